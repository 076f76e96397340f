//! The stages of a scene, one after the other.

use gshear_dem::failure::{Failure, Result};
use gshear_dem::laws::LawSpace;
use gshear_scene::RunStage;
use gshear_store::compression;
use gshear_store::file_names::RUN_FILE;

use super::{quasi_static, shearing};
use crate::header::Header;
use crate::options::Outcome;
use crate::run::Run;
use crate::task::{StageEnd, Start};

/// Runs the stages of the scene from `start` to the end of the last one; collective.
///
/// # Errors
/// Numbers that fail, a file that cannot be written, or a checkpoint of a stage that the scene does
/// not have.
pub(crate) fn run<D: LawSpace>(run: &mut Run<'_>, start: Start) -> Result<Outcome> {
    let mut stage = first(run, &start)?;
    let mut start = start;
    loop {
        let end = match stage {
            RunStage::Shear => shearing::run::<D>(run, start)?,
            RunStage::Strain | RunStage::Newtonian => quasi_static::run::<D>(run, start)?,
        };
        let left = match end {
            StageEnd::Stopped => return Ok(Outcome::Stopped),
            StageEnd::Last => {
                compress(run);
                run.terminal.go_on(&run.options.out);
                return Ok(Outcome::Done);
            }
            StageEnd::Left(left) => left,
        };
        if run.options.stop_at == Some(left.counted) {
            let out = &run.options.out;
            run.terminal.stopped(out, left.stage.name(), left.steps);
            return Ok(Outcome::Stopped);
        }
        stage = run.scene.stages.after(left.stage)[0];
        if stage == RunStage::Shear {
            run.enter_cell(left.cell.lengths::<D>());
        }
        start = Start::StageBefore(left);
    }
}

/// Compresses the file of a run that has ended, if the scene wants it. It is as good without.
fn compress(run: &Run<'_>) {
    if !run.scene.compresses() {
        return;
    }
    let path = run.options.out.join(RUN_FILE);
    if let Err(failure) = compression::compress(run.exchange, &path) {
        run.terminal
            .warn(format!("{RUN_FILE} is whole but not compressed: {failure}"));
    }
}

/// The stage with which the run begins or goes on.
fn first(run: &Run<'_>, start: &Start) -> Result<RunStage> {
    let Start::Checkpoint(saved, _) = start else {
        return Ok(run.scene.stages.first());
    };
    let stage = match &saved.header {
        Header::Pack(_) => RunStage::Shear,
        Header::Prepare(_) => RunStage::Strain,
        header => header.run_stage().expect("a stage that writes frames"),
    };
    if run.scene.stages.has(stage) {
        return Ok(stage);
    }
    Err(Failure::input(format!(
        "{}: is of the stage {}, which the scene does not have",
        saved.path.display(),
        saved.header.stage()
    )))
}
