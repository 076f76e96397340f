//! The report of several runs: curves over each other, and means over seeds against a key of the
//! scenes.

mod marks;
mod values;

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use toml::Value;

use self::marks::{colours, draw_means, key_label, legend, readable, with_error};
use self::values::{Places, number, order, shown, text, values_of};
use crate::boxes::{MOBILISED_FRICTION, Measured};
use crate::curves::{draw, padded};
use crate::drawing::Format;
use crate::history::Axis;
use crate::page;
use crate::panels::{Compared, PANELS};
use crate::plot::{Layout, figure};
use crate::summary::{finite_moments, stress_ratio};
use crate::text::{escape, marked};
use crate::ticks;
use crate::{ReportFigure, SERIES};
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_analysis::moments::{distinct, grouped};
use gshear_analysis::phases::{self, PhaseStatistics};
use gshear_analysis::time_mean::TimeMean;
use gshear_dem::failure::{Failure, Result};
use gshear_store::csv_table::Table;
use gshear_store::dictionary;
use gshear_store::run_reader::{RunFile, RunStage};

/// With room for ticks that are powers of ten.
const LAYOUT: Layout = Layout::new([900.0, 320.0], 108.0);
/// The key in which runs differ that are repeated to be averaged.
const SEED: &str = "seed";
/// Tables of the runs and of their means.
const RUNS: &str = "runs.csv";
const MEANS: &str = "means.csv";
/// Distance between lines whose points lie at the same value of a key (px).
const APART: f64 = 5.0;
/// A run, and what is compared of it.
pub struct SweepRun {
    /// Name of its folder.
    pub name: String,
    /// Digest of its last state.
    digest: Option<String>,
    /// Values of the scene by their keys.
    scene: BTreeMap<String, Value>,
    stage: RunStage,
    axes: usize,
    step: Vec<u64>,
    axis: Axis,
    /// Columns of the time series that may be drawn, by name.
    curves: BTreeMap<&'static str, Vec<f64>>,
    /// Means over the later rows and statistics of phases, by name.
    means: BTreeMap<&'static str, TimeMean>,
}

impl SweepRun {
    /// Takes from a run what is compared. `start`: share of the rows that is left out of means;
    /// `wanted`: columns to draw besides those that are always compared; `scalars`: of its frames,
    /// as far as they are asked for.
    pub fn of(
        name: String,
        run: &RunFile,
        start: f64,
        wanted: &[String],
        scalars: &[FrameScalars],
    ) -> Self {
        let series = run.series();
        let first = first_row(series.rows(), start);
        let weights = series.weights(first);
        let stored = series.declared.iter().zip(&series.columns);
        let stored = stored.map(|(column, values)| (column.name, values.clone()));
        let mut columns: BTreeMap<&'static str, Vec<f64>> = stored.collect();
        let mut means: BTreeMap<&'static str, TimeMean> = (columns.keys())
            .map(|name| (*name, series.mean(name, first)))
            .collect();
        if run.stage() == RunStage::Strain {
            let measured = Measured::of(run);
            let friction = measured.mean_friction(first, &weights);
            for (name, values) in measured.columns() {
                means.insert(name, TimeMean::of(&values[first..], &weights));
                columns.insert(name, values);
            }
            means.insert(MOBILISED_FRICTION, friction);
        }
        if run.stage() == RunStage::Shear && run.boundary().has_top() {
            let (strain, tau) = (series.column("strain"), stress_ratio(run));
            let later_phases = phases::find(&strain[first..], &tau[first..]);
            let names = PhaseStatistics::COLUMNS.iter().map(|column| column.name);
            let values = PhaseStatistics::of(&later_phases).columns();
            means.extend(names.zip(values.map(TimeMean::of_one)));
        }
        let scalars = &scalars[first_row(scalars.len(), start)..];
        for (k, column) in FrameScalars::COLUMNS.iter().enumerate() {
            let values: Vec<f64> = scalars.iter().map(|row| row.columns()[k]).collect();
            let mean = TimeMean::of(&values, &vec![1.0; values.len()]);
            // Without D²min, and of spheres without regions, nothing is defined.
            if mean.mean.is_finite() {
                means.insert(column.name, mean);
            }
        }
        let compared = PANELS.compared.iter().map(|compared| &compared.column);
        let drawn: Vec<&String> = compared.chain(wanted).collect();
        columns.retain(|name, values| {
            drawn.iter().any(|column| column == name) && values.iter().any(|x| x.is_finite())
        });
        Self {
            name,
            digest: run.digest().map(String::from),
            scene: values_of(run.scene()),
            stage: run.stage(),
            axes: run.dimension().axes(),
            step: series.step.clone(),
            axis: Axis::of(run),
            curves: columns,
            means,
        }
    }
}

/// The first row of the means.
fn first_row(rows: usize, start: f64) -> usize {
    (start * rows as f64) as usize
}

/// What a page says at its top.
pub struct Heading<'a> {
    /// Title of the page.
    pub title: &'a str,
    /// Share of the rows that means leave out.
    pub start: f64,
    /// Runs that are left out, and why.
    pub skipped: &'a [String],
}

/// Runs with the same values of all keys but the seed.
struct Group<'a> {
    /// Values of the keys.
    values: Vec<Option<&'a Value>>,
    runs: Vec<&'a SweepRun>,
}

impl Group<'_> {
    /// Mean of a column over the runs, with the standard error over them; of a single run its mean
    /// over time, with the standard error of that.
    fn mean(&self, column: &str) -> TimeMean {
        if let [run] = self.runs[..] {
            return run.means[column];
        }
        let values = self.runs.iter().map(|run| run.means[column].mean);
        let moments = finite_moments(&values.collect::<Vec<_>>());
        TimeMean {
            mean: moments.mean,
            error: moments.error(),
            deviation: moments.deviation(),
        }
    }
}

/// The runs, the keys in which they differ, and the columns that are compared.
pub struct Sweep<'a> {
    runs: &'a [SweepRun],
    /// All keys but the seed.
    keys: Vec<String>,
    has_seeds: bool,
    columns: Vec<String>,
    /// Number of the key that means are drawn against.
    against: Option<usize>,
}

impl<'a> Sweep<'a> {
    /// Compares runs. `columns`: empty for those of `panels.toml` that all runs have; `against`:
    /// the key that means are drawn against, by default the number with the most values.
    ///
    /// # Errors
    /// A column that a run lacks, no common columns, a key in which the runs do not differ, a run
    /// that is given twice.
    pub fn new(runs: &'a [SweepRun], columns: &[String], against: Option<&str>) -> Result<Self> {
        let mut keys: BTreeSet<String> = BTreeSet::new();
        for key in runs.iter().flat_map(|run| run.scene.keys()) {
            let first = runs[0].scene.get(key);
            if runs.iter().any(|run| run.scene.get(key) != first) {
                keys.insert(key.clone());
            }
        }
        let has_seeds = keys.contains(SEED);
        for (k, run) in runs.iter().enumerate() {
            let mut earlier = runs[..k].iter();
            let same = earlier.find(|other| {
                let mut keys = keys.iter();
                run.digest == other.digest
                    && keys.all(|key| run.scene.get(key) == other.scene.get(key))
            });
            if let Some(other) = same {
                return Err(Failure::input(format!(
                    "{} and {} are the same run (equal scenes and digests); give each run once",
                    other.name, run.name
                )));
            }
        }
        let mut sweep = Self {
            runs,
            keys: keys.into_iter().filter(|key| key != SEED).collect(),
            has_seeds,
            columns: columns_of(runs, columns)?,
            against: None,
        };
        sweep.against = sweep.chosen(against)?;
        Ok(sweep)
    }

    fn chosen(&self, against: Option<&str>) -> Result<Option<usize>> {
        let Some(key) = against else {
            // Of equals the first.
            let keys = (0..self.keys.len()).rev();
            return Ok(keys.max_by_key(|k| {
                let all = self.runs.iter().map(|r| r.scene.get(&self.keys[*k]));
                let numbers = all.clone().all(|value| number(value).is_some());
                (numbers, distinct(all).len())
            }));
        };
        let place = self.keys.iter().position(|known| known == key);
        let differ = match &self.keys[..] {
            [] if self.has_seeds => "the seed alone".into(),
            [] => "no key".into(),
            keys => keys.join(", "),
        };
        place.map(Some).ok_or_else(|| {
            Failure::input(format!(
                "--against {key}: is not a key in which the runs differ; they differ in {differ}"
            ))
        })
    }

    /// The values of the keys in the scene of a run.
    fn values(&self, run: &'a SweepRun) -> Vec<Option<&'a Value>> {
        self.keys.iter().map(|key| run.scene.get(key)).collect()
    }

    fn groups(&self) -> Vec<Group<'a>> {
        let by_values = grouped(self.runs, |a, b| self.values(a) == self.values(b));
        let mut groups: Vec<Group<'a>> = (by_values.into_iter())
            .map(|runs| Group {
                values: self.values(runs[0]),
                runs,
            })
            .collect();
        groups.sort_by(|a, b| {
            let pairs = a.values.iter().zip(&b.values);
            let orders = pairs.map(|(a, b)| order(*a, *b));
            orders.fold(Ordering::Equal, Ordering::then)
        });
        groups
    }

    /// The last part of a key, all of it if another key has the same, in words.
    fn short(&self, k: usize) -> String {
        let name = last_part(&self.keys[k]);
        let same = self.keys.iter().filter(|key| last_part(key) == name);
        let name = if same.count() > 1 {
            &self.keys[k]
        } else {
            name
        };
        name.replace('_', " ")
    }

    /// Number of different sets of values that some keys take.
    fn sets(&self, keys: &[usize]) -> usize {
        let sets = grouped(self.runs, |a, b| {
            let mut keys = keys.iter().map(|k| &self.keys[*k]);
            keys.all(|key| a.scene.get(key) == b.scene.get(key))
        });
        sets.len()
    }

    /// The numbers of the keys that tell the groups apart: without those that scenes have or lack
    /// because of another key, such as the gain of a servo, and those that change together with the
    /// key on the axis.
    fn independent_keys(&self) -> Vec<usize> {
        let mut keys: Vec<usize> = (0..self.keys.len()).collect();
        let all = self.sets(&keys);
        let all_keys = (0..self.keys.len()).rev();
        for k in all_keys.filter(|k| Some(*k) != self.against) {
            let mut scenes = self.runs.iter().map(|run| &run.scene);
            let is_lacked = scenes.any(|scene| !scene.contains_key(&self.keys[k]));
            let others: Vec<usize> = keys.iter().copied().filter(|other| *other != k).collect();
            if (is_lacked || self.changes_with_axis(k)) && self.sets(&others) == all {
                keys = others;
            }
        }
        keys
    }

    /// Whether a key changes together with the key on the axis.
    fn changes_with_axis(&self, k: usize) -> bool {
        let Some(axis) = self.against else {
            return false;
        };
        let own = self.sets(&[k]);
        self.sets(&[axis]) == own && self.sets(&[axis, k]) == own
    }

    /// The values of these keys, as a legend names them.
    fn named(&self, group: &Group<'_>, keys: &[usize]) -> String {
        let has = keys.iter().filter(|k| group.values[**k].is_some());
        let named = has.map(|k| format!("{} {}", self.short(*k), shown(group.values[*k])));
        named.collect::<Vec<_>>().join(", ")
    }

    /// Numbers are per unit depth if all runs are of disks.
    fn axes(&self) -> usize {
        self.runs.iter().map(|run| run.axes).max().unwrap_or(3)
    }

    /// What stands at the axis of a column.
    fn label(&self, column: &str) -> String {
        let compared = PANELS.compared.iter().find(|known| known.column == column);
        if let Some(Compared { label, .. }) = compared {
            return label.clone();
        }
        let name = column.replace('_', " ");
        // The scene of a box may have any units.
        let is_si = self.runs.iter().all(|run| run.stage == RunStage::Shear);
        let known = dictionary::column(column);
        match known.and_then(|column| column.unit_in(self.axes())) {
            Some(unit) if is_si => format!("{name} ({})", readable(&unit)),
            _ => name,
        }
    }

    /// A table with a line per run: its name, the keys, the columns.
    fn table_of_runs(&self) -> String {
        let seed = self.has_seeds.then(|| SEED.to_string());
        let keys: Vec<&String> = self.keys.iter().chain(&seed).collect();
        Table::of(self.runs)
            .column("run", |run| run.name.clone())
            .columns(&keys, |&run| {
                keys.iter().map(|key| text(run.scene.get(*key)))
            })
            .columns(with_errors(&self.columns), |&run| {
                let means = self.columns.iter().map(|column| run.means[&**column]);
                means.flat_map(|mean| [mean.mean, mean.error])
            })
            .csv()
    }

    /// A table with a line per group: the keys, means of columns with their errors, number of runs.
    fn table_of_means(&self, columns: &[String]) -> String {
        Table::of(self.groups())
            .columns(&self.keys, |group| {
                group.values.clone().into_iter().map(text)
            })
            .columns(with_errors(columns), |group| {
                let means = columns.iter().map(|column| group.mean(column));
                let values = means.flat_map(|mean| [mean.mean, mean.error]);
                values.collect::<Vec<_>>()
            })
            .column("runs", |group| group.runs.len())
            .csv()
    }

    /// Writes the report into `folder`, which is created if missing: `index.html` with its figures,
    /// `runs.csv` and `means.csv`. Returns the paths of the tables and of the page.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(
        &self,
        heading: &Heading<'_>,
        formats: &[Format],
        folder: &Path,
    ) -> Result<[PathBuf; 3]> {
        let groups = self.groups();
        let mut figures = Vec::new();
        for column in &self.columns {
            figures.extend(self.against(column, &groups));
            figures.extend(self.curves(column, &groups));
        }
        let [runs, means] = [RUNS, MEANS].map(|name| folder.join(name));
        dictionary::write_table(&runs, &self.table_of_runs(), self.axes())?;
        dictionary::write_table(&means, &self.table_of_means(&self.columns), self.axes())?;
        let page = self.page(heading, &groups, &figures, formats);
        let page = crate::write_files(self.axes(), &figures, formats, &page, folder)?;
        Ok([runs, means, page])
    }

    fn page(
        &self,
        heading: &Heading<'_>,
        groups: &[Group<'_>],
        figures: &[ReportFigure],
        formats: &[Format],
    ) -> String {
        let lead = format!(
            "{} runs of gshear-mpi side by side. Means are over the rows of a run from {} % on (of a ratio \
             such as τ = S/N the ratio of the means), then over runs that differ in the seed alone; after ± \
             the standard error over them, of a single run that of its mean over time. \
             <a href=\"{MEANS}\">{MEANS}</a>, <a href=\"{RUNS}\">{RUNS}</a>",
            self.runs.len(),
            100.0 * heading.start
        );
        let skipped = heading.skipped.iter();
        let skipped: String = skipped
            .map(|why| format!("<p>Left out: {}</p>\n", escape(why)))
            .collect();
        let labels = self.columns.iter().map(|column| self.label(column));
        let keys = self.keys.iter().cloned();
        let head = keys.chain(["runs".into()]).chain(labels);
        let head = head.map(|name| format!("<th>{}</th>", marked(&name)));
        let head: String = head.collect();
        let rows: String = groups.iter().map(|group| self.row(group)).collect();
        let body = format!(
            "{skipped}{}<h2>Means</h2>\n<div class=\"wide\"><table>\n<tr>{head}</tr>\n{rows}</table></div>\n\
             <h2>Figures</h2>\n{}",
            page::contents(figures, &[]),
            page::figures(figures, SERIES, formats)
        );
        page::document(&escape(heading.title), &lead, &body)
    }

    /// The means of a group as a line of a table.
    fn row(&self, group: &Group<'_>) -> String {
        let keys = group.values.iter().map(|value| escape(&shown(*value)));
        let means = self.columns.iter().map(|column| {
            let mean = group.mean(column);
            with_error(mean.mean, mean.error)
        });
        let cells = keys.chain([group.runs.len().to_string()]).chain(means);
        let cells: String = cells.map(|cell| format!("<td>{cell}</td>")).collect();
        format!("<tr>{cells}</tr>\n")
    }

    /// Draws the means of a column against the chosen key, a line for each set of the other values.
    fn against(&self, column: &str, groups: &[Group<'_>]) -> Option<ReportFigure> {
        let key = self.against?;
        let name = &self.keys[key];
        let places = Places::of(groups.iter().map(|group| group.values[key]).collect());
        let independent = self.independent_keys();
        let others: Vec<usize> = (independent.iter().copied())
            .filter(|k| *k != key)
            .collect();
        let groups = grouped(groups, |a, b| {
            others.iter().all(|k| a.values[*k] == b.values[*k])
        });
        let names: Vec<String> = (groups.iter())
            .map(|line| self.named(line[0], &others))
            .collect();
        let mut lines: Vec<Vec<[f64; 3]>> = Vec::new();
        for line in groups {
            let points = line.iter().map(|group| {
                let TimeMean { mean, error, .. } = group.mean(column);
                let error = if error.is_finite() { error } else { 0.0 };
                [places.at(group.values[key]), mean, error]
            });
            let mut points: Vec<[f64; 3]> = points.filter(|point| point[1].is_finite()).collect();
            points.sort_by(|a, b| a[0].total_cmp(&b[0]));
            lines.push(points);
        }
        let points = lines.iter().flatten();
        let ends = points.flat_map(|[_, y, error]| [y - error, y + error]);
        let (x, y) = (places.range(), padded(ends, 0.08));
        if lines.iter().all(Vec::is_empty) {
            return None;
        }
        let colours = colours(lines.len());
        let entries = legend(&names, &colours);
        let layout = LAYOUT.with_legend(entries.iter().map(|entry| entry.1));
        let svg = figure(layout, x, y, |plot| {
            let (x_ticks, y_ticks) = (places.ticks(x), ticks::scientific(y, 5));
            plot.grid(&x_ticks, &y_ticks);
            let apart = APART.min(40.0 / lines.len() as f64) / plot.scale();
            for (k, (line, colour)) in lines.iter().zip(&colours).enumerate() {
                let shift = apart * (k as f64 - 0.5 * (lines.len() - 1) as f64);
                let line = line.iter().map(|[x, y, error]| [x + shift, *y, *error]);
                draw_means(plot, line.collect(), places.numbers.is_some(), *colour);
            }
            plot.axes(&x_ticks, &y_ticks, &key_label(name), &self.label(column));
            plot.legend(&entries);
        });
        let tied = (0..self.keys.len()).filter(|k| !independent.contains(k));
        let tied: Vec<&str> = tied.map(|k| &*self.keys[k]).collect();
        let mut caption = format!(
            "Mean of {column} against {name}; bars: standard error over seeds, of a single run over time."
        );
        if !tied.is_empty() {
            caption += &format!(" Keys that follow from the others: {}.", tied.join(", "));
        }
        let caption = escape(&caption);
        let data = self.table_of_means(&[column.to_string()]);
        let name = format!("{column}-means");
        Some(ReportFigure::new(name, caption, svg, data))
    }

    /// Draws a column of all time series over each other, a colour for each set of values; nothing
    /// if it is in none, or if the runs are drawn over different quantities.
    fn curves(&self, column: &str, groups: &[Group<'_>]) -> Option<ReportFigure> {
        let axis = &self.runs[0].axis;
        let mut curves: Vec<&Vec<f64>> = Vec::new();
        for run in self.runs {
            if run.axis.label != axis.label {
                return None;
            }
            curves.push(run.curves.get(column)?);
        }
        let keys = self.independent_keys();
        let names: Vec<String> = (groups.iter())
            .map(|group| self.named(group, &keys))
            .collect();
        let colours = colours(groups.len());
        let entries = legend(&names, &colours);
        let layout = LAYOUT.with_legend(entries.iter().map(|entry| entry.1));
        let places = self.runs.iter().flat_map(|run| &run.axis.values).copied();
        let x = padded(places, 0.02);
        let y = padded(curves.into_iter().flatten().copied(), 0.08);
        let svg = figure(layout, x, y, |plot| {
            let (x_ticks, y_ticks) = (ticks::scientific(x, 10), ticks::scientific(y, 5));
            plot.grid(&x_ticks, &y_ticks);
            for (group, colour) in groups.iter().zip(&colours) {
                for run in &group.runs {
                    let (x, y) = (&run.axis.values, &run.curves[column]);
                    let rows: Vec<usize> = (0..y.len()).collect();
                    draw(plot, x, y, &rows, *colour, 0.8);
                }
            }
            plot.clip();
            plot.axes(&x_ticks, &y_ticks, axis.label, &self.label(column));
            plot.legend(&entries);
        });
        let runs = self.runs.iter();
        let rows = runs.flat_map(|run| (0..run.step.len()).map(move |k| (run, k)));
        let data = Table::of(rows)
            .column("run", |(run, _)| run.name.clone())
            .column("step", |(run, k)| run.step[*k])
            .column(axis.column.0, |(run, k)| run.axis.column.1[*k])
            .column(column, |(run, k)| run.curves[column][*k])
            .csv();
        let caption = format!("{} of all runs.", marked(&self.label(column)));
        let name = format!("{column}-curves");
        Some(ReportFigure::new(name, caption, svg, data))
    }
}

/// Names of columns, each followed by that of its standard error.
fn with_errors(columns: &[String]) -> impl Iterator<Item = String> {
    let columns = columns.iter();
    columns.flat_map(|name| [name.clone(), format!("{name}{}", dictionary::ERROR)])
}

/// The columns that are compared: those that are asked for, or of the usual ones those that all
/// runs have.
fn columns_of(runs: &[SweepRun], asked: &[String]) -> Result<Vec<String>> {
    for name in asked {
        if let Some(run) = runs.iter().find(|run| !run.means.contains_key(&**name)) {
            let why = if FrameScalars::COLUMNS
                .iter()
                .any(|column| column.name == name)
            {
                "no value of it, which needs frames (output.frame_strain) and, \
                 but for D²min, disks between walls"
                    .into()
            } else {
                let known: Vec<&str> = run.means.keys().copied().collect();
                format!("no such column; it has {}", known.join(", "))
            };
            let what = format!("--columns {name}: {} has {why}", run.name);
            return Err(Failure::input(what));
        }
    }
    if !asked.is_empty() {
        return Ok(distinct(asked.iter().cloned()));
    }
    let usual = PANELS.compared.iter().map(|compared| &*compared.column);
    let common = usual.filter(|name| {
        let mut means = runs.iter().map(|run| run.means.get(name));
        means.all(|mean| mean.is_some_and(|mean| mean.mean.is_finite()))
    });
    let common: Vec<String> = common.map(String::from).collect();
    if common.is_empty() {
        let kinds = grouped(runs, |a, b| a.stage == b.stage).into_iter();
        let kinds = kinds.map(|runs| format!("{} (stage {})", runs[0].name, runs[0].stage.name()));
        return Err(Failure::input(format!(
            "the runs have no column in common: {}; give runs of one kind, or --columns",
            kinds.collect::<Vec<_>>().join(", ")
        )));
    }
    Ok(common)
}

/// The last part of a key.
fn last_part(key: &str) -> &str {
    key.rsplit('.').next().unwrap_or_default()
}
