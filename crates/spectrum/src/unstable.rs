//! The fastest growing modes of Newton's equations, complex pairs and negative eigenvalues, without
//! factorisation.
//!
//! Im arccos(2λ/b - 1) is zero on the real interval `[0, b]` and positive off it. The Chebyshev
//! polynomial of degree k, cos(k arccos x), therefore keeps all stable modes of A within 1 and
//! multiplies the others by e^{k Im arccos}. It is k steps of the leapfrog scheme at its longest
//! stable step. Krylov–Schur on it finds the modes in the order of their growth.

use faer::linalg::solvers::DenseSolveCore;
use faer::reborrow::{Reborrow, ReborrowMut};
use faer::sparse::SparseColMat;
use faer::{Mat, MatMut, MatRef, Par, c64, concat};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use crate::eigenvalues::Spectrum;
use crate::krylov::{self, Settings, Stalled};
use crate::problem::Problem;

/// Least factor by which a polynomial multiplies the modes it is to find.
const AMPLIFIED: f64 = 2.0;
/// The first polynomial finds modes with |Im λ| from this times ‖A‖ on.
const COARSEST: f64 = 0.1;
/// Each further polynomial is this many times finer, with the known modes projected out: a
/// polynomial that amplifies some modes beyond 1/ε drowns the others.
const FINER: f64 = 8.0;
/// Greatest growth of the rounding error in known modes between two projections.
const REGROWTH: f64 = 1e4;
/// Number of vectors that a polynomial is applied to at once. The rest of an eigenvalue of greater
/// multiplicity is found after these are projected out.
const BLOCK: usize = 4;
/// Basis vectors that decide whether anything grows: enough to show one mode amplified twofold
/// among a million stable ones.
const PROBE: usize = 16 * BLOCK;
/// Basis vectors for finding it, if many modes grow about equally fast.
const CAPACITY: usize = 32 * BLOCK;
/// Greatest number of eigenvalues sought before they are projected out.
const BATCH: usize = 40;
/// Rows of A per task of a thread.
const ROWS: usize = 1000;
/// Upper end b of the interval over ‖A‖, whose power iteration may be a few per cent too small.
const MARGIN: f64 = 1.05;

/// Which modes are sought.
#[derive(Debug, Clone, Copy)]
pub struct Sought {
    /// Least |Im λ| over ‖A‖ of the pairs that are sought, along with all modes that grow at least
    /// as fast.
    pub resolution: f64,
    /// The search ends when about this many eigenvalues, the fastest growing ones, have been found.
    pub most: usize,
    /// Parallelism.
    pub par: Par,
}

/// The unstable modes found: complex pairs and negative eigenvalues.
pub struct Unstable {
    /// Eigenvalues and vectors.
    pub spectrum: Spectrum,
    /// Degrees of the polynomials used.
    pub degrees: Vec<usize>,
    /// Number of products of A or Aᵀ with a vector.
    pub products: usize,
    /// Whether everything sought was found; false if the search ended at `most`.
    pub complete: bool,
}

/// Finds all complex pairs with |Im λ| ≥ resolution ‖A‖ and all negative λ that grow as fast, with
/// what else is found on the way.
///
/// # Errors
/// [`Stalled`] if Krylov–Schur does not converge.
///
/// # Panics
/// If there is no memory for Aᵀ.
pub fn unstable(problem: &Problem, sought: Sought) -> Result<Unstable, Stalled> {
    let n = problem.size();
    let end = MARGIN * problem.norm();
    let transposed = problem.matrix().transpose().to_col_major();
    let transposed = transposed.expect("memory for the transpose");
    // The compressed columns of the transpose are the compressed rows of A.
    let rows = Rows::new(&transposed, end);
    let columns = Rows::new(problem.matrix(), end);
    let mut known = Known {
        right: Mat::zeros(n, 0),
        left: Mat::zeros(n, 0),
    };
    let mut found = Unstable {
        spectrum: Spectrum::of(problem, &known.right, None),
        degrees: Vec::new(),
        products: 0,
        complete: n == 0,
    };
    let mut resolution = COARSEST.max(sought.resolution);
    while !found.complete && known.right.ncols() < sought.most {
        let growth = 2.0 * resolution * problem.norm() / end;
        let degree = (AMPLIFIED.asinh() / growth).ceil().max(2.0) as usize;
        if found.degrees.last() != Some(&degree) {
            found.degrees.push(degree);
        }
        let mut polynomial = Polynomial {
            problem,
            degree,
            interval: projection_interval(&found.spectrum, end, degree),
            par: sought.par,
            products: 0,
        };
        let batch = BATCH.min(sought.most - known.right.ncols());
        let wanted = Settings {
            count: batch,
            block: BLOCK,
            capacity: CAPACITY,
            tolerance: 1e-13,
            floor: AMPLIFIED,
            restarts: 300,
            par: sought.par,
        };
        let probe = Settings {
            capacity: PROBE,
            restarts: 0,
            ..wanted
        };
        let probed = krylov::largest(n, |x| polynomial.apply(&rows, &known, x), probe);
        let right = match probed {
            Ok(right) => right,
            Err(_) => krylov::largest(n, |x| polynomial.apply(&rows, &known, x), wanted)?,
        };
        if right.basis.ncols() == 0 {
            found.complete = resolution <= sought.resolution;
            resolution = (resolution / FINER).max(sought.resolution);
        } else {
            let adjoint_known = known.adjoint();
            let [right, left] = krylov::matched(
                n,
                right,
                |adjoint, x| {
                    if adjoint {
                        polynomial.apply(&columns, &adjoint_known, x);
                    } else {
                        polynomial.apply(&rows, &known, x);
                    }
                },
                wanted,
            )?;
            known.right = orthonormal(&known.right, &right.basis);
            known.left = orthonormal(&known.left, &left.basis);
            found.spectrum = Spectrum::of(problem, &known.right, Some(&known.left));
        }
        found.products += polynomial.products;
    }
    Ok(found)
}

/// The right and left invariant subspaces found so far, `[n][m]` each, orthonormal.
struct Known {
    right: Mat<f64>,
    left: Mat<f64>,
}

impl Known {
    /// The subspaces of the transpose.
    fn adjoint(&self) -> Known {
        Known {
            right: self.left.clone(),
            left: self.right.clone(),
        }
    }

    /// (LᵀR)⁻¹, for the projection 1 - R (LᵀR)⁻¹ Lᵀ.
    fn inverse_overlap(&self) -> Mat<f64> {
        match self.right.ncols() {
            0 => Mat::zeros(0, 0),
            _ => (self.left.transpose() * &self.right)
                .partial_piv_lu()
                .inverse(),
        }
    }
}

/// An orthonormal basis of the span of both.
fn orthonormal(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    concat![[a, b]].qr().compute_thin_Q()
}

/// 4A/b - 2 by compressed rows: twice the argument of the polynomials.
struct Rows {
    start: Vec<usize>,
    column: Vec<u32>,
    value: Vec<f64>,
}

/// The entries of one row of a block of vectors.
type Panel = [f64; BLOCK];

impl Rows {
    /// Those of the matrix with this transpose.
    fn new(transpose: &SparseColMat<usize, f64>, end: f64) -> Self {
        let mut rows = Rows {
            start: vec![0],
            column: Vec::with_capacity(transpose.compute_nnz() + transpose.ncols()),
            value: Vec::with_capacity(transpose.compute_nnz() + transpose.ncols()),
        };
        for i in 0..transpose.ncols() {
            let entries = transpose.row_idx_of_col_raw(i).iter();
            let entries = entries.zip(transpose.val_of_col(i));
            for (&j, value) in entries {
                rows.column.push(j as u32);
                rows.value.push(4.0 / end * value);
            }
            rows.column.push(i as u32);
            rows.value.push(-2.0);
            rows.start.push(rows.column.len());
        }
        rows
    }

    /// before ← (4A/b - 2) now - before.
    fn step(&self, now: &[Panel], before: &mut [Panel], par: Par) {
        let arch = Arch::new();
        match par {
            Par::Seq => arch.dispatch(RecurrenceStep {
                rows: self,
                first: 0,
                now,
                before,
            }),
            Par::Rayon(_) => {
                let chunks = before.par_chunks_mut(ROWS).enumerate();
                chunks.for_each(|(chunk, before)| {
                    arch.dispatch(RecurrenceStep {
                        rows: self,
                        first: chunk * ROWS,
                        now,
                        before,
                    });
                });
            }
        }
    }
}

/// A Chebyshev polynomial of A, with the known modes and the null vectors projected out.
struct Polynomial<'a> {
    problem: &'a Problem,
    degree: usize,
    /// Steps of the recurrence between two projections.
    interval: usize,
    par: Par,
    /// Number of products of A with a vector so far.
    products: usize,
}

impl Polynomial<'_> {
    /// x ← T_degree x. `rows`: of A or of Aᵀ; `known`: the modes of that matrix found so far.
    fn apply(&mut self, rows: &Rows, known: &Known, mut x: MatMut<'_, f64>) {
        let (n, columns) = (x.nrows(), x.ncols());
        self.products += self.degree * columns;
        let projection = Projection {
            problem: self.problem,
            known,
            overlap: known.inverse_overlap(),
        };
        projection.apply(x.rb_mut());
        let mut before: Vec<Panel> = (0..n).map(|i| panel(x.rb(), i)).collect();
        let mut now = vec![[0.0; BLOCK]; n];
        rows.step(&before, &mut now, self.par);
        now.iter_mut().flatten().for_each(|t| *t *= 0.5);
        for done in 1..self.degree {
            rows.step(&now, &mut before, self.par);
            std::mem::swap(&mut now, &mut before);
            if done % self.interval == 0 && projection.has_modes() {
                for t in [&mut now, &mut before] {
                    (0..n).for_each(|i| (0..columns).for_each(|c| x[(i, c)] = t[i][c]));
                    projection.apply(x.rb_mut());
                    (0..n).for_each(|i| t[i] = panel(x.rb(), i));
                }
            }
        }
        (0..n).for_each(|i| (0..columns).for_each(|c| x[(i, c)] = now[i][c]));
        projection.apply(x);
    }
}

/// A row of up to `BLOCK` vectors.
fn panel(x: MatRef<'_, f64>, i: usize) -> Panel {
    std::array::from_fn(|c| if c < x.ncols() { x[(i, c)] } else { 0.0 })
}

/// Projects out the null vectors and the known modes.
struct Projection<'a> {
    problem: &'a Problem,
    known: &'a Known,
    /// (LᵀR)⁻¹.
    overlap: Mat<f64>,
}

impl Projection<'_> {
    /// Whether there are known modes.
    fn has_modes(&self) -> bool {
        self.overlap.ncols() > 0
    }

    fn apply(&self, mut x: MatMut<'_, f64>) {
        self.problem.project(x.rb_mut());
        if self.has_modes() {
            let along = &self.overlap * (self.known.left.transpose() * x.as_ref());
            x -= &self.known.right * along;
        }
    }
}

/// Number of steps of the recurrence after which the rounding error in the known modes must be
/// projected out again.
fn projection_interval(spectrum: &Spectrum, end: f64, degree: usize) -> usize {
    let growths = spectrum.eigenvalues.iter().map(|e| growth(e.value, end));
    let fastest = growths.fold(0.0, f64::max);
    ((REGROWTH.ln() / fastest) as usize).clamp(1, degree)
}

/// Growth of a mode in a step of the recurrence, as the exponent; `end`: of the interval of the
/// stable modes.
fn growth(value: c64, end: f64) -> f64 {
    let x = 2.0 * value / end - 1.0;
    // |x + √(x² - 1)|, the greater of two reciprocal numbers.
    let grown = (x + (x * x - 1.0).sqrt()).norm();
    grown.max(1.0 / grown).ln()
}

/// One step of the recurrence over some rows.
struct RecurrenceStep<'a> {
    rows: &'a Rows,
    first: usize,
    now: &'a [Panel],
    before: &'a mut [Panel],
}

impl WithSimd for RecurrenceStep<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Rows {
            start,
            column,
            value,
        } = self.rows;
        for (to, ends) in self.before.iter_mut().zip(start[self.first..].windows(2)) {
            let range = ends[0]..ends[1];
            let mut sum = [0.0; BLOCK];
            for c in 0..BLOCK {
                sum[c] = -to[c];
            }
            for (&j, &a) in column[range.clone()].iter().zip(&value[range]) {
                let t = &self.now[j as usize];
                for c in 0..BLOCK {
                    sum[c] += a * t[c];
                }
            }
            *to = sum;
        }
    }
}
