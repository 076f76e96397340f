//! Opens files that other people may have made: they are files, HDF5 files lead nowhere else, and
//! no size that they announce is allocated unless the file can hold it.

use std::fs::FileType;
use std::io;
use std::ops::{Deref, Range};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;

use hdf5::dataset::Layout;
use hdf5::{Dataset, File, Group, H5Type, Hyperslab, LinkType, LocationType, SliceOrIndex};
use ndarray::IxDyn;
use rustix::fs::OFlags;
use rustix::io::Errno;

use crate::h5;

/// No file has groups within groups of as many levels, or as many objects.
const DEEPEST: usize = 8;
const MOST_OBJECTS: usize = 10_000;
/// Bytes that deflate, the densest of the filters, makes of one at most.
const DENSEST: u64 = 1032;

/// Opens a file, or what a link leads to, for reading. A pipe would keep the program waiting for
/// ever, and a device may have no end.
///
/// # Errors
/// What is no file; a file that cannot be opened.
pub fn regular(path: &Path) -> io::Result<std::fs::File> {
    is_regular(std::fs::metadata(path)?.file_type())?;
    // What has taken its place meanwhile does not hold up the program either.
    let mut options = std::fs::File::options();
    options.custom_flags(OFlags::NONBLOCK.bits() as i32);
    let file = options.read(true).open(path)?;
    is_regular(file.metadata()?.file_type())?;
    Ok(file)
}

/// Refuses what is no file, by what it is.
///
/// # Errors
/// What is no file.
pub fn is_regular(kind: FileType) -> io::Result<()> {
    let what = if kind.is_file() {
        return Ok(());
    } else if kind.is_dir() {
        return Err(Errno::ISDIR.into());
    } else if kind.is_fifo() {
        "a named pipe"
    } else if kind.is_socket() {
        "a socket"
    } else {
        "a device"
    };
    let message = format!("it is {what}, where a file belongs");
    Err(io::Error::new(io::ErrorKind::InvalidInput, message))
}

/// An HDF5 file that is open for reading. It is closed when it is dropped, which must be after all
/// objects in it; if that fails, the process [has left a file open](h5::is_left_open).
pub struct ReadFile(Option<File>);

impl ReadFile {
    /// Closes the file, whose objects must have been dropped.
    ///
    /// # Errors
    /// If the system fails to.
    pub fn close(mut self) -> hdf5::Result<()> {
        self.0.take().map_or(Ok(()), h5::close)
    }
}

impl Deref for ReadFile {
    type Target = File;

    fn deref(&self) -> &File {
        self.0.as_ref().expect("only closing takes it")
    }
}

impl Drop for ReadFile {
    fn drop(&mut self) {
        // What was read is good, and a failure to close is noted.
        let _ = self.0.take().map(h5::close);
    }
}

/// Opens a file for reading.
///
/// # Errors
/// What is no file; a file that is damaged, announces more than it holds, or has numbers or links
/// in other files.
pub fn open(path: &Path) -> hdf5::Result<ReadFile> {
    let kind = std::fs::metadata(path).map(|file| file.file_type());
    // HDF5 says best what is missing.
    kind.map_or(Ok(()), is_regular).map_err(|e| e.to_string())?;
    #[expect(clippy::disallowed_methods, reason = "here it is looked at")]
    let file = ReadFile(Some(File::open(path)?));
    let mut objects = MOST_OBJECTS;
    inspect(&file, file.size(), DEEPEST, &mut objects)?;
    Ok(file)
}

/// Opens a file, reads from it and closes it.
///
/// # Errors
/// As of [`open`] and of `read`; a file that cannot be closed.
pub fn read<T>(path: &Path, read: impl FnOnce(&File) -> hdf5::Result<T>) -> hdf5::Result<T> {
    let file = open(path)?;
    let content = read(&file)?;
    file.close()?;
    Ok(content)
}

/// Reads some rows of a dataset, all values in order.
///
/// # Errors
/// If HDF5 fails.
pub fn rows<T: H5Type>(dataset: &Dataset, rows: Range<usize>) -> hdf5::Result<Vec<T>> {
    let mut slab = vec![SliceOrIndex::from(rows)];
    slab.resize(dataset.ndim(), SliceOrIndex::from(..));
    let values = dataset.read_slice::<T, _, IxDyn>(Hyperslab::from(slab))?;
    Ok(values.into_raw_vec_and_offset().0)
}

fn inspect(group: &Group, bytes: u64, levels: usize, objects: &mut usize) -> hdf5::Result<()> {
    group.iter_visit_default(|name, link| {
        if link.link_type == LinkType::External {
            return Err(format!("{}/{name} is a link to another file", group.name()).into());
        }
        if link.link_type == LinkType::Soft {
            return Ok(());
        }
        *objects = objects.saturating_sub(1);
        if levels == 0 || *objects == 0 {
            return Err("its groups contain each other".into());
        }
        // Other types, of which HDF5 1.12 has one more, hold no numbers.
        let kind = group.loc_type_by_name(name)?;
        if kind == LocationType::Group {
            inspect(&group.group(name)?, bytes, levels - 1, objects)
        } else if kind == LocationType::Dataset {
            can_hold(&group.dataset(name)?, bytes)
        } else {
            Ok(())
        }
    })
}

/// Whether a file of so many bytes can hold a dataset.
fn can_hold(dataset: &Dataset, bytes: u64) -> hdf5::Result<()> {
    let (name, create) = (dataset.name(), dataset.create_plist()?);
    if !create.get_external()?.is_empty() || create.get_layout()? == Layout::Virtual {
        return Err(format!("the numbers of {name} are in another file").into());
    }
    let most = if create.has_filters() {
        bytes.saturating_mul(DENSEST)
    } else {
        bytes
    };
    let (shape, of_one) = (dataset.get_shape()?, dataset.dtype()?.size() as u64);
    let mut lengths = shape.iter();
    match lengths.try_fold(of_one, |all, &n| all.checked_mul(n as u64)) {
        Some(announced) if announced <= most => Ok(()),
        _ => Err(format!("{name} announces {shape:?} values, more than the file can hold").into()),
    }
}
