//! Figures of τ(γ): the whole run, and the largest drop.

use plotters::style::RGBColor;

use super::colour::{INK, SLIP, STICK, WHITE};
use super::history::Axis;
use super::plot::{Layout, Plot, figure};
use super::ticks;
use gshear_analysis::phases::{Phase, PhaseKind};

const LAYOUT: Layout = Layout {
    size: [900.0, 400.0],
    margin: [72.0, 36.0, 24.0, 58.0],
};
/// Phases with a change below this share of the range of τ have no colour in the figure of the whole
/// run, where colours would blur.
pub const VISIBLE: f64 = 0.02;

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
        let is_visible = |phase: &&Phase| phase.change.abs() > VISIBLE * (high - low);
        let large: Vec<&Phase> = phases.iter().filter(is_visible).collect();
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
    let is_drawn = |kind: &PhaseKind| phases.iter().any(|phase| phase.kind == *kind);
    let kinds = [PhaseKind::Stick, PhaseKind::Slip].into_iter();
    let kinds = kinds
        .filter(is_drawn)
        .map(|kind| (colour(kind), kind.name()));
    kinds.chain([(INK, "τ")]).collect()
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
        let is_within = |phase: &&Phase| phase.end > rows.start && phase.start < rows.end;
        let within: Vec<&Phase> = phases.iter().filter(is_within).collect();
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

/// Returns strains in percent.
pub(super) fn percent_of(strain: &[f64]) -> Vec<f64> {
    strain.iter().map(|strain| 100.0 * strain).collect()
}

/// Returns the range of the finite values, extended by `share` of it at both ends.
pub(super) fn padded(values: impl Iterator<Item = f64>, share: f64) -> [f64; 2] {
    let finite = values.filter(|value| value.is_finite());
    let [low, high] = finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| {
        [low.min(v), high.max(v)]
    });
    if low > high {
        return [0.0, 1.0];
    }
    let span = if high > low {
        high - low
    } else {
        low.abs().max(1e-3)
    };
    let more = if high > low { share } else { 0.5 };
    [low - more * span, high + more * span]
}

/// Draws rows as lines that break at values that are not finite, with no more points than the
/// figure can resolve.
pub(super) fn draw(
    plot: &mut Plot,
    x: &[f64],
    y: &[f64],
    rows: &[usize],
    colour: RGBColor,
    width: f64,
) {
    for stretch in rows.split(|&row| !y[row].is_finite()) {
        let points: Vec<[f64; 2]> = stretch.iter().map(|&row| [x[row], y[row]]).collect();
        let points = decimate(&points, 1.0 / plot.scale());
        if points.len() > 1 {
            plot.line(&points, colour, width);
        }
    }
}

/// Keeps the first, least, greatest and last point of each interval of width `column` in x.
pub(super) fn decimate(points: &[[f64; 2]], column: f64) -> Vec<[f64; 2]> {
    let place = |point: &[f64; 2]| (point[0] / column).floor();
    let mut kept = Vec::new();
    for group in points.chunk_by(|a, b| place(a) == place(b)) {
        let by_height = |a: &usize, b: &usize| group[*a][1].total_cmp(&group[*b][1]);
        let indices = 0..group.len();
        let (least, most) = (indices.clone().min_by(by_height), indices.max_by(by_height));
        let mut chosen = [0, least.unwrap_or(0), most.unwrap_or(0), group.len() - 1];
        chosen.sort_unstable();
        let mut last = usize::MAX;
        for k in chosen {
            if k != last {
                kept.push(group[k]);
            }
            last = k;
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimation_keeps_the_ends_and_the_extremes_of_every_column() {
        let points: Vec<[f64; 2]> = (0..100_000)
            .map(|k| [f64::from(k) * 1e-4, f64::from((k * 7919 + 137) % 1000)])
            .collect();
        let kept = decimate(&points, 1.0);
        assert_eq!(kept.len(), 40);
        for column in 0..10 {
            let of = |points: &[[f64; 2]]| -> Vec<f64> {
                points
                    .iter()
                    .filter(|p| p[0].floor() == f64::from(column))
                    .map(|p| p[1])
                    .collect()
            };
            let (all, few) = (of(&points), of(&kept));
            assert_eq!(
                all.iter().copied().fold(f64::INFINITY, f64::min),
                few.iter().copied().fold(f64::INFINITY, f64::min)
            );
            assert_eq!(
                all.iter().copied().fold(0.0, f64::max),
                few.iter().copied().fold(0.0, f64::max)
            );
            assert_eq!((all[0], all[all.len() - 1]), (few[0], few[few.len() - 1]));
        }
    }

    #[test]
    fn few_points_are_all_kept() {
        let points = [[0.5, 1.0], [1.5, 0.0], [2.5, 2.0]];
        assert_eq!(decimate(&points, 1.0), points);
        assert!(decimate(&[], 1.0).is_empty());
    }
}
