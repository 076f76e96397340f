//! Grains on one rank with their law and walls, and a gas in a sheared periodic box, dense enough
//! that its grains touch.

use bytemuck::Zeroable;
use gshear_dem::budget::{EnergyBalance, SampleState};
use gshear_dem::contact::{Blocks, CARRY, ContactLaw, PairMotion, Response, dissipation};
use gshear_dem::dimension::Dimension;
use gshear_dem::domain::{Exchange, Solo};
use gshear_dem::drive::{Drive, NoWalls, Piston};
use gshear_dem::kernel::{ContactForces, PairForce};
use gshear_dem::laws::hertz::Spheres;
use gshear_dem::laws::hooke::{self, Springs};
use gshear_dem::laws::{Contact, Law, LawSpace};
use gshear_dem::observe;
use gshear_dem::simd::{LANES, Lanes, Lanes16, Portable, PortableToken};
use gshear_dem::state::{Cell, ContactState, GrainState, Masses, Sheared, body};
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

/// a + c b.
pub fn plus(a: Vector, c: f64, b: Vector) -> Vector {
    std::array::from_fn(|k| a[k] + c * b[k])
}

/// Fails unless `errors`, of runs with Δt halved from each to the next, fall by this order.
pub fn assert_order(of: &str, errors: &[f64], order: std::ops::RangeInclusive<f64>) {
    for pair in errors.windows(2) {
        let found = (pair[0] / pair[1]).log2();
        assert!(order.contains(&found), "{of}: order {found} of {errors:?}");
    }
}

/// y after so many steps of h of the Runge–Kutta method of fourth order.
pub fn runge_kutta<const N: usize>(
    mut y: [f64; N],
    (steps, h): (u32, f64),
    rate: impl Fn(f64, [f64; N]) -> [f64; N],
) -> [f64; N] {
    let add = |y: [f64; N], by: f64, d: [f64; N]| std::array::from_fn(|i| y[i] + by * d[i]);
    for step in 0..steps {
        let t = f64::from(step) * h;
        let k1 = rate(t, y);
        let k2 = rate(t + 0.5 * h, add(y, 0.5 * h, k1));
        let k3 = rate(t + 0.5 * h, add(y, 0.5 * h, k2));
        let k4 = rate(t + h, add(y, h, k3));
        for i in 0..N {
            y[i] += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
        }
    }
    y
}

/// Contacts with this μ and nothing else.
pub fn frictional(friction: f64) -> Contact {
    Contact {
        friction,
        ..Contact::NONE
    }
}

/// Springs without dampers.
pub const fn elastic(normal_stiffness: f64, tangential_stiffness: f64, density: f64) -> Springs {
    Springs {
        normal_stiffness,
        tangential_stiffness,
        density,
        damping_ratio: 0.0,
        sliding_damping: 0.0,
        ageing: None,
    }
}

/// Spheres without dampers.
pub const fn undamped(young_modulus: f64, poisson_ratio: f64, density: f64) -> Spheres {
    Spheres {
        remembers_force: false,
        ageing: None,
        young_modulus,
        poisson_ratio,
        density,
        normal_damping: 0.0,
        tangential_damping: 0.0,
    }
}

/// The forces of springs.
pub fn hooke<D: LawSpace>(springs: Springs, contact: &Contact) -> Box<dyn PairForce<D>> {
    D::pair_force(&Law::of(&hooke::KIND, springs), contact).expect("a law of both dimensions")
}

/// What a law makes of one contact.
pub struct Evaluated {
    pub normal: f64,
    pub tangential: Vector,
    pub history: Vector,
    pub slides: bool,
    pub dissipated: [f64; dissipation::COUNTS],
}

/// Evaluates a law once, of two grains of these radii.
pub fn evaluate<C: ContactLaw>(
    law: &C,
    radii: [f64; 2],
    motion: &PairMotion,
    history: Vector,
) -> Evaluated {
    let [r_i, r_j] = radii.map(|r| Portable::splat(PortableToken, r));
    let mut parameters = vec![Lanes16::ZERO; C::PARAMETERS];
    law.parameters(PortableToken, r_i, r_j, &mut parameters);
    let mut lanes = history.map(splat);
    let mut response = [Response::default()];
    law.evaluate::<Portable, true>(
        PortableToken,
        &mut Blocks {
            parameters: &parameters,
            history: &mut lanes[..C::HISTORY],
            per_step: 0.0,
            turning: &mut [],
            motion: std::slice::from_ref(motion),
            carry: &mut [[Lanes16::ZERO; CARRY]],
            response: &mut response,
            jumps: &[],
        },
    );
    let [of] = response;
    let mut tangential = of.tangential.map(|lanes| lanes.0[3]);
    let mut history = lanes.map(|lanes| lanes.0[3]);
    tangential[C::HISTORY..].fill(0.0);
    history[C::HISTORY..].fill(0.0);
    Evaluated {
        normal: of.normal.0[3],
        tangential,
        history,
        slides: of.sliding != 0,
        dissipated: of.dissipated.map(|lanes| lanes.0[3]),
    }
}

pub fn splat(value: f64) -> Lanes16 {
    Lanes16([value; LANES])
}

/// A top that does not move yet.
pub fn piston(height: f64, mass: f64, load: f64) -> Piston {
    Piston {
        height,
        velocity: 0.0,
        acceleration: 0.0,
        mass,
        load,
    }
}

/// The lengths of a cell along its periodic axes but that of the walls' normals.
pub fn periods<D: Dimension>(length: f64, width: f64) -> [f64; 2] {
    [length, if D::AXES == 2 { f64::INFINITY } else { width }]
}

/// Layers of `side` grains along every other axis, the lowest and the highest of walls, in the
/// order of their ids.
pub fn layers<D: Dimension>(
    (side, layers): (usize, usize),
    spacing: f64,
    mut change: impl FnMut(&mut GrainState),
) -> Vec<GrainState> {
    let per_layer = side.pow(D::UP as u32);
    let grain = |id: usize| {
        let layer = id / per_layer;
        let mut state = GrainState {
            id: id as u32,
            body: match layer {
                0 => body::BOTTOM,
                k if k == layers - 1 => body::TOP,
                _ => body::FREE,
            },
            radius: RADIUS,
            ..GrainState::zeroed()
        };
        for axis in 0..D::UP {
            let place = (id / side.pow(axis as u32) % side) as f64;
            state.position[axis] = (place + 0.1) * spacing;
        }
        state.position[D::UP] = layer as f64 * spacing;
        change(&mut state);
        state
    };
    (0..layers * per_layer).map(grain).collect()
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
        state: (Vec<GrainState>, Vec<ContactState>),
    ) -> Self {
        Self::on(&Solo, setup, law, walls, state)
    }

    /// The part of a rank.
    pub fn on(
        exchange: &dyn Exchange,
        setup: Setup,
        law: Box<dyn PairForce<D>>,
        mut walls: W,
        (grains, contacts): (Vec<GrainState>, Vec<ContactState>),
    ) -> Self {
        let mut system = System::new(exchange, setup).expect("wide slabs");
        let (force, drive) = (law.as_ref(), &mut walls);
        let made = system.replace(exchange, force, drive, grains, contacts);
        made.expect("a list");
        let mut samples = ContactForces::default();
        initial_forces(exchange, &mut system, force, drive, Some(&mut samples)).expect("sound");
        Self {
            system,
            law,
            walls,
            samples,
        }
    }

    /// Steps that record the contact forces.
    pub fn advance(&mut self, steps: usize) {
        for _ in 0..steps {
            let request = StepRequest::sampled(&mut self.samples);
            let (law, walls) = (self.law.as_ref(), &mut self.walls);
            advance(&Solo, &mut self.system, law, walls, request).expect("sound");
        }
    }

    /// A step without samples.
    pub fn step(&mut self) {
        let (law, walls) = (self.law.as_ref(), &mut self.walls);
        let request = StepRequest::default();
        advance(&Solo, &mut self.system, law, walls, request).expect("sound");
    }

    /// The balance of the energy budget, and the kinetic energy (J; J/m in 2D), in a cell without
    /// walls and gravity.
    pub fn balance(&mut self) -> (EnergyBalance, f64) {
        let kinetic = self.system.grain_states().into_iter().map(|g| {
            let rim = g.radius * g.radius * dot(g.angular_velocity, g.angular_velocity);
            let mass = self.system.masses.of(g.material, D::volume(g.radius));
            0.5 * mass * (dot(g.velocity, g.velocity) + D::INERTIA * rim)
        });
        let kinetic: f64 = kinetic.sum();
        let mut budget = self.system.budget.take().expect("a budget");
        let sample = SampleState {
            contacts: &self.system.contacts,
            overlap: &self.samples.overlap,
            load: 0.0,
            height: 0.0,
            kinetic,
            potential: 0.0,
            gravity: [0.0; 2],
        };
        let entry = budget.balance(&Solo, self.system.isa, self.law.as_ref(), sample);
        self.system.budget = Some(budget);
        (entry, kinetic)
    }

    /// The digest of the state, and of this of the walls.
    pub fn digest(&mut self, walls: &[f64]) -> String {
        let (walls, steps) = (bytemuck::cast_slice(walls), self.system.steps);
        observe::digest(&Solo, &mut self.system, self.law.as_ref(), walls, steps)
    }

    /// F_n and F_t of the contact, if two grains touch.
    pub fn contact_force(&self) -> Option<(f64, Vector)> {
        let at = self.system.contacts.touching().next()?;
        let mut tangential = self.samples.tangential[at.block].map(|lanes| lanes.0[at.lane]);
        tangential[D::SPINS..].fill(0.0);
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
            let mut position = place.map(|x| 15.0 * largest + x);
            position[D::AXES..].fill(0.0);
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

    /// The record of a grain.
    pub fn fields_mut(&mut self, id: u32) -> &mut [f64] {
        let grains = self.system.grains_mut();
        let at = grains.id.iter().position(|of| *of == id);
        grains.fields_mut(at.expect("one of the two"))
    }

    /// The two grains.
    pub fn ends(&mut self) -> [GrainState; 2] {
        self.system.grain_states().try_into().expect("two grains")
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
        damping_ratio: 0.02,
        ..elastic(normal_stiffness, 0.4 * normal_stiffness, DENSITY)
    }
}

/// The forces in the gas.
pub fn gas_law<D: LawSpace>() -> Box<dyn PairForce<D>> {
    hooke(springs::<D>(), &CONTACT)
}

/// `side` grains along every axis; the images above move with `velocity` (m/s).
pub fn setup<D: Dimension>(side: usize, velocity: f64, (skin, rebuild_every): (f64, u64)) -> Setup {
    let length = side as f64 * SPACING;
    let cell = Cell {
        periods: periods::<D>(length, length),
        sheared: Some(Sheared {
            offset: 0.3 * RADIUS,
            velocity,
            half_velocity: velocity,
            ..Sheared::upright(length)
        }),
    };
    let list = ListSettings {
        skin: Some(skin),
        rebuild_every,
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
