//! J as BO's appendix B prints it.

use faer::sparse::{SparseColMat, Triplet};

use super::Jacobian;

/// Returns J of BO's equation B15 from K with [`History::Unturned`](super::History::Unturned): rows
/// are unknowns and columns forces, x of all grains first, then y, z, and the rotations. `radius`
/// gives the radius of a grain by id (m).
///
/// B9 divides torques by R and multiplies rotations by R, which turns K into K̃ and M into M̃ =
/// diag(m, I/R²). B10 divides the derivatives by the masses (the paper has m = 1, I/R² = 0.4). With
/// S = diag(1, -1) for positions and rotations, which accounts for the signs of B12 and B13,
///
/// ```text
/// J = S (K̃ M̃⁻¹)ᵀ S.
/// ```
///
/// Its eigenvalues are those of K v = λ M v.
///
/// # Panics
/// If an entry of `jacobian.k` lies outside the matrix.
pub fn paper_form(jacobian: &Jacobian, radius: impl Fn(u32) -> f64) -> SparseColMat<usize, f64> {
    let (per_grain, grains) = (jacobian.per_grain, jacobian.grains.len());
    let place = |unknown: usize| unknown % per_grain * grains + unknown / per_grain;
    let rotation = |unknown: usize| unknown % per_grain >= jacobian.axes;
    let lever = |unknown: usize| {
        if rotation(unknown) {
            radius(jacobian.grains[unknown / per_grain])
        } else {
            1.0
        }
    };
    let entry = |force: usize, unknown: usize, value: f64| {
        let sign = if rotation(force) == rotation(unknown) {
            1.0
        } else {
            -1.0
        };
        let mass = jacobian.mass[unknown] / lever(unknown).powi(2);
        let value = sign * value / (lever(force) * lever(unknown) * mass);
        Triplet::new(place(unknown), place(force), value)
    };
    let entries = jacobian.k.triplet_iter();
    let entries: Vec<_> = entries.map(|e| entry(e.row, e.col, *e.val)).collect();
    let n = jacobian.unknowns();
    SparseColMat::try_new_from_triplets(n, n, &entries).expect("indices within the matrix")
}
