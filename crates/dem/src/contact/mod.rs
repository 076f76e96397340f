//! The interface of contact laws: numbers in, numbers out. The laws are in [`crate::laws`], the loop over contacts in [`crate::kernel`].

pub mod model;
pub mod stiffness;

use crate::dimension::{Dimension, Three, Vector};
use crate::simd::{Lanes, Portable, PortableToken, Row, inverse_sqrt, ln};

/// How sixteen pairs of grains move, i before j, n from j to i (physics.md, conventions). SI units.
///
/// Tangential vectors have one component in two dimensions, along t̂ = ẑ × n, and in three those of a vector in the tangent plane.
#[derive(Debug, Clone, Copy)]
pub struct Motion {
    /// δ (m), positive where the pair touches.
    pub overlap: Row,
    /// v_n of the full step, positive where the pair separates (m/s).
    pub normal_velocity: Row,
    /// v_n(t + ½Δt) Δt (m); with an energy budget only.
    pub normal_increment: Row,
    /// v_t of the full step (m/s).
    pub tangential_velocity: Vector<Row>,
    /// v_t(t + ½Δt) Δt (m), in the tangent plane of the full step.
    pub tangential_increment: Vector<Row>,
    /// ω_i - ω_j of the full step (rad/s).
    pub rolling_velocity: Row,
    /// (ω_i - ω_j)(t + ½Δt) Δt (rad).
    pub rolling_increment: Row,
}

impl Motion {
    pub const ZERO: Self = Self {
        overlap: Row::ZERO,
        normal_velocity: Row::ZERO,
        normal_increment: Row::ZERO,
        tangential_velocity: [Row::ZERO; 3],
        tangential_increment: [Row::ZERO; 3],
        rolling_velocity: Row::ZERO,
        rolling_increment: Row::ZERO,
    };
}

/// What a law says of some blocks, and what it is told, a row or more per block.
///
/// A law works through the blocks in loops of short chains of operations, and keeps what is between them in `carry`: the
/// processor then has several blocks under way where one long loop would wait for each result.
pub struct Blocks<'a> {
    /// [`ContactLaw::PARAMETERS`] rows per block.
    pub parameters: &'a [Row],
    /// What the contacts remember, [`ContactLaw::HISTORY`] rows per block: replaced, by zeros where the pair does not touch. With
    /// friction a tangential vector comes first, which in three dimensions has been turned with n.
    pub history: &'a mut [Row],
    pub motion: &'a [Motion],
    pub carry: &'a mut [[Row; CARRY]],
    pub response: &'a mut [Response],
}

/// Kinds of dissipated energy: the rows of [`Response::dissipated`].
pub mod dissipation {
    /// By all dampers: the power at the end of the step (W/m). The others are energies of the whole
    /// step (J/m).
    pub const DAMPING: usize = 0;
    /// By sliding.
    pub const FRICTION: usize = 1;
    /// By rolling at its limit.
    pub const ROLLING: usize = 2;
    /// By the change of a stiffness under a constant force: what an incremental law loses or gains.
    pub const STIFFNESS: usize = 3;
    pub const KINDS: usize = 4;
}

/// What the contacts do to grain i; arbitrary where the pair does not touch. Forces per unit depth (N/m) in 2D.
#[derive(Debug, Clone, Copy)]
pub struct Response {
    /// F_n ≥ 0 along n.
    pub normal: Row,
    /// F_t.
    pub tangential: Vector<Row>,
    /// Rolling torque about z.
    pub rolling: Row,
    /// At the Coulomb limit.
    pub sliding: u16,
    /// Overlap outside the law.
    pub beyond: u16,
    /// Of the kinds of [`dissipation`], with an energy budget: also for contacts that have just
    /// opened, and 0 for pairs that do not touch.
    pub dissipated: [Row; dissipation::KINDS],
}

impl Response {
    pub const NONE: Self = Self {
        normal: Row::ZERO,
        tangential: [Row::ZERO; 3],
        rolling: Row::ZERO,
        sliding: 0,
        beyond: 0,
        dissipated: [Row::ZERO; dissipation::KINDS],
    };
}

/// Rows that a law may carry from one of its loops to the next.
pub const CARRY: usize = 4;

/// A contact law, as the kernel drives it.
pub trait ContactLaw: Copy + std::fmt::Debug + Send + Sync + 'static {
    type Space: Dimension;
    /// Numbers per pair that depend on the grains alone.
    const PARAMETERS: usize;
    /// Numbers per contact that it remembers from step to step; 0 where the grains do not touch.
    const HISTORY: usize;
    /// Whether forces other than F_n can arise.
    const FRICTION: bool;
    const ROLLING: bool;

    /// The parameters of pairs of radii r_i, r_j (m), a row each.
    fn parameters<L: Lanes>(&self, token: L::Token, r_i: L, r_j: L, out: &mut [Row]);

    /// F_n of two grains of this radius (m) at the end of the law.
    fn largest_force(&self, radius: f64) -> f64;

    /// The response of some blocks of contacts. Tangential forces and torques are filled in only by laws that have them.
    /// With `BUDGET` also the dissipated energies.
    fn evaluate<L: Lanes, const BUDGET: bool>(&self, token: L::Token, blocks: &mut Blocks<'_>);

    /// Elastic energies (J; J/m in 2D) of sixteen contacts: normal, tangential, rolling. Arbitrary where they do not touch.
    fn elastic_energies<L: Lanes>(
        &self,
        token: L::Token,
        parameters: &[Row],
        overlap: L,
        history: &[Row],
    ) -> [L; 3];

    /// The history as [`crate::state::ContactState`] holds it, whichever parts this law has.
    fn history_to_state(history: [f64; 3]) -> [f64; 3];
    /// The reverse of [`ContactLaw::history_to_state`].
    fn history_from_state(state: [f64; 3]) -> [f64; 3];
}

/// A spring's force or torque under a limit, beside a damper.
pub(crate) struct Limited<L: Lanes> {
    /// The spring's part: at the limit where it would be beyond, and to be remembered so.
    pub elastic: Vector<L>,
    /// The damper's, which acts below the limit only.
    pub viscous: Vector<L>,
    pub at_limit: L::Mask,
}

impl<L: Lanes> Limited<L> {
    /// `trial`: the spring's part without limit; `n` components of it and of the damper's are meant.
    #[inline(always)]
    pub fn new(token: L::Token, n: usize, trial: Vector<L>, limit: L, viscous: Vector<L>) -> Self {
        let zero = L::splat(token, 0.0);
        if n == 1 {
            let at_limit = trial[0].abs().greater(limit);
            return Self {
                elastic: [limit.copy_sign(trial[0]).select(at_limit, trial[0]); 3],
                viscous: [zero.select(at_limit, viscous[0]); 3],
                at_limit,
            };
        }
        let (length, per_length) = norm(token, &trial);
        let at_limit = length.greater(limit);
        let part = (limit * per_length).select(at_limit, L::splat(token, 1.0));
        Self {
            elastic: scaled(&trial, part),
            viscous: [
                zero.select(at_limit, viscous[0]),
                zero.select(at_limit, viscous[1]),
                zero.select(at_limit, viscous[2]),
            ],
            at_limit,
        }
    }
}

/// Square of what is so small that its direction does not matter.
const NEXT_TO_NOTHING: f64 = 1e-290;

/// |v| and 1/|v|.
#[inline(always)]
pub(crate) fn norm<L: Lanes>(token: L::Token, v: &Vector<L>) -> (L, L) {
    let square = Three::dot(v, v).max(L::splat(token, NEXT_TO_NOTHING));
    let per_length = inverse_sqrt(token, square);
    (square * per_length, per_length)
}

#[inline(always)]
pub(crate) fn scaled<L: Lanes>(v: &Vector<L>, by: L) -> Vector<L> {
    [v[0] * by, v[1] * by, v[2] * by]
}

/// The first `n` components from rows; in place of the others, the first.
#[inline(always)]
pub(crate) fn vector<L: Lanes>(token: L::Token, rows: &[Row], n: usize) -> Vector<L> {
    let mut v = [L::load(token, &rows[0]); 3];
    for k in 1..n {
        v[k] = L::load(token, &rows[k]);
    }
    v
}

#[inline(always)]
pub(crate) fn store_vector<L: Lanes>(v: &Vector<L>, rows: &mut [Row], n: usize) {
    for k in 0..n {
        v[k].store(&mut rows[k]);
    }
}

/// Adds the power that a damper takes to that of the others.
#[inline(always)]
pub(crate) fn add_damping<L: Lanes>(token: L::Token, response: &mut Response, power: L) {
    let row = &mut response.dissipated[dissipation::DAMPING];
    (L::load(token, row) + power).store(row);
}

/// Natural logarithm of a positive normal number, the same on every platform.
pub fn portable_ln(x: f64) -> f64 {
    scalar(|token| ln::<Portable>(token, Portable::splat(token, x)))
}

/// e^x of x ≤ 0, the same on every platform, to some (1 + |x|) ulps: the series of e^(x/2^k), squared k times.
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
pub(crate) fn scalar(f: impl FnOnce(PortableToken) -> Portable) -> f64 {
    let mut out = Row::ZERO;
    f(PortableToken).store(&mut out);
    out.0[0]
}
