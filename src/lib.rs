//! gshear-mpi: discrete element shear of frictional granular packings on MPI ranks, and its reducer.
//!
//! Read `step` first; `docs/` has the scheme, the contracts and the file formats.

pub mod analysis;
pub mod clock;
pub mod config;
pub mod contact;
pub mod dimension;
pub mod domain;
pub mod drive;
pub mod failure;
pub mod io;
pub mod kernel;
pub mod launch;
pub mod ledger;
pub mod neighbour;
pub mod observe;
pub mod packing;
pub mod periodic;
pub mod record;
pub mod reduce;
pub mod report;
pub mod run;
pub mod sample;
pub mod schedule;
pub mod signals;
pub mod simd;
pub mod state;
pub mod step;
pub mod system;
pub mod team;
pub mod terminal;
