//! Grains that pass a wall and are removed, through the real programs.

use std::fmt::Write;
use std::path::Path;

use crate::common::{beyond_the_digest, gshear_mpi, reducer, run_scene, same_run, succeed};
use gshear_analysis::dmin::NonAffine;
use gshear_store::run_reader::RunFile;

const RADIUS: f64 = 1e-3;
const GRAVITY: f64 = 9.81;
const STEP: f64 = 4e-6;
/// Where the grain that falls begins.
const START: f64 = 14e-3;
/// Where the other one lies, between two grains of the bottom.
const OTHER: f64 = 3e-3;

/// A bottom of grains side by side, with a hole below the grain that falls. In 3D it has two rows,
/// far enough from each other that nothing touches across y.
fn write_packing(path: &Path, disks: bool) {
    let row = (0..10).filter(|k| ![5, 6].contains(k));
    let bottom = row.map(|k| [RADIUS * f64::from(2 * k + 1), RADIUS]);
    let free = [
        [12e-3, START],
        [OTHER - RADIUS, RADIUS + 3_f64.sqrt() * RADIUS],
    ];
    let all = bottom.map(|at| (2, at)).chain(free.map(|at| (1, at)));
    let box_of = if disks {
        "0 0.02 ylo yhi\n-0.002 0.002 zlo zhi"
    } else {
        "0 0.01 ylo yhi\n0 0.02 zlo zhi"
    };
    let mut text =
        format!("a hole\n\n10 atoms\n2 atom types\n0 0.02 xlo xhi\n{box_of}\n\nAtoms # sphere\n\n");
    for (k, (kind, [x, up])) in all.enumerate() {
        let place = if disks {
            format!("{x:?} {up:?} 0.0")
        } else {
            format!("{x:?} 0.005 {up:?}")
        };
        let _ = writeln!(text, "{} {kind} {:?} 2500 {place}", k + 1, 2.0 * RADIUS);
    }
    std::fs::write(path, text).expect("a packing");
}

/// It falls freely, is removed in the hundredth step after it has passed the edge of the bottom at
/// the latest, and rests there. Sums then count the other grain alone, exports and packings too.
#[test]
fn a_grain_that_falls_through_a_hole_is_removed() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, disks) in [("disks", true), ("spheres", false)] {
        let up = if disks { 1 } else { 2 };
        write_packing(&folder.path().join(format!("{name}.data")), disks);
        let (law, dimension) = if disks {
            (
                "law = 'hooke', normal_stiffness = 1e6, damping_ratio = 0.3",
                2,
            )
        } else {
            (
                "law = 'hooke', normal_stiffness = 1e3, damping_ratio = 0.3",
                3,
            )
        };
        let scene = format!(
            "
            dimension = {dimension}
            material.density = 2500
            contact = {{ {law}, friction = 0.5 }}
            sample = {{ packing = '{name}.data', boundary = 'free', outside = 'remove' }}
            load.gravity = {GRAVITY}
            time.step = {STEP}
            shear.protocol = [{{ time = 0.08 }}]
            output = {{ series_rows = 100, frame_rows = 40 }}
            "
        );
        let run = run_scene(folder.path(), name, &scene, &[]);
        let steps_to_edge = (2.0 * START / GRAVITY).sqrt() / STEP;
        let removed = 100.0 * (steps_to_edge / 100.0).ceil();
        let fallen = |steps: f64| START - 0.5 * GRAVITY * (STEP * steps).powi(2);
        let records = run.records(0..run.frames()).expect("frames");
        let mut frames_after = 0;
        for frame in &records {
            let (grain, step) = (&frame.grains[8], frame.step as f64);
            let is_removed = step > removed;
            let expected = fallen(step.min(removed));
            let found = grain.position[up];
            assert!(
                (found - expected).abs() < 1e-12,
                "{name}: {found} {expected}"
            );
            assert_eq!(grain.velocity == [0.0; 3], is_removed || step == 0.0);
            assert_eq!(grain.image[up], 0);
            assert_eq!(frame.is_removed(8), is_removed);
            frames_after += usize::from(is_removed);
        }
        assert!((5..35).contains(&frames_after), "{frames_after}");

        let series = run.series();
        let last = series.rows() - 1;
        let mass = run.grains().mass[9];
        let carried = series.column("normal_force")[last] / (mass * GRAVITY);
        assert!((carried - 1.0).abs() < 1e-2, "{name}: {carried}");
        assert_eq!(series.column("coordination")[last], 2.0, "{name}");
        let before = series.column("coordination")[series.rows() / 2];
        assert_eq!(before, 1.0, "{name}");

        let out = folder.path().join(name);
        let export = |from: &Path, arguments: &[&str]| {
            let to = folder.path().join("exported");
            let mut command = reducer();
            command.arg("export").args(arguments).arg(from);
            succeed(command.arg("--out").arg(&to));
            to
        };
        let text = |path: &Path| std::fs::read_to_string(path).expect("text");
        let checkpoint = out.join("checkpoint.h5");
        for (from, frame) in [(&checkpoint, &[][..]), (&out, &["--frame=last"])] {
            let data = export(from, &[&["--format=lammps-data"], frame].concat());
            let data = text(&data);
            assert!(data.contains("\n9 atoms\n"), "{data}");
            assert!(!data.lines().any(|line| line.starts_with("9 1 ")), "{data}");
        }
        let last = |format: &str| export(&out, &["--frame=last", "--format", format]);
        assert!(text(&last("lammps-dump")).contains("NUMBER OF ATOMS\n9\n"));
        assert!(text(&last("xyz")).starts_with("9\n"));
        assert_eq!(text(&last("csv")).lines().count(), 10);
        let vtk = hdf5::File::open(last("vtkhdf")).expect("a file");
        let points = vtk.dataset("VTKHDF/NumberOfPoints").expect("points");
        assert_eq!(points.read_raw::<i64>().expect("a number"), [9]);

        // Another run begins with the grains that are left, here on a plane.
        let again = format!("{name}-again");
        let packing = format!("sample.packing={}", checkpoint.display());
        let run = run_scene(
            folder.path(),
            &again,
            &scene,
            &[&packing, "sample.outside=end", "sample.walls=flat"],
        );
        assert_eq!(run.grains().count(), 9);
    }
}

/// A packing with a hole in its bottom, from which grains leave one after the other.
fn write_leak(folder: &Path) -> String {
    let text = include_str!("../scenes/triangular.data").replace("120 atoms", "118 atoms");
    let is_of_hole = |line: &&str| ["4 ", "5 "].iter().any(|id| line.starts_with(id));
    let lines: Vec<&str> = text.lines().filter(|line| !is_of_hole(line)).collect();
    let numbered = |line: &str| match line.split_once(' ') {
        // Ids without gaps.
        Some((id, row))
            if row.split(' ').count() > 5 && id.parse::<u32>().is_ok_and(|id| id > 5) =>
        {
            format!("{} {row}", id.parse::<u32>().unwrap_or(0) - 2)
        }
        _ => line.to_string(),
    };
    let lines: Vec<String> = lines.into_iter().map(numbered).collect();
    std::fs::write(folder.join("leak.data"), lines.join("\n")).expect("a packing");
    let scene = folder.join("leak.toml");
    let text = "
        material.density = 2500
        contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.3, damping_ratio = 0.1 }
        sample = { packing = 'leak.data', outside = 'remove' }
        load = { stiffness_number = 1e3, gravity = 9.81 }
        shear = { inertial_number = 0.05, strain = 2.0 }
        output = { frame_strain = 0.02, series_strain = 1e-2, checkpoint_strain = 0.5, keep_checkpoints = true }
        ";
    std::fs::write(&scene, text).expect("a scene");
    scene.display().to_string()
}

/// D²min is that of the grains that are left, in both ways to sum it.
fn removed_grains_have_no_dmin(out: &Path) {
    succeed(reducer().arg("dmin").arg(out));
    let run = RunFile::open(out).expect("a run");
    let reduced = hdf5::File::open(out.join("reduced.h5")).expect("a file");
    let dmin = reduced.dataset("dmin/value").expect("D²min");
    let dmin = dmin.read_2d::<f64>().expect("numbers");
    let frames = run.records(0..run.frames()).expect("frames");
    let radius = 5.0 * run.grains().mean_radius();
    for t in 1..frames.len() {
        let interval = run.interval([t - 1, t], [&frames[t - 1], &frames[t]]);
        let mut wanted = vec![0.0; run.grains().count()];
        let mut direct = NonAffine::default();
        direct.grain_by_grain(run.grains(), &interval, radius, &mut wanted);
        for (n, wanted) in wanted.into_iter().enumerate() {
            let found = dmin[[t, n]];
            assert!(found.is_nan() || !frames[t].is_removed(n));
            let is_same = (found - wanted).abs() <= 1e-9 * wanted + 1e-24 * radius * radius;
            assert!(
                is_same || (found.is_nan() && wanted.is_nan()),
                "{t} {n}: {found:e} {wanted:e}"
            );
        }
    }
}

/// The same grains leave in the same steps on any ranks and threads, whatever is written, and
/// across a stop; and in a replay.
#[test]
fn removal_keeps_the_contracts() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let scene = write_leak(folder.path());
    let run = |name: &str, ranks: usize, arguments: &[&str]| {
        let of = [scene.clone()].into_iter();
        let all: Vec<String> = of
            .chain(arguments.iter().map(ToString::to_string))
            .collect();
        gshear_mpi(ranks, &at(name), &all)
    };
    let whole = run("whole", 1, &[]);
    let digest = whole.digest();
    let left = RunFile::open(&at("whole")).expect("a run");
    let last = left
        .records(left.frames() - 1..left.frames())
        .expect("frames");
    let grains = 0..left.grains().count();
    let removed = grains.filter(|n| last[0].is_removed(*n)).count();
    println!("{removed} removed of {}", left.grains().count());
    assert!(removed > 2, "{removed}");
    assert!(whole.text.contains("; removed"), "{}", whole.text);
    for (name, ranks, arguments) in [
        ("two", 2, &[][..]),
        ("three", 3, &["--set=bookkeeping.rebuild_every=7"]),
        ("threads", 1, &["--threads=2"]),
        ("portable", 1, &["--set=bookkeeping.simd=portable"]),
    ] {
        assert_eq!(run(name, ranks, arguments).digest(), digest, "{name}");
        same_run(&at("whole"), &at(name));
        assert_eq!(
            beyond_the_digest(&at("whole")),
            beyond_the_digest(&at(name))
        );
    }
    let output = [
        "--set=output.frame_strain=0",
        "--set=output.series_strain=0.004",
    ];
    assert_eq!(run("output", 1, &output).digest(), digest);
    removed_grains_have_no_dmin(&at("whole"));

    // In a step in which grains may leave, and beside it.
    let total = left.frame_steps()[left.frames() - 1];
    for stop in [total / 200 * 100, total / 200 * 100 + 37] {
        let stopped = run("stopped", 2, &[&format!("--stop-at={stop}")]);
        assert_eq!(stopped.code, 75, "{}", stopped.text);
        let from = format!("--resume={}", at("stopped").display());
        let resumed = gshear_mpi(1, &at("stopped"), &[from]);
        assert_eq!(resumed.digest(), digest, "{stop}");
        same_run(&at("whole"), &at("stopped"));
        std::fs::remove_dir_all(at("stopped")).expect("removed");
    }

    let mut replay = reducer();
    replay.arg("replay").arg(at("whole"));
    let said = succeed(
        replay
            .args(["--strain=1.2..1.4", "--out"])
            .arg(at("window")),
    );
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    assert!(said.contains("to the last bit"), "{said}");
    let window = RunFile::open(&at("window")).expect("a run");
    let frames = window.records(0..window.frames()).expect("frames");
    assert!(
        frames
            .iter()
            .any(|frame| frame.grains.iter().any(|g| g.removed != 0))
    );
}

/// A top wall that no grain holds any more ends the run.
#[test]
fn a_wall_that_comes_down_ends_the_run() {
    let folder = tempfile::tempdir().expect("a folder");
    write_packing(&folder.path().join("disks.data"), true);
    // Of the free grains only that above the hole, and a top of one row.
    let text = std::fs::read_to_string(folder.path().join("disks.data")).expect("the packing");
    let lines = text.lines().filter(|line| !line.starts_with("10 1 "));
    let lines = lines.map(|line| match line {
        "10 atoms" => "19 atoms".into(),
        "2 atom types" => "3 atom types".into(),
        line => line.to_string(),
    });
    let top = (0..10).map(|k| {
        let x = RADIUS * f64::from(2 * k + 1);
        format!("{} 3 0.002 2500 {x:?} 0.018 0.0", 10 + k)
    });
    let data: Vec<String> = lines.chain(top).collect();
    std::fs::write(folder.path().join("top.data"), data.join("\n")).expect("written");
    let scene = "
        material.density = 2500
        contact = { law = 'hooke', normal_stiffness = 1e6, damping_ratio = 0.3, friction = 0 }
        sample = { packing = 'top.data', outside = 'remove' }
        load = { pressure = 100, gravity = 9.81 }
        time.step = 4e-6
        shear = { velocity = 1e-3, strain = 1 }
        output.frame_strain = 0
    ";
    std::fs::write(folder.path().join("top.toml"), scene).expect("a scene");
    let arguments = [folder.path().join("top.toml").display().to_string()];
    let ended = gshear_mpi(1, &folder.path().join("top"), &arguments);
    assert_eq!(ended.code, 3, "{}", ended.text);
    let said = "the top wall has come down to the bottom wall";
    assert!(ended.text.contains(said), "{}", ended.text);
}
