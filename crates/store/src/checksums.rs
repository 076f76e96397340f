//! Checksums of the numbers in `run.h5`, so that damage in its data is noticed when it is read.
//!
//! A checksum is Σ w(k) b_k modulo 2^64 over the mixed bits b_k of the numbers, where w(k) is an
//! odd number made from the place k of the number. It depends neither on the order of the sum nor
//! on the ranks that hold the numbers, and a change of one number always changes it.

use std::ops::Range;

use super::parameter::{Parameter, Parameters};
use gshear_dem::simd::{Isa, Lanes, Work};
use xxhash_rust::xxh3::xxh3_64;

/// Group of the checksums.
pub(crate) const GROUP: &str = "checksums";
/// `[T][columns]`: of step and time, then of each dataset of every frame.
pub const FRAMES: &str = "checksums/frames";
/// `[R]`: of step, time and all columns of every row of the time series.
pub const ROWS: &str = "checksums/rows";
/// `[L']`: of step and all columns of every row of the scalars of frames.
pub(crate) const SCALARS: &str = "checksums/scalars";
/// Attribute of `parameters`: of all other attributes.
pub const OF_PARAMETERS: &str = "checksum";
/// Of what never changes: id, body, radius, mass, edges of the box.
pub(crate) const CONSTANTS: &str = "checksums/constants";

/// The weight of a place (SplitMix64, odd).
#[inline(always)]
pub(crate) fn weight(place: u64) -> u64 {
    let mut z = place.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (z ^ (z >> 31)) | 1
}

/// The bits of a number, mixed so that round numbers, too, differ in their last bits. Numbers with
/// different bits stay different.
#[inline(always)]
fn mixed(bits: u64) -> u64 {
    let bits = (bits ^ (bits >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    bits ^ (bits >> 32)
}

/// Σ w m(x), compiled for the instruction set of the processor: the checksums would otherwise be a
/// tenth of the cost of a frame.
struct WeightedSum<'a>(&'a [u64], &'a [f64]);

impl Work for WeightedSum<'_> {
    type Output = u64;

    #[inline(always)]
    fn run<L: Lanes>(self, _: L::Token) -> u64 {
        let mut sum = 0u64;
        for (weight, x) in self.0.iter().zip(self.1) {
            sum = sum.wrapping_add(weight.wrapping_mul(mixed(x.to_bits())));
        }
        sum
    }
}

/// Replaces places by their weights.
struct Weigh<'a>(&'a mut [u64]);

impl Work for Weigh<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _: L::Token) {
        for place in self.0 {
            *place = weight(*place);
        }
    }
}

fn weights_of(mut places: Vec<u64>) -> Vec<u64> {
    Isa::detect().run(Weigh(&mut places));
    places
}

/// The weights of the places from `first` on.
pub fn weights(first: u64, count: usize) -> Vec<u64> {
    weights_of((first..).take(count).collect())
}

/// Of numbers with these weights.
pub fn of_numbers(weights: &[u64], values: &[f64]) -> u64 {
    Isa::detect().run(WeightedSum(weights, values))
}

/// Of numbers that follow each other from the place `first` on.
pub(crate) fn of_sequence(first: u64, values: &[f64]) -> u64 {
    of_numbers(&weights(first, values.len()), values)
}

/// Of images with these weights.
pub(crate) fn of_images(weights: &[u64], images: &[i32]) -> u64 {
    weighted(weights, images.iter().map(|&image| u64::from(image as u32)))
}

/// Of flags with these weights.
pub(crate) fn of_flags(weights: &[u64], flags: &[u8]) -> u64 {
    weighted(weights, flags.iter().map(|&flag| flag.into()))
}

/// Σ w b.
fn weighted(weights: &[u64], bits: impl Iterator<Item = u64>) -> u64 {
    let terms = weights.iter().zip(bits);
    terms.fold(0, |sum, (weight, bits)| {
        sum.wrapping_add(weight.wrapping_mul(bits))
    })
}

/// What never changes of some grains that follow each other, and of the box.
pub(crate) struct Constants<'a> {
    /// The first of the grains.
    pub first: u64,
    /// Their ids.
    pub id: &'a [u32],
    /// Their bodies.
    pub body: &'a [u8],
    /// Numbers of their materials.
    pub material: &'a [u8],
    /// Their radii (m).
    pub radius: &'a [f64],
    /// Their masses (kg; kg/m in 2D).
    pub mass: &'a [f64],
    /// Edges of the box (m).
    pub edges: &'a [f64],
}

impl Constants<'_> {
    /// Their checksums. Bodies and materials have one together.
    pub fn checksums(&self) -> [u64; 5] {
        let id: Vec<f64> = self.id.iter().map(|&id| id.into()).collect();
        let kinds = self.body.iter().zip(self.material);
        let kinds: Vec<f64> = kinds
            .map(|(&body, &material)| f64::from(body) + 256.0 * f64::from(material))
            .collect();
        [
            of_sequence(self.first, &id),
            of_sequence(self.first, &kinds),
            of_sequence(self.first, self.radius),
            of_sequence(self.first, self.mass),
            of_sequence(0, self.edges),
        ]
    }
}

/// The weights of contacts, wherever their rows are.
pub(crate) struct ContactWeights {
    of_pairs: Vec<u64>,
    /// Of the components of their vectors, if they have any.
    of_vectors: Vec<u64>,
}

impl ContactWeights {
    /// `axes`: number of dimensions; only contacts of spheres have vectors.
    pub fn new(i: &[u32], j: &[u32], axes: usize) -> Self {
        let pairs = i.iter().zip(j);
        let places = pairs.map(|(&i, &j)| u64::from(i) << 32 | u64::from(j));
        let of_pairs = weights_of(places.collect());
        let of_vectors = match axes {
            2 => Vec::new(),
            _ => of_pairs
                .iter()
                .flat_map(|weight| [0, 2, 4].map(|more| weight.wrapping_add(more)))
                .collect(),
        };
        Self {
            of_pairs,
            of_vectors,
        }
    }

    /// Of the pairs of grains alone.
    pub fn pairs(&self, rows: Range<usize>) -> u64 {
        let weights = self.of_pairs[rows].iter().copied();
        weights.fold(0, u64::wrapping_add)
    }

    /// Of a column, 1 or 3 numbers each.
    pub fn numbers(&self, rows: Range<usize>, values: &[f64], width: usize) -> u64 {
        match width {
            1 => of_numbers(&self.of_pairs[rows], values),
            _ => of_numbers(&self.of_vectors[3 * rows.start..3 * rows.end], values),
        }
    }

    /// Of flags.
    pub fn flags(&self, rows: Range<usize>, flags: &[u8]) -> u64 {
        weighted(&self.of_pairs[rows], flags.iter().map(|&flag| flag.into()))
    }
}

/// Of bits in the column of this name.
fn of_name(name: &str, bits: u64) -> u64 {
    weight(xxh3_64(name.as_bytes())).wrapping_mul(bits)
}

/// Of a row of a table, whose columns have these names in the file; scalars of frames have no time
/// of their own, and so 0.
pub fn of_row<'a>(step: u64, time: f64, columns: impl Iterator<Item = (&'a str, f64)>) -> u64 {
    let numbers = columns.map(|(name, x)| of_name(name, mixed(x.to_bits())));
    let clock = [
        of_name("step", step),
        of_name("time", mixed(time.to_bits())),
    ];
    let all = clock.into_iter().chain(numbers);
    all.fold(0, u64::wrapping_add)
}

/// Of the step, the time and the edges of the box of a frame.
pub(crate) fn of_clock(step: u64, time: f64, edges: &[f64]) -> u64 {
    let of_edges = weight(xxh3_64(b"edges")).wrapping_mul(of_sequence(0, edges));
    of_row(step, time, std::iter::empty()).wrapping_add(of_edges)
}

/// Of attributes, as hexadecimal digits.
pub fn of_parameters(parameters: &Parameters) -> String {
    let mut bytes = Vec::new();
    for (name, value) in parameters {
        let (kind, content) = match value {
            Parameter::Text(text) => (b't', text.as_bytes().to_vec()),
            Parameter::Integer(value) => (b'i', value.to_le_bytes().to_vec()),
            Parameter::Number(value) => (b'n', value.to_le_bytes().to_vec()),
            Parameter::Numbers(values) => {
                (b'v', values.iter().flat_map(|x| x.to_le_bytes()).collect())
            }
        };
        for part in [name.as_bytes(), &[kind], &content] {
            bytes.extend((part.len() as u64).to_le_bytes());
            bytes.extend(part);
        }
    }
    format!("{:016x}", xxh3_64(&bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Any change of one number, and any exchange of two different ones, changes the sum.
    #[test]
    fn changes_are_seen() {
        let values: Vec<f64> = (0..50).map(|k| f64::from(k) * 0.1 - 1.0).collect();
        let whole = of_sequence(7, &values);
        let parts = of_sequence(7, &values[..20]).wrapping_add(of_sequence(27, &values[20..]));
        assert_eq!(whole, parts);
        for k in 0..50 {
            for bit in 0..64 {
                let mut flipped = values.clone();
                flipped[k] = f64::from_bits(flipped[k].to_bits() ^ 1 << bit);
                assert_ne!(of_sequence(7, &flipped), whole);
            }
        }
        for k in 1..50 {
            let mut exchanged = values.clone();
            exchanged.swap(0, k);
            assert_ne!(of_sequence(7, &exchanged), whole);
        }
        let row = |step, time, x| of_row(step, time, [("a", x), ("b", 2.0)].into_iter());
        assert_ne!(row(1, 2.0, 3.0), row(2, 2.0, 3.0));
        assert_ne!(row(1, 2.0, 3.0), row(1, 2.5, 3.0));
        assert_ne!(row(1, 2.0, 3.0), row(1, 2.0, 3.5));
    }

    #[test]
    fn contacts_count_by_their_ids() {
        let weights = |pairs: [[u32; 2]; 3]| {
            ContactWeights::new(&pairs.map(|p| p[0]), &pairs.map(|p| p[1]), 3)
        };
        let there = weights([[1, 2], [1, 3], [4, 5]]);
        let back = weights([[4, 5], [1, 2], [1, 3]]);
        assert_eq!(there.pairs(0..3), back.pairs(0..3));
        let values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0];
        let moved = [7.0, 8.0, 9.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let all = |weights: &ContactWeights, values: &[f64]| weights.numbers(0..3, values, 3);
        assert_eq!(all(&there, &values), all(&back, &moved));
        assert_ne!(all(&there, &values), all(&there, &moved));
        // Parts and components count, too.
        let part = back.numbers(1..3, &values[..6], 3);
        let sum = part.wrapping_add(back.numbers(0..1, &values[6..], 3));
        assert_eq!(sum, all(&there, &values));
        let turned = [2.0, 1.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0];
        assert_ne!(all(&there, &turned), all(&there, &values));
        let one = |values: [f64; 3]| there.numbers(0..3, &values, 1);
        assert_ne!(one([1.0, 2.0, 3.0]), one([2.0, 1.0, 3.0]));
        let flags = |weights: &ContactWeights, flags: [u8; 3]| weights.flags(0..3, &flags);
        assert_eq!(flags(&there, [0, 1, 0]), flags(&back, [0, 0, 1]));
        assert_ne!(flags(&there, [0, 1, 0]), flags(&there, [1, 0, 0]));
        let other = weights([[1, 2], [1, 3], [4, 6]]);
        assert_ne!(there.pairs(0..3), other.pairs(0..3));
    }

    /// Whatever the processor: files go from one to another.
    #[test]
    fn instruction_sets_agree() {
        let values: Vec<f64> = (0..1003).map(|k| (f64::from(k) * 0.37).sin()).collect();
        let weights = weights(5, values.len());
        let places: Vec<u64> = (5..1008).collect();
        let mut others = places.clone();
        Isa::Portable.run(Weigh(&mut others));
        assert_eq!(others, weights);
        assert_eq!(others, places.into_iter().map(weight).collect::<Vec<_>>());
        let portable = Isa::Portable.run(WeightedSum(&weights, &values));
        assert_eq!(portable, of_numbers(&weights, &values));
    }
}
