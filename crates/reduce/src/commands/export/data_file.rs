//! Data files of LAMMPS and LIGGGHTS: one state, from which a simulation can begin.

use std::path::{Path, PathBuf};

use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::failure::{Failure, Result};
use gshear_driver::exported_state::ExportedState;
use gshear_scene::{Dimensions, lammps_data};
use gshear_store::file_names::folder_of;
use gshear_store::run_reader::RunFile;
use gshear_store::{checkpoint, dictionary, provenance, text_writer};

use super::beside;
use crate::frame_selection::Which;
use crate::results::Results;
use crate::stored_state::{StateSelection, StoredState};

/// The program that reads a data file.
pub struct Reader {
    name: &'static str,
    /// Comments in the file of disks on the column `density`.
    on_density: [&'static str; 2],
    /// The volume with which it computes the mass of a disk of this radius.
    volume: fn(f64) -> f64,
}

/// LAMMPS.
pub const LAMMPS: Reader = Reader {
    name: "LAMMPS",
    on_density: [
        "density is that of a sphere with the mass of the disk per metre of depth: density pi d^3/6 = rho pi d^2/4. Forces and",
        "stiffnesses are per metre of depth; fix nve/sphere with disc gives the disk's moment of inertia, too.",
    ],
    volume: Three::volume,
};
/// LIGGGHTS, which takes the density as that of a disk in 2D.
pub const LIGGGHTS: Reader = Reader {
    name: "LIGGGHTS",
    on_density: [
        "density is that of the disk: with dimension 2 LIGGGHTS computes the mass per metre of depth, pi d^2/4 density. Forces and",
        "stiffnesses are per metre of depth; fix nve/sphere takes the disk's moment of inertia in 2 dimensions.",
    ],
    volume: Two::volume,
};

/// A state that is exported.
pub struct DataExport<'a> {
    /// A run or a checkpoint.
    pub run: &'a Path,
    /// The frame of a run; the last, if none is given.
    pub frame: Option<Which>,
    /// The file, if it is not to be in the folder of the run.
    pub out: Option<&'a Path>,
    /// Whether its contacts are written, too.
    pub contacts: bool,
}

impl DataExport<'_> {
    /// Writes the file, and the table of the contacts beside it. Returns their paths.
    ///
    /// # Errors
    /// A missing frame, a damaged file, a file that cannot be written; frames without histories.
    pub fn write(&self, reader: &Reader) -> Result<Vec<PathBuf>> {
        let Self {
            run, frame, out, ..
        } = *self;
        let state = if checkpoint::is_checkpoint(run) {
            if let Some(Which::Number(_)) = frame {
                return Err(Failure::input(format!(
                    "--frame: {} is a checkpoint, which holds one state; leave it out",
                    run.display()
                )));
            }
            ExportedState::of_checkpoint(run)?
        } else {
            let run = RunFile::open_any(run)?;
            ExportedState::of_run(&run, frame.unwrap_or(Which::Last).of(&run)?)?
        };
        let contacts = self.contacts.then(|| self.table(&state)).transpose()?;
        let path = Results::path(out, folder_of(run), &format!("{}.data", state.name))?;
        text_writer::write(&path, data_file(&state, reader))?;
        let mut written = vec![path];
        if let Some(table) = contacts {
            let path = beside(&written[0], "contacts").with_extension("csv");
            dictionary::write_described(KIND, &path, &table, state.dimension.axes())?;
            written.push(path);
        }
        Ok(written)
    }

    /// The contacts as a table.
    fn table(&self, state: &ExportedState) -> Result<String> {
        let which = if checkpoint::is_checkpoint(self.run) {
            None
        } else {
            self.frame.map(StateSelection::Frame)
        };
        let stored = StoredState::read(self.run, which)?;
        Ok(stored.contact_table(|grain| state.id(grain)))
    }
}

/// The name of the table in the dictionary.
const KIND: &str = "frame-contacts.csv";

fn data_file(state: &ExportedState, reader: &Reader) -> String {
    let (density, volume) = match state.dimension {
        Dimensions::Two => (&reader.on_density[..], reader.volume),
        Dimensions::Three => (&[][..], Three::volume as _),
    };
    let (program, title, origin) = (reader.name, &state.title, provenance::printed());
    let title = format!("{program} data file: {title}; {origin}");
    let boxed = state.cell.sheared.is_some();
    let periodic = match (state.dimension, boxed) {
        (Dimensions::Two, false) => ", dimension 2, periodic along x",
        (Dimensions::Two, true) => ", dimension 2, periodic along x and y",
        (Dimensions::Three, false) => ", periodic along x and y",
        (Dimensions::Three, true) => ", periodic along x, y and z",
    };
    let walls = " Types: 1 free grains, 2 bottom wall, 3 top wall, 4 … further materials.";
    let (types, units) = if boxed {
        ("", "Units of the scene")
    } else {
        (walls, "SI units")
    };
    let what = format!("atom_style sphere{periodic}.{types}");
    let units = format!("{units}; the id is that of the run plus 1.");
    let mut comments = vec![&*what, &*units];
    comments.extend(density);
    lammps_data::write(&title, &comments, &state.data(volume))
}
