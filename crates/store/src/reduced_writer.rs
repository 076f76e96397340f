//! Writes `reduced.h5` (docs/file-formats.md).

use std::path::{Path, PathBuf};

use hdf5::types::VarLenUnicode;
use hdf5::{Dataset, File, H5Type};
use ndarray::{ArrayView, ArrayView2, s};

use gshear_dem::failure::Failure;

use crate::checked;
use crate::text_writer::PartFile;

/// Writer of `reduced.h5`.
pub struct ReducedWriter {
    part: PartFile,
    file: File,
    dmin: Dataset,
}

impl ReducedWriter {
    /// Creates the file and, if missing, its folder, with an empty `dmin/value` `[T][N]`
    /// and `dmin/strain` `[T]`.
    ///
    /// # Errors
    /// [`Failure::Other`] if the folder or the file cannot be written.
    pub fn create(path: &Path, strain: &[f64], grains: usize) -> Result<Self, Failure> {
        let part = PartFile::create(path)?;
        let make = || -> hdf5::Result<(File, Dataset)> {
            let file = checked::create(part.part())?;
            let group = file.create_group("dmin")?;
            checked::dataset(&group, "strain", ArrayView::from(strain))?;
            let dmin = checked::empty::<f64>(&group, "value", &[strain.len(), grains])?;
            Ok((file, dmin))
        };
        let (file, dmin) = part.checked(make())?;
        Ok(ReducedWriter { part, file, dmin })
    }

    /// Writes a text attribute of the file.
    ///
    /// # Errors
    /// If the file cannot be written, or the text holds a zero character.
    pub fn text(&self, name: &str, value: &str) -> Result<(), Failure> {
        let text: VarLenUnicode = value
            .parse()
            .map_err(|_| Failure::other(format!("{name}: holds a zero character")))?;
        self.attribute(name, &text)
    }

    /// Writes a numeric attribute of the file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn number(&self, name: &str, value: f64) -> Result<(), Failure> {
        self.attribute(name, &value)
    }

    fn attribute<T: H5Type>(&self, name: &str, value: &T) -> Result<(), Failure> {
        let write = || self.file.new_attr::<T>().create(name)?.write_scalar(value);
        self.part.checked(write())
    }

    /// Writes D²min `[frames][N]` (m²) from frame `first` on.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn dmin(&self, first: usize, values: ArrayView2<f64>) -> Result<(), Failure> {
        let rows = s![first..first + values.nrows(), ..];
        self.part.checked(self.dmin.write_slice(values, rows))
    }

    /// Closes the file and gives it its final name. Returns its path.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(self) -> Result<PathBuf, Failure> {
        let ReducedWriter { part, file, dmin } = self;
        drop(dmin);
        part.checked(file.close())?;
        part.finish()
    }
}
