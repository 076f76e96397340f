//! A cell without walls: its images above move.

use super::{Drive, Felt, Top, WallForces, WallSteps, WallSums, WallVelocities};
use crate::dimension::Dimension;
use crate::domain::{MOST_COUNTED, nearest_whole};
use crate::state::{Cell, Grains, Sheared, Stretching};

/// The images above a cell that is periodic along its last axis, too (Lees and Edwards, J. Phys. C
/// 5, 1921, 1972). They move as a top wall would that feels the stress of the sample, times the
/// base of the cell.
///
/// Along x the images have the velocity V, and the grains at height y of a cell of height h stream
/// with V y/h. Where V changes, the grains get the change of that at once, so that the shear stays
/// homogeneous (the SLLOD equations; Evans and Morriss, Phys. Rev. A 30, 1528, 1984). Along the
/// last axis the cell is stretched affinely: with y = h s, the grains have the velocity u = h
/// ds/dt, and m du/dt = F - m u (dh/dt)/h (Andersen, J. Chem. Phys. 72, 2384, 1980). In a step y
/// becomes y h'/h + Δt u and then u becomes u h/h', which is of second order and the same
/// backwards.
#[derive(Debug)]
pub struct Images {
    /// The motion of the images.
    pub motion: Top,
    /// The stress in the last step at which it was measured, times the base.
    pub felt: WallForces,
    /// Whether the stress is needed in every step.
    needs_stress: bool,
    /// Of the step between [`Drive::drift_cell`] and [`Drive::predict_cell`].
    streaming: Option<Streaming>,
}

/// What a step of a cell without walls does to its grains beside their own motion.
#[derive(Debug, Clone, Copy)]
pub struct Streaming {
    /// h'/h and h/h'.
    pub stretches: [f64; 2],
    /// The changes of V/h (1/s), by which the velocities change times y: before the drift and
    /// after it.
    pub changes: [f64; 2],
    /// The flow of momentum after the step.
    pub flow: Option<MomentumFlow>,
}

/// The kinetic part of the stress: by the velocities of grains less those with which they stream.
#[derive(Debug, Clone, Copy)]
pub struct MomentumFlow {
    cell: Cell,
    /// 1/(h F) with the unit F of the forces (1/N, or m/N in 2D).
    per_unit: f64,
}

/// A sum of [`MomentumFlow::of`] over grains.
#[derive(Debug, Clone, Copy, Default)]
pub struct FlowSum {
    counts: [i128; 2],
    /// The bits of the greatest flow, which are greatest for NaN.
    greatest: u64,
}

impl MomentumFlow {
    /// In a sheared cell; `unit`: that of the forces (N, or N/m in 2D).
    fn new(cell: Cell, unit: f64) -> Option<Self> {
        let per_unit = 1.0 / (cell.sheared?.height * unit);
        Some(Self { cell, per_unit })
    }

    /// m u_y u_y/h and m u_x u_y/h of a grain, in units of the forces.
    #[inline(always)]
    pub fn of<D: Dimension>(&self, mass: f64, fields: &[f64]) -> [f64; 2] {
        let u = self.cell.peculiar_velocity::<D>(fields);
        let flow = mass * self.per_unit * u[D::UP];
        [flow * u[D::UP], flow * u[0]]
    }

    /// Over all grains of a rank, before the first step.
    pub fn over<D: Dimension>(cell: &Cell, grains: &Grains<D>) -> FlowSum {
        let mut sum = FlowSum::default();
        if let Some(flow) = Self::new(*cell, grains.units.force) {
            for (record, mass) in grains.record[..grains.owned].iter().zip(&grains.mass) {
                sum.add(flow.of::<D>(*mass, D::fields(record)));
            }
        }
        sum
    }
}

impl FlowSum {
    /// Adds the flow of a grain.
    #[inline(always)]
    pub fn add(&mut self, flow: [f64; 2]) {
        let [up, along] = flow;
        self.counts[0] += i128::from(nearest_whole(up));
        self.counts[1] += i128::from(nearest_whole(along));
        self.greatest = self.greatest.max((up + along.abs()).to_bits());
    }

    /// Adds the sum over other grains.
    pub fn merge(&mut self, other: Self) {
        for (count, more) in self.counts.iter_mut().zip(other.counts) {
            *count += more;
        }
        self.greatest = self.greatest.max(other.greatest);
    }

    /// Adds the sum to counts of the contacts. Grains that are too fast, faster than that they are
    /// lost, end the run: they make the counts greater than [`crate::domain::Accumulator`] takes.
    pub(crate) fn add_to(self, stress: &mut [i128; 2]) {
        let is_too_fast = self.greatest >= MOST_COUNTED.to_bits();
        for (to, count) in stress.iter_mut().zip(self.counts) {
            *to = if is_too_fast {
                i128::MAX
            } else {
                to.saturating_add(count)
            };
        }
    }
}

impl Images {
    /// Images that move like this.
    pub fn new(motion: Top) -> Self {
        let mut segments = motion.slider.protocol.segments().iter();
        let is_loaded = segments.any(|segment| segment.normal_velocity().is_none());
        Self {
            needs_stress: is_loaded || motion.along,
            motion,
            felt: WallForces::default(),
            streaming: None,
        }
    }
}

impl<D: Dimension> Drive<D> for Images {
    fn start(&mut self, load: WallForces) {
        self.felt = load;
        self.motion.start(load);
    }

    fn drift_cell(&mut self, step: f64, cell: &mut Cell, grains: &Grains<D>) {
        self.motion.drift(step);
        let Some(sheared) = cell.sheared.as_mut() else {
            return;
        };
        let velocity = self.motion.slider.state.velocity;
        let [predicted, _] = self.motion.predicted(step);
        let (before, height) = (sheared.height, self.motion.piston.height);
        let shrinks = before / height;
        let changes = [
            (velocity - sheared.velocity) / before,
            (predicted - velocity) / height,
        ];
        (sheared.velocity, sheared.half_velocity) = (velocity, velocity);
        sheared.height = height;
        sheared.stretching = (height != before).then(|| {
            let mut stretching = Stretching::default();
            stretching.half[D::UP] = (1.0 - shrinks) / step;
            stretching
        });
        let sheared = Some(Sheared {
            velocity: predicted,
            ..*sheared
        });
        self.streaming = Some(Streaming {
            stretches: [height / before, shrinks],
            changes,
            flow: MomentumFlow::new(Cell { sheared, ..*cell }, grains.units.force),
        });
    }

    fn streaming(&self) -> Option<Streaming> {
        self.streaming
    }

    fn predict_cell(&mut self, step: f64, cell: &mut Cell) {
        let Some(sheared) = cell.sheared.as_mut() else {
            return;
        };
        let [along, up] = self.motion.predicted(step);
        if let Some(stretching) = &mut sheared.stretching {
            stretching.full[D::UP] = up / sheared.height;
        }
        sheared.velocity = along;
    }

    fn needs_stress(&self, sampled: bool) -> bool {
        self.needs_stress || sampled
    }

    fn load(&self, felt: &Felt<'_, D>, sums: &mut WallSums) {
        let unit = felt.grains.units.force;
        let [up, along] = felt.stress.unwrap_or_default();
        felt.fixed.add_whole(&mut sums.up, up, unit);
        felt.fixed.add_whole(&mut sums.along, along, unit);
    }

    fn kick(&mut self, step: f64, forces: WallForces) -> Option<WallVelocities> {
        self.felt = forces;
        self.motion.kick(step, forces);
        None
    }

    fn moved(&self) -> WallSteps {
        self.motion.moved()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Accumulator;
    use crate::domain::FixedPoint;

    /// Contacts and flows of grains are added; one flow that cannot be counted ends the run.
    #[test]
    fn flows_are_added_or_end_the_run() {
        let fixed = FixedPoint::new(1.0);
        let value = |flows: &[[f64; 2]]| {
            let mut sum = FlowSum::default();
            for flow in flows {
                let mut of_share = FlowSum::default();
                of_share.add(*flow);
                sum.merge(of_share);
            }
            let mut stress = [100, -7];
            sum.add_to(&mut stress);
            stress.map(|count| {
                let mut to = Accumulator::default();
                fixed.add_whole(&mut to, count, 1.0);
                fixed.value(to)
            })
        };
        assert_eq!(value(&[[2.0, -3.4], [1.0, 0.5]]), [103.0, -10.0]);
        for flow in [[1e17, 0.0], [0.0, -1e17], [f64::NAN, 0.0]] {
            assert!(
                value(&[[1.0; 2], flow]).iter().all(|x| x.is_nan()),
                "{flow:?}"
            );
        }
    }
}
