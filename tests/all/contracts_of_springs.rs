//! The contracts with linear springs, and with dampers on sliding contacts, through the real
//! program: bits compared, never approximately.

use std::path::Path;

use crate::common::crossing::{PACKED, resumed, stopped, whole};
use crate::common::same_run;
use gshear_store::run_reader::RunFile;

/// Contracts 1 and 3 with linear springs, whose histories are fewer.
#[test]
fn linear_springs_keep_the_contracts() {
    let folder = tempfile::tempdir().expect("a folder");
    let springs = [
        "contact.law=hooke",
        "material.young_modulus=none",
        "material.poisson_ratio=none",
        "contact.normal_stiffness=1.5e8",
        "shear.strain=0.4",
    ];
    for (name, law) in [
        ("full", &[][..]),
        ("sliding", &["contact.rolling_friction=0"]),
        ("damped", &["contact.sliding_damping=0.6"]),
        (
            "ageing",
            &[
                "contact.ageing=0.1",
                "contact.ageing_time=1e-7",
                "contact.ageing_slip=1e-9",
            ],
        ),
        ("attracting", &["contact.attraction=0.3"]),
        ("flat", &["sample.walls=flat"]),
        (
            "frictionless",
            &["contact.rolling_friction=0", "contact.friction=0"],
        ),
    ] {
        let sets = [&springs[..], law].concat();
        keeps_the_contracts(folder.path(), name, &sets);
    }
}

/// Shears the packed crossing scene with these keys on one rank and on two, with another skin, and
/// from a checkpoint in every way of computing it. Returns the digest.
fn keeps_the_contracts(folder: &Path, name: &str, sets: &[&str]) -> String {
    let sets = &[&PACKED[..], sets].concat();
    let one = folder.join(name);
    let expected = whole(&one, 1, sets).digest();
    let two = folder.join(format!("{name}-2"));
    let ranks = [&sets[..], &["bookkeeping.skin=0.3"]].concat();
    assert_eq!(whole(&two, 2, &ranks).digest(), expected, "{name}");
    same_run(&one, &two);

    let checkpoint = stopped(&folder.join(format!("{name}-broken")), 2, 600, sets);
    for (ranks, set) in [
        (3, &["bookkeeping.rebuild_every=7"][..]),
        (1, &["bookkeeping.simd=portable"]),
        (
            1,
            &["bookkeeping.steps_at_once=5", "bookkeeping.band_grains=20"],
        ),
    ] {
        let other = folder.join(format!("{name}-other"));
        let outcome = resumed(&checkpoint, &other, ranks, set);
        assert_eq!(outcome.digest(), expected, "{name}: {ranks} ranks, {set:?}");
    }
    expected
}

/// Contracts 1 and 3 with dampers on sliding contacts (LH A6 and A11 as printed). They dissipate
/// more, and the energy budget still closes.
#[test]
fn dampers_on_sliding_contacts_keep_the_contracts() {
    let folder = tempfile::tempdir().expect("a folder");
    let strain = "shear.strain=0.4";
    let at = |name: &str| RunFile::open(&folder.path().join(name)).expect("a run");
    let with = keeps_the_contracts(
        folder.path(),
        "with",
        &[strain, "contact.sliding_damping=1"],
    );
    let packed = [&PACKED[..], &[strain]].concat();
    let without = whole(&folder.path().join("without"), 1, &packed).digest();
    assert_ne!(with, without);
    let last = |run: &RunFile, column: &str| *run.series().column(column).last().expect("a row");
    let [with, without] = ["with", "without"].map(at);
    for run in [&with, &without] {
        let residual = last(run, "energy_residual");
        assert!(residual.abs() < 1e-3, "{residual}");
    }
    let share = |run: &RunFile| {
        last(run, "dissipated_damping")
            / (last(run, "dissipated_damping") + last(run, "dissipated_friction"))
    };
    assert!(share(&with) > share(&without));
}
