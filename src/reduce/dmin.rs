//! `dmin`: D²min between consecutive frames, into `reduced.h5`.

use std::path::{Path, PathBuf};

use ndarray::Array2;
use rayon::prelude::*;

use crate::analysis::dmin::NonAffine;
use crate::failure::Failure;
use crate::io::reduced_writer::ReducedWriter;
use crate::io::run_reader::Run;
use crate::state::Frame;

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
    let mut last: Option<Frame> = None;
    let mut first = 0;
    while first < run.frames() {
        let end = run.frames().min(first + run.block_length());
        let mut frames: Vec<Frame> = last.take().into_iter().collect();
        frames.extend(run.block(first..end)?);
        let mut values = Array2::zeros((frames.len() - 1, n));
        // Without grains the rows have no elements to hand out.
        if n > 0 {
            let rows = values
                .as_slice_mut()
                .expect("in standard layout")
                .par_chunks_exact_mut(n);
            rows.zip(frames.par_windows(2)).for_each_init(
                NonAffine::default,
                |non_affine, (row, pair)| {
                    non_affine.between(run.grains(), radius, &pair[0], &pair[1], row);
                },
            );
        }
        if values.nrows() > 0 {
            writer.dmin(end - values.nrows(), values.view())?;
        }
        last = frames.pop();
        first = end;
    }
    writer.finish()
}
