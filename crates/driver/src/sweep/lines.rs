//! What the terminal shows of runs at the same time: lines, and of each run one line of progress
//! that is drawn anew.

use std::path::Path;

use console::Term;
use indicatif::{MultiProgress, ProgressBar};

use gshear_store::status::{RunState, Status};

use crate::options::Verbosity;
use crate::say::{say, say_error, width};
use crate::terminal::progress::line;
use crate::terminal::{drawable, is_coloured, plain_message};

/// Lines about the runs, and on a terminal those of progress.
pub(super) struct Lines {
    verbosity: Verbosity,
    screen: Option<Screen>,
}

/// A terminal with lines of progress.
struct Screen {
    term: Term,
    lines: MultiProgress,
    /// Of the sweep.
    last: ProgressBar,
    styled: bool,
}

/// The line of progress of a run; nothing without a terminal.
pub(super) struct RunLine(Option<ProgressBar>);

impl Lines {
    pub fn new(verbosity: Verbosity) -> Self {
        let drawn = if verbosity == Verbosity::Quiet {
            None
        } else {
            drawable()
        };
        let screen = drawn.map(|(term, target)| {
            let lines = MultiProgress::with_draw_target(target);
            let last = lines.add(ProgressBar::no_length().with_style(plain_message()));
            Screen {
                term,
                lines,
                last,
                styled: is_coloured(),
            }
        });
        Self { verbosity, screen }
    }

    /// Prints a line, unless told to be quiet.
    pub fn say(&self, text: &str) {
        match (&self.screen, self.verbosity) {
            (_, Verbosity::Quiet) => {}
            (None, _) => say(text),
            (Some(screen), _) => screen.lines.suspend(|| say(text)),
        }
    }

    /// Prints a line if told to print more.
    pub fn detail(&self, text: &str) {
        if self.verbosity == Verbosity::Verbose {
            self.say(text);
        }
    }

    /// Prints a line to standard error.
    pub fn say_error(&self, text: &str) {
        match &self.screen {
            None => say_error(text),
            Some(screen) => screen.lines.suspend(|| say_error(text)),
        }
    }

    /// A line of progress above that of the sweep.
    pub fn begin(&self) -> RunLine {
        RunLine(self.screen.as_ref().map(|screen| {
            let bar = ProgressBar::no_length().with_style(plain_message());
            screen.lines.insert_before(&screen.last, bar)
        }))
    }

    /// Draws how far the run of this number is, as the status in its folder says.
    pub fn draw(&self, run: &RunLine, number: usize, folder: &Path) {
        let (Some(screen), RunLine(Some(bar))) = (&self.screen, run) else {
            return;
        };
        let head = format!("{number:>4} ");
        let width = width(&screen.term).unwrap_or_default();
        let status = Status::read(folder).filter(|status| status.state == RunState::Running);
        bar.set_message(match status {
            Some(status) => {
                let width = width.saturating_sub(head.len());
                let (speed, left) = (status.speed, status.seconds_left);
                head + &line(&status.progress, speed, left, width, screen.styled)
            }
            None => head + "starts",
        });
    }

    /// Removes the line of a run that has ended.
    pub fn end(&self, run: &RunLine) {
        if let (Some(screen), RunLine(Some(bar))) = (&self.screen, run) {
            bar.finish_and_clear();
            screen.lines.remove(bar);
        }
    }

    /// Draws the line of the sweep.
    pub fn draw_sweep(&self, text: &str) {
        if let Some(screen) = &self.screen {
            let width = width(&screen.term).unwrap_or_default();
            let text = text.chars().take(width).collect::<String>();
            screen.last.set_message(text);
        }
    }

    /// Removes all lines of progress.
    pub fn clear(&self) {
        if let Some(screen) = &self.screen {
            screen.last.finish_and_clear();
        }
    }
}
