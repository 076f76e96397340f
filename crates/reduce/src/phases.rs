//! `phases`: writes the table of stick and slip phases.

use std::io::Write;
use std::path::Path;

use crate::output::cannot_write;
use gshear_analysis::phases::{self, Phase, PhaseKind};
use gshear_dem::failure::Failure;
use gshear_store::dictionary;
use gshear_store::run_reader::RunFile;
use gshear_store::table::Table;

/// Writes `phases.csv` into `folder` and a summary to `output`.
///
/// # Errors
/// A folder or file that cannot be written.
pub fn write(run: &RunFile, folder: &Path, output: &mut impl Write) -> Result<(), Failure> {
    let series = run.series();
    let found = phases::find(series.column("strain"), series.column("stress_ratio"));
    let path = folder.join("phases.csv");
    dictionary::write_table(&path, &table(&found, &series.step))?;
    summary(&found, output).map_err(cannot_write)?;
    writeln!(output, "wrote {}", path.display()).map_err(cannot_write)
}

/// Returns one line per phase.
fn table(found: &[Phase], step: &[u64]) -> String {
    Table::of(found.iter().enumerate())
        .column("phase", |(k, _)| *k)
        .column("kind", |(_, phase)| phase.kind.name())
        .column("length", |(_, phase)| phase.length_name())
        .column("start_row", |(_, phase)| phase.start)
        .column("end_row", |(_, phase)| phase.end)
        .column("start_step", |(_, phase)| step[phase.start])
        .column("end_step", |(_, phase)| step[phase.end])
        .columns(["start_strain", "end_strain"], |(_, phase)| phase.strain)
        .column("t_p", |(_, phase)| phase.duration())
        .column("t_p_strain", |(_, phase)| phase.duration_strain())
        .column("delta_tau_p", |(_, phase)| phase.change)
        .csv()
}

fn summary(found: &[Phase], output: &mut impl Write) -> std::io::Result<()> {
    writeln!(
        output,
        "{:<8}{:>10}{:>10}{:>16}{:>16}",
        "phases", "number", "long", "mean |Δτ_p|", "mean t_p/Δγ"
    )?;
    for kind in [PhaseKind::Stick, PhaseKind::Slip] {
        let of_kind: Vec<&Phase> = found.iter().filter(|phase| phase.kind == kind).collect();
        let count = of_kind.len() as f64;
        let change = of_kind.iter().map(|phase| phase.change.abs()).sum::<f64>() / count;
        let duration = of_kind
            .iter()
            .map(|phase| phase.duration() as f64)
            .sum::<f64>()
            / count;
        let long = of_kind.iter().filter(|phase| phase.is_long()).count();
        writeln!(
            output,
            "{:<8}{:>10}{long:>10}{change:>16.3e}{duration:>16.2}",
            kind.name(),
            of_kind.len()
        )?;
    }
    if let Some(drop) = phases::largest_drop(found) {
        writeln!(
            output,
            "largest drop: Δτ_p = {:.4e} from γ = {:.6e} to {:.6e}",
            drop.change, drop.strain[0], drop.strain[1]
        )?;
    }
    Ok(())
}
