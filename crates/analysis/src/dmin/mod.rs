//! D²min, the mean square deviation of a neighbourhood's displacements from the best local affine
//! map (LH appendix B), of disks and spheres, between walls and in boxes.
//!
//! There is one definition, and two ways to sum it, which round differently: `by_pair` is fast and
//! serves the long runs of disks between walls, `by_grain` serves everything else.

mod by_grain;
mod by_pair;

use std::fmt;

use nalgebra::Matrix3;

use super::interval::Interval;
use super::rattlers::RattlerRule;
use gshear_dem::dimension::{Dimensions, Three, Two};
use gshear_dem::state::{Frame, GrainConstants};

/// Radius of the neighbourhood over r̄ (LH section 3.2).
pub const RADIUS: f64 = 5.0;

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
    /// Adds those of another frame.
    pub fn add(&mut self, other: &Self) {
        self.free += other.free;
        self.defined += other.defined;
        self.rattlers += other.rattlers;
        self.removed += other.removed;
        self.few_neighbours += other.few_neighbours;
    }

    /// The share of a number of free grains (%).
    fn percent(&self, count: u64) -> f64 {
        100.0 * count as f64 / self.free.max(1) as f64
    }
}

impl fmt::Display for DefinedCounts {
    /// The shares of the free grains, in words.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let defined = self.percent(self.defined);
        write!(f, "defined for {defined:.1} % of the free grains")?;
        for (count, why) in [
            (self.rattlers, "are rattlers"),
            (self.few_neighbours, "have too few neighbours"),
            (self.removed, "were removed"),
        ] {
            if count > 0 {
                write!(f, ", {:.1} % {why}", self.percent(count))?;
            }
        }
        Ok(())
    }
}

/// The strain E = ½(FᵀF - 1) of a neighbourhood, with F = 1 + G (Falk & Langer, Phys. Rev. E 57,
/// 7192, 1998).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalStrain {
    /// 2 E between the flow and the gradient direction: the shear strain along the imposed one.
    pub along: f64,
    /// √(½ E':E') of the deviator E' (Shimizu, Ogata & Li, Mater. Trans. 48, 2923, 2007); half the
    /// shear strain in simple shear.
    pub invariant: f64,
}

impl LocalStrain {
    const UNDEFINED: Self = Self {
        along: f64::NAN,
        invariant: f64::NAN,
    };

    /// Of a displacement gradient G in so many dimensions.
    fn of(gradient: Matrix3<f64>, axes: usize) -> Self {
        let strain = 0.5 * (gradient + gradient.transpose() + gradient.transpose() * gradient);
        let mean = (0..axes).map(|k| strain[(k, k)]).sum::<f64>() / axes as f64;
        let mut squares = 0.0;
        for a in 0..axes {
            for b in 0..axes {
                let deviator = strain[(a, b)] - if a == b { mean } else { 0.0 };
                squares += deviator * deviator;
            }
        }
        Self {
            along: 2.0 * strain[(0, axes - 1)],
            invariant: (0.5 * squares).sqrt(),
        }
    }
}

/// Computes D²min; its buffers are reused from frame to frame.
#[derive(Debug, Default)]
pub struct NonAffine {
    /// Which grains of the earlier frame are neither centres nor neighbours.
    pub rattlers_by: RattlerRule,
    rattler: Vec<bool>,
    left_out: Vec<bool>,
    by_pair: by_pair::PairSums,
}

impl NonAffine {
    /// Computes D²min of every grain between two frames (LH B1–B4, in D dimensions).
    ///
    /// - `radius`: of the neighbourhood (m), in the earlier frame; LH take [`RADIUS`] r̄ with r̄
    ///   over all grains.
    /// - `dmin`: result, `[N]` (m²), divided by the number of neighbours N_i as B1 is printed.
    ///
    /// Rattlers of the earlier frame, and grains that are removed in the later one, are neither
    /// centres nor neighbours. The result is NaN for them, for grains with fewer neighbours than
    /// dimensions, and for neighbours on one line or plane. A neighbour is the nearest image of a
    /// grain in the earlier frame; that image is followed to the later one, so periodic boundaries
    /// have no effect.
    pub fn between(
        &mut self,
        grains: &GrainConstants,
        interval: &Interval<'_>,
        radius: f64,
        dmin: &mut [f64],
    ) {
        if interval.later().is_of_disks_between_walls() {
            self.leave_out(grains, interval);
            self.by_pair.fit(interval, &self.left_out, radius, dmin);
        } else {
            self.grain_by_grain(grains, interval, radius, dmin);
        }
    }

    /// [`Self::between`], summed grain by grain even for disks between walls.
    pub fn grain_by_grain(
        &mut self,
        grains: &GrainConstants,
        interval: &Interval<'_>,
        radius: f64,
        dmin: &mut [f64],
    ) {
        self.leave_out(grains, interval);
        match interval.later().dimension {
            Dimensions::Two => by_grain::fit::<Two>(interval, &self.left_out, radius, dmin),
            Dimensions::Three => by_grain::fit::<Three>(interval, &self.left_out, radius, dmin),
        }
    }

    /// Computes the local strain around some grains between two frames, from the affine map whose
    /// residual is D²min. NaN where D²min is undefined.
    ///
    /// - `radius`: of the neighbourhood (m), as of [`Self::between`].
    /// - `wanted`: the grains.
    pub fn strains(
        &mut self,
        grains: &GrainConstants,
        interval: &Interval<'_>,
        radius: f64,
        wanted: &[u32],
    ) -> Vec<LocalStrain> {
        self.leave_out(grains, interval);
        let (left_out, dimension) = (&self.left_out, interval.later().dimension);
        let gradients = match dimension {
            Dimensions::Two => by_grain::gradients::<Two>(interval, left_out, radius, wanted),
            Dimensions::Three => by_grain::gradients::<Three>(interval, left_out, radius, wanted),
        };
        let gradients = wanted.iter().zip(gradients);
        let strains = gradients.map(|(n, gradient)| {
            if left_out[*n as usize] {
                LocalStrain::UNDEFINED
            } else {
                LocalStrain::of(gradient, dimension.axes())
            }
        });
        strains.collect()
    }

    /// Marks the grains that are neither centres nor neighbours.
    fn leave_out(&mut self, grains: &GrainConstants, interval: &Interval<'_>) {
        let rule = self.rattlers_by;
        rule.mark(grains, interval.earlier(), &mut self.rattler);
        self.left_out.clear();
        let rattlers = self.rattler.iter().enumerate();
        self.left_out.extend(rattlers.map(|(n, is_rattler)| {
            *is_rattler || interval.frames.iter().any(|frame| frame.is_removed(n))
        }));
    }

    /// Returns the rattlers of the earlier frame in the last computation, `[N]`.
    pub fn rattlers(&self) -> &[bool] {
        &self.rattler
    }

    /// Counts the free grains for which the last computation has defined D²min. `later`: its later
    /// frame; `dmin`: its result, `[N]`.
    pub fn defined(&self, grains: &GrainConstants, later: &Frame, dmin: &[f64]) -> DefinedCounts {
        let mut counts = DefinedCounts::default();
        for n in (0..grains.count()).filter(|n| grains.body[*n] == 0) {
            counts.free += 1;
            if dmin[n].is_finite() {
                counts.defined += 1;
            } else if later.is_removed(n) {
                counts.removed += 1;
            } else if self.rattler[n] {
                counts.rattlers += 1;
            } else {
                counts.few_neighbours += 1;
            }
        }
        counts
    }
}

/// D²min of every grain between two frames, with neighbours within [`RADIUS`] r̄ and without
/// rattlers; see [`NonAffine::between`].
pub fn between(grains: &GrainConstants, interval: &Interval<'_>) -> Vec<f64> {
    let mut dmin = vec![f64::NAN; grains.count()];
    let radius = RADIUS * grains.mean_radius();
    NonAffine::default().between(grains, interval, radius, &mut dmin);
    dmin
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{frame, grains_of, mapped, scattered};
    use nalgebra::{Matrix2, Vector2};

    const L: f64 = 48e-6;

    fn packing(n: usize) -> GrainConstants {
        let radius = scattered(7, n, 0.5e-6, 0.0).into_iter();
        grains_of(&radius.map(|by| 0.75e-6 + by.x).collect::<Vec<f64>>())
    }

    /// Asserts D²min ≤ 1e-24 r̄² for every grain.
    fn assert_affine(grains: &GrainConstants, earlier: &Frame, later: &Frame) {
        let square = grains.mean_radius().powi(2);
        let interval = Interval::between_walls([earlier, later]);
        for (n, value) in between(grains, &interval).into_iter().enumerate() {
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
            assert_affine(&grains, &frame(L, points), &frame(L, &moved));
        }
    }

    /// Compares both ways to sum D²min.
    fn assert_direct(grains: &GrainConstants, earlier: &Frame, later: &Frame) {
        let interval = Interval::between_walls([earlier, later]);
        let radius = RADIUS * grains.mean_radius();
        let mut expected = vec![0.0; grains.count()];
        let mut direct = NonAffine::default();
        direct.grain_by_grain(grains, &interval, radius, &mut expected);
        let found = between(grains, &interval);
        for (i, (value, wanted)) in found.into_iter().zip(expected).enumerate() {
            // Two neighbours always fit an affine map, so only rounding is left.
            let tolerance = 1e-12 * wanted + 1e-24 * grains.mean_radius().powi(2);
            let same = (value - wanted).abs() <= tolerance;
            assert!(
                same || (direct.left_out[i] && value.is_nan() && wanted.is_nan()),
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
        let sheared = |shear: f64| frame(L, &map(shear));
        assert_affine(&grains, &sheared(-7.0), &sheared(11.0));
        // One more grain alone moves by 0.8 L, farther than the shortest way.
        let mut moved = map(0.1);
        moved[3].x += 0.8 * L;
        let (earlier, later) = (sheared(0.0), frame(L, &moved));
        let value = between(&grains, &Interval::between_walls([&earlier, &later]))[3];
        assert!(value > 0.5 * (0.8 * L).powi(2), "{value:e}");
    }

    #[test]
    fn a_random_displacement_gives_what_least_squares_give_grain_by_grain() {
        let mut grains = packing(600);
        grains.body[..40].fill(1);
        let points = scattered(3, 600, L, 24e-6);
        let mut earlier = frame(L, &points);
        // A few rattlers, and some grains that lose their contacts only later.
        earlier.contacts.retain(|c| c.i % 50 != 3 && c.j % 50 != 3);
        for size in [1e-9, 1e-7] {
            let sheared = mapped(&points, Matrix2::new(1.0, 0.01, 0.0, 1.0));
            let mut later = frame(L, &shaken(&sheared, 4, size));
            later.contacts.clear();
            let mut rattler = Vec::new();
            RattlerRule::LeeHurley.mark(&grains, &earlier, &mut rattler);
            assert!(rattler.contains(&true) && rattler.contains(&false));
            // Removed grains count as little as rattlers.
            for n in (5..600).step_by(37) {
                later.grains[n].removed = 1;
            }
            assert_direct(&grains, &earlier, &later);
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
        let grains = grains_of(&vec![1.0; points.len()]);
        let points: Vec<_> = points.iter().map(|r| Vector2::from(*r)).collect();
        let moved = shaken(&points, 5, 0.1);
        let (earlier, later) = (frame(100.0, &points), frame(100.0, &moved));
        let values = between(&grains, &Interval::between_walls([&earlier, &later]));
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
            let grains = grains_of(&[1.0; 60]);
            let points = scattered(6, 60, width, height);
            let moved = shaken(&points, 8, 0.1);
            let (earlier, later) = (frame(width, &points), frame(width, &moved));
            assert_direct(&grains, &earlier, &later);
        }
    }
}
