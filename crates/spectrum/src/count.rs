//! Counts the eigenvalues in a rectangle by the winding number of the determinant, without
//! computing them.

use faer::{Par, c64};

use crate::lu::Lu;
use crate::problem::Problem;
use crate::symbolic::Symbolic;

/// Greatest step of the phase (radians) that is accepted, if both of its halves and the slopes at
/// its ends and middle agree. Without the slopes a step of several turns could pass as a small one.
const STEP: f64 = std::f64::consts::FRAC_PI_4;
/// Slopes are finite differences over this share of a piece.
const SLOPE: f64 = 1.0 / 1024.0;
/// Number of pieces that each side is first cut into.
const PIECES: usize = 4;
/// Greatest number of halvings of a piece.
const HALVINGS: usize = 40;

/// A rectangle in the complex plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rectangle {
    /// Least and greatest real part.
    pub re: [f64; 2],
    /// Least and greatest imaginary part.
    pub im: [f64; 2],
}

impl Rectangle {
    /// Returns whether `z` lies inside the rectangle, its edges excluded.
    pub fn contains(&self, z: c64) -> bool {
        let ([left, right], [lower, upper]) = (self.re, self.im);
        left < z.re && z.re < right && lower < z.im && z.im < upper
    }

    fn corners(&self) -> [c64; 4] {
        let ([a, b], [c, d]) = (self.re, self.im);
        [[a, c], [b, c], [b, d], [a, d]].map(|[re, im]| c64::new(re, im))
    }
}

/// Number of eigenvalues in a rectangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Winding {
    /// Number of eigenvalues, with multiplicity.
    pub eigenvalues: i64,
    /// Number of factorisations it took.
    pub factorisations: usize,
}

/// Counting failed: an eigenvalue lies on the contour, or the phase cannot be followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uncounted {
    /// Point of the contour where it failed.
    pub at: c64,
}

/// Counts the eigenvalues of A in a rectangle as the winding number of det(A - zI) along its edges
/// (argument principle).
///
/// The phase of det(A - zI) turns by π when the contour passes close to an eigenvalue, and by nπ
/// along the whole spectrum. Therefore the phase of det(A - zI) / Π (λ - z) over the `known`
/// eigenvalues is followed, which hardly turns unless an unknown eigenvalue is near, and the number
/// of known eigenvalues inside is added. Wrong known eigenvalues do not change the count; they only
/// make the phase turn more.
///
/// # Errors
/// [`Uncounted`] if an eigenvalue lies on the contour or the phase cannot be followed.
pub fn winding(
    problem: &Problem,
    symbolic: &Symbolic,
    rectangle: Rectangle,
    known: &[c64],
    par: Par,
) -> Result<Winding, Uncounted> {
    let mut contour = Contour {
        problem,
        symbolic,
        known,
        par,
        factorisations: 0,
    };
    let corners = rectangle.corners();
    let mut turned = 0.0;
    let first = contour.point(corners[0])?;
    let mut from = first;
    for side in 0..4 {
        let [start, end] = [corners[side], corners[(side + 1) % 4]];
        for piece in 1..=PIECES {
            let z = start + (end - start) * (piece as f64 / PIECES as f64);
            let closed = side == 3 && piece == PIECES;
            let to = if closed {
                ContourPoint { z, ..first }
            } else {
                contour.point(z)?
            };
            turned += contour.turn(from, to, HALVINGS)?;
            from = to;
        }
    }
    let missing = (turned / std::f64::consts::TAU).round() as i64;
    let inside = known.iter().filter(|&&z| rectangle.contains(z)).count() as i64;
    Ok(Winding {
        eigenvalues: inside + missing,
        factorisations: contour.factorisations,
    })
}

/// A point of the contour.
#[derive(Clone, Copy)]
struct ContourPoint {
    z: c64,
    /// Of det(A - zI) / Π (λ - z), of length 1.
    phase: c64,
}

impl ContourPoint {
    /// Angle by which the phase turns to another one.
    fn angle_to(&self, phase: c64) -> f64 {
        (phase * self.phase.conj()).arg()
    }
}

struct Contour<'a> {
    problem: &'a Problem,
    symbolic: &'a Symbolic,
    known: &'a [c64],
    par: Par,
    factorisations: usize,
}

impl Contour<'_> {
    /// Phase of det(A - zI) / Π (λ - z).
    fn phase(&mut self, z: c64) -> Result<c64, Uncounted> {
        self.factorisations += 1;
        let lu = Lu::new(self.symbolic, self.problem.matrix().val(), z, self.par)
            .map_err(|_| Uncounted { at: z })?;
        let mut phase = lu.phase();
        for known in self.known {
            let away = known - z;
            phase *= away.conj() / away.norm();
        }
        if !phase.is_finite() {
            return Err(Uncounted { at: z });
        }
        Ok(phase / phase.norm())
    }

    fn point(&mut self, z: c64) -> Result<ContourPoint, Uncounted> {
        let phase = self.phase(z)?;
        Ok(ContourPoint { z, phase })
    }

    /// Angle by which the phase turns from one point to the next.
    fn turn(
        &mut self,
        from: ContourPoint,
        to: ContourPoint,
        halvings: usize,
    ) -> Result<f64, Uncounted> {
        let z = 0.5 * (from.z + to.z);
        if halvings == 0 {
            return Err(Uncounted { at: z });
        }
        let middle = self.point(z)?;
        let halves = [from.angle_to(middle.phase), middle.angle_to(to.phase)];
        if halves.iter().all(|half| half.abs() < 0.5 * STEP) {
            let ahead = (to.z - from.z) * SLOPE;
            let is_even = self.is_even(from, ahead)?
                && self.is_even(middle, ahead)?
                && self.is_even(to, -ahead)?;
            if is_even {
                return Ok(halves[0] + halves[1]);
            }
        }
        Ok(self.turn(from, middle, halvings - 1)? + self.turn(middle, to, halvings - 1)?)
    }

    /// Whether the phase turns slowly at a point, by the difference over a short way.
    fn is_even(&mut self, point: ContourPoint, ahead: c64) -> Result<bool, Uncounted> {
        let phase = self.phase(point.z + ahead)?;
        Ok(point.angle_to(phase).abs() < STEP * SLOPE)
    }
}
