//! Where the blocks of grains in contact are among the entries of K.

use faer::sparse::{SparseColMat, SymbolicSparseColMat};

/// Square blocks, of which every grain has one on the diagonal and every pair in contact two.
pub struct Pattern {
    /// Rows and columns of a block.
    side: usize,
    /// First block of every grain's columns, and the grains whose rows they hold, ascending.
    start: Vec<usize>,
    partner: Vec<usize>,
}

impl Pattern {
    pub fn new(grains: usize, side: usize, pairs: impl Iterator<Item = [usize; 2]>) -> Self {
        let mut partners: Vec<Vec<usize>> = (0..grains).map(|g| vec![g]).collect();
        for [i, j] in pairs {
            partners[i].push(j);
            partners[j].push(i);
        }
        let (mut start, mut partner) = (vec![0], Vec::new());
        for mut of_one in partners {
            of_one.sort_unstable();
            of_one.dedup();
            partner.extend(of_one);
            start.push(partner.len());
        }
        Self {
            side,
            start,
            partner,
        }
    }

    pub fn entries(&self) -> usize {
        self.partner.len() * self.side * self.side
    }

    /// Adds a block, of entries by row and column.
    pub fn add(
        &self,
        values: &mut [f64],
        [row, column]: [usize; 2],
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
