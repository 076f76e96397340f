//! `rate-state`: reduces velocity steps and slide-hold-slide tests, and fits rate-and-state
//! parameters.

mod laboratory;
mod read;
mod tables;

use std::path::{Path, PathBuf};

use clap::ValueEnum;

use self::laboratory::Stiffness;
use super::figure_arguments::FigureArguments;
use crate::printer::Printer;
use crate::results::Results;
use gshear_analysis::rate_state::{
    Estimate, Evolution, Experiment, Fit, FitForm, Fitted, PeakGrowth, Quantity, Relaxation,
    SliderRecord, Stack, fit_all, jackknife, merge, modelled, peak_growth, relaxations, stacks,
};
use gshear_dem::failure::{Failure, Result};
use gshear_report::drawing::Format;
use gshear_report::{drawing, rate_state as figures};
use gshear_store::run_reader::RunFile;
use gshear_store::{dictionary, text_writer};

/// Fit rate-and-state friction to velocity steps and slide-hold-slide tests, of spring-driven runs
/// or of a laboratory
///
/// Runs of the same protocol are realisations: their mean is reduced, with bands of 2σ between
/// realisations. Writes the mean series, tables of segments, steps, holds and fits (CSV),
/// rate-state.json, and figures. Intervals are 95 % confidence intervals.
///
/// A laboratory's table needs the names of its columns, for example: gshear-reduce rate-state
/// steps.txt --time 'Time(s)' --displacement 'LP(um):um' --friction mu --stiffness fit --detrend
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, or the folder that holds one; several are realisations or further protocols. With
    /// --time, the table of one experiment
    #[arg(required = true, value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    /// Evolution law to fit
    #[arg(long, value_enum, default_value_t = Laws::Both)]
    law: Laws,
    /// Number of state variables: with 2, a further b_2 ln(V*θ_2/D_c2)
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2))]
    states: u8,
    /// Parameters that are given and not fitted: a, b, b_2, and d_c, d_c_2 in m. With a, b and d_c
    /// the curves are predictions: only μ* is fitted, and the trend if there is one
    #[arg(long, value_name = "NAME=VALUE,…", value_delimiter = ',', value_parser = given)]
    given: Vec<(Quantity, f64)>,
    /// k̄ with its unit (1/m, 1/mm, 1/um of the friction; MPa/mm, … of the stress), or fit
    /// [default: spring over normal force of the run]
    #[arg(long, value_name = "VALUE[:UNIT]|fit", value_parser = laboratory::stiffness)]
    stiffness: Option<Stiffness>,
    /// Fit a trend of μ, linear in the displacement of the drive
    #[arg(long)]
    detrend: bool,
    /// The a of -a ln(1 + k̄ V_i t/a), with which the relaxation in holds is compared [default: of
    /// the fit]
    #[arg(long, value_name = "A", value_parser = super::positive)]
    direct_effect: Option<f64>,
    #[command(flatten)]
    figures: FigureArguments,
    /// Folder to write into [default: the first run's folder + /rate-state; of a table
    /// NAME-rate-state beside it]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    table: laboratory::Arguments,
}

/// Parses NAME=VALUE of a given parameter.
fn given(text: &str) -> Result<(Quantity, f64), String> {
    let names = Quantity::GIVEN.map(Quantity::name).join(", ");
    let (name, value) = text
        .split_once('=')
        .ok_or("must be NAME=VALUE, such as a=0.0247")?;
    let quantity = Quantity::GIVEN
        .into_iter()
        .find(|quantity| quantity.name() == name);
    let quantity = quantity.ok_or(format!("{name:?} cannot be given; there are {names}"))?;
    let value: Option<f64> = value.parse().ok().filter(|value: &f64| value.is_finite());
    match value {
        Some(value) if !quantity.is_logarithmic() || value > 0.0 => Ok((quantity, value)),
        _ if quantity.is_logarithmic() => Err(format!("{name} must be a number greater than 0")),
        _ => Err(format!("{name} must be a number")),
    }
}

/// Options of a reduction.
#[derive(Debug, Default)]
pub struct Options {
    laws: Laws,
    form: FitForm,
    /// k̄ (1/m) instead of that of the runs.
    stiffness: Option<f64>,
    direct_effect: Option<f64>,
    /// Formats of the files of figures.
    formats: Vec<Format>,
}

impl Options {
    /// The defaults, with figures in these formats.
    pub fn with_formats(formats: Vec<Format>) -> Self {
        Self {
            formats,
            ..Self::default()
        }
    }
}

impl Arguments {
    /// # Errors
    /// As [`write`]; of a table bad input, with line and column.
    pub fn run(&self, printer: &mut Printer) -> Result<()> {
        let options = self.options()?;
        let out = self.out.as_deref();
        if !self.table.is_given() {
            if let Some(table) = self.runs.iter().find(|run| is_table(run)) {
                return Err(Failure::input(format!(
                    "{}: the table of an experiment needs --time NAME, --displacement NAME (or --velocity), --friction NAME (or --shear-stress and --normal-stress) and --stiffness VALUE",
                    table.display()
                )));
            }
            let runs = self.runs.iter().map(|run| RunFile::open(run));
            let runs = runs.collect::<Result<Vec<_>, _>>()?;
            let folder = Results::path(out, runs[0].folder(), "rate-state")?;
            return write(&runs, &options, &folder, printer);
        }
        let [path] = &self.runs[..] else {
            return Err(Failure::input(
                "--time: reads the table of one experiment, since each has a μ* and a trend of its own; call rate-state for each",
            ));
        };
        let record = self.table.record(path, self.stiffness)?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let beside = path.with_file_name(format!("{name}-rate-state"));
        let folder = out.map_or(beside, Path::to_path_buf);
        text_writer::refuse_linked_folder(&folder)?;
        let experiment = vec![path.display().to_string()];
        write_reduction(
            reduce(vec![record], &experiment, &options),
            &options.formats,
            &folder,
            printer,
        )
    }

    fn options(&self) -> Result<Options> {
        let form = FitForm {
            two_states: self.states == 2,
            fits_stiffness: self.stiffness == Some(Stiffness::Fitted),
            detrends: self.detrend,
            given: self.given.clone(),
        };
        for (k, (quantity, _)) in self.given.iter().enumerate() {
            let name = quantity.name();
            if self.given[..k].iter().any(|(other, _)| other == quantity) {
                return Err(Failure::input(format!("--given: {name} is given twice")));
            }
            if matches!(quantity, Quantity::SecondB | Quantity::SecondDc) && !form.two_states {
                return Err(Failure::input(format!("--given: {name} needs --states 2")));
            }
        }
        let stiffness = match self.stiffness {
            Some(Stiffness::OfFriction(value)) => Some(value),
            Some(Stiffness::OfStress(_)) if !self.table.is_given() => {
                return Err(Failure::input(
                    "--stiffness: of runs must be k̄ in 1/m, 1/mm or 1/um, or fit",
                ));
            }
            _ => None,
        };
        Ok(Options {
            laws: self.law,
            form,
            stiffness,
            direct_effect: self.direct_effect,
            formats: self.figures.formats.clone(),
        })
    }
}

/// Whether a file has the name of a table.
fn is_table(path: &Path) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str());
    path.is_file() && ending.is_some_and(|ending| ["csv", "txt", "tsv", "dat"].contains(&ending))
}

/// Evolution laws to fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum Laws {
    /// Aging law (Dieterich)
    Aging,
    /// Slip law (Ruina)
    Slip,
    /// Both laws
    #[default]
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
    /// Symbols of the parameters that were given.
    given: String,
    /// `[experiments]` Predictions by law.
    models: Vec<Vec<(Evolution, Experiment)>>,
}

/// Reduces runs, which are realisations of one or several protocols, and writes tables, numbers and
/// figures into a folder. If a law cannot be fitted, the tables give the reason.
///
/// # Errors
/// Runs that are not spring-slider tests, a run given twice, files that cannot be written.
pub fn write(
    runs: &[RunFile],
    options: &Options,
    folder: &Path,
    printer: &mut Printer,
) -> Result<()> {
    refuse_equal(runs)?;
    let mut records: Vec<SliderRecord> = runs.iter().map(read::record).collect::<Result<_, _>>()?;
    if let Some(stiffness) = options.stiffness {
        records
            .iter_mut()
            .for_each(|record| record.stiffness = stiffness);
    }
    let names = runs.iter().map(|run| run.path().display().to_string());
    let reduction = reduce(records, &names.collect::<Vec<_>>(), options);
    write_reduction(reduction, &options.formats, folder, printer)
}

fn write_reduction(
    reduction: Reduction,
    formats: &[Format],
    folder: &Path,
    printer: &mut Printer,
) -> Result<()> {
    let tables = tables::tables(&reduction);
    for (name, csv) in &tables {
        dictionary::write_table(&folder.join(name), csv, 3)?;
    }
    let drawn = figures::all(&reduction.views(), reduction.fitted[0].best());
    let place = folder.display().to_string();
    let page = figures::page(&drawn, &page_rows(&reduction), formats, &place);
    let figures = drawn.iter().map(|(name, svg)| (folder.join(name), &**svg));
    let written = drawing::write_all(&figures.collect::<Vec<_>>(), formats)?;
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

/// Refuses a run that is given twice.
fn refuse_equal(runs: &[RunFile]) -> Result<()> {
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
    Ok(())
}

/// Reduces records, each with the name of its run.
fn reduce(mut records: Vec<SliderRecord>, names: &[String], options: &Options) -> Reduction {
    let form = &options.form;
    let (mut joined, groups): (Vec<_>, Vec<_>) = merge(&records).into_iter().unzip();
    let mut fitted = fit_all(&joined, options.laws.list(), form);
    if let Some(spread) = jackknife(&records, &groups, &fitted[0], form) {
        fitted.insert(1, spread);
    }
    let best = fitted[0].best();
    if let Some(stiffness) = best.and_then(|fit| fit.model.stiffness) {
        let unknown = records
            .iter_mut()
            .chain(&mut joined)
            .filter(|r| r.stiffness.is_nan());
        unknown.for_each(|record| record.stiffness = stiffness);
    }
    let d_c = best.map(|fit| fit.model.law.d_c);
    let fitted_a = best.and_then(|fit| fit.estimate(Quantity::A));
    let fitted_a = fitted_a.filter(|a| a.determined).map(|a| a.value);
    let given = form.given.iter().map(|(quantity, _)| symbol(*quantity));
    let mut reduction = Reduction {
        runs: Vec::new(),
        experiments: Vec::new(),
        stacks: stacks(&records),
        relaxations: relaxations(&records),
        direct_effect: options.direct_effect.or(fitted_a),
        models: Vec::new(),
        given: given.collect::<Vec<_>>().join(", "),
        fitted,
    };
    for (record, group) in joined.into_iter().zip(groups) {
        let names = group.iter().map(|k| names[*k].clone());
        reduction.runs.push(names.collect());
        let models = predictions(&record, &reduction.fitted[0], d_c);
        reduction.models.push(models);
        reduction.experiments.push(Experiment::of(record, d_c));
    }
    reduction
}

/// What the fitted laws predict for a record.
fn predictions(
    record: &SliderRecord,
    fitted: &Fitted,
    d_c: Option<f64>,
) -> Vec<(Evolution, Experiment)> {
    let predictions = fitted.fits.iter().filter_map(|(law, fit)| {
        let record = modelled(record, &fit.as_ref().ok()?.model).ok()?;
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
        let views = views.map(|(experiment, models)| figures::View {
            experiment,
            models,
            given: &self.given,
        });
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

/// A velocity: as it was imposed if that is short, else with four significant digits.
fn speed(velocity: f64) -> String {
    const LONGEST: usize = 8;
    let whole = velocity.to_string();
    if whole.len() <= LONGEST {
        whole
    } else {
        digits(velocity)
    }
}

/// Symbol of a quantity.
fn symbol(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::A => "a",
        Quantity::B => "b",
        Quantity::AMinusB => "a - b",
        Quantity::Dc => "D_c",
        Quantity::MuStar => "μ*",
        Quantity::SecondB => "b_2",
        Quantity::SecondDc => "D_c2",
        Quantity::Stiffness => "k/N",
        Quantity::Trend => "trend",
    }
}

/// Writes an estimate with its interval, or that it was given.
fn shown(fit: &Fit, quantity: Quantity) -> Option<String> {
    let Estimate {
        value,
        interval,
        determined,
    } = fit.estimate(quantity)?;
    let is_of_length = matches!(
        quantity,
        Quantity::Dc | Quantity::SecondDc | Quantity::Stiffness | Quantity::Trend
    );
    let number = if is_of_length { digits } else { decimals };
    let [low, high] = interval;
    let [least, most] = interval.map(number);
    Some(if fit.given.contains(&quantity) {
        format!("{} (given)", number(value))
    } else if determined {
        format!("{} ({least} … {most})", number(value))
    } else if high.is_finite() {
        format!("not determined ({least} … {most})")
    } else if low > 0.0 {
        format!("not determined (> {least})")
    } else {
        "not determined".into()
    })
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
            let [before, after] = healing.velocities.map(speed);
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
                speed(growth.before)
            ),
            format!("{:.5} ± {:.5}", growth.slope, growth.error),
        ]);
    }
    for (name, law, fit, _) in reduction.fits() {
        let text = match fit {
            Ok(fit) => {
                let all = Quantity::ALL.into_iter().filter(|q| *q != Quantity::MuStar);
                let texts = all.filter_map(|quantity| {
                    let unit = match quantity {
                        Quantity::Dc | Quantity::SecondDc => " (m)",
                        Quantity::Stiffness | Quantity::Trend => " (1/m)",
                        _ => "",
                    };
                    Some(format!(
                        "{}{unit} = {}",
                        symbol(quantity),
                        shown(fit, quantity)?
                    ))
                });
                texts.collect::<Vec<_>>().join("; ")
            }
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
            speed(growth.before)
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
        let [before, after] = healing.velocities.map(speed);
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
    let [before, after] = stack.velocities.map(speed);
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
        speed(relaxation.before),
        digits(relaxation.time),
        relaxation.change,
    )
}

fn print_fits(reduction: &Reduction, printer: &mut Printer) -> Result<()> {
    writeln!(
        printer,
        "{:<18}{:<7}{:<33}{:<33}{:<33}{:<10}{:>9}",
        "fit to", "law", "a", "b", "D_c (m)", "rms", "χ²"
    )?;
    for (name, law, fit, chi) in reduction.fits() {
        let law = law.name();
        match fit {
            Ok(fit) => writeln!(
                printer,
                "{name:<18}{law:<7}{:<33}{:<33}{:<33}{:<10.2e}{:>9.1}",
                shown(fit, Quantity::A).unwrap_or_default(),
                shown(fit, Quantity::B).unwrap_or_default(),
                shown(fit, Quantity::Dc).unwrap_or_default(),
                fit.rms,
                chi.unwrap_or(f64::NAN)
            )?,
            Err(why) => writeln!(printer, "{name:<18}{law:<7}no fit: {why}")?,
        }
        let further = [
            (Quantity::SecondB, "b_2"),
            (Quantity::SecondDc, "D_c2 (m)"),
            (Quantity::Stiffness, "k/N (1/m)"),
            (Quantity::Trend, "trend (1/m)"),
        ];
        for (quantity, name) in further {
            if let Some(text) = fit.as_ref().ok().and_then(|fit| shown(fit, quantity)) {
                writeln!(printer, "{:25}{name} {text}", "")?;
            }
        }
    }
    Ok(())
}
