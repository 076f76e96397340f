//! `growth`: how the complex pair of a box grows under Newton's equations, and what becomes of it.

use std::path::PathBuf;

use super::spectrum::dense;
use crate::frame_selection::Which;
use crate::printer::Printer;
use crate::results::Results;
use crate::stored_state::{StateSelection, StoredState};
use gshear_analysis::aftermath::{BoxChange, BoxSeries};
use gshear_analysis::dmin::{NonAffine, RADIUS};
use gshear_analysis::growth::{self, Growth};
use gshear_analysis::jacobian::History;
use gshear_analysis::overlap::{by_chance, overlap};
use gshear_analysis::rattlers::RattlerRule;
use gshear_dem::failure::{Failure, Result};
use gshear_spectrum::Verdict;
use gshear_store::csv_table::Table;
use gshear_store::file_names::{NEWTONIAN_PART, folder_of};
use gshear_store::run_reader::{RunFile, RunStage};

/// Limit of the linear regime: mean square displacement over the square of the mean diameter.
const LINEAR: f64 = 1e-11;
/// Largest number of unknowns for which the growing pair is computed, from all eigenvalues.
const MOST_UNKNOWNS: usize = 3000;

/// Fit the growth of the complex pair under Newton's equations, and say what became of it
///
/// growth.csv, of one line: ω_i and ω_r fitted to the mean square displacement, the aftermath
/// (catastrophe, saturation or growing) with the changes of stress, pressure, energy and contacts,
/// and the overlap of the pair's eigenvector with D²min between the first and the last frame.
/// growth-grains.csv: |v|² and D²min of every grain; without lines if there is no pair or no frame.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The folder of a run in a box, or its run.h5/newtonian
    pub run: PathBuf,
    /// Folder to write into [default: the run's]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Arguments {
    /// # Errors
    /// A damaged run, a file of another stage, a file that cannot be written.
    pub fn run(&self, printer: &mut Printer) -> Result<()> {
        let path = if self.run.is_dir() {
            self.run.join(NEWTONIAN_PART)
        } else {
            self.run.clone()
        };
        let run = RunFile::open_any(&path)?;
        if run.stage() != RunStage::Newtonian {
            return Err(Failure::input(format!(
                "{}: must be the run.h5/newtonian of a run in a box, or its folder",
                path.display()
            )));
        }
        let slip = match growing_pair(&run)? {
            Some(weight) => dmin_of(&run)?.map(|dmin| [weight, dmin]),
            None => None,
        };
        let results = Results::of(self.out.as_deref(), folder_of(&self.run));
        let growth = fitted(&run);
        results.table("growth.csv", &of_run(&run, growth, slip.as_ref()), printer)?;
        if let Some(Err(why)) = growth.map(|growth| growth.omega_r) {
            writeln!(printer, "omega_r of the growth is not resolved: {why}")?;
        }
        results.table("growth-grains.csv", &of_grains(slip.as_ref()), printer)
    }
}

fn fitted(run: &RunFile) -> Option<Growth> {
    let series = run.series();
    let diameter = run.number("mean_diameter").unwrap_or(1.0);
    let linear = LINEAR * diameter * diameter;
    growth::fit(
        &series.time,
        series.column("msd"),
        linear,
        run.number("omega_r"),
    )
}

fn of_run(run: &RunFile, growth: Option<Growth>, slip: Option<&[Vec<f64>; 2]>) -> String {
    let series = run.series();
    let diameter = run.number("mean_diameter").unwrap_or(1.0);
    let msd = series.column("msd");
    let number = |value: fn(Growth) -> f64| growth.map_or(f64::NAN, value);
    let columns = BoxSeries {
        time: &series.time,
        msd,
        stress: series.column("shear_stress"),
        pressure: series.column("pressure"),
        energy: series.column("elastic_energy"),
        contacts: series.column("contacts"),
    };
    let change = BoxChange::of(columns, diameter);
    let has_pair = run.number("lambda_i").is_some_and(f64::is_finite);
    let aftermath = match &change {
        Some(change) if has_pair => Some(change.aftermath().name()),
        _ => None,
    };
    let overlap = slip.map_or([f64::NAN; 2], |[weight, dmin]| {
        [overlap(weight, dmin), by_chance(weight, dmin)]
    });
    let nan = [f64::NAN; BoxChange::COLUMNS.len()];
    Table::of([()])
        .column("fitted_omega_i", |()| number(|growth| growth.omega_i))
        .column("fitted_omega_r", |()| {
            number(|growth| growth.omega_r.unwrap_or(f64::NAN))
        })
        .column("growth_from", |()| number(|growth| growth.from))
        .column("growth_to", |()| number(|growth| growth.to))
        .column("decades", |()| number(|growth| growth.decades))
        .columns(["overlap", "overlap_by_chance"], |()| overlap)
        .column("aftermath", |()| aftermath)
        .columns(BoxChange::COLUMNS.map(|column| column.name), |()| {
            change.as_ref().map_or(nan, BoxChange::columns)
        })
        .csv()
}

fn of_grains(slip: Option<&[Vec<f64>; 2]>) -> String {
    let slip = slip.into_iter();
    Table::of(slip.flat_map(|[weight, dmin]| weight.iter().zip(dmin).enumerate()))
        .column("grain", |(n, _)| *n)
        .column("eigenvector_square", |(_, (weight, _))| *weight)
        .column("dmin", |(_, (_, dmin))| *dmin)
        .csv()
}

/// Returns |v|² of each grain's translation, `[N]`, scaled to a sum of 1, for the complex pair that
/// grows fastest (greatest Im √λ) in the first frame; `None` without a frame or a pair.
fn growing_pair(run: &RunFile) -> Result<Option<Vec<f64>>> {
    if run.frames() == 0 {
        return Ok(None);
    }
    let first = StateSelection::Frame(Which::Number(0));
    let jacobian = StoredState::of_run(run, first)?.jacobian(History::Turned);
    if jacobian.unknowns() > MOST_UNKNOWNS {
        return Ok(None);
    }
    let problem = jacobian
        .problem()
        .map_err(|why| Failure::numbers(format!("{}: {why}", run.path().display())))?;
    let spectrum = dense(&problem)?;
    let all = &spectrum.eigenvalues;
    let pairs = (0..all.len()).filter(|k| all[*k].verdict == Verdict::Pair);
    // Both of a pair have the same |Im √λ|.
    let fastest = pairs.max_by(|a, b| {
        let [a, b] = [a, b].map(|k| all[*k].value.sqrt().im.abs());
        a.total_cmp(&b)
    });
    let Some(k) = fastest else {
        return Ok(None);
    };
    let v = spectrum.eigenvector(&problem, k);
    let squares = v.chunks(jacobian.per_grain).map(|unknowns| {
        let axes = &unknowns[..jacobian.axes];
        axes.iter().map(faer::c64::norm_sqr).sum()
    });
    let squares: Vec<f64> = squares.collect();
    let sum: f64 = squares.iter().sum();
    Ok(Some(squares.iter().map(|x| x / sum).collect()))
}

/// Returns D²min of every grain between the first and the last frame, `[N]`; `None` without frames.
fn dmin_of(run: &RunFile) -> Result<Option<Vec<f64>>> {
    let Some(last) = run.frames().checked_sub(1) else {
        return Ok(None);
    };
    let (earlier, later) = (run.frame(0)?, run.frame(last)?);
    let interval = run.interval([0, last], [&earlier, &later]);
    let grains = run.grains();
    let mut non_affine = NonAffine::default();
    non_affine.rattlers_by = RattlerRule::None;
    let mut dmin = vec![f64::NAN; grains.count()];
    non_affine.between(grains, &interval, RADIUS * grains.mean_radius(), &mut dmin);
    Ok(Some(dmin))
}
