//! LH appendix A in 2D: cylinder Hertz, Lai's tangential stiffness, Coulomb, type C rolling resistance, linear damping.
//!
//! Normal (A1–A5): the implicit A2 in closed form. With y = δ/(4(R_1+R_2)) and ℓ = ln(16 R_1R_2/a²),
//!
//!     ℓ = L + ln(ℓ-1),  L = -ln y;   k_n = πE*/(ℓ-1);   a² = 16 R_1R_2 y/(ℓ-1);
//!     F_n = max(0, k_n δ - γ_n v_n),  γ_n = 2α√(k_n m*)
//!
//! Tangential (A6–A12, A23): the history is the elastic force on i along t̂,
//!
//!     F_t^e ← F_t^e - ½(k_t' + k_t) v_t(t+½Δt) Δt,   k_t' that of the last step: second order in Δt,
//!
//! set to the limit ±μ_s F_n and kept so where it is beyond; elsewhere -γ_t v_t is added, γ_t = 2α√(k_t m*).
//!
//! Rolling (A13–A22): M^k ← M^k - k_r Δθ_r, limited to μ_r R_r F_n; below the limit -C_r (ω_i-ω_j) is added.

use std::f64::consts::{LN_2, PI};

use super::{ContactLaw, Motion, Response, scalar};
use crate::simd::{Lanes, Mask, Portable, Row, ln};

/// Beyond a/R = 0.3 of the smaller grain the fit A9 of the penalty factor is about to change sign.
pub const LARGEST_CONTACT: f64 = 0.3;

/// Constants of the law, the same for all contacts. Both grains are of one material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeeHurley<const FRICTION: bool, const ROLLING: bool> {
    /// πE* (Pa).
    stiffness: f64,
    /// Mass per squared radius, ρπ (kg/m³).
    density: f64,
    /// α.
    damping_ratio: f64,
    /// μ_s.
    friction: f64,
    /// μ_r.
    rolling_friction: f64,
    /// η_r.
    rolling_damping_ratio: f64,
    /// Part of A9 that does not depend on a.
    penalty: f64,
    /// Factor of a/R in A9.
    penalty_slope: f64,
    /// ν/(2(1-ν)) of A8.
    poisson: f64,
}

impl<const FRICTION: bool, const ROLLING: bool> LeeHurley<FRICTION, ROLLING> {
    pub fn new(material: &crate::config::Material, contact: &crate::config::Contact) -> Self {
        let nu = material.poisson_ratio;
        Self {
            stiffness: PI * material.effective_modulus(),
            density: PI * material.density,
            damping_ratio: contact.damping_ratio,
            friction: contact.friction,
            rolling_friction: contact.rolling_friction,
            rolling_damping_ratio: contact.rolling_damping_ratio,
            penalty: 0.22 + 0.18 * nu + 0.36 * nu * nu,
            penalty_slope: 2.89 + 1.75 * nu,
            poisson: nu / (2.0 * (1.0 - nu)),
        }
    }
}

// Places in the parameters of a pair.
/// 1/(4(R_i+R_j)) (1/m).
const INVERSE_SIZE: usize = 0;
/// 2α√m*.
const DAMPING: usize = 1;
/// Largest x = a²/(16 R_i R_j) within the law.
const LARGEST_X: usize = 2;
/// 16 R_i R_j (m²).
const PRODUCT: usize = 3;
/// 1/R_i, 1/R_j (1/m).
const INVERSE_RADIUS_I: usize = 4;
const INVERSE_RADIUS_J: usize = 5;
/// ½ ln(R_i/R_j).
const HALF_LOG_RATIO: usize = 6;

/// ℓ of L = -ln y: the root of ℓ = L + ln(ℓ-1), ℓ > 2, for 3.7 < L < 39 (δ/(R_1+R_2) from 5e-17 to 0.098), to rounding.
///
/// The start is a polynomial in 1/(L+8) good to 6.3e-5; one step of Halley's method then leaves less than 1e-15.
#[inline(always)]
fn ell<L: Lanes>(token: L::Token, large_l: L) -> L {
    let c = |v| L::splat(token, v);
    let one = c(1.0);
    let t = (one / (large_l + c(8.0)) - c(0.05337334060738316)) * c(31.155807365439095);
    let start = c(-0.01489268906808979)
        .mul_add(t, c(0.0021620069681444086))
        .mul_add(t, c(-0.02105229572405353))
        .mul_add(t, c(0.010237045384419635))
        .mul_add(t, c(-0.1200515317408327))
        .mul_add(t, c(0.05572509687245477))
        .mul_add(t, c(-1.0023104998676688))
        .mul_add(t, c(2.5047678731879803))
        + large_l;
    let m = start - one;
    let f = start - ln(token, m) - large_l;
    let slope = m - one;
    start - f * slope * m / slope.mul_add(slope, c(-0.5) * f)
}

/// k_n = F_n^e/δ (Pa) of two cylinders of radii r1, r2 (m) at the overlap δ (m), E* in Pa (A2, physics.md).
pub fn normal_stiffness(effective_modulus: f64, r1: f64, r2: f64, overlap: f64) -> f64 {
    let y = overlap / (4.0 * (r1 + r2));
    let ell = scalar(|token| ell::<Portable>(token, -ln(token, Portable::splat(token, y))));
    PI * effective_modulus / (ell - 1.0)
}

impl<const FRICTION: bool, const ROLLING: bool> ContactLaw for LeeHurley<FRICTION, ROLLING> {
    const PARAMETERS: usize = 3 + if FRICTION { 4 } else { 0 } + if ROLLING { 3 } else { 0 };
    const HISTORY: usize = if FRICTION { 2 } else { 0 } + if ROLLING { 1 } else { 0 };
    const FRICTION: bool = FRICTION;
    const ROLLING: bool = ROLLING;

    fn parameters(&self, r_i: f64, r_j: f64, out: &mut [f64]) {
        let (m_i, m_j) = (self.density * r_i * r_i, self.density * r_j * r_j);
        let reduced_mass = m_i * m_j / (m_i + m_j);
        let smaller = if r_i < r_j { r_i } else { r_j };
        let product = 16.0 * r_i * r_j;
        out[INVERSE_SIZE] = 1.0 / (4.0 * (r_i + r_j));
        out[DAMPING] = 2.0 * self.damping_ratio * reduced_mass.sqrt();
        out[LARGEST_X] = LARGEST_CONTACT * LARGEST_CONTACT * smaller * smaller / product;
        if FRICTION {
            out[PRODUCT] = product;
            out[INVERSE_RADIUS_I] = 1.0 / r_i;
            out[INVERSE_RADIUS_J] = 1.0 / r_j;
            out[HALF_LOG_RATIO] = 0.5 * super::portable_ln(r_i / r_j);
        }
        if ROLLING {
            let at = Self::PARAMETERS - 3;
            let r_r = r_i * r_j / (r_i + r_j);
            let k_r = 0.25 * self.stiffness * r_r * r_r;
            // I + mR² of a disk (A22).
            let (i_i, i_j) = (1.5 * m_i * r_i * r_i, 1.5 * m_j * r_j * r_j);
            let i_r = i_i * i_j / (i_i + i_j);
            out[at] = k_r;
            out[at + 1] = 2.0 * self.rolling_damping_ratio * (i_r * k_r).sqrt();
            out[at + 2] = self.rolling_friction * r_r;
        }
    }

    #[inline(always)]
    fn evaluate<L: Lanes>(
        &self,
        token: L::Token,
        parameters: &[Row],
        history: &mut [Row],
        motion: Motion<L>,
        touching: L::Mask,
    ) -> Response<L> {
        let c = |v| L::splat(token, v);
        let p = |k: usize| L::load(token, &parameters[k]);
        let zero = c(0.0);

        let y = motion.overlap * p(INVERSE_SIZE);
        let ell = ell(token, -ln(token, y));
        let inverse = c(1.0) / (ell - c(1.0));
        let k_n = c(self.stiffness) * inverse;
        let x = y * inverse;
        let damping = p(DAMPING);
        let gamma_n = damping * k_n.sqrt();
        let normal = k_n
            .mul_add(motion.overlap, -(gamma_n * motion.normal_velocity))
            .max(zero);
        let beyond = x.greater(p(LARGEST_X)).and(touching);

        let mut tangential = zero;
        let mut rolling = zero;
        let mut sliding = zero.greater(zero);
        if FRICTION {
            let a = (p(PRODUCT) * x).sqrt();
            let penalty = |ratio: L| {
                c(-10.31)
                    .mul_add(ratio, c(self.penalty_slope))
                    .mul_add(ratio, c(self.penalty))
            };
            let half_log = p(HALF_LOG_RATIO);
            let base = c(0.5).mul_add(ell, c(self.poisson));
            let compliance = penalty(a * p(INVERSE_RADIUS_I)).mul_add(
                base + half_log,
                penalty(a * p(INVERSE_RADIUS_J))
                    .mul_add(base - half_log, ell + c(1.0 - 2.0 * LN_2)),
            );
            let k_t = c(self.stiffness) / compliance;
            let last = L::load(token, &history[1]);
            let trial = -(c(0.5) * (last + k_t))
                .mul_add(motion.tangential_increment, -L::load(token, &history[0]));
            let limit = c(self.friction) * normal;
            sliding = trial.abs().greater(limit);
            let elastic = limit.copy_sign(trial).select(sliding, trial);
            let viscous = damping * k_t.sqrt() * motion.tangential_velocity;
            tangential = elastic - zero.select(sliding, viscous);
            sliding = sliding.and(touching);
            elastic.select(touching, zero).store(&mut history[0]);
            k_t.select(touching, zero).store(&mut history[1]);
        }
        if ROLLING {
            let at = Self::PARAMETERS - 3;
            let place = Self::HISTORY - 1;
            let trial = -p(at).mul_add(motion.rolling_increment, -L::load(token, &history[place]));
            let limit = p(at + 2) * normal;
            let limited = trial.abs().greater(limit);
            let elastic = limit.copy_sign(trial).select(limited, trial);
            let viscous = p(at + 1) * motion.rolling_velocity;
            rolling = elastic - zero.select(limited, viscous);
            elastic.select(touching, zero).store(&mut history[place]);
        }
        Response {
            normal,
            tangential,
            rolling,
            sliding,
            beyond,
        }
    }

    fn history_to_state(history: [f64; 3]) -> [f64; 3] {
        match (FRICTION, ROLLING) {
            (false, true) => [0.0, 0.0, history[0]],
            _ => history,
        }
    }

    fn history_from_state(state: [f64; 3]) -> [f64; 3] {
        match (FRICTION, ROLLING) {
            (false, true) => [state[2], 0.0, 0.0],
            _ => state,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Contact, Material};

    const MATERIAL: Material = Material {
        young_modulus: 1e9,
        poisson_ratio: 0.2,
        density: 2500.0,
    };
    const CONTACT: Contact = Contact {
        friction: 0.7,
        rolling_friction: 0.01,
        damping_ratio: 0.1,
        rolling_damping_ratio: 0.3,
    };

    /// Lower branch of Lambert's W by 40-digit arithmetic (mpmath): ℓ of δ/(R_1+R_2).
    #[test]
    fn closed_form_of_the_cylinder() {
        for (ratio, expected) in [
            (1e-6, 18.037_204_363_872_48),
            (1e-5, 15.578_787_379_050_668),
            (1e-4, 13.088_924_430_173_33),
            (1e-3, 10.550_659_890_711_273),
            (1e-2, 7.926_873_037_311_755),
            (5e-2, 5.989_327_832_447_779),
            (9e-2, 5.238_433_779_037_182),
        ] {
            let k = normal_stiffness(1.0 / PI, 0.4, 0.6, ratio);
            let error = (k * (expected - 1.0) - 1.0).abs();
            assert!(error < 5e-16, "{ratio:e}: {error:e}");
        }
    }

    /// A2 itself: with the force of the closed form, a² = 4FR*/(πE*) and k_n of A2 give back the force.
    #[test]
    fn closed_form_satisfies_the_implicit_law() {
        let (e, r1, r2) = (MATERIAL.effective_modulus(), 0.5e-6, 0.9e-6);
        for exponent in -30..-9 {
            let overlap = (r1 + r2) * 2f64.powi(exponent);
            let force = normal_stiffness(e, r1, r2, overlap) * overlap;
            let a = (4.0 * force * (r1 * r2 / (r1 + r2)) / (PI * e)).sqrt();
            let k = PI * e / ((4.0 * r1 / a).ln() + (4.0 * r2 / a).ln() - 1.0);
            assert!((k * overlap / force - 1.0).abs() < 4e-15);
        }
    }

    /// k_t/k_n of physics.md (ν = 0.2, equal disks).
    #[test]
    fn tangential_stiffness_reference_values() {
        let law = LeeHurley::<true, true>::new(&MATERIAL, &CONTACT);
        for (ratio, expected) in [(0.005, 0.733), (0.01, 0.718), (0.05, 0.645), (0.1, 0.594)] {
            let r = 1e-6;
            let e = MATERIAL.effective_modulus();
            // δ from a: F = πE*a²/(4R*), δ = F/k_n.
            let ell: f64 = (16.0f64 / (ratio * ratio)).ln();
            let k_n = PI * e / (ell - 1.0);
            let overlap = PI * e * (ratio * r) * (ratio * r) / (4.0 * 0.5 * r) / k_n;
            let state = touch(&law, r, overlap, 0.0, 0.0);
            assert!((state[1] / k_n - expected).abs() < 5.1e-4, "{ratio}");
        }
    }

    #[test]
    fn slides_at_the_limit_and_remembers_it() {
        let law = LeeHurley::<true, true>::new(&MATERIAL, &CONTACT);
        let state = touch(&law, 1e-6, 1e-10, 1e-9, 0.0);
        let force = normal_stiffness(MATERIAL.effective_modulus(), 1e-6, 1e-6, 1e-10) * 1e-10;
        assert!((state[0] + 0.7 * force).abs() < 1e-15 * force);
    }

    /// History of one contact of equal radii after one step.
    fn touch(law: &LeeHurley<true, true>, r: f64, overlap: f64, slip: f64, roll: f64) -> [f64; 3] {
        type Law = LeeHurley<true, true>;
        let mut numbers = [0.0; Law::PARAMETERS];
        law.parameters(r, r, &mut numbers);
        let parameters = numbers.map(|v| Row([v; 8]));
        let mut history = [Row::ZERO; Law::HISTORY];
        let token = crate::simd::PortableToken;
        let c = |v| Portable::splat(token, v);
        let motion = Motion {
            overlap: c(overlap),
            normal_velocity: c(0.0),
            tangential_velocity: c(0.0),
            tangential_increment: c(slip),
            rolling_velocity: c(0.0),
            rolling_increment: c(roll),
        };
        law.evaluate(token, &parameters, &mut history, motion, 0xff);
        history.map(|row| row.0[3])
    }
}
