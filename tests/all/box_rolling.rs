//! Rolling resistance in a periodic box reaches the forces, through the real program.

use std::path::Path;

use crate::common::program;
use gshear_store::run_reader::RunFile;

/// A small box of disks or spheres with rolling resistance. `law` has the law and its springs.
fn scene(dimension: usize, law: &str, material: &str) -> String {
    let solid_fraction = if dimension == 2 { 0.9 } else { 0.72 };
    format!(
        "seed = 5\n\
         dimension = {dimension}\n\
         material = {{ density = 1.0{material} }}\n\
         contact = {{ {law}, damping_ratio = 0.1, friction = 0.5, rolling_friction = 0.2 }}\n\
         sample = {{ grains = 60, sizes = \"binary\", radius_min = 0.5, radius_max = 0.7, \
         large_fraction = 0.5, boundary = \"periodic\", solid_fraction = {solid_fraction} }}\n\
         relax = {{ tolerance = 1e-9, drag = 0.1 }}\n\
         aqs = {{ strain_step = 1e-3, steps = 5, frame_every = 5 }}\n\
         newtonian = {{ growth_times = 1.0, rows = 5, frames = 2 }}\n"
    )
}

/// The digest after the strain steps.
fn digest(folder: &Path, scene: &Path, more: &[&str]) -> String {
    let mut program = program(1);
    program.arg(scene).args(more).arg("--out").arg(folder);
    let output = program.output().expect("the program starts");
    let said = String::from_utf8_lossy(&output.stdout);
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}{complaint}");
    let mut words = said.split_whitespace();
    words
        .find(|word| *word == "digest")
        .unwrap_or_else(|| panic!("no digest in\n{said}"));
    words.next().expect("a digest").to_string()
}

/// Σ ½ k_n δ² + ½ F_t²/k_t + ½ M²/k_r of a hooke scene with k_n = 1, k_t = 0.5, k_r = k_t R_r², and
/// of spheres ½ T²/k_w, k_w = k_r.
fn has_the_energy_of_its_springs(folder: &Path) {
    let run = RunFile::open_any(&folder.join("run.h5")).expect("a run");
    let last = run.frames() - 1;
    let frame = run.records(last..last + 1).expect("a frame").remove(0);
    let radius = &run.grains().radius;
    let (mut rolling, mut others) = (0.0, 0.0);
    for c in &frame.contacts {
        let [r_i, r_j] = [c.i, c.j].map(|g| radius[g as usize]);
        let r_r = r_i * r_j / (r_i + r_j);
        let square = |of: &[f64]| of.iter().map(|x| x * x).sum::<f64>();
        let torques = c.rolling_history.powi(2) + square(&c.torques);
        rolling += 0.5 * torques / (0.5 * r_r * r_r);
        others += 0.5 * c.overlap.powi(2) + square(&c.tangential_history);
    }
    let row = run.series().step.binary_search(&frame.step).expect("a row");
    let found = run.series().column("elastic_energy")[row];
    assert!(
        (found / (rolling + others) - 1.0).abs() < 1e-12,
        "{found} {rolling} {others}"
    );
    assert!(rolling > 1e-6 * others, "{rolling} {others}");
}

#[test]
fn rolling_resistance_changes_the_state_of_a_box() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    for (name, dimension, law, material) in [
        (
            "hooke",
            2,
            "law = \"hooke\", normal_stiffness = 1.0, tangential_stiffness = 0.5",
            "",
        ),
        (
            "spheres",
            3,
            "law = \"hooke\", normal_stiffness = 1.0, tangential_stiffness = 0.5, \
             twisting_friction = 0.1",
            "",
        ),
        (
            "lee-hurley",
            2,
            "law = \"lee-hurley\"",
            ", young_modulus = 1.0, poisson_ratio = 0.2",
        ),
    ] {
        let path = at(&format!("{name}.toml"));
        std::fs::write(&path, scene(dimension, law, material)).expect("a scene");
        let with = digest(&at(&format!("{name}-with")), &path, &[]);
        let without = digest(
            &at(&format!("{name}-without")),
            &path,
            &["--set=contact.rolling_friction=0.0"],
        );
        assert_ne!(with, without, "{name}");
    }
    has_the_energy_of_its_springs(&at("hooke-with"));
    has_the_energy_of_its_springs(&at("spheres-with"));
}
