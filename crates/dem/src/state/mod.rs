//! Grains, contacts, the cell, and the records of frames and checkpoints.
//!
//! [`GrainState`] is the state of a grain: what ranks exchange, what a checkpoint holds, and what
//! the digest covers. [`Grains`] stores the same states as a structure of arrays, for the grains of
//! one rank and their ghosts; [`Grains::push`] and [`Grains::state`] convert. All other types of a
//! grain are views of its state. Each is made by one function beside its declaration:
//!
//! | view | made from | used for |
//! | --- | --- | --- |
//! | [`GrainSample`] | [`GrainState`] | a grain's row of a frame |
//! | [`GrainPosition`] | [`GrainSample`] | scalars of a frame |
//! | [`Displacement`] | [`GrainState`] | mean square displacement since the start of a stage |
//! | `GrainShape` of `gshear-store` | [`GrainState`] and mass | constants of the grains in `run.h5`
//! | | [`GrainConstants`], [`Frame`] | `run.h5` | analysis: constants and frames of all grains, by id |
//!
//! In the same way [`ContactState`] is the state of a contact, [`Contacts`] stores the contacts of
//! one rank, and [`ContactSample`] and [`ContactForce`] are views.

mod bands;
pub mod body;
mod cell;
mod contacts;
mod frame;
mod grains;
mod ids;
mod records;
mod snapshot;

pub(crate) use bands::BandSize;
pub use bands::Bands;
pub use cell::{BoxEdges, Cell, Image, Sheared, Stretching, length, nearest_image, strained};
pub use contacts::{
    BlockRange, CandidatePair, Contacts, LocalGrains, OtherBlocks, Remembered, Share, ShareBand,
    Touching,
};
pub(crate) use contacts::{FILLER, way_to_touch};
pub use frame::{Frame, GrainConstants};
pub use grains::{FlatWalls, Foot, Grains, Masses, Units};
pub use ids::Ids;
pub use records::{
    BottomRow, ContactSample, FlowRow, GrainSample, ImposedRow, LateralRow, SeriesRow, StressRow,
    TemperatureRow,
};
pub use snapshot::{
    ContactForce, ContactState, Displacement, FramePart, GrainPosition, GrainState, HeldState,
    Snapshot,
};
