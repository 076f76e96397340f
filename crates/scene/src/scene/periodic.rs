//! Grains in a periodic box that is deformed quasi-statically (BO section III).

use super::sample::Sizes;

/// Quasi-static deformation of a periodic box, and Newton's equations afterwards.
#[derive(Debug, Clone, PartialEq)]
pub struct PeriodicBox {
    /// How the radii are distributed.
    pub sizes: Sizes,
    /// Where they begin.
    pub placement: Placement,
    /// φ: volume of the grains (area in 2D) over that of the box.
    pub solid_fraction: f64,
    /// What a strain step does.
    pub deformation: Deformation,
    /// The pressure of the packing before the first strain step; `None`: that of the solid
    /// fraction.
    pub pressure: Option<f64>,
    /// Greatest relative error of a pressure.
    pub pressure_tolerance: f64,
    /// How equilibrium is found.
    pub relax: Relax,
    /// The strain steps.
    pub aqs: Aqs,
    /// `None`: the run ends with the last strain step.
    pub newtonian: Option<Newtonian>,
}

impl PeriodicBox {
    /// Whether the packing is brought to a pressure.
    pub fn has_pressures(&self) -> bool {
        self.least_pressure().is_some()
    }

    /// The least pressure to which the packing is brought, if it is brought to any.
    pub fn least_pressure(&self) -> Option<f64> {
        let steps = match &self.deformation {
            Deformation::Compression(pressures) => &pressures[..],
            _ => &[],
        };
        let all = self.pressure.iter().chain(steps).copied();
        all.reduce(f64::min)
    }
}

/// Where the grains of a box begin, before it is brought to rest without friction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Placement {
    /// On a loose lattice, jittered, in a larger box that is compressed step by step.
    Lattice,
    /// Anywhere in the box itself, each place as likely as the others.
    Random,
}

impl Placement {
    /// The names, as `sample.placement` has them.
    pub const NAMES: [(&str, Placement); 2] = [
        ("lattice", Placement::Lattice),
        ("random", Placement::Random),
    ];

    /// The name in `sample.placement`.
    pub fn name(self) -> &'static str {
        let known = Self::NAMES.iter().find(|(_, known)| *known == self);
        known.map_or("", |(name, _)| name)
    }
}

/// What a strain step does to the lengths of the box and to its images.
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
}

impl Deformation {
    /// The names, as `box.deformation` has them; the pressures of a compression are given
    /// elsewhere.
    pub const NAMES: [(&str, DeformationName); 4] = [
        ("simple-shear", DeformationName::SimpleShear),
        ("pure-shear", DeformationName::PureShear),
        ("biaxial", DeformationName::Biaxial),
        ("compression", DeformationName::Compression),
    ];

    /// The name in `box.deformation`.
    pub fn name(&self) -> &'static str {
        let of = match self {
            Self::SimpleShear => DeformationName::SimpleShear,
            Self::PureShear => DeformationName::PureShear,
            Self::Biaxial => DeformationName::Biaxial,
            Self::Compression(_) => DeformationName::Compression,
        };
        let name = Self::NAMES.iter().find(|(_, known)| *known == of);
        name.map_or("", |(name, _)| name)
    }
}

/// A kind of deformation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeformationName {
    /// [`Deformation::SimpleShear`].
    SimpleShear,
    /// [`Deformation::PureShear`].
    PureShear,
    /// [`Deformation::Biaxial`].
    Biaxial,
    /// [`Deformation::Compression`].
    Compression,
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

/// Athermal quasi-static deformation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aqs {
    /// δγ; δε of a biaxial box; the greatest relative change of a length between relaxations.
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
