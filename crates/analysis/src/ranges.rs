//! Spearman correlations within ranges of one quantity, as in LH figures 9–11, 13, 22, 23 and 25.

use super::spearman::{Correlation, Spearman};

/// Width of the ranges of |Δτ|, |Δτ_p| and D²min.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Bins {
    /// Whole decades, as the thresholds in LH's text.
    #[default]
    Decades = 1,
    /// Half-decades.
    HalfDecades = 2,
}

/// log10 of the least |Δτ| in a range.
const LEAST: i32 = -5;
/// log10 of the |Δτ| at which the last decade begins. It is open: LH write Δτ_p < -1e-2.
const LAST: i32 = -2;

impl Bins {
    fn per_decade(self) -> i32 {
        self as i32
    }

    /// The edge with this number; 0 is 1.
    fn edge(self, number: i32) -> f64 {
        // Whole powers from a division of exact numbers, so that 1e-3 is the nearest number to it.
        let per_decade = self.per_decade();
        let whole = match number.div_euclid(per_decade) {
            power @ 0.. => 10f64.powi(power),
            power => 1.0 / 10f64.powi(-power),
        };
        match number.rem_euclid(per_decade) {
            0 => whole,
            _ => whole * 10f64.sqrt(),
        }
    }

    /// The number of the last edge that a positive value is not below.
    fn number(self, value: f64) -> i32 {
        let guess = (f64::from(self.per_decade()) * value.log10()).floor() as i32;
        // The logarithm of an edge may be rounded down.
        guess + i32::from(value >= self.edge(guess + 1))
    }

    fn range(self, number: i32) -> ValueRange {
        let [nearer, farther] = [number, number + 1].map(|k| self.edge(k));
        ValueRange { nearer, farther }
    }

    /// Returns the ranges of Δτ and Δτ_p: slip from the greatest to the least, then stick from the
    /// least to the greatest. |Δτ| begins at 1e-5; the last range is open.
    pub(crate) fn of_stress_changes(self) -> Vec<ValueRange> {
        let first = LEAST * self.per_decade();
        let last = (LAST + 1) * self.per_decade() - 1;
        let mut up: Vec<ValueRange> = (first..=last).map(|k| self.range(k)).collect();
        if let Some(last) = up.last_mut() {
            last.farther = f64::INFINITY;
        }
        let down = up.iter().rev().map(|range| ValueRange {
            nearer: -range.nearer,
            farther: -range.farther,
        });
        down.chain(up.iter().copied()).collect()
    }

    /// Returns the ranges that hold all positive finite `values`, at most the greatest 24 of them.
    /// Empty if no value is positive and finite.
    pub fn around(self, values: impl Iterator<Item = f64>) -> Vec<ValueRange> {
        let positive = values.filter(|v| v.is_finite() && *v > 0.0);
        let numbers: Vec<i32> = positive.map(|value| self.number(value)).collect();
        let (Some(&low), Some(&high)) = (numbers.iter().min(), numbers.iter().max()) else {
            return Vec::new();
        };
        (low.max(high - 23)..=high).map(|k| self.range(k)).collect()
    }
}

/// A range of values of one sign: `nearer` ≤ |value| < `farther` in absolute values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValueRange {
    /// End nearer to zero, included.
    pub nearer: f64,
    /// End farther from zero, excluded; infinite if the range is open.
    pub farther: f64,
}

impl ValueRange {
    /// Returns whether the value lies in the range. Zero and NaN lie in none.
    pub fn contains(&self, value: f64) -> bool {
        value.signum() == self.farther.signum()
            && value.is_finite()
            && value.abs() >= self.nearer.abs()
            && value.abs() < self.farther.abs()
    }
}

/// A pair of values and the value that decides which range it belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct KeyedPair {
    /// Value that selects the range.
    pub by: f64,
    /// The two values to correlate.
    pub pair: [f64; 2],
}

/// Returns Spearman's ρ and p of the pairs in each range.
pub(crate) fn correlations(
    rows: &[KeyedPair],
    ranges: &[ValueRange],
) -> Vec<(ValueRange, Correlation)> {
    let mut spearman = Spearman::default();
    let correlations = ranges.iter().map(|range| {
        let rows = rows.iter().filter(|row| range.contains(row.by));
        (*range, spearman.of(rows.map(|row| row.pair)))
    });
    correlations.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_meet_and_the_last_is_open() {
        for (bins, count) in [(Bins::Decades, 4), (Bins::HalfDecades, 8)] {
            let ranges = bins.of_stress_changes();
            assert_eq!(ranges.len(), 2 * count);
            for (down, up) in ranges[..count].iter().rev().zip(&ranges[count..]) {
                assert_eq!((-down.nearer, -down.farther), (up.nearer, up.farther));
            }
            let width = 4.0 / count as f64;
            for (k, range) in ranges[count..].iter().enumerate() {
                let from = -5.0 + width * k as f64;
                let off = range.nearer / 10f64.powf(from) - 1.0;
                assert!(off.abs() < 1e-14, "{range:?}");
                match ranges.get(count + k + 1) {
                    Some(next) => assert_eq!(range.farther, next.nearer),
                    None => assert_eq!(range.farther, f64::INFINITY),
                }
            }
        }
    }

    #[test]
    fn a_value_is_in_the_range_of_its_sign_that_begins_with_it() {
        let of = |value: f64| {
            [Bins::Decades, Bins::HalfDecades].map(|bins| {
                let ranges = bins.of_stress_changes().into_iter().enumerate();
                let holding = ranges.filter(|(_, range)| range.contains(value));
                holding.map(|(k, _)| k).collect::<Vec<usize>>()
            })
        };
        for (value, decade, half) in [
            (1e-5, 4, 8),
            (9e-5, 4, 9),
            (1e-4, 5, 10),
            (1e-3, 6, 12),
            (9.99e-3, 6, 13),
            (1e-2, 7, 14),
            (0.09, 7, 15),
            (0.1, 7, 15),
            (0.5, 7, 15),
        ] {
            assert_eq!(of(value), [[decade], [half]]);
            assert_eq!(of(-value), [[7 - decade], [15 - half]]);
        }
        for outside in [0.0, 9e-6, f64::NAN, f64::INFINITY, -f64::INFINITY] {
            assert_eq!(of(outside), [[0; 0]; 2], "{outside}");
        }
    }

    #[test]
    fn ranges_around_values_hold_all_of_them() {
        let values = [3e-7, 0.02, 1e-3, f64::NAN, 0.0, -1.0];
        for (bins, count) in [(Bins::Decades, 6), (Bins::HalfDecades, 11)] {
            let ranges = bins.around(values.into_iter());
            assert_eq!(ranges.len(), count);
            for value in &values[..3] {
                let holding = ranges.iter().filter(|range| range.contains(*value));
                assert_eq!(holding.count(), 1, "{value}");
            }
            assert!(bins.around([f64::NAN, 0.0].into_iter()).is_empty());
            // Every edge begins a range.
            for power in -30..30 {
                let edge = bins.edge(power);
                assert_eq!(bins.around([edge].into_iter())[0].nearer, edge);
            }
        }
    }

    #[test]
    fn only_the_rows_of_a_range_are_correlated() {
        // Decreasing in one range, increasing in another, and one row outside.
        let decreasing = [[2e-3, 3.0], [1.5e-3, 4.0], [1.1e-3, 9.0]];
        let others = [[0.02, 1.0], [0.03, 2.0], [0.5, 0.0]];
        let rows = [decreasing, others].concat().into_iter();
        let rows = rows.map(|pair| KeyedPair { by: pair[0], pair });
        let rows: Vec<KeyedPair> = rows.collect();
        let found = correlations(&rows, &Bins::HalfDecades.of_stress_changes());
        let [a, b] = [found[12].1, found[14].1];
        assert_eq!((a.rho, a.count, b.rho, b.count), (-1.0, 3, 1.0, 2));
        assert_eq!(found.iter().map(|(_, c)| c.count).sum::<usize>(), 6);
        // The last range, of one row.
        assert_eq!(found[15].1.count, 1);
    }
}
