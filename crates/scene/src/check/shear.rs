//! How the sample is sheared and what is written of it: `[shear]` and `[output]`.

use crate::checker::Checker;
use crate::key::Key;
use crate::kind::Parts;
use crate::raw;
use crate::scene::{Load, Motion, Output, Part, Sample, Shear, Spring, WallSpeed};
use crate::words::show;

pub(super) fn check(c: &mut Checker<'_>, shear: &raw::Shear) -> Shear {
    let raw::Shear {
        inertial_number,
        velocity,
        strain,
        protocol,
        spring_stiffness: stiffness,
        spring_number: number,
    } = shear;
    c.at_most_one(&[stiffness, number]);
    let spring = match (c.number(stiffness), c.number(number)) {
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
    if protocol.is_given() {
        let why = "says how the drive moves, and so does shear.protocol";
        for key in [inertial_number, velocity, strain] {
            c.useless(key, why);
        }
        return Shear {
            motion: Motion::Protocol(parts(c, protocol)),
            spring,
        };
    }
    let chosen = c.exactly_one(
        &[inertial_number, velocity],
        "the rate: inertial_number (I), such as inertial_number = 2e-4, or velocity (m/s), or a protocol",
    );
    let i = c.number(inertial_number).unwrap_or(f64::NAN);
    let v = c.number(velocity).unwrap_or(f64::NAN);
    let drive = match chosen {
        0 => WallSpeed::InertialNumber(i),
        _ => WallSpeed::Velocity(v),
    };
    let strain = c.required(strain);
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
    let Some(Parts(given)) = key.value() else {
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
            Err("a hold (velocity = 0) covers no distance; give its time (s)".into())
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

pub(super) fn output(c: &mut Checker<'_>, output: &raw::Output, shear: &Shear) -> Output {
    match shear.motion {
        Motion::Strain { .. } => {
            let why = "counts per part of shear.protocol, which is not given";
            c.useless(&output.frame_rows, why);
            c.useless(&output.series_rows, why);
        }
        Motion::Protocol(_) => {
            let why = "does not apply to the parts of shear.protocol; give frame_rows and series_rows, the frames and rows of each part";
            for key in [
                &output.frame_strain,
                &output.frame_start,
                &output.series_strain,
                &output.checkpoint_strain,
            ] {
                c.useless(key, why);
            }
        }
    }
    Output {
        frame_strain: c.number_or_default(&output.frame_strain),
        frame_start: c.number_or_default(&output.frame_start),
        series_strain: c.number_or_default(&output.series_strain),
        checkpoint_strain: c.number_or_default(&output.checkpoint_strain),
        frame_rows: c.count(&output.frame_rows),
        series_rows: c.count(&output.series_rows),
        progress_lines: c.count(&output.progress_lines),
        energy: c.flag_or_default(&output.energy),
    }
}
