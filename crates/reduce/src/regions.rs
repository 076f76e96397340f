//! `regions`: the scalars of every frame, GR regions among them, as a table.

use std::path::{Path, PathBuf};

use super::scalars::FrameSeries;
use gshear_analysis::frame_scalars::SCALAR_COLUMNS;
use gshear_dem::failure::Failure;
use gshear_store::run_reader::Run;
use gshear_store::table::Table;
use gshear_store::text_writer;

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
