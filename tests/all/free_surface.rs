//! Flow below a free surface, through the real program: balances of momentum and of energy, arrest,
//! branches, packings with a bottom, and what such runs refuse.

use crate::common::{gshear_mpi, program, reducer, run_scene, succeed};
use gshear_store::run_reader::RunFile;

/// Disks of friction 0.5 on a slope on which they flow.
const SLOPE: &str = "
    material.density = 2500
    contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.5, damping_ratio = 0.1 }
    sample = { grains = 200, radius_min = 0.8e-3, radius_max = 1.2e-3, length = 20e-3, boundary = 'free' }
    load = { gravity = 9.81, incline = 26 }
    pack.tolerance = 1e-4
    shear.protocol = [{ time = 0.05 }]
    output.series_rows = 1000000
";

/// Spheres on one.
const SLOPE_OF_SPHERES: &str = "
    dimension = 3
    material = { young_modulus = 5e6, poisson_ratio = 0.3, density = 2500 }
    contact = { law = 'hertz', friction = 0.5, restitution = 0.5, impact_speed = 1.0, impact_diameter = 2e-3 }
    sample = { grains = 400, radius_min = 0.8e-3, radius_max = 1.2e-3, length = 12e-3, width = 10e-3, boundary = 'free' }
    load = { gravity = 9.81, incline = 30 }
    pack.tolerance = 1e-4
    shear.protocol = [{ time = 0.03 }]
    output.series_rows = 1000000
";

/// The mass of the free grains (kg; kg/m in 2D).
fn free_mass(run: &RunFile) -> f64 {
    let grains = run.grains();
    let free = grains.body.iter().zip(&grains.mass);
    free.filter(|(body, _)| **body == 0).map(|(_, m)| m).sum()
}

/// In every step, as velocity Verlet has it: M Δu = Δt (M g sin θ - S) with the mean of S at both
/// ends, and the same with N along the height.
#[test]
fn momentum_is_balanced_step_by_step() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, scene, angle) in [("2d", SLOPE, 26.0_f64), ("3d", SLOPE_OF_SPHERES, 30.0)] {
        let run = run_scene(folder.path(), name, scene, &[]);
        let series = run.series();
        let [time, shear, normal] = [
            &series.time[..],
            series.column("shear_force"),
            series.column("normal_force"),
        ];
        let [along, up] = ["mean_velocity", "wall_velocity"].map(|name| series.column(name));
        let (mass, angle) = (free_mass(&run), angle.to_radians());
        let weight = mass * 9.81;
        let most = along.iter().fold(0.0_f64, |a, u| a.max(u.abs()));
        assert!(most > 0.01, "{name}: it flows: {most}");
        let mut worst = 0.0_f64;
        for row in 1..series.rows() {
            let step = time[row] - time[row - 1];
            let mean = |of: &[f64]| 0.5 * (of[row] + of[row - 1]);
            let pulled = step * (weight * angle.sin() - mean(shear)) / mass;
            let lifted = step * (mean(normal) - weight * angle.cos()) / mass;
            let off_along = along[row] - along[row - 1] - pulled;
            // The height of the layer is twice that of its centre.
            let off_up = 0.5 * (up[row] - up[row - 1]) - lifted;
            worst = worst.max(off_along.abs()).max(off_up.abs());
        }
        // Steps of time are known to the rounding of the time.
        assert!(worst < 1e-9 * most, "{name}: {worst:e} of {most:e}");
    }
}

/// Gravity does the work, whatever the seam that grains cross. The residual falls at least with Δt:
/// contacts that open within a step leave a part of first order.
#[test]
fn the_energy_budget_closes() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, scene, steps) in [
        ("2d", SLOPE, ["8e-6", "2e-6"]),
        ("3d", SLOPE_OF_SPHERES, ["2.8e-6", "7e-7"]),
    ] {
        let residual = |step: &str| {
            let set = [&format!("time.step={step}")[..], "output.series_rows=100"];
            let run = run_scene(folder.path(), &format!("{name}-{step}"), scene, &set);
            let series = run.series();
            let work = series.column("work_load").last().copied().unwrap_or(0.0);
            assert!(work > 0.0, "{name}: {work}");
            let latter = &series.column("energy_residual")[series.rows() / 2..];
            latter.iter().fold(0.0_f64, |most, x| most.max(x.abs()))
        };
        let [coarse, fine] = steps.map(residual);
        println!("{name}: {coarse:e} {fine:e}");
        assert!(
            fine < 1e-4 && coarse > 3.0 * fine,
            "{name}: {coarse} {fine}"
        );
    }
}

/// The work of gravity is what the centre of mass falls, along the slope and against it.
#[test]
fn the_work_is_that_of_the_centre_of_mass() {
    let folder = tempfile::tempdir().expect("a folder");
    let set = ["shear.protocol=[{ time = 0.3 }]", "output.frame_rows=4"];
    let run = run_scene(folder.path(), "work", SLOPE, &set);
    let records = run.records(0..run.frames()).expect("frames");
    let (grains, length) = (run.grains(), run.periods()[0]);
    let place = |t: usize, axis: usize| {
        let free = (0..grains.count()).filter(|g| grains.body[*g] == 0);
        let of = |g: usize| {
            let grain = &records[t].grains[g];
            let image = if axis == 0 {
                grain.image[0] as f64 * length
            } else {
                0.0
            };
            grains.mass[g] * (grain.position[axis] + image)
        };
        free.map(of).sum::<f64>()
    };
    let last = run.frames() - 1;
    let [along, up] = [0, 1].map(|axis| place(last, axis) - place(0, axis));
    let angle = 26f64.to_radians();
    let expected = 9.81 * (along * angle.sin() - up * angle.cos());
    let series = run.series();
    let row = series
        .step
        .iter()
        .position(|step| *step == records[last].step);
    let work = series.column("work_load")[row.expect("a row with the frame")];
    assert!(along / free_mass(&run) > length, "over the seam: {along}");
    assert!((work / expected - 1.0).abs() < 1e-9, "{work} {expected}");
}

/// On a gentle slope the grains come to rest: the bottom bears the weight, and friction the pull.
/// A branch on a steep one flows from there, and its budget begins again.
#[test]
fn grains_rest_on_a_gentle_slope_and_flow_on_a_steep_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let set = [
        "load.incline=8",
        "contact.damping_ratio=0.3",
        "shear.protocol=[{ time = 0.4 }]",
        "output.series_rows=200",
    ];
    let gentle = run_scene(folder.path(), "gentle", SLOPE, &set);
    let series = gentle.series();
    let last = |name: &str| {
        let rows = &series.column(name)[3 * series.rows() / 4..];
        rows.iter().sum::<f64>() / rows.len() as f64
    };
    let angle = 8f64.to_radians();
    let weight = free_mass(&gentle) * 9.81;
    // It still oscillates a little; falling along the slope it would have 0.5 m/s.
    assert!(last("mean_velocity").abs() < 1e-4);
    assert!((last("stress_ratio") / angle.tan() - 1.0).abs() < 0.01);
    assert!((last("normal_force") / (weight * angle.cos()) - 1.0).abs() < 0.01);
    assert!(series.column("strain").iter().all(|strain| *strain == 0.0));

    let out = folder.path().join("steep");
    let checkpoint = folder.path().join("gentle/checkpoint.h5");
    let mut command = program(1);
    command
        .arg(format!("--resume={}", checkpoint.display()))
        .arg(format!("--branch={}", out.display()))
        .arg("--set=load.incline=30")
        .arg("--set=shear.protocol=[{ time = 0.6 }]");
    succeed(&mut command);
    let steep = RunFile::open(&out).expect("a run");
    let series = steep.series();
    assert!(*series.column("mean_velocity").last().expect("rows") > 0.1);
    let residual = series.column("energy_residual").last().expect("rows");
    assert!(residual.abs() < 0.01, "{residual}");
}

/// A window is computed again with the same bits.
#[test]
fn a_window_is_replayed() {
    let folder = tempfile::tempdir().expect("a folder");
    let set = ["output.keep_checkpoints=true", "output.frame_rows=10"];
    let run = run_scene(folder.path(), "kept", SLOPE, &set);
    let frames = run.records(0..run.frames()).expect("frames");
    let out = folder.path().join("again");
    let mut command = reducer();
    command
        .arg("replay")
        .arg(folder.path().join("kept"))
        .arg(format!("--time={}..{}", frames[3].time, frames[6].time))
        .arg("--out")
        .arg(&out);
    let words = succeed(&mut command).stdout;
    let words = String::from_utf8(words).expect("text");
    assert!(words.contains("to the last bit"), "{words}");
    let again = RunFile::open(&out).expect("the replay");
    let again = again.records(0..again.frames()).expect("frames");
    let end = again.last().expect("a frame");
    assert_eq!(end.step, frames[6].step);
    assert_eq!(end.grains, frames[6].grains);
}

/// Types 1 and 2 of a packing are grains and bottom, as those of LAMMPS' chute.
#[test]
fn a_packing_brings_its_bottom() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut text = String::from("LAMMPS data file\n\n");
    // A bottom of touching disks, and a square block on it at rest.
    let (columns, rows, diameter) = (10, 8, 1e-3);
    let atoms = columns * rows;
    text += &format!(
        "{atoms} atoms\n2 atom types\n0 0.01 xlo xhi\n0 0.0081 ylo yhi\n-0.0005 0.0005 zlo zhi\n\nAtoms # sphere\n\n"
    );
    for n in 0..atoms {
        let (column, row) = (n % columns, n / columns);
        let kind = if row == 0 { 2 } else { 1 };
        let x = (f64::from(column) + 0.5) * diameter;
        let y = (f64::from(row) + 0.5) * diameter * 0.9999;
        text += &format!("{} {kind} {diameter} 2500 {x} {y} 0\n", n + 1);
    }
    std::fs::write(folder.path().join("block.data"), text).expect("a packing");
    let scene = "
        material.density = 2500
        contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.5, damping_ratio = 0.1 }
        sample = { packing = 'block.data', boundary = 'free' }
        load.gravity = 9.81
        shear.protocol = [{ time = 0.02 }]
    ";
    let run = run_scene(folder.path(), "block", scene, &["output.frame_rows=1"]);
    let bottom: Vec<u8> = run.grains().body.clone();
    let expected: Vec<u8> = (0..80).map(|n| u8::from(n < 10)).collect();
    assert_eq!(bottom, expected);
    let weight = free_mass(&run) * 9.81;
    let borne = *run.series().column("normal_force").last().expect("rows");
    assert!((borne / weight - 1.0).abs() < 0.05, "{borne} {weight}");
}

/// Commands that need a shear say so, the others work.
#[test]
fn commands_know_a_free_surface() {
    let folder = tempfile::tempdir().expect("a folder");
    let set = ["output.frame_rows=4", "output.series_rows=20"];
    run_scene(folder.path(), "flow", SLOPE, &set);
    let out = folder.path().join("flow");
    for name in ["phases", "regions", "stages", "correlate"] {
        let output = reducer().arg(name).arg(&out).output().expect("a reducer");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{name}: {said}");
        assert!(said.contains("has a free surface"), "{said}");
    }
    for name in ["report", "info", "dmin", "spectrum", "movie"] {
        succeed(reducer().arg(name).arg(&out));
    }
    let page = folder.path().join("flow/report/index.html");
    let page = std::fs::read_to_string(page).expect("a report");
    assert!(page.contains("Flow below a free surface") && page.contains("mean-velocity.svg"));
    assert!(!page.contains("Stick phases"));
    // Beside others, too, it has no phases.
    let compared = folder.path().join("compared");
    let mut report = reducer();
    report
        .arg("report")
        .arg(folder.path())
        .arg("--out")
        .arg(&compared);
    succeed(&mut report);
    let means = std::fs::read_to_string(compared.join("means.csv")).expect("means");
    assert!(
        means.contains("velocity") && !means.contains("slip_phases"),
        "{means}"
    );
}

/// Grains that fall fast are resumed and replayed as they fell, and begun from a file: the first
/// list lasts for their speed, not only for that of walls.
#[test]
fn fast_grains_go_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    for (name, law, dimension, row) in [
        (
            "2",
            "normal_stiffness = 2e4",
            2,
            "0 0.01 ylo yhi\n-0.001 0.001 zlo zhi",
        ),
        (
            "3",
            "normal_stiffness = 20",
            3,
            "0 0.01 ylo yhi\n0 0.01 zlo zhi",
        ),
    ] {
        // A row of grains that fall onto a plane at 0.2 m/s.
        let of_row = |k: u32| {
            let x = 1e-3 * f64::from(k) + 5e-4;
            if dimension == 2 {
                format!("{} 1 0.0006 2500 {x:?} 0.008 0\n", k + 1)
            } else {
                format!("{} 1 0.0006 2500 {x:?} 0.005 0.008\n", k + 1)
            }
        };
        let fall = |k: u32| match dimension {
            2 => format!("{} 0.1 -0.2 0 0 0 0\n", k + 1),
            _ => format!("{} 0.1 0 -0.2 0 0 0\n", k + 1),
        };
        let atoms: String = (0..10).map(of_row).collect();
        let velocities: String = (0..10).map(fall).collect();
        let data = format!(
            "x\n\n10 atoms\n1 atom types\n0 0.01 xlo xhi\n{row}\n\nAtoms # sphere\n\n{atoms}\nVelocities\n\n{velocities}"
        );
        std::fs::write(at("fall.data"), data).expect("written");
        let scene = format!(
            "
            dimension = {dimension}
            material.density = 2500
            contact = {{ law = 'hooke', {law}, friction = 0.3, damping_ratio = 0.1 }}
            sample = {{ packing = 'fall.data', boundary = 'free', walls = 'flat' }}
            load.gravity = 0.1
            shear.protocol = [{{ time = 0.03 }}, {{ time = 0.03 }}]
            output = {{ keep_checkpoints = true, series_rows = 20 }}
            "
        );
        let whole = run_scene(folder.path(), &format!("whole-{name}"), &scene, &[]);
        let digest = whole.text("digest").expect("a digest").to_string();
        let last = whole.series().step[whole.series().rows() - 1];
        let scene = at(&format!("whole-{name}.toml"));
        let out = folder.path().join(format!("stopped-{name}"));
        let stop = format!("--stop-at={}", last / 3);
        assert_eq!(gshear_mpi(1, &out, &[scene, stop]).code, 75);
        let resume = format!("--resume={}", out.display());
        assert_eq!(gshear_mpi(1, &out, &[resume]).digest(), digest);
        let mut replay = reducer();
        replay.arg("replay").arg(at(&format!("whole-{name}")));
        replay
            .args(["--time=0.035..0.04", "--out"])
            .arg(at(&format!("again-{name}")));
        succeed(&mut replay);
    }
}

/// The bottom of a run with several materials is one again in a run that begins with it.
#[test]
fn a_bottom_of_several_materials_is_a_packing() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = |sample: &str| {
        format!(
            "
            dimension = 2
            material = [{{ name = 'a', density = 2500.0 }}, {{ name = 'b', density = 5000.0, fraction = 0.4 }}]
            contact = {{ law = 'hooke', normal_stiffness = 1e6, friction = 0.4, restitution = 0.5 }}
            sample = {{ {sample}, boundary = 'free' }}
            load.gravity = 9.81
            shear.protocol = [{{ time = 2e-4 }}]
            output = {{ series_rows = 2, frame_rows = 2 }}
            "
        )
    };
    let drawn = "grains = 200, radius_min = 0.4e-3, radius_max = 0.6e-3, length = 9e-3";
    let first = scene(drawn) + "pack.tolerance = 1e-3";
    let first = run_scene(folder.path(), "first", &first, &[]);
    let packing = folder.path().join("first");
    let again = scene(&format!(
        "packing = '{}', walls = 'types'",
        packing.display()
    ));
    let again = again.replace(", fraction = 0.4", "");
    let again = run_scene(folder.path(), "again", &again, &[]);
    assert_eq!(again.grains().body, first.grains().body);
    // The bottom has the material of walls.
    for n in (0..200).filter(|n| first.grains().body[*n] == 0) {
        assert_eq!(again.material()[n], first.material()[n]);
        assert_eq!(again.grains().mass[n], first.grains().mass[n]);
    }
}
