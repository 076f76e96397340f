//! How the sample is sheared and what is written of it: `[shear]` and `[output]`.

use crate::checker::Checker;
use crate::derived::{self, STIFFNESS_NUMBER_MAX, STIFFNESS_NUMBER_MIN};
use crate::key::Key;
use crate::keys::{list, meant};
use crate::kind::Parts;
use crate::raw;
use crate::raw::part::PART_KEYS;
use crate::scene::{
    Law, Load, Motion, Oscillation, Output, Part, PartDrive, PartLength, PartNormal, PlaneShear,
    Sample, Shear, Spring, Stress, WallSpeed,
};
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
        let parts = parts(c, protocol);
        let is_stress = |part: &Part| matches!(part.drive, PartDrive::Stress(_));
        if let (Some(n), Some(_)) = (parts.iter().position(is_stress), spring) {
            let what = format!(
                "part {}: shear_stress pulls the top wall itself, but shear.spring_stiffness or \
                 shear.spring_number gives a spring; leave the spring out",
                n + 1
            );
            c.refuse(protocol, &what);
        }
        return Shear {
            motion: Motion::Protocol(parts),
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
    let known = |name: &str| PART_KEYS.iter().find(|key| key.name == name);
    for (name, x) in entries {
        let Some(key) = known(name) else {
            let names = PART_KEYS.map(|key| key.name);
            let unknown = format!("unknown key {name}{}", meant(name, &names));
            return Err(list(unknown, "a part knows", names.iter()));
        };
        if !x.is_finite() || !key.range.hold(*x) {
            let words = match key.range.hold(*x) {
                true => "must be a finite number".into(),
                false => key.range.words(),
            };
            return Err(format!("{name} {words}, found {}", show(*x)));
        }
    }
    let of = |name: &str| {
        let mut entries = entries.iter();
        entries.find(|(known, _)| known == name).map(|(_, x)| *x)
    };
    // A key that needs another one.
    let needs = [
        (
            "frequency",
            &["strain_amplitude", "shear_stress_amplitude"][..],
        ),
        ("strain_amplitude", &["frequency"]),
        ("shear_stress_amplitude", &["frequency"]),
        ("shear_stress_amplitude", &["shear_stress"]),
        ("shear_stress_end", &["shear_stress"]),
        ("pressure_amplitude", &["pressure_frequency"]),
        ("pressure_frequency", &["pressure_amplitude"]),
        ("bottom_amplitude", &["bottom_frequency"]),
        ("bottom_frequency", &["bottom_amplitude"]),
        ("cycles", &["frequency"]),
        ("distance", &["velocity"]),
    ];
    for (name, others) in needs {
        if of(name).is_some() && others.iter().all(|other| of(other).is_none()) {
            return Err(format!(
                "{name} needs {}; give it as well",
                others.join(" or ")
            ));
        }
    }
    // Keys of which no two may be given.
    let exclusive = [
        &["velocity", "strain_amplitude", "shear_stress"][..],
        &["distance", "time"],
        &["distance", "cycles"],
        &["time", "cycles"],
        &["wall_velocity", "pressure"],
        &["wall_velocity", "pressure_end"],
        &["wall_velocity", "pressure_amplitude"],
    ];
    for names in exclusive {
        let given: Vec<&str> = names
            .iter()
            .copied()
            .filter(|name| of(name).is_some())
            .collect();
        if let [one, other, ..] = given[..] {
            let both = match of("cycles").is_some() || of("distance").is_none() {
                true => format!("has both {one} and {other}; give one of them"),
                false => "has both distance and time; give one of them".into(),
            };
            return Err(both);
        }
    }
    let wave = |amplitude: &str, frequency: &str| {
        Some(Oscillation {
            amplitude: of(amplitude)?,
            frequency: of(frequency)?,
        })
    };
    let drive = match (
        of("velocity"),
        wave("strain_amplitude", "frequency"),
        of("shear_stress"),
    ) {
        (Some(velocity), ..) => PartDrive::Velocity(velocity),
        (_, Some(of), _) => PartDrive::Strain(of),
        (_, _, Some(start)) => PartDrive::Stress(Stress {
            start: Some(start),
            end: of("shear_stress_end"),
            wave: wave("shear_stress_amplitude", "frequency"),
        }),
        _ => {
            return Err(
                "lacks velocity (m/s), such as velocity = 1e-3; 0 is a hold; or \
                        strain_amplitude, or shear_stress (Pa)"
                    .into(),
            );
        }
    };
    let (time, length) = match (of("distance"), of("time"), of("cycles"), drive) {
        (Some(_), _, _, PartDrive::Velocity(0.0)) => {
            return Err("a hold (velocity = 0) covers no distance; give its time (s)".into());
        }
        (Some(distance), _, _, PartDrive::Velocity(velocity)) => {
            (distance / velocity, PartLength::Distance(distance))
        }
        (_, Some(time), ..) => (time, PartLength::Time),
        (_, _, Some(cycles), _) => {
            let frequency = of("frequency").unwrap_or(f64::NAN);
            (cycles / frequency, PartLength::Cycles(cycles))
        }
        _ => {
            return Err(
                "lacks how long it lasts: distance of the drive (m), time (s) or cycles".into(),
            );
        }
    };
    let normal = match of("wall_velocity") {
        Some(velocity) => PartNormal::Velocity(velocity),
        None => PartNormal::Pressure(Stress {
            start: of("pressure"),
            end: of("pressure_end"),
            wave: wave("pressure_amplitude", "pressure_frequency"),
        }),
    };
    Ok(Part {
        drive,
        time,
        length,
        normal,
        bottom: wave("bottom_amplitude", "bottom_frequency"),
    })
}

/// Checks the pressures of the parts, which follow from the load.
pub(super) fn check_pressures(
    c: &mut Checker<'_>,
    key: &Key<Parts>,
    shear: &Shear,
    (law, sample, load): (&Law, &Sample, &Load),
) {
    for (n, values) in shear.pressures(load.pressure).into_iter().enumerate() {
        let Some([start, end, amplitude]) = values else {
            continue;
        };
        let (least, most) = (start.min(end), start.max(end));
        if amplitude >= least {
            let what = format!(
                "part {}: pressure_amplitude must be less than the pressure of {} Pa, found {}",
                n + 1,
                show(least),
                show(amplitude)
            );
            c.refuse(key, &what);
            return;
        }
        // The load itself was checked.
        let extremes = [most + amplitude, least]
            .into_iter()
            .filter(|p| *p != load.pressure);
        for pressure in extremes {
            if derived::stiffness_number(law, sample, pressure).is_none() {
                let range = [STIFFNESS_NUMBER_MAX, STIFFNESS_NUMBER_MIN]
                    .map(|kappa| derived::pressure(law, sample, kappa));
                let what = format!(
                    "part {}: a pressure of {} Pa is outside the range of the law, {:.3e} … {:.3e} Pa",
                    n + 1,
                    show(pressure),
                    range[0],
                    range[1]
                );
                c.refuse(key, &what);
                return;
            }
        }
    }
}

/// δ̄ (m) at the greatest pressure.
pub(super) fn greatest_overlap(law: &Law, sample: &Sample, walls: &PlaneShear) -> f64 {
    let pressures = walls
        .shear
        .pressures(walls.load.pressure)
        .into_iter()
        .flatten();
    let most = pressures.fold(walls.load.pressure, |most, [start, end, amplitude]| {
        most.max(start.max(end) + amplitude)
    });
    match derived::stiffness_number(law, sample, most) {
        Some(kappa) if most > walls.load.pressure => sample.mean_diameter / kappa,
        _ => walls.load.mean_overlap(sample),
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
