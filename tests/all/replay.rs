//! `gshear-reduce replay` and the report that replays: frames that were never stored, to the last
//! bit.

use std::path::{Path, PathBuf};
use std::process::Output;

use crate::common::crossing::{PACKED, SCENE};
use crate::common::{self, gshear_mpi, reducer};
use gshear_dem::state::Frame;
use gshear_store::checksums::{self, FRAMES, ROWS, of_numbers, weights};
use gshear_store::run_reader::RunFile;
use nalgebra::{DMatrix, Vector3};

const SPHERES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing-3d.toml");

fn run(scene: &str, ranks: usize, folder: &Path, set: &[&str]) {
    let sample = if scene == SCENE { &PACKED[..] } else { &[] };
    let mut arguments = vec![scene.to_string()];
    arguments.extend(sample.iter().chain(set).map(|s| format!("--set={s}")));
    gshear_mpi(ranks, folder, &arguments).digest();
}

fn reduce(arguments: &[&str]) -> Output {
    let mut command = reducer();
    command
        .args(arguments)
        .output()
        .expect("the program starts")
}

/// What it said, after it has ended with this code.
fn said(output: &Output, code: i32) -> String {
    let text = [&output.stdout[..], &output.stderr].concat();
    let text = String::from_utf8(text).expect("text");
    assert_eq!(output.status.code(), Some(code), "{text}");
    text
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a path in UTF-8")
}

/// All that is stored of the frames of these steps.
fn frames(folder: &Path, steps: &[u64]) -> Vec<Frame> {
    let run = RunFile::open(folder).expect("a run");
    let at = |step: &u64| run.frame_steps().binary_search(step).expect("a frame");
    let read = |step: &u64| run.frame(at(step)).expect("a frame");
    steps.iter().map(read).collect()
}

#[test]
fn a_window_is_that_of_the_run_with_frames() {
    let temporary = tempfile::tempdir().expect("a folder");
    let folder = |name: &str| -> PathBuf { temporary.path().join(name) };
    // A frame a row, of the same run.
    run(SCENE, 1, &folder("frames"), &["output.frame_strain=0.005"]);
    let kept = [
        "output.frame_strain=0",
        "output.keep_checkpoints=true",
        "output.checkpoint_strain=0.25",
        "analysis.scalars=true",
        "analysis.strain=0.005",
    ];
    run(SCENE, 2, &folder("kept"), &kept);
    let whole = RunFile::open(&folder("frames")).expect("a run");
    let strain = whole.series().column("strain").to_vec();

    // From the first state, across a checkpoint, from a row that has one, to the last row.
    let checkpoint = strain.iter().position(|s| *s > 0.24).expect("a row");
    for (k, [from, to]) in [
        [0.0, 0.03],
        [0.2, 0.3],
        [strain[checkpoint], 0.4],
        [0.9, 1.0],
    ]
    .into_iter()
    .enumerate()
    {
        let out = folder(&format!("replay-{k}"));
        let window = format!("{from}..{to}");
        let threads = ["--threads", ["1", "2"][k % 2]];
        let arguments = [
            "replay",
            text(&folder("kept")),
            "--strain",
            &window,
            "--out",
            text(&out),
        ]
        .map(String::from);
        let all: Vec<&str> = arguments
            .iter()
            .map(String::as_str)
            .chain(threads)
            .collect();
        let words = said(&reduce(&all), 0);
        assert!(words.contains("to the last bit"), "{words}");
        let rows = (0..strain.len()).filter(|row| strain[*row] >= from && strain[*row] <= to);
        let steps: Vec<u64> = rows.map(|row| whole.series().step[row]).collect();
        let again = RunFile::open(&out).expect("a run");
        assert_eq!(again.frame_steps(), steps, "{window}");
        assert!(
            frames(&out, &steps) == frames(&folder("frames"), &steps),
            "{window}"
        );
    }

    // Denser than rows.
    let (out, kept) = (folder("dense"), folder("kept"));
    let run = [
        "replay",
        text(&kept),
        // Rows are within half a step of their strains.
        "--strain=0.298..0.322",
        "--every=7",
        "--out",
        text(&out),
    ];
    said(&reduce(&run), 0);
    let again = RunFile::open(&out).expect("a run");
    let steps = again.frame_steps();
    assert!(steps.len() > 10 && steps.windows(2).all(|w| w[1] - w[0] == 7));
}

#[test]
fn spheres_under_a_spring_are_replayed() {
    let temporary = tempfile::tempdir().expect("a folder");
    // Contacts of JKR hold grains together that no longer overlap.
    let adhering = ["contact.surface_energy=2.0", "contact.adhesion=jkr"];
    let flat = ["sample.walls=flat"];
    for (name, sets) in [("run", &[][..]), ("adhering", &adhering), ("flat", &flat)] {
        let folder = temporary.path().join(name);
        // The protocol writes a checkpoint at the end of every part.
        let sets = [&["output.keep_checkpoints=true"], sets].concat();
        run(SPHERES, 1, &folder, &sets);
        let whole = RunFile::open(&folder).expect("a run");
        let strain = whole.series().column("strain");
        let [from, to] = [0.6, 0.7].map(|part| strain[(part * strain.len() as f64) as usize]);
        let window = format!("{from:?}..{to:?}");
        let words = said(&reduce(&["replay", text(&folder), "--strain", &window]), 0);
        assert!(words.contains("to the last bit"), "{name}: {words}");
    }
}

/// `dmin` of spheres against least squares by SVD over neighbours from all images; `export` and
/// `compare` against the file.
#[test]
fn frames_of_spheres_are_reduced_exported_and_compared() {
    let temporary = tempfile::tempdir().expect("a folder");
    let folder = temporary.path().join("run");
    run(SPHERES, 2, &folder, &[]);
    let whole = RunFile::open(&folder).expect("a run");
    let frames = whole.records(0..whole.frames()).expect("the frames");
    let n = whole.grains().count();
    assert!(frames.len() > 20 && n > 500);

    // Its report has pictures of them.
    said(&reduce(&["report", text(&folder)]), 0);
    for name in ["grains-velocity", "grains-displacement", "forces-3d"] {
        for end in ["svg", "csv"] {
            let path = folder.join("report").join(format!("{name}.{end}"));
            assert!(path.is_file(), "{}", path.display());
        }
    }

    let other = temporary.path().join("other.h5");
    std::fs::copy(folder.join("run.h5"), &other).expect("a copy");
    common::change_file(&other, |copy| {
        let spins = copy
            .dataset("particles/trajectory/angular_velocity/value")
            .expect("ω");
        let mut values = spins.read_raw::<f64>().expect("f64");
        values[(5 * n + 17) * 3 + 1] += 1.0;
        spins.write_raw(&values).expect("ω is written");
        // A sound file of other numbers.
        let sums = copy.dataset(FRAMES).expect("checksums");
        let mut of_frames = sums.read_2d::<u64>().expect("u64");
        let of_frame = &values[5 * 3 * n..][..3 * n];
        // After step and time, positions and velocities.
        of_frames[[5, 3]] = of_numbers(&weights(0, 3 * n), of_frame);
        sums.write(&of_frames).expect("written");
    });
    let runs = [text(&folder), text(&other)];
    let words = said(&reduce(&["compare", runs[0], runs[0]]), 0);
    let values = |name: &str| -> usize {
        let line = words.lines().find(|l| l.starts_with(name)).expect("a line");
        let mut numbers = line[name.len()..].split_whitespace();
        numbers.next().expect("a number").parse().expect("a number")
    };
    assert_eq!(values("angular_velocity "), 3 * n * frames.len());
    assert_eq!(values("image "), 3 * n * frames.len());
    assert_eq!(
        values("c. tangential_force "),
        3 * values("c. normal_force ")
    );
    let words = said(&reduce(&["compare", runs[0], runs[1]]), 1);
    let differs = |line: &&str| line.contains("frame 5 grain 17 y");
    assert_eq!(words.lines().filter(differs).count(), 1, "{words}");

    let file = temporary.path().join("state.data");
    let export = ["export", "--format", "lammps-data", "--out", text(&file)];
    said(
        &reduce(&[&export[..], &[runs[0], "--frame", "3"]].concat()),
        0,
    );
    let data = std::fs::read_to_string(&file).expect("a data file");
    let rows = |section: &str, from: usize| -> Vec<Vec<f64>> {
        let after = data.split_once(section).expect("the section").1;
        let lines = after.lines().skip(1).filter(|l| !l.is_empty()).take(n);
        let numbers = |l: &str| {
            l.split_whitespace()
                .skip(from)
                .map(|x| x.parse().expect("a number"))
                .collect()
        };
        lines.map(numbers).collect()
    };
    let (places, motions) = (rows("Atoms", 4), rows("Velocities", 1));
    for (grain, (place, motion)) in frames[3].grains.iter().zip(places.iter().zip(&motions)) {
        assert_eq!(place[..3], grain.position);
        assert_eq!(motion[..3], grain.velocity);
        assert_eq!(motion[3..], grain.angular_velocity);
    }

    said(&reduce(&["dmin", runs[0]]), 0);
    let reduced = hdf5::File::open(folder.join("reduced.h5")).expect("reduced.h5");
    let dmin: Vec<f64> = reduced
        .dataset("dmin/value")
        .and_then(|d| d.read_raw())
        .expect("D²min");
    let periods = whole.periods();
    let radius = 5.0 * whole.grains().mean_radius();
    let t = frames.len() / 2;
    let (earlier, later) = (&frames[t - 1], &frames[t]);
    let mut contacts = vec![0; n];
    for contact in &earlier.contacts {
        contacts[contact.i as usize] += 1;
        contacts[contact.j as usize] += 1;
    }
    let bears = |g: usize| contacts[g] > if whole.grains().body[g] == 0 { 3 } else { 2 };
    let apart = |frame: &Frame, i: usize, j: usize| {
        let mut r =
            Vector3::from(frame.grains[j].position) - Vector3::from(frame.grains[i].position);
        for axis in 0..2 {
            let images = [-1.0, 0.0, 1.0].map(|k| r[axis] + k * periods[axis]);
            r[axis] = images
                .into_iter()
                .min_by(|a, b| a.abs().total_cmp(&b.abs()))
                .expect("an image");
        }
        r
    };
    let place = |frame: &Frame, g: usize, axis: usize| {
        let grain = &frame.grains[g];
        let turns = if axis < 2 {
            grain.image[axis] as f64 * periods[axis]
        } else {
            0.0
        };
        grain.position[axis] + turns
    };
    let moved = |g: usize, axis: usize| place(later, g, axis) - place(earlier, g, axis);
    let mut centres = 0;
    for i in 0..n {
        let value = dmin[t * n + i];
        if !bears(i) {
            assert!(value.is_nan(), "rattler {i} has {value:e}");
            continue;
        }
        let near: Vec<usize> = (0..n)
            .filter(|&j| j != i && bears(j) && apart(earlier, i, j).norm() < radius)
            .collect();
        let row = |k: usize| apart(earlier, i, near[k]).transpose();
        let before = DMatrix::from_fn(near.len(), 3, |k, axis| row(k)[axis]);
        // The image that was near goes on.
        let after = DMatrix::from_fn(near.len(), 3, |k, axis| {
            row(k)[axis] + moved(near[k], axis) - moved(i, axis)
        });
        let map = before
            .clone()
            .svd(true, true)
            .solve(&after, 0.0)
            .expect("U and V");
        let wanted = (before * map - after).norm_squared() / near.len() as f64;
        assert!(
            (value - wanted).abs() <= 1e-9 * wanted,
            "grain {i}: {value:e} against {wanted:e}"
        );
        centres += 1;
    }
    assert!(centres > 200 && centres < n, "{centres} of {n}");
}

#[test]
fn another_time_series_is_noticed() {
    let temporary = tempfile::tempdir().expect("a folder");
    let folder = temporary.path().join("run");
    let set = [
        "output.keep_checkpoints=true",
        "shear.strain=0.2",
        "output.checkpoint_strain=0.05",
    ];
    run(SCENE, 1, &folder, &set);
    let arguments = ["replay", text(&folder), "--strain=0.1..0.12"];
    said(&reduce(&arguments), 0);

    let run = RunFile::open(&folder).expect("a run");
    let row = run.series().column("strain").iter().position(|s| *s > 0.11);
    let row = row.expect("a row");
    let series = run.series().clone();
    let step = series.step[row];
    drop(run);
    common::change_file(&folder.join("run.h5"), |file| {
        let column = file.dataset("observables/coordination/value");
        let column = column.expect("a column");
        let mut values = column.read_raw::<f64>().expect("values");
        values[row] = f64::from_bits(values[row].to_bits() ^ 1);
        column.write_raw(&values).expect("written");
        // A sound file of other numbers.
        let of_row = series
            .declared
            .iter()
            .zip(&series.columns)
            .map(|(column, of)| {
                let is_changed = column.name == "coordination";
                (column.name, if is_changed { values[row] } else { of[row] })
            });
        let sums = file.dataset(ROWS).expect("checksums");
        let mut of_rows = sums.read_raw::<u64>().expect("u64");
        of_rows[row] = checksums::of_row(step, series.time[row], of_row);
        sums.write_raw(&of_rows).expect("written");
    });
    let words = said(&reduce(&arguments), 3);
    let place = format!("first at step {step}, coordination is");
    assert!(words.contains(&place) && words.contains("1 of "), "{words}");
}

#[test]
fn what_cannot_be_replayed_is_refused() {
    let temporary = tempfile::tempdir().expect("a folder");
    let folder = temporary.path().join("run");
    run(SCENE, 1, &folder, &["shear.strain=0.1"]);
    for (arguments, wanted) in [
        (
            &["--strain=0.02..0.04"][..],
            "there is no checkpoint of the stage shear before step",
        ),
        (
            &["--strain=0.3..0.4"],
            "has fewer than two rows of the time series",
        ),
        (&["--strain=0.04..0.02"], "is no range; write it as"),
        (&["--strain=0.04"], "is no range; write it as"),
    ] {
        let words = said(
            &reduce(&[&["replay", text(&folder)], arguments].concat()),
            2,
        );
        assert!(words.contains(wanted), "{words}");
    }
    let kept = temporary.path().join("kept");
    run(
        SCENE,
        1,
        &kept,
        &["shear.strain=0.1", "output.keep_checkpoints=true"],
    );
    let itself = [
        "replay",
        text(&kept),
        "--strain=0.02..0.04",
        "--out",
        text(&kept),
    ];
    assert!(said(&reduce(&itself), 2).contains("holds the run itself"));
}

/// The maps of a report with a few frames are those of one with a frame for every row.
#[test]
fn the_report_replays_the_largest_drop() {
    let temporary = tempfile::tempdir().expect("a folder");
    let report = |name: &str, set: &[&str]| -> PathBuf {
        let folder = temporary.path().join(name);
        let mut all = vec!["output.series_strain=0.002"];
        all.extend(set);
        run(SCENE, 1, &folder, &all);
        said(&reduce(&["report", text(&folder)]), 0);
        folder.join("report")
    };
    let whole = report("whole", &["output.frame_strain=0.002"]);
    let kept = [
        "output.keep_checkpoints=true",
        "output.checkpoint_strain=0.25",
    ];
    let coarse = report(
        "coarse",
        &[&kept[..], &["output.frame_strain=0.02"]].concat(),
    );
    let none = report("none", &["output.frame_strain=0"]);
    // The files of a replay go once it is shown.
    assert!(!coarse.join("replay").exists() && !whole.join("replay").exists());
    for figure in [
        "dmin",
        "force-change",
        "force-network-before",
        "force-network-after",
    ] {
        let data = |report: &Path| std::fs::read(report.join(format!("{figure}.csv"))).ok();
        assert!(data(&whole).is_some_and(|of| of.len() > 1000), "{figure}");
        assert!(data(&whole) == data(&coarse), "{figure} differs");
        assert_eq!(data(&none), None);
    }
    assert_shows_the_drop(&whole, &coarse);

    // Without a checkpoint before the drop a line says so.
    let told = said(
        &reduce(&["report", text(&temporary.path().join("none"))]),
        0,
    );
    let words = "is shown by the nearest frames: there is no checkpoint before step ";
    assert!(!told.contains("  "), "{told}");
    assert!(
        told.contains(&format!("the largest drop {words}")),
        "{told}"
    );

    // Without a replay the maps show what there is, and say that it is not the drop.
    let folder = temporary.path().join("coarse");
    let out = temporary.path().join("frames");
    let told = said(
        &reduce(&["report", text(&folder), "--no-replay", "--out", text(&out)]),
        0,
    );
    assert!(
        !told.contains("replay") && !out.join("replay").exists(),
        "{told}"
    );
    let page = std::fs::read_to_string(out.join("index.html")).expect("a page");
    assert!(page.contains("at the last frame before the drop: step "));
    assert!(page.contains("The maps show the frames around the largest drop"));
    let told = said(&reduce(&["report", text(&folder)]), 0);
    let words = "for the largest drop, about 1s (--no-replay leaves it out)\n";
    assert!(
        told.contains("replays steps ") && told.contains(words),
        "{told}"
    );
    let page = std::fs::read_to_string(none.join("index.html")).expect("a page");
    assert!(page.contains("there are no maps"));
    // All are made and kept if asked for.
    said(&reduce(&["report", text(&folder), "--replay"]), 0);
    assert!(coarse.join("replay/run.h5").is_file() && coarse.join("replay-dmin/run.h5").is_file());
}

/// The states that a report shows are those right before and after the drop, and say so; the
/// greatest D²min is found between two rows. `whole`: the report of the run with a frame per row.
fn assert_shows_the_drop(whole: &Path, report: &Path) {
    let numbers = |report: &Path| -> serde_json::Value {
        let text = std::fs::read_to_string(report.join("summary.json")).expect("numbers");
        serde_json::from_str(&text).expect("JSON")
    };
    let found = numbers(report);
    let number = |of: &serde_json::Value| of.as_f64().expect("a number");
    let tau = [0, 1].map(|k| number(&found["maps"]["stress_ratio"][k]));
    let drop = number(&found["largest_drop"]["delta_tau"]);
    assert!(drop < 0.0 && tau[1] - tau[0] == drop, "{tau:?} {drop}");
    let page = std::fs::read_to_string(report.join("index.html")).expect("a page");
    for (when, tau) in [("before", tau[0]), ("after", tau[1])] {
        let words = format!("Force network right {when} the drop: step ");
        let caption = page.split(&words).nth(1).expect("a caption");
        let caption = caption.split("Lines join").next().expect("its beginning");
        assert!(caption.contains(&format!("τ = {tau:.4}")), "{caption}");
    }
    let greatest = &found["greatest_dmin"];
    let steps = |of: &serde_json::Value| [0, 1].map(|k| of["steps"][k].as_u64().expect("a step"));
    let [from, to] = steps(greatest);
    let rows = steps(&numbers(whole)["greatest_dmin"]);
    assert_eq!(to - from, rows[1] - rows[0]);
    assert!(!report.join("replay-dmin").exists());
    assert!(page.contains("The greatest D²<sub>min</sub> of the run"));
}

/// The stages of a run that stored its scalars and checkpoints are those of the run that stored its
/// frames.
#[test]
fn stages_replay_the_largest_drop() {
    let temporary = tempfile::tempdir().expect("a folder");
    let folder = |name: &str| -> PathBuf { temporary.path().join(name) };
    run(SCENE, 1, &folder("frames"), &["output.frame_strain=0.005"]);
    let kept = [
        "output.frame_strain=0",
        "output.keep_checkpoints=true",
        "output.checkpoint_strain=0.25",
        "analysis.scalars=true",
        "analysis.strain=0.005",
    ];
    run(SCENE, 1, &folder("kept"), &kept);
    let stages = |name: &str| {
        let out = folder(&format!("stages-{name}"));
        let run = folder(name);
        said(&reduce(&["stages", text(&run), "--out", text(&out)]), 0);
        out
    };
    let (one, other) = (stages("frames"), stages("kept"));
    for name in ["stages", "stages-steps", "stages-grains", "stages-contacts"] {
        let read = |folder: &Path| std::fs::read(folder.join(format!("{name}.csv"))).expect(name);
        assert!(read(&one) == read(&other), "{name} differs");
    }
    assert!(other.join("replay/run.h5").is_file() && !one.join("replay").exists());
}

/// `stability --birth` finds the rows that a run with a frame per row shows: there is no pair in
/// the first state, whose tangential forces are zero, and one in the first row.
#[test]
fn the_birth_of_a_pair_is_found_in_rows_that_had_no_frame() {
    let temporary = tempfile::tempdir().expect("a folder");
    let [frames, kept] = ["frames", "kept"].map(|name| temporary.path().join(name));
    let part = "shear.strain=0.03";
    run(SCENE, 1, &frames, &[part, "output.frame_strain=0.005"]);
    let set = [
        part,
        "output.frame_strain=0.03",
        "output.keep_checkpoints=true",
    ];
    run(SCENE, 1, &kept, &set);
    said(&reduce(&["stability", text(&frames)]), 0);
    let table = std::fs::read_to_string(frames.join("stability.csv")).expect("a table");
    let rows: Vec<Vec<&str>> = table.lines().map(|l| l.split(',').collect()).collect();
    let column = |name: &str| rows[0].iter().position(|c| *c == name).expect("a column");
    let (step, pairs) = (column("step"), column("pairs"));
    let first = rows.iter().skip(1).position(|row| row[pairs] != "0.0");
    let first = first.expect("a pair");
    assert!(first > 0, "{table}");
    let words = said(&reduce(&["stability", text(&kept), "--birth"]), 0);
    let [before, after] = [first, first + 1].map(|row| rows[row][step]);
    let found = format!("birth: a complex pair between steps {before} and {after}, ");
    assert!(words.contains(&found), "{words}\n{table}");
    // The frames before and after are whole frames of a run.
    let again = RunFile::open(&kept.join("birth")).expect("a run");
    assert_eq!(again.frame_steps()[0].to_string(), rows[1][step]);

    // From a frame with a pair on there is no birth, and without a checkpoint no replay.
    let late = ["stability", text(&frames), "--birth", "--frames", "2.."];
    let words = said(&reduce(&late), 0);
    assert!(words.contains("has a complex pair already"), "{words}");
    let first_state = ["stability", text(&frames), "--birth", "--frames", "0..0"];
    let words = said(&reduce(&first_state), 0);
    assert!(words.contains("none of these frames"), "{words}");
}
