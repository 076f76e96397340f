//! Protocols of walls, through the real program: closed forms of what is imposed, and the energy
//! budget.

use std::path::Path;

use crate::common::crossing::{PACKED, whole};
use gshear_store::run_reader::RunFile;

/// Ramps, steps and oscillations of all that a protocol can impose, in eight short parts.
const MIXED: &str = "shear.protocol=[
    { velocity = 0.3, time = 1e-7 },
    { velocity = 0.3, time = 2e-7, pressure = 5e5, pressure_end = 8e5 },
    { strain_amplitude = 0.01, frequency = 4e6, cycles = 1.25 },
    { shear_stress = 1e4, shear_stress_end = 2e5, time = 2e-7, pressure = 6e5 },
    { shear_stress = 1e5, shear_stress_amplitude = 5e4, frequency = 1e7, time = 1e-7 },
    { velocity = 0.3, time = 2e-7, wall_velocity = 0 },
    { velocity = 0.3, time = 2e-7, pressure_amplitude = 1e5, pressure_frequency = 2e7 },
    { velocity = 0.3, time = 2e-7, bottom_amplitude = 2e-9, bottom_frequency = 1e7 },
]";

/// Runs them in `folder`.
fn run(folder: &Path) -> RunFile {
    let sets = [
        MIXED,
        "shear.inertial_number=none",
        "shear.strain=none",
        "output.frame_strain=none",
        "output.series_strain=none",
        "output.checkpoint_strain=none",
        "output.series_rows=20",
        "output.frame_rows=2",
    ];
    whole(folder, 1, &[&PACKED[..], &sets].concat()).digest();
    RunFile::open(folder).expect("a run")
}

/// Imposed values are closed forms of the time, the height is constant to the last bit, and the
/// budget is closed.
#[test]
fn what_is_imposed_is_a_closed_form() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = run(folder.path());
    let series = run.series();
    let column = |name: &str| series.column(name);
    let (load, force) = (
        column("imposed_normal_force"),
        column("imposed_shear_force"),
    );
    let length = 21e-6;
    // The parts begin at these times up to a step each.
    let within = |row: usize, from: f64, to: f64| {
        let (t, margin) = (series.time[row], 5e-9);
        t > from + margin && t < to - margin
    };
    let step = series.time[1] / series.step[1] as f64;
    let rows = |from: f64, to: f64| (0..series.rows()).filter(move |&k| within(k, from, to));
    let mut found = 0;
    for k in rows(1e-7, 3e-7) {
        let expected = length * (5e5 + 3e5 * (series.time[k] - 1e-7) / 2e-7);
        // The part begins at a whole step.
        let error = 3e5 * length * 2.0 * step / 2e-7;
        assert!((load[k] - expected).abs() < error, "{k}");
        found += 1;
    }
    let drive = column("drive_displacement");
    for k in rows(3e-7, 6.125e-7) {
        assert_eq!(load[k], 8e5 * length);
        let cycles = 4e6 * (series.time[k] - 3e-7);
        let amplitude = 0.01 * height(&run);
        let expected = 0.3 * 3e-7 + amplitude * (std::f64::consts::TAU * cycles).sin();
        let error = (0.3 + amplitude * 3e7) * 2.0 * step;
        assert!((drive[k] - expected).abs() < error, "{k}");
        found += 1;
    }
    for k in rows(6.125e-7, 8.125e-7) {
        let expected = length * (1e4 + 1.9e5 * (series.time[k] - 6.125e-7) / 2e-7);
        let error = 1.9e5 * length * 3.0 * step / 2e-7;
        assert!((force[k] - expected).abs() < error, "{k}");
        found += 1;
    }
    let heights: Vec<u64> = rows(9.125e-7, 1.1125e-6)
        .map(|k| {
            assert!(load[k].is_nan() && force[k].is_nan());
            column("wall_height")[k].to_bits()
        })
        .collect();
    assert!(heights.len() > 10 && heights.iter().all(|h| *h == heights[0]));
    let bottom = column("bottom_displacement");
    let greatest = bottom.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    assert!((1.8e-9..=2e-9).contains(&greatest), "{greatest}");
    assert!(found > 40, "{found}");
    let residual = column("energy_residual");
    let worst = residual
        .iter()
        .skip(5)
        .fold(0.0_f64, |most, x| most.max(x.abs()));
    println!("greatest residual {worst:e}");
    assert!(worst < 1e-3, "{worst}");
}

/// H (m).
fn height(run: &RunFile) -> f64 {
    run.series().column("wall_height")[0]
}
