//! Bad input and failing numbers, through the real program: one message, the right exit code, nothing left behind.

mod common;

use std::path::Path;

use common::{gshear_mpi, interrupted};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing.toml");

/// The one line that a failing run says on its standard error, without `error: `.
fn message(text: &str) -> String {
    let said: Vec<&str> = text
        .lines()
        .filter_map(|l| l.strip_prefix("error: "))
        .collect();
    assert_eq!(said.len(), 1, "one message, not\n{text}");
    said[0].to_string()
}

fn refused(ranks: usize, out: &Path, arguments: &[String]) -> String {
    let outcome = gshear_mpi(ranks, out, arguments);
    assert_eq!(outcome.code, 2, "{}", outcome.text);
    assert!(!out.exists(), "something was written");
    message(&outcome.text)
}

#[test]
fn bad_scenes_are_refused_and_nothing_is_written() {
    let _alone = common::alone();
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let bad = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/bad_input");
    let entries = std::fs::read_dir(bad).expect("the bad inputs");
    let mut paths: Vec<_> = entries.map(|e| e.expect("an entry").path()).collect();
    paths.sort();
    // All of them are tested in bad_input.rs; here is to see that the program passes on what it is told.
    for path in paths.iter().step_by(11) {
        let text = std::fs::read_to_string(path).expect("a bad input is text");
        let expected = text
            .lines()
            .next()
            .and_then(|l| l.strip_prefix("# expect: "));
        let found = refused(1, &out, &[path.display().to_string()]);
        assert_eq!(
            found.replace(&format!("{bad}/"), ""),
            expected.expect("a message")
        );
    }
    // On ranks it is said once.
    let path = format!("{bad}/unknown_key.toml");
    assert!(refused(2, &out, &[path]).contains("unknown key"));
    let missing = folder.path().join("none.toml").display().to_string();
    assert!(
        refused(2, &out, std::slice::from_ref(&missing))
            .starts_with(&format!("{missing}: no such file"))
    );
}

#[test]
fn too_many_ranks_are_told_how_many_would_do() {
    let _alone = common::alone();
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    // The cell is 21 µm long, the greatest diameter 2 µm, the thinnest skin 0.015 µm: ten slabs, but for a margin.
    let said = refused(12, &out, &[SCENE.into()]);
    assert!(
        said.contains("12 ranks are too many") && said.contains("1 to 10 ranks"),
        "{said}"
    );
    let said = refused(
        8,
        &out,
        &[SCENE.into(), "--set=bookkeeping.skin=1.0".into()],
    );
    assert!(
        said.contains("8 ranks are too many") && said.contains("1 to 5 ranks"),
        "{said}"
    );
    let most = gshear_mpi(
        5,
        &out,
        &[
            SCENE.into(),
            "--set=bookkeeping.skin=1.0".into(),
            "--check".into(),
        ],
    );
    assert_eq!(most.code, 0, "{}", most.text);
}

#[test]
fn damaged_checkpoints_are_refused() {
    let _alone = common::alone();
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let good = folder.path().join("good");
    let stopped = gshear_mpi(1, &good, &[SCENE.into(), "--stop-at=10".into()]);
    assert_eq!(stopped.code, 75);
    let bytes = std::fs::read(good.join("checkpoint.h5")).expect("a checkpoint");
    let resume = |name: &str| format!("--resume={}", folder.path().join(name).display());

    let said = refused(1, &out, &[resume("none.h5")]);
    assert!(said.contains("none.h5"), "{said}");
    std::fs::write(folder.path().join("short.h5"), &bytes[..bytes.len() / 2]).expect("written");
    let said = refused(2, &out, &[resume("short.h5")]);
    assert!(said.contains("short.h5"), "{said}");
    let mut flipped = bytes.clone();
    let middle = bytes.len() / 2;
    flipped[middle] ^= 1;
    std::fs::write(folder.path().join("flipped.h5"), &flipped).expect("written");
    let said = refused(1, &out, &[resume("flipped.h5")]);
    assert!(said.contains("flipped.h5"), "{said}");
    std::fs::write(folder.path().join("text.h5"), "no HDF5").expect("written");
    let said = refused(1, &out, &[resume("text.h5")]);
    assert!(said.contains("text.h5"), "{said}");
}

/// Numbers that fail end every rank with exit code 3 and one message with step, ids and place.
#[test]
fn failing_numbers_end_the_run() {
    let _alone = common::alone();
    let folder = tempfile::tempdir().expect("a folder");
    for ranks in [1, 2] {
        // At the least stiffness number that the configuration allows, the collapse of the loose sample exceeds the law.
        let soft = [SCENE.into(), "--set=load.stiffness_number=11.0".into()];
        let outcome = gshear_mpi(ranks, &folder.path().join("soft"), &soft);
        assert_eq!(outcome.code, 3, "{}", outcome.text);
        let said = message(&outcome.text);
        for part in [
            "packing, step ",
            "grain",
            " at (",
            "outside the contact law",
        ] {
            assert!(said.contains(part), "{said}");
        }
    }
    // A time step twice the limit, forced, blows up while the sample is packed.
    let wild = [
        SCENE.into(),
        "--set=time.step=4e-9".into(),
        "--set=time.force=true".into(),
        "--set=pack.tolerance=1e-8".into(),
    ];
    let outcome = gshear_mpi(2, &folder.path().join("wild"), &wild);
    assert_eq!(outcome.code, 3, "{}", outcome.text);
    assert!(message(&outcome.text).contains("step "), "{}", outcome.text);
    // Not at rest in time.
    let hasty = [SCENE.into(), "--set=pack.max_steps=2000".into()];
    let outcome = gshear_mpi(1, &folder.path().join("hasty"), &hasty);
    assert_eq!(outcome.code, 3);
    assert!(
        message(&outcome.text).contains("pack.max_steps = 2000"),
        "{}",
        outcome.text
    );
}

/// The last good checkpoint stays when the numbers fail later.
#[test]
fn a_failure_keeps_the_last_checkpoint() {
    let _alone = common::alone();
    let folder = tempfile::tempdir().expect("a folder");
    let stopped = interrupted(folder.path(), &[SCENE.into()]);
    assert_eq!(stopped.code, 75, "{}", stopped.text);
    let checkpoint = folder.path().join("checkpoint.h5");
    let before = std::fs::read(&checkpoint).expect("a checkpoint");
    let [header, _] = gshear_store::checkpoint::read_texts(&checkpoint).expect("a checkpoint");
    let (header, _) = gshear_driver::header::Header::parse(&header).expect("a header");
    let failing = [
        format!("--resume={}", checkpoint.display()),
        // Not at rest so soon.
        format!("--set=pack.max_steps={}", header.step() + 1),
    ];
    let outcome = gshear_mpi(1, folder.path(), &failing);
    assert_eq!(outcome.code, 3, "{}", outcome.text);
    assert_eq!(std::fs::read(&checkpoint).expect("a checkpoint"), before);
}
