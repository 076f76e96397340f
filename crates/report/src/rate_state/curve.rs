//! Curves of μ with their bands and the friction that the laws predict, on one pair of axes.

use std::ops::Range;

use plotters::style::RGBColor;

use super::View;
use crate::colour::{AGING_LAW, FORCE, SLIP_LAW};
use crate::curves::{decimate, padded, thinned};
use crate::plot::{Layout, Plot, figure};
use crate::ticks::{self, Tick};
use gshear_analysis::moments::distinct;
use gshear_analysis::rate_state::{Evolution, Experiment};

pub(super) const LAYOUT: Layout = Layout::new([900.0, 460.0], 88.0);
/// Greatest number of curves named in the legend.
const NAMED: usize = 3;

/// A measured curve with its band, and the curves of the laws.
pub(super) struct Curve {
    /// Name in the legend.
    pub(super) name: String,
    /// Measured points.
    pub(super) points: Vec<[f64; 2]>,
    /// x, lower and upper edge; empty for a single realisation.
    band: Vec<[f64; 3]>,
    /// Points of each law.
    models: Vec<(Evolution, Vec<[f64; 2]>)>,
    /// Symbols of the given parameters.
    given: String,
}

impl Curve {
    /// Takes rows of a view, with x by row and y by experiment and friction.
    pub(super) fn of(
        view: &View,
        name: String,
        rows: &Range<usize>,
        x: impl Fn(usize) -> f64,
        y: impl Fn(&Experiment, f64) -> f64,
    ) -> Self {
        let record = &view.experiment.record;
        let band = rows.clone().map(|row| {
            let (mean, reach) = (record.friction[row], 2.0 * record.deviation[row]);
            let [low, high] = [mean - reach, mean + reach].map(|f| y(view.experiment, f));
            [x(row), low, high]
        });
        let models = view.models.iter();
        Curve {
            name,
            points: points(view.experiment, rows, &x, &y),
            band: band.filter(|e| e.iter().all(|v| v.is_finite())).collect(),
            models: models
                .map(|(law, model)| (*law, points(model, rows, &x, &y)))
                .collect(),
            given: view.given.to_string(),
        }
    }
}

/// The finite points of some rows of an experiment.
fn points(
    experiment: &Experiment,
    rows: &Range<usize>,
    x: impl Fn(usize) -> f64,
    y: impl Fn(&Experiment, f64) -> f64,
) -> Vec<[f64; 2]> {
    let friction = &experiment.record.friction;
    let places = rows
        .clone()
        .map(|row| [x(row), y(experiment, friction[row])]);
    places.filter(|p| p.iter().all(|x| x.is_finite())).collect()
}

/// Colour of a law.
pub(super) fn colour_of(law: Evolution) -> RGBColor {
    match law {
        Evolution::Aging => AGING_LAW,
        Evolution::Slip => SLIP_LAW,
    }
}

/// Colour of curve k of n: shades of blue, which the laws do not use.
fn colour_at(k: usize, n: usize) -> RGBColor {
    FORCE.at(1.0 - 0.7 * k as f64 / (n.max(2) - 1) as f64)
}

/// Draws the curves on one pair of axes, laws on top of the data. `ticks_of`: about so many ticks
/// of a range.
pub(super) fn draw(
    curves: &[Curve],
    x: [f64; 2],
    ticks_of: fn(f64, f64, usize) -> Vec<Tick>,
    labels: [&str; 2],
) -> String {
    let x_ticks = ticks_of(x[0], x[1], 9);
    // The jump at the left end does not count for the scale.
    let begin = x[0] + 0.005 * (x[1] - x[0]);
    let shown = curves.iter().flat_map(|curve| {
        let models = curve.models.iter().flat_map(|(_, points)| points);
        let points = curve.points.iter().chain(models).copied();
        let edges = curve.band.iter();
        points.chain(edges.flat_map(|[x, low, high]| [[*x, *low], [*x, *high]]))
    });
    let heights = shown
        .filter(|p| (begin..=x[1]).contains(&p[0]))
        .map(|p| p[1]);
    let y = padded(heights, 0.06);
    let n = curves.len();
    figure(LAYOUT, x, y, |plot| {
        let y_ticks = ticks::round(y[0], y[1], 6);
        plot.grid(&x_ticks, &y_ticks);
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
        plot.axes(&x_ticks, &y_ticks, labels[0], labels[1]);
        let step = n.div_ceil(NAMED).max(1);
        let named = curves.iter().enumerate().step_by(step);
        let named = named.map(|(k, c)| (colour_at(k, n), &*c.name));
        let mut legend: Vec<(RGBColor, &str)> = named.collect();
        let models = curves.iter().flat_map(|c| &c.models);
        let given = curves.first().map_or("", |curve| &curve.given);
        let laws = law_legend(models.map(|(law, _)| *law), given);
        legend.extend(laws.iter().map(|(colour, name)| (*colour, &**name)));
        plot.legend(&legend);
    })
}

/// Legend entries of the laws, each once, with the parameters that were given.
pub(super) fn law_legend(
    laws: impl Iterator<Item = Evolution>,
    given: &str,
) -> Vec<(RGBColor, String)> {
    let of_given = match given {
        "" => String::new(),
        names => format!(
            ", {} given",
            names.replace("D_c2", "D_{c2}").replace("D_c", "D_{c}")
        ),
    };
    let entries = distinct(laws).into_iter();
    let entries = entries.map(|law| (colour_of(law), format!("{} law{of_given}", law.name())));
    entries.collect()
}

fn band(plot: &mut Plot, edges: &[[f64; 3]], colour: RGBColor) {
    let [mut outline, upper] = [1, 2].map(|c| {
        let points: Vec<[f64; 2]> = edges.iter().map(|e| [e[0], e[c]]).collect();
        decimate(&points, 2.0 / plot.scale())
    });
    outline.extend(upper.into_iter().rev());
    if outline.len() > 2 {
        plot.area(&outline, colour, 0.22);
    }
}
