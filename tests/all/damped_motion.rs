//! `gshear-reduce stability --dampers` against the motion of runs.

use std::path::Path;

use gshear_dem::state::Frame;
use gshear_store::run_reader::RunFile;

use crate::common::{gshear_mpi, reducer, succeed};

/// Disks at a constant volume that are sheared and then left alone.
const DISKS: &str = r#"
material.density = 2500.0
sample = { grains = 60, radius_min = 0.8e-3, radius_max = 1.2e-3, length = 15e-3, boundary = "periodic" }
load.pressure = 5e4
shear.protocol = [{ velocity = 0.02, distance = 2e-4 }, { velocity = 0.0, wall_velocity = 0.0, time = 0.3 }]
output.frame_rows = 400
output.series_rows = 400
"#;
const HOOKE: &str = r#"contact = { law = "hooke", normal_stiffness = 1e6, friction = 0.4, rolling_friction = 0.1, damping_ratio = 0.02, rolling_damping_ratio = 0.02 }"#;
/// From here on no contact slides, opens or begins (s).
const SETTLED: f64 = 0.08;

/// A run, and the last line of its table.
fn run(folder: &Path, contact: &str) -> (RunFile, Vec<(String, f64)>) {
    let scene = folder.join("scene.toml");
    std::fs::write(&scene, format!("{DISKS}{contact}")).expect("a scene");
    let out = folder.join("out");
    let outcome = gshear_mpi(1, &out, &[scene.display().to_string()]);
    assert_eq!(outcome.code, 0, "{}", outcome.text);
    let mut command = reducer();
    succeed(
        command
            .args(["stability", "--dampers", "--frames", "800..800"])
            .arg(&out),
    );
    let table = std::fs::read_to_string(out.join("stability.csv")).expect("a table");
    let lines: Vec<Vec<&str>> = table
        .lines()
        .map(|line| line.split(',').collect())
        .collect();
    let names = lines[0].iter().map(ToString::to_string);
    let last = lines.last().expect("a line");
    let values = last.iter().map(|value| value.parse().expect("a number"));
    let found = names.zip(values).collect();
    (RunFile::open(&out).expect("a run"), found)
}

fn column(line: &[(String, f64)], name: &str) -> f64 {
    let found = line.iter().find(|(own, _)| own == name);
    found.unwrap_or_else(|| panic!("no {name}")).1
}

/// The energy of the motions decays at the rate of the slowest, while it oscillates: by least
/// squares to some per cent.
#[test]
fn motions_decay_at_the_rate_of_the_slowest() {
    let folder = tempfile::tempdir().expect("a folder");
    let (run, line) = run(folder.path(), HOOKE);
    assert_eq!(column(&line, "growing_pairs"), 0.0);
    assert_eq!(column(&line, "growing"), 0.0);
    let rate = column(&line, "damped_growth_rate");
    assert!(rate < 0.0);
    let frames = run.records(0..run.frames()).expect("frames");
    let radius = &run.grains().radius;
    let points = frames.iter().zip(run.frame_times());
    let points = points.filter(|(_, time)| **time > SETTLED);
    let points: Vec<(f64, f64)> = points
        .map(|(frame, time)| (*time, energy(frame, radius).ln()))
        .collect();
    let count = points.len() as f64;
    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / count;
    let (time, log) = (mean(&|p| p.0), mean(&|p| p.1));
    let slope = mean(&|p| (p.0 - time) * (p.1 - log)) / mean(&|p| (p.0 - time).powi(2));
    assert!((slope / (2.0 * rate) - 1.0).abs() < 0.05, "{slope} {rate}");
}

/// Kinetic energy of disks of these radii about their mean motion, in units of πρ.
fn energy(frame: &Frame, radius: &[f64]) -> f64 {
    let masses = || radius.iter().map(|r| r * r);
    let grains = || frame.grains.iter().zip(masses());
    let total: f64 = masses().sum();
    let mean: [f64; 2] = std::array::from_fn(|axis| {
        grains().map(|(g, m)| m * g.velocity[axis]).sum::<f64>() / total
    });
    let energies = grains().map(|(g, m)| {
        let squares = (0..2).map(|axis| (g.velocity[axis] - mean[axis]).powi(2));
        let spin = g.angular_velocity[2];
        0.5 * m * (squares.sum::<f64>() + 0.5 * m * spin * spin)
    });
    energies.sum()
}

/// Without dampers the rates are those of K.
#[test]
fn without_dampers_rates_are_those_of_the_stiffness() {
    let folder = tempfile::tempdir().expect("a folder");
    let undamped = HOOKE.replace("damping_ratio = 0.02", "damping_ratio = 0.0");
    let (_, line) = run(folder.path(), &undamped);
    let (rate, growth) = (
        column(&line, "damped_growth_rate"),
        column(&line, "growth_rate"),
    );
    let frequency = column(&line, "real_greatest").sqrt();
    assert!((rate - growth).abs() < 1e-7 * frequency, "{rate} {growth}");
    assert_eq!(
        column(&line, "growing_pairs") + column(&line, "growing"),
        column(&line, "pairs") + column(&line, "negative")
    );
}
