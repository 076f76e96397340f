//! `dmin`: D²min between consecutive frames, into `reduced.h5`.

use std::path::{Path, PathBuf};

use ndarray::Array2;
use rayon::prelude::*;

use super::pool::Pool;
use crate::analysis::dmin::NonAffine;
use crate::failure::Failure;
use crate::io::reduced_writer::ReducedWriter;
use crate::io::run_reader::{Fields, Run};
use crate::state::{Disks, Frame};

/// Writes `reduced.h5` into `folder`; `radius` of the neighbourhood over r̄. Returns the file.
///
/// Memory holds one block of frames, whatever their number.
/// Errors: a radius that is not positive, a damaged run, a file that cannot be written.
pub fn write(run: &Run, folder: &Path, radius: f64) -> Result<PathBuf, Failure> {
    if !(radius.is_finite() && radius > 0.0) {
        return Err(Failure::input(format!(
            "--radius {radius}: must be a positive number of mean radii"
        )));
    }
    let n = run.grains().count();
    let writer = ReducedWriter::create(folder, &run.frame_strains()?, n)?;
    writer.text("run", &run.path().display().to_string())?;
    writer.text("digest", run.digest().unwrap_or(""))?;
    writer.text("version", env!("CARGO_PKG_VERSION"))?;
    writer.number("radius_over_mean_radius", radius)?;
    let radius = radius * run.grains().mean_radius();

    if run.frames() > 0 {
        writer.dmin(0, Array2::from_elem((1, n), f64::NAN).view())?;
    }
    let read = |first: usize| -> Result<Vec<Frame>, Failure> {
        let end = run.frames().min(first + run.block_length());
        run.block_of(first..end, Fields::Pairs)
    };
    let pool = Pool::default();
    let (mut frames, mut first) = (read(0)?, 1);
    while first < run.frames() {
        let mut values = Array2::zeros((frames.len() - 1, n));
        let next = first + values.nrows();
        // The next block is read while the processor is busy with this one.
        let (following, ()) = rayon::join(
            || read(next),
            || each_pair(run.grains(), radius, &frames, &pool, &mut values),
        );
        if values.nrows() > 0 {
            writer.dmin(first, values.view())?;
        }
        frames = frames.pop().into_iter().chain(following?).collect();
        first = next;
    }
    writer.finish()
}

/// D²min (m²) between each two frames that follow one another, a row each.
fn each_pair(
    grains: &Disks,
    radius: f64,
    frames: &[Frame],
    pool: &Pool<NonAffine>,
    values: &mut Array2<f64>,
) {
    // Without grains the rows have no elements to hand out.
    if grains.count() == 0 {
        return;
    }
    let values = values.as_slice_mut().expect("in standard layout");
    let rows = values.par_chunks_exact_mut(grains.count());
    let pairs = rows.zip(frames.par_windows(2)).with_min_len(8);
    pairs.for_each_init(
        || pool.lend(),
        |non_affine, (row, pair)| {
            let non_affine = &mut non_affine.buffer;
            non_affine.between(grains, radius, &pair[0], &pair[1], row);
        },
    );
}
