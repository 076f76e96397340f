//! The checked scene: every default filled in, every contradiction refused. SI units throughout.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::contact::{hooke, lee_hurley, portable_ln};

/// A plane-shear run, ready to be set up.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    pub title: String,
    pub seed: u64,
    pub law: Law,
    pub contact: Contact,
    pub sample: Sample,
    pub origin: Origin,
    pub load: Load,
    pub time_step: TimeStep,
    pub pack: Pack,
    pub shear: Shear,
    pub output: Output,
    pub bookkeeping: Bookkeeping,
    /// The whole configuration as TOML with every default filled in: what `scene.toml` and `run.h5` hold.
    pub toml: String,
}

impl Scene {
    /// δ̄ = d̄/κ (m): overlap of two grains of the mean radius that carry P d̄.
    pub fn mean_overlap(&self) -> f64 {
        self.sample.mean_diameter / self.load.stiffness_number
    }
}

/// The contact law, with the constants of its springs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Law {
    /// LH appendix A.
    LeeHurley(Material),
    /// Linear springs.
    Hooke(Springs),
}

impl Law {
    /// The names of all laws, as `contact.law` has them.
    pub const NAMES: [&str; 2] = ["lee-hurley", "hooke"];

    pub fn name(&self) -> &'static str {
        match self {
            Law::LeeHurley(_) => Self::NAMES[0],
            Law::Hooke(_) => Self::NAMES[1],
        }
    }

    /// ρ (kg/m³) of the grains.
    pub fn density(&self) -> f64 {
        match self {
            Law::LeeHurley(material) => material.density,
            Law::Hooke(springs) => springs.density,
        }
    }

    /// k_n = F_n^e/δ (Pa) of two disks of radii r1, r2 (m) at the overlap δ (m).
    pub fn normal_stiffness(&self, r1: f64, r2: f64, overlap: f64) -> f64 {
        match self {
            Law::LeeHurley(material) => {
                lee_hurley::normal_stiffness(material.effective_modulus(), r1, r2, overlap)
            }
            Law::Hooke(springs) => springs.normal_stiffness,
        }
    }

    /// m = ρπR² (kg/m) of a disk of radius R (m).
    pub fn disk_mass(&self, radius: f64) -> f64 {
        std::f64::consts::PI * self.density() * radius * radius
    }

    /// The largest overlap (m) that the law takes, of two disks of radii r1, r2 (m).
    pub fn largest_overlap(&self, r1: f64, r2: f64) -> f64 {
        let smaller = r1.min(r2);
        match self {
            Law::LeeHurley(_) => {
                // x = a²/(16 R1 R2), and δ = 4(R1+R2) x (ln(1/x) - 1).
                let a = lee_hurley::LARGEST_CONTACT * smaller;
                let x = a * a / (16.0 * r1 * r2);
                4.0 * (r1 + r2) * x * (-portable_ln(x) - 1.0)
            }
            Law::Hooke(_) => 2.0 * hooke::LARGEST_OVERLAP * smaller,
        }
    }
}

/// Linear springs between grains: k_n, k_t (N/m per unit depth: Pa); ρ (kg/m³) of the grains.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Springs {
    pub normal_stiffness: f64,
    pub tangential_stiffness: f64,
    pub density: f64,
}

/// Of the grains: E (Pa), ν, ρ (kg/m³).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    pub young_modulus: f64,
    pub poisson_ratio: f64,
    pub density: f64,
}

impl Material {
    /// E* (Pa) of two grains: 1/E* = 2 (1-ν²)/E.
    pub fn effective_modulus(&self) -> f64 {
        self.young_modulus / (2.0 * (1.0 - self.poisson_ratio * self.poisson_ratio))
    }
}

/// What every law has: μ_s, μ_r, α (normal and tangential damping ratio), η_r.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    pub friction: f64,
    pub rolling_friction: f64,
    pub damping_ratio: f64,
    pub rolling_damping_ratio: f64,
}

/// Disks in a cell of `length` L_x along x (periodic).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    pub grains: u32,
    /// Least and greatest R (m).
    pub radius_min: f64,
    pub radius_max: f64,
    /// d̄ (m).
    pub mean_diameter: f64,
    /// ⟨R²⟩ (m²).
    pub mean_square_radius: f64,
    pub length: f64,
}

impl Sample {
    /// R uniform in [`radius_min`, `radius_max`]: d̄ = R_min + R_max.
    pub const fn uniform(grains: u32, radius_min: f64, radius_max: f64, length: f64) -> Self {
        let (a, b) = (radius_min, radius_max);
        Self {
            grains,
            radius_min,
            radius_max,
            mean_diameter: a + b,
            mean_square_radius: (a * a + a * b + b * b) / 3.0,
            length,
        }
    }
}

/// Where the grains come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Origin {
    /// Inserted, with R uniform.
    Insertion,
    /// A file.
    Packing { file: PackingFile, walls: Walls },
}

/// What a scene needs to know of the file of a packing. A checkpoint holds it, so that going on does not need the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PackingFile {
    /// Absolute.
    pub path: PathBuf,
    pub grains: u32,
    /// As in [`Sample`].
    pub radius_min: f64,
    pub radius_max: f64,
    pub mean_diameter: f64,
    pub mean_square_radius: f64,
    pub length: f64,
    /// y (m) of the lowest and of the highest edge of a grain.
    pub edges: [f64; 2],
    /// Whether its types are 1, 2 and 3, all three, so that 2 and 3 can be walls.
    pub wall_types: bool,
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

/// P (Pa), N = P L_x (N/m), κ = k_n(mean overlap)/P.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    pub pressure: f64,
    pub normal_force: f64,
    pub stiffness_number: f64,
}

/// Δt (s) and its limit of stability (s). `given`: by the user, not derived.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeStep {
    pub step: f64,
    pub limit: f64,
    pub given: bool,
}

/// Compression between smooth planes under P.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pack {
    /// None: the grains are sheared as they come.
    pub skip: bool,
    /// μ_s while packing; 0 is a law without history.
    pub friction: f64,
    /// Kinetic energy per grain, over P d̄ δ̄, below which the sample is at rest.
    pub tolerance: f64,
    pub max_steps: u64,
}

/// How fast the top wall moves along x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Drive {
    /// I = γ̇ √(m̄/P); V = γ̇ H with H the height after packing.
    InertialNumber(f64),
    /// V (m/s).
    Velocity(f64),
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shear {
    pub drive: Drive,
    /// Total γ.
    pub strain: f64,
}

/// Intervals of output as Δγ; 0 is never.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Output {
    pub frame_strain: f64,
    /// γ from which on frames are written.
    pub frame_start: f64,
    pub series_strain: f64,
    pub checkpoint_strain: f64,
    /// Lines on the terminal over the whole run.
    pub progress_lines: u64,
    /// Whether a ledger of energy is kept.
    pub energy: bool,
}

/// What must not reach the numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bookkeeping {
    /// Skin of the neighbour list over d̄; `None` adapts it to how often the list is rebuilt.
    pub skin: Option<f64>,
    /// Rebuild at least every so many steps; 0 only when needed.
    pub rebuild_every: u64,
    /// Instruction set of the kernel: one of `SIMD_NAMES`.
    pub simd: &'static str,
}

/// The instruction sets that may be asked for; `auto` is the best that the processor has.
pub const SIMD_NAMES: [&str; 4] = ["auto", "avx512", "avx2", "portable"];
