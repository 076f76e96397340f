//! Elementary functions that are the same on every platform.

use super::Lanes;

/// Natural logarithm of positive normal numbers, to less than one unit in the last place.
///
/// x = m 2^e with m in [√½, √2); ln m from s = f/(2 + f), f = m - 1, by the minimax polynomial of FreeBSD's `e_log.c`
/// (|error| < 2^-58.45).
#[inline(always)]
#[expect(clippy::excessive_precision, reason = "the digits of the source")]
pub fn ln<L: Lanes>(token: L::Token, x: L) -> L {
    let c = |v| L::splat(token, v);
    let (e, m) = x.exponent_mantissa();
    let high = m.greater(c(std::f64::consts::SQRT_2));
    let m = (m * c(0.5)).select(high, m);
    let e = (e + c(1.0)).select(high, e);
    let f = m - c(1.0);
    let s = f / (c(2.0) + f);
    let z = s * s;
    let r = c(1.479819860511658591e-1)
        .mul_add(z, c(1.531383769920937332e-1))
        .mul_add(z, c(1.818357216161805012e-1))
        .mul_add(z, c(2.222219843214978396e-1))
        .mul_add(z, c(2.857142874366239149e-1))
        .mul_add(z, c(3.999999999940941908e-1))
        .mul_add(z, c(6.666666666666735130e-1))
        * z;
    let half_square = c(0.5) * f * f;
    let ln2_high = c(6.93147180369123816490e-1);
    let ln2_low = c(1.90821492927058770002e-10);
    e.mul_add(
        ln2_high,
        -((half_square - s.mul_add(half_square + r, e * ln2_low)) - f),
    )
}

#[cfg(test)]
mod tests {
    use super::super::{Portable, PortableToken, Row};
    use super::*;

    #[test]
    fn logarithm_is_good_to_an_ulp() {
        // std's ln is itself within an ulp, so two are allowed between them.
        let mut x = 1e-300;
        while x < 1e300 {
            let row = Row(std::array::from_fn(|k| x * (1.0 + 0.37 * k as f64)));
            let mut out = Row::ZERO;
            ln(PortableToken, Portable::load(PortableToken, &row)).store(&mut out);
            for (v, y) in row.0.iter().zip(out.0) {
                let reference = v.ln();
                assert!(
                    (y - reference).abs() <= 2.0 * f64::EPSILON * reference.abs(),
                    "ln {v:e}: {y:e} against {reference:e}"
                );
            }
            x *= 1.0 + 0.731;
        }
    }
}
