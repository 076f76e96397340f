//! The discrete element method of gshear-mpi.

pub mod budget;
pub mod clock;
pub mod columns;
pub mod contact;
pub mod dimension;
pub mod domain;
pub mod drive;
pub mod failure;
pub mod kernel;
pub mod laws;
pub mod neighbour;
pub mod observe;
pub mod protocol;
pub mod simd;
pub mod state;
pub mod step;
pub mod system;
pub mod threads;
