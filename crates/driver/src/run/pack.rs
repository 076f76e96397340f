//! The first stage: the sample is compressed until it is at rest.

use super::{DRAG_RESTING, Moment, Run, Stage, State, in_stage};
use gshear_dem::kernel::PairForce;
use gshear_dem::dimension::Dimension;
use gshear_dem::domain::Accumulator;
use gshear_dem::drive::{Piston, Planes};
use gshear_dem::failure::Failure;
use gshear_dem::observe::{self, Frame};
use crate::record::Written;
use gshear_scene::sample::freeze_walls;
use gshear_scene::schedule::inertial_time;
use gshear_dem::step::{StepRequest, advance, initial_forces};

/// The sample is looked at every so many steps …
const LOOK: u64 = 1000;
/// … and kept in a checkpoint every so many.
const PACK_CHECKPOINT: u64 = 500_000;

impl Run<'_> {
    /// Compresses the sample between smooth planes, which have the law `plane`, until it is at rest, and freezes the walls. `None`
    /// where it was stopped.
    pub(super) fn pack<D: Dimension>(
        &mut self,
        law: &dyn PairForce<D>,
        plane: Box<dyn PairForce<D>>,
        drag: f64,
        state: State,
    ) -> Result<Option<(f64, State)>, Failure> {
        let (exchange, scene) = (self.exchange, self.scene);
        let mut system = self.system::<D>()?;
        system.steps = state.step;
        let mut drive = Planes::new(plane, state.piston, drag);
        let mut step = state.step;
        system.replace(exchange, law, &mut drive, state.grains, state.contacts)?;

        if step == 0 {
            initial_forces(exchange, &mut system, law, &mut drive, None)
                .map_err(|e| in_stage(e, "packing"))?;
        }
        let (sample, load) = (&scene.sample, &scene.load);
        let mean_force = load.pressure * sample.mean_section();
        let unit = mean_force * scene.mean_overlap();
        let resting_drag = DRAG_RESTING / inertial_time(scene);
        let energy = Frame::measure(exchange, &mut system, 0.0, unit);
        let at_rest = scene.pack.tolerance * unit * sample.grains as f64;
        // The energy of a wave goes with the square of its pressure.
        let balance = scene.pack.tolerance.sqrt().max(1e-3);
        loop {
            let request = StepRequest {
                stop: self.asked_to_stop(),
                samples: None,
            };
            let stop = advance(exchange, &mut system, law, &mut drive, request)
                .map_err(|e| in_stage(e, "packing"))?;
            step += 1;
            if step.is_multiple_of(LOOK) {
                let kinetic = observe::kinetic_energy(exchange, &mut system, &energy.energy);
                let mut carried = Accumulator::default();
                drive.load_on(false, &system.fixed, &mut carried);
                let [carried] = system.fixed.total(exchange, [carried]);
                let pressing = drive.piston.load;
                let carried = carried / pressing;
                self.terminal
                    .packing(step, &drive.piston, kinetic / (unit * sample.grains as f64));
                // The bottom feels the load only when the sample is compressed all through.
                if carried > 0.5 {
                    drive.piston.load = (2.0 * pressing).min(load.normal_force);
                    // In inertial times of the load as it is.
                    let part = drive.piston.load / load.normal_force;
                    drive.drag = resting_drag * part.sqrt();
                }
                let loaded = pressing == load.normal_force;
                if loaded && kinetic < at_rest && (carried - 1.0).abs() < balance {
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
                let moment = Moment {
                    stage: Stage::Pack { drag: drive.drag },
                    step,
                    piston: &drive.piston,
                    slider: None,
                    written: Written::default(),
                    analysed: None,
                };
                self.save(&mut system, law, moment)?;
                if stop {
                    self.terminal.stopped(&self.options.out, "packing", step);
                    return Ok(None);
                }
            }
        }

        let mut grains = system.grain_states();
        let planes = [0.0, drive.piston.height];
        freeze_walls(&mut grains, D::UP, planes, sample.mean_diameter);
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
            contacts: system.contact_states(law),
            slider: None,
            written: None,
            analysed: None,
            energy_budget: None,
        };
        Ok(Some((height, state)))
    }
}
