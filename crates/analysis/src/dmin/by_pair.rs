//! D²min of disks between walls, pair by pair: moments of the neighbourhoods are summed over lists
//! of pairs that serve many frames.

use nalgebra::{Matrix2, Vector2};

use crate::interval::Interval;
use crate::neighbourhood::{NearPairs, separation};
use gshear_dem::dimension::Two;
use gshear_dem::simd::{Isa, Lanes, Work};

/// det Y below this fraction of (tr Y)² counts as singular.
///
/// In 2D det Y/(tr Y)² is at most the squared ratio of the neighbourhood's principal extents, so
/// only neighbours on a line to one part in 10⁶ of its length fall below. Rounding of the positions
/// (1e-14 of a radius) never lifts such a line above it.
const SINGULAR: f64 = 1e-12;

/// If the non-affine share of the squared displacements is less than this, the difference Σ u² -
/// tr(G Xᵀ) loses digits and the residuals are summed one by one; see [`PairSums::residual`].
const CANCELS: f64 = 0.01;

/// Sums over the neighbours of every grain.
#[derive(Debug, Default)]
pub(crate) struct PairSums {
    near: NearPairs,
    position: Vec<[f64; 2]>,
    moving: Vec<Moving>,
    within: Vec<(u32, [f64; 2])>,
    moments: Vec<MomentSums>,
    neighbours: Vec<u32>,
    /// G = Γ - 1 of every grain; NaN where it is undefined.
    gradient: Vec<Matrix2<f64>>,
}

/// Position of a grain in the earlier frame (NaN for one that is left out, so that
/// it is no one's neighbour) and its displacement (m).
#[derive(Debug, Clone, Copy)]
struct Moving {
    place: [f64; 2],
    displacement: [f64; 2],
}

/// Sums over a grain's neighbours, b being the earlier separation and u its change: Σ b ⊗ b (xx,
/// xy, yy), Σ u ⊗ b (xx, xy, yx, yy), Σ u² (m²).
type MomentSums = [f64; 8];

impl PairSums {
    /// Computes D²min of every grain but those in `left_out`; see [`super::NonAffine::between`].
    pub fn fit(
        &mut self,
        interval: &Interval<'_>,
        left_out: &[bool],
        radius: f64,
        dmin: &mut [f64],
    ) {
        let earlier = interval.earlier();
        let length = earlier.cell.periods[0];
        self.position.clear();
        self.position.extend((0..dmin.len()).map(|n| {
            let [x, y, _] = earlier.position(n);
            [x, y]
        }));
        self.near.update(length, radius, &self.position);
        self.moving.clear();
        let places = self.position.iter().zip(left_out).enumerate();
        self.moving.extend(places.map(|(n, (place, left_out))| {
            let [x, y, _] = interval.displacement_in::<Two>(n);
            Moving {
                place: if *left_out { [f64::NAN; 2] } else { *place },
                displacement: [x, y],
            }
        }));
        Isa::detect().run(SumMoments {
            sums: self,
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

/// Sums the moments of every grain pair by pair in order of (i, j), with the same bits on every
/// instruction set.
struct SumMoments<'a> {
    sums: &'a mut PairSums,
    length: f64,
    radius: f64,
}

impl Work for SumMoments<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _: L::Token) {
        let (length, radius) = (self.length, self.radius);
        let PairSums {
            near,
            moving,
            within,
            moments,
            neighbours,
            ..
        } = self.sums;
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
    let x = Matrix2::new(xx, xy, yx, yy);
    match y.try_inverse() {
        Some(inverse) if regular => x * inverse,
        _ => Matrix2::repeat(f64::NAN),
    }
}
