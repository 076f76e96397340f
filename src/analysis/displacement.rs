//! The non-affine displacement field between two frames (LH figures 7 and 20).

use super::neighbourhood::separation;
use crate::state::{Disks, Frame};

/// How far every grain moved beside the mean deformation of the sample, [N] (m); into `field`.
///
/// The mean deformation is the map u = a + b y that fits the displacements best (least squares over all grains but those in
/// `left_out`): simple shear and stretch along y, all that a sample periodic along x can have. LH do not say which map they take off.
pub fn non_affine(
    grains: &Disks,
    earlier: &Frame,
    later: &Frame,
    left_out: &[bool],
    field: &mut Vec<[f64; 2]>,
) {
    let places = earlier.position.iter().zip(&later.position);
    field.clear();
    field.extend(places.map(|(from, to)| separation(grains.length, *from, *to)));
    let included = || (0..field.len()).filter(|n| !left_out[*n]);
    let count = included().count() as f64;
    let height = |n: usize| earlier.position[n][1];
    let middle = included().map(height).sum::<f64>() / count;
    let spread = included()
        .map(|n| (height(n) - middle).powi(2))
        .sum::<f64>();
    let fit = [0, 1].map(|k| {
        let mean = included().map(|n| field[n][k]).sum::<f64>() / count;
        let slope = included()
            .map(|n| field[n][k] * (height(n) - middle))
            .sum::<f64>()
            / spread;
        // One height alone has no slope.
        (mean, if slope.is_finite() { slope } else { 0.0 })
    });
    for (n, u) in field.iter_mut().enumerate() {
        let y = earlier.position[n][1] - middle;
        for (u, (mean, slope)) in u.iter_mut().zip(fit) {
            *u -= mean + slope * y;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::testing::{frame, grains_in, mapped, scattered};
    use nalgebra::{Matrix2, Vector2};

    #[test]
    fn shear_and_stretch_leave_nothing_and_what_is_added_remains() {
        let grains = grains_in(40.0, &[1.0; 300]);
        let points = scattered(1, 300, 40.0, 30.0);
        let map = Matrix2::new(1.0, 0.02, 0.0, 0.99);
        let shift = Vector2::new(0.3, -0.1);
        let mut moved: Vec<_> = mapped(&points, map).iter().map(|r| r + shift).collect();
        // One grain, left out of the fit, moves on its own, and so across the seam.
        moved[7] += Vector2::new(5.0, 2.0);
        let mut left_out = vec![false; 300];
        left_out[7] = true;
        let mut field = Vec::new();
        let (earlier, later) = (frame(&grains, &points), frame(&grains, &moved));
        non_affine(&grains, &earlier, &later, &left_out, &mut field);
        for (n, u) in field.iter().enumerate() {
            let wanted = if n == 7 { [5.0, 2.0] } else { [0.0, 0.0] };
            let off = (u[0] - wanted[0]).hypot(u[1] - wanted[1]);
            assert!(off < 1e-12, "grain {n}: {u:?}");
        }
    }
}
