//! Tables of `run.h5` whose rows all ranks know: the time series, and scalars of frames.

use super::checksums::of_row;
use super::collective::CollectiveOutcome;
use super::h5::{Dataset, by_root};
use gshear_dem::columns::Column;

/// Datasets of a table, and the buffered rows.
pub(crate) struct RowTable {
    pub step: Dataset,
    /// `None` of scalars, whose frames have it.
    pub time: Option<Dataset>,
    /// A dataset per column.
    pub values: Vec<Dataset>,
    pub names: Vec<&'static str>,
    /// Checksums of the rows.
    pub sums: Dataset,
    rows: Vec<BufferedRow>,
    written: u64,
}

/// A buffered row.
struct BufferedRow {
    step: u64,
    time: f64,
    values: Vec<f64>,
}

impl RowTable {
    /// Without rows.
    pub fn new(
        step: Dataset,
        time: Option<Dataset>,
        values: Vec<Dataset>,
        columns: &[Column],
        sums: Dataset,
    ) -> Self {
        Self {
            step,
            time,
            values,
            names: columns.iter().map(|column| column.name).collect(),
            sums,
            rows: Vec::new(),
            written: 0,
        }
    }

    fn datasets(&mut self) -> impl Iterator<Item = &mut Dataset> {
        let clock = [&mut self.step].into_iter().chain(&mut self.time);
        clock.chain(&mut self.values).chain([&mut self.sums])
    }

    /// Whether the datasets have so many rows.
    pub fn has(&mut self, rows: u64) -> bool {
        self.datasets().all(|dataset| dataset.rows() >= rows)
    }

    /// Cuts the datasets to their first `rows` rows, after which the table goes on.
    pub fn cut(&mut self, rows: u64, outcome: &mut CollectiveOutcome) {
        self.datasets()
            .for_each(|dataset| outcome.note(dataset.resize(rows)));
        self.written = rows;
    }

    /// Returns the number of rows so far, buffered ones included.
    pub fn rows(&self) -> u64 {
        self.written + self.waiting() as u64
    }

    /// Returns the number of buffered rows.
    pub fn waiting(&self) -> usize {
        self.rows.len()
    }

    /// Returns the bytes that the buffered rows take.
    pub fn bytes(&self) -> usize {
        8 * self.waiting() * (2 + self.values.len())
    }

    /// Buffers the next row, which must be the same on every rank; the time is 0 where the table
    /// has none.
    pub fn push(&mut self, step: u64, time: f64, row: &[f64]) {
        let values = row.to_vec();
        self.rows.push(BufferedRow { step, time, values });
    }

    /// Writes the buffered rows, by rank 0. Collective.
    pub fn write(&mut self, root: bool, outcome: &mut CollectiveOutcome) {
        let rows = std::mem::take(&mut self.rows);
        if rows.is_empty() {
            return;
        }
        let before = self.written;
        let step: Vec<u64> = rows.iter().map(|row| row.step).collect();
        outcome.note(by_root(root, &mut self.step, before, &step));
        if let Some(column) = &mut self.time {
            let time: Vec<f64> = rows.iter().map(|row| row.time).collect();
            outcome.note(by_root(root, column, before, &time));
        }
        for (n, column) in self.values.iter_mut().enumerate() {
            let values: Vec<f64> = rows.iter().map(|row| row.values[n]).collect();
            outcome.note(by_root(root, column, before, &values));
        }
        let mut sums = Vec::with_capacity(rows.len());
        for BufferedRow { step, time, values } in &rows {
            let names = self.names.iter().copied();
            sums.push(of_row(*step, *time, names.zip(values.iter().copied())));
        }
        outcome.note(by_root(root, &mut self.sums, before, &sums));
        self.written += rows.len() as u64;
    }
}
