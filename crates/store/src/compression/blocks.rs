//! Datasets that grow, in blocks that are read and written as wholes.

use std::io::Write;
use std::ops::Range;

use bytemuck::{NoUninit, cast_slice};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use hdf5::types::{FloatSize, IntSize, TypeDescriptor};
use hdf5::{Dataset, H5Type, Hyperslab, SliceOrIndex};
use ndarray::IxDyn;

use super::Storage;

/// Of deflate: the numbers are nearly random, so more time gains little
/// (docs/validation/speed.md, "Size and speed of files").
pub(super) const LEVEL: u8 = 1;
/// A vector or tensor has at most so many components along its last axis.
const MOST_COMPONENTS: usize = 9;

/// The blocks of a dataset. A block is a chunk of plain storage, and of compressed storage as many
/// chunks as its vectors have components.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Blocks {
    /// Lengths of the dataset along its axes.
    shape: Vec<usize>,
    /// Those of a block.
    block: Vec<usize>,
    /// Components of a vector; `None` of other numbers.
    components: Option<usize>,
    /// Bytes of a number.
    size: usize,
}

impl Blocks {
    /// Of a dataset with chunks of this shape.
    pub fn of(dataset: &Dataset, mut chunk: Vec<usize>) -> hdf5::Result<Self> {
        let shape = dataset.shape();
        let last = shape.len() - 1;
        let is_vector = last > 0
            && shape[last] <= MOST_COMPONENTS
            && (chunk[last] == shape[last] || chunk[last] == 1);
        if is_vector {
            chunk[last] = shape[last];
        }
        if shape.len() - usize::from(is_vector) > 2 {
            return Err(format!("{} has too many dimensions", dataset.name()).into());
        }
        Ok(Self {
            components: is_vector.then_some(shape[last]),
            block: chunk,
            shape,
            size: dataset.dtype()?.size(),
        })
    }

    /// Shape of a chunk.
    pub fn chunk(&self, storage: Storage) -> Vec<usize> {
        let mut chunk = self.block.clone();
        if storage == Storage::Compressed && self.components.is_some() {
            chunk[self.shape.len() - 1] = 1;
        }
        chunk
    }

    /// Number of blocks along each axis.
    fn counts(&self) -> impl Iterator<Item = usize> {
        let axes = self.shape.iter().zip(&self.block);
        axes.map(|(all, of_block)| all.div_ceil(*of_block))
    }

    /// Number of blocks.
    pub fn count(&self) -> usize {
        self.counts().product()
    }

    /// The places of a block in the dataset, of those that it has.
    fn ranges(&self, block: usize) -> Vec<Range<usize>> {
        let counts: Vec<usize> = self.counts().collect();
        let mut rest = block;
        let mut ranges = vec![0..0; counts.len()];
        for axis in (0..counts.len()).rev() {
            let start = rest % counts[axis] * self.block[axis];
            rest /= counts[axis];
            ranges[axis] = start..self.shape[axis].min(start + self.block[axis]);
        }
        ranges
    }

    /// The first place of each chunk of a block.
    pub fn places(&self, block: usize, storage: Storage) -> Vec<Vec<u64>> {
        let ranges = self.ranges(block);
        let first: Vec<u64> = ranges.iter().map(|range| range.start as u64).collect();
        let chunks = match (storage, self.components) {
            (Storage::Compressed, Some(components)) => components,
            _ => 1,
        };
        let component = first.len() - 1;
        let places = (0..chunks as u64).map(|k| {
            let mut place = first.clone();
            place[component] += k;
            place
        });
        places.collect()
    }

    /// Reads a block. Returns its chunks as the file has them.
    pub fn read(
        &self,
        from: &Dataset,
        block: usize,
        storage: Storage,
    ) -> hdf5::Result<Vec<Vec<u8>>> {
        let ranges = self.ranges(block);
        let bytes = read_bytes(from, &ranges)?;
        let components = self.components.unwrap_or(1);
        let whole = WholeBlock {
            bytes: &bytes,
            filled: self.two_axes(ranges.iter().map(Range::len)),
            lengths: self.two_axes(self.block.iter().copied()),
            components,
            size: self.size,
        };
        match storage {
            Storage::Plain => Ok(vec![whole.padded()]),
            Storage::Compressed => (0..components)
                .map(|component| deflated(&whole.shuffled(component)))
                .collect(),
        }
    }

    /// Lengths along the axes without that of the components.
    fn two_axes(&self, lengths: impl Iterator<Item = usize>) -> [usize; 2] {
        let axes = self.shape.len() - usize::from(self.components.is_some());
        let mut both = [1, 1];
        both.iter_mut()
            .zip(lengths.take(axes))
            .for_each(|(to, length)| *to = length);
        both
    }
}

/// The numbers of a block that is partly filled at the end of a dataset.
struct WholeBlock<'a> {
    bytes: &'a [u8],
    /// Rows and columns that are filled.
    filled: [usize; 2],
    /// Rows and columns.
    lengths: [usize; 2],
    /// Numbers of each.
    components: usize,
    /// Bytes of a number.
    size: usize,
}

impl WholeBlock<'_> {
    /// All numbers, zero where nothing is filled.
    fn padded(&self) -> Vec<u8> {
        let [rows, columns] = self.lengths;
        let of_one = self.components * self.size;
        let mut padded = vec![0; rows * columns * of_one];
        let filled = self.bytes.chunks_exact(self.filled[1] * of_one);
        for (row, bytes) in padded.chunks_exact_mut(columns * of_one).zip(filled) {
            row[..bytes.len()].copy_from_slice(bytes);
        }
        padded
    }

    /// One component, shuffled as HDF5 does: the first bytes of all numbers, then the second ones,
    /// and so on.
    fn shuffled(&self, component: usize) -> Vec<u8> {
        let [rows, columns] = self.lengths;
        let (numbers, size) = (rows * columns, self.size);
        let mut shuffled = vec![0; numbers * size];
        let of_one = self.components * size;
        let filled = self.bytes.chunks_exact(self.filled[1] * of_one);
        for (row, bytes) in filled.enumerate() {
            for (column, vector) in bytes.chunks_exact(of_one).enumerate() {
                let number = &vector[component * size..][..size];
                for (k, byte) in number.iter().enumerate() {
                    shuffled[k * numbers + row * columns + column] = *byte;
                }
            }
        }
        shuffled
    }
}

/// Bytes in the format of zlib, as HDF5 deflates them.
fn deflated(bytes: &[u8]) -> hdf5::Result<Vec<u8>> {
    let level = Compression::new(LEVEL.into());
    let mut encoder = ZlibEncoder::new(Vec::with_capacity(bytes.len()), level);
    let written = encoder.write_all(bytes).and_then(|()| encoder.finish());
    written.map_err(|e| e.to_string().into())
}

/// Reads the numbers of some places as they are in memory.
pub(super) fn read_bytes(from: &Dataset, places: &[Range<usize>]) -> hdf5::Result<Vec<u8>> {
    let places: Vec<SliceOrIndex> = places.iter().cloned().map(SliceOrIndex::from).collect();
    let places = Hyperslab::from(places);
    match from.dtype()?.to_descriptor()? {
        TypeDescriptor::Float(FloatSize::U8) => read::<f64>(from, places),
        TypeDescriptor::Unsigned(IntSize::U8) => read::<u64>(from, places),
        TypeDescriptor::Unsigned(IntSize::U4) => read::<u32>(from, places),
        TypeDescriptor::Integer(IntSize::U4) => read::<i32>(from, places),
        TypeDescriptor::Unsigned(IntSize::U1) => read::<u8>(from, places),
        _ => Err(format!("{} has numbers of another kind", from.name()).into()),
    }
}

/// Copies all numbers of a dataset to one of the same shape.
pub(super) fn copy_values(from: &Dataset, to: &Dataset) -> hdf5::Result<()> {
    match from.dtype()?.to_descriptor()? {
        TypeDescriptor::Float(FloatSize::U8) => to.write_raw(&from.read_raw::<f64>()?),
        TypeDescriptor::Unsigned(IntSize::U8) => to.write_raw(&from.read_raw::<u64>()?),
        TypeDescriptor::Unsigned(IntSize::U4) => to.write_raw(&from.read_raw::<u32>()?),
        TypeDescriptor::Integer(IntSize::U4) => to.write_raw(&from.read_raw::<i32>()?),
        TypeDescriptor::Unsigned(IntSize::U1) => to.write_raw(&from.read_raw::<u8>()?),
        _ => Err(format!("{} has numbers of another kind", from.name()).into()),
    }
}

fn read<T: H5Type + NoUninit>(from: &Dataset, places: Hyperslab) -> hdf5::Result<Vec<u8>> {
    let values = from.read_slice::<T, _, IxDyn>(places)?;
    let (values, _) = values.into_raw_vec_and_offset();
    Ok(cast_slice(&values).to_vec())
}
