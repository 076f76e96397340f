//! `report`: a page on a run, or on several.

mod sweep;

use std::path::{Path, PathBuf};

use super::figure_arguments::FigureArguments;
use super::rate_state;
use super::replay::{self, Rows};
use crate::printer::Printer;
use crate::results::Results;
use crate::scalars::interval_of_greatest_dmin;
use gshear_dem::failure::{Failure, Result};
use gshear_driver::estimate::bytes;
use gshear_driver::progress::duration;
use gshear_driver::stored_run::condition;
use gshear_report::drawing::Format;
use gshear_report::{Rearranging, Sources};
use gshear_store::file_names::folder_of;
use gshear_store::part;
use gshear_store::run_reader::{RunFile, RunStage};

/// Write a report: index.html with all figures, each as SVG with its data as CSV, summary.json
///
/// The data of figures of the time series are in log.csv of the run. --formats svg,pdf,png writes
/// the figures in other formats as well, for papers and slides.
///
/// Of disks between walls the maps show the states right before and after the largest drop of τ,
/// and the greatest D²min. Unless frames show them, these parts are computed again from the
/// checkpoint before them (output.keep_checkpoints), with a frame per row, if that takes less than
/// two minutes and 1 GB; --replay makes longer ones as well and keeps their files. The page of
/// quasi-static strain shows what it and Newton's equations have measured. Of a run with both, the
/// first stage has the first page, with a link to the other.
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
    #[command(flatten)]
    figures: FigureArguments,
    /// Compute parts of the run again, however long it takes, and keep the folders replay and
    /// replay-dmin with them
    #[arg(long)]
    replay: bool,
    /// Compute no part of the run again: show the nearest frames
    #[arg(long, conflicts_with = "replay")]
    no_replay: bool,
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
        let folder = Results::path(self.out.as_deref(), run.folder(), "report")?;
        let choice = match (self.replay, self.no_replay) {
            (true, _) => Choice::All,
            (_, true) => Choice::None,
            _ => Choice::Short,
        };
        let again = Replays { choice, threads };
        let pages = Pages {
            again: &again,
            formats: &self.figures.formats,
        };
        // A later stage has a page of its own; Newton's equations are on that of the strain steps.
        let mut later = None;
        let is_whole = part::file_of(first) == *first;
        for stage in [RunStage::Shear, RunStage::Strain] {
            if is_whole
                && stage != run.stage()
                && let Some(file) = run.part(stage)?
            {
                let folder = folder.join(stage.name());
                pages.of(&file, None, &folder, printer)?;
                later = Some(stage);
            }
        }
        let page = pages.of(&run, later, &folder, printer)?;
        printer.wrote(&page)
    }

    fn of_several(&self, printer: &mut Printer) -> Result<()> {
        let first = &self.runs[0];
        let is_sweep = self.runs.len() == 1 && sweep::is_of_runs(first);
        let name = if is_sweep { "report" } else { "sweep-report" };
        let folder = Results::path(self.out.as_deref(), folder_of(first), name)?;
        sweep::write(self, self.start.unwrap_or(START), &folder, printer)
    }
}

/// How the pages of a run are made.
struct Pages<'a> {
    again: &'a Replays,
    formats: &'a [Format],
}

impl Pages<'_> {
    /// The page of a stage. `later`: a stage after it whose page is in a folder of its name.
    fn of(
        &self,
        run: &RunFile,
        later: Option<RunStage>,
        folder: &Path,
        printer: &mut Printer,
    ) -> Result<PathBuf> {
        match run.stage() {
            RunStage::Shear => self.of_shear(run, later, folder, printer),
            RunStage::Strain | RunStage::Newtonian => self.of_strain(run, later, folder),
        }
    }

    /// The page of strain steps and of Newton's equations after them.
    fn of_strain(&self, run: &RunFile, later: Option<RunStage>, folder: &Path) -> Result<PathBuf> {
        let moving = match run.stage() {
            RunStage::Strain => run.part(RunStage::Newtonian)?,
            _ => None,
        };
        let files: Vec<&RunFile> = [run].into_iter().chain(&moving).collect();
        let conditions: Vec<_> = files.iter().map(|file| condition(file)).collect();
        gshear_report::write_box(&files, &conditions, later, self.formats, folder)
    }

    /// The page of a shear. Velocity steps and holds under a spring are reduced into
    /// `folder`/rate-state.
    fn of_shear(
        &self,
        run: &RunFile,
        later: Option<RunStage>,
        folder: &Path,
        printer: &mut Printer,
    ) -> Result<PathBuf> {
        let [of_drop, of_dmin] = ["replay", "replay-dmin"].map(|name| folder.join(name));
        let mut drop = None;
        if let Some(steps) = gshear_report::drop_without_frames(run) {
            drop = (self.again).replayed(run, "the largest drop", steps, &of_drop, printer)?;
        }
        let (mut rearranging, mut finer) = (None, None);
        if gshear_report::shows_drops(run) {
            rearranging = interval_of_greatest_dmin(run)?;
            if let Some(steps) = rearranging
                && has_rows_within(run, steps)
            {
                let what = "the greatest D²min";
                finer = self.again.replayed(run, what, steps, &of_dmin, printer)?;
            }
        }
        let mut rate_state = None;
        if rate_state::is_test(run) {
            let (runs, silent) = (std::slice::from_ref(run), &mut std::io::sink());
            let into = folder.join("rate-state");
            let options = rate_state::Options::with_formats(self.formats.to_vec());
            rate_state::write(runs, &options, &into, &mut Printer::new(silent))?;
            rate_state = Some("rate-state/index.html");
        }
        let sources = Sources {
            condition: &condition(run),
            drop: drop.as_ref(),
            rearranging: rearranging.map(|steps| Rearranging {
                steps,
                shown: finer.as_ref().unwrap_or(run),
            }),
            rate_state,
            later,
        };
        let page = gshear_report::write(run, &sources, self.formats, folder)?;
        let replays = [(drop, of_drop), (finer, of_dmin)];
        let made = replays.into_iter().filter(|(replay, _)| replay.is_some());
        // Closed before they are removed.
        let made: Vec<PathBuf> = made.map(|(_, folder)| folder).collect();
        if self.again.choice != Choice::All {
            made.iter().try_for_each(|folder| removed(folder))?;
        }
        Ok(page)
    }
}

/// Removes the folder of a replay, which is as large as the rest of a report.
fn removed(folder: &Path) -> Result<()> {
    std::fs::remove_dir_all(folder)
        .map_err(|e| Failure::other(format!("{}: cannot be removed: {e}", folder.display())))
}

/// Whether the time series has rows at both steps and between them.
fn has_rows_within(run: &RunFile, steps: [u64; 2]) -> bool {
    let rows = steps.map(|step| run.series().step.binary_search(&step));
    matches!(rows, [Ok(first), Ok(last)] if last > first + 1)
}

/// Whether and how a report computes parts of a run again.
struct Replays {
    choice: Choice,
    threads: usize,
}

/// What the user wants of replays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Choice {
    /// Those that take little time.
    Short,
    /// All.
    All,
    /// None.
    None,
}

/// Most grain-steps of a thread in a replay that a report makes unasked: about two minutes. A limit
/// in time would depend on how busy the machine was.
const LONGEST: f64 = 2e9;
/// Greatest size of its file (bytes), and what a grain with its contacts takes in a frame.
const LARGEST: f64 = 1e9;
const BYTES: f64 = 150.0;
/// Grain-steps per second of a thread, if the run was slower, as on a busy machine.
const SPEED: f64 = 1e7;

impl Replays {
    /// Replays the run between the rows of two steps into `out`, with a frame for every row, and
    /// says so and how long it will take. `None` if the user or the run does not allow it, which a
    /// line says.
    ///
    /// # Errors
    /// A signal that stops it, output that cannot be written.
    fn replayed(
        &self,
        run: &RunFile,
        what: &str,
        steps: [u64; 2],
        out: &Path,
        printer: &mut Printer,
    ) -> Result<Option<RunFile>> {
        let [first, last] = steps;
        if self.choice == Choice::None {
            return Ok(None);
        }
        let Some(start) = replay::start(run, first) else {
            writeln!(
                printer,
                "{what} is shown by the nearest frames: there is no checkpoint before step {first} to replay it from \
                 (output.keep_checkpoints = true keeps them)"
            )?;
            return Ok(None);
        };
        let grains = run.grains().count() as f64;
        let grain_steps = (last - start) as f64 * grains / self.threads as f64;
        let speed = run.number("speed").map_or(SPEED, |speed| speed.max(SPEED));
        let time = duration((grain_steps / speed).ceil());
        let rows = run.series().step.iter();
        let frames = rows.filter(|step| (first..=last).contains(*step)).count() as f64;
        let size = frames * grains * BYTES;
        if self.choice == Choice::Short && (grain_steps > LONGEST || size > LARGEST) {
            let size = bytes(size);
            writeln!(
                printer,
                "{what} is shown by the nearest frames: a replay takes about {time} and {size}; give --replay for it"
            )?;
            return Ok(None);
        }
        writeln!(
            printer,
            "replays steps {start} to {last} for {what}, about {time} (--no-replay leaves it out)"
        )?;
        printer.flush()?;
        match replay::window(run, Rows::Steps(steps), None, self.threads, out) {
            Ok(replayed) => Ok(Some(replayed.run)),
            // Of another version, or damaged: the report shows what there is.
            Err(failure @ (Failure::Numbers(_) | Failure::Input(_))) => {
                writeln!(printer, "{what} is shown by the nearest frames: {failure}")?;
                Ok(None)
            }
            Err(failure) => Err(failure),
        }
    }
}
