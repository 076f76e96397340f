//! `report` of several runs, on made-up ones.

use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::fixture::{Fixture, column};
use super::{are_described, done, refused};

/// τ of the later rows of a run.
fn tau(friction: f64, seed: u64) -> f64 {
    friction + [0.0, 0.01, -0.02, 0.05][seed as usize]
}

/// A run whose first rows, which means leave out, are far off.
fn run_of(friction: f64, seed: u64) -> Fixture {
    let mut run = Fixture::small();
    (run.friction, run.seed) = (friction, seed);
    let rows = run.series_step.len();
    run.series[column("normal_force")].fill(0.5);
    // 51 rows: the first 25 are left out.
    let tau = |row| if row < 25 { 1e3 } else { tau(friction, seed) };
    run.set_stress_ratio((0..rows).map(tau).collect());
    run
}

/// The folder of a sweep over two frictions and three seeds, 10 the last value by its number alone.
fn sweep() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let sweep = folder.path().join("sweep");
    for friction in [0.5, 10.0] {
        for seed in 1..=3 {
            add(
                &sweep,
                &format!("friction-{friction}_seed-{seed}"),
                &run_of(friction, seed),
            );
        }
    }
    (folder, sweep)
}

fn add(sweep: &Path, name: &str, run: &Fixture) {
    let folder = sweep.join(name);
    std::fs::create_dir_all(&folder).expect("a folder");
    run.write(&folder.join("run.h5"));
}

/// The lines of a table, cell by cell.
fn table(path: &Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let cells = |line: &str| line.split(',').map(String::from).collect();
    text.lines().map(cells).collect()
}

fn words(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

fn is_near(cell: &str, expected: f64) {
    let found: f64 = cell.parse().expect("a number");
    assert!((found - expected).abs() <= 1e-12, "{found}, not {expected}");
}

#[test]
fn means_are_over_later_rows_and_then_over_seeds() {
    let (_folder, sweep) = sweep();
    let told = done(&[
        "report",
        words(&sweep),
        "--columns",
        "stress_ratio,coordination",
    ]);
    let out = sweep.join("report");
    for name in ["runs.csv", "means.csv", "index.html"] {
        assert!(
            told.contains(&format!("wrote {}\n", out.join(name).display())),
            "{told}"
        );
    }
    let runs = table(&out.join("runs.csv"));
    assert_eq!(
        runs[0],
        [
            "run",
            "contact.friction",
            "seed",
            "stress_ratio",
            "stress_ratio_error",
            "coordination",
            "coordination_error"
        ]
    );
    assert_eq!(runs[1][..3], ["friction-0.5_seed-1", "0.5", "1"]);
    is_near(&runs[3][3], 0.55);
    // Over the time of the run, in which τ is constant.
    is_near(&runs[3][4], 0.0);
    let means = table(&out.join("means.csv"));
    let names =
        "contact.friction,stress_ratio,stress_ratio_error,coordination,coordination_error,runs";
    assert_eq!(means[0].join(","), names);
    // Of 0.01, -0.02 and 0.05: mean 0.04/3, squared deviations 0.0074/3.
    let error = (0.0074_f64 / 3.0 / 2.0 / 3.0).sqrt();
    for (line, friction) in means[1..].iter().zip([0.5, 10.0]) {
        is_near(&line[0], friction);
        is_near(&line[1], friction + 0.04 / 3.0);
        is_near(&line[2], error);
        is_near(&line[3], 3.1);
        assert_eq!((&*line[4], &*line[5]), ("0.0", "3"));
    }
    are_described(&out, &["runs.csv", "means.csv", "stress_ratio-means.csv"]);
    are_described(&out, &["stress_ratio-curves.csv"]);
    let curves = table(&out.join("stress_ratio-curves.csv"));
    assert_eq!(curves.len(), 1 + 6 * 51);
    // Of all rows the first 25 weigh in.
    done(&[
        "report",
        words(&sweep),
        "--start",
        "0",
        "--columns",
        "stress_ratio",
    ]);
    let all = table(&out.join("means.csv"));
    is_near(&all[1][1], (25.0 * 1e3 + 26.0 * (0.5 + 0.04 / 3.0)) / 51.0);
}

/// Of the case "mean-of-ratios": rows in which N is near zero, with any S/N. A single run has the
/// error of its mean over time.
#[test]
fn a_row_without_load_does_not_ruin_the_mean() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut run = run_of(0.5, 1);
    for row in [30, 40] {
        run.series[column("normal_force")][row] = -1e-9;
        run.series[column("shear_force")][row] = 1e-3;
        run.series[column("stress_ratio")][row] = -1e6;
    }
    add(folder.path(), "one", &run);
    done(&["report", words(folder.path()), "--columns", "stress_ratio"]);
    for name in ["means.csv", "runs.csv"] {
        let table = table(&folder.path().join("report").join(name));
        let at = table[0].iter().position(|name| name == "stress_ratio");
        let at = at.expect("a column");
        // 24 rows of S = 0.51 N, N = 0.5, and these two.
        let expected = (24.0 * 0.5 * 0.51 + 2e-3) / (24.0 * 0.5 - 2e-9);
        is_near(&table[1][at], expected);
        let error: f64 = table[1][at + 1].parse().expect("a number");
        assert!(error > 0.0 && error < 0.03, "{error}");
    }
    done(&["report", words(&folder.path().join("one"))]);
    let summary = std::fs::read_to_string(folder.path().join("one/report/summary.json"));
    let summary: serde_json::Value = serde_json::from_str(&summary.expect("JSON")).expect("JSON");
    let mean = summary["stress_ratio_latter_half"]["mean"]
        .as_f64()
        .expect("a number");
    assert!((mean - 0.51).abs() < 1e-3, "{mean}");
}

/// Means lie at their keys: pixels of the points that the figure has.
#[test]
fn figures_show_the_means() {
    let (_folder, sweep) = sweep();
    done(&["report", words(&sweep), "--columns", "stress_ratio"]);
    let page = std::fs::read_to_string(sweep.join("report/index.html")).expect("a page");
    assert!(page.contains("<td>0.5</td><td>3</td>"), "{page}");
    let svg =
        std::fs::read_to_string(sweep.join("report/stress_ratio-means.svg")).expect("a figure");
    let places: Vec<[f64; 2]> = svg
        .lines()
        .filter(|line| line.starts_with("<circle"))
        .map(|line| {
            ["cx", "cy"].map(|name| {
                let at = line.split(&format!("{name}=\"")).nth(1).expect("a place");
                at.split('"')
                    .next()
                    .expect("a number")
                    .parse()
                    .expect("a number")
            })
        })
        .collect();
    let [one, other] = places[..] else {
        panic!("{places:?}")
    };
    assert!(other[0] > one[0] && other[1] < one[1], "{places:?}");
    let (_, frame) = svg.split_once("data-frame=\"").expect("a frame");
    let frame: Vec<f64> = frame
        .split('"')
        .next()
        .expect("four")
        .split(' ')
        .map(|x| x.parse().expect("a number"))
        .collect();
    // The axis goes from 8 % before the first to 8 % after the last value, on a logarithmic axis.
    let share = (one[0] - frame[0]) / (frame[2] - frame[0]);
    assert!((share - 0.08 / 1.16).abs() < 1e-3, "{share}");
}

/// Runs that differ in two keys at once lie on one line, and the page names the second one.
#[test]
fn keys_that_change_together_make_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    for (friction, steps) in [(0.2, 3), (0.4, 5)] {
        let mut run = run_of(friction, 1);
        run.further = format!("pack.max_steps = {steps}\n");
        add(folder.path(), &format!("friction-{friction}"), &run);
    }
    done(&["report", words(folder.path()), "--columns", "stress_ratio"]);
    let read = |name: &str| {
        let path = folder.path().join("report").join(name);
        std::fs::read_to_string(path).expect("a file")
    };
    let page = read("index.html");
    assert!(
        page.contains("Keys that follow from the others: pack.max_steps."),
        "{page}"
    );
    let svg = read("stress_ratio-means.svg");
    let points: Vec<&str> = svg.lines().filter(|l| l.starts_with("<circle")).collect();
    let colour = |line: &str| line.split("fill=").nth(1).map(|rest| rest[..9].to_string());
    assert_eq!(points.len(), 2);
    assert_eq!(colour(points[0]), colour(points[1]));
    let means = table(&folder.path().join("report/means.csv"));
    assert_eq!(means[0][..2], ["contact.friction", "pack.max_steps"]);
}

#[test]
fn runs_that_did_not_end_are_left_out() {
    let (_folder, sweep) = sweep();
    let stopped = Fixture {
        digest: None,
        ..run_of(0.5, 0)
    };
    add(&sweep, "stopped", &stopped);
    std::fs::create_dir(sweep.join("failed")).expect("a folder");
    let status = r#"{"version":1,"state":"failed","message":"the packing did not settle","run_id":"a",
        "title":"","stage":"pack","step":1,"steps":null,"fraction":null,"strain":null,"stress_ratio":null,
        "solid_fraction":null,"shear_stress":null,"speed":null,"seconds_left":null,"seconds":1.0,
        "grains":1,"ranks":1,"host":"","pid":1,"started":"","updated":""}"#;
    std::fs::write(sweep.join("failed/status.json"), status).expect("written");
    std::fs::create_dir(sweep.join("notes")).expect("a folder");
    let told = done(&["report", words(&sweep)]);
    assert!(
        told.contains("left out failed: failed: the packing did not settle (stage pack)\n"),
        "{told}"
    );
    let unfinished = "left out stopped: unfinished: no digest, and no status.json that says why\n";
    assert!(told.contains(unfinished), "{told}");
    assert_eq!(told.matches("left out").count(), 2, "{told}");
    let means = table(&sweep.join("report/means.csv"));
    assert_eq!(means[1].last().map(String::as_str), Some("3"));

    let only = sweep.join("stopped");
    let message = refused(&["report", words(&only), words(&sweep.join("failed"))]);
    assert!(
        message
            .contains("none of 2 runs has ended by itself, first stopped: unfinished: no digest"),
        "{message}"
    );
    assert!(!only.join("sweep-report").exists());
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let (folder, sweep) = sweep();
    let (path, out) = (words(&sweep), folder.path().join("out"));
    let one = sweep.join("friction-0.5_seed-1");
    let one = words(&one);
    let nothing = folder.path().join("nothing");
    std::fs::create_dir(&nothing).expect("a folder");
    let absent = folder.path().join("absent");
    let bare = folder.path().join("bare");
    let without_frames = Fixture {
        frames: Vec::new(),
        ..run_of(0.5, 1)
    };
    add(folder.path(), "bare", &without_frames);
    for (arguments, expected) in [
        (
            &[path, "--columns", "stres_ratio"][..],
            "--columns stres_ratio: friction-0.5_seed-1 has no such column; it has coordination, ",
        ),
        (
            &[path, "--against", "sample.grains"],
            "--against sample.grains: is not a key in which the runs differ; they differ in contact.friction",
        ),
        (
            &[words(&bare), "--columns", "dmin_greatest"],
            "--columns dmin_greatest: bare has no value of it, which needs frames",
        ),
        (
            &[one, "--against", "contact.friction"],
            "--against contact.friction: is not a key in which the runs differ; they differ in no key",
        ),
        (
            &[one, one],
            "are the same run (equal scenes and digests); give each run once",
        ),
        (
            &[words(&nothing)],
            "holds no run (run.h5), and no folder in it does",
        ),
        (&[one, words(&absent)], "absent: cannot be read"),
    ] {
        let mut all = vec!["report"];
        all.extend(arguments);
        all.extend(["--out", words(&out)]);
        let message = refused(&all);
        assert!(message.contains(expected), "{message}");
    }
    let bad = super::reduce(&["report", path, "--start", "1"]);
    assert_eq!(bad.status.code(), Some(2));
    assert!(!out.exists());
}
