//! Figures of a protocol that imposes more than velocities along x: the stresses over time, loops
//! of stress and strain, and the path of the two stresses.

use gshear_store::run_reader::RunFile;

use super::curves::{Abscissa, lines, percent_of};
use super::plot::Layout;
use super::ticks;
use super::{FigureData, ReportFigure};

const WIDE: Layout = Layout::new([900.0, 320.0], 84.0);
const SQUARE: Layout = Layout::new([640.0, 480.0], 84.0);

/// Columns of forces and the names of their stresses in the legend.
const STRESSES: [(&str, &str); 4] = [
    ("normal_force", "normal stress"),
    ("imposed_normal_force", "imposed normal stress"),
    ("shear_force", "shear stress"),
    ("imposed_shear_force", "imposed shear stress"),
];

/// Draws the figures. Stresses are forces on the top wall over its area; without walls they are
/// those of the cell.
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
    // A step without a load: its normal motion is imposed.
    let holds_volume = imposed_normal.iter().any(|load| load.is_nan());
    let shear_label = format!("shear stress ({unit})");
    let values = [&normal, &imposed_normal, &shear, &imposed_shear];
    let named = STRESSES.iter().zip(values);
    let stresses: Vec<_> = named
        .map(|((_, name), values)| (*name, &values[..]))
        .collect();
    let times = Abscissa {
        label: "time (s)",
        values: &series.time,
    };
    let strains = Abscissa {
        label: "shear strain γ (%)",
        values: &percent_of(strain),
    };
    let normals = Abscissa {
        label: &format!("normal stress ({unit})"),
        values: &normal,
    };
    let shear = [("", &shear[..])];
    let place = run.boundary().place;
    let figures = [
        (
            "stresses",
            format!("Normal and shear stress {place}, and what is imposed of them."),
            lines(WIDE, times, &format!("stress ({unit})"), &stresses),
        ),
        (
            "stress-strain-loops",
            format!("Shear stress {place} over the shear strain."),
            lines(SQUARE, strains, &shear_label, &shear),
        ),
        (
            "stress-path",
            format!("Path of the stresses {place}, whose normal motion a part imposes."),
            if holds_volume {
                lines(SQUARE, normals, &shear_label, &shear)
            } else {
                None
            },
        ),
    ];
    let figures = figures.into_iter().filter_map(|(name, caption, svg)| {
        Some(ReportFigure::new(name, caption, svg?, FigureData::Series))
    });
    figures.collect()
}
