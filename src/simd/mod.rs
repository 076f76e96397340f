//! Eight f64 at a time, with the same bits on every processor.
//!
//! Every operation is exactly one IEEE operation per lane (fused multiply-add included), so AVX-512, AVX2 with FMA
//! and the portable arrays agree to the last bit. The instruction set is chosen once, at run time.
//!
//! Soundness: a value of [`Avx512`] or [`Avx2`] can only be made from its token, and a token only by asking the processor.

mod avx2;
mod avx512;
mod math;
mod portable;

use bytemuck::{Pod, Zeroable};
use std::ops::{Add, Div, Mul, Neg, Sub};

pub use avx2::{Avx2, Avx2Token};
pub use avx512::{Avx512, Avx512Token};
pub use math::ln;
pub use portable::{Portable, PortableToken};

/// Number of lanes.
pub const LANES: usize = 8;

/// Eight f64 on one cache line: a grain as the kernel reads it, or one quantity of eight contacts.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Row(pub [f64; LANES]);

impl Row {
    pub const ZERO: Self = Row([0.0; LANES]);
}

/// Eight f64.
pub trait Lanes:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// Proof that the processor can do this.
    type Token: Copy;
    type Mask: Mask;

    fn splat(token: Self::Token, x: f64) -> Self;
    fn load(token: Self::Token, from: &Row) -> Self;
    fn store(self, to: &mut Row);
    /// `self * factor + term`, rounded once.
    fn mul_add(self, factor: Self, term: Self) -> Self;
    fn sqrt(self) -> Self;
    fn abs(self) -> Self;
    /// To the nearest integer, ties to even.
    fn round(self) -> Self;
    /// `self` where it is greater, else `other` (so `other` where `self` is NaN).
    fn max(self, other: Self) -> Self;
    /// Magnitude of `self`, sign of `sign`.
    fn copy_sign(self, sign: Self) -> Self;
    /// False where either is NaN.
    fn greater(self, other: Self) -> Self::Mask;
    /// Lane-wise `mask ? self : other`.
    fn select(self, mask: Self::Mask, other: Self) -> Self;
    /// Exponent e and mantissa m in [1, 2) of normal positive numbers: x = m 2^e.
    fn exponent_mantissa(self) -> (Self, Self);
    /// `records[i] - records[j]` of eight pairs, transposed: the k-th result holds field k of the eight differences.
    ///
    /// # Panics
    /// Where an index is outside `records`.
    fn differences(
        token: Self::Token,
        records: &[Row],
        i: &[u32; LANES],
        j: &[u32; LANES],
    ) -> [Self; LANES];
    /// Field `field` of eight records.
    ///
    /// # Panics
    /// Where an index is outside `records`.
    #[inline(always)]
    fn gather(token: Self::Token, records: &[Row], index: &[u32; LANES], field: usize) -> Self {
        let mut out = Row::ZERO;
        for (o, &k) in out.0.iter_mut().zip(index) {
            *o = records[k as usize].0[field];
        }
        Self::load(token, &out)
    }
}

/// Eight truth values.
pub trait Mask: Copy {
    fn and(self, other: Self) -> Self;
    /// Lane k in bit k.
    fn bits(self) -> u8;
}

/// Something to do eight lanes at a time, on whichever instruction set there is.
pub trait Work {
    type Output;
    /// To be `#[inline(always)]`, with all that it calls: what is not inlined is not compiled for the instruction set.
    fn run<L: Lanes>(self, token: L::Token) -> Self::Output;
}

/// The instruction sets that the kernel is built for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    Avx512(Avx512Token),
    Avx2(Avx2Token),
    Portable,
}

impl Level {
    /// The widest that this processor has.
    pub fn detect() -> Self {
        if let Some(token) = Avx512Token::detect() {
            Level::Avx512(token)
        } else if let Some(token) = Avx2Token::detect() {
            Level::Avx2(token)
        } else {
            Level::Portable
        }
    }

    /// `auto`, or one by name; `None` where the name is unknown or this processor lacks it.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "auto" => Some(Self::detect()),
            "avx512" => Avx512Token::detect().map(Level::Avx512),
            "avx2" => Avx2Token::detect().map(Level::Avx2),
            "portable" => Some(Level::Portable),
            _ => None,
        }
    }

    /// Does the work with this instruction set.
    pub fn run<W: Work>(self, work: W) -> W::Output {
        match self {
            Level::Avx512(token) => avx512::run(token, work),
            Level::Avx2(token) => avx2::run(token, work),
            Level::Portable => work.run::<Portable>(PortableToken),
        }
    }

    pub fn name(self) -> &'static str {
        match self {
            Level::Avx512(_) => "avx512",
            Level::Avx2(_) => "avx2",
            Level::Portable => "portable",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All that the kernel uses, once, on awkward numbers.
    struct Exercise;

    impl Work for Exercise {
        type Output = Vec<u64>;

        #[inline(always)]
        fn run<L: Lanes>(self, token: L::Token) -> Vec<u64> {
            exercise::<L>(token)
        }
    }

    #[inline(always)]
    fn exercise<L: Lanes>(token: L::Token) -> Vec<u64> {
        let a = Row([1.5, -2.25, 3.0e-7, 1e300, -0.0, 7.5, 0.1, -1e-200]);
        let b = Row([0.5, 2.5, -3.5, 1e-300, 4.0, -7.5, 0.3, 2.0]);
        let (x, y) = (L::load(token, &a), L::load(token, &b));
        let positive = Row([1.0, 1.9999999, 2.5e-12, 1e300, 3e-308, 0.7, 42.0, 1e-5]);
        let (e, m) = L::load(token, &positive).exponent_mantissa();
        let records: Vec<Row> = (0..20)
            .map(|k| Row(std::array::from_fn(|f| (k * k) as f64 + 0.1 * f as f64)))
            .collect();
        let (i, j) = ([0, 3, 5, 7, 11, 13, 17, 19], [2, 4, 6, 8, 10, 12, 14, 16]);
        let mut out = vec![
            x + y,
            x - y,
            x * y,
            x / y,
            -x,
            x.mul_add(y, x),
            y.abs().sqrt(),
            y.round(),
            x.max(y),
            x.copy_sign(y),
            x.select(x.greater(y), y),
            e,
            m,
            ln::<L>(token, L::load(token, &positive)),
            L::gather(token, &records, &i, 5),
        ];
        out.extend(L::differences(token, &records, &i, &j));
        let mut bits = Vec::new();
        for lanes in out {
            let mut row = Row::ZERO;
            lanes.store(&mut row);
            bits.extend(row.0.map(f64::to_bits));
        }
        bits.push(x.greater(y).and(x.greater(L::splat(token, 0.0))).bits() as u64);
        bits
    }

    #[test]
    fn every_level_gives_the_same_bits() {
        let expected = Level::Portable.run(Exercise);
        for level in ["avx2", "avx512"].into_iter().filter_map(Level::named) {
            assert_eq!(level.run(Exercise), expected, "{}", level.name());
        }
    }

    #[test]
    fn rounds_ties_to_even() {
        let x = Row([0.5, 1.5, 2.5, -0.5, -1.5, 0.49999999999999994, -0.6, 3.2]);
        let mut out = Row::ZERO;
        Portable::load(PortableToken, &x).round().store(&mut out);
        assert_eq!(out.0, [0.0, 2.0, 2.0, 0.0, -2.0, 0.0, -1.0, 3.0]);
    }
}
