//! Maps of the steps around the largest drop: figures 3 to 7 and 15 to 20.

use super::step_tables::{contacts_table, displacement_table, grains_table};
use super::studied::{DropStage, MapStep, Size, Studied};
use super::{Drawn, Figure, no_run};
use plotters::style::RGBColor;

use crate::colour::{CHANGE, FORCE, GREY, INK, PALE, SLIP, VIRIDIS, WALL, WHITE};
use crate::compose::{gathered, grid_of};
use crate::map::{self, MapView};
use crate::plot::{Layout, Plot, figure};
use crate::ticks;
use gshear_analysis::displacement::tension;
use gshear_analysis::forces;

/// Width of the sample in a panel (px).
const WIDTH: f64 = 235.0;
/// Margins (px); at the sides wide enough for disks across the periodic boundary.
const MARGIN: [f64; 4] = [11.0, 40.0, 11.0, 6.0];
/// Greatest number of decades of D²min on the colour bar.
const DECADES: f64 = 6.0;
/// Changes below this share of the greatest are too faint to be seen and left out.
const FAINT: f64 = 2e-3;

/// Draws the figures of a run with these `numbers`: Stage I, the drop, further drops, Stage III,
/// force network, displacements. If the number of the further drops is 0, they are shown with the
/// drop.
pub fn figures(numbers: [u8; 6], run: Option<&Studied>) -> Vec<Drawn> {
    let wanted = |number: &&u8| **number != 0;
    let size = if numbers[0] == 3 {
        Size::Small
    } else {
        Size::Large
    };
    let all_but = |reason: (u8, String)| -> Vec<Drawn> {
        numbers
            .iter()
            .filter(wanted)
            .map(|number| Err((*number, reason.1.clone())))
            .collect()
    };
    let Some(run) = run else {
        return all_but(no_run(0, size));
    };
    let steps = run.event.as_ref().map_or(&[][..], |event| &event.steps);
    if steps.is_empty() {
        return all_but((
            0,
            "the run has no frames around the largest drop: replay it (gshear-reduce replay)"
                .into(),
        ));
    }
    let of = |stages: &[DropStage]| -> Vec<&MapStep> {
        steps
            .iter()
            .filter(|step| stages.contains(&step.stage))
            .collect()
    };
    let merged = numbers[2] == 0;
    let drop: &[DropStage] = if merged {
        &[DropStage::Drop, DropStage::FurtherDrop]
    } else {
        &[DropStage::Drop]
    };
    let mut drawn = vec![
        stage(
            numbers[0],
            run,
            "Stage I, before the drop",
            &of(&[DropStage::Before]),
        ),
        stage(numbers[1], run, "Stage II, during the drop", &of(drop)),
    ];
    if !merged {
        drawn.push(stage(
            numbers[2],
            run,
            "Stage II, during the further drops",
            &of(&[DropStage::FurtherDrop]),
        ));
    }
    drawn.push(stage(
        numbers[3],
        run,
        "Stage III, after the drop",
        &of(&[DropStage::After]),
    ));
    drawn.push(Ok(network(numbers[4], run, steps)));
    drawn.push(Ok(displacements(numbers[5], run, steps)));
    drawn
}

/// The view of all steps: the whole sample, or a part if it is very large.
fn view(run: &Studied, steps: &[&MapStep]) -> MapView {
    let first = steps[0];
    let centre = first
        .frame
        .position
        .get(greatest(first).unwrap_or(0))
        .copied()
        .unwrap_or_default();
    MapView::of(&run.grains, &first.frame, centre)
}

fn panel(view: MapView, title: [&str; 2], draw: impl FnOnce(&mut Plot)) -> String {
    let ratio = (view.y[1] - view.y[0]) / (view.x[1] - view.x[0]);
    let [left, top, right, bottom] = MARGIN;
    let layout = Layout {
        size: [WIDTH + left + right, (WIDTH * ratio + top + bottom).round()],
        margin: MARGIN,
    };
    gathered(&figure(layout, view.x, view.y, |plot| {
        draw(plot);
        plot.clip();
        plot.axes(&[], &[], "", "");
        plot.small_titles(title);
    }))
}

fn step_title(step: &MapStep) -> String {
    format!(
        "Step {}, Stage {}, γ = {:.5} %",
        step.number,
        step.stage.name(),
        100.0 * step.strain[1]
    )
}

/// Draws one row per step: greatest reductions of force, differential force network, greatest
/// D²min, and D²min.
fn stage(number: u8, run: &Studied, what: &str, steps: &[&MapStep]) -> Drawn {
    if steps.is_empty() {
        return Err((number, format!("{what}: this drop has no such part")));
    }
    let view = view(run, steps);
    let changes = || steps.iter().flat_map(|step| &step.force_change);
    let greatest = changes().fold(0.0, |most: f64, change| most.max(change.abs()));
    let greatest = if greatest > 0.0 { greatest } else { 1.0 };
    let levels = Levels::of(run, steps);
    let mut panels = Vec::new();
    for step in steps {
        let title = step_title(step);
        panels.push(marked(
            run,
            step,
            view,
            [&title, "greatest 1 % reduction of force"],
            &step.regions,
        ));
        panels.push(differences(run, step, view, greatest));
        panels.push(marked(
            run,
            step,
            view,
            ["", "greatest 1 % D²_{min}"],
            &step.top(),
        ));
        panels.push(dmin(run, step, view, &levels));
    }
    let (factor, unit) = ticks::prefix(greatest);
    let end = greatest * factor;
    let forces = bar(
        &CHANGE,
        ticks::round(-end, end, 8),
        [-end, end],
        &format!("change of |f| ({unit}N/m)"),
    );
    let decades = ticks::decades(levels.low, levels.high, 4);
    let dmins = bar(&VIRIDIS, decades, [levels.low, levels.high], "D²_{min}/r̄²");
    panels.extend([String::new(), forces, String::new(), dmins]);
    let caption = format!(
        "{what}, run {}: the 1 % of the grains with the greatest reduction of contact force (GR regions), differential force network, \
         the 1 % of the grains with the greatest D²<sub>min</sub>, and D²<sub>min</sub> (white: rattlers and other grains without a defined value). \
         All steps of the figure share the scales.",
        run.label
    );
    Ok(Figure {
        number,
        caption,
        svg: grid_of(4, &panels),
        data: vec![
            (".csv", grains_table(run, steps)),
            ("-contacts.csv", contacts_table(run, steps, true)),
        ],
    })
}

/// Draws all grains in pale colours, wall grains darker; without outlines, so that each kind
/// becomes one path.
fn background(plot: &mut Plot, run: &Studied, step: &MapStep, view: MapView) {
    let scale = plot.scale();
    for (wall, colour) in [(false, PALE), (true, WALL)] {
        let of_kind = |n: &usize| (run.grains.body[*n] != 0) == wall;
        for n in (0..run.grains.count()).filter(of_kind) {
            map::disk(
                plot,
                &run.grains,
                &step.frame,
                view,
                n,
                |plot, centre, radius| {
                    plot.disk(centre, radius * scale, colour, None);
                },
            );
        }
    }
}

fn marked(
    run: &Studied,
    step: &MapStep,
    view: MapView,
    title: [&str; 2],
    grains: &[u32],
) -> String {
    panel(view, title, |plot| {
        background(plot, run, step, view);
        let scale = plot.scale();
        for &n in grains {
            map::disk(
                plot,
                &run.grains,
                &step.frame,
                view,
                n as usize,
                |plot, centre, radius| {
                    plot.disk(centre, radius * scale, SLIP, None);
                },
            );
        }
    })
}

fn differences(run: &Studied, step: &MapStep, view: MapView, greatest: f64) -> String {
    panel(view, ["", "differential force network"], |plot| {
        background(plot, run, step, view);
        let shares: Vec<f64> = step
            .force_change
            .iter()
            .map(|change| change / greatest)
            .collect();
        map::lines(
            plot,
            &run.grains,
            &step.frame,
            view,
            &shares,
            FAINT,
            |share| CHANGE.at(0.5 + 0.5 * share),
        );
    })
}

/// Ends of the scale of log10(D²min/r̄²).
struct Levels {
    low: f64,
    high: f64,
    square: f64,
}

impl Levels {
    fn of(run: &Studied, steps: &[&MapStep]) -> Self {
        let square = run.grains.mean_radius().powi(2);
        let mut levels: Vec<f64> = steps
            .iter()
            .flat_map(|step| &step.dmin)
            .map(|value| (value / square).log10())
            .filter(|level| level.is_finite())
            .collect();
        levels.sort_by(f64::total_cmp);
        let high = levels.last().copied().unwrap_or(0.0);
        let low = levels.get(levels.len() / 20).copied().unwrap_or(-1.0);
        let low = low.clamp(high - DECADES, high - 1.0);
        Levels { low, high, square }
    }
}

fn dmin(run: &Studied, step: &MapStep, view: MapView, levels: &Levels) -> String {
    /// QuotedNumber of shades; disks of one shade become one path of the figure.
    const SHADES: f64 = 48.0;
    let share = |n: usize| {
        let level = (step.dmin[n] / levels.square).log10();
        let share = ((level - levels.low) / (levels.high - levels.low)).clamp(0.0, 1.0);
        (share * SHADES).round() / SHADES
    };
    let mut order: Vec<usize> = (0..step.dmin.len()).collect();
    order.sort_by(|a, b| share(*a).total_cmp(&share(*b)));
    panel(view, ["", "D²_{min}"], |plot| {
        let scale = plot.scale();
        let mut draw = |n: usize, less: f64, fill: RGBColor| {
            map::disk(
                plot,
                &run.grains,
                &step.frame,
                view,
                n,
                |plot, centre, radius| {
                    plot.disk(centre, radius * scale - less, fill, None);
                },
            );
        };
        let (defined, undefined): (Vec<usize>, Vec<usize>) =
            order.into_iter().partition(|n| step.dmin[*n].is_finite());
        // A white disk on a grey one draws an outline.
        for n in &undefined {
            draw(*n, 0.0, GREY);
        }
        for n in undefined {
            draw(n, 0.5, WHITE);
        }
        for n in defined {
            draw(n, 0.0, VIRIDIS.at(share(n)));
        }
    })
}

/// Draws a strip with a colour bar.
fn bar(
    scale: &crate::colour::Scale,
    ticks: Vec<ticks::Tick>,
    [low, high]: [f64; 2],
    label: &str,
) -> String {
    let layout = Layout {
        size: [WIDTH + 22.0, 64.0],
        margin: [16.0, 4.0, 16.0, 46.0],
    };
    figure(layout, [low, high], [0.0, 1.0], |plot| {
        plot.flat_colour_bar(scale);
        plot.axes(&ticks, &[], label, "");
    })
}

/// Draws |f| of every contact at the end of every step.
fn network(number: u8, run: &Studied, steps: &[MapStep]) -> Figure {
    let all: Vec<&MapStep> = steps.iter().collect();
    let view = view(run, &all);
    let mut sizes: Vec<f64> = steps
        .iter()
        .flat_map(|step| &step.frame.contacts)
        .map(forces::size)
        .collect();
    sizes.sort_by(f64::total_cmp);
    // With the maximum as the end of the scale, most contacts would look alike.
    let greatest = sizes
        .get(sizes.len() * 999 / 1000)
        .copied()
        .filter(|f| *f > 0.0)
        .unwrap_or(1.0);
    let of_step = |step: &MapStep| {
        panel(view, [&step_title(step), ""], |plot| {
            let shares: Vec<f64> = step
                .frame
                .contacts
                .iter()
                .map(|c| forces::size(c) / greatest)
                .collect();
            map::lines(
                plot,
                &run.grains,
                &step.frame,
                view,
                &shares,
                FAINT,
                |share| FORCE.at(share),
            );
        })
    };
    let mut panels: Vec<String> = steps.iter().map(of_step).collect();
    let (factor, unit) = ticks::prefix(greatest);
    let end = greatest * factor;
    panels.push(bar(
        &FORCE,
        ticks::round(0.0, end, 6),
        [0.0, end],
        &format!("|f| ({unit}N/m)"),
    ));
    Figure {
        number,
        caption: format!(
            "Force network around the largest drop, run {}. Lines join the centres of touching grains; width and colour give the \
             magnitude of the contact force, on one scale.",
            run.label
        ),
        svg: grid_of(4, &panels),
        data: vec![(".csv", contacts_table(run, &all, false))],
    }
}

/// Index of the grain with the greatest D²min.
fn greatest(step: &MapStep) -> Option<usize> {
    (0..step.dmin.len())
        .filter(|n| step.dmin[*n].is_finite())
        .max_by(|a, b| step.dmin[*a].total_cmp(&step.dmin[*b]))
}

/// Draws grey arrows of tension and compression around the grain with the greatest D²min.
fn axes(plot: &mut Plot, run: &Studied, step: &MapStep) {
    let Some(centre) = greatest(step).map(|n| step.frame.position[n]) else {
        return;
    };
    let diameter = 2.0 * run.grains.mean_radius();
    let undefined = |n: usize| step.dmin[n].is_nan();
    let (grains, frame, field) = (&run.grains, &step.frame, &step.displacement);
    let Some(along) = tension(grains, frame, field, undefined, centre, 5.0 * diameter) else {
        return;
    };
    let at = |direction: [f64; 2], r: f64| [0, 1].map(|k| centre[k] + r * diameter * direction[k]);
    let (near, far) = (1.5, 6.0);
    for side in [1.0, -1.0] {
        let across = [-side * along[1], side * along[0]];
        let along = along.map(|a| side * a);
        plot.arrow(at(along, near), at(along, far), GREY, 2.0);
        plot.arrow(at(across, far), at(across, near), GREY, 2.0);
    }
}

/// Draws the non-affine displacements of every step as arrows.
fn displacements(number: u8, run: &Studied, steps: &[MapStep]) -> Figure {
    let all: Vec<&MapStep> = steps.iter().collect();
    let view = view(run, &all);
    let of_step = |step: &MapStep| {
        let length = |u: &[f64; 2]| u[0].hypot(u[1]);
        let mut sizes: Vec<f64> = step.displacement.iter().map(length).collect();
        sizes.sort_by(f64::total_cmp);
        // The 99th percentile of the displacements becomes an arrow of four mean radii.
        let most = sizes
            .get(sizes.len() * 99 / 100)
            .copied()
            .filter(|u| *u > 0.0)
            .unwrap_or(1.0);
        let factor = 4.0 * run.grains.mean_radius() / most;
        let title = step_title(step);
        panel(view, [&title, &format!("arrows × {factor:.2e}")], |plot| {
            for (n, u) in step.displacement.iter().enumerate() {
                let ([x, y], radius) = (step.frame.position[n], run.grains.radius[n]);
                let shrink = (1.5 * most / length(u)).min(1.0);
                let tip = [x + factor * shrink * u[0], y + factor * shrink * u[1]];
                if view.sees_height(y, radius) {
                    for shift in view.shifts(x, radius, run.grains.length) {
                        plot.arrow([x + shift, y], [tip[0] + shift, tip[1]], INK, 0.5);
                    }
                }
            }
            if matches!(step.stage, DropStage::Drop | DropStage::FurtherDrop) {
                axes(plot, run, step);
            }
        })
    };
    let panels: Vec<String> = steps.iter().map(of_step).collect();
    let all_steps: Vec<&MapStep> = steps.iter().collect();
    Figure {
        number,
        caption: format!(
            "Non-affine displacements around the largest drop, run {}: displacements minus the mean shear and stretch along y. Each step has \
             its own scale factor; the longest arrows are cut. Grey arrows in the steps of the drop: directions of tension (outward) \
             and compression (inward) around the greatest D²min, from the displacement gradient within five mean diameters.",
            run.label
        ),
        svg: grid_of(4, &panels),
        data: vec![(".csv", displacement_table(&run.grains, &all_steps))],
    }
}
