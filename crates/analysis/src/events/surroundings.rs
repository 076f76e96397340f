//! What happens to the grains of a sample over an event.

use super::propagator::Change;
use crate::displacement;
use crate::interval::Interval;
use crate::rattlers::RattlerRule;
use crate::stress;
use gshear_dem::state::{Frame, GrainConstants};

/// What happens between the frames before and after an event.
#[derive(Debug, Clone, PartialEq)]
pub struct Surroundings {
    /// Of the grains.
    pub change: Change,
    /// Fall of the mean shear stress of the free grains (Pa).
    pub stress_drop: f64,
    /// Fall of the ratio of their mean shear stress to their mean normal stress across the shear.
    pub stress_ratio_drop: f64,
}

/// Mean stresses of the free grains of a frame, weighted by their volumes (Pa).
struct MeanStress {
    shear: f64,
    normal: f64,
}

impl MeanStress {
    fn ratio(&self) -> f64 {
        self.shear / self.normal
    }
}

impl Surroundings {
    /// Compares two frames with contact forces.
    ///
    /// The shear stress of a grain is -σ between flow and gradient of [`stress::tensors`], so that
    /// it is positive against the imposed shear. Changes of stress are less the mean change over
    /// the grains that count: those that are free, not removed, and no rattlers in the earlier
    /// frame.
    pub fn of(grains: &GrainConstants, interval: &Interval<'_>, rattlers: RattlerRule) -> Self {
        let earlier = interval.earlier();
        let (up, axes) = (earlier.dimension.axes() - 1, earlier.dimension.axes());
        let stresses = interval.frames.map(|frame| stress::tensors(grains, frame));
        let means = [0, 1].map(|k| mean_stress(grains, interval.frames[k], &stresses[k]));
        let mut rattler = Vec::new();
        rattlers.mark(grains, earlier, &mut rattler);
        let included: Vec<bool> = (0..grains.count())
            .map(|n| {
                let is_present = interval.frames.iter().all(|frame| !frame.is_removed(n));
                is_present && grains.body[n] == 0 && !rattler[n]
            })
            .collect();
        let left_out: Vec<bool> = included.iter().map(|is_included| !is_included).collect();
        let mut displacement = Vec::new();
        displacement::non_affine(interval, &left_out, &mut displacement);
        let [before, after] = &stresses;
        let changes = before.iter().zip(after);
        let shear = changes
            .clone()
            .map(|(a, b)| shear_of(b, up) - shear_of(a, up));
        let pressure = changes.map(|(a, b)| pressure_of(b, axes) - pressure_of(a, axes));
        let (mut shear, mut pressure): (Vec<f64>, Vec<f64>) = (shear.collect(), pressure.collect());
        for values in [&mut shear, &mut pressure] {
            let counted = values.iter().zip(&included).filter(|(_, counts)| **counts);
            let count = counted.clone().count() as f64;
            let mean = counted.map(|(value, _)| value).sum::<f64>() / count;
            values.iter_mut().for_each(|value| *value -= mean);
        }
        Self {
            stress_drop: means[0].shear - means[1].shear,
            stress_ratio_drop: means[0].ratio() - means[1].ratio(),
            change: Change {
                cell: earlier.cell,
                place: (0..grains.count()).map(|n| earlier.position(n)).collect(),
                displacement,
                shear,
                pressure,
                included,
            },
        }
    }
}

/// The shear stress of a stress tensor. `up`: number of the gradient axis.
fn shear_of(stress: &[f64; 6], up: usize) -> f64 {
    // xy or xz.
    -stress[2 + up]
}

fn pressure_of(stress: &[f64; 6], axes: usize) -> f64 {
    stress[..axes].iter().sum::<f64>() / axes as f64
}

fn mean_stress(grains: &GrainConstants, frame: &Frame, stresses: &[[f64; 6]]) -> MeanStress {
    let up = frame.dimension.axes() - 1;
    let (mut volumes, mut shear, mut normal) = (0.0, 0.0, 0.0);
    for (n, stress) in stresses.iter().enumerate() {
        if grains.body[n] != 0 || frame.is_removed(n) {
            continue;
        }
        let volume = frame.dimension.volume(grains.radius[n]);
        volumes += volume;
        shear += volume * shear_of(stress, up);
        normal += volume * stress[up];
    }
    MeanStress {
        shear: shear / volumes,
        normal: normal / volumes,
    }
}
