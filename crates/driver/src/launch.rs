//! The start of a run: from a scene and its grains, or from a checkpoint.

use std::cell::OnceCell;
use std::path::Path;
use std::time::Instant;

use gshear_dem::dimension::{Three, Two};
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::HeldState;
use gshear_mpi_exchange::Parallel;
use gshear_scene::identity::{KeyChange, changes};
use gshear_scene::{Change, Dimensions, Scene, Source};
use gshear_store::checkpoint;
use gshear_store::collective::{agree, exists, of_root, on_root, told_by_root};

use crate::continuation::count_anew;
use crate::exported_state::read_packing;
use crate::folder::{RunFolder, same_folder};
use crate::header::{Header, Saved};
use crate::lock::Lock;
use crate::options::{Options, Outcome};
use crate::run::Run;
use crate::run_record::{Continuation, RunRecord};
use crate::say::say_error;
use crate::stages::sequence;
use crate::stored_run::{Ends, StoredRun};
pub use crate::task::Task;
use crate::task::{Entry, Start};
use crate::{cores, ends, memory};

impl Task {
    /// A window of a run from one of its checkpoints, for [`Options::replay`]. `set`: overrides.
    ///
    /// # Errors
    /// An invalid override.
    pub fn replay(saved: Saved, set: &[String]) -> Result<Self> {
        Ok(Self {
            scene: saved.scene(set)?,
            record: saved.record.clone(),
            start: Start::Checkpoint(Box::new(saved), None),
            entry: Entry::Resume,
        })
    }

    /// Runs to the end; collective.
    ///
    /// # Errors
    /// Bad input, numbers that fail, or files that cannot be written.
    pub fn run(self, exchange: &dyn Parallel, options: &Options) -> Result<Outcome> {
        let scene = &self.scene;
        let record = self.record.clone();
        let later = OnceCell::new();
        let mut run = Run::new(exchange, scene, &later, record, options)?;
        if options.replay.is_none() {
            ends::check(&self, options.stop_at)?;
            run.folder = Some(RunFolder::take(exchange, &self, options)?);
            if exchange.rank() == 0 {
                let folder = options.out.clone();
                run.terminal.follow(folder, &run.record, scene, exchange);
            }
        }
        if let Some(saved) = self.saved()
            && self.entry == Entry::Resume
            && (saved.path.parent()).is_some_and(|folder| same_folder(folder, &options.out))
        {
            run.saved_at = Some(saved.header.position());
        }
        run.terminal.header(exchange, scene, run.isa);
        let fewest = -exchange.maximum(-(run.processors as f64)) as usize;
        if let Some(warning) = cores::too_few(options.threads, fewest) {
            run.terminal.warn(warning);
        }
        if let Some(note) = self.counts_anew() {
            run.terminal.warn(note);
        }
        let of_packing = [self.not_at_load(), self.doubtful_contacts()];
        for warning in of_packing.into_iter().flatten() {
            run.terminal.warn(warning);
        }
        let outcome = match scene.dimension {
            Dimensions::Two => sequence::run::<Two>(&mut run, self.start),
            Dimensions::Three => sequence::run::<Three>(&mut run, self.start),
        };
        let outcome = outcome.map_err(|failure| run.leave_sound_state(failure));
        run.terminal.run_ended(&outcome);
        outcome
    }
}

/// Loads a scene and, if it has a packing, its grains, which rank 0 reads. Collective.
///
/// # Errors
/// An invalid configuration or packing.
///
/// # Panics
/// If the packing holds a number that is not finite, which `read_packing` refuses.
pub fn from_the_start(exchange: &dyn Parallel, source: &Source, set: &[String]) -> Result<Task> {
    let mut packing = None;
    let limit = memory::limit(exchange);
    let scene = gshear_scene::load_within(source, set, &limit, &mut |paths, arrangement| {
        packing = on_root(exchange, || {
            let packing = read_packing(paths.grains, arrangement, &limit)?;
            packing.with_contacts(paths.contacts).map(Some)
        })?;
        let file = packing.as_ref().map(|packing| packing.file.clone());
        Ok(of_root(exchange, &file).expect("rank 0 has read it"))
    })?;
    let start = match scene.packing() {
        Some(_) => {
            let state = packing.map_or(Ok(HeldState::default()), |p| p.state(&scene));
            Start::Packing(agree(exchange, state)?)
        }
        None => Start::Insertion,
    };
    Ok(Task {
        record: RunRecord::new(&scene),
        entry: Entry::New,
        scene,
        start,
    })
}

/// How a resume may change the scene of its checkpoint.
#[derive(Debug, Clone, Copy)]
pub enum Changes<'a> {
    /// By these overrides, but not in what decides the trajectory.
    Set(&'a [String]),
    /// By these overrides, which begin a new run.
    Branch(&'a [String]),
    /// To this scene, which is that of the same run.
    Scene(&'a Scene),
}

/// Resumes from a checkpoint, or from the newest good one of a folder; `None` if the run in the
/// folder is finished. Collective.
///
/// # Errors
/// A checkpoint that is missing, damaged or of another version, or a change that a resumed run may
/// not have.
pub fn resume(exchange: &dyn Parallel, path: &Path, changes: Changes<'_>) -> Result<Option<Task>> {
    if !of_root(exchange, &path.is_dir()) {
        return from_checkpoint(Saved::read(exchange, path)?, changes).map(Some);
    }
    let Some(saved) = newest(exchange, path)? else {
        return Err(Failure::input(format!(
            "{}: holds no checkpoint; give the folder of a run, or one of its checkpoints, or begin the run again with its scene and --resume auto",
            path.display()
        )));
    };
    let task = from_checkpoint(saved, changes)?;
    let branches = matches!(changes, Changes::Branch(_));
    let finished = !branches && is_finished(exchange, path, &task)?;
    Ok((!finished).then_some(task))
}

/// Waits until it is known whether a process of another host holds the lock of the folder, as after
/// the failure of a node, and takes the time off the wall time. Collective.
pub fn await_lock(exchange: &dyn Parallel, options: &mut Options) {
    if options.break_lock {
        return;
    }
    let begun = Instant::now();
    if exchange.rank() == 0 {
        Lock::await_verdict(&options.out, |note| say_error(&format!("note: {note}")));
    }
    // The other ranks wait for rank 0.
    exchange.broadcast(vec![0]);
    options.wall_time = options.wall_time_after(begun.elapsed());
}

/// Continues the run of a task in its folder, if the folder holds it, from its newest good
/// checkpoint, or begins it; `None` if the run is finished. Collective.
///
/// # Errors
/// A folder that holds another run, or only damaged checkpoints.
pub fn resume_if_begun(exchange: &dyn Parallel, folder: &Path, task: Task) -> Result<Option<Task>> {
    let [is_empty, is_finished] = told_by_root(exchange, || {
        let stored = StoredRun::read(folder)?;
        stored.require(&task, Ends::Movable)?;
        Ok([stored.is_empty(), stored.is_finished(&task)])
    })?;
    if is_empty {
        return Ok(Some(task));
    }
    if is_finished {
        return Ok(None);
    }
    let mut saved = newest(exchange, folder)?;
    // No run goes on from a preparation.
    saved = saved.filter(|saved| !matches!(saved.header, Header::Prepare(_)));
    let task = match saved {
        None => {
            let note = "holds this run without a checkpoint; it starts again";
            note_once(exchange, &format!("{}: {note}", folder.display()));
            Task {
                entry: Entry::Again,
                ..task
            }
        }
        Some(saved) => from_checkpoint(saved, Changes::Scene(&task.scene))?,
    };
    Ok(Some(task))
}

/// Whether the run in the folder has come to the end that the task asks for. Collective.
fn is_finished(exchange: &dyn Parallel, folder: &Path, task: &Task) -> Result<bool> {
    told_by_root(exchange, || Ok(StoredRun::read(folder)?.is_finished(task)))
}

/// The newest good checkpoint of a folder; `None` if there is none. Collective.
fn newest(exchange: &dyn Parallel, folder: &Path) -> Result<Option<Saved>> {
    let mut damaged = None;
    for name in [checkpoint::NAME, checkpoint::PREVIOUS] {
        let path = folder.join(name);
        if !exists(exchange, &path)? {
            continue;
        }
        match Saved::read(exchange, &path) {
            Ok(saved) => {
                if let Some(failure) = damaged {
                    let note = format!("{failure}; resuming from {}", path.display());
                    note_once(exchange, &note);
                }
                return Ok(Some(saved));
            }
            // It may be sound, and the one before it would take its place.
            Err(failure @ Failure::Other(_)) => return Err(failure),
            Err(failure) => {
                damaged.get_or_insert(failure);
            }
        }
    }
    damaged.map_or(Ok(None), Err)
}

fn note_once(exchange: &dyn Parallel, note: &str) {
    if exchange.rank() == 0 {
        say_error(&format!("note: {note}"));
    }
}

/// The task of a checkpoint: its scene with the changes, and its state.
fn from_checkpoint(mut saved: Saved, wanted: Changes<'_>) -> Result<Task> {
    if let Header::Prepare(_) = saved.header {
        let path = saved.path.display();
        return Err(Failure::input(format!(
            "{path}: is of a preparation that has failed, from which no run goes on; begin the scene again with other keys, or take the grains as sample.packing = \"{path}\""
        )));
    }
    let before = saved.scene(&[])?;
    let scene = match wanted {
        Changes::Set(set) | Changes::Branch(set) => saved.scene(set)?,
        Changes::Scene(scene) => scene.clone(),
    };
    let mut changed = changes(&before.toml, &scene.toml);
    if let Changes::Scene(_) = wanted {
        // The same bytes, as their identities say.
        changed.retain(|change| !change.is_of_a_packing());
    }
    let branches = matches!(wanted, Changes::Branch(_));
    if let Some(change) = changed.iter().find(|change| match change.change {
        Change::Never => true,
        Change::Branch => !branches,
        Change::End | Change::Resume => false,
    }) {
        return Err(refused(&saved.path, change));
    }
    let at = Continuation {
        stage: saved.header.stage().into(),
        step: saved.header.step(),
        changes: changed.iter().map(ToString::to_string).collect(),
    };
    let mut record = saved.record.clone();
    let (entry, record) = if branches {
        count_anew(&mut saved.header, &before, &scene);
        (Entry::New, record.branch(&scene, at))
    } else {
        record.resumed.push(at);
        (Entry::Resume, record)
    };
    Ok(Task {
        scene,
        start: Start::Checkpoint(Box::new(saved), Some(Box::new(before))),
        record,
        entry,
    })
}

/// The failure of a change that a resumed run may not have.
fn refused(path: &Path, change: &KeyChange) -> Failure {
    let path = path.display();
    Failure::input(match change.change {
        Change::Never => format!(
            "{path}: cannot change {change}: the checkpoint holds the grains and their contacts; leave the key as it was, or start a new run"
        ),
        _ => format!(
            "{path}: cannot change {change} in this run, because the key decides its trajectory; leave it as it was, or begin a new run at this checkpoint with --branch NEW_FOLDER"
        ),
    })
}
