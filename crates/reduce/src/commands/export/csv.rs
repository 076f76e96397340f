//! Tables of grains and contacts, one line per grain or contact and frame.

use std::path::{Path, PathBuf};

use csv::{StringRecord, Writer};

use gshear_dem::failure::Failure;
use gshear_store::csv_table::TableCell;
use gshear_store::dictionary;
use gshear_store::text_writer::{PartFile, unwritten};

use super::content::{ExportedFrame, ExportedRun, STATE, contact_names, contact_values, moving};
use super::{FrameWriter, contacts_beside};

/// Columns that say which frame a line belongs to.
const FRAME: [&str; 4] = ["frame", "step", "time", "strain"];

/// Writes both tables.
pub struct CsvWriter {
    grains: TableStream,
    contacts: TableStream,
}

/// A table that is written line by line.
struct TableStream {
    path: PathBuf,
    writer: Writer<PartFile>,
    line: StringRecord,
    names: StringRecord,
    /// Its name in the dictionary.
    kind: &'static str,
    axes: usize,
}

impl TableStream {
    fn create<'a>(
        (kind, axes): (&'static str, usize),
        path: &Path,
        names: impl Iterator<Item = &'a str>,
    ) -> Result<Self, Failure> {
        let names: StringRecord = names.collect();
        let mut table = Self {
            path: path.to_path_buf(),
            writer: Writer::from_writer(PartFile::create(path)?),
            line: names.clone(),
            names,
            kind,
            axes,
        };
        table.end_line()?;
        Ok(table)
    }

    fn cells(&mut self, cells: &[&dyn TableCell]) {
        for cell in cells {
            self.line.push_field(&cell.text());
        }
    }

    fn end_line(&mut self) -> Result<(), Failure> {
        let written = self.writer.write_record(&self.line);
        self.line.clear();
        written.map_err(|e| unwritten(&self.path, &e))
    }

    fn finish(self) -> Result<PathBuf, Failure> {
        let path = self.path;
        let file = self.writer.into_inner().map_err(|e| unwritten(&path, &e))?;
        let written = file.finish()?;
        let names: Vec<&str> = self.names.iter().collect();
        dictionary::write_metadata(self.kind, &written, &names, self.axes)?;
        Ok(written)
    }
}

impl CsvWriter {
    /// # Errors
    /// Files that cannot be created.
    pub fn create(path: &Path, run: &ExportedRun) -> Result<Self, Failure> {
        let axes = run.axes();
        let named = moving(axes).iter().map(|k| STATE[*k]);
        let fields = run.field_names();
        let grains = (FRAME.into_iter())
            .chain(["id", "body", "radius", "mass"])
            .chain(named)
            .chain(fields.iter().map(String::as_str));
        let named: Vec<String> = contact_names(run.file.form()).collect();
        let named = named.iter().map(String::as_str);
        let contacts = FRAME.into_iter().chain(["i", "j"]).chain(named);
        let beside = contacts_beside(path);
        Ok(Self {
            grains: TableStream::create(("frames.csv", axes), path, grains)?,
            contacts: TableStream::create(("frames-contacts.csv", axes), &beside, contacts)?,
        })
    }
}

impl FrameWriter for CsvWriter {
    fn frame(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> Result<(), Failure> {
        let (records, constants, ids) = (&frame.records, run.file.grains(), run.file.ids());
        let of_frame: [&dyn TableCell; 4] =
            [&frame.number, &records.step, &records.time, &frame.strain];
        for &g in &frame.present {
            let table = &mut self.grains;
            table.cells(&of_frame);
            table.cells(&[
                &ids[g],
                &constants.body[g],
                &constants.radius[g],
                &constants.mass[g],
            ]);
            let state: Vec<f64> = run.state_values(frame, g).collect();
            for k in moving(run.axes()) {
                table.cells(&[&state[*k]]);
            }
            for value in run.field_values(frame, g) {
                table.cells(&[&value]);
            }
            table.end_line()?;
        }
        for contact in &records.contacts {
            let table = &mut self.contacts;
            table.cells(&of_frame);
            table.cells(&[&ids[contact.i as usize], &ids[contact.j as usize]]);
            for value in contact_values(run.file.form(), contact) {
                table.cells(&[&value]);
            }
            table.end_line()?;
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, Failure> {
        Ok(vec![self.grains.finish()?, self.contacts.finish()?])
    }
}
