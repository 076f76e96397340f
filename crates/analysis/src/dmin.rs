//! D²min, the mean square deviation of a neighbourhood's displacements from the best local affine
//! map (LH appendix B).

use std::fmt;

use nalgebra::{Matrix2, Vector2};

use super::displacement;
use super::neighbourhood::{NearPairs, separation};
use super::rattlers::RattlerRule;
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

/// Of how many free grains D²min is defined, and why it is not of the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DefinedCounts {
    /// Free grains, of all frames together.
    pub free: u64,
    /// Those that have a value.
    pub defined: u64,
    /// Rattlers, which are left out.
    pub rattlers: u64,
    /// Grains that were removed before the later frame.
    pub removed: u64,
    /// Grains with fewer neighbours than dimensions, or with all of them on one line or plane.
    pub few_neighbours: u64,
}

impl DefinedCounts {
    /// Counts the free grains of a frame. `values`, `rattler`, `removed`: `[N]`, D²min and why a
    /// grain is left out.
    pub fn of(
        grains: &Disks,
        values: &[f64],
        rattler: &[bool],
        removed: impl Fn(usize) -> bool,
    ) -> Self {
        let mut counts = Self::default();
        for n in (0..grains.count()).filter(|n| grains.body[*n] == 0) {
            counts.free += 1;
            if values[n].is_finite() {
                counts.defined += 1;
            } else if removed(n) {
                counts.removed += 1;
            } else if rattler[n] {
                counts.rattlers += 1;
            } else {
                counts.few_neighbours += 1;
            }
        }
        counts
    }

    /// Adds those of another frame.
    pub fn add(&mut self, other: &Self) {
        self.free += other.free;
        self.defined += other.defined;
        self.rattlers += other.rattlers;
        self.removed += other.removed;
        self.few_neighbours += other.few_neighbours;
    }
}

impl fmt::Display for DefinedCounts {
    /// The shares of the free grains, in words.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |count: u64| 100.0 * count as f64 / self.free.max(1) as f64;
        write!(
            f,
            "defined for {:.1} % of the free grains",
            percent(self.defined)
        )?;
        for (count, why) in [
            (self.rattlers, "are rattlers"),
            (self.few_neighbours, "have too few neighbours"),
            (self.removed, "were removed"),
        ] {
            if count > 0 {
                write!(f, ", {:.1} % {why}", percent(count))?;
            }
        }
        Ok(())
    }
}

/// Computes D²min; its buffers are reused from frame to frame.
#[derive(Debug, Default)]
pub struct NonAffine {
    /// Which grains of the earlier frame are neither centres nor neighbours.
    pub rattlers_by: RattlerRule,
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
        let rule = self.rattlers_by;
        rule.mark(2, grains, &earlier.contacts, &mut self.rattler);
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
        Isa::detect().run(SumMoments {
            of: self,
            length,
            radius,
        });
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
    of: &'a mut NonAffine,
    length: f64,
    radius: f64,
}

impl Work for SumMoments<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _: L::Token) {
        let (length, radius) = (self.length, self.radius);
        let NonAffine {
            near,
            moving,
            within,
            moments,
            neighbours,
            ..
        } = self.of;
        moments.clear();
        moments.resize(moving.len(), [0.0; 8]);
        neighbours.clear();
        neighbours.resize(moving.len(), 0);
        let (moving, moments, neighbours) = (&moving[..], &mut moments[..], &mut neighbours[..]);
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
    use crate::event::{self, Interval};
    use crate::rattlers;
    use crate::testing::{frame, grains_in, mapped, scattered};
    use bytemuck::Zeroable;
    use gshear_dem::dimension::Two;
    use gshear_dem::state::{Cell, FrameRecords, GrainSample};

    const L: f64 = 48e-6;

    fn packing(n: usize) -> Disks {
        let radius = scattered(7, n, 0.5e-6, 0.0).into_iter();
        grains_in(L, &radius.map(|by| 0.75e-6 + by.x).collect::<Vec<f64>>())
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
    fn an_affine_map_leaves_nothing() {
        // Maps that keep the period along x, simple shear and stretch along y, of the whole cell;
        // any map of grains close to both sides of the periodic boundary, whose nearest images it
        // keeps.
        let (whole, seam) = (
            scattered(1, 1000, L, 36e-6),
            scattered(2, 400, 0.4 * L, 30e-6),
        );
        for (points, [xx, xy, yx, yy]) in [
            (&whole, [1.0, 0.0, 0.0, 1.0]),
            (&whole, [1.0, 7e-7, 0.0, 1.0 + 1e-7]),
            (&whole, [1.0, 0.02, 0.0, 0.99]),
            (&whole, [1.0, 0.5, 0.0, 1.3]),
            (&seam, [1.1, 0.3, -0.2, 0.8]),
            (&seam, [0.6, -0.8, 0.8, 0.6]),
        ] {
            let grains = packing(points.len());
            let moved = mapped(points, Matrix2::new(xx, xy, yx, yy));
            assert_affine(&grains, &frame(&grains, points), &frame(&grains, &moved));
        }
    }

    /// Compares D²min with what [`event::non_affine`] finds grain by grain, without the grains that
    /// are left out.
    fn assert_direct(grains: &Disks, left_out: &[bool], earlier: &Frame, later: &Frame) {
        let cell = Cell::between_walls([grains.length, f64::INFINITY]);
        let [before, after] = [earlier, later].map(|frame| {
            let grain = |([x, y], image): (&[f64; 2], &i64)| GrainSample {
                position: [*x, *y, 0.0],
                image: [*image, 0, 0],
                ..GrainSample::zeroed()
            };
            FrameRecords {
                grains: frame.position.iter().zip(&frame.image).map(grain).collect(),
                ..FrameRecords::default()
            }
        });
        let interval = Interval {
            cells: [cell; 2],
            frames: [&before, &after],
            periods: 0,
        };
        let radius = RADIUS * grains.mean_radius();
        let expected = event::non_affine::<Two>(&interval, radius, |n| !left_out[n]);
        let found = between(grains, earlier, later);
        for (i, (value, wanted)) in found.into_iter().zip(expected).enumerate() {
            // Two neighbours always fit an affine map, so only rounding is left.
            let tolerance = 1e-12 * wanted + 1e-24 * grains.mean_radius().powi(2);
            let same = (value - wanted).abs() <= tolerance;
            assert!(
                same || (left_out[i] && value.is_nan() && wanted.is_nan()),
                "grain {i}: {value:e} against {wanted:e}"
            );
        }
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
    fn a_random_displacement_gives_what_least_squares_give_grain_by_grain() {
        let mut grains = packing(600);
        grains.body[..40].fill(1);
        let points = scattered(3, 600, L, 24e-6);
        let mut earlier = frame(&grains, &points);
        // A few rattlers, and some grains that lose their contacts only later.
        earlier.contacts.retain(|c| c.i % 50 != 3 && c.j % 50 != 3);
        for size in [1e-9, 1e-7] {
            let sheared = mapped(&points, Matrix2::new(1.0, 0.01, 0.0, 1.0));
            let mut later = frame(&grains, &shaken(&sheared, 4, size));
            later.contacts.clear();
            let mut left_out = Vec::new();
            rattlers::mark(2, &grains, &earlier.contacts, &mut left_out);
            assert!(left_out.contains(&true) && left_out.contains(&false));
            // Removed grains count as little as rattlers.
            for n in (5..600).step_by(37) {
                later.position[n] = [f64::NAN; 2];
                left_out[n] = true;
            }
            assert_direct(&grains, &left_out, &earlier, &later);
        }
    }

    /// Points after random displacements.
    fn shaken(points: &[Vector2<f64>], seed: u64, size: f64) -> Vec<Vector2<f64>> {
        let moves = scattered(seed, points.len(), size, size);
        points.iter().zip(moves).map(|(r, d)| r + d).collect()
    }

    /// Whether D²min of disks of radius 1 at the given places is defined after small random
    /// displacements.
    fn defined(points: &[[f64; 2]]) -> Vec<bool> {
        let grains = grains_in(100.0, &vec![1.0; points.len()]);
        let points: Vec<_> = points.iter().map(|r| Vector2::from(*r)).collect();
        let moved = shaken(&points, 5, 0.1);
        let values = between(&grains, &frame(&grains, &points), &frame(&grains, &moved));
        values.iter().map(|value| value.is_finite()).collect()
    }

    #[test]
    fn fewer_than_two_neighbours_leave_it_undefined() {
        // A pair, a triple in which two grains are farther apart than 5 r̄, and a single grain.
        let (pair, single) = ([[0.0, 0.0], [2.0, 1.0]], [[60.0, 0.0]]);
        let triple = [[30.0, 0.0], [30.0, 4.9], [34.0, 1.0]];
        let found = defined(&[&pair[..], &triple, &single].concat());
        assert_eq!(found, [false, false, true, false, false, false]);
    }

    #[test]
    fn neighbours_on_one_line_leave_it_undefined() {
        let mut line = [0.0, 1.0, 2.0, 3.0, 4.0].map(|k| [97.0 + 0.8 * k, 0.3 + 0.24 * k]);
        assert_eq!(defined(&line), [false; 5]);
        line[2][1] += 1e-3;
        assert!(defined(&line)[0]);
    }

    #[test]
    fn the_choice_of_cells_does_not_matter() {
        // Long and flat, narrower than three cells, and all in one cell.
        for (width, height) in [(40.0, 3.0), (12.0, 40.0), (8.0, 8.0)] {
            let grains = grains_in(width, &[1.0; 60]);
            let points = scattered(6, 60, width, height);
            let moved = shaken(&points, 8, 0.1);
            let (earlier, later) = (frame(&grains, &points), frame(&grains, &moved));
            assert_direct(&grains, &[false; 60], &earlier, &later);
        }
    }
}
