//! AVX-512 (F and DQ): two registers, so that the processor overlaps two chains of operations.

#[allow(clippy::wildcard_imports, reason = "dozens of intrinsics")]
use std::arch::x86_64::*;
use std::arch::x86_64::{
    _mm512_add_epi64 as add_int, _mm512_add_pd as add_pd, _mm512_and_pd as and_pd,
    _mm512_and_si512 as and_int, _mm512_andnot_pd as andnot_pd, _mm512_castpd_si512 as pd_as_int,
    _mm512_castsi512_pd as int_as_pd, _mm512_div_pd as div_pd, _mm512_fmadd_pd as fmadd_pd,
    _mm512_load_pd as load_pd, _mm512_max_pd as max_pd, _mm512_mul_pd as mul_pd,
    _mm512_or_pd as or_pd, _mm512_roundscale_pd as round_pd, _mm512_set1_epi64 as set1_int,
    _mm512_set1_pd as set1_pd, _mm512_setzero_si512 as setzero_int, _mm512_sqrt_pd as sqrt_pd,
    _mm512_srli_epi64 as shift_right_int, _mm512_store_pd as store_pd,
    _mm512_storeu_si512 as storeu_int, _mm512_sub_epi64 as sub_int, _mm512_sub_pd as sub_pd,
    _mm512_xor_pd as xor_pd,
};
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::vector::{operations, registers, rounding_to_eighths, token};
use super::{
    CacheLine, Force2, INVERSE_MAGIC, INVERSE_SQRT_MAGIC, LANES, Lanes, Lanes16, Mask, PairBlock,
    Pairs, TO_INTEGER, Work,
};

token!(Avx512, Avx512Token, "AVX-512 F and DQ", ["avx512f" "avx512dq" "avx2" "fma"]);
registers!(Avx512, Counts512, __m512d, __m512i, [0 1]);
rounding_to_eighths!(__m512d, __m512i);

#[derive(Debug, Clone, Copy)]
pub struct Mask512([__mmask8; 2]);

impl Mask for Mask512 {
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Mask512([self.0[0] & other.0[0], self.0[1] & other.0[1]])
    }

    #[inline(always)]
    fn bits(self) -> u16 {
        u16::from(self.0[0]) | (u16::from(self.0[1]) << 8)
    }
}

/// Integers from 0 to 7, in the last three bits.
#[derive(Debug, Clone, Copy)]
pub struct Eighths512([__m512i; 2]);

impl Lanes for Avx512 {
    type Token = Avx512Token;
    type Mask = Mask512;
    type Index = Eighths512;
    type Counts = Counts512;

    operations!(Avx512, Avx512Token, Counts512, 8, [0 1]);

    #[inline(always)]
    fn mask(_: Avx512Token, bits: u16) -> Mask512 {
        Mask512([bits as __mmask8, (bits >> 8) as __mmask8])
    }

    #[inline(always)]
    fn greater(self, other: Self) -> Mask512 {
        // SAFETY: a value of this type is only made from a token.
        Mask512(each(|k| unsafe {
            _mm512_cmp_pd_mask::<_CMP_GT_OQ>(self.0[k], other.0[k])
        }))
    }

    #[inline(always)]
    fn select(self, mask: Mask512, other: Self) -> Self {
        // SAFETY: a value of this type is only made from a token.
        Avx512(each(|k| unsafe {
            _mm512_mask_blend_pd(mask.0[k], other.0[k], self.0[k])
        }))
    }

    #[inline(always)]
    fn exponent_mantissa(self) -> (Self, Self) {
        // SAFETY: a value of this type is only made from a token.
        unsafe {
            (
                self.map(|x| _mm512_getexp_pd(x)),
                self.map(|x| _mm512_getmant_pd::<_MM_MANT_NORM_1_2, _MM_MANT_SIGN_SRC>(x)),
            )
        }
    }

    #[inline(always)]
    fn exponent_eighth(self) -> (Self, Self, Eighths512) {
        // SAFETY: a value of this type is only made from a token.
        unsafe {
            (
                self.map(|x| _mm512_getexp_pd(_mm512_castsi512_pd(rounded(x)))),
                self.map(|x| mantissa_about_one(x)),
                Eighths512(each(|k| _mm512_srli_epi64::<49>(rounded(self.0[k])))),
            )
        }
    }

    #[inline(always)]
    fn look_up(_: Avx512Token, table: &[f64; 8], k: Eighths512) -> Self {
        // SAFETY: the token proves that the processor has AVX-512; eight f64 are read; of an index
        // the last three bits count.
        unsafe {
            let table = _mm512_loadu_pd(table.as_ptr());
            Avx512(each(|n| _mm512_permutexvar_pd(k.0[n], table)))
        }
    }

    #[inline(always)]
    fn differences<const LINE: usize, const LINES: usize>(
        _: Avx512Token,
        records: &[[CacheLine; LINES]],
        pairs: PairBlock<'_>,
        out: &mut [Lanes16; 8],
        of_j: Option<&mut [Lanes16; 8]>,
    ) {
        let pairs = pairs.within(records.len());
        // SAFETY: the token proves AVX-512; the indices were checked by `within`, and every cache
        // line holds eight f64 and is aligned.
        let [a, b] = unsafe {
            let first = columns::<LINE, LINES>(records, pairs, 0);
            [first, columns::<LINE, LINES>(records, pairs, 8)]
        };
        for (k, lanes) in out.iter_mut().enumerate() {
            Avx512([a[0][k], b[0][k]]).store(lanes);
        }
        for (k, lanes) in of_j.into_iter().flatten().enumerate() {
            Avx512([a[1][k], b[1][k]]).store(lanes);
        }
    }

    #[inline(always)]
    fn last_two_of_j<const LINE: usize, const LINES: usize>(
        _: Avx512Token,
        records: &[[CacheLine; LINES]],
        pairs: PairBlock<'_>,
    ) -> [Self; 2] {
        let pairs = pairs.within(records.len());
        // SAFETY: the token proves AVX-512; the indices were checked by `within`, and a cache line
        // holds eight f64, of which the last two are read.
        unsafe {
            let mut even = [_mm512_setzero_pd(); 2];
            let mut odd = even;
            for k in 0..2 {
                even[k] = four_ends::<LINE, LINES>(records, pairs, 8 * k);
                odd[k] = four_ends::<LINE, LINES>(records, pairs, 8 * k + 1);
            }
            [
                Avx512(each(|k| _mm512_unpacklo_pd(even[k], odd[k]))),
                Avx512(each(|k| _mm512_unpackhi_pd(even[k], odd[k]))),
            ]
        }
    }

    #[inline(always)]
    fn add_forces_2d(terms: [Self; 4], sums: &mut [Force2], pairs: PairBlock<'_>) {
        let pairs = pairs.within(sums.len());
        // SAFETY: a value of this type is only made from a token; the indices were checked by
        // `within`, and every element of `sums` holds four f64 and is aligned.
        unsafe {
            let zero = _mm512_setzero_pd();
            let [a, b, c, d] = terms;
            for part in 0..2 {
                let (a, b, c) = (a.0[part], b.0[part], c.0[part]);
                let d = _mm512_sub_pd(zero, d.0[part]);
                let (ab_even, ab_odd) = (_mm512_unpacklo_pd(a, b), _mm512_unpackhi_pd(a, b));
                let (c_even, c_odd) = (_mm512_unpacklo_pd(c, zero), _mm512_unpackhi_pd(c, zero));
                let (d_even, d_odd) = (_mm512_unpacklo_pd(d, zero), _mm512_unpackhi_pd(d, zero));
                let on_i = interleaved([ab_even, ab_odd], [c_even, c_odd]);
                let on_j = interleaved([ab_even, ab_odd], [d_even, d_odd]);
                for k in 0..8 {
                    let lane = 8 * part + k;
                    let to = sums.as_mut_ptr().add(pairs.i[lane] as usize).cast::<f64>();
                    _mm256_store_pd(to, _mm256_add_pd(_mm256_load_pd(to), of_lane(&on_i, k)));
                    let to = sums.as_mut_ptr().add(pairs.j[lane] as usize).cast::<f64>();
                    _mm256_store_pd(to, _mm256_sub_pd(_mm256_load_pd(to), of_lane(&on_j, k)));
                }
            }
        }
    }

    #[inline(always)]
    fn add_forces_3d(terms: [[Self; 3]; 3], sums: &mut [CacheLine], pairs: PairBlock<'_>) {
        let pairs = pairs.within(sums.len());
        // SAFETY: a value of this type is only made from a token; the indices were checked by
        // `within`, and every element of `sums` holds eight f64 and is aligned.
        unsafe {
            let zero = _mm512_setzero_pd();
            let [a, b, c] = terms;
            for part in 0..2 {
                let (x, y, z) = (a[0].0[part], a[1].0[part], a[2].0[part]);
                let (b_x, b_y, b_z) = (b[0].0[part], b[1].0[part], b[2].0[part]);
                let c_x = _mm512_sub_pd(zero, c[0].0[part]);
                let c_y = _mm512_sub_pd(zero, c[1].0[part]);
                let c_z = _mm512_sub_pd(zero, c[2].0[part]);
                let on_i = transpose([x, y, z, b_x, b_y, b_z, zero, zero]);
                let on_j = transpose([x, y, z, c_x, c_y, c_z, zero, zero]);
                for k in 0..8 {
                    let lane = 8 * part + k;
                    let to = sums.as_mut_ptr().add(pairs.i[lane] as usize).cast::<f64>();
                    _mm512_store_pd(to, _mm512_add_pd(_mm512_load_pd(to), on_i[k]));
                    let to = sums.as_mut_ptr().add(pairs.j[lane] as usize).cast::<f64>();
                    _mm512_store_pd(to, _mm512_sub_pd(_mm512_load_pd(to), on_j[k]));
                }
            }
        }
    }
}

// Functions instead of closures: a closure that is not inlined is not compiled for the instruction
// set.

/// Transposed differences i - j of eight pairs, from `first` on, and the records j.
///
/// # Safety
/// The processor has AVX-512 F, and the indices are below `records.len()`.
#[inline(always)]
unsafe fn columns<const LINE: usize, const LINES: usize>(
    records: &[[CacheLine; LINES]],
    pairs: &Pairs,
    first: usize,
) -> [[__m512d; 8]; 2] {
    // SAFETY: as the caller guarantees; every cache line holds eight f64 and is aligned.
    unsafe {
        let mut difference = [_mm512_setzero_pd(); 8];
        let mut of_j = difference;
        for k in 0..8 {
            let a = &records.get_unchecked(pairs.i[first + k] as usize)[LINE];
            let b = &records.get_unchecked(pairs.j[first + k] as usize)[LINE];
            of_j[k] = _mm512_load_pd(b.0.as_ptr());
            let of_i = _mm512_load_pd(a.0.as_ptr());
            let subtracted = if LINE == 1 { 0x7f } else { 0xff };
            difference[k] = _mm512_mask_sub_pd(of_i, subtracted, of_i, of_j[k]);
        }
        [transpose(difference), transpose(of_j)]
    }
}

/// The last two fields of a cache line of four records `pairs.j`, of every other lane from `first`
/// on.
///
/// # Safety
/// The processor has AVX-512 DQ, and the indices are below `records.len()`.
#[inline(always)]
unsafe fn four_ends<const LINE: usize, const LINES: usize>(
    records: &[[CacheLine; LINES]],
    pairs: &Pairs,
    first: usize,
) -> __m512d {
    // SAFETY: as the caller guarantees; every cache line holds eight f64 and is aligned.
    unsafe {
        let mut ends = [_mm512_setzero_pd(); 4];
        for (k, end) in ends.iter_mut().enumerate() {
            let record = records.get_unchecked(pairs.j[first + 2 * k] as usize);
            *end = _mm512_broadcast_f64x2(_mm_load_pd(record[LINE].0.as_ptr().add(6)));
        }
        let a = _mm512_mask_blend_pd(0b0000_1100, ends[0], ends[1]);
        let b = _mm512_mask_blend_pd(0b0011_0000, a, ends[2]);
        _mm512_mask_blend_pd(0b1100_0000, b, ends[3])
    }
}

/// Interleaves (a, b) and (c, 0) of the even and the odd lanes to (a, b, c, 0) of the lanes {0, 2},
/// {1, 3}, {4, 6} and {5, 7}.
///
/// # Safety
/// The processor has AVX-512 F.
#[inline(always)]
unsafe fn interleaved(ab: [__m512d; 2], c: [__m512d; 2]) -> [__m512d; 4] {
    // SAFETY: register operations only, with the feature that the caller guarantees.
    unsafe {
        let low = _mm512_set_epi64(11, 10, 3, 2, 9, 8, 1, 0);
        let high = _mm512_set_epi64(15, 14, 7, 6, 13, 12, 5, 4);
        [
            _mm512_permutex2var_pd(ab[0], low, c[0]),
            _mm512_permutex2var_pd(ab[1], low, c[1]),
            _mm512_permutex2var_pd(ab[0], high, c[0]),
            _mm512_permutex2var_pd(ab[1], high, c[1]),
        ]
    }
}

/// (a, b, c, 0) of one lane, from the result of [`interleaved`].
///
/// # Safety
/// The processor has AVX-512 F.
#[inline(always)]
unsafe fn of_lane(terms: &[__m512d; 4], lane: usize) -> __m256d {
    let both = terms[lane % 2 + lane / 4 * 2];
    // SAFETY: register operations only, with the feature that the caller guarantees.
    unsafe {
        if (lane / 2).is_multiple_of(2) {
            _mm512_castpd512_pd256(both)
        } else {
            _mm512_extractf64x4_pd::<1>(both)
        }
    }
}

/// Transposes a matrix of eight rows.
///
/// # Safety
/// The processor has AVX-512 F.
#[inline(always)]
unsafe fn transpose(r: [__m512d; 8]) -> [__m512d; 8] {
    // SAFETY: register operations only, with the feature that the caller guarantees.
    unsafe {
        let mut a = [_mm512_setzero_pd(); 8];
        for k in 0..4 {
            a[k] = _mm512_unpacklo_pd(r[2 * k], r[2 * k + 1]);
            a[k + 4] = _mm512_unpackhi_pd(r[2 * k], r[2 * k + 1]);
        }
        // b: columns {0, 4} or {2, 6} of the first four rows and of the last four, then {1, 5} or
        // {3, 7}.
        let mut b = [_mm512_setzero_pd(); 8];
        for k in 0..4 {
            b[2 * k] = _mm512_shuffle_f64x2::<0x88>(a[2 * k], a[2 * k + 1]);
            b[2 * k + 1] = _mm512_shuffle_f64x2::<0xdd>(a[2 * k], a[2 * k + 1]);
        }
        [
            _mm512_shuffle_f64x2::<0x88>(b[0], b[2]),
            _mm512_shuffle_f64x2::<0x88>(b[4], b[6]),
            _mm512_shuffle_f64x2::<0x88>(b[1], b[3]),
            _mm512_shuffle_f64x2::<0x88>(b[5], b[7]),
            _mm512_shuffle_f64x2::<0xdd>(b[0], b[2]),
            _mm512_shuffle_f64x2::<0xdd>(b[4], b[6]),
            _mm512_shuffle_f64x2::<0xdd>(b[1], b[3]),
            _mm512_shuffle_f64x2::<0xdd>(b[5], b[7]),
        ]
    }
}
