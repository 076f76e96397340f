//! Correlations within ranges of one of the quantities, as LH give them (figures 9 to 11, 13, 22, 23, 25).

use super::spearman::{Correlation, Spearman};

/// Half-decades from 1e-5 to 1e-1.
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

/// A range of values: on the side of zero where both ends are, `nearer` ≤ |value| < `farther`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// The end nearer to zero.
    pub nearer: f64,
    pub farther: f64,
}

impl Range {
    pub fn contains(&self, value: f64) -> bool {
        value.signum() == self.farther.signum()
            && value.abs() >= self.nearer.abs()
            && value.abs() < self.farther.abs()
    }

    /// The middle on a logarithmic axis.
    pub fn middle(&self) -> f64 {
        (self.nearer * self.farther).sqrt().copysign(self.farther)
    }
}

/// The half-decades of Δτ and Δτ_p: from -1e-1 to -1e-5, then from 1e-5 to 1e-1.
pub fn of_stress_changes() -> Vec<Range> {
    let up = EDGES.windows(2).map(|edge| Range {
        nearer: edge[0],
        farther: edge[1],
    });
    let down = up.clone().rev().map(|range| Range {
        nearer: -range.nearer,
        farther: -range.farther,
    });
    down.chain(up).collect()
}

/// Half-decades that hold all positive finite `values`, at most 24 of them, the greatest; none where there is no such value.
pub fn around(values: impl Iterator<Item = f64>) -> Vec<Range> {
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
    let range = |k: i32| Range {
        nearer: edge(k),
        farther: edge(k + 1),
    };
    (low.max(high - 23)..=high).map(range).collect()
}

/// A row of the quantities in question.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// What decides on the range.
    pub by: f64,
    /// What is correlated.
    pub pair: [f64; 2],
}

/// ρ and p of the pairs of each range.
pub fn correlations(rows: &[Row], ranges: &[Range]) -> Vec<(Range, Correlation)> {
    let mut spearman = Spearman::default();
    let within = |range: &Range| {
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
        let row = |by: f64, value: f64| Row {
            by,
            pair: [by, value],
        };
        // Falling within one range, rising within the other, and something outside.
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
