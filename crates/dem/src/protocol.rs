//! What is imposed on the walls: a sequence of segments, each for a whole number of steps. Every
//! imposed value is a closed form of the step, so nothing accumulates and nothing needs to be
//! saved.

mod imposed;

use std::f64::consts::TAU;

use crate::until::Until;
use crate::wave::Wave;

pub use imposed::{Along, Course, Imposed, Lateral, LateralAxis, Normal, Ramp, Vibration};

/// What is imposed on the walls, step by step.
#[derive(Debug, Clone, PartialEq)]
pub struct Protocol {
    /// Δt (s).
    step: f64,
    /// At least one.
    segments: Vec<Segment>,
    has_normal: bool,
    /// Whether the bottom vibrates along x, and along its normal.
    has_bottom: [bool; 2],
}

/// Steps of one kind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Steps before it.
    pub first: u64,
    /// Steps in it.
    pub steps: u64,
    /// Steps that were planned: more, if a condition has ended it. What is imposed follows these.
    pub planned: u64,
    /// What is imposed.
    pub imposed: Imposed,
    /// Position of the drive at its start (m), if the drive stood still in segments of a force.
    pub position: f64,
    /// Displacement of the bottom along x and its normal at its start (m).
    pub bottom: [f64; 2],
}

/// A part of the protocol of a scene. It does not depend on the sample and its time step:
/// amplitudes along x are those of γ, forces are stresses (Pa), and frequencies are per second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// What is imposed, in these units.
    pub imposed: Imposed,
    /// Duration (s), the longest if a condition may end it.
    pub time: f64,
    /// What ends it before.
    pub until: Option<Until>,
}

impl Part {
    /// What it imposes on a layer of this height (m) between walls of this length (m; in 3D area,
    /// m²), in steps of Δt = `step` (s).
    pub fn on_layer(&self, height: f64, base: f64, step: f64) -> Imposed {
        let wave = |wave: Wave, unit: f64| Wave {
            amplitude: wave.amplitude * unit,
            frequency: wave.frequency * step,
            ..wave
        };
        let course = |course: Course| Course {
            from: course.from * base,
            to: course.to * base,
            wave: course.wave.map(|of_course| wave(of_course, base)),
        };
        Imposed {
            along: match self.imposed.along {
                Along::Velocity(velocity) => Along::Velocity(velocity),
                Along::Ramp(ramp) => Along::Ramp(Ramp {
                    time: ramp.time / step,
                    ..ramp
                }),
                Along::Oscillation(strain) => Along::Oscillation(wave(strain, height)),
                Along::Force(stress) => Along::Force(course(stress)),
            },
            normal: self.imposed.normal.map(|normal| match normal {
                Normal::Load(pressure) => Normal::Load(course(pressure)),
                Normal::Velocity(velocity) => Normal::Velocity(velocity),
            }),
            bottom: Vibration {
                along: self.imposed.bottom.along.map(|x| wave(x, 1.0)),
                normal: self.imposed.bottom.normal.map(|height| wave(height, 1.0)),
            },
            lateral: self.imposed.lateral,
        }
    }

    /// The greatest speed (m/s) of the drive of a layer of this height (m); 0 under a stress.
    pub fn speed(&self, height: f64) -> f64 {
        match self.imposed.along {
            Along::Velocity(velocity) => velocity.abs(),
            Along::Ramp(ramp) => ramp.fastest(),
            Along::Oscillation(of) => TAU * of.frequency * of.amplitude * height,
            Along::Force(_) => 0.0,
        }
    }

    /// The greatest frequency (Hz) in it; 0 if there is none.
    pub fn highest_frequency(&self) -> f64 {
        let along = match self.imposed.along {
            Along::Velocity(_) | Along::Ramp(_) => None,
            Along::Oscillation(wave) => Some(wave),
            Along::Force(stress) => stress.wave,
        };
        let normal = match self.imposed.normal {
            Some(Normal::Load(pressure)) => pressure.wave,
            _ => None,
        };
        let bottom = self.imposed.bottom;
        let waves = [along, normal, bottom.along, bottom.normal];
        let waves = waves.into_iter().flatten();
        waves.map(|wave| wave.frequency).fold(0.0, f64::max)
    }
}

impl Segment {
    /// Puts it after another one, in steps of Δt = `step` (s).
    fn put_after(&mut self, before: &Self, step: f64) {
        self.first = before.first + before.steps;
        self.bottom = before.bottom(self.first);
        self.position = before.position(self.first, step);
    }

    /// The velocity of the drive (m/s), that to which it is ramped; `None` if it has none.
    pub fn velocity(&self) -> Option<f64> {
        match self.imposed.along {
            Along::Velocity(velocity) => Some(velocity),
            Along::Ramp(ramp) => Some(ramp.to),
            Along::Oscillation(_) | Along::Force(_) => None,
        }
    }

    /// Whether the top is free along x, and pulled by a force.
    pub fn is_pulled(&self) -> bool {
        matches!(self.imposed.along, Along::Force(_))
    }

    /// The force that pulls the top (N; N/m in 2D) after so many steps of the protocol, if it is
    /// free.
    pub fn force(&self, step: u64) -> Option<f64> {
        match &self.imposed.along {
            Along::Force(course) => Some(course.at(step - self.first, self.planned)),
            _ => None,
        }
    }

    /// The load (N; N/m in 2D) after so many steps of the protocol, if one is imposed.
    pub fn load(&self, step: u64) -> Option<f64> {
        match &self.imposed.normal {
            Some(Normal::Load(course)) => Some(course.at(step - self.first, self.planned)),
            _ => None,
        }
    }

    /// The velocity of the top along its normal (m/s), if it is imposed.
    pub fn normal_velocity(&self) -> Option<f64> {
        match self.imposed.normal {
            Some(Normal::Velocity(velocity)) => Some(velocity),
            _ => None,
        }
    }

    fn position(&self, step: u64, dt: f64) -> f64 {
        let done = step - self.first;
        match &self.imposed.along {
            Along::Velocity(velocity) => self.position + velocity * (done as f64 * dt),
            Along::Ramp(ramp) => self.position + ramp.distance(done as f64) * dt,
            Along::Oscillation(wave) => self.position + wave.at(done),
            Along::Force(_) => self.position,
        }
    }

    fn bottom(&self, step: u64) -> [f64; 2] {
        let done = step - self.first;
        let mut bottom = self.bottom;
        for (at, wave) in bottom.iter_mut().zip(self.imposed.bottom.axes()) {
            if let Some(wave) = wave {
                *at += wave.at(done);
            }
        }
        bottom
    }
}

impl Protocol {
    /// A protocol of velocities (m/s) with their numbers of steps, at least one; Δt is `step` (s).
    pub fn new(step: f64, parts: impl IntoIterator<Item = (f64, u64)>) -> Self {
        let velocity = |(velocity, steps)| (Along::Velocity(velocity).into(), steps);
        Self::of(step, parts.into_iter().map(velocity))
    }

    /// A protocol of segments with their numbers of steps, at least one; Δt is `step` (s).
    pub fn of(step: f64, parts: impl IntoIterator<Item = (Imposed, u64)>) -> Self {
        let mut segments: Vec<Segment> = Vec::new();
        for (imposed, steps) in parts {
            let mut segment = Segment {
                first: 0,
                steps,
                planned: steps,
                imposed,
                position: 0.0,
                bottom: [0.0; 2],
            };
            if let Some(last) = segments.last() {
                segment.put_after(last, step);
            }
            segments.push(segment);
        }
        let vibrates = |axis: usize| {
            let mut bottoms = segments.iter().map(|s| s.imposed.bottom.axes());
            bottoms.any(|axes| axes[axis].is_some())
        };
        Self {
            step,
            has_normal: segments.iter().any(|s| s.imposed.normal.is_some()),
            has_bottom: [0, 1].map(vibrates),
            segments,
        }
    }

    /// Ends a segment after so many of its steps, at least one; those after it follow at once.
    pub fn end(&mut self, segment: usize, steps: u64) {
        self.segments[segment].steps = steps;
        for next in segment + 1..self.segments.len() {
            let (before, after) = self.segments.split_at_mut(next);
            after[0].put_after(&before[next - 1], self.step);
        }
    }

    /// The segments, one after the other.
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }

    /// Whether it imposes the load, or the velocity along the normal of the top.
    pub fn has_normal(&self) -> bool {
        self.has_normal
    }

    /// Whether the lengths of the cell across its height change.
    pub fn has_lateral(&self) -> bool {
        let mut segments = self.segments.iter();
        segments.any(|segment| segment.imposed.lateral.is_some())
    }

    /// Whether the bottom vibrates.
    pub fn has_bottom(&self) -> bool {
        self.has_bottom != [false; 2]
    }

    /// Whether it does so along x.
    pub fn has_bottom_along(&self) -> bool {
        self.has_bottom[0]
    }

    /// Whether it does so along its normal.
    pub fn has_bottom_normal(&self) -> bool {
        self.has_bottom[1]
    }

    /// Whether some segment imposes a force along x.
    pub fn has_force(&self) -> bool {
        self.segments.iter().any(Segment::is_pulled)
    }

    /// Whether it imposes more than velocities along x.
    pub(crate) fn is_more_than_velocities(&self) -> bool {
        let velocities = self.segments.iter().all(|s| s.velocity().is_some());
        !velocities || self.has_normal || self.has_bottom()
    }

    /// The greatest speed of a wall (m/s) that a segment imposes, or a bound of it: forces impose
    /// none. A drive that pulls a spring counts as a wall.
    pub fn fastest(&self) -> f64 {
        let of_wave = |wave: Wave| TAU * (wave.amplitude * wave.frequency / self.step).abs();
        let of_segment = |segment: &Segment| {
            let Imposed {
                along,
                normal,
                bottom,
                // They move by little in a step.
                lateral: _,
            } = segment.imposed;
            let along = match along {
                Along::Velocity(velocity) => velocity.abs(),
                Along::Ramp(ramp) => ramp.fastest(),
                Along::Oscillation(wave) => of_wave(wave),
                Along::Force(_) => 0.0,
            };
            let normal = match normal {
                Some(Normal::Velocity(velocity)) => velocity,
                _ => 0.0,
            };
            let [bottom_along, bottom_normal] = bottom.axes().map(|wave| wave.map_or(0.0, of_wave));
            let squared = |along: f64, normal: f64| along * along + normal * normal;
            squared(along, normal)
                .max(squared(bottom_along, bottom_normal))
                .sqrt()
        };
        self.segments.iter().map(of_segment).fold(0.0, f64::max)
    }

    /// Steps of all segments.
    pub fn steps(&self) -> u64 {
        self.segments.iter().map(|s| s.steps).sum()
    }

    /// The number of the segment that holds the step after `step` steps.
    pub fn segment_of(&self, step: u64) -> usize {
        self.segments.partition_point(|s| s.first <= step).max(1) - 1
    }

    /// The segment that holds the step after `step` steps.
    pub fn segment(&self, step: u64) -> &Segment {
        &self.segments[self.segment_of(step)]
    }

    /// The segment that holds the last of `step` steps.
    pub fn segment_before(&self, step: u64) -> &Segment {
        self.segment(step.saturating_sub(1))
    }

    /// Velocity of the drive (m/s) in the step after `step` steps: that of the half step. 0 in
    /// segments of a force.
    pub fn velocity(&self, step: u64) -> f64 {
        let segment = self.segment(step);
        match segment.imposed.along {
            Along::Velocity(velocity) => velocity,
            Along::Ramp(ramp) => {
                let done = (step - segment.first) as f64;
                ramp.velocity_in_step(done)
            }
            Along::Oscillation(_) => (self.position(step + 1) - self.position(step)) / self.step,
            Along::Force(_) => 0.0,
        }
    }

    /// Velocity of the drive (m/s) at the end of the last of `step` steps. 0 in segments of a
    /// force.
    pub fn full_velocity(&self, step: u64) -> f64 {
        let segment = self.segment_before(step);
        match &segment.imposed.along {
            Along::Velocity(velocity) => *velocity,
            Along::Ramp(ramp) => ramp.velocity((step - segment.first) as f64),
            Along::Oscillation(wave) => wave.rate(step - segment.first, self.step),
            Along::Force(_) => 0.0,
        }
    }

    /// Position of the drive (m) after `step` steps, if it stands still in segments of a force.
    pub fn position(&self, step: u64) -> f64 {
        self.segment(step).position(step, self.step)
    }

    /// Displacement of the bottom along x and its normal (m) after `step` steps.
    pub fn bottom(&self, step: u64) -> [f64; 2] {
        self.segment(step).bottom(step)
    }

    /// How far the bottom moves along x and its normal (m) in the step after `step` steps.
    pub(crate) fn bottom_way(&self, step: u64) -> [f64; 2] {
        let [begin, end] = [step, step + 1].map(|step| self.bottom(step));
        [end[0] - begin[0], end[1] - begin[1]]
    }

    /// Velocity of the bottom along x and its normal (m/s) in the step after `step` steps.
    pub(crate) fn bottom_velocity(&self, step: u64) -> [f64; 2] {
        self.bottom_way(step).map(|way| way / self.step)
    }

    /// Velocity of the bottom along x and its normal (m/s) at the end of the last of `step` steps.
    pub(crate) fn full_bottom_velocity(&self, step: u64) -> [f64; 2] {
        let segment = self.segment_before(step);
        let done = step - segment.first;
        let rate = |wave: Wave| wave.rate(done, self.step);
        let axes = segment.imposed.bottom.axes();
        axes.map(|wave| wave.map_or(0.0, rate))
    }

    /// Whether both impose the same in the first `steps` steps, up to the rounding of positions.
    pub fn agrees(&self, other: &Self, steps: u64) -> bool {
        let both = [self, other];
        let turns = both.iter().flat_map(|schedule| schedule.segments.iter());
        let turns = turns.map(|s| s.first).filter(|first| *first < steps);
        turns.into_iter().all(|at| {
            let [one, two] = both.map(|schedule| schedule.segment(at));
            let same_start = one.first == two.first;
            let course = |one: &Course, two: &Course| {
                one == two && same_start && (one.from == one.to || one_length(self, other, at))
                    || one == two && one.from == one.to && one.wave.is_none()
            };
            let along = match (&one.imposed.along, &two.imposed.along) {
                // Their positions tell.
                (Along::Velocity(_), Along::Velocity(_)) => true,
                (Along::Ramp(one), Along::Ramp(two)) => one == two && same_start,
                (Along::Oscillation(one), Along::Oscillation(two)) => one == two && same_start,
                (Along::Force(one), Along::Force(two)) => course(one, two),
                _ => false,
            };
            let normal = match (&one.imposed.normal, &two.imposed.normal) {
                (None, None) => true,
                (Some(Normal::Load(one)), Some(Normal::Load(two))) => course(one, two),
                // A protocol that goes on with other loads: the one before had a constant load.
                (None, Some(Normal::Load(one))) | (Some(Normal::Load(one)), None) => {
                    one.from == one.to && one.wave.is_none()
                }
                (one, two) => one == two,
            };
            let bottom = one.imposed.bottom == two.imposed.bottom
                && (!one.imposed.bottom.is_some() || same_start);
            let lateral = same_lateral(&one.imposed, &two.imposed, course)
                && (one.imposed.lateral.is_none() || same_start);
            along && normal && bottom && lateral
        })
    }
}

/// Whether both impose the same across the height of a cell; `same_course`: whether two stresses
/// do.
fn same_lateral(
    one: &Imposed,
    two: &Imposed,
    same_course: impl Fn(&Course, &Course) -> bool,
) -> bool {
    let (Some(Lateral::Axes(one)), Some(Lateral::Axes(two))) = (one.lateral, two.lateral) else {
        return one.lateral == two.lateral;
    };
    one.iter().zip(&two).all(|axes| match axes {
        (LateralAxis::Stress(one), LateralAxis::Stress(two)) => same_course(one, two),
        (one, two) => one == two,
    })
}

/// Whether the segments of the step after `at` steps were planned with the same length.
fn one_length(one: &Protocol, other: &Protocol, at: u64) -> bool {
    one.segment(at).planned == other.segment(at).planned
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 1e-3;

    fn wave(amplitude: f64, frequency: f64) -> Wave {
        Wave {
            amplitude,
            frequency,
            phase: 0.0,
        }
    }

    /// A push, one and a half cycles and a quarter, a force, and a push again.
    fn mixed() -> Protocol {
        let force = Course {
            from: 1.0,
            to: 3.0,
            wave: None,
        };
        Protocol::of(
            STEP,
            [
                (Along::Velocity(2.0).into(), 10),
                (Along::Oscillation(wave(0.5, 0.0125)).into(), 140),
                (Along::Force(force).into(), 8),
                (Along::Velocity(2.0).into(), 5),
            ],
        )
    }

    #[test]
    fn positions_are_closed_forms_and_continuous() {
        let protocol = mixed();
        assert_eq!(protocol.position(10), 0.02);
        // A quarter and 3/4 of a cycle.
        assert_eq!(protocol.position(30), 0.52);
        assert_eq!(protocol.position(70), 0.02 - 0.5);
        assert_eq!(protocol.position(150), 0.02 - 0.5);
        assert_eq!(protocol.position(157), 0.02 - 0.5);
        assert_eq!(protocol.position(160), 0.02 - 0.5 + 2.0 * (2.0 * STEP));
        for step in 0..protocol.steps() {
            let [here, next] = [step, step + 1].map(|k| protocol.position(k));
            let moved = protocol.velocity(step) * STEP;
            assert!((next - here - moved).abs() < 1e-15, "{step}");
        }
    }

    /// The position of a ramped drive is the integral of its velocity, from whatever it starts, and
    /// the mean velocities of the steps add up to it.
    #[test]
    fn a_ramp_moves_by_its_integral() {
        for (from, to, time) in [(0.0, 2.0, 8.0), (2.0, -1.0, 12.5), (-1.0, 0.0, 0.3)] {
            let ramp = Ramp { from, to, time };
            let parts = [
                (Along::Velocity(from).into(), 3),
                (Along::Ramp(ramp).into(), 20),
                (Along::Velocity(to).into(), 5),
            ];
            let protocol = Protocol::of(STEP, parts);
            let mut summed = 0.0;
            for step in 0..=protocol.steps() {
                let t = step.saturating_sub(3) as f64 * STEP;
                let ramped = t.min(time * STEP);
                let expected = from * (step.min(3) as f64 * STEP)
                    + from * ramped
                    + 0.5 * (to - from) * ramped * ramped / (time * STEP)
                    + to * (t - ramped);
                assert!((protocol.position(step) - expected).abs() < 1e-16, "{step}");
                assert!((summed - expected).abs() < 1e-16, "{step}");
                let velocity = from + (to - from) * ramped / (time * STEP);
                assert!((protocol.full_velocity(step) - velocity).abs() < 1e-15);
                if step < protocol.steps() {
                    summed += protocol.velocity(step) * STEP;
                }
            }
            assert_eq!(protocol.velocity(22), to);
            assert!(!protocol.is_more_than_velocities());
            assert!(protocol.fastest() == f64::max(from.abs(), to.abs()));
        }
    }

    /// No step of the mixed protocol moves the drive faster, and some step does so about as fast.
    #[test]
    fn the_fastest_step_is_bounded() {
        let protocol = mixed();
        let steps = 0..protocol.steps();
        let found = steps
            .map(|k| protocol.velocity(k).abs())
            .fold(0.0, f64::max);
        let bound = protocol.fastest();
        assert!(found <= bound && bound < 1.01 * found, "{found}, {bound}");
    }

    #[test]
    fn a_ramp_ends_at_its_value_to_the_last_bit() {
        let protocol = mixed();
        assert_eq!(protocol.segment(150).force(150), Some(1.0));
        assert_eq!(protocol.segment(150).force(152), Some(1.5));
        assert_eq!(protocol.segment_before(158).force(158), Some(3.0));
        assert_eq!(protocol.segment(158).force(158), None);
        let course = Course {
            from: 0.1,
            to: 0.7,
            wave: Some(wave(0.05, 0.25)),
        };
        assert_eq!(course.at(7, 7), 0.7 - 0.05);
    }

    /// A segment that ends early follows its course up to there, and the next ones begin there.
    #[test]
    fn a_segment_ends_early() {
        let whole = mixed();
        let mut protocol = mixed();
        protocol.end(1, 20);
        assert_eq!(protocol.steps(), whole.steps() - 120);
        for step in 0..=30 {
            assert_eq!(protocol.position(step), whole.position(step), "{step}");
        }
        // The drive stays at a quarter of its cycle.
        assert_eq!(protocol.position(38), whole.position(30));
        for done in 0..8 {
            let [found, expected] = [(&protocol, 30), (&whole, 150)]
                .map(|(of, first)| of.segment(first + done).force(first + done));
            assert_eq!(found, expected, "{done}");
        }
        protocol.end(2, 4);
        // Half of the ramp, from 1 to 3.
        assert_eq!(protocol.segment_before(34).force(34), Some(2.0));
        let last = protocol.segments()[3];
        assert_eq!((last.first, last.steps), (34, 5));
        assert_eq!(
            protocol.position(39),
            protocol.position(34) + 2.0 * (5.0 * STEP)
        );
        assert!(protocol.agrees(&protocol, 39) && !protocol.agrees(&whole, 39));
    }

    #[test]
    fn protocols_that_go_on_agree() {
        let one = mixed();
        assert!(one.agrees(&one, 163));
        let mut parts: Vec<_> = one
            .segments()
            .iter()
            .map(|s| (s.imposed, s.steps))
            .collect();
        parts[3].1 = 50;
        assert!(one.agrees(&Protocol::of(STEP, parts.clone()), 163));
        parts[2].1 = 9;
        let longer_ramp = Protocol::of(STEP, parts.clone());
        assert!(one.agrees(&longer_ramp, 150) && !one.agrees(&longer_ramp, 151));
        parts[1].0 = Along::Oscillation(wave(0.5, 0.0126)).into();
        let faster = Protocol::of(STEP, parts);
        assert!(one.agrees(&faster, 10) && !one.agrees(&faster, 11));
    }
}
