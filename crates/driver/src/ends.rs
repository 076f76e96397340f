//! The ends of a run that starts from a checkpoint: none may lie before it, and the drive up to
//! there must be the one that led to it.

use gshear_dem::failure::{Failure, Result};
use gshear_scene::schedule::Schedule;
use gshear_scene::{QuasiStatic, RunStage, Scene, Stages};

use crate::continuation::{WallScene, has_another_speed};
use crate::header::Header;
use crate::output_schedule::steps_of_newtonian;
use crate::task::{Start, Task};

/// Refuses ends that lie before the step reached, and another drive up to there.
///
/// # Errors
/// Such an end, or such a drive.
pub(crate) fn check(task: &Task, stop_at: Option<u64>) -> Result<()> {
    let (header, before) = match &task.start {
        Start::Checkpoint(saved, before) => (Some(&saved.header), before.as_deref()),
        Start::Insertion | Start::Packing(_) | Start::StageBefore(_) => (None, None),
    };
    let scene = &task.scene;
    if let Some(stop) = stop_at {
        check_stop(header, stop)?;
    }
    let (Some(header), Some(before)) = (header, before) else {
        return Ok(());
    };
    // A stage that a scene does not have is refused where its stages begin.
    if let Some(stage) = header.run_stage() {
        ended(header, stage, scene, before)?;
    }
    if let (Some(now), Some(former)) = (WallScene::of(scene), WallScene::of(before)) {
        check_shear(header, now, former)?;
    }
    check_strain(header, scene, before)
}

/// Refuses another end of a stage before the one of the checkpoint.
fn ended(header: &Header, stage: RunStage, scene: &Scene, before: &Scene) -> Result<()> {
    let [now, former] = [scene, before].map(|scene| &scene.stages);
    let end_of_strain = |stages: &Stages| {
        let strain = stages.strain.as_ref();
        strain.map(
            |QuasiStatic {
                 aqs, deformation, ..
             }| { (aqs.steps, aqs.until_imaginary, deformation.clone()) },
        )
    };
    if now.after(RunStage::Strain).contains(&stage) && end_of_strain(now) != end_of_strain(former) {
        return past(header, "aqs", "another strain step");
    }
    let motion_of = |stages: &Stages| {
        stages
            .shear
            .as_ref()
            .map(|shear| shear.shear.motion.clone())
    };
    if now.after(RunStage::Shear).contains(&stage) && motion_of(now) != motion_of(former) {
        return past(header, "shear", "another step of it");
    }
    Ok(())
}

fn check_stop(header: Option<&Header>, stop: u64) -> Result<()> {
    let counted = header.map_or(0, Header::counted_steps);
    match counted {
        _ if stop > counted => Ok(()),
        0 => Err(Failure::input(format!(
            "--stop-at {stop}: steps count from 1; give 1 or more"
        ))),
        _ => Err(Failure::input(format!(
            "--stop-at {stop}: the run is at step {counted} already; give a later step"
        ))),
    }
}

/// The failure of an end before the checkpoint.
fn past(header: &Header, key: &str, end: impl std::fmt::Display) -> Result<()> {
    Err(Failure::input(format!(
        "{key}: the run would end at {end}, but the checkpoint is at {}; give a later end, or resume from an earlier checkpoint",
        header.position()
    )))
}

fn check_shear(header: &Header, now: WallScene<'_>, former: WallScene<'_>) -> Result<()> {
    let most_steps = now.walls.pack.max_steps;
    match header {
        Header::Pack(pack) if most_steps < pack.step => {
            past(header, "pack.max_steps", format!("step {most_steps}"))
        }
        Header::Shear(shear) => {
            let schedule = shear.with_ends(now.schedule(shear.height));
            let earlier = former.schedule_by_step_of(now.scene, shear.height);
            let earlier = shear.with_ends(earlier);
            if schedule.total < shear.step {
                let strain = schedule.strain(schedule.total);
                let end = format!("step {}, strain {strain:.6}", schedule.total);
                return past(header, "shear", end);
            }
            if has_another_speed(former, now, shear.height) {
                return Ok(());
            }
            same_drive(&schedule, &earlier, shear.step).map_err(|failure| {
                let [then, now] = [former, now].map(|walls| walls.scene.time_step.step);
                if then == now {
                    return failure;
                }
                Failure::input(format!(
                    "{failure}; the time step has changed too, from {then:?} to {now:?} s: --set time.step={then:?} keeps it"
                ))
            })
        }
        _ => Ok(()),
    }
}

/// Refuses another drive in the first steps.
fn same_drive(schedule: &Schedule, earlier: &Schedule, step: u64) -> Result<()> {
    if !schedule.protocol.agrees(&earlier.protocol, step) {
        return Err(Failure::input(format!(
            "shear.protocol: the first {step} steps would have had other parts; keep those \
             parts as they were, and change only what comes after them"
        )));
    }
    let segments = [schedule, earlier].map(|schedule| schedule.protocol.segments());
    let turns = segments.concat().into_iter().map(|segment| segment.first);
    for at in turns.chain([step]) {
        if at > step {
            continue;
        }
        let now = schedule.protocol.position(at);
        let then = earlier.protocol.position(at);
        // Rounding of a velocity given in another way is no jump of the drive.
        if (now - then).abs() > 1e-12 * then.abs() {
            return Err(Failure::input(format!(
                "shear: the drive has moved {then:.6e} m in the first {at} steps, and would have moved {now:.6e} m; keep its motion up to step {step}, and change it after that with shear.protocol"
            )));
        }
    }
    Ok(())
}

fn check_strain(header: &Header, scene: &Scene, before: &Scene) -> Result<()> {
    let Some(quasi_static) = &scene.stages.strain else {
        return Ok(());
    };
    match header {
        Header::Strain(strain) => {
            let steps = quasi_static.aqs.steps;
            let unfinished = strain.unfinished.as_ref();
            let is_begun = unfinished.is_some_and(|unfinished| unfinished.work.is_step());
            let begun = strain.progress.steps + u64::from(is_begun);
            if steps < begun {
                let key = if quasi_static.deformation.is_protocol() {
                    "aqs.protocol"
                } else {
                    "aqs.steps"
                };
                return past(header, key, format!("strain step {steps}"));
            }
            let former = before.stages.strain.as_ref();
            if former
                .is_some_and(|former| !quasi_static.deformation.agrees(&former.deformation, begun))
            {
                return Err(Failure::input(format!(
                    "aqs.protocol: the first {begun} strain steps would have had other parts; keep those parts as they were, \
                     and change only what comes after them"
                )));
            }
        }
        Header::Newtonian(checkpoint) => {
            let Some(newtonian) = &scene.stages.newtonian else {
                return past(header, "newtonian", "the last strain step");
            };
            let pair = checkpoint.progress.pair.as_ref();
            let steps = steps_of_newtonian(newtonian, pair, scene.time_step.step);
            if steps < checkpoint.step {
                return past(header, "newtonian.growth_times", format!("step {steps}"));
            }
        }
        Header::Pack(_) | Header::Shear(_) | Header::Prepare(_) => {}
    }
    Ok(())
}
