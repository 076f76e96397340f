//! The time step: `[time]`.

use gshear_dem::failure::Result;
use gshear_dem::laws::Law;
use gshear_dem::laws::keys::{Change, KeyReader, POSITIVE};

use crate::checker::Checker;
use crate::derived;
use crate::grains::Sample;
use crate::materials::Materials;
use crate::stages::Stages;
use crate::table::table;
use crate::words::show;

table! {
    /// The time step.
    TIME: TimeKeys "time" All Branch {
        /// Δt
        step: Number(POSITIVE) { unit: "s", condition: "at most the stability limit" },
        /// Δt is a hundredth of the time for which two of the smallest spheres collide at this
        /// speed; laws hertz and hertz-tsuji only
        collision_speed: Number(POSITIVE) {
            unit: "m/s",
            condition: "instead of `step`",
            otherwise: "none",
        },
        /// run with a `step` over the limit
        force: Flag {
            condition: "with `step` or `collision_speed`",
            default: "false",
            change: Change::Resume,
        },
    }
}

/// The time step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeStep {
    /// Δt (s).
    pub step: f64,
    /// The stability limit of Δt (s).
    pub limit: f64,
}

/// Overlap over d̄ that packings are expected to have in strain steps, of which ten times bounds
/// Δt.
const STRAINED_OVERLAP: f64 = 0.03;

/// Checks each key by itself. `shears`: the scene shears at a rate.
pub(crate) fn check(c: &mut Checker<'_>, law: &Law, shears: bool) {
    let keys = &TIME;
    c.number(&keys.step);
    if shears {
        c.at_most_one(&[&keys.step, &keys.collision_speed]);
        c.number(&keys.collision_speed);
    } else {
        let why = "is of a shear at a rate, and this scene has no [shear]";
        c.useless(&keys.collision_speed, why);
    }
    let is_given = [&keys.step, &keys.collision_speed].map(|key| c.is_given(key));
    if c.flag_or_default(&keys.force) && is_given == [false; 2] {
        let what = "there is no step to force; give time.step (s), or leave both out";
        c.refuse(&keys.force, what);
    }
    if is_given[1] && law.collision_time(1.0, 1.0).is_none() {
        c.refuse(
            &keys.collision_speed,
            "applies to laws whose collisions take a time that depends on their speed, such as \"hertz\"; give time.step (s), or leave it out",
        );
    }
}

/// A time to four digits that are no more than it, so that a limit that is said is allowed.
fn rounded_down(time: f64) -> f64 {
    let digit = 10f64.powf(time.log10().floor() - 3.0);
    (time / digit).floor() * digit
}

/// Δt and its limit.
pub(crate) fn derive(
    c: &mut Checker<'_>,
    materials: &Materials,
    sample: &Sample,
    stages: &Stages,
) -> Result<TimeStep> {
    let walls = stages.shear.as_ref();
    let (mut limit, mut contact_time) = (f64::INFINITY, f64::INFINITY);
    for (law, contact) in &materials.laws {
        let mut mean_overlap: f64 = 0.0;
        if let Some(walls) = walls {
            mean_overlap = walls.greatest_overlap(law, contact, sample);
        }
        if stages.strain.is_some() {
            mean_overlap = mean_overlap.max(STRAINED_OVERLAP * sample.mean_diameter);
        }
        let friction =
            contact.friction > 0.0 || walls.is_some_and(|walls| walls.pack.friction > 0.0);
        limit = limit.min(derived::step_limit(
            law,
            contact,
            sample,
            mean_overlap,
            friction,
        ));
        if let Some(walls) = walls
            && !walls.pack.skip
        {
            let packing = law.while_packing(sample.mean_diameter, walls.load.pressure);
            limit = limit.min(derived::step_limit(
                &packing,
                contact,
                sample,
                mean_overlap,
                friction,
            ));
        }
        contact_time = contact_time.min(derived::contact_time(law, sample, mean_overlap));
    }
    let default = derived::default_step(contact_time, limit);
    let keys = &TIME;
    let (step, key) = match (c.number(&keys.step), c.number(&keys.collision_speed)) {
        (Some(step), _) => (step, &keys.step),
        (None, Some(speed)) => {
            // A hundredth of how long two of the least grains collide.
            let duration = materials
                .laws
                .iter()
                .filter_map(|(law, _)| law.collision_time(sample.radius_min, speed))
                .fold(f64::INFINITY, f64::min);
            (0.01 * duration, &keys.collision_speed)
        }
        (None, None) => (default, &keys.step),
    };
    if step > limit && !c.flag_or_default(&keys.force) {
        // The number that is said is allowed, and the default is not over it.
        let allowed = rounded_down(limit);
        let what = format!(
            "{} s is over the stability limit of {allowed:.3e} s; give less, or leave it out for {:.3e} s, or run it all the same with time.force = true",
            show(step),
            default.min(allowed)
        );
        c.refuse(key, &what);
    }
    c.settle()?;
    // Values that are each within their bounds can still overflow together.
    if let Some(x) = [step, limit].iter().find(|x| !x.is_normal()) {
        return Err(c.out_of_range(&format!(
            "the time step comes out as {x:?} s; check the units of [material], [contact] and [sample]"
        )));
    }
    Ok(TimeStep { step, limit })
}
