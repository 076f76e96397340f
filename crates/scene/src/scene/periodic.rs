//! Grains in a periodic box that is sheared quasi-statically (BO section III).

use super::sample::Sizes;

/// Quasi-static shear of a periodic box, and Newton's equations afterwards.
#[derive(Debug, Clone, PartialEq)]
pub struct PeriodicBox {
    /// How the radii are distributed.
    pub sizes: Sizes,
    /// φ: volume of the grains (area in 2D) over that of the box.
    pub solid_fraction: f64,
    /// How equilibrium is found.
    pub relax: Relax,
    /// The strain steps.
    pub aqs: Aqs,
    /// `None`: the run ends with the last strain step.
    pub newtonian: Option<Newtonian>,
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
