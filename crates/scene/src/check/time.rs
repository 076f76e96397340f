//! The time step: `[time]`.

use crate::checker::Checker;
use crate::derived;
use crate::kind::Number;
use crate::raw;
use crate::scene::{Boundary, Contact, Law, Sample, StepChoice, TimeStep};
use crate::words::show;
use gshear_dem::failure::Failure;

/// Overlap over d̄ that packings in a box are expected to have, of which ten times bounds Δt.
const BOX_OVERLAP: f64 = 0.03;

/// Checks each key by itself. `boxed`: the scene has a `[box]`.
pub(super) fn check(c: &mut Checker<'_>, time: &raw::Time, law: &Law, boxed: bool) {
    let step = c.number(&time.step);
    let collision_speed = match boxed {
        true => {
            c.useless(&time.collision_speed, "applies to scenes with walls only");
            None
        }
        false => {
            c.at_most_one(&[&time.step, &time.collision_speed]);
            c.number(&time.collision_speed)
        }
    };
    if c.flag_or_default(&time.force) && step.is_none() && collision_speed.is_none() {
        c.refuse(
            &time.force,
            "there is no step to force; give time.step (s), or leave both out",
        );
    }
    if collision_speed.is_some() && law.collision_time(1.0, 1.0).is_none() {
        c.refuse(
            &time.collision_speed,
            "applies to laws whose collisions take a time that depends on their speed, such as \"hertz\"; give time.step (s), or leave it out",
        );
    }
}

/// Δt and its limit.
pub(super) fn derive(
    c: &mut Checker<'_>,
    time: &raw::Time,
    (law, contact): (&Law, &Contact),
    sample: &Sample,
    boundary: &Boundary,
) -> Result<TimeStep, Failure> {
    let (mean_overlap, walls) = match boundary {
        Boundary::Walls(walls) => (
            super::shear::greatest_overlap(law, sample, walls),
            Some(walls),
        ),
        Boundary::Periodic(_) => (BOX_OVERLAP * sample.mean_diameter, None),
    };
    let friction = contact.friction > 0.0 || walls.is_some_and(|walls| walls.pack.friction > 0.0);
    let limit_of = |law: &Law| derived::step_limit(law, contact, sample, mean_overlap, friction);
    let mut limit = limit_of(law);
    if let Some(walls) = walls.filter(|walls| !walls.pack.skip) {
        let packing = law.while_packing(sample.mean_diameter, walls.load.pressure);
        limit = limit.min(limit_of(&packing));
    }
    let contact_time = derived::contact_time(law, sample, mean_overlap);
    let default = derived::default_step(contact_time, limit);
    let (given, step, key) = match (time.step.value(), time.collision_speed.value()) {
        (Some(step), _) => (StepChoice::Given, step.0, &time.step),
        (None, Some(&Number(speed))) => {
            let duration = law.collision_time(sample.radius_min, speed);
            let step = 0.01 * duration.unwrap_or(f64::NAN);
            let key = &time.collision_speed;
            (StepChoice::Collision(speed), step, key)
        }
        (None, None) => (StepChoice::Derived, default, &time.step),
    };
    let force = c.flag_or_default(&time.force);
    if step > limit && !force {
        c.refuse(
            key,
            &format!(
                "{} s is over the stability limit of {limit:.3e} s; give less, or leave it out for {default:.3e} s, or run it all the same with time.force = true",
                show(step)
            ),
        );
    }
    c.settle()?;
    // Values that are each within their bounds can still overflow together.
    if let Some(x) = [step, limit].iter().find(|x| !x.is_normal()) {
        return Err(c.out_of_range(&format!(
            "the time step comes out as {x:?} s; check the units of [material], [contact] and [sample]"
        )));
    }
    Ok(TimeStep {
        step,
        limit,
        given,
        force,
    })
}
