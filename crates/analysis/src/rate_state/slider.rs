//! A slider without inertia on a spring: the forward model of the fits.

use differential_equations::prelude::*;

use super::law::{Law, State as Friction};
use super::protocol::Segment;

/// dμ/dt = k̄ (V_drive - V), where V follows from the law.
///
/// With ψ = ln(V*θ/D_c) this is a ln V = k̄ (V_drive - V) - b ψ under the dots of time: two equations for ln V and ψ,
/// stiff since a/k̄, over which V answers, is far below D_c.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slider {
    pub law: Law,
    /// k̄: stiffness of the spring over the normal force (1/m).
    pub stiffness: f64,
    /// Of one step, relative and absolute in ln V and ln θ.
    pub tolerance: f64,
}

/// Tolerance of a step where nothing else is asked for.
pub const TOLERANCE: f64 = 1e-9;
/// Beyond these |ln(V/V*)| and |ln(V*θ/D_c)| a motion has failed: exp would leave the range of f64 soon.
const LARGEST_LOGARITHM: f64 = 300.0;

impl Slider {
    pub fn new(law: Law, stiffness: f64) -> Self {
        Slider {
            law,
            stiffness,
            tolerance: TOLERANCE,
        }
    }

    /// The states at `times` (s, ascending, since the start of the drive), from `start` on.
    ///
    /// The drive goes through its segments one after the other; the last one lasts as long as there are times. Integrated by
    /// Radau IIA of order 5 (Hairer & Wanner 1996), segment by segment, since V_drive jumps between them.
    /// Errors: the integration failed, as where the slider runs away on a spring that is too soft. Says at which time.
    pub fn motion(
        &self,
        drive: &[Segment],
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

    /// One segment; adds the states at `times` since its start and returns the last state.
    fn segment(
        &self,
        drive: f64,
        duration: f64,
        start: Friction,
        times: &[f64],
        states: &mut Vec<Friction>,
    ) -> Result<Friction, (f64, String)> {
        let system = Driven {
            slider: self,
            drive,
        };
        let mut method = ImplicitRungeKutta::radau5()
            .rtol(self.tolerance)
            .atol(self.tolerance)
            .newton_tol(newton_tolerance(self.tolerance));
        let mut output = Output {
            times,
            states,
            now: start,
        };
        let y = [start.ln_v, start.ln_theta];
        let solved = differential_equations::ode::solve_ode(
            &mut method,
            &system,
            0.0,
            duration,
            &y,
            &mut output,
        );
        let missing = output.times.len();
        match solved {
            Ok(_) if missing == 0 && output.now.is_moderate() => Ok(output.now),
            Ok(_) => Err((duration, "the slider runs away".into())),
            Err(error) => Err((0.0, format!("the integration failed: {error:?}"))),
        }
    }
}

/// How far Newton's iteration goes, as RADAU5 sets it (Hairer & Wanner): the tolerance it works with is 0.1 tolerance^(2/3). What the
/// crate takes without being told belongs to a tolerance of 1e-6.
fn newton_tolerance(tolerance: f64) -> f64 {
    let inner = 0.1 * tolerance.powf(2.0 / 3.0);
    inner.sqrt().min(0.03).max(10.0 * f64::EPSILON / inner)
}

impl Friction {
    fn of(y: &[f64; 2]) -> Self {
        Friction {
            ln_v: y[0],
            ln_theta: y[1],
        }
    }

    fn is_moderate(self) -> bool {
        // NaN is not moderate.
        self.ln_v.abs() < LARGEST_LOGARITHM && self.ln_theta.abs() < LARGEST_LOGARITHM
    }
}

struct Driven<'a> {
    slider: &'a Slider,
    /// V_drive (m/s).
    drive: f64,
}

impl ODE<f64, [f64; 2]> for Driven<'_> {
    fn diff(&self, _time: f64, y: &[f64; 2], rate: &mut [f64; 2]) {
        let Slider { law, stiffness, .. } = self.slider;
        let state = Friction::of(y);
        rate[1] = law.evolution_rate(state);
        rate[0] = (stiffness * (self.drive - law.velocity(state)) - law.b * rate[1]) / law.a;
    }

    fn jacobian(&self, _time: f64, y: &[f64; 2], j: &mut Matrix<f64>) {
        let Slider { law, stiffness, .. } = self.slider;
        let state = Friction::of(y);
        let [by_v, by_theta] = law.evolution_gradient(state);
        j[(1, 0)] = by_v;
        j[(1, 1)] = by_theta;
        j[(0, 0)] = (-stiffness * law.velocity(state) - law.b * by_v) / law.a;
        j[(0, 1)] = -law.b * by_theta / law.a;
    }
}

/// Takes the states at the times asked for, and the last one. The end of the last step may miss the last time by rounding.
struct Output<'a> {
    /// Still to come.
    times: &'a [f64],
    states: &'a mut Vec<Friction>,
    now: Friction,
}

impl Solout<f64, [f64; 2]> for Output<'_> {
    fn solout<I>(
        &mut self,
        time: f64,
        before: f64,
        y: &[f64; 2],
        _y_before: &[f64; 2],
        interpolator: &mut I,
        _solution: &mut Solution<f64, [f64; 2]>,
    ) -> ControlFlag<f64, [f64; 2]>
    where
        I: Interpolation<f64, [f64; 2]> + ?Sized,
    {
        self.now = Friction::of(y);
        let reached = time * (1.0 + 1e-12);
        while let Some((&wanted, rest)) = self.times.split_first()
            && wanted <= reached
        {
            // At the start nothing has been integrated that could be interpolated.
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
