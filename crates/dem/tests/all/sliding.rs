//! Friction, rolling and twisting resistance of spheres: of second order in Δt where contacts slide
//! and their direction turns, and objective: forces turn with a pair that turns as a rigid body.

use gshear_dem::dimension::{Dimension, Three};
use gshear_dem::domain::Solo;
use gshear_dem::drive::NoWalls;
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::hertz::Spheres;
use gshear_dem::laws::hooke::Springs;
use gshear_dem::laws::mindlin::MindlinSprings;
use gshear_dem::laws::tsuji::TsujiSpheres;
use gshear_dem::laws::{Constants, Contact};
use gshear_dem::state::{ContactState, Masses};
use gshear_dem::step::forces;
use gshear_dem::system::Outside;

use crate::common::{Rig, Vector, cross, minus, norm};

const RADII: [f64; 2] = [0.5, 0.7];

/// The laws between spheres, in units in which a contact of δ = 0.02 has about the same stiffness.
fn laws() -> Vec<(&'static str, Box<dyn Constants>)> {
    let spheres = Spheres {
        young_modulus: 12.0,
        poisson_ratio: 0.3,
        density: 1.5,
        normal_damping: 0.0,
        tangential_damping: 0.0,
    };
    vec![
        (
            "hooke",
            Box::new(Springs {
                normal_stiffness: 1.0,
                tangential_stiffness: 0.4,
                density: 1.5,
                damping_ratio: 0.1,
                sliding_damping: 0.5,
            }),
        ),
        (
            "hertz",
            Box::new(Spheres {
                normal_damping: 0.8,
                tangential_damping: 0.4,
                ..spheres
            }),
        ),
        (
            "hertz-tsuji",
            Box::new(TsujiSpheres {
                spheres,
                restitution: 0.8,
                tangential_damping_ratio: 0.5,
            }),
        ),
        (
            "mindlin",
            Box::new(MindlinSprings {
                normal_stiffness: 7.0,
                tangential_stiffness: 5.0,
                masses: Masses::Density(1.5),
            }),
        ),
    ]
}

/// Rolling and twisting resistance, in the same units.
const RESISTING: Contact = Contact {
    rolling_friction: 0.1,
    rolling_stiffness: Some(0.5),
    rolling_damping_ratio: 0.2,
    twisting_friction: 0.05,
    twisting_stiffness: Some(0.3),
    twisting_damping_ratio: 0.1,
    ..Contact::NONE
};

/// Every law without and with rolling and twisting resistance.
fn all_contacts() -> impl Iterator<Item = ((&'static str, Box<dyn Constants>), bool)> {
    let with = laws().into_iter().map(|law| (law, true));
    laws().into_iter().map(|law| (law, false)).chain(with)
}

/// Position, velocity and spin of each, and the histories of their contact.
fn couple(
    radii: [f64; 2],
    law: &dyn Constants,
    contact: &Contact,
    step: f64,
    of: [[Vector; 3]; 2],
    (history, torques): (Vector, [f64; 4]),
) -> Rig<Three> {
    let contacts = vec![ContactState {
        torques,
        ..ContactState::new(0, 1, history)
    }];
    let (masses, law) = (
        law.masses(),
        law.spheres(contact).expect("a law of spheres"),
    );
    Rig::couple(law, (masses, step), radii, of, contacts)
}

/// Whether it is at the limits of friction, rolling and twisting.
fn at_limits(pair: &Rig<Three>) -> [bool; 3] {
    let [slides, rolls, twists, _] = pair.system.contacts.limits[0];
    [slides, rolls, twists].map(|lanes| lanes != 0)
}

/// Two spheres pressed together with spins, which slide from the first step on while the direction
/// of the slip turns. Differences to a run of 12,800 steps fall by four from 200 steps on, in
/// velocities and spins.
#[test]
fn a_direction_that_turns_is_followed_to_second_order() {
    let n = [1.0, 0.4, -0.2].map(|n| n / norm([1.0, 0.4, -0.2]));
    let of = [
        [
            n.map(|n| 0.98 * RADII[0] * n),
            [-0.03, 0.05, 0.02],
            [0.3, -0.1, 0.2],
        ],
        [
            n.map(|n| -0.98 * RADII[1] * n),
            [0.02, -0.03, 0.05],
            [-0.2, 0.4, 0.1],
        ],
    ];
    let [[_, v_i, spin_i], [_, v_j, spin_j]] = of;
    let arms: Vector = std::array::from_fn(|k| RADII[0] * spin_i[k] + RADII[1] * spin_j[k]);
    let slip: Vector = {
        let (v, turning) = (minus(v_i, v_j), cross(n, arms));
        let along: f64 = v.iter().zip(n).map(|(v, n)| v * n).sum();
        std::array::from_fn(|k| v[k] - along * n[k] + turning[k])
    };
    let turning = minus(spin_i, spin_j);
    let twisting: f64 = turning.iter().zip(n).map(|(w, n)| w * n).sum();
    for ((name, law), resists) in all_contacts() {
        // Beyond the limits, so that it slides; a force or a displacement.
        let sign = if name == "hooke" { -1.0 } else { 1.0 };
        let history = slip.map(|v| sign * v / norm(slip));
        let [x, y, z] = std::array::from_fn(|k| twisting * n[k] - turning[k]);
        let torques = [x, y, z, -twisting].map(|t| t * f64::from(u8::from(resists)));
        let contact = Contact {
            friction: 0.15,
            ..if resists { RESISTING } else { Contact::NONE }
        };
        let end = |steps: usize| {
            let step = 0.8 / steps as f64;
            let histories = (history, torques);
            let mut pair = couple(RADII, law.as_ref(), &contact, step, of, histories);
            for _ in 0..steps {
                pair.advance();
                assert_eq!(at_limits(&pair), [true, resists, resists], "{name}");
            }
            pair.system.grains().state(0)
        };
        let reference = end(12800);
        let errors = [200, 400, 800].map(|steps| {
            let found = end(steps);
            norm(minus(found.angular_velocity, reference.angular_velocity))
                + norm(minus(found.velocity, reference.velocity))
        });
        for pair in errors.windows(2) {
            let order = (pair[0] / pair[1]).log2();
            assert!((1.85..2.5).contains(&order), "{name} {resists}: {errors:?}");
        }
    }
}

/// A loaded pair that turns about its normal by 90° as a rigid body: its force turns with it.
#[test]
fn a_force_turns_with_its_pair_about_the_normal() {
    const STEPS: usize = 2000;
    let n = [0.6, 0.0, 0.8];
    // Perpendicular to n.
    let t = [0.8, 0.0, -0.6];
    for ((name, law), resists) in all_contacts() {
        let step = 1e-7;
        // In so short a time the spring does not change the spins.
        let spin = std::f64::consts::FRAC_PI_2 / (step * STEPS as f64);
        let of = [
            [
                n.map(|n| 0.98 * RADII[0] * n),
                [0.0; 3],
                n.map(|n| spin * n),
            ],
            [
                n.map(|n| -0.98 * RADII[1] * n),
                [0.0; 3],
                n.map(|n| spin * n),
            ],
        ];
        let history = t.map(|t| 1e-4 * t);
        let [x, y, z] = history;
        let high = if resists { 10.0 } else { 0.0 };
        let contact = Contact {
            friction: 10.0,
            rolling_friction: high,
            twisting_friction: high,
            ..RESISTING
        };
        let torques = if resists { [x, y, z, 1e-4] } else { [0.0; 4] };
        let mut pair = couple(RADII, law.as_ref(), &contact, step, of, (history, torques));
        (0..STEPS).for_each(|_| pair.advance());
        let contacts = pair.system.contact_states(pair.law.as_ref());
        let found = contacts[0].history;
        let turned = cross(n, t);
        if resists {
            let [x, y, z, twist] = contacts[0].torques;
            let error = norm(minus([x, y, z], turned.map(|t| 1e-4 * t))) / 1e-4;
            assert!(error < 1e-5, "{name}: {x} {y} {z}, {error:e}");
            assert!((twist / 1e-4 - 1.0).abs() < 1e-5, "{name}: {twist}");
        }
        let error = norm(minus(found, turned.map(|t| 1e-4 * t))) / 1e-4;
        assert!(
            error < 1e-5,
            "{name}: {found:?} is not along {turned:?}, {error:e}"
        );
    }
}

/// Two equal spheres that roll on each other, and twist, without slip: damped oscillators whose
/// period and decay are those of k_r, C_r and of k_w, C_w. They lie together from the start, or
/// come to touch within a step, when F_n begins as that of the damper.
#[test]
fn spheres_oscillate_against_each_other() {
    for approach in [0.0, 0.05] {
        oscillate(approach);
    }
}

/// `approach`: the velocity (in the units of the laws) with which they come together.
fn oscillate(approach: f64) {
    const RADIUS: f64 = 0.5;
    let (name, law) = laws().swap_remove(0);
    let mass = law
        .masses()
        .of(0, 4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3));
    let contact = Contact {
        friction: 10.0,
        rolling_friction: 1e3,
        twisting_friction: 1e3,
        // So stiff that the spheres hardly part meanwhile.
        rolling_stiffness: Some(500.0),
        twisting_stiffness: Some(300.0),
        ..RESISTING
    };
    let n = [0.0, 0.6, 0.8];
    for (axis, k, eta, inertia) in [([1.0, 0.0, 0.0], 500.0, 0.2, 1.4), (n, 300.0, 0.1, 0.4)] {
        // I φ'' = -k_r φ - C_r φ' of the relative angle φ with I = (2/5) mR²/2.
        let stiffness = k * RADIUS * RADIUS / 4.0;
        let damping = 2.0 * eta * (0.5 * inertia * mass * RADIUS * RADIUS * stiffness).sqrt();
        let moment = 0.2 * mass * RADIUS * RADIUS;
        let (rate, decay) = ((stiffness / moment).sqrt(), 0.5 * damping / moment);
        let turning = (rate * rate - decay * decay).sqrt();
        let (spin, end) = (1e-3, 3.0 / rate);
        let expected = |end: f64| {
            spin * (-decay * end).exp()
                * ((turning * end).cos() - decay / turning * (turning * end).sin())
        };
        let errors = [400, 800].map(|steps| {
            let step = end / f64::from(steps);
            // A part of a step before they touch, and as much more at the end.
            let before = if approach > 0.0 { 20.3 * step } else { 0.0 };
            let distance = if approach > 0.0 {
                RADIUS + 0.5 * approach * before
            } else {
                0.99 * RADIUS
            };
            let grain = |side: f64| {
                [
                    n.map(|n| side * distance * n),
                    n.map(|n| -0.5 * side * approach * n),
                    axis.map(|a| 0.5 * side * spin * a),
                ]
            };
            let of = [grain(1.0), grain(-1.0)];
            let histories = ([0.0; 3], [0.0; 4]);
            let mut pair = couple([RADIUS; 2], law.as_ref(), &contact, step, of, histories);
            (0..steps + 20).for_each(|_| pair.advance());
            let [a, b] = [0, 1].map(|g| pair.system.grains().state(g).angular_velocity);
            let found: f64 = (0..3).map(|k| (a[k] - b[k]) * axis[k]).sum();
            let touched = f64::from(steps + 20) * step - before;
            (found - expected(touched)).abs() / spin
        });
        assert!(errors[1] < 1e-5, "{name} {approach}: {errors:?}");
        assert!(
            (3.5..4.5).contains(&(errors[0] / errors[1])),
            "{name}: {errors:?}"
        );
    }
}

/// Two equal spheres meet head on while they twist, so fast that the dashpot of twisting is beyond
/// its limit, which begins as that of the damped F_n; later the limit is above it. Beside the law
/// as a differential equation.
#[test]
fn a_torque_beyond_its_limit_is_set_back_at_the_touch() {
    const RADIUS: f64 = 0.5;
    let law = Springs {
        normal_stiffness: 1.0,
        tangential_stiffness: 0.4,
        density: 1.5,
        damping_ratio: 0.1,
        sliding_damping: 0.5,
    };
    let contact = Contact {
        rolling_friction: 0.0,
        twisting_friction: 1.0,
        ..RESISTING
    };
    let (spin, approach, end) = (0.5, 0.05, 1.0);
    let mass = law
        .masses()
        .of(0, 4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3));
    let arm = 0.5 * RADIUS;
    let k_w = 0.3 * arm * arm;
    let of_pair = 0.2 * mass * RADIUS * RADIUS;
    let c_w = 2.0 * 0.1 * (of_pair * k_w).sqrt();
    let gamma = 2.0 * 0.1 * (0.5 * mass).sqrt();
    let (mut overlap, mut v, mut turning, mut spring) = (0.0, approach, spin, 0.0);
    let fine = 1e-6;
    let mut stuck = 0;
    for k in 0..(end / fine) as u32 {
        let normal: f64 = overlap + gamma * v;
        let limit = normal * arm;
        let trial: f64 = spring - c_w * turning;
        let torque = trial.clamp(-limit, limit);
        assert!(
            k > 0 || trial < -limit,
            "it is beyond the limit at the touch"
        );
        stuck += u32::from(torque == trial);
        spring = torque + c_w * turning - fine * k_w * turning;
        turning += fine * torque / of_pair;
        v -= fine * normal / (0.5 * mass);
        overlap += fine * v;
    }
    assert!(stuck > 10_000);

    let n = [0.0, 0.6, 0.8];
    let errors = [200, 400].map(|steps| {
        let step = end / f64::from(steps);
        let distance = RADIUS + 0.5 * approach * 20.3 * step;
        let grain = |side: f64| {
            [
                n.map(|n| side * distance * n),
                n.map(|n| -0.5 * side * approach * n),
                n.map(|n| 0.5 * side * spin * n),
            ]
        };
        let of = [grain(1.0), grain(-1.0)];
        let histories = ([0.0; 3], [0.0; 4]);
        let mut pair = couple([RADIUS; 2], &law, &contact, step, of, histories);
        // The end is between two steps.
        let spins = [20, 1].map(|more| {
            let steps = if more == 20 { steps + more } else { more };
            (0..steps).for_each(|_| pair.advance());
            let [a, b] = [0, 1].map(|g| pair.system.grains().state(g).angular_velocity);
            (0..3).map(|k| (a[k] - b[k]) * n[k]).sum::<f64>()
        });
        let found = spins[0] + 0.3 * (spins[1] - spins[0]);
        (found - turning).abs() / spin
    });
    assert!(errors.iter().all(|error| *error < 1e-6), "{errors:?}");
}

/// Two grains a little within the largest overlap of a law, then a little beyond it.
fn ends_at_the_largest_overlap<D: Dimension>(
    name: &str,
    of: &dyn Constants,
    law: Option<Box<dyn PairForce<D>>>,
) {
    let Some(law) = law else {
        return;
    };
    let most = of.largest_overlap(RADII[0], RADII[1]);
    let distance = |part: f64| RADII[0] + RADII[1] - part * most;
    let places = [
        [[0.0; 3]; 3],
        [[distance(0.999), 0.0, 0.0], [0.0; 3], [0.0; 3]],
    ];
    let mut pair = Rig::couple(law, (of.masses(), 0.01), RADII, places, Vec::new());
    pair.system.grains_mut().fields_mut(1)[0] -= 0.002 * most;
    let law = pair.law.as_ref();
    let outside = forces(&Solo, &mut pair.system, law, &mut NoWalls, 0.0, None);
    assert!(
        matches!(outside, Some(Outside::Pair(..))),
        "{name}: {outside:?}"
    );
}

#[test]
fn every_law_ends_at_its_largest_overlap() {
    for ((name, law), resists) in all_contacts() {
        let contact = if resists { RESISTING } else { Contact::NONE };
        ends_at_the_largest_overlap(name, law.as_ref(), law.spheres(&contact));
        ends_at_the_largest_overlap(name, law.as_ref(), law.disks(&Contact::NONE));
    }
}
