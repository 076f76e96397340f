//! The stages of runs, and the sequences of stages of each kind of scene.

mod box_state;
mod deform;
pub(crate) mod newtonian;
mod pack;
pub mod periodic;
pub(crate) mod prepare;
pub(crate) mod relax;
mod rest;
mod scatter;
pub(crate) mod setup;
pub(crate) mod shear;
mod spectra_file;
mod spectrum;
mod strain;
mod top_wall;
pub mod walls;

/// Names of the stages before those that [`gshear_store::run_reader::RunStage`] names, as messages,
/// checkpoints and `status.json` have them.
pub(crate) const PACK: &str = "pack";
pub(crate) const PREPARE: &str = "prepare";
