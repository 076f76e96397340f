//! Whole runs of the program: soft and stiff samples, large ratios of sizes, and rates and overlaps
//! that are too great.

use std::path::Path;

use gshear_dem::domain::Solo;
use gshear_dem::state::{GrainState, body, nearest_image};
use gshear_store::checkpoint;
use gshear_store::run_reader::RunFile;

use super::table::{Line, line};
use crate::common::{Outcome, datasets, gshear_mpi};

/// 220 disks, I = 0.1, κ = 1e3.
const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing.toml");

/// Runs the scene with these values on one rank.
fn run(folder: &Path, set: &[String]) -> Outcome {
    let set = set.iter().map(|s| format!("--set={s}"));
    let arguments: Vec<_> = std::iter::once(SCENE.into()).chain(set).collect();
    gshear_mpi(1, folder, &arguments)
}

fn sets(values: &[&str]) -> Vec<String> {
    values.iter().map(ToString::to_string).collect()
}

/// The one line of a failure.
fn message(outcome: &Outcome) -> String {
    // Where the last sound state is, is another folder each time.
    let said: Vec<_> = outcome
        .text
        .lines()
        .filter_map(|l| {
            l.strip_prefix("error: ")?
                .split("; the last sound state")
                .next()
        })
        .collect();
    said.join(" / ")
}

/// The number of values in `run.h5` and `log.csv`, and the number that are not finite. τ = S/N is
/// undefined while nothing touches the wall: then, and only then, it must be NaN.
fn numbers(folder: &Path) -> (usize, usize) {
    const RATIO: &str = "stress_ratio";
    const FORCE: &str = "normal_force";
    let file = hdf5::File::open(folder.join("run.h5")).expect("run.h5");
    let read = |name: &str| {
        let dataset = file.dataset(name).expect("a dataset");
        let real = dataset.dtype().expect("its type").is::<f64>();
        real.then(|| dataset.read_raw::<f64>().expect("f64"))
    };
    let mut all = Vec::new();
    for name in datasets(&file, "") {
        if !name.contains(RATIO) {
            all.extend(read(&name).unwrap_or_default());
        }
    }
    let column = |name: &str| read(&format!("observables/{name}/value")).expect("a column");
    let mut ratios: Vec<[f64; 2]> = (column(FORCE).into_iter().zip(column(RATIO)))
        .map(|(force, ratio)| [force, ratio])
        .collect();
    let log = std::fs::read_to_string(folder.join("log.csv")).expect("log.csv");
    let mut rows = log.lines().map(|row| row.split(',').collect::<Vec<_>>());
    let names = rows.next().expect("a header");
    let place = |name: &str| names.iter().position(|n| *n == name).expect("a column");
    let (force, ratio) = (place(FORCE), place(RATIO));
    for row in rows {
        let row: Vec<f64> = row.iter().map(|x| x.parse().expect("a number")).collect();
        ratios.push([row[force], row[ratio]]);
        all.extend((0..row.len()).filter(|&k| k != ratio).map(|k| row[k]));
    }
    let wrong = ratios.iter().filter(|[force, ratio]| {
        if *force == 0.0 {
            !ratio.is_nan()
        } else {
            !ratio.is_finite()
        }
    });
    let not_finite = all.iter().filter(|x| !x.is_finite());
    (all.len() + ratios.len(), not_finite.count() + wrong.count())
}

/// Runs the scene at κ and checks the overlaps. A force P d̄ gives the overlap d̄/κ, and by the
/// virial a contact of a packing of solid fraction φ and z contacts per grain bears on average
/// 4π⟨R²⟩P/(φ z d̄).
fn stiffness_number(kappa: f64, more: &[&str]) -> Line {
    let folder = tempfile::tempdir().expect("a folder");
    let mut values = sets(&[
        "shear.inertial_number=0.001",
        "shear.strain=0.02",
        "output.frame_strain=1e-3",
        "output.series_strain=1e-4",
    ]);
    values.push(format!("load.stiffness_number={kappa:e}"));
    values.extend(sets(more));
    let outcome = run(folder.path(), &values);
    let done = format!("plane shear of 220 disks at κ = {kappa:e}");
    let expected = "runs; no NaN; F = N on the wall; mean overlap as by the virial, to 20 %";
    if outcome.code != 0 {
        return line(done, expected, message(&outcome), false);
    }
    let (count, not_finite) = numbers(folder.path());
    let run = RunFile::open(folder.path()).expect("a run");
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let series = |name: &str| {
        let column = run.series().column(name);
        mean(&column[column.len() / 2..])
    };
    let frames = run
        .records(run.frames() / 2..run.frames())
        .expect("the frames");
    let overlaps: Vec<f64> = frames
        .iter()
        .flat_map(|f| f.contacts.iter().map(|c| c.overlap))
        .collect();
    let (a, b): (f64, f64) = (0.5e-6, 1e-6);
    let diameter = a + b;
    let squared = (a * a + a * b + b * b) / 3.0;
    let part = 4.0 * std::f64::consts::PI * squared
        / (series("solid_fraction") * series("coordination") * diameter * diameter);
    let overlap = mean(&overlaps) * kappa / diameter;
    let force = series("normal_force") / run.number("normal_force").expect("N");
    line(
        done,
        expected,
        format!(
            "{count} numbers, {not_finite} not finite; F/N = {force:.3}; mean overlap {overlap:.3} d̄/κ, virial {part:.3} d̄/κ"
        ),
        count > 10_000
            && not_finite == 0
            && (force - 1.0).abs() < 0.05
            && (overlap / part - 1.0).abs() < 0.2,
    )
}

pub fn stiffness_numbers() -> Vec<Line> {
    [1e2, 1e3, 1e4, 1e5]
        .map(|kappa| stiffness_number(kappa, &[]))
        .into()
}

/// Stiffer ones take √κ times as many steps.
pub fn great_stiffness_numbers() -> Vec<Line> {
    let patient = ["pack.max_steps=50000000"];
    [1e6, 1e7]
        .map(|kappa| stiffness_number(kappa, &patient))
        .into()
}

/// The energy residual of a run at the paper's shear rate over the work, without sliding and with
/// it. `tests/all/accuracy` tests the order of the energy budget in Δt: another Δt packs another
/// sample.
pub fn energy_budget() -> Vec<Line> {
    let bound = |done: &str, more: &[&str], slides: bool| {
        let mut values = sets(&[
            "load.stiffness_number=1e4",
            "pack.tolerance=1e-6",
            "shear.inertial_number=4e-6",
            "shear.strain=2e-5",
            "output.frame_strain=0",
            "output.series_strain=2e-6",
        ]);
        values.extend(sets(more));
        let folder = tempfile::tempdir().expect("a folder");
        let outcome = run(folder.path(), &values);
        assert_eq!(outcome.code, 0, "{}", outcome.text);
        let run = RunFile::open(folder.path()).expect("a run");
        let last = |name: &str| *run.series().column(name).last().expect("a row");
        let (left, work) = (last("energy_residual"), last("work_drive"));
        let slid = last("dissipated_friction") + last("dissipated_rolling");
        line(
            format!("220 disks at I = 4e-6 to γ = 2e-5, {done}"),
            "energy residual below 1e-6 of the work",
            format!(
                "{left:.1e}; {:.2} of the work dissipated by slip",
                slid / work.abs()
            ),
            left.abs() < 1e-6 && (slid > 0.0) == slides,
        )
    };
    vec![
        bound(
            "frictionless",
            &["contact.friction=0", "contact.rolling_friction=0"],
            false,
        ),
        bound("sliding", &[], true),
    ]
}

/// Uniform radii from 0.05 to 1 µm: the mass of the smallest disk, which limits Δt, is 1/400 of
/// that of the largest.
pub fn size_ratio() -> Vec<Line> {
    let folder = tempfile::tempdir().expect("a folder");
    let values = sets(&[
        "sample.radius_min=0.05e-6",
        "sample.grains=300",
        "load.stiffness_number=3e3",
        "shear.inertial_number=0.01",
        "shear.strain=0.05",
    ]);
    let outcome = run(folder.path(), &values);
    let done = "plane shear of 300 disks of radii 1:20";
    let expected = "runs; no NaN; F = N on the wall to 5 %";
    if outcome.code != 0 {
        return vec![line(done, expected, message(&outcome), false)];
    }
    let (count, not_finite) = numbers(folder.path());
    let run = RunFile::open(folder.path()).expect("a run");
    let radii = &run.grains().radius;
    let greatest = radii.iter().fold(0.0, |a: f64, &b| a.max(b));
    let least = radii.iter().fold(f64::MAX, |a: f64, &b| a.min(b));
    let column = run.series().column("normal_force");
    let later = &column[column.len() / 2..];
    let force =
        later.iter().sum::<f64>() / later.len() as f64 / run.number("normal_force").expect("N");
    vec![line(
        done,
        expected,
        format!(
            "radii 1:{:.1}; {count} numbers, {not_finite} not finite; F/N = {force:.3}",
            greatest / least
        ),
        count > 1000 && not_finite == 0 && (force - 1.0).abs() < 0.05,
    )]
}

/// A frictional packing has rattlers that spin: they come to rest as well.
pub fn packing_with_friction() -> Vec<Line> {
    let folder = tempfile::tempdir().expect("a folder");
    let values = sets(&[
        "pack.friction=0.5",
        "contact.rolling_friction=0.5",
        "pack.max_steps=200000",
        "shear.strain=1e-4",
    ]);
    let outcome = run(folder.path(), &values);
    let rest = outcome.text.lines().find(|l| l.contains("at rest after"));
    vec![line(
        "packing with friction, rolling resistance and spinning rattlers",
        "at rest",
        rest.map_or_else(
            || message(&outcome),
            |l| l.trim_start_matches("pack:").trim().to_string(),
        ),
        outcome.code == 0,
    )]
}

/// With strong damping the stability limit is far below √(m/k)/10; the default Δt must take this
/// into account.
pub fn strong_damping() -> Vec<Line> {
    let set = |more: &[&str]| {
        let folder = tempfile::tempdir().expect("a folder");
        let mut values = sets(&[
            "contact.damping_ratio=0.9",
            "contact.rolling_damping_ratio=0.9",
            "contact.rolling_friction=0.5",
            "pack.friction=0.5",
            "shear.inertial_number=0.01",
            "shear.strain=0.01",
        ]);
        values.extend(sets(more));
        run(folder.path(), &values)
    };
    let (default, tenth) = (set(&[]), set(&["time.step=2.78e-10", "time.force=true"]));
    vec![
        line(
            "strong damping (α = η_r = 0.9) with the default Δt",
            "runs",
            format!("exit code {}", default.code),
            default.code == 0,
        ),
        line(
            "the same with Δt = √(m/k)/10, four times the stated limit, by `time.force`",
            "fails: exit code 3",
            format!("exit code {}: {}", tenth.code, message(&tenth)),
            tenth.code == 3,
        ),
    ]
}

/// A thousand times the rate of the scene.
pub fn shear_rate() -> Vec<Line> {
    let folder = tempfile::tempdir().expect("a folder");
    let refused = run(folder.path(), &sets(&["shear.inertial_number=100.0"]));
    let why = message(&refused);
    let names = [
        "shear.inertial_number",
        "half the skin",
        "give a lower rate",
    ];
    let left = std::fs::read_dir(folder.path())
        .expect("the folder")
        .count();
    let failed = run(folder.path(), &sets(&["shear.inertial_number=5.0"]));
    let said = message(&failed);
    let (count, not_finite) = numbers(folder.path());
    let clear = ["shear, step ", ": grains ", " at (", " overlap by "];
    vec![
        line(
            "a shear rate 10³ times too high (I = 100)",
            "exit code 2, one message with the key and what to change; nothing written",
            format!("exit code {}: {why}; {left} files", refused.code),
            refused.code == 2 && names.iter().all(|part| why.contains(part)) && left == 0,
        ),
        line(
            "a shear rate 50 times too high (I = 5)",
            "exit code 3, one message with step, grains and position; no NaN in any file",
            format!(
                "exit code {}: {said}; {count} numbers, {not_finite} not finite",
                failed.code
            ),
            failed.code == 3
                && clear.iter().all(|part| said.contains(part))
                && count > 100
                && not_finite == 0,
        ),
    ]
}

/// In the checkpoint of a run, moves one of two touching grains until a/R is `part` of the greatest
/// one of the law. Then resumes the run for one step.
fn crushed(part: f64) -> (Outcome, (u32, u32)) {
    let folder = tempfile::tempdir().expect("a folder");
    let first = gshear_mpi(1, folder.path(), &[SCENE.into(), "--stop-at=10".into()]);
    assert_eq!(first.code, 75, "{}", first.text);
    let path = folder.path().join(checkpoint::NAME);
    let ([header, scene], mut snapshot) = checkpoint::read(&Solo, &path).expect("a checkpoint");
    let apart = |a: &GrainState, b: &GrainState| {
        let dx = nearest_image(a.position[0] - b.position[0], 21e-6);
        [dx, a.position[1] - b.position[1]]
    };
    // The first pair of free grains of which one can be moved without crushing a third.
    let (i, j) = snapshot
        .contacts
        .iter()
        .map(|c| (c.i as usize, c.j as usize))
        .find(|&(i, j)| {
            let grains = &snapshot.grains;
            let moved = put(&grains[i], &grains[j], apart(&grains[i], &grains[j]), part);
            [i, j].iter().all(|&g| grains[g].body == body::FREE)
                && grains.iter().enumerate().all(|(k, other)| {
                    let [dx, dy] = apart(&moved, other);
                    let overlap = moved.radius + other.radius - dx.hypot(dy);
                    k == i || k == j || overlap < 0.02 * moved.radius.min(other.radius)
                })
        })
        .expect("a pair with room");
    snapshot.grains[i] = put(
        &snapshot.grains[i],
        &snapshot.grains[j],
        apart(&snapshot.grains[i], &snapshot.grains[j]),
        part,
    );
    for g in [i, j] {
        // The grains must not move before the forces are computed.
        snapshot.grains[g].velocity = [0.0; 3];
        snapshot.grains[g].force = [0.0; 3];
    }
    checkpoint::write(&Solo, folder.path(), [&header, &scene], &snapshot).expect("written");
    let resume = format!("--resume={}", path.display());
    let outcome = gshear_mpi(1, folder.path(), &[resume, "--stop-at=11".into()]);
    (outcome, (snapshot.grains[i].id, snapshot.grains[j].id))
}

/// Moves `a` along the line of centres until a/R of the smaller grain is `part` of 0.3.
fn put(a: &GrainState, b: &GrainState, from: [f64; 2], part: f64) -> GrainState {
    let distance = (a.radius + b.radius) - overlap_at(part * 0.3, a.radius, b.radius);
    let now = from[0].hypot(from[1]);
    let mut moved = *a;
    let x = b.position[0] + from[0] * distance / now;
    moved.position = [
        x.rem_euclid(21e-6),
        b.position[1] + from[1] * distance / now,
        0.0,
    ];
    moved
}

/// δ (m) at a/R of the smaller grain: F of a² = 4FR*/(πE*) over k_n of A2, in which E* drops out.
pub fn overlap_at(ratio: f64, r1: f64, r2: f64) -> f64 {
    let a = ratio * r1.min(r2);
    a * a * (r1 + r2) / (4.0 * r1 * r2) * ((4.0 * r1 / a).ln() + (4.0 * r2 / a).ln() - 1.0)
}

/// Runs the program just below and just above the greatest overlap of the law.
pub fn end_of_the_law() -> Vec<Line> {
    let (inside, _) = crushed(1.0 - 1e-6);
    let (beyond, (i, j)) = crushed(1.0 + 1e-6);
    let said = message(&beyond);
    let names = [
        "shear, step 11: ".to_string(),
        format!("grains {} at (", i.min(j)),
        format!(" and {} at (", i.max(j)),
        "outside the contact law".into(),
    ];
    vec![
        line(
            "two grains of a run pressed together to a/R = 0.3 (1 - 1e-6)",
            "continues: exit code 75 at the next checkpoint",
            format!("exit code {}", inside.code),
            inside.code == 75,
        ),
        line(
            "the same to a/R = 0.3 (1 + 1e-6)",
            "exit code 3, one message with step, both grains and their positions",
            format!("exit code {}: {said}", beyond.code),
            beyond.code == 3 && names.iter().all(|n| said.contains(n)),
        ),
    ]
}
