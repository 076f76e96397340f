//! The time step: read this first.
//!
//! Velocity Verlet: when the forces are computed, positions are at t+Δt and velocities at t+½Δt.
//! Damping forces use the full-step velocity predicted from the last acceleration, so the scheme is
//! of second order with damping, too (docs/scheme.md).

use bytemuck::Zeroable;

use crate::budget::EnergyBudget;
use crate::clock::StepPhase;
use crate::dimension::Dimension;
use crate::domain::{Accumulator, Exchange, LIMBS};
use crate::drive::{
    Drive, Felt, FlowSum, MomentumFlow, Streaming, WallForces, WallGrains, WallSteps, WallSums,
    WallVelocities,
};
use crate::failure::Result;
use crate::kernel::{ContactForces, Counting, PairForce, PassInput, PassOutcome};
use crate::simd::{Lanes, Work};
use crate::state::{Cell, Grains, Sheared, Units, body};
use crate::system::{Outside, System};
use crate::threads::OwnedPart;

/// Options of a step.
#[derive(Debug, Default)]
pub struct StepRequest<'a> {
    /// Receives the contact forces.
    pub samples: Option<&'a mut ContactForces>,
    /// Whether this rank was asked to stop.
    pub stop: bool,
}

impl<'a> StepRequest<'a> {
    /// A step that records the contact forces.
    pub fn sampled(samples: &'a mut ContactForces) -> Self {
        Self {
            samples: Some(samples),
            stop: false,
        }
    }
}

/// Advances everything by Δt. Returns whether some rank was asked to stop; collective.
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
) -> Result<bool> {
    let step = system.step;
    system.steps += 1;
    system.clock.start();

    // Not at the end of the last step, because its samples are indexed by the blocks of the old
    // list.
    if system.list.due {
        system.rebuild(exchange, law, drive)?;
        system.clock.end(StepPhase::Rebuild);
    }
    let wall_velocities = drive.drift(step, &mut system.cell, &system.grains);
    if let Some(Sheared { half_velocity, .. }) = system.cell.sheared
        && half_velocity != 0.0
    {
        system.shear(step * half_velocity);
    }
    let (isa, cell) = (system.tuning.passes().isa, system.cell);
    let mut fastest = drive.speed();
    let second_kick_deferred = std::mem::take(&mut system.second_kick_deferred);
    // Those of the last step: the walls have others now.
    system.wall_velocities = None;
    let streaming = drive.streaming();
    let motion = GrainMotion {
        step,
        cell,
        streaming,
        is_stressed: drive.needs_stress(request.samples.is_some()),
        wall_velocities,
        predicted_wall_velocities: drive.predict(step, &mut system.cell),
    };
    let mut walls = drive.wall_grains();
    let feet = walls.split_off(system.grains.owned);
    motion.give_first::<D>(feet, 0, &mut system.grains.record);
    motion.give_predicted::<D>(feet, 0, &mut system.grains.record);
    let mut flow = FlowSum::default();
    system.pool.over_owned(
        &mut system.grains,
        walls,
        |part| match (second_kick_deferred, streaming.is_some()) {
            (true, false) => isa.run(HalfKickAndDrift::<_, true, false> { part, motion }),
            (false, false) => isa.run(HalfKickAndDrift::<_, false, false> { part, motion }),
            (true, true) => isa.run(HalfKickAndDrift::<_, true, true> { part, motion }),
            (false, true) => isa.run(HalfKickAndDrift::<_, false, true> { part, motion }),
        },
        |(speed, of_share)| {
            fastest = greater_or_nan(fastest, speed);
            flow.merge(of_share);
        },
    );
    let planes = drive.planes();
    if let Some(planes) = planes {
        system.grains.put_feet(planes);
    }
    let rebuild = (system.list).moved(fastest, step, &system.grains, &cell, planes);
    system.clock.end(StepPhase::Motion);

    let travelled = Some(system.list.travelled);
    let samples = request.samples;
    let outside = add_forces(exchange, system, law, drive, step, travelled, samples);
    system.add_flow(flow);

    let rebuild = rebuild || system.list.forced(system.steps);
    let flags = [rebuild, request.stop];
    let (load, [due, stop]) = sum_over_ranks(exchange, system, drive, outside, flags, |grains| {
        if let Some(drag) = drive.drag() {
            slow_down(grains, drag);
        }
    })?;
    system.list.due = due;
    system.second_kick_deferred = true;
    if let Some(budget) = &mut system.budget {
        budget.push(&load, drive.moved());
    }
    system.clock.end(StepPhase::Walls);

    system.wall_velocities = drive.kick(step, load);
    system.clock.end(StepPhase::Motion);
    system.tuning.end_step(exchange, system.clock.worked());

    Ok(stop)
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
    let (load, []) = sum_over_ranks(exchange, system, drive, outside, [], |_| ())?;
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

/// Room for two flags.
const FORCES_AT: usize = 3;
const FORCE: usize = LIMBS + 1;
const MESSAGE: usize = FORCES_AT + 3 * FORCE;
/// Size of the message that the ranks sum in every step (bytes), without the force on the bottom.
pub const MESSAGE_BYTES: usize = (MESSAGE - FORCE) * size_of::<i64>();

/// Sums over the ranks in one message: whether something failed, K flags that are set if they are
/// set on some rank, and the forces on the walls. That on the bottom is last, and left out if the
/// drive does not ask for it. Runs `meanwhile` during the sum.
fn sum_over_ranks<D: Dimension, const K: usize>(
    exchange: &dyn Exchange,
    system: &mut System<D>,
    drive: &dyn Drive<D>,
    outside: Option<Outside>,
    flags: [bool; K],
    meanwhile: impl Fn(&mut Grains<D>),
) -> Result<(WallForces, [bool; K])> {
    let felt = Felt {
        grains: &system.grains,
        stress: system.stress,
        fixed: &system.fixed,
    };
    let load = system.pool.over_walls(drive.wall_grains(), |walls| {
        let mut sums = WallSums::default();
        drive.load(&felt, walls, &mut sums);
        sums
    });
    let mut message = [0i64; MESSAGE];
    message[0] = i64::from(outside.is_some());
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
        return Err(system.explain(exchange, outside));
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
    samples: Option<&mut ContactForces>,
) -> Option<Outside> {
    system.finish_step();
    let owned = system.grains.owned;
    system.grains.force[..owned].fill(Zeroable::zeroed());
    // The grains may have been put elsewhere.
    system.contacts.wake();
    add_forces(exchange, system, law, drive, step, None, samples)
}

/// [`forces`] without clearing those on the owned grains. `travelled`: [`PassInput::travelled`].
fn add_forces<D: Dimension>(
    exchange: &dyn Exchange,
    system: &mut System<D>,
    law: &dyn PairForce<D>,
    drive: &mut dyn Drive<D>,
    step: f64,
    travelled: Option<f64>,
    mut samples: Option<&mut ContactForces>,
) -> Option<Outside> {
    let System {
        cell,
        grains,
        contacts,
        slabs,
        clock,
        list,
        pool,
        budget,
        gravity,
        stress,
        step: full_step,
        tuning,
        ..
    } = system;
    grains.force[grains.owned..].fill(Zeroable::zeroed());
    if !std::mem::replace(&mut contacts.limits_are_known, step > 0.0) {
        // Friction of spheres depends on them; a checkpoint does not hold what is not known.
        contacts.limits.fill([0; 4]);
    }
    if *gravity != [0.0; 2] {
        weigh(grains, *gravity);
    }
    let at_plane = drive.forces(tuning.passes(), *cell, step, grains);
    let is_stressed = drive.needs_stress(samples.is_some());
    if let Some(samples) = &mut samples {
        samples.prepare(contacts.blocks());
    }
    let input = PassInput {
        settings: tuning.passes(),
        units: grains.units,
        cell: *cell,
        step,
        travelled,
        counting: (is_stressed || budget.is_some()).then(|| Counting {
            unit: budget.as_ref().map(EnergyBudget::unit),
            step: *full_step,
            height: match cell.sheared {
                Some(sheared) if is_stressed => Some(sheared.height),
                _ => None,
            },
        }),
    };
    let (record, force) = (&mut grains.record, &mut grains.force);
    let mut outcome = PassOutcome::default();
    slabs.exchange(exchange, record, grains.owned, |owned| {
        clock.end(StepPhase::Exchange);
        let samples = samples.as_deref_mut();
        outcome = pool.forces_within_shares(law, input, owned, force, contacts, samples);
        clock.end(StepPhase::Contacts);
    });
    clock.end(StepPhase::Exchange);
    outcome = outcome.merge(pool.other_forces(law, input, record, force, contacts, samples));
    pool.gather(&mut grains.force);
    clock.end(StepPhase::Contacts);

    *stress = is_stressed.then_some(outcome.stress);
    if let Some(budget) = budget {
        budget.step(outcome.dissipated, outcome.uncounted);
    }
    let pair = |at: Option<(usize, usize)>, why: fn(usize, usize) -> Outside| {
        at.map(|(block, lane)| why(block, lane))
    };
    let at_pair = pair(outcome.outside, Outside::Pair).or(pair(outcome.too_strong, Outside::Force));
    let unsound = list.unsound.then_some(Outside::Number);
    at_plane.map(Outside::Plane).or(at_pair).or(unsound)
}

/// Computes v(t+½Δt), x(t+Δt) wrapped into the cell, and the predicted v(t+Δt); clears the forces.
/// Returns the greatest speed (m/s), or NaN if one is NaN, and the flow of momentum where grains
/// stream. `SECOND_KICK_DEFERRED`: gives the deferred second kick of the last step first.
/// `STREAMS`: grains do what [`Drive::streaming`] says.
struct HalfKickAndDrift<'a, D: Dimension, const SECOND_KICK_DEFERRED: bool, const STREAMS: bool> {
    part: OwnedPart<'a, D>,
    motion: GrainMotion,
}

/// What moves the grains in a step beside the forces.
#[derive(Clone, Copy)]
struct GrainMotion {
    /// Δt (s).
    step: f64,
    cell: Cell,
    streaming: Option<Streaming>,
    /// Whether the flow of momentum is needed.
    is_stressed: bool,
    /// With which the grains of walls move.
    wall_velocities: Option<WallVelocities>,
    /// Which they have then.
    predicted_wall_velocities: Option<WallVelocities>,
}

impl GrainMotion {
    /// Gives grains of walls the velocities with which they move, also as those of the half step,
    /// from which the deferred second kick starts.
    fn give_first<D: Dimension>(
        &self,
        walls: WallGrains<'_>,
        first: usize,
        record: &mut [D::Record],
    ) {
        if let Some(velocities) = self.wall_velocities {
            velocities.give::<D>(walls, &[D::VELOCITY, D::HALF_VELOCITY], first, record);
        }
    }

    /// Gives grains of walls that have moved their predicted velocities.
    fn give_predicted<D: Dimension>(
        &self,
        walls: WallGrains<'_>,
        first: usize,
        record: &mut [D::Record],
    ) {
        if let Some(velocities) = self.predicted_wall_velocities {
            velocities.give::<D>(walls, &[D::VELOCITY], first, record);
        }
    }
}

impl<D: Dimension, const SECOND_KICK_DEFERRED: bool, const STREAMS: bool> Work
    for HalfKickAndDrift<'_, D, SECOND_KICK_DEFERRED, STREAMS>
{
    type Output = (f64, FlowSum);

    #[inline(always)]
    fn run<L: Lanes>(self, _: L::Token) -> (f64, FlowSum) {
        let (part, motion) = (self.part, self.motion);
        let GrainMotion {
            step,
            cell,
            is_stressed,
            ..
        } = motion;
        let streaming = if STREAMS { motion.streaming } else { None };
        motion.give_first::<D>(part.walls, part.first, part.record);
        let mut flow = FlowSum::default();
        // The bits of the squared speed, which are greatest for NaN: integers are compared in one
        // cycle, a chain of floating-point maxima would wait for each result.
        let mut fastest = 0;
        let grains = part.record.iter_mut().zip(part.force).zip(part.half_kick);
        for ((((record, force), kick), image), mass) in grains.zip(part.image).zip(part.mass) {
            let r = D::fields_mut(record);
            let [linear, angular] = *kick;
            let speed = translate::<D, SECOND_KICK_DEFERRED>(r, force, linear, step, streaming)
                + turn::<D, SECOND_KICK_DEFERRED>(r, force, angular);
            let along = r[..D::UP].iter_mut().zip(cell.periods).zip(&mut *image);
            for ((x, period), image) in along {
                if *x < 0.0 || *x >= period {
                    *image += Cell::wrap(x, period);
                }
            }
            cell.wrap_last_axis::<D>(r, image);
            if let Some(streaming) = streaming {
                let change = streaming.changes[1];
                if change != 0.0 {
                    let more = change * r[D::UP];
                    r[D::VELOCITY] += more;
                    r[D::HALF_VELOCITY] += more;
                }
                if is_stressed && let Some(momentum) = &streaming.flow {
                    flow.add(momentum.of::<D>(*mass, r));
                }
            }
            *force = Zeroable::zeroed();
            fastest = speed.to_bits().max(fastest);
        }
        motion.give_predicted::<D>(part.walls, part.first, part.record);
        (f64::from_bits(fastest).sqrt(), flow)
    }
}

/// Kicks, moves and, where grains stream, stretches; returns the square of the speed. One short
/// loop per quantity, which the compiler vectorises.
#[inline(always)]
fn translate<D: Dimension, const SECOND_KICK_DEFERRED: bool>(
    r: &mut [f64],
    force: &[f64],
    half_kick: f64,
    step: f64,
    streaming: Option<Streaming>,
) -> f64 {
    let (mut dv, mut v) = ([0.0; 3], [0.0; 3]);
    for axis in 0..D::AXES {
        dv[axis] = half_kick * force[axis];
        v[axis] = if SECOND_KICK_DEFERRED {
            r[D::HALF_VELOCITY + axis] + dv[axis]
        } else {
            r[D::VELOCITY + axis]
        };
    }
    if let Some(streaming) = streaming
        && streaming.changes[0] != 0.0
    {
        v[0] += streaming.changes[0] * r[D::UP];
    }
    for axis in 0..D::AXES {
        v[axis] += dv[axis];
    }
    r[D::HALF_VELOCITY..][..D::AXES].copy_from_slice(&v[..D::AXES]);
    for axis in 0..D::AXES {
        r[D::VELOCITY + axis] = v[axis] + dv[axis];
    }
    if let Some(streaming) = streaming {
        r[D::UP] *= streaming.stretches[0];
    }
    for axis in 0..D::AXES {
        r[axis] += step * v[axis];
    }
    if let Some(streaming) = streaming {
        r[D::VELOCITY + D::UP] *= streaming.stretches[1];
        r[D::HALF_VELOCITY + D::UP] *= streaming.stretches[1];
    }
    v[..D::AXES].iter().map(|v| v * v).sum()
}

/// Kicks the spins; returns NaN if one is not finite, else 0.
#[inline(always)]
fn turn<D: Dimension, const SECOND_KICK_DEFERRED: bool>(
    r: &mut [f64],
    force: &[f64],
    half_kick: f64,
) -> f64 {
    let (mut dw, mut w) = ([0.0; 3], [0.0; 3]);
    for k in 0..D::SPINS {
        dw[k] = half_kick * force[D::TORQUE + k];
        w[k] = if SECOND_KICK_DEFERRED {
            (r[D::HALF_SPIN + k] + dw[k]) + dw[k]
        } else {
            r[D::SPIN + k] + dw[k]
        };
    }
    r[D::HALF_SPIN..][..D::SPINS].copy_from_slice(&w[..D::SPINS]);
    for k in 0..D::SPINS {
        r[D::SPIN + k] = w[k] + dw[k];
    }
    w[..D::SPINS].iter().map(|w| 0.0 * w).sum()
}

fn greater_or_nan(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() { b } else { a }
}

/// Adds the weights to free grains, rounded like the contact forces.
fn weigh<D: Dimension>(grains: &mut Grains<D>, gravity: [f64; 2]) {
    let [along, down] = gravity;
    let shift = Units::shift(grains.units.force);
    for g in 0..grains.owned {
        if grains.body[g] == body::FREE {
            let mass = grains.mass[g];
            grains.force[g][0] = (shift + mass * along) - shift;
            grains.force[g][D::UP] = (shift - mass * down) - shift;
        }
    }
}

/// Adds the drag (1/s) on translations and on rotations.
fn slow_down<D: Dimension>(grains: &mut Grains<D>, drag: [f64; 2]) {
    let [linear, angular] = drag;
    for g in 0..grains.owned {
        let r = D::fields(&grains.record[g]);
        let (mass, radius) = (grains.mass[g], grains.radius[g]);
        let force = &mut grains.force[g];
        for axis in 0..D::AXES {
            force[axis] -= linear * mass * r[D::VELOCITY + axis];
        }
        for k in 0..D::SPINS {
            force[D::TORQUE + k] -= angular * D::INERTIA * mass * radius * radius * r[D::SPIN + k];
        }
    }
}
