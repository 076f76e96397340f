//! The grains of this rank: its own, sorted by id, then its ghosts.

use crate::simd::{Quad, Record};

use super::GrainState;

/// Places in a grain's record.
pub mod field {
    /// Wrapped position (m).
    pub const X: usize = 0;
    pub const Y: usize = 1;
    /// Velocity of the full step (m/s); while the forces are computed, as predicted.
    pub const U: usize = 2;
    pub const V: usize = 3;
    /// Velocity of the half step (m/s).
    pub const HALF_U: usize = 4;
    pub const HALF_V: usize = 5;
    /// Angular velocity (rad/s) of the half step and of the full step. The kernel reads these two again: last.
    pub const HALF_W: usize = 6;
    pub const W: usize = 7;
}

/// What a grain belongs to.
pub mod body {
    pub const FREE: u32 = 0;
    pub const BOTTOM: u32 = 1;
    pub const TOP: u32 = 2;
}

/// F_x, F_y (N/m), torque (N), and one to fill up.
pub type Force = Quad;

/// What contact forces and torques are rounded to before they are added to the grains, powers of two: sums of whole multiples
/// are exact, so that they do not depend on the order (contract 1), and the forces on two grains in contact cancel exactly.
///
/// The unit of force is 2^-50 to 2^-49 of the greatest force of the law, which is less than what the rounding of the grains'
/// positions does to the force: k R 2^-53, where the greatest force is about k R/10.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForceUnit {
    /// (N/m)
    pub force: f64,
    /// (N)
    pub torque: f64,
}

impl ForceUnit {
    /// `largest_force` (N/m) and `largest_radius` (m) of a contact, positive.
    pub fn new(largest_force: f64, largest_radius: f64) -> Self {
        let force = power_of_two_above(largest_force) * 2f64.powi(-50);
        Self {
            force,
            torque: 2.0 * force * power_of_two_above(largest_radius),
        }
    }

    /// A multiple x of the unit is had by adding and subtracting 3·2^51 units, for |x| up to this (N/m).
    pub fn largest(&self) -> f64 {
        self.force * 2f64.powi(51)
    }
}

/// The least power of two that is greater than x.
fn power_of_two_above(x: f64) -> f64 {
    let exponent = (x.to_bits() >> 52).clamp(1, 2045);
    f64::from_bits((exponent + 1) << 52)
}

/// Structure of arrays over own grains and ghosts; what only own grains need is shorter.
#[derive(Debug)]
pub struct Grains {
    /// Number of own grains.
    pub owned: usize,
    pub id: Vec<u32>,
    pub body: Vec<u32>,
    pub radius: Vec<f64>,
    pub record: Vec<Record>,
    pub force: Vec<Force>,
    /// Of the contact forces.
    pub unit: ForceUnit,
    /// m (kg/m), own grains.
    pub mass: Vec<f64>,
    /// ½Δt/m and ½Δt/I, own grains; 0 for those of walls.
    pub half_kick: Vec<[f64; 2]>,
}

impl Default for Grains {
    fn default() -> Self {
        Self {
            owned: 0,
            id: Vec::new(),
            body: Vec::new(),
            radius: Vec::new(),
            record: Vec::new(),
            force: Vec::new(),
            unit: ForceUnit::new(1.0, 1.0),
            mass: Vec::new(),
            half_kick: Vec::new(),
        }
    }
}

impl Grains {
    /// Number of own grains and ghosts.
    pub fn local(&self) -> usize {
        self.id.len()
    }

    /// Own grains, sorted by id, without ghosts. `density` in kg/m³, `step` Δt in s.
    pub fn replace(&mut self, own: &[GrainState], density: f64, step: f64) {
        self.owned = own.len();
        self.id.clear();
        self.body.clear();
        self.radius.clear();
        self.record.clear();
        self.force.clear();
        self.mass.clear();
        for g in own {
            self.push(g);
            self.mass
                .push(std::f64::consts::PI * density * g.radius * g.radius);
        }
        self.set_step(step);
    }

    /// Own grain or ghost.
    pub fn push(&mut self, g: &GrainState) {
        self.id.push(g.id);
        self.body.push(g.body);
        self.radius.push(g.radius);
        let ([x, y], [u, v], w) = (g.position, g.velocity, g.angular_velocity);
        self.record.push(Record([x, y, u, v, u, v, w, w]));
        self.force
            .push(Quad([g.force[0], g.force[1], g.torque, 0.0]));
    }

    /// Sets Δt (s).
    pub fn set_step(&mut self, step: f64) {
        self.half_kick.clear();
        for g in 0..self.owned {
            let (m, r) = (self.mass[g], self.radius[g]);
            self.half_kick.push(if self.body[g] == body::FREE {
                [0.5 * step / m, 0.5 * step / (0.5 * m * r * r)]
            } else {
                [0.0; 2]
            });
        }
    }

    pub fn state(&self, g: usize) -> GrainState {
        let r = &self.record[g].0;
        let f = &self.force[g];
        GrainState {
            id: self.id[g],
            body: self.body[g],
            position: [r[field::X], r[field::Y]],
            velocity: [r[field::U], r[field::V]],
            angular_velocity: r[field::W],
            radius: self.radius[g],
            force: [f[0], f[1]],
            torque: f[2],
        }
    }

    /// Own grains of a body.
    pub fn of_body(&self, body: u32) -> Vec<u32> {
        (0..self.owned as u32)
            .filter(|&g| self.body[g as usize] == body)
            .collect()
    }

    /// Heap in use (bytes).
    pub fn memory(&self) -> usize {
        use std::mem::size_of;
        (self.id.capacity() + self.body.capacity()) * size_of::<u32>()
            + (self.radius.capacity() + self.mass.capacity()) * size_of::<f64>()
            + self.record.capacity() * size_of::<Record>()
            + self.force.capacity() * size_of::<Force>()
            + self.half_kick.capacity() * size_of::<[f64; 2]>()
    }
}
