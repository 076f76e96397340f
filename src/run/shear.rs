//! The second stage: the sample is sheared, and what was asked for is written.

use std::time::Instant;

use super::analysis::Analysis;
use super::{Ending, Moment, Run, Stage, State, in_stage};
use crate::clock::Phase;
use crate::contact::ContactLaw;
use crate::domain::Exchange;
use crate::drive::{GrainWalls, Slider};
use crate::failure::Failure;
use crate::kernel::ContactForces;
use crate::ledger::Ledger;
use crate::observe::{self, Frame};
use crate::record::{Recorder, Written};
use crate::schedule::Schedule;
use crate::state::body;
use crate::step::{Wanted, advance, initial_forces};

impl<E: Exchange> Run<'_, E> {
    pub(super) fn shear<C: ContactLaw>(
        &mut self,
        law: &C,
        height: f64,
        state: State,
    ) -> Result<Ending, Failure> {
        let (exchange, scene, options) = (self.exchange, self.scene, self.options);
        let mut schedule = Schedule::new(scene, height);
        if let Some(window) = options.replay {
            schedule = schedule.of_window(window);
        }
        let mut system = self.system::<C::Space>()?;
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
        let frame = Frame::measure(exchange, &system, 2.0 * thickness, energy);
        if scene.output.energy {
            let mut ledger = Ledger::new(system.grains.units, scene.sample.radius_max);
            if let Some(kept) = &state.ledger {
                ledger.resume(kept, exchange.rank());
            }
            system.ledger = Some(ledger);
        }
        self.terminal.shearing(scene, &schedule, first);
        let written = state.written.filter(|_| options.replay.is_none());
        let mut recorder = Recorder::open(exchange, scene, &schedule, &system, options, written)?;
        // Rows of new files begin with a frame that has none before it.
        let before = state.analysed.filter(|_| recorder.goes_on);
        let mut analysis = scene
            .analysis
            .scalars
            .then(|| Analysis::new(exchange, &system, before));
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
            self.save::<C>(&system, moment)?;
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
                let saved = schedule.checkpoint_due(next) || next == schedule.total;
                let wanted = Wanted {
                    samples: sampled.then_some(&mut samples),
                    stop,
                    unseen: !sampled && !saved,
                };
                let stop = advance(exchange, &mut system, law, &mut walls, wanted)
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
                    &schedule,
                );
                recorder.series(exchange, step, time, &row)?;
                self.terminal.latest(&row);
            }
            if frames || analysed {
                let (grains, contacts) = observe::frame::<C>(&system, &samples);
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
                self.save::<C>(&system, moment)?;
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
        let digest = observe::digest::<C, E>(exchange, &system, bytemuck::cast_slice(&walls), step);
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
