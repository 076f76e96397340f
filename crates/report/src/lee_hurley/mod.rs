//! The study of Lee & Hurley (LH): every figure of the paper that shows data, drawn from our runs,
//! and the paper's numbers next to ours.

mod correlations;
mod curves;
mod drops;
mod ensemble;
mod event;
mod family;
mod numbers;
mod page;
mod step_tables;
mod steps;
mod studied;

use std::path::{Path, PathBuf};

pub use self::studied::{DropStage, Event, MapStep, Size, Studied, StudyOptions, friction};
use crate::drawing;
use gshear_dem::failure::Failure;
use gshear_store::{dictionary, text_writer};

/// A figure with its number in the paper.
pub struct Figure {
    /// QuotedNumber in the paper.
    pub number: u8,
    /// Caption in HTML.
    pub caption: String,
    /// The figure as SVG.
    pub svg: String,
    /// Files with its data: suffix of the name (`.csv`, `-contacts.csv`) and content.
    pub data: Vec<(&'static str, String)>,
}

/// A figure of the paper, or its number and the reason why it is missing.
pub type Drawn = Result<Figure, (u8, String)>;

impl Figure {
    /// Returns the name of its files without suffix: `fig-02`.
    pub fn name(&self) -> String {
        format!("fig-{:02}", self.number)
    }
}

/// Writes the study into `folder`, which is created if missing, and returns the path of the page.
///
/// The files are the figures as SVG with their data as CSV, `numbers.csv`, `drops.csv` and
/// `index.html`; if there are runs that differ in their seeds only, also `ensemble.csv`,
/// `ensemble-correlations.csv` and `ensemble-….svg`.
///
/// # Errors
/// If a file cannot be written.
pub fn write(runs: &[Studied], folder: &Path) -> Result<PathBuf, Failure> {
    let drawn = figures(runs);
    let svg = |figure: &Figure| folder.join(figure.name() + ".svg");
    let figures = drawn
        .iter()
        .flatten()
        .map(|figure| (svg(figure), &*figure.svg));
    drawing::write_all(&figures.collect::<Vec<_>>())?;
    for figure in drawn.iter().flatten() {
        let path = |end: &str| folder.join(figure.name() + end);
        for (end, data) in &figure.data {
            dictionary::write_figure_data(&path(end), data, 2)?;
        }
    }
    let numbers = numbers::of(runs);
    let write = |name: &str, text: &str| {
        // Of disks.
        dictionary::write_figure_data(&folder.join(name), text, 2)
    };
    write("numbers.csv", &numbers::csv(&numbers))?;
    write("drops.csv", &drops::csv(runs))?;
    let mut families = family::families(runs);
    families.retain(|family| family.runs.len() > 1);
    if !families.is_empty() {
        write("ensemble.csv", &ensemble::numbers_csv(&families))?;
        write(
            "ensemble-correlations.csv",
            &ensemble::correlations_csv(&families),
        )?;
    }
    let seeds = ensemble::figures(&families);
    for (name, svg) in &seeds {
        drawing::write(&folder.join(name), svg)?;
    }
    // Written last, so that the page never refers to missing figures.
    let page = folder.join("index.html");
    text_writer::write(&page, page::html(runs, &numbers, &drawn, &seeds))?;
    Ok(page)
}

/// The figures in the order of their numbers. Figure 1 is a drawing of the set-up.
fn figures(runs: &[Studied]) -> Vec<Drawn> {
    // Figures of single runs show the first run of each family.
    let families = family::families(runs);
    let first = || families.iter().map(|family| family.runs[0]);
    let of = |size: Size| -> Vec<&Studied> { first().filter(|run| run.size == size).collect() };
    let (small, large) = (of(Size::Small), of(Size::Large));
    // LH show the sample with μ_s = 0.7; section 4 has the others.
    let main = |runs: &[&'_ Studied]| -> Option<usize> {
        let off = |k: &usize| (runs[*k].friction.unwrap_or(f64::INFINITY) - 0.7).abs();
        (0..runs.len()).min_by(|a, b| off(a).total_cmp(&off(b)))
    };
    let (first, second) = (
        main(&small).map(|k| small[k]),
        main(&large).map(|k| large[k]),
    );
    let mut drawn = vec![curves::whole_and_event(2, first)];
    drawn.extend(steps::figures([3, 4, 0, 5, 6, 7], first));
    drawn.push(event::figure(8, first));
    drawn.extend(correlations::of_one(first));
    drawn.push(curves::of_frictions(12, Size::Small, &small));
    drawn.push(correlations::of_frictions(13, Size::Small, &small));
    drawn.push(curves::of_sizes(14, first, second));
    drawn.extend(steps::figures([15, 16, 17, 18, 19, 20], second));
    drawn.push(event::figure(21, second));
    drawn.push(correlations::of_sizes(22, first, second));
    drawn.push(correlations::of_regions(23, second));
    drawn.push(curves::of_frictions(24, Size::Large, &large));
    drawn.push(correlations::of_frictions(25, Size::Large, &large));
    drawn
}

/// The reason for a missing figure of one size.
fn no_run(number: u8, size: Size) -> (u8, String) {
    (number, format!("no run of the {} sample", size.name()))
}
