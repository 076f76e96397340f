//! The scalars of all frames of a run, with γ and τ: the input of statistics over phases.

use std::ops::Range;

use rayon::prelude::*;

use crate::frame_pairs::{self, DminOfPairs, FramePair, PairWork, consecutive};
use gshear_analysis::frame_scalars::{FrameScalars, ScalarScratch, Stressed, frame_scalars};
use gshear_analysis::stress::ratio_on_top;
use gshear_dem::failure::Result;
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
    /// A damaged run; a stored scalar, or a frame between flat walls of an earlier version, without
    /// its row in the time series.
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
    /// A damaged run; a frame between flat walls of an earlier version without its row in the time
    /// series.
    pub fn of_frames(run: &RunFile) -> Result<Self> {
        let strain = match column_at(run, "strain", run.frame_steps()) {
            Some(strain) => strain,
            None => run.frame_strains()?,
        };
        let recorded = column_at(run, "stress_ratio", run.frame_steps());
        if recorded.is_none() && run.boundary().has_planes() && !run.form().walls {
            return Err(run.wrong(
                "a frame has no row in the time series, which τ is taken from between flat walls, whose contacts the frames of earlier versions do not hold; run it again, or with frames at rows (output.frame_strain a whole number of output.series_strain)",
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

/// Returns the scalars of every frame of any run, `[T]`; without walls those of D²min alone.
///
/// # Errors
/// A damaged run.
pub(crate) fn of_any(run: &RunFile) -> Result<Vec<FrameScalars>> {
    if run.boundary().has_walls() {
        return Ok(FrameSeries::of(run)?.scalars);
    }
    let mut scalars = vec![FrameScalars::UNDEFINED; run.frames().min(1)];
    let work = DminOfPairs::of_paper(run);
    frame_pairs::each(run, &consecutive(run), &work, |_, rows| {
        let rows = rows.iter();
        scalars.extend(rows.map(|(dmin, _)| FrameScalars::of_dmin(dmin)));
        Ok(())
    })?;
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
pub(crate) fn interval_of_greatest_dmin(run: &RunFile) -> Result<Option<[u64; 2]>> {
    let (steps, greatest): (&[u64], Vec<f64>) = match run.stored_scalars() {
        Some(stored) => {
            let greatest = stored.scalars.iter().map(|row| row.dmin_greatest);
            (&stored.step, greatest.collect())
        }
        None if run.frames() * run.grains().count() > MOST_GRAINS => return Ok(None),
        None => (run.frame_steps(), greatest_of_frames(run)?),
    };
    let defined = (1..steps.len()).filter(|t| greatest[*t].is_finite());
    let greatest = defined.max_by(|a, b| greatest[*a].total_cmp(&greatest[*b]));
    Ok(greatest.map(|t| [steps[t - 1], steps[t]]))
}

/// Returns gD²min of every frame of disks between walls, `[T]` (m²); NaN of frame 0.
fn greatest_of_frames(run: &RunFile) -> Result<Vec<f64>> {
    let mut greatest = vec![f64::NAN; run.frames().min(1)];
    let work = DminOfPairs::of_paper(run);
    frame_pairs::each(run, &consecutive(run), &work, |_, rows| {
        let rows = rows.into_iter();
        greatest.extend(rows.map(|(dmin, _)| dmin.into_iter().fold(f64::NAN, f64::max)));
        Ok(())
    })?;
    Ok(greatest)
}

/// Returns a column of the time series at the given steps; `None` if one of them has no row.
fn column_at(run: &RunFile, name: &str, steps: &[u64]) -> Option<Vec<f64>> {
    let (rows, values) = (&run.series().step, run.series().column(name));
    let values = steps.iter().map(|step| {
        let row = rows.binary_search(step).ok()?;
        Some(values[row])
    });
    values.collect()
}

/// τ and the scalars of a frame.
type FrameRow = (f64, FrameScalars);

/// The scalars of Lee & Hurley between two frames, and τ of the later one.
struct ScalarsOfPairs<'a>(&'a RunFile);

impl PairWork for ScalarsOfPairs<'_> {
    type Frame = Stressed;
    type Buffer = ScalarScratch;
    type Value = FrameRow;

    fn read(&self, range: Range<usize>) -> Result<Vec<Stressed>> {
        let frames = self.0.records_with(range, FrameFields::Forces)?;
        let frames = frames.into_par_iter();
        let stressed = frames.map(|frame| Stressed::new(self.0.grains(), frame));
        Ok(stressed.collect())
    }

    fn value(&self, scratch: &mut ScalarScratch, pair: FramePair<'_, Stressed>) -> FrameRow {
        let (grains, [earlier, later]) = (self.0.grains(), pair.frames);
        let scalars = frame_scalars(grains, earlier, later, scratch);
        (ratio_on_top(grains, &later.frame), scalars)
    }
}

/// Returns τ and the scalars of every frame, `[T]`.
fn compute(run: &RunFile) -> Result<Vec<FrameRow>> {
    let mut rows = Vec::with_capacity(run.frames());
    if run.frames() > 0 {
        let first = run.records_with(0..1, FrameFields::Forces)?.swap_remove(0);
        let tau = ratio_on_top(run.grains(), &first);
        rows.push((tau, FrameScalars::UNDEFINED));
    }
    frame_pairs::each(run, &consecutive(run), &ScalarsOfPairs(run), |_, values| {
        rows.extend(values);
        Ok(())
    })?;
    Ok(rows)
}
