//! Pairs of events by their distances in space and time, compared with independent events.

use gshear_dem::dimension::{Dimension, Dimensions, Three, Two};
use gshear_dem::state::{Cell, length};

use super::Event;

/// A range of distances in space and time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairRange {
    /// Intervals from the start of the first event to that of the second: from the first number on,
    /// less than the second.
    pub lag: [usize; 2],
    /// Distance of their places (m), likewise; from 0 to infinity for all.
    pub distance: [f64; 2],
}

/// Pairs of events in a range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairCount {
    /// The range.
    pub range: PairRange,
    /// Number of pairs.
    pub pairs: u64,
    /// The number of pairs of independent events. For all distances: of events whose starts are
    /// spread evenly over the intervals. Else: if the distance did not depend on the lag.
    pub expected: f64,
}

/// Counts pairs of events by the lag between their starts, in doubling ranges, and by their
/// distance, in `rings` ranges of this `width` (m).
///
/// - `intervals`: number of all intervals.
/// - `cell`: in which distances are those of the nearest images.
pub fn pair_counts(
    events: &[Event],
    intervals: usize,
    cell: Cell,
    dimension: Dimensions,
    width: f64,
    rings: usize,
) -> Vec<PairCount> {
    let lags = lag_ranges(intervals);
    // By lag, and then by distance; the last one is for all that are farther.
    let mut counts = vec![vec![0_u64; rings + 1]; lags.len()];
    for (k, first) in events.iter().enumerate() {
        for second in &events[k + 1..] {
            let lag = second.intervals[0].abs_diff(first.intervals[0]);
            let row = lags.partition_point(|[_, end]| *end <= lag);
            let r = match dimension {
                Dimensions::Two => distance::<Two>(cell, first, second),
                Dimensions::Three => distance::<Three>(cell, first, second),
            };
            counts[row][((r / width) as usize).min(rings)] += 1;
        }
    }
    let by_lag: Vec<u64> = counts.iter().map(|row| row.iter().sum()).collect();
    let by_ring: Vec<u64> = (0..rings)
        .map(|ring| counts.iter().map(|row| row[ring]).sum())
        .collect();
    let all: u64 = by_lag.iter().sum();
    let mut found = Vec::new();
    for ((lag, row), pairs) in lags.iter().zip(&counts).zip(by_lag) {
        found.push(PairCount {
            range: PairRange {
                lag: *lag,
                distance: [0.0, f64::INFINITY],
            },
            pairs,
            expected: all as f64 * share_of_even(*lag, intervals),
        });
        for (ring, count) in row[..rings].iter().enumerate() {
            let expected = pairs as f64 * by_ring[ring] as f64 / all.max(1) as f64;
            found.push(PairCount {
                range: PairRange {
                    lag: *lag,
                    distance: [ring as f64 * width, (ring + 1) as f64 * width],
                },
                pairs: *count,
                expected,
            });
        }
    }
    found
}

/// 0, 1, 2 to 3, 4 to 7, … up to the number of intervals.
fn lag_ranges(intervals: usize) -> Vec<[usize; 2]> {
    let mut ranges = vec![[0, 1]];
    let mut start = 1;
    while start < intervals {
        ranges.push([start, (2 * start).min(intervals)]);
        start *= 2;
    }
    ranges
}

/// The share of pairs of two independent starts, each in any of the intervals with the same
/// probability, whose lag is in a range.
fn share_of_even(lag: [usize; 2], intervals: usize) -> f64 {
    let n = intervals as f64;
    let shares = (lag[0]..lag[1]).map(|k| match k {
        0 => 1.0 / n,
        k => 2.0 * (n - k as f64) / (n * n),
    });
    shares.sum()
}

fn distance<D: Dimension>(cell: Cell, first: &Event, second: &Event) -> f64 {
    length(cell.separation::<D>(&second.place, &first.place))
}
