//! What a branch may change, through the real program.

use std::path::Path;

use crate::common::gshear_mpi;
use gshear_store::run_reader::RunFile;

/// Disks between walls of grains, or flat ones, and spheres without walls, at a constant velocity.
fn scene(kind: &str) -> String {
    let (dimension, sample) = match kind {
        "walls" => (2, "grains = 200, length = 15e-3"),
        "flat" => (2, "grains = 200, length = 15e-3, walls = 'flat'"),
        _ => (
            3,
            "grains = 150, length = 5e-3, width = 5e-3, boundary = 'periodic'",
        ),
    };
    let stiffness = if dimension == 2 { 1e7 } else { 1e4 };
    format!(
        "
        dimension = {dimension}
        material.density = 2500
        contact = {{ law = 'hooke', normal_stiffness = {stiffness}, friction = 0.4, restitution = 0.5 }}
        sample = {{ radius_min = 0.4e-3, radius_max = 0.6e-3, {sample} }}
        load.pressure = 1e4
        pack.tolerance = 1e-3
        time.step = 5e-7
        shear = {{ velocity = 2.0, strain = 0.1 }}
        output = {{ frame_strain = 0.0, series_strain = 1e-9 }}
        "
    )
}

fn run(folder: &Path, name: &str, arguments: &[&str]) -> RunFile {
    let arguments: Vec<String> = arguments.iter().map(ToString::to_string).collect();
    let outcome = gshear_mpi(1, &folder.join(name), &arguments);
    assert!([0, 75].contains(&outcome.code), "{}", outcome.text);
    RunFile::open_any(&folder.join(name)).expect("a run")
}

/// The mass that the top has along its normal, from the force on it and its velocity in every step:
/// m Δv = Δt (F - N), with the mean force of both ends.
fn inertia(run: &RunFile, load: f64) -> f64 {
    let series = run.series();
    let [force, velocity] = ["normal_force", "wall_velocity"].map(|name| series.column(name));
    let steps = 1..series.rows();
    let of = |row: usize| {
        let step = series.time[row] - series.time[row - 1];
        let pushed = step * (0.5 * (force[row] + force[row - 1]) - load);
        (pushed, velocity[row] - velocity[row - 1])
    };
    let (mut above, mut below) = (0.0, 0.0);
    for (pushed, change) in steps.map(of) {
        above += pushed * pushed.signum();
        below += change * pushed.signum();
    }
    above / below
}

/// A branch with grains of another density has a top of that density, too.
#[test]
fn another_density_is_that_of_the_top_too() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    for kind in ["walls", "flat", "images"] {
        std::fs::write(at("scene.toml"), scene(kind)).expect("a scene");
        let before = format!("{kind}-before");
        run(folder.path(), &before, &[&at("scene.toml"), "--stop-at=40"]);
        let resume = format!("--resume={}", at(&before));
        let branch = |name: &str, density: &str| {
            let name = format!("{kind}-{name}");
            let to = format!("--branch={}", at(&name));
            let mut program = crate::common::program(1);
            program
                .args([&resume, &to])
                .args(["--stop-at=80", "--set", density]);
            let output = program.output().expect("the program starts");
            assert_eq!(output.status.code(), Some(75), "{output:?}");
            let run = RunFile::open_any(&folder.path().join(&name)).expect("a run");
            let load = run.number("normal_force").expect("a load");
            inertia(&run, load)
        };
        let [same, other] = [
            ("same", "material.density=2500"),
            ("other", "material.density=25000"),
        ]
        .map(|(name, density)| branch(name, density));
        println!("{kind}: {same:e} {other:e}");
        assert!(
            (other / same / 10.0 - 1.0).abs() < 1e-6,
            "{kind}: {same} {other}"
        );
    }
}

/// A wall whose spring is taken away goes on from where it is.
#[test]
fn a_wall_without_its_spring_goes_on_from_its_place() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    for kind in ["walls", "flat", "images"] {
        std::fs::write(at("scene.toml"), scene(kind)).expect("a scene");
        let before = format!("{kind}-before");
        let first = [
            &at("scene.toml")[..],
            "--stop-at=200",
            "--set=shear.spring_number=1",
        ];
        let held = run(folder.path(), &before, &first);
        let last = |run: &RunFile, name: &str| *run.series().column(name).last().expect("a row");
        let slip = last(&held, "slip");
        assert!(
            slip < 0.5 * last(&held, "drive_displacement"),
            "{kind}: the spring is stretched"
        );
        let name = format!("{kind}-free");
        let mut program = crate::common::program(1);
        program
            .arg("--resume")
            .arg(at(&before))
            .arg("--branch")
            .arg(at(&name));
        program.args(["--set=shear.spring_number=none", "--stop-at=210"]);
        let output = program.output().expect("the program starts");
        assert_eq!(output.status.code(), Some(75), "{output:?}");
        let free = RunFile::open_any(&folder.path().join(&name)).expect("a run");
        let slips = free.series().column("slip");
        for (k, after) in slips.iter().enumerate() {
            let expected = slip + 2.0 * 5e-7 * (k + 1) as f64;
            assert!(
                (after / expected - 1.0).abs() < 1e-9,
                "{kind}: {after} {expected}"
            );
        }
        assert_eq!(free.series().column("drive_displacement"), slips);
        let residual = free.series().column("energy_residual");
        let worst = residual.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        assert!(worst < 1e-2, "{kind}: {worst}");
    }
}

/// Energies are counted in a unit of the law, so a branch with another one begins its budget anew.
#[test]
fn the_energy_budget_begins_anew_with_other_contacts() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(at("scene.toml"), scene("walls")).expect("a scene");
    run(
        folder.path(),
        "before",
        &[&at("scene.toml"), "--stop-at=500"],
    );
    for (name, set, anew) in [
        ("stiffer", "contact.normal_stiffness=2e7", true),
        ("rough", "contact.friction=0.6", true),
        ("heavier", "material.density=5000", true),
        ("loaded", "load.pressure=1.1e4", false),
    ] {
        let mut program = crate::common::program(1);
        program
            .arg("--resume")
            .arg(at("before"))
            .arg("--branch")
            .arg(at(name));
        let output = program.args(["--stop-at=1000", "--set", set]).output();
        let output = output.expect("the program starts");
        assert_eq!(output.status.code(), Some(75), "{output:?}");
        let branch = RunFile::open_any(&folder.path().join(name)).expect("a run");
        let column = |name: &str| branch.series().column(name);
        let begun = column("work_drive")[0] == 0.0 && column("dissipated_friction")[0] == 0.0;
        assert_eq!(begun, anew, "{name}");
        let last = column("energy_residual").last().expect("a row").abs();
        assert!(last < 0.02, "{name}: {last}");
    }
}
