//! The contracts of spheres, through the real program: bits compared, never approximately.

use std::fmt::Write;
use std::path::Path;

use crate::common::{avx2, beyond_the_digest, gshear_mpi, reducer, same_run};
use gshear_dem::domain::Solo;
use gshear_store::checkpoint::{PREVIOUS, read};
use gshear_store::run_reader::RunFile;

/// A third of the scene's drive.
const SHORT: &str = "shear.protocol=[{ velocity = 3.0, distance = 2e-3 }, \
    { velocity = 0.0, time = 1e-4 }, { velocity = 2.0, distance = 1e-3 }]";
/// A step of its last part.
const LATE: &str = "--stop-at=1900";

/// Contracts 1, 2 and 3 of spheres with vectors for histories, under a spring and a protocol with a
/// hold.
#[test]
fn spheres_under_a_spring_keep_the_contracts() {
    const SPHERES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing-3d.toml");
    let folder = tempfile::tempdir().expect("a folder");
    let run = |name: &str, ranks, further: &[&str]| {
        let mut arguments = vec![SPHERES.to_string()];
        arguments.extend(further.iter().map(ToString::to_string));
        gshear_mpi(ranks, &folder.path().join(name), &arguments)
    };
    let expected = run("one", 1, &[]).digest();
    // Checkpoints by the time, in the middle of parts, do not reach the numbers.
    let five = [
        "--set=bookkeeping.skin=0.3",
        "--set=output.checkpoint_time=3e-4",
    ];
    assert_eq!(run("five", 5, &five).digest(), expected, "5 ranks");
    same_run(&folder.path().join("one"), &folder.path().join("five"));
    let beyond = beyond_the_digest(&folder.path().join("one"));
    assert!(
        beyond[1].iter().any(|limit| limit & 0b101 == 0b101),
        "nothing slides"
    );
    spheres_cross(&folder.path().join("five"));

    assert_eq!(run("start", 2, &["--stop-at=1"]).code, 75);
    let start = folder.path().join("start/checkpoint.h5");
    for (ranks, further) in [
        (
            2,
            &[
                "--set=bookkeeping.rebuild_every=40",
                "--set=bookkeeping.band_grains=40",
                "--set=output.frame_rows=500",
                "--set=output.series_rows=1",
            ][..],
        ),
        (
            1,
            &[
                avx2(),
                "--threads=3",
                "--set=output.series_rows=0",
                "--set=output.energy=false",
            ],
        ),
        (
            1,
            &[
                "--set=bookkeeping.band_grains=40",
                "--set=bookkeeping.steps_at_once=3",
            ],
        ),
    ] {
        let mut arguments = vec![format!("--resume={}", start.display())];
        arguments.extend(further.iter().map(ToString::to_string));
        let other = folder.path().join("other");
        let outcome = gshear_mpi(ranks, &other, &arguments);
        assert_eq!(outcome.digest(), expected, "{ranks} ranks, {further:?}");
        assert_eq!(
            beyond_the_digest(&other),
            beyond,
            "{ranks} ranks, {further:?}"
        );
    }

    // Portable code is slow, so it has the last part alone.
    assert_eq!(run("late", 1, &["--stop-at=6500"]).code, 75);
    let late = folder.path().join("late");
    let resume = format!("--resume={}", late.join("checkpoint.h5").display());
    let portable = "--set=bookkeeping.simd=portable".to_string();
    assert_eq!(gshear_mpi(3, &late, &[resume, portable]).digest(), expected);
    assert_eq!(beyond_the_digest(&late), beyond, "portable");

    let step_before_the_last = |name: &str| {
        let path = folder.path().join(name).join(PREVIOUS);
        let ([header, _], _) = read(&Solo, &path).expect("a checkpoint");
        let header: serde_json::Value = serde_json::from_str(&header).expect("JSON");
        header["step"].as_u64().expect("a step")
    };
    let [of_parts, by_time] = ["one", "five"].map(step_before_the_last);
    assert!(
        of_parts < by_time && by_time % 100 == 0,
        "{of_parts} {by_time}"
    );

    // In the hold, and again in the last part.
    assert_eq!(run("broken", 3, &["--stop-at=3100"]).code, 75);
    let broken = folder.path().join("broken");
    let resume = format!("--resume={}", broken.join("checkpoint.h5").display());
    let again = gshear_mpi(1, &broken, &[resume.clone(), "--stop-at=4000".into()]);
    assert_eq!(again.code, 75, "{}", again.text);
    assert_eq!(gshear_mpi(2, &broken, &[resume]).digest(), expected);
    same_run(&folder.path().join("one"), &broken);
    assert_eq!(beyond_the_digest(&broken), beyond);

    // Attraction, which depends on the radii and jumps in the steps of touch and of opening; that
    // of JKR holds grains together that no longer overlap. Tsuji's dampers, which exceed Coulomb's
    // limit at most touches and set springs back to their bound. Springs that remember their force.
    // Friction that grows with the age.
    let energy = "--set=contact.surface_energy=2.0";
    let tsuji = [
        "--set=contact.law=hertz-tsuji",
        "--set=contact.impact_speed=none",
        "--set=contact.impact_diameter=none",
        "--set=contact.restitution=0.7",
        "--set=contact.tangential_damping_ratio=2.0",
    ];
    let ageing = [
        "--set=contact.ageing=0.1",
        "--set=contact.ageing_time=1e-6",
        "--set=contact.ageing_slip=1e-6",
    ];
    let cases = [
        ("ageing", &ageing[..]),
        ("held", &[energy, "--set=contact.adhesion=dmt"]),
        ("adhering", &[energy, "--set=contact.adhesion=jkr"]),
        ("damped", &tsuji),
        ("rescaled", &["--set=contact.tangential_history=force"]),
    ];
    let short = format!("--set={SHORT}");
    let plain = run("plain", 1, &[&short]).digest();
    for (held, sets) in cases {
        let changed = |name: &str, ranks, further: &[&str]| {
            run(name, ranks, &[sets, &[&short], further].concat())
        };
        let digest = changed(held, 1, &[]).digest();
        assert_ne!(digest, plain);
        let apart = |overlap: &f64| *overlap < 0.0;
        let file = hdf5::File::open(folder.path().join(held).join("run.h5")).expect("run.h5");
        let overlaps = file
            .dataset("connectivity/contacts/overlap")
            .expect("overlaps");
        let overlaps: Vec<f64> = overlaps.read_raw().expect("overlaps");
        assert_eq!(overlaps.iter().any(apart), held == "adhering");
        // 4e-5, with Δt/2 3e-5: the energy of the jumps is accounted for.
        let series = RunFile::open(&folder.path().join(held)).expect("a run");
        let residual = series.series().column("energy_residual");
        let later = &residual[residual.len() / 2..];
        assert!(later.iter().all(|x| x.abs() < 2e-4), "{later:?}");
        let without_output = [
            "--threads=2",
            "--set=output.energy=false",
            "--set=output.series_rows=0",
            "--set=bookkeeping.skin=0.01",
        ];
        let quietly = format!("{held}-quietly");
        assert_eq!(changed(&quietly, 2, &without_output).digest(), digest);
        let stopped = [LATE, "--overwrite"];
        assert_eq!(changed(held, 3, &stopped).code, 75);
        let checkpoint = folder.path().join(held).join("checkpoint.h5");
        let resume = format!("--resume={}", checkpoint.display());
        let portable = "--set=bookkeeping.simd=portable".to_string();
        let on = folder.path().join(format!("{held}-on"));
        assert_eq!(gshear_mpi(2, &on, &[resume, portable]).digest(), digest);
    }

    let packed = |ranks| {
        let further = [
            "--set=pack.skip=false",
            "--set=pack.tolerance=0.1",
            "--set=shear.protocol=[{ velocity = 3.0, distance = 1e-4 }]",
        ];
        run(&format!("packed-{ranks}"), ranks, &further).digest()
    };
    assert_eq!(packed(1), packed(3), "3 ranks pack");
}

/// Halos so wide that all threads of a rank copy their records: a block of cells of spheres that
/// touch, of 40 by 40 across the slabs.
#[test]
fn wide_halos_keep_the_contracts() {
    const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing-3d.toml");
    const LAYERS: [usize; 3] = [8, 40, 40];
    const SPACING: f64 = 2e-3;
    let folder = tempfile::tempdir().expect("a folder");
    let [along, across, up] = LAYERS.map(|layers| layers as f64 * SPACING);
    let mut text = format!(
        "Spheres in cubes\n\n{} atoms\n3 atom types\n\n0.0 {along} xlo xhi\n0.0 {across} ylo yhi\n\
         0.0 {up} zlo zhi\n\nAtoms # sphere\n\n",
        LAYERS.iter().product::<usize>(),
    );
    for id in 0..LAYERS.iter().product() {
        let [k, l, m] = [id % 8, id / 8 % 40, id / 320];
        let body = match m {
            0 => 2,
            39 => 3,
            _ => 1,
        };
        // Of different sizes, so that the forces on a sphere do not cancel.
        let diameter = SPACING * (1.002 + 1e-3 * (id * 7919 % 13) as f64 / 13.0);
        let [x, y, z] = [k, l, m].map(|layer| (layer as f64 + 0.5) * SPACING);
        let atom = id + 1;
        writeln!(text, "{atom} {body} {diameter} 2500 {x} {y} {z}").expect("a line");
    }
    let packing = folder.path().join("cubes.data");
    std::fs::write(&packing, text).expect("a packing");
    let run = |name: &str, ranks, further: &[&str]| {
        let mut arguments = vec![
            SCENE.to_string(),
            format!("--set=sample.packing={}", packing.display()),
            "--set=shear.protocol=[{ velocity = 3.0, distance = 1e-4 }]".into(),
        ];
        arguments.extend(further.iter().map(ToString::to_string));
        gshear_mpi(ranks, &folder.path().join(name), &arguments).digest()
    };
    let expected = run("one", 1, &[]);
    for (ranks, threads) in [(2, 2), (2, 3), (3, 2)] {
        let name = format!("{ranks}-{threads}");
        let digest = run(&name, ranks, &[&format!("--threads={threads}")]);
        assert_eq!(digest, expected, "{ranks} ranks, {threads} threads");
        same_run(&folder.path().join("one"), &folder.path().join(name));
    }
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
    let edges: Vec<f64> = read("particles/trajectory/box/edges/value")
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

/// The same of three materials, whose pairs have laws of their own: read from the types of a
/// packing, walls included; nothing depends on how the list keeps their pairs apart.
#[test]
fn mixtures_keep_the_contracts() {
    const SCENES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes");
    let folder = tempfile::tempdir().expect("a folder");
    let packing = std::fs::read_to_string(format!("{SCENES}/crossing-3d.data")).expect("a file");
    let row = |line: &str| match line.split_once(" 1 ") {
        Some((id, rest)) if id.parse().is_ok_and(|id: u32| id.is_multiple_of(3)) => {
            format!("{id} 4 {rest}")
        }
        _ => line.into(),
    };
    let mixed = packing.lines().map(row).collect::<Vec<_>>().join("\n");
    std::fs::write(
        folder.path().join("mixed.data"),
        mixed.replace("3 atom", "4 atom"),
    )
    .expect("a packing");
    let scene = format!(
        "extends = '{SCENES}/crossing-3d.toml'
         {SHORT}
         sample = {{ packing = 'mixed.data', walls = 'types', wall_material = 'rough' }}
         [contact]
         pair = [
             {{ materials = ['soft', 'soft'], friction = 0.0, restitution = 0.9 }},
             {{ materials = ['rough', 'hard'], friction = 1.0, rolling_friction = 0.1 }},
         ]
         [[material]]
         name = 'hard'
         young_modulus = 1e8
         poisson_ratio = 0.3
         density = 2500.0
         [[material]]
         name = 'soft'
         young_modulus = 5e7
         poisson_ratio = 0.45
         density = 4000.0
         [[material]]
         name = 'rough'
         young_modulus = 1e8
         poisson_ratio = 0.2
         density = 3000.0
         "
    );
    let path = folder.path().join("mixture.toml");
    std::fs::write(&path, scene).expect("a scene");
    let run = |name: &str, ranks, further: &[&str]| {
        let mut arguments = vec![path.display().to_string()];
        arguments.extend(further.iter().map(ToString::to_string));
        gshear_mpi(ranks, &folder.path().join(name), &arguments)
    };
    let expected = run("one", 1, &[]).digest();
    let rebuilt = [
        "--set=bookkeeping.rebuild_every=7",
        "--set=bookkeeping.skin=0.3",
        "--threads=2",
    ];
    assert_eq!(run("three", 3, &rebuilt).digest(), expected);
    same_run(&folder.path().join("one"), &folder.path().join("three"));
    let file = hdf5::File::open(folder.path().join("one/run.h5")).expect("run.h5");
    let of = |name: &str| -> Vec<u8> {
        let dataset = file.dataset(&format!("particles/trajectory/{name}"));
        dataset.and_then(|d| d.read_raw()).expect(name)
    };
    let (material, body) = (of("material"), of("body"));
    let count = |of: u8| material.iter().filter(|k| **k == of).count();
    assert!([0, 1, 2].map(count).iter().all(|&n| n > 50));
    assert!(
        material
            .iter()
            .zip(&body)
            .all(|(k, body)| (*k == 2) == (*body > 0))
    );

    let quiet = [
        "--set=output.energy=false",
        "--set=output.series_rows=0",
        "--set=bookkeeping.skin=0.3",
    ];
    assert_eq!(run("quiet", 2, &quiet).digest(), expected);
    // With JKR adhesion, whose E* is that of each pair.
    let adhering = [
        "--set=contact.surface_energy=2.0",
        "--set=contact.adhesion=jkr",
    ];
    let held = run("held", 1, &adhering).digest();
    assert_ne!(held, expected);
    let three = run("held-by-three", 3, &[&adhering[..], &rebuilt].concat());
    assert_eq!(three.digest(), held);
    // A type of no material is not taken for the first.
    let other = mixed.replace(" 4 ", " 6 ").replace("3 atom", "6 atom");
    let path = folder.path().join("other.data");
    std::fs::write(&path, other).expect("a packing");
    let refused = run(
        "refused",
        2,
        &[&format!("--set=sample.packing={}", path.display())],
    );
    assert_eq!(refused.code, 2);
    let what = "atom 3 is of type 6, which is that of no material; give a material atom_type = 6";
    assert!(refused.text.contains(what), "{}", refused.text);

    // Exports have them: as a column, and as the types of atoms, of which 2 and 3 are walls.
    let one = folder.path().join("one").display().to_string();
    let exported = |how: &[&str], file: &str| {
        let out = folder.path().join(file);
        let command = &mut reducer();
        command.args(["export", &one, "--out"]).arg(&out).args(how);
        assert!(command.status().expect("the reducer").success());
        std::fs::read_to_string(out).expect(file)
    };
    let table = exported(&["--format=csv", "--frames=0..1"], "frames.csv");
    let [head, rows @ ..] = &table.lines().collect::<Vec<_>>()[..] else {
        panic!("an empty table");
    };
    let at = |name: &str| head.split(',').position(|of| of == name).expect(name);
    let (id, of) = (at("id"), at("material"));
    for row in rows.iter().take(material.len()) {
        let cells: Vec<&str> = row.split(',').collect();
        let k = material[cells[id].parse::<usize>().expect("an id")];
        assert_eq!(cells[of].parse(), Ok(f64::from(k)));
    }
    let data = exported(&["--format=lammps-data"], "end.data");
    let types = data.lines().filter_map(|line| {
        let words: Vec<&str> = line.split(' ').collect();
        (words.len() == 7 && words[1].len() == 1).then(|| words[1].to_string())
    });
    let types: Vec<String> = types.collect();
    for (of, kind) in [(0, "1"), (1, "4")] {
        assert_eq!(types.iter().filter(|t| *t == kind).count(), count(of));
    }

    assert_eq!(run("begun", 2, &[LATE]).code, 75);
    let resume = format!(
        "--resume={}",
        folder.path().join("begun/checkpoint.h5").display()
    );
    let portable = "--set=bookkeeping.simd=portable".to_string();
    let again = gshear_mpi(3, &folder.path().join("begun"), &[resume, portable]);
    assert_eq!(again.digest(), expected);
    same_run(&folder.path().join("one"), &folder.path().join("begun"));
}
