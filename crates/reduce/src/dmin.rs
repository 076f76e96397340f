//! `dmin`: writes D²min between consecutive frames into `reduced.h5`.

use std::ops::Range;
use std::path::{Path, PathBuf};

use ndarray::Array2;
use rayon::prelude::*;

use super::pool::Pool;
use gshear_analysis::dmin::NonAffine;
use gshear_analysis::event;
use gshear_dem::dimension::{Three, Two};
use gshear_dem::failure::Failure;
use gshear_dem::state::FrameRecords;
use gshear_scene::Dimensions;
use gshear_store::reduced_writer::ReducedWriter;
use gshear_store::run_reader::{FrameFields, RunFile, RunStage};

/// Writes `reduced.h5` into `folder` and returns its path. `radius`: radius of the neighbourhood
/// over r̄. Memory holds two blocks of frames, whatever their number.
///
/// # Errors
/// A radius that is not positive, a damaged run, a file that cannot be written.
pub fn write(run: &RunFile, folder: &Path, radius: f64) -> Result<PathBuf, Failure> {
    if !(radius.is_finite() && radius > 0.0) {
        return Err(Failure::input(format!(
            "--radius {radius}: must be a positive number of mean radii"
        )));
    }
    let n = run.grains().count();
    let writer = ReducedWriter::create(folder, &run.frame_strains()?, n)?;
    writer.text("run", &run.path().display().to_string())?;
    writer.text("run_id", run.text("run_id").unwrap_or_default())?;
    writer.text("digest", run.digest().unwrap_or_default())?;
    writer.text("version", env!("CARGO_PKG_VERSION"))?;
    writer.number("radius_over_mean_radius", radius)?;
    let radius = radius * run.grains().mean_radius();

    if run.frames() > 0 {
        writer.dmin(0, Array2::from_elem((1, n), f64::NAN).view())?;
    }
    if is_planar(run) {
        let pool = Pool::<NonAffine>::default();
        each_pair(
            run,
            &writer,
            |range| run.block_of(range, FrameFields::Pairs),
            || pool.lend(),
            |non_affine, _, [earlier, later], row| {
                let non_affine = &mut non_affine.buffer;
                non_affine.between(run.grains(), radius, earlier, later, row);
            },
        )?;
    } else {
        each_pair(
            run,
            &writer,
            |range| run.records(range),
            || (),
            |(), numbers, frames, row| {
                row.copy_from_slice(&between(run, numbers, frames, radius));
            },
        )?;
    }
    writer.finish()
}

/// Whether [`NonAffine`] computes D²min, which is faster: of disks between walls.
pub fn is_planar(run: &RunFile) -> bool {
    run.stage() == RunStage::Shear && run.dimension() == Dimensions::Two
}

/// Returns D²min of every grain between two frames of these numbers, `[N]` (m²), with the neighbours
/// within `radius` (m) in the earlier one. NaN where it is not defined; rattlers do not count.
pub fn between(
    run: &RunFile,
    numbers: [usize; 2],
    frames: [&FrameRecords; 2],
    radius: f64,
) -> Vec<f64> {
    let (grains, interval) = (run.grains(), run.interval(numbers, frames));
    match run.dimension() {
        Dimensions::Two => event::between_frames::<Two>(grains, &interval, radius),
        Dimensions::Three => event::between_frames::<Three>(grains, &interval, radius),
    }
}

/// Writes one row per pair of consecutive frames, computed by `value` with a buffer per thread.
fn each_pair<F: Send + Sync, B>(
    run: &RunFile,
    writer: &ReducedWriter,
    read: impl Fn(Range<usize>) -> Result<Vec<F>, Failure> + Sync,
    buffer: impl Fn() -> B + Sync + Send,
    value: impl Fn(&mut B, [usize; 2], [&F; 2], &mut [f64]) + Sync + Send,
) -> Result<(), Failure> {
    let n = run.grains().count();
    let block = |first: usize| read(first..run.frames().min(first + run.block_length()));
    let (mut frames, mut first) = (block(0)?, 1);
    while first < run.frames() {
        let mut values = Array2::zeros((frames.len() - 1, n));
        let next = first + values.nrows();
        let work = |values: &mut Array2<f64>| {
            // Chunks of zero elements would panic.
            if n == 0 {
                return;
            }
            let values = values.as_slice_mut().expect("in standard layout");
            let pairs = values.par_chunks_exact_mut(n).zip(frames.par_windows(2));
            let pairs = pairs.enumerate();
            // Consecutive frames share the neighbour lists of a buffer; chunks stay small enough to
            // keep all threads busy.
            let together = (frames.len() / (4 * rayon::current_num_threads())).clamp(1, 8);
            pairs
                .with_min_len(together)
                .for_each_init(&buffer, |buffer, (k, (row, pair))| {
                    let numbers = [first + k - 1, first + k];
                    value(buffer, numbers, [&pair[0], &pair[1]], row);
                });
        };
        // Reads the next block during the computation.
        let (following, ()) = rayon::join(|| block(next), || work(&mut values));
        if values.nrows() > 0 {
            writer.dmin(first, values.view())?;
        }
        frames = frames.pop().into_iter().chain(following?).collect();
        first = next;
    }
    Ok(())
}
