//! The three stages around a great drop of τ (LH section 3.2 and figure 2b), found by rule.

use super::phases::{Kind, Phase};

/// The drop as a whole begins and ends within so many intervals of the largest slip, or within its own length: half of the window
/// that LH show around theirs.
const REACH: usize = 14;
/// It begins where τ leaves its greatest value for good and ends where it first comes near its least, by this share of the difference.
const NEAR: f64 = 0.1;
/// A slip after the largest is a further drop where it is at least this share of it (the second drop of LH figure 14b).
const FURTHER: f64 = 0.25;
/// Least number of intervals of Stage I and of Stage III.
const AROUND: usize = 8;

/// Rows of the series: Stage I is `begin` … `drop`, Stage II `drop` … `calm`, Stage III `calm` … `end`.
#[derive(Debug, Clone, PartialEq)]
pub struct Stages {
    pub begin: usize,
    pub drop: usize,
    pub calm: usize,
    pub end: usize,
    /// Start and end of the great slips in Stage II; the first is the largest one.
    pub drops: Vec<[usize; 2]>,
}

impl Stages {
    /// The stages around `largest`, a slip of `phases`, all of them of the series `tau` [L].
    ///
    /// A drop is seldom one slip: τ may turn for an interval or two within it. With τ_max the greatest τ within reach before the
    /// largest slip and τ_min the least within reach after it, Stage II is from the last row before the slip with τ ≥ τ_max - 0.1
    /// (τ_max - τ_min) to the first after it with τ ≤ τ_min + 0.1 (τ_max - τ_min). Stages I and III are as long as Stage II, at
    /// least 8 intervals, as far as there are rows.
    pub fn around(phases: &[Phase], largest: &Phase, tau: &[f64]) -> Self {
        let reach = REACH.max(largest.duration());
        let last = tau.len() - 1;
        let before = largest.start.saturating_sub(reach)..=largest.start;
        let after = largest.end..=(largest.end + reach).min(last);
        // What is not finite is passed over.
        let greatest = tau[before.clone()]
            .iter()
            .copied()
            .fold(f64::NEG_INFINITY, f64::max);
        let least = tau[after.clone()]
            .iter()
            .copied()
            .fold(f64::INFINITY, f64::min);
        let near = NEAR * (greatest - least);
        let drop = before.rev().find(|row| tau[*row] >= greatest - near);
        let drop = drop.unwrap_or(largest.start);
        let calm = after.clone().find(|row| tau[*row] <= least + near);
        let calm = calm.unwrap_or(largest.end);
        let further = phases.iter().filter(|phase| {
            let within = phase.start >= largest.end && phase.end <= calm;
            within && phase.kind == Kind::Slip && phase.change <= FURTHER * largest.change
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

    /// Rows k whose interval, from k-1 to k, belongs to Stage I, II and III.
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

    /// Pieces one after the other: a number of rows, each with τ a step from the one before, from 10 on.
    fn series(pieces: &[(usize, f64)]) -> Vec<f64> {
        let mut tau = vec![10.0];
        for (rows, step) in pieces {
            for _ in 0..*rows {
                tau.push(tau[tau.len() - 1] + step);
            }
        }
        tau
    }

    #[test]
    fn a_single_slip_is_stage_ii_with_eight_intervals_on_either_side() {
        let found = stages(&series(&[(19, 0.1), (3, -2.0), (20, 0.1)]));
        assert_eq!(
            (found.begin, found.drop, found.calm, found.end),
            (11, 19, 22, 30)
        );
        assert_eq!(found.drops, [[19, 22]]);
        assert_eq!(found.intervals(), [12..=19, 20..=22, 23..=30]);
    }

    #[test]
    fn a_drop_that_pauses_is_one_stage() {
        // Slips of 2 and 4 with a rise between them, then one of 0.9: too small for a further drop, but part of Stage II.
        let found = stages(&series(&[
            (19, 0.1),
            (2, -1.0),
            (1, 0.1),
            (2, -2.0),
            (2, 0.1),
            (1, -0.9),
            (30, 0.1),
        ]));
        assert_eq!((found.drop, found.calm), (19, 27));
        assert_eq!(found.drops, [[22, 24]]);
        assert_eq!((found.begin, found.end), (11, 35));
    }

    #[test]
    fn a_further_drop_follows_closely() {
        let of = |pause: usize| {
            stages(&series(&[
                (19, 0.1),
                (2, -2.0),
                (pause, 0.1),
                (2, -1.9),
                (30, 0.1),
            ]))
        };
        assert_eq!((of(4).drops, of(4).calm), (vec![[19, 21], [25, 27]], 27));
        assert_eq!((of(20).drops, of(20).calm), (vec![[19, 21]], 21));
    }

    #[test]
    fn stages_end_where_the_series_does() {
        let found = stages(&[5.0, 5.1, 1.0, 1.1]);
        assert_eq!(
            (found.begin, found.drop, found.calm, found.end),
            (0, 1, 2, 3)
        );
    }
}
