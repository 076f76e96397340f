//! The time spent in each phase of a step.

use std::time::Instant;

use crate::domain::Exchange;

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

/// Seconds spent in each phase on this rank.
#[derive(Debug)]
pub struct Clock {
    seconds: [f64; PHASES.len()],
    since: Instant,
    steps: u64,
}

impl Default for Clock {
    fn default() -> Self {
        Self {
            seconds: [0.0; PHASES.len()],
            since: Instant::now(),
            steps: 0,
        }
    }
}

impl Clock {
    /// Begins one or several steps: the time before this call belongs to no phase.
    pub fn start(&mut self) {
        self.since = Instant::now();
    }

    /// Counts a step.
    pub(crate) fn count_step(&mut self) {
        self.steps += 1;
    }

    /// Adds the time since the last call to `phase`.
    pub fn end(&mut self, phase: StepPhase) {
        self.end_at(phase, Instant::now());
    }

    /// Adds the time from the last call to `now` to `phase`.
    pub(crate) fn end_at(&mut self, phase: StepPhase, now: Instant) {
        self.seconds[phase as usize] += (now - self.since).as_secs_f64();
        self.since = now;
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
