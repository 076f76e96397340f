//! Boxes whose lengths change, through the real program: compression to a pressure, pure shear and
//! the biaxial test, their frames and their contracts.

use std::path::Path;

use crate::common::{Outcome, beyond_the_digest, gshear_mpi, reducer, run_scene, succeed};
use gshear_dem::dimension::{Three, Two};
use gshear_dem::state::length;
use gshear_scene::Dimensions;
use gshear_store::file_names::RUN_FILE;
use gshear_store::run_reader::RunFile;

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");

const COMPRESSION: [&str; 3] = [
    "--set=aqs.deformation=compression",
    "--set=aqs.steps=none",
    "--set=aqs.pressures=[0.009, 0.01, 0.0095, 0.011]",
];
const PURE_SHEAR: [&str; 2] = ["--set=aqs.deformation=pure-shear", "--set=aqs.steps=4"];
const BIAXIAL: [&str; 3] = [
    "--set=aqs.deformation=biaxial",
    "--set=aqs.pressure=0.008",
    "--set=aqs.steps=4",
];
const PROTOCOL: [&str; 4] = [
    "--set=aqs.deformation=protocol",
    "--set=aqs.steps=none",
    "--set=aqs.pressure=0.008",
    "--set=aqs.protocol=[{ strain_zz = 3e-3, stress_xx = 0.008, pressure = 0.0085 }, \
     { shear_strain = 2e-3, cycles = 1, stress_zz = 0.008 }]",
];
const NO_LAST_STAGE: [&str; 3] = [
    "--set=newtonian.growth_times=none",
    "--set=newtonian.rows=none",
    "--set=newtonian.frames=none",
];

fn run(folder: &Path, ranks: usize, parts: &[&[&str]]) -> Outcome {
    let mut arguments = vec![SCENE.to_string(), "--overwrite".into()];
    arguments.extend(
        parts
            .iter()
            .flat_map(|part| part.iter())
            .map(ToString::to_string),
    );
    gshear_mpi(ranks, folder, &arguments)
}

fn finished(folder: &Path, parts: &[&[&str]]) -> RunFile {
    let outcome = run(folder, 1, parts);
    assert_eq!(outcome.code, 0, "{}", outcome.text);
    RunFile::open_any(&folder.join(RUN_FILE)).expect("a run")
}

/// All digests that a run prints.
fn digests(outcome: &Outcome) -> Vec<String> {
    let words = outcome.text.split_whitespace();
    let after = words.clone().skip(1).zip(words);
    let said = after.filter(|(_, word)| *word == "digest");
    said.map(|(digest, _)| digest.into()).collect()
}

fn info_has_the_lengths_of_the_end(run: &RunFile) {
    let mut info = reducer();
    let said = succeed(info.arg("info").arg(run.path())).stdout;
    let said = String::from_utf8(said).expect("text");
    let length = run.series().column("length_x").last().expect("a row");
    let length = format!("{length:.4e} m");
    let is_of_last = |line: &str| line.contains(&length) && line.contains("at the end");
    assert!(said.lines().any(is_of_last), "{said}");
}

/// Overlaps of every frame follow from its positions, radii and edges.
fn overlaps_are_those_of_the_frames(run: &RunFile) {
    assert!(run.frames() > 1);
    let mut contacts = 0;
    for t in 0..run.frames() {
        let cell = run.cell(t);
        let frame = run.records(t..t + 1).expect("a frame").swap_remove(0);
        let radius = &run.grains().radius;
        for contact in &frame.contacts {
            let [i, j] = [contact.i, contact.j].map(|g| g as usize);
            let [a, b] = [i, j].map(|g| frame.grains[g].position);
            let apart = match run.dimension() {
                Dimensions::Two => cell.separation::<Two>(&a, &b),
                Dimensions::Three => cell.separation::<Three>(&a, &b),
            };
            let overlap = radius[i] + radius[j] - length(apart);
            assert!((overlap - contact.overlap).abs() < 1e-14, "{t} {i} {j}");
            contacts += 1;
        }
    }
    assert!(contacts > 100, "{contacts}");
}

/// The pressures are reached one after the other, up and down; the energy changes by -P dV.
#[test]
fn a_compression_reaches_its_pressures() {
    let folder = tempfile::tempdir().expect("a folder");
    let wanted = [0.01, 0.0101, 0.0102, 0.008, 0.0081];
    let pressures = format!("--set=aqs.pressures={wanted:?}");
    let more = [
        "--set=aqs.deformation=compression",
        "--set=aqs.steps=none",
        &pressures,
        "--set=aqs.pressure_tolerance=1e-8",
        "--set=contact.friction=0.0",
        "--set=relax.tolerance=1e-12",
        "--set=aqs.frame_every=1",
    ];
    let run = finished(folder.path(), &[&more, &NO_LAST_STAGE]);
    let column = |name: &str| run.series().column(name).to_vec();
    let (pressure, energy) = (column("pressure"), column("elastic_energy"));
    let lengths = ["length_x", "length_y", "length_z"].map(column);
    let fraction = column("solid_fraction");
    assert_eq!(pressure.len(), 1 + wanted.len());
    let volume = |row: usize| lengths.iter().map(|of| of[row]).product::<f64>();
    assert_eq!(fraction[0], 0.72);
    for (row, wanted) in (1..).zip(wanted) {
        assert!((pressure[row] / wanted - 1.0).abs() <= 1e-8, "{row}");
        assert_eq!(lengths[0][row], lengths[1][row]);
        assert_eq!(lengths[0][row], lengths[2][row]);
        let expected = 0.72 * volume(0) / volume(row);
        assert!((fraction[row] / expected - 1.0).abs() < 1e-14, "{row}");
        let decrease = 1.0 - volume(row) / volume(0);
        assert!((column("strain")[row] - decrease).abs() < 1e-14, "{row}");
        let trace = ["stress_xx", "stress_yy", "stress_zz"].map(|name| column(name)[row]);
        let mean = trace.iter().sum::<f64>() / 3.0;
        assert!((mean / pressure[row] - 1.0).abs() < 1e-13, "{row}");
    }
    // Where no contact slips into another state: by the trapezoid rule.
    for [before, after] in [[1, 2], [2, 3], [4, 5]] {
        let work = 0.5 * (pressure[before] + pressure[after]) * (volume(before) - volume(after));
        let stored = energy[after] - energy[before];
        assert!((work / stored - 1.0).abs() < 1e-3, "{work} {stored}");
    }
    overlaps_are_those_of_the_frames(&run);
}

/// Pure shear keeps the volume to its last bits: the height is the area over the length.
#[test]
fn pure_shear_keeps_the_volume() {
    let folder = tempfile::tempdir().expect("a folder");
    for (dimension, fraction, up) in [
        (
            "--set=dimension=3",
            "--set=sample.solid_fraction=0.72",
            "length_z",
        ),
        (
            "--set=dimension=2",
            "--set=sample.solid_fraction=0.9",
            "length_y",
        ),
    ] {
        let more = [dimension, fraction, "--set=aqs.frame_every=1"];
        let run = finished(
            &folder.path().join(up),
            &[&PURE_SHEAR, &more, &NO_LAST_STAGE],
        );
        let column = |name: &str| run.series().column(name);
        // A frame per row, with its strain as its time.
        assert_eq!(run.frame_strains().expect("strains"), column("strain"));
        assert_eq!(run.frame_times(), column("strain"));
        let (x, z) = (column("length_x"), column(up));
        assert_eq!(x[0], z[0]);
        for (row, strain) in column("strain").iter().enumerate() {
            assert_eq!(*strain, 2e-3 * row as f64);
            // The area over the length rounds at the start, too.
            let height = if row == 0 { x[0] } else { x[0] * x[0] / x[row] };
            assert_eq!(z[row], height);
            let stretched = (0.5 * strain).exp();
            assert!((x[row] / x[0] / stretched - 1.0).abs() < 1e-14);
            let edges = run.box_edges(row);
            assert_eq!(edges[0][0], x[row]);
            assert_eq!(
                edges[run.dimension().axes() - 1][run.dimension().axes() - 1],
                z[row]
            );
        }
        if up == "length_z" {
            assert!(column("length_y").iter().all(|l| *l == x[0]));
        }
        info_has_the_lengths_of_the_end(&run);
        // Compressed along the last axis.
        let up = up.replace("length", "stress");
        let up = column(&format!("{up}{}", &up[up.len() - 1..]));
        let difference = |row: usize| up[row] - column("stress_xx")[row];
        assert!(difference(4) > difference(0));
        overlaps_are_those_of_the_frames(&run);
    }
}

/// A box without frames, and one whose last frame is not of its last strain step.
#[test]
fn info_has_the_lengths_at_the_end() {
    let folder = tempfile::tempdir().expect("a folder");
    let disks = ["--set=dimension=2", "--set=sample.solid_fraction=0.9"];
    for every in [0, 3] {
        let more = [format!("--set=aqs.frame_every={every}")];
        let more: Vec<&str> = more.iter().map(String::as_str).collect();
        let name = folder.path().join(every.to_string());
        let run = finished(&name, &[&PURE_SHEAR, &disks, &more, &NO_LAST_STAGE]);
        info_has_the_lengths_of_the_end(&run);
    }
}

/// The lateral stress is held while the height shrinks.
#[test]
fn a_biaxial_test_holds_the_lateral_stress() {
    let folder = tempfile::tempdir().expect("a folder");
    let tolerance = [
        "--set=aqs.pressure_tolerance=1e-6",
        "--set=aqs.frame_every=2",
    ];
    let run = finished(folder.path(), &[&BIAXIAL, &tolerance, &NO_LAST_STAGE]);
    let column = |name: &str| run.series().column(name);
    assert!((column("pressure")[0] / 0.008 - 1.0).abs() <= 1e-6);
    for row in 1..5 {
        let lateral = 0.5 * (column("stress_xx")[row] + column("stress_yy")[row]);
        assert!((lateral / 0.008 - 1.0).abs() <= 1e-6, "{row}: {lateral}");
        let shrunk = (-2e-3 * row as f64).exp();
        let height = column("length_z");
        assert!((height[row] / height[0] / shrunk - 1.0).abs() < 1e-14);
        assert!(column("length_x")[row] > column("length_x")[row - 1]);
        let equally = column("length_x")[row] / column("length_y")[row];
        assert!((equally - 1.0).abs() < 1e-14, "{equally}");
        assert!(column("stress_zz")[row] > column("stress_zz")[row - 1]);
    }
    overlaps_are_those_of_the_frames(&run);
}

/// The lines of a figure's data, without the header.
fn data(report: &Path, figure: &str) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(report.join(figure).with_extension("csv")).expect(figure);
    let number = |word: &str| word.parse().expect("a number");
    let lines = text.lines().skip(1);
    lines.map(|l| l.split(',').map(number).collect()).collect()
}

/// Every deformation has a report of what it measured, under its own title, while it runs, too. The
/// stress that works on the strain gives the change of the elastic energy.
#[test]
fn every_deformation_is_reported() {
    let temporary = tempfile::tempdir().expect("a folder");
    let small = [
        "--set=title=Box <1>",
        "--set=dimension=2",
        "--set=sample.solid_fraction=0.9",
        "--set=sample.grains=60",
        "--set=contact.friction=0.0",
        "--set=aqs.strain_step=1e-5",
        "--set=aqs.frame_every=1",
        "--set=relax.tolerance=1e-12",
    ];
    let pressures = [
        "--set=aqs.pressures=[0.05, 0.0501, 0.0502, 0.0501]",
        "--set=aqs.strain_step=1e-3",
    ];
    // The lateral stress is not that of the first row: the box needs room to correct it.
    let lateral = [
        "--set=aqs.pressure=0.05",
        "--set=aqs.strain_step=3e-4",
        "--set=aqs.steps=3",
    ];
    let eigenvalues = ["--set=aqs.steps=4", "--set=aqs.spectrum=true"];
    for (key, name, parts) in [
        (
            "simple-shear",
            "Simple shear, then Newton",
            [&eigenvalues[..], &[]],
        ),
        (
            "pure-shear",
            "Pure shear at constant volume:",
            [&PURE_SHEAR, &NO_LAST_STAGE],
        ),
        (
            "biaxial",
            "Biaxial test:",
            [&[&BIAXIAL[..], &lateral].concat(), &NO_LAST_STAGE],
        ),
        (
            "compression",
            "Isotropic compression:",
            [&[&COMPRESSION[..], &pressures].concat(), &NO_LAST_STAGE],
        ),
    ] {
        let folder = temporary.path().join(key);
        let outcome = run(&folder, 1, &[&small, parts[0], parts[1]]);
        assert_eq!(outcome.code, 0, "{}", outcome.text);
        // The lock of a program that writes, as HDF5 takes it; programs that other tests start
        // inherit it, so that only `unlock` ends it.
        let writing = std::fs::File::open(folder.join(RUN_FILE)).expect("the file");
        writing.lock().expect("the lock");
        let mut report = reducer();
        succeed(report.arg("report").arg(&folder));
        writing.unlock().expect("unlocked");
        let run = RunFile::open_any(&folder).expect("a run");
        let report = folder.join("report");
        let page = std::fs::read_to_string(report.join("index.html")).expect("a page");
        assert!(
            page.contains("<h1>Box &lt;1&gt;</h1>") && page.contains(name),
            "{key}"
        );
        let has = |figure: &str| page.contains(&format!("<figure id=\"{figure}\">"));
        for figure in [
            "stress-strain",
            "modulus",
            "stresses",
            "coordination",
            "fabric",
            "forces",
        ] {
            assert!(has(figure), "{key}: {figure}");
        }
        let is_simple = key == "simple-shear";
        assert_eq!(has("real-parts"), is_simple, "{key}");
        assert_eq!(has("newtonian-displacement"), is_simple, "{key}");
        assert!(!page.contains("NaN") && !page.contains("Bonfanti"), "{key}");

        let column = |name: &str| run.series().column(name);
        let energy = column("elastic_energy");
        let volume = |row: usize| column("length_x")[row] * column("length_y")[row];
        let (stress, modulus) = (data(&report, "stress-strain"), data(&report, "modulus"));
        assert_eq!(stress.len(), energy.len());
        // The first pressure of a compression is far from that of the first row.
        for row in 1 + usize::from(key == "compression")..energy.len() {
            let mean = |of: &dyn Fn(usize) -> f64| 0.5 * (of(row - 1) + of(row));
            let shrunk = (volume(row - 1) / volume(row)).ln();
            let strain = column("strain")[row] - column("strain")[row - 1];
            let conjugate = mean(&|row| stress[row][2]);
            let work = match key {
                "biaxial" => conjugate * strain + mean(&|row| column("stress_xx")[row]) * shrunk,
                "compression" => conjugate * shrunk,
                _ => conjugate * strain,
            };
            let stored = (energy[row] - energy[row - 1]) / mean(&volume);
            assert!(
                (work / stored - 1.0).abs() < 1e-3,
                "{key} {row}: {work} {stored}"
            );
            let change = stress[row][2] - stress[row - 1][2];
            let over = if key == "compression" { shrunk } else { strain };
            assert!(
                (change / over / modulus[row][2] - 1.0).abs() < 1e-6,
                "{key} {row}"
            );
        }
    }
    // Newton's equations by their name, and a file that holds nothing else.
    let folder = temporary.path().join("simple-shear");
    let moving = folder.join("run.h5/newtonian");
    succeed(reducer().arg("report").arg(&moving));
    let file = hdf5::File::open_rw(folder.join(RUN_FILE)).expect("HDF5");
    file.unlink("particles").expect("removed");
    file.close().expect("closed");
    for of in [moving, folder] {
        let mut report = reducer();
        succeed(report.arg("report").arg(&of));
    }
}

/// Spheres that are soon at rest.
const SPHERES: [&str; 1] = ["--set=seed=5"];

/// Contracts 1 to 3: ranks and threads, other output, stopped and gone on with.
fn keeps_the_contracts(of: &[&str], more: &[&str]) {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let one = run(&at("one"), 1, &[of, more]);
    assert_eq!(one.code, 0, "{}", one.text);
    let expected = digests(&one);
    assert_eq!(expected.len(), 2, "{}", one.text);
    let beyond = beyond_the_digest(&at("one"));
    let checked = |ranks: usize, set: &[&str]| {
        let found = run(&at("other"), ranks, &[of, more, set]);
        assert_eq!(digests(&found), expected, "{ranks} {set:?}: {}", found.text);
        assert_eq!(beyond_the_digest(&at("other")), beyond, "{ranks} {set:?}");
    };
    checked(2, &["--set=bookkeeping.skin=0.05"]);
    checked(
        1,
        &[
            "--threads=2",
            "--set=aqs.frame_every=1",
            "--set=newtonian.frames=0",
        ],
    );
    let stopped = run(&at("part"), 2, &[of, more, &["--stop-at=2"]]);
    assert_eq!(stopped.code, 75, "{}", stopped.text);
    let resume = format!("--resume={}", at("part").join("checkpoint.h5").display());
    let portable = "--set=bookkeeping.simd=portable".to_string();
    let resumed = gshear_mpi(3, &at("part"), &[resume, portable]);
    assert_eq!(digests(&resumed), expected, "{}", resumed.text);
    assert_eq!(beyond_the_digest(&at("part")), beyond);
    let read = |name: &str| {
        let run = RunFile::open_any(&at(name).join(RUN_FILE)).expect("a run");
        let columns = run.series().columns.iter().flatten();
        let boxes: Vec<_> = (0..run.frames()).map(|t| run.box_edges(t)).collect();
        (columns.map(|x| x.to_bits()).collect::<Vec<_>>(), boxes)
    };
    assert_eq!(read("part"), read("one"));
}

#[test]
fn a_compression_keeps_the_contracts() {
    keeps_the_contracts(&COMPRESSION, &SPHERES);
}

#[test]
fn a_compression_of_disks_keeps_the_contracts() {
    let disks = ["--set=dimension=2", "--set=sample.solid_fraction=0.9"];
    keeps_the_contracts(&COMPRESSION, &disks);
}

#[test]
fn pure_shear_keeps_the_contracts() {
    keeps_the_contracts(
        &[&PURE_SHEAR[..], &["--set=aqs.pressure=0.008"]].concat(),
        &SPHERES,
    );
}

#[test]
fn a_biaxial_test_keeps_the_contracts() {
    keeps_the_contracts(&BIAXIAL, &SPHERES);
}

#[test]
fn a_protocol_keeps_the_contracts() {
    keeps_the_contracts(&PROTOCOL, &SPHERES);
}

#[test]
fn simple_shear_at_a_pressure_keeps_the_contracts() {
    keeps_the_contracts(&["--set=aqs.steps=4", "--set=aqs.pressure=0.008"], &SPHERES);
}

/// Strain steps that stop after every part of a relaxation and go on, on other ranks each time: the
/// same bits as without a stop. A run of no time takes one part.
#[test]
fn strain_steps_stop_within() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let loose = "--set=relax.tolerance=1e-6";
    let overdamped = ["--set=relax.method=overdamped", loose, "--set=aqs.steps=2"];
    let birth = [
        "--set=dimension=2",
        "--set=sample.solid_fraction=0.9",
        "--set=aqs.spectrum=true",
        "--set=aqs.birth_precision=5e-4",
        "--set=aqs.steps=3",
    ];
    for (name, more) in [
        ("overdamped", &overdamped[..]),
        ("birth", &birth),
        ("biaxial", &BIAXIAL),
        ("compression", &COMPRESSION),
        ("protocol", &PROTOCOL),
    ] {
        let parts = [more, &NO_LAST_STAGE];
        let whole = run(&at("whole"), 1, &parts);
        let stopped = run(&at(name), 1, &[more, &NO_LAST_STAGE, &["--stop-at=1"]]);
        assert_eq!(stopped.code, 75, "{}", stopped.text);
        let resume = format!("--resume={}", at(name).display());
        let mut within = 0;
        for ranks in [1, 2, 3, 1, 2, 1] {
            let arguments = [resume.clone(), "--walltime=1ns".into()];
            let stopped = gshear_mpi(ranks, &at(name), &arguments);
            assert_eq!(stopped.code, 75, "{name}: {}", stopped.text);
            let checkpoint = at(name).join("checkpoint.h5");
            let [header, _] = gshear_store::checkpoint::read_texts(&checkpoint).expect("a header");
            within += usize::from(header.contains("\"unfinished\""));
        }
        assert!(within >= 3, "{name}: {within} stops within a step");
        let resumed = gshear_mpi(2, &at(name), &[resume]);
        assert_eq!(
            digests(&resumed),
            digests(&whole),
            "{name}: {}",
            resumed.text
        );
        assert_eq!(digests(&whole).len(), 1, "{}", whole.text);
        let bits = |folder: &Path| -> Vec<Vec<u64>> {
            let run = RunFile::open_any(&folder.join(RUN_FILE)).expect("a file");
            let bits = |column: &[f64]| column.iter().map(|x| x.to_bits()).collect();
            run.series().columns.iter().map(|of| bits(of)).collect()
        };
        assert_eq!(bits(&at(name)), bits(&at("whole")), "{name}");
        assert_eq!(
            beyond_the_digest(&at(name)),
            beyond_the_digest(&at("whole")),
            "{name}"
        );
        let born = |text: &str| {
            text.lines()
                .find(|line| line.starts_with("birth:"))
                .map(String::from)
        };
        if name == "birth" {
            assert!(born(&whole.text).is_some(), "{}", whole.text);
        }
    }
}

/// A box of any ratio of lengths, prepared from a lattice or from random places, has the volume
/// Σ V/φ of its grains and the same bits on any number of ranks. Its first frame, as a packing of a
/// file whose box is that of the file, is strained to the same stresses.
#[test]
fn boxes_have_the_ratios_of_the_scene() {
    let folder = tempfile::tempdir().expect("a folder");
    for (axes, aspect, fraction, placement) in [
        (2, [2.0, 1.0, 0.0], 0.86, "lattice"),
        (3, [1.0, 1.25, 0.8], 0.68, "random"),
    ] {
        let scene = |sample: &str| {
            format!(
                "
                dimension = {axes}
                material.mass = 1.0
                contact = {{ law = 'mindlin', normal_stiffness = 1.0, friction = 0.0 }}
                relax = {{ tolerance = 1e-12, drag = 0.1 }}
                aqs = {{ strain_step = 1e-3, steps = 3, frame_every = 1 }}
                sample = {{ {sample}, boundary = 'periodic' }}"
            )
        };
        let inserted = scene(&format!(
            "grains = 200, sizes = 'binary', radius_min = 0.5, radius_max = 0.7, large_fraction = 0.5,
            solid_fraction = {fraction}, aspect = {:?}, placement = '{placement}'",
            &aspect[..axes]
        ).replace('\n', " "));
        let file = folder.path().join(format!("{axes}.toml"));
        std::fs::write(&file, inserted).expect("written");
        let [one, two] = [1, 2].map(|ranks| {
            let out = folder.path().join(format!("{axes}-{ranks}"));
            let arguments = [file.display().to_string()];
            let digest = gshear_mpi(ranks, &out, &arguments).digest();
            (digest, RunFile::open_any(&out).expect("a run"))
        });
        assert_eq!(one.0, two.0);
        let run = one.1;
        let edges = run.box_edges(0);
        let lengths: Vec<f64> = (0..axes).map(|axis| edges[axis][axis]).collect();
        for axis in 0..axes {
            let ratio = lengths[axis] / lengths[0];
            let wanted = aspect[axis] / aspect[0];
            assert!((ratio / wanted - 1.0).abs() < 1e-14, "{lengths:?}");
        }
        let pi = std::f64::consts::PI;
        let volume = match axes {
            2 => 100.0 * pi * (0.25 + 0.49),
            _ => 100.0 * 4.0 / 3.0 * pi * (0.125 + 0.343),
        };
        let found = volume / lengths.iter().product::<f64>();
        assert!((found / fraction - 1.0).abs() < 1e-13, "{found}");
        // Its first frame as a packing, whose box is that of the file.
        let packing = format!(
            "packing = '{}@0'",
            folder.path().join(format!("{axes}-1")).display()
        );
        let again = run_scene(
            folder.path(),
            &format!("{axes}-again"),
            &scene(&packing),
            &[],
        );
        assert_eq!(again.box_edges(0), edges);
        let pressures = run.series().column("pressure");
        // Far above the tolerance of the relaxation: it is jammed.
        assert!(pressures[0] > 1e-4, "{pressures:?}");
        for name in ["pressure", "shear_stress"] {
            let [first, second] = [&run, &again].map(|run| run.series().column(name).to_vec());
            for (a, b) in first.iter().zip(&second) {
                assert!((a - b).abs() < 1e-8 * pressures[0], "{name}: {a} {b}");
            }
        }
    }
}
