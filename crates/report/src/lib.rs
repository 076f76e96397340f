//! Reports on runs: figures as SVG, tables as CSV and JSON, and HTML pages that show them.
//!
//! [`write()`] makes the report of a single run between walls, [`write_box`] of one in a box, and
//! [`rate_state`] that of slide-hold-slide and velocity-step tests.
//! Figures are made of [`plot`] (axes, lines, markers), [`colour`] and [`ticks`].
//!
//! # Example
//! Write the report of a run, as `gshear-reduce report` does:
//!
//! ```no_run
//! use gshear_store::run_reader::RunFile;
//!
//! let run = RunFile::open("out/plane-shear-2d".as_ref())?;
//! let page = gshear_report::write(&run, None, None, &run.folder().join("report"))?;
//! println!("open {}", page.display());
//! # Ok::<(), gshear_dem::failure::Failure>(())
//! ```

mod boxes;
pub mod colour;
mod curves;
pub mod drawing;
mod histogram;
mod history;
mod imposed;
mod map;
mod page;
mod picture;
pub mod plot;
pub mod rate_state;
pub mod spectrum;
mod stress;
mod structure;
mod summary;
pub mod ticks;

use std::path::{Path, PathBuf};

use self::history::Axis;
use self::map::MapView;
pub use self::summary::window_without_frames;
use self::summary::{DropFrames, Summary};
use gshear_dem::failure::Failure;
use gshear_dem::state::Disks;
use gshear_store::run_reader::RunFile;
use gshear_store::{dictionary, text_writer};

/// A figure of the report: name of its files, caption in HTML, SVG, and its data as CSV.
struct ReportFigure {
    name: &'static str,
    caption: String,
    svg: String,
    data: String,
}

/// Writes the report into `folder`, which is created if missing: `index.html`, the figures as SVG
/// with their data as CSV, and `summary.json`. Returns the path of the page. `replayed`: the run
/// around its largest drop, if [`window_without_frames`] asks for it; `rate_state`: address of the
/// page of its rate-and-state friction, from `folder`.
///
/// # Errors
/// If the run is damaged or a file cannot be written.
pub fn write(
    run: &RunFile,
    replayed: Option<&RunFile>,
    rate_state: Option<&str>,
    folder: &Path,
) -> Result<PathBuf, Failure> {
    let summary = Summary::of(run, replayed)?;
    let mut facts = page::facts(run, &summary);
    facts.extend(rate_state.map(|page| {
        let link = format!("<a href=\"{page}\">velocity steps, holds and fits</a>");
        ("Rate and state", link)
    }));
    let mut figures = figures(run, &summary);
    figures.extend(structure::figures(run, &mut facts)?);
    figures.extend(picture::figures(run)?);
    let note = page::note_on_maps(run, &summary);
    let page = page::html(run, "Shear between walls", facts, &figures, note);
    write_files(run, &figures, &summary.json(run), &page, folder)
}

/// Writes the report of a run in a periodic box, as [`write()`]. `files`: of its strain steps and of
/// Newton's equations, or one of them.
///
/// # Errors
/// If the run is damaged or a file cannot be written.
pub fn write_box(files: &[&RunFile], folder: &Path) -> Result<PathBuf, Failure> {
    let run = files[0];
    let (mut facts, mut figures, mut names) = (Vec::new(), Vec::new(), Vec::new());
    for file in files {
        facts.extend(page::identity(file));
        let (name, drawn) = boxes::measured(file, &mut facts)?;
        names.push(name);
        figures.extend(drawn);
    }
    figures.extend(structure::figures(run, &mut facts)?);
    figures.extend(picture::figures(run)?);
    let page = page::html(run, &names.join(", then "), facts, &figures, "");
    write_files(run, &figures, &boxes::json(files), &page, folder)
}

/// Writes the figures with their data, the numbers, and last the page, so that it never refers to
/// missing figures.
fn write_files(
    run: &RunFile,
    figures: &[ReportFigure],
    summary: &serde_json::Value,
    page: &str,
    folder: &Path,
) -> Result<PathBuf, Failure> {
    let place = |figure: &ReportFigure| folder.join(figure.name).with_extension("svg");
    let drawn = figures.iter().map(|figure| (place(figure), &*figure.svg));
    drawing::write_all(&drawn.collect::<Vec<_>>())?;
    for figure in figures {
        let path = place(figure).with_extension("csv");
        dictionary::write_figure_data(&path, &figure.data, run.dimension().axes())?;
    }
    text_writer::write(&folder.join("summary.json"), format!("{summary:#}\n"))?;
    let path = folder.join("index.html");
    text_writer::write(&path, page)?;
    Ok(path)
}

fn figures(run: &RunFile, summary: &Summary) -> Vec<ReportFigure> {
    let (axis, tau) = (Axis::of(run), summary::stress_ratio(run));
    let tau = &tau[..];
    let phases = &summary.phases;
    let of_tau = axis.table(run.series(), &["stress_ratio"]);
    let mut figures = vec![ReportFigure {
        name: "stress-strain",
        caption: if phases.is_empty() {
            "Shear stress ratio over the whole run.".into()
        } else {
            format!(
                "Shear stress ratio over the whole run. In colour: stick (τ increases) and slip (τ decreases) phases that \
                 change it by more than {} % of its range.",
                100.0 * stress::VISIBLE
            )
        },
        svg: stress::whole(&axis, tau, phases, summary.drop.as_ref()),
        data: of_tau.clone(),
    }];
    let shown = summary
        .event
        .as_ref()
        .map(|event| event.drop)
        .or(summary.drop);
    if let Some(drop) = &shown {
        let on_axis = |event: &DropFrames| event.strain.map(|strain| 100.0 * strain);
        let driven = summary::is_driven(run);
        let frames = summary.event.as_ref().filter(|_| !driven).map(on_axis);
        figures.push(ReportFigure {
            name: "largest-drop",
            caption: format!(
                "The largest drop{}: Δτ<sub>p</sub> = {:.4} over {} intervals of the time series. Shaded: the phases.",
                if Some(*drop) == summary.drop { "" } else { " with frames before and after it" },
                drop.change,
                drop.duration()
            ),
            svg: stress::around(&axis, tau, phases, drop, frames),
            data: of_tau,
        });
    }
    let is_imposed = summary::is_imposed(run);
    if !is_imposed || !phases.is_empty() {
        figures.push(ReportFigure {
            name: "phase-histogram",
            caption: "Number of stick and slip phases by the magnitude of their change of τ."
                .into(),
            svg: histogram::of_changes(phases),
            data: histogram::data(phases),
        });
    }
    if is_imposed {
        figures.extend(imposed::figures(run));
    }
    figures.extend(history::figures(run, &axis));
    if let Some(event) = &summary.event {
        figures.extend(maps(run.grains(), event));
    }
    figures
}

fn maps(grains: &Disks, event: &DropFrames) -> [ReportFigure; 4] {
    let view = MapView::of(grains, &event.later, event.centre());
    let greatest = map::scale_of_forces([&event.earlier, &event.later]);
    let [t, u] = event.frames;
    let [before, after] = event
        .strain
        .map(|strain| format!("γ = {:.5} %", 100.0 * strain));
    let between = format!("frames {t} to {u}: {before} to {after}");
    let part = if grains.count() > map::MOST_GRAINS {
        " The sample is large: only the part around the greatest D²<sub>min</sub> is shown."
    } else {
        ""
    };
    let network = "Lines join the centres of touching grains; their width and colour give the normal force, \
                   on the same scale before and after. Disks of the walls are grey.";
    let [earlier, later] = [&event.earlier, &event.later].map(map::data_of_contacts);
    [
        ReportFigure {
            data: earlier,
            name: "force-network-before",
            caption: format!("Force network before the drop. {network}{part}"),
            svg: map::forces(
                grains,
                &event.earlier,
                view,
                greatest,
                &format!("frame {t}, {before}"),
            ),
        },
        ReportFigure {
            data: later,
            name: "force-network-after",
            caption: format!("Force network after the drop. {network}{part}"),
            svg: map::forces(
                grains,
                &event.later,
                view,
                greatest,
                &format!("frame {u}, {after}"),
            ),
        },
        ReportFigure {
            data: map::data_of_changes(&event.earlier, &event.later),
            name: "force-change",
            caption: format!(
                "Differential force network over the drop: change of the magnitude of every contact force, \
                 0 where a contact was made or lost.{part}"
            ),
            svg: map::force_changes(grains, &event.earlier, &event.later, view, &between),
        },
        ReportFigure {
            data: map::data_of_grains(grains, &event.later, &event.dmin),
            name: "dmin",
            caption: format!(
                "D²<sub>min</sub> over the drop, in units of the mean radius squared, with neighbours within 5 r̄. \
                 White: rattlers and other grains without a defined value. Outlined in grey: walls.{part}"
            ),
            svg: map::dmin(grains, &event.later, &event.dmin, view, &between),
        },
    ]
}
