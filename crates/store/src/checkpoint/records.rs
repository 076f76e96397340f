//! Records of a checkpoint and their fields, each of which is a dataset.

use super::Stretch;
use crate::collective::CollectiveOutcome;
use crate::h5::{H5File, Slab};
use bytemuck::Pod;
use gshear_dem::failure::Failure;
use gshear_dem::state::{ContactForce, ContactState, Displacement, GrainPosition, GrainState};
use hdf5::H5Type;
use std::ops::Range;

/// A field of a record: name, numbers per record, getter and setter.
pub(super) struct Field<R, T> {
    name: &'static str,
    width: usize,
    get: fn(&R) -> &[T],
    set: fn(&mut R) -> &mut [T],
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
    (file, prefix): (&H5File, &str),
    field: &Field<R, T>,
    all: u64,
    first: u64,
    local: &[R],
) -> Result<(), Failure> {
    let values: Vec<T> = local.iter().flat_map(field.get).copied().collect();
    let name = format!("{prefix}{}/{}", R::GROUP, field.name);
    let shape = [all as usize, field.width];
    write_one(
        file,
        &name,
        &shape[..if field.width == 1 { 1 } else { 2 }],
        first,
        &values,
    )
}

/// Writes the records into their group, whose name begins with `prefix`.
pub(super) fn write_records<R: Record>(
    (file, prefix): (&H5File, &str),
    outcome: &mut CollectiveOutcome,
    stretch: &Stretch<R>,
) {
    let (all, first, local) = (stretch.length, stretch.first, &stretch.records[..]);
    let to = (file, prefix);
    outcome.note(file.group(&format!("{prefix}{}", R::GROUP)));
    for field in R::integers() {
        outcome.note(write_column(to, &field, all, first, local));
    }
    for field in R::numbers() {
        outcome.note(write_column(to, &field, all, first, local));
    }
    for field in R::signed() {
        outcome.note(write_column(to, &field, all, first, local));
    }
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
    // The widest field comes with every record.
    if all.saturating_mul(size_of::<R>() as u64) > file.size() {
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
    Ok(records)
}
