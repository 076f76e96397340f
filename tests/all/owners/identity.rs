//! Whose a folder is: the identity in every file, and what a new run refuses or replaces.

use super::{BOX, SCENE, SHORT, attribute, bytes, ended, id_of_checkpoint, resume, run, stopped};
use crate::common::{gshear_mpi, kept_files, reducer};
use gshear_store::checksums::{OF_PARAMETERS, of_parameters};
use gshear_store::run_reader::{Parameter, RunFile};

#[test]
fn every_file_carries_the_identity() {
    let temporary = tempfile::tempdir().expect("a folder");
    let at = |name: &str| temporary.path().join(name);
    stopped(
        &at("a"),
        "100",
        &["--set=title=Other", "--set=output.energy=false"],
    );
    stopped(&at("b"), "50", &[]);
    stopped(&at("c"), "50", &["--set=seed=6"]);
    let ids = ["a", "b", "c"].map(|name| {
        let folder = at(name);
        let id = id_of_checkpoint(&folder.join("checkpoint.h5"));
        assert_eq!(
            attribute(&folder.join("run.h5"), "run_id"),
            Some(id.clone())
        );
        let scene = std::fs::read_to_string(folder.join("scene.toml")).expect("scene.toml");
        assert!(scene.starts_with(&format!("# run_id {id}\n")), "{scene}");
        id
    });
    assert!(ids[0] == ids[1] && ids[0] != ids[2], "{ids:?}");
    assert_eq!(ids[0].len(), 32);
    // What scene.toml says is the same run.
    let scene = at("a/scene.toml").display().to_string();
    ended(&run(&at("a"), &[&scene, "--resume=auto"]), 0, &[]);

    let boxed = ["--set=aqs.steps=1", "--set=newtonian.growth_times=0.01"];
    ended(&run(&at("box"), &[&[BOX][..], &boxed].concat()), 0, &[]);
    let files = ["run.h5", "run.h5/newtonian"];
    let ids = files.map(|file| attribute(&at("box").join(file), "run_id"));
    assert!(ids[0].is_some() && ids[0] == ids[1]);
}

#[test]
fn a_checkpoint_does_not_enter_the_folder_of_another_run() {
    let temporary = tempfile::tempdir().expect("a folder");
    let at = |name: &str| temporary.path().join(name);
    let checkpoint = stopped(&at("a"), "100", &[]);
    for (name, set) in [
        ("seed", "--set=seed=6"),
        ("grains", "--set=sample.grains=200"),
    ] {
        ended(&run(&at(name), &[SCENE, SHORT, set]), 0, &[]);
        let before = bytes(&at(name));
        let refused = run(&at(name), &[&resume(&checkpoint)]);
        ended(&refused, 2, &["run.h5: is of another run", "--overwrite"]);
        assert!(bytes(&at(name)) == before, "{name}");
        // The other way round, into a run that was stopped.
        let own = bytes(&at("a"));
        let last = at(name).join("checkpoint.h5");
        ended(&run(&at("a"), &[&resume(&last)]), 2, &["is of another run"]);
        assert!(bytes(&at("a")) == own);
    }
    // A folder with nothing but a scene.toml of another run.
    std::fs::create_dir(at("scene")).expect("a folder");
    std::fs::copy(at("seed/scene.toml"), at("scene/scene.toml")).expect("copied");
    ended(
        &run(&at("scene"), &[&resume(&checkpoint)]),
        2,
        &["scene.toml: is of another run"],
    );
}

#[test]
fn a_new_run_replaces_nothing_unless_told() {
    let temporary = tempfile::tempdir().expect("a folder");
    let out = temporary.path().join("out");
    stopped(&out, "100", &[]);
    let before = bytes(&out);
    let again = run(&out, &[SCENE, SHORT]);
    ended(
        &again,
        2,
        &["up to shear step 100", "--resume auto", "--overwrite"],
    );
    let other = run(&out, &[SCENE, SHORT, "--set=seed=6"]);
    ended(&other, 2, &["holds another run", "--overwrite"]);
    assert!(!other.text.contains("--resume"), "{}", other.text);
    assert!(bytes(&out) == before);

    // Refused for another reason, an old run stays.
    let arguments = [SCENE, SHORT, "--overwrite"].map(String::from);
    let refused = gshear_mpi(12, &out, &arguments);
    ended(&refused, 2, &["12 ranks are too many"]);
    assert!(bytes(&out) == before);

    std::fs::create_dir(out.join("report")).expect("a folder");
    std::fs::write(out.join("report/index.html"), "old").expect("written");
    std::fs::write(out.join("mine.txt"), "mine").expect("written");
    std::fs::copy(out.join("checkpoint.h5"), out.join("checkpoint-7.h5")).expect("copied");
    ended(
        &run(&out, &[SCENE, SHORT, "--set=seed=6", "--overwrite"]),
        0,
        &[],
    );
    for gone in ["report", "checkpoint-7.h5", "run.lock"] {
        assert!(!out.join(gone).exists(), "{gone}");
    }
    assert!(out.join("mine.txt").exists());
    let finished = run(&out, &[SCENE, SHORT, "--set=seed=6"]);
    ended(&finished, 2, &["which is finished", "--overwrite"]);

    // Stopped while it is packed: there is a checkpoint and nothing else.
    let packing = temporary.path().join("packing");
    let arguments = [SCENE, "--set=pack.tolerance=1e-30"].map(String::from);
    ended(&crate::common::interrupted(&packing, &arguments), 75, &[]);
    let refused = run(&packing, &[SCENE, "--set=pack.tolerance=1e-30"]);
    ended(&refused, 2, &["up to pack step", "--resume auto"]);
    ended(&run(&packing, &[SCENE, SHORT]), 2, &["holds another run"]);
    // Boxes.
    let boxed = temporary.path().join("box");
    let arguments = [
        BOX,
        "--set=aqs.steps=1",
        "--set=newtonian.growth_times=0.01",
    ];
    ended(&run(&boxed, &arguments), 0, &[]);
    ended(&run(&boxed, &arguments), 2, &["which is finished"]);
    ended(&run(&boxed, &[SCENE, SHORT]), 2, &["holds another run"]);
}

/// One file holds the strain steps of a box and Newton's equations after them. Copied together from
/// two runs, with all checksums right, they are not taken for one.
#[test]
fn both_parts_of_a_file_are_of_one_run() {
    let temporary = tempfile::tempdir().expect("a folder");
    let folder = kept_files("box", temporary.path());
    let file = folder.join("run.h5");
    let part = file.join("newtonian");
    let mut parameters = RunFile::open_any(&part)
        .expect("a run")
        .parameters()
        .clone();
    let other = "0".repeat(32);
    parameters.insert("run_id".into(), Parameter::Text(other.clone()));
    {
        let opened = hdf5::File::open_rw(&file).expect("the file");
        let group = opened.group("newtonian/parameters").expect("parameters");
        let id: hdf5::types::VarLenUnicode = other.parse().expect("text");
        let attribute = group.attr("run_id").expect("the identity");
        attribute.write_scalar(&id).expect("written");
        let sum = hdf5::types::FixedAscii::<32>::from_ascii(&of_parameters(&parameters));
        let attribute = group.attr(OF_PARAMETERS).expect("the checksum");
        let sum = sum.expect("a word");
        attribute.write_scalar(&sum).expect("written");
    }

    let out = temporary.path().join("out");
    for (words, run) in [
        (&["info"][..], &file),
        (&["info"], &part),
        (&["report", "--out", "out"], &folder),
        (&["growth", "--out", "out"], &folder),
        (&["export", "--format=npz", "--out", "out/a.npz"], &file),
        (&["export", "--format=npz", "--out", "out/a.npz"], &part),
    ] {
        let mut command = reducer();
        command.args(words).arg(run).current_dir(temporary.path());
        let output = command.output().expect("the program starts");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{words:?}: {said}");
        assert!(said.contains("of different runs (run_id "), "{said}");
    }
    assert!(!out.exists(), "nothing is written");
}
