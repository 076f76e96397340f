//! How stable a state is: complex pairs and negative eigenvalues of K v = λ M v.

use faer::c64;
use faer::sparse::SparseColMat;
use gshear_spectrum::{DAMPED_ZERO, Problem, Spectrum, Verdict, damped_values};

gshear_dem::columns! {
    /// Counts and extremes of all eigenvalues of a state.
    pub struct Stability {
        /// complex pairs λ_r ± iλ_i that rounding does not explain
        pairs: "1",
        /// those with λ_r < 0
        pairs_negative: "1",
        /// real eigenvalues below zero
        negative: "1",
        /// greatest λ_i; 0 without a pair
        imaginary_greatest: "s-2",
        /// λ_r of the pair with the greatest λ_i; NaN without a pair
        pair_real: "s-2",
        /// least Re λ of all eigenvalues but zero modes
        real_least: "s-2",
        /// greatest Re λ
        real_greatest: "s-2",
        /// greatest ω_i = Im √λ of pairs and negative eigenvalues; 0 without one
        growth_rate: "s-1",
    }
}

gshear_dem::columns! {
    /// Motions e^(st) of a state with its dampers, of (s² M + s C + K) v = 0.
    pub struct DampedStability {
        /// complex pairs s with Re s > 0, motions that oscillate and grow
        growing_pairs: "1",
        /// real s > 0
        growing: "1",
        /// greatest Re s of all but zero modes; negative where all motions decay
        damped_growth_rate: "s-1",
    }
}

impl DampedStability {
    /// Of a state without eigenvalues.
    pub const UNKNOWN: Self = Self::from_columns([f64::NAN; Self::COLUMNS.len()]);

    /// Finds all eigenvalues by the dense QR algorithm on one thread, and counts those that grow.
    /// `damping`: C over the unknowns of K.
    ///
    /// # Panics
    /// If the QR algorithm does not converge.
    pub fn of(problem: &Problem, damping: &SparseColMat<usize, f64>) -> Self {
        let frequency = problem.norm().sqrt();
        let mut stability = Self {
            growing_pairs: 0.0,
            growing: 0.0,
            damped_growth_rate: f64::NEG_INFINITY,
        };
        for value in damped_values(problem, damping) {
            if value.norm() <= DAMPED_ZERO * frequency {
                continue;
            }
            stability.damped_growth_rate = stability.damped_growth_rate.max(value.re);
            if value.re <= GROWING * frequency {
                continue;
            }
            if value.im == 0.0 {
                stability.growing += 1.0;
            } else if value.im > 0.0 {
                stability.growing_pairs += 1.0;
            }
        }
        stability
    }
}

/// Re s over the greatest frequency up to which rounding may be what grows.
const GROWING: f64 = 1e-10;

impl Stability {
    /// Of a state without eigenvalues.
    pub const UNKNOWN: Self = Self::from_columns([f64::NAN; Self::COLUMNS.len()]);

    /// Finds all eigenvalues by the dense QR algorithm on one thread, and counts them.
    ///
    /// # Panics
    /// If the QR algorithm does not converge.
    pub fn of(problem: &Problem) -> Self {
        Self::of_values(&Spectrum::values(problem), problem.norm())
    }

    /// Counts the eigenvalues of a matrix of this norm.
    pub(crate) fn of_values(values: &[c64], norm: f64) -> Self {
        let mut stability = Self {
            pair_real: f64::NAN,
            real_least: f64::INFINITY,
            real_greatest: f64::NEG_INFINITY,
            ..Self::from_columns([0.0; Self::COLUMNS.len()])
        };
        for value in values {
            let verdict = Verdict::of_value(*value, norm);
            if verdict == Verdict::Zero {
                continue;
            }
            stability.real_least = stability.real_least.min(value.re);
            stability.real_greatest = stability.real_greatest.max(value.re);
            match verdict {
                // One of the two.
                Verdict::Pair if value.im > 0.0 => {
                    stability.pairs += 1.0;
                    stability.pairs_negative += f64::from(u8::from(value.re < 0.0));
                    if value.im > stability.imaginary_greatest {
                        (stability.imaginary_greatest, stability.pair_real) = (value.im, value.re);
                    }
                    stability.growth_rate = stability.growth_rate.max(value.sqrt().im);
                }
                Verdict::Real if value.re < 0.0 => {
                    stability.negative += 1.0;
                    stability.growth_rate = stability.growth_rate.max((-value.re).sqrt());
                }
                _ => {}
            }
        }
        stability
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::Mat;
    use faer::sparse::{SparseColMat, Triplet};

    /// Blocks of known eigenvalues: 2 ± 0.5i, -1 ± 0.1i, -0.04, 3, 0.
    #[test]
    fn known_eigenvalues_are_counted() {
        let diagonal = [2.0, 2.0, -1.0, -1.0, -0.04, 3.0, 0.0];
        let diagonal = diagonal.into_iter().enumerate().map(|(i, x)| (i, i, x));
        let beside = [(0, 1, 0.5), (1, 0, -0.5), (2, 3, 0.1), (3, 2, -0.1)];
        let entries = diagonal
            .chain(beside)
            .map(|(i, j, x)| Triplet::new(i, j, x));
        let entries: Vec<_> = entries.collect();
        let k = SparseColMat::try_new_from_triplets(7, 7, &entries).unwrap();
        let problem = Problem::new(&k, &[1.0; 7], Mat::zeros(7, 0).as_ref()).unwrap();
        let found = Stability::of(&problem);
        assert_eq!(
            [found.pairs, found.pairs_negative, found.negative],
            [2.0, 1.0, 1.0]
        );
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-13, "{a} {b}");
        near(found.imaginary_greatest, 0.5);
        near(found.pair_real, 2.0);
        near(found.real_least, -1.0);
        near(found.real_greatest, 3.0);
        // (a + ib)² = -1 + 0.1i: b² = (1 + √1.01)/2.
        near(found.growth_rate, (0.5 * (1.0 + 1.01f64.sqrt())).sqrt());

        let damped = |damper: f64| {
            let entries = (0..7).map(|i| Triplet::new(i, i, damper));
            let entries: Vec<_> = entries.collect();
            let c = SparseColMat::try_new_from_triplets(7, 7, &entries).unwrap();
            DampedStability::of(&problem, &c)
        };
        // Without dampers s = ±i√λ: both pairs and √0.04 grow; of the pair with λ_r < 0 two s do,
        // which are conjugate.
        let free = damped(0.0);
        assert_eq!([free.growing_pairs, free.growing], [2.0, 1.0]);
        near(free.damped_growth_rate, found.growth_rate);
        // A damper of 1 stops the pair 2 ± 0.5i, whose ω_i is 0.176, and no real one.
        let held = damped(1.0);
        assert_eq!([held.growing_pairs, held.growing], [1.0, 1.0]);
    }
}
