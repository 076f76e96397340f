//! What the dampers are given: the scheme of this program, and that of LAMMPS, for comparison.

use gshear::domain::{Accumulator, FixedPoint};
use gshear::drive::{Drive, Piston};
use gshear::simd::Level;
use gshear::state::{Grains, field};

/// The velocity that the dampers of a contact take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dampers {
    /// That of the full step, predicted: the program as it is.
    FullStep,
    /// That of the half step, as LAMMPS and others do.
    HalfStep,
}

impl Dampers {
    pub const BOTH: [Self; 2] = [Self::FullStep, Self::HalfStep];

    pub fn name(self) -> &'static str {
        match self {
            Self::FullStep => "this program",
            Self::HalfStep => "half-step dampers",
        }
    }
}

/// Walls, and dampers of either kind: what the program predicts is put back to the velocities of the half step.
pub struct Damped<D> {
    pub walls: D,
    pub dampers: Dampers,
}

impl<D: Drive> Drive for Damped<D> {
    const DRAG: bool = D::DRAG;

    fn drag(&self) -> f64 {
        self.walls.drag()
    }

    fn piston(&self) -> &Piston {
        self.walls.piston()
    }

    fn piston_mut(&mut self) -> &mut Piston {
        self.walls.piston_mut()
    }

    fn speed(&self) -> f64 {
        self.walls.speed()
    }

    fn drift(&mut self, step: f64, grains: &mut Grains) {
        self.walls.drift(step, grains);
    }

    fn predict(&mut self, step: f64, grains: &mut Grains) {
        use field::*;
        self.walls.predict(step, grains);
        if self.dampers == Dampers::HalfStep {
            for record in &mut grains.record {
                let r = &mut record.0;
                [r[U], r[V], r[W]] = [r[HALF_U], r[HALF_V], r[HALF_W]];
            }
        }
    }

    fn forces(
        &mut self,
        level: Level,
        length: f64,
        step: f64,
        grains: &mut Grains,
    ) -> Option<usize> {
        self.walls.forces(level, length, step, grains)
    }

    fn load(&self, grains: &Grains, fixed: &FixedPoint, to: &mut Accumulator) {
        self.walls.load(grains, fixed, to);
    }

    fn kick(&mut self, step: f64, force: f64, grains: &mut Grains) {
        self.walls.kick(step, force, grains);
    }

    fn pull(&self, grains: &Grains) -> i64 {
        self.walls.pull(grains)
    }

    fn renumber(&mut self, level: Level, grains: &Grains, skin: f64) {
        self.walls.renumber(level, grains, skin);
    }
}
