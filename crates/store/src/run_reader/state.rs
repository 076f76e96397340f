//! Reads one frame in the form of a checkpoint, of disks or spheres.

use bytemuck::Zeroable;
use ndarray::{Ix2, Ix3, s};

use super::RunFile;
use gshear_dem::failure::Failure;
use gshear_dem::state::{ContactState, GrainState};

impl RunFile {
    /// Reads positions, radii and bodies of all grains, by id, and the contacts with their
    /// histories, of frame t < T. Velocities and forces are 0.
    ///
    /// # Errors
    /// [`Failure::Input`] if the file is damaged.
    pub fn state(&self, t: usize) -> Result<(Vec<GrainState>, Vec<ContactState>), Failure> {
        let position = self
            .position
            .read_slice::<f64, _, Ix3>(s![t..t + 1, .., ..])
            .map_err(|e| self.damaged(&self.position, &e))?;
        let grain = |g: usize| GrainState {
            id: g as u32,
            body: self.grains.body[g].into(),
            radius: self.grains.radius[g],
            position: [0, 1, 2].map(|axis| position[(0, g, axis)]),
            ..GrainState::zeroed()
        };
        Ok((
            (0..self.grains.count()).map(grain).collect(),
            self.histories(t)?,
        ))
    }

    fn histories(&self, t: usize) -> Result<Vec<ContactState>, Failure> {
        let rows = self.offset[t] as usize..self.offset[t + 1] as usize;
        let columns = &self.contacts;
        let (i, j) = (
            self.column::<u32>(&columns.i, &rows)?,
            self.column::<u32>(&columns.j, &rows)?,
        );
        self.check_pairs(&i, &j, rows.start)?;
        let dataset = &columns.tangential_history;
        let histories: Vec<[f64; 3]> = match &columns.rolling_history {
            Some(rolling) => {
                let tangential = self.column::<f64>(dataset, &rows)?;
                let rolling = self.column::<f64>(rolling, &rows)?;
                let both = tangential.into_iter().zip(rolling);
                both.map(|(t, m)| [t, 0.0, m]).collect()
            }
            None if rows.is_empty() => Vec::new(),
            None => {
                let values = dataset
                    .read_slice::<f64, _, Ix2>(s![rows.start..rows.end, ..])
                    .map_err(|e| self.damaged(dataset, &e))?;
                values.outer_iter().map(|v| [v[0], v[1], v[2]]).collect()
            }
        };
        let pairs = i.into_iter().zip(j).zip(histories);
        Ok(pairs
            .map(|((i, j), history)| ContactState { i, j, history })
            .collect())
    }
}
