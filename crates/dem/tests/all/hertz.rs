//! Spheres in contact: against LAMMPS, closed forms, and themselves at smaller steps.

use bytemuck::Zeroable;
use gshear_dem::contact::{Blocks, CARRY, ContactLaw, PairMotion, Response};
use gshear_dem::dimension::{Dimension, Three};
use gshear_dem::domain::Solo;
use gshear_dem::drive::NoWalls;
use gshear_dem::laws::hertz::Hertz;
use gshear_dem::laws::hertz::Spheres;
use gshear_dem::simd::{LANES, Lanes, Lanes16, Portable, PortableToken};
use gshear_dem::state::{Cell, ContactState, GrainState, Masses};
use gshear_dem::step::forces;
use gshear_dem::system::{Outside, Setup};

use crate::common::{Rig, Vector, cross, dot, frictional, norm};

type Law = Hertz<true>;

const GLASS: Spheres = Spheres {
    young_modulus: 48e9,
    poisson_ratio: 0.2,
    density: 2800.0,
    normal_damping: 0.0,
    tangential_damping: 0.0,
};

fn map(a: Vector, b: Vector, f: impl Fn(f64, f64) -> f64) -> Vector {
    [f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2])]
}

/// Spheres in a wide box.
fn rig(
    spheres: &Spheres,
    friction: f64,
    step: f64,
    grains: Vec<GrainState>,
    contacts: Vec<ContactState>,
) -> Rig<Three> {
    let largest = grains.iter().fold(0.0, |r: f64, g| r.max(g.radius));
    let (cell, masses) = (
        Cell::between_walls([20.0 * largest; 2]),
        Masses::Density(spheres.density),
    );
    let setup = Setup::new(cell, largest, masses, step).with_skin(0.1);
    let law = Box::new(Law::new(spheres, &frictional(friction)));
    Rig::new(setup, law, NoWalls, (grains, contacts))
}

/// F_n of the contact, if there is one.
fn normal_force(pair: &Rig<Three>) -> f64 {
    pair.contact_force().map_or(0.0, |(normal, _)| normal)
}

fn sphere(id: u32, radius: f64, position: Vector, velocity: Vector, spin: Vector) -> GrainState {
    GrainState {
        id,
        radius,
        position,
        velocity,
        angular_velocity: spin,
        ..GrainState::zeroed()
    }
}

/// Chung & Ooi (2011): glass spheres of 10 mm at ±10 m/s: 274.1 µm, 10.70 kN, 40.3 µs.
#[test]
fn glass_spheres_collide_as_hertz_says() {
    const RADIUS: f64 = 10e-3;
    let step = 1e-9;
    let at = |x: f64| [0.1 + x, 0.1, 0.1];
    let grains = vec![
        sphere(0, RADIUS, at(-RADIUS), [10.0, 0.0, 0.0], [0.0; 3]),
        sphere(1, RADIUS, at(RADIUS), [-10.0, 0.0, 0.0], [0.0; 3]),
    ];
    let mut pair = rig(&GLASS, 0.0, step, grains, Vec::new());
    let (mut greatest, mut steps, mut nearest) = (0.0f64, 0, f64::INFINITY);
    loop {
        pair.advance();
        let [a, b] = [0, 1].map(|g| pair.system.grains().state(g).position[0]);
        nearest = nearest.min(b - a);
        greatest = greatest.max(normal_force(&pair));
        if b - a > 2.0 * RADIUS {
            break;
        }
        steps += 1;
    }
    let close =
        |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 2e-3, "{found:e}");
    close(2.0 * RADIUS - nearest, 274.1e-6);
    close(greatest, 10.70e3);
    close(f64::from(steps) * step, 40.3e-6);
}

/// Sliding throughout: of the tangential velocity v_t two equal spheres lose μ(1+e) v_n of their
/// own and turn by 5/2 of it over R, in whatever direction (physics.md).
#[test]
fn gross_slip_in_any_direction() {
    const RADIUS: f64 = 10e-3;
    const FRICTION: f64 = 0.1;
    let n = [2.0 / 3.0, -1.0 / 3.0, 2.0 / 3.0];
    let t = [1.0 / 3.0, -2.0 / 3.0, -2.0 / 3.0];
    let (v_n, v_t) = (1.0, 1.0);
    // Stiff, so that n does not turn much while they touch.
    let stiff = Spheres {
        young_modulus: 4.8e12,
        ..GLASS
    };
    let center = [0.1, 0.1, 0.1];
    let side = |sign: f64| map(center, n, |c, n| c + sign * RADIUS * n);
    let moving = |sign: f64| map(n, t, |n, t| sign * (-v_n * n + v_t * t));
    let grains = vec![
        sphere(0, RADIUS, side(1.0), moving(1.0), [0.0; 3]),
        sphere(1, RADIUS, side(-1.0), moving(-1.0), [0.0; 3]),
    ];
    let mut pair = rig(&stiff, FRICTION, 2e-10, grains, Vec::new());
    (0..100_000).for_each(|_| pair.advance());
    assert_eq!(normal_force(&pair), 0.0);
    let end = pair.system.grains().state(0);
    assert!((dot(end.velocity, n) / v_n - 1.0).abs() < 2e-3);
    // The spring has to be loaded first, and n turns by a milliradian.
    let lost = v_t - dot(end.velocity, t);
    assert!((lost / (2.0 * FRICTION * v_n) - 1.0).abs() < 1e-2, "{lost}");
    // Torque on i is -R n × F_t, and F_t is along -t.
    let axis = cross(n, t);
    let turned = dot(end.angular_velocity, axis) * RADIUS / (2.5 * lost);
    assert!((turned - 1.0).abs() < 1e-2, "{turned}");
    let aside = map(end.angular_velocity, axis, |w, a| {
        w - dot(end.angular_velocity, axis) * a
    });
    assert!(norm(aside) < 1e-3 * norm(end.angular_velocity));
}

/// A loaded contact that is turned as a whole, with spins that leave no slip, keeps its
/// displacement, turned along: after a revolution it is what it was, to second order in the angle
/// of a step.
#[test]
fn history_turns_with_the_contact() {
    const RADIUS: f64 = 1e-3;
    let error = |steps: usize| {
        let distance = 2.0 * RADIUS * (1.0 - 1e-3);
        let turn = std::f64::consts::TAU / steps as f64;
        // About an axis that is across n, and a displacement along neither the axis nor the motion.
        let direction = |k: usize| {
            let (s, c) = (k as f64 * turn).sin_cos();
            [c, 0.6 * s, 0.8 * s]
        };
        let axis = [0.0, -0.8, 0.6];
        let u = [0.0, 0.6e-4 - 1.6e-4, 0.8e-4 + 1.2e-4];
        let center = [10e-3, 10e-3, 10e-3];
        let place =
            |k: usize, sign: f64| map(center, direction(k), |c, n| c + sign * 0.5 * distance * n);
        let grains = vec![
            sphere(0, RADIUS, place(0, 1.0), [0.0; 3], [0.0; 3]),
            sphere(1, RADIUS, place(0, -1.0), [0.0; 3], [0.0; 3]),
        ];
        let contacts = vec![ContactState::new(0, 1, u)];
        let step = 1e-6;
        let mut pair = rig(&GLASS, 1e6, step, grains, contacts);
        let spin = axis.map(|a| a * turn / step * distance / (2.0 * RADIUS));
        for k in 1..=steps {
            for (g, sign) in [(0, 1.0), (1, -1.0)] {
                let (now, last) = (place(k, sign), place(k - 1, sign));
                let r = pair.system.grains_mut().fields_mut(g);
                r[..3].copy_from_slice(&now);
                let v = map(now, last, |a, b| (a - b) / step);
                r[Three::HALF_VELOCITY..Three::HALF_VELOCITY + 3].copy_from_slice(&v);
                r[Three::VELOCITY..Three::VELOCITY + 3].copy_from_slice(&v);
                r[Three::HALF_SPIN..Three::HALF_SPIN + 3].copy_from_slice(&spin);
                r[Three::SPIN..Three::SPIN + 3].copy_from_slice(&spin);
            }
            let outside = forces(
                &Solo,
                &mut pair.system,
                pair.law.as_ref(),
                &mut NoWalls,
                step,
                None,
            );
            assert_eq!(outside, None);
        }
        let after = pair.system.contact_states(pair.law.as_ref())[0].history;
        norm(map(after, u, |a, b| a - b)) / norm(u)
    };
    let errors = [200, 400, 800].map(error);
    assert!(errors[2] < 1e-2, "{errors:?}");
    for pair in errors.windows(2) {
        assert!(pair[1] < pair[0] / 3.8, "{errors:?}");
    }
}

/// Damped spheres in contact, sticking, spinning about everything: second order in Δt.
#[test]
fn motion_in_contact_is_of_second_order() {
    const RADIUS: f64 = 10e-3;
    let damped = Spheres {
        normal_damping: 2e6,
        tangential_damping: 1e6,
        ..GLASS
    };
    let end = |steps: usize| {
        let at = |x: f64| [0.1 + x, 0.1 + 0.4 * x, 0.1 - 0.2 * x];
        let half = 0.995 * RADIUS / norm([1.0, 0.4, -0.2]);
        let grains = vec![
            sphere(
                0,
                RADIUS,
                at(half),
                [-1.0, 2.0, 0.5],
                [300.0, -100.0, 500.0],
            ),
            sphere(
                1,
                RADIUS,
                at(-half),
                [1.0, -1.0, 0.3],
                [-200.0, 400.0, 100.0],
            ),
        ];
        let mut pair = rig(&damped, 1e3, 1e-5 / steps as f64, grains, Vec::new());
        (0..steps).for_each(|_| pair.advance());
        pair.system.grains().state(0)
    };
    let reference = end(6400);
    let errors = [100, 200, 400].map(|steps| {
        let found = end(steps);
        let spin = norm(map(
            found.angular_velocity,
            reference.angular_velocity,
            |a, b| a - b,
        ));
        let speed = norm(map(found.velocity, reference.velocity, |a, b| a - b));
        RADIUS * spin + speed
    });
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((1.85..2.4).contains(&order), "{errors:?}");
    }
}

/// The law itself in LAMMPS' own scheme (dampers and history with the velocities of the half step,
/// the history projected on the tangent plane) against LAMMPS: 10,000 steps of two spheres that
/// fall on three, see lammps/bed.in.
#[test]
fn the_law_is_that_of_lammps() {
    const STEP: f64 = 1e-6;
    const DIAMETERS: [f64; 5] = [3.0e-3, 3.2e-3, 2.8e-3, 2.6e-3, 3.0e-3];
    // k_n = 3.663e7 Pa with ν = 0.3; k_t of bed.in is that of the law.
    let spheres = Spheres {
        young_modulus: 3.663_003_663_003_6e7 * 1.5 * (1.0 - 0.09),
        poisson_ratio: 0.3,
        density: 2500.0,
        normal_damping: 2e7,
        tangential_damping: 1e7,
    };
    let law = Law::new(&spheres, &frictional(0.5));
    let radius = DIAMETERS.map(|d| 0.5 * d);
    let mut x = [
        [0.0, 0.0, 0.0],
        [3.1e-3, 2e-4, 1e-4],
        [1.4e-3, 2.7e-3, -2e-4],
        [1.5e-3, 1e-3, 2.9e-3],
        [1.7e-3, 9e-4, 5.8e-3],
    ];
    let mut v = [[0.0; 3]; 5];
    let mut w = [[0.0; 3]; 5];
    v[3..].fill([0.05, -0.02, -0.1]);
    w[3] = [20.0, -35.0, 50.0];
    w[4] = [-15.0, 40.0, 10.0];
    let mut history = [[[0.0; 3]; 5]; 5];
    let mass = radius.map(|r| spheres.density * Three::volume(r));

    let mut force_on = |x: &[Vector; 5], v: &[Vector; 5], w: &[Vector; 5], step: f64| {
        let (mut force, mut torque) = ([[0.0; 3]; 5], [[0.0; 3]; 5]);
        for i in 0..5 {
            for j in i + 1..5 {
                let r = map(x[i], x[j], |a, b| a - b);
                let overlap = radius[i] + radius[j] - norm(r);
                if overlap <= 0.0 {
                    history[i][j] = [0.0; 3];
                    continue;
                }
                let n = r.map(|c| c / norm(r));
                let apart = map(v[i], v[j], |a, b| a - b);
                let v_n = dot(apart, n);
                let surface = map(w[i], w[j], |a, b| radius[i] * a + radius[j] * b);
                let tangential = map(
                    map(apart, n, |v, n| v - v_n * n),
                    cross(n, surface),
                    |a, b| a + b,
                );
                let last = history[i][j];
                let along = dot(last, n);
                let before = map(last, n, |u, n| u - along * n);
                let slip = tangential.map(|v| v * step);
                let splat = |v: f64| Lanes16([v; LANES]);
                let mut parameters = [Lanes16::ZERO; Law::PARAMETERS];
                let lanes = |v| Portable::splat(PortableToken, v);
                law.parameters(
                    PortableToken,
                    lanes(radius[i]),
                    lanes(radius[j]),
                    &mut parameters,
                );
                let mut lanes = before.map(splat);
                let mut response = [Response::default()];
                law.evaluate::<Portable, false>(
                    PortableToken,
                    &mut Blocks {
                        parameters: &parameters,
                        history: &mut lanes,
                        per_step: 0.0,
                        turning: &mut [],
                        motion: &[PairMotion {
                            overlap: splat(overlap),
                            normal_velocity: splat(v_n),
                            tangential_velocity: tangential.map(splat),
                            tangential_increment: slip.map(splat),
                            ..PairMotion::default()
                        }],
                        carry: &mut [[Lanes16::ZERO; CARRY]],
                        response: &mut response,
                        jumps: &[],
                    },
                );
                history[i][j] = lanes.map(|lanes| lanes.0[0]);
                let f_t = response[0].tangential.map(|lanes| lanes.0[0]);
                let f = map(n, f_t, |n, t| response[0].normal.0[0] * n + t);
                let moment = cross(n, f_t);
                force[i] = map(force[i], f, |a, b| a + b);
                force[j] = map(force[j], f, |a, b| a - b);
                torque[i] = map(torque[i], moment, |a, b| a - radius[i] * b);
                torque[j] = map(torque[j], moment, |a, b| a - radius[j] * b);
            }
        }
        (force, torque)
    };
    let (mut force, mut torque) = force_on(&x, &v, &w, 0.0);
    for _ in 0..10_000 {
        let kick = |v: &mut [Vector; 5],
                    w: &mut [Vector; 5],
                    force: &[Vector; 5],
                    torque: &[Vector; 5]| {
            for g in 3..5 {
                let weight = [0.0, 0.0, -9.81];
                for k in 0..3 {
                    v[g][k] += 0.5 * STEP * (force[g][k] / mass[g] + weight[k]);
                    w[g][k] += 0.5 * STEP * torque[g][k] / (0.4 * mass[g] * radius[g] * radius[g]);
                }
            }
        };
        kick(&mut v, &mut w, &force, &torque);
        for g in 3..5 {
            x[g] = map(x[g], v[g], |x, v| x + STEP * v);
        }
        (force, torque) = force_on(&x, &v, &w, STEP);
        kick(&mut v, &mut w, &force, &torque);
    }

    let text = include_str!("lammps/bed.txt");
    let rows = text
        .lines()
        .skip_while(|line| !line.starts_with("ITEM: ATOMS"))
        .skip(1);
    for (g, row) in rows.enumerate().skip(3) {
        let numbers: Vec<f64> = row
            .split_whitespace()
            .skip(1)
            .map(|n| n.parse().expect("a number"))
            .collect();
        for (what, found, expected) in [
            ("position", x[g], &numbers[..3]),
            ("velocity", v[g], &numbers[3..6]),
            ("spin", w[g], &numbers[6..]),
        ] {
            let expected: Vector = expected.try_into().expect("three");
            let error = norm(map(found, expected, |a, b| a - b)) / norm(expected);
            assert!(
                error < 1e-6,
                "{what} of {g}: {found:?} is not {expected:?}, {error:e}"
            );
        }
    }
}

#[test]
fn spheres_at_one_place_are_no_pair_that_fills_up_a_block() {
    const RADIUS: f64 = 1e-3;
    let at = |x: f64| {
        sphere(
            u32::from(x > 10e-3),
            RADIUS,
            [x, 10e-3, 10e-3],
            [0.0; 3],
            [0.0; 3],
        )
    };
    let grains = vec![at(10e-3), at(10e-3 + 2.0 * RADIUS)];
    let mut pair = rig(&GLASS, 0.5, 1e-6, grains, Vec::new());
    let one = pair.system.grains_mut().fields_mut(0)[..3].to_vec();
    pair.system.grains_mut().fields_mut(1)[..3].copy_from_slice(&one);
    let outside = forces(
        &Solo,
        &mut pair.system,
        pair.law.as_ref(),
        &mut NoWalls,
        0.0,
        None,
    );
    assert!(matches!(outside, Some(Outside::Pair(..))), "{outside:?}");
}
