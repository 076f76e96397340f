//! Sixteen f64 at a time, with the same bits on every processor.
//!
//! Every operation is exactly one IEEE operation per lane (fused multiply-add included), so
//! AVX-512, AVX2 with FMA and the portable arrays agree to the last bit. The instruction set
//! ([`Isa`]) is chosen once, at run time.
//!
//! Soundness: registers of AVX-512 or AVX2 can only be filled with a token ([`Avx512Token`],
//! [`Avx2Token`]), and a token can only be made if the processor has the instruction set.

#![allow(
    unsafe_code,
    reason = "intrinsics of the instruction sets and prefetching"
)]

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod math;
#[cfg(not(target_arch = "x86_64"))]
mod no_avx;
mod portable;
#[cfg(target_arch = "x86_64")]
mod vector;

use bytemuck::{Pod, Zeroable};
use std::ops::{Add, Deref, DerefMut, Div, Mul, Neg, Sub};

#[cfg(target_arch = "x86_64")]
pub use avx2::{Avx2, Avx2Token};
#[cfg(target_arch = "x86_64")]
pub use avx512::{Avx512, Avx512Token};
pub use math::{cube_root, inverse, inverse_sqrt, ln};
#[cfg(not(target_arch = "x86_64"))]
use no_avx::{self as avx2, self as avx512};
#[cfg(not(target_arch = "x86_64"))]
pub use no_avx::{Token as Avx2Token, Token as Avx512Token};
pub use portable::{Portable, PortableToken};

/// Number of lanes.
pub const LANES: usize = 16;

/// One quantity of sixteen contacts, in memory.
#[derive(Debug, Default, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Lanes16(pub [f64; LANES]);

/// Eight f64 on one cache line. The record of a grain, which the kernel reads, takes one or two.
/// One holds force and torque on a sphere, and padding.
#[derive(Debug, Default, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct CacheLine(pub [f64; 8]);

impl Lanes16 {
    /// Zeros.
    pub const ZERO: Self = Lanes16([0.0; LANES]);
}

/// Force and torque on a disk, and padding: half a cache line.
#[derive(Debug, Default, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C, align(32))]
pub struct Force2(pub [f64; 4]);

macro_rules! dereferences_to_slice {
    ($($name:ident)*) => {$(
        impl Deref for $name {
            type Target = [f64];
            fn deref(&self) -> &[f64] {
                &self.0
            }
        }

        impl DerefMut for $name {
            fn deref_mut(&mut self) -> &mut [f64] {
                &mut self.0
            }
        }
    )*};
}
dereferences_to_slice!(CacheLine Force2);

/// Sixteen pairs of indices.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
#[repr(C, align(64))]
pub struct Pairs {
    /// The first of each pair.
    pub i: [u32; LANES],
    /// The second of each pair.
    pub j: [u32; LANES],
}

impl Pairs {
    /// The lanes of two different indices: the others fill up a block.
    pub fn of_two(&self) -> u16 {
        let lanes = (0..LANES).filter(|&lane| self.i[lane] != self.j[lane]);
        lanes.fold(0, |mask, lane| mask | 1 << lane)
    }
}

/// Clears a vector, and makes room for so many elements and few more: growing by itself it would
/// double.
pub(crate) fn clear_for<T>(vector: &mut Vec<T>, count: usize) {
    vector.clear();
    let more = count + count / 16;
    if vector.capacity() < count || vector.capacity() / 2 > more {
        *vector = Vec::with_capacity(more);
    }
}

/// Pairs of indices in blocks of sixteen, with an upper bound of the indices of each block. One
/// check of the bound allows unchecked access with all indices of the block.
#[derive(Debug, Default)]
pub struct PairList {
    blocks: Vec<Pairs>,
    below: Vec<u32>,
}

impl PairList {
    /// Appends a block.
    ///
    /// # Panics
    /// If an index is `u32::MAX`.
    pub fn push(&mut self, pairs: Pairs) {
        let most = pairs.i.iter().chain(&pairs.j).fold(0, |a, &b| a.max(b));
        assert!(most < u32::MAX, "an index has to be below {}", u32::MAX);
        self.below.push(most + 1);
        self.blocks.push(pairs);
    }

    /// Removes all blocks, and makes room for so many.
    pub(crate) fn clear_for(&mut self, blocks: usize) {
        clear_for(&mut self.blocks, blocks);
        clear_for(&mut self.below, blocks);
    }

    /// Appends the blocks of another list, which are gone from there then.
    pub fn append(&mut self, other: &mut Self) {
        self.blocks.append(&mut other.blocks);
        self.below.append(&mut other.below);
    }

    /// The blocks.
    pub fn blocks(&self) -> &[Pairs] {
        &self.blocks
    }

    /// Heap in use (bytes).
    pub fn memory(&self) -> usize {
        self.blocks.capacity() * size_of::<Pairs>() + self.below.capacity() * size_of::<u32>()
    }

    /// A block.
    #[inline(always)]
    pub fn block(&self, block: usize) -> PairBlock<'_> {
        PairBlock { list: self, block }
    }
}

/// A block of a list of pairs.
#[derive(Debug, Clone, Copy)]
pub struct PairBlock<'a> {
    list: &'a PairList,
    block: usize,
}

impl<'a> PairBlock<'a> {
    /// The pairs; checks that all their indices are below `length`.
    ///
    /// # Panics
    /// If one is not.
    #[inline(always)]
    fn within(self, length: usize) -> &'a Pairs {
        assert!(
            self.list.below[self.block] as usize <= length,
            "a pair of the list has an index outside the grains"
        );
        &self.list.blocks[self.block]
    }
}

/// Sixteen f64 in registers.
pub trait Lanes:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// Proof that the processor has the instruction set.
    type Token: Copy;
    /// One truth value per lane.
    type Mask: Mask;
    /// Sixteen integers from 0 to 7.
    type Index: Copy;
    /// Sixteen sums of integers.
    type Counts: Copy;

    /// The same number in every lane.
    fn splat(token: Self::Token, x: f64) -> Self;
    /// The mask with lane k in bit k, the reverse of [`Mask::bits`].
    fn mask(token: Self::Token, bits: u16) -> Self::Mask;
    /// Reads the lanes from memory.
    fn load(token: Self::Token, from: &Lanes16) -> Self;
    /// Writes the lanes to memory.
    fn store(self, to: &mut Lanes16);
    /// The lanes in memory.
    #[inline(always)]
    fn to_lanes16(self) -> Lanes16 {
        let mut lanes = Lanes16::ZERO;
        self.store(&mut lanes);
        lanes
    }
    /// `self * factor + term`, rounded once.
    fn mul_add(self, factor: Self, term: Self) -> Self;
    /// √x.
    fn sqrt(self) -> Self;
    /// |x|.
    fn abs(self) -> Self;
    /// To the nearest integer, ties to even.
    fn round(self) -> Self;
    /// `self` in lanes in which it is greater, else `other`; `other` if `self` is NaN.
    fn max(self, other: Self) -> Self;
    /// Magnitude of `self`, sign of `sign`.
    fn copy_sign(self, sign: Self) -> Self;
    /// Whether `self` is greater; false if either is NaN.
    fn greater(self, other: Self) -> Self::Mask;
    /// Lane-wise `mask ? self : other`.
    fn select(self, mask: Self::Mask, other: Self) -> Self;
    /// Exponent e and mantissa m in [1, 2) of normal positive numbers: x = m 2^e.
    fn exponent_mantissa(self) -> (Self, Self);
    /// Normal positive numbers as x = m 2^e with m in [31/32, 31/16): e, m, and the k for which m
    /// is nearest to 1 + k/8.
    fn exponent_eighth(self) -> (Self, Self, Self::Index);
    /// `table[k]`.
    fn look_up(token: Self::Token, table: &[f64; 8], k: Self::Index) -> Self;
    /// Sums that are zero.
    fn no_counts(token: Self::Token) -> Self::Counts;
    /// Adds `self`, rounded to the nearest integer; |self| < 2^51.
    fn count(self, sums: Self::Counts) -> Self::Counts;
    /// The sum of all lanes.
    fn total(sums: Self::Counts) -> i128;
    /// A first approximation y of 1/x from the bits of normal positive numbers: |1 - x y| < 0.0506.
    fn inverse_start(self) -> Self;
    /// A first approximation y of x^(-1/2) from the bits of normal positive numbers:
    /// |1 - x y²| < 0.0682.
    fn inverse_sqrt_start(self) -> Self;
    /// Transposes `records[i] - records[j]` of a block of pairs, one cache line of each: `out[k]`
    /// gets field k of the sixteen differences, `of_j[k]` that of the sixteen records j. Of a
    /// second line the last field is that of the sixteen records i.
    ///
    /// # Panics
    /// If an index of the list is outside `records`.
    fn differences<const LINE: usize, const LINES: usize>(
        token: Self::Token,
        records: &[[CacheLine; LINES]],
        pairs: PairBlock<'_>,
        out: &mut [Lanes16; 8],
        of_j: Option<&mut [Lanes16; 8]>,
    );
    /// The last two fields of one cache line of the records j.
    ///
    /// # Panics
    /// If an index of the list is outside `records`.
    fn last_two_of_j<const LINE: usize, const LINES: usize>(
        token: Self::Token,
        records: &[[CacheLine; LINES]],
        pairs: PairBlock<'_>,
    ) -> [Self; 2];
    /// Adds (a, b, c, 0) to `sums[i]` and (-a, -b, d, 0) to `sums[j]` of a block of pairs, pair by
    /// pair; `terms` are a, b, c, d.
    ///
    /// # Panics
    /// If an index of the list is outside `sums`.
    fn add_forces_2d(terms: [Self; 4], sums: &mut [Force2], pairs: PairBlock<'_>);
    /// Adds (a, b, 0, 0) to `sums[i]` and (-a, c, 0, 0) to `sums[j]`; `terms` are the vectors a, b,
    /// c.
    ///
    /// # Panics
    /// If an index of the list is outside `sums`.
    fn add_forces_3d(terms: [[Self; 3]; 3], sums: &mut [CacheLine], pairs: PairBlock<'_>);
}

/// Prefetches a cache line into all caches: lines of a chunk that were in the second-level cache
/// alone would cost a quarter of the speed of a large packing. Does nothing on processors other
/// than x86-64.
#[inline(always)]
fn prefetch_line(line: *const i8) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: a prefetch neither faults nor changes what the program reads.
    unsafe {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(line);
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = line;
}

/// Prefetches the elements of `of` at the second indices of a block of pairs.
#[inline(always)]
pub fn prefetch<T>(elements: &[T], pairs: PairBlock<'_>) {
    for &j in &pairs.within(elements.len()).j {
        let first = elements.as_ptr().wrapping_add(j as usize).cast::<i8>();
        for line in 0..size_of::<T>().div_ceil(64) {
            prefetch_line(first.wrapping_add(64 * line));
        }
    }
}

/// [`prefetch`] of a whole slice.
#[inline(always)]
pub(crate) fn prefetch_all<T>(elements: &[T]) {
    for line in (0..size_of_val(elements)).step_by(64) {
        prefetch_line(elements.as_ptr().cast::<i8>().wrapping_add(line));
    }
}

/// 3·2^51: added to a number below 2^51, it rounds to an integer and leaves that in the last bits.
const TO_INTEGER: f64 = (3u64 << 51) as f64;

/// Constants of [`Lanes::inverse_start`] and [`Lanes::inverse_sqrt_start`], chosen so that the
/// greatest errors of both signs are equal.
const INVERSE_MAGIC: u64 = 0x7fde_6238_5024_84ba;
const INVERSE_SQRT_MAGIC: u64 = 0x5fe6_e8ea_de98_a944;

/// Sixteen truth values.
pub trait Mask: Copy {
    /// Lanes that are true in both.
    fn and(self, other: Self) -> Self;
    /// Lane k in bit k.
    fn bits(self) -> u16;
}

/// A computation on sixteen lanes at a time that is compiled for every instruction set.
pub trait Work {
    /// The result.
    type Output;
    /// Does the computation. Must be `#[inline(always)]`, with all that it calls: code that is not
    /// inlined is not compiled for the instruction set.
    fn run<L: Lanes>(self, token: L::Token) -> Self::Output;
}

/// The instruction sets that the kernel is built for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Isa {
    /// AVX-512.
    Avx512(Avx512Token),
    /// AVX2 with FMA.
    Avx2(Avx2Token),
    /// Arrays of f64, on any processor.
    Portable,
}

impl Isa {
    /// The widest instruction set of this processor.
    pub fn detect() -> Self {
        if let Some(token) = Avx512Token::detect() {
            Isa::Avx512(token)
        } else if let Some(token) = Avx2Token::detect() {
            Isa::Avx2(token)
        } else {
            Isa::Portable
        }
    }

    /// `auto`, or an instruction set by its name; `None` if the name is unknown or this processor
    /// lacks it.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "auto" => Some(Self::detect()),
            "avx512" => Avx512Token::detect().map(Isa::Avx512),
            "avx2" => Avx2Token::detect().map(Isa::Avx2),
            "portable" => Some(Isa::Portable),
            _ => None,
        }
    }

    /// Does the work with this instruction set.
    pub fn run<W: Work>(self, work: W) -> W::Output {
        let portable = |work: W| work.run::<Portable>(PortableToken);
        self.run_with_vectors(work).unwrap_or_else(portable)
    }

    /// Does the work with vector instructions.
    ///
    /// # Errors
    /// The work, if this instruction set has none.
    pub(crate) fn run_with_vectors<W: Work>(self, work: W) -> Result<W::Output, W> {
        match self {
            Isa::Avx512(token) => Ok(avx512::run(token, work)),
            Isa::Avx2(token) => Ok(avx2::run(token, work)),
            Isa::Portable => Err(work),
        }
    }

    /// The name that [`Isa::named`] takes.
    pub fn name(self) -> &'static str {
        match self {
            Isa::Avx512(_) => "avx512",
            Isa::Avx2(_) => "avx2",
            Isa::Portable => "portable",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every operation that the kernel uses, once, on extreme numbers.
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
        let twice = |x: [f64; 8]| Lanes16(std::array::from_fn(|k| x[k % 8] * [1.0, 1.1][k / 8]));
        let a = twice([1.5, -2.25, 3.0e-7, 1e300, -0.0, 7.5, 0.1, -1e-200]);
        let b = twice([0.5, 2.5, -3.5, 1e-300, 4.0, -7.5, 0.3, 2.0]);
        let (x, y) = (L::load(token, &a), L::load(token, &b));
        let positive = twice([1.0, 1.9999999, 2.5e-12, 1e300, 3e-308, 0.7, 42.0, 1e-5]);
        let (e, m) = L::load(token, &positive).exponent_mantissa();
        let line = |k: usize| CacheLine(std::array::from_fn(|f| (k * k) as f64 + 0.1 * f as f64));
        let records: Vec<[CacheLine; 2]> = (0..20).map(|k| [line(k), line(2 * k + 1)]).collect();
        // Some indices occur more than once, as first and as second of a pair.
        let mut list = PairList::default();
        list.push(Pairs {
            i: [0, 0, 5, 7, 11, 13, 17, 19, 0, 1, 1, 1, 3, 4, 7, 18],
            j: [2, 5, 6, 8, 12, 17, 19, 16, 1, 3, 4, 5, 4, 17, 9, 19],
        });
        let (e8, m8, k) = L::load(token, &positive).exponent_eighth();
        let table = std::array::from_fn(|k| (k * k) as f64);
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
            x.select(L::mask(token, 0b1010_0011_0101_1100), y),
            e,
            m,
            ln::<L>(token, L::load(token, &positive)),
            e8,
            m8,
            L::look_up(token, &table, k),
            L::load(token, &positive).inverse_start(),
            L::load(token, &positive).inverse_sqrt_start(),
            inverse::<L>(token, L::load(token, &positive)),
            inverse_sqrt::<L>(token, L::load(token, &positive)),
        ];
        let mut rows = [Lanes16::ZERO; 8];
        let pairs = list.block(0);
        L::differences::<0, 2>(token, &records, pairs, &mut rows, None);
        out.extend(rows.iter().map(|row| L::load(token, row)));
        let mut of_j = rows;
        L::differences::<1, 2>(token, &records, pairs, &mut rows, Some(&mut of_j));
        out.extend(rows.iter().chain(&of_j).map(|row| L::load(token, row)));
        out.extend(L::last_two_of_j::<1, 2>(token, &records, pairs));
        let mut bits = Vec::new();
        for lanes in out {
            bits.extend(lanes.to_lanes16().0.map(f64::to_bits));
        }
        let mut sums: Vec<Force2> = (0..20).map(|k| Force2([0.1 * f64::from(k); 4])).collect();
        L::add_forces_2d([x, y, x + y, x - y], &mut sums, pairs);
        bits.extend(sums.iter().flat_map(|q| q.0.map(f64::to_bits)));
        let mut sums: Vec<CacheLine> = (0..20)
            .map(|k| CacheLine([0.1 * f64::from(k); 8]))
            .collect();
        let terms = [[x, y, x + y], [x - y, x * y, -x], [y, -y, y - x]];
        L::add_forces_3d(terms, &mut sums, pairs);
        bits.extend(sums.iter().flat_map(|q| q.0.map(f64::to_bits)));
        let small = L::splat(token, 2.5)
            .max(x)
            .select(L::splat(token, 1e15).greater(x), y);
        let sums = small.count((-small).mul_add(y, x).count(L::no_counts(token)));
        bits.push(L::total(small.count(sums)) as u64);
        let both = x.greater(y).and(x.greater(L::splat(token, 0.0)));
        bits.push(u64::from(both.bits()));
        bits
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let expected = Isa::Portable.run(Exercise);
        for isa in ["avx2", "avx512"].into_iter().filter_map(Isa::named) {
            assert_eq!(isa.run(Exercise), expected, "{}", isa.name());
        }
    }
}
