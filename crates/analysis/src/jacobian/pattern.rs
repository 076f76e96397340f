//! Sparsity pattern of K: which blocks of grains are nonzero and where their entries are stored.

use faer::sparse::{SparseColMat, SymbolicSparseColMat};

/// Pattern of square blocks: one on the diagonal per grain and two per pair of grains in contact.
pub(crate) struct Pattern {
    /// Number of rows and columns of a block.
    side: usize,
    /// First block of every grain's columns; one more at the end.
    start: Vec<usize>,
    /// Grains whose rows the blocks hold, ascending in each column of blocks.
    partner: Vec<usize>,
}

impl Pattern {
    /// Creates the pattern of `grains` grains with the given pairs in contact, in any order and
    /// number.
    pub fn new(grains: usize, side: usize, pairs: impl Iterator<Item = [usize; 2]>) -> Self {
        let mut partners: Vec<Vec<usize>> = (0..grains).map(|g| vec![g]).collect();
        for [i, j] in pairs {
            partners[i].push(j);
            partners[j].push(i);
        }
        let (mut start, mut partner) = (vec![0], Vec::new());
        for mut partners in partners {
            partners.sort_unstable();
            partners.dedup();
            partner.extend(partners);
            start.push(partner.len());
        }
        Self {
            side,
            start,
            partner,
        }
    }

    /// Returns the number of stored entries.
    pub fn entries(&self) -> usize {
        self.partner.len() * self.side * self.side
    }

    /// Adds to `values` the block of a row and a column of blocks. Panics if the pair is not in the
    /// pattern.
    pub fn add(
        &self,
        values: &mut [f64],
        row: usize,
        column: usize,
        entry: impl Fn(usize, usize) -> f64,
    ) {
        let (side, first) = (self.side, self.start[column]);
        let partners = &self.partner[first..self.start[column + 1]];
        let at = partners.binary_search(&row).expect("a pair of the pattern");
        for c in 0..side {
            let place = side * (side * first + c * partners.len() + at);
            for (r, value) in values[place..place + side].iter_mut().enumerate() {
                *value += entry(r, c);
            }
        }
    }

    /// Returns the sparse matrix with these values.
    pub fn matrix(&self, values: Vec<f64>) -> SparseColMat<usize, f64> {
        let side = self.side;
        let unknowns = side * (self.start.len() - 1);
        let (mut column_start, mut rows) = (vec![0], Vec::with_capacity(values.len()));
        for blocks in self.start.windows(2) {
            let partners = &self.partner[blocks[0]..blocks[1]];
            for _ in 0..side {
                rows.extend(partners.iter().flat_map(|g| side * g..side * (g + 1)));
                column_start.push(rows.len());
            }
        }
        let symbolic =
            SymbolicSparseColMat::new_checked(unknowns, unknowns, column_start, None, rows);
        SparseColMat::new(symbolic, values)
    }
}
