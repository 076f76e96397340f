//! A contact law outside the kernel: chosen at run time, with one virtual call for many contacts.

use std::fmt::Debug;

use super::stiffness::Stiffness;
use super::{AGE, ContactLaw, PairRadii};
use crate::dimension::Dimension;
use crate::simd::{Isa, Lanes, Lanes16, Work};

/// Properties of a contact law other than its forces. Implemented for every [`ContactLaw`].
///
/// A block of sixteen pairs has a [`Lanes16`] for each of the parameters and of the histories of
/// [`PairModel::layout`].
pub trait PairModel: Stiffness + Debug + Send + Sync {
    /// What it keeps of a pair.
    fn layout(&self) -> Layout;

    /// The kind of a pair of grains of these materials; a block has pairs of one kind.
    fn kind(&self, _materials: [u64; 2]) -> u16 {
        0
    }

    /// Computes the parameters of all blocks from their R_i + R_j and R_i (m), and their kinds.
    /// Lanes that fill up a block have negative sums.
    fn set_parameters(
        &self,
        isa: Isa,
        geometry: &[[Lanes16; 2]],
        kinds: &[u16],
        out: &mut [Lanes16],
    );

    /// The largest F_n (N; N/m in 2D) of two grains of this radius (m) within the law.
    fn largest_normal_force(&self, radius: f64) -> f64;

    /// The greatest gap (m) of contacts of grains up to this radius (m).
    fn largest_gap(&self, radius: f64) -> f64 {
        self.gap([0; 2], [radius; 2])
    }

    /// Elastic energies (J; J/m in 2D) of the contacts of all blocks: normal, tangential, rolling.
    /// Arbitrary for lanes that do not touch.
    fn energies(&self, isa: Isa, blocks: &Elastic<'_>, out: &mut [[Lanes16; 3]]);
}

/// What a contact law keeps of a pair.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// Whether forces other than F_n can arise.
    pub has_friction: bool,
    /// Whether it has the torques of spheres that resist rolling or twisting.
    pub has_torques: bool,
    /// Number of quantities per pair that depend on the two grains alone.
    pub parameters: usize,
    /// For each quantity that a contact keeps from step to step, its place in a
    /// [`History`](super::History).
    pub history: &'static [usize],
    /// Unit in 3D of the history of F_t, as the units module of H5MD writes it.
    pub history_unit: &'static str,
}

impl Layout {
    /// Whether contacts keep their age.
    pub fn has_age(&self) -> bool {
        self.history.contains(&AGE)
    }
}

/// What the elastic energies of some blocks depend on.
#[derive(Debug, Clone, Copy)]
pub struct Elastic<'a> {
    /// R_i + R_j and R_i (m).
    pub geometry: &'a [[Lanes16; 2]],
    /// [`PairModel::kind`] of each.
    pub kinds: &'a [u16],
    /// [`Layout::parameters`] per block.
    pub parameters: &'a [Lanes16],
    /// [`Layout::history`] per block.
    pub history: &'a [Lanes16],
    /// δ (m).
    pub overlap: &'a [Lanes16],
}

impl<C: ContactLaw + Stiffness> PairModel for C {
    fn layout(&self) -> Layout {
        Layout {
            has_friction: C::FRICTION,
            has_torques: C::ROLLING && C::Space::SPINS == 3,
            parameters: C::PARAMETERS,
            history: &C::HISTORY_PLACES[..C::HISTORY],
            history_unit: C::HISTORY_UNIT,
        }
    }

    fn set_parameters(&self, isa: Isa, geometry: &[[Lanes16; 2]], _: &[u16], out: &mut [Lanes16]) {
        isa.run(Parameters {
            law: self,
            geometry,
            out,
        });
    }

    fn largest_normal_force(&self, radius: f64) -> f64 {
        self.largest_force(radius)
    }

    fn energies(&self, isa: Isa, blocks: &Elastic<'_>, out: &mut [[Lanes16; 3]]) {
        isa.run(Energies {
            law: self,
            blocks,
            out,
        });
    }
}

/// The radius of a flat wall over that of the grain: 1/R_j is below the rounding of 1/R_i.
pub const WALL: f64 = 1e18;

struct Parameters<'a, C> {
    law: &'a C,
    geometry: &'a [[Lanes16; 2]],
    out: &'a mut [Lanes16],
}

impl<C: ContactLaw> Work for Parameters<'_, C> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, token: L::Token) {
        let blocks = self.out.chunks_exact_mut(C::PARAMETERS.max(1));
        for (geometry, out) in self.geometry.iter().zip(blocks) {
            let mut radii = PairRadii::<L>::load(token, geometry);
            // It is negative in lanes that fill up a block.
            radii.sum = radii.sum.abs();
            let wall = L::splat(token, WALL) * radii.first;
            let r_j = (radii.sum - radii.first).select(radii.is_curved(), wall);
            self.law.parameters(token, radii.first, r_j, out);
        }
    }
}

struct Energies<'a, C> {
    law: &'a C,
    blocks: &'a Elastic<'a>,
    out: &'a mut [[Lanes16; 3]],
}

impl<C: ContactLaw> Work for Energies<'_, C> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, token: L::Token) {
        let elastic = self.blocks;
        for (block, out) in self.out.iter_mut().enumerate() {
            let parameters = &elastic.parameters[block * C::PARAMETERS..][..C::PARAMETERS];
            let history = &elastic.history[block * C::HISTORY..][..C::HISTORY];
            let overlap = L::load(token, &elastic.overlap[block]);
            let energies = self
                .law
                .elastic_energies(token, parameters, overlap, history);
            for (lanes, energy) in out.iter_mut().zip(energies) {
                energy.store(lanes);
            }
        }
    }
}
