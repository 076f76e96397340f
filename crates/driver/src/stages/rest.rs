//! A state at rest, to return to.

use std::collections::HashSet;

use super::assembly::Assembly;
use gshear_dem::dimension::Dimension;
use gshear_dem::drive::NoWalls;
use gshear_dem::failure::Failure;
use gshear_dem::state::{Cell, HeldState};

/// This rank's part of a state at rest, to return to.
#[derive(Debug, Clone)]
pub(super) struct RestState {
    /// The cell.
    pub cell: Cell,
    /// Grains, and their contacts, which other ranks may have as well.
    pub state: HeldState,
}

impl RestState {
    pub fn of<D: Dimension>(assembly: &mut Assembly<'_, D>) -> Self {
        Self {
            cell: assembly.system.cell,
            state: assembly.held(),
        }
    }

    /// The state with each contact on the rank that has its first grain, as for a checkpoint.
    pub fn owned(&self) -> HeldState {
        let ids: HashSet<u32> = self.state.grains.iter().map(|g| g.id).collect();
        let mut state = self.state.clone();
        state.contacts.retain(|contact| ids.contains(&contact.i));
        state
    }

    pub fn put_back<D: Dimension>(self, into: &mut Assembly<'_, D>) -> Result<(), Failure> {
        into.system.set_cell(into.exchange, self.cell)?;
        into.replace(&mut NoWalls, self.state.grains, self.state.contacts)
    }
}
