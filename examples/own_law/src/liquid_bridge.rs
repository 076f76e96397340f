//! An adhesion of its own: liquid bridges between spheres, which form when these touch and break at
//! a distance.
//!
//! A bridge of the volume V, the surface tension γ and the contact angle θ holds two spheres at the
//! gap s = max(0, -δ) by (Y. I. Rabinovich, M. S. Esayanur and B. M. Moudgil, Langmuir 21, 10992,
//! 2005)
//!
//! ```text
//! F_c = 4πγ cos θ R* (1 - s/√(s² + c²)),   c² = V/(πR*),   R* = R_i R_j/(R_i+R_j)
//! ```
//!
//! between equal spheres 2πγ cos θ R where they touch. It breaks at (G. Lian, C. Thornton and M. J.
//! Adams, J. Colloid Interface Sci. 161, 138, 1993)
//!
//! ```text
//! s_c = (1 + θ/2) V^(1/3)
//! ```
//!
//! and with it the energy ∫F_c ds up to s_c is lost.

use std::f64::consts::{FRAC_PI_2, PI};
use std::ops::Bound::{Excluded, Included};
use std::sync::Arc;

use gshear_dem::adhesions::AdhesionKind;
use gshear_dem::contact::adhesion::reduced_radius;
use gshear_dem::contact::adhesion::{Adhesion, AdhesiveContact, AdhesivePairs, without_slopes};
use gshear_dem::contact::{PairRadii, scalar};
use gshear_dem::dimension::Dimensions;
use gshear_dem::laws::keys::{Bounds, Key, POSITIVE};
use gshear_dem::simd::{Lanes, Portable, cube_root};

/// The adhesion as scenes name it.
pub const KIND: AdhesionKind = AdhesionKind {
    name: "liquid-bridge",
    summary: "liquid bridges that form where spheres touch and break at a distance",
    dimensions: &[Dimensions::Three],
    keys: &[&SURFACE_TENSION, &LIQUID_VOLUME, &CONTACT_ANGLE],
    unfit: |_| None,
    read: |values, _| {
        Some(Arc::new(LiquidBridge::new(
            values.required(&SURFACE_TENSION),
            values.required(&LIQUID_VOLUME),
            values.number(&CONTACT_ANGLE).unwrap_or(0.0),
        )))
    },
};

/// γ.
const SURFACE_TENSION: Key = Key::number("contact.surface_tension", POSITIVE)
    .such_as("gamma", "N/m", "0.073")
    .doc("surface tension γ of the liquid");
/// V.
const LIQUID_VOLUME: Key = Key::number("contact.liquid_volume", POSITIVE)
    .such_as("V", "m³", "1e-12")
    .doc("volume V of a bridge");
/// θ.
const CONTACT_ANGLE: Key = Key {
    default: "0.0",
    ..Key::number(
        "contact.contact_angle",
        Bounds::new(Included(0.0), Excluded(FRAC_PI_2)),
    )
    .such_as("theta", "", "0.2")
    .doc("contact angle θ (rad)")
};

/// Liquid bridges of one volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LiquidBridge {
    /// F_c/R* at the touch, 4πγ cos θ (N/m).
    per_radius: f64,
    /// c² R* = V/π (m³).
    volume: f64,
    /// s_c (m).
    rupture: f64,
}

impl LiquidBridge {
    /// Of γ (N/m), V (m³) and θ.
    pub fn new(surface_tension: f64, volume: f64, angle: f64) -> Self {
        let length = scalar(|token| cube_root(token, Portable::splat(token, volume)));
        Self {
            per_radius: 4.0 * PI * surface_tension * cosine(angle),
            volume: volume / PI,
            rupture: (1.0 + 0.5 * angle) * length,
        }
    }

    /// √(s² + c²) (m) at s² (m²).
    #[inline(always)]
    fn length<L: Lanes>(&self, token: L::Token, radii: &PairRadii<L>, square: L) -> L {
        (square + L::splat(token, self.volume) / radii.reduced()).sqrt()
    }
}

impl Adhesion for LiquidBridge {
    const ACROSS_GAPS: bool = true;

    #[inline(always)]
    fn force<L: Lanes>(&self, token: L::Token, pairs: &AdhesivePairs<L>) -> L {
        let gap = (-pairs.overlap).max(L::splat(token, 0.0));
        let part = gap / self.length(token, &pairs.radii, gap * gap);
        let force = L::splat(token, self.per_radius) * pairs.radii.reduced();
        force * (L::splat(token, 1.0) - part)
    }

    #[inline(always)]
    fn margin<L: Lanes>(&self, token: L::Token, _: &PairRadii<L>, overlap: L) -> L {
        overlap + L::splat(token, self.rupture)
    }

    /// F_c(0) (c - δ - √(s² + c²)).
    #[inline(always)]
    fn add_potential<L: Lanes>(&self, token: L::Token, pairs: &AdhesivePairs<L>, energy: L) -> L {
        let zero = L::splat(token, 0.0);
        let gap = (-pairs.overlap).max(zero);
        let at_touch = self.length(token, &pairs.radii, zero);
        let length = self.length(token, &pairs.radii, gap * gap);
        let force = L::splat(token, self.per_radius) * pairs.radii.reduced();
        force.mul_add(at_touch - pairs.overlap - length, energy)
    }

    /// dF_c/dδ = F_c(0) c²/(s² + c²)^(3/2) across a gap, 0 elsewhere.
    fn contact(&self, radii: [f64; 2], overlap: f64) -> AdhesiveContact {
        let contact = without_slopes(self, radii, overlap);
        if overlap > 0.0 {
            return contact;
        }
        let reduced = reduced_radius(radii);
        let square = self.volume / reduced;
        let length = (overlap * overlap + square).sqrt();
        AdhesiveContact {
            force_slope: self.per_radius * reduced * square / (length * length * length),
            ..contact
        }
    }
}

/// cos x of 0 ≤ x < π/2 by its series: that of the system may differ in the last bit.
fn cosine(x: f64) -> f64 {
    (1..=12).rev().fold(1.0, |sum, k| {
        let n = 2.0 * f64::from(k);
        1.0 - x * x / (n * (n - 1.0)) * sum
    })
}
