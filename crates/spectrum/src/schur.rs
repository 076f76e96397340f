//! Schur form of a small matrix with sorted eigenvalues.

use faer::c64;
use nalgebra::{DMatrix, DVector};

use crate::qr_iteration;
use crate::scalar::Scalar;

/// B = Q T Qᴴ with T upper triangular, except for 2 × 2 blocks of conjugate pairs if B is real.
pub(crate) struct Schur<T: Scalar> {
    /// Schur vectors.
    pub(crate) q: DMatrix<T>,
    /// Schur form.
    pub(crate) t: DMatrix<T>,
    /// Diagonal blocks of T, from first to last.
    pub(crate) blocks: Vec<Block>,
}

/// A diagonal block of T.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Block {
    /// First row and column.
    pub(crate) start: usize,
    /// 1 or 2.
    pub(crate) size: usize,
    /// Eigenvalues of the block; equal if `size` is 1. In a block of 2 the second one is the
    /// conjugate of the first, or another real one if the pair is about to merge on the real axis.
    pub(crate) values: [c64; 2],
}

impl Block {
    /// The row after it.
    pub(crate) fn end(&self) -> usize {
        self.start + self.size
    }

    /// The greater one of its eigenvalues.
    fn rank(&self, rank: impl Fn(c64) -> f64) -> f64 {
        rank(self.values[0]).max(rank(self.values[1]))
    }
}

impl<T: Scalar> Schur<T> {
    /// Computes the Schur form with eigenvalues of greater `rank` first. `None` if `b` is not
    /// finite or the QR iteration does not converge.
    pub(crate) fn ordered(b: DMatrix<T>, rank: impl Fn(c64) -> f64) -> Option<Self> {
        if !b.iter().all(|value| value.widened().is_finite()) {
            return None;
        }
        // nalgebra's reflections square the entries; those that underflow would become NaN.
        let least = 1e-40 * b.norm();
        let b = b.map(|value| {
            let size = value.widened().norm();
            if size < least { T::of(0.0) } else { value }
        });
        let (q, t) = match b.nrows() {
            1 => (DMatrix::identity(1, 1), b),
            _ => nalgebra::linalg::Hessenberg::new(b).unpack(),
        };
        let mut schur = Schur {
            q,
            t,
            blocks: Vec::new(),
        };
        if !qr_iteration::triangularise(&mut schur.t, &mut schur.q) {
            return None;
        }
        schur.find_blocks();
        // Insertion by swaps of neighbours is stable: equal eigenvalues keep their order.
        for last in 1..schur.blocks.len() {
            let mut at = last;
            while at > 0 && schur.blocks[at].rank(&rank) > schur.blocks[at - 1].rank(&rank) {
                if !schur.swap(at - 1) {
                    break;
                }
                at -= 1;
            }
        }
        Some(schur)
    }

    fn find_blocks(&mut self) {
        let n = self.t.nrows();
        let mut start = 0;
        self.blocks.clear();
        while start < n {
            let coupled = T::IS_REAL && start + 1 < n && self.t[(start + 1, start)] != T::of(0.0);
            let size = if coupled { 2 } else { 1 };
            self.blocks.push(self.block(start, size));
            start += size;
        }
    }

    fn block(&self, start: usize, size: usize) -> Block {
        let values = if size == 1 {
            [self.t[(start, start)].widened(); 2]
        } else {
            eigenvalues_of_two(|i, j| self.t[(start + i, start + j)].real())
        };
        Block {
            start,
            size,
            values,
        }
    }

    /// Swaps block `at` with the next one (Bai & Demmel 1993). Returns false if their eigenvalues
    /// are too close to be separated.
    fn swap(&mut self, at: usize) -> bool {
        let (p, q) = (self.blocks[at].size, self.blocks[at + 1].size);
        let (start, count) = (self.blocks[at].start, p + q);
        let window = self.t.view((start, start), (count, count)).clone_owned();
        // With T₁₁ X - X T₂₂ = T₁₂ the columns of (-X, I) span the invariant subspace of T₂₂.
        let mut system = DMatrix::<T>::zeros(p * q, p * q);
        let mut right = DVector::<T>::zeros(p * q);
        for j in 0..q {
            for i in 0..p {
                right[j * p + i] = window[(i, p + j)];
                (0..p).for_each(|l| system[(j * p + i, j * p + l)] += window[(i, l)]);
                (0..q).for_each(|l| system[(j * p + i, l * p + i)] -= window[(p + l, p + j)]);
            }
        }
        let Some(x) = system.full_piv_lu().solve(&right) else {
            return false;
        };
        let mut frame = DMatrix::<T>::zeros(count, count);
        for j in 0..q {
            (0..p).for_each(|i| frame[(i, j)] = -x[j * p + i]);
            frame[(p + j, j)] = T::of(1.0);
        }
        (0..p).for_each(|i| frame[(i, q + i)] = T::of(1.0));
        let turn = frame.qr().q();
        let swapped = turn.adjoint() * &window * &turn;
        let left_over = swapped.view((q, 0), (p, q)).norm();
        if !left_over.is_finite() || left_over > 1e-14 * (1.0 + window.norm()) * 100.0 {
            return false;
        }

        let n = self.t.nrows();
        let rows = turn.adjoint() * self.t.view((start, start), (count, n - start));
        let mut turned = self.t.view_mut((start, start), (count, n - start));
        turned.copy_from(&rows);
        let columns = self.t.view((0, start), (start + count, count)) * &turn;
        let mut turned = self.t.view_mut((0, start), (start + count, count));
        turned.copy_from(&columns);
        let basis = self.q.view((0, start), (n, count)) * &turn;
        self.q.view_mut((0, start), (n, count)).copy_from(&basis);
        self.t.view_mut((start + q, start), (p, q)).fill(T::of(0.0));
        self.blocks[at] = self.block(start, q);
        self.blocks[at + 1] = self.block(start + q, p);
        true
    }
}

/// Eigenvalues of a real 2 × 2 matrix of these entries.
fn eigenvalues_of_two(entry: impl Fn(usize, usize) -> f64) -> [c64; 2] {
    let (a, b, c, d) = (entry(0, 0), entry(0, 1), entry(1, 0), entry(1, 1));
    let (mean, half) = (0.5 * (a + d), 0.5 * (a - d));
    let square = half * half + b * c;
    let root = square.abs().sqrt();
    if square < 0.0 {
        [c64::new(mean, root), c64::new(mean, -root)]
    } else {
        [c64::new(mean + root, 0.0), c64::new(mean - root, 0.0)]
    }
}
