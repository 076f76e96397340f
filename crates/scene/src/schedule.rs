//! When what happens, in whole steps. Intervals of output are rounded to steps and never reach the
//! trajectory.

use crate::derived::packed_height;
use crate::load::{Control, Load};
use crate::output::Output;
use crate::protocol::{Motion, WallSpeed};
use crate::scene::Scene;
use crate::walls::PlaneShear;
use gshear_dem::boundary::FurtherColumns;
use gshear_dem::columns::{Column, kept};
use gshear_dem::dimension::Dimensions;
use gshear_dem::protocol::{Along, Imposed, Normal, Part, Protocol, Ramp};
use gshear_dem::until::Until;

/// Steps of a stage that are counted: 2^53, up to which f64 has every whole number.
pub const MOST_STEPS: u64 = 1 << 53;

/// Newton's equations of a box without a complex pair: steps that stand for its growth time.
pub const STEPS_WITHOUT_A_PAIR: f64 = 1000.0;

/// The shear stage in steps of Δt.
#[derive(Debug, Clone, PartialEq)]
pub struct Schedule {
    /// Δt (s).
    pub step: f64,
    /// H (m): height of the sheared layer at the start, to which strains refer.
    pub height: f64,
    /// How the drive moves.
    pub protocol: Protocol,
    /// One for each segment of the protocol.
    pub intervals: Vec<Intervals>,
    /// The conditions that end each part of a protocol.
    conditions: Vec<Option<Until>>,
    /// I/γ̇ (s).
    inertial_time: f64,
    /// Steps of the stage.
    pub total: u64,
    /// Step of the first frame.
    pub first_frame: u64,
    /// First frame that is analysed.
    pub first_analysis: u64,
    /// Every so many steps; 0 is never.
    pub progress: u64,
    /// Columns of the time series, those of the scene last.
    pub columns: &'static [Column],
    /// The places among them of the columns of `log.csv`.
    pub log_columns: Vec<usize>,
    /// Which further ones are among them.
    pub further: FurtherColumns,
    /// Frames of a stretch that is computed again, instead of the segments'.
    window: Option<ReplayWindow>,
}

/// The part of the shear that a replay computes again: frames of the steps `first`, `first` +
/// `every`, … up to `last`, where it ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReplayWindow {
    /// Step of the first frame.
    pub first: u64,
    /// The last step.
    pub last: u64,
    /// Steps between frames. `None`: a frame with every row of the time series.
    pub every: Option<u64>,
}

/// How often something is written during a segment of the protocol. The k-th time is at the step
/// nearest to k intervals after the start of the segment, so that rounding to steps does not add
/// up.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Interval {
    /// Steps of a unit at the full speed of the drive, at least 1; 0 is never.
    unit: f64,
    /// Units of the interval: those of frames are rows, so that each frame has a row.
    units: u64,
    /// How the drive comes to its full speed.
    pace: Pace,
}

/// How the drive of a segment comes to its speed: along a ramp of this many steps, or at once.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Pace {
    ramp: f64,
}

impl Pace {
    /// Steps in which the drive moves as far as in `full` steps of its full speed: a ramp of r
    /// steps is r/2 steps behind at its end.
    fn steps(self, full: f64) -> f64 {
        if full >= 0.5 * self.ramp {
            full + 0.5 * self.ramp
        } else {
            (2.0 * self.ramp * full).sqrt()
        }
    }

    /// The inverse of [`Pace::steps`].
    fn full_steps(self, steps: f64) -> f64 {
        if steps >= self.ramp {
            steps - 0.5 * self.ramp
        } else {
            0.5 * steps * (steps / self.ramp)
        }
    }
}

/// What is written during a segment of the protocol.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Intervals {
    /// Frames.
    pub frames: Interval,
    /// Frames whose scalars are computed.
    pub analysis: Interval,
    /// Rows of the time series.
    pub series: Interval,
    /// Checkpoints.
    pub checkpoints: Interval,
    /// Checks of the conditions that end the segment.
    pub checks: Interval,
}

/// How often something is written in a whole stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Counts {
    /// Frames.
    pub frames: u64,
    /// Rows of the time series.
    pub rows: u64,
    /// Checkpoints.
    pub checkpoints: u64,
}

/// I, the inertial number of the literature: of disks γ̇ √(m̄/P) with m̄ per depth (da Cruz et al.,
/// Phys. Rev. E 72, 021309, 2005), of spheres γ̇ d̄ √(ρ/P) (GDR MiDi, Eur. Phys. J. E 14, 341,
/// 2004).
pub fn definition_of_inertial_number(dimension: Dimensions) -> &'static str {
    match dimension {
        Dimensions::Two => "γ̇ √(m̄/P)",
        Dimensions::Three => "γ̇ d̄ √(ρ/P)",
    }
}

/// I/γ̇ (s): √(m̄/P), in three dimensions d̄ √(ρ/P) with ρ = m̄ over the mean volume.
fn inertial_time(scene: &Scene, load: &Load) -> f64 {
    let sample = &scene.sample;
    let per_volume = sample.by_dimension(1.0, sample.mean_section() / sample.mean_volume);
    (mean_mass(scene) / load.pressure * per_volume).sqrt()
}

/// √(m̄/P) (s), in three dimensions √(m̄/(P d̄)): the time in which P moves a mean grain, by which
/// the packing is damped.
pub fn packing_time(scene: &Scene, load: &Load) -> f64 {
    let sample = &scene.sample;
    let per_section = sample.mean_diameter / sample.mean_section();
    (mean_mass(scene) / load.pressure * per_section).sqrt()
}

/// m̄ = ρπ⟨R²⟩ (kg/m), in three dimensions (4/3)πρ⟨R³⟩ (kg), with ρ of the first material; or the
/// mass that all have.
pub fn mean_mass(scene: &Scene) -> f64 {
    scene.materials.masses.of(0, scene.sample.mean_volume)
}

/// A guess how many steps the packing takes: the top falls through loose layers, then waves and the
/// rest of the grains' motion decay. Right within a factor of about three.
pub fn packing_steps(scene: &Scene, load: &Load) -> f64 {
    let layers = packed_height(&scene.sample) / scene.sample.mean_diameter;
    let times = layers * (1.0 + 0.2 * layers);
    times * packing_time(scene, load) / scene.time_step.step
}

/// How strain grows at a constant speed of the drive.
struct StrainRate {
    /// The full speed (m/s).
    speed: f64,
    /// γ of a step at the full speed.
    per_step: f64,
    pace: Pace,
}

impl StrainRate {
    /// Steps after which γ is reached. During a ramp strains take longer than at the full speed.
    fn steps(&self, strain: f64) -> u64 {
        whole(self.pace.steps(strain / self.per_step))
    }

    fn interval(&self, strain: f64) -> Interval {
        Interval::of_steps(strain / self.per_step, self.pace)
    }

    /// Frames and rows of the time series meet wherever their intervals as strains do.
    fn interval_of_frames(&self, strain: f64, output: &Output) -> Interval {
        match output.rows_in(strain) {
            Some(rows) if output.series_strain >= self.per_step => {
                self.interval(output.series_strain).times(rows)
            }
            _ => self.interval(strain),
        }
    }
}

/// What the drive does and what is written.
struct Plan {
    protocol: Protocol,
    intervals: Vec<Intervals>,
    conditions: Vec<Option<Until>>,
    first_frame: u64,
    first_analysis: u64,
}

impl Plan {
    /// At one rate to this γ.
    fn of_strain(scene: &Scene, walls: &PlaneShear, rate: &StrainRate, strain: f64) -> Self {
        let output = &walls.output;
        let along = if rate.pace.ramp > 0.0 {
            Along::Ramp(Ramp {
                from: 0.0,
                to: rate.speed,
                time: rate.pace.ramp,
            })
        } else {
            Along::Velocity(rate.speed)
        };
        let is_constant_volume = walls.load.control == Control::Volume;
        let imposed = Imposed {
            normal: is_constant_volume.then_some(Normal::Velocity(0.0)),
            ..along.into()
        };
        let mut intervals = Intervals {
            frames: rate.interval_of_frames(output.frame_strain, output),
            checkpoints: rate.interval(output.checkpoint_strain),
            series: rate.interval(output.series_strain),
            ..Intervals::default()
        };
        let first_frame = output.frame_start / rate.per_step;
        let first_frame = intervals.frames.nearest(first_frame);
        let mut first_analysis = 0;
        if walls.analysis.scalars {
            intervals.analysis = rate.interval_of_frames(walls.analysis.strain, output);
            let first = walls.analysis.start / rate.per_step;
            first_analysis = intervals.analysis.nearest(first);
        }
        Self {
            protocol: Protocol::of(scene.time_step.step, [(imposed, rate.steps(strain))]),
            intervals: vec![intervals],
            conditions: vec![None],
            first_frame,
            first_analysis,
        }
    }

    /// Through these parts. `height` (m): of the layer.
    fn of_parts(scene: &Scene, output: &Output, height: f64, parts: &[Part]) -> Self {
        let step = scene.time_step.step;
        let base = scene.sample.base();
        let segments = parts.iter().map(|part| {
            let imposed = part.on_layer(height, base, step);
            (imposed, whole(part.time / step))
        });
        let protocol = Protocol::of(step, segments);
        let segments = protocol.segments().iter().zip(parts);
        let intervals = segments.map(|(segment, part)| Intervals {
            frames: Interval::dividing(segment.steps, output.frame_rows),
            analysis: Interval::default(),
            series: Interval::dividing(segment.steps, output.series_rows),
            checkpoints: Interval::dividing(segment.steps, 1),
            checks: Interval::dividing(segment.steps, part.until.map_or(0, |until| until.checks)),
        });
        Self {
            intervals: intervals.collect(),
            conditions: parts.iter().map(|part| part.until).collect(),
            protocol,
            first_frame: 0,
            first_analysis: 0,
        }
    }
}

/// The columns of the time series.
fn columns(walls: &PlaneShear, further: FurtherColumns) -> &'static [Column] {
    let of_program = walls.boundary.series_columns(further);
    if walls.observables.is_empty() {
        return of_program;
    }
    let own = walls.observables.iter().map(|own| own.column);
    let all: Vec<Column> = of_program.iter().copied().chain(own).collect();
    kept(&all)
}

/// The places of the columns of `log.csv` among those of the time series.
fn log_columns(walls: &PlaneShear, columns: &[Column]) -> Vec<usize> {
    let all = 0..columns.len();
    match &walls.log_columns {
        None => all.collect(),
        Some(chosen) => {
            let place = |name: &&str| all.clone().find(|place| columns[*place].name == *name);
            chosen.iter().filter_map(place).collect()
        }
    }
}

impl Schedule {
    /// The schedule of a scene between walls whose sheared layer is `height` (m) high at the start.
    pub fn new(scene: &Scene, walls: &PlaneShear, height: f64) -> Self {
        let step = scene.time_step.step;
        let output = &walls.output;
        let inertial_time = inertial_time(scene, &walls.load);
        let plan = match &walls.shear.motion {
            Motion::Strain {
                drive,
                ramp,
                strain,
            } => {
                let speed = match drive {
                    WallSpeed::Velocity(speed) => *speed,
                    WallSpeed::InertialNumber(i) => i / inertial_time * height,
                };
                let rate = StrainRate {
                    speed,
                    per_step: speed / height * step,
                    pace: Pace { ramp: ramp / step },
                };
                Plan::of_strain(scene, walls, &rate, *strain)
            }
            Motion::Protocol(parts) => Plan::of_parts(scene, output, height, parts),
        };
        let Plan {
            protocol,
            intervals,
            conditions,
            first_frame,
            first_analysis,
        } = plan;
        let total = protocol.steps();
        let further = FurtherColumns {
            imposed: walls.boundary.shows_imposed(&protocol),
            lateral: protocol.has_lateral(),
            bottom: protocol.has_bottom_along(),
            temperatures: output.temperatures,
        };
        let columns = columns(walls, further);
        Self {
            step,
            height,
            inertial_time,
            total,
            first_frame,
            first_analysis,
            progress: match output.progress_lines {
                0 => 0,
                lines => (total / lines).max(1),
            },
            log_columns: log_columns(walls, columns),
            columns,
            further,
            protocol,
            intervals,
            conditions,
            window: None,
        }
    }

    /// The same to the end of a window, with its frames, without checkpoints and scalars.
    pub fn restricted_to(mut self, window: ReplayWindow) -> Self {
        for intervals in &mut self.intervals {
            intervals.analysis = Interval::default();
            intervals.checkpoints = Interval::default();
        }
        self.total = self.total.min(window.last);
        self.window = Some(window);
        self
    }

    /// Ends a part after so many of its steps; the next one follows at once.
    pub fn end_part(&mut self, part: usize, steps: u64) {
        self.protocol.end(part, steps);
        self.total = self.protocol.steps();
        if let Some(window) = self.window {
            self.total = self.total.min(window.last);
        }
    }

    /// The part that has the step after so many steps, and the conditions that end it.
    pub fn condition(&self, step: u64) -> (usize, Option<&Until>) {
        let part = self.protocol.segment_of(step);
        (part, self.conditions[part].as_ref())
    }

    /// Whether some part may end before its time.
    pub fn has_conditions(&self) -> bool {
        self.conditions.iter().any(Option::is_some)
    }

    /// Whether the conditions that end a part are checked after so many steps.
    pub fn check_due(&self, step: u64) -> bool {
        self.has_conditions() && step < self.protocol.steps() && self.on_grid(|s| s.checks, step)
    }

    /// The stretch that is computed again, if it is one.
    pub fn window(&self) -> Option<ReplayWindow> {
        self.window
    }

    /// γ of the drive after so many steps.
    pub fn strain(&self, step: u64) -> f64 {
        self.protocol.position(step) / self.height
    }

    /// t (s).
    pub fn time(&self, step: u64) -> f64 {
        step as f64 * self.step
    }

    /// The step after which the drive, which moves one way, is nearest to a position (m); the one
    /// after the last if it comes nowhere near.
    pub fn step_at(&self, position: f64) -> u64 {
        let (mut low, mut high) = (0, self.total + 1);
        while low < high {
            let middle = low + (high - low) / 2;
            if self.protocol.position(middle) < position {
                low = middle + 1;
            } else {
                high = middle;
            }
        }
        let Some(before) = low.checked_sub(1) else {
            return low;
        };
        let [distance_before, distance] =
            [before, low].map(|step| (self.protocol.position(step) - position).abs());
        if distance_before < distance {
            before
        } else {
            low
        }
    }

    /// The step that has the same place in the protocol, to half a step, as a step of the same
    /// protocol in steps of another length.
    pub fn step_of(&self, other: &Self, step: u64) -> u64 {
        let part = other.protocol.segment_of(step);
        let theirs = other.protocol.segments()[part];
        let own = self.protocol.segments()[part];
        let done = step - theirs.first;
        let steps = if done >= theirs.steps {
            own.steps
        } else {
            ((done as f64 * (other.step / self.step)).round() as u64).min(own.steps)
        };
        own.first + steps
    }

    /// I of a velocity (m/s).
    pub fn inertial_number(&self, velocity: f64) -> f64 {
        velocity / self.height * self.inertial_time
    }

    /// Whether a frame is written after so many steps.
    pub fn frame_due(&self, step: u64) -> bool {
        if let Some(window) = self.window {
            return match window.every {
                Some(every) => step >= window.first && due(every, step - window.first),
                None => step >= window.first && self.series_due(step),
            };
        }
        step >= self.first_frame && self.due(|s| s.frames, step, self.first_frame)
    }

    /// Whether the scalars of a frame are computed after so many steps.
    pub fn analysis_due(&self, step: u64) -> bool {
        step >= self.first_analysis && self.due(|s| s.analysis, step, self.first_analysis)
    }

    /// Whether the time series gets a row after so many steps.
    pub fn series_due(&self, step: u64) -> bool {
        self.due(|s| s.series, step, 0)
    }

    /// Whether the terminal gets a line after so many steps.
    pub fn progress_due(&self, step: u64) -> bool {
        due(self.progress, step)
    }

    /// Whether a checkpoint is written after so many steps.
    pub fn checkpoint_due(&self, step: u64) -> bool {
        step > 0 && self.due(|s| s.checkpoints, step, 0)
    }

    /// What the stage writes up to the step `last`, at which it ends or is stopped.
    pub fn counts(&self, last: u64) -> Counts {
        let frames = self.count(|s| s.frames, self.first_frame, last);
        let rows = self.count(|s| s.series, 0, last);
        let checkpoints = self.count(|s| s.checkpoints, 0, last);
        // None at the start, and always one at the end.
        let at_start = u64::from(self.on_grid(|s| s.checkpoints, 0));
        let at_end = u64::from(!self.due(|s| s.checkpoints, last, 0));
        Counts {
            frames,
            rows,
            checkpoints: checkpoints - at_start + at_end,
        }
    }

    /// Number of steps `from` … `last` at which something is due.
    fn count(&self, every: impl Fn(&Intervals) -> Interval, from: u64, last: u64) -> u64 {
        let segments = self.protocol.segments();
        let ends = segments.iter().skip(1).map(|segment| segment.first);
        let ends = ends.map(|end| end.min(last + 1)).chain([last + 1]);
        let mut sum = 0;
        for ((segment, intervals), end) in segments.iter().zip(&self.intervals).zip(ends) {
            let interval = every(intervals);
            let first = segment.first.max(from);
            if !interval.is_never() && end > first {
                let [first, end] = [first, end].map(|step| interval.before(step - segment.first));
                sum += end - first;
            }
        }
        // Also at the end, between two of an interval.
        let end = self.protocol.steps();
        let is_between = last >= end && self.due(&every, end, from) && !self.on_grid(&every, end);
        sum + u64::from(is_between)
    }

    /// The last state of the stage is always written, if anything is.
    fn due(&self, every: impl Fn(&Intervals) -> Interval, step: u64, from: u64) -> bool {
        if step < from {
            return false;
        }
        if step == self.protocol.steps() {
            return !every(&self.intervals[self.protocol.segment_of(step)]).is_never();
        }
        self.on_grid(every, step)
    }

    /// Whether a step is a whole number of intervals after the start of its segment.
    fn on_grid(&self, every: impl Fn(&Intervals) -> Interval, step: u64) -> bool {
        let segment = self.protocol.segment_of(step);
        let first = self.protocol.segments()[segment].first;
        every(&self.intervals[segment]).is_due(step - first)
    }
}

impl Interval {
    /// So many steps at full speed, at least one; 0 is never.
    fn of_steps(steps: f64, pace: Pace) -> Self {
        if steps > 0.0 {
            Self {
                unit: steps.max(1.0),
                units: 1,
                pace,
            }
        } else {
            Self::default()
        }
    }

    /// So many times in these steps, or in each of them; 0 is never.
    fn dividing(steps: u64, times: u64) -> Self {
        match times {
            0 => Self::default(),
            times => Self::of_steps(steps as f64 / times as f64, Pace::default()),
        }
    }

    /// So many of this interval, at least one.
    fn times(self, units: u64) -> Self {
        Self { units, ..self }
    }

    /// Whether nothing is written.
    pub fn is_never(self) -> bool {
        self.unit == 0.0
    }

    /// Its mean length at the full speed of the drive (steps); 0 is never.
    pub fn mean_steps(self) -> f64 {
        self.unit * self.units as f64
    }

    /// The nearest whole number of steps; 0 is never.
    pub fn steps(self) -> u64 {
        self.mean_steps().round() as u64
    }

    /// The step nearest to so many units. Halves are rounded up even if rounding of the unit made
    /// them less, as are those of a whole stage.
    fn at(self, units: u64) -> u64 {
        let steps = self.pace.steps(units as f64 * self.unit);
        (steps + (0.5 + 1e-6)).floor() as u64
    }

    /// Whether it is due after so many steps of the segment.
    fn is_due(self, step: u64) -> bool {
        if self.is_never() {
            return false;
        }
        let below = (self.pace.full_steps(step as f64) / self.unit).floor() as u64;
        let mut nearest = [below, below + 1].into_iter();
        nearest.any(|units| self.at(units) == step && units.is_multiple_of(self.units))
    }

    /// How often it is due before the step `step`.
    fn before(self, step: u64) -> u64 {
        let full = self.pace.full_steps(step as f64);
        let mut times = (full / self.mean_steps()).floor() as u64;
        times = times.saturating_sub(1);
        while self.at(times * self.units) < step {
            times += 1;
        }
        times
    }

    /// The step at which it is due that is nearest to this one.
    fn nearest(self, steps: f64) -> u64 {
        if self.is_never() {
            return whole(steps);
        }
        let times = (steps / self.mean_steps()).round() as u64;
        self.at(times.saturating_mul(self.units))
    }
}

/// At least one step, and none of nothing.
fn whole(steps: f64) -> u64 {
    if steps > 0.0 {
        (steps.round() as u64).max(1)
    } else {
        0
    }
}

fn due(every: u64, step: u64) -> bool {
    every > 0 && step.is_multiple_of(every)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{embedded, overrides};
    use crate::{Source, load};

    /// The schedule of the default scene, as changed by `set`, 40 μm high.
    fn schedule(set: &str) -> Schedule {
        let scene = embedded(set).expect("the default scene is sound");
        let walls = scene.plane_shear("the default scene").expect("walls");
        Schedule::new(&scene, walls, 40e-6)
    }

    #[test]
    fn strains_become_whole_steps() {
        let schedule = schedule("");
        let per_step = schedule.strain(1);
        assert!((schedule.strain(schedule.total) - 0.1).abs() <= 0.5 * per_step);
        let whole = schedule.intervals[0];
        assert!((whole.series.mean_steps() * per_step / 1e-5 - 1.0).abs() < 1e-12);
        assert!((whole.frames.mean_steps() / whole.series.mean_steps() - 10.0).abs() < 1e-12);
        assert!(
            (schedule.inertial_number(schedule.protocol.velocity(0)) / 2e-4 - 1.0).abs() < 1e-14
        );
        let third = (3e-4 / per_step).round() as u64;
        assert!(schedule.frame_due(0) && schedule.frame_due(third));
        assert!(!schedule.frame_due(third + 1) && !schedule.frame_due(third - 1));
    }

    /// Steps at which frames and rows are due.
    fn written(schedule: &Schedule) -> [Vec<u64>; 2] {
        let steps = || 0..=schedule.total;
        [
            steps().filter(|k| schedule.frame_due(*k)).collect(),
            steps().filter(|k| schedule.series_due(*k)).collect(),
        ]
    }

    /// Frames and rows are at the steps nearest to their strains, and the last state is one of them
    /// whether or not the intervals divide the stage.
    #[test]
    fn a_stage_ends_with_a_frame_and_a_row() {
        for speed in ["1e-3", "7.3e-3", "3.1e-2"] {
            for (strain, frames, rows) in [
                (0.03, 0.01, 1e-3),
                (0.03, 0.01, 1e-2),
                (0.035, 0.01, 1e-3),
                (0.03, 0.0085, 1.7e-3),
                (0.0312, 0.05, 1e-3),
            ] {
                let set = format!(
                    "shear.inertial_number={speed} shear.strain={strain} output.frame_strain={frames}
                    output.series_strain={rows}"
                );
                let s = schedule(&set);
                let per_step = s.strain(1);
                let expected = |interval: f64| {
                    let whole = (strain / interval + 1e-9).floor() as u64;
                    let mut steps: Vec<u64> = (0..=whole)
                        .map(|k| (k as f64 * interval / per_step).round() as u64)
                        .collect();
                    if *steps.last().unwrap() != s.total {
                        steps.push(s.total);
                    }
                    steps
                };
                assert_eq!(written(&s), [frames, rows].map(expected), "{set}");
            }
        }
        // Along a ramp x = V t²/(2 r), then V (t - r/2).
        let steady = schedule("shear.inertial_number=1e-2 shear.strain=0.03");
        let ramp = 0.04 * steady.height / steady.protocol.velocity(steady.total);
        let s = schedule(&format!(
            "shear.inertial_number=1e-2 shear.ramp={ramp} shear.strain=0.03 output.frame_strain=0.01
            output.series_strain=1e-3"
        ));
        let full = s.protocol.velocity(s.total) / s.height;
        let time = |strain: f64| {
            if strain < 0.5 * full * ramp {
                (2.0 * ramp * strain / full).sqrt()
            } else {
                strain / full + 0.5 * ramp
            }
        };
        assert!(time(0.01) < ramp && time(0.03) > ramp);
        let expected = |interval: f64, times: u64| -> Vec<u64> {
            let step = |k: u64| (time(interval * k as f64) / s.step).round() as u64;
            (0..=times).map(step).collect()
        };
        assert_eq!(written(&s), [expected(0.01, 3), expected(1e-3, 30)]);
        assert!((s.strain(s.total) - 0.03).abs() < full * s.step);

        let none = schedule("shear.strain=0.01 output.frame_strain=0 output.series_strain=0");
        assert_eq!(written(&none), [Vec::<u64>::new(), Vec::new()]);
    }

    /// Each part of a protocol has as many frames and rows as are asked for, and the first and last
    /// state.
    #[test]
    fn parts_are_divided() {
        let s = schedule(
            "shear.inertial_number=none shear.strain=none output.frame_strain=none
            output.series_strain=none output.checkpoint_strain=none
            shear.protocol=[{velocity=1e-3,time=1e-6},{velocity=0,time=0.7e-6}]
            output.frame_rows=7 output.series_rows=13",
        );
        let [frames, rows] = written(&s);
        assert_eq!((frames.len(), rows.len()), (15, 27));
        for steps in [&frames, &rows] {
            assert!(steps.contains(&s.protocol.segments()[1].first));
            assert_eq!((steps[0], *steps.last().unwrap()), (0, s.total));
        }
    }

    /// I = γ̇ √(m̄/P) of disks, γ̇ d̄ √(ρ/P) of spheres, by the moments of uniform radii; V = γ̇ H.
    #[test]
    fn inertial_numbers_are_those_of_the_literature() {
        let (least, greatest, density, pressure, height) = (0.8e-3, 1.2e-3, 2500.0, 1e3, 20e-3);
        let mean_square = (least * least + least * greatest + greatest * greatest) / 3.0;
        let disks = f64::sqrt(density * std::f64::consts::PI * mean_square / pressure);
        let spheres = (least + greatest) * f64::sqrt(density / pressure);
        for (sets, time) in [
            ("dimension=2", disks),
            ("dimension=3 sample.width=12e-3", spheres),
        ] {
            let text = "
                material.density = 2500
                contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.5, damping_ratio = 0.1 }
                sample = { grains = 1000, radius_min = 0.8e-3, radius_max = 1.2e-3, length = 24e-3 }
                load.pressure = 1e3
                shear = { inertial_number = 1e-3, strain = 0.1 }
            ";
            let scene = load(&Source::new("s", text), &overrides(sets)).unwrap();
            let walls = scene.plane_shear("s").unwrap();
            let schedule = Schedule::new(&scene, walls, height);
            let velocity = schedule.protocol.velocity(0);
            let expected = 1e-3 / time * height;
            assert!((velocity / expected - 1.0).abs() < 1e-14, "{sets}");
            assert!((schedule.inertial_number(velocity) / 1e-3 - 1.0).abs() < 1e-14);
        }
    }

    /// In a fast flow a step shears by more than the rows ask for: neither frames nor checkpoints
    /// are further apart than asked, but for rounding to whole steps and to rows.
    #[test]
    fn intervals_are_as_near_as_steps_allow() {
        for fast in ["2e-4", "1e-3", "1e-2", "1e-1"] {
            for rows in ["1e-5", "1e-9"] {
                let set = format!("shear.inertial_number={fast} output.series_strain={rows}");
                let s = schedule(&set);
                let (all, per_step) = (s.intervals[0], s.strain(1));
                for (wanted, every) in [(1e-4, all.frames), (0.02, all.checkpoints)] {
                    let wanted = (wanted / per_step).max(1.0);
                    assert!((every.mean_steps() / wanted - 1.0).abs() < 1e-12);
                }
            }
        }
    }

    /// Rows of the time series are there wherever a frame is written or analysed, though no start
    /// is a multiple of an interval.
    #[test]
    fn frames_have_rows() {
        let s = schedule(
            "output.series_strain=7.2e-7 output.frame_strain=3.6e-6 output.frame_start=0.022
            analysis.scalars=true analysis.strain=1.44e-6",
        );
        let all = s.intervals[0];
        for (first, every) in [
            (s.first_frame, all.frames),
            (s.first_analysis, all.analysis),
        ] {
            let off = (s.strain(first) - 0.022).abs();
            assert!(off <= (0.5 * every.mean_steps() + 1.0) * s.strain(1));
        }
        let due = |is_due: &dyn Fn(u64) -> bool| -> Vec<u64> {
            (0..=s.total).filter(|k| is_due(*k)).collect()
        };
        let [frames, analysed] = [due(&|k| s.frame_due(k)), due(&|k| s.analysis_due(k))];
        assert_eq!((frames[0], analysed[0]), (s.first_frame, s.first_analysis));
        assert!(frames.len() > 1000 && analysed.len() > 1000);
        assert!(frames.iter().chain(&analysed).all(|k| s.series_due(*k)));
    }

    /// Counted step by step, of strains and of parts.
    #[test]
    fn counts_are_those_of_the_steps() {
        let of_parts = "shear.inertial_number=none shear.strain=none output.frame_strain=none
            output.series_strain=none output.checkpoint_strain=none
            shear.protocol=[{velocity=1e-3,time=1e-6},{velocity=0,time=0.7e-6}]
            output.frame_rows=7 output.series_rows=13";
        let strains = "shear.strain=0.001 output.frame_strain=1.7e-5 output.frame_start=3e-4
            output.checkpoint_strain=2e-4";
        for set in [of_parts, strains] {
            let s = schedule(set);
            let wanted = |last: u64| {
                let count =
                    |due: &dyn Fn(u64) -> bool| (0..=last).filter(|k| due(*k)).count() as u64;
                Counts {
                    frames: count(&|k| s.frame_due(k)),
                    rows: count(&|k| s.series_due(k)),
                    checkpoints: count(&|k| s.checkpoint_due(k) || k == last),
                }
            };
            // Whole, and stopped in each part.
            for last in [s.total, s.total - 1, s.total / 2, s.total / 3, 1] {
                assert_eq!(s.counts(last), wanted(last), "{set} to step {last}");
            }
            let whole = wanted(s.total);
            assert!(whole.frames > 10 && whole.rows > 20 && whole.checkpoints > 1);
        }
    }

    /// Contract 2: nothing about output moves the time step or the number of steps.
    #[test]
    fn output_does_not_reach_the_steps() {
        let with = |set: &str| {
            let s = schedule(set);
            (s.step, s.total, s.protocol.velocity(0))
        };
        let other = "output.frame_strain=3.3e-5 output.series_strain=0.0 output.frame_start=0.01";
        assert_eq!(with(""), with(other));
    }
}
