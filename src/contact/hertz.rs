//! Spheres: Hertz and Mindlin with viscous damping and Coulomb friction (FR eqs 1–2), LAMMPS' `gran/hertz/history` with the paper's k_t.
//!
//! With the overlap δ and R* = R_i R_j/(R_i+R_j), m* = m_i m_j/(m_i+m_j),
//!
//!     F_n = max(0, √(δR*) (k_n δ - m*γ_n v_n)),   k_n = (2/3) E/(1-ν²)
//!     F_t = -√(δR*) (k_t u + m*γ_t v_t),          k_t = 2E/((1+ν)(2-ν))
//!
//! The history u (m) is the tangential displacement since the touch. Where |F_t| would be beyond μF_n, it is cut to the limit, and u
//! is set back so that spring and damper together give just that force.

use super::stiffness::{Derivatives, Stiffness};
use super::{Blocks, ContactLaw, add_damping, loss, norm, scaled, vector};
use crate::config::{Contact, Spheres};
use crate::dimension::{Dimension, Three};
use crate::simd::{Lanes, Mask, Row, inverse, inverse_sqrt};

/// Largest δ/(R_1+R_2) of two equal spheres: far beyond where Hertz' theory holds, but no further than other laws go. For unequal ones
/// it is this part of the smaller one's diameter.
pub const LARGEST_OVERLAP: f64 = super::hooke::LARGEST_OVERLAP;

/// Constants of the law, the same for all contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hertz<const FRICTION: bool> {
    /// k_n, k_t (Pa).
    normal_stiffness: f64,
    tangential_stiffness: f64,
    /// γ_n (1/(m s)).
    damping: f64,
    /// γ_t/γ_n.
    tangential_damping: f64,
    /// (4/3)πρ (kg/m³).
    density: f64,
    /// μ.
    friction: f64,
}

impl<const FRICTION: bool> Hertz<FRICTION> {
    pub fn new(spheres: &Spheres, contact: &Contact) -> Self {
        Self {
            normal_stiffness: spheres.normal_stiffness(),
            tangential_stiffness: spheres.tangential_stiffness(),
            damping: spheres.normal_damping,
            tangential_damping: spheres.tangential_damping
                / spheres.normal_damping.max(f64::MIN_POSITIVE),
            density: Three::volume(1.0) * spheres.density,
            friction: contact.friction,
        }
    }
}

// Places in the parameters of a pair.
/// R* (m).
const RADIUS: usize = 0;
/// m*γ_n (kg/(m s)).
const DAMPING: usize = 1;
/// Largest overlap (m).
const LARGEST: usize = 2;

// Place in what is carried: √(δR*).
const ROOT: usize = 0;

/// Square of a length (m²) that is as good as none.
const NO_AREA: f64 = 1e-290;

impl<const FRICTION: bool> ContactLaw for Hertz<FRICTION> {
    type Space = Three;
    const PARAMETERS: usize = 3;
    const HISTORY: usize = if FRICTION { 3 } else { 0 };
    const FRICTION: bool = FRICTION;
    const ROLLING: bool = false;

    #[inline(always)]
    fn parameters<L: Lanes>(&self, token: L::Token, r_i: L, r_j: L, out: &mut [Row]) {
        let c = |v| L::splat(token, v);
        let density = c(self.density);
        let (m_i, m_j) = (density * Three::power(r_i), density * Three::power(r_j));
        let smaller = r_i.select(r_j.greater(r_i), r_j);
        (r_i * r_j / (r_i + r_j)).store(&mut out[RADIUS]);
        (c(self.damping) * (m_i * m_j / (m_i + m_j))).store(&mut out[DAMPING]);
        (c(2.0 * LARGEST_OVERLAP) * smaller).store(&mut out[LARGEST]);
    }

    fn largest_force(&self, radius: f64) -> f64 {
        let overlap = 2.0 * LARGEST_OVERLAP * radius;
        self.normal_stiffness * overlap * (0.5 * radius * overlap).sqrt()
    }

    #[inline(always)]
    fn evaluate<L: Lanes, const LEDGER: bool>(&self, token: L::Token, blocks: &mut Blocks<'_>) {
        let c = |v| L::splat(token, v);
        let load = |row: &Row| L::load(token, row);
        let zero = c(0.0);
        for (((p, motion), carry), response) in blocks
            .parameters
            .chunks_exact(Self::PARAMETERS)
            .zip(blocks.motion)
            .zip(&mut *blocks.carry)
            .zip(&mut *blocks.response)
        {
            let (overlap, v_n) = (load(&motion.overlap), load(&motion.normal_velocity));
            let square = (overlap * load(&p[RADIUS])).max(c(NO_AREA));
            let root = square * inverse_sqrt(token, square);
            root.store(&mut carry[ROOT]);
            let elastic = c(self.normal_stiffness) * overlap;
            let normal = (root * (elastic - load(&p[DAMPING]) * v_n)).max(zero);
            normal.store(&mut response.normal);
            response.beyond = overlap.greater(load(&p[LARGEST])).bits();
            if LEDGER {
                let lost = root.mul_add(elastic, -normal) * v_n;
                lost.select(overlap.greater(zero), zero)
                    .store(&mut response.lost[loss::DAMPING]);
            }
        }
        if FRICTION {
            self.rub::<L, LEDGER>(token, blocks);
        }
    }

    /// F = √R* k_n δ^(3/2) over δ gives (2/5) √R* k_n δ^(5/2); tangential ½ k_t √(δR*) u².
    #[inline(always)]
    fn elastic_energies<L: Lanes>(
        &self,
        token: L::Token,
        parameters: &[Row],
        overlap: L,
        history: &[Row],
    ) -> [L; 3] {
        let c = |v| L::splat(token, v);
        let root = (overlap.max(c(0.0)) * L::load(token, &parameters[RADIUS])).sqrt();
        let normal = c(0.4 * self.normal_stiffness) * root * overlap * overlap;
        let mut tangential = c(0.0);
        if FRICTION {
            let u = vector(token, history, 3);
            tangential = c(0.5 * self.tangential_stiffness) * root * Three::dot(&u, &u);
        }
        [normal, tangential, c(0.0)]
    }

    fn history_to_state(history: [f64; 3]) -> [f64; 3] {
        history
    }

    fn history_from_state(state: [f64; 3]) -> [f64; 3] {
        state
    }
}

impl<const FRICTION: bool> Hertz<FRICTION> {
    /// F_t.
    #[inline(always)]
    fn rub<L: Lanes, const LEDGER: bool>(&self, token: L::Token, blocks: &mut Blocks<'_>) {
        let c = |v| L::splat(token, v);
        let load = |row: &Row| L::load(token, row);
        let zero = c(0.0);
        let k_t = c(self.tangential_stiffness);
        for ((((p, history), motion), carry), response) in blocks
            .parameters
            .chunks_exact(Self::PARAMETERS)
            .zip(blocks.history.chunks_exact_mut(3))
            .zip(blocks.motion)
            .zip(&*blocks.carry)
            .zip(&mut *blocks.response)
        {
            let touching = load(&motion.overlap).greater(zero);
            let root = load(&carry[ROOT]);
            let before = vector(token, history, 3);
            let slip = vector(token, &motion.tangential_increment, 3);
            let v_t = vector(token, &motion.tangential_velocity, 3);
            let u = [
                before[0] + slip[0],
                before[1] + slip[1],
                before[2] + slip[2],
            ];
            let gamma_t = c(self.tangential_damping) * load(&p[DAMPING]);
            // Over √(δR*).
            let mut force = [zero; 3];
            for k in 0..3 {
                force[k] = k_t.mul_add(u[k], gamma_t * v_t[k]);
            }
            let (length, per_length) = norm(token, &force);
            let limit = c(self.friction) * load(&response.normal);
            let sliding = (root * length).greater(limit);
            response.sliding = sliding.bits();
            // √(δR*) where the contact sticks.
            let factor = (limit * per_length).select(sliding, root);
            let part = factor * inverse(token, root);
            for k in 0..3 {
                (-(factor * force[k])).store(&mut response.tangential[k]);
                let spring = (part.mul_add(force[k], -(gamma_t * v_t[k])))
                    * c(1.0 / self.tangential_stiffness);
                let after = spring.select(sliding, u[k]).select(touching, zero);
                after.store(&mut history[k]);
            }
            if LEDGER {
                let after = vector(token, history, 3);
                let earlier = load(&motion.overlap) + load(&motion.normal_increment);
                let root_before = (earlier.max(zero) * load(&p[RADIUS])).sqrt();
                let root = root.select(touching, zero);
                let half_k = c(0.5 * self.tangential_stiffness);
                let work = half_k
                    * (root_before * Three::dot(&before, &slip) + root * Three::dot(&after, &slip));
                let gained = half_k
                    * (root * Three::dot(&after, &after)
                        - root_before * Three::dot(&before, &before));
                let stiffness = half_k * (root_before - root) * Three::dot(&before, &after);
                let stiffness = stiffness.select(touching, zero);
                stiffness.store(&mut response.lost[loss::STIFFNESS]);
                (work - gained - stiffness).store(&mut response.lost[loss::FRICTION]);
                let viscous = scaled(&v_t, gamma_t * root);
                let power = Three::dot(&viscous, &v_t).select(touching, zero);
                add_damping(token, response, power);
            }
        }
    }
}

/// F_t = -√(δR*) k_t u grows with the root of δ under a u that stays; at the limit it is -μF_n u/|u|.
impl<const FRICTION: bool> Stiffness for Hertz<FRICTION> {
    fn derivatives(&self, radii: [f64; 2], overlap: f64, history: [f64; 3]) -> Derivatives {
        let [r_i, r_j] = radii;
        let root = (overlap * r_i * r_j / (r_i + r_j)).sqrt();
        let d = Derivatives {
            normal: self.normal_stiffness * root * overlap,
            normal_slope: 1.5 * self.normal_stiffness * root,
            ..Derivatives::default()
        };
        if !FRICTION {
            return d;
        }
        let k_t = self.tangential_stiffness * root;
        let trial = history.map(|u| -k_t * u);
        let mut d = d.limited(trial, k_t, self.friction);
        if !d.sliding {
            d.tangential_slope = d.tangential.map(|f| 0.5 * f / overlap);
        }
        d
    }
}
