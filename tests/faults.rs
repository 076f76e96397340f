//! Faults of files and processes: system calls that fail, and kills, at every call that writes into
//! the folder of a run. Afterwards the run resumes to the same bits.

mod common;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use common::crossing::{SCENE, whole};
use common::{gshear_mpi, mpirun, same_run, succeed};
use gshear_dem::failure::Failure;
use gshear_store::run_reader::RunFile;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Longest time of a run with a fault, its watchdog included.
const LONGEST: Duration = Duration::from_secs(90);
/// Several checkpoints and many frames in a short run.
const SET: [&str; 4] = [
    "output.checkpoint_strain=0.001",
    "output.frame_strain=2e-4",
    "shear.strain=0.004",
    "bookkeeping.watchdog=4",
];

/// The library that makes calls fail, compiled into `folder`.
fn shim(folder: &Path) -> PathBuf {
    let library = folder.join("shim.so");
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/faults/shim.c");
    let mut compiler = Command::new("cc");
    compiler.args(["-O1", "-shared", "-fPIC", "-w", source, "-o"]);
    succeed(compiler.arg(&library).arg("-ldl"));
    library
}

/// A fault: what happens, from which call of a rank on, how often.
#[derive(Debug, Clone, Copy)]
struct Fault {
    kind: &'static str,
    ranks: usize,
    rank: usize,
    call: u64,
    /// How many calls fail; `None`: all from the first on.
    calls: Option<u64>,
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

struct Scenario<'a> {
    shim: &'a Path,
    reference: &'a Path,
    digest: &'a str,
}

impl Scenario<'_> {
    /// Runs with the fault, then resumes. Fails with what was lost.
    fn fate(&self, fault: Fault, out: &Path) -> Result<Fate, String> {
        let program = env!("CARGO_BIN_EXE_gshear-mpi");
        let mut command = match fault.ranks {
            1 => Command::new(program),
            ranks => mpirun(ranks, program),
        };
        command.arg(SCENE).arg("--out").arg(out);
        command.args(SET.iter().map(|set| format!("--set={set}")));
        command
            .env("LD_PRELOAD", self.shim)
            .env("FAULT_PATH", out)
            .env("FAULT_KIND", fault.kind)
            .env("FAULT_RANK", fault.rank.to_string())
            .env("FAULT_CALL", fault.call.to_string())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        if let Some(calls) = fault.calls {
            command.env("FAULT_CALLS", calls.to_string());
        }
        let mut child = command.spawn().expect("the program starts");
        let begun = Instant::now();
        while child.try_wait().expect("its state").is_none() {
            if begun.elapsed() > LONGEST {
                let _ = child.kill();
                return Err("hangs".into());
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let output = child.wait_with_output().expect("its output");
        let said = String::from_utf8_lossy(&output.stdout).into_owned()
            + &String::from_utf8_lossy(&output.stderr);
        if output.status.success() {
            return match said.contains(&format!("digest {}", self.digest)) {
                true => Ok(Fate::Unharmed),
                false => Err(format!("ends well with another digest:\n{said}")),
            };
        }
        let crash = ["SIGSEGV", "Segmentation", "panicked"];
        if output.status.code().is_none() && fault.kind != "kill" && fault.kind != "torn"
            || crash.iter().any(|word| said.contains(word))
        {
            return Err(format!("crashes ({}):\n{said}", output.status));
        }
        let early = !out.join("checkpoint.h5").exists();
        if early && out.join("checkpoint.previous.h5").exists() {
            return Err("checkpoint.h5 is missing".into());
        }
        // As job scripts do; without a checkpoint the run begins again.
        let mut arguments = vec![SCENE.to_string(), "--resume=auto".into()];
        arguments.extend(SET.iter().map(|set| format!("--set={set}")));
        let resumed = gshear_mpi(fault.ranks, out, &arguments);
        if resumed.code != 0 {
            return Err(format!("is not resumed: {}\nafter:\n{said}", resumed.text));
        }
        let run = RunFile::open(out).map_err(|e| e.to_string())?;
        if run.digest() != Some(self.digest) {
            return Err(format!(
                "ends with another digest: {}\nafter:\n{said}",
                resumed.text
            ));
        }
        let fate = if early { Fate::Early } else { Fate::Resumed };
        let same = std::panic::catch_unwind(|| same_run(out, self.reference));
        same.map(|()| fate)
            .map_err(|_| format!("run.h5 differs\nafter:\n{said}\nresumed:\n{}", resumed.text))
    }

    /// Calls of each rank in a run without a fault.
    fn calls(&self, ranks: usize, folder: &Path) -> Vec<u64> {
        let (out, counts) = (
            folder.join("counted"),
            folder.join(format!("counts-{ranks}")),
        );
        let variables = [
            ("LD_PRELOAD", self.shim.to_str().expect("a path")),
            ("FAULT_PATH", out.to_str().expect("a path")),
            ("FAULT_COUNT", counts.to_str().expect("a path")),
        ];
        let mut arguments = vec![SCENE.to_string()];
        arguments.extend(SET.iter().map(|set| format!("--set={set}")));
        let outcome = common::with_environment(&variables, ranks, &out, &arguments);
        assert_eq!(outcome.digest(), self.digest);
        std::fs::remove_dir_all(&out).expect("removed");
        let mut calls = vec![0; ranks];
        for line in std::fs::read_to_string(&counts).expect("counts").lines() {
            let mut numbers = line.split(' ').map(|n| n.parse::<u64>().expect("a number"));
            let (rank, count) = (numbers.next().unwrap() as usize, numbers.next().unwrap());
            calls[rank] = calls[rank].max(count);
        }
        calls
    }
}

/// Runs all faults of `choose` and counts their fates; fails with the first few that lost anything.
fn study(
    choose: impl Fn(usize, &[u64]) -> Vec<Fault>,
    ranks: &[usize],
) -> Vec<(String, [usize; 4])> {
    let folder = tempfile::tempdir().expect("a folder");
    let shim = shim(folder.path());
    let reference = folder.path().join("reference");
    let digest = whole(&reference, 1, &SET).digest();
    let scenario = Scenario {
        shim: &shim,
        reference: &reference,
        digest: &digest,
    };
    let (mut table, mut lost) = (Vec::<(String, [usize; 4])>::new(), Vec::new());
    for &ranks in ranks {
        let calls = scenario.calls(ranks, folder.path());
        for fault in choose(ranks, &calls) {
            let name = format!("{} on {} ranks", fault.kind, fault.ranks);
            let out = folder.path().join("run");
            let fate = scenario.fate(fault, &out);
            let column = match &fate {
                Ok(Fate::Unharmed) => 0,
                Ok(Fate::Resumed) => 1,
                Ok(Fate::Early) => 2,
                Err(_) => 3,
            };
            if let Err(what) = fate {
                println!("{fault:?}: {what}");
                lost.push(fault);
            }
            match table.last_mut().filter(|(known, _)| *known == name) {
                Some((_, counts)) => counts[column] += 1,
                None => {
                    let mut counts = [0; 4];
                    counts[column] = 1;
                    table.push((name, counts));
                }
            }
            let _ = std::fs::remove_dir_all(&out);
        }
    }
    println!("{table:#?}");
    assert!(
        lost.is_empty(),
        "{} faults lost something: {lost:?}",
        lost.len()
    );
    table
}

/// All that a run's file says.
fn content(path: &Path) -> Result<String, Failure> {
    let run = RunFile::open(path)?;
    let frames = run.records(0..run.frames())?;
    let text = format!(
        "{:?}{:?}{:?}{:?}{frames:?}",
        run.parameters(),
        run.grains(),
        run.series(),
        run.stored_scalars()
    );
    Ok(text)
}

/// Damages a file of `folder` at `count` places, one at a time. Returns how often it was noticed,
/// and harmless; fails if it was neither.
fn damage(path: &Path, count: u64, seed: u64) -> [usize; 2] {
    let whole = std::fs::read(path).expect("the file");
    let before = content(path).expect("a good file");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (mut counts, mut silent) = ([0; 2], Vec::new());
    let damaged = path.with_file_name("damaged.h5");
    for _ in 0..count {
        let mut bytes = whole.clone();
        let place = random.random_range(0..bytes.len());
        let bit = random.random_range(0..8);
        bytes[place] ^= 1 << bit;
        std::fs::write(&damaged, &bytes).expect("written");
        match content(&damaged) {
            Err(_) => counts[0] += 1,
            Ok(text) if text == before => counts[1] += 1,
            Ok(_) => silent.push((place, bit)),
        }
    }
    assert!(silent.is_empty(), "not noticed (byte, bit): {silent:?}");
    counts
}

#[test]
fn damage_of_a_run_is_noticed() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    whole(&out, 2, &SET);
    let [noticed, harmless] = damage(&out.join("run.h5"), 200, 1);
    println!("noticed {noticed}, harmless {harmless}");
    assert!(noticed > 20);
}

/// So many of the calls 1 … `all`, evenly spread.
fn spread(all: u64, many: u64) -> impl Iterator<Item = u64> {
    let many = many.min(all);
    (0..many).map(move |k| 1 + k * (all - 1) / (many - 1).max(1))
}

const KINDS: [&str; 5] = ["kill", "torn", "enospc", "eio", "short"];

/// A fault of every kind at each of these calls of these ranks.
fn faults(
    ranks: usize,
    kind: &'static str,
    rank: usize,
    at: impl Iterator<Item = u64>,
) -> Vec<Fault> {
    // A device that fails once; a disk stays full.
    let calls = (kind == "short" || kind == "eio").then_some(1);
    let fault = |call| Fault {
        kind,
        ranks,
        rank,
        call,
        calls,
    };
    at.map(fault).collect()
}

#[test]
fn a_run_survives_faults_of_its_files() {
    let choose = |ranks: usize, calls: &[u64]| {
        let of_kind = |(k, kind)| {
            let rank = k % ranks;
            faults(ranks, kind, rank, spread(calls[rank], 2))
        };
        KINDS.into_iter().enumerate().flat_map(of_kind).collect()
    };
    study(choose, &[1, 3]);
}

/// `make faults`: every call of every rank.
#[test]
#[ignore = "takes an hour"]
fn a_run_survives_a_fault_at_every_call() {
    let number = |text: &str| text.parse::<usize>().expect("a number");
    let ranks = std::env::var("FAULT_RANKS").unwrap_or("1,2,3,4".into());
    let ranks: Vec<usize> = ranks.split(',').map(number).collect();
    let every = std::env::var("FAULT_EVERY").map_or(1, |every| number(&every));
    let choose = |ranks: usize, calls: &[u64]| {
        let mut all = Vec::new();
        for kind in KINDS {
            for (rank, &last) in calls.iter().enumerate() {
                all.extend(faults(ranks, kind, rank, (1..=last).step_by(every)));
            }
        }
        all
    };
    study(choose, &ranks);
}
