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

/// Returns the first row of the block that ends at `last`; the entry that separates it becomes 0.
/// `size`: of an entry; `patient`: whether entries are compared with the whole matrix, of the size
/// `norm`.
fn block_start<T: ComplexField + Copy>(
    h: &mut DMatrix<T>,
    last: usize,
    size: impl Fn(T) -> f64,
    norm: f64,
    patient: bool,
) -> usize {
    let mut first = last;
    while first > 0 {
        let near = size(h[(first, first)]) + size(h[(first - 1, first - 1)]);
        let near = if near == 0.0 || patient { norm } else { near };
        if size(h[(first, first - 1)]) <= f64::EPSILON * near {
            h[(first, first - 1)] = T::zero();
            break;
        }
        first -= 1;
    }
    first
}

/// Splits the block of two of H that begins in this row.
type Split<T> = fn(&mut DMatrix<T>, &mut DMatrix<T>, usize);

/// Steps on the last block, between rows `first` and `last` (the next two arguments) of H and V,
/// until it falls apart; the last argument is whether the shift is exceptional. Blocks of two are
/// left to `split`, if there is one. `size`: of an entry. Returns false without convergence.
fn deflated<T: ComplexField + Copy>(
    h: &mut DMatrix<T>,
    v: &mut DMatrix<T>,
    size: impl Fn(T) -> f64,
    split: Option<Split<T>>,
    step: impl Fn(&mut DMatrix<T>, &mut DMatrix<T>, usize, usize, bool),
) -> bool {
    let norm = h.iter().map(|&z| size(z)).fold(0.0, f64::max);
    let (mut end, mut iteration) = (h.nrows(), 0);
    while end > 0 {
        let last = end - 1;
        let first = block_start(h, last, &size, norm, iteration > PATIENT);
        match split {
            Some(split) if first + 1 == last => split(h, v, first),
            _ if first == last => {}
            _ => {
                iteration += 1;
                if iteration > MOST {
                    return false;
                }
                step(h, v, first, last, iteration % EXCEPTIONAL == 0);
                continue;
            }
        }
        (end, iteration) = (first, 0);
    }
    true
}

/// Reduces H ← QᴴHQ to upper triangular form and V ← VQ, with single Wilkinson shifts. Returns
/// false if it does not converge.
pub fn complex(h: &mut DMatrix<c64>, v: &mut DMatrix<c64>) -> bool {
    let size = |z: c64| z.re.abs() + z.im.abs();
    deflated(h, v, size, None, |h, v, first, last, exceptional| {
        let shift = if exceptional {
            h[(last, last)] + c64::new(0.75 * size(h[(last, last - 1)]), 0.0)
        } else {
            wilkinson(h, last)
        };
        step(h, v, first, last, shift);
    })
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

/// Rotates rows k and k + 1, in these columns, by the Givens rotation of (c, s).
fn turn_rows<T: ComplexField + Copy>(
    m: &mut DMatrix<T>,
    k: usize,
    columns: Range<usize>,
    (c, s): (T, T),
) {
    for j in columns {
        let (x, y) = (m[(k, j)], m[(k + 1, j)]);
        m[(k, j)] = c.conjugate() * x + s.conjugate() * y;
        m[(k + 1, j)] = c * y - s * x;
    }
}

/// Rotates columns k and k + 1, in the first `rows` rows, by the inverse of that.
fn turn_columns<T: ComplexField + Copy>(m: &mut DMatrix<T>, k: usize, rows: usize, (c, s): (T, T)) {
    for i in 0..rows {
        let (x, y) = (m[(i, k)], m[(i, k + 1)]);
        m[(i, k)] = x * c + y * s;
        m[(i, k + 1)] = y * c.conjugate() - x * s.conjugate();
    }
}

/// One QR step with Givens rotations on rows and columns `first` to `last`.
fn step(h: &mut DMatrix<c64>, v: &mut DMatrix<c64>, first: usize, last: usize, shift: c64) {
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
        turn_rows(h, k, k..n, (c, s));
        rotations.push((c, s));
    }
    for (k, rotation) in (first..last).zip(rotations) {
        turn_columns(h, k, (k + 2).min(last) + 1, rotation);
        turn_columns(v, k, n, rotation);
    }
    (first..=last).for_each(|i| h[(i, i)] += shift);
}

/// Reduces H ← QᵀHQ to upper triangular form except for 2 × 2 blocks of conjugate pairs, and V ←
/// VQ, by Francis' double shift (Golub & Van Loan 2013, section 7.5). Returns false if it does not
/// converge.
pub fn real(h: &mut DMatrix<f64>, v: &mut DMatrix<f64>) -> bool {
    deflated(h, v, f64::abs, Some(split), double_step)
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
    let (n, rotation) = (h.nrows(), (z / length, c / length));
    turn_rows(h, at, at..n, rotation);
    turn_columns(h, at, at + 2, rotation);
    turn_columns(v, at, n, rotation);
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
        let Some((axis, scale)) = reflector(&x) else {
            continue;
        };
        for j in k.saturating_sub(1).max(first)..n {
            let along: f64 = (0..count).map(|i| axis[i] * h[(k + i, j)]).sum();
            (0..count).for_each(|i| h[(k + i, j)] -= scale * axis[i] * along);
        }
        let turn = |m: &mut DMatrix<f64>, rows: usize| {
            for row in 0..rows {
                let along: f64 = (0..count).map(|i| axis[i] * m[(row, k + i)]).sum();
                (0..count).for_each(|i| m[(row, k + i)] -= scale * axis[i] * along);
            }
        };
        turn(h, (k + 3).min(last) + 1);
        turn(v, n);
        if k > first {
            (1..count).for_each(|i| h[(k + i, k - 1)] = 0.0);
        }
    }
}

/// u and 2/uᵀu of the reflection that maps x to the first axis; `None` if x is zero.
fn reflector(x: &[f64; 3]) -> Option<([f64; 3], f64)> {
    let largest = x.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    if largest == 0.0 {
        return None;
    }
    let mut u = x.map(|x| x / largest);
    let length = u.iter().map(|x| x * x).sum::<f64>().sqrt();
    u[0] += length.copysign(u[0]);
    let square: f64 = u.iter().map(|x| x * x).sum();
    Some((u, 2.0 / square))
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
            assert!(real(&mut t, &mut q));
            let error = (&q * &t * q.transpose() - &b).norm();
            assert!(error < 1e-13 * b.norm().max(1e-300), "{error:e}");
            assert!((q.transpose() * &q - DMatrix::identity(n, n)).norm() < 1e-13);
            for i in 1..n {
                assert!((0..i - 1).all(|j| t[(i, j)] == 0.0));
                assert!(i < 2 || t[(i, i - 1)] == 0.0 || t[(i - 1, i - 2)] == 0.0);
            }

            let wide = b.map(|x| c64::new(x, 0.3 * x.abs()));
            let (mut q, mut t) = Hessenberg::new(wide.clone()).unpack();
            assert!(complex(&mut t, &mut q));
            let error = (&q * &t * q.adjoint() - &wide).norm();
            assert!(error < 1e-13 * wide.norm().max(1e-300), "{error:e}");
            (1..n).for_each(|i| assert_eq!(t[(i, i - 1)].norm(), 0.0));
        }
    }
}
