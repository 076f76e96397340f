//! Figures of a protocol that imposes more than velocities along x: the stresses over time, loops of
//! stress and strain, and the path of the two stresses.

use gshear_store::run_reader::RunFile;
use gshear_store::table::Table;

use super::ReportFigure;
use super::colour::{CURVES, INK};
use super::plot::{Layout, figure};
use super::stress::{draw, padded, percent_of};
use super::ticks;

const WIDE: Layout = Layout {
    size: [900.0, 320.0],
    margin: [84.0, 36.0, 24.0, 58.0],
};
const SQUARE: Layout = Layout {
    size: [640.0, 480.0],
    margin: [84.0, 36.0, 24.0, 58.0],
};

/// Columns of forces and the names of their stresses in the legend.
const STRESSES: [(&str, &str); 4] = [
    ("normal_force", "normal stress"),
    ("imposed_normal_force", "imposed normal stress"),
    ("shear_force", "shear stress"),
    ("imposed_shear_force", "imposed shear stress"),
];

/// A stress of the top wall, row by row.
struct Stress {
    name: &'static str,
    /// In the unit of the figures.
    values: Vec<f64>,
}

/// Draws the figures. Stresses are forces on the top wall over its area.
pub fn figures(run: &RunFile) -> Vec<ReportFigure> {
    let periods = run.periods().into_iter().filter(|x| x.is_finite());
    let area: f64 = periods.product();
    let series = run.series();
    let pascal = STRESSES.map(|(column, _)| -> Vec<f64> {
        series.column(column).iter().map(|f| f / area).collect()
    });
    let finite = pascal.iter().flatten().filter(|x| x.is_finite());
    let (factor, prefix) = ticks::prefix(finite.fold(0.0_f64, |most, x| most.max(x.abs())));
    let unit = format!("{prefix}Pa");
    let [normal, imposed_normal, shear, imposed_shear] =
        pascal.map(|values| -> Vec<f64> { values.iter().map(|x| factor * x).collect() });
    let strain = series.column("strain");
    let data = Table::of(0..series.rows())
        .column("step", |row| series.step[*row])
        .column("time", |row| series.time[*row])
        .column("strain", |row| strain[*row])
        .columns(STRESSES.map(|(column, _)| column), |row| {
            STRESSES.map(|(column, _)| series.column(column)[*row])
        })
        .csv();
    // A step without a load: its normal motion is imposed.
    let holds_volume = imposed_normal.iter().any(|load| load.is_nan());
    let path = holds_volume.then(|| ReportFigure {
        name: "stress-path",
        caption: "Path of the stresses on the top wall, whose normal motion a part imposes.".into(),
        svg: curve(
            (&normal, &format!("normal stress ({unit})")),
            (&shear, &format!("shear stress ({unit})")),
        ),
        data: data.clone(),
    });
    let stresses = [normal, imposed_normal, shear.clone(), imposed_shear];
    let named = STRESSES.into_iter().zip(stresses);
    let stresses: Vec<Stress> = named
        .map(|((_, name), values)| Stress { name, values })
        .collect();
    let mut figures = vec![
        ReportFigure {
            name: "stresses",
            caption: "Normal and shear stress on the top wall, and what is imposed of them.".into(),
            svg: over_time(&series.time, &stresses, &unit),
            data: data.clone(),
        },
        ReportFigure {
            name: "stress-strain-loops",
            caption: "Shear stress on the top wall over the shear strain.".into(),
            svg: curve(
                (&percent_of(strain), "shear strain γ (%)"),
                (&shear, &format!("shear stress ({unit})")),
            ),
            data,
        },
    ];
    figures.extend(path);
    figures
}

fn over_time(time: &[f64], stresses: &[Stress], unit: &str) -> String {
    let is_known = |of: &&Stress| of.values.iter().filter(|x| x.is_finite()).count() > 1;
    let known: Vec<&Stress> = stresses.iter().filter(is_known).collect();
    let x = padded(time.iter().copied(), 0.0);
    let y = padded(known.iter().flat_map(|of| of.values.iter().copied()), 0.08);
    figure(WIDE, x, y, |plot| {
        let (x_ticks, y_ticks) = (ticks::round(x[0], x[1], 10), ticks::round(y[0], y[1], 5));
        plot.grid(&x_ticks, &y_ticks);
        let rows: Vec<usize> = (0..time.len()).collect();
        for (of, colour) in known.iter().zip(CURVES) {
            draw(plot, time, &of.values, &rows, colour, 1.1);
        }
        plot.clip();
        plot.axes(&x_ticks, &y_ticks, "time (s)", &format!("stress ({unit})"));
        plot.legend_of_curves(&known.iter().map(|of| of.name).collect::<Vec<_>>());
    })
}

/// One quantity over another that may return, with their labels.
fn curve((x, x_label): (&[f64], &str), (y, y_label): (&[f64], &str)) -> String {
    let [from, to] = padded(x.iter().copied(), 0.05);
    let [low, high] = padded(y.iter().copied(), 0.08);
    figure(SQUARE, [from, to], [low, high], |plot| {
        let (x_ticks, y_ticks) = (ticks::round(from, to, 6), ticks::round(low, high, 6));
        plot.grid(&x_ticks, &y_ticks);
        let rows: Vec<usize> = (0..x.len()).collect();
        draw(plot, x, y, &rows, INK, 0.9);
        plot.clip();
        plot.axes(&x_ticks, &y_ticks, x_label, y_label);
    })
}
