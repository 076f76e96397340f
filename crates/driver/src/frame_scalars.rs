//! The scalars of frames, computed while the run goes on by the reducer's own function, so that frames need not be stored.
//!
//! Frames are kept until there are intervals for every rank; then each rank is sent the frames of its share of them, in a row.

use crate::files::shapes;
use bytemuck::Zeroable;
use gshear_analysis::frame_scalars::{FrameScalars, ScalarScratch, Stressed, frame_scalars};
use gshear_dem::dimension::Dimension;
use gshear_dem::state::{
    ContactForce, ContactSample, Disks, Frame, FramePart, GrainPosition, GrainSample,
};
use gshear_dem::system::System;
use gshear_mpi_exchange::Parallel;
use gshear_store::collective::{IdBlocks, gathered, records_of};

/// Bytes of frames gathered before they are analysed, on each rank in the mean.
const BATCH_BYTES: usize = 1 << 20;
/// Most intervals that a rank works on in one go.
const MOST_INTERVALS: usize = 16;

/// A row of the scalars: the step, and what is between this frame and the one before it.
pub type ScalarsRow = (u64, FrameScalars);

/// Frames on their way to scalars.
pub struct FrameAnalysis {
    grains: Disks,
    /// This rank's part of the frames: the last one that is done with, then those that wait.
    frames: Vec<FramePart>,
    /// Of those that wait.
    steps: Vec<u64>,
    /// Intervals that are worked on in one go.
    batch: usize,
    scratch: ScalarScratch,
}

impl FrameAnalysis {
    /// Of the system's grains, going on from the frame that was analysed last, if there is one. Collective.
    pub fn new<D: Dimension>(
        exchange: &dyn Parallel,
        system: &mut System<D>,
        before: Option<FramePart>,
    ) -> Self {
        let shapes = gathered(exchange, &shapes(system), |g| g.id);
        let frame = shapes.len() * (size_of::<GrainPosition>() + 2 * size_of::<ContactForce>());
        let each = (BATCH_BYTES / frame.max(1)).clamp(1, MOST_INTERVALS);
        Self {
            grains: Disks {
                radius: shapes.iter().map(|g| g.radius).collect(),
                body: shapes.iter().map(|g| g.body as u8).collect(),
                mass: shapes.iter().map(|g| g.mass).collect(),
                length: system.cell.periods[0],
            },
            frames: before.into_iter().collect(),
            steps: Vec::new(),
            batch: each * exchange.size(),
            scratch: ScalarScratch::default(),
        }
    }

    /// The next frame: this rank's grains, and the contacts whose first grain it owns. Returns the rows that are ready, the same
    /// on every rank. Few calls send anything.
    pub fn frame(
        &mut self,
        exchange: &dyn Parallel,
        step: u64,
        grains: &[GrainSample],
        contacts: &[ContactSample],
    ) -> Vec<ScalarsRow> {
        let first = self.frames.is_empty();
        self.frames.push(part(grains, contacts));
        if first {
            return vec![(step, FrameScalars::UNDEFINED)];
        }
        self.steps.push(step);
        if self.steps.len() < self.batch {
            return Vec::new();
        }
        self.flush(exchange)
    }

    /// The rows of all frames that wait, the same on every rank. Collective.
    pub fn flush(&mut self, exchange: &dyn Parallel) -> Vec<ScalarsRow> {
        let intervals = self.steps.len();
        if intervals == 0 {
            return Vec::new();
        }
        let shares = IdBlocks {
            grains: intervals as u64,
            ranks: exchange.size() as u64,
        };
        let message = |rank: usize| {
            let share = shares.range(rank);
            let frames = match share.is_empty() {
                true => 0..0,
                false => share.start as usize..share.end as usize + 1,
            };
            let mut message = Vec::new();
            self.frames[frames]
                .iter()
                .for_each(|part| write(part, &mut message));
            message
        };
        let received = exchange.all_to_all((0..exchange.size()).map(message).collect());
        let frames: Vec<Stressed> = assemble(&received, self.grains.count())
            .into_iter()
            .map(|frame| Stressed::new(&self.grains, frame))
            .collect();
        let rows: Vec<[f64; FrameScalars::COLUMNS.len()]> = frames
            .windows(2)
            .map(|pair| {
                frame_scalars(&self.grains, &pair[0], &pair[1], &mut self.scratch).columns()
            })
            .collect();
        let all = exchange.gather(bytemuck::cast_slice(&rows));
        let rows = all.iter().flat_map(|bytes| records_of(bytes));
        let rows = self
            .steps
            .drain(..)
            .zip(rows.map(FrameScalars::from_columns));
        let rows: Vec<ScalarsRow> = rows.collect();
        assert_eq!(rows.len(), intervals, "every interval has its scalars");
        self.frames.drain(..intervals);
        rows
    }

    /// The frame that the next scalars begin with. Panics while frames wait.
    pub fn last(&self) -> Option<&FramePart> {
        assert!(self.steps.is_empty(), "frames wait to be analysed");
        self.frames.last()
    }
}

/// What the scalars need of a frame.
fn part(grains: &[GrainSample], contacts: &[ContactSample]) -> FramePart {
    FramePart {
        grains: grains.iter().map(GrainPosition::from).collect(),
        contacts: contacts.iter().map(ContactForce::from).collect(),
    }
}

fn write(part: &FramePart, message: &mut Vec<u8>) {
    let counts = [part.grains.len() as u64, part.contacts.len() as u64];
    message.extend_from_slice(bytemuck::bytes_of(&counts));
    message.extend_from_slice(bytemuck::cast_slice(&part.grains));
    message.extend_from_slice(bytemuck::cast_slice(&part.contacts));
}

/// The frames of one message of each rank. Panics where a grain is missing or comes twice: a fault of the program.
fn assemble(messages: &[Vec<u8>], grains: usize) -> Vec<Frame> {
    let mut rest: Vec<&[u8]> = messages.iter().map(|m| &m[..]).collect();
    let mut frames = Vec::new();
    while rest.iter().any(|bytes| !bytes.is_empty()) {
        let mut frame = Frame {
            position: vec![[f64::NAN; 2]; grains],
            ..Frame::default()
        };
        let mut seen = 0;
        for rest in &mut rest {
            let counts: [u64; 2] = bytemuck::pod_read_unaligned(take(rest, 16));
            let places = take(rest, counts[0] as usize * size_of::<GrainPosition>());
            let forces = take(rest, counts[1] as usize * size_of::<ContactForce>());
            for place in records_of::<GrainPosition>(places) {
                frame.position[place.id as usize] = place.position;
                seen += 1;
            }
            let contact = |c: ContactForce| ContactSample {
                i: c.i,
                j: c.j,
                normal_force: c.normal_force,
                tangential_force: [c.tangential_force, 0.0, 0.0],
                ..ContactSample::zeroed()
            };
            frame.contacts.extend(records_of(forces).map(contact));
        }
        assert_eq!(seen, grains, "every grain comes once");
        frame.contacts.sort_by_key(|c| (c.i, c.j));
        frames.push(frame);
    }
    frames
}

/// The next so many bytes.
fn take<'a>(bytes: &mut &'a [u8], length: usize) -> &'a [u8] {
    let (now, later) = bytes.split_at(length);
    *bytes = later;
    now
}
