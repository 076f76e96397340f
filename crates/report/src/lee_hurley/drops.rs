//! The largest drops of τ, with the time steps to replay them from.

use super::studied::Studied;
use gshear_analysis::phases::{Phase, PhaseKind};
use gshear_store::table::Table;

/// QuotedNumber of drops listed per run.
const LISTED: usize = 20;
/// QuotedNumber of drops after the largest one in the table of numbers.
const NEXT: usize = 3;

/// The slips of a regime by loss of τ, the greatest first; of equal ones the first in time.
fn largest(run: &Studied) -> Vec<Phase> {
    let phases = run.regime.phases.iter().map(|measured| measured.phase);
    let mut slips: Vec<Phase> = phases
        .filter(|phase| phase.kind == PhaseKind::Slip)
        .collect();
    slips.sort_by(|a, b| a.change.total_cmp(&b.change));
    slips.truncate(LISTED);
    slips
}

/// Returns the content of `drops.csv`, one line per drop.
pub fn csv(runs: &[Studied]) -> String {
    let rows = runs.iter().flat_map(|run| {
        let slips = largest(run).into_iter().zip(1usize..);
        slips.map(move |(slip, rank)| (run, rank, slip))
    });
    Table::of(rows)
        .column("run", |(run, ..)| &run.label)
        .column("rank", |(_, rank, _)| *rank)
        .column("start_step", |(run, _, slip)| run.step[slip.start])
        .column("end_step", |(run, _, slip)| run.step[slip.end])
        .columns(["start_strain", "end_strain"], |(.., slip)| slip.strain)
        .column("t_p", |(.., slip)| slip.duration())
        .column("delta_tau_p", |(.., slip)| slip.change)
        .csv()
}

/// Returns the drops after the largest one as text.
pub fn next(run: &Studied) -> String {
    let slips = largest(run);
    let words = |slip: &Phase| {
        format!(
            "Δτ_p = {:.4} at {:.4} %",
            slip.change,
            100.0 * slip.strain[0]
        )
    };
    let words: Vec<String> = slips.iter().skip(1).take(NEXT).map(words).collect();
    match words.is_empty() {
        true => "none".into(),
        false => words.join("; "),
    }
}
