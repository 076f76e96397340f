//! A spring slider that obeys the rate-and-state law: the forward model of the fits.

use differential_equations::ode::solve_ode;
use differential_equations::prelude::*;

use super::drive_segment::DriveSegment;
use super::evolution_law::{LogState as Friction, RateStateLaw, StateVariable};

/// A slider without inertia on a spring: dμ/dt = k̄ (V_drive - V), with V from the law.
///
/// With ψ = ln(V*θ/D_c) the balance is a d(ln V)/dt = k̄ (V_drive - V) - Σ b dψ/dt, which makes two
/// equations for ln V and ψ, and a third one for a second state variable. They are stiff because V
/// responds over a slip of a/k̄, far less than D_c.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RateStateSlider {
    /// The law.
    pub law: RateStateLaw,
    /// k̄: stiffness of the spring over the normal force (1/m).
    pub stiffness: f64,
    /// Relative and absolute tolerance of a step in ln V and ln θ.
    pub tolerance: f64,
}

/// Default tolerance of a step.
pub(crate) const TOLERANCE: f64 = 1e-9;
/// Limit of |ln(V/V*)| and |ln(V*θ/D_c)|; beyond it the integration has failed, since exp soon
/// leaves the range of f64.
const LARGEST_LOGARITHM: f64 = 300.0;

impl RateStateSlider {
    /// Creates a slider with the default tolerance; `stiffness` is k̄ (1/m).
    pub fn new(law: RateStateLaw, stiffness: f64) -> Self {
        RateStateSlider {
            law,
            stiffness,
            tolerance: TOLERANCE,
        }
    }

    /// Returns the states at `times` (s, ascending, since the start of the drive), starting from
    /// `start`.
    ///
    /// The drive runs through its segments; the last one lasts to the last of `times`. The
    /// integrator is Radau IIA of order 5 (Hairer & Wanner 1996), restarted at each segment because
    /// V_drive jumps there.
    ///
    /// # Errors
    /// If the integration fails, for example because the slider runs away on a spring that is too
    /// soft. The message names the time.
    pub fn motion(
        &self,
        drive: &[DriveSegment],
        start: Friction,
        times: &[f64],
    ) -> Result<Vec<Friction>, String> {
        let mut states = Vec::with_capacity(times.len());
        let mut now = start;
        let mut begin = 0.0;
        for (k, segment) in drive.iter().enumerate() {
            let wanted = &times[states.len()..];
            let last = k + 1 == drive.len();
            let (duration, within) = if last {
                let end = wanted.last().map_or(0.0, |time| time - begin);
                (end, wanted.len())
            } else {
                let end = begin + segment.duration;
                (
                    segment.duration,
                    wanted.partition_point(|time| *time <= end),
                )
            };
            let local: Vec<f64> = wanted[..within].iter().map(|time| time - begin).collect();
            if duration > 0.0 {
                now = self
                    .segment(segment.velocity, duration, now, &local, &mut states)
                    .map_err(|(time, why)| format!("at {:.6e} s: {why}", begin + time))?;
            } else {
                states.extend(local.iter().map(|_| now));
            }
            begin += segment.duration;
        }
        Ok(states)
    }

    /// Integrates one segment; appends the states at `times` (since its start) and returns the last
    /// state.
    fn segment(
        &self,
        drive: f64,
        duration: f64,
        start: Friction,
        times: &[f64],
        states: &mut Vec<Friction>,
    ) -> Result<Friction, (f64, String)> {
        let Friction {
            ln_v,
            ln_theta,
            ln_second,
        } = start;
        let first = self.law.first();
        match self.law.second {
            None => {
                let system = Driven {
                    slider: self,
                    states: [first],
                    drive,
                };
                system.integrated([ln_v, ln_theta], duration, times, states)
            }
            Some(second) => {
                let system = Driven {
                    slider: self,
                    states: [first, second],
                    drive,
                };
                system.integrated([ln_v, ln_theta, ln_second], duration, times, states)
            }
        }
    }
}

/// Tolerance of Newton's iteration as RADAU5 sets it (Hairer & Wanner), which works with 0.1
/// tolerance^(2/3). The crate's default suits a tolerance of 1e-6 only.
fn newton_tolerance(tolerance: f64) -> f64 {
    let inner = 0.1 * tolerance.powf(2.0 / 3.0);
    inner.sqrt().min(0.03).max(10.0 * f64::EPSILON / inner)
}

impl Friction {
    fn of(y: &[f64]) -> Self {
        Friction {
            ln_v: y[0],
            ln_theta: y[1],
            ln_second: y.get(2).copied().unwrap_or(0.0),
        }
    }

    /// Whether the logarithms are within range; false for NaN.
    fn is_moderate(self) -> bool {
        let all = [self.ln_v, self.ln_theta, self.ln_second];
        all.iter().all(|value| value.abs() < LARGEST_LOGARITHM)
    }
}

/// The equations of a slider with S state variables.
struct Driven<'a, const S: usize> {
    slider: &'a RateStateSlider,
    states: [StateVariable; S],
    /// V_drive (m/s).
    drive: f64,
}

impl<const S: usize> Driven<'_, S> {
    /// A step (s) within which the slider cannot follow the drive yet: a hundredth of the slip a/k̄
    /// at the faster of both. The crate's own guess is 0 on stiff springs.
    fn first_step(&self, ln_v: f64, duration: f64) -> f64 {
        let RateStateSlider { law, stiffness, .. } = self.slider;
        let fastest = (law.v_star * ln_v.exp()).max(self.drive);
        let step = 0.01 * law.a / (stiffness * fastest);
        step.clamp(f64::EPSILON * duration, duration)
    }

    /// Integrates N = S + 1 equations; as [`RateStateSlider::segment`].
    fn integrated<const N: usize>(
        &self,
        start: [f64; N],
        duration: f64,
        times: &[f64],
        states: &mut Vec<Friction>,
    ) -> Result<Friction, (f64, String)> {
        let tolerance = self.slider.tolerance;
        let mut method = ImplicitRungeKutta::radau5()
            .rtol(tolerance)
            .atol(tolerance)
            .newton_tol(newton_tolerance(tolerance))
            .h0(self.first_step(start[0], duration));
        let mut output = OutputTimes {
            times,
            states,
            now: Friction::of(&start),
        };
        let solved = solve_ode(&mut method, self, 0.0, duration, &start, &mut output);
        let missing = output.times.len();
        match solved {
            Ok(_) if missing == 0 && output.now.is_moderate() => Ok(output.now),
            Ok(_) => Err((
                duration,
                "the slider runs away: the spring is too soft for the law".into(),
            )),
            Err(error) => Err((0.0, format!("the integration failed: {error:?}"))),
        }
    }
}

impl<const S: usize, const N: usize> ODE<f64, [f64; N]> for Driven<'_, S> {
    fn diff(&self, _time: f64, y: &[f64; N], rate: &mut [f64; N]) {
        let RateStateSlider { law, stiffness, .. } = self.slider;
        let mut evolution = 0.0;
        for (k, state) in self.states.iter().enumerate() {
            rate[k + 1] = law.evolution_rate(state.d_c, y[0], y[k + 1]);
            evolution += state.b * rate[k + 1];
        }
        rate[0] = (stiffness * (self.drive - law.v_star * y[0].exp()) - evolution) / law.a;
    }

    fn jacobian(&self, _time: f64, y: &[f64; N], j: &mut Matrix<f64>) {
        let RateStateSlider { law, stiffness, .. } = self.slider;
        let mut evolution = 0.0;
        for (k, state) in self.states.iter().enumerate() {
            let [by_v, by_theta] = law.evolution_gradient(state.d_c, y[0], y[k + 1]);
            for other in 1..N {
                j[(k + 1, other)] = 0.0;
            }
            j[(k + 1, 0)] = by_v;
            j[(k + 1, k + 1)] = by_theta;
            j[(0, k + 1)] = -state.b * by_theta / law.a;
            evolution += state.b * by_v;
        }
        j[(0, 0)] = (-stiffness * law.v_star * y[0].exp() - evolution) / law.a;
    }
}

/// Collects the states at the requested times, and the last state. The end of the last step may
/// miss the last time by rounding.
struct OutputTimes<'a> {
    /// Times still to come.
    times: &'a [f64],
    states: &'a mut Vec<Friction>,
    now: Friction,
}

impl<const N: usize> Solout<f64, [f64; N]> for OutputTimes<'_> {
    fn solout<I>(
        &mut self,
        time: f64,
        before: f64,
        y: &[f64; N],
        _y_before: &[f64; N],
        interpolator: &mut I,
        _solution: &mut Solution<f64, [f64; N]>,
    ) -> ControlFlag<f64, [f64; N]>
    where
        I: Interpolation<f64, [f64; N]> + ?Sized,
    {
        self.now = Friction::of(y);
        let reached = time * (1.0 + 1e-12);
        while let Some((&wanted, rest)) = self.times.split_first()
            && wanted <= reached
        {
            // At the start there is no step yet to interpolate.
            let state = if wanted >= time || time == before {
                self.now
            } else {
                match interpolator.interpolate(wanted.max(before)) {
                    Ok(y) => Friction::of(&y),
                    Err(_) => return ControlFlag::Terminate,
                }
            };
            self.states.push(state);
            self.times = rest;
        }
        if self.now.is_moderate() {
            ControlFlag::Continue
        } else {
            ControlFlag::Terminate
        }
    }
}
