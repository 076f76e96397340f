//! QR iteration from Hessenberg to Schur form.
//!
//! nalgebra's iteration has no exceptional shifts and cycles on the matrices that Krylov–Schur
//! makes; faer's gives no Schur vectors.

use std::ops::Range;

use faer::c64;
use nalgebra::{ComplexField, DMatrix};

/// Greatest number of iterations per eigenvalue.
const MOST: usize = 120;
/// From this iteration on, subdiagonal entries that are small compared with the whole matrix, and
/// not only with their neighbours, count as zero; eigenvalues of high multiplicity do not separate
/// otherwise.
const PATIENT: usize = 24;
/// Every iteration that is a multiple of this uses an exceptional shift.
const EXCEPTIONAL: usize = 10;

/// The steps of the iteration, real or complex.
pub(crate) trait QrStep: ComplexField<RealField = f64> + Copy {
    /// Size of an entry.
    fn size(self) -> f64;
    /// Rows of a block that is left as it is, at most: 2 where pairs of eigenvalues stay together.
    const LARGEST_BLOCK: usize;
    /// Makes the block of two rows of H that begins at `first` triangular, if it can be.
    fn split(h: &mut DMatrix<Self>, v: &mut DMatrix<Self>, first: usize);
    /// One step on rows and columns `first` to `last`. `exceptional`: with another shift, against
    /// cycles.
    fn step(
        h: &mut DMatrix<Self>,
        v: &mut DMatrix<Self>,
        first: usize,
        last: usize,
        exceptional: bool,
    );
}

/// Reduces a Hessenberg matrix to Schur form: H ← QᴴHQ, V ← VQ. Returns false if the iteration does
/// not converge.
pub(crate) fn triangularise<T: QrStep>(h: &mut DMatrix<T>, v: &mut DMatrix<T>) -> bool {
    let norm = h.iter().map(|&z| z.size()).fold(0.0, f64::max);
    let (mut end, mut iteration) = (h.nrows(), 0);
    while end > 0 {
        let last = end - 1;
        let first = block_start(h, last, norm, iteration > PATIENT);
        let rows = end - first;
        if rows > T::LARGEST_BLOCK {
            iteration += 1;
            if iteration > MOST {
                return false;
            }
            T::step(h, v, first, last, iteration % EXCEPTIONAL == 0);
            continue;
        }
        if rows == 2 {
            T::split(h, v, first);
        }
        (end, iteration) = (first, 0);
    }
    true
}

/// Returns the first row of the block that ends at `last`; the entry that separates it becomes 0.
/// `patient`: whether entries are compared with the whole matrix, of the size `norm`.
fn block_start<T: QrStep>(h: &mut DMatrix<T>, last: usize, norm: f64, patient: bool) -> usize {
    let mut first = last;
    while first > 0 {
        let near = h[(first, first)].size() + h[(first - 1, first - 1)].size();
        let near = if near == 0.0 || patient { norm } else { near };
        if h[(first, first - 1)].size() <= f64::EPSILON * near {
            h[(first, first - 1)] = T::zero();
            break;
        }
        first -= 1;
    }
    first
}

/// To upper triangular form, with single Wilkinson shifts.
impl QrStep for c64 {
    const LARGEST_BLOCK: usize = 1;

    fn size(self) -> f64 {
        self.re.abs() + self.im.abs()
    }

    fn split(_: &mut DMatrix<c64>, _: &mut DMatrix<c64>, _: usize) {}

    fn step(
        h: &mut DMatrix<c64>,
        v: &mut DMatrix<c64>,
        first: usize,
        last: usize,
        exceptional: bool,
    ) {
        let shift = if exceptional {
            h[(last, last)] + c64::new(0.75 * h[(last, last - 1)].size(), 0.0)
        } else {
            wilkinson(h, last)
        };
        single_step(h, v, first, last, shift);
    }
}

/// To upper triangular form except for 2 × 2 blocks of conjugate pairs, by Francis' double shift
/// (Golub & Van Loan 2013, section 7.5).
impl QrStep for f64 {
    const LARGEST_BLOCK: usize = 2;

    fn size(self) -> f64 {
        self.abs()
    }

    fn split(h: &mut DMatrix<f64>, v: &mut DMatrix<f64>, first: usize) {
        split(h, v, first);
    }

    fn step(
        h: &mut DMatrix<f64>,
        v: &mut DMatrix<f64>,
        first: usize,
        last: usize,
        exceptional: bool,
    ) {
        double_step(h, v, first, last, exceptional);
    }
}

/// The eigenvalue of the last 2 × 2 block that is nearer to its last entry.
fn wilkinson(h: &DMatrix<c64>, last: usize) -> c64 {
    let (a, d) = (h[(last - 1, last - 1)], h[(last, last)]);
    let half = (a - d) * 0.5;
    let product = h[(last - 1, last)] * h[(last, last - 1)];
    let root = (half * half + product).sqrt();
    let [plus, minus] = [half + root, half - root];
    let large = if plus.norm() > minus.norm() {
        plus
    } else {
        minus
    };
    if large.norm() == 0.0 {
        d
    } else {
        d - product / large
    }
}

/// A Givens rotation of two rows or columns.
#[derive(Clone, Copy)]
struct Givens<T> {
    c: T,
    s: T,
}

impl<T: ComplexField + Copy> Givens<T> {
    /// Rotates rows k and k + 1, in these columns.
    fn turn_rows(self, m: &mut DMatrix<T>, k: usize, columns: Range<usize>) {
        let Givens { c, s } = self;
        for j in columns {
            let (x, y) = (m[(k, j)], m[(k + 1, j)]);
            m[(k, j)] = c.conjugate() * x + s.conjugate() * y;
            m[(k + 1, j)] = c * y - s * x;
        }
    }

    /// Rotates columns k and k + 1, in the first `rows` rows, by the inverse.
    fn turn_columns(self, m: &mut DMatrix<T>, k: usize, rows: usize) {
        let Givens { c, s } = self;
        for i in 0..rows {
            let (x, y) = (m[(i, k)], m[(i, k + 1)]);
            m[(i, k)] = x * c + y * s;
            m[(i, k + 1)] = y * c.conjugate() - x * s.conjugate();
        }
    }
}

/// One QR step with Givens rotations on rows and columns `first` to `last`.
fn single_step(h: &mut DMatrix<c64>, v: &mut DMatrix<c64>, first: usize, last: usize, shift: c64) {
    let n = h.nrows();
    (first..=last).for_each(|i| h[(i, i)] -= shift);
    let mut rotations = Vec::with_capacity(last - first);
    for k in first..last {
        let (a, b) = (h[(k, k)], h[(k + 1, k)]);
        let length = a.norm().hypot(b.norm());
        let (c, s) = if length == 0.0 {
            (c64::new(1.0, 0.0), c64::new(0.0, 0.0))
        } else {
            (a / length, b / length)
        };
        let rotation = Givens { c, s };
        rotation.turn_rows(h, k, k..n);
        rotations.push(rotation);
    }
    for (k, rotation) in (first..last).zip(rotations) {
        rotation.turn_columns(h, k, (k + 2).min(last) + 1);
        rotation.turn_columns(v, k, n);
    }
    (first..=last).for_each(|i| h[(i, i)] += shift);
}

/// Makes the 2 × 2 block at `at` triangular if its eigenvalues are real.
fn split(h: &mut DMatrix<f64>, v: &mut DMatrix<f64>, at: usize) {
    let (a, b) = (h[(at, at)], h[(at, at + 1)]);
    let (c, d) = (h[(at + 1, at)], h[(at + 1, at + 1)]);
    let half = 0.5 * (a - d);
    let square = half * half + b * c;
    if square < 0.0 {
        return;
    }
    // (z, c) is an eigenvector; z = λ - d is the larger of the two candidates, so that nothing
    // cancels.
    let z = half + square.sqrt().copysign(half);
    let length = z.hypot(c);
    if length == 0.0 {
        return;
    }
    let n = h.nrows();
    let rotation = Givens {
        c: z / length,
        s: c / length,
    };
    rotation.turn_rows(h, at, at..n);
    rotation.turn_columns(h, at, at + 2);
    rotation.turn_columns(v, at, n);
    h[(at + 1, at)] = 0.0;
}

/// One double step on rows and columns `first` to `last`, at least three of them.
fn double_step(
    h: &mut DMatrix<f64>,
    v: &mut DMatrix<f64>,
    first: usize,
    last: usize,
    exceptional: bool,
) {
    let n = h.nrows();
    let z = h[(first, first)];
    // The two shifts are given by x, y and w of (x - s)(y - s) = w. Differences are taken first
    // because there may be many nearly equal eigenvalues.
    let (x, y, w) = if exceptional {
        let s = h[(last, last - 1)].abs() + h[(last - 1, last - 2)].abs();
        let x = h[(last, last)] + 0.75 * s;
        (x, x, -0.4375 * s * s)
    } else {
        let w = h[(last, last - 1)] * h[(last - 1, last)];
        (h[(last, last)], h[(last - 1, last - 1)], w)
    };
    let (r, s) = (x - z, y - z);
    let mut x = [
        (r * s - w) / h[(first + 1, first)] + h[(first, first + 1)],
        h[(first + 1, first + 1)] - z - r - s,
        h[(first + 2, first + 1)],
    ];
    for k in first..last {
        let count = (last + 1 - k).min(3);
        if k > first {
            (0..3).for_each(|i| x[i] = if i < count { h[(k + i, k - 1)] } else { 0.0 });
        }
        let Some(reflection) = Reflection::onto_first_axis(&x, count) else {
            continue;
        };
        reflection.turn_rows(h, k, k.saturating_sub(1).max(first)..n);
        reflection.turn_columns(h, k, (k + 3).min(last) + 1);
        reflection.turn_columns(v, k, n);
        if k > first {
            (1..count).for_each(|i| h[(k + i, k - 1)] = 0.0);
        }
    }
}

/// The reflection 1 - scale u uᵀ of neighbouring rows or columns.
struct Reflection {
    u: [f64; 3],
    /// 2/uᵀu.
    scale: f64,
    /// Rows or columns: only so many of u count.
    count: usize,
}

impl Reflection {
    /// The one that maps x to the first axis; `None` if x is zero.
    fn onto_first_axis(x: &[f64; 3], count: usize) -> Option<Self> {
        let largest = x.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        if largest == 0.0 {
            return None;
        }
        let mut u = x.map(|x| x / largest);
        let length = u.iter().map(|x| x * x).sum::<f64>().sqrt();
        u[0] += length.copysign(u[0]);
        let square: f64 = u.iter().map(|x| x * x).sum();
        Some(Self {
            u,
            scale: 2.0 / square,
            count,
        })
    }

    /// Reflects the rows from k on, in these columns.
    fn turn_rows(&self, m: &mut DMatrix<f64>, k: usize, columns: Range<usize>) {
        let Reflection { u, scale, count } = *self;
        for j in columns {
            let along: f64 = (0..count).map(|i| u[i] * m[(k + i, j)]).sum();
            (0..count).for_each(|i| m[(k + i, j)] -= scale * u[i] * along);
        }
    }

    /// Reflects the columns from k on, in the first `rows` rows.
    fn turn_columns(&self, m: &mut DMatrix<f64>, k: usize, rows: usize) {
        let Reflection { u, scale, count } = *self;
        for row in 0..rows {
            let along: f64 = (0..count).map(|i| u[i] * m[(row, k + i)]).sum();
            (0..count).for_each(|i| m[(row, k + i)] -= scale * u[i] * along);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::linalg::Hessenberg;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Random entries over many orders of magnitude, cycles (which need exceptional shifts), and a
    /// Jordan block.
    fn matrices() -> Vec<DMatrix<f64>> {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let n = 40;
        let plain = DMatrix::from_fn(n, n, |_, _| random.random_range(-1.0..1.0));
        let graded = DMatrix::from_fn(n, n, |i, j| {
            plain[(i, j)] * 10f64.powi(-((i + j) as i32) / 4)
        });
        let mut cycle = DMatrix::zeros(12, 12);
        (0..12).for_each(|i| cycle[((i + 1) % 12, i)] = 1.0);
        let jordan = DMatrix::from_fn(6, 6, |i, j| f64::from(u8::from(i == j || i + 1 == j)));
        vec![plain, graded, cycle, jordan, DMatrix::zeros(5, 5)]
    }

    #[test]
    fn schur_form_is_similar_and_triangular() {
        for b in matrices() {
            let n = b.nrows();
            let (mut q, mut t) = Hessenberg::new(b.clone()).unpack();
            assert!(triangularise(&mut t, &mut q));
            let error = (&q * &t * q.transpose() - &b).norm();
            assert!(error < 1e-13 * b.norm().max(1e-300), "{error:e}");
            assert!((q.transpose() * &q - DMatrix::identity(n, n)).norm() < 1e-13);
            for i in 1..n {
                assert!((0..i - 1).all(|j| t[(i, j)] == 0.0));
                assert!(i < 2 || t[(i, i - 1)] == 0.0 || t[(i - 1, i - 2)] == 0.0);
            }

            let wide = b.map(|x| c64::new(x, 0.3 * x.abs()));
            let (mut q, mut t) = Hessenberg::new(wide.clone()).unpack();
            assert!(triangularise(&mut t, &mut q));
            let error = (&q * &t * q.adjoint() - &wide).norm();
            assert!(error < 1e-13 * wide.norm().max(1e-300), "{error:e}");
            (1..n).for_each(|i| assert_eq!(t[(i, i - 1)].norm(), 0.0));
        }
    }
}
