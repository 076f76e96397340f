//! Reports on runs: figures as SVG, tables as CSV and JSON, and HTML pages that show them.
//!
//! [`write()`] makes the report of a shear, [`write_box`] of quasi-static strain, and
//! [`rate_state`] that of slide-hold-slide and velocity-step tests.
//! Figures are made of [`plot`] (axes, lines, markers), [`colour`] and [`ticks`].
//!
//! # Example
//! Write the report of a run, as `gshear-reduce report` does:
//!
//! ```no_run
//! use gshear_store::run_reader::RunFile;
//! use gshear_store::status::RunCondition;
//!
//! let run = RunFile::open("out/plane-shear-2d".as_ref())?;
//! let sources = gshear_report::Sources::of(&RunCondition::Finished);
//! let formats = [gshear_report::drawing::Format::Svg];
//! let page = gshear_report::write(&run, &sources, &formats, &run.folder().join("report"))?;
//! println!("open {}", page.display());
//! # Ok::<(), gshear_dem::failure::Failure>(())
//! ```

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod box_protocol;
mod boxes;
pub mod colour;
mod curves;
pub mod drawing;
pub mod eigenvalue_figures;
pub mod events;
mod frame_picture;
mod histogram;
mod history;
mod imposed;
mod last_frame;
mod map;
pub mod movie;
pub mod movie_file;
mod packing;
mod page;
mod panels;
pub mod plot;
pub mod rate_state;
mod stress_ratio;
mod structure;
mod summary;
pub mod sweep;
mod text;
pub mod ticks;

use std::io::{BufRead, BufReader, Read as _};
use std::path::{Path, PathBuf};

use self::drawing::Format;
use self::history::Axis;
use self::map::Map;
use self::page::Page;
use self::summary::{DropFrames, EventFrames, Summary};
pub use self::summary::{drop_without_frames, shows_drops};
use gshear_dem::columns::Column;
use gshear_dem::failure::Result;
use gshear_dem::state::GrainConstants;
use gshear_store::csv_table::Table;
use gshear_store::file_names::LOG_FILE;
use gshear_store::run_reader::{RunFile, RunStage};
use gshear_store::status::RunCondition;
use gshear_store::{dictionary, sound, text_writer};

/// A figure of the report: name of its files, caption in HTML, SVG, and its data.
struct ReportFigure {
    name: String,
    caption: String,
    svg: String,
    data: FigureData,
}

/// Where the numbers of a figure are.
enum FigureData {
    /// In a table of its own: CSV.
    Own(String),
    /// In the time series of the run.
    Series,
}

impl From<String> for FigureData {
    fn from(csv: String) -> Self {
        Self::Own(csv)
    }
}

impl ReportFigure {
    fn new(
        name: impl Into<String>,
        caption: impl Into<String>,
        svg: String,
        data: impl Into<FigureData>,
    ) -> Self {
        Self {
            name: name.into(),
            caption: caption.into(),
            svg,
            data: data.into(),
        }
    }

    /// The address of the file of its numbers from the page. `series`: that of the time series.
    fn data_file(&self, series: &str) -> String {
        match self.data {
            FigureData::Own(_) => format!("{}.csv", self.name),
            FigureData::Series => series.into(),
        }
    }
}

/// The time series beside the page, unless the run has it as text.
const SERIES: &str = "series.csv";

/// The address of the time series of a run from a page in `folder`: `log.csv` of the run, or
/// [`SERIES`], which is written if it is not there.
fn series_of(run: &RunFile, folder: &Path) -> Result<String> {
    let series = run.series();
    let log = run.folder().join(LOG_FILE);
    let is_beside = folder.parent() == Some(run.folder()) && log.is_file();
    if is_beside && has_columns(&log, series.declared) {
        return Ok(format!("../{LOG_FILE}"));
    }
    let table = Table::of(0..series.rows())
        .column("step", |row| series.step[*row])
        .column("time", |row| series.time[*row])
        .columns(series.declared.iter().map(|column| column.name), |&row| {
            series.columns.iter().map(move |column| column[row])
        });
    let axes = run.dimension().axes();
    let path = folder.join(SERIES);
    dictionary::write_figure_data_with(&path, &table.csv(), series.declared, axes)?;
    Ok(SERIES.into())
}

/// Whether a log has all of these columns: `output.columns` may leave some out.
fn has_columns(log: &Path, columns: &[Column]) -> bool {
    let mut head = String::new();
    let file = sound::regular(log);
    let read = file.and_then(|file| BufReader::new(file.take(HEAD_BYTES)).read_line(&mut head));
    let names: Vec<&str> = head.trim_end().split(',').collect();
    read.is_ok() && columns.iter().all(|column| names.contains(&column.name))
}

/// Bytes of the first line of a log, at most.
const HEAD_BYTES: u64 = 1 << 20;

/// What the report of a run is made of besides its file.
pub struct Sources<'a> {
    /// What has become of the run.
    pub condition: &'a RunCondition,
    /// The run around its largest drop, if [`drop_without_frames`] asks for it.
    pub drop: Option<&'a RunFile>,
    /// Where its greatest D²min lies.
    pub rearranging: Option<Rearranging<'a>>,
    /// Address of the page of its rate-and-state friction, from the folder of the report.
    pub rate_state: Option<&'a str>,
    /// A later stage, whose page is in a folder of its name within that of the report.
    pub later: Option<RunStage>,
}

impl<'a> Sources<'a> {
    /// The file of a run alone.
    pub fn of(condition: &'a RunCondition) -> Self {
        Self {
            condition,
            drop: None,
            rearranging: None,
            rate_state: None,
            later: None,
        }
    }
}

/// Where the greatest D²min of a run lies.
#[derive(Clone, Copy)]
pub struct Rearranging<'a> {
    /// Steps of the frames between which it was found.
    pub steps: [u64; 2],
    /// The run, or that part of it with more frames.
    pub shown: &'a RunFile,
}

/// Writes the report into `folder`, which is created if missing: `index.html`, the figures as files
/// of these formats, their data as CSV unless the run has them, and `summary.json`. Returns the
/// path of the page.
///
/// # Errors
/// If the run is damaged or a file cannot be written.
pub fn write(
    run: &RunFile,
    sources: &Sources<'_>,
    formats: &[Format],
    folder: &Path,
) -> Result<PathBuf> {
    let summary = Summary::of(run, sources)?;
    let mut facts = page::facts(run, &summary, sources.condition);
    facts.extend(sources.rate_state.map(|page| {
        let link = format!("<a href=\"{page}\">velocity steps, holds and fits</a>");
        ("Rate and state", link)
    }));
    facts.extend(sources.later.map(page::link_to));
    let mut figures = figures(run, &summary);
    figures.extend(structure::figures(run, &mut facts)?);
    figures.extend(last_frame::figures(run)?);
    let page = Page {
        what: run.boundary().title,
        condition: sources.condition,
        facts,
        figures: &figures,
        series: &series_of(run, folder)?,
        formats,
        note: page::note_on_maps(run, &summary),
    };
    let page = page::html(run, page);
    write_numbers(&summary.json(run), folder)?;
    write_files(run.dimension().axes(), &figures, formats, &page, folder)
}

/// Writes the report of strain steps, as [`write()`]. `files`: of the strain steps and of Newton's
/// equations, or one of them; `conditions`: of each what has become of it; `later`: a later stage,
/// whose page is in a folder of its name within that of the report.
///
/// # Errors
/// If the run is damaged or a file cannot be written.
///
/// # Panics
/// Without files.
pub fn write_box(
    files: &[&RunFile],
    conditions: &[RunCondition],
    later: Option<RunStage>,
    formats: &[Format],
    folder: &Path,
) -> Result<PathBuf> {
    let run = files[0];
    let (mut facts, mut figures, mut names) = (Vec::new(), Vec::new(), Vec::new());
    for (file, condition) in files.iter().zip(conditions) {
        facts.extend(page::identity(file, condition));
        let (name, drawn) = boxes::measured(file, &mut facts)?;
        names.push(name);
        figures.extend(drawn);
    }
    facts.extend(later.map(page::link_to));
    figures.extend(structure::figures(run, &mut facts)?);
    figures.extend(last_frame::figures(run)?);
    let unfinished = conditions
        .iter()
        .find(|condition| **condition != RunCondition::Finished);
    let page = Page {
        what: &names.join(", then "),
        condition: unfinished.unwrap_or(&RunCondition::Finished),
        facts,
        figures: &figures,
        series: SERIES,
        formats,
        note: "",
    };
    let page = page::html(run, page);
    write_numbers(&boxes::json(files), folder)?;
    write_files(run.dimension().axes(), &figures, formats, &page, folder)
}

fn write_numbers(summary: &serde_json::Value, folder: &Path) -> Result<()> {
    text_writer::write(&folder.join("summary.json"), format!("{summary:#}\n"))
}

/// Writes the figures with data of their own, and last the page, so that it never refers to missing
/// figures.
fn write_files(
    axes: usize,
    figures: &[ReportFigure],
    formats: &[Format],
    page: &str,
    folder: &Path,
) -> Result<PathBuf> {
    let drawn = figures.iter().map(|figure| {
        let path = folder.join(&figure.name).with_extension("svg");
        (path, &*figure.svg)
    });
    let drawn: Vec<_> = drawn.collect();
    drawing::write_all(&drawn, formats)?;
    for ((path, _), figure) in drawn.iter().zip(figures) {
        if let FigureData::Own(csv) = &figure.data {
            dictionary::write_figure_data(&path.with_extension("csv"), csv, axes)?;
        }
    }
    let path = folder.join("index.html");
    text_writer::write(&path, page)?;
    Ok(path)
}

fn figures(run: &RunFile, summary: &Summary) -> Vec<ReportFigure> {
    let (axis, tau) = (Axis::of(run), summary::stress_ratio(run));
    let tau = &tau[..];
    let phases = &summary.phases;
    let caption = if phases.is_empty() {
        "Shear stress ratio over the whole run.".into()
    } else {
        format!(
            "Shear stress ratio over the whole run. In colour: stick (τ increases) and slip (τ decreases) phases that \
             change it by more than {} % of its range.",
            100.0 * stress_ratio::VISIBLE
        )
    };
    let svg = stress_ratio::whole(&axis, tau, phases, summary.drop.as_ref());
    let whole = ReportFigure::new("stress-strain", caption, svg, FigureData::Series);
    let mut figures = vec![whole];
    let event = summary.event.as_ref();
    let shown = event.map(|event| event.drop).or(summary.drop);
    if let Some(drop) = &shown {
        let frames = match event {
            Some(event) if !summary::is_driven(run) => {
                Some(event.frames.strain.map(|strain| 100.0 * strain))
            }
            _ => None,
        };
        let caption = format!(
            "The largest drop{}: Δτ<sub>p</sub> = {:.4} over {} intervals of the time series, from τ = {:.4} to {:.4}. \
             Shaded: the phases.",
            if Some(*drop) == summary.drop {
                ""
            } else {
                " with frames before and after it"
            },
            drop.change,
            drop.duration(),
            tau[drop.start],
            tau[drop.end]
        );
        let svg = stress_ratio::around(&axis, tau, phases, drop, frames);
        let data = FigureData::Series;
        figures.push(ReportFigure::new("largest-drop", caption, svg, data));
    }
    if summary::has_phases(run, phases) {
        let caption = "Number of stick and slip phases by the magnitude of their change of τ.";
        let (svg, data) = (histogram::of_changes(phases), histogram::data(phases));
        figures.push(ReportFigure::new("phase-histogram", caption, svg, data));
    }
    if summary::is_imposed(run) {
        figures.extend(imposed::figures(run));
    }
    figures.extend(history::figures(run, &axis));
    if let Some(event) = event {
        figures.extend(maps(run.grains(), event));
    }
    if let Some(frames) = &summary.rearrangement {
        figures.push(map_of_greatest(run.grains(), frames));
    }
    figures
}

fn maps(grains: &GrainConstants, event: &DropFrames) -> [ReportFigure; 4] {
    let frames = &event.frames;
    let EventFrames { earlier, later, .. } = frames;
    let view = map::view_of(grains, later, frames.centre());
    let [before, after] = [earlier, later].map(|frame| Map::new(grains, frame, view));
    let greatest = map::scale_of_forces(&[earlier, later]);
    let [from, to] = [0, 1].map(|k| frames.state(k));
    let [at_start, at_end] = [0, 1].map(|k| frames.title(k));
    let between = format!("{at_start} to {at_end}");
    let part = part_of(grains);
    let (first, second) = if event.is_exact {
        ("right before the drop", "right after the drop")
    } else {
        (
            "at the last frame before the drop",
            "at the first frame after the drop",
        )
    };
    let over = if event.is_exact {
        "over the drop"
    } else {
        "between the frames around the drop, which is shorter"
    };
    let network = "Lines join the centres of touching grains; their width and colour give the normal force, \
                   on the same scale before and after. Disks of the walls are grey.";
    [
        ReportFigure::new(
            "force-network-before",
            format!("Force network {first}: {from}. {network}{part}"),
            before.forces(greatest, &at_start),
            map::data_of_contacts(earlier),
        ),
        ReportFigure::new(
            "force-network-after",
            format!("Force network {second}: {to}. {network}{part}"),
            after.forces(greatest, &at_end),
            map::data_of_contacts(later),
        ),
        ReportFigure::new(
            "force-change",
            format!(
                "Differential force network {over}: change of the magnitude of every contact force, \
                 0 where a contact was made or lost. From {from} to {to}.{part}"
            ),
            after.force_changes(earlier, &between),
            map::data_of_changes(earlier, later),
        ),
        ReportFigure::new(
            "dmin",
            format!(
                "D²<sub>min</sub> {over}, in units of the mean radius squared, with neighbours within 5 r̄. \
                 From {from} to {to}. {}{part}",
                without_dmin(frames)
            ),
            after.dmin(&frames.dmin, after.range_of_dmin(&frames.dmin), &between),
            map::data_of_grains(grains, later, &frames.dmin),
        ),
    ]
}

/// What a map of D²min says of grains without a colour.
fn without_dmin(frames: &EventFrames) -> String {
    format!(
        "White: grains without a value; it is {} (rattlers have two contacts or fewer). Outlined in grey: walls.",
        frames.defined
    )
}

/// What a map says that shows only a part of the sample.
fn part_of(grains: &GrainConstants) -> &'static str {
    if grains.count() > map::MOST_GRAINS {
        " The sample is large: only the part around the greatest D²<sub>min</sub> is shown."
    } else {
        ""
    }
}

/// The map of the greatest D²min of the run.
fn map_of_greatest(grains: &GrainConstants, frames: &EventFrames) -> ReportFigure {
    let later = &frames.later;
    let map = Map::new(grains, later, map::view_of(grains, later, frames.centre()));
    let between = format!("{} to {}", frames.title(0), frames.title(1));
    let greatest = frames.greatest_dmin(grains).unwrap_or(f64::NAN);
    let caption = format!(
        "The greatest D²<sub>min</sub> of the run, {greatest:.3e} in units of the mean radius squared, with neighbours \
         within 5 r̄: from {} to {}. {}{}",
        frames.state(0),
        frames.state(1),
        without_dmin(frames),
        part_of(grains)
    );
    let svg = map.dmin(&frames.dmin, map.range_of_dmin(&frames.dmin), &between);
    let data = map::data_of_grains(grains, later, &frames.dmin);
    ReportFigure::new("greatest-dmin", caption, svg, data)
}
