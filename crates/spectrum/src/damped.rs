//! The quadratic problem (s² M + s C + K) v = 0 of motions e^(st) with dampers.

use faer::sparse::SparseColMat;
use faer::{Mat, c64};

use crate::eigenvalues::values_of;
use crate::problem::Problem;

/// |s| over the greatest frequency √‖A‖ below which it is a zero mode: rounding of the double zero
/// of a translation is of the size of the root of that of a matrix.
pub const DAMPED_ZERO: f64 = 1e-6;

/// Returns all 2n eigenvalues s (1/s) of the problem with the damping matrix C, on one thread. Zero
/// modes of K without entries (rattlers) are left out. With s in units of ω = √‖A‖ and A =
/// M^(-1/2) K M^(-1/2), B = M^(-1/2) C M^(-1/2), they are those of
///
/// ```text
/// ⎛    0       1   ⎞
/// ⎝ -A/ω²   -B/ω  ⎠
/// ```
///
/// (F. Tisseur and K. Meerbergen, SIAM Rev. 43, 235, 2001).
///
/// # Panics
/// If C has other rows than K, or the QR algorithm does not converge.
pub fn damped_values(problem: &Problem, c: &SparseColMat<usize, f64>) -> Vec<c64> {
    assert_eq!(c.ncols(), problem.unknowns(), "C is of the unknowns of K");
    let n = problem.size();
    let frequency = problem.norm().sqrt();
    let mut matrix = Mat::<f64>::zeros(2 * n, 2 * n);
    for k in 0..n {
        matrix[(k, n + k)] = 1.0;
    }
    for entry in problem.matrix().triplet_iter() {
        matrix[(n + entry.row, entry.col)] -= entry.val / (frequency * frequency);
    }
    for (row, column, value) in problem.scaled_by_mass(c) {
        matrix[(n + row, n + column)] -= value / frequency;
    }
    let values = values_of(matrix.as_ref()).into_iter();
    values.map(|value| frequency * value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::sparse::Triplet;

    fn sparse(entries: &[(usize, usize, f64)]) -> SparseColMat<usize, f64> {
        let entries = entries.iter().map(|&(i, j, x)| Triplet::new(i, j, x));
        let entries: Vec<_> = entries.collect();
        SparseColMat::try_new_from_triplets(3, 3, &entries).unwrap()
    }

    /// The values of masses 2, 2 and a rattler, in the order of their imaginary parts.
    fn values(k: &[(usize, usize, f64)], c: &[(usize, usize, f64)]) -> Vec<c64> {
        let problem = Problem::new(&sparse(k), &[2.0; 3], Mat::zeros(3, 0).as_ref()).unwrap();
        let mut values = damped_values(&problem, &sparse(c));
        values.sort_by(|a, b| a.im.total_cmp(&b.im));
        values
    }

    /// s = -γ/2m ± √(γ²/4m² - k/m) of two oscillators, one of them beyond critical damping.
    #[test]
    fn damped_oscillators_are_found() {
        let found = values(&[(0, 0, 8.0), (1, 1, 2.0)], &[(0, 0, 1.6), (1, 1, 5.0)]);
        let near = |a: c64, re: f64, im: f64| {
            assert!((a - c64::new(re, im)).norm() < 1e-13, "{a} {re} {im}");
        };
        let frequency = (4.0 - 0.16f64).sqrt();
        near(found[0], -0.4, -frequency);
        near(found[3], -0.4, frequency);
        let mut slow = [found[1].re, found[2].re];
        slow.sort_by(f64::total_cmp);
        assert!((slow[0] + 2.0).abs() < 1e-13 && (slow[1] + 0.5).abs() < 1e-13);
    }

    /// Flutter of λ = 2 ± iε: s² = -λ, so s grows by ω_i = Im √λ; dampers c of all unknowns alike
    /// take c/2m off, and stop it once that is more.
    #[test]
    fn dampers_stop_a_flutter() {
        let k = [(0, 0, 4.0), (1, 1, 4.0), (0, 1, 0.2), (1, 0, -0.2)];
        for damper in [0.0, 0.05, 0.2] {
            let found = values(&k, &[(0, 0, damper), (1, 1, damper)]);
            let greatest = found.iter().map(|s| s.re).fold(f64::MIN, f64::max);
            // s² + (c/m) s + λ = 0.
            let half = 0.25 * damper;
            let shifted = (c64::new(2.0, 0.1) - c64::new(half * half, 0.0)).sqrt();
            assert!((greatest - (shifted.im - half)).abs() < 1e-13);
            assert_eq!(greatest > 0.0, damper < 0.1, "{damper}");
        }
    }
}
