//! JKR adhesion of Hertzian spheres; [`crate::laws::attraction`] has the formulas.

use super::scalar;
use crate::simd::{Lanes, Portable, PortableToken, cube_root, inverse};

/// JKR adhesion of two spheres. Lengths are counted in the overlap d = a_c²/R* of Hertz' contact of
/// the radius a_c at pull-off: with y⁴ = a²/(R* d)
///
/// ```text
/// δ/d = y⁴ - (4/3) y,   y ≥ 1;     d³ = (9πγ/(4E*))² R*
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jkr {
    /// The pull-off force over R*, 3πγ (N/m).
    pub pull_off: f64,
    /// F_a/a^(3/2) = 4√(πγE*) (N/m^(3/2)).
    pull: f64,
    /// d/R*^(1/3) (m^(2/3)).
    depth: f64,
}

/// A contact as the law sees it, and its adhesion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adhesive {
    /// The overlap of Hertz' contact of the same radius (m).
    pub hertzian: f64,
    /// Its derivative by δ.
    pub slope: f64,
    /// What is subtracted from the law's F_n (N; N/m in 2D).
    pub pull: f64,
    /// Its derivative by δ.
    pub pull_slope: f64,
}

impl Jkr {
    /// Of the surface energy γ (J/m²) and E* (Pa).
    pub fn new(surface_energy: f64, modulus: f64) -> Self {
        let of_both = std::f64::consts::PI * surface_energy;
        let ratio = 2.25 * of_both / modulus;
        Self {
            pull_off: 3.0 * of_both,
            pull: 4.0 * (of_both * modulus).sqrt(),
            depth: on_one(ratio * ratio, cube_root),
        }
    }

    /// d (m) of this R* (m).
    #[inline(always)]
    pub fn depth<L: Lanes>(&self, token: L::Token, reduced: L) -> L {
        L::splat(token, self.depth) * cube_root(token, reduced)
    }

    /// a²/R* (m) at the overlap δ (m): the overlap of Hertz' contact of the same radius.
    #[inline(always)]
    pub fn hertzian<L: Lanes>(&self, token: L::Token, depth: L, overlap: L) -> L {
        let y = root(token, overlap / depth);
        depth * (y * y) * (y * y)
    }

    /// F_a = 4√(πγE* a³) (N) at a²/R* = `hertzian` (m).
    #[inline(always)]
    pub fn pull<L: Lanes>(&self, token: L::Token, reduced: L, hertzian: L) -> L {
        let radius = (reduced * hertzian).max(L::splat(token, 0.0)).sqrt();
        L::splat(token, self.pull) * radius * radius.sqrt()
    }

    /// ∫F dδ from δ = 0 without that of Hertz' force at a²/R* = `hertzian` (J).
    #[inline(always)]
    pub fn potential<L: Lanes>(&self, token: L::Token, reduced: L, hertzian: L) -> L {
        let c = |v| L::splat(token, v);
        let of_touch = c(0.6 * AT_TOUCH) * self.depth(token, reduced);
        let pull_off = c(self.pull_off) * reduced * (hertzian + of_touch);
        c(2.0 / 3.0) * (pull_off - self.pull(token, reduced, hertzian) * hertzian)
    }

    /// The contact of spheres of this R* (m) at the overlap δ (m).
    pub fn contact(&self, reduced: f64, overlap: f64) -> Adhesive {
        let depth = self.pull_off_depth(reduced);
        let y = on_one(overlap / depth, root);
        let (cube, force) = (y * y * y, self.pull_off * reduced);
        Adhesive {
            hertzian: depth * y * cube,
            slope: cube / (cube - 1.0 / 3.0),
            pull: 2.0 * force * cube,
            pull_slope: 1.5 * force / depth * y * y / (cube - 1.0 / 3.0),
        }
    }

    /// d (m) of this R* (m): contacts end at δ = -d/3.
    pub fn pull_off_depth(&self, reduced: f64) -> f64 {
        on_one(reduced, |token, x| self.depth(token, x))
    }

    /// F_a (N) under a load (N) on spheres of this R* (m).
    pub fn under(&self, load: f64, reduced: f64) -> f64 {
        let force = self.pull_off * reduced;
        2.0 * (force + (force * (load + force)).sqrt())
    }
}

/// A portable function of one number.
fn on_one(x: f64, f: impl FnOnce(PortableToken, Portable) -> Portable) -> f64 {
    scalar(|token| f(token, Portable::splat(token, x)))
}

/// y⁴ = (4/3)^(4/3) at δ = 0.
const AT_TOUCH: f64 = 1.467_523_221_730_945;

/// The root y ≥ 1 of y⁴ - (4/3) y = x, of x < -1/3 that of -1/3: from a start good to 4 %, four of
/// Newton's steps.
#[inline(always)]
fn root<L: Lanes>(token: L::Token, x: L) -> L {
    let c = |v| L::splat(token, v);
    let third = c(4.0 / 3.0);
    let x = x.max(c(-1.0 / 3.0));
    let fourth = (x + c(1.9)).sqrt().sqrt();
    let mut y = third.mul_add(fourth, x).sqrt().sqrt();
    for _ in 0..4 {
        let square = y * y;
        let slope = (c(4.0) * square).mul_add(y, -third);
        y = (c(3.0) * square).mul_add(square, x) * inverse(token, slope);
    }
    y
}
