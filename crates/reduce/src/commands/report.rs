//! `report`: a page on a run, or on several.

mod sweep;

use std::path::{Path, PathBuf};

use super::rate_state::{self, Laws};
use super::replay::{self, Rows};
use crate::printer::Printer;
use crate::results::Results;
use gshear_dem::failure::Result;
use gshear_store::file_names::{NEWTONIAN_PART, folder_of};
use gshear_store::part;
use gshear_store::run_reader::{RunFile, RunStage};

/// Write a report: index.html with all figures, each as SVG with its data as CSV, summary.json
///
/// If no frames show the largest drop of a run between walls but checkpoints were kept
/// (output.keep_checkpoints), the drop is computed again, with a frame per row. The page of a run
/// in a periodic box shows what its deformation and Newton's equations have measured.
///
/// Several runs, or the folder of a sweep, are compared: their curves over each other, and means
/// with standard errors over seeds against the keys in which their scenes differ. Writes means.csv,
/// runs.csv and a page with figures. Runs that failed or have not ended are left out. With
/// --columns, --against or --start one run has such a report, too.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, run.h5/newtonian, or the folder of a run; several of them, or the folder of a
    /// sweep
    #[arg(required = true, value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    /// Columns to compare: of the time series, of regions.csv, or of runs.csv; gshear-reduce
    /// columns lists them [default: τ, φ, z and so on, as far as all runs have them]
    #[arg(long, value_delimiter = ',', value_name = "NAME,...")]
    columns: Vec<String>,
    /// Key of the scenes that means are drawn against [default: the one with the most values]
    #[arg(long, value_name = "KEY")]
    against: Option<String>,
    /// Share of the rows of each run, from the first on, that means leave out [default: 0.5]
    #[arg(long, value_name = "SHARE", value_parser = share)]
    start: Option<f64>,
    /// Folder to write into [default: the folder of the run or of the sweep + /report; of several
    /// runs that of the first + /sweep-report]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Share of the rows that means leave out unless told otherwise: the latter half is steady.
const START: f64 = 0.5;

fn share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(share) if (0.0..1.0).contains(&share) => Ok(share),
        _ => Err("must be a share of the rows, from 0 to below 1".into()),
    }
}

impl Arguments {
    /// `threads`: of a replay.
    ///
    /// # Errors
    /// A damaged run, a replay that differs, files that cannot be written; runs that cannot be
    /// compared.
    pub fn run(&self, threads: usize, printer: &mut Printer) -> Result<()> {
        let first = &self.runs[0];
        let compares = !self.columns.is_empty() || self.against.is_some() || self.start.is_some();
        if compares || self.runs.len() > 1 || sweep::is_of_runs(first) {
            return self.of_several(printer);
        }
        let run = RunFile::open_any(first)?;
        let beside = || Results::of(None, run.folder()).place("report");
        let folder = self.out.clone().unwrap_or_else(beside);
        let page = match run.stage() {
            RunStage::Shear => between_walls(&run, &folder, threads)?,
            _ => in_a_box(&run, first, &folder)?,
        };
        printer.wrote(&page)
    }

    fn of_several(&self, printer: &mut Printer) -> Result<()> {
        let first = &self.runs[0];
        let is_sweep = self.runs.len() == 1 && sweep::is_of_runs(first);
        let name = if is_sweep { "report" } else { "sweep-report" };
        let beside = || Results::of(None, folder_of(first)).place(name);
        let folder = self.out.clone().unwrap_or_else(beside);
        sweep::write(self, self.start.unwrap_or(START), &folder, printer)
    }
}

/// The page of a box: of its strain steps and, if its folder is given, of Newton's equations.
fn in_a_box(run: &RunFile, given: &Path, folder: &Path) -> Result<PathBuf> {
    let moving = given.join(NEWTONIAN_PART);
    let moving = (run.stage() == RunStage::Strain && part::exists(&moving)).then_some(moving);
    let moving = moving.map(|path| RunFile::open_any(&path)).transpose()?;
    let files: Vec<&RunFile> = [run].into_iter().chain(&moving).collect();
    gshear_report::write_box(&files, folder)
}

/// If no frames show the largest drop and checkpoints were kept, replays it into `folder`/replay.
/// Velocity steps and holds under a spring are reduced into `folder`/rate-state.
fn between_walls(run: &RunFile, folder: &Path, threads: usize) -> Result<PathBuf> {
    let missing = gshear_report::window_without_frames(run)?.filter(|_| replay::can(run));
    let out = folder.join("replay");
    let again = |time| replay::window(run, Rows::Time(time), None, threads, &out);
    let replayed = missing.map(again).transpose()?;
    let replayed = replayed.as_ref().map(|of| &of.run);
    let mut rate_state = None;
    if rate_state::is_test(run) {
        let (runs, silent) = (std::slice::from_ref(run), &mut std::io::sink());
        let into = folder.join("rate-state");
        rate_state::write(runs, (Laws::Both, None), &into, &mut Printer::new(silent))?;
        rate_state = Some("rate-state/index.html");
    }
    gshear_report::write(run, replayed, rate_state, folder)
}
