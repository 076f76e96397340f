//! Plane shear between walls: `[pack]`, and what follows from all of its tables.

use super::sample::SampleKeys;
use super::{analysis, load, sample, shear};
use crate::ReadPacking;
use crate::checker::Checker;
use crate::derived;
use crate::raw::{self, Raw};
use crate::scene::{Boundary, Dimensions, Law, Pack, PlaneShear, Sample, Scene, Walls};
use crate::schedule::packing_steps;
use gshear_dem::failure::Failure;

/// As `super::scene`.
pub(super) fn check(
    c: &mut Checker<'_>,
    dimension: Dimensions,
    law: &Law,
    raw: &Raw,
    packing: ReadPacking<'_>,
) -> Result<(Sample, PlaneShear), Failure> {
    let sample = sample::check(c, dimension, &raw.sample);
    let load = load::check(c, &raw.load);
    let pack = check_pack(c, &raw.pack, &sample);
    let mut shear = shear::check(c, &raw.shear);
    let output = shear::output(c, &raw.output, &shear);
    let analysis = analysis::check(c, &raw.analysis, dimension, &shear, &output);
    c.settle()?;

    let (sample, origin, layers) = sample::derive(c, &sample, pack.skip, packing)?;
    let load = load::derive(c, law, &sample, load)?;
    if !pack.skip {
        load::check_packable(c, law, &sample, &load, &raw.load);
    }
    shear::derive(&mut shear, &sample, &load);
    shear::check_pressures(c, &raw.shear.protocol, &shear, (law, &sample, &load));
    c.settle()?;
    let contact_time = derived::contact_time(law, &sample, load.mean_overlap(&sample));
    // Values that are each within their bounds can still overflow together, such as a radius of
    // 1e-200 m squared.
    let derived = [
        ("pressure", load.pressure),
        ("normal force", load.normal_force),
        ("mean volume of a grain", sample.mean_volume),
        ("time scale of a contact", contact_time),
    ];
    if let Some((name, x)) = derived.iter().find(|(_, x)| !x.is_normal()) {
        return Err(c.out_of_range(&format!(
            "the {name} comes out as {x:?}; check the units (SI) of [material], [sample] and [load]"
        )));
    }
    let walls = PlaneShear {
        origin,
        wall_layers: layers,
        load,
        pack,
        shear,
        output,
        analysis,
    };
    Ok((sample, walls))
}

/// Steps of a packing that are allowed, over those that are expected, if none are given.
const PATIENCE: f64 = 10.0;

/// Stiff samples come to rest in as many more steps as their time step is shorter.
pub(super) fn allow_steps(scene: &mut Scene, raw: &raw::Pack) {
    let Boundary::Walls(walls) = &scene.boundary else {
        return;
    };
    let allowed = PATIENCE * packing_steps(scene, &walls.load);
    if let Boundary::Walls(walls) = &mut scene.boundary
        && !raw.max_steps.is_given()
    {
        walls.pack.max_steps = walls.pack.max_steps.max(allowed as u64);
    }
}

fn check_pack(c: &mut Checker<'_>, pack: &raw::Pack, sample: &SampleKeys<'_>) -> Pack {
    let friction = c.number_or_default(&pack.friction);
    let drag = c.number_or_default(&pack.drag);
    let tolerance = c.number_or_default(&pack.tolerance);
    let max_steps = c.count(&pack.max_steps);
    let packing = sample.raw.packing.is_given();
    let skip = c.flag(&pack.skip).unwrap_or(packing);
    if skip && !packing {
        c.refuse(
            &pack.skip,
            "inserted grains are loose and must be packed; give sample.packing, or leave it out",
        );
    }
    if skip && packing {
        let skipped = match pack.skip.offset() {
            Some(at) => c.mention(at),
            None => "the default with sample.packing".into(),
        };
        let places = [
            pack.friction.place(),
            pack.drag.place(),
            pack.tolerance.place(),
            pack.max_steps.place(),
        ];
        for place in places {
            if place.1.is_some() {
                c.refuse_among(
                    &[place],
                    &format!("says how to pack, but pack.skip = true ({skipped}); leave it out, or give pack.skip = false"),
                );
            }
        }
    }
    if !skip && packing && sample.walls == Some(Walls::Types) {
        c.refuse(
            &pack.skip,
            "contradicts sample.walls = \"types\": a sample that is compressed gets its walls afterwards; leave out one of the two",
        );
    }
    Pack {
        skip,
        friction,
        drag,
        tolerance,
        max_steps,
    }
}
