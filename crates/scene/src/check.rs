//! From the values of a configuration to a scene in which nothing is optional.

use gshear_dem::dimension::Dimensions;
use gshear_dem::failure::Result;
use gshear_dem::laws::Law;
use gshear_dem::laws::keys::{AGEING, KeyReader};
use gshear_dem::state::Masses;

use crate::checker::Checker;
use crate::general::{SCENE, check_bookkeeping};
use crate::grains::Sample;
use crate::load::TopWall;
use crate::output::OUTPUT;
use crate::packing::GrainLimit;
use crate::sample::{Origin, ReadPacking, SAMPLE, Walled};
use crate::scene::Scene;
use crate::schedule::packing_steps;
use crate::stages::{GivenStages, RunStage, Stages};
use crate::value::Value;
use crate::walls::{PACK, PlaneShear};
use crate::{
    extent, law, materials, observables, output, quasi_static, sample, time, walls, write,
};

/// Checks every value by itself, then those that must agree, and derives what follows. `given`: the
/// stages whose tables are there; `limit`: of inserted grains; `packing` is called for the file of
/// a packing, if the scene has one.
pub(crate) fn scene(
    mut c: Checker<'_>,
    given: GivenStages,
    limit: &GrainLimit,
    packing: ReadPacking<'_>,
) -> Result<Scene> {
    let c = &mut c;
    let seed = c.count(&SCENE.seed);
    if c.count(&SCENE.dimension) == 3 {
        c.dimension = Dimensions::Three;
    }
    let (law, contact) = law::check(c)?;
    let materials = materials::check(c, &law, &contact)?;
    if given.strains && c.given_number(&AGEING).is_some_and(|growth| growth > 0.0) {
        let what = "is not for strain steps, which take no time, nor for what follows them; \
                    leave it out, or shear at a rate";
        c.refuse(&AGEING, what);
    }
    time::check(c, &law, given.shears);
    check_limit(c, limit);
    let checkpoint_time = c.number_or_default(&OUTPUT.checkpoint_time);
    let keep_checkpoints = c.flag_or_default(&OUTPUT.keep_checkpoints);
    let bookkeeping = check_bookkeeping(c);
    let input = StageInput {
        seed,
        law: &law,
        masses: &materials.masses,
        given,
    };
    let (sample, mut stages) = check_stages(c, input, packing)?;
    let default_title = if given.shears {
        "Plane shear"
    } else {
        "Periodic box"
    };
    if !c.is_given(&SCENE.title) {
        c.fill(&SCENE.title, default_title);
    }
    for (law, contact) in &materials.laws {
        law::check_attraction(c, law, contact, &sample);
    }
    let time_step = time::derive(c, &materials, &sample, &stages)?;
    if let Some(walls) = &mut stages.shear {
        let top = TopWall {
            law: &law,
            sample: &sample,
            load: &walls.load,
            layers: walls.layers(&sample),
            greatest_overlap: walls.greatest_overlap(&law, &contact, &sample),
            step: time_step.step,
        };
        let control = top.control(c);
        top.check_mass(c);
        walls.load.control = control;
        c.settle()?;
    }
    let mut scene = Scene {
        title: c.text(&SCENE.title).unwrap_or(default_title).into(),
        author: c.text(&SCENE.author).map(Into::into),
        seed,
        dimension: c.dimension,
        law,
        contact,
        materials,
        sample,
        time_step,
        stages,
        checkpoint_time,
        keep_checkpoints,
        bookkeeping,
        toml: String::new(),
    };
    allow_steps(c, &mut scene);
    extent::check(c, &scene)?;
    observables::check(c, &mut scene);
    c.settle()?;
    scene.toml = write::toml(c, &scene);
    Ok(scene)
}

/// What the stages need to know of the rest of the scene.
struct StageInput<'a> {
    seed: u64,
    law: &'a Law,
    masses: &'a Masses,
    given: GivenStages,
}

/// Checks the tables of the stages and of the sample, and derives the sample as the first stage
/// takes it.
fn check_stages(
    c: &mut Checker<'_>,
    input: StageInput<'_>,
    packing: ReadPacking<'_>,
) -> Result<(Sample, Stages)> {
    let StageInput {
        seed,
        law,
        masses,
        given,
    } = input;
    let boundary = sample::boundary(c);
    given.check_boundary(c, boundary);
    let newtonian = if given.strains {
        quasi_static::check_newtonian(c)
    } else {
        None
    };
    let order = given.order(c, newtonian.is_some());
    let shears_first = order[0] == RunStage::Shear;
    let grains = if shears_first {
        sample::check(c)
    } else {
        sample::check_boxed(c)
    };
    let strain_keys = given.strains.then(|| quasi_static::check(c));
    if !given.shears {
        output::check_without_shear(c);
    }
    let tables = given
        .shears
        .then(|| walls::check(c, law, boundary, shears_first));
    c.settle()?;
    let mut stages = Stages {
        order,
        shear: None,
        strain: None,
        newtonian,
    };
    let mut sample;
    if shears_first {
        let tables = tables.expect("the tables of the first stage");
        let walled = sample::derive(c, grains, tables.pack.skip, packing)?;
        let shear;
        (sample, shear) = walls::derive(c, tables, law, masses, walled)?;
        if let Some(keys) = strain_keys {
            let height = shear.height(&sample);
            let volume = f64::from(sample.grains) * sample.mean_volume;
            let solid_fraction = volume / (sample.base() * height);
            let origin = Origin::StageBefore { height };
            let strain = quasi_static::derive(c, keys, &sample, origin, solid_fraction)?;
            stages.strain = Some(strain);
        }
        stages.shear = Some(shear);
    } else {
        let keys = strain_keys.expect("the tables of the first stage");
        let (strained, origin, solid_fraction) = quasi_static::sample(c, seed, grains, packing)?;
        sample = strained;
        let strain = quasi_static::derive(c, keys, &sample, origin, solid_fraction)?;
        if let Some(tables) = tables {
            let [_, _, height] = strain.lengths(&sample);
            let left = Walled::left(sample, height);
            let shear;
            (sample, shear) = walls::derive(c, tables, law, masses, left)?;
            stages.shear = Some(shear);
        }
        stages.strain = Some(strain);
    }
    Ok((sample, stages))
}

/// Refuses more inserted grains than the limit.
fn check_limit(c: &mut Checker<'_>, limit: &GrainLimit) {
    let range = i64::from(limit.most) + 1..=i64::from(u32::MAX);
    let (key, grains) = match (c.value(&SAMPLE.grains), c.value(&SAMPLE.radii)) {
        (Some(Value::Whole(grains)), _) => (&SAMPLE.grains, *grains),
        // Only given radii may come without a number of grains.
        (None, Some(Value::Numbers(radii))) => (&SAMPLE.radii, radii.len() as i64),
        _ => return,
    };
    if range.contains(&grains) {
        let GrainLimit { most, reason } = limit;
        let what = format!("{grains} grains are more than the {most} that {reason}; give fewer");
        c.refuse(key, &what);
    }
}

/// Steps of a packing that are allowed, over those that are expected, if none are given.
const PATIENCE: f64 = 10.0;

/// Stiff samples come to rest in as many more steps as their time step is shorter.
fn allow_steps(c: &mut Checker<'_>, scene: &mut Scene) {
    let Some(PlaneShear { load, pack, .. }) = scene.shear() else {
        return;
    };
    if pack.skip {
        return;
    }
    let allowed = PATIENCE * packing_steps(scene, load);
    if let Some(walls) = &mut scene.stages.shear
        && !c.is_given(&PACK.max_steps)
    {
        walls.pack.max_steps = walls.pack.max_steps.max(allowed as u64);
        c.fill(&PACK.max_steps, walls.pack.max_steps);
    }
}
