//! Files of gshear-mpi: writes and reads runs, checkpoints, logs and reduced results.
//!
//! | module | file |
//! | --- | --- |
//! | [`trajectory`] | writes `run.h5`: frames and time series (H5MD), by all ranks together |
//! | [`run_reader`] | reads `run.h5` |
//! | [`checkpoint`] | writes and reads `checkpoint.h5`, with checksums |
//! | [`log`] | writes `log.csv`, the time series as text |
//! | [`status`] | writes and reads `status.json`, how far a run has come |
//! | [`reduced_writer`], [`spectrum_writer`] | write `reduced.h5` and `spectrum.h5` |
//! | [`spectrum_reader`] | reads the eigenvectors of `spectrum.h5` |
//! | [`csv_table`], [`matrix_market`] | CSV tables, sparse matrices |
//! | [`text_writer`] | writes beside the name of a file, brings it to disk and renames |
//! | [`checked`] | the same for HDF5 files of results, which are read back first |
//! | [`sound`] | opens files that other people may have made |
//! | [`existing`] | what a resumed run finds in `run.h5`, and its repair |
//! | `journal` | `run.h5.journal`: brings `run.h5` back to its last flush after a kill |
//! | [`memory`] | whether there is memory for what is large |
//! | [`h5`], [`collective`] | HDF5 with several ranks; agreement on failures between ranks |
//!
//! Most files are written under a temporary name and renamed when complete ([`text_writer`]).
//! `run.h5` and `log.csv` grow during a run; a resumed run truncates them to the rows and frames
//! that its checkpoint counts. `docs/reference/file-formats.md` describes the content of every
//! file.
//!
//! # Example
//! Print the stress ratio of a run and the number of contacts in its last frame:
//!
//! ```no_run
//! use gshear_store::run_reader::RunFile;
//!
//! let run = RunFile::open("out/plane-shear-2d".as_ref())?;
//! let series = run.series();
//! for (strain, tau) in series.column("strain").iter().zip(series.column("stress_ratio")) {
//!     println!("{strain} {tau}");
//! }
//! if let Some(last) = run.frames().checked_sub(1) {
//!     println!("{} contacts", run.frame(last)?.contacts.len());
//! }
//! # Ok::<(), gshear_dem::failure::Failure>(())
//! ```

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod batch;
pub mod box_columns;
pub mod checked;
pub mod checkpoint;
pub mod checksums;
pub mod collective;
pub mod compression;
pub mod contact_quantities;
pub mod csv_table;
pub mod dictionary;
pub mod disk;
pub mod existing;
pub mod file_names;
#[allow(
    unsafe_code,
    reason = "collective transfers, which the `hdf5` crate lacks"
)]
pub mod h5;
mod journal;
mod layout;
pub mod log;
pub mod matrix_market;
pub mod memory;
mod own_columns;
mod parameter;
pub mod part;
pub mod probe;
pub mod provenance;
pub mod reduced_writer;
mod room;
mod row_table;
mod run_header;
pub mod run_reader;
pub mod sound;
pub mod spectrum_reader;
pub mod spectrum_writer;
pub mod status;
pub mod text_writer;
pub mod trajectory;
