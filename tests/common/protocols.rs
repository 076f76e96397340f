//! Scenes with one part of every kind of a protocol.

use std::path::Path;

use gshear_scene::schedule::Schedule;
use gshear_scene::{Source, load};

use super::crossing::{PACKED, SCENE};
use super::{Outcome, gshear_mpi};

/// A scene with one part of every kind. Parts without a key of the pressure keep that before them.
pub struct Case {
    pub scene: &'static str,
    /// What the scene begins with, if it is not its own sample.
    pub sample: &'static [&'static str],
    /// Keys that another way to shear needs.
    pub removed: &'static [&'static str],
    pub further: &'static [&'static str],
    pub parts: &'static [&'static str],
}

pub const DISKS: Case = Case {
    scene: SCENE,
    sample: &PACKED,
    removed: &[
        "shear.inertial_number",
        "shear.strain",
        "output.frame_strain",
        "output.series_strain",
        "output.checkpoint_strain",
    ],
    further: &["output.series_rows=10", "output.frame_rows=1"],
    parts: &[
        "velocity = 0.3, time = 1e-7",
        "velocity = -0.3, ramp = 6e-8, time = 1e-7, pressure = 7e5",
        "velocity = 0.3, time = 1e-7, pressure = 5e5, pressure_end = 8e5",
        "velocity = 0.3, time = 1e-7, pressure = 6e5, pressure_amplitude = 2e5, pressure_frequency = 2e7",
        "velocity = 0.3, time = 1e-7, wall_velocity = 0",
        "velocity = 0.3, time = 1e-7, wall_velocity = -0.02",
        "strain_amplitude = 0.002, frequency = 1e7, cycles = 1.25, pressure = 6e5",
        "strain_amplitude = 0.002, frequency = 1e7, cycles = 1.25, wall_velocity = 0",
        "shear_stress = 2e5, time = 1e-7, pressure = 6e5",
        "shear_stress = 2e5, shear_stress_end = -1e5, time = 1e-7",
        "shear_stress = 0, shear_stress_amplitude = 2e5, frequency = 1e7, cycles = 1.25",
        "velocity = 0.3, time = 1e-7, bottom_amplitude = 2e-9, bottom_frequency = 1e7",
        "velocity = 0.3, time = 1e-7, bottom_amplitude_x = 5e-9, bottom_frequency_x = 2e7",
        "velocity = 0.3, time = 1e-7, bottom_amplitude_x = 5e-9, bottom_frequency_x = 2e7, bottom_phase_x = 60, bottom_amplitude = 2e-9, bottom_frequency = 1e7",
        "velocity = 0, time = 5e-8",
    ],
};

pub const SPHERES: Case = Case {
    scene: concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing-3d.toml"),
    sample: &[],
    removed: &["shear.spring_number"],
    further: &["output.series_rows=10", "output.frame_rows=1"],
    parts: &[
        "velocity = 3, ramp = 7e-5, time = 1e-4",
        "velocity = 3, time = 1e-4, pressure = 1.2e5",
        "velocity = 3, time = 1e-4, pressure = 8e4, pressure_end = 1.2e5",
        "velocity = 3, time = 1e-4, pressure = 1e5, pressure_amplitude = 3e4, pressure_frequency = 2e4",
        "velocity = 3, time = 1e-4, wall_velocity = 0",
        "velocity = 3, time = 1e-4, wall_velocity = -0.1",
        "strain_amplitude = 0.003, frequency = 1e4, cycles = 1.25, pressure = 1e5",
        "strain_amplitude = 0.003, frequency = 1e4, cycles = 1.25, wall_velocity = 0",
        "shear_stress = 3e4, time = 1e-4, pressure = 1e5",
        "shear_stress = 3e4, shear_stress_end = -2e4, time = 1e-4",
        "shear_stress = 0, shear_stress_amplitude = 3e4, frequency = 1e4, cycles = 1.25",
        "velocity = 3, time = 1e-4, bottom_amplitude = 1e-5, bottom_frequency = 1e4",
        "velocity = 3, time = 1e-4, bottom_amplitude_x = 2e-5, bottom_frequency_x = 2e4, bottom_phase_x = 90, bottom_amplitude = 1e-5, bottom_frequency = 1e4",
        "velocity = 0, time = 5e-5",
    ],
};

/// Between flat walls.
pub const SPHERES_BETWEEN_FLAT_WALLS: Case = Case {
    sample: &["sample.walls=flat"],
    parts: &[
        "velocity = 3, time = 1e-4",
        "velocity = -3, ramp = 8e-5, time = 1e-4, pressure = 8e4, pressure_end = 1.2e5",
        "velocity = 3, time = 1e-4, wall_velocity = -0.1",
        "shear_stress = 1e4, time = 1e-4, pressure = 1e5, bottom_amplitude = 1e-5, bottom_frequency = 1e4",
        "velocity = 3, time = 1e-4, bottom_amplitude_x = 2e-5, bottom_frequency_x = 2e4",
    ],
    ..SPHERES
};

/// A plate on a bottom of grains.
pub const SPHERES_UNDER_A_FLAT_TOP: Case = Case {
    sample: &["sample.walls=flat-top"],
    ..SPHERES_BETWEEN_FLAT_WALLS
};

/// All that a spring allows: what moves is its far end.
pub const SPHERES_UNDER_A_SPRING: Case = Case {
    removed: &[],
    parts: &[
        "velocity = 3, ramp = 7e-5, time = 1e-4",
        "velocity = 3, time = 1e-4, pressure = 8e4, pressure_end = 1.2e5",
        "velocity = 3, time = 1e-4, pressure = 1e5, pressure_amplitude = 3e4, pressure_frequency = 2e4",
        "strain_amplitude = 0.003, frequency = 1e4, cycles = 1.25, pressure = 1e5",
        "strain_amplitude = 0.003, frequency = 1e4, cycles = 1.25, wall_velocity = 0",
        "velocity = 3, time = 1e-4, bottom_amplitude = 1e-5, bottom_frequency = 1e4, pressure = 1e5",
        "velocity = 3, time = 1e-4, bottom_amplitude_x = 2e-5, bottom_frequency_x = 2e4",
    ],
    ..SPHERES
};

/// Loads by a servo, which packs them, too, and what may interrupt them.
pub const DISKS_UNDER_A_SERVO: Case = Case {
    sample: &[],
    further: &[
        "output.series_rows=40",
        "output.frame_rows=40",
        "output.keep_checkpoints=true",
        "load.control=servo",
    ],
    parts: &[
        "velocity = 0.3, time = 1e-7",
        "velocity = 0.3, time = 1e-7, pressure = 5e5, pressure_end = 8e5",
        "velocity = 0.3, time = 1e-7, wall_velocity = 0",
        "shear_stress = 2e5, time = 1e-7, pressure = 6e5",
    ],
    ..DISKS
};

/// A servo between walls whose protocol has velocities only.
pub const SPHERES_UNDER_A_SERVO: Case = Case {
    removed: &[],
    further: &[
        "output.series_rows=40",
        "output.frame_rows=40",
        "output.keep_checkpoints=true",
        "load.control=servo",
    ],
    parts: &[
        "velocity = 3, time = 1e-4",
        "velocity = 0, time = 1e-4",
        "velocity = 3, time = 1e-4",
    ],
    ..SPHERES
};

/// All that a cell without walls allows.
pub const DISKS_WITHOUT_WALLS: Case = Case {
    sample: &["sample.boundary=periodic"],
    parts: &[
        "velocity = 3, time = 4e-6",
        "velocity = -3, ramp = 6e-8, time = 1e-7, pressure = 7e5",
        "velocity = 0.3, time = 1e-7, pressure = 5e5, pressure_end = 8e5",
        "velocity = 0.3, time = 1e-7, pressure = 6e5, pressure_amplitude = 2e5, pressure_frequency = 2e7",
        "velocity = 0.3, time = 1e-7, wall_velocity = 0",
        "velocity = 0.3, time = 1e-7, wall_velocity = -0.02",
        "strain_amplitude = 0.002, frequency = 1e7, cycles = 1.25, pressure = 6e5",
        "strain_amplitude = 0.002, frequency = 1e7, cycles = 1.25, wall_velocity = 0",
        "shear_stress = 2e5, time = 1e-7, pressure = 6e5",
        "shear_stress = 2e5, shear_stress_end = -1e5, time = 1e-7",
        "shear_stress = 0, shear_stress_amplitude = 2e5, frequency = 1e7, cycles = 1.25",
        "velocity = 0, time = 5e-8",
    ],
    ..DISKS
};

/// Disks without walls in a cell whose length changes as well, over the seam.
pub const DISKS_IN_A_CHANGING_CELL: Case = Case {
    parts: &[
        "velocity = 3, time = 4e-6, stress_xx = 2e5",
        "velocity = -3, ramp = 6e-8, time = 1e-7, pressure = 3e5, stress_xx = 2e5, stress_xx_end = 4e5",
        "velocity = 0.3, time = 1e-7, mean_pressure = 6e5",
        "velocity = 0.3, time = 1e-7, mean_pressure = 6e5, mean_pressure_end = 8e5",
        "velocity = 0.3, time = 1e-7, pressure = 6e5",
        "velocity = 0.3, time = 1e-7, strain_xx = 0.01",
        "velocity = 0.3, time = 1e-7, wall_velocity = -0.02, strain_xx = -0.01",
        "shear_stress = 2e5, time = 1e-7, stress_xx = 6e5, pressure = 6e5",
        "strain_amplitude = 0.002, frequency = 1e7, cycles = 1.25, mean_pressure = 6e5",
    ],
    ..DISKS_WITHOUT_WALLS
};

/// Spheres in it, under a spring.
pub const SPHERES_WITHOUT_WALLS: Case = Case {
    sample: &[
        "sample.boundary=periodic",
        "load.gravity=none",
        "sample.packing=none",
        "sample.grains=220",
        "sample.radius_min=0.8e-3",
        "sample.radius_max=1.2e-3",
        "sample.length=12e-3",
        "sample.width=10e-3",
        "pack.skip=none",
        "pack.tolerance=1e-3",
    ],
    parts: &[
        "velocity = 8, time = 1e-3",
        "velocity = 3, time = 1e-4, pressure = 8e4, pressure_end = 1.2e5",
        "velocity = -3, time = 1e-4, pressure = 1e5, pressure_amplitude = 3e4, pressure_frequency = 2e4",
        "strain_amplitude = 0.003, frequency = 1e4, cycles = 1.25, pressure = 1e5",
        "strain_amplitude = 0.003, frequency = 1e4, cycles = 1.25, wall_velocity = 0",
    ],
    ..SPHERES_UNDER_A_SPRING
};

/// Spheres without walls in a cell whose length and width change as well, by a servo.
pub const SPHERES_IN_A_CHANGING_CELL: Case = Case {
    parts: &[
        "velocity = 8, time = 1e-3, stress_xx = 1.1e5, stress_yy = 9e4",
        "velocity = 3, time = 1e-4, pressure = 8e4, pressure_end = 1.2e5, strain_yy = 0.002",
        "velocity = -3, time = 1e-4, mean_pressure = 1e5",
        "velocity = 3, time = 1e-4, wall_velocity = 0, strain_xx = 0.002, stress_yy = 1e5",
    ],
    ..SPHERES_WITHOUT_WALLS_UNDER_A_SERVO
};

/// The same under the servo.
pub const SPHERES_WITHOUT_WALLS_UNDER_A_SERVO: Case = Case {
    sample: SPHERES_WITHOUT_WALLS.sample,
    further: &[
        "output.series_rows=40",
        "output.frame_rows=40",
        "output.keep_checkpoints=true",
        "load.control=servo",
        "time.step=2.5e-7",
    ],
    ..SPHERES_UNDER_A_SERVO
};

/// All that a free surface allows, on a slope on which disks flow over the seam.
pub const DISKS_BELOW_A_FREE_SURFACE: Case = Case {
    further: &[
        "output.series_rows=10",
        "output.frame_rows=1",
        "sample.boundary=free",
        "load.stiffness_number=none",
        "load.gravity=1.3e7",
        "load.incline=35",
    ],
    parts: &[
        "time = 4e-6",
        "time = 2e-7, bottom_amplitude = 2e-9, bottom_frequency = 1e7",
        "time = 2e-7, bottom_amplitude_x = 5e-9, bottom_frequency_x = 2e7, bottom_phase_x = -90",
        "time = 1e-7",
    ],
    ..DISKS
};

/// Spheres on one.
pub const SPHERES_BELOW_A_FREE_SURFACE: Case = Case {
    further: &[
        "output.series_rows=10",
        "output.frame_rows=1",
        "sample.boundary=free",
        "load.pressure=none",
        "load.gravity=7e3",
        "load.incline=35",
    ],
    parts: &[
        "time = 1.5e-3",
        "time = 2e-4, bottom_amplitude = 1e-5, bottom_frequency = 1e4",
        "time = 2e-4, bottom_amplitude_x = 2e-5, bottom_frequency_x = 2e4, bottom_amplitude = 1e-5, bottom_frequency = 1e4",
        "time = 1e-4",
    ],
    ..SPHERES
};

impl Case {
    /// What `--set` takes.
    pub fn sets(&self) -> Vec<String> {
        let removed = self.removed.iter().map(|key| format!("{key}=none"));
        let further = self.sample.iter().chain(self.further);
        let parts: Vec<_> = self
            .parts
            .iter()
            .map(|part| format!("{{ {part} }}"))
            .collect();
        let protocol = format!("shear.protocol=[{}]", parts.join(", "));
        removed
            .chain(further.map(ToString::to_string))
            .chain([protocol])
            .collect()
    }

    /// A run in `folder`; `further` are arguments.
    pub fn run(&self, folder: &Path, ranks: usize, further: &[&str]) -> Outcome {
        let mut arguments = vec![self.scene.to_string()];
        arguments.extend(self.sets().into_iter().map(|set| format!("--set={set}")));
        arguments.extend(further.iter().map(ToString::to_string));
        gshear_mpi(ranks, folder, &arguments)
    }

    /// The steps in the middle of every part, and the last of every third.
    pub fn stops(&self) -> Vec<u64> {
        let scene =
            load(&Source::read(self.scene).expect("a file"), &self.sets()).expect("a sound scene");
        let walls = scene.plane_shear("the scene").expect("walls");
        let protocol = Schedule::new(&scene, walls, 1.0).protocol;
        let segments = protocol.segments();
        let mut stops: Vec<u64> = segments.iter().map(|s| s.first + s.steps / 2).collect();
        stops.extend(segments.iter().skip(1).step_by(3).map(|s| s.first));
        stops.sort_unstable();
        stops
    }
}
