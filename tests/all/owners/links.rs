//! Symbolic links in a folder that came from somebody else: nothing is written where they lead.

use std::os::unix::fs::symlink;
use std::path::Path;

use super::{BOX, SCENE, SHORT, attribute, ended, resume, run, stopped};
use crate::common::{copy_folder, gshear_mpi, kept_files, no_parts, reducer, same_run};

const TEXT: &str = "alias ll='ls -l'\n";

/// Links of these names in a folder, in place of what is there, to a file of the user's.
fn plant(folder: &Path, names: &[&str], file: &Path) {
    std::fs::create_dir_all(file.parent().expect("a folder")).expect("a folder");
    std::fs::write(file, TEXT).expect("written");
    for name in names {
        let path = folder.join(name);
        let _ = std::fs::remove_file(&path);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        symlink(file, path).expect("a link");
    }
}

fn untouched(file: &Path) {
    let text = std::fs::read_to_string(file).expect("the file of the user");
    assert!(text == TEXT, "{text:.200}");
}

#[test]
fn a_resume_writes_through_no_link() {
    let temporary = tempfile::tempdir().expect("a folder");
    let at = |name: &str| temporary.path().join(name);
    let victim = at("home/.bashrc");
    let expected = run(&at("whole"), &[SCENE, SHORT]).digest();
    stopped(&at("gift"), "100", &[]);
    let parts = [
        "scene.toml.part",
        "status.json.part",
        "checkpoint.h5.part",
        "checkpoint.h5.link",
        "run.h5.journal.part",
    ];
    let names = ["status.json", "scene.toml", "run.h5.journal"];
    for ranks in [1, 2] {
        let gift = at(&format!("gift-{ranks}"));
        copy_folder(&at("gift"), &gift);
        plant(&gift, &[&parts[..], &names].concat(), &victim);
        let outcome = gshear_mpi(ranks, &gift, &[resume(&gift)]);
        untouched(&victim);
        assert_eq!(outcome.digest(), expected);
        same_run(&at("whole"), &gift);
        assert!(!gift.join("scene.toml").is_symlink());
    }
    // What would be continued is refused.
    let gift = at("gift-1");
    copy_folder(&at("gift"), &gift);
    plant(&gift, &["log.csv"], &victim);
    ended(
        &run(&gift, &[&resume(&gift)]),
        2,
        &["log.csv: ", "a link to one"],
    );
    let log = std::fs::read(at("gift/log.csv")).expect("a log");
    std::fs::write(&victim, &log).expect("written");
    ended(
        &run(&gift, &[&resume(&gift)]),
        2,
        &["log.csv", "a link to one"],
    );
    assert!(std::fs::read(&victim).expect("a log") == log);

    // A file that a later stage begins.
    ended(
        &run(&at("box"), &[BOX, "--set=newtonian.spectra=2"]),
        0,
        &[],
    );
    let gift = at("boxed");
    ended(
        &run(&gift, &[BOX, "--set=newtonian.spectra=2", "--stop-at=5"]),
        75,
        &[],
    );
    plant(&gift, &["spectra.csv"], &victim);
    ended(&run(&gift, &[&resume(&gift)]), 0, &[]);
    untouched(&victim);
    let digest = |folder: &str| attribute(&at(folder).join("run.h5/newtonian"), "digest");
    assert_eq!(digest("boxed"), digest("box"));
    no_parts(&gift);
}

/// A `run.h5` on another disk.
#[test]
fn a_run_file_that_the_user_links_is_written_and_continued_there() {
    let temporary = tempfile::tempdir().expect("a folder");
    let at = |name: &str| temporary.path().join(name);
    let expected = run(&at("whole"), &[SCENE, SHORT]).digest();
    std::fs::create_dir_all(at("disk")).expect("a folder");
    std::fs::create_dir(at("own")).expect("a folder");
    // The folder itself is a link, too.
    symlink(at("own"), at("link")).expect("a link");
    stopped(&at("link"), "100", &[]);
    std::fs::rename(at("own/run.h5"), at("disk/run.h5")).expect("moved");
    symlink("../disk/run.h5", at("own/run.h5")).expect("a link");
    assert_eq!(run(&at("link"), &[&resume(&at("link"))]).digest(), expected);
    assert!(at("own/run.h5").is_symlink());
    same_run(&at("whole"), &at("own"));
}

#[test]
fn the_reducer_writes_through_no_link() {
    let temporary = tempfile::tempdir().expect("a folder");
    let victim = temporary.path().join("home/.bashrc");
    let walls = kept_files("walls", temporary.path());
    let boxed = kept_files("box", temporary.path());
    let names = [
        "reduced.h5",
        "phases.csv",
        "regions.csv-metadata.json",
        "frames.csv",
        "frames.vtkhdf",
        "frames.npz",
        "report/index.html",
        "report/summary.json",
        "spectrum.h5",
        "spectrum.csv",
        "spectrum.svg",
    ];
    let parts = names.map(|name| format!("{name}.part"));
    let all: Vec<&str> = names
        .into_iter()
        .chain(parts.iter().map(|part| &**part))
        .collect();
    for folder in [&walls, &boxed] {
        plant(folder, &all, &victim);
    }
    let export = |format| ["export", "--format", format];
    for (words, run) in [
        (&["dmin"][..], &walls),
        (&["phases"], &walls),
        (&["regions"], &walls),
        (&["report"], &walls),
        (&export("csv"), &walls),
        (&export("vtkhdf"), &walls),
        (&export("npz"), &walls),
        (&["spectrum"], &boxed),
    ] {
        let mut command = reducer();
        crate::common::succeed(command.args(words).arg(run));
        untouched(&victim);
    }
    assert!(names[..8].iter().all(|name| !walls.join(name).is_symlink()));
}

/// A link to a folder would be entered, and its files replaced.
#[test]
fn the_reducer_enters_no_linked_folder() {
    let temporary = tempfile::tempdir().expect("a folder");
    let home = temporary.path().join("home");
    std::fs::create_dir(&home).expect("a folder");
    let walls = kept_files("walls", temporary.path());
    for (name, words) in [
        ("report", &["report"][..]),
        ("rate-state", &["rate-state"]),
        ("movie", &["movie", "--out", "movie.png"]),
        ("movie.png", &["movie"]),
        ("replay-0..1", &["replay", "--strain", "0..1"]),
        ("reduced.h5", &["dmin"]),
        ("frames.npz", &["export", "--format=npz"]),
    ] {
        // Of a replay the numbers are in the name.
        let link = walls.join(name.replace("0..1", "0-1"));
        symlink(&home, &link).expect("a link");
        let mut command = reducer();
        let command = command.args(words).arg(&walls).current_dir(&walls);
        // Without ffmpeg.
        let output = command
            .env("PATH", "")
            .output()
            .expect("the program starts");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{name}: {said}");
        assert!(said.contains("is a link to a folder"), "{name}: {said}");
        let left = std::fs::read_dir(&home).expect("a folder").count();
        assert_eq!(left, 0, "{name}");
        std::fs::remove_file(&link).expect("removed");
    }
    // The folder of the run itself may be one, and what the user names.
    let [run, out] = ["run", "out"].map(|name| temporary.path().join(name));
    symlink(&walls, &run).expect("a link");
    symlink(&home, &out).expect("a link");
    let mut command = reducer();
    crate::common::succeed(command.arg("phases").arg(&run));
    let mut command = reducer();
    crate::common::succeed(command.arg("phases").arg(&run).arg("--out").arg(&out));
    assert!(walls.join("phases.csv").exists() && home.join("phases.csv").exists());
}
