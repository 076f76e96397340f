//! Several runs in periodic boxes: what became of the growing pairs, and where they were born in
//! both forms of the stiffness matrix.

use super::{BoxRun, SvgWithData};
use crate::colour::{CURVES, GREY, INK};
use crate::compose::grid_of;
use crate::page::{document, escape, links};
use crate::plot::{Layout, figure};
use crate::ticks;
use gshear_analysis::aftermath::{Aftermath, BoxChange, BoxSeries};
use gshear_analysis::event;
use gshear_analysis::spread::Spread;
use gshear_store::table::Table;

/// The drop of the shear stress in BO's figure 5.
const DROP_OF_THE_PAPER: f64 = 0.22;

const PANEL: Layout = Layout {
    size: [980.0, 420.0],
    margin: [72.0, 62.0, 24.0, 58.0],
};

/// The first frame of the strain steps with a complex pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstPair {
    /// Strain of the frame before it; NaN if it is the first frame.
    pub before: f64,
    /// Its strain.
    pub after: f64,
    /// λ_i of the pair with the greatest.
    pub lambda_i: f64,
    /// ω_r of that pair.
    pub omega_r: f64,
    /// ω_i of that pair.
    pub omega_i: f64,
}

/// What the frames of the strain steps say of both forms of the matrix.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BothForms {
    /// Number of frames; 0 of a run without frames.
    pub frames: usize,
    /// With K, the derivative of the program's forces; `None` without a pair.
    pub ours: Option<FirstPair>,
    /// With J in the form of BO's appendix B.
    pub paper: Option<FirstPair>,
}

/// The numbers of a run.
pub(super) struct RunNumbers {
    path: String,
    family: String,
    /// Strain just above the birth of the first pair; NaN without one.
    birth: f64,
    forms: BothForms,
    /// λ_i at the start of Newton's equations, and ω_i and ω_r of that pair.
    pair: [f64; 3],
    /// ω_i and ω_r of the growth, over those of the eigenvalue, less 1, and the same that the time
    /// step explains.
    fit: [f64; 4],
    decades: f64,
    /// Of |v|² of the growing pair with D²min, and by chance.
    overlap: [f64; 2],
    change: Option<BoxChange>,
}

/// The numbers of a run of this family.
pub(super) fn numbers(run: &BoxRun, family: String, forms: BothForms) -> RunNumbers {
    let nan = f64::NAN;
    let of_pair = |name: &str| {
        let number = run.newtonian.as_ref().and_then(|run| run.number(name));
        number.unwrap_or(nan)
    };
    let pair = ["lambda_i", "omega_i", "omega_r"].map(of_pair);
    let growth = run.growth;
    let fitted = growth.map_or([nan; 2], |growth| [growth.omega_i, growth.omega_r]);
    let expected = run.integration_error().unwrap_or([nan; 2]);
    let overlap = run.slip.as_ref().map_or([nan; 2], |[weight, dmin]| {
        [event::overlap(weight, dmin), event::by_chance(weight, dmin)]
    });
    let change = run.newtonian.as_ref().and_then(|moving| {
        let series = moving.series();
        let columns = BoxSeries {
            time: &series.time,
            msd: series.column("msd"),
            stress: series.column("shear_stress"),
            pressure: series.column("pressure"),
            energy: series.column("elastic_energy"),
            contacts: series.column("contacts"),
        };
        BoxChange::of(columns, moving.number("mean_diameter").unwrap_or(1.0))
    });
    RunNumbers {
        path: run.strain.path().display().to_string(),
        family,
        birth: run.strain.number("birth_after").unwrap_or(nan),
        forms,
        pair,
        fit: [
            fitted[0] / pair[1] - 1.0,
            fitted[1] / pair[2] - 1.0,
            expected[0],
            expected[1],
        ],
        decades: growth.map_or(nan, |growth| growth.decades),
        overlap,
        change,
    }
}

/// Families in the order of their first run, with their runs.
fn families(runs: &[RunNumbers]) -> Vec<(&str, Vec<&RunNumbers>)> {
    let mut found: Vec<(&str, Vec<&RunNumbers>)> = Vec::new();
    for run in runs {
        match found.iter_mut().find(|(name, _)| *name == run.family) {
            Some((_, members)) => members.push(run),
            None => found.push((&run.family, vec![run])),
        }
    }
    found
}

/// A quantity of a run; NaN where the run has none.
type Quantity = (&'static str, fn(&RunNumbers) -> f64);

/// Whether the run has this aftermath: 1 or 0; NaN without Newton's equations of a pair.
fn is(run: &RunNumbers, aftermath: Aftermath) -> f64 {
    match &run.change {
        Some(change) if run.pair[0].is_finite() => {
            f64::from(u8::from(change.aftermath() == aftermath))
        }
        _ => f64::NAN,
    }
}

/// A number of the change in runs that end in a catastrophe.
fn in_catastrophe(run: &RunNumbers, of: fn(&BoxChange) -> f64) -> f64 {
    match &run.change {
        Some(change) if is(run, Aftermath::Catastrophe) == 1.0 => of(change),
        _ => f64::NAN,
    }
}

/// A number of the first pair in one form of the matrix.
fn first(pair: Option<FirstPair>, of: fn(&FirstPair) -> f64) -> f64 {
    pair.as_ref().map_or(f64::NAN, of)
}

/// A number of the change in every run.
fn change(run: &RunNumbers, of: fn(&BoxChange) -> f64) -> f64 {
    run.change.as_ref().map_or(f64::NAN, of)
}

const QUANTITIES: [Quantity; 27] = [
    ("birth", |run| run.birth),
    ("has_pair", |run| f64::from(u8::from(run.birth.is_finite()))),
    ("first_frame_with_pair", |run| {
        first(run.forms.ours, |p| p.after)
    }),
    ("first_frame_with_pair_paper_form", |run| {
        first(run.forms.paper, |p| p.after)
    }),
    ("first_omega_r", |run| first(run.forms.ours, |p| p.omega_r)),
    ("first_omega_r_paper_form", |run| {
        first(run.forms.paper, |p| p.omega_r)
    }),
    ("first_omega_i", |run| first(run.forms.ours, |p| p.omega_i)),
    ("first_omega_i_paper_form", |run| {
        first(run.forms.paper, |p| p.omega_i)
    }),
    ("lambda_i", |run| run.pair[0]),
    ("omega_i_error", |run| run.fit[0]),
    ("omega_r_error", |run| run.fit[1]),
    ("omega_i_error_of_time_step", |run| run.fit[2]),
    ("omega_r_error_of_time_step", |run| run.fit[3]),
    ("decades", |run| run.decades),
    ("overlap_less_chance", |run| run.overlap[0] - run.overlap[1]),
    ("catastrophe", |run| is(run, Aftermath::Catastrophe)),
    ("saturation", |run| is(run, Aftermath::Saturation)),
    ("growing", |run| is(run, Aftermath::Growing)),
    ("change_over_pressure", |run| {
        change(run, |c| c.change_over_pressure)
    }),
    ("change_over_stress", |run| {
        change(run, |c| c.change_over_stress)
    }),
    ("change_over_pressure_catastrophe", |run| {
        in_catastrophe(run, |c| c.change_over_pressure)
    }),
    ("change_over_stress_catastrophe", |run| {
        in_catastrophe(run, |c| c.change_over_stress)
    }),
    ("stress_over_pressure_before", |run| {
        change(run, |c| c.stress_before.abs() / c.pressure_before)
    }),
    ("energy_change_catastrophe", |run| {
        in_catastrophe(run, |c| c.energy_change)
    }),
    ("contacts_change_catastrophe", |run| {
        in_catastrophe(run, |c| c.contacts_change)
    }),
    ("linear_growth_times", |run| {
        change(run, |c| c.linear_until) * run.pair[1]
    }),
    ("catastrophe_growth_times", |run| {
        change(run, |c| c.catastrophe_at) * run.pair[1]
    }),
];

/// Columns of the change that are not among the quantities, and their places.
fn further() -> impl Iterator<Item = (&'static str, usize)> {
    let names = BoxChange::COLUMNS.iter().map(|column| column.name);
    let known = |name: &str| QUANTITIES.iter().any(|(known, _)| *known == name);
    names.zip(0..).filter(move |(name, _)| !known(name))
}

/// Names and contents of the tables: one line per run, and means over families.
pub(super) fn tables(runs: &[RunNumbers]) -> [(&'static str, String); 2] {
    let of_runs = Table::of(runs)
        .column("path", |run| &run.path)
        .column("runs_of", |run| &run.family)
        .column("aftermath", |run| {
            let of = run.change.as_ref().filter(|_| run.pair[0].is_finite());
            of.map_or("", |change| change.aftermath().name())
        })
        .column("frames", |run| run.forms.frames)
        .columns(QUANTITIES.map(|(name, _)| name), |run| {
            QUANTITIES.map(|(_, of)| of(run))
        })
        .columns(further().map(|(name, _)| name), |run| {
            let values = run.change.as_ref().map(BoxChange::columns);
            further().map(move |(_, k)| values.map_or(f64::NAN, |values| values[k]))
        });
    let rows = families(runs);
    let spreads = rows.iter().flat_map(|(family, members)| {
        QUANTITIES.iter().map(move |(name, of)| {
            let spread = Spread::of(members.iter().map(|run| of(run)));
            (*family, *name, spread)
        })
    });
    let of_families = Table::of(spreads)
        .column("runs_of", |(family, ..)| *family)
        .column("what", |(_, what, _)| *what)
        .column("runs", |(.., spread)| spread.count)
        .column("mean", |(.., spread)| spread.mean)
        .column("error", |(.., spread)| spread.error)
        .column("least", |(.., spread)| spread.least)
        .column("median", |(.., spread)| spread.median)
        .column("greatest", |(.., spread)| spread.greatest);
    [
        ("ensemble-runs.csv", of_runs.csv()),
        ("ensemble.csv", of_families.csv()),
    ]
}

/// Draws cumulative distributions over the runs of each family: of the change of the shear stress
/// over the pressure and over the stress before, and of the births in both forms of the matrix.
pub(super) fn figure_of(runs: &[RunNumbers]) -> SvgWithData {
    let families = families(runs);
    let names: Vec<&str> = families.iter().map(|(name, _)| *name).collect();
    let sorted = |of: fn(&RunNumbers) -> f64| -> Vec<Vec<f64>> {
        let of_family = |(_, members): &(&str, Vec<&RunNumbers>)| {
            let values = members.iter().map(|run| of(run));
            let mut values: Vec<f64> = values.filter(|x| *x > 0.0 && x.is_finite()).collect();
            values.sort_unstable_by(f64::total_cmp);
            values
        };
        families.iter().map(of_family).collect()
    };
    let panels = [
        (
            "(a)",
            "|Δσ| over the pressure before",
            sorted(|run| change(run, |c| c.change_over_pressure)),
            None,
            Vec::new(),
        ),
        (
            "(b)",
            "|Δσ| over |σ| before",
            sorted(|run| change(run, |c| c.change_over_stress)),
            Some(DROP_OF_THE_PAPER),
            Vec::new(),
        ),
        (
            "(c)",
            "strain γ of the first frame with a pair: K, and dots in the paper's form",
            sorted(|run| first(run.forms.ours, |p| p.after)),
            None,
            sorted(|run| first(run.forms.paper, |p| p.after)),
        ),
    ];
    let mut rows = Vec::new();
    let mut drawn = Vec::new();
    for (panel, label, curves, mark, dots) in &panels {
        for (kind, sets) in [("line", curves), ("dots", dots)] {
            for (family, values) in names.iter().zip(sets) {
                let count = values.len() as f64;
                let share = values.iter().enumerate();
                rows.extend(share.map(|(k, x)| {
                    let share = (k + 1) as f64 / count;
                    (*panel, *family, kind, *x, share)
                }));
            }
        }
        drawn.push(cumulative([*panel, *label], &names, curves, *mark, dots));
    }
    let csv = Table::of(rows)
        .column("panel", |(panel, ..)| *panel)
        .column("runs_of", |(_, family, ..)| *family)
        .column("what", |(_, _, kind, ..)| *kind)
        .column("value", |(.., value, _)| *value)
        .column("share_of_runs", |(.., share)| *share)
        .csv();
    SvgWithData {
        svg: grid_of(1, &drawn),
        csv,
    }
}

/// Draws shares of the runs up to a value, on a logarithmic axis: a line, and dots of a second set.
fn cumulative(
    [heading, label]: [&str; 2],
    names: &[&str],
    curves: &[Vec<f64>],
    mark: Option<f64>,
    dots: &[Vec<f64>],
) -> String {
    let all = || curves.iter().chain(dots).flatten().copied().chain(mark);
    let low = all().fold(f64::INFINITY, f64::min).log10();
    let high = all().fold(f64::NEG_INFINITY, f64::max).log10();
    let x = match low.is_finite() {
        true => [low - 0.1, high + 0.1],
        false => [-1.0, 0.0],
    };
    let y = [0.0, 1.05];
    let steps = |values: &[f64]| -> Vec<[f64; 2]> {
        let count = values.len() as f64;
        let mut points = vec![[x[0], 0.0]];
        for (k, value) in values.iter().enumerate() {
            let at = value.log10();
            points.extend([[at, k as f64 / count], [at, (k + 1) as f64 / count]]);
        }
        points.push([x[1], 1.0]);
        points
    };
    figure(PANEL, x, y, |plot| {
        let (x_ticks, y_ticks) = (ticks::decades(x[0], x[1], 8), ticks::round(0.0, 1.0, 5));
        plot.grid(&x_ticks, &y_ticks);
        if let Some(mark) = mark {
            plot.vertical_line(mark.log10(), GREY);
        }
        let colour = |k: usize| CURVES.get(k).copied().unwrap_or(INK);
        for (k, values) in curves.iter().enumerate().filter(|(_, v)| !v.is_empty()) {
            plot.line(&steps(values), colour(k), 1.6);
        }
        for (k, values) in dots.iter().enumerate() {
            for (place, value) in values.iter().enumerate() {
                let share = (place + 1) as f64 / values.len() as f64;
                plot.disk([value.log10(), share], 2.4, colour(k), None);
            }
        }
        plot.clip();
        plot.axes(&x_ticks, &y_ticks, label, "share of the runs");
        plot.heading(heading);
        let entries: Vec<_> = names
            .iter()
            .enumerate()
            .map(|(k, name)| (colour(k), *name))
            .collect();
        plot.legend(&entries);
    })
}

/// Returns the page: the figure, and a table of means.
pub(super) fn html(runs: &[RunNumbers]) -> String {
    let mut tables = String::new();
    for (family, members) in families(runs) {
        let rows: String = QUANTITIES
            .iter()
            .map(|(name, of)| {
                let spread = Spread::of(members.iter().map(|run| of(run)));
                format!(
                    "<tr><th>{name}</th><td>{}</td><td>{:.4e} ± {:.1e}</td><td>{:.4e}</td><td>{:.4e} … {:.4e}</td></tr>\n",
                    spread.count, spread.mean, spread.error, spread.median, spread.least, spread.greatest
                )
            })
            .collect();
        tables += &format!(
            "<h3>{}: {} runs</h3>\n<table>\n<tr><th></th><td>runs that have it</td><td>mean and standard error</td><td>median</td><td>range</td></tr>\n{rows}</table>\n",
            escape(family),
            members.len()
        );
    }
    let body = format!(
        "<figure>\n<img src=\"ensemble.svg\" alt=\"Cumulative distributions\" style=\"max-width: 100%\"/>\n<figcaption>Shares of the runs. \
         (a) Change of the shear stress over Newton's equations, over the pressure before. (b) The same over the size of the shear stress \
         before; the vertical line is the paper's 22 %. (c) Births by the frames of the strain steps, lines with K, dots with J in the paper's \
         form. {}</figcaption>\n</figure>\n\
         <p><a href=\"ensemble.csv\">ensemble.csv</a>, <a href=\"ensemble-runs.csv\">ensemble-runs.csv</a>. Of a quantity that a run has or \
         has not, such as catastrophe, the mean is the share of the runs.</p>\n{tables}",
        links("ensemble", &["ensemble-distributions.csv"])
    );
    let lead = format!("{} runs, by what they have in common.", runs.len());
    document("Ensemble of the study of Bonfanti et al.", &lead, &body)
}
