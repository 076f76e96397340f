//! J as BO's appendix B prints it.

use faer::sparse::{SparseColMat, Triplet};

use super::Jacobian;

/// J of B15 from K of unturned histories: rows are unknowns and columns forces, x of all grains, then y, z, and the rotations.
///
/// Torques are over R and rotations times R (B9), so K becomes K̃, and M M̃ = diag(m, I/R²), which divides the derivatives (B10; the paper has
/// m = 1, I/R² = 0.4). With S = diag(1, -1) of positions and rotations, which is how the signs of B12 and B13 come out,
///
///     J = S (K̃ M̃⁻¹)ᵀ S,
///
/// whose eigenvalues are those of K v = λ M v. `radius` of all grains, by id (m).
pub fn paper_form(jacobian: &Jacobian, radius: impl Fn(u32) -> f64) -> SparseColMat<usize, f64> {
    let (per_grain, grains) = (jacobian.per_grain, jacobian.grains.len());
    let place = |unknown: usize| unknown % per_grain * grains + unknown / per_grain;
    let rotation = |unknown: usize| unknown % per_grain >= jacobian.axes;
    let lever = |unknown: usize| match rotation(unknown) {
        true => radius(jacobian.grains[unknown / per_grain]),
        false => 1.0,
    };
    let entry = |(force, unknown, value): (usize, usize, f64)| {
        let sign = if rotation(force) == rotation(unknown) {
            1.0
        } else {
            -1.0
        };
        let mass = jacobian.mass[unknown] / lever(unknown).powi(2);
        let value = sign * value / (lever(force) * lever(unknown) * mass);
        Triplet::new(place(unknown), place(force), value)
    };
    let entries: Vec<_> = jacobian
        .k
        .triplet_iter()
        .map(|e| entry((e.row, e.col, *e.val)))
        .collect();
    let n = jacobian.unknowns();
    SparseColMat::try_new_from_triplets(n, n, &entries).expect("indices within the matrix")
}
