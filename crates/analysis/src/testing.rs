//! Synthetic packings for the tests of the analysis.

use nalgebra::{Matrix2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use gshear_dem::state::{ContactSample, Disks, Frame};

/// Returns free grains of the given radii in a cell of length L_x.
pub fn grains_in(length: f64, radius: &[f64]) -> Disks {
    let n = radius.len();
    Disks {
        radius: radius.to_vec(),
        body: vec![0; n],
        mass: vec![1.0; n],
        length,
    }
}

/// Returns a contact of i and j without force.
pub fn contact(i: u32, j: u32) -> ContactSample {
    ContactSample {
        i: i.min(j),
        j: i.max(j),
        ..bytemuck::Zeroable::zeroed()
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

/// Returns a frame of 2D grains at these places, with these contacts.
pub fn touching(position: Vec<[f64; 2]>, contacts: Vec<ContactSample>) -> Frame {
    Frame {
        position,
        contacts,
        ..Frame::default()
    }
}

/// Returns contacts that leave no rattler among n ≥ 5 grains.
pub fn enough_contacts(n: usize) -> Vec<ContactSample> {
    let n = n as u32;
    let of = |i: u32| [contact(i, (i + 1) % n), contact(i, (i + 2) % n)];
    (0..n).flat_map(of).collect()
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
pub fn frame(grains: &Disks, points: &[Vector2<f64>]) -> Frame {
    let place = |r: &Vector2<f64>| [r.x.rem_euclid(grains.length), r.y];
    let image = |r: &Vector2<f64>| r.x.div_euclid(grains.length) as i64;
    let position = points.iter().map(place).collect();
    Frame {
        image: points.iter().map(image).collect(),
        ..touching(position, enough_contacts(points.len()))
    }
}
