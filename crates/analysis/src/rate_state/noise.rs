//! Autocorrelation of the residuals of a fit.

/// Variance and autocorrelation of a series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Autocorrelation {
    /// γ_0: mean square.
    pub variance: f64,
    /// Statistical inefficiency g = 1 + 2 Σ ρ_l ≥ 1: n values are worth n/g independent ones.
    pub inefficiency: f64,
    /// W: last lag of the sum.
    pub window: usize,
}

impl Autocorrelation {
    /// Returns γ_0 g, which is n times the variance of the mean of n values.
    pub(crate) fn spectral_variance(&self) -> f64 {
        self.variance * self.inefficiency
    }
}

/// Σ x_k x_(k+lag).
fn lagged_product(values: &[f64], lag: usize) -> f64 {
    let pairs = values.iter().zip(&values[lag..]);
    pairs.map(|(a, b)| a * b).sum()
}

/// Returns the autocorrelation of values at equal intervals whose true mean is zero, such as the
/// residuals of a fit.
///
/// The sum over ρ ends at the first lag that is at least 5 g/2 (Sokal 1997, eq. 3.19), or at half
/// the number of values.
pub(crate) fn correlation(values: &[f64]) -> Autocorrelation {
    let n = values.len();
    let square = lagged_product(values, 0);
    let (mut inefficiency, mut window) = (1.0, 0);
    if square > 0.0 {
        for lag in 1..n / 2 {
            inefficiency += 2.0 * lagged_product(values, lag) / square;
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
