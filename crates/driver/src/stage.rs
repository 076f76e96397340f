//! A stage of a run, and the loop over its steps.

use gshear_dem::dimension::Dimension;
use gshear_dem::failure::{Failure, Result};
use gshear_store::status::StageProgress;

use crate::files::Files;
use crate::options::Outcome;
use crate::run::{Checkpoint, Run};

/// Steps of Newton's equations after which a stage looks whether the last checkpoint is old.
pub(crate) const CHECKPOINT_INTERVAL: u64 = 100;

/// Steps of Newton's equations between two states that are kept in memory: a copy takes as long as
/// some tens of steps.
const KEPT_STEPS: u64 = 50_000;

/// Whether a checkpoint is due after a step. A stop always writes one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Save {
    /// No checkpoint.
    No,
    /// If the last checkpoint is as old as `output.checkpoint_time`.
    IfOld,
    /// By the schedule of the stage.
    Now,
}

impl Save {
    /// After this step of the equations of motion. `scheduled`: by the schedule of the stage.
    pub(crate) fn after(step: u64, scheduled: bool) -> Self {
        if scheduled {
            Self::Now
        } else if step.is_multiple_of(CHECKPOINT_INTERVAL) {
            Self::IfOld
        } else {
            Self::No
        }
    }
}

/// A stage of a run, which takes one step at a time. Calls are collective.
pub(crate) trait Stage<'a, D: Dimension> {
    /// The name, as checkpoints and `status.json` have it.
    fn name(&self) -> &'static str;

    /// The name in messages.
    fn name_in_messages(&self) -> &'static str {
        self.name()
    }

    /// Number of completed steps.
    fn completed(&self) -> u64;

    /// The number by which `--stop-at` counts the next step; `None` if it does not count it.
    fn count(&self) -> Option<u64> {
        Some(self.completed() + 1)
    }

    /// The files of frames and time series; `None` of a stage without them.
    fn files(&mut self) -> Option<&mut Files>;

    /// Whether all steps are done.
    fn is_done(&self) -> bool;

    /// Whether the state before the first step is a checkpoint to keep, from which a window before
    /// the next one is replayed.
    fn keeps_start(&self) -> bool {
        false
    }

    /// Computes the forces of the initial state, before the first step. Not called when a stage
    /// resumes.
    ///
    /// # Errors
    /// Numbers that fail.
    fn begin(&mut self) -> Result<()>;

    /// Whether the last call of [`Stage::step`] took a part of a step only.
    fn is_within_step(&self) -> bool {
        false
    }

    /// Takes one step. `stop`: whether a stop was requested on this rank. Returns whether the run
    /// stops after this step, the same on every rank.
    ///
    /// # Errors
    /// Numbers that fail.
    fn step(&mut self, run: &mut Run<'_>, stop: bool) -> Result<bool>;

    /// Writes the output that is due after the last step.
    ///
    /// # Errors
    /// A file that cannot be written.
    fn record(&mut self, run: &mut Run<'_>) -> Result<()>;

    /// Whether a checkpoint is due after the last step.
    fn save_due(&self) -> Save;

    /// Checks that a run can go on from the state, before a checkpoint.
    ///
    /// # Errors
    /// A state that no run can go on from.
    fn check(&self, _: &Run<'_>) -> Result<()> {
        Ok(())
    }

    /// The state after the last step, and what was written up to it.
    ///
    /// # Errors
    /// A file that cannot be written.
    fn state(&mut self, run: &mut Run<'_>) -> Result<Checkpoint>;

    /// Whether the state after the last step is kept in memory, to be written if numbers fail
    /// before the next checkpoint.
    fn is_kept(&self) -> bool {
        self.completed().is_multiple_of(KEPT_STEPS)
    }

    /// Whether the state is sound although the last step has failed, because steps ran out.
    fn is_sound(&self) -> bool {
        false
    }

    /// The progress of the stage.
    fn progress(&self) -> StageProgress;

    /// Prints the lines of a log that are due after the last step.
    fn log(&mut self, _: &Run<'_>) {}
}

impl Run<'_> {
    /// Takes the steps of a stage until it is done or the run stops. `begins`: whether this is the
    /// start of the stage. Collective.
    ///
    /// # Errors
    /// Numbers that fail, with the stage's name before the message, or a file that cannot be
    /// written.
    pub(crate) fn drive<D: Dimension>(
        &mut self,
        stage: &mut dyn Stage<'_, D>,
        begins: bool,
    ) -> Result<Outcome> {
        let name = stage.name_in_messages();
        self.clear()?;
        self.terminal.begin(&stage.progress());
        self.keep_in_memory(stage)?;
        if begins {
            self.save_start(stage)
                .and_then(|()| stage.begin())
                .map_err(|failure| in_stage(failure, name))?;
            stage.record(self)?;
        }
        while !stage.is_done() {
            let stops = self.step(stage)?;
            let stopped = stops && !stage.is_done();
            self.save_if_due(stage, stopped)
                .map_err(|failure| in_stage(failure, name))?;
            stage.log(self);
            let step = stage.completed();
            let is_due = stage.is_within_step() || self.terminal.is_due(step);
            if is_due
                && self.terminal.progress(&stage.progress())
                && let Some(files) = stage.files()
            {
                files.publish();
            }
            if stopped {
                self.terminal.set(&stage.progress());
                self.terminal.stopped(&self.options.out, name, step);
                return Ok(Outcome::Stopped);
            }
        }
        self.terminal.clear();
        self.terminal.set(&stage.progress());
        Ok(Outcome::Done)
    }

    /// Takes a step and writes its output; returns whether the run stops after it.
    fn step<D: Dimension>(&mut self, stage: &mut dyn Stage<'_, D>) -> Result<bool> {
        let last = self.options.stop_at;
        let is_last = last.is_some() && stage.count() == last;
        let moved = stage.step(self, is_last);
        let recorded = moved.and_then(|stops| stage.record(self).map(|()| stops));
        if let Err(failure) = recorded {
            if stage.is_sound() {
                self.keep_in_memory(stage)?;
            }
            return Err(in_stage(failure, stage.name_in_messages()));
        }
        recorded
    }

    /// Writes a checkpoint if one is due after the last step, or keeps the state in memory if that
    /// is due.
    fn save_if_due<D: Dimension>(
        &mut self,
        stage: &mut dyn Stage<'_, D>,
        stopped: bool,
    ) -> Result<()> {
        let is_due = match stage.save_due() {
            _ if stopped => true,
            _ if self.options.replay.is_some() => false,
            Save::No => false,
            Save::Now => true,
            Save::IfOld => self.last_checkpoint_is_old(),
        };
        if is_due {
            stage.check(self)?;
            if let Some(files) = stage.files() {
                files.flush(self.exchange)?;
            }
            let checkpoint = stage.state(self)?;
            return self.save(&checkpoint);
        }
        if stage.is_kept() {
            self.keep_in_memory(stage)?;
        }
        Ok(())
    }

    /// Keeps the start of a stage as a checkpoint, if windows of the stage are replayed.
    fn save_start<D: Dimension>(&mut self, stage: &mut dyn Stage<'_, D>) -> Result<()> {
        let keeps = self.scene.keep_checkpoints && self.options.replay.is_none();
        if !(keeps && stage.keeps_start()) {
            return Ok(());
        }
        if let Some(files) = stage.files() {
            files.flush(self.exchange)?;
        }
        let checkpoint = stage.state(self)?;
        self.save(&checkpoint)
    }

    /// Keeps the state of a stage in memory, unless the sample is too large for that or the run is
    /// a replay; collective.
    fn keep_in_memory<D: Dimension>(&mut self, stage: &mut dyn Stage<'_, D>) -> Result<()> {
        // Room for the new one.
        self.sound = None;
        if self.keeps_states() {
            self.sound = Some(stage.state(self)?);
        }
        Ok(())
    }
}

/// Names the stage in which numbers fail.
fn in_stage(failure: Failure, stage: &str) -> Failure {
    match failure {
        Failure::Numbers(what) => Failure::Numbers(format!("{stage}, {what}")),
        other => other,
    }
}
