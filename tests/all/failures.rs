//! Bad input and failing numbers, through the real program: one message, the right exit code,
//! nothing left behind.

use std::path::Path;
use std::process::Stdio;

use crate::bad_input::{BAD_INPUTS, each_bad_input};
use crate::common::{self, gshear_mpi, interrupted, program, reducer};
use gshear_store::run_reader::RunFile;

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing.toml");

/// The one line that a failing run says on its standard error, without `error: `.
fn message(text: &str) -> String {
    let said: Vec<&str> = text
        .lines()
        .filter_map(|l| l.strip_prefix("error: "))
        .collect();
    assert_eq!(said.len(), 1, "one message, not\n{text}");
    said[0].to_string()
}

fn refused(ranks: usize, out: &Path, arguments: &[String]) -> String {
    let outcome = gshear_mpi(ranks, out, arguments);
    assert_eq!(outcome.code, 2, "{}", outcome.text);
    assert!(!out.exists(), "something was written");
    message(&outcome.text)
}

#[test]
fn bad_scenes_are_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    // All of them are tested in bad_input.rs; here is to see that the program passes on what it is
    // told.
    each_bad_input(11, |path| refused(1, &out, &[path.display().to_string()]));
    let ranks = [SCENE, "-n", "2"].map(String::from);
    let outcome = gshear_mpi(1, &out, &ranks);
    assert_eq!(outcome.code, 2, "{}", outcome.text);
    let tip = "mpirun -n RANKS gshear-mpi CONFIG.toml";
    assert!(outcome.text.contains(tip), "{}", outcome.text);
    // On ranks it is said once.
    let path = format!("{BAD_INPUTS}/unknown_key.toml");
    assert!(refused(2, &out, &[path]).contains("unknown key"));
    let missing = folder.path().join("none.toml").display().to_string();
    assert!(
        refused(2, &out, std::slice::from_ref(&missing))
            .starts_with(&format!("{missing}: no such file"))
    );
}

#[test]
fn too_many_ranks_are_told_how_many_would_do() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    // The cell is 21 µm long, the greatest diameter 2 µm, the thinnest skin 0.015 µm: ten slabs,
    // but for a margin.
    let said = refused(12, &out, &[SCENE.into()]);
    assert!(
        said.contains("12 ranks are too many") && said.contains("1 to 10 ranks"),
        "{said}"
    );
    let said = refused(
        8,
        &out,
        &[SCENE.into(), "--set=bookkeeping.skin=1.0".into()],
    );
    assert!(
        said.contains("8 ranks are too many") && said.contains("1 to 5 ranks"),
        "{said}"
    );
    let most = gshear_mpi(
        5,
        &out,
        &[
            SCENE.into(),
            "--set=bookkeeping.skin=1.0".into(),
            "--check".into(),
        ],
    );
    assert_eq!(most.code, 0, "{}", most.text);
}

#[test]
fn damaged_checkpoints_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let good = folder.path().join("good");
    let stopped = gshear_mpi(1, &good, &[SCENE.into(), "--stop-at=10".into()]);
    assert_eq!(stopped.code, 75);
    let bytes = std::fs::read(good.join("checkpoint.h5")).expect("a checkpoint");
    let resume = |name: &str| format!("--resume={}", folder.path().join(name).display());

    let said = refused(1, &out, &[resume("none.h5")]);
    assert!(said.contains("none.h5"), "{said}");
    std::fs::write(folder.path().join("short.h5"), &bytes[..bytes.len() / 2]).expect("written");
    let said = refused(2, &out, &[resume("short.h5")]);
    assert!(said.contains("short.h5"), "{said}");
    let mut flipped = bytes.clone();
    let middle = bytes.len() / 2;
    flipped[middle] ^= 1;
    std::fs::write(folder.path().join("flipped.h5"), &flipped).expect("written");
    let said = refused(1, &out, &[resume("flipped.h5")]);
    assert!(said.contains("flipped.h5"), "{said}");
    std::fs::write(folder.path().join("text.h5"), "no HDF5").expect("written");
    let said = refused(1, &out, &[resume("text.h5")]);
    assert!(said.contains("text.h5"), "{said}");
}

/// A wall that begins at its full speed may move further in a step than the skin that a list begins
/// with allows: the skin is then thicker, and the numbers are those of any other skin.
#[test]
fn a_wall_may_begin_at_a_high_speed() {
    let folder = tempfile::tempdir().expect("a folder");
    // 0.011 mean diameters in a step; the skin begins at 0.02, of which half is allowed.
    let fast = |name: &str, more: &[&str]| {
        let set = [
            "shear.inertial_number=none",
            "shear.velocity=60",
            "shear.strain=0.002",
        ];
        let mut arguments = vec![SCENE.to_string()];
        arguments.extend(set.iter().chain(more).map(|set| format!("--set={set}")));
        gshear_mpi(1, &folder.path().join(name), &arguments).digest()
    };
    let adapted = fast("adapted", &[]);
    assert_eq!(adapted, fast("given", &["bookkeeping.skin=0.5"]));
}

/// Numbers that fail end every rank with exit code 3 and one message with step, ids and place.
#[test]
fn failing_numbers_end_the_run() {
    let folder = tempfile::tempdir().expect("a folder");
    for ranks in [1, 2] {
        // Near the least stiffness number that the configuration allows, force chains exceed the
        // law.
        let soft = [SCENE.into(), "--set=load.stiffness_number=30.0".into()];
        let out = folder.path().join(format!("soft-{ranks}"));
        let outcome = gshear_mpi(ranks, &out, &soft);
        assert_eq!(outcome.code, 3, "{}", outcome.text);
        let said = message(&outcome.text);
        for part in [
            "packing, step ",
            "grain",
            " at (",
            "outside the contact law",
        ] {
            assert!(said.contains(part), "{said}");
        }
    }
    // A time step twice the limit, forced, blows up while the sample is packed.
    let wild = [
        SCENE.into(),
        "--set=time.step=4e-9".into(),
        "--set=time.force=true".into(),
        "--set=pack.tolerance=1e-8".into(),
    ];
    let outcome = gshear_mpi(2, &folder.path().join("wild"), &wild);
    assert_eq!(outcome.code, 3, "{}", outcome.text);
    assert!(message(&outcome.text).contains("step "), "{}", outcome.text);
    // Not at rest in time.
    let hasty = [SCENE.into(), "--set=pack.max_steps=2000".into()];
    let outcome = gshear_mpi(1, &folder.path().join("hasty"), &hasty);
    assert_eq!(outcome.code, 3);
    assert!(
        message(&outcome.text).contains("pack.max_steps = 2000"),
        "{}",
        outcome.text
    );
}

/// Numbers that fail in the shear, on any ranks, from the start or resumed: exit code 3, and all
/// rows and frames before the failure are in the file, as in the log.
#[test]
fn a_failing_shear_keeps_what_led_to_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let set = [
        "shear.inertial_number=none",
        "shear.velocity=40",
        "output.series_strain=1e-3",
        "output.frame_strain=1e-2",
    ];
    let fresh: Vec<String> = std::iter::once(SCENE.to_string())
        .chain(set.map(|set| format!("--set={set}")))
        .collect();
    let stopped = gshear_mpi(
        2,
        &at("stopped"),
        &[&fresh[..], &["--stop-at=10".into()]].concat(),
    );
    assert_eq!(stopped.code, 75, "{}", stopped.text);
    let mut said = None;
    let single = "--set=bookkeeping.steps_at_once=1";
    // Steps that follow each other in bands: those after the failure have begun.
    let bands = "--set=bookkeeping.band_grains=20";
    for (name, ranks, resumes, set) in [
        ("one", 1, false, single),
        ("two", 2, false, single),
        ("of one", 1, true, single),
        ("of two", 2, true, single),
        ("of three", 3, true, single),
        ("bands", 1, false, bands),
        ("bands of one", 1, true, bands),
        ("bands of two", 2, true, bands),
        ("bands on threads", 1, true, bands),
    ] {
        let mut arguments = fresh.clone();
        if resumes {
            common::copy_folder(&at("stopped"), &at(name));
            arguments = vec![format!("--resume={}", at(name).display())];
        }
        arguments.push(set.into());
        if name == "bands on threads" {
            arguments.push("--threads=2".into());
        }
        let failed = gshear_mpi(ranks, &at(name), &arguments);
        assert_eq!(failed.code, 3, "{name}: {}", failed.text);
        let why = message(&failed.text);
        let step: u64 = why["shear, step ".len()..why.find(':').expect("a step")]
            .parse()
            .expect("a step");
        let (why, _) = why.split_once("; the last sound state").expect("a state");
        assert_eq!(*said.get_or_insert(why.to_string()), why);
        let run = RunFile::open(&at(name)).expect("a file");
        let log = std::fs::read_to_string(at(name).join("log.csv")).expect("a log");
        assert_eq!(run.series().step.len(), log.lines().count() - 1, "{name}");
        let interval = run.frame_steps()[1];
        for steps in [&run.series().step[..], run.frame_steps()] {
            let last = *steps.last().expect("some");
            assert!(last < step && last + interval >= step, "{name}: {steps:?}");
        }
        common::same_run(&at("one"), &at(name));
    }
}

/// The last good checkpoint stays when the numbers fail later, though the state of the failure is
/// written after it.
#[test]
fn a_failure_keeps_the_last_checkpoint() {
    let folder = tempfile::tempdir().expect("a folder");
    let stopped = interrupted(folder.path(), &[SCENE.into()]);
    assert_eq!(stopped.code, 75, "{}", stopped.text);
    let checkpoint = folder.path().join("checkpoint.h5");
    let before = std::fs::read(&checkpoint).expect("a checkpoint");
    let [header, _] = gshear_store::checkpoint::read_texts(&checkpoint).expect("a checkpoint");
    let (header, ..) =
        gshear_driver::header::Header::parse(&checkpoint, &header).expect("a header");
    let failing = [
        format!("--resume={}", checkpoint.display()),
        // Not at rest so soon.
        format!("--set=pack.max_steps={}", header.step() + 1),
    ];
    let outcome = gshear_mpi(1, folder.path(), &failing);
    assert_eq!(outcome.code, 3, "{}", outcome.text);
    let previous = folder.path().join("checkpoint.previous.h5");
    assert_eq!(std::fs::read(&previous).expect("a checkpoint"), before);
}

/// A scene of a box that is compressed to rest with overdamped dynamics.
const BOX: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");

/// The checkpoint that the message of a failure names, and its stage and step.
fn left(out: &Path, text: &str) -> (std::path::PathBuf, String, u64) {
    let said = message(text);
    let path = out.join("checkpoint.h5");
    let [header, _] = gshear_store::checkpoint::read_texts(&path).expect("a checkpoint");
    let (header, ..) = gshear_driver::header::Header::parse(&path, &header).expect("a header");
    let (stage, step) = (header.stage(), header.step());
    let named = format!(
        "the last sound state, {stage} step {step}, is in {}",
        path.display()
    );
    assert!(said.contains(&named), "{said}");
    (path, stage.into(), step)
}

/// A stage that runs out of steps leaves the state that it has: with more steps it comes to the end
/// of a run that had them at once.
#[test]
fn a_run_that_runs_out_of_steps_goes_on_with_more() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let short = [SCENE.into(), "--set=shear.strain=0.002".into()];
    let whole = gshear_mpi(1, &at("whole"), &short).digest();
    for ranks in [1, 2] {
        let out = at(&format!("hasty-{ranks}"));
        let hasty = [&short[..], &["--set=pack.max_steps=2000".into()]].concat();
        let failed = gshear_mpi(ranks, &out, &hasty);
        assert_eq!(failed.code, 3, "{}", failed.text);
        let (path, stage, step) = left(&out, &failed.text);
        assert_eq!((&*stage, step), ("pack", 2000));
        let on = [
            format!("--resume={}", path.display()),
            "--set=pack.max_steps=1000000".into(),
        ];
        assert_eq!(gshear_mpi(ranks, &out, &on).digest(), whole);
    }
    let relaxed = [BOX, "--set=relax.method=overdamped", "--set=aqs.steps=2"].map(String::from);
    let digest = |text: &str| {
        let mut lines = text.lines().filter(|line| line.contains("digest"));
        lines.next().map(ToString::to_string).expect("a digest")
    };
    let whole = gshear_mpi(1, &at("box"), &relaxed);
    assert_eq!(whole.code, 0, "{}", whole.text);
    let out = at("hasty box");
    let begun = [&relaxed[..], &["--stop-at=1".into()]].concat();
    assert_eq!(gshear_mpi(1, &out, &begun).code, 75);
    let hasty = [
        format!("--resume={}", out.display()),
        "--set=relax.max_steps=150".into(),
    ];
    let failed = gshear_mpi(2, &out, &hasty);
    assert_eq!(failed.code, 3, "{}", failed.text);
    let (path, stage, _) = left(&out, &failed.text);
    assert_eq!(stage, "aqs");
    let on = [
        format!("--resume={}", path.display()),
        "--set=relax.max_steps=1000000".into(),
    ];
    let on = gshear_mpi(1, &out, &on);
    assert_eq!(on.code, 0, "{}", on.text);
    assert_eq!(digest(&on.text), digest(&whole.text));
}

/// Numbers that fail in any stage leave a checkpoint of the last sound state, from which a branch
/// goes on.
#[test]
fn every_stage_that_fails_leaves_its_last_sound_state() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let fails = |name: &str, ranks: usize, arguments: &[&str]| {
        let out = at(name);
        let arguments: Vec<String> = arguments.iter().map(ToString::to_string).collect();
        let failed = gshear_mpi(ranks, &out, &arguments);
        assert_eq!(failed.code, 3, "{name}: {}", failed.text);
        left(&out, &failed.text)
    };
    let goes_on = |name: &str, path: &Path, more: &[&str]| {
        let out = at(&format!("{name} on"));
        let mut command = program(1);
        command.arg("--resume").arg(path).arg("--branch").arg(&out);
        let output = command.args(more).output().expect("the program starts");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            matches!(output.status.code(), Some(0 | 75)),
            "{name}: {said}"
        );
    };
    for ranks in [1, 2] {
        let soft = [SCENE, "--set=load.stiffness_number=30.0"];
        let (path, stage, step) = fails(&format!("soft {ranks}"), ranks, &soft);
        assert_eq!((&*stage, step), ("pack", 0));
        let stiffer = ["--set=load.stiffness_number=1e3", "--stop-at=3"];
        goes_on(&format!("soft {ranks}"), &path, &stiffer);
        let name = format!("fast {ranks}");
        let fast = [
            SCENE,
            "--set=shear.inertial_number=none",
            "--set=shear.velocity=40",
        ];
        let (path, stage, step) = fails(&name, ranks, &fast);
        assert_eq!((&*stage, step), ("shear", 0));
        goes_on(&name, &path, &["--set=shear.velocity=1", "--stop-at=3"]);
    }
    // Strain steps and Newton's equations, from a stop in each.
    for (name, stop, end, set) in [
        ("aqs", 3, 3, ["aqs.strain_step=1.0", "aqs.steps=8"]),
        ("newtonian", 30, 0, ["time.step=6.0", "time.force=true"]),
    ] {
        let stop = format!("--stop-at={stop}");
        let stopped = gshear_mpi(1, &at(name), &[BOX.into(), stop]);
        assert_eq!(stopped.code, 75, "{}", stopped.text);
        for ranks in [1, 2] {
            let out = at(&format!("{name} {ranks}"));
            let mut command = program(ranks);
            command
                .arg("--resume")
                .arg(at(name))
                .arg("--branch")
                .arg(&out);
            for set in set {
                command.args(["--set", set]);
            }
            let output = command.output().expect("the program starts");
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(3), "{said}");
            let (path, stage, step) = left(&out, &said);
            assert_eq!(stage, name);
            assert!(step >= end, "{step}");
            let sets: &[&str] = match name {
                "aqs" => &["--set=aqs.strain_step=2e-3", "--stop-at=4"],
                _ => &[
                    "--set=time.step=0.1",
                    "--set=time.force=false",
                    "--stop-at=100",
                ],
            };
            goes_on(&format!("{name} {ranks}"), &path, sets);
        }
    }
}

/// For the foreseeable case, instead of an abort on every rank.
#[test]
fn grains_that_do_not_fit_into_memory_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    for ranks in [1, 2] {
        for check in [&[][..], &["--check".to_string()]] {
            let many = [
                SCENE.into(),
                "--set=sample.grains=4294967295".into(),
                "--set=sample.length=1".into(),
            ];
            let said = refused(ranks, &folder.path().join("out"), &[&many, check].concat());
            assert!(
                said.starts_with("--set sample.grains=4294967295: 4294967295 grains are more than")
                    && said.contains("that fit into the memory of this machine")
                    && said.ends_with("give fewer"),
                "{said}"
            );
        }
    }
}

/// What a program's standard output and standard error go to.
fn streams(to: &str) -> [Stdio; 2] {
    [(); 2].map(|()| match to {
        // A pipe whose reader has gone.
        "closed" => {
            let (reader, writer) = std::io::pipe().expect("a pipe");
            drop(reader);
            writer.into()
        }
        path => std::fs::File::create(path).expect("a device").into(),
    })
}

/// A run goes on to the same end if its output cannot be written.
#[test]
fn output_that_cannot_be_written_does_not_end_a_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let sweep = folder.path().join("sweep.toml");
    let text = format!("extends = '{SCENE}'\n[sweep]\nseed = [1, 2]\n");
    std::fs::write(&sweep, text).expect("a scene");
    let run = |name: &str, streams: [Stdio; 2], more: &[&str]| {
        let [out, err] = streams;
        let scene = match name {
            "sweep" => sweep.as_path(),
            _ => Path::new(SCENE),
        };
        let status = program(1)
            .arg(scene)
            .arg("--set=shear.strain=0.01")
            .args(more)
            .arg("--out")
            .arg(folder.path().join(name))
            .stdout(out)
            .stderr(err)
            .status();
        status.expect("the program starts").code()
    };
    assert_eq!(run("read", streams("/dev/null"), &[]), Some(0));
    for to in ["closed", "/dev/full"] {
        let again = ["--overwrite"];
        assert_eq!(run("lost", streams(to), &again), Some(0), "{to}");
        common::same_run(&folder.path().join("read"), &folder.path().join("lost"));
        // Messages of a resume: a finished run, and a lock that is taken over.
        let auto = ["--resume=auto"];
        assert_eq!(run("lost", streams(to), &auto), Some(0), "{to}");
        let lock = r#"{"host":"gone","pid":1,"ticks":null,"started":"then"}"#;
        let path = folder.path().join("lost/run.lock");
        std::fs::write(path, lock).expect("a lock");
        let taken = ["--overwrite", "--break-lock"];
        assert_eq!(run("lost", streams(to), &taken), Some(0), "{to}");
        // Other exit codes, too.
        assert_eq!(
            run("stop", streams(to), &["--stop-at=10", "--overwrite"]),
            Some(75),
            "{to}"
        );
        assert_eq!(run("bad", streams(to), &["--set=seed=-1"]), Some(2), "{to}");
        // What these print is their result; the reader of a pipe may have seen enough of it.
        let printed = i32::from(to != "closed");
        for (name, what) in [("none", "--check"), ("sweep", "--sweep=list")] {
            assert_eq!(run(name, streams(to), &[what]), Some(printed), "{to}");
        }
        assert_eq!(run("help", streams(to), &["--help"]), Some(0), "{to}");
    }
}

/// `gshear-reduce info | head -1` is no failure; a full disk is one.
#[test]
fn a_closed_pipe_is_no_failure_of_the_reducer() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = gshear_mpi(
        1,
        folder.path(),
        &[SCENE.into(), "--set=shear.strain=0.01".into()],
    );
    assert_eq!(run.code, 0, "{}", run.text);
    let reduce = |arguments: &[&str], to: &str| {
        let [out, _] = streams(to);
        let output = reducer()
            .args(arguments)
            .arg(folder.path().join("run.h5"))
            .stdout(out)
            .stderr(Stdio::piped())
            .output()
            .expect("the program starts");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.code(), said)
    };
    assert_eq!(reduce(&["info"], "closed"), (Some(0), String::new()));
    // Its page is there all the same.
    assert_eq!(reduce(&["report"], "closed"), (Some(0), String::new()));
    assert!(folder.path().join("report/index.html").exists());
    let (code, said) = reduce(&["info"], "/dev/full");
    assert_eq!(code, Some(1), "{said}");
    assert!(said.starts_with("error: standard output: "), "{said}");
}

/// Disks that would leave the law if their box shrank at full speed.
const DENSE: &str = "
    seed = 2
    dimension = 2
    material = { density = 1.0, young_modulus = 6.0, poisson_ratio = 0.0 }
    contact = { law = 'lee-hurley', damping_ratio = 0.1, friction = 0.3 }
    sample = { grains = 60, sizes = 'binary', radius_min = 0.5, radius_max = 0.7, large_fraction = 0.5, boundary = 'periodic', solid_fraction = 0.9 }
    relax = { tolerance = 1e-9, drag = 0.1 }
    aqs = { strain_step = 2e-3, steps = 0 }
";

#[test]
fn a_box_is_compressed_more_slowly_before_its_preparation_fails() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("dense.toml");
    std::fs::write(&path, DENSE).expect("a scene");
    let path = path.display().to_string();
    let digest = |ranks: usize| {
        let out = folder.path().join(format!("out-{ranks}"));
        let done = gshear_mpi(ranks, &out, std::slice::from_ref(&path));
        assert_eq!(done.code, 0, "{}", done.text);
        let (_, digest) = done.text.split_once("digest ").expect("a digest");
        digest[..32].to_string()
    };
    assert_eq!(digest(1), digest(2));
    // No packing of these disks is as dense within the law.
    let denser = [path.clone(), "--set=sample.solid_fraction=1.1".into()];
    let failed = gshear_mpi(1, &folder.path().join("denser"), &denser);
    assert_eq!(failed.code, 3, "{}", failed.text);
    let said = message(&failed.text);
    for part in [
        "preparing the packing in a box ",
        "solid fraction 0.9",
        "outside the contact law, after 6 halvings of the compression step; give a lower sample.solid_fraction, or another seed",
    ] {
        assert!(said.contains(part), "{said}");
    }
    // The last box is left; no run goes on from it, but one may take its grains.
    let out = folder.path().join("denser");
    let (left, stage, _) = left(&out, &failed.text);
    assert_eq!(stage, "prepare");
    let resumed = gshear_mpi(1, &out, &[format!("--resume={}", left.display())]);
    assert_eq!(resumed.code, 2, "{}", resumed.text);
    assert!(message(&resumed.text).contains("take the grains as sample.packing"));
    let again = [&denser[..], &["--resume=auto".into()]].concat();
    let again = gshear_mpi(2, &out, &again);
    assert_eq!(again.code, 3, "{}", again.text);
    assert_eq!(message(&again.text), said);
    let taken = [
        path,
        format!("--set=sample.packing={:?}", left.display()),
        "--set=sample.solid_fraction=none".into(),
    ];
    let mut taken = taken.to_vec();
    for key in [
        "grains",
        "sizes",
        "radius_min",
        "radius_max",
        "large_fraction",
    ] {
        taken.push(format!("--set=sample.{key}=none"));
    }
    let taken = gshear_mpi(1, &folder.path().join("taken"), &taken);
    assert_eq!(taken.code, 0, "{}", taken.text);
}

/// Linear springs have no bound but geometry: denser boxes than any within 0.19 R, strained, are
/// the same on any ranks.
#[test]
fn linear_springs_take_great_overlaps() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("soft.toml");
    let soft = DENSE
        .replace(", young_modulus = 6.0, poisson_ratio = 0.0", "")
        .replace("'lee-hurley'", "'hooke', normal_stiffness = 1.0");
    std::fs::write(&path, soft).expect("a scene");
    let digest = |ranks: usize| {
        let soft = [
            path.display().to_string(),
            "--set=sample.solid_fraction=1.15".into(),
            "--set=aqs.steps=3".into(),
            "--set=aqs.strain_step=0.02".into(),
        ];
        let done = gshear_mpi(ranks, &folder.path().join(format!("{ranks}")), &soft);
        assert_eq!(done.code, 0, "{}", done.text);
        let (_, digest) = done.text.split_once("digest ").expect("a digest");
        digest[..32].to_string()
    };
    assert_eq!(digest(1), digest(2));
}

/// A strain step that leads out of the law says which grains do, and what to give; of every kind of
/// deformation.
#[test]
fn a_strain_step_out_of_the_law_names_its_grains() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("box.toml");
    std::fs::write(&path, DENSE).expect("a scene");
    let sets = [
        [
            "aqs.strain_step=0.1",
            "aqs.deformation=simple-shear",
            "aqs.steps=20",
        ],
        [
            "aqs.strain_step=0.2",
            "aqs.deformation=pure-shear",
            "aqs.steps=3",
        ],
    ];
    for set in sets {
        for ranks in [1, 2] {
            let mut arguments = vec![path.display().to_string(), "--overwrite".into()];
            arguments.extend(set.iter().map(|set| format!("--set={set}")));
            let failed = gshear_mpi(ranks, &folder.path().join("out"), &arguments);
            assert_eq!(failed.code, 3, "{}", failed.text);
            let said = message(&failed.text);
            assert!(
                said.starts_with("aqs, strain step ")
                    && said.contains(": grains ")
                    && said.contains("; give a smaller aqs.strain_step, or less strain; "),
                "{said}"
            );
        }
    }
}

/// A batch system may limit the size of files.
#[test]
fn a_limit_of_the_size_of_files_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let command = format!(
        "ulimit -f 3000; exec \"$0\" {} --set=output.frame_strain=1e-4 --out {}",
        concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing.toml"),
        out.display()
    );
    let mut shell = common::start("sh");
    // MPI by itself would put more than that into shared memory.
    shell.env("OMPI_MCA_ess_singleton_isolated", "1");
    let ended = shell.args(["-c", &command, common::PROGRAM]).output();
    let ended = ended.expect("a shell");
    let said = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(1), "{said}");
    assert!(
        said.contains("error: ") && said.contains("File too large"),
        "{said}"
    );
}

/// A name that no file system takes is bad input, as other names that cannot be are.
#[test]
fn a_name_that_cannot_be_is_bad_input() {
    let folder = tempfile::tempdir().expect("a folder");
    let walls = common::kept_files("walls", folder.path());
    let (long, file) = ("a".repeat(256), folder.path().join("file"));
    std::fs::write(&file, "").expect("written");
    for out in [folder.path().join(&long), file.join("below")] {
        refused(1, &out, &[SCENE.into()]);
        refused(1, &out.join("run"), &[SCENE.into()]);
        refused(1, &out, &[format!("--resume={}", out.display())]);
        for words in [&["dmin"][..], &["export", "--format=npz"], &["report"]] {
            let mut command = reducer();
            command.args(words).arg(&walls).arg("--out").arg(&out);
            let output = command.output().expect("the program starts");
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(2), "{words:?}: {said}");
            assert!(said.contains(&*out.to_string_lossy()), "{said}");
        }
        let mut command = reducer();
        let output = command.arg("info").arg(&out).output();
        assert_eq!(output.expect("the program starts").status.code(), Some(2));
    }
}

/// The limits of a job and of a process bound the grains, as the memory of the machine does; more
/// memory than they allow would end the program by a signal.
#[test]
fn limits_of_memory_are_known() {
    let folder = tempfile::tempdir().expect("a folder");
    // 4 GB of addresses, at least 400 bytes for each of 20 million grains.
    let limited = "ulimit -v 4000000 && exec \"$0\" \"$@\"";
    let mut command = common::start("sh");
    command.args(["-c", limited, common::PROGRAM, SCENE, "--check"]);
    let sets = ["--set=sample.grains=20000000", "--set=sample.length=1"];
    let output = command.args(sets).current_dir(folder.path()).output();
    let output = output.expect("the program starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("fit into the memory of this machine (4.1 GB"),
        "{said}"
    );
}
