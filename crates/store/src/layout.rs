//! Layout of `run.h5`: creates its datasets, or opens them to continue.

use super::checksums::{self, FRAMES, GROUP, ROWS};
use super::collective::CollectiveOutcome;
pub use super::contact_quantities::{ContactTable, FrameFormat, Kind};
use super::contact_quantities::{TANGENTIAL_HISTORY, flags, numbers, of_contacts};
use super::h5::{Attribute, Dataset, H5File};
use super::row_table::RowTable;
use super::run_header::RunHeader;
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_dem::columns::Column;
use gshear_dem::failure::Result;
use hdf5::H5Type;
use hdf5::types::TypeDescriptor;

pub(crate) const PARAMETERS: &str = "parameters";
pub(crate) const PARTICLES: &str = "particles/trajectory";
pub(crate) const BOX: &str = "particles/trajectory/box";
pub(crate) const OBSERVABLES: &str = "observables";
/// Group of the scalars of frames.
pub(crate) const SCALARS: &str = "observables/gshear";
/// The edges of the box at the frames.
pub(crate) const EDGES_VALUE: &str = "particles/trajectory/box/edges/value";

/// Constant quantities of a grain; `id`, `species` and `body` have no units.
pub(crate) const RADIUS: Column = Column::new("radius", "m", "R");
/// See [`RADIUS`].
pub(crate) const MASS: Column = Column::new("mass", "kg", "m");
const POSITION: Column = Column::new("position", "m", "wrapped into the box");
const VELOCITY: Column = Column::new("velocity", "m s-1", "at the full step");
const SPIN: Column = Column::new("angular_velocity", "rad s-1", "about z; spheres: all axes");
const EDGES: Column = Column::new("edges", "m", "edges of the box");
const TIME: Column = Column::new("time", "s", "time");

/// A growing dataset of the grains or of the contacts. Writer and reader go by these.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Quantity {
    /// Name, unit and meaning.
    pub column: Column,
    /// Number of values of a grain or contact.
    pub width: usize,
    /// What the values are.
    pub kind: Kind,
}

impl Quantity {
    const fn new(column: Column, width: usize, kind: Kind) -> Self {
        Self {
            column,
            width,
            kind,
        }
    }

    /// Bytes of a grain or contact.
    fn bytes(&self) -> usize {
        self.width * self.kind.element().size()
    }
}

/// The numbers of a grain in `axes` dimensions.
pub(crate) fn elements(axes: usize) -> [Quantity; 3] {
    let spins = if axes == 2 { 1 } else { 3 };
    [
        Quantity::new(POSITION, 3, Kind::Number),
        Quantity::new(VELOCITY, 3, Kind::Number),
        Quantity::new(SPIN, spins, Kind::Number),
    ]
}

pub(crate) const IMAGE: Quantity =
    Quantity::new(Column::new("image", "1", "image"), 3, Kind::Image);
/// Scenes that remove grains have it.
pub(crate) const REMOVED: Quantity =
    Quantity::new(Column::new("removed", "1", "passed a wall"), 1, Kind::Flag);

/// The quantities of a grain.
pub(crate) fn of_grain(form: FrameFormat) -> Vec<Quantity> {
    let mut quantities = elements(form.axes).to_vec();
    quantities.push(IMAGE);
    if form.removed {
        quantities.push(REMOVED);
    }
    quantities
}

/// The dataset of a quantity of the grains.
pub(crate) fn grain_dataset(column: &Column) -> String {
    format!("{PARTICLES}/{column}/value")
}

/// The quantities of a contact.
pub(crate) fn of_contact(table: ContactTable, form: FrameFormat) -> Vec<Quantity> {
    let kind = match table {
        ContactTable::Grains => Kind::Id,
        ContactTable::Walls => Kind::Flag,
    };
    let ids = [
        Quantity::new(Column::new("i", "1", "lower id"), 1, Kind::Id),
        Quantity::new(table.second(), 1, kind),
    ];
    let others = of_contacts(form)
        .map(|quantity| Quantity::new(quantity.column, quantity.width(form), quantity.kind));
    ids.into_iter().chain(others).collect()
}

/// The dataset of a quantity of the contacts between grains.
pub(crate) fn contact_dataset(column: impl std::fmt::Display) -> String {
    ContactTable::Grains.dataset(column)
}

/// Names of the datasets of a frame, in the order of the checksums. `clock` are its step and time,
/// `pairs` the ids of the contacts.
pub(crate) fn frame_columns(form: FrameFormat) -> Vec<String> {
    let grains = elements(form.axes).map(|quantity| quantity.column.name);
    let contacts = numbers(form).map(|quantity| quantity.column.name);
    let mut flags = flags(form).map(|quantity| quantity.column.name);
    let first_flag = flags.next();
    ["clock"]
        .into_iter()
        .chain(grains)
        .chain(["pairs"])
        .chain(contacts)
        .chain(first_flag)
        .chain(["image"])
        .chain(flags)
        .chain(form.removed.then_some(REMOVED.column.name))
        .map(String::from)
        .chain(wall_columns(form))
        .collect()
}

/// Those of the contacts with flat walls.
fn wall_columns(form: FrameFormat) -> Vec<String> {
    if !form.walls {
        return Vec::new();
    }
    let quantities = numbers(form).chain(flags(form));
    let names = quantities.map(|quantity| quantity.column.name);
    let names = ["pairs"].into_iter().chain(names);
    names
        .map(|name| checksum_name(ContactTable::Walls, name))
        .collect()
}

/// The name of the checksum of a quantity of contacts.
pub(crate) fn checksum_name(table: ContactTable, name: &str) -> String {
    match table {
        ContactTable::Grains => name.into(),
        ContactTable::Walls => format!("wall {name}"),
    }
}

/// Entries in a chunk of a dataset of contacts.
fn contact_chunk(table: ContactTable, grains: usize) -> usize {
    let entries = match table {
        ContactTable::Grains => grains * 32,
        ContactTable::Walls => grains,
    };
    (entries.next_power_of_two()).clamp(CHUNK_ROWS, CHUNK_BYTES / 8)
}

/// Frames and grains in a chunk of a dataset with `width` numbers per grain.
fn grain_chunk(grains: usize, width: usize) -> [usize; 2] {
    let frame = 8 * width * grains;
    // A power of two, so that a batch of frames fills whole chunks.
    let frames = 1 << (CHUNK_BYTES / frame).clamp(1, CHUNK_FRAMES).ilog2();
    [frames, grains.min(CHUNK_BYTES / (8 * width))]
}

/// Bytes of a value of a compressed file, about (docs/validation/speed.md, "Size and speed of
/// files").
fn compressed_bytes(kind: Kind) -> f64 {
    match kind {
        Kind::Number => 6.8,
        Kind::Image => 0.05,
        Kind::Id => 0.2,
        Kind::Flag => 0.1,
    }
}

/// Bytes of radius, mass, id and body of a grain.
const CONSTANTS_BYTES: f64 = 21.0;
/// Bytes of objects and attributes of a file, about.
const METADATA_BYTES: f64 = 100e3;

/// How much a file holds.
#[derive(Debug, Clone, Copy)]
pub struct FileContent {
    /// What its contacts are.
    pub form: FrameFormat,
    /// Grains.
    pub grains: usize,
    /// Frames.
    pub frames: u64,
    /// Contacts in a frame.
    pub contacts: f64,
    /// Rows of the time series.
    pub rows: u64,
    /// Its columns.
    pub columns: usize,
}

impl FileContent {
    /// Bytes of the file when it is compressed.
    pub fn compressed_bytes(&self) -> f64 {
        let mut of_frame = 0.0;
        for quantity in of_grain(self.form) {
            // z of disks takes nothing.
            let values = quantity.width.min(self.form.axes);
            of_frame += (self.grains * values) as f64 * compressed_bytes(quantity.kind);
        }
        for quantity in of_contact(ContactTable::Grains, self.form) {
            let values = self.contacts * quantity.width as f64;
            of_frame += values * compressed_bytes(quantity.kind);
        }
        let row = compressed_bytes(Kind::Number) * (self.columns + 3) as f64;
        METADATA_BYTES
            + CONSTANTS_BYTES * self.grains as f64
            + self.frames as f64 * of_frame
            + self.rows as f64 * row
    }

    /// Bytes of the file while the run writes: whole chunks of every dataset.
    pub fn bytes(&self) -> f64 {
        let frames = self.frames as f64;
        let mut numbers = 0.0;
        for quantity in of_grain(self.form) {
            let [in_chunk, block] = grain_chunk(self.grains, quantity.width);
            let entries = whole_chunks(frames, in_chunk) * whole_chunks(self.grains as f64, block);
            numbers += entries * quantity.bytes() as f64;
        }
        let chunk = contact_chunk(ContactTable::Grains, self.grains);
        let contacts = whole_chunks(frames * self.contacts, chunk);
        let [_, contact] = frame_bytes(self.form);
        let constant = CONSTANTS_BYTES * self.grains as f64;
        let series = whole_chunks(self.rows as f64, CHUNK_ROWS) * 8.0 * (self.columns + 3) as f64;
        METADATA_BYTES + constant + numbers + contacts * contact as f64 + series
    }
}

/// So many entries, rounded up to whole chunks.
fn whole_chunks(entries: f64, chunk: usize) -> f64 {
    (entries / chunk as f64).ceil() * chunk as f64
}

/// Bytes of a grain and of a contact in a frame.
pub fn frame_bytes(form: FrameFormat) -> [usize; 2] {
    let grain = of_grain(form).iter().map(Quantity::bytes).sum();
    let contact = of_contact(ContactTable::Grains, form);
    let contact = contact.iter().map(Quantity::bytes).sum();
    [grain, contact]
}

/// Most frames in a chunk.
pub(crate) const CHUNK_FRAMES: usize = 64;
/// Bytes in a chunk of frames: large enough to write fast, small enough to read one frame.
const CHUNK_BYTES: usize = 512 << 10;
/// Entries in a chunk of a dataset with one number per frame or row.
pub(crate) const CHUNK_ROWS: usize = 1024;

/// Whether to create the objects or to open existing ones.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum OpenMode {
    Create,
    Open,
}

/// The growing datasets of the file.
pub(crate) struct Datasets {
    /// What the contacts are.
    pub form: FrameFormat,
    /// `[T][3]` or `[T][3][3]`.
    pub edges: Dataset,
    pub step: Dataset,
    pub time: Dataset,
    /// Of [`of_grain`].
    pub grains: Vec<Dataset>,
    /// Of [`ContactTable::of`].
    pub contacts: Vec<ContactDatasets>,
    /// The time series.
    pub rows: RowTable,
    /// Checksums of the frames.
    pub frame_sums: Dataset,
}

/// The datasets of a table of contacts.
pub(crate) struct ContactDatasets {
    /// `[T+1]`.
    pub offset: Dataset,
    /// Of [`of_contact`].
    pub columns: Vec<Dataset>,
}

impl Datasets {
    /// Creates or opens the datasets of so many grains. Collective.
    pub fn new(
        file: &H5File,
        mode: OpenMode,
        count: usize,
        header: &RunHeader<'_>,
    ) -> Result<Self> {
        let form = header.form;
        let units = header.units.then_some(form.axes);
        let place = DatasetPlace { file, mode, units };
        let first = format!("{PARTICLES}/{POSITION}");
        let mut grains = Vec::new();
        for quantity in of_grain(form) {
            let Quantity {
                column,
                width,
                kind,
            } = quantity;
            place.group(&format!("{PARTICLES}/{column}"))?;
            let [frames, block] = grain_chunk(count, width);
            let chunk = [frames, block, width];
            let shape = [0, count, width];
            let dimensions = if width == 1 { 2 } else { 3 };
            let name = grain_dataset(&column);
            let (shape, chunk) = (&shape[..dimensions], &chunk[..dimensions]);
            let dataset = place.growing(kind.element(), &name, shape, chunk)?;
            grains.push(place.in_units(dataset, &column)?);
        }
        let (step, time) = (place.step(&first)?, place.time(&first)?);
        for Quantity { column, .. } in &of_grain(form)[1..] {
            place.link_clock(&first, &format!("{PARTICLES}/{column}"), true)?;
        }
        place.group(&format!("{BOX}/edges"))?;
        place.link_clock(&first, &format!("{BOX}/edges"), true)?;
        let (shape, chunk): (&[usize], &[usize]) = if header.boundary.is_periodic() {
            (&[0, 3, 3], &[CHUNK_ROWS / 16, 3, 3])
        } else {
            (&[0, 3], &[CHUNK_ROWS / 8, 3])
        };
        let edges = place.growing(f64::type_descriptor(), EDGES_VALUE, shape, chunk)?;

        let mut contacts = Vec::new();
        for table in ContactTable::of(form) {
            place.link_contacts(table, &first)?;
            contacts.push(place.contacts(table, header, count)?);
        }

        place.group(GROUP)?;
        let sums = frame_columns(form).len();
        let (shape, chunk) = ([0, sums], [CHUNK_ROWS / 8, sums]);
        Ok(Datasets {
            form,
            edges: place.in_units(edges, &EDGES)?,
            step,
            time,
            grains,
            contacts,
            rows: place.table(OBSERVABLES, header.series, true, ROWS)?,
            frame_sums: place.growing(u64::type_descriptor(), FRAMES, &shape, &chunk)?,
        })
    }

    /// Cuts the file after so many frames, contacts of each table and rows. Collective.
    pub fn cut(
        &mut self,
        frames: u64,
        contacts: &[u64],
        rows: u64,
        outcome: &mut CollectiveOutcome,
    ) {
        let of_frames = [&mut self.step, &mut self.time, &mut self.edges];
        for dataset in of_frames.into_iter().chain(&mut self.grains) {
            outcome.note(dataset.resize(frames));
        }
        for (table, contacts) in self.contacts.iter_mut().zip(contacts) {
            outcome.note(table.offset.resize(frames + 1));
            for dataset in &mut table.columns {
                outcome.note(dataset.resize(*contacts));
            }
        }
        outcome.note(self.frame_sums.resize(frames));
        self.rows.cut(rows, outcome);
    }
}

/// Where datasets are created or opened.
struct DatasetPlace<'a> {
    file: &'a H5File,
    mode: OpenMode,
    /// The dimensions in which units are written; `None`: they are not.
    units: Option<usize>,
}

impl DatasetPlace<'_> {
    fn group(&self, name: &str) -> Result<()> {
        match self.mode {
            OpenMode::Create => self.file.group(name),
            OpenMode::Open => Ok(()),
        }
    }

    /// A dataset without entries yet, which grows along its first dimension.
    fn growing(
        &self,
        element: TypeDescriptor,
        name: &str,
        shape: &[usize],
        chunk: &[usize],
    ) -> Result<Dataset> {
        match self.mode {
            OpenMode::Create => self.file.dataset(element, name, shape, Some(chunk)),
            OpenMode::Open => self.file.open_dataset(element, name),
        }
    }

    /// The group of a table of contacts of the grains.
    fn link_contacts(&self, table: ContactTable, clock: &str) -> Result<()> {
        let group = table.group();
        self.group(group)?;
        self.link_clock(clock, group, true)?;
        if self.mode == OpenMode::Create {
            let grains = Attribute::Reference(format!("/{PARTICLES}"));
            self.file.attribute(group, "particles_group", &grains)?;
        }
        Ok(())
    }

    /// The datasets of a table of contacts of so many grains.
    fn contacts(
        &self,
        table: ContactTable,
        header: &RunHeader<'_>,
        grains: usize,
    ) -> Result<ContactDatasets> {
        let mut columns = Vec::new();
        for quantity in of_contact(table, header.form) {
            let Quantity {
                mut column,
                width,
                kind,
            } = quantity;
            let chunk = [contact_chunk(table, grains).div_ceil(width), width];
            let dimensions = if width == 1 { 1 } else { 2 };
            let (name, shape) = (table.dataset(column), [0, width]);
            let (shape, chunk) = (&shape[..dimensions], &chunk[..dimensions]);
            let dataset = self.growing(kind.element(), &name, shape, chunk)?;
            if column.name == TANGENTIAL_HISTORY.name {
                column.unit = header.history_unit;
            }
            columns.push(self.in_units(dataset, &column)?);
        }
        Ok(ContactDatasets {
            offset: self.list::<u64>(&table.dataset("offset"))?,
            columns,
        })
    }

    /// One number a frame or row.
    fn list<T: H5Type>(&self, name: &str) -> Result<Dataset> {
        self.growing(T::type_descriptor(), name, &[0], &[CHUNK_ROWS])
    }

    fn step(&self, folder: &str) -> Result<Dataset> {
        self.list::<u64>(&format!("{folder}/step"))
    }

    fn time(&self, folder: &str) -> Result<Dataset> {
        let time = self.list::<f64>(&format!("{folder}/time"))?;
        self.in_units(time, &TIME)
    }

    fn link_clock(&self, from: &str, to: &str, has_time: bool) -> Result<()> {
        if self.mode == OpenMode::Open {
            return Ok(());
        }
        let mut parts = ["step", "time"].into_iter().take(1 + usize::from(has_time));
        parts.try_for_each(|part| {
            self.file
                .link(&format!("/{from}/{part}"), &format!("/{to}/{part}"))
        })
    }

    /// A table with a group per column, and its checksums.
    fn table(
        &self,
        folder: &str,
        columns: &[Column],
        has_time: bool,
        sums: &str,
    ) -> Result<RowTable> {
        let first = format!("{folder}/{}", columns[0]);
        let mut values = Vec::new();
        for column in columns {
            let name = format!("{folder}/{column}");
            self.group(&name)?;
            let dataset = self.list::<f64>(&format!("{name}/value"))?;
            values.push(self.in_units(dataset, column)?);
        }
        let step = self.step(&first)?;
        let time = has_time.then(|| self.time(&first)).transpose()?;
        for column in &columns[1..] {
            self.link_clock(&first, &format!("{folder}/{column}"), has_time)?;
        }
        let sums = self.list::<u64>(sums)?;
        Ok(RowTable::new(step, time, values, columns, sums))
    }

    /// Writes the unit of a column as H5MD's units module has it; pure numbers have none.
    fn in_units(&self, dataset: Dataset, column: &Column) -> Result<Dataset> {
        if self.mode == OpenMode::Create
            && let Some(axes) = self.units
            && let Some(unit) = column.unit_in(axes)
        {
            dataset.attribute("unit", &Attribute::Word(unit))?;
        }
        Ok(dataset)
    }
}

/// Opens the scalars of frames to continue after their first `rows` rows; creates them if the file
/// has none. Collective.
pub(crate) fn scalars(file: &H5File, rows: u64) -> Result<RowTable> {
    let mode = if file.has(SCALARS) {
        OpenMode::Open
    } else if rows > 0 {
        return Err(file.lacks(SCALARS, rows));
    } else {
        OpenMode::Create
    };
    // Scalars of frames exist for disks alone.
    let units = Some(2);
    let place = DatasetPlace { file, mode, units };
    let mut table = place.table(SCALARS, &FrameScalars::COLUMNS, false, checksums::SCALARS)?;
    if table.has(rows) {
        Ok(table)
    } else {
        Err(file.lacks(SCALARS, rows))
    }
}

/// Writes the groups and attributes that H5MD 1.1 requires. Collective.
pub(crate) fn describe(file: &H5File, header: &RunHeader<'_>, author: &str) -> Result<()> {
    for group in ["h5md", "h5md/author", "h5md/creator", BOX, PARAMETERS] {
        file.group(group)?;
    }
    let creator = Attribute::Word("gshear-mpi".into());
    let version = Attribute::Word(env!("CARGO_PKG_VERSION").into());
    file.attribute("h5md", "version", &Attribute::Integers(vec![1, 1]))?;
    file.attribute("h5md/author", "name", &Attribute::Name(author.into()))?;
    file.attribute("h5md/creator", "name", &creator)?;
    file.attribute("h5md/creator", "version", &version)?;
    if header.units {
        const UNITS: &str = "h5md/modules/units";
        file.group(UNITS)?;
        file.attribute(UNITS, "version", &Attribute::Integers(vec![1, 0]))?;
        file.attribute(UNITS, "system", &Attribute::Word("SI".into()))?;
    }
    file.attribute(BOX, "dimension", &Attribute::Count(3))?;
    let last = if header.boundary.is_periodic() {
        "periodic"
    } else {
        "none"
    };
    let boundary = match header.form.axes {
        2 => ["periodic", last, "none"],
        _ => ["periodic", "periodic", last],
    };
    let boundary = boundary.map(String::from);
    file.attribute(BOX, "boundary", &Attribute::Words(boundary.into()))
}
