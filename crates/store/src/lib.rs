//! Files: trajectory, checkpoint, log, what says where a run came from, and what is read back and reduced.

mod batch;
pub mod checkpoint;
pub mod collective;
pub mod columns;
pub mod h5;
mod layout;
pub mod log;
pub mod matrix_market;
pub mod provenance;
pub mod reduced_writer;
pub mod run_reader;
mod scalar_columns;
pub mod spectrum_writer;
pub mod table;
pub mod text_writer;
pub mod trajectory;
