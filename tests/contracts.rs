//! The contracts, through the real program: bits compared, never approximately.

mod common;

use std::path::{Path, PathBuf};

use common::{Outcome, gshear_mpi, same_run};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing.toml");

/// A run of the crossing scene from the first grain, in `folder`.
fn whole(folder: &Path, ranks: usize, set: &[&str]) -> Outcome {
    let mut arguments = vec![SCENE.to_string()];
    arguments.extend(set.iter().map(|s| format!("--set={s}")));
    gshear_mpi(ranks, folder, &arguments)
}

/// The same from a checkpoint.
fn resumed(checkpoint: &Path, folder: &Path, ranks: usize, set: &[&str]) -> Outcome {
    let mut arguments = vec![format!("--resume={}", checkpoint.display())];
    arguments.extend(set.iter().map(|s| format!("--set={s}")));
    gshear_mpi(ranks, folder, &arguments)
}

/// Stops the crossing scene after `step` of the shear and returns the checkpoint.
fn stopped(folder: &Path, ranks: usize, step: u64) -> PathBuf {
    let stop = format!("--stop-at={step}");
    let outcome = gshear_mpi(ranks, folder, &[SCENE.into(), stop]);
    assert_eq!(outcome.code, 75, "{}", outcome.text);
    folder.join("checkpoint.h5")
}

/// Contract 1: ranks, slabs, skins, rebuilds, instruction sets.
#[test]
fn bookkeeping_never_reaches_the_numbers() {
    let _alone = common::alone();
    let folder = tempfile::tempdir().expect("a folder");
    let one = folder.path().join("one");
    let expected = whole(&one, 1, &[]).digest();

    for (ranks, set) in [
        (2, &[][..]),
        (5, &["bookkeeping.skin=0.3", "bookkeeping.rebuild_every=40"]),
    ] {
        let other = folder.path().join(format!("whole-{ranks}"));
        let outcome = whole(&other, ranks, set);
        assert_eq!(outcome.digest(), expected, "{ranks} ranks, {set:?}");
        same_run(&one, &other);
        if ranks == 5 {
            grains_cross(&other);
        }
    }

    let start = stopped(&folder.path().join("start"), 1, 1);
    for (ranks, set) in [
        (1, &["bookkeeping.skin=0.05"][..]),
        (1, &["bookkeeping.skin=0.5", "bookkeeping.rebuild_every=1"]),
        (1, &["bookkeeping.simd=portable"]),
        (2, &["bookkeeping.skin=0.05", "bookkeeping.rebuild_every=7"]),
        (3, &["bookkeeping.skin=0.3"]),
        (
            3,
            &["bookkeeping.simd=portable", "bookkeeping.rebuild_every=13"],
        ),
        (5, &["bookkeeping.skin=0.05"]),
    ] {
        let other = folder.path().join("other");
        let outcome = resumed(&start, &other, ranks, set);
        assert_eq!(outcome.digest(), expected, "{ranks} ranks, {set:?}");
    }
    for (ranks, threads) in [(1, 3), (2, 2)] {
        let arguments = [
            format!("--resume={}", start.display()),
            format!("--threads={threads}"),
        ];
        let outcome = gshear_mpi(ranks, &folder.path().join("other"), &arguments);
        assert_eq!(
            outcome.digest(),
            expected,
            "{ranks} ranks, {threads} threads"
        );
    }
    // Messages through MPI, as between nodes, in place of shared memory.
    let arguments = [format!("--resume={}", start.display())];
    let apart = [("GSHEAR_NO_SHARED_MEMORY", "1")];
    let other = folder.path().join("other");
    let outcome = common::with_environment(&apart, 3, &other, &arguments);
    assert_eq!(outcome.digest(), expected, "3 ranks without shared memory");
    for simd in ["avx2", "avx512"] {
        if gshear_dem::simd::Level::named(simd).is_some() {
            let set = [format!("bookkeeping.simd={simd}")];
            let set: Vec<&str> = set.iter().map(String::as_str).collect();
            let outcome = resumed(&start, &folder.path().join("simd"), 1, &set);
            assert_eq!(outcome.digest(), expected, "{simd}");
        }
    }
}

/// Contracts 1, 2 and 3 of spheres with vectors for histories, under a spring and a protocol with a hold.
#[test]
fn spheres_under_a_spring_keep_the_contracts() {
    const SPHERES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing-3d.toml");
    let _alone = common::alone();
    let folder = tempfile::tempdir().expect("a folder");
    let run = |name: &str, ranks, further: &[&str]| {
        let mut arguments = vec![SPHERES.to_string()];
        arguments.extend(further.iter().map(|s| s.to_string()));
        gshear_mpi(ranks, &folder.path().join(name), &arguments)
    };
    let expected = run("one", 1, &[]).digest();
    let five = run("five", 5, &["--set=bookkeeping.skin=0.3"]);
    assert_eq!(five.digest(), expected, "5 ranks");
    same_run(&folder.path().join("one"), &folder.path().join("five"));
    spheres_cross(&folder.path().join("five"));

    assert_eq!(run("start", 2, &["--stop-at=1"]).code, 75);
    let start = folder.path().join("start/checkpoint.h5");
    for (ranks, further) in [
        (2, &["--set=bookkeeping.rebuild_every=7"][..]),
        (3, &["--set=bookkeeping.simd=portable"]),
        (1, &["--set=bookkeeping.simd=avx2", "--threads=3"]),
        (
            1,
            &["--set=output.series_rows=0", "--set=output.energy=false"],
        ),
        (
            2,
            &["--set=output.frame_rows=500", "--set=output.series_rows=1"],
        ),
    ] {
        let unknown = further.iter().any(|set| set.ends_with("avx2"))
            && gshear_dem::simd::Level::named("avx2").is_none();
        if unknown {
            continue;
        }
        let mut arguments = vec![format!("--resume={}", start.display())];
        arguments.extend(further.iter().map(|s| s.to_string()));
        let outcome = gshear_mpi(ranks, &folder.path().join("other"), &arguments);
        assert_eq!(outcome.digest(), expected, "{ranks} ranks, {further:?}");
    }

    // In the hold, and again in the last part.
    assert_eq!(run("broken", 3, &["--stop-at=3100"]).code, 75);
    let broken = folder.path().join("broken");
    let resume = format!("--resume={}", broken.join("checkpoint.h5").display());
    let again = gshear_mpi(1, &broken, &[resume.clone(), "--stop-at=4000".into()]);
    assert_eq!(again.code, 75, "{}", again.text);
    assert_eq!(gshear_mpi(2, &broken, &[resume]).digest(), expected);
    same_run(&folder.path().join("one"), &broken);
}

/// That spheres change slabs and cross both seams, and contacts slide across.
fn spheres_cross(folder: &Path) {
    let file = hdf5::File::open(folder.join("run.h5")).expect("run.h5");
    let read = |name: &str| file.dataset(name).expect(name);
    let position = read("particles/trajectory/position/value")
        .read::<f64, ndarray::Ix3>()
        .expect("positions");
    let parameters = file.group("parameters").expect("parameters");
    let cuts: Vec<f64> = parameters
        .attr("rank_map")
        .and_then(|a| a.read_raw())
        .expect("rank_map");
    let slab = |x: f64| cuts.iter().filter(|&&c| c <= x).count();
    let edges: Vec<f64> = read("particles/trajectory/box/edges")
        .read_raw()
        .expect("edges");
    let mut counts = [0; 5];
    let (frames, grains) = (position.shape()[0], position.shape()[1]);
    for t in 1..frames {
        for g in 0..grains {
            let at = |axis: usize| [position[[t - 1, g, axis]], position[[t, g, axis]]];
            let [a, b] = at(0);
            counts[0] += usize::from(slab(a) != slab(b));
            for axis in 0..2 {
                let [a, b] = at(axis);
                counts[1 + axis] += usize::from((a - b).abs() > 0.5 * edges[axis]);
            }
        }
    }
    let of = |name: &str| read(&format!("connectivity/contacts/{name}"));
    let offset: Vec<u64> = of("offset").read_raw().expect("offsets");
    let i: Vec<u32> = of("i").read_raw().expect("i");
    let j: Vec<u32> = of("j").read_raw().expect("j");
    let sliding: Vec<u8> = of("sliding").read_raw().expect("sliding");
    for t in 0..frames {
        for c in offset[t] as usize..offset[t + 1] as usize {
            let at = |id: u32, axis: usize| position[[t, id as usize, axis]];
            let over = |axis| (at(i[c], axis) - at(j[c], axis)).abs() > 0.5 * edges[axis];
            let slides = sliding[c] == 1;
            counts[3] += usize::from(slides && slab(at(i[c], 0)) != slab(at(j[c], 0)));
            counts[4] += usize::from(slides && (over(0) || over(1)));
        }
    }
    // Grains that changed slabs, and crossed the seams; contacts sliding over cuts, and over seams.
    assert!(counts.iter().all(|&n| n >= 20), "{counts:?}");
}

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
            if gshear_dem::simd::Level::named(simd).is_some() {
                kinds.push((1, format!("bookkeeping.simd={simd}")));
            }
        }
        for (ranks, set) in kinds {
            let other = folder.path().join("other");
            let outcome = resumed(&checkpoint, &other, ranks, &[&set]);
            assert_eq!(outcome.digest(), expected, "{name}: {ranks} ranks, {set}");
        }
    }
}

/// That the scene is the test it is meant to be: grains change slabs and cross the seam, and contacts slide across both.
fn grains_cross(folder: &Path) {
    let file = hdf5::File::open(folder.join("run.h5")).expect("run.h5");
    let read = |name: &str| file.dataset(name).expect(name);
    let position = read("particles/trajectory/position/value")
        .read::<f64, ndarray::Ix3>()
        .expect("positions");
    let cuts: Vec<f64> = file
        .group("parameters")
        .and_then(|g| g.attr("rank_map")?.read_raw())
        .expect("rank_map");
    let length = cuts[cuts.len() - 1];
    let slab = |x: f64| cuts.iter().filter(|&&c| c <= x).count();
    let (frames, grains) = (position.shape()[0], position.shape()[1]);
    let (mut changed, mut crossed) = (0, 0);
    for t in 1..frames {
        for g in 0..grains {
            let (a, b) = (position[[t - 1, g, 0]], position[[t, g, 0]]);
            changed += usize::from(slab(a) != slab(b));
            crossed += usize::from((a - b).abs() > 0.5 * length);
        }
    }
    let offset: Vec<u64> = read("connectivity/contacts/offset")
        .read_raw()
        .expect("offsets");
    let of = |name: &str| read(&format!("connectivity/contacts/{name}"));
    let i: Vec<u32> = of("i").read_raw().expect("i");
    let j: Vec<u32> = of("j").read_raw().expect("j");
    let sliding: Vec<u8> = of("sliding").read_raw().expect("sliding");
    let (mut over_a_cut, mut over_the_seam) = (0, 0);
    for t in 0..frames {
        for c in offset[t] as usize..offset[t + 1] as usize {
            let x = |id: u32| position[[t, id as usize, 0]];
            let (a, b) = (x(i[c]), x(j[c]));
            over_a_cut += usize::from(sliding[c] == 1 && slab(a) != slab(b));
            over_the_seam += usize::from(sliding[c] == 1 && (a - b).abs() > 0.5 * length);
        }
    }
    for (what, count) in [
        ("grains that changed slabs", changed),
        ("grains that crossed the seam", crossed),
        ("contacts sliding over a cut", over_a_cut),
        ("contacts sliding over the seam", over_the_seam),
    ] {
        assert!(count >= 20, "only {count} {what}");
    }
}

/// Contract 2.
#[test]
fn output_changes_nothing() {
    let _alone = common::alone();
    let folder = tempfile::tempdir().expect("a folder");
    let start = stopped(&folder.path().join("start"), 1, 1);
    let run =
        |name: &str, ranks, set: &[&str]| resumed(&start, &folder.path().join(name), ranks, set);
    let expected = run("plain", 1, &[]).digest();
    let none = [
        "output.frame_strain=0.0",
        "output.series_strain=0.0",
        "output.energy=false",
    ];
    let much = [
        "output.frame_strain=1e-9",
        "output.series_strain=1e-9",
        "output.checkpoint_strain=0.1",
    ];
    let late = [
        "output.frame_strain=0.013",
        "output.frame_start=0.5",
        "output.series_strain=0.1",
    ];
    for (name, ranks, set) in [("none", 1, none), ("much", 2, much), ("late", 3, late)] {
        assert_eq!(run(name, ranks, &set).digest(), expected, "{name}");
    }
    let frames = |name: &str| {
        let file = hdf5::File::open(folder.path().join(name).join("run.h5")).expect("run.h5");
        file.dataset("particles/trajectory/position/step")
            .expect("step")
            .size()
    };
    assert!(
        frames("much") > 50 * frames("plain") && frames("none") == 0,
        "the outputs differ"
    );
}

/// Contract 3, on other numbers of ranks, and the files go on as if nothing had been.
#[test]
fn a_stopped_run_goes_on_exactly() {
    let _alone = common::alone();
    let folder = tempfile::tempdir().expect("a folder");
    let unbroken = folder.path().join("unbroken");
    let expected = whole(&unbroken, 1, &[]).digest();
    for (before, step, after) in [(2, 1733, 1), (1, 4001, 3), (3, 5000, 5)] {
        let broken = folder.path().join(format!("broken-{step}"));
        let checkpoint = stopped(&broken, before, step);
        let outcome = resumed(&checkpoint, &broken, after, &[]);
        assert_eq!(
            outcome.digest(),
            expected,
            "{before} ranks to step {step}, then {after}"
        );
        same_run(&unbroken, &broken);
        let log = |folder: &Path| std::fs::read(folder.join("log.csv")).expect("log.csv");
        assert_eq!(log(&unbroken), log(&broken));
    }
}

/// A signal stops the run wherever it is, packing too; twice, so that a resumed run can be stopped as well.
#[test]
fn a_signal_stops_at_a_checkpoint() {
    let _alone = common::alone();
    let folder = tempfile::tempdir().expect("a folder");
    let expected = whole(&folder.path().join("unbroken"), 1, &[]).digest();
    let broken = folder.path().join("broken");
    let mut arguments = vec![SCENE.to_string()];
    let mut stops = 0;
    let outcome = loop {
        let outcome = if stops < 2 {
            common::interrupted(&broken, &arguments)
        } else {
            gshear_mpi(1, &broken, &arguments)
        };
        if outcome.code != 75 {
            break outcome;
        }
        assert!(
            outcome.text.contains("stopped in packing"),
            "{}",
            outcome.text
        );
        stops += 1;
        arguments = vec![format!(
            "--resume={}",
            broken.join("checkpoint.h5").display()
        )];
    };
    assert!(stops > 0);
    assert_eq!(outcome.digest(), expected);
}
