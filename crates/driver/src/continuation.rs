//! Where a branch goes on whose time step is another one than that of its checkpoint.
//!
//! Steps of a stage are counted by its time step. With another one a branch counts them anew: it
//! begins at the step that has the same place in the motion of the drive, to half a step, and at
//! the very time and place of the checkpoint.

use gshear_scene::schedule::Schedule;
use gshear_scene::{Boundary, Motion, PlaneShear, Scene, WallSpeed};

use crate::header::{Header, ShearHeader, TimeOrigin};

/// Counts the steps of the checkpoint of a branch by the time step of its scene `now`, if that is
/// not the one of the scene `before`.
pub(crate) fn count_anew(header: &mut Header, before: &Scene, now: &Scene) {
    let [old, new] = [before, now].map(|scene| scene.time_step.step);
    match (header, &before.boundary, &now.boundary) {
        (Header::Shear(shear), Boundary::Walls(former), Boundary::Walls(walls)) => {
            count_shear_anew(shear, (before, former), (now, walls));
        }
        (Header::Newtonian { step, origin, .. }, ..) if old != new => {
            let time = origin.time(*step, old);
            *step = (*step as f64 * (old / new)).round() as u64;
            *origin = TimeOrigin { step: *step, time };
        }
        _ => {}
    }
}

fn count_shear_anew(
    shear: &mut ShearHeader,
    (before, former): (&Scene, &PlaneShear),
    (now, walls): (&Scene, &PlaneShear),
) {
    let Some(slider) = &mut shear.slider else {
        return;
    };
    let earlier = Schedule::new(before, former, shear.height);
    let schedule = Schedule::new(now, walls, shear.height);
    let position = earlier.protocol.position(shear.step);
    let step = if has_another_speed([&earlier, &schedule], [former, walls]) {
        schedule.step_at(position)
    } else if earlier.step != schedule.step {
        by_time_step(before, now, former, shear.height).step_of(&earlier, shear.step)
    } else {
        return;
    };
    let time = shear.origin.time(shear.step, earlier.step);
    shear.origin = TimeOrigin { step, time };
    (shear.step, slider.step) = (step, step);
    // The drive stays where it is.
    slider.pulled += position - schedule.protocol.position(step);
}

/// Whether a drive of one inertial number has another speed, because its time √(m̄/P) or its height
/// has changed. The speed is no key, and may change in a branch.
pub(crate) fn has_another_speed(schedules: [&Schedule; 2], walls: [&PlaneShear; 2]) -> bool {
    let numbers = walls.map(|walls| match walls.shear.motion {
        Motion::Strain {
            drive: WallSpeed::InertialNumber(number),
            ..
        } => Some(number),
        _ => None,
    });
    let [one, other] = schedules.map(|of| of.protocol.fastest());
    numbers[0].is_some() && numbers[0] == numbers[1] && (one - other).abs() > 1e-12 * one
}

/// The schedule of the scene `before` with the time step of `now`.
pub(crate) fn by_time_step(
    before: &Scene,
    now: &Scene,
    walls: &PlaneShear,
    height: f64,
) -> Schedule {
    let scene = Scene {
        time_step: now.time_step,
        ..before.clone()
    };
    Schedule::new(&scene, walls, height)
}
