//! A run: its ranks, and the loop over the steps of a stage.

use std::time::{Duration, Instant};

use gshear_dem::failure::{Failure, Result};
use gshear_dem::simd::Isa;
use gshear_dem::state::Snapshot;
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
use crate::terminal::Terminal;
use gshear_store::status::Standing;

/// Steps of Newton's equations after which a stage looks whether the last checkpoint is old.
pub(crate) const LOOK: u64 = 100;

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

    /// Flushes the files and returns the state.
    ///
    /// # Errors
    /// A file that cannot be written.
    fn checkpoint(&mut self, run: &mut Run<'_>) -> Result<Checkpoint>;

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
        if let Some(folder) = &self.folder {
            folder.clear(self.exchange)?;
        }
        self.terminal.begin(&stage.standing());
        if begins {
            stage.begin(self).map_err(|e| in_stage(e, name))?;
            stage.record(self)?;
        }
        while !stage.is_done() {
            let last = self.options.stop_at;
            let last = last.is_some() && stage.count() == last;
            let stop = stage.step(self, last).map_err(|e| in_stage(e, name))?;
            stage.record(self).map_err(|e| in_stage(e, name))?;
            let stopped = stop && !stage.is_done();
            let due = match stage.save_due() {
                Save::No => stopped,
                Save::Now => true,
                Save::IfOld => stopped || self.last_checkpoint_is_old(),
            };
            if due {
                self.record.tuned = stage.tuned();
                let saved = stage.checkpoint(self).and_then(|of| self.save(&of));
                saved.map_err(|e| in_stage(e, name))?;
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
