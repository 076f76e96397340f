//! What a scene may have, but seldom has on purpose: a unit mistaken, a number of another quantity.

use toml::{Table, Value};

use gshear_dem::state::GrainState;

use crate::load::Control;
use crate::packing::force_on_top;
use crate::protocol::{Motion, WallSpeed};
use crate::quasi_static::Newtonian;
use crate::scene::Scene;
use crate::schedule::{STEPS_WITHOUT_A_PAIR, Schedule, mean_mass};
use crate::walls::PlaneShear;
use crate::words::show;
use gshear_dem::protocol::Normal;

/// Ranges in which a value of a key raises no doubt.
struct Likely {
    key: &'static str,
    range: [f64; 2],
    unit: &'static str,
    doubt: &'static str,
}

impl Likely {
    /// What to say of the value of the key, if it is out of the range. `scene`: with every default.
    fn doubt_in(&self, scene: &Table) -> Option<String> {
        let (table, name) = self.key.split_once('.')?;
        let value = number(scene.get(table)?.get(name)?)?;
        let [least, most] = self.range;
        if (least..=most).contains(&value) {
            return None;
        }
        let what = statement(self.key, value, self.unit);
        Some(format!("{what} {}", self.doubt))
    }
}

/// Of scenes in SI units.
const MATERIAL: [Likely; 2] = [
    Likely {
        key: "material.young_modulus",
        range: [1e4, 2e12],
        unit: "Pa",
        doubt: "rubber has about 1e6, glass 7e10; \"70 GPa\" is a way to write it",
    },
    Likely {
        key: "material.density",
        range: [100.0, 25_000.0],
        unit: "kg/m³",
        doubt: "glass has 2500; \"2.5 g/cm^3\" is a way to write it",
    },
];
/// Least number of time steps in which a wall swings once on the spring that pulls it.
const RESOLVED: f64 = 20.0;
/// Of every scene.
const CONTACT: [Likely; 6] = [
    Likely {
        key: "contact.friction",
        // Bonfanti et al. take 10, to keep contacts from sliding.
        range: [0.0, 10.0],
        unit: "",
        doubt: "it is a coefficient, the tangent of an angle: of most materials 0.1 to 1",
    },
    Likely {
        key: "contact.rolling_friction",
        range: [0.0, 1.0],
        unit: "",
        doubt: "it is a coefficient: of most materials below 0.5",
    },
    Likely {
        key: "contact.twisting_friction",
        range: [0.0, 1.0],
        unit: "",
        doubt: "it is a coefficient: of most materials below 0.5",
    },
    Likely {
        key: "contact.surface_energy",
        range: [0.0, 1.0],
        unit: "J/m²",
        doubt: "of most powders 0.001 to 0.1",
    },
    Likely {
        key: "contact.damping_ratio",
        range: [0.0, 1.0],
        unit: "",
        doubt: "above 1 contacts are overdamped and stick",
    },
    Likely {
        key: "pack.tolerance",
        range: [1e-14, 1e-2],
        unit: "",
        doubt: "1e-6 to 1e-4 of P d δ is at rest",
    },
];

/// Least stiffness number κ at which the laws of small overlaps hold, and greatest I of a
/// quasi-static or dense flow. Least number of layers and columns of grains.
const RIGID: f64 = 100.0;
const DENSE_FLOW: f64 = 0.1;
const LAYERS: f64 = 6.0;
/// Mean diameters (m), from dust to pebbles.
const SIZES: std::ops::RangeInclusive<f64> = 1e-8..=0.2;
/// Least velocity, over that of the shear, with which a servo answers twice its load.
const PROMPT: f64 = 0.1;
/// Greatest weight of the sample over its load.
const WEIGHT: f64 = 1.0;

/// Returns a sentence for each value of the scene that is allowed and unlikely. `height` (m): of
/// the sheared layer, as far as that is known.
pub fn unlikely(scene: &Scene, height: f64) -> Vec<String> {
    let mut doubts = Vec::new();
    // Every value with its default.
    let table: Table = scene.toml.parse().unwrap_or_default();
    if scene.shear().is_some() {
        doubts.extend(MATERIAL.iter().filter_map(|likely| likely.doubt_in(&table)));
    }
    doubts.extend(CONTACT.iter().filter_map(|likely| likely.doubt_in(&table)));
    if let Some(walls) = scene.shear() {
        add_doubts_of_walls(scene, walls, height, &mut doubts);
    }
    doubts.extend(intervals_without_a_pair(scene));
    doubts
}

/// The pressure of a packing over that of its load, or the inverse, up to which it is at its load.
const AT_LOAD: f64 = 2.0;

/// A sentence if the grains of a packing that is sheared as it is press on the top wall with
/// another force than it is loaded with at the start. `grains`: all of them.
pub fn not_at_load(scene: &Scene, grains: &[GrainState]) -> Option<String> {
    let walls = scene.shear()?;
    if !walls.pack.skip || walls.boundary.walls() < 2 {
        return None;
    }
    let first = match &walls.shear.motion {
        Motion::Strain { .. } if walls.load.control == Control::Volume => return None,
        Motion::Strain { .. } => None,
        Motion::Protocol(parts) => parts[0].imposed.normal,
    };
    let load = match first {
        None => walls.load.pressure,
        Some(Normal::Load(pressure)) => pressure.from,
        Some(Normal::Velocity(_)) => return None,
    };
    let own = force_on_top(scene, grains) / scene.sample.base();
    let motion = match own / load {
        ratio if ratio > AT_LOAD => "flies upwards",
        ratio if ratio < 1.0 / AT_LOAD => "falls onto it",
        _ => return None,
    };
    let or_pressure = if own > 0.0 {
        format!(", or load.pressure = {own:.3e}")
    } else {
        String::new()
    };
    Some(format!(
        "sample.packing is not at its load: its overlaps press on the top wall with {own:.3e} Pa, and the load is {load:.3e} Pa; the wall {motion}; give pack.skip = false to compress it under the load{or_pressure}"
    ))
}

/// A sentence if a step shears by more than intervals of output ask for, or a part of a protocol
/// has fewer steps than are to be written of it: then every step is written.
pub fn intervals(walls: &PlaneShear, schedule: &Schedule) -> Option<String> {
    let output = &walls.output;
    let Motion::Strain { .. } = walls.shear.motion else {
        let counts = [
            ("output.series_rows", output.series_rows),
            ("output.frame_rows", output.frame_rows),
        ];
        let segments = schedule.protocol.segments().iter().enumerate();
        let mut short = segments.filter_map(|(n, segment)| {
            let part = format!("part {} of shear.protocol", n + 1);
            more_than_steps(&part, segment.steps, &counts)
        });
        return short.next();
    };
    let (all, per_step) = (schedule.intervals[0], schedule.strain(1));
    let checkpoint = output.checkpoint_strain;
    let given = [
        ("output.series_strain", output.series_strain, all.series),
        ("output.frame_strain", output.frame_strain, all.frames),
        ("output.checkpoint_strain", checkpoint, all.checkpoints),
        ("analysis.strain", walls.analysis.strain, all.analysis),
    ];
    let inflated = given.iter().filter(|(_, asked, interval)| {
        !interval.is_never() && interval.steps() as f64 * per_step > 1.5 * asked
    });
    let keys: Vec<String> = inflated
        .map(|(key, asked, _)| format!("{key} = {}", show(*asked)))
        .collect();
    (!keys.is_empty()).then(|| {
        format!(
            "a step of {:.3e} s shears by {per_step:.3e}, more than {} asks for, which comes in every step; give {per_step:.1e} or more, or a slower shear",
            schedule.step,
            crate::words::list(&keys, "and"),
        )
    })
}

/// [`intervals`] of Newton's equations without a complex pair, which strain steps may find.
fn intervals_without_a_pair(scene: &Scene) -> Option<String> {
    if scene.stages.strain.as_ref()?.aqs.spectrum {
        return None;
    }
    let newtonian = scene.stages.newtonian?;
    let steps = (newtonian.growth_times * STEPS_WITHOUT_A_PAIR).ceil() as u64;
    intervals_of_newtonian(&newtonian, steps)
}

/// A sentence if Newton's equations take fewer steps than are to be written.
pub fn intervals_of_newtonian(newtonian: &Newtonian, steps: u64) -> Option<String> {
    let counts = [
        ("newtonian.rows", newtonian.rows),
        ("newtonian.frames", newtonian.frames),
        ("newtonian.spectra", newtonian.spectra),
    ];
    more_than_steps("the stage of Newton's equations", steps, &counts)
}

fn more_than_steps(what: &str, steps: u64, counts: &[(&str, u64)]) -> Option<String> {
    let (key, count) = counts.iter().find(|(_, count)| *count > steps)?;
    Some(format!(
        "{what} has {steps} steps, fewer than {key} = {count}: every step is written; give at most {steps}, or a longer duration"
    ))
}

/// A number, or the first one of a list.
fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Float(x) => Some(*x),
        Value::Integer(n) => Some(*n as f64),
        Value::Array(list) => list.first()?.as_float(),
        _ => None,
    }
}

fn statement(key: &str, value: f64, unit: &str) -> String {
    let value = if (1e-3..1e5).contains(&value.abs()) || value == 0.0 {
        format!("{value}")
    } else {
        format!("{value:.3e}")
    };
    let space = if unit.is_empty() { "" } else { " " };
    format!("{key} is {value}{space}{unit}:")
}

/// `height` (m): of the sheared layer.
fn add_doubts_of_walls(scene: &Scene, walls: &PlaneShear, height: f64, doubts: &mut Vec<String>) {
    let (load, sample) = (&walls.load, &scene.sample);
    let diameter = sample.mean_diameter;
    let greatest = walls.shear.greatest_pressure(load.pressure);
    // κ falls as the pressure rises, at least as fast as by its power 2/3.
    let kappa = load.stiffness_number * (load.pressure / greatest).powf(2.0 / 3.0);
    if kappa < RIGID {
        doubts.push(format!(
            "the pressure of {greatest:.3e} Pa presses grains together by about {:.2} % of their diameter (stiffness number {kappa:.0}): the laws are those of small overlaps, and rigid grains have 1000 or more; give a smaller pressure or stiffer grains",
            100.0 / kappa
        ));
    }
    let schedule = Schedule::new(scene, walls, height);
    let given = match &walls.shear.motion {
        Motion::Strain { drive, .. } => match drive {
            WallSpeed::InertialNumber(i) => *i,
            WallSpeed::Velocity(v) => schedule.inertial_number(*v),
        },
        Motion::Protocol(parts) => {
            let speeds = parts.iter().map(|part| part.speed(height));
            schedule.inertial_number(speeds.fold(0.0, |most, v| most.max(v.abs())))
        }
    };
    if given > DENSE_FLOW {
        doubts.push(format!(
            "the inertial number is {given:.3}: from about {DENSE_FLOW} on grains collide more than they touch; quasi-static shear has 1e-3 or less"
        ));
    }
    doubts.extend(intervals(walls, &schedule));
    if let Control::Servo { gain, .. } = load.control {
        let share = gain * load.pressure / (given / schedule.inertial_number(1.0));
        if share < PROMPT {
            doubts.push(format!(
                "load.servo_gain is {gain:.3e} m/(s Pa): twice the load moves the wall with {:.1} % of the shear velocity only, so a sample that dilates is far above its load; give more, for which contact dampers or time.step may have to be less, or load.control = \"mass\"",
                100.0 * share
            ));
        }
    }
    if let Some(spring) = walls.shear.spring {
        // About the mass of the top wall.
        let mass = mean_mass(scene) * sample.base() / sample.mean_section();
        let unit = sample.by_dimension("kg/m", "kg");
        let step = scene.time_step.step;
        let steps = std::f64::consts::TAU * (mass / spring).sqrt() / step;
        if steps < RESOLVED {
            doubts.push(format!(
                "on the spring of k = {spring:.3e} a top wall of about {mass:.1e} {unit} swings once in {steps:.1} time steps: below {RESOLVED} the spring is not resolved, and at 3 it is unstable; give a smaller shear.spring_number or spring_stiffness, or time.step = {:.1e}",
                step * steps / RESOLVED
            ));
        }
    }
    if !SIZES.contains(&diameter) {
        doubts.push(format!(
            "the mean diameter is {diameter:.3e} m: sand has 1e-4 to 2e-3, gouge 1e-6 to 1e-4; \"0.8 mm\" is a way to write a radius"
        ));
    }
    for (layers, what, key) in [
        (height / diameter, "layers high", "sample.grains"),
        (sample.length / diameter, "grains long", "sample.length"),
    ] {
        if layers < LAYERS {
            doubts.push(format!(
                "the sample is about {layers:.1} {what}: walls and periodic images decide what it does; raise {key}"
            ));
        }
    }
    let mass = mean_mass(scene) * f64::from(sample.grains);
    let weight = load.gravity * mass / load.normal_force;
    if walls.boundary.has_top() && weight > WEIGHT {
        doubts.push(format!(
            "the sample weighs {weight:.2} times its load (load.gravity): the pressure at the bottom is more than twice that at the top"
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{cases, embedded};

    fn doubts(sets: &str) -> Vec<String> {
        let scene = embedded(sets).expect("a legal scene");
        let height = 40.0 / 1.5 * scene.sample.mean_diameter;
        unlikely(&scene, height)
    }

    #[test]
    fn each_unlikely_value_is_doubted_once() {
        assert_eq!(doubts(""), [""; 0]);
        for [sets, word] in cases(
            r"
            material.young_modulus=1.0 | material.young_modulus is 1 Pa
            material.density=2.5 | material.density is 2.5 kg/m³
            contact.friction=30 | contact.friction is 30:
            shear.inertial_number=0.5 output.series_strain=1e-3 output.frame_strain=1e-3 | inertial number is 0.500:
            shear.inertial_number=0.05 | more than output.series_strain = 1e-5 asks for
            load.stiffness_number=50 | presses grains together by about 2.00 %
            sample.length=8e-6 | 5.3 grains long
            load.gravity=1e9 | times its load
            load.control=servo load.servo_gain=1e-12 | of the shear velocity only
            sample.radius_min=0.3 sample.radius_max=0.5 sample.length=30 | the mean diameter is 8.000e-1 m
            ",
        ) {
            let found = doubts(&sets);
            assert_eq!(found.len(), 1, "{sets}: {found:?}");
            assert!(found[0].contains(&word), "{found:?}");
        }
    }
}
