//! How far the runs of a sweep are: a table.

use serde::{Deserialize, Serialize};

use gshear_dem::failure::Result;
use gshear_mpi_exchange::Parallel;
use gshear_store::collective::told_by_root;
use gshear_store::status::{RunCondition, StageProgress, Status};

use super::{Selection, Sweep};
use crate::estimate::Estimate;
use crate::launch::Task;
use crate::options::{Options, Verbosity};
use crate::say::{print, say_error};
use crate::stored_run::{Ends, StoredRun, condition_by_status};
use crate::terminal::progress::duration;

/// Names of the columns.
const HEAD: [&str; 6] = ["run", "state", "stage", "part", "left", "name"];

/// What has become of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
enum State {
    Done,
    Running,
    Stopped,
    Killed,
    Failed,
    #[default]
    New,
    /// The folder holds another run.
    Another,
}

impl State {
    const ALL: [Self; 7] = [
        Self::Done,
        Self::Running,
        Self::Stopped,
        Self::Killed,
        Self::Failed,
        Self::New,
        Self::Another,
    ];

    fn word(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Running => "running",
            Self::Stopped => "stopped",
            Self::Killed => "killed",
            Self::Failed => "failed",
            Self::New => "new",
            Self::Another => "another",
        }
    }

    /// Of the run that a folder holds. `condition`: by its status.
    fn of(stored: &StoredRun, task: &Task, condition: Option<RunCondition>) -> Self {
        match condition {
            None if stored.is_empty() => Self::New,
            _ if stored.require(task, Ends::Movable).is_err() => Self::Another,
            Some(RunCondition::Running) => Self::Running,
            _ if stored.is_finished(task) => Self::Done,
            Some(RunCondition::Killed) => Self::Killed,
            Some(RunCondition::Failed(_)) => Self::Failed,
            _ => Self::Stopped,
        }
    }
}

/// A run of a sweep in the table.
struct Row {
    number: usize,
    state: State,
    /// Its status, unless it is done or has not begun.
    status: Option<Status>,
    name: String,
    /// What the whole run takes.
    whole: Estimate,
}

/// Prints a row for each of the runs: what has become of it, the stage, its part that is done, and
/// the time that is left; on standard error the runs in each state, and the time of all.
/// Collective.
///
/// # Errors
/// A run with an invalid scene; folders that cannot be read.
pub fn status(sweep: &Sweep<'_>, exchange: &dyn Parallel, options: &Options) -> Result<()> {
    let mut rows = Vec::new();
    for number in Selection::All.numbers(sweep.members.len())? {
        let member = sweep.member(number);
        let task = sweep.task(exchange, member)?;
        let folder = sweep.folder(member);
        let state = told_by_root(exchange, || {
            let stored = StoredRun::read(&folder)?;
            Ok(State::of(&stored, &task, condition_by_status(&folder)))
        })?;
        let has_begun = ![State::Done, State::New, State::Another].contains(&state);
        rows.push(Row {
            number,
            state,
            status: if has_begun {
                Status::read(&folder)
            } else {
                None
            },
            name: member.name.clone(),
            whole: Estimate::of(exchange, &task, None),
        });
    }
    // Runs of a sweep are alike; one that is done tells its speed, too.
    let speeds: Vec<f64> = sweep
        .members
        .iter()
        .filter_map(|member| Status::read(&sweep.folder(member))?.speed)
        .collect();
    let speed = if speeds.is_empty() {
        None
    } else {
        Some(speeds.iter().sum::<f64>() / speeds.len() as f64)
    };
    let mut lines = vec![HEAD.map(String::from)];
    lines.extend(rows.iter().map(|row| row.texts(speed)));
    for [run, state, stage, part, left, name] in &lines {
        let line = format!("{run:>4}  {state:<9}{stage:<10}{part:>7}  {left:>8}  {name}");
        print(exchange, line.trim_end())?;
    }
    if exchange.rank() == 0 && options.verbosity != Verbosity::Quiet {
        say_error(&summary(&rows, speed));
        for row in rows.iter().filter(|row| row.state == State::Failed) {
            let message = row
                .status
                .as_ref()
                .and_then(|status| status.message.as_deref());
            if let Some(message) = message {
                say_error(&format!("warning: run {}: failed: {message}", row.number));
            }
        }
    }
    Ok(())
}

impl Row {
    fn texts(&self, speed: Option<f64>) -> [String; HEAD.len()] {
        let none = || "-".to_string();
        let progress = self.status.as_ref().map(|status| &status.progress);
        let part = progress.and_then(StageProgress::fraction);
        let part = if self.state == State::Done {
            Some(1.0)
        } else {
            part
        };
        [
            self.number.to_string(),
            self.state.word().into(),
            progress.map_or_else(none, |progress| progress.stage.to_string()),
            part.map_or_else(none, |part| format!("{:.1} %", 100.0 * part)),
            match self.left(speed) {
                Some(left) if self.state != State::Done => duration(left),
                _ => none(),
            },
            self.name.clone(),
        ]
    }

    /// The time that is left (s), at the speed of runs that tell one.
    fn left(&self, speed: Option<f64>) -> Option<f64> {
        if self.state == State::Done {
            return Some(0.0);
        }
        let status = self.status.as_ref();
        let own = status.and_then(|status| status.speed);
        let speed = own.or(speed);
        let (name, part) = match status {
            Some(status) => (
                &*status.progress.stage,
                status.progress.fraction().unwrap_or(0.0),
            ),
            None => ("", 0.0),
        };
        let stages = &self.whole.stages;
        let at = stages.iter().position(|stage| stage.name == name);
        let mut left = 0.0;
        for (k, stage) in stages.iter().enumerate().skip(at.unwrap_or(0)) {
            let is_present = at == Some(k);
            let told = status.and_then(|status| status.seconds_left);
            left += match told {
                Some(told) if is_present => told,
                // Time of strain steps is told by a run that makes them alone.
                _ if !stage.moves => return None,
                _ => {
                    let rest = if is_present { 1.0 - part } else { 1.0 };
                    rest * f64::from(self.whole.grains) * stage.steps as f64 / speed?
                }
            };
        }
        Some(left)
    }
}

/// The number of runs in each state, and the time that all of them take.
fn summary(rows: &[Row], speed: Option<f64>) -> String {
    let mut counts = Vec::new();
    for state in State::ALL {
        let number = rows.iter().filter(|row| row.state == state).count();
        if number > 0 {
            counts.push(format!("{number} {}", state.word()));
        }
    }
    let text = format!("{} runs: {}", rows.len(), counts.join(", "));
    let left: Option<Vec<f64>> = rows.iter().map(|row| row.left(speed)).collect();
    let left = left.map_or(0.0, |left| left.iter().sum::<f64>());
    let running = rows
        .iter()
        .filter(|row| row.state == State::Running)
        .count();
    match (left > 0.0, running) {
        (false, _) => text,
        (true, 0 | 1) => format!("{text}; {} left, one after the other", duration(left)),
        (true, n) => {
            let left = duration(left / n as f64);
            format!("{text}; {left} left, {n} at a time")
        }
    }
}
