//! A state at rest, to return to.

use std::collections::HashSet;

use gshear_dem::contact::PairForce;
use gshear_dem::dimension::Dimension;
use gshear_dem::drive::NoWalls;
use gshear_dem::failure::Failure;
use gshear_dem::state::{Cell, HeldState};
use gshear_dem::system::System;
use gshear_mpi_exchange::Parallel;

/// This rank's part of a state at rest, to return to.
#[derive(Debug, Clone)]
pub(super) struct RestState {
    /// The cell.
    pub cell: Cell,
    /// Grains, and their contacts, which other ranks may have as well.
    pub state: HeldState,
}

impl RestState {
    pub fn of<D: Dimension>(system: &mut System<D>, law: &dyn PairForce<D>) -> Self {
        Self {
            cell: system.cell,
            state: HeldState {
                grains: system.grain_states(),
                contacts: system.contact_states(law),
            },
        }
    }

    /// The state with each contact on the rank that has its first grain, as for a checkpoint.
    pub fn owned(&self) -> HeldState {
        let ids: HashSet<u32> = self.state.grains.iter().map(|g| g.id).collect();
        let mut state = self.state.clone();
        state.contacts.retain(|contact| ids.contains(&contact.i));
        state
    }

    pub fn put_back<D: Dimension>(
        self,
        exchange: &dyn Parallel,
        system: &mut System<D>,
        law: &dyn PairForce<D>,
    ) -> Result<(), Failure> {
        system.set_cell(exchange, self.cell)?;
        let HeldState { grains, contacts } = self.state;
        system.replace(exchange, law, &mut NoWalls, grains, contacts)
    }
}
