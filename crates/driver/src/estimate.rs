//! What a run will take, before it begins: steps, time, memory, disk, and whether its folder can be
//! written. Times are measured by `calibration`.

use gshear_dem::contact::TORQUES;
use gshear_dem::state::{ContactState, GrainState};
use gshear_mpi_exchange::Parallel;
use gshear_scene::derived;
use gshear_scene::schedule::{Schedule, packing_steps};
use gshear_scene::{
    Deformation, Method, Motion, Origin, PlaneShear, QuasiStatic, RunStage, Sample, Scene,
    WallSpeed,
};
use gshear_store::box_columns::{AqsRow, NewtonianRow};
use gshear_store::file_names::{LOG_FILE, NEWTONIAN_PART, part_of};
use gshear_store::trajectory::{self, FileContent, FrameFormat, waiting_bytes};

use crate::header::Header;
use crate::launch::Task;
use crate::memory;
use crate::output_schedule::{StrainSchedule, dense_rows, steps_of_newtonian};
use crate::stages::{PACK, PREPARE, prepare};
use crate::terminal::progress::duration;
use crate::terminal::ranks;

/// Contacts per grain, of disks and of spheres, as sheared packings with friction have them; the
/// densest have 2 and 3.
const CONTACTS: [f64; 2] = [1.8, 2.3];
/// Solid fractions of dense packings of disks and of spheres.
const DENSE: [f64; 2] = [0.84, 0.6];

/// What a run will take.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Estimate {
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
    /// Time of the strain steps of a box, roughly; `None` if it was not measured.
    pub strain_step: Option<StrainStepTime>,
    /// Time of a step over that of the measured speed.
    slower: f64,
}

/// Times of strain steps (s).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct StrainStepTime {
    /// Of a strain step.
    pub step: f64,
    /// Of a relaxation, of which a strain step may have several.
    pub relaxation: f64,
}

/// The steps of a stage that are left.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct StageEstimate {
    /// Name.
    pub name: &'static str,
    /// Steps, at least as a guess.
    pub steps: u64,
    /// Whether the steps are exactly these.
    pub exact: bool,
    /// Whether they are steps of the equations of motion.
    pub moves: bool,
    /// Relaxations in which a box is brought to its pressures besides these steps, as a guess.
    searches: f64,
    /// Bytes of frames, and rows of the time series, to be written.
    output: (f64, u64),
}

impl StageEstimate {
    /// Steps of the equations of motion, without output.
    fn moving(name: &'static str, steps: u64, exact: bool) -> Self {
        Self {
            name,
            steps,
            exact,
            moves: true,
            searches: 0.0,
            output: (0.0, 0),
        }
    }
}

/// The size of a file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FileEstimate {
    /// Name.
    pub name: &'static str,
    /// Bytes until the end of the run.
    pub bytes: f64,
    /// Bytes of a file that is compressed at the end.
    pub compressed: Option<f64>,
    /// What it holds.
    pub content: String,
}

impl FileEstimate {
    /// Bytes that the run leaves.
    fn left(&self) -> f64 {
        self.compressed.unwrap_or(self.bytes)
    }
}

impl Estimate {
    /// Of a task on these ranks up to the step at which it is to stop, without a speed. Collective.
    pub fn of(exchange: &dyn Parallel, task: &Task, stop_at: Option<u64>) -> Self {
        let (scene, ranks) = (&task.scene, exchange.size());
        let header = task.saved().map(|saved| &saved.header);
        let last = stop_at.unwrap_or(u64::MAX);
        let Parts {
            stages, mut files, ..
        } = Parts::of(scene, header, last);
        if stop_at.is_some() {
            // It is compressed when the run has ended.
            files.iter_mut().for_each(|file| file.compressed = None);
        }
        let writes = stages.iter().any(|stage| stage.output.0 > 0.0);
        let frame = if writes { frame_bytes(scene) } else { 0.0 };
        Self {
            stages,
            ranks,
            hosts: memory::hosts(exchange),
            grains: scene.sample.grains,
            memory: memory_of(scene, ranks, frame),
            files,
            speed: None,
            strain_step: None,
            slower: match scene.shear() {
                Some(walls) if walls.boundary.is_periodic() => WITHOUT_WALLS,
                Some(walls) if walls.output.energy => BUDGET,
                _ => 1.0,
            },
        }
    }

    /// Whether strain steps are left.
    pub fn strains(&self) -> bool {
        self.stages.iter().any(|stage| !stage.moves)
    }

    /// Grain-steps of the stages.
    pub fn grain_steps(&self) -> f64 {
        self.stages.iter().map(|stage| self.work(stage)).sum()
    }

    fn work(&self, stage: &StageEstimate) -> f64 {
        let steps = if stage.moves { stage.steps } else { 0 };
        f64::from(self.grains) * steps as f64
    }

    /// Time of a stage (s).
    fn seconds(&self, stage: &StageEstimate) -> Option<f64> {
        let (bytes, rows) = stage.output;
        let ranks = self.ranks.min(cores());
        let frames = bytes / (FRAMES_PER_SECOND * ranks.min(WRITERS) as f64);
        let output = frames + ROW * f64::from(self.grains) * rows as f64 / ranks as f64;
        let computed = if stage.moves {
            self.slower * self.work(stage) / self.speed?
        } else {
            let time = self.strain_step?;
            stage.steps as f64 * time.step + stage.searches * time.relaxation
        };
        Some(computed + output)
    }

    /// Time of the stages for which it is known (s).
    pub fn time(&self) -> Option<f64> {
        let times = self.stages.iter().filter_map(|stage| self.seconds(stage));
        self.speed.map(|_| times.sum())
    }

    /// Bytes of all files until the end, when some are compressed.
    pub fn disk(&self) -> f64 {
        self.files.iter().map(|file| file.bytes).sum()
    }

    /// A line for each quantity.
    pub fn text(&self) -> String {
        let mut text = String::new();
        let steps = self.stages.iter().map(|stage| {
            let (name, steps) = (stage.name, stage.steps);
            match (stage.exact, stage.moves) {
                (true, _) => format!("{name} {steps}"),
                (false, false) => format!("{name} at most {steps}"),
                (false, true) => format!("{name} about {} (a guess)", rounded(steps as f64)),
            }
        });
        text += &line("steps", &steps.collect::<Vec<_>>().join(", "));
        if self.grain_steps() > 0.0 {
            let work = format!("{:.2e} grain-steps", self.grain_steps());
            text += &line("work", &work);
        }
        if let Some(speed) = self.speed {
            let (ranks, millions) = (ranks(self.ranks), 1e-6 * speed);
            let speed = format!("{millions:.3} million grain-steps/s of {ranks}");
            text += &line("speed", &(speed + ", measured here on a lattice"));
        }
        let times = self.stages.iter().map(|stage| match self.seconds(stage) {
            Some(seconds) => format!("{} {}", stage.name, about(seconds, stage.moves)),
            None => format!("{} unknown", stage.name),
        });
        text += &line("time", &times.collect::<Vec<_>>().join(", "));
        text += &line("memory", &format!("about {} per rank", bytes(self.memory)));
        let at_the_end: f64 = self.files.iter().map(FileEstimate::left).sum();
        let disk = sizes(at_the_end, self.disk());
        text += &line("disk", &format!("about {disk}"));
        for file in &self.files {
            let size = sizes(file.left(), file.bytes);
            text += &line("", &format!("{} {size} ({})", file.name, file.content));
        }
        text
    }
}

/// The size of what a run leaves, and that before its end if it is another one.
fn sizes(left: f64, before: f64) -> String {
    if left < before {
        format!("{}, {} until the end", bytes(left), bytes(before))
    } else {
        bytes(before)
    }
}

/// A line of a quantity.
fn line(name: &str, content: &str) -> String {
    format!("{name:<12}{content}\n")
}

/// Time of a step with the energy budget over that without (docs/validation/speed.md).
const BUDGET: f64 = 1.17;
/// The same of a cell without walls, whose stress is counted.
const WITHOUT_WALLS: f64 = 1.5;
/// Bytes of frames that one rank gathers and writes in a second, and the time of a row for a grain
/// (s): as measured on the default scene.
const FRAMES_PER_SECOND: f64 = 6e7;
const ROW: f64 = 1e-7;
/// Ranks that write frames so many times as fast as one: more were not measured.
const WRITERS: usize = 2;

/// Processors of this machine.
pub(crate) fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// A time (s) in words; that of strain steps is less sure than that of moves.
fn about(seconds: f64, moves: bool) -> String {
    if seconds < 1.0 {
        "less than 1s".into()
    } else if moves {
        format!("about {}", duration(seconds))
    } else {
        format!("very roughly {}", duration(seconds))
    }
}

/// Two digits of a guess.
fn rounded(value: f64) -> u64 {
    let unit = 10f64.powf((value.max(1.0).log10().floor() - 1.0).max(0.0));
    ((value / unit).round() * unit) as u64
}

/// A size in words.
pub fn bytes(size: f64) -> String {
    let names = ["PB", "TB", "GB", "MB", "KB"].into_iter();
    let mut units = names.zip([1e15, 1e12, 1e9, 1e6, 1e3]);
    let largest = units.find(|(_, unit)| size >= *unit);
    let (name, unit) = largest.unwrap_or(("B", 1.0));
    match size / unit {
        size if size < 10.0 && unit > 1.0 => format!("{size:.1} {name}"),
        size => format!("{size:.0} {name}"),
    }
}

pub(crate) fn index(scene: &Scene) -> usize {
    scene.dimension.axes() - 2
}

/// Contacts of all grains.
fn contacts(scene: &Scene) -> f64 {
    CONTACTS[index(scene)] * f64::from(scene.sample.grains)
}

fn form(scene: &Scene) -> FrameFormat {
    let torques = index(scene) == 1 && scene.contact.resists_rotation();
    FrameFormat {
        removed: scene.removes(),
        walls: scene.flat_walls().is_some(),
        histories: scene.writes_histories(),
        ages: scene.writes_histories() && scene.ages(),
        ..FrameFormat::new(scene.dimension.axes(), torques)
    }
}

fn frame_bytes(scene: &Scene) -> f64 {
    let [grain, contact] = trajectory::frame_bytes(form(scene));
    grain as f64 * f64::from(scene.sample.grains) + contact as f64 * contacts(scene)
}

/// Bytes of a checkpoint.
fn checkpoint_bytes(scene: &Scene) -> f64 {
    let form = form(scene);
    let torques = size_of::<[f64; TORQUES]>() * usize::from(!form.torques);
    let age = size_of::<f64>() * usize::from(!form.ages);
    let contact = size_of::<ContactState>() - torques - age;
    size_of::<GrainState>() as f64 * f64::from(scene.sample.grains)
        + contact as f64 * contacts(scene)
        + 6e3
}

/// Greatest resident size of a rank (bytes); docs/validation/speed.md, "Memory".
fn memory_of(scene: &Scene, ranks: usize, frame: f64) -> f64 {
    let part = 1.0 / ranks as f64;
    let grains = f64::from(scene.sample.grains) * part;
    memory::PROCESS_BYTES
        + memory::GRAIN_BYTES[index(scene)] * grains
        + memory::FRAME_COPIES * waiting_bytes(frame) * part
        + match &scene.stages.strain {
            None => 0.0,
            Some(quasi_static) => memory_of_k(scene, quasi_static),
        }
}

/// Bytes of rank 0 for K of a box.
fn memory_of_k(scene: &Scene, quasi_static: &QuasiStatic) -> f64 {
    let (k, grains) = (index(scene), f64::from(scene.sample.grains));
    let factors = match quasi_static.relax.method {
        Method::Newton => memory::FACTOR_BYTES[k] * grains.powf(memory::FACTOR_POWER[k]),
        Method::Overdamped => 0.0,
    };
    let moving = (scene.stages.newtonian).is_some_and(|newtonian| newtonian.spectra > 0);
    let dense = if quasi_static.aqs.spectrum || moving {
        memory::DENSE_COPIES * 8.0 * ([3.0, 6.0][k] * grains).powi(2)
    } else {
        0.0
    };
    factors + dense
}

/// Bytes of a file of frames and rows, and what it holds.
fn file_of(
    scene: &Scene,
    name: &'static str,
    frames: u64,
    rows: u64,
    columns: usize,
) -> FileEstimate {
    let content = FileContent {
        form: form(scene),
        grains: scene.sample.grains as usize,
        frames,
        contacts: contacts(scene),
        rows,
        columns,
    };
    FileEstimate {
        name,
        bytes: content.bytes(),
        compressed: scene.compresses().then(|| content.compressed_bytes()),
        content: format!("{frames} frames, {rows} rows"),
    }
}

/// Bytes of a number in a log.
const NUMBER: f64 = 19.0;

/// What is estimated of the stages and files of a scene.
struct Parts<'a> {
    scene: &'a Scene,
    header: Option<&'a Header>,
    /// Steps that are left up to the one at which the run is to stop.
    last: u64,
    stages: Vec<StageEstimate>,
    files: Vec<FileEstimate>,
    /// Checkpoints that stay.
    checkpoints: u64,
}

impl<'a> Parts<'a> {
    /// Up to the step `last`, which counts those of all stages.
    fn of(scene: &'a Scene, header: Option<&'a Header>, last: u64) -> Self {
        let mut parts = Self {
            scene,
            header,
            last,
            stages: Vec::new(),
            files: Vec::new(),
            checkpoints: 0,
        };
        let stages = &scene.stages;
        let begun = header.and_then(Header::run_stage);
        for stage in &stages.order {
            // That of the checkpoint comes later.
            let is_done = begun.is_some_and(|begun| stages.after(*stage).contains(&begun));
            match (stage, &stages.shear, &stages.strain) {
                (RunStage::Shear, Some(walls), _) => parts.add_shear(walls, is_done),
                (RunStage::Strain, _, Some(strain)) => parts.add_strain(strain, is_done),
                (RunStage::Newtonian, _, Some(strain)) => parts.add_newtonian(strain),
                _ => {}
            }
        }
        parts.files.push(checkpoints(scene, parts.checkpoints));
        parts
    }

    /// The shear, and what packs its sample.
    fn add_shear(&mut self, walls: &PlaneShear, is_done: bool) {
        let (scene, header) = (self.scene, self.header);
        let sample = &scene.sample;
        let packs = match header {
            Some(header) => matches!(header, Header::Pack(_)),
            None => !walls.pack.skip,
        };
        let known = match header {
            Some(Header::Shear(shear)) => Some(shear.height),
            _ => None,
        };
        let packed = match &walls.origin {
            Origin::Packing(file) if walls.pack.skip => file.height(),
            Origin::StageBefore { height } => *height,
            _ => dense_height(scene),
        };
        let height = known.unwrap_or_else(|| height_between(walls, sample, packed));
        let schedule = Schedule::new(scene, walls, height);
        let done = match header {
            Some(header @ (Header::Pack(_) | Header::Shear(_))) => header.step(),
            _ => 0,
        };
        if packs {
            let guess = packing_steps(scene, &walls.load).min(walls.pack.max_steps as f64) as u64;
            let steps = guess.saturating_sub(done).max(guess / 10);
            self.stages.push(StageEstimate::moving(PACK, steps, false));
        }
        let last = schedule.total.min(self.last);
        self.last -= last;
        let counts = schedule.counts(last);
        let left = last.saturating_sub(if packs { 0 } else { done });
        let share = left as f64 / last.max(1) as f64;
        let frames = counts.frames as f64 * frame_bytes(scene);
        // A velocity becomes a strain by the height, which is that of the packed sample.
        let by_velocity = matches!(
            &walls.shear.motion,
            Motion::Strain {
                drive: WallSpeed::Velocity(_),
                ..
            }
        );
        let exact = !by_velocity || known.is_some() || last < schedule.total;
        if !is_done && last > 0 {
            self.stages.push(StageEstimate {
                output: (frames * share, (counts.rows as f64 * share) as u64),
                ..StageEstimate::moving(RunStage::Shear.name(), left, exact)
            });
        }
        let columns = schedule.columns.len();
        let name = part_of(&scene.stages, RunStage::Shear);
        let run = file_of(scene, name, counts.frames, counts.rows, columns);
        let log = FileEstimate {
            name: LOG_FILE,
            bytes: NUMBER * (schedule.log_columns.len() + 1) as f64 * counts.rows as f64,
            compressed: None,
            content: format!("{} rows", counts.rows),
        };
        self.files.extend([run, log]);
        let kept = if scene.keep_checkpoints {
            counts.checkpoints + 1
        } else {
            2.min(counts.checkpoints)
        };
        self.checkpoints = self.checkpoints.max(kept);
    }

    /// The strain steps, and what prepares their sample.
    fn add_strain(&mut self, quasi_static: &QuasiStatic, is_done: bool) {
        let scene = self.scene;
        let strained = match self.header {
            Some(Header::Strain(strain)) => Some(strain.progress.steps),
            _ if is_done => Some(quasi_static.aqs.steps),
            _ => None,
        };
        if strained.is_none() && matches!(quasi_static.origin, Origin::Insertion(_)) {
            let steps = prepare::steps(scene, quasi_static);
            self.stages
                .push(StageEstimate::moving(PREPARE, steps, false));
        }
        let aqs = &quasi_static.aqs;
        let steps = aqs.steps.min(self.last);
        self.last -= steps;
        let frames = StrainSchedule::new(aqs).frames_up_to(steps);
        let strains = steps.saturating_sub(strained.unwrap_or(0));
        let searches = searches(scene, quasi_static, strained);
        if strains > 0 || searches > 0.0 {
            self.stages.push(StageEstimate {
                name: RunStage::Strain.name(),
                steps: strains,
                // Ends earlier with the growth of a pair.
                exact: aqs.until_imaginary == 0.0,
                moves: false,
                searches,
                output: (frames as f64 * frame_bytes(scene), steps),
            });
        }
        let columns = AqsRow::COLUMNS.len();
        let name = part_of(&scene.stages, RunStage::Strain);
        let file = file_of(scene, name, frames, steps + 1, columns);
        self.files.push(file);
        self.checkpoints = self.checkpoints.max(2);
    }

    /// Newton's equations after strain steps.
    fn add_newtonian(&mut self, strain: &QuasiStatic) {
        let (scene, header) = (self.scene, self.header);
        let Some(newtonian) = &scene.stages.newtonian else {
            return;
        };
        if self.last == 0 {
            return;
        }
        let (moved, pair) = match header {
            Some(Header::Strain(strain)) => (0, strain.progress.pair),
            Some(Header::Newtonian(newtonian)) => (newtonian.step, newtonian.progress.pair),
            _ => (0, None),
        };
        // A complex pair, which the strain steps may find, decides how many.
        let may_differ = strain.aqs.spectrum && !matches!(header, Some(Header::Newtonian(_)));
        let all = steps_of_newtonian(newtonian, pair.as_ref(), scene.time_step.step);
        let steps = all.min(self.last);
        let share = steps as f64 / all.max(1) as f64;
        let [frames, rows] =
            [newtonian.frames, newtonian.rows].map(|count| (count as f64 * share) as u64);
        let rows = rows + dense_rows(pair.as_ref(), scene.time_step.step, steps);
        let left = steps.saturating_sub(moved);
        self.stages.push(StageEstimate {
            output: (frames as f64 * frame_bytes(scene), rows),
            ..StageEstimate::moving(RunStage::Newtonian.name(), left, !may_differ)
        });
        let columns = NewtonianRow::COLUMNS.len();
        let file = file_of(scene, NEWTONIAN_PART, frames + 1, rows + 1, columns);
        self.files.push(file);
    }
}

/// Relaxations in which a box is brought to its pressures after `strained` strain steps, as a
/// guess: lengths change from where grains are loose to where they are dense, and then by the
/// overlaps that the pressures need. Those of every strain step are in its time.
fn searches(scene: &Scene, quasi_static: &QuasiStatic, strained: Option<u64>) -> f64 {
    let pressures = match (&quasi_static.deformation, quasi_static.pressure, strained) {
        (Deformation::Compression(pressures), ..) => {
            let done = (strained.unwrap_or(0) as usize).min(pressures.len());
            pressures[done..].to_vec()
        }
        (_, Some(pressure), None) => vec![pressure],
        _ => Vec::new(),
    };
    let axes = scene.dimension.axes() as f64;
    let sample = &scene.sample;
    let fraction = quasi_static.solid_fraction / DENSE[index(scene)];
    // The logarithm of the length over that of a dense packing.
    let mut length = if strained.is_none() {
        -fraction.ln() / axes
    } else {
        0.0
    };
    let mut searches = 0.0;
    for pressure in pressures {
        // δ̄/d̄, by which a dense packing is shorter at this pressure.
        let kappa = derived::stiffness_number(&scene.law, sample, pressure);
        let overlap = kappa.map_or(0.0, |kappa| 1.0 / kappa);
        let change = (length + overlap).abs();
        searches += change / quasi_static.aqs.pressure_step;
        length = -overlap;
    }
    searches
}

fn checkpoints(scene: &Scene, count: u64) -> FileEstimate {
    let one = checkpoint_bytes(scene);
    FileEstimate {
        name: "checkpoints",
        bytes: one * count as f64,
        compressed: None,
        content: format!("{count} of {}", bytes(one)),
    }
}

/// H of a sample of this height with its walls (m).
pub(crate) fn height_between(walls: &PlaneShear, sample: &Sample, height: f64) -> f64 {
    (height - walls.thickness_of_walls(sample)).max(sample.mean_diameter)
}

/// Height of a dense sample with its walls (m).
pub(crate) fn dense_height(scene: &Scene) -> f64 {
    let sample = &scene.sample;
    f64::from(sample.grains) * sample.mean_volume / sample.base() / DENSE[index(scene)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_sizes_are_words() {
        let times = [(0.2, true), (0.2, false), (62.0, true), (62.0, false)];
        let times = times.map(|(seconds, moves)| about(seconds, moves));
        let least = "less than 1s";
        assert_eq!(times, [least, least, "about 1m 2s", "very roughly 1m 2s"]);
        let sizes = [0.0, 12.0, 1.5e3, 2e7, 3e9, 4.2e12, 1.6e15, 2e19].map(bytes);
        let wanted = [
            "0 B", "12 B", "1.5 KB", "20 MB", "3.0 GB", "4.2 TB", "1.6 PB", "20000 PB",
        ];
        assert_eq!(sizes, wanted);
    }
}
