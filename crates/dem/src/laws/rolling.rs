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
use crate::contact::parts::{self, SlidingForce, SpringAndDamper, SpringWork, add_damping};
use crate::contact::stiffness::{Derivatives, ParallelDamper, SpringForce};
use crate::contact::{Blocks, ContactLaw};
use crate::dimension::Vector;
use crate::simd::{Lanes, Lanes16, Mask, inverse};

/// Number of quantities that [`Resistance::parameters`] computes.
pub const PARAMETERS: usize = 3;
// Their places, as in [`PairResistance`].
const STIFFNESS: usize = 0;
const DAMPING: usize = 1;
const ARM: usize = 2;

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

/// Minus the derivatives by the spins of a torque with these [`Resistance::parameters`], beside its
/// spring; `normal`: those of F_n.
pub(super) fn damper_of(
    parameters: &[f64],
    spring: &SpringForce,
    normal: &Derivatives,
) -> SpringForce {
    let damper = ParallelDamper {
        cut: parameters[DAMPING],
        beside: 0.0,
        of_limit: parameters[ARM] * normal.normal_slope,
    };
    damper.derivatives(spring, parameters[STIFFNESS])
}

/// A resistance of pairs of known radii.
#[derive(Clone, Copy)]
pub(super) struct PairResistance<L> {
    /// k (N m; N in 2D).
    pub stiffness: L,
    /// C (N m s; N s in 2D).
    pub damping: L,
    /// μ R_r (m).
    pub arm: L,
}

impl<L: Lanes> PairResistance<L> {
    /// By the parameters that [`Resistance::parameters`] has computed.
    #[inline(always)]
    pub fn load(token: L::Token, parameters: &[Lanes16]) -> Self {
        Self {
            stiffness: L::load(token, &parameters[STIFFNESS]),
            damping: L::load(token, &parameters[DAMPING]),
            arm: L::load(token, &parameters[ARM]),
        }
    }

    /// 1/k; the energy of a spring without stiffness is 0.
    #[inline(always)]
    pub fn compliance(&self, token: L::Token) -> L {
        inverse(token, self.stiffness.max(L::splat(token, SOFTEST)))
    }

    /// Spring and damper over a step, without their limit.
    #[inline(always)]
    pub fn turned(&self, token: L::Token, rotation: &Rotation<L>) -> SpringAndDamper<L> {
        let per_half_step = L::splat(token, 2.0 * rotation.per_step);
        let moves = L::splat(token, if rotation.per_step > 0.0 { 2.0 } else { 0.0 });
        let mut spring = SpringAndDamper {
            components: rotation.components,
            before: rotation.before,
            force_before: rotation.before,
            elastic: rotation.before,
            viscous: rotation.before,
            force: rotation.before,
            was_at_limit: rotation.was_at_limit,
            touching: rotation.touching,
        };
        for k in 0..rotation.components {
            let (angle, velocity) = (rotation.angle[k], rotation.velocity[k]);
            let elastic = (-self.stiffness).mul_add(angle, rotation.before[k]);
            let force = (-self.damping).mul_add(velocity, elastic);
            let gained = moves * velocity - per_half_step * angle;
            spring.elastic[k] = elastic;
            spring.viscous[k] = self.damping * velocity;
            spring.force[k] = force;
            spring.force_before[k] = force + self.stiffness.mul_add(angle, self.damping * gained);
        }
        spring
    }
}

/// Lower bound of a stiffness (N m; N in 2D), by which energies are divided.
pub(super) const SOFTEST: f64 = 1e-200;

/// The rotation of i against j in a step, of one component, the first, or of three in the tangent
/// plane, and the spring that it meets.
pub(super) struct Rotation<L: Lanes> {
    /// Number of components: 1 or 3.
    pub components: usize,
    /// The spring's torque before the step.
    pub before: Vector<L>,
    /// (ω_i - ω_j)(t + ½Δt) Δt (rad).
    pub angle: Vector<L>,
    /// ω_i - ω_j at the end (rad/s).
    pub velocity: Vector<L>,
    /// 1/Δt as in [`Blocks::per_step`].
    pub per_step: f64,
    /// Where the torque was at its limit before the step.
    pub was_at_limit: L::Mask,
    /// Where the grains touch.
    pub touching: L::Mask,
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
    let zero = L::splat(token, 0.0);
    let (at, place) = (C::PARAMETERS - PARAMETERS, C::HISTORY - 1);
    let parameters = blocks.parameters.chunks_exact(C::PARAMETERS);
    let kept = parameters.zip(blocks.history.chunks_exact_mut(C::HISTORY));
    let pairs = kept.zip(blocks.motion);
    for (((p, history), motion), response) in pairs.zip(&mut *blocks.response) {
        let resistance = PairResistance::<L>::load(token, &p[at..]);
        let rotation = Rotation {
            components: 1,
            before: [L::load(token, &history[place]); 3],
            angle: [L::load(token, &motion.rolling_increment); 3],
            velocity: [L::load(token, &motion.rolling_velocity); 3],
            per_step: blocks.per_step,
            was_at_limit: L::mask(token, response.rolls),
            touching: L::load(token, &motion.overlap).greater(zero),
        };
        let spring = resistance.turned(token, &rotation);
        let limit = resistance.arm * L::load(token, &response.normal);
        let slid = if C::CUTS_DAMPERS {
            spring.slide_together(token, limit)
        } else {
            SlidingForce::spring_alone(token, spring.elastic[0], spring.viscous[0], limit, 0.0)
        };
        slid.force[0].store(&mut response.rolling);
        response.rolls = slid.at_limit.bits();
        let elastic = slid.elastic[0].select(rotation.touching, zero);
        elastic.store(&mut history[place]);
        if BUDGET {
            parts::ROLLING.clear(response);
            let power = slid.viscous[0].select(rotation.touching, zero) * rotation.velocity[0];
            let work = SpringWork {
                stored: rotation.before,
                force_before: spring.force_before,
                increment: rotation.angle,
                compliance: resistance.compliance(token),
                limit,
                power,
                was_at_limit: rotation.was_at_limit,
            };
            if C::CUTS_DAMPERS {
                spring.count(token, &slid, &work, &parts::ROLLING, response);
            } else {
                spring.count_slider(token, &slid, &work, &parts::ROLLING, response);
                add_damping(token, response, power);
            }
        }
    }
}
