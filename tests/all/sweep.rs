//! Sweeps through the real program: what is run, what is passed over, what goes on.

use std::path::{Path, PathBuf};

use crate::common::{self, Outcome, gshear_mpi, same_run};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing.toml");
/// Short, of less than a second each.
const SWEEP: &str = "[sweep]\n\"contact.friction\" = [0.2, 0.5]\nseed = [5, 6]\n";
const NAMES: [&str; 4] = [
    "friction-0.2_seed-5",
    "friction-0.2_seed-6",
    "friction-0.5_seed-5",
    "friction-0.5_seed-6",
];
const SHORT: &str = "--set=shear.strain=0.2";

fn config(folder: &Path, sweep: &str) -> PathBuf {
    let path = folder.join("sweep.toml");
    let scene = std::fs::read_to_string(SCENE).expect("the scene");
    std::fs::write(&path, format!("{scene}\n{sweep}")).expect("a configuration");
    path
}

fn run(config: &Path, ranks: usize, out: &Path, further: &[&str]) -> Outcome {
    let mut arguments = vec![config.display().to_string()];
    arguments.extend(further.iter().map(ToString::to_string));
    gshear_mpi(ranks, out, &arguments)
}

/// The lines of a list in words.
fn states(outcome: &Outcome) -> Vec<Vec<&str>> {
    assert_eq!(outcome.code, 0, "{}", outcome.text);
    // What is left to do stands on standard error, after the list.
    let runs = |line: &&str| !line.starts_with("left to do: ");
    let lines = outcome.text.lines().filter(runs);
    lines.map(|l| l.split_whitespace().collect()).collect()
}

#[test]
fn all_runs_are_those_that_set_would_make() {
    let temporary = tempfile::tempdir().expect("a folder");
    let (config, out) = (
        config(temporary.path(), SWEEP),
        temporary.path().join("out"),
    );
    let listed = run(&config, 1, &out, &["--sweep=list", SHORT]);
    let expected: Vec<Vec<&str>> = vec![
        vec!["1", "new", NAMES[0]],
        vec!["2", "new", NAMES[1]],
        vec!["3", "new", NAMES[2]],
        vec!["4", "new", NAMES[3]],
    ];
    assert_eq!(states(&listed), expected);
    assert!(
        listed.text.contains("left to do: 4 of 4 runs, about "),
        "{}",
        listed.text
    );
    assert!(!out.exists(), "listing writes nothing");

    // One is done before, one is stopped while it is packed.
    assert_eq!(run(&config, 2, &out, &["--sweep=3", SHORT]).code, 0);
    let mut whole = vec![config.display().to_string()];
    whole.extend(["--sweep=2", SHORT].map(String::from));
    let stopped = common::interrupted(&out, &whole);
    assert_eq!(stopped.code, 75, "{}", stopped.text);
    let listed = run(&config, 1, &out, &["--sweep=list", SHORT]);
    let found: Vec<&str> = states(&listed).iter().map(|line| line[1]).collect();
    assert_eq!(found, ["new", "stopped", "done", "new"]);
    assert!(
        listed.text.contains("left to do: 3 of 4 runs, about "),
        "{}",
        listed.text
    );

    let modified = |name: &str| {
        let file = std::fs::metadata(out.join(name).join("run.h5")).expect("run.h5");
        file.modified().expect("a time")
    };
    let before = modified(NAMES[2]);
    let all = run(&config, 1, &out, &["--sweep=all", SHORT]);
    assert_eq!(all.code, 0, "{}", all.text);
    assert_eq!(modified(NAMES[2]), before, "what is done is passed over");
    for (name, set) in NAMES.iter().zip([
        ["--set=contact.friction=0.2", "--set=seed=5"],
        ["--set=contact.friction=0.2", "--set=seed=6"],
        ["--set=contact.friction=0.5", "--set=seed=5"],
        ["--set=contact.friction=0.5", "--set=seed=6"],
    ]) {
        let alone = temporary.path().join(name);
        let by_set = run(Path::new(SCENE), 1, &alone, &[set[0], set[1], SHORT]);
        assert_eq!(by_set.code, 0, "{}", by_set.text);
        same_run(&alone, &out.join(name));
    }
    means_are_those_of_the_logs(&out);
}

/// The means and errors of the report of the sweep, against those of the latter half of each log.
fn means_are_those_of_the_logs(out: &Path) {
    common::succeed(common::reducer().arg("report").arg(out));
    let read = |path: PathBuf| std::fs::read_to_string(path).expect("a table");
    let tau = |name: &str| {
        let log = read(out.join(name).join("log.csv"));
        let head: Vec<&str> = log.lines().next().expect("names").split(',').collect();
        // ⟨S⟩/⟨N⟩: rows with N near 0 do not count more than others.
        let column = |name: &str| -> Vec<f64> {
            let at = head.iter().position(|of| *of == name).expect("a column");
            let cell = |line: &str| line.split(',').nth(at)?.parse::<f64>().ok();
            log.lines().skip(1).filter_map(cell).collect()
        };
        let strain = column("strain");
        let half = 0.5 * strain[strain.len() - 1];
        let first = strain.iter().filter(|now| **now < half).count();
        // Rows count for the time since the last one: that at the end comes earlier than others.
        let time = column("time");
        let sum = |name: &str| {
            let values = column(name);
            let of_row = |row: usize| values[row] * (time[row] - time[row - 1]);
            (first..values.len()).map(of_row).sum::<f64>()
        };
        sum("shear_force") / sum("normal_force")
    };
    let means = read(out.join("report/means.csv"));
    let lines: Vec<Vec<&str>> = means
        .lines()
        .map(|line| line.split(',').collect())
        .collect();
    assert_eq!(
        lines[0][..3],
        ["contact.friction", "stress_ratio", "stress_ratio_error"]
    );
    for (line, pair) in lines[1..].iter().zip(NAMES.chunks(2)) {
        let [a, b] = [tau(pair[0]), tau(pair[1])];
        // √((a-m)² + (b-m)²)/√2 of two values.
        for (cell, expected) in [(line[1], 0.5 * (a + b)), (line[2], 0.5 * (a - b).abs())] {
            let found: f64 = cell.parse().expect("a number");
            assert!(
                (found - expected).abs() < 1e-12 && expected != 0.0,
                "{found}, not {expected}"
            );
        }
    }
    assert_eq!(lines.len(), 3);
}

#[test]
fn what_will_not_do_is_refused() {
    let temporary = tempfile::tempdir().expect("a folder");
    let config = config(temporary.path(), SWEEP);
    let out = temporary.path().join("out");
    for (arguments, words) in [
        (
            &["--check"][..],
            "sweep: makes 4 runs of this scene; --sweep list",
        ),
        (&["--sweep=5"], "--sweep 5: there are the runs 1 to 4"),
        (&["--sweep=0"], "is none of list, status, all"),
        (
            &["--sweep=all", "--set=seed=3"],
            "seed is a key of the sweep",
        ),
        (
            &["--sweep=list", "--set=sample.grains=0"],
            "sample.grains=0",
        ),
    ] {
        let outcome = run(&config, 1, &out, arguments);
        assert_eq!(outcome.code, 2, "{arguments:?}: {}", outcome.text);
        assert!(
            outcome.text.contains(words),
            "{arguments:?}: {}",
            outcome.text
        );
    }
    let none = run(Path::new(SCENE), 1, &out, &["--sweep=list"]);
    assert!(
        none.code == 2 && none.text.contains("has no [sweep]"),
        "{}",
        none.text
    );
    assert!(!out.exists());

    assert_eq!(run(&config, 1, &out, &["--sweep=1", SHORT]).code, 0);
    let other = run(&config, 2, &out, &["--sweep=1", "--set=load.gravity=1"]);
    assert_eq!(other.code, 2, "{}", other.text);
    assert!(other.text.contains("is of another run"), "{}", other.text);
}

/// One of two cannot be packed in so few steps.
#[test]
fn a_run_that_fails_does_not_keep_the_others_from_running() {
    let temporary = tempfile::tempdir().expect("a folder");
    let sweep = "[sweep]\npack.max_steps = [2000, 5_000_000]\n";
    let (config, out) = (
        config(temporary.path(), sweep),
        temporary.path().join("out"),
    );
    let outcome = run(&config, 1, &out, &["--sweep=all", SHORT]);
    assert_eq!(outcome.code, 3, "{}", outcome.text);
    assert!(
        outcome.text.contains("1 of 2 runs of the sweep failed"),
        "{}",
        outcome.text
    );
    let listed = run(&config, 1, &out, &["--sweep=list", SHORT]);
    let found: Vec<&str> = states(&listed).iter().map(|line| line[1]).collect();
    assert_eq!(found, ["failed", "done"]);
}

/// As `sweep = "none"` in a file that extends this one.
#[test]
fn a_sweep_is_taken_away_from_the_command_line() {
    let temporary = tempfile::tempdir().expect("a folder");
    let config = config(temporary.path(), "[sweep]\nseed = [3, 4]\n");
    let out = temporary.path().join("out");
    let one = run(&config, 1, &out, &["--set=sweep=none", SHORT]);
    assert_eq!(one.code, 0, "{}", one.text);
    assert!(out.join("run.h5").exists(), "one run, in this folder");
    let both = run(&config, 1, &out, &["--set=sweep=none", "--sweep=list"]);
    assert_eq!(both.code, 2, "{}", both.text);
    let wanted = "error: --set sweep=none: takes away the sweep whose runs --sweep asks for";
    assert!(both.text.starts_with(wanted), "{}", both.text);
}

/// Paths of a sweep are from the folder of its file, numbers differ by value, and names of folders
/// are those that file systems have.
#[test]
fn values_of_a_sweep_are_those_of_its_file() {
    let temporary = tempfile::tempdir().expect("a folder");
    let packing = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing.data");
    std::fs::copy(packing, temporary.path().join("grains.data")).expect("a packing");
    let out = temporary.path().join("out");
    let list = |sweep: &str| {
        let config = config(temporary.path(), sweep);
        let none = ["grains", "radius_min", "radius_max", "length"];
        let mut set: Vec<String> = none.map(|key| format!("--set=sample.{key}=none")).into();
        set.extend(["--set=pack.tolerance=none", "--sweep=list"].map(String::from));
        let set: Vec<&str> = set.iter().map(String::as_str).collect();
        run(&config, 1, &out, &set)
    };
    let listed = list("[sweep]\n'sample.packing' = ['grains.data']\n");
    assert_eq!(states(&listed)[0][1..], ["new", "packing-grains.data"]);
    for (values, wanted) in [
        (
            "'contact.friction' = [0.1, 1e-1]",
            "has 0.1 twice, as 1e-1, too",
        ),
        (
            "'load.pressure' = [\"1 kPa\", \"1000 Pa\", 1e3]",
            "has \"1 kPa\" twice, as \"1000 Pa\", too",
        ),
    ] {
        let twice = list(&format!("[sweep]\n{values}\n"));
        assert!(
            twice.code == 2 && twice.text.contains(wanted),
            "{}",
            twice.text
        );
    }
    let title = "x".repeat(300);
    let long = list(&format!("[sweep]\ntitle = ['{title}']\n"));
    let expected = "a folder whose name has ";
    assert!(
        long.code == 2 && long.text.contains(expected),
        "{}",
        long.text
    );
}
