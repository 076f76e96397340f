//! Grains of several materials: a law for each ordered pair of them.
//!
//! The list keeps pairs of one kind in blocks of their own, so that each law works on its own
//! blocks as if there were no other.

use super::{Contact, Law, LawSpace};
use crate::contact::model::{Elastic, Layout, PairModel};
use crate::contact::stiffness::{Derivatives, SpringState, Stiffness};
use crate::dimension::Dimension;
use crate::kernel::{PairForce, Pass, PassOutcome, Scratch};
use crate::simd::{Isa, Lanes16};

/// The forces between grains of n materials from the n² laws of ordered pairs, that of i and j at i
/// n + j; `None` if one of them has none in this dimension. One law is that of all pairs.
pub fn pair_force<D: LawSpace>(laws: &[(Law, Contact)]) -> Option<Box<dyn PairForce<D>>> {
    let force = |of: &(Law, Contact)| D::pair_force(&of.0, &beside(of.1, laws));
    match laws {
        [of_all] => force(of_all),
        _ => Some(Box::new(Mixture {
            materials: laws.len().isqrt(),
            laws: laws.iter().map(force).collect::<Option<_>>()?,
        })),
    }
}

/// A coefficient whose forces are rounded to 0. All laws of a mixture keep the same histories, so
/// pairs without friction have this one where others have friction.
const NEXT_TO_NOTHING: f64 = 1e-100;

/// The contacts of a pair, compiled as those of all pairs need.
fn beside(mut contact: Contact, laws: &[(Law, Contact)]) -> Contact {
    let any = |of: fn(&Contact) -> f64| laws.iter().any(|(_, contact)| of(contact) > 0.0);
    for (coefficient, needed) in [
        (&mut contact.friction, any(|c| c.friction)),
        (&mut contact.rolling_friction, any(|c| c.rolling_friction)),
        (&mut contact.twisting_friction, any(|c| c.twisting_friction)),
    ] {
        if needed {
            *coefficient = coefficient.max(NEXT_TO_NOTHING);
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
    fn of(&self, materials: [u64; 2]) -> &dyn PairForce<D> {
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
        self.of(state.materials).derivatives(state)
    }

    fn idle_derivatives(&self, state: &SpringState) -> Option<Derivatives> {
        self.of(state.materials).idle_derivatives(state)
    }

    fn gap(&self, materials: [u64; 2], radii: [f64; 2]) -> f64 {
        self.of(materials).gap(materials, radii)
    }
}

impl<D: Dimension> PairModel for Mixture<D> {
    /// All have the same.
    fn layout(&self) -> Layout {
        self.laws[0].layout()
    }

    fn kind(&self, [i, j]: [u64; 2]) -> u16 {
        (i as usize * self.materials + j as usize) as u16
    }

    fn set_parameters(
        &self,
        isa: Isa,
        (mut geometry, kinds): (&[[Lanes16; 2]], &[u16]),
        mut out: &mut [Lanes16],
    ) {
        let parameters = self.layout().parameters;
        for (kind, blocks) in runs(kinds) {
            let (of_kind, others) = geometry.split_at(blocks);
            let (to, rest) = out.split_at_mut(blocks * parameters);
            self.laws[kind].set_parameters(isa, (of_kind, &[]), to);
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
            let of = |per_block: usize| first * per_block..(first + length) * per_block;
            let (to, rest) = out.split_at_mut(length);
            let of_kind = Elastic {
                geometry: &blocks.geometry[of(1)],
                kinds: &blocks.kinds[of(1)],
                parameters: &blocks.parameters[of(layout.parameters)],
                history: &blocks.history[of(layout.history.len())],
                overlap: &blocks.overlap[of(1)],
            };
            self.laws[kind].energies(isa, &of_kind, to);
            (first, out) = (first + length, rest);
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
            let of_kind = Pass {
                input: pass.input,
                record: pass.record,
                force: &mut *pass.force,
                part: std::mem::replace(&mut pass.part, rest),
                samples: std::mem::replace(&mut pass.samples, rest_of_samples),
            };
            outcome = outcome.merge(self.laws[kind].pass(of_kind, scratch));
        }
        outcome
    }
}
