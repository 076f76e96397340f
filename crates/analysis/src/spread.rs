//! Mean, standard error and order statistics of one quantity over several runs.
//!
//! Own code because the running moments of statrs round differently from these sums, and would save
//! five lines.

/// Statistics of the values that are not NaN.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Mean; NaN without values.
    pub mean: f64,
    /// Standard error of the mean, s/√n with s² = Σ(x - x̄)²/(n - 1); NaN for fewer than two
    /// values.
    pub error: f64,
    /// Least value; NaN without values.
    pub least: f64,
    /// Median, of an even number the mean of the middle two; NaN without values.
    pub median: f64,
    /// Greatest value; NaN without values.
    pub greatest: f64,
    /// n: number of values that are not NaN.
    pub count: usize,
}

impl Spread {
    /// Computes the statistics of `values`, NaN left out.
    pub fn of(values: impl Iterator<Item = f64>) -> Self {
        let mut values: Vec<f64> = values.filter(|value| !value.is_nan()).collect();
        values.sort_unstable_by(f64::total_cmp);
        let count = values.len();
        let n = count as f64;
        let mean = values.iter().sum::<f64>() / n;
        let squares: f64 = values.iter().map(|x| (x - mean) * (x - mean)).sum();
        let at = |k: usize| values.get(k).copied().unwrap_or(f64::NAN);
        Spread {
            mean,
            error: match count {
                0 | 1 => f64::NAN,
                _ => (squares / (n - 1.0) / n).sqrt(),
            },
            least: at(0),
            median: 0.5 * (at(count.saturating_sub(1) / 2) + at(count / 2)),
            greatest: at(count.saturating_sub(1)),
            count,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_few_values() {
        let of = |values: &[f64]| Spread::of(values.iter().copied());
        let four = of(&[8.0, 2.0, f64::NAN, 4.0, 6.0]);
        assert_eq!((four.mean, four.median, four.count), (5.0, 5.0, 4));
        assert_eq!([four.least, four.greatest], [2.0, 8.0]);
        // s² = (9 + 1 + 1 + 9)/3.
        assert!((four.error - (20.0f64 / 12.0).sqrt()).abs() < 1e-15);
        let one = of(&[3.0]);
        assert_eq!((one.mean, one.median, one.count), (3.0, 3.0, 1));
        assert!(one.error.is_nan());
        let none = of(&[f64::NAN]);
        assert!(none.mean.is_nan() && none.median.is_nan() && none.greatest.is_nan());
        assert_eq!(of(&[1.0, 2.0, 4.0]).median, 2.0);
    }
}
