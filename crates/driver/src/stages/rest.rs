//! A state at rest, to return to.

use gshear_dem::dimension::Dimension;
use gshear_dem::drive::NoWalls;
use gshear_dem::failure::Failure;
use gshear_dem::kernel::PairForce;
use gshear_dem::state::{Cell, ContactState, GrainState};
use gshear_dem::system::System;
use gshear_mpi_exchange::Parallel;

use crate::run::StageState;

/// This rank's part of a state at rest, to return to.
#[derive(Debug, Clone)]
pub(super) struct RestState {
    /// The cell.
    pub cell: Cell,
    /// Grains and contacts.
    pub state: StageState,
}

impl RestState {
    pub fn of<D: Dimension>(system: &mut System<D>, law: &dyn PairForce<D>) -> Self {
        let (grains, contacts): (Vec<GrainState>, Vec<ContactState>) =
            (system.grain_states(), system.contact_states(law));
        Self {
            cell: system.cell,
            state: StageState {
                grains,
                contacts,
                ..StageState::default()
            },
        }
    }

    pub fn put_back<D: Dimension>(
        self,
        exchange: &dyn Parallel,
        system: &mut System<D>,
        law: &dyn PairForce<D>,
    ) -> Result<(), Failure> {
        system.set_cell(exchange, self.cell)?;
        let StageState {
            grains, contacts, ..
        } = self.state;
        system.replace(exchange, law, &mut NoWalls, grains, contacts)
    }
}
