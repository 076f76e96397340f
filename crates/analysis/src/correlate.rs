//! The correlations of LH section 3.3: which quantities are correlated with Δτ or Δτ_p, and over
//! which intervals or phases.

use super::frame_scalars::FrameScalars;
use super::phase_measures::{self, Measured, PhaseMeasures};
use super::phases;
use super::ranges::{self, Bins, KeyedPair, ValueRange};
use super::regions::GrReading;
use super::spearman::Correlation;

/// Selects phases by their length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Length {
    /// All phases.
    All,
    /// t_p > 3Δγ.
    Long,
    /// t_p ≤ 3Δγ.
    Short,
}

impl Length {
    /// Returns the name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Length::All => "all",
            Length::Long => "long",
            Length::Short => "short",
        }
    }

    fn has(self, phase: &Measured) -> bool {
        match self {
            Length::All => true,
            Length::Long => phase.phase.is_long(),
            Length::Short => !phase.phase.is_long(),
        }
    }
}

/// The measures of a phase in the order of [`PhaseMeasures`], and its duration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// mgD²min (equation 1).
    DminMax,
    /// mg_t10%D²min (equation 2).
    TopMax,
    /// sgD²min (equation 3).
    DminSum,
    /// sg_t10%D²min (equation 4).
    TopSum,
    /// N_c, the least number of GR regions.
    RegionsLeast,
    /// Mean |θ| at the last row with N_c regions.
    AngleMean,
    /// Median |θ| at the last row with N_c regions.
    AngleMedian,
    /// t_p, in intervals.
    Duration,
}

impl Quantity {
    /// Returns the name of the column in tables.
    pub fn name(self) -> &'static str {
        let column = PhaseMeasures::COLUMNS.get(self as usize);
        column.map_or("t_p", |column| column.name)
    }

    /// Returns the value for a phase.
    pub fn of(self, phase: &Measured) -> f64 {
        let measures = phase.measures.columns();
        let measure = measures.get(self as usize).copied();
        measure.unwrap_or(phase.phase.duration() as f64)
    }
}

/// A correlation with Δτ or Δτ_p in ranges of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subject {
    /// Δτ of all intervals with gD²min.
    Greatest,
    /// Δτ of all intervals with g_t10%D²min.
    TopTenth,
    /// Δτ_p of phases with a quantity.
    Phase(Quantity, Length),
}

/// All correlations with Δτ or Δτ_p in LH.
pub fn subjects() -> impl Iterator<Item = Subject> {
    use Quantity::{DminMax, DminSum, Duration, TopMax, TopSum};
    let lengths = [Length::All, Length::Long, Length::Short];
    let measures = lengths.map(|length| {
        [DminMax, TopMax, DminSum, TopSum].map(|quantity| Subject::Phase(quantity, length))
    });
    let durations = lengths.map(|length| Subject::Phase(Duration, length));
    let phases = measures.into_iter().flatten().chain(durations);
    [Subject::Greatest, Subject::TopTenth]
        .into_iter()
        .chain(phases)
}

/// Quantities that LH correlate with Δτ_p of long phases in ranges of mg_t10%D²min and of
/// sg_t10%D²min (figures 11 and 23).
pub const CONFIGURATIONS: [Quantity; 3] = [
    Quantity::AngleMean,
    Quantity::AngleMedian,
    Quantity::RegionsLeast,
];

/// The stick-slip regime of a run: the series from the onset strain on, with its phases.
#[derive(Debug, Clone, PartialEq)]
pub struct Regime {
    /// `[L]` γ.
    pub strain: Vec<f64>,
    /// `[L]` τ.
    pub tau: Vec<f64>,
    /// `[L]` row k for the interval from row k-1 to row k.
    pub scalars: Vec<FrameScalars>,
    /// Phases and their measures.
    pub phases: Vec<Measured>,
    /// Width of the ranges of the correlations.
    pub bins: Bins,
}

impl Regime {
    /// Takes the rows from γ = `onset` on and finds their phases. LH leave open how GR regions are
    /// counted and how wide the ranges are.
    pub fn from(
        onset: f64,
        strain: &[f64],
        tau: &[f64],
        scalars: &[FrameScalars],
        reading: GrReading,
        bins: Bins,
    ) -> Self {
        let first = phases::onset(strain, onset);
        let (strain, tau) = (strain[first..].to_vec(), tau[first..].to_vec());
        let scalars = scalars[first..].to_vec();
        let phases = phase_measures::of(&strain, &tau, &scalars, reading);
        Regime {
            strain,
            tau,
            scalars,
            phases,
            bins,
        }
    }

    /// Returns ρ and p in every range of Δτ or Δτ_p.
    pub fn correlate(&self, subject: Subject) -> Vec<(ValueRange, Correlation)> {
        ranges::correlations(&self.rows(subject), &self.bins.of_stress_changes())
    }

    fn rows(&self, subject: Subject) -> Vec<KeyedPair> {
        match subject {
            Subject::Greatest => self.intervals(|s| s.dmin_greatest),
            Subject::TopTenth => self.intervals(|s| s.dmin_top_tenth),
            Subject::Phase(quantity, length) => {
                let phases = self.phases.iter().filter(|phase| length.has(phase));
                let rows = phases.map(|phase| row(phase.phase.change, quantity.of(phase)));
                rows.collect()
            }
        }
    }

    /// Δτ of every interval with one of its scalars.
    fn intervals(&self, scalar: fn(&FrameScalars) -> f64) -> Vec<KeyedPair> {
        let rows = (1..self.tau.len()).map(|k| {
            let change = self.tau[k] - self.tau[k - 1];
            row(change, scalar(&self.scalars[k]))
        });
        rows.collect()
    }

    /// Returns ρ and p of Δτ_p with `quantity` over long phases, in ranges of `by` over
    /// `unit` (m² if `by` is a D²min).
    pub fn correlate_by(
        &self,
        by: Quantity,
        unit: f64,
        quantity: Quantity,
    ) -> Vec<(ValueRange, Correlation)> {
        let long = self.phases.iter().filter(|phase| Length::Long.has(phase));
        let rows = long.map(|phase| KeyedPair {
            by: by.of(phase) / unit,
            pair: [phase.phase.change, quantity.of(phase)],
        });
        let rows: Vec<KeyedPair> = rows.collect();
        let ranges = self.bins.around(rows.iter().map(|row| row.by));
        ranges::correlations(&rows, &ranges)
    }
}

fn row(change: f64, value: f64) -> KeyedPair {
    KeyedPair {
        by: change,
        pair: [change, value],
    }
}
