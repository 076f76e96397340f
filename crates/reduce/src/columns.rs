//! `columns`: prints name, unit and meaning of the columns of tables.

use std::io::Write;

use gshear_dem::failure::Failure;
use gshear_store::dictionary::{self, TableDescription};

use crate::output::cannot_write;

/// Prints the columns of all tables in `axes` dimensions, or of `table` alone.
///
/// # Errors
/// [`Failure::Input`] if there is no such table.
pub fn print(table: Option<&str>, axes: usize, output: &mut impl Write) -> Result<(), Failure> {
    let all = dictionary::tables(axes);
    let is_wanted = |of: &&TableDescription| {
        let name = of.file.split(':').next().unwrap_or(of.file);
        table.is_none_or(|wanted| [of.file, name].contains(&wanted))
    };
    let chosen: Vec<&TableDescription> = all.iter().filter(is_wanted).collect();
    if let (Some(table), true) = (table, chosen.is_empty()) {
        let known: Vec<&str> = all.iter().map(|of| of.file).collect();
        return Err(Failure::input(format!(
            "{table}: there is no such table; give one of {}",
            known.join(", ")
        )));
    }
    for (k, of) in chosen.iter().enumerate() {
        if k > 0 {
            writeln!(output).map_err(cannot_write)?;
        }
        writeln!(output, "{}: one line per {}", of.file, of.lines).map_err(cannot_write)?;
        let widest = of.columns.iter().map(|column| column.name.len()).max();
        let width = widest.unwrap_or(0);
        for column in &of.columns {
            let unit = column.unit_in(axes).unwrap_or_else(|| "-".into());
            let (name, meaning) = (column.name, column.doc);
            writeln!(output, "  {name:<width$}  {unit:<7}  {meaning}").map_err(cannot_write)?;
        }
    }
    Ok(())
}
