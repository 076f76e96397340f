//! Measurements that need no evolution law: steady friction, velocity steps, holds and their
//! healing.

use statrs::distribution::{ContinuousCDF, StudentsT};

use super::slider_record::SliderRecord;
use crate::moments::{Moments, grouped, joint_moments};
use crate::time_mean::TimeMean;

/// Steady friction, averaged over the latter half of a slide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steady {
    /// Index of the segment.
    pub segment: usize,
    /// V_drive (m/s).
    pub velocity: f64,
    /// μ_ss, ⟨S⟩/⟨N⟩.
    pub friction: f64,
    /// Standard error of μ_ss, as of [`TimeMean`].
    pub error: f64,
    /// Standard deviation over time of (S - μ_ss N)/⟨N⟩.
    pub scatter: f64,
    /// Slip over the whole segment (m).
    pub slip: f64,
}

/// Slip in which peaks are searched, in D_c.
const PEAK_WITHIN: f64 = 2.0;
/// Slip over which μ is averaged for a peak, in D_c.
const PEAK_MEAN: f64 = 0.05;

/// A velocity step: a change from one slide to another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VelocityStep {
    /// Index of the segment after the step.
    pub segment: usize,
    /// V_drive before and after (m/s).
    pub velocities: [f64; 2],
    /// Extreme μ after the step minus μ_ss before it, and its standard error. The extreme is the
    /// maximum after a step up, the minimum after a step down.
    pub direct: [f64; 2],
    /// The extreme minus μ_ss after the step, and its standard error.
    pub evolution: [f64; 2],
    /// μ_ss after minus μ_ss before the step, (a - b) ln(V_2/V_1), and its standard error.
    pub net: [f64; 2],
}

/// A hold after a slide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hold {
    /// Index of the hold's segment.
    pub segment: usize,
    /// t_hold (s).
    pub duration: f64,
    /// V_i (m/s).
    pub before: f64,
    /// μ at the end of the hold minus μ_ss before it.
    pub relaxation: f64,
    /// The slide after the hold; `None` if there is none.
    pub reslide: Option<Reslide>,
}

/// Peak strength after a hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reslide {
    /// V_r (m/s).
    pub velocity: f64,
    /// Peak strength: the greatest μ after the hold, as `holds` finds it.
    pub peak: f64,
    /// Slip at the peak since the end of the hold (m).
    pub slip_at_peak: f64,
    /// k̄ of layer and spring together (`reload_stiffness`, 1/m).
    pub stiffness: Option<f64>,
    /// Δμ: the peak minus μ_ss before the hold.
    pub healing: f64,
    /// Standard error of Δμ, from that of μ_ss and the scatter of means as long as that of the
    /// peak.
    pub error: f64,
}

/// Fit of Δμ = intercept + slope · ln(t_hold/s) to holds with the same velocities before and after.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Healing {
    /// V_i and V_r (m/s).
    pub velocities: [f64; 2],
    /// Indices of the holds.
    pub holds: Vec<usize>,
    /// Healing rate; equal to b for V_r = V_i and long holds (aging law: Δμ → b ln t_hold + const).
    pub slope: f64,
    /// Δμ at t_hold = 1 s.
    pub intercept: f64,
    /// 95 % interval of the slope by Student's t; `None` for two points.
    pub interval: Option<[f64; 2]>,
}

/// Returns the steady friction of each segment; `None` for holds and for slides without rows in
/// their latter half.
pub(crate) fn steady_segments(record: &SliderRecord) -> Vec<Option<Steady>> {
    let segments = 0..record.drive.len();
    segments.map(|k| Steady::of_segment(record, k)).collect()
}

impl Steady {
    fn of_segment(record: &SliderRecord, segment: usize) -> Option<Self> {
        let drive = record.drive[segment];
        let [_, half] = record.halves(segment);
        if drive.is_hold() || half.is_empty() {
            return None;
        }
        let normal = &record.load[half.clone()];
        let shear = record.friction[half].iter().zip(normal);
        let shear: Vec<f64> = shear.map(|(friction, load)| friction * load).collect();
        let steady = TimeMean::of_ratio(&shear, normal, &vec![1.0; normal.len()]);
        let rows = record.rows(segment);
        Some(Self {
            segment,
            velocity: drive.velocity,
            friction: steady.mean,
            error: steady.error,
            scatter: steady.deviation,
            slip: record.slip[rows.end - 1] - record.slip[rows.start],
        })
    }

    /// μ_ss with its standard error.
    fn estimate(&self) -> [f64; 2] {
        [self.friction, self.error]
    }
}

/// The change from one friction to another, each with its standard error.
fn change(from: [f64; 2], to: [f64; 2]) -> [f64; 2] {
    [to[0] - from[0], from[1].hypot(to[1])]
}

/// Returns the velocity steps: changes from one slide to the next. `d_c` (m): see [`holds`].
pub(crate) fn steps(
    record: &SliderRecord,
    steady: &[Option<Steady>],
    d_c: Option<f64>,
) -> Vec<VelocityStep> {
    let segments = (1..record.drive.len()).filter_map(|segment| {
        let (before, after) = (steady[segment - 1]?, steady[segment]?);
        let up = after.velocity > before.velocity;
        let extreme = extreme(record, segment, up, d_c)?;
        let peak = [extreme.friction, extreme.error];
        Some(VelocityStep {
            segment,
            velocities: [before.velocity, after.velocity],
            direct: change(before.estimate(), peak),
            evolution: change(after.estimate(), peak),
            net: change(before.estimate(), after.estimate()),
        })
    });
    segments.collect()
}

/// Returns the holds that follow a slide. Peaks are the greatest μ in the first half of a segment.
///
/// If D_c (m) is known, the search covers only the first 2 D_c of slip, and μ is averaged over 0.05
/// D_c first. The extreme of single rows would exceed the peak by part of their scatter.
pub(crate) fn holds(
    record: &SliderRecord,
    steady: &[Option<Steady>],
    d_c: Option<f64>,
) -> Vec<Hold> {
    let segments = (1..record.drive.len()).filter_map(|segment| {
        let before = steady[segment - 1]?;
        let rows = record.rows(segment);
        if !record.drive[segment].is_hold() || rows.is_empty() {
            return None;
        }
        Some(Hold {
            segment,
            duration: record.drive[segment].duration,
            before: before.velocity,
            relaxation: record.friction[rows.end - 1] - before.friction,
            reslide: Reslide::after(record, segment, &before, d_c),
        })
    });
    segments.collect()
}

impl Reslide {
    /// The slide after the hold in `segment`; `before`: steady friction before the hold.
    fn after(
        record: &SliderRecord,
        segment: usize,
        before: &Steady,
        d_c: Option<f64>,
    ) -> Option<Self> {
        let end = record.rows(segment).end;
        let after = segment + 1;
        let drive = record.drive.get(after).filter(|drive| !drive.is_hold())?;
        let peak = extreme(record, after, true, d_c)?;
        Some(Self {
            velocity: drive.velocity,
            peak: peak.friction,
            slip_at_peak: peak.slip - record.slip[end - 1],
            stiffness: reload_stiffness(record, after),
            healing: peak.friction - before.friction,
            error: before.error.hypot(peak.error),
        })
    }
}

/// Share of the way from the end of a hold to the greatest μ over which a reload is measured.
const RELOAD: f64 = 0.5;

/// Returns k̄ of layer and spring together (1/m) as the slide in `segment` after a hold shows it:
/// the slope of μ over the displacement of the drive, by least squares from the end of the hold
/// until μ has risen half of the way to its greatest value in the first half of the slide.
///
/// `None` if there is no such slide, if μ does not rise, or if fewer than three rows show it.
pub(crate) fn reload_stiffness(record: &SliderRecord, segment: usize) -> Option<f64> {
    let drive = record.drive.get(segment).filter(|drive| !drive.is_hold())?;
    let [half, _] = record.halves(segment);
    let before = half.start.checked_sub(1)?;
    let start = record.friction[before];
    let friction = record.friction[half.clone()].iter().copied();
    let greatest = friction.reduce(f64::max)?;
    let risen = start + RELOAD * (greatest - start);
    let rises = half.take_while(|row| record.friction[*row] < risen);
    let begin = record.begin(segment);
    let rows = std::iter::once(before).chain(rises);
    let points = rows.map(|row| {
        let share = (record.time[row] - begin).max(0.0) / drive.duration;
        [share, record.friction[row]]
    });
    let points: Vec<[f64; 2]> = points.collect();
    if points.len() <= 2 {
        return None;
    }
    let slope = Line::fit(&points)?.slope;
    (slope > 0.0).then_some(slope / drive.distance())
}

struct Extreme {
    /// μ there.
    friction: f64,
    /// Slip there (m).
    slip: f64,
    /// Standard deviation of means over as many rows.
    error: f64,
}

/// The maximum or the minimum of μ in a segment; see [`holds`].
fn extreme(
    record: &SliderRecord,
    segment: usize,
    greatest: bool,
    d_c: Option<f64>,
) -> Option<Extreme> {
    let [half, rest] = record.halves(segment);
    if half.is_empty() || rest.is_empty() {
        return None;
    }
    let start = record.slip[half.start];
    let slipped = record.slip[rest.end - 1] - record.slip[rest.start];
    let per_row = slipped / (rest.len() as f64 - 1.0).max(1.0);
    let (mut end, mut length) = (half.end, 1);
    if let Some(d_c) = d_c
        && per_row > 0.0
    {
        let near = half.clone();
        let near = near
            .take_while(|row| record.slip[*row] - start <= PEAK_WITHIN * d_c)
            .count();
        length = ((PEAK_MEAN * d_c / per_row) as usize).clamp(1, half.len().min(rest.len()));
        end = half.start + near.max(length);
    }
    let means = record.running_means(half.start..end, length);
    let means = means.iter().copied().enumerate();
    let (at, extreme) = if greatest {
        means.max_by(|a, b| a.1.total_cmp(&b.1))?
    } else {
        means.min_by(|a, b| a.1.total_cmp(&b.1))?
    };
    let later_means = record.running_means(rest, length);
    Some(Extreme {
        friction: extreme,
        slip: record.slip[half.start + at + length / 2],
        error: Moments::of(&later_means).deviation(),
    })
}

/// Fits Δμ against ln t_hold for each pair of velocities with at least two different durations.
pub(crate) fn healing(holds: &[Hold]) -> Vec<Healing> {
    let points = holds.iter().enumerate().filter_map(|(number, hold)| {
        let reslide = hold.reslide?;
        Some(HealingPoint {
            hold: number,
            velocities: [hold.before, reslide.velocity],
            point: [hold.duration.ln(), reslide.healing],
        })
    });
    let groups = grouped(points, HealingPoint::has_same_velocities);
    let fits = groups.iter().filter_map(|group| {
        let points: Vec<[f64; 2]> = group.iter().map(|hold| hold.point).collect();
        let line = Line::fit(&points)?;
        Some(Healing {
            velocities: group[0].velocities,
            holds: group.iter().map(|hold| hold.hold).collect(),
            slope: line.slope,
            intercept: line.intercept,
            interval: line.interval,
        })
    });
    fits.collect()
}

/// The healing of one hold.
struct HealingPoint {
    /// Index of the hold.
    hold: usize,
    /// V_i and V_r (m/s).
    velocities: [f64; 2],
    /// ln t_hold and Δμ.
    point: [f64; 2],
}

impl HealingPoint {
    fn has_same_velocities(&self, other: &Self) -> bool {
        let mut pairs = self.velocities.iter().zip(other.velocities);
        pairs.all(|(a, b)| (a - b).abs() <= 1e-6 * a.abs())
    }
}

/// Growth of the peaks with the velocity of the slides after holds of equal duration, which begin
/// at the same velocity (FR, figure S2: V_i = 0.02 m/s; V_r = 0.05, 0.1 and 0.3 m/s).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PeakGrowth {
    /// t_hold (s).
    pub duration: f64,
    /// V_i (m/s).
    pub before: f64,
    /// Number of peaks.
    pub peaks: usize,
    /// Slope of Δμ against ln(V_r/V_i).
    pub slope: f64,
    /// Its standard error, from those of the peaks.
    pub error: f64,
    /// Δμ of the line at V_r = V_i.
    pub intercept: f64,
    /// Sum of the squared deviations of ln(V_r/V_i) from their mean.
    pub spread: f64,
}

/// Fits Δμ against ln(V_r/V_i) for each duration of holds after the same velocity that has peaks at
/// two or more ratios, in order of the durations.
pub fn peak_growth<'a>(holds: impl IntoIterator<Item = &'a Hold>) -> Vec<PeakGrowth> {
    let holds = holds.into_iter();
    let mut holds: Vec<_> = holds
        .filter_map(|hold| Some((hold, hold.reslide?)))
        .collect();
    holds.sort_by(|(a, _), (b, _)| {
        let by_velocity = a.before.total_cmp(&b.before);
        by_velocity.then(a.duration.total_cmp(&b.duration))
    });
    let groups = holds
        .chunk_by(|(a, _), (b, _)| is_near(a.before, b.before) && is_near(a.duration, b.duration));
    let mut growth: Vec<PeakGrowth> = groups.filter_map(PeakGrowth::fit).collect();
    growth.sort_by(|a, b| a.duration.total_cmp(&b.duration));
    growth
}

/// Whether two values of equal protocols differ by rounding only.
fn is_near(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-3 * b
}

impl PeakGrowth {
    /// Fits the peaks of holds of equal duration after the same velocity.
    fn fit(group: &[(&Hold, Reslide)]) -> Option<Self> {
        let (hold, _) = group[0];
        let points = group.iter().map(|(hold, peak)| {
            let x = (peak.velocity / hold.before).ln();
            [x, peak.healing]
        });
        let points: Vec<[f64; 2]> = points.collect();
        let line = Line::fit(&points)?;
        let ([mean, _], [spread, _]) = joint_moments(&points);
        let terms = points.iter().zip(group).map(|([x, _], (_, peak))| {
            let square = (x - mean) * (x - mean);
            square * peak.error * peak.error
        });
        let variance: f64 = terms.sum();
        Some(Self {
            duration: hold.duration,
            before: hold.before,
            peaks: group.len(),
            slope: line.slope,
            error: variance.sqrt() / spread,
            intercept: line.intercept,
            spread,
        })
    }
}

/// A least-squares line.
pub(super) struct Line {
    pub(super) intercept: f64,
    pub(super) slope: f64,
    /// 95 % interval of the slope by Student's t; `None` for two points.
    pub(super) interval: Option<[f64; 2]>,
}

impl Line {
    /// The line through points (x, y); `None` if all x are equal.
    pub(super) fn fit(points: &[[f64; 2]]) -> Option<Self> {
        let n = points.len() as f64;
        let ([x0, y0], [spread, both]) = joint_moments(points);
        if points.len() < 2 || spread <= 1e-12 * n * (1.0 + x0 * x0) {
            return None;
        }
        let slope = both / spread;
        let squares = points
            .iter()
            .map(|[x, y]| ((y - y0) - slope * (x - x0)).powi(2));
        let rest: f64 = squares.sum();
        let freedom = n - 2.0;
        let interval = (freedom > 0.0).then(|| {
            let half = student(freedom) * (rest / freedom / spread).sqrt();
            [slope - half, slope + half]
        });
        Some(Self {
            intercept: y0 - slope * x0,
            slope,
            interval,
        })
    }
}

/// Half-width of a two-sided 95 % interval in standard errors.
pub(super) fn student(freedom: f64) -> f64 {
    let t = StudentsT::new(0.0, 1.0, freedom).expect("degrees of freedom are positive");
    t.inverse_cdf(0.975)
}
