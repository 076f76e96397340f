//! The parts that laws are made of: a spring and a damper along n; and a spring with a damper
//! parallel to it across n, or against a rotation, which a slider cuts to a limit. What they are to
//! K is in [`super::stiffness`].

use super::{Response, dissipation, norm, sum};
use crate::dimension::{Dimension, Three, Vector};
use crate::simd::{Lanes, Lanes16, Mask};

/// A spring and the damper parallel to it along n, which never pull.
pub struct NormalSpring<L: Lanes> {
    /// k_n (N/m; Pa in 2D).
    pub stiffness: L,
    /// γ_n (kg/s; kg/(m s) in 2D).
    pub damping: L,
    /// δ (m).
    pub overlap: L,
    /// v_n (m/s).
    pub velocity: L,
}

impl<L: Lanes> NormalSpring<L> {
    /// F_n = max(0, k_n δ - γ_n v_n).
    #[inline(always)]
    pub fn force(&self, token: L::Token) -> L {
        let damper = self.damping * self.velocity;
        self.stiffness
            .mul_add(self.overlap, -damper)
            .max(L::splat(token, 0.0))
    }

    /// The power (W; W/m in 2D) of what F_n, `force`, is less than the spring's part.
    #[inline(always)]
    pub fn dissipated_power(&self, token: L::Token, force: L) -> L {
        let zero = L::splat(token, 0.0);
        let power = self.stiffness.mul_add(self.overlap, -force) * self.velocity;
        power.select(self.overlap.greater(zero), zero)
    }
}

/// A spring and the damper parallel to it over a step, without a limit: forces or torques on i, of
/// one component, the first, or vectors in the tangent plane.
pub struct SpringAndDamper<L: Lanes> {
    /// Number of components: 1 or 3.
    pub components: usize,
    /// The spring's force before the step.
    pub before: Vector<L>,
    /// That of both before the step.
    pub force_before: Vector<L>,
    /// The spring's force.
    pub elastic: Vector<L>,
    /// The damper's, which is subtracted from it.
    pub viscous: Vector<L>,
    /// That of both.
    pub force: Vector<L>,
    /// Where a slider held them at the limit before the step.
    pub was_at_limit: L::Mask,
    /// Where the grains touch.
    pub touching: L::Mask,
}

/// A spring and the damper parallel to it under the limit of a slider in series.
pub struct SlidingForce<L: Lanes> {
    /// The spring's force; it is stored as the history.
    pub elastic: Vector<L>,
    /// The damper's, which is subtracted from it.
    pub viscous: Vector<L>,
    /// That of both.
    pub force: Vector<L>,
    /// Where they are at the limit.
    pub at_limit: L::Mask,
}

impl<L: Lanes> SlidingForce<L> {
    /// A spring that alone is cut to the limit, where `share` of its damper acts: their sum jumps
    /// there. Of one component.
    #[inline(always)]
    pub fn spring_alone(token: L::Token, elastic: L, viscous: L, limit: L, share: f64) -> Self {
        let at_limit = elastic.abs().greater(limit);
        let elastic = limit.copy_sign(elastic).select(at_limit, elastic);
        let viscous = at_share(token, viscous, share, at_limit);
        Self {
            elastic: [elastic; 3],
            viscous: [viscous; 3],
            force: [elastic - viscous; 3],
            at_limit,
        }
    }
}

impl<L: Lanes> SpringAndDamper<L> {
    /// Those of one component.
    #[inline(always)]
    pub fn scalar(
        before: L,
        elastic: L,
        viscous: L,
        was_at_limit: L::Mask,
        touching: L::Mask,
    ) -> Self {
        Self {
            components: 1,
            before: [before; 3],
            force_before: [before; 3],
            elastic: [elastic; 3],
            viscous: [viscous; 3],
            force: [elastic - viscous; 3],
            was_at_limit,
            touching,
        }
    }

    /// Where the sum of spring and damper exceeds a limit.
    #[inline(always)]
    pub fn exceeds(&self, limit: L) -> L::Mask {
        let is_beyond = if self.components == 1 {
            self.force[0].abs().greater(limit)
        } else {
            exceeds(&self.force, limit)
        };
        is_beyond.and(self.touching)
    }

    /// The sum of spring and damper is cut to the limit, and does not jump there: the spring is set
    /// back so that the two together give the limit.
    #[inline(always)]
    pub fn slide_together(&self, token: L::Token, limit: L) -> SlidingForce<L> {
        let mut slid = SlidingForce {
            elastic: self.elastic,
            viscous: self.viscous,
            force: self.force,
            at_limit: self.touching,
        };
        if self.components == 1 {
            let force = self.force[0];
            slid.at_limit = self.exceeds(limit);
            slid.force = [limit.copy_sign(force).select(slid.at_limit, force); 3];
        } else {
            slid.at_limit = self.exceeds(limit);
            if slid.at_limit.bits() == 0 {
                return slid;
            }
            slid.force = set_back(
                token,
                &self.force_before,
                &self.force,
                limit,
                self.was_at_limit,
                slid.at_limit,
            );
        }
        let elastic = sum(&slid.force, &self.viscous);
        for (k, set_back) in elastic.iter().enumerate().take(self.components) {
            slid.elastic[k] = set_back.select(slid.at_limit, self.elastic[k]);
        }
        slid
    }

    /// Counts what the slider dissipates: the work done on the spring that it does not store.
    #[inline(always)]
    pub fn count_slider(
        &self,
        token: L::Token,
        slid: &SlidingForce<L>,
        work: &SpringWork<L>,
        counts: &SliderCounts,
        response: &mut Response,
    ) {
        let (zero, half) = (L::splat(token, 0.0), L::splat(token, 0.5));
        let mut dissipated = zero;
        for k in 0..self.components {
            let stored = work.stored[k];
            let elastic = slid.elastic[k].select(self.touching, zero);
            let gained = (elastic - stored) * (elastic + stored) * work.compliance;
            let lost = (self.before[k] + elastic).mul_add(work.increment[k], gained);
            dissipated = (-half).mul_add(lost, dissipated);
        }
        add_dissipation(token, response, counts.slider, dissipated);
    }

    /// Counts what spring, damper and slider dissipate in a step in which they slide together.
    #[inline(always)]
    pub fn count(
        &self,
        token: L::Token,
        slid: &SlidingForce<L>,
        work: &SpringWork<L>,
        counts: &SliderCounts,
        response: &mut Response,
    ) {
        self.count_slider(token, slid, work, counts, response);
        let zero = L::splat(token, 0.0);
        let half_compliance = L::splat(token, 0.5) * work.compliance;
        let mut before = LimitedSpring::at(token, work.was_at_limit.and(self.touching));
        let mut after = LimitedSpring::at(token, self.touching);
        let mut square = zero;
        for k in 0..self.components {
            let force = slid.force[k];
            let elastic = slid.elastic[k].select(self.touching, zero);
            square = force.mul_add(force, square);
            before.add(half_compliance, self.before[k], work.force_before[k]);
            after.add(half_compliance, elastic, force);
        }
        // What is subtracted of a pair that has opened is of the kind of the last step.
        let reaches = reaches(token, slid.at_limit, square, work.limit).bits();
        let (touching, was_at_limit) = (self.touching.bits(), self.was_at_limit.bits());
        after.at_limit = L::mask(token, (reaches & touching) | (was_at_limit & !touching));
        let damper = CutDamper {
            power: work.power,
            before,
            after,
        };
        damper.count(token, response, counts);
    }
}

/// What the energy budget needs to know of a linear spring and its damper beside their forces.
pub struct SpringWork<L: Lanes> {
    /// The spring's force at the end of the last step, by the history.
    pub stored: Vector<L>,
    /// Spring and damper before the step, under their limit.
    pub force_before: Vector<L>,
    /// By how much the spring is stretched in the step (m or rad).
    pub increment: Vector<L>,
    /// 1/k.
    pub compliance: L,
    /// The limit.
    pub limit: L,
    /// The power of the damper beside the spring (W; W/m in 2D).
    pub power: L,
    /// Where the two were at the limit at the beginning of the step.
    pub was_at_limit: L::Mask,
}

/// The counts of [`dissipation`] for a slider.
pub struct SliderCounts {
    /// What it dissipates itself.
    slider: usize,
    /// The part of the damper that it cuts.
    cut: usize,
    /// The energy of the spring that it sets back.
    set_back: usize,
}

impl SliderCounts {
    /// Sets them to nothing.
    #[inline(always)]
    pub fn clear(&self, response: &mut Response) {
        for kind in [self.slider, self.cut, self.set_back] {
            response.dissipated[kind] = Lanes16::ZERO;
        }
    }
}

/// Those of friction.
pub const FRICTION: SliderCounts = SliderCounts {
    slider: dissipation::FRICTION,
    cut: dissipation::CUT_FRICTION,
    set_back: dissipation::SET_BACK_TANGENTIAL,
};

/// Those of rolling and twisting.
pub(crate) const ROLLING: SliderCounts = SliderCounts {
    slider: dissipation::ROLLING,
    cut: dissipation::CUT_ROLLING,
    set_back: dissipation::SET_BACK_ROLLING,
};

/// The damper's part, of which `share` acts at the limit. Without one, no sign of zero: forces have
/// the same bits as without a damper.
#[inline(always)]
fn at_share<L: Lanes>(token: L::Token, viscous: L, share: f64, at_limit: L::Mask) -> L {
    let acting = L::splat(token, share).mul_add(viscous, L::splat(token, 0.0));
    acting.select(at_limit, viscous)
}

/// Where a vector is longer than its limit.
#[inline(always)]
pub(crate) fn exceeds<L: Lanes>(v: &Vector<L>, limit: L) -> L::Mask {
    Three::dot(v, v).greater(limit * limit)
}

/// A tangential vector that would grow from `before` to `trial` in a step, set back to `limit`
/// where it is `at_limit`, where the limit is positive.
///
/// A contact that slides sets its spring back along the force, which turns towards the slip:
///
/// ```text
/// f = l m, |m| = 1,  l dm/dt = P v,  v Δt = trial - before,  P the projection perpendicular to m
/// ```
///
/// Where it was at the limit before the step (`slid`), it is set along trial + a before, with
///
/// ```text
/// a = ½ (½ (1 + l²/|before|²) - before·trial/|before|²)
/// ```
///
/// This turns as the solution to second order, as does the mean-normal return of plasticity (J. R.
/// Rice and D. M. Tracey, 1973; R. D. Krieg and D. B. Krieg, J. Press. Vess. Tech. 99, 510, 1977).
/// Elsewhere, in a step in which the sliding begins, or whose slip or change of limit is so great
/// that |a| > 1, it is set along `trial`, which turns to first order: such steps are few, and the
/// error of each is of second order.
#[inline(always)]
pub(crate) fn set_back<L: Lanes>(
    token: L::Token,
    before: &Vector<L>,
    trial: &Vector<L>,
    limit: L,
    slid: L::Mask,
    at_limit: L::Mask,
) -> Vector<L> {
    let c = |v| L::splat(token, v);
    let mut along = *trial;
    let turns = slid.and(at_limit);
    if turns.bits() != 0 {
        // |before|² times trial + a before: no division.
        let half = c(0.5);
        let square = Three::dot(before, before);
        let mean = half * limit.mul_add(limit, square);
        let share = half * (mean - Three::dot(before, trial));
        let turns = turns.and(square.greater(share.abs()));
        let (square, share) = (square.select(turns, c(1.0)), share.select(turns, c(0.0)));
        for k in 0..3 {
            along[k] = share.mul_add(before[k], square * trial[k]);
        }
    }
    let (_, per_length) = norm(token, &along);
    let part = limit * per_length;
    for k in 0..3 {
        along[k] = (part * along[k]).select(at_limit, trial[k]);
    }
    along
}

/// A spring under a limit at one end of a step, as the energy budget sees it.
pub(crate) struct LimitedSpring<L: Lanes> {
    /// Its energy (J; J/m in 2D).
    pub energy: L,
    /// The square of its damper's part less that of the force of both: positive where the damper
    /// alone is beyond the limit.
    pub beyond: L,
    /// Where the two are at the limit.
    pub at_limit: L::Mask,
}

impl<L: Lanes> LimitedSpring<L> {
    /// One without energy yet.
    #[inline(always)]
    pub fn at(token: L::Token, at_limit: L::Mask) -> Self {
        let zero = L::splat(token, 0.0);
        Self {
            energy: zero,
            beyond: zero,
            at_limit,
        }
    }

    /// Adds a component: of the spring's part, half of its compliance, and of the force.
    #[inline(always)]
    pub fn add(&mut self, half_compliance: L, spring: L, force: L) {
        self.energy = (half_compliance * spring).mul_add(spring, self.energy);
        let damper = spring - force;
        self.beyond = damper.mul_add(damper, (-force).mul_add(force, self.beyond));
    }

    /// Where the spring is set back for its damper: no work was done on it.
    #[inline(always)]
    pub(crate) fn is_set_back(&self, token: L::Token) -> L::Mask {
        self.beyond.greater(L::splat(token, 0.0)).and(self.at_limit)
    }
}

/// A damper that is cut to a limit together with its spring, as the energy budget sees it.
pub(crate) struct CutDamper<L: Lanes> {
    /// The power that it has beside its spring (W; W/m in 2D).
    pub power: L,
    /// The spring at the beginning of the step, where the pair touches at its end.
    pub before: LimitedSpring<L>,
    /// The spring at the end of the step.
    pub after: LimitedSpring<L>,
}

impl<L: Lanes> CutDamper<L> {
    /// Adds the counts of its slider.
    ///
    /// A spring that was set back and is at its limit no longer gives its energy back to the
    /// grains. Nothing stored it: the law gains it, and it counts as that.
    #[inline(always)]
    pub fn count(&self, token: L::Token, response: &mut Response, counts: &SliderCounts) {
        let zero = L::splat(token, 0.0);
        let at_limit = self.after.at_limit;
        add_damping(token, response, zero.select(at_limit, self.power));
        let power = self.power.select(at_limit, zero);
        add_dissipation(token, response, counts.cut, power);
        let is_set_back = self.after.is_set_back(token);
        let energy = self.after.energy.select(is_set_back, zero);
        add_dissipation(token, response, counts.set_back, energy);
        let gained = zero.select(is_set_back, self.before.energy);
        let gained = gained.select(self.before.is_set_back(token), zero);
        add_dissipation(token, response, counts.slider, gained);
        add_dissipation(token, response, dissipation::STIFFNESS, -gained);
    }
}

/// What a force at its limit may differ from it by rounding.
const ROUNDING: f64 = 1e-9;

/// Where a force is at its limit, or as great but for rounding, also of a limit of nothing: forces
/// that are computed again without a step between may be either. Takes the square of the force.
#[inline(always)]
pub(crate) fn reaches<L: Lanes>(
    token: L::Token,
    at_limit: L::Mask,
    square: L,
    limit: L,
) -> L::Mask {
    let is_below = (limit * limit * L::splat(token, 1.0 - ROUNDING)).greater(square);
    L::mask(token, at_limit.bits() | !is_below.bits())
}

/// Adds the power of a damper to [`dissipation::DAMPING`].
#[inline(always)]
pub(crate) fn add_damping<L: Lanes>(token: L::Token, response: &mut Response, power: L) {
    add_dissipation(token, response, dissipation::DAMPING, power);
}

/// Adds to a kind of dissipation.
#[inline(always)]
fn add_dissipation<L: Lanes>(token: L::Token, response: &mut Response, kind: usize, more: L) {
    let lanes = &mut response.dissipated[kind];
    (L::load(token, lanes) + more).store(lanes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Portable, PortableToken};

    fn c(v: f64) -> Portable {
        Portable::splat(PortableToken, v)
    }

    fn first(lanes: Portable) -> f64 {
        lanes.to_lanes16().0[0]
    }

    /// A spring and a damper that begin unloaded.
    fn loaded(
        components: usize,
        elastic: [f64; 3],
        viscous: [f64; 3],
    ) -> SpringAndDamper<Portable> {
        let force: [f64; 3] = std::array::from_fn(|k| elastic[k] - viscous[k]);
        SpringAndDamper {
            components,
            before: [c(0.0); 3],
            force_before: [c(0.0); 3],
            elastic: elastic.map(c),
            viscous: viscous.map(c),
            force: force.map(c),
            was_at_limit: 0,
            touching: u16::MAX,
        }
    }

    #[test]
    fn a_damper_acts_below_the_limit_and_its_share_at_it() {
        let limited = |trial: f64, viscous: f64, share: f64| {
            let slid =
                SlidingForce::spring_alone(PortableToken, c(trial), c(viscous), c(2.0), share);
            assert_eq!(
                first(slid.force[0]),
                first(slid.elastic[0]) - first(slid.viscous[0])
            );
            [slid.elastic[0], slid.viscous[0]].map(first)
        };
        for share in [0.0, 0.5, 1.0] {
            assert_eq!(limited(1.0, 0.5, share), [1.0, 0.5]);
            assert_eq!(limited(-4.0, 0.5, share), [-2.0, 0.5 * share]);
        }
        // No damper, no sign of zero: forces have the same bits as without one.
        assert_eq!(limited(4.0, -1.0, 0.0)[1].to_bits(), 0);
    }

    /// The sum and the spring of a trial under a limit of 2.
    fn sliding(components: usize, elastic: [f64; 3], viscous: [f64; 3]) -> ([f64; 3], [f64; 3]) {
        let step = loaded(components, elastic, viscous);
        let slid = step.slide_together(PortableToken, c(2.0));
        (slid.force.map(first), slid.elastic.map(first))
    }

    /// Spring and damper are cut together: the force does not jump where the sliding begins, and
    /// the spring gives what the damper leaves of the limit.
    #[test]
    fn spring_and_damper_are_cut_together() {
        for n in [1, 3] {
            let (force, spring) = sliding(n, [1.0, 0.0, 0.0], [-0.75, 0.0, 0.0]);
            assert_eq!((force[0], spring[0]), (1.75, 1.0));
            for beyond in [1e-9, 1.0, 10.0] {
                let (force, spring) = sliding(n, [1.25 + beyond, 0.0, 0.0], [-0.75, 0.0, 0.0]);
                assert!((force[0] - 2.0).abs() < 1e-15, "{force:?}");
                assert!((spring[0] - 1.25).abs() < 1e-15, "{spring:?}");
            }
            // The damper alone is beyond the limit: the spring pulls back.
            let (force, spring) = sliding(n, [0.0; 3], [-5.0, 0.0, 0.0]);
            assert!((force[0] - 2.0).abs() < 1e-15 && (spring[0] + 3.0).abs() < 1e-15);
        }
        let (force, spring) = sliding(3, [3.0, 0.0, 0.0], [0.0, -4.0, 0.0]);
        let close = |a: [f64; 3], b: [f64; 3]| (0..3).all(|k| (a[k] - b[k]).abs() < 1e-14);
        assert!(close(force, [1.2, 1.6, 0.0]) && close(spring, [1.2, -2.4, 0.0]));
    }
}
