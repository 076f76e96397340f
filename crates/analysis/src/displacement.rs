//! The non-affine displacement field between two frames (LH figures 7 and 20) and its local
//! direction of greatest extension.

use nalgebra::{Matrix3, Vector3};

use super::interval::Interval;
use gshear_dem::dimension::{Dimension, Dimensions, Three, Two};
use gshear_dem::state::{BoxEdges, Frame};

/// Writes to `field` the displacement of every grain relative to the mean deformation of the
/// sample, `[N]` (m).
///
/// Between walls the mean deformation is the map u = a + b y (of spheres a + b z) fitted to the
/// displacements by least squares over all grains but those in `left_out`: a sample periodic along
/// the walls can only have simple shear and stretch across them. LH do not say which map they
/// subtract. In a box it is the deformation of the cell and the mean displacement (Tanguy et al.,
/// Phys. Rev. B 66, 174205, 2002). NaN of a grain that was removed.
pub fn non_affine(interval: &Interval<'_>, left_out: &[bool], field: &mut Vec<[f64; 3]>) {
    field.clear();
    field.extend((0..left_out.len()).map(|n| {
        let is_removed = interval.frames.iter().any(|frame| frame.is_removed(n));
        if is_removed {
            [f64::NAN; 3]
        } else {
            interval.displacement(n)
        }
    }));
    match interval.later().dimension {
        Dimensions::Two => subtract_mean::<Two>(interval, left_out, field),
        Dimensions::Three => subtract_mean::<Three>(interval, left_out, field),
    }
}

/// Subtracts the mean deformation of the sample from displacements (m).
fn subtract_mean<D: Dimension>(interval: &Interval<'_>, left_out: &[bool], field: &mut [[f64; 3]]) {
    let earlier = interval.earlier();
    let included = (0..field.len()).filter(|n| !left_out[*n] && field[*n][0].is_finite());
    let included: Vec<usize> = included.collect();
    let count = included.len() as f64;
    if earlier.cell.sheared.is_some() {
        let edges = [earlier.cell.edges::<D>(0.0), interval.later_edges::<D>()];
        for (n, u) in field.iter_mut().enumerate() {
            let moved = moved_with_cell::<D>(&edges, earlier.grains[n].position);
            (0..D::AXES).for_each(|axis| u[axis] -= moved[axis]);
        }
        for axis in 0..D::AXES {
            let mean = included.iter().map(|n| field[*n][axis]).sum::<f64>() / count;
            field.iter_mut().for_each(|u| u[axis] -= mean);
        }
        return;
    }
    let heights: Vec<f64> = (included.iter())
        .map(|n| earlier.position(*n)[D::UP])
        .collect();
    let middle = heights.iter().sum::<f64>() / count;
    let spread: f64 = heights.iter().map(|height| (height - middle).powi(2)).sum();
    for axis in 0..D::AXES {
        let mean = included.iter().map(|n| field[*n][axis]).sum::<f64>() / count;
        let products = included.iter().zip(&heights);
        let products = products.map(|(n, height)| field[*n][axis] * (height - middle));
        let slope = products.sum::<f64>() / spread;
        // If all grains have the same height, there is no slope.
        let slope = if slope.is_finite() { slope } else { 0.0 };
        for (n, u) in field.iter_mut().enumerate() {
            u[axis] -= mean + slope * (earlier.position(n)[D::UP] - middle);
        }
    }
}

/// How far a point of the earlier cell moves with the cell (m). `edges`: of the earlier and the
/// later cell.
fn moved_with_cell<D: Dimension>(edges: &[BoxEdges; 2], position: [f64; 3]) -> [f64; 3] {
    let [earlier, later] = edges;
    let mut rest = position;
    let mut moved = [0.0; 3];
    // Edges have components along their own axis, and the last one along x.
    for axis in (0..D::AXES).rev() {
        let share = rest[axis] / earlier[axis][axis];
        for k in 0..D::AXES {
            rest[k] -= share * earlier[axis][k];
            moved[k] += share * (later[axis][k] - earlier[axis][k]);
        }
    }
    moved
}

/// Returns the unit vector of greatest extension around `centre`; the direction of compression is
/// normal to it.
///
/// It is the principal axis of the symmetric displacement gradient, fitted by least squares to the
/// displacements `field` (m) of the grains within `radius` (m) for which `left_out` is false.
/// `None` if the fit is singular or no direction is extended more than others.
pub fn tension(
    frame: &Frame,
    field: &[[f64; 3]],
    left_out: impl Fn(usize) -> bool,
    centre: [f64; 3],
    radius: f64,
) -> Option<[f64; 3]> {
    match frame.dimension {
        Dimensions::Two => tension_in::<Two>(frame, field, left_out, centre, radius),
        Dimensions::Three => tension_in::<Three>(frame, field, left_out, centre, radius),
    }
}

fn tension_in<D: Dimension>(
    frame: &Frame,
    field: &[[f64; 3]],
    left_out: impl Fn(usize) -> bool,
    centre: [f64; 3],
    radius: f64,
) -> Option<[f64; 3]> {
    let near = (0..field.len())
        .filter(|n| !left_out(*n))
        .map(|n| (n, frame.cell.separation::<D>(&frame.position(n), &centre)))
        .map(|(n, d)| (Vector3::from(d), Vector3::from(field[n])))
        .filter(|(d, _)| d.norm() <= radius)
        .collect::<Vec<_>>();
    let count = near.len() as f64;
    let middle = near.iter().map(|(d, _)| d).sum::<Vector3<f64>>() / count;
    let mean = near.iter().map(|(_, u)| u).sum::<Vector3<f64>>() / count;
    let (mut spread, mut moved) = (Matrix3::zeros(), Matrix3::zeros());
    for (d, u) in &near {
        let d = d - middle;
        spread += d * d.transpose();
        moved += (u - mean) * d.transpose();
    }
    (D::AXES..3).for_each(|axis| spread[(axis, axis)] = 1.0);
    let gradient = moved * spread.try_inverse()?;
    if D::AXES == 2 {
        let shear = gradient[(0, 1)] + gradient[(1, 0)];
        let difference = gradient[(0, 0)] - gradient[(1, 1)];
        let angle = 0.5 * shear.atan2(difference);
        let is_extended = shear.hypot(difference) > 0.0;
        return is_extended.then(|| [angle.cos(), angle.sin(), 0.0]);
    }
    let eigen = (0.5 * (gradient + gradient.transpose())).symmetric_eigen();
    let greatest = eigen.eigenvalues.imax();
    let others = (0..3).filter(|k| *k != greatest);
    let next = others
        .map(|k| eigen.eigenvalues[k])
        .fold(f64::NEG_INFINITY, f64::max);
    let is_extended = eigen.eigenvalues[greatest] > next;
    is_extended.then(|| eigen.eigenvectors.column(greatest).into_owned().into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{frame, mapped, scattered};
    use bytemuck::Zeroable;
    use gshear_dem::state::{Cell, GrainSample, Sheared};
    use nalgebra::{Matrix2, Vector2};

    const L: f64 = 40.0;

    #[test]
    fn tension_is_where_the_gradient_stretches_most() {
        let points = scattered(1, 300, L, 30.0);
        let frame = frame(L, &points);
        // Near the periodic boundary, which the separations cross.
        let centre = [1.0, 15.0, 0.0];
        for angle in [0.3_f64, -1.2, 1.5] {
            let along = Vector2::new(angle.cos(), angle.sin());
            // Stretched along `along`, rotated and shifted; arbitrary far away.
            let map = 1e-3 * along * along.transpose() + Matrix2::new(0.0, -0.5, 0.5, 0.0);
            let field = frame.grains.iter().map(|grain| {
                let [x, y, _] = frame.cell.separation::<Two>(&grain.position, &centre);
                let d = Vector2::new(x, y);
                let u = map * d + Vector2::new(0.1, 0.2);
                if d.norm() < 8.0 {
                    [u.x, u.y, 0.0]
                } else {
                    [1.0, -7.0, 0.0]
                }
            });
            let field = field.collect::<Vec<_>>();
            let found = tension(&frame, &field, |n| n == 3, centre, 8.0);
            let [x, y, _] = found.expect("a direction");
            let found = Vector2::new(x, y);
            let off = found.dot(&along).abs() - 1.0;
            assert!(off.abs() < 1e-9, "{angle}: {found}");
        }
        let still = vec![[0.0; 3]; 300];
        for radius in [8.0, 0.0] {
            let found = tension(&frame, &still, |_| false, centre, radius);
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
            let wanted = if n == 7 { [65.0, 2.0] } else { [0.0; 2] };
            let off = (u[0] - wanted[0]).hypot(u[1] - wanted[1]);
            assert!(off < 1e-12, "grain {n}: {u:?}");
        }
    }

    /// Spheres between walls, and in a box whose offset passes a period.
    #[test]
    fn mean_deformations_of_spheres_and_boxes_leave_nothing() {
        let places = scattered(2, 200, L, L);
        let depth = scattered(3, 200, L, L);
        let places: Vec<[f64; 3]> = (places.iter().zip(&depth))
            .map(|(r, d)| [r.x + 0.5 * L, r.y + 0.5 * L, d.x + 0.5 * L])
            .collect();
        for is_box in [false, true] {
            let mut cells = [Cell {
                periods: [L; 2],
                sheared: is_box.then(|| Sheared::upright(L)),
            }; 2];
            let periods = cells[1].shear(1.3 * L);
            let shift = if is_box {
                [0.4, 0.2, -0.1]
            } else {
                [0.4, 0.2, 0.0]
            };
            let sheared =
                |[x, y, z]: &[f64; 3]| [x + 1.3 * z + shift[0], y + shift[1], z + shift[2]];
            let earlier = frame_in(cells[0], &places);
            let mut later = frame_in(cells[1], &places.iter().map(sheared).collect::<Vec<_>>());
            // The mean displacement has no part of it.
            let own = [1e-3, -2e-3, 3e-3];
            for (n, sign) in [(3, 1.0), (4, -1.0)] {
                (0..3).for_each(|axis| later.grains[n].position[axis] += sign * own[axis]);
            }
            let mut left_out = vec![false; 200];
            (left_out[3], left_out[4]) = (!is_box, !is_box);
            let interval = Interval {
                frames: [&earlier, &later],
                periods,
            };
            let mut field = Vec::new();
            non_affine(&interval, &left_out, &mut field);
            for (n, u) in field.iter().enumerate() {
                let sign = f64::from(i8::from(n == 3) - i8::from(n == 4));
                let off = (0..3).map(|axis| (u[axis] - sign * own[axis]).abs());
                assert!(off.sum::<f64>() < 1e-12, "{is_box}, grain {n}: {u:?}");
            }
        }
    }

    #[test]
    fn spheres_are_stretched_most_along_the_greatest_principal_axis() {
        let places = scattered(4, 300, L, L);
        let depth = scattered(5, 300, L, L);
        let places: Vec<[f64; 3]> = (places.iter().zip(&depth))
            .map(|(r, d)| [r.x + 0.5 * L, r.y + 0.5 * L, d.x + 0.5 * L])
            .collect();
        let cell = Cell::between_walls([L; 2]);
        let frame = frame_in(cell, &places);
        // Near two sides of the cell.
        let centre = [1.0, 39.0, 20.0];
        let along = Vector3::new(0.6, -0.48, 0.64);
        let map = 1e-3 * along * along.transpose()
            + Matrix3::new(0.0, 0.2, -0.5, -0.2, 0.0, 0.1, 0.5, -0.1, 0.0);
        let field: Vec<[f64; 3]> = (frame.grains.iter())
            .map(|grain| cell.separation::<Three>(&grain.position, &centre))
            .map(|d| <[f64; 3]>::from(map * Vector3::from(d)))
            .collect();
        let found = tension(&frame, &field, |_| false, centre, 12.0);
        let found = Vector3::from(found.expect("a direction"));
        assert!((found.dot(&along).abs() - 1.0).abs() < 1e-9, "{found}");
    }

    /// A frame of spheres at these places (m), wrapped.
    fn frame_in(cell: Cell, places: &[[f64; 3]]) -> Frame {
        let edges = cell.edges::<Three>(f64::INFINITY);
        let grain = |place: &[f64; 3]| {
            let (mut position, mut image) = (*place, [0; 3]);
            for axis in [2, 1, 0] {
                let images = (position[axis] / edges[axis][axis]).floor();
                if images != 0.0 {
                    (0..3).for_each(|k| position[k] -= images * edges[axis][k]);
                }
                image[axis] = images as i64;
            }
            GrainSample {
                position,
                image,
                ..GrainSample::zeroed()
            }
        };
        Frame {
            dimension: Dimensions::Three,
            cell,
            step: 0,
            time: 0.0,
            grains: places.iter().map(grain).collect(),
            contacts: Vec::new(),
            wall_contacts: Vec::new(),
        }
    }
}
