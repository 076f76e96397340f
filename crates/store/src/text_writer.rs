//! The one way by which a file of results gets its name: it is written beside it, brought to disk
//! with every error looked at, and renamed. So a file with its final name is whole.
//!
//! Until then a file has a name of its own, `NAME.XXXXXX.part`, which did not exist before: what
//! other people put into a folder, such as symbolic links, is never written through.
//!
//! Commands write text and pictures with [`write()`] or a [`PartFile`], HDF5 files with a
//! [`CheckedFile`](crate::checked::CheckedFile), which is one. `clippy.toml` forbids the functions
//! of the standard library and of the `hdf5` crate that make files in another way.

use std::error::Error;
use std::fs::{DirEntry, File};
use std::io::{self, BufWriter, ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::disk::{ENDING, RANDOM, beside, folder_of, sync_folder, unwritten};
use crate::file_names::{LOG_FILE, SCENE_FILE, STATUS_FILE};
use crate::run_reader::is_hdf5;
use crate::sound;
use gshear_dem::failure::{Failure, Result};
use tempfile::NamedTempFile;

/// Bytes of a text.
const LONGEST: u64 = 64 << 20;
/// A program that has not written to its file for so long was killed.
const FORGOTTEN: Duration = Duration::from_hours(24);

/// Brings a complete file to disk and gives it its name. Returns the file.
///
/// A file system over a network may report only now that an earlier write has failed; after this
/// call, closing the file cannot lose anything.
///
/// # Errors
/// A file that cannot be written or renamed.
pub(crate) fn give_name(part: NamedTempFile, path: &Path) -> io::Result<File> {
    part.as_file().sync_all()?;
    let file = part.persist(path)?;
    sync_folder(folder_of(path))?;
    Ok(file)
}

/// Replaces a file, or what else has its name; its folder must exist.
///
/// # Errors
/// A file that cannot be written; what was there stays.
pub fn replace(path: &Path, content: impl AsRef<[u8]>) -> io::Result<()> {
    let mut part = beside(path)?;
    part.write_all(content.as_ref())?;
    give_name(part, path).map(drop)
}

/// [`replace`] of a file that is written anew all the time and may be lost, without waiting for the
/// disk.
///
/// # Errors
/// A file that cannot be written; what was there stays.
pub(crate) fn refresh(path: &Path, content: impl AsRef<[u8]>) -> io::Result<()> {
    let mut part = beside(path)?;
    part.write_all(content.as_ref())?;
    part.persist(path)?;
    Ok(())
}

/// Removes what killed programs have left of these files of a folder, if it is older than `age`.
pub fn remove_remnants(folder: &Path, names: &[&str], age: Duration) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let final_name = name.to_str().and_then(final_name);
        if final_name.is_some_and(|name| names.contains(&name)) && is_older(&entry, age) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// The name that a file of this temporary name was to have; `None` of other names.
fn final_name(name: &str) -> Option<&str> {
    let unnamed = name.strip_suffix(ENDING)?;
    let (name, random) = unnamed.split_at_checked(unnamed.len().checked_sub(RANDOM)?)?;
    let is_random = random.bytes().all(|byte| byte.is_ascii_alphanumeric());
    if is_random {
        name.strip_suffix('.')
    } else {
        None
    }
}

/// Whether a file was not written for so long; every file if that is no time.
fn is_older(entry: &DirEntry, age: Duration) -> bool {
    let written = entry.metadata().and_then(|file| file.modified());
    written.is_ok_and(|at| age.is_zero() || at.elapsed().is_ok_and(|since| since > age))
}

/// Reads a text of a folder.
///
/// # Errors
/// What is no [file](crate::sound::regular), or longer than any such text; a file that cannot be
/// read.
pub fn read(path: &Path) -> io::Result<String> {
    let file = sound::regular(path)?;
    if file.metadata()?.len() <= LONGEST {
        io::read_to_string(file)
    } else {
        Err(ErrorKind::InvalidData.into())
    }
}

/// Refuses a link to a folder in a folder that somebody else may have made: results would be
/// written where it leads. Links in the places of files are replaced.
///
/// # Errors
/// [`Failure::Input`] if there is such a link.
pub fn refuse_linked_folder(path: &Path) -> Result<()> {
    if path.is_symlink() && path.is_dir() {
        let name = path.display();
        return Err(Failure::input(format!(
            "{name}: is a link to a folder, where results are not written; remove it, or give the place with --out"
        )));
    }
    Ok(())
}

/// Writes a file; creates its folder if missing.
///
/// # Errors
/// [`Failure::Other`] if the folder or the file cannot be written.
pub fn write(path: &Path, content: impl AsRef<[u8]>) -> Result<()> {
    let mut file = PartFile::create(path)?;
    let written = file.write_all(content.as_ref());
    file.checked(written)?;
    file.finish().map(drop)
}

/// A file under its temporary name; dropping it removes it.
pub struct PartFile {
    path: PathBuf,
    writer: BufWriter<NamedTempFile>,
}

/// Whether a file is one of those that only `gshear-mpi` makes.
fn is_original(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str());
    let is_of_a_run = name.is_some_and(|name| {
        [LOG_FILE, SCENE_FILE, STATUS_FILE].contains(&name)
            && path.exists()
            && path.with_file_name(SCENE_FILE).exists()
    });
    hdf5::silence_errors(true);
    is_of_a_run
        || is_hdf5(path)
            && sound::read(path, |file| {
                Ok(file.group("h5md").is_ok() || file.attr("format").is_ok())
            })
            .unwrap_or(false)
}

fn wrong(path: &Path, what: &str) -> Failure {
    Failure::input(format!("{}: {what}", path.display()))
}

impl PartFile {
    /// Creates the file and, if missing, its folder.
    ///
    /// # Errors
    /// [`Failure::Input`] if the path is that of a file of a run, or of a device or a pipe, or no
    /// file can have it; [`Failure::Other`] if the folder or the file cannot be written.
    pub fn create(path: &Path) -> Result<Self> {
        let place = path.metadata();
        if place.is_ok_and(|place| !place.is_file() && !place.is_dir()) {
            return Err(wrong(path, "is a device or a pipe; give a file"));
        }
        if is_original(path) {
            let what = "is of a run, which would be lost; give another file";
            return Err(wrong(path, what));
        }
        let folder = folder_of(path);
        let file = std::fs::create_dir_all(folder).and_then(|()| beside(path));
        if let Some(name) = path.file_name().and_then(|name| name.to_str()) {
            remove_remnants(folder, &[name], FORGOTTEN);
        }
        let file = file.map_err(|e| match e.kind() {
            // The last: a file is where its folder belongs.
            ErrorKind::InvalidFilename | ErrorKind::NotADirectory | ErrorKind::AlreadyExists => {
                wrong(path, &format!("cannot be a file: {e}; give another name"))
            }
            _ => unwritten(path, &e),
        })?;
        Ok(Self {
            path: path.to_path_buf(),
            writer: BufWriter::new(file),
        })
    }

    /// Its temporary name, for what writes a file by name.
    pub fn part(&self) -> &Path {
        self.writer.get_ref().path()
    }

    /// The outcome of writing into the file, with its name in the message.
    ///
    /// # Errors
    /// [`Failure::Other`] if `written` is an error.
    pub fn checked<T>(&self, written: Result<T, impl Into<Box<dyn Error>>>) -> Result<T> {
        written.map_err(|e| unwritten(&self.path, &with_causes(&*e.into())))
    }

    /// Brings the file to disk, gives it its name, and returns that.
    ///
    /// # Errors
    /// [`Failure::Other`] if the file cannot be written.
    pub fn finish(self) -> Result<PathBuf> {
        let Self { path, writer } = self;
        let part = writer.into_inner().map_err(io::IntoInnerError::into_error);
        let named = part.and_then(|part| give_name(part, &path));
        named.map_err(|e| unwritten(&path, &e))?;
        Ok(path)
    }
}

impl Write for PartFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.writer.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }
}

impl Seek for PartFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.writer.seek(to)
    }
}

/// The message of an error, and those of its causes that it does not repeat.
fn with_causes(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let message = error.to_string();
        if !text.contains(&message) {
            text = format!("{text}: {message}");
        }
        cause = error.source();
    }
    text
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn permissions_are_those_of_every_new_file() {
        let folder = tempfile::tempdir().unwrap();
        let [written, other] = ["a.csv", "other"].map(|name| folder.path().join(name));
        std::fs::write(&other, "").unwrap();
        write(&written, "1").unwrap();
        let mode = |path| std::fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(written), mode(other));
    }

    #[test]
    fn failures_and_kills_leave_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        drop(PartFile::create(&at("a.csv")).unwrap());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        let (_, killed) = beside(&at("a.csv")).unwrap().keep().unwrap();
        let (_, other) = beside(&at("b.csv")).unwrap().keep().unwrap();
        for name in ["a.csv.part", "a.csv", "a.csv.123456.part.x"] {
            std::fs::write(at(name), "").unwrap();
        }
        remove_remnants(folder.path(), &["a.csv"], FORGOTTEN);
        assert!(killed.exists());
        remove_remnants(folder.path(), &["a.csv"], Duration::ZERO);
        assert!(!killed.exists() && other.exists());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 4);
    }
}
