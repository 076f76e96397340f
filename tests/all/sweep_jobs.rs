//! Several runs of a sweep at a time, through the real program: the same bits as one by one, a run
//! that fails, a stop and what continues, the table of all runs.

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::common::crossing::SCENE;
use crate::common::{self, Outcome, PROGRAM, gshear_mpi, mpirun, program, same_run};
use gshear_store::status::{RunState, Status};

/// Short, of less than a second each.
const SHORT: &str = "--set=shear.strain=0.2";

/// Pairs of values, each with two seeds.
const SWEEP: &str =
    "[sweep]\nseeds = 2\n[sweep.zip]\n\"contact.friction\" = [0.2, 0.5]\ntitle = ['a', 'b']\n";
const RUNS: [(&str, [&str; 3]); 4] = [
    ("seed-1_friction-0.2_title-a", ["1", "0.2", "a"]),
    ("seed-1_friction-0.5_title-b", ["1", "0.5", "b"]),
    ("seed-2_friction-0.2_title-a", ["2", "0.2", "a"]),
    ("seed-2_friction-0.5_title-b", ["2", "0.5", "b"]),
];

fn config(folder: &Path, sweep: &str) -> PathBuf {
    let path = folder.join("sweep.toml");
    let scene = std::fs::read_to_string(SCENE).expect("the scene");
    std::fs::write(&path, format!("{scene}\n{sweep}\n")).expect("a configuration");
    path
}

fn run(config: &Path, out: &Path, further: &[&str]) -> Outcome {
    let mut arguments = vec![config.display().to_string()];
    arguments.extend(further.iter().map(ToString::to_string));
    gshear_mpi(1, out, &arguments)
}

/// Number, state and name of each run in the table.
fn table(config: &Path, out: &Path, set: &[&str]) -> Vec<[String; 3]> {
    let mut arguments = vec!["--sweep=status"];
    arguments.extend(set);
    let shown = run(config, out, &arguments);
    assert_eq!(shown.code, 0, "{}", shown.text);
    let mut lines = shown.text.lines().map(str::split_whitespace);
    let head: Vec<&str> = lines.next().expect("names").collect();
    assert_eq!(head, ["run", "state", "stage", "part", "left", "name"]);
    let rows = lines.map(Vec::from_iter).filter(|words| words.len() > 4);
    let rows = rows.filter(|words| words[0].parse::<usize>().is_ok() && words[1] != "runs:");
    rows.map(|words| [words[0], words[1], words[words.len() - 1]].map(String::from))
        .collect()
}

fn states(config: &Path, out: &Path, set: &[&str]) -> Vec<String> {
    let rows = table(config, out, set).into_iter();
    rows.map(|[_, state, _]| state).collect()
}

/// The place of a text in what was said.
fn place(text: &str, wanted: &str) -> usize {
    let found = text.find(wanted);
    found.unwrap_or_else(|| panic!("no {wanted:?} in {text}"))
}

#[test]
fn runs_at_a_time_are_those_one_by_one() {
    let temporary = tempfile::tempdir().expect("a folder");
    let config = config(temporary.path(), SWEEP);
    let (out, on_two) = (temporary.path().join("out"), temporary.path().join("two"));
    assert_eq!(states(&config, &out, &[SHORT]), ["new"; 4]);

    // As the packed part of a job array has it: the range ends beyond the last run.
    let some = run(&config, &out, &["--sweep=3-9", "--jobs=2", SHORT]);
    assert_eq!(some.code, 0, "{}", some.text);
    let ended = "sweep: 2 of 2 runs are done in ";
    assert!(some.text.contains(ended), "{}", some.text);
    let found = table(&config, &out, &[SHORT]);
    let expected = ["new", "new", "done", "done"];
    for (k, row) in found.iter().enumerate() {
        assert_eq!(*row, [&(k + 1).to_string(), expected[k], RUNS[k].0]);
    }
    assert!(!out.join(RUNS[0].0).exists());

    let all = run(&config, &out, &["--sweep=all", "--jobs=2", SHORT]);
    assert_eq!(all.code, 0, "{}", all.text);
    let done = format!("sweep: {} is done\n", RUNS[2].0);
    assert!(all.text.contains(&done), "{}", all.text);
    assert!(all.text.contains("sweep: 4 of 4 runs are done in "));
    if std::thread::available_parallelism().map_or(1, usize::from) > 1 {
        // The second has begun before the first one has ended.
        let second = place(&all.text, &format!("sweep: run 2 of 4, {}", RUNS[1].0));
        let ended = place(&all.text, " is done in ");
        assert!(second < ended, "{}", all.text);
    }

    let ranks = ["--sweep=1,4", "--jobs=2", "--ranks=2", SHORT];
    let two = run(&config, &on_two, &ranks);
    assert_eq!(two.code, 0, "{}", two.text);
    assert_eq!(
        states(&config, &on_two, &[SHORT]),
        ["done", "new", "new", "done"]
    );
    for (name, [seed, friction, title]) in RUNS {
        let alone = temporary.path().join(name);
        let seed = format!("--set=seed={seed}");
        let friction = format!("--set=contact.friction={friction}");
        let title = format!("--set=title={title}");
        let by_set = run(Path::new(SCENE), &alone, &[&seed, &friction, &title, SHORT]);
        same_run(&alone, &out.join(name));
        // It is told at the end of each run.
        let digest = format!(", digest {}\n", by_set.digest());
        let said = [&some.text, &all.text].map(|text| text.matches(&digest).count());
        assert_eq!(said.iter().sum::<usize>(), 1, "{}", all.text);
        if on_two.join(name).exists() {
            assert!(two.text.contains(&digest), "{}", two.text);
        }
    }
}

/// The second cannot be packed in so few steps, and the folder of the third holds another run.
#[test]
fn a_run_that_fails_does_not_stop_the_others() {
    let temporary = tempfile::tempdir().expect("a folder");
    let sweep = "[sweep.zip]\npack.max_steps = [4_000_000, 2000, 5_000_000, 5_000_001]\nseed = [1, 2, 3, 4]\n";
    let config = config(temporary.path(), sweep);
    let out = temporary.path().join("out");
    let third = out.join("max_steps-5-000-000_seed-3");
    let other = run(Path::new(SCENE), &third, &["--set=seed=9", SHORT]);
    assert_eq!(other.code, 0, "{}", other.text);

    let all = run(&config, &out, &["--sweep=all", "--jobs=2", SHORT]);
    // Failures of two kinds.
    assert_eq!(all.code, 1, "{}", all.text);
    for words in [
        "sweep: max_steps-2000_seed-2 failed after ",
        "sweep: max_steps-5-000-000_seed-3 failed after ",
        "is of another run (run_id ",
        "sweep: 2 of 4 runs are done, 2 failed in ",
        "error: 2 of 4 runs of the sweep failed, first max_steps-",
    ] {
        assert!(all.text.contains(words), "{words}: {}", all.text);
    }
    let expected = ["done", "failed", "another", "done"];
    assert_eq!(states(&config, &out, &[SHORT]), expected);
    // Those that are missing are tried again; one kind of failure has its exit code.
    let again = run(&config, &out, &["--sweep=1,2,4", "--jobs=4", SHORT]);
    assert_eq!(again.code, 3, "{}", again.text);
    assert!(again.text.contains(" seed-1 is done\n") || again.text.contains("_seed-1 is done\n"));
    assert!(again.text.contains("1 of 3 runs of the sweep failed"));
}

/// SIGTERM, on which launchers of MPI end their ranks, comes to the program that started them.
#[test]
fn a_stop_leaves_checkpoints_from_which_the_runs_continue() {
    const LONG: &str = "--set=shear.strain=100";
    let temporary = tempfile::tempdir().expect("a folder");
    let config = config(temporary.path(), "[sweep]\nseed = [5, 7, 8]\n");
    let names = ["seed-5", "seed-7", "seed-8"];
    for ranks in ["1", "2"] {
        let out = temporary.path().join(ranks);
        let child = program(1)
            .arg(&config)
            .args(["--sweep=all", "--jobs=2", "--ranks", ranks, LONG, "--out"])
            .arg(&out)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let begun = Instant::now();
        let shears = |name: &&str| {
            let status = Status::read(&out.join(name));
            status.is_some_and(|status| {
                status.state == RunState::Running && status.progress.stage == "shear"
            })
        };
        while !names.iter().any(shears) {
            assert!(begun.elapsed() < Duration::from_mins(2), "no run begins");
            std::thread::sleep(Duration::from_millis(5));
        }
        let found = states(&config, &out, &[LONG]);
        assert!(found.contains(&"running".to_string()), "{found:?}");
        common::signal(child.id(), "TERM");
        let ended = child.wait_with_output().expect("its end");
        let said = String::from_utf8_lossy(&ended.stdout);
        assert_eq!(ended.status.code(), Some(75), "{said}");
        let expected = "sweep: 0 of 3 runs are done, 3 stopped or not begun in ";
        assert!(said.contains(expected), "{said}");
        let found = states(&config, &out, &[LONG]);
        assert_eq!(found[2], "new", "{found:?}");
        assert!(found.contains(&"stopped".to_string()), "{found:?}");
        for name in names {
            assert!(!out.join(name).join("run.lock").exists(), "{name}");
        }
    }

    // To an end that is nearer, to the bits of a run in one go.
    let out = temporary.path().join("2");
    let status = names.map(|name| Status::read(&out.join(name)));
    let strains = status
        .iter()
        .flatten()
        .filter_map(|status| status.progress.strain);
    let reached = strains.fold(0.0, f64::max);
    assert!(reached > 0.0 && reached < 50.0, "{reached}");
    let end = format!("--set=shear.strain={:.1}", reached + 0.5);
    let all = run(
        &config,
        &out,
        &["--sweep=all", "--jobs=2", "--ranks=2", &end],
    );
    assert_eq!(all.code, 0, "{}", all.text);
    assert_eq!(states(&config, &out, &[&end]), ["done"; 3]);
    for name in &names[..2] {
        let alone = temporary.path().join(name);
        let seed = format!("--set={}", name.replace('-', "="));
        let whole = run(Path::new(SCENE), &alone, &[&seed, &end]);
        let digest = format!(", digest {}\n", whole.digest());
        assert!(all.text.contains(&digest), "{}", all.text);
    }
}

#[test]
fn the_wall_time_is_that_of_all_runs() {
    let temporary = tempfile::tempdir().expect("a folder");
    let config = config(temporary.path(), "[sweep]\nseeds = 3\n");
    let out = temporary.path().join("out");
    let ends = ["--sweep=all", "--jobs=1", "--walltime=1ms"];
    let stopped = run(&config, &out, &ends);
    assert_eq!(stopped.code, 75, "{}", stopped.text);
    let expected = "sweep: 0 of 3 runs are done, 3 stopped or not begun in ";
    assert!(stopped.text.contains(expected), "{}", stopped.text);
}

#[test]
fn what_cannot_be_at_a_time_is_refused() {
    let temporary = tempfile::tempdir().expect("a folder");
    let config = config(temporary.path(), SWEEP);
    let out = temporary.path().join("out");
    for (arguments, words) in [
        (
            &["--sweep=list", "--jobs=2"][..],
            "error: --jobs is for runs of a sweep",
        ),
        (&["--jobs=2"], "--sweep"),
        (&["--sweep=all", "--ranks=2"], "--jobs"),
        (&["--sweep=all", "--jobs=2", "--profile"], "--profile"),
        (&["--sweep=all", "--jobs=0"], "0 is not in 1..=65535"),
        (
            &["--sweep=5-8", "--jobs=2"],
            "error: --sweep 5-8: there are the runs 1 to 4",
        ),
        (
            &["--sweep=all", "--jobs=2", "--set=sample.grains=0"],
            "sample.grains=0",
        ),
        (&["--sweep=4-3"], "is none of list, status, all"),
    ] {
        let outcome = run(&config, &out, arguments);
        assert_eq!(outcome.code, 2, "{arguments:?}: {}", outcome.text);
        assert!(
            outcome.text.contains(words),
            "{arguments:?}: {}",
            outcome.text
        );
    }
    let mut launched = mpirun(2, PROGRAM);
    launched.arg(&config).args(["--sweep=all", "--jobs=2"]);
    let ended = launched.arg("--out").arg(&out).output().expect("mpirun");
    let said = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(2), "{said}");
    assert!(
        said.contains("error: --jobs starts each run itself, and "),
        "{said}"
    );

    // No such launcher.
    let variables = [("MPIRUN", "no-such-mpirun")];
    let arguments = ["--sweep=all", "--jobs=2", "--ranks=2"].map(String::from);
    let mut arguments = Vec::from(arguments);
    arguments.insert(0, config.display().to_string());
    let missing = common::with_environment(&variables, 1, &out, &arguments);
    assert_eq!(missing.code, 2, "{}", missing.text);
    let expected = "error: no-such-mpirun: cannot be started: ";
    assert!(missing.text.contains(expected), "{}", missing.text);
    assert!(!out.exists());
}
