//! The threads of a rank beside the calling one, and parts of work for each.

use std::cell::OnceCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use crate::failure::{Failure, Result};

/// The threads of a rank, the calling one included.
#[derive(Debug)]
pub struct Workers {
    threads: usize,
    pool: Arc<rayon::ThreadPool>,
    /// Number of regions of parallel work that have begun.
    regions: Arc<AtomicU64>,
    /// Number of pieces of work of the present region that are not done, of other threads.
    pending: AtomicUsize,
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
            regions: Arc::default(),
            pending: AtomicUsize::new(0),
        }))
    }

    /// Runs `work`, which may spawn, and waits for what it spawned.
    pub fn region<'scope>(&'scope self, work: impl FnOnce(&Region<'scope, '_>)) {
        self.regions.fetch_add(1, Ordering::Release);
        self.pool.in_place_scope(|scope| {
            let workers = self;
            work(&Region { workers, scope });
            // The pool would have this thread sleep after some microseconds.
            wait_while(|| self.pending.load(Ordering::Acquire) > 0);
        });
        let here = self.regions.load(Ordering::Relaxed);
        for _ in 1..self.threads {
            let regions = Arc::clone(&self.regions);
            self.pool
                .spawn(move || wait_while(|| regions.load(Ordering::Acquire) == here));
        }
    }
}

/// A region of parallel work.
pub struct Region<'scope, 'pool> {
    workers: &'scope Workers,
    scope: &'pool rayon::Scope<'scope>,
}

impl<'scope> Region<'scope, '_> {
    /// Lets another thread do this work.
    pub fn spawn(&self, work: impl FnOnce() + Send + 'scope) {
        let pending = &self.workers.pending;
        pending.fetch_add(1, Ordering::Relaxed);
        self.scope.spawn(move |_| {
            work();
            pending.fetch_sub(1, Ordering::Release);
        });
    }
}

/// Waits while this holds, but not longer than [`AWAKE`].
fn wait_while(holds: impl Fn() -> bool) {
    let end = Instant::now() + AWAKE;
    loop {
        for _ in 0..POLLS {
            if !holds() {
                return;
            }
            std::hint::spin_loop();
        }
        if Instant::now() >= end {
            return;
        }
        std::thread::yield_now();
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
