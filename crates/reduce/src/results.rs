//! The folder that a command writes its results into.

use std::path::{Path, PathBuf};

use gshear_dem::failure::Result;
use gshear_scene::Dimensions;
use gshear_store::dictionary;
use gshear_store::file_names::is_reduced;
use gshear_store::text_writer::refuse_linked_folder;

use crate::printer::Printer;

/// The folder of a run, unless the user has named another one. Every result of a command has its
/// place from here, so that `gshear-mpi --overwrite` knows what to remove: [`is_reduced`] lists it.
pub struct Results(PathBuf);

impl Results {
    /// The folder that the user has named, or that of the run.
    pub fn of(named: Option<&Path>, run: &Path) -> Self {
        Self(named.unwrap_or(run).to_path_buf())
    }

    /// The place that the user has named, or that of this name in the folder of the run.
    ///
    /// # Errors
    /// As of [`Results::place`].
    pub fn path(named: Option<&Path>, run: &Path, name: &str) -> Result<PathBuf> {
        named.map_or_else(
            || Self::of(None, run).place(name),
            |path| Ok(path.to_path_buf()),
        )
    }

    /// The place of a file or folder.
    ///
    /// # Errors
    /// A link to a folder, which somebody else may have put there.
    ///
    /// # Panics
    /// If [`is_reduced`] does not know the name.
    pub fn place(&self, name: &str) -> Result<PathBuf> {
        assert!(
            is_reduced(name),
            "{name}: is not in gshear_store::file_names::is_reduced"
        );
        let path = self.0.join(name);
        refuse_linked_folder(&path)?;
        Ok(path)
    }

    /// Writes a table and its metadata, and prints the name of the table.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn table(&self, name: &str, csv: &str, printer: &mut Printer) -> Result<()> {
        // None of its columns is a force or an energy, so the dimension does not matter.
        self.table_in(3, name, csv, printer)
    }

    /// [`Self::table`] of a run in `axes` dimensions.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub(crate) fn table_in(
        &self,
        axes: usize,
        name: &str,
        csv: &str,
        printer: &mut Printer,
    ) -> Result<()> {
        let path = self.place(name)?;
        dictionary::write_table(&path, csv, axes)?;
        printer.wrote(&path)
    }
}

/// The names of the columns of the components of a vector.
pub(crate) fn vector_columns(begin: &str, end: &str, dimension: Dimensions) -> Vec<String> {
    let axes = ["x", "y", "z"].into_iter().take(dimension.axes());
    axes.map(|axis| format!("{begin}{axis}{end}")).collect()
}
