//! Correlations within ranges of one of the quantities, as LH give them (figures 9 to 11, 13, 22, 23, 25).

use super::spearman::{Correlation, Spearman};

/// Half-decades from 1e-5 to 1e-1.
const EDGES: [f64; 9] = [
    1e-5,
    3.1622776601683795e-5,
    1e-4,
    3.1622776601683795e-4,
    1e-3,
    3.1622776601683795e-3,
    1e-2,
    3.1622776601683794e-2,
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
