//! A few grains for the stress tests: the only code of theirs that uses the interfaces of the
//! crates directly.

use gshear_dem::contact::ContactLaw;
use gshear_dem::contact::stiffness::Stiffness;
use gshear_dem::dimension::{Dimension, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::{Drive, NoWalls};
use gshear_dem::failure::Outside;
use gshear_dem::failure::Result;
use gshear_dem::kernel::ContactForces;
use gshear_dem::state::{Cell, ContactState, GrainState, Masses};
use gshear_dem::step::{StepRequest, advance, forces, initial_forces};
use gshear_dem::system::{ListSettings, Setup, System};

/// Grains on one rank, with a law, and with or without walls.
pub struct Rig<C: ContactLaw, D = NoWalls> {
    pub system: System<C::Space>,
    pub drive: D,
    law: C,
    samples: ContactForces,
}

/// A contact as the program reports it: F_n, F_t (N/m), δ (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    pub normal: f64,
    pub tangential: f64,
    pub overlap: f64,
}

/// Position and velocities of a grain, at the full step and at the half step before it.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    pub position: [f64; 2],
    pub velocity: [f64; 2],
    pub half_velocity: [f64; 2],
    pub spin: f64,
}

/// Parameters of the cell, the grains and the list.
#[derive(Debug, Clone, Copy)]
pub struct Setting {
    /// L_x, in 3D L_y as well (m).
    pub length: f64,
    /// ρ (kg/m³).
    pub density: f64,
    /// Δt (s).
    pub step: f64,
    /// Skin of the list over the mean diameter; `None` adapts it.
    pub skin: Option<f64>,
}

impl<C: ContactLaw + Stiffness> Rig<C> {
    /// Grains without walls, with their initial forces.
    ///
    /// # Errors
    /// Forces that fail.
    pub fn free(
        law: C,
        setting: Setting,
        grains: Vec<GrainState>,
        contacts: Vec<ContactState>,
    ) -> Result<Self> {
        Self::new(law, NoWalls, setting, grains, contacts)
    }
}

impl<C: ContactLaw + Stiffness, D: Drive<C::Space>> Rig<C, D> {
    pub fn new(
        law: C,
        mut drive: D,
        setting: Setting,
        grains: Vec<GrainState>,
        contacts: Vec<ContactState>,
    ) -> Result<Self> {
        let radii = grains.iter().map(|g| g.radius);
        let mean = radii.clone().sum::<f64>() / grains.len() as f64;
        let list = ListSettings {
            skin: setting.skin,
            rebuild_every: 0,
        };
        let setup = Setup {
            list,
            mean_diameter: 2.0 * mean,
            ..Setup::new(
                Cell::between_walls([setting.length; 2]),
                radii.fold(0.0, f64::max),
                Masses::Density(setting.density),
                setting.step,
            )
        };
        let mut system = System::new(&Solo, setup)?;
        system.replace(&Solo, &law, &mut drive, grains, contacts)?;
        let mut samples = ContactForces::default();
        initial_forces(&Solo, &mut system, &law, &mut drive, Some(&mut samples))?;
        Ok(Self {
            system,
            drive,
            law,
            samples,
        })
    }

    pub fn advance(&mut self) -> Result<()> {
        let (system, drive) = (&mut self.system, &mut self.drive);
        advance(&Solo, system, &self.law, drive, StepRequest::default()).map(|_| ())
    }

    pub fn grains(&mut self) -> Vec<GrainState> {
        self.system.grain_states()
    }

    /// The touching contacts, in order.
    pub fn contacts(&self) -> Vec<ContactState> {
        self.system.contact_states(&self.law)
    }
}

impl<C: ContactLaw<Space = Two> + Stiffness, D: Drive<Two>> Rig<C, D> {
    /// Moves the grain of this id, before [`Rig::pass`].
    pub fn place(&mut self, id: u32, place: Place) {
        let grains = self.system.grains_mut();
        let grain = grains.id.iter().position(|of| *of == id).expect("a grain");
        let r = grains.fields_mut(grain);
        let mut put = |at: usize, values: &[f64]| r[at..at + values.len()].copy_from_slice(values);
        put(Two::POSITION, &place.position);
        put(Two::VELOCITY, &place.velocity);
        put(Two::HALF_VELOCITY, &place.half_velocity);
        put(Two::SPIN, &[place.spin]);
        put(Two::HALF_SPIN, &[place.spin]);
    }

    /// Computes the forces at the present positions and advances the histories by `step` (s).
    /// Returns what is outside the law.
    pub fn pass(&mut self, step: f64) -> Result<(), Outside> {
        let (system, drive) = (&mut self.system, &mut self.drive);
        let outside = forces(
            &Solo,
            system,
            &self.law,
            drive,
            step,
            Some(&mut self.samples),
        );
        outside.map_or(Ok(()), Err)
    }

    /// The touching contacts at the last pass, in order.
    pub fn samples(&self) -> Vec<Sample> {
        let at = self.system.contacts.touching();
        at.map(|at| Sample {
            normal: self.samples.normal[at.block].0[at.lane],
            tangential: self.samples.tangential[at.block][0].0[at.lane],
            overlap: self.samples.overlap[at.block].0[at.lane],
        })
        .collect()
    }
}
