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
    /// The forces on grains of walls.
    pub load: WallSums,
    /// The failure, and its message.
    pub failure: Option<(Outside, String)>,
}

impl StepUnderWay {
    /// What the passes of a band share, whose grains have travelled so far since the list was made
    /// (m); `step`: the number of the step in its sweep.
    pub fn input_of_band(&self, travelled: f64, step: usize) -> PassInput {
        PassInput {
            travelled: Some(travelled),
            // The first step brings the band into the cache for those that follow.
            is_cold: self.input.is_cold && step == 0,
            ..self.input
        }
    }

    /// Adds what passes found, and what was outside the law.
    pub fn found(&mut self, outcome: PassOutcome, describe: impl Fn(Outside) -> String) {
        self.outcome = self.outcome.merge(outcome);
        for outside in outcome.failures() {
            self.fail(outside, &describe);
        }
    }

    /// Keeps a failure unless one of lower precedence is known. Describes it at once, because bands
    /// before this one may move on.
    pub fn fail(&mut self, outside: Outside, describe: impl FnOnce(Outside) -> String) {
        let known = self.failure.as_ref();
        if known.is_none_or(|(known, _)| outside.precedence() < known.precedence()) {
            self.failure = Some((outside, describe(outside)));
        }
    }
}
