//! Adhesion of Hertzian spheres that deforms their contact (K. L. Johnson, K. Kendall and
//! A. D. Roberts, Proc. R. Soc. London A 324, 301, 1971; LAMMPS' `jkr`): a contact of the
//! radius a has
//!
//! ```text
//! δ = a²/R* - 2√(πγa/E*)
//! F_n = F_n' - F_c,   F_c = 4√(πγE* a³),   F_n' = 4E*a³/(3R*)
//! ```
//!
//! without dampers. F_n', F_t and dampers are the law's at the overlap a²/R*, of the same a. Pairs
//! touch at δ = 0, where F_n is -8/9 of the pull-off force 3πγR*, and stay in contact until -F_n
//! reaches it, at δ = -a_c²/(3R*), a_c³ = 9πγR*²/(4E*). The limits are those of F_n', the load
//! under which Hertz' contact has the same area; LAMMPS takes |F_n + 6πγR*|, which is the same at
//! pull-off and less before. The potential energy is ∫F_n dδ from the touch. What is left of it at
//! the pull-off, 0.961 πγ a_c², counts in `dissipated_stiffness`, the energies of the springs in
//! those of their limits. All forces jump, and are scaled in these two steps.
//!
//! The constant attraction, if there is one, acts as long as the pair is in contact.

use std::sync::Arc;

use super::AdhesionKind;
use super::constant::{ATTRACTION, Constant};
use super::dmt::SURFACE_ENERGY;
use crate::contact::adhesion::{Adhesion, AdhesiveContact, AdhesivePairs, reduced_radius};
use crate::contact::{PairRadii, scalar};
use crate::dimension::Dimensions;
use crate::simd::{Lanes, Portable, cube_root, inverse};

/// The adhesion as scenes name it.
pub const KIND: AdhesionKind = AdhesionKind {
    name: "jkr",
    summary: "Hertzian spheres whose contact the surface energy deforms (Johnson, Kendall and \
              Roberts)",
    dimensions: &[Dimensions::Three],
    keys: &[&ATTRACTION, &SURFACE_ENERGY],
    unfit: |law| {
        let what = format!(
            "\"jkr\" is between Hertzian spheres, and the law {:?} has none; choose the law \"hertz\" or \"hertz-tsuji\", or \"dmt\"",
            law.kind().name
        );
        law.contact_modulus().is_none().then_some(what)
    },
    read: |values, law| {
        let constant = Constant::read(values);
        let surface_energy = values.number(&SURFACE_ENERGY).unwrap_or(0.0);
        match law.contact_modulus() {
            Some(modulus) if surface_energy > 0.0 => {
                Some(Arc::new(Jkr::new(surface_energy, modulus).beside(constant)))
            }
            _ => constant.shared(),
        }
    },
};

/// JKR adhesion of two spheres. Lengths are counted in the overlap d = a_c²/R* of Hertz' contact of
/// the radius a_c at pull-off: with y⁴ = a²/(R* d)
///
/// ```text
/// δ/d = y⁴ - (4/3) y,   y ≥ 1;     d³ = (9πγ/(4E*))² R*
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jkr {
    /// The pull-off force over R*, 3πγ (N/m).
    pull_off: f64,
    /// F_c/a^(3/2) = 4√(πγE*) (N/m^(3/2)).
    pull: f64,
    /// d/R*^(1/3) (m^(2/3)).
    depth: f64,
    constant: Constant,
}

impl Jkr {
    /// Of the surface energy γ (J/m²) and E* (Pa).
    pub fn new(surface_energy: f64, modulus: f64) -> Self {
        let product = std::f64::consts::PI * surface_energy;
        let ratio = 2.25 * product / modulus;
        let square = ratio * ratio;
        Self {
            pull_off: 3.0 * product,
            pull: 4.0 * (product * modulus).sqrt(),
            depth: scalar(|token| cube_root(token, Portable::splat(token, square))),
            constant: Constant { force: 0.0 },
        }
    }

    /// With a constant attraction as well.
    #[must_use]
    pub fn beside(self, constant: Constant) -> Self {
        Self { constant, ..self }
    }

    /// d (m) of this R* (m).
    #[inline(always)]
    fn depth<L: Lanes>(&self, token: L::Token, reduced: L) -> L {
        L::splat(token, self.depth) * cube_root(token, reduced)
    }

    /// F_c = 4√(πγE* a³) (N) at a²/R* = `hertzian` (m).
    #[inline(always)]
    fn pull<L: Lanes>(&self, token: L::Token, reduced: L, hertzian: L) -> L {
        let radius = (reduced * hertzian).max(L::splat(token, 0.0)).sqrt();
        L::splat(token, self.pull) * radius * radius.sqrt()
    }

    /// d (m) of this R* (m): contacts end at δ = -d/3.
    fn pull_off_depth(&self, reduced: f64) -> f64 {
        scalar(|token| self.depth(token, Portable::splat(token, reduced)))
    }
}

impl Adhesion for Jkr {
    const ACROSS_GAPS: bool = true;
    const CHANGES_AREA: bool = true;

    #[inline(always)]
    fn force<L: Lanes>(&self, token: L::Token, pairs: &AdhesivePairs<L>) -> L {
        let pull = self.pull(token, pairs.radii.reduced(), pairs.elastic_overlap);
        self.constant.force(token, pairs) + pull
    }

    #[inline(always)]
    fn margin<L: Lanes>(&self, token: L::Token, radii: &PairRadii<L>, overlap: L) -> L {
        let depth = self.depth(token, radii.reduced());
        depth.mul_add(L::splat(token, 1.0 / 3.0), overlap)
    }

    #[inline(always)]
    fn elastic_overlap<L: Lanes>(&self, token: L::Token, radii: &PairRadii<L>, overlap: L) -> L {
        let depth = self.depth(token, radii.reduced());
        let y = root(token, overlap / depth);
        depth * (y * y) * (y * y)
    }

    /// ∫F_n dδ from δ = 0, without that of Hertz' force at a²/R*.
    #[inline(always)]
    fn add_potential<L: Lanes>(&self, token: L::Token, pairs: &AdhesivePairs<L>, energy: L) -> L {
        let (reduced, hertzian) = (pairs.radii.reduced(), pairs.elastic_overlap);
        let at_touch = L::splat(token, 0.6 * AT_TOUCH) * self.depth(token, reduced);
        let pull_off = L::splat(token, self.pull_off) * reduced * (hertzian + at_touch);
        let pull = self.pull(token, reduced, hertzian) * hertzian;
        let potential = L::splat(token, 2.0 / 3.0) * (pull_off - pull);
        self.constant.add_potential(token, pairs, energy) + potential
    }

    fn contact(&self, radii: [f64; 2], overlap: f64) -> AdhesiveContact {
        let reduced = reduced_radius(radii);
        let depth = self.pull_off_depth(reduced);
        let y = scalar(|token| root(token, Portable::splat(token, overlap / depth)));
        let (cube, force) = (y * y * y, self.pull_off * reduced);
        AdhesiveContact {
            elastic_overlap: depth * y * cube,
            elastic_slope: cube / (cube - 1.0 / 3.0),
            force: 2.0 * force * cube + self.constant.force,
            force_slope: 1.5 * force / depth * y * y / (cube - 1.0 / 3.0),
        }
    }

    fn pull_off(&self, radii: [f64; 2]) -> f64 {
        let [r1, r2] = radii;
        self.constant.force + self.pull_off * r1 * r2 / (r1 + r2)
    }

    /// F_c/F = 2 (1 + √(1 + P/F)) under the load P, with the pull-off force F.
    fn under_load(&self, load: f64, radii: [f64; 2]) -> f64 {
        let constant = self.constant.force;
        let force = self.pull_off * reduced_radius(radii);
        constant + 2.0 * (force + (force * (load + constant + force)).sqrt())
    }
}

/// y⁴ = (4/3)^(4/3) at δ = 0.
const AT_TOUCH: f64 = 1.467_523_221_730_945;

/// The root y ≥ 1 of y⁴ - (4/3) y = x, of x < -1/3 that of -1/3: from a start good to 4 %, four of
/// Newton's steps.
#[inline(always)]
fn root<L: Lanes>(token: L::Token, x: L) -> L {
    let (three, four) = (L::splat(token, 3.0), L::splat(token, 4.0));
    let third = L::splat(token, 4.0 / 3.0);
    let x = x.max(L::splat(token, -1.0 / 3.0));
    let fourth = (x + L::splat(token, 1.9)).sqrt().sqrt();
    let mut y = third.mul_add(fourth, x).sqrt().sqrt();
    for _ in 0..4 {
        let square = y * y;
        let slope = (four * square).mul_add(y, -third);
        y = (three * square).mul_add(square, x) * inverse(token, slope);
    }
    y
}
