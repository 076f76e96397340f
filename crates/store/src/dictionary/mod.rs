//! The columns of every CSV file: name, unit and meaning. `gshear-reduce columns` prints them, and
//! beside each file they are written as `<file>-metadata.json` (CSV on the Web, W3C 2015).

mod tables;

use std::path::Path;

use gshear_dem::columns::Column;
use gshear_dem::failure::Result;
use gshear_scene::key;
use serde_json::{Value, json};

use crate::text_writer;
use tables::OF_FIGURES;
pub use tables::{TableDescription, tables};

/// Returns the metadata of a table `kind`, such as `log.csv`, in a file of the name `file`, if the
/// dictionary has all its columns. A component is described as its vector: `velocity_x` as
/// `velocity`; an eigenvector without its number: `mode12_rotation_re_x` as `modeK_rotation_re`.
///
/// `own`: columns that say more exactly what the table of the kind says.
fn metadata(kind: &str, file: &str, names: &[&str], own: &[Column], axes: usize) -> Option<String> {
    let all = tables(axes);
    let table = all.iter().find(|table| table.file == kind)?;
    let mut known = KnownColumns {
        axes,
        columns: own.iter().chain(&table.columns).collect(),
        // These have columns of other tables.
        is_of_all: OF_ALL.contains(&kind),
    };
    if known.is_of_all {
        known
            .columns
            .extend(all.iter().flat_map(|table| &table.columns));
    }
    let columns: Vec<Value> = names
        .iter()
        .map(|name| known.describe(name))
        .collect::<Option<_>>()?;
    Some(format!(
        "{:#}\n",
        json!({
            "@context": "http://www.w3.org/ns/csvw",
            "url": file,
            "dc:description": format!("One line per {}", table.lines),
            "tableSchema": { "columns": columns },
        })
    ))
}

/// The columns that a table may have.
struct KnownColumns<'a> {
    axes: usize,
    columns: Vec<&'a Column>,
    /// Whether they are of all tables; then there are keys of scenes and standard errors as well.
    is_of_all: bool,
}

impl KnownColumns<'_> {
    /// A column as CSV on the Web describes it, if it is known.
    fn describe(&self, name: &str) -> Option<Value> {
        if self.is_of_all
            && let Some(key) = key(name)
        {
            return Some(described(name, key.doc.trim(), Some(key.unit)));
        }
        let general = match name.strip_prefix("mode") {
            Some(rest) => {
                let rest = rest.trim_start_matches(|c: char| c.is_ascii_digit());
                format!("modeK{rest}")
            }
            None => name.to_string(),
        };
        let mut columns = self.columns.iter();
        let column = columns.find(|column| {
            let rest = general.strip_prefix(column.name);
            rest.is_some_and(|rest| rest.is_empty() || AXES.contains(&rest))
        });
        if let Some(column) = column {
            let unit = column.unit_in(self.axes);
            return Some(described(name, column.doc, unit.as_deref()));
        }
        if !self.is_of_all {
            return None;
        }
        let mean = name.strip_suffix(ERROR)?;
        let column = self.columns.iter().find(|column| column.name == mean)?;
        let doc = column.doc;
        let doc = format!("standard error over runs of the mean of {mean}: {doc}");
        let unit = column.unit_in(self.axes);
        Some(described(name, &doc, unit.as_deref()))
    }
}

/// A column as CSV on the Web describes it.
fn described(name: &str, doc: &str, unit: Option<&str>) -> Value {
    let mut described = json!({ "name": name, "titles": name, "dc:description": doc });
    if let Some(unit) = unit.filter(|unit| !unit.is_empty()) {
        described["schema:unitText"] = unit.into();
    }
    described
}

/// Returns the first column of this name in any table, in 3D.
pub fn column(name: &str) -> Option<Column> {
    let all = tables(3);
    let mut columns = all.iter().flat_map(|table| &table.columns);
    columns.find(|column| column.name == name).copied()
}

/// Writes the metadata of a table `kind`, such as `log.csv`, beside the table, or, if the
/// dictionary lacks a column, nothing.
///
/// # Errors
/// `Failure::Other` if the file cannot be written.
pub fn write_metadata(kind: &str, table: &Path, names: &[&str], axes: usize) -> Result<()> {
    write_metadata_with(kind, table, names, &[], axes)
}

/// [`write_metadata`] of a table whose columns say more exactly what the dictionary says.
///
/// # Errors
/// Likewise.
pub fn write_metadata_with(
    kind: &str,
    table: &Path,
    names: &[&str],
    own: &[Column],
    axes: usize,
) -> Result<()> {
    let file = table.file_name().unwrap_or_default().to_string_lossy();
    match metadata(kind, &file, names, own, axes) {
        Some(text) => text_writer::write(&table.with_file_name(format!("{file}{ENDING}")), &text),
        None => Ok(()),
    }
}

/// Writes a table of the reducer of a run in `axes` dimensions, and its metadata.
///
/// # Errors
/// If a file cannot be written.
pub fn write_table(path: &Path, csv: &str, axes: usize) -> Result<()> {
    let kind = path.file_name().unwrap_or_default().to_string_lossy();
    write_described(&kind, path, csv, axes)
}

/// Writes the data of a figure of a run in `axes` dimensions, and its metadata.
///
/// # Errors
/// If a file cannot be written.
pub fn write_figure_data(path: &Path, csv: &str, axes: usize) -> Result<()> {
    write_described(OF_FIGURES, path, csv, axes)
}

/// Writes a table of a kind, such as `frame-contacts.csv`, whatever its own name, and its metadata.
///
/// # Errors
/// If a file cannot be written.
pub fn write_described(kind: &str, path: &Path, csv: &str, axes: usize) -> Result<()> {
    write_described_with(kind, path, csv, &[], axes)
}

/// [`write_figure_data`] of columns that say more exactly what the dictionary says.
///
/// # Errors
/// Likewise.
pub fn write_figure_data_with(path: &Path, csv: &str, own: &[Column], axes: usize) -> Result<()> {
    write_described_with(OF_FIGURES, path, csv, own, axes)
}

fn write_described_with(
    kind: &str,
    path: &Path,
    csv: &str,
    own: &[Column],
    axes: usize,
) -> Result<()> {
    text_writer::write(path, csv)?;
    let names: Vec<&str> = csv.lines().next().unwrap_or_default().split(',').collect();
    write_metadata_with(kind, path, &names, own, axes)
}

/// Tables with columns of other tables, and keys of scenes.
const OF_ALL: [&str; 3] = [OF_FIGURES, "runs.csv", "means.csv"];

/// Of the name of the standard error of a mean, after that of its column.
pub const ERROR: &str = "_error";

/// Of the name of metadata, after that of its table.
const ENDING: &str = "-metadata.json";

/// Ends of the names of components.
const AXES: [&str; 9] = ["_x", "_y", "_z", "_xx", "_xy", "_xz", "_yy", "_yz", "_zz"];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_are_described_as_their_vector() {
        let mode = "mode12_rotation_im_z";
        let names = ["frame", "x", "angular_velocity_z", "stress_xy", mode];
        let text = metadata("frames.csv", "a.csv", &names, &[], 2).expect("described");
        let found: Value = serde_json::from_str(&text).expect("JSON");
        let column = |k: usize| &found["tableSchema"]["columns"][k];
        assert_eq!(found["url"], "a.csv");
        assert_eq!(column(1)["schema:unitText"], "m");
        assert_eq!(column(2)["schema:unitText"], "rad s-1");
        assert_eq!(column(3)["schema:unitText"], "Pa");
        assert_eq!(column(0).get("schema:unitText"), None);
        assert_eq!(column(4)["name"], mode);
        let doc = column(4)["dc:description"].as_str().unwrap_or_default();
        assert!(doc.starts_with("rotation"), "{doc}");
        assert_eq!(
            metadata("frames.csv", "a.csv", &["positions"], &[], 2),
            None
        );
        assert_eq!(metadata("other.csv", "a.csv", &["step"], &[], 2), None);
    }

    #[test]
    fn forces_of_disks_are_per_unit_depth() {
        let unit = |axes| {
            let text =
                metadata("log.csv", "log.csv", &["shear_force"], &[], axes).expect("described");
            let found: Value = serde_json::from_str(&text).expect("JSON");
            found["tableSchema"]["columns"][0]["schema:unitText"].clone()
        };
        assert_eq!((unit(2), unit(3)), ("N m-1".into(), "N".into()));
    }
}
