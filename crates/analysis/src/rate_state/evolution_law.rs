//! The rate-and-state law with the aging (Dieterich) or slip (Ruina) evolution of θ.

/// Evolution law of θ.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Evolution {
    /// dθ/dt = 1 - Vθ/D_c.
    Aging,
    /// dθ/dt = -(Vθ/D_c) ln(Vθ/D_c).
    Slip,
}

impl Evolution {
    /// Returns the name in options and tables.
    pub fn name(self) -> &'static str {
        match self {
            Evolution::Aging => "aging",
            Evolution::Slip => "slip",
        }
    }
}

/// Rate-and-state law μ = μ* + a ln(V/V*) + b ln(V*θ/D_c).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RateStateLaw {
    /// Evolution of θ.
    pub evolution: Evolution,
    /// μ*: friction of steady sliding at V*.
    pub mu_star: f64,
    /// a, the direct effect.
    pub a: f64,
    /// b, the evolution effect.
    pub b: f64,
    /// D_c (m).
    pub d_c: f64,
    /// V* (m/s), an arbitrary reference velocity; only μ* depends on its choice.
    pub v_star: f64,
}

/// Velocity and state as logarithms, which stay moderate while V and θ vary over many decades.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogState {
    /// ln(V/V*).
    pub ln_v: f64,
    /// ln(V*θ/D_c).
    pub ln_theta: f64,
}

impl RateStateLaw {
    /// Returns μ of a state.
    pub fn friction(&self, state: LogState) -> f64 {
        self.mu_star + self.a * state.ln_v + self.b * state.ln_theta
    }

    /// Returns V (m/s).
    pub fn velocity(&self, state: LogState) -> f64 {
        self.v_star * state.ln_v.exp()
    }

    /// Returns θ (s).
    pub(crate) fn theta(&self, state: LogState) -> f64 {
        self.d_c / self.v_star * state.ln_theta.exp()
    }

    /// Returns the state of steady sliding at V > 0 (m/s): θ = D_c/V.
    pub fn steady(&self, velocity: f64) -> LogState {
        let ln_v = (velocity / self.v_star).ln();
        LogState {
            ln_v,
            ln_theta: -ln_v,
        }
    }

    /// Returns d ln θ/dt (1/s).
    pub(crate) fn evolution_rate(&self, state: LogState) -> f64 {
        let slipping = self.velocity(state) / self.d_c;
        match self.evolution {
            Evolution::Aging => 1.0 / self.theta(state) - slipping,
            Evolution::Slip => -slipping * (state.ln_v + state.ln_theta),
        }
    }

    /// Returns the derivatives of [`Self::evolution_rate`] by ln V and ln θ (1/s).
    pub(crate) fn evolution_gradient(&self, state: LogState) -> [f64; 2] {
        let slipping = self.velocity(state) / self.d_c;
        match self.evolution {
            Evolution::Aging => [-slipping, -1.0 / self.theta(state)],
            Evolution::Slip => [-slipping * (state.ln_v + state.ln_theta + 1.0), -slipping],
        }
    }

    /// Returns k̄_c = (b - a)/D_c (1/m). Without inertia, steady sliding on a softer spring is
    /// unstable (Ruina 1983).
    pub fn critical_stiffness(&self) -> f64 {
        (self.b - self.a) / self.d_c
    }
}
