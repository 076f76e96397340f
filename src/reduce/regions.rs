//! `regions`: the scalars of every frame, GR regions among them, as a table.

use std::path::{Path, PathBuf};

use super::scalars::FrameSeries;
use crate::analysis::frame_scalars::SCALAR_COLUMNS;
use crate::failure::Failure;
use crate::io::run_reader::Run;
use crate::io::table::Table;
use crate::io::text_writer;

/// Writes `regions.csv` into `folder`: a line a frame. Returns the file.
///
/// Errors: a run that will not do, a file that cannot be written.
pub fn write(run: &Run, folder: &Path) -> Result<PathBuf, Failure> {
    let path = folder.join("regions.csv");
    text_writer::write(&path, &table(&FrameSeries::of(run)?))?;
    Ok(path)
}

fn table(series: &FrameSeries) -> String {
    Table::of(0..series.scalars.len())
        .column("frame", |k| *k)
        .column("step", |k| series.step[*k])
        .column("strain", |k| series.strain[*k])
        .column("stress_ratio", |k| series.tau[*k])
        .columns(SCALAR_COLUMNS, |k| series.scalars[*k].columns())
        .csv()
}
