//! Contact laws: numbers in, numbers out.

pub mod lee_hurley;

/// ln x for finite x > 0. Whatever reaches the trajectory (pressure, time step, damping) takes its logarithms here,
/// so that there is one place that decides their last bit.
pub fn portable_ln(x: f64) -> f64 {
    x.ln()
}
