//! A periodic box (BO section III): prepared without friction, strained step by step to mechanical
//! equilibrium, then moved by Newton's equations.

use gshear_dem::clock::Clock;
use gshear_dem::failure::Failure;
use gshear_dem::laws::{Contact, LawSpace};
use gshear_scene::{PeriodicBox, Scene};
use gshear_store::run_reader::RunStage;

use super::newtonian::{From, NewtonianStage, Resumed};
use super::prepare;
use super::rest::RestState;
use super::setup::{force, system};
use super::strain::{self, Strain};
use crate::header::{Header, Progress};
use crate::options::Outcome;
use crate::run::{Run, StageState, Start};
use gshear_dem::state::HeldState;

/// Runs the scene from `start` to its last step; collective.
///
/// # Errors
/// Numbers that fail, or a file that cannot be written.
pub fn run<D: LawSpace>(
    run: &mut Run<'_>,
    scene: &Scene,
    periodic: &PeriodicBox,
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
        let prepared = prepare::prepare(run, scene, periodic, smooth.as_ref())?;
        let Some(state) = prepared else {
            run.terminal.unprepared();
            return Ok(Outcome::Stopped);
        };
        (None, state)
    };
    let mut unfinished = None;
    let (progress, written) = match &header {
        None => {
            let progress = Progress {
                length: Some(scene.sample.length),
                ..Progress::default()
            };
            (progress, None)
        }
        Some(Header::Aqs {
            progress,
            written,
            unfinished: of,
        }) => {
            unfinished.clone_from(of);
            (*progress, Some(*written))
        }
        Some(Header::Newtonian { progress, .. }) => (*progress, None),
        Some(Header::Pack { .. } | Header::Shear { .. }) => {
            return Err(Failure::input("the checkpoint is not of a periodic box"));
        }
    };
    let StageState {
        grains,
        contacts,
        displacements,
        held,
        ..
    } = state;
    let sample = &scene.sample;
    let cell = match &unfinished {
        Some(of) => of.shape.cell::<D>(sample),
        None => progress.cell::<D>(sample),
    };
    let mut system = system::<D>(run, scene, cell)?;
    // Keeps the forces of the state, because a run without a stop does not compute them again here.
    let state = HeldState { grains, contacts };
    RestState { cell, state }.put_back(run.exchange, &mut system, law)?;

    let mut resumed = None;
    let (mut system, progress) = if let Some(Header::Newtonian { step, .. }) = header {
        resumed = Some(Resumed {
            step,
            displacements: displacements.unwrap_or_default(),
        });
        (system, progress)
    } else {
        let begins = written.is_none();
        let resumed = written.map(|written| {
            let (shapes, work) =
                unfinished.map_or_else(Default::default, |of| (of.held, Some(of.work)));
            let states = shapes.iter().zip(held);
            strain::Resumed {
                written,
                work,
                held: states
                    .map(|(shape, state)| RestState {
                        cell: shape.cell::<D>(sample),
                        state,
                    })
                    .collect(),
            }
        });
        let mut strain = Strain::new(run, scene, periodic, law, system, progress, resumed)?;
        let outcome = run.drive(&mut strain, begins);
        let (system, progress, outcome) = strain.finish(run, outcome)?;
        if outcome == Outcome::Stopped {
            return Ok(outcome);
        }
        // The last strain step has its checkpoint.
        if periodic.newtonian.is_some() && run.options.stop_at == Some(progress.steps) {
            let stage = RunStage::Strain.name();
            run.terminal
                .stopped(&run.options.out, stage, progress.steps);
            return Ok(Outcome::Stopped);
        }
        (system, progress)
    };
    let Some(newtonian) = &periodic.newtonian else {
        run.terminal.go_on(&run.options.out);
        return Ok(Outcome::Done);
    };
    let begins = resumed.as_ref().is_none_or(|r| r.step == 0);
    system.clock = Clock::default();
    let from = From {
        strain: strain::reached::<D>(periodic, &progress),
        progress,
        resumed,
    };
    let mut stage = NewtonianStage::new(run, scene, newtonian, law, system, from)?;
    let outcome = run.drive(&mut stage, begins);
    stage.finish(run, outcome)
}
