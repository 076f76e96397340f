//! Symbolic factorisation of A - σI, which is the same for every shift: the fronts of the
//! multifrontal LU and their assembly tree.

use faer::Side;
use faer::perm::Perm;
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholeskyRaw, SymmetricOrdering, factorize_symbolic_cholesky,
};

use crate::ordering::{nested_dissection, symmetric_pattern};

/// Fronts of the multifrontal LU of a matrix with a symmetrised pattern, with partial pivoting
/// inside each front (Duff & Reid 1983). The fill is that of a Cholesky factor and its transpose.
pub struct Symbolic {
    /// `order[k]`: the unknown that is eliminated as the k-th.
    pub(crate) order: Vec<usize>,
    /// Fronts in the order of elimination.
    pub(crate) fronts: Vec<Front>,
    /// Entries of A per front.
    pub(crate) entries: Vec<Vec<MatrixEntry>>,
}

/// Pivots that are eliminated together, and the later pivots that they update.
pub(crate) struct Front {
    /// First pivot.
    pub(crate) begin: usize,
    /// Number of pivots.
    pub(crate) width: usize,
    /// Later pivots in the pattern of the front, ascending.
    pub(crate) reach: Vec<usize>,
    /// Fronts whose updates are assembled into this one.
    pub(crate) children: Vec<usize>,
}

/// A value of A and where it goes in a front.
pub(crate) struct MatrixEntry {
    /// Index in the panel `[width + reach][width]`, by columns; from its end on, index in the rows
    /// `[width][reach]`.
    pub(crate) place: u32,
    /// Index of the value in A.
    pub(crate) value: u32,
}

impl Symbolic {
    /// Analyses the pattern of a square matrix.
    pub fn new(a: SymbolicSparseColMatRef<'_, usize>) -> Self {
        let pattern = symmetric_pattern(a);
        let order = nested_dissection(pattern.as_ref());
        let mut rank = vec![0; order.len()];
        order.iter().enumerate().for_each(|(k, &j)| rank[j] = k);
        let mut fronts = fronts(pattern.as_ref(), &order, &rank);
        for s in 0..fronts.len() {
            if let Some(&next) = fronts[s].reach.first() {
                let parent = fronts.partition_point(|front| front.begin <= next) - 1;
                fronts[parent].children.push(s);
            }
        }
        let entries = entries(a, &rank, &fronts);
        Symbolic {
            order,
            fronts,
            entries,
        }
    }

    /// Returns the number of entries of L and U together.
    pub fn fill(&self) -> usize {
        self.fronts.iter().map(Front::fill).sum()
    }

    /// Returns the number of multiplications and additions of one factorisation.
    pub fn operations(&self) -> f64 {
        self.fronts.iter().map(Front::operations).sum()
    }
}

/// The supernodes of the Cholesky factor of the pattern, with faer's relaxation.
fn fronts(
    pattern: SymbolicSparseColMatRef<'_, usize>,
    order: &[usize],
    rank: &[usize],
) -> Vec<Front> {
    let permutation = Perm::new_checked(order.into(), rank.into(), pattern.ncols());
    let parameters = CholeskySymbolicParams {
        supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
        ..Default::default()
    };
    let ordering = SymmetricOrdering::Custom(permutation.as_ref());
    let factor = factorize_symbolic_cholesky(pattern, Side::Lower, ordering, parameters)
        .expect("memory for the pattern of the factors");
    let SymbolicCholeskyRaw::Supernodal(factor) = factor.raw() else {
        unreachable!("FORCE_SUPERNODAL gives a supernodal factor");
    };
    let mut fronts = Vec::with_capacity(factor.n_supernodes());
    for s in 0..factor.n_supernodes() {
        let begin = factor.supernode_begin()[s];
        let mut reach = factor.supernode(s).pattern().to_vec();
        reach.sort_unstable();
        fronts.push(Front {
            begin,
            width: factor.supernode_end()[s] - begin,
            reach,
            children: Vec::new(),
        });
    }
    fronts
}

fn entries(
    a: SymbolicSparseColMatRef<'_, usize>,
    rank: &[usize],
    fronts: &[Front],
) -> Vec<Vec<MatrixEntry>> {
    let mut front_of = vec![0; a.ncols()];
    for (s, front) in fronts.iter().enumerate() {
        front_of[front.begin..front.begin + front.width].fill(s);
    }
    let mut entries: Vec<Vec<MatrixEntry>> = fronts.iter().map(|_| Vec::new()).collect();
    let mut value = 0u32;
    for (j, &column) in rank.iter().enumerate() {
        for &i in a.row_idx_of_col_raw(j) {
            let row = rank[i];
            let s = front_of[row.min(column)];
            let front = &fronts[s];
            let (i, j) = (front.place(row), front.place(column));
            let height = front.height();
            let place = if j < front.width {
                j * height + i
            } else {
                front.width * height + (j - front.width) * front.width + i
            };
            entries[s].push(MatrixEntry {
                place: u32::try_from(place).expect("a front of less than 2³² entries"),
                value,
            });
            value += 1;
        }
    }
    entries
}

impl Front {
    /// Entries of L and U.
    fn fill(&self) -> usize {
        self.width * (self.width + 2 * self.reach.len())
    }

    /// Multiplications and additions of its elimination.
    fn operations(&self) -> f64 {
        let (w, r) = (self.width as f64, self.reach.len() as f64);
        2.0 / 3.0 * w * w * w + 2.0 * w * w * r + 2.0 * w * r * r
    }

    /// Number of rows.
    pub(crate) fn height(&self) -> usize {
        self.width + self.reach.len()
    }

    /// Index of a pivot among those of the front.
    pub(crate) fn place(&self, pivot: usize) -> usize {
        if pivot < self.begin + self.width {
            return pivot - self.begin;
        }
        let later = self.reach.binary_search(&pivot);
        self.width + later.expect("a pivot that the front reaches")
    }
}
