//! K x = b, again and again: the linear systems of Newton's method.

use faer::sparse::SymbolicSparseColMat;
use faer::{Mat, Par};

use super::lu::{Lu, Singular};
use super::problem::Problem;
use super::symbolic::Symbolic;

/// Shift of the factors over the greatest column of A, below zero. K has zero modes that nobody knows of (grains that their contacts hold in some directions only);
/// with it the factors exist all the same, and what rounding leaves along such modes grows by its inverse at the most. Refinement
/// takes its effect on all other modes away again, as long as it is well below them.
const SHIFT: f64 = -1e-9;
/// Solves for one right-hand side.
const MOST: usize = 12;

/// What all factorisations of matrices of one pattern share.
#[derive(Default)]
pub struct Solver {
    made: Option<(SymbolicSparseColMat<usize>, Symbolic)>,
    /// How often an order of elimination had to be found.
    pub analyses: usize,
}

/// Factors of one matrix.
pub struct Factors<'a> {
    problem: &'a Problem,
    lu: Lu<'a, f64>,
}

/// A solution and what it is worth.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// x over the unknowns of K; 0 for those of no stiffness.
    pub x: Vec<f64>,
    /// ‖b - K x‖ over ‖b‖, both scaled by M^(-1/2) and without what lies along the null vectors or acts on unknowns of no stiffness.
    pub residual: f64,
}

impl Solver {
    /// Factors K. The order of elimination is that of the last matrix if the pattern is; on one thread, so that the result is always the same.
    ///
    /// Errors: a pivot that vanishes in spite of the shift.
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
    /// x of K x = b with no part along the null vectors, by iterative refinement until it gets no better. `b` over the unknowns of K: its part along
    /// the null vectors, and on unknowns of no stiffness, is left out.
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
            self.lu.solve(correction.as_mut());
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
