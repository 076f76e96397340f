//! Grains of a packing that touch each other or flat walls.

use gshear_dem::contact::model::WALL;
use gshear_dem::dimension::{Dimension, Dimensions, Three, Two};
use gshear_dem::neighbour::{self, Cutoff, LocalExtent};
use gshear_dem::simd::Isa;
use gshear_dem::state::{GrainState, Grains, body, length};

use crate::scene::Scene;
use crate::walls::PlaneShear;

/// Two grains that touch.
pub(super) struct GrainContact {
    /// Their places in the list.
    pub(super) grains: [usize; 2],
    /// (m).
    pub(super) overlap: f64,
}

/// A grain that touches a flat wall.
pub(super) struct PlaneContact {
    /// Its place in the list.
    pub(super) grain: usize,
    /// 1 of the upper wall, -1 of the lower one.
    side: f64,
    /// The height of the plane (m).
    pub(super) plane: f64,
    /// (m).
    pub(super) overlap: f64,
}

/// The pairs of grains that touch, but for pairs of wall grains.
pub(super) fn grain_contacts(scene: &Scene, states: &[GrainState]) -> Vec<GrainContact> {
    match scene.dimension {
        Dimensions::Two => grain_contacts_in::<Two>(scene, states),
        Dimensions::Three => grain_contacts_in::<Three>(scene, states),
    }
}

fn grain_contacts_in<D: Dimension>(scene: &Scene, states: &[GrainState]) -> Vec<GrainContact> {
    let sample = &scene.sample;
    let cell = scene.cell();
    let mut grains = Grains::<D>::default();
    grains.replace(states, &scene.materials.masses, scene.time_step.step);
    let extent = LocalExtent::whole(sample.length);
    let cutoff = Cutoff {
        greatest: 2.0 * sample.radius_max,
        skin: 0.0,
    };
    let mut pairs = neighbour::pairs(Isa::detect(), None, &grains, cell, extent, cutoff);
    pairs.sort_unstable_by_key(|pair| pair.grains);
    let mut contacts = Vec::new();
    for pair in pairs {
        let grains = pair.grains.map(|g| g as usize);
        let [a, b] = grains.map(|g| &states[g]);
        let separation = cell.separation::<D>(&a.position, &b.position);
        let overlap = a.radius + b.radius - length(separation);
        if overlap > 0.0 {
            contacts.push(GrainContact { grains, overlap });
        }
    }
    contacts
}

/// The grains that touch flat walls, if there are some.
pub(super) fn plane_contacts(scene: &Scene, grains: &[GrainState]) -> Vec<PlaneContact> {
    let planes = scene.shear().and_then(PlaneShear::planes_of_file);
    let Some([low, high]) = planes else {
        return Vec::new();
    };
    let up = scene.dimension.axes() - 1;
    let mut contacts = Vec::new();
    for (grain, g) in grains.iter().enumerate() {
        for (side, plane) in [(-1.0, low), (1.0, high)] {
            let overlap = g.radius + side * (g.position[up] - plane);
            if overlap > 0.0 {
                contacts.push(PlaneContact {
                    grain,
                    side,
                    plane,
                    overlap,
                });
            }
        }
    }
    contacts
}

/// The force (N; N/m in 2D) upwards on the top wall that the overlaps of grains at rest exert.
pub(crate) fn force_on_top(scene: &Scene, grains: &[GrainState]) -> f64 {
    let up = scene.dimension.axes() - 1;
    let mut sum = 0.0;
    for contact in grain_contacts(scene, grains) {
        let [a, b] = contact.grains.map(|g| &grains[g]);
        let (top, other) = match [a.body == body::TOP, b.body == body::TOP] {
            [true, false] => (a, b),
            [false, true] => (b, a),
            _ => continue,
        };
        let overlap = contact.overlap;
        let force = scene.law.normal_stiffness(a.radius, b.radius, overlap) * overlap;
        let rise = top.position[up] - other.position[up];
        sum += force * rise / (a.radius + b.radius - overlap);
    }
    for contact in plane_contacts(scene, grains) {
        if contact.side > 0.0 {
            let (radius, overlap) = (grains[contact.grain].radius, contact.overlap);
            sum += scene.law.normal_stiffness(radius, WALL * radius, overlap) * overlap;
        }
    }
    sum
}
