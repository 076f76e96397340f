//! AVX2 with FMA: four registers.

#[allow(clippy::wildcard_imports, reason = "dozens of intrinsics")]
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::{
    CacheLine, Force2, Force3, INVERSE_MAGIC, INVERSE_SQRT_MAGIC, LANES, Lanes, Lanes16, Mask,
    PairList, Pairs, TO_INTEGER, Work,
};

/// Proof that this processor has AVX2 and FMA.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Avx2Token(());

impl Avx2Token {
    /// The token, if this processor has them.
    pub fn detect() -> Option<Self> {
        (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Self(()))
    }
}

/// Does the work, compiled for this instruction set.
pub(super) fn run<W: Work>(token: Avx2Token, work: W) -> W::Output {
    #[target_feature(enable = "avx2,fma")]
    fn compiled<W: Work>(token: Avx2Token, work: W) -> W::Output {
        work.run::<Avx2>(token)
    }
    // SAFETY: the token proves that the processor has these features.
    unsafe { compiled(token, work) }
}

/// Sixteen f64 in AVX2 registers.
#[derive(Debug, Clone, Copy)]
pub struct Avx2([__m256d; 4]);

macro_rules! operator {
    ($trait:ident, $method:ident, $intrinsic:ident) => {
        impl $trait for Avx2 {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: a value of this type is only made from a token.
                self.zip(other, |a, b| unsafe { $intrinsic(a, b) })
            }
        }
    };
}
operator!(Add, add, _mm256_add_pd);
operator!(Sub, sub, _mm256_sub_pd);
operator!(Mul, mul, _mm256_mul_pd);
operator!(Div, div, _mm256_div_pd);

/// `[f(0), …, f(3)]`. Unlike `array::from_fn` it is always inlined; code that is not inlined is not
/// compiled for the instruction set.
#[inline(always)]
fn each<T>(f: impl Fn(usize) -> T) -> [T; 4] {
    [f(0), f(1), f(2), f(3)]
}

impl Avx2 {
    #[inline(always)]
    fn map(self, f: impl Fn(__m256d) -> __m256d) -> Self {
        Avx2(each(|k| f(self.0[k])))
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(__m256d, __m256d) -> __m256d) -> Self {
        Avx2(each(|k| f(self.0[k], other.0[k])))
    }
}

impl Neg for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: a value of this type is only made from a token.
        self.map(|x| unsafe { _mm256_xor_pd(x, _mm256_set1_pd(-0.0)) })
    }
}

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

/// Sixteen sums of integers.
#[derive(Debug, Clone, Copy)]
pub struct Counts2([__m256i; 4]);

/// Integers from 0 to 7: each a permutation of the 32-bit words of half a table of eight f64, and,
/// in the sign, which half.
#[derive(Debug, Clone, Copy)]
pub struct Eighths2([(__m256i, __m256d); 4]);

impl Lanes for Avx2 {
    type Token = Avx2Token;
    type Mask = Mask2;
    type Index = Eighths2;
    type Counts = Counts2;

    #[inline(always)]
    fn splat(_: Avx2Token, x: f64) -> Self {
        // SAFETY: the token proves that the processor has AVX2.
        Avx2(unsafe { [_mm256_set1_pd(x); 4] })
    }

    #[inline(always)]
    fn load(_: Avx2Token, from: &Lanes16) -> Self {
        // SAFETY: the token proves AVX2; `Lanes16` holds sixteen f64 and is aligned; four are read
        // from each pointer.
        Avx2(each(|k| unsafe {
            _mm256_load_pd(from.0.as_ptr().add(4 * k))
        }))
    }

    #[inline(always)]
    fn store(self, to: &mut Lanes16) {
        for (k, part) in self.0.into_iter().enumerate() {
            // SAFETY: a value of this type is only made from a token; `Lanes16` holds sixteen f64
            // and is aligned.
            unsafe { _mm256_store_pd(to.0.as_mut_ptr().add(4 * k), part) }
        }
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        // SAFETY: a value of this type is only made from a token.
        Avx2(each(|k| unsafe {
            _mm256_fmadd_pd(self.0[k], factor.0[k], term.0[k])
        }))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: a value of this type is only made from a token.
        self.map(|x| unsafe { _mm256_sqrt_pd(x) })
    }

    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: a value of this type is only made from a token.
        self.map(|x| unsafe { _mm256_andnot_pd(_mm256_set1_pd(-0.0), x) })
    }

    #[inline(always)]
    fn round(self) -> Self {
        // SAFETY: a value of this type is only made from a token.
        self.map(|x| unsafe {
            _mm256_round_pd::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(x)
        })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: a value of this type is only made from a token.
        self.zip(other, |a, b| unsafe { _mm256_max_pd(a, b) })
    }

    #[inline(always)]
    fn copy_sign(self, sign: Self) -> Self {
        // SAFETY: a value of this type is only made from a token.
        self.zip(sign, |x, s| unsafe {
            let bit = _mm256_set1_pd(-0.0);
            _mm256_or_pd(_mm256_andnot_pd(bit, x), _mm256_and_pd(bit, s))
        })
    }

    #[inline(always)]
    fn greater(self, other: Self) -> Mask2 {
        // SAFETY: a value of this type is only made from a token.
        Mask2(
            self.zip(other, |a, b| unsafe { _mm256_cmp_pd::<_CMP_GT_OQ>(a, b) })
                .0,
        )
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
    fn exponent_eighth(self) -> (Self, Self, Eighths2) {
        // SAFETY: a value of this type is only made from a token.
        unsafe {
            // No closures: the compiler does not inline ones of this length.
            let [a, b, c, d] = self.0;
            let exponent = [
                exponent(rounded(a)),
                exponent(rounded(b)),
                exponent(rounded(c)),
                exponent(rounded(d)),
            ];
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
            let (low, high) = (
                _mm256_castpd_ps(_mm256_loadu_pd(table.as_ptr())),
                _mm256_castpd_ps(_mm256_loadu_pd(table.as_ptr().add(4))),
            );
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
    fn no_counts(_: Avx2Token) -> Counts2 {
        // SAFETY: the token proves that the processor has AVX2.
        Counts2(unsafe { [_mm256_setzero_si256(); 4] })
    }

    #[inline(always)]
    fn count(self, sums: Counts2) -> Counts2 {
        let mut sums = sums;
        for (sum, x) in sums.0.iter_mut().zip(self.0) {
            // SAFETY: a value of this type is only made from a token.
            unsafe {
                let shifted = _mm256_add_pd(x, _mm256_set1_pd(TO_INTEGER));
                let zero = _mm256_set1_epi64x(TO_INTEGER.to_bits() as i64);
                let integer = _mm256_sub_epi64(_mm256_castpd_si256(shifted), zero);
                *sum = _mm256_add_epi64(*sum, integer);
            }
        }
        sums
    }

    #[inline(always)]
    fn total(sums: Counts2) -> i128 {
        let mut all = [0i64; 16];
        for (k, sum) in sums.0.into_iter().enumerate() {
            // SAFETY: sums are only made from a token; four i64 are written from each pointer.
            unsafe { _mm256_storeu_si256(all.as_mut_ptr().add(4 * k).cast(), sum) }
        }
        all.iter().copied().map(i128::from).sum()
    }

    #[inline(always)]
    fn inverse_start(self) -> Self {
        // SAFETY: a value of this type is only made from a token.
        self.map(|x| unsafe {
            _mm256_castsi256_pd(_mm256_sub_epi64(
                _mm256_set1_epi64x(INVERSE_MAGIC as i64),
                _mm256_castpd_si256(x),
            ))
        })
    }

    #[inline(always)]
    fn inverse_sqrt_start(self) -> Self {
        // SAFETY: a value of this type is only made from a token.
        self.map(|x| unsafe {
            _mm256_castsi256_pd(_mm256_sub_epi64(
                _mm256_set1_epi64x(INVERSE_SQRT_MAGIC as i64),
                _mm256_srli_epi64::<1>(_mm256_castpd_si256(x)),
            ))
        })
    }

    #[inline(always)]
    fn differences<const LINE: usize, const LINES: usize>(
        _: Avx2Token,
        records: &[[CacheLine; LINES]],
        list: &PairList,
        block: usize,
        out: &mut [Lanes16; 8],
    ) {
        let pairs = list.within(block, records.len());
        for lane in (0..LANES).step_by(4) {
            for from in [0, 4] {
                // SAFETY: the token proves AVX2; the indices were checked by `within`, and every
                // cache line holds eight f64 and is aligned.
                let columns = unsafe { columns::<LINE, LINES>(records, pairs, lane, from) };
                for (column, lanes) in columns.into_iter().zip(&mut out[from..]) {
                    // SAFETY: `Lanes16` holds sixteen f64 and is aligned; four are written, from a
                    // multiple of four on.
                    unsafe { _mm256_store_pd(lanes.0.as_mut_ptr().add(lane), column) }
                }
            }
        }
    }

    #[inline(always)]
    fn cache_line_of_j<const LINE: usize, const LINES: usize>(
        _: Avx2Token,
        records: &[[CacheLine; LINES]],
        list: &PairList,
        block: usize,
    ) -> [Self; 8] {
        let pairs = list.within(block, records.len());
        // SAFETY: the token proves AVX2; the indices were checked by `within`, and every cache line
        // holds eight f64 and is aligned.
        unsafe {
            let mut low = [[_mm256_setzero_pd(); 4]; 4];
            let mut high = low;
            for k in 0..4 {
                low[k] = columns_of_j::<LINE, LINES>(records, pairs, 4 * k, 0);
                high[k] = columns_of_j::<LINE, LINES>(records, pairs, 4 * k, 4);
            }
            joined(low, high)
        }
    }

    #[inline(always)]
    fn last_two_of_j<const LINE: usize, const LINES: usize>(
        _: Avx2Token,
        records: &[[CacheLine; LINES]],
        list: &PairList,
        block: usize,
    ) -> [Self; 2] {
        let pairs = list.within(block, records.len());
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
    fn add_forces_2d(terms: [Self; 4], sums: &mut [Force2], list: &PairList, block: usize) {
        let pairs = list.within(block, sums.len());
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
    fn add_forces_3d(terms: [[Self; 3]; 3], sums: &mut [Force3], list: &PairList, block: usize) {
        let pairs = list.within(block, sums.len());
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

/// Eight quantities of sixteen pairs: `low` has the first four, `high` the last four, of four pairs
/// each.
#[inline(always)]
fn joined(low: [[__m256d; 4]; 4], high: [[__m256d; 4]; 4]) -> [Avx2; 8] {
    [
        Avx2(each(|k| low[k][0])),
        Avx2(each(|k| low[k][1])),
        Avx2(each(|k| low[k][2])),
        Avx2(each(|k| low[k][3])),
        Avx2(each(|k| high[k][0])),
        Avx2(each(|k| high[k][1])),
        Avx2(each(|k| high[k][2])),
        Avx2(each(|k| high[k][3])),
    ]
}

/// The bits of x plus half an eighth of its power of two: rounds the mantissa to eighths.
///
/// # Safety
/// The processor has AVX2.
#[inline(always)]
unsafe fn rounded(x: __m256d) -> __m256i {
    // SAFETY: register operations only, with the feature that the caller guarantees.
    unsafe { _mm256_add_epi64(_mm256_castpd_si256(x), _mm256_set1_epi64x(1 << 48)) }
}

/// x over its power of two, after rounding to eighths: in [31/32, 31/16).
///
/// # Safety
/// The processor has AVX2.
#[inline(always)]
unsafe fn mantissa_about_one(x: __m256d) -> __m256d {
    // SAFETY: register operations only, with the feature that the caller guarantees.
    unsafe {
        let power = _mm256_and_si256(rounded(x), _mm256_set1_epi64x(0xfff << 52));
        let raised = _mm256_add_epi64(_mm256_castpd_si256(x), _mm256_set1_epi64x(1023 << 52));
        _mm256_castsi256_pd(_mm256_sub_epi64(raised, power))
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

/// Transposed differences of four pairs, from `lane` on: four fields, from the field `from` on.
///
/// # Safety
/// The processor has AVX, and the indices are below `records.len()`.
#[inline(always)]
unsafe fn columns<const LINE: usize, const LINES: usize>(
    records: &[[CacheLine; LINES]],
    pairs: &Pairs,
    lane: usize,
    from: usize,
) -> [__m256d; 4] {
    // SAFETY: as the caller guarantees; every cache line holds eight f64 and is aligned, four of
    // which are read from `from` on.
    unsafe {
        let mut rows = [_mm256_setzero_pd(); 4];
        for (k, row) in rows.iter_mut().enumerate() {
            let (a, b) = (
                &records.get_unchecked(pairs.i[lane + k] as usize)[LINE],
                &records.get_unchecked(pairs.j[lane + k] as usize)[LINE],
            );
            *row = _mm256_sub_pd(
                _mm256_load_pd(a.0.as_ptr().add(from)),
                _mm256_load_pd(b.0.as_ptr().add(from)),
            );
        }
        transpose(rows)
    }
}

/// Transposed cache lines of four records `pairs.j`, from `lane` on: four fields, from the field
/// `from` on.
///
/// # Safety
/// The processor has AVX, and the indices are below `records.len()`.
#[inline(always)]
unsafe fn columns_of_j<const LINE: usize, const LINES: usize>(
    records: &[[CacheLine; LINES]],
    pairs: &Pairs,
    lane: usize,
    from: usize,
) -> [__m256d; 4] {
    // SAFETY: as the caller guarantees; every cache line holds eight f64 and is aligned, four of
    // which are read from `from` on.
    unsafe {
        let mut rows = [_mm256_setzero_pd(); 4];
        for (k, row) in rows.iter_mut().enumerate() {
            let record = records.get_unchecked(pairs.j[lane + k] as usize);
            *row = _mm256_load_pd(record[LINE].0.as_ptr().add(from));
        }
        transpose(rows)
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
        let shifted = _mm256_or_si256(
            _mm256_srli_epi64::<52>(bits),
            _mm256_set1_epi64x(0x4330_0000_0000_0000),
        );
        _mm256_sub_pd(
            _mm256_castsi256_pd(shifted),
            _mm256_set1_pd(4503599627370496.0 + 1023.0),
        )
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
