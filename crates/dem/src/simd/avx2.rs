//! AVX2 with FMA: four registers.

#[allow(clippy::wildcard_imports, reason = "dozens of intrinsics")]
use std::arch::x86_64::*;
use std::arch::x86_64::{
    _mm256_add_epi64 as add_int, _mm256_add_pd as add_pd, _mm256_and_pd as and_pd,
    _mm256_and_si256 as and_int, _mm256_andnot_pd as andnot_pd, _mm256_castpd_si256 as pd_as_int,
    _mm256_castsi256_pd as int_as_pd, _mm256_div_pd as div_pd, _mm256_fmadd_pd as fmadd_pd,
    _mm256_load_pd as load_pd, _mm256_max_pd as max_pd, _mm256_mul_pd as mul_pd,
    _mm256_or_pd as or_pd, _mm256_round_pd as round_pd, _mm256_set1_epi64x as set1_int,
    _mm256_set1_pd as set1_pd, _mm256_setzero_si256 as setzero_int, _mm256_sqrt_pd as sqrt_pd,
    _mm256_srli_epi64 as shift_right_int, _mm256_store_pd as store_pd,
    _mm256_storeu_si256 as storeu_int, _mm256_sub_epi64 as sub_int, _mm256_sub_pd as sub_pd,
    _mm256_xor_pd as xor_pd,
};
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::vector::{operations, registers, rounding_to_eighths, token};
use super::{
    CacheLine, Force2, INVERSE_MAGIC, INVERSE_SQRT_MAGIC, LANES, Lanes, Lanes16, Mask, PairBlock,
    Pairs, TO_INTEGER, Work,
};

token!(Avx2, Avx2Token, "AVX2 and FMA", ["avx2" "fma"]);
registers!(Avx2, Counts2, __m256d, __m256i, [0 1 2 3]);
rounding_to_eighths!(__m256d, __m256i);

#[derive(Debug, Clone, Copy)]
pub struct Mask2([__m256d; 4]);

impl Mask for Mask2 {
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        // SAFETY: a mask is only made from a token.
        Mask2(each(|k| unsafe { _mm256_and_pd(self.0[k], other.0[k]) }))
    }

    #[inline(always)]
    fn bits(self) -> u16 {
        // SAFETY: a mask is only made from a token.
        let four = each(|k| unsafe { _mm256_movemask_pd(self.0[k]) });
        (four[0] | four[1] << 4 | four[2] << 8 | four[3] << 12) as u16
    }
}

/// Integers from 0 to 7: each a permutation of the 32-bit words of half a table of eight f64, and,
/// in the sign, which half.
#[derive(Debug, Clone, Copy)]
pub struct Eighths2([(__m256i, __m256d); 4]);

impl Lanes for Avx2 {
    type Token = Avx2Token;
    type Mask = Mask2;
    type Index = Eighths2;
    type Counts = Counts2;

    operations!(Avx2, Avx2Token, Counts2, 4, [0 1 2 3]);

    #[inline(always)]
    fn mask(_: Avx2Token, bits: u16) -> Mask2 {
        Mask2(each(|k| {
            let bit = |lane: usize| 1i64 << (4 * k + lane);
            // SAFETY: the token proves that the processor has the instruction set.
            unsafe {
                let lanes = _mm256_set_epi64x(bit(3), bit(2), bit(1), bit(0));
                let set = and_int(set1_int(i64::from(bits)), lanes);
                int_as_pd(_mm256_cmpeq_epi64(set, lanes))
            }
        }))
    }

    #[inline(always)]
    fn greater(self, other: Self) -> Mask2 {
        // SAFETY: a value of this type is only made from a token.
        Mask2(each(|k| unsafe {
            _mm256_cmp_pd::<_CMP_GT_OQ>(self.0[k], other.0[k])
        }))
    }

    #[inline(always)]
    fn select(self, mask: Mask2, other: Self) -> Self {
        // SAFETY: a value of this type is only made from a token.
        Avx2(each(|k| unsafe {
            _mm256_blendv_pd(other.0[k], self.0[k], mask.0[k])
        }))
    }

    #[inline(always)]
    fn exponent_mantissa(self) -> (Self, Self) {
        // SAFETY: a value of this type is only made from a token.
        let exponent = self.map(|x| unsafe { exponent(_mm256_castpd_si256(x)) });
        // SAFETY: a value of this type is only made from a token.
        let mantissa = self.map(|x| unsafe {
            let digits = and_int(pd_as_int(x), set1_int(0x000f_ffff_ffff_ffff));
            int_as_pd(_mm256_or_si256(digits, set1_int(0x3ff0_0000_0000_0000)))
        });
        (exponent, mantissa)
    }

    #[inline(always)]
    fn exponent_eighth(self) -> (Self, Self, Eighths2) {
        // SAFETY: a value of this type is only made from a token.
        unsafe {
            // No closures: the compiler does not inline ones of this length.
            let [a, b, c, d] = self.0;
            let [e, f, g, h] = [rounded(a), rounded(b), rounded(c), rounded(d)];
            let exponent = [exponent(e), exponent(f), exponent(g), exponent(h)];
            let mantissa = [
                mantissa_about_one(a),
                mantissa_about_one(b),
                mantissa_about_one(c),
                mantissa_about_one(d),
            ];
            let index = [eighth(a), eighth(b), eighth(c), eighth(d)];
            (Avx2(exponent), Avx2(mantissa), Eighths2(index))
        }
    }

    #[inline(always)]
    fn look_up(_: Avx2Token, table: &[f64; 8], k: Eighths2) -> Self {
        // SAFETY: the token proves that the processor has AVX2; four f64 are read from each
        // pointer.
        unsafe {
            let low = _mm256_castpd_ps(_mm256_loadu_pd(table.as_ptr()));
            let high = _mm256_castpd_ps(_mm256_loadu_pd(table.as_ptr().add(4)));
            Avx2(each(|n| {
                let (words, upper) = k.0[n];
                _mm256_blendv_pd(
                    _mm256_castps_pd(_mm256_permutevar8x32_ps(low, words)),
                    _mm256_castps_pd(_mm256_permutevar8x32_ps(high, words)),
                    upper,
                )
            }))
        }
    }

    #[inline(always)]
    fn differences<const LINE: usize, const LINES: usize>(
        _: Avx2Token,
        records: &[[CacheLine; LINES]],
        pairs: PairBlock<'_>,
        out: &mut [Lanes16; 8],
        mut of_j: Option<&mut [Lanes16; 8]>,
    ) {
        let pairs = pairs.within(records.len());
        for lane in (0..LANES).step_by(4) {
            for from in [0, 4] {
                // SAFETY: the token proves AVX2; the indices were checked by `within`, and every
                // cache line holds eight f64 and is aligned. `Lanes16` holds sixteen f64 and is
                // aligned; four are written, from a multiple of four on.
                unsafe {
                    let [difference, second] = columns::<LINE, LINES>(records, pairs, lane, from);
                    for (column, lanes) in difference.into_iter().zip(&mut out[from..]) {
                        _mm256_store_pd(lanes.0.as_mut_ptr().add(lane), column);
                    }
                    if let Some(of_j) = &mut of_j {
                        for (column, lanes) in second.into_iter().zip(&mut of_j[from..]) {
                            _mm256_store_pd(lanes.0.as_mut_ptr().add(lane), column);
                        }
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn last_two_of_j<const LINE: usize, const LINES: usize>(
        _: Avx2Token,
        records: &[[CacheLine; LINES]],
        pairs: PairBlock<'_>,
    ) -> [Self; 2] {
        let pairs = pairs.within(records.len());
        // SAFETY: the token proves AVX2; the indices were checked by `within`, and a cache line
        // holds eight f64, of which the last two are read.
        unsafe {
            let mut even = [_mm256_setzero_pd(); 4];
            let mut odd = even;
            for k in 0..4 {
                even[k] = two_ends::<LINE, LINES>(records, pairs, 4 * k);
                odd[k] = two_ends::<LINE, LINES>(records, pairs, 4 * k + 1);
            }
            [
                Avx2(each(|k| _mm256_unpacklo_pd(even[k], odd[k]))),
                Avx2(each(|k| _mm256_unpackhi_pd(even[k], odd[k]))),
            ]
        }
    }

    #[inline(always)]
    fn add_forces_2d(terms: [Self; 4], sums: &mut [Force2], pairs: PairBlock<'_>) {
        let pairs = pairs.within(sums.len());
        // SAFETY: a value of this type is only made from a token; the indices were checked by
        // `within`, and every element of `sums` holds four f64 and is aligned.
        unsafe {
            let [a, b, c, d] = terms;
            let zero = _mm256_setzero_pd();
            for part in 0..4 {
                let (a, b, c) = (a.0[part], b.0[part], c.0[part]);
                let on_i = transpose([a, b, c, zero]);
                let on_j = transpose([a, b, _mm256_sub_pd(zero, d.0[part]), zero]);
                for k in 0..4 {
                    let lane = 4 * part + k;
                    let to = sums.as_mut_ptr().add(pairs.i[lane] as usize).cast::<f64>();
                    _mm256_store_pd(to, _mm256_add_pd(_mm256_load_pd(to), on_i[k]));
                    let to = sums.as_mut_ptr().add(pairs.j[lane] as usize).cast::<f64>();
                    _mm256_store_pd(to, _mm256_sub_pd(_mm256_load_pd(to), on_j[k]));
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
            let [a, b, c] = terms;
            let zero = _mm256_setzero_pd();
            for part in 0..4 {
                let (x, y, z) = (a[0].0[part], a[1].0[part], a[2].0[part]);
                let c_x = _mm256_sub_pd(zero, c[0].0[part]);
                let c_y = _mm256_sub_pd(zero, c[1].0[part]);
                let c_z = _mm256_sub_pd(zero, c[2].0[part]);
                let low_i = transpose([x, y, z, b[0].0[part]]);
                let high_i = transpose([b[1].0[part], b[2].0[part], zero, zero]);
                let low_j = transpose([x, y, z, c_x]);
                let high_j = transpose([c_y, c_z, zero, zero]);
                for k in 0..4 {
                    let lane = 4 * part + k;
                    let to = sums.as_mut_ptr().add(pairs.i[lane] as usize).cast::<f64>();
                    _mm256_store_pd(to, _mm256_add_pd(_mm256_load_pd(to), low_i[k]));
                    let to = to.add(4);
                    _mm256_store_pd(to, _mm256_add_pd(_mm256_load_pd(to), high_i[k]));
                    let to = sums.as_mut_ptr().add(pairs.j[lane] as usize).cast::<f64>();
                    _mm256_store_pd(to, _mm256_sub_pd(_mm256_load_pd(to), low_j[k]));
                    let to = to.add(4);
                    _mm256_store_pd(to, _mm256_sub_pd(_mm256_load_pd(to), high_j[k]));
                }
            }
        }
    }
}

/// The k for which the mantissa of x is nearest to 1 + k/8, as in [`Eighths2`].
///
/// # Safety
/// The processor has AVX2.
#[inline(always)]
unsafe fn eighth(x: __m256d) -> (__m256i, __m256d) {
    // SAFETY: register operations only, with the feature that the caller guarantees.
    unsafe {
        let bits = rounded(x);
        // 2 (k mod 4) and 2 (k mod 4) + 1 in the halves of a lane, for a permutation of 32-bit
        // words.
        let twice = _mm256_and_si256(_mm256_srli_epi64::<48>(bits), _mm256_set1_epi64x(6));
        let next = _mm256_or_si256(_mm256_slli_epi64::<32>(twice), _mm256_set1_epi64x(1 << 32));
        // k ≥ 4 in the sign.
        (
            _mm256_or_si256(twice, next),
            _mm256_castsi256_pd(_mm256_slli_epi64::<12>(bits)),
        )
    }
}

/// Transposed differences i - j of four pairs, from `lane` on, and the records j: four fields, from
/// the field `from` on.
///
/// # Safety
/// The processor has AVX, and the indices are below `records.len()`.
#[inline(always)]
unsafe fn columns<const LINE: usize, const LINES: usize>(
    records: &[[CacheLine; LINES]],
    pairs: &Pairs,
    lane: usize,
    from: usize,
) -> [[__m256d; 4]; 2] {
    // SAFETY: as the caller guarantees; every cache line holds eight f64 and is aligned, four of
    // which are read from `from` on.
    unsafe {
        let mut difference = [_mm256_setzero_pd(); 4];
        let mut of_j = difference;
        for k in 0..4 {
            let a = &records.get_unchecked(pairs.i[lane + k] as usize)[LINE];
            let b = &records.get_unchecked(pairs.j[lane + k] as usize)[LINE];
            of_j[k] = _mm256_load_pd(b.0.as_ptr().add(from));
            let of_i = _mm256_load_pd(a.0.as_ptr().add(from));
            difference[k] = _mm256_sub_pd(of_i, of_j[k]);
            if LINE == 1 && from == 4 {
                difference[k] = _mm256_blend_pd::<0b1000>(difference[k], of_i);
            }
        }
        [transpose(difference), transpose(of_j)]
    }
}

/// The last two fields of a cache line of the records `pairs.j` of `lane` and `lane + 2`.
///
/// # Safety
/// The processor has AVX, and the indices are below `records.len()`.
#[inline(always)]
unsafe fn two_ends<const LINE: usize, const LINES: usize>(
    records: &[[CacheLine; LINES]],
    pairs: &Pairs,
    lane: usize,
) -> __m256d {
    // SAFETY: as the caller guarantees; every cache line holds eight f64 and is aligned.
    unsafe {
        let a = &records.get_unchecked(pairs.j[lane] as usize)[LINE];
        let b = &records.get_unchecked(pairs.j[lane + 2] as usize)[LINE];
        _mm256_set_m128d(
            _mm_load_pd(b.0.as_ptr().add(6)),
            _mm_load_pd(a.0.as_ptr().add(6)),
        )
    }
}

/// Exponents of normal numbers, given by their bits.
///
/// # Safety
/// The processor has AVX2.
#[inline(always)]
unsafe fn exponent(bits: __m256i) -> __m256d {
    // SAFETY: register operations only, with the feature that the caller guarantees.
    unsafe {
        // The biased exponent in the low bits of 2^52 is 2^52 + exponent, exactly.
        let biased = shift_right_int::<52>(bits);
        let shifted = int_as_pd(_mm256_or_si256(biased, set1_int(0x4330_0000_0000_0000)));
        sub_pd(shifted, set1_pd(4503599627370496.0 + 1023.0))
    }
}

/// Transposes a matrix of four rows.
///
/// # Safety
/// The processor has AVX.
#[inline(always)]
unsafe fn transpose(r: [__m256d; 4]) -> [__m256d; 4] {
    // SAFETY: register operations only, with the feature that the caller guarantees.
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
