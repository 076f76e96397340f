//! From the values of a configuration to a scene in which nothing is optional.

use gshear_dem::dimension::Dimensions;
use gshear_dem::failure::Result;
use gshear_dem::laws::keys::KeyReader;

use crate::checker::Checker;
use crate::general::{SCENE, check_bookkeeping};
use crate::load::TopWall;
use crate::output::OUTPUT;
use crate::packing::GrainLimit;
use crate::sample::{ReadPacking, SAMPLE};
use crate::scene::{Scene, Stages};
use crate::schedule::packing_steps;
use crate::value::Value;
use crate::walls::{PACK, PlaneShear};
use crate::{extent, law, materials, periodic, time, walls, write};

/// Checks every value by itself, then those that must agree, and derives what follows. `boxed`: the
/// scene has a `[box]`; `limit`: of inserted grains; `packing` is called for the file of a packing,
/// if the scene has one.
pub(crate) fn scene(
    mut c: Checker<'_>,
    boxed: bool,
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
    time::check(c, &law, boxed);
    check_limit(c, limit);
    let checkpoint_time = c.number_or_default(&OUTPUT.checkpoint_time);
    let keep_checkpoints = c.flag_or_default(&OUTPUT.keep_checkpoints);
    let bookkeeping = check_bookkeeping(c);
    let (default_title, sample, mut stages) = if boxed {
        let (sample, periodic) = periodic::check(c, seed, packing)?;
        ("Periodic box", sample, Stages::Strain(periodic))
    } else {
        let (sample, walls) = walls::check(c, &law, &materials.masses, packing)?;
        ("Plane shear", sample, Stages::Shear(walls))
    };
    if !c.is_given(&SCENE.title) {
        c.fill(&SCENE.title, default_title);
    }
    for (law, contact) in &materials.laws {
        law::check_attraction(c, law, contact, &sample);
    }
    let time_step = time::derive(c, &materials, &sample, stages.shear())?;
    if let Stages::Shear(walls) = &mut stages {
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
    scene.toml = write::toml(c, &scene);
    Ok(scene)
}

/// Refuses more inserted grains than the limit.
fn check_limit(c: &mut Checker<'_>, limit: &GrainLimit) {
    let range = i64::from(limit.most) + 1..=i64::from(u32::MAX);
    if let Some(Value::Whole(grains)) = c.value(&SAMPLE.grains)
        && range.contains(grains)
    {
        let GrainLimit { most, reason } = limit;
        let what = format!("{grains} grains are more than the {most} that {reason}; give fewer");
        c.refuse(&SAMPLE.grains, &what);
    }
}

/// Steps of a packing that are allowed, over those that are expected, if none are given.
const PATIENCE: f64 = 10.0;

/// Stiff samples come to rest in as many more steps as their time step is shorter.
fn allow_steps(c: &mut Checker<'_>, scene: &mut Scene) {
    let Some(PlaneShear { load, .. }) = scene.shear() else {
        return;
    };
    let allowed = PATIENCE * packing_steps(scene, load);
    if let Stages::Shear(walls) = &mut scene.stages
        && !c.is_given(&PACK.max_steps)
    {
        walls.pack.max_steps = walls.pack.max_steps.max(allowed as u64);
        c.fill(&PACK.max_steps, walls.pack.max_steps);
    }
}
