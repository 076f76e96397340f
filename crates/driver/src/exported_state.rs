//! One state of a run or of a checkpoint as a data file, for other programs, and as the packing of
//! another run.

use std::path::Path;

use gshear_analysis::moments::extent;
use gshear_dem::domain::Solo;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::{Cell, body};
use gshear_scene::lammps_data::{Atom, DataFile};
use gshear_scene::packing::{GrainLimit, Packing, split_frame};
use gshear_scene::{Arrangement, Dimensions, atom_type};
use gshear_store::checkpoint;
use gshear_store::run_reader::{RunFile, RunStage, is_hdf5};

use crate::header::{Header, Saved};

/// State to export, in the units of its scene; grains by id.
pub struct ExportedState {
    /// Origin of the state, on one line.
    pub title: String,
    /// File name without extension.
    pub name: String,
    /// The cell.
    pub cell: Cell,
    /// Heights of flat walls (m), infinite where there is none.
    planes: Option<[f64; 2]>,
    /// Velocity along x of the image above (m/s), if it is known.
    stream: Option<f64>,
    /// Disks or spheres.
    pub dimension: Dimensions,
    grains: Vec<ExportedGrain>,
    /// The ids of the file, by the ids of the grains of the state.
    ids: Vec<u64>,
}

/// A grain of the state.
struct ExportedGrain {
    /// All of it but its density.
    atom: Atom,
    /// Its mass (kg; kg/m in 2D).
    mass: f64,
}

impl ExportedState {
    /// Frame `t` of a run.
    ///
    /// # Errors
    /// A damaged file.
    pub fn of_run(run: &RunFile, t: usize) -> Result<Self> {
        let grains = run.grains();
        let frame = run.records(t..t + 1)?.swap_remove(0);
        let mut exported = Vec::new();
        for (g, sample) in frame.grains.iter().enumerate() {
            if sample.removed != 0 {
                continue;
            }
            let atom = Atom {
                id: u64::from(run.ids()[g]) + 1,
                kind: atom_type(grains.body[g].into(), run.material()[g].into()),
                diameter: 2.0 * grains.radius[g],
                position: sample.position,
                velocity: sample.velocity,
                angular_velocity: sample.angular_velocity,
                ..Atom::default()
            };
            exported.push(ExportedGrain {
                atom,
                mass: grains.mass[g],
            });
        }
        Ok(Self {
            title: format!(
                "frame {t} (step {}, strain {:.8}) of {}",
                frame.step,
                run.frame_strains()?[t],
                run.path().display(),
            ),
            name: format!("frame-{t}"),
            cell: run.cell(t),
            planes: None,
            stream: stream_of(run, frame.step),
            dimension: run.dimension(),
            grains: exported,
            ids: run.ids().iter().map(|id| u64::from(*id) + 1).collect(),
        })
    }

    /// The state of a checkpoint.
    ///
    /// # Errors
    /// A file that is damaged or of another version.
    pub fn of_checkpoint(path: &Path) -> Result<Self> {
        let saved = Saved::read(&Solo, path)?;
        let (header, scene) = (&saved.header, saved.scene(&[])?);
        let ids = scene.packing().map(|file| &file.ids);
        let file_id = |id: u32| u64::from(ids.map_or(id, |ids| ids.of(id))) + 1;
        let mut grains = Vec::new();
        for g in &saved.state.grains {
            if g.body == body::REMOVED {
                continue;
            }
            let volume = scene.dimension.volume(g.radius);
            let atom = Atom {
                id: file_id(g.id),
                kind: atom_type(g.body, g.material),
                diameter: 2.0 * g.radius,
                position: g.position,
                velocity: g.velocity,
                angular_velocity: g.angular_velocity,
                ..Atom::default()
            };
            grains.push(ExportedGrain {
                atom,
                mass: scene.materials.masses.of(g.material, volume),
            });
        }
        Ok(Self {
            title: format!(
                "step {} of the {} in {}",
                header.step(),
                header.stage(),
                path.display()
            ),
            name: path
                .file_stem()
                .map_or("checkpoint".into(), |stem| stem.to_string_lossy().into()),
            cell: header.cell_in(&scene),
            planes: match header {
                Header::Shear(shear) => shear.planes(&scene),
                _ => None,
            },
            stream: (header.cell_in(&scene).sheared).map(|sheared| sheared.velocity),
            dimension: scene.dimension,
            grains,
            ids: (0..saved.state.grains.len() as u32).map(file_id).collect(),
        })
    }

    /// The id in the file of a grain of the state.
    pub fn id(&self, grain: u32) -> u64 {
        self.ids[grain as usize]
    }

    /// As a data file of a program that computes a grain's mass as density times `volume` of its
    /// radius (m).
    pub fn data(&self, volume: impl Fn(f64) -> f64) -> DataFile {
        let up = self.dimension.axes() - 1;
        let ends = self.grains.iter().flat_map(|ExportedGrain { atom, .. }| {
            let (at, radius) = (atom.position[up], 0.5 * atom.diameter);
            [at - radius, at + radius]
        });
        let mut edges = extent(ends);
        for (edge, plane) in edges.iter_mut().zip(self.planes.into_iter().flatten()) {
            if plane.is_finite() {
                *edge = plane;
            }
        }
        let sheared = self.cell.sheared;
        let edges = sheared.map_or(edges, |sheared| [0.0, sheared.height]);
        let mut largest = 0.0f64;
        let mut types = 3;
        let mut atoms = Vec::with_capacity(self.grains.len());
        for ExportedGrain { atom, mass } in &self.grains {
            let radius = 0.5 * atom.diameter;
            largest = largest.max(radius);
            types = types.max(atom.kind);
            atoms.push(Atom {
                density: mass / volume(radius),
                ..*atom
            });
        }
        let mut tilt = [0.0; 3];
        tilt[up - 1] = sheared.map_or(0.0, |sheared| sheared.offset);
        DataFile {
            bounds: match (self.dimension, self.cell.periods) {
                (Dimensions::Two, [length, _]) => [[0.0, length], edges, [-largest, largest]],
                (Dimensions::Three, [length, width]) => [[0.0, length], [0.0, width], edges],
            },
            tilt,
            bounded: Default::default(),
            stream: self.stream,
            types,
            atoms,
        }
    }
}

/// Velocity along x of the images above a cell without walls (m/s) in this step of its shear, if
/// the time series has a row of it; those of a box rest.
fn stream_of(run: &RunFile, step: u64) -> Option<f64> {
    if run.boundary().has_walls() {
        return None;
    }
    if run.stage() != RunStage::Shear {
        return Some(0.0);
    }
    // The first step changes the grains' velocities by that of the images.
    if step == 0 {
        return None;
    }
    let row = run.series().step.binary_search(&step).ok()?;
    Some(run.series().column("slip_rate")[row])
}

/// Reads the packing of a scene: a frame of a run, by default the last, a checkpoint, or what
/// [`Packing::read`] reads.
///
/// # Errors
/// Those of [`Packing::read`]; a run without the frame, or a damaged file.
pub(crate) fn read_packing(
    path: &Path,
    arrangement: Arrangement,
    limit: &GrainLimit,
) -> Result<Packing> {
    let (file, frame) = split_frame(path);
    if !(file.is_dir() || is_hdf5(&file)) {
        return Packing::read_at_most(path, arrangement, limit);
    }
    let shown = file.display();
    let state = if checkpoint::is_checkpoint(&file) {
        if let Some(frame) = frame {
            return Err(Failure::input(format!(
                "{shown}: is a checkpoint of one state; leave out @{frame}"
            )));
        }
        ExportedState::of_checkpoint(&file)?
    } else {
        let run = RunFile::open_any(&file)?;
        let frames = run.frames();
        let t = frame.unwrap_or(frames.saturating_sub(1));
        if t >= frames {
            return Err(Failure::input(format!(
                "{shown}: has {frames} frames, counted from 0; there is no frame {t}"
            )));
        }
        ExportedState::of_run(&run, t)?
    };
    Packing::of_state(path, state.data(|_| 1.0), arrangement, limit)
}
