//! How much of a stage its files hold.

use serde::{Deserialize, Serialize};

/// The number of frames and rows in the files of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Written {
    /// Frames.
    pub frames: u64,
    /// Rows of the time series.
    pub rows: u64,
    /// Rows of the scalars of frames.
    #[serde(default)]
    pub scalars: u64,
}

/// What the files of a resumed stage hold up to its checkpoint.
#[derive(Debug, Clone, Copy)]
pub struct UpToCheckpoint {
    /// Steps at the checkpoint.
    pub step: u64,
    /// The last step whose frame and row stay; `None`: none stays.
    pub last: Option<u64>,
}

impl UpToCheckpoint {
    /// After this step. A stage without steps begins anew and writes the row of step 0 again.
    pub fn new(step: u64) -> Self {
        Self {
            step,
            last: (step > 0).then_some(step),
        }
    }
}
