//! The second kick of a step is given before grains are read, or by the next step: the bits are the
//! same.

use bytemuck::Zeroable;
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::{GrainWalls, Piston, Slider, Top};
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::Contact;
use gshear_dem::laws::hertz::{Hertz, Spheres};
use gshear_dem::laws::hooke::{Hooke, Springs};
use gshear_dem::observe;
use gshear_dem::protocol::Protocol;
use gshear_dem::state::{Cell, GrainState, Masses, body};
use gshear_dem::step::{StepRequest, advance, initial_forces};
use gshear_dem::system::{ListSettings, Setup, System};

const RADIUS: f64 = 1e-3;
const DENSITY: f64 = 2500.0;
/// Grains along every periodic axis, and layers.
const SIDE: usize = 8;
const LAYERS: usize = 5;
const SPACING: f64 = 1.98 * RADIUS;
const STEPS: u64 = 300;

/// An access to the grains during a run, before the end.
type Access<D> = fn(&mut System<D>, &GrainWalls);

/// A pressed layer between a fixed wall and one that a spring pulls along: its grains move, collide
/// and cross the periodic boundary. Returns the digest of grains, contacts and walls.
fn run<D: Dimension>(law: &dyn PairForce<D>, step: f64, every: u64, access: Access<D>) -> String {
    let length = SIDE as f64 * SPACING;
    let width = match D::AXES {
        2 => f64::INFINITY,
        _ => length,
    };
    let setup = Setup {
        list: ListSettings {
            skin: Some(0.1),
            rebuild_every: 7,
        },
        mean_diameter: 2.0 * RADIUS,
        ..Setup::new(
            Cell::between_walls([length, width]),
            1.01 * RADIUS,
            Masses::Density(DENSITY),
            step,
        )
    };
    let mass = DENSITY * D::volume(RADIUS);
    let per_layer = SIDE.pow(D::UP as u32);
    let area = SPACING.powi(D::UP as i32) * per_layer as f64;
    let piston = Piston {
        height: (LAYERS - 1) as f64 * SPACING,
        velocity: 0.0,
        acceleration: 0.0,
        mass: per_layer as f64 * mass,
        load: 1e4 * area,
    };
    let slider = Slider::new(
        Protocol::new(step, [(0.5, STEPS)]),
        Some(1e-3 * per_layer as f64 * mass / (step * step)),
    );
    let mut walls = GrainWalls::new(Top::new(piston, slider, None, true));
    let mut system = System::new(&Solo, setup).expect("one rank");
    system
        .replace(&Solo, law, &mut walls, grains::<D>(), Vec::new())
        .expect("a list");
    initial_forces(&Solo, &mut system, law, &mut walls, None).expect("sound forces");
    for k in 1..=STEPS {
        advance(&Solo, &mut system, law, &mut walls, StepRequest::default()).expect("sound");
        if every > 0 && k % every == 0 {
            access(&mut system, &walls);
        }
    }
    assert!(system.list.rebuilds > STEPS / 8);
    assert!(walls.motion.slider.state.displacement > 0.0 && walls.motion.piston.velocity != 0.0);
    let state = walls.motion.state();
    observe::digest(&Solo, &mut system, law, bytemuck::cast_slice(&state), STEPS)
}

fn grains<D: Dimension>() -> Vec<GrainState> {
    let mut random = crate::common::random(5);
    let per_layer = SIDE.pow(D::UP as u32);
    let grain = |id: usize| {
        let layer = id / per_layer;
        let body = match layer {
            0 => body::BOTTOM,
            k if k == LAYERS - 1 => body::TOP,
            _ => body::FREE,
        };
        let mut state = GrainState {
            id: id as u32,
            body,
            radius: RADIUS * (1.0 + 0.01 * random()),
            ..GrainState::zeroed()
        };
        for axis in 0..D::UP {
            let place = (id / SIDE.pow(axis as u32) % SIDE) as f64;
            state.position[axis] = (place + 0.1 + 0.005 * random()) * SPACING;
        }
        state.position[D::UP] = layer as f64 * SPACING;
        if body == body::FREE {
            for axis in 0..D::AXES {
                state.velocity[axis] = 0.3 * random();
            }
            for axis in 3 - D::SPINS..3 {
                state.angular_velocity[axis] = 100.0 * random();
            }
        }
        state
    };
    (0..LAYERS * per_layer).map(grain).collect()
}

/// The result of an immediate kick: v(t+½Δt) + ½Δt F/m, and likewise for spins; the drive sets the
/// velocities of the walls.
fn at_the_full_step<D: Dimension>(system: &mut System<D>, walls: &GrainWalls) {
    let grains = system.grains();
    let bits = |values: &[f64]| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    let mut moving = 0;
    for g in 0..grains.owned {
        let (r, force, [linear, angular]) =
            (grains.fields(g), &grains.force[g], grains.half_kick[g]);
        let kicked = |at: usize, of: usize, count: usize, kick: f64| -> Vec<f64> {
            let kicked = (0..count).map(|k| r[at + k] + kick * force[of + k]);
            kicked.collect()
        };
        let mut velocity = kicked(D::HALF_VELOCITY, 0, D::AXES, linear);
        if grains.body[g] == body::TOP {
            velocity[0] = walls.motion.slider.state.velocity;
            velocity[D::UP] = walls.motion.piston.velocity;
        }
        let spin = kicked(D::HALF_SPIN, D::TORQUE, D::SPINS, angular);
        assert_eq!(bits(&r[D::VELOCITY..][..D::AXES]), bits(&velocity));
        assert_eq!(bits(&r[D::SPIN..][..D::SPINS]), bits(&spin));
        moving += usize::from(grains.body[g] == body::FREE && force[D::UP] != 0.0);
    }
    assert!(moving > 0, "no free grain is pushed");
}

fn access_changes_nothing<D: Dimension>(law: &dyn PairForce<D>, step: f64) {
    let never = run(law, step, 0, at_the_full_step);
    for every in [1, 3, STEPS] {
        assert_eq!(run(law, step, every, at_the_full_step), never, "{every}");
    }
    // Every accessor.
    let accessors: [Access<D>; 4] = [
        |system, _| drop(system.grain_states()),
        |system, _| {
            system.grains_mut();
        },
        |system, _| {
            system.grains_and_contacts();
        },
        |system, _| {
            system.grains();
            system.grains();
        },
    ];
    for access in accessors {
        assert_eq!(run(law, step, 2, access), never);
    }
}

const CONTACT: Contact = Contact {
    friction: 0.5,
    rolling_friction: 0.1,
    rolling_damping_ratio: 0.2,
    ..Contact::NONE
};

#[test]
fn of_disks() {
    let springs = Springs {
        normal_stiffness: 1e7,
        tangential_stiffness: 4e6,
        density: DENSITY,
        damping_ratio: 0.1,
        sliding_damping: 0.0,
    };
    let mass = DENSITY * Two::volume(RADIUS);
    let step = 0.1 * (mass / springs.normal_stiffness).sqrt();
    access_changes_nothing(&Hooke::<Two, true, true>::new(&springs, &CONTACT), step);
}

#[test]
fn of_spheres() {
    let spheres = Spheres {
        young_modulus: 1e9,
        poisson_ratio: 0.2,
        density: DENSITY,
        normal_damping: 1e5,
        tangential_damping: 5e4,
    };
    let mass = DENSITY * Three::volume(RADIUS);
    let stiffness = spheres.normal_stiffness() * (0.5 * RADIUS * 0.02 * RADIUS).sqrt();
    let step = 0.1 * (mass / stiffness).sqrt();
    access_changes_nothing(&Hertz::<true>::new(&spheres, &CONTACT), step);
}
