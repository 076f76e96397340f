//! What a run of the scene takes: steps that can be counted, and files that a disk can hold.

use crate::checker::Checker;
use crate::derived;
use crate::raw::Raw;
use crate::scene::{
    Boundary, Motion, Origin, Part, PartDrive, PartNormal, PeriodicBox, PlaneShear, Scene,
};
use crate::schedule::{MOST_STEPS, STEPS_WITHOUT_A_PAIR, Schedule};
use crate::words::show;
use gshear_dem::failure::Failure;
use gshear_dem::system::THICKEST_SKIN;
use std::f64::consts::TAU;

/// Bytes of a grain in a frame, and of a row of the time series, at least.
const FRAME_BYTES: f64 = 50.0;
const ROW_BYTES: f64 = 100.0;
/// Time steps of a cycle, at least.
const LEAST_STEPS_OF_A_CYCLE: f64 = 20.0;
/// Greatest rounding of a coordinate over the mean overlap.
const FINEST: f64 = 1e-6;
/// Bytes that a run may write: a petabyte.
const MOST_BYTES: f64 = 1e15;

/// Refuses a scene whose run could not end, or whose coordinates do not resolve its overlaps.
pub(super) fn check(c: &mut Checker<'_>, raw: &Raw, scene: &Scene) -> Result<(), Failure> {
    resolution(c, raw, scene);
    match &scene.boundary {
        Boundary::Walls(walls) => of_walls(c, raw, scene, walls),
        Boundary::Periodic(periodic) => of_a_box(c, raw, scene, periodic),
    }
    c.settle()
}

/// Refuses coordinates whose rounding is more than a millionth of the least mean overlap: contacts
/// would be lost, or their forces be those of other overlaps. Coordinates along the periodic axes stay in
/// the cell however far grains move. Of a box without a pressure the overlaps are not known before.
fn resolution(c: &mut Checker<'_>, raw: &Raw, scene: &Scene) {
    let sample = &scene.sample;
    let (height, kappa, places) = match &scene.boundary {
        Boundary::Walls(walls) => {
            let height = match &walls.origin {
                Origin::Insertion(_) => derived::packed_height(sample),
                Origin::Packing { file, .. } => file.farthest.max(file.height()),
            };
            let load = [
                raw.load.stiffness_number.place(),
                raw.load.pressure.place(),
                raw.load.normal_force.place(),
            ];
            let places = std::iter::once(raw.sample.packing.place()).chain(load);
            let kappa = walls.load.stiffness_number;
            (height, kappa, places.collect::<Vec<_>>())
        }
        Boundary::Periodic(periodic) => {
            let Some(least) = periodic.least_pressure() else {
                return;
            };
            let most = derived::STIFFNESS_NUMBER_MAX;
            let kappa = match derived::stiffness_number(&scene.law, sample, least) {
                Some(kappa) => kappa,
                None if derived::pressure(&scene.law, sample, most) > least => most,
                // Overlaps beyond those of the least κ.
                None => return,
            };
            let places = vec![raw.aqs.pressures.place(), raw.r#box.pressure.place()];
            (sample.length, kappa, places)
        }
    };
    let lengths = [height, sample.length, sample.width];
    let lengths = lengths.into_iter().filter(|x| x.is_finite());
    let farthest = lengths.fold(0.0, f64::max);
    let overlap = sample.mean_diameter / kappa;
    let rounding = 0.5 * f64::EPSILON * farthest;
    // How many times too coarse.
    let coarse = rounding / (FINEST * overlap);
    if coarse > 1.0 {
        c.refuse_among(
            &places,
            &format!(
                "coordinates up to {farthest:.1e} are rounded by {rounding:.1e}, more than {FINEST:e} of the mean overlap of {overlap:.1e}; give coordinates up to {:.1e}, or a load that presses grains together by {:.1e} or more (a stiffness number of at most {:.1e})",
                farthest / coarse,
                overlap * coarse,
                kappa / coarse,
            ),
        );
    }
}

fn of_walls(c: &mut Checker<'_>, raw: &Raw, scene: &Scene, walls: &PlaneShear) {
    let sample = &scene.sample;
    let height = match &walls.origin {
        Origin::Insertion(_) => derived::packed_height(sample),
        Origin::Packing { file, .. } => file.height(),
    };
    let height = height - 2.0 * walls.wall_thickness(sample);
    let (shear, output) = (&raw.shear, &raw.output);
    let schedule = Schedule::new(scene, walls, height);
    let step = scene.time_step.step;
    // Of every part, with its number for the messages.
    let parts: Vec<(String, f64, f64)> = match &walls.shear.motion {
        Motion::Strain { strain, .. } => {
            let speed = schedule.protocol.velocity(0);
            vec![(String::new(), speed, strain * height / speed / step)]
        }
        Motion::Protocol(parts) => {
            let part = |(n, part): (usize, &Part)| {
                let speed = match part.drive {
                    PartDrive::Velocity(velocity) => velocity,
                    PartDrive::Strain(of) => TAU * of.frequency * of.amplitude * height,
                    PartDrive::Stress(_) => 0.0,
                };
                (format!("part {}: ", n + 1), speed, part.time / step)
            };
            parts.iter().enumerate().map(part).collect()
        }
    };
    let rate = [
        shear.protocol.place(),
        shear.velocity.place(),
        shear.inertial_number.place(),
    ];
    for (part, speed, _) in &parts {
        let way = speed * step;
        let is_short = way <= sample.length;
        if !is_short {
            let what = format!(
                "{part}moves the drive by {way:.1e} m in a time step of {step:.1e} s, further than the cell is long, {:.1e} m; give a lower rate",
                sample.length
            );
            c.refuse_among(&rate, &what);
            return;
        }
    }
    // The greatest step of a wall that the list of pairs allows. A spring moves it as it likes.
    let given = scene.bookkeeping.list.skin;
    let half = 0.5 * given.unwrap_or(THICKEST_SKIN) * sample.mean_diameter;
    let too_fast = |(_, speed, _): &&(String, f64, f64)| speed * step > half;
    if walls.shear.spring.is_none()
        && let Some((part, speed, _)) = parts.iter().find(too_fast)
    {
        let greater = match given {
            Some(_) => ", or a greater bookkeeping.skin",
            None => "",
        };
        let what = format!(
            "{part}moves the wall by {:.1e} m in a time step of {step:.1e} s, further than {half:.1e} m, half the skin of the neighbour list; give a lower rate, or a smaller time.step{greater}",
            speed * step
        );
        c.refuse_among(&rate, &what);
        return;
    }
    if let Motion::Protocol(parts) = &walls.shear.motion {
        for (n, part) in parts.iter().enumerate() {
            let fastest = part
                .oscillations()
                .map(|of| of.frequency)
                .fold(0.0, f64::max);
            let least = LEAST_STEPS_OF_A_CYCLE;
            if fastest * step * least > 1.0 {
                let what = format!(
                    "part {}: a cycle of {} Hz takes {:.1} time steps of {step:.1e} s, fewer than {least}; give a lower frequency",
                    n + 1,
                    show(fastest),
                    1.0 / (fastest * step)
                );
                c.refuse(&shear.protocol, &what);
                return;
            }
            let vertical = match part.normal {
                PartNormal::Velocity(velocity) => velocity.abs() * step,
                PartNormal::Pressure(_) => 0.0,
            };
            let vibration = part.bottom.map_or(0.0, |of| of.amplitude);
            for (name, way) in [("wall_velocity", vertical), ("bottom_amplitude", vibration)] {
                if way > sample.mean_diameter {
                    let what = format!(
                        "part {}: {name} moves a wall by {way:.1e} m, more than a mean diameter of {:.1e} m, in a step or a cycle; give less",
                        n + 1,
                        sample.mean_diameter
                    );
                    c.refuse(&shear.protocol, &what);
                    return;
                }
            }
        }
    }
    let steps: f64 = parts.iter().map(|(_, _, steps)| steps).sum();
    // NaN is no number of steps.
    let counted = steps <= MOST_STEPS as f64;
    if !counted {
        let number = match steps.is_finite() {
            true => format!("{steps:.1e}"),
            false => "over 1e308".into(),
        };
        let places = [
            shear.strain.place(),
            shear.protocol.place(),
            raw.time.step.place(),
        ];
        c.refuse_among(
            &places,
            &format!(
                "the shear takes {number} steps of {step:.1e} s, more than the {:.1e} that are counted; give less of it, a higher rate, or another time.step",
                MOST_STEPS as f64
            ),
        );
        return;
    }
    let count = |every: fn(&crate::schedule::Intervals) -> u64, first: u64| -> f64 {
        let segments = schedule.protocol.segments().iter().zip(&schedule.intervals);
        let of_segment = |(segment, intervals): (&gshear_dem::protocol::Segment, _)| {
            let steps = segment.steps.saturating_sub(first);
            steps.checked_div(every(intervals)).unwrap_or(0) as f64
        };
        segments.map(of_segment).sum()
    };
    let frames = count(|s| s.frames, schedule.first_frame);
    let rows = count(|s| s.series, 0);
    let of_frames = [output.frame_strain.place(), output.frame_rows.place()];
    written(
        c,
        &of_frames,
        frames,
        "frames",
        f64::from(sample.grains) * FRAME_BYTES,
    );
    let of_rows = [output.series_strain.place(), output.series_rows.place()];
    written(c, &of_rows, rows, "rows of the time series", ROW_BYTES);
}

fn of_a_box(c: &mut Checker<'_>, raw: &Raw, scene: &Scene, periodic: &PeriodicBox) {
    let aqs = &periodic.aqs;
    let frame = f64::from(scene.sample.grains) * FRAME_BYTES;
    if aqs.steps > MOST_STEPS {
        let what = format!(
            "must be at most {MOST_STEPS}, which is as far as steps are counted, found {}",
            aqs.steps
        );
        c.refuse(&raw.aqs.steps, &what);
        return;
    }
    // Floats between two others run out.
    let least = 1e-15 * aqs.strain_step;
    if aqs.spectrum && aqs.birth_precision < least {
        let what = format!(
            "must be at least 1e-15 aqs.strain_step = {least:.1e}, as strains are no more precise, found {}",
            show(aqs.birth_precision)
        );
        c.refuse(&raw.aqs.birth_precision, &what);
    }
    written(
        c,
        &[raw.aqs.steps.place()],
        aqs.steps as f64,
        "rows of the time series",
        ROW_BYTES,
    );
    let frames = aqs.steps.checked_div(aqs.frame_every).unwrap_or(0) as f64;
    written(c, &[raw.aqs.frame_every.place()], frames, "frames", frame);
    let Some(newtonian) = &periodic.newtonian else {
        return;
    };
    let longest = MOST_STEPS as f64 / STEPS_WITHOUT_A_PAIR;
    if newtonian.growth_times > longest {
        let what = format!(
            "must be at most {longest:.3e}, as steps are counted up to {:.1e}, found {}",
            MOST_STEPS as f64,
            show(newtonian.growth_times)
        );
        c.refuse(&raw.newtonian.growth_times, &what);
    }
    // No more than one in each step.
    let most = newtonian.growth_times * STEPS_WITHOUT_A_PAIR;
    let at_most = |count: u64| (count as f64).min(most);
    written(
        c,
        &[raw.newtonian.rows.place()],
        at_most(newtonian.rows),
        "rows of the time series",
        ROW_BYTES,
    );
    written(
        c,
        &[raw.newtonian.frames.place()],
        at_most(newtonian.frames),
        "frames",
        frame,
    );
}

/// Refuses more output than any disk holds.
fn written(
    c: &mut Checker<'_>,
    places: &[(&'static str, Option<usize>)],
    count: f64,
    what: &str,
    bytes: f64,
) {
    if count * bytes > MOST_BYTES {
        c.refuse_among(
            places,
            &format!(
                "asks for {count:.1e} {what}, at least {:.1e} bytes, more than the {MOST_BYTES:.0e} bytes that a run may write; give fewer",
                count * bytes
            ),
        );
    }
}
