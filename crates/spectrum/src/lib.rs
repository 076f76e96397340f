//! Spectra of sparse generalised eigenvalue problems K v = λ M v with real nonsymmetric K and
//! diagonal M, and linear systems with K (docs/explanation/spectrum.md).
//!
//! [`Problem`] brings K and M to the standard form A w = λ w. [`nearest`] finds the eigenvalues
//! nearest a shift, [`scan()`] all eigenvalues of a rectangle, [`unstable()`] the fastest growing
//! modes without factors, and [`winding`] counts eigenvalues by the argument principle.
//! [`Spectrum`] holds eigenvalues with residuals, condition numbers and a [`Verdict`]; [`Solver`]
//! solves K x = b.
//!
//! [`damped_values`] has all eigenvalues of a problem with a damping matrix.
//!
//! Nothing here knows of grains: K and M are matrices of faer.
//!
//! ```
//! use faer::sparse::{SparseColMat, Triplet};
//! use faer::{Mat, Par, c64};
//! use gshear_spectrum::{Problem, Request, Symbolic, nearest};
//!
//! // Masses 1 and 2, a matrix that is not symmetric: λ² - 3λ + 2 = 0.
//! let entries = [(0, 0, 1.0), (0, 1, 1.0), (1, 1, 4.0)].map(|(i, j, v)| Triplet::new(i, j, v));
//! let k = SparseColMat::<usize, f64>::try_new_from_triplets(2, 2, &entries).unwrap();
//! let problem = Problem::new(&k, &[1.0, 2.0], Mat::zeros(2, 0).as_ref()).unwrap();
//! let symbolic = Symbolic::new(problem.matrix().symbolic());
//! let (shift, count, left, par) = (c64::new(1.9, 0.0), 1, false, Par::Seq);
//! let found = nearest(&problem, &symbolic, Request { shift, count, left, par })?;
//! let value = found.spectrum.eigenvalues[0].value;
//! assert!((value - c64::new(2.0, 0.0)).norm() < 1e-12);
//! # Ok::<(), gshear_spectrum::Failed>(())
//! ```

mod count;
mod damped;
mod eigenvalues;
mod krylov;
mod lu;
mod ordering;
mod problem;
mod qr_iteration;
mod scalar;
mod scan;
mod schur;
mod shift_invert;
mod solve;
mod symbolic;
mod unstable;

#[cfg(test)]
mod tests;

pub use count::{Rectangle, Uncounted, Winding, winding};
pub use damped::{DAMPED_ZERO, damped_values};
pub use eigenvalues::{Eigenvalue, RESIDUAL, Spectrum, Verdict, participation};
pub use krylov::Stalled;
pub use lu::Singular;
pub use problem::{Problem, Unfit};
pub use scan::{Scan, bendixson, scan};
pub use shift_invert::{Failed, Nearest, Request, nearest};
pub use solve::{Factors, Solution, Solver};
pub use symbolic::Symbolic;
pub use unstable::{Sought, Unstable, unstable};
