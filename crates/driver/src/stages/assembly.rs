//! The grains of a stage, the law between them, and a state at rest to return to.

use std::collections::HashSet;

use gshear_dem::dimension::Dimension;
use gshear_dem::drive::{Drive, NoWalls};
use gshear_dem::failure::Result;
use gshear_dem::kernel::{ContactForces, PairForce};
use gshear_dem::observe;
use gshear_dem::state::{
    Cell, ContactSample, ContactState, GrainSample, GrainState, HeldState, Snapshot, length,
};
use gshear_dem::step::{Advanced, StepRequest, advance, initial_forces};
use gshear_dem::system::{Setup, System};
use gshear_mpi_exchange::{Parallel, processor_time};
use gshear_scene::{PlaneShear, Scene};

use crate::run::Run;

/// The grains of a stage on all ranks, and the law between them. All methods are collective.
pub(crate) struct Assembly<'a, D: Dimension> {
    /// The ranks.
    pub exchange: &'a dyn Parallel,
    /// The law.
    pub law: &'a dyn PairForce<D>,
    /// This rank's grains.
    pub system: System<D>,
    /// Forces of the contacts when they were last measured.
    pub samples: ContactForces,
}

impl<'a, D: Dimension> Assembly<'a, D> {
    /// Without its grains yet.
    pub fn new(
        run: &Run<'a>,
        scene: &Scene,
        cell: Cell,
        law: &'a dyn PairForce<D>,
    ) -> Result<Self> {
        Ok(Self::of(run.exchange, law, system(run, scene, cell)?))
    }

    pub fn of(exchange: &'a dyn Parallel, law: &'a dyn PairForce<D>, system: System<D>) -> Self {
        Self {
            exchange,
            law,
            system,
            samples: ContactForces::default(),
        }
    }

    /// Replaces the grains and contacts; the first list lasts for some steps at their speeds.
    pub fn replace(
        &mut self,
        drive: &mut dyn Drive<D>,
        grains: Vec<GrainState>,
        contacts: Vec<ContactState>,
    ) -> Result<()> {
        let fastest = grains.iter().map(|g| length(g.velocity));
        let fastest = self.exchange.maximum(fastest.fold(drive.speed(), f64::max));
        self.system.list.expect(fastest * self.system.step);
        (self.system).replace(self.exchange, self.law, drive, grains, contacts)
    }

    /// Makes the list of pairs anew, without walls.
    pub fn rebuild(&mut self) -> Result<()> {
        (self.system).rebuild(self.exchange, self.law, &mut NoWalls)
    }

    /// Computes the forces before the first step; `sampled`: and measures those of the contacts.
    pub fn initial_forces(&mut self, drive: &mut dyn Drive<D>, sampled: bool) -> Result<()> {
        let samples = sampled.then_some(&mut self.samples);
        initial_forces(self.exchange, &mut self.system, self.law, drive, samples)
    }

    /// Takes a step of the equations of motion, and measures the forces of the contacts if
    /// `sampled`; returns whether a stop is requested.
    pub fn advance(&mut self, drive: &mut dyn Drive<D>, sampled: bool, stop: bool) -> Result<bool> {
        let request = StepRequest {
            samples: sampled.then_some(&mut self.samples),
            stop,
            most: 1,
        };
        let advanced = advance(self.exchange, &mut self.system, self.law, drive, request)?;
        Ok(advanced.stop)
    }

    /// Takes so many steps at once, or fewer, of which nothing is measured.
    pub fn sweep(&mut self, drive: &mut dyn Drive<D>, most: u64, stop: bool) -> Result<Advanced> {
        let request = StepRequest {
            samples: None,
            stop,
            most,
        };
        advance(self.exchange, &mut self.system, self.law, drive, request)
    }

    /// This rank's grains, and their contacts, which other ranks may have as well.
    pub fn held(&mut self) -> HeldState {
        HeldState {
            grains: self.system.grain_states(),
            contacts: self.system.contact_states(self.law),
        }
    }

    /// This rank's part of the state with which a stage begins: that of [`Self::held`].
    pub fn snapshot(&mut self) -> Snapshot {
        Snapshot {
            grains: self.system.grain_states(),
            contacts: self.system.contact_states(self.law),
            ..Snapshot::default()
        }
    }

    /// This rank's part of a checkpoint, each contact on the rank that has its first grain.
    pub fn owned(&mut self) -> Snapshot {
        Snapshot {
            grains: self.system.grain_states(),
            contacts: self.system.owned_contact_states(self.law),
            ..Snapshot::default()
        }
    }

    /// This rank's part of a frame of the last measurement.
    pub fn frame(&mut self) -> (Vec<GrainSample>, Vec<ContactSample>) {
        observe::frame(&mut self.system, self.law, &self.samples)
    }

    /// The digest of the state; `more`: what else belongs to it.
    pub fn digest(&mut self, more: &[u8], step: u64) -> String {
        observe::digest(self.exchange, &mut self.system, self.law, more, step)
    }
}

/// The system of the scene in a cell, without its grains.
pub(crate) fn system<D: Dimension>(run: &Run<'_>, scene: &Scene, cell: Cell) -> Result<System<D>> {
    let sample = &scene.sample;
    let (gravity, typical_force) = match scene.shear() {
        Some(PlaneShear { load, .. }) => (load.gravity_components(), load.normal_force),
        None => {
            let radius = 0.5 * sample.mean_diameter;
            let overlap = 0.01 * sample.mean_diameter;
            let stiffness = scene.law.normal_stiffness(radius, radius, overlap);
            ([0.0; 2], stiffness * overlap)
        }
    };
    let setup = Setup {
        isa: run.isa,
        list: scene.bookkeeping.list,
        sweep: scene.bookkeeping.sweep,
        cell,
        largest_radius: sample.radius_max,
        mean_diameter: sample.mean_diameter,
        masses: scene.materials.masses.clone(),
        step: scene.time_step.step,
        gravity,
        typical_force,
        threads: run.options.threads,
        thread_clock: run.options.profile.then_some(processor_time),
    };
    let mut system = System::new(run.exchange, setup)?;
    if let Some(file) = scene.packing() {
        system.ids = file.ids.clone();
    }
    Ok(system)
}

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

    pub(crate) fn put_back<D: Dimension>(self, into: &mut Assembly<'_, D>) -> Result<()> {
        into.system.set_cell(into.exchange, self.cell)?;
        into.replace(&mut NoWalls, self.state.grains, self.state.contacts)
    }
}
