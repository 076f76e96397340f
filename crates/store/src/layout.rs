//! Layout of `run.h5`: creates its datasets, or opens them to continue.

use super::checksums::{FRAMES, GROUP, ROWS};
use super::h5::{Attribute, Dataset, H5File, Slab};
use gshear_dem::columns::Column;
use gshear_dem::failure::Failure;
use hdf5::H5Type;

pub const PARAMETERS: &str = "parameters";
pub const PARTICLES: &str = "particles/trajectory";
pub const BOX: &str = "particles/trajectory/box";
pub const OBSERVABLES: &str = "observables";
const CONTACTS: &str = "connectivity/contacts";
/// Images of the grains at the frames.
/// Flags of rolling at its limit.
pub const ROLLING: &str = "connectivity/contacts/rolling";
pub const IMAGE_VALUE: &str = "particles/trajectory/image/value";
/// The edges of the box at the frames.
pub const EDGES_VALUE: &str = "particles/trajectory/box/edges/value";

/// Constant quantities of a grain; `id`, `species` and `body` have no units.
pub const RADIUS: Column = Column::new("radius", "m", "R");
/// See [`RADIUS`].
pub const MASS: Column = Column::new("mass", "kg", "m");
const POSITION: Column = Column::new("position", "m", "wrapped into the box");
const VELOCITY: Column = Column::new("velocity", "m s-1", "at the full step");
const SPIN: Column = Column::new("angular_velocity", "rad s-1", "about z; spheres: all axes");
const EDGES: Column = Column::new("edges", "m", "edges of the box");
const TIME: Column = Column::new("time", "s", "time");

/// The grain datasets in `axes` dimensions, and the numbers per grain in each.
pub fn elements(axes: usize) -> [(Column, usize); 3] {
    let spins = if axes == 2 { 1 } else { 3 };
    [(POSITION, 3), (VELOCITY, 3), (SPIN, spins)]
}

const NORMAL_FORCE: Column = Column::new("normal_force", "N", "F_n");
const TANGENTIAL_FORCE: Column = Column::new("tangential_force", "N", "F_t");
/// The unit is that of the law's history.
const TANGENTIAL_HISTORY: Column = Column::new("tangential_history", "N", "history of F_t");
const ROLLING_HISTORY: Column = Column::new("rolling_history", "N m", "M^k");
const OVERLAP: Column = Column::new("overlap", "m", "δ");

/// The contact datasets of type f64 in `axes` dimensions, and the numbers per contact in each.
pub fn forces(axes: usize) -> &'static [(Column, usize)] {
    match axes {
        2 => &[
            (NORMAL_FORCE, 1),
            (TANGENTIAL_FORCE, 1),
            (TANGENTIAL_HISTORY, 1),
            (ROLLING_HISTORY, 1),
            (OVERLAP, 1),
        ],
        _ => &[
            (NORMAL_FORCE, 1),
            (TANGENTIAL_FORCE, 3),
            (TANGENTIAL_HISTORY, 3),
            (OVERLAP, 1),
        ],
    }
}

/// Names of the datasets of a frame in `axes` dimensions, in the order of the checksums. `clock`
/// are its step and time, `pairs` the ids of the contacts.
pub fn frame_columns(axes: usize) -> Vec<&'static str> {
    let grains = elements(axes).map(|(column, _)| column.name);
    let contacts = forces(axes).iter().map(|(column, _)| column.name);
    ["clock"]
        .into_iter()
        .chain(grains)
        .chain(["pairs"])
        .chain(contacts)
        .chain(["sliding", "image"])
        .chain((axes == 2).then_some("rolling"))
        .collect()
}

/// Entries in a chunk of a dataset of contacts.
fn contact_chunk(grains: usize) -> usize {
    (grains * 32)
        .next_power_of_two()
        .clamp(CHUNK_ROWS, CHUNK_BYTES / 8)
}

/// Frames and grains in a chunk of a dataset with `width` numbers per grain.
fn grain_chunk(grains: usize, width: usize) -> [usize; 2] {
    let frame = 8 * width * grains;
    // A power of two, so that a batch of frames fills whole chunks.
    let frames = 1 << (CHUNK_BYTES / frame).clamp(1, CHUNK_FRAMES).ilog2();
    [frames, grains.min(CHUNK_BYTES / (8 * width))]
}

/// Bytes of objects and attributes of a file, about.
const METADATA_BYTES: f64 = 100e3;

/// Bytes of a file with so many frames, contacts in a frame, rows and columns of the time series:
/// whole chunks of every dataset.
pub fn file_bytes(
    (axes, grains): (usize, usize),
    (frames, contacts): (u64, f64),
    (rows, columns): (u64, usize),
) -> f64 {
    let chunks = |entries: f64, chunk: usize| (entries / chunk as f64).ceil() * chunk as f64;
    let of_grains = |width: usize, bytes: usize| {
        let [in_chunk, block] = grain_chunk(grains, width);
        let blocks = chunks(grains as f64, block);
        chunks(frames as f64, in_chunk) * blocks * (width * bytes) as f64
    };
    let numbers = elements(axes)
        .iter()
        .map(|(_, width)| of_grains(*width, 8))
        .sum::<f64>();
    let all = chunks(frames as f64 * contacts, contact_chunk(grains));
    let [_, contact] = frame_bytes(axes);
    // Radius, mass, id, body.
    let constant = 21.0 * grains as f64;
    let series = chunks(rows as f64, CHUNK_ROWS) * 8.0 * (columns + 3) as f64;
    METADATA_BYTES + constant + numbers + of_grains(3, 4) + all * contact as f64 + series
}

/// Bytes of a grain and of a contact in a frame.
pub fn frame_bytes(axes: usize) -> [usize; 2] {
    let numbers = |of: &[(Column, usize)]| of.iter().map(|(_, width)| 8 * width).sum::<usize>();
    let image = 3 * size_of::<i32>();
    let (pair, flags) = (2 * size_of::<u32>(), if axes == 2 { 2 } else { 1 });
    [
        numbers(&elements(axes)) + image,
        numbers(forces(axes)) + pair + flags,
    ]
}

/// Most frames in a chunk.
pub const CHUNK_FRAMES: usize = 64;
/// Bytes in a chunk of frames: large enough to write fast, small enough to read one frame.
const CHUNK_BYTES: usize = 512 << 10;
/// Entries in a chunk of a dataset with one number per frame or row.
pub const CHUNK_ROWS: usize = 1024;

/// Whether to create the objects or to open existing ones.
#[derive(Clone, Copy, PartialEq)]
pub enum Mode {
    Create,
    Open,
}

/// The growing checksums of a file.
pub struct Checksums {
    pub frames: Dataset<u64>,
    pub rows: Dataset<u64>,
}

impl Checksums {
    /// Creates or opens them. Collective.
    pub fn new(file: &H5File, mode: Mode, axes: usize) -> Result<Self, Failure> {
        let width = frame_columns(axes).len();
        if mode == Mode::Open {
            return Ok(Self {
                frames: file.open_dataset(FRAMES)?,
                rows: file.open_dataset(ROWS)?,
            });
        }
        file.group(GROUP)?;
        Ok(Self {
            frames: file.dataset(FRAMES, &[0, width], Some(&[CHUNK_ROWS / 8, width]))?,
            rows: file.dataset(ROWS, &[0], Some(&[CHUNK_ROWS]))?,
        })
    }
}

/// What the datasets of a file depend on.
#[derive(Clone, Copy)]
pub struct Layout<'a> {
    /// Number of grains.
    pub grains: usize,
    /// Dimensions.
    pub axes: usize,
    /// Whether the box is bounded along its last axis, and so its edges are at right angles.
    pub walls: bool,
    /// The columns of the time series.
    pub series: &'a [Column],
    /// Whether the quantities are in SI units, and new datasets say which.
    pub units: bool,
    /// Unit of the tangential history in 3D.
    pub history_unit: &'static str,
}

/// The growing datasets of the file.
pub struct Datasets {
    /// Dimensions.
    pub axes: usize,
    /// `[T][3]` or `[T][3][3]`.
    pub edges: Dataset<f64>,
    pub step: Dataset<u64>,
    pub time: Dataset<f64>,
    /// Of [`elements`].
    pub values: Vec<Dataset<f64>>,
    /// `[T][N][3]`.
    pub image: Dataset<i32>,
    pub offset: Dataset<u64>,
    pub i: Dataset<u32>,
    pub j: Dataset<u32>,
    /// Of [`forces`].
    pub forces: Vec<Dataset<f64>>,
    pub sliding: Dataset<u8>,
    /// Of disks.
    pub rolling: Option<Dataset<u8>>,
    pub row_step: Dataset<u64>,
    pub row_time: Dataset<f64>,
    /// Of the time series, in the order of its columns.
    pub observables: Vec<Dataset<f64>>,
    /// Their names.
    pub names: Vec<&'static str>,
    pub checksums: Checksums,
}

impl Datasets {
    /// Creates or opens the datasets. Collective.
    pub fn new(file: &H5File, mode: Mode, layout: &Layout<'_>) -> Result<Self, Failure> {
        let Layout {
            grains,
            axes,
            series,
            ..
        } = *layout;
        let units = layout.units && mode == Mode::Create;
        let in_units = |dataset: Dataset<f64>, column: &Column| {
            if units {
                set_unit(&dataset, column, axes)?;
            }
            Ok::<_, Failure>(dataset)
        };
        let clock = |folder: &str| -> Result<(Dataset<u64>, Dataset<f64>), Failure> {
            let step = growing(file, mode, &format!("{folder}/step"), CHUNK_ROWS)?;
            let time = growing(file, mode, &format!("{folder}/time"), CHUNK_ROWS)?;
            Ok((step, in_units(time, &TIME)?))
        };
        let link_clock = |from: &str, to: &str| -> Result<(), Failure> {
            if mode == Mode::Create {
                for part in ["step", "time"] {
                    file.link(&format!("/{from}/{part}"), &format!("/{to}/{part}"))?;
                }
            }
            Ok(())
        };
        let group = |name: &str| {
            if mode == Mode::Create {
                file.group(name)
            } else {
                Ok(())
            }
        };

        let elements = elements(axes);
        let element = |n: usize| format!("{PARTICLES}/{}", elements[n].0);
        let mut values = Vec::new();
        for (n, (column, width)) in elements.iter().enumerate() {
            group(&element(n))?;
            let name = format!("{}/value", element(n));
            let dataset = of_grains(file, mode, &name, grains, *width)?;
            values.push(in_units(dataset, column)?);
        }
        let (step, time) = clock(&element(0))?;
        link_clock(&element(0), &element(1))?;
        link_clock(&element(0), &element(2))?;
        let path = format!("{PARTICLES}/image");
        group(&path)?;
        link_clock(&element(0), &path)?;
        let image = of_grains(file, mode, IMAGE_VALUE, grains, 3)?;
        let edges = match mode {
            Mode::Open => file.open_dataset(EDGES_VALUE)?,
            Mode::Create => {
                let path = format!("{BOX}/edges");
                file.group(&path)?;
                link_clock(&element(0), &path)?;
                let (shape, chunk): (&[usize], &[usize]) = if layout.walls {
                    (&[0, 3], &[CHUNK_ROWS / 8, 3])
                } else {
                    (&[0, 3, 3], &[CHUNK_ROWS / 16, 3, 3])
                };
                let dataset = file.dataset(EDGES_VALUE, shape, Some(chunk))?;
                in_units(dataset, &EDGES)?
            }
        };

        group(CONTACTS)?;
        link_clock(&element(0), CONTACTS)?;
        let rows = contact_chunk(grains);
        let contact = |name: &str| format!("{CONTACTS}/{name}");
        let mut columns = Vec::new();
        for (column, width) in forces(axes) {
            let dataset = growing_wide(file, mode, &contact(column.name), rows, *width)?;
            let mut column = *column;
            if column.name == TANGENTIAL_HISTORY.name {
                column.unit = layout.history_unit;
            }
            columns.push(in_units(dataset, &column)?);
        }
        if mode == Mode::Create {
            let grains = Attribute::Reference(format!("/{PARTICLES}"));
            file.attribute(CONTACTS, "particles_group", &grains)?;
        }

        let names: Vec<String> = (series.iter())
            .map(|column| format!("{OBSERVABLES}/{column}"))
            .collect();
        let mut observables = Vec::new();
        for (name, column) in names.iter().zip(series) {
            group(name)?;
            let dataset = growing(file, mode, &format!("{name}/value"), CHUNK_ROWS)?;
            observables.push(in_units(dataset, column)?);
        }
        let (row_step, row_time) = clock(&names[0])?;
        for name in &names[1..] {
            link_clock(&names[0], name)?;
        }

        Ok(Datasets {
            axes,
            edges,
            image,
            step,
            time,
            values,
            offset: growing(file, mode, &contact("offset"), CHUNK_ROWS)?,
            i: growing(file, mode, &contact("i"), rows)?,
            j: growing(file, mode, &contact("j"), rows)?,
            forces: columns,
            sliding: growing(file, mode, &contact("sliding"), rows)?,
            rolling: match axes {
                2 => Some(growing(file, mode, ROLLING, rows)?),
                _ => None,
            },
            row_step,
            row_time,
            observables,
            names: series.iter().map(|column| column.name).collect(),
            checksums: Checksums::new(file, mode, axes)?,
        })
    }
}

/// Writes the unit of a column as H5MD's units module has it; pure numbers have none. Collective.
pub fn set_unit(dataset: &Dataset<f64>, column: &Column, axes: usize) -> Result<(), Failure> {
    match column.unit_in(axes) {
        Some(unit) => dataset.attribute("unit", &Attribute::Word(unit)),
        None => Ok(()),
    }
}

/// A dataset of one number an entry, without entries yet.
fn growing<T: H5Type + Copy>(
    file: &H5File,
    mode: Mode,
    name: &str,
    chunk: usize,
) -> Result<Dataset<T>, Failure> {
    match mode {
        Mode::Create => file.dataset(name, &[0], Some(&[chunk])),
        Mode::Open => file.open_dataset(name),
    }
}

/// A growing dataset with `width` numbers per entry.
fn growing_wide(
    file: &H5File,
    mode: Mode,
    name: &str,
    chunk: usize,
    width: usize,
) -> Result<Dataset<f64>, Failure> {
    match (mode, width) {
        (Mode::Create, 2..) => {
            file.dataset(name, &[0, width], Some(&[chunk.div_ceil(width), width]))
        }
        _ => growing(file, mode, name, chunk),
    }
}

/// A growing dataset `[T][N][width]`, or `[T][N]` if `width` is 1.
fn of_grains<T: H5Type + Copy>(
    file: &H5File,
    mode: Mode,
    name: &str,
    grains: usize,
    width: usize,
) -> Result<Dataset<T>, Failure> {
    if mode == Mode::Open {
        return file.open_dataset(name);
    }
    let [frames, block] = grain_chunk(grains, width);
    match width {
        1 => file.dataset(name, &[0, grains], Some(&[frames, block])),
        _ => file.dataset(name, &[0, grains, width], Some(&[frames, block, width])),
    }
}

/// Appends data that are the same on every rank after the first `before` rows; rank 0 writes them.
pub fn by_root<T: H5Type + Copy>(
    root: bool,
    column: &mut Dataset<T>,
    before: u64,
    data: &[T],
) -> Result<(), Failure> {
    let after = before + data.len() as u64;
    let local = if root { data } else { &[] };
    column.append(after, Slab::rows(before, local.len() as u64, 1), local)
}

/// Writes the groups and attributes that H5MD 1.1 requires. Collective.
pub fn describe(file: &H5File, layout: &Layout<'_>, author: &str) -> Result<(), Failure> {
    for group in ["h5md", "h5md/author", "h5md/creator", BOX, PARAMETERS] {
        file.group(group)?;
    }
    let word = |word: &str| Attribute::Word(word.into());
    file.attribute("h5md", "version", &Attribute::Integers(vec![1, 1]))?;
    file.attribute("h5md/author", "name", &Attribute::Name(author.into()))?;
    file.attribute("h5md/creator", "name", &word("gshear-mpi"))?;
    file.attribute("h5md/creator", "version", &word(env!("CARGO_PKG_VERSION")))?;
    if layout.units {
        const UNITS: &str = "h5md/modules/units";
        file.group(UNITS)?;
        file.attribute(UNITS, "version", &Attribute::Integers(vec![1, 0]))?;
        file.attribute(UNITS, "system", &word("SI"))?;
    }
    file.attribute(BOX, "dimension", &Attribute::Count(3))?;
    let last = if layout.walls { "none" } else { "periodic" };
    let boundary = match layout.axes {
        2 => ["periodic", last, "none"],
        _ => ["periodic", "periodic", last],
    };
    let boundary = boundary.map(String::from);
    file.attribute(BOX, "boundary", &Attribute::Words(boundary.into()))
}
