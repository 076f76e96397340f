//! Friction after velocity steps, averaged over all steps between the same velocities. Averaging
//! reduces noise that hides the effect in a single run.

use super::slider_record::SliderRecord;
use super::steps_and_holds::steady_segments;
use crate::moments::{Moments, grouped, mean};

/// Ends of the intervals of slip, over the least slip after any of the steps.
const ENDS: [f64; 10] = [0.0, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0];

/// Average friction after all steps from one velocity to another.
#[derive(Debug, Clone, PartialEq)]
pub struct Stack {
    /// V_drive before and after (m/s).
    pub velocities: [f64; 2],
    /// Intervals of slip with their averages.
    pub pieces: Vec<SlipInterval>,
}

/// Average over an interval of slip, over the steps that have rows in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlipInterval {
    /// Start and end of the interval: slip since the step (m).
    pub slip: [f64; 2],
    /// Number of steps averaged.
    pub steps: usize,
    /// Mean over the steps of μ minus μ_ss before the step.
    pub change: f64,
    /// Standard error of `change`, from the scatter among the steps; NaN for a single one.
    pub error: f64,
}

/// Returns the averages over all records, in the order in which pairs of velocities first occur.
/// μ_ss is that of each run.
pub fn stacks(records: &[SliderRecord]) -> Vec<Stack> {
    let groups = grouped(records.iter().flat_map(followed), |a, b| {
        a.velocities == b.velocities
    });
    let stacks = groups.into_iter().map(|members| {
        let ends = members.iter().filter_map(|step| step.slip.last());
        let least = ends.copied().fold(f64::INFINITY, f64::min);
        let pieces = ENDS
            .windows(2)
            .filter_map(|part| piece(&members, [part[0] * least, part[1] * least]));
        Stack {
            velocities: members[0].velocities,
            pieces: pieces.collect(),
        }
    });
    stacks.collect()
}

/// A step and the rows after it.
struct Followed {
    velocities: [f64; 2],
    /// Slip since the step (m).
    slip: Vec<f64>,
    /// μ minus μ_ss before the step.
    change: Vec<f64>,
}

fn followed(record: &SliderRecord) -> Vec<Followed> {
    let steady = steady_segments(record);
    let steps = (1..record.drive.len()).filter_map(|segment| {
        let before = steady[segment - 1]?;
        let rows = record.rows(segment);
        let begin = record.slip[record.rows(segment - 1).end - 1];
        if record.drive[segment].is_hold() || rows.is_empty() {
            return None;
        }
        let slip = record.slip[rows.clone()].iter().map(|s| s - begin);
        let friction = record.friction[rows].iter();
        Some(Followed {
            velocities: [before.velocity, record.drive[segment].velocity],
            slip: slip.collect(),
            change: friction.map(|mu| mu - before.friction).collect(),
        })
    });
    steps.collect()
}

fn piece(steps: &[Followed], slip: [f64; 2]) -> Option<SlipInterval> {
    let means = steps.iter().filter_map(|step| {
        let rows = step.slip.iter().zip(&step.change);
        let within = rows.filter(|(s, _)| slip[0] <= **s && **s < slip[1]);
        let changes: Vec<f64> = within.map(|(_, change)| *change).collect();
        (!changes.is_empty()).then(|| mean(&changes))
    });
    let means: Vec<f64> = means.collect();
    let moments = Moments::of(&means);
    (!means.is_empty()).then_some(SlipInterval {
        slip,
        steps: means.len(),
        change: moments.mean,
        error: moments.error(),
    })
}
