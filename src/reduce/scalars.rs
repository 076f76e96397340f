//! The scalars of all frames of a run, with γ and τ: what the statistics over phases are made of.

use rayon::prelude::*;

use crate::analysis::frame_scalars::{FrameScalars, Scratch, frame_scalars};
use crate::failure::Failure;
use crate::io::run_reader::{Fields, Run};
use crate::state::Frame;

/// One row for every frame, or for every interval that the run itself has looked at.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrameSeries {
    /// [L] steps since the start of the shear.
    pub step: Vec<u64>,
    /// [L] γ.
    pub strain: Vec<f64>,
    /// [L] τ.
    pub tau: Vec<f64>,
    /// [L] row k between the rows k-1 and k; undefined in row 0.
    pub scalars: Vec<FrameScalars>,
}

impl FrameSeries {
    /// From `observables/gshear/` where the run has it, else from the frames.
    ///
    /// Errors: a damaged run; a frame at a step at which the time series has no row.
    pub fn of(run: &Run) -> Result<Self, Failure> {
        match run.stored_scalars() {
            Some(stored) => Self::at(run, stored.step.clone(), stored.scalars.clone()),
            None => Self::of_frames(run),
        }
    }

    /// From the frames alone.
    pub fn of_frames(run: &Run) -> Result<Self, Failure> {
        // Before the work, so that a run that will not do is refused at once.
        let mut series = Self::at(run, run.frame_steps().to_vec(), Vec::new())?;
        series.scalars = compute(run)?;
        Ok(series)
    }

    fn at(run: &Run, step: Vec<u64>, scalars: Vec<FrameScalars>) -> Result<Self, Failure> {
        let rows = run.series();
        let row_of = |step: &u64| {
            rows.step.binary_search(step).map_err(|_| {
                Failure::input(format!(
                    "{}: a frame is at step {step}, where the time series has no row, so it has no τ: \
                     output.series_strain must be output.frame_strain or a whole part of it",
                    run.path().display()
                ))
            })
        };
        let found: Vec<usize> = step.iter().map(row_of).collect::<Result<_, _>>()?;
        let column = |name: &str| {
            let values = rows.column(name);
            found.iter().map(|row| values[*row]).collect()
        };
        Ok(FrameSeries {
            strain: column("strain"),
            tau: column("stress_ratio"),
            step,
            scalars,
        })
    }
}

/// The scalars of every frame, [T]. Memory holds two blocks of frames, whatever their number.
fn compute(run: &Run) -> Result<Vec<FrameScalars>, Failure> {
    let mut scalars = Vec::with_capacity(run.frames());
    if run.frames() > 0 {
        scalars.push(FrameScalars::UNDEFINED);
    }
    let read = |first: usize| -> Result<Vec<Frame>, Failure> {
        let end = run.frames().min(first + run.block_length());
        run.block_of(first..end, Fields::Forces)
    };
    let mut frames = read(0)?;
    while scalars.len() < run.frames() {
        let next = scalars.len() - 1 + frames.len();
        // The next block is read while the processor is busy with this one.
        let (following, found) = rayon::join(
            || read(next),
            || -> Vec<FrameScalars> {
                let pairs = frames.par_windows(2);
                let scalars_of = |scratch: &mut Scratch, pair: &[Frame]| {
                    frame_scalars(run.grains(), &pair[0], &pair[1], scratch)
                };
                pairs.map_init(Scratch::default, scalars_of).collect()
            },
        );
        scalars.extend(found);
        frames = frames.pop().into_iter().chain(following?).collect();
    }
    Ok(scalars)
}
