//! `regions`: writes the table of the scalars of every frame, such as the number of GR regions.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::scalars::FrameSeries;
use gshear_analysis::frame_scalars::SCALAR_COLUMNS;
use gshear_dem::failure::Failure;
use gshear_store::run_reader::Run;
use gshear_store::text_writer;

/// Writes `regions.csv` into `folder`, one line per frame. Returns its path.
///
/// # Errors
/// An unfit or damaged run, a file that cannot be written.
pub fn write(run: &Run, folder: &Path) -> Result<PathBuf, Failure> {
    let path = folder.join("regions.csv");
    text_writer::write(&path, &table(&FrameSeries::of(run)?))?;
    Ok(path)
}

/// Numbers have the shortest form that reads back to the same bits.
fn table(series: &FrameSeries) -> String {
    let mut csv = format!(
        "frame,step,strain,stress_ratio,{}\n",
        SCALAR_COLUMNS.join(",")
    );
    for (k, scalars) in series.scalars.iter().enumerate() {
        let (step, strain, tau) = (series.step[k], series.strain[k], series.tau[k]);
        write!(csv, "{k},{step},{strain:?},{tau:?}").expect("a string grows");
        for value in scalars.columns() {
            write!(csv, ",{value:?}").expect("a string grows");
        }
        csv.push('\n');
    }
    csv
}
