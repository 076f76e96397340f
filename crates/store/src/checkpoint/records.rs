//! Records of a checkpoint and their fields, each of which is a dataset.

use crate::collective::CollectiveOutcome;
use crate::h5::{H5File, Slab};
use bytemuck::Pod;
use gshear_dem::domain::total;
use gshear_dem::failure::Failure;
use gshear_dem::state::{ContactForce, ContactState, Displacement, GrainPosition, GrainState};
use gshear_mpi_exchange::Parallel;
use hdf5::H5Type;
use std::ops::Range;
use xxhash_rust::xxh3::xxh3_64;

/// A field of a record: name, numbers per record, getter and setter.
pub(super) struct Field<R, T> {
    pub name: &'static str,
    width: usize,
    get: fn(&R) -> &[T],
    set: fn(&mut R) -> &mut [T],
}

/// A field that is stored only where it is needed.
pub(super) enum Optional<R> {
    Number(Field<R, f64>),
    Whole(Field<R, u64>),
}

impl<R> Optional<R> {
    /// Its name and its bytes per record.
    fn size(&self) -> (&'static str, usize) {
        match self {
            Self::Number(field) => (field.name, 8 * field.width),
            Self::Whole(field) => (field.name, 8 * field.width),
        }
    }

    fn is_zero(&self, r: &R) -> bool {
        match self {
            Self::Number(field) => (field.get)(r).iter().all(|x| x.to_bits() == 0),
            Self::Whole(field) => (field.get)(r).iter().all(|n| *n == 0),
        }
    }
}

macro_rules! field {
    ($record:ty, $name:ident, number) => {
        Field {
            name: stringify!($name),
            width: 1,
            get: |r: &$record| std::slice::from_ref(&r.$name),
            set: |r: &mut $record| std::slice::from_mut(&mut r.$name),
        }
    };
    ($record:ty, $name:ident, $width:literal) => {
        Field {
            name: stringify!($name),
            width: $width,
            get: |r: &$record| &r.$name[..],
            set: |r: &mut $record| &mut r.$name[..],
        }
    };
}

/// A record of a checkpoint. Its fields are stored as the datasets of one group.
pub(super) trait Record: Pod {
    const GROUP: &'static str;
    /// Name in messages.
    const NAME: &'static str;
    /// Attribute with the checksum of all records.
    const CHECKSUM: &'static str;
    fn integers() -> Vec<Field<Self, u32>>;
    fn numbers() -> Vec<Field<Self, f64>>;
    fn signed() -> Vec<Field<Self, i64>> {
        Vec::new()
    }
    /// What its checksum is of.
    fn hashed(&self) -> &[u8] {
        bytemuck::bytes_of(self)
    }
    /// Fields that are stored where one of them is not 0.
    fn where_not_zero() -> Vec<Optional<Self>> {
        Vec::new()
    }
}

impl Record for GrainState {
    const GROUP: &'static str = "grains";
    const NAME: &'static str = "grains";
    const CHECKSUM: &'static str = "checksum_grains";

    fn integers() -> Vec<Field<Self, u32>> {
        vec![field!(Self, id, number), field!(Self, body, number)]
    }

    fn numbers() -> Vec<Field<Self, f64>> {
        vec![
            field!(Self, position, 3),
            field!(Self, velocity, 3),
            field!(Self, angular_velocity, 3),
            field!(Self, radius, number),
            field!(Self, force, 3),
            field!(Self, torque, 3),
        ]
    }

    fn signed() -> Vec<Field<Self, i64>> {
        vec![field!(Self, image, 3)]
    }

    fn where_not_zero() -> Vec<Optional<Self>> {
        vec![Optional::Whole(field!(Self, material, number))]
    }

    /// The first material adds nothing.
    fn hashed(&self) -> &[u8] {
        let all = bytemuck::bytes_of(self);
        match self.material {
            0 => &all[..std::mem::offset_of!(Self, material)],
            _ => all,
        }
    }
}

impl Record for ContactState {
    const GROUP: &'static str = "contacts";
    const NAME: &'static str = "contacts";
    const CHECKSUM: &'static str = "checksum_contacts";

    fn integers() -> Vec<Field<Self, u32>> {
        vec![field!(Self, i, number), field!(Self, j, number)]
    }

    fn numbers() -> Vec<Field<Self, f64>> {
        vec![field!(Self, history, 3)]
    }

    /// Of spheres that resist rolling or twisting.
    fn where_not_zero() -> Vec<Optional<Self>> {
        vec![Optional::Number(field!(Self, torques, 4))]
    }

    fn signed() -> Vec<Field<Self, i64>> {
        vec![field!(Self, limits, number)]
    }
}

impl Record for GrainPosition {
    const GROUP: &'static str = "analysed/grains";
    const NAME: &'static str = "grains of the analysed frame";
    const CHECKSUM: &'static str = "checksum_analysed_grains";

    fn integers() -> Vec<Field<Self, u32>> {
        vec![field!(Self, id, number), field!(Self, body, number)]
    }

    fn numbers() -> Vec<Field<Self, f64>> {
        vec![field!(Self, position, 2)]
    }

    fn signed() -> Vec<Field<Self, i64>> {
        vec![field!(Self, image, number)]
    }
}

impl Record for ContactForce {
    const GROUP: &'static str = "analysed/contacts";
    const NAME: &'static str = "contacts of the analysed frame";
    const CHECKSUM: &'static str = "checksum_analysed_contacts";

    fn integers() -> Vec<Field<Self, u32>> {
        vec![field!(Self, i, number), field!(Self, j, number)]
    }

    fn numbers() -> Vec<Field<Self, f64>> {
        vec![
            field!(Self, normal_force, number),
            field!(Self, tangential_force, number),
        ]
    }
}

impl Record for Displacement {
    const GROUP: &'static str = "travels";
    const NAME: &'static str = "displacements";
    const CHECKSUM: &'static str = "checksum_travels";

    fn integers() -> Vec<Field<Self, u32>> {
        vec![field!(Self, id, number), field!(Self, body, number)]
    }

    fn numbers() -> Vec<Field<Self, f64>> {
        vec![field!(Self, start, 3), field!(Self, angle, 3)]
    }

    fn signed() -> Vec<Field<Self, i64>> {
        vec![field!(Self, image, 3)]
    }
}

pub(super) fn write_one<T: H5Type + Copy>(
    file: &H5File,
    name: &str,
    shape: &[usize],
    first: u64,
    local: &[T],
) -> Result<(), Failure> {
    let width = shape.get(1).copied().unwrap_or(1) as u64;
    let slab = Slab::rows(first, local.len() as u64 / width, width);
    file.dataset::<T>(name, shape, None)?.write(slab, local)
}

fn write_column<R: Record, T: H5Type + Copy>(
    file: &H5File,
    list: &Stretch<R>,
    field: &Field<R, T>,
) -> Result<(), Failure> {
    let values: Vec<T> = list.records.iter().flat_map(field.get).copied().collect();
    let name = format!("{}{}/{}", list.prefix, R::GROUP, field.name);
    let shape = [list.length as usize, field.width];
    let shape = &shape[..if field.width == 1 { 1 } else { 2 }];
    write_one(file, &name, shape, list.first, &values)
}

/// One rank's part of a list of records.
pub(super) struct Stretch<R> {
    /// Before the names of the list's group and checksum.
    pub prefix: &'static str,
    /// Length of the whole list.
    pub length: u64,
    /// Number of records before the stretch.
    pub first: u64,
    pub records: Vec<R>,
    /// Whether a rank has one of [`Record::where_not_zero`].
    not_zero: bool,
}

impl<R: Record> Stretch<R> {
    /// Collective.
    pub fn new(
        exchange: &dyn Parallel,
        prefix: &'static str,
        (length, first): (u64, u64),
        records: Vec<R>,
    ) -> Self {
        let fields = R::where_not_zero();
        let of = |r: &R| !fields.iter().all(|field| field.is_zero(r));
        let not_zero = u64::from(records.iter().any(of));
        Self {
            prefix,
            length,
            first,
            not_zero: !fields.is_empty() && total(exchange, not_zero) > 0,
            records,
        }
    }
}

/// A list of a checkpoint, whatever its records are.
pub(super) trait List {
    /// Name and value of the checksum of the whole list. Collective.
    fn checksum(&self, exchange: &dyn Parallel) -> (String, u64);

    /// Bytes of the whole list.
    fn bytes(&self) -> usize;

    /// Writes the list into its group. Collective.
    fn write(&self, file: &H5File, outcome: &mut CollectiveOutcome);
}

impl<R: Record> List for Stretch<R> {
    fn checksum(&self, exchange: &dyn Parallel) -> (String, u64) {
        let name = format!("{}{}", self.prefix, R::CHECKSUM);
        (name, checksum(exchange, &self.records))
    }

    fn bytes(&self) -> usize {
        self.length as usize * size_of::<R>()
    }

    fn write(&self, file: &H5File, outcome: &mut CollectiveOutcome) {
        outcome.note(file.group(&format!("{}{}", self.prefix, R::GROUP)));
        for field in R::integers() {
            outcome.note(write_column(file, self, &field));
        }
        for field in R::numbers() {
            outcome.note(write_column(file, self, &field));
        }
        for field in R::signed() {
            outcome.note(write_column(file, self, &field));
        }
        for field in R::where_not_zero().iter().filter(|_| self.not_zero) {
            outcome.note(match field {
                Optional::Number(field) => write_column(file, self, field),
                Optional::Whole(field) => write_column(file, self, field),
            });
        }
    }
}

/// Returns the wrapping sum of the records' hashes, which depends neither on their order nor on the
/// ranks that hold them.
pub(super) fn checksum<R: Record>(exchange: &dyn Parallel, records: &[R]) -> u64 {
    let hashes = records.iter().map(|r| xxh3_64(r.hashed()));
    total(exchange, hashes.fold(0, u64::wrapping_add))
}

pub(super) fn length(file: &hdf5::File, name: &str) -> Result<u64, String> {
    let dataset = file
        .dataset(name)
        .map_err(|e| format!("damaged: {name} ({e})"))?;
    match dataset.shape()[..] {
        [n] => Ok(n as u64),
        _ => Err(format!("damaged: {name} is not a list")),
    }
}

pub(super) fn read_records<R: Record>(
    (file, prefix): (&hdf5::File, &str),
    all: u64,
    local: Range<u64>,
) -> Result<Vec<R>, String> {
    fn fill<R: Record, T: H5Type + Copy>(
        (file, prefix): (&hdf5::File, &str),
        field: &Field<R, T>,
        all: u64,
        local: &Range<u64>,
        records: &mut [R],
    ) -> Result<(), String> {
        let name = format!("{prefix}{}/{}", R::GROUP, field.name);
        let damaged = |why: &dyn std::fmt::Display| format!("damaged: {name} ({why})");
        let dataset = file.dataset(&name).map_err(|e| damaged(&e))?;
        let shape = [all as usize, field.width];
        if dataset.shape() != shape[..if field.width == 1 { 1 } else { 2 }] {
            return Err(damaged(&format!("its shape is {:?}", dataset.shape())));
        }
        let rows = local.start as usize..local.end as usize;
        if rows.is_empty() {
            return Ok(());
        }
        let values: Vec<T> = match field.width {
            1 => dataset.read_slice_1d::<T, _>(rows).map(|v| v.to_vec()),
            _ => dataset
                .read_slice_2d::<T, _>((rows, ..))
                .map(|v| v.iter().copied().collect()),
        }
        .map_err(|e| damaged(&e))?;
        for (record, values) in records.iter_mut().zip(values.chunks_exact(field.width)) {
            (field.set)(record).copy_from_slice(values);
        }
        Ok(())
    }
    let optional: usize = R::where_not_zero().iter().map(|field| field.size().1).sum();
    if all.saturating_mul((size_of::<R>() - optional) as u64) > file.size() {
        return Err(format!(
            "damaged: {} has more rows than the file can hold",
            R::GROUP
        ));
    }
    let mut records = vec![R::zeroed(); (local.end - local.start) as usize];
    let file = (file, prefix);
    for field in R::integers() {
        fill(file, &field, all, &local, &mut records)?;
    }
    for field in R::numbers() {
        fill(file, &field, all, &local, &mut records)?;
    }
    for field in R::signed() {
        fill(file, &field, all, &local, &mut records)?;
    }
    for field in R::where_not_zero() {
        let (file, prefix) = file;
        if !file.link_exists(&format!("{prefix}{}/{}", R::GROUP, field.size().0)) {
            continue;
        }
        match field {
            Optional::Number(field) => fill((file, prefix), &field, all, &local, &mut records)?,
            Optional::Whole(field) => fill((file, prefix), &field, all, &local, &mut records)?,
        }
    }
    Ok(records)
}
