//! Runs that differ in their seeds only.

use super::studied::Studied;
use gshear_analysis::correlate::Subject;
use gshear_analysis::ranges::ValueRange;
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
    pub fn correlate(&self, subject: Subject) -> Vec<(ValueRange, Correlation, Spread)> {
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
}
