//! The contribution of one contact to K.
//!
//! With dr = dr_i - dr_j, ds = R_i dθ_i + R_j dθ_j and the forces of `kernel` and `contact`:
//!
//! ```text
//! dδ = -n·dr,  dn = (1 - nn) dr/|r|,  slip = (1 - nn) dr + n × ds
//! dF = F_n' dδ n + F_n dn + dF_t
//! dF_t = ∂F_t/∂δ dδ + ∂F_t/∂slip slip - n (F_t·dn) + ½ n·(dθ_i + dθ_j) n × F_t
//! dT_i = -R_i (dn × F_t + n × dF_t) + dM,  dT_j = -R_j (dn × F_t + n × dF_t) - dM
//! ```
//!
//! The last terms of dF_t are the rotation of the history with n, and about n. In two dimensions the
//! third component of a vector is zero, and rotations have only that component.

use super::History;
use gshear_dem::contact::stiffness::{Derivatives, SpringState, Stiffness};
use gshear_dem::dimension::Dimension;

type Vector = [f64; 3];
type Matrix = [Vector; 3];

/// A contact with positive overlap and the derivatives of its force.
pub struct LinearContact {
    radii: [f64; 2],
    /// Unit normal, from j to i.
    n: Vector,
    distance: f64,
    derivatives: Derivatives,
}

impl LinearContact {
    /// Evaluates the derivatives of the law at this contact of unit normal n.
    pub fn new<D: Dimension>(
        law: &dyn Stiffness,
        n: Vector,
        distance: f64,
        mut springs: SpringState,
    ) -> Self {
        if D::SPINS == 3 {
            // The force routine does the same: rounding has left a small component along n.
            let along = dot(springs.history, n);
            (0..3).for_each(|k| springs.history[k] -= along * n[k]);
        }
        let mut derivatives = law.derivatives(&springs);
        if D::SPINS == 1 {
            let across = [-n[1], n[0], 0.0];
            let vector = |of: Vector| across.map(|t| of[0] * t);
            derivatives = Derivatives {
                tangential: vector(derivatives.tangential),
                tangential_slope: vector(derivatives.tangential_slope),
                direction: across,
                across: 0.0,
                ..derivatives
            };
        }
        Self {
            radii: springs.radii,
            n,
            distance,
            derivatives,
        }
    }

    /// Returns whether the contact is at the limit of friction.
    pub fn slides(&self) -> bool {
        self.derivatives.sliding
    }

    /// Returns the blocks that the contact adds to K.
    pub fn stiffness<D: Dimension>(&self, history: History) -> Stiffnesses {
        let (n, d) = (self.n, &self.derivatives);
        let unit = |a: usize, b: usize| f64::from(u8::from(a == b));
        let plane = matrix(|a, b| unit(a, b) - n[a] * n[b]);
        let slip = matrix(|a, b| {
            let along = d.direction[a] * d.direction[b];
            -(d.across * (unit(a, b) - along) + d.along * along)
        });
        let turned = match history {
            History::Turned => 1.0,
            History::Unturned => 0.0,
        };
        let by_slip = product(&slip, &plane);
        let friction_by_r = matrix(|a, b| {
            by_slip[a][b]
                - d.tangential_slope[a] * n[b]
                - turned / self.distance * n[a] * d.tangential[b]
        });
        let friction_by_s = product(&slip, &cross(n));
        let force_by_r = matrix(|a, b| {
            friction_by_r[a][b] - d.normal_slope * n[a] * n[b]
                + d.normal / self.distance * plane[a][b]
        });
        let across = product(&cross(n), &matrix(|a, _| d.tangential[a]));
        let friction_by_twist = matrix(|a, b| 0.5 * turned * across[a][0] * n[b]);
        // n × dF_t + dn × F_t.
        let turn = product(&cross(d.tangential), &plane);
        let moved = product(&cross(n), &friction_by_r);
        Stiffnesses {
            unknowns: if D::SPINS == 1 {
                &[0, 1, 5]
            } else {
                &[0, 1, 2, 3, 4, 5]
            },
            radii: self.radii,
            force_by_r,
            force_by_s: friction_by_s,
            moment_by_r: matrix(|a, b| moved[a][b] - turn[a][b] / self.distance),
            moment_by_s: product(&cross(n), &friction_by_s),
            force_by_twist: friction_by_twist,
            moment_by_twist: product(&cross(n), &friction_by_twist),
            rolling: d.rolling,
            rolling_by_r: n.map(|n| -d.rolling_slope * n),
        }
    }
}

/// Derivatives of the force and torque of a contact, from which [`Self::entry`] makes the four
/// blocks of K.
pub struct Stiffnesses {
    /// Indices of a grain's unknowns among x, y, z, θ_x, θ_y, θ_z.
    unknowns: &'static [usize],
    radii: [f64; 2],
    /// ∂F/∂r.
    force_by_r: Matrix,
    /// ∂F/∂s.
    force_by_s: Matrix,
    /// ∂(n × F_t)/∂r.
    moment_by_r: Matrix,
    /// ∂(n × F_t)/∂s.
    moment_by_s: Matrix,
    /// ∂F/∂θ and ∂(n × F_t)/∂θ of either grain by the rotation about n.
    force_by_twist: Matrix,
    moment_by_twist: Matrix,
    /// k_r, the rolling stiffness.
    rolling: f64,
    /// ∂M/∂r of the rolling torque.
    rolling_by_r: Vector,
}

impl Stiffnesses {
    /// Returns -∂F̃/∂q for component `row` of the force on grain `a` and unknown `column` of grain
    /// `b`, where 0 is i and 1 is j.
    pub fn entry(&self, [a, b]: [usize; 2], [row, column]: [usize; 2]) -> f64 {
        let (row, column) = (self.unknowns[row], self.unknowns[column]);
        let sign = |g: usize| if g == 0 { 1.0 } else { -1.0 };
        let (f, q) = (row % 3, column % 3);
        match (row < 3, column < 3) {
            (true, true) => -sign(a) * sign(b) * self.force_by_r[f][q],
            (true, false) => {
                -sign(a) * (self.radii[b] * self.force_by_s[f][q] + self.force_by_twist[f][q])
            }
            (false, true) => {
                let rolls = if f == 2 { self.rolling_by_r[q] } else { 0.0 };
                sign(b) * (self.radii[a] * self.moment_by_r[f][q] - sign(a) * rolls)
            }
            (false, false) => {
                let rolls = if f == 2 && q == 2 { self.rolling } else { 0.0 };
                let turned = self.radii[b] * self.moment_by_s[f][q] + self.moment_by_twist[f][q];
                self.radii[a] * turned + sign(a) * sign(b) * rolls
            }
        }
    }
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn matrix(of: impl Fn(usize, usize) -> f64) -> Matrix {
    std::array::from_fn(|a| std::array::from_fn(|b| of(a, b)))
}

/// The matrix of v ×.
fn cross([x, y, z]: Vector) -> Matrix {
    [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
}

fn product(left: &Matrix, right: &Matrix) -> Matrix {
    matrix(|a, b| (0..3).map(|k| left[a][k] * right[k][b]).sum())
}
