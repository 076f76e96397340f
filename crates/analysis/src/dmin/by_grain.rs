//! D²min of disks and spheres, between walls and in boxes, grain by grain.

use nalgebra::{Matrix3, Vector3};

use crate::interval::Interval;
use gshear_dem::dimension::Dimension;
use gshear_dem::neighbour::{Bins, LocalExtent};
use gshear_dem::state::{BoxEdges, Cell};

/// Computes D²min of every grain but those in `left_out`; see [`super::NonAffine::between`].
pub fn fit<D: Dimension>(
    interval: &Interval<'_>,
    left_out: &[bool],
    radius: f64,
    dmin: &mut [f64],
) {
    let motion = Motion::new::<D>(interval);
    let bins = motion.bins::<D>(radius);
    for (i, value) in dmin.iter_mut().enumerate() {
        *value = if left_out[i] {
            f64::NAN
        } else {
            residual::<D>(&motion.neighbours(&bins, i, left_out, radius), radius)
        };
    }
}

/// Returns the best gradient G of the displacements around some grains, u = G b; NaN where it is
/// not defined. In 2D its third row and column are 0.
pub fn gradients<D: Dimension>(
    interval: &Interval<'_>,
    left_out: &[bool],
    radius: f64,
    wanted: &[u32],
) -> Vec<Matrix3<f64>> {
    let motion = Motion::new::<D>(interval);
    let bins = motion.bins::<D>(radius);
    let gradients = wanted.iter().map(|i| {
        let pairs = motion.neighbours(&bins, *i as usize, left_out, radius);
        best_gradient::<D>(&pairs, radius).unwrap_or(Matrix3::repeat(f64::NAN))
    });
    gradients.collect()
}

/// Places and displacements of all grains in an interval.
struct Motion {
    /// The earlier cell.
    cell: Cell,
    /// Edges of the earlier and the later cell.
    edges: [BoxEdges; 2],
    /// `[N]` Position in the earlier frame (m).
    place: Vec<[f64; 3]>,
    /// `[N]` (m)
    displacement: Vec<[f64; 3]>,
}

/// A grain and a neighbour of it.
struct Pair {
    /// b, from the grain to its neighbour in the earlier frame (m).
    separation: Vector3<f64>,
    /// u, the change of b (m).
    change: Vector3<f64>,
}

impl Motion {
    fn new<D: Dimension>(interval: &Interval<'_>) -> Self {
        let earlier = interval.earlier();
        let ids = 0..earlier.grains.len();
        Self {
            cell: earlier.cell,
            edges: [earlier.cell.edges::<D>(0.0), interval.later_edges::<D>()],
            place: earlier.grains.iter().map(|grain| grain.position).collect(),
            displacement: ids.map(|n| interval.displacement_in::<D>(n)).collect(),
        }
    }

    fn bins<D: Dimension>(&self, radius: f64) -> Bins<D> {
        let extent = LocalExtent::whole(self.cell.periods[0]);
        Bins::new(self.cell, extent, radius, &self.place)
    }

    /// The neighbours of grain i within the radius that are not left out.
    fn neighbours<D: Dimension>(
        &self,
        bins: &Bins<D>,
        i: usize,
        left_out: &[bool],
        radius: f64,
    ) -> Vec<Pair> {
        let mut pairs: Vec<Pair> = Vec::new();
        bins.each_near(&self.place[i], |j| {
            let j = j as usize;
            if j != i && !left_out[j] {
                let pair = self.pair::<D>(i, j);
                if pair.separation.norm() < radius {
                    pairs.push(pair);
                }
            }
        });
        pairs
    }

    fn pair<D: Dimension>(&self, i: usize, j: usize) -> Pair {
        let (from, to) = (&self.place[i], &self.place[j]);
        let separation = self.cell.separation::<D>(to, from);
        let mut change = Vector3::zeros();
        for axis in 0..D::AXES {
            change[axis] = self.displacement[j][axis] - self.displacement[i][axis];
        }
        let [earlier, later] = &self.edges;
        if earlier != later {
            let counts = images::<D>(&self.cell, separation, to, from);
            for (axis, change) in change.iter_mut().enumerate() {
                let stretched = (0..3).map(|k| counts[k] * (later[k][axis] - earlier[k][axis]));
                *change += stretched.sum::<f64>();
            }
        }
        Pair {
            separation: Vector3::from(separation),
            change,
        }
    }
}

/// The multiples of the cell's edges between a - b and `near`, the nearest of its images.
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

/// Returns the best gradient G in u = G b of the changes u of the separations b; `None` if it is
/// not defined.
fn best_gradient<D: Dimension>(pairs: &[Pair], radius: f64) -> Option<Matrix3<f64>> {
    let mut y = Matrix3::zeros();
    let mut x = Matrix3::zeros();
    for Pair { separation, change } in pairs {
        x += change * separation.transpose();
        y += separation * separation.transpose();
    }
    // In 2D the fit leaves the third axis unchanged.
    (D::AXES..3).for_each(|axis| y[(axis, axis)] = 1.0);
    let scale = radius * radius * pairs.len() as f64;
    let regular = pairs.len() >= D::AXES && y.determinant() > 1e-12 * scale.powi(D::AXES as i32);
    if regular {
        y.try_inverse().map(|inverse| x * inverse)
    } else {
        None
    }
}

/// Returns the mean square residual of the changes u of the separations b after the best gradient G
/// in u = G b; NaN if it is not defined.
fn residual<D: Dimension>(pairs: &[Pair], radius: f64) -> f64 {
    let Some(gradient) = best_gradient::<D>(pairs, radius) else {
        return f64::NAN;
    };
    let left = (pairs.iter()).map(|pair| (pair.change - gradient * pair.separation).norm_squared());
    left.sum::<f64>() / pairs.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use gshear_dem::dimension::{Dimensions, Three, Two};
    use gshear_dem::state::{Frame, GrainSample, Sheared};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const L: f64 = 10.0;

    fn random(count: usize, seed: u64) -> Vec<[f64; 3]> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let place = || std::array::from_fn(|_| random.random());
        std::iter::repeat_with(place).take(count).collect()
    }

    /// The frame of grains at these unwrapped places.
    fn frame<D: Dimension>(cell: &Cell, places: &[[f64; 3]]) -> Frame {
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
        Frame {
            dimension: if D::AXES == 2 {
                Dimensions::Two
            } else {
                Dimensions::Three
            },
            cell: *cell,
            step: 0,
            time: 0.0,
            grains: places.iter().map(grain).collect(),
            contacts: Vec::new(),
            wall_contacts: Vec::new(),
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
                frames: [&earlier, &later],
                periods,
            };
            let mut dmin = vec![f64::NAN; grains];
            fit::<D>(&interval, &vec![false; grains], radius, &mut dmin);
            dmin
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
}
