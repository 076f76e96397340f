//! Folders have owners, through the real program: what a run may write into, and what it leaves alone.

mod common;

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use common::{Outcome, gshear_mpi, same_run, succeed};
use gshear_driver::header::Header;
use gshear_store::checkpoint;

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing.toml");
const BOX: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");
const SHORT: &str = "--set=shear.strain=0.1";
/// Long enough to be interrupted.
const LONG: &str = "--set=shear.strain=500";

fn run(folder: &Path, arguments: &[&str]) -> Outcome {
    let arguments: Vec<String> = arguments.iter().map(ToString::to_string).collect();
    gshear_mpi(1, folder, &arguments)
}

/// Without `--out`.
fn plain(at: &Path, arguments: &[&str]) -> Outcome {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gshear-mpi"));
    let output = command.args(arguments).current_dir(at).output();
    let output = output.expect("the program starts");
    Outcome {
        code: output.status.code().unwrap_or(-1),
        text: String::from_utf8_lossy(&output.stdout).into_owned()
            + &String::from_utf8_lossy(&output.stderr),
    }
}

fn ended(outcome: &Outcome, code: i32, words: &[&str]) {
    assert_eq!(outcome.code, code, "{}", outcome.text);
    for word in words {
        assert!(
            outcome.text.contains(word),
            "no {word:?} in {}",
            outcome.text
        );
    }
    let errors = outcome.text.matches("error: ").count();
    assert_eq!(
        errors,
        usize::from(![0, 75].contains(&code)),
        "{}",
        outcome.text
    );
}

/// Every file of a folder with its bytes.
fn bytes(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    let paths = entries.map(|entry| entry.expect("an entry").path());
    paths
        .filter(|path| path.is_file())
        .map(|path| (path.clone(), std::fs::read(path).expect("a file")))
        .collect()
}

/// An attribute of `parameters` that is text.
fn attribute(file: &Path, name: &str) -> Option<String> {
    let file = hdf5::File::open(file).expect("a file of the run");
    let parameters = file.group("parameters").expect("parameters");
    let value = parameters.attr(name).ok()?;
    let value = value.read_scalar::<hdf5::types::VarLenUnicode>();
    Some(value.expect("text").to_string())
}

fn id_of_checkpoint(path: &Path) -> String {
    let [header, _] = checkpoint::read_texts(path).expect("a checkpoint");
    let (_, record) = Header::parse(&header).expect("a header");
    record.expect("a record").id
}

fn stopped(folder: &Path, step: &str, more: &[&str]) -> PathBuf {
    let outcome = run(
        folder,
        &[&[SCENE, SHORT, "--stop-at", step][..], more].concat(),
    );
    ended(&outcome, 75, &[]);
    folder.join("checkpoint.h5")
}

fn resume(path: &Path) -> String {
    format!("--resume={}", path.display())
}

#[test]
fn every_file_carries_the_identity() {
    let _alone = common::alone();
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
    let files = ["aqs.h5", "newtonian.h5"];
    let ids = files.map(|file| attribute(&at("box").join(file), "run_id"));
    assert!(ids[0].is_some() && ids[0] == ids[1]);
}

#[test]
fn a_checkpoint_does_not_enter_the_folder_of_another_run() {
    let _alone = common::alone();
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
    let _alone = common::alone();
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
    ended(&common::interrupted(&packing, &arguments), 75, &[]);
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

#[test]
fn resume_finds_the_newest_good_checkpoint() {
    let _alone = common::alone();
    let temporary = tempfile::tempdir().expect("a folder");
    let at = |name: &str| temporary.path().join(name);
    let expected = run(&at("whole"), &[SCENE, SHORT]).digest();

    // In its own folder, by the name alone.
    stopped(&at("here"), "100", &[]);
    let here = plain(
        &at("here"),
        &["--resume", "checkpoint.h5", "--stop-at", "200"],
    );
    ended(&here, 75, &[]);
    assert_eq!(plain(&at("here"), &["--resume", "."]).digest(), expected);
    same_run(&at("whole"), &at("here"));

    // The newest one is damaged: from the one before it.
    let damaged = at("damaged");
    stopped(&damaged, "100", &[]);
    ended(
        &run(&damaged, &[&resume(&damaged), "--stop-at=200"]),
        75,
        &[],
    );
    let newest = damaged.join("checkpoint.h5");
    let mut text = std::fs::read(&newest).expect("a checkpoint");
    let middle = text.len() / 2;
    text[middle] ^= 1;
    std::fs::write(&newest, text).expect("written");
    let outcome = run(&damaged, &[&resume(&damaged)]);
    assert!(outcome.text.contains("note: ") && outcome.text.contains("checkpoint.previous.h5"));
    assert_eq!(outcome.digest(), expected);
    same_run(&at("whole"), &damaged);

    // auto: from the start, from a checkpoint, finished.
    let auto = at("auto");
    let arguments = [SCENE, SHORT, "--resume=auto"];
    ended(
        &run(&auto, &[&arguments[..], &["--stop-at=100"]].concat()),
        75,
        &[],
    );
    assert_eq!(run(&auto, &arguments).digest(), expected);
    same_run(&at("whole"), &auto);
    let before = bytes(&auto);
    ended(&run(&auto, &arguments), 0, &["the run is finished"]);
    ended(
        &plain(&auto, &["--resume", "."]),
        0,
        &["the run is finished"],
    );
    assert!(bytes(&auto) == before, "a finished run is left alone");
    let other = run(&auto, &[SCENE, SHORT, "--resume=auto", "--set=seed=7"]);
    ended(
        &other,
        2,
        &["is of another run", "seed from 5 to 7", "--overwrite"],
    );
    assert!(bytes(&auto) == before);
    // A later end continues it.
    let longer = ["--set=shear.strain=0.12", "--resume=auto"];
    let outcome = run(&auto, &[&[SCENE][..], &longer].concat());
    let whole = run(&at("longer"), &[SCENE, longer[0]]);
    assert_eq!(outcome.digest(), whole.digest());

    ended(
        &run(&at("none"), &["--resume", SCENE]),
        2,
        &["not an HDF5 file"],
    );
    std::fs::create_dir(at("empty")).expect("a folder");
    ended(
        &plain(temporary.path(), &["--resume", "empty"]),
        2,
        &["holds no checkpoint"],
    );
}

#[test]
fn a_resume_that_fails_writes_nothing() {
    let _alone = common::alone();
    let temporary = tempfile::tempdir().expect("a folder");
    let out = temporary.path().join("out");
    ended(&run(&out, &[SCENE, SHORT]), 0, &[]);
    let log = std::fs::read(out.join("log.csv")).expect("log.csv");
    let lines: Vec<&[u8]> = log.split_inclusive(|&byte| byte == b'\n').collect();
    let checkpoint = out.join("checkpoint.h5");
    for text in [
        None,
        Some(lines[..5].concat()),
        Some(b"a,b\n1,2\n".to_vec()),
    ] {
        match &text {
            None => std::fs::remove_file(out.join("log.csv")).expect("removed"),
            Some(text) => std::fs::write(out.join("log.csv"), text).expect("written"),
        }
        let before = bytes(&out);
        ended(&run(&out, &[&resume(&checkpoint)]), 2, &["log.csv"]);
        assert!(bytes(&out) == before, "{text:?}");
    }
    std::fs::write(out.join("log.csv"), &log).expect("written");
    ended(&run(&out, &[&resume(&checkpoint)]), 0, &[]);
    assert_eq!(std::fs::read(out.join("log.csv")).expect("log.csv"), log);
}

/// Without run.h5 the log keeps its rows up to the checkpoint.
#[test]
fn a_lost_run_file_does_not_cut_the_log() {
    let _alone = common::alone();
    let temporary = tempfile::tempdir().expect("a folder");
    let at = |name: &str| temporary.path().join(name);
    run(&at("whole"), &[SCENE, SHORT]).digest();
    let out = at("out");
    let checkpoint = stopped(&out, "300", &[]);
    std::fs::remove_file(out.join("run.h5")).expect("removed");
    let outcome = run(&out, &[&resume(&checkpoint), "--stop-at=400"]);
    ended(
        &outcome,
        75,
        &[
            "note: ",
            "run.h5: is missing",
            "begins anew at shear step 300",
        ],
    );
    // Again from the checkpoint before the loss, whose numbers are those of the lost file.
    let before = resume(&out.join("checkpoint.previous.h5"));
    ended(&run(&out, &[&before, "--stop-at=400"]), 75, &[]);
    // And once more, with a run.h5 that has fewer rows than the log.
    ended(&run(&out, &[&resume(&checkpoint)]), 0, &[]);
    let log = |name: &str| std::fs::read_to_string(at(name).join("log.csv")).expect("log.csv");
    assert!(log("out") == log("whole"), "every row is there once");
    let file = hdf5::File::open(out.join("run.h5")).expect("run.h5");
    let steps = file.dataset("observables/strain/step").expect("steps");
    let steps: Vec<u64> = steps.read_raw().expect("steps");
    assert!(
        steps[0] > 300 && steps.is_sorted_by(|a, b| a < b),
        "{steps:?}"
    );
}

#[test]
fn a_resume_keeps_the_physics_and_records_the_rest() {
    let _alone = common::alone();
    let temporary = tempfile::tempdir().expect("a folder");
    let at = |name: &str| temporary.path().join(name);
    let out = at("out");
    let checkpoint = stopped(&out, "100", &[]);
    let before = bytes(&out);
    let from = resume(&checkpoint);
    for (set, words) in [
        (
            "contact.friction=0.4",
            &["contact.friction from 0.5 to 0.4", "--branch"][..],
        ),
        ("load.gravity=1", &["load.gravity", "--branch"]),
        ("seed=6", &["seed", "start a new run"]),
        ("sample.grains=221", &["sample.grains", "start a new run"]),
        (
            "shear.strain=0.0001",
            &["would end at step", "shear step 100"],
        ),
    ] {
        let outcome = run(&out, &[&from, &format!("--set={set}")]);
        ended(&outcome, 2, words);
    }
    ended(
        &run(&out, &[&from, "--stop-at=60"]),
        2,
        &["is at step 100 already"],
    );
    ended(
        &run(&out, &[&from, "--stop-at=100"]),
        2,
        &["is at step 100 already"],
    );
    ended(
        &run(&out, &[SCENE, &from]),
        2,
        &["takes the scene from the checkpoint"],
    );
    let branch = format!("--branch={}", at("branch").display());
    for set in [
        "--set=seed=6",
        "--set=sample.radius_max=1.1e-6",
        "--set=shear.inertial_number=0.2",
    ] {
        ended(&plain(temporary.path(), &[&from, &branch, set]), 2, &[]);
    }
    assert!(bytes(&out) == before && !at("branch").exists());

    let set = ["--set=shear.strain=0.05", "--set=output.frame_strain=0.01"];
    ended(&run(&out, &[&from, set[0], set[1]]), 0, &[]);
    let scene = std::fs::read_to_string(out.join("scene.toml")).expect("scene.toml");
    assert!(scene.contains("strain = 0.05"), "{scene}");
    let history = attribute(&out.join("run.h5"), "resumed").expect("a history");
    let wanted =
        "shear step 100: output.frame_strain from 0.02 to 0.01, shear.strain from 0.1 to 0.05";
    assert_eq!(history, wanted);
    assert!(scene.contains(&format!("# resumed at {wanted}")), "{scene}");
    let stored = attribute(&out.join("run.h5"), "scene").expect("a scene");
    assert!(stored.contains("strain = 0.05") && scene.ends_with(&stored));

    // A branch is another run, which says where it comes from.
    let early = stopped(&at("early"), "100", &[]);
    let arguments = [&resume(&early), &*branch, "--set=contact.friction=0.4"];
    ended(&plain(temporary.path(), &arguments), 0, &[]);
    let file = at("branch/run.h5");
    let parent = id_of_checkpoint(&early);
    assert_eq!(attribute(&file, "parent_run_id"), Some(parent.clone()));
    assert_eq!(
        attribute(&file, "branched_from").expect("an origin"),
        "shear step 100: contact.friction from 0.5 to 0.4"
    );
    assert_ne!(attribute(&file, "run_id"), Some(parent));
    let again = plain(temporary.path(), &arguments);
    ended(&again, 2, &["branch: holds", "--overwrite"]);
    // It can be resumed as any other run.
    let last = at("branch/checkpoint.h5");
    let longer = plain(
        temporary.path(),
        &[&resume(&last), "--set=shear.strain=0.12"],
    );
    ended(&longer, 0, &[]);
    let other = run(&at("branch"), &[&resume(&early)]);
    ended(&other, 2, &["is of another run"]);
}

#[test]
fn ends_of_a_box_are_not_moved_into_the_past() {
    let _alone = common::alone();
    let temporary = tempfile::tempdir().expect("a folder");
    let out = temporary.path().join("out");
    let small = ["--set=aqs.steps=4", "--set=newtonian.rows=10"];
    let start = [&[BOX, "--stop-at=3"][..], &small].concat();
    ended(&run(&out, &start), 75, &[]);
    let from = resume(&out.join("checkpoint.h5"));
    ended(
        &run(&out, &[&from, "--set=aqs.steps=2"]),
        2,
        &["aqs step 3"],
    );
    ended(
        &run(&out, &[&from, "--stop-at=3"]),
        2,
        &["is at step 3 already"],
    );
    ended(
        &run(&out, &[&from, "--set=contact.friction=0.2"]),
        2,
        &["--branch"],
    );
    ended(&run(&out, &[&from, "--stop-at=100"]), 75, &[]);
    ended(
        &run(&out, &[&from, "--set=aqs.steps=6"]),
        2,
        &["newtonian step"],
    );
    ended(
        &run(&out, &[&from, "--set=newtonian.growth_times=1e-3"]),
        2,
        &["growth_times"],
    );
    let whole = temporary.path().join("whole");
    let digest = |outcome: &Outcome| {
        let words = outcome.text.rsplit("digest ").next();
        words.map(|text| text[..32].to_string())
    };
    let resumed = run(&out, &[&from]);
    ended(&resumed, 0, &[]);
    let unbroken = run(&whole, &[&[BOX][..], &small].concat());
    assert_eq!(digest(&resumed), digest(&unbroken));
}

/// A run in the background, once it shears.
fn background(folder: &Path, more: &[&str]) -> Child {
    let mut child = Command::new(env!("CARGO_BIN_EXE_gshear-mpi"))
        .args([SCENE, LONG, "--out"])
        .arg(folder)
        .args(more)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut lines = BufReader::new(child.stdout.take().expect("its output"));
    let mut text = String::new();
    while !text.contains("shear:") && lines.read_line(&mut text).expect("text") > 0 {}
    let begun = Instant::now();
    while !folder.join("log.csv").exists() && begun.elapsed() < Duration::from_secs(30) {
        std::thread::sleep(Duration::from_millis(5));
    }
    // Drained, so that the program never waits for a reader.
    std::thread::spawn(move || std::io::copy(&mut lines, &mut std::io::sink()));
    child
}

fn signal(child: &Child, name: &str) {
    succeed(Command::new("sh").args(["-c", &format!("kill -{name} {}", child.id())]));
}

fn end(child: Child) -> Outcome {
    let output = child.wait_with_output().expect("its end");
    Outcome {
        code: output.status.code().unwrap_or(-1),
        text: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

#[test]
fn one_run_at_a_time_writes_into_a_folder() {
    let _alone = common::alone();
    let temporary = tempfile::tempdir().expect("a folder");
    let out = temporary.path().join("out");
    let mut child = background(&out, &[]);
    for arguments in [
        &[SCENE, LONG, "--overwrite"][..],
        &[SCENE, LONG, "--resume=auto"],
    ] {
        let pid = child.id().to_string();
        ended(
            &run(&out, arguments),
            2,
            &[&format!("process {pid} on "), "started 20"],
        );
    }
    signal(&child, "USR1");
    assert_eq!(end(child).code, 75);
    assert!(!out.join("run.lock").exists());

    // Killed: the lock stays, and is taken over.
    child = background(&temporary.path().join("killed"), &[]);
    child.kill().expect("killed");
    child.wait().expect("its end");
    let killed = temporary.path().join("killed");
    assert!(killed.join("run.lock").exists());
    let outcome = run(&killed, &[SCENE, SHORT, "--overwrite"]);
    ended(&outcome, 0, &["note: ", "is gone; took the lock over"]);
    assert!(!killed.join("run.lock").exists());
    // A run whose numbers fail leaves no lock.
    let hasty = temporary.path().join("hasty");
    ended(&run(&hasty, &[SCENE, "--set=pack.max_steps=2000"]), 3, &[]);
    assert!(!hasty.join("run.lock").exists());
    // The lock of another machine, without and with the flag.
    let lock = r#"{"host":"elsewhere","pid":1,"ticks":1,"started":"2026-01-01T00:00:00Z"}"#;
    std::fs::write(killed.join("run.lock"), lock).expect("written");
    let again = [SCENE, SHORT, "--overwrite", "--break-lock"];
    ended(
        &run(&killed, &again[..3]),
        2,
        &["process 1 on elsewhere", "--break-lock"],
    );
    ended(&run(&killed, &again), 0, &["note: "]);
}

#[test]
fn what_is_removed_during_a_run_is_missed() {
    let _alone = common::alone();
    let temporary = tempfile::tempdir().expect("a folder");
    for (name, words) in [
        ("run.h5", "run.h5: was removed during the run"),
        ("log.csv", "log.csv: was removed during the run"),
        ("", "folder of the results was removed"),
    ] {
        let out = temporary.path().join(format!("out-{name}"));
        let child = background(&out, &[]);
        match name {
            "" => std::fs::remove_dir_all(&out).expect("removed"),
            name => std::fs::remove_file(out.join(name)).expect("removed"),
        }
        signal(&child, "USR1");
        let outcome = end(child);
        assert_eq!(outcome.code, 1, "{name}: {}", outcome.text);
        let lost = outcome.text.contains(words) || outcome.text.contains("was removed during");
        assert!(lost, "{}", outcome.text);
    }
}

#[test]
fn a_folder_that_cannot_be_written_is_noticed_at_once() {
    let _alone = common::alone();
    let temporary = tempfile::tempdir().expect("a folder");
    let file = temporary.path().join("file");
    std::fs::write(&file, "").expect("written");
    for out in [file.clone(), file.join("out")] {
        let begun = run(&out, &[SCENE, "--set=pack.tolerance=1e-30"]);
        ended(&begun, 2, &["cannot be written", "--out"]);
        assert!(!begun.text.contains("pack:"), "{}", begun.text);
    }
    assert_eq!(
        std::fs::read_dir(temporary.path())
            .expect("a folder")
            .count(),
        1
    );
}

#[test]
fn signals_stop_a_run_from_its_first_moment() {
    let _alone = common::alone();
    let temporary = tempfile::tempdir().expect("a folder");
    for (k, (name, wait)) in [("USR1", 20), ("TERM", 20), ("HUP", 20), ("HUP", 1500)]
        .into_iter()
        .enumerate()
    {
        let out = temporary.path().join(k.to_string());
        let child = Command::new(env!("CARGO_BIN_EXE_gshear-mpi"))
            .args([SCENE, LONG, "--out"])
            .arg(&out)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        std::thread::sleep(Duration::from_millis(wait));
        signal(&child, name);
        let outcome = end(child);
        assert_eq!(outcome.code, 75, "{name} after {wait} ms: {}", outcome.text);
        assert!(out.join("checkpoint.h5").exists(), "{name}");
    }
}

/// A damaged newest checkpoint is of no interest to a window that begins at a kept one.
#[test]
fn a_replay_passes_over_damaged_checkpoints() {
    let _alone = common::alone();
    let temporary = tempfile::tempdir().expect("a folder");
    let out = temporary.path().join("out");
    let keep = [
        "--set=output.keep_checkpoints=true",
        "--set=output.checkpoint_strain=0.05",
    ];
    ended(&run(&out, &[&[SCENE, SHORT][..], &keep].concat()), 0, &[]);
    let replay = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gshear-reduce"));
        let command = command.arg("replay").arg(&out).args(arguments);
        command.output().expect("the program starts")
    };
    for name in ["checkpoint.h5", "checkpoint.previous.h5"] {
        std::fs::write(out.join(name), "damaged").expect("written");
    }
    let done = replay(&["--strain=0.01..0.03"]);
    assert!(
        done.status.success(),
        "{}",
        String::from_utf8_lossy(&done.stderr)
    );
    // Into the folder of another run.
    let other = temporary.path().join("other");
    ended(&run(&other, &[SCENE, SHORT]), 0, &[]);
    let refused = replay(&["--strain=0.01..0.03", "--out", &other.display().to_string()]);
    assert_eq!(refused.status.code(), Some(2));
}

/// A run of a sweep that lost its newest checkpoint goes on from the one before.
#[test]
fn a_sweep_resumes_from_the_checkpoint_before() {
    let _alone = common::alone();
    let temporary = tempfile::tempdir().expect("a folder");
    let at = |name: &str| temporary.path().join(name);
    let text = std::fs::read_to_string(SCENE).expect("the scene");
    std::fs::write(at("sweep.toml"), format!("{text}\n[sweep]\nseed = [5]\n")).expect("written");
    let config = at("sweep.toml").display().to_string();
    let member = at("out/seed-5");
    stopped(&member, "100", &[]);
    std::fs::rename(
        member.join("checkpoint.h5"),
        member.join("checkpoint.previous.h5"),
    )
    .expect("renamed");
    let listed = run(&at("out"), &[&config, SHORT, "--sweep=list"]);
    ended(&listed, 0, &["stopped"]);
    let outcome = run(&at("out"), &[&config, SHORT, "--sweep=1"]);
    ended(&outcome, 0, &["goes on from step 100"]);
    let whole = run(&at("whole"), &[SCENE, SHORT]);
    assert_eq!(outcome.digest(), whole.digest());
    same_run(&member, &at("whole"));
    // Another run in the folder of the member.
    let refused = run(
        &at("out"),
        &[&config, SHORT, "--sweep=1", "--set=contact.friction=0.4"],
    );
    ended(&refused, 2, &["is of another run"]);
}
