//! Spheres in contact: against closed forms and LAMMPS.

use gshear_dem::contact::PairMotion;
use gshear_dem::dimension::{Dimension, Three};
use gshear_dem::laws::hertz::{self, Hertz, Spheres};
use gshear_dem::laws::mindlin::{self, MindlinSprings};
use gshear_dem::laws::{Law, LawSpace};
use gshear_dem::state::Masses;

use crate::common::{
    Rig, Vector, cross, dot, evaluate, frictional, minus, norm, plus, splat, undamped,
};

/// A head-on impact of two spheres with F_n = k δ^(3/2): peak overlap (5m*v²/(4k))^(2/5) and force,
/// all energy back, and 2.9432 δ_max/v for the time, the better the shorter the step. Returns the
/// three closed forms.
fn impact(law: &Law, radii: [f64; 2], k: f64, speed: f64) -> [f64; 3] {
    let [a, b] = radii.map(|r| law.masses().of(0, Three::volume(r)));
    let reduced = a * b / (a + b);
    let deepest = (1.25 * reduced * speed * speed / k).powf(0.4);
    let strongest = k * deepest.powf(1.5);
    let time = 2.943_275_194_3 * deepest / speed;
    let of = [
        [[-radii[0], 0.0, 0.0], [0.5 * speed, 0.0, 0.0], [0.0; 3]],
        [[radii[1], 0.0, 0.0], [-0.5 * speed, 0.0, 0.0], [0.0; 3]],
    ];
    let errors = [1000, 2000].map(|steps| {
        let step = time / f64::from(steps);
        let force = Three::pair_force(law, &frictional(0.5)).expect("a law of spheres");
        let mut pair = Rig::couple(force, (law.masses(), step), radii, of, Vec::new());
        let (mut peak, mut greatest, mut energy, mut steps) = (0.0f64, 0.0f64, 0.0f64, 0);
        loop {
            pair.advance(1);
            let ends = pair.ends();
            let apart = minus(ends[1].velocity, ends[0].velocity)[0];
            let overlap = radii[0] + radii[1] - minus(ends[1].position, ends[0].position)[0];
            if overlap < 0.0 {
                let took = f64::from(steps) * step;
                assert!((took / time - 1.0).abs() < 4e-3, "{took} is not {time}");
                let ratios = [peak / deepest, greatest / strongest, apart / speed];
                let [peak, force, speed] = ratios.map(|ratio| (ratio - 1.0).abs());
                break [peak, force, speed, energy];
            }
            // Of the motion against each other.
            let whole = 0.5 * reduced * apart * apart + 0.4 * k * overlap.powf(2.5);
            energy = energy.max((whole / (0.5 * reduced * speed * speed) - 1.0).abs());
            greatest = greatest.max(pair.contact_force().map_or(0.0, |(normal, _)| normal));
            peak = peak.max(overlap);
            steps += 1;
        }
    });
    for (coarse, fine) in errors[0].iter().zip(errors[1]) {
        let falls = fine < 0.35 * coarse || fine < 1e-8;
        assert!(fine < 1e-5 && falls, "{errors:?}");
    }
    [deepest, strongest, time]
}

/// Chung & Ooi (2011): glass spheres of 10 mm at ±10 m/s: 274.1 µm, 10.70 kN, 40.3 µs. Spheres of
/// the law of Mindlin have a stiffness and a mass that do not depend on their radii.
#[test]
fn spheres_collide_as_hertz_says() {
    let glass = undamped(48e9, 0.2, 2800.0);
    let k = glass.normal_stiffness() * 5e-3f64.sqrt();
    let of_glass = impact(&Law::of(&hertz::KIND, glass), [10e-3; 2], k, 20.0);
    for (found, expected) in of_glass.into_iter().zip([274.1e-6, 10.70e3, 40.3e-6]) {
        assert!((found / expected - 1.0).abs() < 2e-3, "{found:e}");
    }
    let springs = MindlinSprings {
        normal_stiffness: 1.0,
        tangential_stiffness: 2.0 / 7.0,
        masses: Masses::Equal(1.0),
    };
    impact(&Law::of(&mindlin::KIND, springs), [0.5, 0.7], 1.0, 0.02);
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
        normal_damping: 2e7,
        tangential_damping: 1e7,
        ..undamped(3.663_003_663_003_6e7 * 1.5 * (1.0 - 0.09), 0.3, 2500.0)
    };
    let law = Hertz::<true>::new(&spheres, &frictional(0.5));
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
                let r = minus(x[i], x[j]);
                let overlap = radius[i] + radius[j] - norm(r);
                if overlap <= 0.0 {
                    history[i][j] = [0.0; 3];
                    continue;
                }
                let n = r.map(|c| c / norm(r));
                let apart = minus(v[i], v[j]);
                let v_n = dot(apart, n);
                let surface = plus(w[i].map(|w| radius[i] * w), radius[j], w[j]);
                let tangential = plus(plus(apart, -v_n, n), 1.0, cross(n, surface));
                let last = history[i][j];
                let motion = PairMotion {
                    overlap: splat(overlap),
                    normal_velocity: splat(v_n),
                    tangential_velocity: tangential.map(splat),
                    tangential_increment: tangential.map(|v| splat(v * step)),
                    ..PairMotion::default()
                };
                let radii = [radius[i], radius[j]];
                let of = evaluate(&law, radii, &motion, plus(last, -dot(last, n), n));
                history[i][j] = of.history;
                let f = plus(of.tangential, of.normal, n);
                let moment = cross(n, of.tangential);
                force[i] = plus(force[i], 1.0, f);
                force[j] = minus(force[j], f);
                torque[i] = plus(torque[i], -radius[i], moment);
                torque[j] = plus(torque[j], -radius[j], moment);
            }
        }
        (force, torque)
    };
    let kick =
        |v: &mut [Vector; 5], w: &mut [Vector; 5], (force, torque): &([Vector; 5], [Vector; 5])| {
            for g in 3..5 {
                let inertia = 0.4 * mass[g] * radius[g] * radius[g];
                v[g] = plus(v[g], 0.5 * STEP / mass[g], force[g]);
                v[g][2] -= 0.5 * STEP * 9.81;
                w[g] = plus(w[g], 0.5 * STEP / inertia, torque[g]);
            }
        };
    let mut forces = force_on(&x, &v, &w, 0.0);
    for _ in 0..10_000 {
        kick(&mut v, &mut w, &forces);
        for g in 3..5 {
            x[g] = plus(x[g], STEP, v[g]);
        }
        forces = force_on(&x, &v, &w, STEP);
        kick(&mut v, &mut w, &forces);
    }

    let text = include_str!("lammps/bed.txt");
    let rows = text
        .lines()
        .skip_while(|line| !line.starts_with("ITEM: ATOMS"))
        .skip(1);
    for (g, row) in rows.enumerate().skip(3) {
        let numbers = row.split_whitespace().skip(1);
        let numbers: Vec<f64> = numbers.map(|n| n.parse().expect("a number")).collect();
        for (found, expected) in [x[g], v[g], w[g]].into_iter().zip(numbers.chunks_exact(3)) {
            let expected: Vector = expected.try_into().expect("three");
            let error = norm(minus(found, expected)) / norm(expected);
            assert!(
                error < 1e-6,
                "{g}: {found:?} is not {expected:?}, {error:e}"
            );
        }
    }
}
