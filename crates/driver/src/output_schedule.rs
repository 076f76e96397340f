//! The steps at which the stages write output.

use gshear_scene::schedule::{ReplayWindow, STEPS_WITHOUT_A_PAIR, Schedule};
use gshear_scene::{Aqs, Newtonian};

use crate::header::Pair;

/// The output that is due after a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct DueOutput {
    /// A row of the time series.
    pub row: bool,
    /// A frame.
    pub frame: bool,
    /// The scalars of a frame, whether or not it is written.
    pub scalars: bool,
}

impl DueOutput {
    /// Whether anything is due.
    pub(crate) fn any(self) -> bool {
        self.row || self.takes_frame()
    }

    /// Whether a frame is taken, to be written or analysed.
    pub(crate) fn takes_frame(self) -> bool {
        self.frame || self.scalars
    }
}

/// The steps at which a stage writes output.
pub(crate) trait OutputSchedule {
    /// Number of steps of the stage, or up to the end of the window of a replay.
    fn steps(&self) -> u64;

    /// The output that is due after a step.
    fn due(&self, step: u64) -> DueOutput;

    /// Whether the eigenvalues are due after a step.
    fn spectrum_due(&self, _step: u64) -> bool {
        false
    }
}

impl OutputSchedule for Schedule {
    fn steps(&self) -> u64 {
        self.total
    }

    fn due(&self, step: u64) -> DueOutput {
        DueOutput {
            row: self.series_due(step),
            frame: self.frame_due(step),
            scalars: self.analysis_due(step),
        }
    }
}

/// The output of strain steps: a row after each, frames, and eigenvalues if they are asked for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StrainSchedule {
    steps: u64,
    /// Strain steps between frames; 0 is never.
    frames: u64,
    spectrum: bool,
}

impl StrainSchedule {
    pub(crate) fn new(aqs: &Aqs) -> Self {
        Self {
            steps: aqs.steps,
            frames: aqs.frame_every,
            spectrum: aqs.spectrum,
        }
    }

    /// The output after the last strain step, which may come before that of the schedule.
    pub(crate) fn due_at_end(&self, step: u64) -> DueOutput {
        DueOutput {
            frame: self.frames > 0,
            ..self.due(step)
        }
    }

    /// Number of frames up to a strain step.
    pub(crate) fn frames_up_to(&self, step: u64) -> u64 {
        match self.frames {
            0 => 0,
            // Also of the last state.
            every if step == self.steps => step.div_ceil(every) + 1,
            every => step / every + 1,
        }
    }
}

impl OutputSchedule for StrainSchedule {
    fn steps(&self) -> u64 {
        self.steps
    }

    fn due(&self, step: u64) -> DueOutput {
        let is_last = step >= self.steps;
        DueOutput {
            row: true,
            frame: self.frames > 0 && (step.is_multiple_of(self.frames) || is_last),
            scalars: false,
        }
    }

    fn spectrum_due(&self, _step: u64) -> bool {
        self.spectrum
    }
}

/// The output of Newton's equations. An interval longer than the stage disables an output.
pub(crate) struct NewtonianSchedule {
    /// Number of steps of the stage, or up to the end of the window.
    steps: u64,
    /// The last step of the stage, which is always written.
    last: u64,
    rows: u64,
    frames: u64,
    spectra: u64,
    dense: Option<Dense>,
    /// The window of a replay.
    window: Option<ReplayWindow>,
}

/// Number of steps of Δt `step` of Newton's equations.
pub(crate) fn steps_of_newtonian(newtonian: &Newtonian, pair: Option<&Pair>, step: f64) -> u64 {
    match pair {
        Some(pair) => (newtonian.growth_times / pair.omega_i / step).ceil() as u64,
        None => (newtonian.growth_times * STEPS_WITHOUT_A_PAIR).ceil() as u64,
    }
}

/// The interval at which an output is written `count` times in so many steps.
fn interval(steps: u64, count: u64) -> u64 {
    steps
        .checked_div(count)
        .map_or(u64::MAX, |every| every.max(1))
}

impl NewtonianSchedule {
    pub(crate) fn new(newtonian: &Newtonian, pair: Option<&Pair>, step: f64) -> Self {
        let steps = steps_of_newtonian(newtonian, pair, step);
        let dense = pair.map(|pair| Dense::new(pair, step));
        let frames = match (pair, interval(steps, newtonian.frames)) {
            (Some(pair), wanted) if wanted != u64::MAX => strobe(pair, wanted, step),
            (_, wanted) => wanted,
        };
        // All rows lie at multiples of the interval of the dense rows, so that none falls between
        // two of them.
        let grid = dense.as_ref().map_or(1, |dense| dense.every);
        let rows = interval(steps, newtonian.rows);
        Self {
            steps,
            last: steps,
            rows: rows.div_ceil(grid).saturating_mul(grid),
            frames,
            spectra: interval(steps, newtonian.spectra),
            dense,
            window: None,
        }
    }

    /// Restricts the stage to the end of a replay window, with frames in the window.
    pub(crate) fn restricted_to(mut self, window: ReplayWindow) -> Self {
        self.steps = self.steps.min(window.last);
        self.spectra = u64::MAX;
        self.window = Some(window);
        self
    }

    /// Whether eigenvalues are written at all.
    pub(crate) fn has_spectra(&self) -> bool {
        self.spectra != u64::MAX
    }

    fn row_due(&self, step: u64) -> bool {
        let dense = self.dense.as_ref();
        step.is_multiple_of(self.rows)
            || dense.is_some_and(|dense| dense.due(step))
            || self.is_last(step, self.rows)
    }

    fn frame_due(&self, step: u64) -> bool {
        match self.window {
            Some(window) if step < window.first => false,
            Some(ReplayWindow {
                first,
                every: Some(every),
                ..
            }) => (step - first).is_multiple_of(every),
            Some(_) => self.row_due(step),
            None => step.is_multiple_of(self.frames) || self.is_last(step, self.frames),
        }
    }

    /// Whether a step is the last of the stage, and an output of this interval is written.
    fn is_last(&self, step: u64, every: u64) -> bool {
        step == self.last && every != u64::MAX
    }
}

impl OutputSchedule for NewtonianSchedule {
    fn steps(&self) -> u64 {
        self.steps
    }

    fn due(&self, step: u64) -> DueOutput {
        DueOutput {
            row: self.row_due(step),
            frame: self.frame_due(step),
            scalars: false,
        }
    }

    fn spectrum_due(&self, step: u64) -> bool {
        self.has_spectra() && step.is_multiple_of(self.spectra)
    }
}

/// Steps between frames: about `wanted`, adjusted to whole periods of the pair plus 1/24 of a
/// period, so that the sequence of frames shows the oscillation in slow motion.
fn strobe(pair: &Pair, wanted: u64, step: f64) -> u64 {
    let period = std::f64::consts::TAU / pair.omega_r / step;
    let whole = (wanted as f64 / period).round();
    ((whole + 1.0 / 24.0) * period).round().max(1.0) as u64
}

/// Stretches of rows dense enough to resolve the oscillation of the pair: one at the start of each
/// time 1/ω_i in which it grows by e, so that some lie in the growth whenever it ends.
///
/// They depend on the pair and on Δt only: a longer stage has the same ones.
struct Dense {
    /// Steps between the starts of two stretches.
    spacing: u64,
    length: u64,
    every: u64,
}

impl Dense {
    /// Periods of the mean square displacement, π/ω_r, in a stretch, and rows per period.
    const PERIODS: f64 = 20.0;
    const ROWS: f64 = 16.0;
    /// Times 1/ω_i with a stretch. From the rounding of positions, 1e-17 d̄, to the end of the
    /// linear growth, 1e-5 d̄, a pair needs 28.
    const GROWTH_TIMES: u64 = 40;

    fn new(pair: &Pair, step: f64) -> Self {
        let period = std::f64::consts::PI / pair.omega_r / step;
        let every = ((period / Self::ROWS) as u64).max(1);
        let growth_time = (pair.omega_i * step).recip() as u64;
        Self {
            spacing: (growth_time / every).max(1) * every,
            length: (Self::PERIODS * period) as u64,
            every,
        }
    }

    fn due(&self, step: u64) -> bool {
        (1..=Self::GROWTH_TIMES).contains(&(step / self.spacing))
            && step.is_multiple_of(self.every)
            && step % self.spacing <= self.length
    }

    /// Number of dense rows up to a step, at most.
    fn count(&self, step: u64) -> u64 {
        let stretches = (step / self.spacing).min(Self::GROWTH_TIMES);
        stretches * (self.length.min(self.spacing) / self.every + 1)
    }
}

/// Number of rows of Newton's equations beside those at equal intervals, at most, up to a step.
pub(crate) fn dense_rows(pair: Option<&Pair>, time_step: f64, step: u64) -> u64 {
    pair.map_or(0, |pair| Dense::new(pair, time_step).count(step))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// However long the stage, the oscillation is resolved in each 1/ω_i until the growth must have
    /// ended, by rows that no other row falls between.
    #[test]
    fn rows_are_dense_while_the_pair_grows() {
        let pair = Pair {
            lambda_r: 1.235,
            lambda_i: 2e-3,
            omega_r: 1.1113,
            omega_i: 1e-3,
        };
        let time_step = 0.02;
        let of_length = |growth_times: f64| {
            let newtonian = Newtonian {
                growth_times,
                rows: 500,
                frames: 0,
                spectra: 0,
            };
            NewtonianSchedule::new(&newtonian, Some(&pair), time_step)
        };
        let period = std::f64::consts::PI / pair.omega_r / time_step;
        let growth_time = (pair.omega_i * time_step).recip();
        for growth_times in [22.0, 44.0, 100.0] {
            let schedule = of_length(growth_times);
            let rows: Vec<u64> = (0..=schedule.steps())
                .filter(|k| schedule.row_due(*k))
                .collect();
            for n in 1..21 {
                let [begin, end] = [n, n + 1].map(|n| (f64::from(n) * growth_time) as u64);
                let within = rows.iter().filter(|row| (begin..end).contains(row));
                let within: Vec<u64> = within.copied().collect();
                let gaps = within.windows(2).map(|pair| (pair[1] - pair[0]) as f64);
                let dense = gaps.clone().filter(|gap| *gap <= period / 15.9).count();
                assert!(dense >= 300, "{growth_times}, {n}: {dense} dense rows");
                let least = gaps.fold(f64::INFINITY, f64::min);
                assert!(least > period / 20.0, "{growth_times}, {n}: {least}");
            }
            let regular = rows
                .iter()
                .filter(|row| row.is_multiple_of(schedule.rows))
                .count();
            let dense = rows.len() - regular - 1;
            let estimate = dense_rows(Some(&pair), time_step, schedule.steps()) as usize;
            assert!(
                dense <= estimate && estimate < dense + 600,
                "{dense} {estimate}"
            );
        }
        let dense = |growth_times| of_length(growth_times).dense.expect("a pair");
        let [short, long] = [22.0, 100.0].map(dense);
        assert!((0..100_000).all(|step| short.due(step) == long.due(step)));
    }
}
