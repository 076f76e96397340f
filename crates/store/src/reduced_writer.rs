//! Writes `reduced.h5` (docs/file-formats.md), first as `reduced.h5.part`, so that a file with the
//! final name is always complete.

use std::path::{Path, PathBuf};

use hdf5::types::VarLenUnicode;
use hdf5::{Dataset, File, H5Type};
use ndarray::{ArrayView2, s};

use gshear_dem::failure::Failure;

/// Writer of `reduced.h5`.
pub struct ReducedWriter {
    path: PathBuf,
    part: PathBuf,
    file: File,
    dmin: Dataset,
}

impl ReducedWriter {
    /// Creates `reduced.h5.part` in `folder`, which is created if missing, with an empty
    /// `dmin/value` `[T][N]` and `dmin/strain` `[T]`.
    ///
    /// # Errors
    /// [`Failure::Other`] if the folder or the file cannot be written.
    pub fn create(folder: &Path, strain: &[f64], grains: usize) -> Result<Self, Failure> {
        let path = folder.join("reduced.h5");
        let part = folder.join("reduced.h5.part");
        std::fs::create_dir_all(folder)
            .map_err(|e| Failure::other(format!("{}: cannot be created: {e}", folder.display())))?;
        let make = || -> hdf5::Result<(File, Dataset)> {
            let file = File::create(&part)?;
            let group = file.create_group("dmin")?;
            group
                .new_dataset_builder()
                .with_data(strain)
                .create("strain")?;
            let dmin = group
                .new_dataset::<f64>()
                .shape((strain.len(), grains))
                .create("value")?;
            Ok((file, dmin))
        };
        let (file, dmin) = make().map_err(|e| cannot_write(&part, &e))?;
        Ok(ReducedWriter {
            path,
            part,
            file,
            dmin,
        })
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
        write().map_err(|e| cannot_write(&self.part, &e))
    }

    /// Writes D²min `[frames][N]` (m²) from frame `first` on.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn dmin(&self, first: usize, values: ArrayView2<f64>) -> Result<(), Failure> {
        let rows = s![first..first + values.nrows(), ..];
        self.dmin
            .write_slice(values, rows)
            .map_err(|e| cannot_write(&self.part, &e))
    }

    /// Closes the file and gives it its final name. Returns its path.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(self) -> Result<PathBuf, Failure> {
        let ReducedWriter {
            path,
            part,
            file,
            dmin,
        } = self;
        drop(dmin);
        file.close().map_err(|e| cannot_write(&part, &e))?;
        std::fs::rename(&part, &path)
            .map_err(|e| Failure::other(format!("{}: cannot be written: {e}", path.display())))?;
        Ok(path)
    }
}

fn cannot_write(path: &Path, error: &hdf5::Error) -> Failure {
    let reason = error.to_string().replace('\n', " ");
    Failure::other(format!("{}: cannot be written: {reason}", path.display()))
}
