//! A step that goes through the bands.

use crate::drive::{FlowSum, WallSums};
use crate::failure::Outside;
use crate::kernel::{PassInput, PassOutcome};
use crate::motion::GrainMotion;

/// A step, and what it has found in the bands so far.
#[derive(Debug)]
pub(crate) struct StepUnderWay {
    /// What moves the grains.
    pub motion: GrainMotion,
    /// What its passes share.
    pub input: PassInput,
    /// The greatest speed (m/s).
    pub fastest: f64,
    /// How far the grains of the last band moved at most (m).
    pub way: f64,
    /// The flow of momentum.
    pub flow: FlowSum,
    /// What the passes found.
    pub outcome: PassOutcome,
    /// What that of the pairs within the shares found, where it followed the motion at once.
    pub within_shares: Option<PassOutcome>,
    /// The forces on grains of walls.
    pub load: WallSums,
    /// The failure, and its message.
    pub failure: Option<(Outside, String)>,
}

impl StepUnderWay {
    /// Keeps a failure unless one of lower precedence is known. Describes it at once, because bands
    /// before this one may move on.
    pub fn fail(&mut self, outside: Outside, describe: impl FnOnce(Outside) -> String) {
        let known = self.failure.as_ref();
        if known.is_none_or(|(known, _)| outside.precedence() < known.precedence()) {
            self.failure = Some((outside, describe(outside)));
        }
    }
}
