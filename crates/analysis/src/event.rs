//! Analysis of one event in two or three dimensions: D²min between two states, and how well an
//! eigenvector predicts where grains move (BO).

use nalgebra::{Matrix3, Vector3};

use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::neighbour::{Bins, LocalExtent};
use gshear_dem::state::{BoxEdges, Cell, Disks, FrameRecords};

use crate::rattlers::RattlerRule;

/// Two frames of a run, and how grains are followed from one to the other.
#[derive(Debug, Clone, Copy)]
pub struct Interval<'a> {
    /// The cell in the earlier and in the later frame.
    pub cells: [Cell; 2],
    /// The frames.
    pub frames: [&'a FrameRecords; 2],
    /// Periods that were taken from the Lees–Edwards offset in between; see [`Cell::shear`].
    pub periods: i64,
}

impl Interval<'_> {
    /// The edges of the later cell, with the whole Lees–Edwards offset since the earlier frame (m).
    fn later_edges<D: Dimension>(&self) -> BoxEdges {
        let mut edges = self.cells[1].edges::<D>(0.0);
        edges[D::UP][0] += self.periods as f64 * edges[0][0];
        edges
    }

    /// Returns whether a grain had passed a wall and was removed before the later frame.
    fn removes<D: Dimension>(&self, grain: usize) -> bool {
        self.cells[1].sheared.is_none() && self.frames[1].grains[grain].image[D::UP] != 0
    }

    /// Returns how far the copy of a grain moves that is inside the box in the earlier frame (m).
    pub fn displacement<D: Dimension>(&self, grain: usize) -> [f64; 3] {
        let [from, to] = self.frames.map(|frame| &frame.grains[grain]);
        let mut crossed: [i64; 3] = std::array::from_fn(|axis| to.image[axis] - from.image[axis]);
        crossed[0] -= self.periods * from.image[D::UP];
        self.cells[1].displacement::<D>(&to.position, &from.position, crossed)
    }
}

/// The multiples of the cell's edges that `near` is away from a - b, of which it is an image.
fn images<D: Dimension>(cell: &Cell, near: [f64; 3], a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    let edges = cell.edges::<D>(f64::INFINITY);
    let mut counts = [0.0; 3];
    for axis in [D::UP, 1, 0] {
        let skewed = if axis == 0 {
            counts[D::UP] * edges[D::UP][0]
        } else {
            0.0
        };
        let by = near[axis] - (a[axis] - b[axis]) - skewed;
        counts[axis] = (by / edges[axis][axis]).round();
    }
    counts
}

/// Returns D²min of every grain between two frames, `[N]` (m²): the mean square residual of the
/// neighbours' motion after the best local affine map (LH eq. B1, in D dimensions).
///
/// Neighbours are the grains whose nearest image is within `radius` (m) in the earlier frame; that
/// image is followed to the later frame. NaN if there are fewer neighbours than dimensions or if
/// they lie on one line or plane. Grains for which `counts` is false are neither centres (their
/// value is NaN) nor neighbours.
///
/// This version works grain by grain. [`crate::dmin`] works pair by pair and serves the
/// frames of long runs of disks.
pub fn non_affine<D: Dimension>(
    interval: &Interval<'_>,
    radius: f64,
    counts: impl Fn(usize) -> bool,
) -> Vec<f64> {
    let cell = &interval.cells[0];
    let grains = &interval.frames[0].grains;
    let earlier: Vec<[f64; 3]> = grains.iter().map(|grain| grain.position).collect();
    let moved: Vec<[f64; 3]> = (0..earlier.len())
        .map(|n| interval.displacement::<D>(n))
        .collect();
    let edges = [cell.edges::<D>(0.0), interval.later_edges::<D>()];
    let bins = Bins::<D>::new(*cell, LocalExtent::whole(cell.periods[0]), radius, &earlier);
    // The separation b of j from i, and its change u.
    let pair = |i: usize, j: usize| {
        let b = cell.separation::<D>(&earlier[j], &earlier[i]);
        let mut u = Vector3::zeros();
        (0..D::AXES).for_each(|axis| u[axis] = moved[j][axis] - moved[i][axis]);
        if edges[0] != edges[1] {
            let counts = images::<D>(cell, b, &earlier[j], &earlier[i]);
            for (axis, u) in u.iter_mut().enumerate() {
                let stretched = (0..3).map(|k| counts[k] * (edges[1][k][axis] - edges[0][k][axis]));
                *u += stretched.sum::<f64>();
            }
        }
        [Vector3::from(b), u]
    };
    let of = |i: usize| {
        if !counts(i) {
            return f64::NAN;
        }
        let mut pairs: Vec<[Vector3<f64>; 2]> = Vec::new();
        bins.each_near(&earlier[i], |j| {
            let j = j as usize;
            if j != i && counts(j) {
                let [b, u] = pair(i, j);
                if b.norm() < radius {
                    pairs.push([b, u]);
                }
            }
        });
        residual::<D>(&pairs, radius)
    };
    (0..earlier.len()).map(of).collect()
}

/// Returns the mean square residual of the changes u of the separations b after the best gradient G
/// in u = G b; NaN if it is not defined.
fn residual<D: Dimension>(pairs: &[[Vector3<f64>; 2]], radius: f64) -> f64 {
    let mut y = Matrix3::zeros();
    let mut x = Matrix3::zeros();
    for [b, u] in pairs {
        x += u * b.transpose();
        y += b * b.transpose();
    }
    // In 2D the fit leaves the third axis unchanged.
    (D::AXES..3).for_each(|axis| y[(axis, axis)] = 1.0);
    let scale = radius * radius * pairs.len() as f64;
    let regular = pairs.len() >= D::AXES && y.determinant() > 1e-12 * scale.powi(D::AXES as i32);
    let Some(inverse) = y.try_inverse().filter(|_| regular) else {
        return f64::NAN;
    };
    let gradient = x * inverse;
    let left = pairs.iter().map(|[b, u]| (u - gradient * b).norm_squared());
    left.sum::<f64>() / pairs.len() as f64
}

/// [`non_affine`] in so many dimensions, without the rattlers of the earlier frame and the grains
/// that are removed in the later one.
pub fn between_frames(
    axes: usize,
    grains: &Disks,
    interval: &Interval<'_>,
    radius: f64,
) -> Vec<f64> {
    without_rattlers(axes, grains, interval, radius, RattlerRule::LeeHurley).0
}

/// [`between_frames`] with the rattlers by a rule. Returns the rattlers, `[N]`, as well.
pub fn without_rattlers(
    axes: usize,
    grains: &Disks,
    interval: &Interval<'_>,
    radius: f64,
    rule: RattlerRule,
) -> (Vec<f64>, Vec<bool>) {
    let mut rattler = Vec::new();
    rule.mark(axes, grains, &interval.frames[0].contacts, &mut rattler);
    let values = if axes == 2 {
        non_affine::<Two>(interval, radius, |n| {
            !(rattler[n] || interval.removes::<Two>(n))
        })
    } else {
        non_affine::<Three>(interval, radius, |n| {
            !(rattler[n] || interval.removes::<Three>(n))
        })
    };
    (values, rattler)
}

/// Returns the overlap Σab/√(Σa² Σb²) of two non-negative fields over the grains, `[N]`; grains
/// where either field is not finite are left out.
///
/// It is 1 if one field is a multiple of the other; [`by_chance`] is that of independent fields.
pub fn overlap(a: &[f64], b: &[f64]) -> f64 {
    let sum = |of: fn(f64, f64) -> f64| known_pairs(a, b).map(|(a, b)| of(*a, *b)).sum::<f64>();
    sum(|a, b| a * b) / (sum(|a, _| a * a) * sum(|_, b| b * b)).sqrt()
}

/// Returns the [`overlap`] that two independent fields of these values would have:
/// ⟨a⟩⟨b⟩/√(⟨a²⟩⟨b²⟩), over the grains where both are finite.
pub fn by_chance(a: &[f64], b: &[f64]) -> f64 {
    let sum = |of: fn(f64, f64) -> f64| known_pairs(a, b).map(|(a, b)| of(*a, *b)).sum::<f64>();
    let squares = sum(|a, _| a * a) * sum(|_, b| b * b);
    sum(|a, _| a) * sum(|_, b| b) / (known_pairs(a, b).count() as f64 * squares.sqrt())
}

/// The values of the grains where both are finite.
fn known_pairs<'a>(a: &'a [f64], b: &'a [f64]) -> impl Iterator<Item = (&'a f64, &'a f64)> {
    let pairs = a.iter().zip(b);
    pairs.filter(|(a, b)| a.is_finite() && b.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use gshear_dem::state::{GrainSample, Sheared};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const L: f64 = 10.0;

    fn random(count: usize, seed: u64) -> Vec<[f64; 3]> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let place = || std::array::from_fn(|_| random.random());
        std::iter::repeat_with(place).take(count).collect()
    }

    /// The frame of grains at these unwrapped places, none of which is a rattler.
    fn frame<D: Dimension>(cell: &Cell, places: &[[f64; 3]]) -> FrameRecords {
        // Higher than all of them between walls.
        let edges = cell.edges::<D>(1e3);
        let grain = |place: &[f64; 3]| {
            let mut grain = GrainSample::zeroed();
            grain.position = *place;
            for axis in [D::UP, 1, 0] {
                let image = (grain.position[axis] / edges[axis][axis]).floor();
                grain.image[axis] += image as i64;
                (0..3).for_each(|k| grain.position[k] -= image * edges[axis][k]);
            }
            grain
        };
        FrameRecords {
            grains: places.iter().map(grain).collect(),
            ..FrameRecords::default()
        }
    }

    /// An affine motion has no residual, however far the grains and their images move, and in a box
    /// of less than two radii. If one grain moves by a further d, least squares leave at that grain
    /// the residual of -d at all neighbours: |d|² (1 - Σ r·(Σ rr)⁻¹·Σ r/N).
    fn follows<D: Dimension>(
        sheared: bool,
        (radius, grains): (f64, usize),
        strain: f64,
        lengths: [f64; 3],
    ) {
        let mut cells = [Cell {
            periods: [L, if D::AXES == 2 { f64::INFINITY } else { L }],
            sheared: sheared.then(|| Sheared::upright(L)),
        }; 2];
        cells[0].shear(0.37 * L);
        cells[1] = cells[0].with_lengths::<D>(lengths);
        let periods = cells[1].shear(strain * lengths[D::UP]);
        let edges = cells[0].edges::<D>(L);
        let wandered = random(grains, 1);
        let mut places = random(grains, 2);
        for (place, wandered) in places.iter_mut().zip(&wandered) {
            *place = place.map(|x| L * x);
            place[D::AXES..].fill(0.0);
            // Images of before the earlier frame; there are none across walls.
            for axis in 0..if sheared { D::AXES } else { D::UP } {
                let images = (6.0 * wandered[axis] - 3.0).round();
                (0..3).for_each(|k| place[k] += images * edges[axis][k]);
            }
        }
        let mut drift = [33.1, -27.3, 14.9];
        if !sheared {
            drift[D::UP] = 0.0;
        }
        let moved = |place: &[f64; 3]| {
            let mut place = *place;
            (0..D::AXES).for_each(|axis| place[axis] *= lengths[axis] / L);
            place[0] += strain * place[D::UP];
            (0..D::AXES).for_each(|axis| place[axis] += drift[axis]);
            place
        };
        let mut later: Vec<[f64; 3]> = places.iter().map(moved).collect();
        let earlier = frame::<D>(&cells[0], &places);
        let dmin = |later: &[[f64; 3]]| {
            let later = frame::<D>(&cells[1], later);
            let interval = Interval {
                cells,
                frames: [&earlier, &later],
                periods,
            };
            non_affine::<D>(&interval, radius, |_| true)
        };
        for left in dmin(&later) {
            assert!(left < 1e-24, "{left}");
        }
        let by = 1.7 * L;
        later[0][0] += by;
        let left = dmin(&later)[0];
        let at = |g: usize| earlier.grains[g].position;
        let near = (1..grains).map(|j| Vector3::from(cells[0].separation::<D>(&at(j), &at(0))));
        let near: Vec<Vector3<f64>> = near.filter(|r| r.norm() < radius).collect();
        let mut y: Matrix3<f64> = near.iter().map(|r| r * r.transpose()).sum();
        (D::AXES..3).for_each(|axis| y[(axis, axis)] = 1.0);
        let sum: Vector3<f64> = near.iter().sum();
        let part = (sum.transpose() * y.try_inverse().unwrap() * sum)[0] / near.len() as f64;
        let expected = by * by * (1.0 - part);
        assert!((left / expected - 1.0).abs() < 1e-9, "{left} {expected}");
    }

    #[test]
    fn what_is_affine_leaves_nothing_and_what_is_not_the_closed_form() {
        let cube = [L; 3];
        // A wide and a narrow box.
        for size in [(2.0, 400), (6.0, 60)] {
            for strain in [0.0, 0.02, 2.73, -0.9] {
                follows::<Two>(true, size, strain, cube);
                follows::<Three>(true, size, strain, cube);
            }
            for lengths in [[8.0, 9.0, 12.0], [9.5; 3]] {
                follows::<Two>(true, size, 0.0, lengths);
                follows::<Three>(true, size, 0.0, lengths);
            }
            follows::<Two>(false, size, 0.3, cube);
            follows::<Three>(false, size, 0.3, cube);
        }
    }

    #[test]
    fn overlaps_of_equal_and_of_separate_fields() {
        assert_eq!(overlap(&[1.0, 2.0, f64::NAN], &[2.0, 4.0, 9.0]), 1.0);
        assert_eq!(overlap(&[1.0, 0.0], &[0.0, 3.0]), 0.0);
        // ⟨a⟩⟨b⟩ = 1/2 · 3/2, ⟨a²⟩⟨b²⟩ = 1/2 · 9/2.
        assert_eq!(by_chance(&[1.0, 0.0, 7.0], &[0.0, 3.0, f64::NAN]), 0.5);
    }
}
