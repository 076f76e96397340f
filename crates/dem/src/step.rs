//! The time step: read this first.
//!
//! Velocity Verlet: when the forces are computed, positions are at t+Δt and velocities at t+½Δt.
//! Damping forces use the full-step velocity predicted from the last acceleration, so the scheme is
//! of second order with damping, too (docs/explanation/scheme.md).
//!
//! A step goes through the bands of the grains ([`Bands`](crate::state::Bands)): a band moves, then
//! the forces of its pairs are computed, which are complete with those of the next band. So a
//! second step can follow a band behind the first one, and a third one behind that: a sweep of
//! several steps, in which a band is in the cache for all of them. Small samples have one band.

use std::time::Instant;

use bytemuck::Zeroable;

use crate::budget::EnergyBudget;
use crate::clock::StepPhase;
use crate::dimension::Dimension;
use crate::domain::{Accumulator, Exchange, LIMBS};
use crate::drive::{Drive, Felt, FlowSum, MomentumFlow, WallForces, WallSteps, WallSums};
use crate::failure::{Outside, Result};
use crate::kernel::{ContactForces, Counting, PairForce, PassInput, PassOutcome};
use crate::motion::{GrainMotion, Moved, greater_or_nan, slow_down, weigh};
use crate::state::{Grains, Sheared};
use crate::system::System;
use crate::threads::{BandForces, MovedGrains, OwnedPart};
use crate::under_way::StepUnderWay;

/// Options of a step, or of several.
#[derive(Debug)]
pub struct StepRequest<'a> {
    /// Receives the contact forces.
    pub samples: Option<&'a mut ContactForces>,
    /// Whether this rank was asked to stop.
    pub stop: bool,
    /// Number of steps that may be taken at once; with samples it is one.
    pub most: u64,
}

impl Default for StepRequest<'_> {
    /// One step.
    fn default() -> Self {
        Self {
            samples: None,
            stop: false,
            most: 1,
        }
    }
}

impl<'a> StepRequest<'a> {
    /// A step that records the contact forces.
    pub fn sampled(samples: &'a mut ContactForces) -> Self {
        Self {
            samples: Some(samples),
            ..Self::default()
        }
    }
}

/// What was done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Advanced {
    /// Number of steps.
    pub steps: u64,
    /// Whether some rank was asked to stop.
    pub stop: bool,
}

/// Advances everything by Δt, or by several steps. Collective.
///
/// The second kick is deferred to the first kick of the next step, in one pass over the grains;
/// [`System::grains`] gives it before.
///
/// # Errors
/// An overlap outside the law, or a number that is not finite.
pub fn advance<D: Dimension>(
    exchange: &dyn Exchange,
    system: &mut System<D>,
    law: &dyn PairForce<D>,
    drive: &mut dyn Drive<D>,
    request: StepRequest<'_>,
) -> Result<Advanced> {
    system.steps += 1;
    system.clock.start();
    // Not at the end of the last step, because its samples are indexed by the blocks of the old
    // list.
    if system.list.due {
        system.rebuild(exchange, law, drive)?;
        system.clock.end(StepPhase::Rebuild);
    }
    let count = steps_at_once(system, drive, &request);
    let mut under_way = std::mem::take(&mut system.under_way);
    under_way.clear();
    // Those of the last step: the walls have others now.
    system.wall_velocities = None;
    let mut sweep = Sweep {
        second_kick_deferred: std::mem::take(&mut system.second_kick_deferred),
        exchange,
        system,
        law,
        drive,
        request,
        count,
        steps: under_way,
        drifts: 0,
        rebuild: false,
        stop: false,
    };
    let bands = sweep.system.bands.count();
    for position in 0..bands + count - 1 {
        for step in 0..count {
            if let Some(band) = position.checked_sub(step)
                && band < bands
            {
                sweep.band_of_step(step, band)?;
            }
        }
    }
    let Sweep {
        steps,
        stop,
        rebuild,
        ..
    } = sweep;
    system.under_way = steps;
    system.list.due = rebuild;
    system.second_kick_deferred = true;
    Ok(Advanced {
        steps: count as u64,
        stop,
    })
}

/// Number of steps of a sweep: one where each step needs a sum over all grains before the next, is
/// measured, or moves what all bands have in common.
fn steps_at_once<D: Dimension>(
    system: &System<D>,
    drive: &dyn Drive<D>,
    request: &StepRequest<'_>,
) -> usize {
    let is_alone = request.most == 1
        || system.bands.count() == 1
        || request.samples.is_some()
        || system.cell.sheared.is_some()
        || drive.drag().is_some()
        || drive.planes().is_some()
        || drive.needs_stress(false);
    if is_alone {
        return 1;
    }
    let most = system.most_at_once().min(request.most);
    most.min(system.list.lasting) as usize
}

/// Steps that follow each other through the bands.
struct Sweep<'a, D: Dimension> {
    exchange: &'a dyn Exchange,
    system: &'a mut System<D>,
    law: &'a dyn PairForce<D>,
    drive: &'a mut dyn Drive<D>,
    request: StepRequest<'a>,
    /// Number of steps.
    count: usize,
    /// Whether the first step begins with the second kick of the one before the sweep.
    second_kick_deferred: bool,
    /// The steps that have begun.
    steps: Vec<StepUnderWay>,
    /// Number of steps in which the walls have drifted.
    drifts: usize,
    /// Whether the list must be rebuilt after the sweep.
    rebuild: bool,
    /// Whether some rank was asked to stop.
    stop: bool,
}

impl<D: Dimension> Sweep<'_, D> {
    /// Moves a band, and computes the forces of its pairs.
    fn band_of_step(&mut self, step: usize, band: usize) -> Result<()> {
        // Skips the steps after one that failed; with several ranks the others wait for their
        // messages.
        let mut before = self.steps[..step.min(self.steps.len())].iter();
        if self.exchange.size() == 1 && before.any(|step| step.failure.is_some()) {
            return Ok(());
        }
        if band == 0 {
            self.begin(step);
        }
        let is_last = band + 1 == self.system.bands.count();
        if is_last {
            self.move_walls(step);
        }
        self.move_band(step, band);
        if is_last {
            self.end_motion(step);
        }
        self.system.clock.end(StepPhase::Motion);
        self.add_forces(step, band);
        if band > 0 {
            self.complete(step, band - 1);
        }
        if is_last {
            self.complete(step, band);
            self.end(step)?;
        } else {
            self.system.clock.end(StepPhase::Walls);
        }
        Ok(())
    }

    /// Moves the cell.
    fn begin(&mut self, step: usize) {
        let Self { system, drive, .. } = self;
        let time_step = system.step;
        drive.drift_cell(time_step, &mut system.cell, &system.grains);
        if let Some(Sheared { half_velocity, .. }) = system.cell.sheared
            && half_velocity != 0.0
        {
            system.shear(time_step * half_velocity);
        }
        let is_stressed = drive.needs_stress(self.request.samples.is_some());
        let motion = GrainMotion {
            isa: system.isa,
            units: system.grains.units,
            gravity: system.gravity,
            step: time_step,
            cell: system.cell,
            streaming: drive.streaming(),
            is_stressed,
            // With a single band, the walls drift before any grain moves.
            walls: match system.bands.count() {
                1 => None,
                _ => drive.bottom((step - self.drifts) as u64),
            },
        };
        drive.predict_cell(time_step, &mut system.cell);
        let samples = self.request.samples.as_deref_mut();
        let input = begin_forces(system, time_step, is_stressed, samples);
        self.steps.push(StepUnderWay {
            motion,
            input,
            fastest: 0.0,
            way: 0.0,
            flow: FlowSum::default(),
            outcome: PassOutcome::default(),
            within_shares: None,
            load: WallSums::default(),
            failure: None,
        });
    }

    /// Moves the walls, and the feet on them.
    fn move_walls(&mut self, step: usize) {
        let Self { system, drive, .. } = self;
        let motion = &mut self.steps[step].motion;
        motion.walls = drive.drift(system.step);
        self.drifts += 1;
        let mut walls = drive.wall_grains();
        let feet = walls.split_off(system.grains.owned);
        motion.give_first::<D>(feet, 0, &mut system.grains.record);
        motion.give_predicted::<D>(feet, 0, &mut system.grains.record);
    }

    /// Moves the grains of a band, which then have no force but their weight. The forces of the
    /// pairs within shares follow at once where nothing is sent in between.
    fn move_band(&mut self, step: usize, band: usize) {
        let Self { system, drive, .. } = self;
        let under_way = &mut self.steps[step];
        let motion = under_way.motion;
        let second_kick_deferred = self.second_kick_deferred || step > 0;
        let System {
            bands,
            pool,
            grains,
            contacts,
            list,
            clock,
            ..
        } = &mut **system;
        let mut fastest = drive.speed();
        let (time_step, cell, slowest) = (motion.step, motion.cell, fastest);
        let mut ended = None;
        let note = |moved: Moved| {
            fastest = greater_or_nan(fastest, moved.fastest);
            under_way.flow.merge(moved.flow);
            ended = ended.or(moved.ended);
        };
        let owned = bands.grains(band);
        let walls = drive.wall_grains().within(owned.clone());
        if self.exchange.size() == 1 && bands.count() == 1 {
            let forces = BandForces {
                law: self.law,
                band,
                input: under_way.input,
            };
            let moved = MovedGrains {
                grains,
                walls,
                contacts,
                samples: self.request.samples.as_deref_mut(),
            };
            let work = |part: OwnedPart<'_, D>| {
                let mut moved = motion.advance(second_kick_deferred, part);
                moved.ended = Some(Instant::now());
                let fastest = greater_or_nan(slowest, moved.fastest);
                let way = list.way(fastest, time_step, &cell);
                (moved, list.travelled_after(band, way))
            };
            let outcome = pool.move_and_add_forces(&forces, moved, work, note);
            under_way.within_shares = Some(outcome);
            if let Some(ended) = ended {
                clock.end_within_region(StepPhase::Motion, ended);
            }
            clock.end(StepPhase::Contacts);
        } else {
            let work = |part: OwnedPart<'_, D>| motion.advance(second_kick_deferred, part);
            pool.over_owned(grains, owned, walls, work, note);
        }
        let way = list.way(fastest, time_step, &cell);
        // A pair may be with a grain of the band before.
        list.travel(band, greater_or_nan(way, under_way.way));
        under_way.way = way;
        under_way.fastest = greater_or_nan(under_way.fastest, fastest);
        if fastest.is_nan() {
            under_way.fail(Outside::Number, |outside| system.describe(outside));
        }
    }

    /// Ends the motion of all grains.
    fn end_motion(&mut self, step: usize) {
        let Self { system, drive, .. } = self;
        let under_way = &mut self.steps[step];
        let motion = &under_way.motion;
        let planes = drive.planes();
        if let Some(planes) = planes {
            system.grains.put_feet(planes);
        }
        let way = system
            .list
            .way(under_way.fastest, motion.step, &motion.cell);
        let looks = step + 1 == self.count;
        self.rebuild |= system
            .list
            .moved(way, motion, &system.grains, planes, looks);
        let unsound = system.list.unsound.then_some(Outside::Number);
        let PassInput { isa, cell, .. } = under_way.input;
        let at_plane = drive.forces(isa, cell, motion.step, &mut system.grains);
        for outside in unsound.into_iter().chain(at_plane.map(Outside::Plane)) {
            under_way.fail(outside, |outside| system.describe(outside));
        }
    }

    /// Adds the forces of the pairs of a band.
    fn add_forces(&mut self, step: usize, band: usize) {
        let Self { system, .. } = self;
        let under_way = &mut self.steps[step];
        let input = PassInput {
            travelled: Some(system.list.travelled[band]),
            // The first step brings the band into the cache for those that follow.
            is_cold: under_way.input.is_cold && step == 0,
            ..under_way.input
        };
        let samples = self.request.samples.as_deref_mut();
        let forces = BandForces {
            law: self.law,
            band,
            input,
        };
        let within_shares = under_way.within_shares.take();
        let outcome = forces_of_band(self.exchange, system, &forces, samples, within_shares);
        under_way.outcome = under_way.outcome.merge(outcome);
        for outside in outcome.failures() {
            under_way.fail(outside, |outside| system.describe(outside));
        }
    }

    /// Completes the forces of contacts on a band, and sums those on grains of walls.
    fn complete(&mut self, step: usize, band: usize) {
        let Self { system, drive, .. } = self;
        let load = &mut self.steps[step].load;
        let grains = system.bands.grains(band);
        let mut walls = drive.wall_grains();
        // The feet are with the last band.
        if band + 1 < system.bands.count() {
            walls = walls.within(grains.clone());
        } else {
            walls = walls.split_off(grains.start);
        }
        let System {
            pool,
            grains,
            fixed,
            ..
        } = &mut **system;
        pool.complete(
            &mut grains.force,
            walls,
            load,
            |first, force, walls, sums| {
                drive.load_on_grains(first, force, fixed, walls, sums);
            },
        );
    }

    /// Sums over all grains, and gives the walls their second kick.
    fn end(&mut self, step: usize) -> Result<()> {
        let Self { system, drive, .. } = self;
        let under_way = &mut self.steps[step];
        let motion = &under_way.motion;
        system.count(&under_way.outcome, motion.is_stressed);
        system.add_flow(under_way.flow);
        self.rebuild |= system.list.forced(system.steps);
        let [some, many] = LASTING.map(|steps| system.list.lasts(system.steps + 1, steps));
        let flags = [self.rebuild, self.request.stop, !some, !many];
        let load = std::mem::take(&mut under_way.load);
        let failure = under_way.failure.take().map(|(_, message)| message);
        let (load, [rebuild, stop, not_for_some, not_for_many]) = sum_over_ranks(
            self.exchange,
            system,
            *drive,
            load,
            failure,
            flags,
            |grains| {
                // Its forces are no whole multiples of a unit: after all others.
                if let Some(drag) = drive.drag() {
                    slow_down(grains, drag);
                }
            },
        )?;
        self.rebuild = rebuild;
        self.stop |= stop;
        system.list.lasting = match (not_for_some, not_for_many) {
            (true, _) => 1,
            (false, true) => LASTING[0],
            (false, false) => LASTING[1],
        };
        if let Some(budget) = &mut system.budget {
            budget.push(&load, drive.moved());
        }
        system.clock.end(StepPhase::Walls);
        system.wall_velocities = drive.kick(motion.step, load);
        system.clock.end(StepPhase::Motion);
        system.clock.count_step();
        if step + 1 < self.count {
            system.steps += 1;
        }
        Ok(())
    }
}

/// Computes the forces and the wall's acceleration at the start of a stage, without moving anything
/// or advancing histories.
///
/// # Errors
/// An overlap outside the law, or a number that is not finite.
pub fn initial_forces<D: Dimension>(
    exchange: &dyn Exchange,
    system: &mut System<D>,
    law: &dyn PairForce<D>,
    drive: &mut dyn Drive<D>,
    samples: Option<&mut ContactForces>,
) -> Result<()> {
    // The time until now belongs to the first list.
    system.clock.end(StepPhase::Rebuild);
    let outside = forces(exchange, system, law, drive, 0.0, samples);
    system.add_flow(MomentumFlow::over(&system.cell, &system.grains));
    let mut load = WallSums::default();
    let (force, fixed) = (&system.grains.force, &system.fixed);
    drive.load_on_grains(0, force, fixed, drive.wall_grains(), &mut load);
    let failure = outside.map(|outside| system.describe(outside));
    let (load, []) = sum_over_ranks(exchange, system, drive, load, failure, [], |_| ())?;
    if let Some(budget) = &mut system.budget {
        let at_rest = WallSteps {
            along: 0.0,
            normal: drive.moved().normal.map(|_| [0.0; 2]),
        };
        budget.push(&load, at_rest);
    }
    drive.start(load);
    Ok(())
}

/// Size of the records (bytes) beyond which passes prefetch: with their contacts, six times as
/// much, they fill a last-level cache. Prefetching makes larger packings a third faster, and costs
/// some 5 % where the cache holds all (docs/lab/speed.md).
const CACHED: usize = 3 << 20;

/// In every step each rank says whether its list lasts for these numbers of steps.
const LASTING: [u64; 2] = [4, 16];

/// Room for four flags.
const FORCES_AT: usize = 5;
const FORCE: usize = LIMBS + 1;
const MESSAGE: usize = FORCES_AT + 3 * FORCE;
/// Size of the message that the ranks sum in every step (bytes), without the force on the bottom.
pub const MESSAGE_BYTES: usize = (MESSAGE - FORCE) * size_of::<i64>();

/// Sums over the ranks in one message: whether something failed, K flags that are set if they are
/// set on some rank, and the forces on the walls, which are `load` and what the drive adds. That on
/// the bottom is last, and left out if the drive does not ask for it. Runs `meanwhile` during the
/// sum.
fn sum_over_ranks<D: Dimension, const K: usize>(
    exchange: &dyn Exchange,
    system: &mut System<D>,
    drive: &dyn Drive<D>,
    mut load: WallSums,
    failure: Option<String>,
    flags: [bool; K],
    meanwhile: impl Fn(&mut Grains<D>),
) -> Result<(WallForces, [bool; K])> {
    let felt = Felt {
        grains: &system.grains,
        stress: system.stress,
        fixed: &system.fixed,
    };
    drive.load(&felt, &mut load);
    let mut message = [0i64; MESSAGE];
    message[0] = i64::from(failure.is_some());
    for (to, flag) in message[1..FORCES_AT].iter_mut().zip(flags) {
        *to = i64::from(flag);
    }
    let sums = [load.up, load.along, load.bottom];
    for (sum, limbs) in sums.iter().zip(message[FORCES_AT..].chunks_mut(FORCE)) {
        sum.write(limbs);
    }
    let left_out = if drive.has_bottom_force() { 0 } else { FORCE };
    let sent = &mut message[..MESSAGE - left_out];
    exchange.sum_during(sent, &mut || meanwhile(&mut system.grains));
    let force = |k: usize| {
        let limbs = &message[FORCES_AT + k * FORCE..][..FORCE];
        system.fixed.value(Accumulator::read(limbs))
    };
    let forces @ [up, along, bottom] = [0, 1, 2].map(force);
    if message[0] > 0 || forces.iter().any(|force| force.is_nan()) {
        return Err(system.fail(exchange, failure));
    }
    let flags = std::array::from_fn(|k| message[1 + k] > 0);
    Ok((WallForces { up, along, bottom }, flags))
}

/// Computes all forces at the present positions, those of inner contacts during the exchange of the
/// ghosts' records; advances the histories by `step` (s). Returns what was outside the law.
pub fn forces<D: Dimension>(
    exchange: &dyn Exchange,
    system: &mut System<D>,
    law: &dyn PairForce<D>,
    drive: &mut dyn Drive<D>,
    step: f64,
    mut samples: Option<&mut ContactForces>,
) -> Option<Outside> {
    system.finish_step();
    let owned = system.grains.owned;
    system.grains.force[..owned].fill(Zeroable::zeroed());
    // The grains may have been put elsewhere.
    system.contacts.wake();
    let is_stressed = drive.needs_stress(samples.is_some());
    let input = begin_forces(system, step, is_stressed, samples.as_deref_mut());
    let Grains {
        force,
        mass,
        body,
        units,
        ..
    } = &mut system.grains;
    weigh::<D>(
        &mut force[..owned],
        &mass[..owned],
        &body[..owned],
        *units,
        system.gravity,
    );
    let at_plane = drive.forces(input.isa, input.cell, step, &mut system.grains);
    let mut outcome = PassOutcome::default();
    for band in 0..system.bands.count() {
        let samples = samples.as_deref_mut();
        let forces = BandForces { law, band, input };
        let of_band = forces_of_band(exchange, system, &forces, samples, None);
        outcome = outcome.merge(of_band);
    }
    system.pool.gather(&mut system.grains.force);
    system.count(&outcome, is_stressed);
    let unsound = system.list.unsound.then_some(Outside::Number);
    let of_pairs = outcome.failures().next();
    at_plane.map(Outside::Plane).or(of_pairs).or(unsound)
}

/// Clears the forces on ghosts, and makes room for samples. Returns what the passes of a step have
/// in common, which advance the histories by `step` (s).
fn begin_forces<D: Dimension>(
    system: &mut System<D>,
    step: f64,
    is_stressed: bool,
    samples: Option<&mut ContactForces>,
) -> PassInput {
    let System {
        cell,
        grains,
        contacts,
        budget,
        step: full_step,
        isa,
        ..
    } = system;
    grains.force[grains.owned..].fill(Zeroable::zeroed());
    if !std::mem::replace(&mut contacts.limits_are_known, step > 0.0) {
        // Friction of spheres depends on them; a checkpoint does not hold what is not known.
        contacts.limits.fill([0; 4]);
    }
    if let Some(samples) = samples {
        samples.prepare(contacts.blocks());
    }
    PassInput {
        isa: *isa,
        units: grains.units,
        cell: *cell,
        step,
        travelled: None,
        is_cold: size_of_val(&grains.record[..]) > CACHED,
        counting: (is_stressed || budget.is_some()).then(|| Counting {
            unit: budget.as_ref().map(EnergyBudget::unit),
            step: *full_step,
            height: match cell.sheared {
                Some(sheared) if is_stressed => Some(sheared.height),
                _ => None,
            },
        }),
    }
}

/// Adds the forces of the pairs of a band, those of inner contacts during the exchange of the
/// ghosts' records. `within_shares`: what those found that have been added before. Those of other
/// threads are complete after [`ThreadPool::complete`](crate::threads::ThreadPool::complete).
fn forces_of_band<D: Dimension>(
    exchange: &dyn Exchange,
    system: &mut System<D>,
    forces: &BandForces<'_, D>,
    mut samples: Option<&mut ContactForces>,
    within_shares: Option<PassOutcome>,
) -> PassOutcome {
    let System {
        grains,
        contacts,
        slabs,
        clock,
        pool,
        ..
    } = system;
    let (record, force) = (&mut grains.record, &mut grains.force);
    let mut outcome = within_shares;
    slabs.exchange(exchange, forces.band, record, grains.owned, |owned| {
        clock.end(StepPhase::Exchange);
        let samples = samples.as_deref_mut();
        outcome.get_or_insert_with(|| {
            pool.forces_within_shares(forces, owned, force, contacts, samples)
        });
        clock.end(StepPhase::Contacts);
    });
    clock.end(StepPhase::Exchange);
    let others = pool.other_forces(forces, record, force, contacts, samples);
    clock.end(StepPhase::Contacts);
    outcome.map_or(others, |within| within.merge(others))
}
