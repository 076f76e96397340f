//! Preparation of a packing at its solid fraction, without friction: grains on a loose lattice are
//! compressed step by step, or grains at random places of the box are moved apart; then they are
//! brought to rest.

use std::ops::Range;

use bytemuck::Zeroable;

use super::assembly::Assembly;
use super::relax::NOT_AT_REST;
use super::scatter::{PlacedGrain, move_apart};
use crate::header::PrepareHeader;
use crate::run::Run;
use gshear_dem::dimension::Dimension;
use gshear_dem::drive::{NoWalls, Overdamped};
use gshear_dem::failure::{Failure, Result};
use gshear_dem::kernel::PairForce;
use gshear_dem::state::{GrainState, Snapshot};
use gshear_scene::insertion::{Radii, stream};
use gshear_scene::{Origin, Placement, QuasiStatic, Sample, Scene, Sizes};
use gshear_store::status::StageProgress;

/// Lattice constant over the greatest diameter.
const ROOM: f64 = 1.1;
/// Relative change of the box length in a compression step.
const SHRINKING: f64 = 0.995;
/// Steps of overdamped dynamics between two compression steps, and the drag in 1/Δt.
const SETTLING: u64 = 300;
const DRAG: f64 = 0.02;

/// Steps in which a packing comes to rest, as a guess.
const TO_REST: u64 = 10_000;

/// If the grains leave the contact law in a smaller box, the box shrinks by half as much, from the
/// state before; at most so many times in turn.
const MOST_HALVINGS: i32 = 6;

/// Greatest overlap of random grains that were moved apart, over the largest of the law: what the
/// law moves may overlap more for a while.
const CLOSEST: f64 = 0.9;

/// The packing at rest, without friction; `None` if the run was asked to stop before. There are no
/// checkpoints of a preparation. Collective.
pub(super) fn prepare<D: Dimension>(
    run: &mut Run<'_>,
    quasi_static: &QuasiStatic,
    law: &dyn PairForce<D>,
) -> Result<Option<Snapshot>> {
    match quasi_static.placement {
        Placement::Lattice => compress(run, quasi_static, law),
        Placement::Random => {
            let progress = StageProgress {
                stage: super::PREPARE.into(),
                ..StageProgress::default()
            };
            run.terminal.begin(&progress);
            part(run, quasi_static, law)
        }
    }
}

/// The sizes of the grains that are inserted.
fn sizes_of(quasi_static: &QuasiStatic) -> &Sizes {
    match &quasi_static.origin {
        Origin::Insertion(sizes) => sizes,
        Origin::Packing(_) | Origin::StageBefore { .. } => {
            unreachable!("only inserted grains are prepared")
        }
    }
}

/// A guess how many steps a preparation takes. How long the grains take to come to rest is not
/// known in advance, nor how often a compression step is halved.
pub(crate) fn steps(scene: &Scene, quasi_static: &QuasiStatic) -> u64 {
    let boxes = match quasi_static.placement {
        Placement::Lattice => {
            let loosest = BoxLattice::new(&scene.sample).length;
            let shrinks = (loosest / scene.sample.length).max(1.0).ln() / -SHRINKING.ln();
            shrinks.ceil() as u64
        }
        Placement::Random => 0,
    };
    (boxes + 10) * SETTLING + TO_REST
}

/// The packing of grains that begin at random places of the box; `None` if asked to stop.
fn part<D: Dimension>(
    run: &Run<'_>,
    quasi_static: &QuasiStatic,
    law: &dyn PairForce<D>,
) -> Result<Option<Snapshot>> {
    let (exchange, scene) = (run.exchange, run.scene);
    let length = scene.sample.length;
    let cell = scene.sample.box_cell(length);
    let remedy =
        "give a lower sample.solid_fraction, another seed, or sample.placement = \"lattice\"";
    let mut placed = random_places(scene, sizes_of(quasi_static));
    // All ranks take the same steps.
    let moved = move_apart::<D>(
        &mut placed,
        cell,
        |a, b| scene.law.largest_overlap(a, b),
        || run.should_stop(),
    );
    let greatest = match moved {
        Ok(Some(greatest)) => greatest,
        Ok(None) => return Ok(None),
        Err(steps) => {
            let what = format!("random grains still move apart after {steps} steps; {remedy}");
            return Err(in_preparation(scene, length, &what));
        }
    };
    if greatest > CLOSEST {
        let what = format!(
            "random grains that were moved apart still overlap by {greatest:.2} of the largest overlap of the law, and {CLOSEST} is the most to begin with; {remedy}"
        );
        return Err(in_preparation(scene, length, &what));
    }
    // Ids ascend along x, as those of the lattice.
    placed.sort_by(|a, b| a.position[0].total_cmp(&b.position[0]));
    let share = share_of(scene.sample.grains, exchange.rank(), exchange.size());
    let grains = share.map(|id| {
        let PlacedGrain { position, radius } = placed[id as usize];
        GrainState {
            id,
            position,
            radius,
            ..GrainState::zeroed()
        }
    });
    let mut assembly = Assembly::new(run, scene, cell, law)?;
    let mut grains: Vec<_> = grains.collect();
    (scene.materials).give(scene.seed, scene.sample.radius_max, &mut grains);
    assembly.replace(&mut NoWalls, grains, Vec::new())?;
    let packing = match settle(run, &mut assembly, 10 * SETTLING) {
        Ok(true) => return Ok(None),
        Ok(false) => rest(run, quasi_static, &mut assembly),
        Err(failure) => Err(failure),
    };
    packing.map_err(|failure| match failure {
        Failure::Numbers(what) => in_preparation(scene, length, &format!("{what}; {remedy}")),
        other => other,
    })
}

/// Brings a packing in its box to rest by overdamped dynamics with the drag of the scene; `None` if
/// asked to stop.
fn rest<D: Dimension>(
    run: &Run<'_>,
    quasi_static: &QuasiStatic,
    assembly: &mut Assembly<'_, D>,
) -> Result<Option<Snapshot>> {
    let mut steps = 0;
    assembly.begin_overdamped(&quasi_static.relax)?;
    while !assembly.overdamped(&quasi_static.relax, &mut steps)? {
        if run.should_stop() {
            return Ok(None);
        }
    }
    run.terminal.prepared(steps);
    Ok(Some(assembly.snapshot()))
}

/// The packing of grains that begin on a lattice; `None` if asked to stop.
fn compress<D: Dimension>(
    run: &mut Run<'_>,
    quasi_static: &QuasiStatic,
    law: &dyn PairForce<D>,
) -> Result<Option<Snapshot>> {
    let (exchange, scene) = (run.exchange, run.scene);
    let target = scene.sample.length;
    let (mut length, mut grains) = insert(
        scene,
        sizes_of(quasi_static),
        exchange.rank(),
        exchange.size(),
    );
    length = length.max(target);
    // The last box in which the grains settled, and the grains there.
    let mut settled: Option<(f64, Vec<GrainState>)> = None;
    let mut halvings = 0;
    let lengths = BoxLengths {
        loosest: length,
        target,
    };
    let mut boxes = 0;
    run.terminal.begin(&lengths.progress(boxes, length));
    loop {
        boxes += 1;
        run.terminal.progress(&lengths.progress(boxes, length));
        let mut assembly = Assembly::new(run, scene, scene.sample.box_cell(length), law)?;
        assembly.replace(&mut NoWalls, grains, Vec::new())?;
        // At the end the waves of the last steps must decay before the relaxation: with a weak drag
        // of the scene they might lead to overlaps outside the law.
        let settling = if length == target {
            10 * SETTLING
        } else {
            SETTLING << halvings
        };
        let mut moved = settle(run, &mut assembly, settling);
        if moved == Ok(true) {
            return Ok(None);
        }
        if moved.is_ok() && length == target {
            match rest(run, quasi_static, &mut assembly) {
                Ok(state) => return Ok(state),
                Err(Failure::Numbers(m)) if m.starts_with(NOT_AT_REST) => {
                    keep(run, boxes, settled);
                    return Err(in_preparation(scene, length, &m));
                }
                Err(failure) => moved = Err(failure),
            }
        }
        match (moved, &settled) {
            (Ok(_), _) => {
                settled = Some((length, assembly.system.grain_states()));
                halvings = 0.max(halvings - 1);
            }
            (Err(Failure::Numbers(_)), Some(_)) if halvings < MOST_HALVINGS => halvings += 1,
            (Err(Failure::Numbers(m)), _) => {
                let what = format!(
                    "{m}, after {halvings} halvings of the compression step; give a lower sample.solid_fraction, or another seed"
                );
                keep(run, boxes, settled);
                return Err(in_preparation(scene, length, &what));
            }
            (Err(other), _) => return Err(other),
        }
        let Some((from, at_rest)) = &settled else {
            unreachable!("the first box either settles or fails")
        };
        let shrinking = match halvings {
            0 => SHRINKING,
            n => 1.0 - (1.0 - SHRINKING) * 0.5f64.powi(n),
        };
        let next = (shrinking * from).max(target);
        grains = shrunk(at_rest, *from, next, &scene.sample);
        length = next;
    }
}

/// Lengths of the first and of the last box of a compression (m).
struct BoxLengths {
    loosest: f64,
    target: f64,
}

impl BoxLengths {
    /// The progress after so many boxes, in one of this length (m).
    fn progress(&self, boxes: u64, length: f64) -> StageProgress {
        let shrunk = (self.loosest / length).ln();
        StageProgress {
            stage: super::PREPARE.into(),
            step: boxes,
            // The length shrinks by the same part in every step.
            fraction: Some(shrunk / (self.loosest / self.target).ln().max(1e-9)),
            ..StageProgress::default()
        }
    }
}

/// Keeps the last box in which the grains settled, if there is one, after so many boxes.
fn keep(run: &mut Run<'_>, step: u64, settled: Option<(f64, Vec<GrainState>)>) {
    if let Some((length, grains)) = settled {
        run.keep_prepared(PrepareHeader { step, length }, grains);
    }
}

/// The grains of a box of L_x = `from` at rest in one of L_x = `to` (m).
fn shrunk(settled: &[GrainState], from: f64, to: f64, sample: &Sample) -> Vec<GrainState> {
    let part = to / from;
    let lengths = sample.box_axes(to);
    let mut grains = settled.to_vec();
    for g in &mut grains {
        for x in &mut g.position {
            *x *= part;
        }
        // Rounded up to the new period.
        for (x, length) in g.position.iter_mut().zip(&lengths) {
            if *x >= *length {
                *x = 0.0;
            }
        }
        (g.velocity, g.angular_velocity) = ([0.0; 3], [0.0; 3]);
    }
    grains
}

/// Lets the grains move with a strong drag. Returns whether it ended before, because the run is to
/// stop. Collective.
fn settle<D: Dimension>(run: &Run<'_>, assembly: &mut Assembly<'_, D>, steps: u64) -> Result<bool> {
    let mut drive = Overdamped {
        drag: DRAG / assembly.system.step,
    };
    assembly.initial_forces(&mut drive, false)?;
    for _ in 0..steps {
        if assembly.advance(&mut drive, false, run.asked_to_stop())? {
            return Ok(true);
        }
    }
    Ok(false)
}

fn in_preparation(scene: &Scene, length: f64, what: &str) -> Failure {
    let sample = &scene.sample;
    let volume = f64::from(sample.grains) * sample.mean_volume;
    let fraction = volume / sample.box_axes(length).iter().product::<f64>();
    Failure::numbers(format!(
        "preparing the packing in a box {length:.4e} long, solid fraction {fraction:.4}, {what}"
    ))
}

/// A lattice in a box on which no grains touch.
struct BoxLattice {
    /// Sites along each axis.
    sites: Vec<u32>,
    /// Distance between them along each axis (m).
    spacing: Vec<f64>,
    /// L_x of its box, whose lengths have the ratios of the sample (m).
    length: f64,
}

impl BoxLattice {
    fn new(sample: &Sample) -> Self {
        let ratios = sample.box_axes(1.0);
        let mut sites = vec![1u32; ratios.len()];
        // L_x over the distance between sites.
        let mut length = ratios.iter().map(|ratio| 1.0 / ratio).fold(0.0, f64::max);
        loop {
            // As many as there is room for in this box.
            for (along, ratio) in sites.iter_mut().zip(&ratios) {
                while f64::from(*along + 1) / ratio <= length {
                    *along += 1;
                }
            }
            let all: u64 = sites.iter().map(|along| u64::from(*along)).product();
            if all >= u64::from(sample.grains) {
                break;
            }
            // The next box with room for one more.
            let next = sites.iter().zip(&ratios);
            length = next
                .map(|(along, ratio)| f64::from(along + 1) / ratio)
                .fold(f64::INFINITY, f64::min);
        }
        let unit = (2.0 * ROOM * sample.radius_max).max(sample.length / length);
        let spacing = sites.iter().zip(&ratios);
        Self {
            spacing: spacing
                .map(|(along, ratio)| unit * (length * ratio / f64::from(*along)))
                .collect(),
            sites,
            length: unit * length,
        }
    }
}

/// The length of a box in which no grains touch, and this rank's part of the grains, at rest.
fn insert(scene: &Scene, sizes: &Sizes, rank: usize, ranks: usize) -> (f64, Vec<GrainState>) {
    let count = scene.sample.grains;
    let lattice = BoxLattice::new(&scene.sample);
    let sites: u64 = lattice
        .sites
        .iter()
        .map(|along| u64::from(*along))
        .product();
    let radii = Radii::in_box(scene.seed, &scene.sample, sizes);
    let mut grains = Vec::new();
    for id in share_of(count, rank, ranks) {
        let mut uniform = stream(scene.seed, id);
        let radius = radii.radius(id, &mut uniform);
        let mut site = u64::from(id) * sites / u64::from(count);
        let mut position = [0.0; 3];
        // x varies most slowly, so that ids ascend along it.
        for (axis, &along) in lattice.sites.iter().enumerate().rev() {
            let at = site % u64::from(along);
            site /= u64::from(along);
            let room = lattice.spacing[axis];
            let free = room - 2.0 * radius;
            position[axis] = room * at as f64 + radius + free * uniform();
        }
        grains.push(GrainState {
            id,
            position,
            radius,
            ..GrainState::zeroed()
        });
    }
    (scene.materials).give(scene.seed, scene.sample.radius_max, &mut grains);
    (lattice.length, grains)
}

/// The ids that a rank inserts.
pub(crate) fn share_of(grains: u32, rank: usize, ranks: usize) -> Range<u32> {
    let [first, end] =
        [rank, rank + 1].map(|r| (u64::from(grains) * r as u64 / ranks as u64) as u32);
    first..end
}

/// All grains at random places of the box, the same on every rank.
fn random_places(scene: &Scene, sizes: &Sizes) -> Vec<PlacedGrain> {
    let sample = &scene.sample;
    let radii = Radii::in_box(scene.seed, &scene.sample, sizes);
    let mut placed = Vec::new();
    for id in 0..sample.grains {
        let mut uniform = stream(scene.seed, id);
        let radius = radii.radius(id, &mut uniform);
        let mut position = [0.0; 3];
        for (x, length) in position.iter_mut().zip(sample.box_axes(sample.length)) {
            // Rounding must not make it the period.
            *x = (length * uniform()).min(length.next_down());
        }
        placed.push(PlacedGrain { radius, position });
    }
    placed
}

#[cfg(test)]
mod tests {
    use super::*;
    use gshear_dem::dimension::{Three, Two};
    use gshear_dem::state::length;
    use gshear_scene::{Dimensions, Source, load};

    const TEXT: &str = include_str!("../../../../configs/bonfanti.toml");

    /// The scene of a box, and the sizes of its grains.
    fn scene(text: &str, sets: &[&str]) -> (Scene, Sizes) {
        let sets: Vec<String> = sets.iter().map(ToString::to_string).collect();
        let scene = load(&Source::new("a box", text), &sets).unwrap();
        let sizes = sizes_of(scene.stages.strain.as_ref().unwrap()).clone();
        (scene, sizes)
    }

    #[test]
    fn grains_do_not_overlap_and_half_of_them_are_large() {
        for dimension in [Dimensions::Two, Dimensions::Three] {
            let (scene, sizes) = scene(TEXT, &[&format!("dimension={}", dimension.axes())]);
            let (box_length, grains) = insert(&scene, &sizes, 0, 1);
            let part = |rank| insert(&scene, &sizes, rank, 3).1;
            let parts: Vec<_> = (0..3).flat_map(part).collect();
            assert_eq!(grains, parts);
            assert_eq!(grains.len(), 100);
            let large = |g: &&GrainState| g.radius == scene.sample.radius_max;
            assert_eq!(grains.iter().filter(large).count(), 50);
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

    /// The ratios of the lengths are those of the scene, the volume that of the solid fraction, and
    /// grains on the lattice touch no others and no images of themselves in their box, whose ratios
    /// are the same.
    #[test]
    fn a_box_has_the_ratios_of_the_scene() {
        for (axes, aspect, ratios) in [
            (2, "[2.0,1.0]", [1.0, 0.5]),
            (2, "[1,3]", [1.0, 3.0]),
            (3, "[1,1.25,0.8]", [1.25, 0.8]),
            (3, "[3,2,2]", [2.0 / 3.0, 2.0 / 3.0]),
        ] {
            let dimension = format!("dimension={axes}");
            let aspect = format!("sample.aspect={aspect}");
            let (scene, sizes) = scene(TEXT, &[&dimension, &aspect, "sample.grains=400"]);
            let sample = &scene.sample;
            let [long, width, height] = sample.box_lengths(sample.length);
            if axes == 3 {
                assert!((width / long / ratios[0] - 1.0).abs() < 1e-15);
                assert_eq!(width, sample.width);
            }
            assert!((height / long / ratios[1] - 1.0).abs() < 1e-15);
            let (box_length, grains) = insert(&scene, &sizes, 0, 1);
            let volume = |g: &GrainState| scene.dimension.volume(g.radius);
            let all = grains.iter().map(volume).sum::<f64>();
            let fraction = all / (long * width * height);
            let expected = scene.stages.strain.as_ref().expect("a box").solid_fraction;
            assert!((fraction / expected - 1.0).abs() < 1e-13, "{fraction}");
            let parts: Vec<_> = (0..3)
                .flat_map(|rank| insert(&scene, &sizes, rank, 3).1)
                .collect();
            assert_eq!(grains, parts);
            let cell = sample.box_cell(box_length);
            for (k, a) in grains.iter().enumerate() {
                assert!(a.position[0] <= box_length);
                for b in &grains[..k] {
                    let apart = match scene.dimension {
                        Dimensions::Two => cell.separation::<Two>(&a.position, &b.position),
                        Dimensions::Three => cell.separation::<Three>(&a.position, &b.position),
                    };
                    assert!(length(apart) > a.radius + b.radius);
                }
            }
            // The lattice is not much larger than its grains need.
            let sites: u64 = BoxLattice::new(sample)
                .sites
                .iter()
                .map(|n| u64::from(*n))
                .product();
            assert!((400..800).contains(&sites), "{sites}");
        }
    }

    /// The grains that are drawn have the solid fraction that is asked for, however they are
    /// distributed.
    #[test]
    fn the_solid_fraction_is_that_of_the_grains() {
        let is_of_binary = |line: &&str| line.starts_with("large_fraction");
        let without = TEXT.lines().filter(|line| !is_of_binary(line));
        let without = without.collect::<Vec<_>>().join("\n");
        let binary = &["sample.sizes=binary", "sample.large_fraction=0.333"];
        for (text, sizes) in [(&*without, &["sample.sizes=uniform"][..]), (TEXT, binary)] {
            for (seed, axes) in [(1, 2), (2, 2), (3, 3), (4, 3)] {
                let seed = format!("seed={seed}");
                let dimension = format!("dimension={axes}");
                let sets = [sizes, &[&seed, &dimension, "sample.solid_fraction=0.6"]].concat();
                let (scene, sizes) = scene(text, &sets);
                let (_, grains) = insert(&scene, &sizes, 0, 1);
                let volume = |g: &GrainState| scene.dimension.volume(g.radius);
                let all = grains.iter().map(volume).sum::<f64>();
                let fraction = all / scene.sample.length.powi(axes);
                assert!((fraction - 0.6).abs() < 1e-13, "{sets:?}: {fraction}");
            }
        }
    }
}
