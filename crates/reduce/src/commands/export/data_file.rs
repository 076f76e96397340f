//! Data files of LAMMPS and LIGGGHTS: one state, from which a simulation can begin.

use std::path::{Path, PathBuf};

use gshear_analysis::moments::extent;
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::failure::Failure;
use gshear_dem::state::{Cell, GrainSample};
use gshear_driver::header::Saved;
use gshear_scene::lammps_data::{self, Atom, DataFile};
use gshear_scene::{Boundary, Dimensions};
use gshear_store::file_names::folder_of;
use gshear_store::run_reader::RunFile;
use gshear_store::{checkpoint, provenance, text_writer};

use crate::frame_selection::Which;
use crate::results::Results;

/// The program that reads a data file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reader {
    /// LAMMPS.
    Lammps,
    /// LIGGGHTS, which takes the density as that of a disk in 2D.
    Liggghts,
}

impl Reader {
    fn text(self, state: &ExportedState) -> String {
        match (self, state.dimension) {
            (_, Dimensions::Three) => data_file(state, self.name(), &[], Three::volume),
            (Reader::Lammps, _) => data_file(state, self.name(), &SPHERES, Three::volume),
            (Reader::Liggghts, _) => data_file(state, self.name(), &DISKS, Two::volume),
        }
    }

    fn name(self) -> &'static str {
        match self {
            Reader::Lammps => "LAMMPS",
            Reader::Liggghts => "LIGGGHTS",
        }
    }
}

/// State to export, in SI units; grains by id.
struct ExportedState {
    /// Origin of the state, on one line.
    title: String,
    /// File name without extension.
    name: String,
    cell: Cell,
    dimension: Dimensions,
    grains: Vec<Grain>,
}

struct Grain {
    id: u32,
    /// Type of the atom.
    atom_type: u32,
    radius: f64,
    /// kg; kg/m in 2D.
    mass: f64,
    position: [f64; 3],
    velocity: [f64; 3],
    angular_velocity: [f64; 3],
}

/// The type of the atom of a grain of this body and material, as a scene reads it again: 1 free, 2
/// and 3 the walls, from 4 on free grains of the other materials.
pub fn atom_type(body: u32, material: u64) -> u32 {
    match (body, material) {
        (0, 1..) => material as u32 + 3,
        (body, _) => body + 1,
    }
}

/// Writes a state of `run`, which is a run or a checkpoint, to `out` or into the folder of the run.
/// Returns the path.
///
/// # Errors
/// A missing frame, a damaged file, a file that cannot be written.
pub fn write(
    run: &Path,
    reader: Reader,
    frame: Option<Which>,
    out: Option<&Path>,
) -> Result<PathBuf, Failure> {
    let state = if checkpoint::is_checkpoint(run) {
        if let Some(Which::Number(_)) = frame {
            return Err(Failure::input(format!(
                "--frame: {} is a checkpoint, which holds one state; leave it out",
                run.display()
            )));
        }
        of_checkpoint(run)?
    } else {
        of_run(&RunFile::open(run)?, frame.unwrap_or(Which::Last))?
    };
    let beside = || Results::of(None, folder_of(run)).place(&format!("{}.data", state.name));
    let path = out.map_or_else(beside, Path::to_path_buf);
    text_writer::write(&path, reader.text(&state))?;
    Ok(path)
}

fn of_run(run: &RunFile, which: Which) -> Result<ExportedState, Failure> {
    let t = which.of(run)?;
    let grains = run.grains();
    let frame = run.records(t..t + 1)?.swap_remove(0);
    let grain = |(g, of): (usize, &GrainSample)| Grain {
        id: run.ids()[g],
        atom_type: atom_type(grains.body[g].into(), run.material()[g].into()),
        radius: grains.radius[g],
        mass: grains.mass[g],
        position: of.position,
        velocity: of.velocity,
        angular_velocity: of.angular_velocity,
    };
    Ok(ExportedState {
        title: format!(
            "frame {t} (step {}, strain {:.8}) of {}",
            frame.step,
            run.frame_strains()?[t],
            run.path().display(),
        ),
        name: format!("frame-{t}"),
        cell: run.cell(t),
        dimension: run.dimension(),
        grains: frame.grains.iter().enumerate().map(grain).collect(),
    })
}

fn of_checkpoint(path: &Path) -> Result<ExportedState, Failure> {
    let saved = Saved::read(&Solo, path)?;
    let (header, scene) = (&saved.header, saved.scene(&[])?);
    let Boundary::Walls(_) = scene.boundary else {
        return Err(Failure::input(format!(
            "{}: is of a periodic box; only samples between walls are exported",
            path.display()
        )));
    };
    let ids = scene.packing().map(|file| &file.ids);
    let grain = |g: &gshear_dem::state::GrainState| Grain {
        id: ids.map_or(g.id, |ids| ids.of(g.id)),
        atom_type: atom_type(g.body, g.material),
        radius: g.radius,
        mass: (scene.materials.masses).of(g.material, scene.dimension.volume(g.radius)),
        position: g.position,
        velocity: g.velocity,
        angular_velocity: g.angular_velocity,
    };
    Ok(ExportedState {
        title: format!(
            "step {} of the {} in {}",
            header.step(),
            header.stage(),
            path.display()
        ),
        name: path
            .file_stem()
            .map_or("checkpoint".into(), |stem| stem.to_string_lossy().into()),
        cell: scene.sample.cell(),
        dimension: scene.dimension,
        grains: saved.state.grains.iter().map(grain).collect(),
    })
}

/// Comments in the file on the column `density`.
const SPHERES: [&str; 2] = [
    "density is that of a sphere with the mass of the disk per metre of depth: density pi d^3/6 = rho pi d^2/4. Forces and",
    "stiffnesses are per metre of depth; fix nve/sphere with disc gives the disk's moment of inertia, too.",
];
const DISKS: [&str; 2] = [
    "density is that of the disk: with dimension 2 LIGGGHTS computes the mass per metre of depth, pi d^2/4 density. Forces and",
    "stiffnesses are per metre of depth; fix nve/sphere takes the disk's moment of inertia in 2 dimensions.",
];

/// Returns a data file of `program`, which computes a grain's mass as density times `volume` of its
/// radius (m).
fn data_file(
    state: &ExportedState,
    program: &str,
    density: &[&str],
    volume: impl Fn(f64) -> f64,
) -> String {
    let up = state.dimension.axes() - 1;
    let ends = state.grains.iter().map(|g| (g.position[up], g.radius));
    let edges = extent(ends.flat_map(|(at, r)| [at - r, at + r]));
    let largest = state.grains.iter().fold(0.0, |r: f64, g| r.max(g.radius));
    let atom = |grain: &Grain| {
        let diameter = 2.0 * grain.radius;
        Atom {
            id: u64::from(grain.id) + 1,
            kind: grain.atom_type,
            diameter,
            density: grain.mass / volume(grain.radius),
            position: grain.position,
            velocity: grain.velocity,
            angular_velocity: grain.angular_velocity,
            line: 0,
        }
    };
    let file = DataFile {
        bounds: match (state.dimension, state.cell.periods) {
            (Dimensions::Two, [length, _]) => [[0.0, length], edges, [-largest, largest]],
            (Dimensions::Three, [length, width]) => [[0.0, length], [0.0, width], edges],
        },
        tilt: [0.0; 3],
        types: state.grains.iter().fold(3, |n, g| n.max(g.atom_type)),
        atoms: state.grains.iter().map(atom).collect(),
    };
    let title = format!(
        "{program} data file: {}; {}",
        state.title,
        provenance::printed()
    );
    let what = match state.dimension {
        Dimensions::Two => {
            "atom_style sphere, dimension 2, periodic along x. Types: 1 free grains, 2 bottom wall, 3 top wall."
        }
        Dimensions::Three => {
            "atom_style sphere, periodic along x and y. Types: 1 free grains, 2 bottom wall, 3 top wall."
        }
    };
    let mut comments = vec![what, "SI units; the id is that of the run plus 1."];
    comments.extend(density);
    lammps_data::write(&title, &comments, &file)
}
