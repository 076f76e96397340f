//! Figures of events: when and where they are, their sizes, and their propagator.

use plotters::style::RGBColor;

use super::colour::{CHANGE, CURVES, GREY, INK, STICK};
use super::curves::padded;
use super::plot::{Layout, Plot, figure};
use super::ticks;
use gshear_analysis::events::propagator::{Harmonic, MapCell, Mode, Phase, Propagator, Quantity};
use gshear_analysis::moments::{extent, mean};

const LAYOUT: Layout = Layout::new([900.0, 440.0], 92.0);
const MAP: Layout = Layout {
    size: [760.0, 700.0],
    margin: [80.0, 36.0, 118.0, 58.0],
};
/// Radius of the disk of an event of one grain (px).
const ONE_GRAIN: f64 = 1.2;
/// Length of the longest arrows of a map over the side of a square.
const LONGEST: f64 = 1.6;
/// Share of the arrows that are as long at most.
const LONG: f64 = 0.98;

/// What figures show of an event.
#[derive(Debug, Clone, Copy)]
pub struct EventMark {
    /// γ at its start.
    pub strain: f64,
    /// Time at its start (s).
    pub time: f64,
    /// Place along the gradient (m).
    pub height: f64,
    /// Number of grains.
    pub grains: usize,
    /// Sum of the invariants of the local strain.
    pub strain_sum: f64,
}

/// Draws the events by strain and by place along the gradient; the area of a disk is the number of
/// grains. `axes`: number of dimensions.
pub fn in_strain(events: &[EventMark], axes: usize) -> String {
    let x = padded(events.iter().map(|event| event.strain), 0.02);
    let heights = extent(events.iter().map(|event| event.height));
    let (factor, unit) = ticks::prefix(heights[1]);
    let y = padded(events.iter().map(|event| factor * event.height), 0.05);
    figure(LAYOUT, x, y, |plot| {
        if events.is_empty() {
            plot.empty_note("no events");
        }
        let (x_ticks, y_ticks) = (ticks::scientific(x, 8), ticks::round(y[0], y[1], 6));
        plot.grid(&x_ticks, &y_ticks);
        for event in events {
            let radius = ONE_GRAIN * (event.grains as f64).sqrt();
            let place = [event.strain, factor * event.height];
            plot.disk(place, radius, STICK, Some(INK));
        }
        plot.clip();
        let axis = if axes == 2 { "y" } else { "z" };
        let label = format!("place of the event, {axis} ({unit}m)");
        plot.axes(&x_ticks, &y_ticks, "shear strain γ", &label);
    })
}

/// Draws the shares of events that are at least as large as a multiple of the mean: numbers of
/// grains, strains, and the times between starts.
pub fn sizes(events: &[EventMark]) -> String {
    let mut starts: Vec<f64> = events.iter().map(|event| event.time).collect();
    starts.sort_by(f64::total_cmp);
    let waiting = starts.windows(2).map(|pair| pair[1] - pair[0]);
    let curves = [
        (
            "number of grains",
            events.iter().map(|event| event.grains as f64).collect(),
        ),
        (
            "strain",
            events.iter().map(|event| event.strain_sum).collect(),
        ),
        ("waiting time", waiting.collect()),
    ]
    .map(|(name, values): (&str, Vec<f64>)| (name, shares_above(&values)));
    let points: Vec<&[f64; 2]> = curves.iter().flat_map(|(_, points)| points).collect();
    let x = padded(points.iter().map(|point| point[0]), 0.03);
    let y = padded(points.iter().map(|point| point[1]), 0.03);
    figure(LAYOUT, x, y, |plot| {
        if points.is_empty() {
            plot.empty_note("no events of different sizes");
        }
        let (x_ticks, y_ticks) = (
            ticks::decades(x[0], x[1], 10),
            ticks::decades(y[0], y[1], 8),
        );
        plot.grid(&x_ticks, &y_ticks);
        for ((_, points), colour) in curves.iter().zip(CURVES) {
            plot.line(points, colour, 1.6);
        }
        plot.clip();
        plot.axes(
            &x_ticks,
            &y_ticks,
            "size over its mean",
            "share of events of this size or more",
        );
        plot.legend(&[0, 1, 2].map(|k| (CURVES[k], curves[k].0)));
    })
}

/// The logarithms of positive values over their mean, and of the share of values at least as large;
/// each value once.
fn shares_above(values: &[f64]) -> Vec<[f64; 2]> {
    let mut sorted: Vec<f64> = values
        .iter()
        .copied()
        .filter(|value| *value > 0.0)
        .collect();
    sorted.sort_by(f64::total_cmp);
    let (count, mean) = (sorted.len() as f64, mean(&sorted));
    // Differences of times that are equal differ by rounding.
    let firsts = (0..sorted.len()).filter(|k| *k == 0 || sorted[k - 1] * (1.0 + 1e-6) < sorted[*k]);
    firsts
        .map(|k| {
            let share = (sorted.len() - k) as f64 / count;
            [(sorted[k] / mean).log10(), share.log10()]
        })
        .collect()
}

/// A curve of a figure.
struct Curve {
    name: &'static str,
    mode: Mode,
}

impl Curve {
    const fn new(name: &'static str, quantity: Quantity, order: usize, phase: Phase) -> Self {
        Self {
            name,
            mode: Mode {
                quantity,
                order,
                phase,
            },
        }
    }

    /// Its finite amplitudes in the rings. `diameter`: the mean one (m).
    fn amplitudes(&self, harmonics: &[Harmonic], diameter: f64) -> Vec<RingAmplitude> {
        let mut amplitudes = Vec::new();
        for harmonic in harmonics.iter().filter(|harmonic| !harmonic.is_far) {
            if let Some([value, error]) = self.mode.amplitude(harmonic)
                && value.is_finite()
            {
                amplitudes.push(RingAmplitude {
                    distance: harmonic.at / diameter,
                    value,
                    error: if error.is_finite() { error } else { 0.0 },
                });
            }
        }
        amplitudes
    }
}

/// Draws amplitudes of the mean displacement around an event by distance, with their standard
/// errors. `diameter`: the mean one (m).
pub fn displacement(harmonics: &[Harmonic], diameter: f64) -> String {
    let curves = [
        Curve::new("u_{r} sin 2θ", Quantity::Radial, 2, Phase::Sin),
        Curve::new("u_{θ} cos 2θ", Quantity::Tangential, 2, Phase::Cos),
        Curve::new("u_{θ}, rotation", Quantity::Tangential, 0, Phase::Cos),
        Curve::new("u_{r}, dilation", Quantity::Radial, 0, Phase::Cos),
    ];
    amplitudes(
        harmonics,
        diameter,
        &curves,
        "amplitude of the displacement ({}m)",
    )
}

/// Draws amplitudes of the mean change of stress around an event by distance, likewise.
pub fn stress(harmonics: &[Harmonic], diameter: f64) -> String {
    let curves = [
        Curve::new("shear stress, cos 4θ", Quantity::Shear, 4, Phase::Cos),
        Curve::new("shear stress, all around", Quantity::Shear, 0, Phase::Cos),
        Curve::new("pressure, sin 2θ", Quantity::Pressure, 2, Phase::Sin),
        Curve::new("pressure, all around", Quantity::Pressure, 0, Phase::Cos),
    ];
    amplitudes(
        harmonics,
        diameter,
        &curves,
        "amplitude of the change ({}Pa)",
    )
}

/// An amplitude in a ring.
struct RingAmplitude {
    /// Distance over the mean diameter.
    distance: f64,
    value: f64,
    error: f64,
}

/// `label`: of the amplitudes, with `{}` in the place of an SI prefix.
fn amplitudes(harmonics: &[Harmonic], diameter: f64, curves: &[Curve], label: &str) -> String {
    let drawn: Vec<Vec<RingAmplitude>> = (curves.iter())
        .map(|curve| curve.amplitudes(harmonics, diameter))
        .collect();
    // The axis is drawn, too.
    let (mut farthest, mut ends) = (1.0_f64, vec![0.0_f64]);
    for ring in drawn.iter().flatten() {
        farthest = farthest.max(ring.distance);
        ends.extend([ring.value - ring.error, ring.value + ring.error]);
    }
    let greatest = ends.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    let (factor, prefix) = ticks::prefix(greatest);
    let layout = LAYOUT.with_legend(curves.iter().map(|curve| curve.name));
    let x = [0.0, farthest + 0.5];
    let y = padded(ends.iter().map(|value| factor * value), 0.05);
    figure(layout, x, y, |plot| {
        if drawn.iter().all(Vec::is_empty) {
            plot.empty_note("no events with enough grains around them");
        }
        let (x_ticks, y_ticks) = (ticks::round(x[0], x[1], 8), ticks::round(y[0], y[1], 6));
        plot.grid(&x_ticks, &y_ticks);
        plot.line(&[[x[0], 0.0], [x[1], 0.0]], GREY, 1.0);
        for (rings, colour) in drawn.iter().zip(CURVES) {
            let points: Vec<[f64; 2]> = (rings.iter())
                .map(|ring| [ring.distance, factor * ring.value])
                .collect();
            plot.line(&points, colour, 1.4);
            for ring in rings {
                let [low, high] = [-1.0, 1.0].map(|sign| factor * (ring.value + sign * ring.error));
                plot.line(&[[ring.distance, low], [ring.distance, high]], colour, 1.0);
                plot.disk([ring.distance, factor * ring.value], 2.4, colour, None);
            }
        }
        plot.clip();
        let distance = "distance from the event over the mean diameter";
        plot.axes(&x_ticks, &y_ticks, distance, &label.replace("{}", prefix));
        let entries: Vec<(RGBColor, &str)> = (curves.iter().zip(CURVES))
            .map(|(curve, colour)| (colour, curve.name))
            .collect();
        plot.legend(&entries);
    })
}

/// Draws the mean change of the shear stress around an event, and arrows of the mean displacement.
/// `diameter`: the mean one (m).
pub fn map(propagator: &Propagator, diameter: f64) -> String {
    let cells: Vec<&MapCell> = propagator.map().collect();
    let longest = most(cells.iter().map(|cell| length(cell.displacement)).collect());
    let strongest = most(cells.iter().map(|cell| cell.shear.abs()).collect());
    let reach = cells
        .iter()
        .flat_map(|cell| cell.place)
        .fold(0.0, |most: f64, x| most.max(x.abs()));
    let side = reach / diameter + 0.5;
    figure(MAP, [-side, side], [-side, side], |plot| {
        for cell in &cells {
            let [x, y] = cell.place.map(|x| x / diameter);
            let corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];
            let colour = CHANGE.at(0.5 + 0.5 * cell.shear / strongest);
            plot.area(&corners.map(|[a, b]| [x + a, y + b]), colour, 1.0);
        }
        for cell in &cells {
            let from = cell.place.map(|x| x / diameter);
            let scale = LONGEST / length(cell.displacement).max(longest);
            arrow(plot, from, cell.displacement.map(|u| scale * u));
        }
        plot.clip();
        let marks = ticks::round(-side, side, 8);
        let (factor, prefix) = ticks::prefix(longest);
        plot.title(&format!(
            "longest arrows {:.2}\u{a0}{prefix}m, mean of the events",
            factor * longest
        ));
        plot.axes(
            &marks,
            &marks,
            "along the flow, mean diameters",
            "along the gradient, mean diameters",
        );
        plot.colour_bar_of(
            &CHANGE,
            [-strongest, strongest],
            "change of the shear stress ({}Pa)",
        );
    })
}

/// The size that [`LONG`] of the positive sizes do not exceed; 1 without any.
fn most(mut sizes: Vec<f64>) -> f64 {
    sizes.retain(|size| *size > 0.0);
    sizes.sort_by(f64::total_cmp);
    let at = (LONG * sizes.len() as f64) as usize;
    let place = at.min(sizes.len().saturating_sub(1));
    sizes.get(place).copied().unwrap_or(1.0)
}

fn length(vector: [f64; 2]) -> f64 {
    vector[0].hypot(vector[1])
}

/// An arrow around a place.
fn arrow(plot: &mut Plot, middle: [f64; 2], along: [f64; 2]) {
    let [x, y] = middle;
    let [dx, dy] = along;
    let (tail, tip) = ([x - 0.5 * dx, y - 0.5 * dy], [x + 0.5 * dx, y + 0.5 * dy]);
    let head = |side: f64| {
        let (back, across) = (0.3, 0.15 * side);
        [
            tip[0] - back * dx - across * dy,
            tip[1] - back * dy + across * dx,
        ]
    };
    plot.line(&[tail, tip], INK, 0.8);
    plot.line(&[head(1.0), tip, head(-1.0)], INK, 0.8);
}
