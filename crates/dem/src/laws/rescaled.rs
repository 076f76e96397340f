//! Hertzian spheres whose contacts remember the force of their tangential spring, not its
//! displacement: `tangential_history = "force"` of [`super::hertz`] and [`super::tsuji`].

use super::hertz::{Damper, Hertz, NO_AREA, RADIUS, ROOT};
use crate::contact::stiffness::{Derivatives, SpringForce, SpringState, Stiffness};
use crate::contact::{
    Blocks, ContactLaw, CutDamper, LimitedSpring, Sliding, Trial, difference, dissipation, norm,
    reaches, scaled, vector, velocity_before,
};
use crate::dimension::{Dimension, Three, scaled_sum};
use crate::simd::{Lanes, Lanes16, Mask, inverse, inverse_sqrt};

/// The law beside the F_n of Hertz.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rescaled<D: Damper> {
    normal: Hertz<false, D>,
}

impl<D: Damper> Rescaled<D> {
    /// The law with this F_n and the constants of its F_t.
    pub(super) fn new(normal: Hertz<false, D>) -> Self {
        Self { normal }
    }

    /// √(δR*) (m), of pairs that do not touch its lower bound.
    #[inline(always)]
    fn root<L: Lanes>(token: L::Token, overlap: L, radius: L) -> L {
        let square = (overlap * radius).max(L::splat(token, NO_AREA));
        square * inverse_sqrt(token, square)
    }
}

impl<D: Damper> ContactLaw for Rescaled<D> {
    type Space = Three;
    const PARAMETERS: usize = Hertz::<false, D>::PARAMETERS;
    const HISTORY: usize = 3;
    const FRICTION: bool = true;
    const ROLLING: bool = false;
    const CUTS_DAMPERS: bool = true;
    const NEEDS_LAST_OVERLAP: bool = true;
    const LARGEST_OVERLAP: f64 = Hertz::<false, D>::LARGEST_OVERLAP;

    #[inline(always)]
    fn parameters<L: Lanes>(&self, token: L::Token, r_i: L, r_j: L, out: &mut [Lanes16]) {
        self.normal.parameters(token, r_i, r_j, out);
    }

    fn largest_force(&self, radius: f64) -> f64 {
        self.normal.largest_force(radius)
    }

    #[inline(always)]
    fn evaluate<L: Lanes, const BUDGET: bool>(&self, token: L::Token, blocks: &mut Blocks<'_>) {
        self.normal.evaluate::<L, BUDGET>(token, blocks);
        let c = |v| L::splat(token, v);
        let load = |lanes: &Lanes16| L::load(token, lanes);
        let (zero, one, half) = (c(0.0), c(1.0), c(0.5));
        let law = &self.normal;
        let k_t = c(law.tangential_stiffness);
        let parameters = blocks.parameters.chunks_exact(Self::PARAMETERS);
        let kept = parameters.zip(blocks.history.chunks_exact_mut(3));
        let pairs = kept.zip(blocks.motion).zip(&*blocks.carry);
        for ((((p, history), motion), carry), response) in pairs.zip(&mut *blocks.response) {
            let overlap = load(&motion.overlap);
            let touching = overlap.greater(zero);
            let root = load(&carry[ROOT]);
            let last_overlap = overlap + load(&motion.normal_increment);
            let last_root = Self::root(token, last_overlap, load(&p[RADIUS]));
            let shrinks = last_root.greater(root);
            let rescaled = (root * inverse(token, last_root)).select(shrinks, one);
            // The mean of √δ over a step in which δ grows evenly, also from nothing.
            let sum = root + last_root;
            let squares = root.mul_add(root, last_root * sum);
            let mean = c(2.0 / 3.0) * squares * inverse(token, sum);
            let stiffness = k_t * root.select(shrinks, mean);
            let before = vector(token, history, 3);
            let slip = vector(token, &motion.tangential_increment, 3);
            let v_t = vector(token, &motion.tangential_velocity, 3);
            let damping = D::per_root(token, load(&p[super::hertz::DAMPING]), root);
            let gamma_t = c(law.tangential_damping) * damping * root;
            let kept = scaled(&before, rescaled);
            let trial = Trial {
                before: kept,
                elastic: scaled_sum(-stiffness, &slip, &kept),
                viscous: scaled(&v_t, gamma_t),
                viscous_before: scaled(
                    &velocity_before(token, blocks.per_step, &slip, &v_t),
                    gamma_t,
                ),
            };
            let limit = c(law.friction) * load(&response.normal);
            let slid = L::mask(token, response.sliding);
            let mut f = Sliding::vector(token, &trial, limit, slid, touching);
            if D::BOUNDS_SPRING && f.at_limit.bits() != 0 {
                let (speed, per_speed) = norm(token, &v_t);
                let bound = c(law.friction * law.normal_stiffness) * overlap * root;
                let damped = (gamma_t * speed).greater(limit + bound).and(f.at_limit);
                for (k, v) in v_t.iter().enumerate() {
                    let along = *v * per_speed;
                    f.force[k] = (-(limit * along)).select(damped, f.force[k]);
                    f.elastic[k] = (bound * along).select(damped, f.elastic[k]);
                }
            }
            response.sliding = f.at_limit.bits();
            let mut after = f.elastic;
            for k in 0..3 {
                f.force[k].store(&mut response.tangential[k]);
                after[k] = after[k].select(touching, zero);
                after[k].store(&mut history[k]);
            }
            if BUDGET {
                let half_compliance = half * c(1.0 / law.tangential_stiffness);
                let per_root = inverse(token, root);
                let energy = half_compliance * per_root * Three::dot(&after, &after);
                let stored = half_compliance * inverse(token, last_root);
                let stored = stored * Three::dot(&before, &before);
                let stored = stored.select(last_overlap.greater(zero), zero);
                let (mut work, mut lengths) = (zero, zero);
                for k in 0..3 {
                    work = (half * (before[k] + after[k])).mul_add(-slip[k], work);
                    let mean = half * (kept[k] + after[k]);
                    lengths = mean.mul_add(trial.elastic[k] - after[k], lengths);
                }
                let lost = work - (energy - stored);
                let viscous = difference(&f.elastic, &f.force);
                let damper_before = &trial.viscous_before;
                let force_before = difference(&before, damper_before);
                let square = Three::dot(&f.force, &f.force);
                let damper = CutDamper {
                    power: Three::dot(&viscous, &v_t).select(touching, zero),
                    before: LimitedSpring {
                        energy: stored,
                        beyond: Three::dot(damper_before, damper_before)
                            - Three::dot(&force_before, &force_before),
                        at_limit: slid.and(touching),
                    },
                    after: LimitedSpring {
                        energy,
                        beyond: Three::dot(&viscous, &viscous) - square,
                        at_limit: reaches(token, f.at_limit, square, limit).and(touching),
                    },
                };
                // A contact that opens has slid until F was 0.
                let friction = (lengths * inverse(token, stiffness)).select(f.at_limit, zero);
                let is_set_back = damper.after.is_set_back(token);
                let is_spring = L::mask(token, touching.bits() & !is_set_back.bits());
                let friction = friction.select(is_spring, lost);
                friction.store(&mut response.dissipated[dissipation::FRICTION]);
                (lost - friction).store(&mut response.dissipated[dissipation::STIFFNESS]);
                response.dissipated[dissipation::CUT_FRICTION] = Lanes16::ZERO;
                response.dissipated[dissipation::SET_BACK_TANGENTIAL] = Lanes16::ZERO;
                damper.count(token, response, false);
            }
        }
    }

    /// Normal as `hertz`. Tangential: ½ F²/(k_t √(δR*)).
    #[inline(always)]
    fn elastic_energies<L: Lanes>(
        &self,
        token: L::Token,
        parameters: &[Lanes16],
        overlap: L,
        history: &[Lanes16],
    ) -> [L; 3] {
        let [normal, _, rolling] = self
            .normal
            .elastic_energies(token, parameters, overlap, history);
        let root = Self::root(token, overlap, L::load(token, &parameters[RADIUS]));
        let half_compliance = L::splat(token, 0.5 / self.normal.tangential_stiffness);
        let force = vector(token, history, 3);
        let tangential = half_compliance * inverse(token, root) * Three::dot(&force, &force);
        [normal, tangential, rolling]
    }
}

/// F_t below the limit does not depend on δ while that grows.
impl<D: Damper> Stiffness for Rescaled<D> {
    fn derivatives(&self, state: &SpringState) -> Derivatives {
        let d = self.normal.derivatives(state);
        let (overlap, [r_i, r_j]) = (state.overlap, state.radii);
        let root = (overlap * r_i * r_j / (r_i + r_j)).sqrt();
        let k_t = self.normal.tangential_stiffness * root;
        let limit = d.limit(self.normal.friction);
        let [slides, ..] = state.limits;
        Derivatives {
            tangential: SpringForce::new(state.history, k_t, limit, slides),
            ..d
        }
    }
}
