//! HDF5 files written by all ranks together. For what the `hdf5` crate does not tell of them, this
//! module calls the C library; it holds the only unsafe code of this crate.

use super::collective::{CollectiveOutcome, agree, on_root};
use super::parameter::{Parameters, attributes};
use gshear_dem::failure::{Failure, Result};
use gshear_mpi_exchange::{LoneFailure, Parallel};
use hdf5::types::TypeDescriptor;
use hdf5::types::{FixedAscii, FixedUnicode, VarLenUnicode};
use hdf5::{H5Type, Hyperslab, Location, SliceOrIndex};
use hdf5_sys::h5i::hid_t;
use hdf5_sys::{h5d, h5f, h5p};
use ndarray::ArrayViewD;
use serde::{Deserialize, Serialize};

mod extents;
mod mpi_errors;

use crate::disk::{self, reason, unwritten};
use crate::room;
use extents::RawData;
use std::borrow::Cow;
use std::cell::{Cell, RefCell};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};

/// No file has groups within groups of as many levels.
const DEEPEST: usize = 8;

/// The value of an attribute.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Attribute {
    /// Text of any length.
    Text(String),
    /// At most 32 ASCII characters, of fixed length: covered by the object's own checksum.
    Word(String),
    /// List of such words.
    Words(Vec<String>),
    /// Text of fixed length: its first 128 bytes of UTF-8.
    Name(String),
    /// Reference to an object of this path.
    Reference(String),
    /// Number.
    Number(f64),
    /// List of numbers.
    Numbers(Vec<f64>),
    /// Count.
    Count(u64),
    /// List of integers.
    Integers(Vec<i32>),
}

macro_rules! attributes_from {
    ($($kind:ty => $variant:ident),*) => {$(
        impl From<$kind> for Attribute {
            fn from(value: $kind) -> Self {
                Attribute::$variant(value.into())
            }
        }
    )*};
}

attributes_from!(&str => Text, String => Text, f64 => Number, u64 => Count, Vec<f64> => Numbers);

/// Fixed-length text of an attribute.
pub(crate) type Word = FixedAscii<32>;

/// Bytes of a name.
pub(crate) const NAME: usize = 128;

/// Bytes of metadata that a batch may add.
const METADATA_BYTES: u64 = 256 << 10;

struct Context {
    path: PathBuf,
    /// Whether a call has failed, or the file was dropped without being closed.
    failed: Cell<bool>,
    /// Whether the file is being closed.
    closes: Cell<bool>,
    /// A failed rank may leave a collective call that the others wait in.
    lone: LoneFailure,
    /// The datasets of the file that were created or opened.
    raw_data: RefCell<Vec<RawData>>,
    /// Below this offset (bytes), room has been reserved.
    reserved: Cell<u64>,
}

impl Context {
    fn failure(&self, object: &str, what: &str, error: &dyn std::fmt::Display) -> Failure {
        self.failed.set(true);
        let file = self.path.display();
        let reason = mpi_errors::reason(&self.path).unwrap_or_else(|| reason(error));
        let message = format!("{file}: {object}: cannot {what}: {reason}");
        self.lone.note(&message);
        Failure::other(message)
    }

    /// The result of a call that is to do `what` with an object.
    fn checked<T>(&self, object: &str, what: &str, result: hdf5::Result<T>) -> Result<T> {
        result.map_err(|e| self.failure(object, what, &e))
    }
}

/// The number by which HDF5 counts the objects of all files.
const ALL_FILES: hid_t = h5f::H5F_OBJ_ALL as hid_t;

/// Whether a file was left open.
static LEFT_OPEN: AtomicBool = AtomicBool::new(false);

/// Whether this process has left a file open, as after a failure, or failed to close one. It must
/// then end by [`World::abort`](gshear_mpi_exchange::World::abort) or
/// [`end_process`](gshear_mpi_exchange::end_process): HDF5 would close the file when MPI or the
/// process ends, which could crash, or wait for ever. To be called when all files were dropped.
pub fn is_left_open() -> bool {
    let kinds = h5f::H5F_OBJ_FILE | h5f::H5F_OBJ_DATASET | h5f::H5F_OBJ_GROUP | h5f::H5F_OBJ_ATTR;
    // What HDF5 fails to close it keeps among its open objects.
    // SAFETY: the library counts its own list, for all files.
    let open = hdf5::sync::sync(|| unsafe { h5f::H5Fget_obj_count(ALL_FILES, kinds) });
    open != 0 || LEFT_OPEN.load(Ordering::Relaxed)
}

/// Closes a file of the serial driver, whose objects must have been dropped.
///
/// # Errors
/// If the system fails to; the file [is left open](is_left_open) then.
pub(crate) fn close(file: hdf5::File) -> hdf5::Result<()> {
    file.close().inspect_err(|_| leave_open())
}

/// Notes that a file is left open.
pub(crate) fn leave_open() {
    LEFT_OPEN.store(true, Ordering::Relaxed);
}

/// A file open for writing on all ranks. Every call is collective; all arguments but the data must
/// be the same on every rank.
///
/// Only [`H5File::close`] closes it, because closing is collective. After a failure nothing more is
/// written, and the file is [left open](is_left_open).
pub(crate) struct H5File {
    file: hdf5::File,
    /// The group in which names are; empty: the root.
    within: &'static str,
    context: Rc<Context>,
}

impl H5File {
    /// Creates a file, replacing an existing one.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails, the same on every rank.
    pub fn create(path: &Path, exchange: &dyn Parallel) -> Result<Self> {
        // One rank makes an empty file: where ranks create one together and a call of one of them
        // fails, MPI-IO leaves them waiting for each other.
        let made = on_root(exchange, || {
            (hdf5::File::with_options().with_fapl(|access| access.libver_v18()))
                .create(path)
                .and_then(hdf5::File::close)
                .map_err(|e| {
                    Failure::other(format!("{}: cannot create: {}", path.display(), reason(&e)))
                })
        });
        // It may be the close that failed.
        made.inspect_err(|_| leave_open())?;
        Self::open(path, exchange)
    }

    /// Opens an existing file for writing.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails, the same on every rank.
    pub fn open(path: &Path, exchange: &dyn Parallel) -> Result<Self> {
        let lone = exchange.lone_failure();
        let opened = Self::open_here(path, exchange).map_err(|error| {
            let message = format!("{}: cannot open: {}", path.display(), reason(&error));
            lone.note(&message);
            Failure::other(message)
        });
        let agreed = agree(exchange, opened);
        lone.clear();
        agreed
    }

    fn open_here(path: &Path, exchange: &dyn Parallel) -> hdf5::Result<Self> {
        let communicator = exchange.communicator();
        let file = hdf5::File::with_options()
            .with_fapl(|access| {
                if let Some(communicator) = communicator {
                    access.mpio(communicator, exchange.hints());
                    // Reads are not collective, as writes of one rank may need them.
                    access.coll_metadata_write(true);
                }
                // Format 1.8 has checksums on most of the file's structure. Format 1.10 would
                // refuse to open a file left open by a killed program, which could then not be
                // resumed.
                access.libver_v18()
            })
            .open_rw(for_mpi(path, communicator.is_some()))?;
        let context = Context {
            path: path.into(),
            failed: Cell::new(false),
            closes: Cell::new(false),
            lone: exchange.lone_failure(),
            raw_data: RefCell::default(),
            reserved: Cell::new(0),
        };
        let file = H5File {
            file,
            within: "",
            context: Rc::new(context),
        };
        if communicator.is_some() {
            mpi_errors::note(&file.file, path, file.context.lone.clone())?;
        }
        Ok(file)
    }

    /// Takes names in a group from now on; empty: in the root, as before. The datasets outside of
    /// it count as raw data, so that no journal copies them.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails.
    pub fn enter(&mut self, group: &'static str) -> Result<()> {
        self.within = group;
        let mut datasets = Vec::new();
        let own = format!("/{group}");
        let looked = (self.file.as_group())
            .and_then(|root| below(&root, DEEPEST, &own, &mut |dataset| datasets.push(dataset)));
        self.context.checked("/", "look up", looked)?;
        let others = datasets.into_iter().map(RawData::of);
        self.context.raw_data.borrow_mut().extend(others);
        Ok(())
    }

    /// The name of an object in the file.
    fn at(&self, name: &str) -> String {
        match self.within {
            "" => name.into(),
            group => format!("/{group}/{}", name.trim_start_matches('/')),
        }
    }

    /// Removes a group of the root, if it is there.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails.
    pub fn remove(&self, group: &str) -> Result<()> {
        if !self.file.link_exists(group) {
            return Ok(());
        }
        let removed = self.file.unlink(group);
        self.context.checked(group, "remove", removed)
    }

    /// Creates a group and its missing parents.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails.
    pub fn group(&self, name: &str) -> Result<()> {
        let made = self.file.create_group(&self.at(name));
        self.context.checked(name, "create", made).map(drop)
    }

    /// Returns whether an object of this name exists. Its group must exist.
    pub fn has(&self, name: &str) -> bool {
        self.file.link_exists(&self.at(name))
    }

    /// Returns the failure of an object that holds fewer rows than the checkpoint says.
    pub fn lacks(&self, name: &str, rows: u64) -> Failure {
        let file = self.context.path.display();
        Failure::input(format!(
            "{file}: cannot continue this file: {name} holds fewer than the {rows} rows of the checkpoint"
        ))
    }

    /// Adds a second name for an object.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails.
    pub fn link(&self, target: &str, name: &str) -> Result<()> {
        let made = self.file.link_hard(&self.at(target), &self.at(name));
        self.context.checked(name, "link", made)
    }

    /// Creates a dataset of these elements and of `shape`: contiguous and of fixed size, or, with
    /// `chunk`, growing along its first dimension.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails.
    pub fn dataset(
        &self,
        element: TypeDescriptor,
        name: &str,
        shape: &[usize],
        chunk: Option<&[usize]>,
    ) -> Result<Dataset> {
        use hdf5::dataset::{AllocTime, FillTime};
        use hdf5::{Extent, SimpleExtents};
        let mut extents: Vec<Extent> = shape.iter().map(|&n| Extent::fixed(n)).collect();
        if chunk.is_some() {
            extents[0] = Extent::resizable(shape[0]);
        }
        let builder = (self.file.new_dataset_builder().empty_as(&element))
            .shape(SimpleExtents::from_vec(extents))
            .fill_time(FillTime::Never)
            // Several ranks may continue a file of one rank; they can write only to allocated
            // chunks.
            .alloc_time(Some(AllocTime::Early));
        let builder = match chunk {
            Some(chunk) => builder.chunk(chunk.to_vec()),
            None => builder,
        };
        self.column(element, name, "create", builder.create(&*self.at(name)))
    }

    /// Opens an existing dataset of these elements.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails.
    pub(crate) fn open_dataset(&self, element: TypeDescriptor, name: &str) -> Result<Dataset> {
        self.column(element, name, "open", self.file.dataset(&self.at(name)))
    }

    fn column(
        &self,
        element: TypeDescriptor,
        name: &str,
        what: &str,
        dataset: hdf5::Result<hdf5::Dataset>,
    ) -> Result<Dataset> {
        let dataset = self.context.checked(name, what, dataset)?;
        let raw_data = RawData::of(dataset.clone());
        self.context.raw_data.borrow_mut().push(raw_data);
        Ok(Dataset {
            shape: dataset.shape(),
            inner: dataset,
            name: name.into(),
            context: self.context.clone(),
            element,
        })
    }

    /// Writes an attribute of an object, replacing one of the same name.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails.
    pub fn attribute(&self, object: &str, name: &str, value: &Attribute) -> Result<()> {
        let value = match value {
            Attribute::Reference(to) => &Attribute::Reference(self.at(to)),
            _ => value,
        };
        let location = self.location(object);
        let set = location.and_then(|location| set_attribute(&location, name, value));
        let place = format!("{object}@{name}");
        self.context.checked(&place, "write", set)
    }

    /// Removes an attribute if it exists.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails.
    pub(crate) fn remove_attribute(&self, object: &str, name: &str) -> Result<()> {
        let location = self.location(object);
        let removed = location.and_then(|location| remove_attribute(&location, name));
        let place = format!("{object}@{name}");
        self.context.checked(&place, "remove", removed)
    }

    /// Returns all attributes of a group, by name.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails.
    pub fn attributes(&self, group: &str) -> Result<Parameters> {
        let location = self.location(group);
        let location = location.map_err(|e| self.context.failure(group, "read", &e))?;
        attributes(&location).map_err(|(what, e)| {
            let place = format!("{group}{what}");
            self.context.failure(&place, "read", &e)
        })
    }

    fn location(&self, object: &str) -> hdf5::Result<Location> {
        let group = if object == "/" {
            self.file.as_group()?
        } else {
            self.file.group(&self.at(object))?
        };
        Ok((*group).clone())
    }

    /// Writes all buffers to the file system.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails.
    pub fn flush(&self) -> Result<()> {
        self.context.checked("/", "flush", self.file.flush())?;
        // HDF5 sets the file's length, and so gives back what was reserved beyond.
        self.context.reserved.set(self.file.size());
        Ok(())
    }

    /// Returns the byte ranges that hold the data of all datasets created or opened so far.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails.
    pub(crate) fn raw_extents(&self) -> Result<Vec<Range<u64>>> {
        let mut all = Vec::new();
        for raw_data in &mut *self.context.raw_data.borrow_mut() {
            let extents = raw_data.extents();
            all.extend_from_slice(self.context.checked("/", "look up", extents)?);
        }
        Ok(all)
    }

    /// Reserves room for `bytes` of data more, and for what the file needs beside them, or fails on
    /// all ranks before anything is written.
    ///
    /// # Errors
    /// [`Failure::Other`] if there is no room.
    pub fn reserve(&self, exchange: &dyn Parallel, bytes: usize) -> Result<()> {
        let raw_data = self.context.raw_data.borrow();
        let beside: u64 = raw_data.iter().map(|data| data.chunk_bytes).sum();
        drop(raw_data);
        let needed = bytes as u64 + beside + METADATA_BYTES;
        let (from, to) = (self.context.reserved.get(), self.file.size() + needed);
        let reserved = match exchange.rank() {
            0 => room::reserve(&self.context.path, from, to),
            _ => Ok(()),
        };
        self.agree(exchange, CollectiveOutcome::of(reserved))
    }

    /// Agrees on the failures of the calls so far. After a failure on any rank, no rank closes the
    /// file.
    ///
    /// # Errors
    /// As [`agree`].
    pub fn agree(&self, exchange: &dyn Parallel, outcome: CollectiveOutcome) -> Result<()> {
        let agreed = outcome.agree(exchange);
        self.context.lone.clear();
        if agreed.is_err() {
            self.context.failed.set(true);
        }
        agreed
    }

    /// Brings the file to disk and closes it. Its columns must have been dropped.
    ///
    /// # Errors
    /// As [`agree`].
    pub fn close(self, exchange: &dyn Parallel) -> Result<()> {
        // While its datasets are open: what is still in the buffers of a dataset that HDF5 closes
        // is lost without an error. Every rank brings to disk what it has written, because MPI
        // ignores a close that fails.
        self.agree(exchange, CollectiveOutcome::of(self.flush()))?;
        let file = self.file.clone();
        let context = self.context.clone();
        context.raw_data.borrow_mut().clear();
        context.closes.set(true);
        drop(self);
        let agreed = agree(exchange, context.checked("/", "close", file.close()));
        context.lone.clear();
        agreed.inspect_err(|_| leave_open())?;
        on_root(exchange, || {
            disk::sync(&context.path).map_err(|e| unwritten(&context.path, &e))
        })
    }
}

impl Drop for H5File {
    fn drop(&mut self) {
        if !self.context.closes.get() {
            leave_open();
            self.context.failed.set(true);
            // References that are never released keep the file open.
            std::mem::forget(self.file.clone());
            std::mem::forget(self.context.clone());
        }
    }
}

impl Drop for Dataset {
    fn drop(&mut self) {
        if self.context.failed.get() {
            std::mem::forget(self.inner.clone());
        }
    }
}

/// The path as MPI-IO takes it: ROMIO takes what comes before a colon for the kind of the file
/// system.
fn for_mpi(path: &Path, parallel: bool) -> Cow<'_, Path> {
    match path.to_str() {
        Some(name) if parallel && name.contains(':') => PathBuf::from(format!("ufs:{name}")).into(),
        _ => path.into(),
    }
}

/// Writes a chunk as the file is to have it, from a place in the dataset on that has an entry for
/// each dimension.
pub(crate) fn write_chunk(
    dataset: &hdf5::Dataset,
    place: &[u64],
    bytes: &[u8],
) -> hdf5::Result<()> {
    assert_eq!(place.len(), dataset.ndim(), "{}", dataset.name());
    hdf5::sync::sync(|| {
        // SAFETY: the dataset is open; `place` has an entry for each of its dimensions, and there
        // are as many bytes as the length says.
        let status = unsafe {
            h5d::H5Dwrite_chunk(
                dataset.id(),
                h5p::H5P_DEFAULT,
                0,
                place.as_ptr(),
                bytes.len(),
                bytes.as_ptr().cast(),
            )
        };
        hdf5::h5check(status).map(drop)
    })
}

/// Looks up every object of a file and every piece of its data, without reading the data.
///
/// # Errors
/// A damaged structure.
pub(crate) fn walk(file: &hdf5::File) -> hdf5::Result<()> {
    let mut looked = Ok(());
    each_dataset(file, &mut |dataset| {
        if looked.is_ok() {
            looked = RawData::of(dataset).extents().map(drop);
        }
    })?;
    looked
}

/// Passes all datasets of a file to a visitor.
///
/// # Errors
/// A damaged structure.
pub(crate) fn each_dataset(
    file: &hdf5::File,
    each: &mut dyn FnMut(hdf5::Dataset),
) -> hdf5::Result<()> {
    below(&file.as_group()?, DEEPEST, "", each)
}

/// Passes all datasets below a group to a visitor, except those below the group `without`.
fn below(
    group: &hdf5::Group,
    levels: usize,
    without: &str,
    each: &mut dyn FnMut(hdf5::Dataset),
) -> hdf5::Result<()> {
    if group.name() == without {
        return Ok(());
    }
    group.datasets()?.into_iter().for_each(&mut *each);
    let Some(levels) = levels.checked_sub(1) else {
        return Err("its groups contain each other".into());
    };
    let groups = group.groups()?;
    let mut groups = groups.iter();
    groups.try_for_each(|group| below(group, levels, without, each))
}

/// Removes an attribute if it exists.
fn remove_attribute(location: &Location, name: &str) -> hdf5::Result<()> {
    if location.attr_names()?.iter().any(|n| n == name) {
        location.delete_attr(name)?;
    }
    Ok(())
}

/// Writes an attribute, replacing one of the same name.
pub(crate) fn set_attribute(
    location: &Location,
    name: &str,
    value: &Attribute,
) -> hdf5::Result<()> {
    remove_attribute(location, name)?;
    match value {
        Attribute::Text(value) => {
            let value: VarLenUnicode = value.parse().map_err(unfit)?;
            put(location, name, value)
        }
        Attribute::Word(value) => put(location, name, word(value)?),
        Attribute::Words(values) => {
            let values: hdf5::Result<Vec<_>> = values.iter().map(|value| word(value)).collect();
            put_all(location, name, &values?)
        }
        Attribute::Name(value) => {
            let end = value.floor_char_boundary(NAME);
            let value: FixedUnicode<NAME> = value[..end].parse().map_err(unfit)?;
            put(location, name, value)
        }
        Attribute::Reference(path) => {
            let reference: hdf5::ObjectReference1 = location.reference(path)?;
            put(location, name, reference)
        }
        Attribute::Number(value) => put(location, name, *value),
        Attribute::Count(value) => put(location, name, *value),
        Attribute::Numbers(values) => put_all(location, name, values),
        Attribute::Integers(values) => put_all(location, name, values),
    }
}

/// Text of fixed length.
fn word(text: &str) -> hdf5::Result<Word> {
    Word::from_ascii(text).map_err(unfit)
}

/// The error of a text that HDF5 does not take.
fn unfit(why: impl std::fmt::Display) -> hdf5::Error {
    why.to_string().into()
}

fn put<T: H5Type>(location: &Location, name: &str, value: T) -> hdf5::Result<()> {
    location.new_attr::<T>().create(name)?.write_scalar(&value)
}

fn put_all<T: H5Type>(location: &Location, name: &str, values: &[T]) -> hdf5::Result<()> {
    let attribute = location.new_attr::<T>().shape(values.len()).create(name)?;
    attribute.write_raw(values)
}

/// A box in a dataset of one to three dimensions. Entries beyond the dataset's dimensions are
/// ignored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Slab {
    /// First index along each dimension.
    pub start: [u64; 3],
    /// Number of indices along each dimension.
    pub count: [u64; 3],
}

impl Slab {
    /// Returns the slab of `count` whole rows from `start` on; `width`: length of a row.
    pub fn rows(start: u64, count: u64, width: u64) -> Self {
        Slab {
            start: [start, 0, 0],
            count: [count, width, 1],
        }
    }
}

/// A dataset of an [`H5File`].
pub(crate) struct Dataset {
    inner: hdf5::Dataset,
    shape: Vec<usize>,
    name: String,
    context: Rc<Context>,
    element: TypeDescriptor,
}

impl Dataset {
    /// Returns the number of rows.
    pub fn rows(&self) -> u64 {
        self.shape[0] as u64
    }

    /// Returns the number of values in a row.
    pub(crate) fn row_length(&self) -> usize {
        self.shape[1..].iter().product()
    }

    /// Writes an attribute, replacing one of the same name. Collective.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails.
    pub fn attribute(&self, name: &str, value: &Attribute) -> Result<()> {
        let written = set_attribute(&self.inner, name, value);
        let object = format!("{}@{name}", self.name);
        self.context.checked(&object, "write", written)
    }

    /// Sets the number of rows. Collective.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails.
    pub fn resize(&mut self, rows: u64) -> Result<()> {
        if rows as usize == self.shape[0] {
            return Ok(());
        }
        self.shape[0] = rows as usize;
        let done = self.inner.resize(self.shape.clone());
        self.context.checked(&self.name, "resize", done)
    }

    /// Writes this rank's part: the values `data` of `slab`, which may be empty. Not collective.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails.
    ///
    /// # Panics
    /// If `data` and `slab` differ in size, the dataset is of another type, or it has more than
    /// three dimensions.
    pub fn write<T: H5Type + Copy>(&self, slab: Slab, data: &[T]) -> Result<()> {
        let dimensions = self.shape.len();
        assert!((1..=3).contains(&dimensions), "one to three dimensions");
        assert_eq!(T::type_descriptor(), self.element, "{}", self.name);
        let count = &slab.count[..dimensions];
        let selected: u64 = count.iter().product();
        let as_many = "as many values as places";
        assert_eq!(selected, data.len() as u64, "{}: {as_many}", self.name);
        if data.is_empty() {
            return Ok(());
        }
        let shape: Vec<usize> = count.iter().map(|&n| n as usize).collect();
        let places: Vec<SliceOrIndex> = (slab.start.iter().zip(&shape))
            .map(|(&start, &count)| SliceOrIndex::SliceCount {
                start: start as usize,
                step: 1,
                count,
                block: 1,
            })
            .collect();
        // Each rank writes its rows by itself: together, ranks would meet a dozen times for each
        // dataset, which takes longer than to write them.
        let values = ArrayViewD::from_shape(shape, data).expect("as many values as places");
        let written = self.inner.write_slice(values, Hyperslab::from(places));
        self.context.checked(&self.name, "write", written)
    }

    /// Sets the number of rows and writes this rank's part of them. Collective.
    ///
    /// # Errors
    /// [`Failure::Other`] if HDF5 fails.
    pub fn append<T: H5Type + Copy>(&mut self, rows: u64, slab: Slab, data: &[T]) -> Result<()> {
        // Written even after a failure, because the other ranks wait for it.
        let resized = self.resize(rows);
        let written = self.write(slab, data);
        resized.and(written)
    }
}

/// Appends data that are the same on every rank after the first `before` rows; rank 0 writes them.
///
/// # Errors
/// If the file cannot be written.
pub(crate) fn by_root<T: H5Type + Copy>(
    root: bool,
    column: &mut Dataset,
    before: u64,
    data: &[T],
) -> Result<()> {
    let after = before + data.len() as u64;
    let local = if root { data } else { &[] };
    column.append(after, Slab::rows(before, local.len() as u64, 1), local)
}
