//! The stress across a plane.

use super::{Contact, Needs, Observable, SampleView, Total};

/// A component of the stress across a plane of the last axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StressComponent {
    /// Along the last axis, compression positive.
    Normal,
    /// Along x, positive where what is below pulls what is above backwards, as a sheared sample
    /// pulls the top wall.
    Shear,
}

/// The force that the contacts transmit through a plane across the last axis, over its area (Pa):
/// that of what is below on what is above, of all contacts whose line of centres crosses the plane.
///
/// The momentum that grains carry through the plane is not in it. Over a layer that is
/// Σ m u_z u_i/V, which is a sum over grains.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneStress {
    /// The height of the plane over h.
    pub place: f64,
    /// The component.
    pub component: StressComponent,
}

impl Observable for PlaneStress {
    fn needs(&self) -> Needs {
        Needs {
            contacts: true,
            ..Needs::GRAINS
        }
    }

    fn contact(&self, sample: &SampleView, contact: &Contact, totals: &mut [Total]) {
        let (up, h) = (sample.up(), sample.height());
        let height = contact.position[up] - sample.bottom;
        let plane = self.place * h;
        // A contact across the seam of a periodic cell may cross the plane's image.
        let images: &[f64] = if sample.is_periodic {
            &[-1.0, 0.0, 1.0]
        } else {
            &[0.0]
        };
        for image in images {
            let above = height - (plane + image * h);
            let i_is_above = above >= 0.0;
            let j_is_above = above - contact.separation[up] >= 0.0;
            if i_is_above == j_is_above {
                continue;
            }
            let sign = if i_is_above { 1.0 } else { -1.0 };
            totals[0].add(match self.component {
                StressComponent::Normal => sign * contact.force[up],
                StressComponent::Shear => -sign * contact.force[0],
            });
        }
    }

    fn value(&self, sample: &SampleView, totals: &[Total]) -> f64 {
        totals[0].sum() / sample.base()
    }
}
