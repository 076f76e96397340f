//! Figures of `rate-state`: like S1 and S2 of FR's supplement, healing, and the fit over the data.

use std::ops::Range;

use plotters::style::RGBColor;

use super::colour::{AGING_LAW, GREY, INK, SLIP_LAW, VIRIDIS};
use super::plot::{Layout, Plot, figure};
use super::stress::{decimate, padded};
use super::ticks::{self, Tick};
use crate::analysis::rate_state::{Evolution, Experiment, Fit, Hold};

const LAYOUT: Layout = Layout {
    size: [900.0, 460.0],
    margin: [78.0, 36.0, 24.0, 58.0],
};
/// Curves that the legend names, at most.
const NAMED: usize = 4;

/// An experiment, and what the laws that fit make of it.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    pub experiment: &'a Experiment,
    pub models: &'a [(Evolution, Experiment)],
}

/// Names and SVG of the figures that the experiments have something for; `best`: the fit to all of them whose D_c is the unit of slip.
pub fn all(views: &[View], best: Option<&Fit>) -> Vec<(String, String)> {
    let mut figures = Vec::new();
    for (k, view) in views.iter().enumerate() {
        let name = if views.len() == 1 {
            "fit.svg".to_string()
        } else {
            format!("fit-{k}.svg")
        };
        figures.push((name, fit_over_data(view)));
    }
    let mut add = |name: &str, svg: Option<String>| {
        figures.extend(svg.map(|svg| (name.to_string(), svg)));
    };
    add("steps.svg", steps(views));
    add("holds.svg", holds(views));
    add("reslides.svg", reslides(views, best, None));
    let offset = peak_offset(views);
    add(
        "reslides-normalised.svg",
        offset.and_then(|c| reslides(views, best, Some(c))),
    );
    add("healing.svg", healing(views));
    figures
}

/// A line of data with its band, and the same of the models.
struct Curve {
    name: String,
    /// Mean, lower and upper edge at each x; no edges where there is one realisation.
    points: Vec<[f64; 2]>,
    band: Vec<[f64; 3]>,
    models: Vec<(Evolution, Vec<[f64; 2]>)>,
}

impl Curve {
    /// Rows of a view with x of a row and y = scale · (μ - the reference of data or model).
    fn of(
        view: &View,
        name: String,
        rows: &Range<usize>,
        x: impl Fn(usize) -> f64,
        y: impl Fn(&Experiment, f64) -> f64,
    ) -> Self {
        let points = |e: &Experiment| -> Vec<[f64; 2]> {
            let place = |row: usize| [x(row), y(e, e.record.friction[row])];
            rows.clone()
                .map(place)
                .filter(|p| p[0].is_finite() && p[1].is_finite())
                .collect()
        };
        let record = &view.experiment.record;
        let edges = |row: usize| {
            let (mean, reach) = (record.friction[row], 2.0 * record.deviation[row]);
            let [low, high] = [mean - reach, mean + reach].map(|f| y(view.experiment, f));
            [x(row), low, high]
        };
        let band = rows
            .clone()
            .map(edges)
            .filter(|e| e.iter().all(|v| v.is_finite()));
        Curve {
            name,
            points: points(view.experiment),
            band: band.collect(),
            models: view
                .models
                .iter()
                .map(|(law, model)| (*law, points(model)))
                .collect(),
        }
    }
}

fn colour_of(law: Evolution) -> RGBColor {
    match law {
        Evolution::Aging => AGING_LAW,
        Evolution::Slip => SLIP_LAW,
    }
}

/// Colour of curve k of n, in their order.
fn colour_at(k: usize, n: usize) -> RGBColor {
    VIRIDIS.at(0.85 * k as f64 / (n.max(2) - 1) as f64)
}

/// The curves on one pair of axes, models over data.
fn draw(curves: &[Curve], x: [f64; 2], x_ticks: &[Tick], labels: [&str; 2]) -> String {
    // The rise at the left end, over an instant, does not set the scale.
    let begin = x[0] + 0.005 * (x[1] - x[0]);
    let within = |p: &&[f64; 2]| (begin..=x[1]).contains(&p[0]);
    let edges = |c: &Curve| {
        c.band
            .iter()
            .flat_map(|e| [[e[0], e[1]], [e[0], e[2]]])
            .collect::<Vec<_>>()
    };
    let heights: Vec<f64> = curves
        .iter()
        .flat_map(|c| {
            c.points
                .iter()
                .copied()
                .chain(edges(c))
                .chain(c.models.iter().flat_map(|(_, m)| m.iter().copied()))
                .collect::<Vec<_>>()
        })
        .filter(|p| within(&p))
        .map(|p| p[1])
        .collect();
    let y = padded(heights.into_iter(), 0.06);
    let n = curves.len();
    figure(LAYOUT, x, y, |plot| {
        let y_ticks = ticks::round(y[0], y[1], 6);
        plot.grid(x_ticks, &y_ticks);
        for (k, curve) in curves.iter().enumerate() {
            band(plot, &curve.band, colour_at(k, n));
        }
        for (k, curve) in curves.iter().enumerate() {
            thinned(plot, &curve.points, colour_at(k, n), 1.2);
        }
        for (law, points) in curves.iter().flat_map(|c| &c.models) {
            thinned(plot, points, colour_of(*law), 1.6);
        }
        plot.clip();
        plot.axes(x_ticks, &y_ticks, labels[0], labels[1]);
        let step = n.div_ceil(NAMED).max(1);
        let named = curves.iter().enumerate().step_by(step);
        let mut legend: Vec<(RGBColor, &str)> = named
            .map(|(k, c)| (colour_at(k, n), c.name.as_str()))
            .collect();
        legend.extend(law_legend(
            curves
                .iter()
                .flat_map(|c| c.models.iter().map(|(law, _)| *law)),
        ));
        plot.legend(&legend);
    })
}

fn law_legend(laws: impl Iterator<Item = Evolution>) -> Vec<(RGBColor, &'static str)> {
    let mut seen: Vec<Evolution> = Vec::new();
    laws.for_each(|law| {
        if !seen.contains(&law) {
            seen.push(law);
        }
    });
    let entry = |law: Evolution| match law {
        Evolution::Aging => (AGING_LAW, "aging law"),
        Evolution::Slip => (SLIP_LAW, "slip law"),
    };
    seen.into_iter().map(entry).collect()
}

fn thinned(plot: &mut Plot, points: &[[f64; 2]], colour: RGBColor, width: f64) {
    let points = decimate(points, 1.0 / plot.scale());
    if points.len() > 1 {
        plot.line(&points, colour, width);
    }
}

fn band(plot: &mut Plot, edges: &[[f64; 3]], colour: RGBColor) {
    let column = 2.0 / plot.scale();
    let edge = |c: usize| {
        let points: Vec<[f64; 2]> = edges.iter().map(|e| [e[0], e[c]]).collect();
        decimate(&points, column)
    };
    let (mut outline, upper) = (edge(1), edge(2));
    outline.extend(upper.into_iter().rev());
    if outline.len() > 2 {
        plot.area(&outline, colour, 0.22);
    }
}

/// μ against slip over the whole record.
fn fit_over_data(view: &View) -> String {
    let record = &view.experiment.record;
    let slip = |row: usize| 1e3 * (record.slip[row] - record.slip[0]);
    let rows = 0..record.time.len();
    let mut curve = Curve::of(view, "mean".into(), &rows, slip, |_, friction| friction);
    // A single realisation is all that there is to see.
    curve.name = match record.realisations {
        1 => "run".into(),
        n => format!("mean of {n} runs, 2σ"),
    };
    let x = padded(curve.points.iter().map(|p| p[0]), 0.0);
    let x_ticks = ticks::round(x[0], x[1], 9);
    draw(&[curve], x, &x_ticks, ["slip (mm)", "friction μ"])
}

/// μ - μ_ss against slip since each velocity step.
fn steps(views: &[View]) -> Option<String> {
    let mut curves = Vec::new();
    for view in views {
        let record = &view.experiment.record;
        for (n, step) in view.experiment.steps.iter().enumerate() {
            let rows = record.rows(step.segment);
            let start = record.slip[rows.start - 1];
            let name = format!(
                "{} → {} m/s",
                short(step.velocities[0]),
                short(step.velocities[1])
            );
            let before = step.segment - 1;
            let reference = move |e: &Experiment, friction: f64| {
                let steady = e.steady[before].map_or(f64::NAN, |s| s.friction);
                if n < e.steps.len() {
                    friction - steady
                } else {
                    f64::NAN
                }
            };
            let slip = |row: usize| 1e3 * (record.slip[row] - start);
            curves.push(Curve::of(view, name, &rows, slip, reference));
        }
    }
    let longest = curves.iter().filter_map(|c| c.points.last()).map(|p| p[0]);
    let x = [0.0, longest.fold(0.0, f64::max)];
    (x[1] > 0.0).then(|| {
        let x_ticks = ticks::round(x[0], x[1], 9);
        draw(
            &curves,
            x,
            &x_ticks,
            ["slip since the velocity step (mm)", "μ − μ_{ss}(V_{1})"],
        )
    })
}

/// Every hold of every view with its μ_ss before, in order of t_hold.
fn all_holds<'a>(views: &'a [View<'a>]) -> Vec<(&'a View<'a>, &'a Hold)> {
    let of = |view: &'a View<'a>| view.experiment.holds.iter().map(move |hold| (view, hold));
    let mut holds: Vec<_> = views.iter().flat_map(of).collect();
    holds.sort_by(|a, b| a.1.duration.total_cmp(&b.1.duration));
    holds
}

fn above_steady(hold: &Hold) -> impl Fn(&Experiment, f64) -> f64 + use<> {
    let before = hold.segment - 1;
    move |e, friction| friction - e.steady[before].map_or(f64::NAN, |s| s.friction)
}

/// μ - μ_ss against the time since the begin of each hold (FR, figure S1).
fn holds(views: &[View]) -> Option<String> {
    let of = |(view, hold): (&View, &Hold)| {
        let record = &view.experiment.record;
        let begin = record.begin(hold.segment);
        let name = format!("{} s from {} m/s", short(hold.duration), short(hold.before));
        let time = |row: usize| (record.time[row] - begin).log10();
        Curve::of(
            view,
            name,
            &record.rows(hold.segment),
            time,
            above_steady(hold),
        )
    };
    let curves: Vec<Curve> = all_holds(views).into_iter().map(of).collect();
    let times = || curves.iter().flat_map(|c| &c.points).map(|p| p[0]);
    let x = [
        times().fold(f64::INFINITY, f64::min),
        times().fold(f64::NEG_INFINITY, f64::max),
    ];
    (x[0] < x[1]).then(|| {
        let x_ticks = ticks::decades(x[0], x[1], 9);
        draw(
            &curves,
            x,
            &x_ticks,
            ["time since the begin of the hold (s)", "μ − μ_{ss}"],
        )
    })
}

/// Slip in D_c that the reslides are shown over.
const RESLIDE: f64 = 8.0;

/// μ - μ_ss against slip since the end of each hold in units of D_c (FR, figure S2a), or that over C + ln(V_r/V_i) (S2b).
fn reslides(views: &[View], best: Option<&Fit>, offset: Option<f64>) -> Option<String> {
    let (unit, x_label) = match best {
        Some(fit) => (fit.law.d_c, "slip since the end of the hold / D_{c}"),
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
        let name = format!(
            "{} s, V_{{r}}/V_{{i}}: {}",
            short(hold.duration),
            short(ratio)
        );
        let slip = |row: usize| (record.slip[row] - start) / unit;
        let above = above_steady(hold);
        curves.push(Curve::of(view, name, &rows, slip, move |e, f| {
            scale * above(e, f)
        }));
    }
    let longest = curves
        .iter()
        .filter_map(|c| c.points.last())
        .map(|p| p[0])
        .fold(0.0, f64::max);
    let x = [
        0.0,
        if best.is_some() {
            longest.min(RESLIDE)
        } else {
            longest
        },
    ];
    let y_label = match offset {
        Some(c) => format!("(μ − μ_{{ss}})/({c:.2} + ln(V_{{r}}/V_{{i}}))"),
        None => "μ − μ_{ss}".to_string(),
    };
    (x[1] > 0.0).then(|| {
        let x_ticks = ticks::round(x[0], x[1], 9);
        draw(&curves, x, &x_ticks, [x_label, &y_label])
    })
}

/// C, so that the peaks of the holds of equal duration go like C + ln(V_r/V_i); `None` where no two velocity ratios share a duration.
fn peak_offset(views: &[View]) -> Option<f64> {
    let of = |(_, hold): (&View, &Hold)| {
        let reslide = hold.reslide?;
        Some((
            hold.duration,
            (reslide.velocity / hold.before).ln(),
            reslide.healing,
        ))
    };
    let peaks: Vec<(f64, f64, f64)> = all_holds(views).into_iter().filter_map(of).collect();
    // Durations are in order; protocols repeat them to rounding.
    let groups = peaks.chunk_by(|a, b| (a.0 - b.0).abs() <= 1e-3 * b.0);
    let offsets = groups.filter_map(|group| {
        let n = group.len() as f64;
        let (x, y) = (
            group.iter().map(|p| p.1).sum::<f64>() / n,
            group.iter().map(|p| p.2).sum::<f64>() / n,
        );
        let spread: f64 = group.iter().map(|p| (p.1 - x) * (p.1 - x)).sum();
        let slope = group.iter().map(|p| (p.1 - x) * (p.2 - y)).sum::<f64>() / spread;
        (spread > 1e-6 && slope > 0.0).then(|| (y / slope - x, spread))
    });
    let (sum, weight) = offsets.fold((0.0, 0.0), |(s, w), (c, spread)| {
        (s + c * spread, w + spread)
    });
    (weight > 0.0).then(|| sum / weight)
}

/// Δμ against ln t_hold: measured with 2 standard errors, its line, and the laws.
fn healing(views: &[View]) -> Option<String> {
    let point = |hold: &Hold| {
        Some([
            hold.duration.log10(),
            hold.reslide?.healing,
            hold.reslide?.error,
        ])
    };
    let all = all_holds(views);
    let points: Vec<[f64; 3]> = all.iter().filter_map(|(_, hold)| point(hold)).collect();
    let fits: Vec<_> = views
        .iter()
        .flat_map(|view| view.experiment.healing.iter().map(move |h| (view, h)))
        .collect();
    if fits.is_empty() {
        return None;
    }
    let x = padded(points.iter().map(|p| p[0]), 0.08);
    let models: Vec<(Evolution, Vec<[f64; 2]>)> = fits
        .iter()
        .flat_map(|(view, healing)| {
            let of = |(law, model): &(Evolution, Experiment)| {
                let points = healing
                    .holds
                    .iter()
                    .filter_map(|k| point(model.holds.get(*k)?));
                let mut points: Vec<[f64; 2]> = points.map(|p| [p[0], p[1]]).collect();
                points.sort_by(|a, b| a[0].total_cmp(&b[0]));
                (*law, points)
            };
            view.models.iter().map(of).collect::<Vec<_>>()
        })
        .collect();
    let heights = points
        .iter()
        .flat_map(|p| [p[1] - 2.0 * p[2], p[1] + 2.0 * p[2]]);
    let of_models = models.iter().flat_map(|(_, m)| m.iter().map(|p| p[1]));
    let y = padded(heights.chain(of_models), 0.08);
    let decades = ticks::decades(x[0], x[1], 9);
    let x_ticks = if decades.len() > 1 {
        decades
    } else {
        points
            .iter()
            .map(|p| (p[0], short(10f64.powf(p[0]))))
            .collect()
    };
    Some(figure(LAYOUT, x, y, |plot| {
        let y_ticks = ticks::round(y[0], y[1], 6);
        plot.grid(&x_ticks, &y_ticks);
        for (law, points) in &models {
            plot.line(points, colour_of(*law), 1.6);
        }
        let ln_10 = std::f64::consts::LN_10;
        for (_, healing) in &fits {
            let at = |x: f64| [x, healing.intercept + healing.slope * x * ln_10];
            plot.line(&[at(x[0]), at(x[1])], GREY, 1.2);
        }
        for [at, value, error] in &points {
            plot.line(
                &[[*at, value - 2.0 * error], [*at, value + 2.0 * error]],
                INK,
                1.2,
            );
            plot.disk([*at, *value], 4.0, INK, None);
        }
        plot.clip();
        plot.axes(&x_ticks, &y_ticks, "hold time (s)", "healing Δμ");
        let slope = format!("slope {:.4} per factor e", fits[0].1.slope);
        let mut legend = vec![
            (INK, "peak − μ_{ss}, ±2 standard errors"),
            (GREY, slope.as_str()),
        ];
        legend.extend(law_legend(models.iter().map(|(law, _)| *law)));
        plot.legend(&legend);
    }))
}

/// A number with three digits, for names.
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
