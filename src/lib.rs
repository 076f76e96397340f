//! gshear-mpi: discrete element shear of frictional granular packings on MPI ranks, and its reducer.
//!
//! Read `step` first; `docs/` has the scheme, the contracts and the file formats.

pub mod analysis;
pub mod config;
pub mod contact;
pub mod domain;
pub mod failure;
pub mod io;
pub mod reduce;
pub mod report;
pub mod state;
