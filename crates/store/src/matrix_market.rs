//! Reads and writes Matrix Market files (Boisvert, Pozo & Remington 1996, NISTIR 5935): sparse
//! matrices as text.
//!
//! No crate fits. nalgebra-sparse 0.12 and sprs 0.11 refuse `integer` and `pattern` files for real
//! numbers, and comments between entries; nalgebra-sparse needs 420 bytes per entry and names no
//! line for an index out of range; sprs panics at such an index and never names a line.
//! matrix-market-rs has had no release since 2023.

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::str::FromStr;

use faer::sparse::{SparseColMat, Triplet};

use super::text_writer::PartFile;
use gshear_dem::failure::{Failure, Result};

/// A sparse matrix.
pub type Matrix = SparseColMat<usize, f64>;
/// An entry of one.
pub type Entry = Triplet<usize, usize, f64>;

/// The first line of a file.
struct MatrixHeader {
    coordinate: bool,
    pattern: bool,
    /// Of a symmetric matrix (1) and of a skew one (-1), which store only one triangle: the factor
    /// of the mirrored entries.
    mirrored: Option<f64>,
}

/// Reads a real, integer or pattern matrix in `coordinate` or `array` format, of any symmetry.
/// Repeated entries are added.
///
/// # Errors
/// [`Failure::Input`] that names the line, if the file cannot be read or holds no such matrix.
pub fn read(path: &Path) -> Result<Matrix> {
    let file = File::open(path)
        .map_err(|e| Failure::input(format!("{}: cannot be read: {e}", path.display())))?;
    let mut lines = Lines {
        path,
        reader: BufReader::new(file),
        text: String::new(),
        number: 0,
    };
    let header = lines.header()?;
    if header.coordinate {
        coordinates(&mut lines, &header)
    } else {
        array(&mut lines, &header)
    }
}

/// Writes a matrix as `coordinate real general`. Numbers have the shortest form that reads back to
/// the same bits.
///
/// # Errors
/// [`Failure::Other`] if the file cannot be written.
pub fn write(path: &Path, matrix: &Matrix) -> Result<()> {
    let mut out = PartFile::create(path)?;
    let saved = save(&mut out, matrix);
    out.checked(saved)?;
    out.finish().map(drop)
}

fn save(out: &mut PartFile, matrix: &Matrix) -> std::io::Result<()> {
    let (rows, columns, count) = (matrix.nrows(), matrix.ncols(), matrix.compute_nnz());
    writeln!(out, "%%MatrixMarket matrix coordinate real general")?;
    writeln!(out, "{rows} {columns} {count}")?;
    for entry in matrix.triplet_iter() {
        writeln!(out, "{} {} {:?}", entry.row + 1, entry.col + 1, entry.val)?;
    }
    Ok(())
}

fn coordinates(lines: &mut Lines, header: &MatrixHeader) -> Result<Matrix> {
    let [rows, columns, count] = lines.sizes("rows, columns and number of entries")?;
    let mut entries = Vec::new();
    for read in 0..count {
        if !lines.next()? {
            return Err(lines.wrong(format!("the file ends after {read} of {count} entries")));
        }
        let mut words = lines.text.split_ascii_whitespace();
        let row: usize = lines.word(&mut words, "row")?;
        let column: usize = lines.word(&mut words, "column")?;
        let mut value = 1.0;
        if !header.pattern {
            value = lines.word(&mut words, "value")?;
        }
        lines.end(words)?;
        if !(1..=rows).contains(&row) || !(1..=columns).contains(&column) {
            let message = format!("row {row}, column {column}: the matrix is {rows} × {columns}");
            return Err(lines.wrong(message));
        }
        lines.finite(value)?;
        let entry = Entry::new(row - 1, column - 1, value);
        add(&mut entries, entry, header.mirrored);
    }
    if lines.next()? {
        return Err(lines.wrong(format!("more than the {count} entries announced")));
    }
    let matrix = Matrix::try_new_from_triplets(rows, columns, &entries);
    matrix.map_err(|_| lines.wrong(format!("there is no memory for {rows} × {columns}")))
}

fn array(lines: &mut Lines, header: &MatrixHeader) -> Result<Matrix> {
    let [rows, columns] = lines.sizes("rows and columns")?;
    let mut entries = Vec::new();
    for column in 0..columns {
        let first = match header.mirrored {
            None => 0,
            Some(sign) if sign > 0.0 => column,
            Some(_) => column + 1,
        };
        for row in first..rows {
            if !lines.next()? {
                let (row, column) = (row + 1, column + 1);
                let message = format!("the file ends before row {row}, column {column}");
                return Err(lines.wrong(message));
            }
            let mut words = lines.text.split_ascii_whitespace();
            let value: f64 = lines.word(&mut words, "value")?;
            lines.end(words)?;
            lines.finite(value)?;
            if value != 0.0 {
                let entry = Entry::new(row, column, value);
                add(&mut entries, entry, header.mirrored);
            }
        }
    }
    if lines.next()? {
        return Err(lines.wrong("more entries than the matrix has".into()));
    }
    Ok(matrix(rows, columns, &entries))
}

fn add(entries: &mut Vec<Entry>, entry: Entry, mirrored: Option<f64>) {
    entries.push(entry);
    if let Some(sign) = mirrored
        && entry.row != entry.col
    {
        entries.push(Entry::new(entry.col, entry.row, sign * entry.val));
    }
}

/// The matrix of these entries, those of one place added.
///
/// # Panics
/// If an entry is outside of the matrix.
pub fn matrix(rows: usize, columns: usize, entries: &[Entry]) -> Matrix {
    Matrix::try_new_from_triplets(rows, columns, entries).expect("indices within the matrix")
}

/// The lines of a file, with their numbers for messages.
struct Lines<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    text: String,
    number: usize,
}

impl Lines<'_> {
    fn header(&mut self) -> Result<MatrixHeader> {
        const RIGHT: &str = "must be %%MatrixMarket matrix coordinate|array real|integer|pattern general|symmetric|skew-symmetric";
        self.read()?;
        let text = self.text.to_ascii_lowercase();
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        let ["%%matrixmarket", "matrix", format, field, symmetry] = words[..] else {
            return Err(self.wrong(RIGHT.into()));
        };
        let coordinate = match format {
            "coordinate" => true,
            "array" => false,
            _ => return Err(self.wrong(format!("{format}: {RIGHT}"))),
        };
        let pattern = match field {
            "real" | "integer" => false,
            "pattern" if coordinate => true,
            _ => return Err(self.wrong(format!("{field}: {RIGHT}"))),
        };
        let mirrored = match symmetry {
            "general" => None,
            "symmetric" => Some(1.0),
            "skew-symmetric" => Some(-1.0),
            _ => return Err(self.wrong(format!("{symmetry}: {RIGHT}"))),
        };
        Ok(MatrixHeader {
            coordinate,
            pattern,
            mirrored,
        })
    }

    fn sizes<const COUNT: usize>(&mut self, what: &str) -> Result<[usize; COUNT]> {
        if !self.next()? {
            return Err(self.wrong(format!("the file ends before {what}")));
        }
        let words = self.text.split_ascii_whitespace();
        let numbers: Option<Vec<usize>> = words.map(|word| word.parse().ok()).collect();
        let sizes = numbers.and_then(|numbers| numbers.try_into().ok());
        sizes.ok_or_else(|| self.wrong(format!("must hold {what}")))
    }

    /// Goes to the next line that is neither empty nor a comment. False at the end of the file.
    fn next(&mut self) -> Result<bool> {
        while self.read()? {
            let text = self.text.trim_ascii();
            if !text.is_empty() && !text.starts_with('%') {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn read(&mut self) -> Result<bool> {
        self.text.clear();
        self.number += 1;
        let read = self.reader.read_line(&mut self.text);
        read.map(|length| length > 0)
            .map_err(|e| self.wrong(format!("cannot be read: {e}")))
    }

    fn word<'t, W: FromStr>(
        &self,
        words: &mut impl Iterator<Item = &'t str>,
        what: &str,
    ) -> Result<W> {
        let Some(word) = words.next() else {
            return Err(self.wrong(format!("{what} missing")));
        };
        word.parse()
            .map_err(|_| self.wrong(format!("{what} {word}: must be a number")))
    }

    fn end<'t>(&self, mut words: impl Iterator<Item = &'t str>) -> Result<()> {
        match words.next() {
            Some(word) => Err(self.wrong(format!("{word}: one entry a line"))),
            None => Ok(()),
        }
    }

    fn finite(&self, value: f64) -> Result<()> {
        if value.is_finite() {
            return Ok(());
        }
        Err(self.wrong(format!("value {value}: must be finite")))
    }

    fn wrong(&self, message: String) -> Failure {
        let (path, number) = (self.path.display(), self.number);
        Failure::input(format!("{path}, line {number}: {message}"))
    }
}
