//! `aqs.h5` and `newtonian.h5`, the files of runs in a periodic box.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ndarray::{Ix3, s};

use super::Parameter;
use super::source::{Source, one_line};
use gshear_dem::failure::Failure;
use gshear_dem::state::{Cell, Sheared};

const POSITION: &str = "particles/trajectory/position";

/// The time series of a stage in a box, and where its grains were.
pub struct PeriodicRun {
    path: PathBuf,
    parameters: BTreeMap<String, Parameter>,
    /// [L] strain steps, or steps.
    pub step: Vec<u64>,
    /// [L] strain, or time.
    pub time: Vec<f64>,
    columns: BTreeMap<String, Vec<f64>>,
    /// [T].
    pub frame_step: Vec<u64>,
    pub frame_time: Vec<f64>,
    /// [T][N] positions.
    pub positions: Vec<Vec<[f64; 3]>>,
    /// [N].
    pub radius: Vec<f64>,
    edges: Vec<f64>,
}

impl PeriodicRun {
    /// Opens one of the files, with these columns of its time series.
    ///
    /// Errors: `Failure::Input` that names the file and the object that is missing or damaged.
    pub fn open(path: &Path, columns: &[&str]) -> Result<Self, Failure> {
        hdf5::silence_errors(true);
        let source = Source::open(path)?;
        let read = |name: &&str| -> Result<(String, Vec<f64>), Failure> {
            let values = source.all(&format!("observables/{name}/value"))?;
            Ok((name.to_string(), values))
        };
        let mut columns: BTreeMap<String, Vec<f64>> =
            columns.iter().map(read).collect::<Result<_, _>>()?;
        let first = columns.keys().next().cloned().unwrap_or_default();
        let mut step: Vec<u64> = source.all(&format!("observables/{first}/step"))?;
        let mut time: Vec<f64> = source.all(&format!("observables/{first}/time"))?;
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
        let of_frame = |frame: usize| {
            let place = |n: usize| std::array::from_fn(|axis| values[[frame, n, axis]]);
            (0..grains.len()).map(place).collect()
        };
        Ok(Self {
            path: path.to_path_buf(),
            parameters: source.parameters()?,
            step,
            time,
            columns,
            frame_step,
            frame_time,
            positions: (0..frames).map(of_frame).collect(),
            radius: source.of_length("particles/trajectory/radius", grains.len())?,
            edges: source.of_length("particles/trajectory/box/edges", 3)?,
        })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A column that was asked for, [L]. Panics on any other name.
    pub fn column(&self, name: &str) -> &[f64] {
        let column = self.columns.get(name);
        column.unwrap_or_else(|| panic!("{name} is no column that was asked for"))
    }

    pub fn is_planar(&self) -> bool {
        self.number("dimension") == Some(2.0)
    }

    /// The box of a stage in which it is not sheared any more.
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

    /// A number among the parameters.
    pub fn number(&self, name: &str) -> Option<f64> {
        match self.parameters.get(name)? {
            Parameter::Number(value) => Some(*value),
            Parameter::Integer(value) => Some(*value as f64),
            _ => None,
        }
    }

    /// A text among the parameters.
    pub fn text(&self, name: &str) -> Option<&str> {
        match self.parameters.get(name)? {
            Parameter::Text(text) => Some(text),
            _ => None,
        }
    }
}

/// The scene of a file of a run, if it has ended. `Failure::Input` where it is none.
pub fn scene_of_finished(path: &Path) -> Result<Option<String>, Failure> {
    hdf5::silence_errors(true);
    let parameters = Source::open(path)?.parameters()?;
    Ok(match (parameters.get("digest"), parameters.get("scene")) {
        (Some(_), Some(Parameter::Text(scene))) => Some(scene.clone()),
        _ => None,
    })
}
