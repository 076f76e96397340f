//! The ranks of an MPI job as a [`gshear_dem::domain::Exchange`].
//!
//! [`World`] is all ranks of the job, by rsmpi. Ranks of one node exchange halo messages and sums
//! through shared memory, which takes less than a microsecond; other messages go through the MPI
//! library. The results are the same bits on both ways. [`Parallel`] adds the communicator that a
//! parallel library such as HDF5 needs, and also holds for the single rank of
//! [`gshear_dem::domain::Solo`].
//!
//! ```no_run
//! use gshear_dem::domain::Exchange;
//! use gshear_mpi_exchange::World;
//!
//! // First in `main`: before any thread starts.
//! let world = World::start();
//! let mut count = [1];
//! world.sum(&mut count);
//! assert_eq!(count[0] as usize, world.size());
//! ```
//!
//! Run it under mpirun; without it, there is one rank. A panic on any rank ends the whole job with
//! exit code 1. Environment variables:
//!
//! | variable | effect |
//! | --- | --- |
//! | `GSHEAR_NO_SHARED_MEMORY` | if set on rank 0, all messages go through the MPI library |
//! | `OMPI_MCA_btl_vader_eager_limit` | 16384 unless set, so that a halo message needs no handshake |
//! | `OMPI_MCA_io` | `^ompio` unless set, because OMPIO loses the rest of a short write |
//! | `ROMIO_HINTS` | hints for MPI-IO; unless set, each rank writes for itself |
//! | `OMPI_MCA_btl`, `OMPI_MCA_pml` | of a rank without a launcher `self` and `ob1` unless set, so that it looks for no networks |
//! | `OMPI_MCA_mpi_yield_when_idle` | 1 unless set, so that waiting ranks yield their core |
//!
//! The [contracts](gshear_dem#contracts) hold on any number of ranks: every sum is one of integers,
//! which do not depend on the order.

#![allow(
    unsafe_code,
    reason = "MPI's C interface, shared memory, and the environment of Open MPI"
)]

mod hints;
mod launcher;
mod node;
mod parallel;
mod posted;
mod processor;
mod watchdog;
mod world;

pub use launcher::{ForeignLauncher, launcher_variable, library_version};
pub use parallel::Parallel;
pub use processor::processor_time;
pub use watchdog::{LoneFailure, Waiting};
pub use world::{World, end_process};
