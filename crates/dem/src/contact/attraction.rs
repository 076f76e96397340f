//! The attraction of grains that touch, beside any law; see [`crate::laws::attraction`].

use crate::simd::Lanes;

/// F_c = `constant` + `per_radius` R*.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Attraction {
    /// N; N/m in 2D.
    pub constant: f64,
    /// 4πγ (N/m), in 3D.
    pub per_radius: f64,
}

impl Attraction {
    /// F_c (N; N/m in 2D) of pairs with these R_i + R_j and R_i (m).
    #[inline(always)]
    pub fn force<L: Lanes>(&self, token: L::Token, [sum, r_i]: [L; 2]) -> L {
        let reduced = r_i * (sum - r_i) / sum;
        L::splat(token, self.per_radius).mul_add(reduced, L::splat(token, self.constant))
    }

    /// F_c (N; N/m in 2D) of two grains of radii r1, r2 (m).
    pub fn between(&self, r1: f64, r2: f64) -> f64 {
        self.constant + self.per_radius * r1 * r2 / (r1 + r2)
    }
}
