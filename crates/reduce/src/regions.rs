//! `regions`: writes the table of the scalars of every frame, such as the number of GR regions.

use std::path::{Path, PathBuf};

use super::scalars::FrameSeries;
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_dem::failure::Failure;
use gshear_store::dictionary;
use gshear_store::run_reader::RunFile;
use gshear_store::table::Table;

/// Writes `regions.csv` into `folder`, one line per frame. Returns its path.
///
/// # Errors
/// An unfit or damaged run, a file that cannot be written.
pub fn write(run: &RunFile, folder: &Path) -> Result<PathBuf, Failure> {
    let path = folder.join("regions.csv");
    dictionary::write_table(&path, &table(&FrameSeries::of(run)?))?;
    Ok(path)
}

fn table(series: &FrameSeries) -> String {
    Table::of(0..series.scalars.len())
        .column("frame", |k| *k)
        .column("step", |k| series.step[*k])
        .column("strain", |k| series.strain[*k])
        .column("stress_ratio", |k| series.tau[*k])
        .columns(FrameScalars::COLUMNS, |k| series.scalars[*k].columns())
        .csv()
}
