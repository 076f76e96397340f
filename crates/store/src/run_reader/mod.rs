//! Reads `run.h5` (docs/reference/file-formats.md) serially, by blocks of frames, so that memory
//! does not grow with the length of the run.

mod frames;
mod open_file;
mod owner;
mod state;
mod verify;

use std::collections::BTreeMap;
use std::fmt::Display;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use hdf5::Dataset;

pub use self::open_file::is_hdf5;
pub(crate) use self::open_file::one_line;
use self::open_file::{FOREIGN, OpenFile, TablePlace};
pub use self::owner::{Owner, owner};
use self::verify::FrameSums;
use crate::box_columns::{AqsRow, NewtonianRow, StrainProtocolRow, strain_columns};
use crate::checksums;
use crate::contact_quantities::{AGE, IDLE, TANGENTIAL_HISTORY, TWISTING};
use crate::file_names::{RUN_FILE, folder_of};
use crate::layout::{
    ContactTable, FrameFormat, IMAGE, OBSERVABLES, PARTICLES, REMOVED, contact_dataset, elements,
    grain_dataset, of_grain,
};
pub use crate::parameter::{Parameter, Parameters};
use crate::part;
use crate::sound::ReadFile;
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_analysis::interval::Interval;
use gshear_analysis::time_mean::{self, RATIO_COLUMNS, TimeMean};
use gshear_dem::boundary::Boundary;
use gshear_dem::columns::Column;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::{BoxEdges, Cell, Frame, GrainConstants, SeriesRow, Sheared};
pub use gshear_scene::RunStage;
use gshear_scene::schedule::Schedule;
use gshear_scene::{Dimensions, PackingPaths, ReadPacking, Source};

/// Columns of the time series of a stage that all its runs have.
pub fn series_columns(stage: RunStage) -> &'static [Column] {
    match stage {
        RunStage::Shear => &SeriesRow::COLUMNS,
        RunStage::Strain => &AqsRow::COLUMNS,
        RunStage::Newtonian => &NewtonianRow::COLUMNS,
    }
}

/// The stage whose columns a file has; [`RunStage::Shear`] if none fits, so that messages name the
/// columns of that.
fn stage_of(source: &OpenFile<'_>) -> RunStage {
    let stages = [RunStage::Newtonian, RunStage::Strain];
    let stage = stages.into_iter().find(|stage| {
        let mut columns = series_columns(*stage).iter();
        columns.all(|column| source.exists(&format!("{OBSERVABLES}/{column}")))
    });
    stage.unwrap_or(RunStage::Shear)
}

/// The time series: L rows, as many as every column has.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Series {
    /// What the columns are.
    pub declared: &'static [Column],
    /// `[L]` Steps since the start of the stage.
    pub step: Vec<u64>,
    /// `[L]` Time (s); strain in the stage of strain steps.
    pub time: Vec<f64>,
    /// `[columns][L]` Values.
    pub columns: Vec<Vec<f64>>,
}

impl Series {
    /// Returns a column by its name, `[L]`.
    ///
    /// # Panics
    /// On a name that is not declared.
    pub fn column(&self, name: &str) -> &[f64] {
        let mut columns = self.declared.iter();
        let at = columns.position(|column| column.name == name);
        &self.columns[at.unwrap_or_else(|| panic!("{name} is no column of the time series"))]
    }

    /// Returns whether there is a column of this name.
    pub fn has(&self, name: &str) -> bool {
        self.declared.iter().any(|column| column.name == name)
    }

    /// Returns the number of rows L.
    pub fn rows(&self) -> usize {
        self.step.len()
    }

    /// Returns the weights of the rows from `first` on in a mean over time.
    pub fn weights(&self, first: usize) -> Vec<f64> {
        time_mean::durations(&self.time, first)
    }

    /// Returns the mean of a column over the rows from `first` on; of a ratio such as τ that of the
    /// means of what is divided. Rows weigh by their time.
    ///
    /// # Panics
    /// On a name that is not declared.
    pub fn mean(&self, name: &str, first: usize) -> TimeMean {
        let weights = self.weights(first);
        match RATIO_COLUMNS.iter().find(|columns| columns.ratio == name) {
            Some(columns) => {
                let [numerator, denominator] =
                    [columns.numerator, columns.denominator].map(|name| self.column(name));
                TimeMean::of_ratio(&numerator[first..], &denominator[first..], &weights)
            }
            None => TimeMean::of(&self.column(name)[first..], &weights),
        }
    }
}

/// Which fields of a frame are read. Other fields of the grains and of the contacts are 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd)]
pub enum FrameFields {
    /// Positions and ids of the contacts: enough for D²min.
    Pairs,
    /// The forces as well: enough for the scalars of a frame.
    Forces,
    /// Everything.
    All,
}

/// Scalars computed by the run itself, `observables/gshear/`; row k is between the rows k-1 and k.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredScalars {
    /// `[L]` Steps since the start of the shear.
    pub step: Vec<u64>,
    /// `[L]` Scalars.
    pub scalars: Vec<FrameScalars>,
}

/// An open file of a run. Frames are read on demand, everything else on opening.
pub struct RunFile {
    path: PathBuf,
    stage: RunStage,
    grains: GrainConstants,
    ids: Vec<u32>,
    /// Of the grains.
    material: Vec<u8>,
    /// Box at the start of the shear (m): L_x, height in 2D; L_x, L_y, height in 3D.
    edges: [f64; 3],
    dimension: Dimensions,
    form: FrameFormat,
    boundary: &'static Boundary,
    parameters: Parameters,
    series: Series,
    scalars: Option<StoredScalars>,
    step: Vec<u64>,
    time: Vec<f64>,
    /// `[T]` Edges of the box.
    boxes: Vec<BoxEdges>,
    position: Dataset,
    velocity: Dataset,
    angular_velocity: Dataset,
    image: Dataset,
    /// In scenes that remove grains.
    removed: Option<Dataset>,
    /// Of [`ContactTable::of`].
    contacts: Vec<StoredContacts>,
    sums: FrameSums,
    /// Closed when all its datasets are.
    _file: Arc<ReadFile>,
}

/// A table of the contacts of all frames.
struct StoredContacts {
    table: ContactTable,
    /// `[T+1]` Rows of the first contacts of the frames.
    offset: Vec<u64>,
    /// Of [`crate::layout::of_contact`], by name.
    columns: BTreeMap<&'static str, Dataset>,
}

impl StoredContacts {
    /// Rows of the contacts of some frames.
    fn rows(&self, frames: Range<usize>) -> Range<usize> {
        self.offset[frames.start] as usize..self.offset[frames.end] as usize
    }

    /// Number of frames whose contacts every dataset has.
    fn whole_frames(&self) -> usize {
        let stored = self.columns.values().map(rows).min().unwrap_or(0) as u64;
        let whole = self.offset.iter().take_while(|&&end| end <= stored);
        whole.count().saturating_sub(1)
    }
}

impl RunFile {
    /// Opens the shear of a run: a `run.h5`, or the folder that holds one; where another stage came
    /// before it, its part `run.h5/shear`.
    ///
    /// A run that was stopped early is read as far as all of its datasets go.
    ///
    /// # Errors
    /// [`Failure::Input`] that names the file and the object that is missing, damaged or of the
    /// wrong shape; a file of another stage.
    pub fn open(run: &Path) -> Result<Self> {
        let file = Self::open_any(run)?;
        if file.stage == RunStage::Shear {
            return Ok(file);
        }
        match file.part(RunStage::Shear)? {
            Some(shear) => Ok(shear),
            None => Err(file.wrong(format!(
                "is of the stage {}; this command needs a shear at a rate ([shear] of a scene)",
                file.stage.name()
            ))),
        }
    }

    /// Opens the shear of a run between walls.
    ///
    /// # Errors
    /// As of [`RunFile::open`], and a cell without walls.
    pub fn open_between_walls(run: &Path) -> Result<Self> {
        let file = Self::open_sheared(run)?;
        if file.boundary.has_walls() {
            return Ok(file);
        }
        Err(file.wrong(format!(
            "has no walls (sample.boundary = {:?}); this command needs a run between walls",
            file.boundary.key
        )))
    }

    /// Opens `run.h5` of a sample that is sheared: between walls, or without them.
    ///
    /// # Errors
    /// As of [`RunFile::open`], and a free surface.
    pub fn open_sheared(run: &Path) -> Result<Self> {
        let file = Self::open(run)?;
        if file.boundary.has_top() {
            return Ok(file);
        }
        Err(file.wrong(format!(
            "has a free surface (sample.boundary = {:?}), and so no strain; this command needs a run whose top moves",
            file.boundary.key
        )))
    }

    /// Opens any stage: a `run.h5` or the folder that holds one, its first stage;
    /// `run.h5/aqs`, `run.h5/newtonian`, `run.h5/shear`: a later one.
    ///
    /// # Errors
    /// [`Failure::Input`] that names the file and the object that is missing, damaged or of the
    /// wrong shape.
    pub fn open_any(run: &Path) -> Result<Self> {
        let mut path = run.to_path_buf();
        if run.is_dir() {
            path.push(RUN_FILE);
        }
        hdf5::silence_errors(true);
        let source = OpenFile::open(&path)?;
        let stage = stage_of(&source);
        let parameters = source.parameters()?;
        source.is_of_one_run(&parameters)?;
        let edges = source.edges(&parameters)?;
        let dimension = match parameters.get("dimension") {
            Some(Parameter::Integer(3)) => Dimensions::Three,
            _ => Dimensions::Two,
        };
        let (grains, ids, material) = source.grains(&edges)?;
        let boundary = source.boundary(&parameters, &grains)?;
        let finished = parameters.contains_key("digest");
        let columns = match stage {
            RunStage::Shear => source.columns_of_shear(boundary, &parameters)?,
            RunStage::Strain => strain_columns(source.has_row(&StrainProtocolRow::COLUMNS)),
            RunStage::Newtonian => series_columns(stage),
        };
        let place = TablePlace {
            group: OBSERVABLES,
            sums: checksums::ROWS,
            has_time: true,
        };
        let series = source.table(place, columns, finished)?;
        let scalars = source.scalars(finished)?;
        let torques = source.exists(&contact_dataset(TWISTING));
        let form = FrameFormat {
            axes: dimension.axes(),
            torques,
            idle: source.exists(&contact_dataset(IDLE)),
            histories: source.exists(&contact_dataset(TANGENTIAL_HISTORY)),
            ages: source.exists(&contact_dataset(AGE)),
            removed: source.exists(&grain_dataset(&REMOVED.column)),
            walls: source.exists(ContactTable::Walls.group()),
        };
        let of_grains = |quantity| source.of_grains(quantity, grains.count());
        let [position, velocity, angular_velocity] = elements(form.axes).map(of_grains);
        let image = of_grains(IMAGE);
        let removed = if form.removed {
            Some(of_grains(REMOVED)?)
        } else {
            None
        };
        let mut file = Self {
            stage,
            material,
            edges,
            dimension,
            form,
            boundary,
            parameters,
            series,
            scalars,
            step: source.all(&format!("{PARTICLES}/position/step"))?,
            time: source.all(&format!("{PARTICLES}/position/time"))?,
            boxes: Vec::new(),
            position: position?,
            velocity: velocity?,
            angular_velocity: angular_velocity?,
            image: image?,
            removed,
            contacts: (ContactTable::of(form))
                .map(|table| source.of_contacts(table, form))
                .collect::<Result<_>>()?,
            sums: FrameSums::read(&source, form)?,
            grains,
            ids,
            path: path.clone(),
            _file: source.file(),
        };
        file.cut_to_whole_frames(&source, finished)?;
        Ok(file)
    }

    /// Opens the part of the file with a stage that is not the first; `None` if it is not there.
    ///
    /// # Errors
    /// As of [`RunFile::open_any`].
    pub fn part(&self, stage: RunStage) -> Result<Option<Self>> {
        let path = part::file_of(&self.path).join(stage.name());
        if !part::exists(&path) {
            return Ok(None);
        }
        Self::open_any(&path).map(Some)
    }

    /// What its contacts are.
    pub fn form(&self) -> FrameFormat {
        self.form
    }

    /// Keeps the frames that every dataset has, and reads their boxes.
    fn cut_to_whole_frames(&mut self, source: &OpenFile<'_>, finished: bool) -> Result<()> {
        let names = of_grain(self.form).into_iter();
        let names: Vec<String> = names
            .map(|quantity| grain_dataset(&quantity.column))
            .collect();
        let [step, time] = ["step", "time"].map(|part| format!("{PARTICLES}/position/{part}"));
        let mut lengths = vec![(&*step, self.step.len()), (&*time, self.time.len())];
        let tables = self.contacts.iter();
        lengths.extend(tables.map(|contacts| (contacts.table.group(), contacts.whole_frames())));
        let datasets = [
            &self.position,
            &self.velocity,
            &self.angular_velocity,
            &self.image,
        ];
        let datasets = datasets.into_iter().chain(&self.removed);
        lengths.extend(names.iter().map(|name| &**name).zip(datasets.map(rows)));
        let frames = source.common_length(&lengths, finished, "frames")?;
        self.step.truncate(frames);
        self.time.truncate(frames);
        for contacts in &mut self.contacts {
            contacts.offset.truncate(frames + 1);
        }
        let (edges, width) = source.frame_edges(frames)?;
        for (t, edges) in edges.chunks_exact(width).enumerate() {
            let clock = checksums::of_clock(self.step[t], self.time[t], edges);
            if !self.sums.agrees(t, "clock", clock) {
                let what = "step, time and box/edges";
                return Err(Self::damaged_frame(&self.path, t, what));
            }
            let mut vectors = BoxEdges::default();
            for (axis, vector) in vectors.iter_mut().enumerate() {
                match edges.len() {
                    9 => vector.copy_from_slice(&edges[3 * axis..][..3]),
                    _ => vector[axis] = edges[axis],
                }
            }
            self.boxes.push(vectors);
        }
        Ok(())
    }

    fn damaged_frame(path: &Path, t: usize, what: &str) -> Failure {
        let path = path.display();
        Failure::input(format!(
            "{path}: frame {t}: the checksum of its {what} differs from the stored one: the file is damaged"
        ))
    }

    /// Compares a checksum of frame t with the stored one.
    fn verify(&self, t: usize, column: &str, sum: u64) -> Result<()> {
        if self.sums.agrees(t, column, sum) {
            Ok(())
        } else {
            Err(Self::damaged_frame(&self.path, t, column))
        }
    }

    /// Returns the stage that wrote the file.
    pub fn stage(&self) -> RunStage {
        self.stage
    }

    /// Returns what bounds the sample.
    pub fn boundary(&self) -> &'static Boundary {
        self.boundary
    }

    /// Returns the failure that refuses this file: its path, then `what`.
    pub fn wrong(&self, what: impl Display) -> Failure {
        Failure::input(format!("{}: {what}", self.path.display()))
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the folder of the file.
    pub fn folder(&self) -> &Path {
        folder_of(&self.path)
    }

    /// Returns the id of each row of the grains.
    pub fn ids(&self) -> &[u32] {
        &self.ids
    }

    /// Returns radii, bodies and masses of the grains.
    pub fn grains(&self) -> &GrainConstants {
        &self.grains
    }

    /// Returns the numbers of the grains' materials.
    pub fn material(&self) -> &[u8] {
        &self.material
    }

    /// Returns the height of the box at the start of the shear (m).
    pub fn height(&self) -> f64 {
        self.edges[self.dimension.axes() - 1]
    }

    /// Returns the number of dimensions.
    pub fn dimension(&self) -> Dimensions {
        self.dimension
    }

    /// Returns the periods along the walls (m), of every frame: L_x, and L_y of spheres. Of a box,
    /// those at the start; [`RunFile::cell`] has those of each frame.
    pub fn periods(&self) -> [f64; 2] {
        match self.dimension {
            Dimensions::Two => [self.edges[0], f64::INFINITY],
            Dimensions::Three => [self.edges[0], self.edges[1]],
        }
    }

    /// Returns the periodic cell at frame t < T.
    pub fn cell(&self, t: usize) -> Cell {
        let mut periods = self.periods();
        if !self.boundary.is_periodic() {
            return Cell::between_walls(periods);
        }
        let mut height = self.height();
        if let Some(edges) = self.boxes.get(t) {
            let up = self.dimension.axes() - 1;
            (0..up).for_each(|axis| periods[axis] = edges[axis][axis]);
            height = edges[up][up];
        }
        Cell {
            periods,
            sheared: Some(Sheared {
                offset: self.offset_of_image(t),
                ..Sheared::upright(height)
            }),
        }
    }

    /// The Lees–Edwards offset of a box at frame t (m).
    fn offset_of_image(&self, t: usize) -> f64 {
        let up = self.dimension.axes() - 1;
        if let Some(edges) = self.boxes.get(t) {
            return edges[up][0];
        }
        if self.stage != RunStage::Strain {
            return self.number("image_offset").unwrap_or(0.0);
        }
        match self.series.step.binary_search(&self.step[t]) {
            Ok(row) => self.series.column("image_offset")[row],
            Err(_) => 0.0,
        }
    }

    /// Returns two frames of these numbers, the earlier first, to follow grains from one to the
    /// other.
    pub fn interval<'a>(&self, numbers: [usize; 2], frames: [&'a Frame; 2]) -> Interval<'a> {
        Interval {
            frames,
            periods: self.periods_of_shear(numbers),
        }
    }

    /// The periods that were taken from the Lees–Edwards offset between two frames. Each strain
    /// step has a row, and adds less than half a period.
    fn periods_of_shear(&self, numbers: [usize; 2]) -> i64 {
        if self.stage == RunStage::Shear && self.boundary.is_periodic() {
            let [before, after] = numbers.map(|t| self.periods_of_offset(t));
            return (after - before).round() as i64;
        }
        if self.stage != RunStage::Strain {
            return 0;
        }
        let [from, to] = numbers.map(|t| self.series.step.partition_point(|s| *s < self.step[t]));
        let offsets = self.series.column("image_offset");
        let rows = offsets.get(from..=to).unwrap_or_default().windows(2);
        let period = self.cell(numbers[1]).periods[0];
        rows.map(|pair| ((pair[0] - pair[1]) / period).round() as i64)
            .sum()
    }

    /// The periods that were taken from the Lees–Edwards offset of a sheared cell up to frame t,
    /// but for those of the start; not rounded.
    fn periods_of_offset(&self, t: usize) -> f64 {
        let unwrapped = if self.series.has("unwrapped_offset") {
            let row = self.series.step.binary_search(&self.step[t]);
            let offsets = self.series.column("unwrapped_offset");
            row.map_or(0.0, |row| offsets[row])
        } else {
            let strains = self.frame_strains().unwrap_or_default();
            let strain = strains.get(t).copied();
            strain.map_or(0.0, |strain| strain * self.height())
        };
        (unwrapped - self.offset_of_image(t)) / self.cell(t).periods[0]
    }

    /// Returns the edge vectors of the box at frame t < T (m), one a row. Between walls the edge
    /// across them is the height.
    pub fn box_edges(&self, t: usize) -> BoxEdges {
        self.boxes[t]
    }

    /// Returns the time series.
    pub fn series(&self) -> &Series {
        &self.series
    }

    /// Returns the scalars of frames; `None` if the run computed none.
    pub fn stored_scalars(&self) -> Option<&StoredScalars> {
        self.scalars.as_ref()
    }

    /// Returns all attributes of `parameters`, by name.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// Returns a parameter that is text; `None` if it is missing.
    pub fn text(&self, name: &str) -> Option<&str> {
        match self.parameters.get(name) {
            Some(Parameter::Text(text)) => Some(text),
            _ => None,
        }
    }

    /// Returns a parameter that is a number; `None` if it is missing.
    pub fn number(&self, name: &str) -> Option<f64> {
        match self.parameters.get(name) {
            Some(Parameter::Number(value)) => Some(*value),
            Some(Parameter::Integer(value)) => Some(*value as f64),
            _ => None,
        }
    }

    /// Returns the scene as TOML, every default filled in.
    pub fn scene(&self) -> &str {
        self.text("scene").unwrap_or_default()
    }

    /// Returns the digest of the last state; `None` if the run was stopped early.
    pub fn digest(&self) -> Option<&str> {
        self.text("digest")
    }

    /// Returns the number of frames T.
    pub fn frames(&self) -> usize {
        self.step.len()
    }

    /// Returns the steps of the frames, `[T]`.
    pub fn frame_steps(&self) -> &[u64] {
        &self.step
    }

    /// Returns the row of the first contact between grains of each frame, `[T+1]`.
    pub fn contact_offsets(&self) -> &[u64] {
        &self.contacts[0].offset
    }

    /// Returns the time of the frames, `[T]` (s); their strain in the stage of strain steps.
    pub fn frame_times(&self) -> &[f64] {
        &self.time
    }

    /// Returns γ of the frames, `[T]`: V t/H if the wall moves at the constant velocity V, and what
    /// a ramp or the protocol imposes if it does so for all parts; if a spring or a force moves the
    /// wall, interpolated between the rows of the time series (NaN before the first and after the
    /// last row); that of the cell in a periodic box.
    ///
    /// # Errors
    /// [`Failure::Input`] if a parameter is missing.
    pub fn frame_strains(&self) -> Result<Vec<f64>> {
        match self.stage {
            RunStage::Shear => {}
            RunStage::Strain => return Ok(self.interpolated_strains()),
            RunStage::Newtonian => {
                let strain = self.number("strain").unwrap_or(f64::NAN);
                return Ok(vec![strain; self.frames()]);
            }
        }
        if self.number("spring_stiffness").is_some_and(f64::is_finite) {
            return Ok(self.interpolated_strains());
        }
        if self.has_protocol() || gshear_scene::has_key(self.scene(), "shear.ramp") {
            return Ok(match self.schedule() {
                Some(schedule) if !schedule.protocol.has_force() && !schedule.has_conditions() => {
                    let steps = self.step.iter();
                    steps.map(|step| schedule.strain(*step)).collect()
                }
                // The speed of a wall under a force is not known in advance, nor when a condition
                // ends a part.
                _ => self.interpolated_strains(),
            });
        }
        let rate = self.required("wall_speed")? / self.required("height_start")?;
        Ok(self.time.iter().map(|time| rate * time).collect())
    }

    /// A parameter that is a number.
    fn required(&self, name: &str) -> Result<f64> {
        let what = format!("parameters: attribute {name} is missing: {FOREIGN}");
        self.number(name).ok_or_else(|| self.wrong(what))
    }

    /// Whether a protocol moves the wall. The time series does not say so: the rows of a run that
    /// began at the checkpoint of another one may all be of one part.
    pub fn has_protocol(&self) -> bool {
        gshear_scene::has_key(self.scene(), "shear.protocol")
    }

    /// The schedule of a run between walls; `None` where the file does not say all of it: the scene
    /// takes its grains from the file of a packing, or is one of another version.
    fn schedule(&self) -> Option<Schedule> {
        let source = Source::new(self.path.display().to_string(), self.scene());
        let packing: ReadPacking<'_> = &mut |paths: PackingPaths<'_>, _| {
            Err(Failure::input(format!(
                "{} is not read",
                paths.grains.display()
            )))
        };
        let scene = gshear_scene::load_with(&source, &[], packing).ok()?;
        let height = self.number("height_start")?;
        Some(Schedule::new(&scene, scene.shear()?, height))
    }

    fn interpolated_strains(&self) -> Vec<f64> {
        let (steps, strains) = (&self.series.step, self.series.column("strain"));
        let mut interpolated = Vec::with_capacity(self.step.len());
        for step in &self.step {
            let next = steps.partition_point(|row| row < step);
            interpolated.push(match (next.checked_sub(1), steps.get(next)) {
                (_, Some(row)) if row == step => strains[next],
                (Some(last), Some(row)) => {
                    let part = (step - steps[last]) as f64 / (row - steps[last]) as f64;
                    strains[last] + part * (strains[next] - strains[last])
                }
                _ => f64::NAN,
            });
        }
        interpolated
    }
}

/// Number of rows of a dataset.
fn rows(dataset: &Dataset) -> usize {
    dataset.shape()[0]
}
