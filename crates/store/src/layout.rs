//! Layout of `run.h5`: creates its datasets, or opens them to continue.

use super::h5::{Attribute, Column, H5File, Slab};
use gshear_dem::failure::Failure;
use hdf5::H5Type;

pub const PARAMETERS: &str = "parameters";
pub const PARTICLES: &str = "particles/trajectory";
pub const BOX: &str = "particles/trajectory/box";
const CONTACTS: &str = "connectivity/contacts";

/// Names of the grain datasets in `axes` dimensions, and the numbers per grain in each.
pub fn elements(axes: usize) -> [(&'static str, usize); 3] {
    let spins = if axes == 2 { 1 } else { 3 };
    [
        ("position", 3),
        ("velocity", 3),
        ("angular_velocity", spins),
    ]
}

/// Names of the contact datasets of type f64 in `axes` dimensions, and the numbers per contact in
/// each.
pub fn forces(axes: usize) -> &'static [(&'static str, usize)] {
    match axes {
        2 => &[
            ("normal_force", 1),
            ("tangential_force", 1),
            ("tangential_history", 1),
            ("rolling_history", 1),
            ("overlap", 1),
        ],
        _ => &[
            ("normal_force", 1),
            ("tangential_force", 3),
            ("tangential_history", 3),
            ("overlap", 1),
        ],
    }
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

/// The growing datasets of the file.
pub struct Columns {
    /// Number of dimensions.
    pub axes: usize,
    pub step: Column<u64>,
    pub time: Column<f64>,
    /// One dataset per entry of [`elements`].
    pub values: Vec<Column<f64>>,
    pub offset: Column<u64>,
    pub i: Column<u32>,
    pub j: Column<u32>,
    /// One dataset per entry of [`forces`].
    pub forces: Vec<Column<f64>>,
    pub sliding: Column<u8>,
    pub row_step: Column<u64>,
    pub row_time: Column<f64>,
    /// Columns of the time series, in their order.
    pub observables: Vec<Column<f64>>,
}

impl Columns {
    /// Creates or opens the datasets. `series`: columns of the time series. Collective.
    pub fn new(
        file: &H5File,
        mode: Mode,
        grains: usize,
        axes: usize,
        series: &[&str],
    ) -> Result<Self, Failure> {
        let clock = |folder: &str| -> Result<(Column<u64>, Column<f64>), Failure> {
            let step = growing(file, mode, &format!("{folder}/step"), CHUNK_ROWS)?;
            Ok((
                step,
                growing(file, mode, &format!("{folder}/time"), CHUNK_ROWS)?,
            ))
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
        for (n, &(_, width)) in elements.iter().enumerate() {
            group(&element(n))?;
            let name = format!("{}/value", element(n));
            values.push(of_grains(file, mode, &name, grains, width)?);
        }
        let (step, time) = clock(&element(0))?;
        link_clock(&element(0), &element(1))?;
        link_clock(&element(0), &element(2))?;

        group(CONTACTS)?;
        link_clock(&element(0), CONTACTS)?;
        let rows = (grains * 32)
            .next_power_of_two()
            .clamp(CHUNK_ROWS, CHUNK_BYTES / 8);
        let contact = |name: &str| format!("{CONTACTS}/{name}");
        let mut columns = Vec::new();
        for &(name, width) in forces(axes) {
            columns.push(growing_wide(file, mode, &contact(name), rows, width)?);
        }

        let observable = |n: usize| format!("observables/{}", series[n]);
        let mut observables = Vec::new();
        for n in 0..series.len() {
            group(&observable(n))?;
            observables.push(growing(
                file,
                mode,
                &format!("{}/value", observable(n)),
                CHUNK_ROWS,
            )?);
        }
        let (row_step, row_time) = clock(&observable(0))?;
        for n in 1..series.len() {
            link_clock(&observable(0), &observable(n))?;
        }

        Ok(Columns {
            axes,
            step,
            time,
            values,
            offset: growing(file, mode, &contact("offset"), CHUNK_ROWS)?,
            i: growing(file, mode, &contact("i"), rows)?,
            j: growing(file, mode, &contact("j"), rows)?,
            forces: columns,
            sliding: growing(file, mode, &contact("sliding"), rows)?,
            row_step,
            row_time,
            observables,
        })
    }
}

/// A growing dataset with one number per entry, empty if new.
fn growing<T: H5Type + Copy>(
    file: &H5File,
    mode: Mode,
    name: &str,
    chunk: usize,
) -> Result<Column<T>, Failure> {
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
) -> Result<Column<f64>, Failure> {
    match (mode, width) {
        (Mode::Create, 2..) => {
            file.dataset(name, &[0, width], Some(&[chunk.div_ceil(width), width]))
        }
        _ => growing(file, mode, name, chunk),
    }
}

/// A growing dataset `[T][N][width]`, or `[T][N]` if `width` is 1.
fn of_grains(
    file: &H5File,
    mode: Mode,
    name: &str,
    grains: usize,
    width: usize,
) -> Result<Column<f64>, Failure> {
    if mode == Mode::Open {
        return file.open_dataset(name);
    }
    let frame = 8 * width * grains;
    // A power of two, so that a batch of frames fills whole chunks.
    let frames = 1 << (CHUNK_BYTES / frame).clamp(1, CHUNK_FRAMES).ilog2();
    let block = grains.min(CHUNK_BYTES / (8 * width));
    match width {
        1 => file.dataset(name, &[0, grains], Some(&[frames, block])),
        _ => file.dataset(name, &[0, grains, width], Some(&[frames, block, width])),
    }
}

/// Appends data that are the same on every rank after the first `before` rows; rank 0 writes them.
pub fn by_root<T: H5Type + Copy>(
    root: bool,
    column: &mut Column<T>,
    before: u64,
    data: &[T],
) -> Result<(), Failure> {
    let after = before + data.len() as u64;
    let mine = if root { data } else { &[] };
    column.append(after, Slab::rows(before, mine.len() as u64, 1), mine)
}

/// Writes the groups and attributes that H5MD 1.1 requires. `walls`: the box is bounded along its
/// last axis. Collective.
pub fn describe(file: &H5File, axes: usize, walls: bool) -> Result<(), Failure> {
    let name = env!("CARGO_PKG_NAME");
    for group in ["h5md", "h5md/author", "h5md/creator", BOX, PARAMETERS] {
        file.group(group)?;
    }
    file.attribute("h5md", "version", &Attribute::Integers(vec![1, 1]))?;
    file.attribute("h5md/author", "name", &name.into())?;
    file.attribute("h5md/creator", "name", &name.into())?;
    file.attribute("h5md/creator", "version", &env!("CARGO_PKG_VERSION").into())?;
    file.attribute(BOX, "dimension", &Attribute::Count(3))?;
    let last = if walls { "none" } else { "periodic" };
    let boundary = match axes {
        2 => ["periodic", last, "none"],
        _ => ["periodic", "periodic", last],
    };
    let boundary = boundary.map(String::from);
    file.attribute(BOX, "boundary", &Attribute::Texts(boundary.into()))
}
