//! The tables of plane shear between walls.

use super::lines::Lines;
use crate::raw;
use crate::scene::{
    Control, Dimensions, Load, LoadChoice, Motion, Part, PartDrive, PartLength, PartNormal,
    PlaneShear, Scene, Stress, WallSpeed,
};
use crate::words::show;

/// What follows from the keys, in comments.
pub(super) fn derived(t: &mut Lines, scene: &Scene, walls: &PlaneShear) {
    for (symbol, value, unit) in scene.law.derived() {
        t.derived(symbol, value, unit);
    }
    t.derived("pressure P", walls.load.pressure, "Pa");
    let [of_force, of_stiffness] = match scene.dimension {
        Dimensions::Two => ["N/m", "Pa"],
        Dimensions::Three => ["N", "N/m"],
    };
    t.derived("normal force N", walls.load.normal_force, of_force);
    if let Some(spring) = walls.shear.spring {
        t.derived("stiffness of the spring k", spring.stiffness, of_stiffness);
        let number = spring.stiffness * scene.sample.mean_diameter / walls.load.normal_force;
        t.derived("spring number k d/N", number, "");
    }
    t.derived("stiffness number kappa", walls.load.stiffness_number, "");
    t.derived("time step", scene.time_step.step, "s");
    t.derived(
        "stability limit of the time step",
        scene.time_step.limit,
        "s",
    );
}

pub(super) fn load(t: &mut Lines, load: &Load) {
    let keys: raw::Load = t.table();
    match load.given {
        LoadChoice::StiffnessNumber => t.number(&keys.stiffness_number, load.stiffness_number),
        LoadChoice::Pressure => t.number(&keys.pressure, load.pressure),
        LoadChoice::NormalForce => t.number(&keys.normal_force, load.normal_force),
    }
    t.number(&keys.gravity, load.gravity);
    match load.control {
        Control::Mass => t.text(&keys.control, Control::NAMES[0].0),
        Control::Servo { gain, speed_max } => {
            t.text(&keys.control, Control::NAMES[1].0);
            t.number(&keys.servo_gain, gain);
            t.number(&keys.servo_speed_max, speed_max);
        }
    }
}

/// The keys of a part and their values.
fn part_values(part: &Part) -> Vec<(&'static str, f64)> {
    let mut values = Vec::new();
    match part.drive {
        PartDrive::Velocity(velocity) => values.push(("velocity", velocity)),
        PartDrive::Strain(of) => {
            values.extend([
                ("strain_amplitude", of.amplitude),
                ("frequency", of.frequency),
            ]);
        }
        PartDrive::Stress(Stress { start, end, wave }) => {
            values.extend(start.map(|x| ("shear_stress", x)));
            values.extend(end.map(|x| ("shear_stress_end", x)));
            if let Some(of) = wave {
                let amplitude = ("shear_stress_amplitude", of.amplitude);
                values.extend([amplitude, ("frequency", of.frequency)]);
            }
        }
    }
    values.push(match part.length {
        PartLength::Time => ("time", part.time),
        PartLength::Distance(distance) => ("distance", distance),
        PartLength::Cycles(cycles) => ("cycles", cycles),
    });
    match part.normal {
        PartNormal::Velocity(velocity) => values.push(("wall_velocity", velocity)),
        PartNormal::Pressure(Stress { start, end, wave }) => {
            values.extend(start.map(|x| ("pressure", x)));
            values.extend(end.map(|x| ("pressure_end", x)));
            if let Some(of) = wave {
                let amplitude = ("pressure_amplitude", of.amplitude);
                values.extend([amplitude, ("pressure_frequency", of.frequency)]);
            }
        }
    }
    if let Some(of) = part.bottom {
        let amplitude = ("bottom_amplitude", of.amplitude);
        values.extend([amplitude, ("bottom_frequency", of.frequency)]);
    }
    values
}

/// `[pack]`, `[shear]`, `[output]` and `[analysis]`.
pub(super) fn stages(t: &mut Lines, walls: &PlaneShear, keep_checkpoints: bool) {
    let keys: raw::Pack = t.table();
    t.flag(&keys.skip, walls.pack.skip);
    if !walls.pack.skip {
        t.number(&keys.friction, walls.pack.friction);
        t.number(&keys.drag, walls.pack.drag);
        t.number(&keys.tolerance, walls.pack.tolerance);
        t.whole(&keys.max_steps, walls.pack.max_steps);
    }

    let keys: raw::Shear = t.table();
    if let Some(spring) = walls.shear.spring {
        match spring.number {
            Some(number) => t.number(&keys.spring_number, number),
            None => t.number(&keys.spring_stiffness, spring.stiffness),
        }
    }
    match &walls.shear.motion {
        Motion::Strain { drive, strain } => {
            match drive {
                WallSpeed::InertialNumber(i) => t.number(&keys.inertial_number, *i),
                WallSpeed::Velocity(v) => t.number(&keys.velocity, *v),
            }
            t.number(&keys.strain, *strain);
        }
        Motion::Protocol(parts) => {
            let mut list = String::from("[\n");
            for part in parts {
                let values: Vec<String> = part_values(part)
                    .into_iter()
                    .map(|(name, x)| format!("{name} = {}", show(x)))
                    .collect();
                list += &format!("    {{ {} }},\n", values.join(", "));
            }
            t.give(&keys.protocol, &(list + "]"));
        }
    }

    let keys: raw::Output = t.table();
    let output = &walls.output;
    match walls.shear.motion {
        Motion::Strain { .. } => {
            t.number(&keys.frame_strain, output.frame_strain);
            t.number(&keys.frame_start, output.frame_start);
            t.number(&keys.series_strain, output.series_strain);
            t.number(&keys.checkpoint_strain, output.checkpoint_strain);
        }
        Motion::Protocol(_) => {
            t.whole(&keys.frame_rows, output.frame_rows);
            t.whole(&keys.series_rows, output.series_rows);
        }
    }
    t.flag(&keys.keep_checkpoints, keep_checkpoints);
    t.whole(&keys.progress_lines, output.progress_lines);
    t.flag(&keys.energy, output.energy);

    let keys: raw::Analysis = t.table();
    t.flag(&keys.scalars, walls.analysis.scalars);
    if let Motion::Strain { .. } = walls.shear.motion {
        if walls.analysis.strain > 0.0 {
            t.number(&keys.strain, walls.analysis.strain);
        }
        t.number(&keys.start, walls.analysis.start);
    }
}
