//! Multifrontal LU factorisation of A - σI (Duff & Reid 1983).
//!
//! A front F has `width` pivots and `reach` later unknowns that the pivots update:
//!
//! ```text
//!     ( F₁₁  F₁₂ )   F₁₁ [width][width]   F₁₂ [width][reach]
//! F = (          )
//!     ( F₂₁  F₂₂ )   F₂₁ [reach][width]   F₂₂ [reach][reach]
//! ```
//!
//! With the row permutation P it is eliminated as P F₁₁ = L₁₁ U₁₁, L₂₁ = F₂₁ U₁₁⁻¹, U₁₂ = L₁₁⁻¹ P
//! F₁₂; the update F₂₂ - L₂₁ U₁₂ is added to the parent front.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::factor::{lu_in_place, lu_in_place_scratch};
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_unit_lower_triangular_in_place,
    solve_unit_upper_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::reborrow::{Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef, Par, Spec, c64};

use crate::scalar::Scalar;
use crate::symbolic::{Front, MatrixEntry, Symbolic};

/// Pivots below this times the largest entry of A - σI count as zero. The matrix is then singular
/// in double precision, or needs a pivot from outside the front.
const LEAST_PIVOT: f64 = 1e-13;

/// The factors of A - σI, front by front.
pub(crate) struct Lu<'a, T> {
    symbolic: &'a Symbolic,
    factors: Vec<Factor<T>>,
    par: Par,
}

struct Factor<T> {
    /// `[width + reach][width]` by columns: L₁₁ and U₁₁ share the upper square, L₂₁ is below it.
    panel: Vec<T>,
    /// U₁₂ `[width][reach]` by columns.
    rows: Vec<T>,
    /// P: row `pivot[i]` of F₁₁ becomes row i.
    pivot: Vec<usize>,
    /// Whether P is odd, for the sign of the determinant.
    odd: bool,
}

/// The error of the factorisation: the pivots of a front are too small.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Singular;

impl<'a, T: Scalar> Lu<'a, T> {
    /// Factors A - σI with σ = `shift`. `values`: the entries of A, in the order of the pattern
    /// from which `symbolic` was made.
    ///
    /// # Errors
    /// [`Singular`] if a pivot is smaller than `LEAST_PIVOT` allows.
    pub(crate) fn new(
        symbolic: &'a Symbolic,
        values: &[f64],
        shift: T,
        par: Par,
    ) -> Result<Self, Singular> {
        let largest = values
            .iter()
            .fold(shift.widened().norm(), |most, v| most.max(v.abs()));
        let mut updates: Vec<Vec<T>> = symbolic.fronts.iter().map(|_| Vec::new()).collect();
        let mut factors = Vec::with_capacity(symbolic.fronts.len());
        for (s, front) in symbolic.fronts.iter().enumerate() {
            let mut matrix = FrontMatrix::zeros(front);
            matrix.add_entries(&symbolic.entries[s], values);
            matrix.subtract_from_diagonal(shift);
            for &child in &front.children {
                let reach = symbolic.fronts[child].reach.iter();
                let place: Vec<usize> = reach.map(|&pivot| front.place(pivot)).collect();
                matrix.add_update(&std::mem::take(&mut updates[child]), &place);
            }
            let (factor, update) = matrix.eliminate(par);
            if !factor.regular(front.width, LEAST_PIVOT * largest) {
                return Err(Singular);
            }
            factors.push(factor);
            updates[s] = update;
        }
        Ok(Lu {
            symbolic,
            factors,
            par,
        })
    }

    /// Solves for all columns: x ← (A - σI)⁻¹ x, or x ← (A - σI)⁻ᵀ x.
    pub(crate) fn solve(&self, transposed: bool, mut x: MatMut<'_, T>) {
        let (n, columns) = (x.nrows(), x.ncols());
        let order = &self.symbolic.order;
        // The rows in the order of elimination.
        let mut inner = vec![T::of(0.0); n * columns];
        for (j, column) in inner.chunks_exact_mut(n.max(1)).enumerate() {
            let from = x.rb().col(j);
            for (to, &i) in column.iter_mut().zip(order) {
                *to = from[i];
            }
        }
        let mut scratch = Vec::new();
        let mut permuted = MatMut::from_column_major_slice_mut(&mut inner, n, columns);
        let fronts = self.symbolic.fronts.iter().zip(&self.factors);
        for (front, factor) in fronts.clone() {
            factor.forward(front, transposed, permuted.rb_mut(), &mut scratch, self.par);
        }
        for (front, factor) in fronts.rev() {
            factor.backward(front, transposed, permuted.rb_mut(), &mut scratch, self.par);
        }
        for (j, column) in inner.chunks_exact(n.max(1)).enumerate() {
            let mut to = x.rb_mut().col_mut(j);
            for (from, &i) in column.iter().zip(order) {
                to[i] = *from;
            }
        }
    }

    /// Returns det(A - σI) / |det(A - σI)|.
    pub(crate) fn phase(&self) -> c64 {
        let mut phase = c64::new(1.0, 0.0);
        for (front, factor) in self.symbolic.fronts.iter().zip(&self.factors) {
            let height = front.height();
            for j in 0..front.width {
                let pivot = factor.panel[j * height + j].widened();
                phase *= pivot / pivot.norm();
            }
            phase *= if factor.odd { -1.0 } else { 1.0 };
            phase /= phase.norm();
        }
        phase
    }
}

/// The matrix of a front.
struct FrontMatrix<T> {
    width: usize,
    reach: usize,
    /// F₁₁ above F₂₁, `[width + reach][width]` by columns.
    panel: Vec<T>,
    /// F₁₂ `[width][reach]` by columns.
    rows: Vec<T>,
    /// F₂₂ `[reach][reach]` by columns.
    update: Vec<T>,
}

impl<T: Scalar> FrontMatrix<T> {
    fn zeros(front: &Front) -> Self {
        let (width, reach) = (front.width, front.reach.len());
        Self {
            width,
            reach,
            panel: vec![T::of(0.0); front.height() * width],
            rows: vec![T::of(0.0); width * reach],
            update: vec![T::of(0.0); reach * reach],
        }
    }

    fn height(&self) -> usize {
        self.width + self.reach
    }

    /// Adds entries of A; `values`: all of A.
    fn add_entries(&mut self, entries: &[MatrixEntry], values: &[f64]) {
        for entry in entries {
            let value = T::of(values[entry.value as usize]);
            match (entry.place as usize).checked_sub(self.panel.len()) {
                Some(at) => self.rows[at] += value,
                None => self.panel[entry.place as usize] += value,
            }
        }
    }

    fn subtract_from_diagonal(&mut self, shift: T) {
        let height = self.height();
        (0..self.width).for_each(|j| self.panel[j * height + j] -= shift);
    }

    /// Adds the update matrix of a child. `place`, ascending: the indices of its rows and columns
    /// here.
    fn add_update(&mut self, update: &[T], place: &[usize]) {
        let count = place.len();
        let (width, height, reach) = (self.width, self.height(), self.reach);
        let inside = place.partition_point(|&place| place < width);
        for (column, &j) in update.chunks_exact(count.max(1)).zip(place) {
            if j < width {
                let to = &mut self.panel[j * height..(j + 1) * height];
                for (&i, value) in place.iter().zip(column) {
                    to[i] += *value;
                }
                continue;
            }
            let to = &mut self.rows[(j - width) * width..(j - width + 1) * width];
            let first = place[..inside].iter().zip(column);
            first.for_each(|(&i, value)| to[i] += *value);
            let to = &mut self.update[(j - width) * reach..(j - width + 1) * reach];
            let rest = place[inside..].iter().zip(&column[inside..]);
            rest.for_each(|(&i, value)| to[i - width] += *value);
        }
    }

    /// Eliminates the pivots. Returns their factors, and F₂₂ - L₂₁ U₁₂.
    fn eliminate(self, par: Par) -> (Factor<T>, Vec<T>) {
        let FrontMatrix {
            width,
            reach,
            mut panel,
            mut rows,
            mut update,
        } = self;
        let (mut pivot, mut inverse) = (vec![0usize; width], vec![0usize; width]);
        let columns = MatMut::from_column_major_slice_mut(&mut panel, width + reach, width);
        let (mut square, mut below) = columns.split_at_row_mut(width);
        let needed = lu_in_place_scratch::<usize, T>(width, width, par, Spec::default());
        let mut memory = MemBuffer::new(needed);
        let (info, _) = lu_in_place(
            square.rb_mut(),
            &mut pivot,
            &mut inverse,
            par,
            MemStack::new(&mut memory),
            Spec::default(),
        );
        let mut scratch = vec![T::of(0.0); width];
        for column in rows.chunks_exact_mut(width) {
            scratch.copy_from_slice(column);
            for (to, &i) in column.iter_mut().zip(&pivot) {
                *to = scratch[i];
            }
        }
        if reach > 0 {
            let mut right = MatMut::from_column_major_slice_mut(&mut rows, width, reach);
            solve_unit_lower_triangular_in_place(square.rb(), right.rb_mut(), par);
            let upper = square.rb().transpose();
            solve_lower_triangular_in_place(upper, below.rb_mut().transpose_mut(), par);
            let update = MatMut::from_column_major_slice_mut(&mut update, reach, reach);
            matmul(update, Accum::Add, below.rb(), right.rb(), T::of(-1.0), par);
        }
        let factor = Factor {
            panel,
            rows,
            pivot,
            odd: info.transposition_count % 2 == 1,
        };
        (factor, update)
    }
}

impl<T: Scalar> Factor<T> {
    /// Whether all pivots are finite and greater than `least` in magnitude.
    fn regular(&self, width: usize, least: f64) -> bool {
        let height = self.panel.len() / width;
        let mut pivots = (0..width).map(|j| self.panel[j * height + j].widened().norm());
        // Not `!(pivot <= least)`, which NaN would pass.
        pivots.all(|size| size.is_finite() && size > least)
    }

    /// The square that holds L₁₁ and U₁₁; L₂₁; U₁₂.
    fn blocks(&self, front: &Front) -> (MatRef<'_, T>, MatRef<'_, T>, MatRef<'_, T>) {
        let (width, reach) = (front.width, front.reach.len());
        let columns = MatRef::from_column_major_slice(&self.panel, width + reach, width);
        let (square, below) = columns.split_at_row(width);
        let right = MatRef::from_column_major_slice(&self.rows, width, reach);
        (square, below, right)
    }

    /// Solves with P and L₁₁, and subtracts L₂₁ times the result from the later unknowns;
    /// transposed: with U₁₁ᵀ, and U₁₂ᵀ times the result.
    fn forward(
        &self,
        front: &Front,
        transposed: bool,
        mut x: MatMut<'_, T>,
        scratch: &mut Vec<T>,
        par: Par,
    ) {
        let (square, below, right) = self.blocks(front);
        let mut pivots = x.rb_mut().subrows_mut(front.begin, front.width);
        if transposed {
            solve_lower_triangular_in_place(square.transpose(), pivots, par);
            return subtract_from_later(front, x, right.transpose(), scratch, par);
        }
        for j in 0..pivots.ncols() {
            let mut column = pivots.rb_mut().col_mut(j);
            scratch.clear();
            scratch.extend(self.pivot.iter().map(|&i| column[i]));
            for (i, value) in scratch.iter().enumerate() {
                column[i] = *value;
            }
        }
        solve_unit_lower_triangular_in_place(square, pivots, par);
        subtract_from_later(front, x, below, scratch, par);
    }

    /// Subtracts U₁₂ times the later unknowns, and solves with U₁₁; transposed: L₂₁ᵀ times these,
    /// and solves with L₁₁ᵀ and Pᵀ.
    fn backward(
        &self,
        front: &Front,
        transposed: bool,
        mut x: MatMut<'_, T>,
        scratch: &mut Vec<T>,
        par: Par,
    ) {
        let (square, below, right) = self.blocks(front);
        let block = if transposed { below.transpose() } else { right };
        subtract_from_pivots(front, x.rb_mut(), block, scratch, par);
        let mut pivots = x.subrows_mut(front.begin, front.width);
        if !transposed {
            return solve_upper_triangular_in_place(square, pivots, par);
        }
        solve_unit_upper_triangular_in_place(square.transpose(), pivots.rb_mut(), par);
        for j in 0..pivots.ncols() {
            let mut column = pivots.rb_mut().col_mut(j);
            scratch.clear();
            scratch.extend((0..front.width).map(|i| column[i]));
            let back = self.pivot.iter().zip(scratch.iter());
            back.for_each(|(&i, value)| column[i] = *value);
        }
    }
}

/// Subtracts `block` times the rows of x at the pivots of the front from the rows at its later
/// unknowns.
fn subtract_from_later<T: Scalar>(
    front: &Front,
    mut x: MatMut<'_, T>,
    block: MatRef<'_, T>,
    scratch: &mut Vec<T>,
    par: Par,
) {
    let (reach, columns) = (front.reach.len(), x.ncols());
    if reach == 0 {
        return;
    }
    scratch.clear();
    scratch.resize(reach * columns, T::of(0.0));
    let pivots = x.rb().subrows(front.begin, front.width);
    let product = MatMut::from_column_major_slice_mut(scratch, reach, columns);
    matmul(product, Accum::Replace, block, pivots, T::of(1.0), par);
    for (j, product) in scratch.chunks_exact(reach).enumerate() {
        let mut column = x.rb_mut().col_mut(j);
        for (&i, value) in front.reach.iter().zip(product) {
            column[i] -= *value;
        }
    }
}

/// Subtracts `block` times the rows of x at the later unknowns of the front from the rows at its
/// pivots.
fn subtract_from_pivots<T: Scalar>(
    front: &Front,
    mut x: MatMut<'_, T>,
    block: MatRef<'_, T>,
    scratch: &mut Vec<T>,
    par: Par,
) {
    let (reach, columns) = (front.reach.len(), x.ncols());
    if reach == 0 {
        return;
    }
    scratch.clear();
    for j in 0..columns {
        let column = x.rb().col(j);
        scratch.extend(front.reach.iter().map(|&i| column[i]));
    }
    let later = MatRef::from_column_major_slice(scratch.as_slice(), reach, columns);
    let pivots = x.rb_mut().subrows_mut(front.begin, front.width);
    matmul(pivots, Accum::Add, block, later, T::of(-1.0), par);
}
