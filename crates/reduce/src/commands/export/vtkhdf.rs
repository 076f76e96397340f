//! VTKHDF files of type PolyData in time (VTK file formats, "VTKHDF file format", version 2.0):
//! grains are vertices, contacts are lines between their centres.
//!
//! A contact across a periodic boundary would be a line through the whole sample. It ends at an
//! image of its second grain instead, a point without a vertex at the end of the points of the
//! frame, with the data of its grain. So does one with a flat wall at a point of that, with the
//! data of its only grain.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use hdf5::types::{FixedAscii, VarLenUnicode};
use hdf5::{Dataset, H5Type, Hyperslab, SliceOrIndex};
use ndarray::ArrayViewD;

use gshear_dem::failure::Result;
use gshear_store::checked::CheckedFile;
use gshear_store::contact_quantities::of_contacts;

use super::FrameWriter;
use super::content::{ExportedFrame, ExportedRun};

/// The group that holds everything.
const ROOT: &str = "VTKHDF";
/// The kinds of cells of PolyData, in the order of the columns of `CellOffsets`.
const KINDS: [&str; 4] = ["Vertices", "Lines", "Polygons", "Strips"];
/// Groups of data, and of the places of each step in them.
const GROUPS: [&str; 4] = [
    "PointData",
    "CellData",
    "Steps/PointDataOffsets",
    "Steps/CellDataOffsets",
];
/// Numbers in a chunk of a growing dataset of points or cells.
const CHUNK: usize = 8 << 10;
/// Numbers in a chunk of a dataset with an entry per step.
const STEP_CHUNK: usize = 256;

/// Writes the file.
pub(crate) struct VtkWriter {
    file: CheckedFile,
    /// Datasets by their paths in the group `VTKHDF`.
    datasets: HashMap<String, Dataset>,
    frames: i64,
}

impl VtkWriter {
    /// # Errors
    /// A file that cannot be created.
    pub fn create(path: &Path, run: &ExportedRun) -> Result<Self> {
        let file = CheckedFile::create(path)?;
        let described = describe(&file, run);
        file.checked(described)?;
        Ok(Self {
            file,
            datasets: HashMap::new(),
            frames: 0,
        })
    }

    /// Number of entries of a dataset.
    fn entries(&self, name: &str) -> usize {
        let dataset = self.datasets.get(name);
        dataset.map_or(0, |dataset| dataset.shape()[0])
    }

    /// Appends entries of `width` numbers to a dataset, which the first call creates, with so many
    /// numbers in a chunk; it has one axis if `width` is 1.
    fn grow<T: H5Type>(
        &mut self,
        name: &str,
        width: usize,
        chunk: usize,
        values: &[T],
    ) -> hdf5::Result<()> {
        if !self.datasets.contains_key(name) {
            let row_shape = if width == 1 { &[][..] } else { &[width] };
            let path = format!("{ROOT}/{name}");
            let dataset = (self.file).growing::<T>(&path, row_shape, (chunk / width).max(1))?;
            self.datasets.insert(name.into(), dataset);
        }
        let (first, new) = (self.entries(name), values.len() / width);
        if new == 0 {
            return Ok(());
        }
        let dataset = &self.datasets[name];
        dataset.resize(shape(first + new, width))?;
        let mut place = vec![SliceOrIndex::from(first..first + new)];
        place.resize(dataset.ndim(), SliceOrIndex::from(..));
        let view = ArrayViewD::from_shape(shape(new, width), values).map_err(|e| e.to_string())?;
        dataset.write_slice(view, Hyperslab::from(place))
    }

    /// Appends numbers to a dataset of points or cells.
    fn append<T: H5Type>(&mut self, name: &str, width: usize, values: &[T]) -> hdf5::Result<()> {
        self.grow(name, width, CHUNK, values)
    }

    /// Appends the entry of a step.
    fn append_step<T: H5Type>(&mut self, name: &str, entry: &[T]) -> hdf5::Result<()> {
        self.grow(name, entry.len(), STEP_CHUNK, entry)
    }

    /// Appends data of the points or cells of a frame, and where they begin.
    fn append_data<T: H5Type>(
        &mut self,
        group: &str,
        name: &str,
        width: usize,
        values: &[T],
    ) -> hdf5::Result<()> {
        let path = format!("{group}/{name}");
        let before = self.entries(&path) as i64;
        self.append_step(&format!("Steps/{group}Offsets/{name}"), &[before])?;
        self.append(&path, width, values)
    }

    /// Appends the cells of a frame, each of `corners` points.
    fn append_cells(
        &mut self,
        kind: &str,
        connectivity: &[i64],
        corners: usize,
    ) -> hdf5::Result<()> {
        let cells = connectivity.len() / corners;
        let offsets: Vec<i64> = (0..=cells).map(|k| (k * corners) as i64).collect();
        let ids = connectivity.len() as i64;
        self.append_step(&format!("{kind}/NumberOfCells"), &[cells as i64])?;
        self.append_step(&format!("{kind}/NumberOfConnectivityIds"), &[ids])?;
        self.append(&format!("{kind}/Offsets"), 1, &offsets)?;
        self.append(&format!("{kind}/Connectivity"), 1, connectivity)
    }

    fn append_frame(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> hdf5::Result<()> {
        self.append_places(frame.records.time)?;
        let point_grains = self.append_geometry(run, frame)?;
        self.append_point_data(run, frame, &point_grains)?;
        let form = run.file.form();
        for quantity in of_contacts(form) {
            let width = quantity.width(form);
            // Of vertices nothing is known.
            let none = std::iter::repeat_n(f64::NAN, frame.present.len() * width);
            let contacts = frame.records.contacts.iter();
            let contacts = contacts.chain(&frame.records.wall_contacts);
            let values = none.chain(contacts.flat_map(|contact| quantity.values(form, contact)));
            let values: Vec<f64> = values.collect();
            self.append_data("CellData", quantity.column.name, width, &values)?;
        }
        if form.walls {
            let records = &frame.records;
            let none = std::iter::repeat_n(f64::NAN, frame.present.len());
            let contacts = records.contacts.iter().chain(&records.wall_contacts);
            let walls = contacts.map(|c| c.wall(records.grains.len()).unwrap_or_default().into());
            let walls: Vec<f64> = none.chain(walls).collect();
            self.append_data("CellData", "wall", 1, &walls)?;
        }
        Ok(())
    }

    /// Appends the places of the next step in the datasets.
    fn append_places(&mut self, time: f64) -> hdf5::Result<()> {
        let points = self.entries("Points") as i64;
        let [offsets, connectivity] = ["Offsets", "Connectivity"]
            .map(|name| KINDS.map(|kind| self.entries(&format!("{kind}/{name}")) as i64));
        // Offsets have one number more than cells in every step; readers count without it.
        let cells = offsets.map(|offsets| offsets - self.frames);
        self.append_step("Steps/Values", &[time])?;
        self.append_step("Steps/PartOffsets", &[self.frames])?;
        self.append_step("Steps/NumberOfParts", &[1i64])?;
        self.append_step("Steps/PointOffsets", &[points])?;
        self.append_step("Steps/CellOffsets", &cells)?;
        self.append_step("Steps/ConnectivityIdOffsets", &connectivity)?;
        self.frames += 1;
        Ok(())
    }

    /// Appends points and cells. Returns the grain of every point: the grains, then images and
    /// points of flat walls at the ends of contacts.
    fn append_geometry(
        &mut self,
        run: &ExportedRun,
        frame: &ExportedFrame,
    ) -> hdf5::Result<Vec<usize>> {
        let (grains, contacts) = (&frame.records.grains, &frame.records.contacts);
        let mut point_grains = frame.present.clone();
        let mut points: Vec<f64> = point_grains
            .iter()
            .flat_map(|&g| grains[g].position)
            .collect();
        let mut point_of = vec![0; grains.len()];
        for (point, &g) in point_grains.iter().enumerate() {
            point_of[g] = point;
        }
        let mut lines = Vec::with_capacity(2 * contacts.len());
        for contact in contacts {
            let (image, moved) = run.nearest_image(frame, contact.i, contact.j);
            let end = if moved {
                point_grains.push(contact.j as usize);
                points.extend(image);
                point_grains.len() - 1
            } else {
                point_of[contact.j as usize]
            };
            lines.extend([point_of[contact.i as usize] as i64, end as i64]);
        }
        for contact in &frame.records.wall_contacts {
            lines.extend([point_of[contact.i as usize], point_grains.len()].map(|n| n as i64));
            point_grains.push(contact.i as usize);
            points.extend(run.wall_point(frame, contact));
        }
        self.append_step("NumberOfPoints", &[point_grains.len() as i64])?;
        self.append("Points", 3, &points)?;
        let vertices: Vec<i64> = (0..frame.present.len() as i64).collect();
        let cells = [(&vertices[..], 1), (&lines, 2), (&[], 1), (&[], 1)];
        for (kind, (connectivity, corners)) in KINDS.into_iter().zip(cells) {
            self.append_cells(kind, connectivity, corners)?;
        }
        Ok(point_grains)
    }

    fn append_point_data(
        &mut self,
        run: &ExportedRun,
        frame: &ExportedFrame,
        point_grains: &[usize],
    ) -> hdf5::Result<()> {
        const GROUP: &str = "PointData";
        let (grains, constants) = (&frame.records.grains, run.file.grains());
        let velocities: Vec<f64> = point_grains
            .iter()
            .flat_map(|&g| grains[g].velocity)
            .collect();
        self.append_data(GROUP, "velocity", 3, &velocities)?;
        let spins = point_grains
            .iter()
            .flat_map(|&g| grains[g].angular_velocity);
        let spins: Vec<f64> = spins.collect();
        self.append_data(GROUP, "angular_velocity", 3, &spins)?;
        let body: Vec<f64> = constants.body.iter().map(|&body| body.into()).collect();
        let constants_by_name = [
            ("radius", &constants.radius),
            ("mass", &constants.mass),
            ("body", &body),
        ];
        let shapes = run.shapes();
        let fields = shapes.iter().zip(&frame.fields);
        let fields = fields.map(|((name, width), values)| (&**name, *width, values));
        let constants = constants_by_name.map(|(name, values)| (name, 1, values));
        for (name, width, values) in constants.into_iter().chain(fields) {
            let points = point_grains.iter();
            let values: Vec<f64> = points
                .flat_map(|&g| values[g * width..][..width].iter().copied())
                .collect();
            self.append_data(GROUP, name, width, &values)?;
        }
        let ids: Vec<i64> = point_grains
            .iter()
            .map(|&g| run.file.ids()[g].into())
            .collect();
        self.append_data(GROUP, "id", 1, &ids)
    }
}

/// The shape of so many entries of `width` numbers.
fn shape(entries: usize, width: usize) -> Vec<usize> {
    match width {
        1 => vec![entries],
        _ => vec![entries, width],
    }
}

/// Writes what the file is, and its groups.
fn describe(file: &CheckedFile, run: &ExportedRun) -> hdf5::Result<()> {
    let root = file.root()?.create_group(ROOT)?;
    root.new_attr_builder()
        .with_data(&[2i64, 0])
        .create("Version")?;
    let kind = FixedAscii::<8>::from_ascii(b"PolyData").map_err(|e| e.to_string())?;
    root.new_attr::<FixedAscii<8>>()
        .create("Type")?
        .write_scalar(&kind)?;
    let title: VarLenUnicode = run.title().parse().unwrap_or_default();
    root.new_attr::<VarLenUnicode>()
        .create("origin")?
        .write_scalar(&title)?;
    for group in KINDS.into_iter().chain(GROUPS) {
        root.create_group(group)?;
    }
    Ok(())
}

impl FrameWriter for VtkWriter {
    fn frame(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> Result<()> {
        let appended = self.append_frame(run, frame);
        self.file.checked(appended)
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>> {
        let Self {
            file,
            datasets,
            frames,
        } = *self;
        drop(datasets);
        let counted = file.root().and_then(|root| {
            let steps = root.group(&format!("{ROOT}/Steps"))?;
            steps
                .new_attr::<i64>()
                .create("NSteps")?
                .write_scalar(&frames)
        });
        file.checked(counted)?;
        Ok(vec![file.finish()?])
    }
}
