//! Stick and slip phases: maximal monotone runs of τ (LH section 3.2).

use std::ops::Range;

use crate::moments::mean;

/// A phase is long if t_p exceeds this many intervals Δγ (LH section 3.3).
pub const LONG: usize = 3;

/// Kind of a phase.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PhaseKind {
    /// τ increases.
    Stick,
    /// τ decreases.
    Slip,
}

impl PhaseKind {
    /// Returns the name in tables: `stick` or `slip`.
    pub fn name(self) -> &'static str {
        match self {
            PhaseKind::Stick => "stick",
            PhaseKind::Slip => "slip",
        }
    }
}

/// A maximal monotone run of τ over the rows `start` … `end` of the series. The next phase starts
/// where this one ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Phase {
    /// First row.
    pub start: usize,
    /// Last row.
    pub end: usize,
    /// γ at the start and at the end.
    pub strain: [f64; 2],
    /// Δτ_p = τ(end) - τ(start).
    pub change: f64,
    /// Stick or slip.
    pub kind: PhaseKind,
}

impl Phase {
    /// The phase of these rows of τ(γ).
    fn between(strain: &[f64], tau: &[f64], rows: Range<usize>, kind: PhaseKind) -> Self {
        let (start, end) = (rows.start, rows.end - 1);
        Self {
            start,
            end,
            strain: [strain[start], strain[end]],
            change: tau[end] - tau[start],
            kind,
        }
    }

    /// Returns t_p in intervals Δγ of the series.
    pub fn duration(&self) -> usize {
        self.end - self.start
    }

    /// Returns t_p as a strain.
    pub fn duration_strain(&self) -> f64 {
        self.strain[1] - self.strain[0]
    }

    /// Returns whether t_p > 3Δγ.
    pub fn is_long(&self) -> bool {
        self.duration() > LONG
    }

    /// `long` or `short`, for tables.
    pub fn length_name(&self) -> &'static str {
        if self.is_long() { "long" } else { "short" }
    }
}

gshear_dem::columns! {
    /// Statistics of the phases of a stretch of a run. A mean without phases is NaN.
    pub struct PhaseStatistics {
        /// number of stick phases
        stick_phases: "1",
        /// number of slip phases
        slip_phases: "1",
        /// mean Δτ_p of the stick phases
        stick_change: "1",
        /// mean Δτ_p of the slip phases
        slip_change: "1",
        /// greatest |Δτ_p| of a slip phase; NaN if none
        largest_drop: "1",
    }
}

impl PhaseStatistics {
    /// Counts phases and takes their means.
    pub fn of(phases: &[Phase]) -> Self {
        let [stick, slip] = [PhaseKind::Stick, PhaseKind::Slip].map(|kind| -> Vec<f64> {
            let phases = phases.iter().filter(|phase| phase.kind == kind);
            phases.map(|phase| phase.change).collect()
        });
        Self {
            stick_phases: stick.len() as f64,
            slip_phases: slip.len() as f64,
            stick_change: mean(&stick),
            slip_change: mean(&slip),
            largest_drop: largest_drop(phases).map_or(f64::NAN, |phase| -phase.change),
        }
    }
}

/// Returns the first row from which on a regime counts: γ, which may return, has come to `onset`.
pub fn onset(strain: &[f64], onset: f64) -> usize {
    let first = strain.iter().position(|strain| *strain >= onset);
    first.unwrap_or(strain.len())
}

/// Returns the phases of τ(γ), both `[L]`. The interval of the rows is the Δγ in which t_p is
/// counted.
///
/// A plateau continues the phase before it; a plateau at the beginning joins the first phase. A
/// value that is not finite ends a phase and belongs to none. A stretch of constant τ has no phase.
pub fn find(strain: &[f64], tau: &[f64]) -> Vec<Phase> {
    let mut phases = Vec::new();
    let rows: Vec<usize> = (0..tau.len()).collect();
    for finite in rows.split(|&row| !tau[row].is_finite()) {
        if let [first, .., last] = finite {
            find_finite(strain, tau, *first..*last + 1, &mut phases);
        }
    }
    phases
}

/// The phases of rows with finite values.
fn find_finite(strain: &[f64], tau: &[f64], rows: Range<usize>, phases: &mut Vec<Phase>) {
    let mut start = rows.start;
    let mut kind = None;
    for k in rows.start + 1..rows.end {
        let now = if tau[k] < tau[k - 1] {
            PhaseKind::Slip
        } else if tau[k] > tau[k - 1] {
            PhaseKind::Stick
        } else {
            continue;
        };
        if let Some(before) = kind.replace(now)
            && before != now
        {
            phases.push(Phase::between(strain, tau, start..k, before));
            start = k - 1;
        }
    }
    if let Some(kind) = kind {
        phases.push(Phase::between(strain, tau, start..rows.end, kind));
    }
}

/// Returns the slip with the greatest loss of τ; the first one if several are equal.
pub fn largest_drop(phases: &[Phase]) -> Option<&Phase> {
    let slips = phases.iter().filter(|phase| phase.kind == PhaseKind::Slip);
    // Of equal ones `min_by` returns the first.
    slips.min_by(|a, b| a.change.total_cmp(&b.change))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// (start, end, Δτ_p, kind) of the phases of τ on γ = 0, 1, 2, …
    fn phases(tau: &[f64]) -> Vec<(usize, usize, f64, PhaseKind)> {
        let strain: Vec<f64> = (0..tau.len()).map(|k| k as f64).collect();
        let found = find(&strain, tau);
        for phase in &found {
            assert_eq!(phase.strain, [phase.start as f64, phase.end as f64]);
        }
        let all = found.iter();
        all.map(|p| (p.start, p.end, p.change, p.kind)).collect()
    }

    use PhaseKind::{Slip, Stick};

    #[test]
    fn phases_alternate_and_share_their_ends() {
        let (none, most) = (f64::NAN, f64::INFINITY);
        let alternating = [(0, 2, 3.0, Stick), (2, 4, -4.0, Slip), (4, 5, 1.0, Stick)];
        let plateaus = [(0, 5, 2.0, Stick), (5, 7, -1.0, Slip), (7, 9, 2.0, Stick)];
        let leading = [(0, 2, -1.0, Slip), (2, 3, 2.0, Stick)];
        let split = [(1, 2, 1.0, Stick), (4, 5, 1.0, Stick), (7, 8, -1.0, Slip)];
        for (tau, expected) in [
            (&[0.0, 1.0, 3.0, 2.0, -1.0, 0.0][..], &alternating[..]),
            // A plateau continues the phase before it: within a phase, at a maximum, at a minimum,
            // and at the end.
            (
                &[0.0, 1.0, 1.0, 2.0, 2.0, 2.0, 1.0, 1.0, 3.0, 3.0],
                &plateaus,
            ),
            // A leading one joins the first phase.
            (&[1.0, 1.0, 0.0, 2.0], &leading),
            // What is not finite splits.
            (&[none, 0.0, 1.0, none, 2.0, 3.0, most, 5.0, 4.0], &split),
            (&[], &[]),
            (&[1.0], &[]),
            (&[2.0, 2.0, 2.0], &[]),
            (&[0.0, -0.0], &[]),
            (&[none; 3], &[]),
        ] {
            assert_eq!(phases(tau), expected);
        }
    }

    #[test]
    fn long_is_more_than_three_intervals() {
        let tau = [0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0, -1.0, 0.0];
        let strain: Vec<f64> = (0..9).map(|k| 0.5 * f64::from(k)).collect();
        let found = find(&strain, &tau);
        let length = |p: &Phase| (p.duration(), p.duration_strain(), p.is_long());
        let lengths: Vec<_> = found.iter().map(length).collect();
        assert_eq!(lengths, [(3, 1.5, false), (4, 2.0, true), (1, 0.5, false)]);
    }

    #[test]
    fn the_largest_drop_is_the_first_of_the_deepest_slips() {
        let tau = [0.0, 2.0, 1.0, 9.0, 6.0, 7.0, 4.0];
        let strain = [0.0; 7];
        let drop = *largest_drop(&find(&strain, &tau)).expect("a slip");
        assert_eq!((drop.start, drop.end), (3, 4));
        assert!(largest_drop(&find(&strain, &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0])).is_none());
    }
}
