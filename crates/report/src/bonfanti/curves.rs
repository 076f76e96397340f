//! The curves of BO's figures 1 to 5, and figure 6 on the slip that follows.

use plotters::style::RGBColor;

use super::{SpectrumRow, SvgWithData};
use crate::colour::{CURVES, GREY, INK, SLIP, STICK};
use crate::compose::grid_of;
use crate::curves::{decimate, padded};
use crate::plot::{Layout, figure};
use crate::ticks;
use gshear_analysis::growth::Growth;
use gshear_store::run_reader::RunFile;
use gshear_store::table::Table;

const WIDE: Layout = Layout {
    size: [900.0, 400.0],
    margin: [104.0, 62.0, 24.0, 58.0],
};
const SQUARE: Layout = Layout {
    size: [640.0, 600.0],
    margin: [104.0, 36.0, 24.0, 58.0],
};

/// A curve of a panel.
struct Line {
    points: Vec<[f64; 2]>,
    colour: RGBColor,
    name: String,
}

/// Draws curves on one pair of axes.
fn panel(
    layout: Layout,
    heading: &str,
    labels: [&str; 2],
    logarithmic: bool,
    lines: &[Line],
) -> String {
    let points = || lines.iter().flat_map(|line| &line.points);
    let x = padded(points().map(|p| p[0]), 0.01);
    let y = padded(points().map(|p| p[1]), 0.06);
    figure(layout, x, y, |plot| {
        let x_ticks = ticks::scientific(x, 8);
        let y_ticks = match logarithmic {
            true => ticks::decades(y[0], y[1], 8),
            false => ticks::scientific(y, 6),
        };
        plot.grid(&x_ticks, &y_ticks);
        for line in lines {
            let column = 0.5 * (x[1] - x[0]) / layout.size[0];
            let points = match line.points.is_sorted_by(|a, b| a[0] <= b[0]) {
                true => decimate(&line.points, column),
                false => line.points.clone(),
            };
            plot.line(&points, line.colour, 1.2);
        }
        plot.clip();
        plot.axes(&x_ticks, &y_ticks, labels[0], labels[1]);
        plot.heading(heading);
        let named: Vec<_> = lines
            .iter()
            .filter(|line| !line.name.is_empty())
            .map(|line| (line.colour, line.name.as_str()))
            .collect();
        plot.legend(&named);
    })
}

fn rows(columns: &[(&str, &[f64])]) -> String {
    let length = columns.iter().map(|(_, column)| column.len()).min();
    let names = columns.iter().map(|(name, _)| name);
    Table::of(0..length.unwrap_or(0))
        .columns(names, |&row| columns.iter().map(move |(_, c)| c[row]))
        .csv()
}

fn zipped(x: &[f64], y: &[f64]) -> Vec<[f64; 2]> {
    x.iter().zip(y).map(|(x, y)| [*x, *y]).collect()
}

/// Draws figure 1: the extreme imaginary parts against strain.
pub fn imaginary(run: &RunFile) -> Result<SvgWithData, &'static str> {
    let [strain, least, greatest] =
        ["strain", "imaginary_least", "imaginary_greatest"].map(|name| run.series().column(name));
    if greatest.iter().all(|x| x.is_nan()) {
        return Err("no eigenvalues along the strain: set aqs.spectrum");
    }
    let line = |y, colour, name: &str| Line {
        points: zipped(strain, y),
        colour,
        name: name.into(),
    };
    let lines = [
        line(least, STICK, "least"),
        line(greatest, CURVES[2], "greatest"),
    ];
    Ok(SvgWithData {
        svg: panel(WIDE, "", ["strain γ", "Im λ"], false, &lines),
        csv: rows(&[
            ("strain", strain),
            ("imaginary_least", least),
            ("imaginary_greatest", greatest),
        ]),
    })
}

/// Figure 2.
pub(super) fn spectra(rows: &[SpectrumRow]) -> SvgWithData {
    let points: Vec<[f64; 2]> = rows.iter().map(|row| [row.time, row.imaginary]).collect();
    let x = padded(points.iter().map(|p| p[0]), 0.01);
    let y = padded(points.iter().map(|p| p[1]), 0.06);
    let svg = figure(WIDE, x, y, |plot| {
        let (x_ticks, y_ticks) = (ticks::scientific(x, 8), ticks::scientific(y, 6));
        plot.grid(&x_ticks, &y_ticks);
        // One mark per pixel is enough.
        let mut drawn: Vec<(i64, i64)> = Vec::new();
        for point in &points {
            let pixel = |k: usize, range: [f64; 2]| {
                (WIDE.size[k] * (point[k] - range[0]) / (range[1] - range[0])) as i64
            };
            drawn.push((pixel(0, x), pixel(1, y)));
        }
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by_key(|&k| drawn[k]);
        order.dedup_by_key(|k| drawn[*k]);
        for k in order {
            plot.disk(points[k], 1.6, STICK, None);
        }
        plot.clip();
        plot.axes(&x_ticks, &y_ticks, "time", "Im λ");
    });
    let csv = Table::of(rows)
        .column("time", |row| row.time)
        .column("real", |row| row.real)
        .column("imaginary", |row| row.imaginary)
        .csv();
    SvgWithData { svg, csv }
}

/// Draws figure 3: growth of the mean square displacement.
pub fn growth(run: &RunFile, growth: Option<&Growth>) -> SvgWithData {
    let (time, msd) = (&run.series().time, run.series().column("msd"));
    let log = |points: &[[f64; 2]]| -> Vec<[f64; 2]> {
        let positive = points.iter().filter(|p| p[1] > 0.0);
        positive.map(|p| [p[0], p[1].log10()]).collect()
    };
    let measured = zipped(time, msd);
    let mut lines = vec![Line {
        points: log(&measured),
        colour: STICK,
        name: "mean square displacement".into(),
    }];
    let mut panels = Vec::new();
    if let Some(growth) = growth {
        let fitted = |omega: f64, colour, name: &str| {
            let within = |p: &&[f64; 2]| (growth.from..=growth.to).contains(&p[0]);
            let inside: Vec<_> = lines[0].points.iter().filter(within).collect();
            let of = |p: &[f64; 2]| p[1] - 2.0 * omega * p[0] / std::f64::consts::LN_10;
            let mean = inside.iter().map(|p| of(p)).sum::<f64>() / inside.len() as f64;
            let at = |t: f64| [t, mean + 2.0 * omega * t / std::f64::consts::LN_10];
            Line {
                points: vec![at(growth.from), at(growth.to)],
                colour,
                name: name.into(),
            }
        };
        let mut more = vec![fitted(growth.omega_i, SLIP, "fitted exp 2ω_{i}t")];
        if let Some(omega) = run.number("omega_i") {
            more.push(fitted(omega, GREY, "exp 2ω_{i}t of the complex pair"));
        }
        lines.extend(more);
    }
    panels.push(panel(
        WIDE,
        "(a)",
        ["time", "mean square displacement"],
        true,
        &lines,
    ));
    if let Some(zoom) = dense(time) {
        let zoomed = Line {
            points: measured[zoom].to_vec(),
            colour: STICK,
            name: String::new(),
        };
        panels.push(panel(
            WIDE,
            "(b)",
            ["time", "mean square displacement"],
            false,
            &[zoomed],
        ));
    }
    SvgWithData {
        svg: grid_of(1, &panels),
        csv: rows(&[("time", time), ("msd", msd)]),
    }
}

/// The last interval of rows that lie denser than elsewhere.
fn dense(time: &[f64]) -> Option<std::ops::Range<usize>> {
    let gaps: Vec<f64> = time.windows(2).map(|w| w[1] - w[0]).collect();
    let greatest = gaps.iter().copied().fold(0.0, f64::max);
    let close = |gap: &f64| *gap < 0.5 * greatest;
    let end = gaps.iter().rposition(close)?;
    let begin = gaps[..end]
        .iter()
        .rposition(|gap| !close(gap))
        .map_or(0, |k| k + 1);
    (end > begin + 16).then_some(begin..end + 1)
}

/// Draws figure 4: trajectories of the fastest grains.
///
/// `places`: of the grains in the frames up to the end of the growth (m).
pub fn spirals(
    run: &RunFile,
    growth: Option<&Growth>,
    places: &[Vec<[f64; 3]>],
) -> Result<SvgWithData, &'static str> {
    growth.ok_or("the mean square displacement does not grow exponentially")?;
    let (times, end) = (run.frame_times(), places.len());
    if end < 3 {
        return Err("fewer than three frames during the growth: increase newtonian.frames");
    }
    let moved = |frame: usize, grain: usize| -> [f64; 3] {
        let (now, start) = (places[frame][grain], places[0][grain]);
        std::array::from_fn(|axis| now[axis] - start[axis])
    };
    let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let mut grains: Vec<usize> = (0..run.grains().count()).collect();
    grains.sort_by(|a, b| length(moved(end - 1, *b)).total_cmp(&length(moved(end - 1, *a))));
    grains.truncate(8);
    let greatest = grains
        .iter()
        .flat_map(|&grain| (0..end).map(move |frame| (frame, grain)))
        .map(|(frame, grain)| length(moved(frame, grain)))
        .fold(0.0, f64::max);
    let mut rows = Vec::new();
    let mut lines = Vec::new();
    for (k, &grain) in grains.iter().enumerate() {
        let mut points = Vec::new();
        for (frame, time) in times[..end].iter().enumerate() {
            let place = moved(frame, grain).map(|x| x / greatest);
            points.push([place[0], place[1]]);
            rows.push((*time, grain, place));
        }
        lines.push(Line {
            points,
            colour: CURVES.get(k).copied().unwrap_or(INK),
            name: String::new(),
        });
    }
    let labels = ["Δx over the greatest", "Δy over the greatest"];
    Ok(SvgWithData {
        svg: panel(SQUARE, "", labels, false, &lines),
        csv: Table::of(rows)
            .column("time", |(time, ..)| *time)
            .column("grain", |(_, grain, _)| *grain)
            .columns(["x", "y", "z"], |(.., place)| *place)
            .csv(),
    })
}

/// Draws figure 6: D²min of the slip against |v|² in the growing pair.
pub fn slip(mode_weight: &[f64], dmin: &[f64]) -> SvgWithData {
    let points: Vec<[f64; 2]> = mode_weight
        .iter()
        .zip(dmin)
        .filter(|(a, b)| **a > 0.0 && **b > 0.0)
        .map(|(a, b)| [a.log10(), b.log10()])
        .collect();
    let x = padded(points.iter().map(|p| p[0]), 0.05);
    let y = padded(points.iter().map(|p| p[1]), 0.05);
    let svg = figure(SQUARE, x, y, |plot| {
        let x_ticks = ticks::decades(x[0], x[1], 8);
        let y_ticks = ticks::decades(y[0], y[1], 8);
        plot.grid(&x_ticks, &y_ticks);
        for point in &points {
            plot.disk(*point, 3.0, STICK, None);
        }
        plot.clip();
        plot.axes(
            &x_ticks,
            &y_ticks,
            "|v|^{2} in the growing pair",
            "D^{2}_{min} of the slip",
        );
    });
    SvgWithData {
        svg,
        csv: rows(&[("eigenvector_square", mode_weight), ("dmin", dmin)]),
    }
}

/// Draws figure 5: shear stress against time.
pub fn stress(run: &RunFile, growth: Option<&Growth>) -> SvgWithData {
    let (time, stress) = (&run.series().time, run.series().column("shear_stress"));
    let line = |points| Line {
        points,
        colour: STICK,
        name: String::new(),
    };
    let all = zipped(time, stress);
    let mut panels = vec![panel(
        WIDE,
        "(a)",
        ["time", "shear stress σ_{xz}"],
        false,
        &[line(all.clone())],
    )];
    if let Some(growth) = growth {
        let first = stress.first().copied().unwrap_or(0.0);
        let within = all.iter().filter(|p| p[0] <= growth.to);
        let change = within.map(|p| [p[0], p[1] - first]).collect();
        let labels = ["time", "change of σ_{xz}"];
        panels.push(panel(WIDE, "(b)", labels, false, &[line(change)]));
    }
    SvgWithData {
        svg: grid_of(1, &panels),
        csv: rows(&[("time", time), ("shear_stress", stress)]),
    }
}
