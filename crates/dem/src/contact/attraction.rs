//! The attraction of grains that touch, beside any law; see [`crate::laws::attraction`].

use super::is_curved;
use super::jkr::{Adhesive, Jkr};
use crate::simd::Lanes;

/// F_c = `constant` + `per_radius` R*, and the adhesion of JKR.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Attraction {
    /// N; N/m in 2D.
    pub constant: f64,
    /// 4πγ (N/m) of DMT, in 3D.
    pub per_radius: f64,
    /// Between Hertzian spheres.
    pub jkr: Option<Jkr>,
}

impl Attraction {
    /// None.
    pub const NONE: Self = Self {
        constant: 0.0,
        per_radius: 0.0,
        jkr: None,
    };

    /// The attraction (N; N/m in 2D) of pairs with these R_i + R_j and R_i (m). `hertzian`: the
    /// overlap that the law is given (m).
    #[inline(always)]
    pub fn force<L: Lanes>(&self, token: L::Token, radii: [L; 2], hertzian: L) -> L {
        let reduced = reduced_radius(radii);
        let force =
            L::splat(token, self.per_radius).mul_add(reduced, L::splat(token, self.constant));
        match &self.jkr {
            Some(jkr) => force + jkr.pull(token, reduced, hertzian),
            None => force,
        }
    }

    /// The potential energy (J; J/m in 2D) of pairs that touch, added to `energy`. Overlaps: δ, and
    /// that which the law is given (m).
    #[inline(always)]
    pub fn potential<L: Lanes>(
        &self,
        token: L::Token,
        radii: [L; 2],
        [overlap, hertzian]: [L; 2],
        energy: L,
    ) -> L {
        let without = Self { jkr: None, ..*self };
        let force = without.force(token, radii, hertzian);
        let energy = (-force).mul_add(overlap, energy);
        match &self.jkr {
            Some(jkr) => energy + jkr.potential(token, reduced_radius(radii), hertzian),
            None => energy,
        }
    }

    /// The greatest attraction of two grains of radii r1, r2 (m) without a load: the force that
    /// separates them (N; N/m in 2D).
    pub fn pull_off(&self, [r1, r2]: [f64; 2]) -> f64 {
        let per_radius = self.per_radius + self.jkr.map_or(0.0, |jkr| jkr.pull_off);
        self.constant + per_radius * r1 * r2 / (r1 + r2)
    }

    /// The contact of two grains of radii r1, r2 (m) at the overlap δ (m).
    pub fn contact(&self, [r1, r2]: [f64; 2], overlap: f64) -> Adhesive {
        let constant = Self { jkr: None, ..*self }.pull_off([r1, r2]);
        let hertz = Adhesive {
            hertzian: overlap,
            slope: 1.0,
            pull: 0.0,
            pull_slope: 0.0,
        };
        let of_jkr = |jkr: Jkr| jkr.contact(r1 * r2 / (r1 + r2), overlap);
        let found = self.jkr.map_or(hertz, of_jkr);
        Adhesive {
            pull: found.pull + constant,
            ..found
        }
    }

    /// The attraction (N; N/m in 2D) of two grains of radii r1, r2 (m) that a load (N; N/m in 2D)
    /// presses together.
    pub fn under(&self, load: f64, [r1, r2]: [f64; 2]) -> f64 {
        let constant = Self { jkr: None, ..*self }.pull_off([r1, r2]);
        let of_jkr = |jkr: Jkr| jkr.under(load + constant, r1 * r2 / (r1 + r2));
        constant + self.jkr.map_or(0.0, of_jkr)
    }

    /// How far apart (m) two grains of radii r1, r2 (m) are when their contact ends.
    pub fn greatest_gap(&self, [r1, r2]: [f64; 2]) -> f64 {
        let of_jkr = |jkr: Jkr| jkr.pull_off_depth(r1 * r2 / (r1 + r2)) / 3.0;
        self.jkr.map_or(0.0, of_jkr)
    }
}

/// R* (m) of R_i + R_j and R_i (m); R_i at a flat wall.
#[inline(always)]
pub(crate) fn reduced_radius<L: Lanes>([sum, r_i]: [L; 2]) -> L {
    (r_i * (sum - r_i) / sum).select(is_curved([sum, r_i]), r_i)
}
