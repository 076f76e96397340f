//! A scene without walls: grains in a periodic box that is sheared quasi-statically (BO section
//! III).

use super::scene::{Bookkeeping, Sample, Sizes, TimeStep};
use gshear_dem::dimension::Dimensions;
use gshear_dem::laws::{Contact, Law};
use gshear_dem::state::{Cell, Sheared};

/// Grains in a periodic sheared box, ready to be set up. Units are the user's own: SI, or BO's
/// reduced ones.
#[derive(Debug, Clone, PartialEq)]
pub struct PeriodicScene {
    /// The name of the run.
    pub title: String,
    /// Seed of every random number.
    pub seed: u64,
    /// Disks or spheres.
    pub dimension: Dimensions,
    /// The contact law with its constants.
    pub law: Law,
    /// What contacts have whatever their law.
    pub contact: Contact,
    /// The grains and their cell. Its length, and in 3D its width, is that of the box.
    pub sample: Sample,
    /// How their radii are distributed.
    pub sizes: Sizes,
    /// φ: volume of the grains (area in 2D) over that of the box.
    pub solid_fraction: f64,
    /// Δt and its limit.
    pub time_step: TimeStep,
    /// How equilibrium is found.
    pub relax: Relax,
    /// The strain steps.
    pub aqs: Aqs,
    /// `None`: the run ends with the last strain step.
    pub newtonian: Option<Newtonian>,
    /// Whether every checkpoint is kept, so that stretches can be replayed.
    pub keep_checkpoints: bool,
    /// What changes speed, not results.
    pub bookkeeping: Bookkeeping,
    /// The whole configuration as TOML with every default filled in.
    pub toml: String,
}

impl PeriodicScene {
    /// A box of this length along every axis, its images straight above each other.
    pub fn cell(&self, length: f64) -> Cell {
        let width = match self.dimension {
            Dimensions::Two => f64::INFINITY,
            Dimensions::Three => length,
        };
        Cell {
            periods: [length, width],
            sheared: Some(Sheared {
                height: length,
                offset: 0.0,
                velocity: 0.0,
            }),
        }
    }

    /// The box at its solid fraction, its images above displaced by `offset` along x.
    pub fn sheared_cell(&self, offset: f64) -> Cell {
        let mut cell = self.cell(self.sample.length);
        cell.shear(offset);
        cell
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

impl Method {
    /// The names, as `relax.method` has them.
    pub const NAMES: [(&str, Method); 2] = [
        ("newton", Method::Newton),
        ("overdamped", Method::Overdamped),
    ];
}

/// Athermal quasi-static shear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aqs {
    /// δγ.
    pub strain_step: f64,
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
