//! The folder of a run: whether this run may write into it, and its lock.

use std::cell::Cell;
use std::fs;
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::fs::Access;

use gshear_dem::failure::{Failure, Result};
use gshear_mpi_exchange::Parallel;
use gshear_scene::schedule::Schedule;
use gshear_scene::{RunStage, Scene};
use gshear_store::collective::{agree, on_root};
use gshear_store::csv_table::rows_up_to;
use gshear_store::file_names::{
    LOG_FILE, LOG_METADATA_FILE, RUN_FILE, SCENE_FILE, SPECTRA_FILE, STATUS_FILE, is_reduced,
};
use gshear_store::log::{Log, LogColumns};
use gshear_store::run_reader::{self, RunFile};
use gshear_store::{checkpoint, existing, part, probe, text_writer};

use crate::header::{ContinuedFile, Header, NewtonianHeader, Position, Saved, Written};
use crate::lock::{Lock, unwritable};
use crate::options::Options;
use crate::say::say_error;
use crate::stored_run::{Ends, StoredRun, is_of_a_run, readable};
use crate::task::{Entry, Task};

/// What a run writes beside its name and renames.
const WRITTEN_BESIDE: [&str; 8] = [
    checkpoint::NAME,
    SCENE_FILE,
    STATUS_FILE,
    LOG_FILE,
    LOG_METADATA_FILE,
    SPECTRA_FILE,
    "spectra.csv-metadata.json",
    "run.h5.journal",
];

/// The folder of a run that may write into it. Only rank 0 holds the lock.
pub(crate) struct RunFolder {
    path: PathBuf,
    lock: Option<Lock>,
    /// Whether the files of an earlier run are still to be removed.
    clear: Cell<bool>,
    /// The checkpoint that the run resumes from, if the folder's newest one is another.
    cut_back_to: Cell<Option<PathBuf>>,
    /// Folders that were made for this run, the innermost first.
    made: Vec<PathBuf>,
    /// The stages of the run, in order.
    order: Vec<RunStage>,
}

/// Refuses a folder that holds another run, or one that a new run would replace.
fn may_enter(task: &Task, stored: &StoredRun) -> Result<()> {
    match task.entry {
        Entry::New => stored.require_none(task),
        Entry::Resume => stored.require(task, Ends::Fixed),
        Entry::Again => Ok(()),
    }
}

impl RunFolder {
    /// Checks that the run may write into its folder, makes the folder and takes its lock.
    /// Collective.
    ///
    /// # Errors
    /// [`Failure::Input`] if the folder holds another run, files that do not fit the checkpoint, or
    /// the lock of another process; or if it cannot be written. Nothing is written then.
    pub fn take(exchange: &dyn Parallel, task: &Task, options: &Options) -> Result<Self> {
        let mut folder = Self {
            path: options.out.clone(),
            lock: None,
            clear: Cell::new(false),
            cut_back_to: Cell::default(),
            made: Vec::new(),
            order: task.scene.stages.order.clone(),
        };
        let mut notes = Vec::new();
        on_root(exchange, || folder.take_on_root(task, options, &mut notes))?;
        probe::probe(&folder.path, exchange)?;
        for note in notes {
            say_error(&format!("note: {note}"));
        }
        Ok(folder)
    }

    fn take_on_root(
        &mut self,
        task: &Task,
        options: &Options,
        notes: &mut Vec<String>,
    ) -> Result<()> {
        check_name(&self.path)?;
        self.check(task, options, None)?;
        let missing = self.path.ancestors().take_while(|folder| !folder.exists());
        let named = missing.filter(|folder| !folder.as_os_str().is_empty());
        self.made = named.map(Path::to_path_buf).collect();
        fs::create_dir_all(&self.path).map_err(|e| unwritable(&self.path, &e))?;
        self.lock = Some(Lock::take(&self.path, options.break_lock, notes)?);
        text_writer::remove_remnants(&self.path, &WRITTEN_BESIDE, Duration::ZERO);
        let saved = if task.entry == Entry::Resume {
            task.saved()
        } else {
            None
        };
        if saved.is_some_and(|saved| saved.header.run_stage().is_some()) {
            existing::recover(&self.path.join(RUN_FILE), notes)?;
        }
        // Another job may have written between the first look and the lock.
        self.check(task, options, Some(notes))?;
        if let Some(saved) = saved
            && !options.overwrite
        {
            let newest = Watched::id(&self.path.join(checkpoint::NAME));
            if newest.is_some() && newest != Watched::id(&saved.path) {
                self.cut_back_to.set(Some(saved.path.clone()));
            }
        }
        Ok(())
    }

    /// With `notes`, also the files that a resume continues, which only the holder of the lock can
    /// repair.
    fn check(&self, task: &Task, options: &Options, notes: Option<&mut Vec<String>>) -> Result<()> {
        let stored = StoredRun::read(&self.path)?;
        if options.overwrite {
            self.clear.set(!stored.is_empty());
            return Ok(());
        }
        if task.entry == Entry::New && stored.is_begun_branch(&task.record) {
            self.clear.set(true);
            return Ok(());
        }
        may_enter(task, &stored)?;
        let (Entry::Resume, Some(saved), Some(notes)) = (task.entry, task.saved(), notes) else {
            return Ok(());
        };
        let Some(file) = saved.header.continued_file(&task.scene.stages) else {
            return Ok(());
        };
        let path = self.path.join(file.name);
        if !part::exists(&path) && !stored.is_empty() {
            let Written { frames, rows, .. } = file.written;
            notes.push(format!(
                "{}: is missing, with {frames} frames and {rows} rows up to the checkpoint; the file begins anew at {}",
                path.display(),
                saved.header.position(),
            ));
        }
        self.check_files(saved, &file, &task.scene)
    }

    /// Checks that the files fit the checkpoint, so that a resume that fails writes nothing.
    fn check_files(&self, saved: &Saved, file: &ContinuedFile<'_>, scene: &Scene) -> Result<()> {
        let header = &saved.header;
        let (mut columns, mut log_columns) = (file.columns, Vec::new());
        if let (Header::Shear(shear), Some(walls)) = (header, scene.shear()) {
            let schedule = Schedule::new(scene, walls, shear.height);
            (columns, log_columns) = (schedule.columns, schedule.log_columns);
        }
        let (path, step) = (self.path.join(file.name), header.step());
        let is_there = part::exists(&path);
        // The checkpoint's numbers are those of the file beside it, unless that was lost since.
        let is_beside = saved
            .path
            .parent()
            .is_some_and(|folder| same_folder(folder, &self.path));
        let mut rows = 0;
        if is_there {
            let is_counted = is_beside && run_reader::owner(&path)?.begun_at < step;
            if is_counted {
                existing::inspect(&path, columns, file.written.frames, file.written.rows)?;
            }
            let contents = existing::up_to(&path, columns, step)?;
            let counted = file.written.counts();
            // A damaged step would cut off more than it must, and leave a gap.
            if is_counted && contents != counted {
                return Err(Failure::input(format!(
                    "{}: is damaged: up to step {step} it has {contents:?} frames, rows and scalars, the checkpoint counts {counted:?}",
                    path.display(),
                )));
            }
            rows = contents[1];
        }
        let log = self.path.join(LOG_FILE);
        match header {
            Header::Shear(_) if is_there || log.exists() => {
                let of_log = LogColumns {
                    series: columns,
                    places: &log_columns,
                };
                Log::check(&log, of_log, step, rows)?;
                // A killed program may have left anything after the checkpoint, which a reader
                // refuses.
                if is_there && let Ok(file) = RunFile::open(&path) {
                    Log::compare(&log, step, file.series(), &log_columns)?;
                }
                Ok(())
            }
            Header::Newtonian(newtonian) if is_there && is_beside && newtonian.lines > 0 => {
                self.check_spectra(newtonian, scene)
            }
            _ => Ok(()),
        }
    }

    /// Checks that the file of eigenvalues, if it is still written, has the lines that the
    /// checkpoint counts.
    fn check_spectra(&self, header: &NewtonianHeader, scene: &Scene) -> Result<()> {
        let newtonian = scene.stages.newtonian;
        if newtonian.is_none_or(|newtonian| newtonian.spectra == 0) {
            return Ok(());
        }
        let spectra = self.path.join(SPECTRA_FILE);
        let time = header.origin.time(header.step, scene.time_step.step);
        let lines = readable(rows_up_to(&spectra, time))?.flatten().unwrap_or(0);
        if lines >= header.lines {
            return Ok(());
        }
        Err(Failure::input(format!(
            "{}: is missing or has {lines} lines up to the checkpoint, which counts {}; put it back, or leave the spectra out with --set newtonian.spectra=0",
            spectra.display(),
            header.lines,
        )))
    }

    /// Once, before this run writes its first file: removes those of an earlier run. Where frames
    /// and rows are cut back to an older checkpoint, that one becomes the newest first, because no
    /// later one fits the files any more; kept ones after it are removed. Collective.
    ///
    /// # Errors
    /// [`Failure::Other`] if a file can be neither removed nor linked.
    pub fn clear(&self, exchange: &dyn Parallel) -> Result<()> {
        let removed = if self.clear.replace(false) {
            remove_run(&self.path)
        } else {
            Ok(())
        };
        let cut_back = match self.cut_back_to.take() {
            Some(path) if removed.is_ok() => self.cut_back(&path),
            _ => Ok(()),
        };
        agree(exchange, removed.and(cut_back))
    }

    /// Makes a checkpoint the newest one.
    fn cut_back(&self, path: &Path) -> Result<()> {
        self.remove_later(path)?;
        checkpoint::make_newest(path, &self.path)
    }

    /// The stages of the run after the one of this name; all of them after what prepares the
    /// sample.
    fn stages_after(&self, stage: &str) -> &[RunStage] {
        let at = self.order.iter().position(|known| known.name() == stage);
        &self.order[at.map_or(0, |at| at + 1)..]
    }

    /// Removes the kept checkpoints after this one: the run may go on in another way, and makes
    /// them again if it does not.
    fn remove_later(&self, path: &Path) -> Result<()> {
        let [header, _] = checkpoint::read_texts(path)?;
        let (header, ..) = Header::parse(path, &header)?;
        let Position { stage, step } = header.position();
        let mut later = checkpoint::kept(&self.path, stage);
        later.retain(|(kept, _)| *kept > step);
        for stage in self.stages_after(stage) {
            later.extend(checkpoint::kept(&self.path, stage.name()));
        }
        for (_, path) in later {
            removed(&path, fs::remove_file(&path))?;
        }
        Ok(())
    }

    /// Checks that the folder is still there and this run still holds its lock. Collective.
    ///
    /// # Errors
    /// [`Failure::Other`] if the folder or the lock is gone.
    pub fn verify(&self, exchange: &dyn Parallel) -> Result<()> {
        let held = self.lock.as_ref().map_or(Ok(()), Lock::verify);
        agree(exchange, held)
    }
}

impl Drop for RunFolder {
    fn drop(&mut self) {
        drop(self.lock.take());
        for folder in &self.made {
            // Only if it is empty: a run that was refused leaves nothing behind.
            if fs::remove_dir(folder).is_err() {
                break;
            }
        }
    }
}

/// Refuses a name that HDF5 or the file system cannot take.
fn check_name(folder: &Path) -> Result<()> {
    if let Err(why) = fs::symlink_metadata(folder)
        && why.kind() == ErrorKind::InvalidFilename
    {
        return Err(unwritable(folder, &why));
    }
    match folder.to_str() {
        Some(_) => Ok(()),
        None => Err(Failure::input(format!(
            "{}: the name of the folder of the results is not UTF-8, as HDF5 needs it; rename it or give another one with --out",
            folder.display()
        ))),
    }
}

/// The present folder, if the path is empty.
pub fn named(path: &Path) -> &Path {
    if path.as_os_str().is_empty() {
        Path::new(".")
    } else {
        path
    }
}

/// What a run finds in its folder, without writing there, as a sentence.
///
/// # Errors
/// A folder in which the run cannot begin or go on.
pub(crate) fn preview(folder: &Path, task: &Task) -> Result<String> {
    let place = named(folder);
    let existing = place.ancestors().find(|path| path.exists());
    let existing = named(existing.unwrap_or(Path::new("")));
    if !existing.is_dir() {
        let why = std::io::Error::from(ErrorKind::NotADirectory);
        return Err(unwritable(place, &why));
    }
    rustix::fs::access(existing, Access::WRITE_OK | Access::EXEC_OK)
        .map_err(|why| unwritable(place, &why.into()))?;
    check_name(place)?;
    let stored = StoredRun::read(place)?;
    may_enter(task, &stored)?;
    let which = if stored.is_empty() { "no" } else { "this" };
    let name = place.display();
    Ok(format!("{name}: can be written, holds {which} run"))
}

/// Bytes that are free where the folder is or would be, if the system tells.
pub(crate) fn free(folder: &Path) -> Option<f64> {
    let existing = folder.ancestors().find(|path| path.is_dir());
    let existing = existing.unwrap_or(Path::new("."));
    let disk = rustix::fs::statvfs(existing).ok()?;
    Some(disk.f_bavail as f64 * disk.f_frsize as f64)
}

/// Whether two paths lead to the same folder. An empty path is the present one.
pub fn same_folder(one: &Path, other: &Path) -> bool {
    match (named(one).canonicalize(), named(other).canonicalize()) {
        (Ok(one), Ok(other)) => one == other,
        _ => one == other,
    }
}

/// Removes the files of a run and what was reduced from them.
fn remove_run(folder: &Path) -> Result<()> {
    let scene = text_writer::read(&folder.join(SCENE_FILE)).unwrap_or_default();
    let entries = fs::read_dir(folder).map_err(|e| unread(folder, &e))?;
    for entry in entries {
        let entry = entry.map_err(|e| unread(folder, &e))?;
        let name = entry.file_name();
        let Some(name) = name.to_str() else { continue };
        if !(is_of_a_run(name, &scene) || is_reduced(name) || name == STATUS_FILE) {
            continue;
        }
        let path = entry.path();
        let done = match entry.file_type() {
            Ok(kind) if kind.is_dir() => fs::remove_dir_all(&path),
            _ => fs::remove_file(&path),
        };
        removed(&path, done)?;
    }
    Ok(())
}

fn unread(folder: &Path, why: &std::io::Error) -> Failure {
    Failure::other(format!("{}: cannot be read: {why}", folder.display()))
}

/// The failure of what could not be removed.
fn removed(path: &Path, done: std::io::Result<()>) -> Result<()> {
    done.map_err(|e| Failure::other(format!("{}: cannot be removed: {e}", path.display())))
}

/// A file that is open for writing, and must stay where it is.
pub(crate) struct Watched {
    path: PathBuf,
    id: Option<(u64, u64)>,
}

impl Watched {
    /// The file that is at this path now.
    pub fn new(path: PathBuf) -> Self {
        let id = Self::id(&path);
        Self { path, id }
    }

    fn id(path: &Path) -> Option<(u64, u64)> {
        let file = fs::metadata(path).ok()?;
        Some((file.dev(), file.ino()))
    }

    /// Checks that the path still leads to the file.
    ///
    /// # Errors
    /// [`Failure::Other`] if the file was removed or replaced.
    pub fn verify(&self) -> Result<()> {
        let id = Self::id(&self.path);
        // It may have been removed before it was looked at first.
        if id.is_some() && id == self.id {
            return Ok(());
        }
        let event = match id {
            Some(_) => "replaced",
            None => "removed",
        };
        Err(Failure::other(format!(
            "{}: was {event} during the run, so what the run wrote into it is gone; resume from the last checkpoint, or start again",
            self.path.display(),
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_reduced_goes_with_its_run() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        let gone = [
            "run.h5",
            "status.json",
            "stability.csv",
            "stability.csv-metadata.json",
        ];
        let stays = ["mine.csv", "mine.csv-metadata.json"];
        for name in gone.iter().chain(&stays) {
            fs::write(at(name), "").expect("written");
        }
        fs::create_dir(at("report")).expect("a folder");
        remove_run(folder.path()).expect("removed");
        let entries = fs::read_dir(folder.path()).expect("a folder").flatten();
        let mut left: Vec<_> = entries.map(|entry| entry.file_name()).collect();
        left.sort();
        assert_eq!(left, stays);
    }
}
