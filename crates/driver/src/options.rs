//! Options of the command line of a run.

use std::path::PathBuf;
use std::time::Duration;

use gshear_scene::schedule::ReplayWindow;

/// Options of the command line other than the scene.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Folder of the results.
    pub out: PathBuf,
    /// Stop with a checkpoint after this step, as [`crate::run::Stage::count`] counts it.
    pub stop_at: Option<u64>,
    /// Stop with a checkpoint after this time.
    pub wall_time: Option<Duration>,
    /// Threads inside each rank.
    pub threads: usize,
    /// Remove the run that the folder holds.
    pub overwrite: bool,
    /// Take the folder over from another process that holds its lock.
    pub break_lock: bool,
    /// Compute only the steps from the checkpoint to the end of this window, without terminal
    /// output and into new files.
    pub replay: Option<ReplayWindow>,
}
