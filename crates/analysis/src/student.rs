//! Two-sided p of a correlation coefficient from Student's t distribution.
//!
//! The incomplete beta function is computed here because that of `statrs` 0.19 takes Γ(a+½)/Γ(a)
//! from the difference of two large logarithms. Its rounding error, about ε ln Γ(a), is an
//! estimated 1e-10 of p at 130,000 pairs.

use std::f64::consts::PI;

/// Returns the two-sided p of a coefficient ρ of `count` pairs; NaN for fewer than three pairs and
/// for ρ = NaN.
///
/// ```text
/// p = P(|t| ≥ |ρ| √(ν/(1-ρ²))) = I_x(ν/2, ½),  ν = count - 2,  x = 1-ρ²
/// ```
pub(crate) fn two_sided(rho: f64, count: usize) -> f64 {
    if rho.is_nan() || count < 3 {
        return f64::NAN;
    }
    let a = 0.5 * (count - 2) as f64;
    let square = rho * rho;
    let x = (1.0 - rho) * (1.0 + rho);
    // x^a √(1-x) / B(a, ½), with B(a, ½) = √π Γ(a)/Γ(a+½).
    let front = (a * (-square).ln_1p()).exp() * rho.abs() * gamma_ratio(a) / PI.sqrt();
    if x < (a + 1.0) / (a + 2.5) {
        front * continued_fraction(a, 0.5, x) / a
    } else {
        1.0 - front * continued_fraction(0.5, a, square) / 0.5
    }
}

/// Γ(a+½)/Γ(a), a ≥ ½.
fn gamma_ratio(a: f64) -> f64 {
    /// Coefficients of the asymptotic series in 1/a, over √a (NIST DLMF 5.11.13).
    const SERIES: [f64; 9] = [
        1.0,
        -1.0 / 8.0,
        1.0 / 128.0,
        5.0 / 1024.0,
        -21.0 / 32768.0,
        -399.0 / 262144.0,
        869.0 / 4194304.0,
        39325.0 / 33554432.0,
        -334477.0 / 2147483648.0,
    ];
    const LARGE: f64 = 40.0;
    let (mut a, mut factor) = (a, 1.0);
    while a < LARGE {
        factor *= a / (a + 0.5);
        a += 1.0;
    }
    let sum = SERIES.iter().rev().fold(0.0, |sum, term| sum / a + term);
    factor * a.sqrt() * sum
}

/// The value; a tiny one instead of 0, by which the next step divides.
fn away_from_zero(value: f64) -> f64 {
    const TINY: f64 = 1e-300;
    if value.abs() < TINY { TINY } else { value }
}

/// Continued fraction of the incomplete beta function by the method of Lentz: I_x(a, b) is x^a
/// (1-x)^b/(a B(a, b)) times this (NIST DLMF 8.17.22). It converges fast for x < (a+1)/(a+b+2).
fn continued_fraction(a: f64, b: f64, x: f64) -> f64 {
    let mut c = 1.0;
    let mut d = 1.0 / away_from_zero(1.0 - (a + b) * x / (a + 1.0));
    let mut fraction = d;
    for m in 1..10_000 {
        let m = f64::from(m);
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        let before = fraction;
        for term in [even, odd] {
            d = 1.0 / away_from_zero(1.0 + term * d);
            c = away_from_zero(1.0 + term / c);
            fraction *= c * d;
        }
        if (fraction - before).abs() <= f64::EPSILON * fraction.abs() {
            break;
        }
    }
    fraction
}
