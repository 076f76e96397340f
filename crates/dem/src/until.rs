//! What ends a part of a protocol before its time.

use serde::{Deserialize, Serialize};

/// Conditions on the top, of which the first that is true ends the part. They are looked at in
/// fixed steps, whatever is written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Until {
    /// τ is less than this.
    pub stress_ratio_below: Option<f64>,
    /// τ is more than this.
    pub stress_ratio_above: Option<f64>,
    /// τ has fallen by this below its greatest value in the part.
    pub drop: Option<f64>,
    /// The velocity along x (m/s) is less than this.
    pub slip_rate_below: Option<f64>,
    /// The velocity along x (m/s) is more than this.
    pub slip_rate_above: Option<f64>,
    /// It has moved by this along x (m) since the part began, either way.
    pub slip: Option<f64>,
    /// How often they are looked at, evenly over the longest duration of the part.
    pub looks: u64,
}

/// What a look at the top finds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// τ = S/N; NaN while nothing touches the top.
    pub stress_ratio: f64,
    /// Displacement along x (m).
    pub slip: f64,
    /// Velocity along x (m/s).
    pub slip_rate: f64,
}

/// What the looks at a part have found since it began.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Watch {
    /// The number of the part, from 0.
    pub part: usize,
    /// Displacement along x (m) when it began.
    slip: f64,
    /// The greatest τ; `None` while nothing has touched the top.
    greatest: Option<f64>,
}

impl Watch {
    /// Of a part that begins.
    pub fn begin(part: usize, look: &Look) -> Self {
        Self {
            part,
            slip: look.slip,
            greatest: Some(look.stress_ratio).filter(|ratio| !ratio.is_nan()),
        }
    }

    /// Goes on with a look. Returns the condition that is true, in words.
    pub fn look(&mut self, until: &Until, look: &Look) -> Option<String> {
        let Look {
            stress_ratio,
            slip,
            slip_rate,
        } = *look;
        if !stress_ratio.is_nan() {
            let greatest = self.greatest.unwrap_or(stress_ratio);
            self.greatest = Some(greatest.max(stress_ratio));
        }
        let fallen = self.greatest.map_or(f64::NAN, |most| most - stress_ratio);
        let slipped = (slip - self.slip).abs();
        let conditions = [
            (until.stress_ratio_below, stress_ratio, -1.0, "stress_ratio"),
            (until.stress_ratio_above, stress_ratio, 1.0, "stress_ratio"),
            (until.drop, fallen, 1.0, "stress_ratio has fallen by"),
            (until.slip_rate_below, slip_rate, -1.0, "slip_rate"),
            (until.slip_rate_above, slip_rate, 1.0, "slip_rate"),
            (until.slip, slipped, 1.0, "the top has slipped by"),
        ];
        conditions
            .into_iter()
            .find_map(|(limit, value, sign, name)| {
                let limit = limit?;
                let is_met = sign * (value - limit) > 0.0;
                is_met.then(|| {
                    let side = if sign < 0.0 { "below" } else { "above" };
                    format!("{name} {value:.6e}, {side} {limit:e}")
                })
            })
    }
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
        looks: 10,
    };

    fn at(stress_ratio: f64, slip: f64, slip_rate: f64) -> Look {
        Look {
            stress_ratio,
            slip,
            slip_rate,
        }
    }

    /// The number of the look, from 1, at which a condition is true.
    fn ends(until: Until, looks: &[Look]) -> Option<usize> {
        let mut watch = Watch::begin(0, &looks[0]);
        (1..looks.len()).find(|k| watch.look(&until, &looks[*k]).is_some())
    }

    #[test]
    fn each_condition_ends_the_part() {
        let looks = [
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
            assert_eq!(ends(until, &looks), expected, "{until:?}");
        }
    }
}
