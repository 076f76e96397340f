//! Settings on which the speed of a run depends, and none of its bits: while it goes on, others are
//! tried in turns with the present ones, and the fastest are kept.
//!
//! Times of a shared machine scatter by more than settings differ, so a time is only compared with
//! that of the turn before it. Another setting that was slower in `LOSSES` pairs of turns is
//! dropped; one that was faster in `WINS` pairs before is kept, if its median gain is `LEAST_GAIN`,
//! and then all are tried again. Between two rounds the run rests for `REST` times as many turns as
//! the first took, so that trials of slow settings cost little.

use serde::{Deserialize, Serialize};

use crate::contact::CHUNK;
use crate::domain::Exchange;
use crate::simd::Isa;

/// Pairs of turns in which another setting must have been faster to be kept, and slower to be
/// dropped.
const WINS: usize = 9;
const LOSSES: usize = 3;
/// Median time of the present setting over that of another one that is worth a change.
const LEAST_GAIN: f64 = 1.02;
/// Turns before the first round, in which caches fill and the skin adapts.
const WARM_UP: u32 = 8;
/// Turns between rounds, over those of a round.
const REST: u32 = 50;
/// Time of a turn of passes (s), and its steps: before that is known, and at most.
const TURN: f64 = 2e-3;
const FIRST_TURN: u64 = 16;
const LONGEST_TURN: f64 = 1e4;
/// Steps between rebuilds before anything was tried: a rebuild costs about as much as ten steps.
const LIFE: f64 = 600.0;

/// What can be tried.
trait Tunable: Copy + PartialEq {
    /// The k-th variation of this setting, which may be itself.
    fn variation(self, k: usize) -> Self;
}

/// How a pass over the contacts works.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassSettings {
    /// The instruction set.
    pub isa: Isa,
    /// What may change while a run goes on.
    pub choice: PassChoice,
}

/// What is tried of the passes, the same on every rank.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PassChoice {
    /// Blocks at a time, up to [`CHUNK`].
    pub blocks: usize,
    /// Whether the next blocks are prefetched; `None`: if the records fill a cache.
    pub prefetch: Option<bool>,
    /// AVX2 instead of AVX-512.
    pub narrow: bool,
    /// Steps that follow each other through the bands; `None`: there is one band, or the scene says
    /// how many.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steps: Option<u64>,
}

impl Default for PassChoice {
    /// What is right for most processors.
    fn default() -> Self {
        Self {
            blocks: 4,
            prefetch: None,
            narrow: false,
            steps: None,
        }
    }
}

/// Number of variations of a [`PassChoice`].
const VARIATIONS: usize = 10;
/// The steps that follow each other at first, and at most.
const STEPS: u64 = 8;
const MOST_STEPS: u64 = 16;

impl Tunable for PassChoice {
    fn variation(self, k: usize) -> Self {
        match k {
            0..5 => Self {
                blocks: [2, 3, 4, 6, 8][k],
                ..self
            },
            5..7 => Self {
                prefetch: Some(k == 6),
                ..self
            },
            7 => Self {
                steps: self.steps.map(|steps| (2 * steps).min(MOST_STEPS)),
                ..self
            },
            8 => Self {
                steps: self.steps.map(|steps| (steps / 2).max(1)),
                ..self
            },
            // Last, so that it is left out where the scene gives the instruction set.
            _ => Self {
                narrow: !self.narrow,
                ..self
            },
        }
    }
}

/// Steps between rebuilds at which the skin aims.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Life(f64);

impl Life {
    fn new(steps: f64) -> Self {
        Self(steps.clamp(0.5 * LIFE, 4.0 * LIFE))
    }
}

impl Tunable for Life {
    fn variation(self, k: usize) -> Self {
        Self::new(self.0 * [1.5, 1.0 / 1.5][k])
    }
}

/// Tries other settings in turns with the present one.
#[derive(Debug)]
struct Tuner<S> {
    /// The setting of this turn.
    now: S,
    /// The fastest so far.
    kept: S,
    /// Number of variations.
    count: usize,
    /// The variation that is tried, or the next one.
    tried: usize,
    /// Time per step of the first turn of a pair (s).
    first: Option<f64>,
    /// Times of the kept setting over those of the other one, by pairs of turns.
    gains: Vec<f64>,
    /// Whether one was kept since the first variation was tried.
    changed: bool,
    /// Turns of this round, and turns until the next one.
    turns: u32,
    rest: u32,
    /// How many settings were tried so far, and kept.
    trials: u32,
    changes: u32,
}

impl<S: Tunable> Tuner<S> {
    fn new(setting: S, count: usize) -> Self {
        Self {
            now: setting,
            kept: setting,
            count,
            tried: 0,
            first: None,
            gains: Vec::new(),
            changed: false,
            turns: 0,
            rest: WARM_UP,
            trials: 0,
            changes: 0,
        }
    }

    /// Ends a turn that took this time per step, and begins the next.
    fn turn(&mut self, seconds: f64) {
        if self.rest > 0 {
            self.rest -= 1;
            if self.rest == 0 {
                self.begin(0);
            }
            return;
        }
        self.turns += 1;
        let other = self.kept.variation(self.tried);
        let Some(first) = self.first.take() else {
            self.first = Some(seconds);
            self.now = if self.now == self.kept {
                other
            } else {
                self.kept
            };
            return;
        };
        // The second turn of a pair is of the same setting as the first of the next: what changes
        // slowly favours each setting in every second pair.
        let gain = if self.now == other {
            first / seconds
        } else {
            seconds / first
        };
        self.gains.push(gain);
        let wins = self.gains.iter().filter(|gain| **gain > 1.0).count();
        if wins == WINS {
            self.gains.sort_unstable_by(f64::total_cmp);
            if self.gains[self.gains.len() / 2] >= LEAST_GAIN {
                self.kept = other;
                self.changes += 1;
                self.changed = true;
            }
            self.begin(self.tried + 1);
        } else if self.gains.len() - wins == LOSSES {
            self.begin(self.tried + 1);
        }
    }

    /// Tries the first variation from the k-th on that is another setting; after the last one all
    /// of them again if one was kept, else rests.
    fn begin(&mut self, k: usize) {
        self.gains.clear();
        self.now = self.kept;
        let is_other = |k: &usize| self.kept.variation(*k) != self.kept;
        if let Some(tried) = (k..self.count).find(is_other) {
            self.tried = tried;
            self.trials += 1;
        } else if std::mem::take(&mut self.changed) {
            self.begin(0);
        } else {
            self.rest = REST * self.turns.max(1);
            self.turns = 0;
        }
    }

    /// Changes the setting without measuring anything.
    fn change(&mut self) {
        self.trials += 1;
        self.tried = (self.tried + 1) % self.count;
        self.now = self.now.variation(self.tried);
    }
}

/// Whether settings are tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Tune {
    /// They stay as they are.
    #[default]
    Never,
    /// They are tried in turns.
    InTurns,
    /// They change every so many steps, and with every list, whatever is faster: for tests.
    Every(u64),
}

/// Which settings a run tries.
#[derive(Debug, Clone, Copy, Default)]
pub struct Plan {
    /// Whether they are tried.
    pub tune: Tune,
    /// Whether the instruction set stays.
    pub isa_is_given: bool,
    /// The settings with which the run begins.
    pub tuned: Option<Tuned>,
}

/// The settings of a run as it tries them, the same on every rank: ranks wait for the slowest, so
/// they try together, and the time of a turn is that of the slowest.
#[derive(Debug)]
pub struct Tuning {
    tune: Tune,
    /// The instruction set, and with [`PassChoice::narrow`].
    isas: [Isa; 2],
    passes: Tuner<PassChoice>,
    lists: Tuner<Life>,
    /// Steps of a turn, and of the present one so far.
    turn: u64,
    steps: u64,
    /// Seconds of computing before this turn.
    worked: f64,
}

/// Settings of a run, for one that goes on with it on another day.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tuned {
    passes: PassChoice,
    list_steps: f64,
}

impl Tuning {
    /// Begins with the settings of the plan; `isa`: the instruction set of this rank.
    pub fn new(plan: Plan, isa: Isa) -> Self {
        let known = match plan.tune {
            Tune::Never => None,
            _ => plan.tuned,
        };
        let mut choice = known.map_or_else(PassChoice::default, |tuned| tuned.passes);
        choice.blocks = choice.blocks.clamp(1, CHUNK);
        choice.narrow &= !plan.isa_is_given;
        let life = Life::new(known.map_or(LIFE, |tuned| tuned.list_steps));
        Self {
            tune: plan.tune,
            isas: [isa, isa.narrower()],
            passes: Tuner::new(choice, VARIATIONS - usize::from(plan.isa_is_given)),
            lists: Tuner::new(life, 2),
            turn: FIRST_TURN,
            steps: 0,
            worked: 0.0,
        }
    }

    /// Begins a turn anew, by a clock that begins anew.
    pub(crate) fn restart(&mut self) {
        (self.steps, self.worked) = (0, 0.0);
    }

    /// The grains have bands, through which as many steps may follow each other as is fastest, or
    /// have none.
    pub(crate) fn set_bands(&mut self, has_bands: bool) {
        let steps = self.passes.kept.steps;
        if has_bands != steps.is_some() {
            let steps = has_bands.then_some(STEPS);
            self.passes.kept.steps = steps;
            self.passes.now.steps = steps;
        }
    }

    /// How the next pass works.
    pub fn passes(&self) -> PassSettings {
        let choice = self.passes.now;
        PassSettings {
            isa: self.isas[usize::from(choice.narrow)],
            choice,
        }
    }

    /// Steps for which the next list is to last.
    pub(crate) fn life(&self) -> f64 {
        self.lists.now.0
    }

    /// Ends so many steps. `worked`: [`Clock::worked`](crate::clock::Clock::worked). Collective.
    pub fn end_steps(&mut self, exchange: &dyn Exchange, steps: u64, worked: f64) {
        self.steps += steps;
        match self.tune {
            Tune::Never => return,
            Tune::Every(steps) if self.steps < steps => return,
            Tune::Every(_) => self.passes.change(),
            Tune::InTurns if self.steps < self.turn => return,
            Tune::InTurns => {
                let mut seconds = (worked - self.worked) / self.steps as f64;
                if self.passes.rest <= 1 {
                    seconds = exchange.maximum(seconds);
                }
                if self.passes.rest == 1 {
                    self.turn = (TURN / seconds).ceil().clamp(1.0, LONGEST_TURN) as u64;
                }
                self.passes.turn(seconds);
            }
        }
        (self.steps, self.worked) = (0, worked);
    }

    /// Ends the life of a list. `seconds`: those of its making and of the computing with it, per
    /// step. Collective.
    pub(crate) fn end_list(&mut self, exchange: &dyn Exchange, seconds: f64) {
        match self.tune {
            Tune::Never => {}
            Tune::InTurns => self.lists.turn(exchange.maximum(seconds)),
            Tune::Every(_) => self.lists.change(),
        }
    }

    /// What was kept, unless it is what a run begins with anyway.
    pub fn tuned(&self) -> Option<Tuned> {
        let (passes, life) = (self.passes.kept, self.lists.kept);
        let is_changed = (passes, life) != (PassChoice::default(), Life::new(LIFE));
        is_changed.then_some(Tuned {
            passes,
            list_steps: life.0,
        })
    }
}

impl std::fmt::Display for Tuning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let PassChoice {
            blocks,
            prefetch,
            narrow,
            steps,
        } = self.passes.kept;
        let prefetching = match prefetch {
            None => "prefetch beyond a cache",
            Some(true) => "prefetch",
            Some(false) => "no prefetch",
        };
        let (name, life) = (self.isas[usize::from(narrow)].name(), self.lists.kept.0);
        let tried = self.passes.trials + self.lists.trials;
        let changes = self.passes.changes + self.lists.changes;
        let at_once = steps.map_or_else(String::new, |steps| format!("{steps} steps at once, "));
        write!(
            f,
            "settings: {name}, {blocks} blocks at a time, {at_once}{prefetching}, lists of {life:.0} steps; {tried} others tried, {changes} kept",
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Solo;

    /// Seconds per step of a setting, on a machine that slows down and is disturbed now and then.
    fn seconds(blocks: usize, turn: u32) -> f64 {
        let of_setting = [(2, 1.1), (3, 1.0), (4, 1.0), (6, 0.9), (8, 0.97)];
        let (_, seconds) = of_setting[of_setting
            .iter()
            .position(|setting| setting.0 == blocks)
            .unwrap()];
        let disturbed = if turn % 11 == 3 { 3.0 } else { 1.0 };
        seconds * disturbed * (1.0 + 1e-3 * f64::from(turn))
    }

    #[test]
    fn the_fastest_setting_is_kept_on_a_machine_that_slows_down() {
        let mut tuner = Tuner::new(PassChoice::default(), 5);
        let mut tried = Vec::new();
        for turn in 0..200 {
            tuner.turn(seconds(tuner.now.blocks, turn));
            tried.push(tuner.now.blocks);
        }
        assert_eq!(tuner.kept.blocks, 6);
        assert!([2, 3, 4, 6, 8].iter().all(|blocks| tried.contains(blocks)));
        assert_eq!(tuner.now, tuner.kept, "it rests");
        assert_eq!((tuner.trials, tuner.changes), (8, 1));
    }

    #[test]
    fn equal_settings_stay() {
        let start = PassChoice::default();
        let mut tuner = Tuner::new(start, VARIATIONS);
        for turn in 0..2000_u32 {
            tuner.turn(1.0 + 0.01 * f64::from(turn * 7919 % 13));
        }
        assert_eq!((tuner.kept, tuner.changes), (start, 0));
    }

    /// A stage may begin the clock anew: the turn that then ends is as long as it was.
    #[test]
    fn a_turn_survives_a_clock_that_begins_anew() {
        let plan = Plan {
            tune: Tune::InTurns,
            ..Plan::default()
        };
        let mut tuning = Tuning::new(plan, Isa::Portable);
        let before_the_last = u64::from(WARM_UP - 1) * FIRST_TURN;
        (1..=before_the_last).for_each(|k| tuning.end_steps(&Solo, 1, k as f64));
        tuning.restart();
        (1..=FIRST_TURN).for_each(|k| tuning.end_steps(&Solo, 1, 3e-4 * k as f64));
        assert_eq!(tuning.turn, 7, "2 ms of steps of 0.3 ms");
    }

    #[test]
    fn a_run_begins_with_what_it_knows() {
        let known = |narrow| PassChoice {
            blocks: CHUNK,
            prefetch: Some(true),
            narrow,
            steps: None,
        };
        let begun = |isa_is_given, tune| {
            let passes = PassChoice {
                blocks: 100,
                ..known(true)
            };
            let plan = Plan {
                tune,
                isa_is_given,
                tuned: Some(Tuned {
                    passes,
                    list_steps: 900.0,
                }),
            };
            let tuning = Tuning::new(plan, Isa::detect());
            (tuning.passes(), tuning.life())
        };
        let settings = |isa, choice| PassSettings { isa, choice };
        let best = Isa::detect();
        let narrower = settings(best.narrower(), known(true));
        let fixed = settings(best, PassChoice::default());
        assert_eq!(begun(false, Tune::InTurns), (narrower, 900.0));
        assert_eq!(
            begun(true, Tune::InTurns),
            (settings(best, known(false)), 900.0)
        );
        assert_eq!(begun(true, Tune::Never), (fixed, LIFE));
    }
}
