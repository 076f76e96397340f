//! Reads `run.h5` (docs/file-formats.md): serially, by blocks of frames, so that memory does not grow with the run.

mod periodic;
mod source;
mod state;

use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use hdf5::{Dataset, H5Type};
use ndarray::{Ix1, Ix2, Ix3, s};

pub use self::periodic::{PeriodicRun, scene_of_finished};
use self::source::{FOREIGN, Source, one_line};
use crate::analysis::frame_scalars::FrameScalars;
use crate::config::Dimensions;
use crate::failure::Failure;
use crate::state::{Cell, ContactSample, Disks, Frame, FrameRecords, GrainSample, SERIES_COLUMNS};

/// An attribute of `parameters`.
#[derive(Debug, Clone, PartialEq)]
pub enum Parameter {
    Text(String),
    Integer(i64),
    Number(f64),
    Numbers(Vec<f64>),
}

impl fmt::Display for Parameter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Parameter::Text(text) => f.write_str(text),
            Parameter::Integer(value) => write!(f, "{value}"),
            Parameter::Number(value) => write!(f, "{value:?}"),
            Parameter::Numbers(values) => write!(f, "{values:?}"),
        }
    }
}

/// The time series; L rows, as far as every column goes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Series {
    /// [L] steps since the start of the shear.
    pub step: Vec<u64>,
    /// [L] (s).
    pub time: Vec<f64>,
    /// [columns of `SERIES_COLUMNS`][L].
    pub columns: Vec<Vec<f64>>,
}

impl Series {
    /// A column of `SERIES_COLUMNS`, [L]. Panics on any other name.
    pub fn column(&self, name: &str) -> &[f64] {
        let at = SERIES_COLUMNS.iter().position(|column| *column == name);
        &self.columns[at.unwrap_or_else(|| panic!("{name} is no column of the time series"))]
    }

    /// L.
    pub fn rows(&self) -> usize {
        self.step.len()
    }
}

/// What is read of a frame.
///
/// What is not read of the grains is left empty, what is not read of the contacts is 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd)]
pub enum Fields {
    /// Positions and the ids of the contacts: enough for D²min.
    Pairs,
    /// The forces as well: enough for the scalars of a frame.
    Forces,
    All,
}

/// Scalars that the run itself has computed, `observables/gshear/`; row k between the rows k-1 and k.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredScalars {
    /// [L] steps since the start of the shear.
    pub step: Vec<u64>,
    /// [L].
    pub scalars: Vec<FrameScalars>,
}

/// An open `run.h5`. What is small is read on opening; frames are read on demand.
pub struct Run {
    path: PathBuf,
    grains: Disks,
    /// Of the box at the start of the shear (m): L_x and height, of spheres L_x, L_y and height.
    edges: [f64; 3],
    dimension: Dimensions,
    parameters: BTreeMap<String, Parameter>,
    series: Series,
    scalars: Option<StoredScalars>,
    step: Vec<u64>,
    time: Vec<f64>,
    offset: Vec<u64>,
    position: Dataset,
    velocity: Dataset,
    angular_velocity: Dataset,
    contacts: ContactColumns,
}

struct ContactColumns {
    i: Dataset,
    j: Dataset,
    normal_force: Dataset,
    tangential_force: Dataset,
    tangential_history: Dataset,
    rolling_history: Option<Dataset>,
    overlap: Dataset,
    sliding: Dataset,
}

impl Run {
    /// Opens a run: a `run.h5`, or the folder that holds one.
    ///
    /// A run that was stopped early is read as far as every one of its datasets goes.
    /// Errors: `Failure::Input` that names the file and the object that is missing, damaged or of the wrong shape.
    pub fn open(run: &Path) -> Result<Self, Failure> {
        let path = if run.is_dir() {
            run.join("run.h5")
        } else {
            run.to_path_buf()
        };
        hdf5::silence_errors(true);
        let source = Source::open(&path)?;

        let id: Vec<u32> = source.all("particles/trajectory/id")?;
        let n = id.len();
        if let Some(row) = (0..n).find(|&row| id[row] as usize != row) {
            let found = id[row];
            return Err(source.wrong(
                "particles/trajectory/id",
                format!("row {row} is grain {found}; rows must be 0 … N-1"),
            ));
        }
        let edges: Vec<f64> = source.all("particles/trajectory/box/edges")?;
        if edges.len() != 3 || edges[0].is_nan() || edges[0] <= 0.0 {
            return Err(source.wrong(
                "particles/trajectory/box/edges",
                "does not hold L_x > 0, height, 0, or L_x > 0, L_y, height",
            ));
        }
        let parameters = source.parameters()?;
        let dimension = match parameters.get("dimension") {
            Some(Parameter::Integer(3)) => Dimensions::Three,
            _ => Dimensions::Two,
        };
        let planar = dimension == Dimensions::Two;
        let grains = Disks {
            radius: source.of_length("particles/trajectory/radius", n)?,
            body: source.of_length("particles/trajectory/body", n)?,
            mass: source.of_length("particles/trajectory/mass", n)?,
            length: edges[0],
        };
        let finished = parameters.contains_key("digest");
        let series = source.series(finished)?;
        let scalars = source.scalars(finished)?;

        let spins = if planar { &[n][..] } else { &[n, 3] };
        let position = source.frames("particles/trajectory/position/value", &[n, 3])?;
        let velocity = source.frames("particles/trajectory/velocity/value", &[n, 3])?;
        let angular_velocity =
            source.frames("particles/trajectory/angular_velocity/value", spins)?;
        let mut step: Vec<u64> = source.all("particles/trajectory/position/step")?;
        let mut time: Vec<f64> = source.all("particles/trajectory/position/time")?;
        let mut offset: Vec<u64> = source.all("connectivity/contacts/offset")?;
        let wide = |name: &str, shape: &[usize]| {
            source.frames(&format!("connectivity/contacts/{name}"), shape)
        };
        let column = |name: &str| wide(name, &[]);
        let tangential = if planar { &[][..] } else { &[3] };
        let contacts = ContactColumns {
            i: column("i")?,
            j: column("j")?,
            normal_force: column("normal_force")?,
            tangential_force: wide("tangential_force", tangential)?,
            tangential_history: wide("tangential_history", tangential)?,
            // Of disks only.
            rolling_history: match planar {
                true => Some(column("rolling_history")?),
                false => None,
            },
            overlap: column("overlap")?,
            sliding: column("sliding")?,
        };

        let stored = contacts.shortest();
        if let Some(t) = (1..offset.len()).find(|&t| offset[t] < offset[t - 1]) {
            return Err(source.wrong(
                "connectivity/contacts/offset",
                format!("decreases at frame {t}"),
            ));
        }
        let whole = offset
            .iter()
            .take_while(|&&end| end <= stored)
            .count()
            .saturating_sub(1);
        let lengths = [
            ("particles/trajectory/position/value", position.shape()[0]),
            ("particles/trajectory/velocity/value", velocity.shape()[0]),
            (
                "particles/trajectory/angular_velocity/value",
                angular_velocity.shape()[0],
            ),
            ("particles/trajectory/position/step", step.len()),
            ("particles/trajectory/position/time", time.len()),
            ("connectivity/contacts", whole),
        ];
        let frames = source.common_length(&lengths, finished, "frames")?;
        step.truncate(frames);
        time.truncate(frames);
        offset.truncate(frames + 1);

        Ok(Run {
            grains,
            edges: [edges[0], edges[1], edges[2]],
            dimension,
            parameters,
            series,
            scalars,
            step,
            time,
            offset,
            position,
            velocity,
            angular_velocity,
            contacts,
            path,
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The folder of the file.
    pub fn folder(&self) -> &Path {
        match self.path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        }
    }

    pub fn grains(&self) -> &Disks {
        &self.grains
    }

    /// Height of the box at the start of the shear (m).
    pub fn height(&self) -> f64 {
        self.edges[self.dimension.axes() - 1]
    }

    pub fn dimension(&self) -> Dimensions {
        self.dimension
    }

    /// The periodic cell.
    pub fn cell(&self) -> Cell {
        Cell::between_walls(match self.dimension {
            Dimensions::Two => [self.edges[0], f64::INFINITY],
            Dimensions::Three => [self.edges[0], self.edges[1]],
        })
    }

    pub fn series(&self) -> &Series {
        &self.series
    }

    /// `None` where the run computed no scalars of frames.
    pub fn stored_scalars(&self) -> Option<&StoredScalars> {
        self.scalars.as_ref()
    }

    /// All attributes of `parameters`, by name.
    pub fn parameters(&self) -> &BTreeMap<String, Parameter> {
        &self.parameters
    }

    /// A parameter that is text; `None` where it is missing.
    pub fn text(&self, name: &str) -> Option<&str> {
        match self.parameters.get(name) {
            Some(Parameter::Text(text)) => Some(text),
            _ => None,
        }
    }

    /// A parameter that is a number; `None` where it is missing.
    pub fn number(&self, name: &str) -> Option<f64> {
        match self.parameters.get(name) {
            Some(Parameter::Number(value)) => Some(*value),
            Some(Parameter::Integer(value)) => Some(*value as f64),
            _ => None,
        }
    }

    /// The scene as TOML, every default filled in.
    pub fn scene(&self) -> &str {
        self.text("scene").unwrap_or_default()
    }

    /// Digest of the last state; `None` where the run was stopped early.
    pub fn digest(&self) -> Option<&str> {
        self.text("digest")
    }

    /// T.
    pub fn frames(&self) -> usize {
        self.step.len()
    }

    /// [T] steps of the frames.
    pub fn frame_steps(&self) -> &[u64] {
        &self.step
    }

    /// [T+1] first contact of each frame, as far as whole frames go.
    pub fn contact_offsets(&self) -> &[u64] {
        &self.offset
    }

    /// [T] γ of the frames: V t/H where the wall moves at the constant velocity V; where a spring or a protocol moves it, on straight
    /// lines between the rows of the time series.
    pub fn frame_strains(&self) -> Result<Vec<f64>, Failure> {
        let velocities = self.series.column("drive_velocity");
        let changes = velocities.windows(2).any(|pair| pair[0] != pair[1]);
        if changes
            || self
                .number("spring_stiffness")
                .is_some_and(|k| k.is_finite())
        {
            return Ok(self.interpolated_strains());
        }
        let need = |name: &str| {
            let missing = || {
                Failure::input(format!(
                    "{}: parameters: attribute {name} is missing: {FOREIGN}",
                    self.path.display()
                ))
            };
            self.number(name).ok_or_else(missing)
        };
        let rate = need("wall_speed")? / need("height_start")?;
        Ok(self.time.iter().map(|time| rate * time).collect())
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

    /// The frames of a range within 0 … T, whatever they are of.
    pub fn records(&self, range: Range<usize>) -> Result<Vec<FrameRecords>, Failure> {
        let mut position = self.vectors(&self.position, &range)?.into_iter();
        let mut velocity = self.vectors(&self.velocity, &range)?.into_iter();
        let mut angular_velocity = match self.dimension {
            Dimensions::Two => {
                let spins = self.spins(&range)?.into_iter().flatten();
                let about_z = spins.map(|w| [0.0, 0.0, w]);
                about_z.collect()
            }
            Dimensions::Three => self.vectors(&self.angular_velocity, &range)?,
        }
        .into_iter();
        let mut contacts = self.contacts(range.clone(), Fields::All)?.into_iter();
        let frame = |t: usize| FrameRecords {
            step: self.step[t],
            time: self.time[t],
            grains: (0..self.grains.count() as u64)
                .map(|id| GrainSample {
                    id,
                    position: position.next().unwrap_or_default(),
                    velocity: velocity.next().unwrap_or_default(),
                    angular_velocity: angular_velocity.next().unwrap_or_default(),
                })
                .collect(),
            contacts: contacts
                .by_ref()
                .take((self.offset[t + 1] - self.offset[t]) as usize)
                .collect(),
        };
        Ok(range.map(frame).collect())
    }

    /// Of all grains of frames, one after the other, from a dataset [T][N][3].
    fn vectors(&self, dataset: &Dataset, range: &Range<usize>) -> Result<Vec<[f64; 3]>, Failure> {
        let values = dataset
            .read_slice::<f64, _, Ix3>(s![range.start..range.end, .., ..])
            .map_err(|e| self.damaged(dataset, &e))?;
        let (values, _) = values.into_raw_vec_and_offset();
        Ok(values.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect())
    }

    /// [..][N] ω of disks.
    fn spins(&self, range: &Range<usize>) -> Result<Vec<Vec<f64>>, Failure> {
        let values = self
            .angular_velocity
            .read_slice::<f64, _, Ix2>(s![range.start..range.end, ..])
            .map_err(|e| self.damaged(&self.angular_velocity, &e))?;
        Ok(values.outer_iter().map(|frame| frame.to_vec()).collect())
    }

    /// Frame t < T.
    pub fn frame(&self, t: usize) -> Result<Frame, Failure> {
        Ok(self.block(t..t + 1)?.swap_remove(0))
    }

    /// The frames of a range within 0 … T.
    pub fn block(&self, range: Range<usize>) -> Result<Vec<Frame>, Failure> {
        self.block_of(range, Fields::All)
    }

    /// The frames of a range within 0 … T, as far as `fields` go.
    pub fn block_of(&self, range: Range<usize>, fields: Fields) -> Result<Vec<Frame>, Failure> {
        if self.dimension == Dimensions::Three {
            return Err(Failure::input(format!(
                "{}: this is of disks only; of the frames of spheres there are dmin, compare and export, and their time series",
                self.path.display()
            )));
        }
        let mut position = self.planar(&self.position, &range)?.into_iter();
        let (mut velocity, mut angular_velocity) = (Vec::new(), Vec::new());
        if fields == Fields::All {
            velocity = self.planar(&self.velocity, &range)?;
            angular_velocity = self.spins(&range)?;
        }
        let (mut velocity, mut angular_velocity) =
            (velocity.into_iter(), angular_velocity.into_iter());
        let mut contacts = self.contacts(range.clone(), fields)?.into_iter();
        let first = self.offset[range.start];
        debug_assert_eq!(contacts.len() as u64, self.offset[range.end] - first);

        let frame = |t: usize| Frame {
            step: self.step[t],
            time: self.time[t],
            position: position.next().unwrap_or_default(),
            velocity: velocity.next().unwrap_or_default(),
            angular_velocity: angular_velocity.next().unwrap_or_default(),
            contacts: contacts
                .by_ref()
                .take((self.offset[t + 1] - self.offset[t]) as usize)
                .collect(),
        };
        Ok(range.map(frame).collect())
    }

    /// x and y of a dataset [T][N][3], of which z must be 0.
    fn planar(
        &self,
        dataset: &Dataset,
        range: &Range<usize>,
    ) -> Result<Vec<Vec<[f64; 2]>>, Failure> {
        let values = self.vectors(dataset, range)?;
        if values.iter().any(|r| r[2] != 0.0) {
            let name = dataset.name();
            return Err(Failure::input(format!(
                "{}: {}: z is not 0: only 2D runs can be reduced",
                self.path.display(),
                &name[1..]
            )));
        }
        let frame = |t: usize| {
            let rows = values[t * self.grains.count()..].iter();
            rows.take(self.grains.count())
                .map(|row| [row[0], row[1]])
                .collect()
        };
        Ok((0..range.len()).map(frame).collect())
    }

    /// How many frames to read at a time so that a block stays near 16 MiB: memory of that size is used again, where the
    /// system would clear every page of a larger one anew.
    pub fn block_length(&self) -> usize {
        let frames = self.frames().max(1);
        let contacts = self.offset.last().map_or(0, |all| *all as usize) / frames;
        let bytes =
            self.grains.count() * 11 * size_of::<f64>() + contacts * 2 * size_of::<ContactSample>();
        ((16 << 20) / bytes.max(1)).clamp(1, 512)
    }

    fn contacts(
        &self,
        frames: Range<usize>,
        fields: Fields,
    ) -> Result<Vec<ContactSample>, Failure> {
        let rows = self.offset[frames.start] as usize..self.offset[frames.end] as usize;
        let columns = &self.contacts;
        let (i, j) = (
            self.column::<u32>(&columns.i, &rows)?,
            self.column::<u32>(&columns.j, &rows)?,
        );
        // No rows of what is not asked for.
        let rows_from = |least: Fields| if fields >= least { rows.clone() } else { 0..0 };
        let (forces, others) = (rows_from(Fields::Forces), rows_from(Fields::All));
        let normal_force = self.column::<f64>(&columns.normal_force, &forces)?;
        let tangential_force = self.tangential(&columns.tangential_force, &forces)?;
        let tangential_history = self.tangential(&columns.tangential_history, &others)?;
        let rolling_history = match &columns.rolling_history {
            Some(dataset) => self.column::<f64>(dataset, &others)?,
            None => Vec::new(),
        };
        let overlap = self.column::<f64>(&columns.overlap, &others)?;
        let sliding = self.column::<u8>(&columns.sliding, &others)?;
        self.check_pairs(&i, &j, rows.start)?;
        let of = |values: &[f64], k: usize| values.get(k).copied().unwrap_or(0.0);
        let contact = |k: usize| ContactSample {
            i: i[k],
            j: j[k],
            normal_force: of(&normal_force, k),
            tangential_force: tangential_force.get(k).copied().unwrap_or_default(),
            tangential_history: tangential_history.get(k).copied().unwrap_or_default(),
            rolling_history: of(&rolling_history, k),
            overlap: of(&overlap, k),
            sliding: sliding.get(k).map_or(0, |sliding| u64::from(*sliding)),
        };
        Ok((0..i.len()).map(contact).collect())
    }

    /// Ids of the contacts from row `first` on.
    fn check_pairs(&self, i: &[u32], j: &[u32], first: usize) -> Result<(), Failure> {
        let n = self.grains.count();
        match (0..i.len()).find(|&k| i[k] >= j[k] || j[k] as usize >= n) {
            None => Ok(()),
            Some(k) => Err(Failure::input(format!(
                "{}: connectivity/contacts: row {} joins grains {} and {}; ids must be i < j < {n}",
                self.path.display(),
                first + k,
                i[k],
                j[k]
            ))),
        }
    }

    /// A column of tangential vectors: of disks [M], of spheres [M][3].
    fn tangential(&self, dataset: &Dataset, rows: &Range<usize>) -> Result<Vec<[f64; 3]>, Failure> {
        if self.dimension == Dimensions::Two {
            let along = self.column::<f64>(dataset, rows)?;
            return Ok(along.into_iter().map(|f| [f, 0.0, 0.0]).collect());
        }
        if rows.is_empty() {
            return Ok(Vec::new());
        }
        let values = dataset
            .read_slice::<f64, _, Ix2>(s![rows.start..rows.end, ..])
            .map_err(|e| self.damaged(dataset, &e))?;
        Ok(values.outer_iter().map(|v| [v[0], v[1], v[2]]).collect())
    }

    fn column<T: H5Type>(&self, dataset: &Dataset, rows: &Range<usize>) -> Result<Vec<T>, Failure> {
        if rows.is_empty() {
            return Ok(Vec::new());
        }
        let values = dataset
            .read_slice::<T, _, Ix1>(s![rows.start..rows.end])
            .map_err(|e| self.damaged(dataset, &e))?;
        Ok(values.into_raw_vec_and_offset().0)
    }

    fn damaged(&self, dataset: &Dataset, error: &hdf5::Error) -> Failure {
        Failure::input(format!(
            "{}: {} cannot be read: {}",
            self.path.display(),
            &dataset.name()[1..],
            one_line(error)
        ))
    }
}

impl ContactColumns {
    /// Rows that every column has.
    fn shortest(&self) -> u64 {
        let columns = [
            &self.i,
            &self.j,
            &self.normal_force,
            &self.tangential_force,
            &self.tangential_history,
            &self.overlap,
            &self.sliding,
        ];
        columns
            .into_iter()
            .chain(&self.rolling_history)
            .map(|dataset| dataset.shape()[0] as u64)
            .min()
            .unwrap_or(0)
    }
}
