//! The walls and their drive: smooth planes during packing, frozen grains during shear, or none:
//! the images of a cell that is periodic along its last axis, too.

mod grain_walls;
mod images;
mod lateral;
mod moving;
mod planes;
mod top;

use std::ops::Range;

use crate::dimension::Dimension;
use crate::domain::{Accumulator, FixedPoint};
use crate::kernel::STRESSES;
use crate::simd::Isa;
use crate::state::{Cell, Grains};
use crate::workers::tail;

pub use grain_walls::GrainWalls;
pub use images::{FlowSum, Images, LateralStretch, MomentumFlow, Streaming};
pub use lateral::{LateralLengths, LateralState};
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
    /// On the sides of a cell without walls, outwards: along x, and in 3D along y.
    pub lateral: [f64; 2],
    /// On the bottom along x.
    pub bottom_along: f64,
}

/// The exact sums of the [`WallForces`].
#[derive(Debug, Clone, Default)]
pub struct WallSums {
    /// On the top upwards, along the last axis.
    pub up: Accumulator,
    /// On the top along x.
    pub along: Accumulator,
    /// On the bottom upwards.
    pub bottom: Accumulator,
    /// On the sides of a cell without walls, outwards.
    pub lateral: [Accumulator; 2],
    /// On the bottom along x.
    pub bottom_along: Accumulator,
}

/// Which [`WallForces`] are summed over the ranks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SummedForces {
    /// Those on the top.
    OnTop,
    /// Those on the top, and that on the bottom upwards.
    OnTopAndBottom,
    /// Those on top and bottom.
    OnTopAndBottomBothWays,
    /// Those on top and sides.
    OnTopAndSides,
}

/// Which stress of a cell a step needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NeededStress {
    /// None.
    Nothing,
    /// That on the base.
    OnBase,
    /// That on the base, and the normal stresses along the other axes.
    AlongAllAxes,
}

impl WallSums {
    /// Adds the sums of other grains.
    pub(crate) fn merge(&mut self, other: Self) {
        self.up.merge(other.up);
        self.along.merge(other.along);
        self.bottom.merge(other.bottom);
        for (sum, more) in self.lateral.iter_mut().zip(other.lateral) {
            sum.merge(more);
        }
        self.bottom_along.merge(other.bottom_along);
    }
}

/// How far the walls moved in the last step (m).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WallSteps {
    /// The top along x.
    pub along: f64,
    /// The bottom along x, if it vibrates so.
    pub bottom_along: Option<f64>,
    /// The top and the bottom upwards, if the work along the normals is summed step by step.
    pub normal: Option<[f64; 2]>,
    /// The sides of a cell without walls outwards, with `normal`.
    pub lateral: [f64; 2],
}

/// From what a drive takes the forces on the walls: what the grains of a rank feel.
#[derive(Debug, Clone, Copy)]
pub struct Felt<'a, D: Dimension> {
    /// The grains.
    pub grains: &'a Grains<D>,
    /// The counts of their stress with its kinetic part, in units of the forces, if needed.
    pub stress: Option<[i128; STRESSES]>,
    /// How forces are summed.
    pub fixed: &'a FixedPoint,
}

/// The local indices of the owned grains of walls that move as a drive says, and of feet on flat
/// walls; in order.
#[derive(Debug, Clone, Copy, Default)]
pub struct WallGrains<'a> {
    /// Of the top.
    pub top: &'a [u32],
    /// Of the bottom, if it vibrates.
    pub bottom: &'a [u32],
}

impl WallGrains<'_> {
    /// Those of some indices.
    pub(crate) fn within(mut self, grains: Range<usize>) -> Self {
        // As a rule all, or none: no search then.
        let ends = [self.top, self.bottom].map(|walls| [walls.first(), walls.last()]);
        let mut ends = ends.into_iter().flatten().flatten();
        if ends.all(|&g| grains.contains(&(g as usize))) {
            return self;
        }
        self.split_off(grains.end);
        self.split_off(grains.start)
    }

    /// Splits off those from an index on.
    pub(crate) fn split_off(&mut self, first: usize) -> Self {
        let top = self.top.partition_point(|&g| (g as usize) < first);
        let bottom = self.bottom.partition_point(|&g| (g as usize) < first);
        Self {
            top: tail(&mut self.top, top),
            bottom: tail(&mut self.bottom, bottom),
        }
    }
}

/// The velocities of the grains of walls (m/s).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WallVelocities {
    /// Of the top, along x and upwards.
    pub top: [f64; 2],
    /// Of the bottom, along x and upwards, if it vibrates.
    pub bottom: Option<[f64; 2]>,
}

impl WallVelocities {
    /// Gives them to grains of walls, in the fields that begin at `at`, of the records of the
    /// grains from `first` on.
    pub(crate) fn give<D: Dimension>(
        &self,
        walls: WallGrains<'_>,
        at: &[usize],
        first: usize,
        record: &mut [D::Record],
    ) {
        let mut give_to = |grains: &[u32], [along, up]: [f64; 2]| {
            for &g in grains {
                let r = D::fields_mut(&mut record[g as usize - first]);
                for at in at {
                    r[*at] = along;
                    r[at + D::UP] = up;
                }
            }
        };
        give_to(walls.top, self.top);
        if let Some(bottom) = self.bottom {
            give_to(walls.bottom, bottom);
        }
    }
}

/// The velocities of the grains of walls in a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WallMotion {
    /// With which they move, also those of the half step.
    pub moving: WallVelocities,
    /// Which they have then.
    pub predicted: WallVelocities,
}

/// The walls and the drag, as the time step calls them. The default methods are those of a scene
/// without walls.
pub trait Drive<D: Dimension>: Sync {
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
    /// First half kick and drift of the cell, before any grain moves.
    fn drift_cell(&mut self, _step: f64, _: &mut Cell, _: &Grains<D>) {}
    /// Gives the cell its predicted velocity, after [`Drive::drift_cell`].
    fn predict_cell(&mut self, _step: f64, _: &mut Cell) {}
    /// First half kick and drift of the walls, before the last band of grains moves, which has all
    /// of the top. Returns how the grains of walls move in this step.
    fn drift(&mut self, _step: f64) -> Option<WallMotion> {
        None
    }
    /// How the grains of the bottom move in a step before [`Drive::drift`] is called for it, and
    /// for `ahead` steps before it. Velocities of the top are NaN.
    fn bottom(&self, _ahead: u64) -> Option<WallMotion> {
        None
    }
    /// The grains of the walls.
    fn wall_grains(&self) -> WallGrains<'_> {
        WallGrains::default()
    }
    /// What the step does to all grains beside their own motion, after [`Drive::drift_cell`].
    fn streaming(&self) -> Option<Streaming> {
        None
    }
    /// Adds forces of the walls on the grains that are not contacts between grains. Returns a grain
    /// whose overlap is outside the law.
    fn forces(&mut self, _: Isa, _: Cell, _step: f64, _: &mut Grains<D>) -> Option<usize> {
        None
    }
    /// The heights (m) of planes that grains touch, if there are some: of bottom and top.
    fn planes(&self) -> Option<[f64; 2]> {
        None
    }
    /// The forces that are summed over the ranks.
    fn summed_forces(&self) -> SummedForces {
        SummedForces::OnTop
    }
    /// Adds the forces on these grains of [`Drive::wall_grains`].
    fn load_on_grains(
        &self,
        _first: usize,
        _force: &[D::Force],
        _fixed: &FixedPoint,
        _walls: WallGrains<'_>,
        _sums: &mut WallSums,
    ) {
    }
    /// Adds the forces on what else bounds the sample.
    fn load(&self, _: &Felt<'_, D>, _: &mut WallSums) {}
    /// The stress of the contacts that it needs; `sampled`: their forces are measured in this step.
    fn needed_stress(&self, _sampled: bool) -> NeededStress {
        NeededStress::Nothing
    }
    /// Second half kick, by the forces on the walls. Returns the velocities of the grains of walls
    /// at the end of the step.
    fn kick(&mut self, _step: f64, _: WallForces) -> Option<WallVelocities> {
        None
    }
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
