//! The contracts with linear springs, through the real program: bits compared, never approximately.

mod common;

use common::crossing::{SCENE, resumed, whole};
use common::{gshear_mpi, same_run};

/// Contracts 1 and 3 with linear springs, whose histories are fewer.
#[test]
fn linear_springs_keep_the_contracts() {
    let _alone = common::alone();
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
        (
            "frictionless",
            &["contact.rolling_friction=0", "contact.friction=0"],
        ),
    ] {
        let one = folder.path().join(name);
        let sets = [&springs[..], law].concat();
        let expected = whole(&one, 1, &sets).digest();
        let two = folder.path().join(format!("{name}-2"));
        let ranks = [&sets[..], &["bookkeeping.skin=0.3"]].concat();
        assert_eq!(whole(&two, 2, &ranks).digest(), expected, "{name}");
        same_run(&one, &two);

        let mut arguments = vec![SCENE.to_string(), "--stop-at=600".into()];
        arguments.extend(sets.iter().map(|s| format!("--set={s}")));
        let broken = folder.path().join(format!("{name}-broken"));
        assert_eq!(gshear_mpi(2, &broken, &arguments).code, 75);
        let checkpoint = broken.join("checkpoint.h5");
        let mut kinds = vec![(3, "bookkeeping.rebuild_every=7".to_string())];
        for simd in ["portable", "avx2", "avx512"] {
            if gshear_dem::simd::Isa::named(simd).is_some() {
                kinds.push((1, format!("bookkeeping.simd={simd}")));
            }
        }
        for (ranks, set) in kinds {
            let other = folder.path().join(format!("{name}-other"));
            let outcome = resumed(&checkpoint, &other, ranks, &[&set]);
            assert_eq!(outcome.digest(), expected, "{name}: {ranks} ranks, {set}");
        }
    }
}
