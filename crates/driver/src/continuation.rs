//! Where a branch goes on whose time step is another one than that of its checkpoint.
//!
//! Steps of a stage are counted by its time step. With another one a branch counts them anew: it
//! begins at the step that has the same place in the motion of the drive, to half a step, and at
//! the very time and place of the checkpoint.

use gshear_scene::schedule::Schedule;
use gshear_scene::{Motion, PlaneShear, Scene, WallSpeed};

use crate::header::{Header, ShearHeader, TimeOrigin};

/// Counts the steps of the checkpoint of a branch by the time step of its scene `now`, if that is
/// not the one of the scene `before`.
pub(crate) fn count_anew(header: &mut Header, before: &Scene, now: &Scene) {
    let [old, new] = [before, now].map(|scene| scene.time_step.step);
    match header {
        Header::Shear(shear) => {
            if let (Some(former), Some(now)) = (WallScene::of(before), WallScene::of(now)) {
                count_shear_anew(shear, former, now);
            }
        }
        Header::Newtonian(newtonian) if old != new => {
            let time = newtonian.origin.time(newtonian.step, old);
            let step = (newtonian.step as f64 * (old / new)).round() as u64;
            newtonian.step = step;
            newtonian.origin = TimeOrigin { step, time };
        }
        _ => {}
    }
}

/// A scene with a shear.
#[derive(Clone, Copy)]
pub(crate) struct WallScene<'a> {
    pub scene: &'a Scene,
    pub walls: &'a PlaneShear,
}

impl<'a> WallScene<'a> {
    /// `None` without a shear.
    pub(crate) fn of(scene: &'a Scene) -> Option<Self> {
        let walls = scene.shear()?;
        Some(Self { scene, walls })
    }

    /// The schedule of a sheared layer of this height (m).
    pub(crate) fn schedule(self, height: f64) -> Schedule {
        Schedule::new(self.scene, self.walls, height)
    }

    /// The same with the time step of another scene.
    pub(crate) fn schedule_by_step_of(self, other: &Scene, height: f64) -> Schedule {
        let scene = Scene {
            time_step: other.time_step,
            ..self.scene.clone()
        };
        Schedule::new(&scene, self.walls, height)
    }

    /// The inertial number that gives the speed of the drive, if one does.
    fn inertial_number(self) -> Option<f64> {
        match self.walls.shear.motion {
            Motion::Strain {
                drive: WallSpeed::InertialNumber(number),
                ..
            } => Some(number),
            _ => None,
        }
    }
}

fn count_shear_anew(shear: &mut ShearHeader, former: WallScene<'_>, now: WallScene<'_>) {
    let Some(mut slider) = shear.slider else {
        return;
    };
    let earlier = shear.with_ends(former.schedule(shear.height));
    let ratio = earlier.step / now.scene.time_step.step;
    for end in &mut shear.ends {
        end.steps = ((end.steps as f64 * ratio).round() as u64).max(1);
    }
    let schedule = shear.with_ends(now.schedule(shear.height));
    let position = earlier.protocol.position(shear.step);
    let step = if has_another_speed(former, now, shear.height) {
        schedule.step_at(position)
    } else if earlier.step != schedule.step {
        let rescaled = former.schedule_by_step_of(now.scene, shear.height);
        let rescaled = shear.with_ends(rescaled);
        rescaled.step_of(&earlier, shear.step)
    } else {
        return;
    };
    let time = shear.origin.time(shear.step, earlier.step);
    shear.origin = TimeOrigin { step, time };
    shear.step = step;
    slider.step = step;
    // The drive stays where it is.
    slider.pulled += position - schedule.protocol.position(step);
    shear.slider = Some(slider);
}

/// Whether a drive of one inertial number has another speed, because its time √(m̄/P) or its height
/// has changed. The speed is no key, and may change in a branch.
pub(crate) fn has_another_speed(former: WallScene<'_>, now: WallScene<'_>, height: f64) -> bool {
    let number = former.inertial_number();
    if number.is_none() || number != now.inertial_number() {
        return false;
    }
    let [one, other] = [former, now].map(|scene| scene.schedule(height).protocol.fastest());
    (one - other).abs() > 1e-12 * one
}
