//! Adhesion of spheres whose contact it does not deform (B. V. Derjaguin, V. M. Muller and
//! Y. P. Toporov, J. Colloid Interface Sci. 53, 314, 1975; LAMMPS' `dmt`): with the surface
//! energy γ
//!
//! ```text
//! F_c = 4πγR*,  δ > 0,   R* = R_i R_j/(R_i+R_j)
//! ```
//!
//! and the constant attraction, if there is one. The potential is -F_c δ.

use std::f64::consts::PI;
use std::sync::Arc;

use super::AdhesionKind;
use super::constant::{ATTRACTION, Constant};
use crate::contact::adhesion::{Adhesion, AdhesiveContact, AdhesivePairs};
use crate::dimension::Dimensions;
use crate::laws::keys::{Key, NOT_NEGATIVE};
use crate::simd::Lanes;

/// The adhesion as scenes name it.
pub const KIND: AdhesionKind = AdhesionKind {
    name: "dmt",
    summary: "the attraction 4πγR* of spheres that touch (Derjaguin, Muller and Toporov)",
    dimensions: &[Dimensions::Three],
    keys: &[&ATTRACTION, &SURFACE_ENERGY],
    unfit: |_| None,
    read: |values, _| {
        let constant = Constant::read(values);
        let surface_energy = values.number(&SURFACE_ENERGY).unwrap_or(0.0);
        if surface_energy > 0.0 {
            Some(Arc::new(Dmt::new(surface_energy, constant)))
        } else {
            constant.shared()
        }
    },
};

/// γ.
pub(crate) const SURFACE_ENERGY: Key = Key {
    default: "0.0",
    ..Key::number("contact.surface_energy", NOT_NEGATIVE)
        .such_as("gamma", "J/m²", "0.05")
        .doc("surface energy γ: an attraction of 4πγR* (DMT), or JKR; 3D only")
};

/// DMT adhesion of two spheres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dmt {
    /// 4πγ (N/m).
    per_radius: f64,
    constant: Constant,
}

impl Dmt {
    /// Of the surface energy γ (J/m²), beside a constant attraction.
    pub fn new(surface_energy: f64, constant: Constant) -> Self {
        Self {
            per_radius: 4.0 * PI * surface_energy,
            constant,
        }
    }
}

impl Adhesion for Dmt {
    #[inline(always)]
    fn force<L: Lanes>(&self, token: L::Token, pairs: &AdhesivePairs<L>) -> L {
        let constant = self.constant.force(token, pairs);
        L::splat(token, self.per_radius).mul_add(pairs.radii.reduced(), constant)
    }

    #[inline(always)]
    fn add_potential<L: Lanes>(&self, token: L::Token, pairs: &AdhesivePairs<L>, energy: L) -> L {
        (-self.force(token, pairs)).mul_add(pairs.overlap, energy)
    }

    fn contact(&self, radii: [f64; 2], overlap: f64) -> AdhesiveContact {
        AdhesiveContact {
            elastic_overlap: overlap,
            elastic_slope: 1.0,
            force: self.pull_off(radii),
            force_slope: 0.0,
        }
    }

    fn pull_off(&self, radii: [f64; 2]) -> f64 {
        let [r1, r2] = radii;
        self.constant.force + self.per_radius * r1 * r2 / (r1 + r2)
    }
}
