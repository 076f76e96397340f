//! The declared columns, table by table.

use gshear_analysis::aftermath::BoxChange;
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_analysis::phase_measures::PhaseMeasures;
use gshear_analysis::phases::PhaseStatistics;
use gshear_analysis::stability::{DampedStability, Stability};
use gshear_dem::boundary::Boundary;
use gshear_dem::columns::Column;

use crate::box_columns::{NewtonianRow, strain_columns};
use crate::contact_quantities::numbers;
use crate::layout::{FrameFormat, MASS, RADIUS, elements};

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
    for line in TABLES.lines() {
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
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
    let last = columns.rev().find(|column| column.name == name);
    *last.unwrap_or_else(|| panic!("tables.txt: {name} before its meaning"))
}

/// A column of the contacts, whatever their law.
fn of_any_law(column: Column, axes: usize) -> Column {
    if column.name != "tangential_history" {
        return column;
    }
    // Which one it is depends on the law: `unit` of the dataset in run.h5 says it.
    let either = if axes == 2 { "N m-1 or m" } else { "N or m" };
    Column::new(column.name, either, column.doc)
}

/// The columns of a row that is declared elsewhere.
fn declared(row: &str, axes: usize) -> Vec<Column> {
    let form = FrameFormat::new(axes, axes == 3);
    match row {
        "SeriesRow" => Boundary::all_series_columns(),
        "AqsRow" => strain_columns(true).to_vec(),
        "NewtonianRow" => NewtonianRow::COLUMNS.to_vec(),
        "FrameScalars" => FrameScalars::COLUMNS.to_vec(),
        "PhaseStatistics" => PhaseStatistics::COLUMNS.to_vec(),
        "PhaseMeasures" => PhaseMeasures::COLUMNS.to_vec(),
        "Stability" => Stability::COLUMNS.to_vec(),
        "DampedStability" => DampedStability::COLUMNS.to_vec(),
        "BoxChange" => BoxChange::COLUMNS.to_vec(),
        "radius" => vec![RADIUS],
        "mass" => vec![MASS],
        "grain" => elements(axes)[1..]
            .iter()
            .map(|quantity| quantity.column)
            .collect(),
        "contact" => numbers(form)
            .map(|quantity| of_any_law(quantity.column, axes))
            .collect(),
        _ => panic!("tables.txt: [{row}] is not declared"),
    }
}
