//! `--check`: what it says that a run takes is what the run takes. Of times only that of strain
//! steps is compared, roughly.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};

use crate::common::crossing::SCENE;
use crate::common::{self, gshear_mpi, program};
use gshear_scene::{Source, load, unlikely};
use gshear_store::run_reader::RunFile;
use gshear_store::status::Status;

/// Sizes of files, and memory, are right within these factors.
const FILES: f64 = 1.4;
const MEMORY: f64 = 1.6;

const OF_A_BOX: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");

fn check_on(ranks: usize, arguments: &[&str]) -> Output {
    let mut command = program(ranks);
    let command = command.args(arguments).arg("--check");
    command.output().expect("the program starts")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// What a check says on standard error, which is no error.
fn said(arguments: &[&str]) -> String {
    let output = check_on(1, arguments);
    let said = text(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {said}");
    said
}

/// The lines by their first words; those without are further files.
fn lines(said: &str) -> BTreeMap<String, String> {
    let lines = said
        .lines()
        .filter(|line| line.len() > 12 && line.is_char_boundary(12));
    let lines = lines
        .map(|line| line.split_at(12))
        .map(|(name, content)| match name.trim() {
            "" => content.split_once(' ').expect("a file"),
            name => (name, content),
        });
    lines
        .map(|(name, content)| (name.into(), content.into()))
        .collect()
}

/// `1.5 MB` at the start of a text, as bytes.
fn bytes(text: &str) -> f64 {
    let mut words = text.trim_start_matches("about ").split(' ');
    let number: f64 = words.next().expect("a number").parse().expect("a number");
    let unit = words.next().expect("a unit").trim_end_matches(',');
    number
        * match unit {
            "GB" => 1e9,
            "MB" => 1e6,
            "KB" => 1e3,
            unit => panic!("{unit}"),
        }
}

fn within(factor: f64, said: f64, found: f64, what: &str) {
    let ratio = said / found;
    let range = 1.0 / factor..factor;
    assert!(
        range.contains(&ratio),
        "{what}: said {said:.4e}, found {found:.4e}"
    );
}

fn size(path: &Path) -> f64 {
    std::fs::metadata(path).expect("a file").len() as f64
}

/// Steps, frames, rows and sizes of a run between walls that ends or is told to stop.
fn agrees(folder: &Path, arguments: &[&str]) {
    let lines = lines(&said(arguments));
    let owned: Vec<String> = arguments.iter().map(ToString::to_string).collect();
    let run = gshear_mpi(1, folder, &owned);
    let stops = arguments.iter().any(|word| word.starts_with("--stop-at"));
    assert_eq!(run.code, if stops { 75 } else { 0 }, "{}", run.text);
    let status = Status::read(folder).expect("a status");
    let steps = &lines["steps"];
    assert!(
        steps.ends_with(&format!("shear {}", status.progress.step)),
        "{steps}: {}",
        status.progress.step
    );
    let file = RunFile::open(folder).expect("a run");
    let content = format!(
        "({} frames, {} rows)",
        file.frames(),
        file.series().step.len()
    );
    assert!(
        lines["run.h5"].ends_with(&content),
        "{}: {content}",
        lines["run.h5"]
    );
    drop(file);
    let mut files = ["run.h5", "log.csv"]
        .map(|name| (name, size(&folder.join(name))))
        .to_vec();
    let checkpoints = ["checkpoint.h5", "checkpoint.previous.h5"];
    let checkpoints = checkpoints.map(|name| folder.join(name)).into_iter();
    let checkpoints = checkpoints.filter(|path| path.exists());
    files.push(("checkpoints", checkpoints.map(|path| size(&path)).sum()));
    for (name, found) in &files {
        within(FILES, bytes(&lines[*name]), *found, name);
    }
    let all = files.iter().map(|(_, bytes)| bytes).sum();
    within(FILES, bytes(&lines["disk"]), all, "all files");
}

#[test]
fn steps_and_files_are_those_of_the_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let strain = ["--set=shear.strain=0.1", "--set=output.frame_strain=1e-3"];
    agrees(&at("disks"), &[&[SCENE][..], &strain].concat());
    let stop = ["--stop-at=300"];
    agrees(&at("stopped"), &[&[SCENE][..], &strain, &stop].concat());
    // Three parts of a protocol, through a spring.
    let spheres = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing-3d.toml");
    agrees(&at("spheres"), &[spheres]);
}

/// The height between thick walls, from which a velocity and a strain have their steps.
#[test]
fn steps_are_guessed_from_the_height_between_the_walls() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = [
        SCENE,
        "--set=shear.inertial_number=none",
        "--set=shear.velocity=0.5",
        "--set=sample.wall_thickness=4",
        "--set=sample.grains=400",
    ];
    let words = [&scene[..], &["--stop-at=1"]].concat();
    let words: Vec<String> = words.into_iter().map(Into::into).collect();
    let run = gshear_mpi(1, folder.path(), &words);
    assert_eq!(run.code, 75, "{}", run.text);
    let steps = Status::read(folder.path())
        .expect("a status")
        .progress
        .steps;
    let lines = lines(&said(&scene));
    let (_, guess) = lines["steps"].split_once("shear about ").expect("a guess");
    let guess: f64 = guess.split(' ').next().unwrap().parse().expect("a number");
    within(1.1, guess, steps.expect("steps") as f64, "steps");
}

/// The strain steps of a box, which end before Newton's equations begin.
#[test]
fn strain_steps_are_those_of_the_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");
    let words = [scene, "--set=aqs.steps=5", "--stop-at=3"];
    let lines = lines(&said(&words));
    assert!(lines["steps"].ends_with(", aqs 3"), "{}", lines["steps"]);
    assert!(!lines.contains_key("run.h5/newtonian"));
    let run = gshear_mpi(1, folder.path(), &words.map(String::from));
    assert_eq!(run.code, 75, "{}", run.text);
    let path = folder.path().join("run.h5");
    let file = RunFile::open_any(&path).expect("a run");
    let content = format!(
        "({} frames, {} rows)",
        file.frames(),
        file.series().step.len()
    );
    assert!(
        lines["run.h5"].ends_with(&content),
        "{}: {content}",
        lines["run.h5"]
    );
    drop(file);
    within(FILES, bytes(&lines["run.h5"]), size(&path), "run.h5");
}

/// A time such as `1h 3m` at the end of a text (s).
fn seconds(text: &str) -> f64 {
    let of = |word: &str| {
        let (number, unit) = word.split_at(word.len() - 1);
        let unit = match unit {
            "d" => 86_400.0,
            "h" => 3600.0,
            "m" => 60.0,
            "s" => 1.0,
            unit => panic!("{unit} in {text}"),
        };
        unit * number.parse::<f64>().expect("a number")
    };
    text.split_whitespace().map(of).sum()
}

/// A time is said for strain steps, without eigenvalues and with them, of spheres and of disks. How
/// far it is from that which they take is in docs/howto/running.md: a busy machine decides no test.
#[test]
fn a_time_is_said_for_strain_steps() {
    let disks = [
        "--set=dimension=2",
        "--set=sample.solid_fraction=0.9",
        "--set=sample.grains=600",
    ];
    for more in [&[][..], &["--set=aqs.spectrum=true"], &disks] {
        let words = [&[OF_A_BOX, "--set=aqs.steps=100000"][..], more].concat();
        let lines = lines(&said(&words));
        let time = &lines["time"];
        let (_, said) = time.split_once("aqs very roughly ").expect(time);
        let said = seconds(said.split(',').next().expect("a time"));
        assert!(said > 0.0 && said.is_finite(), "{time}");
    }
    let overdamped = said(&[OF_A_BOX, "--set=relax.method=overdamped"]);
    assert!(
        lines(&overdamped)["time"].contains("aqs unknown"),
        "{overdamped}"
    );
}

/// The search for a pressure takes the time of its relaxations: a million where it goes by 1e-7 of
/// the length from a loose packing, each of a tenth of a millisecond and more.
#[test]
fn a_time_is_said_for_the_search_for_a_pressure() {
    let words = [
        OF_A_BOX,
        "--set=aqs.steps=0",
        "--set=sample.solid_fraction=0.5",
        "--set=aqs.pressure=1e-4",
    ];
    let time = |more: &[&str]| lines(&said(&[&words[..], more].concat()))["time"].clone();
    let fine = time(&["--set=aqs.pressure_step=1e-7"]);
    let (_, said) = fine.split_once("aqs very roughly ").expect(&fine);
    assert!(
        seconds(said.split(',').next().expect("a time")) > 60.0,
        "{fine}"
    );
    // By default it is the strain step.
    let by_strain = time(&["--set=aqs.strain_step=1e-7"]);
    assert!(by_strain.contains("aqs very roughly "), "{by_strain}");
}

/// Greatest resident size of a run (bytes) that is asked to stop after a while.
fn resident(out: &Path, arguments: &[&str]) -> f64 {
    let mut child = program(1)
        .args(arguments)
        .arg("--out")
        .arg(out)
        .stdout(Stdio::null())
        .spawn()
        .expect("the program starts");
    let status = format!("/proc/{}/status", child.id());
    let (mut most, mut asked) = (0.0, false);
    while child.try_wait().expect("its state").is_none() {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let peak = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let peak = peak.and_then(|peak| peak.trim().trim_end_matches(" kB").parse::<f64>().ok());
        most = peak.map_or(most, |peak| 1024.0 * peak);
        if !asked && Status::read(out).is_some_and(|status| status.progress.step > 50) {
            common::signal(child.id(), "USR1");
            asked = true;
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    most
}

#[test]
fn memory_is_that_of_the_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let many = ["--set=sample.grains=40000", "--set=sample.length=1900e-6"];
    let boxed = [
        OF_A_BOX,
        "--set=aqs.steps=1",
        "--set=newtonian.growth_times=0.01",
    ];
    let more = ["--set=sample.grains=500"];
    let eigenvalues = ["--set=sample.grains=250", "--set=newtonian.spectra=1"];
    for (name, arguments) in [
        ("few", vec![SCENE, "--set=shear.strain=0.02"]),
        ("factors", [&boxed[..], &more].concat()),
        ("eigenvalues", [&boxed[..], &eigenvalues].concat()),
        (
            "many",
            [&[SCENE][..], &many, &["--set=output.frame_strain=0"]].concat(),
        ),
    ] {
        let lines = lines(&said(&arguments));
        let said = bytes(&lines["memory"]);
        // Who looks now and then may miss a peak just before the end.
        let mut found = 0.0_f64;
        for look in 0..4 {
            if said > MEMORY * found {
                let out = folder.path().join(format!("{name}-{look}"));
                found = found.max(resident(&out, &arguments));
            }
        }
        within(MEMORY, said, found, name);
    }
}

/// Standard output is a scene for another program, whatever else is said.
#[test]
fn the_scene_stands_alone_on_standard_output() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let place = format!("--out={}", out.display());
    for ranks in [1, 2] {
        let output = check_on(ranks, &[SCENE, &place]);
        let said = text(&output.stderr);
        assert!(output.status.success(), "{said}");
        let scene: toml::Table = text(&output.stdout).parse().expect("TOML");
        assert!(scene.contains_key("sample"));
        let name = format!(" of {ranks} rank");
        assert!(
            said.contains(&name) && !said.contains("warning: "),
            "{said}"
        );
        for name in ["steps", "work", "time", "memory", "disk"] {
            assert!(lines(&said).contains_key(name), "no {name} in {said}");
        }
        assert!(said.contains("can be written, holds no run"), "{said}");
        let quiet = check_on(ranks, &[SCENE, "--quiet", &place]);
        assert_eq!((&*quiet.stderr, &quiet.stdout), (&[][..], &output.stdout));
    }
    assert!(!out.exists(), "a check writes nothing");
}

/// The scenes that come with the program raise no doubt, and all kinds can be estimated.
#[test]
fn no_scene_of_ours_is_doubted() {
    let configs = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/configs"));
    let paths = configs
        .expect("a folder")
        .map(|entry| entry.expect("a file").path());
    let mut paths: Vec<PathBuf> = paths.collect();
    paths.sort();
    let mut checked = 0;
    for path in paths {
        let source = Source::read(&path).expect("a scene");
        let scene = match load(&source, &[]) {
            Ok(scene) => scene,
            // Some are sweeps, or begin with a packing that is not there.
            Err(why) => {
                let why = why.to_string();
                let is_meant = why.contains("sweep: makes ") || why.contains("no such file");
                assert!(is_meant, "{why}");
                continue;
            }
        };
        let sample = &scene.sample;
        let volume = f64::from(sample.grains) * sample.mean_volume;
        let height = volume
            / sample.base()
            / if scene.dimension.axes() == 2 {
                0.84
            } else {
                0.6
            };
        // mu(I) is measured far into the flow on purpose.
        let is_meant = |doubt: &String| {
            path.display().to_string().contains("mu-of-i") && doubt.contains("inertial number")
        };
        let mut doubts = unlikely::unlikely(&scene, height);
        doubts.retain(|doubt| !is_meant(doubt));
        assert_eq!(doubts, Vec::<String>::new(), "{}", path.display());
        checked += 1;
    }
    assert!(checked > 35, "{checked}");
    // The program says the same of one of each kind.
    for name in [
        "plane-shear-2d",
        "bonfanti",
        "chute-2d",
        "sheared-modulus-2d",
    ] {
        let path = format!("{}/configs/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        let output = check_on(1, &[&path]);
        let said = text(&output.stderr);
        assert!(output.status.success(), "{path}: {said}");
        assert!(
            said.contains("steps ") && !said.contains("warning: "),
            "{path}: {said}"
        );
    }
}

/// The scenes that the pages print, the first of them as `my.toml`, pass their check.
#[test]
fn the_scenes_of_the_docs_pass() {
    let folder = tempfile::tempdir().expect("a folder");
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    let (scene, base) = (
        folder.path().join("other.toml"),
        folder.path().join("my.toml"),
    );
    let mut checked = 0;
    for page in [
        "howto/scene.md",
        "howto/protocols.md",
        "tutorial/own-scene.md",
    ] {
        let page = std::fs::read_to_string(docs.join(page)).expect("a page");
        for block in page.split("```toml\n").skip(1) {
            let block = block.split("```").next().unwrap_or_default();
            let path = if base.exists() { &scene } else { &base };
            std::fs::write(path, block).expect("a scene");
            let mut command = program(1);
            command.arg(path);
            let is_sweep = block.contains("[sweep]");
            command.args(if is_sweep {
                &["--sweep", "list"][..]
            } else {
                &["--check"]
            });
            let output = command.output().expect("the program starts");
            assert!(output.status.success(), "{block}{}", text(&output.stderr));
            checked += 1;
        }
    }
    assert!(checked >= 9, "{checked}");
}

#[test]
fn what_is_unlikely_is_doubted() {
    let folder = tempfile::tempdir().expect("a folder");
    let warnings = |arguments: &[&str]| {
        let said = said(&[&[SCENE][..], arguments].concat());
        let warnings = said
            .lines()
            .filter_map(|line| line.strip_prefix("warning: "));
        warnings.map(String::from).collect::<Vec<_>>()
    };
    for (set, words) in [
        ("material.density=2.5", "material.density is 2.5 kg/m³"),
        (
            "material.young_modulus=1.0",
            "material.young_modulus is 1 Pa",
        ),
        ("contact.friction=30", "contact.friction is 30"),
        ("shear.inertial_number=0.5", "the inertial number is 0.5"),
        ("shear.spring_number=1e6", "at 3 it is unstable"),
        (
            "load.stiffness_number=25",
            "presses grains together by about 4.00 %",
        ),
    ] {
        let found = warnings(&["--set", set]);
        assert!(
            found.len() == 1 && found[0].contains(words),
            "{set}: {found:?}"
        );
    }
    let refused = check_on(1, &[SCENE, "--set", "shear.spring_number=1.7e308"]);
    assert_eq!(refused.status.code(), Some(2));
    let said = text(&refused.stderr);
    assert!(
        said.contains("shear.spring_number=1.7e308: must lie between 1e-30 and 1e30"),
        "{said}"
    );
    // Seven slabs are three grains wide.
    let many = check_on(7, &[SCENE]);
    let said = text(&many.stderr);
    let wanted = "7 ranks are more than make sense: slabs are so narrow";
    assert!(
        said.contains(wanted) && said.contains("run it on "),
        "{said}"
    );
    let refused = check_on(12, &[SCENE]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("12 ranks are too many"));

    // The folder: of this run, of another one, of none.
    let out = folder.path().join("out");
    let place = format!("--out={}", out.display());
    let short = "--set=shear.strain=0.02";
    let run = gshear_mpi(1, &out, &[SCENE.into(), short.into()]);
    assert_eq!(run.code, 0, "{}", run.text);
    let found = warnings(&[short, &place]);
    assert!(
        found[0].contains("holds this run, which is finished"),
        "{found:?}"
    );
    let found = warnings(&["--set=seed=9", &place]);
    assert!(found[0].contains("holds another run"), "{found:?}");
    std::fs::write(folder.path().join("file"), "").expect("written");
    let below = format!("--out={}/file/out", folder.path().display());
    let found = warnings(&[&below]);
    assert!(found[0].contains("cannot be written"), "{found:?}");
}

/// What is left of a run that its folder holds, and whether a resume would be refused.
#[test]
fn a_resumed_run_is_checked_as_it_would_go_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let place = format!("--out={}", out.display());
    let steps = |arguments: &[&str]| {
        let said = said(&[&[SCENE, &place][..], arguments].concat());
        assert!(!said.contains("warning: "), "{said}");
        let steps = lines(&said).remove("steps");
        (steps.unwrap_or_default(), said)
    };
    let short = "--set=shear.strain=0.02";
    let (whole, _) = steps(&["--resume=auto", short]);
    let run = gshear_mpi(
        1,
        &out,
        &[SCENE.into(), short.into(), "--stop-at=40".into()],
    );
    assert_eq!(run.code, 75, "{}", run.text);
    let (_, whole) = whole.rsplit_once("(a guess), ").expect("a packing");
    let whole: u64 = whole.trim_start_matches("shear ").parse().expect("steps");
    let (left, said) = steps(&["--resume=auto", short]);
    assert_eq!(left, format!("shear {}", whole - 40), "{said}");
    assert!(said.contains("holds this run"), "{said}");

    // An end that has passed is refused as by the run, with nothing else said.
    let resume = format!("--resume={}", out.display());
    for (past, words) in [
        (
            "--set=shear.strain=0.001",
            "error: shear: the run would end at step ",
        ),
        (
            "--stop-at=10",
            "error: --stop-at 10: the run is at step 40 already",
        ),
    ] {
        let refused = check_on(1, &[&resume, past]);
        assert_eq!(refused.status.code(), Some(2), "{past}");
        assert!(
            text(&refused.stderr).starts_with(words),
            "{}",
            text(&refused.stderr)
        );
        assert!(refused.stdout.is_empty(), "{past}");
    }
    // Another run in the folder is a warning, as without --resume.
    let other = check_on(1, &[SCENE, &place, "--resume=auto", "--set=seed=9"]);
    assert!(other.status.success());
    let said = text(&other.stderr);
    assert!(
        said.contains("warning: ") && said.contains("is of another run"),
        "{said}"
    );

    let run = gshear_mpi(
        1,
        &out,
        &[SCENE.into(), short.into(), "--resume=auto".into()],
    );
    assert_eq!(run.code, 0, "{}", run.text);
    let (left, said) = steps(&["--resume=auto", short]);
    assert_eq!(left, "");
    assert!(said.contains("finished; nothing is left to do"), "{said}");
}

/// A run of a sweep is checked by its number; the list names doubts once.
#[test]
fn a_run_of_a_sweep_is_checked() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str, sweep: &str| {
        let path = folder.path().join(name);
        let scene = std::fs::read_to_string(SCENE).expect("the scene");
        std::fs::write(&path, format!("{scene}\n[sweep]\n{sweep}\n")).expect("written");
        path.display().to_string()
    };
    let path = at(
        "sweep.toml",
        "seed = [1, 2]\n'contact.friction' = [0.4, 30]",
    );
    let place = format!("--out={}", folder.path().join("out").display());
    let third = check_on(1, &[&path, "--sweep=4", &place]);
    let said = text(&third.stderr);
    assert!(third.status.success(), "{said}");
    let scene: toml::Table = text(&third.stdout).parse().expect("TOML");
    assert_eq!(scene["contact"]["friction"].as_float(), Some(30.0));
    assert_eq!(scene["seed"].as_integer(), Some(2));
    assert!(
        said.contains("out/seed-2_friction-30: can be written"),
        "{said}"
    );
    assert!(said.contains("warning: contact.friction is 30:"), "{said}");
    assert_eq!(check_on(1, &[&path, "--sweep=5"]).status.code(), Some(2));

    let listed = check_on(1, &[&path, "--sweep=all", &place]);
    let said = text(&listed.stderr);
    assert_eq!(text(&listed.stdout).lines().count(), 4, "{said}");
    assert!(
        said.contains("left to do: 4 of 4 runs") && said.contains(" on 1 rank, "),
        "{said}"
    );
    let doubts: Vec<&str> = said
        .lines()
        .filter(|l| l.starts_with("warning: "))
        .collect();
    assert_eq!(doubts.len(), 1, "{said}");
    assert!(
        doubts[0].starts_with("warning: run 2 and 1 more: contact.friction is 30:"),
        "{said}"
    );

    // A wrong value is one of the file, not of a --set.
    let path = at("wrong.toml", "'contact.friction' = [0.4, 'a']");
    let line = std::fs::read_to_string(&path)
        .expect("text")
        .lines()
        .count();
    for sweep in ["--sweep=list", "--sweep=2", "--sweep=all"] {
        let refused = program(1).args([&*path, sweep, &place]).output();
        let refused = refused.expect("the program starts");
        assert_eq!(refused.status.code(), Some(2));
        let wanted =
            format!("error: {path}:{line}: sweep: contact.friction='a': expected a number");
        let said = text(&refused.stderr);
        assert!(said.starts_with(&wanted), "{said}");
    }
    assert!(!folder.path().join("out").exists(), "nothing was written");
}

/// Threads that a rank has too few grains for, and more of them than processors; ranks likewise.
#[test]
fn too_many_threads_are_doubted() {
    let said = said(&[SCENE, "--threads=500"]);
    assert!(
        said.contains("warning: 500 threads in a rank of "),
        "{said}"
    );
    assert!(said.contains("warning: 500 threads share the "), "{said}");
}

/// Sizes of huge runs can be read, and a time is said however heavy the grains are.
#[test]
fn strange_scenes_have_sizes_and_times() {
    let huge = said(&[
        SCENE,
        "--set=shear.strain=1e7",
        "--set=output.series_strain=1e-6",
    ]);
    let disk = lines(&huge)["disk"].replace(" until the end", "");
    assert!(disk.ends_with(" TB") || disk.ends_with(" PB"), "{disk}");
    // A lattice does not fall.
    let heavy = said(&[SCENE, "--set=load.gravity=1e9"]);
    assert!(!lines(&heavy)["time"].contains("unknown"), "{heavy}");
}
