//! `gshear-reduce` through its binary, on made-up runs.

mod common;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::{Mutex, MutexGuard, PoisonError};

use common::{Fixture, strain_of};
use gshear::io::run_reader::Run;
use gshear::state::Frame;
use tempfile::TempDir;

/// Held by every test: a child process would inherit files that another test has open, and HDF5's locks on them.
fn alone() -> MutexGuard<'static, ()> {
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner)
}

fn reduce(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gshear-reduce"))
        .args(arguments)
        .output()
        .expect("the program runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("UTF-8")
}

/// A folder with the run of `fixture` in it.
fn folder_with(fixture: &Fixture) -> (TempDir, String) {
    let folder = tempfile::tempdir().expect("a folder");
    fixture.write(&folder.path().join("run.h5"));
    let path = folder.path().to_str().expect("UTF-8").to_string();
    (folder, path)
}

/// Asks for exit code 0 and nothing on standard error; returns standard output.
fn done(arguments: &[&str]) -> String {
    let output = reduce(arguments);
    assert_eq!(
        output.status.code(),
        Some(0),
        "{arguments:?}: {}",
        text(&output.stderr)
    );
    assert_eq!(text(&output.stderr), "");
    text(&output.stdout)
}

/// Asks for exit code 2 and one line on standard error; returns it.
fn refused(arguments: &[&str]) -> String {
    let output = reduce(arguments);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    assert_eq!(message.lines().count(), 1, "{message}");
    assert!(message.starts_with("error: "), "{message}");
    message
}

#[test]
fn what_was_written_is_read() {
    let _alone = alone();
    let fixture = Fixture::small();
    let (folder, _) = folder_with(&fixture);
    let run = Run::open(folder.path()).expect("a run");
    assert_eq!(*run.grains(), fixture.grains);
    assert_eq!(run.block(0..6).expect("frames"), fixture.frames);
    assert_eq!(run.frame(4).expect("a frame"), fixture.frames[4]);
    assert_eq!(run.block(2..2).expect("no frames"), Vec::<Frame>::new());
    assert_eq!(run.series().columns, fixture.series);
    assert_eq!(run.series().step, fixture.series_step);
    assert_eq!(
        (run.height(), run.digest()),
        (fixture.height, Some("00c0ffee00c0ffee"))
    );
    let strains = run.frame_strains().expect("strains");
    for (frame, strain) in fixture.frames.iter().zip(strains) {
        let expected = strain_of(frame.step, fixture.height);
        assert!(
            (strain - expected).abs() <= 1e-15 * expected,
            "{strain} against {expected}"
        );
    }
}

#[test]
fn a_run_that_was_stopped_early_is_read_as_far_as_it_goes() {
    let _alone = alone();
    let mut fixture = Fixture::small();
    fixture.digest = None;
    let (folder, path) = folder_with(&fixture);
    // As if the run had died between two datasets of a batch.
    let file = hdf5::File::open_rw(folder.path().join("run.h5")).expect("the file");
    file.dataset("particles/trajectory/angular_velocity/value")
        .expect("it")
        .resize([4, 48])
        .expect("resized");
    file.dataset("observables/coordination/value")
        .expect("it")
        .resize([33])
        .expect("resized");
    file.close().expect("closed");
    let run = Run::open(folder.path()).expect("a run");
    assert_eq!((run.frames(), run.series().rows()), (4, 33));
    assert_eq!(run.block(0..4).expect("frames"), fixture.frames[..4]);
    assert!(done(&["info", &path]).contains("stopped early"));
    drop(run);

    // Contacts that were not all written end the frames as well.
    let file = hdf5::File::open_rw(folder.path().join("run.h5")).expect("the file");
    let two: usize = fixture.frames[..2]
        .iter()
        .map(|frame| frame.contacts.len())
        .sum();
    file.dataset("connectivity/contacts/overlap")
        .expect("it")
        .resize([two + 1])
        .expect("resized");
    file.close().expect("closed");
    assert_eq!(Run::open(folder.path()).expect("a run").frames(), 2);
}

#[test]
fn info_tells_what_is_there() {
    let _alone = alone();
    let (_folder, path) = folder_with(&Fixture::small());
    let told = done(&["info", &path]);
    for part in [
        "48: 32 free, 8 in the bottom wall, 8 in the top wall",
        "6: step 0 … 5000",
        "51: step 0",
        "00c0ffee00c0ffee",
        "seed = 1",
    ] {
        assert!(told.contains(part), "{part} is not in\n{told}");
    }
}

#[test]
fn equal_runs_compare_equal() {
    let _alone = alone();
    let mut fixture = Fixture::small();
    fixture.series[7][3] = f64::NAN;
    fixture.frames[2].velocity[5][1] = f64::NAN;
    let ((_a, a), (_b, b)) = (folder_with(&fixture), folder_with(&fixture));
    let told = done(&["compare", &a, &format!("{b}/run.h5")]);
    assert!(told.ends_with("equal\n"), "{told}");
}

/// What `compare` prints of a fixture and a changed one, which must differ.
fn difference(change: impl Fn(&mut Fixture)) -> String {
    let mut changed = Fixture::small();
    let (_a, a) = folder_with(&changed);
    change(&mut changed);
    let (_b, b) = folder_with(&changed);
    let output = reduce(&["compare", &a, &b]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let told = text(&output.stdout);
    assert!(told.ends_with("different\n"), "{told}");
    told
}

/// The fields that differ, by the third column, and their lines.
fn differing(told: &str) -> Vec<String> {
    let row = |line: &str| {
        let (name, rest) = (line.get(..24)?.trim(), line.get(24..)?);
        let count: u64 = rest.split_whitespace().nth(1)?.parse().ok()?;
        (count > 0).then(|| format!("{name} {count}"))
    };
    told.lines().filter_map(row).collect()
}

#[test]
fn compare_finds_a_single_bit() {
    let _alone = alone();
    let told = difference(|run| {
        let value = &mut run.frames[3].position[17][0];
        *value = f64::from_bits(value.to_bits() ^ 1);
    });
    assert_eq!(differing(&told), ["position 1"]);
    assert!(told.contains("frame 3 grain 17 x"), "{told}");

    let told = difference(|run| run.frames[5].contacts[4].rolling_history *= -1.0);
    assert_eq!(differing(&told), ["c. rolling_history 1"]);
    let told = difference(|run| run.frames[1].angular_velocity[7] = -0.0);
    assert_eq!(
        differing(&told),
        ["angular_velocity 1"],
        "the sign of zero is a bit too"
    );
    let told = difference(|run| run.series[1][20] += 1e-3);
    assert_eq!(differing(&told), ["stress_ratio 1"]);
    assert!(told.contains("row 20"), "{told}");
}

#[test]
fn compare_finds_what_is_missing() {
    let _alone = alone();
    let told = difference(|run| {
        run.frames.pop();
    });
    assert!(told.contains("number of frames: 6 against 5"), "{told}");
    let told = difference(|run| {
        run.frames[2].contacts.remove(3);
    });
    assert_eq!(differing(&told), ["contacts 1"]);
    let told = difference(|run| {
        run.series_step.truncate(40);
        run.series.iter_mut().for_each(|column| column.truncate(40))
    });
    assert!(
        told.contains("rows of the time series: 51 against 40"),
        "{told}"
    );
    let told = difference(|run| run.digest = Some("1".into()));
    assert!(
        told.contains("digest: 00c0ffee00c0ffee against 1"),
        "{told}"
    );
}

#[test]
fn dmin_is_written_for_every_frame() {
    let _alone = alone();
    let mut fixture = Fixture::sheared(16, 12, 7);
    // Frame 3 is an affine map of frame 2: simple shear, which keeps the period.
    fixture.frames[3] = Frame {
        step: 3000,
        ..fixture.frames[2].clone()
    };
    let length = fixture.grains.length;
    fixture.frames[3]
        .position
        .iter_mut()
        .for_each(|r| r[0] = (r[0] + 0.01 * r[1]).rem_euclid(length));
    let (folder, path) = folder_with(&fixture);
    done(&["dmin", &path, "--threads", "2"]);
    assert!(!folder.path().join("reduced.h5.part").exists());

    let file = hdf5::File::open(folder.path().join("reduced.h5")).expect("reduced.h5");
    let values = file
        .dataset("dmin/value")
        .expect("values")
        .read_2d::<f64>()
        .expect("[T][N]");
    let strain = file
        .dataset("dmin/strain")
        .expect("strain")
        .read_1d::<f64>()
        .expect("[T]");
    assert_eq!((values.dim(), strain.len()), ((7, 192), 7));
    assert!(values.row(0).iter().all(|value| value.is_nan()));
    let radius = fixture.grains.mean_radius();
    for t in 1..7 {
        let mut contacts = vec![0; 192];
        for contact in &fixture.frames[t - 1].contacts {
            contacts[contact.i as usize] += 1;
            contacts[contact.j as usize] += 1;
        }
        for n in 0..192 {
            let few = contacts[n] <= if fixture.grains.body[n] == 0 { 2 } else { 1 };
            assert_eq!(values[[t, n]].is_nan(), few, "frame {t} grain {n}");
            if t == 3 && !few {
                assert!(
                    values[[t, n]] <= 1e-24 * radius * radius,
                    "grain {n}: {:e}",
                    values[[t, n]]
                );
            }
        }
    }
    assert!(values.iter().any(|value| *value > 1e-9 * radius * radius));

    let elsewhere = folder.path().join("elsewhere");
    done(&[
        "dmin",
        &path,
        "--threads",
        "1",
        "--out",
        elsewhere.to_str().expect("UTF-8"),
    ]);
    let file = hdf5::File::open(elsewhere.join("reduced.h5")).expect("reduced.h5");
    let again = file
        .dataset("dmin/value")
        .expect("values")
        .read_2d::<f64>()
        .expect("[T][N]");
    let bits = |values: &ndarray::Array2<f64>| {
        values
            .iter()
            .map(|value| value.to_bits())
            .collect::<Vec<_>>()
    };
    assert!(bits(&values) == bits(&again), "threads reach the numbers");
}

#[test]
fn phases_are_tabulated() {
    let _alone = alone();
    let mut fixture = Fixture::small();
    let tau: Vec<f64> = (0..51)
        .map(|row| {
            if row < 20 {
                f64::from(row)
            } else {
                100.0 - 0.25 * f64::from(row)
            }
        })
        .collect();
    fixture.series[1] = tau;
    let (folder, path) = folder_with(&fixture);
    let told = done(&["phases", &path]);
    assert!(told.contains("largest drop: Δτ_p = -7.5000e0"), "{told}");
    let csv = std::fs::read_to_string(folder.path().join("phases.csv")).expect("the table");
    let rows: Vec<Vec<&str>> = csv
        .lines()
        .skip(1)
        .map(|line| line.split(',').collect())
        .collect();
    assert_eq!(rows.len(), 2);
    assert_eq!(rows[0][..7], ["0", "stick", "long", "0", "20", "0", "2000"]);
    assert_eq!(
        rows[1][..7],
        ["1", "slip", "long", "20", "50", "2000", "5000"]
    );
    assert_eq!(
        (rows[0][9], rows[0][11], rows[1][11]),
        ("20", "95.0", "-7.5")
    );
    assert_eq!(rows[1][8].parse(), Ok(fixture.series[0][50]));
}

/// Checks that tags are nested and closed, that attributes are quoted, and that no `<` or `&` stands alone.
fn assert_well_formed(xml: &str, file: &Path) {
    let mut open: Vec<&str> = Vec::new();
    let mut rest = xml;
    while let Some(at) = rest.find('<') {
        let words = &rest[..at];
        for entity in words.match_indices('&').map(|(at, _)| &words[at..]) {
            let known = ["&lt;", "&gt;", "&amp;", "&quot;", "&apos;"];
            assert!(
                known.iter().any(|known| entity.starts_with(known)),
                "{}: {entity}",
                file.display()
            );
        }
        let end = at
            + rest[at..]
                .find('>')
                .unwrap_or_else(|| panic!("{}: an open tag", file.display()));
        let tag = &rest[at + 1..end];
        rest = &rest[end + 1..];
        assert!(
            !tag.contains('<') && tag.matches('"').count() % 2 == 0,
            "{}: <{tag}>",
            file.display()
        );
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name), "{}: </{name}>", file.display());
        } else if !tag.ends_with('/') && !tag.starts_with('!') {
            open.push(tag.split_whitespace().next().expect("a name"));
        }
    }
    assert!(
        open.is_empty(),
        "{}: {open:?} are not closed",
        file.display()
    );
}

/// Makes a report and returns the names of its files, each of them checked.
fn report_of(fixture: &Fixture) -> (Vec<String>, serde_json::Value, String) {
    let (folder, path) = folder_with(fixture);
    done(&["report", &path]);
    let entries = std::fs::read_dir(folder.path().join("report")).expect("the report");
    let mut files: Vec<PathBuf> = entries
        .map(|entry| entry.expect("an entry").path())
        .collect();
    files.sort();
    for file in files.iter().filter(|file| !file.ends_with("summary.json")) {
        assert_well_formed(&std::fs::read_to_string(file).expect("text"), file);
    }
    let read = |name: &str| {
        std::fs::read_to_string(folder.path().join("report").join(name)).expect("text")
    };
    let summary = serde_json::from_str(&read("summary.json")).expect("JSON");
    let names = files.iter().map(|file| {
        file.file_name()
            .expect("a name")
            .to_str()
            .expect("UTF-8")
            .to_string()
    });
    (names.collect(), summary, read("index.html"))
}

#[test]
fn a_report_has_every_figure_and_needs_nothing_else() {
    let _alone = alone();
    let (names, summary, page) = report_of(&Fixture::sheared(16, 12, 20));
    let expected = [
        "dmin.svg",
        "force-change.svg",
        "force-network-after.svg",
        "force-network-before.svg",
        "index.html",
        "largest-drop.svg",
        "phase-histogram.svg",
        "stress-strain.svg",
        "summary.json",
    ];
    assert_eq!(names, expected);
    assert_eq!(page.matches("<svg ").count(), 7);
    assert!(page.contains("Made up &lt;for&gt; tests &amp; nothing else"));
    let links = page.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
    assert!(
        !links.contains("http") && !links.contains("src=") && !links.contains("href="),
        "the page stands alone"
    );
    assert_eq!(summary["digest"], "00c0ffee00c0ffee");
    assert_eq!(summary["grains"], 192);
    let [earlier, later] = [0, 1].map(|k| summary["maps"]["frames"][k].as_u64().expect("a frame"));
    assert!(earlier < later && later < 20);
}

#[test]
fn a_summary_has_the_numbers_of_the_run() {
    let _alone = alone();
    let mut fixture = Fixture::small();
    // Strain 0 … 50, τ = 1 in the first half, then 2 and 4 in turn: mean 3, deviation 1 but for the odd row.
    fixture.series[0] = (0..51).map(f64::from).collect();
    fixture.series[1] = (0..51)
        .map(|row| {
            if row < 25 {
                1.0
            } else {
                f64::from(2 + 2 * (row % 2))
            }
        })
        .collect();
    let (_, summary, _) = report_of(&fixture);
    // Rows 25 … 50: 13 times 4, 13 times 2.
    assert_eq!(summary["stress_ratio_latter_half"]["mean"], 3.0);
    assert_eq!(
        summary["stress_ratio_latter_half"]["standard_deviation"],
        1.0
    );
    assert_eq!(
        summary["phases"]["stick"],
        serde_json::json!({ "long": 1, "short": 12 })
    );
    assert_eq!(
        summary["phases"]["slip"],
        serde_json::json!({ "long": 0, "short": 13 })
    );
    assert_eq!(summary["largest_drop"]["delta_tau"], -2.0);
    assert_eq!(summary["largest_drop"]["rows"], serde_json::json!([25, 26]));
    // Frames are every tenth row.
    assert_eq!(summary["maps"]["frames"], serde_json::json!([2, 3]));
}

#[test]
fn a_report_of_next_to_nothing_says_so() {
    let _alone = alone();
    let mut fixture = Fixture::small();
    fixture.frames.clear();
    fixture.digest = None;
    let (names, summary, page) = report_of(&fixture);
    assert!(
        !names.contains(&"dmin.svg".to_string())
            && names.contains(&"stress-strain.svg".to_string())
    );
    assert!(summary["maps"].is_null() && summary["digest"].is_null());
    assert!(page.contains("there are no maps") && page.contains("stopped early"));

    fixture.series.iter_mut().for_each(Vec::clear);
    fixture.series_step.clear();
    let (_, summary, _) = report_of(&fixture);
    assert!(summary["largest_drop"].is_null());
}

#[test]
fn a_missing_or_foreign_file_is_refused() {
    let _alone = alone();
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| {
        folder
            .path()
            .join(name)
            .to_str()
            .expect("UTF-8")
            .to_string()
    };
    assert!(refused(&["info", &at("none.h5")]).contains("none.h5: cannot be read"));
    assert!(refused(&["info", &at("")]).contains("run.h5: cannot be read"));
    std::fs::write(at("text.h5"), "step,time\n0,0\n").expect("written");
    assert!(refused(&["report", &at("text.h5")]).contains("text.h5: is not an HDF5 file"));
    std::fs::write(at("empty.h5"), "").expect("written");
    assert!(refused(&["dmin", &at("empty.h5")]).contains("empty.h5: is not an HDF5 file"));
    hdf5::File::create(at("other.h5"))
        .expect("made")
        .close()
        .expect("closed");
    let message = refused(&["phases", &at("other.h5")]);
    assert!(
        message.contains("other.h5: particles/trajectory/id is missing: not a run of gshear-mpi"),
        "{message}"
    );
    assert!(
        !folder.path().join("phases.csv").exists(),
        "nothing is written"
    );
}

/// Message about a run after a change of its file.
fn refusal(change: impl Fn(&hdf5::File) -> hdf5::Result<()>) -> String {
    let (folder, path) = folder_with(&Fixture::small());
    let file = hdf5::File::open_rw(folder.path().join("run.h5")).expect("the file");
    change(&file).expect("changed");
    file.close().expect("closed");
    let message = refused(&["report", &path]);
    assert!(
        message.contains("run.h5: ") && !folder.path().join("report").exists(),
        "{message}"
    );
    message
}

#[test]
fn a_damaged_run_is_refused_and_the_object_named() {
    let _alone = alone();
    let (folder, path) = folder_with(&Fixture::small());
    let file = folder.path().join("run.h5");
    let bytes = std::fs::read(&file).expect("bytes");
    std::fs::write(&file, &bytes[..bytes.len() / 2]).expect("cut");
    assert!(refused(&["info", &path]).contains("run.h5: is damaged"));

    let cases: [(&str, &str); 4] = [
        ("particles/trajectory/position/value", "is missing"),
        ("connectivity", "connectivity/contacts/offset is missing"),
        (
            "observables/stress_ratio",
            "observables/stress_ratio/value is missing",
        ),
        ("parameters", "parameters is missing"),
    ];
    for (object, expected) in cases {
        let message = refusal(|file| file.unlink(object));
        assert!(
            message.contains(object) && message.contains(expected),
            "{message}"
        );
    }
    let message = refusal(|file| {
        file.dataset("particles/trajectory/velocity/value")?
            .resize([5, 48, 3])
    });
    assert!(
        message.contains("velocity/value: holds 5 frames where") && message.contains("holds 6"),
        "{message}"
    );
    let message = refusal(|file| {
        file.dataset("particles/trajectory/velocity/value")?
            .resize([6, 48, 2])
    });
    assert!(
        message.contains("velocity/value: has the shape [6, 48, 2]"),
        "{message}"
    );
    let message = refusal(|file| {
        file.dataset("connectivity/contacts/j")?
            .write_slice(&[48u32], 0..1)
    });
    assert!(
        message.contains("connectivity/contacts: row 0") && message.contains("i < j < 48"),
        "{message}"
    );
    let message = refusal(|file| {
        file.dataset("connectivity/contacts/offset")?
            .write_slice(&[9_999_999u64], 1..2)
    });
    assert!(
        message.contains("connectivity/contacts/offset: decreases at frame 2"),
        "{message}"
    );
}

#[test]
fn bad_arguments_are_refused() {
    let _alone = alone();
    let (_folder, path) = folder_with(&Fixture::small());
    assert!(refused(&["dmin", &path, "--radius", "-1"]).contains("--radius -1"));
    for arguments in [
        &["melt", &path][..],
        &["info"],
        &["info", &path, "--threads", "0"],
    ] {
        assert_eq!(reduce(arguments).status.code(), Some(2), "{arguments:?}");
    }
}
