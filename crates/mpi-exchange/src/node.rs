//! Messages between ranks of one node through shared memory (MPI-3 shared windows).
//!
//! A message is a copy and a counter, which takes a fraction of a microsecond; through the library
//! it takes a few.

use std::cell::Cell;
use std::ops::Range;
use std::ptr::null_mut;
use std::slice::{from_raw_parts, from_raw_parts_mut};
use std::sync::atomic::{AtomicI64, AtomicU32, Ordering};
use std::time::{Duration, Instant};

use crate::processor_time;
use crate::watchdog::{Progress, Ranks};
use mpi::ffi;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{AsRaw, Communicator, CommunicatorCollectives};
use rustix::thread::{CpuSet, futex, sched_setaffinity};

/// Greatest number of values in a sum.
pub(crate) const MOST_TERMS: usize = 31;
/// Room for a message (f64): about 4,000 records. Longer messages go through the library.
pub(crate) const MOST_NUMBERS: usize = 1 << 15;

/// A number that one rank raises and others wait for, modulo 2³²: none is further behind than a
/// few.
#[repr(C, align(128))]
struct Counter {
    number: AtomicU32,
    /// Number of ranks that sleep, or are about to, until the number changes. Only they count it:
    /// a reset by the rank that raises could lose one that is about to sleep.
    sleeps: AtomicU32,
}

impl Counter {
    /// Raises the number, and wakes the ranks that sleep until it is.
    fn raise(&self, to: u64) {
        // In one order for all ranks: either this one sees `sleeps`, or the other one the number.
        self.number.store(to as u32, Ordering::SeqCst);
        if self.sleeps.load(Ordering::SeqCst) != 0 {
            let _ = futex::wake(&self.number, futex::Flags::empty(), i32::MAX as u32);
        }
    }

    /// [`Counter::wait`], whose processor time is counted if it is to be.
    fn wait_for(&self, number: u64, patience: &Patience) {
        let Some(before) = patience.waits.get() else {
            return self.wait(number, patience);
        };
        let begun = processor_time();
        self.wait(number, patience);
        patience.waits.set(Some(before + processor_time() - begun));
    }

    /// Waits until the number has been raised to this one: by polls, then yielding the core, and
    /// asleep if others want it or it takes long.
    fn wait(&self, number: u64, patience: &Patience) {
        let is_raised = |to: u32| to.wrapping_sub(number as u32) as i32 >= 0;
        let sleeps = patience.sleeps_next();
        let polls = if sleeps {
            POLLS_CROWDED
        } else {
            patience.polls
        };
        for _ in 0..polls {
            if is_raised(self.number.load(Ordering::Acquire)) {
                return;
            }
            std::hint::spin_loop();
        }
        if !sleeps {
            let begun = Instant::now();
            let mut last = begun;
            while patience.at_once.get() == 0 && last - begun < LONGEST_YIELDING {
                std::thread::yield_now();
                let now = Instant::now();
                if now - last >= LONG_YIELD {
                    patience.sleep_from_now();
                }
                last = now;
                if is_raised(self.number.load(Ordering::Acquire)) {
                    return;
                }
            }
        }
        loop {
            self.sleeps.fetch_add(1, Ordering::SeqCst);
            let seen = self.number.load(Ordering::SeqCst);
            if !is_raised(seen) {
                // It ends at once if the number has changed; after an error, too, look again.
                let _ = futex::wait(&self.number, futex::Flags::empty(), seen, None);
            }
            self.sleeps.fetch_sub(1, Ordering::SeqCst);
            if is_raised(self.number.load(Ordering::SeqCst)) {
                return;
            }
        }
    }
}

/// How a rank waits. To yield the core takes a microsecond where only fellow ranks want it, which
/// is less than to sleep and to be woken, but a slice of the time of any other process,
/// milliseconds a step, one of the lowest priority, too.
struct Patience {
    /// Polls before this rank yields.
    polls: u32,
    /// Number of waits that are to come without yields.
    at_once: Cell<u32>,
    /// Where this rank runs; `None` if that may not be changed.
    binding: Option<Binding>,
    /// Processor time of all waits (ns), if it is counted.
    waits: Cell<Option<u64>>,
}

impl Patience {
    /// Begins a wait. Returns whether it is to sleep without yields.
    fn sleeps_next(&self) -> bool {
        let left = self.at_once.get();
        self.at_once.set(left.saturating_sub(1));
        if left == 1
            && let Some(binding) = &self.binding
        {
            binding.restore();
        }
        left > 0
    }

    /// Lets the next waits sleep: other processes want this core.
    fn sleep_from_now(&self) {
        if self.at_once.replace(SLEEPS) == 0
            && let Some(binding) = &self.binding
        {
            binding.lift();
        }
    }
}

/// The processor to which a launcher has bound this rank, and those that it has given to all ranks
/// of the node. A rank that is woken while another process has its own processor waits there for
/// milliseconds, though a fellow's may be free.
struct Binding {
    own: CpuSet,
    node: CpuSet,
}

impl Binding {
    /// `allowed`: the processors of each rank of the node, [`CPU_WORDS`] words a rank; `rank`: this
    /// one among them. `None` if it has all of them already, or the system does not say.
    fn new(allowed: &[u64], rank: usize) -> Option<Self> {
        let own = cpu_set(&allowed[rank * CPU_WORDS..][..CPU_WORDS]);
        let node = cpu_set(&cpus_of_ranks(allowed));
        (own.count() > 0 && own != node).then_some(Self { own, node })
    }

    /// Lets this thread run on all processors of the node's ranks.
    fn lift(&self) {
        let _ = sched_setaffinity(None, &self.node);
    }

    /// Binds this thread again.
    fn restore(&self) {
        let _ = sched_setaffinity(None, &self.own);
    }
}

/// A yield that takes so long has given the core to another process, or to a rank with as much to
/// do.
const LONG_YIELD: Duration = Duration::from_micros(200);
/// After so long a wait sleeps. Linux may choose a rank that yields again and again: one has kept
/// everything else from a core for a minute.
const LONGEST_YIELDING: Duration = Duration::from_millis(50);
/// Number of waits without yields after a long one, so that it costs little a wait.
const SLEEPS: u32 = 1000;

/// A rank's terms of a sum, on separate cache lines.
#[repr(C, align(128))]
struct Terms {
    /// Number of sums for which this rank has written its terms.
    count: Counter,
    term: [AtomicI64; MOST_TERMS],
}

/// A mailbox for messages of one rank to one neighbour.
#[repr(C, align(128))]
struct Mailbox {
    /// Number of messages written.
    sent: Counter,
    /// Number of messages read, counted by the neighbour.
    taken: Counter,
    message: [f64; MOST_NUMBERS],
}

/// The part of the shared memory that one rank writes and the others read. Terms and mailboxes
/// exist twice and are used in turn, because a rank may be one message ahead.
#[repr(C)]
struct SharedSlot {
    progress: Progress,
    terms: [Terms; 2],
    /// Mailboxes to the next rank, and to the rank before.
    mailboxes: [[Mailbox; 2]; 2],
}

/// The shared memory of the ranks on this node.
pub(crate) struct Node {
    /// By rank in the job; null for ranks on other nodes.
    slots: Vec<*mut SharedSlot>,
    rank: usize,
    sums: Cell<u64>,
    /// Number of messages sent to, and received from, the next rank and the rank before.
    sent: [Cell<u64>; 2],
    received: [Cell<u64>; 2],
    patience: Patience,
    processes: Vec<u32>,
    window: ffi::MPI_Win,
    // Dropped after the window.
    _communicator: SimpleCommunicator,
}

impl Node {
    /// Allocates the shared memory; collective. `None` if this rank is alone on its node.
    pub fn new(world: &SimpleCommunicator) -> Option<Self> {
        let communicator = world.split_shared(world.rank());
        let here = communicator.size();
        if here == 1 {
            return None;
        }
        let mut ranks = vec![0i32; here as usize];
        communicator.all_gather_into(&world.rank(), &mut ranks[..]);
        let mut processes = vec![0u32; here as usize];
        communicator.all_gather_into(&std::process::id(), &mut processes[..]);
        let mut allowed = vec![0u64; here as usize * CPU_WORDS];
        communicator.all_gather_into(&allowed_cpus()[..], &mut allowed[..]);
        let polls = if here as usize <= number_of_cpus(&allowed) {
            POLLS_ALONE
        } else {
            POLLS_CROWDED
        };
        let mut slots = vec![null_mut(); world.size() as usize];
        // A slot begins at the first multiple of its alignment, the same offset on all ranks
        // because memory is shared by pages.
        let room = (size_of::<SharedSlot>() + align_of::<SharedSlot>()).next_multiple_of(4096);
        // SAFETY: the calls are collective over `communicator`; the out pointers are valid; the
        // library returns memory of at least `room` bytes that lives until the window is freed, set
        // to zero by the system, and zeros are a valid slot.
        let window = unsafe {
            let mut window = ffi::RSMPI_WIN_NULL;
            let mut local: *mut u8 = null_mut();
            ffi::MPI_Win_allocate_shared(
                room as ffi::MPI_Aint,
                1,
                ffi::RSMPI_INFO_NULL,
                communicator.as_raw(),
                (&raw mut local).cast(),
                &raw mut window,
            );
            for (k, &rank) in ranks.iter().enumerate() {
                let (mut size, mut unit) = (0, 0);
                let mut begin: *mut u8 = null_mut();
                ffi::MPI_Win_shared_query(
                    window,
                    k as i32,
                    &raw mut size,
                    &raw mut unit,
                    (&raw mut begin).cast(),
                );
                assert!(size as usize >= room, "the window holds a slot");
                slots[rank as usize] = begin
                    .add(begin.align_offset(align_of::<SharedSlot>()))
                    .cast();
            }
            window
        };
        communicator.barrier();
        Some(Self {
            slots,
            rank: world.rank() as usize,
            sums: Cell::new(0),
            sent: Default::default(),
            received: Default::default(),
            patience: Patience {
                polls,
                at_once: Cell::new(0),
                binding: Binding::new(&allowed, communicator.rank() as usize),
                waits: Cell::new(None),
            },
            processes,
            window,
            _communicator: communicator,
        })
    }

    /// From now on counts the processor time of waits.
    pub fn count_waits(&self) {
        self.patience.waits.set(Some(0));
    }

    /// Processor time of all waits (ns), if it is counted.
    pub fn waits(&self) -> u64 {
        self.patience.waits.get().unwrap_or_default()
    }

    /// The processes of the ranks on this node.
    pub fn processes(&self) -> &[u32] {
        &self.processes
    }

    /// What this rank publishes.
    pub fn progress(&self) -> &Progress {
        // SAFETY: the slot lives as long as the window, and its counters are atomic.
        unsafe { &(*self.slots[self.rank]).progress }
    }

    /// What the ranks of this node publish.
    ///
    /// # Safety
    /// It must not be used after this node has been dropped.
    pub unsafe fn watched(&self) -> Ranks {
        let ranks = self.slots.iter().enumerate();
        let here = ranks.filter(|(_, slot)| !slot.is_null());
        Ranks {
            // SAFETY: the slot lives as long as the window, beyond which the caller does not use
            // it, and its counters are atomic.
            here: here
                .map(|(rank, &slot)| (rank, unsafe { &(*slot).progress }))
                .collect(),
            elsewhere: !self.holds_all(),
        }
    }

    /// Whether all ranks of the job are on this node.
    pub(crate) fn holds_all(&self) -> bool {
        self.slots.iter().all(|d| !d.is_null())
    }

    /// The mailbox for messages from `from` to `to`: 0 to the next rank, 1 to the rank before;
    /// `None` if there is none.
    fn direction(&self, from: usize, to: usize) -> Option<usize> {
        let size = self.slots.len();
        if self.slots[from].is_null() || self.slots[to].is_null() || from == to {
            None
        } else if to == (from + 1) % size {
            Some(0)
        } else if from == (to + 1) % size {
            Some(1)
        } else {
            None
        }
    }

    /// Whether messages of at most this many numbers from and to this rank use shared memory. Both
    /// ranks get the same answer.
    pub(crate) fn connects(&self, rank: usize, numbers: usize) -> bool {
        numbers <= MOST_NUMBERS && self.direction(self.rank, rank).is_some()
    }

    /// Lets `write` write a message of `numbers` into the neighbour's mailbox.
    ///
    /// # Panics
    /// If [`Node::connects`] is false.
    pub fn send(&self, to: usize, numbers: usize, write: &dyn Fn(&mut [f64])) {
        let direction = self.direction(self.rank, to).expect("a neighbour");
        assert!(numbers <= MOST_NUMBERS, "a message that fits");
        let number = self.sent[direction].get() + 1;
        self.sent[direction].set(number);
        // SAFETY: the slot lives as long as the window. What is written is read by the neighbour
        // only between `sent` reaching this number and its own `taken`, and this rank last used
        // this mailbox for the message before the last, which the neighbour has taken. Until then
        // no other rank accesses the message, which is aligned as the mailbox and was set to zero
        // once.
        unsafe {
            let slot = self.slots[self.rank];
            let mailbox = &raw mut (*slot).mailboxes[direction][number as usize % 2];
            (*mailbox)
                .taken
                .wait_for(number.saturating_sub(2), &self.patience);
            let message = (&raw mut (*mailbox).message).cast::<f64>();
            write(from_raw_parts_mut(message, numbers));
            (*mailbox).sent.raise(number);
        }
    }

    /// Waits for a message of `numbers` in a neighbour's mailbox, and lets `read` read it.
    ///
    /// # Panics
    /// If [`Node::connects`] is false.
    pub fn receive(&self, from: usize, numbers: usize, read: &mut dyn FnMut(&[f64])) {
        let direction = self.direction(from, self.rank).expect("a neighbour");
        assert!(numbers <= MOST_NUMBERS, "a message that fits");
        let number = self.received[direction].get() + 1;
        self.received[direction].set(number);
        // SAFETY: the slot lives as long as the window. The neighbour has written the message
        // before `sent`, and writes no other into this mailbox before `taken`.
        unsafe {
            let slot = self.slots[from];
            let mailbox = &raw mut (*slot).mailboxes[direction][number as usize % 2];
            (*mailbox).sent.wait_for(number, &self.patience);
            let message = (&raw const (*mailbox).message).cast::<f64>();
            read(from_raw_parts(message, numbers));
            (*mailbox).taken.raise(number);
        }
    }

    /// The terms of the present sum of a rank of this node.
    fn terms(&self, rank: usize) -> &Terms {
        let slot = self.slots[rank];
        assert!(!slot.is_null(), "all ranks are here");
        // SAFETY: the slot lives as long as the window, and terms are atomic.
        unsafe { &(*slot).terms[self.sums.get() as usize % 2] }
    }

    /// Begins an element-wise sum over the ranks. [`Node::end_sum`] must follow before the next.
    ///
    /// A few ranks read each other's terms. Of more, each adds those of [`BRANCHES`] others to its
    /// own, so that a tree comes together at rank 0, whose sum all of them read.
    ///
    /// # Panics
    /// If there are more than [`MOST_TERMS`] values.
    pub fn begin_sum(&self, values: &[i64]) {
        assert!(values.len() <= MOST_TERMS, "few terms");
        self.sums.set(self.sums.get() + 1);
        if self.branches().is_none_or(|branches| branches.is_empty()) {
            self.write_terms(values);
        }
    }

    /// Waits for the sum over the ranks, wrapping, of these values.
    ///
    /// # Panics
    /// If not all ranks are on this node.
    pub fn end_sum(&self, values: &mut [i64]) {
        let Some(branches) = self.branches() else {
            for rank in (0..self.slots.len()).filter(|&r| r != self.rank) {
                self.add_terms(rank, values);
            }
            return;
        };
        if !branches.is_empty() {
            for rank in branches {
                self.add_terms(rank, values);
            }
            self.write_terms(values);
        }
        if self.rank != 0 {
            values.fill(0);
            self.add_terms(0, values);
        }
    }

    /// The ranks whose sums this one adds to its terms; `None` if all read each other's.
    fn branches(&self) -> Option<Range<usize>> {
        let size = self.slots.len();
        (size > BRANCHES).then(|| branches(self.rank, size))
    }

    /// Writes this rank's terms of the present sum. All ranks have read those of the sum before the
    /// last, because they did so before they wrote their terms of the last one.
    fn write_terms(&self, values: &[i64]) {
        let local = self.terms(self.rank);
        for (to, value) in local.term.iter().zip(values) {
            to.store(*value, Ordering::Relaxed);
        }
        local.count.raise(self.sums.get());
    }

    /// Adds the terms of another rank, when it has written them.
    fn add_terms(&self, rank: usize, values: &mut [i64]) {
        let other = self.terms(rank);
        other.count.wait_for(self.sums.get(), &self.patience);
        for (sum, term) in values.iter_mut().zip(&other.term) {
            *sum = sum.wrapping_add(term.load(Ordering::Relaxed));
        }
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        // SAFETY: the window was made in `new` and is freed once, by all ranks of the node.
        unsafe {
            ffi::MPI_Win_free(&raw mut self.window);
        }
    }
}

/// Ranks whose terms another one adds to its own, in a sum of more ranks.
const BRANCHES: usize = 8;

/// The ranks whose sums a rank of so many adds to its terms.
fn branches(rank: usize, size: usize) -> Range<usize> {
    let first = BRANCHES * rank + 1;
    first.min(size)..(first + BRANCHES).min(size)
}

/// Polls before a rank yields its core, if there are more ranks than cores: about two microseconds.
/// More would delay the other ranks.
const POLLS_CROWDED: u32 = 50;

/// The same if every rank has a core: some tenths of a millisecond. To yield takes longer than most
/// waits.
const POLLS_ALONE: u32 = 5000;

/// Words of 64 bits for the processors that a process may use.
const CPU_WORDS: usize = 32;

/// The processors that this process may use, a bit for each; none if the system does not say.
fn allowed_cpus() -> [u64; CPU_WORDS] {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    parse_cpus(&status).unwrap_or([0; CPU_WORDS])
}

/// The line `Cpus_allowed` of a `status` file: words of 32 bits in hexadecimal, the last one first
/// in number.
fn parse_cpus(status: &str) -> Option<[u64; CPU_WORDS]> {
    let mask = status
        .lines()
        .find_map(|line| line.strip_prefix("Cpus_allowed:"))?;
    let mut cpus = [0; CPU_WORDS];
    for (k, word) in mask.trim().rsplit(',').take(2 * CPU_WORDS).enumerate() {
        cpus[k / 2] |= u64::from(u32::from_str_radix(word, 16).ok()?) << (32 * (k % 2));
    }
    Some(cpus)
}

/// The processors that some of the ranks may use.
fn cpus_of_ranks(allowed: &[u64]) -> [u64; CPU_WORDS] {
    let mut all = [0; CPU_WORDS];
    for cpus in allowed.chunks_exact(CPU_WORDS) {
        for (all, cpus) in all.iter_mut().zip(cpus) {
            *all |= cpus;
        }
    }
    all
}

/// The number of processors that some of the ranks may use.
fn number_of_cpus(allowed: &[u64]) -> usize {
    let count = |word: u64| word.count_ones() as usize;
    cpus_of_ranks(allowed).into_iter().map(count).sum()
}

/// The processors, as the system takes them; those beyond the most that it can name are left out.
fn cpu_set(cpus: &[u64]) -> CpuSet {
    let mut set = CpuSet::new();
    for cpu in 0..CpuSet::MAX_CPU.min(64 * cpus.len()) {
        if cpus[cpu / 64] >> (cpu % 64) & 1 == 1 {
            set.set(cpu);
        }
    }
    set
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn processors_are_counted_over_the_ranks() {
        let cpus = |mask: &str| parse_cpus(&format!("Name:\tx\nCpus_allowed:\t{mask}\n"));
        let [first, second] = ["1", "2"].map(|mask| cpus(mask).expect("a mask"));
        assert_eq!(number_of_cpus(&[first, second].concat()), 2);
        assert_eq!(number_of_cpus(&[first, first].concat()), 1);
        let wide = cpus("ffffffff,00000000,00000003").expect("a mask");
        assert_eq!(wide[..3], [3, 0xffff_ffff, 0]);
        assert_eq!(number_of_cpus(&[wide, second].concat()), 34);
        assert_eq!((cpus("what"), parse_cpus("Name:\tx")), (None, None));
    }

    #[test]
    fn every_rank_but_the_first_is_a_branch_of_one_before_it() {
        for size in [9, 10, 64, 73, 74, 200] {
            let all = (0..size).flat_map(|rank| branches(rank, size));
            assert!(all.eq(1..size), "{size}");
            let is_before = |rank| branches(rank, size).all(|branch| rank < branch);
            assert!((0..size).all(is_before), "{size}");
        }
    }

    /// Two ranks, each bound to one of the processors of this test: one whose yield took long runs
    /// on both for the waits that sleep, then on its own again.
    #[test]
    fn a_rank_whose_core_others_want_runs_where_its_fellows_do() {
        let all = allowed_cpus();
        let numbers = (0..64 * CPU_WORDS).filter(|cpu| all[cpu / 64] >> (cpu % 64) & 1 == 1);
        let numbers: Vec<usize> = numbers.take(2).collect();
        let [first, second] = numbers[..] else {
            return;
        };
        let one = |cpu: usize| {
            let mut cpus = [0; CPU_WORDS];
            cpus[cpu / 64] = 1 << (cpu % 64);
            cpus
        };
        let ranks = [one(first), one(second)].concat();
        sched_setaffinity(None, &cpu_set(&one(second))).expect("its own processor");
        let patience = Patience {
            polls: 1,
            at_once: Cell::new(0),
            binding: Binding::new(&ranks, 1),
            waits: Cell::new(None),
        };
        assert!(!patience.sleeps_next());
        assert_eq!(thread_cpus(), cpu_set(&one(second)));
        patience.sleep_from_now();
        for _ in 1..SLEEPS {
            assert!(patience.sleeps_next());
            assert_eq!(thread_cpus(), cpu_set(&cpus_of_ranks(&ranks)));
        }
        assert!(patience.sleeps_next());
        assert!(!patience.sleeps_next());
        assert_eq!(thread_cpus(), cpu_set(&one(second)));
        // Ranks that a launcher has not bound stay so.
        assert!(Binding::new(&[all, all].concat(), 0).is_none());
    }

    fn thread_cpus() -> CpuSet {
        rustix::thread::sched_getaffinity(None).expect("affinity")
    }
}
