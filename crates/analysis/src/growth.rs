//! Growth rate ω_i and frequency ω_r of an oscillatory instability, fitted to its mean square
//! displacement (BO eqs 9 and 10, figure 3).

use std::fmt;

use nalgebra::{DMatrix, DVector};

use crate::moments::joint_moments;

/// ω_r and ω_i fitted to M(t) = e^(2ω_i t) (a + b cos 2ω_r t + c sin 2ω_r t), in the reciprocal
/// unit of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Growth {
    /// Growth rate ω_i.
    pub omega_i: f64,
    /// Frequency ω_r, or why the rows do not give it.
    pub omega_r: Result<f64, Unresolved>,
    /// Start of the fitted interval of time.
    pub from: f64,
    /// End of the fitted interval of time.
    pub to: f64,
    /// Decades by which M grows in the fitted interval.
    pub decades: f64,
}

/// Why ω_r does not follow from the rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Unresolved {
    /// Nothing tells how dense rows must be: the state has no complex pair.
    NoPair,
    /// Rows at too long intervals, or too few of them, while M grows.
    Rows {
        /// The longest interval that resolves the oscillation.
        longest: f64,
    },
    /// Fewer than three periods, or no single oscillation that explains M.
    NoOscillation,
}

impl fmt::Display for Unresolved {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoPair => write!(f, "no complex pair says how fast M oscillates"),
            Self::Rows { longest } => write!(
                f,
                "the growth has no {LEAST_ROWS} rows in a row at intervals of at most \
                 {longest:.3e} (a quarter of the period of M)"
            ),
            Self::NoOscillation => write!(f, "no single oscillation explains M"),
        }
    }
}

/// Least number of rows at equal intervals from which ω_r is fitted.
const LEAST_ROWS: usize = 64;
/// Least number of rows in a period of M, π/ω_r. Equal intervals alone do not tell an oscillation
/// from its alias; those above the limit of Nyquist, two rows, by a factor of two resolve pairs of
/// up to twice the frequency of the known one.
const LEAST_ROWS_PER_PERIOD: f64 = 4.0;
/// Least share of the variance of M e^(-2ω_i t) that the oscillation explains.
const LEAST_EXPLAINED: f64 = 0.5;
/// M must exceed its first values by this factor before the fit begins, so that the growing pair
/// dominates.
const ABOVE_NOISE: f64 = 1e3;

/// Fits the growth of M, `[L]`, at the times `[L]` in ascending order, as long as M is at most
/// `linear`, the limit of the linear regime.
///
/// ω_i is half the slope of ln M over the whole interval, fitted together with the oscillation if
/// that is known. ω_r comes from the last of the longest stretches of rows at the least equal
/// intervals, which must resolve the oscillation of a pair of frequency `pair`. Returns `None` if M
/// grows by less than a decade or fewer than three rows remain.
pub fn fit(time: &[f64], msd: &[f64], linear: f64, pair: Option<f64>) -> Option<Growth> {
    let early = msd.iter().filter(|m| **m > 0.0).take(20);
    let noise = early.fold(0.0, |a: f64, b| a.max(*b));
    let end = msd.iter().position(|m| *m > linear).unwrap_or(msd.len());
    let begin = msd[..end].iter().rposition(|m| *m < ABOVE_NOISE * noise);
    let begin = begin.map_or(0, |last| last + 1);
    let rows = begin..end;
    if rows.len() < 3 {
        return None;
    }
    let positive = rows.clone().filter(|&k| msd[k] > 0.0);
    let points: Vec<[f64; 2]> = positive.map(|k| [time[k], msd[k].ln()]).collect();
    let first = slope(&thinned(&points))?;
    let (from, to) = (time[begin], time[end - 1]);
    let decades = first * (to - from) / std::f64::consts::LN_10;
    if decades < 1.0 {
        return None;
    }
    let omega_r = resolving(&time[rows.clone()], pair).and_then(|dense| {
        let dense = begin + dense.start..begin + dense.end;
        frequency(&time[dense.clone()], &msd[dense], 0.5 * first).ok_or(Unresolved::NoOscillation)
    });
    let refined = (omega_r.ok()).and_then(|omega| slope_beside(&points, 2.0 * omega));
    Some(Growth {
        omega_i: 0.5 * refined.unwrap_or(first),
        omega_r,
        from,
        to,
        decades,
    })
}

/// Slope of the least-squares line fitted together with an oscillation of frequency `omega` and its
/// harmonics, which the logarithm of M generates.
fn slope_beside(points: &[[f64; 2]], omega: f64) -> Option<f64> {
    const HARMONICS: usize = 6;
    let start = points.first()?[0];
    let length = points.last()?[0] - start;
    let fit = LinearFit::new(points, 2 + 2 * HARMONICS, |t, column| {
        let t = t - start;
        match (column, column / 2) {
            (0, _) => 1.0,
            (1, _) => t / length,
            (even, n) if even % 2 == 0 => (n as f64 * omega * t).cos(),
            (_, n) => (n as f64 * omega * t).sin(),
        }
    })?;
    Some(fit.factors[1] / length)
}

/// A sum of functions fitted to points by least squares.
struct LinearFit {
    /// Values of the functions at the points, a column each.
    functions: DMatrix<f64>,
    /// Values of the points.
    values: DVector<f64>,
    /// Factors of the functions.
    factors: DVector<f64>,
}

impl LinearFit {
    /// Fits so many functions of a time, each with its number.
    fn new(
        points: &[[f64; 2]],
        count: usize,
        function: impl Fn(f64, usize) -> f64,
    ) -> Option<Self> {
        let functions = DMatrix::from_fn(points.len(), count, |k, column| {
            function(points[k][0], column)
        });
        let values = DVector::from_fn(points.len(), |k, _| points[k][1]);
        let normal = (functions.transpose() * &functions).cholesky()?;
        let factors = normal.solve(&(functions.transpose() * &values));
        Some(Self {
            functions,
            values,
            factors,
        })
    }

    /// Sum of the squared residuals.
    fn residual(self) -> f64 {
        (self.functions * self.factors - self.values).norm_squared()
    }
}

/// Averages of the points over 400 equal intervals, so that dense rows do not outweigh sparse ones.
fn thinned(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    const INTERVALS: f64 = 400.0;
    let [[first, _], .., [last, _]] = points else {
        return points.to_vec();
    };
    let parts = points.chunk_by(|a, b| {
        let [a, b] = [a, b].map(|point| ((point[0] - first) / (last - first) * INTERVALS).floor());
        a == b
    });
    parts.map(|part| joint_moments(part).0).collect()
}

/// Slope of the least-squares line.
fn slope(points: &[[f64; 2]]) -> Option<f64> {
    let (_, [spread, both]) = joint_moments(points);
    (spread > 0.0).then_some(both / spread)
}

/// The rows from which the frequency of M is read: the densest ones, if they resolve the
/// oscillation of a pair of this frequency.
fn resolving(time: &[f64], pair: Option<f64>) -> Result<std::ops::Range<usize>, Unresolved> {
    let Some(omega_r) = pair.filter(|omega_r| *omega_r > 0.0) else {
        return Err(Unresolved::NoPair);
    };
    let longest = std::f64::consts::PI / omega_r / LEAST_ROWS_PER_PERIOD;
    match densest(time) {
        Some(rows) if time[rows.start + 1] - time[rows.start] <= longest => Ok(rows),
        _ => Err(Unresolved::Rows { longest }),
    }
}

/// ω_r of rows at equal intervals.
fn frequency(time: &[f64], msd: &[f64], omega_i: f64) -> Option<f64> {
    let start = time[0];
    let values = time.iter().zip(msd);
    let values: Vec<[f64; 2]> = values
        .map(|(t, m)| [t - start, m * (-2.0 * omega_i * (t - start)).exp()])
        .collect();
    let mean = values.iter().map(|v| v[1]).sum::<f64>() / values.len() as f64;
    let pairs = values.windows(2);
    let rises: Vec<f64> = pairs
        .filter(|pair| pair[0][1] < mean && pair[1][1] >= mean)
        .map(|pair| pair[0][0])
        .collect();
    let (first, last) = (rises.first()?, rises.last()?);
    if rises.len() < 3 {
        return None;
    }
    let period = (last - first) / (rises.len() - 1) as f64;
    // M oscillates with 2ω_r. The count of periods is refined by the least residual of the linear
    // fit of a, b, c, within the uncertainty of the count.
    let counted = std::f64::consts::TAU / period;
    let margin = 0.5 * std::f64::consts::TAU / (last - first);
    let (mut low, mut high) = (counted - margin, counted + margin);
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    for _ in 0..60 {
        let [a, b] = [high - golden * (high - low), low + golden * (high - low)];
        if residual(&values, a) < residual(&values, b) {
            high = b;
        } else {
            low = a;
        }
    }
    let omega = 0.5 * (low + high);
    let squares: f64 = values.iter().map(|v| (v[1] - mean).powi(2)).sum();
    let explained = 1.0 - residual(&values, omega) / squares;
    (explained >= LEAST_EXPLAINED).then_some(0.5 * omega)
}

/// The longest stretch of rows at the least interval; of several the last, in which the growing
/// pair stands out most.
fn densest(time: &[f64]) -> Option<std::ops::Range<usize>> {
    let gaps: Vec<f64> = time.windows(2).map(|w| w[1] - w[0]).collect();
    let positive = gaps.iter().copied().filter(|gap| *gap > 0.0);
    let least = positive.fold(f64::INFINITY, f64::min);
    let (mut best, mut begin) = (0..0, 0);
    for (k, gap) in gaps.iter().enumerate() {
        if *gap > 1.001 * least {
            begin = k + 1;
        } else if k + 2 - begin >= best.len() {
            best = begin..k + 2;
        }
    }
    (best.len() >= LEAST_ROWS).then_some(best)
}

/// Sum of squared residuals of a + b cos ωt + c sin ωt.
fn residual(values: &[[f64; 2]], omega: f64) -> f64 {
    let fit = LinearFit::new(values, 3, |t, column| match column {
        0 => 1.0,
        1 => (omega * t).cos(),
        _ => (omega * t).sin(),
    });
    fit.map_or(f64::INFINITY, LinearFit::residual)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sparse rows with a dense stretch, as the runs record them.
    fn times(end: f64, period: f64) -> Vec<f64> {
        let dense = (0..320).map(|k| 0.6 * end + period / 16.0 * f64::from(k));
        let outside = |t: &f64| !(0.6 * end..0.6 * end + 20.0 * period).contains(t);
        let coarse = (0..2000)
            .map(|k| end * f64::from(k) / 2000.0)
            .filter(outside);
        let mut times: Vec<f64> = coarse.chain(dense).collect();
        times.sort_by(f64::total_cmp);
        times
    }

    #[test]
    fn growth_and_frequency_of_a_known_pair_come_back() {
        for (omega_r, omega_i) in [(0.3, 1e-4), (0.05, 2e-3), (1.7, 3e-5)] {
            let time = times(14.0 / omega_i, std::f64::consts::PI / omega_r);
            let of = |t: &f64| {
                let (phase, grown) = (2.0 * omega_r * t, 1e-26 * (2.0 * omega_i * t).exp());
                // Noise, then the linear regime, then the nonlinear plateau.
                (1e-25 + grown * (1.2 + (phase + 0.4).cos())).min(1e-14)
            };
            let msd: Vec<f64> = time.iter().map(of).collect();
            let growth = fit(&time, &msd, 9e-15, Some(omega_r)).unwrap();
            assert!((growth.omega_i / omega_i - 1.0).abs() < 3e-3, "{growth:?}");
            assert!(
                (growth.omega_r.unwrap() / omega_r - 1.0).abs() < 1e-3,
                "{growth:?}"
            );
            assert!(growth.decades > 6.0);
        }
    }

    /// M of a pair that grows from 1e-26, until it saturates at 1e-10 after `saturation`, in 1/ω_i.
    fn saturating(t: f64, omega_r: f64, omega_i: f64, saturation: f64) -> f64 {
        let grown = (2.0 * (omega_i * t).min(saturation) - 2.0 * saturation).exp() * 1e-10;
        1e-25 + grown * (1.2 + (2.0 * omega_r * t + 0.4).cos())
    }

    /// Rows that are dense only after the growth has ended, as older runs have them, alias the
    /// oscillation: its frequency is not known, its rate is.
    #[test]
    fn no_frequency_comes_from_rows_that_are_dense_after_saturation() {
        let (omega_r, omega_i) = (1.1113, 1e-3);
        let time = times(100.0 / omega_i, std::f64::consts::PI / omega_r);
        let msd: Vec<f64> = (time.iter())
            .map(|t| saturating(*t, omega_r, omega_i, 20.0))
            .collect();
        let growth = fit(&time, &msd, 1e-11, Some(omega_r)).unwrap();
        assert!(
            matches!(growth.omega_r, Err(Unresolved::Rows { .. })),
            "{growth:?}"
        );
        assert!((growth.omega_i / omega_i - 1.0).abs() < 0.02, "{growth:?}");
    }

    /// Equal intervals of less than two rows per period.
    #[test]
    fn no_frequency_comes_from_rows_below_nyquist() {
        let (omega_r, omega_i) = (0.3, 1e-4);
        let period = std::f64::consts::PI / omega_r;
        for rows_per_period in [0.9, 1.1, 1.9] {
            let time: Vec<f64> = (0..)
                .map(|k| period / rows_per_period * f64::from(k))
                .take_while(|t| *t < 20.0 / omega_i)
                .collect();
            let msd: Vec<f64> = (time.iter())
                .map(|t| saturating(*t, omega_r, omega_i, 20.0))
                .collect();
            for expected in [Some(omega_r), None] {
                let growth = fit(&time, &msd, 1e-11, expected).unwrap();
                assert!(growth.omega_r.is_err(), "{rows_per_period}: {growth:?}");
                assert!((growth.omega_i / omega_i - 1.0).abs() < 0.02, "{growth:?}");
            }
        }
    }

    /// Noise that no oscillation explains has no frequency.
    #[test]
    fn no_frequency_comes_from_noise() {
        let (omega_r, omega_i) = (0.3, 1e-4);
        let time = times(14.0 / omega_i, std::f64::consts::PI / omega_r);
        let mut state = 1_u64;
        let msd: Vec<f64> = (time.iter())
            .map(|t| {
                // Knuth's MMIX generator.
                state = state
                    .wrapping_mul(6364136223846793005)
                    .wrapping_add(1442695040888963407);
                let noise = (state >> 11) as f64 / (1_u64 << 53) as f64;
                1e-26 * (2.0 * omega_i * t).exp() * (0.5 + noise)
            })
            .collect();
        let growth = fit(&time, &msd, 1e-11, Some(omega_r)).unwrap();
        assert!(growth.omega_r.is_err(), "{growth:?}");
    }

    #[test]
    fn what_does_not_grow_is_not_fitted() {
        let time = times(100.0, 1.0);
        let msd: Vec<f64> = time.iter().map(|t| 1e-20 * (1.5 + t.sin())).collect();
        assert_eq!(fit(&time, &msd, 1.0, Some(0.5)), None);
    }
}
