//! Runs in a periodic sheared box, through the real program: the contracts, bits compared, and what the paper's stages must give.

mod common;

use std::path::Path;

use common::{Outcome, gshear_mpi};
use gshear::analysis::growth;
use gshear::io::run_reader::PeriodicRun;
use gshear::periodic::{AQS_COLUMNS, AQS_FILE, NEWTONIAN_COLUMNS, NEWTONIAN_FILE};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");

fn run(folder: &Path, ranks: usize, more: &[&str]) -> Outcome {
    let mut arguments = vec![SCENE.to_string()];
    arguments.extend(more.iter().map(|s| s.to_string()));
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

/// Contracts 1 to 3 in 2D and 3D: any number of ranks, threads, instruction sets and skins; other output; stopped and gone on with.
#[test]
fn neither_bookkeeping_nor_output_reaches_the_numbers() {
    let _alone = common::alone();
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    for dimension in ["--set=dimension=3", "--set=dimension=2"] {
        // Disks at their own fraction, and in a box long enough for three slabs.
        let fraction = match dimension {
            "--set=dimension=2" => "--set=box.solid_fraction=0.9",
            _ => "--set=box.solid_fraction=0.72",
        };
        let base = [dimension, fraction];
        let with = |more: &[&'static str]| [&base[..], more].concat();
        let expected = digests(&run(&at("one"), 1, &base));
        assert_eq!(expected.len(), 2);
        for (ranks, more) in [
            (2, &[][..]),
            (3, &["--set=bookkeeping.skin=0.05"]),
            (2, &["--threads=2", "--set=bookkeeping.rebuild_every=7"]),
        ] {
            let found = digests(&run(&at("other"), ranks, &with(more)));
            assert_eq!(found, expected, "{dimension}, {ranks} ranks, {more:?}");
        }
        for simd in ["portable", "avx2"] {
            if gshear::simd::Level::named(simd).is_some() {
                let set = format!("--set=bookkeeping.simd={simd}");
                let found = digests(&run(&at("other"), 1, &[&base[..], &[&*set]].concat()));
                assert_eq!(found, expected, "{dimension}, {simd}");
            }
        }
        let overdamped = ["--set=relax.method=overdamped", "--set=aqs.steps=2"];
        let [one, two] = [1, 2].map(|ranks| digests(&run(&at("other"), ranks, &with(&overdamped))));
        assert_eq!(one, two, "{dimension}, overdamped");
        // Contract 2: what is written, and the birth that is looked for on the way, change nothing.
        let other_output = [
            "--set=aqs.frame_every=1",
            "--set=newtonian.rows=7",
            "--set=newtonian.frames=0",
        ];
        let found = digests(&run(&at("other"), 1, &with(&other_output)));
        assert_eq!(found, expected, "{dimension}, other output");
        let looking = ["--set=aqs.spectrum=true", "--set=aqs.birth_precision=1e-3"];
        let found = digests(&run(&at("other"), 2, &with(&looking)));
        assert_eq!(found[0], expected[0], "{dimension}, with spectra");
        // Between strain steps, then within Newton's equations.
        let stopped = run(&at("part"), 2, &with(&["--stop-at=5"]));
        assert_eq!(stopped.code, 75, "{}", stopped.text);
        let resume = format!("--resume={}", at("part").join("checkpoint.h5").display());
        let later = [resume.clone(), "--stop-at=400".into()];
        let stopped = gshear_mpi(1, &at("part"), &later);
        assert!(
            stopped.text.contains("stopped in newtonian"),
            "{}",
            stopped.text
        );
        let resumed = gshear_mpi(3, &at("part"), &[resume]);
        let found = [said(&stopped), digests(&resumed)].concat();
        assert_eq!(found, expected, "{dimension}, resumed");
        let read = |name: &str, file: &str, columns: &[gshear_dem::columns::Column]| {
            let run = PeriodicRun::open(&at(name).join(file), columns).expect("a file of the run");
            let bits = |column: &gshear_dem::columns::Column| -> Vec<u64> {
                run.column(column.name).iter().map(|x| x.to_bits()).collect()
            };
            columns.iter().map(bits).collect::<Vec<_>>()
        };
        for (file, columns) in [
            (AQS_FILE, &AQS_COLUMNS[..]),
            (NEWTONIAN_FILE, &NEWTONIAN_COLUMNS),
        ] {
            assert_eq!(
                read("part", file, columns),
                read("one", file, columns),
                "{file}"
            );
        }
    }
}

/// Newton's method reaches what overdamped dynamics reaches where no contact opens: the same energy, stress and pressure.
#[test]
fn newtons_method_finds_the_state_of_overdamped_dynamics() {
    let _alone = common::alone();
    let folder = tempfile::tempdir().expect("a folder");
    let of = |method: &str| {
        let folder = folder.path().join(method);
        let method = format!("--set=relax.method={method}");
        let more = [
            &*method,
            "--set=relax.tolerance=1e-12",
            "--set=relax.drag=0.022",
            "--set=contact.friction=10.0",
            "--set=aqs.strain_step=1e-6",
            "--set=newtonian.growth_times=none",
            "--set=newtonian.rows=none",
            "--set=newtonian.frames=none",
        ];
        let outcome = run(&folder, 1, &more);
        assert_eq!(outcome.code, 0, "{}", outcome.text);
        PeriodicRun::open(&folder.join(AQS_FILE), &AQS_COLUMNS).expect("a file of the run")
    };
    let (newton, overdamped) = (of("newton"), of("overdamped"));
    let fell_back: f64 = newton.column("fell_back").iter().sum();
    assert!(fell_back < 3.0, "{fell_back} of 8 steps were not smooth");
    assert!(
        overdamped
            .column("overdamped_steps")
            .iter()
            .skip(1)
            .all(|n| *n > 0.0)
    );
    for name in ["elastic_energy", "pressure"] {
        for (a, b) in newton.column(name).iter().zip(overdamped.column(name)) {
            assert!((a / b - 1.0).abs() < 1e-9, "{name}: {a} {b}");
        }
    }
    let change = |run: &PeriodicRun| {
        let stress = run.column("shear_stress");
        stress[8] - stress[0]
    };
    assert!((change(&newton) / change(&overdamped) - 1.0).abs() < 1e-5);
}

/// Newton's equations let the pair grow and oscillate as its eigenvalue says (BO eq. 8), over 8 decades.
#[test]
fn a_complex_pair_grows_as_its_eigenvalue_says() {
    let _alone = common::alone();
    let folder = tempfile::tempdir().expect("a folder");
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/configs/bonfanti.toml");
    let mut arguments = vec![scene.to_string()];
    for set in [
        "aqs.birth_precision=1e-5",
        "aqs.until_imaginary=5e-5",
        "newtonian.growth_times=20.0",
        "newtonian.rows=4000",
        "newtonian.frames=0",
        "newtonian.spectra=0",
    ] {
        arguments.push(format!("--set={set}"));
    }
    let outcome = gshear_mpi(1, folder.path(), &arguments);
    assert_eq!(outcome.code, 0, "{}", outcome.text);
    let run = PeriodicRun::open(&folder.path().join(NEWTONIAN_FILE), &NEWTONIAN_COLUMNS)
        .expect("a file of the run");
    let growth = growth::fit(&run.time, run.column("msd"), 1e-11).expect("growth");
    let of = |name: &str| run.number(name).expect("a complex pair");
    assert!(growth.decades > 8.0, "{growth:?}");
    assert!(
        (growth.omega_i / of("omega_i") - 1.0).abs() < 0.01,
        "{growth:?}"
    );
    assert!(
        (growth.omega_r / of("omega_r") - 1.0).abs() < 0.01,
        "{growth:?}"
    );
}
