//! The load: `[load]`.

use crate::checker::Checker;
use crate::derived::{self, STIFFNESS_NUMBER_MAX, STIFFNESS_NUMBER_MIN};
use crate::key::Key;
use crate::kind::Number;
use crate::raw;
use crate::scene::{Law, Load, LoadChoice, Sample};
use crate::words::show;
use gshear_dem::failure::Failure;

/// One of the ways to say it, its key and value, and g (m/s²).
pub(super) struct LoadKeys<'r> {
    given: LoadChoice,
    key: &'r Key<Number>,
    value: f64,
    gravity: f64,
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
    LoadKeys {
        given: ways[chosen],
        key: keys[chosen],
        value: values[chosen],
        gravity: c.number_or_default(&load.gravity),
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
