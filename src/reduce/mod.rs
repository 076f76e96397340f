//! The commands of `gshear-reduce`.

mod commands;
pub mod compare;
mod dmin;
pub mod export;
mod info;
mod phases;

pub use commands::{Arguments, Command, run};
