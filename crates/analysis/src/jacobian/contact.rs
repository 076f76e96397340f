//! The contribution of one contact to K.
//!
//! With dr = dr_i - dr_j, ds = R_i dθ_i + R_j dθ_j and the forces of `kernel` and `contact`:
//!
//! ```text
//! dδ = -n·dr,  dn = (1 - nn) dr/|r|,  slip = (1 - nn) dr + n × ds
//! dF = F_n' dδ n + F_n dn + dF_t
//! dF_t = ∂F_t/∂δ dδ + ∂F_t/∂slip slip - n (F_t·dn) + ½ n·(dθ_i + dθ_j) n × F_t
//! dT_i = -R_i (dn × F_t + n × dF_t) + dM,  dT_j = -R_j (dn × F_t + n × dF_t) - dM
//! M = M_r + T n
//! dM_r = ∂M_r/∂δ dδ + ∂M_r/∂θ (1 - nn)(dθ_i - dθ_j) - n (M_r·dn) + ½ n·(dθ_i + dθ_j) n × M_r
//! dT = ∂T/∂δ dδ + ∂T/∂θ n·(dθ_i - dθ_j)
//! ```
//!
//! The last terms of dF_t and dM_r are the rotation of the history with n, and about n. In two
//! dimensions the third component of a vector is zero, and rotations have only that component.

use nalgebra::{Matrix3, Vector3};

use super::{Forces, History};
use gshear_dem::contact::stiffness::{Derivatives, SpringForce, SpringState, Stiffness};
use gshear_dem::dimension::Dimension;

type Vector = Vector3<f64>;
type Matrix = Matrix3<f64>;

/// The normal of a contact.
pub(crate) struct TurningNormal {
    /// Unit normal, from j to i.
    pub n: Vector,
    /// |r|, at which n turns with r.
    pub distance: f64,
}

/// A contact with positive overlap and the derivatives of its force.
pub(crate) struct LinearContact {
    radii: [f64; 2],
    /// Unit normal, from j to i.
    n: Vector,
    /// |r|, at which n turns with r.
    distance: f64,
    derivatives: Derivatives,
}

impl LinearContact {
    /// Evaluates these derivatives of the law at this contact; `None` if it is `idle` and nothing
    /// acts.
    pub fn new<D: Dimension>(
        law: &dyn Stiffness,
        forces: Forces,
        normal: TurningNormal,
        mut springs: SpringState,
        idle: bool,
    ) -> Option<Self> {
        let TurningNormal { n, distance } = normal;
        if D::SPINS == 3 {
            // The force routine does the same: rounding has left a small component along n.
            let [x, y, z, twist] = springs.torques;
            springs.history = projected(springs.history, n);
            let [x, y, z] = projected([x, y, z], n);
            springs.torques = [x, y, z, twist];
        }
        let mut derivatives = match (forces, idle) {
            (Forces::Elastic, true) => law.idle_derivatives(&springs)?,
            (Forces::Elastic, false) => law.derivatives(&springs),
            (Forces::Damping, true) => return None,
            (Forces::Damping, false) => law.dampers(&springs),
        };
        if D::SPINS == 1 {
            derivatives.tangential = along(derivatives.tangential, [-n[1], n[0], 0.0]);
            derivatives.rolling = along(derivatives.rolling, [0.0, 0.0, 1.0]);
        }
        Some(Self {
            radii: springs.radii,
            n,
            distance,
            derivatives,
        })
    }

    /// Returns whether the contact is at the limit of friction.
    pub fn slides(&self) -> bool {
        self.derivatives.tangential.at_limit
    }

    /// Returns the blocks that the contact adds to K.
    pub fn stiffness<D: Dimension>(&self, history: History) -> Stiffnesses {
        let (n, d) = (self.n, &self.derivatives);
        let (cross, normal) = (n.cross_matrix(), n.transpose());
        let plane = Matrix::identity() - n * normal;
        let turned = match history {
            History::Turned => 1.0,
            History::Unturned => 0.0,
        };
        let friction = self.linear(&d.tangential, turned);
        let friction_by_r = friction.way + friction.r;
        let friction_by_s = friction.way * cross;
        // n × dF_t + dn × F_t.
        let turn = Vector::from(d.tangential.value).cross_matrix() * plane;
        let (rolling, twisting) = (self.linear(&d.rolling, turned), &d.twisting);
        let (twist, twist_slope) = (twisting.value[0], twisting.slope[0]);
        Stiffnesses {
            unknowns: if D::SPINS == 1 {
                &[0, 1, 5]
            } else {
                &[0, 1, 2, 3, 4, 5]
            },
            radii: self.radii,
            force_by_r: friction_by_r - d.normal_slope * n * normal
                + d.normal / self.distance * plane,
            force_by_s: friction_by_s,
            moment_by_r: cross * friction_by_r - turn / self.distance,
            moment_by_s: cross * friction_by_s,
            moment_by_twist: cross * friction.twist,
            force_by_twist: friction.twist,
            torque_by_r: rolling.r - twist_slope * n * normal + twist / self.distance * plane,
            torque_by_turn: rolling.way - twisting.along * n * normal,
            torque_by_twist: rolling.twist,
        }
    }

    /// The derivatives of a force or torque in the tangent plane; `turned`: 1 where it turns with
    /// the pair, else 0.
    fn linear(&self, force: &SpringForce, turned: f64) -> Linear {
        let (n, normal) = (self.n, self.n.transpose());
        let [value, slope, direction] =
            [force.value, force.slope, force.direction].map(Vector::from);
        let along = direction * direction.transpose();
        let way = -(force.across * (Matrix::identity() - along) + force.along * along);
        Linear {
            r: -slope * normal - turned / self.distance * n * value.transpose(),
            way: way * (Matrix::identity() - n * normal),
            twist: 0.5 * turned * (n.cross_matrix() * value) * normal,
        }
    }
}

/// Derivatives of a force in the tangent plane: by r where its way is none, by its way, and by
/// either grain's rotation about n.
struct Linear {
    r: Matrix,
    way: Matrix,
    twist: Matrix,
}

/// A vector without its component along n.
fn projected(vector: [f64; 3], n: Vector) -> [f64; 3] {
    let vector = Vector::from(vector);
    (vector - n * vector.dot(&n)).into()
}

/// A force of one component as a vector along a unit vector; across it there is no stiffness.
fn along(force: SpringForce, direction: [f64; 3]) -> SpringForce {
    SpringForce {
        value: direction.map(|t| force.value[0] * t),
        slope: direction.map(|t| force.slope[0] * t),
        direction,
        across: 0.0,
        ..force
    }
}

/// Derivatives of the force and torque of a contact, from which [`PairBlock`] makes the four blocks
/// of K.
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
    /// ∂M/∂r, ∂M/∂(θ_i - θ_j) and ∂M/∂θ of either grain by the rotation about n.
    torque_by_r: Matrix,
    torque_by_turn: Matrix,
    torque_by_twist: Matrix,
}

impl Stiffnesses {
    /// The block of the force on grain `a` by the unknowns of grain `b`, where 0 is i and 1 is j.
    pub fn pair(&self, a: usize, b: usize) -> PairBlock<'_> {
        const SIGNS: [f64; 2] = [1.0, -1.0];
        PairBlock {
            stiffnesses: self,
            signs: [SIGNS[a], SIGNS[b]],
            radii: [self.radii[a], self.radii[b]],
        }
    }
}

/// A block of K.
pub struct PairBlock<'a> {
    stiffnesses: &'a Stiffnesses,
    /// 1 of i, -1 of j: of the grain of the rows and of that of the columns.
    signs: [f64; 2],
    radii: [f64; 2],
}

impl PairBlock<'_> {
    /// Returns -∂F̃/∂q for a component of the force and an unknown.
    pub fn entry(&self, row: usize, column: usize) -> f64 {
        let derivatives = self.stiffnesses;
        let (row, column) = (derivatives.unknowns[row], derivatives.unknowns[column]);
        let (sign_a, sign_b) = (self.signs[0], self.signs[1]);
        let (radius_a, radius_b) = (self.radii[0], self.radii[1]);
        let at = (row % 3, column % 3);
        match (row < 3, column < 3) {
            (true, true) => -sign_a * sign_b * derivatives.force_by_r[at],
            (true, false) => {
                -sign_a * (radius_b * derivatives.force_by_s[at] + derivatives.force_by_twist[at])
            }
            (false, true) => {
                let torque = sign_a * derivatives.torque_by_r[at];
                sign_b * (radius_a * derivatives.moment_by_r[at] - torque)
            }
            (false, false) => {
                let friction =
                    radius_b * derivatives.moment_by_s[at] + derivatives.moment_by_twist[at];
                let torque =
                    sign_b * derivatives.torque_by_turn[at] + derivatives.torque_by_twist[at];
                radius_a * friction - sign_a * torque
            }
        }
    }
}
