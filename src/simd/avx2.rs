//! AVX2 with FMA: two registers.

use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::{LANES, Lanes, Mask, Row, Work};

/// Proof that this processor has AVX2 and FMA.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Avx2Token(());

impl Avx2Token {
    pub fn detect() -> Option<Self> {
        (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Self(()))
    }
}

/// The work, compiled for this instruction set.
pub(super) fn run<W: Work>(token: Avx2Token, work: W) -> W::Output {
    #[target_feature(enable = "avx2,fma")]
    fn compiled<W: Work>(token: Avx2Token, work: W) -> W::Output {
        work.run::<Avx2>(token)
    }
    // SAFETY: the token proves that the processor has these features.
    unsafe { compiled(token, work) }
}

#[derive(Debug, Clone, Copy)]
pub struct Avx2([__m256d; 2]);

macro_rules! operator {
    ($trait:ident, $method:ident, $intrinsic:ident) => {
        impl $trait for Avx2 {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: a value of this type exists only where a token was shown.
                Avx2(unsafe {
                    [
                        $intrinsic(self.0[0], other.0[0]),
                        $intrinsic(self.0[1], other.0[1]),
                    ]
                })
            }
        }
    };
}
operator!(Add, add, _mm256_add_pd);
operator!(Sub, sub, _mm256_sub_pd);
operator!(Mul, mul, _mm256_mul_pd);
operator!(Div, div, _mm256_div_pd);

impl Avx2 {
    #[inline(always)]
    fn map(self, f: impl Fn(__m256d) -> __m256d) -> Self {
        Avx2([f(self.0[0]), f(self.0[1])])
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(__m256d, __m256d) -> __m256d) -> Self {
        Avx2([f(self.0[0], other.0[0]), f(self.0[1], other.0[1])])
    }
}

impl Neg for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: a value of this type exists only where a token was shown.
        self.map(|x| unsafe { _mm256_xor_pd(x, _mm256_set1_pd(-0.0)) })
    }
}

#[derive(Debug, Clone, Copy)]
pub struct Mask2([__m256d; 2]);

impl Mask for Mask2 {
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        // SAFETY: a mask exists only where a token was shown.
        Mask2(unsafe {
            [
                _mm256_and_pd(self.0[0], other.0[0]),
                _mm256_and_pd(self.0[1], other.0[1]),
            ]
        })
    }

    #[inline(always)]
    fn bits(self) -> u8 {
        // SAFETY: a mask exists only where a token was shown.
        unsafe {
            (_mm256_movemask_pd(self.0[0]) as u8) | ((_mm256_movemask_pd(self.0[1]) as u8) << 4)
        }
    }
}

impl Lanes for Avx2 {
    type Token = Avx2Token;
    type Mask = Mask2;

    #[inline(always)]
    fn splat(_: Avx2Token, x: f64) -> Self {
        // SAFETY: the token proves that the processor has AVX2.
        Avx2(unsafe { [_mm256_set1_pd(x); 2] })
    }

    #[inline(always)]
    fn load(_: Avx2Token, from: &Row) -> Self {
        // SAFETY: the token proves AVX2; a row holds eight f64 and is aligned, four from each pointer.
        Avx2(unsafe {
            [
                _mm256_load_pd(from.0.as_ptr()),
                _mm256_load_pd(from.0.as_ptr().add(4)),
            ]
        })
    }

    #[inline(always)]
    fn store(self, to: &mut Row) {
        // SAFETY: a value of this type exists only where a token was shown; a row holds eight f64 and is aligned.
        unsafe {
            _mm256_store_pd(to.0.as_mut_ptr(), self.0[0]);
            _mm256_store_pd(to.0.as_mut_ptr().add(4), self.0[1]);
        }
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        // SAFETY: a value of this type exists only where a token was shown.
        Avx2(unsafe {
            [
                _mm256_fmadd_pd(self.0[0], factor.0[0], term.0[0]),
                _mm256_fmadd_pd(self.0[1], factor.0[1], term.0[1]),
            ]
        })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: a value of this type exists only where a token was shown.
        self.map(|x| unsafe { _mm256_sqrt_pd(x) })
    }

    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: a value of this type exists only where a token was shown.
        self.map(|x| unsafe { _mm256_andnot_pd(_mm256_set1_pd(-0.0), x) })
    }

    #[inline(always)]
    fn round(self) -> Self {
        // SAFETY: a value of this type exists only where a token was shown.
        self.map(|x| unsafe {
            _mm256_round_pd::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(x)
        })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.select(self.greater(other), other)
    }

    #[inline(always)]
    fn copy_sign(self, sign: Self) -> Self {
        // SAFETY: a value of this type exists only where a token was shown.
        self.zip(sign, |x, s| unsafe {
            let bit = _mm256_set1_pd(-0.0);
            _mm256_or_pd(_mm256_andnot_pd(bit, x), _mm256_and_pd(bit, s))
        })
    }

    #[inline(always)]
    fn greater(self, other: Self) -> Mask2 {
        // SAFETY: a value of this type exists only where a token was shown.
        Mask2(
            self.zip(other, |a, b| unsafe { _mm256_cmp_pd::<_CMP_GT_OQ>(a, b) })
                .0,
        )
    }

    #[inline(always)]
    fn select(self, mask: Mask2, other: Self) -> Self {
        // SAFETY: a value of this type exists only where a token was shown.
        Avx2(unsafe {
            [
                _mm256_blendv_pd(other.0[0], self.0[0], mask.0[0]),
                _mm256_blendv_pd(other.0[1], self.0[1], mask.0[1]),
            ]
        })
    }

    #[inline(always)]
    fn exponent_mantissa(self) -> (Self, Self) {
        // SAFETY: a value of this type exists only where a token was shown.
        let exponent = self.map(|x| unsafe {
            // The biased exponent in the low bits of 2^52 is 2^52 + exponent, exactly.
            let bits = _mm256_srli_epi64::<52>(_mm256_castpd_si256(x));
            let shifted = _mm256_or_si256(bits, _mm256_set1_epi64x(0x4330_0000_0000_0000));
            _mm256_sub_pd(
                _mm256_castsi256_pd(shifted),
                _mm256_set1_pd(4503599627370496.0 + 1023.0),
            )
        });
        // SAFETY: a value of this type exists only where a token was shown.
        let mantissa = self.map(|x| unsafe {
            _mm256_castsi256_pd(_mm256_or_si256(
                _mm256_and_si256(
                    _mm256_castpd_si256(x),
                    _mm256_set1_epi64x(0x000f_ffff_ffff_ffff),
                ),
                _mm256_set1_epi64x(0x3ff0_0000_0000_0000),
            ))
        });
        (exponent, mantissa)
    }

    #[inline(always)]
    fn gather(_: Avx2Token, records: &[Row], index: &[u32; LANES], field: usize) -> Self {
        let x = |k: usize| records[index[k] as usize].0[field];
        // SAFETY: the token proves that the processor has AVX2.
        Avx2(unsafe {
            [
                _mm256_set_pd(x(3), x(2), x(1), x(0)),
                _mm256_set_pd(x(7), x(6), x(5), x(4)),
            ]
        })
    }

    #[inline(always)]
    fn differences(
        _: Avx2Token,
        records: &[Row],
        i: &[u32; LANES],
        j: &[u32; LANES],
    ) -> [Self; LANES] {
        // SAFETY: the token proves AVX2; every index is checked and every row holds eight f64 and is aligned.
        unsafe {
            let row = |k: usize, half: usize| {
                let (a, b) = (&records[i[k] as usize], &records[j[k] as usize]);
                _mm256_sub_pd(
                    _mm256_load_pd(a.0.as_ptr().add(4 * half)),
                    _mm256_load_pd(b.0.as_ptr().add(4 * half)),
                )
            };
            let quarter = |lane: usize, half: usize| {
                transpose([
                    row(lane, half),
                    row(lane + 1, half),
                    row(lane + 2, half),
                    row(lane + 3, half),
                ])
            };
            let (a, b) = (quarter(0, 0), quarter(4, 0));
            let (c, d) = (quarter(0, 1), quarter(4, 1));
            [
                Avx2([a[0], b[0]]),
                Avx2([a[1], b[1]]),
                Avx2([a[2], b[2]]),
                Avx2([a[3], b[3]]),
                Avx2([c[0], d[0]]),
                Avx2([c[1], d[1]]),
                Avx2([c[2], d[2]]),
                Avx2([c[3], d[3]]),
            ]
        }
    }
}

/// Columns of four rows.
///
/// # Safety
/// The processor has AVX.
#[inline(always)]
unsafe fn transpose(r: [__m256d; 4]) -> [__m256d; 4] {
    // SAFETY: register operations only, with the feature that the caller promises.
    unsafe {
        let (a0, a1) = (
            _mm256_unpacklo_pd(r[0], r[1]),
            _mm256_unpackhi_pd(r[0], r[1]),
        );
        let (a2, a3) = (
            _mm256_unpacklo_pd(r[2], r[3]),
            _mm256_unpackhi_pd(r[2], r[3]),
        );
        [
            _mm256_permute2f128_pd::<0x20>(a0, a2),
            _mm256_permute2f128_pd::<0x20>(a1, a3),
            _mm256_permute2f128_pd::<0x31>(a0, a2),
            _mm256_permute2f128_pd::<0x31>(a1, a3),
        ]
    }
}
