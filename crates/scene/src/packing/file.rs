//! The file of a packing: its name, its bytes, and what they say.

use std::fmt::Display;
use std::io::Read;
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;
use gshear_dem::failure::{Failure, Result};

use crate::lammps_data::{self, DataFile};
use crate::lammps_dump;

/// The formats, for messages.
pub(super) const FORMAT: &str = "a LAMMPS data file or dump, a list x y z r, or a run";

/// Bytes of a packed file over its own: a file may not fill the memory with zeros.
const MOST_UNPACKED: u64 = 100;

/// Refuses a file that messages call `name`, with the line if that is not 0: a state has none.
pub(super) fn wrong(name: &str, line: usize, what: impl Display) -> Failure {
    Failure::input(match line {
        0 => format!("{name}: {what}"),
        line => format!("{name}:{line}: {what}"),
    })
}

/// The line of another atom, for messages; nothing of a state that is no text.
pub(super) fn in_line(line: usize) -> String {
    match line {
        0 => String::new(),
        line => format!(" (line {line})"),
    }
}

/// A path that ends in `@` and a number, if no file has this name: the file and the frame.
pub fn split_frame(path: &Path) -> (PathBuf, Option<usize>) {
    match split_name(path) {
        Some((file, frame)) if !path.exists() => (file, Some(frame)),
        _ => (path.into(), None),
    }
}

/// What is before and after the last `@`, if that is a number.
fn split_name(path: &Path) -> Option<(PathBuf, usize)> {
    let (file, frame) = path.to_str()?.rsplit_once('@')?;
    Some((file.into(), frame.parse().ok()?))
}

/// The path of a packing.
pub(super) struct PackingPath {
    /// What messages call the file.
    pub(super) name: String,
    pub(super) absolute: PathBuf,
}

impl PackingPath {
    pub(super) fn new(path: &Path) -> Result<Self> {
        let name = path.display().to_string();
        let absolute = std::path::absolute(path)
            .map_err(|e| wrong(&name, 0, format!("cannot be read: {e}")))?;
        // The scene and the checkpoints hold the path as text.
        if absolute.to_str().is_none() {
            let what = format!("the path {} is not UTF-8; rename it", absolute.display());
            return Err(wrong(&name, 0, what));
        }
        Ok(Self { name, absolute })
    }
}

/// What the bytes of a file say, in any of the formats.
pub(super) fn parsed(name: &str, bytes: &[u8], frame: Option<usize>) -> Result<DataFile> {
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err(wrong(name, 0, "is text in UTF-16; save it as UTF-8"));
    }
    // Comments may be in any other encoding.
    let text = String::from_utf8_lossy(bytes);
    // A byte order mark says nothing in UTF-8.
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    if lammps_dump::is_dump(text) {
        return lammps_dump::parse(name, text, frame);
    }
    if let Some(frame) = frame {
        let what = format!("holds one state; leave out @{frame}");
        return Err(wrong(name, 0, what));
    }
    if lammps_dump::is_list(text) {
        return lammps_dump::parse_list(name, text);
    }
    lammps_data::parse(name, text)
}

/// The bytes of a file, unpacked if gzip has packed them.
pub(super) fn unpacked(name: &str, bytes: Vec<u8>) -> Result<Vec<u8>> {
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return Ok(bytes);
    }
    let most = MOST_UNPACKED * bytes.len() as u64;
    let mut text = Vec::new();
    let read = MultiGzDecoder::new(&bytes[..])
        .take(most + 1)
        .read_to_end(&mut text);
    let what = match read {
        Err(e) => format!("cannot be unpacked: {e}; pack it again with gzip"),
        Ok(_) if text.len() as u64 > most => format!(
            "has more than {MOST_UNPACKED} times its bytes when unpacked; unpack it with gunzip"
        ),
        Ok(_) => return Ok(text),
    };
    Err(wrong(name, 0, what))
}
