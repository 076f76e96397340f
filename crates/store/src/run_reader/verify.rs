//! Compares what is read with the checksums of the file.

use super::Series;
use super::open_file::{OpenFile, TablePlace};
use crate::checksums::{self, CONSTANTS, FRAMES};
use crate::layout::{FrameFormat, frame_columns};
use gshear_dem::failure::{Failure, Result};

/// The checksums of the frames of a file.
pub(crate) struct FrameSums {
    columns: Vec<String>,
    /// `[T][columns]`.
    sums: Vec<u64>,
}

impl FrameSums {
    pub fn read(source: &OpenFile<'_>, form: FrameFormat) -> Result<Self> {
        let columns = frame_columns(form);
        let sums = source.frames(FRAMES, &[columns.len()])?.read_raw();
        Ok(Self {
            columns,
            sums: sums.map_err(|e| source.wrong(FRAMES, e.to_string()))?,
        })
    }

    /// Whether a checksum of frame t is that of the file.
    pub fn agrees(&self, t: usize, column: &str, sum: u64) -> bool {
        let at = self.columns.iter().position(|known| known == column);
        let stored = at.and_then(|at| self.sums.get(t * self.columns.len() + at));
        stored.is_none_or(|&stored| stored == sum)
    }
}

impl OpenFile<'_> {
    pub(super) fn damage(&self, what: &str) -> Failure {
        let why = "its checksum differs from the stored one: the file is damaged";
        self.wrong(what, why)
    }

    /// Compares what never changes with its checksums.
    pub(super) fn verify_constants(&self, sums: [u64; 5]) -> Result<()> {
        let names = ["id", "body", "radius", "mass", "box/edges"];
        let stored: Vec<u64> = self.of_length(CONSTANTS, names.len())?;
        match (0..names.len()).find(|&k| stored[k] != sums[k]) {
            Some(k) => Err(self.damage(&format!("particles/trajectory/{}", names[k]))),
            None => Ok(()),
        }
    }

    /// Compares the rows of a table with their checksums.
    pub(super) fn verify_rows(&self, place: TablePlace, table: &Series) -> Result<()> {
        let stored: Vec<u64> = self.all(place.sums)?;
        for k in 0..table.rows().min(stored.len()) {
            let names = table.declared.iter().map(|column| column.name);
            let values = table.columns.iter().map(|values| values[k]);
            let sum = checksums::of_row(table.step[k], table.time[k], names.zip(values));
            if sum != stored[k] {
                return Err(self.damage(&format!("{}: row {k}", place.group)));
            }
        }
        Ok(())
    }
}
