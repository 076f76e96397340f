//! Histogram of phases by the magnitude of their change of τ.

use super::colour::{SLIP, STICK};
use super::plot::{Layout, figure};
use super::ticks;
use gshear_analysis::phases::{Phase, PhaseKind};
use gshear_store::csv_table::Table;

const LAYOUT: Layout = Layout::new([900.0, 400.0], 72.0);
/// Bins per decade, of equal ratio.
const BINS: f64 = 5.0;

/// Returns the phases as a table.
pub fn data(phases: &[Phase]) -> String {
    Table::of(phases)
        .column("kind", |phase| phase.kind.name())
        .columns(["start_strain", "end_strain"], |phase| phase.strain)
        .column("delta_tau_p", |phase| phase.change)
        .csv()
}

/// The number of the bin of a phase.
fn bin(phase: &Phase) -> i64 {
    (phase.change.abs().log10() * BINS).floor() as i64
}

/// Draws the number of stick and slip phases by |Δτ_p|, on logarithmic axes.
pub(crate) fn of_changes(phases: &[Phase]) -> String {
    let bins = phases.iter().map(bin);
    let (Some(first), Some(last)) = (bins.clone().min(), bins.max()) else {
        return figure(LAYOUT, [0.0, 1.0], [0.0, 1.0], |plot| {
            plot.empty_note("no phases");
            plot.axes(&[], &[], "|Δτ_{p}|", "number of phases");
        });
    };
    let kinds = [(PhaseKind::Stick, STICK), (PhaseKind::Slip, SLIP)].map(|(kind, colour)| {
        let mut counts = vec![0u64; (last - first + 1) as usize];
        for phase in phases.iter().filter(|phase| phase.kind == kind) {
            counts[(bin(phase) - first) as usize] += 1;
        }
        (counts, colour)
    });
    let most = kinds.iter().flat_map(|(counts, _)| counts).max();
    // Below log10(1) = 0, so that a bin with one phase is visible above an empty bin.
    let floor = -0.3;
    let x = [(first - 1) as f64 / BINS, (last + 2) as f64 / BINS];
    let y = [floor, most.map_or(0.0, |most| (*most as f64).log10()) + 0.2];
    figure(LAYOUT, x, y, |plot| {
        let (x_ticks, y_ticks) = (ticks::decades(x[0], x[1], 12), ticks::decades(0.0, y[1], 8));
        plot.grid(&x_ticks, &y_ticks);
        for (counts, colour) in &kinds {
            let mut stairs = vec![[first as f64 / BINS, floor]];
            for (k, &count) in counts.iter().enumerate() {
                let height = (count as f64).log10().max(floor);
                let left = (first + k as i64) as f64 / BINS;
                stairs.extend([[left, height], [left + 1.0 / BINS, height]]);
            }
            stairs.push([(last + 1) as f64 / BINS, floor]);
            plot.area(&stairs, *colour, 0.14);
            plot.line(&stairs, *colour, 2.0);
        }
        plot.clip();
        plot.axes(
            &x_ticks,
            &y_ticks,
            "change of the shear stress ratio in a phase, |Δτ_{p}|",
            "number of phases",
        );
        plot.legend(&[(STICK, "stick"), (SLIP, "slip")]);
    })
}
