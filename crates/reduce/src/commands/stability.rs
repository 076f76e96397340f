//! `stability`: counts complex pairs and negative eigenvalues of frames.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::replay::{self, Rows};
use crate::frame_selection::{FrameRange, Which};
use crate::printer::Printer;
use crate::results::Results;
use crate::stored_state::{StateSelection, StoredState, history};
use gshear_analysis::stability::{DampedStability, Stability};
use gshear_dem::columns::Column;
use gshear_dem::failure::{Failure, Result};
use gshear_store::csv_table::Table;
use gshear_store::run_reader::{RunFile, RunStage};

/// Most unknowns of a dense matrix whose eigenvalues are found.
const MOST_UNKNOWNS: usize = 6000;

/// Count complex pairs and negative eigenvalues of frames, in stability.csv
///
/// One line per frame, from all eigenvalues of K v = λ M v without vectors, which takes a fifth
/// of the time of spectrum --dense: up to 6,000 unknowns, with --dampers 3,000.
#[derive(Debug, clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "flags of the command line")]
pub struct Arguments {
    /// A run.h5, or the folder of a run; run.h5/aqs, run.h5/newtonian or run.h5/shear for a later
    /// stage
    pub run: PathBuf,
    /// Frames A to B, both included, every Nth of them; .. is all
    #[arg(long, value_name = "A..B[:N]", default_value = "..")]
    frames: FrameRange,
    /// Take J as printed by Bonfanti et al., whose histories do not turn with the contacts
    #[arg(long)]
    paper_form: bool,
    /// Also count the motions e^(st) that grow with the dampers of the law, all s of
    /// (s² M + s C + K) v = 0: eight times as long
    #[arg(long)]
    dampers: bool,
    /// Stop at the first of these frames with a complex pair
    #[arg(long)]
    until_pair: bool,
    /// Find the rows of the time series between which a complex pair is born: computes the run
    /// again, with a frame per row, between the first frame with a pair and the one before it, and
    /// bisects; into the folder birth, with a stability.csv of its own. The run must have kept a
    /// checkpoint before (output.keep_checkpoints)
    #[arg(long)]
    birth: bool,
    /// Folder to write into [default: the run's]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Folder of the replayed frames around the birth of a pair.
const BIRTH_FOLDER: &str = "birth";

/// The stability of a frame, or why its K has no eigenvalues.
struct FrameStability {
    frame: usize,
    contacts: usize,
    sliding: usize,
    found: Result<(Stability, Option<DampedStability>)>,
}

impl FrameStability {
    fn has_pair(&self) -> bool {
        let found = self.found.as_ref();
        found.is_ok_and(|(stability, _)| stability.pairs > 0.0)
    }
}

impl Arguments {
    /// `threads`: of a replay.
    ///
    /// # Errors
    /// A damaged run, a missing frame, too many unknowns, a file that cannot be written; a birth in
    /// a run that cannot be replayed; once the table is written, frames whose K is not finite.
    pub fn run(&self, threads: usize, printer: &mut Printer) -> Result<()> {
        let run = RunFile::open_any(&self.run)?;
        if self.birth && run.stage() == RunStage::Strain {
            return Err(run.wrong(
                "is of strain steps, which find the birth of a pair while they run: set aqs.spectrum = true",
            ));
        }
        let results = Results::of(self.out.as_deref(), run.folder());
        let frames = self.frames.of(&run)?;
        let strains = run.frame_strains()?;
        let mut rows = Vec::new();
        // Frames are read one after the other, as many at a time as there are threads.
        for some in frames.chunks(rayon::current_num_threads()) {
            rows.extend(self.frames(&run, some)?);
            if self.until_pair
                && let Some(k) = rows.iter().position(FrameStability::has_pair)
            {
                rows.truncate(k + 1);
                break;
            }
        }
        let columns = table(&run, &strains, &rows, self.dampers);
        results.table("stability.csv", &columns, printer)?;
        if self.birth {
            self.find_birth(&run, &rows, &results.place(BIRTH_FOLDER)?, threads, printer)?;
        }
        let failed = rows.iter().filter_map(|row| row.found.as_ref().err());
        let failed: Vec<String> = failed.map(ToString::to_string).collect();
        if failed.is_empty() {
            return Ok(());
        }
        Err(Failure::numbers(format!(
            "{}; {} has NaN for it and all other frames",
            failed.join("; "),
            results.place("stability.csv")?.display()
        )))
    }

    /// Finds two rows of the time series, the first without a pair and the next with one, between
    /// the first of these frames with a pair and the one before it, and says so.
    fn find_birth(
        &self,
        run: &RunFile,
        frames: &[FrameStability],
        folder: &Path,
        threads: usize,
        printer: &mut Printer,
    ) -> Result<()> {
        let Some(first) = frames.iter().position(FrameStability::has_pair) else {
            return writeln!(printer, "birth: none of these frames has a complex pair");
        };
        if first == 0 {
            let frame = frames[0].frame;
            return writeln!(
                printer,
                "birth: before frame {frame}, the first of these, which has a complex pair already"
            );
        }
        let steps = [first - 1, first].map(|k| run.frame_steps()[frames[k].frame]);
        let replayed = replay::window(run, Rows::Steps(steps), None, threads, folder)?.run;
        let strains = replayed.frame_strains()?;
        let mut tried = Vec::new();
        let (mut without, mut with) = (0, replayed.frames() - 1);
        while with - without > 1 {
            let middle = usize::midpoint(without, with);
            let rows = self.frames(&replayed, &[middle])?;
            if rows.iter().any(FrameStability::has_pair) {
                with = middle;
            } else {
                without = middle;
            }
            tried.extend(rows);
        }
        tried.sort_by_key(|row| row.frame);
        let rows = table(&replayed, &strains, &tried, self.dampers);
        Results::of(Some(folder), folder).table("stability.csv", &rows, printer)?;
        let [before, after] = [without, with].map(|k| (replayed.frame_steps()[k], strains[k]));
        writeln!(
            printer,
            "birth: a complex pair between steps {} and {}, strains {} and {}",
            before.0, after.0, before.1, after.1
        )
    }

    fn frames(&self, run: &RunFile, frames: &[usize]) -> Result<Vec<FrameStability>> {
        let mut states = Vec::new();
        for &t in frames {
            let state = StoredState::of_run(run, StateSelection::Frame(Which::Number(t)))?;
            states.push((t, state));
        }
        let history = history(self.paper_form);
        let rows = states.par_iter().map(|(frame, state)| {
            let jacobian = state.jacobian(history);
            let most = if self.dampers {
                MOST_UNKNOWNS / 2
            } else {
                MOST_UNKNOWNS
            };
            if jacobian.unknowns() > most {
                let what = format!(
                    "{} unknowns, must be {most} or fewer, because all eigenvalues are found; use spectrum --unstable",
                    jacobian.unknowns()
                );
                return Err(run.wrong(what));
            }
            Ok(FrameStability {
                frame: *frame,
                contacts: jacobian.contacts,
                sliding: jacobian.sliding,
                found: state.stability(&jacobian, self.dampers),
            })
        });
        rows.collect()
    }
}

/// `with_dampers`: with the columns of [`DampedStability`].
fn table(run: &RunFile, strains: &[f64], rows: &[FrameStability], with_dampers: bool) -> String {
    let damped: &[Column] = if with_dampers {
        &DampedStability::COLUMNS
    } else {
        &[]
    };
    Table::of(rows)
        .column("frame", |row| row.frame)
        .column("step", |row| run.frame_steps()[row.frame])
        .column("strain", |row| strains[row.frame])
        .column("contacts", |row| row.contacts)
        .column("sliding", |row| row.sliding)
        .columns(Stability::COLUMNS.map(|column| column.name), |row| {
            let found = row.found.as_ref();
            found
                .map_or(Stability::UNKNOWN, |(stability, _)| *stability)
                .columns()
        })
        .columns(damped.iter().map(|column| column.name), |row| {
            let found = row.found.as_ref().ok();
            let found = found.and_then(|(_, damped)| *damped);
            let values = found.unwrap_or(DampedStability::UNKNOWN).columns();
            values.into_iter().take(damped.len())
        })
        .csv()
}
