//! NumPy archives: one array per name, frames along the first axis.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use bytemuck::{NoUninit, cast_slice};
use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

use gshear_dem::failure::Failure;
use gshear_dem::state::GrainSample;
use gshear_store::text_writer::PartFile;

use super::FrameWriter;
use super::content::{ExportedFrame, ExportedRun, FieldShape, contact_quantities};

/// Collects the frames, and writes them at the end: an archive needs whole arrays.
pub struct NpzWriter {
    path: PathBuf,
    constants: Option<[Vec<f64>; 3]>,
    frame: Vec<u64>,
    step: Vec<u64>,
    time: Vec<f64>,
    strain: Vec<f64>,
    bounds: Vec<f64>,
    edges: Vec<f64>,
    position: Vec<f64>,
    velocity: Vec<f64>,
    angular_velocity: Vec<f64>,
    image: Vec<i64>,
    fields: Vec<(FieldShape, Vec<f64>)>,
    /// Row of the first contact of each frame, and after the last.
    offset: Vec<u64>,
    pairs: Vec<u32>,
    /// Name, number of components, and values.
    contacts: Vec<(&'static str, usize, Vec<f64>)>,
}

impl NpzWriter {
    /// An archive without frames.
    pub fn new(path: &Path) -> Self {
        Self {
            path: path.to_path_buf(),
            constants: None,
            frame: Vec::new(),
            step: Vec::new(),
            time: Vec::new(),
            strain: Vec::new(),
            bounds: Vec::new(),
            edges: Vec::new(),
            position: Vec::new(),
            velocity: Vec::new(),
            angular_velocity: Vec::new(),
            image: Vec::new(),
            fields: Vec::new(),
            offset: vec![0],
            pairs: Vec::new(),
            contacts: Vec::new(),
        }
    }

    fn write(self, part: &Path) -> Result<(), Box<dyn std::error::Error>> {
        let mut archive = Archive(ZipWriter::new(File::create(part)?));
        let frames = self.frame.len();
        let [radius, body, mass] = self.constants.unwrap_or_default();
        let body: Vec<u8> = body.into_iter().map(|body| body as u8).collect();
        let grains = radius.len();
        archive.add("frame", &self.frame, &[frames])?;
        archive.add("step", &self.step, &[frames])?;
        archive.add("time", &self.time, &[frames])?;
        archive.add("strain", &self.strain, &[frames])?;
        archive.add("bounds", &self.bounds, &[frames, 3, 2])?;
        archive.add("edges", &self.edges, &[frames, 3, 3])?;
        archive.add("radius", &radius, &[grains])?;
        archive.add("body", &body, &[grains])?;
        archive.add("mass", &mass, &[grains])?;
        let vectors = [frames, grains, 3];
        archive.add("position", &self.position, &vectors)?;
        archive.add("velocity", &self.velocity, &vectors)?;
        archive.add("angular_velocity", &self.angular_velocity, &vectors)?;
        archive.add("image", &self.image, &vectors)?;
        for (field, values) in &self.fields {
            let shape = match field.components {
                1 => &[frames, grains][..],
                components => &[frames, grains, components],
            };
            archive.add(&field.name, values, shape)?;
        }
        let contacts = self.pairs.len() / 2;
        archive.add("contact_offset", &self.offset, &[frames + 1])?;
        archive.add("contact_pair", &self.pairs, &[contacts, 2])?;
        for (name, components, values) in &self.contacts {
            let shape = [contacts, *components];
            let shape = if *components == 1 {
                &shape[..1]
            } else {
                &shape
            };
            archive.add(&format!("contact_{name}"), values, shape)?;
        }
        archive.0.finish()?;
        Ok(())
    }
}

/// An archive of arrays. The header of an array is one line; crates that write it also read it and
/// bring a parser of Python with a dozen dependencies.
struct Archive(ZipWriter<File>);

/// An element of an array, little-endian as the processors that this program runs on.
trait Element: NoUninit {
    /// NumPy's name of the type.
    const KIND: &'static str;
}

impl Element for f64 {
    const KIND: &'static str = "<f8";
}

impl Element for i64 {
    const KIND: &'static str = "<i8";
}

impl Element for u64 {
    const KIND: &'static str = "<u8";
}

impl Element for u32 {
    const KIND: &'static str = "<u4";
}

impl Element for u8 {
    const KIND: &'static str = "|u1";
}

impl Archive {
    /// Bytes of magic number, version and length of the header.
    const BEFORE: usize = 10;

    /// Adds an array in C order (NumPy's format NPY 1.0).
    fn add<T: Element>(
        &mut self,
        name: &str,
        values: &[T],
        shape: &[usize],
    ) -> Result<(), Box<dyn std::error::Error>> {
        const { assert!(cfg!(target_endian = "little")) }
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .large_file(true);
        self.0.start_file(format!("{name}.npy"), options)?;
        let shape: String = shape.iter().map(|n| format!("{n}, ")).collect();
        let mut header = format!(
            "{{'descr': '{}', 'fortran_order': False, 'shape': ({}), }}",
            T::KIND,
            shape.trim_end()
        );
        // Data begin at a multiple of 64 bytes, after a line break.
        let end = (Self::BEFORE + header.len() + 1).next_multiple_of(64) - Self::BEFORE;
        header = format!("{header:<width$}\n", width = end - 1);
        self.0.write_all(b"\x93NUMPY\x01\x00")?;
        self.0
            .write_all(&u16::try_from(header.len())?.to_le_bytes())?;
        self.0.write_all(header.as_bytes())?;
        self.0.write_all(cast_slice(values))?;
        Ok(())
    }
}

impl FrameWriter for NpzWriter {
    fn frame(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> Result<(), Failure> {
        let constants = run.grains();
        self.constants.get_or_insert_with(|| {
            let body = constants.body.iter().map(|&body| body.into());
            [
                constants.radius.clone(),
                body.collect(),
                constants.mass.clone(),
            ]
        });
        let records = &frame.records;
        self.frame.push(frame.number as u64);
        self.step.push(records.step);
        self.time.push(records.time);
        self.strain.push(frame.strain);
        self.bounds.extend(cast_slice::<_, f64>(&run.bounds(frame)));
        self.edges.extend(cast_slice::<_, f64>(&run.edges(frame)));
        let of = |value: fn(&GrainSample) -> [f64; 3]| records.grains.iter().flat_map(value);
        self.position.extend(of(|g| g.position));
        self.velocity.extend(of(|g| g.velocity));
        self.angular_velocity.extend(of(|g| g.angular_velocity));
        self.image
            .extend(records.grains.iter().flat_map(|g| g.image));
        if self.fields.is_empty() {
            let shapes = run.shapes().into_iter();
            self.fields = shapes.map(|shape| (shape, Vec::new())).collect();
        }
        for ((_, all), values) in self.fields.iter_mut().zip(&frame.fields) {
            all.extend(values);
        }
        let contacts = &records.contacts;
        self.pairs.extend(contacts.iter().flat_map(|c| [c.i, c.j]));
        self.offset.push(self.pairs.len() as u64 / 2);
        let quantities = contact_quantities(run.axes());
        if self.contacts.is_empty() {
            let named = quantities
                .iter()
                .map(|q| (q.name, q.components.len(), Vec::new()));
            self.contacts = named.collect();
        }
        for ((.., all), quantity) in self.contacts.iter_mut().zip(&quantities) {
            all.extend(contacts.iter().flat_map(|contact| quantity.values(contact)));
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, Failure> {
        let part = PartFile::create(&self.path)?;
        let written = self.write(part.part());
        part.checked(written)?;
        Ok(vec![part.finish()?])
    }
}
