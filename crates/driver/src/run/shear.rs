//! The second stage: the sample is sheared, and what was asked for is written.

use std::time::Instant;

use super::analysis::Analysis;
use super::{Ending, Moment, Run, Stage, State, in_stage};
use gshear_dem::clock::Phase;
use gshear_dem::dimension::Dimension;
use gshear_dem::kernel::PairForce;
use gshear_dem::drive::{GrainWalls, Slider};
use gshear_dem::failure::Failure;
use gshear_dem::kernel::ContactForces;
use gshear_dem::budget::EnergyBudget;
use gshear_dem::observe::{self, Frame};
use crate::record::{Recorder, Written};
use gshear_scene::schedule::Schedule;
use gshear_dem::state::body;
use gshear_dem::step::{StepRequest, advance, initial_forces};

impl Run<'_> {
    pub(super) fn shear<D: Dimension>(
        &mut self,
        law: &dyn PairForce<D>,
        height: f64,
        state: State,
    ) -> Result<Ending, Failure> {
        let (exchange, scene, options) = (self.exchange, self.scene, self.options);
        let mut schedule = Schedule::new(scene, height);
        if let Some(window) = options.replay {
            schedule = schedule.of_window(window);
        }
        let mut system = self.system::<D>()?;
        system.steps = state.step;
        let spring = scene.shear.spring.map(|spring| spring.stiffness);
        let mut walls = GrainWalls {
            piston: state.piston,
            slider: Slider::new(schedule.protocol.clone(), spring),
            along: spring.is_some() || scene.output.energy,
            top: Vec::new(),
        };
        if let Some(slider) = state.slider {
            walls.slider.state = slider;
        }
        let first = state.step;
        let mut grains = state.grains;
        if first == 0 {
            for g in grains.iter_mut().filter(|g| g.body == body::TOP) {
                g.velocity = [walls.slider.state.velocity, 0.0, 0.0];
            }
        }
        system.replace(exchange, law, &mut walls, grains, state.contacts)?;
        let thickness = scene.sample.mean_diameter;
        let energy = scene.load.pressure * scene.sample.mean_section() * scene.mean_overlap();
        let frame = Frame::measure(exchange, &mut system, 2.0 * thickness, energy);
        if scene.output.energy {
            let mut budget = EnergyBudget::new(system.grains().units, scene.sample.radius_max);
            if let Some(saved) = &state.energy_budget {
                budget.resume(saved, exchange.rank());
            }
            system.budget = Some(budget);
        }
        self.terminal.shearing(scene, &schedule, first);
        let written = state.written.filter(|_| options.replay.is_none());
        let mut recorder = Recorder::open(exchange, scene, &schedule, &mut system, options, written)?;
        // Rows of new files begin with a frame that has none before it.
        let before = state.analysed.filter(|_| recorder.goes_on);
        let mut analysis = scene
            .analysis
            .scalars
            .then(|| Analysis::new(exchange, &mut system, before));
        let mut samples = ContactForces::default();
        if first == 0 && scene.output.keep_checkpoints && options.replay.is_none() {
            // As the sample was packed, so that a window before the first checkpoint can be replayed without packing again.
            let moment = Moment {
                stage: Stage::Shear { height },
                step: 0,
                piston: &walls.piston,
                slider: None,
                written: Written::default(),
                analysed: None,
            };
            self.save(&mut system, law, moment)?;
        }
        let mut step = first;
        let clock_start = Instant::now();
        let mut stopped = false;
        // The state before the first step is looked at as well.
        let mut begins = first == 0;
        while begins || (step < schedule.total && !stopped) {
            let next = if begins { 0 } else { step + 1 };
            let (series, frames) = (schedule.series_due(next), schedule.frame_due(next));
            let analysed = schedule.analysis_due(next);
            if begins {
                let samples = Some(&mut samples);
                initial_forces(exchange, &mut system, law, &mut walls, samples)
                    .map_err(|e| in_stage(e, "shear"))?;
                begins = false;
            } else {
                let stop = self.asked_to_stop() || options.stop_at == Some(next);
                let sampled = series || frames || analysed;
                let request = StepRequest {
                    samples: sampled.then_some(&mut samples),
                    stop,
                };
                let stop = advance(exchange, &mut system, law, &mut walls, request)
                    .map_err(|e| in_stage(e, "shear"))?;
                step = next;
                stopped = stop && step < schedule.total;
            }
            let time = schedule.time(step);
            if series {
                let row = observe::series(
                    exchange,
                    law,
                    &mut system,
                    &samples,
                    &walls,
                    &frame,
                    schedule.height,
                );
                recorder.series(exchange, step, time, &row)?;
                self.terminal.latest(&row);
            }
            if frames || analysed {
                let (grains, contacts) = observe::frame(&mut system, law, &samples);
                if frames {
                    recorder.frame(exchange, step, time, &grains, &contacts)?;
                }
                if let (Some(analysis), true) = (&mut analysis, analysed) {
                    let rows = analysis.frame(exchange, step, &grains, &contacts);
                    recorder.scalars(exchange, &rows)?;
                }
            }
            let ends = stopped || step == schedule.total;
            if schedule.checkpoint_due(step) || (ends && options.replay.is_none()) {
                if let Some(analysis) = &mut analysis {
                    let rows = analysis.flush(exchange);
                    recorder.scalars(exchange, &rows)?;
                }
                let moment = Moment {
                    stage: Stage::Shear { height },
                    step,
                    piston: &walls.piston,
                    slider: Some(&walls.slider.state),
                    written: recorder.flush(exchange)?,
                    analysed: analysis.as_ref().and_then(Analysis::last),
                };
                self.save(&mut system, law, moment)?;
            }
            system.clock.end(Phase::Output);
            if step > first && schedule.progress_due(step) {
                let grains = scene.sample.grains;
                let elapsed = clock_start.elapsed();
                self.terminal
                    .progress(&schedule, grains, first, step, elapsed);
            }
        }
        let seconds = exchange.maximum(clock_start.elapsed().as_secs_f64());
        let rate =
            scene.sample.grains as f64 * (step - first) as f64 / seconds / exchange.size() as f64;
        let walls = walls.state();
        let digest = observe::digest(exchange, &mut system, law, bytemuck::cast_slice(&walls), step);
        recorder.finish(exchange, &mut system, rate, &digest, !stopped)?;
        let phases = system.clock.table(exchange);
        self.terminal
            .end(exchange, &mut system, &phases, rate, &digest, &options.out);
        if stopped {
            self.terminal.stopped(&options.out, "shear", step);
            return Ok(Ending::Stopped);
        }
        Ok(Ending::Done)
    }
}
