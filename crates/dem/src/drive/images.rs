//! A cell without walls: its images above move.

use super::{Drive, Felt, Top, WallForces, WallSteps};
use crate::dimension::Dimension;
use crate::domain::{Accumulator, MOST_COUNTED, nearest_whole};
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
    /// h'/h and h/h' of the last step, if they are not 1.
    stretches: Option<[f64; 2]>,
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
            stretches: None,
        }
    }

    /// Gives the grains the change of their streaming velocities if the images get this velocity
    /// (m/s).
    fn stream<D: Dimension>(velocity: f64, sheared: &mut Sheared, grains: &mut Grains<D>) {
        let change = (velocity - sheared.velocity) / sheared.height;
        sheared.velocity = velocity;
        if change == 0.0 {
            return;
        }
        for g in 0..grains.owned {
            let r = grains.fields_mut(g);
            let more = change * r[D::UP];
            for at in [D::VELOCITY, D::HALF_VELOCITY] {
                r[at] += more;
            }
        }
    }
}

impl<D: Dimension> Drive<D> for Images {
    fn start(&mut self, load: WallForces) {
        self.felt = load;
        self.motion.start(load);
    }

    fn changes_velocities(&self, step: f64, cell: &Cell) -> bool {
        let next = self.motion.slider.next_velocity(step);
        cell.sheared.is_some_and(|sheared| sheared.velocity != next)
    }

    fn drift(&mut self, step: f64, cell: &mut Cell, grains: &mut Grains<D>) {
        self.motion.drift(step);
        let Some(sheared) = &mut cell.sheared else {
            return;
        };
        let velocity = self.motion.slider.state.velocity;
        Self::stream(velocity, sheared, grains);
        sheared.half_velocity = velocity;
        let (before, height) = (sheared.height, self.motion.piston.height);
        (sheared.stretching, self.stretches) = (None, None);
        if height == before {
            return;
        }
        let shrinks = before / height;
        self.stretches = Some([height / before, shrinks]);
        sheared.height = height;
        let mut stretching = Stretching::default();
        stretching.half[D::UP] = (1.0 - shrinks) / step;
        sheared.stretching = Some(stretching);
    }

    fn stretches(&self) -> Option<[f64; 2]> {
        self.stretches
    }

    fn predict(&mut self, step: f64, cell: &mut Cell, grains: &mut Grains<D>) {
        let Some(sheared) = &mut cell.sheared else {
            return;
        };
        let [along, up] = self.motion.predicted(step);
        if let Some(stretching) = &mut sheared.stretching {
            stretching.full[D::UP] = up / sheared.height;
        }
        Self::stream(along, sheared, grains);
    }

    fn needs_stress(&self, sampled: bool) -> bool {
        self.needs_stress || sampled
    }

    fn load(&self, felt: &Felt<'_, D>, [up, along, _]: &mut [Accumulator; 3]) {
        let Felt {
            cell,
            grains,
            fixed,
            stress,
        } = felt;
        let (Some(stress), Some(sheared)) = (stress, cell.sheared) else {
            return;
        };
        let unit = grains.units.force;
        let per_unit = 1.0 / (sheared.height * unit);
        let mut counts = *stress;
        let mut greatest = 0.0_f64;
        for (record, mass) in grains.record[..grains.owned].iter().zip(&grains.mass) {
            let u = cell.peculiar_velocity::<D>(D::fields(record));
            let flow = mass * per_unit * u[D::UP];
            let [of_up, of_along] = [flow * u[D::UP], flow * u[0]];
            greatest = greatest.max(of_up).max(of_along.abs());
            counts[0] += i128::from(nearest_whole(of_up));
            counts[1] += i128::from(nearest_whole(of_along));
        }
        // Faster than that grains are lost: what is outside ends the run.
        let unit = if greatest < MOST_COUNTED {
            unit
        } else {
            f64::NAN
        };
        fixed.add_whole(up, counts[0], unit);
        fixed.add_whole(along, counts[1], unit);
    }

    fn kick(&mut self, step: f64, forces: WallForces, _: &mut Grains<D>) {
        self.felt = forces;
        self.motion.kick(step, forces);
    }

    fn moved(&self) -> WallSteps {
        self.motion.moved()
    }
}
