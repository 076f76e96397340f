//! Scalars of frames in `run.h5`: `observables/gshear/`, one row per frame.

use super::checksums::{self, of_scalars};
use super::collective::CollectiveOutcome;
use super::h5::{Dataset, H5File};
use super::layout::{CHUNK_ROWS, by_root, set_unit};
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_dem::failure::Failure;

/// Group of the scalars.
pub const SCALARS: &str = "observables/gshear";

/// Datasets of the scalars, and the buffered rows.
pub struct ScalarColumns {
    step: Dataset,
    /// A dataset per column.
    values: Vec<Dataset>,
    /// Checksums of the rows.
    sums: Dataset,
    rows: Vec<(u64, FrameScalars)>,
    written: u64,
}

impl ScalarColumns {
    /// Opens the datasets to continue after their first `rows` rows; creates them if the file has
    /// none. Collective.
    pub fn new(file: &H5File, rows: u64) -> Result<Self, Failure> {
        let names = FrameScalars::COLUMNS;
        let name = |n: usize, part: &str| format!("{SCALARS}/{}/{part}", names[n]);
        let all = 0..names.len();
        if !file.has(SCALARS) {
            if rows > 0 {
                return Err(file.lacks(SCALARS, rows));
            }
            drop(file.dataset::<u64>(checksums::SCALARS, &[0], Some(&[CHUNK_ROWS]))?);
            for n in all.clone() {
                file.group(&format!("{SCALARS}/{}", names[n]))?;
                let values = file.dataset::<f64>(&name(n, "value"), &[0], Some(&[CHUNK_ROWS]))?;
                // Scalars of frames exist for disks alone.
                set_unit(&values, &FrameScalars::COLUMNS[n], 2)?;
                match n {
                    0 => drop(file.dataset::<u64>(&name(0, "step"), &[0], Some(&[CHUNK_ROWS]))?),
                    n => file.link(
                        &format!("/{}", name(0, "step")),
                        &format!("/{}", name(n, "step")),
                    )?,
                }
            }
        }
        let mut columns = ScalarColumns {
            step: file.open_dataset::<u64>(&name(0, "step"))?,
            values: (all.map(|n| file.open_dataset::<f64>(&name(n, "value"))))
                .collect::<Result<_, _>>()?,
            sums: file.open_dataset::<u64>(checksums::SCALARS)?,
            rows: Vec::new(),
            written: rows,
        };
        if columns.step.rows() < rows
            || columns.values.iter().any(|c| c.rows() < rows)
            || columns.sums.rows() < rows
        {
            return Err(file.lacks(SCALARS, rows));
        }
        columns.step.resize(rows)?;
        columns.values.iter_mut().try_for_each(|c| c.resize(rows))?;
        columns.sums.resize(rows)?;
        Ok(columns)
    }

    /// Returns the number of rows so far, buffered ones included.
    pub fn rows(&self) -> u64 {
        self.written + self.rows.len() as u64
    }

    pub fn waiting(&self) -> usize {
        self.rows.len()
    }

    /// Buffers the next rows, which must be the same on every rank.
    pub fn push(&mut self, rows: &[(u64, FrameScalars)]) {
        self.rows.extend_from_slice(rows);
    }

    /// Writes the buffered rows, by rank 0. Collective.
    pub fn write(&mut self, root: bool, outcome: &mut CollectiveOutcome) {
        let rows = std::mem::take(&mut self.rows);
        if rows.is_empty() {
            return;
        }
        let step: Vec<u64> = rows.iter().map(|r| r.0).collect();
        outcome.note(by_root(root, &mut self.step, self.written, &step));
        for (n, column) in self.values.iter_mut().enumerate() {
            let values: Vec<f64> = rows.iter().map(|r| r.1.columns()[n]).collect();
            outcome.note(by_root(root, column, self.written, &values));
        }
        let of_row = |(step, row): &(u64, FrameScalars)| of_scalars(*step, row);
        let sums: Vec<u64> = rows.iter().map(of_row).collect();
        outcome.note(by_root(root, &mut self.sums, self.written, &sums));
        self.written += rows.len() as u64;
    }
}
