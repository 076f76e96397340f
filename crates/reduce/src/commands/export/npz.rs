//! NumPy archives: one array per name, frames along the first axis.

use std::error::Error;
use std::io::{self, ErrorKind, Seek, SeekFrom, Write};
use std::num::TryFromIntError;
use std::path::{Path, PathBuf};

use bytemuck::{NoUninit, cast_slice};
use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

use gshear_analysis::forces;
use gshear_dem::failure::Result;
use gshear_store::contact_quantities::of_contacts;
use gshear_store::text_writer::PartFile;

use super::FrameWriter;
use super::content::{ExportedFrame, ExportedRun};

/// Collects the frames, and writes them at the end: an archive needs whole arrays.
pub(crate) struct NpzWriter {
    path: PathBuf,
    arrays: Vec<Array>,
}

/// An array that grows along its first axis. The header of an array is one line; crates that write
/// it also read it and bring a parser of Python with a dozen dependencies.
struct Array {
    name: String,
    /// NumPy's name of the type.
    kind: &'static str,
    /// Lengths of the axes.
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

/// An element of an array, little-endian as the processors that this program runs on.
trait Element: NoUninit {
    /// NumPy's name of the type.
    const KIND: &'static str;
}

macro_rules! elements {
    ($($element:ty: $kind:literal),*) => {$(
        impl Element for $element {
            const KIND: &'static str = $kind;
        }
    )*};
}

elements!(f64: "<f8", i64: "<i8", u64: "<u8", u32: "<u4", u8: "|u1");

/// Bytes of magic number, version and length of the header.
const BEFORE: usize = 10;

impl Array {
    /// The header in NumPy's format NPY 1.0, for C order.
    fn header(&self) -> Result<Vec<u8>, TryFromIntError> {
        const { assert!(cfg!(target_endian = "little")) }
        let shape: String = self.shape.iter().map(|n| format!("{n}, ")).collect();
        let header = format!(
            "{{'descr': '{}', 'fortran_order': False, 'shape': ({}), }}",
            self.kind,
            shape.trim_end()
        );
        // Data begin at a multiple of 64 bytes, after a line break.
        let end = (BEFORE + header.len() + 1).next_multiple_of(64) - BEFORE;
        let header = format!("{header:<width$}\n", width = end - 1);
        let length = u16::try_from(header.len())?.to_le_bytes();
        Ok([&b"\x93NUMPY\x01\x00"[..], &length, header.as_bytes()].concat())
    }
}

impl NpzWriter {
    /// An archive without frames.
    pub fn new(path: &Path) -> Self {
        Self {
            path: path.to_path_buf(),
            arrays: Vec::new(),
        }
    }

    /// Appends so many entries, each of this shape, to an array.
    fn append<T: Element>(&mut self, name: &str, entries: usize, shape: &[usize], values: &[T]) {
        let known = self.arrays.iter().position(|array| array.name == name);
        let at = known.unwrap_or_else(|| {
            self.arrays.push(Array {
                name: name.into(),
                kind: T::KIND,
                shape: [&[0], shape].concat(),
                bytes: Vec::new(),
            });
            self.arrays.len() - 1
        });
        let array = &mut self.arrays[at];
        array.shape[0] += entries;
        array.bytes.extend_from_slice(cast_slice(values));
    }

    /// Appends the row after the contacts of a frame, before the first frame 0. `rows`: an array
    /// with a row of each contact, those of the frame not yet.
    fn append_offset(&mut self, name: &str, rows: &str, contacts: usize) {
        let mut arrays = self.arrays.iter();
        let before = arrays.find(|array| array.name == rows);
        let is_first = before.is_none();
        let before = before.map_or(0, |array| array.shape[0]);
        if is_first {
            self.append(name, 1, &[], &[0u64]);
        }
        self.append(name, 1, &[], &[(before + contacts) as u64]);
    }

    fn append_wall_contacts(&mut self, run: &ExportedRun, frame: &ExportedFrame) {
        let (form, records) = (run.file.form(), &frame.records);
        let contacts = &records.wall_contacts;
        self.append_offset("wall_contact_offset", "wall_contact_grain", contacts.len());
        let count = contacts.len();
        let grains: Vec<u32> = contacts.iter().map(|c| c.i).collect();
        self.append("wall_contact_grain", count, &[], &grains);
        let walls = contacts.iter().map(|c| c.wall(records.grains.len()));
        let walls: Vec<u8> = walls.map(|wall| wall.unwrap_or_default() as u8).collect();
        self.append("wall_contact_wall", count, &[], &walls);
        let points = contacts.iter().flat_map(|c| run.wall_point(frame, c));
        let points: Vec<f64> = points.collect();
        self.append("wall_contact_point", count, &[3], &points);
        let on_grains = contacts
            .iter()
            .flat_map(|c| forces::vectors(records, c).force);
        let on_grains: Vec<f64> = on_grains.collect();
        self.append("wall_contact_force", count, &[3], &on_grains);
        for quantity in of_contacts(form) {
            let values: Vec<f64> = (contacts.iter())
                .flat_map(|contact| quantity.values(form, contact))
                .collect();
            let name = format!("wall_contact_{}", quantity.column);
            let width = quantity.width(form);
            let shape = if width == 1 { &[][..] } else { &[width] };
            self.append(&name, count, shape, &values);
        }
    }

    fn write(&self, part: &mut PartFile) -> Result<(), Box<dyn Error>> {
        let mut failure = None;
        let mut archive = ZipWriter::new(UntilFailure {
            part,
            failure: &mut failure,
            at: 0,
            end: 0,
        });
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .large_file(true);
        for array in &self.arrays {
            archive.start_file(format!("{}.npy", array.name), options)?;
            archive.write_all(&array.header()?)?;
            archive.write_all(&array.bytes)?;
        }
        archive.finish()?;
        failure.map_or(Ok(()), |e| Err(e.into()))
    }
}

/// A file that takes what is written after a failure, and drops it. An archive that fails would end
/// itself when it is dropped, and print that this fails, too.
struct UntilFailure<'a> {
    part: &'a mut PartFile,
    failure: &'a mut Option<io::Error>,
    /// Position and length (bytes).
    at: u64,
    end: u64,
}

impl UntilFailure<'_> {
    fn go_on(&mut self, go_on: impl FnOnce(&mut PartFile) -> io::Result<()>) {
        if self.failure.is_none() {
            *self.failure = go_on(self.part).err();
        }
    }
}

impl Write for UntilFailure<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.go_on(|part| part.write_all(bytes));
        self.at += bytes.len() as u64;
        self.end = self.end.max(self.at);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.go_on(Write::flush);
        Ok(())
    }
}

impl Seek for UntilFailure<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let at = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
            SeekFrom::End(by) => self.end.checked_add_signed(by),
        };
        self.at = at.ok_or(ErrorKind::InvalidInput)?;
        let at = SeekFrom::Start(self.at);
        self.go_on(|part| part.seek(at).map(drop));
        Ok(self.at)
    }
}

impl FrameWriter for NpzWriter {
    fn frame(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> Result<()> {
        let (is_first, records) = (self.arrays.is_empty(), &frame.records);
        self.append("frame", 1, &[], &[frame.number as u64]);
        self.append("step", 1, &[], &[records.step]);
        self.append("time", 1, &[], &[records.time]);
        self.append("strain", 1, &[], &[frame.strain]);
        self.append("bounds", 1, &[3, 2], run.bounds(frame).as_flattened());
        self.append("edges", 1, &[3, 3], run.edges(frame).as_flattened());
        let (n, shared) = (records.grains.len(), run.file.grains());
        if is_first {
            self.append("id", n, &[], run.file.ids());
            self.append("radius", n, &[], &shared.radius);
            self.append("body", n, &[], &shared.body);
            self.append("mass", n, &[], &shared.mass);
        }
        let grains = records.grains.iter();
        let positions: Vec<f64> = grains.clone().flat_map(|g| g.position).collect();
        self.append("position", 1, &[n, 3], &positions);
        let velocities: Vec<f64> = grains.clone().flat_map(|g| g.velocity).collect();
        self.append("velocity", 1, &[n, 3], &velocities);
        let spins: Vec<f64> = grains.flat_map(|g| g.angular_velocity).collect();
        self.append("angular_velocity", 1, &[n, 3], &spins);
        let images: Vec<i64> = records.grains.iter().flat_map(|g| g.image).collect();
        self.append("image", 1, &[n, 3], &images);
        for ((name, components), values) in run.shapes().iter().zip(&frame.fields) {
            let shape = [n, *components];
            let axes = if *components == 1 { 1 } else { 2 };
            self.append(name, 1, &shape[..axes], values);
        }
        let contacts = &records.contacts;
        self.append_offset("contact_offset", "contact_pair", contacts.len());
        let pairs: Vec<u32> = contacts.iter().flat_map(|c| [c.i, c.j]).collect();
        self.append("contact_pair", contacts.len(), &[2], &pairs);
        let form = run.file.form();
        for quantity in of_contacts(form) {
            let width = quantity.width(form);
            let shape = if width == 1 { &[][..] } else { &[width] };
            let values: Vec<f64> = (contacts.iter())
                .flat_map(|contact| quantity.values(form, contact))
                .collect();
            let name = format!("contact_{}", quantity.column);
            self.append(&name, contacts.len(), shape, &values);
        }
        if form.walls {
            self.append_wall_contacts(run, frame);
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>> {
        let mut part = PartFile::create(&self.path)?;
        let written = self.write(&mut part);
        part.checked(written)?;
        Ok(vec![part.finish()?])
    }
}
