//! Sums over grains and ranks that do not depend on the order: fixed-point numbers, added as
//! integers.

use super::Exchange;

/// Number of integers that represent a fixed-point number in a reduction.
pub(crate) const LIMBS: usize = 4;

/// Fixed-point numbers whose unit is 2^-80 of a reference magnitude. Each term is rounded to the
/// unit, and sums of up to 2^46 times the reference are exact.
#[derive(Debug, Clone, Copy)]
pub struct FixedPoint {
    unit: f64,
    per_unit: f64,
}

/// A partial sum.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Accumulator {
    sum: i128,
    /// Number of terms that are not finite or too large.
    outside: i64,
}

impl FixedPoint {
    /// Fixed-point numbers for terms of this typical magnitude, which is positive.
    pub fn new(reference: f64) -> Self {
        let exponent = (reference.to_bits() >> 52) as i32 - 1023;
        let power = |e: i32| f64::from_bits(((e.clamp(-1022, 1023) + 1023) as u64) << 52);
        Self {
            unit: power(exponent - 80),
            per_unit: power(80 - exponent),
        }
    }

    /// Adds a term.
    #[inline(always)]
    pub fn add(&self, to: &mut Accumulator, term: f64) {
        let scaled = term * self.per_unit;
        if scaled.abs() < 2f64.powi(62) {
            to.sum += i128::from(scaled.round_ties_even() as i64);
        } else if scaled.abs() < 2f64.powi(120) {
            to.sum += whole(scaled);
        } else {
            to.outside += 1;
        }
    }

    /// Adds a whole number of units that are a power of two.
    pub(crate) fn add_whole(&self, to: &mut Accumulator, count: i128, unit: f64) {
        let exponent = ((unit * self.per_unit).to_bits() >> 52) as i64 - 1023;
        // That of NaN is 1024.
        let bits = count.unsigned_abs().checked_ilog2().unwrap_or(0);
        if exponent >= 0 && exponent + i64::from(bits) < 120 {
            to.sum += count << exponent;
        } else if count != 0 {
            to.outside += 1;
        }
    }

    /// The sum, correctly rounded; NaN if a term was out of range.
    pub fn value(&self, sum: Accumulator) -> f64 {
        if sum.outside == 0 {
            sum.sum as f64 * self.unit
        } else {
            f64::NAN
        }
    }

    /// Sums over the ranks, in one reduction.
    pub fn total<const K: usize>(
        &self,
        exchange: &dyn Exchange,
        parts: [Accumulator; K],
    ) -> [f64; K] {
        let mut message = vec![0i64; K * (LIMBS + 1)];
        for (part, limbs) in parts.iter().zip(message.chunks_mut(LIMBS + 1)) {
            part.write(limbs);
        }
        exchange.sum(&mut message);
        let mut sums = message.chunks(LIMBS + 1).map(Accumulator::read);
        std::array::from_fn(|_| self.value(sums.next().unwrap_or_default()))
    }
}

/// Greatest magnitude that [`nearest_whole`] takes.
pub(crate) const MOST_COUNTED: f64 = (1u64 << 51) as f64;

/// The nearest whole number, of one up to [`MOST_COUNTED`]: `round_ties_even` calls a function
/// where the instruction set lacks it.
pub(crate) fn nearest_whole(x: f64) -> i64 {
    let shift = (3u64 << 51) as f64;
    (x + shift).to_bits().wrapping_sub(shift.to_bits()) as i64
}

/// A number from 2^53 to 2^120 in magnitude, which is whole. The conversion by `as` calls a
/// function of several times the length.
fn whole(x: f64) -> i128 {
    let bits = x.to_bits();
    let mantissa = bits & ((1 << 52) - 1) | 1 << 52;
    let magnitude = i128::from(mantissa) << ((bits >> 52 & 0x7ff) - 1075);
    if x < 0.0 { -magnitude } else { magnitude }
}

impl From<i128> for Accumulator {
    fn from(sum: i128) -> Self {
        Self { sum, outside: 0 }
    }
}

impl From<Accumulator> for i128 {
    fn from(accumulator: Accumulator) -> i128 {
        accumulator.sum
    }
}

impl Accumulator {
    /// Adds another sum.
    pub(crate) fn merge(&mut self, other: Self) {
        self.sum += other.sum;
        self.outside += other.outside;
    }

    /// This sum less another.
    #[must_use]
    pub fn less(self, other: Self) -> Self {
        Self {
            sum: self.sum - other.sum,
            outside: self.outside + other.outside,
        }
    }

    /// Writes the sum as `LIMBS + 1` integers that can be added over the ranks.
    pub fn write(&self, to: &mut [i64]) {
        for (k, limb) in to[..LIMBS].iter_mut().enumerate() {
            *limb = if k + 1 < LIMBS {
                i64::from((self.sum >> (32 * k)) as u32)
            } else {
                (self.sum >> (32 * k)) as i64
            };
        }
        to[LIMBS] = self.outside;
    }

    /// The sum from added integers.
    pub fn read(from: &[i64]) -> Self {
        let sum = from[..LIMBS]
            .iter()
            .enumerate()
            .map(|(k, &limb)| i128::from(limb) << (32 * k))
            .sum();
        Self {
            sum,
            outside: from[LIMBS],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_order_and_any_partition_gives_the_same_bits() {
        let terms: Vec<f64> = (0..1000)
            .map(|k| (f64::from(k * 7919 % 1000) - 499.5) * 1.37e-3 * 1.01f64.powi(k % 700))
            .collect();
        let fixed = FixedPoint::new(0.02);
        let sum = |order: &mut dyn Iterator<Item = &f64>| {
            let mut part = Accumulator::default();
            order.for_each(|&t| fixed.add(&mut part, t));
            part
        };
        let whole = sum(&mut terms.iter());
        assert_eq!(whole, sum(&mut terms.iter().rev()));
        let mut limbs = [0; LIMBS + 1];
        for chunk in terms.chunks(137) {
            let mut part = [0; LIMBS + 1];
            sum(&mut chunk.iter()).write(&mut part);
            limbs.iter_mut().zip(part).for_each(|(a, b)| *a += b);
        }
        assert_eq!(whole, Accumulator::read(&limbs));
    }

    #[test]
    fn whole_counts_are_added_in_their_unit() {
        let fixed = FixedPoint::new(3.0);
        for count in [0, 1, -7, 1_234_567_890_123_457] {
            for exponent in [-60, -30, 0] {
                let unit = 2f64.powi(exponent);
                let [mut one, mut other] = [Accumulator::default(); 2];
                fixed.add_whole(&mut one, count, unit);
                fixed.add(&mut other, count as f64 * unit);
                assert_eq!(one, other, "{count} {exponent}");
            }
        }
        let mut outside = Accumulator::default();
        fixed.add_whole(&mut outside, 5, f64::NAN);
        assert!(fixed.value(outside).is_nan());
        for x in [0.0, 0.5, 1.5, -2.5, 3.7, -1e15, 2.2e15] {
            assert_eq!(nearest_whole(x), x.round_ties_even() as i64, "{x}");
        }
    }

    #[test]
    fn terms_are_rounded_as_by_a_cast() {
        let fixed = FixedPoint::new(1.0);
        for exponent in -90..40 {
            for digits in [1.0, 1.5, 1.999_999_999_999, std::f64::consts::PI / 3.0] {
                for term in [1.0, -1.0].map(|sign| sign * digits * 2f64.powi(exponent)) {
                    let mut sum = Accumulator::default();
                    fixed.add(&mut sum, term);
                    let scaled = (term * 2f64.powi(80)).round_ties_even();
                    assert_eq!(i128::from(sum), scaled as i128, "{term}");
                }
            }
        }
    }

    /// Terms with few digits have a sum without rounding.
    #[test]
    fn cancels_exactly() {
        let fixed = FixedPoint::new(1.0);
        let mut sum = Accumulator::default();
        for term in [1e9, 2f64.powi(-70), -1e9, 0.5] {
            fixed.add(&mut sum, term);
        }
        assert_eq!(fixed.value(sum), 0.5 + 2f64.powi(-70));
        fixed.add(&mut sum, f64::NAN);
        assert!(fixed.value(sum).is_nan());
    }
}
