//! The scalar types of factors and Krylov bases: real for real shifts, complex for all others.

use faer::c64;

use crate::qr_iteration::QrStep;

/// A scalar type: `f64` for real shifts, `c64` for complex ones.
pub(crate) trait Scalar:
    faer::traits::ComplexField<Real = f64>
    + nalgebra::ComplexField<RealField = f64>
    + QrStep
    + bytemuck::Pod
{
    /// Converts a complex number; a real scalar keeps the real part only.
    fn narrowed(value: c64) -> Self;

    /// Converts a real number.
    fn of(value: f64) -> Self {
        Self::from_real(value)
    }

    /// Converts to a complex number.
    fn widened(self) -> c64 {
        c64::new(self.real(), self.imaginary())
    }
}

impl Scalar for f64 {
    fn narrowed(value: c64) -> Self {
        value.re
    }
}

impl Scalar for c64 {
    fn narrowed(value: c64) -> Self {
        value
    }
}
