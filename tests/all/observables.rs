//! Columns that a scene declares, through the real programs: the numbers are those of the frames of
//! the same steps, computed here from positions, velocities and contacts; the contracts hold; and
//! which columns `log.csv` has.

use std::path::{Path, PathBuf};

use crate::common::crossing::{PACKED, SCENE};
use crate::common::{Outcome, gshear_mpi, program, reducer, same_run, succeed};
use gshear_dem::state::{ContactSample, Frame};
use gshear_scene::{PlaneShear, Scene, Source};
use gshear_store::run_reader::RunFile;

/// Declarations of observables; `{up}` is the last axis.
const OBSERVABLES: &str = r#"
[[observable]]
name = "middle"
quantity = "v_x"
y = [0.2, 0.7]
x = [0.25, 1.0]

[[observable]]
name = "layer"
quantity = "v_{up}"
{up} = [0.3, 0.6]
reduce = "sum"

[[observable]]
name = "fastest"
quantity = "speed"
reduce = "max"
unit = "m/s"

[[observable]]
name = "slowest"
quantity = "v_x"
reduce = "min"
grains = "all"

[[observable]]
name = "energy"
quantity = "kinetic_energy"
reduce = "sum"

[[observable]]
name = "contacts"
quantity = "coordination"

[[observable]]
name = "at_top"
reduce = "count"
condition = "top_contacts > 0"

[[observable]]
name = "pressed"
quantity = "normal_force"
reduce = "sum"
{up} = [-0.1, 0.5]

[[observable]]
name = "mobile"
quantity = "0.5*mass*speed^2"
reduce = "sum"
condition = "coordination >= 3 && radius > 0 && !(material == 2)"

[[observable]]
name = "nothing"
quantity = "spin"
radius = [0, 0]

[[observable]]
name = "sigma"
plane = 0.5

[[observable]]
name = "tau"
plane = 0.5
component = "shear"

[[observable]]
name = "below_top"
plane = 0.9999999

[[observable]]
name = "drawn_back"
plane = 0.9999999
component = "shear"

[[observable]]
name = "excess"
expression = "tau / sigma - 0.3*stress_ratio"

[[observable]]
name = "square"
expression = "max(excess, -excess)^2 + time"
"#;

/// A scene with observables, and its further keys.
struct Case {
    name: &'static str,
    /// The path of a base, or a whole scene.
    base: &'static str,
    /// Keys by which it begins with its sample.
    sample: &'static [&'static str],
    set: &'static [&'static str],
    axes: usize,
}

const SPHERES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing-3d.toml");

/// The disks of the crossing scene, from a packing: seconds.
const DISKS: Case = Case {
    name: "disks",
    base: SCENE,
    sample: &PACKED,
    set: &["shear.strain=0.3", "output.frame_strain=0.05"],
    axes: 2,
};

const CASES: [Case; 4] = [
    DISKS,
    Case {
        name: "spheres",
        base: SPHERES,
        sample: &[],
        set: &["sample.walls=flat", "output.frame_rows=4"],
        axes: 3,
    },
    Case {
        name: "cell",
        base: SPHERES,
        sample: &[],
        set: &[
            "sample.boundary=periodic",
            "load.gravity=none",
            "output.frame_rows=4",
        ],
        axes: 3,
    },
    Case {
        name: "slope",
        base: "
            material.density = 2500
            contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.5, damping_ratio = 0.1 }
            sample = { grains = 200, radius_min = 0.8e-3, radius_max = 1.2e-3, length = 20e-3, boundary = 'free' }
            load = { gravity = 9.81, incline = 26 }
            pack.tolerance = 1e-4
            shear.protocol = [{ time = 0.02 }]
            output = { series_rows = 50, frame_rows = 5 }
        ",
        sample: &[],
        set: &[],
        axes: 2,
    },
];

impl Case {
    /// Writes the scene with these observables.
    fn write(&self, folder: &Path, observables: &str) -> PathBuf {
        let up = if self.axes == 2 { "y" } else { "z" };
        let base = if Path::new(self.base).is_file() {
            format!("extends = {:?}", self.base)
        } else {
            self.base.into()
        };
        let path = folder.join(format!("{}.toml", self.name));
        let text = format!("{base}\n{}", observables.replace("{up}", up));
        std::fs::write(&path, text).expect("a scene");
        path
    }

    fn arguments(&self, scene: &Path, further: &[&str]) -> Vec<String> {
        let mut arguments = vec![scene.display().to_string()];
        let set = self.sample.iter().chain(self.set);
        arguments.extend(set.map(|set| format!("--set={set}")));
        arguments.extend(further.iter().map(ToString::to_string));
        arguments
    }

    fn run(&self, folder: &Path, observables: &str, ranks: usize, further: &[&str]) -> Outcome {
        let scene = self.write(folder.parent().expect("a folder"), observables);
        gshear_mpi(ranks, folder, &self.arguments(&scene, further))
    }
}

fn open(folder: &Path) -> RunFile {
    RunFile::open(folder).expect("a run")
}

/// Steps and all columns as bits.
fn rows(folder: &Path) -> (Vec<u64>, Vec<(String, Vec<u64>)>) {
    let run = open(folder);
    let series = run.series();
    let columns = series.declared.iter().zip(&series.columns);
    let columns = columns.map(|(column, values)| {
        let bits = values.iter().map(|x| x.to_bits()).collect();
        (column.name.to_string(), bits)
    });
    (series.step.clone(), columns.collect())
}

/// The exact sum, rounded once: Shewchuk's partial sums, as `math.fsum` of Python has them, and for
/// the last digit the sign of what is left.
fn exact_sum(terms: impl Iterator<Item = f64>) -> f64 {
    let mut partials: Vec<f64> = Vec::new();
    for mut x in terms {
        let mut kept = 0;
        for k in 0..partials.len() {
            let mut y = partials[k];
            if x.abs() < y.abs() {
                std::mem::swap(&mut x, &mut y);
            }
            let high = x + y;
            let low = y - (high - x);
            if low != 0.0 {
                partials[kept] = low;
                kept += 1;
            }
            x = high;
        }
        partials.truncate(kept);
        partials.push(x);
    }
    let Some(mut high) = partials.pop() else {
        return 0.0;
    };
    while let Some(next) = partials.pop() {
        let x = high;
        high = x + next;
        let low = next - (high - x);
        if low == 0.0 {
            continue;
        }
        // Halfway between two numbers, what follows decides.
        let decides = partials.last().copied().unwrap_or(0.0);
        if (low < 0.0 && decides < 0.0) || (low > 0.0 && decides > 0.0) {
            let twice = 2.0 * low;
            if twice == (high + twice) - high {
                high += twice;
            }
        }
        break;
    }
    high
}

/// A grain of a frame, and what follows from its contacts.
struct Seen {
    body: u8,
    radius: f64,
    mass: f64,
    position: [f64; 3],
    velocity: [f64; 3],
    spin: [f64; 3],
    coordination: u32,
    normal_force: f64,
    top_contacts: u32,
}

/// A frame, and the row of the same step.
struct Reference<'a> {
    frame: &'a Frame,
    grains: Vec<Seen>,
    lengths: [f64; 3],
    bottom: f64,
}

impl Reference<'_> {
    fn axes(&self) -> usize {
        self.frame.dimension.axes()
    }

    fn up(&self) -> usize {
        self.axes() - 1
    }

    /// The place along an axis over the length.
    fn place(&self, grain: &Seen, axis: usize) -> f64 {
        let origin = if axis == self.up() { self.bottom } else { 0.0 };
        (grain.position[axis] - origin) / self.lengths[axis]
    }

    fn free(&self) -> impl Iterator<Item = &Seen> {
        self.grains.iter().filter(|grain| grain.body == 0)
    }

    fn energy(&self, grain: &Seen) -> f64 {
        let inertia = [0.5, 0.4][self.axes() - 2] * grain.mass * grain.radius * grain.radius;
        0.5 * (grain.mass * square(grain.velocity) + inertia * square(grain.spin))
    }

    /// The separation of i from j of a contact, and the force on i.
    fn contact(&self, contact: &ContactSample) -> ([f64; 3], [f64; 3]) {
        let grain = &self.grains[contact.i as usize];
        let separation = match self.frame.wall_normal(contact) {
            Some(normal) => normal.map(|n| n * (grain.radius - contact.overlap)),
            None => self.frame.separation(contact.j, contact.i),
        };
        let length = square(separation).sqrt();
        let n = separation.map(|r| r / length);
        let [t, normal] = [contact.tangential_force[0], contact.normal_force];
        let force = if self.axes() == 2 {
            [normal * n[0] - t * n[1], normal * n[1] + t * n[0], 0.0]
        } else {
            std::array::from_fn(|k| contact.normal_force * n[k] + contact.tangential_force[k])
        };
        (separation, force)
    }

    /// Stress on a plane at this part of the height, and the sum of magnitudes over its area.
    fn stress(&self, place: f64) -> ([f64; 2], f64) {
        let (up, h) = (self.up(), self.lengths[self.up()]);
        let mut terms: [Vec<f64>; 2] = Default::default();
        for contact in self.frame.contacts.iter().chain(&self.frame.wall_contacts) {
            let (separation, force) = self.contact(contact);
            let z = self.grains[contact.i as usize].position[up] - self.bottom;
            for image in [-1.0, 0.0, 1.0] {
                let plane = (place + image) * h;
                if self.frame.cell.sheared.is_none() && image != 0.0 {
                    continue;
                }
                if (z < plane) == (z - separation[up] < plane) {
                    continue;
                }
                let sign = if z < plane { -1.0 } else { 1.0 };
                terms[0].push(sign * force[up]);
                terms[1].push(-sign * force[0]);
            }
        }
        let area: f64 = self.lengths[..up].iter().product();
        let size: f64 = terms.iter().flatten().map(|x| x.abs()).sum();
        (
            terms.map(|terms| exact_sum(terms.into_iter()) / area),
            size / area,
        )
    }
}

fn square(v: [f64; 3]) -> f64 {
    v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.collect();
    exact_sum(values.iter().copied()) / values.len() as f64
}

/// The scene of a run, and its shear.
fn scene_of(run: &RunFile) -> Scene {
    gshear_scene::load(&Source::new("scene.toml", run.scene()), &[]).expect("a scene")
}

fn thickness_of_bottom(scene: &Scene, shear: &PlaneShear) -> f64 {
    if shear.boundary.bodies().next() == Some(1) {
        shear.wall_thickness(&scene.sample)
    } else {
        0.0
    }
}

fn reference<'a>(run: &RunFile, frame: &'a Frame, row: usize) -> Reference<'a> {
    let constants = run.grains();
    let scene = scene_of(run);
    let shear = scene.plane_shear("scene.toml").expect("a shear");
    let series = run.series();
    let column = |name: &str| series.column(name)[row];
    let (h, axes) = (column("wall_height"), frame.dimension.axes());
    let mut lengths = [1.0; 3];
    lengths[..axes - 1].copy_from_slice(&run.periods()[..axes - 1]);
    lengths[axes - 1] = h;
    let is_periodic = run.boundary().is_periodic();
    let mut bottom = 0.0;
    if !is_periodic {
        bottom = shear.floor() + thickness_of_bottom(&scene, shear);
        if series.has("bottom_displacement") {
            bottom += column("bottom_displacement");
        }
    }
    let mut grains: Vec<Seen> = (frame.grains.iter().enumerate())
        .map(|(g, grain)| Seen {
            body: constants.body[g],
            radius: constants.radius[g],
            mass: constants.mass[g],
            position: grain.position,
            velocity: grain.velocity,
            spin: grain.angular_velocity,
            coordination: 0,
            normal_force: 0.0,
            top_contacts: 0,
        })
        .collect();
    let walls: Vec<u8> = constants.body.clone();
    for contact in frame.contacts.iter().chain(&frame.wall_contacts) {
        let top = |other: u32| match walls.get(other as usize) {
            Some(body) => *body == 2,
            None => other as usize == walls.len() + 1,
        };
        let ends = [(contact.i, contact.j), (contact.j, contact.i)];
        for (one, other) in ends {
            let Some(grain) = grains.get_mut(one as usize) else {
                continue;
            };
            grain.coordination += 1;
            grain.normal_force += contact.normal_force;
            grain.top_contacts += u32::from(top(other));
        }
    }
    Reference {
        frame,
        grains,
        lengths,
        bottom,
    }
}

fn near(name: &str, found: f64, expected: f64, size: f64) {
    assert!(
        (found - expected).abs() <= 1e-12 * size,
        "{name}: {found:e}, expected {expected:e}"
    );
}

/// Compares a row with its frame.
fn compare(case: &Case, run: &RunFile, seen: &Reference<'_>, row: usize) {
    let series = run.series();
    let value = |name: &str| series.column(name)[row];
    let same = |name: &str, expected: f64| {
        let found = value(name);
        let label = format!("{}, row {row}: {name}", case.name);
        assert_eq!(
            found.to_bits(),
            (expected + 0.0).to_bits(),
            "{label}: {found:e}, {expected:e}"
        );
    };
    let up = seen.up();
    let within = |grain: &Seen, axis: usize, from: f64, to: f64| {
        let s = seen.place(grain, axis);
        from <= s && s < to
    };
    let middle = seen
        .free()
        .filter(|g| within(g, 1, 0.2, 0.7) && within(g, 0, 0.25, 1.0));
    same("middle", mean(middle.map(|g| g.velocity[0])));
    let layer = seen.free().filter(|g| within(g, up, 0.3, 0.6));
    same("layer", exact_sum(layer.map(|g| g.velocity[up])));
    let speed = |g: &Seen| square(g.velocity).sqrt();
    same("fastest", seen.free().map(speed).fold(0.0, f64::max));
    let slowest = seen.grains.iter().map(|g| g.velocity[0]);
    same("slowest", slowest.fold(f64::INFINITY, f64::min));
    // The same as the column of the program, which rounds each term.
    near(
        "energy",
        value("energy"),
        value("kinetic_energy"),
        value("kinetic_energy"),
    );
    // In a cell without walls it is that of the velocities less the streaming.
    if !run.boundary().is_periodic() {
        let energy = exact_sum(seen.free().map(|g| seen.energy(g)));
        near("energy", value("energy"), energy, energy);
    }
    same(
        "contacts",
        mean(seen.free().map(|g| f64::from(g.coordination))),
    );
    same("contacts", value("coordination"));
    same(
        "at_top",
        seen.free().filter(|g| g.top_contacts > 0).count() as f64,
    );
    // Forces are rounded before they are added to a grain.
    let pressed: f64 = seen
        .free()
        .filter(|g| within(g, up, -0.1, 0.5))
        .map(|g| g.normal_force)
        .sum();
    near("pressed", value("pressed"), pressed, pressed.abs());
    let mobile = seen.free().filter(|g| g.coordination >= 3);
    same(
        "mobile",
        exact_sum(mobile.map(|g| {
            let v = speed(g);
            0.5 * g.mass * (v * v)
        })),
    );
    assert!(value("nothing").is_nan());

    let ([sigma, tau], size) = seen.stress(0.5);
    near("sigma", value("sigma"), sigma, size);
    near("tau", value("tau"), tau, size);
    // Right below the top, which all that the plane cuts presses on.
    if run.boundary().has_walls() && run.boundary().has_top() {
        let area: f64 = seen.lengths[..up].iter().product();
        let [normal, shear] = ["normal_force", "shear_force"].map(|name| value(name) / area);
        near("below_top", value("below_top"), normal, size);
        near("drawn_back", value("drawn_back"), shear, size);
    }
    let excess = value("tau") / value("sigma") - 0.3 * value("stress_ratio");
    same("excess", excess);
    same("square", excess.abs() * excess.abs() + series.time[row]);
}

/// Values are those of frames, on 1, 2 and 3 ranks and several threads; the digest is that without
/// observables, and the other columns are the same.
#[test]
fn observables_are_those_of_frames() {
    let temporary = tempfile::tempdir().expect("a folder");
    for case in &CASES {
        let folder = |name: &str| temporary.path().join(format!("{}-{name}", case.name));
        let without = case.run(&folder("without"), "", 1, &[]).digest();
        let one = folder("one");
        assert_eq!(case.run(&one, OBSERVABLES, 1, &[]).digest(), without);
        let run = open(&one);
        let steps = &run.series().step;
        let mut compared = 0;
        for t in 0..run.frames() {
            let frame = run.records(t..t + 1).expect("a frame").remove(0);
            let Ok(row) = steps.binary_search(&frame.step) else {
                continue;
            };
            compare(case, &run, &reference(&run, &frame, row), row);
            compared += 1;
        }
        assert!(compared > 3, "{}: {compared} frames", case.name);
        let has_top_wall = run.boundary().has_walls() && run.boundary().has_top();
        let touches = run.series().column("at_top").iter().any(|n| *n > 0.0);
        assert_eq!(touches, has_top_wall, "{}", case.name);

        let all = rows(&one);
        let plain = rows(&folder("without"));
        assert_eq!(all.0, plain.0);
        assert_eq!(all.1[..plain.1.len()], plain.1[..]);
        for (ranks, threads) in [(2, "1"), (3, "1"), (1, "3")] {
            let other = folder(&format!("{ranks}-{threads}"));
            let outcome = case.run(&other, OBSERVABLES, ranks, &["--threads", threads]);
            assert_eq!(outcome.digest(), without);
            assert_eq!(
                rows(&other),
                all,
                "{}: {ranks} ranks, {threads} threads",
                case.name
            );
        }
    }
}

/// Stopped and resumed on other ranks the files are those of a run that was not stopped.
#[test]
fn a_resumed_run_has_the_same_rows() {
    let temporary = tempfile::tempdir().expect("a folder");
    let [unbroken, broken] = ["unbroken", "broken"].map(|name| temporary.path().join(name));
    let columns = "--set=output.columns=[\"tau\", \"strain\", \"excess\"]";
    let digest = DISKS.run(&unbroken, OBSERVABLES, 1, &[columns]).digest();
    let step = open(&unbroken).series().step[20];
    let stop = format!("--stop-at={}", step + 7);
    assert_eq!(
        DISKS.run(&broken, OBSERVABLES, 2, &[columns, &stop]).code,
        75
    );
    let checkpoint = format!("--resume={}", broken.join("checkpoint.h5").display());
    assert_eq!(gshear_mpi(3, &broken, &[checkpoint]).digest(), digest);
    assert_eq!(rows(&broken), rows(&unbroken));
    same_run(&unbroken, &broken);
    let text = |folder: &Path| std::fs::read_to_string(folder.join("log.csv")).expect("a log");
    assert_eq!(text(&broken), text(&unbroken));
}

/// A file keeps the observables with which it began; another folder takes others.
#[test]
fn other_observables_begin_a_file() {
    const ONE: &str = "
        [[observable]]
        name = 'fastest'
        quantity = 'speed'
        reduce = 'max'
    ";
    let temporary = tempfile::tempdir().expect("a folder");
    let run = temporary.path().join("run");
    let stopped = DISKS.run(&run, ONE, 1, &["--stop-at=800"]);
    assert_eq!(stopped.code, 75, "{}", stopped.text);
    let resume = format!("--resume={}", run.join("checkpoint.h5").display());
    let before = std::fs::read(run.join("run.h5")).expect("bytes");
    let fastest =
        |more: &str| format!("{{ name = 'fastest', quantity = 'speed', reduce = 'max'{more} }}");
    for (observables, said) in [
        (
            String::from("[]"),
            "its observables are fastest, and those of this run none",
        ),
        (
            format!("[{}, {{ name = 'more', reduce = 'count' }}]", fastest("")),
            "its observables are fastest, and those of this run fastest, more",
        ),
        (
            format!("[{}]", fastest(", grains = 'all'")),
            "its observable fastest is quantity = \"speed\", reduce = \"max\" (unit m s-1), and that of this run quantity = \"speed\", reduce = \"max\", grains = \"all\" (unit m s-1)",
        ),
    ] {
        let set = format!("--set=observable={observables}");
        let refused = gshear_mpi(1, &run, &[resume.clone(), set.clone()]);
        assert_eq!(refused.code, 2, "{}", refused.text);
        for part in [said, "[[observable]] begins with a file", "(--out)"] {
            assert!(refused.text.contains(part), "{}", refused.text);
        }
        assert_eq!(std::fs::read(run.join("run.h5")).expect("bytes"), before);
        let other = temporary
            .path()
            .join(format!("other-{}", observables.len()));
        gshear_mpi(1, &other, &[resume.clone(), set]).digest();
        let is_there = open(&other).series().has("fastest");
        assert_eq!(is_there, observables != "[]");
    }
    let columns = "--set=output.columns=[\"strain\"]".to_string();
    let refused = gshear_mpi(1, &run, &[resume, columns]);
    assert_eq!(refused.code, 2, "{}", refused.text);
    assert!(
        refused
            .text
            .contains("output.columns or [[observable]] has changed"),
        "{}",
        refused.text
    );
}

/// `log.csv` has the columns that are chosen, in that order; `run.h5` all; reports, `watch`,
/// `info` and exports read both.
#[test]
fn chosen_columns_are_those_of_the_log() {
    let temporary = tempfile::tempdir().expect("a folder");
    let folder = temporary.path().join("run");
    let columns = "--set=output.columns=[\"fastest\", \"shear_force\", \"strain\"]";
    DISKS.run(&folder, OBSERVABLES, 1, &[columns]).digest();
    let run = open(&folder);
    let log = std::fs::read_to_string(folder.join("log.csv")).expect("a log");
    let mut lines = log.lines();
    assert_eq!(lines.next(), Some("step,time,fastest,shear_force,strain"));
    for (row, line) in lines.enumerate() {
        let cells: Vec<f64> = line
            .split(',')
            .map(|cell| cell.parse().expect("a number"))
            .collect();
        let series = run.series();
        let mut expected = vec![series.step[row] as f64, series.time[row]];
        expected.extend(["fastest", "shear_force", "strain"].map(|name| series.column(name)[row]));
        assert_eq!(cells, expected);
    }
    let metadata = std::fs::read_to_string(folder.join("log.csv-metadata.json")).expect("metadata");
    for part in ["\"fastest\"", "\"m/s\"", "quantity = \\\"speed\\\""] {
        assert!(metadata.contains(part), "{metadata}");
    }
    let said = |command: &[&str]| {
        let mut reducer = reducer();
        reducer.args(command).arg(&folder);
        String::from_utf8(succeed(&mut reducer).stdout).expect("text")
    };
    assert!(said(&["info"]).contains("excess, square"));
    succeed(reducer().arg("report").arg(&folder));
    let page = std::fs::read_to_string(folder.join("report/index.html")).expect("a page");
    for part in ["observable-excess", "expression = ", "series.csv"] {
        assert!(page.contains(part), "{part}");
    }
    let series = std::fs::read_to_string(folder.join("report/series.csv")).expect("a table");
    assert!(
        series
            .lines()
            .next()
            .is_some_and(|head| head.ends_with("excess,square"))
    );
    assert!(folder.join("report/series.csv-metadata.json").is_file());
    succeed(reducer().arg("watch").arg(&folder));
    let plain = temporary.path().join("plain");
    DISKS.run(&plain, "", 1, &[]).digest();
    let compared = succeed(reducer().arg("compare").arg(&folder).arg(&plain)).stdout;
    let compared = String::from_utf8(compared).expect("text");
    assert!(compared.contains("column excess: only in"), "{compared}");
    // A check says how large the files are, and writes nothing.
    let scene = temporary.path().join("disks.toml");
    succeed(program(1).args(DISKS.arguments(&scene, &["--check"])));
}
