//! The folder of a run: which run it holds, whether this run may write into it, and its lock.

use std::cell::Cell;
use std::fs;
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::fs::Access;

use gshear_dem::columns::Column;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::SeriesRow;
use gshear_mpi_exchange::Parallel;
use gshear_scene::identity::changes;
use gshear_scene::schedule::Schedule;
use gshear_scene::{Boundary, Change, Scene};
use gshear_store::box_columns::{AqsRow, NewtonianRow};
use gshear_store::collective::{agree, on_root};
use gshear_store::csv_table::rows_up_to;
use gshear_store::file_names::{
    LOG_FILE, LOG_METADATA_FILE, NEWTONIAN_PART, RUN_FILE, SCENE_FILE, SPECTRA_FILE, STATUS_FILE,
    is_reduced,
};
use gshear_store::log::Log;
use gshear_store::run_reader::{self, RunFile, RunStage};
use gshear_store::status::{RunCondition, RunState, Status};
use gshear_store::{checkpoint, disk, existing, part, probe, text_writer};

use crate::header::{Header, UpToCheckpoint, Written};
use crate::lock::{Lock, is_left, unwritable};
use crate::options::Options;
use crate::run_record::{RunRecord, id_in_scene};
use crate::say::say_error;
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

/// What has become of the run of a file. A status of another run in its folder does not count.
pub fn condition(run: &RunFile) -> RunCondition {
    let status = Status::read(run.folder());
    let is_of_run = |of: &Status| run.text("run_id").is_none_or(|id| id == of.run_id);
    let status = status.filter(is_of_run);
    RunCondition::of(
        run.digest().is_some(),
        status.as_ref(),
        is_left(run.folder()),
    )
}

/// What has become of the run of a folder, as its status has it; `None` without one.
pub fn condition_by_status(folder: &Path) -> Option<RunCondition> {
    let status = Status::read(folder)?;
    // After the status: a run that ends writes it before it gives up its lock.
    let is_left = is_left(folder);
    let is_done = status.state == RunState::Done;
    Some(RunCondition::of(is_done, Some(&status), is_left))
}

/// What the files of a folder say about their run.
#[derive(Debug, Default)]
pub struct Contents {
    /// The files of a run, by name.
    names: Vec<String>,
    /// Those that say which run they are of.
    owners: Vec<FileOwner>,
    /// Stage and step of the newest readable checkpoint.
    stopped: Option<(&'static str, u64)>,
    /// The scenes of finished files, and of their parts, by name.
    finished: Vec<(&'static str, String)>,
}

/// The run that a file is of.
#[derive(Debug)]
struct FileOwner {
    name: &'static str,
    /// `None` in files of versions without it.
    id: Option<String>,
    /// Empty if the file has none.
    scene: String,
    /// Hash of the packing, if the file knows one.
    packing: Option<String>,
    /// Whether the run began from a checkpoint of another one.
    branch: bool,
}

impl Contents {
    /// Looks into a folder, which need not exist. Skips damaged files. Not collective.
    ///
    /// # Errors
    /// [`Failure::Other`] if the system does not let the folder or a file be read.
    pub fn of(folder: &Path) -> Result<Self> {
        let mut found = Self::default();
        let unread = |e| disk::unread(format!("{}: cannot be read: {e}", folder.display()));
        let scene = text_writer::read(&folder.join(SCENE_FILE)).map_err(unread);
        let scene = readable(scene)?.unwrap_or_default();
        let entries = readable(fs::read_dir(folder).map_err(unread))?;
        for entry in entries.into_iter().flatten() {
            let name = entry.map_err(unread)?.file_name();
            let name = name.to_string_lossy().into_owned();
            if is_of_a_run(&name, &scene) {
                found.names.push(name);
            }
        }
        found.names.sort();
        for name in [RUN_FILE, NEWTONIAN_PART] {
            if let Some(owner) = readable(run_reader::owner(&folder.join(name)))? {
                if owner.finished {
                    found.finished.push((name, owner.scene.clone()));
                }
                found.owners.push(FileOwner {
                    name,
                    id: owner.run_id,
                    scene: owner.scene,
                    packing: None,
                    branch: owner.branch,
                });
            }
        }
        for name in [checkpoint::NAME, checkpoint::PREVIOUS] {
            let path = folder.join(name);
            let texts = checkpoint::read_texts(&path);
            let read =
                texts.and_then(|[header, scene]| Ok((Header::parse(&path, &header)?, scene)));
            if let Some(((header, record, packing), scene)) = readable(read)? {
                found.stopped.get_or_insert((header.stage(), header.step()));
                found.owners.push(FileOwner {
                    name,
                    branch: record.parent.is_some(),
                    id: Some(record.id),
                    scene,
                    packing: packing.map(|file| file.content),
                });
            }
        }
        if let Some(id) = id_in_scene(&scene) {
            found.owners.push(FileOwner {
                name: SCENE_FILE,
                id: Some(id.into()),
                packing: None,
                branch: scene.lines().any(|line| line.starts_with("# branch of")),
                scene,
            });
        }
        Ok(found)
    }

    /// Whether there is no file of a run.
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// The first file of another run than this one. `ends`: a run whose stages end elsewhere is
    /// the same, because a resume may move the ends.
    fn foreign(&self, task: &Task, ends: bool) -> Option<&FileOwner> {
        self.owners.iter().find(|owner| match &owner.id {
            Some(id) => *id != task.record.id && !(ends && owner.is_continued_by(&task.scene)),
            None => owner.differs(&task.scene),
        })
    }

    /// Whether this run has come to the end that the task asks for.
    pub fn is_finished(&self, task: &Task) -> bool {
        let ends = |toml: &str| {
            let changes = changes(toml, &task.scene.toml);
            changes.iter().any(|change| change.change == Change::End)
        };
        let last_file = task.last_file();
        let last = self.finished.iter().find(|(name, _)| *name == last_file);
        last.is_some_and(|(_, toml)| !ends(toml))
    }

    /// Refuses a folder that holds another run. `ends`: a run whose stages end elsewhere is the
    /// same.
    ///
    /// # Errors
    /// [`Failure::Input`] that names the file and both identities.
    pub fn is_of(&self, folder: &Path, task: &Task, ends: bool) -> Result<()> {
        let Some(other) = self.foreign(task, ends) else {
            return Ok(());
        };
        let changes = changes(&other.scene, &task.scene.toml);
        let differs = match changes.iter().find(|change| change.change.is_physics()) {
            Some(change) if !other.scene.is_empty() => format!("; {change}"),
            _ => String::new(),
        };
        let id = other.id.as_deref().unwrap_or("unknown");
        Err(Failure::input(format!(
            "{}: is of another run (run_id {id}, this one is {}{differs}); give another folder with --out, or remove that run with --overwrite",
            folder.join(other.name).display(),
            task.record.id,
        )))
    }

    /// Whether a killed program left only the beginning of this branch, to which no checkpoint
    /// leads.
    fn is_begun_branch(&self, record: &RunRecord) -> bool {
        let checkpoints = [checkpoint::NAME, checkpoint::PREVIOUS];
        let own = |owner: &FileOwner| owner.id.as_ref() == Some(&record.id);
        record.parent.is_some()
            && self.finished.is_empty()
            && !self.names.iter().any(|name| checkpoints.contains(&&**name))
            && self.owners.iter().all(own)
            && !self.owners.is_empty()
    }

    /// The message that refuses a new run.
    fn refuse_new(&self, folder: &Path, task: &Task) -> Failure {
        let place = folder.display();
        let away = "give another folder with --out, or remove that run with --overwrite";
        let same = !self.owners.is_empty() && self.foreign(task, true).is_none();
        Failure::input(if self.is_finished(task) && same {
            format!("{place}: holds this run, which is finished; {away}")
        } else if same {
            let at = match self.stopped {
                Some((stage, step)) => format!("up to {stage} step {step}"),
                None => "without a checkpoint".into(),
            };
            let with = match task.record.parent {
                Some(_) => format!("--resume {place}"),
                None => "--resume auto".into(),
            };
            format!("{place}: holds this run {at}; continue it with {with}, {away}")
        } else {
            format!(
                "{place}: holds another run ({}); {away}",
                self.names.join(", ")
            )
        })
    }
}

impl FileOwner {
    /// Whether any key that decides the trajectory differs.
    fn differs(&self, scene: &Scene) -> bool {
        let changes = changes(&self.scene, &scene.toml);
        changes.iter().any(|change| change.change.is_physics())
    }

    /// Whether a run from the first grain of this scene is the one of the file, but for where its
    /// stages end.
    fn is_continued_by(&self, scene: &Scene) -> bool {
        let packing = scene.packing().map(|file| &file.content);
        // Only checkpoints know the bytes of the packing.
        let same_grains = packing.is_none() || self.packing.as_ref() == packing;
        !self.branch && !self.scene.is_empty() && same_grains && !self.differs(scene)
    }
}

/// What was read; `None` of a file that is missing or damaged.
fn readable<T>(read: Result<T>) -> Result<Option<T>> {
    match read {
        Ok(read) => Ok(Some(read)),
        Err(failure @ Failure::Other(_)) => Err(failure),
        Err(_) => Ok(None),
    }
}

/// Whether it is a file that only a run writes. `status.json` does not count: a folder that holds
/// it alone is that of a run that was packed, of which nothing is left. `scene`: `scene.toml`.
fn is_of_a_run(name: &str, scene: &str) -> bool {
    let is_part = Path::new(name).extension().is_some_and(|of| of == "part");
    let checkpoint = name.starts_with("checkpoint") && name.contains(".h5") && !is_part;
    name.trim_end_matches(".journal") == RUN_FILE
        || [LOG_FILE, SPECTRA_FILE].contains(&name.trim_end_matches("-metadata.json"))
        || checkpoint
        || (name == SCENE_FILE && id_in_scene(scene).is_some())
}

/// The folder of a run that may write into it. Only rank 0 holds the lock.
pub struct RunFolder {
    path: PathBuf,
    lock: Option<Lock>,
    /// Whether the files of an earlier run are still to be removed.
    clear: Cell<bool>,
    /// The checkpoint that the run resumes from, if the folder's newest one is another.
    cut_back_to: Cell<Option<PathBuf>>,
    /// Folders that were made for this run, the innermost first.
    made: Vec<PathBuf>,
}

/// Refuses a folder that holds another run, or one that a new run would replace.
fn may_enter(task: &Task, folder: &Path, found: &Contents) -> Result<()> {
    match task.entry {
        Entry::New if !found.is_empty() => Err(found.refuse_new(folder, task)),
        Entry::Resume => found.is_of(folder, task, false),
        _ => Ok(()),
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
        self.made = missing
            .filter(|folder| !folder.as_os_str().is_empty())
            .map(Path::to_path_buf)
            .collect();
        fs::create_dir_all(&self.path).map_err(|e| unwritable(&self.path, &e))?;
        self.lock = Some(Lock::take(&self.path, options.break_lock, notes)?);
        text_writer::remove_remnants(&self.path, &WRITTEN_BESIDE, Duration::ZERO);
        let saved = task.saved().filter(|_| task.entry == Entry::Resume);
        if saved.is_some_and(|saved| saved.header.run_stage().is_some()) {
            existing::recover(&self.path.join(RUN_FILE), notes)?;
        }
        // Another job may have written between the first look and the lock.
        self.check(task, options, Some(notes))?;
        if let (Some(saved), false) = (saved, options.overwrite) {
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
        let found = Contents::of(&self.path)?;
        if options.overwrite {
            self.clear.set(!found.is_empty());
            return Ok(());
        }
        if task.entry == Entry::New && found.is_begun_branch(&task.record) {
            self.clear.set(true);
            return Ok(());
        }
        may_enter(task, &self.path, &found)?;
        match (task.entry, task.saved(), notes) {
            (Entry::Resume, Some(saved), Some(notes)) => {
                let folder = saved.path.parent();
                let beside = folder.is_some_and(|folder| same_folder(folder, &self.path));
                self.check_files(&saved.header, &task.scene, &found, beside, notes)
            }
            _ => Ok(()),
        }
    }

    /// Checks that the files fit the checkpoint, so that a resume that fails writes nothing.
    fn check_files(
        &self,
        header: &Header,
        scene: &Scene,
        found: &Contents,
        beside: bool,
        notes: &mut Vec<String>,
    ) -> Result<()> {
        let Some((name, mut columns, written)) = files_of(header) else {
            return Ok(());
        };
        if let (Header::Shear(shear), Boundary::Walls(walls)) = (header, &scene.boundary) {
            columns = Schedule::new(scene, walls, shear.height).columns;
        }
        let (path, log) = (self.path.join(name), self.path.join(LOG_FILE));
        let counted @ [frames, rows, _] = [written.frames, written.rows, written.scalars];
        let step = header.step();
        let there = part::exists(&path);
        let mut kept = 0;
        if there {
            // The checkpoint's numbers are those of the file beside it, unless that was lost since.
            let begun_at = run_reader::owner(&path)?.begun_at;
            let is_counted = beside && begun_at < step;
            if is_counted {
                existing::inspect(&path, columns, frames, rows)?;
            }
            let found = existing::up_to(&path, columns, step)?;
            // A damaged step would cut off more than it must, and leave a gap.
            if is_counted && found != counted {
                return Err(Failure::input(format!(
                    "{}: is damaged: up to step {step} it has {found:?} frames, rows and scalars, the checkpoint counts {counted:?}",
                    path.display(),
                )));
            }
            kept = found[1];
        } else if !found.is_empty() {
            notes.push(format!(
                "{}: is missing, with {frames} frames and {rows} rows up to the checkpoint; the file begins anew at {} step {}",
                path.display(),
                header.stage(),
                header.step()
            ));
        }
        match header {
            Header::Shear(_) if there || log.exists() => {
                Log::check(&log, columns, step, kept)?;
                // A killed program may have left anything after the checkpoint, which a reader
                // refuses.
                let file = there.then(|| RunFile::open(&path).ok()).flatten();
                file.map_or(Ok(()), |file| Log::compare(&log, step, file.series()))
            }
            Header::Newtonian { lines, origin, .. } if there && *lines > 0 => {
                let wanted = match &scene.boundary {
                    Boundary::Periodic(of) => of.newtonian.is_some_and(|of| of.spectra > 0),
                    Boundary::Walls(_) => false,
                };
                let spectra = self.path.join(SPECTRA_FILE);
                let time = origin.time(step, scene.time_step.step);
                let found = if wanted && beside {
                    readable(rows_up_to(&spectra, time))?.flatten().unwrap_or(0)
                } else {
                    *lines
                };
                if found < *lines {
                    Err(Failure::input(format!(
                        "{}: is missing or has {found} lines up to the checkpoint, which counts {lines}; put it back, or leave the spectra out with --set newtonian.spectra=0",
                        spectra.display()
                    )))
                } else {
                    Ok(())
                }
            }
            _ => Ok(()),
        }
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
        let cut_back = self.cut_back_to.take();
        let go_back = |path: PathBuf| {
            self.remove_later(&path)?;
            checkpoint::make_newest(&path, &self.path)
        };
        agree(exchange, removed.and(cut_back.map_or(Ok(()), go_back)))
    }

    /// Removes the kept checkpoints after this one: the run may go on in another way, and makes
    /// them again if it does not.
    fn remove_later(&self, path: &Path) -> Result<()> {
        let [header, _] = checkpoint::read_texts(path)?;
        let (header, ..) = Header::parse(path, &header)?;
        let (stage, step) = (header.stage(), header.step());
        let mut later = checkpoint::kept(&self.path, stage);
        later.retain(|(kept, _)| *kept > step);
        if stage == RunStage::Strain.name() {
            later.extend(checkpoint::kept(&self.path, RunStage::Newtonian.name()));
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
pub fn preview(folder: &Path, task: &Task) -> Result<String> {
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
    let found = Contents::of(place)?;
    may_enter(task, place, &found)?;
    let which = if found.is_empty() { "no" } else { "this" };
    let name = place.display();
    Ok(format!("{name}: can be written, holds {which} run"))
}

/// Bytes that are free where the folder is or would be, if the system tells.
pub fn free(folder: &Path) -> Option<f64> {
    let existing = folder.ancestors().find(|path| path.is_dir());
    let existing = existing.unwrap_or(Path::new("."));
    let disk = rustix::fs::statvfs(existing).ok()?;
    Some(disk.f_bavail as f64 * disk.f_frsize as f64)
}

/// The file of frames, or its part, that a checkpoint continues, its columns, and what it holds;
/// `None` before there is one, and of a checkpoint with which a stage begins, which makes its files
/// anew.
fn files_of(header: &Header) -> Option<(&'static str, &'static [Column], &Written)> {
    UpToCheckpoint::new(header.step()).last?;
    match header {
        Header::Pack(_) | Header::Prepare { .. } => None,
        Header::Shear(shear) => Some((RUN_FILE, &SeriesRow::COLUMNS[..], &shear.written)),
        Header::Aqs { written, .. } => Some((RUN_FILE, &AqsRow::COLUMNS[..], written)),
        Header::Newtonian { written, .. } => {
            Some((NEWTONIAN_PART, &NewtonianRow::COLUMNS[..], written))
        }
    }
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
    let is_old = |name: &str| is_of_a_run(name, &scene) || is_reduced(name) || name == STATUS_FILE;
    let unread = |e| Failure::other(format!("{}: cannot be read: {e}", folder.display()));
    for entry in fs::read_dir(folder).map_err(unread)? {
        let entry = entry.map_err(unread)?;
        if !entry.file_name().to_str().is_some_and(is_old) {
            continue;
        }
        let path = entry.path();
        let done = match entry.file_type() {
            Ok(of) if of.is_dir() => fs::remove_dir_all(&path),
            _ => fs::remove_file(&path),
        };
        removed(&path, done)?;
    }
    Ok(())
}

/// The failure of what could not be removed.
fn removed(path: &Path, done: std::io::Result<()>) -> Result<()> {
    done.map_err(|e| Failure::other(format!("{}: cannot be removed: {e}", path.display())))
}

/// A file that is open for writing, and must stay where it is.
pub struct Watched {
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
        match Self::id(&self.path) {
            // It may have been removed before it was looked at first.
            found if found.is_some() && found == self.id => Ok(()),
            found => Err(Failure::other(format!(
                "{}: was {} during the run, so what the run wrote into it is gone; resume from the last checkpoint, or start again",
                self.path.display(),
                match found {
                    Some(_) => "replaced",
                    None => "removed",
                },
            ))),
        }
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
