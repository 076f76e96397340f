//! Room on the file system for what is about to be written.
//!
//! MPI-IO may lose the error of a full disk on one rank, and the others then wait for ever. So one
//! rank reserves the room beforehand, with a plain system call whose error is reliable.

use std::fs::File;
use std::io::{self, ErrorKind};
use std::path::Path;

use gshear_dem::failure::{Failure, Result};
use rustix::fs::{FallocateFlags, fallocate, fstatvfs};
use rustix::io::Errno;

/// Reserves the bytes from `start` to `end` of a file that exists, without changing its length. To
/// be called on one rank.
///
/// File systems that cannot reserve must have as much free space.
///
/// # Errors
/// [`Failure::Other`] if there is no room, or the file cannot be opened.
pub(crate) fn reserve(path: &Path, start: u64, end: u64) -> Result<()> {
    allocate(path, start, end).map_err(|e| {
        let (name, needed) = (path.display(), end - start);
        Failure::other(match e.kind() {
            ErrorKind::NotFound => format!(
                "{name}: was removed during the run; resume from the last checkpoint, or start again"
            ),
            _ => format!(
                "{name}: cannot reserve {:.1} MB for what is to be written next ({e}); free space, then resume from the last checkpoint",
                needed as f64 / 1e6
            ),
        })
    })
}

/// [`reserve`], with the error of the system.
///
/// # Errors
/// No room, or a file that cannot be opened.
pub(crate) fn allocate(path: &Path, start: u64, end: u64) -> io::Result<()> {
    if end <= start {
        return Ok(());
    }
    let needed = end - start;
    let file = File::options().write(true).open(path)?;
    match fallocate(&file, FallocateFlags::KEEP_SIZE, start, needed) {
        Err(Errno::OPNOTSUPP | Errno::NOSYS) => {
            let system = fstatvfs(&file)?;
            if system.f_bavail.saturating_mul(system.f_frsize) >= needed {
                Ok(())
            } else {
                Err(Errno::NOSPC.into())
            }
        }
        other => Ok(other?),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn room_is_reserved_beyond_the_end_if_there_is_any() {
        use std::os::unix::fs::MetadataExt;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.h5");
        std::fs::write(&path, b"ten bytes.").unwrap();
        reserve(&path, 0, 1 << 20).unwrap();
        let file = std::fs::metadata(&path).unwrap();
        assert_eq!(file.len(), 10);
        assert!(file.blocks() * 512 >= 1 << 20);
        let message = reserve(&path, 0, 1 << 50).unwrap_err().to_string();
        assert!(message.contains("run.h5: cannot reserve"), "{message}");
    }
}
