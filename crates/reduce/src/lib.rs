//! The commands of `gshear-reduce`: each reads runs, calls `gshear-analysis`, and writes tables,
//! HDF5 files or reports.
//!
//! [`reduce`] is the program, [`Command`] lists the commands, and [`run()`] runs one. A file per
//! command in `commands/` holds its arguments, its reading, its tables and its printed summary; the
//! numbers themselves are computed in `gshear-analysis`, the figures in `gshear-report`. Most
//! commands are reached only through [`run()`]; public is what other programs and the tests of the
//! repository use.
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

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod braille;
mod commands;
mod frame_pairs;
mod frame_selection;
mod printer;
mod program;
mod results;
pub mod scalars;
mod stored_state;

pub use commands::{Arguments, Command, compare, run};
pub use program::reduce;
