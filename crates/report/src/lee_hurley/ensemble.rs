//! Means and scatter over runs that differ in their seeds only.

use super::correlations::{key, seeds};
use super::family::Family;
use super::numbers::{drop_regions, mean_and_deviation};
use super::studied::{Size, Studied};
use gshear_analysis::correlate::SUBJECTS;
use gshear_analysis::phases::PhaseKind;
use gshear_analysis::regions::Reduction;
use gshear_analysis::spread::Spread;
use gshear_store::table::Table;

impl Family<'_> {
    /// Names and spreads of the numbers that every run has one of.
    fn numbers(&self) -> Vec<(&'static str, Spread)> {
        let spread = |of: &dyn Fn(&Studied) -> f64| Spread::of(self.runs.iter().map(|run| of(run)));
        let count = |run: &Studied, fits: &dyn Fn(usize) -> bool| {
            (0..run.regime.phases.len()).filter(|k| fits(*k)).count() as f64
        };
        let phases = |run: &Studied| count(run, &|_| true);
        let long = |run: &Studied| count(run, &|k| run.regime.phases[k].phase.is_long());
        let intervals = |run: &Studied| run.regime.tau.len().saturating_sub(1) as f64;
        let slips = |run: &Studied| -> Vec<f64> {
            let phases = run.regime.phases.iter().map(|m| m.phase);
            let slips = phases.filter(|phase| phase.kind == PhaseKind::Slip);
            slips.map(|phase| phase.change).collect()
        };
        let tau = |run: &Studied| mean_and_deviation(&run.regime.tau);
        let mut numbers = vec![
            ("intervals", spread(&intervals)),
            ("phases", spread(&phases)),
            (
                "phases_per_interval",
                spread(&|run| phases(run) / intervals(run)),
            ),
            ("long_phases", spread(&long)),
            ("tau_mean", spread(&|run| tau(run)[0])),
            ("tau_deviation", spread(&|run| tau(run)[1])),
            (
                "largest_slip",
                spread(&|run| slips(run).into_iter().fold(f64::NAN, f64::min)),
            ),
            (
                "mean_slip",
                spread(&|run| slips(run).iter().sum::<f64>() / slips(run).len() as f64),
            ),
        ];
        for (reduction, names) in [
            (
                Reduction::Net,
                ["net_regions_before", "net_regions_in_drop"],
            ),
            (
                Reduction::Losses,
                ["loss_regions_before", "loss_regions_in_drop"],
            ),
            (
                Reduction::GreatestLoss,
                [
                    "greatest_loss_regions_before",
                    "greatest_loss_regions_in_drop",
                ],
            ),
        ] {
            let of = |run: &Studied| drop_regions(run, reduction);
            numbers.push((
                names[0],
                spread(&|run| of(run).map_or(f64::NAN, |found| found.before)),
            ));
            numbers.push((
                names[1],
                spread(&|run| of(run).map_or(f64::NAN, |found| found.least)),
            ));
        }
        numbers
    }
}

/// Returns the content of `ensemble.csv`: mean and standard error of the numbers of each family.
pub fn numbers_csv(families: &[Family]) -> String {
    let rows = families.iter().flat_map(|family| {
        let numbers = family.numbers().into_iter();
        numbers.map(move |(what, spread)| (family.label(), what, spread))
    });
    Table::of(rows)
        .column("runs_of", |(label, ..)| *label)
        .column("what", |(_, what, _)| *what)
        .column("runs", |(.., spread)| spread.count)
        .column("mean", |(.., spread)| spread.mean)
        .column("error", |(.., spread)| spread.error)
        .column("least", |(.., spread)| spread.least)
        .column("greatest", |(.., spread)| spread.greatest)
        .csv()
}

/// Returns the content of `ensemble-correlations.csv`: mean and standard error of ρ in every range.
pub fn correlations_csv(families: &[Family]) -> String {
    let subjects = families
        .iter()
        .flat_map(|family| SUBJECTS.map(|subject| (family, subject)));
    let rows = subjects.flat_map(|(family, subject)| {
        let found = family.correlate(subject).into_iter();
        found.map(move |(range, mean, spread)| (family.label(), subject, range, mean, spread))
    });
    Table::of(rows)
        .column("runs_of", |(label, ..)| *label)
        .columns(["with", "over"], |(_, subject, ..)| key(*subject))
        .column("from", |(_, _, range, ..)| range.nearer)
        .column("to", |(_, _, range, ..)| range.farther)
        .column("runs", |(.., spread)| spread.count)
        .column("least_pairs", |(.., mean, _)| mean.count)
        .column("rho_mean", |(.., spread)| spread.mean)
        .column("rho_error", |(.., spread)| spread.error)
        .column("rho_least", |(.., spread)| spread.least)
        .column("rho_greatest", |(.., spread)| spread.greatest)
        .column("p_median", |(.., mean, _)| mean.p)
        .csv()
}

/// Draws the panels of figures 13 and 25 with means and standard errors, one figure per size of the
/// sample. Returns name and SVG.
pub fn figures(families: &[Family]) -> Vec<(String, String)> {
    let of = |size: Size| {
        let families: Vec<&Family> = families.iter().filter(|f| f.runs[0].size == size).collect();
        let name = format!("ensemble-{}.svg", size.name());
        (!families.is_empty()).then(|| (name, seeds(&families)))
    };
    [Size::Small, Size::Large]
        .into_iter()
        .filter_map(of)
        .collect()
}
