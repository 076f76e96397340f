//! Ways to write a configuration: files that extend others, and values with units.

use std::path::Path;

use crate::common::{self, PROGRAM, program, succeed};
use gshear_scene::{Source, load};

const BASE: &str = "
    seed = 1
    material = { young_modulus = 1e9, poisson_ratio = 0.2, density = 2500 }
    contact = { friction = 0.7, damping_ratio = 0.1 }
    sample = { grains = 1000, radius_min = 0.5e-6, radius_max = 1e-6, length = 48e-6 }
    load.stiffness_number = 1e4
    shear = { inertial_number = 2e-4, strain = 0.1 }
";

fn write(folder: &Path, files: &[(&str, &str)]) {
    for (name, text) in files {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        std::fs::write(path, text).expect("written");
    }
}

/// What the program prints of a scene that is checked.
fn checked(folder: &Path, name: &str, set: &[&str]) -> String {
    let mut command = program(1);
    let set = set.iter().flat_map(|set| ["--set", set]);
    let command = command.arg(folder.join(name)).arg("--check").args(set);
    String::from_utf8(succeed(command).stdout).expect("text")
}

/// The scene as its keys and values.
fn scene(text: &str) -> toml::Table {
    text.parse().expect("TOML")
}

#[test]
fn a_file_has_the_keys_of_the_one_that_it_extends() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut all = BASE.replace("friction = 0.7", "friction = 0.3");
    all = all.replace("seed = 1", "seed = 3\ntitle = \"Third\"");
    write(
        folder.path(),
        &[
            ("bases/base.toml", BASE),
            (
                "second.toml",
                "extends = 'bases/base.toml'\nseed = 2\n[contact]\nfriction = 0.3\n",
            ),
            (
                "third.toml",
                "extends = 'second.toml'\nseed = 3\ntitle = 'Third'\n",
            ),
            ("all.toml", &all),
        ],
    );
    let third = checked(folder.path(), "third.toml", &[]);
    assert_eq!(
        scene(&third),
        scene(&checked(folder.path(), "all.toml", &[]))
    );
    let seed = |text: &str| scene(text)["seed"].as_integer();
    assert_eq!(seed(&third), Some(3));
    // `--set` has the last word.
    assert_eq!(
        seed(&checked(folder.path(), "third.toml", &["seed=4"])),
        Some(4)
    );
}

#[test]
fn none_removes_a_key_of_the_base() {
    let folder = tempfile::tempdir().expect("a folder");
    let by_pressure =
        "extends = 'base.toml'\nload = { stiffness_number = 'none', pressure = '13 kPa' }";
    write(
        folder.path(),
        &[
            ("base.toml", &format!("{BASE}\n[sweep]\nseed = [1, 2]\n")),
            ("one.toml", &format!("{by_pressure}\nsweep = 'none'\n")),
            ("two.toml", by_pressure),
        ],
    );
    let one = scene(&checked(folder.path(), "one.toml", &[]));
    assert_eq!(one["load"]["pressure"].as_float(), Some(13e3));
    assert!(one["load"].get("stiffness_number").is_none());
    // The sweep of the base is that of a file without one.
    let list = program(1)
        .arg(folder.path().join("two.toml"))
        .args(["--sweep", "list"])
        .output()
        .expect("the program starts");
    let list = String::from_utf8_lossy(&list.stdout).into_owned();
    assert!(
        list.contains("1  new     seed-1\n   2  new     seed-2"),
        "{list}"
    );
}

/// Paths start in the folder of the file that gives them.
#[test]
fn a_packing_is_found_beside_the_base() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = BASE.replace("sample = {", "sample = { packing = \"grains.data\", ");
    write(
        folder.path(),
        &[
            // As editors on Windows save it, with a byte order mark.
            ("bases/base.toml", &format!("\u{feff}{base}")),
            ("own.toml", "extends = \"bases/base.toml\""),
        ],
    );
    let source = Source::read(folder.path().join("own.toml")).expect("two files");
    let refused = load(&source, &[]).expect_err("no such file").to_string();
    let wanted = format!(
        "{0}/bases/base.toml:5: sample.packing: {0}/bases/grains.data: no such file",
        folder.path().display()
    );
    assert!(refused.starts_with(&wanted), "{refused}\n{wanted}");
}

/// On several ranks, of which only the first reads files; and what the program prints is a
/// configuration with plain numbers.
#[test]
fn ranks_run_the_merged_scene_in_si_units() {
    let folder = tempfile::tempdir().expect("a folder");
    write(
        folder.path(),
        &[
            ("base.toml", BASE),
            (
                "own.toml",
                "extends = 'base.toml'\n[sample]\nradius_min = '0.5 µm'\nlength = '48 um'\n",
            ),
        ],
    );
    let mut command = common::mpirun(2, PROGRAM);
    let command = command.arg(folder.path().join("own.toml")).arg("--check");
    let two = String::from_utf8(succeed(command).stdout).expect("text");
    let base = scene(&checked(folder.path(), "base.toml", &[]));
    assert_eq!(scene(&two), base);
    assert_eq!(base["sample"]["length"].as_float(), Some(48e-6));
}

/// Two spheres of two materials between flat walls, which are pressed together and slide.
const TWO: &str = "two spheres

2 atoms
4 atom types

0.0 0.01 xlo xhi
0.0 0.01 ylo yhi
0.0 0.02 zlo zhi

Atoms # sphere

1 1 0.002 2500.0 0.004 0.005 0.01
2 4 0.002 2500.0 0.00599 0.005 0.01

Velocities

1 0.0 1e-3 0.0 0.0 0.0 0.0
2 0.0 0.0 0.0 0.0 0.0 0.0
";

/// The scene that a run writes, with every default filled in, is the same run: all laws, mixtures
/// whose pairs have defaults of their own, walls, boxes and protocols.
#[test]
fn the_written_scene_runs_to_the_same_digest() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    write(folder.path(), &[("two.data", TWO)]);
    let mixture = |law: &str, elastic: &str, contact: &str, pair: &str| {
        format!(
            "dimension = 3
            material = [
                {{ name = 'a', density = 2500.0 {elastic} }},
                {{ name = 'b', density = 2500.0 {elastic} }},
            ]
            contact = {{ law = '{law}', friction = 100.0, rolling_friction = 1.0, {contact},
                pair = [{{ materials = ['b', 'b'], {pair} }}] }}
            sample = {{ packing = 'two.data', walls = 'flat', wall_material = 'a' }}
            load.pressure = 100.0
            time.step = 1e-7
            shear.protocol = [{{ velocity = 0.0, time = 1e-5, wall_velocity = 0.0 }}]
            output = {{ frame_rows = 1, series_rows = 1 }}"
        )
    };
    let elastic = ", young_modulus = 1e6, poisson_ratio = 0.2";
    let rolls = "rolling_stiffness = 100.0";
    let scenes = [
        mixture(
            "hooke",
            "",
            "normal_stiffness = 1000.0, damping_ratio = 0.0",
            "tangential_stiffness = 1000.0",
        ),
        mixture(
            "mindlin",
            "",
            &format!("normal_stiffness = 1e5, {rolls}"),
            "tangential_stiffness = 9e4",
        ),
        mixture(
            "hertz",
            elastic,
            &format!("normal_damping = 1e6, {rolls}"),
            "normal_damping = 4e6",
        ),
        mixture(
            "hertz-tsuji",
            elastic,
            &format!("restitution = 0.5, {rolls}"),
            "tangential_damping_ratio = 0.9",
        ),
    ];
    let mut runs: Vec<(String, Vec<&str>)> = Vec::new();
    for (k, text) in scenes.iter().enumerate() {
        write(folder.path(), &[(&format!("{k}.toml"), text)]);
        runs.push((at(&format!("{k}.toml")).display().to_string(), Vec::new()));
    }
    let of_tests = |name: &str| format!("{}/tests/scenes/{name}", env!("CARGO_MANIFEST_DIR"));
    runs.push((of_tests("crossing.toml"), vec!["shear.strain=0.001"]));
    runs.push((
        of_tests("periodic.toml"),
        vec!["aqs.steps=1", "newtonian.growth_times=0.1"],
    ));
    let digest = |text: &str| {
        let lines = text.lines().filter(|line| line.contains("digest "));
        let digests = lines.filter_map(|line| line.split_once("digest "));
        let digests: Vec<String> = digests.map(|(_, digest)| digest.to_string()).collect();
        assert!(!digests.is_empty(), "{text}");
        digests
    };
    for (k, (scene, sets)) in runs.iter().enumerate() {
        let [first, again] = ["first", "again"].map(|name| at(&format!("{name}-{k}")));
        let mut arguments = vec![scene.clone()];
        arguments.extend(sets.iter().map(|set| format!("--set={set}")));
        let one = common::gshear_mpi(1, &first, &arguments);
        assert_eq!(one.code, 0, "{scene}: {}", one.text);
        let written = first.join("scene.toml").display().to_string();
        let two = common::gshear_mpi(1, &again, &[written]);
        assert_eq!(two.code, 0, "{scene}: {}", two.text);
        assert_eq!(digest(&one.text), digest(&two.text), "{scene}");
    }
}
