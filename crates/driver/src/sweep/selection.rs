//! Which runs of a sweep are meant.

use std::collections::BTreeSet;
use std::ops::RangeInclusive;
use std::str::FromStr;

use gshear_dem::failure::{Failure, Result};

/// Runs of a sweep, by their numbers from 1 on: `all`, `3`, `5-8`, `1,3,5-8`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Selection {
    /// All of them.
    All,
    /// Those in these ranges.
    Numbers(Vec<RangeInclusive<usize>>),
}

/// The word for all runs.
pub const ALL: &str = "all";

impl FromStr for Selection {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == ALL {
            return Ok(Self::All);
        }
        let ranges = text.split(',').map(range).collect::<Option<_>>();
        let wrong = || {
            format!(
                "{text:?} is none of list, status, all, and the numbers of runs from 1 on, such as 3, 5-8 or 1,3,5-8"
            )
        };
        ranges.map(Self::Numbers).ok_or_else(wrong)
    }
}

/// `3` or `5-8`.
fn range(text: &str) -> Option<RangeInclusive<usize>> {
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    let number = |text: &str| {
        let is_number = text.bytes().all(|byte| byte.is_ascii_digit());
        text.parse().ok().filter(|number| is_number && *number > 0)
    };
    let range = number(first)?..=number(last)?;
    (!range.is_empty()).then_some(range)
}

impl Selection {
    /// The only number, if a single one is given.
    pub fn single(&self) -> Option<usize> {
        match self {
            Self::Numbers(ranges) => match &ranges[..] {
                [range] if range.start() == range.end() => Some(*range.start()),
                _ => None,
            },
            Self::All => None,
        }
    }

    /// The numbers of the chosen runs of a sweep of so many, in order and each once. A range may
    /// end beyond the last run, as that of the last job of an array does.
    ///
    /// # Errors
    /// A range without a run.
    pub fn numbers(&self, runs: usize) -> Result<Vec<usize>> {
        let Self::Numbers(ranges) = self else {
            return Ok((1..=runs).collect());
        };
        let mut numbers = BTreeSet::new();
        for range in ranges {
            if *range.start() > runs {
                let range = match (range.start(), range.end()) {
                    (first, last) if first == last => first.to_string(),
                    (first, last) => format!("{first}-{last}"),
                };
                return Err(Failure::input(format!(
                    "--sweep {range}: there are the runs 1 to {runs}"
                )));
            }
            numbers.extend(*range.start()..=*range.end().min(&runs));
        }
        Ok(numbers.into_iter().collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(text: &str) -> Result<Vec<usize>> {
        text.parse::<Selection>().expect("a selection").numbers(6)
    }

    #[test]
    fn numbers_and_ranges_are_chosen_once() {
        assert_eq!(numbers("all"), Ok(vec![1, 2, 3, 4, 5, 6]));
        assert_eq!(numbers("3"), Ok(vec![3]));
        assert_eq!(numbers("5-8,2,1-2"), Ok(vec![1, 2, 5, 6]));
        let beyond = numbers("2,7-8").expect_err("refused").to_string();
        assert_eq!(beyond, "--sweep 7-8: there are the runs 1 to 6");
        for text in ["", "0", "0-2", "3-1", "1,", "a", "-1", "+1", "1-2-3", "1 2"] {
            assert!(text.parse::<Selection>().is_err(), "{text}");
        }
        let single = |text: &str| text.parse::<Selection>().expect("a selection").single();
        assert_eq!(
            [single("4"), single("4-5"), single("all")],
            [Some(4), None, None]
        );
    }
}
