//! Runs of gshear-mpi: a sequence of stages, from a scene or a checkpoint to the last file.
//!
//! A scene between walls is packed and sheared; a periodic box is prepared, strained
//! quasi-statically and, with a table `[newtonian]`, moved by Newton's equations. Each of these is
//! a `stage::Stage`; stops, signals, wall time, checkpoints and the terminal are in `stage` and
//! `run`, once for all of them.
//!
//! A run of the default scene with a short shear, on one rank:
//!
//! ```no_run
//! use gshear_dem::domain::Solo;
//! use gshear_driver::launch;
//! use gshear_driver::options::Options;
//! use gshear_driver::options::Outcome;
//! use gshear_scene::Source;
//!
//! let task = launch::from_the_start(&Solo, &Source::embedded(), &["shear.strain=0.01".into()])?;
//! let options = Options {
//!     out: "out/short".into(),
//!     threads: 1,
//!     ..Options::default()
//! };
//! assert_eq!(task.run(&Solo, &options)?, Outcome::Done);
//! # Ok::<(), gshear_dem::failure::Failure>(())
//! ```

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod calibration;
mod continuation;
mod cores;
mod ends;
pub mod estimate;
pub mod exported_state;
mod files;
pub mod folder;
mod frame_analysis;
pub mod header;
pub mod launch;
pub mod layout;
mod lock;
mod memory;
pub mod options;
mod output_schedule;
pub mod preview;
mod run;
mod run_record;
pub mod say;
pub mod signals;
mod stage;
mod stages;
pub mod stored_run;
pub mod sweep;
mod task;
mod terminal;
pub mod version;

pub use terminal::progress;
