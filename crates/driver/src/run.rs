//! A run: its ranks, its checkpoints, and when it is to stop.

use std::cell::OnceCell;
use std::time::{Duration, Instant};

use gshear_dem::failure::{Failure, Result};
use gshear_dem::simd::Isa;
use gshear_dem::state::{GrainState, Snapshot};
use gshear_mpi_exchange::Parallel;
use gshear_scene::Scene;
use gshear_store::checkpoint;
use gshear_store::collective::on_root;

use crate::cores;
use crate::folder::RunFolder;
use crate::header::{Header, Position, PrepareHeader};
use crate::options::Options;
use crate::run_record::RunRecord;
use crate::signals::Signals;
use crate::stages::PREPARE;
use crate::terminal::Terminal;

/// The most grains whose state is kept in memory. Larger samples have their checkpoints alone.
const MOST_KEPT: u32 = 1_000_000;

/// A run.
pub(crate) struct Run<'a> {
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
    /// Number of processors that this rank may run on; 0 if the system does not say.
    pub(crate) processors: usize,
    signals: Signals,
    started: Instant,
    saved: Instant,
    /// The last state kept in memory; `None` if a checkpoint was written since.
    pub(crate) sound: Option<Checkpoint>,
    /// The newest checkpoint of this run in its folder.
    pub(crate) saved_at: Option<Position>,
    /// Time between checkpoints (s), if there is one.
    checkpoint_time: Option<f64>,
    later: &'a OnceCell<Scene>,
}

impl<'a> Run<'a> {
    /// `later`: the place of the scene of a later stage, whose cell is another one.
    ///
    /// # Errors
    /// This processor lacks the instruction set, or signals cannot be caught.
    pub fn new(
        exchange: &'a dyn Parallel,
        scene: &'a Scene,
        later: &'a OnceCell<Scene>,
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
        if options.profile {
            exchange.count_waits();
        }
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
            processors: cores::of_this_rank(),
            signals: Signals::catch()?,
            started: now,
            saved: now,
            sound: None,
            saved_at: None,
            checkpoint_time: (scene.checkpoint_time > 0.0).then_some(scene.checkpoint_time),
            later,
        })
    }

    /// Goes on with the scene of a shear in a cell of these lengths (m; the second is 1 in 2D).
    pub(crate) fn enter_cell(&mut self, lengths: [f64; 3]) {
        self.scene = self.later.get_or_init(|| self.scene.in_cell(lengths));
    }

    /// Removes the files of an earlier run, if that is still to be done; collective.
    pub(crate) fn clear(&self) -> Result<()> {
        let folder = self.folder.as_ref();
        folder.map_or(Ok(()), |folder| folder.clear(self.exchange))
    }

    /// Whether states are kept in memory: not of a large sample, nor of a replay.
    pub(crate) fn keeps_states(&self) -> bool {
        self.folder.is_some() && self.scene.sample.grains <= MOST_KEPT
    }

    /// Keeps the last sound state of a preparation that fails.
    pub(crate) fn keep_prepared(&mut self, header: PrepareHeader, grains: Vec<GrainState>) {
        if self.folder.is_none() {
            self.sound = None;
            return;
        }
        self.sound = Some(Checkpoint {
            header: Header::Prepare(header),
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
            && self.saved_at != Some(sound.header.position())
            && let Err(lost) = self.clear().and_then(|()| self.save(&sound))
        {
            return Failure::Numbers(format!("{what}; and its last sound state is lost: {lost}"));
        }
        let Some(position) = self.saved_at else {
            return Failure::Numbers(what);
        };
        let path = self.options.out.join(checkpoint::NAME);
        let path = path.display();
        let how = if position.stage == PREPARE {
            "take it as sample.packing".to_string()
        } else {
            format!("go on from it with --resume {path}, and --branch NEW_FOLDER for other physics")
        };
        Failure::Numbers(format!(
            "{what}; the last sound state, {position}, is in {path}: look at it with gshear-reduce export --format lammps-data {path}, or {how}"
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
    pub(crate) fn last_checkpoint_is_old(&self) -> bool {
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
        let position = header.position();
        self.saved_at = Some(position);
        self.sound = None;
        self.terminal.saved(position, self.saved.elapsed());
        on_root(exchange, || {
            if checkpoint.keep {
                checkpoint::keep(out, position.stage, position.step)
            } else {
                Ok(())
            }
        })
    }
}

/// The data of a stage for a checkpoint. Each contact is on the rank that has its first grain.
pub(crate) struct Checkpoint {
    /// The header of the checkpoint.
    pub header: Header,
    /// This rank's part of the state.
    pub state: Snapshot,
    /// Whether to keep the checkpoint under the name of its step as well.
    pub keep: bool,
}
