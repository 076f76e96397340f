//! Reads the record of an experiment of a laboratory from a table: a line of names, then rows.

use std::io::Read;
use std::path::Path;

use csv::{ReaderBuilder, StringRecord, Trim};

use super::read::{one_load, tested};
use gshear_analysis::moments::mean;
use gshear_analysis::rate_state::{SliderRecord, of_displacement, with_changes};
use gshear_dem::failure::{Failure, Result};
use gshear_store::sound;

/// The columns of a table, and which of its rows are read.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Experiments of a laboratory")]
pub struct Arguments {
    /// Column of the time, with its unit: s, ms, us, min or h [default: s]. RUN then is the table
    /// of an experiment: numbers separated by commas, semicolons, tabs or spaces below a line of
    /// names; without names, columns are 1, 2, …
    #[arg(long, value_name = "NAME[:UNIT]", value_parser = time)]
    time: Option<Column>,
    /// Column of the displacement of the load point, with its unit: m, mm, um or nm [default: m]
    #[arg(long, value_name = "NAME[:UNIT]", value_parser = length, requires = "time")]
    displacement: Option<Column>,
    /// Column of the velocity of the load point instead, with a unit such as um/s [default: m/s]
    #[arg(
        long, value_name = "NAME[:UNIT]", value_parser = velocity, requires = "time",
        conflicts_with = "displacement"
    )]
    velocity: Option<Column>,
    /// Column of the slip, with its unit [default: the displacement less (μ - μ_0)/k̄]
    #[arg(long, value_name = "NAME[:UNIT]", value_parser = length, requires = "time")]
    slip: Option<Column>,
    /// Column of the friction μ
    #[arg(long, value_name = "NAME", value_parser = number, requires = "time")]
    friction: Option<Column>,
    /// Column of the shear stress instead, with its unit: Pa, kPa, MPa or GPa [default: Pa]
    #[arg(
        long, value_name = "NAME[:UNIT]", value_parser = stress,
        requires_all = ["time", "normal_stress"], conflicts_with = "friction"
    )]
    shear_stress: Option<Column>,
    /// Column of the normal stress, with its unit
    #[arg(long, value_name = "NAME[:UNIT]", value_parser = stress, requires = "time")]
    normal_stress: Option<Column>,
    /// Leave out the rows before this time, in the unit of the time
    #[arg(
        long,
        value_name = "TIME",
        requires = "time",
        allow_negative_numbers = true
    )]
    from: Option<f64>,
    /// Leave out the rows after this time
    #[arg(
        long,
        value_name = "TIME",
        requires = "time",
        allow_negative_numbers = true
    )]
    to: Option<f64>,
    /// Times at which the velocity of the load point changes, in the unit of the time [default:
    /// found in the displacement]
    #[arg(
        long,
        value_name = "TIME,…",
        value_delimiter = ',',
        requires = "time",
        allow_negative_numbers = true
    )]
    changes: Vec<f64>,
}

/// A column of the table.
#[derive(Debug, Clone, PartialEq)]
struct Column {
    name: String,
    /// Its unit in SI units.
    unit: f64,
}

/// Units of a quantity, with their values in SI units. The first one is the default.
type Units = [(&'static str, f64)];

const TIMES: &Units = &[
    ("s", 1.0),
    ("ms", 1e-3),
    ("us", 1e-6),
    ("min", 60.0),
    ("h", 3600.0),
];
const LENGTHS: &Units = &[
    ("m", 1.0),
    ("mm", 1e-3),
    ("um", 1e-6),
    ("µm", 1e-6),
    ("μm", 1e-6),
    ("nm", 1e-9),
];
const STRESSES: &Units = &[("Pa", 1.0), ("kPa", 1e3), ("MPa", 1e6), ("GPa", 1e9)];

fn unit_of(units: &Units, name: &str) -> Option<f64> {
    let found = units.iter().find(|(known, _)| *known == name);
    found.map(|(_, value)| *value)
}

/// Divides NAME:UNIT; the name alone has the first unit.
fn column(text: &str, what: &str, unit: impl Fn(&str) -> Option<f64>) -> Result<Column, String> {
    let (name, unit) = match text.rsplit_once(':') {
        None => (text, 1.0),
        Some((name, given)) => {
            let unit = unit(given);
            (
                name,
                unit.ok_or(format!("{given:?} is not a unit of {what}"))?,
            )
        }
    };
    Ok(Column {
        name: name.to_string(),
        unit,
    })
}

fn time(text: &str) -> Result<Column, String> {
    column(text, "time: s, ms, us, min, h", |unit| unit_of(TIMES, unit))
}

fn length(text: &str) -> Result<Column, String> {
    column(text, "length: m, mm, um, nm", |unit| unit_of(LENGTHS, unit))
}

fn velocity(text: &str) -> Result<Column, String> {
    column(
        text,
        "velocity: m/s, mm/s, um/s, nm/s, um/min, …",
        |unit| {
            let (length, time) = unit.split_once('/')?;
            Some(unit_of(LENGTHS, length)? / unit_of(TIMES, time)?)
        },
    )
}

fn stress(text: &str) -> Result<Column, String> {
    column(text, "stress: Pa, kPa, MPa, GPa", |unit| {
        unit_of(STRESSES, unit)
    })
}

fn number(text: &str) -> Result<Column, String> {
    column(text, "friction, which has none: 1", |unit| {
        (unit == "1").then_some(1.0)
    })
}

/// The stiffness of machine and spring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stiffness {
    /// k̄ (1/m).
    OfFriction(f64),
    /// Stress per displacement (Pa/m); k̄ times the normal stress.
    OfStress(f64),
    /// k̄ is fitted.
    Fitted,
}

/// Parses VALUE[:UNIT] or `fit`.
pub(super) fn stiffness(text: &str) -> Result<Stiffness, String> {
    if text == "fit" {
        return Ok(Stiffness::Fitted);
    }
    let (number, unit) = text.split_once(':').unwrap_or((text, "1/m"));
    let value = super::super::positive(number)?;
    let known = unit.split_once('/').and_then(|(above, below)| {
        let length = unit_of(LENGTHS, below)?;
        match above {
            "1" => Some(Stiffness::OfFriction(value / length)),
            stress => Some(Stiffness::OfStress(
                value * unit_of(STRESSES, stress)? / length,
            )),
        }
    });
    known.ok_or(format!(
        "{unit:?} is not a unit of stiffness: 1/m, 1/mm, 1/um of the friction, or MPa/mm, … of the stress"
    ))
}

/// Means per segment of a fit: more than of runs, since a laboratory slides far beyond D_c after a
/// step and the peak is a small part of it.
const MEANS: usize = 3000;

/// The rows of some columns.
struct Rows {
    /// `[columns][rows]` Values in SI units.
    values: Vec<Vec<f64>>,
    /// `[rows]` Lines of the file.
    lines: Vec<u64>,
}

impl Arguments {
    /// Whether the run is a table.
    pub(super) fn is_given(&self) -> bool {
        self.time.is_some()
    }

    /// Returns the record of an experiment, from its first slide on. Its k̄ is NaN if it is fitted.
    ///
    /// # Errors
    /// [`Failure::Input`], with line and column where there is one: a file that is no such table,
    /// columns that are missing, no velocity step or hold, a normal stress that changes.
    pub(super) fn record(&self, path: &Path, stiffness: Option<Stiffness>) -> Result<SliderRecord> {
        let wrong = |what: String| Failure::input(format!("{}: {what}", path.display()));
        let Some(stiffness) = stiffness else {
            return Err(wrong(
                "needs the stiffness of the machine: --stiffness VALUE:UNIT (1/mm of the friction, or MPa/mm of the stress), or --stiffness fit"
                    .into(),
            ));
        };
        let table = self.read(path)?;
        let drive = self
            .displacement(&table)
            .map_err(|what| wrong(what.into()))?;
        let time = &table.of(self.time.as_ref()).expect("a time").values;
        let Some(first_time) = time.first() else {
            return Err(wrong("has no rows; --from and --to leave none".into()));
        };
        let friction = self.friction(&table).map_err(|what| wrong(what.into()))?;
        let normal = table.of(self.normal_stress.as_ref());
        let mean_normal = normal.as_ref().map(|normal| mean(&normal.values));
        let stiffness = match (stiffness, mean_normal) {
            (Stiffness::Fitted, _) => f64::NAN,
            (Stiffness::OfFriction(value), _) => value,
            (Stiffness::OfStress(value), Some(normal)) => value / normal,
            (Stiffness::OfStress(_), None) => {
                return Err(wrong(
                    "a stiffness of the stress needs --normal-stress NAME:UNIT, over which it is k̄"
                        .into(),
                ));
            }
        };
        let unit = self.time.as_ref().map_or(1.0, |time| time.unit);
        let segments = if self.changes.is_empty() {
            of_displacement(time, &drive.values)
        } else {
            let changes = self.changes.iter().map(|change| change * unit);
            with_changes(time, &drive.values, &changes.collect::<Vec<_>>())
        };
        let place = format!("column {}", drive.name);
        let segments = segments.map_err(|what| {
            wrong(format!(
                "{place}: {what}; --from, --to and --changes choose the rows and segments"
            ))
        })?;
        let slip = match table.of(self.slip.as_ref()) {
            Some(slip) => slip.values,
            None => {
                let rows = drive.values.iter().zip(&friction);
                let spring = |mu: f64| {
                    if stiffness.is_finite() {
                        (mu - friction[0]) / stiffness
                    } else {
                        0.0
                    }
                };
                rows.map(|(driven, mu)| driven - spring(*mu)).collect()
            }
        };
        // The record counts from its first row.
        let since = time.iter().map(|t| t - first_time).collect();
        let record = SliderRecord::of_run(stiffness, segments, [since, slip, friction]);
        let mut record = SliderRecord {
            means: MEANS,
            ..record
        };
        if let (Some(normal), Some(mean)) = (&normal, mean_normal) {
            record.load = normal.values.iter().map(|stress| stress / mean).collect();
        }
        let tested = tested(&record, &place).map_err(wrong)?;
        if let Some(normal) = normal {
            let first = record.time.partition_point(|t| *t < tested.time[0]);
            let rows = first..first + tested.time.len();
            let place = format!("column {}", normal.name);
            one_load(&tested, &normal.values[rows], &place, "Pa").map_err(wrong)?;
        }
        Ok(tested)
    }

    /// The displacement of the load point (m), of its velocity the sum.
    fn displacement(&self, table: &Table) -> Result<Values, &'static str> {
        let Some(velocity) = table.of(self.velocity.as_ref()) else {
            let of_load_point = table.of(self.displacement.as_ref());
            return of_load_point.ok_or(
                "needs the motion of the load point: --displacement NAME:UNIT, or --velocity NAME:UNIT",
            );
        };
        let time = &table.of(self.time.as_ref()).expect("a time").values;
        let mut driven = 0.0;
        let mut values = vec![0.0; time.len().min(1)];
        for k in 1..time.len() {
            let mean = 0.5 * (velocity.values[k - 1] + velocity.values[k]);
            driven += mean * (time[k] - time[k - 1]);
            values.push(driven);
        }
        Ok(Values {
            name: velocity.name,
            values,
        })
    }

    /// μ.
    fn friction(&self, table: &Table) -> Result<Vec<f64>, &'static str> {
        if let Some(friction) = table.of(self.friction.as_ref()) {
            return Ok(friction.values);
        }
        let stresses = [&self.shear_stress, &self.normal_stress].map(|s| table.of(s.as_ref()));
        let [Some(shear), Some(normal)] = stresses else {
            return Err(
                "needs the friction: --friction NAME, or --shear-stress NAME:UNIT and --normal-stress NAME:UNIT",
            );
        };
        let rows = shear.values.iter().zip(&normal.values);
        Ok(rows.map(|(shear, normal)| shear / normal).collect())
    }

    /// Reads the columns that are named.
    fn read(&self, path: &Path) -> Result<Table> {
        let wrong = |what: String| Failure::input(format!("{}: {what}", path.display()));
        let mut bytes = Vec::new();
        let mut file = sound::regular(path).map_err(|e| wrong(e.to_string()))?;
        file.read_to_end(&mut bytes)
            .map_err(|e| wrong(e.to_string()))?;
        let text = String::from_utf8_lossy(&bytes);
        let wanted = [
            &self.time,
            &self.displacement,
            &self.velocity,
            &self.slip,
            &self.friction,
            &self.shear_stress,
            &self.normal_stress,
        ];
        let wanted: Vec<Column> = wanted.into_iter().flatten().cloned().collect();
        let window = [self.from, self.to];
        let must_be_positive = self.normal_stress.as_ref().map(|column| &*column.name);
        let rows = rows(&text, &wanted, window, must_be_positive).map_err(wrong)?;
        let time = &rows.values[0];
        if let Some(row) = (1..time.len()).find(|&row| time[row] <= time[row - 1]) {
            return Err(wrong(format!(
                "line {}, column {}: the time does not increase; remove the row, or leave it out by --from and --to",
                rows.lines[row], wanted[0].name
            )));
        }
        let columns = wanted.into_iter().zip(rows.values);
        let columns = columns.map(|(column, values)| Values {
            name: column.name,
            values,
        });
        Ok(Table(columns.collect()))
    }
}

/// A column with its values in SI units.
#[derive(Debug, Clone)]
struct Values {
    name: String,
    values: Vec<f64>,
}

/// The columns that were read.
struct Table(Vec<Values>);

impl Table {
    fn of(&self, column: Option<&Column>) -> Option<Values> {
        let column = column?;
        self.0
            .iter()
            .find(|values| values.name == column.name)
            .cloned()
    }
}

/// What separates the cells of a line.
fn separator(line: &str) -> u8 {
    let known = [b'\t', b';', b','];
    let found = known
        .into_iter()
        .find(|byte| line.as_bytes().contains(byte));
    found.unwrap_or(b' ')
}

/// Reads the wanted columns, the first of which is the time, of the rows from one time to another
/// in the unit of the table.
fn rows(
    text: &str,
    wanted: &[Column],
    [from, to]: [Option<f64>; 2],
    must_be_positive: Option<&str>,
) -> Result<Rows, String> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let written = text
        .lines()
        .find(|line| !line.trim().is_empty() && !line.starts_with('#'));
    let separator = separator(written.ok_or("is empty")?);
    let mut reader = ReaderBuilder::new()
        .delimiter(separator)
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .trim(Trim::All)
        .from_reader(text.as_bytes());
    let mut head: Option<Vec<String>> = None;
    let mut places = Vec::new();
    let mut rows = Rows {
        values: vec![Vec::new(); wanted.len()],
        lines: Vec::new(),
    };
    for record in reader.records() {
        let record = record.map_err(|e| e.to_string())?;
        let line = record.position().map_or(0, csv::Position::line);
        let cells = cells(&record, separator);
        if cells.is_empty() {
            continue;
        }
        let width = match &head {
            Some(head) => head.len(),
            None => {
                let has_names = cells.iter().any(|cell| cell.parse::<f64>().is_err());
                let names: Vec<String> = if has_names {
                    cells.iter().map(ToString::to_string).collect()
                } else {
                    (1..=cells.len()).map(|k| k.to_string()).collect()
                };
                places = places_of(wanted, &names, line)?;
                let width = names.len();
                head = Some(names);
                if has_names {
                    continue;
                }
                width
            }
        };
        if cells.len() != width {
            return Err(format!(
                "line {line}: has {} cells where the first line has {width}",
                cells.len()
            ));
        }
        let mut row = Vec::with_capacity(wanted.len());
        for (column, &place) in wanted.iter().zip(&places) {
            let place_of = format!("line {line}, column {}", column.name);
            let cell = cells[place];
            let value = cell.parse().ok().filter(|value: &f64| value.is_finite());
            let value = value.ok_or(format!("{place_of}: {cell:?} is not a number"))?;
            if row.is_empty() && (from.is_some_and(|t| value < t) || to.is_some_and(|t| value > t))
            {
                break;
            }
            if must_be_positive == Some(&*column.name) && value <= 0.0 {
                return Err(format!(
                    "{place_of}: the normal stress is {value}, must be positive: the slider must press on the sample"
                ));
            }
            row.push(value * column.unit);
        }
        if row.len() == wanted.len() {
            for (values, value) in rows.values.iter_mut().zip(row) {
                values.push(value);
            }
            rows.lines.push(line);
        }
    }
    Ok(rows)
}

/// The cells of a line; several spaces are one separator.
fn cells(record: &StringRecord, separator: u8) -> Vec<&str> {
    let cells = record
        .iter()
        .filter(|cell| separator != b' ' || !cell.is_empty());
    cells.collect()
}

/// The places of the wanted columns in the line of names.
fn places_of(wanted: &[Column], names: &[String], line: u64) -> Result<Vec<usize>, String> {
    let places = wanted.iter().map(|column| {
        let place = names.iter().position(|name| *name == column.name);
        place.ok_or_else(|| {
            format!(
                "line {line}: has no column {:?}; there are {}",
                column.name,
                names
                    .iter()
                    .map(|name| format!("{name:?}"))
                    .collect::<Vec<_>>()
                    .join(", ")
            )
        })
    });
    places.collect()
}
