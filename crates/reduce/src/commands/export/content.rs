//! The frames of a run as they are exported: state of the grains, contacts, and numbers computed
//! for every grain.

use std::path::Path;

use clap::ValueEnum;

use gshear_analysis::dmin;
use gshear_analysis::moments::{distinct, extent};
use gshear_analysis::regions::{GrReading, Regions};
use gshear_analysis::stress;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::{BoxEdges, ContactSample, Frame};
use gshear_scene::{Dimensions, atom_type};
use gshear_store::contact_quantities::of_contacts;
use gshear_store::run_reader::{RunFile, RunStage};
use gshear_store::spectrum_reader::{Mode, SpectrumFile};
use gshear_store::trajectory::FrameFormat;

/// A number of every grain that is computed for the export.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum GrainField {
    /// D²min since the frame before (m²); NaN where it is undefined
    Dmin,
    /// Contact stress (Pa), compression positive: xx, yy, xy; 3D: xx, yy, zz, xy, xz, yz
    Stress,
    /// 1 in the grains of the greatest reduction of force since the frame before (2D)
    Regions,
    /// Number of contacts, those with flat walls as well
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
pub(crate) struct ExportedModes {
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
        if let (Some(id), Some(own)) = (&file.run_id, run.text("run_id"))
            && id != own
        {
            return Err(unfit(spectrum, "another run"));
        }
        if file.stage != run.stage().name() {
            let run = run.path().display();
            let what = format!("the stage {} of the run, not of {run}", file.stage);
            return Err(unfit(spectrum, &what));
        }
        let Ok(frame) = run.frame_steps().binary_search(&file.step) else {
            let what = format!("step {}, which has no frame", file.step);
            return Err(unfit(spectrum, &what));
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

/// The failure that refuses eigenvectors of something else.
fn unfit(spectrum: &Path, what: &str) -> Failure {
    Failure::input(format!("--modes: {}: is of {what}", spectrum.display()))
}

/// The name of a number, or those of the components of a vector.
fn component_names(name: &str, components: usize) -> Vec<String> {
    match components {
        1 => vec![name.into()],
        _ => ["x", "y", "z"].map(|axis| format!("{name}_{axis}")).into(),
    }
}

/// A run, and what is exported of it.
pub(crate) struct ExportedRun<'a> {
    /// The file of the run.
    pub file: &'a RunFile,
    fields: Vec<GrainField>,
    modes: Option<ExportedModes>,
    strains: Vec<f64>,
}

/// One frame.
pub(crate) struct ExportedFrame {
    /// Number of the frame in the run.
    pub number: usize,
    /// γ.
    pub strain: f64,
    /// Steps and time (s) since the start of the shear, grains and contacts.
    pub records: Frame,
    /// Rows of the grains that had not been removed.
    pub present: Vec<usize>,
    /// `[N][components]` Values of the computed fields, in the order of [`ExportedRun::shapes`].
    pub fields: Vec<Vec<f64>>,
}

impl<'a> ExportedRun<'a> {
    /// # Errors
    /// A run without strains; fields that boxes do not have.
    pub fn new(
        run: &'a RunFile,
        fields: &[GrainField],
        modes: Option<ExportedModes>,
    ) -> Result<Self> {
        if fields.contains(&GrainField::Regions) && !run.boundary().has_walls() {
            return Err(Failure::input(format!(
                "--fields regions: {}: needs grains between walls",
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
    pub(crate) fn field_names(&self) -> Vec<String> {
        let shapes = self.shapes().into_iter();
        let names = shapes.flat_map(|(name, components)| component_names(&name, components));
        names.collect()
    }

    /// Position, velocity, angular velocity, radius and mass of a grain.
    pub(crate) fn state_values(
        &self,
        frame: &ExportedFrame,
        grain: usize,
    ) -> impl Iterator<Item = f64> + use<> {
        let (sample, fixed) = (&frame.records.grains[grain], self.file.grains());
        let vectors = [sample.position, sample.velocity, sample.angular_velocity];
        let constants = [fixed.radius[grain], fixed.mass[grain]];
        vectors.into_iter().flatten().chain(constants)
    }

    /// The values of the computed fields of a grain.
    pub(crate) fn field_values<'f>(
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
        let is_box = self.file.boundary().is_periodic();
        match self.file.dimension() {
            Dimensions::Two => [true, is_box, false],
            Dimensions::Three => [true, true, is_box],
        }
    }

    /// Displacement along x of the image above (m), by which the box is tilted; `None` between
    /// walls.
    pub fn tilt(&self, frame: &ExportedFrame) -> Option<f64> {
        let sheared = frame.records.cell.sheared;
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
        let cell = frame.records.cell;
        let extent = match cell.sheared {
            Some(sheared) => [0.0, sheared.height],
            None => extent(frame.present.iter().flat_map(|&g| {
                let (at, r) = (frame.records.grains[g].position[up], radius[g]);
                [at - r, at + r]
            })),
        };
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
        let apart = frame.records.separation(i, j);
        let image: [f64; 3] = std::array::from_fn(|axis| from[axis] + apart[axis]);
        // Another image is a period away along some axis.
        let lengths = self.bounds(frame).map(|[low, high]| high - low);
        let periodic = self.periodic();
        let moved = (0..self.axes())
            .any(|axis| periodic[axis] && (image[axis] - to[axis]).abs() > 0.25 * lengths[axis]);
        (if moved { image } else { to }, moved)
    }

    /// The point at which a grain touches a flat wall (m): that of the plane nearest to its centre.
    pub fn wall_point(&self, frame: &ExportedFrame, contact: &ContactSample) -> [f64; 3] {
        let grain = contact.i as usize;
        let normal = frame.records.wall_normal(contact).unwrap_or_default();
        let distance = self.file.grains().radius[grain] - contact.overlap;
        let from = frame.records.grains[grain].position;
        std::array::from_fn(|axis| from[axis] - distance * normal[axis])
    }

    /// Calls `each` for these frames, in order.
    pub(crate) fn each_frame(
        &self,
        numbers: &[usize],
        mut each: impl FnMut(&ExportedFrame) -> Result<()>,
    ) -> Result<()> {
        let compares = self.fields.iter().any(|field| field.compares());
        let mut last: Option<(usize, Frame)> = None;
        for &number in numbers {
            let records = self.file.frame(number)?;
            let before = match number.checked_sub(1) {
                Some(before) if compares => match last.take() {
                    Some((at, frame)) if at == before => Some(frame),
                    _ => Some(self.file.frame(before)?),
                },
                _ => None,
            };
            let fields = self.fields(number, before.as_ref(), &records);
            let grains = records.grains.iter().enumerate();
            let present = grains.filter(|(_, grain)| grain.removed == 0);
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

    fn fields(&self, number: usize, before: Option<&Frame>, now: &Frame) -> Vec<Vec<f64>> {
        let material = self.file.material().iter().copied().map(f64::from);
        let columns = self.fields.iter().flat_map(|field| match field {
            GrainField::Dmin => vec![self.dmin(number, before, now)],
            GrainField::Stress => self.stress(now),
            GrainField::Regions => vec![self.regions(before, now)],
            GrainField::Contacts => vec![self.contacts(now)],
            GrainField::Material => vec![material.clone().collect()],
        });
        let modes = self.modes.iter().flat_map(|modes| &modes.vectors);
        let flat = modes.map(|(_, values)| values.as_flattened().to_vec());
        columns.chain(flat).collect()
    }

    fn stress(&self, now: &Frame) -> Vec<Vec<f64>> {
        let tensors = stress::tensors(self.file.grains(), now);
        let parts: &[usize] = match now.dimension {
            Dimensions::Two => &[0, 1, 3],
            Dimensions::Three => &[0, 1, 2, 3, 4, 5],
        };
        let columns = parts
            .iter()
            .map(|&part| tensors.iter().map(|tensor| tensor[part]).collect());
        columns.collect()
    }

    fn dmin(&self, number: usize, before: Option<&Frame>, now: &Frame) -> Vec<f64> {
        let grains = self.file.grains();
        let Some(before) = before else {
            return vec![f64::NAN; grains.count()];
        };
        let interval = self.file.interval([number - 1, number], [before, now]);
        dmin::between(grains, &interval)
    }

    fn regions(&self, before: Option<&Frame>, now: &Frame) -> Vec<f64> {
        let mut inside = vec![0.0; self.file.grains().count()];
        if let Some(before) = before {
            let mut regions = Regions::default();
            regions.find(self.file.grains(), before, now);
            let reading = GrReading::default();
            let labels = regions.labels(reading);
            for (&grain, label) in regions.grains(reading.reduction).iter().zip(labels) {
                inside[grain as usize] = f64::from(u8::from(label.is_some()));
            }
        }
        inside
    }

    fn contacts(&self, now: &Frame) -> Vec<f64> {
        let mut count = vec![0.0; self.file.grains().count()];
        for contact in &now.contacts {
            for grain in [contact.i, contact.j] {
                count[grain as usize] += 1.0;
            }
        }
        for contact in &now.wall_contacts {
            count[contact.i as usize] += 1.0;
        }
        count
    }
}

/// Names of the components of all quantities of contacts.
pub(crate) fn contact_names(form: FrameFormat) -> impl Iterator<Item = String> {
    let quantities = of_contacts(form);
    quantities.flat_map(move |known| component_names(known.column.name, known.width(form)))
}

/// Their values.
pub(crate) fn contact_values(
    form: FrameFormat,
    contact: &ContactSample,
) -> impl Iterator<Item = f64> {
    of_contacts(form).flat_map(move |quantity| quantity.values(form, contact))
}

/// Names of position, velocity and angular velocity of a grain, which [`ExportedRun::state_values`]
/// begins with.
pub(crate) fn state_names() -> impl Iterator<Item = String> {
    let vectors = ["", "velocity_", "angular_velocity_"].into_iter();
    vectors.flat_map(|vector| ["x", "y", "z"].map(|axis| format!("{vector}{axis}")))
}
