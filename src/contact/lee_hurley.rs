//! LH appendix A.

/// k_n = F_n^e/δ (Pa) of two cylinders of radii r1, r2 (m) at the overlap δ (m): A2 in closed form, physics.md.
pub fn normal_stiffness(effective_modulus: f64, r1: f64, r2: f64, overlap: f64) -> f64 {
    let l = -(overlap / (4.0 * (r1 + r2))).ln();
    let mut ell = l + l.ln();
    for _ in 0..60 {
        ell = l + (ell - 1.0).ln();
    }
    std::f64::consts::PI * effective_modulus / (ell - 1.0)
}
