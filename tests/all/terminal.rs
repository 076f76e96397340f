//! What a run shows while it goes on, through the real program: the line of progress on a terminal,
//! the lines of a log, `status.json`.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::crossing::{SCENE, whole};
use crate::common::{
    self, Outcome, PROGRAM, REDUCER, gshear_mpi, is_open_mpi, mpirun, program, reducer, succeed,
};
use gshear_store::status::{RunState, Status};

const SHORT: &str = "--set=shear.strain=0.02";

/// Everything that a shell command writes to a terminal of this width; `script` is one.
fn on_a_terminal(columns: usize, command: &str) -> String {
    let command = format!("stty cols {columns} rows 24; {command}");
    let mut script = common::start("script");
    script.args(["-q", "-e", "-c", &command, "/dev/null"]);
    script.env("TERM", "xterm-256color").stdin(Stdio::null());
    String::from_utf8(succeed(&mut script).stdout).expect("text")
}

/// Without colours and movements of the cursor.
fn plain(text: &str) -> String {
    let mut plain = String::new();
    let mut characters = text.chars();
    while let Some(c) = characters.next() {
        match c {
            '\x1b' => drop(characters.by_ref().find(char::is_ascii_alphabetic)),
            c => plain.push(c),
        }
    }
    plain
}

/// The lines of progress that were drawn in the shear, without colours.
fn drawn(text: &str) -> Vec<String> {
    let drawn = text
        .split(['\r', '\n'])
        .filter(|line| line.starts_with("\x1b[2K\x1b[1m"));
    let lines = drawn.map(|line| plain(line).trim_end().to_string());
    lines.filter(|line| line.contains(" strain ")).collect()
}

/// A command as words of a shell, which has the environment of every program.
fn shell_words(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    let words: Vec<String> = words.map(|word| word.display().to_string()).collect();
    words.join(" ")
}

/// Open MPI hides the terminal from its ranks, but not its size.
#[test]
fn a_line_of_progress_fits_the_terminal() {
    if !is_open_mpi() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let options = format!(
        "{SCENE} --set=shear.strain=10 --overwrite --out {}",
        out.display()
    );
    let two = shell_words(&mpirun(2, PROGRAM));
    for (columns, program) in [(80, PROGRAM), (40, PROGRAM), (80, &two), (40, &two)] {
        let said = on_a_terminal(columns, &format!("{program} {options}"));
        let lines = drawn(&said);
        assert!(!lines.is_empty(), "{said:?}");
        for line in &lines {
            assert!(line.chars().count() < columns, "{columns}: {line}");
            assert!(line.contains(" % "), "{line}");
        }
        // At the end all is known.
        let last = lines.last().expect("a line");
        assert!(last.contains("strain ") && last.contains("tau "), "{last}");
        assert!(last.ends_with(['s', 't']), "no time left: {last}");
        let speed = lines.iter().any(|line| line.contains(" M grain-steps/s "));
        assert_eq!(speed, columns == 80, "{lines:?}");
        // It is gone at the end, and the lines of a log are not there.
        // Lines of more than the width are folded.
        let rest = plain(&said)
            .split_whitespace()
            .collect::<Vec<_>>()
            .join(" ");
        assert!(
            rest.contains(&format!("next: gshear-reduce report {}", out.display())),
            "{rest}"
        );
        assert!(!rest.contains("% step "), "{rest}");
    }
    let said = on_a_terminal(80, &format!("NO_COLOR=1 {PROGRAM} {options}"));
    assert!(
        said.contains("\x1b[2K") && said.contains(" tau "),
        "{said:?}"
    );
    assert!(!said.contains("\x1b[1m"), "{said:?}");
    for quiet in ["--quiet", "-q"] {
        let said = on_a_terminal(80, &format!("{PROGRAM} {options} {quiet}"));
        assert_eq!(said, "", "nothing to say");
    }
}

/// The line of progress is on standard error then, and the file has what a log has.
#[test]
fn a_file_gets_the_lines_of_a_log_beside_a_terminal() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    let said = on_a_terminal(
        80,
        &format!(
            "{PROGRAM} {SCENE} {SHORT} --out {} > {}",
            at("out"),
            at("log")
        ),
    );
    assert!(said.contains("\x1b[2K"), "{said:?}");
    let log = std::fs::read_to_string(at("log")).expect("a log");
    assert!(log.contains("% step "), "{log}");
    assert!(!log.contains(['\x1b', '\r']), "{log:?}");
}

/// Under mpirun, too, where every rank has a terminal as standard output.
#[test]
fn a_log_has_plain_lines() {
    let folder = tempfile::tempdir().expect("a folder");
    for ranks in [1, 2] {
        let out = folder.path().join(ranks.to_string());
        let run = whole(&out, ranks, &["shear.strain=0.02"]);
        assert!(!run.text.contains(['\x1b', '\r']), "{:?}", run.text);
        for line in [
            "% step ",
            "million grain-steps/s of ",
            "next: gshear-reduce report ",
        ] {
            assert!(run.text.contains(line), "no {line:?} in {}", run.text);
        }
        let again = |option: &str| {
            let outcome = gshear_mpi(
                ranks,
                &out,
                &[SCENE, SHORT, "--overwrite", option].map(String::from),
            );
            assert_eq!(outcome.code, 0, "{}", outcome.text);
            outcome
        };
        assert_eq!(again("--quiet").text, "");
        let verbose = again("--verbose");
        assert_eq!(verbose.digest(), run.digest());
        let checkpoint = "checkpoint of shear step ";
        assert!(verbose.text.contains(checkpoint), "{}", verbose.text);
        assert!(!run.text.contains(checkpoint), "{}", run.text);
    }
}

fn status(folder: &Path) -> Status {
    Status::read(folder).expect("a status")
}

/// Starts a run, and asks it to stop once `seen` of its status holds. Every version of the file
/// that is seen is whole.
fn stopped_when(out: &Path, seen: impl Fn(&Status) -> bool) -> Status {
    let mut child = program(1)
        .args([SCENE, "--set=shear.strain=100", "--out"])
        .arg(out)
        .stdout(Stdio::null())
        .spawn()
        .expect("the program starts");
    let begun = Instant::now();
    let found = loop {
        assert!(begun.elapsed() < Duration::from_mins(2), "no such status");
        let path = out.join("status.json");
        if let Ok(text) = std::fs::read_to_string(&path) {
            let status: Status = serde_json::from_str(&text).expect("a whole file");
            if seen(&status) {
                break status;
            }
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    common::signal(child.id(), "USR1");
    assert_eq!(child.wait().expect("its end").code(), Some(75));
    found
}

#[test]
fn the_status_says_how_far_a_run_has_come() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let seen = stopped_when(&out, |status| status.progress.stress_ratio.is_some());
    assert_eq!(
        (seen.state, &*seen.progress.stage),
        (RunState::Running, "shear")
    );
    assert!(
        seen.progress.step > 0
            && seen
                .progress
                .steps
                .is_some_and(|steps| steps > seen.progress.step)
    );
    assert!(seen.speed.is_some_and(|speed| speed > 0.0), "{seen:?}");
    assert!(seen.seconds_left.is_some_and(|left| left > 0.0), "{seen:?}");
    // Where Linux counts it.
    let waited = seen.waited_for_cores;
    assert!(
        waited.is_none_or(|waited| (0.0..=1.0).contains(&waited)),
        "{seen:?}"
    );
    // The rows up to there stand in the log, for those who watch.
    let log = std::fs::read_to_string(out.join("log.csv")).expect("a log");
    assert!(log.lines().count() > 1, "{log}");
    let stopped = status(&out);
    assert_eq!(stopped.state, RunState::Stopped);
    assert!(stopped.progress.step >= seen.progress.step && stopped.run_id == seen.run_id);
    let id = format!("# run_id {}", seen.run_id);
    let scene = std::fs::read_to_string(out.join("scene.toml")).expect("a scene");
    assert!(scene.contains(&id), "{scene}");

    // Other runs are refused, and leave it as it is.
    let run = |arguments: &[&str]| -> Outcome {
        let arguments: Vec<String> = arguments.iter().map(ToString::to_string).collect();
        gshear_mpi(1, &out, &arguments)
    };
    assert_eq!(run(&[SCENE]).code, 2);
    assert_eq!(status(&out), stopped);
    // One that is packed long enough to fail.
    let failed = run(&[SCENE, "--overwrite", "--set=pack.max_steps=2000"]);
    assert_eq!(failed.code, 3, "{}", failed.text);
    let found = status(&out);
    assert_eq!(
        (found.state, &*found.progress.stage),
        (RunState::Failed, "pack")
    );
    let message = found.message.expect("a message");
    assert!(message.contains("pack.max_steps = 2000"), "{message}");
    // It leaves its last sound state, which another run may not replace in silence.
    assert_eq!(run(&[SCENE, SHORT]).code, 2);
    let done = run(&[SCENE, SHORT, "--overwrite"]);
    assert_eq!(done.code, 0, "{}", done.text);
    let found = status(&out);
    assert_eq!(
        (found.state, found.progress.fraction),
        (RunState::Done, Some(1.0))
    );
    assert_eq!(Some(found.progress.step), found.progress.steps);
    assert!(found.message.is_none() && found.seconds_left.is_none());
    common::no_parts(&out);
}

/// A run goes on, to the same bits, if `status.json` cannot be written.
#[test]
fn a_status_that_cannot_be_written_does_not_end_a_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let [with, without] = ["with", "without"].map(|name| folder.path().join(name));
    // A folder in its place: nothing can be renamed to it.
    std::fs::create_dir_all(without.join("status.json/kept")).expect("a folder");
    let digests = [&with, &without].map(|out| whole(out, 1, &["shear.strain=0.02"]).digest());
    assert_eq!(digests[0], digests[1]);
    assert!(without.join("status.json/kept").exists());
    common::no_parts(&without);
    common::same_run(&with, &without);
}

/// While the run writes, and when it has ended; without a terminal in one line.
#[test]
fn a_run_can_be_watched() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let mut run = program(1)
        .args([SCENE, "--set=shear.strain=0.2", "--quiet", "--out"])
        .arg(&out)
        .spawn()
        .expect("the program starts");
    while Status::read(&out).is_none() {
        std::thread::sleep(Duration::from_millis(2));
    }
    let watch = format!("{REDUCER} watch {}", out.display());
    let live = on_a_terminal(80, &format!("export LC_ALL=C.UTF-8; {watch}"));
    assert!(run.wait().expect("its end").success());
    let braille = |text: &str| text.contains(|c| ('\u{2801}'..='\u{28ff}').contains(&c));
    let lines: Vec<String> = live.split(['\r', '\n']).map(plain).collect();
    assert!(
        lines.iter().all(|line| line.chars().count() < 80),
        "{lines:?}"
    );
    assert!(
        lines.iter().any(|line| line.starts_with("finished: ")),
        "{lines:?}"
    );
    // More than one picture, of both curves.
    assert!(live.matches("\x1b[2K").count() > 20, "{live:?}");
    for word in ["tau│", "phi│", "strain"] {
        assert!(live.contains(word), "no {word} in {live}");
    }
    assert!(braille(&live), "{live}");
    let ascii = on_a_terminal(60, &format!("export LC_ALL=C; {watch}"));
    assert!(ascii.is_ascii() && ascii.contains("***"), "{ascii}");
    let plainly = succeed(reducer().arg("watch").arg(&out));
    let said = String::from_utf8(plainly.stdout).expect("text");
    let bar = format!("finished: shear 100.0 % [{}] strain ", "=".repeat(30));
    assert!(said.starts_with(&bar), "{said}");
    assert!(
        said.lines().count() == 1 && !said.contains('\x1b'),
        "{said:?}"
    );
    let missing = folder.path().join("missing");
    for (of, words) in [
        (folder.path(), "holds neither status.json nor log.csv"),
        (&missing, "no such folder"),
    ] {
        let none = reducer().arg("watch").arg(of).output();
        let none = none.expect("the program starts");
        assert_eq!(none.status.code(), Some(2));
        let wanted = format!("error: {}: {words}; give the folder of a run", of.display());
        assert_eq!(String::from_utf8_lossy(&none.stderr).trim_end(), wanted);
    }
}

/// At once, also in a terminal, which does not wait for it.
#[test]
fn a_killed_run_is_said_to_be_killed() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let mut run = program(1)
        .args([SCENE, "--set=shear.strain=1000", "--quiet", "--out"])
        .arg(&out)
        .spawn()
        .expect("the program starts");
    while Status::read(&out).is_none_or(|status| status.progress.stress_ratio.is_none()) {
        std::thread::sleep(Duration::from_millis(2));
    }
    let watched = || {
        let said = succeed(reducer().arg("watch").arg(&out)).stdout;
        String::from_utf8(said).expect("text")
    };
    let running = watched();
    assert!(
        running.starts_with("shear ") && running.contains(" left"),
        "{running}"
    );
    run.kill().expect("killed");
    run.wait().expect("its end");
    assert_eq!(status(&out).state, RunState::Running);
    let said = watched();
    let next = "\nthere is no checkpoint yet: begin again with --resume auto\n";
    assert!(
        said.starts_with("killed: shear ") && said.ends_with(next),
        "{said}"
    );
    assert!(!said.contains(" left"), "{said}");
    let shown = on_a_terminal(80, &format!("{REDUCER} watch {}", out.display()));
    assert!(plain(&shown).contains("killed: "), "{shown}");
}

/// The terminal that mpirun gives its ranks does not change with the one that mpirun has.
#[test]
fn the_line_of_progress_follows_the_terminal_of_mpirun() {
    if !is_open_mpi() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let options = format!("{SCENE} --set=shear.strain=10 --out {}", out.display());
    let two = shell_words(&mpirun(2, PROGRAM));
    let seen = format!(
        "until grep -q 'stage.*shear' {}/status.json; do sleep 0.02; done",
        out.display()
    );
    let narrow = format!(
        "({seen}; stty cols 50 </dev/tty; touch {}/narrow) 2>/dev/null &",
        out.display()
    );
    let said = on_a_terminal(100, &format!("{narrow} {two} {options}"));
    assert!(out.join("narrow").exists());
    let lines = drawn(&said);
    let wide = |line: &String| line.chars().count() > 50;
    assert!(lines.iter().any(wide), "{lines:?}");
    let last = lines.last().expect("a line");
    assert!(!wide(last), "{last}");
    // The lines at the end are folded to the new width, too.
    let (_, end) = said.split_once("results in ").expect("an end");
    let width = |line: &str| line.trim_end().chars().count();
    let long = |line: &&str| width(line) > 50 && line.split_whitespace().count() > 1;
    let broken: Vec<&str> = end.lines().skip(1).filter(long).collect();
    assert!(broken.is_empty(), "{broken:?}");
}

/// The stages of a box report, too.
#[test]
fn a_box_has_a_status() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");
    let run = gshear_mpi(1, folder.path(), &[scene.into(), "--stop-at=2".into()]);
    assert_eq!(run.code, 75, "{}", run.text);
    let found = status(folder.path());
    assert_eq!(
        (found.state, &*found.progress.stage),
        (RunState::Stopped, "aqs")
    );
    assert_eq!(found.progress.step, 2);
    assert!(
        found.progress.strain.is_some_and(|strain| strain > 0.0),
        "{found:?}"
    );
    assert!(found.progress.shear_stress.is_some() && found.progress.stress_ratio.is_none());
}

/// The curve of a box begins at its start, though it is watched from later on.
#[test]
fn a_box_is_watched_from_its_start() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");
    let mut run = program(1)
        .args([
            scene,
            "--set=aqs.steps=1000000",
            "--set=aqs.strain_step=1e-6",
        ])
        .args(["--quiet", "--out"])
        .arg(&out)
        .spawn()
        .expect("the program starts");
    let begun = Instant::now();
    let is_under_way = |status: Status| status.progress.stage == "aqs" && status.progress.step > 20;
    let mut since = None;
    // Long enough for the run to write its first rows.
    while since.is_none_or(|since: Instant| since.elapsed() < Duration::from_secs(4)) {
        assert!(begun.elapsed() < Duration::from_mins(3), "no strain steps");
        std::thread::sleep(Duration::from_millis(20));
        if since.is_none() && Status::read(&out).is_some_and(is_under_way) {
            since = Some(Instant::now());
        }
    }
    let pid = run.id();
    let stop = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_secs(5));
        common::signal(pid, "USR1");
    });
    let live = on_a_terminal(80, &format!("{REDUCER} watch {}", out.display()));
    stop.join().expect("a thread");
    assert_eq!(run.wait().expect("its end").code(), Some(75));
    // Of every picture, from the first one on.
    let axes: Vec<String> = live
        .split(['\r', '\n'])
        .map(|line| plain(line).trim().to_string())
        .filter(|line| line.contains(" strain ") && !line.contains("stress"))
        .collect();
    assert!(axes.len() > 2, "{live}");
    for axis in &axes {
        assert!(axis.starts_with("0 "), "{axis}");
    }
    let ends: Vec<&str> = axes
        .iter()
        .filter_map(|axis| axis.rsplit(' ').next())
        .collect();
    assert_ne!(ends.first(), ends.last(), "the curve grows");
}

/// Titles, keys, names and messages that other people wrote reach the terminal without control
/// characters, which would move its cursor, change its title or hide a line.
/// Strain steps after a shear are what is drawn while they go on.
#[test]
fn strain_steps_after_a_shear_are_watched() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/configs/sheared-modulus-2d.toml"
    );
    let small = [
        "sample.grains=100",
        "sample.length=10 mm",
        "shear.strain=0.01",
    ];
    let looser = ["relax.tolerance=1e-6", "aqs.steps=20"];
    let sets = small.into_iter().chain(looser);
    let mut arguments = vec![scene.to_string()];
    arguments.extend(sets.map(|set| format!("--set={set}")));
    let out = folder.path().join("out");
    let watched = || {
        let shown = on_a_terminal(80, &format!("{REDUCER} watch {}", out.display()));
        plain(&shown)
    };
    arguments.push("--stop-at=600".into());
    assert_eq!(gshear_mpi(1, &out, &arguments).code, 75);
    let of_shear = watched();
    assert!(
        of_shear.contains("phi") && !of_shear.contains("stress"),
        "{of_shear}"
    );
    arguments.pop();
    arguments.push("--resume=auto".into());
    assert_eq!(gshear_mpi(1, &out, &arguments).code, 0);
    let of_strain = watched();
    assert!(
        of_strain.contains("stress") && !of_strain.contains("phi"),
        "{of_strain}"
    );
}

#[test]
fn control_characters_of_files_are_escaped() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let hidden = |text: &str| text.contains(|c: char| c.is_control() && !"\n\t".contains(c));
    let says = |program: &str, code: i32, arguments: &[&Path]| {
        let output = common::start(program).args(arguments).output();
        let output = output.expect("the program starts");
        let text = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
        assert_eq!(
            output.status.code(),
            Some(code),
            "{}: {text}",
            output.status
        );
        assert!(!hidden(&text), "{text:?}");
        text
    };
    let scene = std::fs::read_to_string(SCENE).expect("a scene");
    let evil = r#"title = "\u001b]0;owned\u0007\nerror: no\u009b31m""#;
    let title = scene.replace("title = \"Crossing\"", evil);
    let [path, out] = ["a\x1b[31m.toml", "out\x1b[31m"].map(at);
    std::fs::write(&path, &title).expect("written");
    let run = says(PROGRAM, 0, &[&path, SHORT.as_ref(), "--out".as_ref(), &out]);
    assert!(
        run.contains(r"\u{1b}]0;owned\u{7}\nerror: no\u{9b}31m"),
        "{run}"
    );
    says(REDUCER, 0, &["info".as_ref(), &out]);
    let page = says(REDUCER, 0, &["report".as_ref(), &out]);
    assert!(page.contains(r"out\u{1b}[31m/report/index.html"), "{page}");
    let page = std::fs::read_to_string(out.join("report/index.html")).expect("a page");
    assert!(!hidden(&page), "the page");
    // A state that somebody else wrote.
    let status = std::fs::read_to_string(out.join("status.json")).expect("a status");
    let status = status.replace("\"done\"", "\"failed\"");
    let status = status.replace("\"message\": null", r#""message": "\u001b]0;owned\u0007""#);
    std::fs::write(out.join("status.json"), status).expect("written");
    let state = says(REDUCER, 0, &["watch".as_ref(), &out]);
    assert!(state.contains(r"\u{1b}]0;owned"), "{state}");
    // Lines and keys that a message repeats.
    for line in [
        "\"\\u001b[31mkey\" = 1",
        "a = \x1b[31m",
        "output.\"\\u001b[31m\" = 1",
    ] {
        std::fs::write(&path, format!("{line}\n{title}")).expect("written");
        says(PROGRAM, 2, &[&path, "--check".as_ref()]);
    }
    let packing = at("packing.data");
    std::fs::write(&packing, "title\n\n2 atoms\x1b[31m\n").expect("written");
    let set = format!("--set=sample.packing={}", packing.display());
    says(
        PROGRAM,
        2,
        &[SCENE.as_ref(), set.as_ref(), "--check".as_ref()],
    );
}
