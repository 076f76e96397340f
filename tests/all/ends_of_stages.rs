//! The last state of every stage is a frame and a row of the time series, whether or not the
//! intervals of output divide the stage.

use std::path::Path;

use crate::common::crossing::PACKED;
use crate::common::{gshear_mpi, same_run};
use gshear_store::run_reader::RunFile;

const DISKS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing.toml");
const SPHERES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing-3d.toml");
const BOX: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");

fn run(out: &Path, scene: &str, more: &[&str]) -> i32 {
    let mut arguments = vec![scene.to_string()];
    arguments.extend(more.iter().map(ToString::to_string));
    gshear_mpi(1, out, &arguments).code
}

/// The steps of frames and rows of a file.
fn steps(path: &Path) -> [Vec<u64>; 2] {
    let file = RunFile::open_any(path).expect("a run");
    [file.frame_steps().to_vec(), file.series().step.clone()]
}

/// Asserts that each output goes on with the same interval, up to a step, to the last step, with a
/// shorter one before that at most.
fn assert_ends(steps: &[u64], last: u64) {
    assert_eq!(steps.last(), Some(&last));
    let intervals: Vec<u64> = steps.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let (end, whole) = intervals.split_last().expect("two or more");
    assert!(whole.iter().all(|n| n.abs_diff(whole[0]) <= 1), "{steps:?}");
    assert!(*end <= whole.first().unwrap_or(end) + 1, "{steps:?}");
}

/// Of a shear by strains that the intervals divide, and that they do not, on the way stopped or
/// not; a stop writes nothing more.
#[test]
fn of_a_shear() {
    let folder = tempfile::tempdir().expect("a folder");
    let packed = PACKED.map(|set| format!("--set={set}"));
    let packed: Vec<&str> = packed.iter().map(String::as_str).collect();
    for (name, strain, frames) in [("whole", "0.03", 4), ("not", "0.034", 5)] {
        let (strain, at) = (
            format!("--set=shear.strain={strain}"),
            folder.path().join(name),
        );
        let sets = [
            &packed[..],
            &[
                "--set=output.frame_strain=0.01",
                "--set=output.series_strain=1e-3",
            ],
            &[&strain],
        ]
        .concat();
        assert_eq!(run(&at, DISKS, &sets), 0);
        let [of_frames, rows] = steps(&at);
        assert_eq!(of_frames.len(), frames);
        let last = *rows.last().expect("rows");
        assert_ends(&of_frames, last);
        assert_ends(&rows, last);
        let stopped = folder.path().join(format!("{name}-stopped"));
        let stop = format!("--stop-at={}", last / 2 + 1);
        assert_eq!(run(&stopped, DISKS, &[&sets[..], &[&stop]].concat()), 75);
        let [before, _] = steps(&stopped);
        assert_eq!(before, of_frames[..before.len()]);
        let checkpoint = format!("--resume={}", stopped.join("checkpoint.h5").display());
        assert_eq!(gshear_mpi(2, &stopped, &[checkpoint]).code, 0);
        same_run(&at, &stopped);
    }
    let none = folder.path().join("none");
    let sets = ["--set=shear.strain=0.01", "--set=output.frame_strain=0"];
    assert_eq!(run(&none, DISKS, &[&packed[..], &sets].concat()), 0);
    assert!(steps(&none)[0].is_empty());
}

/// Of the parts of a protocol, which their rows divide.
#[test]
fn of_parts() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path().join("parts");
    let sets = [
        "--set=shear.spring_number=none",
        "--set=shear.protocol=[{ velocity = 3, time = 1e-4 }, { velocity = 1, time = 7e-5 }]",
        "--set=output.series_rows=13",
        "--set=output.frame_rows=7",
    ];
    assert_eq!(run(&at, SPHERES, &sets), 0);
    let [frames, rows] = steps(&at);
    assert_eq!((frames.len(), rows.len()), (15, 27));
    assert_eq!((frames[7], frames[14]), (rows[13], rows[26]));
    assert_ends(&frames[..8], rows[13]);
    assert_ends(&frames[7..], rows[26]);
}

/// Of strain steps and of Newton's equations.
#[test]
fn of_a_box() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path().join("box");
    let sets = [
        "--set=aqs.steps=5",
        "--set=aqs.frame_every=3",
        "--set=newtonian.growth_times=0.1",
        "--set=newtonian.frames=7",
        "--set=newtonian.rows=7",
    ];
    assert_eq!(run(&at, BOX, &sets), 0);
    let [frames, rows] = steps(&at.join("run.h5"));
    assert_eq!((frames, rows.last()), (vec![0, 3, 5], Some(&5)));
    let [frames, rows] = steps(&at.join("run.h5").join("newtonian"));
    assert_eq!((frames.last(), rows.last()), (Some(&100), Some(&100)));
    assert_ends(&frames, 100);
}
