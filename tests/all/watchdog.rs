//! A rank that does not answer ends the job, with its name.

use std::io::Read;
use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::common::crossing::{PACKED, SCENE};
use crate::common::{PROGRAM, mpirun, rank_variable, succeed};

/// The process of a rank of the job whose environment has this variable.
fn process(mark: &str, rank: usize) -> Option<u32> {
    let wanted = [mark.to_string(), format!("{}{rank}", rank_variable())];
    std::fs::read_dir("/proc")
        .ok()?
        .flatten()
        .find_map(|entry| {
            let process: u32 = entry.file_name().to_str()?.parse().ok()?;
            let environment = std::fs::read(entry.path().join("environ")).ok()?;
            let variables: Vec<&[u8]> = environment.split(|byte| *byte == 0).collect();
            let all = wanted.iter().all(|v| variables.contains(&v.as_bytes()));
            all.then_some(process)
        })
}

#[test]
fn a_stopped_rank_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let mark = format!("GSHEAR_TEST={}", folder.path().display());
    let (name, value) = mark.split_once('=').expect("a variable");
    let mut child = mpirun(2, PROGRAM)
        .arg(SCENE)
        .args(PACKED.map(|set| format!("--set={set}")))
        .args(["--set=shear.strain=1000", "--set=bookkeeping.watchdog=3"])
        .arg("--out")
        .arg(folder.path().join("run"))
        .env(name, value)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let begun = Instant::now();
    let soon = || begun.elapsed() < Duration::from_mins(2);
    while !folder.path().join("run/run.h5").exists() {
        assert!(soon(), "the shear begins");
        std::thread::sleep(Duration::from_millis(20));
    }
    let stopped = process(&mark, 1).expect("rank 1");
    succeed(std::process::Command::new("sh").args(["-c", &format!("kill -STOP {stopped}")]));
    while child.try_wait().expect("its state").is_none() {
        if !soon() {
            let _ = child.kill();
            panic!("the job waits for the stopped rank");
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let mut text = String::new();
    let mut said = child.stderr.take().expect("its messages");
    said.read_to_string(&mut text).expect("text");
    assert_eq!(child.wait().expect("its end").code(), Some(1), "{text}");
    let name = format!("error: rank 1 (process {stopped}) does not answer");
    assert!(text.contains(&name), "{text}");
}
