//! Preparation of a packing at its solid fraction: grains on a loose lattice are compressed step by
//! step without friction, and brought to rest.

use bytemuck::Zeroable;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::relax::overdamped;
use super::setup::system;
use crate::run::{Run, StageState};
use gshear_dem::dimension::Dimension;
use gshear_dem::drive::{NoWalls, Overdamped};
use gshear_dem::failure::Failure;
use gshear_dem::kernel::PairForce;
use gshear_dem::state::GrainState;
use gshear_dem::step::{StepRequest, advance, initial_forces};
use gshear_scene::sample::radius;
use gshear_scene::{PeriodicBox, Scene, Sizes};

/// Lattice constant over the greatest diameter.
const ROOM: f64 = 1.1;
/// Relative change of the box length in a compression step.
const SHRINKING: f64 = 0.995;
/// Steps of overdamped dynamics between two compression steps, and the drag in 1/Δt.
const SETTLING: u64 = 300;
const DRAG: f64 = 0.02;

/// The packing at rest, without friction.
pub(super) fn prepare<D: Dimension>(
    run: &Run<'_>,
    scene: &Scene,
    periodic: &PeriodicBox,
    law: &dyn PairForce<D>,
) -> Result<StageState, Failure> {
    let exchange = run.exchange;
    let target = scene.sample.length;
    let (mut length, mut grains) = insert(scene, &periodic.sizes, exchange.rank(), exchange.size());
    length = length.max(target);
    loop {
        let mut system = system::<D>(run, scene, scene.sample.box_cell(length))?;
        system.replace(exchange, law, &mut NoWalls, grains, Vec::new())?;
        let mut drive = Overdamped {
            drag: DRAG / system.step,
        };
        let in_stage = |e| in_preparation(e, length);
        initial_forces(exchange, &mut system, law, &mut drive, None).map_err(in_stage)?;
        // At the end the waves of the last steps must decay before the relaxation: with a weak drag
        // of the scene they might lead to overlaps outside the law.
        let settling = if length == target {
            10 * SETTLING
        } else {
            SETTLING
        };
        for _ in 0..settling {
            advance(
                exchange,
                &mut system,
                law,
                &mut drive,
                StepRequest::default(),
            )
            .map_err(in_stage)?;
        }
        if length == target {
            let steps =
                overdamped(&periodic.relax, exchange, &mut system, law).map_err(in_stage)?;
            run.terminal.prepared(steps);
            return Ok(StageState {
                grains: system.grain_states(),
                contacts: system.contact_states(law),
                ..StageState::default()
            });
        }
        grains = system.grain_states();
        let next = (SHRINKING * length).max(target);
        let part = next / length;
        for g in &mut grains {
            for x in &mut g.position {
                *x *= part;
            }
            // Rounded up to the new period.
            for x in g.position[..D::AXES].iter_mut().filter(|x| **x >= next) {
                *x = 0.0;
            }
            (g.velocity, g.angular_velocity) = ([0.0; 3], [0.0; 3]);
        }
        length = next;
    }
}

fn in_preparation(failure: Failure, length: f64) -> Failure {
    match failure {
        Failure::Numbers(m) => Failure::Numbers(format!(
            "preparing the packing in a box {length:.4e} long, {m}"
        )),
        other => other,
    }
}

/// The length of a box in which no grains touch, and this rank's part of the grains, at rest.
fn insert(scene: &Scene, sizes: &Sizes, rank: usize, ranks: usize) -> (f64, Vec<GrainState>) {
    let sample = &scene.sample;
    let count = sample.grains;
    let axes = scene.dimension.axes() as u32;
    let side = (1u32..)
        .find(|side| u64::from(*side).pow(axes) >= u64::from(count))
        .unwrap_or(1);
    let room = (2.0 * ROOM * sample.radius_max).max(sample.length / f64::from(side));
    let sites = u64::from(side).pow(axes);
    let large = large(scene, sizes);
    let part = |r: usize| (u64::from(count) * r as u64 / ranks as u64) as u32;
    let grain = |id: u32| {
        let mut random = ChaCha8Rng::seed_from_u64(scene.seed);
        random.set_stream(u64::from(id));
        let mut uniform = || random.random::<f64>();
        let radius = match (sizes, large[id as usize]) {
            (Sizes::Binary { .. }, true) => sample.radius_max,
            (Sizes::Binary { .. }, false) => sample.radius_min,
            _ => radius(sample, sizes, &mut uniform),
        };
        let mut site = u64::from(id) * sites / u64::from(count);
        let mut position = [0.0; 3];
        let free = room - 2.0 * radius;
        // x varies most slowly, so that ids ascend along it.
        for axis in (0..axes as usize).rev() {
            let at = site % u64::from(side);
            site /= u64::from(side);
            position[axis] = room * at as f64 + radius + free * uniform();
        }
        GrainState {
            id,
            position,
            radius,
            ..GrainState::zeroed()
        }
    };
    let grains = (part(rank)..part(rank + 1)).map(grain).collect();
    (room * f64::from(side), grains)
}

/// The large grains of a binary mixture: exactly the number given by its fraction.
fn large(scene: &Scene, sizes: &Sizes) -> Vec<bool> {
    let count = scene.sample.grains as usize;
    let mut large = vec![false; count];
    if let Sizes::Binary { large_fraction } = sizes {
        let many = (large_fraction * count as f64).round() as usize;
        large[..many].fill(true);
        // A stream of random numbers that no grain uses.
        let mut random = ChaCha8Rng::seed_from_u64(scene.seed);
        random.set_stream(u64::MAX);
        large.shuffle(&mut random);
    }
    large
}

#[cfg(test)]
mod tests {
    use super::*;
    use gshear_dem::dimension::{Three, Two};
    use gshear_dem::state::length;
    use gshear_scene::{Boundary, Dimensions, Source, load};

    fn scene(name: &str, sets: &[&str]) -> Scene {
        let path = format!("{}/../../configs/{name}", env!("CARGO_MANIFEST_DIR"));
        let source = Source::read(&path).unwrap();
        let sets: Vec<String> = sets.iter().map(ToString::to_string).collect();
        load(&source, &sets).unwrap()
    }

    #[test]
    fn grains_do_not_overlap_and_half_of_them_are_large() {
        for dimension in [Dimensions::Two, Dimensions::Three] {
            let scene = scene(
                "bonfanti.toml",
                &[&format!("dimension={}", dimension.axes())],
            );
            let Boundary::Periodic(PeriodicBox { sizes, .. }) = &scene.boundary else {
                panic!("walls")
            };
            let (box_length, grains) = insert(&scene, sizes, 0, 1);
            let parts: Vec<_> = (0..3).flat_map(|r| insert(&scene, sizes, r, 3).1).collect();
            assert_eq!(grains, parts);
            assert_eq!(grains.len(), 100);
            let large = grains
                .iter()
                .filter(|g| g.radius == scene.sample.radius_max);
            assert_eq!(large.count(), 50);
            let cell = scene.sample.box_cell(box_length);
            for (k, a) in grains.iter().enumerate() {
                for b in &grains[..k] {
                    let apart = match dimension {
                        Dimensions::Two => cell.separation::<Two>(&a.position, &b.position),
                        Dimensions::Three => cell.separation::<Three>(&a.position, &b.position),
                    };
                    assert!(length(apart) > a.radius + b.radius);
                }
            }
        }
    }
}
