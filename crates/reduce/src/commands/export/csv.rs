//! Tables of grains, contacts and contacts with flat walls, one line of each and frame.

use std::io::Write;
use std::path::{Path, PathBuf};

use gshear_dem::failure::Result;
use gshear_store::csv_table::Table;
use gshear_store::dictionary;
use gshear_store::text_writer::PartFile;

use super::content::{ExportedFrame, ExportedRun, contact_names, contact_values, state_names};
use super::{FrameWriter, beside};

/// Writes the tables.
pub(crate) struct CsvWriter {
    grains: TableStream,
    contacts: TableStream,
    /// Of runs with flat walls.
    wall_contacts: Option<TableStream>,
    axes: usize,
}

/// A table that is written frame by frame.
struct TableStream {
    file: PartFile,
    /// The line of the names, once it is written.
    names: String,
}

impl TableStream {
    fn create(path: &Path) -> Result<Self> {
        Ok(Self {
            file: PartFile::create(path)?,
            names: String::new(),
        })
    }

    /// Appends the table of a frame, after the first one without its names.
    fn append(&mut self, csv: &str) -> Result<()> {
        let (names, lines) = csv.split_once('\n').unwrap_or_default();
        let new = if self.names.is_empty() { csv } else { lines };
        self.names = names.into();
        let written = self.file.write_all(new.as_bytes());
        self.file.checked(written)
    }

    /// `kind`: its name in the dictionary.
    fn finish(self, kind: &str, axes: usize) -> Result<PathBuf> {
        let written = self.file.finish()?;
        let names: Vec<&str> = self.names.split(',').collect();
        dictionary::write_metadata(kind, &written, &names, axes)?;
        Ok(written)
    }
}

impl CsvWriter {
    /// # Errors
    /// Files that cannot be created.
    pub fn create(path: &Path, run: &ExportedRun) -> Result<Self> {
        Ok(Self {
            grains: TableStream::create(path)?,
            contacts: TableStream::create(&beside(path, "contacts"))?,
            wall_contacts: (run.file.form().walls)
                .then(|| TableStream::create(&beside(path, "wall-contacts")))
                .transpose()?,
            axes: run.axes(),
        })
    }
}

/// A table whose lines begin with the frame they belong to.
fn table_of<I: IntoIterator>(frame: &ExportedFrame, rows: I) -> Table<'_, I> {
    let records = &frame.records;
    Table::of(rows)
        .column("frame", |_| frame.number)
        .column("step", |_| records.step)
        .column("time", |_| records.time)
        .column("strain", |_| frame.strain)
}

impl FrameWriter for CsvWriter {
    fn frame(&mut self, run: &ExportedRun, frame: &ExportedFrame) -> Result<()> {
        let (constants, ids) = (run.file.grains(), run.file.ids());
        let moving: &[usize] = match self.axes {
            2 => &[0, 1, 3, 4, 8],
            _ => &[0, 1, 2, 3, 4, 5, 6, 7, 8],
        };
        let names: Vec<String> = state_names().collect();
        let grains = table_of(frame, &frame.present)
            .column("id", |g| ids[**g])
            .column("body", |g| constants.body[**g])
            .column("radius", |g| constants.radius[**g])
            .column("mass", |g| constants.mass[**g])
            .columns(moving.iter().map(|k| &names[*k]), |g| {
                let state: Vec<f64> = run.state_values(frame, **g).collect();
                moving.iter().map(move |k| state[*k])
            })
            .columns(run.field_names(), |g| run.field_values(frame, **g));
        self.grains.append(&grains.csv())?;
        let form = run.file.form();
        let contacts = table_of(frame, &frame.records.contacts)
            .columns(["i", "j"], |c| [c.i, c.j].map(|row| ids[row as usize]))
            .columns(contact_names(form), |c| {
                contact_values(form, c).collect::<Vec<_>>()
            });
        self.contacts.append(&contacts.csv())?;
        let Some(wall_contacts) = &mut self.wall_contacts else {
            return Ok(());
        };
        let grains = frame.records.grains.len();
        let contacts = table_of(frame, &frame.records.wall_contacts)
            .column("i", |c| ids[c.i as usize])
            .column("wall", |c| c.wall(grains).unwrap_or_default())
            .columns(["x", "y", "z"], |c| run.wall_point(frame, c))
            .columns(contact_names(form), |c| {
                contact_values(form, c).collect::<Vec<_>>()
            });
        wall_contacts.append(&contacts.csv())
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>> {
        let axes = self.axes;
        let mut written = vec![
            self.grains.finish("frames.csv", axes)?,
            self.contacts.finish("frames-contacts.csv", axes)?,
        ];
        if let Some(contacts) = self.wall_contacts {
            written.push(contacts.finish("frames-wall-contacts.csv", axes)?);
        }
        Ok(written)
    }
}
