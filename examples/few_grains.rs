//! Nine disks fall on a row of fixed ones: the smallest program with `gshear-dem`, without MPI and without files.
//!
//!     cargo run --release --example few_grains

use bytemuck::Zeroable;
use gshear_dem::dimension::Two;
use gshear_dem::domain::Solo;
use gshear_dem::drive::NoWalls;
use gshear_dem::failure::Result;
use gshear_dem::kernel::ContactForces;
use gshear_dem::laws::Contact;
use gshear_dem::laws::hooke::{Hooke, Springs};
use gshear_dem::observe;
use gshear_dem::state::{Cell, GrainState, Masses, body};
use gshear_dem::step::{StepRequest, advance, initial_forces};
use gshear_dem::system::{Setup, System};

/// R, the same of all (m).
const RADIUS: f64 = 1e-3;
/// Fixed disks, in a row along the periodic x axis.
const ROW: u32 = 6;

fn main() -> Result<()> {
    // Linear springs with friction, in two dimensions: without rolling resistance (the last `false`).
    let springs = Springs {
        normal_stiffness: 1e6,
        tangential_stiffness: 3e5,
        density: 2500.0,
        damping_ratio: 0.1,
        sliding_damping: 0.0,
        ageing: None,
    };
    let contact = Contact {
        friction: 0.5,
        ..Contact::default()
    };
    let law = Hooke::<Two, true, false>::new(&springs, &contact);

    let step = 1e-6;
    let cell = Cell::between_walls([f64::from(ROW) * 2.0 * RADIUS, f64::INFINITY]);
    let setup = Setup {
        gravity: [0.0, 9.81],
        ..Setup::new(cell, RADIUS, Masses::Density(springs.density), step)
    };
    // One rank. With `gshear_mpi_exchange::World` the same calls run on all ranks of an MPI job.
    let exchange = Solo;
    let mut drive = NoWalls;
    let mut system = System::<Two>::new(&exchange, setup)?;
    system.replace(&exchange, &law, &mut drive, grains(), Vec::new())?;
    initial_forces(&exchange, &mut system, &law, &mut drive, None)?;

    let mut forces = ContactForces::default();
    for k in 1..=60_000 {
        // Every 10,000th step hands out its contact forces.
        let wanted = k % 10_000 == 0;
        let request = if wanted {
            StepRequest::sampled(&mut forces)
        } else {
            StepRequest::default()
        };
        advance(&exchange, &mut system, &law, &mut drive, request)?;
        if wanted {
            report(&mut system, &forces);
        }
    }

    // The same bits on every processor and on any number of ranks.
    let step = system.steps;
    let digest = observe::digest(&exchange, &mut system, &law, &[], step);
    println!("digest {digest}");
    Ok(())
}

/// The row, and three layers of three above it.
fn grains() -> Vec<GrainState> {
    let fixed = (0..ROW).map(|id| GrainState {
        id,
        body: body::BOTTOM,
        radius: RADIUS,
        position: [f64::from(2 * id + 1) * RADIUS, 0.0, 0.0],
        ..GrainState::zeroed()
    });
    let falling = (0..9).map(|k| {
        let (column, layer) = (f64::from(k % 3), f64::from(k / 3));
        GrainState {
            id: ROW + k,
            radius: RADIUS,
            position: [
                (2.0 + 4.0 * column + 0.5 * layer) * RADIUS,
                (4.0 + 3.0 * layer) * RADIUS,
                0.0,
            ],
            ..GrainState::zeroed()
        }
    });
    fixed.chain(falling).collect()
}

fn report(system: &mut System<Two>, forces: &ContactForces) {
    let time = system.steps as f64 * system.step;
    let (grains, contacts) = system.grains_and_contacts();
    let free = (0..grains.owned).map(|g| grains.state(g));
    let fastest = free.fold(0.0, |v: f64, g| v.max(g.velocity[0].hypot(g.velocity[1])));
    let touching = contacts.touching();
    let normal: Vec<f64> = touching
        .map(|at| forces.normal[at.block].0[at.lane])
        .collect();
    let greatest = normal.iter().fold(0.0, |f: f64, x| f.max(*x));
    println!(
        "{:5.1} ms: {:2} contacts, greatest F_n {greatest:9.3e} N/m, greatest speed {fastest:9.3e} m/s",
        1e3 * time,
        normal.len(),
    );
}
