//! Blocks of pairs that cannot touch yet are left out: no first touch is missed, however long the
//! list lives.

use bytemuck::Zeroable;
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::NoWalls;
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::Contact;
use gshear_dem::laws::hooke::{Hooke, Springs};
use gshear_dem::observe;
use gshear_dem::simd::Isa;
use gshear_dem::state::{Cell, GrainState, Masses, Sheared};
use gshear_dem::step::{StepRequest, advance, forces, initial_forces};
use gshear_dem::system::{ListSettings, Setup, System};

const RADIUS: f64 = 1e-3;
const SPACING: f64 = 2.1 * RADIUS;
const STEPS: u64 = 3000;

/// What the grains do at first.
#[derive(Clone, Copy, PartialEq)]
enum Start {
    /// They fly in all directions, and the images above move.
    Gas,
    /// They meet head-on along x, all with the greatest speed, so that they touch as early as
    /// the bound of their ways allows.
    HeadOn,
}

/// Grains in a periodic box, with lists that live for at most `every` steps.
fn begin<D: Dimension>(law: &dyn PairForce<D>, side: usize, start: Start, every: u64) -> System<D> {
    let length = side as f64 * SPACING;
    let cell = Cell {
        periods: match D::AXES {
            2 => [length, f64::INFINITY],
            _ => [length; 2],
        },
        sheared: Some(Sheared {
            offset: 0.3 * RADIUS,
            velocity: match start {
                Start::Gas => 0.2,
                Start::HeadOn => 0.0,
            },
            ..Sheared::upright(length)
        }),
    };
    let setup = Setup {
        isa: Isa::detect(),
        list: ListSettings {
            skin: Some(0.3),
            rebuild_every: every,
        },
        cell,
        largest_radius: RADIUS,
        mean_diameter: 2.0 * RADIUS,
        masses: Masses::Density(2500.0),
        step: 2e-7,
        gravity: 0.0,
        typical_force: 1.0,
        threads: 1,
    };
    let mut seed = 11u64;
    let mut random = || {
        seed = seed
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    let grain = |id: usize| {
        let mut state = GrainState {
            id: id as u32,
            radius: RADIUS,
            ..GrainState::zeroed()
        };
        for axis in 0..D::AXES {
            let place = (id / side.pow(axis as u32) % side) as f64;
            state.position[axis] = (place + 0.5 + 0.02 * random()) * SPACING;
            state.velocity[axis] = random();
        }
        if start == Start::HeadOn {
            state.velocity = [[1.0, -1.0][id % side % 2], 0.0, 0.0];
        }
        state
    };
    let grains: Vec<GrainState> = (0..side.pow(D::AXES as u32)).map(grain).collect();
    let mut system = System::new(&Solo, setup).expect("one rank");
    let walls = &mut NoWalls;
    let made = system.replace(&Solo, law, walls, grains, Vec::new());
    made.expect("a list");
    initial_forces(&Solo, &mut system, law, walls, None).expect("sound forces");
    system
}

/// Returns the digest after [`STEPS`], the number of lists, and in how many steps blocks slept.
fn run<D: Dimension>(
    law: &dyn PairForce<D>,
    side: usize,
    start: Start,
    every: u64,
) -> (String, u64, u64) {
    let mut system = begin(law, side, start, every);
    let walls = &mut NoWalls;
    let mut slept = 0;
    for _ in 0..STEPS {
        advance(&Solo, &mut system, law, walls, StepRequest::default()).expect("sound");
        slept += u64::from(system.contacts.asleep_until.iter().any(|x| *x > 0.0));
    }
    assert!(system.contacts.touching().count() > 10, "too few touch");
    let lists = system.list.rebuilds;
    (
        observe::digest(&Solo, &mut system, law, &[], STEPS),
        lists,
        slept,
    )
}

fn nothing_is_missed<D: Dimension>(law: &dyn PairForce<D>, side: usize) {
    for start in [Start::Gas, Start::HeadOn] {
        let (expected, lists, _) = run(law, side, start, 1);
        assert!(lists >= STEPS);
        let (digest, lists, slept) = run(law, side, start, 0);
        assert!(lists < 60 && slept > STEPS / 2, "{lists} lists, {slept}");
        assert_eq!(digest, expected);
    }
}

/// Forces at places to which grains were put, as in a quasi-static step, wake what slept.
#[test]
fn a_grain_that_is_put_elsewhere_wakes_its_block() {
    let law = Hooke::<Two, true, false>::new(&SPRINGS, &CONTACT);
    let run = |rebuilds: bool| {
        let mut system = begin::<Two>(&law, 20, Start::HeadOn, 0);
        let walls = &mut NoWalls;
        for _ in 0..10 {
            advance(&Solo, &mut system, &law, walls, StepRequest::default()).expect("sound");
        }
        for g in 0..400 {
            let away = if g % 2 == 0 { 0.06 } else { -0.06 };
            system.grains_mut().fields_mut(g)[0] += away * RADIUS;
        }
        let step = system.step;
        assert!(forces(&Solo, &mut system, &law, walls, step, None).is_none());
        assert!(system.contacts.touching().count() > 150);
        if rebuilds {
            system.rebuild(&Solo, &law, walls).expect("a list");
        }
        for _ in 0..20 {
            advance(&Solo, &mut system, &law, walls, StepRequest::default()).expect("sound");
        }
        observe::digest(&Solo, &mut system, &law, &[], 30)
    };
    assert_eq!(run(false), run(true));
}

const SPRINGS: Springs = Springs {
    normal_stiffness: 1e7,
    tangential_stiffness: 4e6,
    density: 2500.0,
    damping_ratio: 0.02,
};

const CONTACT: Contact = Contact {
    friction: 0.5,
    rolling_friction: 0.0,
    rolling_damping_ratio: 0.0,
};

#[test]
fn of_disks() {
    nothing_is_missed(&Hooke::<Two, true, false>::new(&SPRINGS, &CONTACT), 20);
}

#[test]
fn of_spheres() {
    let springs = Springs {
        normal_stiffness: 1e4,
        tangential_stiffness: 4e3,
        ..SPRINGS
    };
    nothing_is_missed(&Hooke::<Three, true, false>::new(&springs, &CONTACT), 8);
}
