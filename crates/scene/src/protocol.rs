//! How the sample is sheared: `[shear]` and the parts of its protocol.

use gshear_dem::boundary::Boundary;
use gshear_dem::dimension::Dimensions;
use gshear_dem::failure::Result;
use gshear_dem::laws::Law;
use gshear_dem::laws::keys::{Change, Key, KeyReader, POSITIVE};
use gshear_dem::protocol::{Along, Course, Imposed, Normal, Part, Ramp, Vibration};
use gshear_dem::until::Until;
use gshear_dem::wave::Wave;

use crate::checker::Checker;
use crate::derived::{self, STIFFNESS_NUMBER_MAX, STIFFNESS_NUMBER_MIN};
use crate::grains::Sample;
use crate::lateral::{self, LATERAL_KEYS};
use crate::load::Load;
use crate::part_keys::{PART, PartKeys};
use crate::part_values::{PartRules, PartValues};
use crate::table::table;
use crate::value::Value;
use crate::words::show;

/// Number of checks of a part, by default.
const USUAL_CHECKS: u64 = 1000;

table! {
    /// The shear.
    SHEAR: ShearKeys "shear" Sheared Branch {
        /// inertial number I = γ̇ √(m̄/P) with m̄ per depth, in 3D γ̇ d̄ √(ρ/P)
        inertial_number: Number(POSITIVE) {},
        /// V of the top wall
        velocity: Number(POSITIVE) { unit: "m/s" },
        /// time in which the velocity rises from 0 along a straight line; without it the wall jumps
        /// to its velocity
        ramp: Number(POSITIVE) {
            unit: "s",
            condition: "with `inertial_number` or `velocity`; parts have their own",
            otherwise: "none",
        },
        /// total γ
        strain: Number(POSITIVE) { what: "the total gamma", example: "0.1", change: Change::End },
        /// instead of these three: a list of parts
        protocol: Parts(PartKeys::TABLE.own) {
            condition: "one part or more",
            otherwise: "none",
            change: Change::End,
        },
        /// k of a spring through which the top wall is pulled; without it the wall moves as the
        /// drive does
        spring_stiffness: Number(POSITIVE) { unit: "N/m, in 2D Pa", otherwise: "none" },
        /// the same as k d̄/N
        spring_number: Number(POSITIVE) {
            condition: "instead of `spring_stiffness`",
            otherwise: "none",
        },
    }
}

/// The shear.
#[derive(Debug, Clone, PartialEq)]
pub struct Shear {
    /// How the drive moves.
    pub motion: Motion,
    /// k (N/m; Pa in 2D) of the spring between drive and top wall. `None`: the top wall moves as
    /// the drive does.
    pub spring: Option<f64>,
}

/// How the drive moves.
#[derive(Debug, Clone, PartialEq)]
pub enum Motion {
    /// At one speed to this γ.
    Strain {
        /// How fast.
        drive: WallSpeed,
        /// Time (s) in which the speed rises from 0; 0 without a ramp.
        ramp: f64,
        /// γ at the end.
        strain: f64,
    },
    /// Through these parts, one after the other.
    Protocol(Vec<Part>),
}

/// How fast the top wall moves along x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WallSpeed {
    /// I (`schedule::definition_of_inertial_number`); V = γ̇ H with H the height after packing.
    InertialNumber(f64),
    /// V (m/s).
    Velocity(f64),
}

impl Shear {
    /// The pressures (Pa) that parts of the protocol impose, along any axis, by the numbers of the
    /// parts.
    pub(crate) fn pressures(&self) -> impl Iterator<Item = (usize, &Course)> {
        let parts = match &self.motion {
            Motion::Strain { .. } => &[],
            Motion::Protocol(parts) => &parts[..],
        };
        parts.iter().enumerate().flat_map(|(n, part)| {
            let along_height = match &part.imposed.normal {
                Some(Normal::Load(pressure)) => Some(pressure),
                _ => None,
            };
            let all = along_height.into_iter().chain(lateral::stresses(part));
            all.map(move |pressure| (n, pressure))
        })
    }

    /// The greatest pressure (Pa), if the load has this one.
    pub(crate) fn greatest_pressure(&self, load: f64) -> f64 {
        self.pressures().fold(load, |most, (_, pressure)| {
            most.max(pressure.from.max(pressure.to) + pressure.amplitude())
        })
    }
}

/// Checks each key by itself.
pub(crate) fn check(c: &mut Checker<'_>, boundary: &Boundary) {
    let keys = &SHEAR;
    let springs = [&keys.spring_stiffness, &keys.spring_number];
    if !boundary.has_top() {
        let why = format!(
            "moves a top wall, but sample.boundary = {:?} has none",
            boundary.key
        );
        c.all_useless(&springs, &why);
        c.useless(&keys.ramp, &why);
        if !c.is_given(&keys.protocol) {
            let what = "how long the grains flow, such as protocol = [{ time = 1.0 }] (s)";
            c.lacks("shear", what);
            return;
        }
    }
    c.at_most_one(&springs);
    for key in springs {
        c.number(key);
    }
    if c.is_given(&keys.protocol) {
        let why = "says how the drive moves, and so does shear.protocol";
        let speeds = [&keys.inertial_number, &keys.velocity, &keys.strain];
        c.all_useless(&speeds, why);
        let why = "applies to shear.inertial_number and shear.velocity; parts of shear.protocol have a ramp of their own";
        c.useless(&keys.ramp, why);
        return;
    }
    c.number(&keys.ramp);
    c.exactly_one(
        &[&keys.inertial_number, &keys.velocity],
        "the rate: inertial_number (I), such as inertial_number = 2e-4, or velocity (m/s), or a protocol",
    );
    c.number(&keys.inertial_number);
    c.number(&keys.velocity);
    c.required(&keys.strain);
}

/// The shear of this sample under this load.
pub(crate) fn derive(
    c: &mut Checker<'_>,
    law: &Law,
    sample: &Sample,
    load: &Load,
    boundary: &Boundary,
) -> Result<Shear> {
    let keys = &SHEAR;
    let number = c.number(&keys.spring_number);
    let from_number = number.map(|number| number * load.normal_force / sample.mean_diameter);
    let spring = c.number(&keys.spring_stiffness).or(from_number);
    if spring.is_some_and(|k| !k.is_normal()) {
        let key = match number {
            Some(_) => &keys.spring_number,
            None => &keys.spring_stiffness,
        };
        let what = "makes a spring stiffness outside the range of numbers; give one within it";
        return Err(c.refused(key, what));
    }
    let motion = if let Some(Value::Parts(given)) = c.value(&keys.protocol) {
        let given = if boundary.has_top() {
            Ok(given.clone())
        } else {
            without_top(given, boundary)
        };
        let begin = ProtocolBegin {
            pressure: load.pressure,
            spring: spring.is_some(),
            boundary,
            dimension: sample.dimension(),
        };
        let parts = given.and_then(|given| parts(&given, begin));
        Motion::Protocol(parts.map_err(|what| c.refused(&keys.protocol, &what))?)
    } else {
        let drive = match c.number(&keys.inertial_number) {
            Some(i) => WallSpeed::InertialNumber(i),
            None => WallSpeed::Velocity(c.known(&keys.velocity)),
        };
        Motion::Strain {
            drive,
            ramp: c.number(&keys.ramp).unwrap_or(0.0),
            strain: c.known(&keys.strain),
        }
    };
    let shear = Shear { motion, spring };
    check_pressures(&shear, law, sample, load.pressure)
        .map_err(|what| c.refused(&keys.protocol, &what))?;
    Ok(shear)
}

/// The keys of a part that need no top wall.
pub(crate) static WITHOUT_TOP: [&Key; 6] = [
    &PART.time,
    &PART.bottom_amplitude,
    &PART.bottom_frequency,
    &PART.bottom_amplitude_x,
    &PART.bottom_frequency_x,
    &PART.bottom_phase_x,
];

/// The parts of a sample with a free surface, as those of a top that rests: nothing touches it.
fn without_top(
    given: &[Vec<(String, f64)>],
    boundary: &Boundary,
) -> Result<Vec<Vec<(String, f64)>>, String> {
    let at_rest = [&PART.velocity, &PART.wall_velocity].map(|key| (key.path.to_owned(), 0.0));
    let mut parts = given.to_vec();
    for (n, part) in parts.iter_mut().enumerate() {
        let refused = part.iter().find(|(name, _)| {
            let is_known = PartKeys::TABLE.key(name).is_some();
            is_known && WITHOUT_TOP.iter().all(|key| key.path != name)
        });
        if let Some((name, _)) = refused {
            return Err(format!(
                "part {}: {name} is of a top wall, but sample.boundary = {:?} has none; leave it out",
                n + 1,
                boundary.key
            ));
        }
        part.extend(at_rest.clone());
    }
    Ok(parts)
}

/// What a protocol begins with.
#[derive(Clone, Copy)]
struct ProtocolBegin<'a> {
    /// Of the load (Pa).
    pressure: f64,
    /// Whether there is a spring.
    spring: bool,
    boundary: &'a Boundary,
    dimension: Dimensions,
}

/// The parts of a protocol.
fn parts(given: &[Vec<(String, f64)>], begin: ProtocolBegin<'_>) -> Result<Vec<Part>, String> {
    let ProtocolBegin {
        mut pressure,
        spring,
        boundary,
        dimension,
    } = begin;
    if given.is_empty() {
        return Err("has no parts; give one or more, such as [[shear.protocol]] with velocity and distance or time".into());
    }
    let mut parts: Vec<Part> = Vec::new();
    // A protocol without loads leaves the load of the packed sample as it is.
    let mut has_normal = false;
    for (n, values) in given.iter().enumerate() {
        let values = PartValues(values);
        let part = values.part(&mut pressure, parts.last());
        let part = part.and_then(|part| {
            values.check_lateral(boundary, dimension)?;
            Ok(part)
        });
        let part = part.map_err(|what| format!("part {}: {what}", n + 1))?;
        has_normal |= values.has_normal();
        parts.push(part);
    }
    let stress = parts
        .iter()
        .position(|part| matches!(part.imposed.along, Along::Force(_)));
    if let Some(n) = stress
        && spring
    {
        return Err(format!(
            "part {}: shear_stress pulls the top wall itself, but shear.spring_stiffness or \
             shear.spring_number gives a spring; leave the spring out",
            n + 1
        ));
    }
    if !has_normal {
        for part in &mut parts {
            part.imposed.normal = None;
        }
    }
    lateral::give_all(&mut parts);
    if !boundary.has_walls() {
        let mut bottoms = parts.iter().map(|part| part.imposed.bottom);
        if let Some(bottom) = bottoms.find(Vibration::is_some) {
            let key = match bottom.normal {
                Some(_) => &PART.bottom_amplitude,
                None => &PART.bottom_amplitude_x,
            };
            return Err(format!(
                "{} moves a wall, but sample.boundary = {:?}; leave it out",
                key.path, boundary.key
            ));
        }
    }
    Ok(parts)
}

/// Which keys of a part go together.
static RULES: PartRules = PartRules {
    table: PartKeys::TABLE,
    needs: &NEEDS,
    exclusive: &EXCLUSIVE,
};

/// Keys that need another one.
static NEEDS: [(&Key, &[&Key]); 19] = [
    (
        &PART.frequency,
        &[&PART.strain_amplitude, &PART.shear_stress_amplitude],
    ),
    (&PART.strain_amplitude, &[&PART.frequency]),
    (&PART.shear_stress_amplitude, &[&PART.frequency]),
    (&PART.shear_stress_amplitude, &[&PART.shear_stress]),
    (&PART.shear_stress_end, &[&PART.shear_stress]),
    (&PART.pressure_amplitude, &[&PART.pressure_frequency]),
    (&PART.pressure_frequency, &[&PART.pressure_amplitude]),
    (&PART.bottom_amplitude, &[&PART.bottom_frequency]),
    (&PART.bottom_frequency, &[&PART.bottom_amplitude]),
    (&PART.bottom_amplitude_x, &[&PART.bottom_frequency_x]),
    (&PART.bottom_frequency_x, &[&PART.bottom_amplitude_x]),
    (&PART.bottom_phase_x, &[&PART.bottom_amplitude_x]),
    (&PART.cycles, &[&PART.frequency]),
    (&PART.distance, &[&PART.velocity]),
    (&PART.ramp, &[&PART.velocity]),
    (&PART.until_checks, &CONDITIONS),
    (&PART.mean_pressure_end, &[&PART.mean_pressure]),
    (&PART.stress_xx_end, &[&PART.stress_xx]),
    (&PART.stress_yy_end, &[&PART.stress_yy]),
];

/// What ends a part before its time.
static CONDITIONS: [&Key; 6] = [
    &PART.until_stress_ratio_below,
    &PART.until_stress_ratio_above,
    &PART.until_drop,
    &PART.until_slip_rate_below,
    &PART.until_slip_rate_above,
    &PART.until_slip,
];

/// Keys of which no two may be given.
static EXCLUSIVE: [&[&Key]; 15] = [
    &[&PART.velocity, &PART.strain_amplitude, &PART.shear_stress],
    &[&PART.distance, &PART.time, &PART.cycles],
    &[&PART.wall_velocity, &PART.pressure],
    &[&PART.wall_velocity, &PART.pressure_end],
    &[&PART.wall_velocity, &PART.pressure_amplitude],
    &[&PART.stress_xx, &PART.strain_xx],
    &[&PART.stress_yy, &PART.strain_yy],
    &[&PART.mean_pressure, &PART.pressure],
    &[&PART.mean_pressure, &PART.pressure_end],
    &[&PART.mean_pressure, &PART.pressure_amplitude],
    &[&PART.mean_pressure, &PART.wall_velocity],
    &[&PART.mean_pressure, &PART.stress_xx],
    &[&PART.mean_pressure, &PART.strain_xx],
    &[&PART.mean_pressure, &PART.stress_yy],
    &[&PART.mean_pressure, &PART.strain_yy],
];

impl PartValues<'_> {
    fn wave(&self, amplitude: &Key, frequency: &Key) -> Option<Wave> {
        Some(Wave {
            amplitude: self.value(amplitude)?,
            frequency: self.value(frequency)?,
            phase: 0.0,
        })
    }

    /// How the bottom wall vibrates.
    fn bottom(&self) -> Vibration {
        let degrees = self.value(&PART.bottom_phase_x).unwrap_or(0.0);
        let along = self.wave(&PART.bottom_amplitude_x, &PART.bottom_frequency_x);
        Vibration {
            along: along.map(|wave| Wave {
                phase: degrees / 360.0,
                ..wave
            }),
            normal: self.wave(&PART.bottom_amplitude, &PART.bottom_frequency),
        }
    }

    fn has_normal(&self) -> bool {
        let keys = [
            &PART.wall_velocity,
            &PART.pressure,
            &PART.pressure_end,
            &PART.pressure_amplitude,
        ];
        keys.iter().chain(&LATERAL_KEYS).any(|key| self.has(key))
    }

    /// The part after `before`. `pressure` (Pa): at the end of the part before, then at the end of
    /// this one.
    fn part(&self, pressure: &mut f64, before: Option<&Part>) -> Result<Part, String> {
        self.check(&RULES)?;
        let along = self.along(before)?;
        let lateral = self.lateral();
        let normal = if let Some(velocity) = self.value(&PART.wall_velocity) {
            Normal::Velocity(velocity)
        } else if let Some((_, Some(mean))) = lateral {
            *pressure = mean.to;
            Normal::Load(mean)
        } else {
            let from = self.value(&PART.pressure).unwrap_or(*pressure);
            *pressure = self.value(&PART.pressure_end).unwrap_or(from);
            Normal::Load(Course {
                from,
                to: *pressure,
                wave: self.wave(&PART.pressure_amplitude, &PART.pressure_frequency),
            })
        };
        Ok(Part {
            imposed: Imposed {
                along,
                normal: Some(normal),
                bottom: self.bottom(),
                lateral: lateral.map(|(lateral, _)| lateral),
            },
            time: self.time(along)?,
            until: self.until()?,
        })
    }

    /// What ends the part before its time.
    fn until(&self) -> Result<Option<Until>, String> {
        if !CONDITIONS.iter().any(|key| self.has(key)) {
            return Ok(None);
        }
        Ok(Some(Until {
            stress_ratio_below: self.value(&PART.until_stress_ratio_below),
            stress_ratio_above: self.value(&PART.until_stress_ratio_above),
            drop: self.value(&PART.until_drop),
            slip_rate_below: self.value(&PART.until_slip_rate_below),
            slip_rate_above: self.value(&PART.until_slip_rate_above),
            slip: self.value(&PART.until_slip),
            checks: self.whole(&PART.until_checks)?.unwrap_or(USUAL_CHECKS),
        }))
    }

    /// What moves the top wall along x: a velocity (m/s), γ, or a stress (Pa).
    fn along(&self, before: Option<&Part>) -> Result<Along, String> {
        match (self.value(&PART.velocity), self.value(&PART.ramp)) {
            (Some(velocity), None) => return Ok(Along::Velocity(velocity)),
            (Some(to), Some(time)) => {
                let from = velocity_after(before)?;
                return Ok(Along::Ramp(Ramp { from, to, time }));
            }
            (None, _) => {}
        }
        if let Some(strain) = self.wave(&PART.strain_amplitude, &PART.frequency) {
            return Ok(Along::Oscillation(strain));
        }
        let from = self.value(&PART.shear_stress).ok_or(
            "lacks velocity (m/s), such as velocity = 1e-3; 0 is a hold; or \
             strain_amplitude, or shear_stress (Pa)",
        )?;
        Ok(Along::Force(Course {
            from,
            to: self.value(&PART.shear_stress_end).unwrap_or(from),
            wave: self.wave(&PART.shear_stress_amplitude, &PART.frequency),
        }))
    }

    /// The duration (s).
    fn time(&self, along: Along) -> Result<f64, String> {
        if let Some(distance) = self.value(&PART.distance) {
            return match along {
                Along::Velocity(0.0) | Along::Ramp(Ramp { to: 0.0, .. }) => {
                    Err("a hold (velocity = 0) covers no distance; give its time (s)".into())
                }
                Along::Ramp(ramp) => time_of_distance(&ramp, distance),
                Along::Velocity(velocity) => Ok(distance / velocity.abs()),
                Along::Oscillation(_) | Along::Force(_) => unreachable!("needs a velocity"),
            };
        }
        let time = self.value(&PART.time).or_else(|| self.time_of_cycles());
        let time =
            time.ok_or("lacks how long it lasts: distance of the drive (m), time (s) or cycles")?;
        match along {
            Along::Ramp(ramp) if ramp.time > time => Err(format!(
                "ramp must be at most the duration of the part, {} s, found {}",
                show(time),
                show(ramp.time)
            )),
            _ => Ok(time),
        }
    }

    /// The duration (s), where it is given in cycles.
    fn time_of_cycles(&self) -> Option<f64> {
        Some(self.value(&PART.cycles)? / self.value(&PART.frequency)?)
    }
}

/// The velocity (m/s) of the drive after a part, from which the next one is ramped.
fn velocity_after(part: Option<&Part>) -> Result<f64, String> {
    match part.map(|part| part.imposed.along) {
        None => Ok(0.0),
        Some(Along::Velocity(velocity)) => Ok(velocity),
        Some(Along::Ramp(ramp)) => Ok(ramp.to),
        Some(Along::Oscillation(_) | Along::Force(_)) => Err(
            "ramp begins with the velocity of the part before, which has none; leave it out, or put a part with velocity (0 is a hold) before"
                .into(),
        ),
    }
}

/// How long (s) a drive that is ramped takes for a distance (m) in the direction in which it ends.
fn time_of_distance(ramp: &Ramp, distance: f64) -> Result<f64, String> {
    let ramped = ramp.distance(ramp.time) * ramp.to.signum();
    if ramped > distance {
        return Err(format!(
            "distance must be at least that of the ramp, {ramped:.3e} m, found {}; give more, or a shorter ramp",
            show(distance)
        ));
    }
    Ok(ramp.time + (distance - ramped) / ramp.to.abs())
}

/// Checks the pressures of the parts beside the one (Pa) of the load, which was checked.
fn check_pressures(shear: &Shear, law: &Law, sample: &Sample, load: f64) -> Result<(), String> {
    for (n, pressure) in shear.pressures() {
        let amplitude = pressure.amplitude();
        let least = pressure.from.min(pressure.to);
        let most = pressure.from.max(pressure.to);
        if amplitude >= least {
            return Err(format!(
                "part {}: pressure_amplitude must be less than the pressure of {} Pa, found {}",
                n + 1,
                show(least),
                show(amplitude)
            ));
        }
        for pressure in [most + amplitude, least] {
            if pressure == load || derived::stiffness_number(law, sample, pressure).is_some() {
                continue;
            }
            let [least, most] = [STIFFNESS_NUMBER_MAX, STIFFNESS_NUMBER_MIN]
                .map(|kappa| derived::pressure(law, sample, kappa));
            return Err(format!(
                "part {}: a pressure of {} Pa is outside the range of the law, {least:.3e} … {most:.3e} Pa",
                n + 1,
                show(pressure),
            ));
        }
    }
    Ok(())
}
