//! The walls and their drive: smooth planes during packing, frozen grains during shear.

use bytemuck::Zeroable;
use serde::{Deserialize, Serialize};

use crate::dimension::Dimension;
use crate::domain::{Accumulator, FixedPoint};
use crate::kernel::{PairForce, Pass, Scratch};
use crate::protocol::Protocol;
use crate::simd::Isa;
use crate::state::{CandidatePair, Cell, Contacts, Grains, LocalGrains, body};

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

    fn full_kick(&mut self, step: f64, force: f64, drag: f64) {
        self.acceleration = (force - self.load) / self.mass - drag * self.predicted(step);
        self.velocity += 0.5 * step * self.acceleration;
    }
}

/// The force of the grains on the top (N; N/m in 2D). The component along x is 0 unless requested.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TopForce {
    /// Upwards, along the last axis.
    pub up: f64,
    /// Along x.
    pub along: f64,
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
    fn start(&mut self, _: TopForce) {}
    /// First half kick and drift of the walls.
    fn drift(&mut self, _step: f64, _: &mut Grains<D>) {}
    /// Gives the wall grains their predicted velocities, after the drift.
    fn predict(&mut self, _step: f64, _: &mut Grains<D>) {}
    /// Adds forces of the walls on the grains that are not contacts between grains. Returns a grain
    /// whose overlap is outside the law.
    fn forces(&mut self, _: Isa, _: Cell, _step: f64, _: &mut Grains<D>) -> Option<usize> {
        None
    }
    /// Adds this rank's part of the force on the top: upwards, and along x.
    fn load(&self, _: &Grains<D>, _: &FixedPoint, _to: &mut [Accumulator; 2]) {}
    /// Second half kick, by the force on the top.
    fn kick(&mut self, _step: f64, _: TopForce, _: &mut Grains<D>) {}
    /// Displacement of the top along x in the last step (m).
    fn slid(&self) -> f64 {
        0.0
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

    fn start(&mut self, load: TopForce) {
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
                samples: None,
                counting: None,
            },
            &mut self.scratch,
        );
        for (k, &(g, _)) in self.candidates.iter().enumerate() {
            grains.force[g as usize][up] += self.force[2 * k][up];
        }
        outcome.outside.or(outcome.too_strong).map(|(block, lane)| {
            let k = self.contacts.pairs.blocks()[block].i[lane] as usize / 2;
            self.candidates[k].0 as usize
        })
    }

    fn load(&self, _: &Grains<D>, fixed: &FixedPoint, [up, _]: &mut [Accumulator; 2]) {
        self.load_on(true, fixed, up);
    }

    fn kick(&mut self, step: f64, load: TopForce, _: &mut Grains<D>) {
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
        let radius: Vec<_> = self
            .candidates
            .iter()
            .flat_map(|&(g, _)| [grains.radius[g as usize]; 2])
            .collect();
        self.record.clear();
        self.record.resize(radius.len(), Zeroable::zeroed());
        self.force.clear();
        self.force.resize(radius.len(), Zeroable::zeroed());
        self.contacts.replace(
            isa,
            self.law.as_ref(),
            &pairs,
            &[],
            LocalGrains {
                id: &id,
                radius: &radius,
                owned: radius.len(),
                ghosts_move: 0.0,
            },
        );
    }
}

/// The motion of the top along x.
#[derive(Debug, Clone)]
pub struct Slider {
    /// Position and velocity of the drive, step by step.
    pub protocol: Protocol,
    /// The stiffness of the spring between drive and top (N/m; Pa in 2D). `None`: the top moves
    /// with the drive.
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
}

impl Slider {
    /// A drive that follows `protocol`. The top starts at rest with a spring, and with the velocity
    /// of the drive without one.
    pub fn new(protocol: Protocol, spring: Option<f64>) -> Self {
        let velocity = match spring {
            None => protocol.velocity(0),
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

    fn half_kick_and_drift(&mut self, step: f64) {
        let state = &mut self.state;
        let before = state.displacement;
        if self.spring.is_some() {
            state.velocity += 0.5 * step * state.acceleration;
            state.displacement += step * state.velocity;
        } else {
            state.velocity = self.protocol.velocity(state.step);
            state.displacement = self.protocol.position(state.step + 1);
        }
        state.slid = state.displacement - before;
        state.step += 1;
    }

    fn predicted(&self, step: f64) -> f64 {
        self.state.velocity + 0.5 * step * self.state.acceleration
    }

    /// Computes the acceleration by the force of the grains along x and by the spring.
    fn accelerate(&mut self, force: f64, mass: f64) {
        if let Some(stiffness) = self.spring {
            let stretch = self.protocol.position(self.state.step) - self.state.displacement;
            self.state.acceleration = (stiffness * stretch + force) / mass;
        }
    }
}

/// Walls of frozen grains: the bottom is fixed; the top is rigid, with a constant load N, and a
/// slider moves it along x.
#[derive(Debug)]
pub struct GrainWalls {
    /// The motion of the top upwards.
    pub piston: Piston,
    /// The motion of the top along x.
    pub slider: Slider,
    /// Whether the force along x is summed in every step.
    pub along: bool,
    /// Owned grains of the top wall.
    pub top: Vec<u32>,
}

impl GrainWalls {
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

    /// Gives the top grains the velocity of the plate, also as that of the half step, from which
    /// the deferred second kick starts.
    fn impose_plate_velocity<D: Dimension>(&self, grains: &mut Grains<D>) {
        let velocity = [self.slider.state.velocity, self.piston.velocity];
        self.impose(&[D::VELOCITY, D::HALF_VELOCITY], velocity, grains);
    }
}

impl<D: Dimension> Drive<D> for GrainWalls {
    fn start(&mut self, load: TopForce) {
        self.piston.acceleration = (load.up - self.piston.load) / self.piston.mass;
        self.slider.accelerate(load.along, self.piston.mass);
    }

    fn drift(&mut self, step: f64, grains: &mut Grains<D>) {
        self.piston.half_kick_and_drift(step);
        self.slider.half_kick_and_drift(step);
        self.impose_plate_velocity(grains);
    }

    fn predict(&mut self, step: f64, grains: &mut Grains<D>) {
        let predicted = [self.slider.predicted(step), self.piston.predicted(step)];
        self.impose(&[D::VELOCITY], predicted, grains);
    }

    fn load(&self, grains: &Grains<D>, fixed: &FixedPoint, [up, along]: &mut [Accumulator; 2]) {
        for &g in &self.top {
            fixed.add(up, grains.force[g as usize][D::UP]);
        }
        if self.along {
            for &g in &self.top {
                fixed.add(along, grains.force[g as usize][0]);
            }
        }
    }

    fn kick(&mut self, step: f64, load: TopForce, grains: &mut Grains<D>) {
        self.piston.full_kick(step, load.up, 0.0);
        if self.slider.spring.is_some() {
            self.slider.accelerate(load.along, self.piston.mass);
            self.slider.state.velocity += 0.5 * step * self.slider.state.acceleration;
        }
        self.impose_plate_velocity(grains);
    }

    fn slid(&self) -> f64 {
        self.slider.state.slid
    }

    fn renumber(&mut self, _: Isa, grains: &Grains<D>, _: f64) {
        self.top = grains.of_body(body::TOP);
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
