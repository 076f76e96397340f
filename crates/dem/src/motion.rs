//! The motion of the grains in a step, and the forces that no contact makes: weight and drag.

use bytemuck::Zeroable;

use crate::dimension::Dimension;
use crate::drive::{FlowSum, Streaming, WallGrains, WallMotion};
use crate::simd::{Isa, Lanes, Work};
use crate::state::{Cell, Grains, Units, body};
use crate::threads::OwnedPart;

/// Computes v(t+½Δt), x(t+Δt) wrapped into the cell, and the predicted v(t+Δt); clears the forces.
/// Returns the greatest speed (m/s), or NaN if one is NaN, and the flow of momentum where grains
/// stream. `SECOND_KICK_DEFERRED`: gives the deferred second kick of the last step first.
/// `STREAMS`: grains do what [`Drive::streaming`] says.
struct HalfKickAndDrift<'a, D: Dimension, const SECOND_KICK_DEFERRED: bool, const STREAMS: bool> {
    part: OwnedPart<'a, D>,
    motion: GrainMotion,
}

/// What moves the grains in a step beside the forces.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GrainMotion {
    /// The instruction set.
    pub isa: Isa,
    /// The units to which forces are rounded.
    pub units: Units,
    /// g (m/s²) along x, and against the last axis.
    pub gravity: [f64; 2],
    /// Δt (s).
    pub step: f64,
    /// The cell.
    pub cell: Cell,
    /// What they do beside their own motion.
    pub streaming: Option<Streaming>,
    /// Whether the flow of momentum is needed.
    pub is_stressed: bool,
    /// How the grains of walls move.
    pub walls: Option<WallMotion>,
}

/// What the motion of some grains found.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moved {
    /// The greatest speed (m/s), or NaN if one is NaN.
    pub fastest: f64,
    /// The flow of momentum where grains stream.
    pub flow: FlowSum,
}

impl GrainMotion {
    /// Moves some grains, which then have no force but their weight. `second_kick_deferred`: gives
    /// the second kick of the last step first.
    pub(crate) fn advance<D: Dimension>(
        &self,
        second_kick_deferred: bool,
        mut part: OwnedPart<'_, D>,
    ) -> Moved {
        let (motion, isa) = (*self, self.isa);
        let moved = part.reborrow();
        let (fastest, flow) = match (second_kick_deferred, motion.streaming.is_some()) {
            (true, false) => isa.run(HalfKickAndDrift::<_, true, false> {
                part: moved,
                motion,
            }),
            (false, false) => isa.run(HalfKickAndDrift::<_, false, false> {
                part: moved,
                motion,
            }),
            (true, true) => isa.run(HalfKickAndDrift::<_, true, true> {
                part: moved,
                motion,
            }),
            (false, true) => isa.run(HalfKickAndDrift::<_, false, true> {
                part: moved,
                motion,
            }),
        };
        weigh::<D>(part.force, part.mass, part.body, self.units, self.gravity);
        Moved { fastest, flow }
    }

    /// Gives grains of walls the velocities with which they move, also as those of the half step,
    /// from which the deferred second kick starts.
    pub(crate) fn give_first<D: Dimension>(
        &self,
        walls: WallGrains<'_>,
        first: usize,
        record: &mut [D::Record],
    ) {
        if let Some(motion) = self.walls {
            let at = [D::VELOCITY, D::HALF_VELOCITY];
            motion.moving.give::<D>(walls, &at, first, record);
        }
    }

    /// Gives grains of walls that have moved their predicted velocities.
    pub(crate) fn give_predicted<D: Dimension>(
        &self,
        walls: WallGrains<'_>,
        first: usize,
        record: &mut [D::Record],
    ) {
        if let Some(motion) = self.walls {
            let at = [D::VELOCITY];
            motion.predicted.give::<D>(walls, &at, first, record);
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
    let height = r[D::UP];
    if let Some(streaming) = streaming {
        r[D::UP] *= streaming.stretches[0];
    }
    if let Some(lateral) = streaming.and_then(|streaming| streaming.lateral) {
        r[D::UP] += step * v[D::UP];
        lateral.drift::<D>(r, &v, height, step);
    } else {
        for axis in 0..D::AXES {
            r[axis] += step * v[axis];
        }
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

/// The greater one, or NaN.
pub(crate) fn greater_or_nan(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() { b } else { a }
}

/// Gives free grains without any other force their weights, rounded like the contact forces.
pub(crate) fn weigh<D: Dimension>(
    force: &mut [D::Force],
    mass: &[f64],
    body: &[u32],
    units: Units,
    gravity: [f64; 2],
) {
    if gravity == [0.0; 2] {
        return;
    }
    let [along, down] = gravity;
    let shift = Units::shift(units.force);
    for ((force, mass), belongs_to) in force.iter_mut().zip(mass).zip(body) {
        if *belongs_to == body::FREE {
            force[0] = (shift + mass * along) - shift;
            force[D::UP] = (shift - mass * down) - shift;
        }
    }
}

/// Adds the drag (1/s) on translations and on rotations.
pub(crate) fn slow_down<D: Dimension>(grains: &mut Grains<D>, drag: [f64; 2]) {
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
