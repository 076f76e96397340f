//! The contracts in every kind of part of a protocol, in 2D and in 3D, under forces and under a
//! spring: bits compared, never approximately.

use crate::common::protocols::{
    Case, DISKS, DISKS_BELOW_A_FREE_SURFACE, DISKS_IN_A_CHANGING_CELL, DISKS_UNDER_A_SERVO,
    DISKS_WITHOUT_WALLS, SPHERES, SPHERES_BELOW_A_FREE_SURFACE, SPHERES_BETWEEN_FLAT_WALLS,
    SPHERES_IN_A_CHANGING_CELL, SPHERES_UNDER_A_FLAT_TOP, SPHERES_UNDER_A_SERVO,
    SPHERES_UNDER_A_SPRING, SPHERES_WITHOUT_WALLS, SPHERES_WITHOUT_WALLS_UNDER_A_SERVO,
};
use crate::common::{self, copy_folder, gshear_mpi, reducer, same_run};
use gshear_dem::state::body;
use gshear_store::run_reader::RunFile;
use tempfile::TempDir;

/// Contracts 1 to 3: ranks, skin, threads, instruction set, other output, a stop within every part.
/// Portable code is slow, so it has the last part alone. Returns a folder that holds the run `one`.
fn keeps_the_contracts(case: &Case) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let expected = case.run(&at("one"), 1, &[]).digest();

    // The others have this start, on two ranks.
    let begun = case.run(&at("begun"), 2, &["--stop-at=1"]);
    assert_eq!(begun.code, 75, "{}", begun.text);
    let on = |name: &str, ranks: usize, further: &[&str]| {
        if !at(name).exists() {
            copy_folder(&at("begun"), &at(name));
        }
        let checkpoint = at(name).join("checkpoint.h5");
        let mut arguments = vec![format!("--resume={}", checkpoint.display())];
        arguments.extend(further.iter().map(ToString::to_string));
        gshear_mpi(ranks, &at(name), &arguments)
    };
    let skin = "--set=bookkeeping.skin=0.3";
    let restless = "--set=bookkeeping.rebuild_every=3";
    let others = [skin, restless, "--threads=2"];
    for (ranks, further) in [(2, &others[..1]), (3, &others)] {
        let name = format!("on-{ranks}");
        let outcome = on(&name, ranks, further);
        assert_eq!(outcome.digest(), expected, "{ranks} ranks");
        same_run(&at("one"), &at(&name));
    }
    let other = [
        "--set=output.series_rows=3",
        "--set=output.frame_rows=none",
        "--set=output.energy=false",
        "--set=bookkeeping.band_grains=30",
        "--set=bookkeeping.steps_at_once=9",
        common::avx2(),
    ];
    assert_eq!(on("other", 1, &other).digest(), expected);
    for (k, step) in case.stops().into_iter().enumerate() {
        let stop = format!("--stop-at={step}");
        let bands = "--set=bookkeeping.band_grains=30";
        let outcome = on("broken", 1 + k % 3, &[&stop, bands]);
        assert_eq!(outcome.code, 75, "step {step}: {}", outcome.text);
    }
    let portable = ["--set=bookkeeping.simd=portable"];
    assert_eq!(on("broken", 1, &portable).digest(), expected);
    same_run(&at("one"), &at("broken"));
    folder
}

#[test]
fn of_disks() {
    keeps_the_contracts(&DISKS);
}

#[test]
fn of_spheres() {
    keeps_the_contracts(&SPHERES);
}

#[test]
fn of_spheres_between_flat_walls() {
    keeps_the_contracts(&SPHERES_BETWEEN_FLAT_WALLS);
}

#[test]
fn of_spheres_under_a_flat_top() {
    let folder = keeps_the_contracts(&SPHERES_UNDER_A_FLAT_TOP);
    let run = RunFile::open(&folder.path().join("one")).expect("a run");
    assert_eq!(run.boundary().name, "flat top");
    let bodies = run.state(0).expect("a state").0;
    let count = |body| bodies.iter().filter(|g| g.body == body).count();
    assert!(count(body::BOTTOM) > 0 && count(body::TOP) == 0);
}

#[test]
fn of_spheres_under_a_spring() {
    keeps_the_contracts(&SPHERES_UNDER_A_SPRING);
}

#[test]
fn of_disks_without_walls() {
    keeps_the_contracts(&DISKS_WITHOUT_WALLS);
}

#[test]
fn of_spheres_without_walls() {
    keeps_the_contracts(&SPHERES_WITHOUT_WALLS);
}

#[test]
fn of_disks_in_a_changing_cell() {
    keeps_the_contracts(&DISKS_IN_A_CHANGING_CELL);
}

#[test]
fn of_spheres_in_a_changing_cell() {
    keeps_the_contracts(&SPHERES_IN_A_CHANGING_CELL);
}

#[test]
fn of_disks_below_a_free_surface() {
    keeps_the_contracts(&DISKS_BELOW_A_FREE_SURFACE);
}

#[test]
fn of_spheres_below_a_free_surface() {
    keeps_the_contracts(&SPHERES_BELOW_A_FREE_SURFACE);
}

/// Besides the contracts: the budget is closed, the wall moves by v = gain (F - N), and a window is
/// replayed with the same bits.
fn of_a_servo(case: &Case, varies: bool) {
    let folder = keeps_the_contracts(case);
    let at = folder.path().join("one");
    let run = RunFile::open(&at).expect("a run");
    let series = run.series();
    let column = |name: &str| series.column(name);
    // At first there is no work to compare with.
    let residual = column("energy_residual").iter().skip(series.rows() / 4);
    let worst = residual.fold(0.0_f64, |most, x| most.max(x.abs()));
    println!("greatest residual {worst:e}");
    assert!(worst < 1e-3, "{worst}");

    let text = std::fs::read_to_string(at.join("scene.toml")).expect("a scene");
    let number = |name: &str| -> f64 {
        let line = text.lines().find(|line| line.starts_with(name));
        let value = line.and_then(|line| line.split('=').nth(1));
        value.expect("a value").trim().parse().expect("a number")
    };
    let [force, pressure] = ["normal_force", "pressure"].map(|of| run.number(of).expect("a load"));
    let gain = number("servo_gain =") * pressure / force;
    let scale = gain * force;
    let load = if varies {
        column("imposed_normal_force").to_vec()
    } else {
        vec![force; series.rows()]
    };
    let rows = column("normal_force").iter().zip(&load);
    let follows = |((force, load), velocity): ((&f64, &f64), &f64)| {
        (velocity - gain * (force - load)).abs() < 1e-9 * scale
    };
    let followed = rows
        .zip(column("wall_velocity"))
        .filter(|row| follows(*row));
    let with_a_load = load.iter().filter(|load| !load.is_nan()).count();
    // The row at a jump of the load has the velocity of the next one.
    let followed = followed.count() + case.parts.len();
    assert!(followed >= with_a_load && with_a_load > 100, "{followed}");

    let out = folder.path().join("again");
    let [from, to] = [1, 3].map(|quarter| series.time[quarter * series.rows() / 4]);
    let mut command = reducer();
    command.arg("replay").arg(&at);
    command
        .arg(format!("--time={from}..{to}"))
        .arg("--out")
        .arg(&out);
    let words = common::succeed(&mut command).stdout;
    let words = String::from_utf8(words).expect("text");
    assert!(words.contains("to the last bit"), "{words}");
}

#[test]
fn of_disks_under_a_servo() {
    of_a_servo(&DISKS_UNDER_A_SERVO, true);
}

#[test]
fn of_spheres_without_walls_under_a_servo() {
    of_a_servo(&SPHERES_WITHOUT_WALLS_UNDER_A_SERVO, false);
}

#[test]
fn of_spheres_under_a_servo() {
    of_a_servo(&SPHERES_UNDER_A_SERVO, false);
}

/// A cyclic strain is that of the far end of a spring, and the wall follows m ẍ = k (x_d - x) - S.
#[test]
fn a_spring_is_pulled_by_a_cyclic_strain() {
    let folder = tempfile::tempdir().expect("a folder");
    let case = Case {
        parts: &["strain_amplitude = 0.01, frequency = 5e3, cycles = 1"],
        // A row per step.
        further: &["output.series_rows=10000"],
        ..SPHERES_UNDER_A_SPRING
    };
    case.run(folder.path(), 1, &[]).digest();
    let run = RunFile::open(folder.path()).expect("a run");
    let series = run.series();
    let column = |name: &str| series.column(name);
    let amplitude = 0.01 * run.height();
    let (drive, slip) = (column("drive_displacement"), column("slip"));
    for (time, drive) in series.time.iter().zip(drive) {
        let expected = amplitude * (std::f64::consts::TAU * 5e3 * time).sin();
        assert!((drive - expected).abs() < 1e-12 * amplitude, "{time}");
    }
    let grains = run.grains();
    let of_top = grains.mass.iter().zip(&grains.body);
    let mass: f64 = of_top.filter(|(_, body)| **body == 2).map(|(m, _)| m).sum();
    let stiffness = run.number("spring_stiffness").expect("a spring");
    let (shear, rate) = (column("shear_force"), column("slip_rate"));
    let acceleration = |k: usize| (stiffness * (drive[k] - slip[k]) - shear[k]) / mass;
    let fastest = rate.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    assert!(series.rows() > 300 && fastest > 0.0);
    for k in 1..series.rows() {
        let step = series.time[k] - series.time[k - 1];
        let kicks = 0.5 * step * (acceleration(k - 1) + acceleration(k));
        let found = rate[k] - rate[k - 1];
        assert!(
            (found - kicks).abs() < 1e-12 * fastest,
            "{k}: {found} {kicks}"
        );
    }
}
