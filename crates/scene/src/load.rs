//! The load on the top wall: `[load]`.

use std::ops::Bound;

use gshear_dem::boundary::Boundary;
use gshear_dem::failure::Result;
use gshear_dem::laws::Law;
use gshear_dem::laws::keys::{Bounds, Change, Key, KeyReader, NOT_NEGATIVE, POSITIVE};
use gshear_dem::state::Masses;
use gshear_dem::wave::sine_and_cosine;

use crate::checker::Checker;
use crate::derived::{self, STIFFNESS_NUMBER_MAX, STIFFNESS_NUMBER_MIN};
use crate::grains::Sample;
use crate::table::{from_to, table};
use crate::words::show;

/// Names of [`Control`].
const CONTROL_NAMES: [&str; 3] = ["mass", "servo", "volume"];

table! {
    /// The load on the top wall.
    LOAD: LoadKeys "load" Sheared Branch {
        /// κ = d̄/δ̄, mean diameter over mean overlap; in 2D that is k_n/P
        stiffness_number: Number(from_to(STIFFNESS_NUMBER_MIN, STIFFNESS_NUMBER_MAX)) {},
        /// pressure P
        pressure: Number(POSITIVE) { unit: "Pa", condition: "κ in its range" },
        /// N = P L_x, in 3D P L_x L_y, on the top wall
        normal_force: Number(POSITIVE) { unit: "N, in 2D N/m", condition: "κ in its range" },
        /// gravity g on the free grains; τ, P and κ are those at the top wall, if there is one
        gravity: Number(NOT_NEGATIVE) {
            unit: "m/s²",
            what: "gravity",
            example: "9.81",
            default: "0.0",
        },
        /// angle θ in degrees by which x points downwards: g sin θ pulls along x, g cos θ to the
        /// bottom; while the sample is packed only that
        incline: Number(from_to(0.0, 90.0)) {
            condition: "with `gravity`; less than 90 below a free surface",
            default: "0.0",
        },
        /// what moves the top wall along its normal: `"mass"`, the load on the mass of its grains;
        /// `"servo"`, in every step a velocity from the error of the pressure; `"volume"`, nothing:
        /// the packed sample is sheared at constant volume
        control: Text(&CONTROL_NAMES) { default: CONTROL_NAMES[0] },
        /// mass of the top wall, on which load, spring and shear stress act
        wall_mass: Number(POSITIVE) {
            unit: "kg, in 2D kg/m",
            condition: "enough for the time step",
            otherwise: "that of its grains",
        },
        /// φ to which the packed sample is brought before the shear, by stretching its cell: less
        /// than it was packed to
        solid_fraction: Number(Bounds { from: Bound::Excluded(0.1), to: Bound::Excluded(1.0) }) {
            condition: "with `\"volume\"` and `sample.boundary = \"periodic\"`",
            otherwise: "that of the packed sample",
            change: Change::Never,
        },
        /// of a servo: velocity over error of the pressure
        servo_gain: Number(POSITIVE) {
            unit: "m/(s Pa)",
            condition: "at most its bound, with `\"servo\"`",
            otherwise: "d̄/√(m̄ k̄), in 3D d̄²/√(m̄ k̄), or its bound",
        },
        /// of a servo: greatest speed
        servo_speed_max: Number(POSITIVE) {
            unit: "m/s",
            condition: "with `\"servo\"`",
            otherwise: "none",
        },
    }
}

/// The ways to give the load.
pub(crate) static WAYS: [&Key; 3] = [&LOAD.stiffness_number, &LOAD.pressure, &LOAD.normal_force];

/// The load on the top wall, and gravity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// P (Pa).
    pub pressure: f64,
    /// N = P L_x (N/m), in 3D P L_x L_y (N).
    pub normal_force: f64,
    /// κ = d̄/δ̄.
    pub stiffness_number: f64,
    /// g (m/s²).
    pub gravity: f64,
    /// θ (degrees): x points downwards by it.
    pub incline: f64,
    /// What moves the top wall along its normal.
    pub control: Control,
    /// Mass of the top wall (kg; kg/m in 2D). `None`: that of its grains.
    pub wall_mass: Option<f64>,
    /// φ to which the packed sample is brought before the shear.
    pub solid_fraction: Option<f64>,
}

/// What moves the top wall along its normal under a load.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Control {
    /// The mass of its grains.
    Mass,
    /// Nothing: the volume is constant.
    Volume,
    /// In every step a velocity from the error of the pressure.
    Servo {
        /// Velocity over error of the pressure (m/(s Pa)).
        gain: f64,
        /// Greatest speed (m/s); infinite if there is none.
        speed_max: f64,
    },
}

impl Load {
    /// δ̄ = d̄/κ (m): overlap of two grains of the mean radius that carry P d̄, in 3D P d̄².
    pub fn mean_overlap(&self, sample: &Sample) -> f64 {
        sample.mean_diameter / self.stiffness_number
    }

    /// Gravity (m/s²) along x, and towards the bottom.
    pub fn gravity_components(&self) -> [f64; 2] {
        sine_and_cosine(self.incline / 360.0).map(|part| part * self.gravity)
    }
}

/// Checks each key by itself.
pub(crate) fn check(c: &mut Checker<'_>, boundary: &Boundary) {
    let key = boundary.key;
    let is_free = !boundary.has_top();
    if is_free {
        let why = format!("loads a top wall, but sample.boundary = {key:?} has none");
        c.all_useless(&WAYS, &why);
        c.all_useless(&[&LOAD.control, &LOAD.wall_mass], &why);
        c.required(&LOAD.gravity);
    } else {
        c.exactly_one(
            &WAYS,
            "the load: stiffness_number (kappa), such as stiffness_number = 1e4, or pressure (Pa), or normal_force (N; N/m in 2D)",
        );
    }
    for key in WAYS {
        c.number(key);
    }
    c.number(&LOAD.wall_mass);
    let gravity = c.number_or_default(&LOAD.gravity);
    let incline = c.number_or_default(&LOAD.incline);
    if is_free && gravity <= 0.0 && c.is_given(&LOAD.gravity) {
        let what = format!("must be positive where sample.boundary = {key:?}");
        c.refuse(&LOAD.gravity, &what);
    }
    if is_free && incline >= 90.0 {
        let what = format!("must be less than 90 degrees where sample.boundary = {key:?}");
        c.refuse(&LOAD.incline, &what);
    }
    if incline > 0.0 && gravity <= 0.0 {
        let what = "inclines gravity; give load.gravity, or leave it out";
        c.refuse(&LOAD.incline, what);
    }
    if c.choice(&LOAD.control) != Some("volume") {
        let why = "applies to load.control = \"volume\"";
        c.useless(&LOAD.solid_fraction, why);
    }
    if c.choice(&LOAD.control) != Some("servo") {
        let why = "applies to load.control = \"servo\"";
        c.all_useless(&[&LOAD.servo_gain, &LOAD.servo_speed_max], why);
    }
}

/// P, N and κ from one of them, or from the weight of a sample with a free surface; the numbers of
/// a servo come later ([`TopWall::control`]).
pub(crate) fn derive(
    c: &mut Checker<'_>,
    law: &Law,
    masses: &Masses,
    sample: &Sample,
) -> Result<Load> {
    let base = sample.base();
    let gravity = c.number_or_default(&LOAD.gravity);
    let incline = c.number_or_default(&LOAD.incline);
    let mass = f64::from(sample.grains) * masses.of(0, sample.mean_volume);
    let control = match c.choice(&LOAD.control) {
        Some("volume") => Control::Volume,
        _ => Control::Mass,
    };
    let solid_fraction = c.number(&LOAD.solid_fraction);
    let [kappa, pressure, normal_force] = WAYS.map(|key| c.number(key));
    let (key, pressure, normal_force) = match (kappa, pressure, normal_force) {
        (Some(kappa), ..) => {
            let p = derived::pressure(law, sample, kappa);
            (&LOAD.stiffness_number, p, p * base)
        }
        (_, Some(p), _) => (&LOAD.pressure, p, p * base),
        (_, _, Some(force)) => (&LOAD.normal_force, force / base, force),
        // Of a free surface.
        (None, None, None) => (&LOAD.gravity, mass * gravity / base, mass * gravity),
    };
    let kappa = kappa.or_else(|| derived::stiffness_number(law, sample, pressure));
    if let Some(stiffness_number) = kappa {
        return Ok(Load {
            pressure,
            normal_force,
            stiffness_number,
            gravity,
            incline,
            control,
            wall_mass: c.number(&LOAD.wall_mass),
            solid_fraction,
        });
    }
    let range = [STIFFNESS_NUMBER_MAX, STIFFNESS_NUMBER_MIN];
    let [least, most] = range.map(|kappa| derived::pressure(law, sample, kappa));
    // What the key must be multiplied by for a pressure, and its value.
    let (unit, factor, given) = match key.path {
        path if path == LOAD.normal_force.path => {
            (sample.by_dimension("N/m", "N"), base, normal_force)
        }
        path if path == LOAD.gravity.path => ("m/s²", gravity / pressure, gravity),
        _ => ("Pa", 1.0, pressure),
    };
    let what = format!(
        "gives a mean overlap outside {:.1e} … {:.3} mean diameters; it must lie in {:.3e} … {:.3e} {unit}, found {}",
        1.0 / STIFFNESS_NUMBER_MAX,
        1.0 / STIFFNESS_NUMBER_MIN,
        least * factor,
        most * factor,
        show(given),
    );
    Err(c.refused(key, &what))
}

/// Force that the smallest grains must bear at the largest overlap of the law, over P times the
/// diameter of the largest grains (in 3D its square). Samples of equal disks that bear less do not
/// pack.
const BORNE: f64 = 1.4;

/// Refuses a load that presses the smallest grains of a packed sample out of the law.
pub(crate) fn check_packable(c: &mut Checker<'_>, law: &Law, sample: &Sample, load: &Load) {
    let r = sample.radius_min;
    let overlap = law.largest_overlap(r, r);
    let force = law.normal_stiffness(r, r, overlap) * overlap;
    let largest = 2.0 * sample.radius_max;
    let section = sample.by_dimension(1.0, largest) * largest;
    let most = force / (BORNE * section);
    if load.pressure <= most {
        return;
    }
    // With few digits it is still enough.
    let most = 0.99 * most;
    let least = derived::stiffness_number(law, sample, most).unwrap_or(STIFFNESS_NUMBER_MIN);
    let by_weight = WAYS.iter().all(|key| c.value(key).is_none());
    let most = if by_weight {
        // P is that of the weight.
        format!("{:.2e} m/s^2", load.gravity * most / load.pressure)
    } else {
        format!("{most:.2e} Pa")
    };
    let what = format!(
        "presses the smallest grains out of the contact law in a packed sample of these sizes: P = {:.3e} Pa, kappa = {:.1}; give at most {most}, kappa = {least:.1}, or sizes closer together",
        load.pressure, load.stiffness_number,
    );
    c.refuse_among(&[&WAYS[..], &[&LOAD.gravity]].concat(), &what);
}

/// A top wall under a load, with all that limits how it may move along its normal.
pub(crate) struct TopWall<'a> {
    pub(crate) law: &'a Law,
    pub(crate) sample: &'a Sample,
    pub(crate) load: &'a Load,
    /// Layers of grains that give way to it together.
    pub(crate) layers: f64,
    /// The greatest mean overlap (m).
    pub(crate) greatest_overlap: f64,
    /// Δt (s).
    pub(crate) step: f64,
}

impl TopWall<'_> {
    /// What moves it: the numbers of a servo, if there is one.
    pub(crate) fn control(&self, c: &mut Checker<'_>) -> Control {
        if c.choice(&LOAD.control) != Some("servo") {
            return self.load.control;
        }
        let (law, sample) = (self.law, self.sample);
        let limit = derived::servo_gain_limit(law, sample, self.greatest_overlap, self.step);
        let limit = self.layers * limit;
        let overlap = self.load.mean_overlap(sample);
        let default = self.layers * derived::servo_gain(law, sample, overlap);
        let default = default.min(limit);
        let gain = c.number(&LOAD.servo_gain).unwrap_or(default);
        if gain > limit {
            let what = format!(
                "{} m/(s Pa) is over the bound of {limit:.3e} m/(s Pa) at this time step, beyond which the wall may oscillate; give less, or leave it out for {default:.3e}",
                show(gain)
            );
            c.refuse(&LOAD.servo_gain, &what);
        }
        c.fill(&LOAD.servo_gain, gain);
        Control::Servo {
            gain,
            speed_max: c.number(&LOAD.servo_speed_max).unwrap_or(f64::INFINITY),
        }
    }

    /// Refuses a mass that is too small for Δt.
    pub(crate) fn check_mass(&self, c: &mut Checker<'_>) {
        let Some(mass) = self.load.wall_mass else {
            return;
        };
        let (overlap, step) = (self.greatest_overlap, self.step);
        let least = derived::least_wall_mass(self.law, self.sample, overlap, step) / self.layers;
        if mass < least {
            let what = format!(
                "{} {unit} is too light for a time step of {step:.3e} s; give at least {:.3e} {unit}, or leave it out for the mass of the wall's grains",
                show(mass),
                1.001 * least,
                unit = self.sample.by_dimension("kg/m", "kg"),
            );
            c.refuse(&LOAD.wall_mass, &what);
        }
    }
}
