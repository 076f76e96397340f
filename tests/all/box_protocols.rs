//! Protocols of strain steps through the real program, against prescribed strains and stresses and
//! against other deformations that reach the same packing.

use std::path::Path;

use crate::common::{Outcome, gshear_mpi, reducer, succeed};
use gshear_store::file_names::RUN_FILE;
use gshear_store::run_reader::RunFile;

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");
/// A whole number of these is exact, and so is each part of them.
const STEP: f64 = 1.0 / 1024.0;
const NO_LAST_STAGE: [&str; 3] = [
    "--set=newtonian.growth_times=none",
    "--set=newtonian.rows=none",
    "--set=newtonian.frames=none",
];
const DISKS: [&str; 2] = ["--set=dimension=2", "--set=sample.solid_fraction=0.9"];

fn run(folder: &Path, ranks: usize, sets: &[&str]) -> Outcome {
    let mut arguments = vec![SCENE.to_string(), "--overwrite".into()];
    arguments.push(format!("--set=aqs.strain_step={STEP}"));
    let sets = NO_LAST_STAGE.iter().chain(sets);
    arguments.extend(sets.map(ToString::to_string));
    gshear_mpi(ranks, folder, &arguments)
}

fn finished(folder: &Path, sets: &[&str]) -> RunFile {
    let outcome = run(folder, 1, sets);
    assert_eq!(outcome.code, 0, "{}", outcome.text);
    RunFile::open_any(&folder.join(RUN_FILE)).expect("a run")
}

/// The options of a protocol with these parts.
fn protocol(parts: &str) -> [String; 3] {
    [
        "--set=aqs.deformation=protocol".into(),
        "--set=aqs.steps=none".into(),
        format!("--set=aqs.protocol=[{parts}]"),
    ]
}

/// A finished run of a protocol.
fn follow(folder: &Path, parts: &str, sets: &[&str]) -> RunFile {
    let options = protocol(parts);
    let mut all: Vec<&str> = options.iter().map(String::as_str).collect();
    all.extend(sets);
    finished(folder, &all)
}

fn near(found: f64, expected: f64, share: f64) {
    let error = (found / expected - 1.0).abs();
    assert!(error <= share, "{found} instead of {expected}: {error:.1e}");
}

/// Parts that shear there and back are steps of simple shear, to the last bit.
#[test]
fn a_part_with_a_shear_strain_is_a_simple_shear() {
    let folder = tempfile::tempdir().expect("a folder");
    for disks in [&DISKS[..], &[]] {
        let part = format!("{{ shear_strain = {} }}", 4.0 * STEP);
        let of_parts = follow(&folder.path().join("parts"), &part, disks);
        let sets = [disks, &["--set=aqs.steps=4"]].concat();
        let simple = finished(&folder.path().join("simple"), &sets);
        for column in simple.series().declared {
            let [found, expected] =
                [&of_parts, &simple].map(|run| run.series().column(column.name));
            let bits = |values: &[f64]| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(found), bits(expected), "{column}");
        }
        let column = |name: &str| of_parts.series().column(name);
        assert_eq!(column("shear_strain"), column("strain"));
        assert_eq!(column("part"), [0.0, 1.0, 1.0, 1.0, 1.0]);
        assert!(column("volume_strain").iter().all(|x| *x == 0.0));
    }
}

/// Without friction, and without contacts that open or close, a cycle of strain is elastic: the
/// stress comes back, and changes by as much to either side.
#[test]
fn a_small_cycle_without_friction_is_reversible() {
    let folder = tempfile::tempdir().expect("a folder");
    let sets = [
        &DISKS[..],
        &[
            "--set=contact.friction=0.0",
            "--set=relax.tolerance=1e-13",
            "--set=aqs.strain_step=1e-7",
        ],
    ];
    let run = follow(
        folder.path(),
        "{ shear_strain = 2e-7, cycles = 2 }",
        &sets.concat(),
    );
    let column = |name: &str| run.series().column(name);
    let (strain, stress) = (column("shear_strain"), column("shear_stress"));
    assert_eq!(strain.len(), 17);
    assert_eq!([2, 4, 6, 8].map(|row| strain[row]), [2e-7, 0.0, -2e-7, 0.0]);
    let rise = stress[2] - stress[0];
    assert!(rise > 0.0);
    for (row, expected) in [(4, 0.0), (6, -rise), (8, 0.0), (10, rise), (16, 0.0)] {
        let found = stress[row] - stress[0];
        assert!(
            (found - expected).abs() < 1e-4 * rise,
            "{row}: {found} {rise}"
        );
    }
    // The report draws the stress over the strain on which it works.
    succeed(reducer().arg("report").arg(folder.path()));
    let report = folder.path().join("report");
    let page = std::fs::read_to_string(report.join("index.html")).expect("a page");
    for figure in [
        "strains",
        "volume-strain",
        "stress-path",
        "stress-strain-loops",
    ] {
        assert!(
            page.contains(&format!("<figure id=\"{figure}\">")),
            "{figure}"
        );
    }
    let loops = std::fs::read_to_string(report.join("stress-strain-loops.csv"));
    let loops = loops.expect("the data of the figure");
    let number = |word: &str| word.parse::<f64>().expect("a number");
    for (row, line) in loops.lines().skip(1).enumerate() {
        let values: Vec<f64> = line.split(',').map(number).collect();
        assert_eq!(values, [row as f64, strain[row], stress[row]]);
    }
}

/// An undrained test keeps the volume, and lengths follow their natural strains.
#[test]
fn an_undrained_test_keeps_the_volume() {
    let folder = tempfile::tempdir().expect("a folder");
    let parts = format!("{{ strain_zz = {}, volume_strain = 0 }}", 4.0 * STEP);
    let run = follow(folder.path(), &parts, &["--set=aqs.frame_every=1"]);
    let column = |name: &str| run.series().column(name);
    for row in 0..5 {
        let strain = STEP * row as f64;
        let [x, y, z] = ["x", "y", "z"].map(|axis| {
            let lengths = column(&format!("length_{axis}"));
            lengths[row] / lengths[0]
        });
        near(z, (-strain).exp(), 1e-14);
        near(x, (0.5 * strain).exp(), 1e-14);
        near(y, x, 1e-14);
        near(
            column("solid_fraction")[row],
            column("solid_fraction")[0],
            1e-14,
        );
        assert!((column("strain_zz")[row] - strain).abs() < 1e-14);
        assert!(column("volume_strain")[row].abs() < 1e-14);
        // The accumulated strain is that of the axis with the greatest strain.
        assert!((column("strain")[row] - strain).abs() < 1e-14);
    }
    assert!(column("stress_zz")[4] > column("stress_zz")[0]);
    assert_eq!(run.frames(), 5);
}

/// A drained test of disks without friction comes to the packing of the biaxial test, which reaches
/// the lateral stress in its first step.
#[test]
fn a_drained_test_of_disks_is_the_biaxial_test() {
    let folder = tempfile::tempdir().expect("a folder");
    let common = [
        &DISKS[..],
        &[
            "--set=contact.friction=0.0",
            "--set=aqs.pressure=0.02",
            "--set=aqs.pressure_tolerance=1e-9",
            "--set=relax.tolerance=1e-12",
        ],
    ]
    .concat();
    let parts = format!("{{ strain_yy = {}, stress_xx = 0.02 }}", 4.0 * STEP);
    let drained = follow(&folder.path().join("drained"), &parts, &common);
    let biaxial = ["--set=aqs.deformation=biaxial", "--set=aqs.steps=4"];
    let biaxial = finished(
        &folder.path().join("biaxial"),
        &[&common[..], &biaxial].concat(),
    );
    for name in [
        "stress_xx",
        "stress_yy",
        "length_x",
        "length_y",
        "shear_stress",
    ] {
        let [found, expected] = [&drained, &biaxial].map(|run| run.series().column(name)[4]);
        near(found, expected, 1e-6);
    }
}

/// A triaxial test with three different stresses and a shear at a constant mean pressure reach
/// their stresses along straight lines.
#[test]
fn stresses_follow_straight_lines() {
    let folder = tempfile::tempdir().expect("a folder");
    let parts = format!(
        "{{ stress_xx = 0.009, stress_yy = 0.0085, stress_zz = 0.011, steps = 4 }}, \
         {{ shear_strain = {0}, pressure = 0.01 }}, {{ strain_zz = {0}, pressure = 0.01 }}",
        2.0 * STEP
    );
    let tolerance = 1e-6;
    let sets = [
        "--set=aqs.pressure=0.01",
        &format!("--set=aqs.pressure_tolerance={tolerance}"),
    ];
    let run = follow(folder.path(), &parts, &sets);
    let column = |name: &str| run.series().column(name);
    assert_eq!(
        column("part"),
        [0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0]
    );
    for (name, end) in [
        ("stress_xx", 0.009),
        ("stress_yy", 0.0085),
        ("stress_zz", 0.011),
    ] {
        let stress = column(name);
        for row in 1..=4 {
            let expected = stress[0] + (end - stress[0]) * row as f64 / 4.0;
            // Each step aims from the present stress at the last one.
            near(stress[row], expected, 4.0 * tolerance);
        }
    }
    let pressure = column("pressure");
    for row in 5..=8 {
        // From the mean of the three stresses to that of the part.
        let expected = match row {
            5 => 0.5 * (pressure[4] + 0.01),
            _ => 0.01,
        };
        near(pressure[row], expected, 4.0 * tolerance);
    }
    near(column("shear_strain")[6], 2.0 * STEP, 1e-14);
    // The axes without a key have equal strains.
    let strain = |row: usize| ["strain_xx", "strain_yy", "strain_zz"].map(|name| column(name)[row]);
    let by = |from: usize, to: usize, axis: usize| strain(to)[axis] - strain(from)[axis];
    assert!((by(4, 6, 0) - by(4, 6, 2)).abs() < 1e-14);
    assert!((by(6, 8, 0) - by(6, 8, 1)).abs() < 1e-14);
    assert!((by(6, 8, 2) - 2.0 * STEP).abs() < 1e-14);
    assert!(by(6, 8, 0) != 0.0);
}

/// Parts may be appended to a run that is done, on other ranks, but those that are done not
/// changed.
#[test]
fn parts_are_appended() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let first = format!("{{ shear_strain = {} }}", 2.0 * STEP);
    let more = format!("{first}, {{ shear_strain = -{STEP}, stress_xx = 0.009 }}");
    let whole = protocol(&more);
    let whole: Vec<&str> = whole.iter().map(String::as_str).collect();
    let whole = run(&at("whole"), 2, &whole);
    follow(&at("grown"), &first, &[]);
    let resume = format!("--resume={}", at("grown").display());
    let other = format!("--set=aqs.protocol=[{{ strain_xx = {} }}]", 4.0 * STEP);
    let refused = gshear_mpi(1, &at("grown"), &[resume.clone(), other]);
    assert_eq!(refused.code, 2, "{}", refused.text);
    assert!(
        refused
            .text
            .contains("aqs.protocol: the first 2 strain steps would have had other parts"),
        "{}",
        refused.text
    );
    let set = format!("--set=aqs.protocol=[{more}]");
    let grown = gshear_mpi(3, &at("grown"), &[resume, set]);
    assert_eq!(grown.digest(), whole.digest());
    let read = |name: &str| {
        let run = RunFile::open_any(&at(name).join(RUN_FILE)).expect("a run");
        let columns = run.series().columns.iter().flatten();
        columns.map(|x| x.to_bits()).collect::<Vec<_>>()
    };
    assert_eq!(read("grown"), read("whole"));
}
