//! Figures of the time series besides τ: dilation, coordination, sliding contacts, energies.

use gshear_store::run_reader::{RunFile, Series};
use gshear_store::table::Table;

use super::ReportFigure;
use super::colour::CURVES;
use super::plot::{Layout, figure};
use super::stress::{draw, padded};
use super::summary::{is_driven, is_imposed};
use super::ticks;

const LAYOUT: Layout = Layout {
    size: [900.0, 320.0],
    margin: [84.0, 36.0, 24.0, 58.0],
};

/// What the time series is drawn over.
pub struct Axis {
    /// `[L]`.
    pub values: Vec<f64>,
    /// With its unit.
    pub label: &'static str,
    /// Name and values of its column in tables, before they are scaled.
    column: (&'static str, Vec<f64>),
}

impl Axis {
    /// The strain; where a spring or a protocol moves the wall, its slip; where a protocol imposes
    /// more than velocities, so that the wall goes back or stands still, the time.
    pub fn of(run: &RunFile) -> Self {
        if is_imposed(run) {
            let time = run.series().time.clone();
            return Self {
                values: time.clone(),
                label: "time (s)",
                column: ("time", time),
            };
        }
        let (name, label, factor) = match is_driven(run) {
            true => ("slip", "slip (mm)", 1e3),
            false => ("strain", "shear strain γ (%)", 100.0),
        };
        let column = run.series().column(name).to_vec();
        Self {
            values: column.iter().map(|x| factor * x).collect(),
            label,
            column: (name, column),
        }
    }

    /// A table with a line per row: step, this axis, and some columns of the time series.
    pub fn table(&self, series: &Series, columns: &[&'static str]) -> String {
        Table::of(0..series.rows())
            .column("step", |row| series.step[*row])
            .column(self.column.0, |row| self.column.1[*row])
            .columns(columns, |row| {
                let values = columns.iter().map(|name| series.column(name)[*row]);
                values.collect::<Vec<f64>>()
            })
            .csv()
    }
}

/// How the values of a figure are drawn.
enum Shown {
    AsTheyAre,
    /// In percent above the first value.
    Growth,
    /// As powers of ten.
    Logarithm,
    /// With an SI prefix before the unit.
    Prefixed,
}

/// Quantities on one pair of axes.
struct Panel {
    name: &'static str,
    caption: &'static str,
    /// `J` stands for the unit of energies, J or J/m.
    label: &'static str,
    shown: Shown,
    /// Columns of the time series, and their names in the legend.
    lines: &'static [(&'static str, &'static str)],
}

const PANELS: [Panel; 7] = [
    Panel {
        name: "slip-rate",
        caption: "Velocity of the top wall and of the drive.",
        label: "log_{10} velocity (m/s)",
        shown: Shown::Logarithm,
        lines: &[("slip_rate", "top wall"), ("drive_velocity", "drive")],
    },
    Panel {
        name: "dilation",
        caption: "Dilation: height of the sheared layer over its height in the first row, less one.",
        label: "dilation (%)",
        shown: Shown::Growth,
        lines: &[("wall_height", "height")],
    },
    Panel {
        name: "solid-fraction",
        caption: "Solid fraction between the walls.",
        label: "solid fraction",
        shown: Shown::AsTheyAre,
        lines: &[("solid_fraction", "solid fraction")],
    },
    Panel {
        name: "coordination",
        caption: "Coordination: mean number of contacts of a free grain.",
        label: "coordination",
        shown: Shown::AsTheyAre,
        lines: &[("coordination", "coordination")],
    },
    Panel {
        name: "sliding-fraction",
        caption: "Share of the contacts that slide.",
        label: "sliding fraction",
        shown: Shown::AsTheyAre,
        lines: &[("sliding_fraction", "sliding fraction")],
    },
    Panel {
        name: "energies",
        caption: "Kinetic energy of the free grains, and elastic energy of the contacts by parts.",
        label: "log_{10} energy (J)",
        shown: Shown::Logarithm,
        lines: &[
            ("kinetic_energy", "kinetic"),
            ("elastic_normal", "normal"),
            ("elastic_tangential", "tangential"),
            ("elastic_rolling", "rolling"),
        ],
    },
    Panel {
        name: "dissipation",
        caption: "Work of drive and load since the start, and where it went.",
        label: "energy (J)",
        shown: Shown::Prefixed,
        lines: &[
            ("work_drive", "work of the drive"),
            ("work_load", "work of the load"),
            ("dissipated_damping", "dampers"),
            ("dissipated_friction", "friction"),
            ("dissipated_rolling", "rolling"),
            ("dissipated_stiffness", "stiffness"),
        ],
    },
];

/// Draws the quantities that the run has recorded.
pub fn figures(run: &RunFile, axis: &Axis) -> Vec<ReportFigure> {
    let driven = is_driven(run);
    let panels = PANELS.iter().filter(|of| driven || of.name != "slip-rate");
    panels.filter_map(|panel| drawn(run, axis, panel)).collect()
}

/// `None` if nothing has been recorded.
fn drawn(run: &RunFile, axis: &Axis, panel: &Panel) -> Option<ReportFigure> {
    let series = run.series();
    let of_panel = panel.lines.iter().flat_map(|(name, _)| series.column(name));
    let greatest = of_panel.map(|x| x.abs()).filter(|x| x.is_finite());
    let (factor, prefix) = match panel.shown {
        Shown::Prefixed => ticks::prefix(greatest.fold(0.0, f64::max)),
        _ => (1.0, ""),
    };
    let unit = if run.dimension().axes() == 2 {
        "J/m"
    } else {
        "J"
    };
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
    let lines: Vec<(&str, &str, Vec<f64>)> = (panel.lines.iter())
        .map(|(column, name)| (*column, *name, shown(column)))
        .filter(|(.., values)| is_known(values))
        .collect();
    if lines.is_empty() {
        return None;
    }
    let x = padded(axis.values.iter().copied(), 0.0);
    let values = lines.iter().flat_map(|(.., values)| values.iter().copied());
    let y = padded(values, 0.08);
    let svg = figure(LAYOUT, x, y, |plot| {
        let (x_ticks, y_ticks) = (ticks::round(x[0], x[1], 10), ticks::round(y[0], y[1], 5));
        plot.grid(&x_ticks, &y_ticks);
        let rows: Vec<usize> = (0..series.rows()).collect();
        for ((.., values), colour) in lines.iter().zip(CURVES) {
            draw(plot, &axis.values, values, &rows, colour, 1.1);
        }
        plot.clip();
        plot.axes(&x_ticks, &y_ticks, axis.label, &label);
        plot.legend_of_curves(&lines.iter().map(|line| line.1).collect::<Vec<_>>());
    });
    let columns: Vec<&str> = panel.lines.iter().map(|(column, _)| *column).collect();
    Some(ReportFigure {
        name: panel.name,
        caption: panel.caption.into(),
        svg,
        data: axis.table(series, &columns),
    })
}
