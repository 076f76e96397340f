//! Checks every operation between the ranks it is started on.

use std::time::Instant;

use gshear_dem::domain::{Exchange, HaloMessage, total};
use gshear_mpi_exchange::{Parallel, World};

/// `panic` and `abort` end it so, `time` measures, and without an argument it checks.
pub fn run(arguments: &[String]) {
    let world = World::start();
    match arguments.first().map(String::as_str) {
        Some("panic") => {
            assert!(world.rank() + 1 < world.size(), "the last rank panics");
            world.barrier();
        }
        Some("abort") => {
            if world.rank() == 0 {
                world.abort(3);
            }
            world.barrier();
        }
        Some("time") => time(&world),
        _ => check(&world),
    }
}

fn check(world: &World) {
    let (rank, size) = (world.rank(), world.size());
    assert_eq!(world.communicator().is_some(), size > 1);

    // Message of s to r: s + 2r bytes of value s, some of them empty.
    let send = (0..size)
        .map(|r| vec![rank as u8; if r == rank + 1 { 0 } else { rank + 2 * r }])
        .collect();
    for (s, bytes) in world.all_to_all(send).into_iter().enumerate() {
        assert_eq!(
            bytes,
            vec![s as u8; if rank == s + 1 { 0 } else { s + 2 * rank }]
        );
    }

    if size > 1 {
        // Lengths around the eager limit; both links of two ranks go to the same neighbour.
        for length in [0, 1, 500, 3000, 100_000] {
            ring(world, length);
        }
        // None sleeps for ever, however the ranks meet.
        for turn in 0..if size > 5 { 500 } else { 30_000 } {
            let mut own = [rank as i64 + 1, turn, i64::MAX];
            world.begin_sum(&own);
            ring(world, 1);
            world.end_sum(&mut own);
            let ranks = size as i64;
            let wrapped = i64::MAX.wrapping_mul(ranks);
            assert_eq!(own, [ranks * (ranks + 1) / 2, ranks * turn, wrapped]);
        }
    }

    let mut values: Vec<i64> = (0..150).map(|k| k * (rank as i64 + 1)).collect();
    world.sum(&mut values);
    let ranks = (size * (size + 1) / 2) as i64;
    assert!(
        values
            .iter()
            .enumerate()
            .all(|(k, &v)| v == k as i64 * ranks)
    );
    let mut wrapping = [i64::MAX];
    world.sum(&mut wrapping);
    assert_eq!(wrapping[0], i64::MAX.wrapping_mul(size as i64));
    assert_eq!(total(world, 7), 7 * size as u64);

    assert_eq!(
        world.sum_below(rank as u64 + 1),
        (rank * (rank + 1) / 2) as u64
    );
    assert_eq!(world.maximum(-(rank as f64)), 0.0);
    assert!(
        world
            .maximum(if rank == 0 { f64::NAN } else { 1.0 })
            .is_nan()
    );

    let nothing = vec![Vec::<u8>::new(); size];
    assert_eq!(world.gather(&[]), nothing);
    assert_eq!(world.all_to_all(nothing.clone()), nothing);
    assert!(world.broadcast(Vec::new()).is_empty());
    let all = world.gather(&vec![rank as u8; rank]);
    assert!(
        all.iter()
            .enumerate()
            .all(|(r, bytes)| *bytes == vec![r as u8; r])
            && all.len() == size
    );

    let bytes = if rank == 0 {
        b"of rank 0".to_vec()
    } else {
        vec![1; 3 * rank]
    };
    assert_eq!(world.broadcast(bytes), b"of rank 0");
    world.barrier();
    if rank == 0 {
        println!("ranks {size}");
    }
}

fn ring(world: &World, length: usize) {
    let (rank, size) = (world.rank(), world.size());
    let (left, right) = ((rank + size - 1) % size, (rank + 1) % size);
    // Twice as many records as are sent: to the left the first half backwards, to the right the
    // other.
    let record = |rank: usize, k: u32| rank as f64 + f64::from(k) / 1e6;
    let all = 2 * length as u32;
    let records: Vec<f64> = (0..all).map(|k| record(rank, k)).collect();
    let to_left: Vec<u32> = (0..all / 2).rev().collect();
    let to_right: Vec<u32> = (all / 2..all).collect();
    // Each rank begins first what moves right, then what moves left: sends and receives must pair
    // up rank by rank.
    let mut links = [(left, &to_left, &to_right), (right, &to_right, &to_left)];
    if size == 2 && rank == 1 {
        links.swap(0, 1);
    }
    for (rank, chosen, _) in links {
        world.begin_halo(HaloMessage {
            rank,
            length: chosen.len(),
            write: &|numbers| {
                for (number, &k) in numbers.iter_mut().zip(chosen) {
                    *number = records[k as usize];
                }
            },
            expected: length,
        });
    }
    for (from, _, sent) in links {
        let wanted: Vec<f64> = sent.iter().map(|&k| record(from, k)).collect();
        let mut came = Vec::new();
        world.end_halo(from, &mut |numbers| came = numbers.to_vec());
        assert_eq!(came, wanted);
    }
}

/// Cost of the operations of a step.
fn time(world: &World) {
    let (rank, size) = (world.rank(), world.size());
    let n = 20_000;
    for length in [64, 512, 1024, 4096] {
        let sent = vec![1.0; length / 2];
        let (left, right) = ((rank + size - 1) % size, (rank + 1) % size);
        let start = Instant::now();
        for _ in 0..n {
            for rank in [left, right] {
                world.begin_halo(HaloMessage {
                    rank,
                    length: sent.len(),
                    write: &|numbers| numbers.copy_from_slice(&sent),
                    expected: sent.len(),
                });
            }
            for rank in [left, right] {
                world.end_halo(rank, &mut |_| ());
            }
        }
        if rank == 0 {
            println!(
                "halo of 2 x {} B each way: {:.2} us",
                length * 4,
                start.elapsed().as_secs_f64() / f64::from(n) * 1e6
            );
        }
    }
    let start = Instant::now();
    for _ in 0..n {
        world.sum(&mut [1; 8]);
    }
    if rank == 0 {
        println!(
            "sum of 8 numbers: {:.2} us",
            start.elapsed().as_secs_f64() / f64::from(n) * 1e6
        );
    }
}
