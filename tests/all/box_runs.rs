//! Boxes are runs like others: sweeps, kept checkpoints, replays, other folders.

use std::path::Path;
use std::time::{Duration, Instant};

use crate::common::{self, Outcome, PROGRAM, gshear_mpi, program, reducer};
use gshear_store::file_names::NEWTONIAN_PART;
use gshear_store::run_reader::RunFile;

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");

fn run(scene: &Path, ranks: usize, folder: &Path, more: &[&str]) -> Outcome {
    let mut arguments = vec![scene.display().to_string()];
    arguments.extend(more.iter().map(|s| (*s).to_string()));
    gshear_mpi(ranks, folder, &arguments)
}

fn done(outcome: &Outcome) -> &str {
    assert_eq!(outcome.code, 0, "{}", outcome.text);
    &outcome.text
}

fn newtonian(folder: &Path) -> RunFile {
    RunFile::open_any(&folder.join(NEWTONIAN_PART)).expect("a run")
}

/// A stretch of Newton's equations from the kept checkpoint: the same frames, to the last bit.
#[test]
fn a_stretch_of_newtons_equations_is_replayed() {
    let temporary = tempfile::tempdir().expect("a folder");
    let at = |name: &str| temporary.path().join(name);
    let scene = Path::new(SCENE);
    let short = ["--set=aqs.steps=2", "--set=newtonian.rows=100"];
    let with = |more: &[&'static str]| [&short[..], more].concat();
    let frames = with(&["--set=newtonian.frames=100"]);
    done(&run(scene, 1, &at("frames"), &frames));
    let kept = with(&[
        "--set=newtonian.frames=0",
        "--set=output.keep_checkpoints=true",
    ]);
    done(&run(scene, 2, &at("kept"), &kept));
    let stored = newtonian(&at("frames"));
    let times = &stored.series().time;
    let [from, to] = [0.3, 0.6].map(|part| times[(part * times.len() as f64) as usize]);
    let replayed = at("replayed");
    let output = reducer()
        .arg("replay")
        .arg(at("kept"))
        .args([&format!("--time={from}..{to}"), "--every=1", "--out"])
        .arg(&replayed)
        .output()
        .expect("the program starts");
    let text = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(text.contains("to the last bit"), "{text}");
    let again = newtonian(&replayed);
    let mut compared = 0;
    for (t, step) in again.frame_steps().iter().enumerate() {
        if let Ok(of) = stored.frame_steps().binary_search(step) {
            let at =
                |run: &RunFile, t: usize| run.records(t..t + 1).expect("a frame").remove(0).grains;
            assert_eq!(at(&again, t), at(&stored, of), "step {step}");
            compared += 1;
        }
    }
    assert!(compared >= 20, "{compared} frames of both");
    assert!(again.frames() > compared, "denser than the stored ones");
}

/// A sweep over boxes: what is done is passed over, what was stopped goes on, to the same bits.
#[test]
fn a_sweep_over_boxes_goes_on() {
    let temporary = tempfile::tempdir().expect("a folder");
    let config = temporary.path().join("sweep.toml");
    let text = std::fs::read_to_string(SCENE).expect("the scene");
    let sweep = "[sweep]\n\"contact.friction\" = [0.1, 0.3]\n";
    // The friction of the scene gives way to that of the sweep.
    let text = text.replace("friction = 0.3", "friction = 0.2");
    std::fs::write(&config, format!("{text}\n{sweep}")).expect("a configuration");
    let out = temporary.path().join("out");
    let short = ["--set=aqs.steps=3", "--set=newtonian.rows=20"];
    let with = |more: &[&'static str]| [&short[..], more].concat();
    let first = run(&config, 1, &out, &with(&["--sweep=1"]));
    done(&first);
    // Quiet: without the line of what is left to do.
    let listed = run(&config, 1, &out, &with(&["--sweep=list", "--quiet"]));
    let states: Vec<&str> = done(&listed)
        .lines()
        .filter_map(|line| line.split_whitespace().nth(1))
        .collect();
    assert_eq!(states, ["done", "new"]);
    let all = run(&config, 2, &out, &with(&["--sweep=all"]));
    assert!(done(&all).contains("friction-0.1 is done"), "{}", all.text);
    let alone = temporary.path().join("alone");
    let set = with(&["--set=contact.friction=0.3"]);
    let single = run(Path::new(SCENE), 1, &alone, &set);
    let digest = |text: &str| text.rsplit("digest ").next().map(|t| t[..32].to_string());
    assert_eq!(digest(&all.text), digest(done(&single)));
}

/// Random places of the box: at rest within the tolerance, at other places than those of the
/// lattice, and to the same bits on any ranks.
#[test]
fn random_places_come_to_rest_on_any_ranks() {
    let temporary = tempfile::tempdir().expect("a folder");
    let digests = |name: &str, ranks: usize, placement: &str| -> Vec<String> {
        let folder = temporary.path().join(name);
        let placement = format!("--set=sample.placement={placement}");
        let more = ["--set=aqs.steps=1", &*placement];
        let outcome = run(Path::new(SCENE), ranks, &folder, &more);
        let words = done(&outcome).split_whitespace();
        let next = words.clone().skip(1);
        let found = words.zip(next).filter(|(word, _)| *word == "digest");
        found.map(|(_, digest)| digest.to_string()).collect()
    };
    let alone = digests("one", 1, "random");
    assert!(!alone.is_empty());
    assert_eq!(alone, digests("two", 2, "random"));
    assert_ne!(alone, digests("lattice", 1, "lattice"));
    let strained = RunFile::open_any(&temporary.path().join("one/run.h5")).expect("a run");
    let first = |name: &str| strained.series().column(name)[0];
    assert!(first("residual") <= 1e-9 && first("pressure") > 0.0);
    assert!((first("solid_fraction") - 0.72).abs() < 1e-12);
}

/// Random places too crowded for the law, and a relaxation that takes too many steps: one message
/// each, with what to do, and exit code 3.
#[test]
fn random_places_that_do_not_settle_are_refused() {
    let temporary = tempfile::tempdir().expect("a folder");
    for (name, more, expected) in [
        (
            "crowded",
            &[
                "--set=sample.solid_fraction=1.19",
                "--set=sample.radius_min=0.3",
                "--set=sample.large_fraction=0.2",
                "--set=time.step=0.02",
            ][..],
            "still overlap by ",
        ),
        (
            "slow",
            &["--set=relax.max_steps=100", "--set=relax.tolerance=1e-16"],
            "not at rest after relax.max_steps = 100 ",
        ),
    ] {
        let folder = temporary.path().join(name);
        let more = [&["--set=sample.placement=random"], more].concat();
        let outcome = run(Path::new(SCENE), 1, &folder, &more);
        assert_eq!(outcome.code, 3, "{}", outcome.text);
        let remedy = "or sample.placement = \"lattice\"";
        for part in [expected, remedy] {
            assert!(outcome.text.contains(part), "{}", outcome.text);
        }
    }
}

/// Numbers that fail in a strain step, and in Newton's equations: exit code 3, and all rows and
/// frames before the failure are in the file.
#[test]
fn a_box_that_fails_keeps_what_led_to_it() {
    let temporary = tempfile::tempdir().expect("a folder");
    let at = |name: &str| temporary.path().join(name);
    let frames = "--set=aqs.frame_every=1";
    let far = [frames, "--set=aqs.strain_step=1.0", "--set=aqs.steps=9"];
    let failed = run(Path::new(SCENE), 1, &at("far"), &far);
    assert_eq!(failed.code, 3, "{}", failed.text);
    let strained = RunFile::open_any(&at("far/run.h5")).expect("a file");
    let rows = failed.text.matches("aqs:   step ").count();
    assert!(rows > 0, "{}", failed.text);
    let steps: Vec<u64> = (0..rows as u64).collect();
    assert_eq!(strained.series().step, steps);
    assert_eq!(strained.frame_steps(), steps);

    let short = [
        "--set=aqs.steps=1",
        "--stop-at=2",
        "--set=newtonian.rows=50",
    ];
    let stopped = run(Path::new(SCENE), 2, &at("stopped"), &short);
    assert_eq!(stopped.code, 75, "{}", stopped.text);
    for ranks in [1, 2] {
        let folder = at(&format!("wild-{ranks}"));
        let checkpoint = at("stopped/checkpoint.h5");
        let wild = [
            format!("--resume={}", checkpoint.display()),
            format!("--branch={}", folder.display()),
            "--set=time.force=true".into(),
            "--set=time.step=3.0".into(),
            "--set=newtonian.rows=1000".into(),
        ];
        let output = common::mpirun(ranks, PROGRAM).args(&wild).output();
        let output = output.expect("the program starts");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{said}");
        assert!(newtonian(&folder).series().step.len() > 1, "{said}");
    }
}

/// Starts a run, waits for a file in its folder and a while longer, asks it to stop, and returns
/// how it ends. Fails if it goes on.
fn asked_to_stop(ranks: usize, folder: &Path, more: &[&str], file: &str) -> Outcome {
    let said = tempfile::NamedTempFile::new().expect("a file");
    let stream = || said.reopen().expect("a file");
    let mut command = program(ranks);
    command.arg(SCENE).args(more).arg("--out").arg(folder);
    let mut child = command
        .stdout(stream())
        .spawn()
        .expect("the program starts");
    let begun = Instant::now();
    while !folder.join(file).exists() {
        assert!(
            begun.elapsed() < Duration::from_mins(1),
            "{more:?}: no {file}"
        );
        std::thread::sleep(Duration::from_millis(20));
    }
    std::thread::sleep(Duration::from_secs(1));
    // mpirun gives its ranks USR1, and little time after another signal.
    common::signal(child.id(), if ranks == 1 { "TERM" } else { "USR1" });
    let asked = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().expect("its state") {
            break status;
        }
        if asked.elapsed() > Duration::from_secs(30) {
            child.kill().expect("killed");
            panic!("{more:?}: goes on");
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    Outcome {
        code: status.code().unwrap_or(-1),
        text: std::fs::read_to_string(said.path()).expect("what it said"),
    }
}

/// A run that is asked to stop while its packing is prepared ends at once: where grains of a
/// lattice are compressed, where random ones move apart, where they come to rest, and where the box
/// takes on a pressure. None of these would end within hours.
#[test]
fn a_preparation_stops_when_it_is_asked_to() {
    let temporary = tempfile::tempdir().expect("a folder");
    let at = |name: &str| temporary.path().join(name);
    let many = "--set=sample.grains=50000";
    let to_rest = [
        "--set=relax.tolerance=1e-30",
        "--set=relax.max_steps=1000000000",
    ];
    let pressed = [
        "--set=aqs.pressure=1e-3",
        "--set=aqs.pressure_tolerance=1e-9",
        "--set=aqs.strain_step=1e-9",
    ];
    let stops = |name: &str, ranks: usize, more: &[&str], file: &str| {
        let outcome = asked_to_stop(ranks, &at(name), more, file);
        assert_eq!(outcome.code, 75, "{name}: {}", outcome.text);
        let why = "stopped while the packing was prepared, which leaves no checkpoint";
        assert!(outcome.text.contains(why), "{name}: {}", outcome.text);
        let status = std::fs::read_to_string(at(name).join("status.json")).expect("a status");
        assert!(status.contains("\"stopped\""), "{name}: {status}");
        assert!(!at(name).join("run.lock").exists(), "{name}");
        outcome
    };
    stops("compressed", 1, &[many], "status.json");
    stops("of two ranks", 2, &[many], "status.json");
    let apart = [many, "--set=sample.placement=random"];
    stops("apart", 1, &apart, "status.json");
    stops("to rest", 1, &to_rest, "status.json");
    // Where the box takes on its pressure, the run goes on from a checkpoint.
    let auto = [&pressed[..], &["--resume=auto"]].concat();
    for (ranks, more) in [(1, &pressed[..]), (2, &auto)] {
        let outcome = asked_to_stop(ranks, &at("pressed"), more, "run.h5");
        assert_eq!(outcome.code, 75, "{}", outcome.text);
        let why = "stopped in aqs at step 0; continue";
        assert!(outcome.text.contains(why), "{}", outcome.text);
        let checkpoint = at("pressed/checkpoint.h5");
        let [header, _] = gshear_store::checkpoint::read_texts(&checkpoint).expect("a header");
        assert!(header.contains("\"pressure\""), "{header}");
    }
    let small = ["--set=aqs.steps=1", "--set=newtonian.rows=10"];
    done(&run(Path::new(SCENE), 1, &at("compressed"), &small));
}

/// The strain steps and Newton's equations share a file: a kill in the latter loses nothing of the
/// former, a return to a strain step makes both anew, and the latter goes on where the file is
/// lost.
#[test]
fn both_parts_of_a_box_go_on() {
    let temporary = tempfile::tempdir().expect("a folder");
    let at = |name: &str| temporary.path().join(name);
    let long = ["--set=aqs.steps=3", "--set=newtonian.growth_times=10"];
    let go_on = |name: &str, ranks: usize, from: &str| {
        let from = format!("--resume={from}");
        done(&run(
            Path::new(SCENE),
            ranks,
            &at(name),
            &[&long[..], &[&from]].concat(),
        ));
    };
    let begin = |name: &str, more: &[&str]| {
        let outcome = run(Path::new(SCENE), 1, &at(name), &[&long[..], more].concat());
        assert_eq!(outcome.code, 75, "{}", outcome.text);
    };
    let equal = |name: &str, part: &str| {
        let [one, other] = [&at("whole"), &at(name)].map(|folder| folder.join(part));
        common::succeed(reducer().arg("compare").args([one, other]));
    };
    done(&run(Path::new(SCENE), 1, &at("whole"), &long));

    for ranks in [1, 2] {
        let name = format!("killed-{ranks}");
        let mut child = program(ranks)
            .args([&[SCENE], &long[..]].concat())
            .arg("--out")
            .arg(at(&name))
            .env("GSHEAR_TEST", at(&name))
            .stdout(std::process::Stdio::null())
            .spawn()
            .expect("the program starts");
        let begun = Instant::now();
        let moves = || {
            let status = std::fs::read_to_string(at(&name).join("status.json"));
            status.is_ok_and(|text| text.contains("\"stage\": \"newtonian\""))
        };
        while !moves() {
            assert!(begun.elapsed() < Duration::from_mins(1), "no equations");
            std::thread::sleep(Duration::from_millis(20));
        }
        std::thread::sleep(Duration::from_millis(500));
        child.kill().expect("killed");
        child.wait().expect("its end");
        // Ranks live on for a moment without mpirun.
        while !common::processes("GSHEAR_TEST", &at(&name)).is_empty() {
            assert!(begun.elapsed() < Duration::from_mins(2), "ranks live on");
            std::thread::sleep(Duration::from_millis(20));
        }
        go_on(&name, 3 - ranks, "auto");
        for part in ["run.h5", NEWTONIAN_PART] {
            equal(&name, part);
        }
        assert!(!at(&name).join("run.h5.journal").exists());
    }

    begin("returned", &["--stop-at=2"]);
    std::fs::copy(at("returned/checkpoint.h5"), at("second.h5")).expect("a copy");
    go_on("returned", 1, "auto");
    let second = format!("--resume={}", at("second.h5").display());
    let outcome = gshear_mpi(1, &at("returned"), &[second, "--stop-at=3".into()]);
    assert_eq!(outcome.code, 75, "{}", outcome.text);
    assert!(!gshear_store::part::exists(
        &at("returned").join(NEWTONIAN_PART)
    ));
    go_on("returned", 2, "auto");
    for part in ["run.h5", NEWTONIAN_PART] {
        equal("returned", part);
    }

    begin("lost", &["--stop-at=103"]);
    std::fs::remove_file(at("lost/run.h5")).expect("removed");
    go_on("lost", 1, "auto");
    let (alone, whole) = (newtonian(&at("lost")), newtonian(&at("whole")));
    assert_eq!(alone.digest(), whole.digest());
    let rows = alone.series().rows();
    assert!(rows > 10 && rows < whole.series().rows());
    let all = RunFile::open_any(&at("lost")).expect("a run");
    assert_eq!(all.series(), alone.series());
}
