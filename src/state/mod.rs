//! Grains, contacts, walls and the cell: what a run consists of between two steps.

mod frame;
mod sample;
mod snapshot;

pub use frame::{Frame, Grains};
pub use sample::{ContactSample, GrainSample, SERIES_COLUMNS, SeriesRow};
pub use snapshot::{ContactState, GrainState, Snapshot};
