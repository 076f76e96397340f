//! Names of grains.

use serde::{Deserialize, Serialize};

/// Ids of grains, ascending, by their rows 0 … N-1: each row at which they jump, and its id. By
/// default ids are rows.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Ids(Vec<[u32; 2]>);

impl Ids {
    /// `ids`: of the rows, from 0 on.
    pub fn new(ids: impl Iterator<Item = u32>) -> Self {
        let mut jumps = Self::default();
        for (row, id) in (0..).zip(ids) {
            if jumps.of(row) != id {
                jumps.0.push([row, id]);
            }
        }
        jumps
    }

    /// The id of a row.
    pub fn of(&self, row: u32) -> u32 {
        let begun = self.0.partition_point(|[first, _]| *first <= row);
        let [first, id] = self.0[..begun].last().copied().unwrap_or_default();
        id + (row - first)
    }
}
