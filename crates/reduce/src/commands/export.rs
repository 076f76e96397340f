//! `export`: writes frames or a checkpoint in the formats of other programs.
//!
//! Data files hold one state and are written whole (`data_file`). All other formats are written
//! frame by frame by a `FrameWriter`, so that memory does not grow with the number of frames.

mod content;
mod csv;
mod data_file;
mod dump;
mod npz;
mod vtkhdf;
mod xyz;

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use clap::ValueEnum;

use crate::frame_selection::{FrameRange, Which};
use crate::printer::Printer;
use crate::results::Results;
use gshear_dem::failure::{Failure, Result};
use gshear_store::run_reader::RunFile;
use gshear_store::text_writer::PartFile;
use gshear_store::trajectory::frame_bytes;
use gshear_store::{checkpoint, memory};

use content::{ExportedFrame, ExportedModes, ExportedRun, GrainField};
use vtkhdf::VtkWriter;

/// Format of the exported file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ExportFormat {
    /// LAMMPS data file of atom_style sphere: one state
    LammpsData,
    /// The same for LIGGGHTS, which takes the density as that of a disk in 2D
    LiggghtsData,
    /// LAMMPS dump: grains, and contacts as a local dump beside it (OVITO)
    LammpsDump,
    /// VTKHDF in time: grains as points, contacts as lines (ParaView 5.12 or newer)
    Vtkhdf,
    /// Extended XYZ: grains (ASE, OVITO)
    Xyz,
    /// NumPy arrays by name: grains and contacts
    Npz,
    /// One table of grains and one of contacts
    Csv,
}

/// Write frames or a checkpoint in the format of another program
///
/// lammps-data and liggghts-data are data files of one state, of atom_style sphere. In 2D the
/// density gives each grain the mass of the disk per metre of depth. sample.packing reads both,
/// and sample.contacts the contacts that --contacts writes.
/// The other formats hold any number of frames; lammps-dump and csv write the contacts into
/// NAME-contacts beside the file, those with flat walls into NAME-wall-contacts. Types in LAMMPS'
/// formats: 1 free grains, 2 bottom wall, 3 top wall, from 4 on free grains of the further
/// materials; ids are those of the run plus 1.
/// Everything is in SI units, of a run in a box in its own ones.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, the folder of a run, run.h5/newtonian or another later stage, or a
    /// checkpoint
    pub run: PathBuf,
    /// Format of the file
    #[arg(long, value_enum)]
    format: ExportFormat,
    /// One frame: its number, from 0 on, or last [default for data files: last]
    #[arg(long, value_name = "N")]
    frame: Option<Which>,
    /// Frames A to B, both included, every Nth of them; .. is all [default: all]
    #[arg(long, value_name = "A..B[:N]", conflicts_with = "frame")]
    frames: Option<FrameRange>,
    /// Numbers to compute for every grain
    #[arg(long, value_enum, value_delimiter = ',', value_name = "FIELD,...")]
    fields: Vec<GrainField>,
    /// Eigenvectors of spectrum.h5, by their numbers from 0 on: displacement and rotation of
    /// every grain, real and imaginary parts, with the frame they are of
    #[arg(long, value_delimiter = ',', value_name = "K,...")]
    modes: Vec<usize>,
    /// Also write the contacts of a data file with their histories, into NAME-contacts.csv
    /// beside it, for sample.contacts
    #[arg(long)]
    contacts: bool,
    /// File of the eigenvectors [default: spectrum.h5 in the folder of the run]
    #[arg(long, value_name = "FILE", requires = "modes")]
    spectrum: Option<PathBuf>,
    /// File to write [default: frame-N.data, checkpoint.data, frames.FORMAT, or of a box
    /// aqs-frames.FORMAT or newtonian-frames.FORMAT in the folder of the run]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

impl Arguments {
    /// # Errors
    /// A missing frame, a damaged file, options that contradict each other, a file that cannot be
    /// written.
    pub fn run(&self, printer: &mut Printer) -> Result<()> {
        let paths = match self.format {
            ExportFormat::LammpsData => self.data_file(&data_file::LAMMPS)?,
            ExportFormat::LiggghtsData => self.data_file(&data_file::LIGGGHTS)?,
            _ => self.frames()?,
        };
        paths.iter().try_for_each(|path| printer.wrote(path))
    }

    fn data_file(&self, reader: &data_file::Reader) -> Result<Vec<PathBuf>> {
        if self.frames.is_some() || !self.fields.is_empty() || !self.modes.is_empty() {
            return Err(Failure::input(
                "--frames, --fields, --modes: a data file holds the state of one frame; give --frame, or another --format",
            ));
        }
        data_file::DataExport {
            run: &self.run,
            frame: self.frame,
            out: self.out.as_deref(),
            contacts: self.contacts,
        }
        .write(reader)
    }

    fn frames(&self) -> Result<Vec<PathBuf>> {
        if self.contacts {
            return Err(Failure::input(
                "--contacts: is of data files; give --format lammps-data, or leave it out: lammps-dump, vtkhdf, npz and csv have the contacts of every frame",
            ));
        }
        if checkpoint::is_checkpoint(&self.run) {
            return Err(Failure::input(format!(
                "{}: is a checkpoint; only lammps-data and liggghts-data are made of it",
                self.run.display()
            )));
        }
        let file = RunFile::open_any(&self.run)?;
        let modes = self.modes(&file)?;
        let numbers = self.numbers(&file, modes.as_ref())?;
        let exported = ExportedRun::new(&file, &self.fields, modes)?;
        if self.format == ExportFormat::Npz {
            let [grain, contact] = frame_bytes(file.form());
            let offsets = file.contact_offsets();
            let contacts = numbers.iter().map(|&t| offsets[t + 1] - offsets[t]);
            let bytes = (grain * file.grains().count() * numbers.len()) as f64
                + contact as f64 * contacts.sum::<u64>() as f64;
            let what = format!("{} frames as whole arrays", numbers.len());
            memory::require(
                bytes,
                &what,
                "give fewer with --frames, or another --format",
            )?;
        }
        let mut writer = self.writer(&file, &exported)?;
        exported.each_frame(&numbers, |frame| writer.frame(&exported, frame))?;
        writer.finish()
    }

    fn modes(&self, file: &RunFile) -> Result<Option<ExportedModes>> {
        if self.modes.is_empty() {
            return Ok(None);
        }
        let spectrum = match &self.spectrum {
            Some(spectrum) => spectrum.clone(),
            None => file.folder().join("spectrum.h5"),
        };
        ExportedModes::read(file, &spectrum, &self.modes).map(Some)
    }

    /// The numbers of the frames.
    fn numbers(&self, file: &RunFile, modes: Option<&ExportedModes>) -> Result<Vec<usize>> {
        let range = match (self.frame, self.frames, modes) {
            (Some(which), ..) => FrameRange::one(which.of(file)?),
            (None, Some(frames), _) => frames,
            (None, None, Some(modes)) => FrameRange::one(modes.frame),
            (None, None, None) => FrameRange::ALL,
        };
        let numbers = range.of(file)?;
        match modes {
            Some(modes) if numbers != [modes.frame] => Err(Failure::input(format!(
                "--modes: the eigenvectors are of frame {}; leave --frame and --frames out",
                modes.frame
            ))),
            _ => Ok(numbers),
        }
    }

    fn writer(&self, file: &RunFile, exported: &ExportedRun) -> Result<Box<dyn FrameWriter>> {
        let ending = match self.format {
            ExportFormat::LammpsDump => "dump",
            ExportFormat::Vtkhdf => "vtkhdf",
            ExportFormat::Xyz => "xyz",
            ExportFormat::Npz => "npz",
            ExportFormat::Csv => "csv",
            ExportFormat::LammpsData | ExportFormat::LiggghtsData => {
                unreachable!("data files are written whole")
            }
        };
        let name = file.stage().named(&format!("frames.{ending}"));
        let path = Results::path(self.out.as_deref(), file.folder(), &name)?;
        Ok(match self.format {
            ExportFormat::LammpsDump => Box::new(dump::DumpWriter::create(&path, exported)?),
            ExportFormat::Vtkhdf => Box::new(VtkWriter::create(&path, exported)?),
            ExportFormat::Xyz => Box::new(xyz::XyzWriter::create(&path)?),
            ExportFormat::Npz => Box::new(npz::NpzWriter::new(&path)),
            _ => Box::new(csv::CsvWriter::create(&path, exported)?),
        })
    }
}

/// Writes exported frames one after the other.
trait FrameWriter {
    /// Writes the next frame.
    fn frame(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> Result<()>;

    /// Closes the files, gives them their names and returns their paths.
    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>>;
}

/// Writes numbers, each after a space, in the shortest form that reads back to the same bits.
fn write_numbers(file: &mut PartFile, mut numbers: impl Iterator<Item = f64>) -> io::Result<()> {
    numbers.try_for_each(|number| write!(file, " {number:?}"))
}

/// The path of a second file beside `path`: `NAME-contacts.ENDING` for `contacts`.
fn beside(path: &Path, contacts: &str) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let name = match path.extension() {
        Some(ending) => format!("{stem}-{contacts}.{}", ending.to_string_lossy()),
        None => format!("{stem}-{contacts}"),
    };
    path.with_file_name(name)
}
