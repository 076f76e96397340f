//! Faults of the files that `gshear-reduce` writes: whatever call fails, a file with its name is
//! whole, or the exit code is 1 and the message names the file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::{Table, shim, spread};
use crate::common::{bounded, copy_folder, kept_files, no_parts, reducer, start, succeed};
use hdf5::types::TypeDescriptor;

/// Longest time of a command on a busy machine.
const LONGEST: Duration = Duration::from_mins(5);

/// Calls that fail, and how many of them.
const FAILING: [(&str, Option<u64>); 5] = [
    ("enospc", None),
    ("eio", None),
    ("eio", Some(1)),
    ("short", Some(1)),
    ("close", Some(1)),
];

/// A command that writes files: its words, the run in whose place `RUN` stands, and the file or
/// folder `OUT`.
struct Reduction {
    words: Vec<&'static str>,
    run: PathBuf,
    out: &'static str,
}

/// One of every kind of file.
fn reductions(folder: &Path) -> Vec<Reduction> {
    let [walls, boxed] = ["walls", "box"].map(|name| kept_files(name, folder));
    [
        (&["dmin"][..], &walls, ""),
        (&["spectrum"], &boxed, ""),
        (&["phases"], &walls, ""),
        (&["export", "--format=vtkhdf"], &walls, "frames.vtkhdf"),
        (&["export", "--format=npz"], &walls, "frames.npz"),
        (&["export", "--format=csv"], &walls, "frames.csv"),
        (&["export", "--format=xyz"], &walls, "frames.xyz"),
        (&["export", "--format=lammps-dump"], &walls, "frames.dump"),
        (&["export", "--format=lammps-data"], &walls, "frame.data"),
        (&["movie", "--width=100"], &walls, "movie.png"),
        (&["report"], &boxed, ""),
    ]
    .map(|(words, run, out)| Reduction {
        words: words.to_vec(),
        run: run.clone(),
        out,
    })
    .into()
}

impl Reduction {
    /// What the command writes into `out`, with variables of the library that makes calls fail;
    /// exit code and text.
    fn run(&self, shim: &Path, out: &Path, variables: &[(&str, String)]) -> (i32, String) {
        let _ = std::fs::remove_dir_all(out);
        std::fs::create_dir(out).expect("a folder");
        let mut command = reducer();
        command.args(&self.words).arg(&self.run).arg("--threads=1");
        command.arg("--out").arg(out.join(self.out));
        command.env("LD_PRELOAD", shim).env("FAULT_PATH", out);
        command.envs(variables.iter().map(|(name, value)| (name, value)));
        let outcome = bounded(&mut command, LONGEST).unwrap_or_else(|| panic!("{command:?} hangs"));
        (outcome.code, outcome.text)
    }
}

/// The files below a folder with what they hold: of HDF5 files the numbers, of others the bytes.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
        let path = entry.path();
        if path.is_dir() {
            all.extend(contents(&path));
            continue;
        }
        let is_hdf5 = path
            .extension()
            .is_some_and(|of| of == "h5" || of == "vtkhdf");
        let content = if is_hdf5 {
            let file = hdf5::File::open(&path);
            file.map_or_else(|e| e.to_string().into(), |file| numbers(&file))
        } else {
            std::fs::read(&path).expect("a file")
        };
        all.insert(path, content);
    }
    all
}

fn numbers(group: &hdf5::Group) -> Vec<u8> {
    let mut all = Vec::new();
    for dataset in group.datasets().expect("datasets") {
        all.extend(dataset.name().bytes());
        let values = match dataset.dtype().and_then(|of| of.to_descriptor()) {
            Ok(TypeDescriptor::Float(_)) => dataset
                .read_raw::<f64>()
                .map(|of| of.iter().flat_map(|x| x.to_ne_bytes()).collect()),
            _ => dataset
                .read_raw::<i64>()
                .map(|of| of.iter().flat_map(|x| x.to_ne_bytes()).collect()),
        };
        all.extend::<Vec<u8>>(values.unwrap_or_else(|e| e.to_string().into()));
    }
    for group in group.groups().expect("groups") {
        all.extend(numbers(&group));
    }
    all
}

/// Whether a command with a failing call came to its end with the files of the reference (true) or
/// ended with a message (false); else what is wrong.
fn fate(
    (code, said): (i32, &str),
    kind: &str,
    out: &Path,
    reference: &BTreeMap<PathBuf, Vec<u8>>,
) -> Result<bool, String> {
    let found = contents(out);
    for (path, content) in &found {
        if reference.get(path) != Some(content) {
            let name = path.display();
            return Err(format!("code {code}: {name} differs or is new:\n{said}"));
        }
    }
    let message = said.lines().find(|line| line.starts_with("error: "));
    match (code, message) {
        (0, None) if found.len() == reference.len() => Ok(true),
        (1, Some(message)) if !message.contains(&*out.to_string_lossy()) => {
            Err(format!("names no file: {message}"))
        }
        (1, Some(message)) if kind == "enospc" && !message.contains("No space left on device") => {
            Err(format!("does not say that the disk is full: {message}"))
        }
        (1, Some(_)) => Ok(false),
        _ => Err(format!("ends with code {code}:\n{said}")),
    }
}

/// `many` of the calls of every command, for every kind of fault.
fn study(many: u64) {
    let begun = Instant::now();
    let folder = tempfile::tempdir().expect("a folder");
    let shim = shim(folder.path());
    let out = folder.path().join("results");
    let (mut table, mut lost) = (Table::default(), Vec::new());
    for (number, reduction) in reductions(folder.path()).into_iter().enumerate() {
        let counts = folder.path().join("counts");
        let _ = std::fs::remove_file(&counts);
        let counted = [("FAULT_COUNT", counts.display().to_string())];
        let (code, said) = reduction.run(&shim, &out, &counted);
        assert_eq!(code, 0, "{:?}: {said}", reduction.words);
        let reference = contents(&out);
        // The program starts itself once more.
        let text = std::fs::read_to_string(&counts).expect("counts");
        let numbers = text.split_whitespace().map(str::parse::<u64>);
        let calls = numbers.map(|n| n.expect("a number")).max().unwrap_or(0);
        println!("{:?}: {calls} calls", reduction.words);
        for (k, (kind, times)) in FAILING.into_iter().enumerate() {
            let offset = ((number + k) % FAILING.len()) as f64 / FAILING.len() as f64;
            for call in spread(calls, many, offset) {
                let mut variables = vec![
                    ("FAULT_KIND", kind.to_string()),
                    ("FAULT_CALL", call.to_string()),
                ];
                variables.extend(times.map(|n| ("FAULT_CALLS", n.to_string())));
                let (code, said) = reduction.run(&shim, &out, &variables);
                let fate = fate((code, &said), kind, &out, &reference);
                let kinds = if times.is_some() {
                    "once"
                } else {
                    "from a call on"
                };
                let row = format!("{kind} {kinds} | {}", reduction.words.join(" "));
                let row = table.0.entry(row).or_default();
                match fate {
                    Ok(true) => row[0] += 1,
                    Ok(false) => {
                        row[1] += 1;
                        no_parts(&out);
                    }
                    Err(what) => {
                        row[3] += 1;
                        println!("{:?}, {kind} at call {call}: {what}", reduction.words);
                        lost.push((reduction.words.clone(), kind, call));
                    }
                }
            }
        }
    }
    table.print();
    println!("in {:.0?}", begun.elapsed());
    assert!(
        lost.is_empty(),
        "{} faults lost something: {lost:?}",
        lost.len()
    );
}

#[test]
fn a_reduction_is_whole_or_fails() {
    study(1);
}

/// `make faults`: at `REDUCER_FAULTS` calls (100) of every command for every kind of fault.
#[test]
#[ignore = "takes half an hour"]
fn reductions_are_whole_or_fail_whatever_call_fails() {
    let many = std::env::var("REDUCER_FAULTS").map_or(Ok(100), |text| text.parse());
    study(many.expect("a number"));
}

/// A run that cannot be closed after it was read: the results are complete, and the exit code is 0.
#[test]
fn a_run_that_cannot_be_closed_is_reduced() {
    let folder = tempfile::tempdir().expect("a folder");
    let shim = shim(folder.path());
    let walls = kept_files("walls", folder.path());
    copy_folder(&walls, &folder.path().join("copy"));
    for close in 1..=4 {
        for words in [&["info"][..], &["compare", "copy"]] {
            let mut command = reducer();
            command.args(words).arg(&walls).current_dir(folder.path());
            command.env("LD_PRELOAD", &shim).env("FAULT_PATH", &walls);
            command.env("FAULT_KIND", "close-read");
            command.env("FAULT_CALL", close.to_string());
            let outcome = bounded(&mut command, LONGEST).expect("an end");
            assert_eq!(outcome.code, 0, "{words:?}, {close}: {}", outcome.text);
        }
    }
}

/// A disk that is really full, of every size below that of the file (needs mounting).
#[test]
fn a_full_disk_loses_no_number_in_silence() {
    let folder = tempfile::tempdir().expect("a folder");
    let walls = kept_files("walls", folder.path());
    let disk = folder.path().join("disk");
    std::fs::create_dir(&disk).expect("a folder");
    let [whole, shim] = [folder.path().join("whole"), shim(folder.path())];
    let dmin = Reduction {
        words: vec!["dmin"],
        run: walls,
        out: "",
    };
    assert_eq!(dmin.run(&shim, &whole, &[]).0, 0);
    let size = std::fs::metadata(whole.join("reduced.h5"))
        .expect("a file")
        .len();
    let [.., last] = [0, 1, size.div_ceil(4096)];
    for pages in 1..=last + 1 {
        let mount = start("mount")
            .args([
                "-t",
                "tmpfs",
                "-o",
                &format!("size={}k", 4 * pages),
                "tmpfs",
            ])
            .arg(&disk)
            .output();
        if !mount.is_ok_and(|mount| mount.status.success()) {
            println!("skipped: cannot mount");
            return;
        }
        let mut command = reducer();
        command.arg("dmin").arg(&dmin.run).arg("--out").arg(&disk);
        let outcome = bounded(&mut command, LONGEST);
        let (there, same) = {
            let found = contents(&disk);
            let content = found.get(&disk.join("reduced.h5"));
            let reference = contents(&whole);
            let reference = reference.get(&whole.join("reduced.h5"));
            (content.is_some(), content == reference)
        };
        succeed(start("umount").arg(&disk));
        let outcome = outcome.expect("an end");
        if outcome.code == 0 {
            assert!(same, "{pages} pages: {}", outcome.text);
        } else {
            assert_eq!((outcome.code, there), (1, false), "{}", outcome.text);
            assert!(outcome.text.contains("No space left"), "{}", outcome.text);
        }
    }
}
