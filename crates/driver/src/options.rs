//! What a run is asked for on the command line, and how it ends.

use std::path::PathBuf;
use std::time::Duration;

use gshear_scene::schedule::ReplayWindow;

/// How much a run prints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Verbosity {
    /// Errors and notes alone.
    Quiet,
    /// What is run, its progress, its results.
    #[default]
    Normal,
    /// Also checkpoints, every check of the packing, and on a terminal the lines that a log gets.
    Verbose,
}

/// Options of the command line other than the scene.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Folder of the results.
    pub out: PathBuf,
    /// Stop with a checkpoint after this step, as `Stage::count` counts it.
    pub stop_at: Option<u64>,
    /// Stop with a checkpoint after this time.
    pub wall_time: Option<Duration>,
    /// Threads inside each rank.
    pub threads: usize,
    /// Remove the run that the folder holds.
    pub overwrite: bool,
    /// Take the folder over from another process that holds its lock.
    pub break_lock: bool,
    /// Print what every rank did, and count processor time for it.
    pub profile: bool,
    /// How much is printed.
    pub verbosity: Verbosity,
    /// Compute only the steps from the checkpoint to the end of this window, without terminal
    /// output and into new files.
    pub replay: Option<ReplayWindow>,
}

impl Options {
    /// The wall time that is left after this time, if it is limited.
    pub(crate) fn wall_time_after(&self, elapsed: Duration) -> Option<Duration> {
        self.wall_time.map(|time| time.saturating_sub(elapsed))
    }
}

/// The outcome of a run that did not fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// All stages are done.
    Done,
    /// The run stopped at a checkpoint before its last step.
    Stopped,
}
