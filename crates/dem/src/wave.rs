//! Sinusoids that are the same on every platform.

use std::f64::consts::{FRAC_PI_2, TAU};

/// A sinusoid a (sin(2πf t + φ) - sin φ), which begins at 0.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wave {
    /// a.
    pub amplitude: f64,
    /// f: cycles per step of Δt; in a [`Part`](crate::protocol::Part) of a protocol cycles per
    /// second.
    pub frequency: f64,
    /// φ in turns.
    pub phase: f64,
}

impl Wave {
    /// The value after so many steps.
    pub fn at(&self, steps: u64) -> f64 {
        let [start, _] = sine_and_cosine(self.phase);
        let [sine, _] = sine_and_cosine(self.turns(steps));
        self.amplitude * (sine - start)
    }

    /// The derivative with respect to time after so many steps; Δt is `step` (s).
    pub fn rate(&self, steps: u64, step: f64) -> f64 {
        let [_, cosine] = sine_and_cosine(self.turns(steps));
        self.amplitude * (TAU * self.frequency / step) * cosine
    }

    /// The greatest derivative, in the unit of time of the frequency.
    pub fn fastest(&self) -> f64 {
        TAU * self.frequency * self.amplitude
    }

    fn turns(&self, steps: u64) -> f64 {
        self.frequency * steps as f64 + self.phase
    }
}

/// sin 2πx and cos 2πx, to about an ulp of 1. Multiples of a quarter turn give exactly 0, 1 and -1.
///
/// x is reduced to an eighth of a turn about the nearest quarter, which is exact; there both are
/// their Taylor series.
pub fn sine_and_cosine(turns: f64) -> [f64; 2] {
    let quarters = 4.0 * (turns - turns.round());
    let nearest = quarters.round();
    let angle = FRAC_PI_2 * (quarters - nearest);
    let square = angle * angle;
    // Coefficients of the series, the last first: -1/(n(n+1)) of the one before.
    let series = |orders: [f64; 8]| {
        orders
            .iter()
            .rev()
            .fold(1.0, |sum, n| 1.0 - sum * square / (n * (n + 1.0)))
    };
    let sine = angle * series([2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0]);
    let cosine = series([1.0, 3.0, 5.0, 7.0, 9.0, 11.0, 13.0, 15.0]);
    match nearest as i64 & 3 {
        0 => [sine, cosine],
        1 => [cosine, -sine],
        2 => [-sine, -cosine],
        _ => [-cosine, sine],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against libm, whose argument 2πx is itself rounded.
    #[test]
    fn sine_and_cosine_are_good_to_an_ulp_of_one() {
        for k in -40_000..40_000 {
            let x = f64::from(k) * 1.234_567e-4;
            let [sine, cosine] = sine_and_cosine(x);
            let (expected_sine, expected_cosine) = (TAU * (x - x.round())).sin_cos();
            assert!((sine - expected_sine).abs() < 5e-16, "sin 2π {x}: {sine}");
            assert!((cosine - expected_cosine).abs() < 5e-16, "cos 2π {x}");
        }
    }

    #[test]
    fn quarters_of_a_turn_are_exact() {
        for (x, expected) in [
            (0.0, [0.0, 1.0]),
            (0.25, [1.0, 0.0]),
            (0.5, [0.0, -1.0]),
            (-0.25, [-1.0, 0.0]),
            (1e6, [0.0, 1.0]),
            (1e6 + 0.75, [-1.0, 0.0]),
        ] {
            let found = sine_and_cosine(x);
            assert!(found[0] == expected[0] && found[1] == expected[1], "{x}");
        }
    }

    #[test]
    fn the_rate_is_the_derivative() {
        let wave = Wave {
            amplitude: 3.0,
            frequency: 1e-6,
            phase: 0.3,
        };
        let step = 2e-3;
        for k in [1, 123_456, 777_777] {
            let difference = (wave.at(k + 1) - wave.at(k - 1)) / (2.0 * step);
            let scale = 3.0 * TAU * 1e-6 / step;
            assert!((wave.rate(k, step) - difference).abs() < 1e-9 * scale);
        }
    }
    /// A quarter of a turn ahead, a sinusoid begins at rest, at 0, and is behind 0 by its amplitude
    /// on the mean.
    #[test]
    fn a_phase_begins_at_zero() {
        let wave = Wave {
            amplitude: 3.0,
            frequency: 1.0 / 8.0,
            phase: 0.25,
        };
        assert_eq!([0, 2, 4, 8].map(|k| wave.at(k)), [0.0, -3.0, -6.0, 0.0]);
        assert_eq!(wave.rate(0, 1.0), 0.0);
        assert_eq!(wave.rate(2, 1.0), -3.0 * TAU / 8.0);
    }
}
