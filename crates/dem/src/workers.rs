//! The threads of a rank beside the calling one, and parts of work for each.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::failure::{Failure, Result};

/// The threads beside the first.
#[derive(Debug)]
pub struct Workers {
    pool: rayon::ThreadPool,
    /// Number of regions of parallel work that have begun.
    regions: Arc<AtomicU64>,
}

/// How long an idle thread waits for the next region of a step before it sleeps. To wake a thread
/// takes longer than most waits.
const AWAKE: Duration = Duration::from_micros(500);

impl Workers {
    /// Starts so many threads, the calling one included; `None`: it is the only one.
    ///
    /// # Errors
    /// If they cannot be started.
    pub fn start(threads: usize) -> Result<Option<Self>> {
        if threads <= 1 {
            return Ok(None);
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads - 1)
            .build()
            .map_err(|e| Failure::Other(format!("{threads} threads: {e}")))?;
        Ok(Some(Self {
            pool,
            regions: Arc::default(),
        }))
    }

    /// Runs `work`, which may spawn, and waits for what it spawned.
    pub fn region<'scope>(&self, work: impl FnOnce(&rayon::Scope<'scope>)) {
        self.regions.fetch_add(1, Ordering::Release);
        self.pool.in_place_scope(work);
        let regions = self.regions.clone();
        let here = regions.load(Ordering::Relaxed);
        self.pool.spawn_broadcast(move |_| {
            let end = Instant::now() + AWAKE;
            while regions.load(Ordering::Acquire) == here && Instant::now() < end {
                std::thread::yield_now();
            }
        });
    }
}

/// Number of threads, the first one included.
pub fn count(workers: Option<&Workers>) -> usize {
    workers.map_or(1, |workers| 1 + workers.pool.current_num_threads())
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
    workers.region(|scope| {
        let (work, first) = (&work, parts.next());
        for (k, part) in parts {
            scope.spawn(move |_| work(k, part));
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
