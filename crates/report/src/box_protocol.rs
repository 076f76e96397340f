//! Figures of a protocol of strain steps: strains over the accumulated strain, stress and volume
//! over the strain, and the stress path.

use gshear_store::run_reader::{RunFile, Series};

use super::ReportFigure;
use super::curves::{lines, percent_of};
use super::history::{Axis, LAYOUT, MeasuredCurve};
use super::panels::has_sheared;

/// Columns of the strains, and their names in the legend.
const STRAINS: [(&str, &str); 5] = [
    ("shear_strain", "γ"),
    ("strain_xx", "ε_{xx}"),
    ("strain_yy", "ε_{yy}"),
    ("strain_zz", "ε_{zz}"),
    ("volume_strain", "ε_{v}"),
];

/// The strain on which the stress works: γ if the box was sheared, else that along its height.
fn worked_on(run: &RunFile) -> (&'static str, &'static str) {
    match run.dimension().axes() {
        _ if has_sheared(run.series()) => ("shear_strain", "shear strain γ (%)"),
        2 => ("strain_yy", "axial strain ε_{yy} (%)"),
        _ => ("strain_zz", "axial strain ε_{zz} (%)"),
    }
}

/// The strain, `[L]`, on which the stress works.
pub fn strain(run: &RunFile) -> &[f64] {
    run.series().column(worked_on(run).0)
}

/// Draws the figures. `stress`: what works on the strain, with its label.
pub fn figures(
    run: &RunFile,
    accumulated: &Axis,
    label: &str,
    stress: &[f64],
) -> Vec<ReportFigure> {
    let series = run.series();
    let (column, name) = worked_on(run);
    let of_strain = Axis {
        values: percent_of(series.column(column)),
        label: name,
        column: (column, series.column(column).to_vec()),
    };
    let of_pressure = Axis {
        values: series.column("pressure").to_vec(),
        label: "pressure P",
        column: ("pressure", series.column("pressure").to_vec()),
    };
    let curves = [
        (
            &of_strain,
            MeasuredCurve {
                name: "stress-strain-loops",
                caption: "The stress over the strain on which it works.".into(),
                label,
                column: "conjugate_stress",
                values: stress,
            },
        ),
        (
            &of_strain,
            MeasuredCurve {
                name: "volume-strain",
                caption: "Strain of the volume, compression positive.".into(),
                label: "volume strain ε_{v}",
                column: "volume_strain",
                values: series.column("volume_strain"),
            },
        ),
        (
            &of_pressure,
            MeasuredCurve {
                name: "stress-path",
                caption: "Stress path.".into(),
                label,
                column: "conjugate_stress",
                values: stress,
            },
        ),
    ];
    let curves = curves.into_iter();
    let mut figures: Vec<_> = curves
        .filter_map(|(axis, curve)| curve.drawn(axis, series))
        .collect();
    figures.extend(strains(series, accumulated));
    figures
}

/// All strains over the accumulated one.
fn strains(series: &Series, accumulated: &Axis) -> Option<ReportFigure> {
    let percent = STRAINS.map(|(column, _)| percent_of(series.column(column)));
    let named: Vec<_> = STRAINS
        .iter()
        .zip(&percent)
        .map(|((_, name), values)| (*name, &values[..]))
        .collect();
    let svg = lines(LAYOUT, accumulated.abscissa(), "strain (%)", &named)?;
    let columns = STRAINS.map(|(column, _)| column);
    let caption = "Strains of the box since the first strain step, compression positive.";
    let data = accumulated.table(series, &columns);
    Some(ReportFigure::new("strains", caption, svg, data))
}
