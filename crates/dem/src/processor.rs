//! Processor time: what a thread has computed, whatever else its core did meanwhile. It is counted
//! where a run is profiled, because to read it takes some tenths of a microsecond.

use std::sync::atomic::{AtomicU64, Ordering};

/// Processor time of the calling thread (ns).
pub type ThreadClock = fn() -> u64;

/// Processor times of regions of parallel work until now (ns).
#[derive(Debug)]
pub struct PieceTimes {
    clock: ThreadClock,
    /// Of all pieces.
    all: AtomicU64,
    /// Of the longest piece of each region.
    longest: AtomicU64,
    /// Of the calling thread in regions, with its waits.
    caller: AtomicU64,
    /// Of the longest piece of the present region.
    greatest: AtomicU64,
}

impl PieceTimes {
    pub(crate) fn new(clock: ThreadClock) -> Self {
        Self {
            clock,
            all: AtomicU64::new(0),
            longest: AtomicU64::new(0),
            caller: AtomicU64::new(0),
            greatest: AtomicU64::new(0),
        }
    }

    /// Begins a region, which ends when the result is dropped.
    pub(crate) fn region(&self) -> RegionTimes<'_> {
        RegionTimes {
            times: self,
            begun: (self.clock)(),
        }
    }

    /// Does a piece of work of a region, and counts its time if `times` are given.
    pub(crate) fn piece(times: Option<&Self>, work: impl FnOnce()) {
        let Some(times) = times else {
            return work();
        };
        let begun = (times.clock)();
        work();
        let taken = (times.clock)() - begun;
        times.all.fetch_add(taken, Ordering::Relaxed);
        times.greatest.fetch_max(taken, Ordering::Relaxed);
    }

    /// Of all pieces, of the longest ones, and of the calling thread.
    pub(crate) fn until_now(&self) -> [u64; 3] {
        [&self.all, &self.longest, &self.caller].map(|time| time.load(Ordering::Relaxed))
    }
}

/// A region whose processor time is counted.
pub(crate) struct RegionTimes<'a> {
    times: &'a PieceTimes,
    begun: u64,
}

impl Drop for RegionTimes<'_> {
    fn drop(&mut self) {
        let times = self.times;
        let taken = (times.clock)() - self.begun;
        times.caller.fetch_add(taken, Ordering::Relaxed);
        let greatest = times.greatest.swap(0, Ordering::Relaxed);
        times.longest.fetch_add(greatest, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    thread_local! {
        /// The processor time of this thread.
        static NOW: Cell<u64> = const { Cell::new(0) };
    }

    fn compute(nanoseconds: u64) {
        NOW.set(NOW.get() + nanoseconds);
    }

    #[test]
    fn a_region_takes_as_long_as_its_longest_piece() {
        let times = PieceTimes::new(|| NOW.get());
        for pieces in [[30, 50, 20], [60, 10, 40]] {
            let region = times.region();
            std::thread::scope(|scope| {
                for piece in &pieces[1..] {
                    scope.spawn(|| PieceTimes::piece(Some(&times), || compute(*piece)));
                }
            });
            PieceTimes::piece(Some(&times), || compute(pieces[0]));
            // The calling thread waits, which is no piece.
            compute(5);
            drop(region);
            compute(1000);
        }
        assert_eq!(times.until_now(), [210, 50 + 60, 30 + 60 + 2 * 5]);
    }
}
