//! Attraction between touching grains, beside any law:
//!
//! ```text
//! F_n = F_n' - F_c,  δ > 0
//! ```
//!
//! with F_n' ≥ 0 of the law's spring and damper, and F_c constant, or 4πγR* between spheres of the
//! surface energy γ (B. V. Derjaguin, V. M. Muller and Y. P. Toporov, J. Colloid Interface Sci. 53,
//! 314, 1975; LAMMPS' `dmt`). The limits of friction, rolling and twisting are those of F_n', which
//! presses the grains together. The potential energy is -F_c δ.
//!
//! F_c jumps when a pair touches and when it opens. In these steps the kernel scales it by the part
//! of the step in which the pair touches, so that the scheme stays of second order.

use crate::contact::History;
use crate::contact::attraction::Attraction;
use crate::contact::model::{Elastic, PairModel};
use crate::contact::stiffness::{Derivatives, SpringState, Stiffness};
use crate::dimension::Dimension;
use crate::kernel::{PairForce, Pass, PassOutcome, Scratch};
use crate::simd::{Isa, Lanes, Lanes16, Work};

/// A law with an attraction.
#[derive(Debug)]
pub(crate) struct Attracting<D: Dimension> {
    law: Box<dyn PairForce<D>>,
    attraction: Attraction,
}

impl<D: Dimension> Attracting<D> {
    /// The law with this attraction, or as it is without one.
    pub fn beside(law: Box<dyn PairForce<D>>, attraction: Attraction) -> Box<dyn PairForce<D>> {
        if attraction == Attraction::default() {
            law
        } else {
            Box::new(Self { law, attraction })
        }
    }
}

impl<D: Dimension> Stiffness for Attracting<D> {
    fn derivatives(&self, state: &SpringState) -> Derivatives {
        let [r_i, r_j] = state.radii;
        let mut d = self.law.derivatives(state);
        d.normal -= self.attraction.between(r_i, r_j);
        d
    }

    fn idle_derivatives(&self, state: &SpringState) -> Option<Derivatives> {
        let [r_i, r_j] = state.radii;
        Some(Derivatives {
            normal: -self.attraction.between(r_i, r_j),
            ..Derivatives::default()
        })
    }
}

impl<D: Dimension> PairModel for Attracting<D> {
    fn has_friction(&self) -> bool {
        self.law.has_friction()
    }

    fn has_torques(&self) -> bool {
        self.law.has_torques()
    }

    fn parameter_lanes(&self) -> usize {
        self.law.parameter_lanes()
    }

    fn history_lanes(&self) -> usize {
        self.law.history_lanes()
    }

    fn set_parameters(&self, isa: Isa, of: (&[[Lanes16; 2]], &[u16]), out: &mut [Lanes16]) {
        self.law.set_parameters(isa, of, out);
    }

    fn largest_normal_force(&self, radius: f64) -> f64 {
        self.law.largest_normal_force(radius) + self.attraction.between(radius, radius)
    }

    fn history_unit(&self) -> &'static str {
        self.law.history_unit()
    }

    fn to_state(&self, history: History) -> History {
        self.law.to_state(history)
    }

    fn from_state(&self, state: History) -> History {
        self.law.from_state(state)
    }

    fn energies(&self, isa: Isa, blocks: &Elastic<'_>, out: &mut [[Lanes16; 3]]) {
        self.law.energies(isa, blocks, out);
        isa.run(Potential {
            attraction: self.attraction,
            blocks,
            out,
        });
    }
}

impl<D: Dimension> PairForce<D> for Attracting<D> {
    fn pass(&self, isa: Isa, mut pass: Pass<'_, D>, scratch: &mut Scratch<D>) -> PassOutcome {
        pass.attraction = Some(self.attraction);
        self.law.pass(isa, pass, scratch)
    }
}

/// Adds -F_c δ to the normal energies.
struct Potential<'a> {
    attraction: Attraction,
    blocks: &'a Elastic<'a>,
    out: &'a mut [[Lanes16; 3]],
}

impl Work for Potential<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, token: L::Token) {
        let load = |lanes: &Lanes16| L::load(token, lanes);
        let blocks = self.blocks.geometry.iter().zip(self.blocks.overlap);
        for (([sum, r_i], overlap), out) in blocks.zip(self.out) {
            let force = self.attraction.force(token, [load(sum), load(r_i)]);
            let energy = (-force).mul_add(load(overlap), load(&out[0]));
            energy.store(&mut out[0]);
        }
    }
}
