//! `regions`: writes the table of the scalars of every frame, such as the number of GR regions.

use std::path::PathBuf;

use crate::printer::Printer;
use crate::results::Results;
use crate::scalars::FrameSeries;
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_dem::failure::Result;
use gshear_store::csv_table::Table;
use gshear_store::run_reader::RunFile;

/// Write the scalars of every frame into regions.csv: GR regions, gD²min, contact angles (Lee &
/// Hurley, section 3)
///
/// One line per frame, from the frame before it to this one: the greatest D²min and the mean of
/// the greatest tenth (m²), the number of GR regions for minPts = 1 and 2 of DBSCAN (the point
/// itself counted), Spearman's rho of |Δσ_p| with D²min and its p, mean and median contact
/// angle in GR regions (rad).
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, or the folder that holds one
    pub run: PathBuf,
    /// Folder to write into [default: the run's]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Arguments {
    /// # Errors
    /// An unfit or damaged run, a file that cannot be written.
    pub fn run(&self, printer: &mut Printer) -> Result<()> {
        let run = RunFile::open_between_walls(&self.run)?;
        let results = Results::of(self.out.as_deref(), run.folder());
        results.table("regions.csv", &table(&FrameSeries::of(&run)?), printer)
    }
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
