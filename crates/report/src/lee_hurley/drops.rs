//! The largest drops of τ, with the time steps to replay them from.

use std::fmt::Write as _;

use super::studied::Studied;
use gshear_analysis::phases::{Kind, Phase};

/// Number of drops listed per run.
const LISTED: usize = 20;
/// Number of drops after the largest one in the table of numbers.
const NEXT: usize = 3;

/// The slips of a regime by loss of τ, the greatest first; of equal ones the first in time.
fn largest(run: &Studied) -> Vec<Phase> {
    let phases = run.regime.phases.iter().map(|measured| measured.phase);
    let mut slips: Vec<Phase> = phases.filter(|phase| phase.kind == Kind::Slip).collect();
    slips.sort_by(|a, b| a.change.total_cmp(&b.change));
    slips.truncate(LISTED);
    slips
}

/// Returns the content of `drops.csv`, one line per drop.
pub fn csv(runs: &[Studied]) -> String {
    let mut csv =
        String::from("run,rank,start_step,end_step,start_strain,end_strain,t_p,delta_tau_p\n");
    for run in runs {
        for (k, slip) in largest(run).iter().enumerate() {
            let [from, to] = slip.strain;
            let steps = [slip.start, slip.end].map(|row| run.step[row]);
            writeln!(
                csv,
                "{},{},{},{},{from:?},{to:?},{},{:?}",
                run.label,
                k + 1,
                steps[0],
                steps[1],
                slip.duration(),
                slip.change
            )
            .expect("writing to a string cannot fail");
        }
    }
    csv
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
