//! Small HDF5 files whose structure and numbers HDF5 itself protects by checksums, so that every
//! reader refuses a damaged one.

use std::path::Path;

use hdf5::{Dataset, File, Group, H5Type};
use ndarray::{ArrayView, Dimension};

/// Creates a file, replacing what is there.
pub fn create(path: &Path) -> hdf5::Result<File> {
    // Before format 1.10 the index of the pieces of a dataset has no checksum.
    let mut options = File::with_options();
    options.with_fapl(|access| access.libver_v110());
    options.create(path)
}

/// Creates a dataset with a checksum for each of its rows, or for all of a list.
pub fn dataset<T: H5Type, D: Dimension>(
    group: &Group,
    name: &str,
    values: ArrayView<T, D>,
) -> hdf5::Result<Dataset> {
    let dataset = empty::<T>(group, name, values.shape())?;
    dataset.write(values)?;
    Ok(dataset)
}

/// The same, of zeros.
pub fn empty<T: H5Type>(group: &Group, name: &str, shape: &[usize]) -> hdf5::Result<Dataset> {
    let builder = group.new_dataset::<T>();
    let mut piece = shape.to_vec();
    if piece.len() > 1 {
        piece[0] = 1;
    }
    let builder = if piece.contains(&0) || shape[0] == 0 {
        builder
    } else {
        builder.chunk(piece).fletcher32()
    };
    builder.shape(shape).create(name)
}
