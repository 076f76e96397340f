//! Messages and sums of the MPI library that are under way, with their buffers.

use std::mem::MaybeUninit;

use gshear_dem::domain::HaloMessage;
use mpi::collective::SystemOperation;
use mpi::datatype::Equivalence;
use mpi::ffi;
use mpi::topology::SimpleCommunicator;
use mpi::traits::AsRaw;

use crate::node::copy_chosen;

/// Requests of the library. Their buffers must live until they are done, which dropping waits for.
struct Requests<const N: usize>([ffi::MPI_Request; N]);

impl<const N: usize> Requests<N> {
    /// Waits until all are done.
    fn wait(&mut self) {
        for request in &mut self.0 {
            // SAFETY: the request is one of the library's, which replaces it by the null request,
            // for which waiting ends at once; it writes the status, which is not read.
            unsafe {
                let mut status = MaybeUninit::uninit();
                ffi::MPI_Wait(request, status.as_mut_ptr());
            }
        }
    }
}

impl<const N: usize> Drop for Requests<N> {
    fn drop(&mut self) {
        self.wait();
    }
}

/// A message to a rank, and one from it.
pub(crate) struct PostedHalo {
    // Dropped before the buffers.
    requests: Requests<2>,
    received: Vec<f64>,
    _sent: Vec<f64>,
}

impl PostedHalo {
    pub fn new(communicator: &SimpleCommunicator, message: HaloMessage<'_>) -> Self {
        let HaloMessage {
            rank,
            width,
            records,
            chosen,
            expected,
        } = message;
        let mut sent = vec![0.0; chosen.len() * width];
        copy_chosen(records, width, chosen, &mut sent);
        let mut received = vec![0.0; expected];
        let count = |numbers: &[f64]| i32::try_from(numbers.len()).expect("a short message");
        // SAFETY: the buffers have as many numbers as the calls say, their memory stays in place
        // when the vectors move, and dropping the requests, which comes first, waits for both.
        let requests = unsafe {
            let mut requests = [ffi::RSMPI_REQUEST_NULL; 2];
            let number = f64::equivalent_datatype().as_raw();
            ffi::MPI_Irecv(
                received.as_mut_ptr().cast(),
                count(&received),
                number,
                rank as i32,
                TAG,
                communicator.as_raw(),
                &raw mut requests[0],
            );
            ffi::MPI_Isend(
                sent.as_ptr().cast(),
                count(&sent),
                number,
                rank as i32,
                TAG,
                communicator.as_raw(),
                &raw mut requests[1],
            );
            requests
        };
        Self {
            requests: Requests(requests),
            received,
            _sent: sent,
        }
    }

    /// Waits for both messages. Returns the one that was received.
    pub fn end(self) -> Vec<f64> {
        let Self {
            mut requests,
            received,
            _sent,
        } = self;
        requests.wait();
        received
    }
}

/// That of halo messages.
const TAG: i32 = 1;

/// A sum over all ranks.
pub(crate) struct PostedSum {
    // Dropped before the buffers.
    request: Requests<1>,
    sums: Vec<u64>,
    _terms: Vec<u64>,
}

impl PostedSum {
    pub fn new(communicator: &SimpleCommunicator, values: &[i64]) -> Self {
        // As u64, whose overflow wraps by definition.
        let terms: Vec<u64> = values.iter().map(|&value| value as u64).collect();
        let mut sums = vec![0; terms.len()];
        // SAFETY: as in `PostedHalo::new`.
        let request = unsafe {
            let mut request = ffi::RSMPI_REQUEST_NULL;
            ffi::MPI_Iallreduce(
                terms.as_ptr().cast(),
                sums.as_mut_ptr().cast(),
                i32::try_from(terms.len()).expect("few terms"),
                u64::equivalent_datatype().as_raw(),
                SystemOperation::sum().as_raw(),
                communicator.as_raw(),
                &raw mut request,
            );
            request
        };
        Self {
            request: Requests([request]),
            sums,
            _terms: terms,
        }
    }

    /// Waits for the sums.
    pub fn end(self) -> Vec<i64> {
        let Self {
            mut request,
            sums,
            _terms,
        } = self;
        request.wait();
        sums.into_iter().map(|sum| sum as i64).collect()
    }
}
