//! Reads `run.h5` (docs/file-formats.md) serially, by blocks of frames, so that memory does not
//! grow with the length of the run.

mod frames;
mod open_file;
mod owner;
mod state;
mod verify;

use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use hdf5::Dataset;

pub use self::open_file::is_hdf5;
pub(crate) use self::open_file::one_line;
use self::open_file::{FOREIGN, OpenFile};
pub use self::owner::{Owner, owner};
use self::verify::FrameSums;
use crate::box_columns::{AqsRow, NewtonianRow};
use crate::checksums;
use crate::contact_quantities::{IDLE, TWISTING_HISTORY};
use crate::file_names::{RUN_FILE, folder_of};
use crate::layout::{
    CONTACTS, Form, OBSERVABLES, PARTICLES, contact_dataset, grain_dataset, of_grain,
};
pub use crate::parameter::{Parameter, Parameters};
use crate::sound::ReadFile;
use gshear_analysis::event::Interval;
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_analysis::time_mean::{self, RATIO_COLUMNS, TimeMean};
use gshear_dem::columns::Column;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::{
    BoxEdges, Cell, Confinement, Disks, FlowRow, FrameRecords, Image, ImposedRow, SeriesRow,
    Sheared, StressRow, series_columns,
};
use gshear_scene::schedule::Schedule;
use gshear_scene::{Boundary, Dimensions, ReadPacking, Source};

/// The stage of a run whose frames and time series a file holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunStage {
    /// Shear between walls.
    Shear,
    /// Strain steps of a periodic box; time is strain.
    Strain,
    /// Newton's equations in a periodic box.
    Newtonian,
}

impl RunStage {
    /// In the order in which a file is tried.
    const ALL: [Self; 3] = [Self::Newtonian, Self::Strain, Self::Shear];

    /// Columns of the time series, of a shear those that all have.
    pub fn columns(self) -> &'static [Column] {
        match self {
            Self::Shear => &SeriesRow::COLUMNS,
            Self::Strain => &AqsRow::COLUMNS,
            Self::Newtonian => &NewtonianRow::COLUMNS,
        }
    }

    /// Name, as messages and checkpoints have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Shear => "shear",
            Self::Strain => "aqs",
            Self::Newtonian => "newtonian",
        }
    }

    /// The name of a file made of this stage, which is `name` for a shear.
    pub fn named(self, name: &str) -> String {
        match self {
            Self::Shear => name.into(),
            _ => format!("{}-{name}", self.name()),
        }
    }

    /// The stage whose columns a file has; [`RunStage::Shear`] if none fits, so that messages name
    /// the columns of that.
    fn of(source: &OpenFile<'_>) -> Self {
        let is_stored = |name: &str| source.exists(&format!("{OBSERVABLES}/{name}"));
        let has_all = |stage: &Self| stage.columns().iter().all(|of| is_stored(of.name));
        Self::ALL.into_iter().find(has_all).unwrap_or(Self::Shear)
    }
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
        let later = |name: &str| &self.column(name)[first..];
        match RATIO_COLUMNS.iter().find(|of| of.ratio == name) {
            Some(of) => TimeMean::of_ratio(later(of.numerator), later(of.denominator), &weights),
            None => TimeMean::of(later(name), &weights),
        }
    }
}

/// Which fields of a frame are read. Other fields of the grains are left empty, other fields of the
/// contacts are 0.
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
    grains: Disks,
    ids: Vec<u32>,
    /// Of the grains.
    material: Vec<u8>,
    /// Box at the start of the shear (m): L_x, height in 2D; L_x, L_y, height in 3D.
    edges: [f64; 3],
    dimension: Dimensions,
    form: Form,
    /// Whether the cell is periodic along its last axis, too.
    is_box: bool,
    parameters: Parameters,
    series: Series,
    scalars: Option<StoredScalars>,
    step: Vec<u64>,
    time: Vec<f64>,
    /// `[T]` Edges of the box.
    boxes: Vec<BoxEdges>,
    offset: Vec<u64>,
    position: Dataset,
    velocity: Dataset,
    angular_velocity: Dataset,
    image: Dataset,
    /// Of [`of_contact`], by name.
    contacts: BTreeMap<&'static str, Dataset>,
    sums: FrameSums,
    /// Closed when all its datasets are.
    _file: Arc<ReadFile>,
}

impl RunFile {
    /// Opens the shear of a run: a `run.h5`, or the folder that holds one.
    ///
    /// A run that was stopped early is read as far as all of its datasets go.
    ///
    /// # Errors
    /// [`Failure::Input`] that names the file and the object that is missing, damaged or of the
    /// wrong shape; a file of another stage.
    pub fn open(run: &Path) -> Result<Self> {
        let file = Self::open_any(run)?;
        match file.stage {
            RunStage::Shear => Ok(file),
            _ => Err(file.wrong("is of a scene with [box]; this command needs the shear of a run")),
        }
    }

    /// Opens the shear of a run between walls.
    ///
    /// # Errors
    /// As of [`RunFile::open`], and a cell without walls.
    pub fn open_between_walls(run: &Path) -> Result<Self> {
        let file = Self::open_sheared(run)?;
        if file.has_walls() {
            return Ok(file);
        }
        let what =
            "has no walls (sample.boundary = \"periodic\"); this command needs a run between walls";
        Err(file.wrong(what))
    }

    /// Opens `run.h5` of a sample that is sheared: between walls, or without them.
    ///
    /// # Errors
    /// As of [`RunFile::open`], and a free surface.
    pub fn open_sheared(run: &Path) -> Result<Self> {
        let file = Self::open(run)?;
        if !file.has_free_surface() {
            return Ok(file);
        }
        let what = "has a free surface (sample.boundary = \"free\"), and so no strain; this command needs a run whose top moves";
        Err(file.wrong(what))
    }

    /// Opens any stage: a `run.h5` or the folder that holds one, of a box its strain steps;
    /// `run.h5/newtonian`: Newton's equations after them.
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
        let stage = RunStage::of(&source);
        let parameters = source.parameters()?;
        source.is_of_one_run(&parameters)?;
        let edges = source.edges(&parameters)?;
        let dimension = match parameters.get("dimension") {
            Some(Parameter::Integer(3)) => Dimensions::Three,
            _ => Dimensions::Two,
        };
        let (grains, ids, material) = source.grains(&edges)?;
        let finished = parameters.contains_key("digest");
        let has = |row: &[Column]| source.exists(&format!("{OBSERVABLES}/{}", row[0]));
        let columns = match stage {
            RunStage::Shear => {
                let confinement = if has(&FlowRow::COLUMNS) {
                    Confinement::FreeSurface
                } else if has(&StressRow::COLUMNS) {
                    Confinement::Images
                } else {
                    Confinement::Walls
                };
                series_columns(has(&ImposedRow::COLUMNS), confinement)
            }
            _ => stage.columns(),
        };
        let place = (OBSERVABLES, checksums::ROWS);
        let series = source.table(place, columns, true, finished)?;
        let scalars = source.scalars(finished)?;
        let torques = source.exists(&contact_dataset(TWISTING_HISTORY));
        let form = Form {
            axes: dimension.axes(),
            torques,
            idle: source.exists(&contact_dataset(IDLE)),
        };
        let [position, velocity, angular_velocity, image] =
            of_grain(dimension.axes()).map(|quantity| source.of_grains(quantity, grains.count()));
        let mut file = Self {
            stage,
            material,
            edges,
            dimension,
            form,
            is_box: source.frame_edges(0)?.1 == 9,
            parameters,
            series,
            scalars,
            step: source.all(&format!("{PARTICLES}/position/step"))?,
            time: source.all(&format!("{PARTICLES}/position/time"))?,
            boxes: Vec::new(),
            offset: source.all(&contact_dataset("offset"))?,
            position: position?,
            velocity: velocity?,
            angular_velocity: angular_velocity?,
            image: image?,
            contacts: source.of_contacts(form)?,
            sums: FrameSums::read(&source, form)?,
            grains,
            ids,
            path: path.clone(),
            _file: source.file(),
        };
        file.cut_to_whole_frames(&source, finished)?;
        Ok(file)
    }

    /// What its contacts are.
    pub fn form(&self) -> Form {
        self.form
    }

    /// Keeps the frames that every dataset has, and reads their boxes.
    fn cut_to_whole_frames(&mut self, source: &OpenFile<'_>, finished: bool) -> Result<()> {
        let offset = &self.offset;
        if let Some(t) = (1..offset.len()).find(|&t| offset[t] < offset[t - 1]) {
            let what = format!("decreases at frame {t}");
            return Err(source.wrong(&contact_dataset("offset"), what));
        }
        let rows = |dataset: &Dataset| dataset.shape()[0];
        let stored = self.contacts.values().map(rows).min().unwrap_or(0) as u64;
        let whole = offset.iter().take_while(|&&end| end <= stored).count();
        let [position, velocity, spin, image] =
            of_grain(self.dimension.axes()).map(|(column, ..)| grain_dataset(&column));
        let [step, time] = ["step", "time"].map(|part| format!("{PARTICLES}/position/{part}"));
        let lengths = [
            (&*position, rows(&self.position)),
            (&*velocity, rows(&self.velocity)),
            (&*spin, rows(&self.angular_velocity)),
            (&*step, self.step.len()),
            (&*time, self.time.len()),
            (CONTACTS, whole.saturating_sub(1)),
            (&*image, rows(&self.image)),
        ];
        let frames = source.common_length(&lengths, finished, "frames")?;
        self.step.truncate(frames);
        self.time.truncate(frames);
        self.offset.truncate(frames + 1);
        let (edges, width) = source.frame_edges(frames)?;
        for (t, edges) in edges.chunks_exact(width).enumerate() {
            let clock = checksums::of_clock(self.step[t], self.time[t], edges);
            if !self.sums.agrees(t, "clock", clock) {
                let what = "step, time and box/edges";
                return Err(Self::damaged_frame(&self.path, t, what));
            }
            let along = |axis: usize| match edges.len() {
                9 => [edges[3 * axis], edges[3 * axis + 1], edges[3 * axis + 2]],
                _ => std::array::from_fn(|k| if k == axis { edges[axis] } else { 0.0 }),
            };
            self.boxes.push(std::array::from_fn(along));
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
    fn verify(&self, t: usize, column: &str, found: u64) -> Result<()> {
        if self.sums.agrees(t, column, found) {
            Ok(())
        } else {
            Err(Self::damaged_frame(&self.path, t, column))
        }
    }

    /// Returns the stage that wrote the file.
    pub fn stage(&self) -> RunStage {
        self.stage
    }

    /// Returns whether walls bound the sample, or one below a free surface.
    pub fn has_walls(&self) -> bool {
        !self.is_box
    }

    /// Returns whether the walls are planes, which no grain belongs to.
    pub fn has_flat_walls(&self) -> bool {
        self.has_walls() && self.grains.body.iter().all(|body| *body == 0)
    }

    /// Returns whether a grain of a frame with this image had passed a wall and was removed.
    pub fn is_removed(&self, image: &Image) -> bool {
        self.has_walls() && image[self.dimension.axes() - 1] != 0
    }

    /// Returns whether nothing is above the sample.
    pub fn has_free_surface(&self) -> bool {
        self.series.has(FlowRow::COLUMNS[0].name)
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
    pub fn grains(&self) -> &Disks {
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
        if self.has_walls() {
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
        let stored = self.boxes.get(t).map(|edges| edges[up][0]);
        let before = || match self.stage {
            RunStage::Strain => {
                let row = self.series.step.binary_search(&self.step[t]).ok()?;
                Some(self.series.column("image_offset")[row])
            }
            _ => self.number("image_offset"),
        };
        stored.or_else(before).unwrap_or(0.0)
    }

    /// Returns two frames of these numbers, the earlier first, to follow grains from one to the
    /// other.
    pub fn interval<'a>(&self, numbers: [usize; 2], frames: [&'a FrameRecords; 2]) -> Interval<'a> {
        Interval {
            cells: numbers.map(|t| self.cell(t)),
            frames,
            periods: self.periods_of_shear(numbers),
        }
    }

    /// The periods that were taken from the Lees–Edwards offset between two frames. Each strain
    /// step has a row, and adds less than half a period.
    fn periods_of_shear(&self, numbers: [usize; 2]) -> i64 {
        if self.stage == RunStage::Shear && self.is_box {
            let period = self.cell(numbers[0]).periods[0];
            let strains = self.frame_strains().unwrap_or_default();
            let moved = |t: usize| strains.get(t).map_or(0.0, |strain| strain * self.height());
            let beyond = |t: usize| moved(t) - self.offset_of_image(t);
            return ((beyond(numbers[1]) - beyond(numbers[0])) / period).round() as i64;
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

    /// Returns the row of the first contact of each frame, `[T+1]`.
    pub fn contact_offsets(&self) -> &[u64] {
        &self.offset
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
        let need = |name: &str| {
            let what = format!("parameters: attribute {name} is missing: {FOREIGN}");
            self.number(name).ok_or_else(|| self.wrong(what))
        };
        if self.number("spring_stiffness").is_some_and(f64::is_finite) {
            return Ok(self.interpolated_strains());
        }
        if self.has_protocol() || gshear_scene::has_key(self.scene(), "shear.ramp") {
            // Under a force the top moves as it likes.
            let imposed = self.schedule().filter(|of| !of.protocol.has_force());
            let imposed = imposed.map(|of| self.step.iter().map(|step| of.strain(*step)).collect());
            return Ok(imposed.unwrap_or_else(|| self.interpolated_strains()));
        }
        let rate = need("wall_speed")? / need("height_start")?;
        Ok(self.time.iter().map(|time| rate * time).collect())
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
        let packing: ReadPacking<'_> =
            &mut |path: &Path, _| Err(Failure::input(format!("{} is not read", path.display())));
        let scene = gshear_scene::load_with(&source, &[], packing).ok()?;
        match &scene.boundary {
            Boundary::Walls(walls) => {
                Some(Schedule::new(&scene, walls, self.number("height_start")?))
            }
            Boundary::Periodic(_) => None,
        }
    }

    fn interpolated_strains(&self) -> Vec<f64> {
        let (steps, strains) = (&self.series.step, self.series.column("strain"));
        let at = |step: &u64| {
            let next = steps.partition_point(|row| row < step);
            match (next.checked_sub(1), steps.get(next)) {
                (_, Some(row)) if row == step => strains[next],
                (Some(last), Some(row)) => {
                    let part = (step - steps[last]) as f64 / (row - steps[last]) as f64;
                    strains[last] + part * (strains[next] - strains[last])
                }
                _ => f64::NAN,
            }
        };
        self.step.iter().map(at).collect()
    }
}
