//! All eigenvalues in a rectangle, and thereby all complex pairs, without a dense matrix.

use faer::{Mat, Par, c64};

use crate::count::Rectangle;
use crate::eigenvalues::{Eigenvalue, Spectrum, Verdict};
use crate::problem::{Problem, ZERO};
use crate::shift_invert::{Failed, Request, nearest};
use crate::symbolic::Symbolic;

/// Grid points per radius of the smallest disk, on which coverage is decided.
const GRID: f64 = 12.0;
/// Greatest number of disks before the scan is given up.
const DISKS: usize = 100_000;

/// Result of a scan.
pub struct Scan {
    /// All eigenvalues of the rectangle and of its mirror image in the real axis.
    pub spectrum: Spectrum,
    /// Number of shifts used, one disk each.
    pub disks: usize,
    /// Number of solves, one per vector.
    pub solves: usize,
}

/// Returns a rectangle that holds all eigenvalues (Bendixson 1902): Re λ lies between the extreme
/// eigenvalues of (A + Aᵀ)/2, and |Im λ| is at most the largest of (A - Aᵀ)/2. Those are bounded by
/// Gershgorin's circles, so the rectangle is safe but seldom tight.
///
/// # Panics
/// If there is no memory for Aᵀ.
pub fn bendixson(problem: &Problem) -> Rectangle {
    let n = problem.size();
    let a = problem.matrix();
    let transposed = a.transpose().to_col_major();
    let transposed = transposed.expect("memory for the transpose");
    let mut diagonal = vec![0.0; n];
    let (mut symmetric, mut skew) = (vec![0.0; n], vec![0.0; n]);
    let mut column = vec![0.0; n];
    for j in 0..n {
        let rows = transposed.row_idx_of_col_raw(j);
        for (&i, value) in rows.iter().zip(transposed.val_of_col(j)) {
            column[i] = *value;
        }
        for (&i, value) in a.row_idx_of_col_raw(j).iter().zip(a.val_of_col(j)) {
            if i == j {
                diagonal[j] = *value;
            } else {
                symmetric[j] += 0.5 * (value + column[i]).abs();
                skew[j] += 0.5 * (value - column[i]).abs();
                column[i] = 0.0;
            }
        }
        for &i in rows {
            if i != j {
                symmetric[j] += 0.5 * column[i].abs();
                skew[j] += 0.5 * column[i].abs();
            }
            column[i] = 0.0;
        }
    }
    let low = (0..n).map(|j| diagonal[j] - symmetric[j]);
    let high = (0..n).map(|j| diagonal[j] + symmetric[j]);
    let height = skew.into_iter().fold(0.0, f64::max);
    Rectangle {
        re: [
            low.fold(f64::INFINITY, f64::min),
            high.fold(f64::NEG_INFINITY, f64::max),
        ],
        im: [-height, height],
    }
}

/// Returns all eigenvalues with a real part in `re` and an imaginary part within Bendixson's bound.
///
/// The upper half of the rectangle is covered by disks. Each shift is the lowest point that no disk
/// covers yet; its disk reaches as far as its `count` nearest eigenvalues, and an eigenvalue
/// belongs to the first disk that holds it. Disks are large where eigenvalues are sparse.
///
/// # Errors
/// [`Failed`] if a shift fails or 100,000 disks do not suffice.
pub fn scan(
    problem: &Problem,
    symbolic: &Symbolic,
    re: [f64; 2],
    count: usize,
    par: Par,
) -> Result<Scan, Failed> {
    let height = bendixson(problem).im[1];
    let mut cover = Cover {
        re,
        height,
        disks: Vec::new(),
        pitch: (re[1] - re[0]) / 50.0,
    };
    let nothing = Mat::<f64>::zeros(problem.size(), 0);
    let mut scan = Scan {
        spectrum: Spectrum::of(problem, &nothing, None),
        disks: 0,
        solves: 0,
    };
    while let Some(shift) = cover.uncovered() {
        if scan.disks == DISKS {
            return Err(Failed::Factors);
        }
        let request = Request {
            shift,
            count,
            left: true,
            par,
        };
        let near = nearest(problem, symbolic, request)?;
        let radius = near.radius(problem);
        let norm = problem.norm();
        let own = near.spectrum.arranged(
            |e| {
                let z = upper(e, norm);
                (z - near.shift).norm() < radius
                    && e.value.im >= -ZERO * norm
                    && re[0] <= z.re
                    && z.re <= re[1]
                    && !cover.holds(z)
            },
            |e| e.value.re,
        );
        let mirrored = own.mirrored(|e| e.value.im > ZERO * norm);
        scan.spectrum.append(own);
        scan.spectrum.append(mirrored);
        cover.add(near.shift, radius);
        scan.disks += 1;
        scan.solves += near.solves;
        if scan.spectrum.eigenvalues.len() + problem.null().ncols() == problem.size() {
            break;
        }
    }
    Ok(scan)
}

/// The eigenvalue, with the imaginary part removed if it counts as real.
fn upper(e: &Eigenvalue, norm: f64) -> c64 {
    if e.verdict == Verdict::Real || e.value.im.abs() <= ZERO * norm {
        c64::new(e.value.re, 0.0)
    } else {
        e.value
    }
}

/// Disks over the upper half of a rectangle.
struct Cover {
    re: [f64; 2],
    height: f64,
    disks: Vec<Disk>,
    /// Distance of grid points.
    pitch: f64,
}

#[derive(Clone, Copy)]
struct Disk {
    centre: c64,
    radius: f64,
}

impl Cover {
    /// Adds a disk. Refines the grid until the disk covers the cell of its own centre; otherwise
    /// the same shift would be chosen again.
    fn add(&mut self, centre: c64, radius: f64) {
        while radius > 0.0 && self.half_diagonal() > 0.5 * radius {
            self.pitch *= 0.5;
        }
        if radius.is_finite() {
            self.pitch = self.pitch.min(radius / GRID);
        }
        self.disks.push(Disk { centre, radius });
    }

    fn holds(&self, z: c64) -> bool {
        let mut disks = self.disks.iter();
        disks.any(|disk| (z - disk.centre).norm() < disk.radius)
    }

    /// Distance from a grid point to the corner of its cell.
    fn half_diagonal(&self) -> f64 {
        self.pitch * std::f64::consts::FRAC_1_SQRT_2
    }

    /// The first disk that covers the cell of a grid point.
    fn covering(&self, z: c64) -> Option<Disk> {
        let half_diagonal = self.half_diagonal();
        let mut disks = self.disks.iter();
        let first = disks.find(|disk| (z - disk.centre).norm() + half_diagonal < disk.radius);
        first.copied()
    }

    /// The lowest grid point, leftmost among equals, whose cell is not wholly inside a disk.
    fn uncovered(&self) -> Option<c64> {
        let half_diagonal = self.half_diagonal();
        let mut y = 0.0;
        while y <= self.height + self.pitch {
            let mut x = self.re[0];
            while x <= self.re[1] + self.pitch {
                match self.covering(c64::new(x, y)) {
                    None if self.disks.is_empty() || y > 0.0 => return Some(c64::new(x, y)),
                    // On the real axis the shift may lie further on, since its disk reaches to both
                    // sides.
                    None => {
                        let radii = self.disks.iter().map(|disk| disk.radius);
                        let ahead = radii.rev().find(|r| r.is_finite()).unwrap_or(0.0);
                        return Some(c64::new((x + 0.7 * ahead).min(self.re[1].max(x)), 0.0));
                    }
                    // Continue where this disk ends at this height.
                    Some(Disk { centre, radius }) => {
                        let half =
                            ((radius - half_diagonal).powi(2) - (y - centre.im).powi(2)).sqrt();
                        let cells = ((centre.re + half - x) / self.pitch).floor().max(1.0);
                        x += cells * self.pitch;
                    }
                }
            }
            y += self.pitch;
        }
        None
    }
}
