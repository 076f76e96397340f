//! The ranks of an MPI job as an [`Exchange`](gshear_dem::domain::Exchange).

#![allow(
    unsafe_code,
    reason = "MPI's C interface, shared memory, and the environment of Open MPI"
)]

mod node;
mod parallel;
mod world;

pub use parallel::Parallel;
pub use world::World;
