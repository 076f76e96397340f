//! τ(γ): figures 2, 12, 14 and 24.

use super::studied::{DropStage, Event, Size, Studied};
use super::{Drawn, Figure, no_run};
use crate::colour::{CURVES, GREY, INK, STAGES};
use crate::compose::grid_of;
use crate::plot::{Layout, Plot, figure};
use crate::{curves, ticks};
use gshear_store::table::Table;

const WIDE: Layout = Layout {
    size: [900.0, 380.0],
    margin: [72.0, 62.0, 24.0, 58.0],
};
const X_LABEL: &str = "shear strain γ (%)";
const Y_LABEL: &str = "shear stress ratio τ = S/N";

/// Draws figure 2: the whole curve and the largest drop of one run.
pub fn whole_and_event(number: u8, run: Option<&Studied>) -> Drawn {
    let run = run.ok_or_else(|| no_run(number, Size::Small))?;
    let mut panels = vec![several("(a)", &[run])];
    if let Some(event) = &run.event {
        panels.push(around("(b)", run, event));
    }
    Ok(Figure {
        number,
        caption: format!(
            "(a) Normalised shear stress over shear strain of the run {}. Dashed: start of the stick-slip regime. \
             (b) The same around the largest drop of the regime, with the three stages: before, during and after it.{}",
            run.label,
            of_steps(run)
        ),
        svg: grid_of(1, &panels),
        data: vec![(".csv", table(&[run], Some(run)))],
    })
}

/// Draws figures 12 and 24: all runs of a size.
pub fn of_frictions(number: u8, size: Size, runs: &[&Studied]) -> Drawn {
    if runs.is_empty() {
        return Err(no_run(number, size));
    }
    Ok(Figure {
        number,
        caption: format!(
            "Normalised shear stress over shear strain for each friction coefficient, {} sample.",
            size.name()
        ),
        svg: several("", runs),
        data: vec![(".csv", table(runs, None))],
    })
}

/// Draws figure 14: both sizes, and the largest drop of the large sample.
pub fn of_sizes(number: u8, small: Option<&Studied>, large: Option<&Studied>) -> Drawn {
    let large = large.ok_or_else(|| no_run(number, Size::Large))?;
    let runs: Vec<&Studied> = small.into_iter().chain([large]).collect();
    let mut panels = vec![several("(a)", &runs)];
    if let Some(event) = &large.event {
        panels.push(around("(b)", large, event));
    }
    Ok(Figure {
        number,
        caption: format!(
            "(a) Normalised shear stress over shear strain of a small and a large sample. (b) The same around the largest \
             drop of the large one, with the three stages; large slips that closely follow the largest one belong to Stage II.{}",
            of_steps(large)
        ),
        svg: grid_of(1, &panels),
        data: vec![(".csv", table(&runs, Some(large)))],
    })
}

fn of_steps(run: &Studied) -> &'static str {
    match &run.event {
        Some(event) if !event.steps.is_empty() => " Numbers: steps shown in the maps.",
        _ => "",
    }
}

fn several(letter: &str, runs: &[&Studied]) -> String {
    let percent: Vec<Vec<f64>> = runs
        .iter()
        .map(|run| curves::percent_of(&run.strain))
        .collect();
    let x = curves::padded(percent.iter().flatten().copied(), 0.0);
    let y = curves::padded(runs.iter().flat_map(|run| &run.tau).copied(), 0.08);
    figure(WIDE, x, y, |plot| {
        let (x_ticks, y_ticks) = (ticks::round(x[0], x[1], 10), ticks::round(y[0], y[1], 6));
        plot.grid(&x_ticks, &y_ticks);
        for (k, run) in runs.iter().enumerate() {
            let rows: Vec<usize> = (0..run.tau.len()).collect();
            curves::draw(
                plot,
                &percent[k],
                &run.tau,
                &rows,
                CURVES[k % CURVES.len()],
                0.9,
            );
        }
        for run in runs {
            plot.vertical_line(100.0 * run.onset, GREY);
        }
        plot.clip();
        plot.axes(&x_ticks, &y_ticks, X_LABEL, Y_LABEL);
        plot.heading(letter);
        legend(plot, runs);
    })
}

/// Draws the legend: labels of runs in the colours of their order.
pub fn legend(plot: &mut Plot, runs: &[&Studied]) {
    let names: Vec<String> = runs.iter().map(|run| run.typeset_label()).collect();
    let entries = names.iter().enumerate();
    let entries: Vec<_> = entries
        .map(|(k, name)| (CURVES[k % CURVES.len()], name.as_str()))
        .collect();
    plot.legend(&entries);
}

fn around(letter: &str, run: &Studied, event: &Event) -> String {
    let stages = &event.stages;
    let percent = curves::percent_of(&run.regime.strain);
    let tau = &run.regime.tau;
    let rows: Vec<usize> = (stages.begin..=stages.end).collect();
    let x = curves::padded(rows.iter().map(|row| percent[*row]), 0.02);
    let y = curves::padded(rows.iter().map(|row| tau[*row]), 0.14);
    figure(WIDE, x, y, |plot| {
        let (x_ticks, y_ticks) = (ticks::round(x[0], x[1], 6), ticks::round(y[0], y[1], 6));
        shade(plot, run, event);
        plot.grid(&[], &y_ticks);
        curves::draw(plot, &percent, tau, &rows, INK, 1.4);
        for &row in rows.iter().filter(|_| rows.len() <= 200) {
            plot.disk([percent[row], tau[row]], 2.2, INK, None);
        }
        for step in &event.steps {
            plot.label_above([percent[step.row], tau[step.row]], &step.number.to_string());
        }
        plot.clip();
        plot.axes(&x_ticks, &y_ticks, X_LABEL, Y_LABEL);
        plot.heading(letter);
        plot.legend(&[
            (STAGES[0], "Stage I"),
            (STAGES[1], "Stage II"),
            (STAGES[2], "Stage III"),
        ]);
    })
}

/// Shades the stages behind the data; x is γ in percent.
pub fn shade(plot: &mut Plot, run: &Studied, event: &Event) {
    let strain = |row: usize| 100.0 * run.regime.strain[row];
    let stages = &event.stages;
    let ends = [stages.begin, stages.drop, stages.calm, stages.end];
    for (k, colour) in STAGES.into_iter().enumerate() {
        plot.band(strain(ends[k]), strain(ends[k + 1]), colour, 0.45);
    }
}

/// Panel a: every row of the time series of `runs`. Panel b: the rows around the largest drop of
/// `with_event`; the stage is that of the interval which a row ends.
fn table(runs: &[&Studied], with_event: Option<&Studied>) -> String {
    let whole = runs.iter().flat_map(|run| {
        let curve = run.strain.iter().zip(&run.tau);
        curve.map(|(strain, tau)| ("a", *run, *strain, *tau, None, None))
    });
    let events = with_event
        .into_iter()
        .filter_map(|run| Some((run, run.event.as_ref()?)));
    let around = events.flat_map(|(run, event)| {
        (event.stages.begin..=event.stages.end).map(move |row| {
            let step = event.steps.iter().find(|step| step.row == row);
            let (strain, tau) = (run.regime.strain[row], run.regime.tau[row]);
            let stage = stage_of(event, row);
            ("b", run, strain, tau, Some(stage), step.map(|s| s.number))
        })
    });
    Table::of(whole.chain(around))
        .column("panel", |(panel, ..)| *panel)
        .column("run", |(_, run, ..)| &run.label)
        .column("strain", |(_, _, strain, ..)| *strain)
        .column("stress_ratio", |(_, _, _, tau, ..)| *tau)
        .column("stage", |(.., stage, _)| *stage)
        .column("step", |(.., step)| *step)
        .csv()
}

/// Returns the name of the stage that contains the interval ending at a row.
pub fn stage_of(event: &Event, row: usize) -> &'static str {
    if row <= event.stages.drop {
        DropStage::Before.name()
    } else if row <= event.stages.calm {
        DropStage::Drop.name()
    } else {
        DropStage::After.name()
    }
}
