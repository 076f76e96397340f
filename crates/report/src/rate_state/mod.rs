//! Figures of `gshear-reduce rate-state`: those of FR's supplement (S1 and S2), healing, and the
//! fit over the data.

mod curve;
mod healing;

use self::curve::{Curve, draw};
use self::healing::{healing, peak_offset};
use super::curves::padded;
use super::drawing::Format;
use super::ticks;
use crate::page;
use crate::text::escape;
use gshear_analysis::moments::extent;
use gshear_analysis::rate_state::{Evolution, Experiment, Fit, Hold};

/// An experiment and the predictions of the fitted laws for it.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    /// The measured experiment.
    pub experiment: &'a Experiment,
    /// Each law with the experiment it predicts.
    pub models: &'a [(Evolution, Experiment)],
    /// Symbols of the parameters that were given and not fitted; may be empty.
    pub given: &'a str,
}

/// Returns name and SVG of every figure for which the experiments have data. `best`: the fit whose
/// D_c is the unit of slip.
pub fn all(views: &[View], best: Option<&Fit>) -> Vec<(String, String)> {
    let mut figures = Vec::new();
    for (k, view) in views.iter().enumerate() {
        let name = match views.len() {
            1 => "fit.svg".to_string(),
            _ => format!("fit-{k}.svg"),
        };
        figures.push((name, fit_over_data(view)));
    }
    let normalised = match peak_offset(views) {
        Some(offset) => reslides(views, best, Some(offset)),
        None => None,
    };
    for (name, svg) in [
        ("steps.svg", steps(views)),
        ("holds.svg", holds(views)),
        ("reslides.svg", reslides(views, best, None)),
        ("reslides-normalised.svg", normalised),
        ("healing.svg", healing(views)),
    ] {
        figures.extend(svg.map(|svg| (name.to_string(), svg)));
    }
    figures
}

/// Returns a page with these figures, names and SVG, and a table of names and texts. `place`: where
/// the tables are.
pub fn page(
    figures: &[(String, String)],
    rows: &[[String; 2]],
    formats: &[Format],
    place: &str,
) -> String {
    let rows = rows.iter();
    let rows = rows.map(|[name, value]| (escape(name), escape(value)));
    let mut body = page::table(rows) + "<h2>Figures</h2>\n";
    for (name, svg) in figures {
        let caption = CAPTIONS.iter().find(|(start, _)| name.starts_with(start));
        let name = name.trim_end_matches(".svg");
        let data = match name {
            "healing" => "holds.csv",
            _ => "rate-state.csv",
        };
        let caption = caption.map_or("", |(_, caption)| caption);
        body += &page::figure(name, caption, data, svg, formats);
    }
    let lead = format!(
        "Fits with intervals of 95 %. The tables are in {}; gshear-reduce columns explains them.",
        escape(place)
    );
    page::document("Rate-and-state friction", &lead, &body)
}

/// Captions by the beginning of the name of a figure.
const CAPTIONS: [(&str, &str); 6] = [
    (
        "fit",
        "Friction over slip, and the laws fitted to all data (with given parameters, their prediction).",
    ),
    ("steps", "Friction after the velocity steps."),
    ("holds", "Relaxation in the holds."),
    (
        "reslides-normalised",
        "Slides after the holds, less the peak that the hold time gives.",
    ),
    ("reslides", "Slides after the holds."),
    ("healing", "Healing over the hold time."),
];

/// Draws μ against slip over the whole record.
fn fit_over_data(view: &View) -> String {
    let record = &view.experiment.record;
    let rows = 0..record.time.len();
    let mut curve = Curve::of(
        view,
        "mean".into(),
        &rows,
        |row| 1e3 * (record.slip[row] - record.slip[0]),
        |_, friction| friction,
    );
    // A single realisation has no band.
    curve.name = match record.realisations {
        1 => "data".into(),
        n => format!("mean of {n} runs, 2σ"),
    };
    let x = padded(curve.points.iter().map(|p| p[0]), 0.0);
    draw(&[curve], x, ticks::round, ["slip (mm)", "friction μ"])
}

/// Draws μ - μ_ss against slip since each velocity step.
fn steps(views: &[View]) -> Option<String> {
    let mut curves = Vec::new();
    for view in views {
        let record = &view.experiment.record;
        for (n, step) in view.experiment.steps.iter().enumerate() {
            let rows = record.rows(step.segment);
            let start = record.slip[rows.start - 1];
            let [before, after] = step.velocities.map(short);
            let name = format!("{before} → {after} m/s");
            curves.push(Curve::of(
                view,
                name,
                &rows,
                |row| 1e3 * (record.slip[row] - start),
                |e, friction| match e.steps.get(n) {
                    Some(_) => above_steady(e, step.segment - 1, friction),
                    None => f64::NAN,
                },
            ));
        }
    }
    let labels = ["slip since the velocity step (mm)", "μ − μ_{ss}(V_{1})"];
    let x = [0.0, longest(&curves)];
    (x[1] > 0.0).then(|| draw(&curves, x, ticks::round, labels))
}

/// The greatest slip that a curve reaches.
fn longest(curves: &[Curve]) -> f64 {
    let last = curves.iter().filter_map(|c| c.points.last());
    last.map(|p| p[0]).fold(0.0, f64::max)
}

/// The holds of all views in order of t_hold.
fn all_holds<'a>(views: &'a [View<'a>]) -> Vec<(&'a View<'a>, &'a Hold)> {
    let mut holds = Vec::new();
    for view in views {
        holds.extend(view.experiment.holds.iter().map(|hold| (view, hold)));
    }
    holds.sort_by(|a, b| a.1.duration.total_cmp(&b.1.duration));
    holds
}

/// μ - μ_ss of the segment `before`.
fn above_steady(experiment: &Experiment, before: usize, friction: f64) -> f64 {
    friction - experiment.steady[before].map_or(f64::NAN, |steady| steady.friction)
}

/// Draws μ - μ_ss against the time since the start of each hold (FR, figure S1).
fn holds(views: &[View]) -> Option<String> {
    let mut curves = Vec::new();
    for (view, hold) in all_holds(views) {
        let record = &view.experiment.record;
        let begin = record.begin(hold.segment);
        let rows = record.rows(hold.segment);
        let interval = record.time[rows.start] - record.time[rows.start - 1];
        let name = format!("{} s from {} m/s", short(hold.duration), short(hold.before));
        curves.push(Curve::of(
            view,
            name,
            &rows,
            |row| {
                let since = record.time[row] - begin;
                // A first row that happens to lie at the start would add decades to the axis.
                if since < 0.5 * interval {
                    f64::NAN
                } else {
                    since.log10()
                }
            },
            |e, friction| above_steady(e, hold.segment - 1, friction),
        ));
    }
    let x = extent(curves.iter().flat_map(|c| &c.points).map(|p| p[0]));
    let labels = ["time since the start of the hold (s)", "μ − μ_{ss}"];
    (x[0] < x[1]).then(|| draw(&curves, x, ticks::decades, labels))
}

/// Greatest slip shown after a hold, in D_c.
const RESLIDE: f64 = 8.0;

/// Draws μ - μ_ss against slip since the end of each hold in D_c (FR, figure S2a). With an `offset`
/// C it draws that over the sum C + ln(V_r/V_i) (S2b).
fn reslides(views: &[View], best: Option<&Fit>, offset: Option<f64>) -> Option<String> {
    let (unit, x_label) = match best {
        Some(fit) => (fit.model.law.d_c, "slip since the end of the hold / D_{c}"),
        None => (1e-3, "slip since the end of the hold (mm)"),
    };
    let mut curves = Vec::new();
    for (view, hold) in all_holds(views) {
        let Some(reslide) = hold.reslide else {
            continue;
        };
        let record = &view.experiment.record;
        let rows = record.rows(hold.segment + 1);
        let start = record.slip[rows.start - 1];
        let ratio = reslide.velocity / hold.before;
        let scale = offset.map_or(1.0, |c| (c + ratio.ln()).recip());
        let [duration, times] = [hold.duration, ratio].map(short);
        let name = format!("{duration} s, V_{{r}}/V_{{i}}: {times}");
        curves.push(Curve::of(
            view,
            name,
            &rows,
            |row| (record.slip[row] - start) / unit,
            |e, friction| scale * above_steady(e, hold.segment - 1, friction),
        ));
    }
    let most = best.map_or(f64::INFINITY, |_| RESLIDE);
    let x = [0.0, longest(&curves).min(most)];
    let y_label = match offset {
        Some(c) => format!("(μ − μ_{{ss}})/({c:.2} + ln(V_{{r}}/V_{{i}}))"),
        None => "μ − μ_{ss}".to_string(),
    };
    (x[1] > 0.0).then(|| draw(&curves, x, ticks::round, [x_label, &y_label]))
}

/// A number with three significant digits.
fn short(value: f64) -> String {
    let power = value.abs().log10().floor();
    if !(-3.0..5.0).contains(&power) {
        return format!("{value:.2e}");
    }
    let decimals = (2.0 - power).max(0.0) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_string()
    } else {
        text
    }
}
