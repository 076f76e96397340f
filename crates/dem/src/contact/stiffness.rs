//! What a law's elastic forces become when a contact moves a little: the derivatives of which the matrix K is made.
//!
//! Dampers are left out. A contact at a limit is taken to go on sliding, or rolling, at it: were it to stick again, as it does when it is
//! moved back, its derivative would be another one. The smoothed law alone has but one there.

/// Part of a limit from which on a contact counts as being at it: its force was cut to μF_n of a step in which F_n was a little different.
pub const AT_LIMIT: f64 = 1.0 - 1e-6;

/// A contact of grains i and j and its derivatives. Tangential vectors are as the law remembers them: one component along t̂ = ẑ × n in two
/// dimensions, those of a vector in the tangent plane in three; that they turn with n is none of the law's business. Units: N and N/m
/// (per unit depth in 2D).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Derivatives {
    /// F_n and dF_n/dδ.
    pub normal: f64,
    pub normal_slope: f64,
    /// F_t on i, and ∂F_t/∂δ without slip.
    pub tangential: [f64; 3],
    pub tangential_slope: [f64; 3],
    /// -∂F_t/∂(slip) along [`Derivatives::direction`] and across it; across means nothing in two dimensions.
    pub along: f64,
    pub across: f64,
    /// Unit vector.
    pub direction: [f64; 3],
    /// Of the rolling torque on i: -∂M/∂(θ_i - θ_j) (N m; N in 2D), and ∂M/∂δ.
    pub rolling: f64,
    pub rolling_slope: f64,
    /// F_t is at its limit.
    pub sliding: bool,
}

/// A law that has derivatives.
pub trait Stiffness: Sync {
    /// Of two grains of radii R_i, R_j (m) at the overlap δ > 0 (m), with what [`crate::state::ContactState`] says that they remember.
    fn derivatives(&self, radii: [f64; 2], overlap: f64, history: [f64; 3]) -> Derivatives;
}

impl Derivatives {
    /// Those of F_t, the spring's force `trial` of stiffness k_t cut to μF_n; F_n is there.
    pub(crate) fn limited(mut self, trial: [f64; 3], k_t: f64, friction: f64) -> Self {
        let length = norm(trial);
        let limit = friction * self.normal;
        self.direction = unit(trial, length);
        self.sliding = length >= AT_LIMIT * limit;
        if self.sliding {
            self.tangential = self.direction.map(|t| limit * t);
            self.tangential_slope = self.direction.map(|t| friction * self.normal_slope * t);
            self.across = k_t * limit / length.max(f64::MIN_POSITIVE);
        } else {
            self.tangential = trial;
            (self.along, self.across) = (k_t, k_t);
        }
        self
    }

    /// Those of the rolling torque, the spring's `trial` of stiffness k_r cut to `arm` F_n, arm = μ_r R_r (m).
    pub(crate) fn rolling(mut self, trial: f64, k_r: f64, arm: f64) -> Self {
        if trial.abs() >= AT_LIMIT * arm * self.normal {
            self.rolling_slope = (arm * self.normal_slope).copysign(trial);
        } else {
            self.rolling = k_r;
        }
        self
    }
}

pub(crate) fn norm(v: [f64; 3]) -> f64 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

/// v over its length, any unit vector where there is none.
pub(crate) fn unit(v: [f64; 3], length: f64) -> [f64; 3] {
    if length > 0.0 {
        v.map(|v| v / length)
    } else {
        [1.0, 0.0, 0.0]
    }
}
