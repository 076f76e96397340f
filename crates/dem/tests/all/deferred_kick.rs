//! The second kick of a step is given before grains are read, or by the next step: the bits are the
//! same.

use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::drive::{GrainWalls, Slider, Top};
use gshear_dem::laws::hertz::{self, Spheres};
use gshear_dem::laws::hooke::{self, Springs};
use gshear_dem::laws::{Contact, Law, LawSpace};
use gshear_dem::protocol::Protocol;
use gshear_dem::state::{Cell, GrainState, body};
use gshear_dem::system::{ListSettings, Setup, System};

use crate::common::{RADIUS, Rig, elastic, layers, periods, piston, random, undamped};

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
fn run<D: LawSpace>(law: &Law, step: f64, every: u64, access: Access<D>) -> String {
    let length = SIDE as f64 * SPACING;
    let cell = Cell::between_walls(periods::<D>(length, length));
    let setup = Setup {
        list: ListSettings {
            skin: Some(0.1),
            rebuild_every: 7,
        },
        mean_diameter: 2.0 * RADIUS,
        ..Setup::new(cell, 1.01 * RADIUS, law.masses(), step)
    };
    let per_layer = SIDE.pow(D::UP as u32);
    let mass = per_layer as f64 * DENSITY * D::volume(RADIUS);
    let area = SPACING.powi(D::UP as i32) * per_layer as f64;
    let protocol = Protocol::new(step, [(0.5, STEPS)]);
    let slider = Slider::new(protocol, Some(1e-3 * mass / (step * step)));
    let piston = piston((LAYERS - 1) as f64 * SPACING, mass, 1e4 * area);
    let walls = GrainWalls::new(Top::new(piston, slider, None, true));
    let law = D::pair_force(law, &CONTACT).expect("a law of this dimension");
    let mut rig = Rig::new(setup, law, walls, (grains::<D>(), Vec::new()));
    for k in 1..=STEPS {
        rig.step();
        if every > 0 && k % every == 0 {
            access(&mut rig.system, &rig.walls);
        }
    }
    let motion = &rig.walls.motion;
    assert!(rig.system.list.rebuilds > STEPS / 8);
    assert!(motion.slider.state.displacement > 0.0 && motion.piston.velocity != 0.0);
    let state = motion.state();
    rig.digest(&state)
}

fn grains<D: Dimension>() -> Vec<GrainState> {
    let mut random = random(5);
    layers::<D>((SIDE, LAYERS), SPACING, |grain| {
        grain.radius *= 1.0 + 0.01 * random();
        for axis in 0..D::UP {
            grain.position[axis] += 0.005 * random() * SPACING;
        }
        if grain.body == body::FREE {
            for axis in 0..D::AXES {
                grain.velocity[axis] = 0.3 * random();
            }
            for axis in 3 - D::SPINS..3 {
                grain.angular_velocity[axis] = 100.0 * random();
            }
        }
    })
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

/// `stiffness` (N/m; Pa in 2D): of a contact.
fn access_changes_nothing<D: LawSpace>(law: &Law, stiffness: f64) {
    let step = 0.1 * (DENSITY * D::volume(RADIUS) / stiffness).sqrt();
    let never = run::<D>(law, step, 0, at_the_full_step);
    for every in [1, 3, STEPS] {
        assert_eq!(
            run(law, step, every, at_the_full_step::<D>),
            never,
            "{every}"
        );
    }
    // Every accessor.
    let accessors: [Access<D>; 4] = [
        |system, _| drop(system.grain_states()),
        |system, _| _ = system.grains_mut(),
        |system, _| _ = system.grains_and_contacts(),
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
        damping_ratio: 0.1,
        ..elastic(1e7, 4e6, DENSITY)
    };
    access_changes_nothing::<Two>(&Law::of(&hooke::KIND, springs), springs.normal_stiffness);
}

#[test]
fn of_spheres() {
    let spheres = Spheres {
        normal_damping: 1e5,
        tangential_damping: 5e4,
        ..undamped(1e9, 0.2, DENSITY)
    };
    let stiffness = spheres.normal_stiffness() * (0.5 * RADIUS * 0.02 * RADIUS).sqrt();
    access_changes_nothing::<Three>(&Law::of(&hertz::KIND, spheres), stiffness);
}
