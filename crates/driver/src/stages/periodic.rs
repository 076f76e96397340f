//! A periodic sheared box (BO section III): prepared without friction, strained step by step to
//! mechanical equilibrium, then moved by Newton's equations.

use gshear_dem::clock::Clock;
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::drive::NoWalls;
use gshear_dem::failure::Failure;
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::{Contact, LawSpace};
use gshear_dem::state::{Cell, ContactState, GrainState};
use gshear_dem::system::{Setup, System};
use gshear_mpi_exchange::Parallel;
use gshear_scene::{Dimensions, PeriodicScene};

use super::newtonian::{NewtonianStage, Resumed};
use super::prepare;
use super::strain::Strain;
use super::walls::force;
use crate::header::{Header, Progress};
use crate::run::{Outcome, Run, StageState, Start};

/// Runs the scene from `start` to its last step; collective.
///
/// # Errors
/// Numbers that fail, or a file that cannot be written.
pub fn run(run: &mut Run<'_>, scene: &PeriodicScene, start: Start) -> Result<Outcome, Failure> {
    run.terminal.periodic_header(run.exchange, scene, run.isa);
    match scene.dimension {
        Dimensions::Two => stages::<Two>(run, scene, start),
        Dimensions::Three => stages::<Three>(run, scene, start),
    }
}

fn stages<D: LawSpace>(
    run: &mut Run<'_>,
    scene: &PeriodicScene,
    start: Start,
) -> Result<Outcome, Failure> {
    let law = force::<D>(&scene.law, scene.contact);
    let law = law.as_ref();
    let (header, state) = if let Start::Checkpoint(snapshot) = start {
        let header = Header::read(&snapshot)?;
        (Some(header), StageState::restore(run.exchange, snapshot))
    } else {
        let smooth = Contact {
            friction: 0.0,
            rolling_friction: 0.0,
            ..scene.contact
        };
        let smooth = force::<D>(&scene.law, smooth);
        (None, prepare::prepare(run, scene, smooth.as_ref())?)
    };
    let (progress, written) = match &header {
        None => (Progress::default(), None),
        Some(Header::Aqs { progress, written }) => (*progress, Some(*written)),
        Some(Header::Newtonian { progress, .. }) => (*progress, None),
        Some(Header::Pack { .. } | Header::Shear { .. }) => {
            return Err(Failure::input("the checkpoint is not of a periodic box"));
        }
    };
    let displacements = state.displacements.clone();
    let mut system = system::<D>(run, scene, scene.sheared_cell(progress.offset))?;
    // Keeps the forces of the state, because a run without a stop does not compute them again here.
    let cell = system.cell;
    RestState { cell, state }.put_back(run.exchange, &mut system, law)?;

    let mut resumed = None;
    let (mut system, progress) = if let Some(Header::Newtonian {
        step,
        written,
        lines,
        ..
    }) = header
    {
        resumed = Some(Resumed {
            step,
            written,
            lines,
            displacements: displacements.unwrap_or_default(),
        });
        (system, progress)
    } else {
        let begins = written.is_none();
        let mut strain = Strain::new(run, scene, law, system, progress, written)?;
        let outcome = run.drive(&mut strain, begins)?;
        let (system, progress) = strain.finish(run, outcome == Outcome::Done)?;
        if outcome == Outcome::Stopped {
            return Ok(outcome);
        }
        (system, progress)
    };
    let Some(newtonian) = &scene.newtonian else {
        return Ok(Outcome::Done);
    };
    let begins = resumed.as_ref().is_none_or(|r| r.step == 0);
    system.clock = Clock::default();
    let mut stage = NewtonianStage::new(run, scene, newtonian, law, system, progress, resumed)?;
    let outcome = run.drive(&mut stage, begins)?;
    if outcome == Outcome::Done {
        stage.finish(run)?;
    }
    Ok(outcome)
}

/// The system of the scene in a cell, without its grains.
pub(super) fn system<D: Dimension>(
    run: &Run<'_>,
    scene: &PeriodicScene,
    cell: Cell,
) -> Result<System<D>, Failure> {
    let sample = &scene.sample;
    let radius = 0.5 * sample.mean_diameter;
    let overlap = 0.01 * sample.mean_diameter;
    let setup = Setup {
        isa: run.isa,
        list: scene.bookkeeping.list,
        cell,
        largest_radius: sample.radius_max,
        mean_diameter: sample.mean_diameter,
        masses: scene.law.masses(),
        step: scene.time_step.step,
        gravity: 0.0,
        typical_force: scene.law.normal_stiffness(radius, radius, overlap) * overlap,
        threads: run.options.threads,
    };
    System::new(run.exchange, setup)
}

/// This rank's part of a state at rest, to return to.
#[derive(Debug, Clone)]
pub(super) struct RestState {
    cell: Cell,
    state: StageState,
}

impl RestState {
    pub fn of<D: Dimension>(system: &mut System<D>, law: &dyn PairForce<D>) -> Self {
        let (grains, contacts): (Vec<GrainState>, Vec<ContactState>) =
            (system.grain_states(), system.contact_states(law));
        Self {
            cell: system.cell,
            state: StageState {
                grains,
                contacts,
                ..StageState::default()
            },
        }
    }

    pub fn put_back<D: Dimension>(
        self,
        exchange: &dyn Parallel,
        system: &mut System<D>,
        law: &dyn PairForce<D>,
    ) -> Result<(), Failure> {
        system.cell = self.cell;
        let StageState {
            grains, contacts, ..
        } = self.state;
        system.replace(exchange, law, &mut NoWalls, grains, contacts)
    }
}
