//! The three stages around a large drop of τ (LH section 3.2, figure 2b). LH choose them by eye;
//! the rule here is that of [`Stages::around`].

use super::moments::extent;
use super::phases::{Phase, PhaseKind};

/// Stage II lies within this many intervals of the largest slip, or within the slip's own duration
/// if that is longer: half of the window that LH plot around their drop.
const SEARCH: usize = 14;
/// Stage II begins where τ leaves its maximum and ends where it first comes near its minimum, both
/// within this share of their difference.
const NEAR: f64 = 0.1;
/// A later slip counts as a further drop if its Δτ_p is at least this share of the largest one's
/// (the second drop of LH figure 14b).
const FURTHER: f64 = 0.25;
/// Least number of intervals of Stage I and of Stage III.
const AROUND: usize = 8;

/// Rows of the time series: Stage I is `begin` … `drop`, Stage II `drop` … `calm`, Stage III `calm`
/// … `end`.
#[derive(Debug, Clone, PartialEq)]
pub struct Stages {
    /// First row of Stage I.
    pub begin: usize,
    /// Row where the drop begins.
    pub drop: usize,
    /// Row where the drop has ended.
    pub calm: usize,
    /// Last row of Stage III.
    pub end: usize,
    /// Start and end rows of the large slips in Stage II; the largest one first.
    pub drops: Vec<[usize; 2]>,
}

impl Stages {
    /// Returns the stages around `largest`, one of the slips in `phases`; `tau` `[L]` is the series
    /// that the phases were found in.
    ///
    /// τ may rise for an interval or two within a drop, so a drop is seldom a single slip. Let
    /// τ_max be the maximum of τ in the window before the largest slip, τ_min the minimum in the
    /// window after it, and Δ = 0.1 (τ_max - τ_min). Stage II goes from the last row before the
    /// slip with τ ≥ τ_max - Δ to the first row after it with τ ≤ τ_min + Δ. Stages I and III are
    /// as long as Stage II, at least 8 intervals, and end where the series ends. Values of τ that
    /// are not finite are ignored.
    ///
    /// # Panics
    /// If `tau` is empty.
    pub fn around(phases: &[Phase], largest: &Phase, tau: &[f64]) -> Self {
        let search = SEARCH.max(largest.duration());
        let last = tau.len() - 1;
        let before = largest.start.saturating_sub(search)..=largest.start;
        let after = largest.end..=(largest.end + search).min(last);
        let [_, greatest] = extent(tau[before.clone()].iter().copied());
        let [least, _] = extent(tau[after.clone()].iter().copied());
        let near = NEAR * (greatest - least);
        let drop = before.rev().find(|row| tau[*row] >= greatest - near);
        let drop = drop.unwrap_or(largest.start);
        let calm = after.clone().find(|row| tau[*row] <= least + near);
        let calm = calm.unwrap_or(largest.end);
        let further = phases.iter().filter(|phase| {
            let within = phase.start >= largest.end && phase.end <= calm;
            within && phase.kind == PhaseKind::Slip && phase.change <= FURTHER * largest.change
        });
        let slips = std::iter::once(largest).chain(further);
        let around = AROUND.max(calm - drop);
        Stages {
            begin: drop.saturating_sub(around),
            drop,
            calm,
            end: (calm + around).min(last),
            drops: slips.map(|slip| [slip.start, slip.end]).collect(),
        }
    }

    /// Returns the rows k whose interval, from k-1 to k, belongs to Stages I, II and III.
    pub fn intervals(&self) -> [std::ops::RangeInclusive<usize>; 3] {
        [
            self.begin + 1..=self.drop,
            self.drop + 1..=self.calm,
            self.calm + 1..=self.end,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phases::{find, largest_drop};

    fn stages(tau: &[f64]) -> Stages {
        let strain: Vec<f64> = (0..tau.len()).map(|k| k as f64).collect();
        let phases = find(&strain, tau);
        Stages::around(&phases, largest_drop(&phases).expect("a slip"), tau)
    }

    /// The stages of a series that begins at τ = 10 and consists of pieces: a number of rows and
    /// the step of τ per row.
    fn assert_stages(pieces: &[(usize, f64)], ends: [usize; 4], drops: &[[usize; 2]]) {
        let mut tau = vec![10.0];
        for (rows, step) in pieces {
            for _ in 0..*rows {
                tau.push(tau[tau.len() - 1] + step);
            }
        }
        let [begin, drop, calm, end] = ends;
        let found = stages(&tau);
        assert_eq!([found.begin, found.drop, found.calm, found.end], ends);
        assert_eq!(found.drops, drops);
        let intervals = [begin + 1..=drop, drop + 1..=calm, calm + 1..=end];
        assert_eq!(found.intervals(), intervals);
    }

    #[test]
    fn a_single_slip_is_stage_ii_with_eight_intervals_on_either_side() {
        let slip = [(19, 0.1), (3, -2.0), (20, 0.1)];
        assert_stages(&slip, [11, 19, 22, 30], &[[19, 22]]);
    }

    #[test]
    fn a_drop_that_pauses_is_one_stage() {
        // Slips of 2 and 4 with a rise between them, then one of 0.9: too small to count as a
        // further drop, but part of Stage II.
        let (two, four, last) = ((2, -1.0), (2, -2.0), (1, -0.9));
        let slips = [(19, 0.1), two, (1, 0.1), four, (2, 0.1), last, (30, 0.1)];
        assert_stages(&slips, [11, 19, 27, 35], &[[22, 24]]);
    }

    #[test]
    fn a_further_drop_follows_closely() {
        let slips = |pause| [(19, 0.1), (2, -2.0), (pause, 0.1), (2, -1.9), (30, 0.1)];
        assert_stages(&slips(4), [11, 19, 27, 35], &[[19, 21], [25, 27]]);
        assert_stages(&slips(20), [11, 19, 21, 29], &[[19, 21]]);
    }

    #[test]
    fn stages_end_where_the_series_does() {
        let found = stages(&[5.0, 5.1, 1.0, 1.1]);
        assert_eq!(
            [found.begin, found.drop, found.calm, found.end],
            [0, 1, 2, 3]
        );
    }
}
