//! Whether the ranks had the cores that they needed, by what Linux says of processes.

use std::collections::HashMap;
use std::fs;
use std::path::PathBuf;
use std::time::Instant;

/// For how long the ranks of this node were ready to compute and had no core.
///
/// A step takes as long as its slowest rank, so that one rank without a core holds up all of them.
pub(crate) struct Cores {
    /// The ranks whose processes this one sees.
    processes: Vec<u32>,
    ranks: usize,
    begun: Instant,
    /// Of each thread when this began (ns).
    before: HashMap<PathBuf, u64>,
}

impl Cores {
    /// From now on. `processes`: of the ranks on this node.
    pub fn of(processes: Vec<u32>) -> Self {
        let ranks = processes.len();
        // In a container of its own, a rank does not see those of others by their numbers.
        let program = fs::read_link("/proc/self/exe").ok();
        let mut seen = processes;
        seen.retain(|process| fs::read_link(format!("/proc/{process}/exe")).ok() == program);
        let before = seen.iter().flat_map(|&process| waits(process));
        Self {
            before: before.collect(),
            processes: seen,
            ranks,
            begun: Instant::now(),
        }
    }

    /// The part of the time, 0 to 1, that the rank waited which waited longest; `None` if Linux
    /// does not count it.
    pub fn waited(&self) -> Option<f64> {
        let mut longest = None;
        for (thread, wait) in self.processes.iter().flat_map(|&process| waits(process)) {
            let before = self.before.get(&thread).copied().unwrap_or(0);
            longest = longest.max(Some(wait.saturating_sub(before)));
        }
        let longest = longest?;
        let elapsed = self.begun.elapsed().as_nanos().max(1) as f64;
        Some((longest as f64 / elapsed).min(1.0))
    }

    /// What to say of ranks that waited for this part of the time, and what helps.
    pub fn advice(&self, waited: f64) -> String {
        let masks: Option<Vec<Vec<u32>>> = self
            .processes
            .iter()
            .map(|process| {
                let status = fs::read_to_string(format!("/proc/{process}/status"));
                allowed(&status.ok()?)
            })
            .collect();
        let place = RankCores {
            ranks: self.ranks,
            allowed: masks.unwrap_or_default(),
            online: online(),
        };
        place.advice(waited)
    }
}

/// Number of processors that this rank may run on; 0 if the system does not say.
pub(crate) fn of_this_rank() -> usize {
    let status = fs::read_to_string("/proc/self/status").ok();
    let list = status.and_then(|status| allowed(&status));
    list.map_or(0, |list| list.len())
}

/// What to say if a rank of so many `threads` may run on these few processors of this machine.
pub(crate) fn too_few(threads: usize, processors: usize) -> Option<String> {
    bound_to_few(threads, processors, online())
}

/// [`too_few`] of a machine with so many processors.
fn bound_to_few(threads: usize, processors: usize, online: usize) -> Option<String> {
    let is_bound = processors > 0 && processors < online;
    (is_bound && processors < threads).then(|| {
        format!(
            "{threads} threads of a rank are bound to {processors} of {online} processors and wait for each other; start the ranks with mpirun --map-by slot:PE={threads} --bind-to core (Slurm: --cpus-per-task={threads}), or with --bind-to none"
        )
    })
}

/// Number of processors of this machine; 0 if the system does not say.
fn online() -> usize {
    let list = fs::read_to_string("/sys/devices/system/cpu/online").ok();
    let list = list.and_then(|list| cpus(list.trim()));
    list.map_or(0, |list| list.len())
}

/// Where ranks may run.
struct RankCores {
    ranks: usize,
    /// The cores that each rank may use.
    allowed: Vec<Vec<u32>>,
    /// Number of cores of the machine.
    online: usize,
}

impl RankCores {
    fn advice(&self, waited: f64) -> String {
        let mut all = self.allowed.concat();
        all.sort_unstable();
        all.dedup();
        let (cores, ranks) = (all.len(), self.ranks);
        let who = if ranks > 1 { "a rank" } else { "the rank" };
        let percent = 100.0 * waited;
        let bound = self.allowed.iter().any(|own| own.len() < self.online);
        let why = if cores > 0 && cores < ranks && cores < self.online {
            format!(
                "{ranks} ranks are bound to {cores} of {} cores; start them with mpirun --bind-to none",
                self.online
            )
        } else if cores > 0 && cores < ranks {
            format!("{ranks} ranks share {cores} cores; use fewer ranks")
        } else if bound && ranks > 1 {
            "other programs used those that the ranks are bound to; start them with mpirun \
             --bind-to none, use fewer ranks, or another machine"
                .into()
        } else if ranks > 1 {
            "other programs used them; use fewer ranks, or another machine".into()
        } else {
            "other programs used them".into()
        };
        format!("{who} waited {percent:.0} % of the time for a core: {why}")
    }
}

/// For how long each thread of a process has been ready to run without running (ns).
fn waits(process: u32) -> Vec<(PathBuf, u64)> {
    let tasks = fs::read_dir(format!("/proc/{process}/task"));
    let tasks = tasks.into_iter().flatten().flatten();
    tasks
        .filter_map(|task| {
            let text = fs::read_to_string(task.path().join("schedstat")).ok()?;
            let wait = text.split_whitespace().nth(1)?.parse().ok()?;
            Some((task.path(), wait))
        })
        .collect()
}

/// The cores in the line `Cpus_allowed_list` of a `status` file.
fn allowed(status: &str) -> Option<Vec<u32>> {
    let list = status
        .lines()
        .find_map(|line| line.strip_prefix("Cpus_allowed_list:"))?;
    cpus(list.trim())
}

/// The numbers of a list such as `0-3,8`.
fn cpus(list: &str) -> Option<Vec<u32>> {
    let mut all = Vec::new();
    for range in list.split(',') {
        let (first, last) = range.split_once('-').unwrap_or((range, range));
        all.extend(first.parse().ok()?..=last.parse::<u32>().ok()?);
    }
    Some(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn advice_follows_from_where_ranks_may_run() {
        let place = |allowed: &[&str], online| RankCores {
            ranks: allowed.len(),
            allowed: allowed
                .iter()
                .map(|list| cpus(list).expect("cores"))
                .collect(),
            online,
        };
        for (allowed, online, wanted) in [
            (
                &["0", "0"][..],
                8,
                "2 ranks are bound to 1 of 8 cores; start them with mpirun --bind-to none",
            ),
            (
                &["0-1", "0-1", "0-1"],
                2,
                "3 ranks share 2 cores; use fewer ranks",
            ),
            (
                &["0", "1"],
                8,
                "other programs used those that the ranks are bound to; start them with mpirun --bind-to none, use fewer ranks, or another machine",
            ),
            (
                &["0-7", "0-7"],
                8,
                "other programs used them; use fewer ranks, or another machine",
            ),
            (&["0-7"], 8, "other programs used them"),
        ] {
            let said = place(allowed, online).advice(0.634);
            let start = if allowed.len() > 1 {
                "a rank"
            } else {
                "the rank"
            };
            assert_eq!(
                said,
                format!("{start} waited 63 % of the time for a core: {wanted}")
            );
        }
    }

    #[test]
    fn threads_that_share_processors_are_noticed() {
        for enough in [(1, 1, 8), (4, 4, 8), (4, 8, 8), (16, 8, 8), (4, 0, 0)] {
            let (threads, processors, online) = enough;
            assert_eq!(
                bound_to_few(threads, processors, online),
                None,
                "{enough:?}"
            );
        }
        let said = bound_to_few(4, 1, 8).expect("too few");
        assert!(
            said.starts_with("4 threads of a rank are bound to 1 of 8 processors"),
            "{said}"
        );
    }

    #[test]
    fn lists_of_cores() {
        assert_eq!(cpus("0-2,8"), Some(vec![0, 1, 2, 8]));
        assert_eq!((cpus("all"), allowed("Name:\tx")), (None, None));
        assert_eq!(allowed("Name:\tx\nCpus_allowed_list:\t3\n"), Some(vec![3]));
    }

    /// This process itself has waited no longer than it has run, as far as Linux says.
    #[test]
    fn a_process_waits_for_part_of_the_time() {
        let cores = Cores::of(vec![std::process::id()]);
        assert!(
            cores
                .waited()
                .is_none_or(|waited| (0.0..=1.0).contains(&waited))
        );
        assert_eq!(Cores::of(Vec::new()).waited(), None);
    }
}
