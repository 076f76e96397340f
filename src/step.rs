//! The time step: read this first.
//!
//! Velocity Verlet with positions at t+Δt and velocities at t+½Δt when the forces are computed. Damping forces take the
//! full-step velocity predicted from the last acceleration, so the scheme stays second order with damping (physics.md).

use std::ops::Range;

use crate::clock::Phase;
use crate::contact::ContactLaw;
use crate::domain::{Accumulator, Exchange, LIMBS};
use crate::drive::Drive;
use crate::failure::Failure;
use crate::kernel::{ContactForces, Found};
use crate::ledger::Ledger;
use crate::simd::{Lanes, Record, Work};
use crate::state::{Grains, field};
use crate::system::System;
use crate::team::{Own, Setting};

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
    let (level, length) = (system.level, system.length);
    let fastest = system.team.greatest(&mut system.grains, |own| {
        level.run(HalfKickAndDrift { own, step, length })
    });
    drive.predict(step, &mut system.grains);
    let rebuild = system.list.moved(
        fastest.max(drive.speed()),
        step,
        &system.grains,
        system.length,
    );
    system.clock.end(Phase::Motion);

    let outside = forces(exchange, system, law, drive, step, samples);

    let rebuild = rebuild || system.list.forced(system.steps);
    let mut message = Message::new(system, drive, outside, [rebuild, stop]);
    exchange.sum_during(&mut message.0, || {
        if D::DRAG {
            slow_down(&mut system.grains, drive.drag());
        }
        system
            .team
            .greatest(&mut system.grains, |own| level.run(SecondKick(own)));
        system.clock.end(Phase::Motion);
    });
    let (load, [due, stop]) = message.read(exchange, system, outside)?;
    system.list.due = due;
    system.clock.end(Phase::Walls);

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
    let outside = forces(exchange, system, law, drive, 0.0, samples);
    let mut message = Message::new(system, drive, outside, []);
    exchange.sum_during(&mut message.0, || ());
    let (load, []) = message.read(exchange, system, outside)?;
    drive.piston_mut().start(load);
    Ok(())
}

/// All that the ranks must agree on in a step, to be added up: the force on the top along y, whether something failed, and K
/// questions that are answered with yes where some rank says so.
struct Message<const K: usize>([i64; LIMBS + 4]);

/// Size of it.
pub const MESSAGE_BYTES: usize = size_of::<Message<2>>();

impl<const K: usize> Message<K> {
    fn new(
        system: &System,
        drive: &impl Drive,
        outside: Option<Outside>,
        questions: [bool; K],
    ) -> Self {
        let mut load = Accumulator::default();
        drive.load(&system.grains, &system.fixed, &mut load);
        let mut message = [0i64; LIMBS + 4];
        load.write(&mut message);
        message[LIMBS + 1] = outside.is_some() as i64;
        for (to, yes) in message[LIMBS + 2..].iter_mut().zip(questions) {
            *to = yes as i64;
        }
        Self(message)
    }

    /// The force (N/m) and the answers.
    fn read(
        &self,
        exchange: &impl Exchange,
        system: &System,
        outside: Option<Outside>,
    ) -> Result<(f64, [bool; K]), Failure> {
        let load = system.fixed.value(Accumulator::read(&self.0));
        if self.0[LIMBS + 1] > 0 || load.is_nan() {
            return Err(system.explain(exchange, outside));
        }
        Ok((load, std::array::from_fn(|k| self.0[LIMBS + 2 + k] > 0)))
    }
}

/// All forces at the present positions, those of inner contacts while the ghosts' records are on their way; histories advance by
/// `step` (s). Returns what was outside the law.
pub fn forces<C: ContactLaw, D: Drive, E: Exchange>(
    exchange: &E,
    system: &mut System,
    law: &C,
    drive: &mut D,
    step: f64,
    mut samples: Option<&mut ContactForces>,
) -> Option<Outside> {
    let System {
        level,
        length,
        grains,
        contacts,
        slabs,
        clock,
        list,
        team,
        ledger,
        ..
    } = system;
    team.clear(&mut grains.force);
    let at_plane = drive.forces(*level, *length, step, grains);
    if let Some(samples) = &mut samples {
        samples.prepare(contacts.blocks());
    }
    let setting = Setting {
        level: *level,
        law,
        unit: grains.unit,
        length: *length,
        step,
        energy_unit: ledger.as_ref().map(Ledger::unit),
    };
    let (inner, all) = (contacts.inner, contacts.blocks());
    let (record, force) = (&mut grains.record, &mut grains.force);
    let mut work = |record: &[Record], group: Range<usize>| {
        let samples = samples.as_deref_mut();
        team.contact_forces(setting, record, force, contacts, group, samples)
    };
    let mut found = Found::default();
    slabs.exchange(exchange, record, grains.owned, |own| {
        clock.end(Phase::Exchange);
        found = work(own, 0..inner);
        clock.end(Phase::Contacts);
    });
    clock.end(Phase::Exchange);
    found = found.and(work(record, inner..all));
    team.gather(&mut grains.force);
    clock.end(Phase::Contacts);

    if let Some(ledger) = ledger {
        ledger.step(found.lost, drive.pull(grains));
    }
    let pair = |at: Option<(usize, usize)>, why: fn(usize, usize) -> Outside| {
        at.map(|(block, lane)| why(block, lane))
    };
    let at_pair = pair(found.outside, Outside::Pair).or(pair(found.too_strong, Outside::Force));
    let unsound = list.unsound.then_some(Outside::Number);
    at_plane.map(Outside::Plane).or(at_pair).or(unsound)
}

/// Where the numbers failed, as this rank knows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outside {
    /// This grain overlaps a plane too much.
    Plane(usize),
    /// The contact in this block and lane overlaps too much.
    Pair(usize, usize),
    /// The force of the contact in this block and lane is greater than any that the law should have.
    Force(usize, usize),
    /// A position or velocity is no number, or a grain moved further than the list allows.
    Number,
}

/// v(t+½Δt), x(t+Δt) wrapped along x, and the predicted v(t+Δt). Returns the greatest speed (m/s), NaN where one is none.
struct HalfKickAndDrift<'a> {
    own: Own<'a>,
    step: f64,
    length: f64,
}

impl Work for HalfKickAndDrift<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Lanes>(self, _: L::Token) -> f64 {
        use field::*;
        let Self { own, step, length } = self;
        let mut fastest = 0.0f64;
        let mut sum = 0.0;
        let grains = own.record.iter_mut().zip(own.force).zip(own.half_kick);
        for ((record, force), kick) in grains {
            let r = &mut record.0;
            let [linear, angular] = *kick;
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
struct SecondKick<'a>(Own<'a>);

impl Work for SecondKick<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Lanes>(self, _: L::Token) -> f64 {
        use field::*;
        let own = self.0;
        let grains = own.record.iter_mut().zip(own.force).zip(own.half_kick);
        for ((record, force), kick) in grains {
            let r = &mut record.0;
            let [linear, angular] = *kick;
            r[U] = r[HALF_U] + linear * force[0];
            r[V] = r[HALF_V] + linear * force[1];
            r[W] = r[HALF_W] + angular * force[2];
        }
        0.0
    }
}
