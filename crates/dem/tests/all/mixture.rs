//! Laws of several materials: equal ones are one, and unlike pairs have their own masses.

use bytemuck::Zeroable;
use gshear_dem::dimension::{Three, Two};
use gshear_dem::drive::NoWalls;
use gshear_dem::laws::damping::damping_ratio;
use gshear_dem::laws::mixture::pair_force;
use gshear_dem::laws::{Contact, Law, LawSpace, hooke};
use gshear_dem::state::{GrainState, Masses};
use gshear_dem::system::Setup;

use crate::common::{CONTACT, Rig, gas, setup, springs};

const ALWAYS: (f64, u64) = (0.1, 7);

/// The grains after so many steps, by id.
fn after<D: LawSpace>(
    setup: Setup,
    laws: &[(Law, Contact)],
    grains: Vec<GrainState>,
    steps: usize,
) -> Vec<GrainState> {
    let law = pair_force::<D>(laws).expect("a law of this dimension");
    let mut rig = Rig::new(setup, law, NoWalls, (grains, Vec::new()));
    (0..steps).for_each(|_| rig.step());
    rig.system.grain_states()
}

/// Fails unless grains of these materials, with the laws of all pairs, move as those of one
/// material with the law of `alone`.
fn move_as_one<D: LawSpace>(
    alone: &(Law, Contact),
    mixture: &[(Law, Contact)],
    material: impl Fn(u32) -> u64,
) {
    let side = if D::AXES == 2 { 12 } else { 6 };
    let grains = gas::<D>(side, 0.9, 5);
    let mut mixed = grains.clone();
    mixed.iter_mut().for_each(|g| g.material = material(g.id));
    for threads in [1, 3] {
        let setup = Setup {
            threads,
            ..setup::<D>(side, 3.0, ALWAYS)
        };
        let one = std::slice::from_ref(alone);
        let expected = after::<D>(setup.clone(), one, grains.clone(), 2000);
        let found = after::<D>(setup, mixture, mixed.clone(), 2000);
        let moved = |(a, b): (&GrainState, &GrainState)| a.moving() == b.moving();
        assert!(found.iter().zip(&expected).all(moved));
        assert!(found.iter().any(|g| g.angular_velocity != [0.0; 3]));
    }
}

fn materials_of_one_kind_are_one<D: LawSpace>(contact: Contact) {
    let law = (Law::of(&hooke::KIND, springs::<D>()), contact);
    move_as_one::<D>(&law, &vec![law.clone(); 4], |id| u64::from(id * 7 % 5 % 2));
}

/// Grains of the second material alone have its law, and not that of the first.
fn the_second_material_alone<D: LawSpace>() {
    let [first, second] = [1.0, 4.0].map(|factor| {
        let mut springs = springs::<D>();
        springs.normal_stiffness *= factor;
        (Law::of(&hooke::KIND, springs), CONTACT)
    });
    let mixture = [&first, &first, &first, &second].map(Clone::clone);
    move_as_one::<D>(&second, &mixture, |_| 1);
}

#[test]
fn grains_of_the_second_material_have_its_law() {
    the_second_material_alone::<Two>();
    the_second_material_alone::<Three>();
}

#[test]
fn grains_of_two_equal_materials_move_as_one() {
    let rolling = Contact {
        rolling_friction: 0.1,
        rolling_stiffness: Some(1e3),
        twisting_friction: 0.1,
        ..CONTACT
    };
    materials_of_one_kind_are_one::<Two>(CONTACT);
    materials_of_one_kind_are_one::<Three>(CONTACT);
    materials_of_one_kind_are_one::<Three>(rolling);
}

/// Friction of one kind of pairs alone is none of the others': grains of the smooth kind fly and
/// collide as in a packing without any friction, but for rounding.
#[test]
fn friction_of_other_pairs_does_not_reach_smooth_ones() {
    let law = Law::of(&hooke::KIND, springs::<Three>());
    let smooth = (law.clone(), Contact::NONE);
    let mut beside = vec![smooth.clone(); 3];
    beside.push((law, CONTACT));
    let [alone, beside] = [&[smooth][..], &beside].map(|laws| {
        let grains = gas::<Three>(6, 0.9, 11);
        after::<Three>(setup::<Three>(6, 3.0, ALWAYS), laws, grains, 2000)
    });
    for (a, b) in alone.iter().zip(&beside) {
        let apart = |k: usize| (a.velocity[k] - b.velocity[k]).abs();
        assert!((0..3).all(|k| apart(k) < 1e-9), "{a:?} {b:?}");
        assert_eq!(b.angular_velocity, [0.0; 3]);
    }
}

/// A head-on impact with α has the restitution of α whatever the masses, if each has its own, and
/// conserves momentum. F_n ≥ 0 lets grains part a little earlier, of all materials.
#[test]
fn unlike_grains_have_their_own_masses() {
    fn impact<D: LawSpace>() {
        let (densities, e) = ([2500.0, 400.0], 0.6);
        let laws = [[0, 0], [0, 1], [1, 0], [1, 1]].map(|[i, j]: [usize; 2]| {
            let mut constants = springs::<D>();
            (constants.damping_ratio, constants.density) = (damping_ratio(e), densities[i]);
            let contact = Contact {
                relative_densities: [1.0, densities[j] / densities[i]],
                ..Contact::NONE
            };
            (Law::of(&hooke::KIND, constants), contact)
        });
        let mut restitution = Vec::new();
        for order in [[0, 0], [0, 1], [1, 0]] {
            let speed = 0.1;
            let grain = |id: u32, x: f64, velocity: f64| GrainState {
                id,
                position: [x, 3e-3, if D::AXES == 3 { 3e-3 } else { 0.0 }],
                velocity: [velocity, 0.0, 0.0],
                radius: 1e-3,
                material: order[id as usize],
                ..GrainState::zeroed()
            };
            let setup = Setup {
                masses: Masses::Densities(densities.into()),
                step: 1e-7,
                ..setup::<D>(8, 0.0, ALWAYS)
            };
            let grains = vec![grain(0, 3e-3, speed), grain(1, 5.001e-3, 0.0)];
            let found = after::<D>(setup, &laws, grains, 40_000);
            let [v_0, v_1] = [found[0].velocity[0], found[1].velocity[0]];
            restitution.push((v_1 - v_0) / speed);
            let [m_0, m_1] = order.map(|k| densities[k as usize]);
            let momentum = (m_0 * v_0 + m_1 * v_1) / (m_0 * speed);
            assert!((momentum - 1.0).abs() < 1e-12, "{momentum}");
        }
        let [of_like, unlike @ ..] = &restitution[..] else {
            panic!("three impacts");
        };
        assert!((of_like - e).abs() < 0.05, "{of_like}");
        let alike = unlike.iter().all(|e| (e - of_like).abs() < 1e-3);
        assert!(alike, "{restitution:?}");
    }
    impact::<Two>();
    impact::<Three>();
}
