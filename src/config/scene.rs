//! The checked scene: every default filled in, every contradiction refused. SI units throughout.

/// A plane-shear run, ready to be set up.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    pub title: String,
    pub seed: u64,
    pub material: Material,
    pub contact: Contact,
    pub sample: Sample,
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
        self.sample.mean_diameter() / self.load.stiffness_number
    }
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

/// LH appendix A: μ_s, μ_r, α (normal and tangential damping ratio), η_r.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    pub friction: f64,
    pub rolling_friction: f64,
    pub damping_ratio: f64,
    pub rolling_damping_ratio: f64,
}

/// Disks with R uniform in [radius_min, radius_max] in a cell of `length` L_x along x (periodic).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    pub grains: u32,
    pub radius_min: f64,
    pub radius_max: f64,
    pub length: f64,
}

impl Sample {
    /// d̄ = R_min + R_max.
    pub fn mean_diameter(&self) -> f64 {
        self.radius_min + self.radius_max
    }

    /// Mean of R² of the uniform distribution.
    pub fn mean_square_radius(&self) -> f64 {
        let (a, b) = (self.radius_min, self.radius_max);
        (a * a + a * b + b * b) / 3.0
    }
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

/// Insertion and compression between smooth planes under P.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pack {
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
