//! Packings that leave the program and come back, and others' packings, through the real programs.

use std::path::Path;

use crate::common::{gshear_mpi, program, reducer, succeed};
use gshear_dem::dimension::{Three, Two};
use gshear_dem::state::{ContactSample, length};
use gshear_driver::header::Header;
use gshear_scene::lammps_data::{DataFile, parse};
use gshear_store::run_reader::RunFile;

const CROSSING: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing.toml");
const TRIANGULAR: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/triangular.data");
const TRIANGULAR_TEXT: &str = include_str!("../scenes/triangular.data");

/// `gshear-reduce export` of a run or a checkpoint.
fn export(run: &Path, arguments: &[&str], out: &Path) -> DataFile {
    succeed(
        reducer()
            .args(["export", "--format=lammps-data", "--out"])
            .arg(out)
            .args(arguments)
            .arg(run),
    );
    parse("exported", &std::fs::read_to_string(out).expect("a file")).expect("what was written")
}

/// The same sheared grains, to the last bit, in the checkpoint that they are read from and in the
/// first frame after that.
#[test]
fn an_exported_state_comes_back() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let stop = gshear_mpi(1, &at("first"), &[CROSSING.into(), "--stop-at=700".into()]);
    assert_eq!(stop.code, 75, "{}", stop.text);
    let out = export(&at("first/checkpoint.h5"), &[], &at("first.data"));

    // The path is that of the configuration's folder.
    let scene = std::fs::read_to_string(CROSSING).expect("the scene");
    let (head, tail) = scene.split_once("grains = 220").expect("its sample");
    let tail = tail.split_once("length = 21e-6").expect("its length").1;
    let scene = format!("{head}packing = \"first.data\"{tail}").replace("tolerance = 1e-4", "");
    std::fs::write(at("again.toml"), &scene).expect("written");
    let arguments = |more: &[&str]| {
        let mut all = vec![at("again.toml").display().to_string()];
        all.extend(more.iter().map(ToString::to_string));
        all
    };
    let short = "--set=shear.strain=0.2";
    let one = gshear_mpi(1, &at("again"), &arguments(&[short]));
    let expected = one.digest();
    assert!(one.text.contains("types 2 (bottom)"), "{}", one.text);

    let back = export(&at("again"), &["--frame=0"], &at("back.data"));
    assert_eq!(back.bounds[0], out.bounds[0]);
    for (a, b) in out.atoms.iter().zip(back.atoms) {
        assert_eq!((a.id, a.kind, a.diameter), (b.id, b.kind, b.diameter));
        assert_eq!((a.density, a.position), (b.density, b.position));
        if a.kind == 1 {
            assert_eq!(
                (a.velocity, a.angular_velocity),
                (b.velocity, b.angular_velocity)
            );
        }
    }

    // A dump has the same numbers, and so has the run itself.
    let dump = at("again.dump");
    let mut command = reducer();
    let command = command.args(["export", "--frames=0..1", "--format=lammps-dump", "--out"]);
    succeed(command.args([&dump, &at("again")]));
    let from = |packing: String| {
        let set = format!("--set=sample.packing={}", at(&packing).display());
        gshear_mpi(1, &at("from"), &arguments(&[short, &set, "--overwrite"])).digest()
    };
    let digest = from("back.data".into());
    for packing in ["again.dump@0", "again@0", "again/run.h5@0"] {
        assert_eq!(from(packing.into()), digest, "{packing}");
    }

    // The ranks do not matter, nor who reads the scene that was written; and a checkpoint does
    // without the file.
    for ranks in [2, 3] {
        let other = gshear_mpi(ranks, &at("ranks"), &arguments(&[short, "--overwrite"]));
        assert_eq!(other.digest(), expected, "{ranks} ranks");
    }
    let written = at("again/scene.toml").display().to_string();
    assert_eq!(gshear_mpi(1, &at("written"), &[written]).digest(), expected);
    let broken = gshear_mpi(2, &at("broken"), &arguments(&[short, "--stop-at=100"]));
    assert_eq!(broken.code, 75, "{}", broken.text);
    std::fs::rename(at("first.data"), at("away.data")).expect("renamed");
    let resume = format!("--resume={}", at("broken/checkpoint.h5").display());
    assert_eq!(gshear_mpi(1, &at("broken"), &[resume]).digest(), expected);
    export(
        &at("broken/checkpoint.h5"),
        &[],
        &at("without-its-file.data"),
    );
    succeed(reducer().arg("stability").arg(at("broken")));
    // From the beginning it is needed.
    for ranks in [1, 2] {
        let lost = gshear_mpi(ranks, &at("lost"), &arguments(&[]));
        assert_eq!(lost.code, 2);
        let said = format!(
            "error: {}:17: sample.packing: {}: no such file",
            at("again.toml").display(),
            at("first.data").display()
        );
        assert_eq!(lost.text.matches("error: ").count(), 1);
        assert!(lost.text.contains(&said), "{}", lost.text);
        assert!(!at("lost").exists());
    }
}

/// As LAMMPS users have them, from the command line, sheared as it is and packed first.
/// Walls are the grains whose centre is within `sample.wall_thickness` of a plane, and H counts
/// from there.
#[test]
fn walls_are_as_thick_as_asked() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut counts = Vec::new();
    for layers in [1.0, 2.0] {
        let at = folder.path().join(format!("walls-{layers}"));
        let arguments = [
            CROSSING.into(),
            "--set=sample.grains=300".into(),
            "--set=shear.strain=0.02".into(),
            format!("--set=sample.wall_thickness={layers:?}"),
        ];
        gshear_mpi(1, &at, &arguments).digest();
        let run = RunFile::open(&at).expect("a run");
        let thickness = layers * 1.5e-6;
        let top = run.number("height_start").expect("H") + thickness;
        let atoms = export(&at, &["--frame=0"], &at.join("walls.data")).atoms;
        for atom in &atoms {
            let expected = match atom.position[1] {
                y if y < thickness => 2,
                y if y > top => 3,
                _ => 1,
            };
            assert_eq!(atom.kind, expected, "{:?}", atom.position);
        }
        let of_kind = |kind| atoms.iter().filter(|a| a.kind == kind).count();
        counts.push([of_kind(2), of_kind(3)]);
    }
    for wall in [0, 1] {
        assert!(2 * counts[1][wall] > 3 * counts[0][wall], "{counts:?}");
    }
}

/// A scene whose `sample.packing` is to be given, of contacts with k = 1e6 Pa.
const OF_A_FILE: &str = "
    material.density = 2500
    contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.5, damping_ratio = 0.3 }
    load.stiffness_number = 1e3
    pack.tolerance = 1e-4
    shear = { inertial_number = 0.01, strain = 0.02 }
    [sample]
    packing = 'is given below'
    ";

/// A frame of a box without friction, as a file of any kind, is strained on as the run that it is
/// of: its box is tilted. Copies have its stresses.
#[test]
fn a_packing_in_a_box_is_strained() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let scene = |sample: &str, steps: u32| {
        format!(
            "
            seed = 3
            dimension = 3
            material.mass = 1.0
            contact = {{ law = 'mindlin', normal_stiffness = 1.0, friction = 0.0 }}
            relax = {{ tolerance = 1e-12, drag = 0.1 }}
            aqs = {{ strain_step = 2e-3, steps = {steps}, frame_every = 1 }}
            {sample}
            "
        )
    };
    let inserted = "
        sample = { grains = 150, sizes = 'binary', radius_min = 0.5, radius_max = 0.7, large_fraction = 0.5, boundary = 'periodic', solid_fraction = 0.72 }";
    std::fs::write(at("first.toml"), scene(inserted, 4)).expect("written");
    let run = |name: &str, ranks, out: &str, more: &[&str]| {
        let mut arguments = vec![at(name).display().to_string()];
        arguments.extend(more.iter().map(ToString::to_string));
        gshear_mpi(ranks, &at(out), &arguments)
    };
    run("first.toml", 1, "first", &[]).digest();
    let from = |packing: &str, more: &str| {
        let packing = at(packing).display().to_string();
        let sample = format!("sample.packing = {packing:?}\n{more}\nsample.boundary = 'periodic'");
        std::fs::write(at("from.toml"), scene(&sample, 2)).expect("written");
        run("from.toml", 2, "from", &["--overwrite"]).digest()
    };
    let column = |out: &str, name: &str| {
        let run = RunFile::open_any(&at(out)).expect("a run");
        run.series().column(name).to_vec()
    };
    export(&at("first/run.h5"), &["--frame=2"], &at("box.data"));
    let mut command = reducer();
    let command = command.args(["export", "--frames=0..2", "--format=lammps-dump", "--out"]);
    succeed(command.args([at("box.dump"), at("first")]));
    let digest = from("box.data", "");
    for packing in ["box.dump", "first@2", "first/run.h5@2"] {
        assert_eq!(from(packing, ""), digest, "{packing}");
    }
    // Newton's equations begin where the strain steps end.
    let moves = "newtonian = { growth_times = 0.01, rows = 2, frames = 2 }";
    let moving = scene(&format!("{inserted}\n{moves}"), 4);
    std::fs::write(at("moving.toml"), moving).expect("written");
    run("moving.toml", 1, "moving", &[]).digest();
    let last = from("first@4", "");
    assert_eq!(from("moving/run.h5/newtonian@0", ""), last);
    assert_eq!(from("first@2", ""), digest);
    for name in ["shear_stress", "pressure", "solid_fraction"] {
        let (first, from) = (column("first", name), column("from", name));
        assert_eq!((first.len(), from.len()), (5, 3));
        for (a, b) in first[2..].iter().zip(&from) {
            assert!((a / b - 1.0).abs() < 1e-6, "{name}: {first:?} {from:?}");
        }
    }

    let stopped = run("from.toml", 1, "stopped", &["--stop-at=1"]);
    assert_eq!(stopped.code, 75, "{}", stopped.text);
    std::fs::rename(at("first"), at("away")).expect("renamed");
    let resume = format!("--resume={}", at("stopped").display());
    assert_eq!(gshear_mpi(2, &at("stopped"), &[resume]).digest(), digest);
    export(&at("stopped/checkpoint.h5"), &[], &at("end.data"));
    // So do the eigenvalues of frames, of a packing of any kind.
    succeed(reducer().arg("stability").arg(at("stopped")));
    succeed(reducer().arg("stability").arg(at("from")));

    from("box.data", "sample.replicate = [2, 1, 3]");
    let copies = RunFile::open_any(&at("from")).expect("a run");
    assert_eq!(copies.grains().count(), 6 * 150);
    for name in ["shear_stress", "pressure", "solid_fraction"] {
        let [of_copies, once] = ["from", "stopped"].map(|out| column(out, name)[0]);
        assert!(
            (of_copies / once - 1.0).abs() < 1e-9,
            "{name}: {of_copies} {once}"
        );
    }
    from("away/checkpoint.h5", "");
    let [first, end] = ["from", "away"].map(|out| column(out, "pressure"));
    assert!((first[0] / end[4] - 1.0).abs() < 1e-6, "{first:?} {end:?}");
    let missing = run(
        "from.toml",
        1,
        "missing",
        &[&format!("--set=sample.packing={}@7", at("away").display())],
    );
    assert_eq!(missing.code, 2, "{}", missing.text);
    let said = format!(
        "{}: has 5 frames, counted from 0; there is no frame 7",
        at("away").display()
    );
    assert!(missing.text.contains(&said), "{}", missing.text);
}

/// Grains of a file that overlap are moved apart before the first row, by either method.
#[test]
fn a_packing_in_a_box_is_brought_to_rest_first() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    for (name, box_of, z) in [
        ("2", "0 10 ylo yhi\n-0.5 0.5 zlo zhi", 0),
        ("3", "0 10 ylo yhi\n0 10 zlo zhi", 5),
    ] {
        let text = format!(
            "two grains\n\n2 atoms\n1 atom types\n0 10 xlo xhi\n{box_of}\n\nAtoms # sphere\n\n1 1 1 1 3 5 {z}\n2 1 1 1 3.95 5 {z}\n"
        );
        std::fs::write(at("two.data"), text).expect("written");
        for (ranks, method) in [(1, "newton"), (2, "newton"), (1, "overdamped")] {
            let scene = format!(
                "
                dimension = {name}
                material.density = 1.0
                contact = {{ law = 'hooke', normal_stiffness = 1.0, friction = 0.5, damping_ratio = 0.1 }}
                sample.packing = 'two.data'
                sample.boundary = 'periodic'
                relax = {{ tolerance = 1e-9, drag = 0.05, method = '{method}' }}
                aqs = {{ strain_step = 1e-3, steps = 1, frame_every = 1 }}
                "
            );
            std::fs::write(at("two.toml"), scene).expect("written");
            let out = at(&format!("{name}-{ranks}-{method}"));
            gshear_mpi(ranks, &out, &[at("two.toml").display().to_string()]).digest();
            let run = RunFile::open_any(&out).expect("a run");
            let frame = run.records(0..1).expect("a frame").swap_remove(0);
            let apart = frame.grains[1].position[0] - frame.grains[0].position[0];
            assert!(apart > 1.0 - 1e-6, "{name}, {method}: {apart}");
            let first = |name: &str| run.series().column(name)[0];
            assert!(first("pressure").abs() < 1e-8, "{name}, {method}");
            assert!(first("residual") <= 1e-9, "{name}, {method}");
        }
    }
}

/// A line of a data file with another id, if it is of an atom.
fn renumbered(line: &str, of: impl Fn(u64) -> u64) -> String {
    match line.split_once(' ').map(|(id, row)| (id.parse(), row)) {
        Some((Ok(id), row)) if row.split(' ').count() > 5 => format!("{} {row}", of(id)),
        _ => line.into(),
    }
}

/// A grain is followed by the id of its file through all files of a run, also of one that began
/// without the file.
#[test]
fn ids_of_a_file_are_kept() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let of_file = |id: u64| 10 * id + 7 * (id / 50);
    let lines = TRIANGULAR_TEXT.lines();
    let lines: Vec<String> = lines.map(|line| renumbered(line, of_file)).collect();
    std::fs::write(at("gaps.data"), lines.join("\n")).expect("written");
    std::fs::write(
        at("scene.toml"),
        OF_A_FILE.replace("pack.tolerance = 1e-4", ""),
    )
    .expect("written");
    let arguments = [
        at("scene.toml").display().to_string(),
        format!("--set=sample.packing={}", at("gaps.data").display()),
        "--set=output.frame_strain=1e-4".into(),
        "--stop-at=100".into(),
    ];
    let first = gshear_mpi(2, &at("first"), &arguments);
    assert_eq!(first.code, 75, "{}", first.text);
    std::fs::remove_file(at("gaps.data")).expect("removed");
    let mut command = program(1);
    let branch = command
        .arg(format!("--resume={}", at("first").display()))
        .arg(format!("--branch={}", at("branch").display()))
        .args(["--set=contact.friction=0.4", "--stop-at=200"])
        .output()
        .expect("the program starts");
    assert_eq!(branch.status.code(), Some(75), "{branch:?}");

    let expected: Vec<u64> = (1..=120).map(of_file).collect();
    for name in ["first", "branch"] {
        let run = RunFile::open(&at(name)).expect("a run");
        assert!(
            run.ids()
                .iter()
                .map(|id| u64::from(*id) + 1)
                .eq(expected.iter().copied())
        );
        for from in [at(name), at(name).join("checkpoint.h5")] {
            let atoms = export(&from, &[], &at("out.data")).atoms;
            assert!(atoms.iter().map(|a| a.id).eq(expected.iter().copied()));
        }
    }
    let run = RunFile::open(&at("first")).expect("a run");
    let contacts = &run.records(0..1).expect("a frame")[0].contacts;
    let of_contacts: Vec<u64> = contacts.iter().map(|c| expected[c.j as usize]).collect();
    for (format, file, head, separator, column, more) in [
        ("csv", "out.csv", "frame,", ',', 4, 1),
        ("csv", "out-contacts.csv", "frame,", ',', 5, 1),
        ("lammps-dump", "out.dump", "ITEM: ATOMS", ' ', 0, 0),
        (
            "lammps-dump",
            "out-contacts.dump",
            "ITEM: ENTRIES",
            ' ',
            1,
            0,
        ),
        ("xyz", "out.xyz", "Lattice", ' ', 12, 1),
    ] {
        let out = at(&file.replace("-contacts", ""));
        let mut command = reducer();
        let command = command.args(["export", "--frames=0..0", "--format", format, "--out"]);
        succeed(command.args([&out, &at("first")]));
        let text = std::fs::read_to_string(at(file)).expect(file);
        let rows = text.lines().skip_while(|line| !line.starts_with(head));
        let id = |row: &str| row.split(separator).nth(column)?.parse::<u64>().ok();
        let ids = rows.skip(1).map(|row| more + id(row).expect(row));
        let is_of_contacts = file.contains("contacts");
        let of_file = if is_of_contacts {
            &of_contacts
        } else {
            &expected
        };
        assert!(ids.eq(of_file.iter().copied()), "{file}");
    }
}

/// Ten columns press on the top wall by two contacts of 1e-6 m each, at 60 degrees. Under a load
/// far below that the wall flies away; a branch may change the load.
#[test]
fn a_packing_may_not_be_at_its_load() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("scene.toml");
    let at_pressure = OF_A_FILE.replace("stiffness_number = 1e3", "pressure = 1e3");
    let at_pressure = at_pressure.replace("pack.tolerance = 1e-4", "");
    std::fs::write(&path, at_pressure).expect("written");
    let length = 0.00799 - -0.002;
    let own = 20.0 * 60f64.to_radians().sin() / length;
    let run = |name: &str, ranks, pressure: f64, more: &[&str]| {
        let mut arguments = vec![
            path.display().to_string(),
            format!("--set=sample.packing={TRIANGULAR}"),
            format!("--set=load.pressure={pressure:e}"),
        ];
        arguments.extend(more.iter().map(ToString::to_string));
        gshear_mpi(ranks, &folder.path().join(name), &arguments)
    };
    for (over, is_at_load) in [
        (1.0, true),
        (1.0 / 1.9, true),
        (1.0 / 2.1, false),
        (2.1, false),
    ] {
        let said = run("checked", 1, own * over, &["--check"]);
        assert_eq!(said.code, 0, "{}", said.text);
        let wanted = format!(
            "press on the top wall with {own:.3e} Pa, and the load is {:.3e} Pa",
            own * over
        );
        assert_eq!(!said.text.contains(&wanted), is_at_load, "{}", said.text);
    }
    // A loose one.
    let gaps = TRIANGULAR_TEXT.replace(" 0.001 2500 ", " 0.00099 2500 ");
    let loose = folder.path().join("loose.data");
    std::fs::write(&loose, gaps).expect("written");
    let loose = format!("--set=sample.packing={}", loose.display());
    let said = run("loose", 1, own, &[&loose, "--stop-at=10"]);
    assert!(said.text.contains("with 0.000e0 Pa"), "{}", said.text);
    let mut failures = Vec::new();
    for ranks in [1, 2] {
        let flies = run("flies", ranks, 1e-5 * own, &["--overwrite", "--quiet"]);
        assert_eq!(flies.code, 3, "{}", flies.text);
        let warns = flies
            .text
            .contains("warning: sample.packing is not at its load");
        let ends = flies.text.contains("the top wall has left the sample");
        assert!(warns && ends, "{}", flies.text);
        let error = flies.text.lines().find(|line| line.starts_with("error: "));
        failures.push(error.expect("a message").to_string());
    }
    assert_eq!(failures[0], failures[1]);

    let drive = [
        "--set=shear.inertial_number=none",
        "--set=shear.velocity=0.1",
    ];
    let stopped = run("first", 1, own, &[&drive[..], &["--stop-at=20"]].concat());
    assert_eq!(stopped.code, 75, "{}", stopped.text);
    let load = |name: &str| {
        let checkpoint = folder.path().join(name).join("checkpoint.h5");
        let [header, _] = gshear_store::checkpoint::read_texts(&checkpoint).expect("a checkpoint");
        match Header::parse(&checkpoint, &header).expect("a header").0 {
            Header::Shear(shear) => shear.piston.load,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(load("first"), own * length);
    let branch = [
        format!("--resume={}", folder.path().join("first").display()),
        format!("--branch={}", folder.path().join("branch").display()),
        format!("--set=load.pressure={:e}", 1.5 * own),
        "--stop-at=40".into(),
    ];
    let mut command = program(1);
    let branch = command.args(branch).output().expect("the program starts");
    assert_eq!(branch.status.code(), Some(75), "{branch:?}");
    assert_eq!(load("branch"), 1.5 * own * length);
}

#[test]
fn anothers_packing_is_sheared() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, OF_A_FILE).expect("written");
    let run = |name: &str, ranks, sets: &[&str]| {
        let mut arguments = vec![
            path.display().to_string(),
            "--overwrite".into(),
            format!("--set=sample.packing={TRIANGULAR}"),
        ];
        arguments.extend(sets.iter().map(|s| format!("--set={s}")));
        gshear_mpi(ranks, &folder.path().join(name), &arguments)
    };
    for (name, sets) in [
        ("types", &["pack.tolerance=none"][..]),
        ("layers", &["pack.tolerance=none", "sample.walls=layers"]),
        ("packed", &["pack.skip=false"]),
    ] {
        let one = run(name, 1, sets);
        assert_eq!(one.digest(), run("two", 2, sets).digest(), "{name}");
        assert_eq!(
            one.text.contains("at rest after"),
            name == "packed",
            "{}",
            one.text
        );
        let first = export(
            &folder.path().join(name),
            &["--frame=0"],
            &folder.path().join("first.data"),
        );
        let of = |kind| first.atoms.iter().filter(|a| a.kind == kind).count();
        assert_eq!([of(1), of(2), of(3)], [100, 10, 10], "{name}");
    }

    let outside = folder.path().join("outside.data");
    let text = std::fs::read_to_string(TRIANGULAR).expect("the packing");
    let squeezed = text.replace("11 1 0.001 2500 -0.00125075", "11 1 0.001 2500 -0.00065075");
    assert_ne!(squeezed, text);
    std::fs::write(&outside, squeezed).expect("written");
    let set = format!("sample.packing={}", outside.display());
    for ranks in [1, 2] {
        let refused = run("refused", ranks, &["pack.tolerance=none", &set]);
        assert_eq!(refused.code, 2, "{}", refused.text);
        let said = format!("error: {}:19: atom 11 overlaps atom ", outside.display());
        assert!(refused.text.contains(&said), "{}", refused.text);
        assert!(!folder.path().join("refused").exists());
    }
}

/// A free grain that falls through a hole of the bottom wall ends the run, with its id and place,
/// the same on one rank and two; until then no more than the first packing is between the walls.
#[test]
fn a_grain_that_leaves_through_a_wall_ends_the_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = std::fs::read_to_string(TRIANGULAR).expect("the packing");
    let is_of_hole = |line: &&str| ["4 ", "5 "].iter().any(|id| line.starts_with(id));
    let lines = text.replace("120 atoms", "118 atoms");
    let lines = lines.lines().filter(|line| !is_of_hole(line));
    let lines: Vec<String> = lines.map(|line| renumbered(line, |id| 1000 * id)).collect();
    let path = folder.path().join("hole.data");
    std::fs::write(&path, lines.join("\n")).expect("written");
    let scene = folder.path().join("hole.toml");
    let text = "
        material.density = 2500
        contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.3, damping_ratio = 0.1 }
        sample.packing = 'hole.data'
        load = { stiffness_number = 1e3, gravity = 9.81 }
        shear = { inertial_number = 0.01, strain = 3.0 }
        output = { frame_strain = 0, series_strain = 1e-3 }
        ";
    std::fs::write(&scene, text).expect("written");
    let said = [1, 2].map(|ranks| {
        let at = folder.path().join(format!("on-{ranks}"));
        let ended = gshear_mpi(ranks, &at, &[scene.display().to_string()]);
        assert_eq!(ended.code, 3, "{}", ended.text);
        let run = RunFile::open(&at).expect("a run");
        let fractions = run.series().column("solid_fraction");
        let most = fractions.iter().copied().fold(0.0, f64::max);
        assert_eq!(most, fractions[0]);
        let error = ended.text.lines().find(|line| line.starts_with("error: "));
        // The rest names the files of this run.
        let error = error
            .expect("a message")
            .split_once("; the last sound state");
        error.expect("a checkpoint").0.to_string()
    });
    let expected = "has left the space between the walls through the bottom wall";
    assert!(said[0].contains(expected), "{}", said[0]);
    assert_eq!(said[0], said[1]);
    // The id of the file, less one.
    let id = said[0].split_once("grain ").expect("a grain").1;
    let id: u32 = id
        .split(' ')
        .next()
        .and_then(|id| id.parse().ok())
        .expect("an id");
    assert_eq!(id % 1000, 999, "{}", said[0]);
}

/// The bottom wall of this sample had a hole wider than any grain, bridged by an arch. A grain left
/// after 48,321 steps; now one of the arch is a grain of the wall, on any number of ranks.
#[test]
fn a_hole_under_an_arch_is_closed() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = folder.path().join("arch.toml");
    let text = "
        seed = 1
        material = { young_modulus = 1e9, poisson_ratio = 0.2, density = 2500 }
        contact = { friction = 0.2, rolling_friction = 0.01, damping_ratio = 0.1 }
        sample = { grains = 300, radius_min = 0.5e-6, radius_max = 1e-6, length = 30e-6 }
        load.stiffness_number = 1e3
        shear = { inertial_number = 1e-3, strain = 0.1 }
        output = { frame_strain = 0, series_strain = 1e-4 }
        ";
    std::fs::write(&scene, text).expect("written");
    let shear = |name: &str, ranks: usize, stop: u64| {
        let arguments = [scene.display().to_string(), format!("--stop-at={stop}")];
        let ended = gshear_mpi(ranks, &folder.path().join(name), &arguments);
        assert_eq!(ended.code, 75, "{}", ended.text);
        let plugged = "one grain more belongs to the walls: it closes a hole";
        assert!(ended.text.contains(plugged), "{}", ended.text);
        let run = RunFile::open(&folder.path().join(name)).expect("a run");
        run.grains().body.clone()
    };
    let bodies = shear("long", 1, 50_000);
    assert_eq!(shear("ranks", 2, 1), bodies);
}

/// A sample that weighs 20 times its load comes to rest: the bottom wall carries load and weight.
/// Sheared, it keeps its energy: a grain that rises takes some.
#[test]
fn a_heavy_sample_is_packed() {
    let folder = tempfile::tempdir().expect("a folder");
    for dimension in [2, 3] {
        let (grains, stiffness, width) = match dimension {
            2 => (300, 1e6, ""),
            _ => (500, 1e3, "width = 8e-3, "),
        };
        let text = format!(
            "
            dimension = {dimension}
            material.density = 2500
            contact = {{ law = 'hooke', normal_stiffness = {stiffness}, friction = 0.5, damping_ratio = 0.2 }}
            sample = {{ {width}grains = {grains}, radius_min = 0.8e-3, radius_max = 1e-3, length = 20e-3 }}
            load = {{ stiffness_number = 1e5, gravity = 9.81 }}
            pack = {{ tolerance = 1e-4, max_steps = 400000 }}
            shear = {{ velocity = 0.02, strain = 0.02 }}
            output = {{ frame_strain = 0.02, series_strain = 1e-3 }}
            "
        );
        let scene = folder.path().join("heavy.toml");
        std::fs::write(&scene, text).expect("written");
        let at = folder.path().join(format!("heavy-{dimension}"));
        gshear_mpi(1, &at, &[scene.display().to_string()]).digest();
        let run = RunFile::open(&at).expect("a run");
        let frame = run.records(0..1).expect("a frame").remove(0);
        let (body, mass) = (&run.grains().body, &run.grains().mass);
        let up = |c: &ContactSample| {
            let [i, j] = [c.i, c.j].map(|id| id as usize);
            if (body[i] == 1) == (body[j] == 1) {
                return 0.0;
            }
            let [a, b] = [i, j].map(|id| &frame.grains[id].position);
            let apart = match dimension {
                2 => run.cell(0).separation::<Two>(a, b),
                _ => run.cell(0).separation::<Three>(a, b),
            };
            c.normal_force * apart[dimension - 1].abs() / length(apart)
        };
        let carried: f64 = frame.contacts.iter().map(up).sum();
        let above = mass.iter().zip(body).filter(|(_, body)| **body != 1);
        let weight = 9.81 * above.map(|(mass, _)| mass).sum::<f64>();
        let load = run.number("normal_force").expect("N");
        assert!(weight > 20.0 * load, "{weight} {load}");
        let expected = load + weight;
        assert!(
            (carried / expected - 1.0).abs() < 1e-3,
            "{carried} is not {expected}"
        );
        let residual = run.series().column("energy_residual");
        let greatest = residual.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
        assert!(greatest < 1e-2, "{residual:?}");
    }
}

/// Disks of 4 : 1, of whose small ones a single one would bear the whole load at first: they begin
/// again under a part of it, to the same bits on every number of ranks. A load that no packing of
/// them bears is refused with the least that is taken.
#[test]
fn wide_sizes_are_packed_under_a_growing_load() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("wide.toml");
    let scene = "
        seed = 2
        material = { density = 2500, young_modulus = 1e7, poisson_ratio = 0.2 }
        contact = { law = 'lee-hurley', friction = 0.5, damping_ratio = 0.1 }
        load.stiffness_number = 1e3
        pack.tolerance = 1e-4
        shear = { inertial_number = 0.01, strain = 1e-4 }
        [sample]
        grains = 500
        sizes = 'binary'
        radius_min = 0.25e-3
        radius_max = 1e-3
        large_fraction = 0.03
        length = 16e-3
        ";
    std::fs::write(&path, scene).expect("written");
    let run = |name: &str, ranks, sets: &[&str]| {
        let mut arguments = vec![path.display().to_string()];
        arguments.extend(sets.iter().map(|set| format!("--set={set}")));
        gshear_mpi(ranks, &folder.path().join(name), &arguments)
    };
    let one = run("one", 1, &[]);
    assert!(
        one.text.contains("begins again under a quarter"),
        "{}",
        one.text
    );
    assert_eq!(one.digest(), run("two", 2, &[]).digest());
    let soft = run("soft", 1, &["load.stiffness_number=20"]);
    assert_eq!(soft.code, 2, "{}", soft.text);
    let (_, least) = soft
        .text
        .split_once("kappa = 20.0; give at most ")
        .expect("a limit");
    let least = least.split_once("kappa = ").expect("a limit").1;
    let least = least.split(',').next().expect("a number");
    let set = format!("load.stiffness_number={least}");
    let mut command = program(1);
    succeed(
        command
            .arg(&path)
            .args(["--check", "--quiet", "--set"])
            .arg(&set),
    );
}
