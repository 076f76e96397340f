//! `correlate`: tables of statistics of every phase and their correlation with the change of τ.

use std::path::PathBuf;

use crate::printer::Printer;
use crate::results::Results;
use crate::scalars::FrameSeries;
use gshear_analysis::correlate::{CONFIGURATIONS, Quantity, Regime, Subject, subjects};
use gshear_analysis::phase_measures::PhaseMeasures;
use gshear_analysis::ranges::{Bins, ValueRange};
use gshear_analysis::regions::{GrReading, MinPoints, Reduction};
use gshear_analysis::spearman::Correlation;
use gshear_dem::failure::Result;
use gshear_store::csv_table::Table;
use gshear_store::run_reader::RunFile;

/// Write statistics of every phase and their correlation with the change of τ (Lee & Hurley,
/// section 3.3)
///
/// measures.csv: one line per phase, with the measures of equations 1 to 4. correlations.csv:
/// Spearman's rho and its two-sided p in ranges of Δτ, Δτ_p and D²min. Phases are those
/// of τ at the frames; t_p is counted in intervals of the frames.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, or the folder that holds one
    pub run: PathBuf,
    /// Folder to write into [default: the run's]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Shear strain at which the stick-slip regime begins
    #[arg(long, value_name = "STRAIN", default_value_t = 0.0, value_parser = super::strain)]
    from: f64,
    /// minPts of DBSCAN, the point itself counted: with 1 a single grain is a region, with 2 it
    /// is noise
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2))]
    min_points: u8,
    /// Reduction of force of a grain, by which the grains of GR regions are chosen
    #[arg(long, value_enum, default_value_t = GrainReduction::Net)]
    reduction: GrainReduction,
    /// Ranges of Δτ, Δτ_p and D²min; the last one of Δτ and Δτ_p is open
    #[arg(long, value_enum, default_value_t = RangeWidth::Decades)]
    bins: RangeWidth,
}

/// Width of ranges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum RangeWidth {
    /// As the thresholds in the text of Lee & Hurley
    Decades,
    /// Half as wide
    HalfDecades,
}

/// The reduction of force of a grain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum GrainReduction {
    /// Sum over its contacts; gains make up for losses
    Net,
    /// Sum over those of its contacts that lose force
    Losses,
    /// That of the contact that loses most
    GreatestLoss,
}

impl From<GrainReduction> for Reduction {
    fn from(reduction: GrainReduction) -> Self {
        match reduction {
            GrainReduction::Net => Reduction::Net,
            GrainReduction::Losses => Reduction::Losses,
            GrainReduction::GreatestLoss => Reduction::GreatestLoss,
        }
    }
}

impl Arguments {
    /// # Errors
    /// An unfit or damaged run, a file that cannot be written.
    pub fn run(&self, printer: &mut Printer) -> Result<()> {
        let run = RunFile::open_between_walls(&self.run)?;
        let results = Results::of(self.out.as_deref(), run.folder());
        let series = FrameSeries::of(&run)?;
        let reading = GrReading {
            reduction: self.reduction.into(),
            min_points: match self.min_points {
                1 => MinPoints::Itself,
                _ => MinPoints::OneNeighbour,
            },
        };
        let bins = match self.bins {
            RangeWidth::Decades => Bins::Decades,
            RangeWidth::HalfDecades => Bins::HalfDecades,
        };
        let (strain, tau, scalars) = (&series.strain, &series.tau, &series.scalars);
        let regime = Regime::from(self.from, strain, tau, scalars, reading, bins);
        results.table("measures.csv", &measures(&regime, &series.step), printer)?;
        let unit = run.grains().mean_radius().powi(2);
        results.table("correlations.csv", &correlations(&regime, unit), printer)
    }
}

/// Returns one line per phase. `step`: steps of all rows; the regime is the last part of them.
fn measures(regime: &Regime, step: &[u64]) -> String {
    let step = &step[step.len() - regime.strain.len()..];
    Table::of(regime.phases.iter().enumerate())
        .column("phase", |(k, _)| *k)
        .column("kind", |(_, measured)| measured.phase.kind.name())
        .column("length", |(_, measured)| measured.phase.length_name())
        .column("start_step", |(_, measured)| step[measured.phase.start])
        .column("end_step", |(_, measured)| step[measured.phase.end])
        .columns(["start_strain", "end_strain"], |(_, measured)| {
            measured.phase.strain
        })
        .column("t_p", |(_, measured)| measured.phase.duration())
        .column("delta_tau_p", |(_, measured)| measured.phase.change)
        .columns(PhaseMeasures::COLUMNS, |(_, measured)| {
            measured.measures.columns()
        })
        .csv()
}

/// A correlation in several ranges.
struct CorrelationGroup {
    /// What is correlated, with what, over what, and what the ranges are of.
    head: [&'static str; 4],
    ranges: Vec<(ValueRange, Correlation)>,
}

/// Returns one line per range of every correlation, insignificant ones included.
fn correlations(regime: &Regime, unit: f64) -> String {
    let mut groups: Vec<CorrelationGroup> = Vec::new();
    for subject in subjects() {
        let head = match subject {
            Subject::Greatest => ["delta_tau", "dmin_greatest", "intervals", "delta_tau"],
            Subject::TopTenth => ["delta_tau", "dmin_top_tenth", "intervals", "delta_tau"],
            Subject::Phase(quantity, length) => {
                ["delta_tau_p", quantity.name(), length.name(), "delta_tau_p"]
            }
        };
        groups.push(CorrelationGroup {
            head,
            ranges: regime.correlate(subject),
        });
    }
    for (by, name) in [
        (Quantity::TopMax, "top_max_over_mean_radius_squared"),
        (Quantity::TopSum, "top_sum_over_mean_radius_squared"),
    ] {
        for quantity in CONFIGURATIONS {
            let head = ["delta_tau_p", quantity.name(), "long", name];
            groups.push(CorrelationGroup {
                head,
                ranges: regime.correlate_by(by, unit, quantity),
            });
        }
    }
    let rows = groups.into_iter().flat_map(|group| {
        let ranges = group.ranges.into_iter();
        ranges.map(move |(range, correlation)| (group.head, range, correlation))
    });
    Table::of(rows)
        .columns(["of", "with", "over", "range_of"], |(head, ..)| *head)
        .column("from", |(_, range, _)| range.nearer)
        .column("to", |(_, range, _)| range.farther)
        .column("pairs", |(.., correlation)| correlation.count)
        .column("rho", |(.., correlation)| correlation.rho)
        .column("p", |(.., correlation)| correlation.p)
        .csv()
}
