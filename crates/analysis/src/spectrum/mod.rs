//! Spectra of sparse generalised eigenvalue problems K v = λ M v with real nonsymmetric K and
//! diagonal M, and linear systems with K (docs/spectrum.md).
//!
//! [`Problem`] brings K and M to the standard form A w = λ w. [`nearest`] finds the eigenvalues
//! nearest a shift, [`scan()`] all eigenvalues of a rectangle, [`unstable()`] the fastest growing
//! modes without factors, and [`winding`] counts eigenvalues by the argument principle.
//! [`Spectrum`] holds eigenvalues with residuals, condition numbers and a [`Verdict`]; [`Solver`]
//! solves K x = b.

mod count;
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
#[allow(clippy::module_inception)]
mod spectrum;
mod symbolic;
mod unstable;

#[cfg(test)]
mod tests;

pub use count::{Rectangle, Uncounted, Winding, winding};
pub use krylov::Stalled;
pub use lu::Singular;
pub use problem::{Problem, Unfit};
pub use scan::{Scan, bendixson, scan};
pub use shift_invert::{Failed, Nearest, Request, nearest};
pub use solve::{Factors, Solution, Solver};
pub use spectrum::{Eigenvalue, RESIDUAL, Spectrum, Verdict, participation};
pub use symbolic::Symbolic;
pub use unstable::{Sought, Unstable, unstable};
