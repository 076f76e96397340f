//! `correlate`: tables of statistics of every phase and their correlation with the change of τ.

use std::path::{Path, PathBuf};

use super::scalars::FrameSeries;
use gshear_analysis::correlate::{CONFIGURATIONS, Choices, Quantity, Regime, SUBJECTS, Subject};
use gshear_analysis::ranges::ValueRange;
use gshear_analysis::spearman::Correlation;
use gshear_dem::failure::Failure;
use gshear_store::dictionary;
use gshear_store::run_reader::RunFile;
use gshear_store::table::Table;

/// Writes `measures.csv` and `correlations.csv` of the phases from γ = `onset` on into `folder`.
/// Returns the paths.
///
/// # Errors
/// An unfit or damaged run, a file that cannot be written.
pub fn write(
    run: &RunFile,
    folder: &Path,
    onset: f64,
    choices: Choices,
) -> Result<[PathBuf; 2], Failure> {
    let FrameSeries {
        step,
        strain,
        tau,
        scalars,
    } = FrameSeries::of(run)?;
    let regime = Regime::from(onset, &strain, &tau, &scalars, choices);
    let paths = ["measures.csv", "correlations.csv"].map(|name| folder.join(name));
    dictionary::write_table(&paths[0], &measures(&regime, &step))?;
    let unit = run.grains().mean_radius().powi(2);
    dictionary::write_table(&paths[1], &correlations(&regime, unit))?;
    Ok(paths)
}

/// Returns one line per phase. `step`: steps of all rows; the regime is the last part of them.
fn measures(regime: &Regime, step: &[u64]) -> String {
    const QUANTITIES: [Quantity; 7] = [
        Quantity::DminMax,
        Quantity::TopMax,
        Quantity::DminSum,
        Quantity::TopSum,
        Quantity::RegionsLeast,
        Quantity::AngleMean,
        Quantity::AngleMedian,
    ];
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
        .columns(QUANTITIES.map(Quantity::name), |(_, measured)| {
            QUANTITIES.map(|quantity| quantity.of(measured))
        })
        .csv()
}

/// Returns one line per range of every correlation, insignificant ones included.
fn correlations(regime: &Regime, unit: f64) -> String {
    let mut rows: Vec<([&str; 4], ValueRange, Correlation)> = Vec::new();
    let mut add = |head: [&'static str; 4], found: Vec<(ValueRange, Correlation)>| {
        rows.extend(found.into_iter().map(|(range, c)| (head, range, c)));
    };
    for subject in SUBJECTS {
        let head = match subject {
            Subject::Greatest => ["delta_tau", "dmin_greatest", "intervals", "delta_tau"],
            Subject::TopTenth => ["delta_tau", "dmin_top_tenth", "intervals", "delta_tau"],
            Subject::Phase(quantity, length) => {
                ["delta_tau_p", quantity.name(), length.name(), "delta_tau_p"]
            }
        };
        add(head, regime.correlate(subject));
    }
    for (by, name) in [
        (Quantity::TopMax, "top_max_over_mean_radius_squared"),
        (Quantity::TopSum, "top_sum_over_mean_radius_squared"),
    ] {
        for quantity in CONFIGURATIONS {
            let found = regime.correlate_by(by, unit, quantity);
            add(["delta_tau_p", quantity.name(), "long", name], found);
        }
    }
    Table::of(rows)
        .columns(["of", "with", "over", "range_of"], |(head, ..)| *head)
        .column("from", |(_, range, _)| range.nearer)
        .column("to", |(_, range, _)| range.farther)
        .column("pairs", |(.., correlation)| correlation.count)
        .column("rho", |(.., correlation)| correlation.rho)
        .column("p", |(.., correlation)| correlation.p)
        .csv()
}
