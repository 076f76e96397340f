//! Means over the time of a run, with standard errors of correlated rows.

use crate::moments::Moments;

/// A column of the time series that is the ratio of two others, either of which may pass zero. Its
/// mean is the ratio of their means: in the mean of the rows' ratios one row with a denominator
/// near zero outweighs all others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RatioColumn {
    /// Name of the ratio.
    pub ratio: &'static str,
    /// What is divided.
    pub numerator: &'static str,
    /// By what it is divided.
    pub denominator: &'static str,
}

/// The ratios among the columns that runs write.
pub const RATIO_COLUMNS: [RatioColumn; 1] = [RatioColumn {
    ratio: "stress_ratio",
    numerator: "shear_force",
    denominator: "normal_force",
}];

/// Mean over time of a quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeMean {
    /// The mean; NaN without rows.
    pub mean: f64,
    /// Standard error of the mean, which knows that rows are correlated; NaN with fewer than four
    /// rows.
    pub error: f64,
    /// Standard deviation of the quantity over time; of a ratio S/N that of (S - τN)/⟨N⟩ with
    /// τ = ⟨S⟩/⟨N⟩, which is that of S/N if N fluctuates little, and finite if N passes zero.
    pub deviation: f64,
}

impl TimeMean {
    /// A quantity of which one value is known, but not how it varies.
    pub fn of_one(mean: f64) -> Self {
        Self {
            mean,
            error: f64::NAN,
            deviation: f64::NAN,
        }
    }

    /// Mean of values. `weights`: of the rows, as from [`durations`]. Rows that are not finite do
    /// not count.
    pub fn of(values: &[f64], weights: &[f64]) -> Self {
        Self::of_ratio(values, &vec![1.0; values.len()], weights)
    }

    /// ⟨S⟩/⟨N⟩ of a numerator S and a denominator N, rows in the order of time. `weights`: of the
    /// rows, as from [`durations`]. Rows in which one of them is not finite do not count.
    ///
    /// The error is that of the mean of the linearised residuals (S - τN)/⟨N⟩, by
    /// `block_error`: to first order those of a ratio of means (Cochran, *Sampling Techniques*,
    /// 1977, section 6.3).
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn of_ratio(numerator: &[f64], denominator: &[f64], weights: &[f64]) -> Self {
        assert!(numerator.len() == denominator.len() && numerator.len() == weights.len());
        let rows = numerator.iter().zip(denominator).zip(weights);
        let rows: Vec<[f64; 3]> = rows
            .map(|((s, n), w)| [*s, *n, *w])
            .filter(|row| row.iter().all(|value| value.is_finite()))
            .collect();
        let shear: f64 = rows.iter().map(|[s, _, w]| w * s).sum();
        let normal: f64 = rows.iter().map(|[_, n, w]| w * n).sum();
        let time: f64 = rows.iter().map(|[.., w]| *w).sum();
        let count = rows.len() as f64;
        let mean = shear / normal;
        let scale = count / normal;
        let residuals: Vec<f64> = (rows.iter())
            .map(|[s, n, w]| w * (s - mean * n) * scale)
            .collect();
        let squares = (rows.iter()).map(|[s, n, w]| w * (s - mean * n) * (s - mean * n));
        Self {
            mean,
            error: block_error(&residuals),
            deviation: (squares.sum::<f64>() / time).sqrt() * (time / normal).abs(),
        }
    }
}

/// Intervals that differ by less than this share are equal.
const EQUAL: f64 = 1e-6;

/// Returns the weights of the rows from `first` on in a mean over time: the time from the row
/// before, of row 0 that to the next one. 1 for every row if these are equal. `time`: `[L]`, in any
/// unit.
pub fn durations(time: &[f64], first: usize) -> Vec<f64> {
    let rows = first..time.len();
    let intervals = rows.map(|row| match row {
        0 if time.len() > 1 => (time[1] - time[0]).abs(),
        0 => 1.0,
        row => (time[row] - time[row - 1]).abs(),
    });
    let intervals: Vec<f64> = intervals.collect();
    let mean = intervals.iter().sum::<f64>() / intervals.len() as f64;
    let mut deviations = intervals.iter().map(|interval| (interval - mean).abs());
    if mean.is_nan() || mean <= 0.0 || deviations.all(|by| by <= EQUAL * mean) {
        return vec![1.0; intervals.len()];
    }
    intervals
}

/// Least number of blocks from whose scatter the error of the mean is taken.
const FEWEST_BLOCKS: usize = 4;

/// Returns the standard error of the mean of correlated values at equal intervals, by block
/// averaging (Flyvbjerg & Petersen 1989).
///
/// The block length B is the least power of two with B³ > 2n (e_B/e_1)⁴, e_B being the error from
/// blocks of length B (Lee et al. 2011, PRE 83, 066706), or the longest one that leaves four
/// blocks. NaN for fewer than four values.
pub(crate) fn block_error(values: &[f64]) -> f64 {
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// One row with N near zero, whose S/N is -1e6, does not move ⟨S⟩/⟨N⟩.
    #[test]
    fn a_ratio_is_that_of_the_means() {
        let (shear, normal) = ([1.0, 2.0, 3.0, 2.0, 1.0], [2.0, 4.0, 6.0, 4.0, -1e-6]);
        let found = TimeMean::of_ratio(&shear, &normal, &[1.0; 5]);
        assert_eq!(found.mean, 9.0 / (16.0 - 1e-6));
        // Of values and of unequal rows.
        let of_values = TimeMean::of(&[1.0, 4.0, f64::NAN], &[3.0, 1.0, 9.0]);
        assert_eq!(
            (of_values.mean, of_values.deviation),
            (1.75, (27.0_f64 / 16.0).sqrt())
        );
        assert!(TimeMean::of(&[], &[]).mean.is_nan());
        // A constant ratio is exact, whatever N does.
        let half = normal.map(|n| 0.5 * n);
        let exact = TimeMean::of_ratio(&half, &normal, &[1.0, 2.0, 0.5, 7.0, 1.0]);
        assert_eq!((exact.mean, exact.error, exact.deviation), (0.5, 0.0, 0.0));
    }

    #[test]
    fn rows_weigh_by_the_time_that_they_stand_for() {
        assert_eq!(durations(&[0.0, 1.0, 2.0, 3.0], 1), [1.0; 3]);
        assert_eq!(durations(&[0.0, 0.1, 0.2, 0.3], 0), [1.0; 4]);
        assert_eq!(durations(&[0.0, 1.0, 3.0], 0), [1.0, 1.0, 2.0]);
        assert_eq!(durations(&[0.0, 1.0, 3.0], 2), [1.0]);
        assert_eq!(durations(&[5.0], 0), [1.0]);
        assert_eq!(durations(&[], 0), [0.0; 0]);
    }

    /// A series x' = ρx + noise and one of N about 1 that is correlated with it. The errors are
    /// those with which the ratios of many such runs scatter.
    #[test]
    fn errors_are_the_scatter_of_repetitions() {
        let (runs, rows, memory) = (300, 4096, 0.9);
        let (mut ratios, mut squares) = (Vec::new(), 0.0);
        for seed in 0..runs {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let mut uniform = || random.random::<f64>() - 0.5;
            let (mut x, mut y) = (0.0, 0.0);
            let (mut shear, mut normal) = (Vec::new(), Vec::new());
            for _ in 0..rows {
                x = memory * x + uniform();
                y = memory * y + uniform();
                normal.push(1.0 + 0.3 * x);
                shear.push(0.4 * (1.0 + 0.3 * x) + 0.2 * y + 0.1 * x);
            }
            let found = TimeMean::of_ratio(&shear, &normal, &vec![1.0; rows]);
            ratios.push(found.mean);
            squares += found.error * found.error / runs as f64;
        }
        let scatter = Moments::of(&ratios).deviation();
        // To first order the scatter of a sum of two such series: σ² = 1/12/(1 - ρ)²/n each.
        let expected = (0.05 / 12.0 / (1.0 - memory).powi(2) / rows as f64).sqrt();
        assert!(
            (scatter / expected - 1.0).abs() < 0.1,
            "{scatter} {expected}"
        );
        let error = squares.sqrt();
        assert!((error / expected - 1.0).abs() < 0.1, "{error} {expected}");
    }
}
