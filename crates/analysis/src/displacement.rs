//! The non-affine displacement field of disks between two frames (LH figures 7 and 20) and its
//! local direction of greatest extension.

use nalgebra::{Matrix2, Vector2};

use super::interval::Interval;
use super::neighbourhood::separation;
use gshear_dem::state::Frame;

/// Writes to `field` the displacement of every grain relative to the mean deformation of the
/// sample, `[N]` (m).
///
/// The mean deformation is the map u = a + b y fitted to the displacements by least squares over
/// all grains but those in `left_out`. A sample periodic along x can only have simple shear and
/// stretch along y. LH do not say which map they subtract. NaN of a grain that was removed.
pub fn non_affine(interval: &Interval<'_>, left_out: &[bool], field: &mut Vec<[f64; 2]>) {
    let earlier = interval.earlier();
    field.clear();
    field.extend((0..left_out.len()).map(|n| {
        let [x, y, _] = interval.displacement(n);
        let is_removed = interval.frames.iter().any(|frame| frame.is_removed(n));
        if is_removed { [f64::NAN; 2] } else { [x, y] }
    }));
    let included = (0..field.len()).filter(|n| !left_out[*n] && field[*n][0].is_finite());
    let included: Vec<usize> = included.collect();
    let heights: Vec<f64> = included.iter().map(|n| earlier.position(*n)[1]).collect();
    let count = included.len() as f64;
    let middle = heights.iter().sum::<f64>() / count;
    let spread: f64 = heights.iter().map(|height| (height - middle).powi(2)).sum();
    let fit = [0, 1].map(|k| {
        let mean = included.iter().map(|n| field[*n][k]).sum::<f64>() / count;
        let products = included.iter().zip(&heights);
        let products = products.map(|(n, height)| field[*n][k] * (height - middle));
        let slope = products.sum::<f64>() / spread;
        // If all grains have the same height, there is no slope.
        (mean, if slope.is_finite() { slope } else { 0.0 })
    });
    for (n, u) in field.iter_mut().enumerate() {
        let y = earlier.position(n)[1] - middle;
        for (u, (mean, slope)) in u.iter_mut().zip(fit) {
            *u -= mean + slope * y;
        }
    }
}

/// Returns the unit vector of greatest extension around `centre`; the direction of compression is
/// normal to it.
///
/// It is the principal axis of the symmetric displacement gradient, fitted by least squares to the
/// displacements `field` (m) of the grains within `radius` (m) for which `left_out` is false.
/// `None` if the fit is singular or no direction is extended more than others.
pub fn tension(
    frame: &Frame,
    field: &[[f64; 2]],
    left_out: impl Fn(usize) -> bool,
    centre: [f64; 2],
    radius: f64,
) -> Option<[f64; 2]> {
    let near = (0..field.len())
        .filter(|n| !left_out(*n))
        .map(|n| {
            let [x, y, _] = frame.position(n);
            (n, separation(frame.cell.periods[0], centre, [x, y]))
        })
        .filter(|(_, d)| d[0].hypot(d[1]) <= radius)
        .map(|(n, d)| (Vector2::from(d), Vector2::from(field[n])))
        .collect::<Vec<_>>();
    let count = near.len() as f64;
    let middle = near.iter().map(|(d, _)| d).sum::<Vector2<f64>>() / count;
    let mean = near.iter().map(|(_, u)| u).sum::<Vector2<f64>>() / count;
    let (mut spread, mut moved) = (Matrix2::zeros(), Matrix2::zeros());
    for (d, u) in &near {
        let d = d - middle;
        spread += d * d.transpose();
        moved += (u - mean) * d.transpose();
    }
    let gradient = moved * spread.try_inverse()?;
    let shear = gradient[(0, 1)] + gradient[(1, 0)];
    let difference = gradient[(0, 0)] - gradient[(1, 1)];
    let angle = 0.5 * shear.atan2(difference);
    let is_extended = shear.hypot(difference) > 0.0;
    is_extended.then(|| [angle.cos(), angle.sin()])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{frame, mapped, scattered};

    const L: f64 = 40.0;

    #[test]
    fn tension_is_where_the_gradient_stretches_most() {
        let points = scattered(1, 300, L, 30.0);
        let frame = frame(L, &points);
        // Near the periodic boundary, which the separations cross.
        let centre = Vector2::new(1.0, 15.0);
        for angle in [0.3_f64, -1.2, 1.5] {
            let along = Vector2::new(angle.cos(), angle.sin());
            // Stretched along `along`, rotated and shifted; arbitrary far away.
            let map = 1e-3 * along * along.transpose() + Matrix2::new(0.0, -0.5, 0.5, 0.0);
            let field = frame.grains.iter().map(|grain| {
                let [x, y, _] = grain.position;
                let d = Vector2::from(separation(L, centre.into(), [x, y]));
                let u = map * d + Vector2::new(0.1, 0.2);
                if d.norm() < 8.0 {
                    u.into()
                } else {
                    [1.0, -7.0]
                }
            });
            let field = field.collect::<Vec<_>>();
            let found = tension(&frame, &field, |n| n == 3, centre.into(), 8.0);
            let found = Vector2::from(found.expect("a direction"));
            let off = found.dot(&along).abs() - 1.0;
            assert!(off.abs() < 1e-9, "{angle}: {found}");
        }
        let still = vec![[0.0; 2]; 300];
        for radius in [8.0, 0.0] {
            let found = tension(&frame, &still, |_| false, centre.into(), radius);
            assert_eq!(found, None);
        }
    }

    #[test]
    fn shear_and_stretch_leave_nothing_and_what_is_added_remains() {
        let points = scattered(1, 300, L, 30.0);
        let map = Matrix2::new(1.0, 0.02, 0.0, 0.99);
        let shift = Vector2::new(0.3, -0.1);
        let mut moved: Vec<_> = mapped(&points, map).iter().map(|r| r + shift).collect();
        // One grain, left out of the fit, moves on its own across the boundary.
        moved[7] += Vector2::new(65.0, 2.0);
        let mut left_out = vec![false; 300];
        left_out[7] = true;
        let mut field = Vec::new();
        let (earlier, later) = (frame(L, &points), frame(L, &moved));
        let interval = Interval::between_walls([&earlier, &later]);
        non_affine(&interval, &left_out, &mut field);
        for (n, u) in field.iter().enumerate() {
            let wanted = if n == 7 { [65.0, 2.0] } else { [0.0, 0.0] };
            let off = (u[0] - wanted[0]).hypot(u[1] - wanted[1]);
            assert!(off < 1e-12, "grain {n}: {u:?}");
        }
    }
}
