//! The contracts of runs in a periodic sheared box, through the real program: bits compared, never
//! approximately.

use std::path::Path;

use crate::common::{Outcome, avx2, beyond_the_digest, gshear_mpi};
use gshear_dem::columns::Column;
use gshear_store::file_names::{NEWTONIAN_PART, RUN_FILE};
use gshear_store::run_reader::RunFile;

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");

fn run(folder: &Path, ranks: usize, more: &[&str]) -> Outcome {
    // Many of them in turn into one folder.
    let mut arguments = vec![SCENE.to_string(), "--overwrite".into()];
    arguments.extend(more.iter().map(ToString::to_string));
    gshear_mpi(ranks, folder, &arguments)
}

/// All digests of a run that comes to its end: of the strain steps and of the last stage.
fn digests(outcome: &Outcome) -> Vec<String> {
    assert_eq!(outcome.code, 0, "{}", outcome.text);
    said(outcome)
}

/// All digests that a run prints.
fn said(outcome: &Outcome) -> Vec<String> {
    let words = outcome.text.split_whitespace();
    let after = words.clone().skip(1).zip(words);
    after
        .filter(|(_, word)| *word == "digest")
        .map(|(digest, _)| digest.into())
        .collect()
}

/// Contracts 1 to 3 in 2D and 3D: any number of ranks, threads, instruction sets and skins; other
/// output; stopped and gone on with.
fn keeps_the_contracts(dimension: &'static str, sample: &'static str) {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let base = [dimension, sample, "--set=aqs.steps=4"];
    let with = |more: &[&'static str]| [&base[..], more].concat();
    let expected = digests(&run(&at("one"), 1, &base));
    assert_eq!(expected.len(), 2);
    let beyond = beyond_the_digest(&at("one"));
    for (ranks, more) in [
        // Contract 2: what is written changes nothing.
        (
            2,
            &[
                "--set=bookkeeping.rebuild_every=1",
                "--set=aqs.frame_every=1",
                "--set=newtonian.rows=7",
                "--set=newtonian.frames=0",
            ][..],
        ),
        (3, &["--set=bookkeeping.skin=0.05", avx2()]),
        (
            1,
            &[
                "--threads=2",
                "--set=bookkeeping.rebuild_every=7",
                "--set=bookkeeping.simd=portable",
            ],
        ),
    ] {
        let found = digests(&run(&at("other"), ranks, &with(more)));
        assert_eq!(found, expected, "{dimension}, {ranks} ranks, {more:?}");
        assert_eq!(
            beyond_the_digest(&at("other")),
            beyond,
            "{dimension}, {more:?}"
        );
    }
    let overdamped = ["--set=relax.method=overdamped", "--set=aqs.steps=2"];
    let [one, two] = [1, 2].map(|ranks| digests(&run(&at("other"), ranks, &with(&overdamped))));
    assert_eq!(one, two, "{dimension}, overdamped");
    // Nor does the birth that is looked for on the way.
    let looking = ["--set=aqs.spectrum=true", "--set=aqs.birth_precision=1e-3"];
    let found = digests(&run(&at("other"), 2, &with(&looking)));
    assert_eq!(found[0], expected[0], "{dimension}, with spectra");
    // Between strain steps, after the last of them, then within Newton's equations.
    let stopped = run(&at("part"), 2, &with(&["--stop-at=2"]));
    assert_eq!(stopped.code, 75, "{}", stopped.text);
    let resume = format!("--resume={}", at("part").join("checkpoint.h5").display());
    let last = gshear_mpi(3, &at("part"), &[resume.clone(), "--stop-at=4".into()]);
    assert_eq!(last.code, 75, "{}", last.text);
    assert!(
        last.text.contains("stopped in aqs at step 4"),
        "{}",
        last.text
    );
    let later = [resume.clone(), "--stop-at=400".into()];
    let stopped = gshear_mpi(1, &at("part"), &later);
    assert!(
        stopped.text.contains("stopped in newtonian"),
        "{}",
        stopped.text
    );
    let unbroken = run(&at("other"), 3, &with(&["--stop-at=400"]));
    assert_eq!(unbroken.code, 75, "{}", unbroken.text);
    let beyond = beyond_the_digest(&at("other"));
    assert_eq!(
        beyond_the_digest(&at("part")),
        beyond,
        "{dimension}, resumed"
    );
    let known = |limits: &i64| limits & 0b100 != 0;
    assert!(beyond[1].iter().all(known), "{dimension}");
    let resumed = gshear_mpi(3, &at("part"), &[resume]);
    let found = [said(&stopped), digests(&resumed)].concat();
    assert_eq!(found, expected, "{dimension}, resumed");
    let read = |name: &str, file: &str| {
        let run = RunFile::open_any(&at(name).join(file)).expect("a file of the run");
        let columns = run.series().declared;
        let bits = |column: &Column| -> Vec<u64> {
            let values = run.series().column(column.name);
            values.iter().map(|x| x.to_bits()).collect()
        };
        columns.iter().map(bits).collect::<Vec<_>>()
    };
    for file in [RUN_FILE, NEWTONIAN_PART] {
        assert_eq!(read("part", file), read("one", file), "{file}");
    }
}

/// A sample that is soon at rest.
#[test]
fn spheres_in_a_box_keep_the_contracts() {
    keeps_the_contracts("--set=dimension=3", "--set=seed=5");
}

/// At their own fraction, and in a box long enough for three slabs.
#[test]
fn disks_in_a_box_keep_the_contracts() {
    keeps_the_contracts("--set=dimension=2", "--set=sample.solid_fraction=0.9");
}
