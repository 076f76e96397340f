//! `rate-state`: reduces velocity steps and slide-hold-slide tests, and fits rate-and-state
//! parameters.

mod read;
mod tables;

use std::io::Write;
use std::path::Path;

use clap::ValueEnum;

use crate::output::cannot_write;
use gshear_analysis::rate_state::{
    Estimate, Evolution, Experiment, Fit, Fitted, PeakGrowth, Relaxation, SliderRecord, Stack,
    fit_all, jackknife, merge, modelled, peak_growth, relaxations, stacks,
};
use gshear_dem::failure::Failure;
use gshear_report::{drawing, rate_state as figures};
use gshear_store::run_reader::RunFile;
use gshear_store::{dictionary, text_writer};

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
    (laws, direct_effect): (Laws, Option<f64>),
    folder: &Path,
    output: &mut impl Write,
) -> Result<(), Failure> {
    let reduction = reduce(runs, laws, direct_effect)?;
    let mut files = tables::files(&reduction);
    let views: Vec<figures::View> = reduction.views();
    let drawn = figures::all(&views, reduction.fitted[0].best());
    let page = figures::page(
        &drawn,
        &page_rows(&reduction),
        &folder.display().to_string(),
    );
    let figures = drawn.iter().map(|(name, svg)| (folder.join(name), &**svg));
    let written = drawing::write_all(&figures.collect::<Vec<_>>())?;
    files.push(("index.html".into(), page));
    for (name, text) in &files {
        let path = folder.join(name);
        if path.extension().is_some_and(|of| of == "csv") {
            dictionary::write_table(&path, text)?;
        } else {
            text_writer::write(&path, text)?;
        }
    }
    summary(&reduction, output).map_err(cannot_write)?;
    writeln!(
        output,
        "wrote {} files into {}",
        files.len() + written,
        folder.display()
    )
    .map_err(cannot_write)
}

/// Whether a run is under a spring and has velocity steps or holds.
pub fn is_test(run: &RunFile) -> bool {
    read::record(run).is_ok()
}

fn reduce(runs: &[RunFile], laws: Laws, direct_effect: Option<f64>) -> Result<Reduction, Failure> {
    for (k, run) in runs.iter().enumerate() {
        let same = |other: &&RunFile| other.digest().is_some() && other.digest() == run.digest();
        if let Some(other) = runs[..k].iter().find(same) {
            return Err(Failure::input(format!(
                "{} and {} are the same run (equal digests); realisations differ by their seed",
                other.path().display(),
                run.path().display()
            )));
        }
    }
    let records: Vec<SliderRecord> = runs.iter().map(read::record).collect::<Result<_, _>>()?;
    let (joined, groups): (Vec<SliderRecord>, Vec<Vec<usize>>) =
        merge(&records).into_iter().unzip();
    let mut fitted = fit_all(&joined, laws.list());
    if let Some(spread) = jackknife(&records, &groups, &fitted[0]) {
        fitted.insert(1, spread);
    }
    let stacks = stacks(&records);
    let relaxations = relaxations(&records);
    let records = joined;
    let d_c = fitted[0].best().map(|fit| fit.law.d_c);
    let of_fit = fitted[0].best().filter(|fit| fit.a.determined);
    let of_fit = of_fit.map(|fit| fit.a.value);
    let models = |record: &SliderRecord| -> Vec<(Evolution, Experiment)> {
        let of = |(law, fit): &(Evolution, Result<Fit, String>)| {
            let record = modelled(record, &fit.as_ref().ok()?.law).ok()?;
            Some((*law, Experiment::of(record, d_c)))
        };
        fitted[0].fits.iter().filter_map(of).collect()
    };
    let name = |k: usize| runs[k].path().display().to_string();
    Ok(Reduction {
        models: records.iter().map(models).collect(),
        experiments: records
            .into_iter()
            .map(|r| Experiment::of(r, d_c))
            .collect(),
        runs: groups
            .iter()
            .map(|group| group.iter().map(|k| name(*k)).collect())
            .collect(),
        stacks,
        relaxations,
        direct_effect: direct_effect.or(of_fit),
        fitted,
    })
}

impl Reduction {
    /// Growth of the peaks with the velocity, over the holds of all experiments.
    fn peak_growth(&self) -> Vec<PeakGrowth> {
        peak_growth(self.experiments.iter().flat_map(|e| &e.holds))
    }

    fn views(&self) -> Vec<figures::View<'_>> {
        self.experiments
            .iter()
            .zip(&self.models)
            .map(|(experiment, models)| figures::View { experiment, models })
            .collect()
    }
}

/// A duration with four significant digits.
fn seconds(duration: f64) -> String {
    format!("{duration:.3e}")
}

/// Writes an estimate with its interval.
fn shown(e: Estimate, digits: usize) -> String {
    let [low, high] = e.interval;
    if e.determined {
        format!("{:.digits$} ({low:.digits$} … {high:.digits$})", e.value)
    } else {
        "not determined".into()
    }
}

/// Returns the table of the page: names and texts.
fn page_rows(reduction: &Reduction) -> Vec<[String; 2]> {
    let mut rows = Vec::new();
    let mut add = |name: String, text: String| rows.push([name, text]);
    for (k, (experiment, runs)) in reduction
        .experiments
        .iter()
        .zip(&reduction.runs)
        .enumerate()
    {
        let protocol = format!(
            "{} velocity steps, {} holds; k/N = {:.4e} 1/m; {}",
            experiment.steps.len(),
            experiment.holds.len(),
            experiment.record.stiffness,
            runs.join(", ")
        );
        add(format!("Experiment {k}"), protocol);
        for healing in &experiment.healing {
            let [before, after] = healing.velocities;
            add(
                format!("Healing per factor e of hold time, {before} m/s, hold, {after} m/s"),
                format!("{:.5}", healing.slope),
            );
        }
    }
    for growth in reduction.peak_growth() {
        add(
            format!(
                "Growth of {} peaks per factor e of V_r/V_i, holds of {} s after {} m/s",
                growth.peaks,
                seconds(growth.duration),
                growth.before
            ),
            format!("{:.5} ± {:.5}", growth.slope, growth.error),
        );
    }
    for fitted in reduction.fitted.iter().filter(|f| f.event.is_none()) {
        for (law, fit) in &fitted.fits {
            let name = format!("Fit to {}, {} law", fitted.name, law.name());
            let text = match fit {
                Ok(fit) => format!(
                    "a = {}; b = {}; a - b = {}; D_c (m) = {}",
                    shown(fit.a, 5),
                    shown(fit.b, 5),
                    shown(fit.a_minus_b, 5),
                    shown(fit.d_c, 6)
                ),
                Err(why) => format!("none: {why}"),
            };
            add(name, text);
        }
    }
    rows
}

/// Prints the main results.
fn summary(reduction: &Reduction, output: &mut impl Write) -> std::io::Result<()> {
    for (k, (experiment, runs)) in reduction
        .experiments
        .iter()
        .zip(&reduction.runs)
        .enumerate()
    {
        let record = &experiment.record;
        writeln!(
            output,
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
            let interval = healing
                .interval
                .map_or("from two holds".into(), |[low, high]| {
                    format!("{low:.5} … {high:.5}")
                });
            writeln!(
                output,
                "  healing {:.5} per factor e of hold time ({interval}), {before} m/s, hold, {after} m/s",
                healing.slope
            )?;
        }
    }
    for growth in reduction.peak_growth() {
        writeln!(
            output,
            "peaks after holds of {} s: {:.5} ± {:.5} per factor e of V_r/V_i, {} peaks, V_i = {} m/s",
            seconds(growth.duration),
            growth.slope,
            growth.error,
            growth.peaks,
            growth.before
        )?;
    }
    for stack in reduction.stacks.iter().filter(|s| s.pieces.len() > 1) {
        let [before, after] = stack.velocities;
        let shown = stack.pieces[1..].iter().filter(|p| p.steps > 1).map(|p| {
            let ([from, to], change, error) = (p.slip, p.change, p.error);
            format!("{change:+.4} ± {error:.4} ({from:.1e} to {to:.1e} m)")
        });
        let shown: Vec<String> = shown.step_by(2).collect();
        if !shown.is_empty() {
            writeln!(
                output,
                "  {before} → {after} m/s, mean change of μ: {}",
                shown.join(", ")
            )?;
        }
    }
    for of in &reduction.relaxations {
        let by = |a: f64, stiffness: f64| {
            if stiffness.is_finite() {
                format!("{:+.4}", of.of_direct_effect(a, stiffness))
            } else {
                "unknown".into()
            }
        };
        let law = reduction.direct_effect.map_or(String::new(), |a| {
            format!(
                ", by the direct effect {} with k/N of the spring, {} with that of the reload",
                by(a, of.stiffness),
                by(a, of.reload)
            )
        });
        let error = if of.error.is_finite() {
            format!(" ± {:.4}", of.error)
        } else {
            String::new()
        };
        writeln!(
            output,
            "hold of {} s after {} m/s, after {} s: μ {:+.4}{error}{law}, granular temperature {:.2e}",
            seconds(of.duration),
            of.before,
            seconds(of.time),
            of.change,
            of.temperature
        )?;
    }
    writeln!(
        output,
        "{:<18}{:<7}{:<30}{:<30}{:<33}{:<10}{:>9}",
        "fit to", "law", "a", "b", "D_c (m)", "rms", "χ²"
    )?;
    for fitted in reduction.fitted.iter().filter(|f| f.event.is_none()) {
        for ((law, fit), chi) in fitted.fits.iter().zip(&fitted.chi_squared) {
            let (name, law) = (fitted.name, law.name());
            match fit {
                Ok(fit) => writeln!(
                    output,
                    "{name:<18}{law:<7}{:<30}{:<30}{:<33}{:<10.2e}{:>9.1}",
                    shown(fit.a, 5),
                    shown(fit.b, 5),
                    shown(fit.d_c, 6),
                    fit.rms,
                    chi.unwrap_or(f64::NAN)
                )?,
                Err(why) => writeln!(output, "{name:<18}{law:<7}no fit: {why}")?,
            }
        }
    }
    Ok(())
}
