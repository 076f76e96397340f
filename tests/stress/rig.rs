//! How the stress tests hold a few grains: all that they know of the program's inside is here.

use gshear::config::Bookkeeping;
use gshear::contact::ContactLaw;
use gshear::domain::Solo;
use gshear::drive::{Drive, NoWalls};
use gshear::failure::Failure;
use gshear::kernel::ContactForces;
use gshear::simd::Level;
use gshear::state::{ContactState, GrainState, field};
use gshear::step::{Outside, advance, forces, initial_forces};
use gshear::system::System;

/// Some grains under a law and between walls, or without any, on one rank.
pub struct Rig<C, D = NoWalls> {
    pub system: System,
    pub drive: D,
    law: C,
    samples: ContactForces,
}

/// What a contact does, as the program reports it: F_n, F_t (N/m), δ (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    pub normal: f64,
    pub tangential: f64,
    pub overlap: f64,
}

/// Where a grain is and how it moves, at the full step and at the half step before it.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    pub position: [f64; 2],
    pub velocity: [f64; 2],
    pub half_velocity: [f64; 2],
    pub spin: f64,
}

/// What the box and the grains are made of.
#[derive(Debug, Clone, Copy)]
pub struct Setting {
    /// L_x (m).
    pub length: f64,
    /// ρ (kg/m³).
    pub density: f64,
    /// Δt (s).
    pub step: f64,
    /// Of the list, over the mean diameter; `None` adapts it.
    pub skin: Option<f64>,
}

impl<C: ContactLaw> Rig<C> {
    /// Without walls, forces computed; or why they cannot be.
    pub fn free(
        law: C,
        setting: Setting,
        grains: Vec<GrainState>,
        contacts: Vec<ContactState>,
    ) -> Result<Self, Failure> {
        Self::new(law, NoWalls::default(), setting, grains, contacts)
    }
}

impl<C: ContactLaw, D: Drive> Rig<C, D> {
    pub fn new(
        law: C,
        mut drive: D,
        setting: Setting,
        grains: Vec<GrainState>,
        contacts: Vec<ContactState>,
    ) -> Result<Self, Failure> {
        let radii = grains.iter().map(|g| g.radius);
        let mean = radii.clone().sum::<f64>() / grains.len() as f64;
        let bookkeeping = Bookkeeping {
            skin: setting.skin,
            rebuild_every: 0,
            simd: "auto",
        };
        let mut system = System::new(
            &Solo,
            Level::detect(),
            &bookkeeping,
            setting.length,
            [radii.fold(0.0, f64::max), mean],
            setting.density,
            setting.step,
            1.0,
            1,
        )?;
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

    pub fn advance(&mut self) -> Result<(), Failure> {
        let (system, drive) = (&mut self.system, &mut self.drive);
        advance(&Solo, system, &self.law, drive, false, None).map(|_| ())
    }

    pub fn grains(&self) -> Vec<GrainState> {
        self.system.grain_states()
    }

    /// The touching contacts, in order.
    pub fn contacts(&self) -> Vec<ContactState> {
        self.system.contact_states::<C>()
    }

    /// Puts a grain somewhere, for [`Rig::pass`].
    pub fn place(&mut self, grain: usize, place: Place) {
        let r = &mut self.system.grains.record[grain].0;
        [r[field::X], r[field::Y]] = place.position;
        [r[field::U], r[field::V]] = place.velocity;
        [r[field::HALF_U], r[field::HALF_V]] = place.half_velocity;
        r[field::W] = place.spin;
        r[field::HALF_W] = place.spin;
    }

    /// The forces where the grains are; histories advance by `step` (s). Or what is outside the law.
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
            tangential: self.samples.tangential[at.block].0[at.lane],
            overlap: self.samples.overlap[at.block].0[at.lane],
        })
        .collect()
    }
}
