//! `stability`: counts complex pairs and negative eigenvalues of frames.

use std::path::PathBuf;

use rayon::prelude::*;

use crate::frame_selection::{FrameRange, Which};
use crate::printer::Printer;
use crate::results::Results;
use crate::stored_state::{StateSelection, StoredState, history};
use gshear_analysis::stability::Stability;
use gshear_dem::failure::{Failure, Result};
use gshear_store::csv_table::Table;
use gshear_store::run_reader::RunFile;

/// Most unknowns of a dense matrix whose eigenvalues are found.
const MOST_UNKNOWNS: usize = 6000;

/// Count complex pairs and negative eigenvalues of frames, in stability.csv
///
/// One line per frame, from all eigenvalues of K v = λ M v without vectors, which takes a fifth
/// of the time of spectrum --dense: up to 6,000 unknowns.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, or the folder of a run; run.h5/newtonian for Newton's equations of a box
    pub run: PathBuf,
    /// Frames A to B, both included, every Nth of them; .. is all
    #[arg(long, value_name = "A..B[:N]", default_value = "..")]
    frames: FrameRange,
    /// Take J as printed by Bonfanti et al., whose histories do not turn with the contacts
    #[arg(long)]
    paper_form: bool,
    /// Stop at the first of these frames with a complex pair
    #[arg(long)]
    until_pair: bool,
    /// Folder to write into [default: the run's]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// The stability of a frame, or why its K has no eigenvalues.
struct FrameStability {
    frame: usize,
    contacts: usize,
    sliding: usize,
    found: Result<Stability>,
}

impl Arguments {
    /// # Errors
    /// A damaged run, a missing frame, too many unknowns, a file that cannot be written; once it is
    /// written, frames whose K is not finite.
    pub fn run(&self, printer: &mut Printer) -> Result<()> {
        let run = RunFile::open_any(&self.run)?;
        let results = Results::of(self.out.as_deref(), run.folder());
        let frames = self.frames.of(&run)?;
        let strains = run.frame_strains()?;
        let mut rows = Vec::new();
        // Frames are read one after the other, as many at a time as there are threads.
        for some in frames.chunks(rayon::current_num_threads()) {
            rows.extend(self.frames(&run, some)?);
            let is_pair = |row: &FrameStability| row.found.as_ref().is_ok_and(|of| of.pairs > 0.0);
            if let (true, Some(k)) = (self.until_pair, rows.iter().position(is_pair)) {
                rows.truncate(k + 1);
                break;
            }
        }
        results.table("stability.csv", &table(&run, &strains, &rows), printer)?;
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

    fn frames(&self, run: &RunFile, frames: &[usize]) -> Result<Vec<FrameStability>> {
        let read = |t: &usize| {
            let state = StoredState::of_run(run, StateSelection::Frame(Which::Number(*t)))?;
            Ok((*t, state))
        };
        let states: Vec<_> = frames.iter().map(read).collect::<Result<_>>()?;
        let history = history(self.paper_form);
        let of = |(frame, state): &(usize, StoredState)| {
            let jacobian = state.jacobian(history);
            if jacobian.unknowns() > MOST_UNKNOWNS {
                let what = format!(
                    "{} unknowns, must be {MOST_UNKNOWNS} or fewer, because all eigenvalues are found; use spectrum --unstable",
                    jacobian.unknowns()
                );
                return Err(run.wrong(what));
            }
            Ok(FrameStability {
                frame: *frame,
                contacts: jacobian.contacts,
                sliding: jacobian.sliding,
                found: state.stability(&jacobian),
            })
        };
        states.par_iter().map(of).collect()
    }
}

fn table(run: &RunFile, strains: &[f64], rows: &[FrameStability]) -> String {
    Table::of(rows)
        .column("frame", |row| row.frame)
        .column("step", |row| run.frame_steps()[row.frame])
        .column("strain", |row| strains[row.frame])
        .column("contacts", |row| row.contacts)
        .column("sliding", |row| row.sliding)
        .columns(Stability::COLUMNS.map(|column| column.name), |row| {
            let found = row.found.as_ref();
            found.unwrap_or(&Stability::UNKNOWN).columns()
        })
        .csv()
}
