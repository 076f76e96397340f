//! Figures of τ(γ): the whole run, and the largest drop.

use plotters::style::RGBColor;

use super::colour::{INK, SLIP, STICK, WHITE};
use super::curves::{draw, padded};
use super::history::Axis;
use super::plot::{Layout, figure};
use super::ticks;
use gshear_analysis::phases::{Phase, PhaseKind};

const LAYOUT: Layout = Layout::new([900.0, 400.0], 72.0);
/// Phases with a change below this share of the range of τ have no colour in the figure of the
/// whole run, where colours would blur.
pub(crate) const VISIBLE: f64 = 0.02;

/// Draws τ over the whole run, with large phases in colour. `tau` is `[L]`.
pub fn whole(axis: &Axis, tau: &[f64], phases: &[Phase], drop: Option<&Phase>) -> String {
    let percent = &axis.values;
    let x = padded(percent.iter().copied(), 0.0);
    let y = padded(tau.iter().copied(), 0.1);
    figure(LAYOUT, x, y, |plot| {
        let (x_ticks, y_ticks) = (ticks::round(x[0], x[1], 10), ticks::round(y[0], y[1], 6));
        plot.grid(&x_ticks, &y_ticks);
        if let Some(drop) = drop {
            plot.vertical_line(percent[drop.start], INK);
            plot.note(percent[drop.start], "largest drop");
        }
        let rows: Vec<usize> = (0..tau.len()).collect();
        draw(plot, percent, tau, &rows, INK, 0.9);
        let [low, high] = padded(tau.iter().copied(), 0.0);
        let large: Vec<&Phase> = (phases.iter())
            .filter(|phase| phase.change.abs() > VISIBLE * (high - low))
            .collect();
        for phase in &large {
            let rows = &rows[phase.start..=phase.end];
            draw(plot, percent, tau, rows, colour(phase.kind), 1.1);
        }
        plot.clip();
        plot.axes(&x_ticks, &y_ticks, axis.label, "shear stress ratio τ = S/N");
        if !large.is_empty() {
            plot.legend(&legend(&large));
        }
    })
}

/// The kinds of these phases, and the curve.
fn legend(phases: &[&Phase]) -> Vec<(RGBColor, &'static str)> {
    let mut entries = Vec::new();
    for kind in [PhaseKind::Stick, PhaseKind::Slip] {
        if phases.iter().any(|phase| phase.kind == kind) {
            entries.push((colour(kind), kind.name()));
        }
    }
    entries.push((INK, "τ"));
    entries
}

/// Draws τ around a drop with its phases shaded. `frames`: places of the
/// two frames that the maps show.
pub fn around(
    axis: &Axis,
    tau: &[f64],
    phases: &[Phase],
    drop: &Phase,
    frames: Option<[f64; 2]>,
) -> String {
    let percent = &axis.values;
    let rows = window(tau.len(), drop);
    let x = padded(percent[rows.clone()].iter().copied(), 0.0);
    let y = padded(tau[rows.clone()].iter().copied(), 0.08);
    figure(LAYOUT, x, y, |plot| {
        let (x_ticks, y_ticks) = (ticks::round(x[0], x[1], 6), ticks::round(y[0], y[1], 6));
        let within: Vec<&Phase> = (phases.iter())
            .filter(|phase| phase.end > rows.start && phase.start < rows.end)
            .collect();
        for phase in &within {
            let [from, to] = [phase.start, phase.end].map(|row| percent[row]);
            plot.band(from, to, colour(phase.kind), 0.16);
        }
        plot.grid(&[], &y_ticks);
        let rows: Vec<usize> = rows.collect();
        draw(plot, percent, tau, &rows, INK, 1.4);
        if rows.len() <= 150 {
            for &row in &rows {
                plot.disk([percent[row], tau[row]], 2.2, INK, None);
            }
        }
        let mut legend = legend(&within);
        let places = frames.into_iter().flatten();
        for strain in places.filter(|at| (x[0]..=x[1]).contains(at)) {
            plot.vertical_line(strain, INK);
            legend.push((WHITE, "dashed: frames of the maps below"));
        }
        legend.dedup();
        plot.clip();
        plot.axes(&x_ticks, &y_ticks, axis.label, "shear stress ratio τ = S/N");
        plot.legend(&legend);
    })
}

fn colour(kind: PhaseKind) -> RGBColor {
    match kind {
        PhaseKind::Stick => STICK,
        PhaseKind::Slip => SLIP,
    }
}

/// The rows around a drop: four times its length, and at least 30 rows, on either side.
fn window(rows: usize, drop: &Phase) -> std::ops::Range<usize> {
    let around = (4 * drop.duration()).max(30);
    drop.start.saturating_sub(around)..(drop.end + around + 1).min(rows)
}
