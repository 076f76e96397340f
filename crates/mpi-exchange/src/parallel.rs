//! Ranks that may have an MPI communicator.

use gshear_dem::domain::{Exchange, Solo};
use mpi::ffi::{MPI_Comm, MPI_Info};
use std::time::Duration;

use crate::watchdog::{LoneFailure, Waiting};

/// A set of ranks that parallel libraries can address, such as HDF5.
pub trait Parallel: Exchange {
    /// The communicator of the ranks; `None` for a single process.
    fn communicator(&self) -> Option<MPI_Comm>;

    /// Hints for MPI-IO.
    fn hints(&self) -> Option<MPI_Info> {
        None
    }

    /// Marks that this rank waits for other ranks or for files until the result is dropped; calls
    /// of [`Exchange`] mark themselves. Not collective.
    fn waiting(&self) -> Waiting<'_> {
        Waiting::UNWATCHED
    }

    /// Where this rank notes that it has failed in a collective operation, until all ranks know.
    /// Not collective.
    fn lone_failure(&self) -> LoneFailure {
        LoneFailure::default()
    }

    /// The processes of the ranks on this node, as far as it knows them: at least this one.
    fn processes(&self) -> Vec<u32> {
        vec![std::process::id()]
    }

    /// From now on, counts the processor time of waits ([`Exchange::traffic`]). Not collective.
    fn count_waits(&self) {}

    /// From now on, ends the job with a message that names the rank if a rank has waited so long
    /// and no rank of its node computes. On several nodes ten times as long, since the ranks of
    /// other nodes are not seen. A few seconds after a [`LoneFailure`] with that message. Not
    /// collective.
    fn watch(&self, _: Duration) {}
}

impl Parallel for Solo {
    fn communicator(&self) -> Option<MPI_Comm> {
        None
    }
}
