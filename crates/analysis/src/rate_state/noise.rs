//! Standard errors of means of correlated values.

use crate::moments::Moments;

/// Variance and autocorrelation of a series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Autocorrelation {
    /// γ_0: mean square.
    pub variance: f64,
    /// Statistical inefficiency g = 1 + 2 Σ ρ_l ≥ 1: n values are worth n/g independent ones.
    pub inefficiency: f64,
    /// W: last lag of the sum.
    pub window: usize,
}

impl Autocorrelation {
    /// Returns γ_0 g, which is n times the variance of the mean of n values.
    pub fn spectral_variance(&self) -> f64 {
        self.variance * self.inefficiency
    }
}

/// Returns the autocorrelation of values at equal intervals whose true mean is zero, such as the
/// residuals of a fit.
///
/// The sum over ρ ends at the first lag that is at least 5 g/2 (Sokal 1997, eq. 3.19), or at half
/// the number of values.
pub fn correlation(values: &[f64]) -> Autocorrelation {
    let n = values.len();
    let product =
        |lag: usize| -> f64 { values.iter().zip(&values[lag..]).map(|(a, b)| a * b).sum() };
    let square = product(0);
    let (mut inefficiency, mut window) = (1.0, 0);
    if square > 0.0 {
        for lag in 1..n / 2 {
            inefficiency += 2.0 * product(lag) / square;
            window = lag;
            if lag as f64 >= 2.5 * inefficiency {
                break;
            }
        }
    }
    Autocorrelation {
        variance: square / n.max(1) as f64,
        inefficiency: inefficiency.clamp(1.0, n.max(1) as f64),
        window,
    }
}

/// Least number of blocks from whose scatter the error of the mean is taken.
const FEWEST_BLOCKS: usize = 4;

/// Returns the standard error of the mean of correlated values at equal intervals, by block
/// averaging (Flyvbjerg & Petersen 1989).
///
/// The block length B is the least power of two with B³ > 2n (e_B/e_1)⁴, e_B being the error from
/// blocks of length B (Lee et al. 2011, PRE 83, 066706), or the longest one that leaves four
/// blocks. NaN for fewer than four values.
pub fn block_error(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    let mut blocks = values.to_vec();
    let (mut length, mut first, mut error) = (1.0, f64::NAN, f64::NAN);
    while blocks.len() >= FEWEST_BLOCKS {
        error = Moments::of(&blocks).error();
        if length == 1.0 {
            first = error;
        }
        let ratio: f64 = error / first;
        // The ratio is NaN if all values are equal; their error is 0 at any block length.
        if ratio.is_nan() || f64::powi(length, 3) > 2.0 * n * ratio.powi(4) {
            break;
        }
        blocks = blocks
            .chunks_exact(2)
            .map(|two| 0.5 * (two[0] + two[1]))
            .collect();
        length *= 2.0;
    }
    error
}
