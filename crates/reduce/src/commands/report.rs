//! `report`: a page on a run.

use std::path::{Path, PathBuf};

use super::rate_state::{self, Laws};
use super::replay::{self, ReplayRequest, Rows};
use crate::printer::Printer;
use crate::results::Results;
use gshear_dem::failure::Failure;
use gshear_store::file_names::NEWTONIAN_FILE;
use gshear_store::run_reader::{RunFile, RunStage};

/// Write a report: index.html with all figures, each as SVG with its data as CSV, summary.json
///
/// If no frames show the largest drop of a run between walls but checkpoints were kept
/// (output.keep_checkpoints), the drop is computed again, with a frame per row. The page of a run
/// in a periodic box shows what its deformation and Newton's equations have measured.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, aqs.h5 or newtonian.h5, or the folder of a run
    pub run: PathBuf,
    /// Folder to write into [default: the run's folder + /report]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Arguments {
    /// `threads`: of a replay.
    ///
    /// # Errors
    /// A damaged run, a replay that differs, files that cannot be written.
    pub fn run(&self, threads: usize, printer: &mut Printer) -> Result<(), Failure> {
        let run = RunFile::open_any(&self.run)?;
        let beside = || Results::of(None, run.folder()).place("report");
        let folder = self.out.clone().unwrap_or_else(beside);
        let page = match run.stage() {
            RunStage::Shear => between_walls(&run, &folder, threads)?,
            _ => in_a_box(&run, &self.run, &folder)?,
        };
        printer.wrote(&page)
    }
}

/// The page of a box: of its strain steps and, if its folder is given, of Newton's equations.
fn in_a_box(run: &RunFile, given: &Path, folder: &Path) -> Result<PathBuf, Failure> {
    let moving = given.join(NEWTONIAN_FILE);
    let moving = (run.stage() == RunStage::Strain && moving.exists()).then_some(moving);
    let moving = moving.map(|path| RunFile::open_any(&path)).transpose()?;
    let files: Vec<&RunFile> = [run].into_iter().chain(&moving).collect();
    gshear_report::write_box(&files, folder)
}

/// If no frames show the largest drop and checkpoints were kept, replays it into `folder`/replay.
/// Velocity steps and holds under a spring are reduced into `folder`/rate-state.
fn between_walls(run: &RunFile, folder: &Path, threads: usize) -> Result<PathBuf, Failure> {
    let missing = gshear_report::window_without_frames(run)?.filter(|_| replay::can(run));
    let again = |time| {
        let request = ReplayRequest {
            rows: Rows::Time(time),
            every: None,
            threads,
        };
        replay::window(run, request, &folder.join("replay"))
    };
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
