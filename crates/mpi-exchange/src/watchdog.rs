//! Ends a job whose ranks wait for ever, and names the rank that does not answer.
//!
//! Every rank publishes whether it waits, in an operation with other ranks or files, and how many
//! operations it has begun. A thread of each rank counts seconds, so a stopped process is told from
//! one that computes.

use std::io::Write;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What a rank publishes. Valid if all zero.
#[repr(C, align(128))]
#[derive(Default)]
pub struct Progress {
    /// Operations begun.
    operations: AtomicU64,
    /// Operations that this rank is in, one inside the other.
    depth: AtomicU64,
    /// Seconds counted by the thread.
    seconds: AtomicU64,
    process: AtomicU64,
}

impl Progress {
    fn waits(&self) -> bool {
        self.depth.load(Ordering::Relaxed) > 0
    }

    /// Marks the beginning of an operation, which ends when the result is dropped.
    pub fn wait(&self) -> Waiting<'_> {
        // Only this rank's main thread writes them.
        let next = |counter: &AtomicU64| {
            counter.store(counter.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
        };
        next(&self.operations);
        next(&self.depth);
        Waiting(Some(self))
    }
}

/// An operation with other ranks or files, for as long as this lives.
#[must_use = "the operation ends when this is dropped"]
pub struct Waiting<'a>(Option<&'a Progress>);

impl Waiting<'_> {
    /// The operation of a rank without a watchdog.
    pub(crate) const UNWATCHED: Waiting<'static> = Waiting(None);
}

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        if let Some(progress) = self.0 {
            let depth = progress.depth.load(Ordering::Relaxed);
            progress.depth.store(depth - 1, Ordering::Relaxed);
        }
    }
}

/// A failure of this rank in a collective operation. The other ranks may not know of it, and wait
/// in that operation for ever: the watchdog then ends the job with this failure.
#[derive(Clone, Default)]
pub struct LoneFailure(Arc<Mutex<Noted>>);

#[derive(Default)]
struct Noted {
    cause: Option<String>,
    failure: Option<String>,
}

impl LoneFailure {
    /// Stores the failure of an operation, unless there is an earlier one.
    pub fn note(&self, message: &str) {
        self.lock().failure.get_or_insert_with(|| message.into());
    }

    /// Stores the cause of a failure, which is told if the operation does not end.
    pub fn note_cause(&self, message: &str) {
        self.lock().cause.get_or_insert_with(|| message.into());
    }

    /// All ranks know of it.
    pub fn clear(&self) {
        *self.lock() = Noted::default();
    }

    fn message(&self) -> Option<String> {
        let noted = self.lock();
        noted.failure.as_ref().or(noted.cause.as_ref()).cloned()
    }

    fn lock(&self) -> MutexGuard<'_, Noted> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The ranks that a watchdog sees.
pub struct Ranks {
    /// Rank and progress of those on this node, in order.
    pub here: Vec<(usize, &'static Progress)>,
    /// Whether there are others on other nodes.
    pub elsewhere: bool,
}

/// The thread of a rank.
pub(crate) struct Watchdog {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// Seconds for which a thread may count nothing before its process is taken for stopped: more than
/// a loaded machine keeps a thread waiting.
const STOPPED: u64 = 5;
/// What took longer than this, of a sleep of a second, is not counted: the job or its machine was
/// suspended, and no rank went on.
const LONGEST: Duration = Duration::from_secs(2);
/// So long this rank waits after a failure of its own for the others to agree on it.
const AGREEMENT: Duration = Duration::from_secs(2);
/// Ranks of other nodes are not seen, and may compute: they get this many times as long.
const ELSEWHERE: u32 = 10;

impl Watchdog {
    /// Ends the job by `end` with a message once this rank has waited for `limit` and no rank of
    /// the node computes, or for a few seconds after a `failure` of its own.
    pub fn start(
        rank: usize,
        limit: Duration,
        ranks: Ranks,
        failure: LoneFailure,
        end: impl Fn(&str) + Send + 'static,
    ) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let thread = std::thread::spawn(move || {
            watch(rank, limit, &ranks, &failure, &stopped, end);
        });
        Self {
            stop,
            thread: Some(thread),
        }
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}

/// What is seen of a rank.
#[derive(Clone, Default)]
struct Seen {
    seconds: u64,
    /// For how long this rank has not seen its seconds change.
    silence: Duration,
}

impl Seen {
    fn look(&mut self, progress: &Progress, passed: Duration) {
        let seconds = progress.seconds.load(Ordering::Relaxed);
        if seconds == self.seconds {
            self.silence += passed;
        } else {
            *self = Self {
                seconds,
                silence: Duration::ZERO,
            };
        }
    }

    fn is_silent(&self) -> bool {
        self.silence > Duration::from_secs(STOPPED)
    }
}

/// Why the ranks wait.
fn reason(ranks: &Ranks, seen: &[Seen]) -> String {
    let Ranks { here, elsewhere } = ranks;
    let gone: Vec<String> = (0..here.len())
        .filter(|&k| seen[k].is_silent())
        .map(|k| {
            let process = here[k].1.process.load(Ordering::Relaxed);
            format!("rank {} (process {process})", here[k].0)
        })
        .collect();
    match (gone.is_empty(), elsewhere) {
        (false, _) => format!("{} does not answer", gone.join(", ")),
        (true, true) => "a rank of another node does not answer".into(),
        (true, false) if here.len() == 1 => "a file operation does not end".into(),
        (true, false) => {
            // They tell which rank is behind.
            let begun = here
                .iter()
                .map(|(_, progress)| progress.operations.load(Ordering::Relaxed));
            let begun: Vec<String> = begun.take(8).map(|n| n.to_string()).collect();
            format!(
                "the ranks wait for each other, or for a file operation (operations begun, by rank: {})",
                begun.join(", ")
            )
        }
    }
}

fn watch(
    rank: usize,
    limit: Duration,
    ranks: &Ranks,
    failure: &LoneFailure,
    stopped: &AtomicBool,
    end: impl Fn(&str),
) {
    let Ranks { here, elsewhere } = ranks;
    let own = here.iter().find(|(number, _)| *number == rank);
    let (_, own) = own.expect("this rank is on its node");
    own.process
        .store(std::process::id().into(), Ordering::Relaxed);
    let limit = if *elsewhere {
        limit.saturating_mul(ELSEWHERE)
    } else {
        limit
    };
    // Not before a stopped process can be told.
    let limit = limit.max(Duration::from_secs(STOPPED + 2));
    let mut seen = vec![Seen::default(); here.len()];
    let (mut operation, mut waited, mut told) = (u64::MAX, Duration::ZERO, false);
    while !stopped.load(Ordering::Relaxed) {
        let parked = Instant::now();
        std::thread::park_timeout(Duration::from_secs(1));
        let passed = parked.elapsed().min(LONGEST);
        own.seconds.fetch_add(1, Ordering::Relaxed);
        for ((_, progress), seen) in here.iter().zip(&mut seen) {
            seen.look(progress, passed);
        }
        waited += passed;
        let current = own.operations.load(Ordering::Relaxed);
        if current != operation || !own.waits() {
            (operation, waited, told) = (current, Duration::ZERO, false);
        }
        if own.waits()
            && waited > AGREEMENT
            && let Some(failure) = failure.message()
        {
            end(&format!("{failure}; resume from the last checkpoint"));
            return;
        }
        if waited < limit {
            continue;
        }
        let computes = (0..here.len()).find(|&k| !seen[k].is_silent() && !here[k].1.waits());
        let answers = (0..here.len()).filter(|&k| !seen[k].is_silent());
        let speaks = answers.map(|k| here[k].0).min() == Some(rank);
        if let Some(k) = computes {
            if speaks && !told {
                // A closed standard error does not end the run.
                let _ = writeln!(
                    std::io::stderr(),
                    "note: rank {} has computed for {} s; the other ranks wait",
                    here[k].0,
                    waited.as_secs()
                );
            }
            told = true;
            continue;
        }
        // The first that answers speaks; the others leave it a few seconds.
        if speaks || waited > limit + Duration::from_secs(2 * STOPPED) {
            let what = reason(ranks, &seen);
            end(&format!(
                "{what}: rank {rank} has waited for {} s (bookkeeping.watchdog); resume from the last checkpoint",
                waited.as_secs()
            ));
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;
    use std::sync::mpsc::channel;

    fn node<const SIZE: usize>() -> [&'static Progress; SIZE] {
        [(); SIZE].map(|()| &*Box::leak(Box::default()))
    }

    fn ranks(node: &[&'static Progress]) -> Ranks {
        Ranks {
            here: node.iter().copied().enumerate().collect(),
            elsewhere: false,
        }
    }

    fn start(node: &[&'static Progress], rank: usize, said: &Arc<Mutex<Vec<String>>>) -> Watchdog {
        let said = said.clone();
        let (limit, failure) = (Duration::from_secs(1), LoneFailure::default());
        Watchdog::start(rank, limit, ranks(node), failure, move |m| {
            said.lock().unwrap().push(m.into());
        })
    }

    /// What is said first, within a minute.
    fn first(said: &Mutex<Vec<String>>) -> String {
        let begun = Instant::now();
        while said.lock().unwrap().is_empty() && begun.elapsed() < Duration::from_mins(1) {
            std::thread::sleep(Duration::from_millis(50));
        }
        said.lock().unwrap()[0].clone()
    }

    #[test]
    fn ranks_that_all_wait_say_who_is_behind() {
        let (node, said) = (node::<2>(), Arc::default());
        drop(node[1].wait());
        let waiting = node.map(Progress::wait);
        let dogs = [0, 1].map(|rank| start(&node, rank, &said));
        let said = first(&said);
        drop((waiting, dogs));
        assert!(said.contains("by rank: 1, 2)"), "{said}");
    }

    #[test]
    fn a_stopped_rank_is_named() {
        let (node, said) = (node::<2>(), Arc::default());
        // Rank 1 has a process, but no thread that counts.
        node[1].process.store(77, Ordering::Relaxed);
        let waiting = node[0].wait();
        let dog = start(&node, 0, &said);
        let said = first(&said);
        drop((waiting, dog));
        let expected = "rank 1 (process 77) does not answer";
        assert!(said.starts_with(expected), "{said}");
    }

    #[test]
    fn a_failure_that_the_others_do_not_know_of_ends_the_job() {
        let (node, failure) = (node::<2>(), LoneFailure::default());
        let (ended, end) = channel();
        let limit = Duration::from_hours(1);
        let dog = Watchdog::start(0, limit, ranks(&node), failure.clone(), move |m| {
            let _ = ended.send(m.to_string());
        });
        let waiting = node[0].wait();
        // Known to all.
        failure.note("damaged");
        failure.note_cause("no link");
        failure.clear();
        assert!(end.recv_timeout(AGREEMENT * 2).is_err());
        // Rank 1 does not know, and may compute.
        failure.note_cause("no link");
        failure.note("no room");
        failure.note("cannot close");
        let said = end.recv_timeout(Duration::from_mins(1)).unwrap();
        assert!(said.starts_with("no room;"), "{said}");
        drop((waiting, dog));
    }

    #[test]
    fn a_rank_that_computes_or_answers_in_time_is_left_alone() {
        let (node, said) = (node::<2>(), Arc::default());
        // Rank 1 computes; rank 0 waits for it.
        let dogs = [start(&node, 0, &said), start(&node, 1, &said)];
        let waiting = node[0].wait();
        std::thread::sleep(Duration::from_secs(STOPPED + 5));
        drop(waiting);
        // Both begin an operation again and again.
        let (done, end) = channel();
        let thread = std::thread::spawn(move || {
            while end.try_recv().is_err() {
                for progress in node {
                    let _waiting = progress.wait();
                    std::thread::sleep(Duration::from_millis(100));
                }
            }
        });
        std::thread::sleep(Duration::from_secs(STOPPED + 4));
        done.send(()).unwrap();
        thread.join().unwrap();
        drop(dogs);
        assert!(said.lock().unwrap().is_empty(), "{said:?}");
    }
}
