//! The first touch, the greatest overlap of the law, a grain without contacts, and crushed grains.

use gshear_dem::dimension::Two;
use gshear_dem::drive::{Drive, GrainWalls, Piston, Planes, Slider, Top};
use gshear_dem::failure::Failure;
use gshear_dem::protocol::Protocol;
use gshear_dem::state::{GrainState, body};

use super::rig::{Place, Rig, Setting};
use super::runs::overlap_at;
use super::table::{Line, line};
use crate::accuracy::scenes::in_plane;
use crate::accuracy::scenes::{Full, LAW, grain, program_law};

const LENGTH: f64 = 8e-6;

fn setting(step: f64) -> Setting {
    Setting {
        length: LENGTH,
        density: LAW.density,
        step,
        skin: Some(0.5),
    }
}

/// Two grains, one above the other, at a distance that can be set to the bit.
struct Tower {
    rig: Rig<Full>,
    radii: [f64; 2],
}

impl Tower {
    fn new(radii: [f64; 2]) -> Self {
        let above = [4e-6, radii[0] + radii[1]];
        let grains = vec![
            grain(0, radii[0], [4e-6, 0.0], [0.0; 2], 0.0),
            grain(1, radii[1], above, [0.0; 2], 0.0),
        ];
        let law = program_law(&LAW);
        let rig = Rig::free(law, setting(1e-12), grains, Vec::new()).expect("within the law");
        Self { rig, radii }
    }

    /// δ (m), F_n (N/m) and k_t (Pa) at this distance, zeros if they do not touch; `None` if the
    /// overlap is outside the law.
    fn at(&mut self, distance: f64) -> Option<[f64; 3]> {
        let place = Place {
            position: [4e-6, distance],
            velocity: [0.0; 2],
            half_velocity: [0.0; 2],
            spin: 0.0,
        };
        self.rig.place(1, place);
        self.rig.pass(0.0).ok()?;
        let (samples, contacts) = (self.rig.samples(), self.rig.contacts());
        Some(match samples.first() {
            Some(s) => [s.overlap, s.normal, contacts[0].history[1]],
            None => [0.0; 3],
        })
    }

    /// Largest relative error of F_n and of k_t at this distance, against an independent solution
    /// of the implicit law; infinite if a result is not finite or outside the law.
    fn error(&mut self, distance: f64) -> f64 {
        let [r_i, r_j] = self.radii;
        let expected = r_i + r_j - distance;
        let Some([overlap, normal, k_t]) = self.at(distance) else {
            return f64::INFINITY;
        };
        if expected <= 0.0 {
            return if [overlap, normal, k_t] == [0.0; 3] {
                0.0
            } else {
                f64::INFINITY
            };
        }
        let [k_n, tangential] = LAW.stiffnesses(r_i, r_j, expected);
        let error = (normal / (k_n * expected) - 1.0)
            .abs()
            .max((k_t / tangential - 1.0).abs());
        if overlap == expected && error.is_finite() {
            error
        } else {
            f64::INFINITY
        }
    }
}

const SIZES: [[f64; 2]; 3] = [[1e-6, 1e-6], [0.7e-6, 1e-6], [0.05e-6, 1e-6]];

/// Every distance from a gap of 60 ulps to an overlap of 60 ulps.
pub fn touch() -> Vec<Line> {
    SIZES
        .into_iter()
        .map(|radii| {
            let mut tower = Tower::new(radii);
            let sum = radii[0] + radii[1];
            let mut distance = sum;
            (0..60).for_each(|_| distance = distance.next_up());
            let mut worst = 0.0f64;
            for _ in 0..121 {
                worst = worst.max(tower.error(distance));
                distance = distance.next_down();
            }
            let [overlap, normal, _] = tower.at(sum.next_down()).unwrap_or([f64::NAN; 3]);
            line(
                format!(
                    "radii {:.2} and {:.2} µm, overlaps from -60 to 60 ulps of the distance",
                    1e6 * radii[0],
                    1e6 * radii[1]
                ),
                "no force before the touch, then F_n and k_t of the law to 1e-12",
                format!(
                    "error {worst:.1e}; at the first ulp δ/(R_i+R_j) = {:.1e}, F_n = {normal:.1e} N/m",
                    overlap / sum
                ),
                worst < 1e-12,
            )
        })
        .collect()
}

/// Overlaps up to the greatest one of the law, and the position of the latter.
pub fn end() -> Vec<Line> {
    SIZES
        .into_iter()
        .map(|radii| {
            let mut tower = Tower::new(radii);
            let sum = radii[0] + radii[1];
            let last = overlap_at(0.3, radii[0], radii[1]);
            let worst = (0..2000)
                .map(|k| last * (1.0 - 1e-9) * 10f64.powf(-0.006 * f64::from(k)))
                .map(|overlap| tower.error(sum - overlap))
                .fold(0.0, f64::max);
            // Bisection down to neighbouring floats.
            let (mut inside, mut beyond) = (sum - 0.9 * last, sum - 1.1 * last);
            assert!(tower.at(inside).is_some() && tower.at(beyond).is_none());
            while inside.next_down() > beyond {
                let middle = 0.5 * (inside + beyond);
                if tower.at(middle).is_some() {
                    inside = middle;
                } else {
                    beyond = middle;
                }
            }
            let found = (sum - inside) / last - 1.0;
            line(
                format!(
                    "radii {:.2} and {:.2} µm, overlaps from 1e-12 of the greatest one up to it",
                    1e6 * radii[0],
                    1e6 * radii[1]
                ),
                format!(
                    "F_n and k_t of the law to 1e-12; the end at a/R = 0.3, δ/(R_i+R_j) = {:.4}",
                    last / sum
                ),
                format!("error {worst:.1e}; error of the end {found:.1e}"),
                worst < 1e-12 && found.abs() < 1e-12,
            )
        })
        .collect()
}

/// All constants are powers of two, so the closed form is exact: no bit may differ, although the
/// grain crosses the periodic boundary many times.
pub fn lone_grain() -> Vec<Line> {
    const STEPS: u32 = 1_000_000;
    let two = |exponent: i32| 2f64.powi(exponent);
    let (length, step) = (two(-16), two(-30));
    let velocity = [two(-1) + two(-9), -(two(-3) + two(-7))];
    let start = [5.0 * two(-19), two(-20)];
    let setting = Setting {
        length,
        density: LAW.density,
        step,
        skin: None,
    };
    let one = grain(0, 1e-6, start, velocity, 12345.678);
    let law = program_law::<true, true>(&LAW);
    let mut rig = Rig::free(law, setting, vec![one], Vec::new()).expect("alone");
    let mut wrong = 0;
    for k in 1..=STEPS {
        rig.advance().expect("alone");
        let now = rig.grains()[0];
        let path = velocity.map(|v| f64::from(k) * step * v);
        let x = (start[0] + path[0]).rem_euclid(length);
        let expected = [x, start[1] + path[1]];
        wrong += usize::from(
            now.position != in_plane(expected)
                || now.velocity != in_plane(velocity)
                || now.angular_velocity != one.angular_velocity,
        );
    }
    let turns = f64::from(STEPS) * step * velocity[0] / length;
    vec![line(
        format!("a grain without contacts, {STEPS} steps, {turns:.0} times through the cell"),
        "a straight line at constant velocity and spin, to the last bit",
        format!("{wrong} steps differ"),
        wrong == 0,
    )]
}

const RADIUS: f64 = 1e-6;

/// A piston at `height` (m) with `times` the greatest load of the law.
fn pressed_piston(times: f64, height: f64) -> Piston {
    let last = overlap_at(0.3, RADIUS, RADIUS);
    Piston {
        height,
        velocity: 0.0,
        acceleration: 0.0,
        mass: LAW.mass(RADIUS),
        load: times * LAW.stiffnesses(RADIUS, RADIUS, last)[0] * last,
    }
}

/// A free grain between one of the bottom wall and one of the top wall.
fn between_walls(times: f64, step: f64) -> Rig<Full, GrainWalls> {
    let at = |id: u32, body: u32, y: f64| GrainState {
        body,
        ..grain(id, RADIUS, [4e-6, y], [0.0; 2], 0.0)
    };
    let height = 4.001 * RADIUS;
    let grains = vec![
        at(0, body::BOTTOM, 0.0),
        at(1, body::FREE, 2.0 * RADIUS),
        at(2, body::TOP, height),
    ];
    let slider = Slider::new(Protocol::new(step, [(0.5, 1_000_000)]), None);
    let walls = GrainWalls::new(Top::new(pressed_piston(times, height), slider, None, false));
    let law = program_law::<true, true>(&LAW);
    Rig::new(law, walls, setting(step), grains, Vec::new()).expect("not yet pressed")
}

/// In frames, the grains of a wall have the full-step velocity of the wall.
pub fn wall_velocity() -> Vec<Line> {
    const STEPS: usize = 2000;
    let mut rig = between_walls(0.01, 5e-11);
    let mut wrong = 0;
    let mut turns = 0;
    let mut last = 0.0;
    for _ in 0..STEPS {
        rig.advance().expect("within the law");
        let now = rig.drive.motion.piston.velocity;
        wrong += usize::from(rig.grains()[2].velocity != [0.5, now, 0.0]);
        turns += usize::from(now * last < 0.0);
        last = now;
    }
    vec![line(
        format!("a wall that bounces {turns} times on a grain, {STEPS} steps"),
        "wall grains have the wall's velocity after every step, to the last bit",
        format!("{wrong} steps differ"),
        wrong == 0 && turns > 2,
    )]
}

/// Steps until the run fails. Returns the failure, and whether all numbers were finite then.
fn until_failure<D: Drive<Two>>(mut rig: Rig<Full, D>) -> (Failure, bool) {
    for _ in 0..1_000_000 {
        if let Err(failure) = rig.advance() {
            let finite = rig.grains().iter().all(|g| {
                let numbers = [g.position, g.velocity, g.angular_velocity];
                numbers.as_flattened().iter().all(|x| x.is_finite())
            });
            return (failure, finite);
        }
    }
    panic!("no failure at ten times the greatest load of the law");
}

pub fn crushed() -> Vec<Line> {
    let step = 5e-11;
    let law = || program_law::<true, true>(&LAW);
    let grains = vec![grain(0, RADIUS, [4e-6, RADIUS], [0.0; 2], 0.0)];
    let planes = Planes::new(
        Box::new(program_law::<false, false>(&LAW)),
        pressed_piston(10.0, 2.001 * RADIUS),
        0.0,
    );
    let rig = Rig::new(law(), planes, setting(step), grains, Vec::new()).expect("not yet pressed");
    let planes = until_failure(rig);
    let walls = until_failure(between_walls(10.0, step));

    [
        (
            "a grain crushed between smooth planes",
            planes,
            ["step ", "grain 0 ", "overlaps a wall too much"],
        ),
        (
            "a grain crushed between grains of the walls",
            walls,
            ["step ", " and ", "outside the contact law"],
        ),
    ]
    .into_iter()
    .map(|(done, (failure, finite), parts)| {
        let said = failure.to_string();
        let clear = parts.iter().all(|part| said.contains(part)) && said.contains(" at (");
        line(
            done,
            "exit code 3, a message with step, grains and position; all numbers finite",
            format!("exit code {}: {said}", failure.exit_code()),
            failure.exit_code() == 3 && clear && finite,
        )
    })
    .collect()
}
