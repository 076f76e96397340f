//! Tables as CSV (RFC 4180): a line of column names, then one line per row.

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use csv::{StringRecord, Writer};
use rustix::fs::OFlags;
use serde::de::DeserializeOwned;

use super::disk::{self, unwritten};
use super::sound;
use super::text_writer;
use gshear_dem::failure::{Failure, Result};

/// A value that a cell can hold. Numbers have the shortest form that reads back to the same bits.
pub trait TableCell {
    /// Returns the text of the cell, without quotes.
    fn text(&self) -> String;
}

impl TableCell for f64 {
    fn text(&self) -> String {
        format!("{self:?}")
    }
}

macro_rules! cells_by_display {
    ($($kind:ty)*) => {$(
        impl TableCell for $kind {
            fn text(&self) -> String {
                self.to_string()
            }
        }
    )*};
}

cells_by_display!(str String char u8 u32 u64 usize);

impl<C: TableCell + ?Sized> TableCell for &C {
    fn text(&self) -> String {
        (**self).text()
    }
}

/// `None` is an empty cell.
impl<C: TableCell> TableCell for Option<C> {
    fn text(&self) -> String {
        self.as_ref().map_or_else(String::new, TableCell::text)
    }
}

/// A table written as a whole: rows, and the columns as functions of a row.
pub struct Table<'a, I: IntoIterator> {
    rows: I,
    names: StringRecord,
    values: Vec<CellWriter<'a, I::Item>>,
}

/// Appends the cells of some columns to a record.
type CellWriter<'a, R> = Box<dyn Fn(&R, &mut StringRecord) + 'a>;

impl<'a, I: IntoIterator> Table<'a, I> {
    /// Creates a table without columns.
    pub fn of(rows: I) -> Self {
        Self {
            rows,
            names: StringRecord::new(),
            values: Vec::new(),
        }
    }

    /// Adds a column.
    pub fn column<C: TableCell>(self, name: &str, value: impl Fn(&I::Item) -> C + 'a) -> Self {
        self.columns([name], move |row| [value(row)])
    }

    /// Adds several columns. `values` must return one value per name.
    pub fn columns<V: IntoIterator<Item: TableCell>>(
        mut self,
        names: impl IntoIterator<Item: AsRef<str>>,
        values: impl Fn(&I::Item) -> V + 'a,
    ) -> Self {
        self.names.extend(names);
        self.values.push(Box::new(move |row, record| {
            for value in values(row) {
                record.push_field(&value.text());
            }
        }));
        self
    }

    /// Returns the table as CSV.
    ///
    /// # Panics
    /// If the number of values in a row differs from the number of names.
    pub fn csv(self) -> String {
        let columns = self.names.len();
        let mut writer = Writer::from_writer(line(&self.names));
        let mut record = StringRecord::new();
        for row in self.rows {
            record.clear();
            for values in &self.values {
                values(&row, &mut record);
            }
            assert_eq!(record.len(), columns, "one value for each name");
            writer.write_record(&record).expect(IN_MEMORY);
        }
        String::from_utf8(writer.into_inner().expect(IN_MEMORY)).expect("cells are UTF-8")
    }
}

const IN_MEMORY: &str = "a vector takes every record";

/// Formats a record with its line break.
fn line(record: &StringRecord) -> Vec<u8> {
    let mut writer = Writer::from_writer(Vec::new());
    writer.write_record(record).expect(IN_MEMORY);
    writer.into_inner().expect(IN_MEMORY)
}

/// Why a table is not continued.
const NO_FILE: &str = "it is no file, or a link to one; put the file itself here";

/// A table that grows in its file, row by row.
pub struct TableFile {
    path: PathBuf,
    writer: Writer<File>,
}

impl TableFile {
    /// Creates a table without rows, replacing an existing file.
    ///
    /// # Errors
    /// [`Failure::Other`] if the file cannot be written.
    pub fn create(path: &Path, names: &[&str]) -> Result<Self> {
        let file = create_with_names(path, names).map_err(|e| unwritten(path, &e))?;
        Ok(Self {
            path: path.into(),
            writer: Writer::from_writer(file),
        })
    }

    /// Opens a table to continue after its first `rows` rows; later rows are removed.
    ///
    /// # Errors
    /// [`Failure::Input`] if the file has other columns or fewer rows.
    pub fn open_to_append(path: &Path, names: &[&str], rows: u64) -> Result<Self> {
        if path.symlink_metadata().is_ok_and(|place| !place.is_file()) {
            return Err(unfit(path, NO_FILE));
        }
        let mut options = OpenOptions::new();
        options.custom_flags(OFlags::NOFOLLOW.bits() as i32);
        let file = options.read(true).append(true).open(path);
        let file = file.map_err(|e| unfit(path, e))?;
        let names = line(&StringRecord::from(names));
        let mut reader = BufReader::new(&file);
        let (mut text, mut end) = (Vec::new(), 0);
        for row in 0..=rows {
            text.clear();
            let length = reader.read_until(b'\n', &mut text);
            end += length.map_err(|e| unfit(path, e))? as u64;
            if row == 0 && text != names {
                let names = String::from_utf8_lossy(&names);
                let names = names.trim_end();
                return Err(unfit(path, format!("its first line must be {names}")));
            }
            if text.last() != Some(&b'\n') {
                let has = row - 1;
                let why = format!("it has {has} rows, the checkpoint counts {rows}");
                return Err(unfit(path, why));
            }
        }
        file.set_len(end).map_err(|e| unwritten(path, &e))?;
        Ok(Self {
            path: path.into(),
            writer: Writer::from_writer(file),
        })
    }

    /// Appends a row.
    ///
    /// # Errors
    /// [`Failure::Other`] if the file cannot be written.
    pub fn row(&mut self, cells: impl IntoIterator<Item: TableCell>) -> Result<()> {
        let record: StringRecord = cells.into_iter().map(|cell| cell.text()).collect();
        let written = self.writer.write_record(&record);
        written.map_err(|e| unwritten(&self.path, &e))
    }

    /// Passes the rows to the file system.
    ///
    /// # Errors
    /// [`Failure::Other`] if the file cannot be written.
    pub fn flush(&mut self) -> Result<()> {
        self.writer.flush().map_err(|e| unwritten(&self.path, &e))
    }

    /// Writes the rows to disk.
    ///
    /// # Errors
    /// [`Failure::Other`] if the file cannot be written.
    pub fn sync(&mut self) -> Result<()> {
        self.flush()?;
        let synced = self.writer.get_ref().sync_data();
        synced.map_err(|e| unwritten(&self.path, &e))
    }
}

/// Creates a table of these names, which are there as soon as the file is.
fn create_with_names(path: &Path, names: &[&str]) -> std::io::Result<File> {
    let mut part = disk::beside(path)?;
    part.write_all(&line(&StringRecord::from(names)))?;
    text_writer::give_name(part, path)
}

fn unfit(path: &Path, why: impl std::fmt::Display) -> Failure {
    let path = path.display();
    Failure::input(format!("{path}: cannot continue this file: {why}"))
}

fn unread(path: &Path, why: impl std::fmt::Display) -> Failure {
    let path = path.display();
    disk::unread(format!("{path}: cannot continue this file: {why}"))
}

/// The number of whole rows up to the first one whose first cell is greater than `last`; `None` if
/// a killed program left not even the first line. Writes nothing.
///
/// # Errors
/// A file that cannot be read.
pub fn rows_up_to(path: &Path, last: f64) -> Result<Option<u64>> {
    if path.symlink_metadata().is_ok_and(|place| !place.is_file()) {
        return Err(unread(path, NO_FILE));
    }
    let mut reader = BufReader::new(sound::regular(path).map_err(|e| unread(path, e))?);
    let (mut line, mut lines) = (Vec::new(), 0u64);
    loop {
        line.clear();
        let read = reader.read_until(b'\n', &mut line);
        read.map_err(|e| unread(path, e))?;
        let counts = lines == 0 || first_cell(&line).is_some_and(|first: f64| first <= last);
        // A killed program may leave part of a line.
        if !line.ends_with(b"\n") || !counts {
            return Ok(lines.checked_sub(1));
        }
        lines += 1;
    }
}

/// The first cell of a line.
pub(crate) fn first_cell<T: FromStr>(line: &[u8]) -> Option<T> {
    let first = line.split(|&byte| byte == b',').next()?;
    std::str::from_utf8(first).ok()?.parse().ok()
}

/// Reads the rows of a table, columns by their names.
///
/// # Errors
/// [`Failure::Input`] that names the line, if the file cannot be read or a row does not fit `R`.
pub fn read<R: DeserializeOwned>(path: &Path) -> Result<Vec<R>> {
    rows(path).map_err(|e| Failure::input(format!("{}: {e}", path.display())))
}

fn rows<R: DeserializeOwned>(path: &Path) -> csv::Result<Vec<R>> {
    let mut reader = csv::Reader::from_reader(sound::regular(path)?);
    reader.deserialize().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_quoted_where_necessary() {
        let rows = [("plain", 0.1, Some(1)), ("a, \"b\"", 1e-300, None)];
        let table = Table::of(rows)
            .column("text", |row| row.0)
            .columns(["number", "twice"], |row| [row.1, 2.0 * row.1])
            .column("count", |row| row.2.map(|count: u32| count));
        let expected =
            "text,number,twice,count\nplain,0.1,0.2,1\n\"a, \"\"b\"\"\",1e-300,2e-300,\n";
        assert_eq!(table.csv(), expected);
    }

    #[test]
    fn reads_columns_by_name_and_names_a_wrong_line() {
        #[derive(Debug, PartialEq, serde::Deserialize)]
        struct Row {
            b: f64,
            a: String,
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read::<Row>(&path).map_err(|e| e.to_string())
        };
        let row = Row {
            b: 0.1,
            a: "x, y".into(),
        };
        assert_eq!(read("a,c,b\n\"x, y\",,0.1\n"), Ok(vec![row]));
        let wrong = read("a,b\nx,1\ny,z\n").unwrap_err();
        assert!(
            wrong.contains("table.csv") && wrong.contains("line: 3"),
            "{wrong}"
        );
    }
}
