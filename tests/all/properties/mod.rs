//! Any input is either taken or refused with a message: no panic, no hang. Random configurations
//! and LAMMPS data files go the way of a user's: a file is written, read and loaded.
//!
//! Files that were once wrong are in `corpus/`, and seeds of proptest in `regressions`.

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use gshear_dem::failure::Result;
use gshear_dem::state::GrainState;
use gshear_scene::insertion::Lattice;
use gshear_scene::packing::Packing;
use gshear_scene::{Arrangement, Origin, Scene, Source, lammps_data, load, sweep};
use proptest::prelude::*;
use proptest::sample::{Index, select};
use proptest::test_runner::{FileFailurePersistence, TestCaseResult, TestRng, TestRunner};

/// Nothing may take longer.
const LONGEST: Duration = Duration::from_mins(1);

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// Numbers at the ends of their types and beyond, and what is none.
const NUMBERS: [&str; 40] = [
    "0",
    "-0.0",
    "1",
    "2",
    "3",
    "-1",
    "0.5",
    "1e-3",
    "1e3",
    "1e-300",
    "1e300",
    "1e308",
    "-1e308",
    "5e-324",
    "1e-320",
    "2.2250738585072014e-308",
    "1e-200",
    "1e200",
    "1e400",
    "-1e400",
    "inf",
    "-inf",
    "nan",
    "+nan",
    "2147483647",
    "2147483648",
    "4294967295",
    "4294967296",
    "9007199254740993",
    "9223372036854775807",
    "-9223372036854775808",
    "9223372036854775808",
    "18446744073709551616",
    "0x7fffffffffffffff",
    "1_000",
    "1__0",
    "007",
    "1.",
    ".5",
    "1e",
];

/// Values of other types.
const VALUES: [&str; 26] = [
    "true",
    "false",
    "\"\"",
    "\"none\"",
    "none",
    "\"\\u0000\"",
    "'ü€😀\u{202e}'",
    "\"\\uD800\"",
    "[]",
    "[1]",
    "[0]",
    "[1, 2]",
    "[1e6, 1e6]",
    "[1e-300, 1e300]",
    "[nan]",
    "[[1]]",
    "[\"a\"]",
    "{}",
    "{ a = 1 }",
    "[{ velocity = 1e-3, distance = 1e-6 }]",
    "[{ velocity = 0, time = 1e300 }]",
    "[{ velocity = 1e300, time = 1e-300 }]",
    "[{}]",
    "1979-05-27T07:32:00Z",
    "07:32",
    "\"avx2\"",
];

/// Text to put anywhere.
const SNIPPETS: [&str; 21] = [
    "\n",
    "=",
    "[",
    "]",
    "\"",
    "'",
    "\"\"\"",
    "#",
    "{",
    "}",
    ",",
    ".",
    "\r",
    "\0",
    "\u{feff}",
    "😀",
    "\n[sample]\n",
    "\n[[shear.protocol]]\nvelocity = 1\n",
    "\n[sweep]\nseed = [1, 2]\n",
    "\n[aqs]\nstrain_step = 0.001\n",
    "\n[relax]\ntolerance = 1e-9\ndrag = 0.1\n",
];

/// A change of a text.
#[derive(Debug, Clone)]
enum Mutation {
    Flip(Index, u8),
    Truncate(Index),
    Delete(Index, usize),
    DuplicateLine(Index, Index),
    SwapLines(Index, Index),
    DeleteLine(Index),
    Insert(Index, &'static str),
    /// Another number in place of one.
    Number(Index, &'static str),
    /// Another number in place of one of the first ten: the header of a data file.
    EarlyNumber(Index, &'static str),
    /// A number times a power of ten.
    Scale(Index, i32),
    /// One of its numbers in place of another.
    MoveNumber(Index, Index),
}

fn mutation() -> impl Strategy<Value = Mutation> {
    let at = any::<Index>;
    prop_oneof![
        2 => (at(), 0..8u8).prop_map(|(at, bit)| Mutation::Flip(at, 1 << bit)),
        1 => at().prop_map(Mutation::Truncate),
        1 => (at(), 1..40usize).prop_map(|(at, n)| Mutation::Delete(at, n)),
        1 => (at(), at()).prop_map(|(a, b)| Mutation::DuplicateLine(a, b)),
        1 => (at(), at()).prop_map(|(a, b)| Mutation::SwapLines(a, b)),
        1 => at().prop_map(Mutation::DeleteLine),
        1 => (at(), select(&SNIPPETS[..])).prop_map(|(at, s)| Mutation::Insert(at, s)),
        5 => (at(), select(&NUMBERS[..])).prop_map(|(at, s)| Mutation::Number(at, s)),
        2 => (at(), at()).prop_map(|(a, b)| Mutation::MoveNumber(a, b)),
    ]
}

/// Only of numbers.
fn other_number() -> impl Strategy<Value = Mutation> {
    let at = any::<Index>;
    prop_oneof![
        2 => (at(), select(&NUMBERS[..])).prop_map(|(at, s)| Mutation::Number(at, s)),
        2 => (at(), select(&NUMBERS[..])).prop_map(|(at, s)| Mutation::EarlyNumber(at, s)),
        4 => (at(), -20..20i32).prop_map(|(at, power)| Mutation::Scale(at, power)),
        1 => (at(), -300..300i32).prop_map(|(at, power)| Mutation::Scale(at, power)),
        1 => (at(), at()).prop_map(|(a, b)| Mutation::MoveNumber(a, b)),
    ]
}

/// Where the numbers of a text begin and end.
fn numbers(text: &[u8]) -> Vec<std::ops::Range<usize>> {
    let part = |b: &u8| b.is_ascii_alphanumeric() || b"+-._".contains(b);
    let mut found = Vec::new();
    let mut at = 0;
    while at < text.len() {
        let length = text[at..].iter().take_while(|b| part(b)).count();
        let word = std::str::from_utf8(&text[at..at + length]).unwrap_or_default();
        if word.parse::<f64>().is_ok() {
            found.push(at..at + length);
        }
        at += length.max(1);
    }
    found
}

impl Mutation {
    fn apply(&self, text: &mut Vec<u8>) {
        if text.is_empty() {
            return;
        }
        let lines = |text: &[u8], edit: &dyn Fn(&mut Vec<Vec<u8>>)| {
            let mut lines: Vec<Vec<u8>> = text.split(|b| *b == b'\n').map(<[u8]>::to_vec).collect();
            edit(&mut lines);
            lines.join(&b'\n')
        };
        match self {
            Mutation::Flip(at, bit) => {
                let at = at.index(text.len());
                text[at] ^= bit;
            }
            Mutation::Truncate(at) => text.truncate(at.index(text.len())),
            Mutation::Delete(at, n) => {
                let from = at.index(text.len());
                text.drain(from..(from + n).min(text.len()));
            }
            Mutation::DuplicateLine(from, to) => {
                *text = lines(text, &|lines| {
                    let line = lines[from.index(lines.len())].clone();
                    lines.insert(to.index(lines.len()), line);
                });
            }
            Mutation::SwapLines(a, b) => {
                *text = lines(text, &|lines| {
                    let (a, b) = (a.index(lines.len()), b.index(lines.len()));
                    lines.swap(a, b);
                });
            }
            Mutation::DeleteLine(at) => {
                *text = lines(text, &|lines| {
                    lines.remove(at.index(lines.len()));
                });
            }
            Mutation::Insert(at, what) => {
                let at = at.index(text.len());
                text.splice(at..at, what.bytes());
            }
            Mutation::Number(at, what) => {
                let all = numbers(text);
                if !all.is_empty() {
                    text.splice(all[at.index(all.len())].clone(), what.bytes());
                }
            }
            Mutation::EarlyNumber(at, what) => {
                let all = numbers(text);
                if !all.is_empty() {
                    let first = at.index(all.len().min(10));
                    text.splice(all[first].clone(), what.bytes());
                }
            }
            Mutation::Scale(at, power) => {
                let all = numbers(text);
                if !all.is_empty() {
                    let place = all[at.index(all.len())].clone();
                    let old = String::from_utf8_lossy(&text[place.clone()]).into_owned();
                    let x = old.parse::<f64>().unwrap_or(1.0) * 10f64.powi(*power);
                    // An integer stays one, if it can.
                    let new = match old.parse::<i64>() {
                        Ok(_) if x.fract() == 0.0 && x.abs() < 1e18 => format!("{x:.0}"),
                        _ => format!("{x:?}"),
                    };
                    text.splice(place, new.bytes());
                }
            }
            Mutation::MoveNumber(from, to) => {
                let all = numbers(text);
                if !all.is_empty() {
                    let number = text[all[from.index(all.len())].clone()].to_vec();
                    text.splice(all[to.index(all.len())].clone(), number);
                }
            }
        }
    }
}

fn mutated(
    base: impl Strategy<Value = Vec<u8>>,
    mutation: impl Strategy<Value = Mutation>,
    most: usize,
) -> impl Strategy<Value = Vec<u8>> {
    (base, prop::collection::vec(mutation, 0..=most)).prop_map(|(mut text, mutations)| {
        mutations.iter().for_each(|m| m.apply(&mut text));
        text
    })
}

/// Texts of the files with this extension in a folder of the repository.
fn files(folder: &str, extension: &str) -> Vec<Vec<u8>> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(format!("{ROOT}/{folder}"))
        .expect("a folder")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|e| e == extension))
        .collect();
    paths.sort();
    paths
        .iter()
        .map(|p| std::fs::read(p).expect("a file"))
        .collect()
}

/// Paths of all keys, from the schema.
fn keys() -> Vec<String> {
    let schema: serde_json::Value =
        serde_json::from_str(include_str!("../../../docs/scene.schema.json")).expect("JSON");
    let mut found = Vec::new();
    for (name, value) in schema["properties"].as_object().expect("keys") {
        match value["properties"].as_object() {
            Some(table) => found.extend(table.keys().map(|key| format!("{name}.{key}"))),
            None => found.push(name.clone()),
        }
    }
    assert!(found.len() > 60, "{found:?}");
    found
}

/// An override of any key by any value, or of an unknown one.
fn set() -> impl Strategy<Value = String> {
    let key = prop_oneof![20 => select(keys()), 1 => "[a-z.=\"]{0,12}"];
    let number = any::<f64>().prop_map(|x| format!("{x:?}"));
    let value = prop_oneof![
        4 => select(&NUMBERS[..]).prop_map(String::from),
        3 => select(&VALUES[..]).prop_map(String::from),
        2 => number,
        2 => (1e-9..1e9f64).prop_map(|x| format!("{x:?}")),
        1 => any::<i64>().prop_map(|n| n.to_string()),
        1 => "\\PC{0,20}",
    ];
    (key, value).prop_map(|(key, value)| format!("{key}={value}"))
}

/// Cases from which on they are others in every run.
const LONG: u32 = 300;

/// Runs a property on so many cases; seeds of those that fail are kept.
fn check<T: std::fmt::Debug>(
    cases: u32,
    strategy: &impl Strategy<Value = T>,
    property: impl Fn(T) -> TestCaseResult,
) {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/all/properties/regressions"
    );
    let config = ProptestConfig {
        cases,
        source_file: Some(file!()),
        failure_persistence: Some(Box::new(FileFailurePersistence::Direct(path))),
        ..ProptestConfig::default()
    };
    let mut runner = if cases < LONG {
        let rng = TestRng::deterministic_rng(config.rng_algorithm);
        TestRunner::new_with_rng(config, rng)
    } else {
        TestRunner::new(config)
    };
    if let Err(e) = runner.run(strategy, property) {
        panic!("{e}\n{runner}");
    }
}

/// How many inputs were taken and how many were refused.
#[derive(Default)]
struct Counts {
    taken: Cell<u32>,
    refused: Cell<u32>,
}

impl Counts {
    fn count<T>(&self, result: &Result<T, String>) {
        let count = match result {
            Ok(_) => &self.taken,
            Err(_) => &self.refused,
        };
        count.set(count.get() + 1);
    }

    /// One of `least` or more is taken, and some are refused.
    fn finish(&self, what: &str, least: u32) {
        let (taken, refused) = (self.taken.get(), self.refused.get());
        println!("{what}: {taken} taken, {refused} refused");
        let all = taken + refused;
        assert!(
            taken >= all / least && refused > all / 50,
            "{what}: {taken} of {all}"
        );
    }
}

/// The message of a refused input: one line or more, not a book.
fn message<T>(result: Result<T>) -> Result<T, String> {
    result.map_err(|failure| {
        assert_eq!(failure.exit_code(), 2, "{failure}");
        let text = failure.to_string();
        assert!((10..5000).contains(&text.len()), "{} bytes", text.len());
        text
    })
}

/// What must be true of any configuration.
fn configuration(path: &Path, text: &[u8], sets: &[String]) -> Result<Scene, String> {
    std::fs::write(path, text).expect("written");
    let begun = Instant::now();
    let scene = message(Source::read(path).and_then(|source| load(&source, sets)));
    if let Ok(source) = Source::read(path) {
        let _ = message(sweep::members(&source));
    }
    let elapsed = begun.elapsed();
    assert!(elapsed < LONGEST, "{elapsed:?}: {scene:?}");
    let scene = scene?;
    let again = load(&Source::new("scene.toml", scene.toml.clone()), &[]);
    let again = again.unwrap_or_else(|e| panic!("{e}\n{}", scene.toml));
    assert_eq!(again, scene);
    assert_eq!(format!("{again:?}"), format!("{scene:?}"));
    if let Some(walls) = scene.shear()
        && let Origin::Insertion(sizes) = &walls.origin
        && scene.sample.grains <= 2000
    {
        let begun = Instant::now();
        let grains = Lattice::new(scene.seed, &scene.sample, sizes).insert(0, 1);
        let elapsed = begun.elapsed();
        assert!(elapsed < LONGEST, "{elapsed:?}: {}", scene.toml);
        assert_eq!(grains.len(), scene.sample.grains as usize);
        assert!(grains.iter().all(is_sound), "{}", scene.toml);
    }
    Ok(scene)
}

fn is_sound(grain: &GrainState) -> bool {
    let numbers = [grain.position, grain.velocity, grain.angular_velocity];
    grain.radius > 0.0
        && grain.radius.is_finite()
        && numbers.as_flattened().iter().all(|x| x.is_finite())
}

/// One run of a configuration that may have a sweep, which is its last table.
fn without_sweep(text: &[u8]) -> String {
    let text = String::from_utf8(text.to_vec()).expect("text");
    text.split("\n[sweep]").next().unwrap_or_default().into()
}

fn configurations(cases: u32) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("scene.toml");
    let shipped: Vec<_> = [files("configs", "toml"), files("tests/scenes", "toml")].concat();
    let bad = files("tests/bad_input", "toml");
    // What the bad ones extend.
    std::fs::create_dir(folder.path().join("bases")).expect("a folder");
    for entry in std::fs::read_dir(format!("{ROOT}/tests/bad_input/bases")).expect("a folder") {
        let base = entry.expect("an entry");
        let copy = folder.path().join("bases").join(base.file_name());
        std::fs::copy(base.path(), copy).expect("copied");
    }
    let base = prop_oneof![3 => select(shipped.clone()), 1 => select(bad)];
    let counts = Counts::default();
    check(cases / 3, &mutated(base, mutation(), 4), |text| {
        counts.count(&configuration(&path, &text, &[]));
        Ok(())
    });
    counts.finish("mutated configurations", 20);
    // With every key that the scene may have.
    let written = shipped.iter().filter_map(|text| {
        let scene = configuration(&path, without_sweep(text).as_bytes(), &[]).ok()?;
        Some(scene.toml.into_bytes())
    });
    let written: Vec<_> = written.collect();
    assert!(written.len() > 8, "{}", written.len());
    let counts = Counts::default();
    let others = mutated(select(written), other_number(), 3);
    check(cases / 3, &others, |text| {
        counts.count(&configuration(&path, &text, &[]));
        Ok(())
    });
    counts.finish("scenes with other numbers", 20);
    let counts = Counts::default();
    let sets = prop::collection::vec(set(), 1..4);
    check(
        cases - 2 * (cases / 3),
        &(select(shipped), sets),
        |(text, sets)| {
            let text = without_sweep(&text);
            counts.count(&configuration(&path, text.as_bytes(), &sets));
            Ok(())
        },
    );
    counts.finish("configurations with other values", cases);
}

/// A scene of the packing `packing.data` beside it.
fn scene_of_packing(dimension: u8) -> String {
    format!(
        "dimension = {dimension}
        material.density = 2500
        contact = {{ law = '{}', friction = 0.5{} }}
        sample.packing = 'packing.data'
        sample.walls = 'layers'
        load.stiffness_number = 1e3
        shear = {{ inertial_number = 1e-3, strain = 0.01 }}\n",
        ["hooke", "hertz"][usize::from(dimension) - 2],
        [
            ", normal_stiffness = 1e6, damping_ratio = 0.1",
            ", normal_damping = 1e6"
        ][usize::from(dimension) - 2],
    ) + match dimension {
        3 => "material.young_modulus = 1e8\nmaterial.poisson_ratio = 0.3\n",
        _ => "",
    }
}

/// A loose cubic packing.
fn spheres() -> Vec<u8> {
    let atom = |k: usize| lammps_data::Atom {
        id: 1 + k as u64,
        kind: 1,
        diameter: 1e-3,
        density: 2500.0,
        position: [k % 5, k / 5 % 5, k / 25].map(|k| 1e-3 * (k as f64 + 0.5)),
        velocity: [0.1 * k as f64, 0.0, 1e-3],
        angular_velocity: [0.0, 1.0, 2.0],
        line: 0,
    };
    let file = lammps_data::DataFile {
        bounded: Default::default(),
        bounds: [[0.0, 5e-3], [0.0, 5e-3], [0.0, 10e-3]],
        tilt: [0.0; 3],
        stream: None,
        types: 1,
        atoms: (0..200).map(atom).collect(),
    };
    lammps_data::write("spheres", &[], &file).into_bytes()
}

/// The same as a dump and as a list.
fn spheres_in_other_formats() -> [Vec<u8>; 2] {
    let data = lammps_data::parse("spheres", &String::from_utf8(spheres()).expect("text"));
    let rows = |row: &dyn Fn(&lammps_data::Atom, String) -> String| -> String {
        let atoms = data.as_ref().expect("what was written").atoms.iter();
        atoms
            .map(|a| row(a, a.position.map(|x| format!("{x:?}")).join(" ")))
            .collect()
    };
    let dump = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n200\nITEM: BOX BOUNDS xy xz yz pp pp ff\n0 5e-3 0\n0 5e-3 0\n0 10e-3 0\nITEM: ATOMS id x y z radius vx\n";
    let dump = dump.to_owned() + &rows(&|a, place| format!("{} {place} 0.5e-3 1.0\n", a.id));
    let list = "##PERIODIC:: 5e-3 5e-3 10e-3\n".to_owned();
    let list = list + &rows(&|_, place| format!("{place} 0.5e-3\n"));
    [dump, list].map(String::into_bytes)
}

/// What must be true of any data file.
fn data_file(folder: &Path, dimension: u8, text: &[u8]) -> Result<(), String> {
    let packing = folder.join("packing.data");
    std::fs::write(&packing, text).expect("written");
    let config = folder.join("scene.toml");
    std::fs::write(&config, scene_of_packing(dimension)).expect("written");
    let begun = Instant::now();
    let read = Source::read(&config).and_then(|source| {
        let scene = load(&source, &[])?;
        let grains = Packing::read(&packing, Arrangement::BETWEEN_WALLS)?.grains(&scene)?;
        Ok((scene, grains))
    });
    let elapsed = begun.elapsed();
    assert!(elapsed < LONGEST, "{elapsed:?}");
    let (scene, grains) = message(read)?;
    let walls = scene.plane_shear("the scene").expect("a shear");
    let edges = walls.origin.file().expect("a packing").edges;
    let sample = &scene.sample;
    assert_eq!(grains.len(), sample.grains as usize);
    for grain in &grains {
        assert!(is_sound(grain), "{grain:?}");
        let up = scene.dimension.axes() - 1;
        let height = grain.position[up];
        assert!((edges[0]..=edges[1]).contains(&height), "{grain:?}");
        let periods = [sample.length, sample.width];
        for (x, period) in grain.position.iter().zip(periods).take(up) {
            assert!((0.0..period).contains(x), "{grain:?}");
        }
    }
    Ok(())
}

fn data_files(cases: u32) {
    let folder = tempfile::tempdir().expect("a folder");
    let disks = std::fs::read(format!("{ROOT}/tests/scenes/triangular.data")).expect("a file");
    let [dump, list] = spheres_in_other_formats();
    for (dimension, base) in [(2, disks), (3, spheres()), (3, dump), (3, list)] {
        data_file(folder.path(), dimension, &base).expect("a good file");
        let counts = Counts::default();
        check(
            cases / 2,
            &mutated(Just(base), prop_oneof![mutation(), other_number()], 3),
            |text| {
                counts.count(&data_file(folder.path(), dimension, &text));
                Ok(())
            },
        );
        counts.finish(&format!("data files, dimension {dimension}"), 10);
    }
}

#[test]
fn any_configuration_is_taken_or_refused() {
    configurations(400);
}

#[test]
fn any_data_file_is_taken_or_refused() {
    data_files(200);
}

#[test]
#[ignore = "long: 10,000 configurations"]
fn many_configurations_are_taken_or_refused() {
    configurations(10_000);
}

#[test]
#[ignore = "long: 1,000 data files"]
fn many_data_files_are_taken_or_refused() {
    data_files(1000);
}

/// What was wrong once: `.toml` are configurations, `.data` data files.
#[test]
fn the_corpus_is_taken_or_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("scene.toml");
    let corpus = "tests/all/properties/corpus";
    let configs = files(corpus, "toml");
    for text in configs {
        let _ = configuration(&path, &text, &[]);
    }
    for text in files(corpus, "data") {
        for dimension in [2, 3] {
            let _ = data_file(folder.path(), dimension, &text);
        }
    }
}
