//! What a resume finds, keeps, and refuses.

use super::{
    BOX, SCENE, SHORT, attribute, bytes, ended, id_of_checkpoint, plain, resume, run, stopped,
};
use crate::common::{Outcome, reducer, same_run};
use gshear_store::checkpoint;

#[test]
fn resume_finds_the_newest_good_checkpoint() {
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

/// A damaged newest checkpoint is of no interest to a window that begins at a kept one.
#[test]
fn a_replay_passes_over_damaged_checkpoints() {
    let temporary = tempfile::tempdir().expect("a folder");
    let out = temporary.path().join("out");
    let keep = [
        "--set=output.keep_checkpoints=true",
        "--set=output.checkpoint_strain=0.05",
    ];
    ended(&run(&out, &[&[SCENE, SHORT][..], &keep].concat()), 0, &[]);
    let replay = |arguments: &[&str]| {
        let mut command = reducer();
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

/// A run that begins with the one in its own folder does not remove that.
#[test]
fn a_packing_is_not_overwritten_by_its_run() {
    let temporary = tempfile::tempdir().expect("a folder");
    let folder = temporary.path().join("run");
    run(&folder, &[SCENE, SHORT]).digest();
    let before = bytes(&folder);
    let none = ["grains", "radius_min", "radius_max", "length"];
    let none = none.map(|key| format!("--set=sample.{key}=none"));
    for packing in ["", "/run.h5@1", "/checkpoint.h5"] {
        let packing = format!("--set=sample.packing={}{packing}", folder.display());
        let mut arguments = vec![SCENE, SHORT, "--overwrite", "--set=pack.tolerance=none"];
        arguments.extend(none.iter().map(String::as_str));
        arguments.push(&packing);
        let refused = run(&folder, &arguments);
        ended(
            &refused,
            2,
            &["--overwrite would remove ", "give another folder"],
        );
        assert!(bytes(&folder) == before);
    }
}

/// Going back to an older checkpoint removes the kept ones after it, which may be of another way to
/// go on; the same way makes them again.
#[test]
fn kept_checkpoints_are_of_the_run_that_goes_on() {
    let temporary = tempfile::tempdir().expect("a folder");
    let folder = temporary.path().join("run");
    let keep = [
        "--set=output.keep_checkpoints=true",
        "--set=output.checkpoint_strain=0.02",
    ];
    let whole = run(&folder, &[&[SCENE, SHORT], &keep[..]].concat());
    let kept = || -> Vec<u64> {
        let all = checkpoint::kept(&folder, "shear");
        all.into_iter().map(|(step, _)| step).collect()
    };
    let all = kept();
    assert!(all.len() > 3, "{all:?}");
    let from = folder.join(checkpoint::kept_name("shear", all[1]));
    let stop = format!("--stop-at={}", all[1] + 1);
    let back = run(&folder, &[&resume(&from), &stop]);
    assert_eq!(back.code, 75, "{}", back.text);
    // The stop has one, too.
    let of_stop = all[1] + 1;
    assert_eq!(kept(), [all[0], all[1], of_stop]);
    assert_eq!(run(&folder, &[&resume(&folder)]).digest(), whole.digest());
    let mut again = kept();
    again.retain(|step| *step != of_stop);
    assert_eq!(again, all);
}
