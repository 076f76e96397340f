//! Runs of gshear-mpi: a sequence of stages, from a scene or a checkpoint to the last file.
//!
//! A scene between walls is packed and sheared; a periodic box is prepared, strained
//! quasi-statically and, with a table `[newtonian]`, moved by Newton's equations. Each of these is
//! a [`run::Stage`]; stops, signals, wall time, checkpoints and the terminal are in [`run`], once
//! for all of them.

pub mod files;
pub mod folder;
mod frame_scalars;
pub mod header;
pub mod launch;
mod lock;
pub mod record;
pub mod run;
pub mod signals;
pub mod stages;
pub mod sweep;
mod terminal;
