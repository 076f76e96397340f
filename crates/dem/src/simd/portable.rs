//! Plain arrays, for any processor.
//!
//! On x86-64 they run only where AVX2 is missing, so the operations stay out of line there: inlined
//! into every law they would be a third of the program and of the time to build it. Elsewhere they
//! are the kernel, and inlined.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::{
    CacheLine, Force2, INVERSE_MAGIC, INVERSE_SQRT_MAGIC, LANES, Lanes, Lanes16, Mask, PairBlock,
    TO_INTEGER,
};

/// The token of the portable lanes; every processor has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PortableToken;

/// Sixteen f64 in an array.
#[derive(Debug, Clone, Copy)]
pub struct Portable([f64; LANES]);

// Out of line they take references: arguments by value would be copied for every call.
impl Portable {
    #[cfg_attr(target_arch = "x86_64", inline(never))]
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn map(&self, f: impl Fn(f64) -> f64) -> Self {
        Portable(self.0.map(f))
    }

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn zip(&self, other: &Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Portable(std::array::from_fn(|k| f(self.0[k], other.0[k])))
    }

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn times_plus(&self, factor: &Self, term: &Self) -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("fma") {
            // SAFETY: the processor has FMA.
            return unsafe { times_plus_with_fma(self, factor, term) };
        }
        times_plus(self, factor, term)
    }

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn is_greater(&self, other: &Self) -> u16 {
        (0..LANES).fold(0, |m, k| m | (u16::from(self.0[k] > other.0[k]) << k))
    }

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn where_set(&self, mask: u16, other: &Self) -> Self {
        Portable(std::array::from_fn(|k| {
            if mask >> k & 1 == 1 {
                self.0[k]
            } else {
                other.0[k]
            }
        }))
    }
}

#[inline(always)]
fn times_plus(x: &Portable, factor: &Portable, term: &Portable) -> Portable {
    Portable(std::array::from_fn(|k| {
        x.0[k].mul_add(factor.0[k], term.0[k])
    }))
}

/// [`times_plus`] with the instruction: without it, the C library's function takes half of the time
/// of portable code.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "fma")]
fn times_plus_with_fma(x: &Portable, factor: &Portable, term: &Portable) -> Portable {
    // A loop: what `array::from_fn` does not inline is not compiled for the instruction.
    let mut sums = term.0;
    for ((sum, x), factor) in sums.iter_mut().zip(&x.0).zip(&factor.0) {
        *sum = x.mul_add(*factor, *sum);
    }
    Portable(sums)
}

macro_rules! operator {
    ($trait:ident, $method:ident) => {
        impl $trait for Portable {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.zip(&other, f64::$method)
            }
        }
    };
}
operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);
operator!(Div, div);

macro_rules! unary {
    ($method:ident, $of_lane:expr) => {
        #[inline(always)]
        fn $method(self) -> Self {
            self.map($of_lane)
        }
    };
}

impl Neg for Portable {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|x| -x)
    }
}

impl Mask for u16 {
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        self & other
    }

    #[inline(always)]
    fn bits(self) -> u16 {
        self
    }
}

impl Lanes for Portable {
    type Token = PortableToken;
    type Mask = u16;
    type Index = [u8; LANES];
    type Counts = [i64; LANES];

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn splat(_: PortableToken, x: f64) -> Self {
        Portable([x; LANES])
    }

    #[inline(always)]
    fn mask(_: PortableToken, bits: u16) -> u16 {
        bits
    }

    #[inline(always)]
    fn load(_: PortableToken, from: &Lanes16) -> Self {
        Portable(from.0)
    }

    #[inline(always)]
    fn store(self, to: &mut Lanes16) {
        to.0 = self.0;
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        self.times_plus(&factor, &term)
    }

    unary!(sqrt, f64::sqrt);
    unary!(abs, f64::abs);
    unary!(round, f64::round_ties_even);
    unary!(inverse_start, |x: f64| {
        f64::from_bits(INVERSE_MAGIC.wrapping_sub(x.to_bits()))
    });
    unary!(inverse_sqrt_start, |x: f64| {
        f64::from_bits(INVERSE_SQRT_MAGIC.wrapping_sub(x.to_bits() >> 1))
    });

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(&other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn copy_sign(self, sign: Self) -> Self {
        self.zip(&sign, f64::copysign)
    }

    #[inline(always)]
    fn greater(self, other: Self) -> u16 {
        self.is_greater(&other)
    }

    #[inline(always)]
    fn select(self, mask: u16, other: Self) -> Self {
        self.where_set(mask, &other)
    }

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn exponent_mantissa(self) -> (Self, Self) {
        let exponent = self.map(|x| ((x.to_bits() >> 52) as i64 - 1023) as f64);
        let mantissa = self
            .map(|x| f64::from_bits(x.to_bits() & 0x000f_ffff_ffff_ffff | 0x3ff0_0000_0000_0000));
        (exponent, mantissa)
    }

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn exponent_eighth(self) -> (Self, Self, [u8; LANES]) {
        let rounded = self.0.map(|x| x.to_bits().wrapping_add(1 << 48));
        let exponent = rounded.map(|b| ((b >> 52) as i64 - 1023) as f64);
        let mantissa = std::array::from_fn(|k| {
            let bits = self.0[k].to_bits().wrapping_add(1023 << 52);
            f64::from_bits(bits.wrapping_sub(rounded[k] & (0xfff << 52)))
        });
        let eighth = rounded.map(|b| (b >> 49 & 7) as u8);
        (Portable(exponent), Portable(mantissa), eighth)
    }

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn look_up(_: PortableToken, table: &[f64; 8], k: [u8; LANES]) -> Self {
        Portable(k.map(|k| table[k as usize % 8]))
    }

    #[inline(always)]
    fn no_counts(_: PortableToken) -> [i64; LANES] {
        [0; LANES]
    }

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn count(self, sums: [i64; LANES]) -> [i64; LANES] {
        std::array::from_fn(|k| {
            let integer = (self.0[k] + TO_INTEGER)
                .to_bits()
                .wrapping_sub(TO_INTEGER.to_bits());
            sums[k].wrapping_add(integer as i64)
        })
    }

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn total(sums: [i64; LANES]) -> i128 {
        sums.iter().copied().map(i128::from).sum()
    }

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn differences<const LINE: usize, const LINES: usize>(
        _: PortableToken,
        records: &[[CacheLine; LINES]],
        pairs: PairBlock<'_>,
        out: &mut [Lanes16; 8],
        mut of_j: Option<&mut [Lanes16; 8]>,
    ) {
        let pairs = pairs.within(records.len());
        for lane in 0..LANES {
            let a = &records[pairs.i[lane] as usize][LINE];
            let b = &records[pairs.j[lane] as usize][LINE];
            for field in 0..8 {
                let is_last = LINE == 1 && field == 7;
                out[field].0[lane] = a.0[field] - if is_last { 0.0 } else { b.0[field] };
                if let Some(of_j) = &mut of_j {
                    of_j[field].0[lane] = b.0[field];
                }
            }
        }
    }

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn last_two_of_j<const LINE: usize, const LINES: usize>(
        _: PortableToken,
        records: &[[CacheLine; LINES]],
        pairs: PairBlock<'_>,
    ) -> [Self; 2] {
        let pairs = pairs.within(records.len());
        [6, 7].map(|field| Portable(pairs.j.map(|j| records[j as usize][LINE].0[field])))
    }

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn add_forces_2d(terms: [Self; 4], sums: &mut [Force2], pairs: PairBlock<'_>) {
        let pairs = pairs.within(sums.len());
        let [a, b, c, d] = terms;
        for lane in 0..LANES {
            let on_i = &mut sums[pairs.i[lane] as usize].0;
            on_i[0] += a.0[lane];
            on_i[1] += b.0[lane];
            on_i[2] += c.0[lane];
            let on_j = &mut sums[pairs.j[lane] as usize].0;
            on_j[0] -= a.0[lane];
            on_j[1] -= b.0[lane];
            on_j[2] += d.0[lane];
        }
    }

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn add_forces_3d(terms: [[Self; 3]; 3], sums: &mut [CacheLine], pairs: PairBlock<'_>) {
        let pairs = pairs.within(sums.len());
        let [a, b, c] = terms;
        for lane in 0..LANES {
            for k in 0..3 {
                let on_i = &mut sums[pairs.i[lane] as usize].0;
                on_i[k] += a[k].0[lane];
                on_i[3 + k] += b[k].0[lane];
                let on_j = &mut sums[pairs.j[lane] as usize].0;
                on_j[k] -= a[k].0[lane];
                on_j[3 + k] += c[k].0[lane];
            }
        }
    }
}
