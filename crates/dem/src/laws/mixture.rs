//! Grains of several materials: a law for each ordered pair of them.
//!
//! The list keeps pairs of one kind in blocks of their own, on which their law works alone.

use super::{Contact, Law, LawSpace};
use crate::contact::model::{Elastic, Layout, PairModel};
use crate::contact::stiffness::{Derivatives, SpringState, Stiffness};
use crate::dimension::Dimension;
use crate::kernel::{PairForce, Pass, PassOutcome, Scratch};
use crate::simd::{Isa, Lanes16};

/// The forces between grains of n materials from the n² laws of ordered pairs, that of i and j at i
/// n + j; `None` if one of them has none in this dimension. One law is that of all pairs.
pub fn pair_force<D: LawSpace>(laws: &[(Law, Contact)]) -> Option<Box<dyn PairForce<D>>> {
    let mut forces = Vec::new();
    for (law, contact) in laws {
        forces.push(D::pair_force(law, &beside(contact, laws))?);
    }
    if forces.len() == 1 {
        return forces.pop();
    }
    Some(Box::new(Mixture {
        materials: laws.len().isqrt(),
        laws: forces,
    }))
}

/// A coefficient of friction whose forces are rounded to 0. All laws of a mixture keep the same
/// histories, so pairs without friction have this one where others have friction.
const LEAST_COEFFICIENT: f64 = 1e-100;

/// The contacts of a pair, compiled as those of all pairs need.
fn beside(contact: &Contact, laws: &[(Law, Contact)]) -> Contact {
    let mut contact = contact.clone();
    for (_, other) in laws {
        for (coefficient, others) in [
            (&mut contact.friction, other.friction),
            (&mut contact.rolling_friction, other.rolling_friction),
            (&mut contact.twisting_friction, other.twisting_friction),
        ] {
            if others > 0.0 {
                *coefficient = coefficient.max(LEAST_COEFFICIENT);
            }
        }
    }
    contact
}

/// The laws of all ordered pairs of materials.
#[derive(Debug)]
struct Mixture<D: Dimension> {
    materials: usize,
    laws: Vec<Box<dyn PairForce<D>>>,
}

impl<D: Dimension> Mixture<D> {
    /// The law of two materials.
    fn law(&self, materials: [u64; 2]) -> &dyn PairForce<D> {
        self.laws[usize::from(self.kind(materials))].as_ref()
    }
}

/// The lengths of the runs of one kind.
fn runs(kinds: &[u16]) -> impl Iterator<Item = (usize, usize)> {
    kinds
        .chunk_by(|a, b| a == b)
        .map(|run| (usize::from(run[0]), run.len()))
}

impl<D: Dimension> Stiffness for Mixture<D> {
    fn derivatives(&self, state: &SpringState) -> Derivatives {
        self.law(state.materials).derivatives(state)
    }

    fn dampers(&self, state: &SpringState) -> Derivatives {
        self.law(state.materials).dampers(state)
    }

    fn idle_derivatives(&self, state: &SpringState) -> Option<Derivatives> {
        self.law(state.materials).idle_derivatives(state)
    }

    fn gap(&self, materials: [u64; 2], radii: [f64; 2]) -> f64 {
        self.law(materials).gap(materials, radii)
    }
}

impl<D: Dimension> PairModel for Mixture<D> {
    /// All have the same.
    fn layout(&self) -> Layout {
        self.laws[0].layout()
    }

    fn kind(&self, materials: [u64; 2]) -> u16 {
        (materials[0] as usize * self.materials + materials[1] as usize) as u16
    }

    fn set_parameters(
        &self,
        isa: Isa,
        mut geometry: &[[Lanes16; 2]],
        kinds: &[u16],
        mut out: &mut [Lanes16],
    ) {
        let parameters = self.layout().parameters;
        for (kind, blocks) in runs(kinds) {
            let (equal, others) = geometry.split_at(blocks);
            let (to, rest) = out.split_at_mut(blocks * parameters);
            self.laws[kind].set_parameters(isa, equal, &[], to);
            (geometry, out) = (others, rest);
        }
    }

    fn largest_normal_force(&self, radius: f64) -> f64 {
        let forces = self.laws.iter().map(|law| law.largest_normal_force(radius));
        forces.fold(0.0, f64::max)
    }

    fn largest_gap(&self, radius: f64) -> f64 {
        let gaps = self.laws.iter().map(|law| law.largest_gap(radius));
        gaps.fold(0.0, f64::max)
    }

    fn energies(&self, isa: Isa, blocks: &Elastic<'_>, mut out: &mut [[Lanes16; 3]]) {
        let (mut first, layout) = (0, self.layout());
        for (kind, length) in runs(&blocks.kinds[..out.len()]) {
            let end = first + length;
            let (parameters, history) = (layout.parameters, layout.history.len());
            let (to, rest) = out.split_at_mut(length);
            let run = Elastic {
                geometry: &blocks.geometry[first..end],
                kinds: &blocks.kinds[first..end],
                parameters: &blocks.parameters[first * parameters..end * parameters],
                history: &blocks.history[first * history..end * history],
                overlap: &blocks.overlap[first..end],
            };
            self.laws[kind].energies(isa, &run, to);
            (first, out) = (end, rest);
        }
    }
}

impl<D: Dimension> PairForce<D> for Mixture<D> {
    fn pass(&self, mut pass: Pass<'_, D>, scratch: &mut Scratch<D>) -> PassOutcome {
        let mut outcome = PassOutcome::default();
        for (kind, blocks) in runs(pass.part.kinds) {
            let until = pass.part.first + blocks;
            let rest = pass.part.split_off(until);
            let rest_of_samples = pass.samples.as_mut().map(|s| s.split_off(blocks));
            let part = std::mem::replace(&mut pass.part, rest);
            let samples = std::mem::replace(&mut pass.samples, rest_of_samples);
            let run = Pass::new(pass.input, pass.record, &mut *pass.force, part).sampled(samples);
            outcome = outcome.merge(self.laws[kind].pass(run, scratch));
        }
        outcome
    }
}
