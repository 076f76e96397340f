//! Ranks that may have an MPI communicator.

use gshear_dem::domain::{Exchange, Solo};
use mpi::ffi::MPI_Comm;

/// A set of ranks that parallel libraries can address, such as HDF5.
pub trait Parallel: Exchange {
    /// The communicator of the ranks; `None` for a single process.
    fn communicator(&self) -> Option<MPI_Comm>;
}

impl Parallel for Solo {
    fn communicator(&self) -> Option<MPI_Comm> {
        None
    }
}
