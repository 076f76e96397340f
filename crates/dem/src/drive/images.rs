//! A cell without walls: its images above move.

use super::lateral::CellStresses;
use super::{
    Drive, Felt, LateralLengths, NeededStress, SummedForces, Top, WallForces, WallSteps, WallSums,
    WallVelocities,
};
use crate::dimension::Dimension;
use crate::domain::{MOST_COUNTED, nearest_whole};
use crate::kernel::STRESSES;
use crate::protocol::Segment;
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
///
/// The lengths across the height may change as well. Grains are then stretched by half of a step's
/// change before they move, and by the other half after it ([`LateralStretch`]). Forces on the top
/// are stresses times the base at the start; only works are those of the base as it is.
#[derive(Debug)]
pub struct Images {
    /// The motion of the images.
    pub motion: Top,
    /// The lengths across the height, if they change.
    pub lateral: Option<LateralLengths>,
    /// The stress in the last step at which it was measured, times the base at the start.
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
    /// The changes of the lengths across the height, if they change.
    pub lateral: Option<LateralStretch>,
    /// The flow of momentum after the step.
    pub flow: Option<MomentumFlow>,
}

/// How a step stretches grains along the lateral axes: each half of it multiplies lengths by f and
/// divides velocities, but for the streaming V y/h, by it, with f² = L'/L.
#[derive(Debug, Clone, Copy)]
pub struct LateralStretch {
    /// f.
    pub half: [f64; 2],
    /// 1/f.
    pub slower: [f64; 2],
    /// V/h (1/s) before the height changes and after it, with V of the half step.
    pub shear_rates: [f64; 2],
}

impl LateralStretch {
    /// Moves a grain along the lateral axes with the velocity `v` (m/s) of the half step; `height`
    /// (m): its height before the step.
    #[inline(always)]
    pub fn drift<D: Dimension>(&self, fields: &mut [f64], v: &[f64; 3], height: f64, step: f64) {
        let [before, after] = self.shear_rates;
        let mut streams = [before * height, after * fields[D::UP]];
        for axis in 0..D::UP {
            let (half, slower) = (self.half[axis], self.slower[axis]);
            let [first, last] = streams;
            let middle = |v: f64| first + (v - first) * slower;
            fields[axis] = (fields[axis] * half + step * middle(v[axis])) * half;
            for at in [D::VELOCITY + axis, D::HALF_VELOCITY + axis] {
                fields[at] = last + (middle(fields[at]) - last) * slower;
            }
            // Only along x.
            streams = [0.0; 2];
        }
    }
}

/// The kinetic part of the stress: by the velocities of grains less those with which they stream.
#[derive(Debug, Clone, Copy)]
pub struct MomentumFlow {
    cell: Cell,
    /// 1/(h F) with the unit F of the forces (1/N, or m/N in 2D).
    per_unit: f64,
    /// The same with the lengths across the height, if the stresses along these are needed.
    lateral: Option<[f64; 2]>,
}

/// A sum of [`MomentumFlow::of`] over grains.
#[derive(Debug, Clone, Copy, Default)]
pub struct FlowSum {
    counts: [i128; STRESSES],
    /// The bits of the greatest flow, which are greatest for NaN.
    greatest: u64,
}

impl MomentumFlow {
    /// In a sheared cell; `unit`: that of the forces (N, or N/m in 2D). `has_lateral`: with the
    /// flows along the axes across the height.
    fn new(cell: Cell, unit: f64, has_lateral: bool) -> Option<Self> {
        let per_unit = 1.0 / (cell.sheared?.height * unit);
        let lateral = if has_lateral {
            Some(cell.periods.map(|length| 1.0 / (length * unit)))
        } else {
            None
        };
        Some(Self {
            cell,
            per_unit,
            lateral,
        })
    }

    /// m u_y u_y/h and m u_x u_y/h of a grain, in units of the forces, and m u_a u_a/L_a along the
    /// axes across the height.
    #[inline(always)]
    pub fn of<D: Dimension>(&self, mass: f64, fields: &[f64]) -> [f64; STRESSES] {
        let u = self.cell.peculiar_velocity::<D>(fields);
        let flow = mass * self.per_unit * u[D::UP];
        let mut flows = [flow * u[D::UP], flow * u[0], 0.0, 0.0];
        if let Some(per_unit) = self.lateral {
            for axis in 0..D::UP {
                flows[2 + axis] = mass * per_unit[axis] * u[axis] * u[axis];
            }
        }
        flows
    }

    /// Over all grains of a rank, before the first step.
    pub fn over<D: Dimension>(cell: &Cell, grains: &Grains<D>) -> FlowSum {
        let mut sum = FlowSum::default();
        if let Some(flow) = Self::new(*cell, grains.units.force, true) {
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
    pub fn add(&mut self, flow: [f64; STRESSES]) {
        let [up, along, lateral @ ..] = flow;
        self.counts[0] += i128::from(nearest_whole(up));
        self.counts[1] += i128::from(nearest_whole(along));
        self.greatest = self.greatest.max((up + along.abs()).to_bits());
        // Those that are not needed are 0.
        if lateral != [0.0; 2] {
            for (count, flow) in self.counts[2..].iter_mut().zip(lateral) {
                *count += i128::from(nearest_whole(flow));
                self.greatest = self.greatest.max(flow.to_bits());
            }
        }
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
    pub(crate) fn add_to(self, stress: &mut [i128; STRESSES]) {
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
            lateral: None,
            felt: WallForces::default(),
            streaming: None,
        }
    }

    /// The forces on the cell, and its stresses if its lengths change: those that the drive feels,
    /// which are stresses times the base at the start.
    fn nominal(&self, mut forces: WallForces) -> (WallForces, Option<CellStresses>) {
        let stresses = self.lateral.as_ref().map(|lateral| {
            let height = self.motion.piston.height;
            let stresses = lateral.stresses(forces.up, forces.lateral, height);
            forces.up = lateral.of_base_at_start(forces.up);
            forces.along = lateral.of_base_at_start(forces.along);
            stresses
        });
        (forces, stresses)
    }

    /// The force under which the top rises in a segment.
    fn rises_by(
        &self,
        segment: &Segment,
        forces: &WallForces,
        stresses: Option<CellStresses>,
    ) -> f64 {
        match (&self.lateral, stresses) {
            (Some(lateral), Some(stresses)) if LateralLengths::is_isotropic(segment) => {
                lateral.on_top(stresses.mean)
            }
            _ => forces.up,
        }
    }
}

impl<D: Dimension> Drive<D> for Images {
    fn start(&mut self, load: WallForces) {
        let (felt, stresses) = self.nominal(load);
        self.felt = felt;
        let protocol = &self.motion.slider.protocol;
        let up = self.rises_by(protocol.segment(0), &felt, stresses);
        if let (Some(lateral), Some(stresses)) = (&mut self.lateral, &stresses) {
            lateral.start(stresses, protocol);
        }
        self.motion.start(WallForces { up, ..felt });
    }

    fn drift_cell(&mut self, step: f64, cell: &mut Cell, grains: &Grains<D>) {
        let now = self.motion.slider.state.step;
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
        let lateral = self.lateral.as_mut().map(|lateral| {
            let protocol = &self.motion.slider.protocol;
            let stretches = lateral.drift(step, now, protocol, height / before);
            let half = stretches.map(f64::sqrt);
            let stretching = sheared.stretching.get_or_insert_default();
            for (rate, stretch) in stretching.half[..D::UP].iter_mut().zip(stretches) {
                *rate = (1.0 - 1.0 / stretch) / step;
            }
            sheared.offset *= stretches[0];
            sheared.half_stretch = half[0];
            let offset = &mut lateral.state.unwrapped_offset;
            *offset = *offset * stretches[0] + sheared.step_of_images(step);
            for (period, axis) in cell.periods.iter_mut().zip(&lateral.state.axes) {
                *period = axis.height;
            }
            LateralStretch {
                half,
                slower: half.map(f64::recip),
                shear_rates: [velocity / before, velocity / height],
            }
        });
        let sheared = Some(Sheared {
            velocity: predicted,
            ..*sheared
        });
        let has_lateral = lateral.is_some();
        self.streaming = Some(Streaming {
            stretches: [height / before, shrinks],
            changes,
            lateral,
            flow: MomentumFlow::new(Cell { sheared, ..*cell }, grains.units.force, has_lateral),
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
            let rate = up / sheared.height;
            stretching.full[D::UP] = rate;
            if let Some(lateral) = &self.lateral {
                let slider = &self.motion.slider;
                let rates = lateral.predicted(step, slider.state.step, &slider.protocol, rate);
                stretching.full[..D::UP].copy_from_slice(&rates[..D::UP]);
            }
        }
        sheared.velocity = along;
    }

    fn needed_stress(&self, sampled: bool) -> NeededStress {
        if self.lateral.is_some() {
            NeededStress::AlongAllAxes
        } else if self.needs_stress || sampled {
            NeededStress::OnBase
        } else {
            NeededStress::Nothing
        }
    }

    fn summed_forces(&self) -> SummedForces {
        if self.lateral.is_some() {
            SummedForces::OnTopAndSides
        } else {
            SummedForces::OnTop
        }
    }

    fn load(&self, felt: &Felt<'_, D>, sums: &mut WallSums) {
        let unit = felt.grains.units.force;
        let [up, along, lateral @ ..] = felt.stress.unwrap_or_default();
        felt.fixed.add_whole(&mut sums.up, up, unit);
        felt.fixed.add_whole(&mut sums.along, along, unit);
        if self.lateral.is_some() {
            for (sum, count) in sums.lateral.iter_mut().zip(lateral) {
                felt.fixed.add_whole(sum, count, unit);
            }
        }
    }

    fn kick(&mut self, step: f64, forces: WallForces) -> Option<WallVelocities> {
        let (felt, stresses) = self.nominal(forces);
        self.felt = felt;
        let slider = &self.motion.slider;
        let now = slider.state.step;
        let [last, next] = [
            slider.protocol.segment_before(now),
            slider.protocol.segment(now),
        ];
        let [up, next_up] = [last, next].map(|part| self.rises_by(part, &felt, stresses));
        self.motion
            .kick_anew(step, WallForces { up, ..felt }, next_up);
        if let (Some(lateral), Some(stresses)) = (&mut self.lateral, &stresses) {
            let rate = self.motion.piston.velocity / self.motion.piston.height;
            let protocol = &self.motion.slider.protocol;
            lateral.kick(step, stresses, now, protocol, rate);
        }
        None
    }

    fn moved(&self) -> WallSteps {
        let lateral = self.lateral.as_ref().map(|lateral| lateral.grew);
        WallSteps {
            lateral: lateral.unwrap_or_default(),
            ..self.motion.moved()
        }
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
        let value = |flows: &[[f64; STRESSES]]| {
            let mut sum = FlowSum::default();
            for flow in flows {
                let mut of_share = FlowSum::default();
                of_share.add(*flow);
                sum.merge(of_share);
            }
            let mut stress = [100, -7, 3, 0];
            sum.add_to(&mut stress);
            stress.map(|count| {
                let mut to = Accumulator::default();
                fixed.add_whole(&mut to, count, 1.0);
                fixed.value(to)
            })
        };
        let flows = [[2.0, -3.4, 0.0, 0.0], [1.0, 0.5, 8.0, 1.2]];
        assert_eq!(value(&flows), [103.0, -10.0, 11.0, 1.0]);
        for at in 0..STRESSES {
            for great in [1e17, f64::NAN] {
                let mut flow = [0.0; STRESSES];
                flow[at] = great;
                let values = value(&[[1.0; STRESSES], flow]);
                assert!(values.iter().all(|x| x.is_nan()), "{flow:?}");
            }
        }
        let backwards = [0.0, -1e17, 0.0, 0.0];
        let values = value(&[[1.0; STRESSES], backwards]);
        assert!(values.iter().all(|x| x.is_nan()));
    }
}
