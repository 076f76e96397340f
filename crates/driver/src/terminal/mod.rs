//! What rank 0 tells of a run: lines, and on a terminal one line of progress that is drawn anew.

pub mod progress;
mod status;

use std::path::Path;
use std::time::Duration;

use console::Term;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::header::{Birth, Position, StrainProgress};
use crate::options::Verbosity;
use crate::say::{say, say_error, width};
use gshear_dem::clock::{PHASES, StepPhase};
use gshear_dem::dimension::Dimension;
use gshear_dem::domain::Traffic;
use gshear_dem::drive::Piston;
use gshear_dem::failure::on_one_line;
use gshear_dem::protocol::{Along, Course, Normal, Ramp, Segment};
use gshear_dem::simd::Isa;
use gshear_dem::system::System;
use gshear_mpi_exchange::Parallel;
use gshear_scene::derived::mean_attraction;
use gshear_scene::schedule::{Interval, Schedule, definition_of_inertial_number};
use gshear_scene::{
    Control, Dimensions, Motion, Origin, PlaneShear, Scene, TimeStep, WallSpeed, Walls, unlikely,
};
use gshear_store::box_columns::AqsRow;
use gshear_store::provenance;
use gshear_store::status::StageProgress;
use progress::{duration, line};
use status::StatusFile;

/// Lines about the run, the line of progress, and `status.json`.
pub(crate) struct Terminal {
    verbosity: Verbosity,
    /// Whether this rank prints.
    speaks: bool,
    /// The terminal with the line of progress.
    screen: Option<Screen>,
    next_packing_line: u64,
    /// Where this rank tells how far the run has come.
    status: Option<StatusFile>,
}

/// A terminal, and the line of progress on it.
struct Screen {
    term: Term,
    line: ProgressBar,
    styled: bool,
    /// Whether it is where the other lines go.
    has_lines: bool,
}

impl Screen {
    fn find() -> Option<Self> {
        let (term, target) = drawable()?;
        let bar = ProgressBar::with_draw_target(None, target);
        bar.set_style(plain_message());
        Some(Self {
            term,
            has_lines: Term::stdout().is_term(),
            line: bar,
            styled: is_coloured(),
        })
    }
}

/// The terminal of standard output or standard error on which lines of progress can be drawn. Open
/// MPI gives every rank a pseudo-terminal as standard output; it has the size of the terminal that
/// mpirun itself writes to, and none if mpirun writes to a file or a pipe.
pub(crate) fn drawable() -> Option<(Term, ProgressDrawTarget)> {
    let mut terms = [Term::stdout(), Term::stderr()].into_iter();
    let term = terms.find(|term| term.is_term() && term.size_checked().is_some())?;
    let target = ProgressDrawTarget::term(term.clone(), 10);
    (!target.is_hidden()).then_some((term, target))
}

/// The style of a line of progress that is its message.
pub(crate) fn plain_message() -> ProgressStyle {
    ProgressStyle::with_template("{msg}").expect("a sound template")
}

/// Whether the environment leaves terminals their colours.
pub(crate) fn is_coloured() -> bool {
    std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
}

/// What the summary at the end of a shear says besides the state.
pub(crate) struct Ending<'a> {
    /// Grain-steps/s of all ranks together.
    pub speed: f64,
    /// What this rank has sent.
    pub traffic: Traffic,
    /// The digest.
    pub digest: &'a str,
    /// The folder of the results.
    pub out: &'a Path,
}

impl Terminal {
    /// `speaks`: whether this rank prints.
    pub fn new(speaks: bool, verbosity: Verbosity) -> Self {
        let verbosity = if speaks { verbosity } else { Verbosity::Quiet };
        Self {
            verbosity,
            speaks,
            screen: (verbosity != Verbosity::Quiet).then(Screen::find).flatten(),
            next_packing_line: 10_000,
            status: None,
        }
    }

    pub(crate) fn say(&self, line: impl AsRef<str>) {
        match (&self.screen, self.verbosity) {
            (_, Verbosity::Quiet) => {}
            (None, _) => say(line.as_ref()),
            (Some(screen), _) => screen.line.suspend(|| say(line.as_ref())),
        }
    }

    /// Says on standard error what is unlikely about the run, also if told to be quiet.
    pub fn warn(&self, warning: impl std::fmt::Display) {
        let line = format!("warning: {warning}");
        match &self.screen {
            _ if !self.speaks => {}
            None => say_error(&line),
            Some(screen) => screen.line.suspend(|| say_error(&line)),
        }
    }

    /// Prints what is of interest only if something is to be understood.
    fn detail(&self, line: impl AsRef<str>) {
        if self.verbosity == Verbosity::Verbose {
            self.say(line);
        }
    }

    /// A line that a log gets now and then; a terminal has the line of progress instead.
    fn log(&self, line: impl AsRef<str>) {
        let has_line = self.screen.as_ref().is_some_and(|screen| screen.has_lines);
        if !has_line || self.verbosity == Verbosity::Verbose {
            self.say(line);
        }
    }

    /// Draws the line of progress. `speed`: in grain-steps/s of all ranks; `left`: in s.
    fn draw(&self, progress: &StageProgress, speed: Option<f64>, left: Option<f64>) {
        if let Some(screen) = &self.screen {
            let width = width(&screen.term).unwrap_or_default();
            let text = line(progress, speed, left, width, screen.styled);
            if screen.line.is_finished() {
                screen.line.reset();
            }
            screen.line.set_message(text);
        }
    }

    /// Removes the line of progress, until it is drawn again.
    pub fn clear(&self) {
        if let Some(screen) = &self.screen {
            screen.line.finish_and_clear();
        }
    }

    pub fn header(&self, exchange: &dyn Parallel, scene: &Scene, isa: Isa) {
        let title = on_one_line(&scene.title);
        self.say(format!("{}: {title}", provenance::printed()));
        let sample = &scene.sample;
        let grains = format!(
            "{} on {} ({}); {} grains",
            ranks(exchange.size()),
            provenance::processor(),
            isa.name(),
            sample.grains
        );
        let law = law(scene);
        let TimeStep { step, limit, .. } = scene.time_step;
        let first_strain = scene.stages.first_strain();
        if let Some(quasi_static) = first_strain {
            let lengths = quasi_static.lengths(sample);
            self.say(format!(
                "{grains} in a periodic box {}, solid fraction {:.4}",
                box_size(lengths, scene.dimension),
                quasi_static.solid_fraction
            ));
            if let Some(file) = scene.packing() {
                self.say(format!("grains from {}", file.path.display()));
            }
        }
        let Some(plane_shear) = scene.shear() else {
            self.say(format!(
                "law:   {law}; step:  dt = {step:.4e}, limit {limit:.4e}"
            ));
            return;
        };
        let (width, unit) = match scene.dimension {
            Dimensions::Two => (String::new(), "N/m"),
            Dimensions::Three => (format!(", L_y = {:.4e} m", sample.width), "N"),
        };
        if first_strain.is_none() {
            self.say(format!("{grains}, L_x = {:.4e} m{width}", sample.length));
        }
        if let Origin::Packing(file) = &plane_shear.origin {
            let what = if plane_shear.pack.skip {
                walls_of_file(plane_shear)
            } else {
                "to be packed"
            };
            self.say(format!("grains from {}; {what}", file.path.display()));
        }
        let load = &plane_shear.load;
        self.say(format!("law:   {law}"));
        let suffix = if plane_shear.boundary.has_top() {
            ""
        } else {
            " of the weight"
        };
        let force = match first_strain {
            // By a cell that is not known yet.
            Some(_) => String::new(),
            None => format!(", N = {:.6e} {unit}", load.normal_force),
        };
        self.say(format!(
            "load:  kappa = {:.4e}, P = {:.6e} Pa{force}{suffix}",
            load.stiffness_number, load.pressure,
        ));
        if load.gravity > 0.0 {
            self.say(format!(
                "       g = {:.4} m/s², inclined by {:.4} degrees",
                load.gravity, load.incline
            ));
        }
        self.say(format!("step:  dt = {step:.4e} s, limit {limit:.4e} s"));
    }

    /// Progress of the packing. `kinetic`: kinetic energy per grain over P d̄ δ̄.
    pub fn packing(&mut self, step: u64, piston: &Piston, kinetic: f64) {
        // At growing intervals, because the number of steps is unknown.
        let verbose = self.verbosity == Verbosity::Verbose;
        if step >= self.next_packing_line || verbose {
            self.next_packing_line = 2 * step;
            self.log(format!(
                "pack:  step {step}, height {:.4e} m, kinetic energy per grain {kinetic:.1e} P d delta",
                piston.height
            ));
        }
    }

    pub(crate) fn packs_again(&self, step: u64) {
        self.say(format!(
            "pack:  outside the contact law at step {step}; begins again under a quarter of the load, which is raised later"
        ));
    }

    /// `height` (m): without the walls.
    pub fn packed(&self, step: u64, height: f64, plane_shear: &PlaneShear) {
        let height = format!("{height:.6e}");
        let made = plane_shear.boundary.packed.replace("{height}", &height);
        self.say(format!("pack:  at rest after {step} steps; {made}"));
    }

    /// `count`: grains that became grains of the walls because they close holes of these.
    pub fn plugged(&self, count: usize) {
        match count {
            0 => {}
            1 => self.say("pack:  one grain more belongs to the walls: it closes a hole"),
            n => self.say(format!(
                "pack:  {n} grains more belong to the walls: they close holes"
            )),
        }
    }

    pub(crate) fn shearing(
        &self,
        scene: &Scene,
        plane_shear: &PlaneShear,
        schedule: &Schedule,
        first: u64,
    ) {
        if let Some(spring) = plane_shear.shear.spring {
            self.say(format!(
                "drive: a spring of k = {:.4e}, k d/N = {:.4e}",
                spring,
                spring * scene.sample.mean_diameter / plane_shear.load.normal_force
            ));
        }
        if let Control::Servo { gain, speed_max } = plane_shear.load.control {
            let most = if speed_max.is_finite() {
                format!(", at most {speed_max:.4e} m/s")
            } else {
                String::new()
            };
            self.say(format!("load:  a servo of {gain:.4e} m/(s Pa){most}"));
        }
        if let Some(warning) = unlikely::intervals(plane_shear, schedule) {
            self.warn(warning);
        }
        let segments = schedule.protocol.segments();
        let intervals = &schedule.intervals;
        match &plane_shear.shear.motion {
            Motion::Strain { drive, .. } => self.shearing_to_a_strain(scene, *drive, schedule),
            Motion::Protocol(_) => {
                for (n, (segment, intervals)) in segments.iter().zip(intervals).enumerate() {
                    let (_, condition) = schedule.condition(segment.first);
                    self.say(format!(
                        "shear: part {} of {}: {} for {}{:.4e} s, {} steps; {}, {}",
                        n + 1,
                        segments.len(),
                        imposed(schedule, segment),
                        if condition.is_some() { "at most " } else { "" },
                        schedule.time(segment.steps),
                        segment.steps,
                        every("frames", intervals.frames.steps()),
                        every("series", intervals.series.steps()),
                    ));
                }
            }
        }
        if first > 0 {
            self.say(format!(
                "shear: goes on from step {first}, strain {:.6}",
                schedule.strain(first)
            ));
        }
    }

    fn shearing_to_a_strain(&self, scene: &Scene, drive: WallSpeed, schedule: &Schedule) {
        let given = match drive {
            WallSpeed::InertialNumber(_) => "I given",
            WallSpeed::Velocity(_) => "V given",
        };
        let segment = schedule.protocol.segment(0);
        let speed = segment.velocity().unwrap_or(0.0);
        let ramp = ramped(schedule, segment);
        self.say(format!(
            "shear: I = {} = {:.4e}, V = {speed:.6e} m/s ({given}){ramp}; shear rate {:.4e} /s",
            definition_of_inertial_number(scene.dimension),
            schedule.inertial_number(speed),
            speed / schedule.height,
        ));
        let intervals = &schedule.intervals[0];
        self.say(format!(
            "shear: {} steps to strain {:.4}; {}, {}, {}",
            schedule.total,
            schedule.strain(schedule.total),
            every_strain(schedule, "frames", intervals.frames),
            every_strain(schedule, "series", intervals.series),
            every_strain(schedule, "checkpoints", intervals.checkpoints),
        ));
        let starts = [
            ("frames", intervals.frames, schedule.first_frame),
            ("scalars", intervals.analysis, schedule.first_analysis),
        ];
        for (name, interval, first) in starts {
            if !interval.is_never() && (name == "scalars" || first > 0) {
                self.say(format!(
                    "shear: {} from step {first} on, strain {:.6}",
                    every_strain(schedule, name, interval),
                    schedule.strain(first)
                ));
            }
        }
    }

    /// A line about the shear. `steps`, `elapsed`: since it was begun or resumed.
    pub(crate) fn log_shear(&self, progress: &StageProgress, steps: u64, elapsed: Duration) {
        let (steps, elapsed) = (steps as f64, elapsed.as_secs_f64());
        let step = progress.step;
        let total = progress.steps.unwrap_or(step);
        let left = elapsed / steps * (total - step) as f64;
        let stress = match (progress.stress_ratio, progress.solid_fraction) {
            (Some(tau), Some(phi)) => format!(" tau {tau:.4} phi {phi:.4}"),
            _ => String::new(),
        };
        let strain = progress.strain.map(|strain| format!(" strain {strain:.5}"));
        let grains = f64::from(progress.moving.unwrap_or(0));
        self.log(format!(
            "{:5.1} % step {step}{}{stress} | {:.1} million grain-steps/s, {} left",
            100.0 * step as f64 / total as f64,
            strain.unwrap_or_default(),
            1e-6 * grains * steps / elapsed,
            duration(left),
        ));
    }

    /// A checkpoint was written, within this time.
    pub fn saved(&self, position: Position, time: Duration) {
        self.detail(format!(
            "checkpoint of {position}, written in {:.3} s",
            time.as_secs_f64()
        ));
    }

    pub fn stopped(&self, out: &Path, stage: &str, step: u64) {
        self.say(format!(
            "stopped in {stage} at step {step}; continue with --resume {}",
            out.display()
        ));
    }

    /// The run stopped while the packing of a box was prepared.
    pub(crate) fn unprepared(&self) {
        self.say("stopped while the packing was prepared, which leaves no checkpoint; start the run again with --resume auto");
    }

    /// Summary at the end of a shear.
    pub fn end(
        &self,
        exchange: &dyn Parallel,
        system: &mut System<impl Dimension>,
        ending: &Ending<'_>,
    ) {
        self.clear();
        let phases = system.clock.table(exchange);
        let memory = exchange.maximum(system.memory() as f64);
        let rebuilds = system.list.rebuilds;
        self.say(format!("results in {}", ending.out.display()));
        let room = width(&Term::stdout()).unwrap_or(usize::MAX);
        self.say(phases_within(&phases, room).trim_end());
        if exchange.size() > 1 {
            let messages = ending.traffic.messages[0] as f64 / system.clock.steps().max(1) as f64;
            let [exchange, sums] = [StepPhase::Exchange, StepPhase::Walls]
                .map(|phase| 1e6 * system.clock.per_step(phase));
            self.say(format!(
                "per step from rank 0: {messages:.1} messages of {} bytes in all and 1 sum of {} bytes; with what they wait for, {exchange:.1} and {sums:.1} us",
                system.slabs.bytes_per_step(),
                gshear_dem::sum_over_ranks::MESSAGE_BYTES,
            ));
        }
        let threads = system.pool.threads();
        if let Some((alone, phases)) = system.clock.serial_shares(exchange) {
            self.say(work_alone(threads, alone, phases));
        }
        self.say(format!(
            "{rebuilds} list rebuilds; state {:.0} bytes per grain of a rank",
            memory / system.owned().max(1) as f64
        ));
        self.say(settings(system));
        self.say(format!(
            "speed {:.4} million grain-steps/s of {}",
            1e-6 * ending.speed,
            ranks(exchange.size())
        ));
        self.say(format!("digest {}", ending.digest));
    }

    /// Says what can be done with the results.
    pub fn go_on(&self, out: &Path) {
        self.say(format!("next: gshear-reduce report {}", out.display()));
    }
}

/// The instruction set, and the bands if there are several.
fn settings(system: &System<impl Dimension>) -> String {
    let isa = system.isa.name();
    match system.bands() {
        1 => format!("instruction set {isa}"),
        bands => format!(
            "instruction set {isa}; {bands} bands, up to {} steps at once",
            system.most_at_once(),
        ),
    }
}

/// How much of the time one of the threads works alone, and what that means for more of them.
fn work_alone(threads: usize, alone: f64, phases: [f64; PHASES.len()]) -> String {
    let named = PHASES.iter().zip(phases);
    let named = named.filter(|(_, share)| *share >= 5e-4);
    let named: Vec<String> = named
        .map(|((_, name), share)| format!("{name} {:.1}", 100.0 * share))
        .collect();
    // Amdahl's law: the share in the time of one thread, which is longer.
    let of_one = alone / (alone + (1.0 - alone) * threads as f64);
    let most = 1.0 / (of_one + (1.0 - of_one) / 16.0);
    format!(
        "{threads} threads: one works alone for {:.1} % of the time ({}); 16 threads would be at most {most:.1} times as fast as one",
        100.0 * alone,
        named.join(", "),
    )
}

/// The table of the phases, without the least and the greatest time if it is wider than this.
fn phases_within(table: &str, width: usize) -> String {
    if table.lines().all(|line| line.chars().count() <= width) {
        return table.trim_end().into();
    }
    let lines: Vec<String> = table.lines().map(narrowed).collect();
    lines.join("\n")
}

/// A line of the table without the columns of the least and the greatest time.
fn narrowed(line: &str) -> String {
    let columns = line.chars().enumerate();
    let kept = columns.filter(|(at, _)| !(20..30).contains(at) && !(40..50).contains(at));
    kept.map(|(_, c)| c).collect()
}

/// How often an output is written.
fn every(name: &str, steps: u64) -> String {
    match steps {
        0 => format!("no {name}"),
        n => format!("{name} every {n} steps"),
    }
}

/// How often an output is written, also in strain.
fn every_strain(schedule: &Schedule, name: &str, interval: Interval) -> String {
    let steps = every(name, interval.steps());
    if interval.is_never() {
        return steps;
    }
    let strain = interval.mean_steps() * schedule.strain(1);
    format!("{steps} ({strain:.4e} strain)")
}

/// The ramp to the velocity of a segment, if it has one.
fn ramped(schedule: &Schedule, segment: &Segment) -> String {
    match &segment.imposed.along {
        Along::Ramp(ramp) => format!(
            ", from {:.4e} m/s within {:.4e} s",
            ramp.from,
            ramp.time * schedule.step
        ),
        _ => String::new(),
    }
}

/// What a segment of a protocol imposes; forces in N, in 2D N/m.
fn imposed(schedule: &Schedule, segment: &Segment) -> String {
    let mut text = match &segment.imposed.along {
        Along::Velocity(velocity) | Along::Ramp(Ramp { to: velocity, .. }) => {
            let mut text = format!("V = {velocity:.4e} m/s");
            // I is that of the load of the scene, which other parts may change.
            if segment.imposed.normal.is_none() {
                text += &format!(" (I = {:.2e})", schedule.inertial_number(*velocity));
            }
            text + &ramped(schedule, segment)
        }
        Along::Oscillation(wave) => format!(
            "strain amplitude {:.4e} at {:.4e} Hz",
            wave.amplitude / schedule.height,
            wave.frequency / schedule.step
        ),
        Along::Force(force) => format!("S = {}", course(schedule, force)),
    };
    match &segment.imposed.normal {
        None => {}
        Some(Normal::Load(load)) => text += &format!(", N = {}", course(schedule, load)),
        Some(Normal::Velocity(0.0)) => text += ", constant volume",
        Some(Normal::Velocity(velocity)) => text += &format!(", wall velocity {velocity:.4e} m/s"),
    }
    let bottom = &segment.imposed.bottom;
    for (along, wave) in [("", bottom.normal), (" along x", bottom.along)] {
        if let Some(wave) = wave {
            text += &format!(
                ", bottom {:.4e} m{along} at {:.4e} Hz",
                wave.amplitude,
                wave.frequency / schedule.step
            );
        }
    }
    text
}

/// The course of a force (N; N/m in 2D).
fn course(schedule: &Schedule, course: &Course) -> String {
    let mut text = format!("{:.4e}", course.from);
    if course.to != course.from {
        text += &format!(" to {:.4e}", course.to);
    }
    if let Some(wave) = &course.wave {
        let (amplitude, frequency) = (wave.amplitude, wave.frequency / schedule.step);
        text += &format!(" and {amplitude:.4e} at {frequency:.4e} Hz");
    }
    text
}

/// What the header says of a box of these lengths (m; the second is 1 in 2D).
fn box_size([length, width, height]: [f64; 3], dimension: Dimensions) -> String {
    let is_planar = dimension == Dimensions::Two;
    if length == height && (is_planar || width == length) {
        return format!("{length:.4e} long");
    }
    let width = if is_planar {
        String::new()
    } else {
        format!(" {width:.4e} wide,")
    };
    format!("{length:.4e} long,{width} {height:.4e} high")
}

/// The law's name and its derived constants.
fn law(scene: &Scene) -> String {
    let law = &scene.law;
    let attraction = mean_attraction(&scene.contact, &scene.sample);
    let unit = ["N/m", "N"][scene.dimension.axes() - 2];
    let attraction = (attraction > 0.0).then_some(("attraction F_c", attraction, unit));
    let derived = law.derived().into_iter().chain(attraction);
    let derived = derived.map(|(symbol, value, unit)| format!("{symbol} = {value:.4e} {unit}"));
    let name = match &scene.materials.names[..] {
        [first, _, ..] => format!("{} of {first}", law.kind().name),
        _ => law.kind().name.into(),
    };
    let derived = derived.map(|text| text.trim_end().into());
    let parts: Vec<String> = std::iter::once(name).chain(derived).collect();
    parts.join(", ")
}

/// `1 rank`, `2 ranks`.
pub(crate) fn ranks(n: usize) -> String {
    if n == 1 {
        "1 rank".into()
    } else {
        format!("{n} ranks")
    }
}

/// Output of strain steps and of Newton's equations.
impl Terminal {
    /// End of the preparation, after `steps` of overdamped dynamics.
    pub fn prepared(&self, steps: u64) {
        self.say(format!(
            "pack:  at rest without friction after {steps} steps of overdamped dynamics"
        ));
    }

    pub fn strain_step(&self, step: u64, row: &AqsRow) {
        let greatest = row.imaginary_greatest;
        let pairs = match row.pairs {
            // Eigenvalues are not computed.
            pairs if pairs.is_nan() => String::new(),
            0.0 => ", no complex pair".into(),
            pairs => format!(", complex pairs: {pairs}, greatest |Im| {greatest:.3e}"),
        };
        self.log(format!(
            "aqs:   step {step} strain {:.6e} stress {:.5e} pressure {:.5e} z {:.3} residual {:.1e} | {} factorisations, {} steps{pairs}",
            row.strain,
            row.shear_stress,
            row.pressure,
            row.coordination,
            row.residual,
            row.factorisations,
            row.overdamped_steps,
        ));
    }

    pub fn born(&self, birth: &Birth) {
        self.say(format!(
            "birth: a complex pair between strains {:.12e} and {:.12e}",
            birth.before, birth.after
        ));
    }

    pub fn strained(&self, progress: &StrainProgress, digest: &str) {
        self.say(format!(
            "aqs:   done after {} steps, {} of them by overdamped dynamics because Newton's method did not converge; digest {digest}",
            progress.steps, progress.fell_back
        ));
    }

    pub fn newtonian(&self, steps: u64, step: f64) {
        self.say(format!(
            "newtonian: {steps} steps, to the time {:.4e}",
            steps as f64 * step
        ));
    }

    pub fn moved(&self, digest: &str, out: &Path) {
        self.say(format!(
            "done:  digest {digest}\n       results in {}",
            out.display()
        ));
    }
}

/// What the walls of a sample are that is sheared as its file has it.
fn walls_of_file(shear: &PlaneShear) -> &'static str {
    let boundary = shear.boundary;
    match (boundary.walls(), boundary.bodies().count(), shear.walls) {
        (0, ..) => "without walls",
        (1, 0, _) => "the bottom is flat",
        (2, 1, Walls::Layers) => "the bottom is its lowest layer, the top is flat",
        (2, 1, Walls::Types) => "the bottom is type 2, the top is flat",
        (_, 0, _) => "walls are flat",
        (_, 1, Walls::Layers) => "the bottom is its lowest layer",
        (_, 1, Walls::Types) => "the bottom is type 2",
        (.., Walls::Layers) => "walls are its lowest and highest layer",
        (.., Walls::Types) => "walls are types 2 (bottom) and 3 (top)",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tenth of the time of two threads is a nineteenth of that of one.
    #[test]
    fn the_serial_share_is_that_of_one_thread_for_others() {
        let said = work_alone(2, 0.1, [0.0, 0.0, 0.0, 0.02, 0.0, 0.08]);
        // 1/(1/19 + (18/19)/16) = 8.94.
        let expected = "2 threads: one works alone for 10.0 % of the time (walls, global sums 2.0, output 8.0); 16 threads would be at most 8.9 times as fast as one";
        assert_eq!(said, expected);
    }

    #[test]
    fn a_narrow_terminal_has_a_narrow_table() {
        let clock = gshear_dem::clock::Clock::default();
        let table = clock.table(&gshear_dem::domain::Solo);
        assert_eq!(phases_within(&table, 80), table.trim_end());
        let narrow = phases_within(&table, 39);
        let head = "phase (s)                 mean    share\nmotion ";
        assert!(narrow.starts_with(head), "{narrow}");
        for line in narrow.lines() {
            assert_eq!(line.chars().count(), 39, "{narrow}");
            assert!(line.ends_with('%') || line.ends_with("share"), "{narrow}");
        }
    }
}
