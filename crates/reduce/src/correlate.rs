//! `correlate`: tables of statistics of every phase and their correlation with the change of τ.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::scalars::FrameSeries;
use gshear_analysis::correlate::{CONFIGURATIONS, Quantity, Regime, SUBJECTS, Subject};
use gshear_analysis::ranges::Range;
use gshear_analysis::regions::MinPoints;
use gshear_analysis::spearman::Correlation;
use gshear_dem::failure::Failure;
use gshear_store::run_reader::Run;
use gshear_store::text_writer;

/// Writes `measures.csv` and `correlations.csv` of the phases from γ = `onset` on into `folder`.
/// Returns the paths.
///
/// # Errors
/// An unfit or damaged run, a file that cannot be written.
pub fn write(
    run: &Run,
    folder: &Path,
    onset: f64,
    reading: MinPoints,
) -> Result<[PathBuf; 2], Failure> {
    let FrameSeries {
        strain,
        tau,
        scalars,
        ..
    } = FrameSeries::of(run)?;
    let regime = Regime::from(onset, &strain, &tau, &scalars, reading);
    let paths = ["measures.csv", "correlations.csv"].map(|name| folder.join(name));
    text_writer::write(&paths[0], &measures(&regime))?;
    let unit = run.grains().mean_radius().powi(2);
    text_writer::write(&paths[1], &correlations(&regime, unit))?;
    Ok(paths)
}

/// Returns one line per phase.
fn measures(regime: &Regime) -> String {
    const QUANTITIES: [Quantity; 7] = [
        Quantity::DminMax,
        Quantity::TopMax,
        Quantity::DminSum,
        Quantity::TopSum,
        Quantity::RegionsLeast,
        Quantity::AngleMean,
        Quantity::AngleMedian,
    ];
    let mut csv = String::from("phase,kind,length,start_strain,end_strain,t_p,delta_tau_p");
    for quantity in QUANTITIES {
        csv += ",";
        csv += quantity.name();
    }
    csv.push('\n');
    for (k, measured) in regime.phases.iter().enumerate() {
        let phase = &measured.phase;
        let length = if phase.is_long() { "long" } else { "short" };
        let (kind, [from, to]) = (phase.kind.name(), phase.strain);
        let (duration, change) = (phase.duration(), phase.change);
        write!(
            csv,
            "{k},{kind},{length},{from:?},{to:?},{duration},{change:?}"
        )
        .expect("a string grows");
        for quantity in QUANTITIES {
            write!(csv, ",{:?}", quantity.of(measured)).expect("a string grows");
        }
        csv.push('\n');
    }
    csv
}

/// Returns one line per range of every correlation, insignificant ones included.
fn correlations(regime: &Regime, unit: f64) -> String {
    let mut csv = String::from("of,with,over,range_of,from,to,pairs,rho,p\n");
    let mut add = |head: [&str; 4], found: Vec<(Range, Correlation)>| {
        for (range, correlation) in found {
            let Correlation { rho, p, count } = correlation;
            let (head, nearer, farther) = (head.join(","), range.nearer, range.farther);
            writeln!(csv, "{head},{nearer:?},{farther:?},{count},{rho:?},{p:?}")
                .expect("a string grows");
        }
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
    csv
}
