//! Jackknife intervals of a fit, from the differences between realisations rather than the noise
//! within them.

use super::experiment::Fitted;
use super::fit::{Fit, fit};
use super::quantity::FitForm;
use super::slider_record::{SliderRecord, mean};
use super::steps_and_holds::student;
use super::window::FitWindow;
use crate::moments::Moments;

/// Least number of realisations per protocol.
const FEWEST: usize = 3;

/// Returns the fits to all records with 95 % intervals from fits that each leave out one
/// realisation (Tukey 1958, applied per experiment e because each has its own realisations).
///
/// ```text
/// variance = Σ_e (R_e - 1)/R_e Σ_k (p_ek - p̄_e)²,  degrees of freedom Σ (R_e - 1)
/// ```
///
/// for p = ln a, b, a - b, ln D_c and μ*. `groups`: indices into `records` of the realisations of
/// each experiment. `None` if an experiment has fewer than three realisations. If one of the fits
/// fails, so does that law's result.
pub fn jackknife(
    records: &[SliderRecord],
    groups: &[Vec<usize>],
    all: &Fitted,
    form: &FitForm,
) -> Option<Fitted> {
    if groups.iter().any(|group| group.len() < FEWEST) {
        return None;
    }
    let fits = all.fits.iter().map(|(law, fit)| {
        let fit = fit.clone();
        (
            *law,
            fit.and_then(|fit| with_spread(records, groups, fit, form)),
        )
    });
    Some(Fitted {
        name: "all (jackknife)",
        event: None,
        fits: fits.collect(),
        chi_squared: all.chi_squared.clone(),
    })
}

fn with_spread(
    records: &[SliderRecord],
    groups: &[Vec<usize>],
    full: Fit,
    form: &FitForm,
) -> Result<Fit, String> {
    let windows = groups.iter();
    let windows: Vec<FitWindow> = windows
        .map(|group| whole(records, group.iter().copied()))
        .collect();
    let (mut variance, mut freedom) = (vec![0.0; full.estimates.len()], 0.0);
    for (e, group) in groups.iter().enumerate() {
        let mut without = Vec::new();
        for left in group {
            let mut windows = windows.clone();
            let kept = group.iter().copied().filter(|k| k != left);
            windows[e] = whole(records, kept);
            without.push(fit(&windows, full.model.law.evolution, form)?);
        }
        let count = group.len() as f64;
        for (p, variance) in variance.iter_mut().enumerate() {
            let values = without.iter().map(|fit| {
                let (quantity, estimate) = fit.estimates[p];
                quantity.fitted_form(estimate.value)
            });
            let moments = Moments::of(&values.collect::<Vec<_>>());
            *variance += (count - 1.0) / count * moments.squares;
        }
        freedom += count - 1.0;
    }
    let estimates = full.estimates.iter().zip(variance);
    let estimates = estimates.map(|((quantity, estimate), variance)| {
        let half_width = student(freedom) * variance.sqrt();
        let estimate = quantity.estimate(estimate.value, half_width, full.length);
        (*quantity, estimate)
    });
    Ok(Fit {
        estimates: estimates.collect(),
        ..full.clone()
    })
}

fn whole(records: &[SliderRecord], members: impl Iterator<Item = usize>) -> FitWindow {
    let members: Vec<&SliderRecord> = members.map(|k| &records[k]).collect();
    let record = mean(&members);
    let segments = record.drive.len();
    FitWindow::of(&record, 0..segments)
}
