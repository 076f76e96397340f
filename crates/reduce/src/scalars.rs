//! The scalars of all frames of a run, with γ and τ: the input of statistics over phases.

use rayon::prelude::*;

use crate::commands::dmin::{between, is_planar};
use crate::frame_pairs::{self, consecutive};
use gshear_analysis::dmin::{NonAffine, RADIUS};
use gshear_analysis::frame_scalars::{FrameScalars, ScalarScratch, Stressed, frame_scalars};
use gshear_analysis::stress::ratio_on_top;
use gshear_dem::failure::Result;
use gshear_dem::state::{Frame, FrameRecords};
use gshear_store::run_reader::{FrameFields, RunFile, StoredScalars};

/// Scalars of frames: one row per frame, or per interval for which the run has computed them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrameSeries {
    /// `[L]` Steps since the start of the shear.
    pub step: Vec<u64>,
    /// `[L]` γ.
    pub strain: Vec<f64>,
    /// `[L]` τ.
    pub tau: Vec<f64>,
    /// `[L]` Scalars between the rows k-1 and k; undefined in row 0.
    pub scalars: Vec<FrameScalars>,
}

impl FrameSeries {
    /// Reads the scalars of `observables/gshear/` if the run has them; otherwise computes them from
    /// the frames.
    ///
    /// τ is taken from the time series if it has a row for every frame. Otherwise it is summed over
    /// the contacts of the frames, which agrees within rounding.
    ///
    /// # Errors
    /// A damaged run; a stored scalar, or a frame between flat walls, without its row in the time
    /// series.
    pub fn of(run: &RunFile) -> Result<Self> {
        match run.stored_scalars() {
            Some(stored) => Self::stored(run, stored),
            None => Self::of_frames(run),
        }
    }

    fn stored(run: &RunFile, stored: &StoredScalars) -> Result<Self> {
        let tau = column_at(run, "stress_ratio", &stored.step);
        let strain = column_at(run, "strain", &stored.step);
        let (Some(tau), Some(strain)) = (tau, strain) else {
            return Err(run.wrong(
                "observables/gshear: a step has no row in the time series, which τ is taken from",
            ));
        };
        Ok(FrameSeries {
            step: stored.step.clone(),
            strain,
            tau,
            scalars: stored.scalars.clone(),
        })
    }

    /// Computes the scalars from the frames.
    ///
    /// # Errors
    /// A damaged run; a frame between flat walls without its row in the time series.
    pub fn of_frames(run: &RunFile) -> Result<Self> {
        let strain = match column_at(run, "strain", run.frame_steps()) {
            Some(strain) => strain,
            None => run.frame_strains()?,
        };
        let recorded = column_at(run, "stress_ratio", run.frame_steps());
        if recorded.is_none() && run.has_flat_walls() {
            return Err(run.wrong(
                "a frame has no row in the time series, which τ is taken from between flat walls, whose contacts no frame holds; run it with frames at rows (output.frame_strain a whole number of output.series_strain)",
            ));
        }
        let (tau, scalars) = compute(run)?.into_iter().unzip();
        Ok(FrameSeries {
            step: run.frame_steps().to_vec(),
            strain,
            tau: recorded.unwrap_or(tau),
            scalars,
        })
    }
}

/// Returns the scalars of every frame of any run, `[T]`; of spheres and boxes those of D²min alone.
///
/// # Errors
/// A damaged run.
pub fn of_any(run: &RunFile) -> Result<Vec<FrameScalars>> {
    if is_planar(run) {
        return Ok(FrameSeries::of(run)?.scalars);
    }
    let radius = RADIUS * run.grains().mean_radius();
    let value = |(): &mut (), numbers: [usize; 2], frames: [&FrameRecords; 2]| {
        FrameScalars::of_dmin(&between(run, numbers, frames, radius))
    };
    let mut scalars = vec![FrameScalars::UNDEFINED; run.frames().min(1)];
    let write = |_, values| {
        scalars.extend::<Vec<_>>(values);
        Ok(())
    };
    if run.frames() > 0 {
        frame_pairs::each(
            run,
            &consecutive(run),
            |range| run.records(range),
            value,
            write,
        )?;
    }
    Ok(scalars)
}

/// Most grains, in all frames together, of which a report computes D²min: seconds.
const MOST_GRAINS: usize = 30_000_000;

/// Returns the steps between which the greatest D²min of a run of disks between walls lies: of its
/// stored scalars, or of consecutive frames. `None` without D²min, or if there are too many grains
/// and frames to look.
///
/// # Errors
/// A damaged run.
pub fn interval_of_greatest_dmin(run: &RunFile) -> Result<Option<[u64; 2]>> {
    let (steps, greatest): (&[u64], Vec<f64>) = match run.stored_scalars() {
        Some(stored) => {
            let of_rows = stored.scalars.iter().map(|row| row.dmin_greatest);
            (&stored.step, of_rows.collect())
        }
        None if run.frames() * run.grains().count() > MOST_GRAINS => return Ok(None),
        None => (run.frame_steps(), greatest_of_frames(run)?),
    };
    let defined = (1..steps.len()).filter(|t| greatest[*t].is_finite());
    let found = defined.max_by(|a, b| greatest[*a].total_cmp(&greatest[*b]));
    Ok(found.map(|t| [steps[t - 1], steps[t]]))
}

/// Returns gD²min of every frame of disks between walls, `[T]` (m²); NaN of frame 0.
fn greatest_of_frames(run: &RunFile) -> Result<Vec<f64>> {
    let grains = run.grains();
    let radius = RADIUS * grains.mean_radius();
    let read = |range| run.block_of(range, FrameFields::Pairs);
    let value = |of: &mut NonAffine, _: [usize; 2], [earlier, later]: [&Frame; 2]| {
        let mut dmin = vec![f64::NAN; grains.count()];
        of.between(grains, radius, earlier, later, &mut dmin);
        dmin.into_iter().fold(f64::NAN, f64::max)
    };
    let mut greatest = vec![f64::NAN; run.frames().min(1)];
    if run.frames() > 0 {
        frame_pairs::each(run, &consecutive(run), read, value, |_, values| {
            greatest.extend(values);
            Ok(())
        })?;
    }
    Ok(greatest)
}

/// Returns a column of the time series at the given steps; `None` if one of them has no row.
fn column_at(run: &RunFile, name: &str, steps: &[u64]) -> Option<Vec<f64>> {
    let (rows, values) = (&run.series().step, run.series().column(name));
    let value = |step: &u64| rows.binary_search(step).ok().map(|row| values[row]);
    steps.iter().map(value).collect()
}

/// Returns τ and the scalars of every frame, `[T]`.
fn compute(run: &RunFile) -> Result<Vec<(f64, FrameScalars)>> {
    let grains = run.grains();
    let read = |range| -> Result<Vec<Stressed>> {
        let frames = run.block_of(range, FrameFields::Forces)?.into_par_iter();
        Ok(frames.map(|frame| Stressed::new(grains, frame)).collect())
    };
    let value = |scratch: &mut ScalarScratch, _: [usize; 2], [earlier, later]: [&Stressed; 2]| {
        let scalars = frame_scalars(grains, earlier, later, scratch);
        (ratio_on_top(grains, &later.frame), scalars)
    };
    let mut rows = Vec::with_capacity(run.frames());
    if run.frames() > 0 {
        let first = run.block_of(0..1, FrameFields::Forces)?.swap_remove(0);
        rows.push((ratio_on_top(grains, &first), FrameScalars::UNDEFINED));
    }
    frame_pairs::each(run, &consecutive(run), read, value, |_, values| {
        rows.extend(values);
        Ok(())
    })?;
    Ok(rows)
}
