//! The checked scene: every default filled in, every contradiction refused. SI units throughout.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use gshear_dem::contact::portable_exp;
pub use gshear_dem::dimension::Dimensions;
pub use gshear_dem::laws::{Contact, Law};
use gshear_dem::state::Cell;
use gshear_dem::system::ListSettings;

/// A plane-shear run, ready to be set up.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The name of the run.
    pub title: String,
    /// Seed of every random number.
    pub seed: u64,
    /// Disks or spheres.
    pub dimension: Dimensions,
    /// The contact law with its constants.
    pub law: Law,
    /// What contacts have whatever their law: friction and rolling resistance.
    pub contact: Contact,
    /// The grains and their cell.
    pub sample: Sample,
    /// Where the grains come from.
    pub origin: Origin,
    /// The load on the top wall, and gravity.
    pub load: Load,
    /// Δt and its limit.
    pub time_step: TimeStep,
    /// The compression.
    pub pack: Pack,
    /// The shear.
    pub shear: Shear,
    /// What is written, and how often.
    pub output: Output,
    /// What the run computes of its frames.
    pub analysis: Analysis,
    /// What changes speed, not results.
    pub bookkeeping: Bookkeeping,
    /// The whole configuration as TOML with every default filled in: what `scene.toml` and `run.h5`
    /// hold.
    pub toml: String,
}

impl Scene {
    /// δ̄ = d̄/κ (m): overlap of two grains of the mean radius that carry P d̄, in 3D P d̄².
    pub fn mean_overlap(&self) -> f64 {
        self.sample.mean_diameter / self.load.stiffness_number
    }
}

/// Grains in a cell of `length` L_x along x and, in 3D, `width` L_y along y, both periodic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Number of grains N, those of the walls included.
    pub grains: u32,
    /// Least R (m).
    pub radius_min: f64,
    /// Greatest R (m).
    pub radius_max: f64,
    /// d̄ (m).
    pub mean_diameter: f64,
    /// π⟨R²⟩ (m²) in 2D, (4/3)π⟨R³⟩ (m³) in 3D.
    pub mean_volume: f64,
    /// L_x (m).
    pub length: f64,
    /// L_y (m); infinite in 2D.
    pub width: f64,
}

impl Sample {
    /// Disks of R uniform in [`radius_min`, `radius_max`]: d̄ = R_min + R_max.
    pub const fn uniform(grains: u32, radius_min: f64, radius_max: f64, length: f64) -> Self {
        let (a, b) = (radius_min, radius_max);
        Self {
            grains,
            radius_min,
            radius_max,
            mean_diameter: a + b,
            mean_volume: std::f64::consts::PI * (a * a + a * b + b * b) / 3.0,
            length,
            width: f64::INFINITY,
        }
    }

    /// The periodic cell.
    pub fn cell(&self) -> Cell {
        Cell::between_walls([self.length, self.width])
    }

    /// Whether the grains are disks, in a cell without a width.
    pub fn is_planar(&self) -> bool {
        self.width == f64::INFINITY
    }

    /// Length of a wall L_x (m), in 3D its area L_x L_y (m²).
    pub fn base(&self) -> f64 {
        if self.is_planar() {
            self.length
        } else {
            self.length * self.width
        }
    }

    /// d̄ (m), in 3D d̄² (m²): a mean grain carries the force F = P d̄, in 3D P d̄².
    pub fn mean_section(&self) -> f64 {
        if self.is_planar() {
            self.mean_diameter
        } else {
            self.mean_diameter * self.mean_diameter
        }
    }
}

/// How the radii of inserted grains are distributed, between the sample's least and greatest.
#[derive(Debug, Clone, PartialEq)]
pub enum Sizes {
    /// Each radius between them is as likely as the others.
    Uniform,
    /// A normal distribution, cut off at both ends.
    Normal {
        /// Its mean before it is cut off (m).
        mean: f64,
        /// Its standard deviation before it is cut off (m).
        deviation: f64,
    },
    /// The greatest or the least.
    Binary {
        /// Share of the grains that have the greatest.
        large_fraction: f64,
    },
    /// These (m), each as likely as the others.
    List(Vec<f64>),
}

impl Sizes {
    /// The names, as `sample.sizes` has them.
    pub const NAMES: [&str; 4] = ["uniform", "normal", "binary", "list"];

    /// The name in `sample.sizes`.
    pub fn name(&self) -> &'static str {
        match self {
            Sizes::Uniform => Self::NAMES[0],
            Sizes::Normal { .. } => Self::NAMES[1],
            Sizes::Binary { .. } => Self::NAMES[2],
            Sizes::List(_) => Self::NAMES[3],
        }
    }

    /// ⟨f(R)⟩, between `a` and `b` (m). Polynomials of third order are exact but for rounding where
    /// R is not normal.
    pub fn mean(&self, [a, b]: [f64; 2], f: impl Fn(f64) -> f64) -> f64 {
        match self {
            Sizes::Uniform => weighted(a, b, 2, f, |_| 1.0),
            Sizes::Normal { mean, deviation } => weighted(a, b, 2000, f, |r| {
                let z = (r - mean) / deviation;
                portable_exp(-0.5 * z * z)
            }),
            Sizes::Binary { large_fraction } => {
                large_fraction * f(b) + (1.0 - large_fraction) * f(a)
            }
            Sizes::List(radii) => radii.iter().map(|&r| f(r)).sum::<f64>() / radii.len() as f64,
        }
    }
}

/// Mean of f over [a, b] with these weights, by Simpson's rule with an even number of intervals.
fn weighted(
    a: f64,
    b: f64,
    intervals: usize,
    f: impl Fn(f64) -> f64,
    weight: impl Fn(f64) -> f64,
) -> f64 {
    let (mut sum, mut all) = (0.0, 0.0);
    for k in 0..=intervals {
        let r = a + (b - a) * k as f64 / intervals as f64;
        let share = match k {
            0 => 1.0,
            k if k == intervals => 1.0,
            k => [2.0, 4.0][k % 2],
        };
        let w = share * weight(r);
        sum += w * f(r);
        all += w;
    }
    sum / all
}

/// Where the grains come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Origin {
    /// They are inserted on a lattice.
    Insertion(Sizes),
    /// A file has them.
    Packing {
        /// What is in it.
        file: PackingFile,
        /// Which of them are walls.
        walls: Walls,
    },
}

/// What a scene needs to know of the file of a packing. A checkpoint holds it, so that going on
/// does not need the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PackingFile {
    /// The path, absolute.
    pub path: PathBuf,
    /// Copies along x and y that are set beside each other; what follows is of all of them.
    #[serde(default = "once")]
    pub replicate: [u32; 2],
    /// Number of grains.
    pub grains: u32,
    /// Least R (m).
    pub radius_min: f64,
    /// Greatest R (m).
    pub radius_max: f64,
    /// d̄ (m).
    pub mean_diameter: f64,
    /// π⟨R²⟩ (m²) in 2D, (4/3)π⟨R³⟩ (m³) in 3D.
    pub mean_volume: f64,
    /// L_x (m).
    pub length: f64,
    /// L_y (m); `None` in 2D.
    pub width: Option<f64>,
    /// Coordinates of the lowest and of the highest edge of a grain, along the last axis (m).
    pub edges: [f64; 2],
    /// Whether its types are 1, 2 and 3, all three, so that 2 and 3 can be walls.
    pub wall_types: bool,
}

/// Of files before there were copies.
fn once() -> [u32; 2] {
    [1, 1]
}

impl PackingFile {
    /// H (m) with its walls.
    pub fn height(&self) -> f64 {
        self.edges[1] - self.edges[0]
    }
}

/// Which grains of a packing are walls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Walls {
    /// Those within one mean diameter of the lowest and of the highest edge.
    Layers,
    /// Type 2 is the bottom, type 3 the top.
    Types,
}

impl Walls {
    /// The names, as `sample.walls` has them.
    pub const NAMES: [(&str, Walls); 2] = [("layers", Walls::Layers), ("types", Walls::Types)];
}

/// The load on the top wall, and gravity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// P (Pa).
    pub pressure: f64,
    /// N = P L_x (N/m), in 3D P L_x L_y (N).
    pub normal_force: f64,
    /// κ = d̄/δ̄.
    pub stiffness_number: f64,
    /// g (m/s²), towards the bottom.
    pub gravity: f64,
}

/// The time step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeStep {
    /// Δt (s).
    pub step: f64,
    /// The stability limit of Δt (s).
    pub limit: f64,
    /// Where Δt comes from.
    pub given: StepChoice,
}

/// Where Δt comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StepChoice {
    /// From the stiffness of the contacts.
    Derived,
    /// From the configuration.
    Given,
    /// A hundredth of how long two of the least grains collide at this speed (m/s).
    Collision(f64),
}

/// Compression between smooth planes under P.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pack {
    /// No compression: the grains are sheared as they come.
    pub skip: bool,
    /// μ_s while packing; 0 is a law without history.
    pub friction: f64,
    /// Kinetic energy per grain, over P d̄ δ̄, below which the sample is at rest.
    pub tolerance: f64,
    /// Steps after which packing is given up.
    pub max_steps: u64,
}

/// How fast the top wall moves along x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WallSpeed {
    /// I = γ̇ √(m̄/P); V = γ̇ H with H the height after packing.
    InertialNumber(f64),
    /// V (m/s).
    Velocity(f64),
}

/// How the drive moves.
#[derive(Debug, Clone, PartialEq)]
pub enum Motion {
    /// At one speed to this γ.
    Strain {
        /// How fast.
        drive: WallSpeed,
        /// γ at the end.
        strain: f64,
    },
    /// Through these parts, one after the other.
    Protocol(Vec<Part>),
}

/// A part of a protocol.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Velocity of the drive (m/s); 0 is a hold.
    pub velocity: f64,
    /// Duration (s).
    pub time: f64,
    /// How far the drive moves (m), if that was given instead of the duration.
    pub distance: Option<f64>,
}

/// The spring between drive and top wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spring {
    /// k (N/m; Pa in 2D).
    pub stiffness: f64,
    /// k d̄/N, if that was given.
    pub number: Option<f64>,
}

/// The shear.
#[derive(Debug, Clone, PartialEq)]
pub struct Shear {
    /// How the drive moves.
    pub motion: Motion,
    /// `None`: the top wall moves as the drive does.
    pub spring: Option<Spring>,
}

/// Intervals of output as Δγ, and as rows in each part of a protocol; 0 is never.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Output {
    /// Δγ between frames.
    pub frame_strain: f64,
    /// γ from which on frames are written.
    pub frame_start: f64,
    /// Δγ between rows of the time series.
    pub series_strain: f64,
    /// Δγ between checkpoints.
    pub checkpoint_strain: f64,
    /// Whether every checkpoint of the shear is kept, from the state before the first step on.
    pub keep_checkpoints: bool,
    /// Frames in each part of a protocol.
    pub frame_rows: u64,
    /// Rows of the time series in each part of a protocol.
    pub series_rows: u64,
    /// Lines on the terminal over the whole run.
    pub progress_lines: u64,
    /// Whether the energy budget is recorded.
    pub energy: bool,
}

impl Output {
    /// How many rows of the time series an interval has, if it has a whole number of them.
    pub fn rows_in(&self, strain: f64) -> Option<u64> {
        let rows = strain / self.series_strain;
        // Decimal fractions divide no better.
        let whole = rows.round();
        (rows.is_finite() && whole >= 1.0 && (rows - whole).abs() < 1e-9 * whole)
            .then_some(whole as u64)
    }
}

/// What the run itself computes of its frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Analysis {
    /// Whether the scalars of frames are computed (LH section 3).
    pub scalars: bool,
    /// Δγ between these frames, which need not be written.
    pub strain: f64,
    /// γ of the first of them.
    pub start: f64,
}

/// What changes speed, not results.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bookkeeping {
    /// Skin and rebuilds of the neighbour list.
    pub list: ListSettings,
    /// Instruction set of the kernel: one of `SIMD_NAMES`.
    pub simd: &'static str,
}

/// The instruction sets that may be asked for; `auto` is the best that the processor has.
pub const SIMD_NAMES: [&str; 4] = ["auto", "avx512", "avx2", "portable"];
