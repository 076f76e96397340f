//! Damping constants from a coefficient of restitution.

use std::f64::consts::PI;

use super::keys::{DAMPING_RATIO, KeyReader, RESTITUTION, SLIDING_DAMPING};
use crate::contact::portable_ln;

/// α of a linear damper whose restitution is e: e = exp(-πα/√(1-α²)), 0 < e ≤ 1 (LH A4, A12).
pub fn damping_ratio(restitution: f64) -> f64 {
    let l = -portable_ln(restitution);
    l / (PI * PI + l * l).sqrt()
}

/// Reads α from `contact.damping_ratio` or `contact.restitution`.
pub(super) fn read_ratio(values: &mut dyn KeyReader) -> f64 {
    let chosen = values.exactly_one(
        &[&DAMPING_RATIO, &RESTITUTION],
        "the damping: damping_ratio (alpha), such as damping_ratio = 0.1, or restitution",
    );
    match (values.number(&DAMPING_RATIO), values.number(&RESTITUTION)) {
        (_, Some(e)) if chosen == 1 => damping_ratio(e),
        (alpha, _) => alpha.unwrap_or(0.0),
    }
}

/// Reads the share of the tangential damper that acts on sliding contacts; by default none does.
pub(super) fn read_sliding(values: &mut dyn KeyReader) -> f64 {
    let constant = SLIDING_DAMPING.default_number().unwrap_or(0.0);
    values.number(&SLIDING_DAMPING).unwrap_or(constant)
}

/// γ = 2α√(k m*) (kg/s) of two grains of mass m, for k_n and k_t.
pub(super) fn of_ratio(alpha: f64, mass: f64, stiffnesses: [f64; 2]) -> [f64; 2] {
    stiffnesses.map(|k| 2.0 * alpha * (0.5 * k * mass).sqrt())
}
