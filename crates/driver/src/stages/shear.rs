//! Shear of the sample between walls made of its grains, of a cell without walls, or below a free
//! surface.

use std::time::Instant;

use gshear_dem::budget::{EnergyBudget, SavedBudget};
use gshear_dem::clock::StepPhase;
use gshear_dem::dimension::Dimension;
use gshear_dem::domain::{Exchange, Traffic};
use gshear_dem::drive::{LateralLengths, LateralState, MovingBoundary, Slider, Top};
use gshear_dem::failure::{Failure, Result};
use gshear_dem::fluctuations::{self, Scales};
use gshear_dem::kernel::PairForce;
use gshear_dem::observables::SampleView;
use gshear_dem::observe::{self, RowInput, SampleConstants};
use gshear_dem::profile::RankProfile;
use gshear_dem::state::{Cell, GrainState, SeriesRow, Snapshot, body};
use gshear_dem::until::{Checks, TopState};
use gshear_mpi_exchange::Parallel;
use gshear_scene::schedule::{Schedule, definition_of_inertial_number};
use gshear_scene::{Motion, PlaneShear, RunStage, Scene};
use gshear_store::h5::Attribute;

use super::assembly::Assembly;
use super::own_columns::OwnColumns;
use super::top_wall::mass_of;
use crate::files::{Files, Format, TimePoint};
use crate::header::{Header, PartEnd, ShearHeader, TimeOrigin, UpToCheckpoint};
use crate::options::Outcome;
use crate::output_schedule::OutputSchedule;
use crate::run::{Checkpoint, Run};
use crate::stage::{CHECKPOINT_INTERVAL, Save, Stage};
use crate::terminal::Ending;
use gshear_store::file_names::part_of;
use gshear_store::status::StageProgress;

/// Steps between looks for grains that have passed a wall, where these are removed.
const REMOVAL_STEPS: u64 = 100;

/// The stage that shears the sample.
pub(super) struct ShearStage<'a, D: Dimension> {
    scene: &'a Scene,
    plane_shear: &'a PlaneShear,
    schedule: Schedule,
    assembly: Assembly<'a, D>,
    boundary: MovingBoundary,
    /// Constants of the sample for the time series.
    frame: SampleConstants,
    /// Scales for the temperatures, if these are recorded.
    scales: Option<Scales>,
    /// Columns that the scene declares, if it does.
    own_columns: Option<OwnColumns>,
    /// Mass of the free grains (kg; kg/m in 2D).
    mass: f64,
    files: Files,
    step: u64,
    first: u64,
    /// Steps of the stages before.
    before: u64,
    /// Lengths of the cell in which strain steps left the sample, if they came before.
    left_in: Option<[f64; 3]>,
    /// From where the time counts.
    origin: TimeOrigin,
    started: Instant,
    /// What this rank had sent before.
    traffic: Traffic,
    /// The last row of the time series.
    latest: Option<SeriesRow>,
    /// The parts of the protocol that a condition has ended.
    ends: Vec<PartEnd>,
    /// The checks of the present part so far.
    checks: Option<Checks>,
}

/// A sample after its shear, or up to a stop.
pub(super) struct Sheared<'a, D: Dimension> {
    pub assembly: Assembly<'a, D>,
    pub steps: u64,
    pub outcome: Outcome,
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
        let mut schedule = from.with_ends(Schedule::new(scene, plane_shear, from.height));
        if let Some(window) = run.options.replay {
            schedule = schedule.restricted_to(window);
        }
        let mut assembly = Assembly::new(run, scene, from.cell(&scene.sample), law)?;
        assembly.system.steps = from.step;
        let traffic = exchange.traffic();
        let spring = plane_shear.shear.spring;
        if spring.is_none() {
            // A wall that begins to move at its full speed is not to leave the list in a step.
            let displacement = schedule.protocol.fastest() * schedule.step;
            assembly.system.list.at_least(4.0 * displacement);
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
        let floor = plane_shear.floor();
        let mut boundary = MovingBoundary::new(plane_shear.boundary, top, floor);
        if schedule.protocol.has_lateral() {
            let cell = &assembly.system.cell;
            boundary.change_lengths(lateral_lengths::<D>(scene, &from, cell, boundary.top()));
        }
        assembly.system.flat = scene.flat_walls();
        let mass = mass_of(run, scene, &state.grains, body::FREE);
        assembly.replace(boundary.drive(), state.grains, state.contacts)?;
        let system = &mut assembly.system;
        let thickness = plane_shear.thickness_of_walls(&scene.sample);
        let (load, sample) = (&plane_shear.load, &scene.sample);
        let energy = load.pressure * sample.mean_section() * load.mean_overlap(sample);
        let frame = SampleConstants::measure(exchange, system, thickness, energy);
        let scales = plane_shear
            .output
            .temperatures
            .then(|| Scales::measure(exchange, system));
        if plane_shear.output.energy {
            let mut budget = EnergyBudget::new(system.grains().units, scene.sample.radius_max);
            if let Some(mut saved) = from.energy_budget {
                if boundary.top().normal_work {
                    saved = saved.with_varying_load(&from.piston);
                }
                budget.resume(&saved, exchange.rank());
            }
            system.budget = Some(budget);
        }
        let own_columns = OwnColumns::of(scene, plane_shear, schedule.columns);
        run.terminal
            .shearing(scene, plane_shear, &schedule, from.step);
        let format = Format {
            name: part_of(&scene.stages, RunStage::Shear),
            columns: schedule.columns,
            log_columns: &schedule.log_columns,
            attributes: attributes(scene, plane_shear, &schedule),
            height: Some(schedule.height),
            analysed: state.analysed,
            spectra: None,
        };
        let checkpoint = UpToCheckpoint::new(from.step);
        let files = Files::open(run, &mut assembly, format, checkpoint)?;
        Ok(Self {
            scene,
            plane_shear,
            schedule,
            assembly,
            boundary,
            frame,
            scales,
            own_columns,
            mass,
            files,
            step: from.step,
            first: from.step,
            before: from.before,
            left_in: from.left_in,
            origin: from.origin,
            started: Instant::now(),
            traffic,
            latest: None,
            ends: from.ends,
            checks: from.checks,
        })
    }

    /// Closes the files; a shear that is done is marked as finished.
    pub fn finish(mut self, run: &Run<'_>, outcome: Result<Outcome>) -> Result<Sheared<'a, D>> {
        let exchange = run.exchange;
        let images = self.images();
        let traffic = exchange.traffic().since(&self.traffic);
        let profile = run.options.profile.then(|| {
            let system = &self.assembly.system;
            RankProfile::of(exchange, system, traffic, run.processors)
        });
        let (files, outcome) = self.files.unless_failed(exchange, outcome)?;
        let seconds = exchange.maximum(self.started.elapsed().as_secs_f64());
        let done = f64::from(self.scene.sample.grains) * (self.step - self.first) as f64;
        let rate = done / seconds / exchange.size() as f64;
        let mut more = self.boundary.top().state().to_vec();
        more.extend(images.into_iter().flatten());
        if let Some(lengths) = self.boundary.lateral() {
            more.extend(lengths.state.numbers());
        }
        let digest = (self.assembly).digest(bytemuck::cast_slice(&more), self.step);
        let mut attributes = vec![
            ("digest", Attribute::from(digest.clone())),
            ("speed", rate.into()),
            ("rank_map", self.assembly.system.slabs.cuts.clone().into()),
        ];
        if self.schedule.has_conditions() {
            let parts = self.schedule.protocol.segments().iter();
            let begins: Vec<f64> = parts.map(|part| part.first as f64).collect();
            attributes.push(("part_begins", begins.into()));
        }
        files.finish(exchange, outcome, &attributes)?;
        let system = &mut self.assembly.system;
        let ending = Ending {
            speed: done / seconds,
            traffic,
            digest: &digest,
            out: &run.options.out,
        };
        run.terminal.end(exchange, system, &ending);
        if let Some(profile) = profile {
            run.terminal.say(profile.table(exchange));
        }
        Ok(Sheared {
            assembly: self.assembly,
            steps: self.step,
            outcome,
        })
    }

    /// Ends the run if a free grain has passed a wall, unless such grains are removed. Collective.
    fn check_between(&self, exchange: &dyn Exchange) -> Result<()> {
        match self.boundary.heights() {
            Some(planes) if !self.plane_shear.removes => {
                observe::check_between(exchange, &self.assembly.system, planes)
            }
            _ => Ok(()),
        }
    }

    /// Removes the free grains that have passed a wall. Before a step, whose number alone decides
    /// when, so that output does not. Collective.
    fn remove_beyond(&mut self, run: &Run<'_>) {
        let Some(planes) = self.boundary.heights() else {
            return;
        };
        let system = &mut self.assembly.system;
        let Some(message) = observe::remove_beyond(run.exchange, system, planes) else {
            return;
        };
        self.frame.count(run.exchange, system);
        if let Some(scales) = &mut self.scales {
            *scales = Scales::measure(run.exchange, system);
        }
        self.mass = mass_of(run, self.scene, &system.grain_states(), body::FREE);
        run.terminal.warn(format!("{message}; removed"));
    }

    /// Number of steps that may be taken at once: without output, checkpoints and checks between
    /// them.
    fn steps_without_output(&self, run: &Run<'_>) -> u64 {
        let most = self.assembly.system.most_at_once();
        // Before a part begins, the last step does not say how fast its walls are.
        if most == 1 || self.begins_part(self.step) || self.may_lose_top() {
            return 1;
        }
        let before_stop = match (run.options.stop_at, self.count()) {
            (Some(last), Some(next)) => last.saturating_sub(next),
            _ => u64::MAX,
        };
        let next = (1..most).find(|steps| self.ends_sweep(self.step + steps));
        next.unwrap_or(most).min(before_stop).max(1)
    }

    /// Whether a part of the protocol begins after so many steps.
    fn begins_part(&self, step: u64) -> bool {
        self.schedule.protocol.segment(step).first == step
    }

    /// Whether the state after so many steps is measured.
    fn is_measured(&self, step: u64) -> bool {
        self.schedule.due(step).any() || self.schedule.check_due(step)
    }

    /// Whether something is due after so many steps, or measured in the next one.
    fn ends_sweep(&self, step: u64) -> bool {
        let schedule = &self.schedule;
        step >= schedule.steps()
            || self.begins_part(step)
            || self.is_measured(step + 1)
            || schedule.checkpoint_due(step)
            || schedule.progress_due(step)
            || step.is_multiple_of(CHECKPOINT_INTERVAL)
    }

    /// Whether the top wall may leave the sample within some steps.
    fn may_lose_top(&self) -> bool {
        let motion = self.boundary.top();
        let piston = &motion.piston;
        let rise = 0.5 * piston.velocity * piston.velocity * piston.mass / piston.load;
        let layer = piston.height - self.frame.walls - motion.bottom_displacement()[1];
        let near = 0.1 * self.scene.sample.mean_diameter;
        self.boundary.kind().walls() == 2 && (rise > near || layer < near)
    }

    /// Ends the run if the top wall has left the sample: nothing touches it, and it flies on by
    /// more than half a mean diameter, or it has come down to the bottom. A top that moves at an
    /// imposed velocity or by a servo does not fly, and a vibrating bottom may throw it on purpose.
    fn check_top(&self) -> Result<()> {
        let motion = self.boundary.top();
        if self.boundary.kind().walls() < 2 {
            return Ok(());
        }
        let layer = motion.piston.height - self.frame.walls - motion.bottom_displacement()[1];
        if layer <= 0.0 {
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
            || protocol.has_bottom_normal()
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

    /// Ends the present part if one of its conditions holds. The next step is then its last one, so
    /// that the walls enter the next part as they always do.
    fn check_part(&mut self, run: &Run<'_>, row: &SeriesRow) {
        let (part, condition) = self.schedule.condition(self.step);
        let Some(condition) = condition else {
            return;
        };
        let top = TopState {
            stress_ratio: row.stress_ratio,
            slip: row.slip,
            slip_rate: row.slip_rate,
        };
        let of_part = self.checks.as_mut().filter(|checks| checks.part == part);
        let Some(checks) = of_part else {
            self.checks = Some(Checks::begin(part, &top));
            return;
        };
        let Some(reason) = checks.check(condition, &top) else {
            return;
        };
        let segment = self.schedule.protocol.segments()[part];
        let steps = self.step + 1 - segment.first;
        if steps >= segment.steps {
            return;
        }
        self.schedule.end_part(part, steps);
        self.boundary.end_segment(part, steps);
        self.ends.push(PartEnd { part, steps });
        run.terminal.say(format!(
            "shear: part {} ends after step {}: {reason}",
            part + 1,
            self.step + 1
        ));
    }

    /// Measures a row of the time series: its first columns, and all values. Collective.
    fn measure(&mut self, exchange: &dyn Parallel) -> (SeriesRow, Vec<f64>) {
        let boundary = &self.boundary;
        let system = &mut self.assembly.system;
        let flow = if boundary.kind().has_top() {
            None
        } else {
            Some(observe::flow(
                exchange,
                system,
                &self.frame,
                self.mass,
                boundary,
            ))
        };
        let samples = &self.assembly.samples;
        let row = observe::series(
            exchange,
            self.assembly.law,
            system,
            samples,
            &self.frame,
            &RowInput {
                boundary,
                flow,
                height: self.schedule.height,
            },
        );
        let mut values = row.columns().to_vec();
        if self.schedule.further.imposed {
            values.extend(observe::imposed(self.boundary.top()).columns());
        }
        if self.schedule.protocol.has_bottom_along() {
            values.extend(observe::bottom_along(self.boundary.top()).columns());
        }
        if boundary.kind().is_periodic() {
            let row = observe::stress(exchange, system, samples, self.mass);
            values.extend(row.columns());
        }
        if let Some(lengths) = boundary.lateral() {
            values.extend(observe::lateral(lengths).columns());
        }
        if let Some(flow) = flow {
            values.extend(flow.row().columns());
        }
        if let Some(scales) = &self.scales {
            let row = fluctuations::temperatures(exchange, system, scales, &self.frame);
            values.extend(row.columns());
        }
        (row, values)
    }

    /// Appends the columns that the scene declares to a row of the time series. Collective.
    fn append_own(
        &mut self,
        exchange: &dyn Parallel,
        time: f64,
        row: &SeriesRow,
        values: &mut Vec<f64>,
    ) {
        let Some(own) = &self.own_columns else { return };
        let is_periodic = self.boundary.kind().is_periodic();
        let mut lengths = [1.0; 3];
        lengths[..D::UP].copy_from_slice(&self.assembly.system.cell.periods[..D::UP]);
        lengths[D::UP] = row.wall_height;
        let view = SampleView {
            dimension: self.scene.dimension,
            time,
            lengths,
            bottom: if is_periodic {
                0.0
            } else {
                self.boundary.bottom(own.bottom_thickness())
            },
            is_periodic,
        };
        own.append(exchange, &mut self.assembly, view, values);
    }

    /// The Lees–Edwards offset (m) and the velocity (m/s) of images.
    fn images(&self) -> Option<[f64; 2]> {
        let sheared = self.assembly.system.cell.sheared;
        sheared.map(|sheared| [sheared.offset, sheared.velocity])
    }
}

impl<'a, D: Dimension> Stage<'a, D> for ShearStage<'a, D> {
    fn name(&self) -> &'static str {
        RunStage::Shear.name()
    }

    fn completed(&self) -> u64 {
        self.step
    }

    fn count(&self) -> Option<u64> {
        Some(self.before + self.step + 1)
    }

    fn files(&mut self) -> Option<&mut Files> {
        Some(&mut self.files)
    }

    fn is_done(&self) -> bool {
        self.step >= self.schedule.steps()
    }

    fn keeps_start(&self) -> bool {
        true
    }

    fn begin(&mut self) -> Result<()> {
        // Dampers see other velocities than in the step that was exported, and would cut springs at
        // a limit anew.
        let has_histories = self.left_in.is_none()
            && (self.scene.packing()).is_some_and(|packing| packing.contacts.is_some());
        let springs = has_histories.then(|| self.assembly.system.contacts.springs());
        self.assembly.initial_forces(self.boundary.drive(), true)?;
        if let Some(springs) = springs {
            let Assembly { system, law, .. } = &mut self.assembly;
            let is_planar = D::SPINS == 1;
            system.contacts.put_springs(springs, *law, is_planar);
        }
        Ok(())
    }

    fn step(&mut self, run: &mut Run<'_>, stop: bool) -> Result<bool> {
        if self.plane_shear.removes && self.step.is_multiple_of(REMOVAL_STEPS) {
            self.remove_beyond(run);
        }
        let sampled = self.is_measured(self.step + 1);
        let stop = stop || run.asked_to_stop();
        let most = self.steps_without_output(run);
        let drive = self.boundary.drive();
        let stop = if sampled {
            let stop = self.assembly.advance(drive, true, stop)?;
            self.step += 1;
            stop
        } else {
            let advanced = self.assembly.sweep(drive, most, stop)?;
            self.step += advanced.steps;
            advanced.stop
        };
        self.check_top()?;
        Ok(stop)
    }

    fn record(&mut self, run: &mut Run<'_>) -> Result<()> {
        let (exchange, step) = (run.exchange, self.step);
        let due = self.schedule.due(step);
        let at = TimePoint {
            step,
            time: self.origin.time(step, self.schedule.step),
        };
        if due.any() || self.is_done() {
            self.check_between(exchange)?;
        }
        let is_checked = self.schedule.check_due(step);
        if due.row || is_checked {
            let (row, mut values) = self.measure(exchange);
            if due.row {
                self.latest = Some(row);
                self.append_own(exchange, at.time, &row, &mut values);
                self.files.row(exchange, at, &values)?;
            }
            if is_checked {
                self.check_part(run, &row);
            }
        }
        let height = self.boundary.top().piston.height - self.frame.walls;
        self.files.frame(&mut self.assembly, due, at, height)?;
        self.assembly.system.clock.end(StepPhase::Output);
        Ok(())
    }

    fn save_due(&self) -> Save {
        let scheduled = self.is_done() || self.schedule.checkpoint_due(self.step);
        Save::after(self.step, scheduled)
    }

    fn check(&self, run: &Run<'_>) -> Result<()> {
        self.check_between(run.exchange)
    }

    fn state(&mut self, run: &mut Run<'_>) -> Result<Checkpoint> {
        self.files.write_scalars(run.exchange)?;
        let top = self.boundary.top();
        let budget = self.assembly.system.budget.as_ref();
        let header = ShearHeader {
            step: self.step,
            origin: self.origin,
            before: self.before,
            left_in: self.left_in,
            piston: top.piston,
            images: self.images(),
            lateral: self.boundary.lateral().map(|lengths| lengths.state.clone()),
            slider: (self.step > 0).then_some(top.slider.state),
            height: self.schedule.height,
            ends: self.ends.clone(),
            checks: self.checks,
            written: self.files.written(),
            energy_budget: budget.map(|budget| budget.save(run.exchange)),
        };
        Ok(Checkpoint {
            header: Header::Shear(header),
            state: Snapshot {
                analysed: self.files.last_analysed(),
                ..self.assembly.owned()
            },
            keep: self.scene.keep_checkpoints,
        })
    }

    fn progress(&self) -> StageProgress {
        let row = self.latest;
        // The strain under a force is not known in advance.
        let strain = match (self.schedule.protocol.has_force(), row) {
            _ if !self.plane_shear.boundary.has_top() => None,
            (true, Some(row)) => Some(row.strain),
            _ => Some(self.schedule.strain(self.step)),
        };
        StageProgress {
            stage: self.name().into(),
            step: self.step,
            steps: Some(self.schedule.steps()),
            strain,
            stress_ratio: row.map(|row| row.stress_ratio),
            solid_fraction: row.map(|row| row.solid_fraction),
            moving: Some(self.scene.sample.grains),
            ..StageProgress::default()
        }
    }

    fn log(&mut self, run: &Run<'_>) {
        self.assembly.system.clock.end(StepPhase::Output);
        if self.schedule.progress_due(self.step) {
            let progress = self.progress();
            let (steps, elapsed) = (self.step - self.first, self.started.elapsed());
            run.terminal.log_shear(&progress, steps, elapsed);
        }
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
    let budget = from.energy_budget.as_ref();
    let was_summed = budget.is_some_and(SavedBudget::has_normal_work);
    top.normal_work |= is_loaded_anew || plane_shear.output.energy && was_summed;
    if let Some(slider) = from.slider {
        top.slider.state = slider;
    }
    top
}

/// The lengths of a cell across its height, as they begin to change or go on.
fn lateral_lengths<D: Dimension>(
    scene: &Scene,
    from: &ShearHeader,
    cell: &Cell,
    top: &Top,
) -> LateralLengths {
    let saved = from.lateral.clone();
    let state = saved.unwrap_or_else(|| LateralState::at_rest::<D>(cell, &top.piston));
    let start = scene.cell().periods;
    LateralLengths::new(state, &start[..D::UP], from.height, top.servo)
}

/// Gives the grains of the walls the velocities with which these begin.
fn set_moving(grains: &mut [GrainState], top: &mut Top, schedule: &Schedule, up: usize) {
    let [top, bottom] = top.begin();
    for g in grains {
        let [along, upwards] = match g.body {
            body::TOP => top,
            body::BOTTOM if schedule.protocol.has_bottom() => bottom,
            _ => continue,
        };
        g.velocity = [along, 0.0, 0.0];
        g.velocity[up] = upwards;
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
