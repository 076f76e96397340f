//! The walls and their drive: smooth planes during packing, frozen grains during shear.

use bytemuck::Zeroable;
use serde::{Deserialize, Serialize};

use crate::dimension::Dimension;
use crate::domain::{Accumulator, FixedPoint};
use crate::kernel::{PairForce, Pass, Scratch};
use crate::protocol::{Protocol, Segment};
use crate::simd::Isa;
use crate::state::{CandidatePair, Cell, Contacts, Grains, LocalGrains, Remembered, body};

/// The rigid body on top, along the last axis: m_w ÿ = F_y - N - c ẏ, by the Verlet scheme of the
/// grains. SI units; per unit depth in 2D.
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
    fn half_kick_and_drift(&mut self, step: f64) {
        self.velocity += 0.5 * step * self.acceleration;
        self.height += step * self.velocity;
    }

    /// The velocity of the full step, predicted from the last acceleration.
    fn predicted(&self, step: f64) -> f64 {
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

    fn full_kick(&mut self, step: f64, force: f64, drag: f64) {
        self.acceleration = (force - self.load) / self.mass - drag * self.predicted(step);
        self.velocity += 0.5 * step * self.acceleration;
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

/// The forces of the grains on the walls (N; N/m in 2D). What the drive does not ask for is 0.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WallForces {
    /// On the top upwards, along the last axis.
    pub up: f64,
    /// On the top along x.
    pub along: f64,
    /// On the bottom upwards.
    pub bottom: f64,
}

/// How far the walls moved in the last step (m).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WallSteps {
    /// The top along x.
    pub along: f64,
    /// The top and the bottom upwards, if the work along the normals is summed step by step.
    pub normal: Option<[f64; 2]>,
}

/// The walls and the drag, as the time step calls them. The default methods are those of a scene
/// without walls.
pub trait Drive<D: Dimension> {
    /// The drag c (1/s) on translations and on rotations: forces -c m v and torques -c I ω.
    fn drag(&self) -> Option<[f64; 2]> {
        None
    }
    /// The greatest speed of a wall (m/s).
    fn speed(&self) -> f64 {
        0.0
    }
    /// Computes the accelerations before the first step.
    fn start(&mut self, _: WallForces) {}
    /// First half kick and drift of the walls.
    fn drift(&mut self, _step: f64, _: &mut Grains<D>) {}
    /// Gives the wall grains their predicted velocities, after the drift.
    fn predict(&mut self, _step: f64, _: &mut Grains<D>) {}
    /// Adds forces of the walls on the grains that are not contacts between grains. Returns a grain
    /// whose overlap is outside the law.
    fn forces(&mut self, _: Isa, _: Cell, _step: f64, _: &mut Grains<D>) -> Option<usize> {
        None
    }
    /// Whether the force on the bottom is summed too.
    fn has_bottom_force(&self) -> bool {
        false
    }
    /// Adds this rank's part of the forces on the walls: on the top upwards and along x, on the
    /// bottom upwards.
    fn load(&self, _: &Grains<D>, _: &FixedPoint, _to: &mut [Accumulator; 3]) {}
    /// Second half kick, by the forces on the walls.
    fn kick(&mut self, _step: f64, _: WallForces, _: &mut Grains<D>) {}
    /// How far the walls moved in the last step.
    fn moved(&self) -> WallSteps {
        WallSteps::default()
    }
    /// The rank's grains were renumbered; until the next call they move by at most half a skin (m).
    fn renumber(&mut self, _: Isa, _: &Grains<D>, _skin: f64) {}
}

/// Smooth rigid planes at 0 and at the piston's height along the last axis, the upper one pressed
/// by N.
///
/// A smooth rigid plane is the plane of symmetry of a contact of two equal grains: each grain near
/// it touches its mirror image, by the law of the grains without friction.
#[derive(Debug)]
pub struct Planes<D: Dimension> {
    /// The upper plane.
    pub piston: Piston,
    /// The drag on grains and planes (1/s).
    pub drag: f64,
    law: Box<dyn PairForce<D>>,
    /// Grains within the cutoff of a plane, and whether it is the upper one.
    candidates: Vec<(u32, bool)>,
    record: Vec<D::Record>,
    force: Vec<D::Force>,
    contacts: Contacts,
    scratch: Box<Scratch<D>>,
}

impl<D: Dimension> Planes<D> {
    /// Planes that touch grains by `law`, which has no friction.
    pub fn new(law: Box<dyn PairForce<D>>, piston: Piston, drag: f64) -> Self {
        Self {
            piston,
            drag,
            law,
            candidates: Vec::new(),
            record: Vec::new(),
            force: Vec::new(),
            contacts: Contacts::default(),
            scratch: Box::default(),
        }
    }

    /// Adds this rank's part of the force on a plane, away from the sample.
    pub fn load_on(&self, upper: bool, fixed: &FixedPoint, to: &mut Accumulator) {
        for (k, &(_, side)) in self.candidates.iter().enumerate() {
            if side == upper {
                fixed.add(to, self.force[2 * k][D::UP].abs());
            }
        }
    }
}

impl<D: Dimension> Drive<D> for Planes<D> {
    /// Also on spins: a grain without contacts would otherwise never come to rest.
    fn drag(&self) -> Option<[f64; 2]> {
        Some([self.drag; 2])
    }

    fn speed(&self) -> f64 {
        self.piston.velocity.abs()
    }

    fn start(&mut self, load: WallForces) {
        self.piston.acceleration = (load.up - self.piston.load) / self.piston.mass;
    }

    fn drift(&mut self, step: f64, _: &mut Grains<D>) {
        self.piston.half_kick_and_drift(step);
    }

    fn predict(&mut self, _: f64, _: &mut Grains<D>) {}

    fn forces(&mut self, isa: Isa, cell: Cell, step: f64, grains: &mut Grains<D>) -> Option<usize> {
        let up = D::UP;
        let velocity = self.piston.predicted(step);
        for (k, &(g, upper)) in self.candidates.iter().enumerate() {
            let (plane, speed) = if upper {
                (self.piston.height, velocity)
            } else {
                (0.0, 0.0)
            };
            let record = grains.record[g as usize];
            let mut image = record;
            let mirrored = D::fields_mut(&mut image);
            mirrored[up] = 2.0 * plane - mirrored[up];
            let v = &mut mirrored[D::VELOCITY + up];
            *v = 2.0 * speed - *v;
            self.record[2 * k] = record;
            self.record[2 * k + 1] = image;
        }
        self.force.fill(Zeroable::zeroed());
        let all = 0..self.contacts.blocks();
        let part = self.contacts.part(all);
        let outcome = self.law.pass(
            isa,
            Pass {
                record: &self.record,
                force: &mut self.force,
                part,
                units: grains.units,
                cell,
                step,
                travelled: None,
                attraction: None,
                samples: None,
                counting: None,
            },
            &mut self.scratch,
        );
        for (k, &(g, _)) in self.candidates.iter().enumerate() {
            grains.force[g as usize][up] += self.force[2 * k][up];
        }
        outcome.outside.or(outcome.too_strong).map(|(block, lane)| {
            let k = self.contacts.grains(block).i[lane] as usize / 2;
            self.candidates[k].0 as usize
        })
    }

    fn load(&self, _: &Grains<D>, fixed: &FixedPoint, [up, ..]: &mut [Accumulator; 3]) {
        self.load_on(true, fixed, up);
    }

    fn kick(&mut self, step: f64, load: WallForces, _: &mut Grains<D>) {
        self.piston.full_kick(step, load.up, self.drag);
    }

    fn renumber(&mut self, isa: Isa, grains: &Grains<D>, skin: f64) {
        self.candidates.clear();
        for g in 0..grains.owned {
            let y = grains.fields(g)[D::UP];
            let cutoff = grains.radius[g] + skin;
            for (upper, gap) in [(false, y), (true, self.piston.height - y)] {
                if gap < cutoff {
                    self.candidates.push((g as u32, upper));
                }
            }
        }
        let with_image = |k: u32| CandidatePair {
            grains: [2 * k, 2 * k + 1],
            gap: 0.0,
        };
        let pairs: Vec<_> = (0..self.candidates.len() as u32).map(with_image).collect();
        let id: Vec<_> = (0..2 * self.candidates.len() as u32).collect();
        let grains_of = || self.candidates.iter().map(|&(g, _)| g as usize);
        let radius: Vec<_> = grains_of().flat_map(|g| [grains.radius[g]; 2]).collect();
        let material: Vec<_> = grains_of().flat_map(|g| [grains.material[g]; 2]).collect();
        self.record.clear();
        self.record.resize(radius.len(), Zeroable::zeroed());
        self.force.clear();
        self.force.resize(radius.len(), Zeroable::zeroed());
        self.contacts.replace(
            isa,
            self.law.as_ref(),
            &pairs,
            &Remembered::default(),
            LocalGrains {
                id: &id,
                radius: &radius,
                material: &material,
                owned: radius.len(),
                shares: std::slice::from_ref(&(0..radius.len())),
                ghosts_move: 0.0,
            },
        );
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
fn is_zero(x: &f64) -> bool {
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

    fn half_kick_and_drift(&mut self, step: f64) {
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
    fn predicted(&self, step: f64) -> f64 {
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
            Some(stiffness) => {
                Some(stiffness * (self.protocol.position(now) - self.state.displacement))
            }
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
    pub fn drive_position(&self) -> f64 {
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

/// Walls of frozen grains. The bottom is fixed, or vibrates along its normal. The top is rigid,
/// with a load N or an imposed velocity along its normal, and a slider moves it along x. A load
/// acts on its mass, or a servo moves it.
#[derive(Debug)]
pub struct GrainWalls {
    /// The motion of the top upwards.
    pub piston: Piston,
    /// The motion of the top along x, and what is imposed on the walls.
    pub slider: Slider,
    /// What moves the top under a load. `None`: its mass does.
    pub servo: Option<Servo>,
    /// Whether the force along x is summed in every step.
    pub along: bool,
    /// Whether the work along the normals is summed in every step, because it is not that of a
    /// constant load on a mass.
    pub normal_work: bool,
    /// Owned grains of the top wall.
    pub top: Vec<u32>,
    /// Owned grains of the bottom wall, if it vibrates.
    pub bottom: Vec<u32>,
    /// How far top and bottom moved upwards in the last step (m).
    pub rose: [f64; 2],
}

impl GrainWalls {
    /// Walls without their grains. `along`: whether the force along x is summed though no motion
    /// needs it.
    pub fn new(piston: Piston, slider: Slider, servo: Option<Servo>, along: bool) -> Self {
        let protocol = &slider.protocol;
        let varies = protocol.has_normal() || protocol.has_bottom();
        Self {
            piston,
            servo,
            along: along || slider.spring.is_some() || protocol.has_force(),
            normal_work: varies || servo.is_some(),
            slider,
            top: Vec::new(),
            bottom: Vec::new(),
            rose: [0.0; 2],
        }
    }

    /// Imposes the load or the normal velocity of the start of the shear. Returns the velocities of
    /// the walls (m/s): of the top along x and upwards, of the bottom upwards.
    pub fn begin(&mut self) -> [f64; 3] {
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
        [self.slider.state.velocity, up, bottom]
    }

    /// The walls' part of the state that the digest covers.
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

    /// Displacement of the bottom upwards since the start of the shear (m).
    pub fn bottom_displacement(&self) -> f64 {
        self.slider.protocol.bottom(self.slider.state.step)
    }

    /// What is imposed at the end of the last step: the load and the force along x (N; N/m in 2D),
    /// NaN if there is none.
    pub fn imposed(&self) -> [f64; 2] {
        let now = self.slider.state.step;
        let segment = self.slider.protocol.segment_before(now);
        let load = match segment.imposed.normal {
            None => Some(self.piston.load),
            Some(_) => segment.load(now),
        };
        [load, segment.force(now)].map(|force| force.unwrap_or(f64::NAN))
    }

    /// Gives the grains of the top these velocities, in the fields that begin at `at`.
    fn impose<D: Dimension>(&self, at: &[usize], [along, up]: [f64; 2], grains: &mut Grains<D>) {
        for &g in &self.top {
            let r = grains.fields_mut(g as usize);
            for at in at {
                r[*at] = along;
                r[at + D::UP] = up;
            }
        }
    }

    /// Gives the grains of a bottom that vibrates this velocity upwards.
    fn impose_bottom<D: Dimension>(&self, at: &[usize], up: f64, grains: &mut Grains<D>) {
        for &g in &self.bottom {
            let r = grains.fields_mut(g as usize);
            for at in at {
                r[at + D::UP] = up;
            }
        }
    }

    /// Gives the wall grains the velocities of the walls, also as those of the half step, from
    /// which the deferred second kick starts. `bottom` (m/s) is asked for only if it vibrates.
    fn impose_velocities<D: Dimension>(
        &self,
        bottom: impl FnOnce(&Protocol) -> f64,
        grains: &mut Grains<D>,
    ) {
        let velocity = [self.slider.state.velocity, self.piston.velocity];
        let fields = [D::VELOCITY, D::HALF_VELOCITY];
        self.impose(&fields, velocity, grains);
        if self.slider.protocol.has_bottom() {
            self.impose_bottom(&fields, bottom(&self.slider.protocol), grains);
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
        let bottom = protocol.bottom(now + 1) - protocol.bottom(now);
        self.rose = [self.piston.height - before, bottom];
    }

    /// The second half kick of the top upwards by the load of the last segment; load and
    /// acceleration are then those of the next one, so that a jump of the load leaves the scheme of
    /// second order.
    fn end_rise(&mut self, step: f64, force: f64) {
        let protocol = &self.slider.protocol;
        if !protocol.has_normal() {
            self.kick_up(step, force);
            return;
        }
        let now = self.slider.state.step;
        let (last, next) = (protocol.segment_before(now), protocol.segment(now));
        let [last_load, next_load] = [last, next].map(|segment| segment.load(now));
        match last.normal_velocity() {
            None => {
                self.piston.load = last_load.unwrap_or(self.piston.load);
                self.kick_up(step, force);
            }
            Some(velocity) => {
                (self.piston.velocity, self.piston.acceleration) = (velocity, 0.0);
            }
        }
        if let Some(load) = next_load {
            self.piston.load = load;
            match self.servo {
                None => self.piston.acceleration = (force - load) / self.piston.mass,
                Some(servo) if last_load != next_load => servo.restart(&mut self.piston, force),
                Some(_) => {}
            }
        }
    }

    /// The second half kick of the top upwards under its load.
    fn kick_up(&mut self, step: f64, force: f64) {
        match self.servo {
            None => self.piston.full_kick(step, force, 0.0),
            Some(servo) => servo.kick(&mut self.piston, step, force),
        }
    }
}

impl<D: Dimension> Drive<D> for GrainWalls {
    fn start(&mut self, load: WallForces) {
        let first = self.slider.protocol.segment(0);
        let piston = &mut self.piston;
        match self.servo {
            _ if first.normal_velocity().is_some() => {}
            None => piston.acceleration = (load.up - piston.load) / piston.mass,
            Some(servo) => servo.restart(piston, load.up),
        }
        self.slider.accelerate(load.along, self.piston.mass);
    }

    fn drift(&mut self, step: f64, grains: &mut Grains<D>) {
        let now = self.slider.state.step;
        self.rise(step);
        self.slider.half_kick_and_drift(step);
        self.impose_velocities(|protocol| protocol.bottom_velocity(now), grains);
    }

    fn predict(&mut self, step: f64, grains: &mut Grains<D>) {
        let now = self.slider.state.step;
        let protocol = &self.slider.protocol;
        let up = match protocol.segment_before(now).normal_velocity() {
            None => self.piston.predicted(step),
            Some(velocity) => velocity,
        };
        self.impose(&[D::VELOCITY], [self.slider.predicted(step), up], grains);
        if protocol.has_bottom() {
            self.impose_bottom(&[D::VELOCITY], protocol.full_bottom_velocity(now), grains);
        }
    }

    fn has_bottom_force(&self) -> bool {
        self.slider.protocol.has_bottom()
    }

    fn load(
        &self,
        grains: &Grains<D>,
        fixed: &FixedPoint,
        [up, along, bottom]: &mut [Accumulator; 3],
    ) {
        for &g in &self.top {
            fixed.add(up, grains.force[g as usize][D::UP]);
        }
        if self.along {
            for &g in &self.top {
                fixed.add(along, grains.force[g as usize][0]);
            }
        }
        for &g in &self.bottom {
            fixed.add(bottom, grains.force[g as usize][D::UP]);
        }
    }

    fn kick(&mut self, step: f64, forces: WallForces, grains: &mut Grains<D>) {
        let now = self.slider.state.step;
        self.end_rise(step, forces.up);
        self.slider.kick(step, forces.along, self.piston.mass);
        self.impose_velocities(|protocol| protocol.full_bottom_velocity(now), grains);
    }

    fn moved(&self) -> WallSteps {
        WallSteps {
            along: self.slider.state.slid,
            normal: self.normal_work.then_some(self.rose),
        }
    }

    fn renumber(&mut self, _: Isa, grains: &Grains<D>, _: f64) {
        self.top = grains.of_body(body::TOP);
        if self.slider.protocol.has_bottom() {
            self.bottom = grains.of_body(body::BOTTOM);
        }
    }
}

/// No walls, and a drag on translations but not on spins: overdamped dynamics (BO section III).
#[derive(Debug)]
pub struct Overdamped {
    /// η_0 (1/s).
    pub drag: f64,
}

/// No walls and no drag.
#[derive(Debug, Default)]
pub struct NoWalls;

impl<D: Dimension> Drive<D> for Overdamped {
    fn drag(&self) -> Option<[f64; 2]> {
        Some([self.drag, 0.0])
    }
}

impl<D: Dimension> Drive<D> for NoWalls {}
