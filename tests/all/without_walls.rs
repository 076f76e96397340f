//! Shear without walls, through the real program: load and volume, the energy budget, displacements
//! over the edges of the cell, and packings of boxes.

use crate::common::{gshear_mpi, reducer, run_scene, succeed};
use gshear_store::run_reader::RunFile;

/// Disks of friction 0.4 at I = 0.02.
const FLOW: &str = "
    material.density = 2500
    contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.4, restitution = 0.3 }
    sample = { grains = 150, radius_min = 0.4e-3, radius_max = 0.6e-3, length = 11e-3, boundary = 'periodic' }
    load.pressure = 1e3
    pack.tolerance = 1e-4
    shear = { inertial_number = 0.02, strain = 1.0 }
    output = { series_strain = 1e-3, frame_strain = 0.05 }
";

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Row and frame of step 0 are the packed sample, whose grains and images are at rest; those after
/// it move at the velocity of the drive, which they get at once.
#[test]
fn the_first_row_is_the_packed_sample() {
    let folder = tempfile::tempdir().expect("a folder");
    let set = ["shear.strain=0.01", "output.frame_strain=0.005"];
    let flow = run_scene(folder.path(), "flow", FLOW, &set);
    let series = flow.series();
    let (slip_rate, drive) = (series.column("slip_rate"), series.column("drive_velocity"));
    assert_eq!(slip_rate[0], 0.0);
    assert!(
        slip_rate[1..]
            .iter()
            .zip(drive)
            .all(|(v, drive)| v == drive)
    );
    let greatest = |frame: usize| {
        let grains = flow.frame(frame).expect("a frame").grains;
        grains
            .iter()
            .flat_map(|grain| grain.velocity)
            .fold(0.0_f64, |most: f64, v: f64| most.max(v.abs()))
    };
    assert!(greatest(0) < 1e-2 * drive[0]);
    assert!(greatest(1) > 0.5 * drive[0]);
}

/// The mass of the height is pressed by N and does not leave: so the mean of the stress is N. Its
/// columns are the stress tensor's.
#[test]
fn the_stress_is_that_of_the_load() {
    let folder = tempfile::tempdir().expect("a folder");
    let flow = run_scene(folder.path(), "flow", FLOW, &[]);
    let series = flow.series();
    let latter = |name: &str| &series.column(name)[series.rows() / 2..];
    let load = 1e3 * 11e-3;
    let found = mean(latter("normal_force")) / load;
    assert!((found - 1.0).abs() < 0.01, "{found}");
    // N has the velocities that were predicted for the step, the columns those after it.
    for (force, stress) in latter("normal_force").iter().zip(latter("stress_yy")) {
        assert!(
            (stress * 11e-3 / force - 1.0).abs() < 1e-4,
            "{stress} {force}"
        );
    }
    assert!(
        latter("kinetic_pressure")
            .iter()
            .all(|p| *p > 0.0 && *p < 100.0)
    );
    assert!(latter("stress_zz").iter().all(|p| p.is_nan()));
    assert!(!flow.boundary().has_walls() && flow.grains().body.iter().all(|body| *body == 0));
}

#[test]
fn the_volume_is_constant() {
    let folder = tempfile::tempdir().expect("a folder");
    let set = ["load.control=volume", "shear.strain=0.2"];
    let flow = run_scene(folder.path(), "volume", FLOW, &set);
    let heights = flow.series().column("wall_height");
    assert!(heights.iter().all(|height| *height == heights[0]));
    let edges = (0..flow.frames()).map(|t| flow.box_edges(t)[1][1]);
    assert!(edges.into_iter().all(|height| height == heights[0]));
    assert!(
        flow.series()
            .column("work_load")
            .iter()
            .all(|work| *work == 0.0)
    );
}

/// Stretched before the shear to a solid fraction at which only contacts along x are left, and no
/// further than the sample allows.
#[test]
fn the_solid_fraction_is_that_of_the_scene() {
    let folder = tempfile::tempdir().expect("a folder");
    let set = [
        "load.control=volume",
        "shear.strain=0.1",
        "load.solid_fraction=0.7",
    ];
    let flow = run_scene(folder.path(), "loose", FLOW, &set);
    let series = flow.series();
    let fractions = series.column("solid_fraction");
    assert!(
        fractions.iter().all(|phi| (phi - 0.7).abs() < 1e-12),
        "{fractions:?}"
    );
    // Of four in the packing.
    assert!(series.column("coordination")[0] < 0.5);
    assert!(series.column("work_drive").last() > Some(&0.0));

    let file = folder.path().join("loose.toml");
    let set = ["--set=load.control=volume", "--set=load.solid_fraction=0.9"];
    let mut arguments = vec![file.display().to_string()];
    arguments.extend(set.map(String::from));
    let outcome = gshear_mpi(1, &folder.path().join("dense"), &arguments);
    assert_eq!(outcome.code, 3, "{}", outcome.text);
    let said = "less than load.solid_fraction = 0.9";
    assert!(outcome.text.contains(said), "{}", outcome.text);
}

/// The residual falls by more than Δt: contacts that open within a step leave a part of first
/// order.
#[test]
fn the_energy_budget_closes() {
    let folder = tempfile::tempdir().expect("a folder");
    for control in ["mass", "volume"] {
        let residual = |step: &str| {
            let set = [
                &format!("load.control={control}")[..],
                "shear.strain=0.03",
                &format!("time.step={step}"),
            ];
            let flow = run_scene(folder.path(), &format!("{control}-{step}"), FLOW, &set);
            let series = flow.series();
            let latter = &series.column("energy_residual")[series.rows() / 2..];
            latter.iter().fold(0.0_f64, |most, x| most.max(x.abs()))
        };
        let [coarse, fine] = ["1.6e-6", "4e-7"].map(residual);
        println!("{control}: {coarse:e} {fine:e}");
        assert!(
            fine < 5e-4 && coarse > 4.0 * fine,
            "{control}: {coarse} {fine}"
        );
    }
}

/// Between two frames each grain moves with the stream, but for some diameters: whatever edges it
/// crosses, and however often the offset returns.
#[test]
fn displacements_follow_images_and_offset() {
    let folder = tempfile::tempdir().expect("a folder");
    let set = ["shear.strain=2.5", "output.frame_strain=0.1"];
    let flow = run_scene(folder.path(), "far", FLOW, &set);
    let records = flow.records(0..flow.frames()).expect("frames");
    let (length, height) = (11e-3, flow.height());
    let strains = flow.frame_strains().expect("strains");
    let mut farthest = 0.0_f64;
    for (from, to) in [(0, 1), (3, 5), (8, 11), (20, 21), (12, 16)] {
        let interval = flow.interval([from, to], [&records[from], &records[to]]);
        let shear = (strains[to] - strains[from]) * height;
        for (n, grain) in records[from].grains.iter().enumerate() {
            let moved = interval.displacement(n);
            let expected = shear * grain.position[1] / height;
            farthest = farthest.max((moved[0] - expected).abs());
        }
        assert!(shear > 0.09 * height);
    }
    assert!(strains.last() > Some(&2.4) && 2.4 * height > 2.0 * length);
    assert!(farthest < 0.5 * length, "{farthest}");
}

/// A packing that a box has strained has the same stress when a shear begins with it.
#[test]
fn a_jammed_packing_of_a_box_is_sheared() {
    let boxed = "
        material.density = 1
        contact = { law = 'hooke', normal_stiffness = 1, friction = 0, damping_ratio = 0.1 }
        sample = { grains = 80, sizes = 'binary', radius_min = 0.5, radius_max = 0.7, large_fraction = 0.5, boundary = 'periodic', solid_fraction = 0.86 }
        relax = { tolerance = 1e-12, drag = 0.05 }
        aqs = { strain_step = 1e-3, steps = 3, frame_every = 1 }
    ";
    let sheared = "
        material.density = 1
        contact = { law = 'hooke', normal_stiffness = 1, friction = 0, damping_ratio = 0.1 }
        sample = { packing = 'boxed/run.h5', boundary = 'periodic' }
        load = { pressure = 1e-3, control = 'volume' }
        shear = { velocity = 1e-3, strain = 1e-3 }
        output = { series_strain = 1e-4, frame_strain = 1e-3 }
    ";
    let folder = tempfile::tempdir().expect("a folder");
    let strained = run_scene(folder.path(), "boxed", boxed, &[]);
    let flow = run_scene(folder.path(), "flow", sheared, &[]);
    for name in ["stress_xx", "stress_yy", "solid_fraction", "coordination"] {
        let before = *strained.series().column(name).last().expect("a row");
        let after = flow.series().column(name)[0];
        assert!(
            (after / before - 1.0).abs() < 1e-9,
            "{name}: {before} {after}"
        );
    }
    let offset = |run: &RunFile, t: usize| run.box_edges(t)[1][0];
    assert_eq!(offset(&flow, 0), offset(&strained, strained.frames() - 1));
}

/// A flow goes on from its checkpoint or its last frame, also in copies above each other: the
/// energy of its fluctuations is that of before (the checkpoint is some steps after the last row),
/// and nothing jumps. Of a file of another program the stream is that of its velocities.
#[test]
fn a_flow_goes_on_as_a_packing() {
    let folder = tempfile::tempdir().expect("a folder");
    let shear = [
        "shear.inertial_number=none",
        "shear.velocity=0.5",
        "output.energy=false",
    ];
    let whole = [&shear[..], &["shear.strain=0.3"]].concat();
    let first = run_scene(folder.path(), "first", FLOW, &whole);
    let energy = |run: &RunFile, row: usize| run.series().column("kinetic_energy")[row];
    let last = energy(&first, first.series().rows() - 1);
    let mut export = reducer();
    export.args(["export", "--format=lammps-dump", "--frame=last"]);
    let dump = folder.path().join("last.dump");
    succeed(
        export
            .arg(folder.path().join("first"))
            .arg("--out")
            .arg(&dump),
    );
    let at = |name: &str| folder.path().join(name).display().to_string();
    let text = std::fs::read_to_string(&dump).expect("a dump");
    let centred = text.lines().map(|line| {
        let mut words: Vec<String> = line.split(' ').map(str::to_string).collect();
        if words.len() > 13 && words[0] != "ITEM:" {
            words[5] = format!("{:?}", words[5].parse::<f64>().expect("v_x") - 0.25);
        }
        words.join(" ")
    });
    let centred: Vec<String> = centred.collect();
    std::fs::write(at("centred.dump"), centred.join("\n")).expect("written");
    let frame = format!("{}@{}", at("first/run.h5"), first.frames() - 1);
    let again = |name: &str, packing: &str, copies: [u32; 2]| {
        let packing = format!("sample.packing={packing}");
        let copied = format!("sample.replicate={copies:?}");
        let mut set = [&shear[..], &[&packing, &copied, "shear.strain=0.01"]].concat();
        let keys = [
            "sample.grains",
            "sample.radius_min",
            "sample.radius_max",
            "sample.length",
        ];
        let none = keys.map(|key| format!("{key}=none"));
        set.extend(none.iter().map(String::as_str));
        set.extend([
            "pack.tolerance=none",
            "output.frame_strain=0",
            "output.series_strain=1e-9",
        ]);
        // Images of a higher cell are as much faster.
        let velocity = format!("shear.velocity={}", 0.5 * f64::from(copies[1]));
        set.push(&velocity);
        run_scene(folder.path(), name, FLOW, &set)
    };
    // The grains of the first frame are at rest; the first step makes them stream.
    let start = again("start", &format!("{}@0", at("first/run.h5")), [1, 1]);
    assert!(energy(&start, 1) < 1e-3 * last, "{:e}", energy(&start, 1));

    let mut found = Vec::new();
    for (name, packing, copies, within) in [
        ("checkpoint", &at("first/checkpoint.h5"), [1, 1], 0.01),
        ("frame", &frame, [1, 1], 1e-9),
        ("copies", &at("first/checkpoint.h5"), [2, 3], 0.01),
        // A line through 150 velocities is off by a tenth; streams counted twice give 19 times as
        // much.
        ("dump", &at("last.dump"), [1, 1], 0.3),
        // The same from -V/2 to V/2.
        ("centred", &at("centred.dump"), [1, 1], 0.3),
    ] {
        let run = again(name, packing, copies);
        let count = f64::from(copies[0] * copies[1]);
        let [before, after] = [0, 1].map(|row| energy(&run, row) / count);
        println!("{name}: {last:e} {before:e} {after:e}");
        assert!(
            (before / last - 1.0).abs() < within,
            "{name}: {before:e} {last:e}"
        );
        assert!(
            (after / before - 1.0).abs() < 0.01,
            "{name}: {after:e} {before:e}"
        );
        found.push(before);
    }
    assert!((found[2] / found[0] - 1.0).abs() < 1e-9, "{found:?}");
    assert!((found[4] / found[3] - 1.0).abs() < 1e-9, "{found:?}");
}

/// The profile of the solid fraction is that of the height that each frame has.
#[test]
fn the_profile_of_a_report_is_of_each_frames_height() {
    let folder = tempfile::tempdir().expect("a folder");
    let set = [
        "shear.inertial_number=0.2",
        "output.frame_strain=0.1",
        "output.energy=false",
    ];
    let flow = run_scene(folder.path(), "flow", FLOW, &set);
    let out = folder.path().join("flow");
    succeed(reducer().arg("report").arg(&out));
    let page = std::fs::read_to_string(out.join("report/index.html")).expect("a page");
    let figures = page.split("<h2>Parameters</h2>").next().expect("figures");
    assert!(!figures.contains("top wall"), "there is none");
    let table = std::fs::read_to_string(out.join("report/fraction-profile.csv"));
    let table = table.expect("a profile");
    let column = |line: &str| line.split(',').nth(1).and_then(|x| x.parse().ok());
    let fractions: Vec<f64> = table.lines().skip(1).filter_map(column).collect();
    assert!(fractions.len() > 10, "{table}");
    // The area of every disk within the cell.
    let inside = |t: usize| {
        let frame = flow.records(t..t + 1).expect("a frame").swap_remove(0);
        let height = flow.box_edges(t)[1][1];
        let below = |at: f64, y: f64, r: f64| {
            let u = ((at - y) / r).clamp(-1.0, 1.0);
            r * r * ((-u).acos() + u * (1.0 - u * u).sqrt())
        };
        let grains = frame.grains.iter().zip(&flow.grains().radius);
        let area = grains.map(|(grain, &r)| {
            below(height, grain.position[1], r) - below(0.0, grain.position[1], r)
        });
        (area.sum::<f64>() / (11e-3 * height), height)
    };
    let latter: Vec<(f64, f64)> = (flow.frames() / 2..flow.frames()).map(inside).collect();
    let mean_of =
        |of: fn(&(f64, f64)) -> f64| latter.iter().map(of).sum::<f64>() / latter.len() as f64;
    let (expected, height) = (mean_of(|of| of.0), mean_of(|of| of.1));
    assert!(
        height > 1.03 * flow.box_edges(0)[1][1],
        "it dilates: {height}"
    );
    let found = mean(&fractions);
    assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
}

/// The radii of a run are exactly those that the scene gives, on one rank and on two, in a cell
/// that is packed and in one of a solid fraction; the order is not that of the list.
#[test]
fn given_radii_are_those_of_the_grains() {
    let folder = tempfile::tempdir().expect("a folder");
    // Ascending and uneven, two of them equal.
    let mut given: Vec<f64> = (0..120u32)
        .map(|k| 0.4e-3 + 0.2e-3 * (f64::from(k) / 119.0).powi(2))
        .collect();
    given[1] = given[0];
    let sample = format!("sizes = 'given', radii = {given:?}, boundary = 'periodic'");
    let packed = format!(
        "{}
        sample = {{ {sample}, length = 11e-3 }}",
        FLOW.lines()
            .filter(|line| !line.contains("sample ="))
            .collect::<Vec<_>>()
            .join("\n")
    );
    let strained = format!(
        "
        material.density = 2500
        contact = {{ law = 'hooke', normal_stiffness = 1e6, friction = 0.0, restitution = 0.3 }}
        sample = {{ {sample}, solid_fraction = 0.86 }}
        relax = {{ tolerance = 1e-6, drag = 1e3 }}"
    );
    for (name, text, set) in [
        ("packed", packed, "--set=shear.strain=0.001"),
        ("strained", strained, "--set=seed=1"),
    ] {
        let file = folder.path().join(format!("{name}.toml"));
        std::fs::write(&file, text).expect("written");
        let arguments = [file.display().to_string(), set.into()];
        let [one, two] = [1, 2].map(|ranks| {
            let out = folder.path().join(format!("{name}-{ranks}"));
            let digest = gshear_mpi(ranks, &out, &arguments).digest();
            (digest, RunFile::open_any(&out).expect("a run"))
        });
        assert_eq!(one.0, two.0, "{name}");
        for run in [&one.1, &two.1] {
            let mut radii = run.grains().radius.clone();
            assert_ne!(radii, given, "{name}");
            radii.sort_by(f64::total_cmp);
            assert_eq!(radii, given, "{name}");
        }
    }
}
