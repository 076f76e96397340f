//! The load: `[load]`.

use crate::checker::Checker;
use crate::derived::{self, STIFFNESS_NUMBER_MAX, STIFFNESS_NUMBER_MIN};
use crate::key::Key;
use crate::kind::Number;
use crate::raw;
use crate::scene::{Control, Law, Load, LoadChoice, PlaneShear, Sample};
use crate::words::show;
use gshear_dem::failure::Failure;

/// One of the ways to say it, its key and value, g (m/s²), and what moves the wall.
pub(super) struct LoadKeys<'r> {
    given: LoadChoice,
    key: &'r Key<Number>,
    value: f64,
    gravity: f64,
    control: Control,
}

pub(super) fn check<'r>(c: &mut Checker<'_>, load: &'r raw::Load) -> LoadKeys<'r> {
    let keys = [&load.stiffness_number, &load.pressure, &load.normal_force];
    let chosen = c.exactly_one(
        &keys,
        "the load: stiffness_number (kappa), such as stiffness_number = 1e4, or pressure (Pa), or normal_force (N; N/m in 2D)",
    );
    let values = keys.map(|key| c.number(key).unwrap_or(f64::NAN));
    let ways = [
        LoadChoice::StiffnessNumber,
        LoadChoice::Pressure,
        LoadChoice::NormalForce,
    ];
    let control = c.choice_or_default(&load.control);
    let control = Control::NAMES.iter().find(|of| Some(of.0) == control);
    let control = control.map_or(Control::Mass, |of| of.1);
    if control == Control::Mass {
        let why = "applies to load.control = \"servo\"";
        c.useless(&load.servo_gain, why);
        c.useless(&load.servo_speed_max, why);
    }
    LoadKeys {
        given: ways[chosen],
        key: keys[chosen],
        value: values[chosen],
        gravity: c.number_or_default(&load.gravity),
        control,
    }
}

/// P, N and κ from one of them.
pub(super) fn derive(
    c: &mut Checker<'_>,
    law: &Law,
    sample: &Sample,
    keys: LoadKeys<'_>,
) -> Result<Load, Failure> {
    let (base, value) = (sample.base(), keys.value);
    let load = |pressure, normal_force, stiffness_number| Load {
        pressure,
        normal_force,
        stiffness_number,
        gravity: keys.gravity,
        given: keys.given,
        control: keys.control,
    };
    let (pressure, normal_force) = match keys.given {
        LoadChoice::StiffnessNumber => {
            let p = derived::pressure(law, sample, value);
            return Ok(load(p, p * base, value));
        }
        LoadChoice::Pressure => (value, value * base),
        LoadChoice::NormalForce => (value / base, value),
    };
    if let Some(kappa) = derived::stiffness_number(law, sample, pressure) {
        return Ok(load(pressure, normal_force, kappa));
    }
    let least = derived::pressure(law, sample, STIFFNESS_NUMBER_MAX);
    let most = derived::pressure(law, sample, STIFFNESS_NUMBER_MIN);
    let (unit, factor) = match (keys.given, sample.is_planar()) {
        (LoadChoice::NormalForce, true) => ("N/m", base),
        (LoadChoice::NormalForce, false) => ("N", base),
        _ => ("Pa", 1.0),
    };
    c.refuse(
        keys.key,
        &format!(
            "gives a mean overlap outside {:.1e} … {:.3} mean diameters; it must lie in {:.3e} … {:.3e} {unit}, found {}",
            1.0 / STIFFNESS_NUMBER_MAX,
            1.0 / STIFFNESS_NUMBER_MIN,
            least * factor,
            most * factor,
            show(value),
        ),
    );
    Err(c
        .settle()
        .err()
        .unwrap_or(Failure::input("the load is out of range")))
}

/// Force that the smallest grains must bear at the largest overlap of the law, over P times the diameter
/// of the largest grains (in 3D its square). Samples of equal disks that bear less do not pack.
const BORNE: f64 = 1.4;

/// Refuses a load that presses the smallest grains of a packed sample out of the law.
pub(super) fn check_packable(
    c: &mut Checker<'_>,
    law: &Law,
    sample: &Sample,
    load: &Load,
    raw: &raw::Load,
) {
    let r = sample.radius_min;
    let overlap = law.largest_overlap(r, r);
    let force = law.normal_stiffness(r, r, overlap) * overlap;
    let largest = 2.0 * sample.radius_max;
    let section = match sample.is_planar() {
        true => largest,
        false => largest * largest,
    };
    let most = force / (BORNE * section);
    if load.pressure <= most {
        return;
    }
    let places = [
        raw.stiffness_number.place(),
        raw.pressure.place(),
        raw.normal_force.place(),
    ];
    // With few digits it is still enough.
    let most = 0.99 * most;
    let least = derived::stiffness_number(law, sample, most).unwrap_or(STIFFNESS_NUMBER_MIN);
    c.refuse_among(
        &places,
        &format!(
            "presses the smallest grains out of the contact law in a packed sample of these sizes: P = {:.3e} Pa, kappa = {:.1}; give at most {most:.2e} Pa, kappa = {least:.1}, or sizes closer together",
            load.pressure, load.stiffness_number,
        ),
    );
}

/// The numbers of a servo, for the time step (s): gain and greatest speed.
pub(super) fn derive_servo(
    c: &mut Checker<'_>,
    raw: &raw::Load,
    (law, sample): (&Law, &Sample),
    walls: &mut PlaneShear,
    step: f64,
) {
    if walls.load.control == Control::Mass {
        return;
    }
    let overlap = super::shear::greatest_overlap(law, sample, walls);
    let limit = derived::servo_gain_limit(law, sample, overlap, step);
    let mean_overlap = walls.load.mean_overlap(sample);
    let default = derived::servo_gain(law, sample, mean_overlap).min(limit);
    let gain = c.number(&raw.servo_gain).unwrap_or(default);
    if gain > limit {
        let what = format!(
            "{} m/(s Pa) is over the bound of {limit:.3e} m/(s Pa) at this time step, beyond which the wall may oscillate; give less, or leave it out for {default:.3e}",
            show(gain)
        );
        c.refuse(&raw.servo_gain, &what);
    }
    let speed_max = c.number(&raw.servo_speed_max);
    walls.load.control = Control::Servo {
        gain,
        speed_max: speed_max.unwrap_or(gain * walls.load.pressure),
    };
}
