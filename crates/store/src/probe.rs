//! Tries whether all ranks can write an HDF5 file into a folder.

use std::path::Path;

use gshear_dem::failure::{Failure, Result};
use gshear_mpi_exchange::Parallel;

use super::collective::{CollectiveOutcome, agree};
use crate::h5::{Attribute, H5File};
use crate::sound;

/// Creates a file in a folder on all ranks, reads it and removes it. Collective.
///
/// # Errors
/// [`Failure::Input`] if the folder is no place for HDF5; [`Failure::Other`] if writing fails.
pub fn probe(folder: &Path, exchange: &dyn Parallel) -> Result<()> {
    let _waiting = exchange.waiting();
    let path = folder.join("run.probe");
    // One that a killed program has left.
    remove(&path, exchange);
    exchange.barrier();
    let tried = write_and_read(folder, &path, exchange);
    exchange.barrier();
    remove(&path, exchange);
    tried
}

fn remove(path: &Path, exchange: &dyn Parallel) {
    if exchange.rank() == 0 {
        let _ = std::fs::remove_file(path);
    }
}

fn write_and_read(folder: &Path, path: &Path, exchange: &dyn Parallel) -> Result<()> {
    let file = H5File::create(path, exchange).map_err(|why| unfit(folder, &why))?;
    let probed = file.attribute("/", "probe", &Attribute::Count(1));
    file.agree(exchange, CollectiveOutcome::of(probed))?;
    file.close(exchange)?;
    // Each rank with the serial driver, as checkpoints are read.
    let read = sound::read(path, |file| file.attr("probe").map(drop));
    agree(exchange, read.map_err(|why| unfit(folder, &why)))
}

fn unfit(folder: &Path, why: &dyn std::fmt::Display) -> Failure {
    Failure::input(format!(
        "{}: HDF5 cannot write here: {why}; give another folder with --out, and where there are \
         no locks HDF5_USE_FILE_LOCKING=FALSE in the environment",
        folder.display()
    ))
}
