//! Relaxation and quasi-static strain of a periodic cell (BO section III), and Newton's equations
//! afterwards: `[relax]`, `[aqs]` and `[newtonian]`.

use std::ops::Bound;

use gshear_dem::contact::portable_exp;
use gshear_dem::failure::Result;
use gshear_dem::laws::keys::{
    Bounds, Change, FROM_ONE, FROM_ZERO, KeyReader, NOT_NEGATIVE, POSITIVE, UNIT,
};

use crate::checker::Checker;
use crate::grains::Sample;
use crate::sample::{self, Grains, Origin, Placement, ReadPacking, SAMPLE};
use crate::strain_protocol::{self, StrainPart, StrainPartKeys};
use crate::table::{names, table};
use crate::value::Value;

/// Names of [`Deformation`].
const DEFORMATION_NAMES: [&str; 5] = [
    "simple-shear",
    "pure-shear",
    "biaxial",
    "compression",
    "protocol",
];

/// The methods and their names.
const METHODS: [(&str, Method); 2] = [
    ("newton", Method::Newton),
    ("overdamped", Method::Overdamped),
];
const METHOD_NAMES: [&str; 2] = names(&METHODS);

table! {
    /// How mechanical equilibrium is found.
    RELAX: RelaxKeys "relax" Strained Branch {
        /// `"newton"`: Newton's method with the exact K, and overdamped dynamics if it does not
        /// converge; `"overdamped"`: overdamped dynamics only
        method: Text(&METHOD_NAMES) { default: METHOD_NAMES[0] },
        /// greatest net force on a grain at rest, and torque over its radius
        tolerance: Number(POSITIVE) {
            unit: "force",
            what: "the greatest residual of a grain at rest",
            example: "5e-14",
        },
        /// η_0 of overdamped dynamics, -η_0 m v on translations
        drag: Number(POSITIVE) { unit: "1/time", what: "eta_0 of -eta_0 m v", example: "0.022" },
        /// steps of overdamped dynamics, for one relaxation
        max_steps: Whole(FROM_ONE) { default: "10000000", change: Change::Resume },
    }
}

table! {
    /// Quasi-static strain of a periodic cell; without this table it only comes to rest.
    AQS: AqsKeys "aqs" Strained Branch {
        /// what a strain step does to the cell
        deformation: Text(&DEFORMATION_NAMES) {
            default: DEFORMATION_NAMES[0],
            change: Change::Never,
        },
        /// δγ, or δε of a biaxial cell; of a protocol that of each of its strains, at most
        strain_step: Number(UNIT) { what: "delta gamma", example: "1e-4" },
        /// number of strain steps
        steps: Whole(FROM_ZERO) {
            condition: "not with `\"compression\"` and `\"protocol\"`",
            otherwise: "number of `pressures`, or of those of the parts",
            what: "the number of strain steps",
            example: "100",
            change: Change::End,
        },
        /// pressures that the strain steps of a compression reach, one after the other, up or down
        pressures: Numbers(POSITIVE) {
            unit: "pressure",
            condition: "each, one or more, with `\"compression\"`",
            what: "the pressures that the packing is to reach",
            example: "[1e-4, 1e-3]",
        },
        /// a list of parts, each of which imposes strains and stresses along the axes
        protocol: Parts(StrainPartKeys::TABLE.own) {
            condition: "one part or more, with `\"protocol\"`",
            otherwise: "none",
            change: Change::End,
        },
        /// the cell is compressed or expanded to this pressure, with the scene's friction, before
        /// the first strain step; with `"biaxial"` the lateral stress, too
        pressure: Number(POSITIVE) {
            unit: "pressure",
            otherwise: "that of the sample; required with `\"biaxial\"`",
            what: "the lateral stress",
            example: "1e-3",
            change: Change::Never,
        },
        /// greatest relative error of these pressures
        pressure_tolerance: Number(Bounds { from: Bound::Excluded(0.0), to: Bound::Excluded(1.0) }) {
            default: "1e-4",
        },
        /// greatest relative change of a length between two relaxations while such a pressure is
        /// looked for
        pressure_step: Number(UNIT) { otherwise: "`strain_step`" },
        /// strain steps between frames; 0 is never
        frame_every: Whole(FROM_ZERO) { default: "0", change: Change::Resume },
        /// find all eigenvalues after every step, and the birth of the first complex pair; simple
        /// shear only
        spectrum: Flag { default: "false" },
        /// precision of the birth in γ, by bisection
        birth_precision: Number(POSITIVE) {
            condition: "with `spectrum`",
            default: "1e-10",
            change: Change::Resume,
        },
        /// the strain steps end when a complex pair is alone and its imaginary part is this or
        /// more; 0 is never
        until_imaginary: Number(NOT_NEGATIVE) {
            condition: "with `spectrum`",
            default: "0.0",
            change: Change::End,
        },
    }
}

table! {
    /// Newton's equations without any drag, after the strain steps.
    NEWTONIAN: NewtonianKeys "newtonian" Strained Resume {
        /// duration of the last stage, in 1/ω_i of the complex pair that grows fastest (without
        /// one, in 1000 Δt); without `[newtonian]` there is none
        growth_times: Number(POSITIVE) {
            what: "the duration, in times 1/omega_i in which the complex pair grows by e",
            example: "20",
            change: Change::End,
        },
        /// rows of its time series at equal intervals, beside a stretch of 20 periods in each 1/ω_i
        /// that resolves the oscillation, up to the fortieth; 0 is none
        rows: Whole(FROM_ZERO) { default: "20000" },
        /// frames of it; 0 is none
        frames: Whole(FROM_ZERO) { default: "200" },
        /// times at which all eigenvalues are written; 0 is none
        spectra: Whole(FROM_ZERO) { default: "0" },
    }
}

/// Relaxation and quasi-static strain of a periodic cell.
#[derive(Debug, Clone, PartialEq)]
pub struct QuasiStatic {
    /// Where the grains come from.
    pub origin: Origin,
    /// Where inserted grains begin.
    pub placement: Placement,
    /// φ: volume of the grains (area in 2D) over that of the cell. Of the cell of a shear that was
    /// before only a guess.
    pub solid_fraction: f64,
    /// What a strain step does.
    pub deformation: Deformation,
    /// The pressure of the packing before the first strain step; `None`: that of the sample.
    pub pressure: Option<f64>,
    /// Greatest relative error of a pressure.
    pub pressure_tolerance: f64,
    /// How equilibrium is found.
    pub relax: Relax,
    /// The strain steps.
    pub aqs: Aqs,
}

impl QuasiStatic {
    /// Lengths of the cell before the first strain step (m): L_x, in three dimensions L_y, else 1,
    /// and that along the last axis. Those of the cell of a shear are only expected.
    pub fn lengths(&self, sample: &Sample) -> [f64; 3] {
        let width = sample.by_dimension(1.0, sample.width);
        let height = match &self.origin {
            Origin::Insertion(_) => return sample.box_lengths(sample.length),
            Origin::Packing(file) => file.boxed.map_or(sample.length, |[height, _]| height),
            Origin::StageBefore { height } => *height,
        };
        [sample.length, width, height]
    }

    /// The least pressure to which the packing is brought, if it is brought to any.
    pub(crate) fn least_pressure(&self) -> Option<f64> {
        let steps = match &self.deformation {
            Deformation::Compression(pressures) => pressures.clone(),
            Deformation::Protocol(parts) => {
                let controls = parts.iter().flat_map(StrainPart::controls);
                controls.map(|control| control.stress).collect()
            }
            _ => Vec::new(),
        };
        let all = self.pressure.into_iter().chain(steps);
        all.reduce(f64::min)
    }
}

/// What a strain step does to the lengths of the cell and to its images.
#[derive(Debug, Clone, PartialEq)]
pub enum Deformation {
    /// Displaces the images above along x (Lees and Edwards).
    SimpleShear,
    /// Stretches the box along x and shrinks it along the last axis, at constant volume.
    PureShear,
    /// Shrinks the box along the last axis, at a constant mean stress along the others.
    Biaxial,
    /// Changes all lengths by the same factor, until the pressure is the next one of these.
    Compression(Vec<f64>),
    /// Strains the axes, or brings their stresses to values, part by part.
    Protocol(Vec<StrainPart>),
}

impl Deformation {
    /// Whether it is a list of parts.
    pub fn is_protocol(&self) -> bool {
        matches!(self, Self::Protocol(_))
    }

    /// Whether the first strain steps, so many, are the same as those of another deformation, where
    /// parts may follow.
    pub fn agrees(&self, other: &Self, steps: u64) -> bool {
        match (self, other) {
            (Self::Protocol(parts), Self::Protocol(others)) => {
                StrainPart::begun(parts, steps) == StrainPart::begun(others, steps)
            }
            _ => true,
        }
    }

    /// Whether strain steps may bring stresses of the cell to values: parts of a protocol that do
    /// may be appended.
    fn has_stresses(&self) -> bool {
        match self {
            Self::SimpleShear | Self::PureShear => false,
            Self::Biaxial | Self::Compression(_) | Self::Protocol(_) => true,
        }
    }
}

/// How mechanical equilibrium is found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relax {
    /// By which method.
    pub method: Method,
    /// Greatest |F| on a grain, and |T| over its radius.
    pub tolerance: f64,
    /// η_0, of overdamped dynamics: -η_0 m v on translations (1/time).
    pub drag: f64,
    /// Steps of overdamped dynamics after which a relaxation fails.
    pub max_steps: u64,
}

/// A method to find mechanical equilibrium.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Newton's method with the exact K, and overdamped dynamics if it does not converge.
    Newton,
    /// Overdamped dynamics only.
    Overdamped,
}

/// Athermal quasi-static deformation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aqs {
    /// δγ; δε of a biaxial box.
    pub strain_step: f64,
    /// The greatest relative change of a length between relaxations while a pressure is looked for.
    pub pressure_step: f64,
    /// Number of strain steps.
    pub steps: u64,
    /// Frames are written every so many steps; 0 is never.
    pub frame_every: u64,
    /// Whether the eigenvalues of K are found after every step, and the birth of the first complex
    /// pair.
    pub spectrum: bool,
    /// Precision of the birth in γ.
    pub birth_precision: f64,
    /// The strain steps end when a pair is alone and |Im λ| of it is at least this; 0 is never.
    pub until_imaginary: f64,
}

impl Aqs {
    /// No strain step: the sample comes to rest, and a frame shows it.
    const REST: Self = Self {
        strain_step: 0.0,
        pressure_step: 0.0,
        steps: 0,
        frame_every: 1,
        spectrum: false,
        birth_precision: 0.0,
        until_imaginary: 0.0,
    };
}

/// Newton's equations without any drag, from the last state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Newtonian {
    /// How long, in 1/ω_i of the complex pair (BO eq. 8); without a pair in 1000 Δt.
    pub growth_times: f64,
    /// Rows of the time series over that time.
    pub rows: u64,
    /// Frames over that time.
    pub frames: u64,
    /// Spectra over that time.
    pub spectra: u64,
}

/// Of whose dense matrix all eigenvalues are found after every strain step.
const MOST_UNKNOWNS: u64 = 6000;

/// What the keys of relaxation and strain steps say by themselves.
pub(crate) struct StrainKeys {
    placement: Placement,
    deformation: Deformation,
    pressure: Option<f64>,
    pressure_tolerance: f64,
    relax: Relax,
    aqs: Aqs,
}

/// Checks each key by itself.
pub(crate) fn check(c: &mut Checker<'_>) -> StrainKeys {
    let deformation = check_deformation(c);
    let pressure = check_pressure(c, &deformation);
    let has_pressure = pressure.is_some() || deformation.has_stresses();
    StrainKeys {
        placement: c
            .named(&SAMPLE.placement, &Placement::NAMES)
            .unwrap_or(Placement::Lattice),
        pressure,
        pressure_tolerance: c.number_or_default(&AQS.pressure_tolerance),
        relax: Relax {
            method: c.named(&RELAX.method, &METHODS).unwrap_or(Method::Newton),
            tolerance: c.required(&RELAX.tolerance),
            drag: c.required(&RELAX.drag),
            max_steps: c.count(&RELAX.max_steps),
        },
        aqs: check_aqs(c, &deformation, has_pressure),
        deformation,
    }
}

/// The sample of a scene whose first stage this is.
pub(crate) fn sample(
    c: &mut Checker<'_>,
    seed: u64,
    grains: Grains,
    packing: ReadPacking<'_>,
) -> Result<(Sample, Origin, f64)> {
    match grains {
        Grains::Inserted(sizes) => {
            let solid_fraction = c.known(&SAMPLE.solid_fraction);
            let sample = sample::derive_boxed(c, seed, &sizes, solid_fraction)?;
            Ok((sample, Origin::Insertion(sizes), solid_fraction))
        }
        Grains::File(arrangement) => {
            let (sample, file) = sample::derive_filed(c, arrangement, packing)?;
            let [height, _] = file.boxed.unwrap_or([sample.length, 0.0]);
            let volume = [
                sample.length,
                sample.by_dimension(1.0, sample.width),
                height,
            ];
            let volume: f64 = volume.iter().product();
            let solid_fraction = f64::from(sample.grains) * sample.mean_volume / volume;
            Ok((sample, Origin::Packing(file), solid_fraction))
        }
    }
}

/// The strain steps of this sample.
pub(crate) fn derive(
    c: &Checker<'_>,
    keys: StrainKeys,
    sample: &Sample,
    origin: Origin,
    solid_fraction: f64,
) -> Result<QuasiStatic> {
    let strain = QuasiStatic {
        origin,
        placement: keys.placement,
        solid_fraction,
        deformation: keys.deformation,
        pressure: keys.pressure,
        pressure_tolerance: keys.pressure_tolerance,
        relax: keys.relax,
        aqs: keys.aqs,
    };
    let per_grain = sample.by_dimension(3, 6);
    if strain.aqs.spectrum && u64::from(sample.grains) * per_grain > MOST_UNKNOWNS {
        return Err(c.out_of_range(&format!(
            "aqs.spectrum finds all eigenvalues at once, of up to {} grains in this dimension; leave it out, and take gshear-reduce spectrum \
             of checkpoints or frames",
            MOST_UNKNOWNS / per_grain
        )));
    }
    let least = sample.least_box_length();
    let shortest = shortest(sample, &strain);
    if shortest < least {
        return Err(c.out_of_range(&format!(
            "the box would become {shortest:.3e} long, so that grains would touch their own images; give fewer strain steps or more grains, for a length of at least {least:.3e}"
        )));
    }
    Ok(strain)
}

/// The least length of the box, as far as it follows from the number of strain steps.
fn shortest(sample: &Sample, stage: &QuasiStatic) -> f64 {
    let strain = stage.aqs.strain_step * stage.aqs.steps as f64;
    let lengths = stage.lengths(sample);
    let [length, _, height] = lengths;
    let shrinks = match &stage.deformation {
        Deformation::PureShear => 0.5 * strain,
        Deformation::Biaxial => strain,
        Deformation::SimpleShear | Deformation::Compression(_) => 0.0,
        Deformation::Protocol(parts) => return shortest_of_parts(sample, lengths, parts),
    };
    length.min(height * portable_exp(-shrinks))
}

/// The least length of a box of these lengths that has the strains of the parts.
fn shortest_of_parts(sample: &Sample, lengths: [f64; 3], parts: &[StrainPart]) -> f64 {
    let [length, width, height] = lengths;
    let lengths = sample.by_dimension(vec![length, height], vec![length, width, height]);
    let mut shortest = f64::INFINITY;
    for (axis, length) in lengths.into_iter().enumerate() {
        let mut strain = 0.0;
        for part in parts {
            let most = strain + part.most_compressed(axis);
            shortest = shortest.min(length * portable_exp(-most));
            strain += part.strain[axis] * part.share(part.steps);
        }
    }
    shortest
}

/// What a strain step does, with the pressures of a compression.
fn check_deformation(c: &mut Checker<'_>) -> Deformation {
    let deformation = match c.choice(&AQS.deformation) {
        Some("compression") => {
            Deformation::Compression(c.required_list(&AQS.pressures, "pressure"))
        }
        Some("pure-shear") => Deformation::PureShear,
        Some("biaxial") => Deformation::Biaxial,
        Some("protocol") => Deformation::Protocol(check_parts(c)),
        _ => Deformation::SimpleShear,
    };
    if !matches!(deformation, Deformation::Compression(_)) {
        let why = "applies to aqs.deformation = \"compression\"";
        c.useless(&AQS.pressures, why);
    }
    if !matches!(deformation, Deformation::Protocol(_)) {
        let why = "applies to aqs.deformation = \"protocol\"";
        c.useless(&AQS.protocol, why);
    }
    deformation
}

/// The parts of a protocol; none if they are refused.
fn check_parts(c: &mut Checker<'_>) -> Vec<StrainPart> {
    let Some(Value::Parts(given)) = c.value(&AQS.protocol).cloned() else {
        let what = "protocol: a list of parts, such as protocol = [{ shear_strain = 0.1 }]";
        c.lacks(AqsKeys::TABLE.name, what);
        return Vec::new();
    };
    // It is refused where it is read.
    let strain_step = c.given_number(&AQS.strain_step).unwrap_or(1.0);
    match strain_protocol::parts(&given, c.dimension, strain_step) {
        Ok(parts) => parts,
        Err(what) => {
            c.refuse(&AQS.protocol, &what);
            Vec::new()
        }
    }
}

/// The pressure of the packing before the first strain step.
fn check_pressure(c: &mut Checker<'_>, deformation: &Deformation) -> Option<f64> {
    match deformation {
        Deformation::Biaxial => Some(c.required(&AQS.pressure)),
        Deformation::Compression(_) => {
            let why = "is the first of aqs.pressures in a compression";
            c.useless(&AQS.pressure, why);
            None
        }
        Deformation::SimpleShear | Deformation::PureShear | Deformation::Protocol(_) => {
            if !c.is_given(&AQS.pressure) && !deformation.has_stresses() {
                let why =
                    "applies to a cell that is brought to a pressure, and there is no aqs.pressure";
                c.all_useless(&[&AQS.pressure_tolerance, &AQS.pressure_step], why);
            }
            c.number(&AQS.pressure)
        }
    }
}

/// `has_pressure`: the box is brought to some pressure.
fn check_aqs(c: &mut Checker<'_>, deformation: &Deformation, has_pressure: bool) -> Aqs {
    let keys = &AQS;
    if !AqsKeys::TABLE.own.iter().any(|key| c.is_given(key)) {
        c.omit(AqsKeys::TABLE.own);
        return Aqs::REST;
    }
    let spectrum = c.flag_or_default(&keys.spectrum);
    if !spectrum {
        let why = "applies to the eigenvalues, which need aqs.spectrum = true";
        c.all_useless(&[&keys.birth_precision, &keys.until_imaginary], why);
    }
    if spectrum && *deformation != Deformation::SimpleShear {
        c.refuse(
            &keys.spectrum,
            "applies to aqs.deformation = \"simple-shear\"; leave it out, and take gshear-reduce spectrum of checkpoints or frames",
        );
    }
    let steps = match deformation {
        Deformation::Compression(pressures) => {
            c.useless(&keys.steps, "is the number of aqs.pressures");
            pressures.len() as u64
        }
        Deformation::Protocol(parts) => {
            let why = "follows from the parts of aqs.protocol, whose strains take steps of aqs.strain_step";
            c.useless(&keys.steps, why);
            parts.iter().map(|part| part.steps).sum()
        }
        _ => c.required_count(&keys.steps),
    };
    let strain_step = c.required(&keys.strain_step);
    let pressure_step = c.number(&AQS.pressure_step).unwrap_or(strain_step);
    if has_pressure {
        c.fill(&AQS.pressure_step, pressure_step);
    }
    Aqs {
        strain_step,
        pressure_step,
        steps,
        frame_every: c.count(&keys.frame_every),
        spectrum,
        birth_precision: c.number_or_default(&keys.birth_precision),
        until_imaginary: c.number_or_default(&keys.until_imaginary),
    }
}

/// `None` if no key of the table is given.
pub(crate) fn check_newtonian(c: &mut Checker<'_>) -> Option<Newtonian> {
    let keys = &NEWTONIAN;
    if !NewtonianKeys::TABLE.own.iter().any(|key| c.is_given(key)) {
        return None;
    }
    Some(Newtonian {
        growth_times: c.required(&keys.growth_times),
        rows: c.count(&keys.rows),
        frames: c.count(&keys.frames),
        spectra: c.count(&keys.spectra),
    })
}
