//! How the sample is sheared and what is written of it: `[shear]` and `[output]`.

use super::{Checker, Key, NOT_NEGATIVE, POSITIVE, key};
use crate::raw::{self, Parts, show};
use crate::scene::*;

pub(super) fn check(c: &mut Checker<'_>, shear: raw::Shear) -> Shear {
    let inertial_number = key!(shear.inertial_number);
    let velocity = key!(shear.velocity);
    let strain = key!(shear.strain);
    let protocol = key!(shear.protocol);
    let stiffness = key!(shear.spring_stiffness);
    let number = key!(shear.spring_number);
    c.at_most_one(&[&stiffness, &number]);
    let spring = match (
        c.number(&stiffness, &POSITIVE),
        c.number(&number, &POSITIVE),
    ) {
        (Some(stiffness), _) => Some(Spring {
            stiffness,
            number: None,
        }),
        // The stiffness follows from the load.
        (None, Some(number)) => Some(Spring {
            stiffness: f64::NAN,
            number: Some(number),
        }),
        (None, None) => None,
    };
    if protocol.given.is_some() {
        let why = "says how the drive moves, and so does shear.protocol";
        for key in [&inertial_number, &velocity, &strain] {
            c.useless(key, why);
        }
        return Shear {
            motion: Motion::Protocol(parts(c, &protocol)),
            spring,
        };
    }
    let chosen = c.exactly_one(
        &[&inertial_number, &velocity],
        "the rate: inertial_number (I), such as inertial_number = 2e-4, or velocity (m/s), or a protocol",
    );
    let i = c.number(&inertial_number, &POSITIVE).unwrap_or(f64::NAN);
    let v = c.number(&velocity, &POSITIVE).unwrap_or(f64::NAN);
    let drive = match chosen {
        0 => Drive::InertialNumber(i),
        _ => Drive::Velocity(v),
    };
    let strain = c.required(&strain, &POSITIVE, "the total gamma, such as strain = 0.1");
    Shear {
        motion: Motion::Strain { drive, strain },
        spring,
    }
}

/// What follows from sample and load.
pub(super) fn derive(shear: &mut Shear, sample: &Sample, load: &Load) {
    if let Some(spring) = &mut shear.spring
        && let Some(number) = spring.number
    {
        spring.stiffness = number * load.normal_force / sample.mean_diameter;
    }
}

fn parts(c: &mut Checker<'_>, key: &Key<Parts>) -> Vec<Part> {
    let Some((_, Parts(given))) = &key.given else {
        return Vec::new();
    };
    if given.is_empty() {
        c.refuse(
            key,
            "has no parts; give one or more, such as [[shear.protocol]] with velocity and distance or time",
        );
    }
    let mut parts = Vec::new();
    for (n, entries) in given.iter().enumerate() {
        match part(entries) {
            Ok(part) => parts.push(part),
            Err(what) => {
                c.refuse(key, &format!("part {}: {what}", n + 1));
                return parts;
            }
        }
    }
    parts
}

fn part(entries: &[(String, f64)]) -> Result<Part, String> {
    let known = ["velocity", "distance", "time"];
    if let Some((name, _)) = entries.iter().find(|(name, _)| !known.contains(&&**name)) {
        return Err(format!(
            "unknown key {name}; a part knows {}",
            known.join(", ")
        ));
    }
    let of = |name: &str| {
        entries
            .iter()
            .find(|(known, _)| known == name)
            .map(|(_, x)| *x)
    };
    let velocity =
        of("velocity").ok_or("lacks velocity (m/s), such as velocity = 1e-3; 0 is a hold")?;
    if !(velocity >= 0.0 && velocity.is_finite()) {
        return Err(format!(
            "velocity must be 0 or greater, found {}",
            show(velocity)
        ));
    }
    let positive = |name: &str, x: f64| match x > 0.0 && x.is_finite() {
        true => Ok(x),
        false => Err(format!("{name} must be greater than 0, found {}", show(x))),
    };
    match (of("distance"), of("time")) {
        (Some(_), Some(_)) => Err("has both distance and time; give one of them".into()),
        (None, None) => {
            Err("lacks how long it lasts: distance of the drive (m) or time (s)".into())
        }
        (Some(_), None) if velocity == 0.0 => {
            Err("a hold (velocity = 0) goes no distance; give its time (s)".into())
        }
        (Some(distance), None) => Ok(Part {
            velocity,
            time: positive("distance", distance)? / velocity,
            distance: Some(distance),
        }),
        (None, Some(time)) => Ok(Part {
            velocity,
            time: positive("time", time)?,
            distance: None,
        }),
    }
}

pub(super) fn output(c: &mut Checker<'_>, output: raw::Output, shear: &Shear) -> Output {
    let frame_strain = key!(output.frame_strain);
    let frame_start = key!(output.frame_start);
    let series_strain = key!(output.series_strain);
    let checkpoint_strain = key!(output.checkpoint_strain);
    let frame_rows = key!(output.frame_rows);
    let series_rows = key!(output.series_rows);
    match shear.motion {
        Motion::Strain { .. } => {
            let why = "is counted in parts of shear.protocol, and there is none";
            c.useless(&frame_rows, why);
            c.useless(&series_rows, why);
        }
        Motion::Protocol(_) => {
            let why = "is for one speed; with shear.protocol frame_rows and series_rows say how much is written in each part";
            for key in [
                &frame_strain,
                &frame_start,
                &series_strain,
                &checkpoint_strain,
            ] {
                c.useless(key, why);
            }
        }
    }
    let progress_lines = c.whole(&key!(output.progress_lines), 0, i64::MAX);
    Output {
        frame_strain: c.number(&frame_strain, &NOT_NEGATIVE).unwrap_or(1e-4),
        frame_start: c.number(&frame_start, &NOT_NEGATIVE).unwrap_or(0.0),
        series_strain: c.number(&series_strain, &NOT_NEGATIVE).unwrap_or(1e-5),
        checkpoint_strain: c.number(&checkpoint_strain, &NOT_NEGATIVE).unwrap_or(0.02),
        keep_checkpoints: c.flag(&key!(output.keep_checkpoints)).unwrap_or(false),
        frame_rows: c
            .whole(&frame_rows, 0, i64::MAX)
            .map_or(0, i64::unsigned_abs),
        series_rows: c
            .whole(&series_rows, 0, i64::MAX)
            .map_or(1000, i64::unsigned_abs),
        progress_lines: progress_lines.map_or(20, i64::unsigned_abs),
        energy: c.flag(&key!(output.energy)).unwrap_or(true),
    }
}
