//! D²min: how far a grain's neighbourhood moved from any affine map (LH appendix B).

use nalgebra::{Matrix2, Vector2};

use super::neighbourhood::{Cells, separation};
use super::rattlers;
use crate::state::{Disks, Frame};

/// Radius of the neighbourhood over r̄ in LH section 3.2.
pub const RADIUS: f64 = 5.0;

/// det Y below this fraction of (tr Y)² is singular. In 2D det Y/(tr Y)² is the squared ratio of the neighbourhood's
/// principal extents at most, so only neighbours on one line to a millionth of its length fall under it, and
/// rounding of the positions (1e-14 of a radius) alone never lifts such a line above it.
const SINGULAR: f64 = 1e-12;

/// Buffers for D²min, reused from frame to frame.
#[derive(Debug, Default)]
pub struct NonAffine {
    cells: Cells,
    rattler: Vec<bool>,
    /// Neighbours i < j.
    pairs: Vec<[u32; 2]>,
    moments: Vec<Moments>,
    /// Γ of every grain; NaN where it is undefined.
    gamma: Vec<Matrix2<f64>>,
}

/// What a grain's neighbours add up to.
#[derive(Debug, Clone, Copy)]
struct Moments {
    neighbours: u32,
    /// X of B2 and Y of B3 (m²).
    x: Matrix2<f64>,
    y: Matrix2<f64>,
}

impl NonAffine {
    /// D²min of every grain between two frames (LH B1–B4).
    ///
    /// - `radius`: of the neighbourhood (m), in the earlier frame; LH take [`RADIUS`] r̄ with r̄ of all grains.
    /// - `dmin`: [N] (m²), divided by the number of neighbours N_i as B1 is printed.
    ///
    /// Rattlers of the earlier frame are neither centres nor neighbours. NaN for them, for grains with fewer than
    /// two neighbours, and where the neighbours lie on one line (singular Y).
    /// Separations are nearest images along x in both frames, so that nothing jumps at the seam.
    pub fn between(
        &mut self,
        grains: &Disks,
        radius: f64,
        earlier: &Frame,
        later: &Frame,
        dmin: &mut [f64],
    ) {
        rattlers::mark(grains, earlier, &mut self.rattler);
        self.find_pairs(grains.length, radius, &earlier.position);
        let (pairs, gamma) = (&self.pairs, &mut self.gamma);
        let of_pair = |&[i, j]: &[u32; 2]| {
            let [i, j] = [i as usize, j as usize];
            let between = |frame: &Frame| -> Vector2<f64> {
                separation(grains.length, frame.position[i], frame.position[j]).into()
            };
            (i, j, between(earlier), between(later))
        };

        // A pair seen from its other end has both signs changed: products of the two are the same for i and for j.
        let none = Moments {
            neighbours: 0,
            x: Matrix2::zeros(),
            y: Matrix2::zeros(),
        };
        self.moments.clear();
        self.moments.resize(dmin.len(), none);
        for (i, j, before, after) in pairs.iter().map(of_pair) {
            let (x, y) = (after * before.transpose(), before * before.transpose());
            for n in [i, j] {
                let moments = &mut self.moments[n];
                moments.neighbours += 1;
                moments.x += x;
                moments.y += y;
            }
        }
        gamma.clear();
        gamma.extend(self.moments.iter().map(best_fit));
        // A second pass over the pairs: the expansion of the square in moments would cancel.
        dmin.fill(0.0);
        for (i, j, before, after) in pairs.iter().map(of_pair) {
            dmin[i] += (after - gamma[i] * before).norm_squared();
            dmin[j] += (after - gamma[j] * before).norm_squared();
        }
        for (value, moments) in dmin.iter_mut().zip(&self.moments) {
            *value /= f64::from(moments.neighbours);
        }
    }

    /// The rattlers of the earlier frame in the last call of [`Self::between`], [N].
    pub fn rattlers(&self) -> &[bool] {
        &self.rattler
    }

    /// Γ [N] of the last call of [`Self::between`] (LH B4); NaN where it is undefined.
    pub fn gamma(&self) -> &[Matrix2<f64>] {
        &self.gamma
    }

    fn find_pairs(&mut self, length: f64, radius: f64, position: &[[f64; 2]]) {
        let (rattler, pairs) = (&self.rattler, &mut self.pairs);
        self.cells.fill(length, radius, position, |n| !rattler[n]);
        pairs.clear();
        for (i, &r) in position.iter().enumerate().filter(|(i, _)| !rattler[*i]) {
            self.cells.near(r, |j| {
                if j > i {
                    let d = separation(length, r, position[j]);
                    if d[0] * d[0] + d[1] * d[1] <= radius * radius {
                        pairs.push([i as u32, j as u32]);
                    }
                }
            });
        }
    }
}

/// Γ of B4.
fn best_fit(moments: &Moments) -> Matrix2<f64> {
    let Moments { neighbours, x, y } = moments;
    // Written so that NaN counts as singular.
    let regular = *neighbours >= 2 && y.determinant() > SINGULAR * y.trace() * y.trace();
    let inverse = y.try_inverse().filter(|_| regular);
    inverse.map_or(Matrix2::repeat(f64::NAN), |inverse| x * inverse)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::testing::{frame, grains_in, mapped, scattered};
    use nalgebra::{DMatrix, DVector};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const L: f64 = 48e-6;

    fn packing(n: usize) -> Disks {
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let radius: Vec<f64> = (0..n)
            .map(|_| 0.5e-6 * (1.0 + random.random::<f64>()))
            .collect();
        grains_in(L, &radius)
    }

    fn dmin(grains: &Disks, earlier: &Frame, later: &Frame) -> Vec<f64> {
        let mut values = vec![0.0; grains.count()];
        let radius = RADIUS * grains.mean_radius();
        NonAffine::default().between(grains, radius, earlier, later, &mut values);
        values
    }

    /// Asks D²min ≤ 1e-24 r̄² of every grain.
    fn assert_affine(grains: &Disks, earlier: &Frame, later: &Frame) {
        let square = grains.mean_radius().powi(2);
        for (n, value) in dmin(grains, earlier, later).into_iter().enumerate() {
            assert!(
                value <= 1e-24 * square,
                "grain {n}: D²min/r̄² = {:e}",
                value / square
            );
        }
    }

    #[test]
    fn an_affine_map_leaves_nothing_in_a_periodic_cell() {
        let grains = packing(1000);
        let points = scattered(1, 1000, L, 36e-6);
        // What keeps the period along x: simple shear and stretch along y.
        for (shear, stretch) in [(0.0, 1.0), (7e-7, 1.0 + 1e-7), (0.02, 0.99), (0.5, 1.3)] {
            let map = Matrix2::new(1.0, shear, 0.0, stretch);
            assert_affine(
                &grains,
                &frame(&grains, &points),
                &frame(&grains, &mapped(&points, map)),
            );
        }
    }

    #[test]
    fn a_general_affine_map_leaves_nothing_across_the_seam() {
        // The grains lie on both sides of the seam only, so that any map keeps their nearest images.
        let grains = packing(400);
        let points = scattered(2, 400, 0.4 * L, 30e-6);
        for map in [
            Matrix2::new(1.1, 0.3, -0.2, 0.8),
            Matrix2::new(0.6, -0.8, 0.8, 0.6),
        ] {
            assert_affine(
                &grains,
                &frame(&grains, &points),
                &frame(&grains, &mapped(&points, map)),
            );
        }
    }

    /// B1 minimised over Γ by SVD of the whole design matrix; neighbours by trying every grain and image.
    fn direct(grains: &Disks, rattler: &[bool], earlier: &Frame, later: &Frame, i: usize) -> f64 {
        let nearest = |a: [f64; 2], b: [f64; 2]| {
            let image = |k: f64| [b[0] - a[0] + k * grains.length, b[1] - a[1]];
            let by_length = |a: &[f64; 2], b: &[f64; 2]| a[0].abs().total_cmp(&b[0].abs());
            [-1.0, 0.0, 1.0]
                .map(image)
                .into_iter()
                .min_by(by_length)
                .expect("three images")
        };
        let radius = 5.0 * grains.radius.iter().sum::<f64>() / grains.radius.len() as f64;
        let others = (0..grains.count()).filter(|&j| j != i && !rattler[j]);
        let (mut before, mut after) = (Vec::new(), Vec::new());
        for j in others {
            let d = nearest(earlier.position[i], earlier.position[j]);
            if d[0].hypot(d[1]) <= radius {
                before.push(d);
                after.extend(nearest(later.position[i], later.position[j]));
            }
        }
        let design = DMatrix::from_fn(after.len(), 4, |row, column| {
            if column / 2 == row % 2 {
                before[row / 2][column % 2]
            } else {
                0.0
            }
        });
        let wanted = DVector::from_vec(after);
        let gamma = design
            .clone()
            .svd(true, true)
            .solve(&wanted, 0.0)
            .expect("U and V were asked for");
        (design * gamma - wanted).norm_squared() / before.len() as f64
    }

    #[test]
    fn a_random_displacement_gives_what_dense_least_squares_gives() {
        let mut grains = packing(600);
        grains.body[..40].fill(1);
        let points = scattered(3, 600, L, 24e-6);
        let mut earlier = frame(&grains, &points);
        // Makes a few rattlers, and some which lose their contacts only later.
        earlier.contacts.retain(|c| c.i % 50 != 3 && c.j % 50 != 3);
        for size in [1e-9, 1e-7] {
            let moved: Vec<_> = mapped(&points, Matrix2::new(1.0, 0.01, 0.0, 1.0))
                .iter()
                .zip(scattered(4, 600, size, size))
                .map(|(r, displacement)| r + displacement)
                .collect();
            let mut later = frame(&grains, &moved);
            later.contacts.clear();
            let mut rattler = Vec::new();
            rattlers::mark(&grains, &earlier, &mut rattler);
            let values = dmin(&grains, &earlier, &later);
            assert!(rattler.contains(&true) && rattler.contains(&false));
            for (i, value) in values.into_iter().enumerate() {
                if rattler[i] {
                    assert!(value.is_nan(), "rattler {i} has {value:e}");
                } else {
                    let wanted = direct(&grains, &rattler, &earlier, &later, i);
                    // Two neighbours always fit an affine map: rounding is all that is left.
                    let tolerance = 1e-12 * wanted + 1e-24 * grains.mean_radius().powi(2);
                    assert!(
                        (value - wanted).abs() <= tolerance,
                        "grain {i}: {value:e} against {wanted:e}"
                    );
                }
            }
        }
    }

    /// Disks of radius 1 at the given places, and the same ones displaced a little.
    fn small(points: &[[f64; 2]]) -> Vec<f64> {
        let grains = grains_in(100.0, &vec![1.0; points.len()]);
        let points: Vec<_> = points.iter().map(|r| Vector2::new(r[0], r[1])).collect();
        let moved = points
            .iter()
            .zip(scattered(5, points.len(), 0.1, 0.1))
            .map(|(r, d)| r + d);
        dmin(
            &grains,
            &frame(&grains, &points),
            &frame(&grains, &moved.collect::<Vec<_>>()),
        )
    }

    #[test]
    fn fewer_than_two_neighbours_leave_it_undefined() {
        // A pair, a triple with one neighbour out of the reach of 5 r̄, and a grain alone.
        let values = small(&[
            [0.0, 0.0],
            [2.0, 1.0],
            [30.0, 0.0],
            [30.0, 4.9],
            [34.0, 1.0],
            [60.0, 0.0],
        ]);
        let defined: Vec<bool> = values.iter().map(|value| value.is_finite()).collect();
        assert_eq!(defined, [false, false, true, false, false, false]);
    }

    #[test]
    fn neighbours_on_one_line_leave_it_undefined() {
        let line: Vec<[f64; 2]> = (0..5)
            .map(|k| [97.0 + 0.8 * f64::from(k), 0.3 + 0.24 * f64::from(k)])
            .collect();
        assert!(small(&line).iter().all(|value| value.is_nan()));
        let mut bent = line;
        bent[2][1] += 1e-3;
        assert!(small(&bent)[0].is_finite());
    }

    #[test]
    fn the_choice_of_cells_does_not_matter() {
        // Long and flat, narrower than three cells, and all in one cell: the same as direct least squares.
        for (width, height) in [(40.0, 3.0), (12.0, 40.0), (8.0, 8.0)] {
            let grains = grains_in(width, &[1.0; 60]);
            let points = scattered(6, 60, width, height);
            let moved: Vec<_> = points
                .iter()
                .zip(scattered(8, 60, 0.1, 0.1))
                .map(|(r, d)| r + d)
                .collect();
            let (earlier, later) = (frame(&grains, &points), frame(&grains, &moved));
            for (i, value) in dmin(&grains, &earlier, &later).into_iter().enumerate() {
                let wanted = direct(&grains, &[false; 60], &earlier, &later, i);
                assert!(
                    (value - wanted).abs() <= 1e-12 * wanted,
                    "grain {i}: {value:e} against {wanted:e}"
                );
            }
        }
    }
}
