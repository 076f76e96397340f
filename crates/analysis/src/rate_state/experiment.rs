//! All measurements of one protocol, and the fits to several records.

use std::ops::Range;

use super::evolution_law::Evolution;
use super::fit::{Fit, chi_squared, fit};
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
    /// Measures a record. `d_c` (m): see [`steps_and_holds::holds`].
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
    let slides = |k: &usize| !record.drive[*k - 1].is_hold() && !record.drive[*k].is_hold();
    let after = (1..record.drive.len()).filter(slides);
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
    fn of(name: &'static str, windows: &[FitWindow], laws: &[Evolution]) -> Self {
        let fits: Vec<_> = laws.iter().map(|law| (*law, fit(windows, *law))).collect();
        let mut fitted = Fitted {
            name,
            event: None,
            fits,
            chi_squared: Vec::new(),
        };
        let best = fitted.best();
        let chi = |(_, fit): &(Evolution, Result<Fit, String>)| {
            Some(chi_squared(windows, fit.as_ref().ok()?, best?))
        };
        fitted.chi_squared = fitted.fits.iter().map(chi).collect();
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
pub fn fit_all(records: &[SliderRecord], laws: &[Evolution]) -> Vec<Fitted> {
    let window = |(k, range): &(usize, Range<usize>)| FitWindow::of(&records[*k], range.clone());
    let of_all = |ranges: fn(&SliderRecord) -> Vec<Range<usize>>| -> Vec<(usize, Range<usize>)> {
        let of = |(k, record)| ranges(record).into_iter().map(move |range| (k, range));
        records.iter().enumerate().flat_map(of).collect()
    };
    let of_whole = |(k, record): (usize, &SliderRecord)| (k, 0..record.drive.len());
    let whole: Vec<_> = records.iter().enumerate().map(of_whole).collect();
    let steps = of_all(step_ranges);
    let holds = of_all(hold_ranges);
    let together = |name, ranges: &[(usize, Range<usize>)]| {
        let windows: Vec<FitWindow> = ranges.iter().map(window).collect();
        Fitted::of(name, &windows, laws)
    };
    let mut fitted = vec![together("all", &whole)];
    if !steps.is_empty() && !holds.is_empty() {
        fitted.push(together("velocity steps", &steps));
        fitted.push(together("slide-hold-slide", &holds));
    }
    if steps.len() + holds.len() > 1 {
        for (name, events) in [("velocity step", steps), ("hold", holds)] {
            fitted.extend(events.into_iter().map(|event| Fitted {
                event: Some(event.clone()),
                ..together(name, &[event])
            }));
        }
    }
    fitted
}
