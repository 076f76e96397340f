//! The stages of a run, from the sample to the last step.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use crate::clock::Phase;
use crate::config::{self, Law, Origin, PackingFile, Scene, Source};
use crate::contact::ContactLaw;
use crate::contact::family::Family;
use crate::domain::{Accumulator, Exchange};
use crate::drive::{GrainWalls, Piston, Planes};
use crate::failure::Failure;
use crate::kernel::ContactForces;
use crate::ledger::{Kept, Ledger};
use crate::observe::{self, Frame};
use crate::record::{self, Recorder};
use crate::sample::{Lattice, freeze_walls};
use crate::schedule::{Schedule, inertial_time, mean_mass};
use crate::signals::Signals;
use crate::simd::Level;
use crate::state::{ContactState, GrainState, Snapshot, body};
use crate::step::{advance, initial_forces};
use crate::system::System;
use crate::terminal::Terminal;

/// While packing, the sample is looked at every so many steps …
const LOOK: u64 = 1000;
/// … and kept in a checkpoint every so many.
const PACK_CHECKPOINT: u64 = 500_000;
/// Drag of the compression, and of the rest after it, in inverse inertial times.
const DRAG_FALLING: f64 = 0.01;
const DRAG_RESTING: f64 = 1.0;

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
    /// Frames and rows of the time series written so far.
    pub frames: u64,
    pub rows: u64,
    /// The ledger of energy, where one is kept.
    #[serde(default)]
    pub ledger: Option<Kept>,
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
        config::load_with(&source, set, &mut |path| {
            let known = self.packing.as_ref().filter(|file| file.path == path);
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
pub struct Run<'a, E: Exchange> {
    pub exchange: &'a E,
    pub scene: &'a Scene,
    pub options: &'a Options,
    level: Level,
    signals: Signals,
    terminal: Terminal,
    started: Instant,
}

/// The state at the start of a stage, wherever its grains are.
struct State {
    step: u64,
    piston: Piston,
    grains: Vec<GrainState>,
    contacts: Vec<ContactState>,
    /// Frames and rows written before, if this goes on with an earlier run.
    written: Option<[u64; 2]>,
    ledger: Option<Kept>,
}

impl<'a, E: Exchange> Run<'a, E> {
    pub fn new(exchange: &'a E, scene: &'a Scene, options: &'a Options) -> Result<Self, Failure> {
        let level = Level::named(scene.bookkeeping.simd).ok_or_else(|| {
            Failure::input(format!("this processor has no {}", scene.bookkeeping.simd))
        })?;
        Ok(Self {
            exchange,
            scene,
            options,
            level,
            signals: Signals::catch()?,
            terminal: Terminal::new(exchange.rank() == 0),
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
        // Once per run, so that no step asks again.
        match self.scene.law {
            Law::LeeHurley(material) => self.stages(material, stage, state),
            Law::Hooke(springs) => self.stages(springs, stage, state),
        }
    }

    fn stages<F: Family>(
        mut self,
        family: F,
        stage: Stage,
        state: State,
    ) -> Result<Ending, Failure> {
        let contact = &self.scene.contact;
        let (height, state) = match stage {
            Stage::Shear { height } => (height, state),
            Stage::Pack { drag } => {
                let mut with = *contact;
                with.friction = self.scene.pack.friction;
                let plane = family.law::<false, false>(contact);
                let packed = match (with.friction > 0.0, with.rolling_friction > 0.0) {
                    (false, _) => {
                        self.pack(&family.law::<false, false>(&with), plane, drag, state)?
                    }
                    (true, false) => {
                        self.pack(&family.law::<true, false>(&with), plane, drag, state)?
                    }
                    (true, true) => {
                        self.pack(&family.law::<true, true>(&with), plane, drag, state)?
                    }
                };
                match packed {
                    Some(packed) => packed,
                    None => return Ok(Ending::Stopped),
                }
            }
        };
        match (contact.friction > 0.0, contact.rolling_friction > 0.0) {
            (false, false) => self.shear(&family.law::<false, false>(contact), height, state),
            (false, true) => self.shear(&family.law::<false, true>(contact), height, state),
            (true, false) => self.shear(&family.law::<true, false>(contact), height, state),
            (true, true) => self.shear(&family.law::<true, true>(contact), height, state),
        }
    }

    fn insert(&self) -> (Stage, State) {
        let sample = &self.scene.sample;
        let lattice = Lattice::new(sample);
        let (rank, size) = (self.exchange.rank(), self.exchange.size());
        let grains = lattice.insert(sample, self.scene.seed, rank, size);
        let top = grains.iter().map(|g| g.position[1] + g.radius);
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
        let height = self.height_between_walls(&state.piston);
        (Stage::Shear { height }, state)
    }

    fn packing_stage(&self) -> Stage {
        let drag = DRAG_FALLING / inertial_time(self.scene);
        Stage::Pack { drag }
    }

    /// These grains before the first step, under a piston at rest at `height` (m).
    fn at_rest_on_top(&self, height: f64, grains: Vec<GrainState>) -> State {
        let sample = &self.scene.sample;
        State {
            step: 0,
            piston: Piston {
                height,
                velocity: 0.0,
                acceleration: 0.0,
                // About that of the wall to come.
                mass: mean_mass(self.scene) * sample.length / sample.mean_diameter,
                load: self.scene.load.normal_force,
            },
            grains,
            contacts: Vec::new(),
            written: None,
            ledger: None,
        }
    }

    /// Mass of the top wall (kg/m), of which each rank has a part; collective.
    fn mass_of_top(&self, grains: &[GrainState]) -> f64 {
        let masses = crate::domain::FixedPoint::new(mean_mass(self.scene));
        let mut mass = Accumulator::default();
        for g in grains.iter().filter(|g| g.body == body::TOP) {
            masses.add(&mut mass, self.scene.law.disk_mass(g.radius));
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
        let total = crate::domain::total(self.exchange, snapshot.grains.len() as u64);
        // A contact is read by the rank that has read its first grain; the rank that has the second must know of it, too.
        let mut to = vec![Vec::new(); self.exchange.size()];
        let blocks = crate::io::collective::IdBlocks {
            grains: total,
            ranks: self.exchange.size() as u64,
        };
        for contact in &snapshot.contacts {
            let (a, b) = (blocks.holder(contact.i), blocks.holder(contact.j));
            to[a].extend_from_slice(bytemuck::bytes_of(contact));
            if b != a {
                to[b].extend_from_slice(bytemuck::bytes_of(contact));
            }
        }
        let contacts = self
            .exchange
            .all_to_all(to)
            .iter()
            .flat_map(|bytes| bytemuck::allocation::pod_collect_to_vec::<u8, ContactState>(bytes))
            .collect();
        Ok((
            header.stage,
            State {
                step: header.step,
                piston: header.piston,
                grains: snapshot.grains,
                contacts,
                written: Some([header.frames, header.rows]),
                ledger: header.ledger,
            },
        ))
    }

    fn system(&self) -> Result<System, Failure> {
        let (scene, sample) = (self.scene, &self.scene.sample);
        System::new(
            self.exchange,
            self.level,
            &scene.bookkeeping,
            sample.length,
            [sample.radius_max, 0.5 * sample.mean_diameter],
            scene.law.density(),
            scene.time_step.step,
            scene.load.normal_force,
            self.options.threads,
        )
    }

    fn header(
        &self,
        stage: Stage,
        step: u64,
        piston: &Piston,
        [frames, rows]: [u64; 2],
        ledger: Option<Kept>,
    ) -> String {
        let header = Header {
            stage,
            step,
            piston: *piston,
            frames,
            rows,
            ledger,
            packing: match &self.scene.origin {
                Origin::Insertion => None,
                Origin::Packing { file, .. } => Some(file.clone()),
            },
        };
        serde_json::to_string(&header).expect("a header of finite numbers")
    }

    /// Whether this rank was asked to stop.
    fn asked_to_stop(&self) -> bool {
        let out_of_time = self.options.wall_time;
        self.signals.received()
            || (self.exchange.rank() == 0
                && out_of_time.is_some_and(|t| self.started.elapsed() >= t))
    }

    /// Compresses the sample between smooth planes, which have the law `plane`, until it is at rest, and freezes the walls. `None`
    /// where it was stopped.
    fn pack<C: ContactLaw>(
        &mut self,
        law: &C,
        plane: impl ContactLaw,
        drag: f64,
        state: State,
    ) -> Result<Option<(f64, State)>, Failure> {
        let (exchange, scene) = (self.exchange, self.scene);
        let mut system = self.system()?;
        let mut drive = Planes::new(plane, state.piston, drag);
        let mut step = state.step;
        system.replace(exchange, law, &mut drive, state.grains, state.contacts)?;

        if step == 0 {
            initial_forces(exchange, &mut system, law, &mut drive, None)
                .map_err(|e| in_stage(e, "packing"))?;
        }
        let (sample, load) = (&scene.sample, &scene.load);
        let mean_force = load.pressure * sample.mean_diameter;
        let unit = mean_force * scene.mean_overlap();
        let resting_drag = DRAG_RESTING / inertial_time(scene);
        let energy = Frame::measure(exchange, &system, 0.0, unit);
        let at_rest = scene.pack.tolerance * unit * sample.grains as f64;
        // The energy of a wave goes with the square of its pressure.
        let balance = scene.pack.tolerance.sqrt().max(1e-3);
        loop {
            let stop = advance(
                exchange,
                &mut system,
                law,
                &mut drive,
                self.asked_to_stop(),
                None,
            )
            .map_err(|e| in_stage(e, "packing"))?;
            step += 1;
            if step.is_multiple_of(LOOK) {
                let kinetic = observe::kinetic_energy(exchange, &system, &energy.energy);
                let mut carried = Accumulator::default();
                drive.load_on(false, &system.fixed, &mut carried);
                let [carried] = system.fixed.total(exchange, [carried]);
                let carried = carried / load.normal_force;
                self.terminal
                    .packing(step, &drive.piston, kinetic / (unit * sample.grains as f64));
                // The bottom feels the load only when the sample is compressed all through.
                if carried > 0.5 {
                    drive.drag = resting_drag;
                }
                if kinetic < at_rest && (carried - 1.0).abs() < balance {
                    break;
                }
                if step >= scene.pack.max_steps {
                    return Err(Failure::numbers(format!(
                        "packing: not at rest after pack.max_steps = {step} steps: kinetic energy per grain is {:.1e} P d δ, \
                         pack.tolerance is {:.1e}",
                        kinetic / (unit * sample.grains as f64),
                        scene.pack.tolerance
                    )));
                }
            }
            if stop || step.is_multiple_of(PACK_CHECKPOINT) {
                record::checkpoint(
                    exchange,
                    &self.options.out,
                    &scene.toml,
                    &Snapshot {
                        header: self.header(
                            Stage::Pack { drag: drive.drag },
                            step,
                            &drive.piston,
                            [0; 2],
                            None,
                        ),
                        grains: system.grain_states(),
                        contacts: system.own_contact_states::<C>(),
                    },
                )?;
                if stop {
                    self.terminal.stopped(&self.options.out, "packing", step);
                    return Ok(None);
                }
            }
        }

        let mut grains = system.grain_states();
        let planes = [0.0, drive.piston.height];
        freeze_walls(&mut grains, planes, sample.mean_diameter);
        let mass = self.mass_of_top(&grains);
        let height = self.height_between_walls(&drive.piston);
        self.terminal.packed(step, height);
        let state = State {
            step: 0,
            piston: Piston {
                velocity: 0.0,
                acceleration: 0.0,
                mass,
                ..drive.piston
            },
            grains,
            contacts: system.contact_states::<C>(),
            written: None,
            ledger: None,
        };
        Ok(Some((height, state)))
    }

    fn shear<C: ContactLaw>(
        &mut self,
        law: &C,
        height: f64,
        state: State,
    ) -> Result<Ending, Failure> {
        let (exchange, scene, options) = (self.exchange, self.scene, self.options);
        let schedule = Schedule::new(scene, height);
        let mut system = self.system()?;
        let mut drive = GrainWalls {
            piston: state.piston,
            speed: schedule.speed,
            top: Vec::new(),
        };
        let first = state.step;
        let mut grains = state.grains;
        if first == 0 {
            for g in grains.iter_mut().filter(|g| g.body == body::TOP) {
                g.velocity = [schedule.speed, 0.0];
            }
        }
        system.replace(exchange, law, &mut drive, grains, state.contacts)?;
        let thickness = scene.sample.mean_diameter;
        let energy = scene.load.pressure * thickness * scene.mean_overlap();
        let frame = Frame::measure(exchange, &system, 2.0 * thickness, energy);
        if scene.output.energy {
            let mut ledger = Ledger::new(system.grains.unit, scene.sample.radius_max);
            if let Some(kept) = &state.ledger {
                ledger.resume(kept, exchange.rank());
            }
            system.ledger = Some(ledger);
        }
        self.terminal.shearing(scene, &schedule, first);
        let mut recorder =
            Recorder::open(exchange, scene, &schedule, &system, options, state.written)?;
        let mut samples = ContactForces::default();
        let mut step = first;

        if step == 0 {
            initial_forces(exchange, &mut system, law, &mut drive, Some(&mut samples))
                .map_err(|e| in_stage(e, "shear"))?;
            if schedule.series_due(0) {
                let row = observe::series(
                    exchange,
                    law,
                    &mut system,
                    &samples,
                    &drive.piston,
                    drive.speed,
                    &frame,
                    0.0,
                );
                recorder.series(exchange, 0, 0.0, &row)?;
            }
            if schedule.frame_due(0) {
                let (grains, contacts) = observe::frame::<C>(&system, &samples);
                recorder.frame(exchange, 0, 0.0, &grains, &contacts)?;
            }
        }
        let clock_start = Instant::now();
        let mut stopped = false;
        while step < schedule.total && !stopped {
            let stop = self.asked_to_stop() || options.stop_at == Some(step + 1);
            let next = step + 1;
            let (series, frames) = (schedule.series_due(next), schedule.frame_due(next));
            let sampled = (series || frames).then_some(&mut samples);
            let stop = advance(exchange, &mut system, law, &mut drive, stop, sampled)
                .map_err(|e| in_stage(e, "shear"))?;
            step = next;
            stopped = stop && step < schedule.total;
            let time = schedule.time(step);
            if series {
                let strain = schedule.strain(step);
                let row = observe::series(
                    exchange,
                    law,
                    &mut system,
                    &samples,
                    &drive.piston,
                    drive.speed,
                    &frame,
                    strain,
                );
                recorder.series(exchange, step, time, &row)?;
                self.terminal.latest(&row);
            }
            if frames {
                let (grains, contacts) = observe::frame::<C>(&system, &samples);
                recorder.frame(exchange, step, time, &grains, &contacts)?;
            }
            if schedule.checkpoint_due(step) || stopped || step == schedule.total {
                let written = recorder.flush(exchange)?;
                record::checkpoint(
                    exchange,
                    &options.out,
                    &scene.toml,
                    &Snapshot {
                        header: self.header(
                            Stage::Shear { height },
                            step,
                            &drive.piston,
                            written,
                            system.ledger.as_ref().map(|l| l.keep(exchange)),
                        ),
                        grains: system.grain_states(),
                        contacts: system.own_contact_states::<C>(),
                    },
                )?;
            }
            system.clock.end(Phase::Output);
            if schedule.progress_due(step) {
                self.terminal.progress(
                    &schedule,
                    scene.sample.grains,
                    first,
                    step,
                    clock_start.elapsed(),
                );
            }
        }
        let seconds = exchange.maximum(clock_start.elapsed().as_secs_f64());
        let rate =
            scene.sample.grains as f64 * (step - first) as f64 / seconds / exchange.size() as f64;
        let digest = observe::digest::<C, E>(exchange, &system, &drive.piston, step);
        recorder.finish(exchange, &system, rate, &digest, !stopped)?;
        let phases = system.clock.table(exchange);
        self.terminal
            .end(exchange, &system, &phases, rate, &digest, &options.out);
        if stopped {
            self.terminal.stopped(&options.out, "shear", step);
            return Ok(Ending::Stopped);
        }
        Ok(Ending::Done)
    }
}

fn in_stage(failure: Failure, stage: &str) -> Failure {
    match failure {
        Failure::Numbers(m) => Failure::Numbers(format!("{stage}, {m}")),
        other => other,
    }
}
