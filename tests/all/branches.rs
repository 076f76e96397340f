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
    let step = 2.5e-7;
    for kind in ["walls", "flat", "images"] {
        let scene = scene(kind).replace("time.step = 5e-7", &format!("time.step = {step:e}"));
        std::fs::write(at("scene.toml"), scene).expect("a scene");
        let before = format!("{kind}-before");
        let first = [
            &at("scene.toml")[..],
            "--stop-at=400",
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
        program.args(["--set=shear.spring_number=none", "--stop-at=420"]);
        let output = program.output().expect("the program starts");
        assert_eq!(output.status.code(), Some(75), "{output:?}");
        let free = RunFile::open_any(&folder.path().join(&name)).expect("a run");
        let slips = free.series().column("slip");
        for (k, after) in slips.iter().enumerate() {
            let expected = slip + 2.0 * step * (k + 1) as f64;
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

/// A branch of a run in `before`, under another name in the same folder.
fn branch(folder: &Path, [before, name]: [&str; 2], more: &[&str]) -> RunFile {
    let mut program = crate::common::program(1);
    program.arg("--resume").arg(folder.join(before));
    program.arg("--branch").arg(folder.join(name)).args(more);
    let output = program.output().expect("the program starts");
    let code = output.status.code();
    assert!(matches!(code, Some(0 | 75)), "{output:?}");
    RunFile::open_any(&folder.join(name)).expect("a run")
}

/// The first rows of a branch go on from the last one of its checkpoint, in steps of its own.
fn goes_on(before: &RunFile, after: &RunFile, time_step: f64, name: &str) {
    let [last, first] = [
        *before.series().time.last().expect("a row"),
        after.series().time[0],
    ];
    assert!(
        (first - last - time_step).abs() < 1e-9 * last,
        "{name}: {last} {first}"
    );
    for pair in after.series().time.windows(2) {
        assert!(
            (pair[1] - pair[0] - time_step).abs() < 1e-9 * last,
            "{name}"
        );
    }
}

/// With half the time step or another part of it, a branch begins at the time and place of its
/// checkpoint; the drive goes on with its velocity, and a stop and resume in it changes nothing.
#[test]
fn a_branch_with_another_time_step_goes_on_at_its_time_and_place() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    for kind in ["walls", "flat", "images"] {
        std::fs::write(at("scene.toml"), scene(kind)).expect("a scene");
        let before = format!("{kind}-before");
        let first = run(folder.path(), &before, &[&at("scene.toml"), "--stop-at=40"]);
        for (time_step, step) in [(2.5e-7, 80), (3e-7, 67), (5.5e-7, 36)] {
            let name = format!("{kind}-{time_step:e}");
            let set = format!("--set=time.step={time_step:e}");
            let stop = |more: u64| format!("--stop-at={}", step + more);
            let whole = branch(folder.path(), [&before, &name], &[&set, &stop(10)]);
            assert_eq!(whole.series().step[0], step + 1, "{name}");
            goes_on(&first, &whole, time_step, &name);
            let series = whole.series();
            for (time, place) in series.time.iter().zip(series.column("drive_displacement")) {
                assert!((place - 2.0 * time).abs() < 1e-12 * time, "{name}: {place}");
            }
            let parts = format!("{name}-parts");
            branch(folder.path(), [&before, &parts], &[&set, &stop(5)]);
            let resumed = gshear_mpi(
                2,
                &folder.path().join(&parts),
                &[format!("--resume={}", at(&parts)), stop(10)],
            );
            assert_eq!(resumed.code, 75, "{}", resumed.text);
            let reduced = crate::common::reducer()
                .arg("compare")
                .args([at(&name), at(&parts)])
                .output()
                .expect("the reducer starts");
            assert!(reduced.status.success(), "{name}: {reduced:?}");
        }
    }
}

/// What changes the time step by itself, and the speed of a given inertial number.
#[test]
fn a_branch_may_change_what_decides_the_time_step() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    let text = scene("walls")
        .replace("time.step = 5e-7", "")
        .replace("velocity = 2.0", "inertial_number = 0.1");
    std::fs::write(at("scene.toml"), text).expect("a scene");
    let first = run(
        folder.path(),
        "before",
        &[&at("scene.toml"), "--stop-at=40"],
    );
    let last = |name: &str| *first.series().column(name).last().expect("a row");
    let old = first.number("time_step").expect("a number");
    for (name, set, faster) in [
        ("stiffer", "contact.normal_stiffness=4e7", 1.0),
        ("heavier", "material.density=10000", 0.5),
        ("pressed", "load.pressure=4e4", 2.0),
    ] {
        let set = format!("--set={set}");
        let after = branch(folder.path(), ["before", name], &[&set, "--stop-at=200"]);
        let new = after.number("time_step").expect("a number");
        goes_on(&first, &after, new, name);
        assert!(
            name == "pressed" || (new / old - 1.0).abs() > 0.1,
            "{name}: {new} {old}"
        );
        let velocity = after.series().column("drive_velocity")[0];
        let expected = faster * last("drive_velocity");
        assert!(
            (velocity / expected - 1.0).abs() < 1e-9,
            "{name}: {velocity} {expected}"
        );
        let place = after.series().column("drive_displacement")[0];
        let expected = last("drive_displacement") + velocity * new;
        assert!(
            (place / expected - 1.0).abs() < 1e-9,
            "{name}: {place} {expected}"
        );
    }
}

/// Parts of a protocol go on where they were: a push, an oscillation and a hold, with the branch in
/// each and between two; and below a free surface, where nothing is driven.
#[test]
fn protocols_go_on_with_another_time_step() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    let parts = "shear.protocol = [
        { velocity = 2.0, time = 5e-5 },
        { strain_amplitude = 1e-3, frequency = 1e4, time = 1e-4 },
        { velocity = 0.0, time = 5e-5 },
    ]";
    let text = scene("walls")
        .replace("shear = { velocity = 2.0, strain = 0.1 }", parts)
        .replace(
            "frame_strain = 0.0, series_strain = 1e-9",
            "frame_rows = 0, series_rows = 100000",
        );
    std::fs::write(at("scene.toml"), text).expect("a scene");
    let free = scene("walls")
        .replace(
            "load.pressure = 1e4",
            "load = { gravity = 9.81, incline = 20.0 }",
        )
        .replace("length = 15e-3", "length = 15e-3, boundary = 'free'")
        .replace(
            "shear = { velocity = 2.0, strain = 0.1 }",
            "shear.protocol = [{ time = 5e-5 }]",
        )
        .replace(
            "frame_strain = 0.0, series_strain = 1e-9",
            "frame_rows = 0, series_rows = 100000",
        );
    std::fs::write(at("free.toml"), free).expect("a scene");
    // In steps of 5e-7 s the parts are of 100, 200 and 100 steps.
    for (scene, stop, place) in [
        ("scene", 60, 120),
        ("scene", 100, 200),
        ("scene", 141, 282),
        ("scene", 350, 700),
        ("free", 60, 120),
    ] {
        let before = format!("{scene}-{stop}");
        let stop = format!("--stop-at={stop}");
        let path = at(&format!("{scene}.toml"));
        let first = run(folder.path(), &before, &[&path, &stop]);
        let name = format!("{before}-on");
        let after = branch(folder.path(), [&before, &name], &["--set=time.step=2.5e-7"]);
        goes_on(&first, &after, 2.5e-7, &name);
        assert_eq!(after.series().step[0], place + 1);
        let ends = if scene == "free" { 5e-5 } else { 2e-4 };
        let end = *after.series().time.last().expect("a row");
        assert!((end - ends).abs() < 1e-9 * ends, "{name}: {end}");
        if scene == "free" {
            continue;
        }
        let height = after.number("height_start").expect("a height");
        let series = after.series();
        for (time, place) in series.time.iter().zip(series.column("drive_displacement")) {
            let swing = (time - 5e-5).clamp(0.0, 1e-4) * 1e4 * std::f64::consts::TAU;
            let expected = 2.0 * time.min(5e-5) + 1e-3 * height * swing.sin();
            assert!(
                (place - expected).abs() < 1e-12 * expected.abs() + 1e-17,
                "{name}: {time}"
            );
        }
    }
}

/// A change of the motion before the checkpoint is refused, and the message says that the time step
/// has changed, too, and how to keep it.
#[test]
fn a_refused_branch_says_that_the_time_step_has_changed() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(at("scene.toml"), scene("walls")).expect("a scene");
    run(
        folder.path(),
        "before",
        &[&at("scene.toml"), "--stop-at=40"],
    );
    let mut program = crate::common::program(1);
    program.args(["--resume", &at("before"), "--branch", &at("after")]);
    program.args(["--set=time.step=2.5e-7", "--set=shear.velocity=3.0"]);
    let output = program.output().expect("the program starts");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    for part in [
        "the drive has moved",
        "from 5e-7 to 2.5e-7 s",
        "--set time.step=5e-7 keeps it",
    ] {
        assert!(said.contains(part), "{said}");
    }
    assert!(!folder.path().join("after").exists());
}

/// Newton's equations of a box.
#[test]
fn newtonian_goes_on_with_another_time_step() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    let box_scene = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");
    let first = [
        box_scene,
        "--stop-at=502",
        "--set=aqs.steps=2",
        "--set=newtonian.growth_times=2.0",
        "--set=newtonian.rows=1000",
    ];
    run(folder.path(), "before", &first);
    let newtonian = |name: &str| {
        let part = folder.path().join(name).join("run.h5/newtonian");
        RunFile::open_any(&part).expect("a part")
    };
    let before = newtonian("before");
    let old = before.number("time_step").expect("a number");
    let set = format!("--set=time.step={:e}", 0.5 * old);
    let mut program = crate::common::program(1);
    program.args(["--resume", &at("before"), "--branch", &at("after"), &set]);
    let output = program.output().expect("the program starts");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let after = newtonian("after");
    let [last, first] = [
        *before.series().time.last().expect("a row"),
        after.series().time[0],
    ];
    assert_eq!(last, 500.0 * old);
    assert!(first > last && first <= last + 2.0 * old, "{last} {first}");
    // It is counted from the checkpoint, so the sum is rounded otherwise.
    let of_step = after.series().step[0] as f64 * 0.5 * old;
    assert!(
        (first / of_step - 1.0).abs() <= f64::EPSILON,
        "{first} {of_step}"
    );
}
