//! The ends of a run that starts from a checkpoint: none may lie before it, and the drive up to
//! there must be the one that led to it.

use gshear_dem::failure::{Failure, Result};
use gshear_scene::schedule::Schedule;
use gshear_scene::{Boundary, PeriodicBox, PlaneShear, Scene};

use crate::continuation::{by_time_step, has_another_speed};
use crate::header::Header;
use crate::stages::newtonian;
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
    match (&scene.boundary, &before.boundary) {
        (Boundary::Walls(walls), Boundary::Walls(former)) => {
            between_walls(header, (scene, walls), (before, former))
        }
        (Boundary::Periodic(periodic), Boundary::Periodic(former)) => {
            in_a_box(header, scene.time_step.step, periodic, former)
        }
        // A scene of the other kind is refused where its stages begin.
        _ => Ok(()),
    }
}

fn check_stop(header: Option<&Header>, stop: u64) -> Result<()> {
    let counted = match header {
        None | Some(Header::Pack(_) | Header::Prepare { .. }) => 0,
        Some(Header::Shear(shear)) => shear.step,
        Some(Header::Aqs { progress, .. }) => progress.steps,
        Some(Header::Newtonian { step, progress, .. }) => progress.steps + step,
    };
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
        "{key}: the run would end at {end}, but the checkpoint is at {} step {}; give a later end, or resume from an earlier checkpoint",
        header.stage(),
        header.step()
    )))
}

fn between_walls(
    header: &Header,
    (scene, walls): (&Scene, &PlaneShear),
    (before, former): (&Scene, &PlaneShear),
) -> Result<()> {
    match header {
        Header::Pack(pack) if walls.pack.max_steps < pack.step => {
            let end = format!("step {}", walls.pack.max_steps);
            past(header, "pack.max_steps", end)
        }
        Header::Shear(shear) => {
            let schedule = Schedule::new(scene, walls, shear.height);
            let earlier = by_time_step(before, scene, former, shear.height);
            if schedule.total < shear.step {
                let strain = schedule.strain(schedule.total);
                let end = format!("step {}, strain {strain:.6}", schedule.total);
                return past(header, "shear", end);
            }
            if has_another_speed([&earlier, &schedule], [former, walls]) {
                return Ok(());
            }
            same_drive(&schedule, &earlier, shear.step).map_err(|failure| {
                let [then, now] = [before, scene].map(|scene| scene.time_step.step);
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
    let parts = [schedule, earlier].map(|of| of.protocol.segments().iter());
    let turns = parts.into_iter().flatten().map(|part| part.first);
    for at in turns.chain([step]).filter(|at| *at <= step) {
        let [now, then] = [schedule, earlier].map(|of| of.protocol.position(at));
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
        Header::Aqs {
            progress,
            unfinished,
            ..
        } => {
            let steps = periodic.aqs.steps;
            let begun = unfinished.as_ref().is_some_and(|of| of.work.is_step());
            if steps < progress.steps + u64::from(begun) {
                return past(header, "aqs.steps", format!("strain step {steps}"));
            }
        }
        Header::Newtonian { step, progress, .. } => {
            let ends = |of: &PeriodicBox| (of.aqs.steps, of.aqs.until_imaginary);
            if ends(periodic) != ends(former) {
                return past(header, "aqs", "another strain step");
            }
            let Some(of) = &periodic.newtonian else {
                return past(header, "newtonian", "the last strain step");
            };
            let steps = newtonian::steps(of, progress.pair.as_ref(), time_step);
            if steps < *step {
                return past(header, "newtonian.growth_times", format!("step {steps}"));
            }
        }
        Header::Pack(_) | Header::Shear(_) | Header::Prepare { .. } => {}
    }
    Ok(())
}
