//! Compresses the `run.h5` of a run that has ended, and expands one that goes on.
//!
//! While a run writes, its datasets are plain. HDF5 lets ranks write compressed ones only all
//! together, and moves their pieces whenever rows are added, so that what is there at a checkpoint
//! would not stay where the journal knows it. At the end the file is written once more, beside
//! itself, and takes the place of the plain one when it is whole. Every rank reads, shuffles and
//! deflates some of its blocks, and rank 0 writes them. Every HDF5 reads shuffle and deflate. A
//! compressed chunk has one component of a vector, so that z of disks takes nothing.

use std::path::Path;

use gshear_dem::domain::Solo;
use gshear_dem::failure::{Failure, Result};
use gshear_mpi_exchange::Parallel;
use hdf5::{Dataset, File};
use tempfile::NamedTempFile;

use crate::checked::OpenFile;
use crate::collective::{CollectiveOutcome, agree, on_root, put_bytes, take_bytes};
use crate::disk::{self, beside, unwritten};
use crate::h5;
use crate::journal;
use crate::layout::{IMAGE, grain_dataset};
use crate::part::{Part, groups};
use crate::room;
use crate::run_reader::{RunFile, one_line};
use crate::sound;
use crate::text_writer::give_name;

mod blocks;
mod objects;

use objects::Objects;

/// Blocks that a rank reads before rank 0 writes them.
const ROUND: usize = 8;

/// Bytes of objects for which there is room beside those of the values.
const OBJECTS_BYTES: u64 = 1 << 20;

/// How the datasets are stored to which a run adds rows.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Storage {
    Plain,
    Compressed,
}

/// Compresses a `run.h5` that is whole and closed. Its content stays the same. Collective.
///
/// # Errors
/// If the file cannot be read, or its copy not be written. The file stays as it was then.
pub fn compress(exchange: &dyn Parallel, path: &Path) -> Result<()> {
    let _waiting = exchange.waiting();
    rewrite(exchange, path, Storage::Compressed)
}

/// Expands a compressed `run.h5`, so that ranks can write to it. One that is not compressed stays
/// as it is. Not collective.
///
/// # Errors
/// [`Failure::Input`] if the file is damaged; [`Failure::Other`] if its copy cannot be written. The
/// file stays as it was then.
pub(crate) fn expand(path: &Path) -> Result<()> {
    let file = Part::of(path).file;
    if sound::read(&file, is_compressed).map_err(|e| unread(&file, &e))? {
        // What is damaged is not copied.
        verify(&file)?;
        rewrite(&Solo, &file, Storage::Plain)
    } else {
        Ok(())
    }
}

/// Whether frames of a stage are compressed.
fn is_compressed(file: &File) -> hdf5::Result<bool> {
    let name = grain_dataset(&IMAGE.column);
    let stages = groups().filter(|group| file.link_exists(group));
    let mut parts: Vec<String> = stages.map(|group| format!("{group}/{name}")).collect();
    if file.link_exists("particles") {
        parts.push(name);
    }
    for name in parts {
        if file.dataset(&name)?.create_plist()?.has_filters() {
            return Ok(true);
        }
    }
    Ok(false)
}

fn unread(path: &Path, error: &hdf5::Error) -> Failure {
    let (path, why) = (path.display(), one_line(error));
    disk::unread(format!("{path}: cannot be read: {why}"))
}

/// Writes the file with another storage in its place.
fn rewrite(exchange: &dyn Parallel, path: &Path, storage: Storage) -> Result<()> {
    // A link may lead to another disk.
    let path = &journal::target(path);
    let mut copy = on_root(exchange, || Copy::create(path).map(Some))?;
    let opened = sound::open(path).map_err(|e| unread(path, &e));
    let source = agree(exchange, opened)?;
    let listed = Objects::of(&source).map_err(|e| unread(path, &e));
    let objects = agree(exchange, listed)?;
    on_root(exchange, || match &mut copy {
        Some(copy) => copy.begin(path, &objects, storage),
        None => Ok(()),
    })?;
    let blocks: Vec<(usize, usize)> = (objects.growing.iter().enumerate())
        .flat_map(|(dataset, growing)| (0..growing.blocks.count()).map(move |k| (dataset, k)))
        .collect();
    let ranks = exchange.size();
    for round in blocks.chunks(ROUND * ranks) {
        let mut outcome = CollectiveOutcome::default();
        let mut message = Vec::new();
        for &(dataset, block) in round.iter().skip(exchange.rank()).step_by(ranks) {
            let growing = &objects.growing[dataset];
            match growing.blocks.read(&growing.dataset, block, storage) {
                Ok(chunks) => chunks
                    .iter()
                    .for_each(|chunk| put_bytes(&mut message, chunk)),
                Err(error) => outcome.note(Err(unread(path, &error))),
            }
        }
        outcome.agree(exchange)?;
        let mut messages = vec![Vec::new(); ranks];
        messages[0] = message;
        let received = exchange.all_to_all(messages);
        let mut rest: Vec<&[u8]> = received.iter().map(Vec::as_slice).collect();
        on_root(exchange, || {
            let copy = copy.as_ref().expect("rank 0 writes");
            copy.reserve(path, rest.iter().map(|message| message.len() as u64).sum())?;
            for (k, &(dataset, block)) in round.iter().enumerate() {
                let blocks = &objects.growing[dataset].blocks;
                for place in blocks.places(block, storage) {
                    let chunk = take_bytes(&mut rest[k % ranks]);
                    let written = h5::write_chunk(&copy.growing[dataset], &place, chunk);
                    written.map_err(|e| unwritten(path, &e))?;
                }
            }
            Ok(())
        })?;
    }
    drop(objects);
    let closed = source.close().map_err(|e| unread(path, &e));
    agree(exchange, closed)?;
    on_root(exchange, || copy.map_or(Ok(()), |copy| copy.finish(path)))
}

/// The file that takes the place of another one, under its temporary name.
struct Copy {
    /// The datasets that grow.
    growing: Vec<Dataset>,
    open: OpenFile,
    part: NamedTempFile,
}

impl Copy {
    fn create(path: &Path) -> Result<Self> {
        let part = beside(path).map_err(|e| unwritten(path, &e))?;
        let options = File::with_options()
            .with_fapl(|access| access.libver_v18())
            .clone();
        let file = options
            .create(part.path())
            .map_err(|e| unwritten(path, &e))?;
        Ok(Self {
            growing: Vec::new(),
            open: OpenFile::new(file),
            part,
        })
    }

    /// Reserves room for so many bytes more, and for the objects beside them: HDF5 may crash on a
    /// full disk.
    fn reserve(&self, path: &Path, bytes: u64) -> Result<()> {
        let end = self.open.file().size();
        let reserved = room::allocate(self.part.path(), end, end + bytes + OBJECTS_BYTES);
        reserved.map_err(|e| unwritten(path, &e))
    }

    /// Creates all objects, those that grow without their values.
    fn begin(&mut self, path: &Path, objects: &Objects, storage: Storage) -> Result<()> {
        self.reserve(path, 0)?;
        let made = objects.copy_to(&mut self.open, storage);
        self.growing = made.map_err(|e| unwritten(path, &e))?;
        Ok(())
    }

    /// Closes the file, reads it back but for the numbers of its frames, and puts it into the place
    /// of `path`.
    fn finish(self, path: &Path) -> Result<()> {
        let Self {
            growing,
            open,
            part,
        } = self;
        drop(growing);
        open.close().map_err(|e| unwritten(path, &e))?;
        verify(part.path()).map_err(|e| unwritten(path, &e))?;
        give_name(part, path).map_err(|e| unwritten(path, &e))?;
        Ok(())
    }
}

/// Reads all stages of a file.
fn verify(file: &Path) -> Result<()> {
    let walked: hdf5::Result<Vec<&str>> = sound::read(file, |open| {
        h5::walk(open)?;
        let stages = groups().filter(|group| open.link_exists(group));
        Ok(stages.collect())
    });
    let stages = walked.map_err(|e| unread(file, &e))?;
    RunFile::open_any(file)?;
    for stage in stages {
        RunFile::open_any(&file.join(stage))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
