//! Files in and out.

pub mod reduced_writer;
pub mod run_reader;
pub mod text_writer;
