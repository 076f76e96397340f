//! Curves on a pair of axes.

use std::collections::BTreeSet;

use plotters::style::RGBColor;

use super::colour::CURVES;
use super::plot::{Layout, Plot, figure};
use super::ticks;
use gshear_analysis::moments::extent;

/// Most points of a curve that are marked.
const MARKED: usize = 100;
/// Least range of an axis over its greatest value, so that labels stay short.
const LEAST_RANGE: f64 = 1e-4;

/// The places that curves have in common.
#[derive(Clone, Copy)]
pub(crate) struct Abscissa<'a> {
    pub label: &'a str,
    pub values: &'a [f64],
}

/// Draws curves, values `y` by name, over common places `x`; `None` if none has two points.
pub fn lines(
    layout: Layout,
    x: Abscissa<'_>,
    y_label: &str,
    curves: &[(&str, &[f64])],
) -> Option<String> {
    let mut finite = curves
        .iter()
        .map(|(_, values)| values.iter().filter(|v| v.is_finite()));
    if finite.all(|values| values.count() < 2) {
        return None;
    }
    let Abscissa {
        label: x_label,
        values: x,
    } = x;
    let layout = layout.with_legend(curves.iter().map(|curve| curve.0));
    let [width, height] = layout.size;
    let on_x = padded(x.iter().copied(), 0.02);
    let on_y = padded(curves.iter().flat_map(|(_, y)| y.iter().copied()), 0.08);
    let more = LEAST_RANGE * on_y[0].abs().max(on_y[1].abs()) - (on_y[1] - on_y[0]);
    let on_y = [on_y[0] - 0.5 * more.max(0.0), on_y[1] + 0.5 * more.max(0.0)];
    Some(figure(layout, on_x, on_y, |plot| {
        let x_ticks = ticks::scientific(on_x, (width / 90.0) as usize);
        let y_ticks = ticks::scientific(on_y, (height / 64.0) as usize);
        plot.grid(&x_ticks, &y_ticks);
        let rows: Vec<usize> = (0..x.len()).collect();
        for ((_, y), colour) in curves.iter().zip(CURVES) {
            draw(plot, x, y, &rows, colour, 1.2);
            if x.len() > MARKED {
                continue;
            }
            for &row in rows.iter().filter(|row| y[**row].is_finite()) {
                plot.disk([x[row], y[row]], 2.0, colour, None);
            }
        }
        plot.clip();
        plot.axes(&x_ticks, &y_ticks, x_label, y_label);
        if curves.len() > 1 {
            let names = curves.iter().map(|curve| curve.0);
            plot.legend(&CURVES.into_iter().zip(names).collect::<Vec<_>>());
        }
    }))
}

/// Returns strains in percent.
pub(crate) fn percent_of(strain: &[f64]) -> Vec<f64> {
    strain.iter().map(|strain| 100.0 * strain).collect()
}

/// Returns the range of the finite values, extended by `share` of it at both ends.
pub fn padded(values: impl Iterator<Item = f64>, share: f64) -> [f64; 2] {
    let [low, high] = extent(values.filter(|value| value.is_finite()));
    if low > high {
        return [0.0, 1.0];
    }
    let more = if high > low {
        share * (high - low)
    } else {
        0.5 * low.abs().max(1e-3)
    };
    [low - more, high + more]
}

/// Draws rows as lines that break at values that are not finite, with no more points than the
/// figure can resolve.
pub fn draw(plot: &mut Plot, x: &[f64], y: &[f64], rows: &[usize], colour: RGBColor, width: f64) {
    for stretch in rows.split(|&row| !y[row].is_finite()) {
        let points: Vec<[f64; 2]> = stretch.iter().map(|&row| [x[row], y[row]]).collect();
        thinned(plot, &points, colour, width);
    }
}

/// Draws a line with no more points than the figure can resolve.
pub fn thinned(plot: &mut Plot, points: &[[f64; 2]], colour: RGBColor, width: f64) {
    let points = decimate(points, 1.0 / plot.scale());
    if points.len() > 1 {
        plot.line(&points, colour, width);
    }
}

/// Keeps the first, least, greatest and last point of each interval of width `column` in x.
pub(crate) fn decimate(points: &[[f64; 2]], column: f64) -> Vec<[f64; 2]> {
    let columns = points.chunk_by(|a, b| (a[0] / column).floor() == (b[0] / column).floor());
    let mut kept = Vec::new();
    for group in columns {
        let indices = 0..group.len();
        let least = indices
            .clone()
            .min_by(|a, b| group[*a][1].total_cmp(&group[*b][1]));
        let most = indices.max_by(|a, b| group[*a][1].total_cmp(&group[*b][1]));
        let ends = [0, group.len() - 1].into_iter();
        let chosen: BTreeSet<usize> = ends.chain(least).chain(most).collect();
        kept.extend(chosen.into_iter().map(|k| group[k]));
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
            let heights = |points: &[[f64; 2]]| -> Vec<f64> {
                let here = points.iter().filter(|p| p[0].floor() == f64::from(column));
                here.map(|p| p[1]).collect()
            };
            let (all, few) = (heights(&points), heights(&kept));
            assert_eq!(extent(all.iter().copied()), extent(few.iter().copied()));
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
