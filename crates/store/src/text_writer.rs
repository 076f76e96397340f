//! Writes small text files, first as `.part`, so that a file with the final name is always
//! complete.
//!
//! `NamedTempFile::persist` of tempfile would be no shorter, and a killed program would leave files
//! with random names.

use std::path::Path;

use gshear_dem::failure::Failure;

/// Writes a text file; creates its folder if missing.
///
/// # Errors
/// [`Failure::Other`] if the folder or the file cannot be written.
pub fn write(path: &Path, text: &str) -> Result<(), Failure> {
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    let folder = path.parent().unwrap_or(Path::new(""));
    std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(&part, text))
        .and_then(|()| std::fs::rename(&part, path))
        .map_err(|e| Failure::other(format!("{}: cannot be written: {e}", path.display())))
}
