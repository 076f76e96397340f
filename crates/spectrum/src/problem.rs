//! The problem K v = λ M v and its standard form A w = λ w.

use std::fmt;
use std::sync::OnceLock;

use faer::reborrow::ReborrowMut;
use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, MatMut, MatRef, c64};

use crate::scalar::Scalar;

/// Relative tolerance for zero: an eigenvalue over ‖A‖, and the residual of a null vector over the
/// greatest column of A.
pub(crate) const ZERO: f64 = 1e-12;

const DEPENDENT: &str =
    "null vectors must be linearly independent: leave out those that depend on others";

/// K v = λ M v with diagonal M as A w = λ w, where A = M^(-1/2) K M^(-1/2) and w = M^(1/2) v.
///
/// In this form displacements and rotations, light and heavy grains have entries of similar size,
/// so a residual of A weighs all of them alike, whereas the heaviest grains dominate that of K v -
/// λ M v. A is symmetric if K is. Unknowns whose row and column are zero (rattlers) are zero modes
/// and left out of A. Null vectors of K that are given (translations) are projected out of the
/// iterations.
pub struct Problem {
    a: SparseColMat<usize, f64>,
    /// Square roots of the masses, per unknown of A.
    root_mass: Vec<f64>,
    /// Unknown of K of every unknown of A.
    active: Vec<usize>,
    unknowns: usize,
    /// Null vectors of A `[size][m]`, orthonormal.
    null: Mat<f64>,
    /// ‖A‖₂, computed on first use: its iteration takes longer than the factors of a small matrix.
    norm: OnceLock<f64>,
}

/// What is wrong with K, M or the null vectors. Messages count rows and columns from 1.
#[derive(Debug, Clone, PartialEq)]
pub enum Unfit {
    /// Of K.
    Matrix(String),
    /// Of the masses.
    Mass(String),
    /// Of the null vectors.
    Null(String),
}

impl fmt::Display for Unfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Unfit::Matrix(what) | Unfit::Mass(what) | Unfit::Null(what)) = self;
        f.write_str(what)
    }
}

impl Problem {
    /// Creates the problem. `mass`: diagonal of M; `null`: `[unknowns][m]` null vectors of K and of
    /// Kᵀ, m may be 0.
    ///
    /// # Errors
    /// [`Unfit`] if K, M or the null vectors are invalid.
    ///
    /// # Panics
    /// If there is no memory for A.
    pub fn new(
        k: &SparseColMat<usize, f64>,
        mass: &[f64],
        null: MatRef<'_, f64>,
    ) -> Result<Self, Unfit> {
        let unknowns = k.ncols();
        check(k, mass, null)?;
        let mut touched = vec![false; unknowns];
        for entry in k.triplet_iter().filter(|entry| *entry.val != 0.0) {
            touched[entry.row] = true;
            touched[entry.col] = true;
        }
        let active: Vec<usize> = (0..unknowns).filter(|&j| touched[j]).collect();
        let mut place = vec![usize::MAX; unknowns];
        active.iter().enumerate().for_each(|(at, &j)| place[j] = at);
        let root_mass: Vec<f64> = active.iter().map(|&j| mass[j].sqrt()).collect();
        let nonzero = k.triplet_iter().filter(|entry| *entry.val != 0.0);
        let entries = nonzero.map(|entry| {
            let (i, j) = (place[entry.row], place[entry.col]);
            Triplet::new(i, j, entry.val / (root_mass[i] * root_mass[j]))
        });
        let entries: Vec<_> = entries.collect();
        let a = SparseColMat::try_new_from_triplets(active.len(), active.len(), &entries)
            .expect("indices within the matrix");
        let mut problem = Problem {
            a,
            root_mass,
            active,
            unknowns,
            null: Mat::zeros(0, 0),
            norm: OnceLock::new(),
        };
        // Without stiffness nothing is left of null vectors.
        let left = if problem.size() == 0 { 0 } else { null.ncols() };
        problem.null = problem.orthonormal_null(null.subcols(0, left))?;
        Ok(problem)
    }

    /// Returns the number of unknowns of A.
    pub fn size(&self) -> usize {
        self.active.len()
    }

    /// Returns the number of unknowns of K.
    pub fn unknowns(&self) -> usize {
        self.unknowns
    }

    /// Returns the number of zero modes left out of A, one per empty row and column of K.
    pub fn rattling(&self) -> usize {
        self.unknowns - self.active.len()
    }

    /// Returns the null vectors `[size][m]`, orthonormal.
    pub fn null(&self) -> MatRef<'_, f64> {
        self.null.as_ref()
    }

    /// Returns A.
    pub fn matrix(&self) -> &SparseColMat<usize, f64> {
        &self.a
    }

    /// Row, column and value of the entries of M^(-1/2) C M^(-1/2), over the unknowns of A.
    pub(crate) fn scaled_by_mass<'c>(
        &'c self,
        c: &'c SparseColMat<usize, f64>,
    ) -> impl Iterator<Item = (usize, usize, f64)> + 'c {
        let mut place = vec![None; self.unknowns];
        for (at, &unknown) in self.active.iter().enumerate() {
            place[unknown] = Some(at);
        }
        c.triplet_iter().filter_map(move |entry| {
            let (row, column) = (place[entry.row]?, place[entry.col]?);
            let masses = self.root_mass[row] * self.root_mass[column];
            Some((row, column, entry.val / masses))
        })
    }

    /// Returns ‖A‖₂ by power iteration on AᵀA; too small by a few per cent at worst.
    pub fn norm(&self) -> f64 {
        *self.norm.get_or_init(|| self.two_norm())
    }

    /// Returns the greatest 2-norm of a column of A: a lower bound of ‖A‖₂ that costs one pass over
    /// the entries.
    pub(crate) fn greatest_column(&self) -> f64 {
        let columns = (0..self.size()).map(|j| self.a.val_of_col(j));
        let squares = columns.map(|column| column.iter().map(|a| a * a).sum::<f64>());
        squares.fold(0.0, f64::max).sqrt()
    }

    /// Computes y ← A x for each column.
    pub(crate) fn apply<T: Scalar>(&self, x: MatRef<'_, T>, mut y: MatMut<'_, T>) {
        for c in 0..x.ncols() {
            let (x, mut y) = (x.col(c), y.rb_mut().col_mut(c));
            y.fill(T::of(0.0));
            for j in 0..self.size() {
                let (rows, values) = (self.a.row_idx_of_col_raw(j), self.a.val_of_col(j));
                for (&i, &a) in rows.iter().zip(values) {
                    y[i] += T::of(a) * x[j];
                }
            }
        }
    }

    /// Computes y ← Aᵀ x for each column.
    pub(crate) fn apply_transposed<T: Scalar>(&self, x: MatRef<'_, T>, mut y: MatMut<'_, T>) {
        for c in 0..x.ncols() {
            let (x, mut y) = (x.col(c), y.rb_mut().col_mut(c));
            for j in 0..self.size() {
                let (rows, values) = (self.a.row_idx_of_col_raw(j), self.a.val_of_col(j));
                let products = rows.iter().zip(values).map(|(&i, &a)| T::of(a) * x[i]);
                y[j] = products.fold(T::of(0.0), |sum, product| sum + product);
            }
        }
    }

    /// Projects the null vectors out of every column of x.
    pub(crate) fn project<T: Scalar>(&self, mut x: MatMut<'_, T>) {
        for m in 0..self.null.ncols() {
            let null = self.null.col(m);
            for c in 0..x.ncols() {
                let mut x = x.rb_mut().col_mut(c);
                let along = (0..x.nrows()).map(|i| T::of(null[i]) * x[i]);
                let along = along.fold(T::of(0.0), |sum, product| sum + product);
                (0..x.nrows()).for_each(|i| x[i] -= T::of(null[i]) * along);
            }
        }
    }

    /// Returns M^(-1/2) b `[size][1]` for b over the unknowns of K. Entries for unknowns without
    /// stiffness are dropped.
    pub(crate) fn scaled(&self, b: &[f64]) -> Mat<f64> {
        Mat::from_fn(self.size(), 1, |i, _| b[self.active[i]] / self.root_mass[i])
    }

    /// Returns M^(-1/2) w over the unknowns of K, with 0 for those without stiffness; `w`
    /// `[size][1]`.
    pub(crate) fn unscaled(&self, w: MatRef<'_, f64>) -> Vec<f64> {
        let mut x = vec![0.0; self.unknowns];
        for (i, &at) in self.active.iter().enumerate() {
            x[at] = w[(i, 0)] / self.root_mass[i];
        }
        x
    }

    /// Returns v = M^(-1/2) w over the unknowns of K, normalised to ‖v‖ = 1; `w` over those of A.
    pub(crate) fn eigenvector(&self, w: &[c64]) -> Vec<c64> {
        let mut v = vec![c64::new(0.0, 0.0); self.unknowns];
        for ((&at, value), root) in self.active.iter().zip(w).zip(&self.root_mass) {
            v[at] = *value / *root;
        }
        let norm = v.iter().map(c64::norm_sqr).sum::<f64>().sqrt();
        for v in &mut v {
            *v /= norm;
        }
        v
    }

    fn two_norm(&self) -> f64 {
        const STEPS: usize = 40;
        let n = self.size();
        let mut x = Mat::from_fn(n, 1, |i, _| 1.0 + (i as f64 * 0.754877).fract());
        let mut y = Mat::zeros(n, 1);
        let mut norm = 0.0;
        for _ in 0..STEPS {
            let length = x.norm_l2();
            if length == 0.0 {
                break;
            }
            x /= faer::Scale(length);
            self.apply(x.as_ref(), y.as_mut());
            norm = f64::max(norm, y.norm_l2());
            self.apply_transposed(y.as_ref(), x.as_mut());
        }
        norm
    }

    /// Null vectors of A from those of K, checked for A and Aᵀ.
    fn orthonormal_null(&self, null: MatRef<'_, f64>) -> Result<Mat<f64>, Unfit> {
        let scale = self.greatest_column();
        let mut kept = Mat::<f64>::zeros(self.size(), null.ncols());
        let mut image = Mat::zeros(self.size(), 1);
        for column in 0..null.ncols() {
            let mut w = Mat::from_fn(self.size(), 1, |i, _| {
                self.root_mass[i] * null[(self.active[i], column)]
            });
            let before = w.norm_l2();
            for _ in 0..2 {
                let earlier = kept.subcols(0, column);
                let along = earlier.transpose() * &w;
                w -= earlier * along;
            }
            let length = w.norm_l2();
            if length <= 1e-10 * before || before == 0.0 {
                return Err(Unfit::Null(DEPENDENT.into()));
            }
            w /= faer::Scale(length);
            self.apply(w.as_ref(), image.as_mut());
            let mut residual = image.norm_l2();
            self.apply_transposed(w.as_ref(), image.as_mut());
            residual = residual.max(image.norm_l2()) / scale;
            if residual > ZERO {
                return Err(Unfit::Null(format!(
                    "column {}: leaves {residual:.1e} ‖K‖, must be a null vector of K and of its transpose",
                    column + 1
                )));
            }
            kept.col_mut(column).copy_from(w.col(0));
        }
        Ok(kept)
    }
}

fn check(k: &SparseColMat<usize, f64>, mass: &[f64], null: MatRef<'_, f64>) -> Result<(), Unfit> {
    let (rows, unknowns) = (k.nrows(), k.ncols());
    if rows != unknowns {
        let what = format!("{rows} × {unknowns}: K must be square");
        return Err(Unfit::Matrix(what));
    }
    if let Some(entry) = k.triplet_iter().find(|entry| !entry.val.is_finite()) {
        let (row, column) = (entry.row + 1, entry.col + 1);
        let what = format!("row {row}, column {column}: must be finite");
        return Err(Unfit::Matrix(what));
    }
    if mass.len() != unknowns {
        let given = mass.len();
        let what = format!("{given} masses: K has {unknowns} unknowns, each needs one");
        return Err(Unfit::Mass(what));
    }
    if let Some(row) = mass.iter().position(|m| !(m.is_finite() && *m > 0.0)) {
        let (value, row) = (mass[row], row + 1);
        let what = format!("row {row}: mass {value} must be positive and finite");
        return Err(Unfit::Mass(what));
    }
    if null.ncols() > 0 && null.nrows() != unknowns {
        let given = null.nrows();
        return Err(Unfit::Null(format!(
            "{given} rows: K has {unknowns} unknowns, a null vector needs a row for each"
        )));
    }
    Ok(())
}
