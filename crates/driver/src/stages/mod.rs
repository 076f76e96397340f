//! The stages of runs, and the sequences of stages of each kind of scene.

pub(crate) mod assembly;
pub mod between_walls;
mod box_state;
mod deform;
pub(crate) mod eigenvalues;
pub mod in_a_box;
pub(crate) mod newtonian;
mod pack;
pub(crate) mod prepare;
pub(crate) mod relax;
mod scatter;
pub(crate) mod shear;
pub(crate) mod spectra_file;
mod strain;
mod top_wall;

/// Names of the stages before those that [`gshear_store::run_reader::RunStage`] names, as messages,
/// checkpoints and `status.json` have them.
pub(crate) const PACK: &str = "pack";
pub(crate) const PREPARE: &str = "prepare";
