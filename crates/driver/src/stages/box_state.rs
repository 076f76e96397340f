//! Stress, pressure and elastic energy of a packing in a box. Sums over the contacts are in one
//! order, so that they do not depend on the ranks.

use bytemuck::{Pod, Zeroable};

use super::assembly::Assembly;
use gshear_dem::dimension::Dimension;
use gshear_dem::drive::NoWalls;
use gshear_dem::kernel::{ContactForces, PairForce};
use gshear_dem::simd::Lanes16;
use gshear_dem::step::forces;
use gshear_dem::system::System;
use gshear_store::collective::gathered;

/// Sums over the contacts of a packing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Observed {
    /// σ_xz (σ_xy in 2D): -(1/V) Σ r^x F^z over the contacts (BO section IV).
    pub shear_stress: f64,
    /// Trace of (1/V) Σ r F over the contacts, divided by the number of dimensions.
    pub pressure: f64,
    /// Normal stress along each axis, compression positive: (1/V) Σ r^k F^k over the contacts.
    pub normal_stress: [f64; 3],
    /// Elastic energy of all springs.
    pub elastic_energy: f64,
    pub contacts: u64,
    pub coordination: f64,
    /// Fraction of the contacts at the Coulomb limit.
    pub sliding_fraction: f64,
}

/// The terms of one contact.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct ContactTerms {
    i: u32,
    j: u32,
    /// r^x F^z and r·F.
    shear: f64,
    pressure: f64,
    /// r^k F^k.
    normal: [f64; 3],
    energy: f64,
    sliding: f64,
}

impl<D: Dimension> Assembly<'_, D> {
    /// Measures the state, at rest or not; `grains`: their number on all ranks.
    pub(super) fn observe(&mut self, grains: u32) -> Observed {
        let system = &mut self.system;
        // Forces and histories are restored afterwards, because a pass with Δt = 0 also rotates
        // histories into the tangent planes, which changes their last bits, and does not find
        // limits.
        let forces_before = system.grains().force.clone();
        let histories = system.contacts.history.clone();
        let limits = (
            system.contacts.limits.clone(),
            system.contacts.limits_are_known,
        );
        let (samples, rest) = (Some(&mut self.samples), &mut NoWalls);
        let outside = forces(self.exchange, system, self.law, rest, 0.0, samples);
        debug_assert!(outside.is_none());
        system.grains_mut().force = forces_before;
        system.contacts.history = histories;
        (system.contacts.limits, system.contacts.limits_are_known) = limits;
        let shares = shares(system, self.law, &self.samples);
        let all = gathered(self.exchange, &shares, |c| (c.i, c.j));
        let volume = volume_of_cell(system);
        let count = all.len() as f64;
        let mut normal_stress = [0.0; 3];
        for (axis, stress) in normal_stress.iter_mut().enumerate() {
            *stress = all.iter().map(|c| c.normal[axis]).sum::<f64>() / volume;
        }
        Observed {
            shear_stress: -all.iter().map(|c| c.shear).sum::<f64>() / volume,
            pressure: all.iter().map(|c| c.pressure).sum::<f64>() / (D::AXES as f64 * volume),
            normal_stress,
            elastic_energy: all.iter().map(|c| c.energy).sum(),
            contacts: all.len() as u64,
            coordination: 2.0 * count / f64::from(grains),
            sliding_fraction: if all.is_empty() {
                0.0
            } else {
                all.iter().map(|c| c.sliding).sum::<f64>() / count
            },
        }
    }
}

/// The volume of the cell (m³; area in 2D, m²).
pub(super) fn volume_of_cell<D: Dimension>(system: &System<D>) -> f64 {
    system.cell.lengths::<D>()[..D::AXES].iter().product()
}

/// Terms of the contacts whose first grain this rank owns.
fn shares<D: Dimension>(
    system: &mut System<D>,
    law: &dyn PairForce<D>,
    samples: &ContactForces,
) -> Vec<ContactTerms> {
    let (isa, cell) = (system.isa, system.cell);
    let (grains, contacts) = system.grains_and_contacts();
    let (axes, up) = (D::AXES, D::UP);
    let mut energies = vec![[Lanes16::ZERO; 3]; contacts.blocks()];
    law.energies(isa, &contacts.elastic(&samples.overlap), &mut energies);
    let owned = contacts.touching().filter(|at| at.i < grains.owned);
    let mut terms = Vec::new();
    for at in owned {
        let r = cell.separation::<D>(grains.fields(at.i), grains.fields(at.j));
        let force = samples.vector::<D>(at.block, at.lane, &r);
        let [normal, tangential, rolling] = energies[at.block].map(|lanes| lanes.0[at.lane]);
        terms.push(ContactTerms {
            i: grains.id[at.i],
            j: grains.id[at.j],
            shear: r[0] * force[up],
            pressure: (0..axes).map(|axis| r[axis] * force[axis]).sum(),
            normal: std::array::from_fn(|axis| r[axis] * force[axis]),
            energy: normal + tangential + rolling,
            sliding: f64::from(contacts.limits[at.block][0] >> at.lane & 1),
        });
    }
    terms
}
