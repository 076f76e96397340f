//! Pipes and sockets in a folder that came from somebody else, with the names of its files: nothing
//! waits for them.

use std::os::unix::net::UnixListener;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use super::{SCENE, SHORT, ended, resume, run, stopped};
use crate::common::{Outcome, bounded, copy_folder, program, reducer, start, succeed};

/// A program that waits for a pipe never ends.
const LONGEST: Duration = Duration::from_mins(2);

fn pipe(path: &Path) {
    let _ = std::fs::remove_file(path);
    succeed(start("mkfifo").arg(path));
}

fn bounded_outcome(command: &mut Command) -> Outcome {
    bounded(command, LONGEST).unwrap_or_else(|| panic!("{command:?} hangs"))
}

#[test]
fn a_resume_waits_for_no_pipe() {
    let temporary = tempfile::tempdir().expect("a folder");
    let at = |name: &str| temporary.path().join(name);
    stopped(&at("gift"), "100", &[]);
    let digest = {
        copy_folder(&at("gift"), &at("whole"));
        run(&at("whole"), &[&resume(&at("whole"))]).digest()
    };
    for (name, code) in [
        ("run.lock", 2),
        ("run.h5", 2),
        ("log.csv", 2),
        ("checkpoint.h5", 2),
        ("scene.toml", 0),
        ("status.json", 0),
        ("run.h5.journal", 0),
    ] {
        for is_socket in [false, true] {
            let folder = at(&format!("{name}-{is_socket}"));
            copy_folder(&at("gift"), &folder);
            let path = folder.join(name);
            let _ = std::fs::remove_file(&path);
            let _listener = if is_socket {
                Some(UnixListener::bind(&path).expect("a socket"))
            } else {
                pipe(&path);
                None
            };
            let mut command = program(1);
            command.arg(resume(&folder)).arg("--out").arg(&folder);
            let outcome = bounded_outcome(&mut command);
            let words: &[&str] = if code == 0 { &[] } else { &[name] };
            ended(&outcome, code, words);
            if code == 0 {
                assert_eq!(outcome.digest(), digest, "{name}");
            }
        }
    }
}

#[test]
fn the_reducer_waits_for_no_pipe() {
    let temporary = tempfile::tempdir().expect("a folder");
    let path = temporary.path().join("run.h5");
    let results = temporary.path().join("results");
    pipe(&path);
    for words in [&["info"][..], &["report", "--out"], &["dmin", "--out"]] {
        let mut command = reducer();
        command.args(words);
        if words.len() > 1 {
            command.arg(&results);
        }
        let outcome = bounded_outcome(command.arg(temporary.path()));
        ended(&outcome, 2, &["run.h5", "it is a named pipe"]);
    }
    assert!(!results.exists());
}

/// A scene may come through a pipe, as from a command of the shell.
#[test]
fn a_scene_is_read_from_a_pipe_that_is_written() {
    let temporary = tempfile::tempdir().expect("a folder");
    let path = temporary.path().join("scene.toml");
    pipe(&path);
    let check = || {
        let mut command = program(1);
        let arguments = [path.as_path(), Path::new("--check"), Path::new(SHORT)];
        command.args(arguments).current_dir(temporary.path());
        bounded_outcome(&mut command)
    };
    ended(&check(), 2, &["scene.toml", "no program writes into"]);
    std::thread::scope(|scope| {
        let scene = std::fs::read(SCENE).expect("the scene");
        // Opening it waits for the reader.
        scope.spawn(|| std::fs::write(&path, scene).expect("written"));
        ended(&check(), 0, &[]);
    });
}
