//! Columns of the time series that a scene has declared, as an attribute of `parameters`: their
//! order, units and definitions, which the checksum of the attributes protects.

use gshear_dem::columns::Column;
use serde::{Deserialize, Serialize};

/// The name of the attribute. Files without such columns lack it.
pub(crate) const ATTRIBUTE: &str = "observables";

/// Columns of a file, at most: each has datasets of its own.
const MOST: usize = 10_000;

/// A column as the attribute has it.
#[derive(Serialize, Deserialize)]
struct StoredColumn {
    name: String,
    unit: String,
    definition: String,
}

/// The text of the attribute, as JSON; `None` without such columns.
pub(crate) fn text(series: &[Column]) -> Option<String> {
    let own = series.iter().filter(|column| column.is_own);
    let own: Vec<StoredColumn> = own
        .map(|column| StoredColumn {
            name: column.name.into(),
            unit: column.unit.into(),
            definition: column.doc.into(),
        })
        .collect();
    if own.is_empty() {
        return None;
    }
    Some(serde_json::to_string(&own).expect("texts"))
}

/// The columns of a text; `None` if it is none of [`text`].
pub(crate) fn read(text: &str) -> Option<Vec<Column>> {
    if text.is_empty() {
        return Some(Vec::new());
    }
    let stored: Vec<StoredColumn> = serde_json::from_str(text).ok()?;
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let are_names = stored
        .iter()
        .all(|column| !column.name.is_empty() && column.name.chars().all(is_word));
    if !are_names || stored.len() > MOST {
        return None;
    }
    let columns = stored
        .iter()
        .map(|column| Column::own(&column.name, &column.unit, &column.definition));
    Some(columns.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use gshear_dem::state::SeriesRow;

    #[test]
    fn columns_come_back_in_their_order() {
        let own = [
            Column::own("v", "m/s", "quantity = \"v_x\""),
            Column::own("a", "1", "expression = \"v\""),
        ];
        let series = [&SeriesRow::COLUMNS[..], &own].concat();
        let stored = text(&series).expect("columns of a scene");
        assert_eq!(read(&stored).as_deref(), Some(&own[..]));
        assert_eq!(text(&SeriesRow::COLUMNS), None);
        for damaged in ["{", "[{}]", &stored.replace("\"v\"", "\"../v\"")] {
            assert_eq!(read(damaged), None);
        }
    }
}
