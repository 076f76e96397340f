//! Friction that grows with the age of a contact, with the laws `hooke` and `hertz`.
//!
//! ```text
//! μ(θ) = μ_s (1 + β ln(1 + θ/θ_0)),   dθ/dt = 1 - v_s θ/D
//! ```
//!
//! The age θ, in seconds, begins with the touch. v_s is the speed of the slip while the contact is
//! at the limit, and 0 while it sticks; without D the slip does not renew the contact, and the age
//! is the time since the touch. At a steady speed it becomes D/v_s. This is the law of Dieterich
//! (J. Geophys. Res. 84, 2161, 1979) with the state of Ruina (J. Geophys. Res. 88, 10359, 1983),
//! without the direct effect, for each contact, as Abe et al. have it in grains (Pure Appl.
//! Geophys. 159, 1967, 2002).
//!
//! Over a step, with x = v_s Δt/D,
//!
//! ```text
//! θ ← (θ + (1 + ½x) Δt)/(1 + x + ½x²)
//! ```
//!
//! of second order, positive, and exact at the steady age. The first step of a contact counts half.
//! Whether it slides in a step is decided with the friction that it has if it sticks.
//!
//! The elastic energy does not depend on θ. K takes a contact at its limit as one that slides on,
//! so its friction falls with the slip.

use super::keys::{AGEING, AGEING_SLIP, AGEING_TIME, KeyReader};
use crate::contact::friction::{Coefficient, Friction, SlipOfStep};
use crate::contact::portable_ln;
use crate::simd::{Lanes, Lanes16, ln};

/// How friction grows with the age of a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ageing {
    /// β, growth of μ over μ_s for a factor e of the age.
    pub growth: f64,
    /// θ_0 (s).
    pub time: f64,
    /// D (m), the slip that renews a contact; `None`: slip does not.
    pub slip: Option<f64>,
}

/// Reads how contacts age; by default they do not.
pub(super) fn read_ageing(values: &mut dyn KeyReader) -> Option<Ageing> {
    let growth = values.number(&AGEING).unwrap_or(0.0);
    if growth == 0.0 {
        let why = "says how contacts age, which they do with ageing (beta) greater than 0";
        values.useless(&AGEING_TIME, why);
        values.useless(&AGEING_SLIP, why);
        return None;
    }
    Some(Ageing {
        growth,
        time: values.required(&AGEING_TIME),
        slip: values.number(&AGEING_SLIP),
    })
}

/// A coefficient that grows with the age of a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aged {
    /// μ_s.
    friction: f64,
    /// β.
    growth: f64,
    /// 1/θ_0 (1/s).
    per_time: f64,
    /// 1/D (1/m); 0 if slip does not renew contacts.
    per_slip: f64,
}

impl Aged {
    /// That of contacts of this μ_s.
    pub fn new(friction: f64, ageing: &Ageing) -> Self {
        Self {
            friction,
            growth: ageing.growth,
            per_time: 1.0 / ageing.time,
            per_slip: ageing.slip.map_or(0.0, |slip| 1.0 / slip),
        }
    }

    /// μ of ages (s).
    #[inline(always)]
    fn coefficient<L: Lanes>(&self, token: L::Token, age: L) -> L {
        let ratio = L::splat(token, self.per_time).mul_add(age, L::splat(token, 1.0));
        let friction = L::splat(token, self.friction);
        L::splat(token, self.friction * self.growth).mul_add(ln(token, ratio), friction)
    }
}

/// Δt (s) of 1/Δt.
fn step_of(per_step: f64) -> f64 {
    if per_step > 0.0 { 1.0 / per_step } else { 0.0 }
}

impl Friction for Aged {
    const HISTORY: usize = 1;

    #[inline(always)]
    fn of_stuck<L: Lanes>(
        &self,
        token: L::Token,
        kept: &mut [Lanes16],
        touching: L::Mask,
        per_step: f64,
    ) -> L {
        let zero = L::splat(token, 0.0);
        let step = step_of(per_step);
        let before = L::load(token, &kept[0]);
        let grown = L::splat(token, step).select(before.greater(zero), L::splat(token, 0.5 * step));
        let age = (before + grown).select(touching, zero);
        age.store(&mut kept[0]);
        self.coefficient(token, age)
    }

    #[inline(always)]
    fn of_sliding<L: Lanes>(
        &self,
        token: L::Token,
        kept: &mut [Lanes16],
        slip: &SlipOfStep<L>,
        stuck: L,
    ) -> L {
        let one = L::splat(token, 1.0);
        let x = L::splat(token, self.per_slip) * slip.length(token);
        let half_step = L::splat(token, 0.5 * step_of(slip.per_step));
        let grown = L::load(token, &kept[0]);
        let renewed = half_step.mul_add(x, grown) / (L::splat(token, 0.5) * x).mul_add(x, one + x);
        let age = renewed.select(slip.sliding, grown);
        age.store(&mut kept[0]);
        self.coefficient(token, age).select(slip.sliding, stuck)
    }

    fn at_age(&self, age: f64) -> Coefficient {
        let ratio = 1.0 + self.per_time * age;
        let raised = self.friction * self.growth;
        Coefficient {
            value: self.friction + raised * portable_ln(ratio),
            fall: raised * self.per_time * age * self.per_slip / ratio,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Portable, PortableToken};

    const AGEING: Ageing = Ageing {
        growth: 0.1,
        time: 2e-3,
        slip: Some(1e-5),
    };
    const FRICTION: f64 = 0.4;

    /// μ and the age after steps of Δt (s), each with this slip (m); `None`: the contact sticks.
    fn after(ageing: &Ageing, mut age: f64, step: f64, slips: &[Option<f64>]) -> [f64; 2] {
        let friction = Aged::new(FRICTION, ageing);
        let first = |of: Portable| of.to_lanes16().0[0];
        let c = |x| Portable::splat(PortableToken, x);
        let mut found = f64::NAN;
        for slip in slips {
            let mut kept = [Lanes16([age; 16])];
            let per_step = 1.0 / step;
            let stuck: Portable = friction.of_stuck(PortableToken, &mut kept, u16::MAX, per_step);
            let slip_of_step = SlipOfStep {
                way: [c(-slip.unwrap_or(1.0)); 3],
                components: 1,
                sliding: slip.map_or(0, |_| u16::MAX),
                per_step,
            };
            found = first(friction.of_sliding(PortableToken, &mut kept, &slip_of_step, stuck));
            age = kept[0].0[0];
        }
        [found, age]
    }

    /// 0.4 (1 + 0.1 ln(1 + θ/2 ms)).
    fn of_age(age: f64) -> f64 {
        FRICTION * (1.0 + 0.1 * (1.0 + age / 2e-3).ln())
    }

    #[test]
    fn a_contact_that_sticks_ages_with_the_time() {
        let [friction, age] = after(&AGEING, 0.0, 1e-4, &[None; 100]);
        assert!((age - 99.5e-4).abs() < 1e-15, "{age}");
        assert!((friction - of_age(age)).abs() < 1e-15);
        let known = Aged::new(FRICTION, &AGEING).at_age(age);
        assert!((friction - known.value).abs() < 1e-15);
    }

    /// The steady age D/v is kept to rounding, whatever the step, and others decay to it as
    /// e^(-v t/D), to second order in Δt.
    #[test]
    fn slip_renews_a_contact() {
        for step in [1e-5, 1e-3, 1.0] {
            let speed = 0.02;
            let [_, age] = after(&AGEING, 5e-4, step, &[Some(speed * step); 10]);
            assert!((age / 5e-4 - 1.0).abs() < 1e-14, "{age}");
        }
        let error = |steps: usize| {
            let (begun, step) = (1e-3, 1e-3 / steps as f64);
            let slips = vec![Some(0.02 * step); steps];
            let [friction, age] = after(&AGEING, begun, step, &slips);
            assert!((friction - of_age(age)).abs() < 1e-15);
            (age - (5e-4 + 5e-4 * (-2f64).exp())).abs()
        };
        let ratio = error(100) / error(200);
        assert!((3.8..4.2).contains(&ratio), "{ratio}");
    }

    #[test]
    fn without_a_length_of_slip_a_contact_is_never_renewed() {
        let kept = Ageing {
            slip: None,
            ..AGEING
        };
        let slips = [Some(1e-3); 100];
        assert_eq!(
            after(&kept, 0.0, 1e-4, &slips),
            after(&kept, 0.0, 1e-4, &[None; 100])
        );
        assert_eq!(Aged::new(FRICTION, &kept).at_age(1.0).fall, 0.0);
    }

    /// The fall of μ over a slip is the difference of the steps' own μ.
    #[test]
    fn friction_falls_over_a_slip() {
        let (age, slip) = (3e-3, 1e-10);
        let friction = |slip| after(&AGEING, age, f64::INFINITY, &[Some(slip)])[0];
        let found = (4.0 * (friction(slip) - friction(0.0))
            - (friction(2.0 * slip) - friction(0.0)))
            / (2.0 * slip);
        let fall = Aged::new(FRICTION, &AGEING).at_age(age).fall;
        assert!((found / -fall - 1.0).abs() < 1e-5, "{found} {fall}");
    }
}
