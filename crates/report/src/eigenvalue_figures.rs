//! Figures of eigenvalues: in the complex plane, and over time.

use super::colour::{GREY, INK, SLIP, STICK};
use super::curves::padded;
use super::plot::{Layout, figure};
use super::ticks;
use gshear_analysis::moments::extent;
use gshear_spectrum::{Eigenvalue, Verdict};
use gshear_store::csv_table::Table;

const WIDE: Layout = Layout {
    size: [900.0, 400.0],
    margin: [104.0, 62.0, 24.0, 58.0],
};
const LAYOUT: Layout = Layout::new([900.0, 480.0], 84.0);

/// Draws eigenvalues coloured by verdict, pairs on top.
pub fn in_the_plane(eigenvalues: &[Eigenvalue]) -> String {
    let re = extent(eigenvalues.iter().map(|e| e.value.re));
    let im = extent(eigenvalues.iter().map(|e| e.value.im));
    if re[0] > re[1] || im[0] > im[1] {
        return figure(LAYOUT, [0.0, 1.0], [0.0, 1.0], |plot| {
            plot.empty_note("no eigenvalues");
            plot.axes(&[], &[], "Re λ", "Im λ");
        });
    }
    let least = 1e-12 * re[0].abs().max(re[1].abs()).max(1e-300);
    let x = with_margin(re, least);
    let y = with_margin(im, 0.01 * (re[1] - re[0]).max(least));
    figure(LAYOUT, x, y, |plot| {
        let (x_ticks, y_ticks) = (ticks::round(x[0], x[1], 8), ticks::round(y[0], y[1], 6));
        plot.grid(&x_ticks, &y_ticks);
        let kinds = [
            (Verdict::Real, STICK, "real"),
            (Verdict::Zero, INK, "zero"),
            (Verdict::Doubtful, GREY, "doubtful"),
            (Verdict::Pair, SLIP, "pair"),
        ];
        for (verdict, colour, _) in kinds {
            for e in eigenvalues.iter().filter(|e| e.verdict == verdict) {
                plot.disk([e.value.re, e.value.im], 2.5, colour, None);
            }
        }
        plot.axes(&x_ticks, &y_ticks, "Re λ", "Im λ");
        plot.legend(&kinds.map(|(_, colour, name)| (colour, name)));
    })
}

/// A range extended by a twentieth of it at both ends, and at least by `least`.
fn with_margin(range: [f64; 2], least: f64) -> [f64; 2] {
    let [low, high] = range;
    let margin = (0.05 * (high - low)).max(least);
    [low - margin, high + margin]
}

/// A row of `spectra.csv`.
#[derive(serde::Deserialize)]
pub(crate) struct SpectrumRow {
    time: f64,
    real: f64,
    imaginary: f64,
}

/// Draws the imaginary parts over time. Returns SVG and CSV.
pub(crate) fn over_time(rows: &[SpectrumRow]) -> [String; 2] {
    let points: Vec<[f64; 2]> = rows.iter().map(|row| [row.time, row.imaginary]).collect();
    let x = padded(points.iter().map(|p| p[0]), 0.01);
    let y = padded(points.iter().map(|p| p[1]), 0.06);
    let svg = figure(WIDE, x, y, |plot| {
        let (x_ticks, y_ticks) = (ticks::scientific(x, 8), ticks::scientific(y, 6));
        plot.grid(&x_ticks, &y_ticks);
        // One mark per pixel is enough.
        let mut marks: Vec<([i64; 2], [f64; 2])> = Vec::new();
        for point in &points {
            let pixel = [(0, x), (1, y)].map(|(axis, [low, high])| {
                (WIDE.size[axis] * (point[axis] - low) / (high - low)) as i64
            });
            marks.push((pixel, *point));
        }
        marks.sort_by_key(|(pixel, _)| *pixel);
        marks.dedup_by_key(|(pixel, _)| *pixel);
        for (_, point) in marks {
            plot.disk(point, 1.6, STICK, None);
        }
        plot.clip();
        plot.axes(&x_ticks, &y_ticks, "time", "Im λ");
    });
    let csv = Table::of(rows)
        .column("time", |row| row.time)
        .column("real", |row| row.real)
        .column("imaginary", |row| row.imaginary)
        .csv();
    [svg, csv]
}
