//! What ends a part of a protocol before its time.

use serde::{Deserialize, Serialize};

/// Conditions on the top. The first one that holds ends the part. They are checked at fixed steps,
/// which do not depend on the output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Until {
    /// τ is less than this.
    pub stress_ratio_below: Option<f64>,
    /// τ is more than this.
    pub stress_ratio_above: Option<f64>,
    /// τ has fallen by more than this below its greatest value in the part.
    pub drop: Option<f64>,
    /// The velocity along x (m/s) is less than this.
    pub slip_rate_below: Option<f64>,
    /// The velocity along x (m/s) is more than this.
    pub slip_rate_above: Option<f64>,
    /// The distance along x (m) from where the part began is more than this.
    pub slip: Option<f64>,
    /// Number of checks, evenly over the longest duration of the part.
    pub checks: u64,
}

/// Stress ratio and motion of the top.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TopState {
    /// τ = S/N; NaN while nothing touches the top.
    pub stress_ratio: f64,
    /// Displacement along x (m).
    pub slip: f64,
    /// Velocity along x (m/s).
    pub slip_rate: f64,
}

/// The checks of a part so far.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checks {
    /// The number of the part, from 0.
    pub part: usize,
    /// Displacement along x (m) at the first check.
    slip: f64,
    /// The greatest τ; `None` while nothing has touched the top.
    greatest: Option<f64>,
}

impl Checks {
    /// The first check of a part, which does not end it.
    pub fn begin(part: usize, top: &TopState) -> Self {
        let mut checks = Self {
            part,
            slip: top.slip,
            greatest: None,
        };
        checks.note(top.stress_ratio);
        checks
    }

    /// Checks the conditions. Returns the first one that holds, in words.
    pub fn check(&mut self, until: &Until, top: &TopState) -> Option<String> {
        self.note(top.stress_ratio);
        let drop = self.greatest.unwrap_or(f64::NAN) - top.stress_ratio;
        let slip = (top.slip - self.slip).abs();
        below("stress_ratio", top.stress_ratio, until.stress_ratio_below)
            .or_else(|| above("stress_ratio", top.stress_ratio, until.stress_ratio_above))
            .or_else(|| above("the drop of stress_ratio", drop, until.drop))
            .or_else(|| below("slip_rate", top.slip_rate, until.slip_rate_below))
            .or_else(|| above("slip_rate", top.slip_rate, until.slip_rate_above))
            .or_else(|| above("the slip in the part", slip, until.slip))
    }

    /// Notes τ, if it is known.
    fn note(&mut self, stress_ratio: f64) {
        if !stress_ratio.is_nan() {
            let greatest = self.greatest.unwrap_or(stress_ratio);
            self.greatest = Some(greatest.max(stress_ratio));
        }
    }
}

/// Says that a value is below its limit, if it is.
fn below(name: &str, value: f64, limit: Option<f64>) -> Option<String> {
    let limit = limit?;
    (value < limit).then(|| format!("{name} = {value:.6e} is below {limit:e}"))
}

/// Says that a value is above its limit, if it is.
fn above(name: &str, value: f64, limit: Option<f64>) -> Option<String> {
    let limit = limit?;
    (value > limit).then(|| format!("{name} = {value:.6e} is above {limit:e}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const NEVER: Until = Until {
        stress_ratio_below: None,
        stress_ratio_above: None,
        drop: None,
        slip_rate_below: None,
        slip_rate_above: None,
        slip: None,
        checks: 10,
    };

    fn at(stress_ratio: f64, slip: f64, slip_rate: f64) -> TopState {
        TopState {
            stress_ratio,
            slip,
            slip_rate,
        }
    }

    /// The number of the check, from 1, at which a condition is true.
    fn ends(until: Until, states: &[TopState]) -> Option<usize> {
        let mut checks = Checks::begin(0, &states[0]);
        (1..states.len()).find(|k| checks.check(&until, &states[*k]).is_some())
    }

    #[test]
    fn each_condition_ends_the_part() {
        let states = [
            at(0.30, 1.0, 0.0),
            at(0.40, 1.1, 0.1),
            at(0.38, 1.2, 0.3),
            at(0.20, 0.5, -0.4),
            at(f64::NAN, 0.4, 0.0),
        ];
        let cases = [
            (
                Until {
                    stress_ratio_above: Some(0.39),
                    ..NEVER
                },
                Some(1),
            ),
            (
                Until {
                    stress_ratio_below: Some(0.29),
                    ..NEVER
                },
                Some(3),
            ),
            // From the greatest, not from the last.
            (
                Until {
                    drop: Some(0.01),
                    ..NEVER
                },
                Some(2),
            ),
            (
                Until {
                    drop: Some(0.19),
                    ..NEVER
                },
                Some(3),
            ),
            (
                Until {
                    slip_rate_above: Some(0.2),
                    ..NEVER
                },
                Some(2),
            ),
            (
                Until {
                    slip_rate_below: Some(0.0),
                    ..NEVER
                },
                Some(3),
            ),
            // Since the part began, backwards too.
            (
                Until {
                    slip: Some(0.15),
                    ..NEVER
                },
                Some(2),
            ),
            (
                Until {
                    slip: Some(0.45),
                    ..NEVER
                },
                Some(3),
            ),
            // What is not known is not true.
            (
                Until {
                    stress_ratio_below: Some(0.1),
                    ..NEVER
                },
                None,
            ),
            (NEVER, None),
        ];
        for (until, expected) in cases {
            assert_eq!(ends(until, &states), expected, "{until:?}");
        }
    }
}
