//! Tests of rate-and-state friction; here the law they use, synthetic data and noise.

mod drives;
mod fits;
mod motion;
mod steps_and_holds;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::fit::{chi_squared, fit};
use super::noise::correlation;
use super::steps_and_holds::{healing, holds, reload_stiffness, steady_segments, steps};
use super::window::FitWindow;
use super::*;
use crate::time_mean::block_error;

/// FR's law and stiffness: k̄ d = 425 at d = 3 mm.
const STIFFNESS: f64 = 1.4e5;

fn law(evolution: Evolution) -> RateStateLaw {
    RateStateLaw {
        evolution,
        mu_star: 0.35,
        a: 0.0247,
        b: 0.0178,
        d_c: 0.0053,
        second: None,
        v_star: 0.02,
    }
}

const BOTH: [Evolution; 2] = [Evolution::Aging, Evolution::Slip];

fn segment(velocity: f64, duration: f64) -> DriveSegment {
    DriveSegment { velocity, duration }
}

/// Synthetic record of the law: a row every `interval` (s), for a drive that begins with steady
/// sliding.
fn synthetic(law: &RateStateLaw, drive: &[DriveSegment], interval: f64) -> SliderRecord {
    on_spring(law, STIFFNESS, drive, interval)
}

/// The same on a spring of this k̄ (1/m).
fn on_spring(
    law: &RateStateLaw,
    stiffness: f64,
    drive: &[DriveSegment],
    interval: f64,
) -> SliderRecord {
    let total: f64 = drive.iter().map(|s| s.duration).sum();
    let rows = (total / interval).round() as usize;
    let time: Vec<f64> = (0..=rows).map(|k| interval * k as f64).collect();
    let slider = RateStateSlider::new(*law, stiffness);
    let states = moved(slider, drive[0].velocity, drive, &time);
    let friction: Vec<f64> = states.iter().map(|s| law.friction(*s)).collect();
    let driven = |mut left: f64| -> f64 {
        let way = drive.iter().map(|s| {
            let part = left.clamp(0.0, s.duration);
            left -= s.duration;
            s.velocity * part
        });
        way.sum()
    };
    let rows = time.iter().zip(&friction);
    let slip = rows.map(|(t, f)| driven(*t) - (f - friction[0]) / stiffness);
    let slip = slip.collect();
    SliderRecord::of_run(stiffness, drive.to_vec(), [time, slip, friction])
}

/// The states at these times, from steady sliding at a velocity.
fn moved(
    slider: RateStateSlider,
    velocity: f64,
    drive: &[DriveSegment],
    times: &[f64],
) -> Vec<LogState> {
    let start = slider.law.steady(velocity);
    slider.motion(drive, start, times).expect("a motion")
}

/// Fails unless a number is what is expected, to a share of it.
#[track_caller]
fn assert_near(found: f64, expected: f64, share: f64) {
    let off = (found / expected - 1.0).abs();
    assert!(off < share, "{found} for {expected}");
}

/// Holds between slides of one velocity.
fn with_holds(velocity: f64, slide: f64, holds: &[f64]) -> Vec<DriveSegment> {
    let slide = segment(velocity, slide);
    let after = holds.iter().flat_map(|hold| [segment(0.0, *hold), slide]);
    std::iter::once(slide).chain(after).collect()
}

/// Values of a Gaussian process with standard deviation σ and a correlation length of `memory`
/// values; 0: white.
fn noise(seed: u64, count: usize, sigma: f64, memory: f64) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = move || {
        let [u, v]: [f64; 2] = [1.0 - random.random::<f64>(), random.random()];
        (-2.0 * u.ln()).sqrt() * (2.0 * std::f64::consts::PI * v).cos()
    };
    let kept = kept(memory);
    let mut value = normal();
    let next = |_| {
        let now = sigma * value;
        value = kept * value + (1.0 - kept * kept).sqrt() * normal();
        now
    };
    (0..count).map(next).collect()
}

/// Autocorrelation of neighbours with this correlation length; 0: none.
fn kept(memory: f64) -> f64 {
    if memory > 0.0 {
        (-1.0 / memory).exp()
    } else {
        0.0
    }
}

fn disturbed(record: &SliderRecord, seed: u64, sigma: f64, memory: f64) -> SliderRecord {
    let mut record = record.clone();
    let noise = noise(seed, record.time.len(), sigma, memory);
    let rows = record.friction.iter_mut().zip(noise);
    rows.for_each(|(f, n)| *f += n);
    record
}

/// A step up and a step down.
fn step_test() -> [DriveSegment; 3] {
    [segment(0.02, 2.0), segment(0.2, 0.3), segment(0.02, 3.0)]
}
