//! The commands of `gshear-reduce`.

mod commands;
pub mod compare;
mod correlate;
mod dmin;
pub mod export;
mod info;
mod phases;
mod pool;
pub mod rate_state;
mod regions;
pub mod replay;
pub mod scalars;
mod spectrum;
mod stiffness;
mod study;

pub use commands::{Arguments, Command, run};
