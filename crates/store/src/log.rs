//! `log.csv`: the time series as text.

use super::collective::on_root;
use super::csv_table::{TableFile, first_cell, rows_up_to};
use super::disk;
use super::run_reader::Series;
use super::sound;
use gshear_dem::columns::Column;
use gshear_dem::domain::Exchange;
use gshear_dem::failure::{Failure, Result};
use std::io::{BufRead, BufReader};
use std::path::Path;

/// The columns of a log after step and time: some of those of the time series, in their own order.
#[derive(Debug, Clone, Copy)]
pub struct LogColumns<'a> {
    /// Those of the time series.
    pub series: &'a [Column],
    /// The places among them of those of the log.
    pub places: &'a [usize],
}

impl LogColumns<'_> {
    fn columns(self) -> impl Iterator<Item = Column> {
        self.places.iter().map(move |place| self.series[*place])
    }

    /// The names of all columns.
    pub fn names(self) -> Vec<&'static str> {
        let row = self.columns().map(|column| column.name);
        ["step", "time"].into_iter().chain(row).collect()
    }
}

/// Writer of the log. Only rank 0 writes.
pub struct Log {
    file: Option<TableFile>,
    /// The places of its columns in a row of the time series.
    places: Vec<usize>,
}

impl Log {
    fn of(file: Option<TableFile>, columns: LogColumns<'_>) -> Self {
        Self {
            file,
            places: columns.places.to_vec(),
        }
    }

    /// Creates the log, replacing an existing file. Collective.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn create(exchange: &dyn Exchange, path: &Path, columns: LogColumns<'_>) -> Result<Self> {
        let file = on_root(exchange, || {
            TableFile::create(path, &columns.names()).map(Some)
        })?;
        Ok(Self::of(file, columns))
    }

    /// Opens an existing log to continue after the step `last`. Later rows are removed. Collective.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub fn open_to_append(
        exchange: &dyn Exchange,
        path: &Path,
        columns: LogColumns<'_>,
        last: u64,
        rows: u64,
    ) -> Result<Self> {
        let names = columns.names();
        let file = on_root(exchange, || {
            let file = match Self::check(path, columns, last, rows)? {
                Some(rows) => TableFile::open_to_append(path, &names, rows)?,
                None => TableFile::create(path, &names)?,
            };
            Ok(Some(file))
        })?;
        Ok(Self::of(file, columns))
    }

    /// Returns the number of rows of a log up to the step `last`; `None` if a
    /// killed program left it without its first line, and there is nothing to continue. `rows`:
    /// their number in `run.h5`, which may have fewer if it was begun anew. Writes nothing. Not
    /// collective.
    ///
    /// # Errors
    /// [`Failure::Input`] if the file has fewer rows or another header.
    pub fn check(
        path: &Path,
        columns: LogColumns<'_>,
        last: u64,
        rows: u64,
    ) -> Result<Option<u64>> {
        let stored = rows_up_to(path, last as f64)?;
        if stored.is_none() && rows == 0 {
            return Ok(None);
        }
        check_columns(path, columns)?;
        let stored = stored.unwrap_or(0);
        if stored < rows {
            let why = format!(
                "it has {stored} rows up to the step of the checkpoint, which counts {rows}"
            );
            return Err(unfit(path, why));
        }
        Ok(Some(stored))
    }

    /// Compares the rows up to the step `last` with those of the same steps in `run.h5`, whose
    /// columns at these `places` the log has. Writes nothing. Not collective.
    ///
    /// # Errors
    /// [`Failure::Input`] that names the first line that differs.
    pub fn compare(path: &Path, last: u64, series: &Series, places: &[usize]) -> Result<()> {
        let file = sound::regular(path).map_err(|e| unfit(path, e.to_string()))?;
        let lines = BufReader::new(file).split(b'\n');
        for (number, line) in lines.enumerate().skip(1) {
            let line = line.map_err(|e| unfit(path, e.to_string()))?;
            let Some(step) = first_cell::<u64>(&line).filter(|step| *step <= last) else {
                break;
            };
            // Rows of before a lost run.h5 stand in the log alone.
            let Ok(row) = series.step.binary_search(&step) else {
                continue;
            };
            let numbers = places.iter().map(|place| series.columns[*place][row]);
            let wanted: Vec<String> = cells(step, series.time[row], numbers).collect();
            if line != wanted.join(",").as_bytes() {
                let why = format!(
                    "line {} differs from the row of step {step} in run.h5; put the file back, or \
                     continue with --out OTHER, where the files begin anew",
                    number + 1
                );
                return Err(unfit(path, why));
            }
        }
        Ok(())
    }

    /// Writes the next row. Not collective: only rank 0 can fail.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn row(&mut self, step: u64, time: f64, row: &[f64]) -> Result<()> {
        let numbers = self.places.iter().map(|place| row[*place]);
        let cells = cells(step, time, numbers);
        self.file.as_mut().map_or(Ok(()), |file| file.row(cells))
    }

    /// Passes the rows to the file system. Not collective: only rank 0 can fail.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn flush(&mut self) -> Result<()> {
        self.file.as_mut().map_or(Ok(()), TableFile::flush)
    }

    /// Writes the rows to disk. Not collective: only rank 0 can fail.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn sync(&mut self) -> Result<()> {
        self.file.as_mut().map_or(Ok(()), TableFile::sync)
    }
}

fn unfit(path: &Path, why: String) -> Failure {
    let path = path.display();
    disk::unread(format!("{path}: cannot continue this log: {why}"))
}

/// The cells of a row.
fn cells(step: u64, time: f64, row: impl Iterator<Item = f64>) -> impl Iterator<Item = String> {
    let numbers = [time].into_iter().chain(row);
    [step.to_string()].into_iter().chain(numbers.map(shortest))
}

/// Keys that decide the columns of a log.
const KEYS_OF_COLUMNS: &str = "output.temperatures, output.columns or [[observable]]";

/// Checks that an existing log has these columns.
fn check_columns(path: &Path, columns: LogColumns<'_>) -> Result<()> {
    let mut line = String::new();
    sound::regular(path)
        .and_then(|file| BufReader::new(file).read_line(&mut line))
        .map_err(|e| unfit(path, e.to_string()))?;
    let mut names = line.trim_end().split(',');
    if (names.next(), names.next()) != (Some("step"), Some("time")) {
        let why = "its first line must begin with step,time";
        return Err(unfit(path, why.into()));
    }
    for column in columns.columns() {
        let name = names.next().unwrap_or("nothing");
        if name != column.name {
            let why = format!(
                "it lacks the column {column} (found: {name}); another version wrote it, its protocol \
                 imposed velocities alone and this one more, its bottom did not vibrate along x, its cell kept its lengths, or \
                 {KEYS_OF_COLUMNS} has changed"
            );
            return Err(unfit(path, why));
        }
    }
    match names.next() {
        None => Ok(()),
        Some(name) => {
            let why = format!(
                "its column {name} would not be continued; another version wrote it, or {KEYS_OF_COLUMNS} has changed"
            );
            Err(unfit(path, why))
        }
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
    use gshear_dem::state::SeriesRow;

    fn row(k: u64) -> SeriesRow {
        let numbers: [f64; SeriesRow::COLUMNS.len()] =
            std::array::from_fn(|c| (k as f64 + 0.1) * 10f64.powi(4 * c as i32 - 20) / 3.0);
        SeriesRow::from_columns(numbers)
    }

    const ALL: [usize; SeriesRow::COLUMNS.len()] = {
        let mut places = [0; SeriesRow::COLUMNS.len()];
        let mut k = 0;
        while k < places.len() {
            places[k] = k;
            k += 1;
        }
        places
    };

    const COLUMNS: LogColumns<'static> = LogColumns {
        series: &SeriesRow::COLUMNS,
        places: &ALL,
    };

    fn text(path: &Path) -> String {
        std::fs::read_to_string(path).unwrap()
    }

    #[test]
    fn a_changed_digit_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        let mut log = Log::create(&Solo, &path, COLUMNS).unwrap();
        (0..5).for_each(|k| log.row(10 * k, 0.1 * k as f64, row(k).as_ref()).unwrap());
        log.flush().unwrap();
        // The first rows stand in the log alone.
        let column = |c: usize| (2..5).map(|k| row(k).columns()[c]).collect();
        let series = Series {
            declared: &SeriesRow::COLUMNS,
            step: vec![20, 30, 40],
            time: (2..5).map(|k| 0.1 * f64::from(k)).collect(),
            columns: (0..SeriesRow::COLUMNS.len()).map(column).collect(),
        };
        let compare = |last| Log::compare(&path, last, &series, &ALL).map_err(|e| e.to_string());
        assert_eq!(compare(40), Ok(()));
        let whole = text(&path);
        let digit = whole.rfind('3').unwrap();
        let mut changed = whole.clone();
        changed.replace_range(digit..=digit, "4");
        std::fs::write(&path, changed).unwrap();
        assert!(compare(40).unwrap_err().contains("line 6 differs"));
        assert_eq!(compare(39), Ok(()));
    }

    #[test]
    fn numbers_read_back_to_the_same_bits() {
        let values = [0.0, -0.0, 1.0, 0.1, 1e-300, 7.2e-7, 1e22, 13_000.0, 5e-324];
        for value in values.into_iter().chain([f64::MIN_POSITIVE, f64::MAX]) {
            let read: f64 = shortest(value).parse().unwrap();
            assert_eq!(read.to_bits(), value.to_bits());
            assert!(shortest(value).len() <= 24);
        }
        assert_eq!([1.0, 7.2e-7, 1e22].map(shortest), ["1", "7.2e-7", "1e22"]);
    }

    #[test]
    fn goes_on_after_the_rows_that_count() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        let mut log = Log::create(&Solo, &path, COLUMNS).unwrap();
        (0..5).for_each(|k| log.row(k, k as f64, row(k).as_ref()).unwrap());
        log.flush().unwrap();
        let whole = text(&path);
        assert!(whole.starts_with("step,time,strain,"));
        let third = whole.lines().nth(3).unwrap().split(',');
        let third: Vec<f64> = third.map(|v| v.parse().unwrap()).collect();
        assert_eq!(third[2..], row(2).columns());

        // As left by a killed program: too many rows, the last one incomplete.
        std::fs::write(&path, format!("{whole}5,0.1")).unwrap();
        let mut log = Log::open_to_append(&Solo, &path, COLUMNS, 2, 3).unwrap();
        (3..5).for_each(|k| log.row(k, k as f64, row(k).as_ref()).unwrap());
        drop(log);
        assert_eq!(text(&path), whole);

        // As left before the first line was written: begun again if nothing counts on it.
        for part in ["", "step,ti"] {
            std::fs::write(&path, part).unwrap();
            let open = |rows| Log::open_to_append(&Solo, &path, COLUMNS, 2, rows);
            assert!(open(1).is_err());
            drop(open(0).unwrap());
            let names = COLUMNS.names().join(",");
            assert_eq!(text(&path), format!("{names}\n"));
        }
    }

    #[test]
    fn other_columns_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        let open = |names: &str| {
            std::fs::write(&path, format!("{names}\n")).unwrap();
            Log::open_to_append(&Solo, &path, COLUMNS, 0, 0).map(drop)
        };
        let names = COLUMNS.names().join(",");
        assert!(open(&names).is_ok());
        let refused = |names: &str| open(names).unwrap_err().to_string();
        let renamed = names.replace("slip_rate", "rate");
        assert!(refused(&renamed).contains("lacks the column slip_rate"));
        assert!(refused(&names[..names.rfind(',').unwrap()]).contains("energy_residual"));
        assert!(refused(&format!("{names},more")).contains("column more"));
    }

    #[test]
    fn chosen_columns_keep_their_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        let columns = LogColumns {
            places: &[3, 0],
            ..COLUMNS
        };
        let mut log = Log::create(&Solo, &path, columns).unwrap();
        log.row(7, 0.5, row(1).as_ref()).unwrap();
        drop(log);
        let [strain, .., shear_force] = row(1).columns()[..4] else {
            panic!("four columns")
        };
        let [strain, shear_force] = [strain, shear_force].map(shortest);
        let expected = format!("step,time,shear_force,strain\n7,0.5,{shear_force},{strain}\n");
        assert_eq!(text(&path), expected);
        assert!(Log::check(&path, columns, 7, 1).is_ok());
        let said = Log::check(&path, COLUMNS, 7, 1).unwrap_err().to_string();
        assert!(said.contains("lacks the column strain (found: shear_force)"));
        assert!(said.contains("output.columns"));
    }

    #[test]
    fn refuses_a_log_that_does_not_fit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        let refuse = |rows| match Log::open_to_append(&Solo, &path, COLUMNS, 9, rows) {
            Err(Failure::Input(message)) => message,
            _ => panic!("a log that does not fit was accepted"),
        };
        assert!(refuse(0).contains("log.csv"));
        std::fs::write(&path, "a,b\n1,2\n").unwrap();
        assert!(refuse(1).contains("first line"));
        let mut log = Log::create(&Solo, &path, COLUMNS).unwrap();
        (0..2).for_each(|k| log.row(k, 0.0, row(k).as_ref()).unwrap());
        drop(log);
        let fewer = "it has 2 rows up to the step of the checkpoint, which counts 3";
        assert!(refuse(3).contains(fewer));
    }
}
