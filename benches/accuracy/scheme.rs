//! What the dampers are given: the scheme of this program, and that of LAMMPS, for comparison.

use gshear_dem::dimension::{Dimension, Two};
use gshear_dem::domain::FixedPoint;
use gshear_dem::drive::{
    Drive, WallForces, WallGrains, WallMotion, WallSteps, WallSums, WallVelocities,
};
use gshear_dem::simd::Isa;
use gshear_dem::state::{Cell, Grains};

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

/// Walls, and dampers of either kind: what the program predicts is put back to the velocities of
/// the half step.
pub struct Damped<D> {
    pub walls: D,
    pub dampers: Dampers,
}

impl<D: Drive<Two>> Drive<Two> for Damped<D> {
    fn drag(&self) -> Option<[f64; 2]> {
        self.walls.drag()
    }

    fn speed(&self) -> f64 {
        self.walls.speed()
    }

    fn start(&mut self, load: WallForces) {
        self.walls.start(load);
    }

    fn drift(&mut self, step: f64) -> Option<WallMotion> {
        self.walls.drift(step)
    }

    fn wall_grains(&self) -> WallGrains<'_> {
        self.walls.wall_grains()
    }

    fn forces(
        &mut self,
        isa: Isa,
        cell: Cell,
        step: f64,
        grains: &mut Grains<Two>,
    ) -> Option<usize> {
        if self.dampers == Dampers::HalfStep {
            for record in &mut grains.record {
                let r = Two::fields_mut(record);
                r.copy_within(
                    Two::HALF_VELOCITY..Two::HALF_VELOCITY + Two::AXES,
                    Two::VELOCITY,
                );
                r.copy_within(Two::HALF_SPIN..=Two::HALF_SPIN, Two::SPIN);
            }
        }
        self.walls.forces(isa, cell, step, grains)
    }

    fn load_on_grains(
        &self,
        first: usize,
        force: &[<Two as Dimension>::Force],
        fixed: &FixedPoint,
        walls: WallGrains<'_>,
        sums: &mut WallSums,
    ) {
        self.walls.load_on_grains(first, force, fixed, walls, sums);
    }

    fn kick(&mut self, step: f64, load: WallForces) -> Option<WallVelocities> {
        self.walls.kick(step, load)
    }

    fn moved(&self) -> WallSteps {
        self.walls.moved()
    }

    fn renumber(&mut self, isa: Isa, grains: &mut Grains<Two>, skin: f64) {
        self.walls.renumber(isa, grains, skin);
    }
}
