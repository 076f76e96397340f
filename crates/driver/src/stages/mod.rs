//! The stages of runs, and the programs made of them.

mod box_state;
mod newtonian;
mod pack;
mod prepare;
mod relax;
mod setup;
mod shear;
mod spectra_file;
mod spectrum;
mod strain;
pub mod walls;

pub mod periodic;
