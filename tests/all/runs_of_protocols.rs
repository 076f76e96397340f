//! Protocols of walls, through the real program: closed forms of what is imposed, and the energy
//! budget.

use std::path::Path;

use crate::common::crossing::{PACKED, whole};
use crate::common::{gshear_mpi, program};
use gshear_store::run_reader::RunFile;

/// Ramps, steps and oscillations of all that a protocol can impose, in nine short parts.
const MIXED: &str = "shear.protocol=[
    { velocity = 0.3, time = 1e-7 },
    { velocity = 0.3, time = 2e-7, pressure = 5e5, pressure_end = 8e5 },
    { strain_amplitude = 0.01, frequency = 4e6, cycles = 1.25 },
    { shear_stress = 1e4, shear_stress_end = 2e5, time = 2e-7, pressure = 6e5 },
    { shear_stress = 1e5, shear_stress_amplitude = 5e4, frequency = 1e7, time = 1e-7 },
    { velocity = 0.3, time = 2e-7, wall_velocity = 0 },
    { velocity = 0.3, time = 2e-7, pressure_amplitude = 1e5, pressure_frequency = 2e7 },
    { velocity = 0.3, time = 2e-7, bottom_amplitude = 2e-9, bottom_frequency = 1e7 },
    { velocity = 0.3, time = 2e-7, bottom_amplitude_x = 8e-9, bottom_frequency_x = 9e6, bottom_phase_x = 30 },
]";

/// Runs them in `folder`.
fn run(folder: &Path) -> RunFile {
    let sets = [
        MIXED,
        "shear.inertial_number=none",
        "shear.strain=none",
        "output.frame_strain=none",
        "output.series_strain=none",
        "output.checkpoint_strain=none",
        "output.series_rows=20",
        "output.frame_rows=2",
    ];
    whole(folder, 1, &[&PACKED[..], &sets].concat()).digest();
    RunFile::open(folder).expect("a run")
}

/// Imposed values are closed forms of the time, the height is constant to the last bit, and the
/// budget is closed.
#[test]
fn what_is_imposed_is_a_closed_form() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = run(folder.path());
    let series = run.series();
    let column = |name: &str| series.column(name);
    let (load, force) = (
        column("imposed_normal_force"),
        column("imposed_shear_force"),
    );
    let length = 21e-6;
    // The parts begin at these times up to a step each.
    let within = |row: usize, from: f64, to: f64| {
        let (t, margin) = (series.time[row], 5e-9);
        t > from + margin && t < to - margin
    };
    let step = series.time[1] / series.step[1] as f64;
    let rows = |from: f64, to: f64| (0..series.rows()).filter(move |&k| within(k, from, to));
    let mut found = 0;
    for k in rows(1e-7, 3e-7) {
        let expected = length * (5e5 + 3e5 * (series.time[k] - 1e-7) / 2e-7);
        // The part begins at a whole step.
        let error = 3e5 * length * 2.0 * step / 2e-7;
        assert!((load[k] - expected).abs() < error, "{k}");
        found += 1;
    }
    let drive = column("drive_displacement");
    for k in rows(3e-7, 6.125e-7) {
        assert_eq!(load[k], 8e5 * length);
        let cycles = 4e6 * (series.time[k] - 3e-7);
        let amplitude = 0.01 * height(&run);
        let expected = 0.3 * 3e-7 + amplitude * (std::f64::consts::TAU * cycles).sin();
        let error = (0.3 + amplitude * 3e7) * 2.0 * step;
        assert!((drive[k] - expected).abs() < error, "{k}");
        found += 1;
    }
    for k in rows(6.125e-7, 8.125e-7) {
        let expected = length * (1e4 + 1.9e5 * (series.time[k] - 6.125e-7) / 2e-7);
        let error = 1.9e5 * length * 3.0 * step / 2e-7;
        assert!((force[k] - expected).abs() < error, "{k}");
        found += 1;
    }
    let heights: Vec<u64> = rows(9.125e-7, 1.1125e-6)
        .map(|k| {
            assert!(load[k].is_nan() && force[k].is_nan());
            column("wall_height")[k].to_bits()
        })
        .collect();
    assert!(heights.len() > 10 && heights.iter().all(|h| *h == heights[0]));
    let bottom = column("bottom_displacement");
    let greatest = bottom.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    assert!((1.8e-9..=2e-9).contains(&greatest), "{greatest}");
    let along = column("bottom_displacement_x");
    let last = series.time[series.rows() - 1];
    for k in rows(last - 2e-7, last) {
        // From the end, because parts are of whole steps.
        let turns = |t: f64| std::f64::consts::TAU * (9e6 * t + 30.0 / 360.0);
        let expected = 8e-9 * (turns(series.time[k] - last + 2e-7).sin() - turns(0.0).sin());
        let error = 8e-9 * 9e6 * std::f64::consts::TAU * step;
        assert!(
            (along[k] - expected).abs() < error,
            "{k}: {} {expected}",
            along[k]
        );
        assert_eq!(bottom[k], bottom[series.rows() - 1]);
        found += 1;
    }
    let first = series
        .time
        .iter()
        .position(|t| *t > last - 2e-7 - 3.0 * step);
    assert!(
        along[..first.expect("the last part")]
            .iter()
            .all(|x| *x == 0.0)
    );
    assert!(found > 55, "{found}");
    let residual = column("energy_residual");
    let worst = residual
        .iter()
        .skip(5)
        .fold(0.0_f64, |most, x| most.max(x.abs()));
    println!("greatest residual {worst:e}");
    assert!(worst < 1e-3, "{worst}");
}

/// H (m).
fn height(run: &RunFile) -> f64 {
    run.series().column("wall_height")[0]
}

/// A drive that is ramped moves by the integral of its velocity, from rest and back to it, whatever
/// moves with it; frames, rows and strains follow it.
#[test]
fn a_ramp_is_its_integral() {
    let folder = tempfile::tempdir().expect("a folder");
    let (velocity, ramp) = (0.8, 4e-7);
    let strain = "shear.strain=0.05";
    let of_strain = [
        "shear.inertial_number=none",
        "shear.velocity=0.8",
        "shear.ramp=4e-7",
        strain,
        "output.frame_strain=0.01",
        "output.series_strain=2e-3",
    ];
    let of_parts = [
        "shear.inertial_number=none",
        "shear.strain=none",
        "shear.protocol=[{ velocity = 0.8, ramp = 4e-7, distance = 4e-7 }, { velocity = 0, ramp = 2e-7, time = 3e-7 }]",
        "output.frame_strain=none",
        "output.series_strain=none",
        "output.checkpoint_strain=none",
        "output.series_rows=20",
        "output.frame_rows=5",
    ];
    let without_walls = [&of_strain[..], &["sample.boundary=periodic"]].concat();
    for (name, sets, sample) in [
        ("strain", &of_strain[..], &PACKED[..]),
        ("parts", &of_parts, &PACKED),
        ("images", &without_walls, &[]),
    ] {
        let at = folder.path().join(name);
        whole(&at, 1, &[sample, sets].concat()).digest();
        let run = RunFile::open(&at).expect("a run");
        let series = run.series();
        // How long the whole speed lasts.
        let full = if name == "parts" {
            let distance = 4e-7;
            (distance - 0.5 * velocity * ramp) / velocity
        } else {
            f64::INFINITY
        };
        let position = |t: f64| {
            let begins = velocity * t.min(ramp).powi(2) / (2.0 * ramp);
            let goes = velocity * (t - ramp).clamp(0.0, full);
            let ends = (t - ramp - full).clamp(0.0, 2e-7);
            begins + goes + velocity * (ends - 0.5 * ends * ends / 2e-7)
        };
        let speed = |t: f64| {
            let ended = ((t - ramp - full) / 2e-7).clamp(0.0, 1.0);
            velocity * (t / ramp).min(1.0) * (1.0 - ended)
        };
        let step = series.time[1] / series.step[1] as f64;
        for (k, t) in series.time.iter().enumerate() {
            // Parts begin at whole steps.
            let error = if name == "parts" {
                velocity * step
            } else {
                1e-18
            };
            for column in ["drive_displacement", "slip"] {
                let moved = series.column(column)[k];
                assert!((moved - position(*t)).abs() <= error, "{name} {column} {t}");
            }
            let error = if name == "parts" {
                velocity * 2.0 * step / 2e-7
            } else {
                1e-12
            };
            for column in ["drive_velocity", "slip_rate"] {
                let found = series.column(column)[k];
                assert!((found - speed(*t)).abs() <= error, "{name} {column} {t}");
            }
        }
        let strains = run.frame_strains().expect("strains");
        let expected = |t: &f64| position(*t) / run.number("height_start").expect("H");
        for (strain, t) in strains.iter().zip(run.frame_times()) {
            assert!((strain - expected(t)).abs() < 1e-3, "{name} {t}: {strain}");
        }
        assert!(!series.has("imposed_normal_force"));
        if name == "parts" {
            assert_eq!((run.frames(), series.rows()), (11, 41));
            continue;
        }
        let per_step = velocity * step / run.number("height_start").expect("H");
        assert_eq!((strains.len(), series.rows()), (6, 26));
        for (k, strain) in strains.iter().enumerate() {
            assert!(
                (strain - 0.01 * k as f64).abs() <= 0.51 * per_step,
                "{strain}"
            );
        }
    }
}

/// Disks that a wall shears fast.
const FAST: &str = "
    material.density = 2500
    contact = { law = 'hooke', normal_stiffness = 1e7, friction = 0.4, restitution = 0.5 }
    sample = { grains = 200, radius_min = 0.4e-3, radius_max = 0.6e-3, length = 12e-3 }
    load.pressure = 1e3
    pack.tolerance = 1e-5
    shear = { inertial_number = 0.2, strain = 3.0 }
    output = { frame_strain = 0, series_strain = 1e-2 }
";

/// A wall that jumps to I = 0.2 leaves the sample, and the message says what helps. Each of it
/// does.
#[test]
fn what_is_said_of_a_wall_that_leaves_helps() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("fast.toml");
    std::fs::write(&file, FAST).expect("a scene");
    let shear = |name: &str, sets: &[&str]| {
        let mut arguments = vec![file.display().to_string()];
        arguments.extend(sets.iter().map(|set| format!("--set={set}")));
        gshear_mpi(1, &folder.path().join(name), &arguments)
    };
    let thrown = shear("thrown", &[]);
    assert_eq!(thrown.code, 3, "{}", thrown.text);
    let (_, advice) = thrown
        .text
        .split_once("the top wall has left the sample")
        .expect("why");
    for (word, set) in [
        ("load.control = \"servo\"", "load.control=servo"),
        ("shear.ramp", "shear.ramp=0.2"),
        ("sample.boundary = \"periodic\"", "sample.boundary=periodic"),
    ] {
        assert!(advice.contains(word), "{advice}");
        let ended = shear(&set.replace(['=', '.'], "-"), &[set]);
        assert_eq!(ended.code, 0, "{set}: {}", ended.text);
    }
    assert!(!advice.contains("pack.skip"), "{advice}");
}

/// The wall follows m_w ÿ = F - N with the mass that the scene gives it, and a branch may change
/// it.
#[test]
fn a_wall_has_the_mass_of_the_scene() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let sets = [
        &PACKED[..],
        &["shear.inertial_number=1e-2", "shear.strain=1e-3"],
    ]
    .concat();
    let rows = ["output.series_strain=1e-9", "output.frame_strain=0"];
    for mass in [1e-7, 3e-7] {
        let mass_of_wall = format!("load.wall_mass={mass:e}");
        let name = format!("{mass:e}");
        let all = [&sets[..], &rows, &[&mass_of_wall[..]]].concat();
        whole(&at(&name), 1, &all).digest();
        let run = RunFile::open(&at(&name)).expect("a run");
        let series = run.series();
        let [velocity, force] = ["wall_velocity", "normal_force"].map(|of| series.column(of));
        let load = run.number("normal_force").expect("N");
        // Velocity Verlet: a step has the mean of the forces at its ends.
        for k in 1..series.rows() {
            let step = series.time[k] - series.time[k - 1];
            let mean = 0.5 * (force[k] + force[k - 1]) - load;
            let expected = velocity[k - 1] + mean / mass * step;
            let scale = load / mass * step;
            assert!((velocity[k] - expected).abs() < 1e-9 * scale, "{mass} {k}");
        }
    }
    let [light, heavy] = ["1e-7", "3e-7"].map(|name| at(name).join("checkpoint.h5"));
    let longer = "shear.strain=1.1e-3";
    let branch = |from: &Path, name: &str, set: &str| {
        let (from, to) = (
            format!("--resume={}", from.display()),
            format!("--branch={}", at(name).display()),
        );
        let mut program = program(1);
        program
            .args([&from, &to])
            .args(["--set", set, "--set", longer]);
        let output = program.output().expect("the program starts");
        assert!(output.status.success(), "{output:?}");
        let run = RunFile::open(&at(name)).expect("a run");
        let (series, load) = (run.series(), run.number("normal_force").expect("N"));
        let [velocity, force] = ["wall_velocity", "normal_force"].map(|of| series.column(of));
        let last = series.rows() - 1;
        let step = series.time[last] - series.time[last - 1];
        let mean = 0.5 * (force[last] + force[last - 1]) - load;
        mean * step / (velocity[last] - velocity[last - 1])
    };
    let found = branch(&light, "heavier", "load.wall_mass=3e-7");
    assert!((found / 3e-7 - 1.0).abs() < 1e-6, "{found}");
    let found = branch(&heavy, "lighter", "load.wall_mass=1e-7");
    assert!((found / 1e-7 - 1.0).abs() < 1e-6, "{found}");
}
