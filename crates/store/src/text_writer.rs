//! Small text files: written beside, then renamed, so that a file of the name is always whole.
//!
//! Own code because `NamedTempFile::persist` of tempfile is no shorter, and a killed program would leave files of random names.

use std::path::Path;

use gshear_dem::failure::Failure;

/// Writes a file and, where missing, its folder.
///
/// Errors: `Failure::Other` that names what cannot be written.
pub fn write(path: &Path, text: &str) -> Result<(), Failure> {
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    let folder = path.parent().unwrap_or(Path::new(""));
    std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(&part, text))
        .and_then(|()| std::fs::rename(&part, path))
        .map_err(|e| Failure::other(format!("{}: cannot be written: {e}", path.display())))
}
