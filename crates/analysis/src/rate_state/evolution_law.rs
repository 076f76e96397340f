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

    /// Returns ln(V*θ/D_c) at each of `times` (s), starting from steady sliding, if ln(V/V*) is
    /// `ln_v` at these times and V constant in the interval before each: closed forms of both laws.
    /// `v_star` in m/s, `d_c` in m.
    pub(super) fn states_in_motion(
        self,
        times: &[f64],
        ln_v: &[f64],
        v_star: f64,
        d_c: f64,
    ) -> Vec<f64> {
        let mut states = Vec::with_capacity(times.len());
        let mut state = -ln_v[0];
        for (k, (time, ln_v)) in times.iter().zip(ln_v).enumerate() {
            let duration = if k == 0 { 0.0 } else { time - times[k - 1] };
            let slip = v_star * ln_v.exp() * duration / d_c;
            let left = (-slip).exp();
            state = match self {
                Evolution::Aging => {
                    let ageing = if slip > 0.0 {
                        -(-slip).exp_m1() / slip * v_star * duration / d_c
                    } else {
                        v_star * duration / d_c
                    };
                    (state.exp() * left + ageing).ln()
                }
                Evolution::Slip => (state + ln_v) * left - ln_v,
            };
            states.push(state);
        }
        states
    }
}

/// A state variable θ beside the first: its evolution effect and the slip over which it evolves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StateVariable {
    /// b, the evolution effect.
    pub b: f64,
    /// D_c (m).
    pub d_c: f64,
}

/// Rate-and-state law μ = μ* + a ln(V/V*) + b ln(V*θ/D_c), with a second such term b_2
/// ln(V*θ_2/D_c2) if there are two state variables (Ruina 1983).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RateStateLaw {
    /// Evolution of θ, and of θ_2.
    pub evolution: Evolution,
    /// μ*: friction of steady sliding at V*.
    pub mu_star: f64,
    /// a, the direct effect.
    pub a: f64,
    /// b, the evolution effect.
    pub b: f64,
    /// D_c (m).
    pub d_c: f64,
    /// The second state variable.
    pub second: Option<StateVariable>,
    /// V* (m/s), an arbitrary reference velocity; only μ* depends on its choice.
    pub v_star: f64,
}

/// Velocity and states as logarithms, which stay moderate while V and θ vary over many decades.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogState {
    /// ln(V/V*).
    pub ln_v: f64,
    /// ln(V*θ/D_c).
    pub ln_theta: f64,
    /// ln(V*θ_2/D_c2); 0 of a law with one state variable.
    pub ln_second: f64,
}

impl RateStateLaw {
    /// Returns μ of a state.
    pub fn friction(&self, state: LogState) -> f64 {
        let second = self.second.map_or(0.0, |second| second.b * state.ln_second);
        self.mu_star + self.a * state.ln_v + self.b * state.ln_theta + second
    }

    /// Returns V (m/s).
    pub fn velocity(&self, state: LogState) -> f64 {
        self.v_star * state.ln_v.exp()
    }

    /// Returns the state of steady sliding at V > 0 (m/s): θ = D_c/V.
    pub fn steady(&self, velocity: f64) -> LogState {
        let ln_v = (velocity / self.v_star).ln();
        LogState {
            ln_v,
            ln_theta: -ln_v,
            ln_second: self.second.map_or(0.0, |_| -ln_v),
        }
    }

    /// Returns the first state variable.
    pub(crate) fn first(&self) -> StateVariable {
        StateVariable {
            b: self.b,
            d_c: self.d_c,
        }
    }

    /// Returns a - b, with b the sum of both state variables: dμ_ss/d ln V.
    pub fn rate_dependence(&self) -> f64 {
        self.a - self.b - self.second.map_or(0.0, |second| second.b)
    }

    /// Returns k̄_c = (b - a)/D_c (1/m) of a law with one state variable. Without inertia, steady
    /// sliding on a softer spring is unstable (Ruina 1983).
    pub fn critical_stiffness(&self) -> Option<f64> {
        let single = self.second.is_none();
        single.then(|| (self.b - self.a) / self.d_c)
    }

    /// Returns d ln θ/dt (1/s) of a state variable with this D_c (m), at ln(V/V*) and ln(V*θ/D_c).
    pub(crate) fn evolution_rate(&self, d_c: f64, ln_v: f64, ln_theta: f64) -> f64 {
        let slipping = self.v_star * ln_v.exp() / d_c;
        match self.evolution {
            Evolution::Aging => self.v_star / d_c * (-ln_theta).exp() - slipping,
            Evolution::Slip => -slipping * (ln_v + ln_theta),
        }
    }

    /// Returns the derivatives of [`Self::evolution_rate`] by ln V and ln θ (1/s).
    pub(crate) fn evolution_gradient(&self, d_c: f64, ln_v: f64, ln_theta: f64) -> [f64; 2] {
        let slipping = self.v_star * ln_v.exp() / d_c;
        match self.evolution {
            Evolution::Aging => [-slipping, -self.v_star / d_c * (-ln_theta).exp()],
            Evolution::Slip => [-slipping * (ln_v + ln_theta + 1.0), -slipping],
        }
    }
}

/// What predicts a record: a law, the spring and a trend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SliderModel {
    /// The law.
    pub law: RateStateLaw,
    /// k̄ (1/m), if it is not that of the record.
    pub stiffness: Option<f64>,
    /// Increase of μ per displacement of the drive since the start of the record (1/m), as wear and
    /// hardening give it; 0 is none.
    pub trend: f64,
}
