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
    let n = jacobian.unknowns();
    let unknowns = (0..n).map(|k| PaperUnknown::new(jacobian, k, &radius));
    let unknowns: Vec<PaperUnknown> = unknowns.collect();
    let entries = jacobian.k.triplet_iter().map(|entry| {
        let (force, unknown) = (&unknowns[entry.row], &unknowns[entry.col]);
        let sign = if force.is_rotation == unknown.is_rotation {
            1.0
        } else {
            -1.0
        };
        let mass = jacobian.mass[entry.col] / unknown.lever.powi(2);
        let value = sign * entry.val / (force.lever * unknown.lever * mass);
        Triplet::new(unknown.place, force.place, value)
    });
    let entries: Vec<_> = entries.collect();
    SparseColMat::try_new_from_triplets(n, n, &entries).expect("indices within the matrix")
}

/// An unknown, or a force, in the form of the paper.
struct PaperUnknown {
    /// Number of its row or column.
    place: usize,
    /// Whether it is a rotation or a torque.
    is_rotation: bool,
    /// R of a rotation (m), else 1.
    lever: f64,
}

impl PaperUnknown {
    fn new(jacobian: &Jacobian, number: usize, radius: impl Fn(u32) -> f64) -> Self {
        let (grain, own) = (number / jacobian.per_grain, number % jacobian.per_grain);
        let is_rotation = own >= jacobian.axes;
        Self {
            place: own * jacobian.grains.len() + grain,
            is_rotation,
            lever: if is_rotation {
                radius(jacobian.grains[grain])
            } else {
                1.0
            },
        }
    }
}
