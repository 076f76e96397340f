//! Scenes that shear at a rate and strain quasi-statically, in either order.

use std::path::Path;

use crate::common::{Outcome, beyond_the_digest, gshear_mpi, reducer, succeed};
use gshear_store::run_reader::{RunFile, RunStage};

/// A sample in a cell, with this key of its size.
fn scene(dimension: usize, size: &str, friction: f64, stages: &str) -> String {
    format!(
        "
        seed = 3
        dimension = {dimension}
        material.density = 1.0
        contact = {{ law = 'hooke', normal_stiffness = 1.0, friction = {friction}, damping_ratio = 0.3 }}
        sample = {{ radius_min = 0.4, radius_max = 0.6, boundary = 'periodic', {size} }}
        time.step = 0.02
        {stages}
        "
    )
}

const SHEAR: &str = "
    load.pressure = 1e-2
    shear = { velocity = 1e-2, strain = 0.02 }
    output = { frame_strain = 5e-3, series_strain = 1e-3, checkpoint_strain = 0.0 }
";
const STRAIN: &str = "
    relax = { tolerance = 1e-8, drag = 0.2 }
    aqs = { strain_step = 1e-4, steps = 3, frame_every = 1 }
";
const NEWTONIAN: &str = "
    newtonian = { growth_times = 0.1, rows = 10, frames = 2 }
";
/// Strain steps that change the cell, and then the shear.
const COMPRESSION: &str = "
    stages = ['aqs', 'shear']
    relax = { tolerance = 1e-8, drag = 0.2 }
    aqs = { deformation = 'compression', strain_step = 5e-3, pressure_tolerance = 1e-2, pressures = [1e-2], frame_every = 1 }
";

/// A scene in a folder, and the runs of it.
struct Case {
    folder: tempfile::TempDir,
    parts: &'static [&'static str],
}

impl Case {
    fn new(scene: &str, parts: &'static [&'static str]) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("scene.toml"), scene).expect("written");
        Self { folder, parts }
    }

    fn at(&self, name: &str) -> std::path::PathBuf {
        self.folder.path().join(name)
    }

    fn run(&self, name: &str, ranks: usize, more: &[&str]) -> Outcome {
        let mut arguments = vec![self.at("scene.toml").display().to_string()];
        arguments.extend(more.iter().map(ToString::to_string));
        gshear_mpi(ranks, &self.at(name), &arguments)
    }

    fn resume(&self, name: &str, ranks: usize, more: &[&str]) -> Outcome {
        let mut arguments = vec![format!("--resume={}", self.at(name).display())];
        arguments.extend(more.iter().map(ToString::to_string));
        gshear_mpi(ranks, &self.at(name), &arguments)
    }

    /// The bits of the time series of all parts.
    fn series(&self, name: &str) -> Vec<Vec<Vec<u64>>> {
        let parts = self.parts.iter();
        parts
            .map(|part| {
                let run = RunFile::open_any(&self.at(name).join(part)).expect("a part");
                assert!(run.digest().is_some(), "{part} is finished");
                let columns = run.series().columns.iter();
                columns
                    .map(|column| column.iter().map(|x| x.to_bits()).collect())
                    .collect()
            })
            .collect()
    }

    /// The digests of all parts.
    fn digests(&self, name: &str) -> Vec<String> {
        let parts = self.parts.iter();
        parts
            .map(|part| {
                let run = RunFile::open_any(&self.at(name).join(part)).expect("a part");
                run.digest().expect("a finished part").to_string()
            })
            .collect()
    }

    /// Contracts 1 to 3: ranks, output, instruction sets; stopped after each of these steps, which
    /// count those of all stages, and gone on with.
    fn keeps_the_contracts(&self, stops: &[u64]) {
        let whole = self.run("one", 1, &[]);
        assert_eq!(whole.code, 0, "{}", whole.text);
        let (expected, series) = (self.digests("one"), self.series("one"));
        let beyond = beyond_the_digest(&self.at("one"));
        let other = [
            "--set=bookkeeping.simd=portable",
            "--set=output.frame_strain=0",
            "--set=aqs.frame_every=0",
        ];
        let found = self.run("two", 2, &other);
        assert_eq!(found.code, 0, "{}", found.text);
        assert_eq!(self.digests("two"), expected);
        assert_eq!(self.series("two"), series);
        assert_eq!(beyond_the_digest(&self.at("two")), beyond);
        for (k, stop) in stops.iter().enumerate() {
            let stop = format!("--stop-at={stop}");
            let stopped = if k == 0 {
                self.run("part", 2, &[&stop])
            } else {
                self.resume("part", 1 + k % 2, &[&stop])
            };
            assert_eq!(stopped.code, 75, "{stop}: {}", stopped.text);
        }
        let done = self.resume("part", 2, &[]);
        assert_eq!(done.code, 0, "{}", done.text);
        assert_eq!(self.digests("part"), expected, "resumed");
        assert_eq!(self.series("part"), series, "resumed");
        assert_eq!(beyond_the_digest(&self.at("part")), beyond, "resumed");
        let again = self.run("part", 1, &["--resume=auto"]);
        assert_eq!(again.code, 0, "{}", again.text);
        assert!(again.text.contains("finished"), "{}", again.text);
    }

    /// The steps of a part.
    fn steps(&self, name: &str, part: &str) -> u64 {
        let run = RunFile::open_any(&self.at(name).join(part)).expect("a part");
        *run.series().step.last().expect("a row")
    }
}

/// A shear, strain steps after it and Newton's equations, stopped within each and between them.
fn a_shear_is_strained(dimension: usize, size: &str) {
    let text = scene(dimension, size, 0.3, &format!("{SHEAR}{STRAIN}{NEWTONIAN}"));
    let case = Case::new(&text, &["run.h5", "run.h5/aqs", "run.h5/newtonian"]);
    let first = case.run("steps", 1, &[]);
    assert_eq!(first.code, 0, "{}", first.text);
    let shear = case.steps("steps", "run.h5");
    case.keeps_the_contracts(&[shear / 2, shear, shear + 1, shear + 3, shear + 10]);
    // A stage that is over cannot end elsewhere; one that is to come can.
    let stopped = case.run("ends", 1, &[&format!("--stop-at={}", shear + 1)]);
    assert_eq!(stopped.code, 75, "{}", stopped.text);
    let moved = case.resume("ends", 1, &["--set=shear.strain=0.03"]);
    assert_eq!(moved.code, 2, "{}", moved.text);
    assert!(
        moved.text.contains(
            "shear: the run would end at another step of it, but the checkpoint is at aqs step 1"
        ),
        "{}",
        moved.text
    );
    let longer = case.resume("ends", 1, &["--set=aqs.steps=4"]);
    assert_eq!(longer.code, 0, "{}", longer.text);
    assert_eq!(case.steps("ends", "run.h5/aqs"), 4);
}

#[test]
fn disks_are_sheared_and_then_strained() {
    a_shear_is_strained(2, "grains = 100, length = 10.0");
}

#[test]
fn spheres_are_sheared_and_then_strained() {
    a_shear_is_strained(3, "grains = 160, length = 5.4, width = 4.9");
}

/// Strain steps change all lengths of the cell, and a shear goes on in it.
fn a_strained_cell_is_sheared(dimension: usize, solid_fraction: f64) {
    let size = format!("grains = 100, solid_fraction = {solid_fraction}");
    let text = scene(dimension, &size, 0.3, &format!("{COMPRESSION}{SHEAR}"));
    let case = Case::new(&text, &["run.h5", "run.h5/shear"]);
    case.keeps_the_contracts(&[1, 20, 40]);
    let [strain, shear] = ["run.h5", "run.h5/shear"]
        .map(|part| RunFile::open_any(&case.at("one").join(part)).expect("a part"));
    assert_eq!(
        [strain.stage(), shear.stage()],
        [RunStage::Strain, RunStage::Shear]
    );
    // The shear begins in the cell that the strain steps leave, under the pressure of its load.
    let last = strain.series().rows() - 1;
    let length = strain.series().column("length_x")[last];
    assert_eq!(shear.periods()[0], length);
    let base = if dimension == 2 {
        length
    } else {
        length * strain.series().column("length_y")[last]
    };
    let force = shear.number("normal_force").expect("an attribute");
    assert!((force / (1e-2 * base) - 1.0).abs() < 1e-14);
    for name in ["solid_fraction", "coordination"] {
        let [before, after] = [
            strain.series().column(name)[last],
            shear.series().column(name)[0],
        ];
        assert!((after / before - 1.0).abs() < 1e-12, "{name}");
    }
    let [before, after] = ["stress_yy", "stress_xx"].map(|name| {
        let before = strain.series().column(name)[last];
        (before, shear.series().column(name)[0])
    });
    for (before, after) in [before, after] {
        assert!((after / before - 1.0).abs() < 1e-9, "{before} {after}");
    }
}

#[test]
fn disks_are_compressed_and_then_sheared() {
    a_strained_cell_is_sheared(2, 0.84);
}

#[test]
fn spheres_are_compressed_and_then_sheared() {
    a_strained_cell_is_sheared(3, 0.64);
}

/// Without friction contacts have no history, so that a stage is the same whether it follows
/// another one or begins with the file of that one's last state.
#[test]
fn a_stage_goes_on_as_from_the_file_of_the_one_before() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = |name: &str, text: &str| {
        let path = folder.path().join(format!("{name}.toml"));
        std::fs::write(&path, text).expect("written");
        let done = gshear_mpi(1, &folder.path().join(name), &[path.display().to_string()]);
        assert_eq!(done.code, 0, "{}", done.text);
    };
    let from = |name: &str, text: &str| {
        let sample = text.find("sample = {").expect("a sample");
        let end = sample + text[sample..].find('\n').expect("a line");
        let file = folder.path().join(name).join("checkpoint.h5");
        format!(
            "{}sample = {{ packing = {file:?}, boundary = 'periodic' }}{}",
            &text[..sample],
            &text[end..]
        )
    };
    let column = |path: &str, name: &str| {
        let run = RunFile::open_any(&folder.path().join(path)).expect("a part");
        run.series().column(name).to_vec()
    };
    let size = "grains = 100, length = 10.0";
    run("sheared", &scene(2, size, 0.0, SHEAR));
    let both = scene(2, size, 0.0, &format!("{SHEAR}{STRAIN}"));
    run("both", &both);
    run("strained", &from("sheared", &scene(2, size, 0.0, STRAIN)));
    for name in [
        "shear_stress",
        "pressure",
        "solid_fraction",
        "elastic_energy",
    ] {
        let [ours, theirs] = ["both/run.h5/aqs", "strained/run.h5"].map(|path| column(path, name));
        assert_eq!(ours.len(), 4);
        for (a, b) in ours.iter().zip(&theirs) {
            assert!((a / b - 1.0).abs() < 1e-6, "{name}: {ours:?} {theirs:?}");
        }
    }
    let size = "grains = 100, solid_fraction = 0.84";
    let compressed = COMPRESSION.replace("stages = ['aqs', 'shear']", "");
    run("compressed", &scene(2, size, 0.0, &compressed));
    // The mass of the top depends on the mean size, which of a file is that of its grains.
    let shear = SHEAR.replace(
        "load.pressure = 1e-2",
        "load = { pressure = 1e-2, control = 'volume' }",
    );
    let turned = scene(2, size, 0.0, &format!("{COMPRESSION}{shear}"));
    run("turned", &turned);
    run("after", &from("compressed", &scene(2, size, 0.0, &shear)));
    for name in [
        "stress_ratio",
        "solid_fraction",
        "coordination",
        "stress_xx",
    ] {
        let [ours, theirs] = ["turned/run.h5/shear", "after/run.h5"].map(|path| column(path, name));
        assert!(ours.len() > 10);
        for (k, (a, b)) in ours.iter().zip(&theirs).enumerate() {
            assert!(
                (a - b).abs() < 1e-6 * a.abs().max(1e-3),
                "{name}, {k}: {a} {b}"
            );
        }
    }
}

/// The reducer takes each part of a run, and the report has a page for each stage.
#[test]
fn every_part_is_reduced() {
    let both = scene(
        2,
        "grains = 100, length = 10.0",
        0.3,
        &format!("{SHEAR}{STRAIN}{NEWTONIAN}"),
    );
    let turned = scene(
        2,
        "grains = 100, solid_fraction = 0.84",
        0.3,
        &format!("{COMPRESSION}{SHEAR}"),
    );
    for (text, first, later) in [(both, "shear", "aqs"), (turned, "aqs", "shear")] {
        let case = Case::new(&text, &["run.h5"]);
        let done = case.run("run", 1, &["--set=output.keep_checkpoints=true"]);
        assert_eq!(done.code, 0, "{}", done.text);
        let run = case.at("run");
        let reduce = |words: &[&str], path: &Path| {
            let output = succeed(reducer().args(words).arg(path));
            String::from_utf8_lossy(&output.stdout).into_owned()
        };
        reduce(&["report"], &run);
        let page = |path: &str| std::fs::read_to_string(run.join(path)).expect("a page");
        let link = format!("<a href=\"{later}/index.html\">");
        assert!(page("report/index.html").contains(&link), "{first}");
        assert!(page(&format!("report/{later}/index.html")).contains("<figure"));
        let part = run.join("run.h5").join(later);
        for path in [run.clone(), part.clone()] {
            assert!(reduce(&["info"], &path).contains("frames"));
            reduce(&["spectrum", "--count=6"], &path);
        }
        // Commands that need the shear find it.
        reduce(&["phases"], &run);
        let shear = RunFile::open(&run).expect("the shear");
        assert_eq!(shear.stage(), RunStage::Shear);
        let step = shear.series().step[3];
        assert!(step > 0);
        reduce(&["replay", "--strain=0.004..0.009"], &run);
    }
}
