//! The header of a checkpoint: everything but grains and contacts.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use gshear_dem::budget::SavedBudget;
use gshear_dem::columns::Column;
use gshear_dem::dimension::{Dimension, Dimensions, Three, Two};
use gshear_dem::drive::{LateralState, Piston, SliderState};
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::{Cell, Sheared, Snapshot};
use gshear_dem::until::Checks;
use gshear_mpi_exchange::Parallel;
use gshear_scene::schedule::Schedule;
use gshear_scene::{Origin, PackingFile, RunStage, Sample, Scene, Source, Stages};
use gshear_store::box_columns::strain_columns;
use gshear_store::checkpoint;
use gshear_store::file_names::part_of;
use gshear_store::run_reader::series_columns;

use crate::run_record::RunRecord;
use crate::stages::{PACK, PREPARE};

/// Fields of the header with the record of the run, and with the file that the grains came from.
const RECORD: &str = "run";
const PACKING: &str = "packing";

/// The progress of a run: the stage, and the data with which it resumes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "stage", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Header {
    /// Compression between smooth planes.
    Pack(PackHeader),
    /// Shear at a rate.
    Shear(ShearHeader),
    /// The preparation of a cell that has failed, from which no run goes on.
    Prepare(PrepareHeader),
    /// Quasi-static strain steps.
    #[serde(rename = "aqs")]
    Strain(StrainHeader),
    /// Newton's equations.
    Newtonian(NewtonianHeader),
}

/// A stage, and its completed steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Position {
    /// Name of the stage.
    pub stage: &'static str,
    /// Completed steps.
    pub step: u64,
}

impl std::fmt::Display for Position {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} step {}", self.stage, self.step)
    }
}

/// The last box of a failed preparation in which the grains came to rest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PrepareHeader {
    /// Boxes so far.
    pub step: u64,
    /// The length of the box.
    pub length: f64,
}

/// How strain steps go on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StrainHeader {
    /// Steps of the stages before.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub before: u64,
    /// The progress of the strain steps.
    pub progress: StrainProgress,
    /// Number of frames and rows in the files.
    pub written: Written,
    /// What goes on after the last strain step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unfinished: Option<Unfinished>,
}

/// How Newton's equations go on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NewtonianHeader {
    /// Steps done.
    pub step: u64,
    /// From where their time counts.
    #[serde(default, skip_serializing_if = "TimeOrigin::is_start")]
    pub origin: TimeOrigin,
    /// Steps of the stages before the strain steps.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub before: u64,
    /// The progress of the strain steps before.
    pub progress: StrainProgress,
    /// Number of frames and rows in the files.
    pub written: Written,
    /// Number of lines in the file of eigenvalues.
    pub lines: u64,
}

impl NewtonianHeader {
    /// The start after the strain steps, and so many steps of the stages before these.
    pub(crate) fn after(before: u64, progress: &StrainProgress) -> Self {
        Self {
            step: 0,
            origin: TimeOrigin::default(),
            before,
            progress: *progress,
            written: Written::default(),
            lines: 0,
        }
    }
}

/// How a packing goes on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PackHeader {
    /// Steps done.
    pub step: u64,
    /// The top.
    pub piston: Piston,
    /// Drag (1/s).
    pub drag: f64,
    /// Starts before this one, each of which left the contact law before it bore the load.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub starts: u32,
}

/// How a shear goes on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShearHeader {
    /// Steps done.
    pub step: u64,
    /// From where their time counts.
    #[serde(default, skip_serializing_if = "TimeOrigin::is_start")]
    pub origin: TimeOrigin,
    /// Steps of the stages before.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub before: u64,
    /// Lengths of the cell (m; the second is 1 in 2D) in which strain steps left the sample, if
    /// they came before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left_in: Option<[f64; 3]>,
    /// The top.
    pub piston: Piston,
    /// `None` before the first step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slider: Option<SliderState>,
    /// H (m).
    pub height: f64,
    /// Of a cell without walls: the Lees–Edwards offset (m) and the velocity of the images (m/s).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub images: Option<[f64; 2]>,
    /// The lengths of a cell without walls across its height, if they change.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lateral: Option<LateralState>,
    /// The parts of the protocol that a condition has ended.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ends: Vec<PartEnd>,
    /// The checks of the present part so far.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub checks: Option<Checks>,
    /// Number of frames and rows in the files.
    pub written: Written,
    /// The energy budget, if the scene has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub energy_budget: Option<SavedBudget>,
}

/// A part of a protocol that a condition has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartEnd {
    /// Its number, from 0.
    pub part: usize,
    /// Steps that it had.
    pub steps: u64,
}

impl ShearHeader {
    /// A schedule in which the parts end that conditions have ended. A part that it does not have
    /// any more is left out.
    pub(crate) fn with_ends(&self, mut schedule: Schedule) -> Schedule {
        let parts = schedule.protocol.segments().len();
        for end in self.ends.iter().filter(|end| end.part < parts) {
            schedule.end_part(end.part, end.steps);
        }
        schedule
    }

    /// The cell of this sample.
    pub fn cell(&self, sample: &Sample) -> Cell {
        let sheared = self.images.map(|[offset, velocity]| Sheared {
            offset,
            velocity,
            half_velocity: velocity,
            ..Sheared::upright(self.piston.height)
        });
        let cell = Cell {
            sheared,
            ..sample.cell()
        };
        match &self.lateral {
            Some(lateral) => lateral.in_cell(cell),
            None => cell,
        }
    }

    /// The heights (m) of the flat walls of this shear; infinite for a top that is not there.
    pub fn planes(&self, scene: &Scene) -> Option<[f64; 2]> {
        let walls = scene.shear()?;
        let step = self.slider.map_or(0, |slider| slider.step);
        let schedule = self.with_ends(Schedule::new(scene, walls, self.height));
        let [_, rise] = schedule.protocol.bottom(step);
        let floor = walls.floor();
        let heights = [floor + rise, floor + self.piston.height];
        walls.boundary.planes(heights)
    }
}

/// Whether a number is 0, as serde asks.
fn is_zero<N: Default + PartialEq>(number: &N) -> bool {
    *number == N::default()
}

impl Header {
    /// Parses the text of the header of a checkpoint, the record of its run, and the file that the
    /// grains came from.
    ///
    /// # Errors
    /// A header of another version of this program.
    pub fn parse(checkpoint: &Path, text: &str) -> Result<(Self, RunRecord, Option<PackingFile>)> {
        Self::parse_fields(text).map_err(|e| {
            Failure::input(format!(
                "{}: the header of the checkpoint cannot be read: {e}; resume with the version that wrote it",
                checkpoint.display()
            ))
        })
    }

    fn parse_fields(text: &str) -> serde_json::Result<(Self, RunRecord, Option<PackingFile>)> {
        let mut fields: Map<String, Value> = serde_json::from_str(text)?;
        let record = fields.remove(RECORD).unwrap_or_default();
        let packing = fields.remove(PACKING).unwrap_or_default();
        let header = serde_json::from_value(Value::Object(fields))?;
        let record = serde_json::from_value(record)?;
        Ok((header, record, serde_json::from_value(packing)?))
    }

    /// The text of the header, with the record of its run, and the file that the grains came from.
    ///
    /// # Panics
    /// If a number is not finite.
    pub fn text(&self, record: &RunRecord, packing: Option<&PackingFile>) -> String {
        let mut fields = serde_json::to_value(self).expect("a header of finite numbers");
        fields[RECORD] = serde_json::to_value(record).expect("texts and counts");
        if let Some(file) = packing {
            fields[PACKING] = serde_json::to_value(file).expect("finite numbers");
        }
        fields.to_string()
    }

    /// The stage, if it writes frames.
    pub fn run_stage(&self) -> Option<RunStage> {
        match self {
            Header::Pack(_) | Header::Prepare(_) => None,
            Header::Shear(_) => Some(RunStage::Shear),
            Header::Strain(_) => Some(RunStage::Strain),
            Header::Newtonian(_) => Some(RunStage::Newtonian),
        }
    }

    /// The stage and its completed steps.
    pub fn position(&self) -> Position {
        let (stage, step) = match self {
            Header::Pack(pack) => (PACK, pack.step),
            Header::Prepare(prepare) => (PREPARE, prepare.step),
            Header::Shear(shear) => (RunStage::Shear.name(), shear.step),
            Header::Strain(strain) => (RunStage::Strain.name(), strain.progress.steps),
            Header::Newtonian(newtonian) => (RunStage::Newtonian.name(), newtonian.step),
        };
        Position { stage, step }
    }

    /// The name of the stage.
    pub fn stage(&self) -> &'static str {
        self.position().stage
    }

    /// Completed steps of the stage.
    pub fn step(&self) -> u64 {
        self.position().step
    }

    /// Number by which `--stop-at` counts the last step: those of all stages that write a time
    /// series, one after the other.
    pub(crate) fn counted_steps(&self) -> u64 {
        match self {
            Header::Pack(_) | Header::Prepare(_) => 0,
            Header::Shear(shear) => shear.before + shear.step,
            Header::Strain(strain) => strain.before + strain.progress.steps,
            Header::Newtonian(newtonian) => {
                newtonian.before + newtonian.progress.steps + newtonian.step
            }
        }
    }

    /// The progress of the strain steps, in or after these.
    pub(crate) fn strain_progress(&self) -> Option<&StrainProgress> {
        match self {
            Header::Pack(_) | Header::Shear(_) | Header::Prepare(_) => None,
            Header::Strain(strain) => Some(&strain.progress),
            Header::Newtonian(newtonian) => Some(&newtonian.progress),
        }
    }

    /// The file of frames that the stage continues; `None` before there is one, and of a checkpoint
    /// with which a stage begins, which makes its files anew.
    pub(crate) fn continued_file(&self, stages: &Stages) -> Option<ContinuedFile<'_>> {
        if self.step() == 0 {
            return None;
        }
        let stage = self.run_stage()?;
        let written = match self {
            Header::Pack(_) | Header::Prepare(_) => return None,
            Header::Shear(shear) => &shear.written,
            Header::Strain(strain) => &strain.written,
            Header::Newtonian(newtonian) => &newtonian.written,
        };
        Some(ContinuedFile {
            name: part_of(stages, stage),
            columns: match (stage, &stages.strain) {
                (RunStage::Strain, Some(strain)) => {
                    strain_columns(strain.deformation.is_protocol())
                }
                _ => series_columns(stage),
            },
            written,
        })
    }

    /// The cell of its state.
    pub fn cell<D: Dimension>(&self, sample: &Sample) -> Cell {
        match self {
            Header::Pack(_) => sample.cell(),
            Header::Shear(shear) => shear.cell(sample),
            Header::Prepare(prepare) => sample.box_cell(prepare.length),
            Header::Strain(StrainHeader {
                unfinished: Some(unfinished),
                ..
            }) => unfinished.shape.cell::<D>(sample),
            Header::Strain(strain) => strain.progress.cell::<D>(sample),
            Header::Newtonian(newtonian) => newtonian.progress.cell::<D>(sample),
        }
    }

    /// [`Self::cell`] in the dimension of the scene.
    pub fn cell_in(&self, scene: &Scene) -> Cell {
        match scene.dimension {
            Dimensions::Two => self.cell::<Two>(&scene.sample),
            Dimensions::Three => self.cell::<Three>(&scene.sample),
        }
    }
}

/// A checkpoint that was read.
#[derive(Debug, Clone)]
pub struct Saved {
    /// Its path.
    pub path: PathBuf,
    /// Stage, step, walls and what was written so far.
    pub header: Header,
    /// The identity and history of the run.
    pub record: RunRecord,
    /// The file that the grains came from; resuming does not read it.
    pub packing: Option<PackingFile>,
    /// The scene as TOML.
    pub toml: String,
    /// This rank's part of the state.
    pub state: Snapshot,
}

impl Saved {
    /// Reads a checkpoint. Collective.
    ///
    /// # Errors
    /// Those of [`checkpoint::read`], and a header of another version of this program.
    pub fn read(exchange: &dyn Parallel, path: &Path) -> Result<Self> {
        let ([header, toml], state) = checkpoint::read(exchange, path)?;
        let (header, record, packing) = Header::parse(path, &header)?;
        Ok(Self {
            path: path.into(),
            header,
            record,
            packing,
            toml,
            state,
        })
    }

    /// The scene with overrides. Does not read the file of the packing.
    ///
    /// # Errors
    /// An override that contradicts the scene, or changes its grains.
    pub fn scene(&self, set: &[String]) -> Result<Scene> {
        let name = format!("{} (its scene)", self.path.display());
        let source = Source::new(name, self.toml.clone());
        let mut scene =
            gshear_scene::load_with(&source, set, &mut |paths, how| match &self.packing {
                Some(file) if file.is_at(paths) && how.copies.starts_with(&file.replicate) => {
                    Ok(file.clone())
                }
                _ => Err(Failure::input(
                    "the grains are those of the checkpoint; leave it as it was",
                )),
            })?;
        if let (Some(progress), Some(strain)) =
            (self.header.strain_progress(), scene.stages.first_strain())
            && let Origin::Insertion(_) = strain.origin
        {
            let length = progress.length.unwrap_or(scene.sample.length);
            scene.sample = scene.sample.in_box(scene.dimension, length);
        }
        if let Header::Shear(ShearHeader {
            left_in: Some(lengths),
            ..
        }) = &self.header
        {
            scene = scene.in_cell(*lengths);
        }
        Ok(scene)
    }
}

/// The step and the time (s) from which a stage counts its time: those of its start, or of a branch
/// with another time step.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeOrigin {
    /// The step.
    pub step: u64,
    /// Its time (s).
    pub time: f64,
}

impl TimeOrigin {
    /// The time (s) after so many steps of Δt = `time_step` (s).
    pub fn time(&self, step: u64, time_step: f64) -> f64 {
        self.time + (step as f64 - self.step as f64) * time_step
    }

    /// Whether it is the start of the stage.
    pub(crate) fn is_start(&self) -> bool {
        *self == Self::default()
    }
}

/// The number of frames and rows in the files of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Written {
    /// Frames.
    pub frames: u64,
    /// Rows of the time series.
    pub rows: u64,
    /// Rows of the scalars of frames.
    #[serde(default)]
    pub scalars: u64,
}

impl Written {
    /// Frames, rows and rows of scalars.
    pub(crate) fn counts(&self) -> [u64; 3] {
        [self.frames, self.rows, self.scalars]
    }
}

/// The file of frames and time series, or its part, that a resumed stage continues.
pub(crate) struct ContinuedFile<'a> {
    /// Its name in the folder of the run.
    pub name: &'static str,
    /// The columns of its time series.
    pub columns: &'static [Column],
    /// What it holds up to the checkpoint.
    pub written: &'a Written,
}

/// What the files of a resumed stage hold up to its checkpoint.
#[derive(Debug, Clone, Copy)]
pub(crate) struct UpToCheckpoint {
    /// Steps at the checkpoint; 0 of a stage that begins.
    pub step: u64,
    /// The last step whose frame and row stay; `None`: none stays.
    pub last: Option<u64>,
}

impl UpToCheckpoint {
    /// After this step. A stage without steps begins anew and writes the row of step 0 again.
    pub fn new(step: u64) -> Self {
        Self {
            step,
            last: (step > 0).then_some(step),
        }
    }
}

/// The progress of the strain steps.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct StrainProgress {
    /// Number of completed strain steps.
    pub steps: u64,
    /// Lees–Edwards offset: displacement of the image above along x.
    pub offset: f64,
    /// Length of the box.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length: Option<f64>,
    /// The lengths of the box and how it came to them, if they change.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stretched: Option<Stretched>,
    /// The birth of the first complex pair; `None` before it.
    pub birth: Option<Birth>,
    /// Complex pairs after the last strain step.
    pub pairs: u64,
    /// The pair of the greatest |Im λ|.
    pub pair: Option<Pair>,
    /// Strain steps that fell back to overdamped dynamics.
    pub fell_back: u64,
}

impl StrainProgress {
    /// The box of this sample.
    pub fn cell<D: Dimension>(&self, sample: &Sample) -> Cell {
        let lengths = match self.stretched {
            Some(stretched) => stretched.lengths,
            None => sample.box_cell(sample.length).lengths::<D>(),
        };
        let shape = Shape {
            lengths,
            offset: self.offset,
        };
        shape.cell::<D>(sample)
    }

    /// What a digest contains of the box.
    pub(crate) fn box_bytes(&self) -> Vec<u8> {
        let lengths = self
            .stretched
            .iter()
            .flat_map(|stretched| stretched.lengths);
        let numbers = std::iter::once(self.offset).chain(lengths);
        numbers.flat_map(f64::to_le_bytes).collect()
    }
}

/// The shape of a box.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Shape {
    /// Lengths along the axes.
    pub lengths: [f64; 3],
    /// Lees–Edwards offset.
    pub offset: f64,
}

impl Shape {
    /// The shape of a cell.
    pub fn of<D: Dimension>(cell: &Cell) -> Self {
        Self {
            lengths: cell.lengths::<D>(),
            offset: cell.sheared.map_or(0.0, |sheared| sheared.offset),
        }
    }

    /// The box of this sample.
    pub fn cell<D: Dimension>(&self, sample: &Sample) -> Cell {
        let mut cell = sample
            .box_cell(sample.length)
            .with_lengths::<D>(self.lengths);
        if let Some(sheared) = &mut cell.sheared {
            sheared.offset = self.offset;
        }
        cell
    }
}

/// A strain step that is not finished, or what comes before and after strain steps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Unfinished {
    /// The box.
    pub shape: Shape,
    /// The boxes of the states that the checkpoint holds.
    pub held: Vec<Shape>,
    /// What is done.
    pub work: Work,
}

/// The relaxation that goes on, and what it is for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Work {
    /// Whether it comes before the first strain step.
    pub prepares: bool,
    /// Of the relaxations that are done.
    #[serde(rename = "found")]
    pub statistics: RelaxationStatistics,
    /// The one that goes on.
    pub relaxing: Relaxing,
    /// What follows it.
    pub search: Search,
}

impl Work {
    /// Whether it is a strain step.
    pub(crate) fn is_step(&self) -> bool {
        !self.prepares && !matches!(self.search, Search::Birth { .. })
    }
}

/// A relaxation that goes on.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Relaxing {
    /// Of what was done so far.
    #[serde(rename = "found")]
    pub statistics: RelaxationStatistics,
    /// Contacts that Newton's method has opened so far; `None`: overdamped dynamics. The state
    /// before Newton's method is the last one held.
    pub opened: Option<Vec<[u32; 2]>>,
}

/// Statistics of a relaxation, or of several.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct RelaxationStatistics {
    /// Factorisations of K.
    pub factorisations: u64,
    /// Steps of overdamped dynamics.
    pub steps: u64,
    /// Whether overdamped dynamics was needed because Newton's method did not converge.
    pub fell_back: bool,
}

impl std::ops::AddAssign for RelaxationStatistics {
    fn add_assign(&mut self, other: Self) {
        self.factorisations += other.factorisations;
        self.steps += other.steps;
        self.fell_back |= other.fell_back;
    }
}

/// What follows a relaxation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Search {
    /// Nothing.
    Rest,
    /// The next trial on the way to a pressure.
    Pressure(Pressing),
    /// The next correction of stresses.
    Stresses(Correction),
    /// The next bisection of the birth of a pair, between these strains after the last but one
    /// strain step. The states at the lower one and after the last strain step are held.
    Birth {
        /// Without a pair.
        low: f64,
        /// With one.
        high: f64,
    },
}

/// The way to a pressure. The packing from which a trial starts is held.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pressing {
    /// The pressure that is to be reached.
    pub wanted: f64,
    /// 1 if the box shrinks, -1 if it grows.
    pub toward: f64,
    /// The pressure of the packing from which the trial starts.
    pub pressure: f64,
    /// Relative change of the lengths in the trial.
    pub change: f64,
    /// Change of the pressure by that of the lengths, in the last trial before the wanted one.
    pub slope: Option<f64>,
    /// The nearest packing beyond the wanted pressure.
    pub beyond: Option<Beyond>,
}

/// A pressure beyond the wanted one, at this relative change of the lengths from the packing that
/// is kept.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Beyond {
    /// The change of the lengths.
    pub change: f64,
    /// `None`: outside the contact law.
    pub pressure: Option<f64>,
}

/// The search for the lengths at which up to three stresses have their wanted values. Each array
/// has a value for each stress; the rest is 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Correction {
    /// Corrections so far.
    pub count: usize,
    /// The stresses that are to be reached.
    pub wanted: [f64; 3],
    /// Changes of the logarithms of the lengths so far.
    pub total: [f64; 3],
    /// Those of the last correction.
    pub by: [f64; 3],
    /// By how much the stresses fall with the logarithms of the lengths.
    pub moduli: Moduli,
    /// The stresses before the last correction, less the wanted ones; `None` before the first.
    pub excess: Option<[f64; 3]>,
}

/// Moduli: by how much stresses fall with the logarithms of lengths, a row for each stress.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Moduli(pub [[f64; 3]; 3]);

/// A box whose lengths change.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Stretched {
    /// Along the axes; 1 along one that two dimensions lack.
    pub lengths: [f64; 3],
    /// Those before the first strain step.
    pub initial: [f64; 3],
    /// Of a protocol the sum over the strain steps of the greatest change of γ or of the logarithm
    /// of a length.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub accumulated_strain: f64,
    /// The result of the search for stresses in the last strain step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corrected: Option<Corrected>,
}

/// The result of a search for stresses.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Corrected {
    /// As last measured.
    pub moduli: Moduli,
    /// Of each control the change of the logarithms of the lengths.
    pub strain: [f64; 3],
}

impl Stretched {
    /// The part by which the volume has decreased.
    pub(crate) fn volume_strain<D: Dimension>(&self) -> f64 {
        let parts = self.lengths.iter().zip(self.initial).take(D::AXES);
        1.0 - parts.map(|(now, then)| now / then).product::<f64>()
    }

    /// Before the first strain step.
    pub fn new(lengths: [f64; 3]) -> Self {
        Self {
            lengths,
            initial: lengths,
            accumulated_strain: 0.0,
            corrected: None,
        }
    }
}

/// The birth of the first complex pair: the strains between which it appears.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Birth {
    /// γ of the last state without a pair.
    pub before: f64,
    /// γ of the first state with one.
    pub after: f64,
}

/// A complex pair λ_r ± iλ_i, and ω_r ± iω_i = √λ (BO eq. 8).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pair {
    /// Real part of λ.
    pub lambda_r: f64,
    /// |Im λ|.
    pub lambda_i: f64,
    /// Real part of √λ.
    pub omega_r: f64,
    /// Imaginary part of √λ: the growth rate.
    pub omega_i: f64,
}

impl Pair {
    /// The pair λ_r ± i|λ_i|.
    pub fn new(lambda_r: f64, lambda_i: f64) -> Self {
        let lambda_i = lambda_i.abs();
        let root = faer::c64::new(lambda_r, lambda_i).sqrt();
        Self {
            lambda_r,
            lambda_i,
            omega_r: root.re,
            omega_i: root.im,
        }
    }
}
