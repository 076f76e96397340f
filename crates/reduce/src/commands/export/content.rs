//! The frames of a run as they are exported: state of the grains, contacts, and numbers computed
//! for every grain.

use std::path::Path;

use clap::ValueEnum;

use crate::commands::dmin::{between, is_planar};
use gshear_analysis::dmin;
use gshear_analysis::moments::{distinct, extent};
use gshear_analysis::regions::{GrReading, Regions};
use gshear_analysis::stress;
use gshear_dem::dimension::{Three, Two};
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::{BoxEdges, ContactSample, Frame, FrameRecords};
use gshear_scene::{Dimensions, atom_type};
use gshear_store::contact_quantities::of_contacts;
use gshear_store::run_reader::{RunFile, RunStage};
use gshear_store::spectrum_reader::{Mode, SpectrumFile};
use gshear_store::trajectory::Form;

/// A number of every grain that is computed for the export.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum GrainField {
    /// D²min since the frame before (m²); NaN where it is undefined
    Dmin,
    /// Contact stress (Pa), compression positive: xx, yy, xy; 3D: xx, yy, zz, xy, xz, yz
    Stress,
    /// 1 in the grains of the greatest reduction of force since the frame before (2D)
    Regions,
    /// Number of contacts
    Contacts,
    /// Number of the material; always where there are several
    Material,
}

impl GrainField {
    /// Names of its components.
    fn names(self, dimension: Dimensions) -> Vec<String> {
        let parts: &[&str] = match dimension {
            Dimensions::Two => &["xx", "yy", "xy"],
            Dimensions::Three => &["xx", "yy", "zz", "xy", "xz", "yz"],
        };
        match self {
            GrainField::Dmin => vec!["dmin".into()],
            GrainField::Stress => parts.iter().map(|part| format!("stress_{part}")).collect(),
            GrainField::Regions => vec!["region".into()],
            GrainField::Contacts => vec!["contacts".into()],
            GrainField::Material => vec!["material".into()],
        }
    }

    /// Whether it compares a frame with the one before.
    fn compares(self) -> bool {
        matches!(self, GrainField::Dmin | GrainField::Regions)
    }
}

/// Eigenvectors that are exported with the state they are of.
pub struct ExportedModes {
    /// The state.
    pub frame: usize,
    /// Name and `[N][3]` values: displacements and rotations, real and imaginary parts.
    vectors: Vec<(String, Vec<[f64; 3]>)>,
}

impl ExportedModes {
    /// Reads eigenvectors of these numbers, from 0 on, from a `spectrum.h5` of this run.
    ///
    /// # Errors
    /// A file of another run or of a state without a frame, an eigenvector that it does not have.
    pub fn read(run: &RunFile, spectrum: &Path, numbers: &[usize]) -> Result<Self> {
        let file = SpectrumFile::open(spectrum)?;
        let other =
            |what: &str| Failure::input(format!("--modes: {}: is of {what}", spectrum.display()));
        if let (Some(id), Some(of)) = (&file.run_id, run.text("run_id"))
            && id != of
        {
            return Err(other("another run"));
        }
        if file.stage != run.stage().name() {
            return Err(other(&format!(
                "the stage {} of the run, not of {}",
                file.stage,
                run.path().display()
            )));
        }
        let Ok(frame) = run.frame_steps().binary_search(&file.step) else {
            return Err(other(&format!("step {}, which has no frame", file.step)));
        };
        let mut vectors = Vec::new();
        for k in distinct(numbers.iter().copied()) {
            let Mode {
                displacement,
                rotation,
            } = file.mode(k, run.grains().count())?;
            for (kind, parts) in [("displacement", displacement), ("rotation", rotation)] {
                for (part, values) in ["re", "im"].into_iter().zip(parts) {
                    vectors.push((format!("mode{k}_{kind}_{part}"), values));
                }
            }
        }
        Ok(Self { frame, vectors })
    }
}

/// The name of a number, or those of the components of a vector.
fn component_names(name: &str, components: usize) -> Vec<String> {
    match components {
        1 => vec![name.into()],
        _ => ["x", "y", "z"].map(|axis| format!("{name}_{axis}")).into(),
    }
}

/// A run, and what is exported of it.
pub struct ExportedRun<'a> {
    /// The file of the run.
    pub file: &'a RunFile,
    fields: Vec<GrainField>,
    modes: Option<ExportedModes>,
    strains: Vec<f64>,
}

/// One frame.
pub struct ExportedFrame {
    /// Number of the frame in the run.
    pub number: usize,
    /// γ.
    pub strain: f64,
    /// Steps and time (s) since the start of the shear, grains and contacts.
    pub records: FrameRecords,
    /// Rows of the grains that had not been removed.
    pub present: Vec<usize>,
    /// `[N][components]` Values of the computed fields, in the order of [`ExportedRun::shapes`].
    pub fields: Vec<Vec<f64>>,
}

impl<'a> ExportedRun<'a> {
    /// # Errors
    /// A run without strains; fields that spheres or boxes do not have.
    pub fn new(
        run: &'a RunFile,
        fields: &[GrainField],
        modes: Option<ExportedModes>,
    ) -> Result<Self> {
        let is_planar = run.dimension() == Dimensions::Two;
        let has_regions = is_planar && run.has_walls();
        if fields.contains(&GrainField::Regions) && !has_regions {
            return Err(Failure::input(format!(
                "--fields regions: {}: needs disks between walls",
                run.path().display()
            )));
        }
        let several = run.material().iter().any(|material| *material > 0);
        let material = several.then_some(GrainField::Material);
        Ok(Self {
            file: run,
            fields: distinct(fields.iter().copied().chain(material)),
            modes,
            strains: run.frame_strains()?,
        })
    }

    /// The type of a grain's atom.
    pub fn atom_type(&self, g: usize) -> u32 {
        atom_type(
            self.file.grains().body[g].into(),
            self.file.material()[g].into(),
        )
    }

    /// Number of dimensions.
    pub fn axes(&self) -> usize {
        self.file.dimension().axes()
    }

    /// Name and number of components, 1 or 3, of each of the computed fields.
    pub fn shapes(&self) -> Vec<(String, usize)> {
        let dimension = self.file.dimension();
        let names = self.fields.iter().flat_map(|field| field.names(dimension));
        let modes = self.modes.iter().flat_map(|modes| &modes.vectors);
        let modes = modes.map(|(name, _)| (name.clone(), 3));
        names.map(|name| (name, 1)).chain(modes).collect()
    }

    /// Names of their components.
    pub fn field_names(&self) -> Vec<String> {
        let shapes = self.shapes().into_iter();
        let names = shapes.flat_map(|(name, components)| component_names(&name, components));
        names.collect()
    }

    /// Position, velocity, angular velocity, radius and mass of a grain.
    pub fn state_values(
        &self,
        frame: &ExportedFrame,
        grain: usize,
    ) -> impl Iterator<Item = f64> + use<> {
        let (of, fixed) = (&frame.records.grains[grain], self.file.grains());
        let vectors = [of.position, of.velocity, of.angular_velocity];
        let constants = [fixed.radius[grain], fixed.mass[grain]];
        vectors.into_iter().flatten().chain(constants)
    }

    /// The values of the computed fields of a grain.
    pub fn field_values<'f>(
        &self,
        frame: &'f ExportedFrame,
        grain: usize,
    ) -> impl Iterator<Item = f64> + 'f {
        let grains = self.file.grains().count();
        frame.fields.iter().flat_map(move |values| {
            let components = values.len() / grains;
            values[grain * components..][..components].iter().copied()
        })
    }

    /// Units of lengths, times and masses; a box may have any consistent ones.
    pub fn units(&self) -> Option<&'static str> {
        (self.file.stage() == RunStage::Shear).then_some("m s kg")
    }

    /// Which axes are periodic.
    pub fn periodic(&self) -> [bool; 3] {
        let is_box = !self.file.has_walls();
        match self.file.dimension() {
            Dimensions::Two => [true, is_box, false],
            Dimensions::Three => [true, true, is_box],
        }
    }

    /// Displacement along x of the image above (m), by which the box is tilted; `None` between
    /// walls.
    pub fn tilt(&self, frame: &ExportedFrame) -> Option<f64> {
        let sheared = self.file.cell(frame.number).sheared;
        sheared.map(|sheared| sheared.offset)
    }

    /// The edge vectors of the box, one a row (m), with the lengths of [`Self::bounds`].
    pub fn edges(&self, frame: &ExportedFrame) -> BoxEdges {
        let mut edges = [[0.0; 3]; 3];
        for (axis, [low, high]) in self.bounds(frame).into_iter().enumerate() {
            edges[axis][axis] = high - low;
        }
        edges[self.axes() - 1][0] = self.tilt(frame).unwrap_or(0.0);
        edges
    }

    /// The name, the version and the origin, on one line.
    pub fn title(&self) -> String {
        let path = self.file.path().display();
        format!("{path}; {}", gshear_store::provenance::printed())
    }

    /// Lower and upper bounds along each axis (m): the period, or the extent of the grains. In 2D
    /// the box is as thick as the greatest grain.
    pub fn bounds(&self, frame: &ExportedFrame) -> [[f64; 2]; 3] {
        let up = self.axes() - 1;
        let radius = &self.file.grains().radius;
        let at = |g: usize| frame.records.grains[g].position[up];
        let ends = frame.present.iter().map(|&g| (at(g), radius[g]));
        let extent = extent(ends.flat_map(|(at, r)| [at - r, at + r]));
        let cell = self.file.cell(frame.number);
        let extent = cell.sheared.map_or(extent, |of| [0.0, of.height]);
        let periods = cell.periods;
        let largest = radius.iter().copied().fold(0.0, f64::max);
        match self.file.dimension() {
            Dimensions::Two => [[0.0, periods[0]], extent, [-largest, largest]],
            Dimensions::Three => [[0.0, periods[0]], [0.0, periods[1]], extent],
        }
    }

    /// Position of the image of grain j nearest to grain i (m), and whether it is another image
    /// than the one in the box.
    pub fn nearest_image(&self, frame: &ExportedFrame, i: u32, j: u32) -> ([f64; 3], bool) {
        let [from, to] = [i, j].map(|g| frame.records.grains[g as usize].position);
        let cell = self.file.cell(frame.number);
        let apart = match self.file.dimension() {
            Dimensions::Two => cell.separation::<Two>(&to, &from),
            Dimensions::Three => cell.separation::<Three>(&to, &from),
        };
        let image: [f64; 3] = std::array::from_fn(|axis| from[axis] + apart[axis]);
        // Another image is a period away along some axis.
        let lengths = self.bounds(frame).map(|[low, high]| high - low);
        let periodic = self.periodic();
        let moved =
            |axis: usize| periodic[axis] && (image[axis] - to[axis]).abs() > 0.25 * lengths[axis];
        let moved = (0..self.axes()).any(moved);
        (if moved { image } else { to }, moved)
    }

    /// Calls `each` for these frames, in order.
    pub fn each_frame(
        &self,
        numbers: &[usize],
        mut each: impl FnMut(&ExportedFrame) -> Result<()>,
    ) -> Result<()> {
        let compares = self.fields.iter().any(|field| field.compares());
        let read = |t: usize| Ok(self.file.records(t..t + 1)?.swap_remove(0));
        let mut last: Option<(usize, FrameRecords)> = None;
        for &number in numbers {
            let records = read(number)?;
            let before = match number.checked_sub(1).filter(|_| compares) {
                Some(before) => match last.take() {
                    Some((at, frame)) if at == before => Some(frame),
                    _ => Some(read(before)?),
                },
                None => None,
            };
            let fields = self.fields(number, before.as_ref(), &records);
            let grains = records.grains.iter().enumerate();
            let present = grains.filter(|(_, grain)| !self.file.is_removed(&grain.image));
            let frame = ExportedFrame {
                number,
                strain: self.strains[number],
                present: present.map(|(g, _)| g).collect(),
                records,
                fields,
            };
            each(&frame)?;
            last = Some((number, frame.records));
        }
        Ok(())
    }

    fn fields(
        &self,
        number: usize,
        before: Option<&FrameRecords>,
        now: &FrameRecords,
    ) -> Vec<Vec<f64>> {
        let material = self.file.material().iter().copied().map(f64::from);
        let columns = self.fields.iter().flat_map(|field| match field {
            GrainField::Dmin => vec![self.dmin(number, before, now)],
            GrainField::Stress => self.stress(number, now),
            GrainField::Regions => vec![self.regions(before, now)],
            GrainField::Contacts => vec![self.contacts(now)],
            GrainField::Material => vec![material.clone().collect()],
        });
        let modes = self.modes.iter().flat_map(|modes| &modes.vectors);
        let flat = modes.map(|(_, values)| values.as_flattened().to_vec());
        columns.chain(flat).collect()
    }

    fn stress(&self, number: usize, now: &FrameRecords) -> Vec<Vec<f64>> {
        let (grains, cell) = (self.file.grains(), self.file.cell(number));
        let (tensors, parts) = match self.file.dimension() {
            Dimensions::Two => (stress::in_cell::<Two>(grains, cell, now), &[0, 1, 3][..]),
            Dimensions::Three => {
                let tensors = stress::in_cell::<Three>(grains, cell, now);
                (tensors, &[0, 1, 2, 3, 4, 5][..])
            }
        };
        let column = |part: &usize| tensors.iter().map(|tensor| tensor[*part]).collect();
        parts.iter().map(column).collect()
    }

    fn dmin(&self, number: usize, before: Option<&FrameRecords>, now: &FrameRecords) -> Vec<f64> {
        let grains = self.file.grains();
        let Some(before) = before else {
            return vec![f64::NAN; grains.count()];
        };
        if is_planar(self.file) {
            return dmin::between(grains, &planar(before), &planar(now));
        }
        let radius = dmin::RADIUS * grains.mean_radius();
        between(self.file, [number - 1, number], [before, now], radius)
    }

    fn regions(&self, before: Option<&FrameRecords>, now: &FrameRecords) -> Vec<f64> {
        let mut inside = vec![0.0; self.file.grains().count()];
        if let Some(before) = before {
            let mut regions = Regions::default();
            regions.find(self.file.grains(), &planar(before), &planar(now));
            let reading = GrReading::default();
            let labels = regions.labels(reading);
            for (&grain, label) in regions.grains(reading.reduction).iter().zip(labels) {
                inside[grain as usize] = f64::from(u8::from(label.is_some()));
            }
        }
        inside
    }

    fn contacts(&self, now: &FrameRecords) -> Vec<f64> {
        let mut count = vec![0.0; self.file.grains().count()];
        for contact in &now.contacts {
            for grain in [contact.i, contact.j] {
                count[grain as usize] += 1.0;
            }
        }
        count
    }
}

/// A frame of disks.
fn planar(frame: &FrameRecords) -> Frame {
    let two = |[x, y, _]: [f64; 3]| [x, y];
    Frame {
        step: frame.step,
        time: frame.time,
        position: frame.grains.iter().map(|g| two(g.position)).collect(),
        image: frame.grains.iter().map(|g| g.image[0]).collect(),
        velocity: frame.grains.iter().map(|g| two(g.velocity)).collect(),
        angular_velocity: frame.grains.iter().map(|g| g.angular_velocity[2]).collect(),
        contacts: frame.contacts.clone(),
    }
}

/// Names of the components of all quantities of contacts.
pub fn contact_names(form: Form) -> impl Iterator<Item = String> {
    of_contacts(form).flat_map(move |of| component_names(of.column.name, of.width(form)))
}

/// Their values.
pub fn contact_values(form: Form, contact: &ContactSample) -> impl Iterator<Item = f64> {
    of_contacts(form).flat_map(move |of| of.values(form, contact))
}

/// Names of position, velocity and angular velocity of a grain, which [`ExportedRun::state_values`]
/// begins with.
pub fn state_names() -> impl Iterator<Item = String> {
    let vectors = ["", "velocity_", "angular_velocity_"].into_iter();
    vectors.flat_map(|of| ["x", "y", "z"].map(|axis| format!("{of}{axis}")))
}
