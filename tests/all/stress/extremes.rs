//! Large ratios of sizes and of loads, and positions far from the origin, against the reference.

use std::f64::consts::{FRAC_PI_2, PI};

use gshear_dem::state::GrainState;

use super::rig::{Rig, Setting};
use super::table::{Line, line};
use crate::accuracy::reference::{Law, STICKING};
use crate::accuracy::scenes::{self, FIELDS, LAW, LOOKS, Scene, grain, program_law};

/// A free grain squeezed between fixed neighbours, of which the second one moves at `speed` (m/s):
/// (radius, angle, overlap over the sum of the radii) of each. It starts at rest, slightly out of
/// balance.
fn squeezed(radius: f64, neighbours: &[(f64, f64, f64)], speed: f64) -> Scene {
    let law = Law {
        rolling_friction: 0.5,
        friction: 5.0,
        ..LAW
    };
    let centre = [4e-6, 0.0];
    let mut grains = vec![grain(0, radius, centre, [0.0; 2], 0.0)];
    let mut pairs = Vec::new();
    for (k, &(r, angle, part)) in neighbours.iter().enumerate() {
        let distance = (radius + r) * (1.0 - part);
        let (s, c) = angle.sin_cos();
        grains.push(GrainState {
            velocity: if k == 1 {
                [speed, -0.3 * speed, 0.0]
            } else {
                [0.0; 3]
            },
            ..grain(
                1 + k as u32,
                r,
                [centre[0] + distance * c, centre[1] + distance * s],
                [0.0; 2],
                0.0,
            )
        });
        pairs.push((0, 1 + k, [0.0; 2], STICKING));
    }
    let mut free = vec![false; grains.len()];
    free[0] = true;
    let mut scene = Scene {
        law,
        length: 16e-6,
        grains,
        free,
        pairs,
        duration: 0.0,
    };
    // Two periods of the softest mode.
    scene.duration = 4.0 * PI * scene.time_scale();
    scene
}

/// Errors at Δt = √(m/k)/64 and at half of that: of second order, and small.
fn second_order(done: &str, scene: &Scene) -> Line {
    let reference = scene.reference(800);
    assert_eq!(reference.0.switches, [], "{done}: the regime changes");
    let greatest = |errors: [f64; 5]| errors.into_iter().fold(0.0, f64::max);
    let itself = greatest(scene.errors(&reference, &scene.reference(400).1));
    let error = |part: f64| {
        let steps = scene.duration / scene.time_scale() * part / LOOKS as f64;
        scene.errors(&reference, &scene.program(steps.round() as usize * LOOKS))
    };
    let (coarse, fine) = (error(64.0), error(128.0));
    let orders = coarse.iter().zip(fine).map(|(a, b)| (a / b).log2());
    let (least, most) = (
        orders.clone().fold(f64::MAX, f64::min),
        orders.fold(f64::MIN, f64::max),
    );
    let error = greatest(fine);
    line(
        done,
        format!("order 2 in {}, against the reference", FIELDS.join(", ")),
        format!(
            "orders {least:.2} … {most:.2}; at Δt = √(m/k)/128 the greatest error is {error:.1e} (reference: {itself:.0e})"
        ),
        least > 1.9 && most < 2.1 && error < 1e-3 && itself < 0.01 * error,
    )
}

pub fn sizes_and_loads() -> Vec<Line> {
    vec![
        second_order(
            "a grain between two 20 times as large (masses 1:400), one of which moves past it",
            &squeezed(0.05e-6, &[(1e-6, -1.4, 2e-4), (1e-6, 1.72, 2e-4)], 0.03),
        ),
        second_order(
            "the same, 100 times as large: ω² = k/m of touching grains differs by a factor of 1e4",
            &squeezed(0.02e-6, &[(2e-6, -1.4, 4e-5), (2e-6, 1.72, 4e-5)], 0.01),
        ),
        second_order(
            "a grain with two contacts of 1e4 times the force of its two others (similar k_n: one material)",
            &squeezed(
                1e-6,
                &[
                    (1e-6, -FRAC_PI_2, 2e-2),
                    (1e-6, FRAC_PI_2, 2e-2),
                    (0.9e-6, 0.1, 4e-6),
                    (1e-6, 3.2, 4e-6),
                ],
                1e-5,
            ),
        ),
    ]
}

/// An oblique impact far from the origin, in a wide cell, against the same near the origin, both at
/// the same Δt.
///
/// A coordinate X is rounded to ½εX in every step: over N steps the separation of two grains
/// changes by at most NεX, which is NεX/δ of the greatest overlap δ; random roundings change it by
/// about √N εX/δ.
pub fn far_from_the_origin() -> Vec<Line> {
    const STEPS: usize = 200;
    const DIAMETER: f64 = 2e-6;
    let end = |place: [f64; 2], length: f64| {
        let scene = scenes::oblique(LAW, 1.0, 0.5);
        let grains = scene.grains.iter().map(|g| GrainState {
            position: [place[0] + g.position[0], place[1] + g.position[1], 0.0],
            ..*g
        });
        let setting = Setting {
            length,
            density: LAW.density,
            step: 6e-9 / STEPS as f64,
            skin: Some(0.1),
        };
        let law = program_law::<true, true>(&LAW);
        let mut rig = Rig::free(law, setting, grains.collect(), Vec::new()).expect("apart");
        (0..STEPS).for_each(|_| rig.advance().expect("within the law"));
        let ([a, b], contact) = (
            <[GrainState; 2]>::try_from(rig.grains()).expect("two grains"),
            rig.contacts()[0],
        );
        let separation = [0, 1].map(|k| a.position[k] - b.position[k]);
        let overlap = a.radius + b.radius - separation[0].hypot(separation[1]);
        (
            separation,
            [a.velocity, b.velocity],
            contact.history[0],
            overlap,
        )
    };
    let (separation, velocities, force, overlap) = end([4e-6, 0.0], 8e-6);
    let mut lines = Vec::new();
    for away in [1e3, 1e6] {
        let x = away * DIAMETER;
        for (axis, place) in [("x", [x, 0.0]), ("y", [4e-6, x])] {
            let length = if axis == "x" { 4.0 * x } else { 8e-6 };
            let far = end(place, length);
            let lost = [0, 1]
                .map(|k| (far.0[k] - separation[k]).abs())
                .into_iter()
                .fold(0.0, f64::max)
                / overlap;
            let speeds = velocities.as_flattened().iter().zip(far.1.as_flattened());
            let speed = speeds.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let tangential = (far.2 / force - 1.0).abs();
            let one = f64::EPSILON * x / overlap;
            let most = STEPS as f64 * one;
            lines.push(line(
                format!("an impact {away:.0e} diameters from the origin along {axis}, {STEPS} steps, δ = {:.1} nm", 1e9 * overlap),
                format!("as at the origin up to rounding, εX/δ = {one:.1e} per operation: {:.0e} at random, {most:.0e} at most", one * (STEPS as f64).sqrt()),
                format!("separation differs by {lost:.1e} δ, velocities by {speed:.1e} of 1 m/s, F_t by {tangential:.1e}"),
                lost <= most && speed <= most && tangential <= most,
            ));
        }
    }
    lines
}
