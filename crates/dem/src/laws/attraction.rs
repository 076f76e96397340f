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
//!
//! With `contact.adhesion = "jkr"` a Hertzian contact of the radius a has (K. L. Johnson,
//! K. Kendall and A. D. Roberts, Proc. R. Soc. London A 324, 301, 1971; LAMMPS' `jkr`)
//!
//! ```text
//! δ = a²/R* - 2√(πγa/E*)
//! F_n = F_n' - F_a,   F_a = 4√(πγE* a³),   F_n' = 4E*a³/(3R*)
//! ```
//!
//! without dampers. F_n', F_t and dampers are the law's at the overlap a²/R*, of the same a. Pairs
//! touch at δ = 0, where F_n is -8/9 of the pull-off force 3πγR*, and stay in contact until -F_n
//! reaches it, at δ = -a_c²/(3R*), a_c³ = 9πγR*²/(4E*). The limits are again those of F_n', the
//! load under which Hertz' contact has the same area; LAMMPS takes |F_n + 6πγR*|, which is the same
//! at pull-off and less before. The potential energy is ∫F_n dδ from the touch. What is left of it
//! at the pull-off, 0.961 πγ a_c², is lost: it counts in `dissipated_stiffness`, the energies of
//! the springs in those of their limits. All forces jump, and are scaled in these two steps.

use crate::contact::attraction::{Attraction, reduced_radius};
use crate::contact::jkr::Jkr;
use crate::contact::model::{Elastic, Layout, PairModel};
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

/// With JKR adhesion of the law at the overlap of Hertz' contact, by δ.
impl<D: Dimension> Stiffness for Attracting<D> {
    fn derivatives(&self, state: &SpringState) -> Derivatives {
        let contact = self.attraction.contact(state.radii, state.overlap);
        let mut d = self.law.derivatives(&SpringState {
            overlap: contact.hertzian,
            ..*state
        });
        for force in [&mut d.tangential, &mut d.rolling, &mut d.twisting] {
            force.slope = force.slope.map(|slope| slope * contact.slope);
        }
        d.normal -= contact.pull;
        d.normal_slope = d.normal_slope * contact.slope - contact.pull_slope;
        d
    }

    fn idle_derivatives(&self, state: &SpringState) -> Option<Derivatives> {
        let contact = self.attraction.contact(state.radii, state.overlap);
        Some(Derivatives {
            normal: -contact.pull,
            normal_slope: -contact.pull_slope,
            ..Derivatives::default()
        })
    }

    fn gap(&self, _: [u64; 2], radii: [f64; 2]) -> f64 {
        self.attraction.greatest_gap(radii)
    }
}

impl<D: Dimension> PairModel for Attracting<D> {
    fn layout(&self) -> Layout {
        self.law.layout()
    }

    fn set_parameters(&self, isa: Isa, of: (&[[Lanes16; 2]], &[u16]), out: &mut [Lanes16]) {
        self.law.set_parameters(isa, of, out);
    }

    fn largest_normal_force(&self, radius: f64) -> f64 {
        let elastic = self.law.largest_normal_force(radius);
        elastic + self.attraction.under(elastic, [radius; 2])
    }

    fn energies(&self, isa: Isa, blocks: &Elastic<'_>, out: &mut [[Lanes16; 3]]) {
        let mut hertzian = blocks.overlap.to_vec();
        if let Some(jkr) = self.attraction.jkr {
            let geometry = blocks.geometry;
            isa.run(Hertzian {
                jkr,
                geometry,
                overlap: &mut hertzian,
            });
        }
        let of_law = Elastic {
            overlap: &hertzian,
            ..*blocks
        };
        self.law.energies(isa, &of_law, out);
        isa.run(Potential {
            attraction: self.attraction,
            blocks,
            hertzian: &hertzian,
            out,
        });
    }
}

impl<D: Dimension> PairForce<D> for Attracting<D> {
    fn pass(&self, mut pass: Pass<'_, D>, scratch: &mut Scratch<D>) -> PassOutcome {
        pass.input.attraction = Some(self.attraction);
        self.law.pass(pass, scratch)
    }
}

/// Replaces the overlaps of contacts by those of Hertz' contacts of the same radii.
struct Hertzian<'a> {
    jkr: Jkr,
    geometry: &'a [[Lanes16; 2]],
    overlap: &'a mut [Lanes16],
}

impl Work for Hertzian<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, token: L::Token) {
        let load = |lanes: &Lanes16| L::load(token, lanes);
        for ([sum, r_i], overlap) in self.geometry.iter().zip(self.overlap) {
            let reduced = reduced_radius([load(sum), load(r_i)]);
            let depth = self.jkr.depth(token, reduced);
            let hertzian = self.jkr.hertzian(token, depth, load(overlap));
            hertzian.store(overlap);
        }
    }
}

/// Adds the potential of the attraction to the normal energies.
struct Potential<'a> {
    attraction: Attraction,
    blocks: &'a Elastic<'a>,
    hertzian: &'a [Lanes16],
    out: &'a mut [[Lanes16; 3]],
}

impl Work for Potential<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, token: L::Token) {
        let load = |lanes: &Lanes16| L::load(token, lanes);
        let attraction = self.attraction;
        let overlaps = self.blocks.overlap.iter().zip(self.hertzian);
        let blocks = self.blocks.geometry.iter().zip(overlaps);
        for (([sum, r_i], (overlap, hertzian)), out) in blocks.zip(self.out) {
            let overlaps = [load(overlap), load(hertzian)];
            let radii = [load(sum), load(r_i)];
            let energy = load(&out[0]);
            let energy = attraction.potential(token, radii, overlaps, energy);
            energy.store(&mut out[0]);
        }
    }
}
