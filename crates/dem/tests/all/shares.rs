//! Each thread has a share of the grains; any number of threads gives the same bits.

use crate::common::{CONTACT, gas, setup, springs};
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::NoWalls;
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::hooke::Hooke;
use gshear_dem::observe;
use gshear_dem::step::{StepRequest, advance, initial_forces};
use gshear_dem::system::{ListSettings, Setup, System};

const STEPS: u64 = 1500;

fn run<D: Dimension>(law: &dyn PairForce<D>, side: usize, threads: usize) -> String {
    let list = ListSettings {
        skin: Some(0.1),
        rebuild_every: 0,
    };
    let setup = Setup {
        threads,
        ..setup::<D>(side, 0.2, list)
    };
    let mut system = System::new(&Solo, setup).expect("a wide cell");
    let (walls, grains) = (&mut NoWalls, gas::<D>(side, 0.5, 5));
    let made = system.replace(&Solo, law, walls, grains, Vec::new());
    made.expect("a list");
    initial_forces(&Solo, &mut system, law, walls, None).expect("sound forces");
    let mut looked_at = 0;
    for _ in 0..STEPS {
        advance(&Solo, &mut system, law, walls, StepRequest::default()).expect("sound");
        if system.list.rebuilds > looked_at {
            looked_at = system.list.rebuilds;
            check_shares(&system, threads);
        }
    }
    assert!(looked_at > 3, "too few lists");
    observe::digest(&Solo, &mut system, law, &[], STEPS)
}

/// Fails unless the shares hold every grain once and have about the same work, and every pair of a
/// share is between two of its grains.
fn check_shares<D: Dimension>(system: &System<D>, threads: usize) {
    let (contacts, owned) = (&system.contacts, system.owned());
    assert_eq!(contacts.shares.len(), threads);
    let mut end = 0;
    for share in &contacts.shares {
        assert_eq!(share.grains.start, end, "{:?}", contacts.shares);
        end = share.grains.end;
        let few = 0.5 * owned as f64 / threads as f64;
        assert!(share.grains.len() as f64 > few, "{:?}", contacts.shares);
        for block in share.blocks.clone() {
            let pairs = contacts.grains(block);
            for g in pairs.i.iter().chain(&pairs.j) {
                assert!(share.grains.contains(&(*g as usize)), "grain {g}");
            }
        }
    }
    assert_eq!(end, owned);
    assert_eq!(contacts.shared_blocks() == contacts.blocks(), threads == 1);
}

#[test]
fn of_disks() {
    let law = Hooke::<Two, true, false>::new(&springs::<Two>(), &CONTACT);
    let expected = run(&law, 24, 1);
    assert_eq!(
        [2, 3, 7].map(|threads| run(&law, 24, threads)),
        [(); 3].map(|()| expected.clone())
    );
}

#[test]
fn of_spheres() {
    let law = Hooke::<Three, true, false>::new(&springs::<Three>(), &CONTACT);
    let expected = run(&law, 9, 1);
    assert_eq!(
        [2, 3].map(|threads| run(&law, 9, threads)),
        [(); 2].map(|()| expected.clone())
    );
}
