//! Spearman correlations within ranges of one quantity, as in LH figures 9–11, 13, 22, 23 and 25.

use super::spearman::{Correlation, Spearman};

/// Edges of the half-decades of |Δτ|: 1e-5 to 1e-1.
const EDGES: [f64; 9] = [
    1e-5,
    3.1622776601683795e-5,
    1e-4,
    0.00031622776601683794,
    1e-3,
    0.0031622776601683794,
    1e-2,
    0.03162277660168379,
    1e-1,
];

/// A range of values of one sign: `nearer` ≤ |value| < `farther` in absolute values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValueRange {
    /// End nearer to zero, included.
    pub nearer: f64,
    /// End farther from zero, excluded.
    pub farther: f64,
}

impl ValueRange {
    /// Returns whether the value lies in the range. Zero and NaN lie in none.
    pub fn contains(&self, value: f64) -> bool {
        value.signum() == self.farther.signum()
            && value.abs() >= self.nearer.abs()
            && value.abs() < self.farther.abs()
    }

    /// Returns the middle of the range on a logarithmic axis.
    pub fn middle(&self) -> f64 {
        (self.nearer * self.farther).sqrt().copysign(self.farther)
    }
}

/// Returns the 16 half-decades of Δτ and Δτ_p: from -1e-1 to -1e-5, then from 1e-5 to 1e-1.
///
/// LH use whole decades, the last one open; half-decades that end at 0.1 are a choice of this code.
pub fn of_stress_changes() -> Vec<ValueRange> {
    let up = EDGES.windows(2).map(|edge| ValueRange {
        nearer: edge[0],
        farther: edge[1],
    });
    let down = up.clone().rev().map(|range| ValueRange {
        nearer: -range.nearer,
        farther: -range.farther,
    });
    down.chain(up).collect()
}

/// Returns the half-decades that hold all positive finite `values`, at most the greatest 24 of
/// them. Empty if no value is positive and finite.
pub fn around(values: impl Iterator<Item = f64>) -> Vec<ValueRange> {
    let halves = values
        .filter(|v| v.is_finite() && *v > 0.0)
        .map(|v| (2.0 * v.log10()).floor() as i32);
    let ends = halves.fold(None, |ends: Option<(i32, i32)>, k| {
        let (low, high) = ends.unwrap_or((k, k));
        Some((low.min(k), high.max(k)))
    });
    let Some((low, high)) = ends else {
        return Vec::new();
    };
    let edge = |k: i32| 10f64.powf(0.5 * f64::from(k));
    let range = |k: i32| ValueRange {
        nearer: edge(k),
        farther: edge(k + 1),
    };
    (low.max(high - 23)..=high).map(range).collect()
}

/// A pair of values and the value that decides which range it belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeyedPair {
    /// Value that selects the range.
    pub by: f64,
    /// The two values to correlate.
    pub pair: [f64; 2],
}

/// Returns Spearman's ρ and p of the pairs in each range.
pub fn correlations(rows: &[KeyedPair], ranges: &[ValueRange]) -> Vec<(ValueRange, Correlation)> {
    let mut spearman = Spearman::default();
    let within = |range: &ValueRange| {
        let rows = rows.iter().filter(|row| range.contains(row.by));
        (*range, spearman.of(rows.map(|row| row.pair)))
    };
    ranges.iter().map(within).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_decades_are_sixteen_and_meet() {
        let ranges = of_stress_changes();
        assert_eq!(ranges.len(), 16);
        for pair in ranges[..8].windows(2) {
            assert_eq!(pair[0].nearer, pair[1].farther);
        }
        for pair in ranges[8..].windows(2) {
            assert_eq!(pair[0].farther, pair[1].nearer);
        }
        for (k, range) in ranges[8..].iter().enumerate() {
            let wanted = 10f64.powf(-5.0 + 0.5 * k as f64);
            assert!((range.nearer / wanted - 1.0).abs() < 1e-14, "{range:?}");
        }
        assert_eq!((ranges[0].farther, ranges[15].farther), (-1e-1, 1e-1));
    }

    #[test]
    fn a_value_is_in_the_range_of_its_sign_that_begins_with_it() {
        let of = |value: f64| -> Vec<usize> {
            let ranges = of_stress_changes();
            (0..16).filter(|k| ranges[*k].contains(value)).collect()
        };
        assert_eq!(
            (of(1e-2), of(-1e-2), of(0.09), of(-0.09)),
            (vec![14], vec![1], vec![15], vec![0])
        );
        assert_eq!((of(1e-5), of(-1e-5)), (vec![8], vec![7]));
        for outside in [0.0, 9e-6, 0.1, -0.1, f64::NAN, f64::INFINITY] {
            assert_eq!(of(outside), [0; 0], "{outside}");
        }
    }

    #[test]
    fn ranges_around_values_hold_all_of_them() {
        let values = [3e-7, 0.02, f64::NAN, 0.0, -1.0];
        let ranges = around(values.into_iter());
        assert_eq!(ranges.len(), 11);
        for value in &values[..2] {
            assert_eq!(
                ranges.iter().filter(|range| range.contains(*value)).count(),
                1
            );
        }
        assert!(around([f64::NAN, 0.0].into_iter()).is_empty());
    }

    #[test]
    fn only_the_rows_of_a_range_are_correlated() {
        let row = |by: f64, value: f64| KeyedPair {
            by,
            pair: [by, value],
        };
        // Decreasing in one range, increasing in another, and one row outside.
        let rows = [
            row(2e-3, 3.0),
            row(1.5e-3, 4.0),
            row(1.1e-3, 9.0),
            row(0.02, 1.0),
            row(0.03, 2.0),
            row(0.5, 0.0),
        ];
        let found = correlations(&rows, &of_stress_changes());
        let [a, b] = [found[12].1, found[14].1];
        assert_eq!((a.rho, a.count, b.rho, b.count), (-1.0, 3, 1.0, 2));
        assert_eq!(found.iter().map(|(_, c)| c.count).sum::<usize>(), 5);
    }
}
