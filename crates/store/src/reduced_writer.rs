//! Writes `reduced.h5` (docs/reference/file-formats.md).

use std::path::{Path, PathBuf};

use hdf5::Dataset;
use ndarray::{ArrayView, ArrayView2, s};

use gshear_dem::failure::Result;

use crate::checked::CheckedFile;
use crate::h5::Attribute;

/// Writer of `reduced.h5`.
pub struct ReducedWriter {
    dmin: Dataset,
    file: CheckedFile,
}

impl ReducedWriter {
    /// Creates the file and, if missing, its folder, with an empty `dmin/value` `[rows][N]`
    /// and `dmin/strain` `[rows]`.
    ///
    /// # Errors
    /// `Failure::Other` if the folder or the file cannot be written.
    pub fn create(path: &Path, strain: &[f64], grains: usize) -> Result<Self> {
        let mut file = CheckedFile::create(path)?;
        let made = (|| {
            file.root()?.create_group("dmin")?;
            file.dataset("dmin/strain", ArrayView::from(strain))?;
            file.empty::<f64>("dmin/value", &[strain.len(), grains])
        })();
        let dmin = file.checked(made)?;
        Ok(ReducedWriter { dmin, file })
    }

    /// Writes numbers, one of each row, into `dmin/NAME`.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn numbers(&mut self, name: &str, values: &[i64]) -> Result<()> {
        let name = format!("dmin/{name}");
        let written = self.file.dataset(&name, ArrayView::from(values));
        self.file.checked(written)
    }

    /// Writes an attribute of the file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn attribute(&self, name: &str, value: impl Into<Attribute>) -> Result<()> {
        let written = self.file.attribute(name, &value.into());
        self.file.checked(written)
    }

    /// Writes D²min `[rows][N]` (m²) from row `first` on.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn dmin(&self, first: usize, values: ArrayView2<f64>) -> Result<()> {
        let rows = s![first..first + values.nrows(), ..];
        self.file.checked(self.dmin.write_slice(values, rows))
    }

    /// Closes the file and gives it its final name. Returns its path.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(self) -> Result<PathBuf> {
        drop(self.dmin);
        self.file.finish()
    }
}
