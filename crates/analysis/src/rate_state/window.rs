//! The part of a record that a fit uses, and the friction that a law predicts for it.

use std::ops::Range;

use super::drive_segment::DriveSegment;
use super::evolution_law::RateStateLaw;
use super::slider::RateStateSlider;
use super::slider_record::{SliderRecord, weighted_mean};

/// Greatest number of means per segment; rows are averaged in groups so that the cost of a fit does
/// not grow with the number of rows.
const MEANS: usize = 400;

/// Consecutive segments of a record. The first one is a slide; only its latter half is used, where
/// sliding is taken as steady.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FitWindow {
    /// k̄ (1/m).
    pub stiffness: f64,
    /// Segments; the first one shortened to the half that is used.
    pub drive: Vec<DriveSegment>,
    /// `[rows]` Time since the start of the window (s).
    pub time: Vec<f64>,
    /// `[means]` Rows of each mean.
    groups: Vec<Range<usize>>,
    /// `[rows]` Normal force, by which rows weigh in the means.
    load: Vec<f64>,
    /// `[means]` μ, ⟨S⟩/⟨N⟩.
    pub friction: Vec<f64>,
    /// `[segments]` Means of each segment.
    pub segments: Vec<Range<usize>>,
}

impl FitWindow {
    /// Takes the segments of `record` in the range. The first one must be a slide.
    pub fn of(record: &SliderRecord, range: Range<usize>) -> Self {
        let first = range.start;
        let mut drive = record.drive[range.clone()].to_vec();
        drive[0].duration *= 0.5;
        let begin = record.begin(first) + drive[0].duration;
        let mut window = FitWindow {
            stiffness: record.stiffness,
            drive,
            time: Vec::new(),
            groups: Vec::new(),
            load: Vec::new(),
            friction: Vec::new(),
            segments: Vec::new(),
        };
        for segment in range {
            let rows = if segment == first {
                record.halves(segment)[1].clone()
            } else {
                record.rows(segment)
            };
            let from = window.groups.len();
            let length = rows.len().div_ceil(MEANS).max(1);
            for start in rows.clone().step_by(length) {
                let group = start..rows.end.min(start + length);
                window.friction.push(record.mean_friction(group.clone()));
                window.load.extend(&record.load[group.clone()]);
                let place = window.time.len();
                window.groups.push(place..place + group.len());
                let times = record.time[group].iter();
                window
                    .time
                    .extend(times.map(|time| (time - begin).max(0.0)));
            }
            window.segments.push(from..window.groups.len());
        }
        window
    }

    /// Returns μ of the law at every row, on the window's spring and from steady sliding.
    ///
    /// # Errors
    /// If the integration fails; see [`RateStateSlider::motion`].
    pub fn model(&self, law: &RateStateLaw) -> Result<Vec<f64>, String> {
        let start = law.steady(self.drive[0].velocity);
        let slider = RateStateSlider::new(*law, self.stiffness);
        let states = slider.motion(&self.drive, start, &self.time)?;
        let states = states.into_iter();
        Ok(states.map(|state| law.friction(state)).collect())
    }

    /// Returns μ of the law averaged over the same groups of rows as `friction`.
    ///
    /// # Errors
    /// If the integration fails; see [`RateStateSlider::motion`].
    pub(crate) fn model_means(&self, law: &RateStateLaw) -> Result<Vec<f64>, String> {
        let rows = self.model(law)?;
        let groups = self.groups.iter().cloned();
        let means = groups.map(|group| weighted_mean(&rows[group.clone()], &self.load[group]));
        Ok(means.collect())
    }

    /// Returns the mean μ over the latter half of a segment, where sliding is nearest to steady.
    pub(crate) fn steady_friction(&self, segment: usize) -> f64 {
        let means = &self.segments[segment];
        let latter = means.start + means.len() / 2..means.end;
        let groups = self.groups[latter.clone()].iter().cloned();
        let loads: Vec<f64> = groups.map(|group| self.load[group].iter().sum()).collect();
        weighted_mean(&self.friction[latter], &loads)
    }
}

/// Returns the record that a law predicts for the same protocol. Before the window, which begins in
/// the middle of the first segment, μ is constant.
///
/// # Errors
/// If the integration fails; see [`RateStateSlider::motion`].
pub fn modelled(record: &SliderRecord, law: &RateStateLaw) -> Result<SliderRecord, String> {
    let window = FitWindow::of(record, 0..record.drive.len());
    let model = window.model(law)?;
    let before = record.time.len() - model.len();
    let first = model.first().copied().unwrap_or(f64::NAN);
    let friction = std::iter::repeat_n(first, before).chain(model).collect();
    Ok(SliderRecord {
        friction,
        ..record.clone()
    })
}
