//! The part of a record that a fit uses, and the friction that a law predicts for it.

use std::ops::Range;

use super::drive_segment::DriveSegment;
use super::evolution_law::{LogState, SliderModel};
use super::slider::RateStateSlider;
use super::slider_record::{SliderRecord, weighted_mean};

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
    /// `[rows]` Displacement of the drive since the start of the record (m).
    displacement: Vec<f64>,
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
            displacement: Vec::new(),
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
            let length = rows.len().div_ceil(record.means).max(1);
            for start in rows.clone().step_by(length) {
                let group = start..rows.end.min(start + length);
                window.friction.push(record.mean_friction(group.clone()));
                window.load.extend(&record.load[group.clone()]);
                let place = window.time.len();
                window.groups.push(place..place + group.len());
                let (start, velocity) = (record.begin(segment), record.drive[segment].velocity);
                let driven = record.driven(segment);
                for time in &record.time[group] {
                    window.time.push((time - begin).max(0.0));
                    window.displacement.push(driven + velocity * (time - start));
                }
            }
            window.segments.push(from..window.groups.len());
        }
        window
    }

    /// Returns the states at every row, from steady sliding.
    ///
    /// # Errors
    /// If the integration fails; see [`RateStateSlider::motion`].
    pub(super) fn motion(&self, model: &SliderModel) -> Result<Vec<LogState>, String> {
        let law = model.law;
        let start = law.steady(self.drive[0].velocity);
        let slider = RateStateSlider::new(law, model.stiffness.unwrap_or(self.stiffness));
        slider.motion(&self.drive, start, &self.time)
    }

    /// Returns μ of the model at every row, from steady sliding.
    ///
    /// # Errors
    /// If the integration fails; see [`RateStateSlider::motion`].
    pub fn model(&self, model: &SliderModel) -> Result<Vec<f64>, String> {
        let states = self.motion(model)?;
        let rows = states.into_iter().zip(&self.displacement);
        let friction = rows.map(|(state, driven)| model.law.friction(state) + model.trend * driven);
        Ok(friction.collect())
    }

    /// Returns μ of the model averaged over the same groups of rows as `friction`.
    ///
    /// # Errors
    /// If the integration fails; see [`RateStateSlider::motion`].
    pub(crate) fn model_means(&self, model: &SliderModel) -> Result<Vec<f64>, String> {
        Ok(self.means(&self.model(model)?))
    }

    /// Returns the mean displacement of the drive of each group of rows (m), `[means]`.
    pub(crate) fn mean_displacements(&self) -> Vec<f64> {
        self.means(&self.displacement)
    }

    /// The means of a value of the rows over the groups.
    pub(super) fn means(&self, rows: &[f64]) -> Vec<f64> {
        let groups = self.groups.iter().cloned();
        let means = groups.map(|group| weighted_mean(&rows[group.clone()], &self.load[group]));
        means.collect()
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

/// Returns the record that a model predicts for the same protocol. Before the window, which begins
/// in the middle of the first segment, μ is constant but for the trend.
///
/// # Errors
/// If the integration fails; see [`RateStateSlider::motion`].
pub fn modelled(record: &SliderRecord, model: &SliderModel) -> Result<SliderRecord, String> {
    let window = FitWindow::of(record, 0..record.drive.len());
    let of_window = window.model(model)?;
    let before = record.time.len() - of_window.len();
    let steady = model.law.steady(record.drive[0].velocity);
    let first = model.law.friction(steady);
    let earlier = record.time[..before].iter().map(|time| {
        let driven = record.drive[0].velocity * (time - record.time[0]);
        first + model.trend * driven
    });
    let friction = earlier.chain(of_window).collect();
    Ok(SliderRecord {
        friction,
        ..record.clone()
    })
}
