//! What happened in a phase (LH equations 1 to 4): a function of τ and of the frames' scalars only.

use super::frame_scalars::FrameScalars;
use super::phases::{self, Phase};
use super::regions::MinPoints;

/// A phase with the measures that LH correlate with its Δτ_p. NaN where a scalar of the phase is undefined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    pub phase: Phase,
    /// mgD²min (m², equation 1): the greatest gD²min.
    pub dmin_max: f64,
    /// mg_t10%D²min (m², equation 2): the greatest g_t10%D²min.
    pub top_max: f64,
    /// sgD²min (m², equation 3): the sum of gD²min from t_s to the end.
    pub dmin_sum: f64,
    /// sg_t10%D²min (m², equation 4): the sum of g_t10%D²min from t_s to the end.
    pub top_sum: f64,
    /// N_c: the least number of GR regions.
    pub regions_least: f64,
    /// Mean and median |θ| (rad) in the GR regions at the last row with N_c regions.
    pub angle_mean: f64,
    pub angle_median: f64,
}

/// The phases of τ(γ), both [L], and their measures.
///
/// `scalars`: [L], row k between the rows k-1 and k; those of a phase are the rows `start` + 1 … `end`, one for each of its
/// intervals. t_s is the first of them with N_c regions.
pub fn of(
    strain: &[f64],
    tau: &[f64],
    scalars: &[FrameScalars],
    reading: MinPoints,
) -> Vec<Measured> {
    let phases = phases::find(strain, tau);
    let measured = phases
        .into_iter()
        .map(|phase| measure(phase, &scalars[phase.start + 1..=phase.end], reading));
    measured.collect()
}

fn measure(phase: Phase, scalars: &[FrameScalars], reading: MinPoints) -> Measured {
    let regions = || scalars.iter().map(|s| s.regions(reading));
    let regions_least = regions().fold(f64::INFINITY, least);
    let first = regions().position(|count| count == regions_least);
    let last = regions().rposition(|count| count == regions_least);
    let of_last = |of: fn(&FrameScalars) -> f64| last.map_or(f64::NAN, |k| of(&scalars[k]));
    let (one, top): (fn(&FrameScalars) -> f64, fn(&FrameScalars) -> f64) =
        (|s| s.dmin_greatest, |s| s.dmin_top_tenth);
    let max = |of: fn(&FrameScalars) -> f64| {
        let values = scalars.iter().map(of);
        values.fold(f64::NEG_INFINITY, |a, b| -least(-a, -b))
    };
    let sum = |of: fn(&FrameScalars) -> f64| {
        first.map_or(f64::NAN, |first| scalars[first..].iter().map(of).sum())
    };
    Measured {
        phase,
        dmin_max: max(one),
        top_max: max(top),
        dmin_sum: sum(one),
        top_sum: sum(top),
        regions_least,
        angle_mean: of_last(|s| s.region_angle_mean),
        angle_median: of_last(|s| s.region_angle_median),
    }
}

/// The lesser of two numbers, NaN where either is: `f64::min` would pass over it.
fn least(a: f64, b: f64) -> f64 {
    if a.is_nan() || a < b { a } else { b }
}
