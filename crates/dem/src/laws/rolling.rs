//! [`Resistance`] to the rotation of two grains against each other: disks have one against rolling,
//! spheres (`rolling_spheres`) one against rolling and one against twisting.
//!
//! That of disks is of type C (Ai et al. 2011; LH A13 to A22): a torsional spring between the two
//! rotations, and a damper,
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
use crate::contact::adhesion::reduced_radius;
use crate::contact::stiffness::{Derivatives, SpringForce};
use crate::contact::{
    Blocks, ContactLaw, CutDamper, Limited, LimitedSpring, Sliding, Trial, add_damping,
    dissipation, reaches, velocity_before,
};
use crate::simd::{Lanes, Lanes16, Mask, inverse};

/// Number of quantities that [`Resistance::parameters`] computes.
pub const PARAMETERS: usize = 3;
// Their places: k (N m; N in 2D), C (N m s; N s in 2D), μ R_r (m).
pub(super) const STIFFNESS: usize = 0;
pub(super) const DAMPING: usize = 1;
pub(super) const ARM: usize = 2;

/// A torque of a spring, a damper and a slider: with R_r = R_i R_j/(R_i+R_j) and the reduced moment
/// of inertia I
///
/// ```text
/// k = `stiffness` R_r²,   C = `damping` √(I k),   |M| ≤ `friction` R_r F_n
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resistance {
    /// k/R_r² (N/m; Pa in 2D).
    pub stiffness: f64,
    /// μ.
    pub friction: f64,
    /// 2η, times what I lacks.
    pub damping: f64,
}

impl Resistance {
    /// Computes the parameters of pairs from R_r (m) and I (kg m²; kg m in 2D).
    #[inline(always)]
    pub fn parameters<L: Lanes>(
        &self,
        token: L::Token,
        reduced_radius: L,
        inertia: L,
        out: &mut [Lanes16],
    ) {
        let stiffness = L::splat(token, self.stiffness) * reduced_radius * reduced_radius;
        let damping = L::splat(token, self.damping) * (inertia * stiffness).sqrt();
        stiffness.store(&mut out[STIFFNESS]);
        damping.store(&mut out[DAMPING]);
        (L::splat(token, self.friction) * reduced_radius).store(&mut out[ARM]);
    }

    /// The derivatives of the spring's torque `trial` on i, of grains of these radii (m); F_n must
    /// be set.
    pub fn derivatives(
        &self,
        trial: [f64; 3],
        radii: [f64; 2],
        normal: &Derivatives,
        at_limit: Option<bool>,
    ) -> SpringForce {
        let r_r = reduced_radius(radii);
        let limit = normal.limit(self.friction * r_r);
        SpringForce::new(trial, self.stiffness * r_r * r_r, limit, at_limit)
    }
}

/// Resistance of disks to rolling.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rolling {
    resistance: Resistance,
    /// Mass per squared radius, ρπ (kg/m³), of i and j.
    densities: [f64; 2],
}

impl Rolling {
    /// That of these contacts.
    pub(super) fn new(constants: &dyn Constants, contact: &Contact) -> Self {
        let stiffness = contact.rolling_stiffness.or(constants.rolling_stiffness());
        Self {
            resistance: Resistance {
                stiffness: stiffness.unwrap_or(0.0),
                friction: contact.rolling_friction,
                damping: 2.0 * contact.rolling_damping_ratio,
            },
            densities: contact.densities(constants.masses().of(0, PI)),
        }
    }

    /// The derivatives of the spring's torque `trial` on i; F_n must be set.
    pub(super) fn derivatives(
        &self,
        trial: f64,
        radii: [f64; 2],
        normal: &Derivatives,
        rolls: Option<bool>,
    ) -> SpringForce {
        let trial = [trial, 0.0, 0.0];
        self.resistance.derivatives(trial, radii, normal, rolls)
    }

    /// Computes the parameters of the resistance; I = (3/2) mR² of each disk, about the contact.
    #[inline(always)]
    pub fn parameters<L: Lanes>(&self, token: L::Token, r_i: L, r_j: L, out: &mut [Lanes16]) {
        let [density_i, density_j] = self.densities.map(|density| 1.5 * density);
        let i_i = L::splat(token, density_i) * r_i * r_i * r_i * r_i;
        let i_j = L::splat(token, density_j) * r_j * r_j * r_j * r_j;
        let reduced_radius = r_i * r_j / (r_i + r_j);
        let inertia = i_i * i_j / (i_i + i_j);
        self.resistance
            .parameters(token, reduced_radius, inertia, out);
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
        let trial = (-load(&p[at + STIFFNESS])).mul_add(increment, before);
        let limit = load(&p[at + ARM]) * load(&response.normal);
        let speed = load(&motion.rolling_velocity);
        let damping = load(&p[at + DAMPING]) * speed;
        let [speed_before, ..] =
            velocity_before(token, blocks.per_step, &[increment; 3], &[speed; 3]);
        let damping_before = load(&p[at + DAMPING]) * speed_before;
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
            let compliance = inverse(token, load(&p[at + STIFFNESS]));
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
