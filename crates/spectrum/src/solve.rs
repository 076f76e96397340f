//! Repeated solution of K x = b, the linear systems of Newton's method.

use faer::sparse::SymbolicSparseColMat;
use faer::{Mat, Par};

use crate::lu::{Lu, Singular};
use crate::problem::Problem;
use crate::symbolic::Symbolic;

/// Shift of the factors over the greatest column of A, negative.
///
/// K may have zero modes that are not given as null vectors (grains that their contacts hold in
/// some directions only). The shift makes the factors exist, and rounding errors along such modes
/// grow by at most its inverse. Iterative refinement removes its effect on all modes well above it.
const SHIFT: f64 = -1e-9;
/// Greatest number of solves for one right-hand side.
const MOST: usize = 12;

/// The symbolic factorisation, reused for matrices of the same pattern.
#[derive(Default)]
pub struct Solver {
    made: Option<(SymbolicSparseColMat<usize>, Symbolic)>,
    /// Number of symbolic factorisations made.
    pub analyses: usize,
}

/// Factors of one matrix.
pub struct Factors<'a> {
    problem: &'a Problem,
    lu: Lu<'a, f64>,
}

/// A solution of K x = b and its residual.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// x over the unknowns of K; 0 for those without stiffness.
    pub x: Vec<f64>,
    /// ‖b - K x‖ over ‖b‖, both scaled by M^(-1/2) and without components along the null vectors or
    /// on unknowns without stiffness.
    pub residual: f64,
}

impl Solver {
    /// Factors K, with the elimination order of the last matrix if the pattern is the same. Runs on
    /// one thread, so that the result is reproducible.
    ///
    /// # Errors
    /// [`Singular`] if a pivot vanishes in spite of the shift.
    ///
    /// # Panics
    /// If there is no memory for the pattern.
    pub fn factor<'a>(&'a mut self, problem: &'a Problem) -> Result<Factors<'a>, Singular> {
        let pattern = problem.matrix().symbolic();
        let same = self.made.as_ref().is_some_and(|(made, _)| {
            made.col_ptr() == pattern.col_ptr() && made.row_idx() == pattern.row_idx()
        });
        if !same {
            let owned = pattern.to_owned().expect("memory for the pattern");
            self.made = Some((owned, Symbolic::new(pattern)));
            self.analyses += 1;
        }
        let (_, symbolic) = self.made.as_ref().expect("just made");
        let shift = SHIFT * problem.greatest_column();
        let lu = Lu::new(symbolic, problem.matrix().val(), shift, Par::Seq)?;
        Ok(Factors { problem, lu })
    }
}

impl Factors<'_> {
    /// Solves K x = b for the x without components along the null vectors, by iterative refinement
    /// until the residual stops falling. Components of `b` (over the unknowns of K) along the null
    /// vectors, and on unknowns without stiffness, are ignored.
    pub fn solve(&self, b: &[f64]) -> Solution {
        let problem = self.problem;
        let mut right = problem.scaled(b);
        problem.project(right.as_mut());
        let size = right.norm_l2();
        let mut w = Mat::<f64>::zeros(problem.size(), 1);
        let mut image = Mat::<f64>::zeros(problem.size(), 1);
        let (mut rest, mut left) = (right.clone(), size);
        for _ in 0..MOST {
            if left == 0.0 {
                break;
            }
            let mut correction = rest.clone();
            self.lu.solve(false, correction.as_mut());
            problem.project(correction.as_mut());
            let next = &w + &correction;
            problem.apply(next.as_ref(), image.as_mut());
            let mut next_rest = &right - &image;
            problem.project(next_rest.as_mut());
            let next_left = next_rest.norm_l2();
            if next_left.is_nan() || next_left >= left {
                break;
            }
            let slow = next_left > 0.5 * left;
            (w, rest, left) = (next, next_rest, next_left);
            if slow {
                break;
            }
        }
        Solution {
            x: problem.unscaled(w.as_ref()),
            residual: if size > 0.0 { left / size } else { 0.0 },
        }
    }
}
