//! When what happens, in whole steps. Intervals of output are rounded to steps and never reach the trajectory.

use crate::config::{Drive, Scene};

/// The shear stage in steps of Δt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Schedule {
    /// Δt (s).
    pub step: f64,
    /// H (m): height of the sheared layer at the start, to which strains refer.
    pub height: f64,
    /// V (m/s).
    pub speed: f64,
    /// Steps of the stage.
    pub total: u64,
    /// Every so many steps; 0 is never.
    pub frames: u64,
    pub first_frame: u64,
    pub series: u64,
    pub checkpoints: u64,
    pub progress: u64,
}

/// √(m̄/P) (s), the time of I = γ̇ √(m̄/P).
pub fn inertial_time(scene: &Scene) -> f64 {
    (mean_mass(scene) / scene.load.pressure).sqrt()
}

/// m̄ = ρπ⟨R²⟩ (kg/m).
pub fn mean_mass(scene: &Scene) -> f64 {
    std::f64::consts::PI * scene.law.density() * scene.sample.mean_square_radius
}

impl Schedule {
    pub fn new(scene: &Scene, height: f64) -> Self {
        let step = scene.time_step.step;
        let speed = match scene.shear.drive {
            Drive::Velocity(speed) => speed,
            Drive::InertialNumber(i) => i / inertial_time(scene) * height,
        };
        let per_step = speed / height * step;
        let steps = |strain: f64| {
            if strain > 0.0 {
                ((strain / per_step).round() as u64).max(1)
            } else {
                0
            }
        };
        let total = steps(scene.shear.strain);
        Self {
            step,
            height,
            speed,
            total,
            frames: steps(scene.output.frame_strain),
            first_frame: steps(scene.output.frame_start),
            series: steps(scene.output.series_strain),
            checkpoints: steps(scene.output.checkpoint_strain),
            progress: match scene.output.progress_lines {
                0 => 0,
                lines => (total / lines).max(1),
            },
        }
    }

    /// γ after so many steps.
    pub fn strain(&self, step: u64) -> f64 {
        self.speed * (step as f64 * self.step) / self.height
    }

    /// t (s).
    pub fn time(&self, step: u64) -> f64 {
        step as f64 * self.step
    }

    /// I.
    pub fn inertial_number(&self, scene: &Scene) -> f64 {
        self.speed / self.height * inertial_time(scene)
    }

    pub fn frame_due(&self, step: u64) -> bool {
        step >= self.first_frame && due(self.frames, step - self.first_frame)
    }

    pub fn series_due(&self, step: u64) -> bool {
        due(self.series, step)
    }

    pub fn progress_due(&self, step: u64) -> bool {
        due(self.progress, step)
    }

    pub fn checkpoint_due(&self, step: u64) -> bool {
        step > 0 && due(self.checkpoints, step)
    }
}

fn due(every: u64, step: u64) -> bool {
    every > 0 && step.is_multiple_of(every)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Source, load};

    #[test]
    fn strains_become_whole_steps() {
        let scene = load(&Source::embedded(), &[]).expect("the default scene is sound");
        let schedule = Schedule::new(&scene, 40e-6);
        let per_step = schedule.strain(1);
        assert!((schedule.strain(schedule.total) - 0.1).abs() <= 0.5 * per_step);
        assert!((schedule.frames as f64 * per_step - 1e-4).abs() <= 0.5 * per_step);
        assert!((schedule.inertial_number(&scene) / 2e-4 - 1.0).abs() < 1e-14);
        assert!(schedule.frame_due(0) && schedule.frame_due(3 * schedule.frames));
        assert!(!schedule.frame_due(3 * schedule.frames + 1));
    }

    /// Contract 2: nothing about output moves the time step or the number of steps.
    #[test]
    fn output_does_not_reach_the_steps() {
        let with = |set: &[String]| {
            let scene = load(&Source::embedded(), set).expect("sound");
            let s = Schedule::new(&scene, 40e-6);
            (s.step, s.total, s.speed)
        };
        let other = [
            "output.frame_strain=3.3e-5",
            "output.series_strain=0.0",
            "output.frame_start=0.01",
        ];
        assert_eq!(with(&[]), with(&other.map(String::from)));
    }
}
