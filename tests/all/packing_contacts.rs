//! Packings whose contacts leave the program and come back with their histories, through the real
//! programs: bits compared, never approximately.

use std::path::Path;

use gshear_dem::domain::Solo;
use gshear_dem::state::{ContactState, GrainState, body};
use gshear_driver::header::Saved;
use gshear_store::run_reader::RunFile;
use tempfile::TempDir;

use crate::common::{Outcome, gshear_mpi, reducer, succeed};

/// Disks between walls.
const DISKS: &str = "
    material.density = 2500
    sample = { grains = 220, radius_min = 0.4e-3, radius_max = 0.6e-3, length = 12e-3, LATER }
    load = { pressure = 1e3 }
    shear = { velocity = 0.02, strain = 0.02 }
    output = { frame_strain = 0.005, series_strain = 1e-3 }
";
/// Spheres between walls.
const SPHERES: &str = "
    dimension = 3
    material.density = 2500
    sample = { grains = 400, radius_min = 0.8e-3, radius_max = 1.2e-3, length = 12e-3, width = 10e-3, LATER }
    load = { pressure = 1e3 }
    shear = { velocity = 0.05, strain = 0.02 }
    output = { frame_strain = 0.005, series_strain = 1e-3 }
";
const INSERTED: [&str; 5] = ["grains", "radius_min", "radius_max", "length", "width"];

/// A sheared sample, and what is exported of it.
struct Exported {
    folder: TempDir,
    scene: String,
    saved: Saved,
}

impl Exported {
    /// Shears a scene, and stops it within the shear.
    fn new(scene: String, stop: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("first.toml"), &scene).expect("a scene");
        let of = |name: &str| folder.path().join(name);
        let arguments = [
            of("first.toml").display().to_string(),
            format!("--stop-at={stop}"),
        ];
        let stopped = gshear_mpi(1, &of("first"), &arguments);
        assert_eq!(stopped.code, 75, "{}", stopped.text);
        export(&of("first/checkpoint.h5"), &[], &of("first.data"));
        let saved = Saved::read(&Solo, &of("first/checkpoint.h5")).expect("a checkpoint");
        Self {
            folder,
            scene,
            saved,
        }
    }

    fn at(&self, name: &str) -> std::path::PathBuf {
        self.folder.path().join(name)
    }

    /// The scene with the packing in place of inserted grains.
    fn of_packing(&self) -> String {
        let mut scene = self.scene.clone();
        let sample = scene.find("sample = {").expect("a sample");
        let end = sample + scene[sample..].find('}').expect("its end");
        let kept = scene[sample..end]
            .trim_start_matches("sample = {")
            .to_string();
        let kept = kept.split(',').map(str::trim).filter(|item| {
            let name = item.split(['=', ' ']).next().unwrap_or_default();
            !item.is_empty() && !INSERTED.contains(&name)
        });
        // A checkpoint knows how fast its images move, a data file does not.
        let packing = if scene.contains("'periodic'") {
            "packing = 'first/checkpoint.h5'"
        } else {
            "packing = 'first.data'"
        };
        let own = [packing, "contacts = 'first-contacts.csv'"];
        let items: Vec<&str> = own.into_iter().chain(kept).collect();
        scene.replace_range(
            sample..=end,
            &format!("sample = {{ {} }}", items.join(", ")),
        );
        scene
    }

    /// Runs the packing into the folder `again`.
    fn again(&self, ranks: usize, name: &str, sets: &[&str]) -> Outcome {
        std::fs::write(self.at("again.toml"), self.of_packing()).expect("a scene");
        let mut arguments = vec![self.at("again.toml").display().to_string()];
        arguments.extend(sets.iter().map(ToString::to_string));
        gshear_mpi(ranks, &self.at(name), &arguments)
    }
}

/// `gshear-reduce export --contacts`.
fn export(run: &Path, arguments: &[&str], out: &Path) {
    let mut command = reducer();
    command.args(["export", "--format=lammps-data", "--contacts", "--out"]);
    succeed(command.arg(out).args(arguments).arg(run));
}

/// Histories that decide what follows, by their pairs; k_t of the last step, which disks of
/// lee-hurley have besides, follows from the overlap.
fn histories(contacts: &[ContactState], is_planar: bool) -> Vec<(u32, u32, Vec<u64>)> {
    let mut all: Vec<_> = contacts
        .iter()
        .map(|c| {
            let [a, b, rest] = c.history;
            let numbers = if is_planar {
                vec![a, rest]
            } else {
                vec![a, b, rest]
            };
            let numbers = numbers.into_iter().chain(c.torques).chain([c.age]);
            (c.i, c.j, numbers.map(f64::to_bits).collect())
        })
        .collect();
    all.sort();
    all
}

fn places(grains: &[GrainState]) -> Vec<(u32, [u64; 3])> {
    let place = |g: &GrainState| (g.id, g.position.map(f64::to_bits));
    grains.iter().map(place).collect()
}

/// Positions, velocities and histories are those of the checkpoint, and the run does not depend on
/// ranks, on who has written its scene, or on whether the files are still there when it goes on.
fn comes_back(scene: &str, contact: &str, walls: &str) {
    let scene = scene.replace(", LATER", walls) + contact;
    let exported = Exported::new(scene, "400");
    let outcome = exported.again(
        1,
        "again",
        &["--stop-at=1", "--set=output.frame_strain=1e-9"],
    );
    assert_eq!(outcome.code, 75, "{}", outcome.text);
    let run = RunFile::open(&exported.at("again")).expect("a run");
    let first = run.records(0..1).expect("a frame").swap_remove(0);
    let state = &exported.saved.state;
    assert!(state.contacts.len() > 200);
    let is_planar = run.dimension().axes() == 2;
    for (now, before) in first.grains.iter().zip(&state.grains) {
        assert_eq!(now.position, before.position);
        if before.body == body::FREE {
            assert_eq!(now.velocity, before.velocity);
            assert_eq!(now.angular_velocity, before.angular_velocity);
        }
    }
    let mut found = Vec::new();
    let grains = first.grains.len() as u32;
    for c in &first.contacts {
        let history = if is_planar {
            [c.tangential_history[0], 0.0, c.rolling_history]
        } else {
            c.tangential_history
        };
        found.push(ContactState {
            torques: c.torques,
            age: c.age,
            ..ContactState::new(c.i, c.j, history)
        });
    }
    let expected: Vec<_> = (state.contacts.iter())
        .filter(|c| c.j < grains)
        .copied()
        .collect();
    assert_eq!(
        histories(&found, is_planar),
        histories(&expected, is_planar)
    );
    let is_loaded = |c: &&ContactState| c.history[0] != 0.0;
    assert!(expected.iter().filter(is_loaded).count() > 100);

    let digest = exported.again(1, "one", &[]).digest();
    for ranks in [2, 3] {
        let name = format!("on-{ranks}");
        assert_eq!(exported.again(ranks, &name, &[]).digest(), digest);
    }
    // A scene that was written, and a checkpoint without the files.
    let written = exported.at("one/scene.toml").display().to_string();
    assert_eq!(
        gshear_mpi(1, &exported.at("written"), &[written]).digest(),
        digest
    );
    let stopped = exported.again(2, "broken", &["--stop-at=50"]);
    assert_eq!(stopped.code, 75, "{}", stopped.text);
    for name in ["first", "first.data", "first-contacts.csv"] {
        std::fs::rename(exported.at(name), exported.at(&format!("away-{name}"))).expect("renamed");
    }
    let resume = format!("--resume={}", exported.at("broken").display());
    assert_eq!(
        gshear_mpi(1, &exported.at("broken"), &[resume]).digest(),
        digest
    );
}

#[test]
fn contacts_of_disks_come_back() {
    let hooke = "contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.3, rolling_friction = 0.05, restitution = 0.5 }";
    comes_back(DISKS, hooke, "");
    let lee_hurley = "
        material.young_modulus = 1e8
        material.poisson_ratio = 0.3
        contact = { friction = 0.4, rolling_friction = 0.1, damping_ratio = 0.1 }
    ";
    comes_back(DISKS, lee_hurley, ", boundary = 'periodic'");
}

#[test]
fn contacts_of_spheres_come_back() {
    let rolling = "rolling_friction = 0.05, rolling_stiffness = 1e4, twisting_friction = 0.02";
    let hooke = format!(
        "contact = {{ law = 'hooke', normal_stiffness = 1e5, tangential_stiffness = 5e4, friction = 0.3, restitution = 0.5, {rolling} }}"
    );
    comes_back(SPHERES, &hooke, "");
    // Its history is a displacement, and it has an age.
    let ageing = "ageing = 0.1, ageing_time = 1e-5, ageing_slip = 1e-6";
    let hertz = format!(
        "
        material.young_modulus = 1e8
        material.poisson_ratio = 0.3
        contact = {{ law = 'hertz', friction = 0.3, normal_damping = 1e6, {rolling}, {ageing} }}
        "
    );
    comes_back(SPHERES, &hertz, ", walls = 'flat'");
    let mindlin = "contact = { law = 'mindlin', normal_stiffness = 1e5, friction = 0.3 }";
    comes_back(SPHERES, mindlin, ", boundary = 'periodic'");
}

/// Where no damper acts, forces follow from places and histories: the first steps of the packing
/// are those of the run that was exported, of spheres but for the rounding of a spring that is
/// turned into its plane once more.
fn goes_on(scene: &str, contact: &str, step: &str) {
    let scene = scene.replace(", LATER", "").replace(
        "load = { pressure = 1e3 }",
        "load = { pressure = 1e3, control = 'volume' }",
    );
    let scene = format!("{scene}{contact}\n    time = {{ step = {step} }}\n");
    let exported = Exported::new(scene, "3000");
    let end = |step: u64| format!("--stop-at={step}");
    let steps = 200;
    let resume = format!("--resume={}", exported.at("first/checkpoint.h5").display());
    let after = gshear_mpi(1, &exported.at("first"), &[resume, end(3000 + steps)]);
    assert_eq!(after.code, 75, "{}", after.text);
    let again = exported.again(2, "again", &[&end(steps)]);
    assert_eq!(again.code, 75, "{}", again.text);
    let [expected, found] = ["first", "again"].map(|name| {
        Saved::read(&Solo, &exported.at(name).join("checkpoint.h5")).expect("a checkpoint")
    });
    let begin = &exported.saved.state;
    let is_planar = scene_is_planar(&exported.scene);
    if is_planar {
        assert_eq!(places(&found.state.grains), places(&expected.state.grains));
        let [expected, found] =
            [&expected, &found].map(|saved| histories(&saved.state.contacts, is_planar));
        assert_eq!(found, expected);
        assert_ne!(found, histories(&begin.contacts, is_planar));
    }
    // Apart by rounding, over the way.
    let apart = |one: &[GrainState], other: &[GrainState]| {
        let pairs = one.iter().zip(other);
        let pairs = pairs.filter(|(one, other)| one.image == other.image);
        let apart = pairs.flat_map(|(one, other)| {
            [0, 1, 2].map(|axis| (one.position[axis] - other.position[axis]).abs())
        });
        apart.fold(0.0, f64::max)
    };
    let way = apart(&begin.grains, &expected.state.grains);
    let error = apart(&found.state.grains, &expected.state.grains);
    assert!(way > 1e-6 && error < 1e-9 * way, "{error} of {way}");
}

fn scene_is_planar(scene: &str) -> bool {
    !scene.contains("dimension = 3")
}

#[test]
fn undamped_packings_go_on() {
    let disks = "contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.4, rolling_friction = 0.05, damping_ratio = 0.0 }";
    goes_on(DISKS, disks, "3e-6");
    let spheres = "contact = { law = 'hooke', normal_stiffness = 1e5, tangential_stiffness = 5e4, friction = 0.4, damping_ratio = 0.0 }";
    goes_on(SPHERES, spheres, "5e-7");
}

/// Strain steps begin with the histories, too.
#[test]
fn a_box_begins_with_its_contacts() {
    let scene = "
        dimension = 2
        material.mass = 1.0
        contact = { law = 'mindlin', normal_stiffness = 1.0, friction = 0.4 }
        sample = { grains = 100, radius_min = 0.5, radius_max = 0.7, boundary = 'periodic', solid_fraction = 0.9 }
        relax = { tolerance = 1e-9, drag = 0.1 }
        aqs = { deformation = 'simple-shear', strain_step = 1e-4, steps = 20, frame_every = 20 }
    ";
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("first.toml"), scene).expect("a scene");
    gshear_mpi(1, &at("first"), &[at("first.toml").display().to_string()]).digest();
    export(&at("first"), &["--frame=1"], &at("last.data"));
    let stress = |name: &str, row: usize| {
        let run = RunFile::open_any(&at(name)).expect("a run");
        let series = run.series();
        let row = if row == 0 { 0 } else { series.rows() - 1 };
        series.column("shear_stress")[row]
    };
    let sample = scene.find("sample").expect("a sample");
    let end = sample + scene[sample..].find('\n').expect("its end");
    let begin = |contacts: &str, name: &str| {
        let mut again = scene.to_string();
        let own = format!("sample = {{ packing = 'last.data', boundary = 'periodic'{contacts} }}");
        again.replace_range(sample..end, &own);
        std::fs::write(at("again.toml"), again).expect("a scene");
        gshear_mpi(1, &at(name), &[at("again.toml").display().to_string()]).digest();
        stress(name, 0)
    };
    let expected = stress("first", 1);
    let [with, without] = [
        begin(", contacts = 'last-contacts.csv'", "with"),
        begin("", "without"),
    ];
    assert!(
        (with / expected - 1.0).abs() < 1e-6,
        "{with} for {expected}"
    );
    assert!((without / expected - 1.0).abs() > 1e-3, "{without}");
}

/// Each with its file and line, exit code 2, and nothing written.
#[test]
fn wrong_tables_are_refused() {
    let hooke = "contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.3, rolling_friction = 0.05, restitution = 0.5 }";
    let exported = Exported::new(DISKS.replace(", LATER", "") + hooke, "400");
    let path = exported.at("first-contacts.csv");
    let good = std::fs::read_to_string(&path).expect("a table");
    let lines: Vec<&str> = good.lines().collect();
    let cells: Vec<&str> = lines[1].split(',').collect();
    let [i, j] = [cells[0], cells[1]];
    let row = |change: &dyn Fn(&mut Vec<String>)| {
        let mut changed: Vec<String> = cells.iter().map(ToString::to_string).collect();
        change(&mut changed);
        good.replacen(lines[1], &changed.join(","), 1)
    };
    let last = lines.len() + 1;
    let twice = format!("{good}{}\n", lines[1]);
    for (text, expected) in [
        (
            String::new(),
            "is empty; give a table of contacts with the columns i and j".to_string(),
        ),
        (
            good.replacen("i,", "k,", 1),
            ":1: lacks the column i".into(),
        ),
        (
            good.replacen("tangential_history", "history", 1),
            ": lacks the column tangential_history, a history of the law hooke".into(),
        ),
        (
            good.replacen("rolling_history", "tangential_history", 1),
            ":1: has two columns \"tangential_history\"".into(),
        ),
        (
            row(&|c| c[5] = "nan".into()),
            ":2: tangential_history must be a number, found \"nan\"".into(),
        ),
        (
            row(&|c| c[5] = "inf".into()),
            ":2: tangential_history must be a number, found \"inf\"".into(),
        ),
        (
            row(&|c| c[5] = String::new()),
            ":2: tangential_history is missing".into(),
        ),
        (
            row(&|c| c[7] = "2".into()),
            ":2: sliding, rolling, twisting and idle are 0 or 1, found 2.0".into(),
        ),
        (
            row(&|c| c[1] = "9999".into()),
            ":2: there is no grain 9999 in sample.packing".into(),
        ),
        (
            row(&|c| c[1] = "-1".into()),
            ":2: j = -1 is a flat bottom wall, which the scene does not have".into(),
        ),
        (
            row(&|c| c[0] = "1.5".into()),
            ":2: i must be the id of a grain, a whole number, found \"1.5\"".into(),
        ),
        (
            row(&|c| c.swap(0, 1)),
            format!(":2: i must be less than j, found {j} and {i}"),
        ),
        (
            row(&|c| c[1] = "219".into()),
            format!(":2: {i} and 219 do not touch"),
        ),
        (
            row(&|c| c.truncate(4)),
            ":2: 4 columns, but the first line names 11".into(),
        ),
        (
            twice,
            format!(":{last}: the contact of {i} and {j} was on line 2 already"),
        ),
    ] {
        std::fs::write(&path, text).expect("written");
        let refused = exported.again(1, "refused", &[]);
        assert_eq!(refused.code, 2, "{expected}: {}", refused.text);
        let said = refused.text.replace('\n', " ");
        assert!(
            said.contains("first-contacts.csv") && said.contains(&expected),
            "{expected}: {said}"
        );
        assert_eq!(said.matches("error: ").count(), 1);
        assert!(!exported.at("refused").exists());
    }
    // A table of another law, and what does not go together.
    std::fs::write(
        &path,
        good.replacen("tangential_history", "tangential_displacement_x", 1),
    )
    .expect("written");
    let refused = exported.again(1, "refused", &[]);
    assert!(
        refused.code == 2 && refused.text.contains("displacements of tangential springs"),
        "{}",
        refused.text
    );
    std::fs::write(&path, &good).expect("written");
    for (set, expected) in [
        ("--set=pack.skip=false", "compresses them first"),
        ("--set=sample.replicate=[2]", "sample.replicate makes some"),
    ] {
        let refused = exported.again(1, "refused", &[set]);
        assert!(
            refused.code == 2 && refused.text.contains(expected),
            "{}",
            refused.text
        );
        assert!(!exported.at("refused").exists());
    }
    // Beyond friction, and without a line: warnings.
    let strong = row(&|c| {
        c[5] = "1e3".into();
        c[7] = "0".into();
    });
    let fewer = strong.replacen(&format!("{}\n", lines[3]), "", 1);
    std::fs::write(&path, fewer).expect("written");
    let warned = exported.again(1, "warned", &["--stop-at=1"]);
    assert_eq!(warned.code, 75, "{}", warned.text);
    let said = warned.text.replace('\n', " ");
    for words in [
        "tangential springs of 1 of ",
        "have more than friction allows",
        "1 pairs of grains touch that are not in the table",
    ] {
        assert!(said.contains(words), "{said}");
    }
}
