//! A periodic box (BO section III): prepared without friction, strained step by step to mechanical
//! equilibrium, then moved by Newton's equations.

use gshear_dem::drive::NoWalls;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::laws::LawSpace;
use gshear_scene::PeriodicBox;
use gshear_store::checkpoint;
use gshear_store::run_reader::RunStage;

use super::assembly::{Assembly, RestState};
use super::newtonian::NewtonianStage;
use super::prepare;
use super::strain::Strain;
use crate::header::{
    Header, NewtonianHeader, Shape, StrainHeader, StrainProgress, Stretched, Written,
};
use crate::options::Outcome;
use crate::run::Run;
use crate::task::Start;
use gshear_dem::state::{HeldState, Snapshot};

/// Runs the scene from `start` to its last step; collective.
///
/// # Errors
/// Numbers that fail, or a file that cannot be written.
pub fn run<D: LawSpace>(
    run: &mut Run<'_>,
    periodic: &PeriodicBox,
    start: Start,
) -> Result<Outcome> {
    let scene = run.scene;
    let law = scene.force::<D>();
    let law = law.as_ref();
    let begins = !matches!(start, Start::Checkpoint(..));
    let mut laws = scene.materials.laws.iter();
    let attracts = laws.any(|(_, contact)| contact.adhesion.is_some());
    // A packing of a file has no forces, and one that is prepared those without attraction.
    let is_unloaded =
        matches!(start, Start::Grains(_)) || attracts && matches!(start, Start::Insertion);
    let Some((header, state)) = begin::<D>(run, periodic, start)? else {
        run.terminal.unprepared();
        return Ok(Outcome::Stopped);
    };
    if header.strain_progress().is_none() {
        return Err(Failure::input("the checkpoint is not of a periodic box"));
    }
    let cell = header.cell::<D>(&scene.sample);
    let mut assembly = Assembly::new(run, scene, cell, law)?;
    let Snapshot {
        grains,
        contacts,
        displacements,
        held,
        ..
    } = state;
    // Keeps the forces of the state, because a run without a stop does not compute them again here.
    let state = HeldState { grains, contacts };
    RestState { cell, state }.put_back(&mut assembly)?;
    if is_unloaded {
        assembly.initial_forces(&mut NoWalls, false)?;
    }
    let header = match header {
        Header::Newtonian(header) => header,
        Header::Strain(header) => {
            let mut strain = Strain::new(run, periodic, assembly, header, held)?;
            let outcome = run.drive(&mut strain, begins);
            let strained = strain.finish(run, outcome)?;
            let progress = strained.progress;
            if strained.outcome == Outcome::Stopped {
                return Ok(Outcome::Stopped);
            }
            // The last strain step has its checkpoint.
            if periodic.newtonian.is_some() && run.options.stop_at == Some(progress.steps) {
                let stage = RunStage::Strain.name();
                run.terminal
                    .stopped(&run.options.out, stage, progress.steps);
                return Ok(Outcome::Stopped);
            }
            assembly = strained.assembly;
            NewtonianHeader::after(progress)
        }
        Header::Pack(_) | Header::Shear(_) | Header::Prepare(_) => {
            unreachable!("a checkpoint of a box, as was checked")
        }
    };
    if periodic.newtonian.is_none() {
        run.terminal.go_on(&run.options.out);
        return Ok(Outcome::Done);
    }
    let begins = header.step == 0;
    assembly.system.restart_clock();
    let mut stage = NewtonianStage::new(run, periodic, assembly, header, displacements)?;
    let outcome = run.drive(&mut stage, begins);
    stage.finish(run, outcome)
}

/// The stage with which the run begins or goes on, and its state: those of the checkpoint, or a
/// packing from a file or without friction, and `None` if the run was stopped before that was
/// prepared.
fn begin<D: LawSpace>(
    run: &mut Run<'_>,
    periodic: &PeriodicBox,
    start: Start,
) -> Result<Option<(Header, Snapshot)>> {
    let scene = run.scene;
    let mut progress = StrainProgress {
        length: Some(scene.sample.length),
        ..StrainProgress::default()
    };
    let prepared = match start {
        Start::Checkpoint(mut saved, _) => {
            checkpoint::to_both_holders(run.exchange, &mut saved.state);
            return Ok(Some((saved.header, saved.state)));
        }
        Start::Grains(grains) => {
            let Shape { lengths, offset } = Shape::of::<D>(&scene.cell());
            progress.offset = offset;
            progress.stretched = Some(Stretched::new(lengths));
            Some(Snapshot {
                grains,
                ..Snapshot::default()
            })
        }
        Start::Insertion => {
            let smooth = scene.force_with::<D>(|law, contact| (law.clone(), contact.smooth()));
            prepare::prepare(run, periodic, smooth.as_ref())?
        }
    };
    let header = Header::Strain(StrainHeader {
        progress,
        written: Written::default(),
        unfinished: None,
    });
    Ok(prepared.map(|state| (header, state)))
}
