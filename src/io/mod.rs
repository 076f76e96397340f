//! Files: trajectory, checkpoint, log, and what says where a run came from.

mod batch;
pub mod checkpoint;
pub mod collective;
pub mod h5;
mod layout;
pub mod log;
pub mod provenance;
pub mod trajectory;
