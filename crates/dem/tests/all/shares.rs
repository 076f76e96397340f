//! Each thread has a share of the grains; any number of threads gives the same bits.

use crate::common::{Rig, gas, gas_law, setup};
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::drive::NoWalls;
use gshear_dem::laws::LawSpace;
use gshear_dem::system::{Setup, SweepSettings, System};

const STEPS: u64 = 1500;

/// Runs [`STEPS`] with bands of so many grains, and returns the digest.
fn run<D: LawSpace>(side: usize, threads: usize, band: usize) -> String {
    let setup = Setup {
        threads,
        sweep: SweepSettings {
            band: Some(band),
            ..SweepSettings::default()
        },
        ..setup::<D>(side, 0.2, (0.1, 0))
    };
    let grains = (gas::<D>(side, 0.5, 5), Vec::new());
    let mut rig = Rig::new(setup, gas_law::<D>(), NoWalls, grains);
    let mut looked_at = 0;
    for _ in 0..STEPS {
        rig.step();
        if rig.system.list.rebuilds > looked_at {
            looked_at = rig.system.list.rebuilds;
            assert_eq!(rig.system.bands() > 1, band < usize::MAX);
            check_shares(&rig.system, threads);
        }
    }
    assert!(looked_at > 3, "too few lists");
    rig.digest(&[])
}

/// Fails unless the shares hold every grain once and have about the same number of them, and every
/// pair of a share is between two of its grains.
fn check_shares<D: Dimension>(system: &System<D>, threads: usize) {
    let (contacts, owned) = (&system.contacts, system.owned());
    assert_eq!(contacts.shares.len(), threads);
    let mut begin = 0;
    for share in &contacts.shares {
        let last = share.bands.last().expect("a band");
        let grains = begin..last.grains.end;
        begin = grains.end;
        let few = 0.8 * owned as f64 / threads as f64;
        assert!(grains.len() as f64 > few, "{:?}", contacts.shares);
        for band in &share.bands {
            for block in band.blocks.clone() {
                let pairs = contacts.grains(block);
                for g in pairs.i.iter().chain(&pairs.j).map(|g| *g as usize) {
                    assert!(grains.contains(&g) && band.grains.contains(&g), "grain {g}");
                }
            }
        }
    }
    assert_eq!(begin, owned);
    let others: usize = contacts.others.iter().map(|o| o.blocks().len()).sum();
    assert_eq!(others == 0, threads == 1);
}

fn any_number_gives_the_bits_of_one<D: LawSpace>(side: usize, numbers: &[usize]) {
    let expected = run::<D>(side, 1, usize::MAX);
    for &threads in numbers {
        for band in [usize::MAX, 20] {
            let digest = run::<D>(side, threads, band);
            assert_eq!(digest, expected, "{threads} threads, bands of {band}");
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    any_number_gives_the_bits_of_one::<Two>(24, &[2, 3, 7]);
    any_number_gives_the_bits_of_one::<Three>(9, &[2, 3]);
}
