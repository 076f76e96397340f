//! Synthetic packings for the tests of the analysis.

use nalgebra::{Matrix2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use bytemuck::Zeroable;
use gshear_dem::dimension::Dimensions;
use gshear_dem::state::{Cell, ContactSample, Frame, GrainConstants, GrainSample};

/// Returns free grains of the given radii.
pub fn grains_of(radius: &[f64]) -> GrainConstants {
    let n = radius.len();
    GrainConstants {
        radius: radius.to_vec(),
        body: vec![0; n],
        mass: vec![1.0; n],
    }
}

/// Returns a contact of i and j without force.
pub fn contact(i: u32, j: u32) -> ContactSample {
    ContactSample {
        i: i.min(j),
        j: i.max(j),
        ..ContactSample::zeroed()
    }
}

/// Returns a contact of i and j with these forces.
pub fn pushed(i: u32, j: u32, normal_force: f64, tangential_force: f64) -> ContactSample {
    ContactSample {
        normal_force,
        tangential_force: [tangential_force, 0.0, 0.0],
        ..contact(i, j)
    }
}

/// Returns a frame of disks between walls at these places, with these contacts; `length`: L_x.
pub fn touching(length: f64, places: &[[f64; 2]], contacts: Vec<ContactSample>) -> Frame {
    let grain = |[x, y]: &[f64; 2]| GrainSample {
        position: [*x, *y, 0.0],
        ..GrainSample::zeroed()
    };
    Frame {
        dimension: Dimensions::Two,
        cell: Cell::between_walls([length, f64::INFINITY]),
        step: 0,
        time: 0.0,
        grains: places.iter().map(grain).collect(),
        contacts,
        wall_contacts: Vec::new(),
    }
}

/// Returns contacts that leave no rattler among n ≥ 5 grains.
pub(crate) fn enough_contacts(n: usize) -> Vec<ContactSample> {
    let n = n as u32;
    (0..n)
        .flat_map(|i| [contact(i, (i + 1) % n), contact(i, (i + 2) % n)])
        .collect()
}

/// Returns points drawn uniformly from `width` × `height` around the periodic boundary x = 0, not
/// wrapped.
pub fn scattered(seed: u64, n: usize, width: f64, height: f64) -> Vec<Vector2<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut uniform = |extent: f64| extent * (random.random::<f64>() - 0.5);
    let mut point = |_| Vector2::new(uniform(width), uniform(height));
    (0..n).map(&mut point).collect()
}

/// Returns F r for every point r.
pub fn mapped(points: &[Vector2<f64>], map: Matrix2<f64>) -> Vec<Vector2<f64>> {
    points.iter().map(|r| map * r).collect()
}

/// Returns a frame of these points, wrapped into [0, L_x), without rattlers.
pub fn frame(length: f64, points: &[Vector2<f64>]) -> Frame {
    let place = |r: &Vector2<f64>| [r.x.rem_euclid(length), r.y];
    let places: Vec<[f64; 2]> = points.iter().map(place).collect();
    let mut frame = touching(length, &places, enough_contacts(points.len()));
    for (grain, r) in frame.grains.iter_mut().zip(points) {
        grain.image[0] = r.x.div_euclid(length) as i64;
    }
    frame
}
