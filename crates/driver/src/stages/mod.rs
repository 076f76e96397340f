//! The stages of runs, and the order in which they follow each other.

pub(crate) mod assembly;
mod box_state;
mod deform;
pub(crate) mod eigenvalues;
pub(crate) mod newtonian;
mod own_columns;
mod pack;
pub(crate) mod prepare;
mod quasi_static;
pub(crate) mod relax;
mod scatter;
pub(crate) mod sequence;
pub(crate) mod shear;
mod shearing;
pub(crate) mod spectra_file;
mod strain;
mod stress_search;
mod top_wall;

/// Names of the stages before those that [`gshear_scene::RunStage`] names, as messages,
/// checkpoints and `status.json` have them.
pub(crate) const PACK: &str = "pack";
pub(crate) const PREPARE: &str = "prepare";
