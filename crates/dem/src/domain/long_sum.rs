//! Sums of f64 without rounding, which depend neither on the order of the terms nor on a reference
//! magnitude: integers of the least positive f64, 2^-1074, in limbs of 32 bits.

/// Bits of a limb.
const BITS: u32 = 32;
/// Every finite f64 is less than 2^2098 units, which takes 66 limbs; the last one holds the carry
/// and the sign.
const LIMBS: usize = 67;
/// Integers that represent a sum in a reduction over ranks.
pub(crate) const WORDS: usize = LIMBS + 1;
/// The exponent of the unit.
const UNIT: i32 = -1074;
/// Terms after which carries are passed on: each adds less than 2^32 to a limb.
const MOST_PENDING: u32 = 1 << 30;

/// A sum of f64 without rounding. Its value is the exact sum, rounded once.
///
/// ```
/// use gshear_dem::domain::LongSum;
///
/// let mut sum = LongSum::default();
/// for term in [1e200, 1.0, -1e200, 1e-200] {
///     sum.add(term);
/// }
/// assert_eq!(sum.value(), 1.0);
/// ```
#[derive(Debug, Clone)]
pub struct LongSum {
    /// The integer, from its lowest bits on. Between carries a limb may have any sign.
    limbs: [i64; LIMBS],
    /// Terms since carries were passed on.
    pending: u32,
    /// Number of terms that are not finite.
    outside: i64,
}

impl Default for LongSum {
    fn default() -> Self {
        Self {
            limbs: [0; LIMBS],
            pending: 0,
            outside: 0,
        }
    }
}

impl LongSum {
    /// Adds a term.
    pub fn add(&mut self, term: f64) {
        if !term.is_finite() {
            self.outside += 1;
            return;
        }
        let bits = term.to_bits();
        let exponent = (bits >> 52 & 0x7ff) as u32;
        let fraction = bits & ((1 << 52) - 1);
        let (mantissa, shift) = if exponent == 0 {
            (fraction, 0)
        } else {
            (fraction | 1 << 52, exponent - 1)
        };
        let first = (shift / BITS) as usize;
        let mut rest = u128::from(mantissa) << (shift % BITS);
        for limb in &mut self.limbs[first..first + 3] {
            let part = i64::from(rest as u32);
            *limb += if term < 0.0 { -part } else { part };
            rest >>= BITS;
        }
        self.pending += 1;
        if self.pending == MOST_PENDING {
            self.carry();
        }
    }

    /// Adds another sum.
    pub fn merge(&mut self, mut other: Self) {
        self.carry();
        other.carry();
        for (limb, more) in self.limbs.iter_mut().zip(other.limbs) {
            *limb += more;
        }
        self.outside += other.outside;
        self.carry();
    }

    /// Passes carries on, so that every limb but the last one is in 0 … 2^32 - 1.
    fn carry(&mut self) {
        let mut carry = 0;
        for limb in &mut self.limbs[..LIMBS - 1] {
            let sum = *limb + carry;
            *limb = i64::from(sum as u32);
            carry = sum >> BITS;
        }
        self.limbs[LIMBS - 1] += carry;
        self.pending = 0;
    }

    /// The exact sum, rounded to nearest; NaN if a term was not finite.
    pub fn value(&self) -> f64 {
        if self.outside > 0 {
            return f64::NAN;
        }
        let mut sum = self.clone();
        sum.carry();
        let is_negative = sum.limbs[LIMBS - 1] < 0;
        if is_negative {
            sum.limbs.iter_mut().for_each(|limb| *limb = -*limb);
            sum.carry();
        }
        let magnitude = sum.magnitude();
        if is_negative { -magnitude } else { magnitude }
    }

    /// The value of limbs of which none is negative.
    fn magnitude(&self) -> f64 {
        let Some(last) = self.limbs.iter().rposition(|limb| *limb != 0) else {
            return 0.0;
        };
        // Three limbs have 65 digits or more: those below them only break ties.
        let first = last.saturating_sub(2);
        let mut digits = 0u128;
        for limb in self.limbs[first..=last].iter().rev() {
            digits = digits << BITS | *limb as u128;
        }
        if self.limbs[..first].iter().any(|limb| *limb != 0) {
            digits |= 1;
        }
        let exponent = UNIT + (BITS as usize * first) as i32;
        digits as f64 * power_of_two(exponent)
    }

    /// Writes the sum as integers that can be added over the ranks.
    pub(crate) fn write(&self, to: &mut [i64]) {
        let mut sum = self.clone();
        sum.carry();
        to[..LIMBS].copy_from_slice(&sum.limbs);
        to[LIMBS] = sum.outside;
    }

    /// The sum from added integers.
    pub(crate) fn read(from: &[i64]) -> Self {
        let mut sum = Self {
            outside: from[LIMBS],
            ..Self::default()
        };
        sum.limbs.copy_from_slice(&from[..LIMBS]);
        sum.carry();
        sum
    }
}

/// 2^exponent, of exponents from -1074 to 1023.
fn power_of_two(exponent: i32) -> f64 {
    if exponent >= -1022 {
        f64::from_bits(((exponent + 1023) as u64) << 52)
    } else {
        f64::from_bits(1 << (exponent - UNIT))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sum(terms: &[f64]) -> f64 {
        let mut sum = LongSum::default();
        terms.iter().for_each(|term| sum.add(*term));
        sum.value()
    }

    /// One term comes back to the bit, whatever its magnitude.
    #[test]
    fn a_term_is_its_own_sum() {
        let magnitudes = [
            5e-324,
            1e-310,
            f64::MIN_POSITIVE,
            1e-200,
            0.1,
            1.0,
            std::f64::consts::PI,
            1e22,
            1e300,
            f64::MAX,
        ];
        for x in magnitudes.into_iter().flat_map(|x| [x, -x]) {
            assert_eq!(sum(&[x]).to_bits(), x.to_bits(), "{x:e}");
            assert_eq!(sum(&[x, x, -x]), x, "{x:e}");
            assert_eq!(sum(&[x, -x]).to_bits(), 0);
        }
        assert_eq!(sum(&[]).to_bits(), 0);
    }

    /// Rounded once: to nearest, ties to even, by whatever lies far below.
    #[test]
    fn the_exact_sum_is_rounded_once() {
        let ulp = f64::EPSILON;
        assert_eq!(sum(&[1.0, 0.5 * ulp]), 1.0);
        assert_eq!(sum(&[1.0, 0.5 * ulp, 5e-324]), 1.0 + ulp);
        assert_eq!(sum(&[1.0, 0.5 * ulp, -5e-324]), 1.0);
        assert_eq!(sum(&[1.0 + ulp, 0.5 * ulp]), 1.0 + 2.0 * ulp);
        assert_eq!(sum(&[f64::MAX, f64::MAX]), f64::INFINITY);
        assert_eq!(sum(&[f64::MAX, f64::MAX, -f64::MAX]), f64::MAX);
        assert!(sum(&[1.0, f64::NAN]).is_nan());
        assert!(sum(&[f64::INFINITY, 1.0]).is_nan());
    }

    /// Whole numbers of a unit, summed as i128.
    #[test]
    fn agrees_with_integers() {
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1);
            (state >> 11) as i64 - (1 << 52)
        };
        let unit = 2f64.powi(-200);
        let whole: Vec<i64> = (0..5000).map(|_| next()).collect();
        let terms: Vec<f64> = whole.iter().map(|n| *n as f64 * unit).collect();
        let exact: i128 = whole.iter().map(|n| i128::from(*n)).sum();
        assert_eq!(sum(&terms), exact as f64 * unit);
        let mut parts = [0i64; WORDS];
        for chunk in terms.rchunks(137) {
            let mut part = LongSum::default();
            chunk.iter().for_each(|term| part.add(*term));
            let mut words = [0; WORDS];
            part.write(&mut words);
            parts.iter_mut().zip(words).for_each(|(a, b)| *a += b);
        }
        assert_eq!(LongSum::read(&parts).value(), exact as f64 * unit);
        let (before, after) = terms.split_at(1234);
        let [mut one, mut other] = [LongSum::default(), LongSum::default()];
        before.iter().for_each(|term| one.add(*term));
        after.iter().for_each(|term| other.add(*term));
        one.merge(other);
        assert_eq!(one.value(), exact as f64 * unit);
    }
}
