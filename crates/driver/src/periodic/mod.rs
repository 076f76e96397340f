//! Runs in a periodic sheared box (BO section III): a packing prepared without friction, strain steps each brought to mechanical
//! equilibrium, Newton's equations from the last of them.

mod equilibrium;
mod newtonian;
mod observe;
mod prepare;
mod record;
mod spectrum;
pub(crate) mod strain;

use std::cell::RefCell;
use std::path::Path;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use gshear_analysis::spectrum::Solver;
use gshear_scene::{Dimensions, PeriodicScene, Source, Study};
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::{Contact, LawSpace};
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_mpi_exchange::Parallel;
use gshear_dem::drive::NoWalls;
use gshear_dem::failure::Failure;
use gshear_store::checkpoint;
use crate::run::{Ending, Options, level_of};
use crate::signals::Signals;
use gshear_dem::simd::Level;
use gshear_dem::state::{Cell, ContactState, GrainState, Snapshot, Travel};
use gshear_dem::system::{Setup, System};
use crate::terminal::Terminal;


/// One run: who takes part, what is run, how.
pub struct PeriodicRun<'a> {
    exchange: &'a dyn Parallel,
    scene: &'a PeriodicScene,
    options: &'a Options,
    level: Level,
    signals: Signals,
    terminal: Terminal,
    started: Instant,
    /// Of Newton's steps, which K's pattern outlives.
    solver: RefCell<Solver>,
}

/// What a checkpoint says beside grains and contacts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Header {
    pub progress: Progress,
    /// Frames and rows of the strain steps' file.
    pub frames: u64,
    pub rows: u64,
    /// Where it was written during Newton's equations.
    pub newtonian: Option<Moving>,
}

/// How far Newton's equations have come.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Moving {
    pub steps: u64,
    /// Frames and rows of their file, and lines of that of the eigenvalues.
    pub frames: u64,
    pub rows: u64,
    pub lines: u64,
}

/// What a run goes on with, beside the state.
struct Resumed {
    header: Header,
    travels: Option<Vec<Travel>>,
}

/// How far the strain steps have come.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Progress {
    /// Strain steps that are done.
    pub steps: u64,
    /// Displacement of the image above along x.
    pub offset: f64,
    /// Of the first complex pair, if it has been born.
    pub birth: Option<Birth>,
    /// Complex pairs after the last of them, and that of the greatest |Im λ|.
    pub pairs: u64,
    pub pair: Option<Pair>,
    /// Strain steps for which Newton's method was not enough.
    pub fell_back: u64,
}

/// Where the first complex pair is born: the last γ without and the first with it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Birth {
    pub before: f64,
    pub after: f64,
}

/// A complex pair λ_r ± iλ_i, and ω_r ± iω_i = √λ (BO eq. 8).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pair {
    pub lambda_r: f64,
    pub lambda_i: f64,
    pub omega_r: f64,
    pub omega_i: f64,
}

impl Pair {
    pub fn new(lambda_r: f64, lambda_i: f64) -> Self {
        let lambda_i = lambda_i.abs();
        let root = faer::c64::new(lambda_r, lambda_i).sqrt();
        Self {
            lambda_r,
            lambda_i,
            omega_r: root.re,
            omega_i: root.im,
        }
    }
}

impl Header {
    /// That of a checkpoint; `None` where it is of a run with walls.
    pub fn read(snapshot: &Snapshot) -> Option<Self> {
        serde_json::from_str(&snapshot.header).ok()
    }
}

/// The scene of a checkpoint (`name` in messages, `toml` its text).
pub fn scene_of_checkpoint(
    name: &Path,
    toml: String,
    set: &[String],
) -> Result<PeriodicScene, Failure> {
    let source = Source::new(format!("{} (its scene)", name.display()), toml);
    let no_packing = &mut |_: &Path, _| Err(Failure::input("a box has no packing"));
    match gshear_scene::study(&source, set, no_packing)? {
        Study::Periodic(scene) => Ok(scene),
        Study::PlaneShear(_) => Err(Failure::input(format!(
            "{}: the scene has no [box]",
            source.name()
        ))),
    }
}

/// The state at rest, this rank's part of it, to go back to.
#[derive(Debug, Clone)]
struct Held {
    cell: Cell,
    grains: Vec<GrainState>,
    contacts: Vec<ContactState>,
}

impl Held {
    fn of<D: Dimension>(system: &mut System<D>, law: &dyn PairForce<D>) -> Self {
        Self {
            cell: system.cell,
            grains: system.grain_states(),
            contacts: system.contact_states(law),
        }
    }

    fn put_back<D: Dimension>(
        self,
        exchange: &dyn Parallel,
        system: &mut System<D>,
        law: &dyn PairForce<D>,
    ) -> Result<(), Failure> {
        system.cell = self.cell;
        system.replace(exchange, law, &mut NoWalls, self.grains, self.contacts)
    }
}

impl<'a> PeriodicRun<'a> {
    pub fn new(
        exchange: &'a dyn Parallel,
        scene: &'a PeriodicScene,
        options: &'a Options,
    ) -> Result<Self, Failure> {
        Ok(Self {
            exchange,
            scene,
            options,
            level: level_of(&scene.bookkeeping)?,
            signals: Signals::catch()?,
            terminal: Terminal::new(exchange.rank() == 0),
            started: Instant::now(),
            solver: RefCell::default(),
        })
    }

    /// From insertion, or from a checkpoint, to the end.
    pub fn run(self, from: Option<Snapshot>) -> Result<Ending, Failure> {
        self.terminal
            .periodic_header(self.exchange, self.scene, self.level);
        // Once per run, so that no step asks again.
        match self.scene.dimension {
            Dimensions::Two => self.stages::<Two>(from),
            Dimensions::Three => self.stages::<Three>(from),
        }
    }

    fn stages<D: LawSpace>(self, from: Option<Snapshot>) -> Result<Ending, Failure> {
        let scene = self.scene;
        let force = |contact: Contact| {
            D::pair_force(&scene.law, &contact)
                .expect("a law of this dimension, as the scene was checked")
        };
        let smooth = Contact {
            friction: 0.0,
            rolling_friction: 0.0,
            ..scene.contact
        };
        let (state, resumed) = match from {
            Some(snapshot) => self.restore(snapshot)?,
            None => (self.prepare(force(smooth).as_ref())?, None),
        };
        self.shear(force(scene.contact).as_ref(), state, resumed)
    }

    fn restore(&self, snapshot: Snapshot) -> Result<(Held, Option<Resumed>), Failure> {
        let header = Header::read(&snapshot)
            .ok_or_else(|| Failure::input("the checkpoint is not one of a periodic box"))?;
        let contacts = checkpoint::to_both_holders(self.exchange, &snapshot);
        let state = Held {
            cell: self.scene.sheared_cell(header.progress.offset),
            grains: snapshot.grains,
            contacts,
        };
        let travels = snapshot.travels;
        Ok((state, Some(Resumed { header, travels })))
    }

    fn system<D: Dimension>(&self, cell: Cell) -> Result<System<D>, Failure> {
        let (scene, sample) = (self.scene, &self.scene.sample);
        let radius = 0.5 * sample.mean_diameter;
        let overlap = 0.01 * sample.mean_diameter;
        let setup = Setup {
            level: self.level,
            list: scene.bookkeeping.list,
            cell,
            largest_radius: sample.radius_max,
            mean_diameter: sample.mean_diameter,
            masses: scene.law.masses(),
            step: scene.time_step.step,
            gravity: 0.0,
            typical_force: scene.law.normal_stiffness(radius, radius, overlap) * overlap,
            threads: self.options.threads,
        };
        System::new(self.exchange, setup)
    }

    /// Whether this rank was asked to stop.
    fn asked_here(&self) -> bool {
        let out_of_time = self.options.wall_time;
        self.signals.received() || out_of_time.is_some_and(|t| self.started.elapsed() >= t)
    }

    /// Whether some rank was asked to stop; collective.
    fn asked_to_stop(&self) -> bool {
        self.exchange
            .maximum(f64::from(u8::from(self.asked_here())))
            > 0.0
    }
}
