//! Frames of a run, read on demand.

use std::ops::Range;

use bytemuck::Zeroable;
use hdf5::{Dataset, H5Type};

use super::open_file::one_line;
use super::{FrameFields, RunFile};
use crate::checksums::{self, ContactWeights};
use crate::contact_quantities::{ContactQuantity, of_contacts};
use crate::layout::Kind;
use crate::sound;
use gshear_dem::failure::Result;
use gshear_dem::state::{ContactSample, Frame, FrameRecords, GrainSample, Image};
use gshear_scene::Dimensions;

/// Contacts of some frames, as far as they were read.
pub(super) struct ContactValues {
    /// Row of the first contact.
    first: usize,
    i: Vec<u32>,
    j: Vec<u32>,
    /// Each with the number of values of a contact.
    numbers: Vec<(&'static ContactQuantity, usize, Vec<f64>)>,
    flags: Vec<(&'static ContactQuantity, Vec<u8>)>,
    /// Whether the file says which contacts are idle. In those of earlier versions they are the
    /// ones without a force, which is right unless something attracts.
    has_idle: bool,
}

impl ContactValues {
    pub(super) fn of_rows(&self, rows: Range<usize>) -> Vec<ContactSample> {
        let contact = |k: usize| {
            let mut contact = ContactSample {
                i: self.i[k],
                j: self.j[k],
                ..ContactSample::zeroed()
            };
            for (of, width, values) in &self.numbers {
                of.set_numbers(&mut contact, &values[k * width..][..*width]);
            }
            for (of, flags) in &self.flags {
                of.set_flag(&mut contact, flags[k]);
            }
            if !self.has_idle {
                contact.idle = u64::from(contact.normal_force == 0.0);
            }
            contact
        };
        (rows.start - self.first..rows.end - self.first)
            .map(contact)
            .collect()
    }
}

/// The fields with which a quantity is read.
fn least_fields(of: &ContactQuantity) -> FrameFields {
    match of.column.name {
        "normal_force" | "tangential_force" => FrameFields::Forces,
        _ => FrameFields::All,
    }
}

impl RunFile {
    /// Reads the frames of a range within 0 … T, of disks or spheres.
    ///
    /// # Errors
    /// `Failure::Input` if the file is damaged.
    pub fn records(&self, range: Range<usize>) -> Result<Vec<FrameRecords>> {
        let mut position = self.vectors(&self.position, &range)?.into_iter();
        let mut velocity = self.vectors(&self.velocity, &range)?.into_iter();
        let spins = match self.dimension {
            Dimensions::Two => {
                let spins = self.numbers(&self.angular_velocity, &range)?;
                spins.into_iter().map(|w| [0.0, 0.0, w]).collect()
            }
            Dimensions::Three => self.vectors(&self.angular_velocity, &range)?,
        };
        let mut angular_velocity = spins.into_iter();
        let mut image = self.images(&range)?.into_iter();
        let contacts = self.contacts(&range, FrameFields::All)?;
        let frame = |t: usize| FrameRecords {
            step: self.step[t],
            time: self.time[t],
            grains: (0..self.grains.count() as u64)
                .map(|id| GrainSample {
                    id,
                    position: position.next().unwrap_or_default(),
                    velocity: velocity.next().unwrap_or_default(),
                    angular_velocity: angular_velocity.next().unwrap_or_default(),
                    image: image.next().unwrap_or_default(),
                })
                .collect(),
            contacts: contacts.of_rows(self.rows(t..t + 1)),
        };
        Ok(range.map(frame).collect())
    }

    /// Reads a dataset `[T][N][3]` for some frames, all grains of a frame after the other.
    pub(super) fn vectors(&self, dataset: &Dataset, range: &Range<usize>) -> Result<Vec<[f64; 3]>> {
        let values = self.numbers(dataset, range)?;
        Ok(values.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect())
    }

    /// Returns whether the file has the flags of rolling at its limit: files of disks, and of
    /// spheres that resist it.
    pub fn has_rolling(&self) -> bool {
        self.contacts.contains_key("rolling")
    }

    /// Returns whether the file has those of twisting: files of spheres that resist it.
    pub fn has_twisting(&self) -> bool {
        self.contacts.contains_key("twisting")
    }

    /// Reads the images of some frames, all grains of a frame after the other.
    fn images(&self, range: &Range<usize>) -> Result<Vec<Image>> {
        let values: Vec<i32> = self.read(&self.image, range)?;
        let weights = checksums::weights(0, 3 * self.grains.count());
        for (t, of_frame) in (range.clone()).zip(values.chunks(3 * self.grains.count())) {
            self.verify(t, "image", checksums::of_images(&weights, of_frame))?;
        }
        let images = values.chunks_exact(3);
        Ok(images.map(|v| [v[0], v[1], v[2]].map(i64::from)).collect())
    }

    /// Reads the values of a dataset of grains for some frames, in order, and compares them, frame
    /// by frame, with their checksums.
    fn numbers(&self, dataset: &Dataset, range: &Range<usize>) -> Result<Vec<f64>> {
        let values: Vec<f64> = self.read(dataset, range)?;
        let name = dataset.name();
        let column = name.trim_end_matches("/value").rsplit('/').next();
        let of_frame = (values.len() / range.len().max(1)).max(1);
        let weights = checksums::weights(0, of_frame);
        for (t, values) in range.clone().zip(values.chunks(of_frame)) {
            let found = checksums::of_numbers(&weights, values);
            self.verify(t, column.unwrap_or_default(), found)?;
        }
        Ok(values)
    }

    /// Reads some frames of a dataset of grains, or some rows of one of contacts, all values in
    /// order.
    fn read<T: H5Type>(&self, dataset: &Dataset, rows: &Range<usize>) -> Result<Vec<T>> {
        sound::rows(dataset, rows.clone()).map_err(|e| {
            let (name, why) = (dataset.name(), one_line(&e));
            self.wrong(format!("{} cannot be read: {why}", &name[1..]))
        })
    }

    /// Reads frame t < T of disks.
    ///
    /// # Errors
    /// `Failure::Input` if the file is damaged or the grains are spheres.
    pub fn frame(&self, t: usize) -> Result<Frame> {
        Ok(self.block(t..t + 1)?.swap_remove(0))
    }

    /// Reads the frames of a range within 0 … T, of disks.
    ///
    /// # Errors
    /// `Failure::Input` if the file is damaged or the grains are spheres.
    pub fn block(&self, range: Range<usize>) -> Result<Vec<Frame>> {
        self.block_of(range, FrameFields::All)
    }

    /// Reads the given fields of the frames of a range within 0 … T, of disks.
    ///
    /// # Errors
    /// `Failure::Input` if the file is damaged or the grains are spheres.
    pub fn block_of(&self, range: Range<usize>, fields: FrameFields) -> Result<Vec<Frame>> {
        if self.dimension == Dimensions::Three {
            let what = "this command needs disks; for spheres use dmin, compare or export, or commands on the time series";
            return Err(self.wrong(what));
        }
        let mut position = self.planar(&self.position, &range)?;
        let of_frame = self.grains.count().max(1);
        let images = self.images(&range)?;
        for (place, image) in position.iter_mut().flatten().zip(&images) {
            if self.is_removed(image) {
                *place = [f64::NAN; 2];
            }
        }
        let mut position = position.into_iter();
        let mut images = images.chunks(of_frame);
        let (mut velocity, mut spins) = (Vec::new(), Vec::new());
        if fields == FrameFields::All {
            velocity = self.planar(&self.velocity, &range)?;
            spins = self.numbers(&self.angular_velocity, &range)?;
        }
        let mut velocity = velocity.into_iter();
        let mut spins = spins.chunks(of_frame).map(<[f64]>::to_vec);
        let contacts = self.contacts(&range, fields)?;
        let frame = |t: usize| Frame {
            step: self.step[t],
            time: self.time[t],
            position: position.next().unwrap_or_default(),
            image: images
                .next()
                .map_or_else(Vec::new, |of| of.iter().map(|i| i[0]).collect()),
            velocity: velocity.next().unwrap_or_default(),
            angular_velocity: spins.next().unwrap_or_default(),
            contacts: contacts.of_rows(self.rows(t..t + 1)),
        };
        Ok(range.map(frame).collect())
    }

    /// Reads x and y from a dataset `[T][N][3]`; z must be 0.
    fn planar(&self, dataset: &Dataset, range: &Range<usize>) -> Result<Vec<Vec<[f64; 2]>>> {
        let values = self.vectors(dataset, range)?;
        if values.iter().any(|[.., z]| *z != 0.0) {
            let name = dataset.name();
            let name = &name[1..];
            return Err(self.wrong(format!("{name}: z is not 0: only 2D runs can be reduced")));
        }
        let planar = |frame: &[[f64; 3]]| frame.iter().map(|[x, y, _]| [*x, *y]).collect();
        let frames = values.chunks(self.grains.count().max(1));
        Ok(frames.map(planar).collect())
    }

    /// Returns how many frames to read at a time so that a block stays near 16 MiB. The allocator
    /// reuses memory of this size; for larger blocks the system would clear every page again.
    pub fn block_length(&self) -> usize {
        let frames = self.frames().max(1);
        let contacts = self.offset.last().map_or(0, |all| *all as usize) / frames;
        let bytes =
            self.grains.count() * 11 * size_of::<f64>() + contacts * 2 * size_of::<ContactSample>();
        ((16 << 20) / bytes.max(1)).clamp(1, 512)
    }

    /// Returns the rows of the contacts of some frames.
    pub(super) fn rows(&self, frames: Range<usize>) -> Range<usize> {
        self.offset[frames.start] as usize..self.offset[frames.end] as usize
    }

    pub(super) fn contacts(
        &self,
        frames: &Range<usize>,
        fields: FrameFields,
    ) -> Result<ContactValues> {
        let (rows, form) = (self.rows(frames.clone()), self.form);
        let mut contacts = ContactValues {
            first: rows.start,
            i: self.column("i", &rows)?,
            j: self.column("j", &rows)?,
            numbers: Vec::new(),
            flags: Vec::new(),
            has_idle: form.idle,
        };
        for of in of_contacts(form).filter(|of| fields >= least_fields(of)) {
            let (name, width) = (of.column.name, of.width(form));
            match of.kind {
                Kind::Flag => contacts.flags.push((of, self.column(name, &rows)?)),
                _ => (contacts.numbers).push((of, width, self.column(name, &rows)?)),
            }
        }
        self.check_pairs(&contacts.i, &contacts.j, rows.start)?;
        let weights = ContactWeights::new(&contacts.i, &contacts.j, form.axes);
        for t in frames.clone() {
            let rows = self.rows(t..t + 1);
            let rows = rows.start - contacts.first..rows.end - contacts.first;
            self.verify(t, "pairs", weights.pairs(rows.clone()))?;
            for (of, width, values) in &contacts.numbers {
                let values = &values[rows.start * width..rows.end * width];
                let found = weights.numbers(rows.clone(), values, *width);
                self.verify(t, of.column.name, found)?;
            }
            for (of, flags) in &contacts.flags {
                let found = weights.flags(rows.clone(), &flags[rows.clone()]);
                self.verify(t, of.column.name, found)?;
            }
        }
        Ok(contacts)
    }

    /// Checks the ids of contacts; `first`: row of the first one.
    fn check_pairs(&self, i: &[u32], j: &[u32], first: usize) -> Result<()> {
        let n = self.grains.count();
        match (0..i.len()).find(|&k| i[k] >= j[k] || j[k] as usize >= n) {
            None => Ok(()),
            Some(k) => {
                let (row, i, j) = (first + k, i[k], j[k]);
                Err(self.wrong(format!(
                    "connectivity/contacts: row {row} joins grains {i} and {j}; ids must be i < j < {n}"
                )))
            }
        }
    }

    /// Reads the values of a quantity of the contacts, one contact after the other.
    fn column<T: H5Type>(&self, name: &str, rows: &Range<usize>) -> Result<Vec<T>> {
        if rows.is_empty() {
            return Ok(Vec::new());
        }
        self.read(&self.contacts[name], rows)
    }
}
