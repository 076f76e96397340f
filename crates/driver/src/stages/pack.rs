//! Compression of a sample between smooth planes until it is at rest.

use gshear_dem::clock::StepPhase;
use gshear_dem::dimension::Dimension;
use gshear_dem::domain::Accumulator;
use gshear_dem::drive::{Piston, Planes};
use gshear_dem::failure::{Failure, Result};
use gshear_dem::kernel::PairForce;
use gshear_dem::observe::{self, SampleConstants};
use gshear_dem::state::{GrainState, Snapshot, body};
use gshear_scene::holes;
use gshear_scene::insertion::freeze_walls;
use gshear_scene::schedule::packing_time;
use gshear_scene::{Load, PlaneShear, Scene};

use super::assembly::Assembly;
use super::top_wall::{height_between, mass_of, mass_of_top};
use crate::files::Files;
use crate::header::{Header, PackHeader};
use crate::run::{Checkpoint, Run};
use crate::stage::{Save, Stage};
use gshear_store::collective::gathered;
use gshear_store::status::StageProgress;

/// Steps between two checks whether the sample is at rest.
const CHECK_INTERVAL: u64 = 1000;
/// Starts after the first one, each with a quarter of the load of the one before.
const MOST_STARTS: u32 = 6;

/// The stage that compresses the sample between planes.
pub(super) struct PackStage<'a, D: Dimension> {
    scene: &'a Scene,
    plane_shear: &'a PlaneShear,
    assembly: Assembly<'a, D>,
    drive: Planes<D>,
    /// Weight of the grains (N; N/m in 2D), which the bottom carries besides the load.
    weight: f64,
    step: u64,
    /// P d̄ δ̄, and the fixed-point numbers for sums of energies.
    unit: f64,
    energy: SampleConstants,
    at_rest: bool,
    /// Whether the grains left the contact law before the bottom bore the whole load.
    fell_outside: bool,
    /// Whether it has taken all the steps that it may.
    ran_out: bool,
    /// Starts before this one.
    starts: u32,
    advance: Advance,
}

/// How far the packing has come, as a guess: the top falls to where the grains touch, then the
/// kinetic energy decays.
struct Advance {
    /// Height of the top at the start (m), and where the grains are dense.
    heights: [f64; 2],
    /// Greatest kinetic energy per grain so far.
    greatest: f64,
    /// The guess, which never falls.
    fraction: f64,
}

/// The part of the packing in which the top falls, about; and the solid fractions at which disks
/// and spheres are dense.
const FALLING: f64 = 0.25;
const DENSE: [f64; 2] = [0.84, 0.63];

impl Advance {
    fn new(scene: &Scene, axes: usize, height: f64) -> Self {
        let sample = &scene.sample;
        let volume = f64::from(sample.grains) * sample.mean_volume;
        Self {
            heights: [height, volume / sample.base() / DENSE[axes - 2]],
            greatest: 0.0,
            fraction: 0.0,
        }
    }

    /// The top is at `height` (m) and a grain has the energy `kinetic`, at rest `tolerance`.
    fn observe(&mut self, height: f64, kinetic: f64, tolerance: f64) {
        self.greatest = self.greatest.max(kinetic);
        let [first, dense] = self.heights;
        let fallen = ((first - height) / (first - dense).max(0.01 * first)).clamp(0.0, 1.0);
        let mut fraction = FALLING * fallen;
        if fallen > 0.9 && self.greatest > tolerance {
            let decayed = (self.greatest / kinetic).ln() / (self.greatest / tolerance).ln();
            fraction += (1.0 - FALLING) * decayed.clamp(0.0, 1.0);
        }
        self.fraction = self.fraction.max(fraction);
    }
}

/// Drag during the compression, over the inverse [`packing_time`] of the present load.
const DRAG_FALLING: f64 = 0.01;

/// Drag (1/s) while the sample falls together under this part of the load.
pub(super) fn falling_drag(scene: &Scene, load: &Load, part: f64) -> f64 {
    DRAG_FALLING / packing_time(scene, load) * part.sqrt()
}

impl<'a, D: Dimension> PackStage<'a, D> {
    /// The sample as its packing begins or goes on; `plane` is the law of the planes.
    pub fn new(
        run: &Run<'a>,
        plane_shear: &'a PlaneShear,
        law: &'a dyn PairForce<D>,
        plane: Box<dyn PairForce<D>>,
        header: PackHeader,
        state: Snapshot,
    ) -> Result<Self> {
        let scene = run.scene;
        let mut assembly = Assembly::new(run, scene, scene.sample.cell(), law)?;
        assembly.system.steps = header.step;
        // What pulls along smooth planes would move the sample as a whole.
        let [along, down] = &mut assembly.system.gravity;
        *along = 0.0;
        let down = *down;
        let mut drive = Planes::new(plane, header.piston, header.drag);
        let weight = down * mass_of(run, scene, &state.grains, body::FREE);
        assembly.replace(&mut drive, state.grains, state.contacts)?;
        let (load, sample) = (&plane_shear.load, &scene.sample);
        let mean_force = load.pressure * sample.mean_section();
        let unit = mean_force * load.mean_overlap(sample);
        Ok(Self {
            energy: SampleConstants::measure(run.exchange, &mut assembly.system, 0.0, unit),
            scene,
            plane_shear,
            assembly,
            drive,
            weight,
            step: header.step,
            unit,
            at_rest: false,
            fell_outside: false,
            ran_out: false,
            starts: header.starts,
            advance: Advance::new(scene, D::AXES, header.piston.height),
        })
    }

    /// The drag (1/s) until the bottom bears the load, to rounding.
    fn falling_drag(&self) -> f64 {
        let load = &self.plane_shear.load;
        falling_drag(self.scene, load, self.drive.piston.load / load.normal_force)
    }

    /// The start to try next, if the grains left the contact law before they bore the load.
    pub(crate) fn next_start(&self) -> Option<u32> {
        (self.fell_outside && self.starts < MOST_STARTS).then_some(self.starts + 1)
    }

    /// The grains that close holes of the walls, with the bodies of these; the same on every rank.
    /// Collective.
    fn plugs(&self, run: &Run<'_>, grains: &[GrainState], height: f64) -> Vec<(u32, u32)> {
        let (scene, walls) = (self.scene, self.plane_shear);
        let reach = holes::reach(walls, &scene.sample);
        let mut near = Vec::new();
        for g in grains {
            let up = g.position[D::UP];
            if g.body != body::FREE || up < reach || up > height - reach {
                near.push(*g);
            }
        }
        let near = gathered(run.exchange, &near, |g| g.id);
        holes::plugs(scene, walls, [0.0, height], &near)
    }

    /// Makes walls of grains of the sample at rest. Returns the top wall, and the state for the
    /// shear.
    pub fn finish(mut self, run: &Run<'_>) -> (Piston, Snapshot) {
        let mut state = self.assembly.snapshot();
        let (scene, height) = (self.scene, self.drive.piston.height);
        let plane_shear = self.plane_shear;
        let mut plugged = 0;
        if plane_shear.boundary.has_grains() {
            let planes = plane_shear.cuts(&scene.sample, [0.0, height]);
            let material = scene.materials.wall;
            freeze_walls(&mut state.grains, D::UP, planes, material);
            let plugs = self.plugs(run, &state.grains, height);
            holes::close(&mut state.grains, &plugs, material);
            plugged = plugs.len();
        }
        let piston = Piston {
            velocity: 0.0,
            acceleration: 0.0,
            mass: mass_of_top(run, scene, plane_shear, &state.grains, height),
            ..self.drive.piston
        };
        let between = height_between(scene, plane_shear, &piston);
        run.terminal.packed(self.step, between, plane_shear);
        run.terminal.plugged(plugged);
        (piston, state)
    }
}

impl<'a, D: Dimension> Stage<'a, D> for PackStage<'a, D> {
    fn name(&self) -> &'static str {
        super::PACK
    }

    fn name_in_messages(&self) -> &'static str {
        "packing"
    }

    fn completed(&self) -> u64 {
        self.step
    }

    fn files(&mut self) -> Option<&mut Files> {
        None
    }

    fn count(&self) -> Option<u64> {
        None
    }

    fn is_done(&self) -> bool {
        self.at_rest
    }

    fn begin(&mut self) -> Result<()> {
        self.assembly.initial_forces(&mut self.drive, false)
    }

    fn step(&mut self, run: &mut Run<'_>, stop: bool) -> Result<bool> {
        let stop = stop || run.asked_to_stop();
        let moved = self.assembly.advance(&mut self.drive, false, stop);
        self.step += 1;
        moved.map_err(|failure| match failure {
            Failure::Numbers(what) => {
                let falls = self.drive.drag < 2.0 * self.falling_drag();
                let load = self.plane_shear.load.normal_force;
                self.fell_outside = falls || self.drive.piston.load < load;
                let less = if self.plane_shear.boundary.has_top() {
                    "a greater load.stiffness_number, that is a lower load"
                } else {
                    "less load.gravity"
                };
                Failure::numbers(format!("{what}; give {less}, or sizes closer together"))
            }
            other => other,
        })
    }

    /// Raises the load once the bottom bears it, and checks whether the sample is at rest, every
    /// [`CHECK_INTERVAL`] steps.
    fn record(&mut self, run: &mut Run<'_>) -> Result<()> {
        let (scene, exchange) = (self.scene, run.exchange);
        let PlaneShear { load, pack, .. } = self.plane_shear;
        let is_last = self.step == pack.max_steps;
        if self.step == 0 || !(is_last || self.step.is_multiple_of(CHECK_INTERVAL)) {
            return Ok(());
        }
        let tolerance = pack.tolerance;
        let grains = f64::from(scene.sample.grains);
        let kinetic =
            observe::kinetic_energy(exchange, &mut self.assembly.system, &self.energy.energy);
        let mut carried = Accumulator::default();
        let fixed = &self.assembly.system.fixed;
        self.drive.load_on(false, fixed, &mut carried);
        let [carried] = fixed.total(exchange, [carried]);
        let pressing = self.drive.piston.load;
        let carried = (carried - self.weight) / pressing;
        let per_grain = kinetic / (self.unit * grains);
        self.advance
            .observe(self.drive.piston.height, per_grain, tolerance);
        run.terminal
            .packing(self.step, &self.drive.piston, per_grain);
        // The bottom bears the load besides the weight only once the whole sample is compressed.
        if carried > 0.5 {
            self.drive.piston.load = (2.0 * pressing).min(load.normal_force);
            let part = self.drive.piston.load / load.normal_force;
            self.drive.drag = pack.drag / packing_time(scene, load) * part.sqrt();
        }
        let loaded = pressing == load.normal_force;
        // The energy of a wave is proportional to the square of its pressure.
        let balance = tolerance.sqrt().max(1e-3);
        let energy_at_rest = tolerance * self.unit * grains;
        if loaded && kinetic < energy_at_rest && (carried - 1.0).abs() < balance {
            self.at_rest = true;
        } else if self.step >= pack.max_steps {
            self.ran_out = true;
            return Err(Failure::numbers(format!(
                "not at rest after pack.max_steps = {} steps: the kinetic energy per grain is {per_grain:.1e} P d δ, \
                 pack.tolerance is {tolerance:.1e}; allow more steps or a greater tolerance",
                self.step,
            )));
        }
        self.assembly.system.clock.end(StepPhase::Output);
        Ok(())
    }

    fn progress(&self) -> StageProgress {
        StageProgress {
            stage: self.name().into(),
            step: self.step,
            fraction: Some(self.advance.fraction),
            moving: Some(self.scene.sample.grains),
            ..StageProgress::default()
        }
    }

    fn save_due(&self) -> Save {
        if self.at_rest {
            Save::No
        } else {
            Save::after(self.step, false)
        }
    }

    fn is_sound(&self) -> bool {
        self.ran_out
    }

    fn state(&mut self, _: &mut Run<'_>) -> Result<Checkpoint> {
        Ok(Checkpoint {
            header: Header::Pack(PackHeader {
                step: self.step,
                piston: self.drive.piston,
                drag: self.drive.drag,
                starts: self.starts,
            }),
            state: self.assembly.owned(),
            keep: false,
        })
    }
}
