//! D²min, the mean square deviation of a neighbourhood's displacements from the best local affine
//! map (LH appendix B).

use nalgebra::{Matrix2, Vector2};

use super::neighbourhood::{NearPairs, separation};
use super::{displacement, rattlers};
use gshear_dem::simd::{Isa, Lanes, Work};
use gshear_dem::state::{Disks, Frame};

/// Radius of the neighbourhood over r̄ (LH section 3.2).
pub const RADIUS: f64 = 5.0;

/// det Y below this fraction of (tr Y)² counts as singular.
///
/// In 2D det Y/(tr Y)² is at most the squared ratio of the neighbourhood's principal extents, so
/// only neighbours on a line to one part in 10⁶ of its length fall below. Rounding of the positions
/// (1e-14 of a radius) never lifts such a line above it.
const SINGULAR: f64 = 1e-12;

/// If the non-affine share of the squared displacements is less than this, the difference Σ u² -
/// tr(G Xᵀ) loses digits and the residuals are summed one by one; see [`NonAffine::residual`].
const CANCELS: f64 = 0.01;

/// Computes D²min; its buffers are reused from frame to frame.
#[derive(Debug, Default)]
pub struct NonAffine {
    near: NearPairs,
    rattler: Vec<bool>,
    moving: Vec<Moving>,
    within: Vec<(u32, [f64; 2])>,
    moments: Vec<MomentSums>,
    neighbours: Vec<u32>,
    /// G = Γ - 1 of every grain; NaN where it is undefined.
    gradient: Vec<Matrix2<f64>>,
}

/// Position of a grain in the earlier frame (NaN for a rattler or a grain that is removed, so that
/// it is no one's neighbour) and its displacement (m).
#[derive(Debug, Clone, Copy)]
struct Moving {
    place: [f64; 2],
    displacement: [f64; 2],
}

/// Sums over a grain's neighbours, b being the earlier separation and u its change: Σ b ⊗ b (xx,
/// xy, yy), Σ u ⊗ b (xx, xy, yx, yy), Σ u² (m²).
type MomentSums = [f64; 8];

impl NonAffine {
    /// Computes D²min of every grain between two frames (LH B1–B4).
    ///
    /// - `radius`: of the neighbourhood (m), in the earlier frame; LH take [`RADIUS`] r̄ with r̄
    ///   over all grains.
    /// - `dmin`: result, `[N]` (m²), divided by the number of neighbours N_i as B1 is printed.
    ///
    /// Rattlers of the earlier frame, and grains that are removed in the later one, are neither
    /// centres nor neighbours. The result is NaN for them, for grains with fewer than two
    /// neighbours, and for neighbours on one line (singular Y). Separations are nearest images
    /// along x and displacements follow the images of the grains, so the periodic boundary has no
    /// effect.
    pub fn between(
        &mut self,
        grains: &Disks,
        radius: f64,
        earlier: &Frame,
        later: &Frame,
        dmin: &mut [f64],
    ) {
        let length = grains.length;
        rattlers::mark::<2>(grains, &earlier.contacts, &mut self.rattler);
        self.near.update(length, radius, &earlier.position);
        self.moving.clear();
        let grains = self.rattler.iter().zip(&earlier.position).enumerate();
        self.moving.extend(grains.map(|(n, (rattler, from))| {
            let displacement = displacement::between(length, earlier, later, n);
            let left_out = *rattler || displacement[0].is_nan();
            Moving {
                place: if left_out { [f64::NAN; 2] } else { *from },
                displacement,
            }
        }));
        self.sum_moments(length, radius);
        self.gradient.clear();
        let sums = self.moments.iter().zip(&self.neighbours);
        self.gradient
            .extend(sums.map(|(moments, neighbours)| best_fit(moments, *neighbours)));
        for (i, value) in dmin.iter_mut().enumerate() {
            *value = self.residual(i, length, radius) / f64::from(self.neighbours[i]);
        }
    }

    /// Returns the rattlers of the earlier frame in the last call of [`Self::between`], `[N]`.
    pub fn rattlers(&self) -> &[bool] {
        &self.rattler
    }

    fn sum_moments(&mut self, length: f64, radius: f64) {
        self.moments.clear();
        self.moments.resize(self.moving.len(), [0.0; 8]);
        self.neighbours.clear();
        self.neighbours.resize(self.moving.len(), 0);
        Isa::detect().run(SumMoments {
            length,
            radius,
            near: &self.near,
            moving: &self.moving,
            within: &mut self.within,
            moments: &mut self.moments,
            neighbours: &mut self.neighbours,
        });
    }

    /// Σ (u - G b)² (m²), as Σ u² - tr(G Xᵀ) with X = Σ u ⊗ b, or term by term if that difference
    /// loses digits.
    fn residual(&self, i: usize, length: f64, radius: f64) -> f64 {
        let [.., xx, xy, yx, yy, squares] = self.moments[i];
        let g = self.gradient[i];
        let rest = squares - g.component_mul(&Matrix2::new(xx, xy, yx, yy)).sum();
        if rest >= CANCELS * squares || rest.is_nan() {
            return rest;
        }
        let from = &self.moving[i];
        let mut sum = 0.0;
        self.near.around(i, |j| {
            let to = &self.moving[j];
            let b = separation(length, from.place, to.place);
            if b[0] * b[0] + b[1] * b[1] <= radius * radius {
                let rest = Vector2::from(change(from, to)) - g * Vector2::from(b);
                sum += rest.norm_squared();
            }
        });
        sum
    }
}

/// D²min of every grain between two frames, with neighbours within [`RADIUS`] r̄; see
/// [`NonAffine::between`].
pub fn between(grains: &Disks, earlier: &Frame, later: &Frame) -> Vec<f64> {
    let mut dmin = vec![f64::NAN; grains.count()];
    let radius = RADIUS * grains.mean_radius();
    NonAffine::default().between(grains, radius, earlier, later, &mut dmin);
    dmin
}

/// Sums the moments of every grain pair by pair in order of (i, j), with the same bits on every
/// instruction set.
struct SumMoments<'a> {
    length: f64,
    radius: f64,
    near: &'a NearPairs,
    moving: &'a [Moving],
    within: &'a mut Vec<(u32, [f64; 2])>,
    moments: &'a mut [MomentSums],
    neighbours: &'a mut [u32],
}

impl Work for SumMoments<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _: L::Token) {
        let SumMoments {
            length,
            radius,
            near,
            moving,
            within,
            moments,
            neighbours,
        } = self;
        for (i, from) in moving.iter().enumerate() {
            let after = near.after(i);
            // Every candidate is stored and overwritten by the next one if it lies outside the
            // radius: a branch would be mispredicted too often.
            within.resize(within.len().max(after.len() + 1), (0, [0.0; 2]));
            let mut count = 0;
            for &j in after {
                let b = separation(length, from.place, moving[j as usize].place);
                within[count] = (j, b);
                count += usize::from(b[0] * b[0] + b[1] * b[1] <= radius * radius);
            }
            let mut sums = moments[i];
            for &(j, b) in &within[..count] {
                let j = j as usize;
                let u = change(from, &moving[j]);
                let terms = [
                    b[0] * b[0],
                    b[0] * b[1],
                    b[1] * b[1],
                    u[0] * b[0],
                    u[0] * b[1],
                    u[1] * b[0],
                    u[1] * b[1],
                    u[0] * u[0] + u[1] * u[1],
                ];
                // For j both b and u change sign, and their products do not.
                let other = &mut moments[j];
                for k in 0..8 {
                    sums[k] += terms[k];
                    other[k] += terms[k];
                }
                neighbours[j] += 1;
            }
            moments[i] = sums;
            neighbours[i] += count as u32;
        }
    }
}

/// u, the change of the separation (m).
#[inline(always)]
fn change(from: &Moving, to: &Moving) -> [f64; 2] {
    [
        to.displacement[0] - from.displacement[0],
        to.displacement[1] - from.displacement[1],
    ]
}

/// G: B4 minus the identity.
fn best_fit(moments: &MomentSums, neighbours: u32) -> Matrix2<f64> {
    let [bxx, bxy, byy, xx, xy, yx, yy, _] = *moments;
    let y = Matrix2::new(bxx, bxy, bxy, byy);
    // This form counts NaN as singular.
    let regular = neighbours >= 2 && y.determinant() > SINGULAR * y.trace() * y.trace();
    let inverse = y.try_inverse().filter(|_| regular);
    let x = Matrix2::new(xx, xy, yx, yy);
    inverse.map_or(Matrix2::repeat(f64::NAN), |inverse| x * inverse)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{frame, grains_in, mapped, scattered};
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

    /// Asserts D²min ≤ 1e-24 r̄² for every grain.
    fn assert_affine(grains: &Disks, earlier: &Frame, later: &Frame) {
        let square = grains.mean_radius().powi(2);
        for (n, value) in between(grains, earlier, later).into_iter().enumerate() {
            let relative = value / square;
            assert!(relative <= 1e-24, "grain {n}: D²min/r̄² = {relative:e}");
        }
    }

    #[test]
    fn an_affine_map_leaves_nothing_in_a_periodic_cell() {
        let grains = packing(1000);
        let points = scattered(1, 1000, L, 36e-6);
        // Maps that keep the period along x: simple shear and stretch along y.
        for (shear, stretch) in [(0.0, 1.0), (7e-7, 1.0 + 1e-7), (0.02, 0.99), (0.5, 1.3)] {
            let map = Matrix2::new(1.0, shear, 0.0, stretch);
            let [earlier, later] = [points.clone(), mapped(&points, map)];
            assert_affine(&grains, &frame(&grains, &earlier), &frame(&grains, &later));
        }
    }

    #[test]
    fn a_general_affine_map_leaves_nothing_across_the_seam() {
        // The grains lie close to both sides of the periodic boundary, so that any map keeps their
        // nearest images.
        let grains = packing(400);
        let points = scattered(2, 400, 0.4 * L, 30e-6);
        for map in [
            Matrix2::new(1.1, 0.3, -0.2, 0.8),
            Matrix2::new(0.6, -0.8, 0.8, 0.6),
        ] {
            let [earlier, later] = [points.clone(), mapped(&points, map)];
            assert_affine(&grains, &frame(&grains, &earlier), &frame(&grains, &later));
        }
    }

    /// B1 minimised over Γ - 1 by SVD of the whole design matrix, for the changes of the
    /// separations, which rounding does not affect; neighbours by trying every grain and image.
    fn direct(grains: &Disks, rattler: &[bool], earlier: &Frame, later: &Frame, i: usize) -> f64 {
        let nearest = |a: [f64; 2], b: [f64; 2]| {
            let image = |k: f64| [b[0] - a[0] + k * grains.length, b[1] - a[1]];
            let by_length = |a: &[f64; 2], b: &[f64; 2]| a[0].abs().total_cmp(&b[0].abs());
            let images = [-1.0, 0.0, 1.0].map(image).into_iter();
            images.min_by(by_length).expect("three images")
        };
        let radius = 5.0 * grains.radius.iter().sum::<f64>() / grains.radius.len() as f64;
        let others = (0..grains.count()).filter(|&j| j != i && !rattler[j]);
        let moved = |n: usize| nearest(earlier.position[n], later.position[n]);
        let (mut before, mut after) = (Vec::new(), Vec::new());
        for j in others {
            let d = nearest(earlier.position[i], earlier.position[j]);
            if d[0].hypot(d[1]) <= radius {
                before.push(d);
                after.extend([0, 1].map(|k| moved(j)[k] - moved(i)[k]));
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
        let gamma = design.clone().svd(true, true).solve(&wanted, 0.0);
        let gamma = gamma.expect("U and V were asked for");
        (design * gamma - wanted).norm_squared() / before.len() as f64
    }

    /// Grains that move by several periods, each by its own number of them, between two frames.
    #[test]
    fn displacements_follow_the_images() {
        let grains = packing(500);
        let points = scattered(9, 500, L, 24e-6);
        let map = |shear: f64| mapped(&points, Matrix2::new(1.0, shear, 0.0, 1.0));
        let sheared = |shear: f64| frame(&grains, &map(shear));
        assert_affine(&grains, &sheared(-7.0), &sheared(11.0));
        // One more grain alone moves by 0.8 L, farther than the shortest way.
        let mut moved = map(0.1);
        moved[3].x += 0.8 * L;
        let later = frame(&grains, &moved);
        let value = between(&grains, &sheared(0.0), &later)[3];
        assert!(value > 0.5 * (0.8 * L).powi(2), "{value:e}");
    }

    #[test]
    fn a_random_displacement_gives_what_dense_least_squares_gives() {
        let mut grains = packing(600);
        grains.body[..40].fill(1);
        let points = scattered(3, 600, L, 24e-6);
        let mut earlier = frame(&grains, &points);
        // A few rattlers, and some grains that lose their contacts only later.
        earlier.contacts.retain(|c| c.i % 50 != 3 && c.j % 50 != 3);
        for size in [1e-9, 1e-7] {
            let sheared = mapped(&points, Matrix2::new(1.0, 0.01, 0.0, 1.0));
            let moved = shaken(&sheared, 4, size);
            let mut later = frame(&grains, &moved);
            later.contacts.clear();
            let mut rattler = Vec::new();
            rattlers::mark::<2>(&grains, &earlier.contacts, &mut rattler);
            // Removed grains count as little as rattlers.
            for n in (5..600).step_by(37) {
                later.position[n] = [f64::NAN; 2];
                rattler[n] = true;
            }
            let values = between(&grains, &earlier, &later);
            assert!(rattler.contains(&true) && rattler.contains(&false));
            for (i, value) in values.into_iter().enumerate() {
                if rattler[i] {
                    assert!(value.is_nan(), "rattler {i} has {value:e}");
                } else {
                    let wanted = direct(&grains, &rattler, &earlier, &later, i);
                    // Two neighbours always fit an affine map, so only rounding is left.
                    let tolerance = 1e-12 * wanted + 1e-24 * grains.mean_radius().powi(2);
                    assert!(
                        (value - wanted).abs() <= tolerance,
                        "grain {i}: {value:e} against {wanted:e}"
                    );
                }
            }
        }
    }

    /// Points after random displacements.
    fn shaken(points: &[Vector2<f64>], seed: u64, size: f64) -> Vec<Vector2<f64>> {
        let moves = scattered(seed, points.len(), size, size);
        points.iter().zip(moves).map(|(r, d)| r + d).collect()
    }

    /// D²min of disks of radius 1 at the given places after small random displacements.
    fn small(points: &[[f64; 2]]) -> Vec<f64> {
        let grains = grains_in(100.0, &vec![1.0; points.len()]);
        let points: Vec<_> = points.iter().map(|r| Vector2::new(r[0], r[1])).collect();
        let moved = shaken(&points, 5, 0.1);
        between(&grains, &frame(&grains, &points), &frame(&grains, &moved))
    }

    #[test]
    fn fewer_than_two_neighbours_leave_it_undefined() {
        // A pair, a triple in which two grains are farther apart than 5 r̄, and a single grain.
        let (pair, single) = ([[0.0, 0.0], [2.0, 1.0]], [[60.0, 0.0]]);
        let triple = [[30.0, 0.0], [30.0, 4.9], [34.0, 1.0]];
        let values = small(&[&pair[..], &triple, &single].concat());
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
        // Long and flat, narrower than three cells, and all in one cell: each must agree with
        // direct least squares.
        for (width, height) in [(40.0, 3.0), (12.0, 40.0), (8.0, 8.0)] {
            let grains = grains_in(width, &[1.0; 60]);
            let points = scattered(6, 60, width, height);
            let moved = shaken(&points, 8, 0.1);
            let (earlier, later) = (frame(&grains, &points), frame(&grains, &moved));
            for (i, value) in between(&grains, &earlier, &later).into_iter().enumerate() {
                let wanted = direct(&grains, &[false; 60], &earlier, &later, i);
                assert!(
                    (value - wanted).abs() <= 1e-12 * wanted,
                    "grain {i}: {value:e} against {wanted:e}"
                );
            }
        }
    }
}
