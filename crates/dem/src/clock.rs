//! The time spent in each phase of a step.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::domain::Exchange;
use crate::processor::{PieceTimes, ThreadClock};

/// Phases of a step, in the order of `step::advance`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StepPhase {
    /// Kicks, drift and the motion of the walls.
    Motion,
    /// Waiting for the records of the ghosts.
    Exchange,
    /// Contact forces.
    Contacts,
    /// Forces on the walls and global sums.
    Walls,
    /// Migration and a new list of pairs.
    Rebuild,
    /// Frames, rows and checkpoints.
    Output,
}

/// All phases with their names in the table.
pub const PHASES: [(StepPhase, &str); 6] = [
    (StepPhase::Motion, "motion"),
    (StepPhase::Exchange, "halo exchange"),
    (StepPhase::Contacts, "contacts"),
    (StepPhase::Walls, "walls, global sums"),
    (StepPhase::Rebuild, "migrate, rebuild"),
    (StepPhase::Output, "output"),
];

/// Processor time (s) of a phase on a rank.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PhaseWork {
    /// Of the first thread, while it works alone or waits for other ranks.
    pub alone: f64,
    /// Of all threads in regions of parallel work.
    pub parallel: f64,
    /// Of the longest piece of each region: the least time that the regions take.
    pub longest: f64,
}

/// The processor time spent in each phase.
#[derive(Debug)]
struct ProcessorTime {
    clock: ThreadClock,
    pieces: Option<Arc<PieceTimes>>,
    /// Of the first thread, and [`PieceTimes::until_now`], when the last phase ended.
    since: (u64, [u64; 3]),
    phases: [PhaseWork; PHASES.len()],
}

impl ProcessorTime {
    fn now(&self) -> (u64, [u64; 3]) {
        let pieces = self.pieces.as_ref();
        let pieces = pieces.map_or([0; 3], |pieces| pieces.until_now());
        ((self.clock)(), pieces)
    }

    fn end(&mut self, phase: StepPhase) {
        let now = self.now();
        let (first, pieces) = self.since;
        let [all, longest, caller] = std::array::from_fn(|k| (now.1[k] - pieces[k]) as f64);
        let work = &mut self.phases[phase as usize];
        work.alone += 1e-9 * ((now.0 - first) as f64 - caller);
        work.parallel += 1e-9 * all;
        work.longest += 1e-9 * longest;
        self.since = now;
    }
}

/// Seconds spent in each phase on this rank.
#[derive(Debug)]
pub struct Clock {
    seconds: [f64; PHASES.len()],
    since: Instant,
    steps: u64,
    /// Nanoseconds of all regions of parallel work until now, if there are several threads.
    regions: Option<Arc<AtomicU64>>,
    /// Their value when the last phase ended.
    regions_since: u64,
    /// Seconds spent in regions in each phase.
    parallel: [f64; PHASES.len()],
    /// If it is counted.
    processor: Option<ProcessorTime>,
}

impl Default for Clock {
    fn default() -> Self {
        Self {
            seconds: [0.0; PHASES.len()],
            since: Instant::now(),
            steps: 0,
            regions: None,
            regions_since: 0,
            parallel: [0.0; PHASES.len()],
            processor: None,
        }
    }
}

impl Clock {
    /// A clock that also counts the time in regions of parallel work, of which `regions` has the
    /// nanoseconds until now.
    pub(crate) fn with_regions(regions: Option<Arc<AtomicU64>>) -> Self {
        let mut clock = Self {
            regions,
            ..Self::default()
        };
        clock.regions_since = clock.nanoseconds_of_regions();
        clock
    }

    /// A clock that also counts processor time, if it has a clock of that.
    pub(crate) fn counting_processor_time(
        mut self,
        clock: Option<ThreadClock>,
        pieces: Option<Arc<PieceTimes>>,
    ) -> Self {
        self.processor = clock.map(|clock| ProcessorTime {
            clock,
            pieces,
            since: (0, [0; 3]),
            phases: Default::default(),
        });
        self.begin_processor_time();
        self
    }

    fn begin_processor_time(&mut self) {
        if let Some(processor) = &mut self.processor {
            processor.since = processor.now();
        }
    }

    fn nanoseconds_of_regions(&self) -> u64 {
        let regions = self.regions.as_ref();
        regions.map_or(0, |regions| regions.load(Ordering::Relaxed))
    }

    /// Begins one or several steps: the time before this call belongs to no phase.
    pub fn start(&mut self) {
        self.since = Instant::now();
        self.regions_since = self.nanoseconds_of_regions();
        self.begin_processor_time();
    }

    /// Number of steps since the clock began.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Counts a step.
    pub(crate) fn count_step(&mut self) {
        self.steps += 1;
    }

    /// Adds the time since the last call to `phase`.
    pub fn end(&mut self, phase: StepPhase) {
        let now = Instant::now();
        self.seconds[phase as usize] += (now - self.since).as_secs_f64();
        self.since = now;
        let regions = self.nanoseconds_of_regions();
        let parallel = regions.saturating_sub(self.regions_since);
        self.parallel[phase as usize] += 1e-9 * parallel as f64;
        self.regions_since = regions;
        if let Some(processor) = &mut self.processor {
            processor.end(phase);
        }
    }

    /// Gives a part of the time in a region of one phase to another one.
    pub(crate) fn give(&mut self, from: StepPhase, to: StepPhase, time: Duration) {
        for seconds in [&mut self.seconds, &mut self.parallel] {
            seconds[from as usize] -= time.as_secs_f64();
            seconds[to as usize] += time.as_secs_f64();
        }
    }

    /// Processor time in each phase on this rank, if it is counted. That of a region belongs to the
    /// phase that ends with it.
    pub fn work(&self) -> Option<[PhaseWork; PHASES.len()]> {
        self.processor.as_ref().map(|processor| processor.phases)
    }

    /// Seconds of computing, without waiting for other ranks.
    pub fn worked(&self) -> f64 {
        self.seconds[StepPhase::Motion as usize] + self.seconds[StepPhase::Contacts as usize]
    }

    /// Seconds in a phase on this rank.
    pub fn seconds(&self, phase: StepPhase) -> f64 {
        self.seconds[phase as usize]
    }

    /// Mean seconds per step in a phase on this rank.
    pub fn per_step(&self, phase: StepPhase) -> f64 {
        self.seconds(phase) / self.steps.max(1) as f64
    }

    /// The share of the time in which one thread works alone while the others wait, mean over the
    /// ranks, in all and in each phase; `None` with one thread. Collective.
    pub fn serial_shares(&self, exchange: &dyn Exchange) -> Option<(f64, [f64; PHASES.len()])> {
        self.regions.as_ref()?;
        let alone: [f64; PHASES.len()] =
            std::array::from_fn(|k| (self.seconds[k] - self.parallel[k]).max(0.0));
        let all: f64 = self.seconds.iter().sum();
        let shares = alone.map(|alone| alone / all.max(f64::MIN_POSITIVE));
        let gathered = exchange.gather(bytemuck::cast_slice(&shares));
        let of_ranks: Vec<Vec<f64>> = gathered
            .iter()
            .map(|bytes| bytemuck::allocation::pod_collect_to_vec(bytes))
            .collect();
        let ranks = of_ranks.len() as f64;
        let means: [f64; PHASES.len()] =
            std::array::from_fn(|k| of_ranks.iter().map(|shares| shares[k]).sum::<f64>() / ranks);
        Some((means.iter().sum(), means))
    }

    /// A table of the phases: least, mean and greatest seconds over the ranks, and the share of the
    /// mean.
    pub fn table(&self, exchange: &dyn Exchange) -> String {
        let all: Vec<Vec<f64>> = exchange
            .gather(bytemuck::cast_slice(&self.seconds))
            .iter()
            .map(|bytes| bytemuck::allocation::pod_collect_to_vec(bytes))
            .collect();
        let ranks = all.len() as f64;
        let sum: f64 = all.iter().flatten().sum();
        let mut text = format!(
            "{:<20}{:>10}{:>10}{:>10}{:>9}\n",
            "phase (s)", "min", "mean", "max", "share"
        );
        for (k, (_, name)) in PHASES.iter().enumerate() {
            let folded = |f: fn(f64, f64) -> f64, from| all.iter().fold(from, |a, r| f(a, r[k]));
            let mean = all.iter().map(|r| r[k]).sum::<f64>() / ranks;
            text += &format!(
                "{name:<20}{:>10.3}{mean:>10.3}{:>10.3}{:>8.1}%\n",
                folded(f64::min, f64::INFINITY),
                folded(f64::max, 0.0),
                100.0 * mean * ranks / sum.max(f64::MIN_POSITIVE),
            );
        }
        text
    }
}
