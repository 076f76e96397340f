//! What the energy budget says of a sphere on a floor: closed forms of sliding and of rolling to
//! rest, of every law whose dampers a limit cuts together with their springs.

use std::fmt::Write as _;
use std::fs;

use crate::common::{gshear_mpi, run_scene};
use gshear_store::run_reader::RunFile;

/// Radius (m), density (kg/m³), speed (m/s).
const RADIUS: f64 = 1e-3;
const DENSITY: f64 = 2500.0;
const SPEED: f64 = 0.02;

fn mass() -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * DENSITY * RADIUS.powi(3)
}

/// Laws of about the same stiffness, damped.
const LAWS: [(&str, &str, &str); 5] = [
    (
        "hooke",
        "",
        r#"law = "hooke"
normal_stiffness = 500.0
damping_ratio = 0.3"#,
    ),
    (
        "hertz",
        "young_modulus = 5e7\npoisson_ratio = 0.3",
        r#"law = "hertz"
normal_damping = 3e8"#,
    ),
    (
        "tsuji",
        "young_modulus = 5e7\npoisson_ratio = 0.3",
        r#"law = "hertz-tsuji"
restitution = 0.3"#,
    ),
    (
        "hertz-force",
        "young_modulus = 5e7\npoisson_ratio = 0.3",
        r#"law = "hertz"
normal_damping = 3e8
tangential_history = "force""#,
    ),
    (
        "tsuji-force",
        "young_modulus = 5e7\npoisson_ratio = 0.3",
        r#"law = "hertz-tsuji"
restitution = 0.3
tangential_history = "force""#,
    ),
];

/// The time series of a sphere of this spin (rad/s) on a floor: dampers, friction, rolling, and the
/// elastic energies of the first row.
struct Series {
    damping: Vec<f64>,
    friction: Vec<f64>,
    rolling: Vec<f64>,
    elastic: [f64; 2],
}

fn on_a_floor(name: &str, material: &str, contact: &str, spin: f64, time: f64) -> Series {
    let folder = tempfile::tempdir().expect("a folder");
    let data = format!(
        "a sphere\n\n1 atoms\n1 atom types\n\n0.0 0.01 xlo xhi\n0.0 0.01 ylo yhi\n0.0 0.02 zlo zhi\n\n\
         Atoms # sphere\n\n1 1 0.002 2500.0 0.005 0.005 0.0009998\n\n\
         Velocities\n\n1 {SPEED} 0.0 0.0 0.0 {spin} 0.0\n"
    );
    fs::write(folder.path().join("one.data"), data).expect("a packing");
    let scene = format!(
        "dimension = 3\n[material]\ndensity = {DENSITY}\n{material}\n[contact]\n{contact}\nfriction = 0.5\n\
         [sample]\npacking = \"one.data\"\nwalls = \"flat\"\n[load]\npressure = 100.0\ngravity = 10.0\n\
         [time]\nstep = 2e-6\n[shear]\nprotocol = [{{ velocity = 0.0, time = {time}, wall_velocity = 0.0 }}]\n\
         [output]\nseries_rows = 60\n"
    );
    let file = folder.path().join("scene.toml");
    fs::write(&file, scene).expect("a scene");
    let run = folder.path().join("run");
    let outcome = gshear_mpi(1, &run, &[file.to_str().expect("UTF-8").to_string()]);
    assert_eq!(outcome.code, 0, "{name}: {}", outcome.text);
    let run = RunFile::open(&run).expect("a run");
    let column = |name: &str| run.series().column(name).to_vec();
    let first = |name: &str| column(name)[0];
    Series {
        damping: column("dissipated_damping"),
        friction: column("dissipated_friction"),
        rolling: column("dissipated_rolling"),
        elastic: [first("elastic_tangential"), first("elastic_rolling")],
    }
}

fn last(of: &[f64]) -> f64 {
    of[of.len() - 1]
}

/// Nothing is given back, and nothing is stored before something works on it.
fn is_sound(name: &str, series: &Series, energy: f64) {
    for part in [&series.damping, &series.friction, &series.rolling] {
        for pair in part.windows(2) {
            assert!(pair[1] - pair[0] > -1e-6 * energy, "{name}: {part:?}");
        }
    }
    for elastic in series.elastic {
        assert!(
            elastic.abs() < 1e-12 * energy,
            "{name}: {elastic:e} at the start"
        );
    }
}

/// It slides until it rolls at 5/7 of its speed: friction takes 2/7 of its energy, dampers next to
/// nothing.
#[test]
fn a_sphere_that_slides_loses_the_work_of_friction() {
    let energy = 0.5 * mass() * SPEED * SPEED;
    for (name, material, contact) in LAWS {
        let series = on_a_floor(name, material, contact, 0.0, 3e-3);
        is_sound(name, &series, energy);
        let friction = last(&series.friction) / energy;
        assert!((friction - 2.0 / 7.0).abs() < 0.01, "{name}: {friction}");
        assert!(
            last(&series.damping) < 0.02 * energy,
            "{name}: {:?}",
            series.damping
        );
        assert_eq!(last(&series.rolling), 0.0, "{name}");
    }
}

/// It rolls without slip until it rests: rolling takes all of its energy, 7/10 mv².
#[test]
fn a_sphere_that_rolls_to_rest_loses_the_work_of_rolling() {
    let energy = 0.7 * mass() * SPEED * SPEED;
    for (name, material, contact) in LAWS {
        let resisting = format!(
            "{contact}\nrolling_friction = 0.05\nrolling_stiffness = 2e3\nrolling_damping_ratio = 0.3"
        );
        let series = on_a_floor(name, material, &resisting, SPEED / RADIUS, 0.08);
        is_sound(name, &series, energy);
        let rolling = last(&series.rolling) / energy;
        assert!((rolling - 1.0).abs() < 0.02, "{name}: {rolling}");
        let rest = last(&series.damping) + last(&series.friction).abs();
        assert!(rest < 0.02 * energy, "{name}: {rest:e} of {energy:e}");
    }
}

/// A closed cycle of shear and pressure on a cubic lattice, twice: sheared, pressed, sheared back,
/// released. The work of the drive over the tangential energy after the first part.
fn work_of_a_cycle(law: &str, history: &str) -> f64 {
    let folder = tempfile::tempdir().expect("a folder");
    let (side, diameter) = (6, 1e-3);
    let spacing = diameter * (1.0 - 5e-3);
    let mut grains = format!(
        "##PERIODIC:: {0:?} {0:?} {0:?}\n",
        f64::from(side) * spacing
    );
    for id in 0..side * side * side {
        for place in [id % side, id / side % side, id / side / side] {
            let _ = write!(grains, "{:?} ", (f64::from(place) + 0.5) * spacing);
        }
        let _ = writeln!(grains, "{:?}", 0.5 * diameter);
    }
    fs::write(folder.path().join("lattice.txt"), grains).expect("a packing");
    let scene = format!(
        "dimension = 3\n[material]\nyoung_modulus = 1e6\npoisson_ratio = 0.3\ndensity = 2500.0\n\
         [contact]\n{law}\ntangential_history = \"{history}\"\nfriction = 10.0\n\
         [sample]\npacking = \"lattice.txt\"\nboundary = \"periodic\"\n[load]\npressure = 200.0\n\
         [shear]\nprotocol = [\n{{ velocity = 2e-5, time = 0.05, wall_velocity = 0.0 }},\n\
         {{ velocity = 0.0, time = 0.05, wall_velocity = -6e-4 }},\n\
         {{ velocity = -2e-5, time = 0.05, wall_velocity = 0.0 }},\n\
         {{ velocity = 0.0, time = 0.05, wall_velocity = 6e-4 }},\n]\n[output]\nseries_rows = 10\n"
    );
    let run = run_scene(folder.path(), "cycle", &scene, &[]);
    let series = run.series();
    let last = series.rows() - 1;
    let sheared = series.time.iter().filter(|now| **now <= 0.0501).count() - 1;
    series.column("work_drive")[last] / series.column("elastic_tangential")[sheared]
}

/// No cycle returns more than it took where contacts remember a force: second law. Where they
/// remember a displacement u, this one returns ½k_t u² (√(δ'R*) - √(δR*)) of each contact.
#[test]
fn a_closed_cycle_returns_nothing_from_remembered_forces() {
    for law in [
        "law = \"hertz\"\nnormal_damping = 1e6",
        "law = \"hertz-tsuji\"\nrestitution = 0.3",
    ] {
        let [displacement, force] = ["displacement", "force"].map(|of| work_of_a_cycle(law, of));
        println!("{law}: {displacement} {force}");
        assert!(
            displacement < -0.02 && force > -1e-3,
            "{law}: {displacement} {force}"
        );
    }
}
