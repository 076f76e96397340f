//! The checked scene: every default filled in, every contradiction refused. SI units throughout; in
//! a periodic box any consistent units, such as BO's reduced ones.

mod periodic;
mod sample;
mod walls;

pub use gshear_dem::dimension::Dimensions;
use gshear_dem::failure::Failure;
pub use gshear_dem::laws::{Contact, Law};
use gshear_dem::system::ListSettings;

pub use periodic::{
    Aqs, Deformation, DeformationName, Method, Newtonian, PeriodicBox, Placement, Relax,
};
pub use sample::{Sample, Sizes};
pub use walls::{
    Analysis, Control, Load, LoadChoice, Motion, Origin, Oscillation, Output, Pack, PackingFile,
    Part, PartDrive, PartLength, PartNormal, PlaneShear, Shear, Spring, Stress, WallSpeed, Walls,
};

/// A run, ready to be set up.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The name of the run.
    pub title: String,
    /// Who made the run, if the configuration says it.
    pub author: Option<String>,
    /// Seed of every random number.
    pub seed: u64,
    /// Disks or spheres.
    pub dimension: Dimensions,
    /// The contact law with its constants.
    pub law: Law,
    /// What contacts have whatever their law: friction and rolling resistance.
    pub contact: Contact,
    /// The grains and their cell. In a periodic box, length and width are those of the box.
    pub sample: Sample,
    /// Δt and its limit.
    pub time_step: TimeStep,
    /// What bounds the grains, and how they are sheared there.
    pub boundary: Boundary,
    /// Whether every checkpoint is kept, so that stretches can be replayed.
    pub keep_checkpoints: bool,
    /// What changes speed, not results.
    pub bookkeeping: Bookkeeping,
    /// The whole configuration as TOML with every default filled in: what `scene.toml` and the
    /// files of a run hold.
    pub toml: String,
}

impl Scene {
    /// The part of a scene between walls; messages call the scene `name`.
    ///
    /// # Errors
    /// `Failure::Input` for a scene in a periodic box.
    pub fn plane_shear(&self, name: &str) -> Result<&PlaneShear, Failure> {
        match &self.boundary {
            Boundary::Walls(walls) => Ok(walls),
            Boundary::Periodic(_) => Err(Failure::input(format!(
                "{name}: is a scene in a periodic box; this needs one of plane shear, without [box]"
            ))),
        }
    }
}

/// What bounds the grains, and how they are sheared there.
#[derive(Debug, Clone, PartialEq)]
pub enum Boundary {
    /// Walls at bottom and top.
    Walls(PlaneShear),
    /// A periodic box: with a table `[box]`.
    Periodic(PeriodicBox),
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
    /// Whether Δt may exceed its limit.
    pub force: bool,
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

/// What changes speed, not results.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bookkeeping {
    /// Skin and rebuilds of the neighbour list.
    pub list: ListSettings,
    /// Instruction set of the kernel: one of `SIMD_NAMES`.
    pub simd: &'static str,
    /// Time after which a rank that does not answer ends the run (s); 0 is never.
    pub watchdog: f64,
}

/// The instruction sets that may be asked for; `auto` is the best that the processor has.
pub const SIMD_NAMES: [&str; 4] = ["auto", "avx512", "avx2", "portable"];
