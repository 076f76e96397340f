//! Writes text files, first as `.part`, so that a file with the final name is always complete.
//!
//! `NamedTempFile::persist` of tempfile would be no shorter, and a killed program would leave files
//! with random names.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use gshear_dem::failure::Failure;

/// Writes a file; creates its folder if missing.
///
/// # Errors
/// [`Failure::Other`] if the folder or the file cannot be written.
pub fn write(path: &Path, content: impl AsRef<[u8]>) -> Result<(), Failure> {
    let mut file = PartFile::create(path)?;
    let written = file.write_all(content.as_ref());
    file.checked(written)?;
    file.finish().map(drop)
}

/// The path under which a file is written until it is complete: `NAME.part`.
pub fn part_of(path: &Path) -> PathBuf {
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    part.into()
}

/// A file under its temporary name.
pub struct PartFile {
    path: PathBuf,
    writer: BufWriter<File>,
}

impl PartFile {
    /// Creates the file and, if missing, its folder.
    ///
    /// # Errors
    /// [`Failure::Other`] if the folder or the file cannot be written.
    pub fn create(path: &Path) -> Result<Self, Failure> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let file = std::fs::create_dir_all(folder).and_then(|()| File::create(part_of(path)));
        let file = file.map_err(|e| unwritten(path, &e))?;
        Ok(Self {
            path: path.to_path_buf(),
            writer: BufWriter::new(file),
        })
    }

    /// The outcome of writing into the file, with its name in the message.
    ///
    /// # Errors
    /// [`Failure::Other`] if `written` is an error.
    pub fn checked(&self, written: std::io::Result<()>) -> Result<(), Failure> {
        written.map_err(|e| unwritten(&self.path, &e))
    }

    /// Gives the file its name, and returns it.
    ///
    /// # Errors
    /// [`Failure::Other`] if the file cannot be written.
    pub fn finish(mut self) -> Result<PathBuf, Failure> {
        let written = self
            .writer
            .flush()
            .and_then(|()| std::fs::rename(part_of(&self.path), &self.path));
        self.checked(written)?;
        Ok(self.path)
    }
}

impl Write for PartFile {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.writer.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.writer.flush()
    }
}

fn unwritten(path: &Path, error: &std::io::Error) -> Failure {
    Failure::other(format!("{}: cannot be written: {error}", path.display()))
}
