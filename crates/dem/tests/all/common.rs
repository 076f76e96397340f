//! A gas in a sheared periodic box, dense enough that its grains touch; its laws and random
//! numbers.

use bytemuck::Zeroable;
use gshear_dem::dimension::Dimension;
use gshear_dem::laws::Contact;
use gshear_dem::laws::hooke::Springs;
use gshear_dem::simd::Isa;
use gshear_dem::state::{Cell, GrainState, Masses, Sheared};
use gshear_dem::system::{ListSettings, Setup};

/// Greatest radius (m), and distance between the sites of the lattice on which the gas begins (m).
pub const RADIUS: f64 = 1e-3;
pub const SPACING: f64 = 2.1 * RADIUS;
const DENSITY: f64 = 2500.0;

pub const CONTACT: Contact = Contact {
    friction: 0.5,
    ..Contact::NONE
};

/// Stiff enough for overlaps of at most some percent at 1 m/s: Pa in 2D, N/m in 3D.
pub fn springs<D: Dimension>() -> Springs {
    let normal_stiffness = match D::AXES {
        2 => 1e7,
        _ => 1e4,
    };
    Springs {
        normal_stiffness,
        tangential_stiffness: 0.4 * normal_stiffness,
        density: DENSITY,
        damping_ratio: 0.02,
        sliding_damping: 0.0,
    }
}

/// `side` grains along every axis; the images above move with `velocity` (m/s).
pub fn setup<D: Dimension>(side: usize, velocity: f64, list: ListSettings) -> Setup {
    let length = side as f64 * SPACING;
    Setup {
        isa: Isa::detect(),
        list,
        cell: Cell {
            periods: match D::AXES {
                2 => [length, f64::INFINITY],
                _ => [length; 2],
            },
            sheared: Some(Sheared {
                offset: 0.3 * RADIUS,
                velocity,
                half_velocity: velocity,
                ..Sheared::upright(length)
            }),
        },
        largest_radius: RADIUS,
        mean_diameter: 2.0 * RADIUS,
        masses: Masses::Density(DENSITY),
        step: 2e-7,
        gravity: [0.0; 2],
        typical_force: 1.0,
        threads: 1,
    }
}

/// Uniform random numbers in [-1, 1).
pub fn random(mut seed: u64) -> impl FnMut() -> f64 {
    move || {
        seed = seed
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Grains near the sites of a lattice, flying in all directions; radii are between `smallest` and
/// 1, times [`RADIUS`].
pub fn gas<D: Dimension>(side: usize, smallest: f64, seed: u64) -> Vec<GrainState> {
    let mut random = random(seed);
    let (middle, half) = (0.5 * (1.0 + smallest), 0.5 * (1.0 - smallest));
    let grain = |id: usize| {
        let mut state = GrainState {
            id: id as u32,
            radius: (middle + half * random()) * RADIUS,
            ..GrainState::zeroed()
        };
        for axis in 0..D::AXES {
            let site = (id / side.pow(axis as u32) % side) as f64;
            state.position[axis] = (site + 0.5 + 0.02 * random()) * SPACING;
            state.velocity[axis] = random();
        }
        state
    };
    (0..side.pow(D::AXES as u32)).map(grain).collect()
}
