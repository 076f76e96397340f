//! Damaged files: flipped bits, missing ends, blocks that are zero, exchanged or noise. The
//! programs refuse them with a message, or do what they do with the whole file; they never crash,
//! hang, or take other numbers in silence.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use crate::common::{self, PROGRAM, REDUCER, bounded, kept_files, program, reducer};
use hdf5::types::{FixedAscii, TypeDescriptor, VarLenUnicode};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Longest time of a program with a damaged file, on a busy machine.
const LONGEST: Duration = Duration::from_mins(1);

/// What happens to the bytes of a file.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Damage {
    /// This bit of this byte.
    Flip(usize, u8),
    /// Nothing from here on.
    Cut(usize),
    /// So many bytes from here on.
    Zero(usize, usize),
    /// Two blocks of so many bytes exchange their places.
    Swap(usize, usize, usize),
    /// So many bytes from here on are those of this seed.
    Noise(usize, usize, u64),
}

impl Damage {
    fn random(bytes: &[u8], random: &mut ChaCha8Rng) -> Self {
        let all = bytes.len();
        let length = [1, 8, 64, 512, 4096][random.random_range(0..5)].min(all / 2);
        let place = |random: &mut ChaCha8Rng| random.random_range(0..=all - length);
        match random.random_range(0..6) {
            0 => Self::Flip(random.random_range(0..all), random.random_range(0..8)),
            1 => {
                // Much of a file of few frames is empty.
                let begin = random.random_range(0..all);
                let filled = (begin..all).find(|&at| bytes[at] != 0);
                Self::Flip(filled.unwrap_or(begin), random.random_range(0..8))
            }
            2 => Self::Cut(random.random_range(0..all)),
            3 => Self::Zero(place(random), length),
            4 => Self::Swap(place(random), place(random), length),
            _ => Self::Noise(place(random), length, random.random_range(0..1000)),
        }
    }

    fn apply(self, bytes: &mut Vec<u8>) {
        match self {
            Self::Flip(at, bit) => bytes[at] ^= 1 << bit,
            Self::Cut(at) => bytes.truncate(at),
            Self::Zero(at, length) => bytes[at..at + length].fill(0),
            Self::Swap(a, b, length) => {
                let whole = bytes.clone();
                bytes[a..a + length].copy_from_slice(&whole[b..b + length]);
                bytes[b..b + length].copy_from_slice(&whole[a..a + length]);
            }
            Self::Noise(at, length, seed) => {
                ChaCha8Rng::seed_from_u64(seed).fill_bytes(&mut bytes[at..at + length]);
            }
        }
    }

    /// As in `corpus.txt`.
    fn parse(words: &[&str]) -> Self {
        let number = |k: usize| words[k].parse::<usize>().expect("a number");
        match words[0] {
            "flip" => Self::Flip(number(1), number(2) as u8),
            "cut" => Self::Cut(number(1)),
            "zero" => Self::Zero(number(1), number(2)),
            "swap" => Self::Swap(number(1), number(2), number(3)),
            "noise" => Self::Noise(number(1), number(2), number(3) as u64),
            other => panic!("{other} is no damage"),
        }
    }
}

/// What the programs made of a damaged file.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Verdict {
    Refused,
    /// The same as with the whole file.
    Harmless,
    /// It is other, valid input, which nothing can tell from the one that was meant.
    Taken,
}

/// The end of a program that must be good or a refusal; else what is wrong with it.
fn ended(command: &mut Command, file: &str) -> Result<Option<String>, String> {
    let Some(outcome) = bounded(command, LONGEST) else {
        return Err("hangs".into());
    };
    let (code, text) = (outcome.code, outcome.text);
    let messages = text.lines().filter(|line| line.starts_with("error: "));
    let messages: Vec<&str> = messages.collect();
    match (code, &messages[..]) {
        _ if text.contains("panicked") => Err(format!("panics:\n{text}")),
        (0, []) => Ok(Some(text)),
        (2, [message]) if message.contains(file) => Ok(None),
        _ => Err(format!("ends with code {code}:\n{text}")),
    }
}

fn simulate() -> Command {
    program(1)
}

fn reduce() -> Command {
    reducer()
}

fn kept_scene(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/files")).join(name)
}

fn digest(text: &str) -> Option<&str> {
    let (_, rest) = text.rsplit_once("digest ")?;
    rest.split_whitespace().next()
}

fn copy(from: &Path, to: &Path) {
    let _ = std::fs::remove_dir_all(to);
    common::copy_folder(from, to);
}

/// A file, the programs that read it, and what they say about the whole file.
trait Subject {
    /// Name in the corpus.
    fn name(&self) -> &'static str;
    /// The whole file.
    fn file(&self) -> &Path;
    /// What the programs make of these bytes in place of the file: `None` if they refuse them.
    fn read(&self, bytes: &[u8]) -> Result<Option<String>, String>;
    /// Whether the programs may make something else of a damaged file.
    fn is_free(&self) -> bool {
        false
    }
}

/// A checkpoint, from which a run goes on.
struct Checkpoint {
    name: &'static str,
    whole: PathBuf,
    folder: PathBuf,
}

impl Subject for Checkpoint {
    fn name(&self) -> &'static str {
        self.name
    }
    fn file(&self) -> &Path {
        &self.whole
    }
    fn read(&self, bytes: &[u8]) -> Result<Option<String>, String> {
        let (path, out) = (self.folder.join("checkpoint.h5"), self.folder.join("out"));
        std::fs::create_dir_all(&self.folder).expect("a folder");
        let _ = std::fs::remove_dir_all(&out);
        std::fs::write(&path, bytes).expect("written");
        let mut command = simulate();
        command.arg("--resume").arg(&path).arg("--out").arg(&out);
        let text = ended(&mut command, "checkpoint.h5")?;
        if text.is_none() && out.exists() {
            return Err("is refused, but something was written".into());
        }
        Ok(text.map(|text| digest(&text).unwrap_or_default().to_string()))
    }
}

/// `run.h5`, of which all is read.
struct Run {
    whole: PathBuf,
    folder: PathBuf,
}

impl Subject for Run {
    fn name(&self) -> &'static str {
        "run"
    }
    fn file(&self) -> &Path {
        &self.whole
    }
    fn read(&self, bytes: &[u8]) -> Result<Option<String>, String> {
        std::fs::create_dir_all(&self.folder).expect("a folder");
        let path = self.folder.join("run.h5");
        std::fs::write(&path, bytes).expect("written");
        let mut said = String::new();
        let mut info = reduce();
        let mut compare = reduce();
        let mut scalars = reduce();
        info.arg("info").arg(&path);
        compare.arg("compare").args([&path, &self.whole]);
        scalars.arg("correlate").arg(&path);
        scalars.arg("--out").arg(self.folder.join("out"));
        for command in [&mut info, &mut compare, &mut scalars] {
            match ended(command, "run.h5")? {
                Some(text) => said += &text,
                None => return Ok(None),
            }
        }
        said += &contents(&self.folder.join("out"));
        Ok(Some(said))
    }
}

/// All files of a folder as text.
fn contents(folder: &Path) -> String {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let files: BTreeMap<PathBuf, String> = entries
        .map(|entry| {
            let bytes = std::fs::read(entry.path()).expect("a file");
            let text = String::from_utf8_lossy(&bytes).into_owned();
            (entry.path(), text)
        })
        .collect();
    format!("{files:?}")
}

/// The file of a run in a periodic box, both parts of which are reduced and exported.
struct BoxFile {
    /// A whole run.
    run: PathBuf,
    whole: PathBuf,
    folder: PathBuf,
}

impl Subject for BoxFile {
    fn name(&self) -> &'static str {
        "box"
    }
    fn file(&self) -> &Path {
        &self.whole
    }
    fn read(&self, bytes: &[u8]) -> Result<Option<String>, String> {
        copy(&self.run, &self.folder);
        let file = self.folder.join("run.h5");
        std::fs::write(&file, bytes).expect("written");
        let mut said = String::new();
        for (part, reduced) in [
            (file.clone(), &["stability", "--until-pair"][..]),
            (file.join("newtonian"), &["growth"]),
        ] {
            let (mut command, mut export) = (reduce(), reduce());
            command.args(reduced).arg(&part);
            command.arg("--out").arg(self.folder.join("reduced"));
            export.args(["export", "--format=csv"]).arg(&part);
            export
                .arg("--out")
                .arg(self.folder.join("frames/frames.csv"));
            for command in [&mut command, &mut export] {
                if ended(command, "run.h5")?.is_none() {
                    return Ok(None);
                }
            }
            let read = |of| contents(&self.folder.join(of));
            said += &(read("reduced") + &read("frames"));
        }
        Ok(Some(said))
    }
}

/// `spectrum.h5` of a run in a box, of which eigenvectors are exported.
struct Spectrum {
    run: PathBuf,
    whole: PathBuf,
    folder: PathBuf,
}

impl Subject for Spectrum {
    fn name(&self) -> &'static str {
        "spectrum"
    }
    fn file(&self) -> &Path {
        &self.whole
    }
    fn read(&self, bytes: &[u8]) -> Result<Option<String>, String> {
        std::fs::create_dir_all(&self.folder).expect("a folder");
        let path = self.folder.join("spectrum.h5");
        std::fs::write(&path, bytes).expect("written");
        let out = self.folder.join("out/frames.csv");
        let mut export = reduce();
        export.args(["export", "--format=csv", "--modes=0,3", "--spectrum"]);
        export.arg(&path).arg("--out").arg(&out).arg(&self.run);
        let exported = ended(&mut export, "spectrum.h5")?;
        Ok(exported.map(|_| contents(&self.folder.join("out"))))
    }
}

/// A file of a folder in which a run goes on.
struct Resumed {
    name: &'static str,
    /// A stopped run.
    run: PathBuf,
    whole: PathBuf,
    folder: PathBuf,
    scene: PathBuf,
    digest: String,
}

impl Subject for Resumed {
    fn name(&self) -> &'static str {
        self.name
    }
    fn file(&self) -> &Path {
        &self.whole
    }
    fn read(&self, bytes: &[u8]) -> Result<Option<String>, String> {
        let name = self.whole.file_name().expect("a name");
        copy(&self.run, &self.folder);
        std::fs::write(self.folder.join(name), bytes).expect("written");
        let mut command = simulate();
        command.arg(&self.scene).arg("--resume=auto");
        command.arg("--out").arg(&self.folder);
        let Some(text) = ended(&mut command, "")? else {
            return Ok(None);
        };
        if digest(&text) != Some(&self.digest) {
            return Err(format!("ends with another digest:\n{text}"));
        }
        let reads = |file: &str| {
            let mut info = reduce();
            let path = self.folder.join(file);
            ended(info.arg("compare").args([&path, &path]), file)
        };
        let file = self.folder.join("run.h5");
        let log = std::fs::read(self.folder.join("log.csv")).expect("a log");
        // Damage in rows and frames of before may stay in a file, and is noticed when it is read.
        let whole = reads("run.h5")?.is_some();
        let set_aside = self.folder.join("run.unreadable-1.h5").exists();
        let all = match (whole, set_aside) {
            (true, false) => {
                let run = gshear_store::run_reader::RunFile::open(&file);
                let run = run.map_err(|e| e.to_string())?;
                let frames = run.records(0..run.frames()).map_err(|e| e.to_string())?;
                format!(
                    "{:?}{:?}{frames:?}{log:?}",
                    run.series(),
                    run.stored_scalars()
                )
            }
            _ => return Ok(None),
        };
        Ok(Some(all))
    }
}

/// Text that a user gives: a configuration, or a packing.
struct Input {
    name: &'static str,
    whole: PathBuf,
    folder: PathBuf,
    scene: Option<PathBuf>,
}

impl Subject for Input {
    fn name(&self) -> &'static str {
        self.name
    }
    fn file(&self) -> &Path {
        &self.whole
    }
    fn read(&self, bytes: &[u8]) -> Result<Option<String>, String> {
        std::fs::create_dir_all(&self.folder).expect("a folder");
        let path = self.folder.join(self.whole.file_name().expect("a name"));
        std::fs::write(&path, bytes).expect("written");
        let mut command = simulate();
        match &self.scene {
            Some(scene) => {
                let packing = format!("--set=sample.packing={}", path.display());
                command.arg(scene).arg(packing)
            }
            None => command.arg(&path),
        };
        ended(command.args(["--check", "--quiet"]), "")
    }
    fn is_free(&self) -> bool {
        true
    }
}

/// All kinds of files, of the kept runs.
fn subjects(folder: &Path) -> Vec<(Box<dyn Subject>, f64)> {
    let walls = kept_files("walls", folder);
    let cell = kept_files("box", folder);
    let stopped = folder.join("stopped");
    let mut command = simulate();
    command.arg(kept_scene("walls.toml")).arg("--stop-at=100");
    let outcome = bounded(command.arg("--out").arg(&stopped), LONGEST).expect("an end");
    assert_eq!(outcome.code, 75, "{}", outcome.text);
    let _ = std::fs::remove_file(stopped.join("checkpoint.previous.h5"));
    let run = gshear_store::run_reader::RunFile::open(&walls).expect("a run");
    let whole = run.digest().expect("a digest").to_string();
    let at = |name: &str| folder.join("damaged").join(name);
    let checkpoint = |name, run: &Path| Checkpoint {
        name,
        whole: run.join("checkpoint.h5"),
        folder: at(name),
    };
    let resumed = |name, file| Resumed {
        name,
        run: stopped.clone(),
        whole: stopped.join(file),
        folder: at(name),
        scene: kept_scene("walls.toml"),
        digest: whole.clone(),
    };
    let input = |name, whole: PathBuf, scene| Input {
        name,
        whole,
        folder: at(name),
        scene,
    };
    let tests = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests"));
    vec![
        (Box::new(checkpoint("checkpoint", &walls)), 0.2),
        (Box::new(checkpoint("box-checkpoint", &cell)), 0.1),
        (
            Box::new(Run {
                whole: walls.join("run.h5"),
                folder: at("run"),
            }),
            0.2,
        ),
        (
            Box::new(BoxFile {
                whole: cell.join("run.h5"),
                run: cell.clone(),
                folder: at("box"),
            }),
            0.15,
        ),
        (
            Box::new(Spectrum {
                whole: spectrum(&cell),
                run: cell.clone(),
                folder: at("spectrum"),
            }),
            0.05,
        ),
        (Box::new(resumed("resumed-run", "run.h5")), 0.1),
        (
            Box::new(resumed("resumed-checkpoint", "checkpoint.h5")),
            0.02,
        ),
        (Box::new(resumed("resumed-log", "log.csv")), 0.04),
        (Box::new(resumed("resumed-scene", "scene.toml")), 0.02),
        (
            Box::new(input("scene", kept_scene("walls.toml"), None)),
            0.06,
        ),
        (
            Box::new(input(
                "packing",
                tests.join("scenes/triangular.data"),
                Some(tests.join("all/damage/packed.toml")),
            )),
            0.06,
        ),
    ]
}

/// `spectrum.h5` of the last state of a run.
fn spectrum(run: &Path) -> PathBuf {
    common::succeed(reduce().arg("spectrum").arg(run));
    run.join("spectrum.h5")
}

fn verdict(subject: &dyn Subject, whole: &str, bytes: &[u8]) -> Result<Verdict, String> {
    match subject.read(bytes)? {
        None => Ok(Verdict::Refused),
        Some(text) if text == whole => Ok(Verdict::Harmless),
        Some(_) if subject.is_free() => Ok(Verdict::Taken),
        Some(text) => Err(format!("makes a difference in silence:\n{text:.2000}")),
    }
}

/// Damages the files `count` times in all and prints the verdicts; fails with what is wrong.
fn study(count: usize, seed: u64) {
    let folder = tempfile::tempdir().expect("a folder");
    let mut bad = Vec::new();
    println!("| file | damaged | refused | harmless | other valid input | wrong |");
    println!("| --- | ---: | ---: | ---: | ---: | ---: |");
    for (subject, share) in subjects(folder.path()) {
        let subject = &*subject;
        let bytes = std::fs::read(subject.file()).expect("the file");
        let whole = subject
            .read(&bytes)
            .expect("a good end")
            .expect("no refusal");
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let many = (share * count as f64).round().max(1.0) as usize;
        let mut counts = [0; 4];
        for _ in 0..many {
            let damage = Damage::random(&bytes, &mut random);
            let mut damaged = bytes.clone();
            damage.apply(&mut damaged);
            match verdict(subject, &whole, &damaged) {
                Ok(verdict) => counts[verdict as usize] += 1,
                Err(what) => {
                    println!("{} {damage:?}: {what}", subject.name());
                    counts[3] += 1;
                    bad.push((subject.name(), damage));
                }
            }
        }
        let [refused, harmless, taken, wrong] = counts;
        let name = subject.name();
        println!("| {name} | {many} | {refused} | {harmless} | {taken} | {wrong} |");
    }
    assert!(bad.is_empty(), "{bad:?}");
}

#[test]
fn damaged_files_are_refused_or_harmless() {
    study(60, 1);
}

/// `make faults`: `DAMAGED` files (1,000), by the seed `FAULT_SEED`.
#[test]
#[ignore = "takes minutes"]
fn a_thousand_damaged_files_are_refused_or_harmless() {
    let number = |name: &str, otherwise: u64| match std::env::var(name) {
        Ok(text) => text.parse().expect("a number"),
        Err(_) => otherwise,
    };
    study(number("DAMAGED", 1000) as usize, number("FAULT_SEED", 2));
}

/// Damage that was once not noticed, or crashed a program.
#[test]
fn damage_of_the_corpus_is_refused_or_harmless() {
    let folder = tempfile::tempdir().expect("a folder");
    let subjects = subjects(folder.path());
    for line in include_str!("corpus.txt").lines() {
        if line.starts_with('#') {
            continue;
        }
        let words: Vec<&str> = line.split(' ').collect();
        let (subject, _) = (subjects.iter())
            .find(|(subject, _)| subject.name() == words[0])
            .unwrap_or_else(|| panic!("{line}: no such file"));
        let mut bytes = std::fs::read(subject.file()).expect("the file");
        let whole = subject
            .read(&bytes)
            .expect("a good end")
            .expect("no refusal");
        Damage::parse(&words[1..]).apply(&mut bytes);
        if let Err(what) = verdict(&**subject, &whole, &bytes) {
            panic!("{line}: {what}");
        }
    }
}

/// One number of a dataset becomes another one.
fn change_one(dataset: &hdf5::Dataset) {
    macro_rules! change {
        ($kind:ty, $other:expr) => {{
            let mut values = dataset.read_raw::<$kind>().expect("numbers");
            let middle = values.len() / 2;
            values[middle] = $other(values[middle]);
            let array = ndarray::Array::from_shape_vec(dataset.shape(), values);
            dataset.write(&array.expect("its shape")).expect("written");
        }};
    }
    let kind = dataset.dtype().expect("a type").to_descriptor();
    match kind.expect("a type") {
        TypeDescriptor::Float(_) => change!(f64, |x: f64| f64::from_bits(x.to_bits() ^ 1)),
        TypeDescriptor::Unsigned(size) if size as usize == 1 => change!(u8, |x| x ^ 1),
        TypeDescriptor::Unsigned(size) if size as usize == 4 => change!(u32, |x| x ^ 1),
        _ => change!(u64, |x| x ^ 1),
    }
}

/// An attribute of `parameters` becomes another one.
fn change_attribute(file: &hdf5::File, group: &str, name: &str) {
    let group = file.group(group).expect("the parameters");
    let attribute = group.attr(name).expect("an attribute");
    let kind = attribute.dtype().expect("a type").to_descriptor();
    match kind.expect("a type") {
        TypeDescriptor::VarLenUnicode => {
            let text = attribute.read_scalar::<VarLenUnicode>().expect("text");
            let other: VarLenUnicode = text
                .replacen(['1', 'a', '0', ' ', 'o'], "2", 1)
                .parse()
                .unwrap();
            attribute.write_scalar(&other).expect("written");
        }
        TypeDescriptor::FixedAscii(_) => {
            let other = FixedAscii::<32>::from_ascii("0000").expect("text");
            attribute.write_scalar(&other).expect("written");
        }
        TypeDescriptor::Float(_) => {
            let mut values = attribute.read_raw::<f64>().expect("numbers");
            values[0] += 1.0;
            let _ = attribute.write_raw(&values).map(drop);
        }
        _ => {
            let value = attribute.read_scalar::<u64>().expect("a number");
            attribute.write_scalar(&(value + 1)).expect("written");
        }
    }
}

/// A resumed run cuts its file after the steps of its checkpoint: with a damaged step it would cut
/// off more, and leave a gap.
#[test]
fn a_damaged_step_is_not_cut_off() {
    let folder = tempfile::tempdir().expect("a folder");
    let (stopped, run) = (folder.path().join("stopped"), folder.path().join("run"));
    let mut command = simulate();
    command.arg(kept_scene("walls.toml")).arg("--stop-at=100");
    let outcome = bounded(command.arg("--out").arg(&stopped), LONGEST).expect("an end");
    assert_eq!(outcome.code, 75, "{}", outcome.text);
    // 0 is the step of the only frame.
    for (name, others) in [
        ("particles/trajectory/position/step", &[u64::MAX][..]),
        ("observables/coordination/step", &[0, u64::MAX]),
        ("observables/gshear/dmin_greatest/step", &[0, u64::MAX]),
    ] {
        for &damaged in others {
            copy(&stopped, &run);
            common::change_file(&run.join("run.h5"), |file| {
                let dataset = file.dataset(name).expect("steps");
                let mut steps: Vec<u64> = dataset.read_raw().expect("numbers");
                *steps.last_mut().expect("a step") = damaged;
                dataset.write_raw(&steps).expect("written");
            });
            let mut resume = simulate();
            resume.arg(kept_scene("walls.toml")).arg("--resume=auto");
            let outcome = bounded(resume.arg("--out").arg(&run), LONGEST).expect("an end");
            let refused = outcome.code == 2 && outcome.text.contains("is damaged");
            assert!(refused, "{name}: {}", outcome.text);
        }
    }
}

/// No number of a run's files can change without being noticed, with the structure intact.
#[test]
fn every_number_is_protected() {
    let folder = tempfile::tempdir().expect("a folder");
    let subjects = subjects(folder.path());
    let mut changed = 0;
    for name in ["run", "box"] {
        let (subject, _) = (subjects.iter())
            .find(|(subject, _)| subject.name() == name)
            .expect("a file");
        let path = folder.path().join("changed.h5");
        let whole = std::fs::read(subject.file()).expect("the file");
        subject.read(&whole).expect("a good end").expect("read");
        let file = hdf5::File::open(subject.file()).expect("HDF5");
        let names = common::datasets(&file, "");
        let groups = ["parameters", "newtonian/parameters"].into_iter();
        let attributes = groups.filter_map(|name| Some((name, file.group(name).ok()?)));
        let attributes: Vec<(String, Option<&str>)> = attributes
            .flat_map(|(name, group)| {
                let names = group.attr_names().unwrap().into_iter();
                names.map(move |attribute| (attribute, Some(name)))
            })
            .collect();
        let full = |name: &&String| file.dataset(name).expect("a dataset").size() > 0;
        let names = names.iter().filter(full).map(|name| (name.clone(), None));
        let objects: Vec<_> = names.chain(attributes).collect();
        for (object, group) in &objects {
            std::fs::write(&path, &whole).expect("written");
            common::change_file(&path, |file| match group {
                Some(group) => change_attribute(file, group, object),
                None => change_one(&file.dataset(object).expect("a dataset")),
            });
            let bytes = std::fs::read(&path).expect("the file");
            let found = subject
                .read(&bytes)
                .unwrap_or_else(|e| panic!("{name} {object}: {e}"));
            match found {
                None => changed += 1,
                Some(_) => panic!("{name} {object}: not noticed"),
            }
        }
    }
    assert!(changed > 150, "{changed}");
}

/// The bytes of some datasets, as any program reads them.
fn numbers(path: &Path, names: &[String]) -> hdf5::Result<Vec<Vec<u8>>> {
    let file = hdf5::File::open(path)?;
    let read = |name: &String| {
        let dataset = file.dataset(name)?;
        let kind = dataset.dtype()?;
        Ok(match kind.size() {
            8 => bytemuck::cast_slice(&dataset.read_raw::<f64>()?).to_vec(),
            4 => bytemuck::cast_slice(&dataset.read_raw::<u32>()?).to_vec(),
            _ => dataset.read_raw::<u8>()?,
        })
    };
    names.iter().map(read).collect()
}

/// HDF5 itself refuses the small files of the reducer if one bit of a number or of the structure
/// has changed.
#[test]
fn every_bit_of_a_spectrum_is_protected() {
    hdf5::silence_errors(true);
    let folder = tempfile::tempdir().expect("a folder");
    let run = kept_files("walls", folder.path());
    common::succeed(reduce().arg("dmin").arg(&run));
    let files = [
        spectrum(&kept_files("box", folder.path())),
        run.join("reduced.h5"),
    ];
    for path in files {
        let whole = std::fs::read(&path).expect("the file");
        let names = common::datasets(&hdf5::File::open(&path).expect("HDF5"), "");
        let stored = numbers(&path, &names).expect("numbers");
        let damaged = folder.path().join("damaged.h5");
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut refused = 0;
        for at in (0..whole.len()).step_by(whole.len() / 400) {
            let mut bytes = whole.clone();
            bytes[at] ^= 1 << random.random_range(0..8);
            std::fs::write(&damaged, &bytes).expect("written");
            match numbers(&damaged, &names) {
                Ok(found) => assert!(found == stored, "{}: byte {at}", path.display()),
                Err(_) => refused += 1,
            }
        }
        assert!(refused > 100, "{}: {refused}", path.display());
    }
}

/// What somebody can put in the place of a dataset.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Hostile {
    Huge,
    Empty,
    Texts,
    Flat,
    Dangling,
    Circle,
    NotANumber,
    OtherFile,
    OtherDataset,
    Virtual,
}

impl Hostile {
    const ALL: [Self; 10] = [
        Self::Huge,
        Self::Empty,
        Self::Texts,
        Self::Flat,
        Self::Dangling,
        Self::Circle,
        Self::NotANumber,
        Self::OtherFile,
        Self::OtherDataset,
        Self::Virtual,
    ];

    /// Whether the numbers are those of a file of the user's.
    fn leads_away(self) -> bool {
        matches!(self, Self::OtherFile | Self::OtherDataset | Self::Virtual)
    }

    /// `own`: a file of the user's, which is HDF5 and holds a list `x` of numbers.
    fn replace(self, file: &hdf5::File, name: &str, own: &Path) -> hdf5::Result<()> {
        let old = file.dataset(name)?;
        let (mut shape, rows, floats) = (old.shape(), old.shape()[0], old.dtype()?.is::<f64>());
        drop(old);
        let own = own.to_str().expect("a path");
        file.unlink(name)?;
        let numbers = file.new_dataset::<f64>();
        match self {
            Self::Huge => {
                shape[0] = 1 << 40;
                let chunk: Vec<usize> = shape.iter().map(|&n| n.min(64)).collect();
                numbers.chunk(chunk).shape(shape).create(name)?;
            }
            Self::Empty => {
                shape[0] = 0;
                numbers.shape(shape).create(name)?;
            }
            Self::Texts => {
                file.new_dataset::<FixedAscii<8>>()
                    .shape(shape)
                    .create(name)?;
            }
            Self::Flat => {
                let all: usize = shape.iter().product();
                numbers.shape([all, 1, 1, 1]).create(name)?;
            }
            Self::Dangling => file.link_soft("/nowhere", name)?,
            Self::Circle => {
                let (group, _) = name.rsplit_once('/').expect("a path");
                file.link_hard(&format!("{group}/"), name)?;
            }
            Self::NotANumber if floats => {
                let all = vec![f64::NAN; shape.iter().product()];
                let all = ndarray::Array::from_shape_vec(shape, all).expect("its shape");
                file.new_dataset_builder().with_data(&all).create(name)?;
            }
            Self::NotANumber => {
                let all = vec![u64::MAX; shape.iter().product()];
                let all = ndarray::Array::from_shape_vec(shape, all).expect("its shape");
                file.new_dataset_builder().with_data(&all).create(name)?;
            }
            Self::OtherFile => {
                numbers
                    .external(own, 0, 8 * rows)
                    .shape([rows])
                    .create(name)?;
            }
            Self::OtherDataset => file.link_external(own, "/x", name)?,
            Self::Virtual => {
                numbers
                    .virtual_map(own, "/x", rows, .., rows, ..)
                    .shape([rows])
                    .create(name)?;
            }
        }
        Ok(())
    }
}

/// Files that somebody made on purpose, with the sums that they need: no program crashes, takes
/// more memory than there is in the file, or reads another file of the user's.
#[test]
fn hostile_files_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let own = at("own.h5");
    let file = hdf5::File::create(&own).expect("HDF5");
    let numbers = [7.0; 1000];
    (file.new_dataset_builder().with_data(&numbers).create("x")).expect("numbers");
    file.close().expect("closed");
    let walls = kept_files("walls", folder.path());
    let cell = kept_files("box", folder.path());
    let spectrum = spectrum(&cell);
    let damaged = at("damaged");
    std::fs::create_dir(&damaged).expect("a folder");
    let reduce = |words: &'static [&'static str]| (REDUCER, words);
    let resume: (_, &[_]) = (PROGRAM, &["-q", "--resume"]);
    let of_run = [
        reduce(&["info"]),
        reduce(&["export", "--format=npz"]),
        reduce(&["phases"]),
        reduce(&["dmin"]),
        reduce(&["correlate"]),
        reduce(&["report"]),
    ];
    let of_box = [
        reduce(&["report"]),
        reduce(&["export", "--format=csv"]),
        reduce(&["stability"]),
    ];
    let of_modes = [reduce(&[
        "export",
        "--format=csv",
        "--modes=0",
        "--spectrum",
    ])];
    let mut refused = 0;
    for (whole, programs) in [
        (walls.join("run.h5"), &of_run[..]),
        (cell.join("run.h5"), &of_box),
        (walls.join("checkpoint.h5"), &[resume]),
        (cell.join("checkpoint.h5"), &[resume]),
        (spectrum, &of_modes),
    ] {
        let name = whole.file_name().expect("a name").to_str().expect("text");
        let names = common::datasets(&hdf5::File::open(&whole).expect("HDF5"), "");
        for (k, dataset) in names
            .iter()
            .filter(|name| !name.contains("checksums"))
            .enumerate()
        {
            let hostile = Hostile::ALL[k % Hostile::ALL.len()];
            let path = damaged.join(name);
            std::fs::copy(&whole, &path).expect("a copy");
            common::change_file(&path, |file| {
                hostile.replace(file, dataset, &own).expect("replaced");
            });
            let (program, words) = programs[k / Hostile::ALL.len() % programs.len()];
            // 8 GB of addresses: nothing that the file announces and does not hold. Products of
            // matrices reserve some for the caches of the processor, of some 600 MB a thread.
            let mut command = common::start("sh");
            command.args(["-c", "ulimit -v 8000000; exec \"$0\" \"$@\"", program]);
            command.args(words).arg(&path);
            if name == "spectrum.h5" {
                command.arg(&cell);
            }
            if words[0] != "info" {
                command.arg("--out").arg(at("out/file"));
            }
            let outcome = bounded(&mut command, LONGEST).expect("an end");
            let (code, text) = (outcome.code, outcome.text);
            let _ = std::fs::remove_dir_all(at("out"));
            assert!(
                [0, 2, 3].contains(&code) && !text.contains("panicked"),
                "{words:?} {dataset} {hostile:?}: {code}\n{text}"
            );
            refused += u32::from(code == 2);
            let is_known = code == 2 && text.contains(name);
            assert!(
                is_known || !hostile.leads_away(),
                "{words:?} {dataset} {hostile:?}: is read\n{text}"
            );
        }
    }
    assert!(refused > 100, "{refused}");
}
