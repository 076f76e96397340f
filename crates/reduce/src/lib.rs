//! The commands of `gshear-reduce`: each reads runs, calls `gshear-analysis`, and writes tables,
//! HDF5 files or reports.
//!
//! [`Command`] lists the commands and their options; [`run`] runs one. One file per command holds
//! its reading, its tables and its printed summary; the numbers themselves are computed in
//! `gshear-analysis`, the figures in `gshear-report`. Most commands are reached only through
//! [`run`]; public are those that other programs and the tests of the repository use.
//!
//! # Example
//! Compare two runs to the last bit, as `gshear-reduce compare` does:
//!
//! ```no_run
//! use gshear_reduce::compare;
//! use gshear_store::run_reader::RunFile;
//!
//! let (a, b) = (RunFile::open("out/one".as_ref())?, RunFile::open("out/two".as_ref())?);
//! let comparison = compare::runs(&a, &b)?;
//! for field in comparison.fields.iter().filter(|field| field.differing > 0) {
//!     println!("{}: first at {}", field.name, field.first);
//! }
//! # Ok::<(), gshear_dem::failure::Failure>(())
//! ```

mod braille;
mod columns;
mod commands;
pub mod compare;
mod correlate;
mod dmin;
pub mod export;
mod growth;
mod info;
mod output;
mod phases;
mod pool;
pub mod rate_state;
mod regions;
pub mod replay;
mod report;
pub mod scalars;
mod spectrum;
mod stability;
mod stages;
mod stiffness;
mod watch;

pub use commands::{Arguments, Command, run};
