//! Walls of frozen grains, or flat ones.

use super::{Drive, Felt, Slider, Top, WallForces, WallSteps, WallSums};
use crate::dimension::Dimension;
use crate::protocol::Protocol;
use crate::simd::Isa;
use crate::state::{Cell, Grains, body};

/// Walls of frozen grains, or flat walls, whose feet stand for these. The bottom is fixed, or
/// vibrates along its normal. The top is rigid and moves as `motion` says.
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

    /// Gives the grains of the top these velocities, and those of a bottom that vibrates that
    /// upwards, in the fields that begin at `at`.
    fn impose<D: Dimension>(
        &self,
        at: &[usize],
        velocity: [f64; 2],
        bottom: impl FnOnce(&Protocol) -> f64,
        grains: &mut Grains<D>,
    ) {
        for &g in &self.top {
            let r = grains.fields_mut(g as usize);
            for at in at {
                r[*at] = velocity[0];
                r[at + D::UP] = velocity[1];
            }
        }
        let protocol = &self.motion.slider.protocol;
        if !protocol.has_bottom() {
            return;
        }
        let up = bottom(protocol);
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
        let Top { slider, piston, .. } = &self.motion;
        let velocity = [slider.state.velocity, piston.velocity];
        self.impose(&[D::VELOCITY, D::HALF_VELOCITY], velocity, bottom, grains);
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
        let bottom = protocol.full_bottom_velocity(state.step);
        self.motion.piston.velocity.abs().max(bottom.abs())
    }

    fn planes(&self) -> Option<[f64; 2]> {
        let [bottom, top] = self.flat?;
        let Top { piston, .. } = &self.motion;
        Some([
            bottom + self.motion.bottom_displacement(),
            top + piston.height,
        ])
    }

    fn start(&mut self, load: WallForces) {
        self.motion.start(load);
    }

    fn drift(&mut self, step: f64, _: &mut Cell, grains: &mut Grains<D>) {
        let now = self.motion.slider.state.step;
        self.motion.drift(step);
        self.impose_velocities(|protocol| protocol.bottom_velocity(now), grains);
    }

    fn predict(&mut self, step: f64, _: &mut Cell, grains: &mut Grains<D>) {
        let now = self.motion.slider.state.step;
        let bottom = |protocol: &Protocol| protocol.full_bottom_velocity(now);
        let velocity = self.motion.predicted(step);
        self.impose(&[D::VELOCITY], velocity, bottom, grains);
    }

    fn has_bottom_force(&self) -> bool {
        self.motion.slider.protocol.has_bottom()
    }

    fn load(&self, felt: &Felt<'_, D>, sums: &mut WallSums) {
        let Felt { grains, fixed, .. } = felt;
        for &g in &self.top {
            fixed.add(&mut sums.up, grains.force[g as usize][D::UP]);
        }
        if self.motion.along {
            for &g in &self.top {
                fixed.add(&mut sums.along, grains.force[g as usize][0]);
            }
        }
        for &g in &self.bottom {
            fixed.add(&mut sums.bottom, grains.force[g as usize][D::UP]);
        }
    }

    fn kick(&mut self, step: f64, forces: WallForces, grains: &mut Grains<D>) {
        let now = self.motion.slider.state.step;
        self.motion.kick(step, forces);
        self.impose_velocities(|protocol| protocol.full_bottom_velocity(now), grains);
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
            self.impose_velocities(|protocol| protocol.full_bottom_velocity(now), grains);
        }
    }
}
