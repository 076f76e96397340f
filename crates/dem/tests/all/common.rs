//! Grains on one rank with their law and walls, and a gas in a sheared periodic box, dense enough
//! that its grains touch.

use bytemuck::Zeroable;
use gshear_dem::dimension::Dimension;
use gshear_dem::domain::Solo;
use gshear_dem::drive::{Drive, NoWalls};
use gshear_dem::kernel::{ContactForces, PairForce};
use gshear_dem::laws::Contact;
use gshear_dem::laws::hooke::Springs;
use gshear_dem::state::{Cell, ContactState, GrainState, Masses, Sheared};
use gshear_dem::step::{StepRequest, advance, initial_forces};
use gshear_dem::system::{ListSettings, Setup, System};

pub type Vector = [f64; 3];

pub fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub fn norm(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

pub fn cross(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|k| a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3])
}

pub fn minus(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|k| a[k] - b[k])
}

/// Contacts with this μ and nothing else.
pub fn frictional(friction: f64) -> Contact {
    Contact {
        friction,
        ..Contact::NONE
    }
}

/// Grains on one rank, and the forces of the last step.
pub struct Rig<D: Dimension, W = NoWalls> {
    pub system: System<D>,
    pub law: Box<dyn PairForce<D>>,
    pub walls: W,
    pub samples: ContactForces,
}

impl<D: Dimension, W: Drive<D>> Rig<D, W> {
    pub fn new(
        setup: Setup,
        law: Box<dyn PairForce<D>>,
        walls: W,
        (grains, contacts): (Vec<GrainState>, Vec<ContactState>),
    ) -> Self {
        let system = System::new(&Solo, setup).expect("one rank");
        let mut rig = Self {
            system,
            law,
            walls,
            samples: ContactForces::default(),
        };
        let (law, walls) = (rig.law.as_ref(), &mut rig.walls);
        let made = rig.system.replace(&Solo, law, walls, grains, contacts);
        made.expect("a list");
        let samples = Some(&mut rig.samples);
        initial_forces(&Solo, &mut rig.system, law, walls, samples).expect("sound");
        rig
    }

    pub fn advance(&mut self) {
        let request = StepRequest::sampled(&mut self.samples);
        let (law, walls) = (self.law.as_ref(), &mut self.walls);
        advance(&Solo, &mut self.system, law, walls, request).expect("sound");
    }

    /// F_n and F_t of the contact, if two grains touch.
    pub fn contact_force(&self) -> Option<(f64, Vector)> {
        let at = self.system.contacts.touching().next()?;
        let mut tangential = [0.0; 3];
        for (f, lanes) in tangential[..D::SPINS]
            .iter_mut()
            .zip(&self.samples.tangential[at.block])
        {
            *f = lanes.0[at.lane];
        }
        Some((self.samples.normal[at.block].0[at.lane], tangential))
    }
}

impl<D: Dimension> Rig<D> {
    /// Two grains in a wide cell: their radii, places about its middle, velocities and spins.
    pub fn couple(
        law: Box<dyn PairForce<D>>,
        (masses, step): (Masses, f64),
        radii: [f64; 2],
        of: [[Vector; 3]; 2],
        contacts: Vec<ContactState>,
    ) -> Self {
        let largest = radii[0].max(radii[1]);
        let grain = |id: usize| {
            let [place, velocity, angular_velocity] = of[id];
            let mut position = [0.0; 3];
            for (axis, x) in position[..D::AXES].iter_mut().enumerate() {
                *x = 15.0 * largest + place[axis];
            }
            GrainState {
                id: id as u32,
                radius: radii[id],
                position,
                velocity,
                angular_velocity,
                ..GrainState::zeroed()
            }
        };
        let cell = Cell::between_walls([30.0 * largest; 2]);
        let setup = Setup::new(cell, largest, masses, step).with_skin(0.1);
        Self::new(setup, law, NoWalls, (vec![grain(0), grain(1)], contacts))
    }
}

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
    let cell = Cell {
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
    };
    Setup {
        list,
        ..Setup::new(cell, RADIUS, Masses::Density(DENSITY), 2e-7)
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
