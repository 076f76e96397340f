//! The commands of `gshear-reduce`.

mod commands;
pub mod compare;
mod dmin;
pub mod export;
mod info;
mod phases;
pub mod rate_state;
mod spectrum;

pub use commands::{Arguments, Command, run};
