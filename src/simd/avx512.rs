//! AVX-512 (F and DQ): one register.

use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::{LANES, Lanes, Mask, Row, Work};

/// Proof that this processor has AVX-512 F and DQ.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Avx512Token(());

impl Avx512Token {
    pub fn detect() -> Option<Self> {
        let has = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("fma");
        has.then_some(Self(()))
    }
}

/// The work, compiled for this instruction set.
pub(super) fn run<W: Work>(token: Avx512Token, work: W) -> W::Output {
    #[target_feature(enable = "avx512f,avx512dq,avx2,fma")]
    fn compiled<W: Work>(token: Avx512Token, work: W) -> W::Output {
        work.run::<Avx512>(token)
    }
    // SAFETY: the token proves that the processor has these features.
    unsafe { compiled(token, work) }
}

#[derive(Debug, Clone, Copy)]
pub struct Avx512(__m512d);

macro_rules! operator {
    ($trait:ident, $method:ident, $intrinsic:ident) => {
        impl $trait for Avx512 {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: a value of this type exists only where a token was shown.
                Avx512(unsafe { $intrinsic(self.0, other.0) })
            }
        }
    };
}
operator!(Add, add, _mm512_add_pd);
operator!(Sub, sub, _mm512_sub_pd);
operator!(Mul, mul, _mm512_mul_pd);
operator!(Div, div, _mm512_div_pd);

impl Neg for Avx512 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: a value of this type exists only where a token was shown.
        Avx512(unsafe { _mm512_xor_pd(self.0, _mm512_set1_pd(-0.0)) })
    }
}

#[derive(Debug, Clone, Copy)]
pub struct Mask512(__mmask8);

impl Mask for Mask512 {
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Mask512(self.0 & other.0)
    }

    #[inline(always)]
    fn bits(self) -> u8 {
        self.0
    }
}

impl Lanes for Avx512 {
    type Token = Avx512Token;
    type Mask = Mask512;

    #[inline(always)]
    fn splat(_: Avx512Token, x: f64) -> Self {
        // SAFETY: the token proves that the processor has AVX-512.
        Avx512(unsafe { _mm512_set1_pd(x) })
    }

    #[inline(always)]
    fn load(_: Avx512Token, from: &Row) -> Self {
        // SAFETY: the token proves AVX-512; a row holds eight f64 and is aligned.
        Avx512(unsafe { _mm512_load_pd(from.0.as_ptr()) })
    }

    #[inline(always)]
    fn store(self, to: &mut Row) {
        // SAFETY: a value of this type exists only where a token was shown; a row holds eight f64 and is aligned.
        unsafe { _mm512_store_pd(to.0.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        // SAFETY: a value of this type exists only where a token was shown.
        Avx512(unsafe { _mm512_fmadd_pd(self.0, factor.0, term.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: a value of this type exists only where a token was shown.
        Avx512(unsafe { _mm512_sqrt_pd(self.0) })
    }

    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: a value of this type exists only where a token was shown.
        Avx512(unsafe { _mm512_andnot_pd(_mm512_set1_pd(-0.0), self.0) })
    }

    #[inline(always)]
    fn round(self) -> Self {
        // SAFETY: a value of this type exists only where a token was shown.
        Avx512(unsafe {
            _mm512_roundscale_pd::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(self.0)
        })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.select(self.greater(other), other)
    }

    #[inline(always)]
    fn copy_sign(self, sign: Self) -> Self {
        // SAFETY: a value of this type exists only where a token was shown.
        Avx512(unsafe {
            let bit = _mm512_set1_pd(-0.0);
            _mm512_or_pd(_mm512_andnot_pd(bit, self.0), _mm512_and_pd(bit, sign.0))
        })
    }

    #[inline(always)]
    fn greater(self, other: Self) -> Mask512 {
        // SAFETY: a value of this type exists only where a token was shown.
        Mask512(unsafe { _mm512_cmp_pd_mask::<_CMP_GT_OQ>(self.0, other.0) })
    }

    #[inline(always)]
    fn select(self, mask: Mask512, other: Self) -> Self {
        // SAFETY: a value of this type exists only where a token was shown.
        Avx512(unsafe { _mm512_mask_blend_pd(mask.0, other.0, self.0) })
    }

    #[inline(always)]
    fn exponent_mantissa(self) -> (Self, Self) {
        // SAFETY: a value of this type exists only where a token was shown.
        unsafe {
            let bits = _mm512_castpd_si512(self.0);
            let exponent = _mm512_sub_epi64(_mm512_srli_epi64::<52>(bits), _mm512_set1_epi64(1023));
            let mantissa = _mm512_or_si512(
                _mm512_and_si512(bits, _mm512_set1_epi64(0x000f_ffff_ffff_ffff)),
                _mm512_set1_epi64(0x3ff0_0000_0000_0000),
            );
            (
                Avx512(_mm512_cvtepi64_pd(exponent)),
                Avx512(_mm512_castsi512_pd(mantissa)),
            )
        }
    }

    #[inline(always)]
    fn gather(_: Avx512Token, records: &[Row], index: &[u32; LANES], field: usize) -> Self {
        let x = |k: usize| records[index[k] as usize].0[field];
        // SAFETY: the token proves that the processor has AVX-512.
        Avx512(unsafe { _mm512_set_pd(x(7), x(6), x(5), x(4), x(3), x(2), x(1), x(0)) })
    }

    #[inline(always)]
    fn differences(
        _: Avx512Token,
        records: &[Row],
        i: &[u32; LANES],
        j: &[u32; LANES],
    ) -> [Self; LANES] {
        // SAFETY: the token proves AVX-512; every index is checked and every row holds eight f64 and is aligned.
        unsafe {
            let row = |k: usize| {
                let (a, b) = (&records[i[k] as usize], &records[j[k] as usize]);
                _mm512_sub_pd(_mm512_load_pd(a.0.as_ptr()), _mm512_load_pd(b.0.as_ptr()))
            };
            let r: [__m512d; LANES] = [
                row(0),
                row(1),
                row(2),
                row(3),
                row(4),
                row(5),
                row(6),
                row(7),
            ];
            transpose(r).map(Avx512)
        }
    }
}

/// Columns of eight rows.
///
/// # Safety
/// The processor has AVX-512 F.
#[inline(always)]
unsafe fn transpose(r: [__m512d; LANES]) -> [__m512d; LANES] {
    // SAFETY: register operations only, with the feature that the caller promises.
    unsafe {
        let pair = |a, b| (_mm512_unpacklo_pd(a, b), _mm512_unpackhi_pd(a, b));
        let (a0, a1) = pair(r[0], r[1]);
        let (a2, a3) = pair(r[2], r[3]);
        let (a4, a5) = pair(r[4], r[5]);
        let (a6, a7) = pair(r[6], r[7]);
        let even = |a, b| _mm512_shuffle_f64x2::<0x88>(a, b);
        let odd = |a, b| _mm512_shuffle_f64x2::<0xdd>(a, b);
        // b: columns {0, 4} or {2, 6} (from a0, a2, a4, a6), and {1, 5} or {3, 7}, half of the rows each
        let (b0, b1) = (even(a0, a2), odd(a0, a2));
        let (b2, b3) = (even(a1, a3), odd(a1, a3));
        let (b4, b5) = (even(a4, a6), odd(a4, a6));
        let (b6, b7) = (even(a5, a7), odd(a5, a7));
        [
            even(b0, b4),
            even(b2, b6),
            even(b1, b5),
            even(b3, b7),
            odd(b0, b4),
            odd(b2, b6),
            odd(b1, b5),
            odd(b3, b7),
        ]
    }
}
