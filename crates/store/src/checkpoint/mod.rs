//! `checkpoint.h5`: the whole state of a run, verified by checksums when it is read.

mod records;

use super::collective::{CollectiveOutcome, IdBlocks, agree, on_root, records_of};
use super::disk::{self, unwritten};
use super::h5::{Attribute, H5File, Word};
use super::sound::{self, ReadFile};
use gshear_dem::domain::total;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::{
    ContactForce, ContactState, Displacement, FramePart, GrainPosition, GrainState, HeldState,
    Snapshot,
};
use gshear_mpi_exchange::Parallel;
use records::{List, RankRecords, Record, checksum, length, read_records, write_one};
use std::ffi::OsString;
use std::io::ErrorKind;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Path, PathBuf};
use tempfile::{NamedTempFile, TempPath};
use xxhash_rust::xxh3::xxh3_64;

/// File name of the newest checkpoint.
pub const NAME: &str = "checkpoint.h5";
/// File name of the checkpoint before it.
pub const PREVIOUS: &str = "checkpoint.previous.h5";

const FORMAT: &str = "gshear-checkpoint";
/// Before the names of groups and checksums of the states that are held: one after the other, as if
/// they were one state of more grains.
const HELD: &str = "held_";

/// Version of the format, the only one that is read.
pub const VERSION: u64 = 8;

fn hex(sum: u64) -> String {
    format!("{sum:016x}")
}

/// Brings the contacts of a state that was [`read`] to every rank that holds one of the two grains.
/// Collective.
pub fn to_both_holders(exchange: &dyn Parallel, state: &mut Snapshot) {
    state.contacts = contacts_of_both(exchange, &state.grains, &state.contacts);
    for held in &mut state.held {
        held.contacts = contacts_of_both(exchange, &held.grains, &held.contacts);
    }
}

/// The contacts of which this rank holds a grain, from those whose first grain it holds.
/// Collective.
fn contacts_of_both(
    exchange: &dyn Parallel,
    grains: &[GrainState],
    contacts: &[ContactState],
) -> Vec<ContactState> {
    let blocks = IdBlocks::of(exchange, total(exchange, grains.len() as u64));
    let mut messages = vec![Vec::new(); exchange.size()];
    for contact in contacts {
        let (a, b) = (blocks.holder(contact.i), blocks.holder(contact.j));
        messages[a].extend_from_slice(bytemuck::bytes_of(contact));
        if b != a {
            messages[b].extend_from_slice(bytemuck::bytes_of(contact));
        }
    }
    let received = exchange.all_to_all(messages);
    let records = received.iter().flat_map(|bytes| records_of(bytes));
    records.collect()
}

/// Writes `checkpoint.h5` into the folder; an existing one becomes `checkpoint.previous.h5`.
/// Together the ranks must hold each of the grains 0 … N-1 and each contact once, in any order.
/// `texts`: the header and the scene, of which those of rank 0 are written. Collective.
///
/// # Errors
/// [`Failure::Other`] if a file cannot be written or renamed.
pub fn write(
    exchange: &dyn Parallel,
    folder: &Path,
    texts: [&str; 2],
    snapshot: &Snapshot,
) -> Result<()> {
    let _waiting = exchange.waiting();
    let lists = lists_of(exchange, snapshot);
    // Rank 0's texts on every rank, because HDF5 requires equal arguments.
    let [header, scene] = texts.map(|text| exchange.broadcast(text.into()));
    let texts = [("header", header), ("scene", scene)];
    let mut attributes = vec![
        ("format".into(), Attribute::Word(FORMAT.into())),
        ("format_version".into(), Attribute::Count(VERSION)),
    ];
    for (name, text) in &texts {
        let sum = Attribute::Word(hex(xxh3_64(text)));
        attributes.push((format!("checksum_{name}"), sum));
    }
    for list in &lists {
        let (name, sum) = list.checksum(exchange);
        attributes.push((name, Attribute::Word(hex(sum))));
    }
    let (part, name) = part_of(exchange, folder)?;
    let path = folder.join(name);
    let file = H5File::create(&path, exchange)?;
    let of_texts = texts.iter().map(|(_, text)| text.len()).sum::<usize>();
    let of_lists = lists.iter().map(|list| list.bytes()).sum::<usize>();
    file.reserve(exchange, of_texts + of_lists)?;
    let mut outcome = CollectiveOutcome::default();
    for (name, value) in &attributes {
        outcome.note(file.attribute("/", name, value));
    }
    let root = exchange.rank() == 0;
    for (name, text) in &texts {
        let local = if root { &text[..] } else { &[] };
        outcome.note(write_one(&file, name, &[text.len()], 0, local));
    }
    for list in &lists {
        list.write(&file, &mut outcome);
    }
    file.agree(exchange, outcome)?;
    file.close(exchange)?;
    verify(exchange, &path, &attributes)?;
    let moved = part.map_or(Ok(()), |part| replace(folder, part));
    agree(exchange, moved)
}

/// The lists of a checkpoint, this rank's part of each. Collective.
fn lists_of(exchange: &dyn Parallel, snapshot: &Snapshot) -> Vec<Box<dyn List>> {
    let blocks = IdBlocks::of(exchange, total(exchange, snapshot.grains.len() as u64));
    let mut lists = ListsOfRank {
        exchange,
        lists: Vec::new(),
    };
    lists.push("", blocks, &snapshot.grains);
    lists.push("", blocks, &snapshot.contacts);
    if let Some(part) = &snapshot.analysed {
        lists.push("", blocks, &part.grains);
        lists.push("", blocks, &part.contacts);
    }
    if let Some(displacements) = &snapshot.displacements {
        lists.push("", blocks, displacements);
    }
    if !snapshot.held.is_empty() {
        let HeldState { grains, contacts } = one_after_another(&snapshot.held, blocks.grains);
        let count = snapshot.held.len() as u64;
        let blocks = IdBlocks::new(blocks.grains * count, blocks.ranks);
        lists.push(HELD, blocks, &grains);
        lists.push(HELD, blocks, &contacts);
    }
    lists.lists
}

/// Lists of a checkpoint, this rank's part of each.
struct ListsOfRank<'a> {
    exchange: &'a dyn Parallel,
    lists: Vec<Box<dyn List>>,
}

impl ListsOfRank<'_> {
    /// Adds a list. `blocks`: of the ids of its grains. Collective.
    fn push<R: Record>(&mut self, prefix: &'static str, blocks: IdBlocks, records: &[R]) {
        let list = RankRecords::new(self.exchange, prefix, blocks, records);
        self.lists.push(Box::new(list));
    }
}

/// Creates an empty file for the next checkpoint, which rank 0 keeps; dropping it removes it.
/// Returns its name on every rank. Collective.
fn part_of(exchange: &dyn Parallel, folder: &Path) -> Result<(Option<TempPath>, OsString)> {
    let new = folder.join(NAME);
    let part = on_root(exchange, || {
        let part = disk::beside(&new).map_err(|e| unwritten(&new, &e))?;
        Ok(Some(part))
    })?;
    let part = part.map(NamedTempFile::into_temp_path);
    let name = part.as_ref().and_then(|part| part.file_name());
    let name = exchange.broadcast(name.unwrap_or_default().as_bytes().to_vec());
    Ok((part, OsString::from_vec(name)))
}

/// Reads a checkpoint back that has been written, because not every error of parallel writing
/// reaches the program. Collective.
fn verify(exchange: &dyn Parallel, path: &Path, attributes: &[(String, Attribute)]) -> Result<()> {
    let pieces = read_pieces(path, exchange.rank(), exchange.size());
    let pieces = agree(exchange, pieces.map_err(|why| miswritten(path, &why)))?;
    check(exchange, &pieces).map_err(|why| miswritten(path, &why))?;
    on_root(exchange, || {
        checksums_are(path, attributes).map_err(|why| miswritten(path, &why))
    })
}

fn miswritten(path: &Path, why: &str) -> Failure {
    let path = path.display();
    Failure::other(format!(
        "{path}: was not written as it should be: {why}; the checkpoint before it is kept"
    ))
}

/// Compares the checksums of a file with those that were to be written.
fn checksums_are(path: &Path, attributes: &[(String, Attribute)]) -> Result<(), String> {
    let compared = sound::read(path, |file| {
        for (name, value) in attributes {
            if let Attribute::Word(expected) = value
                && file.attr(name)?.read_scalar::<Word>()?.as_str() != expected
            {
                return Err(format!("its attribute {name} differs").into());
            }
        }
        Ok(())
    });
    compared.map_err(|e| disk::reason(&e))
}

/// The states as one, in which the grains of the k-th have ids from k `grains` on.
fn one_after_another(states: &[HeldState], grains: u64) -> HeldState {
    let mut all = HeldState::default();
    for (k, state) in states.iter().enumerate() {
        let first = k as u32 * grains as u32;
        for mut g in state.grains.iter().copied() {
            g.id += first;
            all.grains.push(g);
        }
        for mut c in state.contacts.iter().copied() {
            (c.i, c.j) = (first + c.i, first + c.j);
            all.contacts.push(c);
        }
    }
    all
}

/// The states that were written as one: of each the grains of this rank's block of `blocks`, and
/// their contacts. Collective.
fn split_states(exchange: &dyn Parallel, blocks: IdBlocks, held: &HeldPieces) -> Vec<HeldState> {
    let grains = blocks.grains as u32;
    let count = held.grains.blocks.grains / blocks.grains.max(1);
    let mut states = vec![HeldState::default(); count as usize];
    for mut g in blocks.redistribute(exchange, &held.grains.records, |g| g.id % grains) {
        let state = g.id / grains;
        g.id %= grains;
        states[state as usize].grains.push(g);
    }
    for mut c in blocks.redistribute(exchange, &held.contacts.records, |c| c.i % grains) {
        let state = c.i / grains;
        (c.i, c.j) = (c.i % grains, c.j % grains);
        states[state as usize].contacts.push(c);
    }
    states
}

/// Gives the new checkpoint its name. `checkpoint.h5` exists and is complete at every moment.
fn replace(folder: &Path, part: TempPath) -> Result<()> {
    let new = folder.join(NAME);
    rename(folder, part, &new)
        .map_err(|error| Failure::other(format!("{}: cannot be renamed: {error}", new.display())))
}

fn rename(folder: &Path, part: TempPath, new: &Path) -> std::io::Result<()> {
    // Every rank has brought its part to disk when it closed the file.
    if new.try_exists()? {
        link(new, &folder.join(PREVIOUS))?;
    }
    part.persist(new)?;
    disk::sync_folder(folder)
}

/// Gives a file a second name, which may belong to another file before.
fn link(from: &Path, to: &Path) -> std::io::Result<()> {
    let part = to.with_extension("h5.link");
    let _ = std::fs::remove_file(&part);
    // Not every file system has hard links.
    std::fs::hard_link(from, &part).or_else(|_| {
        std::fs::copy(from, &part)?;
        std::fs::File::open(&part)?.sync_all()
    })?;
    std::fs::rename(&part, to)
}

/// Stage whose kept checkpoints have only the step in their names.
const MAIN_STAGE: &str = "shear";

/// Returns the name of a kept checkpoint: `checkpoint-<step>.h5` for the shear,
/// `checkpoint-<stage>-<step>.h5` for other stages.
pub fn kept_name(stage: &str, step: u64) -> String {
    format!("{}{step}.h5", kept_prefix(stage))
}

fn kept_prefix(stage: &str) -> String {
    match stage {
        MAIN_STAGE => "checkpoint-".into(),
        _ => format!("checkpoint-{stage}-"),
    }
}

/// Keeps the newest checkpoint of the folder under [`kept_name`] as well. To be called on one rank.
///
/// # Errors
/// [`Failure::Other`] if the file can be neither linked nor copied.
pub fn keep(folder: &Path, stage: &str, step: u64) -> Result<()> {
    let (newest, kept) = (folder.join(NAME), folder.join(kept_name(stage, step)));
    link(&newest, &kept)
        .map_err(|e| Failure::other(format!("{}: cannot be kept: {e}", kept.display())))
}

/// Makes a checkpoint the newest of the folder: it gets the name `checkpoint.h5`. To be called on
/// one rank.
///
/// # Errors
/// [`Failure::Other`] if the file can be neither linked nor copied.
pub fn make_newest(path: &Path, folder: &Path) -> Result<()> {
    let newest = folder.join(NAME);
    link(path, &newest).map_err(|e| unwritten(&newest, &e))
}

/// Returns the kept checkpoints of a stage in a folder with their steps, sorted by step.
pub fn kept(folder: &Path, stage: &str) -> Vec<(u64, PathBuf)> {
    let prefix = kept_prefix(stage);
    let mut kept = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if let Some(step) = kept_step(&path, &prefix) {
            kept.push((step, path));
        }
    }
    kept.sort();
    kept
}

/// The step of a kept checkpoint whose name begins with this.
fn kept_step(path: &Path, prefix: &str) -> Option<u64> {
    let name = path.file_name()?.to_str()?;
    let step = name.strip_prefix(prefix)?.strip_suffix(".h5")?;
    step.parse().ok()
}

/// Returns whether a file is marked as a checkpoint.
pub fn is_checkpoint(path: &Path) -> bool {
    hdf5::silence_errors(true);
    let marked = sound::read(path, |file| Ok(file.attr("format").is_ok()));
    path.is_file() && marked.unwrap_or(false)
}

/// Reads the header and the scene of a checkpoint, and nothing of its state. Not collective.
///
/// # Errors
/// [`Failure::Input`] if the file is missing, not a checkpoint, or damaged in one of the two;
/// [`Failure::Other`] if the system does not let it be read.
pub fn read_texts(path: &Path) -> Result<[String; 2]> {
    hdf5::silence_errors(true);
    within(path, texts).map_err(|why| unread(path, &why))
}

fn unread(path: &Path, why: &str) -> Failure {
    disk::unread(format!("{}: {why}", path.display()))
}

/// Reads a checkpoint. Returns the header, the scene as TOML, and this rank's part of the state: a
/// block of the grains by id, and the contacts whose lower id is in the block, sorted by their ids.
/// Collective.
///
/// # Errors
/// [`Failure::Input`], the same on every rank, if the file is missing, damaged or not a checkpoint;
/// [`Failure::Other`] if the system does not let it be read.
pub fn read(exchange: &dyn Parallel, path: &Path) -> Result<([String; 2], Snapshot)> {
    // Each rank reads for itself with the serial driver, so that a failure on one rank does not
    // make the others wait.
    let pieces = read_pieces(path, exchange.rank(), exchange.size());
    let pieces = agree(exchange, pieces.map_err(|why| unread(path, &why)))?;

    check(exchange, &pieces).map_err(|why| unread(path, &why))?;
    let blocks = pieces.grains.blocks;
    let contacts = blocks.redistribute(exchange, &pieces.contacts.records, |c| c.i);
    let held = match &pieces.held {
        Some(held) => split_states(exchange, blocks, held),
        None => Vec::new(),
    };
    Ok((
        pieces.texts,
        Snapshot {
            grains: pieces.grains.records,
            contacts,
            analysed: pieces.analysed.map(|frame| FramePart {
                grains: frame.grains.records,
                contacts: frame.contacts.records,
            }),
            displacements: (pieces.displacements).map(|displacements| displacements.records),
            held,
        },
    ))
}

/// Checks all lists of a checkpoint, with the same result on every rank. Collective.
fn check(exchange: &dyn Parallel, pieces: &Pieces) -> Result<(), String> {
    let blocks = pieces.grains.blocks;
    pieces.grains.check(exchange, blocks)?;
    pieces.contacts.check(exchange, blocks)?;
    if let Some(frame) = &pieces.analysed {
        frame.grains.check(exchange, blocks)?;
        frame.contacts.check(exchange, blocks)?;
    }
    if let Some(displacements) = &pieces.displacements {
        displacements.check(exchange, blocks)?;
    }
    if let Some(held) = &pieces.held {
        let blocks = held.grains.blocks;
        held.grains.check(exchange, blocks)?;
        held.contacts.check(exchange, blocks)?;
    }
    Ok(())
}

struct Pieces {
    /// The header and the scene.
    texts: [String; 2],
    grains: Piece<GrainState>,
    contacts: Piece<ContactState>,
    analysed: Option<FramePieces>,
    displacements: Option<Piece<Displacement>>,
    held: Option<HeldPieces>,
}

/// The last analysed frame.
struct FramePieces {
    grains: Piece<GrainPosition>,
    contacts: Piece<ContactForce>,
}

/// The states that are held, all together.
struct HeldPieces {
    grains: Piece<GrainState>,
    contacts: Piece<ContactState>,
}

/// One rank's share of a list, whatever its ids, and the stored checksum of the whole list.
struct Piece<R> {
    /// Of the records of the list.
    blocks: IdBlocks,
    records: Vec<R>,
    sum: String,
}

impl<R: Record> Piece<R> {
    /// Checks the list of all ranks. `blocks`: of the ids of the grains.
    fn check(&self, exchange: &dyn Parallel, blocks: IdBlocks) -> Result<(), String> {
        let mut ids = self.records.iter().map(R::ids);
        let ordered = if R::IS_CONTACT {
            // Flat walls have the next two ids.
            let end = blocks.grains + 2;
            self.records.is_sorted_by_key(R::ids) && ids.all(|(i, j)| i < j && u64::from(j) < end)
        } else {
            let block = blocks.range(exchange.rank());
            ids.map(|(id, _)| u64::from(id)).eq(block)
        };
        let name = R::NAME;
        if hex(checksum(exchange, &self.records)) != self.sum {
            return Err(format!(
                "damaged: the checksum of its {name} differs from the stored one"
            ));
        }
        match total(exchange, u64::from(!ordered)) {
            0 => Ok(()),
            _ => Err(format!(
                "damaged: its {name} are not in the order of their ids"
            )),
        }
    }
}

fn word(file: &hdf5::File, name: &str) -> Result<String, String> {
    let value = file.attr(name).and_then(|a| a.read_scalar::<Word>());
    let value = value.map_err(|e| format!("damaged: attribute {name} ({e})"))?;
    String::from_utf8(value.as_bytes().to_vec()).map_err(|_| format!("damaged: attribute {name}"))
}

/// Opens a checkpoint.
fn open(path: &Path) -> Result<ReadFile, String> {
    match std::fs::metadata(path) {
        Err(e) if e.kind() == ErrorKind::NotFound => Err("there is no such checkpoint".into()),
        Err(e) => Err(e.to_string()),
        Ok(file) => sound::is_regular(file.file_type()).map_err(|e| e.to_string()),
    }?;
    let file = sound::open(path).map_err(|e| format!("not an HDF5 file, or damaged ({e})"))?;
    let names = file.attr_names().unwrap_or_default();
    let is_marked = names.iter().any(|name| name == "format");
    if !is_marked || word(&file, "format")? != FORMAT {
        return Err("not a checkpoint of gshear-mpi".into());
    }
    let version = file.attr("format_version");
    let version = version.and_then(|a| a.read_scalar::<u64>());
    let version = version.map_err(|e| format!("damaged: attribute format_version ({e})"))?;
    if version != VERSION {
        return Err(format!(
            "a checkpoint of format version {version}; this program reads version {VERSION}"
        ));
    }
    Ok(file)
}

/// The header and the scene.
fn texts(file: &hdf5::File) -> Result<[String; 2], String> {
    Ok([text(file, "header")?, text(file, "scene")?])
}

fn text(file: &hdf5::File, name: &str) -> Result<String, String> {
    let bytes = file.dataset(name).and_then(|d| d.read_raw::<u8>());
    let bytes = bytes.map_err(|e| format!("damaged: {name} ({e})"))?;
    if hex(xxh3_64(&bytes)) != word(file, &format!("checksum_{name}"))? {
        return Err(format!(
            "damaged: the checksum of its {name} differs from the stored one"
        ));
    }
    String::from_utf8(bytes).map_err(|_| format!("damaged: {name} is not text"))
}

/// Reads from a checkpoint, and closes it.
fn within<T>(
    path: &Path,
    read: impl FnOnce(&hdf5::File) -> Result<T, String>,
) -> Result<T, String> {
    let file = open(path)?;
    let content = read(&file)?;
    file.close()
        .map_err(|e| format!("cannot be closed: {}", disk::reason(&e)))?;
    Ok(content)
}

/// Reads this rank's share of a checkpoint.
fn read_pieces(path: &Path, rank: usize, ranks: usize) -> Result<Pieces, String> {
    within(path, |file| PieceReader { file, rank, ranks }.pieces())
}

/// Reads a rank's share of a checkpoint.
struct PieceReader<'a> {
    file: &'a hdf5::File,
    rank: usize,
    ranks: usize,
}

impl PieceReader<'_> {
    fn pieces(&self) -> Result<Pieces, String> {
        let texts = texts(self.file)?;
        let names = self.file.attr_names().unwrap_or_default();
        let grains: Piece<GrainState> = self.piece("")?;
        let count = grains.blocks.grains;
        if count == 0 {
            return Err("damaged: it holds no grain".into());
        }
        let mut held = None;
        if names.contains(&format!("{HELD}{}", GrainState::CHECKSUM)) {
            let states = HeldPieces {
                grains: self.piece(HELD)?,
                contacts: self.piece(HELD)?,
            };
            if !states.grains.blocks.grains.is_multiple_of(count) {
                return Err("damaged: the states that it holds have other grains".into());
            }
            held = Some(states);
        }
        let contacts = self.piece("")?;
        let mut analysed = None;
        if names.iter().any(|name| name == GrainPosition::CHECKSUM) {
            analysed = Some(FramePieces {
                grains: self.piece("")?,
                contacts: self.piece("")?,
            });
        }
        let mut displacements = None;
        if names.iter().any(|name| name == Displacement::CHECKSUM) {
            displacements = Some(self.piece("")?);
        }
        Ok(Pieces {
            texts,
            grains,
            contacts,
            analysed,
            displacements,
            held,
        })
    }

    /// Reads a list, the names of whose group and checksum begin with `prefix`.
    fn piece<R: Record>(&self, prefix: &str) -> Result<Piece<R>, String> {
        let first = format!("{prefix}{}/{}", R::GROUP, R::FIELDS[0].name);
        let blocks = IdBlocks::new(length(self.file, &first)?, self.ranks as u64);
        let rows = blocks.range(self.rank);
        Ok(Piece {
            blocks,
            records: read_records(self.file, prefix, blocks.grains, rows)?,
            sum: word(self.file, &format!("{prefix}{}", R::CHECKSUM))?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::VERSION;

    #[test]
    fn the_page_of_the_files_names_the_version() {
        let page = include_str!("../../../../docs/reference/file-formats.md");
        assert!(page.contains(&format!("`format_version` = {VERSION},")));
    }
}
