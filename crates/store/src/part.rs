//! The parts of a `run.h5`: the root of the file holds the first stage of the run, a group of its
//! name each later one: `aqs`, `newtonian` or `shear`.

use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use gshear_scene::RunStage;
use hdf5::Group;

use crate::sound::{self, ReadFile};

/// The groups of later stages, which have their names.
pub(crate) fn groups() -> impl Iterator<Item = &'static str> {
    RunStage::ALL.into_iter().map(RunStage::name)
}

/// The groups of the stages that may come after that of a group: any after the root, which is "",
/// and any but itself after strain steps. Nothing follows the others where they are not first.
pub(crate) fn groups_after(group: &str) -> Vec<&'static str> {
    if group.is_empty() || group == RunStage::Strain.name() {
        groups().filter(|later| *later != group).collect()
    } else {
        Vec::new()
    }
}

/// A file and the group in it that holds a stage.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Part {
    pub file: PathBuf,
    /// Empty: the root.
    pub group: &'static str,
}

/// A part of a file that is open for reading.
pub(crate) struct OpenPart {
    // Dropped before the file.
    group: Group,
    file: Arc<ReadFile>,
}

impl OpenPart {
    /// The file, for what keeps objects of the part: it must be dropped after them.
    pub fn file(&self) -> Arc<ReadFile> {
        self.file.clone()
    }

    /// Closes the file, whose objects must have been dropped.
    ///
    /// # Errors
    /// If the system fails to.
    pub fn close(self) -> hdf5::Result<()> {
        drop(self.group);
        Arc::into_inner(self.file).map_or(Ok(()), ReadFile::close)
    }
}

impl Deref for OpenPart {
    type Target = Group;

    fn deref(&self) -> &Group {
        &self.group
    }
}

impl Part {
    /// That of a path: `run.h5`, or `run.h5/newtonian`.
    pub fn of(path: &Path) -> Self {
        let group = groups().find(|group| path.ends_with(group));
        match (path.parent(), group) {
            (Some(file), Some(group)) if !path.exists() && !file.is_dir() => Self {
                file: file.into(),
                group,
            },
            _ => Self {
                file: path.into(),
                group: "",
            },
        }
    }

    /// Opens the group for reading. Of a file that holds only another part, as a replay's, that.
    pub fn open(&self) -> hdf5::Result<OpenPart> {
        let file = sound::open(&self.file)?;
        let mut group = self.group;
        if group.is_empty() && !file.link_exists("particles") {
            let only = groups().find(|group| file.link_exists(group));
            group = only.unwrap_or_default();
        }
        let group = match group {
            "" => file.as_group(),
            group if file.link_exists(group) => file.group(group),
            group => Err(format!(
                "the file has no group {group}: its scene has no [{group}], or the run has not come to it"
            )
            .into()),
        }?;
        Ok(OpenPart {
            group,
            file: Arc::new(file),
        })
    }

    /// Whether the part is there. A file that cannot be opened is in the way of its root, too.
    pub fn exists(&self) -> bool {
        if !self.file.exists() {
            return false;
        }
        match self.open() {
            Ok(part) => part.name() == format!("/{}", self.group),
            Err(_) => self.group.is_empty(),
        }
    }
}

/// The file at `path`, or of that part: `run.h5/newtonian`.
pub fn file_of(path: &Path) -> PathBuf {
    Part::of(path).file
}

/// Whether there is a file at `path`, or that part of one: `run.h5/newtonian`.
pub fn exists(path: &Path) -> bool {
    Part::of(path).exists()
}
