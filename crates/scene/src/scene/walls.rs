//! A sample between walls: compressed under a load, then sheared.

use std::path::PathBuf;

use gshear_dem::drive::Servo;
use serde::{Deserialize, Serialize};

use super::sample::{Sample, Sizes};

/// Plane shear between walls.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneShear {
    /// Where the grains come from.
    pub origin: Origin,
    /// Thickness of each wall over d̄.
    pub wall_layers: f64,
    /// The load on the top wall, and gravity.
    pub load: Load,
    /// The compression.
    pub pack: Pack,
    /// The shear.
    pub shear: Shear,
    /// What is written, and how often.
    pub output: Output,
    /// What the run computes of its frames.
    pub analysis: Analysis,
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

impl Origin {
    /// The file of the packing, if the grains come from one.
    pub fn file(&self) -> Option<&PackingFile> {
        match self {
            Origin::Insertion(_) => None,
            Origin::Packing { file, .. } => Some(file),
        }
    }
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
    /// Greatest coordinate of a grain or of its box in the file, in magnitude (m); 0 in checkpoints of
    /// versions without it.
    #[serde(default)]
    pub farthest: f64,
    /// Whether its types are 1, 2 and 3, all three, so that 2 and 3 can be walls.
    pub wall_types: bool,
    /// Hash of the file's bytes; empty in checkpoints of versions without it.
    #[serde(default)]
    pub content: String,
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
    /// Those whose centre is within the thickness of a wall of the lowest and of the highest edge.
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
    /// How the load was given.
    pub given: LoadChoice,
    /// What moves the top wall along its normal.
    pub control: Control,
}

/// What moves the top wall along its normal under a load.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Control {
    /// The mass of its grains.
    Mass,
    /// In every step a velocity from the error of the pressure.
    Servo {
        /// Velocity over error of the pressure (m/(s Pa)).
        gain: f64,
        /// Greatest speed (m/s).
        speed_max: f64,
    },
}

impl Control {
    const UNKNOWN_SERVO: Control = Control::Servo {
        gain: f64::NAN,
        speed_max: f64::NAN,
    };

    /// The names, as `load.control` has them; a servo by its name has no numbers yet.
    pub const NAMES: [(&str, Control); 2] =
        [("mass", Control::Mass), ("servo", Control::UNKNOWN_SERVO)];
}

impl PlaneShear {
    /// Thickness of each wall of this sample (m).
    pub fn wall_thickness(&self, sample: &Sample) -> f64 {
        self.wall_layers * sample.mean_diameter
    }

    /// The servo that moves the top wall of this sample, if one does.
    pub fn servo(&self, sample: &Sample) -> Option<Servo> {
        match self.load.control {
            Control::Mass => None,
            Control::Servo { gain, speed_max } => Some(Servo {
                gain: gain / sample.base(),
                fastest: speed_max,
            }),
        }
    }
}

impl Load {
    /// δ̄ = d̄/κ (m): overlap of two grains of the mean radius that carry P d̄, in 3D P d̄².
    pub fn mean_overlap(&self, sample: &Sample) -> f64 {
        sample.mean_diameter / self.stiffness_number
    }
}

/// How the load was given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LoadChoice {
    /// κ.
    StiffnessNumber,
    /// P.
    Pressure,
    /// N.
    NormalForce,
}

/// Compression between smooth planes under P.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pack {
    /// No compression: the grains are sheared as they come.
    pub skip: bool,
    /// μ_s while packing; 0 is a law without history.
    pub friction: f64,
    /// Drag once the bottom carries the load, over the inverse `schedule::packing_time`.
    pub drag: f64,
    /// Kinetic energy per grain, over P d̄ δ̄, below which the sample is at rest.
    pub tolerance: f64,
    /// Steps after which packing is given up.
    pub max_steps: u64,
}

/// How fast the top wall moves along x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WallSpeed {
    /// I (`schedule::inertial_time`); V = γ̇ H with H the height after packing.
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
    /// What moves the top wall along x.
    pub drive: PartDrive,
    /// Duration (s).
    pub time: f64,
    /// How the duration was given.
    pub length: PartLength,
    /// What is imposed along the normal of the top wall.
    pub normal: PartNormal,
    /// Vibration of the bottom wall along its normal (m).
    pub bottom: Option<Oscillation>,
}

/// What moves the top wall along x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PartDrive {
    /// Velocity of the drive (m/s); 0 is a hold.
    Velocity(f64),
    /// Cyclic strain: the drive oscillates about its position, with this amplitude of γ.
    Strain(Oscillation),
    /// The top wall is free along x under a shear stress (Pa).
    Stress(Stress),
}

/// How the duration of a part was given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PartLength {
    /// As a time.
    Time,
    /// How far the drive moves (m).
    Distance(f64),
    /// Number of cycles of the drive.
    Cycles(f64),
}

/// What is imposed along the normal of the top wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PartNormal {
    /// A pressure (Pa).
    Pressure(Stress),
    /// The velocity of the top wall away from the bottom wall (m/s); 0 is a constant volume.
    Velocity(f64),
}

/// A stress during a part: linear from one value to another, and a sinusoid (Pa).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Stress {
    /// At the start. `None`: where the part before ended.
    pub start: Option<f64>,
    /// At the end. `None`: as at the start.
    pub end: Option<f64>,
    /// Added to it.
    pub wave: Option<Oscillation>,
}

impl Stress {
    /// Values at start and end; `before`: at the end of the part before.
    pub fn values(&self, before: f64) -> [f64; 2] {
        let start = self.start.unwrap_or(before);
        [start, self.end.unwrap_or(start)]
    }

    /// The amplitude of the sinusoid.
    pub fn amplitude(&self) -> f64 {
        self.wave.map_or(0.0, |wave| wave.amplitude)
    }
}

/// A sinusoid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Oscillation {
    /// In the unit of what oscillates.
    pub amplitude: f64,
    /// Cycles per second (Hz).
    pub frequency: f64,
}

impl Part {
    /// Whether it imposes something along the normal of the top wall.
    pub fn has_normal(&self) -> bool {
        self.normal != PartNormal::Pressure(Stress::default())
    }

    /// The sinusoids in it.
    pub fn oscillations(&self) -> impl Iterator<Item = Oscillation> {
        let along = match self.drive {
            PartDrive::Velocity(_) => None,
            PartDrive::Strain(wave) => Some(wave),
            PartDrive::Stress(stress) => stress.wave,
        };
        let normal = match self.normal {
            PartNormal::Pressure(pressure) => pressure.wave,
            PartNormal::Velocity(_) => None,
        };
        [along, normal, self.bottom].into_iter().flatten()
    }
}

impl Shear {
    /// The pressure (Pa) of every part at start and end, and its amplitude; `None` with a velocity.
    /// `pressure`: that of `[load]`. Empty without a protocol.
    pub fn pressures(&self, pressure: f64) -> Vec<Option<[f64; 3]>> {
        let Motion::Protocol(parts) = &self.motion else {
            return Vec::new();
        };
        let mut before = pressure;
        let of_part = |part: &Part| match &part.normal {
            PartNormal::Pressure(pressure) => {
                let [start, end] = pressure.values(before);
                before = end;
                Some([start, end, pressure.amplitude()])
            }
            PartNormal::Velocity(_) => None,
        };
        parts.iter().map(of_part).collect()
    }
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
