//! A run: its ranks, and the loop over the steps of a stage.

use std::time::{Duration, Instant};

use gshear_dem::failure::{Failure, Result};
use gshear_dem::simd::Isa;
use gshear_dem::state::{GrainState, Snapshot};
use gshear_dem::tuning::Tuned;
use gshear_mpi_exchange::Parallel;
use gshear_scene::Scene;
use gshear_store::checkpoint;
use gshear_store::collective::on_root;

use crate::folder::RunFolder;
use crate::header::Header;
use crate::options::{Options, Outcome};
use crate::run_record::RunRecord;
use crate::signals::Signals;
use crate::stages::PREPARE;
use crate::terminal::Terminal;
use gshear_store::status::Standing;

/// Steps of Newton's equations after which a stage looks whether the last checkpoint is old.
pub(crate) const LOOK: u64 = 100;

/// Steps of Newton's equations between two states that are kept in memory: a copy takes as long as
/// some tens of steps.
const KEPT_STEPS: u64 = 50_000;

/// The most grains whose state is kept in memory. Larger samples have their checkpoints alone.
const MOST_KEPT: u32 = 1_000_000;

/// Whether a checkpoint is due after a step. A stop always writes one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Save {
    /// No checkpoint.
    No,
    /// If the last checkpoint is as old as `output.checkpoint_time`.
    IfOld,
    /// By the schedule of the stage.
    Now,
}

/// A stage of a run, which takes one step at a time. Calls are collective.
pub trait Stage {
    /// The name in messages, and the number of completed steps.
    fn at(&self) -> (&'static str, u64);

    /// The number by which `--stop-at` counts the next step; `None` if it does not count it.
    fn count(&self) -> Option<u64> {
        Some(self.at().1 + 1)
    }

    /// Whether all steps are done.
    fn is_done(&self) -> bool;

    /// Computes the forces of the initial state, before the first step. Not called when a stage
    /// resumes.
    ///
    /// # Errors
    /// Numbers that fail.
    fn begin(&mut self, run: &mut Run<'_>) -> Result<()>;

    /// Whether the last call of [`Stage::step`] took a part of a step only.
    fn goes_on(&self) -> bool {
        false
    }

    /// Takes one step. `stop`: whether a stop was requested on this rank. Returns whether the run
    /// stops after this step, the same on every rank.
    ///
    /// # Errors
    /// Numbers that fail.
    fn step(&mut self, run: &mut Run<'_>, stop: bool) -> Result<bool>;

    /// Writes the output that is due after the last step.
    ///
    /// # Errors
    /// A file that cannot be written.
    fn record(&mut self, run: &mut Run<'_>) -> Result<()>;

    /// Whether a checkpoint is due after the last step.
    fn save_due(&self) -> Save;

    /// Writes what the files hold so far to disk, before a checkpoint.
    ///
    /// # Errors
    /// A file that cannot be written, or a state that no run can go on from.
    fn flush(&mut self, run: &mut Run<'_>) -> Result<()>;

    /// The state after the last step, and what was written up to it.
    ///
    /// # Errors
    /// A file that cannot be written.
    fn state(&mut self, run: &mut Run<'_>) -> Result<Checkpoint>;

    /// Whether the state after the last step is kept in memory, to be written if numbers fail
    /// before the next checkpoint.
    fn is_kept(&self) -> bool {
        self.at().1.is_multiple_of(KEPT_STEPS)
    }

    /// Whether the state is sound although the last step has failed, because steps ran out.
    fn is_sound(&self) -> bool {
        false
    }

    /// The fastest settings so far, if they are not those of the start.
    fn tuned(&self) -> Option<Tuned>;

    /// How far the stage has come.
    fn standing(&self) -> Standing;

    /// Prints the lines of a log that are due after the last step.
    fn log(&mut self, _: &Run<'_>) {}

    /// Passes the rows of the log to the file system, for those who watch the run.
    fn publish(&mut self) {}
}

/// A run.
pub struct Run<'a> {
    /// The ranks.
    pub exchange: &'a dyn Parallel,
    /// Options of the command line.
    pub options: &'a Options,
    /// The scene.
    pub scene: &'a Scene,
    /// The identity and history of the run.
    pub record: RunRecord,
    /// The instruction set of the kernel.
    pub isa: Isa,
    /// The folder of the results; `None` for a replay.
    pub(crate) folder: Option<RunFolder>,
    pub(crate) terminal: Terminal,
    signals: Signals,
    started: Instant,
    saved: Instant,
    /// The last state kept in memory; `None` if a checkpoint was written since.
    sound: Option<Checkpoint>,
    /// Stage and step of the newest checkpoint of this run in its folder.
    pub(crate) saved_at: Option<(&'static str, u64)>,
    /// Time between checkpoints (s), if there is one.
    checkpoint_time: Option<f64>,
}

impl<'a> Run<'a> {
    /// # Errors
    /// This processor lacks the instruction set, or signals cannot be caught.
    pub fn new(
        exchange: &'a dyn Parallel,
        scene: &'a Scene,
        record: RunRecord,
        options: &'a Options,
    ) -> Result<Self> {
        let bookkeeping = &scene.bookkeeping;
        let name = bookkeeping.simd;
        let isa = Isa::named(name)
            .ok_or_else(|| Failure::input(format!("this processor has no {name}")))?;
        exchange.watch(match bookkeeping.watchdog {
            0.0 => Duration::MAX,
            seconds => Duration::from_secs_f64(seconds.clamp(1.0, 1e9)),
        });
        let now = Instant::now();
        Ok(Self {
            exchange,
            options,
            scene,
            record,
            isa,
            folder: None,
            terminal: Terminal::new(
                exchange.rank() == 0 && options.replay.is_none(),
                options.verbosity,
            ),
            signals: Signals::catch()?,
            started: now,
            saved: now,
            sound: None,
            saved_at: None,
            checkpoint_time: Some(scene.checkpoint_time).filter(|time| *time > 0.0),
        })
    }

    /// Takes the steps of a stage until it is done or the run stops. `begins`: whether this is the
    /// start of the stage. Collective.
    ///
    /// # Errors
    /// Numbers that fail, with the stage's name before the message, or a file that cannot be
    /// written.
    pub(crate) fn drive(&mut self, stage: &mut dyn Stage, begins: bool) -> Result<Outcome> {
        let (name, _) = stage.at();
        self.clear()?;
        self.terminal.begin(&stage.standing());
        self.keep(stage)?;
        if begins {
            stage.begin(self).map_err(|e| in_stage(e, name))?;
            stage.record(self)?;
        }
        while !stage.is_done() {
            let last = self.options.stop_at;
            let last = last.is_some() && stage.count() == last;
            let moved = stage.step(self, last);
            let recorded = moved.and_then(|stop| stage.record(self).map(|()| stop));
            let stop = match recorded {
                Ok(stop) => stop,
                Err(failure) => {
                    if stage.is_sound() {
                        self.keep(stage)?;
                    }
                    return Err(in_stage(failure, name));
                }
            };
            let stopped = stop && !stage.is_done();
            let due = match stage.save_due() {
                Save::No => stopped,
                Save::Now => true,
                Save::IfOld => stopped || self.last_checkpoint_is_old(),
            };
            if due {
                self.record.tuned = stage.tuned();
                let flushed = stage.flush(self).and_then(|()| stage.state(self));
                let saved = flushed.and_then(|of| self.save(&of));
                saved.map_err(|e| in_stage(e, name))?;
            } else if stage.is_kept() {
                self.keep(stage)?;
            }
            stage.log(self);
            let (_, step) = stage.at();
            let due = stage.goes_on() || self.terminal.is_due(step);
            if due && self.terminal.progress(&stage.standing()) {
                stage.publish();
            }
            if stopped {
                self.terminal.set(&stage.standing());
                self.terminal.stopped(&self.options.out, name, step);
                return Ok(Outcome::Stopped);
            }
        }
        // The next stage begins with them.
        self.record.tuned = stage.tuned();
        self.terminal.clear();
        self.terminal.set(&stage.standing());
        Ok(Outcome::Done)
    }

    /// Removes the files of an earlier run, if that is still to be done; collective.
    fn clear(&self) -> Result<()> {
        let folder = self.folder.as_ref();
        folder.map_or(Ok(()), |folder| folder.clear(self.exchange))
    }

    /// Keeps the state of a stage in memory, unless the sample is too large for that or the run is
    /// a replay; collective.
    fn keep(&mut self, stage: &mut dyn Stage) -> Result<()> {
        // Room for the new one.
        self.sound = None;
        if self.folder.is_some() && self.scene.sample.grains <= MOST_KEPT {
            self.sound = Some(stage.state(self)?);
        }
        Ok(())
    }

    /// Keeps the last sound state of a preparation that fails.
    pub(crate) fn keep_prepared(&mut self, header: Header, grains: Vec<GrainState>) {
        self.sound = self.folder.is_some().then(|| Checkpoint {
            header,
            state: Snapshot {
                grains,
                ..Snapshot::default()
            },
            keep: false,
        });
    }

    /// After numbers that failed, writes the last sound state that is kept, and says in the failure
    /// where it is. Collective.
    pub(crate) fn leave_sound_state(&mut self, failure: Failure) -> Failure {
        let Failure::Numbers(what) = failure else {
            return failure;
        };
        if let Some(sound) = self.sound.take()
            && self.saved_at != Some((sound.header.stage(), sound.header.step()))
            && let Err(lost) = self.clear().and_then(|()| self.save(&sound))
        {
            return Failure::Numbers(format!("{what}; and its last sound state is lost: {lost}"));
        }
        let Some((stage, step)) = self.saved_at else {
            return Failure::Numbers(what);
        };
        let path = self.options.out.join(checkpoint::NAME);
        let path = path.display();
        let how = if stage == PREPARE {
            "take it as sample.packing".to_string()
        } else {
            format!("go on from it with --resume {path}, and --branch NEW_FOLDER for other physics")
        };
        Failure::Numbers(format!(
            "{what}; the last sound state, {stage} step {step}, is in {path}: look at it with gshear-reduce export --format lammps-data {path}, or {how}"
        ))
    }

    /// Whether a signal or the wall time requests a stop on this rank.
    pub(crate) fn asked_to_stop(&self) -> bool {
        let wall_time = self.options.wall_time;
        self.signals.received()
            || (self.exchange.rank() == 0 && wall_time.is_some_and(|t| self.started.elapsed() >= t))
    }

    /// Whether a stop is requested on some rank; collective.
    pub(crate) fn should_stop(&self) -> bool {
        self.exchange
            .maximum(f64::from(u8::from(self.asked_to_stop())))
            > 0.0
    }

    /// Decides by the greatest age over the ranks, because their clocks differ; collective.
    fn last_checkpoint_is_old(&self) -> bool {
        let Some(time) = self.checkpoint_time else {
            return false;
        };
        self.exchange.maximum(self.saved.elapsed().as_secs_f64()) > time
    }

    /// Writes a checkpoint; collective.
    pub(crate) fn save(&mut self, checkpoint: &Checkpoint) -> Result<()> {
        let header = &checkpoint.header;
        self.saved = Instant::now();
        let (exchange, out) = (self.exchange, &self.options.out);
        if let Some(folder) = &self.folder {
            folder.verify(exchange)?;
        }
        let header_text = header.text(&self.record, self.scene.packing());
        let texts = [&*header_text, &self.scene.toml];
        checkpoint::write(exchange, out, texts, &checkpoint.state)?;
        self.saved_at = Some((header.stage(), header.step()));
        self.sound = None;
        self.terminal
            .saved(header.stage(), header.step(), self.saved.elapsed());
        on_root(exchange, || {
            if checkpoint.keep {
                checkpoint::keep(out, header.stage(), header.step())
            } else {
                Ok(())
            }
        })
    }
}

/// The data of a stage for a checkpoint. Each contact is on the rank that has its first grain.
pub struct Checkpoint {
    /// The header of the checkpoint.
    pub header: Header,
    /// This rank's part of the state.
    pub state: Snapshot,
    /// Whether to keep the checkpoint under the name of its step as well.
    pub keep: bool,
}

fn in_stage(failure: Failure, stage: &str) -> Failure {
    match failure {
        Failure::Numbers(m) => Failure::Numbers(format!("{stage}, {m}")),
        other => other,
    }
}
