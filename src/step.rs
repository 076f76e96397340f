//! The time step: read this first.
//!
//! Velocity Verlet with positions at t+Δt and velocities at t+½Δt when the forces are computed. Damping forces take the
//! full-step velocity predicted from the last acceleration, so the scheme stays second order with damping (physics.md).

use crate::clock::Phase;
use crate::contact::ContactLaw;
use crate::domain::{Accumulator, Exchange, LIMBS};
use crate::drive::Drive;
use crate::failure::Failure;
use crate::kernel::{ContactForces, Pass, contact_forces};
use crate::state::{Grains, field};
use crate::system::System;

/// Advances everything by Δt. `stop`: this rank was asked to stop; returned: some rank was. `samples` are filled where given.
pub fn advance<C: ContactLaw, D: Drive, E: Exchange>(
    exchange: &E,
    system: &mut System,
    law: &C,
    drive: &mut D,
    stop: bool,
    samples: Option<&mut ContactForces>,
) -> Result<bool, Failure> {
    let step = system.step;
    system.steps += 1;
    system.clock.start();

    // Not at the end of the last step: what was sampled there belongs to the list it was sampled with.
    if system.list.due {
        system.rebuild(exchange, law, drive)?;
        system.clock.end(Phase::Rebuild);
    }
    drive.drift(step, &mut system.grains);
    let fastest = half_kick_and_drift(&mut system.grains, step, system.length);
    drive.predict(step, &mut system.grains);
    let rebuild = system.list.moved(
        fastest.max(drive.speed()),
        step,
        &system.grains,
        system.length,
    );
    system.clock.end(Phase::Motion);

    system.slabs.exchange(exchange, &mut system.grains, || ());
    system.clock.end(Phase::Exchange);

    let outside = forces(system, law, drive, step, samples);
    system.clock.end(Phase::Contacts);

    let rebuild = rebuild || system.list.forced(system.steps);
    let (load, [due, stop]) = agree(exchange, system, drive, outside, [rebuild, stop])?;
    system.list.due = due;
    system.clock.end(Phase::Walls);

    if D::DRAG {
        slow_down(&mut system.grains, drive.drag());
    }
    second_kick(&mut system.grains);
    // Last, since the second kick leaves grains of walls at the velocity of the half step.
    drive.kick(step, load, &mut system.grains);
    system.clock.end(Phase::Motion);

    Ok(stop)
}

/// Forces and the wall's acceleration at the start of a stage: nothing moves, no history advances.
pub fn initial_forces<C: ContactLaw, D: Drive, E: Exchange>(
    exchange: &E,
    system: &mut System,
    law: &C,
    drive: &mut D,
    samples: Option<&mut ContactForces>,
) -> Result<(), Failure> {
    let outside = forces(system, law, drive, 0.0, samples);
    let (load, []) = agree(exchange, system, drive, outside, [])?;
    drive.piston_mut().start(load);
    Ok(())
}

/// The force on the top along y (N/m), and which of the questions some rank answers with yes: one message for all that
/// the ranks must agree on.
fn agree<D: Drive, const K: usize>(
    exchange: &impl Exchange,
    system: &System,
    drive: &D,
    outside: Option<Outside>,
    questions: [bool; K],
) -> Result<(f64, [bool; K]), Failure> {
    let mut load = Accumulator::default();
    drive.load(&system.grains, &system.fixed, &mut load);
    let mut message = [0i64; LIMBS + 4];
    load.write(&mut message);
    message[LIMBS + 1] = outside.is_some() as i64;
    for (to, yes) in message[LIMBS + 2..].iter_mut().zip(questions) {
        *to = yes as i64;
    }
    exchange.sum(&mut message);
    let load = system.fixed.value(Accumulator::read(&message));
    if message[LIMBS + 1] > 0 || load.is_nan() {
        return Err(system.explain(exchange, outside));
    }
    Ok((load, std::array::from_fn(|k| message[LIMBS + 2 + k] > 0)))
}

/// All forces at the present positions; histories advance by `step` (s). Returns what was outside the law.
pub fn forces<C: ContactLaw, D: Drive>(
    system: &mut System,
    law: &C,
    drive: &mut D,
    step: f64,
    samples: Option<&mut ContactForces>,
) -> Option<Outside> {
    system.grains.force.fill([0.0; 4]);
    let at_plane = drive
        .forces(system.level, system.length, step, &mut system.grains)
        .map(Outside::Plane);
    let grains = &mut system.grains;
    let at_pair = contact_forces(
        system.level,
        law,
        Pass {
            record: &grains.record,
            force: &mut grains.force,
            contacts: &mut system.contacts,
            length: system.length,
            step,
            samples,
        },
    );
    let at_pair = at_pair.map(|(block, lane)| Outside::Pair(block, lane));
    let unsound = system.list.unsound.then_some(Outside::Number);
    at_plane.or(at_pair).or(unsound)
}

/// Where the numbers failed, as this rank knows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outside {
    /// This grain overlaps a plane too much.
    Plane(usize),
    /// The contact in this block and lane overlaps too much.
    Pair(usize, usize),
    /// A position or velocity is no number, or a grain moved further than the list allows.
    Number,
}

/// v(t+½Δt), x(t+Δt) wrapped along x, and the predicted v(t+Δt). Returns the greatest speed (m/s), NaN where one is none.
fn half_kick_and_drift(grains: &mut Grains, step: f64, length: f64) -> f64 {
    use field::*;
    let mut fastest = 0.0f64;
    let mut sum = 0.0;
    let own = grains.owned;
    for ((record, force), [linear, angular]) in grains.record[..own]
        .iter_mut()
        .zip(&grains.force)
        .zip(&grains.half_kick)
    {
        let r = &mut record.0;
        let (du, dv, dw) = (linear * force[0], linear * force[1], angular * force[2]);
        r[HALF_U] = r[U] + du;
        r[HALF_V] = r[V] + dv;
        r[HALF_W] = r[W] + dw;
        let x = r[X] + step * r[HALF_U];
        r[X] = if x < 0.0 || x >= length {
            wrapped(x, length)
        } else {
            x
        };
        r[Y] += step * r[HALF_V];
        r[U] = r[HALF_U] + du;
        r[V] = r[HALF_V] + dv;
        r[W] = r[HALF_W] + dw;
        let speed = r[HALF_U] * r[HALF_U] + r[HALF_V] * r[HALF_V];
        sum += speed + r[HALF_W];
        fastest = if speed > fastest { speed } else { fastest };
    }
    // A comparison drops NaN, a sum keeps it.
    if (sum * 0.0).is_nan() {
        f64::NAN
    } else {
        fastest.sqrt()
    }
}

/// x in [0, length), in the very step in which it left.
#[cold]
fn wrapped(x: f64, length: f64) -> f64 {
    let inside = if x < 0.0 { x + length } else { x - length };
    // x may be so little below zero that the sum rounds to the length.
    if inside >= length { 0.0 } else { inside }
}

/// Spins as well: a grain that touches nothing would turn for ever, and the sample never be at rest.
fn slow_down(grains: &mut Grains, drag: f64) {
    use field::*;
    for g in 0..grains.owned {
        let (record, mass, radius) = (&grains.record[g].0, grains.mass[g], grains.radius[g]);
        grains.force[g][0] -= drag * mass * record[U];
        grains.force[g][1] -= drag * mass * record[V];
        grains.force[g][2] -= drag * 0.5 * mass * radius * radius * record[W];
    }
}

/// v(t+Δt), in place of the predicted one.
fn second_kick(grains: &mut Grains) {
    use field::*;
    let own = grains.owned;
    for ((record, force), [linear, angular]) in grains.record[..own]
        .iter_mut()
        .zip(&grains.force)
        .zip(&grains.half_kick)
    {
        let r = &mut record.0;
        r[U] = r[HALF_U] + linear * force[0];
        r[V] = r[HALF_V] + linear * force[1];
        r[W] = r[HALF_W] + angular * force[2];
    }
}
