//! Cells without walls whose lengths change as stresses and strains impose, through the real
//! programs: stresses, volumes, the energy budget, frames, replays, stages after the shear.

use std::path::Path;

use crate::common::{reducer, run_scene, succeed};
use gshear_store::run_reader::RunFile;

/// Disks of friction 0.4 in a cell of 11 mm.
const DISKS: &str = "
    material.density = 2500
    contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.4, restitution = 0.3 }
    sample = { grains = 150, radius_min = 0.4e-3, radius_max = 0.6e-3, length = 11e-3, boundary = 'periodic' }
    load.pressure = 1e3
    pack.tolerance = 1e-4
    output = { series_rows = 400, frame_rows = 20 }
";

/// Spheres in a cell of 8 mm by 7 mm.
const SPHERES: &str = "
    dimension = 3
    material.density = 2500
    contact = { law = 'hooke', normal_stiffness = 1e3, friction = 0.4, restitution = 0.3 }
    sample = { grains = 400, radius_min = 0.4e-3, radius_max = 0.6e-3, length = 8e-3, width = 7e-3, boundary = 'periodic' }
    load.pressure = 1e3
    pack.tolerance = 1e-3
    output = { series_rows = 100, frame_rows = 5 }
";

fn run(folder: &Path, name: &str, scene: &str, parts: &str, more: &[&str]) -> RunFile {
    let protocol = format!("shear.protocol=[{parts}]");
    run_scene(folder, name, scene, &[&[&protocol[..]], more].concat())
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn last(run: &RunFile, name: &str) -> f64 {
    *run.series().column(name).last().expect("a row")
}

/// The mean of the latter half of a part, which is one of so many.
fn latter(run: &RunFile, name: &str, part: usize, parts: usize) -> f64 {
    let column = run.series().column(name);
    let rows = column.len() / parts;
    mean(&column[part * rows + rows / 2..(part + 1) * rows])
}

/// While it shears, each axis comes to its own stress; the volume is free. N is the stress along
/// the height times the base at the start.
#[test]
fn each_axis_comes_to_its_stress() {
    let folder = tempfile::tempdir().expect("a folder");
    // Under a servo a stress lags behind as long as its length changes.
    for (control, velocity) in [("mass", 0.1), ("servo", 0.0)] {
        let set = [
            &format!("load.control={control}")[..],
            "output.energy=false",
        ];
        let parts = format!(
            "{{velocity={velocity},time=0.1,stress_xx=1.3e3}},{{velocity={velocity},time=0.1,pressure=1.2e3,stress_xx=900}}"
        );
        let disks = run(
            folder.path(),
            &format!("disks-{control}"),
            DISKS,
            &parts,
            &set,
        );
        for (name, part, wanted) in [
            ("stress_xx", 0, 1.3e3),
            ("stress_yy", 0, 1e3),
            ("stress_xx", 1, 900.0),
            ("stress_yy", 1, 1.2e3),
        ] {
            let found = latter(&disks, name, part, 2);
            println!("{control} {name} {part}: {found}");
            assert!((found / wanted - 1.0).abs() < 0.02, "{name}: {found}");
        }
        let series = disks.series();
        let forces = series.column("normal_force").iter();
        for (force, stress) in forces.zip(series.column("stress_yy")) {
            assert!(
                (stress * 11e-3 / force - 1.0).abs() < 1e-3,
                "{stress} {force}"
            );
        }
        let lengths = series.column("length_x");
        assert!((lengths[lengths.len() / 2] / lengths[0] - 1.0).abs() > 1e-3);
        assert!(
            series
                .column("length_y")
                .iter()
                .all(|length| length.is_nan())
        );
    }
    let parts = "{velocity=0.1,time=0.03,stress_xx=1.2e3,stress_yy=800,pressure=1e3}";
    let set = ["output.energy=false"];
    let spheres = run(folder.path(), "spheres", SPHERES, parts, &set);
    for (name, wanted) in [
        ("stress_xx", 1.2e3),
        ("stress_yy", 800.0),
        ("stress_zz", 1e3),
    ] {
        let found = latter(&spheres, name, 0, 1);
        println!("{name}: {found}");
        assert!((found / wanted - 1.0).abs() < 0.03, "{name}: {found}");
    }
}

/// Under a mean pressure all lengths keep their ratios, and the mean of the stresses follows the
/// ramp.
#[test]
fn the_mean_pressure_changes_all_lengths_alike() {
    let folder = tempfile::tempdir().expect("a folder");
    let parts = "{velocity=0,time=0.02,mean_pressure=1e3,mean_pressure_end=4e3},{velocity=0,time=0.02,mean_pressure=4e3}";
    for (name, scene) in [("disks", DISKS), ("spheres", SPHERES)] {
        let run = run(folder.path(), name, scene, parts, &["output.energy=false"]);
        let series = run.series();
        let start = series.column("length_x")[0] / series.column("wall_height")[0];
        let lengths = series.column("length_x").iter();
        for (length, height) in lengths.zip(series.column("wall_height")) {
            assert!((length / height / start - 1.0).abs() < 1e-12);
        }
        let axes: &[&str] = if name == "disks" {
            &["stress_xx", "stress_yy"]
        } else {
            &["stress_xx", "stress_yy", "stress_zz"]
        };
        let of_axes = axes.iter().map(|axis| latter(&run, axis, 1, 2));
        let found = of_axes.sum::<f64>() / axes.len() as f64;
        println!("{name}: {found}");
        assert!((found / 4e3 - 1.0).abs() < 0.01, "{name}: {found}");
        assert!(last(&run, "solid_fraction") > series.column("solid_fraction")[0] + 1e-3);
    }
}

/// Natural strains are those of the part, to rounding, and grains follow them between frames, over
/// all edges: their displacements less those of the cell are some diameters. The cell of each frame
/// has its lengths.
#[test]
fn strains_are_those_of_the_part() {
    let folder = tempfile::tempdir().expect("a folder");
    let parts = "{velocity=0,time=0.01,strain_xx=0.1,wall_velocity=0},{velocity=0.3,time=0.01,strain_xx=-0.2,wall_velocity=0}";
    let disks = run(folder.path(), "disks", DISKS, parts, &[]);
    let lengths = disks.series().column("length_x");
    let rows = (lengths.len() - 1) / 2;
    for (row, strain) in [(rows, 0.1_f64), (2 * rows, -0.1)] {
        let expected = 11e-3 * (-strain).exp();
        assert!((lengths[row] / expected - 1.0).abs() < 1e-11, "{row}");
    }
    let records = disks.records(0..disks.frames()).expect("frames");
    let edges = |t: usize| disks.box_edges(t);
    let mut farthest = 0.0_f64;
    for (from, to) in [(0, 20), (3, 4), (20, 40), (22, 37)] {
        let (before, after) = (edges(from), edges(to));
        let interval = disks.interval([from, to], [&records[from], &records[to]]);
        let offsets = disks.series().column("unwrapped_offset");
        let row = |t: usize| {
            let steps = &disks.series().step;
            steps.binary_search(&disks.frame_steps()[t]).expect("a row")
        };
        let sheared = offsets[row(to)] / after[0][0] - offsets[row(from)] / before[0][0];
        for (n, grain) in records[from].grains.iter().enumerate() {
            let moved = interval.displacement(n);
            let [x, y] = [grain.position[0], grain.position[1]];
            let part = y / before[1][1];
            // What is left of the first offset stretches with the cell.
            let expected = x * (after[0][0] / before[0][0] - 1.0) + part * sheared * after[0][0];
            farthest = farthest.max((moved[0] - expected).abs());
        }
    }
    println!("{farthest:e}");
    assert!(farthest < 2e-3, "{farthest:e}");
}

/// The residual falls by more than Δt while all lengths change under stresses and strains.
#[test]
fn the_energy_budget_closes() {
    let folder = tempfile::tempdir().expect("a folder");
    let parts = "{velocity=0.2,time=0.01,stress_xx=1.5e3},{velocity=0.2,time=0.01,mean_pressure=1.2e3},{velocity=0.2,time=0.01,strain_xx=0.02,pressure=1e3}";
    let residual = |step: &str| {
        let set = [format!("time.step={step}")];
        let set: Vec<&str> = set.iter().map(String::as_str).collect();
        let flow = run(folder.path(), step, DISKS, parts, &set);
        let series = flow.series();
        let later = &series.column("energy_residual")[series.rows() / 4..];
        later.iter().fold(0.0_f64, |most, x| most.max(x.abs()))
    };
    let [coarse, fine] = ["1.6e-6", "4e-7"].map(residual);
    println!("{coarse:e} {fine:e}");
    assert!(fine < 5e-4 && coarse > 4.0 * fine, "{coarse} {fine}");
}

/// A window of it is computed again with the same bits, and a report drawn.
#[test]
fn windows_are_replayed() {
    let folder = tempfile::tempdir().expect("a folder");
    let parts =
        "{velocity=0.3,time=0.01,stress_xx=1.2e3},{velocity=0.3,time=0.01,mean_pressure=1.5e3}";
    let set = ["output.keep_checkpoints=true"];
    run(folder.path(), "flow", DISKS, parts, &set);
    let out = folder.path().join("flow");
    let mut replay = reducer();
    replay.arg("replay").arg(&out).arg("--time=0.012..0.015");
    replay.arg("--out").arg(folder.path().join("again"));
    let words = String::from_utf8(succeed(&mut replay).stdout).expect("text");
    assert!(words.contains("to the last bit"), "{words}");
    succeed(reducer().arg("report").arg(&out));
}

/// Strain steps after the shear begin in the cell that it has come to.
#[test]
fn a_stage_after_it_begins_in_its_cell() {
    let folder = tempfile::tempdir().expect("a folder");
    let strain = "
        relax = { tolerance = 1e-8, drag = 2e4 }
        aqs = { strain_step = 1e-4, steps = 2, frame_every = 1 }
    ";
    let parts = "{velocity=0.3,time=0.01,strain_xx=0.05}";
    let scene = format!("{DISKS}{strain}");
    let shear = run(folder.path(), "flow", &scene, parts, &[]);
    let strained = folder.path().join("flow/run.h5/aqs");
    let strained = RunFile::open_any(&strained).expect("the strain steps");
    let end = shear.box_edges(shear.frames() - 1);
    let begin = strained.box_edges(0);
    assert!((end[0][0] / 11e-3 / (-0.05_f64).exp() - 1.0).abs() < 1e-11);
    assert_eq!(begin, end);
}

/// The report draws what changes: lengths of the axes that there are, and their stresses.
#[test]
fn a_report_has_the_lengths_and_stresses_of_a_cell() {
    let folder = tempfile::tempdir().expect("a folder");
    let short = ["output.energy=false", "output.series_rows=20"];
    let changes = "{velocity=0.1,time=0.004,stress_xx=1.2e3}";
    let both = "{velocity=0.1,time=0.004,stress_xx=1.2e3,stress_yy=800}";
    let constant = "{velocity=0.1,time=0.004}";
    for (name, scene, parts, lengths) in [
        ("disks", DISKS, changes, Some(&["length", "height"][..])),
        ("constant", DISKS, constant, None),
        (
            "spheres",
            SPHERES,
            both,
            Some(&["length", "width", "height"]),
        ),
    ] {
        run(folder.path(), name, scene, parts, &short);
        let own = folder.path().join(name);
        succeed(reducer().arg("report").arg(&own));
        let drawn = |figure: &str| {
            std::fs::read_to_string(own.join("report").join(figure).with_extension("svg")).ok()
        };
        let stresses = drawn("cell-stresses").expect("a figure of stresses");
        let axes = 2 + usize::from(name == "spheres");
        assert_eq!(stresses.matches('σ').count(), axes, "{name}");
        let found = drawn("cell-lengths");
        assert_eq!(found.is_some(), lengths.is_some(), "{name}");
        for word in ["length", "width", "height"] {
            let wanted = lengths.is_some_and(|words| words.contains(&word));
            let mut words = found.as_deref().unwrap_or_default().lines();
            assert_eq!(words.any(|line| line == word), wanted, "{name}: {word}");
        }
    }
}
