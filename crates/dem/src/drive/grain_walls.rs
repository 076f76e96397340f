//! Walls of frozen grains, or flat ones.

use super::{
    Drive, Slider, SummedForces, Top, WallForces, WallGrains, WallMotion, WallSteps, WallSums,
    WallVelocities,
};
use crate::dimension::Dimension;
use crate::domain::FixedPoint;
use crate::protocol::Protocol;
use crate::simd::Isa;
use crate::state::{Grains, body};

/// Walls of frozen grains, or flat walls, whose feet stand for these. The bottom is fixed, or
/// vibrates. The top is rigid and moves as `motion` says.
#[derive(Debug)]
pub struct GrainWalls {
    /// The motion of the top, and what is imposed on the walls.
    pub motion: Top,
    /// Owned grains of the top wall.
    pub top: Vec<u32>,
    /// Owned grains of the bottom wall, if it vibrates.
    pub bottom: Vec<u32>,
    /// Of flat walls, the heights (m) from which the motion of the bottom and the piston's height
    /// count; infinite for a top that is not there.
    pub flat: Option<[f64; 2]>,
}

impl GrainWalls {
    /// Walls without their grains.
    pub fn new(motion: Top) -> Self {
        Self {
            motion,
            top: Vec::new(),
            bottom: Vec::new(),
            flat: None,
        }
    }

    /// The velocities of the walls, where the bottom has this one (m/s), which is asked for only if
    /// it vibrates.
    fn velocities(
        &self,
        top: [f64; 2],
        bottom: impl FnOnce(&Protocol) -> [f64; 2],
    ) -> WallVelocities {
        let protocol = &self.motion.slider.protocol;
        WallVelocities {
            top,
            bottom: protocol.has_bottom().then(|| bottom(protocol)),
        }
    }

    /// How the grains of the bottom move in the step that begins in `ahead` steps. Velocities of
    /// the top are NaN.
    fn bottom_motion(&self, ahead: u64) -> WallMotion {
        let begin = self.motion.slider.state.step + ahead;
        let of_bottom = |velocity: fn(&Protocol, u64) -> [f64; 2], step: u64| {
            self.velocities([f64::NAN; 2], |protocol| velocity(protocol, step))
        };
        WallMotion {
            moving: of_bottom(Protocol::bottom_velocity, begin),
            predicted: of_bottom(Protocol::full_bottom_velocity, begin + 1),
        }
    }

    /// The present velocity of the top, along x and upwards (m/s).
    fn velocity_of_top(&self) -> [f64; 2] {
        let Top { slider, piston, .. } = &self.motion;
        [slider.state.velocity, piston.velocity]
    }
}

impl<D: Dimension> Drive<D> for GrainWalls {
    fn speed(&self) -> f64 {
        if self.flat.is_none() {
            // Wall grains have it.
            return 0.0;
        }
        let Slider {
            protocol, state, ..
        } = &self.motion.slider;
        let [_, bottom] = protocol.full_bottom_velocity(state.step);
        self.motion.piston.velocity.abs().max(bottom.abs())
    }

    fn planes(&self) -> Option<[f64; 2]> {
        let [bottom, top] = self.flat?;
        let Top { piston, .. } = &self.motion;
        Some([
            bottom + self.motion.bottom_displacement()[1],
            top + piston.height,
        ])
    }

    fn start(&mut self, load: WallForces) {
        self.motion.start(load);
    }

    fn drift(&mut self, step: f64) -> Option<WallMotion> {
        let bottom = self.bottom_motion(0);
        self.motion.drift(step);
        Some(WallMotion {
            moving: WallVelocities {
                top: self.velocity_of_top(),
                ..bottom.moving
            },
            predicted: WallVelocities {
                top: self.motion.predicted(step),
                ..bottom.predicted
            },
        })
    }

    fn bottom(&self, ahead: u64) -> Option<WallMotion> {
        Some(self.bottom_motion(ahead))
    }

    fn wall_grains(&self) -> WallGrains<'_> {
        WallGrains {
            top: &self.top,
            bottom: &self.bottom,
        }
    }

    fn summed_forces(&self) -> SummedForces {
        let protocol = &self.motion.slider.protocol;
        if protocol.has_bottom_along() {
            SummedForces::OnTopAndBottomBothWays
        } else if protocol.has_bottom() {
            SummedForces::OnTopAndBottom
        } else {
            SummedForces::OnTop
        }
    }

    fn load_on_grains(
        &self,
        first: usize,
        force: &[D::Force],
        fixed: &FixedPoint,
        walls: WallGrains<'_>,
        sums: &mut WallSums,
    ) {
        for &g in walls.top {
            fixed.add(&mut sums.up, force[g as usize - first][D::UP]);
        }
        if self.motion.along {
            for &g in walls.top {
                fixed.add(&mut sums.along, force[g as usize - first][0]);
            }
        }
        for &g in walls.bottom {
            fixed.add(&mut sums.bottom, force[g as usize - first][D::UP]);
        }
        if self.motion.slider.protocol.has_bottom_along() {
            for &g in walls.bottom {
                fixed.add(&mut sums.bottom_along, force[g as usize - first][0]);
            }
        }
    }

    fn kick(&mut self, step: f64, forces: WallForces) -> Option<WallVelocities> {
        let now = self.motion.slider.state.step;
        self.motion.kick(step, forces);
        Some(self.velocities(self.velocity_of_top(), |protocol| {
            protocol.full_bottom_velocity(now)
        }))
    }

    fn moved(&self) -> WallSteps {
        self.motion.moved()
    }

    fn renumber(&mut self, _: Isa, grains: &mut Grains<D>, _: f64) {
        self.top = grains.of_body(body::TOP).collect();
        if self.motion.slider.protocol.has_bottom() {
            self.bottom = grains.of_body(body::BOTTOM).collect();
        }
        if self.flat.is_some() {
            // New feet are at rest.
            let now = self.motion.slider.state.step;
            let velocities = self.velocities(self.velocity_of_top(), |protocol| {
                protocol.full_bottom_velocity(now)
            });
            let walls = Drive::<D>::wall_grains(self);
            let at = [D::VELOCITY, D::HALF_VELOCITY];
            velocities.give::<D>(walls, &at, 0, &mut grains.record);
        }
    }
}
