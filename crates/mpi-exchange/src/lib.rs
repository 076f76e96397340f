//! The ranks of an MPI job as an [`Exchange`](gshear_dem::domain::Exchange).

mod node;
mod parallel;
mod world;

pub use parallel::Parallel;
pub use world::World;
