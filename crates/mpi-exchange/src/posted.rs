//! Messages and sums of the MPI library that are under way, with their buffers.

use std::mem::MaybeUninit;

use gshear_dem::domain::HaloMessage;
use mpi::collective::SystemOperation;
use mpi::datatype::Equivalence;
use mpi::ffi;
use mpi::topology::SimpleCommunicator;
use mpi::traits::AsRaw;

/// A request of the library. Its buffer must live until it is done, which dropping waits for.
struct Request(ffi::MPI_Request);

impl Request {
    /// Waits until it is done. Returns its status.
    fn wait(&mut self) -> ffi::MPI_Status {
        let mut status = MaybeUninit::zeroed();
        // SAFETY: the request is one of the library's, which replaces it by the null request, for
        // which waiting ends at once; all bits 0 are a valid status.
        unsafe {
            ffi::MPI_Wait(&raw mut self.0, status.as_mut_ptr());
            status.assume_init()
        }
    }
}

impl Drop for Request {
    fn drop(&mut self) {
        self.wait();
    }
}

/// A message to a rank, and one from it.
pub(crate) struct PostedHalo {
    // Dropped before the buffers.
    receive: Request,
    send: Request,
    received: Vec<f64>,
    sent: Vec<f64>,
}

impl PostedHalo {
    /// Begins a message in these buffers, whatever they hold.
    pub fn new(
        communicator: &SimpleCommunicator,
        message: HaloMessage<'_>,
        [mut sent, mut received]: [Vec<f64>; 2],
    ) -> Self {
        let HaloMessage {
            rank,
            length,
            write,
            expected,
        } = message;
        sent.resize(length, 0.0);
        write(&mut sent);
        received.resize(expected, 0.0);
        let count = |numbers: &[f64]| i32::try_from(numbers.len()).expect("a short message");
        // SAFETY: the buffers have as many numbers as the calls say, their memory stays in place
        // when the vectors move, and dropping the requests, which comes first, waits for both.
        let [receive, send] = unsafe {
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
            receive: Request(receive),
            send: Request(send),
            received,
            sent,
        }
    }

    /// Waits for both messages. Returns that of the other rank, and the buffer of this rank's.
    ///
    /// # Panics
    /// If it has another length than was expected.
    pub fn end(mut self) -> [Vec<f64>; 2] {
        let status = self.receive.wait();
        self.send.wait();
        let mut count = 0;
        // SAFETY: the status is that of a message of numbers of this type.
        unsafe {
            let number = f64::equivalent_datatype().as_raw();
            ffi::MPI_Get_count(&raw const status, number, &raw mut count);
        }
        let expected = self.received.len();
        assert_eq!(count as usize, expected, "length of a neighbour's message");
        [&mut self.received, &mut self.sent].map(std::mem::take)
    }
}

/// That of halo messages.
const TAG: i32 = 1;

/// A sum over all ranks.
pub(crate) struct PostedSum {
    // Dropped before the buffers.
    request: Request,
    sums: Vec<u64>,
    _terms: Vec<u64>,
}

impl PostedSum {
    pub fn new(communicator: &SimpleCommunicator, values: &[i64]) -> Self {
        // As u64, whose overflow wraps by definition. One message for all values: its latency
        // exceeds the time for a few thousand numbers.
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
            request: Request(request),
            sums,
            _terms: terms,
        }
    }

    /// Waits for the sums.
    pub fn end(mut self) -> Vec<i64> {
        self.request.wait();
        self.sums.iter().map(|&sum| sum as i64).collect()
    }
}
