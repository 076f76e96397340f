//! The texts that a configuration is read from, and how a message names a place in them.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::ops::Range;
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::fs::OFlags;
use serde::{Deserialize, Serialize};
use toml::de::DeTable;

use crate::words::EXTENDS;
use gshear_dem::failure::{Failure, Result};

/// For so long a pipe may have no writer, and the pause between two looks at it.
const WRITER_COMES: Duration = Duration::from_millis(500);
const PAUSE: Duration = Duration::from_millis(5);

/// A configuration as text, with the name that messages give it, and the files that it extends.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Source {
    /// The file itself, then the one that it extends, and so on.
    pub(super) parts: Vec<Part>,
    /// Whether its sweep is passed over, as by one of the runs that it makes.
    pub(super) member: bool,
}

/// A text of a configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Part {
    name: String,
    /// Where the paths in it begin.
    folder: PathBuf,
    /// Offset of its first byte among those of all parts.
    start: usize,
    /// What the parser reads: the text after as many spaces, so that it counts from the first part
    /// on.
    pub(super) padded: String,
}

impl Source {
    /// A text from elsewhere, such as the scene that a checkpoint holds.
    pub fn new(name: impl Into<String>, text: impl Into<String>) -> Self {
        Source {
            parts: vec![Part {
                name: name.into(),
                folder: PathBuf::new(),
                start: 0,
                padded: text.into(),
            }],
            member: false,
        }
    }

    /// The scene that runs when no file is given: `configs/plane-shear-2d.toml`.
    pub fn embedded() -> Self {
        Source::new(
            "embedded default scene",
            include_str!("../../../configs/plane-shear-2d.toml"),
        )
    }

    /// Reads a file and those that it extends, named in messages as they were given.
    ///
    /// # Errors
    /// `Failure::Input` if there is no such file, it is a directory, it cannot be read or is not
    /// UTF-8, or if a file extends itself.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let mut source = Source {
            parts: Vec::new(),
            member: false,
        };
        source.add(path, read_text(path, FORMAT, MOST_BYTES)?);
        let mut seen = vec![path.to_path_buf()];
        while let Some((at, base)) = source.base()? {
            if seen.len() == MOST_FILES {
                let what = format!(
                    "is one file too many: at most {MOST_FILES} may extend each other; put some of them together"
                );
                return Err(source.input().failure(at, EXTENDS, &what));
            }
            let file = base.canonicalize().ok();
            let is_known = seen.iter().any(|path| path.canonicalize().ok() == file);
            if is_known && base.exists() {
                seen.push(base);
                let names = seen.iter().map(|path| path.display().to_string());
                let circle = names.collect::<Vec<_>>().join(" extends ");
                let what = format!("is a circle: {circle}; leave one of them out");
                return Err(source.input().failure(at, EXTENDS, &what));
            }
            let most = MOST_BYTES.saturating_sub(source.length() as u64);
            let text = read_text(&base, "a TOML file to extend", most)
                .map_err(|failure| source.input().failure(at, EXTENDS, &failure.to_string()))?;
            source.add(&base, text);
            seen.push(base);
        }
        Ok(source)
    }

    fn add(&mut self, path: &Path, text: String) {
        let start = self.parts.last().map_or(0, |part| part.padded.len() + 1);
        self.parts.push(Part {
            name: path.display().to_string(),
            folder: path.parent().unwrap_or(Path::new("")).into(),
            start,
            padded: " ".repeat(start) + text.strip_prefix('\u{feff}').unwrap_or(&text),
        });
    }

    /// The file that the last part extends, and where it says so.
    fn base(&self) -> Result<Option<(usize, PathBuf)>> {
        let last = &self.parts[self.parts.len() - 1];
        // What is not TOML is said by whoever reads the rest of it.
        let Ok(tree) = DeTable::parse(&last.padded) else {
            return Ok(None);
        };
        let Some((key, value)) = tree.get_ref().get_key_value(EXTENDS) else {
            return Ok(None);
        };
        let at = key.span().start;
        match value.get_ref().as_str() {
            Some(path) if !path.trim().is_empty() => Ok(Some((at, last.folder.join(path)))),
            text => {
                let found = match text {
                    Some(_) => "none".into(),
                    None => format!("a value of type {}", value.get_ref().type_str()),
                };
                let what = format!(
                    "must be the path of a file in quotes, such as \"base.toml\", found {found}"
                );
                Err(self.input().failure(at, EXTENDS, &what))
            }
        }
    }

    /// The source without overrides.
    pub(super) fn input(&self) -> Input<'_> {
        Input {
            source: self,
            overrides: &[],
        }
    }

    /// The same as one of the runs of its sweep reads it: without the sweep.
    pub fn of_member(&self) -> Self {
        Source {
            member: true,
            ..self.clone()
        }
    }

    /// The name in messages.
    pub fn name(&self) -> &str {
        &self.parts[0].name
    }

    /// The part that holds an offset.
    fn part_at(&self, offset: usize) -> &Part {
        let held = self.parts.iter().rev().find(|part| part.start <= offset);
        held.unwrap_or(&self.parts[0])
    }

    /// The text of a span.
    pub(super) fn slice(&self, span: Range<usize>) -> &str {
        &self.part_at(span.start).padded[span]
    }

    /// Length of all parts.
    fn length(&self) -> usize {
        self.parts.last().map_or(0, |part| part.padded.len())
    }
}

/// The expected file, as messages about a missing or unreadable one name it.
const FORMAT: &str =
    "a TOML file, such as configs/plane-shear-2d.toml, or none for the embedded default scene";

/// Bytes of a configuration. A list of half a million radii has fewer.
const MOST_BYTES: u64 = 16 << 20;

/// Files that may extend each other in a row: each is read as long as all before it together.
const MOST_FILES: usize = 16;

/// The text of a file.
///
/// # Errors
/// Those of [`read_bytes`], and if it is not UTF-8.
fn read_text(path: &Path, format: &str, most: u64) -> Result<String> {
    String::from_utf8(read_bytes(path, format, most)?).map_err(|e| {
        let good = e.utf8_error().valid_up_to();
        let bytes = e.as_bytes();
        let line = 1 + bytes[..good].iter().filter(|&&b| b == b'\n').count();
        Failure::input(format!(
            "{}:{line}: byte 0x{:02x} is not UTF-8; give {format}",
            path.display(),
            bytes[good]
        ))
    })
}

/// The bytes of a file, which messages name as it was given; they ask for `format` instead of what
/// is no such file. `most`: bytes that it may have.
///
/// # Errors
/// `Failure::Input` if there is no such file, it is a directory or a device, it is too large, or
/// cannot be read.
pub(super) fn read_bytes(path: &Path, format: &str, most: u64) -> Result<Vec<u8>> {
    read_up_to(path, most)
        .map_err(|unread| match unread {
            Unread::Directory => format!("is a directory; give {format}"),
            Unread::Device => format!("is a device; give {format}"),
            Unread::TooLarge => format!("has more than {most} bytes; give {format}"),
            Unread::Failed(e) => match e.kind() {
                ErrorKind::NotFound => format!("no such file; give {format}"),
                ErrorKind::PermissionDenied => {
                    "cannot be read: permission denied; allow reading it".into()
                }
                _ => format!("cannot be read: {e}"),
            },
        })
        .map_err(|what| Failure::input(format!("{}: {what}", path.display())))
}

/// Why the bytes of a file were not read.
enum Unread {
    Directory,
    /// Such as /dev/zero, which has no end.
    Device,
    TooLarge,
    Failed(std::io::Error),
}

impl From<std::io::Error> for Unread {
    fn from(e: std::io::Error) -> Self {
        Unread::Failed(e)
    }
}

/// The bytes of a file that has no more of them than `most`.
fn read_up_to(path: &Path, most: u64) -> Result<Vec<u8>, Unread> {
    let kind = std::fs::metadata(path)?.file_type();
    if kind.is_dir() {
        return Err(Unread::Directory);
    }
    if kind.is_char_device() || kind.is_block_device() {
        return Err(Unread::Device);
    }
    let mut bytes = Vec::new();
    if kind.is_fifo() {
        bytes = read_pipe(path, most)?;
    } else {
        let file = File::open(path)?;
        file.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    }
    if bytes.len() as u64 > most {
        return Err(Unread::TooLarge);
    }
    Ok(bytes)
}

/// The bytes of a pipe, up to the first beyond `most`. Opening a pipe that nothing writes into, or
/// reading from it, would keep the program waiting for ever.
fn read_pipe(path: &Path, most: u64) -> std::io::Result<Vec<u8>> {
    let mut options = File::options();
    let mut pipe = (options.read(true))
        .custom_flags(OFlags::NONBLOCK.bits() as i32)
        .open(path)?;
    let begun = Instant::now();
    let (mut bytes, mut piece) = (Vec::new(), vec![0; 64 << 10]);
    while bytes.len() as u64 <= most {
        match pipe.read(&mut piece) {
            // Its writer may be about to open it.
            Ok(0) if bytes.is_empty() && begun.elapsed() < WRITER_COMES => {}
            Ok(0) if bytes.is_empty() => {
                let what = "it is a named pipe that no program writes into";
                return Err(std::io::Error::new(ErrorKind::InvalidInput, what));
            }
            Ok(0) => break,
            Ok(length) => {
                bytes.extend_from_slice(&piece[..length]);
                continue;
            }
            Err(e) if [ErrorKind::WouldBlock, ErrorKind::Interrupted].contains(&e.kind()) => {}
            Err(e) => return Err(e),
        }
        std::thread::sleep(PAUSE);
    }
    Ok(bytes)
}

/// The source and the `--set` overrides as one text: an offset beyond the source's end lies in an
/// override, so that one number says of every value where it came from, and later offsets win.
#[derive(Clone, Copy)]
pub(super) struct Input<'a> {
    pub(super) source: &'a Source,
    pub(super) overrides: &'a [String],
}

impl<'a> Input<'a> {
    /// Offset of the k-th override.
    pub(super) fn override_offset(&self, k: usize) -> usize {
        let before: usize = self.overrides[..k].iter().map(|o| o.len() + 1).sum();
        self.source.length() + 1 + before
    }

    /// The override that holds the offset; `None` where it lies in the source.
    pub(super) fn override_at(&self, offset: usize) -> Option<&'a str> {
        (0..self.overrides.len())
            .rev()
            .find(|&k| self.override_offset(k) <= offset)
            .map(|k| self.overrides[k].as_str())
    }

    /// Whether the offset lies in a file that the first one extends.
    pub(super) fn is_extended(&self, offset: usize) -> bool {
        self.override_at(offset).is_none() && self.source.part_at(offset).start > 0
    }

    /// Whether both offsets lie in the same file.
    pub(super) fn are_beside(&self, first: usize, second: usize) -> bool {
        let [first, second] = [first, second].map(|offset| self.source.part_at(offset).start);
        first == second
    }

    /// The folder of the file that holds the offset.
    pub(super) fn folder(&self, offset: usize) -> &'a Path {
        &self.source.part_at(offset).folder
    }

    /// Line of its file, from 1.
    fn line(&self, offset: usize) -> usize {
        let part = self.source.part_at(offset);
        let bytes = part.padded.as_bytes();
        let before = &bytes[part.start..offset.min(bytes.len())];
        1 + before.iter().filter(|&&b| b == b'\n').count()
    }

    /// The text of the line.
    pub(super) fn text_of_line(&self, offset: usize) -> Option<&'a str> {
        let part = self.source.part_at(offset);
        part.padded[part.start..].lines().nth(self.line(offset) - 1)
    }

    /// [`Self::mention`] in a message about the place `beside`: names the file if that is another
    /// one.
    pub(super) fn mention_beside(&self, offset: usize, beside: usize) -> String {
        let in_files = self.override_at(offset).is_none() && self.override_at(beside).is_none();
        if in_files && !self.are_beside(offset, beside) {
            self.place(offset)
        } else {
            self.mention(offset)
        }
    }

    /// `line 12` or `--set a.b=c`: the place as another place's message refers to it. In a file
    /// that is extended, `base.toml:12`.
    pub(super) fn mention(&self, offset: usize) -> String {
        match self.override_at(offset) {
            Some(set) => format!("--set {set}"),
            None if self.is_extended(offset) => self.place(offset),
            None => format!("line {}", self.line(offset)),
        }
    }

    /// `file.toml:12` or `--set a.b=c`.
    pub(super) fn place(&self, offset: usize) -> String {
        match self.override_at(offset) {
            Some(set) => format!("--set {set}"),
            None => {
                let name = &self.source.part_at(offset).name;
                format!("{name}:{}", self.line(offset))
            }
        }
    }

    /// `file.toml:12: a.b: what`, or `--set a.b=c: what`.
    pub(super) fn message(&self, offset: usize, path: &str, what: &str) -> String {
        let place = self.place(offset);
        if path.is_empty() || self.override_at(offset).is_some() {
            format!("{place}: {what}")
        } else {
            format!("{place}: {path}: {what}")
        }
    }

    /// [`Input::message`] as a failure.
    pub(super) fn failure(&self, offset: usize, path: &str, what: &str) -> Failure {
        Failure::Input(self.message(offset, path, what))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What reading says of a file, without its name.
    fn refused(path: &Path) -> String {
        let said = Source::read(path).unwrap_err().to_string();
        let name = path.display().to_string();
        said.strip_prefix(&name).expect("the name first").into()
    }

    #[test]
    fn what_is_no_configuration_is_refused() {
        let missing = Path::new("no/such/file.toml");
        let give = "give a TOML file, such as configs/plane-shear-2d.toml, or none for the embedded default scene";
        assert_eq!(refused(missing), format!(": no such file; {give}"));
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(refused(dir.path()), format!(": is a directory; {give}"));
        let device = Path::new("/dev/zero");
        assert_eq!(refused(device), format!(": is a device; {give}"));
        let path = dir.path().join("huge.toml");
        // A hole: no byte of it is on the disk.
        let huge = File::create(&path).unwrap();
        huge.set_len(MOST_BYTES + 1).unwrap();
        let said = format!(": has more than 16777216 bytes; {give}");
        assert_eq!(refused(&path), said);
        let latin1 = b"seed = 1\ntitle = \"Scherversuch f\xfcr Granulate\"\n";
        std::fs::write(&path, latin1).unwrap();
        let said = format!(":2: byte 0xfc is not UTF-8; {give}");
        assert_eq!(refused(&path), said);
    }

    #[test]
    fn a_long_chain_of_files_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let at = |k: usize| dir.path().join(format!("{k}.toml"));
        for k in 0..=MOST_FILES {
            std::fs::write(at(k), format!("extends = \"{}.toml\"\n", k + 1)).unwrap();
        }
        let e = Source::read(at(0)).unwrap_err().to_string();
        let said = format!("{}:1: extends: is one file too many", at(15).display());
        assert!(e.starts_with(&said), "{e}");
        std::fs::write(at(MOST_FILES), "seed = 1\n").unwrap();
        assert_eq!(Source::read(at(1)).unwrap().parts.len(), MOST_FILES);
    }

    #[test]
    fn offsets_tell_lines_from_overrides() {
        let source = Source::new("x.toml", "a = 1\nb = 2\n");
        let overrides = ["a=3".to_string(), "c.d=4".to_string()];
        let input = Input {
            source: &source,
            overrides: &overrides,
        };
        assert_eq!(input.mention(0), "line 1");
        assert_eq!(input.mention(6), "line 2");
        assert_eq!(input.mention(input.override_offset(0)), "--set a=3");
        assert_eq!(input.mention(input.override_offset(1)), "--set c.d=4");
        assert_eq!(input.message(6, "b", "bad"), "x.toml:2: b: bad");
    }
}
