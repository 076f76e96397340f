//! The halo holds the ghosts that the forces need and no others. The ranks are threads.

use std::sync::{Barrier, Mutex};

use crate::common::{gas, gas_law, setup};
use bytemuck::{cast_slice, pod_collect_to_vec};
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::domain::{Exchange, Link, Solo};
use gshear_dem::drive::NoWalls;
use gshear_dem::laws::LawSpace;
use gshear_dem::observe;
use gshear_dem::step::{StepRequest, advance, initial_forces};
use gshear_dem::system::System;

/// A rank of a job whose ranks are threads.
struct Thread<'a> {
    rank: usize,
    barrier: &'a Barrier,
    /// By sender and receiver.
    messages: &'a Mutex<Vec<Vec<Vec<u8>>>>,
}

impl Thread<'_> {
    fn sums(&self, values: &[i64]) -> Vec<Vec<i64>> {
        let all = self.gather(cast_slice(values));
        all.iter().map(|bytes| pod_collect_to_vec(bytes)).collect()
    }
}

impl Exchange for Thread<'_> {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.messages.lock().expect("no panic").len()
    }

    fn all_to_all(&self, send: Vec<Vec<u8>>) -> Vec<Vec<u8>> {
        self.messages.lock().expect("no panic")[self.rank] = send;
        self.barrier.wait();
        let messages = self.messages.lock().expect("no panic");
        let received = messages.iter().map(|sent| sent[self.rank].clone());
        let received = received.collect();
        drop(messages);
        self.barrier.wait();
        received
    }

    fn halo(&self, links: &mut [Link<'_>], meanwhile: &mut dyn FnMut()) {
        let mut send = vec![Vec::new(); self.size()];
        for link in &*links {
            for &chosen in link.chosen {
                let record = &link.records[chosen as usize * link.width..][..link.width];
                send[link.rank].extend_from_slice(cast_slice::<f64, u8>(record));
            }
        }
        meanwhile();
        let received = self.all_to_all(send);
        for link in links {
            let message: Vec<f64> = pod_collect_to_vec(&received[link.rank]);
            link.receive.copy_from_slice(&message);
        }
    }

    fn sum(&self, values: &mut [i64]) {
        let all = self.sums(values);
        for (k, value) in values.iter_mut().enumerate() {
            *value = all.iter().fold(0, |sum, of| sum.wrapping_add(of[k]));
        }
    }

    fn sum_during(&self, values: &mut [i64], meanwhile: &mut dyn FnMut()) {
        meanwhile();
        self.sum(values);
    }

    fn sum_below(&self, value: u64) -> u64 {
        let all = self.sums(&[value as i64]);
        all[..self.rank].iter().map(|of| of[0] as u64).sum()
    }

    fn maximum(&self, value: f64) -> f64 {
        let all = self.gather(cast_slice(&[value]));
        let values = all
            .iter()
            .map(|bytes| pod_collect_to_vec::<u8, f64>(bytes)[0]);
        values.fold(f64::NEG_INFINITY, f64::max)
    }

    fn gather(&self, bytes: &[u8]) -> Vec<Vec<u8>> {
        self.all_to_all(vec![bytes.to_vec(); self.size()])
    }

    fn broadcast(&self, bytes: Vec<u8>) -> Vec<u8> {
        self.gather(&bytes).swap_remove(0)
    }

    fn barrier(&self) {
        self.barrier.wait();
    }
}

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
    let (barrier, messages) = (&Barrier::new(ranks), &Mutex::new(vec![Vec::new(); ranks]));
    let on_one = |exchange: Thread<'_>| {
        let mut ghosts = 0;
        let digest = run::<D>(&exchange, side, |system| {
            let here = count_paired_ghosts(system);
            ghosts = here.max(ghosts);
            let sent = system.slabs.traffic().0 / size_of::<D::Record>();
            let mut counts = [here, sent].map(|n| n as i64);
            exchange.sum(&mut counts);
            assert_eq!(counts[0], counts[1], "what is sent is received");
        });
        assert_eq!(digest, expected);
        assert!(ghosts > 0, "no ghosts");
    };
    std::thread::scope(|scope| {
        for rank in 0..ranks {
            let exchange = Thread {
                rank,
                barrier,
                messages,
            };
            scope.spawn(|| on_one(exchange));
        }
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
