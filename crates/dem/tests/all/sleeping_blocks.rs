//! Blocks of pairs that cannot touch yet are left out: no first touch is missed, however long the
//! list lives.

use crate::common::{CONTACT, RADIUS, gas, setup, springs};
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::NoWalls;
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::hooke::Hooke;
use gshear_dem::observe;
use gshear_dem::step::{StepRequest, advance, forces, initial_forces};
use gshear_dem::system::{ListSettings, System};

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
    let velocity = match start {
        Start::Gas => 0.2,
        Start::HeadOn => 0.0,
    };
    let list = ListSettings {
        skin: Some(0.3),
        rebuild_every: every,
    };
    let setup = setup::<D>(side, velocity, list);
    let mut grains = gas::<D>(side, 1.0, 11);
    if start == Start::HeadOn {
        for (id, grain) in grains.iter_mut().enumerate() {
            grain.velocity = [[1.0, -1.0][id % side % 2], 0.0, 0.0];
        }
    }
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

/// What is done of the list in the middle of a run.
enum Relist {
    No,
    InPlace,
    Sorted,
}

/// Forces at places to which grains were put, as in a quasi-static step, wake what slept. A new
/// list with the grains in place or sorted anew changes no bit.
#[test]
fn a_grain_that_is_put_elsewhere_wakes_its_block() {
    let law = Hooke::<Two, true, false>::new(&springs::<Two>(), &CONTACT);
    let run = |relist: Relist| {
        let mut system = begin::<Two>(&law, 20, Start::HeadOn, 0);
        let walls = &mut NoWalls;
        for _ in 0..10 {
            advance(&Solo, &mut system, &law, walls, StepRequest::default()).expect("sound");
        }
        for g in 0..400 {
            let grains = system.grains_mut();
            let away = if grains.id[g].is_multiple_of(2) {
                0.06
            } else {
                -0.06
            };
            grains.fields_mut(g)[0] += away * RADIUS;
        }
        let step = system.step;
        assert!(forces(&Solo, &mut system, &law, walls, step, None).is_none());
        // Each is put 0.12 radii closer to one neighbour, of a mean gap of 0.1: most then touch.
        let touching = system.contacts.touching().count();
        assert!(touching > 100, "{touching} of 200 touch");
        let (grains, contacts) = (system.grain_states(), system.contact_states(&law));
        assert!(contacts.iter().any(|c| c.history != [0.0; 3]));
        match relist {
            Relist::No => Ok(()),
            Relist::InPlace => system.rebuild(&Solo, &law, walls),
            Relist::Sorted => system.replace(&Solo, &law, walls, grains, contacts),
        }
        .expect("a list");
        for _ in 0..20 {
            advance(&Solo, &mut system, &law, walls, StepRequest::default()).expect("sound");
        }
        observe::digest(&Solo, &mut system, &law, &[], 30)
    };
    let expected = run(Relist::No);
    assert_eq!(run(Relist::InPlace), expected);
    assert_eq!(run(Relist::Sorted), expected);
}

#[test]
fn of_disks() {
    nothing_is_missed(
        &Hooke::<Two, true, false>::new(&springs::<Two>(), &CONTACT),
        20,
    );
}

#[test]
fn of_spheres() {
    nothing_is_missed(
        &Hooke::<Three, true, false>::new(&springs::<Three>(), &CONTACT),
        8,
    );
}
