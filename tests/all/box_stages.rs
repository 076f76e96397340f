//! Runs in a periodic sheared box, through the real program: what the paper's stages must give.

use std::path::Path;

use crate::common::{self, Outcome, gshear_mpi, run_scene};
use gshear_analysis::growth;
use gshear_store::file_names::{NEWTONIAN_PART, RUN_FILE, STATUS_FILE};
use gshear_store::run_reader::RunFile;

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");

fn run(folder: &Path, ranks: usize, more: &[&str]) -> Outcome {
    let mut arguments = vec![SCENE.to_string()];
    arguments.extend(more.iter().map(ToString::to_string));
    gshear_mpi(ranks, folder, &arguments)
}

/// Newton's method reaches what overdamped dynamics reaches where no contact opens: the same
/// energy, stress and pressure.
#[test]
fn newtons_method_finds_the_state_of_overdamped_dynamics() {
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
        RunFile::open_any(&folder.join(RUN_FILE)).expect("a file of the run")
    };
    let (newton, overdamped) = (of("newton"), of("overdamped"));
    let fell_back: f64 = newton.series().column("fell_back").iter().sum();
    assert!(fell_back < 3.0, "{fell_back} of 8 steps were not smooth");
    assert!(
        overdamped
            .series()
            .column("overdamped_steps")
            .iter()
            .skip(1)
            .all(|n| *n > 0.0)
    );
    for name in ["elastic_energy", "pressure"] {
        for (a, b) in (newton.series().column(name).iter()).zip(overdamped.series().column(name)) {
            assert!((a / b - 1.0).abs() < 1e-9, "{name}: {a} {b}");
        }
    }
    let change = |run: &RunFile| {
        let stress = run.series().column("shear_stress");
        stress[8] - stress[0]
    };
    assert!((change(&newton) / change(&overdamped) - 1.0).abs() < 1e-5);
}

/// Newton's equations let the pair grow and oscillate as its eigenvalue says (BO eq. 8), over 8
/// decades.
#[test]
fn a_complex_pair_grows_as_its_eigenvalue_says() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/configs/bonfanti.toml");
    let mut arguments = vec![scene.to_string()];
    for set in [
        "aqs.birth_precision=1e-5",
        // A pair that grows fast.
        "aqs.until_imaginary=1e-4",
        "newtonian.growth_times=20.0",
        "newtonian.rows=4000",
        "newtonian.frames=0",
        "newtonian.spectra=0",
    ] {
        arguments.push(format!("--set={set}"));
    }
    let outcome = gshear_mpi(1, folder.path(), &arguments);
    assert_eq!(outcome.code, 0, "{}", outcome.text);
    let run = RunFile::open_any(&folder.path().join(NEWTONIAN_PART)).expect("a file of the run");
    let of = |name: &str| run.number(name).expect("a complex pair");
    let (time, msd) = (&run.series().time, run.series().column("msd"));
    let growth = growth::fit(time, msd, 1e-11, Some(of("omega_r"))).expect("growth");
    assert!(growth.decades > 8.0, "{growth:?}");
    assert!(
        (growth.omega_i / of("omega_i") - 1.0).abs() < 0.01,
        "{growth:?}"
    );
    assert!(
        (growth.omega_r.expect("dense rows") / of("omega_r") - 1.0).abs() < 0.01,
        "{growth:?}"
    );
}

/// A box that is packed without its attraction comes to rest under it before the first row: over a
/// tiny strain step the energy changes by the work of the stress alone, and little by little.
#[test]
fn a_box_is_at_rest_under_its_attraction() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = "
        dimension = 3
        material.density = 1.0
        contact = { law = 'hooke', friction = 0.0, normal_stiffness = 1.0, damping_ratio = 0.1, attraction = 0.005 }
        sample = { grains = 160, radius_min = 0.5, radius_max = 0.7, boundary = 'periodic', solid_fraction = 0.68 }
        relax = { tolerance = 1e-11, drag = 0.1 }
        aqs = { strain_step = 1e-7, steps = 2 }
        ";
    for (method, further) in [("newton", ""), ("overdamped", "relax.method=overdamped")] {
        let set: Vec<&str> = further.split_whitespace().collect();
        let run = run_scene(folder.path(), method, scene, &set);
        let energy = run.series().column("elastic_energy");
        let change = |row: usize| (energy[row + 1] / energy[row] - 1.0).abs();
        println!("{method}: {:e} {:e}", change(0), change(1));
        assert!(change(0) < 1e-6, "{method}: {energy:?}");
        let contacts = run.series().column("contacts");
        assert_eq!(contacts[0], contacts[1], "{method}");
    }
}

/// Strain steps are quasi-static: dampers leave the stresses of contacts that stick as they are,
/// also of those across the edge along which the box is sheared.
#[test]
fn dampers_do_not_act_in_strain_steps() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = |sample: &str, damping: f64| {
        format!(
            "
            material.density = 1.0
            contact = {{ law = 'hooke', friction = 10.0, normal_stiffness = 1.0, damping_ratio = {damping} }}
            sample = {{ {sample}, boundary = 'periodic' }}
            relax = {{ tolerance = 1e-12, drag = 0.1 }}
            aqs = {{ strain_step = 1e-4, steps = 3, frame_every = 1 }}
            "
        )
    };
    let drawn = "grains = 100, radius_min = 0.5, radius_max = 0.7, solid_fraction = 0.88";
    run_scene(folder.path(), "first", &scene(drawn, 0.0), &[]);
    let [still, damped] = [0.0, 0.8].map(|damping| {
        let packing = format!(
            "packing = '{}'",
            folder.path().join("first/run.h5@0").display()
        );
        let name = format!("damping-{damping}");
        run_scene(folder.path(), &name, &scene(&packing, damping), &[])
    });
    let [still, damped] = [&still, &damped].map(|run| run.series().column("shear_stress").to_vec());
    let change = still[3] - still[0];
    assert!(change > 0.0);
    for (a, b) in still.iter().zip(&damped) {
        assert!((a - b).abs() < 1e-9 * change, "{still:?} {damped:?}");
    }
}

/// `info` of a run whose strain steps are complete says what has become of the stage after them.
#[test]
fn info_says_that_a_later_stage_failed() {
    let folder = tempfile::tempdir().expect("a folder");
    let outcome = run(folder.path(), 1, &["--set=newtonian.growth_times=0.01"]);
    assert_eq!(outcome.code, 0, "{}", outcome.text);
    let info = || {
        let mut command = common::reducer();
        let output = common::succeed(command.arg("info").arg(folder.path()));
        String::from_utf8(output.stdout).expect("text")
    };
    let text = info();
    assert!(text.contains("\nstate     finished, digest "), "{text}");
    assert!(!text.contains("then newtonian"), "{text}");
    let status = folder.path().join(STATUS_FILE);
    let text = std::fs::read_to_string(&status).expect("a status");
    let failed = text
        .replace("\"state\": \"done\"", "\"state\": \"failed\"")
        .replace("\"message\": null", "\"message\": \"too fast\"");
    assert_ne!(failed, text);
    std::fs::write(&status, failed).expect("a status");
    let text = info();
    let then = "\n          then newtonian: failed: too fast (stage newtonian)\n";
    assert!(text.contains("\nstate     finished, digest "), "{text}");
    assert!(text.contains(then), "{text}");
}
