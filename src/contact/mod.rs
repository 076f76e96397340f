//! Contact laws: numbers in, numbers out. One law, one file; the loop over contacts is in `kernel`.

pub mod family;
pub mod hooke;
pub mod lee_hurley;

use crate::simd::{Lanes, Portable, PortableToken, Row, ln};

/// How eight pairs of grains move, i before j, n from j to i, t̂ = ẑ × n (physics.md, conventions). SI units.
#[derive(Clone, Copy)]
pub struct Motion<L> {
    /// δ (m), positive where the pair touches.
    pub overlap: L,
    /// v_n of the full step, positive where the pair separates (m/s).
    pub normal_velocity: L,
    /// v_t of the full step (m/s).
    pub tangential_velocity: L,
    /// v_t(t + ½Δt) Δt (m).
    pub tangential_increment: L,
    /// ω_i - ω_j of the full step (rad/s).
    pub rolling_velocity: L,
    /// (ω_i - ω_j)(t + ½Δt) Δt (rad).
    pub rolling_increment: L,
}

/// What the contact does to grain i. Forces per unit depth (N/m) in 2D.
#[derive(Clone, Copy)]
pub struct Response<L: Lanes> {
    /// F_n ≥ 0 along n.
    pub normal: L,
    /// F_t along t̂.
    pub tangential: L,
    /// Rolling torque about z.
    pub rolling: L,
    /// At the Coulomb limit.
    pub sliding: L::Mask,
    /// Overlap outside the law.
    pub beyond: L::Mask,
}

/// A contact law, as the kernel drives it.
pub trait ContactLaw: Copy + Send + Sync {
    /// Numbers per pair that depend on the grains alone.
    const PARAMETERS: usize;
    /// Numbers per contact that it remembers from step to step; 0 where the grains do not touch.
    const HISTORY: usize;
    /// Whether forces other than F_n can arise.
    const FRICTION: bool;
    const ROLLING: bool;

    /// The parameters of a pair of radii r_i, r_j (m).
    fn parameters(&self, r_i: f64, r_j: f64, out: &mut [f64]);

    /// Eight contacts. `history` is what they remember and is replaced, by zeros where not `touching`;
    /// what is returned where not `touching` is arbitrary.
    fn evaluate<L: Lanes>(
        &self,
        token: L::Token,
        parameters: &[Row],
        history: &mut [Row],
        motion: Motion<L>,
        touching: L::Mask,
    ) -> Response<L>;

    /// The history as [`crate::state::ContactState`] holds it, whichever parts this law has.
    fn history_to_state(history: [f64; 3]) -> [f64; 3];
    /// The reverse of [`ContactLaw::history_to_state`].
    fn history_from_state(state: [f64; 3]) -> [f64; 3];
}

/// Natural logarithm of a positive normal number, the same on every platform.
pub fn portable_ln(x: f64) -> f64 {
    scalar(|token| ln::<Portable>(token, Portable::splat(token, x)))
}

/// A portable computation on one number.
pub(crate) fn scalar(f: impl FnOnce(PortableToken) -> Portable) -> f64 {
    let mut out = Row::ZERO;
    f(PortableToken).store(&mut out);
    out.0[0]
}
