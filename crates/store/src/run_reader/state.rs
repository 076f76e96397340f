//! Reads one frame in the form of a checkpoint, of disks or spheres.

use bytemuck::Zeroable;

use super::{FrameFields, RunFile};
use gshear_dem::failure::Result;
use gshear_dem::state::{ContactSample, ContactState, GrainState};
use gshear_scene::Dimensions;

impl RunFile {
    /// Reads positions, radii and bodies of all grains, by id, and the contacts with their
    /// histories, of frame t < T. Velocities and forces are 0.
    ///
    /// # Errors
    /// `Failure::Input` if the file is damaged.
    pub fn state(&self, t: usize) -> Result<(Vec<GrainState>, Vec<ContactState>)> {
        let position = self.vectors(&self.position, &(t..t + 1))?;
        let grain = |g: usize| GrainState {
            id: g as u32,
            body: self.grains.body[g].into(),
            radius: self.grains.radius[g],
            material: self.material[g].into(),
            position: position[g],
            ..GrainState::zeroed()
        };
        let contacts = self.contacts(&(t..t + 1), FrameFields::All)?;
        let contacts = contacts.of_rows(self.rows(t..t + 1));
        let history = |c: &ContactSample| match self.dimension {
            Dimensions::Two => [c.tangential_history[0], 0.0, c.rolling_history],
            Dimensions::Three => c.tangential_history,
        };
        let contact = |c: &ContactSample| ContactState {
            limits: ContactState::stored(
                [
                    Some(c.sliding != 0),
                    self.has_rolling().then_some(c.rolling != 0),
                    self.has_twisting().then_some(c.twisting != 0),
                ],
                c.idle != 0,
            ),
            torques: c.torques,
            ..ContactState::new(c.i, c.j, history(c))
        };
        Ok((
            (0..self.grains.count()).map(grain).collect(),
            contacts.iter().map(contact).collect(),
        ))
    }
}
