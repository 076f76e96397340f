//! Shift-and-invert: the operator (A - σI)⁻¹ and the eigenvalues nearest a shift.

use faer::reborrow::{Reborrow, ReborrowMut};
use faer::{Mat, MatMut, MatRef, Par, c64};

use crate::eigenvalues::Spectrum;
use crate::krylov::{self, Settings, Stalled};
use crate::lu::Lu;
use crate::problem::Problem;
use crate::scalar::Scalar;
use crate::symbolic::Symbolic;

/// First displacement of a singular shift over ‖A‖; each further attempt moves it four times as
/// far.
const MOVE: f64 = 1e-6;
/// Greatest number of shifts tried.
const ATTEMPTS: i32 = 8;
/// Backward error of a solve above which solves are refined.
const GOOD: f64 = 1e-14;
/// Backward error above which the factors are discarded.
const USELESS: f64 = 1e-9;
/// Rounding error of the eigenvalues over ‖A‖ above which the shift is too near to one of them.
const LOST: f64 = 1e-12;

/// Which eigenvalues are wanted.
#[derive(Debug, Clone, Copy)]
pub struct Request {
    /// The shift σ.
    pub shift: c64,
    /// Number of eigenvalues nearest the shift; one more if a conjugate pair would be split.
    pub count: usize,
    /// Whether the left invariant subspace is computed too, which doubles the time. Without it
    /// condition numbers are those within the right subspace, which are lower bounds.
    pub left: bool,
    /// Parallelism.
    pub par: Par,
}

/// The eigenvalues nearest a shift, and the cost of finding them.
pub struct Nearest {
    /// Eigenvalues and vectors.
    pub spectrum: Spectrum,
    /// The shift used, which differs from the requested one if A - σI was singular or nearly so.
    pub shift: c64,
    /// Number of solves, one per vector.
    pub solves: usize,
    /// Number of restarts.
    pub restarts: usize,
    /// Number of factorisations, including discarded ones.
    pub factorisations: usize,
}

impl Nearest {
    /// Returns the radius around the shift within which every eigenvalue is among those found: half
    /// way across the widest gap among the outer quarter of them. Infinite if all eigenvalues of
    /// the problem were found.
    pub fn radius(&self, problem: &Problem) -> f64 {
        let eigenvalues = &self.spectrum.eigenvalues;
        if eigenvalues.len() + problem.null().ncols() >= problem.size() {
            return f64::INFINITY;
        }
        let distances = eigenvalues.iter().map(|e| e.distance(self.shift));
        let mut distances: Vec<f64> = distances.collect();
        distances.sort_by(f64::total_cmp);
        let outer = distances.len() - distances.len().div_ceil(4);
        let gaps = distances[outer.saturating_sub(1)..].windows(2);
        let widest = gaps.max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])));
        widest.map_or(0.0, |gap| 0.5 * (gap[0] + gap[1]))
    }
}

/// Why no eigenvalues were found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Failed {
    /// No shift near the requested one gives usable factors.
    Factors,
    /// Krylov–Schur did not converge.
    Stalled(Stalled),
}

/// Returns the eigenvalues of the problem nearest a shift, by Krylov–Schur on (A - σI)⁻¹ followed
/// by Rayleigh–Ritz with A.
///
/// A real shift is computed in real arithmetic. The problem's null vectors are projected out, so
/// the zero modes it knows of are not among the results.
///
/// # Errors
/// [`Failed`] if no shift gives usable factors or the iteration does not converge.
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
    let n = problem.size();
    let settings = settings(request, n);
    let (mut shift, mut attempts) = (request.shift, 0);
    // With a shift that is too near to an eigenvalue.
    let mut imprecise = None;
    let (mut inverse, right) = loop {
        let factored = Inverse::<T>::near(problem, symbolic, shift, request.par);
        let mut inverse = match (factored, imprecise) {
            (Ok(inverse), _) => inverse,
            (Err(_), Some(imprecise)) => break imprecise,
            (Err(failed), None) => return Err(failed),
        };
        inverse.attempts += attempts;
        attempts = inverse.attempts;
        let right =
            krylov::largest(n, |x| inverse.apply(false, x), settings).map_err(Failed::Stalled)?;
        // Rounding errors are those of the greatest θ = 1/(λ - σ): with a far greater one the
        // others are lost.
        let sizes: Vec<f64> = right.values.iter().map(|value| value.norm()).collect();
        let nearest = sizes.iter().copied().fold(0.0, f64::max);
        // Null vectors have none.
        let nonzero = sizes
            .into_iter()
            .filter(|size| *size > 1e-3 * f64::EPSILON * nearest);
        let farthest = 1.0 / nonzero.fold(f64::MAX, f64::min);
        let reach = farthest.min(problem.norm() + shift.norm());
        let error = 2.0 * f64::EPSILON * nearest * reach * reach;
        if error <= LOST * problem.norm() || attempts >= ATTEMPTS as usize {
            break (inverse, right);
        }
        let displacement = 1e-3 * (reach * reach / problem.norm()).min(reach);
        shift = request.shift + displacement * f64::from(attempts as u32);
        imprecise = Some((inverse, right));
    };
    let wanted = right.basis.ncols();
    let (right, left) = if request.left {
        let [right, left] =
            krylov::matched(n, right, |adjoint, x| inverse.apply(adjoint, x), settings)
                .map_err(Failed::Stalled)?;
        (right, Some(left))
    } else {
        (right, None)
    };
    let mut spectrum = Spectrum::of(problem, &right.basis, left.as_ref().map(|left| &left.basis));
    if right.basis.ncols() > wanted {
        let shift = inverse.shift;
        let distances = spectrum.eigenvalues.iter().map(|e| e.distance(shift));
        let mut distances: Vec<f64> = distances.collect();
        distances.sort_by(f64::total_cmp);
        // The two of a pair are equally far, but for rounding.
        let farthest = distances[wanted - 1] * (1.0 + 1e-12);
        spectrum = spectrum.arranged(|e| e.distance(shift) <= farthest, |e| e.distance(shift));
    }
    let subspaces = std::iter::once(&right).chain(&left);
    Ok(Nearest {
        spectrum,
        shift: inverse.shift,
        solves: subspaces.clone().map(|subspace| subspace.applied).sum(),
        restarts: subspaces.map(|subspace| subspace.restarts).sum(),
        factorisations: inverse.attempts,
    })
}

/// Parameters of the iteration, not tuned: blocks of two vectors read the factors half as often,
/// and a basis of more than twice the wanted size saves restarts.
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

/// The operator (A - σI)⁻¹ on vectors without components along the null vectors.
struct Inverse<'a, T> {
    problem: &'a Problem,
    lu: Lu<'a, T>,
    /// The shift used.
    shift: c64,
    /// Number of factorisations tried.
    attempts: usize,
    /// Whether each solve is followed by one step of iterative refinement.
    refine: bool,
}

impl<'a, T: Scalar> Inverse<'a, T> {
    /// Factors A - σI at the shift, or at a shift moved from it if A - σI is singular to working
    /// precision.
    ///
    /// # Errors
    /// [`Failed::Factors`] if no attempt gives usable factors.
    fn near(
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
            inverse.refine = error > GOOD;
            if error < USELESS {
                return Ok(inverse);
            }
        }
        Err(Failed::Factors)
    }

    /// Computes x ← (A - σI)⁻¹ x, or x ← (A - σI)⁻ᴴ x.
    fn apply(&mut self, adjoint: bool, mut x: MatMut<'_, T>) {
        self.problem.project(x.rb_mut());
        if adjoint {
            conjugate(x.rb_mut());
        }
        let right = self.refine.then(|| x.rb().to_owned());
        self.lu.solve(adjoint, x.rb_mut());
        if let Some(right) = right {
            let mut rest = self.residual(adjoint, x.rb(), &right);
            self.lu.solve(adjoint, rest.as_mut());
            x += &rest;
        }
        if adjoint {
            conjugate(x.rb_mut());
        }
        self.problem.project(x);
    }

    /// b - (A - σI) x, or with Aᵀ.
    fn residual(&self, transposed: bool, x: MatRef<'_, T>, right: &Mat<T>) -> Mat<T> {
        let mut image = Mat::zeros(x.nrows(), x.ncols());
        if transposed {
            self.problem.apply_transposed(x, image.as_mut());
        } else {
            self.problem.apply(x, image.as_mut());
        }
        let shift = T::narrowed(self.shift);
        Mat::from_fn(x.nrows(), x.ncols(), |i, j| {
            right[(i, j)] - image[(i, j)] + shift * x[(i, j)]
        })
    }

    /// Backward error ‖b - (A - σI)x‖ / (‖A - σI‖ ‖x‖ + ‖b‖) of one solve (Rigal & Gaches 1967).
    fn backward_error(&self) -> f64 {
        let n = self.problem.size();
        let right = Mat::from_fn(n, 1, |i, _| T::of((i as f64 * 0.569840).fract() - 0.5));
        let mut x = right.clone();
        self.lu.solve(false, x.as_mut());
        let size = (self.problem.norm() + self.shift.norm()) * x.norm_l2() + right.norm_l2();
        let error = self.residual(false, x.as_ref(), &right).norm_l2() / size;
        if error.is_nan() { f64::INFINITY } else { error }
    }
}

fn conjugate<T: Scalar>(mut x: MatMut<'_, T>) {
    for j in 0..x.ncols() {
        let mut column = x.rb_mut().col_mut(j);
        (0..column.nrows()).for_each(|i| column[i] = column[i].conjugate());
    }
}
