//! VTKHDF files of type PolyData in time (VTK file formats, "VTKHDF file format", version 2.0):
//! grains are vertices, contacts are lines between their centres.
//!
//! A contact across a periodic boundary would be a line through the whole sample. It ends at an
//! image of its second grain instead, a point without a vertex at the end of the points of the
//! frame, with the data of its grain.

use std::path::{Path, PathBuf};

use hdf5::types::FixedAscii;
use hdf5::{Dataset, File, Group, H5Type};
use ndarray::{ArrayView1, ArrayView2, s};

use gshear_dem::failure::Failure;
use gshear_dem::state::GrainSample;
use gshear_store::contact_quantities::{ContactQuantity, of_contacts};
use gshear_store::text_writer::{PartFile, unwritten};

use super::FrameWriter;
use super::content::{ExportedFrame, ExportedRun};

/// The kinds of cells of PolyData, in the order of the columns of `CellOffsets`.
const KINDS: [&str; 4] = ["Vertices", "Lines", "Polygons", "Strips"];
/// Numbers in a chunk of a growing dataset of points or cells.
const CHUNK: usize = 8 << 10;
/// Numbers in a chunk of a dataset with an entry per step.
const STEP_CHUNK: usize = 256;

/// Writes the file.
pub struct VtkWriter {
    part: PartFile,
    file: File,
    points: Column<f64>,
    point_data: Vec<Column<f64>>,
    ids: Column<i64>,
    cells: [CellColumns; 4],
    cell_data: Vec<(&'static ContactQuantity, Column<f64>)>,
    /// Steps: values, and the place of each step in the datasets.
    steps: StepColumns,
    frames: i64,
}

/// The cells of one kind.
struct CellColumns {
    cells: Column<i64>,
    ids: Column<i64>,
    offsets: Column<i64>,
    connectivity: Column<i64>,
}

struct StepColumns {
    group: Group,
    values: Column<f64>,
    number_of_points: Column<i64>,
    /// [`OF_STEPS`].
    places: Vec<Column<i64>>,
    point_data: Vec<Column<i64>>,
    cell_data: Vec<Column<i64>>,
}

/// Places of a step in the datasets, and their widths.
const OF_STEPS: [(&str, usize); 5] = [
    ("PartOffsets", 1),
    ("NumberOfParts", 1),
    ("PointOffsets", 1),
    ("CellOffsets", KINDS.len()),
    ("ConnectivityIdOffsets", KINDS.len()),
];

/// A dataset that grows along its first axis; `width` numbers an entry.
struct Column<T> {
    dataset: Dataset,
    width: usize,
    rows: usize,
    kind: std::marker::PhantomData<T>,
}

impl<T: H5Type> Column<T> {
    /// A dataset of one axis if `width` is 1.
    fn create(group: &Group, name: &str, width: usize) -> hdf5::Result<Self> {
        Self::chunked(group, name, width, CHUNK)
    }

    /// A dataset with an entry per step.
    fn of_steps(group: &Group, name: &str, width: usize) -> hdf5::Result<Self> {
        Self::chunked(group, name, width, STEP_CHUNK)
    }

    fn chunked(group: &Group, name: &str, width: usize, chunk: usize) -> hdf5::Result<Self> {
        let builder = group.new_dataset::<T>();
        let entries = (chunk / width).max(1);
        let dataset = match width {
            1 => builder.chunk((entries,)).shape((0..,)).create(name)?,
            _ => builder
                .chunk((entries, width))
                .shape((0.., width))
                .create(name)?,
        };
        Ok(Self {
            dataset,
            width,
            rows: 0,
            kind: std::marker::PhantomData,
        })
    }

    fn append(&mut self, values: &[T]) -> hdf5::Result<()> {
        let rows = values.len() / self.width;
        if rows == 0 {
            return Ok(());
        }
        let (first, end) = (self.rows, self.rows + rows);
        self.rows = end;
        match self.width {
            1 => {
                self.dataset.resize((end,))?;
                self.dataset
                    .write_slice(ArrayView1::from(values), s![first..end])
            }
            width => {
                self.dataset.resize((end, width))?;
                let view = ArrayView2::from_shape((rows, width), values)
                    .map_err(|e| hdf5::Error::from(e.to_string()))?;
                self.dataset.write_slice(view, s![first..end, ..])
            }
        }
    }
}

impl CellColumns {
    fn create(root: &Group, kind: &str) -> hdf5::Result<Self> {
        let group = root.create_group(kind)?;
        Ok(Self {
            cells: Column::of_steps(&group, "NumberOfCells", 1)?,
            ids: Column::of_steps(&group, "NumberOfConnectivityIds", 1)?,
            offsets: Column::create(&group, "Offsets", 1)?,
            connectivity: Column::create(&group, "Connectivity", 1)?,
        })
    }

    /// Appends the cells of a frame, each of `corners` points.
    fn append(&mut self, connectivity: &[i64], corners: usize) -> hdf5::Result<()> {
        let cells = connectivity.len() / corners;
        let offsets: Vec<i64> = (0..=cells).map(|k| (k * corners) as i64).collect();
        self.cells.append(&[cells as i64])?;
        self.ids.append(&[connectivity.len() as i64])?;
        self.offsets.append(&offsets)?;
        self.connectivity.append(connectivity)
    }
}

/// A vector of every point from the state of its grain.
type PointVector = (&'static str, fn(&GrainSample) -> [f64; 3]);

const STATE: [PointVector; 2] = [
    ("velocity", |g| g.velocity),
    ("angular_velocity", |g| g.angular_velocity),
];
const CONSTANTS: [&str; 3] = ["radius", "mass", "body"];

impl VtkWriter {
    /// # Errors
    /// A file that cannot be created.
    pub fn create(path: &Path, run: &ExportedRun) -> Result<Self, Failure> {
        let part = PartFile::create(path)?;
        Self::try_create(part, run).map_err(|e| unwritten(path, &e))
    }

    fn try_create(part: PartFile, run: &ExportedRun) -> hdf5::Result<Self> {
        let file = File::create(part.part())?;
        let root = file.create_group("VTKHDF")?;
        root.new_attr_builder()
            .with_data(&[2i64, 0])
            .create("Version")?;
        let kind = FixedAscii::<8>::from_ascii(b"PolyData").map_err(|e| e.to_string())?;
        root.new_attr::<FixedAscii<8>>()
            .create("Type")?
            .write_scalar(&kind)?;
        let title: hdf5::types::VarLenUnicode = run.title().parse().unwrap_or_default();
        root.new_attr::<hdf5::types::VarLenUnicode>()
            .create("origin")?
            .write_scalar(&title)?;

        let point_group = root.create_group("PointData")?;
        let cell_group = root.create_group("CellData")?;
        let steps = root.create_group("Steps")?;
        let of_points = steps.create_group("PointDataOffsets")?;
        let of_cells = steps.create_group("CellDataOffsets")?;
        let shapes = run.shapes();
        let fields = shapes.iter().map(|shape| (&*shape.name, shape.components));
        let names = (STATE.map(|(name, _)| (name, 3)).into_iter())
            .chain(CONSTANTS.map(|name| (name, 1)))
            .chain(fields);
        let (mut point_data, mut point_offsets) = (Vec::new(), Vec::new());
        for (name, width) in names {
            point_data.push(Column::create(&point_group, name, width)?);
            point_offsets.push(Column::of_steps(&of_points, name, 1)?);
        }
        let ids = Column::create(&point_group, "id", 1)?;
        point_offsets.push(Column::of_steps(&of_points, "id", 1)?);
        let (mut cell_data, mut cell_offsets) = (Vec::new(), Vec::new());
        for quantity in of_contacts(run.file.form()) {
            let name = quantity.column.name;
            let column = Column::create(&cell_group, name, quantity.width(run.file.form()))?;
            cell_offsets.push(Column::of_steps(&of_cells, name, 1)?);
            cell_data.push((quantity, column));
        }
        let places = OF_STEPS.map(|(name, width)| Column::of_steps(&steps, name, width));
        let places = places.into_iter();
        let [vertices, lines, polygons, strips] =
            KINDS.map(|kind| CellColumns::create(&root, kind));
        Ok(Self {
            part,
            points: Column::create(&root, "Points", 3)?,
            point_data,
            ids,
            cells: [vertices?, lines?, polygons?, strips?],
            cell_data,
            steps: StepColumns {
                values: Column::of_steps(&steps, "Values", 1)?,
                number_of_points: Column::of_steps(&root, "NumberOfPoints", 1)?,
                places: places.collect::<Result<_, _>>()?,
                point_data: point_offsets,
                cell_data: cell_offsets,
                group: steps,
            },
            frames: 0,
            file,
        })
    }

    fn append(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> hdf5::Result<()> {
        self.append_step(frame.records.time)?;
        let of_point = self.append_geometry(run, frame)?;
        self.append_point_data(run, frame, &of_point)?;
        let (form, grains) = (run.file.form(), frame.present.len());
        for (quantity, column) in &mut self.cell_data {
            // Of vertices nothing is known.
            let none = std::iter::repeat_n(f64::NAN, grains * quantity.width(form));
            let contacts = frame.records.contacts.iter();
            let values = none.chain(contacts.flat_map(|contact| quantity.values(form, contact)));
            column.append(&values.collect::<Vec<_>>())?;
        }
        Ok(())
    }

    /// Appends the places of the next step in the datasets.
    fn append_step(&mut self, time: f64) -> hdf5::Result<()> {
        let cells_before: i64 = self.cell_data.first().map_or(0, |(_, c)| c.rows as i64);
        let points_before = self.points.rows as i64;
        let kinds = self.cells.each_ref();
        // Offsets have one number more than cells in every step; readers count without it.
        let cells = kinds.map(|kind| kind.offsets.rows as i64 - self.frames);
        let connectivity = kinds.map(|kind| kind.connectivity.rows as i64);
        let places: [&[i64]; OF_STEPS.len()] = [
            &[self.frames],
            &[1],
            &[points_before],
            &cells,
            &connectivity,
        ];
        let steps = &mut self.steps;
        steps.values.append(&[time])?;
        for (column, place) in steps.places.iter_mut().zip(places) {
            column.append(place)?;
        }
        for column in &mut steps.point_data {
            column.append(&[points_before])?;
        }
        for column in &mut steps.cell_data {
            column.append(&[cells_before])?;
        }
        self.frames += 1;
        Ok(())
    }

    /// Appends points and cells. Returns the grain of every point: the grains, then images at the
    /// ends of contacts.
    fn append_geometry(
        &mut self,
        run: &ExportedRun,
        frame: &ExportedFrame,
    ) -> hdf5::Result<Vec<usize>> {
        let (grains, contacts) = (&frame.records.grains, &frame.records.contacts);
        let mut of_point = frame.present.clone();
        let mut points: Vec<f64> = of_point.iter().flat_map(|&g| grains[g].position).collect();
        let mut point_of = vec![0; grains.len()];
        for (point, &g) in of_point.iter().enumerate() {
            point_of[g] = point;
        }
        let mut lines = Vec::with_capacity(2 * contacts.len());
        for contact in contacts {
            let (image, moved) = run.nearest_image(frame, contact.i, contact.j);
            let end = if moved {
                of_point.push(contact.j as usize);
                points.extend(image);
                of_point.len() - 1
            } else {
                point_of[contact.j as usize]
            };
            lines.extend([point_of[contact.i as usize] as i64, end as i64]);
        }
        let count = of_point.len() as i64;
        self.steps.number_of_points.append(&[count])?;
        self.points.append(&points)?;
        let vertices: Vec<i64> = (0..frame.present.len() as i64).collect();
        let [of_vertices, of_lines, polygons, strips] = &mut self.cells;
        of_vertices.append(&vertices, 1)?;
        of_lines.append(&lines, 2)?;
        polygons.append(&[], 1)?;
        strips.append(&[], 1)?;
        Ok(of_point)
    }

    fn append_point_data(
        &mut self,
        run: &ExportedRun,
        frame: &ExportedFrame,
        of_point: &[usize],
    ) -> hdf5::Result<()> {
        let (grains, constants) = (&frame.records.grains, run.file.grains());
        let mut columns = self.point_data.iter_mut();
        for ((_, value), column) in STATE.iter().zip(columns.by_ref()) {
            let values: Vec<f64> = of_point.iter().flat_map(|&g| value(&grains[g])).collect();
            column.append(&values)?;
        }
        let body: Vec<f64> = constants.body.iter().map(|&body| body.into()).collect();
        let of_grains = [&constants.radius, &constants.mass, &body];
        for (values, column) in of_grains.into_iter().chain(&frame.fields).zip(columns) {
            let width = column.width;
            let of_grain = |&g: &usize| values[g * width..][..width].iter().copied();
            let values: Vec<f64> = of_point.iter().flat_map(of_grain).collect();
            column.append(&values)?;
        }
        let ids: Vec<i64> = of_point.iter().map(|&g| run.file.ids()[g].into()).collect();
        self.ids.append(&ids)
    }

    fn close(self) -> (PartFile, hdf5::Result<()>) {
        let Self {
            part,
            file,
            steps,
            frames,
            ..
        } = self;
        let close = || {
            let count = steps.group.new_attr::<i64>().create("NSteps")?;
            count.write_scalar(&frames)?;
            drop(steps);
            // What cannot be written is noticed here; to close it says nothing.
            file.flush()?;
            file.close()
        };
        (part, close())
    }
}

impl FrameWriter for VtkWriter {
    fn frame(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> Result<(), Failure> {
        let appended = self.append(run, frame);
        self.part.checked(appended)
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, Failure> {
        let (part, closed) = self.close();
        part.checked(closed)?;
        Ok(vec![part.finish()?])
    }
}
