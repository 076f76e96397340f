//! Spectra of sparse problems K v = λ M v with real nonsymmetric K and diagonal M (docs/spectrum.md).

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
