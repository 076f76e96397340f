//! The numbers of a run's report.

use serde_json::{Value, json};

use gshear_analysis::dmin::{DefinedCounts, NonAffine, RADIUS};
use gshear_analysis::interval::Interval;
use gshear_analysis::moments::{Moments, extent};
use gshear_analysis::phases::{self, Phase, PhaseKind};
use gshear_analysis::stress::ratio_on_top;
use gshear_analysis::time_mean::TimeMean;
use gshear_dem::failure::Result;
use gshear_dem::state::{Frame, GrainConstants};
use gshear_store::run_reader::RunFile;

use crate::{Rearranging, Sources};

/// Moments of the finite values.
pub(crate) fn finite_moments(values: &[f64]) -> Moments {
    let finite = values.iter().copied().filter(|value| value.is_finite());
    Moments::of(&finite.collect::<Vec<_>>())
}

/// Whether a spring or a protocol moves the wall, so that the strain is no measure of the time.
pub fn is_driven(run: &RunFile) -> bool {
    let velocities = run.series().column("drive_velocity");
    run.number("spring_stiffness").is_some_and(f64::is_finite)
        || velocities.windows(2).any(|pair| pair[0] != pair[1])
}

/// Whether a protocol imposes more than velocities along x, as the columns of the time series say.
pub(crate) fn is_imposed(run: &RunFile) -> bool {
    run.series().has("imposed_normal_force")
}

/// Whether a run can have phases of stick and slip, or has some.
pub(crate) fn has_phases(run: &RunFile, phases: &[Phase]) -> bool {
    !is_imposed(run) && run.boundary().has_top() || !phases.is_empty()
}

/// Least normal force with which τ is shown, over the greatest one of the run. Under less, as in a
/// liquefied layer or one that attraction holds together, τ is a ratio of two noises.
const LEAST_LOAD: f64 = 0.01;

/// `[L]` τ of a run; NaN in rows in which the layer bears next to no load.
pub fn stress_ratio(run: &RunFile) -> Vec<f64> {
    let series = run.series();
    let (tau, normal) = (series.column("stress_ratio"), series.column("normal_force"));
    let least = LEAST_LOAD * normal.iter().copied().fold(0.0, f64::max);
    let rows = tau.iter().zip(normal);
    let shown = rows.map(|(tau, normal)| if *normal < least { f64::NAN } else { *tau });
    shown.collect()
}

/// Stick and slip phases of a run. Where a protocol imposes more than velocities, only those at a
/// constant velocity of the drive are any: else τ rises and falls with what is imposed. A free
/// surface has no drive.
fn phases_of(run: &RunFile, tau: &[f64]) -> Vec<Phase> {
    if !run.boundary().has_top() {
        return Vec::new();
    }
    let mut phases = phases::find(run.series().column("strain"), tau);
    if is_imposed(run) {
        phases.retain(|phase| is_free(run, phase));
    }
    phases
}

/// Whether a phase is at a constant velocity of the drive: the stress after a change of the
/// velocity or during a hold falls because of the drive.
fn is_free(run: &RunFile, phase: &Phase) -> bool {
    let velocities = &run.series().column("drive_velocity")[phase.start..=phase.end];
    velocities[0] != 0.0 && velocities.iter().all(|v| *v == velocities[0])
}

/// First row of the latter half of the strain; of the time, if a protocol imposes more than
/// velocities.
pub(crate) fn latter_half(run: &RunFile) -> usize {
    // A strain that returns does not tell the halves of a run.
    let clock = if is_imposed(run) {
        &run.series().time[..]
    } else {
        run.series().column("strain")
    };
    let half = 0.5 * clock.last().copied().unwrap_or(0.0);
    clock.partition_point(|now| *now < half)
}

/// The largest slip at a constant velocity of the drive, after the start of the flow: τ first
/// overshoots its mean of the latter half, and is back where that slip ends.
fn largest_drop(run: &RunFile, tau: &[f64], phases: &[Phase]) -> Option<Phase> {
    let mean = run.series().mean("stress_ratio", latter_half(run)).mean;
    let over: Vec<bool> = tau.iter().map(|tau| *tau > mean).collect();
    let mut rows = (0..tau.len()).skip_while(|row| !over[*row]);
    let start = rows.find(|row| !over[*row]).unwrap_or(0);
    let phases = phases.iter().copied();
    let after: Vec<Phase> = phases
        .filter(|phase| phase.start >= start && is_free(run, phase))
        .collect();
    phases::largest_drop(&after).copied()
}

/// Whether frames are drawn around the largest drop: of disks between walls.
pub fn shows_drops(run: &RunFile) -> bool {
    run.has_disks_between_walls() && run.boundary().has_top()
}

/// Steps of the first and the last row of the largest drop, if it is one of disks between walls and
/// no frames show its start and its end.
pub fn drop_without_frames(run: &RunFile) -> Option<[u64; 2]> {
    if !shows_drops(run) {
        return None;
    }
    let tau = stress_ratio(run);
    let drop = largest_drop(run, &tau, &phases_of(run, &tau))?;
    let steps = [drop.start, drop.end].map(|row| run.series().step[row]);
    let mut frames = steps
        .iter()
        .map(|step| run.frame_steps().binary_search(step));
    if frames.all(|frame| frame.is_ok()) {
        return None;
    }
    Some(steps)
}

/// Two frames of a run, and D²min between them.
pub(crate) struct EventFrames {
    /// The earlier frame.
    pub earlier: Frame,
    /// The later frame.
    pub later: Frame,
    /// γ of the two frames.
    pub strain: [f64; 2],
    /// τ of the two frames: of the time series, or of the contacts if it has no row there.
    pub tau: [f64; 2],
    /// `[N]` D²min between the two frames (m²).
    pub dmin: Vec<f64>,
    /// Of how many free grains it is defined.
    pub defined: DefinedCounts,
}

impl EventFrames {
    /// Reads two frames of `shown`, which is `run` or a part of it.
    ///
    /// # Errors
    /// If a frame cannot be read.
    fn read(run: &RunFile, shown: &RunFile, frames: [usize; 2]) -> Result<Self> {
        let (grains, series) = (run.grains(), run.series());
        let [earlier, later] = [shown.frame(frames[0])?, shown.frame(frames[1])?];
        let strain = shown.frame_strains()?;
        let tau = [&earlier, &later].map(|frame| match series.step.binary_search(&frame.step) {
            Ok(row) => series.column("stress_ratio")[row],
            Err(_) => ratio_on_top(grains, frame),
        });
        let (mut non_affine, mut dmin) = (NonAffine::default(), vec![f64::NAN; grains.count()]);
        let interval = Interval::between_walls([&earlier, &later]);
        non_affine.between(grains, &interval, RADIUS * grains.mean_radius(), &mut dmin);
        Ok(Self {
            strain: frames.map(|t| strain[t]),
            tau,
            defined: non_affine.defined(grains, &later, &dmin),
            dmin,
            earlier,
            later,
        })
    }

    fn frame(&self, k: usize) -> &Frame {
        [&self.earlier, &self.later][k]
    }

    /// Sum of the normal forces of all contacts of a frame (N/m).
    pub(crate) fn normal_forces(&self, k: usize) -> f64 {
        let contacts = self.frame(k).contacts.iter();
        contacts.map(|contact| contact.normal_force).sum()
    }

    /// The state of frame 0 or 1, for captions.
    pub fn state(&self, k: usize) -> String {
        let force = self.normal_forces(k);
        let force = match force.abs() {
            0.0 | 1e-3..1e6 => format!("{force:.4}"),
            _ => format!("{force:.4e}"),
        };
        format!(
            "step {}, γ = {:.5} %, τ = {:.4}, ΣF<sub>n</sub> = {force} N/m",
            self.frame(k).step,
            100.0 * self.strain[k],
            self.tau[k],
        )
    }

    /// Frame 0 or 1 in the title of a map.
    pub fn title(&self, k: usize) -> String {
        let strain = 100.0 * self.strain[k];
        format!("γ = {strain:.5} %, τ = {:.4}", self.tau[k])
    }

    /// Returns the position of the grain with the greatest D²min, or of the first grain if none has
    /// one.
    pub fn centre(&self) -> [f64; 2] {
        let defined = (0..self.dmin.len()).filter(|n| self.dmin[*n].is_finite());
        let greatest = defined.max_by(|a, b| self.dmin[*a].total_cmp(&self.dmin[*b]));
        let [x, y, _] = self.later.position(greatest.unwrap_or(0));
        [x, y]
    }

    /// Returns the greatest D²min over r̄²; `None` if no grain has one.
    pub fn greatest_dmin(&self, grains: &GrainConstants) -> Option<f64> {
        let greatest = extent(self.dmin.iter().copied().filter(|d| d.is_finite()))[1];
        let square = grains.mean_radius().powi(2);
        greatest.is_finite().then_some(greatest / square)
    }

    /// What `summary.json` says of them.
    fn json(&self, grains: &GrainConstants) -> Value {
        json!({
            "steps": [self.earlier.step, self.later.step],
            "strain": self.strain,
            "stress_ratio": self.tau,
            "sum_of_normal_forces": [self.normal_forces(0), self.normal_forces(1)],
            "greatest_dmin_over_mean_radius_squared": self.greatest_dmin(grains),
        })
    }
}

/// The two frames around a drop.
pub(crate) struct DropFrames {
    /// The slip.
    pub drop: Phase,
    /// Whether they are those at its start and at its end.
    pub is_exact: bool,
    /// The last frame at or before the start of the drop, and the first at or after its end.
    pub frames: EventFrames,
}

impl DropFrames {
    /// Returns the largest drop that lies between two of the frames of `shown`; `None` if no slip
    /// does, or the grains are spheres or have no walls.
    ///
    /// # Errors
    /// If a frame cannot be read.
    pub fn largest(
        run: &RunFile,
        shown: &RunFile,
        tau: &[f64],
        phases: &[Phase],
    ) -> Result<Option<Self>> {
        if !shows_drops(run) {
            return Ok(None);
        }
        let (steps, rows) = (shown.frame_steps(), &run.series().step);
        let mut covered = phases.to_vec();
        covered
            .retain(|phase| frames_around(steps, [rows[phase.start], rows[phase.end]]).is_some());
        let Some(drop) = largest_drop(run, tau, &covered) else {
            return Ok(None);
        };
        let ends = [rows[drop.start], rows[drop.end]];
        let Some(frames) = frames_around(steps, ends) else {
            return Ok(None);
        };
        Ok(Some(DropFrames {
            is_exact: frames.map(|t| steps[t]) == ends,
            drop,
            frames: EventFrames::read(run, shown, frames)?,
        }))
    }
}

/// The last of the frames of these steps at or before the first step, and the first one at or after
/// the second step; `None` if one of them is missing.
fn frames_around(steps: &[u64], ends: [u64; 2]) -> Option<[usize; 2]> {
    let after = steps.partition_point(|step| *step <= ends[0]);
    let earlier = after.checked_sub(1)?;
    let later = steps.partition_point(|step| *step < ends[1]);
    (later < steps.len()).then_some([earlier, later])
}

/// Returns the two consecutive frames with the greatest D²min between the steps where it was found;
/// `None` without such frames.
///
/// # Errors
/// If a frame cannot be read.
fn rearrangement(run: &RunFile, place: Rearranging<'_>) -> Result<Option<EventFrames>> {
    let Rearranging { steps, shown } = place;
    let frame_steps = shown.frame_steps();
    let first = frame_steps.partition_point(|step| *step < steps[0]);
    let end = frame_steps.partition_point(|step| *step <= steps[1]);
    let mut greatest: Option<(f64, EventFrames)> = None;
    for t in first + 1..end.max(first + 1) {
        let frames = EventFrames::read(run, shown, [t - 1, t])?;
        let value = frames.greatest_dmin(run.grains());
        if let Some(value) = value
            && greatest.as_ref().is_none_or(|(most, _)| value > *most)
        {
            greatest = Some((value, frames));
        }
    }
    Ok(greatest.map(|(_, frames)| frames))
}

/// All numbers of a run's report.
pub struct Summary {
    /// Stick and slip phases of the whole run.
    pub phases: Vec<Phase>,
    /// The largest drop after the start of the flow.
    pub drop: Option<Phase>,
    /// Mean of τ, ⟨S⟩/⟨N⟩, over the latter half of the strain; of the time, if a protocol imposes
    /// more than velocities.
    pub stress: TimeMean,
    /// The drop that the maps show.
    pub event: Option<DropFrames>,
    /// The frames of the greatest D²min of the run.
    pub rearrangement: Option<EventFrames>,
}

impl Summary {
    /// Computes the numbers of a run.
    ///
    /// # Errors
    /// If the run is damaged.
    pub fn of(run: &RunFile, sources: &Sources<'_>) -> Result<Self> {
        let tau = stress_ratio(run);
        let phases = phases_of(run, &tau);
        let event = DropFrames::largest(run, sources.drop.unwrap_or(run), &tau, &phases)?;
        let rearrangement = sources.rearranging.map(|place| rearrangement(run, place));
        Ok(Summary {
            rearrangement: rearrangement.transpose()?.flatten(),
            drop: largest_drop(run, &tau, &phases),
            stress: run.series().mean("stress_ratio", latter_half(run)),
            event,
            phases,
        })
    }

    /// Returns the number of long and of short phases of a kind.
    pub fn count(&self, kind: PhaseKind) -> [usize; 2] {
        let phases = self.phases.iter().filter(|phase| phase.kind == kind);
        let long = phases.clone().filter(|phase| phase.is_long()).count();
        [long, phases.count() - long]
    }

    /// Returns the content of `summary.json`.
    pub fn json(&self, run: &RunFile) -> Value {
        let [stick, slip] = [PhaseKind::Stick, PhaseKind::Slip].map(|kind| {
            let [long, short] = self.count(kind);
            json!({ "long": long, "short": short })
        });
        let event = self.event.as_ref().map(|event| {
            let mut maps = event.frames.json(run.grains());
            maps["drop"] = phase_json(&event.drop);
            maps
        });
        let rearrangement = self.rearrangement.as_ref();
        json!({
            "run": run.path().display().to_string(),
            "digest": run.digest(),
            "speed": run.number("speed"),
            "grains": run.grains().count(),
            "frames": run.frames(),
            "series_rows": run.series().rows(),
            "final_strain": run.series().column("strain").last(),
            "stress_ratio_latter_half": {
                "mean": self.stress.mean,
                "standard_error": self.stress.error,
                "standard_deviation": self.stress.deviation,
            },
            "phases": { "stick": stick, "slip": slip },
            "largest_drop": self.drop.as_ref().map(phase_json),
            "maps": event,
            "greatest_dmin": rearrangement.map(|frames| frames.json(run.grains())),
            "parameters": run.parameters(),
        })
    }
}

/// What `summary.json` says of a phase.
fn phase_json(phase: &Phase) -> Value {
    json!({
        "delta_tau": phase.change,
        "strain": phase.strain,
        "rows": [phase.start, phase.end],
        "intervals": phase.duration(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_pass_over_what_is_not_finite() {
        let moments = finite_moments(&[1.0, f64::NAN, 3.0, f64::INFINITY]);
        assert_eq!((moments.mean, moments.population_deviation()), (2.0, 1.0));
        assert!(finite_moments(&[f64::NAN]).mean.is_nan());
    }
}
