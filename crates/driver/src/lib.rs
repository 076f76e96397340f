//! Runs of gshear-mpi: stages, files, terminal, sweeps.

pub mod launch;
pub mod periodic;
pub mod record;
pub mod run;
pub mod signals;
pub mod terminal;
