//! The shear of spheres of benches/peers in DIRT: its plugins, and between them the rigid walls,
//! the count of contacts and the clock, which it has not.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::time::Instant;

use dirt_core::dirt_atom::{DemAtom, same_body};
use dirt_core::prelude::*;
use dirt_core::soil_core::{Read, Write};

// Materials of shear.toml.
const FREE: u32 = 0;
const TOP: u32 = 2;

/// `[shear]` of shear.toml.
struct Shear {
    data: String,
    /// Of the top wall along x (m/s).
    velocity: f64,
    /// Along z on each of the `top` grains of the top wall (N).
    push: f64,
    top: f64,
    steps: usize,
    /// Steps between counts of contacts.
    look: usize,
    end: String,
    start: Instant,
}

impl Shear {
    fn read(config: &Config) -> Self {
        let value = |key: &str| &config.table["shear"][key];
        let text = |key| value(key).as_str().unwrap().to_owned();
        let number = |key| value(key).as_float().unwrap();
        let whole = |key| value(key).as_integer().unwrap() as usize;
        Self {
            data: text("data"),
            velocity: number("velocity"),
            push: number("push"),
            top: whole("top") as f64,
            steps: whole("steps"),
            look: whole("look"),
            end: text("end"),
            start: Instant::now(),
        }
    }
}

/// Spins, which DIRT does not read, by tag, which it gives in the order of the file.
fn read_spins(data: &str) -> Vec<[f64; 3]> {
    let text = std::fs::read_to_string(data).unwrap();
    let mut sections = text
        .split("\n\n")
        .skip_while(|part| !part.starts_with("Atoms"))
        .skip(1);
    let words = |part: &'_ str| -> Vec<Vec<f64>> {
        let row = |line: &str| line.split(' ').map(|word| word.parse().unwrap()).collect();
        part.lines().map(row).collect()
    };
    let atoms = words(sections.next().unwrap());
    let velocities = words(sections.nth(1).unwrap());
    let spin = |row: &Vec<f64>| (row[0] as u32, [row[4], row[5], row[6]]);
    let spins: HashMap<u32, [f64; 3]> = velocities.iter().map(spin).collect();
    atoms.iter().map(|row| spins[&(row[0] as u32)]).collect()
}

fn prepare(
    mut atoms: ResMut<Atom>,
    particles: ParticlesWith<'_, Write<DemAtom>>,
    shear: Res<Shear>,
) {
    let spins = read_spins(&shear.data);
    particles.with(|mut dem| {
        for i in 0..atoms.nlocal() as usize {
            dem.omega[i] = spins[atoms.tag[i] as usize];
            if atoms.atom_type[i] == FREE {
                continue;
            }
            // A wall does not turn, nor touch itself.
            dem.inv_inertia[i] = 0.0;
            dem.body_id[i] = 1.0;
            atoms.vel[i] = [0.0; 3];
            if atoms.atom_type[i] == TOP {
                atoms.vel[i][0] = shear.velocity;
            } else {
                atoms.inv_mass[i] = 0.0;
            }
        }
    });
}

fn start_clock(mut shear: ResMut<Shear>, run: Res<RunState>) {
    if run.total_cycle == 1 {
        shear.start = Instant::now();
    }
}

/// The grains of the top wall have equal masses, and share load and force equally.
fn push_top(mut atoms: ResMut<Atom>, shear: Res<Shear>, comm: Res<CommResource>) {
    let top: Vec<usize> = (0..atoms.nlocal() as usize)
        .filter(|&i| atoms.atom_type[i] == TOP)
        .collect();
    let sum = comm.all_reduce_sum_f64(top.iter().map(|&i| atoms.force[i][2]).sum());
    for i in top {
        atoms.force[i] = [0.0, 0.0, sum / shear.top + shear.push];
    }
}

/// Prints contacts per free grain, and at the end the time of the steps.
fn look(
    atoms: Res<Atom>,
    particles: ParticlesWith<'_, Read<DemAtom>>,
    neighbor: Res<Neighbor>,
    shear: Res<Shear>,
    run: Res<RunState>,
    comm: Res<CommResource>,
) {
    // The step without motion is 0.
    let step = run.total_cycle;
    if step % shear.look != 0 && step != shear.steps {
        return;
    }
    let locals = atoms.nlocal() as usize;
    let free = |i: usize| f64::from(u8::from(atoms.atom_type[i] == FREE));
    particles.with(|dem| {
        let mut ends = 0.0;
        for (i, j) in neighbor.pairs(locals) {
            let square: f64 = (0..3)
                .map(|k| (atoms.pos[j][k] - atoms.pos[i][k]).powi(2))
                .sum();
            if square < (dem.radius[i] + dem.radius[j]).powi(2) && !same_body(&dem, i, j) {
                ends += free(i) + if neighbor.newton { free(j) } else { 0.0 };
            }
        }
        let grains = comm.all_reduce_sum_f64((0..locals).map(free).sum());
        let contacts = comm.all_reduce_sum_f64(ends) / grains;
        if comm.rank() == 0 {
            println!("contacts {step} {contacts}");
        }
        if step == shear.steps && comm.rank() == 0 {
            println!("loop {} s", shear.start.elapsed().as_secs_f64());
        }
        if step == shear.steps && comm.size() == 1 {
            std::fs::write(&shear.end, data_file(&atoms, &dem, &shear.data)).unwrap();
        }
    });
}

/// The grains as a LAMMPS data file, with the box of another.
fn data_file(atoms: &Atom, dem: &DemAtom, other: &str) -> String {
    let mut text = String::new();
    let other = std::fs::read_to_string(other).unwrap();
    for line in other.lines().filter(|line| line.ends_with("hi")) {
        writeln!(text, "{line}").unwrap();
    }
    let rows = 0..atoms.nlocal() as usize;
    text += "\nAtoms # sphere\n\n";
    for i in rows.clone() {
        let (id, kind, [x, y, z]) = (atoms.tag[i] + 1, atoms.atom_type[i] + 1, atoms.pos[i]);
        let (diameter, density) = (2.0 * dem.radius[i], dem.density[i]);
        writeln!(text, "{id} {kind} {diameter} {density} {x} {y} {z}").unwrap();
    }
    text += "\nVelocities\n\n";
    for i in rows {
        let ([vx, vy, vz], [wx, wy, wz]) = (atoms.vel[i], dem.omega[i]);
        writeln!(text, "{} {vx} {vy} {vz} {wx} {wy} {wz}", atoms.tag[i] + 1).unwrap();
    }
    text
}

fn main() {
    let mut app = App::new();
    app.add_plugins(CorePlugins)
        .add_plugins(GranularDefaultPlugins);
    let shear = Shear::read(&app.get_resource_ref::<Config>().unwrap());
    app.add_resource(shear);
    app.add_setup_system(
        prepare.run_if(first_stage_only()),
        ScheduleSetupSet::PostSetup,
    );
    app.add_update_system(start_clock, ParticleSimScheduleSet::Setup);
    app.add_update_system(
        push_top.after(REVERSE_SEND_FORCE),
        ParticleSimScheduleSet::PostForce,
    );
    app.add_update_system(look, ParticleSimScheduleSet::PostFinalIntegration);
    app.start();
}
