//! The walls and their drive: smooth planes during packing, frozen grains during shear, or none:
//! the images of a cell that is periodic along its last axis, too.

mod grain_walls;
mod images;
mod moving;
mod planes;
mod top;

use crate::dimension::Dimension;
use crate::domain::{Accumulator, FixedPoint};
use crate::simd::Isa;
use crate::state::{Cell, Grains};
use crate::tuning::PassSettings;

pub use grain_walls::GrainWalls;
pub use images::{FlowSum, Images, MomentumFlow, Streaming};
pub use moving::MovingBoundary;
pub use planes::Planes;
pub(crate) use top::is_zero;
pub use top::{Piston, Servo, Slider, SliderState, Top};

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

/// The exact sums of the [`WallForces`].
#[derive(Debug, Default)]
pub struct WallSums {
    /// On the top upwards, along the last axis.
    pub up: Accumulator,
    /// On the top along x.
    pub along: Accumulator,
    /// On the bottom upwards.
    pub bottom: Accumulator,
}

/// How far the walls moved in the last step (m).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WallSteps {
    /// The top along x.
    pub along: f64,
    /// The top and the bottom upwards, if the work along the normals is summed step by step.
    pub normal: Option<[f64; 2]>,
}

/// From what a drive takes the forces on the walls: what the grains of a rank feel.
#[derive(Debug, Clone, Copy)]
pub struct Felt<'a, D: Dimension> {
    /// The grains.
    pub grains: &'a Grains<D>,
    /// The counts of their stress with its kinetic part, in units of the forces, if needed.
    pub stress: Option<[i128; 2]>,
    /// How forces are summed.
    pub fixed: &'a FixedPoint,
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
    /// First half kick and drift of the walls, or of the cell.
    fn drift(&mut self, _step: f64, _: &mut Cell, _: &mut Grains<D>) {}
    /// What the step does to all grains beside their own motion, after [`Drive::drift`].
    fn streaming(&self) -> Option<Streaming> {
        None
    }
    /// Gives the wall grains, or the cell, their predicted velocities, after the drift.
    fn predict(&mut self, _step: f64, _: &mut Cell, _: &mut Grains<D>) {}
    /// Adds forces of the walls on the grains that are not contacts between grains. Returns a grain
    /// whose overlap is outside the law.
    fn forces(&mut self, _: PassSettings, _: Cell, _step: f64, _: &mut Grains<D>) -> Option<usize> {
        None
    }
    /// The heights (m) of planes that grains touch, if there are some: of bottom and top.
    fn planes(&self) -> Option<[f64; 2]> {
        None
    }
    /// Whether the force on the bottom is summed too.
    fn has_bottom_force(&self) -> bool {
        false
    }
    /// Adds this rank's part of the forces on the walls.
    fn load(&self, _: &Felt<'_, D>, _: &mut WallSums) {}
    /// Whether it needs the stress of the contacts; `sampled`: their forces are measured in this
    /// step.
    fn needs_stress(&self, _sampled: bool) -> bool {
        false
    }
    /// Second half kick, by the forces on the walls.
    fn kick(&mut self, _step: f64, _: WallForces, _: &mut Grains<D>) {}
    /// How far the walls moved in the last step.
    fn moved(&self) -> WallSteps {
        WallSteps::default()
    }
    /// The rank's grains were renumbered; until the next call they move by at most half a skin (m).
    fn renumber(&mut self, _: Isa, _: &mut Grains<D>, _skin: f64) {}
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
