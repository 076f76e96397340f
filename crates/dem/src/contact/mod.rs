//! The interface of contact laws: numbers in, numbers out. The laws are in [`crate::laws`], the
//! loop over the contacts in [`crate::kernel`].

pub mod adhesion;
pub mod friction;
pub mod model;
pub mod parts;
pub mod stiffness;

use crate::dimension::{Dimension, Three, Vector, scaled_sum};
use crate::simd::{Lanes, Lanes16, Mask, Portable, PortableToken, inverse_sqrt, ln};

/// Relative motion of sixteen pairs of grains, of i with respect to j; n points from j to i. SI
/// units.
///
/// Tangential vectors have one component in two dimensions, along t̂ = ẑ × n, and in three
/// dimensions the three of a vector in the tangent plane.
#[derive(Debug, Default, Clone, Copy)]
pub struct PairMotion {
    /// δ (m), positive where the pair touches.
    pub overlap: Lanes16,
    /// v_n of the full step, positive where the pair separates (m/s).
    pub normal_velocity: Lanes16,
    /// By how much the overlap was greater a step ago (m): v_n(t + ½Δt) Δt, set with an energy
    /// budget only, or to rounding if the law has [`ContactLaw::NEEDS_LAST_OVERLAP`].
    pub normal_increment: Lanes16,
    /// v_t of the full step (m/s).
    pub tangential_velocity: Vector<Lanes16>,
    /// v_t(t + ½Δt) Δt (m), in the tangent plane of the full step.
    pub tangential_increment: Vector<Lanes16>,
    /// ω_i - ω_j of the full step (rad/s), of disks.
    pub rolling_velocity: Lanes16,
    /// (ω_i - ω_j)(t + ½Δt) Δt (rad), of disks.
    pub rolling_increment: Lanes16,
}

/// Rotation of sixteen pairs of spheres against each other, and the torques on i that resist it:
/// each a vector in the tangent plane and the component along n. Apart from [`PairMotion`], which
/// is smaller without it.
#[derive(Debug, Default, Clone, Copy)]
pub struct Turning {
    /// ω_i - ω_j of the full step (rad/s).
    pub velocity: [Lanes16; TORQUES],
    /// (ω_i - ω_j)(t + ½Δt) Δt (rad), of the components of the full step.
    pub increment: [Lanes16; TORQUES],
    /// The torque (N m).
    pub torque: [Lanes16; TORQUES],
}

/// Input and output of a law for some blocks of sixteen pairs.
///
/// A law processes the blocks in several loops with short chains of operations, and passes
/// intermediate results from loop to loop in `carry`. The processor then works on several blocks at
/// a time; in one long loop it would wait for each result.
pub struct Blocks<'a> {
    /// [`ContactLaw::PARAMETERS`] quantities per block.
    pub parameters: &'a [Lanes16],
    /// The histories, [`ContactLaw::HISTORY`] quantities per block, which the law updates; zeros in
    /// lanes that do not touch. With friction a tangential vector comes first, which in three
    /// dimensions has been rotated with the pair.
    pub history: &'a mut [Lanes16],
    /// The relative motion of the pairs.
    pub motion: &'a [PairMotion],
    /// The rotation of spheres that resist it, and its torques.
    pub turning: &'a mut [Turning],
    /// 1/Δt (1/s) in three dimensions, where contacts age, and where an energy budget counts
    /// dampers that are cut to a limit; 0 elsewhere, and if Δt is 0.
    pub per_step: f64,
    /// Intermediate results that one loop of a law passes to the next.
    pub carry: &'a mut [[Lanes16; CARRY]],
    /// Receives the forces.
    pub response: &'a mut [Response],
    /// Pairs whose contact begins or ends in this step with an [`adhesion`] that changes its area,
    /// for the torques of spheres: the motion of other pairs tells.
    pub jumps: &'a [Jump],
}

/// A pair whose forces jump in this step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jump {
    /// Its block among those that the law is given.
    pub block: usize,
    /// Its lane.
    pub lane: usize,
    /// By which the forces that jump are multiplied.
    pub factor: f64,
}

/// Kinds of dissipation: the indices of [`Response::dissipated`].
///
/// The part of each contact is what it does: a damper dissipates while it acts beside its spring,
/// and a slider what is left where it cuts the two to a limit.
pub mod dissipation {
    /// By dampers: the power at the end of the step (W; W/m in 2D). The other kinds are energies
    /// dissipated in the step (J; J/m in 2D).
    pub const DAMPING: usize = 0;
    /// By sliding.
    pub const FRICTION: usize = 1;
    /// By rolling at its limit.
    pub const ROLLING: usize = 2;
    /// By a change of stiffness under a constant force. Negative where a law gains energy: an
    /// incremental one, or one whose springs are set back against the force.
    pub const STIFFNESS: usize = 3;
    /// Number of kinds.
    pub const KINDS: usize = 4;
    /// A part of [`FRICTION`]: the power at the end of the step (W; W/m in 2D) that a damper would
    /// have beside a spring with which it is cut to the limit of friction.
    pub const CUT_FRICTION: usize = 4;
    /// The same of [`ROLLING`].
    pub const CUT_ROLLING: usize = 5;
    /// The energy (J; J/m in 2D) at the end of the step of springs that are set back against the
    /// force that they are part of, because their dampers alone exceed the limit. No work was done
    /// on them, so it is not elastic energy while they slide; once they stick it is, and
    /// [`STIFFNESS`] counts the gain.
    pub const SET_BACK_TANGENTIAL: usize = 6;
    /// The same of rolling and twisting.
    pub const SET_BACK_ROLLING: usize = 7;
    /// Number of the kinds and of what else is counted for them.
    pub const COUNTS: usize = 8;
}

/// Forces of sixteen contacts on grain i, per unit depth (N/m) in 2D; arbitrary where the pair does
/// not touch.
#[derive(Debug, Default, Clone, Copy)]
pub struct Response {
    /// F_n ≥ 0 along n.
    pub normal: Lanes16,
    /// F_t.
    pub tangential: Vector<Lanes16>,
    /// Rolling torque about z, of disks.
    pub rolling: Lanes16,
    /// Lanes at the Coulomb limit; before the law is evaluated those of the last step, where
    /// [`Blocks::per_step`] is set.
    pub sliding: u16,
    /// Lanes at the limit of rolling, likewise.
    pub rolls: u16,
    /// Lanes at the limit of twisting.
    pub twists: u16,
    /// Lanes with an overlap outside the law, set by the kernel where there is a
    /// [`ContactLaw::LARGEST_OVERLAP`].
    pub beyond: u16,
    /// Dissipation by [`dissipation`], if an energy budget is kept; also of contacts that have just
    /// opened, and 0 elsewhere.
    pub dissipated: [Lanes16; dissipation::COUNTS],
}

/// Elastic torques that resist the rolling and twisting of spheres: a vector in the tangent plane
/// and the component along n (N m).
pub const TORQUES: usize = 4;

/// The numbers that a contact may keep from step to step, in the layout of
/// [`crate::state::ContactState`]: its history, then its torques, then its age.
pub type History = [f64; AGE + 1];

/// The place of the age in a [`History`].
pub const AGE: usize = 3 + TORQUES;

/// Blocks that a law is given at once. On Zen 4, with AVX-512 and with AVX2, 2 to 8 are within 2 %
/// of each other.
pub const CHUNK: usize = 4;

/// Number of quantities that a loop of a law may pass to the next loop.
pub const CARRY: usize = 4;

/// A contact law, as the kernel calls it.
pub trait ContactLaw: Copy + std::fmt::Debug + Send + Sync + 'static {
    /// The dimension of the grains.
    type Space: Dimension;
    /// Numbers per pair that depend on the two grains alone.
    const PARAMETERS: usize;
    /// Numbers per contact that the law keeps from step to step; 0 where the grains do not touch.
    const HISTORY: usize;
    /// Their places in a [`History`]; at least as many.
    const HISTORY_PLACES: &'static [usize] = &[0, 1, 2, 3, 4, 5, 6];
    /// Whether the friction of its contacts depends on their age, for which it needs Δt.
    const AGES: bool = false;
    /// Unit in 3D of the history of F_t: that of its elastic part, or `m` of a displacement.
    const HISTORY_UNIT: &'static str = "N";
    /// Whether forces other than F_n can arise.
    const FRICTION: bool;
    /// Whether rolling torques can arise. In three dimensions their history is the last
    /// [`TORQUES`] numbers, and `FRICTION` is set.
    const ROLLING: bool;
    /// Whether dampers are cut to a limit together with their springs: then it sets the counts of
    /// [`dissipation`] after its kinds.
    const CUTS_DAMPERS: bool = false;
    /// Whether it needs the overlap of a step ago.
    const NEEDS_LAST_OVERLAP: bool = false;
    /// Whether the limits begin with a jump where two grains touch, as those of a linear damper.
    const LIMITS_JUMP: bool = false;
    /// The largest overlap within the law over the diameter of the smaller grain; infinite if the
    /// law itself sets [`Response::beyond`].
    const LARGEST_OVERLAP: f64 = f64::INFINITY;

    /// Computes the parameters of pairs of radii r_i, r_j (m), one [`Lanes16`] each.
    fn parameters<L: Lanes>(&self, token: L::Token, r_i: L, r_j: L, out: &mut [Lanes16]);

    /// The elastic F_n of two grains of this radius (m) at the largest overlap within the law, or
    /// half of that: from it follows the unit of the forces.
    fn largest_force(&self, radius: f64) -> f64;

    /// Computes the response of some blocks of contacts and updates their histories. Only laws that
    /// have tangential forces and torques set them. With `BUDGET`, also computes the dissipation.
    fn evaluate<L: Lanes, const BUDGET: bool>(&self, token: L::Token, blocks: &mut Blocks<'_>);

    /// Elastic energies (J; J/m in 2D) of sixteen contacts: normal, tangential, rolling. Arbitrary
    /// where the pair does not touch.
    fn elastic_energies<L: Lanes>(
        &self,
        token: L::Token,
        parameters: &[Lanes16],
        overlap: L,
        history: &[Lanes16],
    ) -> [L; 3];
}

/// The parameters of two grains of these radii (m), in their order.
pub fn parameters_of<C: ContactLaw>(law: &C, radii: [f64; 2]) -> Vec<f64> {
    let mut lanes = vec![Lanes16::ZERO; C::PARAMETERS];
    let [r_i, r_j] = radii.map(|r| Portable::splat(PortableToken, r));
    law.parameters(PortableToken, r_i, r_j, &mut lanes);
    lanes.iter().map(|lanes| lanes.0[0]).collect()
}

/// Lower bound of |v|²: vectors shorter than 1e-145 have an arbitrary direction.
const SMALLEST_SQUARE: f64 = 1e-290;

/// |v| and 1/|v|.
#[inline(always)]
pub(crate) fn norm<L: Lanes>(token: L::Token, v: &Vector<L>) -> (L, L) {
    let square = Three::dot(v, v).max(L::splat(token, SMALLEST_SQUARE));
    let per_length = inverse_sqrt(token, square);
    (square * per_length, per_length)
}

/// The radii of sixteen pairs; the second of a flat wall counts as 0.
#[derive(Debug, Clone, Copy)]
pub struct PairRadii<L> {
    /// R_i + R_j (m).
    pub sum: L,
    /// R_i (m).
    pub first: L,
}

impl<L: Lanes> PairRadii<L> {
    /// Of R_i + R_j and R_i, as in [`crate::state::Contacts::geometry`].
    #[inline(always)]
    pub fn load(token: L::Token, geometry: &[Lanes16; 2]) -> Self {
        Self {
            sum: L::load(token, &geometry[0]),
            first: L::load(token, &geometry[1]),
        }
    }

    /// Pairs of two grains.
    #[inline(always)]
    pub(crate) fn is_curved(&self) -> L::Mask {
        self.sum.abs().greater(self.first.abs())
    }

    /// R* (m); R_i at a flat wall.
    #[inline(always)]
    pub fn reduced(&self) -> L {
        let (sum, r_i) = (self.sum, self.first);
        (r_i * (sum - r_i) / sum).select(self.is_curved(), r_i)
    }

    /// The radius of the smaller grain (m): a flat wall is larger than any grain.
    #[inline(always)]
    pub fn smaller(&self) -> L {
        let (r_i, r_j) = (self.first, self.sum - self.first);
        r_j.select(r_i.greater(r_j).and(self.is_curved()), r_i)
    }
}

/// a + b.
#[inline(always)]
pub(crate) fn sum<L: Lanes>(a: &Vector<L>, b: &Vector<L>) -> Vector<L> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// a - b.
#[inline(always)]
pub(crate) fn difference<L: Lanes>(a: &Vector<L>, b: &Vector<L>) -> Vector<L> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// v at the beginning of a step, 2 v(t + ½Δt) - v to second order, from the way in the step; v if
/// Δt is 0.
#[inline(always)]
pub(crate) fn velocity_before<L: Lanes>(
    token: L::Token,
    per_step: f64,
    way: &Vector<L>,
    velocity: &Vector<L>,
) -> Vector<L> {
    let per_half_step = L::splat(token, 2.0 * per_step);
    let sign = L::splat(token, if per_step > 0.0 { -1.0 } else { 1.0 });
    scaled_sum(per_half_step, way, &scaled(velocity, sign))
}

/// A vector times a number.
#[inline(always)]
pub fn scaled<L: Lanes>(v: &Vector<L>, by: L) -> Vector<L> {
    [v[0] * by, v[1] * by, v[2] * by]
}

/// Loads a vector of `n` components; the others repeat the first.
#[inline(always)]
pub fn vector<L: Lanes>(token: L::Token, lanes: &[Lanes16], n: usize) -> Vector<L> {
    let mut v = [L::load(token, &lanes[0]); 3];
    for k in 1..n {
        v[k] = L::load(token, &lanes[k]);
    }
    v
}

#[inline(always)]
pub(crate) fn store_vector<L: Lanes>(v: &Vector<L>, lanes: &mut [Lanes16], n: usize) {
    for k in 0..n {
        v[k].store(&mut lanes[k]);
    }
}

/// Natural logarithm of a positive normal number, the same on every platform.
pub fn portable_ln(x: f64) -> f64 {
    scalar(|token| ln::<Portable>(token, Portable::splat(token, x)))
}

/// e^x of x ≤ 0, the same on every platform, to some (1 + |x|) ulps: the series of e^(x/2^k),
/// squared k times.
pub fn portable_exp(x: f64) -> f64 {
    if x < -700.0 {
        return 0.0;
    }
    let mut halvings = 0;
    let mut small = -x;
    while small > 0.125 {
        small *= 0.5;
        halvings += 1;
    }
    let mut sum = 1.0;
    for n in (1..=12).rev() {
        sum = 1.0 + small / f64::from(n) * sum;
    }
    (0..halvings).fold(1.0 / sum, |power, _| power * power)
}

/// A portable computation on one number.
pub fn scalar(f: impl FnOnce(PortableToken) -> Portable) -> f64 {
    f(PortableToken).to_lanes16().0[0]
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::simd::LANES;

    /// The response of two grains of these radii in a step, which updates their history. `motion`
    /// is in the order of [`PairMotion`], without the normal increment.
    pub(crate) fn response_of<C: ContactLaw>(
        law: &C,
        radii: [f64; 2],
        motion: [f64; 6],
        history: &mut [f64],
    ) -> Response {
        let lanes = |v| Lanes16([v; LANES]);
        let [r_i, r_j] = radii.map(|r| Portable::splat(PortableToken, r));
        let mut parameters = vec![Lanes16::ZERO; C::PARAMETERS];
        law.parameters(PortableToken, r_i, r_j, &mut parameters);
        let [overlap, v_n, v_t, slip, spin, rotation] = motion.map(lanes);
        let motion = PairMotion {
            overlap,
            normal_velocity: v_n,
            tangential_velocity: [v_t; 3],
            tangential_increment: [slip; 3],
            rolling_velocity: spin,
            rolling_increment: rotation,
            ..PairMotion::default()
        };
        let mut kept: Vec<_> = history.iter().map(|v| lanes(*v)).collect();
        let mut response = [Response::default()];
        law.evaluate::<Portable, false>(
            PortableToken,
            &mut Blocks {
                parameters: &parameters,
                history: &mut kept,
                per_step: 0.0,
                motion: &[motion],
                turning: &mut [],
                carry: &mut [[Lanes16::ZERO; CARRY]],
                response: &mut response,
                jumps: &[],
            },
        );
        for (number, lanes) in history.iter_mut().zip(kept) {
            *number = lanes.0[3];
        }
        response[0]
    }
}
