//! What can happen to the place that a run writes into: a full disk, a folder that is read-only or
//! goes away. A stopped process. The run ends with a message, and continues to the same bits.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

use crate::common::crossing::{PACKED, SCENE, whole};
use crate::common::{self, Outcome, bounded, processes, program, same_run, signal};

/// Longest time of a run, its watchdog included.
const LONGEST: Duration = Duration::from_mins(2);
/// Many checkpoints in some thousand steps.
const SET: [&str; 5] = [
    "output.checkpoint_strain=0.05",
    "output.frame_strain=0.02",
    "output.series_strain=0.005",
    "shear.strain=0.5",
    // Long enough for a busy machine.
    "bookkeeping.watchdog=20",
];

fn sets() -> impl Iterator<Item = &'static str> {
    PACKED.into_iter().chain(SET)
}

/// A folder on which something is mounted.
struct Mount(PathBuf);

impl Mount {
    /// `None`, with a note, where that is not permitted.
    fn new(at: &Path, options: &[&str]) -> Option<Self> {
        std::fs::create_dir_all(at).expect("a folder");
        let done = common::start("mount").args(options).arg(at).output();
        match done {
            Ok(output) if output.status.success() => Some(Self(at.into())),
            _ => {
                println!("skipped: nothing can be mounted here");
                None
            }
        }
    }

    fn tmpfs(at: &Path, size: &str) -> Option<Self> {
        Self::new(at, &["-t", "tmpfs", "-o", &format!("size={size}"), "none"])
    }

    fn remount(&self, options: &str) {
        let options = format!("remount,{options}");
        common::succeed(common::start("mount").args(["-o", &options]).arg(&self.0));
    }
}

impl Drop for Mount {
    fn drop(&mut self) {
        let _ = common::start("umount").arg("-l").arg(&self.0).status();
    }
}

/// The run in a folder, begun or continued.
fn command(out: &Path, ranks: usize) -> Command {
    let mut command = program(ranks);
    command
        .arg(SCENE)
        .arg("--resume=auto")
        .arg("--out")
        .arg(out);
    command.args(sets().map(|set| format!("--set={set}")));
    command
}

fn run(out: &Path, ranks: usize) -> Outcome {
    bounded(&mut command(out, ranks), LONGEST).expect("an end")
}

/// One message, and this code.
fn failed(outcome: &Outcome, code: i32, words: &[&str]) {
    let text = &outcome.text;
    assert_eq!(outcome.code, code, "{text}");
    assert_eq!(text.matches("error: ").count(), 1, "{text}");
    assert!(!text.contains("panicked"), "{text}");
    for word in words {
        assert!(text.contains(word), "no {word:?} in {text}");
    }
}

/// A run without faults, and the folder of the tests.
struct Reference {
    folder: tempfile::TempDir,
    digest: String,
}

impl Reference {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let sets: Vec<&str> = sets().collect();
        let digest = whole(&folder.path().join("reference"), 1, &sets).digest();
        Self { folder, digest }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The run continues to the same bits.
    fn continues(&self, out: &Path, ranks: usize) {
        assert_eq!(run(out, ranks).digest(), self.digest);
        same_run(out, &self.path("reference"));
        let log = |folder: &Path| std::fs::read(folder.join("log.csv")).expect("a log");
        assert_eq!(log(out), log(&self.path("reference")));
    }
}

/// Starts a run and waits until it has written its second checkpoint.
fn begun(out: &Path, ranks: usize, said: &Path) -> Child {
    begun_with(out, ranks, said, &[])
}

/// The same with further arguments.
fn begun_with(out: &Path, ranks: usize, said: &Path, further: &[&str]) -> Child {
    let log = std::fs::File::create(said).expect("a file");
    let mut command = command(out, ranks);
    command.args(further);
    command.env("GSHEAR_TEST", out);
    command.stdout(log.try_clone().expect("a file")).stderr(log);
    let mut child = command.spawn().expect("the program starts");
    let begun = Instant::now();
    while !out.join("checkpoint.previous.h5").exists() {
        assert!(begun.elapsed() < LONGEST, "no checkpoint");
        assert!(child.try_wait().expect("its state").is_none(), "too soon");
        std::thread::sleep(Duration::from_millis(2));
    }
    child
}

fn end(mut child: Child, said: &Path) -> Outcome {
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().expect("its state") {
            break status;
        }
        if begun.elapsed() > LONGEST {
            let _ = child.kill();
            panic!("hangs: {}", std::fs::read_to_string(said).unwrap());
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    Outcome {
        code: status.code().unwrap_or(-1),
        text: std::fs::read_to_string(said).expect("what it said"),
    }
}

#[test]
fn a_full_disk_loses_nothing() {
    let reference = Reference::new();
    let all = std::fs::read_dir(reference.path("reference")).expect("a folder");
    let all: u64 = all.flatten().map(|e| e.metadata().unwrap().len()).sum();
    for ranks in [1, 3] {
        // From too small for the first file to too small for the last.
        for (k, part) in [0.02, 0.3, 0.6, 0.8, 0.95].into_iter().enumerate() {
            let place = reference.path(&format!("full-{ranks}-{k}"));
            let size = format!("{}", (part * all as f64) as u64);
            let Some(disk) = Mount::tmpfs(&place, &size) else {
                return;
            };
            let out = place.join("run");
            let outcome = run(&out, ranks);
            // What is small enough is refused before anything is written.
            let code = if outcome.code == 2 { 2 } else { 1 };
            failed(&outcome, code, &["space"]);
            disk.remount("size=256m");
            reference.continues(&out, ranks);
        }
    }
}

/// MPI-IO takes the part before a colon for the kind of the file system.
#[test]
fn a_colon_in_the_path_is_a_letter() {
    let reference = Reference::new();
    for ranks in [1, 2] {
        reference.continues(&reference.path(&format!("2026-11-25T13:26/{ranks}")), ranks);
    }
}

#[test]
fn a_read_only_folder_is_refused() {
    let reference = Reference::new();
    for ranks in [1, 3] {
        let place = reference.path(&format!("fixed-{ranks}"));
        let Some(disk) = Mount::tmpfs(&place, "256m") else {
            return;
        };
        let out = place.join("run");
        disk.remount("ro");
        failed(&run(&out, ranks), 2, &["cannot be written"]);
        disk.remount("rw");
        // And at a resume.
        let mut stopped = command(&out, ranks);
        let stopped = bounded(stopped.arg("--stop-at=1000"), LONGEST).expect("an end");
        assert_eq!(stopped.code, 75, "{}", stopped.text);
        disk.remount("ro");
        failed(&run(&out, ranks), 2, &["cannot be written"]);
        disk.remount("rw");
        reference.continues(&out, ranks);
    }
}

#[test]
fn a_folder_that_goes_away_ends_the_run() {
    let reference = Reference::new();
    let said = reference.path("said");
    for ranks in [1, 3] {
        let out = reference.path(&format!("removed-{ranks}"));
        let child = begun(&out, ranks, &said);
        std::fs::rename(&out, out.with_extension("away")).expect("renamed");
        failed(&end(child, &said), 1, &["removed-"]);
        std::fs::rename(out.with_extension("away"), &out).expect("renamed");
        reference.continues(&out, ranks);

        let child = {
            std::fs::remove_dir_all(&out).expect("removed");
            begun(&out, ranks, &said)
        };
        // The run may put a file there between the removal of the files and that of the folder.
        while std::fs::remove_dir_all(&out).is_err_and(|e| e.kind() == ErrorKind::DirectoryNotEmpty)
        {
        }
        assert!(!out.exists());
        failed(&end(child, &said), 1, &["removed-"]);
        reference.continues(&out, ranks);

        let (disk, place) = (
            reference.path(&format!("disk-{ranks}")),
            reference.path(&format!("place-{ranks}")),
        );
        std::fs::create_dir(&disk).expect("a folder");
        let disk = disk.display().to_string();
        let Some(mounted) = Mount::new(&place, &["--bind", &disk]) else {
            continue;
        };
        let out = place.join("run");
        let child = begun(&out, ranks, &said);
        drop(mounted);
        failed(&end(child, &said), 1, &["place-"]);
        let _mounted = Mount::new(&place, &["--bind", &disk]).expect("mounted again");
        reference.continues(&out, ranks);
    }
}

#[test]
fn a_stopped_process_loses_nothing() {
    let reference = Reference::new();
    let said = reference.path("said");
    let out = reference.path("one");
    let child = begun(&out, 1, &said);
    signal(child.id(), "STOP");
    std::thread::sleep(Duration::from_secs(1));
    signal(child.id(), "CONT");
    assert_eq!(end(child, &said).digest(), reference.digest);
    for rank in [0, 2] {
        let out = reference.path(&format!("rank-{rank}"));
        // Nothing is asked of the ranks in this time but to wait.
        let child = begun_with(&out, 3, &said, &["--set=bookkeeping.watchdog=8"]);
        let ranks = processes("GSHEAR_TEST", &out);
        let (_, process) = ranks.iter().find(|(r, _)| *r == rank).expect("the rank");
        signal(*process, "STOP");
        let name = format!("rank {rank} (process {process}) does not answer");
        let outcome = end(child, &said);
        assert_eq!(outcome.code, 1, "{}", outcome.text);
        assert!(outcome.text.contains(&name), "{}", outcome.text);
        reference.continues(&out, 3);
    }
}
