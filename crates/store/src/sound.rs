//! Opens HDF5 files that other people may have made: they lead nowhere else, and no size that they
//! announce is allocated unless the file can hold it.

use std::ops::Range;
use std::path::Path;

use hdf5::dataset::Layout;
use hdf5::{Dataset, File, Group, H5Type, Hyperslab, LinkType, LocationType, SliceOrIndex};
use ndarray::IxDyn;

/// No file has groups within groups of as many levels, or as many objects.
const DEEPEST: usize = 8;
const MOST_OBJECTS: usize = 10_000;
/// Bytes that deflate, the densest of the filters, makes of one at most.
const DENSEST: u64 = 1032;

/// Opens a file for reading.
///
/// # Errors
/// A file that is damaged, announces more than it holds, or has numbers or links in other files.
pub fn open(path: &Path) -> hdf5::Result<File> {
    let file = File::open(path)?;
    let mut objects = MOST_OBJECTS;
    inspect(&file, file.size(), DEEPEST, &mut objects)?;
    Ok(file)
}

/// Reads some rows of a dataset, all values in order.
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
