//! Batches of frames and rows, written by all ranks together.

use super::TrajectoryWriter;
use crate::batch::{BatchShare, BatchShares, Frames, ShareColumns, length};
use crate::checksums::of_clock;
use crate::collective::CollectiveOutcome;
use crate::contact_quantities::numbers;
use crate::h5::Slab;
use crate::h5::by_root;
use crate::layout::{FrameFormat, frame_columns};
use crate::row_table::RowTable;
use gshear_dem::failure::Result;
use gshear_dem::state::{ContactSample, GrainSample};
use gshear_mpi_exchange::Parallel;

/// Of each frame of a batch the number of contacts, then the checksums of the columns. Collective.
fn sums_of(
    exchange: &dyn Parallel,
    part: &ShareColumns,
    share: &BatchShare,
    frames: usize,
    form: FrameFormat,
) -> Vec<i64> {
    let width = frame_columns(form).len();
    let mut sums = vec![0i64; frames * width];
    let of_share = part.checksums(share, form);
    let rows = (sums.chunks_exact_mut(width)).skip(share.frames.start as usize);
    for ((row, contacts), checksums) in rows.zip(&part.counts).zip(of_share) {
        row[0] = *contacts;
        for (sum, checksum) in row[1..].iter_mut().zip(checksums) {
            *sum = checksum as i64;
        }
    }
    exchange.sum(&mut sums);
    sums
}

/// The checksums of the frames of a batch. `sums`: [`sums_of`].
fn checksums(frames: &Frames, sums: &[i64], edges: &[f64]) -> Vec<u64> {
    let count = frames.step.len();
    let rows = sums.chunks_exact(sums.len() / count);
    let clock = frames.step.iter().zip(&frames.time);
    let boxes = edges.chunks_exact(edges.len() / count);
    let mut all = Vec::with_capacity(sums.len());
    for ((row, (&step, &time)), edges) in rows.zip(clock).zip(boxes) {
        all.push(of_clock(step, time, edges));
        all.extend(row[1..].iter().map(|&sum| sum as u64));
    }
    all
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
        let part = ShareColumns::assemble(&messages, &share, form);
        drop(messages);
        let width = frame_columns(form).len();
        let sums = sums_of(exchange, &part, &share, count as usize, form);
        // Shares follow each other in the order of the file, so a rank's contacts are contiguous.
        let counts = sums.iter().step_by(width);
        let own = part.i.len() as u64;
        let begin = self.contacts_written + exchange.sum_below(own);
        let mut end = self.contacts_written;
        let mut ends = Vec::new();
        for count in counts {
            end += *count as u64;
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
        let mut contacts = columns.contacts.iter_mut();
        for (ids, column) in [&part.i, &part.j].into_iter().zip(contacts.by_ref()) {
            outcome.note(column.append(end, Slab::rows(begin, own, 1), ids));
        }
        let numbers = part.forces.iter().zip(numbers(form));
        for ((values, quantity), column) in numbers.zip(contacts.by_ref()) {
            let rows = Slab::rows(begin, own, quantity.width(form) as u64);
            outcome.note(column.append(end, rows, values));
        }
        for (flags, column) in part.flags.iter().zip(contacts) {
            outcome.note(column.append(end, Slab::rows(begin, own, 1), flags));
        }
        outcome.note(by_root(root, &mut columns.step, before, &self.frames.step));
        outcome.note(by_root(root, &mut columns.time, before, &self.frames.time));
        outcome.note(by_root(root, &mut columns.offset, before + 1, &ends));
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
            sums_of_frames = checksums(&self.frames, &sums, &edges);
        }
        let rows = (sums_of_frames.len() / width) as u64;
        let rows = Slab::rows(before, rows, width as u64);
        outcome.note(columns.frame_sums.append(after, rows, &sums_of_frames));
        self.file.agree(exchange, outcome)?;
        (self.frames_written, self.contacts_written) = (after, end);
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
