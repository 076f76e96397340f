//! Eigenvalues with residuals, condition numbers and a verdict on what they are evidence of.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, evd_real, evd_scratch};
use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, MatRef, Par, Spec, c64, concat};

use crate::lu::Lu;
use crate::problem::{Problem, ZERO};
use crate::scalar::Scalar;
use crate::symbolic::Symbolic;

/// All eigenvalues of a matrix by the QR algorithm on one thread.
///
/// # Panics
/// If it does not converge.
pub(crate) fn values_of(matrix: MatRef<'_, f64>) -> Vec<c64> {
    let n = matrix.ncols();
    let (mut re, mut im) = (Diag::<f64>::zeros(n), Diag::<f64>::zeros(n));
    let no = ComputeEigenvectors::No;
    let scratch = evd_scratch::<f64>(n, no, no, Par::Seq, Spec::default());
    evd_real(
        matrix,
        re.as_mut(),
        im.as_mut(),
        None,
        None,
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(scratch)),
        Spec::default(),
    )
    .expect("the QR algorithm converges");
    (0..n).map(|k| c64::new(re[k], im[k])).collect()
}

/// What an eigenvalue is evidence of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Zero: |λ| ≤ 10⁻¹² ‖A‖.
    Zero,
    /// Real: |Im λ| ≤ 10⁻¹² ‖A‖, the rounding error that complex shifts leave.
    Real,
    /// One of a conjugate pair.
    Pair,
    /// An imaginary part that rounding alone may have caused: evidence neither for nor against a
    /// pair.
    Doubtful,
}

impl Verdict {
    /// All verdicts.
    pub const ALL: [Verdict; 4] = [
        Verdict::Zero,
        Verdict::Real,
        Verdict::Pair,
        Verdict::Doubtful,
    ];

    /// Judges by the value alone, for a matrix of this norm. At an exceptional point rounding may
    /// cause an imaginary part up to √ε ‖A‖.
    pub fn of_value(value: c64, norm: f64) -> Self {
        let (size, imaginary) = (value.norm() / norm, value.im.abs() / norm);
        if size <= ZERO {
            Verdict::Zero
        } else if imaginary <= ZERO {
            Verdict::Real
        } else if imaginary > f64::EPSILON.sqrt() {
            Verdict::Pair
        } else {
            Verdict::Doubtful
        }
    }

    /// Returns the name in tables.
    pub fn name(self) -> &'static str {
        ["zero", "real", "pair", "doubtful"][self as usize]
    }
}

/// An eigenvalue of A. Its vectors are columns of [`Spectrum`].
#[derive(Debug, Clone, Copy)]
pub struct Eigenvalue {
    /// λ.
    pub value: c64,
    /// ‖A w - λ w‖ / (‖A‖ ‖w‖).
    pub residual: f64,
    /// Condition number 1/|yᴴ w| of the unit left and right vectors: the change of λ over the
    /// change of A. Infinite if λ is defective.
    pub condition: f64,
    /// What the eigenvalue is evidence of.
    pub verdict: Verdict,
}

impl Eigenvalue {
    /// Rounding moves λ by about its condition times ε; at an exceptional point of two eigenvalues
    /// by √ε, of more by more, and the condition grows accordingly. An imaginary part below either
    /// is no evidence.
    fn judged(problem: &Problem, value: c64, residual: f64, condition: f64) -> Self {
        let relative = value / problem.norm();
        let rounding = 10.0 * condition * residual.max(f64::EPSILON);
        let verdict = match Verdict::of_value(relative, 1.0) {
            Verdict::Pair if relative.im.abs() <= rounding => Verdict::Doubtful,
            verdict => verdict,
        };
        Self {
            value,
            residual,
            condition,
            verdict,
        }
    }

    /// |λ - σ|.
    pub(crate) fn distance(&self, shift: c64) -> f64 {
        (self.value - shift).norm()
    }
}

/// Greatest residual accepted for an eigenvalue; see [`Spectrum::refine`].
pub const RESIDUAL: f64 = 1e-12;
/// Greatest number of solves to reach it.
const SOLVES: usize = 3;

/// Eigenvalues and eigenvectors of a problem.
pub struct Spectrum {
    /// Eigenvalues, k of them.
    pub eigenvalues: Vec<Eigenvalue>,
    /// Right vectors w of A w = λ w, `[size][k]`, of length 1.
    pub right: Mat<c64>,
    /// Left vectors y of yᴴ A = λ yᴴ, `[size][k]`, with yᴴ w = 1. Without a left subspace they are
    /// the dual basis within the right one.
    pub left: Mat<c64>,
}

impl Spectrum {
    /// Rayleigh–Ritz projection: the eigenvalues of XᴴAX for X = `right` `[size][k]`, orthonormal.
    /// `left` is the left invariant subspace of the same eigenvalues; without it condition numbers
    /// are those within the right subspace, which are lower bounds.
    ///
    /// # Panics
    /// If the QR algorithm does not converge.
    pub(crate) fn of<T: Scalar>(problem: &Problem, right: &Mat<T>, left: Option<&Mat<T>>) -> Self {
        let mut image = Mat::zeros(right.nrows(), right.ncols());
        problem.apply(right.as_ref(), image.as_mut());
        let small = right.adjoint() * &image;
        let (values, vectors) = eigen(&small);
        let right = widened(right.as_ref()) * normalised(vectors);
        let left = left.map(|left| widened(left.as_ref()));
        let left = left.as_ref().map_or(right.as_ref(), Mat::as_ref);
        Spectrum::with_vectors(problem, values, right.clone(), dual(left, right.as_ref()))
    }

    /// Returns all eigenvalues of a problem, in no order, by the QR algorithm on A as a dense
    /// matrix.
    ///
    /// Without vectors and verdicts this is about five times as fast as [`Spectrum::dense`]. It
    /// runs on one thread, so that the result is reproducible.
    ///
    /// # Panics
    /// If the QR algorithm does not converge.
    pub fn values(problem: &Problem) -> Vec<c64> {
        values_of(problem.matrix().to_dense().as_ref())
    }

    /// Returns all eigenvalues and vectors of a problem by the QR algorithm on A as a dense matrix,
    /// on as many threads as faer may use (`faer::set_global_parallelism`).
    ///
    /// # Panics
    /// If the QR algorithm does not converge.
    pub fn dense(problem: &Problem) -> Self {
        let n = problem.size();
        let (values, vectors) = eigen(&problem.matrix().to_dense());
        let right = normalised(vectors);
        // The left vectors are the rows of the inverse of the right ones.
        let left = if n > 0 {
            right.partial_piv_lu().inverse().adjoint().to_owned()
        } else {
            Mat::zeros(0, 0)
        };
        Spectrum::with_vectors(problem, values, right, left)
    }

    fn with_vectors(problem: &Problem, values: Vec<c64>, right: Mat<c64>, left: Mat<c64>) -> Self {
        let mut eigenvalues = Vec::with_capacity(values.len());
        for (k, value) in values.into_iter().enumerate() {
            let residual = residual(problem, right.subcols(k, 1), value);
            let norm = left.col(k).norm_l2();
            // A left vector that is not a number is that of a defective eigenvalue.
            let condition = if norm.is_nan() { f64::INFINITY } else { norm };
            eigenvalues.push(Eigenvalue::judged(problem, value, residual, condition));
        }
        Spectrum {
            eigenvalues,
            right,
            left,
        }
    }

    /// Reduces residuals above [`RESIDUAL`] by inverse iteration at the eigenvalue, with the
    /// Rayleigh quotient as the new value. Left vectors stay unchanged. Returns the number of
    /// eigenvalues whose residual remains above.
    pub fn refine(&mut self, problem: &Problem, symbolic: &Symbolic, par: Par) -> usize {
        let mut left_over = 0;
        for k in 0..self.eigenvalues.len() {
            for _ in 0..SOLVES {
                if self.eigenvalues[k].residual <= RESIDUAL
                    || !self.improve(k, problem, symbolic, par)
                {
                    break;
                }
            }
            left_over += usize::from(self.eigenvalues[k].residual > RESIDUAL);
        }
        left_over
    }

    /// One step of inverse iteration; returns false if it does not reduce the residual.
    fn improve(&mut self, k: usize, problem: &Problem, symbolic: &Symbolic, par: Par) -> bool {
        let old = self.eigenvalues[k];
        // Shifted off the eigenvalue by 1e-11 ‖A‖: at the eigenvalue itself the pivots vanish.
        let shift = old.value + 1e-11 * problem.norm();
        let Ok(lu) = Lu::new(symbolic, problem.matrix().val(), shift, par) else {
            return false;
        };
        let mut w = self.right.subcols(k, 1).to_owned();
        lu.solve(false, w.as_mut());
        let length = w.norm_l2();
        if !length.is_normal() {
            return false;
        }
        w /= faer::Scale(c64::new(length, 0.0));
        let mut image = Mat::zeros(problem.size(), 1);
        problem.apply(w.as_ref(), image.as_mut());
        let value = (w.adjoint() * &image)[(0, 0)];
        let residual = residual(problem, w.as_ref(), value);
        if residual.is_nan() || residual >= old.residual {
            return false;
        }
        self.right.col_mut(k).copy_from(w.col(0));
        self.eigenvalues[k] = Eigenvalue::judged(problem, value, residual, old.condition);
        true
    }

    /// Returns the k-th right eigenvector v of K v = λ M v over the unknowns of K, of length 1.
    pub fn eigenvector(&self, problem: &Problem, k: usize) -> Vec<c64> {
        let w: Vec<c64> = (0..problem.size()).map(|i| self.right[(i, k)]).collect();
        problem.eigenvector(&w)
    }

    /// Returns the eigenvalues for which `kept` is true, sorted by `key`.
    pub fn arranged(
        &self,
        kept: impl Fn(&Eigenvalue) -> bool,
        key: impl Fn(&Eigenvalue) -> f64,
    ) -> Spectrum {
        let all = 0..self.eigenvalues.len();
        let mut order: Vec<usize> = all.filter(|&k| kept(&self.eigenvalues[k])).collect();
        order.sort_by(|&a, &b| {
            let [a, b] = [a, b].map(|k| &self.eigenvalues[k]);
            let upper_first = b.value.im.total_cmp(&a.value.im);
            key(a).total_cmp(&key(b)).then(upper_first)
        });
        Spectrum {
            eigenvalues: order.iter().map(|&k| self.eigenvalues[k]).collect(),
            right: columns(&self.right, &order),
            left: columns(&self.left, &order),
        }
    }

    /// Returns the complex conjugates of the eigenvalues for which `kept` is true.
    pub(crate) fn mirrored(&self, kept: impl Fn(&Eigenvalue) -> bool) -> Spectrum {
        let mut out = self.arranged(kept, |e| e.value.re);
        out.eigenvalues
            .iter_mut()
            .for_each(|e| e.value = e.value.conj());
        for vectors in [&mut out.right, &mut out.left] {
            *vectors = vectors.conjugate().to_owned();
        }
        out
    }

    /// Appends other eigenvalues of the same problem.
    pub(crate) fn append(&mut self, other: Spectrum) {
        self.eigenvalues.extend(other.eigenvalues);
        self.right = concat![[self.right, other.right]];
        self.left = concat![[self.left, other.left]];
    }
}

/// These columns, in this order.
fn columns(vectors: &Mat<c64>, order: &[usize]) -> Mat<c64> {
    Mat::from_fn(vectors.nrows(), order.len(), |i, j| vectors[(i, order[j])])
}

/// ‖A w - λ w‖ / ‖A‖ of one column w.
fn residual(problem: &Problem, w: MatRef<'_, c64>, value: c64) -> f64 {
    let mut image = Mat::zeros(problem.size(), 1);
    problem.apply(w, image.as_mut());
    image -= w * faer::Scale(value);
    image.norm_l2() / problem.norm().max(f64::MIN_POSITIVE)
}

/// Returns the participation ratio (Σ p)² / (N Σ p²) of N grains, p = |v|² summed over the unknowns
/// of each (Bell & Dean 1970). `grain`: the grain of every unknown.
pub fn participation(v: &[c64], grain: &[usize]) -> f64 {
    let count = grain.iter().max().map_or(0, |last| last + 1);
    let mut weight = vec![0.0; count];
    for (&g, v) in grain.iter().zip(v) {
        weight[g] += v.norm_sqr();
    }
    let sum: f64 = weight.iter().sum();
    let squares: f64 = weight.iter().map(|p| p * p).sum();
    sum * sum / (count as f64 * squares)
}

/// Vectors in the span of `left` that are dual to `right`: LᴴR = 1.
fn dual(left: MatRef<'_, c64>, right: MatRef<'_, c64>) -> Mat<c64> {
    if right.ncols() == 0 {
        return Mat::zeros(right.nrows(), 0);
    }
    let overlap = left.adjoint() * right;
    left * overlap.partial_piv_lu().inverse().adjoint()
}

fn eigen<T: Scalar>(small: &Mat<T>) -> (Vec<c64>, Mat<c64>) {
    if small.nrows() == 0 {
        return (Vec::new(), Mat::zeros(0, 0));
    }
    let eigen = small.eigen().expect("the QR algorithm converges");
    let values = (0..small.nrows()).map(|k| eigen.S()[k]).collect();
    (values, eigen.U().to_owned())
}

fn normalised(mut vectors: Mat<c64>) -> Mat<c64> {
    for k in 0..vectors.ncols() {
        let norm = vectors.col(k).norm_l2();
        let mut column = vectors.col_mut(k);
        (0..column.nrows()).for_each(|i| column[i] /= norm);
    }
    vectors
}

fn widened<T: Scalar>(x: MatRef<'_, T>) -> Mat<c64> {
    Mat::from_fn(x.nrows(), x.ncols(), |i, j| x[(i, j)].widened())
}
