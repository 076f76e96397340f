//! `checkpoint.h5`: the whole state of a run, checked by sums when it is read.

use super::collective::{IdBlocks, Outcome, agree};
use super::h5::{Attribute, H5File, Slab, Word};
use crate::domain::{Exchange, total};
use crate::failure::Failure;
use crate::state::{ContactState, GrainState, Snapshot};
use bytemuck::Pod;
use hdf5::H5Type;
use std::ops::Range;
use std::path::Path;
use xxhash_rust::xxh3::xxh3_64;

/// The newest checkpoint of a run's folder.
pub const NAME: &str = "checkpoint.h5";
/// The one before it.
pub const PREVIOUS: &str = "checkpoint.previous.h5";
const PART: &str = "checkpoint.h5.part";

const FORMAT: &str = "gshear-checkpoint";
/// Changes with what a checkpoint holds.
pub const VERSION: u64 = 2;

/// A field of a record: its name, its numbers a record (1 or more), and how they are got and set.
struct Field<R, T> {
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

/// A record of a checkpoint and its fields, which are stored in a group as a dataset each.
trait Record: Pod {
    const GROUP: &'static str;
    fn integers() -> Vec<Field<Self, u32>>;
    fn numbers() -> Vec<Field<Self, f64>>;
}

impl Record for GrainState {
    const GROUP: &'static str = "grains";

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
}

impl Record for ContactState {
    const GROUP: &'static str = "contacts";

    fn integers() -> Vec<Field<Self, u32>> {
        vec![field!(Self, i, number), field!(Self, j, number)]
    }

    fn numbers() -> Vec<Field<Self, f64>> {
        vec![field!(Self, history, 3)]
    }
}

/// Wrapping sum of the hashes of the records: the same in whatever order and on whatever ranks they are.
fn checksum<R: Record>(exchange: &impl Exchange, records: &[R]) -> u64 {
    let hashes = records.iter().map(|r| xxh3_64(bytemuck::bytes_of(r)));
    total(exchange, hashes.fold(0, u64::wrapping_add))
}

fn hex(sum: u64) -> String {
    format!("{sum:016x}")
}

/// Writes the folder's `checkpoint.h5`, keeping the one that is there as `checkpoint.previous.h5`.
/// Together the ranks have the grains 0 … N-1 and every contact once, in any order. Collective.
pub fn write(
    exchange: &impl Exchange,
    folder: &Path,
    scene_toml: &str,
    snapshot: &Snapshot,
) -> Result<(), Failure> {
    let blocks = IdBlocks {
        grains: total(exchange, snapshot.grains.len() as u64),
        ranks: exchange.size() as u64,
    };
    let ids = blocks.range(exchange.rank());
    let mut grains = blocks.redistribute(exchange, &snapshot.grains, |g| g.id);
    grains.sort_unstable_by_key(|g| g.id);
    let complete = grains.iter().map(|g| u64::from(g.id)).eq(ids.clone());
    assert!(complete, "a snapshot's grains are not 0 … N-1");
    let mut contacts = blocks.redistribute(exchange, &snapshot.contacts, |c| c.i);
    contacts.sort_unstable_by_key(|c| (c.i, c.j));
    let first_contact = exchange.sum_below(contacts.len() as u64);
    let all_contacts = total(exchange, contacts.len() as u64);

    // The texts of rank 0: HDF5 wants the same from all.
    let header = exchange.broadcast(snapshot.header.clone().into_bytes());
    let scene = exchange.broadcast(scene_toml.to_owned().into_bytes());
    let attributes = [
        ("format", Attribute::Word(FORMAT.into())),
        ("format_version", Attribute::Count(VERSION)),
        ("checksum_header", Attribute::Word(hex(xxh3_64(&header)))),
        ("checksum_scene", Attribute::Word(hex(xxh3_64(&scene)))),
        (
            "checksum_grains",
            Attribute::Word(hex(checksum(exchange, &grains))),
        ),
        (
            "checksum_contacts",
            Attribute::Word(hex(checksum(exchange, &contacts))),
        ),
    ];
    let part = folder.join(PART);
    let file = agree(exchange, H5File::create(&part, exchange.communicator()))?;
    let mut outcome = Outcome::default();
    for (name, value) in &attributes {
        outcome.note(file.attribute("/", name, value));
    }
    let root = exchange.rank() == 0;
    for (name, text) in [("header", &header), ("scene", &scene)] {
        let mine = if root { &text[..] } else { &[] };
        outcome.note(write_one(&file, name, &[text.len()], 0, mine));
    }
    write_records(&file, &mut outcome, blocks.grains, ids.start, &grains);
    write_records(&file, &mut outcome, all_contacts, first_contact, &contacts);
    file.agree(exchange, outcome)?;
    agree(exchange, file.close())?;
    let moved = if root { replace(folder) } else { Ok(()) };
    agree(exchange, moved)
}

fn write_one<T: H5Type + Copy>(
    file: &H5File,
    name: &str,
    shape: &[usize],
    first: u64,
    mine: &[T],
) -> Result<(), Failure> {
    let width = shape.get(1).copied().unwrap_or(1) as u64;
    let slab = Slab::rows(first, mine.len() as u64 / width, width);
    file.dataset::<T>(name, shape, None)?.write(slab, mine)
}

fn write_records<R: Record>(
    file: &H5File,
    outcome: &mut Outcome,
    all: u64,
    first: u64,
    mine: &[R],
) {
    outcome.note(file.group(R::GROUP));
    fn column<R: Record, T: H5Type + Copy>(
        file: &H5File,
        field: &Field<R, T>,
        all: u64,
        first: u64,
        mine: &[R],
    ) -> Result<(), Failure> {
        let values: Vec<T> = mine.iter().flat_map(field.get).copied().collect();
        let name = format!("{}/{}", R::GROUP, field.name);
        let shape = [all as usize, field.width];
        write_one(
            file,
            &name,
            &shape[..if field.width == 1 { 1 } else { 2 }],
            first,
            &values,
        )
    }
    for field in R::integers() {
        outcome.note(column(file, &field, all, first, mine));
    }
    for field in R::numbers() {
        outcome.note(column(file, &field, all, first, mine));
    }
}

/// Puts the new checkpoint in the place of the old one, at no moment without a whole one.
fn replace(folder: &Path) -> Result<(), Failure> {
    let (new, old, part) = (folder.join(NAME), folder.join(PREVIOUS), folder.join(PART));
    let renamed = || -> std::io::Result<()> {
        std::fs::File::open(&part)?.sync_all()?;
        if new.exists() {
            std::fs::rename(&new, &old)?;
        }
        std::fs::rename(&part, &new)?;
        std::fs::File::open(folder)?.sync_all()
    };
    renamed().map_err(|error| {
        Failure::other(format!(
            "{}: cannot put it in place: {error}",
            new.display()
        ))
    })
}

/// Whether a file says of itself that it is a checkpoint.
pub fn is_checkpoint(path: &Path) -> bool {
    hdf5::silence_errors(true);
    path.is_file() && hdf5::File::open(path).is_ok_and(|file| file.attr("format").is_ok())
}

/// The scene and this rank's part of a checkpoint: an even block of the ids, and the contacts whose lower id is in it, in order.
/// `Failure::Input`, the same on every rank, where the file is missing, damaged, or none of ours. Collective.
pub fn read(exchange: &impl Exchange, path: &Path) -> Result<(String, Snapshot), Failure> {
    let bad = |why: String| Failure::input(format!("{}: {why}", path.display()));
    // By each rank for itself, through the plain driver: what fails on one alone then leaves nobody waiting.
    let pieces = read_pieces(path, exchange.rank(), exchange.size()).map_err(bad);
    let pieces = agree(exchange, pieces)?;

    let sums = [
        checksum(exchange, &pieces.grains),
        checksum(exchange, &pieces.contacts),
    ];
    let blocks = pieces.blocks;
    let contacts = &pieces.contacts;
    let checked = (|| {
        let parts = [
            ("grains", sums[0], &pieces.sums[0]),
            ("contacts", sums[1], &pieces.sums[1]),
        ];
        for (name, sum, stored) in parts {
            if hex(sum) != *stored {
                return Err(bad(format!(
                    "damaged: the checksum of its {name} is not the one stored"
                )));
            }
        }
        let ids = pieces.grains.iter().map(|g| u64::from(g.id));
        if !ids.eq(blocks.range(exchange.rank())) {
            return Err(bad(
                "damaged: its grains are not in the order of their ids".into()
            ));
        }
        let pairs = |c: &ContactState| c.i < c.j && u64::from(c.j) < blocks.grains;
        if !contacts.iter().all(pairs) || !contacts.is_sorted_by_key(|c| (c.i, c.j)) {
            return Err(bad(
                "damaged: its contacts are not in the order of their ids".into(),
            ));
        }
        Ok(())
    })();
    agree(exchange, checked)?;
    let contacts = blocks.redistribute(exchange, contacts, |c| c.i);
    Ok((
        pieces.scene,
        Snapshot {
            header: pieces.header,
            grains: pieces.grains,
            contacts,
        },
    ))
}

struct Pieces {
    header: String,
    scene: String,
    blocks: IdBlocks,
    grains: Vec<GrainState>,
    /// An even share of the list, whichever ids they are of.
    contacts: Vec<ContactState>,
    /// As stored: of grains, of contacts.
    sums: [String; 2],
}

fn read_pieces(path: &Path, rank: usize, ranks: usize) -> Result<Pieces, String> {
    if !path.is_file() {
        return Err("there is no such checkpoint".into());
    }
    let file = hdf5::File::open(path).map_err(|e| format!("not an HDF5 file, or damaged ({e})"))?;
    let foreign = || "not a checkpoint of gshear-mpi".to_string();
    let word = |name: &str| -> Result<String, String> {
        let value = file.attr(name).and_then(|a| a.read_scalar::<Word>());
        let value = value.map_err(|e| format!("damaged: attribute {name} ({e})"))?;
        String::from_utf8(value.as_bytes().to_vec())
            .map_err(|_| format!("damaged: attribute {name}"))
    };
    match file.attr_names() {
        Ok(names) if names.iter().any(|n| n == "format") => {}
        _ => return Err(foreign()),
    }
    if word("format")? != FORMAT {
        return Err(foreign());
    }
    let version = file
        .attr("format_version")
        .and_then(|a| a.read_scalar::<u64>());
    let version = version.map_err(|e| format!("damaged: attribute format_version ({e})"))?;
    if version != VERSION {
        return Err(format!(
            "a checkpoint of format version {version}; this program reads version {VERSION}"
        ));
    }
    let text = |name: &str| -> Result<String, String> {
        let bytes = file.dataset(name).and_then(|d| d.read_raw::<u8>());
        let bytes = bytes.map_err(|e| format!("damaged: {name} ({e})"))?;
        if hex(xxh3_64(&bytes)) != word(&format!("checksum_{name}"))? {
            return Err(format!(
                "damaged: the checksum of its {name} is not the one stored"
            ));
        }
        String::from_utf8(bytes).map_err(|_| format!("damaged: {name} is no text"))
    };
    let (header, scene) = (text("header")?, text("scene")?);
    let blocks = IdBlocks {
        grains: length(&file, "grains/id")?,
        ranks: ranks as u64,
    };
    let list = IdBlocks {
        grains: length(&file, "contacts/i")?,
        ranks: ranks as u64,
    };
    Ok(Pieces {
        header,
        scene,
        blocks,
        grains: read_records(&file, blocks.grains, blocks.range(rank))?,
        contacts: read_records(&file, list.grains, list.range(rank))?,
        sums: [word("checksum_grains")?, word("checksum_contacts")?],
    })
}

fn length(file: &hdf5::File, name: &str) -> Result<u64, String> {
    let dataset = file
        .dataset(name)
        .map_err(|e| format!("damaged: {name} ({e})"))?;
    match dataset.shape()[..] {
        [n] => Ok(n as u64),
        _ => Err(format!("damaged: {name} is not a list")),
    }
}

fn read_records<R: Record>(
    file: &hdf5::File,
    all: u64,
    mine: Range<u64>,
) -> Result<Vec<R>, String> {
    fn fill<R: Record, T: H5Type + Copy>(
        file: &hdf5::File,
        field: &Field<R, T>,
        all: u64,
        mine: &Range<u64>,
        records: &mut [R],
    ) -> Result<(), String> {
        let name = format!("{}/{}", R::GROUP, field.name);
        let damaged = |why: &dyn std::fmt::Display| format!("damaged: {name} ({why})");
        let dataset = file.dataset(&name).map_err(|e| damaged(&e))?;
        let shape = [all as usize, field.width];
        if dataset.shape() != shape[..if field.width == 1 { 1 } else { 2 }] {
            return Err(damaged(&format!("its shape is {:?}", dataset.shape())));
        }
        let rows = mine.start as usize..mine.end as usize;
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
    let mut records = vec![R::zeroed(); (mine.end - mine.start) as usize];
    for field in R::integers() {
        fill(file, &field, all, &mine, &mut records)?;
    }
    for field in R::numbers() {
        fill(file, &field, all, &mine, &mut records)?;
    }
    Ok(records)
}
