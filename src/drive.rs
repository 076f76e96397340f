//! The walls and what moves them: smooth planes while packing, frozen grains while shearing.

use serde::{Deserialize, Serialize};

use crate::contact::ContactLaw;
use crate::domain::{Accumulator, FixedPoint};
use crate::kernel::{Pass, contact_forces};
use crate::simd::{Level, Quad, Record};
use crate::state::{Contacts, Force, Grains, body, field};

/// The rigid body on top: m_w ÿ = F_y - N - c ẏ, by the grains' own Verlet scheme. SI units, per unit depth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Piston {
    /// Upper boundary of the sample (m).
    pub height: f64,
    /// Full-step velocity along y; between the kicks that of the half step (m/s).
    pub velocity: f64,
    pub acceleration: f64,
    pub mass: f64,
    /// N (N/m), pressing down.
    pub load: f64,
}

impl Piston {
    /// ÿ (m/s²) under the force (N/m) of the grains, before the first step.
    pub fn start(&mut self, force: f64) {
        self.acceleration = (force - self.load) / self.mass;
    }

    fn half_kick_and_drift(&mut self, step: f64) {
        self.velocity += 0.5 * step * self.acceleration;
        self.height += step * self.velocity;
    }

    /// The velocity of the full step, as far as the last acceleration tells.
    fn predicted(&self, step: f64) -> f64 {
        self.velocity + 0.5 * step * self.acceleration
    }

    fn full_kick(&mut self, step: f64, force: f64, drag: f64) {
        self.acceleration = (force - self.load) / self.mass - drag * self.predicted(step);
        self.velocity += 0.5 * step * self.acceleration;
    }
}

/// What the step asks of the walls.
pub trait Drive {
    /// Grains are slowed by -c m v.
    const DRAG: bool;
    /// c (1/s).
    fn drag(&self) -> f64 {
        0.0
    }
    fn piston(&self) -> &Piston;
    fn piston_mut(&mut self) -> &mut Piston;
    /// Fastest that a wall moves (m/s).
    fn speed(&self) -> f64;
    /// First half kick and drift of the walls.
    fn drift(&mut self, step: f64, grains: &mut Grains);
    /// After the grains' drift: the wall grains' predicted velocities.
    fn predict(&mut self, step: f64, grains: &mut Grains);
    /// Forces of the walls on the grains that are no contacts between grains. Returns a grain whose overlap is outside the law.
    fn forces(
        &mut self,
        level: Level,
        length: f64,
        step: f64,
        grains: &mut Grains,
    ) -> Option<usize>;
    /// Adds this rank's part of the force on the top along y.
    fn load(&self, grains: &Grains, fixed: &FixedPoint, to: &mut Accumulator);
    /// This rank's part of the force against an imposed motion, in units of the contact forces.
    fn pull(&self, _grains: &Grains) -> i64 {
        0
    }
    /// Second half kick, by the force on the top along y (N/m).
    fn kick(&mut self, step: f64, force: f64, grains: &mut Grains);
    /// The grains of this rank are others than before, and may move by half a skin (m) until the next time.
    fn renumber(&mut self, level: Level, grains: &Grains, skin: f64);
}

/// Smooth rigid planes at y = 0 and y = height, the upper one pressed by N.
///
/// A smooth rigid plane is the plane of symmetry of a contact of two equal grains: each grain near it meets its mirror
/// image, by the very law `C` of the grains, which needs no friction here.
#[derive(Debug)]
pub struct Planes<C> {
    pub piston: Piston,
    pub drag: f64,
    law: C,
    /// Grains near a plane, and whether it is the upper one.
    near: Vec<(u32, bool)>,
    record: Vec<Record>,
    force: Vec<Force>,
    contacts: Contacts,
}

impl<C: ContactLaw> Planes<C> {
    pub fn new(law: C, piston: Piston, drag: f64) -> Self {
        Self {
            piston,
            drag,
            law,
            near: Vec::new(),
            record: Vec::new(),
            force: Vec::new(),
            contacts: Contacts::default(),
        }
    }

    /// Adds this rank's part of the force (N/m) on a plane, away from the sample.
    pub fn load_on(&self, upper: bool, fixed: &FixedPoint, to: &mut Accumulator) {
        for (k, &(_, side)) in self.near.iter().enumerate() {
            if side == upper {
                fixed.add(to, self.force[2 * k][1].abs());
            }
        }
    }
}

impl<C: ContactLaw> Drive for Planes<C> {
    const DRAG: bool = true;

    fn drag(&self) -> f64 {
        self.drag
    }

    fn piston(&self) -> &Piston {
        &self.piston
    }

    fn piston_mut(&mut self) -> &mut Piston {
        &mut self.piston
    }

    fn speed(&self) -> f64 {
        self.piston.velocity.abs()
    }

    fn drift(&mut self, step: f64, _grains: &mut Grains) {
        self.piston.half_kick_and_drift(step);
    }

    fn predict(&mut self, _step: f64, _grains: &mut Grains) {}

    fn forces(
        &mut self,
        level: Level,
        length: f64,
        step: f64,
        grains: &mut Grains,
    ) -> Option<usize> {
        let velocity = self.piston.predicted(step);
        for (k, &(g, upper)) in self.near.iter().enumerate() {
            let (plane, speed) = if upper {
                (self.piston.height, velocity)
            } else {
                (0.0, 0.0)
            };
            let own = grains.record[g as usize];
            let mut image = own;
            image.0[field::Y] = 2.0 * plane - own.0[field::Y];
            image.0[field::V] = 2.0 * speed - own.0[field::V];
            self.record[2 * k] = own;
            self.record[2 * k + 1] = image;
        }
        self.force.fill(Quad::ZERO);
        let all = 0..self.contacts.blocks();
        let part = self.contacts.part::<C>(all);
        let found = contact_forces(
            level,
            &self.law,
            Pass {
                record: &self.record,
                force: &mut self.force,
                part,
                unit: grains.unit,
                length,
                step,
                samples: None,
                energy_unit: None,
            },
        );
        for (k, &(g, _)) in self.near.iter().enumerate() {
            grains.force[g as usize][1] += self.force[2 * k][1];
        }
        found.outside.or(found.too_strong).map(|(block, lane)| {
            let k = self.contacts.pairs.blocks()[block].i[lane] as usize / 2;
            self.near[k].0 as usize
        })
    }

    fn load(&self, _grains: &Grains, fixed: &FixedPoint, to: &mut Accumulator) {
        self.load_on(true, fixed, to);
    }

    fn kick(&mut self, step: f64, force: f64, _grains: &mut Grains) {
        self.piston.full_kick(step, force, self.drag);
    }

    fn renumber(&mut self, level: Level, grains: &Grains, skin: f64) {
        self.near.clear();
        for g in 0..grains.owned {
            let (y, reach) = (grains.record[g].0[field::Y], grains.radius[g] + skin);
            for (upper, gap) in [(false, y), (true, self.piston.height - y)] {
                if gap < reach {
                    self.near.push((g as u32, upper));
                }
            }
        }
        let both = |k: u32| [2 * k, 2 * k + 1];
        let pairs: Vec<_> = (0..self.near.len() as u32).map(both).collect();
        let radius: Vec<_> = self
            .near
            .iter()
            .flat_map(|&(g, _)| [grains.radius[g as usize]; 2])
            .collect();
        self.record.clear();
        self.record.resize(radius.len(), Record::ZERO);
        self.force.clear();
        self.force.resize(radius.len(), Quad::ZERO);
        self.contacts
            .replace(level, &self.law, &pairs, &radius, radius.len());
    }
}

/// Walls frozen out of the sample: the bottom fixed, the top rigid with constant load N and constant speed V along x.
#[derive(Debug)]
pub struct GrainWalls {
    pub piston: Piston,
    /// V (m/s).
    pub speed: f64,
    /// Own grains of the top wall.
    pub top: Vec<u32>,
}

impl GrainWalls {
    fn impose(&self, velocity: f64, grains: &mut Grains) {
        for &g in &self.top {
            let record = &mut grains.record[g as usize].0;
            record[field::U] = self.speed;
            record[field::V] = velocity;
        }
    }
}

impl Drive for GrainWalls {
    const DRAG: bool = false;

    fn piston(&self) -> &Piston {
        &self.piston
    }

    fn piston_mut(&mut self) -> &mut Piston {
        &mut self.piston
    }

    fn speed(&self) -> f64 {
        0.0
    }

    fn drift(&mut self, step: f64, grains: &mut Grains) {
        self.piston.half_kick_and_drift(step);
        self.impose(self.piston.velocity, grains);
    }

    fn predict(&mut self, step: f64, grains: &mut Grains) {
        self.impose(self.piston.predicted(step), grains);
    }

    fn forces(&mut self, _: Level, _: f64, _: f64, _: &mut Grains) -> Option<usize> {
        None
    }

    fn load(&self, grains: &Grains, fixed: &FixedPoint, to: &mut Accumulator) {
        for &g in &self.top {
            fixed.add(to, grains.force[g as usize][1]);
        }
    }

    fn pull(&self, grains: &Grains) -> i64 {
        let force = |&g: &u32| (-grains.force[g as usize][0] / grains.unit.force) as i64;
        self.top.iter().map(force).sum()
    }

    fn kick(&mut self, step: f64, force: f64, grains: &mut Grains) {
        self.piston.full_kick(step, force, 0.0);
        self.impose(self.piston.velocity, grains);
    }

    fn renumber(&mut self, _: Level, grains: &Grains, _: f64) {
        self.top = grains.of_body(body::TOP);
    }
}

/// No walls: a box that is periodic along x and open along y, for tests of grains alone.
#[derive(Debug)]
pub struct NoWalls(Piston);

impl Default for NoWalls {
    fn default() -> Self {
        Self(Piston {
            height: 0.0,
            velocity: 0.0,
            acceleration: 0.0,
            mass: 1.0,
            load: 0.0,
        })
    }
}

impl Drive for NoWalls {
    const DRAG: bool = false;

    fn piston(&self) -> &Piston {
        &self.0
    }

    fn piston_mut(&mut self) -> &mut Piston {
        &mut self.0
    }

    fn speed(&self) -> f64 {
        0.0
    }

    fn drift(&mut self, _: f64, _: &mut Grains) {}

    fn predict(&mut self, _: f64, _: &mut Grains) {}

    fn forces(&mut self, _: Level, _: f64, _: f64, _: &mut Grains) -> Option<usize> {
        None
    }

    fn load(&self, _: &Grains, _: &FixedPoint, _: &mut Accumulator) {}

    fn kick(&mut self, _: f64, _: f64, _: &mut Grains) {}

    fn renumber(&mut self, _: Level, _: &Grains, _: f64) {}
}
