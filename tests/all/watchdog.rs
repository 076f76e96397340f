//! A rank that does not answer ends the job, with its name; a job that was suspended goes on.

use std::io::Read;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::common::crossing::{PACKED, SCENE};
use crate::common::{PROGRAM, mpirun, processes, signal};

/// A job that shears, and the processes of its two ranks.
fn begun(folder: &Path, watchdog: u64) -> (Child, [u32; 2]) {
    let child = mpirun(2, PROGRAM)
        .arg(SCENE)
        .args(PACKED.map(|set| format!("--set={set}")))
        .arg("--set=shear.strain=1000")
        .arg(format!("--set=bookkeeping.watchdog={watchdog}"))
        .arg("--out")
        .arg(folder.join("run"))
        .env("GSHEAR_TEST", folder)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let begun = Instant::now();
    while !folder.join("run/run.h5").exists() {
        assert!(begun.elapsed() < Duration::from_mins(2), "no shear");
        std::thread::sleep(Duration::from_millis(20));
    }
    let mut ranks = processes("GSHEAR_TEST", folder);
    ranks.sort_unstable();
    (child, [ranks[0].1, ranks[1].1])
}

/// The exit code, and what was said.
fn end(mut child: Child) -> (Option<i32>, String) {
    let asked = Instant::now();
    while child.try_wait().expect("its state").is_none() {
        if asked.elapsed() > Duration::from_mins(2) {
            let _ = child.kill();
            panic!("the job goes on");
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let mut text = String::new();
    let mut said = child.stderr.take().expect("its messages");
    said.read_to_string(&mut text).expect("text");
    (child.wait().expect("its end").code(), text)
}

#[test]
fn a_stopped_rank_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    // Long enough for a start on a busy machine.
    let (child, [_, stopped]) = begun(folder.path(), 8);
    signal(stopped, "STOP");
    let (code, text) = end(child);
    assert_eq!(code, Some(1), "{text}");
    let name = format!("error: rank 1 (process {stopped}) does not answer");
    assert!(text.contains(&name), "{text}");
}

/// By Slurm for a job of a higher priority, or with its whole machine.
#[test]
fn a_suspended_job_goes_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let (child, [first, second]) = begun(folder.path(), 12);
    // The first rank waits for the second while both are stopped, and when it goes on alone.
    signal(second, "STOP");
    std::thread::sleep(Duration::from_secs(2));
    signal(first, "STOP");
    std::thread::sleep(Duration::from_secs(13));
    signal(first, "CONT");
    std::thread::sleep(Duration::from_millis(500));
    signal(second, "CONT");
    // mpirun gives it to the ranks.
    signal(child.id(), "USR1");
    let (code, text) = end(child);
    assert_eq!(code, Some(75), "{text}");
}
