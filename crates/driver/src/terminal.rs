//! Terminal output of a run, by rank 0.

use std::io::IsTerminal;
use std::path::Path;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::header::{Birth, Progress};
use crate::say::say;
use gshear_dem::clock::StepPhase;
use gshear_dem::dimension::Dimension;
use gshear_dem::drive::Piston;
use gshear_dem::protocol::{Along, Course, Normal, Segment};
use gshear_dem::simd::Isa;
use gshear_dem::state::SeriesRow;
use gshear_dem::system::System;
use gshear_dem::wave::Wave;
use gshear_mpi_exchange::Parallel;
use gshear_scene::schedule::Schedule;
use gshear_scene::{
    Boundary, Control, Dimensions, Law, Motion, Origin, PlaneShear, Scene, TimeStep, WallSpeed,
    Walls,
};
use gshear_store::provenance;

/// Lines of progress, and a progress bar if the output is a terminal.
pub struct Terminal {
    speaks: bool,
    bar: ProgressBar,
    latest: Option<SeriesRow>,
    next_packing_line: u64,
}

impl Terminal {
    pub fn new(speaks: bool) -> Self {
        let bar = if speaks && std::io::stderr().is_terminal() {
            ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr())
        } else {
            ProgressBar::hidden()
        };
        let style =
            ProgressStyle::with_template("{msg} [{bar:30}] {percent:>3} % {elapsed} left {eta}")
                .expect("a sound template");
        bar.set_style(style.progress_chars("=> "));
        Self {
            speaks,
            bar,
            latest: None,
            next_packing_line: 10_000,
        }
    }

    fn say(&self, line: impl AsRef<str>) {
        if self.speaks {
            self.bar.suspend(|| say(line.as_ref()));
        }
    }

    pub fn header(&self, exchange: &dyn Parallel, scene: &Scene, isa: Isa) {
        self.say(format!("{}: {}", provenance::printed(), scene.title));
        let sample = &scene.sample;
        let grains = format!(
            "{} on {} ({}); {} grains",
            ranks(exchange.size()),
            provenance::processor(),
            isa.name(),
            sample.grains
        );
        let law = law(&scene.law);
        let TimeStep { step, limit, .. } = scene.time_step;
        let plane_shear = match &scene.boundary {
            Boundary::Walls(plane_shear) => plane_shear,
            Boundary::Periodic(periodic) => {
                self.say(format!(
                    "{grains} in a periodic box {:.4e} long, solid fraction {:.4}",
                    sample.length, periodic.solid_fraction
                ));
                self.say(format!(
                    "law:   {law}; step:  dt = {step:.4e}, limit {limit:.4e}"
                ));
                return;
            }
        };
        let (width, unit) = match scene.dimension {
            Dimensions::Two => (String::new(), "N/m"),
            Dimensions::Three => (format!(", L_y = {:.4e} m", sample.width), "N"),
        };
        self.say(format!("{grains}, L_x = {:.4e} m{width}", sample.length));
        if let Origin::Packing { file, walls } = &plane_shear.origin {
            self.say(format!(
                "grains from {}; {}",
                file.path.display(),
                match (plane_shear.pack.skip, walls) {
                    (false, _) => "to be packed",
                    (true, Walls::Layers) => "walls are its lowest and highest layer",
                    (true, Walls::Types) => "walls are types 2 (bottom) and 3 (top)",
                }
            ));
        }
        let load = &plane_shear.load;
        self.say(format!("law:   {law}"));
        self.say(format!(
            "load:  kappa = {:.4e}, P = {:.6e} Pa, N = {:.6e} {unit}",
            load.stiffness_number, load.pressure, load.normal_force,
        ));
        self.say(format!("step:  dt = {step:.4e} s, limit {limit:.4e} s"));
    }

    /// Progress of the packing. `kinetic`: kinetic energy per grain over P d̄ δ̄.
    pub fn packing(&mut self, step: u64, piston: &Piston, kinetic: f64) {
        // At growing intervals, because the number of steps is unknown.
        if step >= self.next_packing_line {
            self.next_packing_line = 2 * step;
            self.say(format!(
                "pack:  step {step}, height {:.4e} m, kinetic energy per grain {kinetic:.1e} P d delta",
                piston.height
            ));
        }
    }

    pub fn packed(&self, step: u64, height: f64) {
        self.say(format!(
            "pack:  at rest after {step} steps; walls frozen, {height:.6e} m between them"
        ));
    }

    pub fn shearing(
        &self,
        scene: &Scene,
        plane_shear: &PlaneShear,
        schedule: &Schedule,
        first: u64,
    ) {
        if let Some(spring) = plane_shear.shear.spring {
            self.say(format!(
                "drive: a spring of k = {:.4e}, k d/N = {:.4e}",
                spring.stiffness,
                spring.stiffness * scene.sample.mean_diameter / plane_shear.load.normal_force
            ));
        }
        if let Control::Servo { gain, speed_max } = plane_shear.load.control {
            self.say(format!(
                "load:  a servo of {gain:.4e} m/(s Pa), at most {speed_max:.4e} m/s"
            ));
        }
        let segments = schedule.protocol.segments();
        let intervals = &schedule.intervals;
        let every = |name: &str, steps: u64| match steps {
            0 => format!("no {name}"),
            n => format!("{name} every {n} steps"),
        };
        match &plane_shear.shear.motion {
            Motion::Strain { drive, .. } => {
                let given = match drive {
                    WallSpeed::InertialNumber(_) => "I given",
                    WallSpeed::Velocity(_) => "V given",
                };
                let speed = schedule.protocol.velocity(0);
                self.say(format!(
                    "shear: I = {:.4e}, V = {speed:.6e} m/s ({given}); shear rate {:.4e} /s",
                    schedule.inertial_number(speed),
                    speed / schedule.height,
                ));
                let every = |name: &str, steps: u64| match steps {
                    0 => every(name, 0),
                    n => format!("{} ({:.4e} strain)", every(name, n), schedule.strain(n)),
                };
                self.say(format!(
                    "shear: {} steps to strain {:.4}; {}, {}, {}",
                    schedule.total,
                    schedule.strain(schedule.total),
                    every("frames", intervals[0].frames),
                    every("series", intervals[0].series),
                    every("checkpoints", intervals[0].checkpoints),
                ));
                let starts = [
                    ("frames", intervals[0].frames, schedule.first_frame),
                    ("scalars", intervals[0].analysis, schedule.first_analysis),
                ];
                for (name, steps, first) in starts {
                    if steps > 0 && (name == "scalars" || first > 0) {
                        self.say(format!(
                            "shear: {} from step {first} on, strain {:.6}",
                            every(name, steps),
                            schedule.strain(first)
                        ));
                    }
                }
            }
            Motion::Protocol(_) => {
                for (n, (segment, intervals)) in segments.iter().zip(intervals).enumerate() {
                    self.say(format!(
                        "shear: part {} of {}: {} for {:.4e} s, {} steps; {}, {}",
                        n + 1,
                        segments.len(),
                        imposed(schedule, segment),
                        schedule.time(segment.steps),
                        segment.steps,
                        every("frames", intervals.frames),
                        every("series", intervals.series),
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
        self.bar.set_length(schedule.total);
        self.bar.set_position(first);
        self.bar.reset_eta();
    }

    pub fn latest(&mut self, row: &SeriesRow) {
        self.latest = Some(*row);
    }

    pub fn progress(
        &self,
        schedule: &Schedule,
        grains: u32,
        first: u64,
        step: u64,
        elapsed: Duration,
    ) {
        if !self.speaks {
            return;
        }
        let done = (step - first) as f64;
        let seconds = elapsed.as_secs_f64();
        let left = seconds / done * (schedule.total - step) as f64;
        // A top that is pulled by a force moves as it likes.
        let strain = match (schedule.protocol.has_force(), self.latest) {
            (true, Some(row)) => row.strain,
            _ => schedule.strain(step),
        };
        let stress = self.latest.map_or(String::new(), |row| {
            format!(" tau {:.4} phi {:.4}", row.stress_ratio, row.solid_fraction)
        });
        self.say(format!(
            "{:5.1} % step {step} strain {:.5}{stress} | {:.1} million grain-steps/s, {} left",
            100.0 * step as f64 / schedule.total as f64,
            strain,
            1e-6 * f64::from(grains) * done / seconds,
            humantime::format_duration(Duration::from_secs(left as u64)),
        ));
        self.bar.set_position(step);
        self.bar.set_message(format!("strain {strain:.5}{stress}"));
    }

    pub fn stopped(&self, out: &Path, stage: &str, step: u64) {
        self.say(format!(
            "stopped in {stage} at step {step}; continue with --resume {}",
            out.display()
        ));
    }

    /// Summary at the end of a run. `rate`: grain-steps per second and rank.
    pub fn end(
        &self,
        exchange: &dyn Parallel,
        system: &mut System<impl Dimension>,
        phases: &str,
        rate: f64,
        digest: &str,
        out: &Path,
    ) {
        self.bar.finish_and_clear();
        let memory = exchange.maximum(system.memory() as f64);
        let rebuilds = system.list.rebuilds;
        let (bytes, messages) = system.slabs.traffic();
        self.say(format!("results in {}", out.display()));
        self.say(phases.trim_end());
        if exchange.size() > 1 {
            let micro = |phase| 1e6 * system.clock.per_step(phase);
            self.say(format!(
                "per step from rank 0: {messages} messages of {bytes} bytes in all and 1 sum of {} bytes; with what they wait for, {:.1} and {:.1} us",
                gshear_dem::step::MESSAGE_BYTES,
                micro(StepPhase::Exchange),
                micro(StepPhase::Walls),
            ));
        }
        self.say(format!(
            "{rebuilds} list rebuilds; state {:.0} bytes per grain of a rank",
            memory / system.owned().max(1) as f64
        ));
        self.say(format!("speed {rate:.4e}"));
        self.say(format!("digest {digest}"));
    }
}

/// What a segment of a protocol imposes; forces in N, in 2D N/m.
fn imposed(schedule: &Schedule, segment: &Segment) -> String {
    let frequency = |wave: &Wave| wave.per_step / schedule.step;
    let course = |of: &Course| {
        let mut text = format!("{:.4e}", of.from);
        if of.to != of.from {
            text += &format!(" to {:.4e}", of.to);
        }
        if let Some(wave) = &of.wave {
            let (amplitude, frequency) = (wave.amplitude, frequency(wave));
            text += &format!(" and {amplitude:.4e} at {frequency:.4e} Hz");
        }
        text
    };
    let mut text = match &segment.imposed.along {
        Along::Velocity(velocity) => {
            let mut text = format!("V = {velocity:.4e} m/s");
            // I is that of the load of the scene, which other parts may change.
            if segment.imposed.normal.is_none() {
                text += &format!(" (I = {:.2e})", schedule.inertial_number(*velocity));
            }
            text
        }
        Along::Oscillation(wave) => format!(
            "strain amplitude {:.4e} at {:.4e} Hz",
            wave.amplitude / schedule.height,
            frequency(wave)
        ),
        Along::Force(force) => format!("S = {}", course(force)),
    };
    match &segment.imposed.normal {
        None => {}
        Some(Normal::Load(load)) => text += &format!(", N = {}", course(load)),
        Some(Normal::Velocity(0.0)) => text += ", constant volume",
        Some(Normal::Velocity(velocity)) => text += &format!(", wall velocity {velocity:.4e} m/s"),
    }
    if let Some(wave) = &segment.imposed.bottom {
        text += &format!(
            ", bottom {:.4e} m at {:.4e} Hz",
            wave.amplitude,
            frequency(wave)
        );
    }
    text
}

/// The law's name and its derived constants.
fn law(law: &Law) -> String {
    let derived = law.derived().into_iter();
    let derived = derived.map(|(symbol, value, unit)| format!("{symbol} = {value:.4e} {unit}"));
    let parts: Vec<String> = std::iter::once(law.kind().name.into())
        .chain(derived.map(|text| text.trim_end().into()))
        .collect();
    parts.join(", ")
}

fn ranks(n: usize) -> String {
    if n == 1 {
        "1 rank".into()
    } else {
        format!("{n} ranks")
    }
}

/// Output of runs in a periodic box.
impl Terminal {
    /// End of the preparation, after `steps` of overdamped dynamics.
    pub fn prepared(&self, steps: u64) {
        self.say(format!(
            "pack:  at rest without friction after {steps} steps of overdamped dynamics"
        ));
    }

    pub fn strain_step(&self, row: &dyn std::fmt::Display) {
        self.say(row.to_string());
    }

    pub fn born(&self, birth: &Birth) {
        self.say(format!(
            "birth: a complex pair between strains {:.12e} and {:.12e}",
            birth.before, birth.after
        ));
    }

    pub fn strained(&self, progress: &Progress, digest: &str) {
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
