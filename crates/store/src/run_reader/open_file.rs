//! Reads single objects of a file, checks their shape, and makes the messages about them.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io::Read as _;
use std::path::Path;
use std::sync::Arc;

use hdf5::types::VarLenUnicode;
use hdf5::{Dataset, H5Type};

use super::{Parameter, Parameters, Series, StoredContacts, StoredScalars};
use crate::checksums::{self, Constants, OF_PARAMETERS, of_parameters};
use crate::disk;
use crate::layout::{
    ContactTable, EDGES_VALUE, FrameFormat, OBSERVABLES, PARAMETERS, PARTICLES, Quantity, SCALARS,
    grain_dataset, of_contact,
};
use crate::own_columns;
use crate::parameter::attributes;
use crate::part::{OpenPart, Part, groups};
use crate::sound::{self, ReadFile};
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_dem::boundary::{
    Boundary, FLAT_WALLS, FREE_SURFACE, FREE_SURFACE_ABOVE_PLANE, FurtherColumns, PERIODIC,
    ROUGH_WALLS,
};
use gshear_dem::columns::{Column, kept};
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::{
    BottomRow, FlowRow, GrainConstants, ImposedRow, LateralRow, TemperatureRow, body,
};

/// Every HDF5 file begins with these bytes.
const SIGNATURE: [u8; 8] = *b"\x89HDF\r\n\x1a\n";
/// Whether a file, or that of its part, begins as HDF5 files do.
pub fn is_hdf5(path: &Path) -> bool {
    let mut first = [0; SIGNATURE.len()];
    let file = sound::regular(&Part::of(path).file);
    let read = file.and_then(|mut file| file.read_exact(&mut first));
    read.is_ok() && first == SIGNATURE
}

pub(super) const FOREIGN: &str = "not a run of gshear-mpi";
/// An open file and its path for messages.
pub(super) struct OpenFile<'a> {
    file: OpenPart,
    path: &'a Path,
}

/// Where a table is in a file.
#[derive(Clone, Copy)]
pub(super) struct TablePlace {
    /// Its group.
    pub group: &'static str,
    /// The dataset of its checksums.
    pub sums: &'static str,
    /// Whether rows have a time; otherwise it is 0.
    pub has_time: bool,
}

impl<'a> OpenFile<'a> {
    /// Opens the file, which must be HDF5 and whole.
    pub(super) fn open(path: &'a Path) -> Result<Self> {
        let file = open_file(path)?;
        Ok(OpenFile { file, path })
    }

    /// The file, for what keeps its datasets: it must be dropped after them.
    pub(super) fn file(&self) -> Arc<ReadFile> {
        self.file.file()
    }

    /// Closes the file.
    ///
    /// # Errors
    /// If the system fails to.
    pub(super) fn close(self) -> Result<()> {
        let path = self.path.display();
        let closed = self.file.close();
        closed.map_err(|e| Failure::other(format!("{path}: cannot be closed: {}", one_line(&e))))
    }

    pub(super) fn wrong(&self, object: &str, what: impl fmt::Display) -> Failure {
        Failure::input(format!("{}: {object}: {what}", self.path.display()))
    }

    fn lacks(&self, name: &str) -> Failure {
        let path = self.path.display();
        Failure::input(format!("{path}: {name} is missing: {FOREIGN}"))
    }

    pub(super) fn dataset(&self, name: &str) -> Result<Dataset> {
        if !self.exists(name) {
            return Err(self.lacks(name));
        }
        let dataset = self.file.dataset(name);
        dataset.map_err(|e| self.wrong(name, format!("cannot be opened: {}", one_line(&e))))
    }

    /// Checks every group of the path, because HDF5 fails if one of them is missing.
    pub(super) fn exists(&self, name: &str) -> bool {
        let ends = name.match_indices('/').map(|(at, _)| at);
        ends.chain([name.len()])
            .all(|end| self.file.link_exists(&name[..end]))
    }

    pub(super) fn all<T: H5Type>(&self, name: &str) -> Result<Vec<T>> {
        let dataset = self.dataset(name)?;
        if dataset.ndim() != 1 {
            let what = format!("has {} dimensions instead of 1: {FOREIGN}", dataset.ndim());
            return Err(self.wrong(name, what));
        }
        self.whole(name, &dataset)
    }

    /// All values of a dataset, in order.
    fn whole<T: H5Type>(&self, name: &str, dataset: &Dataset) -> Result<Vec<T>> {
        let values = dataset.read_raw();
        values.map_err(|e| self.wrong(name, format!("cannot be read: {}", one_line(&e))))
    }

    pub(super) fn of_length<T: H5Type>(&self, name: &str, length: usize) -> Result<Vec<T>> {
        let values = self.all(name)?;
        if values.len() != length {
            let what = format!("has {} rows instead of {length}", values.len());
            return Err(self.wrong(name, what));
        }
        Ok(values)
    }

    /// Opens a dataset whose first dimension is frames or contacts and the others are `inner`.
    pub(super) fn frames(&self, name: &str, inner: &[usize]) -> Result<Dataset> {
        let dataset = self.dataset(name)?;
        let shape = dataset.shape();
        if shape.len() != inner.len() + 1 || shape[1..] != *inner {
            let what = format!("has the shape {shape:?} instead of [any] + {inner:?}");
            return Err(self.wrong(name, what));
        }
        Ok(dataset)
    }

    /// The dataset of a quantity of so many grains.
    pub(super) fn of_grains(&self, quantity: Quantity, grains: usize) -> Result<Dataset> {
        let inner = [grains, quantity.width];
        let dimensions = if quantity.width == 1 { 1 } else { 2 };
        self.frames(&grain_dataset(&quantity.column), &inner[..dimensions])
    }

    /// A table of contacts.
    pub(super) fn of_contacts(
        &self,
        table: ContactTable,
        form: FrameFormat,
    ) -> Result<StoredContacts> {
        let name = table.dataset("offset");
        let offset: Vec<u64> = self.all(&name)?;
        if let Some(t) = (1..offset.len()).find(|&t| offset[t] < offset[t - 1]) {
            return Err(self.wrong(&name, format!("decreases at frame {t}")));
        }
        let mut columns = BTreeMap::new();
        for Quantity { column, width, .. } in of_contact(table, form) {
            let inner = if width == 1 { &[][..] } else { &[width] };
            let dataset = self.frames(&table.dataset(column), inner)?;
            columns.insert(column.name, dataset);
        }
        Ok(StoredContacts {
            table,
            offset,
            columns,
        })
    }

    /// What is constant of the grains, their ids and materials, verified. `edges`: of the box at
    /// the start.
    pub(super) fn grains(&self, edges: &[f64; 3]) -> Result<(GrainConstants, Vec<u32>, Vec<u8>)> {
        let [id_name, radius, body, mass, material] =
            ["id", "radius", "body", "mass", "material"].map(|name| format!("{PARTICLES}/{name}"));
        let id: Vec<u32> = self.all(&id_name)?;
        if !id.is_sorted_by(|a, b| a < b) {
            return Err(self.wrong(&id_name, "does not ascend"));
        }
        let grains = GrainConstants {
            radius: self.of_length(&radius, id.len())?,
            body: self.of_length(&body, id.len())?,
            mass: self.of_length(&mass, id.len())?,
        };
        let material = if self.exists(&material) {
            self.of_length(&material, id.len())?
        } else {
            vec![0; id.len()]
        };
        let constants = Constants {
            first: 0,
            id: &id,
            body: &grains.body,
            material: &material,
            radius: &grains.radius,
            mass: &grains.mass,
            edges,
        };
        self.verify_constants(constants.checksums())?;
        self.check_grains(&grains)?;
        Ok((grains, id, material))
    }

    /// Checks that there are grains, of some size.
    fn check_grains(&self, grains: &GrainConstants) -> Result<()> {
        if grains.count() == 0 {
            return Err(self.wrong(PARTICLES, "holds no grain"));
        }
        for g in 0..grains.count() {
            let sizes = [grains.radius[g], grains.mass[g]];
            let have_size = sizes.iter().all(|x| x.is_finite() && *x > 0.0);
            if !have_size || grains.body[g] > 2 {
                let what = "radius and mass must be greater than 0, body 0, 1 or 2";
                return Err(self.wrong(PARTICLES, format!("grain {g}: {what}")));
            }
        }
        Ok(())
    }

    /// The edges of the box at the start (m): L_x, height, 0, or L_x, L_y, height.
    pub(super) fn edges(&self, parameters: &Parameters) -> Result<[f64; 3]> {
        match parameters.get("edges") {
            Some(Parameter::Numbers(edges))
                if edges.len() == 3 && edges[0] > 0.0 && edges.iter().all(|x| x.is_finite()) =>
            {
                Ok([edges[0], edges[1], edges[2]])
            }
            _ => {
                let what = "does not hold L_x > 0, height, 0, or L_x > 0, L_y, height";
                Err(self.wrong("parameters: edges", what))
            }
        }
    }

    /// The edges of the box at the first `frames` frames, and the numbers of each.
    pub(super) fn frame_edges(&self, frames: usize) -> Result<(Vec<f64>, usize)> {
        let dataset = self.dataset(EDGES_VALUE)?;
        let width = match dataset.shape()[..] {
            [_, 3] => 3,
            [_, 3, 3] => 9,
            ref shape => return Err(self.wrong(EDGES_VALUE, format!("has the shape {shape:?}"))),
        };
        let mut values = self.whole(EDGES_VALUE, &dataset)?;
        if values.len() < frames * width {
            return Err(self.wrong(EDGES_VALUE, "has fewer rows than there are frames"));
        }
        values.truncate(frames * width);
        Ok((values, width))
    }

    /// What bounds the sample.
    pub(super) fn boundary(
        &self,
        parameters: &Parameters,
        grains: &GrainConstants,
    ) -> Result<&'static Boundary> {
        let Some(stored) = parameters.get("boundary") else {
            return self.boundary_of_earlier_versions(grains);
        };
        let known = match stored {
            Parameter::Text(name) => Boundary::named(name),
            _ => None,
        };
        // The box of a cell without walls is stored as its three edge vectors.
        let has_vectors = self.frame_edges(0)?.1 == 9;
        if let Some(boundary) = known
            && boundary.is_periodic() != has_vectors
        {
            let what = format!("is not of a sample that is bounded by {:?}", boundary.name);
            return Err(self.wrong(EDGES_VALUE, what));
        }
        known.ok_or_else(|| self.wrong("parameters: boundary", "is none that this version knows"))
    }

    /// What bounds the sample of a file of a version that did not say it.
    fn boundary_of_earlier_versions(&self, grains: &GrainConstants) -> Result<&'static Boundary> {
        if self.frame_edges(0)?.1 == 9 {
            return Ok(&PERIODIC);
        }
        let is_flat = grains
            .body
            .iter()
            .all(|body| u32::from(*body) == body::FREE);
        let is_free = self.has_row(&FlowRow::COLUMNS);
        Ok(match (is_free, is_flat) {
            (true, false) => &FREE_SURFACE,
            (true, true) => &FREE_SURFACE_ABOVE_PLANE,
            (false, false) => &ROUGH_WALLS,
            (false, true) => &FLAT_WALLS,
        })
    }

    /// Columns of the time series of a shear with this boundary, those of its scene last.
    pub(super) fn columns_of_shear(
        &self,
        boundary: &'static Boundary,
        parameters: &Parameters,
    ) -> Result<&'static [Column]> {
        let of_program = boundary.series_columns(FurtherColumns {
            imposed: self.has_row(&ImposedRow::COLUMNS),
            lateral: self.has_row(&LateralRow::COLUMNS),
            bottom: self.has_row(&BottomRow::COLUMNS),
            temperatures: self.has_row(&TemperatureRow::COLUMNS),
        });
        let own = match parameters.get(own_columns::ATTRIBUTE) {
            None => return Ok(of_program),
            Some(Parameter::Text(text)) => own_columns::read(text),
            Some(_) => None,
        };
        let own = own.filter(|own| {
            let mut names = BTreeSet::new();
            let mut all = of_program.iter().chain(own);
            all.all(|column| names.insert(column.name))
        });
        let Some(own) = own else {
            let object = format!("parameters: {}", own_columns::ATTRIBUTE);
            return Err(self.wrong(&object, "does not hold columns of the time series"));
        };
        Ok(kept(&[of_program, &own].concat()))
    }

    /// Whether the time series has the columns of a row, which are there together.
    pub(super) fn has_row(&self, row: &[Column]) -> bool {
        self.exists(&format!("{OBSERVABLES}/{}", row[0]))
    }

    /// The table of a group, verified by its checksums: as many rows as every column has.
    pub(super) fn table(
        &self,
        place: TablePlace,
        declared: &'static [Column],
        finished: bool,
    ) -> Result<Series> {
        let group = place.group;
        let of_clock = ["step", "time"].map(|part| format!("{group}/{}/{part}", declared[0]));
        let mut step: Vec<u64> = self.all(&of_clock[0])?;
        let mut lengths = vec![(&*of_clock[0], step.len())];
        let mut time = vec![0.0; step.len()];
        if place.has_time {
            time = self.all(&of_clock[1])?;
            lengths.push((&*of_clock[1], time.len()));
        }
        let mut columns: Vec<Vec<f64>> = Vec::new();
        for column in declared {
            columns.push(self.all(&format!("{group}/{column}/value"))?);
        }
        let names = declared.iter().map(|column| column.name);
        lengths.extend(names.zip(columns.iter().map(Vec::len)));
        let rows = self.common_length(&lengths, finished, "rows")?;
        step.truncate(rows);
        time.truncate(rows);
        for column in &mut columns {
            column.truncate(rows);
        }
        let table = Series {
            declared,
            step,
            time,
            columns,
        };
        self.verify_rows(place, &table)?;
        Ok(table)
    }

    /// Reads the scalars of `observables/gshear/`, if there are any.
    pub(super) fn scalars(&self, finished: bool) -> Result<Option<StoredScalars>> {
        if !self.exists(SCALARS) {
            return Ok(None);
        }
        let place = TablePlace {
            group: SCALARS,
            sums: checksums::SCALARS,
            has_time: false,
        };
        let table = self.table(place, &FrameScalars::COLUMNS, finished)?;
        let mut scalars = Vec::with_capacity(table.rows());
        for k in 0..table.rows() {
            let row = std::array::from_fn(|c| table.columns[c][k]);
            scalars.push(FrameScalars::from_columns(row));
        }
        Ok(Some(StoredScalars {
            scalars,
            step: table.step,
        }))
    }

    /// Returns the shortest length. In a finished run all must be equal; a run that was stopped may
    /// have begun a batch.
    pub(super) fn common_length(
        &self,
        lengths: &[(&str, usize)],
        finished: bool,
        what: &str,
    ) -> Result<usize> {
        let least = lengths.iter().min_by_key(|(_, length)| length);
        let most = lengths.iter().max_by_key(|(_, length)| length);
        let (shortest, least) = *least.expect("some dataset");
        let (longest, most) = *most.expect("some dataset");
        if finished && least != most {
            let what =
                format!("holds {least} {what} where {longest} holds {most}: the file is damaged");
            return Err(self.wrong(shortest, what));
        }
        Ok(least)
    }

    /// Refuses a file whose stages are of different runs. `own`: parameters of this part.
    pub(super) fn is_of_one_run(&self, own: &Parameters) -> Result<()> {
        let Some(Parameter::Text(own)) = own.get("run_id") else {
            return Ok(());
        };
        let file = self.file.file();
        let stored = groups().filter(|group| file.link_exists(group));
        let stored = stored.map(|group| format!("{group}/{PARAMETERS}"));
        for name in stored.chain([PARAMETERS.to_string()]) {
            let other = file.group(&name).and_then(|group| group.attr("run_id"));
            let other = other.and_then(|id| id.read_scalar::<VarLenUnicode>());
            if let Ok(other) = other
                && own != other.as_str()
            {
                let what = format!(
                    "stages of one file are of different runs (run_id {own} and {other}); give the file as one run wrote it"
                );
                return Err(self.wrong(&name, what));
            }
        }
        Ok(())
    }

    pub(super) fn parameters(&self) -> Result<Parameters> {
        if !self.exists(PARAMETERS) {
            return Err(self.lacks(PARAMETERS));
        }
        let group = self.file.group(PARAMETERS);
        let group = group.map_err(|e| self.wrong(PARAMETERS, one_line(&e)))?;
        let mut parameters = attributes(&group)
            .map_err(|(name, e)| self.wrong(&format!("parameters{name}"), one_line(&e)))?;
        let stored = parameters.remove(OF_PARAMETERS);
        if stored == Some(Parameter::Text(of_parameters(&parameters))) {
            Ok(parameters)
        } else {
            Err(self.damage("parameters"))
        }
    }
}

fn open_file(path: &Path) -> Result<OpenPart> {
    let (name, part) = (path.display(), Part::of(path));
    let mut head = Vec::new();
    let begin = sound::regular(&part.file)
        .and_then(|file| file.take(SIGNATURE.len() as u64).read_to_end(&mut head));
    begin.map_err(|e| disk::unread(format!("{name}: cannot be read: {e}")))?;
    if head != SIGNATURE {
        return Err(Failure::input(format!(
            "{name}: is not an HDF5 file: {FOREIGN}"
        )));
    }
    part.open().map_err(|e| {
        let reason = one_line(&e);
        let state = if reason.contains("lock file") {
            "is being written"
        } else if reason.contains("has no group") {
            "is missing"
        } else if disk::is_refused(&reason) {
            "cannot be opened"
        } else {
            "is damaged"
        };
        disk::unread(format!("{name}: {state}: {reason}"))
    })
}

/// Returns the message of an HDF5 error on one line.
pub(crate) fn one_line(error: &hdf5::Error) -> String {
    disk::reason(error)
}
