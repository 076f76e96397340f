//! Friction that grows with the age of a contact, through the real program.

use std::collections::HashMap;

use gshear_store::run_reader::RunFile;

use crate::common::gshear_mpi;

/// Spheres between walls that are sheared, then held.
const SCENE: &str = "
    dimension = 3
    material = { young_modulus = 1e8, poisson_ratio = 0.3, density = 2500 }
    contact = { friction = 0.3, normal_damping = 1e6, ageing = 0.1, ageing_time = 1e-4 }
    sample = { grains = 400, radius_min = 0.8e-3, radius_max = 1.2e-3, length = 12e-3, width = 10e-3 }
    load = { pressure = 1e3 }
    shear.protocol = [{ velocity = 0.5, distance = 1e-3 }, { velocity = 0.0, time = 1e-3 }]
    output = { frame_rows = 5, series_rows = 5 }
";
/// The scale of slip at which contacts are renewed (m).
const SLIP: f64 = 1e-6;

/// A run of the scene.
fn run(folder: &std::path::Path, ranks: usize, sets: &[&str]) -> RunFile {
    let scene = folder.join("scene.toml");
    std::fs::write(&scene, SCENE).expect("a scene");
    let mut arguments = vec![scene.display().to_string()];
    arguments.extend(sets.iter().map(|set| format!("--set={set}")));
    let out = folder.join(format!("out-{ranks}"));
    let outcome = gshear_mpi(ranks, &out, &arguments);
    assert_eq!(outcome.code, 0, "{}", outcome.text);
    RunFile::open(&out).expect("a run")
}

/// 0.3 (1 + 0.1 ln(1 + θ/0.1 ms)).
fn friction(age: f64) -> f64 {
    0.3 * (1.0 + 0.1 * (1.0 + age / 1e-4).ln())
}

/// The age is the time since the touch, and what slides has the friction of its age, in frames of
/// two ranks.
#[test]
fn sliding_contacts_have_the_friction_of_their_age() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = run(folder.path(), 2, &[]);
    let frames = run.records(0..run.frames()).expect("frames");
    let times = run.frame_times();
    let (mut aged, mut slid, mut before) = (0, 0, HashMap::<(u32, u32), f64>::new());
    for (k, frame) in frames.iter().enumerate() {
        let mut now: HashMap<(u32, u32), f64> = HashMap::new();
        for contact in &frame.contacts {
            let age = contact.age;
            // The packing has no friction, and its contacts no ages.
            assert_eq!(age > 0.0, k > 0);
            now.insert((contact.i, contact.j), age);
            if let Some(age_before) = before.get(&(contact.i, contact.j))
                && age > times[k] - times[k - 1]
            {
                let grown = age - age_before;
                let elapsed = times[k] - times[k - 1];
                assert!((grown / elapsed - 1.0).abs() < 1e-6, "{grown} {elapsed}");
                aged += 1;
            }
            if k > 0 && contact.sliding == 1 && contact.normal_force > 0.0 {
                let [x, y, z] = contact.tangential_force;
                let ratio = (x * x + y * y + z * z).sqrt() / contact.normal_force;
                assert!((ratio / friction(age) - 1.0).abs() < 1e-9, "{ratio} {age}");
                slid += 1;
            }
        }
        before = now;
    }
    assert!(aged > 1000 && slid > 50, "{aged} {slid}");
}

/// Slip that renews contacts keeps those young that slide; energy is accounted for as without.
#[test]
fn slip_renews_contacts() {
    let ages = |sets: &[&str]| {
        let folder = tempfile::tempdir().expect("a folder");
        let run = run(folder.path(), 1, sets);
        let residual = run.series().column("energy_residual");
        let last = residual.last().expect("a row");
        assert!(last.abs() < 1e-3, "{last}");
        let frame = run.records(2..3).expect("a frame").swap_remove(0);
        let sliding = frame.contacts.iter().filter(|contact| contact.sliding == 1);
        let mut ages: Vec<f64> = sliding.map(|contact| contact.age).collect();
        ages.sort_by(f64::total_cmp);
        ages[ages.len() / 2]
    };
    let [kept, renewed] = [ages(&[]), ages(&[&format!("contact.ageing_slip={SLIP}")])];
    assert!(renewed < 0.3 * kept, "{renewed} {kept}");
}
