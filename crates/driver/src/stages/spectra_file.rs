//! `spectra.csv`: eigenvalues as a function of time.

use std::path::Path;

use gshear_dem::domain::total;
use gshear_dem::failure::Result;
use gshear_mpi_exchange::Parallel;
use gshear_store::collective::{agree, on_root};
use gshear_store::csv_table::{TableCell, TableFile, rows_up_to};
use gshear_store::dictionary;
use gshear_store::file_names::SPECTRA_FILE;

use super::eigenvalues::Eigenvalues;

const COLUMNS: [&str; 4] = ["time", "real", "imaginary", "verdict"];

/// The file, which rank 0 writes. Every call is collective.
pub(crate) struct SpectraFile {
    file: Option<TableFile>,
    rows: u64,
}

impl SpectraFile {
    /// Creates the file, or opens an existing one and removes its rows after the time `last`.
    pub fn open(exchange: &dyn Parallel, path: &Path, last: Option<f64>) -> Result<Self> {
        let (file, rows) = on_root(exchange, || {
            let (file, rows) = open_table(path, last)?;
            Ok((Some(file), rows))
        })?;
        let rows = total(exchange, rows);
        Ok(Self { file, rows })
    }

    /// Appends all eigenvalues of one time.
    pub fn write(
        &mut self,
        exchange: &dyn Parallel,
        time: f64,
        eigenvalues: &Eigenvalues,
    ) -> Result<()> {
        self.rows += eigenvalues.all().count() as u64;
        let wrote = match &mut self.file {
            None => Ok(()),
            Some(file) => eigenvalues.all().try_for_each(|(value, verdict)| {
                let cells: [&dyn TableCell; 4] = [&time, &value.re, &value.im, &verdict.name()];
                file.row(cells)
            }),
        };
        agree(exchange, wrote)
    }

    /// The number of rows so far.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Writes all rows to disk.
    pub fn flush(&mut self, exchange: &dyn Parallel) -> Result<()> {
        agree(exchange, self.file.as_mut().map_or(Ok(()), TableFile::sync))
    }
}

/// The table and the number of its rows up to the time `last`.
fn open_table(path: &Path, last: Option<f64>) -> Result<(TableFile, u64)> {
    let rows = match last {
        // A killed program may have left an empty file.
        Some(last) => rows_up_to(path, last)?,
        None => None,
    };
    if let Some(rows) = rows {
        let file = TableFile::open_to_append(path, &COLUMNS, rows)?;
        return Ok((file, rows));
    }
    dictionary::write_metadata(SPECTRA_FILE, path, &COLUMNS, 3)?;
    Ok((TableFile::create(path, &COLUMNS)?, 0))
}
