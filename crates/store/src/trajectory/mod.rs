//! The writer of `run.h5`: frames and time series, written by all ranks together in batches.

mod batches;
mod resume;

use crate::batch::{Frames, length};
use crate::checksums::{self, Constants, OF_PARAMETERS, of_parameters};
use crate::collective::{CollectiveOutcome, IdBlocks, agree, of_root, on_root, told_by_root};
use crate::existing::{is_of, unlink_foreign};
use crate::h5::{self, Attribute, H5File, Slab, by_root};
use crate::journal::{self, Journal};
use crate::layout::{
    self, CHUNK_FRAMES, Datasets, MASS, OpenMode, PARAMETERS, PARTICLES, RADIUS, describe,
};
pub use crate::layout::{FileContent, FrameFormat, frame_bytes};
use crate::own_columns;
use crate::part::{Part, groups_after};
use crate::row_table::RowTable;
pub use crate::run_header::{GrainShape, RunHeader};
use crate::run_reader::RunFile;
use crate::sound;
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_dem::domain::total;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::{BoxEdges, ContactSample, GrainSample};
use gshear_mpi_exchange::Parallel;
use hdf5::H5Type;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Attributes written only when a run ends.
const AT_THE_END: [&str; 3] = ["digest", "speed", "rank_map"];
/// Bytes of frames buffered before they are written, over all ranks.
const BATCH_BYTES: usize = 16 << 20;
/// Rows of the time series buffered before they are written.
const BATCH_ROWS: usize = 1024;
/// Longest time between flushes to disk (s), if batches come as often.
const FLUSH_SECONDS: f64 = 2.0;

/// Bytes of frames of this size (bytes) that wait in memory to be written, over all ranks.
pub fn waiting_bytes(frame: f64) -> f64 {
    (CHUNK_FRAMES as f64 * frame)
        .min(BATCH_BYTES as f64)
        .max(frame)
}

/// `run.h5`, open for writing. Its content does not depend on the number of ranks. Every call is
/// collective.
pub struct TrajectoryWriter {
    // Dropped first: its datasets are not to be closed unless the file is.
    file: H5File,
    columns: Datasets,
    /// Where the run computes scalars of frames.
    scalars: Option<RowTable>,
    path: PathBuf,
    /// In which the part of the file is; empty: the root.
    group: &'static str,
    blocks: IdBlocks,
    /// Number of frames in a batch.
    batch: usize,
    frames: Frames,
    frames_written: u64,
    /// In each table of contacts.
    contacts_written: Vec<u64>,
    flushed: Instant,
}

impl TrajectoryWriter {
    /// Creates the file, replacing an existing one; a part of it is added to that of the same run.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn create(exchange: &dyn Parallel, path: &Path, header: &RunHeader<'_>) -> Result<Self> {
        let _waiting = exchange.waiting();
        let grains = total(exchange, header.grains.len() as u64);
        let mut attributes = named(header.attributes);
        attributes.push(("boundary".into(), header.boundary.name.into()));
        attributes.push(("edges".into(), Attribute::Numbers(header.edges.to_vec())));
        if let Some(columns) = own_columns::text(header.series) {
            attributes.push((own_columns::ATTRIBUTE.into(), Attribute::Text(columns)));
        }
        // HDF5 requires equal arguments.
        let attributes = of_root(exchange, &attributes);
        let author = of_root(exchange, &header.author.to_string());
        let blocks = IdBlocks::of(exchange, grains);
        let id = header.attributes.iter().find(|(name, _)| *name == "run_id");
        let id = id.map(|(_, id)| id);
        let part = Part::of(path);
        let is_added = told_by_root(exchange, || {
            Ok(!part.group.is_empty() && is_of(&part.file, id))
        })?;
        let mut file = if is_added {
            H5File::open(&part.file, exchange)?
        } else {
            // In place of a journal of another run, which would bring that run's metadata back.
            on_root(exchange, || {
                unlink_foreign(&part.file, id)?;
                Journal::of_nothing().write(&part.file)
            })?;
            H5File::create(&part.file, exchange)?
        };
        agree(exchange, file.enter(part.group))?;
        if is_added {
            // To which the file returns until the first flush.
            write_journal(&file, &part.file, exchange)?;
        }
        let created = (|| {
            if is_added {
                file.remove(part.group)?;
                for group in groups_after(part.group) {
                    file.remove(group)?;
                }
            }
            describe(&file, header, &author)?;
            for (name, value) in &attributes {
                file.attribute(PARAMETERS, name, value)?;
            }
            seal(&file)?;
            Datasets::new(&file, OpenMode::Create, grains as usize, header)
        })();
        let columns = agree(exchange, created)?;
        let mut writer = Self::new(file, &part, columns, blocks);
        writer.write_statics(exchange, header)?;
        Ok(writer)
    }

    /// Writes attributes of `parameters` (rank 0's), replacing those of the same names.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn attributes(
        &mut self,
        exchange: &dyn Parallel,
        attributes: &[(&str, Attribute)],
    ) -> Result<()> {
        let mut outcome = CollectiveOutcome::default();
        for (name, value) in of_root(exchange, &named(attributes)) {
            outcome.note(self.file.attribute(PARAMETERS, &name, &value));
        }
        outcome.note(seal(&self.file));
        self.file.agree(exchange, outcome)
    }

    fn new(file: H5File, part: &Part, columns: Datasets, blocks: IdBlocks) -> Self {
        // About two contacts a grain.
        let frame = size_of::<GrainSample>() + 2 * size_of::<ContactSample>();
        TrajectoryWriter {
            contacts_written: vec![0; columns.contacts.len()],
            columns,
            scalars: None,
            file,
            path: part.file.clone(),
            group: part.group,
            blocks,
            batch: (BATCH_BYTES / (frame * blocks.grains as usize).max(1)).clamp(1, CHUNK_FRAMES),
            frames: Frames::default(),
            frames_written: 0,
            flushed: Instant::now(),
        }
    }

    fn write_statics(&mut self, exchange: &dyn Parallel, header: &RunHeader<'_>) -> Result<()> {
        let mut shapes = self.blocks.redistribute(exchange, header.grains, |g| g.id);
        shapes.sort_unstable_by_key(|g| g.id);
        let ids = self.blocks.range(exchange.rank());
        let complete = shapes.iter().map(|g| u64::from(g.id)).eq(ids.clone());
        assert!(complete, "a run's grains are not 0 … N-1");

        let grains = self.blocks.grains as usize;
        let file = &self.file;
        file.reserve(exchange, size_of::<GrainShape>() * grains)?;
        let local = Slab::rows(ids.start, length(&ids), 1);
        let id = shapes.iter().map(|g| match header.ids {
            Some(ids) => ids.of(g.id),
            None => g.id,
        });
        let id: Vec<u32> = id.collect();
        let body: Vec<u8> = shapes.iter().map(|g| g.body as u8).collect();
        let radius: Vec<f64> = shapes.iter().map(|g| g.radius).collect();
        let mass: Vec<f64> = shapes.iter().map(|g| g.mass).collect();
        let material: Vec<u8> = shapes.iter().map(|g| g.material as u8).collect();
        let several = u64::from(material.iter().any(|material| *material > 0));
        let several = total(exchange, several) > 0;
        let root = exchange.rank() == 0;
        let edges = if root { &header.edges[..] } else { &[] };

        let constants = Constants {
            first: ids.start,
            id: &id,
            body: &body,
            material: &material,
            radius: &radius,
            mass: &mass,
            edges,
        };
        let mut sums = constants.checksums().map(|sum| sum as i64);
        exchange.sum(&mut sums);
        let sums = sums.map(|sum| sum as u64);
        let of_root = if root { &sums[..] } else { &[] };
        let places = Slab::rows(0, of_root.len() as u64, 1);

        let mut outcome = CollectiveOutcome::default();
        let checksums = FixedDataset::new(checksums::CONSTANTS, sums.len());
        outcome.note(checksums.write(file, places, of_root));
        let [of_id, of_body, of_species, of_material] =
            ["id", "body", "species", "material"].map(|name| format!("{PARTICLES}/{name}"));
        outcome.note(FixedDataset::new(&of_id, grains).write(file, local, &id));
        outcome.note(FixedDataset::new(&of_body, grains).write(file, local, &body));
        outcome.note(file.link(&of_body, &of_species));
        if several {
            let dataset = FixedDataset::new(&of_material, grains);
            outcome.note(dataset.write(file, local, &material));
        }
        for (column, values) in [(RADIUS, &radius), (MASS, &mass)] {
            let name = format!("{PARTICLES}/{}", column.name);
            let mut dataset = FixedDataset::new(&name, grains);
            if header.units {
                dataset.unit = column.unit_in(header.form.axes);
            }
            outcome.note(dataset.write(file, local, values));
        }
        for table in &mut self.columns.contacts {
            outcome.note(by_root(root, &mut table.offset, 0, &[0u64]));
        }
        self.file.agree(exchange, outcome)?;
        self.flush_file(exchange)
    }

    /// Returns the number of frames so far, buffered ones included.
    pub fn frames(&self) -> u64 {
        self.frames_written + self.frames.len() as u64
    }

    /// Returns the number of rows of the time series so far, buffered ones included.
    pub fn rows(&self) -> u64 {
        self.columns.rows.rows()
    }

    /// Adds the next frame: `edges` of the box (between walls, the diagonal is written), which are
    /// the same on every rank, this rank's grains, and the contacts whose lower id is one of them,
    /// those with flat walls as well, in any order. Together the ranks must give each grain and
    /// each contact once. Frames are buffered and written in batches, so few calls communicate.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn frame(
        &mut self,
        exchange: &dyn Parallel,
        (step, time): (u64, f64),
        edges: &BoxEdges,
        grains: &[GrainSample],
        contacts: &[ContactSample],
    ) -> Result<()> {
        self.frames.push(step, time, edges, grains, contacts);
        if self.frames.len() < self.batch {
            return Ok(());
        }
        self.write_frames(exchange)
    }

    /// Adds the next row of the time series, which must be the same on every rank.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn series(
        &mut self,
        exchange: &dyn Parallel,
        step: u64,
        time: f64,
        row: &impl AsRef<[f64]>,
    ) -> Result<()> {
        let rows = &mut self.columns.rows;
        rows.push(step, time, row.as_ref());
        if rows.waiting() < BATCH_ROWS {
            return Ok(());
        }
        self.write_rows(exchange)
    }

    /// Writes the rows so far to disk if the last flush is two seconds ago: for those who watch a
    /// run whose rows come slowly.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn publish_rows(&mut self, exchange: &dyn Parallel) -> Result<()> {
        if self.is_flush_due(exchange) {
            self.write_rows(exchange)
        } else {
            Ok(())
        }
    }

    /// Starts to write scalars of frames after the first `rows` rows in the file.
    ///
    /// # Errors
    /// `Failure::Input` if the file holds fewer rows; `Failure::Other` if it cannot be written.
    pub fn begin_scalars(&mut self, exchange: &dyn Parallel, rows: u64) -> Result<()> {
        let mut scalars = agree(exchange, layout::scalars(&self.file, rows))?;
        let mut outcome = CollectiveOutcome::default();
        scalars.cut(rows, &mut outcome);
        self.scalars = Some(scalars);
        self.file.agree(exchange, outcome)
    }

    /// Returns the number of rows of scalars so far, buffered ones included; 0 without scalars.
    pub fn scalar_rows(&self) -> u64 {
        self.scalars.as_ref().map_or(0, RowTable::rows)
    }

    /// Adds rows of scalars, which must be the same on every rank. The rows of the time series of
    /// their steps must have been added.
    ///
    /// # Errors
    /// If the file cannot be written.
    ///
    /// # Panics
    /// Before [`Self::begin_scalars`].
    pub fn scalars(&mut self, exchange: &dyn Parallel, rows: &[(u64, FrameScalars)]) -> Result<()> {
        let scalars = self.scalars.as_mut().expect("scalars were begun");
        for (step, row) in rows {
            scalars.push(*step, 0.0, &row.columns());
        }
        if scalars.waiting() < BATCH_ROWS {
            return Ok(());
        }
        self.write_rows(exchange)
    }

    /// Writes all buffers to disk, so that the file can be read and continued even if the program
    /// is killed.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn flush(&mut self, exchange: &dyn Parallel) -> Result<()> {
        let _waiting = exchange.waiting();
        self.write_frames(exchange)?;
        self.write_rows(exchange)?;
        self.flush_file(exchange)?;
        write_journal(&self.file, &self.path, exchange)
    }

    /// Writes all buffers and the attributes of `parameters` known only at the end (rank 0's), and
    /// closes the file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(
        mut self,
        exchange: &dyn Parallel,
        attributes: &[(&str, Attribute)],
    ) -> Result<()> {
        let _waiting = exchange.waiting();
        self.write_frames(exchange)?;
        self.write_rows(exchange)?;
        self.attributes(exchange, attributes)?;
        drop((self.columns, self.scalars));
        self.file.close(exchange)?;
        // The journal is there until the file has been read.
        on_root(exchange, || {
            verify(&self.path, self.group)?;
            journal::remove(&self.path)
        })
    }

    /// Flushes if the last flush was long ago. A flush after every batch would double the cost of
    /// frames in fast runs.
    fn flush_now_and_then(&mut self, exchange: &dyn Parallel) -> Result<()> {
        if self.is_flush_due(exchange) {
            self.flush_file(exchange)
        } else {
            Ok(())
        }
    }

    /// The ranks' clocks differ, but all ranks must decide alike.
    fn is_flush_due(&self, exchange: &dyn Parallel) -> bool {
        exchange.maximum(self.flushed.elapsed().as_secs_f64()) >= FLUSH_SECONDS
    }

    fn flush_file(&mut self, exchange: &dyn Parallel) -> Result<()> {
        let outcome = CollectiveOutcome::of(self.file.flush());
        self.flushed = Instant::now();
        self.file.agree(exchange, outcome)
    }
}

/// Reads a file back that has been written, but for the numbers of its frames, and compares it with
/// its checksums. Not collective.
fn verify(file: &Path, group: &str) -> Result<()> {
    sound::read(file, h5::walk).map_err(|e| miswritten(file, &e))?;
    let part = file.join(group);
    let part = if group.is_empty() { file } else { &part };
    RunFile::open_any(part)
        .map(drop)
        .map_err(|e| miswritten(file, &e))
}

fn miswritten(file: &Path, why: &dyn std::fmt::Display) -> Failure {
    let name = file.display();
    Failure::other(format!("{name}: was not written as it should be: {why}"))
}

/// Keeps the metadata of a flush, to which the file returns if the program is killed.
fn write_journal(file: &H5File, path: &Path, exchange: &dyn Parallel) -> Result<()> {
    let raw = agree(exchange, file.raw_extents())?;
    let written = match exchange.rank() {
        0 => Journal::of(path, raw).and_then(|journal| journal.write(path)),
        _ => Ok(()),
    };
    file.agree(exchange, CollectiveOutcome::of(written))
}

/// Attributes with names of their own.
fn named(attributes: &[(&str, Attribute)]) -> Vec<(String, Attribute)> {
    let own = attributes.iter().cloned();
    own.map(|(name, value)| (name.to_string(), value)).collect()
}

/// Writes the checksum of the attributes of `parameters`, whose texts HDF5 does not protect.
/// Collective.
fn seal(file: &H5File) -> Result<()> {
    let mut attributes = file.attributes(PARAMETERS)?;
    attributes.remove(OF_PARAMETERS);
    let sum = Attribute::Word(of_parameters(&attributes));
    file.attribute(PARAMETERS, OF_PARAMETERS, &sum)
}

/// A one-dimensional dataset of fixed size.
struct FixedDataset<'a> {
    name: &'a str,
    size: usize,
    unit: Option<String>,
}

impl<'a> FixedDataset<'a> {
    /// Of pure numbers.
    fn new(name: &'a str, size: usize) -> Self {
        Self {
            name,
            size,
            unit: None,
        }
    }

    /// Creates it and writes this rank's part. Collective.
    fn write<T: H5Type + Copy>(self, file: &H5File, slab: Slab, data: &[T]) -> Result<()> {
        let dataset = file.dataset(T::type_descriptor(), self.name, &[self.size], None)?;
        let described = match self.unit {
            Some(unit) => dataset.attribute("unit", &Attribute::Word(unit)),
            None => Ok(()),
        };
        described.and(dataset.write(slab, data))
    }
}

#[cfg(test)]
mod tests;
