//! Batches of frames and rows, written by all ranks together.

use super::TrajectoryWriter;
use crate::batch::{BatchShare, BatchShares, Frames, ShareColumns, length};
use crate::checksums::of_clock;
use crate::collective::CollectiveOutcome;
use crate::contact_quantities::numbers;
use crate::h5::Slab;
use crate::h5::by_root;
use crate::layout::{ContactTable, FrameFormat, frame_columns};
use crate::row_table::RowTable;
use gshear_dem::failure::Result;
use gshear_dem::state::{ContactSample, GrainSample};
use gshear_mpi_exchange::Parallel;

/// Of each frame of a batch the numbers of contacts of each table, then the checksums of the
/// columns but the clock. Collective.
fn sums_of(
    exchange: &dyn Parallel,
    part: &ShareColumns,
    share: &BatchShare,
    frames: usize,
    form: FrameFormat,
) -> Vec<i64> {
    let tables = part.contacts.len();
    let width = tables + frame_columns(form).len() - 1;
    let mut sums = vec![0i64; frames * width];
    let of_share = part.checksums(share, form);
    let rows = (sums.chunks_exact_mut(width)).skip(share.frames.start as usize);
    for (f, (row, checksums)) in rows.zip(of_share).enumerate() {
        let (counts, of_columns) = row.split_at_mut(tables);
        for (count, contacts) in counts.iter_mut().zip(&part.contacts) {
            *count = contacts.counts[f];
        }
        for (sum, checksum) in of_columns.iter_mut().zip(checksums) {
            *sum = checksum as i64;
        }
    }
    exchange.sum(&mut sums);
    sums
}

/// The checksums of the frames of a batch with so many tables of contacts. `sums`: [`sums_of`].
fn checksums(frames: &Frames, sums: &[i64], tables: usize, edges: &[f64]) -> Vec<u64> {
    let count = frames.step.len();
    let rows = sums.chunks_exact(sums.len() / count);
    let clock = frames.step.iter().zip(&frames.time);
    let boxes = edges.chunks_exact(edges.len() / count);
    let mut all = Vec::with_capacity(sums.len());
    for ((row, (&step, &time)), edges) in rows.zip(clock).zip(boxes) {
        all.push(of_clock(step, time, edges));
        all.extend(row[tables..].iter().map(|&sum| sum as u64));
    }
    all
}

/// Where the contacts of a batch are in a table.
struct ContactPlace {
    /// Row of this rank's first contact.
    begin: u64,
    /// Number of its contacts.
    own: u64,
    /// The row after the last contact of each frame.
    ends: Vec<u64>,
}

impl ContactPlace {
    /// The row after the last contact.
    fn end(&self) -> u64 {
        *self.ends.last().expect("a batch has frames")
    }
}

impl TrajectoryWriter {
    pub(super) fn write_frames(&mut self, exchange: &dyn Parallel) -> Result<()> {
        let count = self.frames.len() as u64;
        if count == 0 {
            return Ok(());
        }
        let _waiting = exchange.waiting();
        let shares = BatchShares {
            frames: count,
            grains: self.blocks.grains,
            ranks: self.blocks.ranks,
        };
        let messages = exchange.all_to_all(self.frames.messages(&shares));
        let share = shares.of(exchange.rank());
        let form = self.columns.form;
        let part = ShareColumns::assemble(&messages, &share, self.blocks.grains, form);
        drop(messages);
        let sums = sums_of(exchange, &part, &share, count as usize, form);
        let tables = part.contacts.len();
        // Shares follow each other in the order of the file, so a rank's contacts are contiguous.
        let mut places = Vec::new();
        for (k, contacts) in part.contacts.iter().enumerate() {
            let before = self.contacts_written[k];
            let own = contacts.i.len() as u64;
            let counts = sums.iter().skip(k).step_by(sums.len() / count as usize);
            let ends = counts.scan(before, |end, count| {
                *end += *count as u64;
                Some(*end)
            });
            places.push(ContactPlace {
                begin: before + exchange.sum_below(own),
                own,
                ends: ends.collect(),
            });
        }

        let (before, after) = (self.frames_written, self.frames_written + count);
        let block = Slab {
            start: [before + share.frames.start, share.ids.start, 0],
            count: [length(&share.frames), length(&share.ids), 3],
        };
        let after_contacts: Vec<u64> = places.iter().map(ContactPlace::end).collect();
        let contacts =
            after_contacts.iter().sum::<u64>() - self.contacts_written.iter().sum::<u64>();
        let bytes = count * self.blocks.grains * size_of::<GrainSample>() as u64
            + contacts * size_of::<ContactSample>() as u64;
        self.file.reserve(exchange, bytes as usize)?;
        let root = exchange.rank() == 0;
        let columns = &mut self.columns;
        let mut outcome = CollectiveOutcome::default();
        let mut grains = columns.grains.iter_mut();
        for (values, column) in part.values.iter().zip(grains.by_ref()) {
            outcome.note(column.append(after, block, values));
        }
        if let Some(column) = grains.next() {
            outcome.note(column.append(after, block, &part.image));
        }
        if let Some(column) = grains.next() {
            outcome.note(column.append(after, block, &part.removed));
        }
        let tables_of = ContactTable::of(form).zip(&mut columns.contacts);
        for ((table, datasets), (contacts, place)) in
            tables_of.zip(part.contacts.iter().zip(&places))
        {
            let (end, rows) = (place.end(), |width| {
                Slab::rows(place.begin, place.own, width)
            });
            let mut datasets_of = datasets.columns.iter_mut();
            let mut next = || datasets_of.next().expect("a dataset of each quantity");
            outcome.note(next().append(end, rows(1), &contacts.i));
            outcome.note(match table {
                ContactTable::Grains => next().append(end, rows(1), &contacts.j),
                ContactTable::Walls => {
                    let walls = contacts.walls(self.blocks.grains);
                    next().append(end, rows(1), &walls)
                }
            });
            for (values, quantity) in contacts.forces.iter().zip(numbers(form)) {
                let rows = rows(quantity.width(form) as u64);
                outcome.note(next().append(end, rows, values));
            }
            for flags in &contacts.flags {
                outcome.note(next().append(end, rows(1), flags));
            }
            outcome.note(by_root(root, &mut datasets.offset, before + 1, &place.ends));
        }
        outcome.note(by_root(root, &mut columns.step, before, &self.frames.step));
        outcome.note(by_root(root, &mut columns.time, before, &self.frames.time));
        let of_box = columns.edges.row_length();
        let edges = self.frames.edges_as_stored(of_box);
        let slab = Slab {
            start: [before, 0, 0],
            count: [if root { count } else { 0 }, 3, 3],
        };
        let local = if root { &edges[..] } else { &[] };
        outcome.note(columns.edges.append(after, slab, local));
        let mut sums_of_frames = Vec::new();
        if root {
            sums_of_frames = checksums(&self.frames, &sums, tables, &edges);
        }
        let width = frame_columns(form).len();
        let rows = (sums_of_frames.len() / width) as u64;
        let rows = Slab::rows(before, rows, width as u64);
        outcome.note(columns.frame_sums.append(after, rows, &sums_of_frames));
        self.file.agree(exchange, outcome)?;
        (self.frames_written, self.contacts_written) = (after, after_contacts);
        self.frames.clear();
        self.flush_now_and_then(exchange)
    }

    pub(super) fn write_rows(&mut self, exchange: &dyn Parallel) -> Result<()> {
        let scalars = self.scalars.as_ref().map_or(0, RowTable::bytes);
        let bytes = self.columns.rows.bytes() + scalars;
        if bytes == 0 {
            return Ok(());
        }
        let _waiting = exchange.waiting();
        self.file.reserve(exchange, bytes)?;
        let mut outcome = CollectiveOutcome::default();
        let tables = [&mut self.columns.rows].into_iter();
        for table in tables.chain(&mut self.scalars) {
            table.write(exchange.rank() == 0, &mut outcome);
        }
        self.file.agree(exchange, outcome)?;
        self.flush_now_and_then(exchange)
    }
}
