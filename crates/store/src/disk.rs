//! What the system does with files: bringing them and their names to disk, and what it says when
//! that fails.

use std::fs::{File, Permissions};
use std::io::{self, ErrorKind};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use gshear_dem::failure::Failure;
use rustix::io::Errno;
use tempfile::{Builder, NamedTempFile};

/// Between the name of a file and the end of its temporary name.
pub(crate) const RANDOM: usize = 6;
pub(crate) const ENDING: &str = ".part";

pub(crate) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Brings the names of a folder to disk.
///
/// # Errors
/// A folder that cannot be synchronised, unless the file system or the permissions of the folder
/// do not allow it at all.
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    match File::open(folder).and_then(|folder| folder.sync_all()) {
        Err(e) if e.kind() == ErrorKind::PermissionDenied => Ok(()),
        Err(e) if e.raw_os_error() == Some(Errno::INVAL.raw_os_error()) => Ok(()),
        other => other,
    }
}

/// Brings a file that was written by its name to disk, and its name.
///
/// # Errors
/// A file that cannot be written.
pub(crate) fn sync(path: &Path) -> io::Result<()> {
    File::open(path)?.sync_all()?;
    sync_folder(folder_of(path))
}

/// What an error says, on one line: of a call of the system that failed in HDF5 what the system
/// says of it, as "No space left on device (os error 28)".
pub fn reason(error: &dyn std::fmt::Display) -> String {
    let text = error.to_string();
    said_by_system(&text).unwrap_or_else(|| text.replace('\n', " "))
}

/// What the system says in a message of HDF5, if it says something.
fn said_by_system(text: &str) -> Option<String> {
    let number = text.split_once("errno = ")?.1.split_once(',')?.0;
    let message = text.split_once("error message = '")?.1.split_once('\'')?.0;
    Some(format!("{message} (os error {number})"))
}

/// Whether a message tells that the system refused a call, as where the file is locked, too many
/// files are open or a device fails. The file may be sound.
pub fn is_refused(message: &str) -> bool {
    let number = ["errno = ", "(os error "].into_iter().find_map(|before| {
        let (_, after) = message.split_once(before)?;
        let digits = after.split(|c: char| !c.is_ascii_digit()).next();
        digits?.parse().ok()
    });
    let no_file = [
        Errno::NOENT,
        Errno::NOTDIR,
        Errno::ISDIR,
        Errno::LOOP,
        Errno::NAMETOOLONG,
    ];
    number.is_some_and(|number| !no_file.map(Errno::raw_os_error).contains(&number))
}

/// The failure of a file that cannot be read: [`Failure::Other`] if that may pass.
pub fn unread(message: String) -> Failure {
    if is_refused(&message) {
        Failure::other(message)
    } else {
        Failure::input(message)
    }
}

/// The failure of a file that cannot be written.
pub fn unwritten(path: &Path, why: &dyn std::fmt::Display) -> Failure {
    let why = reason(why);
    Failure::other(format!("{}: cannot be written: {why}", path.display()))
}

/// Creates a file beside `path`. It is removed when it is dropped; `persist` gives it its name.
///
/// # Errors
/// A folder in which no file can be made.
pub(crate) fn beside(path: &Path) -> io::Result<NamedTempFile> {
    let mut prefix = path.file_name().unwrap_or_default().to_owned();
    prefix.push(".");
    Builder::new()
        .prefix(&prefix)
        .rand_bytes(RANDOM)
        .suffix(ENDING)
        // As of every new file; the system takes away what the user does not want.
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(folder_of(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_call_says_what_the_system_says() {
        let of_hdf5 = "H5Fflush(): unable to flush: file write failed: time = Sat Nov 28 2026\n\
             , filename = 'a.h5', file descriptor = 9, errno = 28, error message = 'No space left on \
             device', buf = 0x1, total write size = 8";
        let expected = "No space left on device (os error 28)";
        assert_eq!(reason(&of_hdf5), expected);
        assert_eq!(reason(&io::Error::from(Errno::NOSPC)), expected);
        assert_eq!(reason(&"a\nb"), "a b");
        assert!(is_refused(of_hdf5) && is_refused(expected) && !is_refused("damaged"));
    }
}
