//! HDF5 files of results: HDF5 itself protects their structure and numbers by checksums, so that
//! every reader refuses a damaged one, and a file gets its name only when it has been read back.

use std::path::{Path, PathBuf};

use hdf5::types::{FloatSize, TypeDescriptor};
use hdf5::{Dataset, Extent, File, Group, H5Type};
use ndarray::{ArrayView, Dimension};

use crate::h5::{self, Attribute, set_attribute};
use crate::sound;
use crate::text_writer::PartFile;
use gshear_dem::failure::Result;

/// Bytes that are read back at a time.
const BLOCK: usize = 16 << 20;

/// An HDF5 file of results that is being written, under its temporary name.
///
/// HDF5 keeps what is written in buffers and loses it without an error where a dataset is closed
/// and its buffer cannot be written. So every dataset stays open until [`CheckedFile::finish`] has
/// flushed the file. A file that is dropped before is removed, and [left open](h5::is_left_open) in
/// HDF5.
pub struct CheckedFile {
    open: OpenFile,
    part: PartFile,
}

/// What is open in HDF5. Unless it is closed it stays open: HDF5 would try to write its buffers.
pub(crate) struct OpenFile {
    /// `None` if it was closed.
    file: Option<File>,
    datasets: Vec<Dataset>,
}

impl OpenFile {
    pub fn new(file: File) -> Self {
        Self {
            file: Some(file),
            datasets: Vec::new(),
        }
    }

    /// Keeps a dataset open until the file is flushed.
    pub fn keep(&mut self, dataset: Dataset) {
        self.datasets.push(dataset);
    }

    pub fn file(&self) -> &File {
        self.file.as_ref().expect("only closing takes it")
    }

    pub fn close(mut self) -> hdf5::Result<()> {
        // While the datasets are open, so that no error is lost.
        self.file().flush()?;
        self.datasets.clear();
        self.file.take().map_or(Ok(()), h5::close)
    }
}

impl Drop for OpenFile {
    fn drop(&mut self) {
        if let Some(file) = self.file.take() {
            h5::leave_open();
            std::mem::forget((file, std::mem::take(&mut self.datasets)));
        }
    }
}

impl CheckedFile {
    /// Creates the file and, if missing, its folder.
    ///
    /// # Errors
    /// As of [`PartFile::create`].
    pub fn create(path: &Path) -> Result<Self> {
        let part = PartFile::create(path)?;
        let mut options = File::with_options();
        // Before format 1.10 the index of the pieces of a dataset has no checksum.
        options.with_fapl(|access| access.libver_v110());
        let file = part.checked(options.create(part.part()))?;
        let open = OpenFile::new(file);
        Ok(Self { open, part })
    }

    /// The root group.
    ///
    /// # Errors
    /// If HDF5 fails.
    pub fn root(&self) -> hdf5::Result<Group> {
        self.open.file().as_group()
    }

    /// Keeps a dataset open until the file is flushed.
    fn kept(&mut self, dataset: Dataset) -> Dataset {
        self.open.keep(dataset.clone());
        dataset
    }

    /// Writes an attribute of the file.
    ///
    /// # Errors
    /// If HDF5 fails.
    pub fn attribute(&self, name: &str, value: &Attribute) -> hdf5::Result<()> {
        set_attribute(self.open.file(), name, value)
    }

    /// Creates a dataset with a checksum for each of its rows, or for all of a list.
    ///
    /// # Errors
    /// If HDF5 fails.
    pub fn dataset<T: H5Type, D: Dimension>(
        &mut self,
        name: &str,
        values: ArrayView<T, D>,
    ) -> hdf5::Result<()> {
        self.empty::<T>(name, values.shape())?.write(values)
    }

    /// The same, of zeros.
    ///
    /// # Errors
    /// If HDF5 fails.
    pub fn empty<T: H5Type>(&mut self, name: &str, shape: &[usize]) -> hdf5::Result<Dataset> {
        let builder = self.open.file().new_dataset::<T>();
        let mut piece = shape.to_vec();
        if piece.len() > 1 {
            piece[0] = 1;
        }
        let builder = if piece.contains(&0) || shape[0] == 0 {
            builder
        } else {
            builder.chunk(piece).fletcher32()
        };
        let dataset = builder.shape(shape).create(name)?;
        Ok(self.kept(dataset))
    }

    /// Creates a dataset without rows, each of the shape `of_row`, that grows by rows, with a
    /// checksum for every `chunk` of them.
    ///
    /// # Errors
    /// If HDF5 fails.
    pub fn growing<T: H5Type>(
        &mut self,
        name: &str,
        of_row: &[usize],
        chunk: usize,
    ) -> hdf5::Result<Dataset> {
        let mut extents = vec![Extent::resizable(0)];
        extents.extend(of_row.iter().map(|&n| Extent::fixed(n)));
        let builder = self.open.file().new_dataset::<T>();
        let builder = builder.chunk([&[chunk], of_row].concat()).fletcher32();
        let dataset = builder.shape(extents).create(name)?;
        Ok(self.kept(dataset))
    }

    /// The outcome of writing into the file, with its name in the message.
    ///
    /// # Errors
    /// [`Failure::Other`](gshear_dem::failure::Failure::Other) if `written` is an error.
    pub fn checked<T>(&self, written: hdf5::Result<T>) -> Result<T> {
        self.part.checked(written)
    }

    /// Closes the file, whose datasets must have been dropped, reads it back, and gives it its
    /// name. Returns that.
    ///
    /// # Errors
    /// [`Failure::Other`](gshear_dem::failure::Failure::Other) if the file cannot be written.
    pub fn finish(self) -> Result<PathBuf> {
        let Self { open, part } = self;
        part.checked(open.close())?;
        part.checked(read_back(part.part()))?;
        part.finish()
    }
}

/// Reads all numbers of a file, which HDF5 compares with their checksums.
fn read_back(path: &Path) -> hdf5::Result<()> {
    sound::read(path, |file| {
        let mut outcome = Ok(());
        h5::each_dataset(file, &mut |dataset| {
            if outcome.is_ok() {
                outcome = read_all(&dataset);
            }
        })?;
        outcome
    })
}

fn read_all(dataset: &Dataset) -> hdf5::Result<()> {
    let (shape, dtype) = (dataset.shape(), dataset.dtype()?);
    let Some((&rows, of_row)) = shape.split_first() else {
        return Ok(());
    };
    let bytes = of_row.iter().product::<usize>() * dtype.size();
    let block = (BLOCK / bytes.max(1)).max(1);
    for first in (0..rows).step_by(block) {
        let rows = first..rows.min(first + block);
        match dtype.to_descriptor()? {
            TypeDescriptor::Float(FloatSize::U8 | FloatSize::U4) => {
                sound::rows::<f64>(dataset, rows).map(drop)
            }
            TypeDescriptor::Integer(_) => sound::rows::<i64>(dataset, rows).map(drop),
            _ => sound::rows::<u64>(dataset, rows).map(drop),
        }?;
    }
    Ok(())
}
