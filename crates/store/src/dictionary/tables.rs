//! The declared columns, table by table.

use gshear_analysis::aftermath::BoxChange;
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_analysis::phase_measures::PhaseMeasures;
use gshear_analysis::phases::PhaseStatistics;
use gshear_analysis::stability::Stability;
use gshear_dem::columns::Column;
use gshear_dem::state::all_series_columns;

use crate::box_columns::{AqsRow, NewtonianRow};
use crate::contact_quantities::numbers;
use crate::layout::{Form, MASS, RADIUS, elements};

/// A table of numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct TableDescription {
    /// Name of the file; of a group in an HDF5 file `file: group`.
    pub file: &'static str,
    /// What a line is.
    pub lines: &'static str,
    /// The columns. Those with an axis or a component stand once, without it.
    pub columns: Vec<Column>,
}

/// The tables; the first lines say how they are written.
const TABLES: &str = include_str!("tables.txt");

/// The kind of the tables of figures.
pub(super) const OF_FIGURES: &str = "report/*.csv";

/// Returns all tables in `axes` dimensions.
///
/// # Panics
/// If `tables.txt` is wrong, which is a bug.
pub fn tables(axes: usize) -> Vec<TableDescription> {
    let mut all: Vec<TableDescription> = Vec::new();
    let is_comment = |line: &&str| line.is_empty() || line.starts_with('#');
    for line in TABLES.lines().filter(|line| !is_comment(line)) {
        let fields: Vec<&str> = line.trim().split(" | ").collect();
        let columns = match fields[..] {
            [file, lines] => {
                all.push(TableDescription {
                    file,
                    lines,
                    columns: Vec::new(),
                });
                continue;
            }
            [_, _, _, "3D"] if axes == 2 => continue,
            [name, unit, doc] | [name, unit, doc, "3D"] => vec![Column::new(name, unit, doc)],
            [name] => match name.strip_prefix('[') {
                Some(row) => declared(row.trim_end_matches(']'), axes),
                None => vec![above(&all, name)],
            },
            _ => panic!("tables.txt: {line}"),
        };
        let table = all.last_mut().expect("a table before its columns");
        table.columns.extend(columns);
    }
    all
}

/// The last column of this name.
fn above(tables: &[TableDescription], name: &str) -> Column {
    let columns = tables.iter().flat_map(|table| &table.columns);
    let found = columns.rev().find(|column| column.name == name);
    *found.unwrap_or_else(|| panic!("tables.txt: {name} before its meaning"))
}

/// The columns of a row that is declared elsewhere.
fn declared(row: &str, axes: usize) -> Vec<Column> {
    // Which one it is depends on the law: `unit` of the dataset in run.h5 says it.
    let either = if axes == 2 { "N m-1 or m" } else { "N or m" };
    let of_law = |column: Column| match column.name {
        "tangential_history" => Column::new(column.name, either, column.doc),
        _ => column,
    };
    let form = Form::new(axes, axes == 3);
    match row {
        "SeriesRow" => all_series_columns(),
        "AqsRow" => AqsRow::COLUMNS.to_vec(),
        "NewtonianRow" => NewtonianRow::COLUMNS.to_vec(),
        "FrameScalars" => FrameScalars::COLUMNS.to_vec(),
        "PhaseStatistics" => PhaseStatistics::COLUMNS.to_vec(),
        "PhaseMeasures" => PhaseMeasures::COLUMNS.to_vec(),
        "Stability" => Stability::COLUMNS.to_vec(),
        "BoxChange" => BoxChange::COLUMNS.to_vec(),
        "radius" => vec![RADIUS],
        "mass" => vec![MASS],
        "grain" => elements(axes)[1..].iter().map(|of| of.0).collect(),
        "contact" => numbers(form).map(|of| of_law(of.column)).collect(),
        _ => panic!("tables.txt: [{row}] is not declared"),
    }
}
