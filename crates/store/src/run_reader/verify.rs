//! Compares what is read with the checksums of the file.

use super::Series;
use super::open_file::OpenFile;
use crate::checksums::{self, CONSTANTS, FRAMES};
use crate::layout::{Form, frame_columns};
use gshear_dem::failure::{Failure, Result};

/// The checksums of the frames of a file.
pub struct FrameSums {
    columns: Vec<&'static str>,
    /// `[T][columns]`.
    sums: Vec<u64>,
}

impl FrameSums {
    pub fn read(source: &OpenFile<'_>, form: Form) -> Result<Self> {
        let columns = frame_columns(form);
        let sums = source.frames(FRAMES, &[columns.len()])?.read_raw();
        Ok(Self {
            columns,
            sums: sums.map_err(|e| source.wrong(FRAMES, e.to_string()))?,
        })
    }

    /// Whether a checksum of frame t is that of the file.
    pub fn agrees(&self, t: usize, column: &str, found: u64) -> bool {
        let at = self.columns.iter().position(|known| *known == column);
        let stored = at.and_then(|at| self.sums.get(t * self.columns.len() + at));
        stored.is_none_or(|&stored| stored == found)
    }
}

impl OpenFile<'_> {
    pub(super) fn damage(&self, what: &str) -> Failure {
        let why = "its checksum differs from the stored one: the file is damaged";
        self.wrong(what, why)
    }

    /// Compares what never changes with its checksums.
    pub(super) fn verify_constants(&self, found: [u64; 5]) -> Result<()> {
        let names = ["id", "body", "radius", "mass", "box/edges"];
        let stored: Vec<u64> = self.of_length(CONSTANTS, names.len())?;
        match (0..names.len()).find(|&k| stored[k] != found[k]) {
            Some(k) => Err(self.damage(&format!("particles/trajectory/{}", names[k]))),
            None => Ok(()),
        }
    }

    /// Compares the rows of a table with their checksums.
    pub(super) fn verify_rows(&self, place: (&str, &str), table: &Series) -> Result<()> {
        let (group, sums) = place;
        let stored: Vec<u64> = self.all(sums)?;
        let found = |k: usize| {
            let names = table.declared.iter().map(|column| column.name);
            let values = table.columns.iter().map(|values| values[k]);
            checksums::of_row(table.step[k], table.time[k], names.zip(values))
        };
        match (0..table.rows().min(stored.len())).find(|&k| found(k) != stored[k]) {
            Some(k) => Err(self.damage(&format!("{group}: row {k}"))),
            None => Ok(()),
        }
    }
}
