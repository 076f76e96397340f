//! A state of a run, a frame or a checkpoint, and its stiffness matrix.

use std::path::Path;

use crate::frame_selection::Which;
use faer::sparse::SparseColMat;
use gshear_analysis::jacobian::{History, Jacobian, NetworkState, assemble, damping};
use gshear_analysis::moments::extent;
use gshear_analysis::stability::{DampedStability, Stability};
use gshear_dem::dimension::{Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::{Cell, ContactState, FlatWalls, GrainState, Ids};
use gshear_driver::header::{Header, Saved};
use gshear_scene::packing::contacts::{self, TabledState};
use gshear_scene::{
    Arrangement, ContactFile, Dimensions, PackingFile, PackingPaths, Scene, Source, identity,
};
use gshear_store::checkpoint;
use gshear_store::run_reader::{RunFile, RunStage};
use gshear_store::spectrum_writer::StateOrigin;

/// The histories in K: as the law has them, or as printed by Bonfanti et al.
pub fn history(paper_form: bool) -> History {
    if paper_form {
        History::Unturned
    } else {
        History::Turned
    }
}

/// The frame to take.
#[derive(Debug, Clone, Copy)]
pub(crate) enum StateSelection {
    /// The last frame, or one by number.
    Frame(Which),
    /// The frame nearest to this shear strain.
    Strain(f64),
}

/// A state with its law and cell, from which K is assembled.
pub(crate) struct StoredState {
    scene: Scene,
    cell: Cell,
    flat: Option<(FlatWalls, [f64; 2])>,
    /// Grains by id.
    pub grains: Vec<GrainState>,
    contacts: Vec<ContactState>,
    /// The state and its file, in words.
    pub what: String,
    /// The state.
    pub origin: StateOrigin,
}

impl StoredState {
    /// Reads a state from a run.h5, the folder that holds one, or a checkpoint.
    ///
    /// # Errors
    /// A damaged file, a file that is neither a run nor a checkpoint, a missing frame, a checkpoint
    /// of the packing stage.
    pub fn read(path: &Path, selection: Option<StateSelection>) -> Result<Self> {
        if checkpoint::is_checkpoint(path) {
            return of_checkpoint(path, selection);
        }
        let selection = selection.unwrap_or(StateSelection::Frame(Which::Last));
        Self::of_run(&RunFile::open_any(path)?, selection)
    }

    /// Reads a frame.
    ///
    /// # Errors
    /// A damaged file, a missing frame.
    pub fn of_run(run: &RunFile, selection: StateSelection) -> Result<Self> {
        let t = match selection {
            StateSelection::Frame(which) => which.of(run)?,
            StateSelection::Strain(strain) => {
                let strains = run.frame_strains()?;
                let distances = strains.iter().map(|known| (known - strain).abs());
                let nearest = distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
                let nearest = nearest.map(|(t, _)| t);
                nearest.ok_or_else(|| {
                    Failure::input(format!("--strain: {} has no frames", run.path().display()))
                })?
            }
        };
        let name = format!("{} (its scene)", run.path().display());
        if !run.form().histories {
            return Err(Failure::input(format!(
                "{}: K and tables of contacts need their histories, which output.histories = false left out of its frames; give a checkpoint, or a replay (gshear-reduce replay)",
                run.path().display()
            )));
        }
        let source = Source::new(&name, run.scene().to_string());
        let packing = &mut |paths: PackingPaths<'_>, how| Ok(packing_of(run, paths, how));
        let scene = gshear_scene::load_with(&source, &[], packing)?;
        let (grains, contacts) = run.state(t)?;
        let step = run.frame_steps()[t];
        let what = format!("frame {t} (step {step}) of {}", run.path().display());
        let origin = StateOrigin {
            run_id: run.text("run_id").map(str::to_string),
            stage: run.stage(),
            step,
        };
        let mut laws = scene.materials.laws.iter();
        let attracts = laws.any(|(_, contact)| contact.adhesion.is_some());
        if attracts && !run.form().idle && run.stage() != RunStage::Strain {
            return Err(Failure::input(format!(
                "{what}: K of grains that attract each other, and a table of their contacts, depend on which of these a damper holds back, which the version that wrote this file did not store; give a checkpoint, or run the scene again"
            )));
        }
        if scene.flat_walls().is_some() {
            return Err(Failure::input(format!(
                "{what}: has flat walls, whose places no frame holds; give a checkpoint"
            )));
        }
        Ok(Self {
            scene,
            cell: run.cell(t),
            flat: None,
            grains,
            contacts,
            what,
            origin,
        })
    }

    /// What K and C are assembled from.
    fn network(&self) -> NetworkState<'_> {
        NetworkState {
            grains: &self.grains,
            contacts: &self.contacts,
            cell: self.cell,
            flat: self.flat,
            masses: &self.scene.materials.masses,
            // Strain steps end at rest.
            at_rest: self.origin.stage == RunStage::Strain,
        }
    }

    /// Assembles K and M.
    pub fn jacobian(&self, history: History) -> Jacobian {
        let (state, scene) = (self.network(), &self.scene);
        match scene.dimension {
            Dimensions::Two => assemble::<Two>(state, scene.force::<Two>().as_ref(), history),
            Dimensions::Three => assemble::<Three>(state, scene.force::<Three>().as_ref(), history),
        }
    }

    /// Assembles C.
    fn damping(&self) -> SparseColMat<usize, f64> {
        let (state, scene) = (self.network(), &self.scene);
        match scene.dimension {
            Dimensions::Two => damping::<Two>(state, scene.force::<Two>().as_ref()),
            Dimensions::Three => damping::<Three>(state, scene.force::<Three>().as_ref()),
        }
    }

    /// The contacts as a table; `id`: of a grain in the file of the grains.
    pub fn contact_table(&self, id: impl Fn(u32) -> u64) -> String {
        let state = TabledState {
            scene: &self.scene,
            cell: self.cell,
            planes: self.flat.map(|(_, planes)| planes),
            grains: &self.grains,
            contacts: &self.contacts,
        };
        contacts::write(&state, id)
    }

    /// Finds all eigenvalues of the state's K and counts those that make it unstable; with dampers
    /// also the motions that grow with them.
    ///
    /// # Errors
    /// If K is not finite.
    pub fn stability(
        &self,
        jacobian: &Jacobian,
        with_dampers: bool,
    ) -> Result<(Stability, Option<DampedStability>)> {
        let problem = jacobian
            .problem()
            .map_err(|why| Failure::numbers(format!("{}: K: {why}", self.what)))?;
        let damped = with_dampers.then(|| DampedStability::of(&problem, &self.damping()));
        Ok((Stability::of(&problem), damped))
    }
}

/// What the scene of a run is to know of the file of its grains, by the run: the file may have
/// changed or gone.
fn packing_of(run: &RunFile, paths: PackingPaths<'_>, arrangement: Arrangement) -> PackingFile {
    let values = identity::values(run.scene());
    let [thickness, length, width] = ["sample.wall_thickness", "sample.length", "sample.width"]
        .map(|key| {
            let text = values.get(key);
            text.and_then(|text| text.parse::<f64>().ok())
        });
    let radii = &run.grains().radius;
    let (count, dimension) = (radii.len() as f64, run.dimension());
    let mean_diameter = 2.0 * run.grains().mean_radius();
    let volumes = radii.iter().map(|r| dimension.volume(*r));
    let [radius_min, radius_max] = extent(radii.iter().copied());
    let height = run.height();
    // H is that between the walls.
    let walls = 2.0 * thickness.unwrap_or(1.0) * mean_diameter;
    PackingFile {
        path: run.path().to_path_buf(),
        replicate: arrangement.copies.to_vec(),
        grains: radii.len() as u32,
        radius_min,
        radius_max,
        mean_diameter,
        mean_volume: volumes.sum::<f64>() / count,
        length: length.unwrap_or(run.periods()[0]),
        width: (dimension == Dimensions::Three).then(|| width.unwrap_or(run.periods()[1])),
        boxed: arrangement.boundary.is_periodic().then_some([height, 0.0]),
        stream: 0.0,
        edges: [0.0, height + walls],
        farthest: 0.0,
        wall_types: false,
        bottom_type: false,
        content: String::new(),
        contacts: paths.contacts.map(|path| {
            Box::new(ContactFile {
                path: path.into(),
                content: String::new(),
            })
        }),
        ids: Ids::default(),
    }
}

fn of_checkpoint(path: &Path, selection: Option<StateSelection>) -> Result<StoredState> {
    let shown = path.display();
    if selection.is_some() {
        return Err(Failure::input(format!(
            "--frame, --strain: {shown} is a checkpoint, which holds one state; leave it out"
        )));
    }
    let saved = Saved::read(&Solo, path)?;
    let scene = saved.scene(&[])?;
    let Saved { header, state, .. } = saved;
    if let Header::Prepare { .. } = header {
        let what = "a checkpoint of a preparation, which has no contacts; use one of a run";
        return Err(unfit(path, what));
    }
    let Some(stage) = header.run_stage() else {
        let what = "a checkpoint of the packing stage, in which the contacts with the planes are not stored; use a checkpoint of the shear";
        return Err(unfit(path, what));
    };
    let step = header.step();
    if !scene.stages.has(stage) {
        let what = "the checkpoint is of a stage that its scene does not have";
        return Err(unfit(path, what));
    }
    let (cell, what) = match &header {
        Header::Strain(strain) if strain.unfinished.is_some() => {
            let what = format!(
                "the run was stopped within strain step {}, so the checkpoint's state is not at rest; continue the run, or give run.h5 and a frame of it",
                step + 1
            );
            return Err(unfit(path, &what));
        }
        Header::Shear(shear) => (
            shear.cell(&scene.sample),
            format!("step {step} of the shear in {shown}"),
        ),
        _ => {
            let what = format!("{} step {step} in {shown}", header.stage());
            (header.cell_in(&scene), what)
        }
    };
    let flat = match &header {
        Header::Shear(shear) => scene.flat_walls().zip(shear.planes(&scene)),
        _ => None,
    };
    Ok(StoredState {
        scene,
        cell,
        flat,
        grains: state.grains,
        contacts: state.contacts,
        what,
        origin: StateOrigin {
            run_id: None,
            stage,
            step,
        },
    })
}

/// The failure that refuses a checkpoint.
fn unfit(checkpoint: &Path, what: &str) -> Failure {
    Failure::input(format!("{}: {what}", checkpoint.display()))
}
