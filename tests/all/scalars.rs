//! Scalars of frames that a run computes itself: those of stored frames, to the last bit, whoever
//! shares the work.

use std::path::{Path, PathBuf};

use crate::common::{Outcome, gshear_mpi, same_run};
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_reduce::scalars::FrameSeries;
use gshear_store::run_reader::RunFile;

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing.toml");
/// A start that is no multiple of the interval.
const SCALARS: [&str; 4] = [
    SHORT,
    "--set=analysis.scalars=true",
    "--set=analysis.strain=0.005",
    "--set=analysis.start=0.097",
];
const SHORT: &str = "--set=shear.strain=0.4";
const NO_FRAMES: &str = "--set=output.frame_strain=0";

fn run(folder: &Path, ranks: usize, further: &[&str]) -> Outcome {
    let scene = [SCENE];
    let arguments = scene.iter().chain(&SCALARS).chain(further);
    let arguments: Vec<String> = arguments.map(ToString::to_string).collect();
    gshear_mpi(ranks, folder, &arguments)
}

fn resumed(checkpoint: &Path, folder: &Path, ranks: usize, further: &[&str]) -> Outcome {
    let mut arguments = vec![format!("--resume={}", checkpoint.display())];
    arguments.extend(further.iter().map(ToString::to_string));
    gshear_mpi(ranks, folder, &arguments)
}

fn open(folder: &Path) -> RunFile {
    RunFile::open(folder).expect("a run")
}

/// Steps and all numbers as bits.
fn bits(series: &FrameSeries) -> Vec<Vec<u64>> {
    let row = |k: usize| {
        let scalars: FrameScalars = series.scalars[k];
        let mut row = vec![series.step[k]];
        let numbers = [series.strain[k], series.tau[k]].into_iter();
        row.extend(numbers.chain(scalars.columns()).map(f64::to_bits));
        row
    };
    (0..series.step.len()).map(row).collect()
}

fn of(folder: &Path) -> Vec<Vec<u64>> {
    let run = open(folder);
    assert!(run.stored_scalars().is_some());
    bits(&FrameSeries::of(&run).expect("scalars"))
}

#[test]
fn scalars_of_the_run_are_those_of_its_frames() {
    let temporary = tempfile::tempdir().expect("a folder");
    let folder = |name: &str| -> PathBuf { temporary.path().join(name) };
    let without = gshear_mpi(1, &folder("without"), &[SCENE.into(), SHORT.into()]).digest();

    let frames = [
        "--set=output.frame_strain=0.005",
        "--set=output.frame_start=0.097",
    ];
    assert_eq!(run(&folder("one"), 1, &frames).digest(), without);
    let one = open(&folder("one"));
    let expected = bits(&FrameSeries::of_frames(&one).expect("frames"));
    // Of γ = 0.1 … 0.4, one more than the intervals; more than a batch of three ranks.
    assert!((60..=62).contains(&expected.len()), "{}", expected.len());
    // Where it flows so fast, D²min is not defined in every interval.
    let defined = |row: &&Vec<u64>| f64::from_bits(row[3]) > 0.0;
    assert!(expected.iter().filter(defined).count() > 30);
    assert_eq!(of(&folder("one")), expected);

    for ranks in [2, 3] {
        let other = folder(&format!("ranks-{ranks}"));
        assert_eq!(run(&other, ranks, &[NO_FRAMES]).digest(), without);
        assert_eq!(of(&other), expected, "{ranks} ranks");
        assert_eq!(open(&other).frames(), 0);
    }

    // Before the first frame, on a frame, and between two.
    let every = one.frame_steps()[1] - one.frame_steps()[0];
    let on = one.frame_steps()[30];
    for (before, step, after) in [(2, 5, 1), (1, on, 3), (3, on + every / 2, 2)] {
        let broken = folder(&format!("broken-{step}"));
        let stop = format!("--stop-at={step}");
        let stopped = run(&broken, before, &[NO_FRAMES, &stop]);
        assert_eq!(stopped.code, 75, "{}", stopped.text);
        let outcome = resumed(&broken.join("checkpoint.h5"), &broken, after, &[]);
        assert_eq!(outcome.digest(), without);
        assert_eq!(of(&broken), expected, "stopped at {step}");
        same_run(&folder("ranks-2"), &broken);
    }
}

/// Grains that move by more than half a period between two frames, with a stop in between: images
/// are part of the checkpoint.
#[test]
fn scalars_follow_grains_over_the_edge() {
    let temporary = tempfile::tempdir().expect("a folder");
    let scalars = [
        SCENE,
        "--set=analysis.scalars=true",
        "--set=analysis.strain=0.9",
        "--set=output.frame_strain=0.9",
    ];
    let scalars = scalars.map(String::from);
    let whole = temporary.path().join("whole");
    gshear_mpi(1, &whole, &scalars).digest();
    let run_of = open(&whole);
    let [first, last] = [0, 1].map(|t| run_of.unwrapped(t..t + 1).expect("a frame").remove(0));
    let moved = first.iter().zip(&last).map(|(a, b)| (b[0] - a[0]).abs());
    assert!(moved.fold(0.0, f64::max) > 0.5 * run_of.grains().length);
    let expected = bits(&FrameSeries::of_frames(&run_of).expect("frames"));
    assert_eq!(of(&whole), expected);
    let broken = temporary.path().join("broken");
    let stop = format!("--stop-at={}", run_of.frame_steps()[1] - 5);
    let stopped = gshear_mpi(1, &broken, &[&scalars[..], &[stop]].concat());
    assert_eq!(stopped.code, 75, "{}", stopped.text);
    resumed(&broken.join("checkpoint.h5"), &broken, 2, &[]).digest();
    assert_eq!(of(&broken), expected);
}

/// Turned off for a while: the rows that are there stay, and the next one has no frame before it.
#[test]
fn a_gap_is_a_gap() {
    let temporary = tempfile::tempdir().expect("a folder");
    let whole = temporary.path().join("whole");
    run(&whole, 1, &[NO_FRAMES]).digest();
    let expected = of(&whole);
    let [first, last] = [expected[20][0], expected[40][0]];

    let broken = temporary.path().join("broken");
    let checkpoint = broken.join("checkpoint.h5");
    let stop = format!("--stop-at={first}");
    assert_eq!(run(&broken, 1, &[NO_FRAMES, &stop]).code, 75);
    let stop = format!("--stop-at={last}");
    let off = ["--set=analysis.scalars=false", &stop];
    assert_eq!(resumed(&checkpoint, &broken, 1, &off).code, 75);
    let on = ["--set=analysis.scalars=true"];
    resumed(&checkpoint, &broken, 2, &on).digest();

    let found = of(&broken);
    assert_eq!(found[..21], expected[..21]);
    assert_eq!(found[21][0], expected[41][0]);
    assert!(found[21][3..].iter().all(|v| f64::from_bits(*v).is_nan()));
    assert_eq!(found[22..], expected[42..]);
}
