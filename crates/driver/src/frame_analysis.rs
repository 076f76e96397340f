//! The scalars of frames, computed during the run by the function of the reducer, so that the
//! frames need not be stored.
//!
//! Frames are collected until there are intervals for every rank. Then each rank receives the
//! consecutive frames of its share of the intervals.

use bytemuck::Zeroable;
use gshear_analysis::frame_scalars::{FrameScalars, ScalarScratch, Stressed, frame_scalars};
use gshear_dem::dimension::{Dimension, Dimensions};
use gshear_dem::state::{
    Cell, ContactForce, ContactSample, Frame, FramePart, GrainConstants, GrainPosition, GrainSample,
};
use gshear_dem::system::System;
use gshear_mpi_exchange::Parallel;
use gshear_store::collective::{IdBlocks, gathered, put_lists, records_of, take_lists};
use gshear_store::trajectory::GrainShape;

/// Bytes of frames to collect before they are analysed, per rank on average.
const BATCH_BYTES: usize = 1 << 20;
/// Greatest number of intervals per rank in a batch.
const MOST_INTERVALS: usize = 16;

/// A row of the scalars: the step of a frame, and the scalars of the interval that ends there.
pub(crate) type ScalarsRow = (u64, FrameScalars);

/// Frames that wait for their scalars to be computed.
pub(crate) struct FrameAnalysis {
    grains: GrainConstants,
    cell: Cell,
    /// This rank's part of the frames: the last analysed one, then those that wait.
    frames: Vec<FramePart>,
    /// Steps of the frames that wait.
    steps: Vec<u64>,
    /// Number of intervals in a batch.
    batch: usize,
    scratch: ScalarScratch,
}

impl FrameAnalysis {
    /// Starts with the grains of the system, after the last analysed frame, if there is one.
    /// Collective.
    pub fn new<D: Dimension>(
        exchange: &dyn Parallel,
        system: &mut System<D>,
        before: Option<FramePart>,
    ) -> Self {
        let shapes = gathered(exchange, &GrainShape::owned(system), |g| g.id);
        let frame = shapes.len() * (size_of::<GrainPosition>() + 2 * size_of::<ContactForce>());
        let each = (BATCH_BYTES / frame.max(1)).clamp(1, MOST_INTERVALS);
        Self {
            grains: GrainConstants {
                radius: shapes.iter().map(|g| g.radius).collect(),
                body: shapes.iter().map(|g| g.body as u8).collect(),
                mass: shapes.iter().map(|g| g.mass).collect(),
            },
            cell: Cell::between_walls(system.cell.periods),
            frames: before.into_iter().collect(),
            steps: Vec::new(),
            batch: each * exchange.size(),
            scratch: ScalarScratch::default(),
        }
    }

    /// Adds a frame: the grains of this rank, and the contacts whose first grain it owns, but for
    /// those with flat walls. Returns the rows that are ready, the same on every rank. Collective
    /// if a batch is full.
    pub fn frame(
        &mut self,
        exchange: &dyn Parallel,
        step: u64,
        grains: &[GrainSample],
        contacts: &[ContactSample],
    ) -> Vec<ScalarsRow> {
        let first = self.frames.is_empty();
        self.frames.push(FramePart {
            grains: grains.iter().map(GrainPosition::from).collect(),
            contacts: (contacts.iter())
                .filter(|contact| contact.wall(self.grains.count()).is_none())
                .map(ContactForce::from)
                .collect(),
        });
        if first {
            return vec![(step, FrameScalars::UNDEFINED)];
        }
        self.steps.push(step);
        if self.steps.len() < self.batch {
            return Vec::new();
        }
        self.flush(exchange)
    }

    /// Computes the rows of all frames that wait, the same on every rank. Collective.
    pub fn flush(&mut self, exchange: &dyn Parallel) -> Vec<ScalarsRow> {
        let intervals = self.steps.len();
        if intervals == 0 {
            return Vec::new();
        }
        let shares = IdBlocks::of(exchange, intervals as u64);
        let mut messages = Vec::new();
        for rank in 0..exchange.size() {
            let share = shares.range(rank);
            let frames = if share.is_empty() {
                0..0
            } else {
                share.start as usize..share.end as usize + 1
            };
            let mut message = Vec::new();
            for FramePart { grains, contacts } in &self.frames[frames] {
                put_lists(&mut message, grains, contacts);
            }
            messages.push(message);
        }
        let received = exchange.all_to_all(messages);
        let frames = assemble(&received, self.cell, self.grains.count()).into_iter();
        let frames = frames.map(|frame| Stressed::new(&self.grains, frame));
        let frames: Vec<Stressed> = frames.collect();
        let mut rows: Vec<[f64; FrameScalars::COLUMNS.len()]> = Vec::new();
        for pair in frames.windows(2) {
            let scalars = frame_scalars(&self.grains, &pair[0], &pair[1], &mut self.scratch);
            rows.push(scalars.columns());
        }
        let all = exchange.gather(bytemuck::cast_slice(&rows));
        let rows = all.iter().flat_map(|bytes| records_of(bytes));
        let rows = rows.map(FrameScalars::from_columns);
        let rows: Vec<ScalarsRow> = self.steps.drain(..).zip(rows).collect();
        assert_eq!(rows.len(), intervals, "every interval has its scalars");
        self.frames.drain(..intervals);
        rows
    }

    /// The frame at which the next interval begins.
    ///
    /// # Panics
    /// If frames wait.
    pub fn last(&self) -> Option<&FramePart> {
        assert!(self.steps.is_empty(), "frames wait to be analysed");
        self.frames.last()
    }
}

/// Assembles frames from one message of each rank. Panics if a grain is missing or occurs twice,
/// which is a bug.
fn assemble(messages: &[Vec<u8>], cell: Cell, grains: usize) -> Vec<Frame> {
    let mut rest: Vec<&[u8]> = messages.iter().map(|m| &m[..]).collect();
    let mut frames = Vec::new();
    while rest.iter().any(|bytes| !bytes.is_empty()) {
        let mut frame = Frame {
            dimension: Dimensions::Two,
            cell,
            step: 0,
            time: 0.0,
            grains: vec![GrainSample::zeroed(); grains],
            contacts: Vec::new(),
            wall_contacts: Vec::new(),
        };
        let mut seen = 0;
        for rest in &mut rest {
            let (places, forces) = take_lists::<GrainPosition, ContactForce>(rest);
            for place in places {
                let [x, y] = place.position;
                frame.grains[place.id as usize] = GrainSample {
                    id: place.id,
                    position: [x, y, 0.0],
                    image: [place.image, 0, 0],
                    ..GrainSample::zeroed()
                };
                seen += 1;
            }
            frame.contacts.extend(forces.map(|c| ContactSample {
                i: c.i,
                j: c.j,
                normal_force: c.normal_force,
                tangential_force: [c.tangential_force, 0.0, 0.0],
                ..ContactSample::zeroed()
            }));
        }
        assert_eq!(seen, grains, "every grain comes once");
        frame.contacts.sort_by_key(|c| (c.i, c.j));
        frames.push(frame);
    }
    frames
}
