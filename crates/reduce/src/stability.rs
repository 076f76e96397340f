//! `stability`: counts complex pairs and negative eigenvalues of frames.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::export::{FrameRange, Which};
use super::stiffness::{StateSelection, StoredState};
use gshear_analysis::jacobian::History;
use gshear_analysis::stability::Stability;
use gshear_dem::failure::Failure;
use gshear_store::dictionary;
use gshear_store::run_reader::RunFile;
use gshear_store::table::Table;

/// Most unknowns of a dense matrix whose eigenvalues are found.
const MOST_UNKNOWNS: usize = 6000;

/// Writes `stability.csv` into `folder`, one line per frame; if asked for, the first frame with a
/// complex pair is the last. With [`History::Unturned`] K is that of the paper. Returns its path.
///
/// # Errors
/// A damaged run, a missing frame, too many unknowns, a file that cannot be written; once it is
/// written, frames whose K is not finite.
pub fn write(
    run: &RunFile,
    (frames, until_pair): (FrameRange, bool),
    history: History,
    folder: &Path,
) -> Result<PathBuf, Failure> {
    let frames = frames.of(run)?;
    let strains = run.frame_strains()?;
    let mut rows: Vec<(usize, usize, usize, Result<Stability, Failure>)> = Vec::new();
    // Frames are read one after the other, as many at a time as there are threads.
    for some in frames.chunks(rayon::current_num_threads()) {
        let states = some
            .iter()
            .map(|&t| {
                Ok((
                    t,
                    StoredState::of_run(run, StateSelection::Frame(Which::Number(t)))?,
                ))
            })
            .collect::<Result<Vec<_>, Failure>>()?;
        let found = states
            .par_iter()
            .map(|(t, state)| {
                let jacobian = state.jacobian(history);
                if jacobian.unknowns() > MOST_UNKNOWNS {
                    return Err(Failure::input(format!(
                        "{}: {} unknowns, must be {MOST_UNKNOWNS} or fewer, because all eigenvalues are found; use spectrum --unstable",
                        run.path().display(),
                        jacobian.unknowns()
                    )));
                }
                Ok((*t, jacobian.contacts, jacobian.sliding, state.stability(history)))
            })
            .collect::<Result<Vec<_>, Failure>>()?;
        rows.extend(found);
        let is_pair = |found: &Result<Stability, Failure>| {
            found.as_ref().is_ok_and(|found| found.pairs > 0.0)
        };
        if let (true, Some(k)) = (until_pair, rows.iter().position(|row| is_pair(&row.3))) {
            rows.truncate(k + 1);
            break;
        }
    }
    let csv = Table::of(&rows)
        .column("frame", |(t, ..)| *t)
        .column("step", |(t, ..)| run.frame_steps()[*t])
        .column("strain", |(t, ..)| strains[*t])
        .column("contacts", |(_, contacts, ..)| *contacts)
        .column("sliding", |(_, _, sliding, _)| *sliding)
        .columns(
            Stability::COLUMNS.map(|column| column.name),
            |(.., found)| found.as_ref().unwrap_or(&Stability::UNKNOWN).columns(),
        )
        .csv();
    let path = folder.join("stability.csv");
    dictionary::write_table(&path, &csv)?;
    let failed = rows.iter().filter_map(|(.., found)| found.as_ref().err());
    let failed: Vec<String> = failed.map(ToString::to_string).collect();
    if failed.is_empty() {
        Ok(path)
    } else {
        Err(Failure::numbers(format!(
            "{}; {} has NaN for it and all other frames",
            failed.join("; "),
            path.display()
        )))
    }
}
