//! How the runs of a sweep ended, and the outcome of all of them.

use gshear_dem::failure::{Failure, Result};

use crate::options::Outcome;

/// How the chosen runs of a sweep ended.
#[derive(Debug, Default)]
pub(crate) struct Ended {
    /// Runs that came to their end, now or before.
    pub done: usize,
    /// Runs that stopped early, or were not begun because the program was asked to stop.
    pub stopped: usize,
    /// The names of the runs that failed, and why.
    pub failed: Vec<(String, Failure)>,
}

impl Ended {
    /// Adds a run.
    pub fn add(&mut self, name: &str, ended: Result<Outcome>) {
        match ended {
            Ok(Outcome::Done) => self.done += 1,
            Ok(Outcome::Stopped) => self.stopped += 1,
            Err(failure) => self.failed.push((name.into(), failure)),
        }
    }

    /// Number of the runs.
    fn all(&self) -> usize {
        self.done + self.stopped + self.failed.len()
    }

    /// The runs in a line.
    pub fn text(&self) -> String {
        let mut text = format!("{} of {} runs are done", self.done, self.all());
        for (number, what) in [
            (self.stopped, "stopped or not begun"),
            (self.failed.len(), "failed"),
        ] {
            if number > 0 {
                text += &format!(", {number} {what}");
            }
        }
        text
    }

    /// Stopped if any run is to be continued, or else failed if any run has.
    ///
    /// # Errors
    /// Of failed runs, a failure of their kind, or `Failure::Other` if they are of several kinds.
    pub fn outcome(&self) -> Result<Outcome> {
        if self.stopped > 0 {
            return Ok(Outcome::Stopped);
        }
        let Some((name, first)) = self.failed.first() else {
            return Ok(Outcome::Done);
        };
        let what = format!(
            "{} of {} runs of the sweep failed, first {name}: {first}",
            self.failed.len(),
            self.all()
        );
        let mut codes = self.failed.iter().map(|(_, failure)| failure.exit_code());
        let alike = codes.all(|code| code == first.exit_code());
        Err(match first {
            Failure::Input(_) if alike => Failure::Input(what),
            Failure::Numbers(_) if alike => Failure::Numbers(what),
            _ => Failure::Other(what),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_outcome_is_that_of_all_runs() {
        let mut ended = Ended::default();
        ended.add("a", Ok(Outcome::Done));
        assert_eq!(ended.outcome(), Ok(Outcome::Done));
        ended.add("b", Err(Failure::numbers("NaN")));
        let expected = "1 of 2 runs of the sweep failed, first b: NaN";
        assert_eq!(ended.outcome(), Err(Failure::numbers(expected)));
        ended.add("c", Err(Failure::input("no file")));
        let expected = "2 of 3 runs of the sweep failed, first b: NaN";
        assert_eq!(ended.outcome(), Err(Failure::other(expected)));
        // What stopped goes on in the next job, in which failed runs are tried again.
        ended.add("d", Ok(Outcome::Stopped));
        assert_eq!(ended.outcome(), Ok(Outcome::Stopped));
        assert_eq!(
            ended.text(),
            "1 of 4 runs are done, 1 stopped or not begun, 2 failed"
        );
    }
}
