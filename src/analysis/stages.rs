//! The three stages around a great drop of τ (LH section 3.2 and figure 2b), found by rule.

use super::phases::{Kind, Phase};

/// A slip that follows belongs to Stage II where its drop is at least this share of the largest one (the second drop of LH figure 14b).
const FURTHER: f64 = 0.25;
/// It must begin within so many lengths of the largest drop, or this many intervals, after the end of the one before.
const PAUSE: usize = 4;
/// Least number of intervals of Stage I and of Stage III.
const AROUND: usize = 8;

/// Rows of the series: Stage I is `begin` … `drop`, Stage II `drop` … `calm`, Stage III `calm` … `end`.
#[derive(Debug, Clone, PartialEq)]
pub struct Stages {
    pub begin: usize,
    pub drop: usize,
    pub calm: usize,
    pub end: usize,
    /// Start and end of the great slips in Stage II; the first is the largest drop.
    pub drops: Vec<[usize; 2]>,
}

impl Stages {
    /// The stages around `largest`, one of `phases`, in a series of `rows` rows.
    ///
    /// Stage II begins with the largest drop and ends with it, or with the last of the slips of at least a quarter of its size
    /// that follow one another closely. Stages I and III are as long as Stage II, at least 8 intervals, as far as there are rows.
    pub fn around(phases: &[Phase], largest: &Phase, rows: usize) -> Self {
        let mut drops = vec![[largest.start, largest.end]];
        let mut calm = largest.end;
        let pause = PAUSE.max(largest.duration());
        let later = phases.iter().filter(|p| p.start >= largest.end);
        for slip in later.filter(|p| p.kind == Kind::Slip) {
            if slip.start > calm + pause {
                break;
            }
            if slip.change <= FURTHER * largest.change {
                drops.push([slip.start, slip.end]);
                calm = slip.end;
            }
        }
        let around = AROUND.max(calm - largest.start);
        Stages {
            begin: largest.start.saturating_sub(around),
            drop: largest.start,
            calm,
            end: (calm + around).min(rows.saturating_sub(1)),
            drops,
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
