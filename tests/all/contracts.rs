//! The contracts, through the real program: bits compared, never approximately.

use std::path::Path;

use crate::common::crossing::{PACKED, SCENE, resumed, stopped, whole};
use crate::common::{self, beyond_the_digest, gshear_mpi, same_run};
use gshear_dem::domain::Solo;
use gshear_store::checkpoint;
use serde_json::Value;

/// Contract 1: ranks, slabs, skins, rebuilds, instruction sets.
#[test]
fn bookkeeping_never_reaches_the_numbers() {
    let folder = tempfile::tempdir().expect("a folder");
    let one = folder.path().join("one");
    let expected = whole(&one, 1, &[]).digest();
    let beyond = beyond_the_digest(&one);
    assert!(
        beyond[1].iter().any(|limit| limit & 0b101 == 0b101),
        "nothing slides"
    );

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
    let threads = folder.path().join("threads");
    let arguments = [SCENE.to_string(), "--threads=3".into()];
    let outcome = gshear_mpi(1, &threads, &arguments);
    assert_eq!(outcome.digest(), expected, "3 threads");
    same_run(&one, &threads);

    let start = stopped(&folder.path().join("start"), 1, 1, &[]);
    for (ranks, set) in [
        (1, &["bookkeeping.skin=0.05"][..]),
        (1, &["bookkeeping.skin=0.5", "bookkeeping.rebuild_every=1"]),
        (2, &["bookkeeping.skin=0.05", "bookkeeping.rebuild_every=7"]),
        (3, &["bookkeeping.skin=0.3"]),
        (
            1,
            &["bookkeeping.band_grains=20", "bookkeeping.steps_at_once=7"],
        ),
        (
            3,
            &["bookkeeping.band_grains=20", "bookkeeping.steps_at_once=16"],
        ),
        (2, &["bookkeeping.band_grains=20"]),
        (
            3,
            &["bookkeeping.simd=portable", "bookkeeping.rebuild_every=13"],
        ),
        (5, &["bookkeeping.skin=0.05"]),
    ] {
        let other = folder.path().join("other");
        let outcome = resumed(&start, &other, ranks, set);
        assert_eq!(outcome.digest(), expected, "{ranks} ranks, {set:?}");
        assert_eq!(beyond_the_digest(&other), beyond, "{ranks} ranks, {set:?}");
        if set[0] == "bookkeeping.band_grains=20" {
            let said = &outcome.text;
            assert!(said.contains(" steps at once"), "no bands: {said}");
        }
    }
    // With one band, and with several.
    for (ranks, threads, band) in [(1, 3, 1_000_000), (1, 2, 20), (2, 2, 1_000_000), (2, 2, 20)] {
        let arguments = [
            format!("--resume={}", start.display()),
            format!("--threads={threads}"),
            format!("--set=bookkeeping.band_grains={band}"),
        ];
        let outcome = gshear_mpi(ranks, &folder.path().join("other"), &arguments);
        let of = format!("{ranks} ranks, {threads} threads, bands of {band}");
        assert_eq!(outcome.digest(), expected, "{of}");
        assert_eq!(outcome.text.contains(" steps at once"), band == 20, "{of}");
        let found = beyond_the_digest(&folder.path().join("other"));
        assert_eq!(found, beyond, "{of}");
    }
    // Messages through MPI, as between nodes, in place of shared memory: in bands one message has
    // those of several steps.
    for band in [1_000_000, 20] {
        let arguments = [
            format!("--resume={}", start.display()),
            format!("--set=bookkeeping.band_grains={band}"),
        ];
        let apart = [("GSHEAR_NO_SHARED_MEMORY", "1")];
        let other = folder.path().join("other");
        let outcome = common::with_environment(&apart, 3, &other, &arguments);
        let of = format!("3 ranks without shared memory, bands of {band}");
        assert_eq!(outcome.digest(), expected, "{of}");
        assert_eq!(outcome.text.contains(" steps at once"), band == 20, "{of}");
        assert_eq!(beyond_the_digest(&other), beyond, "{of}");
    }
    if common::avx2().ends_with("avx2") {
        let other = folder.path().join("avx2");
        let outcome = resumed(&start, &other, 1, &["bookkeeping.simd=avx2"]);
        assert_eq!(outcome.digest(), expected, "avx2");
        assert_eq!(beyond_the_digest(&other), beyond, "avx2");
    }
}

/// Earlier builds tried settings of speed if the scene said so, and kept the fastest in the
/// checkpoint.
#[test]
fn a_checkpoint_with_settings_of_an_earlier_build_is_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let expected = whole(&folder.path().join("one"), 1, &PACKED).digest();
    let start = stopped(&folder.path().join("start"), 1, 1, &PACKED);
    let ([header, scene], state) = checkpoint::read(&Solo, &start).expect("a checkpoint");
    let mut header: Value = serde_json::from_str(&header).expect("JSON");
    header["run"]["tuned"] = serde_json::json!({
        "passes": { "blocks": 8, "prefetch": true, "narrow": false },
        "list_steps": 900.0,
    });
    let scene = scene.replace(
        "[bookkeeping]\n",
        "[bookkeeping]\ntune = true\ntune_every = 0\n",
    );
    assert!(scene.contains("tune_every"), "{scene}");
    let on = folder.path().join("on");
    std::fs::create_dir(&on).expect("a folder");
    checkpoint::write(&Solo, &on, [&header.to_string(), &scene], &state).expect("written");
    let path = on.join("checkpoint.h5");
    assert_eq!(resumed(&path, &on, 1, &[]).digest(), expected);
}

/// That the scene is the test it is meant to be: grains change slabs and cross the seam, and
/// contacts slide across both.
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
    let folder = tempfile::tempdir().expect("a folder");
    let start = stopped(&folder.path().join("start"), 1, 1, &[]);
    let run =
        |name: &str, ranks, set: &[&str]| resumed(&start, &folder.path().join(name), ranks, set);
    let expected = run("plain", 1, &[]).digest();
    let beyond = beyond_the_digest(&folder.path().join("plain"));
    let none = &[
        "output.frame_strain=0.0",
        "output.series_strain=0.0",
        "output.energy=false",
    ][..];
    let much = &[
        "output.frame_strain=1e-9",
        "output.series_strain=1e-9",
        "output.checkpoint_strain=0.1",
    ][..];
    let late = &[
        "output.frame_strain=0.013",
        "output.frame_start=0.5",
        "output.series_strain=0.1",
        "output.temperatures=false",
    ][..];
    for (name, ranks, set) in [("none", 1, none), ("much", 2, much), ("late", 3, late)] {
        assert_eq!(run(name, ranks, set).digest(), expected, "{name}");
        assert_eq!(
            beyond_the_digest(&folder.path().join(name)),
            beyond,
            "{name}"
        );
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
    let folder = tempfile::tempdir().expect("a folder");
    let unbroken = folder.path().join("unbroken");
    let expected = whole(&unbroken, 1, &PACKED).digest();
    for (before, step, after) in [(2, 1733, 1), (1, 4001, 3), (3, 5000, 5)] {
        let broken = folder.path().join(format!("broken-{step}"));
        let checkpoint = stopped(&broken, before, step, &PACKED);
        let outcome = resumed(&checkpoint, &broken, after, &[]);
        assert_eq!(
            outcome.digest(),
            expected,
            "{before} ranks to step {step}, then {after}"
        );
        same_run(&unbroken, &broken);
        assert_eq!(beyond_the_digest(&unbroken), beyond_the_digest(&broken));
        let log = |folder: &Path| std::fs::read(folder.join("log.csv")).expect("log.csv");
        assert_eq!(log(&unbroken), log(&broken));
    }
}

/// A signal stops the run wherever it is, packing too; twice, so that a resumed run can be stopped
/// as well.
#[test]
fn a_signal_stops_at_a_checkpoint() {
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
