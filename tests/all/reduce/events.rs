//! `events`: made-up runs with known events.

use std::collections::BTreeMap;

use gshear_analysis::stress::tensors;
use gshear_dem::state::Frame;

use super::fixture::{Fixture, strain_of};
use super::{are_described, done, folder_with, reduce, refused};

/// A table by its columns.
fn table(csv: &str) -> BTreeMap<String, Vec<String>> {
    let mut reader = csv::Reader::from_reader(csv.as_bytes());
    let names = reader.headers().expect("a header").clone();
    let mut columns: Vec<Vec<String>> = vec![Vec::new(); names.len()];
    for row in reader.records() {
        for (column, cell) in columns.iter_mut().zip(&row.expect("a row")) {
            column.push(cell.into());
        }
    }
    names.iter().map(String::from).zip(columns).collect()
}

fn numbers(column: &[String]) -> Vec<f64> {
    let numbers = column.iter().map(|cell| cell.parse().expect("a number"));
    numbers.collect()
}

const TABLES: [&str; 5] = [
    "events.csv",
    "events-grains.csv",
    "events-propagator.csv",
    "events-map.csv",
    "events-pairs.csv",
];

/// How far grains move that rearrange (m): farther than D²min of their neighbours, and less than a
/// distance between grains.
const MOVE: f64 = 0.3e-6;
/// D²min over r̄² between that of the grains that move and that of their neighbours.
const BETWEEN: f64 = 0.5 * MOVE * MOVE / (0.78e-6 * 0.78e-6);

/// A run of 20 × 14 disks at rest, of which some move between two frames, and whose forces weaken.
struct Resting {
    fixture: Fixture,
    columns: usize,
}

impl Resting {
    /// Eight frames, with the forces of the first one times `strength`.
    fn new(strength: [f64; 8]) -> Self {
        let columns = 20;
        let mut fixture = Fixture::sheared(columns, 14, 8);
        let first = fixture.frames[0].clone();
        for (frame, strength) in fixture.frames.iter_mut().zip(strength) {
            let mut contacts = first.contacts.clone();
            for contact in &mut contacts {
                contact.normal_force *= strength;
                contact.tangential_force[0] *= strength;
            }
            *frame = Frame {
                step: frame.step,
                time: frame.time,
                contacts,
                ..first.clone()
            };
        }
        Self { fixture, columns }
    }

    fn grain(&self, column: usize, row: usize) -> usize {
        row * self.columns + column
    }

    /// Moves grains of these columns in a row between a frame and the one before it, each in
    /// another direction.
    fn rearrange(&mut self, frame: usize, columns: &[usize], row: usize) {
        for (k, column) in columns.iter().enumerate() {
            let grain = self.grain(*column, row);
            let angle = 1.0 + 2.4 * k as f64;
            for frame in &mut self.fixture.frames[frame..] {
                let [x, y, _] = &mut frame.grains[grain].position;
                *x += MOVE * angle.cos();
                *y += MOVE * angle.sin();
                let images = x.div_euclid(self.fixture.length);
                *x -= images * self.fixture.length;
                frame.grains[grain].image[0] += images as i64;
            }
        }
    }
}

#[test]
fn planted_clusters_are_the_events() {
    let mut run = Resting::new([1.0, 1.0, 1.0, 0.5, 0.25, 0.25, 0.25, 0.2]);
    // One event of two intervals, one across the edge of the cell, and one alone, later.
    run.rearrange(3, &[8, 9, 10], 7);
    run.rearrange(4, &[11], 7);
    run.rearrange(4, &[19, 0], 5);
    run.rearrange(7, &[10], 4);
    let (folder, path) = folder_with(&run.fixture);
    let threshold = format!("{BETWEEN}");
    let options = [
        "--threshold",
        &threshold,
        "--rattlers",
        "none",
        "--formats",
        "svg,png",
    ];
    let said = done(&[&["events", &path][..], &options].concat());
    assert!(
        said.contains("3 events in 7 intervals, of up to 4 grains; 3 count"),
        "{said}"
    );
    are_described(folder.path(), &TABLES);
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).expect("a table");
    let events = table(&read("events.csv"));
    let of = |name: &str| numbers(&events[name]);
    assert_eq!(of("grains"), [4.0, 2.0, 1.0]);
    assert_eq!(of("intervals"), [2.0, 1.0, 1.0]);
    assert_eq!(of("start_frame"), [2.0, 3.0, 6.0]);
    assert_eq!(of("end_frame"), [4.0, 4.0, 7.0]);
    let strain = |frame: f64| strain_of(1000 * frame as u64, run.fixture.height);
    for (name, frames) in [
        ("start_strain", [2.0, 3.0, 6.0]),
        ("end_strain", [4.0, 4.0, 7.0]),
    ] {
        for (found, frame) in of(name).into_iter().zip(frames) {
            assert!((found / strain(frame) - 1.0).abs() < 1e-12, "{name}");
        }
    }
    let waiting = of("waiting_strain");
    assert!(waiting[0].is_nan());
    assert!((waiting[1] / strain(1.0) - 1.0).abs() < 1e-12);
    assert!((waiting[2] / strain(3.0) - 1.0).abs() < 1e-12);

    // Their grains.
    let grains = table(&read("events-grains.csv"));
    let mut found: Vec<(String, usize)> = (grains["event"].iter().zip(&grains["grain"]))
        .map(|(event, grain)| (event.clone(), grain.parse().expect("an id")))
        .collect();
    found.sort();
    let mut wanted = Vec::new();
    for (event, column, row) in [
        ("0", 8, 7),
        ("0", 9, 7),
        ("0", 10, 7),
        ("0", 11, 7),
        ("1", 19, 5),
        ("1", 0, 5),
        ("2", 10, 4),
    ] {
        wanted.push((event.to_string(), run.grain(column, row)));
    }
    wanted.sort();
    assert_eq!(found, wanted);

    // A grain alone moves by d against N neighbours: d² less what an affine map takes of it.
    let (greatest, sum) = (of("dmin_greatest"), of("dmin_sum"));
    let relative = greatest[2] / (MOVE * MOVE);
    assert!(relative > 0.9 && relative <= 1.0, "{relative}");
    assert_eq!(greatest[2], sum[2]);
    assert_eq!(
        (of("gyration")[2], of("extent_x")[2], of("extent_y")[2]),
        (0.0, 0.0, 0.0)
    );
    let alone = &run.fixture.frames[6].grains[run.grain(10, 4)].position;
    assert!((of("x")[2] - alone[0]).abs() < 1e-18 && (of("y")[2] - alone[1]).abs() < 1e-18);
    // Two at the edge: half of their distance.
    let [last, first] = [19, 0].map(|c| run.fixture.frames[3].grains[run.grain(c, 5)].position);
    let between = (first[0] + run.fixture.length - last[0]).hypot(first[1] - last[1]);
    assert!((of("gyration")[1] / (0.5 * between) - 1.0).abs() < 1e-9);
    assert!((of("extent_x")[1] - (first[0] + run.fixture.length - last[0]).abs()).abs() < 1e-18);

    // Stress drops: means over the volumes of the free grains.
    let free: Vec<usize> = (0..run.fixture.grains.count())
        .filter(|n| run.fixture.grains.body[*n] == 0)
        .collect();
    let area = |n: &usize| run.fixture.grains.radius[*n].powi(2);
    let means = |frame: usize| {
        let stresses = tensors(&run.fixture.grains, &run.fixture.frames[frame]);
        // σ_xy and σ_yy.
        [3, 1].map(|k| {
            let sum: f64 = free.iter().map(|n| area(n) * stresses[*n][k]).sum();
            sum / free.iter().map(area).sum::<f64>()
        })
    };
    for (k, ends) in [[2, 4], [3, 4], [6, 7]].into_iter().enumerate() {
        let [[shear, normal], [shear_after, normal_after]] = ends.map(means);
        let drop = shear_after - shear;
        assert!((of("stress_drop")[k] - drop).abs() < 1e-9 * shear.abs());
        let drop = shear_after / normal_after - shear / normal;
        assert!((of("stress_ratio_drop")[k] - drop).abs() < 1e-9);
    }
    for name in [
        "events",
        "events-sizes",
        "events-displacement",
        "events-stress",
        "events-propagator",
    ] {
        for ending in ["svg", "png"] {
            let file = folder.path().join(format!("{name}.{ending}"));
            assert!(
                file.metadata().is_ok_and(|file| file.len() > 1000),
                "{}",
                file.display()
            );
        }
    }
}

#[test]
fn reach_and_gap_decide_what_is_linked() {
    let mut run = Resting::new([1.0; 8]);
    // Columns are 1.5 µm apart, the mean diameter is near 1.56 µm.
    run.rearrange(2, &[4, 6], 7);
    run.rearrange(5, &[4], 7);
    let (folder, path) = folder_with(&run.fixture);
    let threshold = format!("{BETWEEN}");
    let grains = |more: &[&str]| {
        let always = [
            "events",
            &path,
            "--threshold",
            &threshold,
            "--rattlers",
            "none",
        ];
        done(&[&always[..], more].concat());
        let csv = std::fs::read_to_string(folder.path().join("events.csv")).expect("a table");
        numbers(&table(&csv)["grains"])
    };
    assert_eq!(grains(&[]), [1.0, 1.0, 1.0]);
    assert_eq!(grains(&["--reach", "2.5"]), [2.0, 1.0]);
    assert_eq!(grains(&["--gap", "1"]), [1.0, 1.0, 1.0]);
    assert_eq!(grains(&["--gap", "2"]), [1.0, 1.0]);
    assert_eq!(grains(&["--gap", "2", "--reach", "2.5"]), [2.0]);
    let options = [
        "--threshold",
        &threshold,
        "--rattlers",
        "none",
        "--reach",
        "2.5",
    ];
    for (counts, wanted) in [("1..", 2), ("2..", 1), ("1..1", 1), ("3..", 0)] {
        let said = done(&[&["events", &path, "--grains", counts][..], &options].concat());
        let ending = format!("of up to 2 grains; {wanted} count for the propagator");
        assert!(said.contains(&ending), "{counts}: {said}");
    }
    // Frames 0, 2, 4 and 6: both in consecutive intervals but one.
    assert_eq!(grains(&["--every", "2", "--gap", "1"]), [1.0, 1.0]);
    let late = format!("{}", strain_of(3000, run.fixture.height) * (1.0 - 1e-9));
    assert_eq!(grains(&["--from", &late]), [1.0]);
}

#[test]
fn a_share_is_of_the_greatest_values() {
    let (folder, path) = folder_with(&Fixture::sheared(16, 12, 12));
    let said = done(&["events", &path, "--share", "0.05", "--rattlers", "none"]);
    // 160 free grains in 11 intervals.
    assert!(
        said.contains(": 88 of 1760 values in 11 intervals"),
        "{said}"
    );
    let csv = std::fs::read_to_string(folder.path().join("events-grains.csv")).expect("a table");
    let chosen = numbers(&table(&csv)["dmin"]);
    assert_eq!(chosen.len(), 88);
    let csv = std::fs::read_to_string(folder.path().join("events.csv")).expect("a table");
    let events = table(&csv);
    let threshold = numbers(&events["threshold"])[0];
    let square = folder_square(&Fixture::sheared(16, 12, 12));
    assert_eq!(chosen.into_iter().fold(f64::INFINITY, f64::min), threshold);
    // The same with that threshold, whatever the threads.
    for threads in ["1", "2"] {
        let over = format!("{:?}", threshold / square * (1.0 - 1e-12));
        done(&[
            "events",
            &path,
            "--threshold",
            &over,
            "--rattlers",
            "none",
            "--threads",
            threads,
        ]);
        let again = std::fs::read_to_string(folder.path().join("events.csv")).expect("a table");
        let again = table(&again);
        for (name, column) in events.iter().filter(|(name, _)| *name != "threshold") {
            assert_eq!(&again[name], column, "{name}");
        }
    }
}

/// The square of the mean radius (m²).
fn folder_square(fixture: &Fixture) -> f64 {
    fixture.grains.mean_radius().powi(2)
}

#[test]
fn wrong_options_and_runs_are_refused() {
    let mut one = Fixture::small();
    one.frames.truncate(1);
    let (folder, path) = folder_with(&one);
    let message = refused(&["events", &path]);
    assert!(
        message.contains("has 1 frames") && message.contains("two or more"),
        "{message}"
    );
    let (other, path) = folder_with(&Fixture::small());
    let message = refused(&["events", &path, "--every", "6"]);
    assert!(message.contains("of which every 6 is taken"), "{message}");
    assert!(refused(&["events", &path, "--from", "0.9"]).contains("has 0 frames from γ = 0.9 on"));
    let message = refused(&["events", &path, "--radius", "0.1", "--rattlers", "none"]);
    assert!(
        message.contains("D²min is not defined for any free grain"),
        "{message}"
    );
    for wrong in [
        &["--share", "0"][..],
        &["--share", "1.5"],
        &["--threshold", "-1"],
        &["--threshold", "1", "--share", "0.1"],
        &["--reach", "0"],
        &["--gap", "-1"],
        &["--grains", "0.."],
        &["--grains", "3..2"],
        &["--every", "0"],
        &["--formats", "gif"],
    ] {
        let arguments = [&["events", &path][..], wrong].concat();
        assert_eq!(reduce(&arguments).status.code(), Some(2), "{wrong:?}");
    }
    for folder in [&folder, &other] {
        assert_eq!(
            std::fs::read_dir(folder.path()).expect("a folder").count(),
            1
        );
    }
}
