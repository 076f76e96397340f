//! `log.csv`: the time series as text.

use super::collective::agree;
use super::table::TableFile;
use gshear_dem::domain::Exchange;
use gshear_dem::failure::Failure;
use gshear_dem::state::SeriesRow;
use std::io::{BufRead, BufReader};
use std::path::Path;

/// Writer of the log. Only rank 0 writes.
pub struct Log(Option<TableFile>);

impl Log {
    /// Creates the log, replacing an existing file. Collective.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn create(exchange: &dyn Exchange, path: &Path) -> Result<Self, Failure> {
        Self::of(exchange, || TableFile::create(path, &columns()))
    }

    /// Opens an existing log to continue after its first `rows` rows; later rows are removed.
    /// Collective.
    ///
    /// # Errors
    /// [`Failure::Input`] if the file has fewer rows or another header.
    pub fn open_to_append(
        exchange: &dyn Exchange,
        path: &Path,
        rows: u64,
    ) -> Result<Self, Failure> {
        Self::of(exchange, || {
            TableFile::open_to_append(path, &stored_columns(path)?, rows)
        })
    }

    fn of(
        exchange: &dyn Exchange,
        open: impl FnOnce() -> Result<TableFile, Failure>,
    ) -> Result<Self, Failure> {
        let file = (exchange.rank() == 0).then(open).transpose();
        agree(exchange, file.map(Log))
    }

    /// Writes the next row. Not collective: only rank 0 can fail.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn row(&mut self, step: u64, time: f64, row: &SeriesRow) -> Result<(), Failure> {
        let Some(file) = &mut self.0 else {
            return Ok(());
        };
        let numbers = [time].into_iter().chain(row.columns());
        file.row([step.to_string()].into_iter().chain(numbers.map(shortest)))
    }

    /// Hands the rows to the file system. Not collective: only rank 0 can fail.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn flush(&mut self) -> Result<(), Failure> {
        self.0.as_mut().map_or(Ok(()), TableFile::flush)
    }
}

fn columns() -> Vec<&'static str> {
    let row = SeriesRow::COLUMNS.iter().map(|column| column.name);
    ["step", "time"].into_iter().chain(row).collect()
}

/// The columns of an existing log, in which renamed ones may have their former names.
fn stored_columns(path: &Path) -> Result<Vec<&'static str>, Failure> {
    let unfit = |why: String| {
        Failure::input(format!(
            "{}: cannot go on with this log: {why}",
            path.display()
        ))
    };
    let mut line = String::new();
    std::fs::File::open(path)
        .and_then(|file| BufReader::new(file).read_line(&mut line))
        .map_err(|e| unfit(e.to_string()))?;
    let mut found = line.trim_end().split(',');
    if (found.next(), found.next()) != (Some("step"), Some("time")) {
        return Err(unfit("its first line must begin with step,time".into()));
    }
    let mut names = vec!["step", "time"];
    for column in &SeriesRow::COLUMNS {
        let name = found.next().unwrap_or("nothing");
        names.push(column.stored_name(|known| known == name).ok_or_else(|| {
            unfit(format!(
                "it lacks the column {column} (found: {name}); another version wrote it"
            ))
        })?);
    }
    match found.next() {
        None => Ok(names),
        Some(name) => Err(unfit(format!(
            "its column {name} would not be continued; another version wrote it"
        ))),
    }
}

/// Returns the shortest text that reads back to the same bits.
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
        let numbers: [f64; SeriesRow::COLUMNS.len()] =
            std::array::from_fn(|c| (k as f64 + 0.1) * 10f64.powi(4 * c as i32 - 20) / 3.0);
        SeriesRow::from_columns(numbers)
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

        // As left by a killed program: too many rows, the last one incomplete.
        std::fs::write(&path, format!("{whole}5,0.1")).unwrap();
        let mut log = Log::open_to_append(&Solo, &path, 3).unwrap();
        (3..5).for_each(|k| log.row(k, k as f64, &row(k)).unwrap());
        drop(log);
        assert_eq!(text(&path), whole);
    }

    #[test]
    fn former_names_are_continued_and_other_columns_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        let open = |names: &str| {
            std::fs::write(&path, format!("{names}\n")).unwrap();
            Log::open_to_append(&Solo, &path, 0).map(drop)
        };
        let names = columns().join(",");
        assert!(open(&names).is_ok());
        assert!(open(&names.replace("dissipated_", "lost_")).is_ok());
        let refused = |names: &str| open(names).unwrap_err().to_string();
        assert!(
            refused(&names.replace("slip_rate", "rate")).contains("lacks the column slip_rate")
        );
        assert!(refused(&names[..names.rfind(',').unwrap()]).contains("energy_residual"));
        assert!(refused(&format!("{names},more")).contains("column more"));
    }

    #[test]
    fn refuses_a_log_that_does_not_fit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        let refuse = |rows| match Log::open_to_append(&Solo, &path, rows) {
            Err(Failure::Input(message)) => message,
            _ => panic!("a log that does not fit was accepted"),
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
