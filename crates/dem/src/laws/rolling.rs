//! Rolling resistance of disks, of type C (Ai et al. 2011; LH A13 to A22): a torsional spring
//! between the two rotations, and a damper,
//!
//! ```text
//! M^k ← M^k - k_r Δθ_r,  |M^k| ≤ μ_r R_r F_n,  M = M^k - C_r (ω_i-ω_j) below that limit
//! C_r = 2η_r√(I_r k_r)
//! ```
//!
//! of `lee_hurley`. With `hooke` the limit is that of M, so that M does not jump there, and M^k is
//! set back so that spring and damper together give it, as between spheres (`rolling_spheres`).
//! Without a damper both are the same.
//!
//! with R_r = R_i R_j/(R_i+R_j) and I_r = I_i I_j/(I_i+I_j) of the moments of inertia I + mR² about
//! the contact (LH A22).

use std::f64::consts::PI;

use super::{Constants, Contact};
use crate::contact::stiffness::{Derivatives, SpringForce};
use crate::contact::{
    Blocks, ContactLaw, CutDamper, Limited, LimitedSpring, Sliding, Trial, add_damping,
    dissipation, reaches, velocity_before,
};
use crate::simd::{Lanes, Lanes16, Mask, inverse};

/// Number of quantities that [`Rolling::parameters`] computes, the last parameters of a law.
pub const PARAMETERS: usize = 3;

/// Constants of a rolling resistance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rolling {
    /// k_r/R_r² (Pa).
    pub stiffness: f64,
    /// Mass per squared radius, ρπ (kg/m³), of i and j.
    pub densities: [f64; 2],
    /// μ_r.
    pub friction: f64,
    /// η_r.
    pub damping_ratio: f64,
}

impl Rolling {
    /// That of these contacts.
    pub(super) fn new(constants: &dyn Constants, contact: &Contact) -> Self {
        let stiffness = contact.rolling_stiffness.or(constants.rolling_stiffness());
        Self {
            stiffness: stiffness.unwrap_or(0.0),
            densities: contact.densities(constants.masses().of(0, PI)),
            friction: contact.rolling_friction,
            damping_ratio: contact.rolling_damping_ratio,
        }
    }

    /// k_r (N m; N in 2D) and μ_r R_r (m) of two radii (m).
    fn spring(&self, [r_i, r_j]: [f64; 2]) -> (f64, f64) {
        let r_r = r_i * r_j / (r_i + r_j);
        (self.stiffness * r_r * r_r, self.friction * r_r)
    }

    /// The derivatives of the spring's torque `trial` on i; F_n must be set.
    pub(super) fn derivatives(
        &self,
        trial: f64,
        radii: [f64; 2],
        of: &Derivatives,
        rolls: Option<bool>,
    ) -> SpringForce {
        let (k_r, arm) = self.spring(radii);
        SpringForce::new([trial, 0.0, 0.0], k_r, of.limit(arm), rolls)
    }

    /// Computes k_r, C_r and μ_r R_r.
    #[inline(always)]
    pub fn parameters<L: Lanes>(&self, token: L::Token, r_i: L, r_j: L, out: &mut [Lanes16]) {
        let c = |v| L::splat(token, v);
        let r_r = r_i * r_j / (r_i + r_j);
        let k_r = c(self.stiffness) * r_r * r_r;
        let [of_i, of_j] = [c(1.5 * self.densities[0]), c(1.5 * self.densities[1])];
        let (i_i, i_j) = (of_i * r_i * r_i * r_i * r_i, of_j * r_j * r_j * r_j * r_j);
        let i_r = i_i * i_j / (i_i + i_j);
        k_r.store(&mut out[0]);
        (c(2.0 * self.damping_ratio) * (i_r * k_r).sqrt()).store(&mut out[1]);
        (c(self.friction) * r_r).store(&mut out[2]);
    }
}

/// Computes M, the last number of the history of the law `C`; F_n must be set.
#[inline(always)]
pub fn rolling_force<C: ContactLaw, L: Lanes, const BUDGET: bool>(
    token: L::Token,
    blocks: &mut Blocks<'_>,
) {
    let load = |lanes: &Lanes16| L::load(token, lanes);
    let zero = L::splat(token, 0.0);
    let (at, place) = (C::PARAMETERS - PARAMETERS, C::HISTORY - 1);
    let parameters = blocks.parameters.chunks_exact(C::PARAMETERS);
    let kept = parameters.zip(blocks.history.chunks_exact_mut(C::HISTORY));
    let pairs = kept.zip(blocks.motion);
    for (((p, history), motion), response) in pairs.zip(&mut *blocks.response) {
        let touching = load(&motion.overlap).greater(zero);
        let before = load(&history[place]);
        let increment = load(&motion.rolling_increment);
        let trial = (-load(&p[at])).mul_add(increment, before);
        let limit = load(&p[at + 2]) * load(&response.normal);
        let speed = load(&motion.rolling_velocity);
        let damping = load(&p[at + 1]) * speed;
        let [speed_before, ..] =
            velocity_before(token, blocks.per_step, &[increment; 3], &[speed; 3]);
        let damping_before = load(&p[at + 1]) * speed_before;
        let rolled = L::mask(token, response.rolls);
        let (torque, elastic, viscous, at_limit);
        if C::CUTS_DAMPERS {
            let trial = Trial {
                before: [before; 3],
                elastic: [trial; 3],
                viscous: [damping; 3],
                viscous_before: [damping_before; 3],
            };
            let m = Sliding::scalar(&trial, limit, touching);
            (torque, elastic, viscous, at_limit) = (m.force[0], m.elastic[0], damping, m.at_limit);
        } else {
            let m = Limited::scalar(token, trial, limit, damping, 0.0);
            torque = m.elastic - m.viscous;
            (elastic, viscous, at_limit) = (m.elastic, m.viscous, m.at_limit);
        }
        torque.store(&mut response.rolling);
        response.rolls = at_limit.bits();
        let after = elastic.select(touching, zero);
        if BUDGET {
            let work = (before + after) * increment;
            let compliance = inverse(token, load(&p[at]));
            let gained = (after - before) * (after + before) * compliance;
            let dissipated = L::splat(token, -0.5) * (work + gained);
            dissipated.store(&mut response.dissipated[dissipation::ROLLING]);
            let power = viscous.select(touching, zero) * speed;
            if C::CUTS_DAMPERS {
                response.dissipated[dissipation::CUT_ROLLING] = Lanes16::ZERO;
                response.dissipated[dissipation::SET_BACK_ROLLING] = Lanes16::ZERO;
                let half_compliance = L::splat(token, 0.5) * compliance;
                let reaches = reaches(token, at_limit, torque * torque, limit);
                let mut damper = CutDamper {
                    power,
                    before: LimitedSpring::at(token, rolled.and(touching)),
                    after: LimitedSpring::at(token, reaches.and(touching)),
                };
                damper
                    .before
                    .add(half_compliance, before, before - damping_before);
                damper.after.add(half_compliance, after, torque);
                damper.count(token, response, true);
            } else {
                add_damping(token, response, power);
            }
        }
        after.store(&mut history[place]);
    }
}
