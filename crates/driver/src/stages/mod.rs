//! The stages of runs, and the programs made of them.

mod box_state;
mod newtonian;
mod pack;
mod prepare;
mod relax;
mod shear;
mod spectra_file;
mod spectrum;
mod strain;
pub mod walls;

pub mod periodic;

use gshear_dem::failure::Failure;

use crate::run::{Checkpoint, Run};

pub(crate) use self::strain::Row as StrainRow;

/// When the state after a step is saved. A stop saves it in any case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Save {
    /// Not.
    No,
    /// If the last checkpoint is a minute old.
    IfOld,
    /// By the schedule of the stage.
    Now,
}

/// A part of a run, step by step. Calls are collective.
pub trait Stage {
    /// The name in messages.
    fn name(&self) -> &'static str;

    /// Steps that are done.
    fn steps(&self) -> u64;

    /// The number by which `--stop-at` counts the next step; `None` if it does not count it.
    fn count(&self) -> Option<u64>;

    /// Whether all steps are done.
    fn is_done(&self) -> bool;

    /// Before the first step: forces of the initial state. Not called when a stage resumes.
    ///
    /// # Errors
    /// Numbers that fail.
    fn begin(&mut self, run: &mut Run<'_>) -> Result<(), Failure>;

    /// Takes one step. `stop`: a stop is asked for after it, beside signals and wall time. Returns
    /// whether the run stops, the same on every rank.
    ///
    /// # Errors
    /// Numbers that fail.
    fn step(&mut self, run: &mut Run<'_>, stop: bool) -> Result<bool, Failure>;

    /// Writes what is due after the last step.
    ///
    /// # Errors
    /// A file that cannot be written.
    fn record(&mut self, run: &mut Run<'_>) -> Result<(), Failure>;

    /// When the state after the last step is saved.
    fn save_due(&self) -> Save;

    /// Brings the files up to date and hands over the state.
    ///
    /// # Errors
    /// A file that cannot be written.
    fn checkpoint(&mut self, run: &mut Run<'_>) -> Result<Checkpoint, Failure>;

    /// Reports to the terminal.
    fn progress(&mut self, _: &mut Run<'_>) {}
}
