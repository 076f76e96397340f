//! All measurements of one protocol, and the fits to several records.

use std::ops::Range;

use super::evolution_law::Evolution;
use super::fit::{Fit, chi_squared, fit};
use super::quantity::FitForm;
use super::slider_record::SliderRecord;
use super::steps_and_holds::{self, Healing, Hold, Steady, VelocityStep};
use super::window::FitWindow;

/// A record with everything measured on it without a law.
#[derive(Debug, Clone, PartialEq)]
pub struct Experiment {
    /// The record: one run, or the mean of several realisations.
    pub record: SliderRecord,
    /// `[segments]` Steady friction; `None` for holds.
    pub steady: Vec<Option<Steady>>,
    /// Velocity steps.
    pub steps: Vec<VelocityStep>,
    /// Holds after a slide.
    pub holds: Vec<Hold>,
    /// Fits of healing against ln t_hold.
    pub healing: Vec<Healing>,
}

impl Experiment {
    /// Measures a record. `d_c` (m): see `steps_and_holds::holds`.
    pub fn of(record: SliderRecord, d_c: Option<f64>) -> Self {
        let steady = steps_and_holds::steady_segments(&record);
        let steps = steps_and_holds::steps(&record, &steady, d_c);
        let holds = steps_and_holds::holds(&record, &steady, d_c);
        let healing = steps_and_holds::healing(&holds);
        Experiment {
            record,
            steady,
            steps,
            holds,
            healing,
        }
    }
}

/// Segments of each velocity step: the one before and the one after.
fn step_ranges(record: &SliderRecord) -> Vec<Range<usize>> {
    let segments = 1..record.drive.len();
    let after = segments.filter(|k| !record.drive[*k - 1].is_hold() && !record.drive[*k].is_hold());
    after.map(|k| k - 1..k + 1).collect()
}

/// Segments of each hold: the slide before, the hold, and the slide after it if there is one.
fn hold_ranges(record: &SliderRecord) -> Vec<Range<usize>> {
    let count = record.drive.len();
    let holds = (1..count).filter(|k| record.drive[*k].is_hold());
    holds.map(|k| k - 1..count.min(k + 2)).collect()
}

/// Fits of one or both laws to the same windows.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// `all`, `all (jackknife)`, `velocity steps` or `slide-hold-slide`; for a single event
    /// `velocity step` or `hold`.
    pub name: &'static str,
    /// Index of the record and its segments, for a single step or hold.
    pub event: Option<(usize, Range<usize>)>,
    /// A fit per law, or the reason why there is none.
    pub fits: Vec<(Evolution, Result<Fit, String>)>,
    /// χ² of each fit, in units of the noise of the best one; `None` without a fit.
    pub chi_squared: Vec<Option<f64>>,
}

impl Fitted {
    fn of(name: &'static str, windows: &[FitWindow], laws: &[Evolution], form: &FitForm) -> Self {
        let fits: Vec<_> = (laws.iter())
            .map(|law| (*law, fit(windows, *law, form)))
            .collect();
        let mut fitted = Fitted {
            name,
            event: None,
            fits,
            chi_squared: Vec::new(),
        };
        let best = fitted.best();
        let chi_squared = fitted
            .fits
            .iter()
            .map(|(_, fit)| Some(chi_squared(windows, fit.as_ref().ok()?, best?)));
        fitted.chi_squared = chi_squared.collect();
        fitted
    }

    /// Returns the fit with the least residuals.
    pub fn best(&self) -> Option<&Fit> {
        let done = self.fits.iter().filter_map(|(_, fit)| fit.as_ref().ok());
        done.min_by(|a, b| a.rms.total_cmp(&b.rms))
    }
}

/// Fits the laws to all records together; then, if there are both kinds, to all velocity steps and
/// to all slide-hold-slide tests; then, if there are several, to each step and each hold.
pub fn fit_all(records: &[SliderRecord], laws: &[Evolution], form: &FitForm) -> Vec<Fitted> {
    let whole = records.iter().enumerate();
    let whole: Vec<_> = whole
        .map(|(k, record)| (k, 0..record.drive.len()))
        .collect();
    let steps = numbered(records, step_ranges);
    let holds = numbered(records, hold_ranges);
    let mut fitted = vec![Fitted::of("all", &windows(records, &whole), laws, form)];
    if !steps.is_empty() && !holds.is_empty() {
        for (name, ranges) in [("velocity steps", &steps), ("slide-hold-slide", &holds)] {
            fitted.push(Fitted::of(name, &windows(records, ranges), laws, form));
        }
    }
    if steps.len() + holds.len() > 1 {
        for (name, events) in [("velocity step", steps), ("hold", holds)] {
            fitted.extend(events.into_iter().map(|event| Fitted {
                event: Some(event.clone()),
                ..Fitted::of(name, &windows(records, &[event]), laws, form)
            }));
        }
    }
    fitted
}

/// Ranges of segments of all records, each with the index of its record.
fn numbered(
    records: &[SliderRecord],
    ranges: fn(&SliderRecord) -> Vec<Range<usize>>,
) -> Vec<(usize, Range<usize>)> {
    let records = records.iter().enumerate();
    let all = records.flat_map(|(k, record)| {
        let ranges = ranges(record).into_iter();
        ranges.map(move |range| (k, range))
    });
    all.collect()
}

/// The windows of ranges of segments, each with the index of its record.
fn windows(records: &[SliderRecord], ranges: &[(usize, Range<usize>)]) -> Vec<FitWindow> {
    let ranges = ranges.iter();
    let windows = ranges.map(|(k, range)| FitWindow::of(&records[*k], range.clone()));
    windows.collect()
}
