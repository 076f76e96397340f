//! Reads one frame in the form of a checkpoint, of disks or spheres.

use bytemuck::Zeroable;

use super::{FrameFields, RunFile};
use gshear_dem::failure::Result;
use gshear_dem::state::{ContactSample, ContactState, GrainState, body};
use gshear_scene::Dimensions;

impl RunFile {
    /// Reads positions, radii and bodies of all grains, by id, and the contacts between them with
    /// their histories, of frame t < T. Velocities and forces are 0.
    ///
    /// # Errors
    /// `Failure::Input` if the file is damaged.
    pub fn state(&self, t: usize) -> Result<(Vec<GrainState>, Vec<ContactState>)> {
        let places = self.places(&(t..t + 1))?;
        let grains = places.iter().enumerate().map(|(g, place)| GrainState {
            id: place.id,
            body: match place.removed {
                0 => self.grains.body[g].into(),
                _ => body::REMOVED,
            },
            radius: self.grains.radius[g],
            material: self.material[g].into(),
            position: place.position,
            ..GrainState::zeroed()
        });
        let between_grains = &self.contacts[0];
        let contacts = self.contacts(between_grains, &(t..t + 1), FrameFields::All)?;
        let contacts = contacts.iter().flatten().map(|c| self.contact_state(c));
        Ok((grains.collect(), contacts.collect()))
    }

    fn contact_state(&self, c: &ContactSample) -> ContactState {
        let history = match self.dimension {
            Dimensions::Two => [c.tangential_history[0], 0.0, c.rolling_history],
            Dimensions::Three => c.tangential_history,
        };
        let limits = [
            Some(c.sliding != 0),
            self.has_rolling().then_some(c.rolling != 0),
            self.has_twisting().then_some(c.twisting != 0),
        ];
        ContactState {
            limits: ContactState::stored(limits, c.idle != 0),
            torques: c.torques,
            age: c.age,
            ..ContactState::new(c.i, c.j, history)
        }
    }
}
