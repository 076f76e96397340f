//! Records of a checkpoint and their fields, each of which is a dataset.

use crate::collective::{CollectiveOutcome, IdBlocks};
use crate::h5::{H5File, Slab};
use crate::sound;
use bytemuck::{Pod, bytes_of, bytes_of_mut, cast_slice};
use gshear_dem::domain::total;
use gshear_dem::failure::Result;
use gshear_dem::state::{ContactForce, ContactState, Displacement, GrainPosition, GrainState};
use gshear_mpi_exchange::Parallel;
use hdf5::H5Type;
use std::mem::offset_of;
use std::ops::Range;
use xxhash_rust::xxh3::xxh3_64;

/// What the values of a field are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Values {
    /// u32
    Id,
    /// f64
    Number,
    /// i64
    Signed,
    /// f64 of a list in which one of them is not 0; else there is no dataset.
    OptionalNumber,
    /// u64 of such a list.
    OptionalInteger,
}

impl Values {
    /// Whether there may be no dataset.
    fn are_optional(self) -> bool {
        matches!(self, Values::OptionalNumber | Values::OptionalInteger)
    }
}

/// A field of a record: name, what it holds and how many, and its first byte in the record.
pub(super) struct Field {
    pub name: &'static str,
    values: Values,
    width: usize,
    at: usize,
}

impl Field {
    /// The values of a record.
    fn of<'r, R: Record, T: Pod>(&self, record: &'r R) -> &'r [T] {
        cast_slice(&bytes_of(record)[self.at..][..self.width * size_of::<T>()])
    }

    fn set<R: Record, T: Pod>(&self, record: &mut R, values: &[T]) {
        let bytes: &[u8] = cast_slice(values);
        bytes_of_mut(record)[self.at..][..bytes.len()].copy_from_slice(bytes);
    }

    /// The shape of its dataset.
    fn shape(&self, records: u64) -> Vec<usize> {
        let shape = [records as usize, self.width];
        shape[..if self.width == 1 { 1 } else { 2 }].to_vec()
    }
}

/// A record of a checkpoint. Its fields are stored as the datasets of one group.
pub(super) trait Record: Pod {
    const GROUP: &'static str;
    /// Name in messages.
    const NAME: &'static str;
    /// Attribute with the checksum of all records.
    const CHECKSUM: &'static str;
    const FIELDS: &'static [Field];
    /// Whether it is of a pair of grains.
    const IS_CONTACT: bool;
    /// The ids of the pair, or twice that of the grain.
    fn ids(&self) -> (u32, u32);

    /// What its checksum is of: an optional number at its end that is 0 adds nothing, so that of
    /// earlier versions, which did not have it, is the same.
    fn hashed(&self) -> &[u8] {
        let absent = Self::FIELDS.iter().find(|field| {
            field.values.are_optional() && field.width == 1 && field.of::<Self, u64>(self) == [0]
        });
        let end = absent.map_or(size_of::<Self>(), |field| field.at);
        &bytes_of(self)[..end]
    }
}

macro_rules! record {
    (
        $record:ty, $group:literal, $name:literal, $checksum:literal, $i:ident, $j:ident:
        $($values:ident $field:ident $width:literal;)+
    ) => {
        impl Record for $record {
            const GROUP: &'static str = $group;
            const NAME: &'static str = $name;
            const CHECKSUM: &'static str = $checksum;
            const FIELDS: &'static [Field] = &[$(Field {
                name: stringify!($field),
                values: Values::$values,
                width: $width,
                at: offset_of!($record, $field),
            }),+];
            const IS_CONTACT: bool = offset_of!($record, $i) != offset_of!($record, $j);

            fn ids(&self) -> (u32, u32) {
                (self.$i, self.$j)
            }
        }
    };
}

record! {
    GrainState, "grains", "grains", "checksum_grains", id, id:
    Id id 1;
    Id body 1;
    Number position 3;
    Number velocity 3;
    Number angular_velocity 3;
    Number radius 1;
    Number force 3;
    Number torque 3;
    Signed image 3;
    OptionalInteger material 1;
}

record! {
    ContactState, "contacts", "contacts", "checksum_contacts", i, j:
    Id i 1;
    Id j 1;
    Number history 3;
    Signed limits 1;
    // Of spheres that resist rolling or twisting.
    OptionalNumber torques 4;
    // Of contacts that age.
    OptionalNumber age 1;
}

record! {
    GrainPosition, "analysed/grains", "grains of the analysed frame",
    "checksum_analysed_grains", id, id:
    Id id 1;
    Id body 1;
    Number position 2;
    Signed image 1;
}

record! {
    ContactForce, "analysed/contacts", "contacts of the analysed frame",
    "checksum_analysed_contacts", i, j:
    Id i 1;
    Id j 1;
    Number normal_force 1;
    Number tangential_force 1;
}

record! {
    Displacement, "travels", "displacements", "checksum_travels", id, id:
    Id id 1;
    Id body 1;
    Number start 3;
    Number angle 3;
    Signed image 3;
}

pub(super) fn write_one<T: H5Type + Copy>(
    file: &H5File,
    name: &str,
    shape: &[usize],
    first: u64,
    local: &[T],
) -> Result<()> {
    let width = shape.get(1).copied().unwrap_or(1) as u64;
    let slab = Slab::rows(first, local.len() as u64 / width, width);
    let dataset = file.dataset(T::type_descriptor(), name, shape, None)?;
    dataset.write(slab, local)
}

/// One rank's part of a list of records.
pub(super) struct RankRecords<R> {
    /// Before the names of the list's group and checksum.
    prefix: &'static str,
    /// Length of the whole list.
    length: u64,
    /// Number of records of the ranks before.
    first: u64,
    records: Vec<R>,
    /// Whether a rank has an optional value that is not 0.
    has_optional: bool,
}

impl<R: Record> RankRecords<R> {
    /// Collects the records of this rank's block of `blocks`, in the order of their ids: grains,
    /// which must be 0 … N-1, or contacts by their lower id. Collective.
    pub fn new(
        exchange: &dyn Parallel,
        prefix: &'static str,
        blocks: IdBlocks,
        records: &[R],
    ) -> Self {
        let ids = blocks.range(exchange.rank());
        let mut records = blocks.redistribute(exchange, records, |r| r.ids().0);
        records.sort_unstable_by_key(R::ids);
        let (length, first) = if R::IS_CONTACT {
            let here = records.len() as u64;
            (total(exchange, here), exchange.sum_below(here))
        } else {
            let own = records.iter().map(|r| u64::from(r.ids().0));
            assert!(own.eq(ids.clone()), "a snapshot's grains are not 0 … N-1");
            (blocks.grains, ids.start)
        };
        let has_fields = R::FIELDS.iter().any(|field| field.values.are_optional());
        let is_set = u64::from(records.iter().any(has_optional));
        Self {
            prefix,
            length,
            first,
            has_optional: has_fields && total(exchange, is_set) > 0,
            records,
        }
    }

    fn write_field<T: H5Type + Pod>(&self, file: &H5File, field: &Field) -> Result<()> {
        let values = self.records.iter().flat_map(|r| field.of::<R, T>(r));
        let values: Vec<T> = values.copied().collect();
        let name = format!("{}{}/{}", self.prefix, R::GROUP, field.name);
        write_one(file, &name, &field.shape(self.length), self.first, &values)
    }
}

/// Whether an optional value of a record is not 0.
fn has_optional<R: Record>(record: &R) -> bool {
    let mut optional = R::FIELDS.iter().filter(|field| field.values.are_optional());
    optional.any(|field| field.of::<R, u64>(record).iter().any(|bits| *bits != 0))
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

impl<R: Record> List for RankRecords<R> {
    fn checksum(&self, exchange: &dyn Parallel) -> (String, u64) {
        let name = format!("{}{}", self.prefix, R::CHECKSUM);
        (name, checksum(exchange, &self.records))
    }

    fn bytes(&self) -> usize {
        self.length as usize * size_of::<R>()
    }

    fn write(&self, file: &H5File, outcome: &mut CollectiveOutcome) {
        outcome.note(file.group(&format!("{}{}", self.prefix, R::GROUP)));
        for field in R::FIELDS {
            if field.values.are_optional() && !self.has_optional {
                continue;
            }
            outcome.note(match field.values {
                Values::Id => self.write_field::<u32>(file, field),
                Values::Signed => self.write_field::<i64>(file, field),
                Values::OptionalInteger => self.write_field::<u64>(file, field),
                Values::Number | Values::OptionalNumber => self.write_field::<f64>(file, field),
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
    let dataset = file.dataset(name);
    let dataset = dataset.map_err(|e| format!("damaged: {name} ({e})"))?;
    match dataset.shape()[..] {
        [n] => Ok(n as u64),
        _ => Err(format!("damaged: {name} is not a list")),
    }
}

pub(super) fn read_records<R: Record>(
    file: &hdf5::File,
    prefix: &str,
    all: u64,
    local: Range<u64>,
) -> Result<Vec<R>, String> {
    fn fill<R: Record, T: H5Type + Pod>(
        dataset: &hdf5::Dataset,
        rows: Range<usize>,
        field: &Field,
        records: &mut [R],
    ) -> hdf5::Result<()> {
        let values: Vec<T> = sound::rows(dataset, rows)?;
        for (record, values) in records.iter_mut().zip(values.chunks_exact(field.width)) {
            field.set(record, values);
        }
        Ok(())
    }
    let optional = R::FIELDS.iter().filter(|field| field.values.are_optional());
    let optional: usize = optional.map(|field| 8 * field.width).sum();
    if all.saturating_mul((size_of::<R>() - optional) as u64) > file.size() {
        let group = R::GROUP;
        return Err(format!(
            "damaged: {group} has more rows than the file can hold"
        ));
    }
    let rows = local.start as usize..local.end as usize;
    let mut records = vec![R::zeroed(); rows.len()];
    for field in R::FIELDS {
        let name = format!("{prefix}{}/{}", R::GROUP, field.name);
        if field.values.are_optional() && !file.link_exists(&name) {
            continue;
        }
        let dataset = file.dataset(&name);
        let dataset = dataset.map_err(|e| format!("damaged: {name} ({e})"))?;
        let shape = dataset.shape();
        if shape != field.shape(all) {
            return Err(format!("damaged: {name} (its shape is {shape:?})"));
        }
        if rows.is_empty() {
            continue;
        }
        let rows = rows.clone();
        let filled = match field.values {
            Values::Id => fill::<R, u32>(&dataset, rows, field, &mut records),
            Values::Signed => fill::<R, i64>(&dataset, rows, field, &mut records),
            Values::OptionalInteger => fill::<R, u64>(&dataset, rows, field, &mut records),
            Values::Number | Values::OptionalNumber => {
                fill::<R, f64>(&dataset, rows, field, &mut records)
            }
        };
        filled.map_err(|e| format!("damaged: {name} ({e})"))?;
    }
    Ok(records)
}
