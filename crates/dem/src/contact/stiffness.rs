//! Derivatives of a law's elastic forces, from which the stiffness matrix K is assembled.
//!
//! Dampers do not contribute. A contact at a limit is assumed to keep sliding, or rolling, at it.
//! If it moves back it sticks, with another derivative; only the smoothed law `mindlin` has the
//! same on both sides.

/// Fraction of a limit from which a contact counts as being at it. Less than 1, because its force
/// was cut to μF_n of a step in which F_n was slightly different.
pub const AT_LIMIT: f64 = 1.0 - 1e-6;

/// The elastic forces of a contact of grains i and j and their derivatives.
///
/// Tangential vectors have the components of the law's history: one along t̂ = ẑ × n in two
/// dimensions, three of a vector in the tangent plane in three. The rotation of the history with n
/// is not included. Units: N and N/m (per unit depth in 2D).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Derivatives {
    /// F_n.
    pub normal: f64,
    /// dF_n/dδ.
    pub normal_slope: f64,
    /// F_t on i.
    pub tangential: [f64; 3],
    /// ∂F_t/∂δ without slip.
    pub tangential_slope: [f64; 3],
    /// -∂F_t/∂(slip) along [`Derivatives::direction`].
    pub along: f64,
    /// -∂F_t/∂(slip) perpendicular to it; not used in two dimensions.
    pub across: f64,
    /// Unit vector along F_t.
    pub direction: [f64; 3],
    /// -∂M/∂(θ_i - θ_j) of the rolling torque M on i (N m; N in 2D).
    pub rolling: f64,
    /// ∂M/∂δ.
    pub rolling_slope: f64,
    /// F_t is at its limit.
    pub sliding: bool,
}

/// The springs of a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpringState {
    /// R_i, R_j (m).
    pub radii: [f64; 2],
    /// δ > 0 (m).
    pub overlap: f64,
    /// As in [`crate::state::ContactState`].
    pub history: [f64; 3],
    /// Whether it is at the limit of friction and at that of rolling, as the step found with F_n of
    /// spring and damper; `None`: by the elastic F_n, as in equilibrium.
    pub limits: [Option<bool>; 2],
}

/// A law that has derivatives.
pub trait Stiffness: Sync {
    /// The derivatives at this state.
    fn derivatives(&self, state: &SpringState) -> Derivatives;
}

impl Derivatives {
    /// Adds those of F_t: the spring's force `trial` of stiffness k_t, cut to μF_n. F_n must be
    /// set. What `slides` by a step was cut there, to the limit that the damper left.
    pub(crate) fn limited(
        mut self,
        trial: [f64; 3],
        k_t: f64,
        friction: f64,
        slides: Option<bool>,
    ) -> Self {
        let length = norm(trial);
        let limit = friction * self.normal;
        self.direction = unit(trial, length);
        self.sliding = slides.unwrap_or(length >= AT_LIMIT * limit);
        if self.sliding {
            let limit = if slides.is_some() { length } else { limit };
            self.tangential = self.direction.map(|t| limit * t);
            self.across = if length > 0.0 {
                k_t * limit / length
            } else {
                k_t
            };
            // Without a force there is no direction in which it could grow.
            let slope = if length > 0.0 {
                friction * self.normal_slope
            } else {
                0.0
            };
            self.tangential_slope = self.direction.map(|t| slope * t);
        } else {
            self.tangential = trial;
            (self.along, self.across) = (k_t, k_t);
        }
        self
    }

    /// Adds those of the rolling torque: the spring's torque `trial` of stiffness k_r, cut to `arm`
    /// F_n with arm = μ_r R_r (m). F_n must be set.
    pub(crate) fn rolling(mut self, trial: f64, k_r: f64, arm: f64, rolls: Option<bool>) -> Self {
        if rolls.unwrap_or(trial.abs() >= AT_LIMIT * arm * self.normal) {
            let slope = if trial == 0.0 {
                0.0
            } else {
                arm * self.normal_slope
            };
            self.rolling_slope = slope.copysign(trial);
        } else {
            self.rolling = k_r;
        }
        self
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
            let spring = spring.limited([trial, 0.0, 0.0], k_t, friction, slides);
            spring.rolling(0.2 * trial, k_r, arm, rolls)
        };
        for trial in [0.9, 1.1] {
            let slid = at(trial, Some(true), Some(true));
            assert!(slid.sliding);
            assert_eq!((slid.along, slid.rolling), (0.0, 0.0));
            assert_eq!(slid.tangential_slope, [friction * 4.0, 0.0, 0.0]);
            assert_eq!(slid.rolling_slope, arm * 4.0);
            let stuck = at(trial, Some(false), Some(false));
            assert!(!stuck.sliding);
            assert_eq!((stuck.along, stuck.rolling), (k_t, k_r));
            assert_eq!(stuck.tangential, [trial, 0.0, 0.0]);
            assert_eq!(at(trial, None, None).sliding, trial > 1.0);
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
            let spring = spring.limited(trial, 3.0, 0.5, slides);
            spring.rolling(trial[0], 7.0, 0.1, slides)
        };
        for size in [2f64.powi(-10), 2f64.powi(-460)] {
            let found = at([0.0, size, 0.0], Some(true));
            assert_eq!((found.along, found.across), (0.0, 3.0));
            assert_eq!(found.tangential, [0.0, size, 0.0]);
            assert_eq!(found.tangential_slope, [0.0, 2.0, 0.0]);
        }
        // No direction, no sign.
        for nothing in [0.0, -0.0] {
            let found = at([nothing; 3], Some(true));
            assert_eq!((found.along, found.across), (0.0, 3.0));
            assert_eq!(found.tangential_slope, [0.0; 3]);
            assert_eq!(found.rolling_slope, 0.0);
        }
        // At rest the limit of the spring cuts.
        assert_eq!(at([4.0, 0.0, 0.0], None).across, 0.75);
    }
}
