//! Shear of the sample between walls made of its grains, of a cell without walls, or below a free
//! surface.

use std::time::Instant;

use gshear_dem::budget::{EnergyBudget, SavedBudget};
use gshear_dem::clock::StepPhase;
use gshear_dem::dimension::Dimension;
use gshear_dem::domain::Exchange;
use gshear_dem::drive::{Drive, GrainWalls, Images, Slider, Top};
use gshear_dem::failure::{Failure, Result};
use gshear_dem::kernel::PairForce;
use gshear_dem::observe::{self, SampleConstants, UpperEnd};
use gshear_dem::state::{Confinement, GrainState, SeriesRow, Snapshot, body};
use gshear_dem::tuning::Tuned;
use gshear_mpi_exchange::Parallel;
use gshear_scene::schedule::{Schedule, definition_of_inertial_number};
use gshear_scene::{Motion, PlaneShear, Scene};
use gshear_store::h5::Attribute;
use gshear_store::run_reader::RunStage;

use super::assembly::Assembly;
use super::top_wall::mass_of;
use crate::files::{Files, Format};
use crate::frame_analysis::FrameAnalysis;
use crate::header::{Header, ShearHeader, TimeOrigin, UpToCheckpoint, Written};
use crate::options::Outcome;
use crate::run::{Checkpoint, LOOK, Run, Save, Stage};
use gshear_store::file_names::RUN_FILE;
use gshear_store::status::Standing;

/// Steps between looks for grains that have passed a wall, where these are removed.
const REMOVAL_STEPS: u64 = 100;

/// What is above the sample, and moves.
enum Above {
    /// A wall, and one below. Nothing is a wall without grains, which rests.
    Wall(GrainWalls),
    /// The images of the sample.
    Images(Images),
}

impl Above {
    fn new(scene: &Scene, plane_shear: &PlaneShear, top: Top, images: bool) -> Self {
        if images {
            return Self::Images(Images::new(top));
        }
        let mut walls = GrainWalls::new(top);
        let floor = plane_shear.floor();
        walls.flat = scene.flat_walls().map(|_| match plane_shear.confinement {
            Confinement::FreeSurface => [floor, f64::INFINITY],
            _ => [floor; 2],
        });
        Self::Wall(walls)
    }

    fn top(&self) -> &Top {
        match self {
            Self::Wall(walls) => &walls.motion,
            Self::Images(images) => &images.motion,
        }
    }

    fn drive<D: Dimension>(&mut self) -> &mut dyn Drive<D> {
        match self {
            Self::Wall(walls) => walls,
            Self::Images(images) => images,
        }
    }
}

/// The stage that shears the sample.
pub(super) struct ShearStage<'a, D: Dimension> {
    scene: &'a Scene,
    plane_shear: &'a PlaneShear,
    schedule: Schedule,
    assembly: Assembly<'a, D>,
    above: Above,
    /// Constants of the sample for the time series.
    frame: SampleConstants,
    /// Mass of the free grains (kg; kg/m in 2D).
    mass: f64,
    files: Files,
    analysis: Option<FrameAnalysis>,
    step: u64,
    first: u64,
    /// From where the time counts.
    origin: TimeOrigin,
    started: Instant,
    /// The last row of the time series.
    latest: Option<SeriesRow>,
}

impl<'a, D: Dimension> ShearStage<'a, D> {
    /// Takes the sample and opens its files.
    pub fn new(
        run: &Run<'a>,
        plane_shear: &'a PlaneShear,
        law: &'a dyn PairForce<D>,
        from: ShearHeader,
        mut state: Snapshot,
    ) -> Result<Self> {
        let (exchange, scene) = (run.exchange, run.scene);
        let mut schedule = Schedule::new(scene, plane_shear, from.height);
        if let Some(window) = run.options.replay {
            schedule = schedule.of_window(window);
        }
        let mut assembly = Assembly::new(run, scene, from.cell(&scene.sample), law)?;
        assembly.system.steps = from.step;
        let spring = plane_shear.shear.spring;
        if spring.is_none() {
            // A wall that begins to move at its full speed is not to leave the list in a step.
            let way = schedule.protocol.fastest() * schedule.step;
            assembly.system.list.at_least(4.0 * way);
        }
        let mut top = top(scene, plane_shear, &schedule, &from);
        if from.step == 0 {
            set_moving(&mut state.grains, &mut top, &schedule, D::UP);
            let is_driven = spring.is_none() && !schedule.protocol.segment(0).is_pulled();
            if let (Some([_, stream]), true) = (from.images, is_driven) {
                // Images, and the grains with them, take the velocity of the drive in the first
                // step.
                top.slider.state.velocity = stream;
            }
        }
        let mut above = Above::new(scene, plane_shear, top, from.images.is_some());
        assembly.system.flat = scene.flat_walls();
        let mass = mass_of(run, scene, &state.grains, body::FREE);
        assembly.replace(above.drive(), state.grains, state.contacts)?;
        let system = &mut assembly.system;
        let thickness = plane_shear.thickness_of_walls(&scene.sample);
        let (load, sample) = (&plane_shear.load, &scene.sample);
        let energy = load.pressure * sample.mean_section() * load.mean_overlap(sample);
        let frame = SampleConstants::measure(exchange, system, thickness, energy);
        if plane_shear.output.energy {
            let mut budget = EnergyBudget::new(system.grains().units, scene.sample.radius_max);
            if let Some(mut saved) = from.energy_budget {
                if above.top().normal_work {
                    saved = saved.with_varying_load(&from.piston);
                }
                budget.resume(&saved, exchange.rank());
            }
            system.budget = Some(budget);
        }
        run.terminal
            .shearing(scene, plane_shear, &schedule, from.step);
        let before = (run.options.replay.is_none()).then(|| UpToCheckpoint::new(from.step));
        let format = Format {
            name: RUN_FILE,
            columns: schedule.columns,
            attributes: attributes(scene, plane_shear, &schedule),
            height: Some(schedule.height),
        };
        let files = Files::open(run, &mut assembly, &format, before)?;
        // The first row of new scalars is of a frame without a frame before it.
        let before = state.analysed.filter(|_| files.resumed);
        let scalars = plane_shear.analysis.scalars;
        let analysis = scalars.then(|| FrameAnalysis::new(exchange, &mut assembly.system, before));
        Ok(Self {
            scene,
            plane_shear,
            schedule,
            assembly,
            above,
            frame,
            mass,
            files,
            analysis,
            step: from.step,
            first: from.step,
            origin: from.origin,
            started: Instant::now(),
            latest: None,
        })
    }

    /// Closes the files; a run that is done is marked as finished.
    pub fn finish(mut self, run: &Run<'_>, outcome: Result<Outcome>) -> Result<Outcome> {
        let exchange = run.exchange;
        let outcome = match outcome {
            Ok(outcome) => outcome,
            Err(failure) => {
                if let Failure::Numbers(_) = failure {
                    self.write_scalars(exchange)?;
                }
                return Err(self.files.fail(exchange, failure));
            }
        };
        let complete = outcome == Outcome::Done;
        let seconds = exchange.maximum(self.started.elapsed().as_secs_f64());
        let done = f64::from(self.scene.sample.grains) * (self.step - self.first) as f64;
        let rate = done / seconds / exchange.size() as f64;
        let mut more = self.above.top().state().to_vec();
        more.extend(self.images().into_iter().flatten());
        let digest = (self.assembly).digest(bytemuck::cast_slice(&more), self.step);
        let attributes = [
            ("digest", Attribute::from(digest.clone())),
            ("speed", rate.into()),
            ("rank_map", self.assembly.system.slabs.cuts.clone().into()),
        ];
        let known = if complete { &attributes[..] } else { &[] };
        self.files.finish(exchange, known)?;
        run.terminal.end(
            exchange,
            &mut self.assembly.system,
            done / seconds,
            &digest,
            (&run.options.out, complete),
        );
        Ok(outcome)
    }

    /// Passes the scalars computed so far to the files.
    fn write_scalars(&mut self, exchange: &dyn Parallel) -> Result<()> {
        let Some(analysis) = &mut self.analysis else {
            return Ok(());
        };
        let rows = analysis.flush(exchange);
        self.files.trajectory.scalars(exchange, &rows)
    }

    /// The output due after the step `next`: a row, a frame, a frame to be analysed.
    fn due(&self, next: u64) -> [bool; 3] {
        [
            self.schedule.series_due(next),
            self.schedule.frame_due(next),
            self.schedule.analysis_due(next),
        ]
    }

    /// Ends the run if a free grain has passed a wall, unless such grains are removed. Collective.
    fn check_between(&self, exchange: &dyn Exchange) -> Result<()> {
        match self.outer_planes() {
            Some(planes) if !self.plane_shear.removes => {
                observe::check_between(exchange, &self.assembly.system, planes)
            }
            _ => Ok(()),
        }
    }

    /// Removes the free grains that have passed a wall. Before a step, whose number alone decides
    /// when, so that output does not. Collective.
    fn remove_beyond(&mut self, run: &Run<'_>) {
        let Some(planes) = self.outer_planes() else {
            return;
        };
        let system = &mut self.assembly.system;
        let Some(said) = observe::remove_beyond(run.exchange, system, planes) else {
            return;
        };
        self.frame.count(run.exchange, system);
        self.mass = mass_of(run, self.scene, &system.grain_states(), body::FREE);
        run.terminal.warn(format!("{said}; removed"));
    }

    /// Heights of the planes that no free grain is to pass (m): the lower edge of the bottom, and
    /// the upper edge of the top, infinite below a free surface.
    fn outer_planes(&self) -> Option<[f64; 2]> {
        if let Above::Images(_) = self.above {
            return None;
        }
        let top = self.above.top();
        let bottom = self.plane_shear.floor() + top.bottom_displacement();
        let top = match self.plane_shear.confinement {
            Confinement::FreeSurface => f64::INFINITY,
            _ => self.plane_shear.floor() + top.piston.height,
        };
        Some([bottom, top])
    }

    /// Ends the run if the top wall has left the sample: nothing touches it, and it flies on by
    /// more than half a mean diameter, or it has come down to the bottom. A top that moves at an
    /// imposed velocity or by a servo does not fly, and a vibrating bottom may throw it on purpose.
    fn check_top(&self) -> Result<()> {
        let Above::Wall(GrainWalls { motion, .. }) = &self.above else {
            return Ok(());
        };
        let layer = motion.piston.height - self.frame.walls - motion.bottom_displacement();
        if layer <= 0.0 && self.plane_shear.confinement == Confinement::Walls {
            return Err(Failure::numbers(format!(
                "step {}: the top wall has come down to the bottom wall: no grain between them holds it; give walls without holes, or end the run before",
                self.step
            )));
        }
        let now = motion.slider.state.step;
        let protocol = &self.schedule.protocol;
        let is_driven = protocol.segment_before(now).normal_velocity().is_some();
        let piston = &motion.piston;
        let flight = piston.flight();
        if is_driven
            || motion.servo.is_some()
            || protocol.has_bottom()
            || flight <= 0.5 * self.scene.sample.mean_diameter
        {
            return Ok(());
        }
        Err(Failure::numbers(format!(
            "step {}: the top wall has left the sample: nothing touches it at {:.6e} m above the bottom, and at {:.3e} m/s it rises by another {flight:.3e} m, more than half a mean diameter, against its load of {:.3e} Pa; {}",
            self.step,
            piston.height - self.frame.walls,
            piston.velocity,
            piston.load / self.scene.sample.base(),
            self.what_holds_the_top(),
        )))
    }

    /// What to change so that the top wall does not leave the sample.
    fn what_holds_the_top(&self) -> String {
        let is_loose = self.plane_shear.origin.file().is_some() && self.plane_shear.pack.skip;
        let packed = if is_loose {
            "pack.skip = false if the file's grains are not at rest at this load; "
        } else {
            ""
        };
        let ramp = match self.plane_shear.shear.motion {
            Motion::Strain { .. } => "shear.ramp (s)",
            Motion::Protocol(_) => "ramp (s) in the part, or pressure and pressure_end",
        };
        format!(
            "{packed}grains throw a wall that begins to move at once: give a gradual start ({ramp}), or load.control = \"servo\", or no walls (sample.boundary = \"periodic\")"
        )
    }

    /// What is above the sample, as rows of the time series measure it; collective.
    fn upper_end(&mut self, exchange: &dyn Exchange) -> UpperEnd {
        match &self.above {
            Above::Images(images) => UpperEnd::Images(images.felt),
            Above::Wall(walls) if self.plane_shear.confinement == Confinement::FreeSurface => {
                let bottom = self.plane_shear.floor()
                    + self.frame.walls
                    + walls.motion.bottom_displacement();
                let system = &mut self.assembly.system;
                let of = (self.mass, bottom);
                UpperEnd::Free(observe::flow(exchange, system, &self.frame, of))
            }
            Above::Wall(_) => UpperEnd::Wall,
        }
    }

    /// The Lees–Edwards offset (m) and the velocity (m/s) of images.
    fn images(&self) -> Option<[f64; 2]> {
        let sheared = self.assembly.system.cell.sheared;
        sheared.map(|sheared| [sheared.offset, sheared.velocity])
    }

    fn header(&self, run: &Run<'_>, written: Written) -> Header {
        Header::Shear(ShearHeader {
            step: self.step,
            origin: self.origin,
            piston: self.above.top().piston,
            images: self.images(),
            slider: (self.step > 0).then_some(self.above.top().slider.state),
            height: self.schedule.height,
            written,
            energy_budget: (self.assembly.system.budget.as_ref()).map(|b| b.save(run.exchange)),
        })
    }

    fn snapshot(&mut self) -> Snapshot {
        Snapshot {
            analysed: (self.analysis.as_ref().and_then(FrameAnalysis::last)).cloned(),
            ..self.assembly.owned()
        }
    }
}

impl<D: Dimension> Stage for ShearStage<'_, D> {
    fn at(&self) -> (&'static str, u64) {
        (RunStage::Shear.name(), self.step)
    }

    fn is_done(&self) -> bool {
        self.step >= self.schedule.total
    }

    /// Also records the state before the first step.
    fn begin(&mut self, run: &mut Run<'_>) -> Result<()> {
        if self.scene.keep_checkpoints && run.options.replay.is_none() {
            // A window before the first checkpoint is replayed from the packed sample.
            run.save(&Checkpoint {
                header: self.header(run, Written::default()),
                state: self.snapshot(),
                keep: true,
            })?;
        }
        self.assembly.initial_forces(self.above.drive(), true)
    }

    fn step(&mut self, run: &mut Run<'_>, stop: bool) -> Result<bool> {
        if self.plane_shear.removes && self.step.is_multiple_of(REMOVAL_STEPS) {
            self.remove_beyond(run);
        }
        let sampled = self.due(self.step + 1).contains(&true);
        let stop = stop || run.asked_to_stop();
        let stop = self.assembly.advance(self.above.drive(), sampled, stop)?;
        self.step += 1;
        self.check_top()?;
        Ok(stop)
    }

    fn record(&mut self, run: &mut Run<'_>) -> Result<()> {
        let (exchange, step) = (run.exchange, self.step);
        let [series, frames, analysed] = self.due(step);
        let time = self.origin.time(step, self.schedule.step);
        let is_last = step == self.schedule.total;
        if series || frames || analysed || is_last {
            self.check_between(exchange)?;
        }
        if series {
            let above = self.upper_end(exchange);
            let row = observe::series(
                exchange,
                self.assembly.law,
                &mut self.assembly.system,
                &self.assembly.samples,
                (self.above.top(), above),
                &self.frame,
                self.schedule.height,
            );
            let mut values = row.columns().to_vec();
            if self.schedule.has_imposed {
                values.extend(observe::imposed(self.above.top()).columns());
            }
            match above {
                UpperEnd::Wall => {}
                UpperEnd::Images(_) => {
                    let (system, samples) = (&mut self.assembly.system, &self.assembly.samples);
                    let row = observe::stress(exchange, system, samples, self.mass);
                    values.extend(row.columns());
                }
                UpperEnd::Free(flow) => values.extend(flow.row().columns()),
            }
            let files = &mut self.files;
            files.trajectory.series(exchange, step, time, &values)?;
            files.log(step, time, &values);
            self.latest = Some(row);
        }
        if frames || analysed {
            let (grains, contacts) = self.assembly.frame();
            if frames {
                let height = self.above.top().piston.height - self.frame.walls;
                let edges = self.assembly.system.cell.edges::<D>(height);
                let clock = (step, time);
                (self.files.trajectory).frame(exchange, clock, &edges, &grains, &contacts)?;
            }
            if let (Some(analysis), true) = (&mut self.analysis, analysed) {
                let rows = analysis.frame(exchange, step, &grains, &contacts);
                self.files.trajectory.scalars(exchange, &rows)?;
            }
        }
        self.assembly.system.clock.end(StepPhase::Output);
        Ok(())
    }

    fn save_due(&self) -> Save {
        let is_replay = self.schedule.window().is_some();
        if self.schedule.checkpoint_due(self.step) || (self.is_done() && !is_replay) {
            Save::Now
        } else if self.step.is_multiple_of(LOOK) && !is_replay {
            Save::IfOld
        } else {
            Save::No
        }
    }

    fn flush(&mut self, run: &mut Run<'_>) -> Result<()> {
        self.check_between(run.exchange)?;
        self.write_scalars(run.exchange)?;
        self.files.flush(run.exchange)
    }

    fn state(&mut self, run: &mut Run<'_>) -> Result<Checkpoint> {
        self.write_scalars(run.exchange)?;
        Ok(Checkpoint {
            header: self.header(run, self.files.written()),
            state: self.snapshot(),
            keep: self.scene.keep_checkpoints,
        })
    }

    fn tuned(&self) -> Option<Tuned> {
        self.assembly.system.tuning.tuned()
    }

    fn standing(&self) -> Standing {
        let row = self.latest;
        // The strain under a force is not known in advance.
        let strain = match (self.schedule.protocol.has_force(), row) {
            _ if self.plane_shear.confinement == Confinement::FreeSurface => None,
            (true, Some(row)) => Some(row.strain),
            _ => Some(self.schedule.strain(self.step)),
        };
        Standing {
            stage: RunStage::Shear.name().into(),
            step: self.step,
            steps: Some(self.schedule.total),
            strain,
            stress_ratio: row.map(|row| row.stress_ratio),
            solid_fraction: row.map(|row| row.solid_fraction),
            moving: Some(self.scene.sample.grains),
            ..Standing::default()
        }
    }

    fn log(&mut self, run: &Run<'_>) {
        self.assembly.system.clock.end(StepPhase::Output);
        if self.schedule.progress_due(self.step) {
            let done = (self.step - self.first, self.started.elapsed());
            run.terminal
                .log_shear(&self.schedule, &self.standing(), done);
        }
    }

    fn publish(&mut self) {
        self.files.publish();
    }
}

/// The top of a shear as it begins or goes on.
fn top(scene: &Scene, plane_shear: &PlaneShear, schedule: &Schedule, from: &ShearHeader) -> Top {
    let slider = Slider::new(schedule.protocol.clone(), plane_shear.shear.spring);
    let servo = plane_shear.servo(&scene.sample);
    let mut piston = from.piston;
    let load = plane_shear.load.normal_force;
    // A branch may change the load; a protocol follows its own.
    let is_loaded_anew = !schedule.protocol.has_normal() && piston.load != load;
    if is_loaded_anew {
        piston.acceleration += (piston.load - load) / piston.mass;
        piston.load = load;
    }
    let mut top = Top::new(piston, slider, servo, plane_shear.output.energy);
    // Once it is summed, it stays so.
    let is_summed = |saved: &SavedBudget| plane_shear.output.energy && saved.has_normal_work();
    top.normal_work |= is_loaded_anew || from.energy_budget.as_ref().is_some_and(is_summed);
    if let Some(slider) = from.slider {
        top.slider.state = slider;
    }
    top
}

/// Gives the grains of the walls the velocities with which these begin.
fn set_moving(grains: &mut [GrainState], top: &mut Top, schedule: &Schedule, up: usize) {
    let [along, top, bottom] = top.begin();
    for g in grains {
        match g.body {
            body::TOP => {
                g.velocity = [along, 0.0, 0.0];
                g.velocity[up] = top;
            }
            body::BOTTOM if schedule.protocol.has_bottom() => g.velocity[up] = bottom,
            _ => {}
        }
    }
}

/// Attributes of `run.h5`. With a protocol, intervals are those of its first part.
fn attributes(
    scene: &Scene,
    plane_shear: &PlaneShear,
    schedule: &Schedule,
) -> Vec<(&'static str, Attribute)> {
    let load = &plane_shear.load;
    let velocity = schedule.protocol.segment(0).velocity().unwrap_or(0.0);
    let frames = schedule.intervals[0].frames;
    let frame_strain = velocity * (frames.mean_steps() * schedule.step) / schedule.height;
    let definition = definition_of_inertial_number(scene.dimension);
    let inertial_number = schedule.inertial_number(velocity);
    let mut attributes = vec![
        ("frame_strain", frame_strain.into()),
        ("steps_per_frame", frames.steps().into()),
        ("inertial_number", inertial_number.into()),
        ("inertial_number_definition", definition.into()),
        ("stiffness_number", load.stiffness_number.into()),
        ("wall_speed", velocity.into()),
        ("normal_force", load.normal_force.into()),
        ("pressure", load.pressure.into()),
        ("height_start", schedule.height.into()),
    ];
    if let Some(spring) = plane_shear.shear.spring {
        attributes.push(("spring_stiffness", spring.into()));
    }
    attributes
}
