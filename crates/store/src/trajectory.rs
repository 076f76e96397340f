//! The writer of `run.h5`: frames and time series, written by all ranks together in batches.

use super::batch::{Frames, ShareColumns, Shares, length};
use super::checksums::{self, OF_PARAMETERS, of_clock, of_parameters, of_row};
use super::collective::{CollectiveOutcome, IdBlocks, agree, records_of};
use super::existing::inspect;
use super::h5::{Attribute, Dataset, H5File, Slab};
use super::journal::{self, Journal};
use super::layout::{
    CHUNK_FRAMES, Datasets, Layout, MASS, Mode, PARAMETERS, PARTICLES, RADIUS, by_root, describe,
    forces, frame_columns,
};
use super::scalar_columns::ScalarColumns;
use bytemuck::{Pod, Zeroable};
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_dem::columns::Column;
use gshear_dem::domain::total;
use gshear_dem::failure::Failure;
use gshear_dem::state::{BoxEdges, ContactSample, GrainSample, GrainState};
use gshear_mpi_exchange::Parallel;
use hdf5::H5Type;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The constant properties of a grain.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct GrainShape {
    /// Number of the grain, 0 … N-1.
    pub id: u32,
    /// 0 free, 1 bottom wall, 2 top wall.
    pub body: u32,
    /// R (m).
    pub radius: f64,
    /// m (kg; kg/m in 2D).
    pub mass: f64,
}

impl GrainShape {
    /// The constant properties of a grain in this state. `mass`: m (kg; kg/m in 2D).
    pub fn new(grain: &GrainState, mass: f64) -> Self {
        Self {
            id: grain.id,
            body: grain.body,
            radius: grain.radius,
            mass,
        }
    }
}

/// Content of `run.h5` from the start of the run.
#[derive(Debug, Clone, Copy)]
pub struct RunHeader<'a> {
    /// Number of dimensions.
    pub axes: usize,
    /// Whether the box is bounded along its last axis.
    pub walls: bool,
    /// Columns of the time series.
    pub series: &'a [Column],
    /// L_x, height at the start of the shear, 0; in three dimensions L_x, L_y, height (m).
    pub edges: [f64; 3],
    /// Who made the run; rank 0's is written.
    pub author: &'a str,
    /// Unit of the tangential history in 3D.
    pub history_unit: &'static str,
    /// This rank's grains; together the ranks hold each of the ids 0 … N-1 once.
    pub grains: &'a [GrainShape],
    /// Attributes of `parameters`; rank 0's are written.
    pub attributes: &'a [(&'a str, Attribute)],
}

/// Attributes written only when a run ends.
const AT_THE_END: [&str; 3] = ["digest", "speed", "rank_map"];
/// Bytes of frames buffered before they are written, over all ranks.
const BATCH_BYTES: usize = 16 << 20;
/// Rows of the time series buffered before they are written.
const BATCH_ROWS: usize = 1024;
/// Longest time between flushes to disk (s), if batches come as often.
const FLUSH_SECONDS: f64 = 2.0;

/// `run.h5`, open for writing. Its content does not depend on the number of ranks. Every call is
/// collective.
pub struct TrajectoryWriter {
    columns: Datasets,
    /// Where the run computes scalars of frames.
    scalars: Option<ScalarColumns>,
    file: H5File,
    path: PathBuf,
    blocks: IdBlocks,
    /// Number of frames in a batch.
    batch: usize,
    frames: Frames,
    rows: Vec<(u64, f64, Vec<f64>)>,
    frames_written: u64,
    contacts_written: u64,
    rows_written: u64,
    flushed: Instant,
}

impl TrajectoryWriter {
    /// Creates the file, replacing an existing one.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn create(
        exchange: &dyn Parallel,
        path: &Path,
        header: &RunHeader<'_>,
    ) -> Result<Self, Failure> {
        let _waiting = exchange.waiting();
        let grains = total(exchange, header.grains.len() as u64);
        let mut attributes = Vec::new();
        for (name, value) in header.attributes {
            attributes.push((name.to_string(), value.clone()));
        }
        attributes.push(("edges".into(), Attribute::Numbers(header.edges.to_vec())));
        let attributes = shared(exchange, attributes);
        let author = exchange.broadcast(header.author.into());
        let author = String::from_utf8_lossy(&author);
        let blocks = IdBlocks {
            grains,
            ranks: exchange.size() as u64,
        };
        // One of another run would bring that run's metadata back.
        let removed = match exchange.rank() {
            0 => journal::remove(path),
            _ => Ok(()),
        };
        agree(exchange, removed)?;
        let created = (|| {
            let file = H5File::create(path, exchange)?;
            let layout = Layout {
                grains: grains as usize,
                axes: header.axes,
                walls: header.walls,
                series: header.series,
                // Scenes of a periodic box may use any consistent set of units.
                units: header.walls,
                history_unit: header.history_unit,
            };
            describe(&file, &layout, &author)?;
            for (name, value) in &attributes {
                file.attribute(PARAMETERS, name, value)?;
            }
            seal(&file)?;
            let columns = Datasets::new(&file, Mode::Create, &layout)?;
            Ok((file, columns))
        })();
        let (file, columns) = agree(exchange, created)?;
        let mut writer = Self::new(file, path, columns, blocks);
        writer.write_statics(exchange, header)?;
        Ok(writer)
    }

    /// Opens an existing file to continue after its first `frames` frames and `rows` rows; later
    /// ones are removed. `series`: columns of the time series.
    ///
    /// # Errors
    /// [`Failure::Input`] if the file is not a `run.h5` or holds less.
    pub fn open_to_append(
        exchange: &dyn Parallel,
        path: &Path,
        series: &[Column],
        frames: u64,
        rows: u64,
    ) -> Result<Self, Failure> {
        let _waiting = exchange.waiting();
        // Only one rank inspects the file: after a failure in a collective call the others could
        // wait for ever.
        let mut extent = Vec::new();
        let looked = match exchange.rank() {
            0 => inspect(path, series, frames, rows).map(|e| extent = e.to_vec()),
            _ => Ok(()),
        };
        agree(exchange, looked)?;
        let extent = exchange.broadcast(bytemuck::cast_slice(&extent).to_vec());
        let extent: Vec<u64> = records_of(&extent).collect();
        let [grains, contacts, axes] = extent[..] else {
            unreachable!("three numbers were sent")
        };

        let blocks = IdBlocks {
            grains,
            ranks: exchange.size() as u64,
        };
        let opened = (|| {
            let file = H5File::open(path, exchange)?;
            let layout = Layout {
                grains: grains as usize,
                axes: axes as usize,
                series,
                // They matter only to new datasets.
                walls: true,
                units: false,
                history_unit: "",
            };
            let columns = Datasets::new(&file, Mode::Open, &layout)?;
            Ok((file, columns))
        })();
        let (file, columns) = agree(exchange, opened)?;
        let mut writer = Self::new(file, path, columns, blocks);
        (
            writer.frames_written,
            writer.contacts_written,
            writer.rows_written,
        ) = (frames, contacts, rows);
        // A file that was closed has no journal, and a kill while it is cut would damage it.
        writer.write_journal(exchange)?;
        let mut outcome = CollectiveOutcome::default();
        for name in AT_THE_END {
            outcome.note(writer.file.remove_attribute(PARAMETERS, name));
        }
        outcome.note(seal(&writer.file));
        let columns = &mut writer.columns;
        outcome.note(columns.offset.resize(frames + 1));
        outcome.note(columns.step.resize(frames));
        outcome.note(columns.time.resize(frames));
        if let Some(edges) = &mut columns.edges {
            outcome.note(edges.resize(frames));
        }
        if let Some(image) = &mut columns.image {
            outcome.note(image.resize(frames));
        }
        columns
            .values
            .iter_mut()
            .for_each(|c| outcome.note(c.resize(frames)));
        outcome.note(columns.i.resize(contacts));
        outcome.note(columns.j.resize(contacts));
        columns
            .forces
            .iter_mut()
            .for_each(|c| outcome.note(c.resize(contacts)));
        outcome.note(columns.sliding.resize(contacts));
        outcome.note(columns.row_step.resize(rows));
        outcome.note(columns.row_time.resize(rows));
        columns
            .observables
            .iter_mut()
            .for_each(|c| outcome.note(c.resize(rows)));
        if let Some(checksums) = &mut columns.checksums {
            outcome.note(checksums.frames.resize(frames));
            outcome.note(checksums.rows.resize(rows));
        }
        writer.file.agree(exchange, outcome)?;
        writer.flush_file(exchange)?;
        // The space of removed rows may be used again, which the last journal does not know.
        writer.write_journal(exchange)?;
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
    ) -> Result<(), Failure> {
        let attributes = attributes
            .iter()
            .map(|(name, value)| (name.to_string(), value.clone()));
        let mut outcome = CollectiveOutcome::default();
        for (name, value) in shared(exchange, attributes.collect()) {
            outcome.note(self.file.attribute(PARAMETERS, &name, &value));
        }
        outcome.note(seal(&self.file));
        self.file.agree(exchange, outcome)
    }

    fn new(file: H5File, path: &Path, columns: Datasets, blocks: IdBlocks) -> Self {
        // About two contacts a grain.
        let frame = size_of::<GrainSample>() + 2 * size_of::<ContactSample>();
        TrajectoryWriter {
            columns,
            scalars: None,
            file,
            path: path.into(),
            blocks,
            batch: (BATCH_BYTES / (frame * blocks.grains as usize).max(1)).clamp(1, CHUNK_FRAMES),
            frames: Frames::default(),
            rows: Vec::new(),
            frames_written: 0,
            contacts_written: 0,
            rows_written: 0,
            flushed: Instant::now(),
        }
    }

    fn write_statics(
        &mut self,
        exchange: &dyn Parallel,
        header: &RunHeader<'_>,
    ) -> Result<(), Failure> {
        let mut shapes = self.blocks.redistribute(exchange, header.grains, |g| g.id);
        shapes.sort_unstable_by_key(|g| g.id);
        let ids = self.blocks.range(exchange.rank());
        let complete = shapes.iter().map(|g| u64::from(g.id)).eq(ids.clone());
        assert!(complete, "a run's grains are not 0 … N-1");

        self.file.reserve(
            exchange,
            size_of::<GrainShape>() * self.blocks.grains as usize,
        )?;
        let file = &self.file;
        let grains = self.blocks.grains as usize;
        let name = |part: &str| format!("{PARTICLES}/{part}");
        let local = Slab::rows(ids.start, length(&ids), 1);
        let id: Vec<u32> = shapes.iter().map(|g| g.id).collect();
        let body: Vec<u8> = shapes.iter().map(|g| g.body as u8).collect();
        let radius: Vec<f64> = shapes.iter().map(|g| g.radius).collect();
        let mass: Vec<f64> = shapes.iter().map(|g| g.mass).collect();
        let root = exchange.rank() == 0;
        let edges = if root { &header.edges[..] } else { &[] };

        let mut sums = checksums::of_constants(ids.start, &id, &body, [&radius, &mass], edges)
            .map(|sum| sum as i64);
        exchange.sum(&mut sums);
        let sums = sums.map(|sum| sum as u64);
        let of_root = if root { &sums[..] } else { &[] };
        let places = Slab::rows(0, of_root.len() as u64, 1);

        let mut outcome = CollectiveOutcome::default();
        outcome.note(fixed(
            file,
            checksums::CONSTANTS,
            sums.len(),
            places,
            of_root,
        ));
        let numbers = |column: &Column, values: &[f64]| {
            let unit = column.unit_in(header.axes).filter(|_| header.walls);
            fixed_in_units(file, &name(column.name), grains, local, values, unit)
        };
        outcome.note(fixed(file, &name("id"), grains, local, &id));
        outcome.note(fixed(file, &name("body"), grains, local, &body));
        outcome.note(file.link(&name("body"), &name("species")));
        outcome.note(numbers(&RADIUS, &radius));
        outcome.note(numbers(&MASS, &mass));
        outcome.note(by_root(root, &mut self.columns.offset, 0, &[0]));
        self.file.agree(exchange, outcome)?;
        self.flush_file(exchange)
    }

    /// Returns the number of frames so far, buffered ones included.
    pub fn frames(&self) -> u64 {
        self.frames_written + self.frames.len() as u64
    }

    /// Returns the number of rows of the time series so far, buffered ones included.
    pub fn rows(&self) -> u64 {
        self.rows_written + self.rows.len() as u64
    }

    /// Adds the next frame: `edges` of the box (between walls, the diagonal is written), which are
    /// the same on every rank, this rank's grains, and the contacts whose lower id is one of them, in
    /// any order. Together the ranks must give each grain and each contact once. Frames are
    /// buffered and written in batches, so few calls communicate.
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
    ) -> Result<(), Failure> {
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
    ) -> Result<(), Failure> {
        self.rows.push((step, time, row.as_ref().to_vec()));
        if self.rows.len() < BATCH_ROWS {
            return Ok(());
        }
        self.write_rows(exchange)
    }

    /// Starts to write scalars of frames after the first `rows` rows in the file.
    ///
    /// # Errors
    /// [`Failure::Input`] if the file holds fewer rows; [`Failure::Other`] if it cannot be written.
    pub fn begin_scalars(&mut self, exchange: &dyn Parallel, rows: u64) -> Result<(), Failure> {
        let scalars = ScalarColumns::new(&self.file, rows);
        self.scalars = Some(agree(exchange, scalars)?);
        Ok(())
    }

    /// Returns the number of rows of scalars so far, buffered ones included; 0 without scalars.
    pub fn scalar_rows(&self) -> u64 {
        self.scalars.as_ref().map_or(0, ScalarColumns::rows)
    }

    /// Adds rows of scalars, which must be the same on every rank. The rows of the time series of
    /// their steps must have been added.
    ///
    /// # Errors
    /// If the file cannot be written.
    ///
    /// # Panics
    /// Before [`Self::begin_scalars`].
    pub fn scalars(
        &mut self,
        exchange: &dyn Parallel,
        rows: &[(u64, FrameScalars)],
    ) -> Result<(), Failure> {
        let scalars = self.scalars.as_mut().expect("scalars were begun");
        scalars.push(rows);
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
    pub fn flush(&mut self, exchange: &dyn Parallel) -> Result<(), Failure> {
        let _waiting = exchange.waiting();
        self.write_frames(exchange)?;
        self.write_rows(exchange)?;
        self.flush_file(exchange)?;
        self.write_journal(exchange)
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
    ) -> Result<(), Failure> {
        let _waiting = exchange.waiting();
        self.write_frames(exchange)?;
        self.write_rows(exchange)?;
        self.attributes(exchange, attributes)?;
        drop((self.columns, self.scalars));
        agree(exchange, self.file.close())?;
        let removed = match exchange.rank() {
            0 => journal::remove(&self.path),
            _ => Ok(()),
        };
        agree(exchange, removed)
    }

    fn write_frames(&mut self, exchange: &dyn Parallel) -> Result<(), Failure> {
        let count = self.frames.len() as u64;
        if count == 0 {
            return Ok(());
        }
        let _waiting = exchange.waiting();
        let shares = Shares {
            frames: count,
            grains: self.blocks.grains,
            ranks: self.blocks.ranks,
        };
        let messages = exchange.all_to_all(self.frames.messages(&shares));
        let share = shares.of(exchange.rank());
        let part = ShareColumns::assemble(&messages, &share, self.columns.axes);
        drop(messages);

        // Shares follow each other in the order of the file, so a rank's contacts are contiguous.
        let first = share.frames.start as usize;
        let width = frame_columns(self.columns.axes).len();
        // Per frame the number of contacts, then the checksums.
        let mut sums = vec![0i64; count as usize * width];
        let of_share = part.checksums(&share, self.columns.axes);
        let rows = sums.chunks_exact_mut(width).skip(first);
        for ((row, contacts), checksums) in rows.zip(&part.counts).zip(of_share) {
            row[0] = *contacts;
            for (sum, checksum) in row[1..].iter_mut().zip(checksums) {
                *sum = checksum as i64;
            }
        }
        exchange.sum(&mut sums);
        let counts = sums.chunks_exact(width).map(|row| row[0]);
        let begin = self.contacts_written + exchange.sum_below(part.i.len() as u64);
        let of_width = |width: usize| Slab::rows(begin, part.i.len() as u64, width as u64);
        let stretch = of_width(1);
        let mut end = self.contacts_written;
        let mut ends = Vec::with_capacity(count as usize);
        for count in counts {
            end += count as u64;
            ends.push(end);
        }

        let (before, after) = (self.frames_written, self.frames_written + count);
        let block = Slab {
            start: [before + share.frames.start, share.ids.start, 0],
            count: [length(&share.frames), length(&share.ids), 3],
        };
        let contacts = end - self.contacts_written;
        let bytes = count * self.blocks.grains * size_of::<GrainSample>() as u64
            + contacts * size_of::<ContactSample>() as u64;
        self.file.reserve(exchange, bytes as usize)?;
        let root = exchange.rank() == 0;
        let columns = &mut self.columns;
        let mut outcome = CollectiveOutcome::default();
        for (column, values) in columns.values.iter_mut().zip(&part.values) {
            outcome.note(column.append(after, block, values));
        }
        if let Some(image) = &mut columns.image {
            outcome.note(image.append(after, block, &part.image));
        }
        outcome.note(columns.i.append(end, stretch, &part.i));
        outcome.note(columns.j.append(end, stretch, &part.j));
        let forces = forces(columns.axes);
        for ((column, values), (_, width)) in
            columns.forces.iter_mut().zip(&part.forces).zip(forces)
        {
            outcome.note(column.append(end, of_width(*width), values));
        }
        outcome.note(columns.sliding.append(end, stretch, &part.sliding));
        outcome.note(by_root(root, &mut columns.step, before, &self.frames.step));
        outcome.note(by_root(root, &mut columns.time, before, &self.frames.time));
        outcome.note(by_root(root, &mut columns.offset, before + 1, &ends));
        let of_box = columns.edges.as_ref().map_or(0, Dataset::row_length);
        let edges: Vec<f64> = match of_box {
            0 => Vec::new(),
            3 => (self.frames.edges.iter())
                .flat_map(|edges| std::array::from_fn::<_, 3, _>(|axis| edges[axis][axis]))
                .collect(),
            _ => self.frames.edges.as_flattened().as_flattened().to_vec(),
        };
        if let Some(column) = &mut columns.edges {
            let slab = Slab {
                start: [before, 0, 0],
                count: [if root { count } else { 0 }, 3, 3],
            };
            let local = if root { &edges[..] } else { &[] };
            outcome.note(column.append(after, slab, local));
        }
        if let Some(checksums) = &mut columns.checksums {
            let clock = self.frames.step.iter().zip(&self.frames.time);
            let rows = sums.chunks_exact(width).zip(clock);
            // A file of an earlier version may have fewer columns.
            let stored = checksums.frames.row_length();
            let mut sums = Vec::new();
            for (t, (row, (&step, &time))) in rows.enumerate().filter(|_| root) {
                sums.push(of_clock(step, time, &edges[t * of_box..][..of_box]));
                sums.extend(row[1..stored].iter().map(|&sum| sum as u64));
            }
            let rows = Slab::rows(before, (sums.len() / stored) as u64, stored as u64);
            outcome.note(checksums.frames.append(after, rows, &sums));
        }
        self.file.agree(exchange, outcome)?;
        (self.frames_written, self.contacts_written) = (after, end);
        self.frames.clear();
        self.flush_now_and_then(exchange)
    }

    /// Flushes if the last flush was long ago. A flush after every batch would double the cost of
    /// frames in fast runs.
    fn flush_now_and_then(&mut self, exchange: &dyn Parallel) -> Result<(), Failure> {
        // The ranks' clocks differ, but all ranks must decide alike.
        if exchange.maximum(self.flushed.elapsed().as_secs_f64()) < FLUSH_SECONDS {
            return Ok(());
        }
        self.flush_file(exchange)
    }

    fn flush_file(&mut self, exchange: &dyn Parallel) -> Result<(), Failure> {
        let mut outcome = CollectiveOutcome::default();
        outcome.note(self.file.flush());
        self.flushed = Instant::now();
        self.file.agree(exchange, outcome)
    }

    /// Keeps the metadata of this flush, to which the file returns if the program is killed.
    fn write_journal(&mut self, exchange: &dyn Parallel) -> Result<(), Failure> {
        let raw = agree(exchange, self.file.raw_extents())?;
        let written = match exchange.rank() {
            0 => Journal::of(&self.path, raw).and_then(|journal| journal.write(&self.path)),
            _ => Ok(()),
        };
        let mut outcome = CollectiveOutcome::default();
        outcome.note(written);
        self.file.agree(exchange, outcome)
    }

    fn write_rows(&mut self, exchange: &dyn Parallel) -> Result<(), Failure> {
        let scalars = self.scalars.as_ref().map_or(0, ScalarColumns::waiting);
        if self.rows.is_empty() && scalars == 0 {
            return Ok(());
        }
        let _waiting = exchange.waiting();
        let rows = std::mem::take(&mut self.rows);
        let numbers = rows.iter().map(|(_, _, row)| 2 + row.len()).sum::<usize>();
        let of_scalars = scalars * size_of::<FrameScalars>();
        self.file.reserve(exchange, 8 * numbers + of_scalars)?;
        let root = exchange.rank() == 0;
        let before = self.rows_written;
        let columns = &mut self.columns;
        let mut outcome = CollectiveOutcome::default();
        let step: Vec<u64> = rows.iter().map(|r| r.0).collect();
        outcome.note(by_root(root, &mut columns.row_step, before, &step));
        let time: Vec<f64> = rows.iter().map(|r| r.1).collect();
        outcome.note(by_root(root, &mut columns.row_time, before, &time));
        for (n, column) in columns.observables.iter_mut().enumerate() {
            let values: Vec<f64> = rows.iter().map(|r| r.2[n]).collect();
            outcome.note(by_root(root, column, before, &values));
        }
        if let Some(checksums) = &mut columns.checksums {
            let sum = |(step, time, row): &(u64, f64, Vec<f64>)| {
                let names = columns.names.iter().copied();
                of_row(*step, *time, names.zip(row.iter().copied()))
            };
            let sums: Vec<u64> = rows.iter().map(sum).collect();
            outcome.note(by_root(root, &mut checksums.rows, before, &sums));
        }
        if let Some(scalars) = &mut self.scalars {
            scalars.write(root, &mut outcome);
        }
        self.file.agree(exchange, outcome)?;
        self.rows_written += rows.len() as u64;
        self.flush_now_and_then(exchange)
    }
}

/// Returns rank 0's attributes on every rank, because HDF5 requires equal arguments.
fn shared(
    exchange: &dyn Parallel,
    attributes: Vec<(String, Attribute)>,
) -> Vec<(String, Attribute)> {
    let bytes = serde_json::to_vec(&attributes).expect("attributes are texts and finite numbers");
    serde_json::from_slice(&exchange.broadcast(bytes))
        .expect("attributes are texts and finite numbers")
}

/// Writes the checksum of the attributes of `parameters`, whose texts HDF5 does not protect.
/// Collective.
fn seal(file: &H5File) -> Result<(), Failure> {
    let mut attributes = file.attributes(PARAMETERS)?;
    attributes.remove(OF_PARAMETERS);
    let sum = Attribute::Word(of_parameters(&attributes));
    file.attribute(PARAMETERS, OF_PARAMETERS, &sum)
}

/// Writes a one-dimensional dataset of fixed size.
fn fixed<T: H5Type + Copy>(
    file: &H5File,
    name: &str,
    size: usize,
    slab: Slab,
    data: &[T],
) -> Result<(), Failure> {
    file.dataset::<T>(name, &[size], None)?.write(slab, data)
}

/// Writes a dataset of numbers with their unit.
fn fixed_in_units(
    file: &H5File,
    name: &str,
    size: usize,
    slab: Slab,
    data: &[f64],
    unit: Option<String>,
) -> Result<(), Failure> {
    let dataset = file.dataset(name, &[size], None)?;
    let described = unit.map_or(Ok(()), |unit| {
        dataset.attribute("unit", &Attribute::Word(unit))
    });
    described.and(dataset.write(slab, data))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::OBSERVABLES;
    use crate::run_reader::RunFile;
    use gshear_dem::domain::Solo;
    use gshear_dem::state::SeriesRow;

    fn row(k: u64) -> SeriesRow {
        SeriesRow::from_columns(std::array::from_fn(|c| (100 * k + c as u64) as f64))
    }

    /// A file with the rows `0..rows` and one frame of one grain.
    fn create(path: &Path, rows: u64) {
        let grains = [GrainShape {
            id: 0,
            body: 0,
            radius: 1.0,
            mass: 1.0,
        }];
        let header = RunHeader {
            axes: 2,
            walls: true,
            series: &SeriesRow::COLUMNS,
            edges: [2.0, 3.0, 0.0],
            author: "the test",
            history_unit: "N",
            grains: &grains,
            attributes: &[("scene", "seed = 1".into())],
        };
        let mut writer = TrajectoryWriter::create(&Solo, path, &header).unwrap();
        let grain = GrainSample::zeroed();
        let edges = [[0.0; 3]; 3];
        writer
            .frame(&Solo, (0, 0.0), &edges, &[grain], &[])
            .unwrap();
        (0..rows).for_each(|k| writer.series(&Solo, k, k as f64, &row(k)).unwrap());
        writer.finish(&Solo, &[]).unwrap();
    }

    /// Gives columns other names, or takes them away (`None`).
    /// As an earlier version wrote it, without checksums.
    fn rename(path: &Path, names: &[(&str, Option<&str>)]) {
        let file = hdf5::File::open_rw(path).unwrap();
        if file.link_exists(checksums::GROUP) {
            file.unlink(checksums::GROUP).unwrap();
        }
        let group = file.group(OBSERVABLES).unwrap();
        for (from, to) in names {
            match to {
                Some(to) => group.relink(from, to).unwrap(),
                None => group.unlink(from).unwrap(),
            }
        }
    }

    fn append(path: &Path, frames: u64, rows: u64) -> Result<TrajectoryWriter, Failure> {
        TrajectoryWriter::open_to_append(&Solo, path, &SeriesRow::COLUMNS, frames, rows)
    }

    #[test]
    fn files_with_former_names_are_read_and_continued() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.h5");
        create(&path, 3);
        let formers: Vec<_> = SeriesRow::COLUMNS
            .iter()
            .filter_map(|column| Some((column.name, Some(column.former?))))
            .collect();
        rename(&path, &formers);
        let mut writer = append(&path, 1, 2).unwrap();
        (2..5).for_each(|k| writer.series(&Solo, k, k as f64, &row(k)).unwrap());
        writer.finish(&Solo, &[]).unwrap();

        let run = RunFile::open(&path).unwrap();
        assert_eq!(run.series().step, [0, 1, 2, 3, 4]);
        for (c, column) in SeriesRow::COLUMNS.iter().enumerate() {
            let values: Vec<f64> = (0..5).map(|k| row(k).columns()[c]).collect();
            assert_eq!(run.series().column(column.name), values, "{column}");
        }
        let file = hdf5::File::open(&path).unwrap();
        for (present, former) in formers {
            assert!(file.link_exists(&format!("{OBSERVABLES}/{}", former.unwrap())));
            assert!(!file.link_exists(&format!("{OBSERVABLES}/{present}")));
        }
    }

    #[test]
    fn a_file_of_other_columns_is_not_continued() {
        let folder = tempfile::tempdir().unwrap();
        let refused = |from: &str, to: Option<&str>| {
            let path = folder.path().join("run.h5");
            create(&path, 3);
            rename(&path, &[(from, to)]);
            match append(&path, 1, 3) {
                Err(Failure::Input(message)) => message,
                _ => panic!("not refused"),
            }
        };
        assert!(refused("slip_rate", None).contains("no column slip_rate"));
        assert!(refused("strain", None).contains("no column strain"));
        assert!(refused("slip", Some("offset")).contains("no column slip;"));
        let path = folder.path().join("run.h5");
        create(&path, 3);
        let group = hdf5::File::open_rw(&path)
            .unwrap()
            .group(OBSERVABLES)
            .unwrap();
        group.create_group("temperature").unwrap();
        group.create_group("gshear").unwrap();
        drop(group);
        let message = append(&path, 1, 3).err().unwrap().to_string();
        assert!(message.contains("its column temperature"), "{message}");
    }

    #[test]
    fn values_have_units_per_unit_depth() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.h5");
        create(&path, 1);
        let file = hdf5::File::open(&path).unwrap();
        let unit = |name: &str| {
            let values = file
                .dataset(&format!("{OBSERVABLES}/{name}/value"))
                .unwrap();
            let unit = values.attr("unit").ok()?;
            Some(unit.read_scalar::<crate::h5::Word>().unwrap().to_string())
        };
        assert_eq!(unit("slip_rate").as_deref(), Some("m s-1"));
        assert_eq!(unit("work_load").as_deref(), Some("J m-1"));
        assert_eq!(unit("strain"), None);
    }
}
