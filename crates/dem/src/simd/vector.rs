//! What AVX2 and AVX-512 share: sixteen lanes as an array of registers, and the operations that are
//! the same few instructions on each register.
//!
//! The macros name the intrinsics without `_mm256` or `_mm512`; the files that use them import them
//! under these names.

/// The token of an instruction set of these features, and `run`.
macro_rules! token {
    ($lanes:ident, $token:ident, $name:literal, [$($feature:tt)*]) => {
        #[doc = concat!("Proof that this processor has ", $name, ".")]
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub struct $token(());

        impl $token {
            /// The token, if this processor has them.
            pub fn detect() -> Option<Self> {
                ($(is_x86_feature_detected!($feature))&&*).then_some(Self(()))
            }
        }

        /// Does the work, compiled for this instruction set.
        pub(super) fn run<W: Work>(token: $token, work: W) -> W::Output {
            $(#[target_feature(enable = $feature)])*
            fn compiled<W: Work>(token: $token, work: W) -> W::Output {
                work.run::<$lanes>(token)
            }
            // SAFETY: the token proves that the processor has these features.
            unsafe { compiled(token, work) }
        }
    };
}

/// The lanes, the sums of integers, and the arithmetic operators. `$part` are the numbers of the
/// registers. Nothing here loops or calls `array::from_fn`: what is not inlined is not compiled for
/// the instruction set.
macro_rules! registers {
    ($lanes:ident, $counts:ident, $register:ty, $integers:ty, [$($part:literal)*]) => {
        /// Sixteen f64 in vector registers.
        #[derive(Debug, Clone, Copy)]
        pub struct $lanes([$register; [$($part),*].len()]);

        /// Sixteen sums of integers.
        #[derive(Debug, Clone, Copy)]
        pub struct $counts([$integers; [$($part),*].len()]);

        /// `f` of the number of each register. Unlike `array::from_fn` it is always inlined; code
        /// that is not inlined is not compiled for the instruction set.
        #[inline(always)]
        fn each<T>(f: impl Fn(usize) -> T) -> [T; [$($part),*].len()] {
            [$(f($part)),*]
        }

        impl $lanes {
            #[inline(always)]
            fn map(self, f: impl Fn($register) -> $register) -> Self {
                $lanes([$(f(self.0[$part])),*])
            }

            #[inline(always)]
            fn zip(self, other: Self, f: impl Fn($register, $register) -> $register) -> Self {
                $lanes([$(f(self.0[$part], other.0[$part])),*])
            }
        }

        $crate::simd::vector::operators!($lanes: Add add add_pd, Sub sub sub_pd, Mul mul mul_pd, Div div div_pd);

        impl Neg for $lanes {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                // SAFETY: a value of this type is only made from a token.
                self.map(|x| unsafe { xor_pd(x, set1_pd(-0.0)) })
            }
        }
    };
}

macro_rules! operators {
    ($lanes:ident: $($trait:ident $method:ident $intrinsic:ident),*) => {$(
        impl $trait for $lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: a value of this type is only made from a token.
                self.zip(other, |a, b| unsafe { $intrinsic(a, b) })
            }
        }
    )*};
}

/// Operations of [`Lanes`](super::Lanes), in its `impl`. `$width` is the number of lanes of a
/// register.
macro_rules! operations {
    ($lanes:ident, $token:ident, $counts:ident, $width:literal, [$($part:literal)*]) => {
        #[inline(always)]
        fn splat(_: $token, x: f64) -> Self {
            // SAFETY: the token proves that the processor has the instruction set.
            $lanes(unsafe { [set1_pd(x); [$($part),*].len()] })
        }

        #[inline(always)]
        fn load(_: $token, from: &Lanes16) -> Self {
            // SAFETY: the token proves that the processor has the instruction set; `Lanes16` holds
            // sixteen f64 and is aligned, and each pointer is that of the lanes of a register.
            $lanes(unsafe { [$(load_pd(from.0.as_ptr().add($width * $part))),*] })
        }

        #[inline(always)]
        fn store(self, to: &mut Lanes16) {
            // SAFETY: a value of this type is only made from a token; `Lanes16` holds sixteen f64
            // and is aligned, and each pointer is that of the lanes of a register.
            unsafe { $(store_pd(to.0.as_mut_ptr().add($width * $part), self.0[$part]);)* }
        }

        #[inline(always)]
        fn mul_add(self, factor: Self, term: Self) -> Self {
            // SAFETY: a value of this type is only made from a token.
            $lanes(unsafe { [$(fmadd_pd(self.0[$part], factor.0[$part], term.0[$part])),*] })
        }

        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: a value of this type is only made from a token.
            self.map(|x| unsafe { sqrt_pd(x) })
        }

        #[inline(always)]
        fn abs(self) -> Self {
            // SAFETY: a value of this type is only made from a token.
            self.map(|x| unsafe { andnot_pd(set1_pd(-0.0), x) })
        }

        #[inline(always)]
        fn round(self) -> Self {
            // SAFETY: a value of this type is only made from a token.
            self.map(|x| unsafe { round_pd::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(x) })
        }

        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: a value of this type is only made from a token.
            self.zip(other, |a, b| unsafe { max_pd(a, b) })
        }

        #[inline(always)]
        fn copy_sign(self, sign: Self) -> Self {
            // SAFETY: a value of this type is only made from a token.
            self.zip(sign, |x, s| unsafe {
                let bit = set1_pd(-0.0);
                or_pd(andnot_pd(bit, x), and_pd(bit, s))
            })
        }

        #[inline(always)]
        fn no_counts(_: $token) -> $counts {
            // SAFETY: the token proves that the processor has the instruction set.
            $counts(unsafe { [setzero_int(); [$($part),*].len()] })
        }

        #[inline(always)]
        fn count(self, sums: $counts) -> $counts {
            let mut sums = sums;
            for (sum, x) in sums.0.iter_mut().zip(self.0) {
                // SAFETY: a value of this type is only made from a token.
                unsafe {
                    let shifted = add_pd(x, set1_pd(TO_INTEGER));
                    let zero = set1_int(TO_INTEGER.to_bits() as i64);
                    *sum = add_int(*sum, sub_int(pd_as_int(shifted), zero));
                }
            }
            sums
        }

        #[inline(always)]
        fn total(sums: $counts) -> i128 {
            let mut all = [0i64; LANES];
            // SAFETY: sums are only made from a token; each pointer is that of the lanes of a
            // register.
            unsafe { $(storeu_int(all.as_mut_ptr().add($width * $part).cast(), sums.0[$part]);)* }
            all.iter().copied().map(i128::from).sum()
        }

        #[inline(always)]
        fn inverse_start(self) -> Self {
            // SAFETY: a value of this type is only made from a token.
            self.map(|x| unsafe { int_as_pd(sub_int(set1_int(INVERSE_MAGIC as i64), pd_as_int(x))) })
        }

        #[inline(always)]
        fn inverse_sqrt_start(self) -> Self {
            // SAFETY: a value of this type is only made from a token.
            self.map(|x| unsafe {
                let half = shift_right_int::<1>(pd_as_int(x));
                int_as_pd(sub_int(set1_int(INVERSE_SQRT_MAGIC as i64), half))
            })
        }
    };
}

/// The bits of x plus half an eighth of its power of two, which rounds the mantissa to eighths; and
/// x over its power of two after this rounding, in [31/32, 31/16).
macro_rules! rounding_to_eighths {
    ($register:ty, $integers:ty) => {
        /// The bits of x plus half an eighth of its power of two: rounds the mantissa to eighths.
        ///
        /// # Safety
        /// The processor has the instruction set.
        #[inline(always)]
        unsafe fn rounded(x: $register) -> $integers {
            // SAFETY: register operations only, with the feature that the caller guarantees.
            unsafe { add_int(pd_as_int(x), set1_int(1 << 48)) }
        }

        /// x over its power of two, after rounding to eighths: in [31/32, 31/16).
        ///
        /// # Safety
        /// The processor has the instruction set.
        #[inline(always)]
        unsafe fn mantissa_about_one(x: $register) -> $register {
            // SAFETY: register operations only, with the feature that the caller guarantees.
            unsafe {
                let power = and_int(rounded(x), set1_int(0xfff << 52));
                int_as_pd(sub_int(add_int(pd_as_int(x), set1_int(1023 << 52)), power))
            }
        }
    };
}

pub(super) use {operations, operators, registers, rounding_to_eighths, token};
