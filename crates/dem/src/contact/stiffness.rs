//! Derivatives of a law's forces: of the elastic ones by places, from which the stiffness matrix K
//! is assembled, and of those of dampers by velocities, for the damping matrix C.
//!
//! Dampers do not contribute to K. A contact at a limit is assumed to keep sliding, or rolling, at
//! it. If it moves back it sticks, with another derivative; only the smoothed law `mindlin` has the
//! same on both sides.

use super::TORQUES;
use super::friction::Coefficient;

/// Fraction of a limit from which a contact counts as being at it. Less than 1, because its force
/// was cut to μF_n of a step in which F_n was slightly different.
pub(crate) const AT_LIMIT: f64 = 1.0 - 1e-6;

/// The elastic forces of a contact of grains i and j and their derivatives (per unit depth in 2D).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Derivatives {
    /// F_n (N).
    pub normal: f64,
    /// dF_n/dδ (N/m).
    pub normal_slope: f64,
    /// F_t on i, by the slip (N, N/m).
    pub tangential: SpringForce,
    /// The rolling torque on i, by θ_i - θ_j (N m; N in 2D).
    pub rolling: SpringForce,
    /// The component along n of the torque on i, by that of θ_i - θ_j (N m); in three dimensions.
    pub twisting: SpringForce,
}

/// A force or torque of a spring that is cut to a limit, and its derivatives.
///
/// In two dimensions and for twisting it has one component, the first: along t̂ = ẑ × n, about z,
/// along n. Otherwise it is a vector in the tangent plane; its rotation with the pair is not
/// included.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SpringForce {
    /// The force.
    pub value: [f64; 3],
    /// Its derivative by δ, where nothing else moves.
    pub slope: [f64; 3],
    /// Minus its derivative by the way along [`SpringForce::direction`].
    pub along: f64,
    /// Minus that perpendicular to it.
    pub across: f64,
    /// Unit vector along the force.
    pub direction: [f64; 3],
    /// It is at its limit.
    pub at_limit: bool,
}

/// The springs of a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpringState {
    /// Of i and j.
    pub materials: [u64; 2],
    /// R_i, R_j (m).
    pub radii: [f64; 2],
    /// δ (m), greater than minus [`Stiffness::gap`].
    pub overlap: f64,
    /// As in [`crate::state::ContactState`].
    pub history: [f64; 3],
    /// As in [`crate::state::ContactState`].
    pub torques: [f64; TORQUES],
    /// As in [`crate::state::ContactState`].
    pub age: f64,
    /// Whether it is at the limit of friction, at that of rolling and at that of twisting, as the
    /// step found with F_n of spring and damper; `None`: by the elastic F_n, as in equilibrium.
    pub limits: [Option<bool>; 3],
}

/// A law that has derivatives.
pub trait Stiffness: Sync {
    /// The derivatives at this state.
    fn derivatives(&self, state: &SpringState) -> Derivatives;

    /// Minus the derivatives of the forces by the velocities at this state, as
    /// [`Stiffness::derivatives`] has those by the places: those of F_n by dδ/dt, of F_t by dδ/dt
    /// and the velocity of the slip, of the torques by dδ/dt and the difference of the spins. Where
    /// a force is at its limit this is that of F_n with its damper. Values are 0. The contact is
    /// not idle.
    fn dampers(&self, state: &SpringState) -> Derivatives;

    /// Those of an idle contact, whose spring and damper leave no force; `None` if nothing else
    /// acts.
    fn idle_derivatives(&self, _state: &SpringState) -> Option<Derivatives> {
        None
    }

    /// The gap (m) at which a contact of two grains ends.
    fn gap(&self, _materials: [u64; 2], _radii: [f64; 2]) -> f64 {
        0.0
    }
}

impl Derivatives {
    /// A tangential spring `trial` of this stiffness under a friction that falls with the slip.
    /// F_n must be set.
    pub fn friction(
        &self,
        trial: [f64; 3],
        stiffness: f64,
        friction: Coefficient,
        slides: Option<bool>,
    ) -> SpringForce {
        let limit = self.limit(friction.value);
        let mut force = SpringForce::new(trial, stiffness, limit, slides);
        if force.at_limit {
            force.along -= friction.fall * self.normal;
        }
        force
    }

    /// The limit of a force of this coefficient. F_n must be set.
    pub fn limit(&self, coefficient: f64) -> Limit {
        Limit {
            value: coefficient * self.normal,
            slope: coefficient * self.normal_slope,
        }
    }
}

/// A limit of a spring's force, proportional to F_n.
#[derive(Debug, Clone, Copy)]
pub struct Limit {
    /// The limit (N or N m; per m in 2D).
    pub value: f64,
    /// Its derivative by δ.
    pub slope: f64,
}

impl SpringForce {
    /// The spring's force `trial` of this stiffness, cut to a limit of this slope. What is
    /// `at_limit` by a step was cut there, to the limit that the damper left.
    pub fn new(trial: [f64; 3], stiffness: f64, limit: Limit, at_limit: Option<bool>) -> Self {
        let length = norm(trial);
        let direction = unit(trial, length);
        if !at_limit.unwrap_or(length >= AT_LIMIT * limit.value) {
            return Self {
                value: trial,
                along: stiffness,
                across: stiffness,
                direction,
                ..Self::default()
            };
        }
        let size = if at_limit.is_some() {
            length
        } else {
            limit.value
        };
        // Without a force there is no direction in which it could grow.
        let [across, slope] = if length > 0.0 {
            [stiffness * size / length, limit.slope]
        } else {
            [stiffness, 0.0]
        };
        Self {
            value: direction.map(|t| size * t),
            slope: direction.map(|t| slope * t),
            along: 0.0,
            across,
            direction,
            at_limit: true,
        }
    }
}

/// A damper parallel to a spring under a limit.
#[derive(Debug, Clone, Copy)]
pub struct ParallelDamper {
    /// The part that is cut to the limit with the spring (kg/s; per m in 2D).
    pub cut: f64,
    /// The part that acts beside the limit.
    pub beside: f64,
    /// Minus the derivative of the limit by the velocity that separates the grains.
    pub of_limit: f64,
}

impl ParallelDamper {
    /// Minus the derivatives by the velocities beside a spring of this stiffness, whose force is
    /// `spring`.
    pub fn derivatives(&self, spring: &SpringForce, stiffness: f64) -> SpringForce {
        if !spring.at_limit {
            let all = self.cut + self.beside;
            return SpringForce {
                along: all,
                across: all,
                direction: spring.direction,
                ..SpringForce::default()
            };
        }
        SpringForce {
            slope: spring.direction.map(|t| self.of_limit * t),
            along: self.beside,
            across: self.cut * (spring.across / stiffness) + self.beside,
            direction: spring.direction,
            at_limit: true,
            ..SpringForce::default()
        }
    }
}

pub(crate) fn norm(v: [f64; 3]) -> f64 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

/// v/|v|, or any unit vector if |v| = 0.
pub(crate) fn unit(v: [f64; 3], length: f64) -> [f64; 3] {
    if length > 0.0 {
        v.map(|v| v / length)
    } else {
        [1.0, 0.0, 0.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A damper makes F_n and with it the limit of the step greater or less than those of the
    /// spring; what the step found decides, and only without it the spring.
    #[test]
    fn the_step_says_what_is_at_its_limit() {
        let (friction, k_t, arm, k_r) = (0.5, 3.0, 0.1, 7.0);
        let at = |trial: f64, slides, rolls| {
            let spring = Derivatives {
                normal: 2.0,
                normal_slope: 4.0,
                ..Derivatives::default()
            };
            let force = |trial, k, part, at_limit| {
                SpringForce::new([trial, 0.0, 0.0], k, spring.limit(part), at_limit)
            };
            let tangential = force(trial, k_t, friction, slides);
            (tangential, force(0.2 * trial, k_r, arm, rolls))
        };
        for trial in [0.9, 1.1] {
            let (slid, rolled) = at(trial, Some(true), Some(true));
            assert!(slid.at_limit && rolled.at_limit);
            assert_eq!((slid.along, rolled.along), (0.0, 0.0));
            assert_eq!(slid.slope, [friction * 4.0, 0.0, 0.0]);
            assert_eq!(rolled.slope, [arm * 4.0, 0.0, 0.0]);
            let (stuck, held) = at(trial, Some(false), Some(false));
            assert!(!stuck.at_limit);
            assert_eq!((stuck.along, held.along), (k_t, k_r));
            assert_eq!(stuck.value, [trial, 0.0, 0.0]);
            assert_eq!(at(trial, None, None).0.at_limit, trial > 1.0);
        }
    }

    /// A step has cut what slides to the limit that the damper left, however little: across its way
    /// it is as stiff as the spring.
    #[test]
    fn a_limit_near_zero_leaves_stiffnesses_of_the_spring() {
        let at = |trial: [f64; 3], slides| {
            let spring = Derivatives {
                normal: 2.0,
                normal_slope: 4.0,
                ..Derivatives::default()
            };
            SpringForce::new(trial, 3.0, spring.limit(0.5), slides)
        };
        for size in [2f64.powi(-10), 2f64.powi(-460)] {
            let found = at([0.0, size, 0.0], Some(true));
            assert_eq!((found.along, found.across), (0.0, 3.0));
            assert_eq!(found.value, [0.0, size, 0.0]);
            assert_eq!(found.slope, [0.0, 2.0, 0.0]);
        }
        // No direction, no sign.
        for nothing in [0.0, -0.0] {
            let found = at([nothing; 3], Some(true));
            assert_eq!((found.along, found.across), (0.0, 3.0));
            assert_eq!(found.slope, [0.0; 3]);
        }
        // At rest the limit of the spring cuts.
        assert_eq!(at([4.0, 0.0, 0.0], None).across, 0.75);
    }
}
