//! `gshear-reduce spectrum` of runs and checkpoints, through the real programs.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crate::common::{gshear_mpi, reducer, succeed};
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

fn spectrum(arguments: &[&str]) -> String {
    let mut command = reducer();
    let output = succeed(command.args(["spectrum", "--threads", "1"]).args(arguments));
    String::from_utf8(output.stdout).expect("text")
}

fn path(folder: &Path, name: &str) -> String {
    folder.join(name).to_str().expect("UTF-8").to_string()
}

/// The number of contacts of the last frame that slide, as the file has them.
fn sliding_of_the_last_frame(run: &Path) -> usize {
    let file = hdf5::File::open(run.join("run.h5")).expect("run.h5");
    let contacts = |name: &str| {
        let dataset = file.dataset(&format!("connectivity/contacts/{name}"));
        dataset.expect("a dataset")
    };
    let ends: Vec<u64> = contacts("offset").read_raw().expect("offsets");
    let flags: Vec<u8> = contacts("sliding").read_raw().expect("flags");
    let [.., from, to] = ends[..] else {
        panic!("no frames");
    };
    let flags = &flags[from as usize..to as usize];
    flags.iter().filter(|flag| **flag == 1).count()
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
            let flagged = sliding_of_the_last_frame(&run);
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
