//! `gshear-reduce spectrum` of runs and checkpoints, through the real programs.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crate::common::{change_file, gshear_mpi, reducer, succeed};
use gshear_store::run_reader::RunFile;

const MINDLIN: &str = r#"
title = "Smoothed Mindlin"
seed = 5
dimension = 3
material.mass = 1e-9
contact = { law = "mindlin", normal_stiffness = 1e11, friction = 0.5 }
sample = { grains = 700, radius_min = 0.5e-6, radius_max = 1.0e-6, length = 12e-6, width = 8.4e-6 }
load.stiffness_number = 1e3
pack.tolerance = 1e-2
shear = { inertial_number = 0.01, strain = 0.3 }
output.frame_strain = 1e-4
"#;

/// Scenes of grains that attract each other: constant, by DMT, by JKR, of disks and of two
/// materials; dampers hold back some of their contacts.
const ATTRACTING: [(&str, &str); 4] = [
    (
        "disks",
        r#"
material.density = 2500.0
contact = { law = "hooke", normal_stiffness = 1e7, friction = 0.4, restitution = 0.1, attraction = 5.0 }
sample = { grains = 100, radius_min = 0.8e-3, radius_max = 1.2e-3, length = 21e-3, boundary = "periodic" }
load.pressure = 5e3
pack.tolerance = 0.1
shear = { inertial_number = 0.2, strain = 0.4 }
"#,
    ),
    (
        "dmt",
        r#"
dimension = 3
material = { density = 2500.0, young_modulus = 1e6, poisson_ratio = 0.3 }
contact = { law = "hertz-tsuji", friction = 0.4, restitution = 0.1, surface_energy = 0.01 }
sample = { grains = 150, radius_min = 0.8e-3, radius_max = 1.2e-3, length = 10e-3, width = 10e-3, boundary = "periodic" }
load.pressure = 5e2
pack.tolerance = 0.1
shear = { inertial_number = 0.2, strain = 0.4 }
"#,
    ),
    (
        "jkr",
        r#"
dimension = 3
material = { density = 2500.0, young_modulus = 1e6, poisson_ratio = 0.3 }
contact = { law = "hertz-tsuji", friction = 0.4, restitution = 0.1, surface_energy = 0.01, adhesion = "jkr" }
sample = { grains = 150, radius_min = 0.8e-3, radius_max = 1.2e-3, length = 10e-3, width = 10e-3, boundary = "periodic" }
load.pressure = 5e2
pack.tolerance = 0.1
shear = { inertial_number = 0.2, strain = 0.4 }
"#,
    ),
    (
        "mixture",
        r#"
sample = { grains = 100, radius_min = 0.8e-3, radius_max = 1.2e-3, length = 21e-3, boundary = "periodic" }
load.pressure = 5e3
pack.tolerance = 0.1
shear = { inertial_number = 0.2, strain = 0.4 }
[contact]
law = "hooke"
normal_stiffness = 1e7
friction = 0.4
restitution = 0.1
attraction = 2.0
pair = [{ materials = ["light", "heavy"], attraction = 8.0 }]
[[material]]
name = "light"
density = 2500.0
[[material]]
name = "heavy"
density = 5000.0
fraction = 0.5
"#,
    ),
];

fn spectrum(arguments: &[&str]) -> String {
    let mut command = reducer();
    let output = succeed(command.args(["spectrum", "--threads", "1"]).args(arguments));
    String::from_utf8(output.stdout).expect("text")
}

fn path(folder: &Path, name: &str) -> String {
    folder.join(name).to_str().expect("UTF-8").to_string()
}

/// The flags of the last frame.
fn flags_of_the_last_frame(run: &Path, name: &str) -> Vec<u8> {
    let file = hdf5::File::open(run.join("run.h5")).expect("run.h5");
    let contacts = |name: &str| {
        let dataset = file.dataset(&format!("connectivity/contacts/{name}"));
        dataset.expect("a dataset")
    };
    let ends: Vec<u64> = contacts("offset").read_raw().expect("offsets");
    let flags: Vec<u8> = contacts(name).read_raw().expect("flags");
    let [.., from, to] = ends[..] else {
        panic!("no frames");
    };
    flags[from as usize..to as usize].to_vec()
}

/// A frame and the checkpoint of the same step have the same K and M, to the last bit, in two
/// dimensions and three, between walls and in a box; what is exported and read again has the same
/// eigenvalues.
#[test]
fn frames_and_checkpoints_have_one_stiffness() {
    let folder = tempfile::tempdir().expect("a folder");
    let in_space = path(folder.path(), "mindlin.toml");
    fs::write(&in_space, MINDLIN).expect("a scene");
    let in_plane = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing.toml");
    let in_box = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");
    let each_step = "output.frame_strain=1e-9";
    for (name, scene, set, per_grain) in [
        ("plane", in_plane, each_step, 3),
        ("space", in_space.as_str(), each_step, 6),
        ("box", in_box, "aqs.frame_every=1", 6),
    ] {
        let (stop, file, state) = match name {
            "box" => (5, "run.h5", "aqs step 5 in"),
            _ => (60, "run.h5", "step 60 of the shear"),
        };
        let run = folder.path().join(name);
        let arguments = [
            scene.into(),
            format!("--set={set}"),
            format!("--stop-at={stop}"),
        ];
        let outcome = gshear_mpi(1, &run, &arguments);
        assert_eq!(outcome.code, 75, "{}", outcome.text);

        let export = |what: &str| path(folder.path(), &format!("{name}-{what}.mtx"));
        let out = |what: &str| path(folder.path(), &format!("{name}-{what}"));
        let (frame, checkpoint) = (export("frame"), export("checkpoint"));
        let whole = path(&run, "checkpoint.h5");
        let said = spectrum(&[
            &whole,
            "--count",
            "12",
            "--export-matrix",
            &checkpoint,
            "--out",
            &out("a"),
        ]);
        assert!(said.contains(state), "{said}");
        let of_run = path(&run, file);
        let said = spectrum(&[
            &of_run,
            "--count",
            "12",
            "--export-matrix",
            &frame,
            "--out",
            &out("b"),
        ]);
        assert!(said.contains(&format!("(step {stop})")), "{said}");
        if name != "box" {
            let flagged = flags_of_the_last_frame(&run, "sliding");
            let flagged = flagged.iter().filter(|flag| **flag == 1).count();
            assert!(flagged > 0, "{name}: nothing slides");
            let of_them = format!(" contacts, {flagged} of them sliding");
            assert!(
                said.contains(&of_them),
                "{name}: {flagged} slide, but {said}"
            );
        }
        let read = |file: &str| fs::read(file).expect("a file");
        assert!(read(&frame) == read(&checkpoint), "{name}: K differs");
        let mass = |file: &str| file.replace(".mtx", ".mass.mtx");
        assert!(
            read(&mass(&frame)) == read(&mass(&checkpoint)),
            "{name}: M differs"
        );

        let group = per_grain.to_string();
        let mass = mass(&frame);
        let out_of_files = out("c");
        let mut of_files = vec!["--matrix", &frame, "--mass", &mass, "--count", "12"];
        of_files.extend(["--group", &group, "--out", &out_of_files]);
        // No walls hold the grains of a box.
        let null = frame.replace(".mtx", ".null.mtx");
        if Path::new(&null).exists() {
            of_files.extend(["--null", &null]);
        }
        spectrum(&of_files);
        let table = |what: &str| {
            fs::read_to_string(Path::new(&out(what)).join("spectrum.csv")).expect("a table")
        };
        assert!(table("a").lines().count() > 12);
        assert!(
            table("a") == table("b") && table("a") == table("c"),
            "{name}: eigenvalues differ"
        );
    }
}

/// The same of grains that attract each other: F_n of a contact that a damper holds back is not 0
/// there, and the frame says so by a flag of its own.
#[test]
fn frames_of_grains_that_attract_have_the_stiffness_of_checkpoints() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, scene) in ATTRACTING {
        let file = path(folder.path(), &format!("{name}.toml"));
        fs::write(&file, scene).expect("a scene");
        let run = folder.path().join(name);
        let each_step = "--set=output.frame_strain=1e-9";
        let outcome = gshear_mpi(1, &run, &[file, each_step.into(), "--stop-at=400".into()]);
        assert_eq!(outcome.code, 75, "{}", outcome.text);
        let idle = flags_of_the_last_frame(&run, "idle");
        assert!(idle.contains(&1), "{name}: no damper holds a contact back");
        let whole = path(&run, "checkpoint.h5");
        let [frame, checkpoint] = [path(&run, "run.h5"), whole].map(|state| {
            let matrix = format!("{state}.mtx");
            let out = format!("{state}.spectrum");
            spectrum(&[
                &state,
                "--count",
                "2",
                "--export-matrix",
                &matrix,
                "--out",
                &out,
            ]);
            fs::read(matrix).expect("a matrix")
        });
        assert!(frame == checkpoint, "{name}: K differs");

        // A file of an earlier version lacks the flag, and its sum; flags come last.
        change_file(&run.join("run.h5"), |file| {
            file.unlink("connectivity/contacts/idle").expect("removed");
            let name = "checksums/frames";
            let sums = file.dataset(name).expect("sums").read_2d::<u64>();
            let sums = sums.expect("numbers");
            let fewer = sums.slice(ndarray::s![.., ..sums.ncols() - 1]).to_owned();
            file.unlink(name).expect("removed");
            let made = file.new_dataset_builder().with_data(&fewer).create(name);
            made.expect("sums");
        });
        let state = path(&run, "run.h5");
        let out = path(&run, "old");
        for command in ["spectrum", "stability"] {
            let output = reducer().args([command, &state, "--out", &out]).output();
            let output = output.expect("it starts");
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(2), "{command}: {said}");
            assert!(said.contains("did not store; give a checkpoint"), "{said}");
            assert!(!Path::new(&out).exists(), "{command}");
        }
    }
}

/// A table by its columns.
fn table(path: &Path) -> BTreeMap<String, Vec<String>> {
    let mut reader = csv::Reader::from_path(path).expect("a table");
    let names: Vec<String> = (reader.headers().expect("a header").iter())
        .map(String::from)
        .collect();
    let mut columns: Vec<Vec<String>> = vec![Vec::new(); names.len()];
    for row in reader.records() {
        let row = row.expect("a row");
        for (column, cell) in columns.iter_mut().zip(&row) {
            column.push(cell.into());
        }
    }
    names.into_iter().zip(columns).collect()
}

fn numbers(column: &[String]) -> Vec<f64> {
    let read = |cell: &String| cell.parse().expect("a number");
    column.iter().map(read).collect()
}

/// `stability` counts what `spectrum` finds, in both forms of the matrix, and `growth` holds what
/// run.h5/newtonian says.
#[test]
fn stability_and_growth_of_boxes_are_what_their_runs_say() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");
    let runs = [3, 4].map(|seed| {
        let run = folder.path().join(format!("seed-{seed}"));
        let sets = [
            format!("seed={seed}"),
            "sample.grains=60".into(),
            "aqs.steps=5".into(),
            "aqs.frame_every=1".into(),
            "aqs.spectrum=true".into(),
            "aqs.birth_precision=1e-3".into(),
        ];
        let mut arguments = vec![scene.to_string()];
        arguments.extend(sets.map(|set| format!("--set={set}")));
        let outcome = gshear_mpi(1, &run, &arguments);
        assert_eq!(outcome.code, 0, "{}", outcome.text);
        run
    });
    let reduce = |arguments: &[&str]| {
        let mut command = reducer();
        let output = succeed(command.args(["--threads", "1"]).args(arguments));
        String::from_utf8(output.stdout).expect("text")
    };
    for (form, options) in [("ours", &[][..]), ("paper", &["--paper-form"][..])] {
        for (k, run) in runs.iter().enumerate() {
            let out = path(folder.path(), &format!("{form}-{k}"));
            let of_run = path(run, "run.h5");
            reduce(&[&["stability", &of_run, "--out", &out], options].concat());
            let counted = table(&Path::new(&out).join("stability.csv"));
            let pairs = numbers(&counted["pairs"]);
            assert_eq!(pairs.len(), 6);
            // Without tangential forces K is symmetric.
            assert_eq!(pairs[0], 0.0);
            let first = pairs.iter().position(|pairs| *pairs > 0.0).expect("a pair");
            let until = path(folder.path(), &format!("until-{form}-{k}"));
            let command = ["stability", &of_run, "--until-pair", "--out", &until];
            reduce(&[&command, options].concat());
            let until = table(&Path::new(&until).join("stability.csv"));
            for (name, column) in &until {
                assert_eq!(column[..], counted[name][..=first], "{name}");
            }
            reduce(
                &[
                    &["spectrum", &of_run, "--frame=5", "--dense", "--out", &out],
                    options,
                ]
                .concat(),
            );
            let found = table(&Path::new(&out).join("spectrum.csv"));
            let (re, im) = (numbers(&found["lambda_re"]), numbers(&found["lambda_im"]));
            let with = |verdict: &str, counts: &dyn Fn(usize) -> bool| {
                let of = (0..re.len()).filter(|k| found["verdict"][*k] == verdict && counts(*k));
                of.count() as f64
            };
            assert_eq!(pairs[5], with("pair", &|k| im[k] > 0.0));
            assert_eq!(
                numbers(&counted["negative"])[5],
                with("real", &|k| re[k] < 0.0)
            );
            let greatest = im.iter().copied().fold(0.0, f64::max);
            let counted = numbers(&counted["imaginary_greatest"])[5];
            assert!(
                (counted / greatest - 1.0).abs() < 1e-9,
                "{counted} {greatest}"
            );
        }
    }
    for run in &runs {
        reduce(&["growth", run.to_str().expect("UTF-8")]);
        let growth = table(&run.join("growth.csv"));
        let moving = RunFile::open_any(&run.join("run.h5/newtonian")).expect("a run");
        let (time, stress) = (
            &moving.series().time,
            moving.series().column("shear_stress"),
        );
        let last = time[time.len() - 1];
        let begin = last - 0.1 * (last - time[0]);
        let from = time.iter().position(|t| *t >= begin).expect("rows");
        let mut sum = 0.0;
        for k in from + 1..time.len() {
            sum += 0.5 * (stress[k - 1] + stress[k]) * (time[k] - time[k - 1]);
        }
        let end = sum / (time[time.len() - 1] - time[from]);
        let change = (end - stress[0]).abs();
        let pressure = moving.series().column("pressure")[0];
        let found = numbers(&growth["change_over_pressure"])[0];
        // The change is a small difference of these.
        let rounding = 1e-12 * (end.abs() + stress[0].abs());
        assert!((found - change / pressure).abs() < rounding / pressure);
        let found = numbers(&growth["change_over_stress"])[0];
        assert!((found - change / stress[0].abs()).abs() < rounding / stress[0].abs());
        let grains = table(&run.join("growth-grains.csv"));
        let weights = numbers(&grains["eigenvector_square"]);
        assert_eq!(weights.len(), 60);
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        // Cauchy and Schwarz.
        let overlap = numbers(&growth["overlap"])[0];
        assert!(overlap > 0.0 && overlap <= 1.0, "{overlap}");
    }
}
