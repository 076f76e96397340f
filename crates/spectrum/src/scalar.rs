//! The scalar types of factors and Krylov bases: real for real shifts, complex for all others.

use faer::c64;
use nalgebra::DMatrix;

use crate::qr_iteration;

/// A scalar type: `f64` for real shifts, `c64` for complex ones.
pub trait Scalar:
    faer::traits::ComplexField<Real = f64>
    + nalgebra::ComplexField<RealField = f64>
    + Copy
    + bytemuck::Pod
{
    /// Converts a complex number; a real scalar keeps the real part only.
    fn narrowed(value: c64) -> Self;
    /// Reduces a Hessenberg matrix to Schur form: H ← QᴴHQ, V ← VQ. Returns false if the QR
    /// iteration does not converge.
    fn triangularise(h: &mut DMatrix<Self>, v: &mut DMatrix<Self>) -> bool;

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

    fn triangularise(h: &mut DMatrix<f64>, v: &mut DMatrix<f64>) -> bool {
        qr_iteration::real(h, v)
    }
}

impl Scalar for c64 {
    fn narrowed(value: c64) -> Self {
        value
    }

    fn triangularise(h: &mut DMatrix<c64>, v: &mut DMatrix<c64>) -> bool {
        qr_iteration::complex(h, v)
    }
}
