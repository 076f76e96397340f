//! The scalars of the frames around the largest drop: figures 8 and 21.

use plotters::style::RGBColor;

use super::curves::{shade, stage_of};
use super::studied::{Event, Size, Studied};
use super::{Drawn, Figure, no_run};
use crate::colour::CURVES;
use crate::compose::grid_of;
use crate::plot::{Layout, figure as plotted};
use crate::{curves, ticks};
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_analysis::spearman::Correlation;
use gshear_store::table::Table;

const PANEL: Layout = Layout {
    size: [560.0, 330.0],
    margin: [72.0, 62.0, 16.0, 58.0],
};

type ScalarCurve<'a> = (&'a str, RGBColor, Box<dyn Fn(&FrameScalars) -> f64>);

/// Draws Spearman's ρ of |Δσ_p| with D²min, the greatest D²min, the number of GR regions and their
/// contact angles around the drop.
pub fn figure(number: u8, run: Option<&Studied>) -> Drawn {
    let size = if number == 8 {
        Size::Small
    } else {
        Size::Large
    };
    let run = run.ok_or_else(|| no_run(number, size))?;
    let no_slip = || (number, "no slip in the regime".to_string());
    let event = run.event.as_ref().ok_or_else(no_slip)?;
    let square = run.grains.mean_radius().powi(2);
    let [one, two, three, four] = [CURVES[0], CURVES[1], CURVES[2], CURVES[3]];
    let significant = |s: &FrameScalars| {
        let is = s.stress_dmin_p <= Correlation::SIGNIFICANT;
        if is { s.stress_dmin_rho } else { f64::NAN }
    };
    let level = move |value: f64| (value / square).log10();
    let panels = [
        panel(
            run,
            event,
            "(a)",
            "Spearman ρ of |Δσ_{p}| with D²_{min}",
            false,
            &[("ρ where p ≤ 0.05", one, Box::new(significant))],
        ),
        panel(
            run,
            event,
            "(b)",
            "D²_{min}/r̄²",
            true,
            &[
                ("gD²_{min}", one, Box::new(move |s| level(s.dmin_greatest))),
                (
                    "g_{t10%}D²_{min}",
                    two,
                    Box::new(move |s| level(s.dmin_top_tenth)),
                ),
            ],
        ),
        panel(
            run,
            event,
            "(c)",
            "number of GR regions",
            false,
            &[
                ("minPts = 1", one, Box::new(|s| s.regions)),
                ("minPts = 2", two, Box::new(|s| s.regions_of_two)),
                ("losses", three, Box::new(|s| s.loss_regions)),
                ("greatest loss", four, Box::new(|s| s.greatest_loss_regions)),
            ],
        ),
        panel(
            run,
            event,
            "(d)",
            "|θ| in GR regions (rad)",
            false,
            &[
                ("mean", one, Box::new(|s| s.region_angle_mean)),
                ("median", two, Box::new(|s| s.region_angle_median)),
            ],
        ),
    ];
    Ok(Figure {
        number,
        caption: format!(
            "Around the largest drop of the run {}, for every interval Δγ: (a) Spearman's coefficient between the change of the \
             largest principal stress of a grain and its D²<sub>min</sub>; (b) the greatest D²<sub>min</sub> and the mean of the \
             greatest 10 %; (c) the number of GR regions, for both readings of DBSCAN's minPts, and by the losses of a grain's contacts alone and by its greatest loss; (d) mean and median of the contact \
             angles in GR regions. Shaded: the stages.",
            run.label
        ),
        svg: grid_of(2, &panels),
        data: vec![(".csv", table(run, event))],
    })
}

fn panel(
    run: &Studied,
    event: &Event,
    letter: &str,
    y_label: &str,
    logarithmic: bool,
    curves: &[ScalarCurve],
) -> String {
    let rows: Vec<usize> = (event.stages.begin + 1..=event.stages.end).collect();
    let percent = curves::percent_of(&run.regime.strain);
    let values: Vec<Vec<f64>> = curves
        .iter()
        .map(|(.., of)| run.regime.scalars.iter().map(of).collect())
        .collect();
    let shown = values
        .iter()
        .flat_map(|values| rows.iter().map(|row| values[*row]));
    let y = curves::padded(shown, 0.08);
    let x = curves::padded(
        (event.stages.begin..=event.stages.end).map(|row| percent[row]),
        0.02,
    );
    plotted(PANEL, x, y, |plot| {
        let x_ticks = ticks::round(x[0], x[1], 4);
        let y_ticks = if logarithmic {
            ticks::decades(y[0], y[1], 6)
        } else {
            ticks::round(y[0], y[1], 5)
        };
        shade(plot, run, event);
        plot.grid(&[], &y_ticks);
        for ((_, colour, _), values) in curves.iter().zip(&values) {
            curves::draw(plot, &percent, values, &rows, *colour, 1.3);
            for &row in rows.iter().filter(|row| values[**row].is_finite()) {
                plot.disk([percent[row], values[row]], 2.0, *colour, None);
            }
        }
        plot.clip();
        plot.axes(&x_ticks, &y_ticks, "shear strain γ (%)", y_label);
        plot.heading(letter);
        let legend: Vec<_> = curves
            .iter()
            .map(|(name, colour, _)| (*colour, *name))
            .collect();
        plot.legend(&legend);
    })
}

fn table(run: &Studied, event: &Event) -> String {
    Table::of(event.stages.begin + 1..=event.stages.end)
        .column("strain", |row| run.regime.strain[*row])
        .column("stress_ratio", |row| run.regime.tau[*row])
        .column("stage", |row| stage_of(event, *row))
        .columns(FrameScalars::COLUMNS, |row| {
            run.regime.scalars[*row].columns()
        })
        .csv()
}
