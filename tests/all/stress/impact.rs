//! Oblique impacts gain no energy, unlike in some other codes.

use super::table::{Line, line};
use crate::accuracy::reference::{Law, World};
use crate::accuracy::scenes::{self, LAW, LOOKS, Scene};

/// μ_s.
const FRICTION: f64 = 0.5;
/// Phases of the first touch within a step.
const PHASES: usize = 12;

fn law(damping_ratio: f64) -> Law {
    Law {
        damping_ratio,
        friction: FRICTION,
        rolling_friction: 0.0,
        ..LAW
    }
}

/// Two unequal disks that meet at `speed` (m/s), at `degrees` from head-on.
fn scene(damping_ratio: f64, degrees: f64, speed: f64) -> Scene {
    let angle = degrees.to_radians();
    let (approach, sideways) = (speed * angle.cos(), speed * angle.sin());
    scenes::oblique(law(damping_ratio), approach, sideways)
}

/// Relative changes of the kinetic energy in the impact at Δt (s), for every phase.
fn changes(scene: &Scene, step: f64) -> Vec<f64> {
    let (world, start) = scene.world(1);
    let before = world.kinetic_energy(&start);
    let steps = (scene.duration / step / LOOKS as f64).ceil() as usize * LOOKS;
    let one = |phase: usize| {
        let mut scene = scene.clone();
        let moving = &mut scene.grains[1];
        for k in 0..2 {
            moving.position[k] -= step * phase as f64 / PHASES as f64 * moving.velocity[k];
        }
        let end = &scene.program(steps)[LOOKS - 1];
        assert!(
            apart(&world, end),
            "the impact is not over at Δt = {step:e}"
        );
        world.kinetic_energy(end) / before - 1.0
    };
    (0..PHASES).map(one).collect()
}

fn apart(world: &World, state: &[f64]) -> bool {
    world.touch(state, 0).overlap < 0.0
}

/// The default Δt is a tenth of √(m/k).
fn default_step(scene: &Scene) -> f64 {
    0.1 * scene.time_scale()
}

pub fn no_gain() -> Vec<Line> {
    let mut lines = Vec::new();
    for damping_ratio in [0.0, 0.1] {
        let mut worst = (f64::MIN, 0.0, 0.0, 0.0);
        let mut count = 0;
        for degrees in (1..=17).map(|k| 5.0 * f64::from(k)).chain([76.0]) {
            for speed in [0.1, 1.0, 10.0] {
                for part in (0..7).map(|k| 0.5f64.powi(k)) {
                    let scene = scene(damping_ratio, degrees, speed);
                    for change in changes(&scene, part * default_step(&scene)) {
                        count += 1;
                        if change > worst.0 {
                            worst = (change, degrees, speed, part);
                        }
                    }
                }
            }
        }
        let (change, degrees, speed, part) = worst;
        lines.push(line(
            format!(
                "{count} impacts at 5° … 85° and 76°, μ_s = {FRICTION}, α = {damping_ratio}, 0.1 to 10 m/s, Δt from the default down to a \
                 64th, {PHASES} phases of the first touch within a step"
            ),
            "none gains energy",
            format!(
                "the least loss is {:.1e} of the energy, at {degrees}°, {speed} m/s, Δt = {part} of the default",
                -change
            ),
            change < 0.0,
        ));
    }
    lines
}

/// In an impact that slides throughout, the tangential impulse J_t is μ_s times the normal one, 2
/// m* v_n without damping; it reduces v_t by J_t (1/m* + R_i²/I_i + R_j²/I_j) = 3 J_t/m*. This
/// holds beyond tan⁻¹(6 μ_s) = 71.6°. The line of centres rotates by about 1e-3 rad.
pub fn sliding_loss() -> Vec<Line> {
    [76.0f64, 85.0]
        .into_iter()
        .map(|degrees| {
            let scene = scene(0.0, degrees, 0.1);
            let (world, start) = scene.world(1);
            let [m_i, m_j] = [0, 1].map(|k| world.law.mass(world.disks[k].radius));
            let reduced = m_i * m_j / (m_i + m_j);
            let (normal, across) = (
                0.1 * degrees.to_radians().cos(),
                0.1 * degrees.to_radians().sin(),
            );
            let impulse = FRICTION * 2.0 * reduced * normal;
            let loss = impulse * across - 1.5 * impulse * impulse / reduced;
            let expected = loss / world.kinetic_energy(&start);
            let found = changes(&scene, default_step(&scene));
            let furthest = found
                .iter()
                .map(|change| (-change / expected - 1.0).abs())
                .fold(0.0, f64::max);
            line(
                format!("an impact at {degrees}° with μ_s = {FRICTION}, sliding throughout, at the default Δt"),
                format!("sliding dissipates {expected:.4} of the energy"),
                format!(
                    "{:.4} to {:.4}",
                    -found.iter().fold(f64::MIN, |a, &b| a.max(b)),
                    -found.iter().fold(f64::MAX, |a, &b| a.min(b))
                ),
                furthest < 0.01,
            )
        })
        .collect()
}
