//! Figures of the time series besides τ: dilation, coordination, sliding contacts, energies.

use gshear_store::csv_table::Table;
use gshear_store::run_reader::{RunFile, RunStage, Series};

use super::curves::{Abscissa, lines};
use super::panels::{Deformation, PANELS, Panel, Shown};
use super::plot::Layout;
use super::summary::{is_driven, is_imposed};
use super::text::escape;
use super::ticks;
use super::{FigureData, ReportFigure};

pub(crate) const LAYOUT: Layout = Layout::new([900.0, 320.0], 84.0);

/// What the time series is drawn over.
pub struct Axis {
    /// `[L]`.
    pub values: Vec<f64>,
    /// With its unit.
    pub label: &'static str,
    /// Name and values of its column in tables, before they are scaled.
    pub column: (&'static str, Vec<f64>),
}

impl Axis {
    /// The strain; where a spring or a protocol moves the wall, its slip; where a protocol imposes
    /// more than velocities, so that the wall goes back or stands still, or nothing is above the
    /// sample, the time. Of a box what its deformation names, and the time of Newton's equations.
    pub fn of(run: &RunFile) -> Self {
        let series = run.series();
        let (name, label, factor) = match run.stage() {
            RunStage::Newtonian => ("time", "time", 1.0),
            RunStage::Strain => {
                let (name, label, factor) = &Deformation::of(run).axis;
                (&**name, &**label, *factor)
            }
            RunStage::Shear if is_imposed(run) || !run.boundary().has_top() => {
                ("time", "time (s)", 1.0)
            }
            RunStage::Shear if is_driven(run) => ("slip", "slip (mm)", 1e3),
            RunStage::Shear => ("strain", "shear strain γ (%)", 100.0),
        };
        let column = match name {
            "time" => series.time.clone(),
            _ => series.column(name).to_vec(),
        };
        Self {
            values: column.iter().map(|x| factor * x).collect(),
            label,
            column: (name, column),
        }
    }

    /// The places of curves.
    pub(crate) fn abscissa(&self) -> Abscissa<'_> {
        Abscissa {
            label: self.label,
            values: &self.values,
        }
    }

    /// A table with a line per row: step, this axis, and some columns of the time series.
    pub fn table(&self, series: &Series, columns: &[&'static str]) -> String {
        let values = columns.iter().map(|name| (*name, series.column(name)));
        self.table_of(series, &values.collect::<Vec<_>>())
    }

    /// A table with a line per row: step, this axis, and these columns.
    pub fn table_of(&self, series: &Series, columns: &[(&'static str, &[f64])]) -> String {
        Table::of(0..series.rows())
            .column("step", |row| series.step[*row])
            .column(self.column.0, |row| self.column.1[*row])
            .columns(columns.iter().map(|column| column.0), |&row| {
                columns.iter().map(move |column| column.1[row])
            })
            .csv()
    }
}

/// A figure of one quantity.
pub struct MeasuredCurve<'a> {
    pub name: &'static str,
    pub caption: String,
    /// At the axis.
    pub label: &'a str,
    /// In the data.
    pub column: &'static str,
    /// `[L]`.
    pub values: &'a [f64],
}

impl MeasuredCurve<'_> {
    /// `None` without two values.
    pub fn drawn(self, axis: &Axis, series: &Series) -> Option<ReportFigure> {
        let svg = lines(LAYOUT, axis.abscissa(), self.label, &[("", self.values)])?;
        let data = axis.table_of(series, &[(self.column, self.values)]);
        Some(ReportFigure::new(self.name, self.caption, svg, data))
    }
}

/// Draws the quantities that the run has recorded.
pub fn figures(run: &RunFile, axis: &Axis) -> Vec<ReportFigure> {
    let driven = is_driven(run);
    let panels = PANELS.shear.iter().filter(|panel| {
        let mut columns = panel.lines.iter().map(|[column, _]| column);
        (driven || panel.name != "slip-rate") && columns.all(|column| run.series().has(column))
    });
    let figures = panels.filter_map(|panel| drawn(run, axis, panel));
    figures.chain(own_figures(run, axis)).collect()
}

/// Draws the columns that the scene declares, a figure each.
fn own_figures<'a>(
    run: &'a RunFile,
    axis: &'a Axis,
) -> impl Iterator<Item = ReportFigure> + use<'a> {
    let series = run.series();
    let columns = series.declared.iter().zip(&series.columns);
    let own = columns.filter(|(column, _)| column.is_own);
    own.filter_map(|(column, values)| {
        let label = match column.unit_in(run.dimension().axes()) {
            Some(unit) => format!("{column} ({unit})"),
            None => column.to_string(),
        };
        let svg = lines(LAYOUT, axis.abscissa(), &label, &[("", &values[..])])?;
        let caption = format!("Observable {column}: {}.", escape(column.doc));
        let name = format!("observable-{column}");
        Some(ReportFigure::new(&name, caption, svg, FigureData::Series))
    })
}

/// `None` if nothing has been recorded.
pub fn drawn(run: &RunFile, axis: &Axis, panel: &'static Panel) -> Option<ReportFigure> {
    let series = run.series();
    let values = panel.lines.iter().flat_map(|[name, _]| series.column(name));
    let greatest = values.map(|x| x.abs()).filter(|x| x.is_finite());
    let (factor, prefix) = match panel.shown {
        Shown::Prefixed => ticks::prefix(greatest.fold(0.0, f64::max)),
        _ => (1.0, ""),
    };
    let unit = ["J/m", "J"][run.dimension().axes() - 2];
    let label = panel.label.replace("(J)", &format!("({prefix}{unit})"));
    let mut curves: Vec<(String, Vec<f64>)> = Vec::new();
    for [column, name] in &panel.lines {
        let values = panel.shown.values(series.column(column), factor);
        let finite = values.iter().filter(|x| x.is_finite());
        if finite.clone().count() > 1 && finite.clone().any(|x| *x != 0.0) {
            curves.push((name.replace("{top}", run.boundary().driven), values));
        }
    }
    let curves: Vec<_> = (curves.iter())
        .map(|(name, values)| (&**name, &values[..]))
        .collect();
    let svg = lines(LAYOUT, axis.abscissa(), &label, &curves)?;
    let columns: Vec<&str> = panel.lines.iter().map(|[column, _]| &**column).collect();
    let data = match run.stage() {
        RunStage::Shear => FigureData::Series,
        _ => FigureData::Own(axis.table(series, &columns)),
    };
    let caption = panel.caption.replace("{top}", run.boundary().driven);
    Some(ReportFigure::new(&panel.name, caption, svg, data))
}
