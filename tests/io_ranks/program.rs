//! Writes made-up frames, rows and checkpoints from the ranks it is started on.

use std::path::Path;
use std::time::{Duration, Instant};

use gshear_dem::domain::Exchange;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::{
    ContactSample, ContactState, FramePart, GrainSample, GrainState, HeldState, SeriesRow, Snapshot,
};
use gshear_mpi_exchange::{Parallel, World};
use gshear_store::checkpoint;
use gshear_store::log::{Log, LogColumns};
use gshear_store::trajectory::{RunHeader, TrajectoryWriter};

use crate::common::synthetic::{
    at_the_end, attributes, contact, edges, grain, header, owner, pairs, row, shapes, snapshot,
};

/// Header and scene of the checkpoints.
const TEXTS: [&str; 2] = ["{}", "seed = 1\n"];

/// `FOLDER GRAINS` writes, `damaged CHECKPOINT` reads what it must refuse, `time FOLDER` measures.
pub fn run(arguments: &[String]) {
    let world = World::start();
    let [first, second] = arguments else {
        panic!("two arguments")
    };
    match first.as_str() {
        "time" => time(&world, Path::new(second)).unwrap(),
        "damaged" => damaged(&world, Path::new(second)),
        _ => write(&world, Path::new(first), second.parse().unwrap()).unwrap(),
    }
}

fn write(world: &World, folder: &Path, grains: u64) -> Result<()> {
    let is_owned = |t: u64, id: u64| owner(t, id, world.size()) == world.rank();
    let mut shapes = shapes(grains);
    shapes.retain(|g| is_owned(0, u64::from(g.id)));
    // What follows differs between the ranks and must not be written: rank 0's counts.
    let mut attributes = attributes();
    if world.rank() > 0 {
        attributes[0].1 = "another".into();
    }
    let header = RunHeader {
        attributes: &attributes,
        ..header(&shapes)
    };
    let (path, csv) = (folder.join("run.h5"), folder.join("log.csv"));
    let mut writer = TrajectoryWriter::create(world, &path, &header)?;
    let places: Vec<usize> = (0..SeriesRow::COLUMNS.len()).collect();
    let columns = LogColumns {
        series: &SeriesRow::COLUMNS,
        places: &places,
    };
    let mut log = Log::create(world, &csv, columns)?;
    let frame = |writer: &mut TrajectoryWriter, t: u64| {
        let of_rank: Vec<GrainSample> = (0..grains)
            .rev()
            .filter(|&id| is_owned(t, id))
            .map(|id| grain(t, id))
            .collect();
        let pairs = pairs(t, grains)
            .into_iter()
            .rev()
            .filter(|p| is_owned(t, u64::from(p.0)));
        let contacts: Vec<ContactSample> = pairs.map(|p| contact(t, p)).collect();
        writer.frame(
            world,
            (10 * t, t as f64 * 0.1),
            &edges(t),
            &of_rank,
            &contacts,
        )
    };
    for t in 0..100 {
        frame(&mut writer, t)?;
        writer.series(world, 5 * t, 0.05 * t as f64, &row(t))?;
        log.row(5 * t, 0.05 * t as f64, row(t).as_ref())?;
        if t == 30 {
            writer.flush(world)?;
        }
    }
    log.flush()?;
    writer.finish(world, &at_the_end())?;

    // Resumed from the middle of a batch.
    let mut writer = TrajectoryWriter::open_to_append(world, &path, &SeriesRow::COLUMNS, 81, 55)?;
    let mut log = Log::open_to_append(world, &csv, columns, 270, 55)?;
    assert_eq!((writer.frames(), writer.rows()), (81, 55));
    for t in 81..150 {
        frame(&mut writer, t)?;
    }
    for k in 55..1200 {
        writer.series(world, 5 * k, 0.05 * k as f64, &row(k))?;
        log.row(5 * k, 0.05 * k as f64, row(k).as_ref())?;
    }
    assert_eq!((writer.frames(), writer.rows()), (150, 1200));
    log.flush()?;
    writer.finish(world, &at_the_end())?;

    for t in [5, 6] {
        let mut part = snapshot(t, grains);
        part.grains.retain(|g| is_owned(t, u64::from(g.id)));
        part.contacts.retain(|c| is_owned(t, u64::from(c.i)));
        part.grains.reverse();
        if let Some(frame) = &mut part.analysed {
            frame.grains.retain(|g| is_owned(t, u64::from(g.id)));
            frame.contacts.retain(|c| is_owned(t, u64::from(c.i)));
        }
        if let Some(displacements) = &mut part.displacements {
            displacements.retain(|g| is_owned(t, u64::from(g.id)));
        }
        for state in &mut part.held {
            state.grains.retain(|g| is_owned(t, u64::from(g.id)));
            state.contacts.retain(|c| is_owned(t, u64::from(c.i)));
        }
        checkpoint::write(world, folder, TEXTS, &part)?;
    }
    let (texts, part) = checkpoint::read(world, &folder.join(checkpoint::NAME))?;
    assert_eq!(texts, TEXTS);
    let whole = Snapshot {
        grains: together(world, &part.grains),
        contacts: together(world, &part.contacts),
        analysed: part.analysed.map(|frame| FramePart {
            grains: together(world, &frame.grains),
            contacts: together(world, &frame.contacts),
        }),
        displacements: part
            .displacements
            .map(|displacements| together(world, &displacements)),
        held: (part.held.iter())
            .map(|state| HeldState {
                grains: together(world, &state.grains),
                contacts: together(world, &state.contacts),
            })
            .collect(),
    };
    assert_eq!(whole, snapshot(6, grains));
    Ok(())
}

fn together<T: bytemuck::Pod>(world: &World, part: &[T]) -> Vec<T> {
    let all = world.gather(bytemuck::cast_slice(part)).concat();
    all.chunks_exact(size_of::<T>())
        .map(bytemuck::pod_read_unaligned)
        .collect()
}

/// Every rank must come to the same message, which rank 0 prints.
fn damaged(world: &World, path: &Path) {
    let message = checkpoint::read(world, path).unwrap_err();
    assert!(matches!(message, Failure::Input(_)));
    let all = world.gather(message.to_string().as_bytes());
    assert!(all.iter().all(|m| *m == all[0]));
    if world.rank() == 0 {
        println!("{message}");
    }
}

/// Cost of frames, rows and checkpoints.
fn time(world: &World, folder: &Path) -> Result<()> {
    world.watch(Duration::from_mins(8));
    let print = |what: &str, microseconds: f64| {
        if world.rank() == 0 {
            println!("{what}: {microseconds:.1} us");
        }
    };
    for (grains, frames) in [(1_000u64, 2560u64), (20_000, 160)] {
        // Slabs: each rank has a stretch of the ids, and grains near its ends change rank.
        let is_owned = |id: u64| {
            (id * 97 % grains / 8 + id) * world.size() as u64 / (grains + grains / 8)
                == world.rank() as u64
        };
        let of_rank: Vec<GrainSample> = (0..grains)
            .filter(|&id| is_owned(id))
            .map(|id| grain(1, id))
            .collect();
        let pairs = (0..grains as u32 - 2).flat_map(|i| (1..=2).map(move |k| (i, i + k)));
        let pairs = pairs.filter(|p| is_owned(u64::from(p.0)) && (p.1 - p.0 == 1 || p.0 % 10 < 3));
        let contacts: Vec<ContactSample> = pairs.map(|p| contact(1, p)).collect();
        let mut shapes = shapes(grains);
        shapes.retain(|g| is_owned(u64::from(g.id)));
        world.barrier();
        let start = Instant::now();
        let mut writer =
            TrajectoryWriter::create(world, &folder.join("time.h5"), &header(&shapes))?;
        print(
            &format!("{grains} grains: create"),
            start.elapsed().as_secs_f64() * 1e6,
        );
        world.barrier();
        let start = Instant::now();
        for t in 0..frames {
            writer.frame(world, (t, t as f64), &edges(t), &of_rank, &contacts)?;
        }
        print(
            "  frame",
            start.elapsed().as_secs_f64() / frames as f64 * 1e6,
        );
        let start = Instant::now();
        for k in 0..4096 {
            writer.series(world, k, k as f64, &row(k))?;
        }
        print("  row", start.elapsed().as_secs_f64() / 4096.0 * 1e6);
        let start = Instant::now();
        writer.finish(world, &at_the_end())?;
        print("  finish", start.elapsed().as_secs_f64() * 1e6);
        let mut part = snapshot(1, 1);
        part.grains = shapes
            .iter()
            .map(|g| GrainState {
                id: g.id,
                ..part.grains[0]
            })
            .collect();
        part.contacts = contacts
            .iter()
            .map(|c| ContactState::new(c.i, c.j, [1.0; 3]))
            .collect();
        let start = Instant::now();
        for _ in 0..4 {
            checkpoint::write(world, folder, TEXTS, &part)?;
        }
        print(
            "  checkpoint write",
            start.elapsed().as_secs_f64() / 4.0 * 1e6,
        );
        let start = Instant::now();
        checkpoint::read(world, &folder.join(checkpoint::NAME))?;
        print("  checkpoint read", start.elapsed().as_secs_f64() * 1e6);
    }
    Ok(())
}
