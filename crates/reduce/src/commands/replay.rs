//! `replay`: computes a part of a run again, with frames, from the checkpoint before it.

use std::io;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::compare::{self, Location};
use crate::printer::Printer;
use gshear_dem::domain::Solo;
use gshear_dem::failure::{Failure, Result};
use gshear_driver::folder::same_folder;
use gshear_driver::header::{Header, Saved};
use gshear_driver::launch::Task;
use gshear_driver::options::{Options, Outcome};
use gshear_driver::say::say_error;
use gshear_scene::schedule::ReplayWindow;
use gshear_store::checkpoint;
use gshear_store::disk::{sync_folder, unwritten};
use gshear_store::file_names::{NEWTONIAN_PART, RUN_FILE, folder_of};
use gshear_store::run_reader::{self, RunFile, RunStage};
use gshear_store::text_writer::refuse_linked_folder;

/// Compute a part of a run again, with frames, from the checkpoint before it
///
/// Writes a run.h5 into a folder of its own. The run must have kept its checkpoints
/// (output.keep_checkpoints); otherwise only its end, from the last two checkpoints on, can be
/// replayed. The time series is compared with the stored one, to the last bit: exit code 3 if
/// it differs.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, or the folder that holds one
    pub run: PathBuf,
    /// Range of shear strain, as 0.1005..0.1006: from the first to the last row of the time
    /// series in it
    #[arg(long, value_name = "A..B", value_parser = range, required_unless_present = "time")]
    strain: Option<Ends>,
    /// Range of time in s, as 0.1..0.2: as --strain, for a strain that returns. Of a run that does
    /// not shear at a rate that of Newton's equations
    #[arg(long, value_name = "A..B", value_parser = range, conflicts_with = "strain")]
    time: Option<Ends>,
    /// Steps between frames, from the first row on [default: one frame per row]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    every: Option<u64>,
    /// Folder to write into [default: the run's folder + /replay-A-B]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Both ends of a range.
type Ends = [f64; 2];

/// Parses `A..B`, a strain or a time at both ends.
fn range(text: &str) -> Result<Ends, String> {
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

impl Arguments {
    /// `threads`: of the replay, whose results do not depend on them.
    ///
    /// # Errors
    /// As [`window`].
    pub fn run(&self, threads: usize, printer: &mut Printer) -> Result<()> {
        let (rows, [from, to], kind, run) = match (self.strain, self.time) {
            (Some(ends), _) => (Rows::Strain(ends), ends, "", RunFile::open(&self.run)?),
            (None, Some(ends)) => {
                let run = moving(&self.run)?;
                let kind = match run.stage() {
                    RunStage::Shear => "time-",
                    _ => "newtonian-",
                };
                (Rows::Time(ends), ends, kind, run)
            }
            (None, None) => {
                return Err(Failure::input("replay: give --strain A..B or --time A..B"));
            }
        };
        let out = if let Some(out) = &self.out {
            out.clone()
        } else {
            let out = run.folder().join(format!("replay-{kind}{from}-{to}"));
            refuse_linked_folder(&out)?;
            out
        };
        let replayed = window(&run, rows, self.every, threads, &out)?;
        let steps = replayed.run.frame_steps();
        writeln!(
            printer,
            "wrote {}: {} frames, steps {} to {}, from the checkpoint of step {}; {} rows of the time series equal those of {} to the last bit",
            replayed.run.path().display(),
            steps.len(),
            steps.first().copied().unwrap_or_default(),
            steps.last().copied().unwrap_or_default(),
            replayed.from,
            replayed.rows,
            run.path().display()
        )
    }
}

/// The first stage of a run, from the one at this path on, that moves by the equations of motion.
fn moving(run: &Path) -> Result<RunFile> {
    let file = RunFile::open_any(run)?;
    if file.stage() == RunStage::Shear {
        return Ok(file);
    }
    if let Some(shear) = file.part(RunStage::Shear)? {
        return Ok(shear);
    }
    RunFile::open_any(&folder_of(run).join(NEWTONIAN_PART))
}

/// The rows of the time series that are replayed: from the first to the last in a range.
#[derive(Debug, Clone, Copy)]
pub enum Rows {
    /// γ at both ends.
    Strain(Ends),
    /// Time at both ends (s): for a strain that returns.
    Time(Ends),
    /// Steps of the first and the last row.
    Steps([u64; 2]),
}

/// Result of a replay.
pub(crate) struct Replayed {
    /// The replayed part.
    pub run: RunFile,
    /// Step of the checkpoint that the replay started from.
    pub from: u64,
    /// Number of rows of the time series compared, all equal to the last bit.
    rows: usize,
}

/// Returns whether the run kept checkpoints.
pub fn can(run: &RunFile) -> bool {
    !checkpoint::kept(run.folder(), "shear").is_empty()
}

/// Returns the step of the checkpoint from which a replay of the shear begins whose first row is
/// that of `step`; `None` if there is none.
pub fn start(run: &RunFile, step: u64) -> Option<u64> {
    Candidates::of(run.folder(), "shear")
        .before(step)
        .next()
        .map(|(at, _)| *at)
}

/// Replays the run from the first to the last row of the time series in the range, into the folder
/// `out`: the shear, or Newton's equations in a box. `every`: steps between frames, `None` for one
/// frame per row; the results do not depend on the number of `threads`.
///
/// # Errors
/// [`Failure::Input`] if the range has fewer than two rows or no checkpoint before it;
/// [`Failure::Numbers`] if the time series differs from the stored one.
pub fn window(
    run: &RunFile,
    rows: Rows,
    every: Option<u64>,
    threads: usize,
    out: &Path,
) -> Result<Replayed> {
    let window = steps(run, rows, every)?;
    if same_folder(out, run.folder()) {
        return Err(Failure::input(format!(
            "{}: holds the run itself; give another folder with --out",
            out.display()
        )));
    }
    let stage = run.stage();
    let set = match stage {
        RunStage::Newtonian => &["newtonian.spectra=0"][..],
        _ => &["analysis.scalars=false", "output.progress_lines=0"],
    };
    let options = Options {
        out: out.to_path_buf(),
        threads,
        replay: Some(window),
        ..Options::default()
    };
    let from = again(run.folder(), stage.name(), window.first, set, options)?;
    // Of a file that holds one part only, that is opened.
    let again = RunFile::open_any(&out.join(RUN_FILE))?;
    let rows = equal_rows(run, &again)?;
    Ok(Replayed {
        run: again,
        from,
        rows,
    })
}

/// Returns the steps of the first and the last row of the time series in the range.
fn steps(run: &RunFile, rows: Rows, every: Option<u64>) -> Result<ReplayWindow> {
    let series = run.series();
    let [first, last] = match rows {
        Rows::Strain(ends) => rows_within(run, "strains", series.column("strain"), ends)?,
        Rows::Time(ends) => rows_within(run, "times", &series.time, ends)?,
        Rows::Steps(ends) => {
            let steps: Vec<f64> = series.step.iter().map(|step| *step as f64).collect();
            rows_within(run, "steps", &steps, ends.map(|step| step as f64))?
        }
    };
    Ok(ReplayWindow {
        first: series.step[first],
        last: series.step[last],
        every,
    })
}

/// Returns the first and the last row whose values, `[L]`, are within a range. `what`: name of the
/// values.
fn rows_within(run: &RunFile, what: &str, values: &[f64], ends: Ends) -> Result<[usize; 2]> {
    let [from, to] = ends;
    let mut rows =
        (0..run.series().rows()).filter(|row| values[*row] >= from && values[*row] <= to);
    if let (Some(first), Some(last)) = (rows.next(), rows.next_back()) {
        return Ok([first, last]);
    }
    let extent = match (values.first(), values.last()) {
        (Some(first), Some(last)) => format!("it goes from {first} to {last}"),
        _ => "it has none".into(),
    };
    Err(run.wrong(format!(
        "has fewer than two rows of the time series between the {what} {from} and {to}; {extent}"
    )))
}

/// Replays the window of `options`, whose first step is `first`, of a stage of the run in `folder`
/// into the folder of `options`. `set`: keys of the scene. Returns the step of the checkpoint that
/// the replay started from.
fn again(folder: &Path, stage: &str, first: u64, set: &[&str], options: Options) -> Result<u64> {
    let out = options.out.clone();
    let file = out.join(RUN_FILE);
    if run_reader::owner(&file).is_ok_and(|owner| !owner.replay) {
        return Err(Failure::input(format!(
            "{}: is of a run, which a replay would replace; give another folder with --out",
            file.display()
        )));
    }
    let saved = before(folder, stage, first)?;
    let from = saved.header.step();
    let set = [&["output.keep_checkpoints=false"], set].concat();
    let task = Task::replay(saved, &set.into_iter().map(Into::into).collect::<Vec<_>>())?;
    // The files get their place when they are whole.
    let part = part_folder(&out).map_err(|e| unwritten(&out, &e))?;
    let options = Options {
        out: part.path().to_path_buf(),
        ..options
    };
    if task.run(&Solo, &options)? == Outcome::Stopped {
        return Err(Failure::other("replay: stopped by a signal"));
    }
    move_files(part.path(), &out).map_err(|e| unwritten(&out, &e))?;
    Ok(from)
}

/// Makes a folder in a folder, which is created if missing, for files that are not whole.
fn part_folder(folder: &Path) -> io::Result<TempDir> {
    std::fs::create_dir_all(folder)?;
    tempfile::Builder::new()
        .prefix("replay.")
        .tempdir_in(folder)
}

/// Moves all files from one folder to another.
fn move_files(from: &Path, to: &Path) -> io::Result<()> {
    for entry in std::fs::read_dir(from)? {
        let entry = entry?;
        std::fs::rename(entry.path(), to.join(entry.file_name()))?;
    }
    sync_folder(to)
}

/// The checkpoints of a stage in a folder.
struct Candidates {
    /// Step and path, by step.
    found: Vec<(u64, PathBuf)>,
    /// A damaged one; it may not be needed.
    damaged: Option<Failure>,
}

impl Candidates {
    fn of(folder: &Path, stage: &str) -> Self {
        let mut damaged = None;
        let mut found = checkpoint::kept(folder, stage);
        for name in [checkpoint::PREVIOUS, checkpoint::NAME] {
            let path = folder.join(name);
            if !path.is_file() {
                continue;
            }
            let texts = checkpoint::read_texts(&path);
            let header = texts.and_then(|[header, _]| Header::parse(&path, &header));
            match header {
                Ok((header, ..)) if header.stage() == stage => found.push((header.step(), path)),
                Ok(_) => {}
                Err(failure) => damaged = damaged.or(Some(failure)),
            }
        }
        found.sort();
        Self { found, damaged }
    }

    /// Those that a replay of `step` can start from, the last first. The forces of a frame are
    /// computed in its step, so the checkpoint must be before it, or at step 0.
    fn before(&self, step: u64) -> impl Iterator<Item = &(u64, PathBuf)> {
        let candidates = self.found.iter();
        candidates
            .filter(move |(at, _)| *at < step || *at == 0)
            .rev()
    }
}

/// Reads the last checkpoint of a stage before `step`, or at `step` if that is 0.
fn before(folder: &Path, stage: &str, step: u64) -> Result<Saved> {
    let mut candidates = Candidates::of(folder, stage);
    let mut damaged = candidates.damaged.take();
    for (_, path) in candidates.before(step) {
        match Saved::read(&Solo, path) {
            Ok(saved) => {
                if let Some(failure) = damaged {
                    let path = path.display();
                    say_error(&format!("note: {failure}; replaying from {path}"));
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

/// Returns the number of rows that both runs have. Fails if there are none or any differs.
fn equal_rows(run: &RunFile, again: &RunFile) -> Result<usize> {
    let (stored, computed) = (run.series(), again.series());
    let steps = computed.step.iter().enumerate();
    let rows: Vec<[usize; 2]> = steps
        .filter_map(|(k, step)| Some([stored.step.binary_search(step).ok()?, k]))
        .collect();
    if rows.is_empty() {
        return Err(run.wrong("no row of the time series to compare the replay with"));
    }
    let fields = compare::series(run, again, &rows);
    let first = fields.iter().filter_map(|field| match field.first {
        Location::Row(row) => Some((row, field)),
        _ => None,
    });
    let Some((row, field)) = first.min_by_key(|(row, _)| *row) else {
        return Ok(rows.len());
    };
    let at = rows.partition_point(|pair| pair[0] < row);
    let [is, was] =
        [(computed, rows[at][1]), (stored, row)].map(|(series, row)| match &*field.name {
            "series time" => series.time[row],
            column => series.column(column)[row],
        });
    Err(Failure::numbers(format!(
        "replay: {} of {} rows of the time series differ from {}: first at step {}, {} is {is:?} and was {was:?}; \
         the run was made by another version or with other values ({} is kept)",
        field.differing,
        rows.len(),
        run.path().display(),
        stored.step[row],
        field.name,
        again.path().display()
    )))
}
