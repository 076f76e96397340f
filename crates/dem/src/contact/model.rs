//! A contact law outside the kernel: chosen at run time, with one virtual call for many contacts.

use std::fmt::Debug;

use super::ContactLaw;
use super::stiffness::Stiffness;
use crate::simd::{Lanes, Level, Row, Work};

/// Properties of a contact law other than its forces. Implemented for every [`ContactLaw`].
///
/// A row holds sixteen pairs. A block of sixteen pairs has [`PairModel::parameter_rows`] rows of
/// parameters and [`PairModel::history_rows`] rows of histories.
pub trait PairModel: Stiffness + Debug + Send + Sync {
    /// Whether forces other than F_n can arise.
    fn has_friction(&self) -> bool;

    /// Number of rows per block that depend on the two grains alone.
    fn parameter_rows(&self) -> usize;

    /// Number of rows per block that a contact keeps from step to step.
    fn history_rows(&self) -> usize;

    /// Computes the parameters of all blocks from their R_i + R_j and R_i (m). Lanes that fill up a
    /// block have negative sums.
    fn set_parameters(&self, level: Level, geometry: &[[Row; 2]], out: &mut [Row]);

    /// The largest F_n (N; N/m in 2D) of two grains of this radius (m) within the law.
    fn largest_normal_force(&self, radius: f64) -> f64;

    /// Converts the history rows of a contact to the layout of [`crate::state::ContactState`].
    fn to_state(&self, history: [f64; 3]) -> [f64; 3];

    /// The reverse of [`PairModel::to_state`].
    #[expect(
        clippy::wrong_self_convention,
        reason = "depends on the law, and `to_state` is its reverse"
    )]
    fn from_state(&self, state: [f64; 3]) -> [f64; 3];

    /// Elastic energies (J; J/m in 2D) of the contacts of all blocks: normal, tangential, rolling.
    /// Arbitrary for lanes that do not touch. `overlap`: δ (m).
    fn energies(
        &self,
        level: Level,
        parameters: &[Row],
        history: &[Row],
        overlap: &[Row],
        out: &mut [[Row; 3]],
    );
}

impl<C: ContactLaw + Stiffness> PairModel for C {
    fn has_friction(&self) -> bool {
        C::FRICTION
    }

    fn parameter_rows(&self) -> usize {
        C::PARAMETERS
    }

    fn history_rows(&self) -> usize {
        C::HISTORY
    }

    fn set_parameters(&self, level: Level, geometry: &[[Row; 2]], out: &mut [Row]) {
        level.run(Parameters {
            law: self,
            geometry,
            out,
        });
    }

    fn largest_normal_force(&self, radius: f64) -> f64 {
        self.largest_force(radius)
    }

    fn to_state(&self, history: [f64; 3]) -> [f64; 3] {
        C::history_to_state(history)
    }

    fn from_state(&self, state: [f64; 3]) -> [f64; 3] {
        C::history_from_state(state)
    }

    fn energies(
        &self,
        level: Level,
        parameters: &[Row],
        history: &[Row],
        overlap: &[Row],
        out: &mut [[Row; 3]],
    ) {
        level.run(Energies {
            law: self,
            parameters,
            history,
            overlap,
            out,
        });
    }
}

struct Parameters<'a, C> {
    law: &'a C,
    geometry: &'a [[Row; 2]],
    out: &'a mut [Row],
}

impl<C: ContactLaw> Work for Parameters<'_, C> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, token: L::Token) {
        let blocks = self.out.chunks_exact_mut(C::PARAMETERS);
        for ([sum, r_i], out) in self.geometry.iter().zip(blocks) {
            // The sum is negative in lanes that fill up a block.
            let (sum, r_i) = (L::load(token, sum).abs(), L::load(token, r_i));
            self.law.parameters(token, r_i, sum - r_i, out);
        }
    }
}

struct Energies<'a, C> {
    law: &'a C,
    parameters: &'a [Row],
    history: &'a [Row],
    overlap: &'a [Row],
    out: &'a mut [[Row; 3]],
}

impl<C: ContactLaw> Work for Energies<'_, C> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, token: L::Token) {
        for (block, out) in self.out.iter_mut().enumerate() {
            let parameters = &self.parameters[block * C::PARAMETERS..][..C::PARAMETERS];
            let history = &self.history[block * C::HISTORY..][..C::HISTORY];
            let overlap = L::load(token, &self.overlap[block]);
            let energies = self
                .law
                .elastic_energies(token, parameters, overlap, history);
            for (row, energy) in out.iter_mut().zip(energies) {
                energy.store(row);
            }
        }
    }
}
