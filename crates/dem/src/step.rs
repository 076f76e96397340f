//! The time step: read this first.
//!
//! Velocity Verlet: when the forces are computed, positions are at t+Δt and velocities at t+½Δt.
//! Damping forces use the full-step velocity predicted from the last acceleration, so the scheme is
//! of second order with damping, too (docs/explanation/scheme.md).
//!
//! A step goes through the bands of the grains ([`Bands`](crate::state::Bands)): a band moves, then
//! the forces of its pairs are computed, which are complete with those of the next band. So a
//! second step can follow some bands behind the first one, and a third one behind that: a sweep of
//! several steps, in which a band is in the cache for all of them. A stage is one band of each of
//! these steps; threads meet, and ranks exchange messages, once a stage. Small samples have one
//! band.

use std::time::{Duration, Instant};

use bytemuck::Zeroable;

use crate::budget::EnergyBudget;
use crate::clock::StepPhase;
use crate::dimension::Dimension;
use crate::domain::Exchange;
use crate::drive::{Drive, FlowSum, MomentumFlow, NeededStress, WallGrains, WallSteps, WallSums};
use crate::failure::{Outside, Result};
use crate::kernel::{ContactForces, Counting, PairForce, PassInput, PassOutcome};
use crate::motion::{GrainMotion, Moved, greater_or_nan, slow_down, weigh};
use crate::state::Grains;
use crate::sum_over_ranks::{FLAGS, SumOverRanks};
use crate::system::System;
use crate::threads::{BandForces, ShareWork, SharesInput};
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
        pace: Pace::new(count, exchange, system.pool.threads()),
        exchange,
        system,
        law,
        drive,
        request,
        count,
        steps: under_way,
        sum: None,
        drifts: 0,
        rebuild: false,
        stop: false,
    };
    sweep.run()?;
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
        || drive.needed_stress(false) != NeededStress::Nothing;
    if is_alone {
        return 1;
    }
    let most = system.most_at_once().min(request.most);
    most.min(system.list.lasting) as usize
}

/// How steps follow each other through the bands.
#[derive(Debug, Clone, Copy)]
struct Pace {
    /// By how many bands a step is behind the one before.
    lag: usize,
    /// How many bands of a stage move before forces are computed.
    together: usize,
}

impl Pace {
    /// A band is complete with the forces on the next one. A thread alone moves it at once in the
    /// next step, so that as few bands as possible are in the cache. Where threads must meet, or
    /// messages take long, all bands of a stage move together, which must not need each other.
    fn new(steps: usize, exchange: &dyn Exchange, threads: usize) -> Self {
        if threads == 1 && exchange.is_near() {
            return Self {
                lag: 1,
                together: 1,
            };
        }
        Self {
            lag: 2,
            together: steps,
        }
    }
}

/// A band of a step.
#[derive(Debug, Clone, Copy)]
struct BandOfStep {
    step: usize,
    band: usize,
    /// Whether it is the last one of the step.
    is_last: bool,
}

/// What threads do with the bands of their shares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ShareTask {
    /// They move the grains.
    Move,
    /// They add the forces of the pairs.
    AddForces,
    /// Both, where nothing is sent in between.
    MoveAndAddForces,
}

/// What a thread found in a band of its share.
#[derive(Default)]
struct BandOfShare {
    /// What the motion found, if the grains moved.
    moved: Option<Moved>,
    /// How long it took.
    time: Duration,
    /// What the passes found, if forces were added.
    forces: PassOutcome,
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
    pace: Pace,
    /// Whether the first step begins with the second kick of the one before the sweep.
    second_kick_deferred: bool,
    /// The steps that have begun.
    steps: Vec<StepUnderWay>,
    /// The step whose sum over the ranks is under way.
    sum: Option<(usize, SumOverRanks)>,
    /// Number of steps in which the walls have drifted.
    drifts: usize,
    /// Whether the list must be rebuilt after the sweep.
    rebuild: bool,
    /// Whether some rank was asked to stop.
    stop: bool,
}

impl<D: Dimension> Sweep<'_, D> {
    fn run(&mut self) -> Result<()> {
        let Pace { lag, together } = self.pace;
        for stage in 0..self.system.bands.count() + lag * (self.count - 1) {
            for bands in self.bands_of(stage).chunks(together) {
                self.move_bands(bands)?;
                self.complete_bands(bands);
            }
        }
        self.end_step()
    }

    /// The bands that move in a stage, the last one first, which is of the first step.
    fn bands_of(&self, stage: usize) -> Vec<BandOfStep> {
        let bands = self.system.bands.count();
        let mut found = Vec::new();
        for step in 0..self.count {
            let Some(band) = stage.checked_sub(self.pace.lag * step) else {
                break;
            };
            if band < bands {
                found.push(BandOfStep {
                    step,
                    band,
                    is_last: band + 1 == bands,
                });
            }
            // Leaves out the steps after one that failed; with several ranks the others wait for
            // their messages.
            let failed = self.steps.get(step).is_some_and(|s| s.failure.is_some());
            if failed && self.exchange.size() == 1 {
                break;
            }
        }
        found
    }

    /// Moves bands, and computes the forces of their pairs within shares while the records of their
    /// ghosts are under way.
    fn move_bands(&mut self, bands: &[BandOfStep]) -> Result<()> {
        for BandOfStep {
            step,
            band,
            is_last,
        } in bands.iter().copied()
        {
            if is_last && step > 0 {
                self.end_step()?;
            }
            if band == 0 {
                self.begin(step);
            }
            if is_last {
                self.move_walls(step);
            }
        }
        let is_alone = self.exchange.size() == 1;
        let task = if is_alone {
            ShareTask::MoveAndAddForces
        } else {
            ShareTask::Move
        };
        self.over_shares(bands, task);
        for band in bands.iter().filter(|band| band.is_last) {
            self.end_motion(band.step);
        }
        self.system.clock.end(StepPhase::Motion);
        if !is_alone {
            let System {
                slabs,
                grains,
                pool,
                ..
            } = &mut *self.system;
            let numbers = bands.iter().map(|band| band.band);
            slabs.begin_exchange(self.exchange, numbers, &grains.record, pool.workers());
            self.system.clock.end(StepPhase::Exchange);
            self.over_shares(bands, ShareTask::AddForces);
        }
        Ok(())
    }

    /// Waits for the ghosts of bands that have moved, computes the forces that are left, and
    /// completes those on the bands before.
    fn complete_bands(&mut self, bands: &[BandOfStep]) {
        let System {
            slabs,
            grains,
            pool,
            ..
        } = &mut *self.system;
        let numbers = bands.iter().map(|band| band.band);
        slabs.end_exchange(self.exchange, numbers, &mut grains.record, pool.workers());
        self.system.clock.end(StepPhase::Exchange);
        self.add_other_forces(bands);
        self.system.clock.end(StepPhase::Contacts);
        self.complete(bands);
        for band in bands.iter().filter(|band| band.is_last) {
            self.sum(band.step);
        }
        self.system.clock.end(StepPhase::Walls);
    }

    /// Moves the cell.
    fn begin(&mut self, step: usize) {
        let Self { system, drive, .. } = self;
        let time_step = system.step;
        drive.drift_cell(time_step, &mut system.cell, &system.grains);
        if let Some(sheared) = system.cell.sheared
            && sheared.half_velocity != 0.0
        {
            system.shear(sheared.step_of_images(time_step));
        }
        let stress = drive.needed_stress(self.request.samples.is_some());
        let motion = GrainMotion {
            isa: system.isa,
            units: system.grains.units,
            gravity: system.gravity,
            step: time_step,
            cell: system.cell,
            streaming: drive.streaming(),
            is_stressed: stress != NeededStress::Nothing,
            // With a single band, the walls drift before any grain moves.
            walls: match system.bands.count() {
                1 => None,
                _ => drive.bottom((step - self.drifts) as u64),
            },
        };
        drive.predict_cell(time_step, &mut system.cell);
        let samples = self.request.samples.as_deref_mut();
        let input = begin_forces(system, time_step, stress, samples);
        self.steps.push(StepUnderWay {
            motion,
            input,
            fastest: 0.0,
            way: 0.0,
            flow: FlowSum::default(),
            outcome: PassOutcome::default(),
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

    /// Has the threads move the grains of bands in their shares, which then have no force but their
    /// weight, or add the forces of the pairs within these.
    fn over_shares(&mut self, bands: &[BandOfStep], task: ShareTask) {
        let Self {
            system,
            drive,
            law,
            steps,
            request,
            second_kick_deferred,
            ..
        } = self;
        let System {
            bands: places,
            pool,
            grains,
            contacts,
            list,
            ..
        } = &mut **system;
        let slowest = drive.speed();
        let input = SharesInput {
            bands: places,
            grains,
            walls: drive.wall_grains(),
            contacts,
            samples: request.samples.as_deref_mut(),
        };
        let work = |share: &mut ShareWork<'_, D>| {
            let mut found = Vec::with_capacity(bands.len());
            for &BandOfStep { step, band, .. } in bands {
                let under_way = &steps[step];
                let motion = &under_way.motion;
                let mut of_band = BandOfShare::default();
                let mut travelled = list.travelled[band];
                if task != ShareTask::AddForces {
                    let begun = Instant::now();
                    let is_kicked = *second_kick_deferred || step > 0;
                    let moved = motion.advance(is_kicked, share.grains_of(band));
                    of_band.time = begun.elapsed();
                    let fastest = greater_or_nan(slowest, moved.fastest);
                    let way = list.way(fastest, motion.step, &motion.cell);
                    travelled = list.travelled_after(band, greater_or_nan(way, under_way.way));
                    of_band.moved = Some(moved);
                }
                if task != ShareTask::Move {
                    of_band.forces = share.add_forces(&BandForces {
                        law: *law,
                        band,
                        input: under_way.input_of_band(travelled, step),
                    });
                }
                found.push(of_band);
            }
            found
        };
        let found = pool.over_shares(input, work);
        for (k, &BandOfStep { step, band, .. }) in bands.iter().enumerate() {
            if task != ShareTask::AddForces {
                let mut fastest = slowest;
                for moved in found.iter().filter_map(|of_share| of_share[k].moved) {
                    fastest = greater_or_nan(fastest, moved.fastest);
                    self.steps[step].flow.merge(moved.flow);
                }
                self.end_motion_of_band(step, band, fastest);
            }
            for of_share in &found {
                self.found(step, of_share[k].forces);
            }
        }
        let clock = &mut self.system.clock;
        if task == ShareTask::Move {
            clock.end(StepPhase::Motion);
            return;
        }
        clock.end(StepPhase::Contacts);
        let of_first = found.first().into_iter().flatten();
        let time = of_first.map(|of_band| of_band.time).sum();
        clock.give(StepPhase::Contacts, StepPhase::Motion, time);
    }

    /// Notes how fast the grains of a band have moved.
    fn end_motion_of_band(&mut self, step: usize, band: usize, fastest: f64) {
        let Self { system, steps, .. } = self;
        let under_way = &mut steps[step];
        let motion = &under_way.motion;
        let way = system.list.way(fastest, motion.step, &motion.cell);
        // A pair may be with a grain of the band before.
        system.list.travel(band, greater_or_nan(way, under_way.way));
        under_way.way = way;
        under_way.fastest = greater_or_nan(under_way.fastest, fastest);
        if fastest.is_nan() {
            under_way.fail(Outside::Number, |outside| system.describe(outside));
        }
    }

    /// Adds what passes of a step found.
    fn found(&mut self, step: usize, outcome: PassOutcome) {
        let Self { system, steps, .. } = self;
        steps[step].found(outcome, |outside| system.describe(outside));
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

    /// Adds the forces of the pairs of bands that are within no share.
    fn add_other_forces(&mut self, bands: &[BandOfStep]) {
        let Self {
            system,
            law,
            steps,
            request,
            ..
        } = self;
        let System {
            pool,
            grains,
            contacts,
            list,
            ..
        } = &mut **system;
        let mut forces = Vec::with_capacity(bands.len());
        for &BandOfStep { step, band, .. } in bands {
            forces.push(BandForces {
                law: *law,
                band,
                input: steps[step].input_of_band(list.travelled[band], step),
            });
        }
        let samples = request.samples.as_deref_mut();
        let outcomes = pool.add_other_forces(&forces, grains, contacts, samples);
        for (band, outcome) in bands.iter().zip(outcomes) {
            self.found(band.step, outcome);
        }
    }

    /// Completes the forces of contacts on the bands before these, and on the last one of all, and
    /// sums those on grains of walls.
    fn complete(&mut self, bands: &[BandOfStep]) {
        let Self { system, drive, .. } = self;
        let mut completed = Vec::with_capacity(bands.len());
        for &BandOfStep { band, is_last, .. } in bands {
            let end = if is_last { band + 1 } else { band };
            completed.push(band.saturating_sub(1)..end);
        }
        let System {
            bands: places,
            pool,
            grains,
            fixed,
            ..
        } = &mut **system;
        let load = |first: usize, force: &[D::Force]| {
            let mut sums = WallSums::default();
            let walls = drive.wall_grains().within(first..first + force.len());
            drive.load_on_grains(first, force, fixed, walls, &mut sums);
            sums
        };
        let sums = pool.complete(places, &completed, &mut grains.force, load);
        for (band, sums) in bands.iter().zip(sums) {
            self.steps[band.step].load.merge(sums);
        }
    }

    /// Begins the sum over the ranks of a step.
    fn sum(&mut self, step: usize) {
        let Self { system, drive, .. } = self;
        let under_way = &mut self.steps[step];
        system.count(&under_way.outcome, under_way.motion.is_stressed);
        system.add_flow(under_way.flow);
        self.rebuild |= system.list.forced(system.steps);
        let [some, many] = LASTING.map(|steps| system.list.lasts(system.steps + 1, steps));
        let flags = [self.rebuild, self.request.stop, !some, !many];
        let load = std::mem::take(&mut under_way.load);
        // Kept, so that the steps after this one go no further.
        let failure = under_way.failure.clone().map(|(_, message)| message);
        let sum = SumOverRanks::begin(self.exchange, system, *drive, load, failure, flags);
        self.sum = Some((step, sum));
        // Its forces are no whole multiples of a unit: after all others.
        if let Some(drag) = drive.drag() {
            slow_down(&mut system.grains, drag);
        }
    }

    /// Ends the step whose sum over the ranks is under way: gives the walls their second kick.
    fn end_step(&mut self) -> Result<()> {
        let Some((step, sum)) = self.sum.take() else {
            return Ok(());
        };
        let Self { system, drive, .. } = self;
        let (load, [rebuild, stop, not_for_some, not_for_many]) = sum.end(self.exchange, system)?;
        self.rebuild |= rebuild;
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
        system.wall_velocities = drive.kick(self.steps[step].motion.step, load);
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
    let sum = SumOverRanks::begin(exchange, system, drive, load, failure, [false; FLAGS]);
    let (load, _) = sum.end(exchange, system)?;
    if let Some(budget) = &mut system.budget {
        let moved = drive.moved();
        let at_rest = WallSteps {
            along: 0.0,
            bottom_along: moved.bottom_along.map(|_| 0.0),
            normal: moved.normal.map(|_| [0.0; 2]),
            lateral: [0.0; 2],
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

/// Computes all forces at the present positions, where ghosts have their records; advances the
/// histories by `step` (s). Returns what was outside the law.
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
    let stress = drive.needed_stress(samples.is_some());
    let input = begin_forces(system, step, stress, samples.as_deref_mut());
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
    let all = 0..system.bands.count();
    let System {
        bands,
        grains,
        contacts,
        slabs,
        pool,
        ..
    } = system;
    slabs.begin_exchange(exchange, all.clone(), &grains.record, pool.workers());
    slabs.end_exchange(exchange, all.clone(), &mut grains.record, pool.workers());
    let forces: Vec<_> = all
        .rev()
        .map(|band| BandForces { law, band, input })
        .collect();
    let shares = SharesInput {
        bands,
        grains,
        walls: WallGrains::default(),
        contacts,
        samples: samples.as_deref_mut(),
    };
    let within_shares = pool.over_shares(shares, |share| {
        let of_bands = forces.iter().map(|forces| share.add_forces(forces));
        of_bands.fold(PassOutcome::default(), PassOutcome::merge)
    });
    let others = pool.add_other_forces(&forces, grains, contacts, samples);
    let outcomes = within_shares.into_iter().chain(others);
    let outcome = outcomes.fold(PassOutcome::default(), PassOutcome::merge);
    pool.gather(bands, &mut grains.force);
    system.count(&outcome, stress != NeededStress::Nothing);
    let unsound = system.list.unsound.then_some(Outside::Number);
    let of_pairs = outcome.failures().next();
    at_plane.map(Outside::Plane).or(of_pairs).or(unsound)
}

/// Clears the forces on ghosts, and makes room for samples. Returns what the passes of a step have
/// in common, which advance the histories by `step` (s).
fn begin_forces<D: Dimension>(
    system: &mut System<D>,
    step: f64,
    stress: NeededStress,
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
        counting: (stress != NeededStress::Nothing || budget.is_some()).then(|| Counting {
            unit: budget.as_ref().map(EnergyBudget::unit),
            step: *full_step,
            height: match cell.sheared {
                Some(sheared) if stress != NeededStress::Nothing => Some(sheared.height),
                _ => None,
            },
            lateral: match stress {
                NeededStress::AlongAllAxes => Some(cell.periods),
                _ => None,
            },
        }),
    }
}
