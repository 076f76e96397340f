//! `phases`: writes the table of stick and slip phases.

use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

use super::commands::lost;
use gshear_analysis::phases::{self, Kind, Phase};
use gshear_dem::failure::Failure;
use gshear_store::run_reader::Run;
use gshear_store::text_writer;

/// Writes `phases.csv` into `folder` and a summary to `output`.
///
/// # Errors
/// A folder or file that cannot be written.
pub fn write(run: &Run, folder: &Path, output: &mut impl Write) -> Result<(), Failure> {
    let series = run.series();
    let found = phases::find(series.column("strain"), series.column("stress_ratio"));
    let path = folder.join("phases.csv");
    text_writer::write(&path, &table(&found, &series.step))?;
    summary(&found, output).map_err(lost)?;
    writeln!(output, "wrote {}", path.display()).map_err(lost)
}

/// Returns one line per phase. Numbers have the shortest form that reads back to the same bits.
fn table(found: &[Phase], step: &[u64]) -> String {
    let mut csv = String::from(
        "phase,kind,length,start_row,end_row,start_step,end_step,start_strain,end_strain,t_p,t_p_strain,delta_tau_p\n",
    );
    for (k, phase) in found.iter().enumerate() {
        let length = if phase.is_long() { "long" } else { "short" };
        let (kind, [from, to]) = (phase.kind.name(), phase.strain);
        let (start, end, duration) = (phase.start, phase.end, phase.duration());
        let (first, last) = (step[start], step[end]);
        let (strain, change) = (phase.duration_strain(), phase.change);
        writeln!(
            csv,
            "{k},{kind},{length},{start},{end},{first},{last},{from:?},{to:?},{duration},{strain:?},{change:?}"
        )
        .expect("a string grows");
    }
    csv
}

fn summary(found: &[Phase], output: &mut impl Write) -> std::io::Result<()> {
    writeln!(
        output,
        "{:<8}{:>10}{:>10}{:>16}{:>16}",
        "phases", "number", "long", "mean |Δτ_p|", "mean t_p/Δγ"
    )?;
    for kind in [Kind::Stick, Kind::Slip] {
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
