//! `replay`: computes a part of a run again, with frames, from the checkpoint before it.

use std::io::Write;
use std::path::{Path, PathBuf};

use crate::output::cannot_write;
use gshear_dem::domain::Solo;
use gshear_dem::failure::Failure;
use gshear_driver::header::{Header, Saved};
use gshear_driver::launch::Task;
use gshear_driver::options::Options;
use gshear_driver::options::Outcome;
use gshear_driver::say::say_error;
use gshear_scene::schedule::ReplayWindow;
use gshear_store::checkpoint;
use gshear_store::columns::NewtonianRow;
use gshear_store::file_names::{NEWTONIAN_FILE, RUN_FILE};
use gshear_store::run_reader::{self, RunFile};
use gshear_store::text_writer::unwritten;

/// The rows of the time series that are replayed: from the first to the last in a range.
#[derive(Debug, Clone, Copy)]
pub enum Rows {
    /// γ at both ends.
    Strain([f64; 2]),
    /// Time at both ends (s): for a strain that returns.
    Time([f64; 2]),
}

/// The part of a run to replay.
#[derive(Debug, Clone, Copy)]
pub struct ReplayRequest {
    /// Its rows.
    pub rows: Rows,
    /// Steps between frames; `None`: one frame per row of the time series.
    pub every: Option<u64>,
    /// Number of threads; the results do not depend on it.
    pub threads: usize,
}

/// Result of a replay.
pub struct Replayed {
    /// The replayed part.
    pub run: RunFile,
    /// Step of the checkpoint that the replay started from.
    pub from: u64,
    /// Number of rows of the time series compared, all equal to the last bit.
    pub rows: usize,
}

/// Parses `A..B`, a strain or a time at both ends.
///
/// # Errors
/// A message if the text is not a range of finite numbers with 0 ≤ A < B.
pub fn range(text: &str) -> Result<[f64; 2], String> {
    let wrong = || format!("{text:?} is no range; write it as 0.1005..0.1006");
    let (from, to) = text.split_once("..").ok_or_else(wrong)?;
    let number = |text: &str| text.trim().parse::<f64>().map_err(|_| wrong());
    let (from, to) = (number(from)?, number(to)?);
    if from >= 0.0 && to > from && to.is_finite() {
        Ok([from, to])
    } else {
        Err(wrong())
    }
}

/// Returns whether the run kept checkpoints.
pub fn can(run: &RunFile) -> bool {
    !checkpoint::kept(run.folder(), "shear").is_empty()
}

/// Replays a part of a run and prints a summary.
///
/// # Errors
/// As [`window`].
pub fn write(
    run: &RunFile,
    request: ReplayRequest,
    out: Option<&Path>,
    output: &mut impl Write,
) -> Result<(), Failure> {
    let default = match request.rows {
        Rows::Strain([from, to]) => format!("replay-{from}-{to}"),
        Rows::Time([from, to]) => format!("replay-time-{from}-{to}"),
    };
    let default = run.folder().join(default);
    let found = window(run, request, out.unwrap_or(&default))?;
    let steps = found.run.frame_steps();
    writeln!(
        output,
        "wrote {}: {} frames, steps {} to {}, from the checkpoint of step {}; {} rows of the time series equal those of {} to the last bit",
        found.run.path().display(),
        steps.len(),
        steps.first().copied().unwrap_or_default(),
        steps.last().copied().unwrap_or_default(),
        found.from,
        found.rows,
        run.path().display()
    )
    .map_err(cannot_write)
}

/// Replays the run from the first to the last row of the time series in the range, into
/// `out`/run.h5.
///
/// # Errors
/// [`Failure::Input`] if the range has fewer than two rows or no checkpoint before it;
/// [`Failure::Numbers`] if the time series differs from the stored one.
pub fn window(run: &RunFile, request: ReplayRequest, out: &Path) -> Result<Replayed, Failure> {
    let window = steps(run, request)?;
    if same_folder(out, run.folder()) {
        return Err(Failure::input(format!(
            "{}: holds the run itself; give another folder with --out",
            out.display()
        )));
    }
    let set = [
        "analysis.scalars=false",
        "output.keep_checkpoints=false",
        "output.progress_lines=0",
    ];
    let from = again(run.folder(), "shear", window, &set, (request.threads, out))?;
    let again = RunFile::open(&out.join(RUN_FILE))?;
    let rows = compare(run, &again)?;
    Ok(Replayed {
        run: again,
        from,
        rows,
    })
}

/// Returns the steps of the first and the last row of the time series in the range.
fn steps(run: &RunFile, request: ReplayRequest) -> Result<ReplayWindow, Failure> {
    let series = run.series();
    let (what, values, [from, to]) = match request.rows {
        Rows::Strain(range) => ("strains", series.column("strain"), range),
        Rows::Time(range) => ("times", &series.time[..], range),
    };
    let within = |row: &usize| values[*row] >= from && values[*row] <= to;
    let mut rows = (0..series.rows()).filter(within);
    let bad = |what: String| Failure::input(format!("{}: {what}", run.path().display()));
    let (Some(first), Some(last)) = (rows.next(), rows.next_back()) else {
        let ends = [values.first(), values.last()].map(|end| end.copied().unwrap_or(f64::NAN));
        return Err(bad(format!(
            "has fewer than two rows of the time series between the {what} {from} and {to}; it goes from {} to {}",
            ends[0], ends[1]
        )));
    };
    let every = request
        .every
        .unwrap_or_else(|| series.step[first + 1] - series.step[first]);
    Ok(ReplayWindow {
        first: series.step[first],
        last: series.step[last],
        every,
    })
}

/// Replays a window of a stage into the folder `out`. Returns the step of the checkpoint that the
/// replay started from.
fn again(
    folder: &Path,
    stage: &str,
    window: ReplayWindow,
    set: &[&str],
    (threads, out): (usize, &Path),
) -> Result<u64, Failure> {
    for name in [RUN_FILE, NEWTONIAN_FILE] {
        let file = out.join(name);
        if run_reader::owner(&file).is_ok_and(|owner| !owner.replay) {
            return Err(Failure::input(format!(
                "{}: is of a run, which a replay would replace; give another folder with --out",
                file.display()
            )));
        }
    }
    let saved = before(folder, stage, window.first)?;
    let from = saved.header.step();
    let set: Vec<String> = set.iter().map(|s| (*s).into()).collect();
    let task = Task::replay(saved, &set)?;
    // The files get their place when they are whole.
    let unmade = |e: std::io::Error| unwritten(out, &e);
    std::fs::create_dir_all(out).map_err(unmade)?;
    let part = tempfile::Builder::new()
        .prefix("replay.")
        .tempdir_in(out)
        .map_err(unmade)?;
    let options = Options {
        out: part.path().to_path_buf(),
        threads,
        replay: Some(window),
        ..Options::default()
    };
    if task.run(&Solo, &options)? == Outcome::Stopped {
        return Err(Failure::other("replay: stopped by a signal"));
    }
    for entry in std::fs::read_dir(&part).map_err(unmade)? {
        let entry = entry.map_err(unmade)?;
        std::fs::rename(entry.path(), out.join(entry.file_name())).map_err(unmade)?;
    }
    Ok(from)
}

/// Reads the last checkpoint of a stage before `step`, or at `step` if that is 0.
fn before(folder: &Path, stage: &str, step: u64) -> Result<Saved, Failure> {
    let mut damaged = None;
    let mut candidates = checkpoint::kept(folder, stage);
    for name in [checkpoint::PREVIOUS, checkpoint::NAME] {
        let path = folder.join(name);
        if !path.is_file() {
            continue;
        }
        // A damaged one may not be needed; if it is, the message below names it.
        let header = checkpoint::read_texts(&path).and_then(|[header, _]| Header::parse(&header));
        match header {
            Ok((header, _)) if header.stage() == stage => candidates.push((header.step(), path)),
            Ok(_) => {}
            Err(failure) => damaged = damaged.or(Some(failure)),
        }
    }
    // The forces of a frame are computed in its step, so the checkpoint must be before it.
    let fits = |(at, _): &&(u64, PathBuf)| *at < step || *at == 0;
    candidates.sort();
    for (_, path) in candidates.iter().filter(fits).rev() {
        match Saved::read(&Solo, path) {
            Ok(saved) => {
                if let Some(failure) = damaged {
                    say_error(&format!(
                        "note: {failure}; replaying from {}",
                        path.display()
                    ));
                }
                return Ok(saved);
            }
            Err(failure) => damaged = damaged.or(Some(failure)),
        }
    }
    Err(damaged.unwrap_or_else(|| {
        Failure::input(format!(
            "{}: there is no checkpoint of the stage {stage} before step {step}; a run with output.keep_checkpoints = true keeps them",
            folder.display()
        ))
    }))
}

/// Whether a path is of a run in a box: Newton's equations are replayed by their time.
pub fn has_newtonian(run: &Path) -> bool {
    let of_walls = if run.is_dir() {
        run.join(RUN_FILE).exists()
    } else {
        run.file_name().is_some_and(|name| name == RUN_FILE)
    };
    !of_walls
}

/// Replays a part of Newton's equations in a box into `newtonian.h5` of the folder `out` and prints
/// a summary. `time`: both ends (s), as in the rows of `newtonian.h5`.
///
/// # Errors
/// [`Failure::Input`] if the range has fewer than two rows or no checkpoint before it;
/// [`Failure::Numbers`] if the time series differs from the stored one.
pub fn newtonian(
    run: &Path,
    time: [f64; 2],
    (every, threads): (Option<u64>, usize),
    out: Option<&Path>,
    output: &mut impl Write,
) -> Result<(), Failure> {
    let folder = if run.is_dir() {
        run
    } else {
        run.parent().unwrap_or(Path::new("."))
    };
    let default = folder.join(format!("replay-newtonian-{}-{}", time[0], time[1]));
    let out = out.unwrap_or(&default);
    if same_folder(out, folder) {
        return Err(Failure::input(format!(
            "{}: holds the run itself; give another folder with --out",
            out.display()
        )));
    }
    let path = folder.join(NEWTONIAN_FILE);
    let file = RunFile::open_any(&path)?;
    let stored = file.series();
    let within = |row: &usize| stored.time[*row] >= time[0] && stored.time[*row] <= time[1];
    let mut rows = (0..stored.time.len()).filter(within);
    let (Some(first), Some(last)) = (rows.next(), rows.next_back()) else {
        return Err(Failure::input(format!(
            "{}: has fewer than two rows between the times {} and {}; it goes from {:?} to {:?}",
            path.display(),
            time[0],
            time[1],
            stored.time.first().unwrap_or(&f64::NAN),
            stored.time.last().unwrap_or(&f64::NAN),
        )));
    };
    let window = ReplayWindow {
        first: stored.step[first],
        last: stored.step[last],
        every: every.unwrap_or_else(|| stored.step[first + 1] - stored.step[first]),
    };
    let set = ["output.keep_checkpoints=false", "newtonian.spectra=0"];
    let from = again(folder, "newtonian", window, &set, (threads, out))?;
    let repeated = RunFile::open_any(&out.join(NEWTONIAN_FILE))?;
    let computed = repeated.series();
    let mut same = 0;
    for (k, step) in computed.step.iter().enumerate() {
        let Ok(row) = stored.step.binary_search(step) else {
            continue;
        };
        for name in NewtonianRow::COLUMNS.map(|column| column.name) {
            let (had, has) = (stored.column(name)[row], computed.column(name)[k]);
            if had.to_bits() != has.to_bits() {
                return Err(Failure::numbers(format!(
                    "replay: at step {step}, {name} is {has:?} and was {had:?} in {}; the run was made by another version or with other values",
                    path.display()
                )));
            }
        }
        same += 1;
    }
    let frames = repeated.frame_steps();
    writeln!(
        output,
        "wrote {}: {} frames, steps {} to {}, from the checkpoint of step {from}; {same} rows of the time series equal those of {} to the last bit",
        repeated.path().display(),
        frames.len(),
        frames.first().copied().unwrap_or_default(),
        frames.last().copied().unwrap_or_default(),
        path.display()
    )
    .map_err(cannot_write)
}

/// Returns the number of rows that both runs have. Fails if there are none or any differs.
fn compare(run: &RunFile, again: &RunFile) -> Result<usize, Failure> {
    let (one, other) = (run.series(), again.series());
    let (mut rows, mut different, mut first) = (0, 0, None);
    for (k, step) in other.step.iter().enumerate() {
        let Ok(row) = one.step.binary_search(step) else {
            continue;
        };
        rows += 1;
        let differs = |c: &usize| one.columns[*c][row].to_bits() != other.columns[*c][k].to_bits();
        if let Some(c) = (0..one.columns.len().min(other.columns.len())).find(differs) {
            different += 1;
            first.get_or_insert((
                *step,
                one.declared[c],
                one.columns[c][row],
                other.columns[c][k],
            ));
        }
    }
    if let Some((step, column, had, has)) = first {
        return Err(Failure::numbers(format!(
            "replay: {different} of {rows} rows of the time series differ from {}: first at step {step}, {column} is {has:?} \
             and was {had:?}; the run was made by another version or with other values ({} is kept)",
            run.path().display(),
            again.path().display()
        )));
    }
    if rows == 0 {
        return Err(Failure::input(format!(
            "{}: no row of the time series to compare the replay with",
            run.path().display()
        )));
    }
    Ok(rows)
}

fn same_folder(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => a == b,
    }
}
