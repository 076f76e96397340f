//! Runs under way: locks, signals, and files that are removed or cannot be written.

use std::io::{BufRead, BufReader};
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use super::{LONG, SCENE, SHORT, ended, run};
use crate::common::{Outcome, PROGRAM, bounded, program, start, succeed};
use crate::faults::shim;

/// A run in the background, once it shears.
fn background(folder: &Path, more: &[&str]) -> Child {
    let mut child = program(1)
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
    succeed(start("sh").args(["-c", &format!("kill -{name} {}", child.id())]));
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
    // A lock that cannot be asked for, as where the table of locks is full, is not known to be
    // free.
    let mut blind = program(1);
    blind.args([SCENE, LONG, "--overwrite", "--out"]).arg(&out);
    blind
        .env("LD_PRELOAD", shim(temporary.path()))
        .env("FAULT_LOCKS", "37");
    let refused = bounded(&mut blind, Duration::from_mins(2)).expect("it ends");
    ended(&refused, 2, &[&format!("process {} on ", child.id())]);
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

/// Containers have process ids of their own and may share the name of the host.
#[test]
fn a_lock_holds_in_another_pid_namespace() {
    let temporary = tempfile::tempdir().expect("a folder");
    let out = temporary.path().join("out");
    let child = background(&out, &[]);
    let mut other = start("unshare");
    other.args(["--pid", "--fork", "--mount-proc"]);
    other.args([PROGRAM, SCENE, LONG, "--resume=auto"]);
    let other = other
        .arg("--out")
        .arg(&out)
        .output()
        .expect("unshare starts");
    let said = String::from_utf8_lossy(&other.stderr);
    if said.starts_with("unshare:") {
        println!("skipped: no namespaces here: {said}");
    } else {
        assert_eq!(other.status.code(), Some(2), "{said}");
        assert!(said.contains("writes into this folder"), "{said}");
    }
    // A lock that cannot be asked for, as where the table of locks is full, is not known to be
    // free.
    let mut blind = program(1);
    blind.args([SCENE, LONG, "--overwrite", "--out"]).arg(&out);
    blind
        .env("LD_PRELOAD", shim(temporary.path()))
        .env("FAULT_LOCKS", "37");
    let refused = bounded(&mut blind, Duration::from_mins(2)).expect("it ends");
    ended(&refused, 2, &[&format!("process {} on ", child.id())]);
    signal(&child, "USR1");
    assert_eq!(end(child).code, 75);
    assert!(!out.join("run.lock").exists());
}

/// `mpiexec` of another MPI starts programs that know nothing of each other, or that end in the
/// start of MPI: the first one says so before.
#[test]
fn a_launcher_of_another_mpi_is_refused() {
    let temporary = tempfile::tempdir().expect("a folder");
    let out = temporary.path().join("out");
    let scene = [SCENE, "--set=shear.strain=0.001"].map(String::from);
    let library = gshear_mpi_exchange::library_version();
    let is_open_mpi = library.starts_with("Open MPI");
    let started = |rank: &str| {
        let several = if is_open_mpi {
            [("PMI_SIZE", "2"), ("PMI_RANK", rank)]
        } else {
            [
                ("OMPI_COMM_WORLD_SIZE", "2"),
                ("OMPI_COMM_WORLD_RANK", rank),
            ]
        };
        crate::common::with_environment(&several, 1, &out, &scene)
    };
    let needed = if is_open_mpi {
        ["PMI_SIZE says", "start it with Open MPI's mpirun"]
    } else {
        [
            "OMPI_COMM_WORLD_SIZE says",
            "start it with the mpiexec of that MPI",
        ]
    };
    let first = started("0");
    ended(
        &first,
        2,
        &[needed[0], "one of 2 ranks", &library, needed[1]],
    );
    let second = started("1");
    assert_eq!((second.code, second.text.trim()), (2, ""));
    assert!(!out.exists());
    // A program of a batch script for four tasks.
    let script = [("SLURM_NTASKS", "4"), ("SLURM_PROCID", "0")];
    ended(
        &crate::common::with_environment(&script, 1, &out, &scene),
        0,
        &[],
    );
}

#[test]
fn what_is_removed_during_a_run_is_missed() {
    let temporary = tempfile::tempdir().expect("a folder");
    for (name, words) in [
        ("run.h5", "run.h5: was removed during the run"),
        ("log.csv", "log.csv: was removed during the run"),
        ("", "folder of the results was removed"),
    ] {
        let out = temporary.path().join(format!("out-{name}"));
        let child = background(&out, &[]);
        match name {
            // The run may make a file in it meanwhile.
            "" => {
                while out.exists() {
                    let _ = std::fs::remove_dir_all(&out);
                }
            }
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
    let temporary = tempfile::tempdir().expect("a folder");
    let file = temporary.path().join("file");
    std::fs::write(&file, "").expect("written");
    for out in [file.clone(), file.join("out")] {
        let begun = run(&out, &[SCENE, "--set=pack.tolerance=1e-30"]);
        ended(&begun, 2, &["cannot be written", "--out"]);
        assert!(!begun.text.contains("pack:"), "{}", begun.text);
    }
    let name = std::ffi::OsStr::from_bytes(b"r\xffun");
    let begun = run(
        &temporary.path().join(name),
        &[SCENE, "--set=pack.tolerance=1e-30"],
    );
    ended(&begun, 2, &["is not UTF-8", "--out"]);
    assert_eq!(
        std::fs::read_dir(temporary.path())
            .expect("a folder")
            .count(),
        1
    );
}

#[test]
fn a_signal_while_handlers_are_installed_is_not_lost() {
    let temporary = tempfile::tempdir().expect("a folder");
    let library = shim(temporary.path());
    for (name, number) in [("TERM", "15"), ("INT", "2"), ("HUP", "1"), ("USR1", "10")] {
        let out = temporary.path().join(name);
        let child = program(1)
            .args([SCENE, SHORT, "--out"])
            .arg(&out)
            .env("LD_PRELOAD", &library)
            .env("FAULT_SIGNAL", number)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let outcome = end(child);
        assert_eq!(outcome.code, 75, "{name}: {}", outcome.text);
        assert!(out.join("checkpoint.h5").exists(), "{name}");
    }
}

#[test]
fn signals_stop_a_run_from_its_first_moment() {
    let temporary = tempfile::tempdir().expect("a folder");
    for (k, (name, number, wait)) in [
        ("USR1", 10, 0),
        ("TERM", 15, 0),
        ("HUP", 1, 0),
        ("HUP", 1, 1500),
    ]
    .into_iter()
    .enumerate()
    {
        let out = temporary.path().join(k.to_string());
        let child = program(1)
            .args([SCENE, LONG, "--out"])
            .arg(&out)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        // Before main, in the loader, nothing can catch it; a busy machine takes its time for that.
        let status = format!("/proc/{}/status", child.id());
        let catches = || {
            let text = std::fs::read_to_string(&status).expect("a process");
            let mask = text.lines().find_map(|line| line.strip_prefix("SigCgt:"));
            let mask = u64::from_str_radix(mask.expect("a mask").trim(), 16);
            mask.expect("hexadecimal digits") >> (number - 1) & 1 == 1
        };
        let begun = Instant::now();
        while !catches() && begun.elapsed() < Duration::from_secs(20) {
            std::thread::sleep(Duration::from_millis(1));
        }
        std::thread::sleep(Duration::from_millis(wait));
        signal(&child, name);
        let outcome = end(child);
        assert_eq!(outcome.code, 75, "{name} after {wait} ms: {}", outcome.text);
        assert!(out.join("checkpoint.h5").exists(), "{name}");
    }
}
