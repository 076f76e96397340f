//! The ends of a run that starts from a checkpoint: none may lie before it, and the drive up to
//! there must be the one that led to it.

use gshear_dem::failure::{Failure, Result};
use gshear_scene::schedule::Schedule;
use gshear_scene::{PeriodicBox, Stages};

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
        Start::Insertion | Start::Grains(_) => (None, None),
    };
    let scene = &task.scene;
    if let Some(stop) = stop_at {
        check_stop(header, stop)?;
    }
    let (Some(header), Some(before)) = (header, before) else {
        return Ok(());
    };
    match (&scene.stages, &before.stages) {
        (Stages::Shear(walls), Stages::Shear(former)) => {
            let former = WallScene {
                scene: before,
                walls: former,
            };
            between_walls(header, WallScene { scene, walls }, former)
        }
        (Stages::Strain(periodic), Stages::Strain(former)) => {
            in_a_box(header, scene.time_step.step, periodic, former)
        }
        // A scene of the other kind is refused where its stages begin.
        _ => Ok(()),
    }
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

fn between_walls(header: &Header, now: WallScene<'_>, former: WallScene<'_>) -> Result<()> {
    let most_steps = now.walls.pack.max_steps;
    match header {
        Header::Pack(pack) if most_steps < pack.step => {
            past(header, "pack.max_steps", format!("step {most_steps}"))
        }
        Header::Shear(shear) => {
            let schedule = now.schedule(shear.height);
            let earlier = former.schedule_by_step_of(now.scene, shear.height);
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

fn in_a_box(
    header: &Header,
    time_step: f64,
    periodic: &PeriodicBox,
    former: &PeriodicBox,
) -> Result<()> {
    match header {
        Header::Strain(strain) => {
            let steps = periodic.aqs.steps;
            let unfinished = strain.unfinished.as_ref();
            let is_begun = unfinished.is_some_and(|unfinished| unfinished.work.is_step());
            if steps < strain.progress.steps + u64::from(is_begun) {
                return past(header, "aqs.steps", format!("strain step {steps}"));
            }
        }
        Header::Newtonian(checkpoint) => {
            let (aqs, aqs_before) = (&periodic.aqs, &former.aqs);
            if aqs.steps != aqs_before.steps || aqs.until_imaginary != aqs_before.until_imaginary {
                return past(header, "aqs", "another strain step");
            }
            let Some(newtonian) = &periodic.newtonian else {
                return past(header, "newtonian", "the last strain step");
            };
            let pair = checkpoint.progress.pair.as_ref();
            let steps = steps_of_newtonian(newtonian, pair, time_step);
            if steps < checkpoint.step {
                return past(header, "newtonian.growth_times", format!("step {steps}"));
            }
        }
        Header::Pack(_) | Header::Shear(_) | Header::Prepare(_) => {}
    }
    Ok(())
}
