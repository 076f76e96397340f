//! Reads `aqs.h5` and `newtonian.h5`, the files of runs in a periodic box.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ndarray::{Ix3, s};

use super::Parameter;
use super::source::{OpenFile, one_line};
use super::verify::FrameSums;
use crate::checksums;
use crate::journal;
use gshear_dem::columns::Column;
use gshear_dem::failure::Failure;
use gshear_dem::state::{Cell, Disks, Sheared};

const POSITION: &str = "particles/trajectory/position";

/// Time series and positions of a stage in a periodic box: L rows, T frames.
pub struct PeriodicRunFile {
    path: PathBuf,
    parameters: BTreeMap<String, Parameter>,
    /// `[L]` Strain steps, or time steps.
    pub step: Vec<u64>,
    /// `[L]` Strain, or time (s).
    pub time: Vec<f64>,
    columns: BTreeMap<&'static str, Vec<f64>>,
    /// `[T]` steps of the frames.
    pub frame_step: Vec<u64>,
    /// `[T]` Strain or time of the frames.
    pub frame_time: Vec<f64>,
    /// `[T][N]` Positions (m).
    pub positions: Vec<Vec<[f64; 3]>>,
    /// `[N]` Radii (m).
    pub radius: Vec<f64>,
    edges: [f64; 3],
}

impl PeriodicRunFile {
    /// Reads one of the files, with these columns of its time series.
    ///
    /// # Errors
    /// [`Failure::Input`] that names the file and the object that is missing or damaged.
    pub fn open(path: &Path, declared: &[Column]) -> Result<Self, Failure> {
        const GROUP: &str = "observables";

        hdf5::silence_errors(true);
        let source = OpenFile::open(path)?;
        let mut step: Vec<u64> = source.column(GROUP, &declared[0], "step")?;
        let mut time: Vec<f64> = source.column(GROUP, &declared[0], "time")?;
        let read = |column: &Column| Ok((column.name, source.column(GROUP, column, "value")?));
        let mut columns: BTreeMap<&str, Vec<f64>> =
            declared.iter().map(read).collect::<Result<_, Failure>>()?;
        // A file that is being written may be longer in some columns.
        let rows = columns
            .values()
            .map(Vec::len)
            .chain([step.len(), time.len()])
            .min();
        let rows = rows.unwrap_or(0);
        step.truncate(rows);
        time.truncate(rows);
        for column in columns.values_mut() {
            column.truncate(rows);
        }
        let named: Vec<_> = (declared.iter())
            .map(|column| (column, &columns[column.name][..]))
            .collect();
        source.verify_rows((&step, &time), &named)?;

        let mut frame_step: Vec<u64> = source.all(&format!("{POSITION}/step"))?;
        let mut frame_time: Vec<f64> = source.all(&format!("{POSITION}/time"))?;
        let grains: Vec<u32> = source.all("particles/trajectory/id")?;
        let name = format!("{POSITION}/value");
        let dataset = source.frames(&name, &[grains.len(), 3])?;
        let frames = dataset.shape()[0]
            .min(frame_step.len())
            .min(frame_time.len());
        frame_step.truncate(frames);
        frame_time.truncate(frames);
        let values = dataset
            .read_slice::<f64, _, Ix3>(s![..frames, .., ..])
            .map_err(|e| source.wrong(&name, format!("cannot be read: {}", one_line(&e))))?;
        let parameters = source.parameters()?;
        let axes = match parameters.get("dimension") {
            Some(Parameter::Integer(3)) => 3,
            _ => 2,
        };
        let sums = FrameSums::read(&source, axes)?;
        let of_grains = |part: &str| format!("particles/trajectory/{part}");
        let edges = source.edges(&parameters)?;
        let disks = Disks {
            radius: source.of_length(&of_grains("radius"), grains.len())?,
            body: source.of_length(&of_grains("body"), grains.len())?,
            mass: source.of_length(&of_grains("mass"), grains.len())?,
            length: edges[0],
        };
        source.verify_constants(&grains, &disks, &edges)?;
        let (of_box, width) = source.frame_edges(frames)?;
        let of_box = |t: usize| &of_box[t * width..][..width];
        let clock = |t: &usize| checksums::of_clock(frame_step[*t], frame_time[*t], of_box(*t));
        if let Some(t) = (0..frames).find(|t| !sums.agrees(*t, "clock", clock(t))) {
            return Err(source.damage(&format!("{POSITION}/step and time, box/edges: frame {t}")));
        }
        let of_frame = 3 * grains.len();
        let frame_values = values
            .as_slice()
            .unwrap_or_default()
            .chunks(of_frame.max(1));
        for (t, values) in frame_values.enumerate() {
            if !sums.agrees(t, "position", checksums::of_sequence(0, values)) {
                return Err(source.damage(&format!("{name}: frame {t}")));
            }
        }
        let of_frame = |frame: usize| {
            let place = |n: usize| std::array::from_fn(|axis| values[[frame, n, axis]]);
            (0..grains.len()).map(place).collect()
        };
        Ok(Self {
            path: path.to_path_buf(),
            parameters,
            step,
            time,
            columns,
            frame_step,
            frame_time,
            positions: (0..frames).map(of_frame).collect(),
            radius: disks.radius,
            edges,
        })
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns a column that was given to [`PeriodicRunFile::open`], `[L]`.
    ///
    /// # Panics
    /// On any other name.
    pub fn column(&self, name: &str) -> &[f64] {
        let column = self.columns.get(name);
        column.unwrap_or_else(|| panic!("{name} is not a column that was read"))
    }

    /// Returns whether the grains are disks.
    pub fn is_planar(&self) -> bool {
        self.number("dimension") == Some(2.0)
    }

    /// Returns the cell of a stage that shears it no further.
    pub fn cell(&self) -> Cell {
        let (width, height) = match self.is_planar() {
            true => (f64::INFINITY, self.edges[1]),
            false => (self.edges[1], self.edges[2]),
        };
        Cell {
            periods: [self.edges[0], width],
            sheared: Some(Sheared {
                height,
                offset: self.number("image_offset").unwrap_or(0.0),
                velocity: 0.0,
            }),
        }
    }

    /// Returns a parameter that is a number; `None` if it is missing.
    pub fn number(&self, name: &str) -> Option<f64> {
        match self.parameters.get(name)? {
            Parameter::Number(value) => Some(*value),
            Parameter::Integer(value) => Some(*value as f64),
            _ => None,
        }
    }

    /// Returns a parameter that is text; `None` if it is missing.
    pub fn text(&self, name: &str) -> Option<&str> {
        match self.parameters.get(name)? {
            Parameter::Text(text) => Some(text),
            _ => None,
        }
    }
}

/// The run that a file of frames and time series belongs to.
#[derive(Debug, Clone, PartialEq)]
pub struct Owner {
    /// The identity of the run; `None` in files of versions without it.
    pub run_id: Option<String>,
    /// The scene as TOML.
    pub scene: String,
    /// Whether the stage of the file is done.
    pub finished: bool,
    /// Whether the run began from a checkpoint of another one.
    pub branch: bool,
    /// Steps of the stage before the file begins; 0 unless it was begun at a resume.
    pub begun_at: u64,
    /// Whether a replay wrote the file.
    pub replay: bool,
}

/// Reads which run a `run.h5`, `aqs.h5` or `newtonian.h5` belongs to.
///
/// # Errors
/// [`Failure::Input`] if the file is not of a run, or damaged.
pub fn owner(path: &Path) -> Result<Owner, Failure> {
    hdf5::silence_errors(true);
    let parameters = OpenFile::open(path)?.parameters()?;
    let text = |name: &str| match parameters.get(name) {
        Some(Parameter::Text(text)) => Some(text.clone()),
        _ => None,
    };
    Ok(Owner {
        run_id: text("run_id"),
        scene: text("scene").unwrap_or_default(),
        // A file with a journal was not closed: a killed program may have left it in any state.
        finished: parameters.contains_key("digest") && !journal::path_of(path).exists(),
        branch: parameters.contains_key("parent_run_id"),
        begun_at: match parameters.get("begun_at_step") {
            Some(Parameter::Integer(step)) => *step as u64,
            _ => 0,
        },
        replay: parameters.contains_key("replay"),
    })
}
