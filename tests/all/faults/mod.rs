//! Faults of files and processes: system calls that fail, and kills, at every call that writes into
//! the folder of a run, and kills at random times. Afterwards the run resumes to the same bits.
//!
//! `make faults` runs many of them; docs/validation/faults.md has the results.

mod reducer;

use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

use crate::common::crossing::{PACKED, SCENE, whole};
use crate::common::{self, copy_folder, processes, program, reducer, same_run, signal, succeed};
use gshear_store::run_reader::RunFile;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Longest time of a run with a fault, its watchdog included. Beside other tests, and programs that
/// write to the same disk, ranks may wait for each other and for their files for tens of seconds,
/// and virtual machines were seen to leave processes without a core for two minutes.
const LONGEST: Duration = Duration::from_mins(10);
/// Several checkpoints, many frames and rows in a short run.
const SET: [&str; 5] = [
    "output.checkpoint_strain=0.001",
    "output.frame_strain=2e-4",
    "output.series_strain=5e-4",
    "shear.strain=0.004",
    "bookkeeping.watchdog=300",
];

fn sets() -> impl Iterator<Item = &'static str> {
    PACKED.into_iter().chain(SET)
}

const BOX: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");

/// The library that makes calls fail, compiled into `folder`.
pub fn shim(folder: &Path) -> PathBuf {
    let library = folder.join("shim.so");
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/all/faults/shim.c");
    let mut compiler = common::start("cc");
    compiler.args(["-O1", "-shared", "-fPIC", "-w", source, "-o"]);
    succeed(compiler.arg(&library).arg("-ldl"));
    library
}

/// How a run begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Start {
    /// From the packed grains.
    New,
    /// From a checkpoint of the shear, with the files of the run.
    Resume,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum What {
    /// The calls of a rank from this one on, so many of them (`None`: all).
    Call {
        kind: &'static str,
        rank: usize,
        call: u64,
        calls: Option<u64>,
    },
    /// SIGKILL after this part of the time of a whole run.
    Kill { whom: Victim, after: f64 },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Victim {
    Rank(usize),
    /// mpirun alone: the ranks notice.
    Mpirun,
    /// mpirun and all ranks, as a node that fails.
    All,
}

#[derive(Debug, Clone, Copy)]
struct Fault {
    start: Start,
    ranks: usize,
    what: What,
}

impl Fault {
    /// Name of its row in the table.
    fn name(&self) -> String {
        let what = match self.what {
            What::Call { kind, calls, .. } => match (kind, calls) {
                ("kill", _) => "kill of a rank before a call".into(),
                ("torn", _) => "kill of a rank within a write".into(),
                (kind, None) => format!("{kind} from a call on"),
                (kind, Some(1)) => format!("{kind} once"),
                (kind, Some(calls)) => format!("{kind} {calls} times"),
            },
            What::Kill { whom, .. } => match whom {
                Victim::Rank(_) => "kill of a rank at random".into(),
                Victim::Mpirun => "kill of mpirun at random".into(),
                Victim::All => "kill of mpirun and all ranks at random".to_string(),
            },
        };
        format!("{what} | {}", self.ranks)
    }

    fn is_full_disk(&self) -> bool {
        matches!(self.what, What::Call { kind: "enospc", .. })
    }

    fn is_kill(&self) -> bool {
        matches!(
            self.what,
            What::Kill { .. }
                | What::Call {
                    kind: "kill" | "torn",
                    ..
                }
        )
    }
}

/// What became of a run with a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fate {
    /// It went on to the end, with the same bits.
    Unharmed,
    /// It ended, and the resumed run has the same bits.
    Resumed,
    /// It ended before there was a checkpoint, and the same command ran it from the start.
    Early,
}

/// What a program said and how it ended; `None`: it hung.
struct Ending {
    code: Option<i32>,
    said: String,
}

/// A rank that lives: what its threads do.
fn describe(&(rank, process): &(usize, u32)) -> String {
    let folder = format!("/proc/{process}/task");
    let threads = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let state = |name: &str, thread: &std::fs::DirEntry| {
        let text = std::fs::read_to_string(thread.path().join(name)).unwrap_or_default();
        text.trim().to_string()
    };
    let threads = threads.map(|t| state("comm", &t) + " in " + &state("wchan", &t));
    format!("{rank}: {}", threads.collect::<Vec<_>>().join(", "))
}

struct Scenario {
    folder: tempfile::TempDir,
    shim: PathBuf,
    digest: String,
}

impl Scenario {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let shim = shim(folder.path());
        let sets: Vec<&str> = sets().collect();
        let digest = whole(&folder.path().join("reference"), 1, &sets).digest();
        Self {
            folder,
            shim,
            digest,
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The scene on ranks, in the folder `run`, continued if there is something to continue.
    fn command(&self, ranks: usize) -> Command {
        let mut command = program(ranks);
        command.arg(SCENE).arg("--resume=auto");
        command.arg("--out").arg(self.path("run"));
        command.args(sets().map(|set| format!("--set={set}")));
        // By which its ranks are found.
        command.env("FAULT_JOB", self.folder.path());
        // Open MPI waits no second before it ends ranks that are left over.
        command.env("OMPI_MCA_odls_base_sigkill_timeout", "0");
        command
    }

    /// Runs a command to its end, and kills its victim in between.
    fn bounded(
        &self,
        command: &mut Command,
        ranks: usize,
        kill: Option<(Victim, Duration)>,
    ) -> Result<Ending, String> {
        let log = self.path("said");
        let to = std::fs::File::create(&log).expect("a file");
        command.stdout(to.try_clone().expect("a file")).stderr(to);
        let mut child = command.spawn().expect("the program starts");
        let begun = Instant::now();
        let mut due = kill;
        let status = loop {
            if let Some(status) = child.try_wait().expect("its state") {
                break status;
            }
            if due.is_some_and(|(_, after)| begun.elapsed() >= after) {
                let (whom, _) = due.take().expect("a victim");
                self.kill(&mut child, whom, ranks);
            }
            if begun.elapsed() > LONGEST {
                let living: Vec<String> = self.ranks().iter().map(describe).collect();
                self.kill(&mut child, Victim::All, ranks);
                let _ = child.wait();
                let said = std::fs::read_to_string(&log).unwrap_or_default();
                return Err(format!("hangs, with the ranks {living:?}:\n{said}"));
            }
            std::thread::sleep(Duration::from_millis(2));
        };
        // Ranks that outlive mpirun may still write.
        while !self.ranks().is_empty() {
            if begun.elapsed() > LONGEST {
                self.ranks()
                    .iter()
                    .for_each(|&(_, process)| signal(process, "KILL"));
                return Err("ranks live on without mpirun".into());
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let said = std::fs::read(&log).expect("what it said");
        Ok(Ending {
            code: status.code(),
            said: String::from_utf8_lossy(&said).into_owned(),
        })
    }

    /// Number and process of each rank that lives.
    fn ranks(&self) -> Vec<(usize, u32)> {
        processes("FAULT_JOB", self.folder.path())
    }

    fn kill(&self, child: &mut Child, whom: Victim, ranks: usize) {
        if ranks == 1 || matches!(whom, Victim::Mpirun | Victim::All) {
            let _ = child.kill();
        }
        for (rank, process) in self.ranks() {
            if whom == Victim::All || whom == Victim::Rank(rank) {
                signal(process, "KILL");
            }
        }
    }

    /// What a run begins from, in the folder `run`.
    fn prepare(&self, start: Start) {
        let run = self.path("run");
        let _ = std::fs::remove_dir_all(&run);
        if start == Start::New {
            return;
        }
        let begun = self.path("begun");
        if !begun.exists() {
            let mut arguments = vec![SCENE.to_string(), "--stop-at=3".into()];
            arguments.extend(sets().map(|set| format!("--set={set}")));
            assert_eq!(common::gshear_mpi(1, &begun, &arguments).code, 75);
        }
        copy_folder(&begun, &run);
    }

    /// Calls of each rank, and the time, of a run without a fault.
    fn measure(&self, start: Start, ranks: usize) -> (Vec<u64>, Duration) {
        self.prepare(start);
        let counts = self.path("counts");
        let _ = std::fs::remove_file(&counts);
        let mut command = self.command(ranks);
        command.env("LD_PRELOAD", &self.shim);
        command.env("FAULT_PATH", self.path("run"));
        command.env("FAULT_COUNT", &counts);
        let begun = Instant::now();
        let ending = self.bounded(&mut command, ranks, None).expect("an end");
        let time = begun.elapsed();
        assert_eq!(ending.code, Some(0), "{}", ending.said);
        self.same().expect("the same run");
        let mut calls = vec![0; ranks];
        for line in std::fs::read_to_string(&counts).expect("counts").lines() {
            let mut numbers = line.split(' ').map(|n| n.parse::<u64>().expect("a number"));
            let (rank, count) = (numbers.next().unwrap() as usize, numbers.next().unwrap());
            calls[rank] = calls[rank].max(count);
        }
        (calls, time)
    }

    /// Whether the folder holds the run, whole and with the same bits.
    fn same(&self) -> Result<(), String> {
        let (run, reference) = (self.path("run"), self.path("reference"));
        let file = RunFile::open(&run).map_err(|e| e.to_string())?;
        if file.digest() != Some(&self.digest) {
            return Err(format!("digest {:?}", file.digest()));
        }
        std::panic::catch_unwind(|| same_run(&run, &reference)).map_err(|_| "run.h5 differs")?;
        let log = |folder: &Path| std::fs::read(folder.join("log.csv")).ok();
        if log(&run) != log(&reference) {
            return Err("log.csv differs".into());
        }
        let mut compare = reducer();
        let compare = compare.arg("compare").args([&run, &reference]);
        let compared = compare.output().expect("the program starts");
        if compared.status.success() {
            Ok(())
        } else {
            Err(String::from_utf8_lossy(&compared.stdout).into_owned())
        }
    }

    /// Runs with the fault, then resumes. Fails with what was lost.
    fn fate(&self, fault: Fault, time: Duration) -> Result<Fate, String> {
        self.prepare(fault.start);
        let mut command = self.command(fault.ranks);
        let mut kill = None;
        match fault.what {
            What::Call {
                kind,
                rank,
                call,
                calls,
            } => {
                command
                    .env("LD_PRELOAD", &self.shim)
                    .env("FAULT_PATH", self.path("run"))
                    .env("FAULT_KIND", kind)
                    .env("FAULT_RANK", rank.to_string())
                    .env("FAULT_CALL", call.to_string());
                if let Some(calls) = calls {
                    command.env("FAULT_CALLS", calls.to_string());
                }
            }
            What::Kill { whom, after } => kill = Some((whom, time.mul_f64(after))),
        }
        let Ending { code, said } = self.bounded(&mut command, fault.ranks, kill)?;
        let lost = |what: String| Err(format!("{what}\nafter ({code:?}):\n{said}"));
        if code == Some(0) {
            return match self.same() {
                Ok(()) => Ok(Fate::Unharmed),
                Err(why) => lost(format!("ends well, but: {why}")),
            };
        }
        let crash = ["SIGSEGV", "Segmentation", "panicked", "Abort"];
        let crashed = code.is_none() || crash.iter().any(|word| said.contains(word));
        if !fault.is_kill() && (crashed || !said.contains("error: ")) {
            return lost("crashes".into());
        }
        if !fault.is_kill() && said.contains("bookkeeping.watchdog") {
            return lost("says no reason".into());
        }
        if !fault.is_kill() && !said.contains(&self.path("run").display().to_string()) {
            return lost("names no file".into());
        }
        if fault.is_full_disk() && !said.contains("No space left on device") {
            return lost("does not say that the disk is full".into());
        }
        let run = self.path("run");
        let early = !run.join("checkpoint.h5").exists();
        if early && (fault.start == Start::Resume || run.join("checkpoint.previous.h5").exists()) {
            return lost("checkpoint.h5 is missing".into());
        }
        // As job scripts do; without a checkpoint the run begins again.
        let resumed = self.bounded(&mut self.command(fault.ranks), fault.ranks, None)?;
        if resumed.code != Some(0) {
            return lost(format!("is not resumed: {}", resumed.said));
        }
        match self.same() {
            Ok(()) if early => Ok(Fate::Early),
            Ok(()) => Ok(Fate::Resumed),
            Err(why) => lost(format!("{why}, resumed with:\n{}", resumed.said)),
        }
    }
}

/// Fates by kind of fault and number of ranks: unharmed, resumed, early, lost.
#[derive(Default)]
struct Table(std::collections::BTreeMap<String, [usize; 4]>);

impl Table {
    fn print(&self) {
        println!("| fault | ranks | faults | unharmed | resumed | early | lost |");
        println!("| --- | ---: | ---: | ---: | ---: | ---: | ---: |");
        let mut all = [0; 4];
        for (name, counts) in &self.0 {
            let [unharmed, resumed, early, lost] = counts;
            let sum: usize = counts.iter().sum();
            println!("| {name} | {sum} | {unharmed} | {resumed} | {early} | {lost} |");
            all.iter_mut().zip(counts).for_each(|(all, n)| *all += n);
        }
        let [unharmed, resumed, early, lost] = all;
        let sum: usize = all.iter().sum();
        println!("| all | | {sum} | {unharmed} | {resumed} | {early} | {lost} |");
    }
}

/// Runs all faults of `choose`, which gets the calls of each rank, and counts their fates; fails
/// with those that lost anything.
fn study(ranks: &[usize], mut choose: impl FnMut(Start, usize, &[u64]) -> Vec<Fault>) {
    let begun = Instant::now();
    let scenario = Scenario::new();
    let (mut table, mut lost, mut done) = (Table::default(), Vec::new(), 0);
    for &ranks in ranks {
        for start in [Start::New, Start::Resume] {
            let (calls, time) = scenario.measure(start, ranks);
            let faults = choose(start, ranks, &calls);
            println!(
                "{start:?} on {ranks} ranks: {} faults in {calls:?} calls, {time:?}",
                faults.len()
            );
            for fault in faults {
                let fate = scenario.fate(fault, time);
                let column = match &fate {
                    Ok(Fate::Unharmed) => 0,
                    Ok(Fate::Resumed) => 1,
                    Ok(Fate::Early) => 2,
                    Err(_) => 3,
                };
                table.0.entry(fault.name()).or_default()[column] += 1;
                if let Err(what) = fate {
                    println!("{fault:?}: {what}");
                    lost.push(fault);
                }
                done += 1;
                if done % 100 == 0 {
                    println!(
                        "{done} faults in {:.0?}, lost {}",
                        begun.elapsed(),
                        lost.len()
                    );
                }
            }
        }
    }
    table.print();
    println!("{done} faults in {:.0?}", begun.elapsed());
    assert!(
        lost.is_empty(),
        "{} faults lost something: {lost:?}",
        lost.len()
    );
}

/// So many of the calls 1 … `all`, evenly spread, from an offset below the distance.
fn spread(all: u64, many: u64, offset: f64) -> impl Iterator<Item = u64> {
    let many = many.min(all);
    let at = move |k: u64| (k as f64 + offset) * all as f64 / many as f64;
    (0..many).map(move |k| 1 + (at(k) as u64).min(all - 1))
}

/// Calls that fail. A disk stays full, or is full for a moment; a device fails once, at a write or
/// when a file is closed.
const FAILING: [(&str, Option<u64>); 6] = [
    ("enospc", None),
    ("enospc", Some(3)),
    ("eio", Some(1)),
    ("eio", None),
    ("short", Some(1)),
    ("close", Some(1)),
];
const KILLING: [(&str, Option<u64>); 2] = [("kill", None), ("torn", None)];

fn at_calls(
    (start, ranks): (Start, usize),
    (kind, calls): (&'static str, Option<u64>),
    rank: usize,
    at: impl Iterator<Item = u64>,
) -> impl Iterator<Item = Fault> {
    at.map(move |call| Fault {
        start,
        ranks,
        what: What::Call {
            kind,
            rank,
            call,
            calls,
        },
    })
}

/// `count` kills at random times.
fn random_kills(
    (start, ranks): (Start, usize),
    count: usize,
    random: &mut ChaCha8Rng,
) -> Vec<Fault> {
    let victim = |k: usize, random: &mut ChaCha8Rng| match k % 4 {
        0 | 1 => Victim::Rank(random.random_range(0..ranks)),
        2 => Victim::All,
        _ if ranks > 1 => Victim::Mpirun,
        _ => Victim::Rank(0),
    };
    (0..count)
        .map(|k| Fault {
            start,
            ranks,
            what: What::Kill {
                whom: victim(k, random),
                after: random.random_range(0.0..1.0),
            },
        })
        .collect()
}

#[test]
fn a_run_survives_faults_of_its_files() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    study(&[1, 3], |start, ranks, calls| {
        // A new run on one rank and a resumed one on three meet every kind.
        if (start == Start::New) != (ranks == 1) {
            return random_kills((start, ranks), 1, &mut random);
        }
        let mut faults = random_kills((start, ranks), 2, &mut random);
        for (k, kind) in FAILING.into_iter().chain(KILLING).enumerate() {
            let rank = k % ranks;
            let at = spread(calls[rank], 1, 0.1 + 0.12 * k as f64);
            faults.extend(at_calls((start, ranks), kind, rank, at));
        }
        faults
    });
}

/// The system may do a part of a write: the rest follows, whichever ranks write.
#[test]
fn a_short_write_is_completed() {
    study(&[3], |start, ranks, calls| {
        at_calls(
            (start, ranks),
            ("short", Some(1)),
            0,
            spread(calls[0], 5, 0.5),
        )
        .collect()
    });
}

/// A close that fails on one rank ends the job, with the reason.
#[test]
fn a_close_that_fails_is_no_wait() {
    study(&[2, 3], |start, ranks, calls| {
        // The ranks do not close the same files.
        let rank = if start == Start::New { 0 } else { ranks - 1 };
        let at = spread(calls[rank], 2, 0.4);
        at_calls((start, ranks), ("close", Some(1)), rank, at).collect()
    });
}

/// A file that cannot be closed after it was read: a checkpoint, at its end or at a resume, or
/// another one. HDF5 keeps it among its open files and would close it again when MPI ends.
#[test]
fn a_close_that_fails_after_reading_is_no_crash() {
    study(&[1, 2], |start, ranks, _| {
        // The number of the close.
        let at = if start == Start::New { 3..=4 } else { 1..=4 };
        at_calls((start, ranks), ("close-read", Some(1)), ranks - 1, at).collect()
    });
}

/// A run that goes back to an older checkpoint and is killed continues from that one, because the
/// files no longer fit a later one.
#[test]
fn a_kill_after_going_back_loses_nothing() {
    let scenario = Scenario::new();
    let (begun, run) = (scenario.path("later"), scenario.path("run"));
    let mut arguments = vec![SCENE.to_string(), "--stop-at=15".into()];
    let set = sets().chain(["output.keep_checkpoints=true"]);
    arguments.extend(set.map(|set| format!("--set={set}")));
    assert_eq!(common::gshear_mpi(1, &begun, &arguments).code, 75);
    for kill in (0..24).map(|k| 1 + 9 * k) {
        let _ = std::fs::remove_dir_all(&run);
        copy_folder(&begun, &run);
        let mut back = program(1);
        back.arg("--resume").arg(run.join("checkpoint-6.h5"));
        back.env("LD_PRELOAD", &scenario.shim)
            .env("FAULT_PATH", &run)
            .env("FAULT_KIND", "torn")
            .env("FAULT_CALL", kill.to_string());
        let ending = scenario.bounded(&mut back, 1, None).expect("an end");
        assert_eq!(ending.code, None, "{}", ending.said);
        let resumed = scenario.bounded(&mut scenario.command(1), 1, None);
        let resumed = resumed.expect("an end");
        assert_eq!(resumed.code, Some(0), "call {kill}: {}", resumed.said);
        scenario
            .same()
            .unwrap_or_else(|why| panic!("call {kill}: {why}"));
    }
}

/// What HDF5 and the lock of the folder do without.
#[test]
fn a_file_system_without_locks_holds_a_run() {
    let scenario = Scenario::new();
    for (ranks, number) in [(1, "37"), (2, "95")] {
        let command = || {
            let mut command = scenario.command(ranks);
            command.env("LD_PRELOAD", &scenario.shim);
            command.env("FAULT_LOCKS", number);
            command
        };
        scenario.prepare(Start::New);
        let forced = command().env("HDF5_USE_FILE_LOCKING", "TRUE").output();
        let forced = forced.expect("the program starts");
        let said = String::from_utf8_lossy(&forced.stderr);
        assert_eq!(forced.status.code(), Some(2), "{said}");
        assert!(said.contains("HDF5_USE_FILE_LOCKING=FALSE"), "{said}");
        assert!(!scenario.path("run").exists(), "before anything is written");
        let whole = scenario.bounded(&mut command(), ranks, None);
        let whole = whole.expect("an end");
        assert_eq!(whole.code, Some(0), "{}", whole.said);
        scenario.same().expect("the same run");
    }
}

/// A file that cannot be opened for a while is no damaged file: it stays, and so do all others.
#[test]
fn what_cannot_be_opened_for_now_is_left_alone() {
    let scenario = Scenario::new();
    let run = scenario.path("run");
    let files = || -> Vec<_> {
        let entries = std::fs::read_dir(&run).expect("a folder").flatten();
        let mut files: Vec<_> = entries
            .map(|entry| {
                (
                    entry.file_name(),
                    std::fs::read(entry.path()).expect("a file"),
                )
            })
            .collect();
        files.sort();
        files
    };
    for name in ["run.h5", "checkpoint.h5", "scene.toml", "log.csv", "run"] {
        scenario.prepare(Start::Resume);
        let before = files();
        let mut command = scenario.command(1);
        command.env("LD_PRELOAD", &scenario.shim);
        command.env("FAULT_OPEN", format!("/{name}"));
        let refused = scenario.bounded(&mut command, 1, None).expect("an end");
        assert_eq!(refused.code, Some(1), "{name}: {}", refused.said);
        assert!(refused.said.contains("open files"), "{}", refused.said);
        assert!(files() == before, "{name}");
        let resumed = scenario.bounded(&mut scenario.command(1), 1, None);
        assert_eq!(resumed.expect("an end").code, Some(0), "{name}");
        scenario
            .same()
            .unwrap_or_else(|why| panic!("{name}: {why}"));
    }
    // Another program reads the file, or locks it.
    scenario.prepare(Start::Resume);
    let file = std::fs::File::open(run.join("run.h5")).expect("run.h5");
    file.lock().expect("a lock");
    let resumed = scenario.bounded(&mut scenario.command(1), 1, None);
    let resumed = resumed.expect("an end");
    assert_eq!(resumed.code, Some(0), "{}", resumed.said);
    drop(file);
    scenario.same().expect("the same run");
}

/// The digest of a run that ended well.
fn digest(said: &str) -> Option<String> {
    let (_, digest) = said.rsplit_once("digest ")?;
    digest.get(..32).map(String::from)
}

/// Commands that begin a run, in a folder `run`: of every kind of scene and of entry.
fn beginnings(scenario: &Scenario) -> Vec<(&'static str, Vec<String>)> {
    let at = |name: &str| scenario.path(name).display().to_string();
    let succeeds = |code: i32, out: &str, arguments: &[&str]| {
        let arguments: Vec<String> = arguments.iter().map(ToString::to_string).collect();
        let outcome = common::gshear_mpi(1, &scenario.path(out), &arguments);
        assert_eq!(outcome.code, code, "{}", outcome.text);
    };
    // Fewer grains, which are soon at rest.
    let small = [
        "sample.grains=60",
        "sample.length=8e-6",
        "pack.tolerance=0.3",
    ];
    let set = SET
        .into_iter()
        .chain(small)
        .map(|set| format!("--set={set}"));
    let set: Vec<String> = set.collect();
    let set: Vec<&str> = set.iter().map(String::as_str).collect();
    let keep = "--set=output.keep_checkpoints=true";
    succeeds(75, "stopped", &[&[SCENE, "--stop-at=9"], &set[..]].concat());
    let checkpoint = format!("--resume={}", at("stopped/checkpoint.h5"));
    let mut export = reducer();
    export.args([
        "export",
        "--format=lammps-data",
        "--out",
        &at("grains.data"),
    ]);
    succeed(export.arg(scenario.path("stopped/checkpoint.h5")));
    let scene = std::fs::read_to_string(SCENE).expect("the scene");
    let (head, tail) = scene.split_once("grains = 220").expect("its sample");
    let tail = tail.split_once("length = 21e-6").expect("its length").1;
    let packed = format!("{head}packing = \"grains.data\"{tail}").replace("tolerance = 1e-4", "");
    std::fs::write(at("packed.toml"), packed).expect("written");
    std::fs::write(at("sweep.toml"), format!("{scene}\n[sweep]\nseed = [5]\n")).expect("written");
    let boxed = [
        BOX,
        "--set=aqs.steps=1",
        "--set=newtonian.growth_times=0.02",
        "--set=newtonian.spectra=4",
        keep,
    ];
    succeeds(75, "moved", &[&boxed[..], &["--stop-at=20"]].concat());
    let moved = format!("--resume={}", at("moved/checkpoint.h5"));
    let (out, auto) = (format!("--out={}", at("run")), "--resume=auto");
    let branch = format!("--branch={}", at("run"));
    [
        ("inserted", [&[SCENE, keep, auto, &out], &set[..]].concat()),
        (
            "packed",
            [&[&at("packed.toml"), keep, auto, &out], &set[..SET.len()]].concat(),
        ),
        (
            "sweep",
            [&[&at("sweep.toml"), keep, "--sweep=1", &out], &set[..]].concat(),
        ),
        ("box", [&boxed[..], &[auto, &out]].concat()),
        ("elsewhere", vec![&checkpoint, keep, &out]),
        ("box elsewhere", vec![&moved, &out]),
        (
            "branch",
            vec![&checkpoint, keep, &branch, "--set=contact.friction=0.4"],
        ),
    ]
    .map(|(name, arguments)| (name, arguments.into_iter().map(String::from).collect()))
    .into()
}

/// Whatever a kill or a full disk leaves in the first second of a run, the same command begins or
/// continues it. At `many` calls of each beginning, more of them early.
fn first_seconds(many: u64) {
    let scenario = Scenario::new();
    let run = scenario.path("run");
    for (name, arguments) in beginnings(&scenario) {
        let command = |arguments: &[String]| {
            let mut command = program(1);
            command
                .args(arguments)
                .env("FAULT_JOB", scenario.folder.path());
            command
        };
        let end = |mut command: Command| scenario.bounded(&mut command, 1, None).expect("an end");
        let counts = scenario.path("counts");
        let _ = (std::fs::remove_dir_all(&run), std::fs::remove_file(&counts));
        let mut whole = command(&arguments);
        whole.env("LD_PRELOAD", &scenario.shim);
        whole.env("FAULT_PATH", &run).env("FAULT_COUNT", &counts);
        let whole = end(whole);
        assert_eq!(whole.code, Some(0), "{name}: {}", whole.said);
        let expected = digest(&whole.said);
        // Its children count, too.
        let calls = std::fs::read_to_string(&counts).expect("counts");
        let calls = calls
            .split_whitespace()
            .map(|n| n.parse::<u64>().expect("a number"));
        let calls = calls.max().expect("a count");
        println!("{name}: {calls} calls");
        let many = many.min(calls);
        for k in 0..many {
            let call = if many == calls {
                k + 1
            } else {
                1 + calls * k * k / (many * many)
            };
            let _ = std::fs::remove_dir_all(&run);
            let mut faulty = command(&arguments);
            let kind = ["kill", "torn", "enospc"][k as usize % 3];
            faulty
                .env("LD_PRELOAD", &scenario.shim)
                .env("FAULT_PATH", &run);
            faulty
                .env("FAULT_KIND", kind)
                .env("FAULT_CALL", call.to_string());
            let begun = end(faulty);
            let mut again = end(command(&arguments));
            if name == "branch" && again.code == Some(2) {
                // It has a checkpoint.
                let next = format!("--resume={}", run.display());
                assert!(again.said.contains("--resume "), "{}", again.said);
                again = end(command(&[next]));
            }
            let done = ["is finished", "is done"].map(|words| again.said.contains(words));
            let finished = begun.code == Some(0) || done.contains(&true);
            assert!(
                again.code == Some(0) && (finished || digest(&again.said) == expected),
                "{name}: {kind} at call {call} of {calls}: {}\nafter {}",
                again.said,
                begun.said
            );
        }
    }
}

#[test]
fn a_run_begins_whatever_its_first_second_left() {
    first_seconds(4);
}

/// `make faults`.
#[test]
#[ignore = "takes half an hour"]
fn a_run_begins_after_a_fault_at_any_call() {
    first_seconds(u64::MAX);
}

/// `make faults`: `FAULTS` failing calls and `KILLS` kills (1,000 each), by the seed `FAULT_SEED`.
/// Half of the kills are at calls, half at random times. On the numbers of ranks `FAULT_RANKS`.
#[test]
#[ignore = "takes an hour"]
fn a_run_survives_a_thousand_faults_and_kills() {
    let number = |name: &str, otherwise: u64| match std::env::var(name) {
        Ok(text) => text.parse().expect("a number"),
        Err(_) => otherwise,
    };
    let (faults, kills) = (number("FAULTS", 1000), number("KILLS", 1000));
    let mut random = ChaCha8Rng::seed_from_u64(number("FAULT_SEED", 1));
    let ranks = std::env::var("FAULT_RANKS").unwrap_or("1,2,3,4".into());
    let ranks: Vec<usize> = (ranks.split(','))
        .map(|n| n.parse().expect("a number"))
        .collect();
    // Half of the runs begin at a checkpoint, whatever the number of ranks.
    let cells = 2 * ranks.len() as u64;
    let mut cell = 0;
    study(&ranks, |start, ranks, calls| {
        let share = |all: u64, of: u64, k: u64| all * (k + 1) / of - all * k / of;
        let here = [faults, kills / 2, kills - kills / 2].map(|all| share(all, cells, cell));
        cell += 1;
        let mut all = Vec::new();
        for (kinds, count) in [(&FAILING[..], here[0]), (&KILLING[..], here[1])] {
            let ways = (kinds.len() * ranks) as u64;
            for (k, &kind) in kinds.iter().enumerate() {
                for (rank, &of_rank) in calls.iter().enumerate() {
                    let many = share(count, ways, (k * ranks + rank) as u64);
                    let at = spread(of_rank, many, random.random());
                    all.extend(at_calls((start, ranks), kind, rank, at));
                }
            }
        }
        all.extend(random_kills((start, ranks), here[2] as usize, &mut random));
        all
    });
}
