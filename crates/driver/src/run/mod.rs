//! The stages of a run, from the sample to the last step.

mod analysis;
mod pack;
mod shear;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use gshear_scene::{Bookkeeping, Dimensions, Law, Origin, PackingFile, Scene, Source};
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::{Contact, LawSpace};
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::domain::{Accumulator, FixedPoint};
use gshear_mpi_exchange::Parallel;
use gshear_dem::drive::{Piston, SliderState};
use gshear_dem::failure::Failure;
use gshear_dem::budget::SavedBudget;
use crate::record::{self, Written};
use gshear_scene::sample::Lattice;
use gshear_scene::schedule::{Window, inertial_time, mean_mass};
use crate::signals::Signals;
use gshear_dem::simd::Level;
use gshear_dem::state::{ContactState, FramePart, GrainState, Snapshot, body};
use gshear_dem::system::{Setup, System};
use crate::terminal::Terminal;

/// Drag of the compression, and of the rest after it, in inverse inertial times.
const DRAG_FALLING: f64 = 0.01;
const DRAG_RESTING: f64 = 1.0;
/// κ from which on the loose sample bears the whole load at once, of disks and of spheres. At first a few grains carry all of it,
/// some fifteen times their share, and more in space; a softer sample is begun with that part of the load which overlaps it no more.
const BEARS_ALL: [f64; 2] = [1e3, 1e4];

/// What the command line says beside the scene.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Folder of the results.
    pub out: PathBuf,
    /// Stop with a checkpoint after this step of the shear, if it comes.
    pub stop_at: Option<u64>,
    /// Stop with a checkpoint after this time.
    pub wall_time: Option<Duration>,
    /// Threads inside each rank.
    pub threads: usize,
    /// Only the stretch from the checkpoint to the end of this window, into new files and without a word.
    pub replay: Option<Window>,
}

/// What a run begins with; of grains this rank's part, whichever they are.
#[derive(Debug, Clone)]
pub enum Start {
    /// Grains inserted by the scene.
    Insertion,
    /// Those of the scene's packing, made by `Packing::grains`.
    Packing(Vec<GrainState>),
    Checkpoint(Snapshot),
}

/// How a run ended that did not fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    Done,
    /// At a checkpoint, before the last step.
    Stopped,
}

/// What a checkpoint says beside grains and contacts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Header {
    pub stage: Stage,
    /// Steps of the stage that are done.
    pub step: u64,
    pub piston: Piston,
    /// Of the shear.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slider: Option<SliderState>,
    /// Frames and rows of the time series written so far.
    pub frames: u64,
    pub rows: u64,
    /// Rows of the scalars of frames.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub scalars: u64,
    /// With `output.energy`.
    #[serde(default, alias = "ledger")]
    pub energy_budget: Option<SavedBudget>,
    /// Of the file that the grains came from, which then is not needed any more.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub packing: Option<PackingFile>,
}

impl Header {
    /// That of a checkpoint.
    pub fn read(snapshot: &Snapshot) -> Result<Self, Failure> {
        serde_json::from_str(&snapshot.header)
            .map_err(|e| Failure::input(format!("the checkpoint's header: {e}")))
    }

    /// The scene of a checkpoint (`name` in messages, `toml` its text), without the file that the grains may have come from.
    pub fn scene(&self, name: &Path, toml: String, set: &[String]) -> Result<Scene, Failure> {
        let source = Source::new(format!("{} (its scene)", name.display()), toml);
        gshear_scene::load_with(&source, set, &mut |path, copies| {
            let same = |file: &&PackingFile| file.path == path && file.replicate == copies;
            let known = self.packing.as_ref().filter(same);
            known.cloned().ok_or_else(|| {
                Failure::input("the grains are those of the checkpoint; leave it as it was")
            })
        })
    }
}

/// A stage, with what it was begun with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// Drag while packing (1/s).
    Pack { drag: f64 },
    /// H (m).
    Shear { height: f64 },
}

/// One run: who takes part, what is run, how.
pub struct Run<'a> {
    pub exchange: &'a dyn Parallel,
    pub scene: &'a Scene,
    pub options: &'a Options,
    level: Level,
    signals: Signals,
    terminal: Terminal,
    started: Instant,
}

/// What a checkpoint says beside the system.
struct Moment<'a> {
    stage: Stage,
    step: u64,
    piston: &'a Piston,
    slider: Option<&'a SliderState>,
    written: Written,
    /// The last frame of which scalars were computed.
    analysed: Option<&'a FramePart>,
}

/// The state at the start of a stage, wherever its grains are.
struct State {
    step: u64,
    piston: Piston,
    /// `None` before the first step of the shear.
    slider: Option<SliderState>,
    grains: Vec<GrainState>,
    contacts: Vec<ContactState>,
    /// Frames and rows written before, if this goes on with an earlier run.
    written: Option<Written>,
    energy_budget: Option<SavedBudget>,
    analysed: Option<FramePart>,
}

impl<'a> Run<'a> {
    pub fn new(exchange: &'a dyn Parallel, scene: &'a Scene, options: &'a Options) -> Result<Self, Failure> {
        Ok(Self {
            exchange,
            scene,
            options,
            level: level_of(&scene.bookkeeping)?,
            signals: Signals::catch()?,
            terminal: Terminal::new(exchange.rank() == 0 && options.replay.is_none()),
            started: Instant::now(),
        })
    }

    /// From `start` to the last step.
    pub fn run(self, start: Start) -> Result<Ending, Failure> {
        let (stage, state) = match start {
            Start::Insertion => self.insert(),
            Start::Packing(grains) => self.take(grains),
            Start::Checkpoint(snapshot) => self.restore(snapshot)?,
        };
        self.terminal.header(self.exchange, self.scene, self.level);
        match self.scene.dimension {
            Dimensions::Two => self.stages::<Two>(stage, state),
            Dimensions::Three => self.stages::<Three>(stage, state),
        }
    }

    fn stages<D: LawSpace>(mut self, stage: Stage, state: State) -> Result<Ending, Failure> {
        let scene = self.scene;
        let force = |law: &Law, contact: Contact| {
            D::pair_force(law, &contact).expect("a law of this dimension, as the scene was checked")
        };
        let (height, state) = match stage {
            Stage::Shear { height } => (height, state),
            Stage::Pack { drag } => {
                let (sample, load) = (&scene.sample, &scene.load);
                let law = scene.law.while_packing(sample.mean_diameter, load.pressure);
                let smooth = Contact {
                    friction: 0.0,
                    rolling_friction: 0.0,
                    ..scene.contact
                };
                // Without friction there is no rolling resistance either: it packs densest.
                let contact = match scene.pack.friction > 0.0 {
                    true => Contact {
                        friction: scene.pack.friction,
                        ..scene.contact
                    },
                    false => smooth,
                };
                let (pairs, plane) = (force(&law, contact), force(&law, smooth));
                match self.pack(pairs.as_ref(), plane, drag, state)? {
                    Some(packed) => packed,
                    None => return Ok(Ending::Stopped),
                }
            }
        };
        self.shear(force(&scene.law, scene.contact).as_ref(), height, state)
    }

    fn insert(&self) -> (Stage, State) {
        let Origin::Insertion(sizes) = &self.scene.origin else {
            unreachable!("a packing that was not read")
        };
        let lattice = Lattice::new(&self.scene.sample, sizes);
        let (rank, size) = (self.exchange.rank(), self.exchange.size());
        let grains = lattice.insert(self.scene.seed, rank, size);
        let top = grains.iter().map(|g| g.position[self.up()] + g.radius);
        let height = self.exchange.maximum(top.fold(0.0, f64::max));
        (self.packing_stage(), self.at_rest_on_top(height, grains))
    }

    /// The grains of a packing: to be compressed, or to be sheared as they are.
    fn take(&self, grains: Vec<GrainState>) -> (Stage, State) {
        let Origin::Packing { file, .. } = &self.scene.origin else {
            unreachable!("grains of a packing that the scene does not have")
        };
        let mut state = self.at_rest_on_top(file.height(), grains);
        if !self.scene.pack.skip {
            return (self.packing_stage(), state);
        }
        state.piston.mass = self.mass_of_top(&state.grains);
        state.piston.load = self.scene.load.normal_force;
        let height = self.height_between_walls(&state.piston);
        (Stage::Shear { height }, state)
    }

    /// The axis of the walls' normals.
    fn up(&self) -> usize {
        self.scene.dimension.axes() - 1
    }

    fn packing_stage(&self) -> Stage {
        let drag = DRAG_FALLING / inertial_time(self.scene) * self.first_load().sqrt();
        Stage::Pack { drag }
    }

    /// Part of N with which the packing begins.
    fn first_load(&self) -> f64 {
        (self.scene.load.stiffness_number / BEARS_ALL[self.up() - 1]).min(1.0)
    }

    /// These grains before the first step, under a piston at rest at `height` (m).
    fn at_rest_on_top(&self, height: f64, grains: Vec<GrainState>) -> State {
        let (sample, load) = (&self.scene.sample, &self.scene.load);
        State {
            step: 0,
            piston: Piston {
                height,
                velocity: 0.0,
                acceleration: 0.0,
                // About that of the wall to come.
                mass: mean_mass(self.scene) * sample.base() / sample.mean_section(),
                load: load.normal_force * self.first_load(),
            },
            grains,
            contacts: Vec::new(),
            slider: None,
            written: None,
            energy_budget: None,
            analysed: None,
        }
    }

    /// Mass of the top wall (kg; kg/m in 2D), of which each rank has a part; collective.
    fn mass_of_top(&self, grains: &[GrainState]) -> f64 {
        let masses = FixedPoint::new(mean_mass(self.scene));
        let mut mass = Accumulator::default();
        let of_grain = self.scene.law.masses();
        for g in grains.iter().filter(|g| g.body == body::TOP) {
            let volume = self.scene.dimension.volume(g.radius);
            masses.add(&mut mass, of_grain.of(volume));
        }
        let [mass] = masses.total(self.exchange, [mass]);
        mass
    }

    /// H (m), between the planes at which the walls end.
    fn height_between_walls(&self, piston: &Piston) -> f64 {
        piston.height - 2.0 * self.scene.sample.mean_diameter
    }

    fn restore(&self, snapshot: Snapshot) -> Result<(Stage, State), Failure> {
        let header = Header::read(&snapshot)?;
        let contacts = gshear_store::checkpoint::to_both_holders(self.exchange, &snapshot);
        Ok((
            header.stage,
            State {
                step: header.step,
                piston: header.piston,
                slider: header.slider,
                grains: snapshot.grains,
                contacts,
                written: Some(Written {
                    frames: header.frames,
                    rows: header.rows,
                    scalars: header.scalars,
                }),
                energy_budget: header.energy_budget,
                analysed: snapshot.analysed,
            },
        ))
    }

    fn system<D: Dimension>(&self) -> Result<System<D>, Failure> {
        let (scene, sample) = (self.scene, &self.scene.sample);
        let setup = Setup {
            level: self.level,
            list: scene.bookkeeping.list,
            cell: sample.cell(),
            largest_radius: sample.radius_max,
            mean_diameter: sample.mean_diameter,
            masses: scene.law.masses(),
            step: scene.time_step.step,
            gravity: scene.load.gravity,
            typical_force: scene.load.normal_force,
            threads: self.options.threads,
        };
        System::new(self.exchange, setup)
    }

    /// Writes a checkpoint.
    fn save<D: Dimension>(
        &self,
        system: &mut System<D>,
        law: &dyn PairForce<D>,
        of: Moment<'_>,
    ) -> Result<(), Failure> {
        let header = Header {
            stage: of.stage,
            step: of.step,
            piston: *of.piston,
            slider: of.slider.copied(),
            frames: of.written.frames,
            rows: of.written.rows,
            scalars: of.written.scalars,
            energy_budget: system.budget.as_ref().map(|b| b.save(self.exchange)),
            packing: match &self.scene.origin {
                Origin::Insertion(_) => None,
                Origin::Packing { file, .. } => Some(file.clone()),
            },
        };
        let sheared = matches!(of.stage, Stage::Shear { .. });
        let keep = (sheared && self.scene.output.keep_checkpoints).then_some(of.step);
        record::checkpoint(
            self.exchange,
            &self.options.out,
            &self.scene.toml,
            &Snapshot {
                header: serde_json::to_string(&header).expect("a header of finite numbers"),
                grains: system.grain_states(),
                contacts: system.own_contact_states(law),
                analysed: of.analysed.cloned(),
                travels: None,
            },
            keep,
        )
    }

    /// Whether this rank was asked to stop.
    fn asked_to_stop(&self) -> bool {
        let out_of_time = self.options.wall_time;
        self.signals.received()
            || (self.exchange.rank() == 0
                && out_of_time.is_some_and(|t| self.started.elapsed() >= t))
    }
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// The instruction set that is asked for. Errors: this processor does not have it.
pub fn level_of(bookkeeping: &Bookkeeping) -> Result<Level, Failure> {
    let name = bookkeeping.simd;
    Level::named(name).ok_or_else(|| Failure::input(format!("this processor has no {name}")))
}

fn in_stage(failure: Failure, stage: &str) -> Failure {
    match failure {
        Failure::Numbers(m) => Failure::Numbers(format!("{stage}, {m}")),
        other => other,
    }
}
