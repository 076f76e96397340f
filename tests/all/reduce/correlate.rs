//! `regions`, `correlate` and `stages`.

use std::collections::BTreeMap;
use std::path::Path;

use gshear_analysis::frame_scalars::{FrameScalars, ScalarScratch, Stressed, frame_scalars};
use gshear_analysis::stress::ratio_on_top;

use super::fixture::Fixture;
use super::{are_described, done, folder_with, reduce, refused};

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
    // Every phase whose |Δτ_p| is at least 1e-5 is in one range of each correlation over all
    // phases.
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
}

#[test]
fn scalars_that_the_run_has_computed_are_taken() {
    let mut fixture = Fixture::small();
    // Where the time series has rows, but not those of the frames.
    let value = |row: usize, k: usize| [0.25, 1.5 + k as f64, 7.0][row];
    let row = |row| FrameScalars::from_columns(std::array::from_fn(|k| value(row, k)));
    fixture.scalars = vec![(300, row(0)), (400, row(1)), (500, row(2))];
    let (folder, path) = folder_with(&fixture);
    done(&["regions", &path]);
    let found = table(&folder.path().join("regions.csv"));
    assert_eq!(found["step"], ["300", "400", "500"]);
    assert_eq!(numbers(&found["stress_ratio"]), fixture.series[1][3..6]);
    for (k, name) in FrameScalars::COLUMNS.iter().enumerate() {
        assert_eq!(numbers(&found[name.name]), [0.25, 1.5 + k as f64, 7.0]);
    }
}

/// The largest drop of the regime lies in Stage II, the stages meet, and the tables of the steps
/// hold every grain and contact of frames of the run, with the scalars of those frames.
#[test]
fn stages_are_around_the_largest_drop() {
    let fixture = Fixture::sheared(16, 12, 60);
    let (folder, path) = folder_with(&fixture);
    for command in ["regions", "correlate", "stages"] {
        done(&[command, &path]);
    }
    let names = ["stages", "stages-steps", "stages-grains", "stages-contacts"];
    let names = names.map(|name| format!("{name}.csv"));
    are_described(folder.path(), &names.each_ref().map(String::as_str));
    let [stages, steps, grains, contacts] = names.map(|name| table(&folder.path().join(name)));

    assert_eq!(stages["stage"][..4], ["I", "II", "III", "slip"]);
    let (start, end) = (numbers(&stages["start_step"]), numbers(&stages["end_step"]));
    assert_eq!([end[0], end[1]], [start[1], start[2]]);
    let phases = table(&folder.path().join("measures.csv"));
    let changes = numbers(&phases["delta_tau_p"]);
    let largest = (0..changes.len())
        .min_by(|a, b| changes[*a].total_cmp(&changes[*b]))
        .expect("a phase");
    assert_eq!(stages["start_step"][3], phases["start_step"][largest]);
    assert_eq!(stages["end_step"][3], phases["end_step"][largest]);
    assert!(start[1] <= start[3] && end[3] <= end[1]);

    // The steps are numbered through, from Stage I to Stage III.
    let count = steps["step"].len();
    assert_eq!(
        numbers(&steps["step"]),
        (1..=count).map(|k| k as f64).collect::<Vec<_>>()
    );
    assert!(steps["stage"].is_sorted());
    assert_eq!(
        (steps["stage"].first(), steps["stage"].last()),
        (Some(&"I".into()), Some(&"III".into()))
    );
    let frames = table(&folder.path().join("regions.csv"));
    let disks = fixture.grains.count();
    assert_eq!(grains["grain"].len(), count * disks);
    let mut seen = 0;
    for k in 0..count {
        let row = frames["step"]
            .iter()
            .position(|s| *s == steps["end_step"][k]);
        let row = row.expect("a frame");
        assert_eq!(frames["step"][row - 1], steps["start_step"][k]);
        let of_step = &numbers(&grains["dmin"])[k * disks..][..disks];
        let greatest = of_step.iter().copied().fold(f64::NAN, f64::max);
        assert_eq!(greatest, numbers(&frames["dmin_greatest"])[row]);
        let marked = |name: &str| {
            numbers(&grains[name])[k * disks..][..disks]
                .iter()
                .sum::<f64>()
        };
        // 1 % of those with a defined D²min, and at most 1 % of the 192 disks.
        let defined = of_step.iter().filter(|dmin| dmin.is_finite()).count();
        assert_eq!(
            marked("greatest_dmin"),
            (0.01 * defined as f64).round().max(1.0)
        );
        assert!(marked("in_gr_region") <= 2.0);
        let along = ["tension_x", "tension_y"].map(|name| numbers(&steps[name])[k]);
        assert!((along[0].hypot(along[1]) - 1.0).abs() < 1e-12);
        seen += fixture.frames[row].contacts.len();
    }
    assert_eq!(contacts["i"].len(), seen);

    // There must be a drop after the onset.
    let message = refused(&["stages", &path, "--from", "1e9"]);
    assert!(message.contains("give a lesser --from"), "{message}");
}

#[test]
fn wrong_arguments_are_refused() {
    let (_folder, path) = folder_with(&Fixture::small());
    for arguments in [
        &["report", &path, &path][..],
        &["growth", &path],
        &["correlate", &path, "--min-points", "3"],
        &["stages", &path, "--reduction", "all"],
        &["phases", &path, "--round", "0"],
    ] {
        assert_eq!(reduce(arguments).status.code(), Some(2), "{arguments:?}");
    }
}
