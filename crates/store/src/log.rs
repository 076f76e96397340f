//! `log.csv`: the time series as text.

use super::collective::agree;
use super::table::TableFile;
use gshear_dem::domain::Exchange;
use gshear_dem::failure::Failure;
use gshear_dem::state::{SERIES_COLUMNS, SeriesRow};
use std::path::Path;

/// Writes the log on rank 0; on the others it does nothing.
pub struct Log(Option<TableFile>);

impl Log {
    /// A new log in the place of whatever is there. Collective.
    pub fn create(exchange: &dyn Exchange, path: &Path) -> Result<Self, Failure> {
        Self::of(exchange, || TableFile::create(path, &columns()))
    }

    /// An existing log, to go on after its first `rows` rows; those beyond are cut off.
    /// `Failure::Input` where the file has fewer rows, or is no log of ours. Collective.
    pub fn open_to_append(
        exchange: &dyn Exchange,
        path: &Path,
        rows: u64,
    ) -> Result<Self, Failure> {
        Self::of(exchange, || {
            TableFile::open_to_append(path, &columns(), rows)
        })
    }

    fn of(
        exchange: &dyn Exchange,
        open: impl FnOnce() -> Result<TableFile, Failure>,
    ) -> Result<Self, Failure> {
        let file = (exchange.rank() == 0).then(open).transpose();
        agree(exchange, file.map(Log))
    }

    /// The next row. Not collective: a failure is rank 0's alone.
    pub fn row(&mut self, step: u64, time: f64, row: &SeriesRow) -> Result<(), Failure> {
        let Some(file) = &mut self.0 else {
            return Ok(());
        };
        let numbers = [time].into_iter().chain(row.columns());
        file.row([step.to_string()].into_iter().chain(numbers.map(shortest)))
    }

    /// Hands the rows to the file system. Not collective: a failure is rank 0's alone.
    pub fn flush(&mut self) -> Result<(), Failure> {
        self.0.as_mut().map_or(Ok(()), TableFile::flush)
    }
}

fn columns() -> Vec<&'static str> {
    [&["step", "time"], &SERIES_COLUMNS[..]].concat()
}

/// The shortest text that reads back to the same bits.
pub fn shortest(value: f64) -> String {
    let (plain, scientific) = (value.to_string(), format!("{value:e}"));
    if scientific.len() < plain.len() {
        scientific
    } else {
        plain
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gshear_dem::domain::Solo;

    fn row(k: u64) -> SeriesRow {
        let numbers: [f64; SERIES_COLUMNS.len()] =
            std::array::from_fn(|c| (k as f64 + 0.1) * 10f64.powi(4 * c as i32 - 20) / 3.0);
        bytemuck::cast(numbers)
    }

    fn text(path: &Path) -> String {
        std::fs::read_to_string(path).unwrap()
    }

    #[test]
    fn numbers_read_back_to_the_same_bits() {
        for value in [
            0.0,
            -0.0,
            1.0,
            0.1,
            1e-300,
            7.2e-7,
            1e22,
            13_000.0,
            f64::MIN_POSITIVE,
            f64::MAX,
            5e-324,
        ] {
            assert_eq!(
                shortest(value).parse::<f64>().unwrap().to_bits(),
                value.to_bits()
            );
            assert!(shortest(value).len() <= 24);
        }
        assert_eq!(
            [shortest(1.0), shortest(7.2e-7), shortest(1e22)],
            ["1", "7.2e-7", "1e22"]
        );
    }

    #[test]
    fn goes_on_after_the_rows_that_count() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        let mut log = Log::create(&Solo, &path).unwrap();
        (0..5).for_each(|k| log.row(k, k as f64, &row(k)).unwrap());
        log.flush().unwrap();
        let whole = text(&path);
        assert!(whole.starts_with("step,time,strain,"));
        let third: Vec<f64> = whole
            .lines()
            .nth(3)
            .unwrap()
            .split(',')
            .map(|v| v.parse().unwrap())
            .collect();
        assert_eq!(third[2..], row(2).columns());

        // As a killed program leaves it: rows too many, the last one torn.
        std::fs::write(&path, format!("{whole}5,0.1")).unwrap();
        let mut log = Log::open_to_append(&Solo, &path, 3).unwrap();
        (3..5).for_each(|k| log.row(k, k as f64, &row(k)).unwrap());
        drop(log);
        assert_eq!(text(&path), whole);
    }

    #[test]
    fn refuses_a_log_that_does_not_fit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        let refuse = |rows| match Log::open_to_append(&Solo, &path, rows) {
            Err(Failure::Input(message)) => message,
            _ => panic!("a log that does not fit was taken"),
        };
        assert!(refuse(0).contains("log.csv"));
        std::fs::write(&path, "a,b\n1,2\n").unwrap();
        assert!(refuse(1).contains("first line"));
        let mut log = Log::create(&Solo, &path).unwrap();
        (0..2).for_each(|k| log.row(k, 0.0, &row(k)).unwrap());
        drop(log);
        assert!(refuse(3).contains("it has 2 rows, the checkpoint counts 3"));
    }
}
