//! Flat walls, through the real program: closed forms, LAMMPS, and what such scenes refuse.

use std::f64::consts::PI;
use std::fmt::Write as _;
use std::path::Path;

use crate::common::{change_file, gshear_mpi, reducer, run_scene, same_run, succeed};
use gshear_dem::state::body;
use gshear_store::run_reader::RunFile;

/// A LAMMPS data file of grains in a square of this length (m), between planes this far apart (m):
/// the radius and place of each (m), its velocity (m/s) and spin (rad/s).
fn write_grains(path: &Path, [length, height]: [f64; 2], disks: bool, grains: &[[[f64; 3]; 4]]) {
    let (y, z) = if disks {
        (height, format!("{:?} {:?}", -0.1 * length, 0.1 * length))
    } else {
        (length, format!("0 {height:?}"))
    };
    let mut text = format!(
        "grains between planes\n\n{} atoms\n1 atom types\n0 {length:?} xlo xhi\n0 {y:?} ylo yhi\n{z} zlo zhi\n\nAtoms # sphere\n\n",
        grains.len()
    );
    let mut velocities = String::from("\nVelocities\n\n");
    for (k, [[radius, ..], [x, y, z], v, w]) in grains.iter().enumerate() {
        let id = k + 1;
        let _ = writeln!(text, "{id} 1 {:?} 2500 {x:?} {y:?} {z:?}", 2.0 * radius);
        let both: Vec<String> = v.iter().chain(w).map(|v| format!("{v:?}")).collect();
        let _ = writeln!(velocities, "{id} {}", both.join(" "));
    }
    std::fs::write(path, text + &velocities).expect("a packing");
}

fn close(found: f64, expected: f64, within: f64, what: &str) {
    let error = (found / expected - 1.0).abs();
    assert!(
        error < within,
        "{what}: {found:e} is not {expected:e}: {error:e}"
    );
}

/// Four spheres that bounce, slide and roll on a floor for 0.05 s: `fix wall/gran` of LAMMPS, see
/// floor.in. Ours is of second order in Δt, LAMMPS' of first.
#[test]
fn spheres_on_a_floor_are_those_of_lammps() {
    let folder = tempfile::tempdir().expect("a folder");
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/all/flat_walls");
    let scene = here.join("floor.toml").display().to_string();
    let run = |step: &str| {
        let out = folder.path().join(step);
        gshear_mpi(1, &out, &[scene.clone(), format!("--set=time.step={step}")]).digest();
        let run = RunFile::open_any(&out).expect("a run");
        run.records(1..2).expect("a frame").swap_remove(0)
    };
    let text = include_str!("floor.txt");
    let rows = text.lines().skip_while(|l| !l.starts_with("ITEM: ATOMS"));
    let lammps: Vec<Vec<f64>> = rows
        .skip(1)
        .map(|row| {
            let numbers = row.split_whitespace().map(|n| n.parse().expect("a number"));
            numbers.collect()
        })
        .collect();
    assert_eq!(lammps.len(), 4);
    let [coarse, fine] = ["4e-7", "1e-7"].map(|step| {
        let frame = run(step);
        let mut worst = 0.0_f64;
        for (grain, row) in frame.grains.iter().zip(&lammps) {
            for (found, expected) in [
                (grain.position, &row[1..4]),
                (grain.velocity, &row[4..7]),
                (grain.angular_velocity, &row[7..10]),
            ] {
                let square = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>();
                let apart = square(&mut found.iter().zip(expected).map(|(a, b)| a - b));
                worst = worst.max((apart / square(&mut expected.iter().copied())).sqrt());
            }
        }
        worst
    });
    println!("from LAMMPS: {coarse:e} {fine:e}");
    assert!(fine < 5e-5 && coarse > 6.0 * fine, "{coarse:e} {fine:e}");
}

/// Chung & Ooi (2011), test 2: an aluminium sphere of R = 0.1 m at 0.2 m/s on a rigid plane:
/// 49.74 µm, 11.37 kN, 732 µs. Its modulus is twice that of aluminium, since ours gives way on
/// both sides.
#[test]
fn an_aluminium_sphere_hits_a_rigid_plane() {
    const RADIUS: f64 = 0.1;
    const STEP: f64 = 1e-7;
    let folder = tempfile::tempdir().expect("a folder");
    let place = [0.5, 0.5, RADIUS + 1e-6];
    let grain = [[RADIUS; 3], place, [0.0, 0.0, -0.2], [0.0; 3]];
    write_grains(&folder.path().join("one.data"), [1.0, 1.0], false, &[grain]);
    let scene = "
        dimension = 3
        material = { young_modulus = 140e9, poisson_ratio = 0.3, density = 2699 }
        contact = { law = 'hertz', friction = 0, normal_damping = 0, tangential_damping = 0 }
        sample = { packing = 'one.data', boundary = 'free', walls = 'flat' }
        load.gravity = 1e-3
        time.step = 1e-7
        shear.protocol = [{ time = 1e-3 }]
        output = { series_rows = 10000, frame_rows = 1 }
    ";
    let run = run_scene(folder.path(), "one", scene, &[]);
    let series = run.series();
    let forces = series.column("normal_force");
    let heights = series.column("wall_height");
    let most = forces.iter().fold(0.0_f64, |a, b| a.max(*b));
    let least = heights.iter().fold(f64::INFINITY, |a, b| a.min(*b));
    let touching = forces.iter().filter(|force| **force > 0.0).count();
    close(RADIUS - 0.5 * least, 49.74e-6, 1e-3, "greatest overlap");
    close(most, 11.37e3, 1e-3, "greatest force");
    close(touching as f64 * STEP, 732e-6, 2e-3, "time of contact");
}

/// Sliding throughout an impact: a sphere loses μ(1+e)v_n of its tangential velocity and turns by
/// 5/2 of it over R, a disk by twice of it, in whatever direction (Chung & Ooi 2011, tests 5 to 8).
#[test]
fn impacts_that_slide_throughout() {
    const RADIUS: f64 = 1e-3;
    const FRICTION: f64 = 0.1;
    let folder = tempfile::tempdir().expect("a folder");
    for (name, up, per_spin) in [("disks", 1, 2.0), ("spheres", 2, 2.5)] {
        let grain = |k: usize| {
            let (along, across) = (
                [1.0, -2.0, 1.5][k],
                if up == 1 { 0.0 } else { [2.0, 0.5, -1.0][k] },
            );
            let mut place = [2.5e-3 * (k + 1) as f64, 4e-3, 0.0];
            place[up] = RADIUS * 1.000_01;
            let mut velocity = [along, across, 0.0];
            velocity[up] = -0.5;
            [[RADIUS; 3], place, velocity, [0.0; 3]]
        };
        let grains: Vec<_> = (0..3).map(grain).collect();
        let data = folder.path().join(format!("{name}.data"));
        write_grains(&data, [10e-3, 10e-3], up == 1, &grains);
        let law = match up {
            1 => {
                "material.density = 2500\ncontact = { law = 'hooke', normal_stiffness = 1e8, friction = 0.1, damping_ratio = 0 }"
            }
            _ => {
                "material = { young_modulus = 70e9, poisson_ratio = 0.3, density = 2500 }\ncontact = { law = 'hertz', friction = 0.1, restitution = 0.8, impact_speed = 0.5, impact_diameter = 2e-3 }"
            }
        };
        let scene = format!(
            "dimension = {}\n{law}
            sample = {{ packing = '{name}.data', boundary = 'free', walls = 'flat' }}
            load.gravity = 1.0
            shear.protocol = [{{ time = 1e-4 }}]
            output.frame_rows = 1",
            up + 1
        );
        let run = run_scene(folder.path(), name, &scene, &["time.step=5e-9"]);
        let frame = run.records(1..2).expect("a frame").swap_remove(0);
        for (grain, [_, _, before, _]) in frame.grains.iter().zip(&grains) {
            let lifted = grain.velocity[up];
            assert!(lifted > 0.2, "{name}: it bounces: {lifted}");
            let lost = FRICTION * (lifted - before[up]);
            let slip = before[..up].iter().map(|v| v * v).sum::<f64>().sqrt();
            for (axis, first) in before.iter().enumerate().take(up) {
                let expected = first * (1.0 - lost / slip);
                let off = (grain.velocity[axis] - expected).abs();
                assert!(off < 2e-3 * lost, "{name}: {:?} {expected}", grain.velocity);
            }
            // The bottom of the grain is dragged against its slip.
            let spin = per_spin * lost / RADIUS;
            let expected = match up {
                1 => [0.0, 0.0, -spin * before[0].signum()],
                _ => [-spin * before[1] / slip, spin * before[0] / slip, 0.0],
            };
            for axis in 0..3 {
                let off = (grain.angular_velocity[axis] - expected[axis]).abs();
                assert!(
                    off < 2e-3 * spin,
                    "{name}: {:?} {expected:?}",
                    grain.angular_velocity
                );
            }
        }
    }
}

/// A grain that slides under its weight rolls in the end: m v + I ω/R stays, whatever the force
/// between, so that v is 5/7 of the first velocity for a sphere, 2/3 for a disk. It goes on to roll
/// over many periods of the cell: the normal of a plane does not turn.
#[test]
fn a_grain_slides_until_it_rolls() {
    const RADIUS: f64 = 1e-3;
    let folder = tempfile::tempdir().expect("a folder");
    for (name, up, inertia) in [("disk", 1, 0.5), ("sphere", 2, 0.4)] {
        let weight = 2500.0
            * 9.81
            * if up == 1 {
                PI * RADIUS * RADIUS
            } else {
                4.0 / 3.0 * PI * RADIUS.powi(3)
            };
        let stiffness: f64 = if up == 1 { 1e6 } else { 1e3 };
        let mut place = [3e-3, 3e-3, 0.0];
        place[up] = RADIUS - weight / stiffness;
        let velocity = if up == 1 {
            [0.1, 0.0, 0.0]
        } else {
            [0.08, -0.06, 0.0]
        };
        let grain = [[RADIUS; 3], place, velocity, [0.0; 3]];
        let data = folder.path().join(format!("{name}.data"));
        write_grains(&data, [10e-3, 10e-3], up == 1, &[grain]);
        let scene = format!(
            "dimension = {}
            material.density = 2500
            contact = {{ law = 'hooke', normal_stiffness = {stiffness:?}, friction = 0.3, damping_ratio = 0.2 }}
            sample = {{ packing = '{name}.data', boundary = 'free', walls = 'flat' }}
            load.gravity = 9.81
            shear.protocol = [{{ time = 1.0 }}]
            output.frame_rows = 2",
            up + 1
        );
        let run = run_scene(folder.path(), name, &scene, &[]);
        let frames = run.records(1..3).expect("frames");
        let end = &frames[1].grains[0];
        // Half a unit of force and one of torque in the same direction for 1 s: 2^-49 of k R.
        let rounding = 1.5 * stiffness * RADIUS * 2f64.powi(-49) / (weight / 9.81);
        for axis in 0..up {
            let spin = [end.angular_velocity[1], -end.angular_velocity[0]][axis];
            let spin = if up == 1 {
                -end.angular_velocity[2]
            } else {
                spin
            };
            let now = end.velocity[axis];
            let kept = now + inertia * RADIUS * spin;
            close(
                kept,
                velocity[axis],
                rounding / velocity[axis].abs(),
                "momentum about the floor",
            );
            close(RADIUS * spin, now, 1e-6, "rolling");
            close(now, velocity[axis] / (1.0 + inertia), 1e-6, "velocity");
        }
        let way = frames[1].grains[0].image[0] - frames[0].grains[0].image[0];
        assert!(way >= 2, "{name}: it crosses the seam: {way}");
        let spin = end.angular_velocity[up];
        assert!(up == 1 || spin.abs() < 1e-9, "it does not twist: {spin:e}");
    }
}

/// Rollers between plates: under a load and with friction they roll at half the velocity of the
/// upper one and drag it no more; without friction at a plate they stay where they are.
#[test]
fn rollers_bear_a_moving_top() {
    const RADIUS: f64 = 1e-3;
    const SPEED: f64 = 0.02;
    let folder = tempfile::tempdir().expect("a folder");
    for (dimension, length) in [(2, 16e-3), (3, 10e-3)] {
        let up = dimension - 1;
        let grain = |k: usize| {
            let mut place = [2.5e-3 * (k + 1) as f64, 4e-3, 0.0];
            place[up] = RADIUS;
            [[RADIUS; 3], place, [0.0; 3], [0.0; 3]]
        };
        let grains: Vec<_> = (0..3).map(grain).collect();
        let data = folder.path().join(format!("rollers-{dimension}.data"));
        write_grains(&data, [length, 2.0 * RADIUS], dimension == 2, &grains);
        let law = match dimension {
            2 => "law = 'hooke'\nnormal_stiffness = 1e6\ndamping_ratio = 0.3",
            _ => "law = 'hertz'\nrestitution = 0.5\nimpact_speed = 0.1\nimpact_diameter = 2e-3",
        };
        let modulus = if dimension == 2 {
            ""
        } else {
            "young_modulus = 1e8\npoisson_ratio = 0.3"
        };
        let scene = |at_wall: f64| {
            format!(
                "dimension = {dimension}
                material = [{{ name = 'grains', density = 2500, MODULUS }}, {{ name = 'plate', density = 1000, MODULUS }}]
                [contact]
                {law}
                friction = 0.5
                [[contact.pair]]
                materials = ['grains', 'plate']
                friction = {at_wall:?}
                [sample]
                packing = 'rollers-{dimension}.data'
                walls = 'flat'
                wall_material = 'plate'
                [load]
                pressure = 100.0
                [shear]
                protocol = [{{ velocity = {SPEED:?}, time = 0.2 }}]
                [output]
                frame_rows = 1",
            )
            .replace("MODULUS", &modulus.replace('\n', ", "))
            .replace(", }", " }")
        };
        let at_end = |name: &str, friction: f64| {
            let name = format!("{name}-{dimension}");
            let run = run_scene(folder.path(), &name, &scene(friction), &[]);
            let frame = run.records(1..2).expect("a frame").swap_remove(0);
            let series = run.series();
            let last = |of: &str| *series.column(of).last().expect("rows");
            let force = [last("normal_force"), last("shear_force")];
            (frame.grains, force, last("energy_residual"))
        };
        let load = 100.0
            * if dimension == 2 {
                length
            } else {
                length * length
            };
        let (grains, [normal, shear], residual) = at_end("rough", 0.6);
        close(normal, load, 1e-6, "the load");
        assert!(shear.abs() < 1e-6 * load, "{shear:e}");
        assert!(residual.abs() < 1e-3, "{residual:e}");
        for grain in grains {
            close(grain.velocity[0], 0.5 * SPEED, 1e-5, "half the velocity");
            let spin = if dimension == 2 {
                -grain.angular_velocity[2]
            } else {
                grain.angular_velocity[1]
            };
            close(RADIUS * spin, 0.5 * SPEED, 1e-5, "spin");
        }
        let (grains, [normal, shear], _) = at_end("smooth", 0.0);
        close(normal, load, 1e-6, "the load");
        assert_eq!(shear, 0.0);
        assert!(grains.iter().all(|grain| grain.velocity[0] == 0.0));
    }
}

/// A sphere at rest on a plane that attracts it: its weight W and the attraction, R* = R, press it
/// in. DMT: (4/3) E* √R δ^(3/2) = W + 4πγR. JKR: a from W = (4/3) E* a³/R - √(16πγE*a³), δ = a²/R -
/// √(4πγa/E*).
#[test]
fn a_plane_attracts() {
    const RADIUS: f64 = 1e-3;
    const GAMMA: f64 = 0.5;
    let folder = tempfile::tempdir().expect("a folder");
    let modulus = 1e8 / (2.0 * (1.0 - 0.09));
    let weight = 2500.0 * 9.81 * 4.0 / 3.0 * PI * RADIUS.powi(3);
    let dmt = 0.75 * (weight + 4.0 * PI * GAMMA * RADIUS) / (modulus * RADIUS.sqrt());
    let force = |a: f64| {
        let cube: f64 = modulus * a * a * a;
        4.0 / 3.0 * cube / RADIUS - (16.0 * PI * GAMMA * cube).sqrt()
    };
    // From the greatest pull on, the force rises with a.
    let (mut low, mut high) = (
        (9.0 * PI * GAMMA * RADIUS * RADIUS / modulus).cbrt(),
        RADIUS,
    );
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        let is_high = force(middle) > weight;
        (low, high) = if is_high {
            (low, middle)
        } else {
            (middle, high)
        };
    }
    let jkr = low * low / RADIUS - (4.0 * PI * GAMMA * low / modulus).sqrt();
    for (adhesion, expected) in [("dmt", dmt.powf(2.0 / 3.0)), ("jkr", jkr)] {
        let place = [5e-3, 5e-3, RADIUS - expected * 0.9];
        let grain = [[RADIUS; 3], place, [0.0; 3], [0.0; 3]];
        let data = folder.path().join(format!("{adhesion}.data"));
        write_grains(&data, [10e-3, 10e-3], false, &[grain]);
        let scene = format!(
            "dimension = 3
            material = {{ young_modulus = 1e8, poisson_ratio = 0.3, density = 2500 }}
            contact = {{ law = 'hertz', friction = 0.5, restitution = 0.2, impact_speed = 0.01, impact_diameter = 2e-3, surface_energy = {GAMMA:?}, adhesion = '{adhesion}' }}
            sample = {{ packing = '{adhesion}.data', boundary = 'free', walls = 'flat' }}
            load.gravity = 9.81
            shear.protocol = [{{ time = 0.05 }}]
            output = {{ series_rows = 10, frame_rows = 1 }}",
        );
        let run = run_scene(folder.path(), adhesion, &scene, &[]);
        let series = run.series();
        let height = series.column("wall_height").last().expect("rows");
        close(RADIUS - 0.5 * height, expected, 1e-5, adhesion);
        let borne = series.column("normal_force").last().expect("rows");
        close(*borne, weight, 1e-6, "the weight");
    }
}

/// Disks between planes.
const DISKS: &str = "
    material.density = 2500
    contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.5, damping_ratio = 0.1 }
    sample = { grains = 200, radius_min = 0.8e-3, radius_max = 1.2e-3, length = 20e-3, walls = 'flat' }
    load.pressure = 1e3
    pack.tolerance = 1e-4
    shear = { inertial_number = 0.01, strain = 0.01 }
";

/// Spheres between planes.
const SPHERES: &str = "
    dimension = 3
    material = { young_modulus = '65 MPa', poisson_ratio = 0.22, density = 2500 }
    contact = { law = 'hertz-tsuji', friction = 0.4, restitution = 0.8 }
    sample = { grains = 120, radius_min = 0.8e-3, radius_max = 1e-3, length = 8e-3, width = 8e-3, walls = 'flat' }
    load.pressure = 1e3
    pack.tolerance = 1e-3
    shear = { inertial_number = 0.01, strain = 0.01 }
";

/// Disks below a free surface, on a plane.
const FLOW: &str = "
    material.density = 2500
    contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.5, damping_ratio = 0.1 }
    sample = { grains = 60, radius_min = 0.8e-3, radius_max = 1.2e-3, length = 10e-3, boundary = 'free', walls = 'flat' }
    load = { gravity = 9.81, incline = 35 }
    pack.tolerance = 1e-3
    shear.protocol = [{ time = 0.1 }]
    output = { series_rows = 10, frame_rows = 10 }
";

/// The forces of the contacts with planes in a frame are, summed, those of the time series, which
/// are sums of the forces on the planes; each is `F_n` along the normal and `F_t` in the plane. The
/// frames of a run are the same on any number of ranks, and if it was stopped in between.
#[test]
fn frames_hold_the_contacts_with_planes() {
    let folder = tempfile::tempdir().expect("a folder");
    let rows = ["output.series_strain=1e-3", "output.frame_strain=1e-3"];
    // N and S are the forces on the top, or below a free surface on the bottom.
    for (name, scene, rows, measured) in [
        ("disks", DISKS, &rows[..], body::TOP),
        ("spheres", SPHERES, &rows, body::TOP),
        (
            "plate",
            &DISKS.replace("'flat'", "'flat-top'"),
            &rows,
            body::TOP,
        ),
        ("flow", FLOW, &[], body::BOTTOM),
    ] {
        let run = run_scene(folder.path(), name, scene, rows);
        let (grains, up) = (run.grains().count(), run.dimension().axes() - 1);
        let series = run.series();
        assert!(run.frames() > 9);
        let mut seen = [0; 2];
        for frame in run.records(0..run.frames()).expect("frames") {
            let row = series.step.binary_search(&frame.step).expect("a row");
            let mut force = [0.0; 3];
            let mut walls = [0; 2];
            for contact in &frame.wall_contacts {
                let wall = contact.wall(grains).expect("a wall");
                walls[wall as usize - 1] += 1;
                if wall != measured {
                    continue;
                }
                // t̂ = ẑ × n is x below the top, -x above the bottom.
                let [x, y, z] = contact.tangential_force;
                let tangential = match (up, wall) {
                    (1, body::TOP) => [x, 0.0],
                    (1, _) => [-x, 0.0],
                    _ => [x, y],
                };
                assert!(
                    up == 1 || z.abs() <= 1e-12 * contact.normal_force,
                    "in the plane"
                );
                force[0] += contact.normal_force;
                force[1] += tangential[0];
                force[2] += tangential[1];
            }
            let [normal, shear] =
                ["normal_force", "shear_force"].map(|name| series.column(name)[row]);
            // On the bottom the flow drags against S.
            let sign = if measured == body::TOP { 1.0 } else { -1.0 };
            // Forces on the planes are rounded to 2^-50 of the greatest force of the law.
            let scale = 1e-11 * normal.abs().max(shear.abs());
            let found = [force[0], sign * force[1]];
            let off = [found[0] - normal, found[1] - shear].map(f64::abs);
            assert!(
                off.iter().all(|off| *off <= scale),
                "{name}: {found:?} {normal} {shear}"
            );
            seen = [seen[0] + walls[0], seen[1] + walls[1]];
        }
        let all = match name {
            "disks" | "spheres" => [true, true],
            "plate" => [false, true],
            _ => [true, false],
        };
        assert_eq!(seen.map(|count| count > 2), all, "{name}: {seen:?}");
        assert!(seen.iter().all(|count| *count > 2 || *count == 0));
        let scene = folder.path().join(format!("{name}.toml"));
        let begun = |ranks: usize, more: &[&str]| {
            let out = folder.path().join(format!("{name}-{ranks}"));
            let sets = rows.iter().map(|set| format!("--set={set}"));
            let more = more.iter().map(ToString::to_string);
            let scene = scene.display().to_string();
            let arguments: Vec<String> = [scene].into_iter().chain(sets).chain(more).collect();
            (gshear_mpi(ranks, &out, &arguments).code, out)
        };
        let steps = run.frame_steps();
        let stop = format!("--stop-at={}", u64::midpoint(steps[4], steps[5]));
        assert_eq!(begun(2, &[]).0, 0);
        assert_eq!(begun(3, &[&stop]).0, 75);
        let (code, resumed) = begun(3, &["--resume=auto"]);
        assert_eq!(code, 0);
        let whole = folder.path().join(name);
        for other in [folder.path().join(format!("{name}-2")), resumed] {
            same_run(&whole, &other);
        }
    }
}

/// Damage of a contact with a plane is noticed.
#[test]
fn damaged_contacts_with_planes_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let rows = ["output.series_strain=5e-3", "output.frame_strain=5e-3"];
    run_scene(folder.path(), "disks", DISKS, &rows);
    let whole = folder.path().join("disks/run.h5");
    let path = folder.path().join("run.h5");
    let names = ["i", "wall", "normal_force", "tangential_history", "sliding"];
    for name in names.map(|name| format!("connectivity/wall_contacts/{name}")) {
        std::fs::copy(&whole, &path).expect("a copy");
        change_file(&path, |file| {
            let dataset = file.dataset(&name).expect("a dataset");
            if name.ends_with("force") || name.ends_with("history") {
                let mut values: Vec<f64> = dataset.read_raw().expect("numbers");
                values[3] = f64::from_bits(values[3].to_bits() ^ 1);
                dataset.write_raw(&values).expect("written");
            } else if name.ends_with("/i") {
                let mut values: Vec<u32> = dataset.read_raw().expect("numbers");
                values[3] ^= 1;
                dataset.write_raw(&values).expect("written");
            } else {
                let mut values: Vec<u8> = dataset.read_raw().expect("numbers");
                values[3] ^= 1;
                dataset.write_raw(&values).expect("written");
            }
        });
        let run = RunFile::open_any(&path).expect("a run");
        let refused = run.records(0..run.frames()).expect_err("damage");
        let said = refused.to_string();
        assert!(
            said.contains("damaged") || said.contains("wall 1 or 2"),
            "{said}"
        );
    }
}

/// A checkpoint is the packing of another run, whose planes are where they were: the same forces.
#[test]
fn a_checkpoint_brings_its_planes() {
    let folder = tempfile::tempdir().expect("a folder");
    let first = run_scene(folder.path(), "first", DISKS, &[]);
    let end = |of: &RunFile, row: usize| of.series().column("normal_force")[row];
    let last = first.series().rows() - 1;
    let going = DISKS.replace(
        "grains = 200, radius_min = 0.8e-3, radius_max = 1.2e-3, length = 20e-3",
        "packing = 'first/checkpoint.h5'",
    );
    let going = going.replace("pack.tolerance = 1e-4", "");
    let (file, out) = (
        folder.path().join("second.toml"),
        folder.path().join("second"),
    );
    std::fs::write(&file, going).expect("a scene");
    let undamped = [
        file.display().to_string(),
        "--set=contact.damping_ratio=0".into(),
    ];
    let outcome = gshear_mpi(1, &out, &undamped);
    outcome.digest();
    assert!(
        !outcome.text.contains("not at its load"),
        "{}",
        outcome.text
    );
    let second = RunFile::open_any(&out).expect("a run");
    let [before, after] = [end(&first, last), end(&second, 0)];
    // The dampers of the first hold a little of it.
    assert!((after / before - 1.0).abs() < 0.02, "{before} {after}");

    let said = reducer()
        .arg("spectrum")
        .arg(folder.path().join("first"))
        .output();
    let said = said.expect("a reducer");
    let text = String::from_utf8_lossy(&said.stderr);
    assert_eq!(said.status.code(), Some(2), "{text}");
    assert!(
        text.contains("whose places no frame holds; give a checkpoint"),
        "{text}"
    );
}

/// K of a sphere that is pressed between two planes: each is a spring k_n along its normal and a
/// spring k_t of the slip u + θ × r, r = ±R from the centre. Nothing else: the sphere rolls freely
/// between them, because their normals do not turn with it.
#[test]
fn a_sphere_between_planes_is_held_by_its_springs() {
    const RADIUS: f64 = 1e-3;
    const NORMAL: f64 = 1e3;
    const TANGENTIAL: f64 = 400.0;
    let folder = tempfile::tempdir().expect("a folder");
    let load = 1e-2;
    let height = 2.0 * (RADIUS - load / NORMAL);
    let grain = [[RADIUS; 3], [5e-3, 5e-3, 0.5 * height], [0.0; 3], [0.0; 3]];
    write_grains(
        &folder.path().join("one.data"),
        [10e-3, height],
        false,
        &[grain],
    );
    let scene = format!(
        "dimension = 3
        material.density = 2500
        contact = {{ law = 'hooke', normal_stiffness = {NORMAL:?}, tangential_stiffness = {TANGENTIAL:?}, friction = 0.5, damping_ratio = 0.2 }}
        sample = {{ packing = 'one.data', walls = 'flat' }}
        load.pressure = {:?}
        shear.protocol = [{{ velocity = 0.0, time = 1e-3 }}]",
        load / 1e-4
    );
    run_scene(folder.path(), "one", &scene, &[]);
    let matrix = folder.path().join("k.mtx");
    let mut spectrum = reducer();
    spectrum
        .arg("spectrum")
        .arg(folder.path().join("one/checkpoint.h5"));
    spectrum.args(["--dense", "--export-matrix"]).arg(&matrix);
    succeed(spectrum.arg("--out").arg(folder.path().join("spectrum")));
    let text = std::fs::read_to_string(matrix).expect("K");
    let mut k = [[0.0; 6]; 6];
    for line in text.lines().filter(|line| !line.starts_with('%')).skip(1) {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [row, column] = [words[0], words[1]].map(|n| n.parse::<usize>().expect("a place"));
        k[row - 1][column - 1] = words[2].parse().expect("a number");
    }
    let mut expected = [[0.0; 6]; 6];
    for axis in 0..2 {
        expected[axis][axis] = 2.0 * TANGENTIAL;
        expected[3 + axis][3 + axis] = 2.0 * TANGENTIAL * RADIUS * RADIUS;
    }
    expected[2][2] = 2.0 * NORMAL;
    for (row, column) in (0..6).flat_map(|row| (0..6).map(move |column| (row, column))) {
        let scale = [1.0, RADIUS][usize::from(row > 2)] * [1.0, RADIUS][usize::from(column > 2)];
        let off = (k[row][column] - expected[row][column]).abs();
        assert!(off < 1e-9 * NORMAL * scale, "{row} {column}: {k:?}");
    }
}

/// A grain that is far beyond a plane at the start is a mistake of the file.
#[test]
fn a_grain_beyond_a_plane_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |y: f64| [[1e-3; 3], [3e-3, y, 0.0], [0.0; 3], [0.0; 3]];
    let data = folder.path().join("low.data");
    write_grains(&data, [10e-3, 10e-3], true, &[at(5e-3), at(0.1e-3)]);
    let scene = "
        material.density = 2500
        contact = { law = 'mindlin', normal_stiffness = 1e8, tangential_stiffness = 1e8, friction = 0.5 }
        sample = { packing = 'low.data', walls = 'flat' }
        load.pressure = 1e3
        shear = { inertial_number = 0.01, strain = 0.01 }
    ";
    let (file, out) = (folder.path().join("low.toml"), folder.path().join("low"));
    std::fs::write(&file, scene).expect("a scene");
    let outcome = gshear_mpi(1, &out, &[file.display().to_string()]);
    assert_eq!(outcome.code, 2, "{}", outcome.text);
    let expected = "low.data:12: atom 2 overlaps the flat wall at 0.0 m, a bound of the box, by 9.000e-4 m; the law mindlin takes 7.800e-4 m";
    assert!(outcome.text.contains(expected), "{}", outcome.text);
    assert!(!out.exists());
}

/// A checkpoint of a free surface has a bound below, its plane, and above it the highest grain: so
/// its export is a packing for other boundaries, too.
#[test]
fn a_free_surface_on_a_plane_is_a_packing() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = "
        material.density = 2500
        contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.5, damping_ratio = 0.1 }
        sample = { grains = 60, radius_min = 0.8e-3, radius_max = 1.2e-3, length = 10e-3, boundary = 'free', walls = 'flat' }
        load = { gravity = 9.81, incline = 35 }
        pack.tolerance = 1e-3
        shear.protocol = [{ time = 0.1, bottom_amplitude = 1e-4, bottom_frequency = 100 }]
        output.frame_rows = 1
    ";
    let run = run_scene(folder.path(), "flow", scene, &[]);
    let frame = run.records(1..2).expect("a frame").swap_remove(0);
    let tops = frame.grains.iter().zip(&run.grains().radius);
    let highest = tops.fold(0.0_f64, |most, (grain, r)| most.max(grain.position[1] + r));
    let data = folder.path().join("flow.data");
    let checkpoint = folder.path().join("flow/checkpoint.h5");
    let mut export = reducer();
    export.args(["export", "--format=lammps-data", "--out"]);
    succeed(export.arg(&data).arg(&checkpoint));
    let text = std::fs::read_to_string(&data).expect("a packing");
    let bounds = text.lines().find(|line| line.ends_with("ylo yhi"));
    let high = bounds.and_then(|line| line.split(' ').nth(1)?.parse().ok());
    assert_eq!(high, Some(highest), "{text}");
    for packing in [&data, &checkpoint] {
        let set = format!("sample.packing={}", packing.display());
        let keys = ["grains", "radius_min", "radius_max", "length"];
        let none: Vec<String> = keys
            .iter()
            .map(|key| format!("sample.{key}=none"))
            .collect();
        let mut all = vec![
            &set[..],
            "pack.tolerance=none",
            "shear.protocol=[{ time = 1e-3 }]",
        ];
        all.extend(none.iter().map(String::as_str));
        let name = packing
            .extension()
            .map_or("", |of| of.to_str().unwrap_or(""));
        let again = run_scene(folder.path(), name, scene, &all);
        assert_eq!(again.grains().count(), 60);
    }
}

/// Grains below a plate cannot all roll, so it slides at its own friction: τ = μ of the plate. The
/// sample comes back as a packing, with its bottom and its plate.
#[test]
fn a_plate_slides_on_grains_at_its_friction() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = "
        material = [{ name = 'grains', density = 2500 }, { name = 'plate', density = 2500 }]
        load.pressure = 100.0
        shear = { inertial_number = 1e-2, strain = 0.05 }
        output = { frame_strain = 0.05, series_strain = 1e-3 }
        [contact]
        law = 'hooke'
        normal_stiffness = 1e6
        damping_ratio = 0.3
        friction = 0.5
        [[contact.pair]]
        materials = ['grains', 'plate']
        friction = 0.1
        [sample]
        grains = 150
        radius_min = 0.8e-3
        radius_max = 1.2e-3
        length = 16e-3
        walls = 'flat-top'
        wall_material = 'plate'
    ";
    let slides = |run: &RunFile| {
        let series = run.series();
        let tau = series.column("stress_ratio");
        for tau in &tau[tau.len() / 2..] {
            close(*tau, 0.1, 1e-9, "friction");
        }
    };
    slides(&run_scene(folder.path(), "plate", scene, &[]));

    let data = folder.path().join("plate.data");
    let mut export = reducer();
    export.args(["export", "--format=lammps-data", "--out"]);
    succeed(
        export
            .arg(&data)
            .arg(folder.path().join("plate/checkpoint.h5")),
    );
    let mut arguments = vec![folder.path().join("plate.toml").display().to_string()];
    arguments.extend([
        format!("--set=sample.packing={}", data.display()),
        "--set=pack.skip=true".into(),
    ]);
    for key in ["grains", "radius_min", "radius_max", "length"] {
        arguments.push(format!("--set=sample.{key}=none"));
    }
    let out = folder.path().join("again");
    let again = gshear_mpi(2, &out, &arguments);
    let said = "the bottom is type 2, the top is flat";
    assert!(again.text.contains(said), "{}", again.text);
    slides(&RunFile::open(&out).expect("a run"));
    arguments.push("--set=bookkeeping.simd=portable".into());
    arguments.push("--set=output.series_strain=0.0".into());
    let portable = gshear_mpi(1, &folder.path().join("portable"), &arguments);
    assert_eq!(portable.digest(), again.digest());
}

/// τ of frames between rows follows from their contacts with the planes, and is the one that a row
/// would have.
#[test]
fn frames_between_rows_have_their_stress_ratio() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, rows) in [("beside", "0.002"), ("at", "0.005")] {
        let rows = format!("output.series_strain={rows}");
        let set = ["shear.strain=0.03", "output.frame_strain=0.005", &rows];
        run_scene(folder.path(), name, DISKS, &set);
    }
    let regions = |name: &str| {
        let mut regions = reducer();
        regions.arg("regions").arg(folder.path().join(name));
        regions.output().expect("the program starts")
    };
    let ratios = |name: &str| -> Vec<f64> {
        assert_eq!(regions(name).status.code(), Some(0));
        let table = folder.path().join(name).join("regions.csv");
        let table = std::fs::read_to_string(table).expect("a table");
        let column = table
            .lines()
            .skip(1)
            .filter_map(|line| line.split(',').nth(3));
        column.map(|tau| tau.parse().expect("a number")).collect()
    };
    let [beside, at] = ["beside", "at"].map(ratios);
    assert!(at.len() > 4 && at.len() == beside.len(), "{at:?}");
    for (beside, at) in beside.iter().zip(&at) {
        assert!((beside - at).abs() < 1e-11, "{beside} {at}");
    }
}
