//! What a run will take, before it begins: steps, time, memory, disk, and whether its folder can be
//! written. The speed is measured on a lattice of grains with the law of the scene.

use std::fmt::Write;
use std::time::Instant;

use bytemuck::Zeroable;

use gshear_dem::dimension::{Three, Two};
use gshear_dem::drive::NoWalls;
use gshear_dem::failure::Failure;
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::LawSpace;
use gshear_dem::state::{Cell, ContactState, GrainState, Sheared};
use gshear_dem::step::{StepRequest, advance, initial_forces};
use gshear_dem::system::System;
use gshear_mpi_exchange::Parallel;
use gshear_scene::schedule::{Schedule, inertial_time};
use gshear_scene::{
    Boundary, Deformation, Dimensions, Method, Motion, Origin, PeriodicBox, PlaneShear, Sample,
    Scene, WallSpeed,
};
use gshear_store::trajectory::{self, file_bytes, waiting_bytes};

use crate::header::Header;
use crate::launch::Task;
use crate::memory;
use crate::options::Options;
use crate::progress::duration;
use crate::run::{Run, Start};
use crate::stages::setup::{force, system};
use crate::stages::shear::series_columns;
use crate::stages::{newtonian, prepare, relax};

/// Contacts per grain, of disks and of spheres, as sheared packings with friction have them; the
/// densest have 2 and 3.
const CONTACTS: [f64; 2] = [1.8, 2.3];
/// Solid fractions of dense packings of disks and of spheres.
const DENSE: [f64; 2] = [0.84, 0.6];

/// What a run will take.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// The stages that are left, in order.
    pub stages: Vec<StageEstimate>,
    /// Ranks.
    pub ranks: usize,
    /// Number of hosts that they are on.
    pub hosts: usize,
    /// Grains.
    pub grains: u32,
    /// Greatest resident size of a rank (bytes).
    pub memory: f64,
    /// The files, in bytes.
    pub files: Vec<FileEstimate>,
    /// Speed of all ranks together (grain-steps/s), without output; `None` if it was not measured.
    pub speed: Option<f64>,
    /// Time of a strain step of a box (s), roughly; `None` if it was not measured.
    pub strain_step: Option<f64>,
    /// Whether the energy budget is recorded.
    energy: bool,
}

/// The steps of a stage that are left.
#[derive(Debug, Clone, PartialEq)]
pub struct StageEstimate {
    /// Name.
    pub name: &'static str,
    /// Steps; `None` if they are not known in advance.
    pub steps: Option<u64>,
    /// Whether the steps are exactly these.
    pub exact: bool,
    /// Whether they are steps of the equations of motion.
    pub moves: bool,
    /// Bytes of frames, and rows of the time series, to be written.
    output: (f64, u64),
}

/// The size of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct FileEstimate {
    /// Name.
    pub name: &'static str,
    /// Bytes.
    pub bytes: f64,
    /// What it holds.
    pub content: String,
}

impl Estimate {
    /// Of a task on these ranks, without a speed. Collective.
    ///
    /// # Errors
    /// A checkpoint of another version.
    pub fn of(exchange: &dyn Parallel, task: &Task) -> Result<Self, Failure> {
        let scene = &task.scene;
        let header = match &task.start {
            Start::Checkpoint(snapshot) => Some(Header::read(snapshot)?),
            Start::Insertion | Start::Grains(_) => None,
        };
        let mut estimate = match &scene.boundary {
            Boundary::Walls(walls) => of_walls(scene, walls, header.as_ref()),
            Boundary::Periodic(_) => of_box(scene, header.as_ref()),
        };
        estimate.ranks = exchange.size();
        estimate.hosts = memory::hosts(exchange);
        estimate.memory = memory_of(scene, exchange.size(), estimate.frame_bytes(scene));
        Ok(estimate)
    }

    /// Speed of all ranks together (grain-steps/s), measured within a second; `None` if the law does
    /// not hold on the lattice. Collective.
    ///
    /// # Errors
    /// More ranks than the sample has room for.
    pub fn speed(
        exchange: &dyn Parallel,
        task: &Task,
        options: &Options,
    ) -> Result<Option<f64>, Failure> {
        match task.scene.dimension {
            Dimensions::Two => speed::<Two>(exchange, task, options),
            Dimensions::Three => speed::<Three>(exchange, task, options),
        }
    }

    /// Time of a strain step of a box (s), roughly, measured within seconds; `None` for other
    /// scenes, and if the equilibrium is not found by Newton's method. Collective.
    ///
    /// # Errors
    /// More ranks than the sample has room for.
    pub fn strain_step(
        exchange: &dyn Parallel,
        task: &Task,
        options: &Options,
    ) -> Result<Option<f64>, Failure> {
        match task.scene.dimension {
            Dimensions::Two => strain_step::<Two>(exchange, task, options),
            Dimensions::Three => strain_step::<Three>(exchange, task, options),
        }
    }

    /// Whether strain steps are left.
    pub fn strains(&self) -> bool {
        self.stages.iter().any(|stage| !stage.moves)
    }

    fn new(scene: &Scene, energy: bool) -> Self {
        Self {
            stages: Vec::new(),
            ranks: 1,
            hosts: 1,
            grains: scene.sample.grains,
            memory: 0.0,
            files: Vec::new(),
            speed: None,
            strain_step: None,
            energy,
        }
    }

    /// Bytes of a frame, if any are written.
    fn frame_bytes(&self, scene: &Scene) -> f64 {
        let writes = self.stages.iter().any(|stage| stage.output.0 > 0.0);
        if writes { frame_bytes(scene) } else { 0.0 }
    }

    /// Grain-steps of the stages whose steps are known, at least as a guess.
    pub fn grain_steps(&self) -> f64 {
        self.stages.iter().map(|stage| self.work(stage)).sum()
    }

    fn work(&self, stage: &StageEstimate) -> f64 {
        let steps = stage.steps.filter(|_| stage.moves).unwrap_or(0);
        f64::from(self.grains) * steps as f64
    }

    /// Time of a stage (s).
    fn seconds(&self, stage: &StageEstimate) -> Option<f64> {
        let steps = stage.steps?;
        let budget = if self.energy { BUDGET } else { 1.0 };
        let (bytes, rows) = stage.output;
        let output = bytes / FRAMES_PER_SECOND + ROW * f64::from(self.grains) * rows as f64;
        let output = output / self.ranks.min(cores()) as f64;
        let computed = match stage.moves {
            true => budget * self.work(stage) / self.speed?,
            false => steps as f64 * self.strain_step?,
        };
        Some(computed + output)
    }

    /// Time of the stages for which it is known (s).
    pub fn time(&self) -> Option<f64> {
        let times = self.stages.iter().filter_map(|stage| self.seconds(stage));
        self.speed.map(|_| times.sum())
    }

    /// Bytes of all files.
    pub fn disk(&self) -> f64 {
        self.files.iter().map(|file| file.bytes).sum()
    }

    /// A line for each quantity.
    pub fn text(&self) -> String {
        let mut text = String::new();
        let mut line = |name: &str, content: String| {
            writeln!(text, "{name:<12}{content}").expect("a string grows");
        };
        let steps = self.stages.iter().map(|stage| {
            let name = stage.name;
            match stage.steps {
                Some(steps) if stage.exact => format!("{steps} of {name}"),
                Some(steps) if !stage.moves => format!("at most {steps} of {name}"),
                Some(steps) => format!("about {} of {name} (a guess)", rounded(steps as f64)),
                None => format!("unknown of {name}"),
            }
        });
        line("steps", steps.collect::<Vec<_>>().join(", "));
        if self.grain_steps() > 0.0 {
            line("work", format!("{:.2e} grain-steps", self.grain_steps()));
        }
        if let Some(speed) = self.speed {
            let ranks = match self.ranks {
                1 => "1 rank".into(),
                n => format!("{n} ranks"),
            };
            line(
                "speed",
                format!(
                    "{:.3} million grain-steps/s of {ranks}, measured here on a lattice",
                    1e-6 * speed
                ),
            );
        }
        let times: Vec<String> = self
            .stages
            .iter()
            .map(|stage| match self.seconds(stage) {
                Some(seconds) if stage.moves => {
                    format!("{} about {}", stage.name, duration(seconds))
                }
                Some(seconds) => format!("{} very roughly {}", stage.name, duration(seconds)),
                None => format!("{} unknown", stage.name),
            })
            .collect();
        line("time", times.join(", "));
        line("memory", format!("about {} per rank", bytes(self.memory)));
        let files: Vec<String> = self
            .files
            .iter()
            .map(|file| format!("{} {} ({})", file.name, bytes(file.bytes), file.content))
            .collect();
        line("disk", format!("about {}", bytes(self.disk())));
        for file in files {
            line("", file);
        }
        text
    }
}

/// Time of a step with the energy budget over that without (docs/speed.md).
const BUDGET: f64 = 1.06;
/// Bytes of frames that one rank gathers and writes in a second, and the time of a row for a grain
/// (s): as measured on the default scene.
const FRAMES_PER_SECOND: f64 = 6e7;
const ROW: f64 = 1e-7;

/// Processors of this machine.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Two digits of a guess.
fn rounded(value: f64) -> u64 {
    let unit = 10f64.powf((value.max(1.0).log10().floor() - 1.0).max(0.0));
    ((value / unit).round() * unit) as u64
}

/// A size in words.
pub fn bytes(size: f64) -> String {
    let units = [("GB", 1e9), ("MB", 1e6), ("KB", 1e3)];
    let (name, unit) = units
        .into_iter()
        .find(|(_, unit)| size >= *unit)
        .unwrap_or(("KB", 1e3));
    match size / unit {
        size if size < 10.0 => format!("{size:.1} {name}"),
        size => format!("{size:.0} {name}"),
    }
}

fn index(scene: &Scene) -> usize {
    scene.dimension.axes() - 2
}

/// Contacts of all grains.
fn contacts(scene: &Scene) -> f64 {
    CONTACTS[index(scene)] * f64::from(scene.sample.grains)
}

fn frame_bytes(scene: &Scene) -> f64 {
    let [grain, contact] = trajectory::frame_bytes(scene.dimension.axes());
    grain as f64 * f64::from(scene.sample.grains) + contact as f64 * contacts(scene)
}

/// Bytes of a checkpoint.
fn checkpoint_bytes(scene: &Scene) -> f64 {
    size_of::<GrainState>() as f64 * f64::from(scene.sample.grains)
        + size_of::<ContactState>() as f64 * contacts(scene)
        + 6e3
}

/// Greatest resident size of a rank (bytes); docs/speed.md, "Memory".
fn memory_of(scene: &Scene, ranks: usize, frame: f64) -> f64 {
    let part = 1.0 / ranks as f64;
    let grains = f64::from(scene.sample.grains) * part;
    memory::PROCESS_BYTES
        + memory::GRAIN_BYTES[index(scene)] * grains
        + memory::FRAME_COPIES * waiting_bytes(frame) * part
}

/// Bytes of a file of frames and rows, and what it holds.
fn file_of(
    scene: &Scene,
    name: &'static str,
    frames: u64,
    (rows, columns): (u64, usize),
) -> FileEstimate {
    let of = (scene.dimension.axes(), scene.sample.grains as usize);
    FileEstimate {
        name,
        bytes: file_bytes(of, (frames, contacts(scene)), (rows, columns)),
        content: format!("{frames} frames, {rows} rows"),
    }
}

/// Bytes of a number in a log.
const NUMBER: f64 = 19.0;

fn of_walls(scene: &Scene, walls: &PlaneShear, header: Option<&Header>) -> Estimate {
    let mut estimate = Estimate::new(scene, walls.output.energy);
    let sample = &scene.sample;
    let packs = match header {
        None => !walls.pack.skip,
        Some(header) => matches!(header, Header::Pack { .. }),
    };
    let known = match header {
        Some(Header::Shear { height, .. }) => Some(*height),
        _ => None,
    };
    let file = match &walls.origin {
        Origin::Packing { file, .. } if walls.pack.skip => Some(file.height()),
        _ => None,
    };
    let between = |height: f64| height - 2.0 * sample.mean_diameter;
    let height = known.unwrap_or_else(|| {
        between(file.unwrap_or_else(|| dense_height(scene))).max(sample.mean_diameter)
    });
    let schedule = Schedule::new(scene, walls, height);
    let done = match header {
        Some(Header::Pack { step, .. } | Header::Shear { step, .. }) => *step,
        _ => 0,
    };
    if packs {
        let guess = packing_steps(scene, walls).min(walls.pack.max_steps as f64) as u64;
        estimate.stages.push(StageEstimate {
            name: "packing",
            steps: Some(guess.saturating_sub(done).max(guess / 10)),
            exact: false,
            moves: true,
            output: (0.0, 0),
        });
    }
    let counts = schedule.counts();
    let left = schedule.total - if packs { 0 } else { done };
    let share = left as f64 / schedule.total.max(1) as f64;
    let frames = counts.frames as f64 * frame_bytes(scene);
    // A velocity becomes a strain by the height, which is that of the packed sample.
    let by_velocity = matches!(
        &walls.shear.motion,
        Motion::Strain {
            drive: WallSpeed::Velocity(_),
            ..
        }
    );
    estimate.stages.push(StageEstimate {
        name: "shear",
        steps: Some(left),
        exact: !by_velocity || known.is_some(),
        moves: true,
        output: (frames * share, (counts.rows as f64 * share) as u64),
    });
    let columns = series_columns(schedule.protocol.is_more_than_velocities()).len();
    let run = file_of(scene, "run.h5", counts.frames, (counts.rows, columns));
    estimate.files.push(run);
    estimate.files.push(FileEstimate {
        name: "log.csv",
        bytes: NUMBER * (columns + 1) as f64 * counts.rows as f64,
        content: format!("{} rows", counts.rows),
    });
    let kept = match scene.keep_checkpoints {
        true => counts.checkpoints + 1,
        false => 2.min(counts.checkpoints),
    };
    estimate.checkpoints(scene, kept);
    estimate
}

impl Estimate {
    fn checkpoints(&mut self, scene: &Scene, count: u64) {
        let one = checkpoint_bytes(scene);
        self.files.push(FileEstimate {
            name: "checkpoints",
            bytes: one * count as f64,
            content: format!("{count} of {}", bytes(one)),
        });
    }
}

/// Height of a dense sample between walls (m).
pub fn dense_height(scene: &Scene) -> f64 {
    let sample = &scene.sample;
    f64::from(sample.grains) * sample.mean_volume / sample.base() / DENSE[index(scene)]
}

/// A guess how many steps the packing takes: the top falls through loose layers, then waves and the
/// rest of the grains' motion decay. Right within a factor of about three.
fn packing_steps(scene: &Scene, walls: &PlaneShear) -> f64 {
    let layers = dense_height(scene) / scene.sample.mean_diameter;
    let times = layers * (1.0 + 0.2 * layers);
    times * inertial_time(scene, &walls.load) / scene.time_step.step
}

fn of_box(scene: &Scene, header: Option<&Header>) -> Estimate {
    let mut estimate = Estimate::new(scene, false);
    let Boundary::Periodic(periodic) = &scene.boundary else {
        unreachable!("a box")
    };
    let (strained, moved, pair) = match header {
        Some(Header::Aqs { progress, .. }) => (Some(progress.steps), 0, progress.pair),
        Some(Header::Newtonian { step, progress, .. }) => {
            (Some(periodic.aqs.steps), *step, progress.pair)
        }
        _ => (None, 0, None),
    };
    if strained.is_none() {
        estimate.stages.push(StageEstimate {
            name: "preparation",
            steps: Some(prepare::steps(scene, periodic)),
            exact: false,
            moves: true,
            output: (0.0, 0),
        });
    }
    let aqs = &periodic.aqs;
    let frames = |every: u64| aqs.steps.checked_div(every).map_or(0, |frames| frames + 1);
    let frames = frames(aqs.frame_every);
    let strains = aqs.steps.saturating_sub(strained.unwrap_or(0));
    if strains > 0 {
        estimate.stages.push(StageEstimate {
            name: "strain",
            steps: Some(strains),
            // Ends earlier with the growth of a pair.
            exact: aqs.until_imaginary == 0.0,
            moves: false,
            output: (frames as f64 * frame_bytes(scene), aqs.steps),
        });
    }
    let columns = gshear_store::columns::AqsRow::COLUMNS.len();
    estimate
        .files
        .push(file_of(scene, "aqs.h5", frames, (aqs.steps + 1, columns)));
    if let Some(of) = &periodic.newtonian {
        // A complex pair, which the strain steps may find, decides how many.
        let may_differ = aqs.spectrum && header.is_none_or(|h| matches!(h, Header::Aqs { .. }));
        let steps = newtonian::steps(of, pair.as_ref(), scene.time_step.step);
        estimate.stages.push(StageEstimate {
            name: "newtonian",
            steps: Some(steps.saturating_sub(moved)),
            exact: !may_differ,
            moves: true,
            output: (of.frames as f64 * frame_bytes(scene), of.rows),
        });
        let columns = gshear_store::columns::NewtonianRow::COLUMNS.len();
        let file = file_of(scene, "newtonian.h5", of.frames + 1, (of.rows + 1, columns));
        estimate.files.push(file);
    }
    estimate.checkpoints(scene, 2);
    estimate
}

/// Grains of the lattice on a rank, at most; more are as fast.
const MOST_GRAINS: u32 = 100_000;
/// Time of the measurement (s), about.
const MEASURED: f64 = 0.4;

/// A run that says nothing and writes nothing, for a measurement with the grains of a scene.
/// Refuses more ranks than the sample has room for.
fn silent<'a, D: LawSpace>(
    exchange: &'a dyn Parallel,
    task: &'a Task,
    options: &'a Options,
) -> Result<Run<'a>, Failure> {
    let scene = &task.scene;
    let record = task.record.clone();
    let run = Run::new(exchange, &scene.toml, &scene.bookkeeping, record, options)?;
    let cell = match &scene.boundary {
        Boundary::Walls(_) => scene.sample.cell(),
        Boundary::Periodic(_) => scene.sample.box_cell(scene.sample.length),
    };
    system::<D>(&run, scene, cell)?;
    Ok(run)
}

/// No terminal, no files.
fn quiet(options: &Options) -> Options {
    Options {
        verbosity: crate::options::Verbosity::Quiet,
        ..options.clone()
    }
}

/// What all ranks have measured; `None` if it failed on one, as where the law does not hold on the
/// lattice.
fn of_all(exchange: &dyn Parallel, measured: Result<f64, Failure>) -> Option<f64> {
    let failed = exchange.maximum(f64::from(u8::from(measured.is_err()))) > 0.0;
    measured.ok().filter(|_| !failed)
}

/// Speed of all ranks together (grain-steps/s). `None` if the law does not hold on the lattice.
/// Collective.
fn speed<D: LawSpace>(
    exchange: &dyn Parallel,
    task: &Task,
    options: &Options,
) -> Result<Option<f64>, Failure> {
    let options = quiet(options);
    let run = silent::<D>(exchange, task, &options)?;
    Ok(of_all(exchange, measured::<D>(&run, &task.scene)))
}

/// A lattice of equal grains at rest.
#[derive(Debug, Clone, Copy)]
struct Lattice {
    /// Grains along x, y and the last axis; one along y in two dimensions.
    grains: [u32; 3],
    /// Distances along these axes (m).
    spacing: [f64; 3],
}

impl Lattice {
    fn count(&self) -> u32 {
        self.grains.iter().product()
    }

    /// The lattice in a periodic cell, with its forces.
    fn system<D: LawSpace>(
        &self,
        run: &Run<'_>,
        scene: &Scene,
        law: &dyn PairForce<D>,
    ) -> Result<System<D>, Failure> {
        let exchange = run.exchange;
        let diameter = scene.sample.mean_diameter;
        let [along, across, up] = self.grains;
        let lengths: [f64; 3] =
            std::array::from_fn(|k| f64::from(self.grains[k]) * self.spacing[k]);
        let planar = D::AXES == 2;
        let cell = Cell {
            periods: [lengths[0], if planar { f64::INFINITY } else { lengths[1] }],
            sheared: Some(Sheared::upright(lengths[2])),
        };
        let equal = Scene {
            sample: Sample {
                radius_min: 0.5 * diameter,
                radius_max: 0.5 * diameter,
                ..scene.sample
            },
            ..scene.clone()
        };
        let all = along * across * up;
        let (rank, size) = (exchange.rank() as u64, exchange.size() as u64);
        let part = |r: u64| (u64::from(all) * r / size) as u32;
        let grain = |id: u32| {
            let at = [id / (across * up), id / up % across, id % up].map(|k| f64::from(k) + 0.5);
            let mut position = [0.0; 3];
            position[0] = at[0] * self.spacing[0];
            position[D::UP] = at[2] * self.spacing[2];
            if !planar {
                position[1] = at[1] * self.spacing[1];
            }
            GrainState {
                id,
                position,
                radius: 0.5 * diameter,
                ..GrainState::zeroed()
            }
        };
        let grains = (part(rank)..part(rank + 1)).map(grain).collect();
        let mut system: System<D> = system(run, &equal, cell)?;
        system.replace(exchange, law, &mut NoWalls, grains, Vec::new())?;
        initial_forces(exchange, &mut system, law, &mut NoWalls, None)?;
        Ok(system)
    }
}

/// Overlap over d̄ of the grains of a lattice.
fn overlap(scene: &Scene) -> f64 {
    match &scene.boundary {
        Boundary::Walls(walls) => (1.0 / walls.load.stiffness_number).min(0.01),
        Boundary::Periodic(_) => 0.01,
    }
}

/// Steps on a lattice of equal grains, two or three of whose neighbours each touch, as in a packing.
fn measured<D: LawSpace>(run: &Run<'_>, scene: &Scene) -> Result<f64, Failure> {
    let exchange = run.exchange;
    let sample = &scene.sample;
    let diameter = sample.mean_diameter;
    let (touching, near) = (diameter * (1.0 - overlap(scene)), 1.001 * diameter);
    let count = sample
        .grains
        .min(MOST_GRAINS.saturating_mul(exchange.size() as u32));
    let along = ((sample.length / touching) as u32).max(8);
    let across = match D::AXES {
        2 => 1,
        _ => ((sample.width / near) as u32).max(4),
    };
    let up = (count / along / across).max(8);
    let lattice = Lattice {
        grains: [along, across, up],
        spacing: [touching, near, touching],
    };
    let law = force::<D>(&scene.law, scene.contact);
    let law = law.as_ref();
    let mut system = lattice.system(run, scene, law)?;
    let mut steps = |steps: u64| -> Result<f64, Failure> {
        exchange.barrier();
        let begun = Instant::now();
        for _ in 0..steps {
            let request = StepRequest::default();
            advance(exchange, &mut system, law, &mut NoWalls, request)?;
        }
        Ok(exchange.maximum(begun.elapsed().as_secs_f64()))
    };
    // The first steps fill the caches.
    steps(3)?;
    let one = steps(3)? / 3.0;
    let many = ((MEASURED / one) as u64).clamp(3, 1_000_000);
    let seconds = steps(many)?;
    Ok(f64::from(lattice.count()) * many as f64 / seconds)
}

/// Factorisations of K, each with its solves, in a relaxation by Newton's method.
const FACTORISATIONS: f64 = 2.0;
/// Relaxations in a strain step of simple or pure shear, of a biaxial box and of a compression.
const RELAXATIONS: [f64; 3] = [1.0, 4.0, 15.0];
/// Time of a measurement of Newton's method after which larger lattices are extrapolated to (s).
const LONG: f64 = 0.3;
/// Grains of the first lattice, and of that whose eigenvalues are found.
const FEW: u32 = 100;
/// Powers of the number of grains that the time of a factorisation grows by, of disks and of
/// spheres: nested dissection of a network in two and in three dimensions.
const FACTORISATION_POWER: [f64; 2] = [1.5, 2.0];

/// Time of a strain step (s): that of its factorisations of K and, if the scene asks for them, of
/// all eigenvalues, of lattices in which every grain touches as many others as in a packing.
/// Collective.
fn strain_step<D: LawSpace>(
    exchange: &dyn Parallel,
    task: &Task,
    options: &Options,
) -> Result<Option<f64>, Failure> {
    let scene = &task.scene;
    let Boundary::Periodic(periodic) = &scene.boundary else {
        return Ok(None);
    };
    if periodic.relax.method != Method::Newton {
        return Ok(None);
    }
    let options = quiet(options);
    let run = silent::<D>(exchange, task, &options)?;
    Ok(of_all(
        exchange,
        strain_step_on_lattices::<D>(&run, scene, periodic),
    ))
}

fn strain_step_on_lattices<D: LawSpace>(
    run: &Run<'_>,
    scene: &Scene,
    periodic: &PeriodicBox,
) -> Result<f64, Failure> {
    let exchange = run.exchange;
    let all = scene.sample.grains;
    let law = force::<D>(&scene.law, scene.contact);
    let law = law.as_ref();
    let lattice = |grains: u32| {
        let side = f64::from(grains).powf(1.0 / D::AXES as f64).round() as u32;
        // A grain must not meet its own images, nor a slab be narrower than the cutoff.
        let side = side.max(4);
        let along = side.max(3 * exchange.size() as u32);
        let touching = scene.sample.mean_diameter * (1.0 - overlap(scene));
        Lattice {
            grains: match D::AXES {
                2 => [along, 1, side],
                _ => [along, side, side],
            },
            spacing: [touching; 3],
        }
    };
    let timed = |of: &mut dyn FnMut() -> Result<(), Failure>| -> Result<f64, Failure> {
        exchange.barrier();
        let begun = Instant::now();
        of()?;
        Ok(exchange.maximum(begun.elapsed().as_secs_f64()))
    };

    let mut grains = all.min(FEW);
    let relaxation = loop {
        let lattice = lattice(grains);
        let mut system = lattice.system(run, scene, law)?;
        let seconds = timed(&mut || relax::factor_once(exchange, &mut system, law))?;
        let larger = f64::from(all) / f64::from(lattice.count());
        if grains == all || seconds > LONG {
            let power = FACTORISATION_POWER[index(scene)];
            break seconds * larger.max(1.0).powf(power);
        }
        grains = all.min(grains.saturating_mul(4));
    };
    let relaxations = match periodic.deformation {
        Deformation::SimpleShear | Deformation::PureShear => RELAXATIONS[0],
        Deformation::Biaxial => RELAXATIONS[1],
        Deformation::Compression(_) => RELAXATIONS[2],
    };
    let mut seconds = relaxations * FACTORISATIONS * relaxation;
    if periodic.aqs.spectrum {
        let lattice = lattice(all.min(FEW));
        let mut system = lattice.system(run, scene, law)?;
        let one = timed(&mut || relax::eigenvalues_once(exchange, &mut system, law))?;
        let larger = f64::from(all) / f64::from(lattice.count());
        seconds += one * larger.powi(3);
    }
    Ok(seconds)
}
