//! Frames of a run, read on demand.

use std::borrow::Cow;
use std::ops::Range;

use hdf5::{Dataset, H5Type};
use ndarray::{Ix1, Ix2, Ix3, s};

use super::open_file::one_line;
use super::verify::Pairs;
use super::{FrameFields, RunFile};
use crate::checksums;
use gshear_dem::failure::Failure;
use gshear_dem::state::{ContactSample, Frame, FrameRecords, GrainSample, Image};
use gshear_scene::Dimensions;

/// Contacts of some frames, as far as they were read.
pub(super) struct ContactValues {
    /// Row of the first contact.
    first: usize,
    i: Vec<u32>,
    j: Vec<u32>,
    normal_force: Vec<f64>,
    tangential_force: Vec<[f64; 3]>,
    tangential_history: Vec<[f64; 3]>,
    /// Of disks.
    rolling_history: Vec<f64>,
    /// Of spheres.
    rolling_torque: Vec<[f64; 3]>,
    twisting_history: Vec<f64>,
    overlap: Vec<f64>,
    sliding: Vec<u8>,
    rolling: Vec<u8>,
    twisting: Vec<u8>,
}

impl ContactValues {
    pub(super) fn of_rows(&self, rows: Range<usize>) -> Vec<ContactSample> {
        let of = |values: &[f64], k: usize| values.get(k).copied().unwrap_or(0.0);
        let flag = |flags: &[u8], k: usize| flags.get(k).map_or(0, |flag| u64::from(*flag));
        let contact = |k: usize| ContactSample {
            i: self.i[k],
            j: self.j[k],
            normal_force: of(&self.normal_force, k),
            tangential_force: self.tangential_force.get(k).copied().unwrap_or_default(),
            tangential_history: self.tangential_history.get(k).copied().unwrap_or_default(),
            rolling_history: of(&self.rolling_history, k),
            overlap: of(&self.overlap, k),
            sliding: flag(&self.sliding, k),
            rolling: flag(&self.rolling, k),
            torques: {
                let [x, y, z] = self.rolling_torque.get(k).copied().unwrap_or_default();
                [x, y, z, of(&self.twisting_history, k)]
            },
            twisting: flag(&self.twisting, k),
        };
        (rows.start - self.first..rows.end - self.first)
            .map(contact)
            .collect()
    }

    /// The columns of numbers: name, values, numbers per contact, and with which fields they are
    /// read.
    fn numbers(&self, planar: bool) -> [(&'static str, Cow<'_, [f64]>, usize, FrameFields); 6] {
        let spins = if planar { 1 } else { 3 };
        let flat = |vectors: &[[f64; 3]]| -> Cow<'_, [f64]> {
            let of_each = vectors.iter().flat_map(|v| v[..spins].iter().copied());
            Cow::Owned(of_each.collect())
        };
        let rolling = if planar {
            Cow::Borrowed(&self.rolling_history[..])
        } else {
            flat(&self.rolling_torque)
        };
        let (force, history) = (flat(&self.tangential_force), flat(&self.tangential_history));
        let (forces, all) = (FrameFields::Forces, FrameFields::All);
        [
            ("normal_force", Cow::Borrowed(&self.normal_force), 1, forces),
            ("tangential_force", force, spins, forces),
            ("tangential_history", history, spins, all),
            ("rolling_history", rolling, spins, all),
            (
                "twisting_history",
                Cow::Borrowed(&self.twisting_history),
                1,
                all,
            ),
            ("overlap", Cow::Borrowed(&self.overlap), 1, all),
        ]
    }
}

impl RunFile {
    /// Reads the frames of a range within 0 … T, of disks or spheres.
    ///
    /// # Errors
    /// [`Failure::Input`] if the file is damaged.
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
    pub(super) fn vectors(
        &self,
        dataset: &Dataset,
        range: &Range<usize>,
    ) -> Result<Vec<[f64; 3]>, Failure> {
        let values = dataset
            .read_slice::<f64, _, Ix3>(s![range.start..range.end, .., ..])
            .map_err(|e| self.damaged(dataset, &e))?;
        let (values, _) = values.into_raw_vec_and_offset();
        self.verify_grains(dataset, range, &values)?;
        Ok(values.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect())
    }

    /// Reads the positions of a range of frames within 0 … T, `[frames][N]` (m).
    ///
    /// # Errors
    /// [`Failure::Input`] if the file is damaged.
    pub fn positions(&self, range: Range<usize>) -> Result<Vec<Vec<[f64; 3]>>, Failure> {
        let all = self.vectors(&self.position, &range)?;
        let of_frame = self.grains.count().max(1);
        let mut frames: Vec<_> = all.chunks(of_frame).map(<[_]>::to_vec).collect();
        frames.resize(range.len(), Vec::new());
        Ok(frames)
    }

    /// Reads [`RunFile::positions`] with the images added, so that nothing jumps at the seams.
    ///
    /// # Errors
    /// [`Failure::Input`] if the file is damaged.
    pub fn unwrapped(&self, range: Range<usize>) -> Result<Vec<Vec<[f64; 3]>>, Failure> {
        let mut frames = self.positions(range.clone())?;
        let images = self.images(&range)?;
        let places = frames.iter_mut().flatten().zip(images);
        let of_frame = self.grains.count().max(1);
        for (k, (place, image)) in places.enumerate() {
            let edges = self.box_edges(range.start + k / of_frame);
            for (edge, many) in edges.iter().zip(image) {
                (place.iter_mut().zip(edge)).for_each(|(x, side)| *x += many as f64 * side);
            }
        }
        Ok(frames)
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
    fn images(&self, range: &Range<usize>) -> Result<Vec<Image>, Failure> {
        let dataset = &self.image;
        let values = dataset
            .read_slice::<i32, _, Ix3>(s![range.start..range.end, .., ..])
            .map_err(|e| self.damaged(dataset, &e))?;
        let (values, _) = values.into_raw_vec_and_offset();
        let weights = checksums::weights(0, 3 * self.grains.count());
        for (t, of_frame) in (range.clone()).zip(values.chunks(3 * self.grains.count())) {
            self.verify(t, "image", checksums::of_images(&weights, of_frame))?;
        }
        let images = values.chunks_exact(3);
        Ok(images.map(|v| [v[0], v[1], v[2]].map(i64::from)).collect())
    }

    /// Reads ω of disks, `[frames][N]`.
    fn spins(&self, range: &Range<usize>) -> Result<Vec<Vec<f64>>, Failure> {
        let values = self
            .angular_velocity
            .read_slice::<f64, _, Ix2>(s![range.start..range.end, ..])
            .map_err(|e| self.damaged(&self.angular_velocity, &e))?;
        let (values, _) = values.into_raw_vec_and_offset();
        self.verify_grains(&self.angular_velocity, range, &values)?;
        let of_frame = self.grains.count();
        Ok(values.chunks(of_frame).map(<[f64]>::to_vec).collect())
    }

    /// Compares what has been read of grains, frame by frame, with its checksums.
    fn verify_grains(
        &self,
        dataset: &Dataset,
        range: &Range<usize>,
        values: &[f64],
    ) -> Result<(), Failure> {
        let name = dataset.name();
        let column = name.trim_end_matches("/value").rsplit('/').next();
        let of_frame = (values.len() / range.len().max(1)).max(1);
        let weights = checksums::weights(0, of_frame);
        for (t, values) in range.clone().zip(values.chunks(of_frame)) {
            self.verify(
                t,
                column.unwrap_or_default(),
                checksums::of_numbers(&weights, values),
            )?;
        }
        Ok(())
    }

    /// Reads frame t < T of disks.
    ///
    /// # Errors
    /// [`Failure::Input`] if the file is damaged or the grains are spheres.
    pub fn frame(&self, t: usize) -> Result<Frame, Failure> {
        Ok(self.block(t..t + 1)?.swap_remove(0))
    }

    /// Reads the frames of a range within 0 … T, of disks.
    ///
    /// # Errors
    /// [`Failure::Input`] if the file is damaged or the grains are spheres.
    pub fn block(&self, range: Range<usize>) -> Result<Vec<Frame>, Failure> {
        self.block_of(range, FrameFields::All)
    }

    /// Reads the given fields of the frames of a range within 0 … T, of disks.
    ///
    /// # Errors
    /// [`Failure::Input`] if the file is damaged or the grains are spheres.
    pub fn block_of(
        &self,
        range: Range<usize>,
        fields: FrameFields,
    ) -> Result<Vec<Frame>, Failure> {
        if self.dimension == Dimensions::Three {
            return Err(Failure::input(format!(
                "{}: this command needs disks; for spheres use dmin, compare or export, or commands on the time series",
                self.path.display()
            )));
        }
        let mut position = self.planar(&self.position, &range)?.into_iter();
        let images = self.images(&range)?;
        let mut images = images.chunks(self.grains.count().max(1));
        let (mut velocity, mut angular_velocity) = (Vec::new(), Vec::new());
        if fields == FrameFields::All {
            velocity = self.planar(&self.velocity, &range)?;
            angular_velocity = self.spins(&range)?;
        }
        let (mut velocity, mut angular_velocity) =
            (velocity.into_iter(), angular_velocity.into_iter());
        let contacts = self.contacts(&range, fields)?;
        let frame = |t: usize| Frame {
            step: self.step[t],
            time: self.time[t],
            position: position.next().unwrap_or_default(),
            image: images
                .next()
                .unwrap_or_default()
                .iter()
                .map(|i| i[0])
                .collect(),
            velocity: velocity.next().unwrap_or_default(),
            angular_velocity: angular_velocity.next().unwrap_or_default(),
            contacts: contacts.of_rows(self.rows(t..t + 1)),
        };
        Ok(range.map(frame).collect())
    }

    /// Reads x and y from a dataset `[T][N][3]`; z must be 0.
    fn planar(
        &self,
        dataset: &Dataset,
        range: &Range<usize>,
    ) -> Result<Vec<Vec<[f64; 2]>>, Failure> {
        let values = dataset
            .read_slice::<f64, _, Ix3>(s![range.start..range.end, .., ..])
            .map_err(|e| self.damaged(dataset, &e))?;
        let (values, _) = values.into_raw_vec_and_offset();
        self.verify_grains(dataset, range, &values)?;
        let mut planar = true;
        let frame = |t: usize| {
            let of_frame = 3 * self.grains.count();
            let rows = values[t * of_frame..(t + 1) * of_frame].chunks_exact(3);
            let of_row = |row: &[f64]| {
                planar &= row[2] == 0.0;
                [row[0], row[1]]
            };
            rows.map(of_row).collect()
        };
        let frames = (0..range.len()).map(frame).collect();
        if !planar {
            let name = dataset.name();
            return Err(Failure::input(format!(
                "{}: {}: z is not 0: only 2D runs can be reduced",
                self.path.display(),
                &name[1..]
            )));
        }
        Ok(frames)
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
    ) -> Result<ContactValues, Failure> {
        let rows = self.rows(frames.clone());
        // No rows of fields that are not wanted.
        let rows_from = |least: FrameFields| if fields >= least { rows.clone() } else { 0..0 };
        let (forces, others) = (rows_from(FrameFields::Forces), rows_from(FrameFields::All));
        let planar = self.dimension == Dimensions::Two;
        let contacts = ContactValues {
            first: rows.start,
            i: self.column("i", &rows)?,
            j: self.column("j", &rows)?,
            normal_force: self.column("normal_force", &forces)?,
            tangential_force: self.tangential("tangential_force", &forces)?,
            tangential_history: self.tangential("tangential_history", &others)?,
            rolling_history: if planar {
                self.column("rolling_history", &others)?
            } else {
                Vec::new()
            },
            rolling_torque: if self.has_rolling() && !planar {
                self.tangential("rolling_history", &others)?
            } else {
                Vec::new()
            },
            twisting_history: self.column("twisting_history", &others)?,
            overlap: self.column("overlap", &others)?,
            sliding: self.column("sliding", &others)?,
            rolling: self.column("rolling", &others)?,
            twisting: self.column("twisting", &others)?,
        };
        self.check_pairs(&contacts.i, &contacts.j, rows.start)?;
        let pairs = Pairs::new(&contacts.i, &contacts.j, rows.start, self.dimension.axes());
        let numbers = contacts.numbers(planar);
        for t in frames.clone() {
            let rows = self.rows(t..t + 1);
            self.verify(t, "pairs", pairs.ids(&rows))?;
            for (name, values, width, least) in &numbers {
                let (width, least) = (*width, *least);
                if fields >= least && self.contacts.contains_key(name) {
                    self.verify(t, name, pairs.numbers(&rows, values, width))?;
                }
            }
            if fields == FrameFields::All {
                let flags = [
                    ("sliding", &contacts.sliding),
                    ("rolling", &contacts.rolling),
                    ("twisting", &contacts.twisting),
                ];
                let stored = flags
                    .iter()
                    .filter(|(name, _)| self.contacts.contains_key(name));
                for (name, flags) in stored {
                    self.verify(t, name, pairs.flags(&rows, flags))?;
                }
            }
        }
        Ok(contacts)
    }

    /// Checks the ids of contacts; `first`: row of the first one.
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

    /// Reads a column of tangential vectors: `[M]` for disks, `[M][3]` for spheres.
    fn tangential(&self, name: &str, rows: &Range<usize>) -> Result<Vec<[f64; 3]>, Failure> {
        if self.dimension == Dimensions::Two {
            let along = self.column::<f64>(name, rows)?;
            return Ok(along.into_iter().map(|f| [f, 0.0, 0.0]).collect());
        }
        if rows.is_empty() {
            return Ok(Vec::new());
        }
        let dataset = &self.contacts[name];
        let values = dataset
            .read_slice::<f64, _, Ix2>(s![rows.start..rows.end, ..])
            .map_err(|e| self.damaged(dataset, &e))?;
        Ok(values.outer_iter().map(|v| [v[0], v[1], v[2]]).collect())
    }

    /// Reads a column of the contacts; nothing if the file has none.
    fn column<T: H5Type>(&self, name: &str, rows: &Range<usize>) -> Result<Vec<T>, Failure> {
        let Some(dataset) = self.contacts.get(name).filter(|_| !rows.is_empty()) else {
            return Ok(Vec::new());
        };
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
