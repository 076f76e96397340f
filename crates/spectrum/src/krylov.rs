//! Block Krylov–Schur iteration for the invariant subspace of the largest eigenvalues of an
//! operator.

use faer::linalg::matmul::matmul;
use faer::reborrow::{Reborrow, ReborrowMut};
use faer::{Accum, Mat, MatMut, MatRef, Par, c64};
use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::scalar::Scalar;
use crate::schur::{Block, Schur};

/// Parameters of an iteration.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Settings {
    /// Number of eigenvalues wanted.
    pub(crate) count: usize,
    /// Number of vectors the operator is applied to at once. Eigenvalues up to this multiplicity
    /// are found in exact arithmetic.
    pub(crate) block: usize,
    /// Number of basis vectors.
    pub(crate) capacity: usize,
    /// Tolerance of the residual of an eigenvalue θ of the operator, over |θ|.
    pub(crate) tolerance: f64,
    /// Eigenvalues with |θ| below this are not wanted; the iteration ends when it meets one.
    pub(crate) floor: f64,
    /// Greatest number of restarts.
    pub(crate) restarts: usize,
    /// Parallelism of the dense operations.
    pub(crate) par: Par,
}

impl Settings {
    /// Those for so many eigenvalues of a matrix of this size, whatever their magnitude.
    fn for_count(self, count: usize, n: usize) -> Self {
        Settings {
            count,
            capacity: self.capacity.max((2 * count + 20).min(n)),
            floor: 0.0,
            ..self
        }
    }
}

/// An invariant subspace.
pub(crate) struct Subspace<T> {
    /// `[n][k]`, orthonormal. k is `count`; one more if a conjugate pair would be split; fewer if n
    /// is smaller or `floor` is met.
    pub(crate) basis: Mat<T>,
    /// Its eigenvalues θ, in the order of the iteration, k of them.
    pub(crate) values: Vec<c64>,
    /// Number of vectors the operator was applied to.
    pub(crate) applied: usize,
    /// Number of restarts.
    pub(crate) restarts: usize,
}

/// The iteration did not converge within its restarts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stalled {
    /// Number of eigenvalues that have converged.
    pub converged: usize,
}

/// Returns the invariant subspace of the eigenvalues of greatest |θ|, by Krylov–Schur in blocks
/// (Stewart 2001) with locking: converged vectors are decoupled from the residual and kept.
///
/// `operator` replaces the columns of its argument `[n][block]` by their images. The iteration
/// stays in its range, so directions that it projects out do not appear.
///
/// # Errors
/// [`Stalled`] if the restarts are used up.
pub(crate) fn largest<T: Scalar>(
    n: usize,
    operator: impl FnMut(MatMut<'_, T>),
    settings: Settings,
) -> Result<Subspace<T>, Stalled> {
    let block = settings.block.min(n).max(1);
    let capacity = settings.capacity.clamp((2 * block).min(n), n.max(1));
    let mut krylov = Krylov {
        operator,
        n,
        block,
        capacity,
        settings,
        basis: Mat::zeros(n, capacity + block),
        projected: DMatrix::zeros(capacity + block, capacity),
        used: 0,
        locked: 0,
        applied: 0,
        random: ChaCha8Rng::seed_from_u64(1),
    };
    krylov.start();
    for restart in 0..=settings.restarts {
        krylov.expand();
        if let Some((basis, values)) = krylov.contract() {
            return Ok(Subspace {
                basis,
                values,
                applied: krylov.applied,
                restarts: restart,
            });
        }
    }
    Err(Stalled {
        converged: krylov.locked,
    })
}

/// Greatest number of subspaces tried to match the two sides.
const MATCHES: u32 = 12;
/// Of those, with sides of one size whose eigenvalues differ.
const UNEQUAL: u32 = 3;
/// Relative difference of |θ| up to which eigenvalues of the two sides are the same.
const SAME: f64 = 1e-6;

/// Returns a right and a left invariant subspace of the same eigenvalues: `right`, or a larger one
/// if the other side cannot be cut there. Where eigenvalues are equally large, each side has its
/// own order, and one may cut between a conjugate pair, or between two eigenvalues, that the other
/// keeps together.
///
/// `operator(false, x)` is that of `right`, `operator(true, x)` its adjoint.
///
/// # Errors
/// [`Stalled`] if the restarts are used up, or no cut fits both sides.
pub(crate) fn matched<T: Scalar>(
    n: usize,
    mut right: Subspace<T>,
    mut operator: impl FnMut(bool, MatMut<'_, T>),
    settings: Settings,
) -> Result<[Subspace<T>; 2], Stalled> {
    let converged = right.basis.ncols();
    let mut unequal = Vec::new();
    for attempt in 0..MATCHES {
        let count = right.basis.ncols();
        let left = largest(n, |x| operator(true, x), settings.for_count(count, n))?;
        let cut = left.basis.ncols();
        if cut == count && have_same_values(&right, &left) {
            return Ok([right, left]);
        }
        let wider = cut.max(count + 2usize.pow(attempt)).min(n);
        if cut == count {
            unequal.push([right, left]);
            if unequal.len() as u32 == UNEQUAL || count == n {
                break;
            }
        }
        right = largest(n, |x| operator(false, x), settings.for_count(wider, n))?;
    }
    // Eigenvalues that rounding moves by more than `SAME` still have both sides.
    unequal.into_iter().next().ok_or(Stalled { converged })
}

fn have_same_values<T: Scalar>(right: &Subspace<T>, left: &Subspace<T>) -> bool {
    let mut rest: Vec<c64> = left.values.iter().map(c64::conj).collect();
    for value in &right.values {
        let same = rest
            .iter()
            .position(|other| (value - other).norm() <= SAME * value.norm());
        let Some(k) = same else {
            return false;
        };
        rest.swap_remove(k);
    }
    true
}

/// The decomposition OP V = (V, U) H, where V are the first `used` columns of the basis and U the
/// `block` columns after them.
struct Krylov<T: Scalar, F> {
    operator: F,
    n: usize,
    block: usize,
    capacity: usize,
    settings: Settings,
    basis: Mat<T>,
    projected: DMatrix<T>,
    used: usize,
    locked: usize,
    applied: usize,
    random: ChaCha8Rng,
}

impl<T: Scalar, F: FnMut(MatMut<'_, T>)> Krylov<T, F> {
    /// Starts with random vectors, mapped once by the operator into its range.
    fn start(&mut self) {
        for j in 0..self.block {
            self.fill_random(j);
        }
        (self.operator)(self.basis.subcols_mut(0, self.block));
        self.applied += self.block;
        self.orthonormalise_block(0, self.block);
    }

    fn fill_random(&mut self, column: usize) {
        for i in 0..self.n {
            self.basis[(i, column)] = T::of(self.random.random_range(-1.0..1.0));
        }
    }

    /// Applies the operator block by block until the basis is full.
    fn expand(&mut self) {
        while self.used < self.capacity {
            let block = self.block.min(self.capacity - self.used);
            let (done, mut next) = self.basis.as_mut().split_at_col_mut(self.used + self.block);
            let mut next = next.rb_mut().subcols_mut(0, block);
            next.copy_from(done.rb().subcols(self.used, block));
            (self.operator)(next);
            self.applied += block;
            let first = self.used + self.block;
            let coefficients = self.orthonormalise_block(first, block);
            for c in 0..block {
                let mut column = self.projected.column_mut(self.used + c);
                column.fill(T::of(0.0));
                (0..first + block).for_each(|i| column[i] = coefficients[(i, c)]);
            }
            self.used += block;
        }
    }

    /// Makes the columns from `first` on orthonormal to all earlier ones and to each other, by
    /// classical Gram–Schmidt applied twice.
    ///
    /// Returns the coefficients `[first + block][block]` of the original columns in the new basis.
    fn orthonormalise_block(&mut self, first: usize, block: usize) -> DMatrix<T> {
        let par = self.settings.par;
        let mut coefficients = DMatrix::zeros(first + block, block);
        let (done, mut next) = self.basis.as_mut().split_at_col_mut(first);
        let mut next = next.rb_mut().subcols_mut(0, block);
        let size: Vec<f64> = (0..block).map(|c| next.rb().col(c).norm_l2()).collect();
        for _ in 0..2 {
            let along = take_out(done.rb(), next.rb_mut(), par);
            for c in 0..block {
                (0..first).for_each(|i| coefficients[(i, c)] += along[(i, c)]);
            }
        }
        for (c, &size) in size.iter().enumerate() {
            let mut left = 0.0;
            for attempt in 0..3 {
                let (done, rest) = self.basis.as_mut().split_at_col_mut(first + c);
                let mut column = rest.subcols_mut(0, 1);
                // Against the columns of the block; against all columns if so little was left that
                // rounding shows.
                let from = if attempt == 0 { first } else { 0 };
                let before = column.norm_l2();
                for _ in 0..2 {
                    let against = done.rb().subcols(from, first + c - from);
                    let along = take_out(against, column.rb_mut(), par);
                    (from..first + c).for_each(|i| coefficients[(i, c)] += along[(i - from, 0)]);
                }
                left = column.norm_l2();
                if left > 0.1 * before || left <= f64::EPSILON * size {
                    break;
                }
            }
            if left > 4.0 * f64::EPSILON * size && left.is_normal() {
                coefficients[(first + c, c)] = T::of(left);
                let inverse = T::of(1.0 / left);
                let mut column = self.basis.col_mut(first + c);
                (0..self.n).for_each(|i| column[i] *= inverse);
            } else {
                self.replace(first + c);
            }
        }
        coefficients
    }

    /// Continues from a column that is dependent on the basis: with a random vector from the
    /// operator's range, or with zero if the basis spans everything.
    fn replace(&mut self, at: usize) {
        if at >= self.n {
            self.basis.col_mut(at).fill(T::of(0.0));
            return;
        }
        let par = self.settings.par;
        self.fill_random(at);
        (self.operator)(self.basis.subcols_mut(at, 1));
        self.applied += 1;
        let (done, rest) = self.basis.as_mut().split_at_col_mut(at);
        let mut column = rest.subcols_mut(0, 1);
        let size = column.norm_l2();
        let mut left = size;
        for _ in 0..3 {
            take_out(done.rb(), column.rb_mut(), par);
            left = column.norm_l2();
            let inverse = if left > 1e-13 * size {
                T::of(1.0 / left)
            } else {
                T::of(0.0)
            };
            (0..self.n).for_each(|i| column[(i, 0)] *= inverse);
        }
        if left.is_nan() {
            column.fill(T::of(0.0));
        }
    }

    /// Sorts the Schur form and locks what has converged. Returns the subspace and its eigenvalues
    /// if it is complete; otherwise keeps the better part of the basis.
    fn contract(&mut self) -> Option<(Mat<T>, Vec<c64>)> {
        let (used, block) = (self.used, self.block);
        let square = self.projected.view((0, 0), (used, used)).clone_owned();
        let coupling = self.projected.view((used, 0), (block, used)).clone_owned();
        // Rounding scales with the norm of the operator, which exceeds its eigenvalues if it is
        // non-normal.
        let rounding = 2.0 * f64::EPSILON * square.norm();
        let schur = Schur::ordered(square, c64::norm)?;
        let mut coupling = coupling * &schur.q;
        let mut converged = 0;
        let mut at_floor = false;
        for part in &schur.blocks {
            let mut values = part.values.iter();
            at_floor = values.all(|value| value.norm() < self.settings.floor);
            if at_floor {
                break;
            }
            let residual = coupling.columns(part.start, part.size).norm();
            let size = part.values[0].norm();
            if residual > (self.settings.tolerance * size).max(rounding) {
                break;
            }
            coupling.columns_mut(part.start, part.size).fill(T::of(0.0));
            converged = part.end();
        }
        self.locked = converged;
        if converged >= self.settings.count || at_floor || converged == used && used == self.n {
            let most = if at_floor { converged } else { used };
            let wanted = self.settings.count.min(most);
            if wanted == 0 {
                return Some((Mat::zeros(self.n, 0), Vec::new()));
            }
            let mut ends = schur.blocks.iter().map(Block::end);
            let end = ends.find(|&end| end >= wanted);
            let end = end.expect("the last block ends at `used`");
            let blocks = schur.blocks.iter();
            let values = blocks.flat_map(|part| &part.values[..part.size]).take(end);
            return Some((self.turned(&schur.q, end), values.copied().collect()));
        }

        let count = self.settings.count.min(used);
        let room = used.saturating_sub(2 * block).max(1);
        let target = (count + (used - count) / 2).max(converged).min(room);
        let ends = schur.blocks.iter().map(Block::end);
        let kept = ends.take_while(|&end| end <= target).last().unwrap_or(0);
        let basis = self.turned(&schur.q, kept);
        let residual = self.basis.subcols(used, block).to_owned();
        self.basis.subcols_mut(0, kept).copy_from(&basis);
        self.basis.subcols_mut(kept, block).copy_from(&residual);
        self.projected.fill(T::of(0.0));
        let square = schur.t.view((0, 0), (kept, kept));
        let mut to = self.projected.view_mut((0, 0), (kept, kept));
        to.copy_from(&square);
        let mut to = self.projected.view_mut((kept, 0), (block, kept));
        to.copy_from(&coupling.columns(0, kept));
        self.used = kept;
        None
    }

    /// V Q over the first `count` columns of Q.
    fn turned(&self, q: &DMatrix<T>, count: usize) -> Mat<T> {
        let small = Mat::from_fn(q.nrows(), count, |i, j| q[(i, j)]);
        let mut out = Mat::zeros(self.n, count);
        let (basis, par) = (self.basis.subcols(0, q.nrows()), self.settings.par);
        let product = out.as_mut();
        matmul(product, Accum::Replace, basis, small.rb(), T::of(1.0), par);
        out
    }
}

/// w ← w - V Vᴴ w; returns Vᴴ w.
fn take_out<T: Scalar>(v: MatRef<'_, T>, w: MatMut<'_, T>, par: Par) -> Mat<T> {
    let mut along = Mat::zeros(v.ncols(), w.ncols());
    let to = along.as_mut();
    matmul(to, Accum::Replace, v.adjoint(), w.rb(), T::of(1.0), par);
    matmul(w, Accum::Add, v, along.as_ref(), T::of(-1.0), par);
    along
}
