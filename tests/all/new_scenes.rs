//! `gshear-mpi new`: every scene is sound and runs, and no file is overwritten.

use std::path::Path;

use gshear_scene::templates::TEMPLATES;

use crate::common::{PROGRAM, REDUCER, mpirun, start, succeed};

/// Keys that make a run of a template short: a small sample, packed less precisely.
fn short(name: &str) -> Vec<String> {
    let (grains, length, others) = match name {
        "walls-2d" => (120, "10 mm", &["shear.strain=0.02"][..]),
        "walls-3d" => (
            260,
            "5 mm",
            &["sample.width=\"5 mm\"", "shear.strain=0.05"][..],
        ),
        "periodic" => (100, "10 mm", &["shear.strain=0.05"][..]),
        "chute" => (100, "15 mm", &["shear.protocol=[{ time = 0.1 }]"][..]),
        "slider" => (
            400,
            "20 mm",
            &[
                "sample.width=\"20 mm\"",
                "shear.protocol=[{ velocity = 0.5, time = 0.002 }, { velocity = 0, time = 1e-4 }]",
            ][..],
        ),
        "quasi-static" => return ["sample.grains=60", "aqs.steps=5"].map(String::from).into(),
        "cohesive" => (
            100,
            "10 mm",
            &["shear.protocol=[{ velocity = 0.5, time = 0.01 }]"][..],
        ),
        _ => panic!("{name}: no short run"),
    };
    let mut set = vec![
        format!("sample.grains={grains}"),
        format!("sample.length=\"{length}\""),
        "pack.tolerance=1e-2".into(),
    ];
    set.extend(others.iter().map(ToString::to_string));
    set
}

#[test]
fn every_scene_passes_its_check_and_runs() {
    let folder = tempfile::tempdir().expect("a folder");
    let program = || {
        let mut program = start(PROGRAM);
        program.current_dir(folder.path());
        program
    };
    for template in TEMPLATES {
        let name = template.name;
        let said = succeed(program().args(["new", name])).stdout;
        let said = String::from_utf8_lossy(&said);
        let file = format!("{name}.toml");
        let next = format!("wrote {file}; next: gshear-mpi {file} --check, then ");
        assert!(said.starts_with(&next), "{said}");
        let written = std::fs::read_to_string(folder.path().join(&file)).expect("a scene");
        assert_eq!(written, template.text);

        let checked = succeed(program().args([&file, "--check"]));
        let doubts = String::from_utf8_lossy(&checked.stderr).into_owned();
        assert!(!doubts.contains("warning: "), "{name}: {doubts}");

        let mut run = program();
        run.arg(&file);
        run.args(short(name).iter().map(|set| format!("--set={set}")));
        succeed(&mut run);
        let out = Path::new("out").join(name);
        let info = succeed(
            start(REDUCER)
                .current_dir(folder.path())
                .arg("info")
                .arg(out),
        );
        let info = String::from_utf8_lossy(&info.stdout).into_owned();
        assert!(info.contains("finished"), "{name}: {info}");
    }
}

#[test]
fn a_file_is_not_overwritten() {
    let folder = tempfile::tempdir().expect("a folder");
    let new = |arguments: &[&str]| {
        let mut command = start(PROGRAM);
        command
            .current_dir(folder.path())
            .arg("new")
            .args(arguments);
        let ended = command.output().expect("the program starts");
        let said = String::from_utf8_lossy(&ended.stderr).into_owned();
        (ended.status.code(), said)
    };
    assert_eq!(new(&["chute", "my.toml"]).0, Some(0));
    let path = folder.path().join("my.toml");
    std::fs::write(&path, "# mine").expect("written");
    let (code, said) = new(&["periodic", "my.toml"]);
    assert_eq!(code, Some(2), "{said}");
    assert_eq!(
        said,
        "error: my.toml: is there already; give the new scene another name: gshear-mpi new periodic OTHER.toml\n"
    );
    assert_eq!(std::fs::read_to_string(&path).expect("a file"), "# mine");
    for (arguments, words) in [
        (&["drum"][..], "[possible values: walls-2d, walls-3d, "),
        (&["chute", "chute"], "error: chute: is no name of a scene"),
        (
            &["chute", "no/where.toml"],
            "error: no/where.toml: cannot be written: ",
        ),
        (&[], "<NAME>"),
    ] {
        let (code, said) = new(arguments);
        assert_eq!(code, Some(2), "{said}");
        assert!(said.contains(words), "{said}");
    }
    let entries = std::fs::read_dir(folder.path()).expect("a folder");
    assert_eq!(entries.count(), 1);
    // One rank writes.
    let mut ranks = mpirun(2, PROGRAM);
    ranks.current_dir(folder.path()).args(["new", "slider"]);
    succeed(&mut ranks);
    assert!(folder.path().join("slider.toml").exists());
}
