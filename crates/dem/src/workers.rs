//! The threads of a rank beside the calling one, and parts of work for each.

use std::cell::OnceCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::thread::Thread;
use std::time::{Duration, Instant};

use crate::failure::{Failure, Result};
use crate::processor::{PieceTimes, ThreadClock};

/// The threads of a rank, the calling one included.
#[derive(Debug)]
pub struct Workers {
    threads: usize,
    pool: Arc<rayon::ThreadPool>,
    shared: Arc<Shared>,
    /// Nanoseconds of all regions until now.
    nanoseconds: Arc<AtomicU64>,
    /// The processor time of their pieces, if it is counted.
    times: Option<Arc<PieceTimes>>,
}

/// What the threads tell each other.
#[derive(Debug, Default)]
struct Shared {
    /// Whether a region of parallel work has begun and not ended. Stays true after a panic, until
    /// the end of the next region.
    is_within: AtomicBool,
    /// Number of pieces of work of the present region that other threads were given and that are
    /// not done.
    pending: AtomicUsize,
    /// Number of threads that watch for regions, or have been asked to.
    watching: AtomicUsize,
    /// Number of regions that are to come in which no thread yields its core: other processes want
    /// it.
    crowded: AtomicU64,
    /// Logarithm to base 2 of the number of regions that the next long yield makes crowded.
    severity: AtomicU64,
    /// Number of regions since the last crowded one, modulo [`UNDISTURBED`].
    undisturbed: AtomicU64,
}

thread_local! {
    /// The pool of this thread, which is one of its threads. A thread belongs to one pool as long
    /// as it lives; with fewer threads than a later caller asks for, its work is still done.
    static POOL: OnceCell<Arc<rayon::ThreadPool>> = const { OnceCell::new() };
}

/// How long an idle thread waits for the next region of a step before it sleeps, and the calling
/// thread for the others at the end of a region. To wake a thread takes longer than most waits.
const AWAKE: Duration = Duration::from_micros(500);

/// Polls between two yields of a thread that waits: about a microsecond.
const POLLS: usize = 32;
/// Polls before it sleeps, where others want its core: longer than from one region to the next.
const POLLS_CROWDED: usize = 1024;

/// A yield that takes so long has given the core to another process.
const LONG_YIELD: Duration = Duration::from_micros(200);
/// Logarithms to base 2 of the least and greatest number of regions without yields after a long
/// one: twice as many after each that follows such regions soon, so that a process that wants the
/// core for a moment costs little, and one that goes on costs a long yield in thousands of regions.
const SEVERITY: [u64; 2] = [5, 13];
/// Number of regions with yields after which a long one is less severe.
const UNDISTURBED: u64 = 1000;

impl Workers {
    /// Starts so many threads, the calling one included; `None`: it is the only one.
    ///
    /// # Errors
    /// If they cannot be started.
    pub fn start(threads: usize) -> Result<Option<Self>> {
        if threads <= 1 {
            return Ok(None);
        }
        let pool = POOL.with(|pool| {
            if let Some(pool) = pool.get() {
                return Ok(Arc::clone(pool));
            }
            let begun = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .use_current_thread()
                .build()
                .map_err(|e| Failure::Other(format!("{threads} threads: {e}")))?;
            Ok(Arc::clone(pool.get_or_init(|| Arc::new(begun))))
        })?;
        Ok(Some(Self {
            threads,
            pool,
            shared: Arc::default(),
            nanoseconds: Arc::default(),
            times: None,
        }))
    }

    /// Counts the processor time of the pieces of work by this clock.
    pub(crate) fn count_times(&mut self, clock: ThreadClock) {
        self.times = Some(Arc::new(PieceTimes::new(clock)));
    }

    /// The processor time of the pieces of work, if it is counted.
    pub(crate) fn times(&self) -> Option<&Arc<PieceTimes>> {
        self.times.as_ref()
    }

    /// Nanoseconds of all regions until now.
    pub fn nanoseconds(&self) -> &Arc<AtomicU64> {
        &self.nanoseconds
    }

    /// Runs `work`, which may spawn, and waits for what it spawned.
    pub fn region<'scope>(&'scope self, work: impl FnOnce(&Region<'scope, '_>)) {
        let shared = &self.shared;
        let begun = Instant::now();
        let times = self.times.as_deref();
        let region_of_times = times.map(PieceTimes::region);
        shared.begin_region();
        shared.is_within.store(true, Ordering::Release);
        while shared.watching.load(Ordering::Acquire) + 1 < self.threads {
            shared.watching.fetch_add(1, Ordering::Relaxed);
            let shared = Arc::clone(shared);
            self.pool.spawn(move || shared.watch());
        }
        self.pool.in_place_scope(|scope| {
            let region = Region {
                shared,
                caller: std::thread::current(),
                times,
                scope,
            };
            PieceTimes::piece(times, || work(&region));
            // What no thread has begun: they have no core.
            let is_pending = || shared.pending.load(Ordering::Acquire) > 0;
            while is_pending() && rayon::yield_local() == Some(rayon::Yield::Executed) {}
            let mut patience = Patience::new(shared);
            while is_pending() && patience.waits() {}
            // The pool would have this thread yield its core.
            while is_pending() {
                std::thread::park();
            }
        });
        shared.is_within.store(false, Ordering::Release);
        drop(region_of_times);
        let nanoseconds = begun.elapsed().as_nanos() as u64;
        self.nanoseconds.fetch_add(nanoseconds, Ordering::Relaxed);
    }
}

impl Shared {
    /// Counts a region, crowded or not.
    fn begin_region(&self) {
        let crowded = self.crowded.load(Ordering::Relaxed);
        if crowded > 0 {
            self.crowded.store(crowded - 1, Ordering::Relaxed);
            self.undisturbed.store(0, Ordering::Relaxed);
            return;
        }
        let undisturbed = 1 + self.undisturbed.load(Ordering::Relaxed);
        self.undisturbed
            .store(undisturbed % UNDISTURBED, Ordering::Relaxed);
        if undisturbed == UNDISTURBED {
            let severity = self.severity.load(Ordering::Relaxed).saturating_sub(1);
            self.severity.store(severity, Ordering::Relaxed);
        }
    }

    /// Makes the next regions crowded, after a long yield.
    fn crowd(&self) {
        let [least, most] = SEVERITY;
        let severity = self.severity.load(Ordering::Relaxed).clamp(least, most);
        self.severity.store(severity + 1, Ordering::Relaxed);
        self.crowded.store(1 << severity, Ordering::Relaxed);
    }

    /// Runs pieces of one region after the other, until none begins for a while. A thread that
    /// slept between two regions would be woken too late for most of them.
    fn watch(&self) {
        // The first thread of the pool calls regions.
        if rayon::current_thread_index() != Some(0) {
            let mut patience = Patience::new(self);
            while patience.waits() {
                let is_within = self.is_within.load(Ordering::Acquire);
                if is_within && rayon::yield_now() == Some(rayon::Yield::Executed) {
                    patience = Patience::new(self);
                }
            }
        }
        self.watching.fetch_sub(1, Ordering::Release);
    }
}

/// How long a thread goes on waiting awake: [`AWAKE`], by polls, and yielding the core while only
/// fellow threads want it.
struct Patience<'a> {
    shared: &'a Shared,
    polls: usize,
    end: Instant,
}

impl<'a> Patience<'a> {
    fn new(shared: &'a Shared) -> Self {
        Self {
            shared,
            polls: 0,
            end: Instant::now() + AWAKE,
        }
    }

    /// Waits a moment. Returns whether to wait on.
    fn waits(&mut self) -> bool {
        std::hint::spin_loop();
        self.polls += 1;
        let is_crowded = self.shared.crowded.load(Ordering::Relaxed) > 0;
        if self.polls < if is_crowded { POLLS_CROWDED } else { POLLS } {
            return true;
        }
        self.polls = 0;
        let before = Instant::now();
        if is_crowded || before >= self.end {
            return false;
        }
        std::thread::yield_now();
        if before.elapsed() >= LONG_YIELD {
            self.shared.crowd();
        }
        true
    }
}

/// A region of parallel work.
pub struct Region<'scope, 'pool> {
    shared: &'scope Shared,
    /// The thread that waits for its end.
    caller: Thread,
    times: Option<&'scope PieceTimes>,
    scope: &'pool rayon::Scope<'scope>,
}

impl<'scope> Region<'scope, '_> {
    /// Lets another thread do this work.
    pub fn spawn(&self, work: impl FnOnce() + Send + 'scope) {
        self.shared.pending.fetch_add(1, Ordering::Relaxed);
        let piece = Piece {
            pending: &self.shared.pending,
            caller: self.caller.clone(),
        };
        let times = self.times;
        self.scope.spawn(move |_| {
            let _piece = piece;
            PieceTimes::piece(times, work);
        });
    }
}

/// A piece of work of a region, which is done when this is dropped, after a panic, too.
struct Piece<'a> {
    pending: &'a AtomicUsize,
    caller: Thread,
}

impl Drop for Piece<'_> {
    fn drop(&mut self) {
        if self.pending.fetch_sub(1, Ordering::Release) == 1 {
            self.caller.unpark();
        }
    }
}

/// Number of threads, the first one included.
pub fn count(workers: Option<&Workers>) -> usize {
    workers.map_or(1, |workers| workers.threads)
}

/// Does the work on every part, the first one on this thread.
pub fn each<T: Send>(
    workers: Option<&Workers>,
    parts: &mut [T],
    work: impl Fn(usize, &mut T) + Sync,
) {
    let mut parts = parts.iter_mut().enumerate();
    let Some(workers) = workers else {
        return parts.for_each(|(k, part)| work(k, part));
    };
    workers.region(|region| {
        let (work, first) = (&work, parts.next());
        for (k, part) in parts {
            region.spawn(move || work(k, part));
        }
        if let Some((k, part)) = first {
            work(k, part);
        }
    });
}

/// Splits off the elements of a slice from `at` on.
pub fn tail<'a, T>(slice: &mut &'a [T], at: usize) -> &'a [T] {
    let (before, after) = slice.split_at(at);
    *slice = before;
    after
}

/// [`tail`] of elements that may be changed.
#[expect(clippy::mut_mut, reason = "the slice itself is changed")]
pub(crate) fn tail_mut<'a, T>(slice: &mut &'a mut [T], at: usize) -> &'a mut [T] {
    let (before, after) = std::mem::take(slice).split_at_mut(at);
    *slice = before;
    after
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every part is done once, whatever threads the pool of this thread has: it keeps those of the
    /// first who asked. Threads that sleep between two regions do theirs, too.
    #[test]
    fn every_part_is_done_once() {
        for threads in [1, 3, 2, 5] {
            let workers = Workers::start(threads).expect("threads");
            assert_eq!(count(workers.as_ref()), threads);
            for parts in [1, threads, 7] {
                let mut numbers = vec![0; parts];
                for pause in [Duration::ZERO, AWAKE / 10, 4 * AWAKE] {
                    std::thread::sleep(pause);
                    each(workers.as_ref(), &mut numbers, |k, number| *number += k + 1);
                }
                let expected: Vec<usize> = (1..=parts).map(|k| 3 * k).collect();
                assert_eq!(numbers, expected, "{threads} threads");
            }
        }
    }

    /// A piece that panics ends the region with it, and leaves nothing to wait for.
    #[test]
    fn a_panic_ends_the_region() {
        let workers = Workers::start(2).expect("threads");
        for _ in 0..2 {
            let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                each(workers.as_ref(), &mut [0; 4], |k, _| assert_ne!(k, 2));
            }));
            assert!(outcome.is_err());
        }
        let mut numbers = [0; 4];
        each(workers.as_ref(), &mut numbers, |k, number| *number = k);
        assert_eq!(numbers, [0, 1, 2, 3]);
    }

    /// They are done as well where the threads were started by another one.
    #[test]
    fn another_thread_may_use_them() {
        let workers = Workers::start(3).expect("threads");
        let mut numbers = vec![0; 5];
        std::thread::scope(|scope| {
            scope.spawn(|| each(workers.as_ref(), &mut numbers, |k, number| *number = k));
        });
        assert_eq!(numbers, [0, 1, 2, 3, 4]);
    }
}
