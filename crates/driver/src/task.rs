//! What a run is to do: its scene, and where it starts.

use gshear_dem::state::{Cell, HeldState, Snapshot};
use gshear_scene::packing::contacts;
use gshear_scene::{RunStage, Scene, unlikely};
use gshear_store::file_names::part_of;

use crate::header::Saved;
use crate::run_record::RunRecord;

/// A scene, and the state from which its run starts.
pub struct Task {
    /// The scene.
    pub scene: Scene,
    /// The initial state.
    pub start: Start,
    /// The identity and history of the run.
    pub record: RunRecord,
    /// How it enters its folder.
    pub(crate) entry: Entry,
}

/// The start of a run. Grains are this rank's part of all grains, in any distribution.
#[derive(Debug, Clone)]
pub enum Start {
    /// Grains that the scene inserts.
    Insertion,
    /// The grains of the scene's packing, and the contacts of its table.
    Packing(HeldState),
    /// A checkpoint, and its scene, where that of the run may differ.
    Checkpoint(Box<Saved>, Option<Box<Scene>>),
    /// What the stage before left.
    StageBefore(Box<LeftState>),
}

/// What a stage leaves to the next one.
#[derive(Debug, Clone)]
pub struct LeftState {
    /// The stage.
    pub stage: RunStage,
    /// Its steps.
    pub steps: u64,
    /// Steps of the stages up to this one, as `--stop-at` counts them.
    pub counted: u64,
    /// The cell.
    pub cell: Cell,
    /// This rank's part of the state, each contact on the ranks that have its grains.
    pub state: Snapshot,
}

/// How a stage ends.
pub(crate) enum StageEnd {
    /// The run stops within it, or has said that it stops at its end.
    Stopped,
    /// It is the last one.
    Last,
    /// Another one follows.
    Left(Box<LeftState>),
}

/// How a run enters its folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Entry {
    /// From the first grain, or as a branch: the folder must not hold a run.
    New,
    /// From the first grain, because the folder holds the beginning of this run without a
    /// checkpoint.
    Again,
    /// From a checkpoint: the folder may hold the same run.
    Resume,
}

impl Task {
    /// The checkpoint that the run starts from, if it does.
    pub(crate) fn saved(&self) -> Option<&Saved> {
        match &self.start {
            Start::Checkpoint(saved, _) => Some(saved),
            Start::Insertion | Start::Packing(_) | Start::StageBefore(_) => None,
        }
    }

    /// A sentence if this branch counts the steps of its checkpoint anew.
    pub(crate) fn counts_anew(&self) -> Option<String> {
        let (saved, parent) = (self.saved()?, self.record.parent.as_ref()?);
        let [step, of_parent] = [saved.header.step(), parent.at.step];
        (self.entry == Entry::New && step != of_parent).then(|| {
            format!(
                "the time step is {:.4e} s now: steps are counted by it, so that step {of_parent} of the checkpoint is step {step} of the branch; times and places go on",
                self.scene.time_step.step
            )
        })
    }

    /// A sentence if the grains that the shear starts with are not at their load; of rank 0.
    pub(crate) fn not_at_load(&self) -> Option<String> {
        match &self.start {
            Start::Packing(state) if !state.grains.is_empty() => {
                unlikely::not_at_load(&self.scene, &state.grains)
            }
            _ => None,
        }
    }

    /// A sentence if the contacts of a table are not those of the grains, or beyond the limit of
    /// friction; of rank 0.
    pub(crate) fn doubtful_contacts(&self) -> Option<String> {
        match &self.start {
            Start::Packing(state) if !state.grains.is_empty() => {
                contacts::doubts(&self.scene, state)
            }
            _ => None,
        }
    }

    /// The file, or its part, of the last stage, whose attribute `digest` marks a finished run.
    pub(crate) fn last_file(&self) -> &'static str {
        let stages = &self.scene.stages;
        part_of(stages, stages.last())
    }
}
