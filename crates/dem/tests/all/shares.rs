//! Each thread has a share of the grains; any number of threads gives the same bits.

use crate::common::{Rig, gas, gas_law, setup};
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::drive::NoWalls;
use gshear_dem::laws::LawSpace;
use gshear_dem::system::{Setup, System};

const STEPS: u64 = 1500;

fn run<D: LawSpace>(side: usize, threads: usize) -> String {
    let setup = Setup {
        threads,
        ..setup::<D>(side, 0.2, (0.1, 0))
    };
    let grains = (gas::<D>(side, 0.5, 5), Vec::new());
    let mut rig = Rig::new(setup, gas_law::<D>(), NoWalls, grains);
    let mut looked_at = 0;
    for _ in 0..STEPS {
        rig.step();
        if rig.system.list.rebuilds > looked_at {
            looked_at = rig.system.list.rebuilds;
            check_shares(&rig.system, threads);
        }
    }
    assert!(looked_at > 3, "too few lists");
    rig.digest(&[])
}

/// Fails unless the shares hold every grain once and have about the same work, and every pair of a
/// share is between two of its grains.
fn check_shares<D: Dimension>(system: &System<D>, threads: usize) {
    let (contacts, owned) = (&system.contacts, system.owned());
    assert_eq!(contacts.bands.len(), 1);
    let band = &contacts.bands[0];
    assert_eq!(band.shares.len(), threads);
    let mut end = 0;
    for share in &band.shares {
        assert_eq!(share.grains.start, end, "{:?}", band.shares);
        end = share.grains.end;
        let few = 0.5 * owned as f64 / threads as f64;
        assert!(share.grains.len() as f64 > few, "{:?}", band.shares);
        for block in share.blocks.clone() {
            let pairs = contacts.grains(block);
            for g in pairs.i.iter().chain(&pairs.j) {
                assert!(share.grains.contains(&(*g as usize)), "grain {g}");
            }
        }
    }
    assert_eq!(end, owned);
    assert_eq!(band.others().is_empty(), threads == 1);
}

fn any_number_gives_the_bits_of_one<D: LawSpace>(side: usize, numbers: &[usize]) {
    let expected = run::<D>(side, 1);
    for &threads in numbers {
        assert_eq!(run::<D>(side, threads), expected, "{threads} threads");
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    any_number_gives_the_bits_of_one::<Two>(24, &[2, 3, 7]);
    any_number_gives_the_bits_of_one::<Three>(9, &[2, 3]);
}
