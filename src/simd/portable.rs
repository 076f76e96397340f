//! Plain arrays, for any processor.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::{LANES, Lanes, Mask, Row};

/// Every processor can do this.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PortableToken;

#[derive(Debug, Clone, Copy)]
pub struct Portable([f64; LANES]);

impl Portable {
    #[inline(always)]
    fn map(self, f: impl Fn(f64) -> f64) -> Self {
        Portable(self.0.map(f))
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Portable(std::array::from_fn(|k| f(self.0[k], other.0[k])))
    }
}

macro_rules! operator {
    ($trait:ident, $method:ident) => {
        impl $trait for Portable {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.zip(other, f64::$method)
            }
        }
    };
}
operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);
operator!(Div, div);

impl Neg for Portable {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|x| -x)
    }
}

impl Mask for u8 {
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        self & other
    }

    #[inline(always)]
    fn bits(self) -> u8 {
        self
    }
}

impl Lanes for Portable {
    type Token = PortableToken;
    type Mask = u8;

    #[inline(always)]
    fn splat(_: PortableToken, x: f64) -> Self {
        Portable([x; LANES])
    }

    #[inline(always)]
    fn load(_: PortableToken, from: &Row) -> Self {
        Portable(from.0)
    }

    #[inline(always)]
    fn store(self, to: &mut Row) {
        to.0 = self.0;
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        Portable(std::array::from_fn(|k| {
            self.0[k].mul_add(factor.0[k], term.0[k])
        }))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(f64::sqrt)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        self.map(f64::abs)
    }

    #[inline(always)]
    fn round(self) -> Self {
        self.map(f64::round_ties_even)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn copy_sign(self, sign: Self) -> Self {
        self.zip(sign, f64::copysign)
    }

    #[inline(always)]
    fn greater(self, other: Self) -> u8 {
        (0..LANES).fold(0, |m, k| m | (u8::from(self.0[k] > other.0[k]) << k))
    }

    #[inline(always)]
    fn select(self, mask: u8, other: Self) -> Self {
        Portable(std::array::from_fn(|k| {
            if mask >> k & 1 == 1 {
                self.0[k]
            } else {
                other.0[k]
            }
        }))
    }

    #[inline(always)]
    fn exponent_mantissa(self) -> (Self, Self) {
        let exponent = self.map(|x| ((x.to_bits() >> 52) as i64 - 1023) as f64);
        let mantissa = self
            .map(|x| f64::from_bits(x.to_bits() & 0x000f_ffff_ffff_ffff | 0x3ff0_0000_0000_0000));
        (exponent, mantissa)
    }

    #[inline(always)]
    fn differences(
        _: PortableToken,
        records: &[Row],
        i: &[u32; LANES],
        j: &[u32; LANES],
    ) -> [Self; LANES] {
        let mut out = [Portable([0.0; LANES]); LANES];
        for lane in 0..LANES {
            let (a, b) = (&records[i[lane] as usize], &records[j[lane] as usize]);
            for (field, lanes) in out.iter_mut().enumerate() {
                lanes.0[lane] = a.0[field] - b.0[field];
            }
        }
        out
    }
}
