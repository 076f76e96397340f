//! Blocks of pairs that cannot touch yet are left out: no first touch is missed, however long the
//! list lives.

use crate::common::{RADIUS, Rig, gas, gas_law, setup};
use gshear_dem::dimension::{Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::NoWalls;
use gshear_dem::laws::LawSpace;
use gshear_dem::step::forces;

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
fn begin<D: LawSpace>(side: usize, start: Start, every: u64) -> Rig<D> {
    let velocity = match start {
        Start::Gas => 0.2,
        Start::HeadOn => 0.0,
    };
    let mut grains = gas::<D>(side, 1.0, 11);
    if start == Start::HeadOn {
        for (id, grain) in grains.iter_mut().enumerate() {
            grain.velocity = [[1.0, -1.0][id % side % 2], 0.0, 0.0];
        }
    }
    let setup = setup::<D>(side, velocity, (0.3, every));
    Rig::new(setup, gas_law(), NoWalls, (grains, Vec::new()))
}

/// Returns the digest after [`STEPS`], the number of lists, and in how many steps blocks slept.
fn run<D: LawSpace>(side: usize, start: Start, every: u64) -> (String, u64, u64) {
    let mut rig = begin::<D>(side, start, every);
    let mut slept = 0;
    for _ in 0..STEPS {
        rig.step();
        let asleep_until = &rig.system.contacts.asleep_until;
        slept += u64::from(asleep_until.iter().any(|x| *x > 0.0));
    }
    let touching = rig.system.contacts.touching().count();
    assert!(touching > 10, "too few touch");
    (rig.digest(&[]), rig.system.list.rebuilds, slept)
}

fn nothing_is_missed<D: LawSpace>(side: usize) {
    for start in [Start::Gas, Start::HeadOn] {
        let (expected, lists, _) = run::<D>(side, start, 1);
        assert!(lists >= STEPS);
        let (digest, lists, slept) = run::<D>(side, start, 0);
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
    let run = |relist: Relist| {
        let mut rig = begin::<Two>(20, Start::HeadOn, 0);
        (0..10).for_each(|_| rig.step());
        let (system, law, walls) = (&mut rig.system, &*rig.law, &mut rig.walls);
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
        assert!(forces(&Solo, system, law, walls, step, None).is_none());
        // Each is put 0.12 radii closer to one neighbour, of a mean gap of 0.1: most then touch.
        let touching = system.contacts.touching().count();
        assert!(touching > 100, "{touching} of 200 touch");
        let (grains, contacts) = (system.grain_states(), system.contact_states(law));
        assert!(contacts.iter().any(|c| c.history != [0.0; 3]));
        match relist {
            Relist::No => Ok(()),
            Relist::InPlace => system.rebuild(&Solo, law, walls),
            Relist::Sorted => system.replace(&Solo, law, walls, grains, contacts),
        }
        .expect("a list");
        (0..20).for_each(|_| rig.step());
        rig.digest(&[])
    };
    let expected = run(Relist::No);
    assert_eq!(run(Relist::InPlace), expected);
    assert_eq!(run(Relist::Sorted), expected);
}

#[test]
fn no_first_touch_is_missed() {
    nothing_is_missed::<Two>(20);
    nothing_is_missed::<Three>(8);
}
