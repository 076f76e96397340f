//! Holes in walls of grains through which free grains may leave, and the grains that close them
//! (docs/explanation/scheme.md, "Holes in walls").
//!
//! A wall has a hole for a grain of radius r if a path for its centre leads through the wall,
//! farther than `R_i` + r from every grain i of it. A hole that is bridged by a grain greater than
//! it stays closed: the grain is wedged between grains of the wall. One that is wider than what
//! rests over it is bridged by an arch, which shear breaks.

use gshear_dem::state::{GrainState, body, length};

use crate::derived::wall_layers;
use crate::grains::Sample;
use crate::insertion::finish_walls;
use crate::sample::Walls;
use crate::scene::Scene;
use crate::walls::PlaneShear;

mod pores;
mod rings;

/// Mean overlaps by which a grain may be squeezed through a hole.
const SQUEEZED: f64 = 10.0;
/// Diameters of the largest grain above a wall in which grains may close its holes.
const REACH: f64 = 2.0;
/// Radii of disks and of spheres for which holes are looked for, at most.
const MOST_RADII: [usize; 2] = [200, 8];

/// A grain in or above a wall.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sphere {
    id: u32,
    /// x, y (0 of disks), and the height of the centre above the outer plane of the wall (m).
    place: [f64; 3],
    radius: f64,
    /// Whether it belongs to the wall.
    is_wall: bool,
}

/// A wall and the grains near it.
struct Wall {
    spheres: Vec<Sphere>,
    /// Lengths along x and y (m); infinite along y of disks.
    periods: [f64; 2],
    /// How far a grain may be squeezed (m).
    margin: f64,
}

/// The free grains, by their ids in ascending order, that close the holes of the walls of a packed
/// sample through which others could leave, and become grains of the walls; with the body of each.
/// `grains`: all within [`reach`] of the walls.
///
/// Walls thinner than the default are taken as they are.
pub fn plugs(
    scene: &Scene,
    plane_shear: &PlaneShear,
    edges: [f64; 2],
    grains: &[GrainState],
) -> Vec<(u32, u32)> {
    let sample = &scene.sample;
    if !closes_holes(plane_shear, sample) {
        return Vec::new();
    }
    let mut plugs = Vec::new();
    for body in plane_shear.boundary.bodies() {
        let wall = Wall::new(scene, plane_shear, body, edges, grains);
        plugs.extend(wall.plugs().into_iter().map(|id| (id, body)));
    }
    plugs.sort_unstable();
    plugs
}

/// Distance from the outer plane of a wall within which grains decide about its holes (m).
pub fn reach(plane_shear: &PlaneShear, sample: &Sample) -> f64 {
    plane_shear.wall_thickness(sample) + REACH * 2.0 * sample.radius_max
}

/// Makes grains of the walls of these plugs that are among `grains`.
pub fn close(grains: &mut [GrainState], plugs: &[(u32, u32)], material: Option<u64>) {
    for g in grains {
        if let Ok(at) = plugs.binary_search_by_key(&g.id, |(id, _)| *id) {
            g.body = plugs[at].1;
            finish_walls(std::slice::from_mut(g), material);
        }
    }
}

/// Whether the holes of the walls are closed: those of layers of grains at least as thick as by
/// default.
fn closes_holes(plane_shear: &PlaneShear, sample: &Sample) -> bool {
    plane_shear.walls == Walls::Layers && plane_shear.wall_layers >= wall_layers(sample)
}

impl Wall {
    /// The wall of this body of a sample between these edges (m), and the free grains near it.
    fn new(
        scene: &Scene,
        plane_shear: &PlaneShear,
        body: u32,
        edges: [f64; 2],
        grains: &[GrainState],
    ) -> Self {
        let sample = &scene.sample;
        let up = scene.dimension.axes() - 1;
        let far = reach(plane_shear, sample);
        let mut spheres = Vec::new();
        for g in grains {
            let height = match body {
                body::BOTTOM => g.position[up] - edges[0],
                _ => edges[1] - g.position[up],
            };
            let is_near = g.body == body::FREE && height < far;
            if g.body != body && !is_near {
                continue;
            }
            let y = if up == 1 { 0.0 } else { g.position[1] };
            spheres.push(Sphere {
                id: g.id,
                place: [g.position[0], y, height],
                radius: g.radius,
                is_wall: g.body == body,
            });
        }
        spheres.sort_by_key(|sphere| sphere.id);
        Self {
            spheres,
            periods: [sample.length, sample.width],
            margin: SQUEEZED * plane_shear.load.mean_overlap(sample),
        }
    }

    /// The ids of the free grains that close the holes that leak. A sample so loose that it takes
    /// as many as the wall has keeps its holes.
    fn plugs(mut self) -> Vec<u32> {
        let most = self.spheres.iter().filter(|sphere| sphere.is_wall).count();
        if most == 0 {
            return Vec::new();
        }
        let paths = self.paths();
        let mut plugs = Vec::new();
        while let Some(plug) = self.leak(&paths) {
            if plugs.len() == most {
                return Vec::new();
            }
            plugs.push(self.spheres[plug].id);
            self.spheres[plug].is_wall = true;
        }
        plugs
    }

    /// The free grain that closes a hole that leaks, as a place in the list; `None` if there is no
    /// such hole.
    fn leak(&self, paths: &Paths) -> Option<usize> {
        let walls: Vec<bool> = self.spheres.iter().map(|sphere| sphere.is_wall).collect();
        let mut limits = [f64::INFINITY, 0.0];
        for sphere in self.spheres.iter().filter(|sphere| !sphere.is_wall) {
            limits[0] = limits[0].min(sphere.radius);
            limits[1] = limits[1].max(sphere.radius);
        }
        // Most walls have no hole for any grain.
        paths.through(&walls, limits[0] - self.margin)?;
        let over = self.resting();
        for radius in self.radii(&over, limits) {
            let mut bridged = walls.clone();
            for (k, sphere) in self.spheres.iter().enumerate() {
                bridged[k] |= over[k] && sphere.radius > radius;
            }
            if let Some(place) = paths.through(&bridged, radius - self.margin) {
                return self.nearest_free(place);
            }
        }
        None
    }

    fn paths(&self) -> Paths {
        if self.periods[1].is_finite() {
            Paths::Spheres(pores::Pores::new(self))
        } else {
            Paths::Disks(rings::Rings::new(self))
        }
    }

    /// Which free grains touch the wall.
    fn resting(&self) -> Vec<bool> {
        let mut wall: Vec<&Sphere> = self.spheres.iter().filter(|s| s.is_wall).collect();
        wall.sort_by(|a, b| a.place[0].total_cmp(&b.place[0]));
        let widest = greatest_radius(&self.spheres);
        let mut resting = Vec::with_capacity(self.spheres.len());
        for g in &self.spheres {
            let far = g.radius + widest + self.margin;
            let touches = [-1.0, 0.0, 1.0].into_iter().any(|image| {
                let x = g.place[0] + image * self.periods[0];
                let [first, end] =
                    [x - far, x + far].map(|edge| wall.partition_point(|s| s.place[0] < edge));
                wall[first..end]
                    .iter()
                    .any(|s| self.distance(&g.place, &s.place) < g.radius + s.radius + self.margin)
            });
            resting.push(touches && !g.is_wall);
        }
        resting
    }

    /// The radii for which holes are looked for: those of what rests over the wall, as fewer grains
    /// bridge holes for greater ones.
    fn radii(&self, over: &[bool], limits: [f64; 2]) -> Vec<f64> {
        let mut radii = limits.to_vec();
        let resting = self.spheres.iter().zip(over).filter(|(_, over)| **over);
        radii.extend(resting.map(|(sphere, _)| sphere.radius));
        radii.sort_by(f64::total_cmp);
        radii.dedup();
        let is_planar = self.periods[1].is_infinite();
        let every = radii.len().div_ceil(MOST_RADII[usize::from(!is_planar)]);
        // The greatest radius is always one of them.
        radii.into_iter().rev().step_by(every).rev().collect()
    }

    /// The free grain whose surface is nearest to a place.
    fn nearest_free(&self, place: [f64; 3]) -> Option<usize> {
        let mut nearest = None;
        let mut least = f64::INFINITY;
        for (k, sphere) in self.spheres.iter().enumerate() {
            if sphere.is_wall {
                continue;
            }
            let gap = self.distance(&sphere.place, &place) - sphere.radius;
            if gap < least {
                (least, nearest) = (gap, Some(k));
            }
        }
        nearest
    }

    /// The vector between two places, that of the nearest images.
    fn separation(&self, from: &[f64; 3], to: &[f64; 3]) -> [f64; 3] {
        let mut separation: [f64; 3] = std::array::from_fn(|axis| to[axis] - from[axis]);
        for (x, period) in separation.iter_mut().zip(self.periods) {
            if period.is_finite() {
                *x -= period * (*x / period).round();
            }
        }
        separation
    }

    fn distance(&self, from: &[f64; 3], to: &[f64; 3]) -> f64 {
        length(self.separation(from, to))
    }
}

/// The greatest radius (m), 0 of none.
fn greatest_radius(spheres: &[Sphere]) -> f64 {
    let radii = spheres.iter().map(|sphere| sphere.radius);
    radii.fold(0.0, f64::max)
}

/// Paths through a wall.
enum Paths {
    Disks(rings::Rings),
    Spheres(pores::Pores),
}

impl Paths {
    /// Where a grain of this radius (m) passes a wall of these spheres; `None` if it does not.
    fn through(&self, walls: &[bool], radius: f64) -> Option<[f64; 3]> {
        match self {
            Self::Disks(rings) => rings.through(walls, radius),
            Self::Spheres(pores) => pores.through(walls, radius),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sphere(id: u32, place: [f64; 3], radius: f64, is_wall: bool) -> Sphere {
        Sphere {
            id,
            place,
            radius,
            is_wall,
        }
    }

    /// Disks of radius 1 in a row, with gaps of 0.5, without the eighth; and these free ones.
    fn row(free: &[([f64; 2], f64)]) -> Wall {
        let mut spheres = Vec::new();
        for k in (0..16).filter(|k| *k != 7) {
            spheres.push(sphere(k, [2.5 * f64::from(k), 0.0, 1.0], 1.0, true));
        }
        for (k, ([x, z], radius)) in free.iter().enumerate() {
            spheres.push(sphere(100 + k as u32, [*x, 0.0, *z], *radius, false));
        }
        Wall {
            spheres,
            periods: [40.0, f64::INFINITY],
            margin: 1e-3,
        }
    }

    /// Heights of a disk that rests on the two beside the missing one.
    fn over_the_gap(radius: f64) -> f64 {
        1.0 + ((1.0 + radius).powi(2) - 2.5 * 2.5).sqrt()
    }

    /// The widest gap of a row is that of the missing disk: 5 less two radii, for a radius of 1.5.
    #[test]
    fn a_row_has_the_gap_of_a_missing_disk() {
        let wall = row(&[]);
        let walls = vec![true; wall.spheres.len()];
        let paths = wall.paths();
        let place = paths.through(&walls, 1.4999).expect("a hole");
        assert_eq!((place[0], place[2]), (17.5, 1.0));
        assert_eq!(paths.through(&walls, 1.5001), None);
        // The gap over the edge of the period is as wide as the others.
        let mut closed = row(&[([17.5, 1.0], 1.0)]);
        closed.spheres.last_mut().expect("a disk").is_wall = true;
        let walls = vec![true; closed.spheres.len()];
        assert!(closed.paths().through(&walls, 0.2499).is_some());
        assert!(closed.paths().through(&walls, 0.2501).is_none());
    }

    /// A disk greater than the hole is wedged in it and stays; smaller ones that bridge it together
    /// do not, nor one that does not touch the wall. Small ones far away need a hole to leave.
    #[test]
    fn what_is_wedged_closes_a_hole() {
        let far = ([3.0, 6.0], 0.3);
        let wedged = ([17.5, over_the_gap(1.7)], 1.7);
        assert!(row(&[far, wedged]).plugs().is_empty());
        let barely = ([17.5, over_the_gap(1.502)], 1.502);
        assert!(row(&[far, barely]).plugs().is_empty());
        // Squeezed by less than the margin.
        let squeezed = ([17.5, over_the_gap(1.5005)], 1.5005);
        assert_eq!(row(&[far, squeezed]).plugs(), [101]);
        let arch = [([16.4, 2.66], 1.2), ([18.6, 2.66], 1.2)];
        let plugs = row(&[&[far][..], &arch].concat()).plugs();
        assert!(
            !plugs.is_empty() && plugs.iter().all(|id| *id > 100),
            "{plugs:?}"
        );
        let above = ([17.5, 6.0], 1.7);
        // The other one is then wedged.
        assert_eq!(row(&[far, above, arch[0], arch[1]]).plugs(), [102]);
        // Disks that no hole lets through.
        let narrow = [([8.75, 3.0], 0.26), ([21.25, 3.0], 0.26)];
        let mut closed = row(&narrow);
        closed.spheres.push(sphere(7, [17.5, 0.0, 1.0], 1.0, true));
        assert!(closed.plugs().is_empty());
    }

    /// A layer of touching spheres of radius 1 has pores for √2 - 1; one is missing, whose place
    /// has room for 1. The grid takes paths that are narrower by a tenth.
    #[test]
    fn pores_of_a_square_layer() {
        let layer = |missing: bool| {
            let mut spheres = Vec::new();
            for k in (0..36).filter(|k| !missing || *k != 14) {
                let [x, y] = [k / 6, k % 6].map(|k| 2.0 * f64::from(k));
                spheres.push(sphere(k, [x, y, 1.0], 1.0, true));
            }
            spheres.push(sphere(99, [5.0, 5.0, 8.0], 0.4, false));
            Wall {
                spheres,
                periods: [12.0; 2],
                // Without one, rounding decides whether a sphere that rests on others touches them.
                margin: 1e-3,
            }
        };
        for (missing, pore) in [(false, 2f64.sqrt() - 1.0), (true, 1.0)] {
            let wall = layer(missing);
            let walls: Vec<bool> = wall.spheres.iter().map(|s| s.is_wall).collect();
            let paths = wall.paths();
            assert!(paths.through(&walls, 0.999 * pore).is_some());
            assert!(paths.through(&walls, pore + 0.11 * 0.4 + 1e-3).is_none());
        }
        // A sphere over the missing one closes it if it is greater than the pore.
        let with = |radius: f64| {
            let mut wall = layer(true);
            let height = 1.0 + ((1.0 + radius) * (1.0 + radius) - 4.0).max(0.0).sqrt();
            wall.spheres[35] = sphere(99, [4.0, 4.0, height], radius, false);
            wall.spheres.push(sphere(98, [9.0, 9.0, 8.0], 0.6, false));
            wall.plugs()
        };
        assert_eq!(with(1.2), Vec::<u32>::new());
        assert_eq!(with(1.02), [99]);
    }
}
