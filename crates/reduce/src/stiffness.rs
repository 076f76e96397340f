//! Assembles K and M of a frame or a checkpoint.

use std::path::Path;

use super::export::Which;
use crate::output::cannot_write;
use gshear_analysis::jacobian::{History, Jacobian, NetworkState, assemble, paper_form};
use gshear_analysis::stability::Stability;
use gshear_dem::dimension::{Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::failure::Failure;
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::LawSpace;
use gshear_dem::state::{Cell, ContactState, GrainState};
use gshear_driver::header::{Header, Saved};
use gshear_scene::{Boundary, Contact, Dimensions, Law, Scene, Source};
use gshear_store::checkpoint;
use gshear_store::run_reader::{RunFile, RunStage};
use gshear_store::spectrum_writer::StateOrigin;
use std::io::Write;

/// The frame to take.
#[derive(Debug, Clone, Copy)]
pub enum StateSelection {
    /// The last frame, or one by number.
    Frame(Which),
    /// The frame nearest to this shear strain.
    Strain(f64),
}

/// K, and the paper's J if requested.
pub struct StiffnessMatrix {
    /// K and M.
    pub jacobian: Jacobian,
    /// J in the form of the paper's appendix.
    pub paper: Option<faer::sparse::SparseColMat<usize, f64>>,
    /// The state.
    pub origin: StateOrigin,
}

/// A state with its law and cell, from which K is assembled.
pub struct StoredState {
    law: Law,
    contact: Contact,
    dimension: Dimensions,
    cell: Cell,
    /// Grains by id.
    pub grains: Vec<GrainState>,
    contacts: Vec<ContactState>,
    at_rest: bool,
    what: String,
    origin: StateOrigin,
}

impl StoredState {
    /// Reads a state from a run.h5, the folder that holds one, or a checkpoint.
    ///
    /// # Errors
    /// A damaged file, a file that is neither a run nor a checkpoint, a missing frame, a checkpoint
    /// of the packing stage.
    pub fn read(path: &Path, selection: Option<StateSelection>) -> Result<Self, Failure> {
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
    pub fn of_run(run: &RunFile, selection: StateSelection) -> Result<Self, Failure> {
        let t = match selection {
            StateSelection::Frame(which) => which.of(run)?,
            StateSelection::Strain(strain) => {
                let strains = run.frame_strains()?;
                let apart = |&t: &usize| (strains[t] - strain).abs();
                let nearest = (0..strains.len()).min_by(|a, b| apart(a).total_cmp(&apart(b)));
                nearest.ok_or_else(|| {
                    Failure::input(format!("--strain: {} has no frames", run.path().display()))
                })?
            }
        };
        let name = format!("{} (its scene)", run.path().display());
        let scene = gshear_scene::load(&Source::new(&name, run.scene().to_string()), &[])?;
        let state = run.state(t)?;
        let what = format!(
            "frame {t} (step {}) of {}",
            run.frame_steps()[t],
            run.path().display()
        );
        let origin = StateOrigin {
            run_id: run.text("run_id").map(str::to_string),
            stage: run.stage(),
            step: run.frame_steps()[t],
        };
        Ok(Self::new(scene, run.cell(t), state, (what, origin)))
    }

    /// Assembles K and M.
    pub fn jacobian(&self, history: History) -> Jacobian {
        let state = NetworkState {
            grains: &self.grains,
            contacts: &self.contacts,
            cell: self.cell,
            masses: self.law.masses(),
            at_rest: self.at_rest,
        };
        match self.dimension {
            Dimensions::Two => assemble::<Two>(state, self.force::<Two>().as_ref(), history),
            Dimensions::Three => assemble::<Three>(state, self.force::<Three>().as_ref(), history),
        }
    }

    /// Finds all eigenvalues and counts those that make the state unstable. With [`History::Unturned`]
    /// they are those of J in the paper's form.
    ///
    /// # Errors
    /// If K is not finite.
    pub fn stability(&self, history: History) -> Result<Stability, Failure> {
        let problem = self.jacobian(history).problem();
        let problem =
            problem.map_err(|why| Failure::numbers(format!("{}: K: {why}", self.what)))?;
        Ok(Stability::of(&problem))
    }

    /// Returns the contact law, as the run itself chooses it.
    fn force<D: LawSpace>(&self) -> Box<dyn PairForce<D>> {
        D::pair_force(&self.law, &self.contact)
            .expect("a law of this dimension, as the scene was checked")
    }
}

/// Assembles K of a run.h5, the folder that holds one, or a checkpoint, and prints its origin. With
/// `paper` the contact histories do not turn with the contacts.
///
/// # Errors
/// As [`StoredState::read`].
pub fn of(
    path: &Path,
    selection: Option<StateSelection>,
    paper: bool,
    output: &mut impl Write,
) -> Result<StiffnessMatrix, Failure> {
    let found = StoredState::read(path, selection)?;
    let history = if paper {
        History::Unturned
    } else {
        History::Turned
    };
    let jacobian = found.jacobian(history);
    writeln!(
        output,
        "{}: {} free grains of {}, {} contacts, {} of them sliding",
        found.what,
        jacobian.grains.len(),
        found.grains.len(),
        jacobian.contacts,
        jacobian.sliding
    )
    .map_err(cannot_write)?;
    let radius = |g: u32| found.grains[g as usize].radius;
    let paper = paper.then(|| paper_form(&jacobian, radius));
    Ok(StiffnessMatrix {
        jacobian,
        paper,
        origin: found.origin,
    })
}

impl StoredState {
    fn new(
        scene: Scene,
        cell: Cell,
        (grains, contacts): (Vec<GrainState>, Vec<ContactState>),
        (what, origin): (String, StateOrigin),
    ) -> Self {
        Self {
            law: scene.law,
            contact: scene.contact,
            dimension: scene.dimension,
            cell,
            grains,
            contacts,
            at_rest: origin.stage == RunStage::Strain,
            what,
            origin,
        }
    }
}

fn of_checkpoint(path: &Path, selection: Option<StateSelection>) -> Result<StoredState, Failure> {
    if selection.is_some() {
        return Err(Failure::input(format!(
            "--frame, --strain: {} is a checkpoint, which holds one state; leave it out",
            path.display()
        )));
    }
    let saved = Saved::read(&Solo, path)?;
    let scene = saved.scene(&[])?;
    let Saved { header, state, .. } = saved;
    let state = (state.grains, state.contacts);
    let Some(stage) = header.run_stage() else {
        return Err(Failure::input(format!(
            "{}: a checkpoint of the packing stage, in which the contacts with the planes are not stored; use a checkpoint of the shear",
            path.display()
        )));
    };
    let origin = StateOrigin {
        run_id: None,
        stage,
        step: header.step(),
    };
    match (&header, &scene.boundary) {
        (
            Header::Aqs {
                unfinished: Some(_),
                ..
            },
            _,
        ) => Err(Failure::input(format!(
            "{}: the run was stopped within strain step {}, so the checkpoint's state is not at rest; continue the run, or give aqs.h5 and a frame of it",
            path.display(),
            header.step() + 1
        ))),
        (
            Header::Aqs { progress, .. } | Header::Newtonian { progress, .. },
            Boundary::Periodic(_),
        ) => {
            let what = format!(
                "{} step {} in {}",
                header.stage(),
                header.step(),
                path.display()
            );
            let cell = match scene.dimension {
                Dimensions::Two => progress.cell::<Two>(&scene.sample),
                Dimensions::Three => progress.cell::<Three>(&scene.sample),
            };
            Ok(StoredState::new(scene, cell, state, (what, origin)))
        }
        (_, Boundary::Walls(_)) => {
            let what = format!("step {} of the shear in {}", header.step(), path.display());
            let cell = scene.sample.cell();
            Ok(StoredState::new(scene, cell, state, (what, origin)))
        }
        (_, Boundary::Periodic(_)) => Err(Failure::input(format!(
            "{}: the checkpoint is of a stage between walls, but its scene has a [box]",
            path.display()
        ))),
    }
}
