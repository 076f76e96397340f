//! Scalars of frames that a run computes itself: those of stored frames, to the last bit, whoever
//! shares the work.

use std::path::{Path, PathBuf};

use crate::common::crossing::{PACKED, resumed, stopped, whole};
use crate::common::{Outcome, gshear_mpi, same_run};
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_dem::state::GrainSample;
use gshear_reduce::scalars::FrameSeries;
use gshear_store::run_reader::RunFile;

/// A start that is no multiple of the interval.
const SCALARS: [&str; 3] = [
    "analysis.scalars=true",
    "analysis.strain=0.005",
    "analysis.start=0.097",
];
/// Little friction, so that D²min is defined in most intervals.
const SHORT: [&str; 2] = ["shear.strain=0.4", "contact.friction=0.3"];
const NO_FRAMES: &str = "output.frame_strain=0";

fn sets<'a>(further: &[&'a str]) -> Vec<&'a str> {
    [&PACKED, &SHORT[..], &SCALARS, further].concat()
}

fn run(folder: &Path, ranks: usize, further: &[&str]) -> Outcome {
    whole(folder, ranks, &sets(further))
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
    let without = whole(&folder("without"), 1, &[&PACKED[..], &SHORT].concat()).digest();

    let frames = ["output.frame_strain=0.005", "output.frame_start=0.097"];
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
        let checkpoint = stopped(&broken, before, step, &sets(&[NO_FRAMES]));
        let outcome = resumed(&checkpoint, &broken, after, &[]);
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
        "analysis.scalars=true",
        "analysis.strain=0.9",
        "output.frame_strain=0.9",
    ];
    let scalars = [&PACKED[..], &scalars].concat();
    let unbroken = temporary.path().join("unbroken");
    whole(&unbroken, 1, &scalars).digest();
    let run_of = open(&unbroken);
    let length = run_of.periods()[0];
    let [first, last] = [0, 1].map(|t| {
        let frame = run_of.records(t..t + 1).expect("a frame").remove(0);
        let of_grain = |g: &GrainSample| g.position[0] + g.image[0] as f64 * length;
        frame.grains.iter().map(of_grain).collect::<Vec<_>>()
    });
    let moved = first.iter().zip(&last).map(|(a, b)| (b - a).abs());
    assert!(moved.fold(0.0, f64::max) > 0.5 * length);
    let expected = bits(&FrameSeries::of_frames(&run_of).expect("frames"));
    assert_eq!(of(&unbroken), expected);
    let broken = temporary.path().join("broken");
    let checkpoint = stopped(&broken, 1, run_of.frame_steps()[1] - 5, &scalars);
    resumed(&checkpoint, &broken, 2, &[]).digest();
    assert_eq!(of(&broken), expected);
}

/// Turned off for a while: the rows that are there stay, and the next one has no frame before it.
#[test]
fn a_gap_is_a_gap() {
    let temporary = tempfile::tempdir().expect("a folder");
    let unbroken = temporary.path().join("unbroken");
    run(&unbroken, 1, &[NO_FRAMES]).digest();
    let expected = of(&unbroken);
    let [first, last] = [expected[20][0], expected[40][0]];

    let broken = temporary.path().join("broken");
    let checkpoint = stopped(&broken, 1, first, &sets(&[NO_FRAMES]));
    let off = [
        format!("--resume={}", checkpoint.display()),
        format!("--stop-at={last}"),
        "--set=analysis.scalars=false".into(),
    ];
    assert_eq!(gshear_mpi(1, &broken, &off).code, 75);
    resumed(&checkpoint, &broken, 2, &["analysis.scalars=true"]).digest();

    let found = of(&broken);
    assert_eq!(found[..21], expected[..21]);
    assert_eq!(found[21][0], expected[41][0]);
    assert!(found[21][3..].iter().all(|v| f64::from_bits(*v).is_nan()));
    assert_eq!(found[22..], expected[42..]);
}
