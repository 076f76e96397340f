//! Frames of a run, read on demand.

use std::ops::Range;

use bytemuck::Zeroable;
use hdf5::{Dataset, H5Type};

use super::open_file::one_line;
use super::{FrameFields, RunFile, StoredContacts};
use crate::checksums::{self, ContactWeights};
use crate::contact_quantities::{ContactQuantity, of_contacts};
use crate::layout::{ContactTable, Kind, REMOVED, checksum_name};
use crate::sound;
use gshear_dem::failure::Result;
use gshear_dem::state::{ContactSample, Frame, GrainSample, Image, body};
use gshear_scene::Dimensions;

/// Contacts of some frames, as far as they were read.
struct ContactValues {
    /// Row of the first contact.
    first: usize,
    i: Vec<u32>,
    j: Vec<u32>,
    numbers: Vec<NumberColumn>,
    flags: Vec<FlagColumn>,
    /// Whether the file says which contacts are idle. In those of earlier versions they are the
    /// ones without a force, which is right unless something attracts.
    has_idle: bool,
}

/// Numbers of contacts.
struct NumberColumn {
    quantity: &'static ContactQuantity,
    /// Number of values of a contact.
    width: usize,
    values: Vec<f64>,
}

/// Flags of contacts.
struct FlagColumn {
    quantity: &'static ContactQuantity,
    flags: Vec<u8>,
}

impl ContactValues {
    fn of_rows(&self, rows: Range<usize>) -> Vec<ContactSample> {
        let mut contacts = Vec::with_capacity(rows.len());
        for k in rows.start - self.first..rows.end - self.first {
            let mut contact = ContactSample {
                i: self.i[k],
                j: self.j[k],
                ..ContactSample::zeroed()
            };
            for column in &self.numbers {
                let values = &column.values[k * column.width..][..column.width];
                column.quantity.set_numbers(&mut contact, values);
            }
            for column in &self.flags {
                column.quantity.set_flag(&mut contact, column.flags[k]);
            }
            if !self.has_idle {
                contact.idle = u64::from(contact.normal_force == 0.0);
            }
            contacts.push(contact);
        }
        contacts
    }
}

/// The fields with which a quantity is read.
fn least_fields(quantity: &ContactQuantity) -> FrameFields {
    match quantity.column.name {
        "normal_force" | "tangential_force" => FrameFields::Forces,
        _ => FrameFields::All,
    }
}

impl RunFile {
    /// Returns whether the grains are disks between walls, of which there are maps.
    pub fn has_disks_between_walls(&self) -> bool {
        self.boundary.has_walls() && self.dimension == Dimensions::Two
    }

    /// Reads frame t < T.
    ///
    /// # Errors
    /// `Failure::Input` if the file is damaged.
    pub fn frame(&self, t: usize) -> Result<Frame> {
        Ok(self.records(t..t + 1)?.swap_remove(0))
    }

    /// Reads the frames of a range within 0 … T.
    ///
    /// # Errors
    /// `Failure::Input` if the file is damaged.
    pub fn records(&self, range: Range<usize>) -> Result<Vec<Frame>> {
        self.records_with(range, FrameFields::All)
    }

    /// Reads the given fields of the frames of a range within 0 … T.
    ///
    /// # Errors
    /// `Failure::Input` if the file is damaged.
    pub fn records_with(&self, range: Range<usize>, fields: FrameFields) -> Result<Vec<Frame>> {
        let mut grains = self.places(&range)?;
        if fields == FrameFields::All {
            self.read_velocities(&range, &mut grains)?;
        }
        let mut contacts = Vec::new();
        for table in &self.contacts {
            contacts.push(self.contacts(table, &range, fields)?.into_iter());
        }
        let mut grains = grains.chunks(self.grains.count().max(1));
        let frames = range.map(|t| {
            let mut of_tables = contacts.iter_mut().filter_map(Iterator::next);
            Frame {
                dimension: self.dimension,
                cell: self.cell(t),
                step: self.step[t],
                time: self.time[t],
                grains: grains.next().unwrap_or_default().to_vec(),
                contacts: of_tables.next().unwrap_or_default(),
                wall_contacts: of_tables.next().unwrap_or_default(),
            }
        });
        Ok(frames.collect())
    }

    /// Reads positions and images of some frames, all grains of a frame after the other; all else
    /// of the grains is 0.
    pub(super) fn places(&self, range: &Range<usize>) -> Result<Vec<GrainSample>> {
        let positions = self.vectors_in_space(&self.position, range)?;
        let mut images = self.images(range)?;
        let removed = self.removed(range, &mut images)?;
        let ids = (0..self.grains.count() as u32).cycle();
        let grains = ids.zip(positions).zip(images).zip(removed);
        let grains = grains.map(|(((id, position), image), removed)| GrainSample {
            id,
            removed: removed.into(),
            position,
            image,
            ..GrainSample::zeroed()
        });
        Ok(grains.collect())
    }

    /// Reads which grains of some frames had been removed: not 0. Files of earlier versions say it
    /// by an image along the axis that walls bound, which is taken from `images`.
    fn removed(&self, range: &Range<usize>, images: &mut [Image]) -> Result<Vec<u8>> {
        let Some(dataset) = &self.removed else {
            let mut removed = vec![0; images.len()];
            if self.boundary.has_walls() {
                let up = self.dimension.axes() - 1;
                for (removed, image) in removed.iter_mut().zip(images) {
                    *removed = (std::mem::take(&mut image[up]) != 0).into();
                }
            }
            return Ok(removed);
        };
        let removed: Vec<u8> = self.read(dataset, range)?;
        let grains = self.grains.count();
        let weights = checksums::weights(0, grains);
        for (t, of_frame) in range.clone().zip(removed.chunks(grains)) {
            self.verify(
                t,
                REMOVED.column.name,
                checksums::of_flags(&weights, of_frame),
            )?;
        }
        Ok(removed)
    }

    /// Reads the velocities of some frames into their grains.
    fn read_velocities(&self, range: &Range<usize>, grains: &mut [GrainSample]) -> Result<()> {
        let velocities = self.vectors_in_space(&self.velocity, range)?;
        for (grain, velocity) in grains.iter_mut().zip(velocities) {
            grain.velocity = velocity;
        }
        match self.dimension {
            Dimensions::Two => {
                let spins = self.numbers(&self.angular_velocity, range)?;
                for (grain, spin) in grains.iter_mut().zip(spins) {
                    grain.angular_velocity[2] = spin;
                }
            }
            Dimensions::Three => {
                let spins = self.vectors(&self.angular_velocity, range)?;
                for (grain, spin) in grains.iter_mut().zip(spins) {
                    grain.angular_velocity = spin;
                }
            }
        }
        Ok(())
    }

    /// [`Self::vectors`], whose z must be 0 of disks.
    fn vectors_in_space(&self, dataset: &Dataset, range: &Range<usize>) -> Result<Vec<[f64; 3]>> {
        let values = self.vectors(dataset, range)?;
        if self.dimension == Dimensions::Two && values.iter().any(|[.., z]| *z != 0.0) {
            let name = dataset.name();
            let name = &name[1..];
            return Err(self.wrong(format!("{name}: z is not 0: only 2D runs can be reduced")));
        }
        Ok(values)
    }

    /// Reads a dataset `[T][N][3]` for some frames, all grains of a frame after the other.
    pub(super) fn vectors(&self, dataset: &Dataset, range: &Range<usize>) -> Result<Vec<[f64; 3]>> {
        let values = self.numbers(dataset, range)?;
        Ok(values.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect())
    }

    /// Returns whether the file has the flags of rolling at its limit: files of disks, and of
    /// spheres that resist it.
    pub(crate) fn has_rolling(&self) -> bool {
        self.contacts[0].columns.contains_key("rolling")
    }

    /// Returns whether the file has those of twisting: files of spheres that resist it.
    pub(crate) fn has_twisting(&self) -> bool {
        self.contacts[0].columns.contains_key("twisting")
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
            let sum = checksums::of_numbers(&weights, values);
            self.verify(t, column.unwrap_or_default(), sum)?;
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

    /// Returns how many frames to read at a time so that a block stays near 16 MiB. The allocator
    /// reuses memory of this size; for larger blocks the system would clear every page again.
    pub fn block_length(&self) -> usize {
        let frames = self.frames().max(1);
        let ends = self.contacts.iter().filter_map(|table| table.offset.last());
        let contacts = ends.sum::<u64>() as usize / frames;
        let bytes =
            self.grains.count() * 11 * size_of::<f64>() + contacts * 2 * size_of::<ContactSample>();
        ((16 << 20) / bytes.max(1)).clamp(1, 512)
    }

    /// Reads the contacts of a table, of each of some frames.
    pub(super) fn contacts(
        &self,
        table: &StoredContacts,
        frames: &Range<usize>,
        fields: FrameFields,
    ) -> Result<Vec<Vec<ContactSample>>> {
        let values = self.contact_values(table, frames, fields)?;
        let of_frames = frames.clone();
        Ok(of_frames
            .map(|t| values.of_rows(table.rows(t..t + 1)))
            .collect())
    }

    fn contact_values(
        &self,
        table: &StoredContacts,
        frames: &Range<usize>,
        fields: FrameFields,
    ) -> Result<ContactValues> {
        let (rows, form) = (table.rows(frames.clone()), self.form);
        let mut contacts = ContactValues {
            first: rows.start,
            i: self.column(table, "i", &rows)?,
            j: self.second_ids(table, &rows)?,
            numbers: Vec::new(),
            flags: Vec::new(),
            has_idle: form.idle,
        };
        for quantity in of_contacts(form) {
            let name = quantity.column.name;
            match quantity.kind {
                _ if fields < least_fields(quantity) => {}
                Kind::Flag => contacts.flags.push(FlagColumn {
                    quantity,
                    flags: self.column(table, name, &rows)?,
                }),
                _ => contacts.numbers.push(NumberColumn {
                    quantity,
                    width: quantity.width(form),
                    values: self.column(table, name, &rows)?,
                }),
            }
        }
        self.check_pairs(table.table, &contacts.i, &contacts.j, rows.start)?;
        let weights = ContactWeights::new(&contacts.i, &contacts.j, form.axes);
        for t in frames.clone() {
            let rows = table.rows(t..t + 1);
            let rows = rows.start - contacts.first..rows.end - contacts.first;
            let verify =
                |name: &str, sum: u64| self.verify(t, &checksum_name(table.table, name), sum);
            verify("pairs", weights.pairs(rows.clone()))?;
            for column in &contacts.numbers {
                let width = column.width;
                let values = &column.values[rows.start * width..rows.end * width];
                let sum = weights.numbers(rows.clone(), values, width);
                verify(column.quantity.column.name, sum)?;
            }
            for column in &contacts.flags {
                let sum = weights.flags(rows.clone(), &column.flags[rows.clone()]);
                verify(column.quantity.column.name, sum)?;
            }
        }
        Ok(contacts)
    }

    /// Checks the ids of contacts; `first`: row of the first one.
    fn check_pairs(&self, table: ContactTable, i: &[u32], j: &[u32], first: usize) -> Result<()> {
        let n = self.grains.count() as u32;
        let is_right = |i: u32, j: u32| match table {
            ContactTable::Grains => i < j && j < n,
            ContactTable::Walls => i < n && (n..n + 2).contains(&j),
        };
        let Some(k) = (0..i.len()).find(|&k| !is_right(i[k], j[k])) else {
            return Ok(());
        };
        let (group, row, i, j) = (table.group(), first + k, i[k], j[k]);
        Err(self.wrong(match table {
            ContactTable::Grains => {
                format!("{group}: row {row} joins grains {i} and {j}; ids must be i < j < {n}")
            }
            ContactTable::Walls => {
                format!("{group}: row {row}: i must be less than {n}, wall 1 or 2")
            }
        }))
    }

    /// The second ids of contacts: j, or N or N + 1 of a flat wall.
    fn second_ids(&self, table: &StoredContacts, rows: &Range<usize>) -> Result<Vec<u32>> {
        let name = table.table.second().name;
        if table.table == ContactTable::Grains {
            return self.column(table, name, rows);
        }
        let walls: Vec<u8> = self.column(table, name, rows)?;
        let before = self.grains.count() as u32 - body::BOTTOM;
        Ok(walls
            .into_iter()
            .map(|wall| before + u32::from(wall))
            .collect())
    }

    /// Reads the values of a quantity of the contacts, one contact after the other.
    fn column<T: H5Type>(
        &self,
        table: &StoredContacts,
        name: &str,
        rows: &Range<usize>,
    ) -> Result<Vec<T>> {
        if rows.is_empty() {
            return Ok(Vec::new());
        }
        self.read(&table.columns[name], rows)
    }
}
