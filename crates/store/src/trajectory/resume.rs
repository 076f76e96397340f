//! A `run.h5` that is continued.

use super::{AT_THE_END, RunHeader, TrajectoryWriter, seal, write_journal};
use crate::collective::{CollectiveOutcome, IdBlocks, agree, told_by_root};
use crate::compression;
use crate::existing::inspect;
use crate::h5::H5File;
use crate::layout::{Datasets, OpenMode, PARAMETERS};
use crate::part::{Part, groups_after};
use gshear_dem::columns::Column;
use gshear_dem::failure::Result;
use gshear_mpi_exchange::Parallel;
use std::path::Path;

impl TrajectoryWriter {
    /// Opens an existing file to continue after its first `frames` frames and `rows` rows; later
    /// ones are removed. `series`: columns of the time series.
    ///
    /// # Errors
    /// `Failure::Input` if the file is not a `run.h5` or holds less.
    pub fn open_to_append(
        exchange: &dyn Parallel,
        path: &Path,
        series: &[Column],
        frames: u64,
        rows: u64,
    ) -> Result<Self> {
        let _waiting = exchange.waiting();
        // Only one rank inspects the file: after a failure in a collective call the others could
        // wait for ever.
        let existing = told_by_root(exchange, || {
            let existing = inspect(path, series, frames, rows)?;
            compression::expand(path)?;
            Ok(existing)
        })?;

        let blocks = IdBlocks::of(exchange, existing.grains);
        let part = Part::of(path);
        let mut file = H5File::open(&part.file, exchange)?;
        agree(exchange, file.enter(part.group))?;
        // The rest matters only to new datasets.
        let header = RunHeader {
            form: existing.form,
            series,
            ..RunHeader::default()
        };
        let opened = Datasets::new(&file, OpenMode::Open, existing.grains as usize, &header);
        let columns = agree(exchange, opened)?;
        let mut writer = Self::new(file, &part, columns, blocks);
        (writer.frames_written, writer.contacts_written) = (frames, existing.contacts.clone());
        // A file that was closed has no journal, and a kill while it is cut would damage it.
        write_journal(&writer.file, &writer.path, exchange)?;
        let mut outcome = CollectiveOutcome::default();
        // What follows is made anew.
        for group in groups_after(part.group) {
            outcome.note(writer.file.remove(group));
        }
        for name in AT_THE_END {
            outcome.note(writer.file.remove_attribute(PARAMETERS, name));
        }
        outcome.note(seal(&writer.file));
        writer
            .columns
            .cut(frames, &existing.contacts, rows, &mut outcome);
        writer.file.agree(exchange, outcome)?;
        writer.flush_file(exchange)?;
        // The space of removed rows may be used again, which the last journal does not know.
        write_journal(&writer.file, &writer.path, exchange)?;
        Ok(writer)
    }
}
