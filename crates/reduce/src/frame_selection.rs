//! Which frames are exported.

use std::str::FromStr;

use gshear_dem::failure::{Failure, Result};
use gshear_store::run_reader::RunFile;

/// A frame of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Which {
    /// The last frame.
    Last,
    /// The frame of this number, from 0 on.
    Number(usize),
}

impl FromStr for Which {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match (text, text.parse()) {
            ("last", _) => Ok(Which::Last),
            (_, Ok(number)) => Ok(Which::Number(number)),
            (_, Err(_)) => Err("write last, or the number of a frame, from 0 on".into()),
        }
    }
}

impl Which {
    /// Returns its number.
    ///
    /// # Errors
    /// [`Failure::Input`] if the run has no such frame.
    pub fn of(self, run: &RunFile) -> Result<usize> {
        let frames = run.frames();
        let asked = match self {
            Which::Number(t) if t < frames => return Ok(t),
            Which::Last if frames > 0 => return Ok(frames - 1),
            Which::Last => "last".to_string(),
            Which::Number(t) => t.to_string(),
        };
        Err(lacks(run, format!("--frame {asked}")))
    }
}

/// The failure of a run without a frame that an option asks for.
fn lacks(run: &RunFile, option: String) -> Failure {
    let has = match run.frames() {
        0 => "no frames".into(),
        n => format!("the frames 0 … {}", n - 1),
    };
    Failure::input(format!("{option}: {} has {has}", run.path().display()))
}

/// A range of frames, both ends included, and the stride through it: `A..B:N`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct FrameRange {
    first: usize,
    /// `None`: the last frame of the run.
    last: Option<usize>,
    stride: usize,
}

impl FrameRange {
    /// All frames.
    pub const ALL: Self = Self {
        first: 0,
        last: None,
        stride: 1,
    };

    /// One frame.
    pub fn one(number: usize) -> Self {
        Self {
            first: number,
            last: Some(number),
            stride: 1,
        }
    }

    fn parsed(text: &str) -> Option<Self> {
        let (range, stride) = match text.split_once(':') {
            Some((range, stride)) => (range, stride.parse().ok()?),
            None => (text, 1),
        };
        let (first, last) = match range.split_once("..")? {
            ("", "") => (0, None),
            ("", last) => (0, Some(last.parse().ok()?)),
            (first, "") => (first.parse().ok()?, None),
            (first, last) => (first.parse().ok()?, Some(last.parse().ok()?)),
        };
        if stride == 0 || last.is_some_and(|last| last < first) {
            return None;
        }
        Some(Self {
            first,
            last,
            stride,
        })
    }

    /// Returns the numbers of the frames.
    ///
    /// # Errors
    /// [`Failure::Input`] if the run lacks one of them.
    pub fn of(self, run: &RunFile) -> Result<Vec<usize>> {
        let frames = run.frames();
        let last = self.last.unwrap_or(frames.saturating_sub(1));
        if frames == 0 || last >= frames || self.first > last {
            return Err(lacks(run, format!("--frames {}..{last}", self.first)));
        }
        Ok((self.first..=last).step_by(self.stride).collect())
    }
}

impl FromStr for FrameRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let range = Self::parsed(text);
        range.ok_or_else(|| {
            "write A..B or A..B:N: frames A to B, both included, every Nth of them".to_string()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::FrameRange;

    #[test]
    fn ranges_are_read() {
        let read = |text: &str| text.parse::<FrameRange>();
        let range = |first, last, stride| FrameRange {
            first,
            last,
            stride,
        };
        assert_eq!(read(".."), Ok(FrameRange::ALL));
        assert_eq!(read("3..7"), Ok(range(3, Some(7), 1)));
        assert_eq!(read("3..:2"), Ok(range(3, None, 2)));
        assert_eq!(read("..7:3"), Ok(range(0, Some(7), 3)));
        for wrong in ["", "3", "3..2", "1..2:0", "a..b", "1...3", "-1..2"] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }
}
