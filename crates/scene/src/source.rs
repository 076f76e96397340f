//! The texts that a configuration is read from, and how a message names a place in them.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

use gshear_dem::failure::Failure;

/// A configuration as text, with the name that messages give it.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    name: String,
    text: String,
    /// Where the paths in it begin.
    folder: PathBuf,
    /// Whether its sweep is passed over, as by one of the runs that it makes.
    member: bool,
}

impl Source {
    /// A text from elsewhere, such as the scene that a checkpoint holds.
    pub fn new(name: impl Into<String>, text: impl Into<String>) -> Self {
        Source {
            name: name.into(),
            text: text.into(),
            folder: PathBuf::new(),
            member: false,
        }
    }

    /// The text of this file.
    pub fn of_file(path: impl AsRef<Path>, text: impl Into<String>) -> Self {
        let path = path.as_ref();
        Source {
            folder: path.parent().unwrap_or(Path::new("")).into(),
            ..Source::new(path.display().to_string(), text)
        }
    }

    /// The scene that runs when no file is given: `configs/plane-shear-2d.toml`.
    pub fn embedded() -> Self {
        Source::new(
            "embedded default scene",
            include_str!("../../../configs/plane-shear-2d.toml"),
        )
    }

    /// Reads a file, named in messages as it was given.
    ///
    /// # Errors `Failure::Input` where there is no such file, it is a directory, it cannot be read
    /// or is not UTF-8.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, Failure> {
        let path = path.as_ref();
        let text = read_text(path, FORMAT, MOST_BYTES)?;
        Ok(Source::of_file(path, text))
    }

    /// The same as one of the runs of its sweep reads it: without the sweep.
    pub fn of_member(&self) -> Self {
        Source {
            member: true,
            ..self.clone()
        }
    }

    pub(super) fn is_member(&self) -> bool {
        self.member
    }

    /// The name in messages.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The folder in which the paths of the text begin.
    pub fn folder(&self) -> &Path {
        &self.folder
    }
}

/// The expected file, as messages about a missing or unreadable one name it.
const FORMAT: &str =
    "a TOML file, such as configs/plane-shear-2d.toml, or none for the embedded default scene";

/// Bytes of a configuration. A list of half a million radii has fewer.
const MOST_BYTES: u64 = 16 << 20;

/// The text of a file, which messages name as it was given; they ask for `format` instead of what is
/// no such file. `most`: bytes that it may have.
///
/// # Errors
/// `Failure::Input` if there is no such file, it is a directory or a device, it is too large, it
/// cannot be read, or is not UTF-8.
pub(super) fn read_text(path: &Path, format: &str, most: u64) -> Result<String, Failure> {
    let name = path.display();
    let refuse = |what: String| Failure::input(format!("{name}: {what}"));
    let unreadable = |e: std::io::Error| {
        refuse(match e.kind() {
            ErrorKind::NotFound => format!("no such file; give {format}"),
            ErrorKind::PermissionDenied => {
                "cannot be read: permission denied; allow reading it".into()
            }
            _ => format!("cannot be read: {e}"),
        })
    };
    let kind = std::fs::metadata(path).map_err(unreadable)?.file_type();
    if kind.is_dir() {
        return Err(refuse(format!("is a directory; give {format}")));
    }
    // Such as /dev/zero, which has no end.
    if kind.is_char_device() || kind.is_block_device() {
        return Err(refuse(format!("is a device; give {format}")));
    }
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(unreadable)?;
    let read = file.take(most.saturating_add(1)).read_to_end(&mut bytes);
    read.map_err(unreadable)?;
    if bytes.len() as u64 > most {
        return Err(refuse(format!("has more than {most} bytes; give {format}")));
    }
    String::from_utf8(bytes).map_err(|e| {
        let good = e.utf8_error().valid_up_to();
        let bytes = e.as_bytes();
        let line = 1 + bytes[..good].iter().filter(|&&b| b == b'\n').count();
        Failure::input(format!(
            "{name}:{line}: byte 0x{:02x} is not UTF-8; give {format}",
            bytes[good]
        ))
    })
}

/// The source and the `--set` overrides as one text: an offset beyond the source's end lies in an
/// override, so that one number says of every value where it came from, and later offsets win.
#[derive(Clone, Copy)]
pub(super) struct Input<'a> {
    pub source: &'a Source,
    pub overrides: &'a [String],
}

impl<'a> Input<'a> {
    /// Offset of the k-th override.
    pub fn override_offset(&self, k: usize) -> usize {
        let before: usize = self.overrides[..k].iter().map(|o| o.len() + 1).sum();
        self.source.text.len() + 1 + before
    }

    /// The override that holds the offset; `None` where it lies in the source.
    pub fn override_at(&self, offset: usize) -> Option<&'a str> {
        (0..self.overrides.len())
            .rev()
            .find(|&k| self.override_offset(k) <= offset)
            .map(|k| self.overrides[k].as_str())
    }

    /// Line of the source, from 1.
    pub fn line(&self, offset: usize) -> usize {
        let bytes = self.source.text.as_bytes();
        1 + bytes[..offset.min(bytes.len())]
            .iter()
            .filter(|&&b| b == b'\n')
            .count()
    }

    /// `line 12` or `--set a.b=c`: the place as another place's message refers to it.
    pub fn mention(&self, offset: usize) -> String {
        match self.override_at(offset) {
            Some(set) => format!("--set {set}"),
            None => format!("line {}", self.line(offset)),
        }
    }

    /// `file.toml:12` or `--set a.b=c`.
    pub fn place(&self, offset: usize) -> String {
        match self.override_at(offset) {
            Some(set) => format!("--set {set}"),
            None => format!("{}:{}", self.source.name, self.line(offset)),
        }
    }

    /// `file.toml:12: a.b: what`, or `--set a.b=c: what`.
    pub fn message(&self, offset: usize, path: &str, what: &str) -> String {
        let place = self.place(offset);
        if path.is_empty() || self.override_at(offset).is_some() {
            format!("{place}: {what}")
        } else {
            format!("{place}: {path}: {what}")
        }
    }

    /// [`Input::message`] as a failure.
    pub fn failure(&self, offset: usize, path: &str, what: &str) -> Failure {
        Failure::Input(self.message(offset, path, what))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_file_is_named() {
        let e = Source::read("no/such/file.toml").unwrap_err();
        assert_eq!(
            e,
            Failure::input(
                "no/such/file.toml: no such file; give a TOML file, such as configs/plane-shear-2d.toml, or none for the embedded default scene"
            )
        );
    }

    #[test]
    fn a_directory_is_no_configuration() {
        let dir = tempfile::tempdir().unwrap();
        let e = Source::read(dir.path()).unwrap_err();
        let name = dir.path().display();
        assert_eq!(
            e,
            Failure::input(format!("{name}: is a directory; give {FORMAT}"))
        );
    }

    #[test]
    fn bytes_that_are_not_utf8_are_found() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("latin1.toml");
        std::fs::write(
            &path,
            b"seed = 1\ntitle = \"Scherversuch f\xfcr Granulate\"\n",
        )
        .unwrap();
        let e = Source::read(&path).unwrap_err();
        assert_eq!(
            e,
            Failure::input(format!(
                "{}:2: byte 0xfc is not UTF-8; give {FORMAT}",
                path.display()
            ))
        );
    }

    #[test]
    fn devices_and_huge_files_are_no_configurations() {
        let e = Source::read("/dev/zero").unwrap_err();
        assert_eq!(
            e,
            Failure::input(format!("/dev/zero: is a device; give {FORMAT}"))
        );
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("huge.toml");
        // A hole: no byte of it is on the disk.
        File::create(&path)
            .unwrap()
            .set_len(MOST_BYTES + 1)
            .unwrap();
        let e = Source::read(&path).unwrap_err();
        assert_eq!(
            e,
            Failure::input(format!(
                "{}: has more than 16777216 bytes; give {FORMAT}",
                path.display()
            ))
        );
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
