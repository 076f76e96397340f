//! `rate-state`: reduces velocity steps and slide-hold-slide tests, and fits rate-and-state
//! parameters.

mod read;
mod tables;

use std::path::{Path, PathBuf};

use clap::ValueEnum;

use crate::printer::Printer;
use crate::results::Results;
use gshear_analysis::rate_state::{
    Estimate, Evolution, Experiment, Fit, Fitted, PeakGrowth, Relaxation, SliderRecord, Stack,
    fit_all, jackknife, merge, modelled, peak_growth, relaxations, stacks,
};
use gshear_dem::failure::{Failure, Result};
use gshear_report::{drawing, rate_state as figures};
use gshear_store::run_reader::RunFile;
use gshear_store::{dictionary, text_writer};

/// Fit rate-and-state friction to spring-driven runs: velocity steps and slide-hold-slide tests
///
/// Runs of the same protocol are realisations: their mean is reduced, with bands of 2σ between
/// realisations. Writes the mean series, tables of segments, steps, holds and fits (CSV),
/// rate-state.json, and figures. Intervals are 95 % confidence intervals.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, or the folder that holds one; several are realisations or further protocols
    #[arg(required = true, value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    /// Evolution law to fit
    #[arg(long, value_enum, default_value_t = Laws::Both)]
    law: Laws,
    /// The a of -a ln(1 + k̄ V_i t/a), with which the relaxation in holds is compared [default: of
    /// the fit]
    #[arg(long, value_name = "A", value_parser = super::positive)]
    direct_effect: Option<f64>,
    /// Folder to write into [default: the first run's folder + /rate-state]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Arguments {
    /// # Errors
    /// As [`write`].
    pub fn run(&self, printer: &mut Printer) -> Result<()> {
        let runs = self.runs.iter().map(|run| RunFile::open(run));
        let runs = runs.collect::<Result<Vec<_>, _>>()?;
        let folder = Results::path(self.out.as_deref(), runs[0].folder(), "rate-state")?;
        write(&runs, self.law, self.direct_effect, &folder, printer)
    }
}

/// Evolution laws to fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Laws {
    /// Aging law (Dieterich)
    Aging,
    /// Slip law (Ruina)
    Slip,
    /// Both laws
    Both,
}

impl Laws {
    fn list(self) -> &'static [Evolution] {
        match self {
            Laws::Aging => &[Evolution::Aging],
            Laws::Slip => &[Evolution::Slip],
            Laws::Both => &[Evolution::Aging, Evolution::Slip],
        }
    }
}

/// Experiments, fits, and the experiments as predicted by the fits to all data.
struct Reduction {
    /// `[experiments]` Runs of each.
    runs: Vec<Vec<String>>,
    experiments: Vec<Experiment>,
    /// Stacks over all runs.
    stacks: Vec<Stack>,
    /// Courses of the holds of all runs.
    relaxations: Vec<Relaxation>,
    /// a with which they are compared; `None` if none is given and no fit determines it.
    direct_effect: Option<f64>,
    fitted: Vec<Fitted>,
    /// `[experiments]` Predictions by law.
    models: Vec<Vec<(Evolution, Experiment)>>,
}

/// Reduces runs, which are realisations of one or several protocols, and writes tables, numbers and
/// figures into `folder`. If a law cannot be fitted, the tables give the reason.
///
/// # Errors
/// Runs that are not spring-slider tests, a run given twice, files that cannot be written.
pub fn write(
    runs: &[RunFile],
    laws: Laws,
    direct_effect: Option<f64>,
    folder: &Path,
    printer: &mut Printer,
) -> Result<()> {
    let reduction = reduce(runs, laws, direct_effect)?;
    let tables = tables::tables(&reduction);
    for (name, csv) in &tables {
        dictionary::write_table(&folder.join(name), csv, 3)?;
    }
    let drawn = figures::all(&reduction.views(), reduction.fitted[0].best());
    let place = folder.display().to_string();
    let page = figures::page(&drawn, &page_rows(&reduction), &place);
    let figures = drawn.iter().map(|(name, svg)| (folder.join(name), &**svg));
    let written = drawing::write_all(&figures.collect::<Vec<_>>())?;
    let json = format!("{:#}\n", tables::json(&reduction));
    text_writer::write(&folder.join("rate-state.json"), json)?;
    text_writer::write(&folder.join("index.html"), page)?;
    summary(&reduction, printer)?;
    writeln!(
        printer,
        "wrote {} files into {}",
        tables.len() + 2 + written,
        folder.display()
    )
}

/// Whether a run is under a spring and has velocity steps or holds.
pub(crate) fn is_test(run: &RunFile) -> bool {
    read::record(run).is_ok()
}

fn reduce(runs: &[RunFile], laws: Laws, direct_effect: Option<f64>) -> Result<Reduction> {
    for (k, run) in runs.iter().enumerate() {
        let same = (runs[..k].iter())
            .find(|other| other.digest().is_some() && other.digest() == run.digest());
        if let Some(other) = same {
            return Err(Failure::input(format!(
                "{} and {} are the same run (equal digests); realisations differ by their seed",
                other.path().display(),
                run.path().display()
            )));
        }
    }
    let records: Vec<SliderRecord> = runs.iter().map(read::record).collect::<Result<_, _>>()?;
    let (joined, groups): (Vec<_>, Vec<_>) = merge(&records).into_iter().unzip();
    let mut fitted = fit_all(&joined, laws.list());
    if let Some(spread) = jackknife(&records, &groups, &fitted[0]) {
        fitted.insert(1, spread);
    }
    let best = fitted[0].best();
    let d_c = best.map(|fit| fit.law.d_c);
    let fitted_a = best.filter(|fit| fit.a.determined).map(|fit| fit.a.value);
    let mut reduction = Reduction {
        runs: Vec::new(),
        experiments: Vec::new(),
        stacks: stacks(&records),
        relaxations: relaxations(&records),
        direct_effect: direct_effect.or(fitted_a),
        models: Vec::new(),
        fitted,
    };
    for (record, group) in joined.into_iter().zip(groups) {
        let names = group.iter().map(|k| runs[*k].path().display().to_string());
        reduction.runs.push(names.collect());
        let models = predictions(&record, &reduction.fitted[0], d_c);
        reduction.models.push(models);
        reduction.experiments.push(Experiment::of(record, d_c));
    }
    Ok(reduction)
}

/// What the fitted laws predict for a record.
fn predictions(
    record: &SliderRecord,
    fitted: &Fitted,
    d_c: Option<f64>,
) -> Vec<(Evolution, Experiment)> {
    let predictions = fitted.fits.iter().filter_map(|(law, fit)| {
        let record = modelled(record, &fit.as_ref().ok()?.law).ok()?;
        Some((*law, Experiment::of(record, d_c)))
    });
    predictions.collect()
}

/// An experiment of a reduction.
struct NumberedExperiment<'a> {
    number: usize,
    experiment: &'a Experiment,
    /// Its runs.
    runs: &'a [String],
}

impl Reduction {
    /// Growth of the peaks with the velocity, over the holds of all experiments.
    fn peak_growth(&self) -> Vec<PeakGrowth> {
        peak_growth(self.experiments.iter().flat_map(|e| &e.holds))
    }

    fn views(&self) -> Vec<figures::View<'_>> {
        let views = self.experiments.iter().zip(&self.models);
        let views = views.map(|(experiment, models)| figures::View { experiment, models });
        views.collect()
    }

    /// The experiments with their numbers and runs.
    fn experiments(&self) -> impl Iterator<Item = NumberedExperiment<'_>> {
        let experiments = self.experiments.iter().zip(&self.runs).enumerate();
        experiments.map(|(number, (experiment, runs))| NumberedExperiment {
            number,
            experiment,
            runs,
        })
    }

    /// The fits to several windows together, a law each, with χ².
    fn fits(&self) -> impl Iterator<Item = (&str, Evolution, &Result<Fit, String>, Option<f64>)> {
        let together = self.fitted.iter().filter(|fitted| fitted.event.is_none());
        together.flat_map(|fitted| {
            let fits = fitted.fits.iter().zip(&fitted.chi_squared);
            fits.map(|((law, fit), chi)| (fitted.name, *law, fit, *chi))
        })
    }
}

/// Four significant digits, for durations and lengths, which may have any scale.
fn digits(x: f64) -> String {
    format!("{x:.3e}")
}

/// Writes an estimate with its interval.
fn shown(e: Estimate, number: impl Fn(f64) -> String) -> String {
    let [low, high] = e.interval.map(&number);
    if e.determined {
        format!("{} ({low} … {high})", number(e.value))
    } else {
        "not determined".into()
    }
}

fn decimals(x: f64) -> String {
    format!("{x:.5}")
}

/// Returns the table of the page: names and texts.
fn page_rows(reduction: &Reduction) -> Vec<[String; 2]> {
    let mut rows = Vec::new();
    for numbered in reduction.experiments() {
        let experiment = numbered.experiment;
        let protocol = format!(
            "{} velocity steps, {} holds; k/N = {:.4e} 1/m; {}",
            experiment.steps.len(),
            experiment.holds.len(),
            experiment.record.stiffness,
            numbered.runs.join(", ")
        );
        rows.push([format!("Experiment {}", numbered.number), protocol]);
        for healing in &experiment.healing {
            let [before, after] = healing.velocities;
            rows.push([
                format!("Healing per factor e of hold time, {before} m/s, hold, {after} m/s"),
                format!("{:.5}", healing.slope),
            ]);
        }
    }
    for growth in reduction.peak_growth() {
        rows.push([
            format!(
                "Growth of {} peaks per factor e of V_r/V_i, holds of {} s after {} m/s",
                growth.peaks,
                digits(growth.duration),
                growth.before
            ),
            format!("{:.5} ± {:.5}", growth.slope, growth.error),
        ]);
    }
    for (name, law, fit, _) in reduction.fits() {
        let text = match fit {
            Ok(fit) => format!(
                "a = {}; b = {}; a - b = {}; D_c (m) = {}",
                shown(fit.a, decimals),
                shown(fit.b, decimals),
                shown(fit.a_minus_b, decimals),
                shown(fit.d_c, digits)
            ),
            Err(why) => format!("none: {why}"),
        };
        rows.push([format!("Fit to {name}, {} law", law.name()), text]);
    }
    rows
}

/// Prints the main results.
fn summary(reduction: &Reduction, printer: &mut Printer) -> Result<()> {
    for numbered in reduction.experiments() {
        print_experiment(&numbered, printer)?;
    }
    for growth in reduction.peak_growth() {
        writeln!(
            printer,
            "peaks after holds of {} s: {:.5} ± {:.5} per factor e of V_r/V_i, {} peaks, V_i = {} m/s",
            digits(growth.duration),
            growth.slope,
            growth.error,
            growth.peaks,
            growth.before
        )?;
    }
    for stack in reduction.stacks.iter().filter(|s| s.pieces.len() > 1) {
        print_stack(stack, printer)?;
    }
    for relaxation in &reduction.relaxations {
        print_relaxation(relaxation, reduction.direct_effect, printer)?;
    }
    print_fits(reduction, printer)
}

fn print_experiment(numbered: &NumberedExperiment<'_>, printer: &mut Printer) -> Result<()> {
    let NumberedExperiment {
        number: k,
        experiment,
        runs,
    } = numbered;
    let record = &experiment.record;
    writeln!(
        printer,
        "experiment {k}: {} realisation{}, {} segments, {} velocity steps, {} holds, k/N = {:.4e} 1/m",
        runs.len(),
        if runs.len() == 1 { "" } else { "s" },
        record.drive.len(),
        experiment.steps.len(),
        experiment.holds.len(),
        record.stiffness
    )?;
    for healing in &experiment.healing {
        let [before, after] = healing.velocities;
        let interval = match healing.interval {
            Some([low, high]) => format!("{low:.5} … {high:.5}"),
            None => "from two holds".into(),
        };
        writeln!(
            printer,
            "  healing {:.5} per factor e of hold time ({interval}), {before} m/s, hold, {after} m/s",
            healing.slope
        )?;
    }
    Ok(())
}

/// Prints every second mean over several velocity steps, if there is any.
fn print_stack(stack: &Stack, printer: &mut Printer) -> Result<()> {
    let [before, after] = stack.velocities;
    let shown = stack.pieces[1..].iter().filter(|p| p.steps > 1).map(|p| {
        let ([from, to], change, error) = (p.slip, p.change, p.error);
        format!("{change:+.4} ± {error:.4} ({from:.1e} to {to:.1e} m)")
    });
    let shown = shown.step_by(2).collect::<Vec<_>>().join(", ");
    if shown.is_empty() {
        return Ok(());
    }
    writeln!(
        printer,
        "  {before} → {after} m/s, mean change of μ: {shown}"
    )
}

fn print_relaxation(
    relaxation: &Relaxation,
    direct_effect: Option<f64>,
    printer: &mut Printer,
) -> Result<()> {
    let law = match direct_effect {
        Some(a) => {
            let changes = [relaxation.stiffness, relaxation.reload].map(|stiffness| {
                if stiffness.is_finite() {
                    format!("{:+.4}", relaxation.of_direct_effect(a, stiffness))
                } else {
                    "unknown".into()
                }
            });
            let [spring, reload] = changes;
            format!(
                ", by the direct effect {spring} with k/N of the spring, {reload} with that of the reload"
            )
        }
        None => String::new(),
    };
    let error = if relaxation.error.is_finite() {
        format!(" ± {:.4}", relaxation.error)
    } else {
        String::new()
    };
    let temperatures = if relaxation.temperature.is_finite() {
        format!(
            ", temperatures over P d³ {:.2e}, of spins {:.2e}",
            relaxation.temperature, relaxation.spin_temperature
        )
    } else {
        String::new()
    };
    writeln!(
        printer,
        "hold of {} s after {} m/s, after {} s: μ {:+.4}{error}{law}{temperatures}",
        digits(relaxation.duration),
        relaxation.before,
        digits(relaxation.time),
        relaxation.change,
    )
}

fn print_fits(reduction: &Reduction, printer: &mut Printer) -> Result<()> {
    writeln!(
        printer,
        "{:<18}{:<7}{:<30}{:<30}{:<33}{:<10}{:>9}",
        "fit to", "law", "a", "b", "D_c (m)", "rms", "χ²"
    )?;
    for (name, law, fit, chi) in reduction.fits() {
        let law = law.name();
        match fit {
            Ok(fit) => writeln!(
                printer,
                "{name:<18}{law:<7}{:<30}{:<30}{:<33}{:<10.2e}{:>9.1}",
                shown(fit.a, decimals),
                shown(fit.b, decimals),
                shown(fit.d_c, digits),
                fit.rms,
                chi.unwrap_or(f64::NAN)
            )?,
            Err(why) => writeln!(printer, "{name:<18}{law:<7}no fit: {why}")?,
        }
    }
    Ok(())
}
