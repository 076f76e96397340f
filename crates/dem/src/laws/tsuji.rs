//! Spheres: Hertz and Mindlin as in `hertz`, with the damping of Tsuji et al. (1992), whose
//! restitution is the same at every speed.
//!
//! With δ, R* and m* of `hertz`,
//!
//! ```text
//! F_n = max(0, √(δR*) k_n δ - γ_n v_n),   γ_n = α √(2 m* k_n √(δR*)),   k_n = (2/3) E/(1-ν²)
//! F_t = -√(δR*) k_t u - γ_t v_t,          γ_t = x γ_n,                  k_t = 2E/((1+ν)(2-ν))
//! ```
//!
//! with Coulomb's limit and the history u, or F, of `hertz`, but u is set back against v_t to
//! k_t |u| = μ k_n δ at most: where γ_t |v_t| exceeds the limit by more, F_t = -μF_n v_t/|v_t|. At
//! the touch a damper exceeds the limit if x |v_t| > μ |v_n|. Without the bound it would set u back
//! by more the smaller the overlap, as δ^(-1/4), and the motion not converge with Δt. LAMMPS has no
//! such bound.
//!
//! α depends on the coefficient of restitution e (Marshall 2009, eq. 53):
//!
//! ```text
//! α = 1.2728 - 4.2783 e + 11.087 e² - 22.348 e³ + 27.467 e⁴ - 18.022 e⁵ + 4.8218 e⁶
//! ```
//!
//! This is LAMMPS' `pair_style granular` with `hertz/material E e ν`,
//! `tangential mindlin NULL x μ`, `damping tsuji` and `limit_damping`. In Tsuji's α the mass is
//! that of one of two equal spheres, 2 m*; versions of LAMMPS up to 2025 take m*, so their α is
//! smaller by √2, and their restitution higher. The torque of F_t has the arm R here, as in LAMMPS'
//! `gran/*`; in `granular` it has R - δ/2, which is 5 % less at δ = 0.1 R and 10 % at δ = 0.2 R.
//!
//! e is the restitution of spheres that may pull. Because F_n ≥ 0, they separate a little faster:
//! e = 0.5 gives 0.55, 0.9 gives 0.902.

use std::sync::Arc;

use super::hertz::{Damper, Hertz, PACKING_RESTITUTION, Rescaled, Spheres, impact};
use super::keys::{
    DENSITY, Key, POISSON_RATIO, RESTITUTION, TANGENTIAL_DAMPING_RATIO, TANGENTIAL_HISTORY,
    YOUNG_MODULUS,
};
use super::rolling_spheres::between_spheres;
use super::{Constants, Contact, LawKind, Rigidity};
use crate::contact::friction::Coulomb;
use crate::dimension::{Dimensions, Three};
use crate::kernel::PairForce;
use crate::simd::{Lanes, inverse_sqrt};
use crate::state::Masses;

/// The law as scenes name it.
pub const KIND: LawKind = LawKind {
    name: "hertz-tsuji",
    summary: "spheres of one elastic material: Hertz and Mindlin with the damping of Tsuji, whose \
              restitution does not depend on the speed, and Coulomb friction (LAMMPS `granular` \
              with `hertz/material`, `mindlin` and `damping tsuji`)",
    dimensions: &[Dimensions::Three],
    rolling: false,
    keys: &[
        &YOUNG_MODULUS,
        &POISSON_RATIO,
        &DENSITY,
        &RESTITUTION,
        &TANGENTIAL_DAMPING_RATIO,
        &TANGENTIAL_HISTORY,
    ],
    read: |values| {
        Arc::new(TsujiSpheres {
            spheres: Spheres::read_material(values),
            restitution: values.required(&RESTITUTION),
            tangential_damping_ratio: values
                .number(&TANGENTIAL_DAMPING_RATIO)
                .unwrap_or(DEFAULT_RATIO),
        })
    },
};

/// x if it is not given.
const DEFAULT_RATIO: f64 = 0.5;

/// The elastic material of the spheres, and their restitution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TsujiSpheres {
    /// E, ν and ρ; the damping here is not used.
    pub spheres: Spheres,
    /// e.
    pub restitution: f64,
    /// x = γ_t/γ_n.
    pub tangential_damping_ratio: f64,
}

/// α of a coefficient of restitution e, 0 < e ≤ 1.
pub(crate) fn damping_factor(e: f64) -> f64 {
    const COEFFICIENTS: [f64; 7] = [1.2728, -4.2783, 11.087, -22.348, 27.467, -18.022, 4.8218];
    if e == 1.0 {
        // The fit leaves 3e-4 there.
        return 0.0;
    }
    let fit = COEFFICIENTS.iter().rev().fold(0.0, |sum, c| sum * e + c);
    fit.max(0.0)
}

impl TsujiSpheres {
    /// √2 α.
    fn damping(&self) -> f64 {
        std::f64::consts::SQRT_2 * damping_factor(self.restitution)
    }

    /// The restitution of an impact of these spheres, which never pull.
    ///
    /// With δ = vT x, t = T s, T^(5/2) = m*/(k_n √(R* v)) the impact is
    /// x'' = -max(0, x^(3/2) + √2 α x^(1/4) x').
    pub fn restitution_of_impact(&self) -> f64 {
        let damping = self.damping();
        impact(|x, v| x.sqrt() * x + damping * x.sqrt().sqrt() * v)
    }

    fn force<const FRICTION: bool>(&self, contact: &Contact) -> Hertz<FRICTION, Tsuji> {
        let constant = self.damping() * self.spheres.normal_stiffness().sqrt();
        let dampers = [constant, self.tangential_damping_ratio];
        Hertz::damped(&self.spheres, contact, dampers, Coulomb(contact.friction))
    }
}

impl Constants for TsujiSpheres {
    fn masses(&self) -> Masses {
        self.spheres.masses()
    }

    fn normal_stiffness(&self, r1: f64, r2: f64, overlap: f64) -> f64 {
        Constants::normal_stiffness(&self.spheres, r1, r2, overlap)
    }

    fn largest_overlap(&self, r1: f64, r2: f64) -> f64 {
        self.spheres.largest_overlap(r1, r2)
    }

    fn rigidity(&self, secant: f64, mass: f64, tangential: bool) -> Rigidity {
        let normal = self.damping() * (0.5 * mass * secant).sqrt();
        Rigidity {
            damping: [normal, self.tangential_damping_ratio * normal],
            ..self.spheres.rigidity(secant, mass, tangential)
        }
    }

    /// With the restitution of `hertz` during packing, unless theirs is lower.
    fn while_packing(&self, _: f64, _: f64) -> Option<Arc<dyn Constants>> {
        Some(Arc::new(Self {
            restitution: self.restitution.min(PACKING_RESTITUTION),
            ..*self
        }))
    }

    fn collision_time(&self, radius: f64, speed: f64) -> Option<f64> {
        self.spheres.collision_time(radius, speed)
    }

    fn contact_modulus(&self) -> Option<f64> {
        self.spheres.contact_modulus()
    }

    fn default_of(&self, key: &Key) -> Option<f64> {
        (key.path == TANGENTIAL_DAMPING_RATIO.path).then_some(DEFAULT_RATIO)
    }

    fn derived(&self) -> Vec<(&'static str, f64, &'static str)> {
        let mut derived = self.spheres.stiffnesses().to_vec();
        derived.push(("damping factor alpha", damping_factor(self.restitution), ""));
        derived.push(("restitution of an impact", self.restitution_of_impact(), ""));
        derived
    }

    fn spheres(&self, contact: &Contact) -> Option<Box<dyn PairForce<Three>>> {
        let smooth = self.force::<false>(contact);
        Some(if self.spheres.remembers_force {
            between_spheres(self, contact, Rescaled::new(smooth), smooth)
        } else {
            between_spheres(self, contact, self.force::<true>(contact), smooth)
        })
    }
}

/// A damper α √(2 m* k_n √(δR*)); its constant is α √(2 k_n).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tsuji;

impl Damper for Tsuji {
    const BOUNDS_SPRING: bool = true;

    #[inline(always)]
    fn of_pair<L: Lanes>(_: L::Token, constant: L, reduced_mass: L) -> L {
        constant * reduced_mass.sqrt()
    }

    #[inline(always)]
    fn per_root<L: Lanes>(token: L::Token, of_pair: L, root: L) -> L {
        of_pair * inverse_sqrt(token, root)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the closed form of spheres that may pull, √2 α = -√5 ln e/√(π² + ln² e).
    #[test]
    fn the_fit_of_alpha_is_good_to_a_thousandth() {
        for percent in 10..=100 {
            let e = f64::from(percent) / 100.0;
            let exact = -2.5f64.sqrt() * e.ln() / e.ln().hypot(std::f64::consts::PI);
            assert!((damping_factor(e) - exact).abs() < 1.5e-3, "{e}");
        }
    }
}
