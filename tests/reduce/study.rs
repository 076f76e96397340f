//! `regions`, `correlate` and `report --study`.

use std::collections::BTreeMap;
use std::path::Path;

use gshear_analysis::frame_scalars::{FrameScalars, ScalarScratch, Stressed, frame_scalars};
use gshear_analysis::stress::ratio_on_top;
use tempfile::TempDir;

use crate::fixture::Fixture;
use crate::results::assert_well_formed;
use crate::{alone, are_described, done, folder_with, reduce, refused};

/// A table by its columns, every line as long as the header.
fn table(path: &Path) -> BTreeMap<String, Vec<String>> {
    let mut reader = csv::Reader::from_path(path).expect("a table");
    let names = reader.headers().expect("a header").clone();
    let mut columns: Vec<Vec<String>> = vec![Vec::new(); names.len()];
    for row in reader.records() {
        let row = row.unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        for (column, cell) in columns.iter_mut().zip(&row) {
            column.push(cell.into());
        }
    }
    names.iter().map(String::from).zip(columns).collect()
}

fn numbers(column: &[String]) -> Vec<f64> {
    column
        .iter()
        .map(|cell| cell.parse().expect("a number"))
        .collect()
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

#[test]
fn the_scalars_of_every_frame_are_those_of_its_pair() {
    let _alone = alone();
    let fixture = Fixture::sheared(16, 12, 30);
    let (folder, path) = folder_with(&fixture);
    done(&["regions", &path, "--threads", "2"]);
    let found = table(&folder.path().join("regions.csv"));
    let tau: Vec<f64> = (0..30).map(|t| fixture.series[1][10 * t]).collect();
    assert_eq!(numbers(&found["stress_ratio"]), tau);
    let mut rows = vec![[f64::NAN; FrameScalars::COLUMNS.len()]];
    for pair in fixture.frames.windows(2) {
        let of = |k: usize| Stressed::new(&fixture.grains, pair[k].clone());
        let scalars = frame_scalars(
            &fixture.grains,
            &of(0),
            &of(1),
            &mut ScalarScratch::default(),
        );
        rows.push(scalars.columns());
    }
    for (k, name) in FrameScalars::COLUMNS.iter().enumerate() {
        let wanted: Vec<f64> = rows.iter().map(|row| row[k]).collect();
        assert_eq!(bits(&numbers(&found[name.name])), bits(&wanted), "{name}");
    }
    let once = std::fs::read(folder.path().join("regions.csv")).expect("the table");
    done(&["regions", &path, "--threads", "1"]);
    assert!(once == std::fs::read(folder.path().join("regions.csv")).expect("the table"));
}

#[test]
fn frames_between_the_rows_of_the_series_have_the_tau_of_their_contacts() {
    let _alone = alone();
    let mut fixture = Fixture::small();
    fixture.series_step.iter_mut().for_each(|step| *step += 7);
    let (folder, path) = folder_with(&fixture);
    done(&["regions", &path]);
    let found = numbers(&table(&folder.path().join("regions.csv"))["stress_ratio"]);
    let wanted: Vec<f64> = fixture
        .frames
        .iter()
        .map(|f| ratio_on_top(&fixture.grains, f))
        .collect();
    assert!(wanted.iter().all(|tau| tau.is_finite()));
    assert_eq!(bits(&found), bits(&wanted));
}

#[test]
fn the_measures_of_a_phase_are_those_of_its_frames() {
    let _alone = alone();
    let (folder, path) = folder_with(&Fixture::sheared(16, 12, 60));
    done(&["regions", &path]);
    done(&["correlate", &path]);
    let tables = ["regions.csv", "measures.csv", "correlations.csv"];
    are_described(folder.path(), &tables);
    let frames = table(&folder.path().join("regions.csv"));
    let phases = table(&folder.path().join("measures.csv"));
    let (strain, one) = (
        numbers(&frames["strain"]),
        numbers(&frames["dmin_greatest"]),
    );
    let (regions, angle) = (
        numbers(&frames["regions"]),
        numbers(&frames["region_angle_mean"]),
    );
    let row = |cell: &String| {
        strain
            .iter()
            .position(|s| *s == cell.parse::<f64>().expect("γ"))
            .expect("a row")
    };
    assert!(phases["phase"].len() > 10);
    for (k, length) in phases["length"].iter().enumerate() {
        let rows = row(&phases["start_strain"][k]) + 1..row(&phases["end_strain"][k]) + 1;
        let value = |name: &str| phases[name][k].parse::<f64>().expect("a number");
        let most = rows.clone().map(|t| one[t]).fold(0.0, f64::max);
        assert_eq!(value("dmin_max"), most);
        let least = rows
            .clone()
            .map(|t| regions[t])
            .fold(f64::INFINITY, f64::min);
        assert_eq!(value("regions_least"), least);
        let first = rows.clone().find(|t| regions[*t] == least).expect("a row");
        let sum: f64 = (first..rows.end).map(|t| one[t]).sum();
        assert!((value("dmin_sum") / sum - 1.0).abs() < 1e-14);
        let last = rows
            .clone()
            .rev()
            .find(|t| regions[*t] == least)
            .expect("a row");
        assert_eq!(value("angle_mean").to_bits(), angle[last].to_bits());
        assert_eq!(length == "long", rows.len() > 3);
    }
    // Every phase whose |Δτ_p| is at least 1e-5 is in one range of each correlation over all phases.
    let correlations = table(&folder.path().join("correlations.csv"));
    let within = numbers(&phases["delta_tau_p"]);
    let within = within.iter().filter(|change| change.abs() >= 1e-5).count();
    let rows = 0..correlations["of"].len();
    let of = |with: &str, over: &str| -> usize {
        let rows = rows
            .clone()
            .filter(|k| correlations["with"][*k] == with && correlations["over"][*k] == over);
        rows.map(|k| correlations["pairs"][k].parse::<usize>().expect("a count"))
            .sum()
    };
    assert_eq!(of("dmin_max", "all"), within);
    assert_eq!(of("top_sum", "long") + of("top_sum", "short"), within);

    // The regions are counted, and the ranges cut, as it is asked for.
    let ranges = correlations["of"].len();
    done(&[
        "correlate",
        &path,
        "--reduction",
        "losses",
        "--bins",
        "half-decades",
    ]);
    let by_losses = table(&folder.path().join("measures.csv"));
    let regions = numbers(&frames["loss_regions"]);
    for (k, least) in numbers(&by_losses["regions_least"]).into_iter().enumerate() {
        let rows = row(&by_losses["start_strain"][k]) + 1..row(&by_losses["end_strain"][k]) + 1;
        let counted = rows.map(|t| regions[t]).fold(f64::INFINITY, f64::min);
        assert_eq!(least, counted);
    }
    let halves = table(&folder.path().join("correlations.csv"));
    assert!(halves["of"].len() > ranges);
    assert!(halves["to"].contains(&"inf".to_string()));
    let message = refused(&["report", &path, "--bins", "half-decades"]);
    assert!(
        message.contains("belong to --study lee-hurley"),
        "{message}"
    );
}

#[test]
fn scalars_that_the_run_has_computed_are_taken() {
    let _alone = alone();
    let fixture = Fixture::small();
    let (folder, path) = folder_with(&fixture);
    // Where the time series has rows, but not those of the frames.
    let step: Vec<u64> = vec![300, 400, 500];
    let file = hdf5::File::open_rw(folder.path().join("run.h5")).expect("the file");
    for (k, name) in FrameScalars::COLUMNS.iter().enumerate() {
        let group = file
            .create_group(&format!("observables/gshear/{name}"))
            .expect("a group");
        let values = [0.25, 1.5 + k as f64, 7.0];
        let write = |name: &str| group.new_dataset_builder().with_data(&values).create(name);
        write("value").expect("values");
        group
            .new_dataset_builder()
            .with_data(&step)
            .create("step")
            .expect("steps");
    }
    file.close().expect("closed");
    done(&["regions", &path]);
    let found = table(&folder.path().join("regions.csv"));
    assert_eq!(found["step"], ["300", "400", "500"]);
    assert_eq!(numbers(&found["stress_ratio"]), fixture.series[1][3..6]);
    for (k, name) in FrameScalars::COLUMNS.iter().enumerate() {
        assert_eq!(numbers(&found[name.name]), [0.25, 1.5 + k as f64, 7.0]);
    }
}

/// A study of runs with these frictions, and of a large sample if wanted: the folder it was written into.
fn study_of(frictions: &[f64], large: bool) -> (Vec<TempDir>, TempDir) {
    let mut runs = Vec::new();
    let mut paths = Vec::new();
    for friction in frictions {
        let mut fixture = Fixture::sheared(16, 12, 60);
        fixture.friction = *friction;
        let (folder, path) = folder_with(&fixture);
        runs.push(folder);
        paths.push(path);
    }
    if large {
        let (folder, path) = folder_with(&Fixture::sheared(58, 40, 25));
        runs.push(folder);
        paths.push(path);
    }
    let out = tempfile::tempdir().expect("a folder");
    let into = out.path().to_str().expect("UTF-8").to_string();
    let mut arguments = vec!["report", "--study", "lee-hurley", "--out", &into];
    arguments.extend(paths.iter().map(String::as_str));
    done(&arguments);
    (runs, out)
}

/// Names of the files in a folder, each of them checked.
fn checked(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("the study");
    let mut names: Vec<String> = Vec::new();
    for entry in entries {
        let path = entry.expect("an entry").path();
        let text = || std::fs::read_to_string(&path).expect("text");
        match path.extension().and_then(|end| end.to_str()) {
            Some("svg") => {
                assert_well_formed(&text(), &path);
                let beside = ["pdf", "png"].map(|end| path.with_extension(end));
                assert!(beside.iter().all(|path| path.is_file()), "{beside:?}");
            }
            Some("csv") => assert!(!table(&path).is_empty()),
            Some("pdf" | "png") => continue,
            _ => drop(text()),
        }
        names.push(
            path.file_name()
                .expect("a name")
                .to_str()
                .expect("UTF-8")
                .into(),
        );
    }
    names.sort();
    let is_table = |name: &&String| Path::new(name).extension().is_some_and(|end| end == "csv");
    for table in names.iter().filter(is_table) {
        let units = format!("{table}-metadata.json");
        assert!(names.contains(&units), "{units} is missing");
    }
    names
}

#[test]
fn a_study_of_both_samples_has_every_figure() {
    let _alone = alone();
    let (_runs, out) = study_of(&[0.1, 0.7], true);
    let names = checked(out.path());
    let page = std::fs::read_to_string(out.path().join("index.html")).expect("the page");
    for number in 2..=25 {
        let svg = format!("fig-{number:02}.svg");
        let why = format!("Figure {number}: ");
        let drawn = names.contains(&svg);
        assert_eq!(
            drawn,
            names.contains(&format!("fig-{number:02}.csv")),
            "{svg}"
        );
        assert_eq!(drawn, page.contains(&format!("src=\"{svg}\"")), "{svg}");
        // Only the second drop may be missing: not every drop has one.
        assert!(drawn || (number == 17 && page.contains(&why)), "{svg}");
    }
    assert_eq!(page.matches("<h3>").count(), 3);
    assert!(page.contains("μ_s = 0.1 small") && page.contains("μ_s = 0.7 large"));

    // Panels a to j of the comparison: eight ranges of each run.
    let compared = table(&out.path().join("fig-13.csv"));
    assert_eq!(compared["panel"].len(), 10 * 2 * 8);
    // The steps of the maps are numbered through, from Stage I to Stage III.
    let steps: Vec<String> = [3, 4, 5]
        .iter()
        .flat_map(|n| table(&out.path().join(format!("fig-{n:02}.csv")))["step"].clone())
        .collect();
    let mut seen: Vec<usize> = steps
        .iter()
        .map(|step| step.parse().expect("a number"))
        .collect();
    assert!(seen.is_sorted());
    seen.dedup();
    assert_eq!(seen, (1..=seen.len()).collect::<Vec<_>>());
    let last = table(&out.path().join("fig-05.csv"))["stage"]
        .last()
        .cloned();
    assert_eq!(last.as_deref(), Some("III"));
}

/// Three seeds of one scene, one of them given twice, beside a run of another friction.
#[test]
fn seeds_make_means_with_errors() {
    let _alone = alone();
    let mut paths = Vec::new();
    let mut folders = Vec::new();
    for (seed, friction, frames) in [
        (1, 0.7, 60),
        (2, 0.7, 50),
        (3, 0.7, 40),
        (3, 0.7, 40),
        (1, 0.3, 30),
    ] {
        let mut fixture = Fixture::sheared(16, 12, frames);
        (fixture.seed, fixture.friction) = (seed, friction);
        let (folder, path) = folder_with(&fixture);
        done(&["correlate", &path]);
        folders.push(folder);
        paths.push(path);
    }
    let out = tempfile::tempdir().expect("a folder");
    let into = out.path().to_str().expect("UTF-8").to_string();
    let mut arguments = vec!["report", "--study", "lee-hurley", "--out", &into];
    arguments.extend(paths.iter().map(String::as_str));
    done(&arguments);
    let names = checked(out.path());
    assert!(names.contains(&"ensemble-small.svg".to_string()));
    assert!(!names.contains(&"ensemble-large.svg".to_string()));
    // Figure 13 has one run of each friction.
    assert_eq!(
        table(&out.path().join("fig-13.csv"))["panel"].len(),
        10 * 2 * 8
    );

    let found = table(&out.path().join("ensemble.csv"));
    assert!(found["runs_of"].iter().all(|label| label == "μ_s = 0.7"));
    let row = found["what"]
        .iter()
        .position(|what| what == "intervals")
        .expect("a row");
    // 59, 49 and 39 of them: s² = 100.
    assert_eq!(found["runs"][row], "3");
    assert_eq!(numbers(&found["mean"])[row], 49.0);
    assert!((numbers(&found["error"])[row] - (100.0f64 / 3.0).sqrt()).abs() < 1e-13);
    assert_eq!(
        [
            numbers(&found["least"])[row],
            numbers(&found["greatest"])[row]
        ],
        [39.0, 59.0]
    );

    // The mean ρ of a range is that of the runs' own tables, as far as they have five pairs there.
    let merged = table(&out.path().join("ensemble-correlations.csv"));
    let single: Vec<_> = folders[..3]
        .iter()
        .map(|folder| table(&folder.path().join("correlations.csv")))
        .collect();
    let mut compared = 0;
    for k in 0..merged["with"].len() {
        let own = single.iter().filter_map(|run| {
            let same = |row: &usize| {
                ["with", "over", "from", "to"]
                    .iter()
                    .all(|name| run[*name][*row] == merged[*name][k])
                    && run["range_of"][*row].starts_with("delta_tau")
            };
            let row = (0..run["with"].len()).find(same).expect("the range");
            let pairs: usize = run["pairs"][row].parse().expect("a count");
            (pairs >= 5).then(|| numbers(&run["rho"])[row])
        });
        let own: Vec<f64> = own.collect();
        assert_eq!(merged["runs"][k], own.len().to_string());
        if own.len() > 1 {
            let mean = own.iter().sum::<f64>() / own.len() as f64;
            assert!((numbers(&merged["rho_mean"])[k] - mean).abs() < 1e-15);
            compared += 1;
        }
    }
    assert!(compared > 5, "{compared}");
}

#[test]
fn figures_without_a_run_for_them_are_left_out_and_said() {
    let _alone = alone();
    let (_runs, out) = study_of(&[0.5], false);
    let names = checked(out.path());
    assert!(
        names.contains(&"fig-13.svg".to_string()) && !names.contains(&"fig-14.svg".to_string())
    );
    let page = std::fs::read_to_string(out.path().join("index.html")).expect("the page");
    assert!(page.contains("Figure 25: no run of the large sample."));
}

#[test]
fn what_cannot_be_studied_is_refused() {
    let _alone = alone();
    let mut fixture = Fixture::small();
    let (_folder, path) = folder_with(&fixture);
    assert!(refused(&["report", &path, &path]).contains("without --study it takes one"));
    fixture.frames.truncate(1);
    let (folder, short) = folder_with(&fixture);
    let message = refused(&["report", &path, &short, "--study", "lee-hurley"]);
    assert!(
        message.contains("has 1 frames: the study needs two or more"),
        "{message}"
    );
    assert!(!folder.path().join("lee-hurley").exists());
    for arguments in [
        &["report", &path, "--from", "0.1"][..],
        &["report", &path, "--study", "kepler"],
        &["correlate", &path, "--min-points", "3"],
        &["phases", &path, "--round", "0"],
    ] {
        assert_eq!(reduce(arguments).status.code(), Some(2), "{arguments:?}");
    }
}
