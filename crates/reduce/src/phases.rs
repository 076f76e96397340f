//! `phases`: writes the table of stick and slip phases.

use std::io::Write;
use std::path::Path;

use crate::output::cannot_write;
use gshear_analysis::phases::{self, Phase, PhaseKind};
use gshear_analysis::tau::TauReading;
use gshear_dem::failure::Failure;
use gshear_store::dictionary;
use gshear_store::run_reader::RunFile;
use gshear_store::table::Table;

/// The normal force by which τ = S/N.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NormalForce {
    /// That of the free grains on the top wall.
    Measured,
    /// That imposed on the top wall.
    Imposed,
}

/// What the phases are found in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhaseRequest {
    /// The normal force.
    pub normal_force: NormalForce,
    /// The series of τ.
    pub tau: TauReading,
    /// γ from which on phases are found.
    pub from: f64,
}

/// Writes `phases.csv` into `folder` and a summary to `output`.
///
/// # Errors
/// A run without an imposed normal force, if that is asked for; a file that cannot be written.
pub fn write(
    run: &RunFile,
    request: &PhaseRequest,
    folder: &Path,
    output: &mut impl Write,
) -> Result<(), Failure> {
    let series = run.series();
    let tau = match request.normal_force {
        NormalForce::Measured => series.column("stress_ratio").to_vec(),
        NormalForce::Imposed => over_imposed(run)?,
    };
    let all = series.column("strain");
    let first = all.partition_point(|strain| *strain < request.from);
    let (rows, tau) = request.tau.of(&tau[first..]);
    let rows: Vec<usize> = rows.into_iter().map(|row| first + row).collect();
    let strain: Vec<f64> = rows.iter().map(|row| all[*row]).collect();
    let found = phases::find(&strain, &tau);
    let path = folder.join("phases.csv");
    dictionary::write_table(&path, &table(&found, &rows, &series.step))?;
    summary(&found, rows.len().saturating_sub(1), output).map_err(cannot_write)?;
    writeln!(output, "wrote {}", path.display()).map_err(cannot_write)
}

/// τ of every row with the normal force that the run imposed.
fn over_imposed(run: &RunFile) -> Result<Vec<f64>, Failure> {
    const IMPOSED: &str = "imposed_normal_force";
    let series = run.series();
    let shear = series.column("shear_force");
    if series.declared.iter().any(|column| column.name == IMPOSED) {
        let imposed = series.column(IMPOSED);
        return Ok(shear.iter().zip(imposed).map(|(s, n)| s / n).collect());
    }
    let imposed = run.number("normal_force").ok_or_else(|| {
        Failure::input(format!(
            "{}: parameters/normal_force is missing: use --normal-force measured",
            run.path().display()
        ))
    })?;
    Ok(shear.iter().map(|s| s / imposed).collect())
}

/// Returns one line per phase. `rows`: the rows of the time series in which it was found.
fn table(found: &[Phase], rows: &[usize], step: &[u64]) -> String {
    Table::of(found.iter().enumerate())
        .column("phase", |(k, _)| *k)
        .column("kind", |(_, phase)| phase.kind.name())
        .column("length", |(_, phase)| phase.length_name())
        .column("start_row", |(_, phase)| rows[phase.start])
        .column("end_row", |(_, phase)| rows[phase.end])
        .column("start_step", |(_, phase)| step[rows[phase.start]])
        .column("end_step", |(_, phase)| step[rows[phase.end]])
        .columns(["start_strain", "end_strain"], |(_, phase)| phase.strain)
        .column("t_p", |(_, phase)| phase.duration())
        .column("t_p_strain", |(_, phase)| phase.duration_strain())
        .column("delta_tau_p", |(_, phase)| phase.change)
        .csv()
}

fn summary(found: &[Phase], intervals: usize, output: &mut impl Write) -> std::io::Result<()> {
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
    if intervals > 0 {
        let per_interval = found.len() as f64 / intervals as f64;
        writeln!(
            output,
            "per interval: {per_interval:.4} phases, {:.4} cycles of a stick and a slip ({intervals} intervals)",
            0.5 * per_interval
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
