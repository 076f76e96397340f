//! Where in a file the raw data of its datasets are.

use std::ops::Range;

use hdf5_sys::h5::{haddr_t, hsize_t};
use hdf5_sys::h5d;

/// A dataset, and the places of the chunks found so far: chunks never move.
pub(super) struct RawData {
    dataset: hdf5::Dataset,
    /// In the order of their indices.
    chunks: Vec<Range<u64>>,
    /// Shape of a chunk; `None` if the data are contiguous.
    chunk: Option<Vec<usize>>,
    /// Bytes of a chunk: the most by which the data in the file exceed what has been written.
    pub(super) chunk_bytes: u64,
}

impl RawData {
    pub(super) fn of(dataset: hdf5::Dataset) -> Self {
        let chunk = dataset.chunk();
        let entries = match &chunk {
            Some(chunk) => chunk.iter().product::<usize>(),
            None => 0,
        };
        let bytes = dataset.dtype().map_or(0, |datatype| datatype.size());
        Self {
            chunks: Vec::new(),
            chunk_bytes: (entries * bytes) as u64,
            chunk,
            dataset,
        }
    }

    /// Byte ranges of the file, empty ones included. Collective.
    pub(super) fn extents(&mut self) -> hdf5::Result<&[Range<u64>]> {
        let Some(chunk) = &self.chunk else {
            let start = self.dataset.offset().unwrap_or(0);
            let end = start + self.dataset.storage_size();
            self.chunks = std::iter::once(start..end).collect();
            return Ok(&self.chunks);
        };
        let shape = self.dataset.shape();
        let axes = shape.iter().zip(chunk);
        let counts: Vec<usize> = axes
            .map(|(all, of_chunk)| all.div_ceil(*of_chunk))
            .collect();
        let all = counts.iter().product();
        // The number of chunks changes along the first dimension only, so indices stay.
        self.chunks.truncate(all);
        for index in self.chunks.len()..all {
            let mut rest = index;
            let mut offset: Vec<hsize_t> = vec![0; counts.len()];
            for axis in (0..counts.len()).rev() {
                offset[axis] = (rest % counts[axis] * chunk[axis]) as hsize_t;
                rest /= counts[axis];
            }
            let (mut mask, mut start, mut size) = (0, haddr_t::MAX, 0);
            hdf5::sync::sync(|| {
                // SAFETY: the dataset is open; `offset` has an entry for each of its dimensions;
                // the other pointers are to numbers of the types that the library writes.
                let status = unsafe {
                    h5d::H5Dget_chunk_info_by_coord(
                        self.dataset.id(),
                        offset.as_ptr(),
                        &raw mut mask,
                        &raw mut start,
                        &raw mut size,
                    )
                };
                hdf5::h5check(status)
            })?;
            // A chunk that is not allocated has the greatest address, and no data.
            let start = if start == haddr_t::MAX { 0 } else { start };
            self.chunks.push(start..start + size);
        }
        Ok(&self.chunks)
    }
}
