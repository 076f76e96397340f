//! Contact stress of single grains, and the stress ratio τ on the top wall, from the contacts of a
//! frame.

use nalgebra::Matrix3;

use super::forces::{self, ContactVectors};
use gshear_dem::dimension::Dimensions;
use gshear_dem::state::{Frame, GrainConstants, body};

/// The axes of the components of a stress, in their order.
const COMPONENTS: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [0, 1], [0, 2], [1, 2]];

/// Returns the contact stress of every grain, `[N]` of σ_xx, σ_yy, σ_zz, σ_xy, σ_xz, σ_yz (Pa;
/// forces in 2D are per unit depth). Compression is positive.
///
/// ```text
/// σ = (1/V) Σ_c R n ⊗ f,  V = πR² or (4/3)πR³
/// ```
///
/// The sum is over the grain's contacts c, those with flat walls as well, n points towards the
/// grain, f is the force on it, and the tensor is made symmetric. The lever arm is the full radius
/// R, as in the contact forces.
pub fn tensors(grains: &GrainConstants, frame: &Frame) -> Vec<[f64; 6]> {
    let mut stress = force_moments(grains, frame);
    for contact in &frame.wall_contacts {
        let moment = forces::vectors(frame, contact).moment();
        let of_grain = stress[contact.i as usize].iter_mut().zip(moment);
        of_grain.for_each(|(sum, moment)| *sum += moment);
    }
    for (stress, radius) in stress.iter_mut().zip(&grains.radius) {
        for s in stress {
            *s *= radius / frame.dimension.volume(*radius);
        }
    }
    stress
}

impl ContactVectors {
    /// n ⊗ f, symmetric, components as of [`tensors`].
    fn moment(&self) -> [f64; 6] {
        let Self { normal, force } = self;
        COMPONENTS.map(|[a, b]| 0.5 * (normal[a] * force[b] + normal[b] * force[a]))
    }
}

/// Σ n ⊗ f over the contacts of every grain with others, symmetric, components as of [`tensors`].
fn force_moments(grains: &GrainConstants, frame: &Frame) -> Vec<[f64; 6]> {
    let mut moments = vec![[0.0; 6]; grains.count()];
    for contact in &frame.contacts {
        let moment = forces::vectors(frame, contact).moment();
        // n and f both change sign for j.
        for grain in [contact.i, contact.j] {
            let of_grain = moments[grain as usize].iter_mut().zip(moment);
            of_grain.for_each(|(sum, moment)| *sum += moment);
        }
    }
    moments
}

/// Returns τ = S/N from the contacts of a frame (LH section 2).
///
/// S and N are the forces of the free grains on those of the top wall, or on a flat one: S against
/// the wall's motion along +x, N away from the sample. NaN if no free grain touches the top wall.
pub fn ratio_on_top(grains: &GrainConstants, frame: &Frame) -> f64 {
    let up = frame.dimension.axes() - 1;
    let mut on_wall = [0.0; 2];
    for contact in &frame.contacts {
        let [i, j] =
            [contact.i, contact.j].map(|n| u32::from(grains.body[n as usize]) == body::TOP);
        let sign = match (i, j) {
            (true, false) => 1.0,
            (false, true) => -1.0,
            _ => continue,
        };
        let force = forces::vectors(frame, contact).force;
        on_wall = [on_wall[0] + sign * force[0], on_wall[1] + sign * force[up]];
    }
    for contact in &frame.wall_contacts {
        if contact.wall(grains.count()) == Some(body::TOP) {
            let force = forces::vectors(frame, contact).force;
            on_wall = [on_wall[0] - force[0], on_wall[1] - force[up]];
        }
    }
    -on_wall[0] / on_wall[1]
}

/// Returns σ_p of every grain, `[N]` (Pa): the largest principal value of its stress.
pub(crate) fn largest_principals(grains: &GrainConstants, frame: &Frame) -> Vec<f64> {
    if frame.dimension == Dimensions::Three {
        let stresses = tensors(grains, frame).into_iter();
        let principals = stresses.map(|[xx, yy, zz, xy, xz, yz]| {
            let stress = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
            stress.symmetric_eigenvalues().max()
        });
        return principals.collect();
    }
    let moments = force_moments(grains, frame).into_iter();
    let principals = moments.zip(&grains.radius).map(|(moments, radius)| {
        // R/(πR²) would round differently from what runs have stored.
        let scale = 1.0 / (std::f64::consts::PI * radius);
        let [xx, yy, _, xy, ..] = moments.map(|sum| sum * scale);
        largest_principal(xx, yy, xy)
    });
    principals.collect()
}

/// Returns the largest principal value of a stress in the plane.
fn largest_principal(xx: f64, yy: f64, xy: f64) -> f64 {
    let half = 0.5 * (xx - yy);
    0.5 * (xx + yy) + (half * half + xy * xy).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{grains_of, pushed, touching};
    use nalgebra::Matrix2;
    use std::f64::consts::PI;

    #[test]
    fn a_disk_under_equal_pressure_from_all_sides_has_the_pressure_of_the_formula() {
        // Six equal forces F around a disk of radius R: σ = 3 F/(πR) in every direction.
        let (radius, force) = (2.0, 5.0);
        let grains = grains_of(&[radius; 7]);
        let around = (1..7).map(|k| {
            let angle = 0.3 + PI / 3.0 * f64::from(k);
            [50.0 + 4.0 * angle.cos(), 50.0 + 4.0 * angle.sin()]
        });
        let places: Vec<[f64; 2]> = std::iter::once([50.0, 50.0]).chain(around).collect();
        let contacts = (1..7).map(|k| pushed(0, k, force, 0.0)).collect();
        let mut frame = touching(100.0, &places, contacts);
        let wanted = 3.0 * force / (PI * radius);
        let [xx, yy, _, xy, ..] = tensors(&grains, &frame)[0];
        assert!((xx - wanted).abs() < 1e-13 && (yy - wanted).abs() < 1e-13 && xy.abs() < 1e-13);
        // One force alone: R F/(πR²) along it.
        let principal = largest_principals(&grains, &frame);
        assert!((principal[3] - force / (PI * radius)).abs() < 1e-13);
        frame.contacts.remove(0);
        let without = largest_principals(&grains, &frame);
        assert_eq!((without[1], without[3]), (0.0, principal[3]));
    }

    #[test]
    fn tangential_forces_of_a_balanced_disk_give_shear() {
        // Four contacts on the axes, F_t = ±T so that the torques cancel: T along ±y at the sides,
        // along ±x above and below.
        let grains = grains_of(&[1.0; 5]);
        let middle = [50.0, 50.0];
        let places = [
            middle,
            [52.0, 50.0],
            [50.0, 52.0],
            [48.0, 50.0],
            [50.0, 48.0],
        ];
        let contact = |k: u32| pushed(0, k, 0.0, if k % 2 == 1 { 3.0 } else { -3.0 });
        let frame = touching(100.0, &places, (1..5).map(contact).collect());
        let [xx, yy, _, xy, ..] = tensors(&grains, &frame)[0];
        assert!(xx.abs() < 1e-15 && yy.abs() < 1e-15, "{xx} {yy}");
        assert!((xy - 2.0 * 3.0 / PI).abs() < 1e-14, "{xy}");
    }

    #[test]
    fn the_ratio_on_the_top_wall_is_that_of_the_forces_on_it() {
        // Grain 2 of the top wall rests on 0 and 1; grain 3 belongs to the top wall as well.
        let mut grains = grains_of(&[1.0; 4]);
        grains.body = vec![0, 0, 2, 2];
        let height = 3.0_f64.sqrt();
        let contacts = vec![
            pushed(0, 2, 2.0, 0.0),
            pushed(1, 2, 4.0, 0.0),
            pushed(2, 3, 99.0, 9.0),
        ];
        let places = [[49.0, 0.0], [51.0, 0.0], [50.0, height], [52.0, height]];
        // On 2: 2 (½, √3/2) + 4 (-½, √3/2) = (-1, 3√3).
        let found = ratio_on_top(&grains, &touching(100.0, &places, contacts));
        assert!((found - 1.0 / (3.0 * height)).abs() < 1e-15, "{found}");
        assert!(ratio_on_top(&grains, &touching(100.0, &places, Vec::new())).is_nan());
    }

    #[test]
    fn the_largest_principal_stress_is_the_greater_eigenvalue() {
        let tensors = [
            [1.0, 2.0, 0.5],
            [-3.0, 4.0, 7.0],
            [2.0, 2.0, 0.0],
            [0.0, 0.0, -1.0],
        ];
        for [xx, yy, xy] in tensors {
            let eigen = Matrix2::new(xx, xy, xy, yy).symmetric_eigenvalues();
            let found = largest_principal(xx, yy, xy);
            assert!((found - eigen.max()).abs() < 1e-14, "{xx} {yy} {xy}");
        }
    }
}
