//! The runs of a sweep, and what is read of each for their report.

use std::path::{Path, PathBuf};

use super::Arguments;
use crate::printer::Printer;
use crate::scalars;
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_dem::failure::{Failure, Result};
use gshear_driver::stored_run::{condition, condition_by_status};
use gshear_report::sweep::{Heading, Sweep, SweepRun};
use gshear_store::file_names::{RUN_FILE, STATUS_FILE, folder_of};
use gshear_store::run_reader::RunFile;

/// Whether a folder is that of a run, which may have failed before it wrote a file.
fn has_begun(folder: &Path) -> bool {
    folder.join(RUN_FILE).exists() || folder.join(STATUS_FILE).exists()
}

/// The folders in a folder that hold a run, or one that has begun, in the order of their names.
///
/// # Errors
/// A folder that cannot be read, or without runs.
pub(crate) fn runs_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder);
    let entries = entries
        .map_err(|e| Failure::input(format!("{}: {e}", folder.display())))?
        .flatten();
    let paths = entries.map(|entry| entry.path());
    let runs = paths.filter(|path| path.is_dir() && has_begun(path));
    let mut runs: Vec<_> = runs.collect();
    runs.sort();
    if runs.is_empty() {
        return Err(Failure::input(format!(
            "{}: holds no run ({RUN_FILE}), and no folder in it does; give the folder of a run, or of a sweep",
            folder.display()
        )));
    }
    Ok(runs)
}

/// Whether a path is a folder of runs, and not of a run.
pub(crate) fn is_of_runs(path: &Path) -> bool {
    path.is_dir() && !has_begun(path)
}

/// Compares runs and writes their report into `folder`. Runs that have not ended by themselves are
/// left out, and a line says so. `start`: share of the rows that means leave out.
///
/// # Errors
/// No finished run, columns or keys that the runs lack, a run that is given twice, files that
/// cannot be read or written.
pub fn write(
    arguments: &Arguments,
    start: f64,
    folder: &Path,
    printer: &mut Printer,
) -> Result<()> {
    let (given, columns) = (&arguments.runs, &arguments.columns);
    let mut paths = Vec::new();
    for path in given {
        if is_of_runs(path) {
            paths.extend(runs_in(path)?);
        } else {
            paths.push(path.clone());
        }
    }
    let names = names(&paths);
    let (mut runs, mut skipped) = (Vec::new(), Vec::new());
    for (path, name) in paths.iter().zip(names) {
        match unfinished(path)? {
            Ok(run) => runs.push(read(name, &run, start, columns)?),
            Err(why) => skipped.push(format!("{name}: {why}")),
        }
    }
    if runs.is_empty() {
        let first = skipped.first().map(String::as_str).unwrap_or_default();
        return Err(Failure::input(format!(
            "none of {} runs has ended by itself, first {first}; finish one or more",
            skipped.len()
        )));
    }
    let sweep = Sweep::new(&runs, columns, arguments.against.as_deref())?;
    for why in &skipped {
        writeln!(printer, "left out {why}")?;
    }
    let title = match &given[..] {
        [first, rest @ .., _] => format!("{} and {} more", first.display(), rest.len() + 1),
        _ => given[0].display().to_string(),
    };
    let heading = Heading {
        title: &title,
        start,
        skipped: &skipped,
    };
    let written = sweep.write(&heading, &arguments.figures.formats, folder)?;
    written.iter().try_for_each(|path| printer.wrote(path))
}

/// Names of the folders of runs; the paths if two have the same name.
fn names(paths: &[PathBuf]) -> Vec<String> {
    let names: Vec<Option<String>> = paths.iter().map(|path| folder_name(path)).collect();
    let mut sorted = names.clone();
    sorted.sort();
    let unique = sorted.windows(2).all(|pair| pair[0] != pair[1]);
    let chosen = names.into_iter().zip(paths).map(|(name, path)| match name {
        Some(name) if unique => name,
        _ => path.display().to_string(),
    });
    chosen.collect()
}

/// The name of the folder of a run.
fn folder_name(path: &Path) -> Option<String> {
    let folder = folder_of(path);
    let whole = folder.canonicalize().unwrap_or_else(|_| folder.into());
    Some(whole.file_name()?.to_string_lossy().into_owned())
}

/// The run, or why it is left out.
///
/// # Errors
/// A path without a run that has not begun either, a damaged file.
fn unfinished(path: &Path) -> Result<Result<RunFile, String>> {
    let why = condition_by_status(folder_of(path)).map(|condition| condition.to_string());
    match (RunFile::open_any(path), why) {
        (Ok(run), _) if run.digest().is_some() => Ok(Ok(run)),
        (Ok(run), _) => Ok(Err(condition(&run).to_string())),
        (Err(_), Some(why)) if path.is_dir() && !path.join(RUN_FILE).exists() => Ok(Err(why)),
        (Err(failure), _) => Err(failure),
    }
}

fn read(name: String, run: &RunFile, start: f64, columns: &[String]) -> Result<SweepRun> {
    let frame_columns = FrameScalars::COLUMNS.map(|column| column.name);
    let are_asked = columns.iter().any(|name| frame_columns.contains(&&**name));
    let scalars = if are_asked {
        scalars::of_any(run)?
    } else {
        Vec::new()
    };
    Ok(SweepRun::of(name, run, start, columns, &scalars))
}
