//! The run that a folder holds: which one it is, and how far it has come.

use std::fs;
use std::path::{Path, PathBuf};

use gshear_dem::failure::{Failure, Result};
use gshear_scene::identity::changes;
use gshear_scene::{Change, PackingFile, Scene};
use gshear_store::file_names::{ALL_PARTS, LOG_FILE, RUN_FILE, SCENE_FILE, SPECTRA_FILE};
use gshear_store::run_reader::{self, RunFile};
use gshear_store::status::{RunCondition, RunState, Status};
use gshear_store::{checkpoint, disk, text_writer};

use crate::header::{Header, Position};
use crate::lock::is_left;
use crate::run_record::{RunRecord, id_in_scene, is_branch_in_scene};
use crate::task::Task;

/// What has become of the run of a file.
pub fn condition(run: &RunFile) -> RunCondition {
    let status = status_of(run);
    let is_left = is_left(run.folder());
    RunCondition::of(run.digest().is_some(), status.as_ref(), is_left)
}

/// The stage of the run beyond a file that has come to its end, and what has become of it; `None`
/// if the whole run has come to its end or its status does not say.
pub fn stage_beyond(run: &RunFile) -> Option<(String, RunCondition)> {
    run.digest()?;
    let status = status_of(run)?;
    if status.state == RunState::Done {
        return None;
    }
    let condition = RunCondition::of(false, Some(&status), is_left(run.folder()));
    Some((status.progress.stage.into_owned(), condition))
}

/// The status in the folder of a file, unless it is that of another run.
fn status_of(run: &RunFile) -> Option<Status> {
    let status = Status::read(run.folder())?;
    match run.text("run_id") {
        Some(id) if id != status.run_id => None,
        _ => Some(status),
    }
}

/// What has become of the run of a folder, as its status has it; `None` without one.
pub fn condition_by_status(folder: &Path) -> Option<RunCondition> {
    let status = Status::read(folder)?;
    // After the status: a run that ends writes it before it gives up its lock.
    let is_left = is_left(folder);
    let is_done = status.state == RunState::Done;
    Some(RunCondition::of(is_done, Some(&status), is_left))
}

/// The run of a folder, as its files say: `run.h5` and its parts, two checkpoints and `scene.toml`
/// each say which run they are of.
#[derive(Debug, Default)]
pub(crate) struct StoredRun {
    folder: PathBuf,
    /// The names of the files of a run, in order.
    files: Vec<String>,
    /// The run of each file that says it.
    identities: Vec<FileIdentity>,
    /// The newest readable checkpoint.
    position: Option<Position>,
    /// The finished files, and their parts.
    finished: Vec<FinishedFile>,
}

/// Which run a file is of.
#[derive(Debug)]
struct FileIdentity {
    /// The name of the file.
    file: &'static str,
    /// `None` in files of versions without it.
    id: Option<String>,
    /// The scene as TOML; empty if the file has none.
    scene: String,
    /// Hash of the packing, if the file knows one.
    packing: Option<String>,
    /// Whether the run began from a checkpoint of another one.
    is_branch: bool,
}

/// A file of a stage that has come to its end.
#[derive(Debug)]
struct FinishedFile {
    name: &'static str,
    /// The scene as TOML.
    scene: String,
}

/// Whether a run whose stages end elsewhere is the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ends {
    /// It is another run.
    Fixed,
    /// It is the same: a resume may move the ends.
    Movable,
}

/// The run of a folder, as a task sees it.
enum Relation<'a> {
    /// The folder holds no run.
    Empty,
    /// No file says which run it is of.
    Unknown,
    /// The run of the task, before the end that the task asks for.
    Begun,
    /// The run of the task, at that end.
    Finished,
    /// Another run, as this file says.
    Other(&'a FileIdentity),
}

impl StoredRun {
    /// Reads what the files of a folder, which need not exist, say of their run. Skips damaged
    /// files. Not collective.
    ///
    /// # Errors
    /// [`Failure::Other`] if the system does not let the folder or a file be read.
    pub(crate) fn read(folder: &Path) -> Result<Self> {
        let mut stored = Self {
            folder: folder.into(),
            ..Self::default()
        };
        let scene = text_writer::read(&folder.join(SCENE_FILE));
        let scene = readable(scene.map_err(|e| unread(folder, &e)))?.unwrap_or_default();
        stored.list_files(&scene)?;
        for name in ALL_PARTS {
            stored.read_run_file(name)?;
        }
        for name in [checkpoint::NAME, checkpoint::PREVIOUS] {
            stored.read_checkpoint(name)?;
        }
        if let Some(id) = id_in_scene(&scene) {
            stored.identities.push(FileIdentity {
                file: SCENE_FILE,
                id: Some(id.into()),
                packing: None,
                is_branch: is_branch_in_scene(&scene),
                scene,
            });
        }
        Ok(stored)
    }

    fn list_files(&mut self, scene: &str) -> Result<()> {
        let entries = fs::read_dir(&self.folder).map_err(|e| unread(&self.folder, &e));
        for entry in readable(entries)?.into_iter().flatten() {
            let name = entry.map_err(|e| unread(&self.folder, &e))?.file_name();
            let name = name.to_string_lossy().into_owned();
            if is_of_a_run(&name, scene) {
                self.files.push(name);
            }
        }
        self.files.sort();
        Ok(())
    }

    fn read_run_file(&mut self, name: &'static str) -> Result<()> {
        let Some(owner) = readable(run_reader::owner(&self.folder.join(name)))? else {
            return Ok(());
        };
        if owner.finished {
            self.finished.push(FinishedFile {
                name,
                scene: owner.scene.clone(),
            });
        }
        self.identities.push(FileIdentity {
            file: name,
            id: owner.run_id,
            scene: owner.scene,
            packing: None,
            is_branch: owner.branch,
        });
        Ok(())
    }

    fn read_checkpoint(&mut self, name: &'static str) -> Result<()> {
        let path = self.folder.join(name);
        let Some([header, scene]) = readable(checkpoint::read_texts(&path))? else {
            return Ok(());
        };
        let Some((header, record, packing)) = readable(Header::parse(&path, &header))? else {
            return Ok(());
        };
        self.position.get_or_insert(header.position());
        self.identities.push(FileIdentity {
            file: name,
            is_branch: record.parent.is_some(),
            id: Some(record.id),
            scene,
            packing: packing.map(|file| file.content),
        });
        Ok(())
    }

    /// Whether there is no file of a run.
    pub(crate) fn is_empty(&self) -> bool {
        self.files.is_empty()
    }

    fn relation(&self, task: &Task, ends: Ends) -> Relation<'_> {
        if self.is_empty() {
            return Relation::Empty;
        }
        if self.identities.is_empty() {
            return Relation::Unknown;
        }
        let mut identities = self.identities.iter();
        if let Some(other) = identities.find(|identity| !identity.is_of(task, ends)) {
            return Relation::Other(other);
        }
        if self.is_finished(task) {
            Relation::Finished
        } else {
            Relation::Begun
        }
    }

    /// Whether this run has come to the end that the task asks for.
    pub(crate) fn is_finished(&self, task: &Task) -> bool {
        let last_file = task.last_file();
        let Some(last) = self.finished.iter().find(|file| file.name == last_file) else {
            return false;
        };
        let changes = changes(&last.scene, &task.scene.toml);
        !changes.iter().any(|change| change.change == Change::End)
    }

    /// Refuses a folder that holds another run.
    ///
    /// # Errors
    /// [`Failure::Input`] that names the file and both identities.
    pub(crate) fn require(&self, task: &Task, ends: Ends) -> Result<()> {
        let Relation::Other(other) = self.relation(task, ends) else {
            return Ok(());
        };
        let changes = changes(&other.scene, &task.scene.toml);
        let difference = match changes.iter().find(|change| change.change.is_physics()) {
            Some(change) if !other.scene.is_empty() => format!("; {change}"),
            _ => String::new(),
        };
        let id = other.id.as_deref().unwrap_or("unknown");
        Err(Failure::input(format!(
            "{}: is of another run (run_id {id}, this one is {}{difference}); give another folder with --out, or remove that run with --overwrite",
            self.folder.join(other.file).display(),
            task.record.id,
        )))
    }

    /// Refuses a folder that a new run would replace.
    ///
    /// # Errors
    /// [`Failure::Input`] that says what the folder holds.
    pub(crate) fn require_none(&self, task: &Task) -> Result<()> {
        let folder = self.folder.display();
        let remedy = "give another folder with --out, or remove that run with --overwrite";
        Err(Failure::input(match self.relation(task, Ends::Movable) {
            Relation::Empty => return Ok(()),
            Relation::Finished => {
                format!("{folder}: holds this run, which is finished; {remedy}")
            }
            Relation::Begun => {
                let at = match self.position {
                    Some(position) => format!("up to {position}"),
                    None => "without a checkpoint".into(),
                };
                let with = match task.record.parent {
                    Some(_) => format!("--resume {folder}"),
                    None => "--resume auto".into(),
                };
                format!("{folder}: holds this run {at}; continue it with {with}, {remedy}")
            }
            Relation::Unknown | Relation::Other(_) => format!(
                "{folder}: holds another run ({}); {remedy}",
                self.files.join(", ")
            ),
        }))
    }

    /// Whether a killed program left only the beginning of this branch, to which no checkpoint
    /// leads.
    pub(crate) fn is_begun_branch(&self, record: &RunRecord) -> bool {
        let checkpoints = [checkpoint::NAME, checkpoint::PREVIOUS];
        let has_checkpoint = self.files.iter().any(|name| checkpoints.contains(&&**name));
        let mut ids = self.identities.iter().map(|identity| &identity.id);
        record.parent.is_some()
            && self.finished.is_empty()
            && !has_checkpoint
            && !self.identities.is_empty()
            && ids.all(|id| id.as_ref() == Some(&record.id))
    }
}

impl FileIdentity {
    /// Whether the file is of the run of a task.
    fn is_of(&self, task: &Task, ends: Ends) -> bool {
        match &self.id {
            Some(id) if *id == task.record.id => true,
            Some(_) => ends == Ends::Movable && self.is_continued_by(&task.scene),
            None => !self.differs(&task.scene),
        }
    }

    /// Whether any key that decides the trajectory differs.
    fn differs(&self, scene: &Scene) -> bool {
        let changes = changes(&self.scene, &scene.toml);
        changes.iter().any(|change| change.change.is_physics())
    }

    /// Whether a run from the first grain of this scene is the one of the file, but for where its
    /// stages end.
    fn is_continued_by(&self, scene: &Scene) -> bool {
        let packing = scene.packing().map(|file: &PackingFile| &file.content);
        // Only checkpoints know the bytes of the packing.
        let same_grains = packing.is_none() || self.packing.as_ref() == packing;
        !self.is_branch && !self.scene.is_empty() && same_grains && !self.differs(scene)
    }
}

/// What was read; `None` of a file that is missing or damaged.
pub(crate) fn readable<T>(read: Result<T>) -> Result<Option<T>> {
    match read {
        Ok(read) => Ok(Some(read)),
        Err(failure @ Failure::Other(_)) => Err(failure),
        Err(_) => Ok(None),
    }
}

fn unread(folder: &Path, why: &std::io::Error) -> Failure {
    disk::unread(format!("{}: cannot be read: {why}", folder.display()))
}

/// Whether it is a file that only a run writes. `status.json` does not count: a folder that holds
/// it alone is that of a run that was packed, of which nothing is left. `scene`: `scene.toml`.
pub(crate) fn is_of_a_run(name: &str, scene: &str) -> bool {
    let extension = Path::new(name).extension();
    let is_part = extension.is_some_and(|extension| extension == "part");
    let is_checkpoint = name.starts_with("checkpoint") && name.contains(".h5") && !is_part;
    name.trim_end_matches(".journal") == RUN_FILE
        || [LOG_FILE, SPECTRA_FILE].contains(&name.trim_end_matches("-metadata.json"))
        || is_checkpoint
        || (name == SCENE_FILE && id_in_scene(scene).is_some())
}
