//! (A - σI)⁻¹ as an operator, and the eigenvalues nearest a shift.

use faer::reborrow::{Reborrow, ReborrowMut};
use faer::{Mat, MatMut, Par, c64};

use super::krylov::{self, Settings, Stalled, Subspace};
use super::lu::{Lu, Singular};
use super::problem::Problem;
use super::scalar::Scalar;
use super::spectrum::Spectrum;
use super::symbolic::Symbolic;

/// How far a singular shift is moved, over ‖A‖; four times as far at each further attempt.
const MOVE: f64 = 1e-6;
const ATTEMPTS: i32 = 8;
/// Backward error of a solve above which it is refined, and above which the factors are of no use.
const GOOD: f64 = 1e-14;
const USELESS: f64 = 1e-9;

/// What is asked for.
#[derive(Debug, Clone, Copy)]
pub struct Request {
    pub shift: c64,
    /// Eigenvalues nearest the shift; a conjugate more where the last one would be split from its own.
    pub count: usize,
    /// Whether the left invariant subspace is sought too, which takes as long again: without it conditions are those within the
    /// subspace, which are lower bounds.
    pub left: bool,
    pub par: Par,
}

/// Eigenvalues nearest a shift, and how they were come by.
pub struct Nearest {
    pub spectrum: Spectrum,
    /// The shift used: not that of the request where A - σI was singular.
    pub shift: c64,
    /// Solves, each of one vector.
    pub solves: usize,
    pub restarts: usize,
    /// Factorisations, those of shifts given up among them.
    pub factorisations: usize,
}

impl Nearest {
    /// Radius round the shift within which every eigenvalue is among those found: half way between two of the outer ones, where the gap is widest.
    /// Infinite where all eigenvalues of the problem are found.
    pub fn radius(&self, problem: &Problem) -> f64 {
        let eigenvalues = &self.spectrum.eigenvalues;
        if eigenvalues.len() + problem.null().ncols() >= problem.size() {
            return f64::INFINITY;
        }
        let mut distances: Vec<f64> = eigenvalues
            .iter()
            .map(|e| (e.value - self.shift).norm())
            .collect();
        distances.sort_by(f64::total_cmp);
        let outer = distances.len() - distances.len().div_ceil(4);
        let gaps = distances[outer.saturating_sub(1)..].windows(2);
        let widest = gaps.max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])));
        widest.map_or(0.0, |gap| 0.5 * (gap[0] + gap[1]))
    }
}

/// Why there are no eigenvalues.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Failed {
    /// No shift near the wished one gives factors of use.
    Factors,
    Stalled(Stalled),
}

/// The eigenvalues of the problem nearest a shift, by Krylov–Schur on (A - σI)⁻¹, and by Rayleigh–Ritz with A itself.
///
/// Real shifts are worked in real arithmetic. Zero modes that the problem knows of are not among them.
pub fn nearest(
    problem: &Problem,
    symbolic: &Symbolic,
    request: Request,
) -> Result<Nearest, Failed> {
    if request.shift.im == 0.0 {
        nearest_in::<f64>(problem, symbolic, request)
    } else {
        nearest_in::<c64>(problem, symbolic, request)
    }
}

fn nearest_in<T: Scalar>(
    problem: &Problem,
    symbolic: &Symbolic,
    request: Request,
) -> Result<Nearest, Failed> {
    let mut inverse = Inverse::<T>::near(problem, symbolic, request.shift, request.par)?;
    let settings = settings(request, problem.size());
    let n = problem.size();
    let solve = |x: MatMut<'_, T>| inverse.apply(x);
    let right = krylov::largest(n, solve, settings).map_err(Failed::Stalled)?;
    let left = if request.left {
        let solve = |x: MatMut<'_, T>| inverse.apply_adjoint(x);
        let settings = Settings {
            count: right.basis.ncols(),
            ..settings
        };
        Some(krylov::largest(n, solve, settings).map_err(Failed::Stalled)?)
    } else {
        None
    };
    let both = || std::iter::once(&right).chain(&left);
    Ok(Nearest {
        spectrum: Spectrum::of(problem, &right.basis, left.as_ref().map(|left| &left.basis)),
        shift: inverse.shift,
        solves: both().map(|one: &Subspace<T>| one.applied).sum(),
        restarts: both().map(|one: &Subspace<T>| one.restarts).sum(),
        factorisations: inverse.attempts,
    })
}

/// First choices, not tuned: two vectors at once read the factors half as often, and more than twice as many columns
/// as wanted eigenvalues spare restarts.
fn settings(request: Request, n: usize) -> Settings {
    let count = request.count.min(n);
    Settings {
        count,
        block: 2,
        capacity: (2 * count + 20).min(n),
        tolerance: 1e-13,
        floor: 0.0,
        restarts: 300,
        par: request.par,
    }
}

/// (A - σI)⁻¹ on vectors without the null vectors.
pub struct Inverse<'a, T> {
    problem: &'a Problem,
    lu: Lu<'a, T>,
    pub shift: c64,
    pub attempts: usize,
    refine: bool,
}

impl<'a, T: Scalar> Inverse<'a, T> {
    /// At the shift, or at one moved from it where A - σI is singular to working precision.
    pub fn near(
        problem: &'a Problem,
        symbolic: &'a Symbolic,
        wished: c64,
        par: Par,
    ) -> Result<Self, Failed> {
        let mut shift = wished;
        for attempt in 0..ATTEMPTS {
            if attempt > 0 {
                shift = wished + MOVE * 4f64.powi(attempt - 1) * problem.norm();
            }
            let values = problem.matrix().val();
            let Ok(lu) = Lu::new(symbolic, values, T::narrowed(shift), par) else {
                continue;
            };
            let mut inverse = Inverse {
                problem,
                lu,
                shift,
                attempts: attempt as usize + 1,
                refine: false,
            };
            let error = inverse.backward_error();
            if error > GOOD {
                inverse.refine = true;
            }
            if error < USELESS {
                return Ok(inverse);
            }
        }
        Err(Failed::Factors)
    }

    /// x ← (A - σI)⁻¹ x.
    pub fn apply(&mut self, mut x: MatMut<'_, T>) {
        self.problem.project(x.rb_mut());
        if self.refine {
            let right = x.rb().to_owned();
            self.lu.solve(x.rb_mut());
            let mut rest = self.residual(x.rb().to_owned(), &right);
            self.lu.solve(rest.as_mut());
            x += &rest;
        } else {
            self.lu.solve(x.rb_mut());
        }
        self.problem.project(x);
    }

    /// x ← (A - σI)⁻ᴴ x.
    pub fn apply_adjoint(&mut self, mut x: MatMut<'_, T>) {
        self.problem.project(x.rb_mut());
        conjugate(x.rb_mut());
        if self.refine {
            let right = x.rb().to_owned();
            self.lu.solve_transposed(x.rb_mut());
            let mut image = Mat::zeros(x.nrows(), x.ncols());
            self.problem.apply_transposed(x.rb(), image.as_mut());
            let shift = T::narrowed(self.shift);
            let mut rest = Mat::from_fn(x.nrows(), x.ncols(), |i, j| {
                right[(i, j)] - image[(i, j)] + shift * x[(i, j)]
            });
            self.lu.solve_transposed(rest.as_mut());
            x += &rest;
        } else {
            self.lu.solve_transposed(x.rb_mut());
        }
        conjugate(x.rb_mut());
        self.problem.project(x);
    }

    /// b - (A - σI) x.
    fn residual(&self, x: Mat<T>, right: &Mat<T>) -> Mat<T> {
        let mut image = Mat::zeros(x.nrows(), x.ncols());
        self.problem.apply(x.as_ref(), image.as_mut());
        let shift = T::narrowed(self.shift);
        Mat::from_fn(x.nrows(), x.ncols(), |i, j| {
            right[(i, j)] - image[(i, j)] + shift * x[(i, j)]
        })
    }

    /// ‖b - (A - σI)x‖ / (‖A - σI‖ ‖x‖ + ‖b‖) of one solve (Rigal & Gaches 1967).
    fn backward_error(&self) -> f64 {
        let n = self.problem.size();
        let right = Mat::from_fn(n, 1, |i, _| T::of((i as f64 * 0.569840).fract() - 0.5));
        let mut x = right.clone();
        self.lu.solve(x.as_mut());
        let size = (self.problem.norm() + self.shift.norm()) * x.norm_l2() + right.norm_l2();
        let error = self.residual(x, &right).norm_l2() / size;
        if error.is_nan() { f64::INFINITY } else { error }
    }
}

fn conjugate<T: Scalar>(mut x: MatMut<'_, T>) {
    if T::REAL {
        return;
    }
    for j in 0..x.ncols() {
        let mut column = x.rb_mut().col_mut(j);
        (0..column.nrows()).for_each(|i| column[i] = T::narrowed(column[i].widened().conj()));
    }
}

impl From<Singular> for Failed {
    fn from(_: Singular) -> Self {
        Failed::Factors
    }
}
