//! Writes `reduced.h5` (docs/file-formats.md).

use std::path::{Path, PathBuf};

use hdf5::{Dataset, File};
use ndarray::{ArrayView, ArrayView2, s};

use gshear_dem::failure::Result;

use crate::checked;
use crate::h5::{Attribute, set_attribute};
use crate::text_writer::PartFile;

/// Writer of `reduced.h5`.
pub struct ReducedWriter {
    part: PartFile,
    file: File,
    dmin: Dataset,
}

impl ReducedWriter {
    /// Creates the file and, if missing, its folder, with an empty `dmin/value` `[rows][N]`
    /// and `dmin/strain` `[rows]`.
    ///
    /// # Errors
    /// `Failure::Other` if the folder or the file cannot be written.
    pub fn create(path: &Path, strain: &[f64], grains: usize) -> Result<Self> {
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

    /// Writes numbers, one of each row, into `dmin/NAME`.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn numbers(&self, name: &str, values: &[i64]) -> Result<()> {
        let write = || -> hdf5::Result<()> {
            let group = self.file.group("dmin")?;
            checked::dataset(&group, name, ArrayView::from(values)).map(drop)
        };
        self.part.checked(write())
    }

    /// Writes an attribute of the file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn attribute(&self, name: &str, value: impl Into<Attribute>) -> Result<()> {
        let written = set_attribute(&self.file, name, &value.into());
        self.part.checked(written)
    }

    /// Writes D²min `[rows][N]` (m²) from row `first` on.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn dmin(&self, first: usize, values: ArrayView2<f64>) -> Result<()> {
        let rows = s![first..first + values.nrows(), ..];
        self.part.checked(self.dmin.write_slice(values, rows))
    }

    /// Closes the file and gives it its final name. Returns its path.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(self) -> Result<PathBuf> {
        let ReducedWriter { part, file, dmin } = self;
        drop(dmin);
        part.checked(file.close())?;
        part.finish()
    }
}
