//! Means and scatter over runs that differ in their seeds only.

use std::fmt::Write as _;

use super::correlations::{key, seeds};
use super::studied::{Size, Studied};
use gshear_analysis::correlate::{SUBJECTS, Subject};
use gshear_analysis::phases::Kind;
use gshear_analysis::ranges::Range;
use gshear_analysis::spearman::Correlation;
use gshear_analysis::spread::Spread;

/// Runs of one scene with different seeds, each seed once, in the order given.
pub struct Family<'a> {
    /// The runs; at least one.
    pub runs: Vec<&'a Studied>,
}

/// Groups runs into families, in the order of their first runs.
pub fn families(runs: &[Studied]) -> Vec<Family<'_>> {
    let mut families: Vec<Family> = Vec::new();
    for run in runs {
        let same = |family: &&mut Family| family.runs[0].family == run.family;
        match families.iter_mut().find(same) {
            None => families.push(Family { runs: vec![run] }),
            // The same seed gives the same run, which is no further evidence.
            Some(family) if family.runs.iter().any(|other| other.seed == run.seed) => {}
            Some(family) => family.runs.push(run),
        }
    }
    families
}

impl Family<'_> {
    /// Returns the label of the first run, without its number.
    pub fn label(&self) -> &str {
        let label = &self.runs[0].label;
        label.strip_suffix(" (1)").unwrap_or(label)
    }

    /// Returns for every range the mean ρ of the runs with at least five pairs, their median p and
    /// least number of pairs, and the spread of ρ.
    pub fn correlate(&self, subject: Subject) -> Vec<(Range, Correlation, Spread)> {
        let all: Vec<_> = self
            .runs
            .iter()
            .map(|run| run.regime.correlate(subject))
            .collect();
        let of_range = |k: usize| {
            let found = || {
                all.iter()
                    .map(|of_run| of_run[k].1)
                    .filter(|c| c.count >= 5)
            };
            let spread = Spread::of(found().map(|c| c.rho));
            let mean = Correlation {
                rho: spread.mean,
                p: Spread::of(found().map(|c| c.p)).median,
                count: found().map(|c| c.count).min().unwrap_or(0),
            };
            (all[0][k].0, mean, spread)
        };
        (0..all[0].len()).map(of_range).collect()
    }

    /// Names and spreads of the numbers that every run has one of.
    fn numbers(&self) -> [(&'static str, Spread); 8] {
        let spread = |of: &dyn Fn(&Studied) -> f64| Spread::of(self.runs.iter().map(|run| of(run)));
        let count = |run: &Studied, fits: &dyn Fn(usize) -> bool| {
            (0..run.regime.phases.len()).filter(|k| fits(*k)).count() as f64
        };
        let phases = |run: &Studied| count(run, &|_| true);
        let long = |run: &Studied| count(run, &|k| run.regime.phases[k].phase.is_long());
        let intervals = |run: &Studied| run.regime.tau.len().saturating_sub(1) as f64;
        let tau = |run: &Studied| {
            let tau = &run.regime.tau;
            let mean = tau.iter().sum::<f64>() / tau.len() as f64;
            let square = tau.iter().map(|t| (t - mean) * (t - mean)).sum::<f64>();
            [mean, (square / tau.len() as f64).sqrt()]
        };
        let slips = |run: &Studied| -> Vec<f64> {
            let phases = run.regime.phases.iter().map(|m| m.phase);
            let slips = phases.filter(|phase| phase.kind == Kind::Slip);
            slips.map(|phase| phase.change).collect()
        };
        [
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
        ]
    }
}

/// Returns the content of `ensemble.csv`: mean and standard error of the numbers of each family.
pub fn numbers_csv(families: &[Family]) -> String {
    let mut csv = String::from("runs_of,what,runs,mean,error,least,greatest\n");
    for family in families {
        for (what, s) in family.numbers() {
            writeln!(
                csv,
                "{},{what},{},{:?},{:?},{:?},{:?}",
                family.label(),
                s.count,
                s.mean,
                s.error,
                s.least,
                s.greatest
            )
            .expect("writing to a string cannot fail");
        }
    }
    csv
}

/// Returns the content of `ensemble-correlations.csv`: mean and standard error of ρ in every range.
pub fn correlations_csv(families: &[Family]) -> String {
    let mut csv = String::from(
        "runs_of,with,over,from,to,runs,least_pairs,rho_mean,rho_error,rho_least,rho_greatest,p_median\n",
    );
    for family in families {
        for subject in SUBJECTS {
            let [with, over] = key(subject);
            for (range, mean, s) in family.correlate(subject) {
                writeln!(
                    csv,
                    "{},{with},{over},{:?},{:?},{},{},{:?},{:?},{:?},{:?},{:?}",
                    family.label(),
                    range.nearer,
                    range.farther,
                    s.count,
                    mean.count,
                    s.mean,
                    s.error,
                    s.least,
                    s.greatest,
                    mean.p
                )
                .expect("writing to a string cannot fail");
            }
        }
    }
    csv
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
