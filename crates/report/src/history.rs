//! Figures of the time series besides τ: dilation, coordination, sliding contacts, energies.

use gshear_store::csv_table::Table;
use gshear_store::run_reader::{RunFile, RunStage, Series};

use super::ReportFigure;
use super::curves::lines;
use super::panels::{Deformation, PANELS, Panel, Shown};
use super::plot::Layout;
use super::summary::{is_driven, is_imposed};
use super::ticks;

pub const LAYOUT: Layout = Layout::new([900.0, 320.0], 84.0);

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
            RunStage::Shear if is_imposed(run) || run.has_free_surface() => {
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

/// Draws the quantities that the run has recorded.
pub fn figures(run: &RunFile, axis: &Axis) -> Vec<ReportFigure> {
    let driven = is_driven(run);
    let has = |name: &str| run.series().has(name);
    let panels = PANELS.walls.iter().filter(|of| {
        (driven || of.name != "slip-rate") && of.lines.iter().all(|[name, _]| has(name))
    });
    panels.filter_map(|panel| drawn(run, axis, panel)).collect()
}

/// What the drive moves.
pub fn top(run: &RunFile) -> &'static str {
    if run.has_walls() {
        "top wall"
    } else {
        "image above the cell"
    }
}

/// `None` if nothing has been recorded.
pub fn drawn(run: &RunFile, axis: &Axis, panel: &'static Panel) -> Option<ReportFigure> {
    let series = run.series();
    let of_panel = panel.lines.iter().flat_map(|[name, _]| series.column(name));
    let greatest = of_panel.map(|x| x.abs()).filter(|x| x.is_finite());
    let (factor, prefix) = match panel.shown {
        Shown::Prefixed => ticks::prefix(greatest.fold(0.0, f64::max)),
        _ => (1.0, ""),
    };
    let unit = ["J/m", "J"][run.dimension().axes() - 2];
    let label = panel.label.replace("(J)", &format!("({prefix}{unit})"));
    let shown = |name: &str| -> Vec<f64> {
        let column = series.column(name);
        let first = column.first().copied().unwrap_or(f64::NAN);
        let value = |x: &f64| match panel.shown {
            Shown::AsTheyAre | Shown::Prefixed => factor * x,
            Shown::Growth => 100.0 * (x / first - 1.0),
            // -∞ of 0 breaks the line, as NaN does.
            Shown::Logarithm => x.abs().log10(),
        };
        column.iter().map(value).collect()
    };
    let is_known = |values: &[f64]| {
        let finite = values.iter().filter(|x| x.is_finite());
        finite.clone().count() > 1 && (finite.clone().any(|x| *x != 0.0))
    };
    let named = |text: &str| text.replace("{top}", top(run));
    let known: Vec<(String, Vec<f64>)> = (panel.lines.iter())
        .map(|[column, name]| (named(name), shown(column)))
        .filter(|(_, values)| is_known(values))
        .collect();
    let known: Vec<_> = known.iter().map(|(name, of)| (&**name, &of[..])).collect();
    let svg = lines(LAYOUT, (axis.label, &axis.values), &label, &known)?;
    let columns: Vec<&str> = panel.lines.iter().map(|[column, _]| &**column).collect();
    let data = axis.table(series, &columns);
    let caption = named(&panel.caption);
    Some(ReportFigure::new(&panel.name, caption, svg, data))
}
