//! `export`: writes frames or a checkpoint in the formats of other programs.
//!
//! Data files hold one state and are written whole (`data_file`). All other formats are written
//! frame by frame by a `FrameWriter`, so that memory does not grow with the number of frames.

mod content;
mod csv;
mod data_file;
mod dump;
mod npz;
mod selection;
mod vtkhdf;
mod xyz;

use std::path::{Path, PathBuf};

use clap::ValueEnum;

use gshear_dem::failure::Failure;
use gshear_store::checkpoint;
use gshear_store::run_reader::{RunFile, RunStage};

pub use content::GrainField;
use content::{ExportedFrame, ExportedModes, ExportedRun};
use data_file::Reader;
pub use selection::{FrameRange, Which};

/// Format of the exported file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
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

/// What is exported.
#[derive(Debug, Clone)]
pub struct ExportRequest {
    /// Format of the file.
    pub format: ExportFormat,
    /// The frame of a data file; of other formats the only frame.
    pub frame: Option<Which>,
    /// Frames of formats that hold several.
    pub frames: Option<FrameRange>,
    /// Numbers of every grain in addition to its state.
    pub fields: Vec<GrainField>,
    /// Eigenvectors of the state, by their numbers in the file of them.
    pub modes: Vec<usize>,
    /// The file of eigenvectors; `None`: `spectrum.h5` in the folder of the run.
    pub spectrum: Option<PathBuf>,
    /// The file to write; `None`: a file in the folder of the run.
    pub out: Option<PathBuf>,
}

/// Writes exported frames one after the other.
trait FrameWriter {
    /// Writes the next frame.
    fn frame(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> Result<(), Failure>;

    /// Closes the files, gives them their names and returns their paths.
    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, Failure>;
}

/// Writes the frames of `run`, which is a run or, for data files, a checkpoint. Returns the paths of
/// the files.
///
/// # Errors
/// A missing frame, a damaged file, options that contradict each other, a file that cannot be
/// written.
pub fn write(run: &Path, request: &ExportRequest) -> Result<Vec<PathBuf>, Failure> {
    let reader = match request.format {
        ExportFormat::LammpsData => Some(Reader::Lammps),
        ExportFormat::LiggghtsData => Some(Reader::Liggghts),
        _ => None,
    };
    if let Some(reader) = reader {
        if request.frames.is_some() || !request.fields.is_empty() || !request.modes.is_empty() {
            return Err(Failure::input(
                "--frames, --fields, --modes: a data file holds the state of one frame; give --frame, or another --format",
            ));
        }
        let path = data_file::write(run, reader, request.frame, request.out.as_deref())?;
        return Ok(vec![path]);
    }
    if checkpoint::is_checkpoint(run) {
        return Err(Failure::input(format!(
            "{}: is a checkpoint; only lammps-data and liggghts-data are made of it",
            run.display()
        )));
    }
    let file = RunFile::open_any(run)?;
    let modes = if request.modes.is_empty() {
        None
    } else {
        let beside = || file.folder().join("spectrum.h5");
        let spectrum = request.spectrum.clone().unwrap_or_else(beside);
        Some(ExportedModes::read(&file, &spectrum, &request.modes)?)
    };
    let range = match (request.frame, request.frames) {
        (Some(which), None) => FrameRange::one(which.of(&file)?),
        (None, Some(frames)) => frames,
        (None, None) => (modes.as_ref()).map_or(FrameRange::ALL, |of| FrameRange::one(of.frame)),
        (Some(_), Some(_)) => {
            return Err(Failure::input("--frame, --frames: give one of them"));
        }
    };
    let numbers = range.of(&file)?;
    if let Some(modes) = modes.as_ref().filter(|modes| numbers != [modes.frame]) {
        return Err(Failure::input(format!(
            "--modes: the eigenvectors are of frame {}; leave --frame and --frames out",
            modes.frame
        )));
    }
    let exported = ExportedRun::new(&file, &request.fields, modes)?;
    let named = |ending: &str| match &request.out {
        Some(out) => out.clone(),
        None => {
            let stem = match file.stage() {
                RunStage::Shear => "frames",
                RunStage::Strain => "aqs-frames",
                RunStage::Newtonian => "newtonian-frames",
            };
            file.folder().join(format!("{stem}.{ending}"))
        }
    };
    let mut writer: Box<dyn FrameWriter> = match request.format {
        ExportFormat::LammpsDump => Box::new(dump::DumpWriter::create(&named("dump"))?),
        ExportFormat::Vtkhdf => Box::new(vtkhdf::VtkWriter::create(&named("vtkhdf"), &exported)?),
        ExportFormat::Xyz => Box::new(xyz::XyzWriter::create(&named("xyz"))?),
        ExportFormat::Npz => Box::new(npz::NpzWriter::new(&named("npz"))),
        ExportFormat::Csv => Box::new(csv::CsvWriter::create(&named("csv"), &exported)?),
        ExportFormat::LammpsData | ExportFormat::LiggghtsData => unreachable!("written above"),
    };
    exported.each_frame(&numbers, |frame| writer.frame(&exported, frame))?;
    writer.finish()
}

/// The path of a second file beside `path`: `NAME-contacts.ENDING`.
fn contacts_beside(path: &Path) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let name = match path.extension() {
        Some(ending) => format!("{stem}-contacts.{}", ending.to_string_lossy()),
        None => format!("{stem}-contacts"),
    };
    path.with_file_name(name)
}
