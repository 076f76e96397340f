//! What is measured of a packing in a box: sums over all contacts in one order, so that they do not depend on the ranks.

use bytemuck::{Pod, Zeroable};

use crate::contact::ContactLaw;
use crate::dimension::Dimension;
use crate::domain::Exchange;
use crate::drive::NoWalls;
use crate::io::collective::gathered;
use crate::kernel::ContactForces;
use crate::simd::{Lanes, Portable, PortableToken, Row};
use crate::state::length;
use crate::step::forces;
use crate::system::System;

/// Sums over the contacts of a packing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Observed {
    /// σ_xz (σ_xy in 2D): -(1/V) Σ r^x F^z over the contacts (BO section IV).
    pub shear_stress: f64,
    /// A D-th of the trace of (1/V) Σ r F.
    pub pressure: f64,
    /// Of normal and tangential springs.
    pub elastic_energy: f64,
    pub contacts: u64,
    pub coordination: f64,
    /// Contacts at the Coulomb limit over all.
    pub sliding_fraction: f64,
}

/// One contact's part in the sums.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Share {
    i: u32,
    j: u32,
    /// r^x F^z and r·F.
    shear: f64,
    pressure: f64,
    energy: f64,
    sliding: f64,
}

/// Of the system as it is, at rest or not. Collective.
pub(super) fn observe<C: ContactLaw, E: Exchange>(
    exchange: &E,
    system: &mut System<C::Space>,
    law: &C,
    samples: &mut ContactForces,
    grains: u32,
) -> Observed {
    // What the grains feel and the contacts remember is put back: a pass without a step, too, projects histories anew on their planes,
    // which changes their last bits.
    let felt = system.grains.force.clone();
    let remembered = system.contacts.history.clone();
    let outside = forces(
        exchange,
        system,
        law,
        &mut NoWalls,
        0.0,
        Some(&mut *samples),
    );
    debug_assert!(outside.is_none());
    system.grains.force = felt;
    system.contacts.history = remembered;
    let shares = shares::<C>(system, law, samples);
    let all = gathered(exchange, &shares, |c| (c.i, c.j));
    let sum = |of: fn(&Share) -> f64| all.iter().map(of).sum::<f64>();
    let height = system.cell.sheared.map_or(f64::NAN, |s| s.height);
    let base: f64 = system.cell.periods[..C::Space::UP].iter().product();
    let volume = base * height;
    let count = all.len() as f64;
    Observed {
        shear_stress: -sum(|c| c.shear) / volume,
        pressure: sum(|c| c.pressure) / (C::Space::AXES as f64 * volume),
        elastic_energy: sum(|c| c.energy),
        contacts: all.len() as u64,
        coordination: 2.0 * count / f64::from(grains),
        sliding_fraction: if all.is_empty() {
            0.0
        } else {
            sum(|c| c.sliding) / count
        },
    }
}

/// Of the contacts whose first grain is this rank's.
fn shares<C: ContactLaw>(
    system: &System<C::Space>,
    law: &C,
    samples: &ContactForces,
) -> Vec<Share> {
    let (grains, contacts) = (&system.grains, &system.contacts);
    let (axes, up) = (C::Space::AXES, C::Space::UP);
    let of_block = |block: usize| -> [Row; 3] {
        let rows = |per_block: usize| block * per_block..(block + 1) * per_block;
        let energies = law.elastic_energies::<Portable>(
            PortableToken,
            &contacts.parameters[rows(C::PARAMETERS)],
            Portable::load(PortableToken, &samples.overlap[block]),
            &contacts.history[rows(C::HISTORY)],
        );
        energies.map(|energy| energy.to_row())
    };
    let mut energies = (usize::MAX, [Row::ZERO; 3]);
    let own = contacts.touching().filter(|at| at.i < grains.owned);
    own.map(|at| {
        if energies.0 != at.block {
            energies = (at.block, of_block(at.block));
        }
        let r = system
            .cell
            .separation::<C::Space>(grains.fields(at.i), grains.fields(at.j));
        let per_length = 1.0 / length(r);
        let normal = samples.normal[at.block].0[at.lane];
        let tangential = samples.tangential[at.block].map(|row| row.0[at.lane]);
        let across = match axes {
            // Along t̂ = ẑ × n.
            2 => [
                -r[1] * per_length * tangential[0],
                r[0] * per_length * tangential[0],
                0.0,
            ],
            _ => tangential,
        };
        let mut force = [0.0; 3];
        for axis in 0..axes {
            force[axis] = normal * r[axis] * per_length;
            if C::FRICTION {
                force[axis] += across[axis];
            }
        }
        let energy = |k: usize| energies.1[k].0[at.lane];
        Share {
            i: grains.id[at.i],
            j: grains.id[at.j],
            shear: r[0] * force[up],
            pressure: (0..axes).map(|axis| r[axis] * force[axis]).sum(),
            energy: energy(0) + if C::FRICTION { energy(1) } else { 0.0 },
            sliding: f64::from(samples.sliding[at.block] >> at.lane & 1),
        }
    })
    .collect()
}
