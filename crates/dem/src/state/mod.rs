//! Grains, contacts, the cell, and the records of frames and checkpoints.

mod cell;
mod contacts;
mod frame;
mod grains;
mod sample;
mod snapshot;

pub use cell::{Cell, Sheared, length, nearest_image};
pub use contacts::{BlockRange, CandidatePair, Contacts, Touching};
pub use frame::{Disks, Frame, FrameRecords};
pub use grains::{Grains, Masses, Units, body};
pub use sample::{ContactSample, GrainSample, SeriesRow};
pub use snapshot::{
    ContactForce, ContactState, FramePart, GrainPlace, GrainState, Snapshot, Travel,
};
