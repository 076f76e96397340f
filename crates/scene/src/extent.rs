//! What a run of the scene takes: steps that can be counted, and files that a disk can hold.

use gshear_dem::failure::Result;
use gshear_dem::laws::keys::{Key, KeyReader};
use gshear_dem::protocol::Normal;
use gshear_dem::system::THICKEST_SKIN;

use crate::checker::Checker;
use crate::derived;
use crate::grains::Sample;
use crate::load::WAYS;
use crate::output::OUTPUT;
use crate::protocol::{Motion, SHEAR};
use crate::quasi_static::{AQS, NEWTONIAN, Newtonian, QuasiStatic};
use crate::sample::SAMPLE;
use crate::scene::Scene;
use crate::schedule::{MOST_STEPS, STEPS_WITHOUT_A_PAIR, Schedule};
use crate::time::TIME;
use crate::walls::PlaneShear;
use crate::words::show;

/// A kind of record that is written during a run.
struct Record {
    /// In the plural.
    name: &'static str,
    /// Bytes of one, at least.
    bytes: f64,
}

/// A row of the time series.
const ROW: Record = Record {
    name: "rows of the time series",
    bytes: 100.0,
};

impl Record {
    /// A frame of the scene.
    fn frame(scene: &Scene) -> Self {
        Record {
            name: "frames",
            bytes: 50.0 * f64::from(scene.sample.grains),
        }
    }

    /// Refuses more of them than any disk holds; `keys` set how many.
    fn check(&self, c: &mut Checker<'_>, keys: &[&Key], count: f64) {
        let name = self.name;
        let bytes = count * self.bytes;
        if bytes > MOST_BYTES {
            let what = format!(
                "asks for {count:.1e} {name}, at least {bytes:.1e} bytes, more than the {MOST_BYTES:.0e} bytes that a run may write; give fewer"
            );
            c.refuse_among(keys, &what);
        }
    }
}

/// Time steps of a cycle, at least.
const LEAST_STEPS_OF_A_CYCLE: f64 = 20.0;
/// Greatest rounding of a coordinate over the mean overlap.
const FINEST: f64 = 1e-6;
/// Bytes that a run may write: a petabyte.
const MOST_BYTES: f64 = 1e15;

/// Refuses a scene whose run could not end, or whose coordinates do not resolve its overlaps.
pub(crate) fn check(c: &mut Checker<'_>, scene: &Scene) -> Result<()> {
    resolution(c, scene);
    let stages = &scene.stages;
    if let Some(walls) = &stages.shear {
        check_shear(c, scene, walls);
    }
    if let Some(strain) = &stages.strain {
        check_strain(c, scene, strain);
    }
    if let Some(newtonian) = &stages.newtonian {
        check_newtonian(c, scene, newtonian);
    }
    c.settle()
}

/// Refuses coordinates whose rounding is more than a millionth of the least mean overlap: contacts
/// would be lost, or their forces be those of other overlaps. Coordinates along the periodic axes
/// stay in the cell however far grains move. Of strain steps without a pressure the overlaps are
/// not known before.
fn resolution(c: &mut Checker<'_>, scene: &Scene) {
    let sample = &scene.sample;
    if let Some(walls) = scene.shear() {
        let farthest = walls.origin.file().map_or(0.0, |file| file.farthest);
        let height = farthest.max(walls.height(sample));
        let keys = [&[&SAMPLE.packing][..], &WAYS].concat();
        check_rounding(c, sample, height, walls.load.stiffness_number, &keys);
    }
    if let Some(strain) = &scene.stages.strain
        && let Some(least) = strain.least_pressure()
    {
        let most = derived::STIFFNESS_NUMBER_MAX;
        let kappa = match derived::stiffness_number(&scene.law, sample, least) {
            Some(kappa) => kappa,
            None if derived::pressure(&scene.law, sample, most) > least => most,
            // Overlaps beyond those of the least κ.
            None => return,
        };
        let keys = [&AQS.pressures, &AQS.pressure];
        let [_, _, height] = strain.lengths(sample);
        check_rounding(c, sample, height, kappa, &keys);
    }
}

/// Refuses coordinates up to this height (m) and the lengths of the cell, at this κ, whose rounding
/// is too coarse; `keys` set them.
fn check_rounding(c: &mut Checker<'_>, sample: &Sample, height: f64, kappa: f64, keys: &[&Key]) {
    let lengths = [height, sample.length, sample.width];
    let lengths = lengths.into_iter().filter(|x| x.is_finite());
    let farthest = lengths.fold(0.0, f64::max);
    let overlap = sample.mean_diameter / kappa;
    let rounding = 0.5 * f64::EPSILON * farthest;
    // How many times too coarse.
    let coarse = rounding / (FINEST * overlap);
    if coarse > 1.0 {
        let what = format!(
            "coordinates up to {farthest:.1e} are rounded by {rounding:.1e}, more than {FINEST:e} of the mean overlap of {overlap:.1e}; give coordinates up to {:.1e}, or a load that presses grains together by {:.1e} or more (a stiffness number of at most {:.1e})",
            farthest / coarse,
            overlap * coarse,
            kappa / coarse,
        );
        c.refuse_among(keys, &what);
    }
}

/// What the drive does in a part of the shear.
struct DrivePart {
    /// Its number, for the messages; empty of a shear without parts.
    name: String,
    /// The greatest speed (m/s).
    speed: f64,
    steps: f64,
}

/// The keys that set the rate of the shear.
static RATE: [&Key; 3] = [&SHEAR.protocol, &SHEAR.velocity, &SHEAR.inertial_number];

fn check_shear(c: &mut Checker<'_>, scene: &Scene, walls: &PlaneShear) {
    let height = walls.height(&scene.sample) - walls.thickness_of_walls(&scene.sample);
    let schedule = Schedule::new(scene, walls, height);
    let step = scene.time_step.step;
    let parts: Vec<DrivePart> = match &walls.shear.motion {
        Motion::Strain { ramp, strain, .. } => {
            let speed = schedule.protocol.segment(0).velocity().unwrap_or(0.0);
            vec![DrivePart {
                name: String::new(),
                speed,
                // A ramp is at most so much behind.
                steps: (strain * height / speed + ramp) / step,
            }]
        }
        Motion::Protocol(parts) => {
            let parts = parts.iter().enumerate();
            parts
                .map(|(n, part)| DrivePart {
                    name: format!("part {}: ", n + 1),
                    speed: part.speed(height),
                    steps: part.time / step,
                })
                .collect()
        }
    };
    let refused = check_speeds(scene, walls, &parts)
        .map_err(|what| (&RATE[..], what))
        .and_then(|()| {
            check_waves(scene, walls).map_err(|what| (&RATE[..1], what))?;
            check_steps(&parts, step).map_err(|what| (&LENGTH[..], what))
        });
    match refused {
        Ok(()) => check_output(c, scene, &schedule),
        Err((keys, what)) => c.refuse_among(keys, &what),
    }
}

/// Refuses steps of the drive that leave the cell or the skin of the neighbour list.
fn check_speeds(scene: &Scene, walls: &PlaneShear, parts: &[DrivePart]) -> Result<(), String> {
    let (sample, step) = (&scene.sample, scene.time_step.step);
    for DrivePart { name, speed, .. } in parts {
        let distance = speed * step;
        // NaN is too long.
        let is_short = distance <= sample.length;
        if !is_short {
            return Err(format!(
                "{name}moves the drive by {distance:.1e} m in a time step of {step:.1e} s, further than the cell is long, {:.1e} m; give a lower rate",
                sample.length
            ));
        }
    }
    // How far a spring moves the wall is not known before.
    if walls.shear.spring.is_some() {
        return Ok(());
    }
    // The greatest step of a wall that the list of pairs allows.
    let given = scene.bookkeeping.list.skin;
    let half = 0.5 * given.unwrap_or(THICKEST_SKIN) * sample.mean_diameter;
    let too_fast = parts.iter().find(|part| part.speed * step > half);
    match too_fast {
        Some(DrivePart { name, speed, .. }) => Err(format!(
            "{name}moves the wall by {:.1e} m in a time step of {step:.1e} s, further than {half:.1e} m, half the skin of the neighbour list; give a lower rate, or a smaller time.step{}",
            speed * step,
            if given.is_some() {
                ", or a greater bookkeeping.skin"
            } else {
                ""
            }
        )),
        None => Ok(()),
    }
}

/// Refuses parts of a protocol that a time step does not resolve.
fn check_waves(scene: &Scene, walls: &PlaneShear) -> Result<(), String> {
    let (sample, step) = (&scene.sample, scene.time_step.step);
    let Motion::Protocol(parts) = &walls.shear.motion else {
        return Ok(());
    };
    for (n, part) in parts.iter().enumerate() {
        let n = n + 1;
        let fastest = part.highest_frequency();
        let least = LEAST_STEPS_OF_A_CYCLE;
        if fastest * step * least > 1.0 {
            return Err(format!(
                "part {n}: a cycle of {} Hz takes {:.1} time steps of {step:.1e} s, fewer than {least}; give a lower frequency",
                show(fastest),
                1.0 / (fastest * step)
            ));
        }
        let vertical = match part.imposed.normal {
            Some(Normal::Velocity(velocity)) => velocity.abs() * step,
            _ => 0.0,
        };
        let bottom = part.imposed.bottom;
        let vibration = bottom.normal.map_or(0.0, |wave| wave.amplitude);
        let along = bottom.along.map_or(0.0, |wave| wave.fastest() * step);
        for (name, distance) in [
            ("wall_velocity", vertical),
            ("bottom_amplitude", vibration),
            ("bottom_amplitude_x", along),
        ] {
            if distance > sample.mean_diameter {
                return Err(format!(
                    "part {n}: {name} moves a wall by {distance:.1e} m, more than a mean diameter of {:.1e} m, in a step or a cycle; give less",
                    sample.mean_diameter
                ));
            }
        }
    }
    Ok(())
}

/// The keys that set how many steps the shear takes.
static LENGTH: [&Key; 3] = [&SHEAR.strain, &SHEAR.protocol, &TIME.step];

/// Refuses more steps than are counted.
fn check_steps(parts: &[DrivePart], step: f64) -> Result<(), String> {
    let steps: f64 = parts.iter().map(|part| part.steps).sum();
    // NaN is no number of steps.
    if steps <= MOST_STEPS as f64 {
        return Ok(());
    }
    let number = if steps.is_finite() {
        format!("{steps:.1e}")
    } else {
        "over 1e308".into()
    };
    Err(format!(
        "the shear takes {number} steps of {step:.1e} s, more than the {:.1e} that are counted; give less of it, a higher rate, or another time.step",
        MOST_STEPS as f64
    ))
}

/// Refuses more output of the shear than any disk holds.
fn check_output(c: &mut Checker<'_>, scene: &Scene, schedule: &Schedule) {
    let counts = schedule.counts(schedule.total);
    let keys = [&OUTPUT.frame_strain, &OUTPUT.frame_rows];
    Record::frame(scene).check(c, &keys, counts.frames as f64);
    let keys = [&OUTPUT.series_strain, &OUTPUT.series_rows];
    ROW.check(c, &keys, counts.rows as f64);
}

fn check_strain(c: &mut Checker<'_>, scene: &Scene, strain: &QuasiStatic) {
    let aqs = &strain.aqs;
    if aqs.steps > MOST_STEPS {
        let what = format!(
            "must be at most {MOST_STEPS}, which is as far as steps are counted, found {}",
            aqs.steps
        );
        c.refuse(&AQS.steps, &what);
        return;
    }
    // Floats between two others run out.
    let least = 1e-15 * aqs.strain_step;
    if aqs.spectrum && aqs.birth_precision < least {
        let what = format!(
            "must be at least 1e-15 aqs.strain_step = {least:.1e}, as strains are no more precise, found {}",
            show(aqs.birth_precision)
        );
        c.refuse(&AQS.birth_precision, &what);
    }
    ROW.check(c, &[&AQS.steps], aqs.steps as f64);
    let frames = aqs.steps.checked_div(aqs.frame_every).unwrap_or(0) as f64;
    Record::frame(scene).check(c, &[&AQS.frame_every], frames);
}

fn check_newtonian(c: &mut Checker<'_>, scene: &Scene, newtonian: &Newtonian) {
    let longest = MOST_STEPS as f64 / STEPS_WITHOUT_A_PAIR;
    if newtonian.growth_times > longest {
        let what = format!(
            "must be at most {longest:.3e}, as steps are counted up to {:.1e}, found {}",
            MOST_STEPS as f64,
            show(newtonian.growth_times)
        );
        c.refuse(&NEWTONIAN.growth_times, &what);
    }
    // No more than one in each step.
    let most = newtonian.growth_times * STEPS_WITHOUT_A_PAIR;
    let rows = (newtonian.rows as f64).min(most);
    ROW.check(c, &[&NEWTONIAN.rows], rows);
    let frames = (newtonian.frames as f64).min(most);
    Record::frame(scene).check(c, &[&NEWTONIAN.frames], frames);
}
