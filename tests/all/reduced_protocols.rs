//! `gshear-reduce` on runs of protocols that impose more than velocities.

use std::path::Path;

use crate::common::protocols::{Case, DISKS, SPHERES_UNDER_A_SPRING};
use crate::common::{self, gshear_mpi, program, reducer};
use gshear_store::run_reader::RunFile;

/// Parts of which every one returns to a strain that another one has had.
const CYCLES: Case = Case {
    further: &[
        "output.series_rows=40",
        "output.frame_rows=40",
        "output.keep_checkpoints=true",
    ],
    parts: &[
        "velocity = 0.3, time = 1e-7",
        "strain_amplitude = 0.002, frequency = 1e7, cycles = 1.25",
        "strain_amplitude = 0.002, frequency = 1e7, cycles = 1, wall_velocity = 0",
        "shear_stress = 2e5, time = 1e-7, pressure = 6e5",
    ],
    ..DISKS
};

/// What the reducer says, after it has ended well.
fn reduce(arguments: &[&str]) -> String {
    let mut command = reducer();
    let output = common::succeed(command.args(arguments));
    String::from_utf8(output.stdout).expect("text")
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a path in UTF-8")
}

#[test]
fn cycles_are_replayed_and_reported() {
    let temporary = tempfile::tempdir().expect("a folder");
    let folder = temporary.path().join("run");
    CYCLES.run(&folder, 1, &[]).digest();
    let run = RunFile::open(&folder).expect("a run");
    let series = run.series();

    // By its time, as its strain returns: within the first cyclic part.
    let [from, to] = [1.1e-7, 2.2e-7];
    let within = |row: &usize| series.time[*row] >= from && series.time[*row] <= to;
    let rows: Vec<usize> = (0..series.rows()).filter(within).collect();
    assert!(rows.len() > 20);
    let out = temporary.path().join("again");
    let window = format!("--time={from}..{to}");
    let words = reduce(&["replay", text(&folder), &window, "--out", text(&out)]);
    assert!(words.contains("to the last bit"), "{words}");
    let again = RunFile::open(&out).expect("a run");
    assert_eq!(
        again.frame_steps(),
        &series.step[rows[0]..=rows[rows.len() - 1]]
    );
    for (t, step) in again.frame_steps().iter().enumerate() {
        let stored = run.frame_steps().binary_search(step).expect("a frame");
        let [one, two] = [(&run, stored), (&again, t)].map(|(run, t)| run.frame(t).expect("it"));
        assert!(one == two, "step {step}");
    }

    let report = folder.join("report");
    reduce(&["report", text(&folder)]);
    let elsewhere = temporary.path().join("elsewhere");
    reduce(&["report", text(&folder), "--out", text(&elsewhere)]);
    // The numbers of the figures are those of the run, once.
    let numbers = std::fs::read_to_string(elsewhere.join("series.csv")).expect("the series");
    let mut lines = numbers.lines().map(|line| line.split(','));
    let names: Vec<&str> = lines.next().expect("names").collect();
    for (row, line) in lines.enumerate() {
        assert!(row < series.rows());
        for (name, word) in names.iter().zip(line) {
            let found: f64 = word.parse().expect("a number");
            let stored = match *name {
                "step" => series.step[row] as f64,
                "time" => series.time[row],
                _ => series.column(name)[row],
            };
            assert!(
                found == stored || found.is_nan() && stored.is_nan(),
                "{name}"
            );
        }
    }
    assert_eq!(numbers.lines().count(), 1 + series.rows());
    assert!(names.contains(&"imposed_shear_force"));
    for figure in ["stresses", "stress-strain-loops", "stress-path", "dilation"] {
        assert!(report.join(figure).with_extension("svg").is_file());
        assert!(!report.join(figure).with_extension("csv").exists());
    }
    let page = std::fs::read_to_string(report.join("index.html")).expect("a page");
    assert!(page.contains("Shear strain, least and greatest") && !page.contains("Inertial number"));
    is_sound(&report);

    for command in [&["info"][..], &["phases"], &["dmin"], &["columns"]] {
        let run = [text(&folder)];
        let of_run = if command == ["columns"] {
            &run[..0]
        } else {
            &run[..]
        };
        reduce(&[command, of_run].concat());
    }
    let information = reduce(&["info", text(&folder)]);
    let greatest = series
        .column("strain")
        .iter()
        .fold(0.0_f64, |most, x| most.max(*x));
    assert!(
        information.contains(&format!("{greatest:.8}")),
        "{information}"
    );
    let exported = temporary.path().join("frames.csv");
    let to = ["--format", "csv", "--out", text(&exported)];
    let to = &to[..];
    reduce(&[&["export", text(&folder), "--frames", "50..60"][..], to].concat());
}

/// No number of a figure is infinite or not a number.
fn is_sound(report: &Path) {
    let mut figures = 0;
    for entry in std::fs::read_dir(report).expect("a report").flatten() {
        if entry.path().extension().is_some_and(|end| end == "svg") {
            let drawn = std::fs::read_to_string(entry.path()).expect("a figure");
            for wrong in ["NaN", "inf"] {
                let place = drawn
                    .find(wrong)
                    .map(|at| &drawn[at.saturating_sub(40)..][..60]);
                assert_eq!(place, None, "{}", entry.path().display());
            }
            figures += 1;
        }
    }
    assert!(figures > 5, "{figures}");
}

/// A layer whose walls stand still: no strain, no inertial number, nothing that is divided by them.
#[test]
fn a_layer_at_rest_is_reported() {
    let temporary = tempfile::tempdir().expect("a folder");
    let rest = Case {
        parts: &["velocity = 0, time = 1e-7, wall_velocity = 0"],
        ..CYCLES
    };
    rest.run(temporary.path(), 1, &[]).digest();
    reduce(&["report", text(temporary.path())]);
    let report = temporary.path().join("report");
    is_sound(&report);
    let summary = std::fs::read_to_string(report.join("summary.json")).expect("numbers");
    let summary: serde_json::Value = serde_json::from_str(&summary).expect("JSON");
    assert_eq!(summary["final_strain"], 0.0);
    assert!(summary["stress_ratio_latter_half"]["mean"].is_number());
    assert_eq!(summary["largest_drop"], serde_json::Value::Null);
    reduce(&["info", text(temporary.path())]);
    reduce(&["phases", text(temporary.path())]);
}

/// k/N and the laws are of one normal force: a mean over a step of the pressure would be of neither
/// side of it. An oscillation about one pressure is no step.
#[test]
fn rate_and_state_takes_one_load() {
    let temporary = tempfile::tempdir().expect("a folder");
    let of = |parts: &'static [&'static str], name: &str| {
        let case = Case {
            further: &["output.series_rows=100", "output.frame_rows=none"],
            parts,
            ..SPHERES_UNDER_A_SPRING
        };
        let folder = temporary.path().join(name);
        case.run(&folder, 1, &[]).digest();
        let mut command = reducer();
        command.args(["rate-state", text(&folder)]);
        let output = command.output().expect("gshear-reduce");
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        (
            output.status.code(),
            words.split_whitespace().collect::<Vec<_>>().join(" "),
        )
    };
    let stepped = &[
        "velocity = 3, time = 1e-4",
        "velocity = 1, time = 1e-4, pressure = 5e4",
    ];
    let free = &[
        "velocity = 3, time = 1e-4",
        "velocity = 1, time = 1e-4, wall_velocity = 0",
    ];
    for (parts, name, why) in [
        (stepped, "stepped", "the load changes from "),
        (free, "free", "no load is imposed in a part"),
    ] {
        let (code, words) = of(parts, name);
        let why = format!("imposed_normal_force: {why}");
        assert!(code == Some(2) && words.contains(&why), "{code:?} {words}");
    }
    let vibrated = &[
        "velocity = 1, time = 1e-4",
        "velocity = 3, time = 1e-4, pressure = 1e5, pressure_amplitude = 3e4, pressure_frequency = 8e4",
    ];
    let (code, words) = of(vibrated, "vibrated");
    assert_eq!(code, Some(0), "{words}");
}

/// A run of velocities alone has fewer columns, and its files cannot be continued with more.
#[test]
fn a_continuation_with_other_columns_says_why_not() {
    let temporary = tempfile::tempdir().expect("a folder");
    let of = |parts: &'static [&'static str]| Case { parts, ..DISKS };
    let first = of(&["velocity = 0.3, time = 1e-7"]);
    first.run(temporary.path(), 1, &[]).digest();
    let more = of(&[
        "velocity = 0.3, time = 1e-7",
        "velocity = 0.3, time = 1e-7, wall_velocity = 0",
    ]);
    let protocol = more.sets().pop().expect("the protocol");
    let resume = format!(
        "--resume={}",
        temporary.path().join("checkpoint.h5").display()
    );
    let outcome = gshear_mpi(1, temporary.path(), &[resume, format!("--set={protocol}")]);
    assert_eq!(outcome.code, 2, "{}", outcome.text);
    let words = outcome
        .text
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ");
    let why = "its protocol imposed velocities alone and this one more";
    assert!(
        words.contains("imposed_normal_force") && words.contains(why),
        "{words}"
    );
}

/// Parts of several velocities. More frames than rows, so that the first frames of a branch come
/// before its first row.
const PUSHES: Case = Case {
    // Of a packing from a file the schedule is not known, nor a strain before the first row.
    sample: &[],
    further: &["output.series_rows=3", "output.frame_rows=8"],
    parts: &[
        "velocity = 0.3, time = 1e-7",
        "velocity = 0, time = 5e-8",
        "velocity = 0.1, time = 2e-7",
    ],
    ..DISKS
};

/// The rows of a run that began at a checkpoint are all of the last part; its strain is
/// nevertheless that of all parts.
#[test]
fn strains_of_a_branch_are_those_of_all_parts() {
    let temporary = tempfile::tempdir().expect("a folder");
    let at = |name: &str| temporary.path().join(name);
    let stop = *PUSHES.stops().last().expect("the middle of the last part");
    let early = PUSHES.run(&at("run"), 1, &[&format!("--stop-at={stop}")]);
    assert_eq!(early.code, 75, "{}", early.text);
    let resume = format!("--resume={}", at("run/checkpoint.h5").display());
    let begin = |into: &str, further: &[&str]| {
        let mut command = program(1);
        let into = format!("--{into}={}", at(into).display());
        common::succeed(command.args([&resume, &into]).args(further));
    };
    begin("branch", &["--set=load.gravity=1"]);
    // The same run, whose files begin anew elsewhere.
    begin("out", &[]);

    for name in ["branch", "out"] {
        let folder = at(name);
        let run = RunFile::open(&folder).expect("a run");
        let [step, height] =
            ["time_step", "height_start"].map(|name| run.number(name).expect(name));
        let [push, hold] = [1e-7, 5e-8].map(|time: f64| (time / step).round());
        let strain = |at: u64| (0.3 * push + 0.1 * (at as f64 - push - hold)) * step / height;
        let (steps, found) = (run.frame_steps(), run.frame_strains().expect("strains"));
        assert!(
            steps.len() > 3 && steps[0] < run.series().step[0],
            "{steps:?}"
        );
        for (at, found) in steps.iter().zip(&found) {
            let expected = strain(*at);
            assert!(
                (found / expected - 1.0).abs() < 1e-12,
                "{name}: {found}, {expected}"
            );
        }
        let [first, last] = [&steps[0], steps.last().expect("one")].map(|at| strain(*at));
        let range = format!("γ = {first:.8} … {last:.8}");
        assert!(reduce(&["info", text(&folder)]).contains(&range), "{range}");
        reduce(&["stability", text(&folder)]);
        let table = std::fs::read_to_string(folder.join("stability.csv")).expect("a table");
        let strains = table.lines().skip(1).map(|line| {
            let word = line.split(',').nth(2).expect("a strain");
            word.parse::<f64>().expect("a number")
        });
        assert!(strains.eq(found), "{table}");
        reduce(&["report", text(&folder)]);
        let page = std::fs::read_to_string(folder.join("report/index.html")).expect("a page");
        assert!(!page.contains("Inertial number"), "that of the first part");
    }
}
