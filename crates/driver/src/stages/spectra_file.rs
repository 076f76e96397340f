//! `spectra.csv`: eigenvalues in time.

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use gshear_dem::failure::Failure;
use gshear_mpi_exchange::Parallel;
use gshear_store::collective::agree;

use super::spectrum::Eigenvalues;

/// The file, which rank 0 writes. Every call is collective.
pub(super) struct SpectraFile {
    file: Option<BufWriter<File>>,
    path: PathBuf,
    /// Lines after that of the names.
    lines: u64,
}

impl SpectraFile {
    /// A new file, or the one that is there with its first `lines` lines.
    pub fn open(
        exchange: &dyn Parallel,
        path: PathBuf,
        lines: Option<u64>,
    ) -> Result<Self, Failure> {
        let opened = match (exchange.rank(), lines) {
            (0, None) => create(&path).map(Some),
            (0, Some(lines)) => cut(&path, lines).map(Some),
            _ => Ok(None),
        };
        Ok(Self {
            file: agree(exchange, opened.map_err(|e| unwritten(&path, &e)))?,
            path,
            lines: lines.unwrap_or(0),
        })
    }

    /// Appends all eigenvalues at a time.
    pub fn write(
        &mut self,
        exchange: &dyn Parallel,
        time: f64,
        eigenvalues: &Eigenvalues,
    ) -> Result<(), Failure> {
        self.lines += eigenvalues.all().count() as u64;
        let wrote = match &mut self.file {
            None => Ok(()),
            Some(file) => eigenvalues.all().try_for_each(|(value, verdict)| {
                writeln!(
                    file,
                    "{time:?},{:?},{:?},{}",
                    value.re,
                    value.im,
                    verdict.name()
                )
            }),
        };
        agree(exchange, wrote.map_err(|e| unwritten(&self.path, &e)))
    }

    /// Brings all lines to the file. Returns their number.
    pub fn flush(&mut self, exchange: &dyn Parallel) -> Result<u64, Failure> {
        let wrote = self.file.as_mut().map_or(Ok(()), BufWriter::flush);
        agree(exchange, wrote.map_err(|e| unwritten(&self.path, &e)))?;
        Ok(self.lines)
    }
}

fn create(path: &Path) -> std::io::Result<BufWriter<File>> {
    let mut file = BufWriter::new(File::create(path)?);
    writeln!(file, "time,real,imaginary,verdict")?;
    Ok(file)
}

/// The file after its names and so many lines; what is behind them is cut off.
fn cut(path: &Path, lines: u64) -> std::io::Result<BufWriter<File>> {
    let mut file = OpenOptions::new().read(true).write(true).open(path)?;
    let mut reader = BufReader::new(&file);
    let mut length = 0;
    for _ in 0..=lines {
        match reader.skip_until(b'\n')? {
            0 => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            bytes => length += bytes as u64,
        }
    }
    file.set_len(length)?;
    file.seek(SeekFrom::Start(length))?;
    Ok(BufWriter::new(file))
}

fn unwritten(path: &Path, why: &std::io::Error) -> Failure {
    Failure::other(format!("{}: cannot be written: {why}", path.display()))
}
