//! The motion of the top, along its normal and along x.

use serde::{Deserialize, Serialize};

use super::{WallForces, WallSteps};
use crate::protocol::{Lateral, Protocol, Segment};

/// The rigid body on top, along the last axis: m_w ÿ = F_y - N - c ẏ, by the Verlet scheme of the
/// grains. SI units; per unit depth in 2D. Of a cell without walls also the end of a lateral axis
/// ([`super::LateralLengths`]), whose height is the length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Piston {
    /// Upper boundary of the sample (m).
    pub height: f64,
    /// Full-step velocity upwards; between the kicks that of the half step (m/s).
    pub velocity: f64,
    /// (m/s²)
    pub acceleration: f64,
    /// m_w (kg; kg/m in 2D).
    pub mass: f64,
    /// N, downwards (N; N/m in 2D).
    pub load: f64,
}

impl Piston {
    pub(super) fn half_kick_and_drift(&mut self, step: f64) {
        self.velocity += 0.5 * step * self.acceleration;
        self.height += step * self.velocity;
    }

    /// The velocity of the full step, predicted from the last acceleration.
    pub(super) fn predicted(&self, step: f64) -> f64 {
        self.velocity + 0.5 * step * self.acceleration
    }

    /// How far (m) the top still rises against its load, if the last step left nothing that touches
    /// it; else 0.
    pub fn flight(&self) -> f64 {
        let fall = self.load / self.mass;
        // Without a force the acceleration is -N/m, to rounding.
        let is_free = self.acceleration <= -(1.0 - 1e-12) * fall;
        if is_free && self.velocity > 0.0 {
            0.5 * self.velocity * self.velocity / fall
        } else {
            0.0
        }
    }

    pub(super) fn full_kick(&mut self, step: f64, force: f64, drag: f64) {
        self.acceleration = (force - self.load) / self.mass - drag * self.predicted(step);
        self.velocity += 0.5 * step * self.acceleration;
    }

    /// The second half kick under its load, by its mass or a servo.
    pub(super) fn kick_up(&mut self, servo: Option<Servo>, step: f64, force: f64) {
        match servo {
            None => self.full_kick(step, force, 0.0),
            Some(servo) => servo.kick(self, step, force),
        }
    }

    /// Computes the acceleration under the load with which the next step begins; `jumps`: whether
    /// it is another one than that with which the last step ended.
    pub(super) fn accelerate(&mut self, servo: Option<Servo>, force: f64, jumps: bool) {
        match servo {
            None => self.acceleration = (force - self.load) / self.mass,
            Some(servo) if jumps => servo.restart(self, force),
            Some(_) => {}
        }
    }
}

/// Sets the velocity of the top along its normal from the error of the measured force, in every
/// step: v = gain (F - N), at most `fastest` either way. The top then has no mass along its normal.
///
/// A step has the velocity of its middle, extrapolated from the last two (Adams and Bashforth), so
/// the scheme is of second order. On contacts with the stiffness K and the damping constant C
/// together it is stable while gain (K Δt + 3 C) < 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Servo {
    /// (m/(s N); m²/(s N) in 2D)
    pub gain: f64,
    /// (m/s)
    pub fastest: f64,
}

impl Servo {
    fn bounded(&self, velocity: f64) -> f64 {
        velocity.clamp(-self.fastest, self.fastest)
    }

    /// Gives the piston the velocity for this force; it is constant until the next step.
    fn restart(&self, piston: &mut Piston, force: f64) {
        piston.velocity = self.bounded(self.gain * (force - piston.load));
        piston.acceleration = 0.0;
    }

    /// Gives the piston the velocity for this force, and the acceleration that the last step had.
    fn kick(&self, piston: &mut Piston, step: f64, force: f64) {
        let before = piston.velocity - 0.5 * step * piston.acceleration;
        self.restart(piston, force);
        let next = self.bounded(2.0 * piston.velocity - before);
        piston.acceleration = (next - piston.velocity) / step;
    }
}

/// The motion of the top along x.
#[derive(Debug, Clone)]
pub struct Slider {
    /// What is imposed, step by step.
    pub protocol: Protocol,
    /// The stiffness of the spring between drive and top (N/m; Pa in 2D). `None`: the top moves
    /// with the drive, or is pulled by a force of the protocol. A protocol of forces has no spring.
    pub spring: Option<f64>,
    /// Position and velocity of the top.
    pub state: SliderState,
}

/// The top along x since the start of the shear. SI units.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct SliderState {
    /// Steps done.
    pub step: u64,
    /// x (m).
    pub displacement: f64,
    /// Full-step velocity; between the kicks that of the half step (m/s).
    pub velocity: f64,
    /// (m/s²)
    pub acceleration: f64,
    /// How far it moved in the last step (m).
    pub slid: f64,
    /// How far it moved in segments in which a force pulled it (m): the position of the drive is
    /// that of the protocol plus this.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub pulled: f64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde calls it")]
pub(crate) fn is_zero(x: &f64) -> bool {
    x.to_bits() == 0
}

impl Slider {
    /// A drive that follows `protocol`. The top starts at rest with a spring or under a force, and
    /// with the velocity of the drive without one.
    pub fn new(protocol: Protocol, spring: Option<f64>) -> Self {
        let velocity = match spring {
            None => protocol.full_velocity(0),
            Some(_) => 0.0,
        };
        Self {
            protocol,
            spring,
            state: SliderState {
                velocity,
                ..SliderState::default()
            },
        }
    }

    /// Whether forces move the top in a segment.
    fn is_free(&self, segment: &Segment) -> bool {
        self.spring.is_some() || segment.is_pulled()
    }

    pub(super) fn half_kick_and_drift(&mut self, step: f64) {
        let now = self.state.step;
        let is_free = self.is_free(self.protocol.segment(now));
        let state = &mut self.state;
        let before = state.displacement;
        if is_free {
            state.velocity += 0.5 * step * state.acceleration;
            state.displacement += step * state.velocity;
            if self.spring.is_none() {
                state.pulled = state.displacement - self.protocol.position(now + 1);
            }
        } else {
            state.velocity = self.protocol.velocity(now);
            state.displacement = state.pulled + self.protocol.position(now + 1);
            state.acceleration = 0.0;
        }
        state.slid = state.displacement - before;
        state.step += 1;
    }

    /// The velocity of the full step: of the drive, or predicted from the last acceleration.
    pub(super) fn predicted(&self, step: f64) -> f64 {
        let now = self.state.step;
        if self.is_free(self.protocol.segment_before(now)) {
            self.state.velocity + 0.5 * step * self.state.acceleration
        } else {
            self.protocol.full_velocity(now)
        }
    }

    /// What pulls the top along x besides the grains in this segment: the spring or the imposed
    /// force. `None` if the top moves with the drive.
    fn pull(&self, segment: &Segment) -> Option<f64> {
        let now = self.state.step;
        match self.spring {
            Some(stiffness) => Some(stiffness * (self.drive_position() - self.state.displacement)),
            None => segment.force(now),
        }
    }

    /// Computes the acceleration at the start of a segment by the force of the grains along x.
    fn accelerate(&mut self, force: f64, mass: f64) {
        if let Some(pull) = self.pull(self.protocol.segment(self.state.step)) {
            self.state.acceleration = (pull + force) / mass;
        }
    }

    /// The second half kick by the force of the last segment; the acceleration is then that of the
    /// next one, so that a jump of the force leaves the scheme of second order.
    fn kick(&mut self, step: f64, force: f64, mass: f64) {
        let now = self.state.step;
        match self.pull(self.protocol.segment_before(now)) {
            Some(pull) => {
                self.state.acceleration = (pull + force) / mass;
                self.state.velocity += 0.5 * step * self.state.acceleration;
            }
            None => self.state.velocity = self.protocol.full_velocity(now),
        }
        self.accelerate(force, mass);
    }

    /// Position of the far end of the spring, or of the top itself (m).
    pub(crate) fn drive_position(&self) -> f64 {
        self.state.pulled + self.protocol.position(self.state.step)
    }

    /// Velocity of the far end of the spring, or of the top itself (m/s), at the end of the last
    /// step.
    pub fn drive_velocity(&self) -> f64 {
        let now = self.state.step;
        if self.protocol.segment_before(now).is_pulled() {
            self.state.velocity
        } else {
            self.protocol.full_velocity(now)
        }
    }
}

/// How the top moves, which is the upper wall or, in a cell without walls, the images above: along
/// its normal with a load N or an imposed velocity, along x by a slider. A load acts on its mass,
/// or a servo moves it.
#[derive(Debug)]
pub struct Top {
    /// The motion upwards.
    pub piston: Piston,
    /// The motion along x, and what is imposed.
    pub slider: Slider,
    /// What moves it under a load. `None`: its mass does.
    pub servo: Option<Servo>,
    /// Whether the force along x is summed in every step.
    pub along: bool,
    /// Whether the work along the normals is summed in every step, because it is not that of a
    /// constant load on a mass.
    pub normal_work: bool,
    /// How far top and bottom moved upwards in the last step (m).
    pub rose: [f64; 2],
    /// How far the bottom moved along x in the last step (m).
    pub bottom_slid: f64,
}

impl Top {
    /// `along`: whether the force along x is summed though no motion needs it.
    pub fn new(piston: Piston, slider: Slider, servo: Option<Servo>, along: bool) -> Self {
        let protocol = &slider.protocol;
        let varies = protocol.has_normal() || protocol.has_bottom_normal();
        Self {
            piston,
            servo,
            along: along || slider.spring.is_some() || protocol.has_force(),
            normal_work: varies || servo.is_some(),
            slider,
            rose: [0.0; 2],
            bottom_slid: 0.0,
        }
    }

    /// Imposes the load or the normal velocity of the start of the shear. Returns the velocities of
    /// top and bottom (m/s), along x and upwards.
    pub fn begin(&mut self) -> [[f64; 2]; 2] {
        let protocol = &self.slider.protocol;
        let first = protocol.segment(0);
        if let Some(load) = first.load(0) {
            self.piston.load = load;
        }
        if let Some(velocity) = first.normal_velocity() {
            (self.piston.velocity, self.piston.acceleration) = (velocity, 0.0);
        }
        let up = first.normal_velocity().unwrap_or(0.0);
        let bottom = protocol.full_bottom_velocity(0);
        [[self.slider.state.velocity, up], bottom]
    }

    /// Its part of the state that the digest covers.
    pub fn state(&self) -> [f64; 6] {
        let (piston, slider) = (&self.piston, &self.slider.state);
        [
            piston.height,
            piston.velocity,
            piston.acceleration,
            slider.displacement,
            slider.velocity,
            slider.acceleration,
        ]
    }

    /// Displacement of the bottom along x and upwards since the start of the shear (m).
    pub fn bottom_displacement(&self) -> [f64; 2] {
        self.slider.protocol.bottom(self.slider.state.step)
    }

    /// What is imposed at the end of the last step: the load and the force along x (N; N/m in 2D),
    /// NaN if there is none.
    pub fn imposed(&self) -> [f64; 2] {
        let now = self.slider.state.step;
        let segment = self.slider.protocol.segment_before(now);
        let load = match (segment.imposed.normal, segment.imposed.lateral) {
            (_, Some(Lateral::Isotropic)) => None,
            (None, _) => Some(self.piston.load),
            (Some(_), _) => segment.load(now),
        };
        [load, segment.force(now)].map(|force| force.unwrap_or(f64::NAN))
    }

    /// Computes the accelerations before the first step.
    pub(super) fn start(&mut self, load: WallForces) {
        let first = self.slider.protocol.segment(0);
        if first.normal_velocity().is_none() {
            self.piston.accelerate(self.servo, load.up, true);
        }
        self.slider.accelerate(load.along, self.piston.mass);
    }

    /// First half kick and drift.
    pub(super) fn drift(&mut self, step: f64) {
        self.rise(step);
        let protocol = &self.slider.protocol;
        if protocol.has_bottom_along() {
            [self.bottom_slid, _] = protocol.bottom_way(self.slider.state.step);
        }
        self.slider.half_kick_and_drift(step);
    }

    /// The velocities of the full step along x and upwards (m/s), after the drift.
    pub(super) fn predicted(&self, step: f64) -> [f64; 2] {
        let Slider {
            protocol, state, ..
        } = &self.slider;
        let up = match protocol.segment_before(state.step).normal_velocity() {
            None => self.piston.predicted(step),
            Some(velocity) => velocity,
        };
        [self.slider.predicted(step), up]
    }

    /// Second half kick, by the forces on it.
    pub(super) fn kick(&mut self, step: f64, forces: WallForces) {
        self.kick_anew(step, forces, forces.up);
    }

    /// [`Top::kick`], with another force upwards under the load of the next step.
    pub(super) fn kick_anew(&mut self, step: f64, forces: WallForces, next_up: f64) {
        self.end_rise(step, forces.up, next_up);
        self.slider.kick(step, forces.along, self.piston.mass);
    }

    /// How far it moved in the last step.
    pub(super) fn moved(&self) -> WallSteps {
        WallSteps {
            along: self.slider.state.slid,
            bottom_along: (self.slider.protocol.has_bottom_along()).then_some(self.bottom_slid),
            normal: self.normal_work.then_some(self.rose),
            lateral: [0.0; 2],
        }
    }

    /// Moves the top upwards by a step: half a kick and the drift, or at an imposed velocity.
    fn rise(&mut self, step: f64) {
        if !self.normal_work {
            self.piston.half_kick_and_drift(step);
            return;
        }
        let protocol = &self.slider.protocol;
        let now = self.slider.state.step;
        let before = self.piston.height;
        match protocol.segment(now).normal_velocity() {
            None => self.piston.half_kick_and_drift(step),
            Some(velocity) => {
                (self.piston.velocity, self.piston.acceleration) = (velocity, 0.0);
                self.piston.height += step * velocity;
            }
        }
        let [_, bottom] = protocol.bottom_way(now);
        self.rose = [self.piston.height - before, bottom];
    }

    /// The second half kick of the top upwards by the load of the last segment; load and
    /// acceleration are then those of the next one, so that a jump of the load leaves the scheme of
    /// second order.
    fn end_rise(&mut self, step: f64, force: f64, next_force: f64) {
        let protocol = &self.slider.protocol;
        if !protocol.has_normal() {
            self.piston.kick_up(self.servo, step, force);
            return;
        }
        let now = self.slider.state.step;
        let (last, next) = (protocol.segment_before(now), protocol.segment(now));
        let [last_load, next_load] = [last, next].map(|segment| segment.load(now));
        match last.normal_velocity() {
            None => {
                self.piston.load = last_load.unwrap_or(self.piston.load);
                self.piston.kick_up(self.servo, step, force);
            }
            Some(velocity) => {
                (self.piston.velocity, self.piston.acceleration) = (velocity, 0.0);
            }
        }
        if let Some(load) = next_load {
            self.piston.load = load;
            let jumps = last_load != next_load;
            self.piston.accelerate(self.servo, next_force, jumps);
        }
    }
}
