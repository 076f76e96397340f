//! Elementary functions that are the same on every platform.

use super::Lanes;

/// Natural logarithm of positive normal numbers, without division. The error is at most an ulp of
/// the result or of 1, whichever is greater; for x from 31/32 to 17/16 it is at most an ulp of the
/// result.
///
/// ```text
/// x = m 2^e with m near 1 + k/8;  f = m r_k - 1 with r_k ≈ 1/(1 + k/8), so |f| ≤ 1/16
/// ln x = e ln 2 - ln r_k + ln(1+f)
/// ln(1+f) = f - f²/2 + f³ q(f) with minimax q (ln to 4.1e-17)
/// ```
///
/// r_0 = 1 avoids cancellation near 1.
#[inline(always)]
pub fn ln<L: Lanes>(token: L::Token, x: L) -> L {
    const INVERSE: [f64; 8] = [
        1.0,
        0.8888888888888888,
        0.8,
        0.7272727272727273,
        0.6666666666666666,
        0.6153846153846154,
        0.5714285714285714,
        0.5333333333333333,
    ];
    const LOG: [f64; 8] = [
        0.0,
        0.11778303565638351,
        0.2231435513142097,
        0.3184537311185346,
        0.40546510810816444,
        0.48550781578170077,
        0.5596157879354228,
        0.6286086594223742,
    ];
    let c = |v| L::splat(token, v);
    let (e, m, k) = x.exponent_eighth();
    let f = m.mul_add(L::look_up(token, &INVERSE, k), c(-1.0));
    let f2 = f * f;
    let q = c(-0.10081927246175626)
        .mul_add(f, c(0.11182478647391302))
        .mul_add(f, c(-0.12499727177513775))
        .mul_add(f, c(0.14285539746728146))
        .mul_add(f, c(-0.16666667012089464))
        .mul_add(f, c(0.20000000136489163))
        .mul_add(f, c(-0.24999999999877187))
        .mul_add(f, c(0.3333333333331666));
    let log_1_f = f2.mul_add(f.mul_add(q, c(-0.5)), f);
    // ln 2 is split into its first 32 bits, whose product with e is exact, and the rest.
    let low = e.mul_add(c(1.908_214_929_270_587_7e-10), log_1_f);
    e.mul_add(
        c(6.931_471_803_691_238e-1),
        L::look_up(token, &LOG, k) + low,
    )
}

/// 1/x of positive normal numbers, to about an ulp: faster than a division in code with many
/// divisions.
///
/// With e = 1 - x y and the first approximation y, 1/x = y p(e): p ≈ 1/(1-e) is minimax (5e-10),
/// and one step of Newton's method follows.
#[inline(always)]
pub fn inverse<L: Lanes>(token: L::Token, x: L) -> L {
    let c = |v| L::splat(token, v);
    let y = x.inverse_start();
    let e = (-x).mul_add(y, c(1.0));
    let p = c(1.0038456275156673)
        .mul_add(e, c(1.0038456275156673))
        .mul_add(e, c(0.9999963104249739))
        .mul_add(e, c(0.9999963104249739))
        .mul_add(e, c(1.0000000005240683))
        .mul_add(e, c(1.0000000005240683));
    let y = y * p;
    (-x).mul_add(y, c(1.0)).mul_add(y, y)
}

/// x^(-1/2) of positive normal numbers, to about an ulp, without division or root.
///
/// With e = 1 - x y² and the first approximation y, x^(-1/2) = y (1-e)^(-1/2) = y (1 + e p(e)): p
/// is minimax (1.5e-9), and one step of Newton's method follows.
#[inline(always)]
pub fn inverse_sqrt<L: Lanes>(token: L::Token, x: L) -> L {
    let c = |v| L::splat(token, v);
    let y = x.inverse_sqrt_start();
    let e = (-(x * y)).mul_add(y, c(1.0));
    let p = c(0.24780814106360657)
        .mul_add(e, c(0.27475480941714614))
        .mul_add(e, c(0.31249629079524605))
        .mul_add(e, c(0.37499846587808383))
        .mul_add(e, c(0.5000000013292664));
    let y = (y * e).mul_add(p, y);
    let e = (-(x * y)).mul_add(y, c(1.0));
    (y * c(0.5)).mul_add(e, y)
}

/// x^(1/3) of numbers from 1e-30 to 1e30, to some ulps: four of Halley's steps from x^(21/64) of
/// repeated first approximations.
#[inline(always)]
pub fn cube_root<L: Lanes>(token: L::Token, x: L) -> L {
    let two = L::splat(token, 2.0);
    let mut y = x;
    let mut power = x;
    for k in 0..3 {
        power = power.inverse_sqrt_start().inverse_sqrt_start();
        y = if k == 0 { power } else { y * power };
    }
    for _ in 0..4 {
        let cube = y * y * y;
        let wide = inverse(token, two.mul_add(cube, x));
        y = y * two.mul_add(x, cube) * wide;
    }
    y
}

#[cfg(test)]
mod tests {
    use super::super::{Lanes16, Portable, PortableToken};
    use super::*;

    #[test]
    fn logarithm_is_good_to_an_ulp_of_it_or_of_one() {
        // `f64::ln` is itself within an ulp, so the two may differ by two ulps.
        let mut x = 1e-300;
        while x < 1e300 {
            let lanes = Lanes16(std::array::from_fn(|k| x * (1.0 + 0.37 * k as f64)));
            let out = ln(PortableToken, Portable::load(PortableToken, &lanes));
            for (v, y) in lanes.0.iter().zip(out.to_lanes16().0) {
                let reference = v.ln();
                assert!(
                    (y - reference).abs() <= 2.0 * f64::EPSILON * reference.abs().max(1.0),
                    "ln {v:e}: {y:e} against {reference:e}"
                );
            }
            x *= 1.0 + 0.731;
        }
    }

    #[test]
    fn logarithm_near_one_keeps_its_digits() {
        for x in [1.0, 1.0 + 1e-9, 1.0 - 1e-9, 1.0625, 0.96875, 1.05, 0.97] {
            let y = ln(PortableToken, Portable::splat(PortableToken, x));
            let (y, reference) = (y.to_lanes16().0[0], f64::ln(x));
            assert!(
                (y - reference).abs() <= 2.0 * f64::EPSILON * reference.abs(),
                "ln {x}: {y:e} against {reference:e}"
            );
        }
    }

    #[test]
    fn cube_roots_are_good_to_some_ulps() {
        let mut x = 1e-30;
        while x < 1e30 {
            let y = cube_root(PortableToken, Portable::splat(PortableToken, x));
            let y = y.to_lanes16().0[0];
            assert!(
                (y / x.cbrt() - 1.0).abs() <= 4.0 * f64::EPSILON,
                "{x:e}: {y:e}"
            );
            x *= 1.0731;
        }
    }

    #[test]
    fn inverses_are_good_to_an_ulp() {
        let mut x = 1e-300;
        while x < 1e300 {
            let x16 = Lanes16(std::array::from_fn(|k| x * (1.0 + 0.37 * k as f64)));
            let lanes = Portable::load(PortableToken, &x16);
            let root = inverse_sqrt(PortableToken, lanes).to_lanes16();
            let inverse = inverse(PortableToken, lanes).to_lanes16();
            for (k, v) in x16.0.into_iter().enumerate() {
                for (y, reference) in [(root.0[k], 1.0 / v.sqrt()), (inverse.0[k], 1.0 / v)] {
                    assert!(
                        (y / reference - 1.0).abs() <= 2.0 * f64::EPSILON,
                        "{v:e}: {y:e} against {reference:e}"
                    );
                }
            }
            x *= 1.0 + 0.731;
        }
    }
}
