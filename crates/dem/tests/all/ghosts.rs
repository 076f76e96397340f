//! The halo holds the ghosts that the forces need and no others. The ranks are threads.

use std::time::Duration;

use crate::common::{gas, gas_law, setup};
use crate::ranks::Job;
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::domain::{Exchange, Solo};
use gshear_dem::drive::NoWalls;
use gshear_dem::laws::LawSpace;
use gshear_dem::observe;
use gshear_dem::step::{StepRequest, advance, initial_forces};
use gshear_dem::system::System;

const STEPS: u64 = 3000;

/// Runs [`STEPS`] on this rank, and returns the digest. After each list that it makes, calls
/// `look`.
fn run<D: LawSpace>(
    exchange: &dyn Exchange,
    side: usize,
    mut look: impl FnMut(&mut System<D>),
) -> String {
    let mut grains = gas::<D>(side, 0.5, 5);
    if exchange.rank() > 0 {
        grains.clear();
    }
    let (law, walls) = (&*gas_law(), &mut NoWalls);
    let mut system = System::new(exchange, setup::<D>(side, 0.2, (0.1, 0))).expect("wide slabs");
    let made = system.replace(exchange, law, walls, grains, Vec::new());
    made.expect("a list");
    look(&mut system);
    initial_forces(exchange, &mut system, law, walls, None).expect("sound");
    for _ in 0..STEPS {
        let lists = system.list.rebuilds;
        advance(exchange, &mut system, law, walls, StepRequest::default()).expect("sound");
        if system.list.rebuilds > lists {
            look(&mut system);
        }
    }
    assert!(system.list.rebuilds > 3, "too few lists");
    observe::digest(exchange, &mut system, law, &[], STEPS)
}

/// Fails if a ghost is in no pair. Returns the number of ghosts.
fn count_paired_ghosts<D: Dimension>(system: &mut System<D>) -> usize {
    let (owned, local) = (system.owned(), system.local());
    let mut paired = vec![false; local];
    for block in 0..system.contacts.blocks() {
        let pairs = system.contacts.grains(block);
        for (i, j) in pairs.i.into_iter().zip(pairs.j) {
            // The rest of a block is filled up with pairs of a grain and itself.
            if i != j {
                paired[i as usize] = true;
                paired[j as usize] = true;
            }
        }
    }
    assert!(paired[owned..].iter().all(|&paired| paired));
    local - owned
}

fn on_ranks<D: LawSpace>(side: usize, ranks: usize) {
    let expected = run::<D>(&Solo, side, |_| ());
    Job::new(ranks, Duration::ZERO).run(|exchange| {
        let mut ghosts = 0;
        let digest = run::<D>(exchange, side, |system| {
            let here = count_paired_ghosts(system);
            ghosts = here.max(ghosts);
            let sent = system.slabs.bytes_per_step() / size_of::<D::Record>();
            let mut counts = [here, sent].map(|n| n as i64);
            exchange.sum(&mut counts);
            assert_eq!(counts[0], counts[1], "what is sent is received");
        });
        assert_eq!(digest, expected);
        assert!(ghosts > 0, "no ghosts");
    });
}

#[test]
fn ghosts_of_disks_are_those_in_pairs() {
    for ranks in [2, 3] {
        on_ranks::<Two>(24, ranks);
    }
}

#[test]
fn ghosts_of_spheres_are_those_in_pairs() {
    for ranks in [2, 3] {
        on_ranks::<Three>(12, ranks);
    }
}
