//! The numbers of a run's report.

use serde_json::{Value, json};

use gshear_analysis::dmin;
use gshear_analysis::moments::{Moments, extent};
use gshear_analysis::phases::{self, Phase, PhaseKind};
use gshear_dem::failure::Result;
use gshear_dem::state::{Disks, Frame};
use gshear_store::run_reader::RunFile;

/// Moments of the finite values.
pub fn finite_moments(values: &[f64]) -> Moments {
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
pub fn is_imposed(run: &RunFile) -> bool {
    run.series().has("imposed_normal_force")
}

/// Whether a run can have phases of stick and slip, or has some.
pub fn has_phases(run: &RunFile, phases: &[Phase]) -> bool {
    !(is_imposed(run) || run.has_free_surface()) || !phases.is_empty()
}

/// Least normal force with which τ is shown, over the greatest one of the run. Under less, as in a
/// liquefied layer, τ is a ratio of two noises.
const LEAST_LOAD: f64 = 0.01;

/// `[L]` τ of a run; NaN in rows in which the layer bears next to no load, if a protocol imposes
/// more than velocities.
pub fn stress_ratio(run: &RunFile) -> Vec<f64> {
    let series = run.series();
    let (tau, normal) = (series.column("stress_ratio"), series.column("normal_force"));
    let least = if is_imposed(run) {
        LEAST_LOAD * normal.iter().copied().fold(0.0, f64::max)
    } else {
        f64::NEG_INFINITY
    };
    let shown = |(tau, normal): (&f64, &f64)| if *normal < least { f64::NAN } else { *tau };
    tau.iter().zip(normal).map(shown).collect()
}

/// Stick and slip phases of a run. Where a protocol imposes more than velocities, only those at a
/// constant velocity of the drive are any: else τ rises and falls with what is imposed. A free
/// surface has no drive.
fn phases_of(run: &RunFile, tau: &[f64]) -> Vec<Phase> {
    if run.has_free_surface() {
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

/// Rows of the latter half of the strain; of the time, if a protocol imposes more than velocities.
pub fn latter_half(run: &RunFile) -> std::ops::RangeFrom<usize> {
    // A strain that returns does not tell the halves of a run.
    let clock = if is_imposed(run) {
        &run.series().time[..]
    } else {
        run.series().column("strain")
    };
    let half = 0.5 * clock.last().copied().unwrap_or(0.0);
    clock.partition_point(|now| *now < half)..
}

/// The largest slip at a constant velocity of the drive, after the start of the flow: τ first
/// overshoots its mean of the latter half, and is back where that slip ends.
fn largest_drop(run: &RunFile, tau: &[f64], phases: &[Phase]) -> Option<Phase> {
    let mean = finite_moments(&tau[latter_half(run)]).mean;
    let is_over = |row: &usize| tau[*row] > mean;
    let mut rows = (0..tau.len()).skip_while(|row| !is_over(row));
    let start = rows.find(|row| !is_over(row)).unwrap_or(0);
    let after = |phase: &&Phase| phase.start >= start && is_free(run, phase);
    phases::largest_drop(&phases.iter().filter(after).copied().collect::<Vec<_>>()).copied()
}

/// Whether frames are drawn around the largest drop: of disks between walls.
fn shows_drops(run: &RunFile) -> bool {
    run.dimension().axes() == 2 && run.has_walls()
}

/// Time (s) from before the start to after the end of the largest drop, if it is one of disks that
/// no frames show from its start to its end.
///
/// # Errors
/// A damaged file.
pub fn window_without_frames(run: &RunFile) -> Result<Option<[f64; 2]>> {
    let series = run.series();
    let tau = stress_ratio(run);
    let Some(drop) = largest_drop(run, &tau, &phases_of(run, &tau)).filter(|_| shows_drops(run))
    else {
        return Ok(None);
    };
    let shown = |row: usize| run.frame_steps().binary_search(&series.step[row]).is_ok();
    let window = [drop.start, drop.end].map(|row| series.time[row]);
    Ok((!(shown(drop.start) && shown(drop.end))).then_some(window))
}

/// The two frames around a drop, and D²min between them.
pub struct DropFrames {
    /// The slip.
    pub drop: Phase,
    /// Index of the last frame at or before the start of the drop, and of the first at or after its
    /// end.
    pub frames: [usize; 2],
    /// γ of the two frames.
    pub strain: [f64; 2],
    /// The frame before the drop.
    pub earlier: Frame,
    /// The frame after the drop.
    pub later: Frame,
    /// `[N]` D²min between the two frames (m²).
    pub dmin: Vec<f64>,
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
        let frames = |phase: &Phase| {
            let after = steps.partition_point(|step| *step <= rows[phase.start]);
            let earlier = after.checked_sub(1)?;
            let later = steps.partition_point(|step| *step < rows[phase.end]);
            (later < steps.len()).then_some([earlier, later])
        };
        let mut covered = phases.to_vec();
        covered.retain(|phase| frames(phase).is_some());
        let drop = largest_drop(run, tau, &covered);
        let Some((drop, frames)) = drop.and_then(|drop| Some((drop, frames(&drop)?))) else {
            return Ok(None);
        };
        let strain = shown.frame_strains()?;
        let [earlier, later] = [shown.frame(frames[0])?, shown.frame(frames[1])?];
        Ok(Some(DropFrames {
            drop,
            frames,
            strain: frames.map(|t| strain[t]),
            dmin: dmin::between(run.grains(), &earlier, &later),
            earlier,
            later,
        }))
    }

    /// Returns the position of the grain with the greatest D²min, or of the first grain if none has
    /// one.
    pub fn centre(&self) -> [f64; 2] {
        let defined = (0..self.dmin.len()).filter(|n| self.dmin[*n].is_finite());
        let greatest = defined.max_by(|a, b| self.dmin[*a].total_cmp(&self.dmin[*b]));
        let place = self.later.position.get(greatest.unwrap_or(0));
        place.copied().unwrap_or_default()
    }

    /// Returns the greatest D²min over r̄²; `None` if no grain has one.
    pub fn greatest_dmin(&self, grains: &Disks) -> Option<f64> {
        let greatest = extent(self.dmin.iter().copied().filter(|d| d.is_finite()))[1];
        (greatest.is_finite()).then(|| greatest / grains.mean_radius().powi(2))
    }
}

/// All numbers of a run's report.
pub struct Summary {
    /// Stick and slip phases of the whole run.
    pub phases: Vec<Phase>,
    /// The largest drop after the start of the flow.
    pub drop: Option<Phase>,
    /// Moments of τ over the latter half of the strain; of the time, if a protocol imposes more
    /// than velocities.
    pub stress: Moments,
    /// The drop that the maps show.
    pub event: Option<DropFrames>,
}

impl Summary {
    /// Computes the numbers of a run. `replayed`: the run around its largest drop, with frames.
    ///
    /// # Errors
    /// If the run is damaged.
    pub fn of(run: &RunFile, replayed: Option<&RunFile>) -> Result<Self> {
        let tau = stress_ratio(run);
        let phases = phases_of(run, &tau);
        let event = DropFrames::largest(run, replayed.unwrap_or(run), &tau, &phases)?;
        Ok(Summary {
            drop: largest_drop(run, &tau, &phases),
            stress: finite_moments(&tau[latter_half(run)]),
            event,
            phases,
        })
    }

    /// Returns the number of long and of short phases of a kind.
    pub fn count(&self, kind: PhaseKind) -> [usize; 2] {
        let of_kind = self.phases.iter().filter(|phase| phase.kind == kind);
        let long = of_kind.clone().filter(|phase| phase.is_long()).count();
        [long, of_kind.count() - long]
    }

    /// Returns the content of `summary.json`.
    pub fn json(&self, run: &RunFile) -> Value {
        let phase = |phase: &Phase| {
            json!({
                "delta_tau": phase.change,
                "strain": phase.strain,
                "rows": [phase.start, phase.end],
                "intervals": phase.duration(),
            })
        };
        let count = |kind: PhaseKind| {
            let [long, short] = self.count(kind);
            json!({ "long": long, "short": short })
        };
        let event = self.event.as_ref().map(|event| {
            json!({
                "drop": phase(&event.drop),
                "frames": event.frames,
                "strain": event.strain,
                "greatest_dmin_over_mean_radius_squared": event.greatest_dmin(run.grains()),
            })
        });
        json!({
            "run": run.path().display().to_string(),
            "digest": run.digest(),
            "speed": run.number("speed"),
            "grains": run.grains().count(),
            "frames": run.frames(),
            "series_rows": run.series().rows(),
            "final_strain": run.series().column("strain").last(),
            "stress_ratio_latter_half": { "mean": self.stress.mean, "standard_deviation": self.stress.population_deviation() },
            "phases": { "stick": count(PhaseKind::Stick), "slip": count(PhaseKind::Slip) },
            "largest_drop": self.drop.as_ref().map(phase),
            "maps": event,
            "parameters": run.parameters(),
        })
    }
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
