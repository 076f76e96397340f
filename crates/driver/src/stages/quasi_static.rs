//! Relaxation and quasi-static strain of a cell (BO section III), step by step to mechanical
//! equilibrium, and Newton's equations afterwards. A sample that no stage leaves is prepared
//! without friction.

use gshear_dem::drive::NoWalls;
use gshear_dem::failure::Result;
use gshear_dem::laws::LawSpace;
use gshear_dem::state::{HeldState, Snapshot};
use gshear_scene::{QuasiStatic, RunStage};
use gshear_store::checkpoint;

use super::assembly::{Assembly, RestState};
use super::newtonian::NewtonianStage;
use super::prepare;
use super::strain::Strain;
use crate::header::{
    Header, NewtonianHeader, Shape, StrainHeader, StrainProgress, Stretched, Written,
};
use crate::options::Outcome;
use crate::run::Run;
use crate::task::{LeftState, StageEnd, Start};

/// Runs the strain steps and Newton's equations from `start` to their last step; collective.
///
/// # Errors
/// Numbers that fail, or a file that cannot be written.
pub(super) fn run<D: LawSpace>(run: &mut Run<'_>, start: Start) -> Result<StageEnd> {
    let scene = run.scene;
    let quasi_static = scene.stages.strain.as_ref();
    let quasi_static = quasi_static.expect("a stage of the scene, as was checked");
    let law = scene.force::<D>();
    let law = law.as_ref();
    let begins = !matches!(start, Start::Checkpoint(..));
    let mut laws = scene.materials.laws.iter();
    let attracts = laws.any(|(_, contact)| contact.adhesion.is_some());
    // A packing of a file has no forces, grains that moved have others at rest, and those of a
    // packing that is prepared are without attraction.
    let is_unloaded = matches!(start, Start::Packing(_) | Start::StageBefore(_))
        || attracts && matches!(start, Start::Insertion);
    let Some((header, state)) = begin::<D>(run, quasi_static, start)? else {
        run.terminal.unprepared();
        return Ok(StageEnd::Stopped);
    };
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
            let before = header.before;
            let mut strain = Strain::new(run, quasi_static, assembly, header, held)?;
            let outcome = run.drive(&mut strain, begins);
            let strained = strain.finish(run, outcome)?;
            let progress = strained.progress;
            if strained.outcome == Outcome::Stopped {
                return Ok(StageEnd::Stopped);
            }
            let counted = before + progress.steps;
            assembly = strained.assembly;
            let (stage, steps) = (RunStage::Strain, progress.steps);
            match scene.stages.after(stage) {
                [] => return Ok(StageEnd::Last),
                [RunStage::Newtonian, ..] => {}
                _ => {
                    return Ok(StageEnd::Left(Box::new(LeftState {
                        stage,
                        steps,
                        counted,
                        cell: assembly.system.cell,
                        state: assembly.snapshot(),
                    })));
                }
            }
            // The last strain step has its checkpoint.
            if run.options.stop_at == Some(counted) {
                let out = &run.options.out;
                run.terminal.stopped(out, stage.name(), steps);
                return Ok(StageEnd::Stopped);
            }
            NewtonianHeader::after(before, &progress)
        }
        Header::Pack(_) | Header::Shear(_) | Header::Prepare(_) => {
            unreachable!("a checkpoint of these stages, as was checked")
        }
    };
    let begins = header.step == 0;
    assembly.system.restart_clock();
    let mut stage = NewtonianStage::new(run, quasi_static, assembly, header, displacements)?;
    let outcome = run.drive(&mut stage, begins);
    match stage.finish(run, outcome)? {
        Outcome::Stopped => Ok(StageEnd::Stopped),
        Outcome::Done => Ok(StageEnd::Last),
    }
}

/// The stage with which the run begins or goes on, and its state: those of the checkpoint, what the
/// stage before left, brought to a halt, a packing from a file or without friction, and `None` if
/// the run was stopped before that was prepared.
fn begin<D: LawSpace>(
    run: &mut Run<'_>,
    quasi_static: &QuasiStatic,
    start: Start,
) -> Result<Option<(Header, Snapshot)>> {
    let scene = run.scene;
    let mut progress = StrainProgress {
        length: Some(scene.sample.length),
        ..StrainProgress::default()
    };
    let mut before = 0;
    let prepared = match start {
        Start::Checkpoint(mut saved, _) => {
            checkpoint::to_both_holders(run.exchange, &mut saved.state);
            return Ok(Some((saved.header, saved.state)));
        }
        Start::StageBefore(left) => {
            let mut left = *left;
            before = left.counted;
            for grain in &mut left.state.grains {
                (grain.velocity, grain.angular_velocity) = ([0.0; 3], [0.0; 3]);
            }
            take_shape(&mut progress, Shape::of::<D>(&left.cell));
            Some(left.state)
        }
        Start::Packing(HeldState { grains, contacts }) => {
            take_shape(&mut progress, Shape::of::<D>(&scene.cell()));
            Some(Snapshot {
                grains,
                contacts,
                ..Snapshot::default()
            })
        }
        Start::Insertion => {
            let smooth = scene.force_with::<D>(|law, contact| (law.clone(), contact.smooth()));
            prepare::prepare(run, quasi_static, smooth.as_ref())?
        }
    };
    let header = Header::Strain(StrainHeader {
        before,
        progress,
        written: Written::default(),
        unfinished: None,
    });
    Ok(prepared.map(|state| (header, state)))
}

/// Notes the shape of a cell that is not the one of the sample's solid fraction.
fn take_shape(progress: &mut StrainProgress, shape: Shape) {
    progress.offset = shape.offset;
    progress.stretched = Some(Stretched::new(shape.lengths));
}
