//! Analysis of one event in two or three dimensions: D²min between two states, and how well an
//! eigenvector predicts where grains move (BO).

use nalgebra::{Matrix3, Vector3};

use gshear_dem::dimension::Dimension;
use gshear_dem::neighbour::{Bins, LocalExtent};
use gshear_dem::state::{Cell, Disks, FrameRecords};

use crate::rattlers;

/// Returns D²min of every grain between two states, `[N]` (m²): the mean square residual of the
/// neighbours' motion after the best local affine map (LH eq. B1, in D dimensions).
///
/// `cells`: the cell in the earlier and in the later state. Neighbours are the grains within
/// `radius` (m) in the earlier state. NaN if there are fewer neighbours than dimensions or if they
/// lie on one line or plane. Grains for which `counts` is false are neither centres (their value is
/// NaN) nor neighbours.
///
/// This version works grain by grain. [`crate::dmin`] works pair by pair and serves the
/// frames of long runs of disks.
pub fn non_affine<D: Dimension>(
    cells: [Cell; 2],
    earlier: &[[f64; 3]],
    later: &[[f64; 3]],
    radius: f64,
    counts: impl Fn(usize) -> bool,
) -> Vec<f64> {
    let apart = |cell: &Cell, at: &[[f64; 3]], i: usize, j: usize| {
        let mut r = Vector3::from(cell.separation::<D>(&at[j], &at[i]));
        r.iter_mut().skip(D::AXES).for_each(|x| *x = 0.0);
        r
    };
    let extent = LocalExtent::whole(cells[0].periods[0]);
    let bins = Bins::<D>::new(cells[0], extent, radius, earlier);
    let of = |i: usize| {
        if !counts(i) {
            return f64::NAN;
        }
        let mut pairs: Vec<[Vector3<f64>; 2]> = Vec::new();
        bins.each_near(&earlier[i], |j| {
            let j = j as usize;
            if j != i && counts(j) {
                let before = apart(&cells[0], earlier, i, j);
                if before.norm() < radius {
                    pairs.push([before, apart(&cells[1], later, i, j)]);
                }
            }
        });
        let mut y = Matrix3::zeros();
        let mut x = Matrix3::zeros();
        for [before, after] in &pairs {
            x += after * before.transpose();
            y += before * before.transpose();
        }
        // In 2D the fit leaves the third axis unchanged.
        (D::AXES..3).for_each(|axis| y[(axis, axis)] = 1.0);
        let scale = radius * radius * pairs.len() as f64;
        let regular = y.determinant() > 1e-12 * scale.powi(D::AXES as i32);
        match y
            .try_inverse()
            .filter(|_| regular && pairs.len() >= D::AXES)
        {
            Some(inverse) => {
                let map = x * inverse;
                let left =
                    |[before, after]: &[Vector3<f64>; 2]| (after - map * before).norm_squared();
                pairs.iter().map(left).sum::<f64>() / pairs.len() as f64
            }
            None => f64::NAN,
        }
    };
    (0..earlier.len()).map(of).collect()
}

/// [`non_affine`] between two frames, without the rattlers of the earlier one.
pub fn between_frames<D: Dimension>(
    grains: &Disks,
    cells: [Cell; 2],
    frames: [&FrameRecords; 2],
    radius: f64,
) -> Vec<f64> {
    let [earlier, later] = frames.map(|frame| {
        let places = frame.grains.iter().map(|grain| grain.position);
        places.collect::<Vec<_>>()
    });
    let mut rattler = Vec::new();
    let contacts = &frames[0].contacts;
    match D::AXES {
        2 => rattlers::mark::<2>(grains, contacts, &mut rattler),
        _ => rattlers::mark::<3>(grains, contacts, &mut rattler),
    }
    non_affine::<D>(cells, &earlier, &later, radius, |n| !rattler[n])
}

/// Returns the overlap Σab/√(Σa² Σb²) of two non-negative fields over the grains, `[N]`; grains
/// where either field is not finite are left out.
///
/// It is 1 if one field is a multiple of the other; [`by_chance`] is that of independent fields.
pub fn overlap(a: &[f64], b: &[f64]) -> f64 {
    let pairs = || {
        a.iter()
            .zip(b)
            .filter(|(a, b)| a.is_finite() && b.is_finite())
    };
    let sum = |of: fn(f64, f64) -> f64| pairs().map(|(a, b)| of(*a, *b)).sum::<f64>();
    sum(|a, b| a * b) / (sum(|a, _| a * a) * sum(|_, b| b * b)).sqrt()
}

/// Returns the [`overlap`] that two independent fields of these values would have:
/// ⟨a⟩⟨b⟩/√(⟨a²⟩⟨b²⟩), over the grains where both are finite.
pub fn by_chance(a: &[f64], b: &[f64]) -> f64 {
    let pairs = || {
        a.iter()
            .zip(b)
            .filter(|(a, b)| a.is_finite() && b.is_finite())
    };
    let sum = |of: fn(f64, f64) -> f64| pairs().map(|(a, b)| of(*a, *b)).sum::<f64>();
    let squares = sum(|a, _| a * a) * sum(|_, b| b * b);
    sum(|a, _| a) * sum(|_, b| b) / (pairs().count() as f64 * squares.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use gshear_dem::dimension::{Three, Two};
    use gshear_dem::state::Sheared;

    fn scattered(count: usize, height: f64, planar: bool) -> Vec<[f64; 3]> {
        let mut seed = 5u64;
        let mut random = || {
            seed = seed
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1u64 << 53) as f64
        };
        let point = |_| {
            let p = [10.0 * random(), 10.0 * random(), height * random()];
            if planar { [p[0], p[1], 0.0] } else { p }
        };
        (0..count).map(point).collect()
    }

    /// An affine motion has no residual, also across the seams of a sheared cell. If one grain
    /// moves by a further d, least squares leave at that grain the residual of -d at all
    /// neighbours: |d|² (1 - Σ r·(Σ rr)⁻¹·Σ r/N).
    fn affine<D: Dimension>(planar: bool) {
        let sheared = Sheared::upright(10.0);
        let before = Cell {
            periods: [10.0, if planar { f64::INFINITY } else { 10.0 }],
            sheared: Some(sheared),
        };
        let earlier = scattered(400, 10.0, planar);
        let mut after = before;
        after.shear(0.02 * 10.0);
        let mut later = earlier.clone();
        later.iter_mut().for_each(|p| p[0] += 0.02 * p[D::UP]);
        let cells = [before, after];
        let left = non_affine::<D>(cells, &earlier, &later, 2.0, |_| true);
        for left in left {
            assert!(left < 1e-24, "{left}");
        }
        let (moved, by) = (0, 0.01);
        later[moved][1] += by;
        let left = non_affine::<D>(cells, &earlier, &later, 2.0, |_| true)[moved];
        let near = (0..400).filter(|&j| j != moved);
        let near =
            near.map(|j| Vector3::from(before.separation::<D>(&earlier[j], &earlier[moved])));
        let near: Vec<Vector3<f64>> = near.filter(|r| r.norm() < 2.0).collect();
        let mut y: Matrix3<f64> = near.iter().map(|r| r * r.transpose()).sum();
        (D::AXES..3).for_each(|axis| y[(axis, axis)] = 1.0);
        let sum: Vector3<f64> = near.iter().sum();
        let part = (sum.transpose() * y.try_inverse().unwrap() * sum)[0] / near.len() as f64;
        let expected = by * by * (1.0 - part);
        assert!((left / expected - 1.0).abs() < 1e-9, "{left} {expected}");
    }

    #[test]
    fn what_is_affine_leaves_nothing_and_what_is_not_the_closed_form() {
        affine::<Two>(true);
        affine::<Three>(false);
    }

    #[test]
    fn overlaps_of_equal_and_of_separate_fields() {
        assert_eq!(overlap(&[1.0, 2.0, f64::NAN], &[2.0, 4.0, 9.0]), 1.0);
        assert_eq!(overlap(&[1.0, 0.0], &[0.0, 3.0]), 0.0);
        // ⟨a⟩⟨b⟩ = 1/2 · 3/2, ⟨a²⟩⟨b²⟩ = 1/2 · 9/2.
        assert_eq!(by_chance(&[1.0, 0.0, 7.0], &[0.0, 3.0, f64::NAN]), 0.5);
    }
}
