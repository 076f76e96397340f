//! `replay`: computes a part of a run again, with frames, from the checkpoint before it.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::commands::lost;
use gshear_dem::domain::Solo;
use gshear_dem::failure::Failure;
use gshear_dem::state::{SERIES_COLUMNS, Snapshot};
use gshear_driver::record::RUN_FILE;
use gshear_driver::run::{self, Header, Options, Stage, Start};
use gshear_scene::schedule::Window;
use gshear_store::checkpoint;
use gshear_store::run_reader::Run;

/// The part of a run to replay.
#[derive(Debug, Clone, Copy)]
pub struct Wanted {
    /// γ at both ends.
    pub strain: [f64; 2],
    /// Steps between frames; `None`: one frame per row of the time series.
    pub every: Option<u64>,
    /// Number of threads; the results do not depend on it.
    pub threads: usize,
}

/// Result of a replay.
pub struct Replayed {
    /// The replayed part.
    pub run: Run,
    /// Step of the checkpoint that the replay started from.
    pub from: u64,
    /// Number of rows of the time series compared, all equal to the last bit.
    pub rows: usize,
}

/// Parses `A..B`, γ at both ends.
///
/// # Errors
/// A message if the text is not a range of finite strains with 0 ≤ A < B.
pub fn strains(text: &str) -> Result<[f64; 2], String> {
    let wrong = || format!("{text:?} is no stretch of strain; write it as 0.1005..0.1006");
    let (from, to) = text.split_once("..").ok_or_else(wrong)?;
    let number = |text: &str| text.trim().parse::<f64>().map_err(|_| wrong());
    let (from, to) = (number(from)?, number(to)?);
    match from >= 0.0 && to > from && to.is_finite() {
        true => Ok([from, to]),
        false => Err(wrong()),
    }
}

/// Returns whether the run kept checkpoints.
pub fn can(run: &Run) -> bool {
    !checkpoint::kept(run.folder()).is_empty()
}

/// Replays a part of a run and prints a summary.
///
/// # Errors
/// As [`window`].
pub fn write(
    run: &Run,
    wanted: Wanted,
    out: Option<&Path>,
    output: &mut impl Write,
) -> Result<(), Failure> {
    let [from, to] = wanted.strain;
    let default = run.folder().join(format!("replay-{from}-{to}"));
    let found = window(run, wanted, out.unwrap_or(&default))?;
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
    .map_err(lost)
}

/// Replays the run from the first to the last row of the time series in the range, into `out`/run.h5.
///
/// # Errors
/// [`Failure::Input`] if the range has fewer than two rows or no checkpoint before it;
/// [`Failure::Numbers`] if the time series differs from the stored one.
pub fn window(run: &Run, wanted: Wanted, out: &Path) -> Result<Replayed, Failure> {
    let window = steps(run, wanted)?;
    if same_folder(out, run.folder()) {
        return Err(Failure::input(format!(
            "{}: holds the run itself; give another folder with --out",
            out.display()
        )));
    }
    let (path, toml, snapshot) = before(run, window.first)?;
    let header = Header::read(&snapshot)?;
    let set = [
        "analysis.scalars=false",
        "output.keep_checkpoints=false",
        "output.progress_lines=0",
    ];
    let scene = header.scene(&path, toml, &set.map(String::from))?;
    let options = Options {
        out: out.to_path_buf(),
        threads: wanted.threads,
        replay: Some(window),
        ..Options::default()
    };
    let computed = run::Run::new(&Solo, &scene, &options)?.run(Start::Checkpoint(snapshot))?;
    if computed == run::Ending::Stopped {
        return Err(Failure::other("replay: stopped by a signal"));
    }
    let again = Run::open(&out.join(RUN_FILE))?;
    let rows = compare(run, &again)?;
    Ok(Replayed {
        run: again,
        from: header.step,
        rows,
    })
}

/// Returns the steps of the first and the last row of the time series in the range.
fn steps(run: &Run, wanted: Wanted) -> Result<Window, Failure> {
    let (series, [from, to]) = (run.series(), wanted.strain);
    let strain = series.column("strain");
    let within = |row: &usize| strain[*row] >= from && strain[*row] <= to;
    let mut rows = (0..series.rows()).filter(within);
    let bad = |what: String| Failure::input(format!("{}: {what}", run.path().display()));
    let (Some(first), Some(last)) = (rows.next(), rows.next_back()) else {
        let ends = [strain.first(), strain.last()].map(|end| end.copied().unwrap_or(f64::NAN));
        return Err(bad(format!(
            "has fewer than two rows of the time series between the strains {from} and {to}; it goes from {} to {}",
            ends[0], ends[1]
        )));
    };
    let every = wanted
        .every
        .unwrap_or_else(|| series.step[first + 1] - series.step[first]);
    Ok(Window {
        first: series.step[first],
        last: series.step[last],
        every,
    })
}

/// Reads the last checkpoint of the shear before `step`, or at `step` if that is 0. Returns its path,
/// scene and state.
fn before(run: &Run, step: u64) -> Result<(PathBuf, String, Snapshot), Failure> {
    let folder = run.folder();
    let mut candidates = checkpoint::kept(folder);
    for name in [checkpoint::PREVIOUS, checkpoint::NAME] {
        let path = folder.join(name);
        if !path.is_file() {
            continue;
        }
        let header = Header::read(&checkpoint::read(&Solo, &path)?.1)?;
        if let Stage::Shear { .. } = header.stage {
            candidates.push((header.step, path));
        }
    }
    // The forces of a frame are computed in its step, so the checkpoint must be before it.
    let fits = |(at, _): &&(u64, PathBuf)| *at < step || *at == 0;
    let best = candidates.iter().filter(fits).max_by_key(|(at, _)| *at);
    let Some((_, path)) = best else {
        return Err(Failure::input(format!(
            "{}: there is no checkpoint before step {step}; a run with output.keep_checkpoints = true keeps them",
            folder.display()
        )));
    };
    let (toml, snapshot) = checkpoint::read(&Solo, path)?;
    Ok((path.clone(), toml, snapshot))
}

/// Returns the number of rows that both runs have. Fails if there are none or any differs.
fn compare(run: &Run, again: &Run) -> Result<usize, Failure> {
    let (one, other) = (run.series(), again.series());
    let (mut rows, mut different, mut first) = (0, 0, None);
    for (k, step) in other.step.iter().enumerate() {
        let Ok(row) = one.step.binary_search(step) else {
            continue;
        };
        rows += 1;
        let differs = |c: &usize| one.columns[*c][row].to_bits() != other.columns[*c][k].to_bits();
        if let Some(c) = (0..SERIES_COLUMNS.len()).find(differs) {
            different += 1;
            first.get_or_insert((
                *step,
                SERIES_COLUMNS[c],
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
