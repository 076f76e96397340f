//! `status.json`: how far a run has come, for dashboards and `gshear-reduce watch`.
//!
//! The file says nothing that decides a run: it is written anew every second, beside and renamed,
//! and a run goes on if it cannot be written.

use std::borrow::Cow;
use std::fmt;
use std::path::Path;

use gshear_dem::failure::on_one_line;
use serde::{Deserialize, Serialize};

use super::file_names::STATUS_FILE;
use super::text_writer;

/// Version of the format.
pub const VERSION: u32 = 1;

/// The part of the time for which a rank may wait for a core without a word.
const LONG_WAIT: f64 = 0.2;

/// What has become of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RunState {
    /// It runs, or was killed.
    Running,
    /// It stopped at a checkpoint before its end.
    Stopped,
    /// It came to its end.
    Done,
    /// It failed.
    Failed,
}

/// What is known of a run from its file, `status.json` and the lock of its folder. Every command
/// that says what has become of a run says it in these words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RunCondition {
    /// It runs.
    Running,
    /// It was killed: it left a status that says that it runs, and its process is gone.
    Killed,
    /// It stopped at a checkpoint before its end.
    Stopped,
    /// It came to its end.
    Finished,
    /// It failed, and why.
    Failed(String),
    /// It has not come to its end, and no status says more.
    Unknown,
}

impl RunCondition {
    /// Decides on a run. `finished`: its file has the digest of its last state; `status`: of its
    /// folder, if it is that of this run; `gone`: no process holds the lock of the folder.
    pub fn of(finished: bool, status: Option<&Status>, gone: bool) -> Self {
        match status {
            _ if finished => Self::Finished,
            None => Self::Unknown,
            Some(status) => match status.state {
                RunState::Running if gone => Self::Killed,
                RunState::Running => Self::Running,
                RunState::Stopped => Self::Stopped,
                RunState::Failed => {
                    let message = status.message.as_deref().unwrap_or("unknown");
                    Self::Failed(format!("{message} (stage {})", status.progress.stage))
                }
                // Another file of the folder is the one that is whole.
                RunState::Done => Self::Unknown,
            },
        }
    }

    /// The condition in a word, which `gshear.Run.state` has, too.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Killed => "killed",
            Self::Stopped => "stopped",
            Self::Finished => "finished",
            Self::Failed(_) => "failed",
            Self::Unknown => "unfinished",
        }
    }
}

impl fmt::Display for RunCondition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Running => write!(f, "running"),
            Self::Killed => write!(f, "killed: its process is gone"),
            Self::Stopped => write!(f, "stopped at a checkpoint before its end"),
            Self::Finished => write!(f, "finished"),
            Self::Failed(message) => write!(f, "failed: {message}"),
            Self::Unknown => write!(
                f,
                "unfinished: no digest, and no {STATUS_FILE} that says why"
            ),
        }
    }
}

/// Progress of a stage. What is unknown is `None`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct StageProgress {
    /// Name of the stage, as in checkpoints; `prepare` is that of a box before its strain steps.
    pub stage: Cow<'static, str>,
    /// Completed steps of the stage.
    pub step: u64,
    /// Steps of the stage; unknown while packing.
    pub steps: Option<u64>,
    /// The part that is done, 0 to 1, if it is not that of the steps; estimated while packing.
    pub fraction: Option<f64>,
    /// Shear strain γ, of a box the strain of its deformation.
    pub strain: Option<f64>,
    /// τ, of a run between walls.
    pub stress_ratio: Option<f64>,
    /// Solid fraction, of a run between walls.
    pub solid_fraction: Option<f64>,
    /// Shear stress, of a run in a box.
    pub shear_stress: Option<f64>,
    /// Greatest force in the relaxation that goes on, in a box.
    #[serde(default)]
    pub residual: Option<f64>,
    /// Grains that a step of the equations of motion moves; `None` if the steps are others.
    #[serde(skip)]
    pub moving: Option<u32>,
}

impl StageProgress {
    /// The part of the stage that is done, 0 to 1.
    pub fn fraction(&self) -> Option<f64> {
        let fraction = match (self.fraction, self.steps) {
            (Some(fraction), _) => fraction,
            (None, Some(steps)) => self.step as f64 / steps.max(1) as f64,
            (None, None) => return None,
        };
        Some(fraction.clamp(0.0, 1.0))
    }
}

/// The content of `status.json`. Numbers that are unknown are `None`, in the file `null`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Version of the format.
    pub version: u32,
    /// What has become of the run.
    pub state: RunState,
    /// Why it failed.
    pub message: Option<String>,
    /// The identity of the run.
    pub run_id: String,
    /// Title of the scene.
    pub title: String,
    /// How far it has come.
    #[serde(flatten)]
    pub progress: StageProgress,
    /// Speed (grain-steps/s), of all ranks together.
    pub speed: Option<f64>,
    /// Estimated time to the end of the stage (s).
    pub seconds_left: Option<f64>,
    /// Time since the program started (s).
    pub seconds: f64,
    /// Grains.
    pub grains: u32,
    /// Ranks.
    pub ranks: usize,
    /// The part of the time, 0 to 1, that a rank on the node of rank 0 waited for a core which
    /// other programs or ranks used: of the rank that waited longest.
    #[serde(default)]
    pub waited_for_cores: Option<f64>,
    /// The host of rank 0.
    pub host: String,
    /// The process of rank 0.
    pub pid: u32,
    /// When the program started (UTC).
    pub started: String,
    /// When this was written (UTC).
    pub updated: String,
}

impl Status {
    /// The part of the time that a rank waited for a core, if it is worth a word.
    pub fn long_wait(&self) -> Option<f64> {
        self.waited_for_cores.filter(|waited| *waited >= LONG_WAIT)
    }

    /// Writes the file into a folder, beside and renamed.
    ///
    /// # Errors
    /// The file cannot be written; an earlier one stays.
    pub fn write(&self, folder: &Path) -> std::io::Result<()> {
        let text = serde_json::to_string_pretty(self)? + "\n";
        text_writer::refresh(&folder.join(STATUS_FILE), text)
    }

    /// Reads the file of a folder, its texts on one line each; `None` if there is none, or another
    /// program wrote it.
    pub fn read(folder: &Path) -> Option<Self> {
        let text = text_writer::read(&folder.join(STATUS_FILE)).ok()?;
        let mut status: Self = serde_json::from_str(&text).ok()?;
        let texts = [&mut status.run_id, &mut status.title, &mut status.host];
        for text in texts.into_iter().chain(&mut status.message) {
            *text = on_one_line(text).into_owned();
        }
        status.progress.stage = on_one_line(&status.progress.stage).into_owned().into();
        Some(status)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_condition_follows_from_file_status_and_lock() {
        let text = r#"{"version":1,"state":"running","message":null,"run_id":"a","title":"",
            "stage":"shear","step":1,"steps":null,"fraction":null,"strain":null,
            "stress_ratio":null,"solid_fraction":null,"shear_stress":null,"speed":null,
            "seconds_left":null,"seconds":1.0,"grains":1,"ranks":1,"host":"","pid":1,"started":"",
            "updated":""}"#;
        let mut status: Status = serde_json::from_str(text).expect("a status");
        let words = |status: &Status, gone| RunCondition::of(false, Some(status), gone).to_string();
        assert_eq!(words(&status, false), "running");
        assert_eq!(words(&status, true), "killed: its process is gone");
        status.state = RunState::Stopped;
        assert!(words(&status, true).starts_with("stopped at a checkpoint"));
        status.state = RunState::Failed;
        status.message = Some("2 grains have left".into());
        assert_eq!(
            words(&status, true),
            "failed: 2 grains have left (stage shear)"
        );
        assert_eq!(
            RunCondition::of(true, Some(&status), true).name(),
            "finished"
        );
        assert_eq!(RunCondition::of(false, None, true).name(), "unfinished");
    }
}
