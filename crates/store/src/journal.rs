//! The journal of an HDF5 file that grows: a copy of its metadata at the last flush.
//!
//! HDF5 rewrites metadata in place, at any time, so a program that is killed can leave a file that
//! no longer opens. Raw data that has been written is never written again with other values.
//! Therefore all bytes outside the raw data, as they are after a flush, and the file's length
//! bring the file back to the state of that flush: [`Journal::restore`].
//!
//! Format, little endian: `GSHEARJ1`, length of the file (u64), number of pieces n (u64), n pairs
//! (offset, length) (u64), the bytes of the pieces, xxh3-64 of all that comes before (u64).

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::disk::unwritten;
use super::sound;
use super::text_writer;
use gshear_dem::failure::{Failure, Result};
use xxhash_rust::xxh3::xxh3_64;

const MAGIC: &[u8; 8] = b"GSHEARJ1";

/// The path of a file's journal: `run.h5.journal` beside `run.h5`, or beside what that links to, so
/// that a copied folder cannot make a journal overwrite other files.
pub(crate) fn path_of(file: &Path) -> PathBuf {
    let mut name = target(file).into_os_string();
    name.push(".journal");
    name.into()
}

/// Where a link leads, whether or not there is a file; other paths as they are.
pub(crate) fn target(path: &Path) -> PathBuf {
    let mut path = path.to_path_buf();
    // As many links as the system follows.
    for _ in 0..40 {
        match path.read_link() {
            Ok(to) => path = path.parent().unwrap_or(Path::new("")).join(to),
            Err(_) => break,
        }
    }
    path
}

/// Removes the journal of a file that has been closed.
///
/// # Errors
/// A file that cannot be removed.
pub(crate) fn remove(file: &Path) -> Result<()> {
    let path = path_of(file);
    match std::fs::remove_file(&path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            let path = path.display();
            Err(Failure::other(format!("{path}: cannot be removed: {e}")))
        }
        _ => Ok(()),
    }
}

/// The metadata of a file.
#[derive(Debug, PartialEq)]
pub(crate) struct Journal {
    /// Length of the file (bytes).
    length: u64,
    /// Offset and bytes, in order.
    pieces: Vec<(u64, Vec<u8>)>,
}

impl Journal {
    /// The journal of a file that is about to be created: a program that is killed before the first
    /// flush leaves nothing to continue.
    pub(crate) fn of_nothing() -> Self {
        Self {
            length: 0,
            pieces: Vec::new(),
        }
    }

    /// Whether it is [`Self::of_nothing`].
    pub(crate) fn is_of_nothing(&self) -> bool {
        self.length == 0
    }

    /// Copies what a file holds outside its raw data, which has been flushed. `raw`: byte ranges in
    /// any order; they may touch but not overlap.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn of(file: &Path, raw: Vec<Range<u64>>) -> Result<Self> {
        Self::copy(file, raw)
            .map_err(|e| Failure::other(format!("{}: cannot be read: {e}", file.display())))
    }

    fn copy(file: &Path, mut raw: Vec<Range<u64>>) -> std::io::Result<Self> {
        let mut from = File::open(file)?;
        // On disk before the checkpoint that counts on it.
        from.sync_all()?;
        let length = from.metadata()?.len();
        raw.retain(|range| !range.is_empty());
        raw.sort_unstable_by_key(|range| range.start);
        let mut pieces = Vec::new();
        let mut at = 0;
        for range in raw.into_iter().chain(std::iter::once(length..length)) {
            if at < range.start {
                let mut bytes = vec![0; (range.start.min(length) - at) as usize];
                from.seek(SeekFrom::Start(at))?;
                from.read_exact(&mut bytes)?;
                pieces.push((at, bytes));
            }
            at = at.max(range.end);
        }
        Ok(Self { length, pieces })
    }

    /// Writes the journal of `file` in place of the one before; at every moment there is a whole
    /// one.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, file: &Path) -> Result<()> {
        let path = path_of(file);
        text_writer::replace(&path, self.bytes()).map_err(|e| unwritten(&path, &e))
    }

    /// Reads the journal of `file`; `None` if there is none or it is damaged.
    pub fn read(file: &Path) -> Option<Self> {
        let mut bytes = Vec::new();
        let mut journal = sound::regular(&path_of(file)).ok()?;
        journal.read_to_end(&mut bytes).ok()?;
        Self::parse(&bytes)
    }

    /// Brings `file` back to the state of the journal.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub(crate) fn restore(&self, file: &Path) -> Result<()> {
        self.copy_back(file)
            .map_err(|e| Failure::other(format!("{}: cannot be repaired: {e}", file.display())))
    }

    fn copy_back(&self, file: &Path) -> std::io::Result<()> {
        let mut to = File::options().write(true).open(file)?;
        for (offset, bytes) in &self.pieces {
            to.seek(SeekFrom::Start(*offset))?;
            to.write_all(bytes)?;
        }
        to.set_len(self.length)?;
        to.sync_all()
    }

    fn bytes(&self) -> Vec<u8> {
        let mut numbers = vec![self.length, self.pieces.len() as u64];
        for (offset, piece) in &self.pieces {
            numbers.extend([*offset, piece.len() as u64]);
        }
        let mut bytes = MAGIC.to_vec();
        bytes.extend(numbers.into_iter().flat_map(u64::to_le_bytes));
        for (_, piece) in &self.pieces {
            bytes.extend(piece);
        }
        let sum = xxh3_64(&bytes);
        bytes.extend(sum.to_le_bytes());
        bytes
    }

    fn parse(bytes: &[u8]) -> Option<Self> {
        let (content, sum) = bytes.split_last_chunk::<8>()?;
        if xxh3_64(content) != u64::from_le_bytes(*sum) {
            return None;
        }
        let mut rest = content.strip_prefix(MAGIC)?;
        let (length, count) = (take_number(&mut rest)?, take_number(&mut rest)?);
        let mut places = Vec::new();
        for _ in 0..count {
            places.push((take_number(&mut rest)?, take_number(&mut rest)?));
        }
        let mut pieces = Vec::new();
        for (offset, size) in places {
            let (piece, after) = rest.split_at_checked(size as usize)?;
            rest = after;
            pieces.push((offset, piece.to_vec()));
        }
        Some(Self { length, pieces })
    }
}

/// Splits off the number at the beginning of some bytes.
fn take_number(bytes: &mut &[u8]) -> Option<u64> {
    let (first, after) = bytes.split_first_chunk::<8>()?;
    *bytes = after;
    Some(u64::from_le_bytes(*first))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_comes_back_but_for_its_raw_data() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.h5");
        let before: Vec<u8> = (0..200).collect();
        std::fs::write(&path, &before).unwrap();
        let journal = Journal::of(&path, vec![150..170, 20..50, 50..60]).unwrap();
        journal.write(&path).unwrap();

        let mut after = vec![255; 400];
        after[20..60].copy_from_slice(&before[20..60]);
        after[150..170].copy_from_slice(&before[150..170]);
        std::fs::write(&path, &after).unwrap();
        let read = Journal::read(&path).unwrap();
        assert_eq!(read, journal);
        let kept: usize = read.pieces.iter().map(|(_, piece)| piece.len()).sum();
        assert_eq!(kept, 200 - 40 - 20);
        read.restore(&path).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), before);
    }

    /// A link must not bring a journal to a file that is not beside it.
    #[test]
    fn the_journal_of_a_link_is_beside_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("disk")).unwrap();
        std::fs::write(at("disk/a.h5"), [7; 100]).unwrap();
        std::os::unix::fs::symlink("disk/a.h5", at("b.h5")).unwrap();
        std::os::unix::fs::symlink(at("b.h5"), at("run.h5")).unwrap();
        let journal = Journal::of(&at("disk/a.h5"), vec![10..20, 30..40]).unwrap();
        journal.write(&at("run.h5")).unwrap();
        assert!(at("disk/a.h5.journal").exists());
        std::fs::rename(at("disk/a.h5.journal"), at("run.h5.journal")).unwrap();
        assert_eq!(Journal::read(&at("run.h5")), None);
    }

    #[test]
    fn a_damaged_journal_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.h5");
        assert_eq!(Journal::read(&path), None);
        std::fs::write(&path, [7; 100]).unwrap();
        let journal = Journal::of(&path, vec![10..20, 30..40]).unwrap();
        journal.write(&path).unwrap();
        let whole = std::fs::read(path_of(&path)).unwrap();
        for n in 0..whole.len() {
            let mut flipped = whole.clone();
            flipped[n] ^= 0x10;
            std::fs::write(path_of(&path), &flipped).unwrap();
            assert_eq!(Journal::read(&path), None, "byte {n}");
            std::fs::write(path_of(&path), &whole[..n]).unwrap();
            assert_eq!(Journal::read(&path), None, "cut at {n}");
        }
    }
}
