//! Contact stress of single grains and, of disks, the stress ratio τ on the top wall, from the
//! contacts of a frame.

use super::forces;
use gshear_dem::dimension::Dimension;
use gshear_dem::state::{Cell, Disks, Frame, FrameRecords};

/// Returns the contact stress of every grain, `[N]` of σ_xx, σ_yy, σ_xy (Pa; forces in 2D are per
/// unit depth). Compression is positive.
///
/// ```text
/// σ = (1/A) Σ_c R n ⊗ f,  A = πR²
/// ```
///
/// The sum is over the grain's contacts c, n points towards the grain, f is the force on it, and
/// the tensor is made symmetric. The lever arm is the full radius R, as in the contact forces.
pub fn tensors(grains: &Disks, frame: &Frame) -> Vec<[f64; 3]> {
    let mut stress = vec![[0.0; 3]; grains.count()];
    for contact in &frame.contacts {
        let (n, f) = forces::vector(grains, frame, contact);
        let moment = [n[0] * f[0], n[1] * f[1], 0.5 * (n[0] * f[1] + n[1] * f[0])];
        // n and f both change sign for j.
        for grain in [contact.i, contact.j] {
            let stress = &mut stress[grain as usize];
            (0..3).for_each(|k| stress[k] += moment[k]);
        }
    }
    for (stress, radius) in stress.iter_mut().zip(&grains.radius) {
        let scale = 1.0 / (std::f64::consts::PI * radius);
        for s in stress {
            *s *= scale;
        }
    }
    stress
}

/// [`tensors`] in two or three dimensions and any cell, `[N]` of σ_xx, σ_yy, σ_zz, σ_xy, σ_xz, σ_yz
/// (Pa), of spheres with the volume (4/3)πR³ for A.
pub fn in_cell<D: Dimension>(grains: &Disks, cell: Cell, frame: &FrameRecords) -> Vec<[f64; 6]> {
    let mut stress = vec![[0.0; 6]; grains.count()];
    for contact in &frame.contacts {
        let [i, j] = [contact.i, contact.j].map(|g| g as usize);
        let [from, to] = [j, i].map(|g| frame.grains[g].position);
        let r = cell.separation::<D>(&to, &from);
        let distance = r.iter().map(|x| x * x).sum::<f64>().sqrt();
        let n = r.map(|x| x / distance);
        // Of disks the frame has the component along (-n_y, n_x).
        let tangential = match (D::AXES, contact.tangential_force) {
            (2, [along, ..]) => [-along * n[1], along * n[0], 0.0],
            (_, vector) => vector,
        };
        let f: [f64; 3] = std::array::from_fn(|k| contact.normal_force * n[k] + tangential[k]);
        let symmetric = |a: usize, b: usize| 0.5 * (n[a] * f[b] + n[b] * f[a]);
        let moment = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];
        for grain in [i, j] {
            for (sum, (a, b)) in stress[grain].iter_mut().zip(moment) {
                *sum += symmetric(a, b);
            }
        }
    }
    for (stress, radius) in stress.iter_mut().zip(&grains.radius) {
        for s in stress {
            *s *= radius / D::volume(*radius);
        }
    }
    stress
}

/// Returns τ = S/N from the contacts of a frame (LH section 2).
///
/// S and N are the forces of the free grains on those of the top wall: S against the wall's motion
/// along +x, N away from the sample. NaN if no free grain touches the top wall.
pub fn ratio_on_top(grains: &Disks, frame: &Frame) -> f64 {
    const TOP: u8 = 2;
    let mut on_wall = [0.0; 2];
    for contact in &frame.contacts {
        let [i, j] = [contact.i, contact.j].map(|n| grains.body[n as usize] == TOP);
        let sign = match (i, j) {
            (true, false) => 1.0,
            (false, true) => -1.0,
            _ => continue,
        };
        let (_, f) = forces::vector(grains, frame, contact);
        on_wall = [on_wall[0] + sign * f[0], on_wall[1] + sign * f[1]];
    }
    -on_wall[0] / on_wall[1]
}

/// Returns σ_p, the largest principal stress of the tensor σ_xx, σ_yy, σ_xy.
pub fn largest_principal([xx, yy, xy]: [f64; 3]) -> f64 {
    let half = 0.5 * (xx - yy);
    0.5 * (xx + yy) + (half * half + xy * xy).sqrt()
}

/// Returns σ_p of every grain, `[N]` (Pa).
pub fn largest_principals(grains: &Disks, frame: &Frame) -> Vec<f64> {
    let tensors = tensors(grains, frame).into_iter();
    tensors.map(largest_principal).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{grains_in, pushed, touching};
    use nalgebra::Matrix2;
    use std::f64::consts::PI;

    #[test]
    fn a_disk_under_equal_pressure_from_all_sides_has_the_pressure_of_the_formula() {
        // Six equal forces F around a disk of radius R: σ = 3 F/(πR) in every direction.
        let (radius, force) = (2.0, 5.0);
        let grains = grains_in(100.0, &[radius; 7]);
        let around = (1..7).map(|k| {
            let angle = 0.3 + PI / 3.0 * f64::from(k);
            [50.0 + 4.0 * angle.cos(), 50.0 + 4.0 * angle.sin()]
        });
        let places = std::iter::once([50.0, 50.0]).chain(around).collect();
        let contacts = (1..7).map(|k| pushed(0, k, force, 0.0)).collect();
        let mut frame = touching(places, contacts);
        let wanted = 3.0 * force / (PI * radius);
        let [xx, yy, xy] = tensors(&grains, &frame)[0];
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
        let grains = grains_in(100.0, &[1.0; 5]);
        let middle = [50.0, 50.0];
        let places = vec![
            middle,
            [52.0, 50.0],
            [50.0, 52.0],
            [48.0, 50.0],
            [50.0, 48.0],
        ];
        let contact = |k: u32| pushed(0, k, 0.0, if k % 2 == 1 { 3.0 } else { -3.0 });
        let [xx, yy, xy] = tensors(&grains, &touching(places, (1..5).map(contact).collect()))[0];
        assert!(xx.abs() < 1e-15 && yy.abs() < 1e-15, "{xx} {yy}");
        assert!((xy - 2.0 * 3.0 / PI).abs() < 1e-14, "{xy}");
    }

    #[test]
    fn the_ratio_on_the_top_wall_is_that_of_the_forces_on_it() {
        // Grain 2 of the top wall rests on 0 and 1; grain 3 belongs to the top wall as well.
        let mut grains = grains_in(100.0, &[1.0; 4]);
        grains.body = vec![0, 0, 2, 2];
        let height = 3.0_f64.sqrt();
        let contacts = vec![
            pushed(0, 2, 2.0, 0.0),
            pushed(1, 2, 4.0, 0.0),
            pushed(2, 3, 99.0, 9.0),
        ];
        let places = vec![[49.0, 0.0], [51.0, 0.0], [50.0, height], [52.0, height]];
        // On 2: 2 (½, √3/2) + 4 (-½, √3/2) = (-1, 3√3).
        let found = ratio_on_top(&grains, &touching(places, contacts));
        assert!((found - 1.0 / (3.0 * height)).abs() < 1e-15, "{found}");
        assert!(ratio_on_top(&grains, &Frame::default()).is_nan());
    }

    #[test]
    fn the_largest_principal_stress_is_the_greater_eigenvalue() {
        let tensors = [
            [1.0, 2.0, 0.5],
            [-3.0, 4.0, 7.0],
            [2.0, 2.0, 0.0],
            [0.0, 0.0, -1.0],
        ];
        for s in tensors {
            let eigen = Matrix2::new(s[0], s[2], s[2], s[1]).symmetric_eigenvalues();
            assert!((largest_principal(s) - eigen.max()).abs() < 1e-14, "{s:?}");
        }
    }
}
