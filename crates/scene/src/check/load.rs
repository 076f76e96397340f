//! The load: `[load]`.

use super::Checker;
use crate::derived::{self, STIFFNESS_NUMBER_MAX, STIFFNESS_NUMBER_MIN};
use crate::key::Key;
use crate::raw::{self, Number, show};
use crate::scene::*;
use crate::write::LoadChoice;
use gshear_dem::failure::Failure;

/// One of the ways to say it, its key, and g (m/s²).
pub(super) struct LoadKeys {
    choice: LoadChoice,
    key: Key<Number>,
    gravity: f64,
}

pub(super) fn check(c: &mut Checker<'_>, load: raw::Load) -> LoadKeys {
    let raw::Load {
        stiffness_number,
        pressure,
        normal_force,
        gravity,
    } = load;
    let chosen = c.exactly_one(
        &[&stiffness_number, &pressure, &normal_force],
        "the load: stiffness_number (kappa), such as stiffness_number = 1e4, or pressure (Pa), or normal_force (N; N/m in 2D)",
    );
    let kappa = c.number(&stiffness_number).unwrap_or(f64::NAN);
    let p = c.number(&pressure).unwrap_or(f64::NAN);
    let n = c.number(&normal_force).unwrap_or(f64::NAN);
    let gravity = c.number_or_default(&gravity);
    let (choice, key) = match chosen {
        0 => (LoadChoice::StiffnessNumber(kappa), stiffness_number),
        1 => (LoadChoice::Pressure(p), pressure),
        _ => (LoadChoice::NormalForce(n), normal_force),
    };
    LoadKeys {
        choice,
        key,
        gravity,
    }
}

/// P, N and κ from one of them.
pub(super) fn derive(
    c: &mut Checker<'_>,
    law: &Law,
    sample: &Sample,
    keys: LoadKeys,
) -> Result<(Load, LoadChoice), Failure> {
    let LoadKeys {
        choice,
        key,
        gravity,
    } = keys;
    let base = sample.base();
    let load = |pressure, normal_force, stiffness_number| Load {
        pressure,
        normal_force,
        stiffness_number,
        gravity,
    };
    let (pressure, normal_force) = match choice {
        LoadChoice::StiffnessNumber(kappa) => {
            let p = derived::pressure(law, sample, kappa);
            return Ok((load(p, p * base, kappa), choice));
        }
        LoadChoice::Pressure(p) => (p, p * base),
        LoadChoice::NormalForce(n) => (n / base, n),
    };
    if let Some(kappa) = derived::stiffness_number(law, sample, pressure) {
        return Ok((load(pressure, normal_force, kappa), choice));
    }
    let least = derived::pressure(law, sample, STIFFNESS_NUMBER_MAX);
    let most = derived::pressure(law, sample, STIFFNESS_NUMBER_MIN);
    let (unit, factor) = match (choice, sample.is_planar()) {
        (LoadChoice::NormalForce(_), true) => ("N/m", base),
        (LoadChoice::NormalForce(_), false) => ("N", base),
        _ => ("Pa", 1.0),
    };
    c.refuse(
        &key,
        &format!(
            "gives a mean overlap outside {:.1e} … {:.3} mean diameters; it must lie in {:.3e} … {:.3e} {unit}, found {}",
            1.0 / STIFFNESS_NUMBER_MAX,
            1.0 / STIFFNESS_NUMBER_MIN,
            least * factor,
            most * factor,
            key.given
                .as_ref()
                .map_or(String::new(), |(_, Number(x))| show(*x)),
        ),
    );
    Err(c
        .settle()
        .err()
        .unwrap_or(Failure::input("the load is out of range")))
}
