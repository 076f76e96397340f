//! The stages of runs, and the sequences of stages of each kind of scene.

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
