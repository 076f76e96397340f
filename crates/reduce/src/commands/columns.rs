//! `columns`: prints name, unit and meaning of the columns of tables.

use gshear_dem::failure::{Failure, Result};
use gshear_store::dictionary::{self, TableDescription};

use crate::printer::Printer;

/// Print name, unit and meaning of the columns of every table
///
/// Of log.csv, of the tables that this program writes, and of the time series of boxes.
/// Beside each CSV file the same stands in FILE-metadata.json (CSV on the Web).
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Only of this table, such as log.csv or phases.csv
    table: Option<String>,
    /// Dimensions: in 2 forces, energies and masses are per unit depth
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(2..=3))]
    dimension: u8,
}

impl Arguments {
    /// # Errors
    /// [`Failure::Input`] if there is no such table.
    pub fn run(&self, printer: &mut Printer) -> Result<()> {
        let (table, axes) = (self.table.as_deref(), self.dimension.into());
        let all = dictionary::tables(axes);
        let chosen = all.iter().filter(|known| {
            let name = known.file.split(':').next().unwrap_or(known.file);
            table.is_none_or(|wanted| [known.file, name].contains(&wanted))
        });
        let chosen: Vec<&TableDescription> = chosen.collect();
        if let (Some(table), true) = (table, chosen.is_empty()) {
            let known: Vec<&str> = all.iter().map(|known| known.file).collect();
            return Err(Failure::input(format!(
                "{table}: there is no such table; give one of {}",
                known.join(", ")
            )));
        }
        for (k, chosen) in chosen.iter().enumerate() {
            if k > 0 {
                writeln!(printer)?;
            }
            writeln!(printer, "{}: one line per {}", chosen.file, chosen.lines)?;
            let widths = chosen.columns.iter().map(|column| column.name.len());
            let width = widths.max().unwrap_or(0);
            for column in &chosen.columns {
                let unit = column.unit_in(axes).unwrap_or_else(|| "-".into());
                let (name, meaning) = (column.name, column.doc);
                writeln!(printer, "  {name:<width$}  {unit:<7}  {meaning}")?;
            }
        }
        Ok(())
    }
}
