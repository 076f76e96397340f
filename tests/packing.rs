//! Packings that leave the program and come back, and others' packings, through the real programs.

mod common;

use std::path::Path;
use std::process::Command;

use common::{gshear_mpi, succeed};
use gshear_scene::lammps_data::{Atom, DataFile, parse};
use gshear_store::run_reader::RunFile;

const CROSSING: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing.toml");
const TRIANGULAR: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/triangular.data");

/// `gshear-reduce export` of a run or a checkpoint.
fn export(run: &Path, arguments: &[&str], out: &Path) -> DataFile {
    succeed(
        Command::new(env!("CARGO_BIN_EXE_gshear-reduce"))
            .args(["export", "--format=lammps-data", "--out"])
            .arg(out)
            .args(arguments)
            .arg(run),
    );
    parse("exported", &std::fs::read_to_string(out).expect("a file")).expect("what was written")
}

/// In an order that both have: ids are given out anew.
fn by_place(mut file: DataFile) -> Vec<Atom> {
    let key = |a: &Atom| a.position;
    file.atoms
        .sort_by(|a, b| key(a).partial_cmp(&key(b)).expect("numbers"));
    file.atoms
}

/// The same sheared grains, to the last bit, in the checkpoint that they are read from and in the first frame after that.
#[test]
fn an_exported_state_comes_back() {
    let _alone = common::alone();
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let stop = gshear_mpi(1, &at("first"), &[CROSSING.into(), "--stop-at=700".into()]);
    assert_eq!(stop.code, 75, "{}", stop.text);
    let out = export(&at("first/checkpoint.h5"), &[], &at("first.data"));

    // The path is that of the configuration's folder.
    let scene = std::fs::read_to_string(CROSSING).expect("the scene");
    let (head, tail) = scene.split_once("grains = 220").expect("its sample");
    let tail = tail.split_once("length = 21e-6").expect("its length").1;
    let scene = format!("{head}packing = \"first.data\"{tail}").replace("tolerance = 1e-4", "");
    std::fs::write(at("again.toml"), &scene).expect("written");
    let arguments = |more: &[&str]| {
        let mut all = vec![at("again.toml").display().to_string()];
        all.extend(more.iter().map(ToString::to_string));
        all
    };
    let short = "--set=shear.strain=0.2";
    let one = gshear_mpi(1, &at("again"), &arguments(&[short]));
    let expected = one.digest();
    assert!(one.text.contains("types 2 (bottom)"), "{}", one.text);

    let back = export(&at("again"), &["--frame=0"], &at("back.data"));
    assert_eq!(back.bounds[0], out.bounds[0]);
    for (a, b) in by_place(out).iter().zip(by_place(back)) {
        assert_eq!((a.kind, a.diameter), (b.kind, b.diameter));
        assert_eq!((a.density, a.position), (b.density, b.position));
        if a.kind == 1 {
            assert_eq!(
                (a.velocity, a.angular_velocity),
                (b.velocity, b.angular_velocity)
            );
        }
    }

    // The ranks do not matter, nor who reads the scene that was written; and a checkpoint does without the file.
    for ranks in [2, 3] {
        let other = gshear_mpi(ranks, &at("ranks"), &arguments(&[short, "--overwrite"]));
        assert_eq!(other.digest(), expected, "{ranks} ranks");
    }
    let written = at("again/scene.toml").display().to_string();
    assert_eq!(gshear_mpi(1, &at("written"), &[written]).digest(), expected);
    let broken = gshear_mpi(2, &at("broken"), &arguments(&[short, "--stop-at=100"]));
    assert_eq!(broken.code, 75, "{}", broken.text);
    std::fs::rename(at("first.data"), at("away.data")).expect("renamed");
    let resume = format!("--resume={}", at("broken/checkpoint.h5").display());
    assert_eq!(gshear_mpi(1, &at("broken"), &[resume]).digest(), expected);
    export(
        &at("broken/checkpoint.h5"),
        &[],
        &at("without-its-file.data"),
    );
    // From the beginning it is needed.
    for ranks in [1, 2] {
        let lost = gshear_mpi(ranks, &at("lost"), &arguments(&[]));
        assert_eq!(lost.code, 2);
        let said = format!(
            "error: {}:17: sample.packing: {}: no such file",
            at("again.toml").display(),
            at("first.data").display()
        );
        assert_eq!(lost.text.matches("error: ").count(), 1);
        assert!(lost.text.contains(&said), "{}", lost.text);
        assert!(!at("lost").exists());
    }
}

/// As LAMMPS users have them, from the command line, sheared as it is and packed first.
/// Walls are the grains whose centre is within `sample.wall_thickness` of a plane, and H counts from
/// there.
#[test]
fn walls_are_as_thick_as_asked() {
    let _alone = common::alone();
    let folder = tempfile::tempdir().expect("a folder");
    let mut counts = Vec::new();
    for layers in [1.0, 2.0] {
        let at = folder.path().join(format!("walls-{layers}"));
        let arguments = [
            CROSSING.into(),
            "--set=sample.grains=300".into(),
            "--set=shear.strain=0.02".into(),
            format!("--set=sample.wall_thickness={layers:?}"),
        ];
        gshear_mpi(1, &at, &arguments).digest();
        let run = RunFile::open(&at).expect("a run");
        let thickness = layers * 1.5e-6;
        let top = run.number("height_start").expect("H") + thickness;
        let atoms = export(&at, &["--frame=0"], &at.join("walls.data")).atoms;
        for atom in &atoms {
            let expected = match atom.position[1] {
                y if y < thickness => 2,
                y if y > top => 3,
                _ => 1,
            };
            assert_eq!(atom.kind, expected, "{:?}", atom.position);
        }
        let of_kind = |kind| atoms.iter().filter(|a| a.kind == kind).count();
        counts.push([of_kind(2), of_kind(3)]);
    }
    for wall in [0, 1] {
        assert!(2 * counts[1][wall] > 3 * counts[0][wall], "{counts:?}");
    }
}

#[test]
fn anothers_packing_is_sheared() {
    let _alone = common::alone();
    let folder = tempfile::tempdir().expect("a folder");
    let scene = "
        material.density = 2500
        contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.5, damping_ratio = 0.3 }
        load.stiffness_number = 1e3
        pack.tolerance = 1e-4
        shear = { inertial_number = 0.01, strain = 0.02 }
        [sample]
        packing = 'is given below'
        ";
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, scene).expect("written");
    let run = |name: &str, ranks, sets: &[&str]| {
        let mut arguments = vec![
            path.display().to_string(),
            "--overwrite".into(),
            format!("--set=sample.packing={TRIANGULAR}"),
        ];
        arguments.extend(sets.iter().map(|s| format!("--set={s}")));
        gshear_mpi(ranks, &folder.path().join(name), &arguments)
    };
    for (name, sets) in [
        ("types", &["pack.tolerance=none"][..]),
        ("layers", &["pack.tolerance=none", "sample.walls=layers"]),
        ("packed", &["pack.skip=false"]),
    ] {
        let one = run(name, 1, sets);
        assert_eq!(one.digest(), run("two", 2, sets).digest(), "{name}");
        assert_eq!(
            one.text.contains("at rest after"),
            name == "packed",
            "{}",
            one.text
        );
        let first = export(
            &folder.path().join(name),
            &["--frame=0"],
            &folder.path().join("first.data"),
        );
        let of = |kind| first.atoms.iter().filter(|a| a.kind == kind).count();
        assert_eq!([of(1), of(2), of(3)], [100, 10, 10], "{name}");
    }

    let outside = folder.path().join("outside.data");
    let text = std::fs::read_to_string(TRIANGULAR).expect("the packing");
    let squeezed = text.replace("11 1 0.001 2500", "11 1 0.0013 2500");
    std::fs::write(&outside, squeezed).expect("written");
    let set = format!("sample.packing={}", outside.display());
    for ranks in [1, 2] {
        let refused = run("refused", ranks, &["pack.tolerance=none", &set]);
        assert_eq!(refused.code, 2, "{}", refused.text);
        let said = format!("error: {}:19: atom 11 overlaps atom ", outside.display());
        assert!(refused.text.contains(&said), "{}", refused.text);
        assert!(!folder.path().join("refused").exists());
    }
}
