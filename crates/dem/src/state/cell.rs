//! The cell: periodic along all axes but the last, along which there are walls, or periodic along
//! all axes and sheared.

use crate::contact::portable_exp;
use crate::dimension::Dimension;
use crate::simd::{Lanes, Mask};

/// The nearest image of a separation along a periodic axis of `length` (m).
#[inline]
pub fn nearest_image(dx: f64, length: f64) -> f64 {
    // Most are their own, and dividing and rounding take long.
    if dx.abs() < 0.5 * length {
        return dx;
    }
    dx - length * (dx / length).round()
}

/// Multiples of the edges of the box by which a position is wrapped.
pub type Image = [i64; 3];

/// The edge vectors of a box, one a row (m).
pub type BoxEdges = [[f64; 3]; 3];

/// The periods of the cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// L_x, and in three dimensions L_y (m).
    pub periods: [f64; 2],
    /// The last axis of a cell that is periodic along it.
    pub sheared: Option<Sheared>,
}

/// The last axis of a Lees–Edwards cell, whose image above is displaced along x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sheared {
    /// Period along the last axis (m).
    pub height: f64,
    /// The Lees–Edwards offset: displacement of the image above along x (m), in [-L_x/2, L_x/2].
    pub offset: f64,
    /// Its velocity along x (m/s): γ̇ times the height.
    pub velocity: f64,
    /// That of the half step.
    pub half_velocity: f64,
    /// √(L_x'/L_x) of the last step, in which the images move by Δt V times this.
    pub half_stretch: f64,
    /// The affine motion of a step that changes the lengths of the cell. `None` in all other steps.
    pub stretching: Option<Stretching>,
}

/// The affine motion of a step that changes the lengths of a cell: relative velocity over
/// separation along each axis (1/s).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Stretching {
    /// In the half step: of a step from one separation to the next, over the next.
    pub half: [f64; 3],
    /// At the full step.
    pub full: [f64; 3],
}

impl Sheared {
    /// Images straight above each other, at rest; `height` in m.
    pub const fn upright(height: f64) -> Self {
        Self {
            height,
            offset: 0.0,
            velocity: 0.0,
            half_velocity: 0.0,
            half_stretch: 1.0,
            stretching: None,
        }
    }

    /// How far (m) the images above move along x in a `step` (s).
    pub(crate) fn step_of_images(&self, step: f64) -> f64 {
        step * self.half_velocity * self.half_stretch
    }

    /// dx/dz along a column of images.
    fn tilt(&self) -> f64 {
        self.offset / self.height
    }
}

impl Cell {
    /// Between walls; L_x and L_y (m).
    pub const fn between_walls(periods: [f64; 2]) -> Self {
        Self {
            periods,
            sheared: None,
        }
    }

    /// The nearest image of a - b (m), as many components as there are dimensions.
    #[inline]
    pub fn separation<D: Dimension>(&self, a: &[f64], b: &[f64]) -> [f64; 3] {
        let mut r = [0.0; 3];
        for (axis, r) in r[..D::AXES].iter_mut().enumerate() {
            *r = a[axis] - b[axis];
        }
        if let Some(sheared) = self.sheared {
            let images = (r[D::UP] / sheared.height).round();
            r[D::UP] -= images * sheared.height;
            r[0] -= images * sheared.offset;
        }
        for (r, period) in r[..D::UP].iter_mut().zip(self.periods) {
            *r = nearest_image(*r, period);
        }
        r
    }

    /// [`Cell::separation`] of sixteen differences of positions at a time. Returns by how many
    /// heights of a sheared cell they were moved.
    #[inline(always)]
    pub(crate) fn nearest_images<D: Dimension, L: Lanes>(
        &self,
        token: L::Token,
        r: &mut [L; 3],
    ) -> Option<L> {
        let c = |v| L::splat(token, v);
        let mut furthest = c(0.0);
        if let Some(sheared) = &self.sheared {
            furthest = (r[D::UP] * c(1.0 / sheared.height)).abs();
        }
        for (r, period) in r[..D::UP].iter().zip(self.periods) {
            furthest = furthest.max((*r * c(1.0 / period)).abs());
        }
        // Few pairs are across an edge.
        if c(0.5).greater(furthest).bits() == u16::MAX {
            return None;
        }
        let mut beyond = None;
        if let Some(sheared) = &self.sheared {
            let images = -(r[D::UP] * c(1.0 / sheared.height)).round();
            r[D::UP] = images.mul_add(c(sheared.height), r[D::UP]);
            r[0] = images.mul_add(c(sheared.offset), r[0]);
            beyond = Some(images);
        }
        for (r, period) in r[..D::UP].iter_mut().zip(self.periods) {
            let images = -(*r * c(1.0 / period)).round();
            *r = images.mul_add(c(period), *r);
        }
        beyond
    }

    /// Returns to - from (m) of a grain whose image has changed by `crossed`, so that nothing jumps
    /// at the edges.
    pub fn displacement<D: Dimension>(&self, to: &[f64], from: &[f64], crossed: Image) -> [f64; 3] {
        let edges = self.edges::<D>(0.0);
        let mut moved = [0.0; 3];
        for (axis, moved) in moved[..D::AXES].iter_mut().enumerate() {
            let images = (0..D::AXES).map(|k| crossed[k] as f64 * edges[k][axis]);
            *moved = to[axis] - from[axis] + images.sum::<f64>();
        }
        moved
    }

    /// Wraps x into [0, period). Called in the step in which x leaves that range. Returns by how
    /// many periods it went beyond, which is added to its image.
    #[cold]
    pub fn wrap(x: &mut f64, period: f64) -> i64 {
        let below = *x < 0.0;
        let inside = if below { *x + period } else { *x - period };
        // If x is just below 0, the sum rounds to the period.
        let outside = inside >= period;
        *x = if outside { 0.0 } else { inside };
        i64::from(!below) - i64::from(below && !outside)
    }

    /// Wraps the position of a record that has left a sheared cell along the last axis, and changes
    /// its velocities by that of the image.
    #[inline(always)]
    pub fn wrap_last_axis<D: Dimension>(&self, fields: &mut [f64], image: &mut Image) {
        if let Some(sheared) = &self.sheared
            && !(0.0..sheared.height).contains(&fields[D::UP])
        {
            self.wrap_through_image::<D>(sheared, fields, image);
        }
    }

    #[cold]
    fn wrap_through_image<D: Dimension>(
        &self,
        sheared: &Sheared,
        fields: &mut [f64],
        image: &mut Image,
    ) {
        let beyond = Self::wrap(&mut fields[D::UP], sheared.height);
        image[D::UP] += beyond;
        let images = -beyond as f64;
        fields[0] += images * sheared.offset;
        if !(0.0..self.periods[0]).contains(&fields[0]) {
            image[0] += Self::wrap(&mut fields[0], self.periods[0]);
        }
        fields[D::VELOCITY] += images * sheared.half_velocity;
        fields[D::HALF_VELOCITY] += images * sheared.half_velocity;
    }

    /// The velocity of a grain (m/s) less that with which it streams in a sheared cell.
    #[inline(always)]
    pub(crate) fn peculiar_velocity<D: Dimension>(&self, fields: &[f64]) -> [f64; 3] {
        let mut u = [0.0; 3];
        u[..D::AXES].copy_from_slice(&fields[D::VELOCITY..D::VELOCITY + D::AXES]);
        if let Some(sheared) = &self.sheared {
            u[0] -= sheared.velocity / sheared.height * fields[D::UP];
        }
        u
    }

    /// The strain of the last step (s) along the edges, at most.
    pub(crate) fn stretched_by(&self, step: f64) -> f64 {
        let stretching = self.sheared.and_then(|sheared| sheared.stretching);
        let rates = stretching.map_or([0.0; 3], |stretching| stretching.half);
        let strains = rates.map(|rate| (step * rate).abs());
        strains.into_iter().fold(0.0, f64::max)
    }

    /// The coordinate of a grain by which slabs are cut (m), in [0, L_x): x, or in a sheared cell x
    /// less the tilt. The cuts between slabs tilt with the images of a sheared cell, so that a
    /// grain and its image above are in the same slab.
    pub(crate) fn slab_coordinate<D: Dimension>(&self, position: &[f64]) -> f64 {
        let Some(sheared) = &self.sheared else {
            return position[0];
        };
        let s = position[0] - sheared.tilt() * position[D::UP];
        let inside = s - self.periods[0] * (s / self.periods[0]).floor();
        if inside >= self.periods[0] {
            0.0
        } else {
            inside
        }
    }

    /// The greatest difference of [`Cell::slab_coordinate`] between two grains that are `cutoff`
    /// (m) apart.
    pub(crate) fn cutoff_along_x(&self, cutoff: f64) -> f64 {
        match &self.sheared {
            None => cutoff,
            // 1e-9 more, for the rounding of `along`.
            Some(sheared) => cutoff * (1.0 + sheared.tilt() * sheared.tilt()).sqrt() * (1.0 + 1e-9),
        }
    }

    /// [`Cell::cutoff_along_x`] at the greatest offset of the images.
    pub(crate) fn greatest_cutoff_along_x(&self, cutoff: f64) -> f64 {
        let at_greatest_offset = |sheared| Self {
            sheared: Some(Sheared {
                offset: 0.5 * self.periods[0],
                ..sheared
            }),
            ..*self
        };
        self.sheared
            .map_or(cutoff, |s| at_greatest_offset(s).cutoff_along_x(cutoff))
    }

    /// The edge vectors; `height`: along the last axis (m), if the cell is not periodic along it.
    /// In two dimensions the third edge is the unit depth.
    pub fn edges<D: Dimension>(&self, height: f64) -> BoxEdges {
        let mut edges = [[0.0; 3]; 3];
        edges[2][2] = 1.0;
        for (axis, period) in self.periods[..D::UP].iter().enumerate() {
            edges[axis][axis] = *period;
        }
        edges[D::UP][D::UP] = self.sheared.map_or(height, |sheared| sheared.height);
        edges[D::UP][0] = self.sheared.map_or(0.0, |sheared| sheared.offset);
        edges
    }

    /// The lengths along the axes (m), of a cell that is periodic along all of them; 1 along an
    /// axis that two dimensions lack.
    pub fn lengths<D: Dimension>(&self) -> [f64; 3] {
        let edges = self.edges::<D>(f64::NAN);
        std::array::from_fn(|axis| edges[axis][axis])
    }

    /// The cell with these lengths (m), stretched affinely with its images.
    pub fn with_lengths<D: Dimension>(&self, lengths: [f64; 3]) -> Self {
        let mut cell = *self;
        cell.periods[..D::UP].copy_from_slice(&lengths[..D::UP]);
        if let Some(sheared) = &mut cell.sheared {
            sheared.height = lengths[D::UP];
            sheared.offset *= lengths[0] / self.periods[0];
        }
        cell
    }

    /// Adds this length (m) to the Lees–Edwards offset. Returns the number of periods that were
    /// taken from it to keep it within ± L_x/2.
    pub fn shear(&mut self, by: f64) -> i64 {
        let period = self.periods[0];
        let Some(sheared) = &mut self.sheared else {
            return 0;
        };
        let whole = sheared.offset + by;
        sheared.offset = nearest_image(whole, period);
        ((whole - sheared.offset) / period).round() as i64
    }
}

/// A length after this natural strain, compression positive.
pub fn strained(length: f64, strain: f64) -> f64 {
    if strain < 0.0 {
        length / portable_exp(strain)
    } else {
        length * portable_exp(-strain)
    }
}

/// Length of a vector (m).
pub fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dimension::{Three, Two};

    /// Against the nearest of all images, whatever the offset.
    fn nearest<D: Dimension>() {
        let mut seed = 3u64;
        let mut random = || {
            seed = seed
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1u64 << 53) as f64
        };
        for _ in 0..2000 {
            let mut cell = Cell::between_walls([5.0, 4.0]);
            let height = 6.0;
            cell.sheared = Some(Sheared::upright(height));
            cell.shear(20.0 * random() - 10.0);
            let offset = cell.sheared.unwrap().offset;
            assert!(offset.abs() <= 2.5);
            let mut point = |periods: [f64; 3]| periods.map(|l| l * random());
            let periods = if D::AXES == 2 {
                [5.0, 6.0, 0.0]
            } else {
                [5.0, 4.0, 6.0]
            };
            let (a, b) = (point(periods), point(periods));
            let mut least = f64::INFINITY;
            let mut best = [0.0; 3];
            for up in -2..=2 {
                for along in -3..=3 {
                    for across in if D::AXES == 2 { 0..=0 } else { -1..=1 } {
                        let mut r = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
                        r[0] += f64::from(along) * 5.0 + f64::from(up) * offset;
                        if D::AXES == 3 {
                            r[1] += f64::from(across) * 4.0;
                        }
                        r[D::UP] += f64::from(up) * height;
                        if length(r) < least {
                            (least, best) = (length(r), r);
                        }
                    }
                }
            }
            // Farther apart than half a period there may be another image as near.
            if least < 1.9 {
                let r = cell.separation::<D>(&a, &b);
                for (r, best) in r.iter().zip(best) {
                    assert!((r - best).abs() < 1e-12, "{r} {best}");
                }
                let along = cell.slab_coordinate::<D>(&a) - cell.slab_coordinate::<D>(&b);
                assert!(nearest_image(along, 5.0).abs() <= cell.cutoff_along_x(least));
                assert!(cell.cutoff_along_x(least) <= cell.greatest_cutoff_along_x(least));
            }
        }
    }

    #[test]
    fn separations_in_a_sheared_cell_are_those_of_the_nearest_images() {
        nearest::<Two>();
        nearest::<Three>();
    }

    #[test]
    fn the_edges_lead_to_the_images() {
        let walls = Cell::between_walls([5.0, 4.0]);
        let depth = [0.0, 0.0, 1.0];
        let lengths = [[5.0, 0.0, 0.0], [0.0, 7.0, 0.0], depth];
        assert_eq!(walls.edges::<Two>(7.0), lengths);
        let mut cell = walls;
        cell.sheared = Some(Sheared {
            offset: -1.5,
            velocity: 0.25,
            ..Sheared::upright(6.0)
        });
        let [a, b, c] = cell.edges::<Three>(f64::NAN);
        for image in [a, b, c] {
            assert_eq!(cell.separation::<Three>(&image, &[0.0; 3]), [0.0; 3]);
        }
        assert_eq!((a[0], b[1], c), (5.0, 4.0, [-1.5, 0.0, 6.0]));
        assert_eq!(cell.edges::<Two>(0.0)[1..], [[-1.5, 6.0, 0.0], depth]);
    }

    /// A place just below 0 is rounded to 0, not moved by a period.
    #[test]
    fn images_are_counted_where_positions_jump() {
        for (x, inside, image) in [
            (-0.25, 4.75, -1),
            (5.25, 0.25, 1),
            (5.0, 0.0, 1),
            (-1e-30, 0.0, 0),
        ] {
            let mut wrapped = x;
            assert_eq!(Cell::wrap(&mut wrapped, 5.0), image);
            assert_eq!(wrapped, inside);
        }
        let mut cell = Cell {
            periods: [5.0, f64::INFINITY],
            sheared: Some(Sheared {
                offset: 2.25,
                ..Sheared::upright(6.0)
            }),
        };
        assert_eq!((cell.shear(0.5), cell.sheared.unwrap().offset), (1, -2.25));
        assert_eq!((cell.shear(-0.5), cell.sheared.unwrap().offset), (-1, 2.25));
    }

    #[test]
    fn a_grain_and_its_image_are_in_one_place() {
        let sheared = Sheared {
            offset: -1.5,
            half_velocity: 0.25,
            ..Sheared::upright(6.0)
        };
        let cell = Cell {
            periods: [5.0, f64::INFINITY],
            sheared: Some(sheared),
        };
        for (x, z) in [(0.5, 6.25), (4.75, -0.125)] {
            let mut fields = vec![0.0; 16];
            (fields[0], fields[Two::UP]) = (x, z);
            let before = cell.slab_coordinate::<Two>(&fields);
            let mut image = [0; 3];
            cell.wrap_last_axis::<Two>(&mut fields, &mut image);
            let edges = cell.edges::<Two>(0.0);
            for (axis, before) in [x, z].into_iter().enumerate() {
                let images = (0..3).map(|k| image[k] as f64 * edges[k][axis]);
                assert_eq!(fields[axis] + images.sum::<f64>(), before);
            }
            assert!((0.0..5.0).contains(&fields[0]) && (0.0..6.0).contains(&fields[1]));
            assert!((cell.slab_coordinate::<Two>(&fields) - before).abs() < 1e-14);
            assert!(length(cell.separation::<Two>(&fields, &[x, z])) < 1e-14);
            let faster = if z < 0.0 { 0.25 } else { -0.25 };
            assert_eq!(fields[Two::VELOCITY], faster);
            assert_eq!(fields[Two::HALF_VELOCITY], faster);
        }
    }
}
