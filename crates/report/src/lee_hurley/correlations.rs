//! Spearman's coefficients by range: figures 9, 10, 11, 13, 22, 23 and 25.

use plotters::style::RGBColor;

use super::family::Family;
use super::studied::{Size, Studied};
use super::{Drawn, Figure, no_run};
use crate::colour::{CURVES, PALE};
use crate::compose::grid_of;
use crate::plot::{Layout, Marker, figure};
use crate::ticks::{self, Tick};
use gshear_analysis::correlate::{Length, Quantity, Subject};
use gshear_analysis::ranges::ValueRange;
use gshear_analysis::spearman::Correlation;
use gshear_store::table::Table;

use Length::{All, Long, Short};
use Quantity::{AngleMean, AngleMedian, DminMax, DminSum, Duration, RegionsLeast, TopMax, TopSum};

const PANEL: Layout = Layout {
    size: [560.0, 330.0],
    margin: [64.0, 62.0, 16.0, 58.0],
};
/// Half the gap between slip and stick on the axis of Δτ (decades).
const GAP: f64 = 0.5;
/// log10 of the least |Δτ| shown.
const LEAST: f64 = -5.0;
/// Panels (a) to (j) of figures 13, 22 and 25.
const PANELS: [Subject; 10] = [
    Subject::TopTenth,
    Subject::Phase(TopMax, All),
    Subject::Phase(TopMax, Long),
    Subject::Phase(TopMax, Short),
    Subject::Phase(DminMax, Long),
    Subject::Phase(TopSum, All),
    Subject::Phase(TopSum, Long),
    Subject::Phase(TopSum, Short),
    Subject::Phase(DminSum, Long),
    Subject::Phase(Duration, Long),
];
const OMITTED: &str = "Points with p > 0.05 are left out, but kept in the table.";

struct RunCurve {
    name: String,
    colour: RGBColor,
    marker: Marker,
    points: Vec<(ValueRange, Correlation)>,
    /// Half-length of the error bar at every point; empty without bars.
    bars: Vec<f64>,
}

fn curve(k: usize, name: String, points: Vec<(ValueRange, Correlation)>) -> RunCurve {
    RunCurve {
        name,
        colour: CURVES[k % CURVES.len()],
        marker: Marker::ALL[k % Marker::ALL.len()],
        points,
        bars: Vec::new(),
    }
}

/// Draws figures 9, 10 and 11.
pub fn of_one(run: Option<&Studied>) -> Vec<Drawn> {
    let Some(run) = run else {
        return [9, 10, 11]
            .map(|number| Err(no_run(number, Size::Small)))
            .into();
    };
    let four =
        |length: Length| [DminMax, TopMax, DminSum, TopSum].map(|q| Subject::Phase(q, length));
    let nine = [
        (
            "Δτ, all intervals",
            vec![Subject::Greatest, Subject::TopTenth],
        ),
        ("Δτ_{p}, all phases", four(All).into()),
    ];
    let ten = [
        ("Δτ_{p}, long phases (t_{p} > 3Δγ)", four(Long).to_vec()),
        ("Δτ_{p}, short phases (t_{p} ≤ 3Δγ)", four(Short).to_vec()),
        (
            "Δτ_{p}, long and short phases",
            vec![
                Subject::Phase(Duration, Long),
                Subject::Phase(Duration, Short),
            ],
        ),
    ];
    vec![
        Ok(by_stress(
            9,
            run,
            &nine,
            format!(
                "Absolute values of Spearman's coefficient (a) of Δτ with gD²<sub>min</sub> and g<sub>t10%</sub>D²<sub>min</sub> over \
                 all intervals and (b) of Δτ<sub>p</sub> with the four measures over all phases of the regime, run {}. {OMITTED}",
                run.label
            ),
        )),
        Ok(by_stress(
            10,
            run,
            &ten,
            format!(
                "The same for (a) long and (b) short phases, and (c) of Δτ<sub>p</sub> with the duration t<sub>p</sub> of long and \
                 short phases, run {}. {OMITTED}",
                run.label
            ),
        )),
        Ok(by_measure(
            11,
            run,
            &[AngleMean, AngleMedian],
            format!(
                "Absolute values of Spearman's coefficient of Δτ<sub>p</sub> with mean and median contact angle in GR regions, in ranges \
                 of (a) mg<sub>t10%</sub>D²<sub>min</sub> and (b) sg<sub>t10%</sub>D²<sub>min</sub>, long phases, at the last interval \
                 with the least number of regions, run {}. {OMITTED}",
                run.label
            ),
        )),
    ]
}

/// Draws figure 23: N_c of the large sample.
pub fn of_regions(number: u8, run: Option<&Studied>) -> Drawn {
    let run = run.ok_or_else(|| no_run(number, Size::Large))?;
    let caption = format!(
        "Absolute values of Spearman's coefficient of Δτ<sub>p</sub> with N<sub>c</sub>, the least number of GR regions in a phase, in ranges \
         of (a) mg<sub>t10%</sub>D²<sub>min</sub> and (b) sg<sub>t10%</sub>D²<sub>min</sub>, long phases, run {}. {OMITTED}",
        run.label
    );
    Ok(by_measure(number, run, &[RegionsLeast], caption))
}

/// Draws figures 13 and 25: all runs of a size.
pub fn of_frictions(number: u8, size: Size, runs: &[&Studied]) -> Drawn {
    if runs.is_empty() {
        return Err(no_run(number, size));
    }
    let caption = format!(
        "{} for each friction coefficient, {} sample. {OMITTED}",
        panels_caption(),
        size.name()
    );
    Ok(compared(number, runs, caption))
}

/// Draws figure 22: a small and a large sample.
pub fn of_sizes(number: u8, small: Option<&Studied>, large: Option<&Studied>) -> Drawn {
    let large = large.ok_or_else(|| no_run(number, Size::Large))?;
    let small = small.ok_or_else(|| no_run(number, Size::Small))?;
    let caption = format!(
        "{} for a small and a large sample. {OMITTED}",
        panels_caption()
    );
    Ok(compared(number, &[small, large], caption))
}

fn panels_caption() -> &'static str {
    "Absolute values of Spearman's coefficient of (a) Δτ with g<sub>t10%</sub>D²<sub>min</sub> over all intervals; of Δτ<sub>p</sub> with \
     mg<sub>t10%</sub>D²<sub>min</sub> over (b) all, (c) long, (d) short phases; with mgD²<sub>min</sub> over (e) long phases; with \
     sg<sub>t10%</sub>D²<sub>min</sub> over (f) all, (g) long, (h) short phases; with sgD²<sub>min</sub> over (i) long phases; with \
     t<sub>p</sub> over (j) long phases"
}

fn symbol(subject: Subject) -> &'static str {
    match subject {
        Subject::Greatest => "gD²_{min}",
        Subject::TopTenth => "g_{t10%}D²_{min}",
        Subject::Phase(quantity, _) => quantity.symbol(),
    }
}

/// Returns the keys of a subject in tables: what is correlated, and over which intervals or phases.
pub fn key(subject: Subject) -> [&'static str; 2] {
    match subject {
        Subject::Greatest => ["dmin_greatest", "intervals"],
        Subject::TopTenth => ["dmin_top_tenth", "intervals"],
        Subject::Phase(quantity, length) => [quantity.name(), length.name()],
    }
}

/// Coefficients of a panel and run, for a table.
struct PanelCoefficients<'a> {
    panel: char,
    run: &'a Studied,
    of: &'static str,
    with: &'static str,
    over: &'static str,
    range_of: String,
    points: Vec<(ValueRange, Correlation)>,
}

fn letter(k: usize) -> char {
    char::from(b'a' + k as u8)
}

/// Draws panels of one run with a curve per subject.
fn by_stress(
    number: u8,
    run: &Studied,
    panels: &[(&str, Vec<Subject>)],
    caption: String,
) -> Figure {
    let mut found = Vec::new();
    let mut drawn = Vec::new();
    for (k, (title, subjects)) in panels.iter().enumerate() {
        let mut curves = Vec::new();
        for (c, subject) in subjects.iter().enumerate() {
            let points = run.regime.correlate(*subject);
            found.push(found_by_stress(letter(k), run, *subject, &points));
            let alone = matches!(subject, Subject::Phase(Duration, _));
            let name = if alone {
                format!("t_{{p}}, {}", key(*subject)[1])
            } else {
                symbol(*subject).into()
            };
            curves.push(curve(c, name, points));
        }
        drawn.push(panel_of_stress(
            &format!("({}) {title}", letter(k)),
            &curves,
        ));
    }
    let svg = grid_of(2, &drawn);
    Figure {
        number,
        caption,
        svg,
        data: vec![(".csv", table(&found))],
    }
}

/// Draws the ten panels with a curve per run.
fn compared(number: u8, runs: &[&Studied], caption: String) -> Figure {
    let mut found = Vec::new();
    let mut drawn = Vec::new();
    for (k, subject) in PANELS.into_iter().enumerate() {
        let mut curves = Vec::new();
        for (c, run) in runs.iter().enumerate() {
            let points = run.regime.correlate(subject);
            found.push(found_by_stress(letter(k), run, subject, &points));
            curves.push(curve(c, run.typeset_label(), points));
        }
        drawn.push(panel_of_stress(&title(k, subject), &curves));
    }
    let svg = grid_of(2, &drawn);
    Figure {
        number,
        caption,
        svg,
        data: vec![(".csv", table(&found))],
    }
}

/// Draws the ten panels with a curve per family: means with standard errors.
pub fn seeds(families: &[&Family]) -> String {
    let mut drawn = Vec::new();
    for (k, subject) in PANELS.into_iter().enumerate() {
        let of_family = |(c, family): (usize, &&Family)| {
            let found = family.correlate(subject);
            let points = found.iter().map(|(range, mean, _)| (*range, *mean));
            let name = family.label().replace("μ_s", "μ_{s}");
            RunCurve {
                bars: found.iter().map(|(_, _, spread)| spread.error).collect(),
                ..curve(c, name, points.collect())
            }
        };
        let curves: Vec<RunCurve> = families.iter().enumerate().map(of_family).collect();
        drawn.push(panel_of_stress(&title(k, subject), &curves));
    }
    grid_of(2, &drawn)
}

/// Heading of one of the ten panels.
fn title(k: usize, subject: Subject) -> String {
    let over = key(subject)[1];
    match subject {
        Subject::Phase(..) => format!(
            "({}) Δτ_{{p}} – {}, {over} phases",
            letter(k),
            symbol(subject)
        ),
        _ => format!("({}) Δτ – {}, all intervals", letter(k), symbol(subject)),
    }
}

fn found_by_stress<'a>(
    panel: char,
    run: &'a Studied,
    subject: Subject,
    points: &[(ValueRange, Correlation)],
) -> PanelCoefficients<'a> {
    let [with, over] = key(subject);
    let of = if over == "intervals" {
        "delta_tau"
    } else {
        "delta_tau_p"
    };
    PanelCoefficients {
        panel,
        run,
        of,
        with,
        over,
        range_of: of.into(),
        points: points.to_vec(),
    }
}

fn table(found: &[PanelCoefficients]) -> String {
    let rows = found
        .iter()
        .flat_map(|found| found.points.iter().map(move |point| (found, point)));
    Table::of(rows)
        .column("panel", |(found, _)| found.panel)
        .column("run", |(found, _)| &found.run.label)
        .column("of", |(found, _)| found.of)
        .column("with", |(found, _)| found.with)
        .column("over", |(found, _)| found.over)
        .column("range_of", |(found, _)| &found.range_of)
        .column("from", |(_, (range, _))| range.nearer)
        .column("to", |(_, (range, _))| range.farther)
        .column("pairs", |(_, (_, correlation))| correlation.count)
        .column("rho", |(_, (_, correlation))| correlation.rho)
        .column("p", |(_, (_, correlation))| correlation.p)
        .csv()
}

/// Draws two panels, by mg_t10%D²min and by sg_t10%D²min.
fn by_measure(number: u8, run: &Studied, quantities: &[Quantity], caption: String) -> Figure {
    let unit = run.grains.mean_radius().powi(2);
    let mut found = Vec::new();
    let mut drawn = Vec::new();
    for (k, by) in [TopMax, TopSum].into_iter().enumerate() {
        let mut curves = Vec::new();
        for (c, quantity) in quantities.iter().enumerate() {
            let points = run.regime.correlate_by(by, unit, *quantity);
            found.push(PanelCoefficients {
                panel: letter(k),
                run,
                of: "delta_tau_p",
                with: quantity.name(),
                over: "long",
                range_of: format!("{}_over_mean_radius_squared", by.name()),
                points: points.clone(),
            });
            curves.push(curve(c, quantity.symbol().into(), points));
        }
        let title = format!("({}) Δτ_{{p}}, long phases", letter(k));
        drawn.push(panel_of_measure(
            &title,
            &format!("{}/r̄²", by.symbol()),
            &curves,
        ));
    }
    let svg = grid_of(2, &drawn);
    Figure {
        number,
        caption,
        svg,
        data: vec![(".csv", table(&found))],
    }
}

/// Position of a change of τ on an axis that is logarithmic on both sides of a gap.
fn place(change: f64) -> f64 {
    (change.abs().log10() - LEAST + GAP).copysign(change)
}

fn panel_of_stress(title: &str, curves: &[RunCurve]) -> String {
    let end = -1.0 - LEAST + GAP;
    let tick = |power: i32, sign: f64| -> Tick {
        let at = place(sign * 10f64.powi(power));
        let minus = if sign < 0.0 { "−" } else { "" };
        (at, format!("{minus}10^{{−{}}}", -power))
    };
    let powers = || (-5..=-1).rev();
    let x_ticks: Vec<Tick> = powers()
        .map(|power| tick(power, -1.0))
        .chain((-5..=-1).map(|power| tick(power, 1.0)))
        .collect();
    panel(
        title,
        [-end - 0.1, end + 0.1],
        &x_ticks,
        "change of the shear stress ratio: slip | stick",
        curves,
        &place,
    )
}

fn panel_of_measure(title: &str, x_label: &str, curves: &[RunCurve]) -> String {
    let ranges = curves
        .iter()
        .flat_map(|curve| &curve.points)
        .map(|(range, _)| range);
    let ends = ranges.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], range| {
        [
            low.min(range.nearer.log10()),
            high.max(range.farther.log10()),
        ]
    });
    let x = if ends[0] < ends[1] { ends } else { [0.0, 1.0] };
    panel(
        title,
        x,
        &ticks::decades(x[0], x[1], 8),
        x_label,
        curves,
        &f64::log10,
    )
}

fn panel(
    title: &str,
    x: [f64; 2],
    x_ticks: &[Tick],
    x_label: &str,
    curves: &[RunCurve],
    place: &dyn Fn(f64) -> f64,
) -> String {
    let y_ticks = ticks::round(0.0, 1.0, 5);
    figure(PANEL, x, [0.0, 1.04], |plot| {
        plot.grid(x_ticks, &y_ticks);
        if x[0] < 0.0 && x[1] > 0.0 {
            plot.vertical_line(0.0, PALE);
        }
        for curve in curves {
            // A line joins neighbouring ranges that are both significant.
            let points = |pair: &[(ValueRange, Correlation)]| -> Option<Vec<[f64; 2]>> {
                let all = pair.iter().all(|(_, found)| found.is_significant());
                all.then(|| {
                    pair.iter()
                        .map(|(range, found)| [place(range.middle), found.rho.abs()])
                        .collect()
                })
            };
            let same_side = |pair: &&[(ValueRange, Correlation)]| {
                pair[0].0.farther.signum() == pair[1].0.farther.signum()
            };
            for line in curve.points.windows(2).filter(same_side).filter_map(points) {
                plot.line(&line, curve.colour, 1.4);
            }
            for ((range, found), bar) in curve.points.iter().zip(&curve.bars) {
                if found.is_significant() && bar.is_finite() {
                    let (x, y) = (place(range.middle), found.rho.abs());
                    plot.line(&[[x, y - bar], [x, y + bar]], curve.colour, 1.4);
                }
            }
            for at in curve.points.chunks(1).filter_map(points).flatten() {
                plot.marker(at, curve.marker, curve.colour);
            }
        }
        if !curves
            .iter()
            .flat_map(|curve| &curve.points)
            .any(|(_, found)| found.is_significant())
        {
            plot.empty_note("no coefficient with p ≤ 0.05");
        }
        plot.clip();
        plot.axes(x_ticks, &y_ticks, x_label, "|Spearman ρ|");
        plot.heading(title);
        let legend: Vec<_> = curves
            .iter()
            .map(|curve| (curve.colour, curve.name.as_str()))
            .collect();
        plot.legend(&legend);
    })
}
