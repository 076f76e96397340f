//! Many ranks, by MPI.

use crate::hints::Hints;
use crate::launcher::{launched, launcher_variable, library_version, variable};
use crate::node::Node;
use crate::parallel::Parallel;
use crate::posted::{PostedHalo, PostedSum};
use crate::processor_time;
use crate::watchdog::{LoneFailure, Progress, Ranks, Waiting, Watchdog};
use gshear_dem::domain::{Exchange, HaloMessage, Traffic};
use gshear_dem::failure::{Failure, Result, printable};
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::io::Write;
use std::time::Duration;

use mpi::Threading;
use mpi::collective::SystemOperation;
use mpi::datatype::{Partition, PartitionMut};
use mpi::environment::Universe;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{AsRaw, Communicator, CommunicatorCollectives, Root};

/// All ranks of the job.
///
/// Dropping it ends MPI, so every file opened with its communicator must be closed before.
pub struct World {
    // Dropped before the node, whose memory it reads.
    watchdog: RefCell<Option<Watchdog>>,
    /// What a rank publishes that shares memory with no other.
    alone: &'static Progress,
    failure: LoneFailure,
    communicator: SimpleCommunicator,
    rank: usize,
    size: usize,
    /// Shared memory with the ranks on this node, if it is used.
    node: Option<Node>,
    hints: Option<Hints>,
    /// Halo messages that are under way, the first one first.
    halos: RefCell<VecDeque<Halo>>,
    /// Buffers of messages through the library that none uses.
    idle_buffers: RefCell<Vec<Vec<f64>>>,
    /// The sum that is under way through the library.
    posted_sum: RefCell<Option<PostedSum>>,
    traffic: Cell<Traffic>,
    /// Whether the processor time of waits is counted.
    counts_waits: Cell<bool>,
    // Dropped last: ends MPI.
    _universe: Universe,
}

/// A halo message under way to a neighbour, and one from it.
struct Halo {
    rank: usize,
    way: Way,
}

/// The way of a halo message.
enum Way {
    /// Shared memory, for so many numbers from the neighbour.
    SharedMemory(usize),
    /// The library.
    Library(PostedHalo),
}

/// Settings of libraries that the environment may override.
const LIBRARIES: [(&str, &str); 4] = [
    // The lock of a run's folder keeps other runs out, and not every file system has locks. With
    // them, a program that reads `run.h5` would keep the run from being continued.
    ("HDF5_USE_FILE_LOCKING", "FALSE"),
    // A halo message of 4 KiB just exceeds the default, above which a handshake comes first.
    ("OMPI_MCA_btl_vader_eager_limit", "16384"),
    // OMPIO takes a write that the system did in part for a whole one; ROMIO writes the rest.
    ("OMPI_MCA_io", "^ompio"),
    // A waiting rank yields its core. This costs nothing if each rank has one; with other work on
    // the cores, two ranks ran several times as fast.
    ("OMPI_MCA_mpi_yield_when_idle", "1"),
];

/// Settings of Open MPI for a rank that no launcher started, likewise: without a look for networks
/// it starts in half the time.
const ALONE: [(&str, &str); 2] = [("OMPI_MCA_btl", "self"), ("OMPI_MCA_pml", "ob1")];

/// If this is in rank 0's environment, all messages go through the MPI library.
const NO_SHARED_MEMORY: &str = "GSHEAR_NO_SHARED_MEMORY";

impl World {
    /// Starts MPI, under mpirun or as a single rank without it. Must be called once, at the start
    /// of `main`, while there is one thread.
    ///
    /// From then on, a panic on any rank prints its message and ends the whole job with exit code
    /// 1; otherwise the other ranks would wait for ever.
    ///
    /// # Panics
    /// If MPI has been started before.
    pub fn start() -> World {
        let mut settings = LIBRARIES.to_vec();
        if launcher_variable().is_none() {
            settings.extend(ALONE);
        }
        for (name, value) in settings {
            if std::env::var_os(name).is_none() {
                // SAFETY: the caller has started no other thread that could read the environment.
                unsafe { std::env::set_var(name, value) };
            }
        }
        let (universe, _) =
            mpi::initialize_with_threading(Threading::Funneled).expect("MPI is started once");
        let message = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            message(panic);
            if !mpi::environment::is_finalized() {
                SimpleCommunicator::world().abort(1);
            }
        }));
        let communicator = universe.world();
        // Rank 0 decides: the environments of other nodes may differ.
        let mut shares = [u8::from(std::env::var_os(NO_SHARED_MEMORY).is_none())];
        communicator
            .process_at_rank(0)
            .broadcast_into(&mut shares[..]);
        let shares = shares[0] == 1;
        let (rank, size) = (communicator.rank() as usize, communicator.size() as usize);
        World {
            watchdog: RefCell::default(),
            alone: Box::leak(Box::default()),
            failure: LoneFailure::default(),
            node: shares.then(|| Node::new(&communicator)).flatten(),
            hints: Hints::new(),
            halos: RefCell::default(),
            idle_buffers: RefCell::default(),
            posted_sum: RefCell::default(),
            traffic: Cell::default(),
            counts_waits: Cell::new(false),
            rank,
            size,
            communicator,
            _universe: universe,
        }
    }

    /// Ends every rank with this exit code, for a failure that only one rank knows, or after which
    /// files cannot be closed. Not collective.
    pub fn abort(&self, exit_code: i32) -> ! {
        if self.size == 1 {
            end_process(exit_code);
        }
        self.communicator.abort(exit_code)
    }

    /// Says so if this is one of several ranks that a launcher has started, but MPI's only one:
    /// each would run the whole scene.
    ///
    /// # Errors
    /// [`Failure::Input`] with the variable of the launcher.
    pub fn check_launcher(&self) -> Result<()> {
        match launched(variable, std::process::id()) {
            Some((name, ranks)) if self.size == 1 => Err(Failure::input(format!(
                "{name} says that this is one of {ranks} ranks, but MPI ({}) knows of one: another \
                 MPI's program started them; start them with its own mpirun, or srun --mpi=pmix. If \
                 each is to be a run of its own, remove {name} from its environment",
                library_version()
            ))),
            _ => Ok(()),
        }
    }

    /// Begins an operation of all ranks other than the halo and the sum of a step.
    fn operation(&self) -> Operation<'_> {
        Operation {
            _waiting: self.waiting(),
            wait: self.wait(OTHERS),
        }
    }

    /// Begins to wait.
    fn wait(&self, kind: usize) -> Wait<'_> {
        Wait {
            traffic: &self.traffic,
            kind,
            begun: self.counts_waits.get().then(processor_time),
        }
    }

    /// Runs an operation through shared memory, and counts its waits as of this kind.
    fn on_node(&self, node: &Node, kind: usize, operation: impl FnOnce()) {
        let before = node.waits();
        operation();
        let mut traffic = self.traffic.get();
        traffic.waits[kind] += node.waits() - before;
        self.traffic.set(traffic);
    }

    fn progress(&self) -> &Progress {
        self.node.as_ref().map_or(self.alone, Node::progress)
    }

    /// Counts and offsets of pieces (bytes) as MPI takes them, and the total.
    fn layout(lengths: impl Iterator<Item = usize>) -> (Vec<i32>, Vec<i32>, usize) {
        let (mut counts, mut starts, mut end) = (Vec::new(), Vec::new(), 0usize);
        for length in lengths {
            starts.push(end as i32);
            counts.push(length as i32);
            end += length;
            assert!(
                i32::try_from(end).is_ok(),
                "a message of more than 2 GiB: use more ranks"
            );
        }
        (counts, starts, end)
    }

    fn split(bytes: &[u8], counts: &[i32], starts: &[i32]) -> Vec<Vec<u8>> {
        let pieces = starts.iter().zip(counts);
        pieces
            .map(|(&s, &c)| bytes[s as usize..][..c as usize].to_vec())
            .collect()
    }
}

/// Places in [`Traffic::waits`].
const MESSAGES: usize = 0;
const SUMS: usize = 1;
const OTHERS: usize = 2;

/// A wait, until it is dropped.
struct Wait<'a> {
    traffic: &'a Cell<Traffic>,
    kind: usize,
    /// The processor time then (ns), if it is counted.
    begun: Option<u64>,
}

impl Drop for Wait<'_> {
    fn drop(&mut self) {
        if let Some(begun) = self.begun {
            let mut traffic = self.traffic.get();
            traffic.waits[self.kind] += processor_time() - begun;
            self.traffic.set(traffic);
        }
    }
}

/// An operation of all ranks, until it is dropped.
struct Operation<'a> {
    _waiting: Waiting<'a>,
    wait: Wait<'a>,
}

impl Drop for Operation<'_> {
    fn drop(&mut self) {
        let mut traffic = self.wait.traffic.get();
        traffic.others += 1;
        self.wait.traffic.set(traffic);
    }
}

/// The same bytes; an empty slice with a valid address. Rust gives an empty slice of bytes the
/// address 1, which is Open MPI's `MPI_IN_PLACE`. Receive buffers are a byte longer than needed for
/// the same reason.
fn addressable(bytes: &[u8]) -> &[u8] {
    if bytes.is_empty() { &[0][..0] } else { bytes }
}

/// Ends this process at once: nothing is closed. mpirun then ends the other ranks.
pub fn end_process(exit_code: i32) -> ! {
    let _ = std::io::stdout().flush();
    // SAFETY: it takes any number and does not return.
    unsafe { libc::_exit(exit_code) }
}

impl Parallel for World {
    fn waiting(&self) -> Waiting<'_> {
        self.progress().wait()
    }

    fn processes(&self) -> Vec<u32> {
        match &self.node {
            Some(node) => node.processes().to_vec(),
            None => vec![std::process::id()],
        }
    }

    fn lone_failure(&self) -> LoneFailure {
        self.failure.clone()
    }

    fn watch(&self, limit: Duration) {
        let ranks = match &self.node {
            // SAFETY: the watchdog is dropped before the node.
            Some(node) => unsafe { node.watched() },
            None => Ranks {
                here: vec![(self.rank, self.alone)],
                elsewhere: self.size > 1,
            },
        };
        let end = |message: &str| {
            let _ = writeln!(std::io::stderr(), "error: {}", printable(message));
            end_process(1);
        };
        *self.watchdog.borrow_mut() = Some(Watchdog::start(
            self.rank,
            limit,
            ranks,
            self.failure.clone(),
            end,
        ));
    }

    /// `None` for a single rank, for which HDF5's serial driver is faster.
    fn communicator(&self) -> Option<mpi::ffi::MPI_Comm> {
        (self.size > 1).then(|| self.communicator.as_raw())
    }

    fn hints(&self) -> Option<mpi::ffi::MPI_Info> {
        self.hints.as_ref().map(Hints::as_raw)
    }

    fn count_waits(&self) {
        self.counts_waits.set(true);
        if let Some(node) = &self.node {
            node.count_waits();
        }
    }
}

impl Exchange for World {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.size
    }

    fn is_near(&self) -> bool {
        self.size == 1 || self.node.as_ref().is_some_and(Node::holds_all)
    }

    fn all_to_all(&self, mut send: Vec<Vec<u8>>) -> Vec<Vec<u8>> {
        let _operation = self.operation();
        assert_eq!(send.len(), self.size, "a message for every rank");
        if self.size == 1 {
            return send;
        }
        let local = std::mem::take(&mut send[self.rank]);
        let (counts, starts, _) = Self::layout(send.iter().map(Vec::len));
        let mut arriving = vec![0i32; self.size];
        self.communicator
            .all_to_all_into(&counts[..], &mut arriving[..]);
        let (arriving, places, end) = Self::layout(arriving.iter().map(|&c| c as usize));
        let outgoing = send.concat();
        let mut incoming = vec![0u8; end + 1];
        self.communicator.all_to_all_varcount_into(
            &Partition::new(addressable(&outgoing), &counts[..], &starts[..]),
            &mut PartitionMut::new(&mut incoming[..], &arriving[..], &places[..]),
        );
        let mut received = Self::split(&incoming, &arriving, &places);
        received[self.rank] = local;
        received
    }

    fn begin_halo(&self, message: HaloMessage<'_>) {
        let HaloMessage {
            rank,
            length,
            write,
            expected,
        } = message;
        let mut traffic = self.traffic.get();
        traffic.messages[0] += 1;
        traffic.messages[1] += (size_of::<f64>() * length) as u64;
        self.traffic.set(traffic);
        let node = self.node.as_ref();
        let way = match node.filter(|node| node.connects(rank, length.max(expected))) {
            Some(node) => {
                // A mailbox may have to be emptied first.
                let _waiting = self.waiting();
                self.on_node(node, MESSAGES, || node.send(rank, length, write));
                Way::SharedMemory(expected)
            }
            None => {
                let mut idle = self.idle_buffers.borrow_mut();
                let buffers = [(); 2].map(|()| idle.pop().unwrap_or_default());
                Way::Library(PostedHalo::new(&self.communicator, message, buffers))
            }
        };
        self.halos.borrow_mut().push_back(Halo { rank, way });
    }

    fn end_halo(&self, rank: usize, read: &mut dyn FnMut(&[f64])) {
        let _waiting = self.waiting();
        let mut halos = self.halos.borrow_mut();
        let first = halos.iter().position(|halo| halo.rank == rank);
        let halo = first.and_then(|place| halos.remove(place));
        match (halo.map(|halo| halo.way), &self.node) {
            (Some(Way::SharedMemory(expected)), Some(node)) => {
                self.on_node(node, MESSAGES, || node.receive(rank, expected, read));
            }
            (Some(Way::Library(posted)), _) => {
                let wait = self.wait(MESSAGES);
                let [received, sent] = posted.end();
                drop(wait);
                read(&received);
                self.idle_buffers.borrow_mut().extend([received, sent]);
            }
            _ => panic!("no message is under way from rank {rank}"),
        }
    }

    fn begin_sum(&self, values: &[i64]) {
        if self.size > 1 {
            let mut traffic = self.traffic.get();
            traffic.sums[0] += 1;
            traffic.sums[1] += size_of_val(values) as u64;
            self.traffic.set(traffic);
        }
        if let Some(node) = self.node.as_ref().filter(|n| n.holds_all()) {
            node.begin_sum(values);
        } else if self.size > 1 {
            let posted = PostedSum::new(&self.communicator, values);
            *self.posted_sum.borrow_mut() = Some(posted);
        }
    }

    fn end_sum(&self, values: &mut [i64]) {
        let _waiting = self.waiting();
        if let Some(node) = self.node.as_ref().filter(|n| n.holds_all()) {
            self.on_node(node, SUMS, || node.end_sum(values));
        } else if let Some(posted) = self.posted_sum.borrow_mut().take() {
            let _wait = self.wait(SUMS);
            values.copy_from_slice(&posted.end());
        }
    }

    fn sum(&self, values: &mut [i64]) {
        let _operation = self.operation();
        if self.size > 1 {
            let posted = PostedSum::new(&self.communicator, values);
            values.copy_from_slice(&posted.end());
        }
    }

    fn sum_below(&self, value: u64) -> u64 {
        let _operation = self.operation();
        let mut below = 0u64;
        self.communicator
            .exclusive_scan_into(&value, &mut below, SystemOperation::sum());
        // MPI leaves rank 0's answer undefined.
        if self.rank == 0 { 0 } else { below }
    }

    /// NaN if the value of any rank is NaN, which MPI's own maximum does not guarantee.
    fn maximum(&self, value: f64) -> f64 {
        let _operation = self.operation();
        if self.size == 1 {
            return value;
        }
        let local = if value.is_nan() {
            [1.0, f64::NEG_INFINITY]
        } else {
            [0.0, value]
        };
        let mut all = [0.0; 2];
        self.communicator
            .all_reduce_into(&local[..], &mut all[..], SystemOperation::max());
        if all[0] > 0.0 { f64::NAN } else { all[1] }
    }

    fn gather(&self, bytes: &[u8]) -> Vec<Vec<u8>> {
        let _operation = self.operation();
        let mut lengths = vec![0u64; self.size];
        self.communicator
            .all_gather_into(&(bytes.len() as u64), &mut lengths[..]);
        let (counts, starts, end) = Self::layout(lengths.iter().map(|&l| l as usize));
        let mut all = vec![0u8; end + 1];
        self.communicator.all_gather_varcount_into(
            addressable(bytes),
            &mut PartitionMut::new(&mut all[..], &counts[..], &starts[..]),
        );
        Self::split(&all, &counts, &starts)
    }

    fn broadcast(&self, mut bytes: Vec<u8>) -> Vec<u8> {
        let _operation = self.operation();
        if self.size == 1 {
            return bytes;
        }
        let root = self.communicator.process_at_rank(0);
        let mut length = bytes.len() as u64;
        root.broadcast_into(&mut length);
        bytes.resize(length as usize, 0);
        if length > 0 {
            root.broadcast_into(&mut bytes[..]);
        }
        bytes
    }

    fn barrier(&self) {
        let _operation = self.operation();
        self.communicator.barrier();
    }

    fn traffic(&self) -> Traffic {
        self.traffic.get()
    }
}
