//! The objects of a file: groups, datasets, their attributes and names.

use hdf5::dataset::{AllocTime, FillTime};
use hdf5::types::FixedUnicode;
use hdf5::types::{TypeDescriptor, VarLenUnicode};
use hdf5::{
    Dataset, Extent, File, Group, Location, LocationToken, LocationType, ObjectReference1,
    ReferencedObject, SimpleExtents,
};

use super::Storage;
use super::blocks::{Blocks, LEVEL, copy_values};
use crate::checked::OpenFile;
use crate::h5::{Attribute, NAME, Word, set_attribute};

/// No file has groups within groups of as many levels.
const DEEPEST: usize = 8;

/// A dataset that grows.
pub(super) struct Growing {
    pub dataset: Dataset,
    pub blocks: Blocks,
    name: String,
}

/// What else is in a file, in the order in which it is created.
enum Object {
    Group(Group),
    /// A dataset of fixed size.
    Fixed(Dataset),
    /// The number of a dataset that grows.
    Growing(usize),
    /// Another name of an object of this name.
    Link(String),
}

/// All objects of a file.
pub(super) struct Objects {
    pub growing: Vec<Growing>,
    /// With their names.
    all: Vec<(String, Object)>,
    root: Group,
}

impl Objects {
    pub fn of(file: &File) -> hdf5::Result<Self> {
        let root = file.as_group()?;
        let mut objects = Self {
            growing: Vec::new(),
            all: Vec::new(),
            root: root.clone(),
        };
        objects.list(&root, "", DEEPEST, &mut Vec::new())?;
        Ok(objects)
    }

    /// Lists what is below a group. `known`: places of the objects so far, and their names.
    fn list(
        &mut self,
        group: &Group,
        path: &str,
        levels: usize,
        known: &mut Vec<(LocationToken, String)>,
    ) -> hdf5::Result<()> {
        let Some(levels) = levels.checked_sub(1) else {
            return Err("its groups contain each other".into());
        };
        for member in group.member_names()? {
            let name = format!("{path}/{member}");
            let place = group.loc_info_by_name(&member)?.token;
            if let Some((_, first)) = known.iter().find(|(token, _)| *token == place) {
                self.all.push((name, Object::Link(first.clone())));
                continue;
            }
            known.push((place, name.clone()));
            let kind = group.loc_type_by_name(&member)?;
            if kind == LocationType::Group {
                let below = group.group(&member)?;
                self.all.push((name.clone(), Object::Group(below.clone())));
                self.list(&below, &name, levels, known)?;
            } else if kind == LocationType::Dataset {
                let object = self.dataset(group.dataset(&member)?, &name)?;
                self.all.push((name, object));
            } else {
                return Err(format!("{name} is neither a group nor a dataset").into());
            }
        }
        Ok(())
    }

    /// A dataset of this name.
    fn dataset(&mut self, dataset: Dataset, name: &str) -> hdf5::Result<Object> {
        let Some(chunk) = dataset.chunk() else {
            return Ok(Object::Fixed(dataset));
        };
        self.growing.push(Growing {
            blocks: Blocks::of(&dataset, chunk)?,
            dataset,
            name: name.into(),
        });
        Ok(Object::Growing(self.growing.len() - 1))
    }

    /// Creates all objects in an empty file, and keeps its datasets open. Returns those that grow,
    /// without their values.
    pub fn copy_to(&self, to: &mut OpenFile, storage: Storage) -> hdf5::Result<Vec<Dataset>> {
        let file = to.file().clone();
        let (mut growing, mut fixed) = (Vec::new(), Vec::new());
        for (name, object) in &self.all {
            match object {
                Object::Group(_) => drop(file.create_group(name)?),
                Object::Fixed(dataset) => {
                    let copy = create_fixed(&file, name, dataset)?;
                    to.keep(copy.clone());
                    // H5Ocopy crashes on a full disk.
                    copy_values(dataset, &copy)?;
                    fixed.push((dataset, copy));
                }
                Object::Growing(k) => {
                    let copy = self.growing[*k].create(&file, storage)?;
                    to.keep(copy.clone());
                    growing.push(copy);
                }
                Object::Link(first) => file.link_hard(first, name)?,
            }
        }
        // References are to objects that are there.
        copy_attributes(&self.root, &*file.as_group()?)?;
        for (name, object) in &self.all {
            if let Object::Group(group) = object {
                copy_attributes(group, &*file.group(name)?)?;
            }
        }
        for (from, to) in self.growing.iter().zip(&growing) {
            copy_attributes(&from.dataset, to)?;
        }
        for (from, to) in fixed {
            copy_attributes(from, &to)?;
        }
        Ok(growing)
    }
}

impl Growing {
    fn create(&self, file: &File, storage: Storage) -> hdf5::Result<Dataset> {
        let shape = self.dataset.shape();
        let mut extents: Vec<Extent> = shape.iter().map(|&n| Extent::fixed(n)).collect();
        extents[0] = Extent::resizable(shape[0]);
        let element = self.dataset.dtype()?.to_descriptor()?;
        let builder = (file.new_dataset_builder().empty_as(&element))
            .shape(SimpleExtents::from_vec(extents))
            .chunk(self.blocks.chunk(storage))
            .fill_time(FillTime::Never);
        let builder = match storage {
            // As a run creates it.
            Storage::Plain => builder.alloc_time(Some(AllocTime::Early)),
            Storage::Compressed => builder
                .alloc_time(Some(AllocTime::Incr))
                .shuffle()
                .deflate(LEVEL),
        };
        builder.create(&*self.name)
    }
}

fn create_fixed(file: &File, name: &str, dataset: &Dataset) -> hdf5::Result<Dataset> {
    let element = dataset.dtype()?.to_descriptor()?;
    let builder = (file.new_dataset_builder().empty_as(&element))
        .shape(dataset.shape())
        .fill_time(FillTime::Never)
        .alloc_time(Some(AllocTime::Early));
    builder.create(name)
}

fn copy_attributes(from: &Location, to: &Location) -> hdf5::Result<()> {
    for name in from.attr_names()? {
        set_attribute(to, &name, &attribute(from, &name)?)?;
    }
    Ok(())
}

/// An attribute of the kinds that runs write.
fn attribute(object: &Location, name: &str) -> hdf5::Result<Attribute> {
    let stored = object.attr(name)?;
    let is_scalar = stored.is_scalar();
    Ok(match stored.dtype()?.to_descriptor()? {
        TypeDescriptor::VarLenUnicode => {
            Attribute::Text(stored.read_scalar::<VarLenUnicode>()?.to_string())
        }
        TypeDescriptor::FixedAscii(_) if is_scalar => {
            Attribute::Word(stored.read_scalar::<Word>()?.to_string())
        }
        TypeDescriptor::FixedAscii(_) => {
            let words = stored.read_raw::<Word>()?;
            Attribute::Words(words.iter().map(ToString::to_string).collect())
        }
        TypeDescriptor::FixedUnicode(_) => {
            Attribute::Name(stored.read_scalar::<FixedUnicode<NAME>>()?.to_string())
        }
        TypeDescriptor::Float(_) if is_scalar => Attribute::Number(stored.read_scalar()?),
        TypeDescriptor::Float(_) => Attribute::Numbers(stored.read_raw()?),
        TypeDescriptor::Unsigned(_) if is_scalar => Attribute::Count(stored.read_scalar()?),
        TypeDescriptor::Integer(_) if !is_scalar => Attribute::Integers(stored.read_raw()?),
        TypeDescriptor::Reference(_) => {
            let reference = stored.read_scalar::<ObjectReference1>()?;
            Attribute::Reference(match object.dereference(&reference)? {
                ReferencedObject::Group(group) => group.name(),
                ReferencedObject::Dataset(dataset) => dataset.name(),
                ReferencedObject::Datatype(_) => return Err("refers to a type".into()),
            })
        }
        other => return Err(format!("attribute {name} is of the kind {other}").into()),
    })
}
